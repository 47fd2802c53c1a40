//! What goes wrong on a line: a fault injector for the bytes of any link, in one direction.
//!
//! [`FaultyLine`] takes bytes as they are sent and gives them as they arrive. Faults strike frame by frame, drawn from a
//! seed, and may be combined as one likes; [`Injected`] counts each, so that what a receiver counts can be held against
//! it. Order is kept, as any serial line keeps it. Without faults, what comes out is what went in.
//!
//! Times: µs on the clock of whoever calls. Errors: none.

use std::collections::VecDeque;

use palpate::math::random::Draw;
use palpate_shared::frame::{DELIMITER, decode_in_place};
use palpate_shared::wire::FromDevice;

/// Bytes of a burst of noise, at most: longer than a frame may be.
const NOISE_MAX: usize = 300;

/// Bytes that are lost from within a frame, at most.
const CUT_MAX: usize = 8;

/// What is wrong with a line. Each is a probability for a frame, 0 to 1, unless it says otherwise; the default is none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LineFaults {
    /// The frame is lost.
    pub drop: f64,
    /// Bits of the frame are flipped, bytes of it are lost, or noise stands right before it; then it is lost too.
    pub corrupt: f64,
    /// The frame comes twice.
    pub duplicate: f64,
    /// Noise comes before the frame and ends in a delimiter, so that the frame is not hurt.
    pub noise: f64,
    /// The longest time that a frame takes, in s; each takes a random part of it.
    pub delay_s: f64,
    /// The line stands still before the frame, for [`Self::stall_s`].
    pub stall: f64,
    /// How long it then stands still, in s.
    pub stall_s: f64,
    /// What arrives is read in pieces of random size, which begin and end anywhere.
    pub pieces: bool,
}

/// What was done to a line's frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Injected {
    /// Frames that were lost whole.
    pub dropped: u64,
    /// Frames that were damaged, each so that its receiver sees one damaged frame.
    pub corrupted: u64,
    /// Frames that came twice.
    pub duplicated: u64,
    /// Bursts of noise between frames, each of which its receiver sees as one damaged frame.
    pub noise: u64,
    /// Times that the line stood still.
    pub stalled: u64,
    /// Samples in the frames that were dropped or corrupted.
    pub samples_lost: u64,
    /// Samples in the frames that came twice.
    pub samples_repeated: u64,
}

impl Injected {
    /// Damaged frames that the receiver sees.
    #[must_use]
    pub fn damaged(&self) -> u64 {
        self.corrupted + self.noise
    }
}

/// A line with faults, in one direction.
///
/// ```
/// use palpate_device::simulated::{FaultyLine, LineFaults};
/// let mut line = FaultyLine::new(LineFaults { drop: 1.0, ..LineFaults::default() }, 1);
/// // The first may be the end of a frame that began before the line was watched: it is left alone.
/// line.send(&[3, 1, 2, 0, 3, 1, 2, 0], 0);
/// assert_eq!((line.receive(1000), line.injected().dropped), (vec![3, 1, 2, 0], 1));
/// ```
#[derive(Clone, Debug)]
pub struct FaultyLine {
    faults: LineFaults,
    draw: Draw,
    /// The frame that is being sent.
    frame: Vec<u8>,
    /// What is on its way, with the time of its arrival.
    under_way: VecDeque<(u64, Vec<u8>)>,
    /// What has arrived and was not read.
    arrived: VecDeque<u8>,
    /// When the last frame arrives: none overtakes another.
    last_due_us: u64,
    /// Whether a frame has passed since the line was put up. A receiver takes what comes before for the end of a frame
    /// that it did not see begin, so until then nothing is hurt.
    in_step: bool,
    injected: Injected,
}

impl FaultyLine {
    /// A line with these faults.
    #[must_use]
    pub fn new(faults: LineFaults, seed: u64) -> Self {
        Self {
            faults,
            draw: Draw::new(seed),
            frame: Vec::new(),
            under_way: VecDeque::new(),
            arrived: VecDeque::new(),
            last_due_us: 0,
            in_step: false,
            injected: Injected::default(),
        }
    }

    /// What is wrong from the next frame on.
    pub fn set_faults(&mut self, faults: LineFaults) {
        self.faults = faults;
    }

    /// What is wrong at present.
    #[must_use]
    pub fn faults(&self) -> LineFaults {
        self.faults
    }

    /// What was done so far.
    #[must_use]
    pub fn injected(&self) -> Injected {
        self.injected
    }

    /// Whether nothing is on its way or waits to be read.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.frame.is_empty() && self.under_way.is_empty() && self.arrived.is_empty()
    }

    /// Bytes on their way or waiting to be read.
    #[must_use]
    pub fn len(&self) -> usize {
        self.frame.len() + self.arrived.len() + self.under_way.iter().map(|(_, bytes)| bytes.len()).sum::<usize>()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.is_idle()
    }

    /// Takes bytes at a time; a frame goes on its way with its last byte.
    pub fn send(&mut self, bytes: &[u8], now_us: u64) {
        for &byte in bytes {
            self.frame.push(byte);
            if byte == DELIMITER {
                let frame = std::mem::take(&mut self.frame);
                self.strike(frame, now_us);
            }
        }
    }

    /// What is read at a time; nothing if nothing has arrived.
    pub fn receive(&mut self, now_us: u64) -> Vec<u8> {
        while self.under_way.front().is_some_and(|(due_us, _)| *due_us <= now_us) {
            self.arrived.extend(self.under_way.pop_front().map(|(_, bytes)| bytes).unwrap_or_default());
        }
        let most = self.arrived.len();
        let length = if !self.faults.pieces || most == 0 { most } else { self.draw.index(most + 1) };
        self.arrived.drain(..length).collect()
    }

    /// Bytes that were received and not taken: they come again first.
    pub fn give_back(&mut self, bytes: &[u8]) {
        bytes.iter().rev().for_each(|&byte| self.arrived.push_front(byte));
    }

    /// The cable is pulled: what is on its way is lost.
    pub fn cut(&mut self) {
        self.frame.clear();
        self.under_way.clear();
        self.arrived.clear();
        self.in_step = false;
    }

    /// Lets faults strike a frame, delimiter included.
    fn strike(&mut self, frame: Vec<u8>, now_us: u64) {
        let faults = self.faults;
        let is_frame = frame.len() > 1;
        if !is_frame || !std::mem::replace(&mut self.in_step, true) {
            return self.put(frame, now_us);
        }
        if self.draw.unit() < faults.stall {
            self.injected.stalled += 1;
            self.last_due_us = self.last_due_us.max(now_us) + microseconds(faults.stall_s);
        }
        if self.draw.unit() < faults.noise {
            self.injected.noise += 1;
            let mut noise = self.noise();
            noise.push(DELIMITER);
            self.put(noise, now_us);
        }
        let (chance, samples) = (self.draw.unit(), samples_in(&frame));
        if chance < faults.drop {
            self.injected.dropped += 1;
            self.injected.samples_lost += samples;
        } else if chance < faults.drop + faults.corrupt {
            self.injected.corrupted += 1;
            self.injected.samples_lost += samples;
            let damaged = self.damage(frame);
            self.put(damaged, now_us);
        } else if chance < faults.drop + faults.corrupt + faults.duplicate {
            self.injected.duplicated += 1;
            self.injected.samples_repeated += samples;
            self.put(frame.clone(), now_us);
            self.put(frame, now_us);
        } else {
            self.put(frame, now_us);
        }
    }

    fn put(&mut self, bytes: Vec<u8>, now_us: u64) {
        let delay_us = if self.faults.delay_s > 0.0 { microseconds(self.faults.delay_s * self.draw.unit()) } else { 0 };
        self.last_due_us = self.last_due_us.max(now_us + delay_us);
        self.under_way.push_back((self.last_due_us, bytes));
    }

    /// Bytes that hold no delimiter.
    fn noise(&mut self) -> Vec<u8> {
        let length = 1 + self.draw.index(NOISE_MAX);
        (0..length).map(|_| self.byte()).collect()
    }

    /// A byte that is no delimiter.
    fn byte(&mut self) -> u8 {
        u8::try_from(1 + self.draw.index(255)).unwrap_or(1)
    }

    /// A frame after something on its way that its checksum finds out, and that leaves one frame of it.
    fn damage(&mut self, mut frame: Vec<u8>) -> Vec<u8> {
        let body = frame.len() - 1;
        match self.draw.index(3) {
            0 => {
                let at = self.draw.index(body);
                // The flip of one bit is always found out; that of a byte to a delimiter would make two frames of one.
                let flipped = frame[at] ^ (1_u8 << self.draw.index(8));
                frame[at] = if flipped == DELIMITER { frame[at] ^ 0x03 } else { flipped };
                frame
            }
            1 => {
                let cut = (1 + self.draw.index(CUT_MAX)).min(body - 1);
                let at = self.draw.index(body - cut + 1);
                frame.drain(at..at + cut);
                frame
            }
            _ => [self.noise(), frame].concat(),
        }
    }
}

/// A time in s as whole µs.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "negative and endless times saturate")]
pub(super) fn microseconds(seconds: f64) -> u64 {
    (seconds * 1e6) as u64
}

/// Samples that a device's frame holds, delimiter included.
fn samples_in(frame: &[u8]) -> u64 {
    let mut body = frame[..frame.len() - 1].to_vec();
    match decode_in_place(&mut body).ok().and_then(|payload| FromDevice::from_payload(payload).ok()) {
        Some(FromDevice::Block(block)) => block.samples.len() as u64,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use palpate_shared::frame::{FRAME_MAX, encode};
    use palpate_shared::units::{Counts, DeviceTime, Seq};
    use palpate_shared::wire::{Block, Status};
    use proptest::prelude::*;

    use super::*;
    use crate::wire_reader::MessageReader;

    fn frame(number: u32) -> Vec<u8> {
        let samples = (0..8).map(|i| [Counts(i), Counts(number.cast_signed())]).collect();
        let (first, time) = (Seq(8 * number), DeviceTime(2000 * number));
        let block = FromDevice::Block(Block { first, time, status: Status::default(), samples });
        encode(&block, &mut [0; FRAME_MAX + 1]).unwrap().to_vec()
    }

    #[test]
    fn frames_arrive_late_and_in_order() {
        let faults = LineFaults { delay_s: 0.01, stall: 0.1, stall_s: 0.05, ..LineFaults::default() };
        let mut line = FaultyLine::new(faults, 3);
        let (mut arrived, mut late) = (Vec::new(), 0);
        for number in 0..100 {
            let now_us = 2000 * u64::from(number);
            line.send(&frame(number), now_us);
            arrived.extend(line.receive(now_us));
            late += usize::from(!line.is_idle());
        }
        assert!(late > 50 && line.injected().stalled > 2);
        arrived.extend(line.receive(u64::MAX));
        assert_eq!(arrived, (0..100).flat_map(frame).collect::<Vec<u8>>());
    }

    #[test]
    fn a_cable_that_is_pulled_loses_what_is_under_way() {
        let mut line = FaultyLine::new(LineFaults { delay_s: 1.0, ..LineFaults::default() }, 3);
        line.send(&frame(1), 0);
        line.cut();
        assert!(line.is_idle() && line.receive(u64::MAX).is_empty());
    }

    proptest! {
        /// The receiver sees what was injected, no more and no less, and every message that it reads was sent.
        #[test]
        fn a_receiver_counts_what_was_injected(
            seed in any::<u64>(), drop in 0.0..0.3, corrupt in 0.0..0.3, duplicate in 0.0..0.3, noise in 0.0..0.3,
            pieces in any::<bool>(),
        ) {
            let faults = LineFaults { drop, corrupt, duplicate, noise, pieces, ..LineFaults::default() };
            let mut line = FaultyLine::new(faults, seed);
            let (mut reader, mut numbers) = (MessageReader::default(), Vec::new());
            for number in 0..200 {
                line.send(&frame(number), 0);
                let bytes = line.receive(0);
                reader.read(&bytes, |message| {
                    let FromDevice::Block(block) = message else { panic!("{message:?}") };
                    numbers.push(block.first.0 / 8);
                });
            }
            while !line.is_idle() {
                reader.read(&line.receive(0), |message| {
                    let FromDevice::Block(block) = message else { panic!("{message:?}") };
                    numbers.push(block.first.0 / 8);
                });
            }
            let injected = line.injected();
            prop_assert_eq!(reader.counts().damaged, injected.damaged());
            let repeated = numbers.windows(2).filter(|pair| pair[0] == pair[1]).count() as u64;
            prop_assert_eq!((repeated, 8 * repeated), (injected.duplicated, injected.samples_repeated));
            let lost = 200 + repeated - numbers.len() as u64;
            prop_assert_eq!((lost, 8 * lost), (injected.dropped + injected.corrupted, injected.samples_lost));
            prop_assert!(numbers.is_sorted());
        }
    }
}
