//! Two hosts, one on each link: whoever sent the last sound command is talked to.

mod rig;

use palpate_firmware_core::Link;
use palpate_shared::frame::{FRAME_MAX, FrameReader, encode};
use palpate_shared::sim::FingerConfig;
use palpate_shared::wire::{Command, CommandId, FrameBuffer, FromDevice, Outcome, Request};
use rig::{Bench, Rig, World};

/// A host that hears what its link carries, and nothing else.
#[derive(Default)]
struct Host {
    reader: FrameReader,
    messages: Vec<FromDevice>,
    damaged: usize,
}

impl Host {
    fn hear(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let (taken, frame) = self.reader.push(rest);
            match frame.map(|frame| frame.ok().and_then(|payload| FromDevice::from_payload(payload).ok())) {
                Some(Some(message)) => self.messages.push(message),
                Some(None) => self.damaged += 1,
                None => {}
            }
            rest = &rest[taken..];
        }
    }

    fn outcomes(&self, id: CommandId) -> Vec<&Outcome> {
        let replies = self.messages.iter().filter_map(|message| match message {
            FromDevice::Reply(reply) if reply.id == id => Some(&reply.outcome),
            _ => None,
        });
        replies.collect()
    }

    /// First number and length of each block.
    fn blocks(&self) -> Vec<(u32, usize)> {
        let block = |message: &FromDevice| match message {
            FromDevice::Block(block) => Some((block.first.0, block.samples.len())),
            _ => None,
        };
        self.messages.iter().filter_map(block).collect()
    }
}

/// A device between two hosts.
struct Between<'w> {
    rig: Rig<'w>,
    serial: Host,
    usb: Host,
    /// Most bytes that a link takes in one turn: less than a frame, so that frames are always under way.
    bytes_per_turn: usize,
}

impl<'w> Between<'w> {
    fn new(world: &'w mut World) -> Self {
        let mut rig = Rig::new(world, Bench { link_baud: 115_200, ..Bench::default() });
        rig.link_open = false;
        Self { rig, serial: Host::default(), usb: Host::default(), bytes_per_turn: 13 }
    }

    fn send(&mut self, link: Link, id: u32, request: Request) -> CommandId {
        let (mut line, id): (FrameBuffer, _) = ([0; FRAME_MAX + 1], CommandId(id));
        let frame = encode(&Command::new(id, request), &mut line).expect("a buffer for any frame");
        self.rig.device.receive_by(link, frame, self.rig.now());
        id
    }

    fn run(&mut self, turns: u32) {
        for _ in 0..turns {
            self.rig.step();
            let bytes: Vec<u8> = self.rig.device.transmit().iter().copied().take(self.bytes_per_turn).collect();
            self.rig.device.transmitted(bytes.len());
            match self.rig.device.link() {
                Link::Serial => self.serial.hear(&bytes),
                Link::Usb => self.usb.hear(&bytes),
            }
        }
    }
}

#[test]
fn replies_and_samples_go_to_the_host_that_spoke_last() {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut between = Between::new(&mut world);
    between.run(200);
    assert_eq!(between.rig.device.link(), Link::Serial);
    assert!(matches!(between.serial.messages[..], [FromDevice::Hello(_)]), "{:?}", between.serial.messages);

    let start = between.send(Link::Usb, 1, Request::Start);
    between.run(400);
    assert_eq!(between.usb.outcomes(start), [&Outcome::Done]);
    let before = between.usb.blocks();
    assert!(before.len() > 10 && between.serial.blocks().is_empty(), "{before:?}");

    // The same id, by chance, on the other link: a command of its own.
    let ping = between.send(Link::Serial, 1, Request::Ping);
    between.run(400);
    assert!(matches!(between.serial.outcomes(ping)[..], [Outcome::Pong { .. }]));
    let after = between.serial.blocks();
    // At most the block that was under way is lost, and the rest arrives once, in order.
    let taken_over = between.usb.blocks();
    let (last, first) = (*taken_over.last().unwrap(), after[0]);
    assert!((0..=8).contains(&(first.0 - last.0 - 8)), "{last:?}, then {first:?}");
    for pair in after.windows(2) {
        assert_eq!(pair[0].0 + 8, pair[1].0);
    }

    let ping = between.send(Link::Usb, 2, Request::Ping);
    between.run(100);
    assert!(matches!(between.usb.outcomes(ping)[..], [Outcome::Pong { .. }]));
    assert!(between.usb.blocks().len() > taken_over.len());
    // The half frame on USB from before was ended by a delimiter.
    assert!(
        between.usb.damaged <= 1 && between.serial.damaged == 0,
        "{} {}",
        between.usb.damaged,
        between.serial.damaged
    );
}

#[test]
fn only_a_sound_command_changes_the_link_and_links_do_not_disturb_each_other() {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut between = Between::new(&mut world);
    between.run(200);
    let mut line: FrameBuffer = [0; FRAME_MAX + 1];
    let frame = encode(&Command::new(CommandId(7), Request::Ping), &mut line).unwrap().to_vec();
    let (head, tail) = frame.split_at(frame.len() / 2);
    let now = between.rig.now();
    between.rig.device.receive_by(Link::Serial, head, now);
    between.rig.device.receive_by(Link::Usb, &[3, 1, 4, 1, 5, 0, 9, 2, 0], now);
    assert_eq!((between.rig.device.link(), between.rig.device.counters().frames_damaged), (Link::Serial, 2));
    between.rig.device.receive_by(Link::Serial, tail, now);
    between.run(50);
    assert!(matches!(between.serial.outcomes(CommandId(7))[..], [Outcome::Pong { .. }]));
    assert_eq!(between.usb.messages, []);
}

#[test]
fn a_reply_for_a_host_that_was_taken_over_waits_until_it_asks_again() {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut between = Between::new(&mut world);
    between.run(200);
    let gain = between.send(Link::Serial, 5, Request::SetGain { gain: 8 });
    let ping = between.send(Link::Usb, 6, Request::Ping);
    between.run(400);
    assert!(matches!(between.usb.outcomes(ping)[..], [Outcome::Pong { .. }]));
    assert!(between.serial.outcomes(gain).is_empty() && between.usb.outcomes(gain).is_empty());
    between.send(Link::Serial, 5, Request::SetGain { gain: 8 });
    between.run(100);
    assert_eq!(between.serial.outcomes(gain), [&Outcome::Done]);
    assert_eq!(between.rig.device.counters().commands_repeated, 1);
}

#[test]
fn usb_has_no_speed_and_carries_what_the_line_does_not() {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut between = Between::new(&mut world);
    between.bytes_per_turn = usize::MAX;
    between.run(200);
    let fast = Request::SetRate { rate_hz: 8000 };
    let refused = between.send(Link::Serial, 1, fast);
    between.run(200);
    assert!(matches!(between.serial.outcomes(refused)[..], [Outcome::Refused(_)]));
    assert_eq!(between.rig.device.hello().link_baud, 115_200);
    let done = between.send(Link::Usb, 2, fast);
    between.run(400);
    assert_eq!(between.usb.outcomes(done), [&Outcome::Done]);
    assert_eq!(between.rig.device.hello().link_baud, 0);
}
