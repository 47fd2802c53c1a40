//! The fault injector around the firmware's link and its front-end, over many seeds: whatever is injected is counted, no
//! wrong sample is delivered, and the host's counts say what was missing.

#![allow(clippy::unwrap_used, reason = "clippy exempts tests, but not their helpers")]

#[path = "../../../firmware/core/tests/rig/mod.rs"]
mod bench;

use std::sync::Arc;
use std::time::{Duration, Instant};

use bench::{Bench, Conversion, Rig, World};
use palpate::math::random::Draw;
use palpate_device::sample_sequence::{Continuity, Sequence};
use palpate_device::session::{SessionOptions, Settings};
use palpate_device::simulated::{Config, FaultyLine, Injected, LineFaults, LinkFaults, Pace, SimulatedDevice};
use palpate_device::wire_reader::MessageReader;
use palpate_device::{Incoming, Session};
use palpate_shared::frame::{FRAME_MAX, encode};
use palpate_shared::sim::{Faults, FingerConfig, FloatingBus, MICROSTRAIN};
use palpate_shared::wire::{Block, Command, CommandId, FromDevice, Outcome, Reply, Request, Status};

/// Seeds by default; `PALPATE_FAULT_SEEDS` names another number, as does a CI that wants to be through sooner.
const SEEDS: u64 = 1000;

/// Conversions of each of a seed's two lives while faults come and go: a third of a second.
const CONVERSIONS: u32 = 1200;

/// What the host makes of the line.
#[derive(Default)]
struct Host {
    reader: MessageReader,
    sequence: Sequence,
    delivered: u64,
    wrong: u64,
    /// Number after the last sample.
    end: u64,
    hellos: u64,
    /// Commands that were done.
    done: Vec<CommandId>,
}

impl Host {
    fn hear(&mut self, bytes: &[u8], conversions: &[Conversion]) {
        let mut messages = Vec::new();
        self.reader.read(bytes, |message| messages.push(message));
        for message in messages {
            match message {
                FromDevice::Hello(_) => {
                    self.hellos += 1;
                    self.end = 0;
                    self.done.clear();
                    self.sequence.begin_anew();
                }
                FromDevice::Block(block) => self.take(&block, conversions),
                FromDevice::Reply(Reply { id, outcome: Outcome::Done }) => self.done.push(id),
                _ => {}
            }
        }
    }

    fn take(&mut self, block: &Block, conversions: &[Conversion]) {
        let place = self.sequence.place(block.first, block.time, block.samples.len());
        match place.continuity {
            Continuity::Missing(_) => {
                self.delivered += block.samples.len() as u64;
                self.end = place.first + block.samples.len() as u64;
                self.wrong += wrong_samples(block, conversions);
            }
            Continuity::Repeated(repeated) => assert_eq!(repeated, block.samples.len() as u64),
            strange => panic!("{strange:?}: {block:?}"),
        }
    }
}

/// Samples whose codes are not those of the conversions that they stand for, or of another gain.
fn wrong_samples(block: &Block, conversions: &[Conversion]) -> u64 {
    let at = conversions.binary_search_by_key(&block.time.0, |made| made.time.0).expect("a conversion of that time");
    let settles = block.status.contains(Status::SETTLING);
    let is_wrong = |(got, made): &(&[_; 2], &Conversion)| **got != made.codes || !(made.has_set_gain || settles);
    block.samples.iter().zip(&conversions[at..]).filter(is_wrong).count() as u64
}

/// A device, its two lines and what is broken on the way.
struct Rigged<'a, 'w> {
    rig: Rig<'w>,
    to_host: &'a mut FaultyLine,
    to_device: FaultyLine,
    host: &'a mut Host,
    commands: u64,
    /// The lines' clock at the device's start: a restart does not turn it back.
    began_us: u64,
}

impl Rigged<'_, '_> {
    fn now_us(&self) -> u64 {
        self.began_us + u64::from(self.rig.now().0)
    }

    /// One conversion; whether the host reads meanwhile.
    fn step(&mut self, reads: bool) {
        self.rig.step();
        let (now, now_us) = (self.rig.now(), self.now_us());
        let arrived = self.to_device.receive(now_us);
        self.rig.device.receive(&arrived, now);
        self.rig.device.poll(now);
        if reads {
            while !self.rig.device.transmit().is_empty() {
                let bytes = self.rig.device.transmit().to_vec();
                self.rig.device.transmitted(bytes.len());
                self.to_host.send(&bytes, now_us);
            }
            let arrived = self.to_host.receive(now_us);
            self.host.hear(&arrived, &self.rig.conversions);
        }
    }

    /// Gives an order past the faults, again while the device is busy with an earlier command, until it is done.
    fn order(&mut self, request: Request) {
        for _ in 0..100 {
            self.commands += 1;
            let id = self.rig.send(request);
            (0..40).for_each(|_| self.step(true));
            if self.host.done.contains(&id) {
                return;
            }
        }
        panic!("{request:?} is not done");
    }

    fn command(&mut self, request: Request) {
        self.commands += 1;
        let id = CommandId(u32::try_from(self.commands).unwrap());
        let frame = encode(&Command::new(id, request), &mut [0; FRAME_MAX + 1]).unwrap().to_vec();
        self.to_device.send(&frame, self.now_us());
    }

    /// Faults come and go, commands are sent.
    fn suffer(&mut self, draw: &mut Draw) {
        let (mut asleep, mut next) = (0, 0);
        for conversion in 0..CONVERSIONS {
            if conversion == next {
                next += 20 + u32::try_from(draw.index(300)).unwrap();
                match draw.index(4) {
                    0 => self.rig.set_faults(front_end_faults(draw)),
                    1 => self.to_host.set_faults(line_faults(draw)),
                    2 => self.rig.overlook_edges = u32::try_from(draw.index(40)).unwrap(),
                    _ => asleep = draw.index(400),
                }
            }
            if draw.index(40) == 0 {
                let requests =
                    [Request::Ping, Request::SelfTest, Request::Counters, Request::ReadRegister { address: 4 }];
                self.command(requests[draw.index(4)]);
            }
            self.step(asleep == 0);
            asleep = asleep.saturating_sub(1);
        }
    }

    /// Everything that is still to come has come.
    fn come_to_rest(&mut self) {
        self.to_host.set_faults(LineFaults::default());
        self.to_device.set_faults(LineFaults::default());
        self.rig.overlook_edges = 0;
        // A job on a damaged bus may have to begin again before the stop is taken up.
        self.rig.set_faults(Faults::default());
        while !self.to_device.is_idle() {
            self.step(true);
        }
        self.order(Request::Stop);
        while !self.to_host.is_idle() {
            self.step(true);
        }
    }
}

fn front_end_faults(draw: &mut Draw) -> Faults {
    // Beyond, four damaged bits in one frame, the least that can pass its CRC, would be too common.
    let bits_max = if draw.index(2) == 0 { 0.002 } else { 0.0 };
    Faults {
        bit_error_rate: single(draw.uniform(0.0, bits_max)),
        data_ready_stuck: draw.index(8) == 0,
        chip_absent: (draw.index(10) == 0).then_some(FloatingBus::High),
        stuck_codes: draw.index(6) == 0,
        saturated: [draw.index(6) == 0, draw.index(6) == 0],
        open_gauge: [draw.index(6) == 0, draw.index(6) == 0],
        drift_per_s: single(draw.uniform(-10.0, 10.0)) * MICROSTRAIN,
        hum_peak_to_peak: single(draw.uniform(0.0, 20.0)) * MICROSTRAIN,
        excitation_change: single(draw.uniform(-0.05, 0.05)),
        // It makes no conversions that could be held against what was counted.
        clock_stopped: false,
    }
}

/// As the simulation computes.
#[expect(clippy::cast_possible_truncation, reason = "a small number")]
fn single(number: f64) -> f32 {
    number as f32
}

fn line_faults(draw: &mut Draw) -> LineFaults {
    let mut some = |most: f64| if draw.index(2) == 0 { draw.uniform(0.0, most) } else { 0.0 };
    let (drop, corrupt, duplicate, noise) = (some(0.1), some(0.1), some(0.1), some(0.1));
    let (delay_s, stall, stall_s) = (some(0.01), some(0.02), some(0.05));
    LineFaults { drop, corrupt, duplicate, noise, delay_s, stall, stall_s, pieces: draw.index(2) == 0 }
}

/// Two lives of a device on one line; what was injected towards the host.
fn two_lives(seed: u64) -> Injected {
    let mut draw = Draw::new(seed);
    let (mut to_host, mut host) = (FaultyLine::new(LineFaults::default(), seed), Host::default());
    let mut began_us = 0;
    for life in 1..=2 {
        let mut world = World::new(FingerConfig::default(), seed.wrapping_mul(2) + life);
        let mut rig = Rig::new(&mut world, Bench::default());
        rig.link_open = false;
        let (before, lost_before, delivered_before) = (to_host.injected(), host.sequence.missing(), host.delivered);
        let to_device = FaultyLine::new(line_faults(&mut draw), seed.wrapping_add(life));
        let mut rigged = Rigged { rig, to_host: &mut to_host, to_device, host: &mut host, commands: 0, began_us };
        (0..20).for_each(|_| rigged.step(true));
        assert_eq!(rigged.host.hellos, life);
        rigged.order(Request::Start);
        rigged.to_host.set_faults(line_faults(&mut draw));
        rigged.suffer(&mut draw);
        rigged.come_to_rest();
        began_us = rigged.now_us();

        let counters = rigged.rig.device.counters();
        let towards_device = rigged.to_device.injected();
        let sent = rigged.commands + towards_device.duplicated - towards_device.dropped - towards_device.corrupted;
        assert_eq!(u64::from(counters.commands), sent, "seed {seed}: {counters:?}");
        assert_eq!(u64::from(counters.frames_damaged), towards_device.damaged(), "seed {seed}: {counters:?}");

        let injected = to_host.injected();
        let on_the_line = injected.samples_lost - before.samples_lost;
        let in_the_device = u64::from(counters.samples_missed + counters.samples_damaged + counters.samples_dropped);
        let delivered = host.delivered - delivered_before;
        assert_eq!(
            u64::from(counters.samples),
            delivered + in_the_device + on_the_line,
            "seed {seed}: {counters:?}, {injected:?}"
        );
        let after_the_last = u64::from(counters.samples) - host.end;
        let missing = host.sequence.missing() - lost_before + after_the_last;
        assert_eq!(missing, in_the_device + on_the_line, "seed {seed}: {counters:?}, {injected:?}");
    }
    let injected = to_host.injected();
    assert_eq!(host.wrong, 0, "seed {seed}");
    assert_eq!(host.reader.counts().damaged, injected.damaged(), "seed {seed}");
    assert_eq!(host.sequence.repeated(), injected.samples_repeated, "seed {seed}");
    assert_eq!((host.sequence.strays(), host.reader.counts().malformed), (0, 0), "seed {seed}");
    injected
}

#[test]
fn whatever_is_injected_is_counted_and_nothing_wrong_is_delivered() {
    let seeds = std::env::var("PALPATE_FAULT_SEEDS").ok().and_then(|seeds| seeds.parse().ok()).unwrap_or(SEEDS);
    let all: Vec<Injected> = (0..seeds).map(two_lives).collect();
    // And something was.
    let sum = |count: fn(&Injected) -> u64| all.iter().map(count).sum::<u64>();
    assert!(sum(|injected| injected.dropped) > seeds && sum(|injected| injected.corrupted) > seeds);
    assert!(sum(|injected| injected.duplicated) > seeds && sum(|injected| injected.noise) > seeds);
    assert!(sum(|injected| injected.stalled) > seeds / 4);
}

/// How long a session may take for what an idle machine does in a second.
const PATIENCE: Duration = Duration::from_secs(60);

/// A session on a line with all faults at once, whose cable is pulled and whose device restarts now and then: it always
/// comes back, its samples are in order, and its counts say what is missing between them.
#[test]
fn a_session_comes_through_everything_at_once() {
    for seed in 0..8 {
        let line = LineFaults {
            drop: 0.01,
            corrupt: 0.01,
            duplicate: 0.01,
            noise: 0.01,
            delay_s: 0.004,
            stall: 0.002,
            stall_s: 0.03,
            pieces: true,
        };
        let link_faults = LinkFaults { line, unplug_every_s: 3.0, restart_every_s: 3.0 };
        let config = Config { seed, pace: Pace::AsRead, ..Config::default() };
        let device = Arc::new(SimulatedDevice::start(config).unwrap());
        let mut session = Session::open_simulated(Arc::clone(&device), SessionOptions::default()).unwrap();
        let settings = Settings::of(session.hello());
        session.start().unwrap();
        device.set_link_faults(link_faults).unwrap();
        let (begun, mut next, mut missing, mut samples) = (Instant::now(), None, 0, 0);
        let has_seen_all = |session: &Session| session.counts().disconnections > 0 && session.counts().restarts > 0;
        while samples < 40_000 || !has_seen_all(&session) {
            assert!(begun.elapsed() < PATIENCE, "seed {seed}: {:?}", session.counts());
            match session.next(Duration::from_millis(100)).unwrap() {
                Some(Incoming::Samples(block)) => {
                    let begins = block.first - block.missing_before;
                    assert!(next.is_none_or(|next| next == begins), "seed {seed}: {next:?}, {block:?}");
                    next = Some(block.first + block.counts.len() as u64);
                    samples += block.counts.len() as u64;
                    missing += block.missing_before;
                }
                Some(Incoming::Restarted(_)) => next = None,
                _ => {}
            }
        }
        let injected = device.injected().unwrap();
        let counts = session.counts();
        assert!(injected.restarted > 0 && injected.unplugged > 0, "seed {seed}: {injected:?}");
        // What waits to be handed on is counted already.
        assert!(counts.samples >= samples && counts.missing >= missing, "seed {seed}: {counts:?}");
        // An unplug or a restart cuts frames in both directions: the one under way, its rest, and what that is joined to.
        // How many without them is held exactly by the tests above.
        let cut = 3 * (injected.unplugged + injected.restarted);
        assert!(counts.damaged_frames <= injected.to_host.damaged() + cut, "seed {seed}: {counts:?}, {injected:?}");
        assert_eq!(Settings::of(session.hello()), settings);
    }
}
