//! Which changes of the board's digital inputs are told.
//!
//! The first change after a rest is told with the sample that it is seen with, and so are [`BURST`] in a row. A line that
//! goes on changing is told once in [`SPACING_US`], with how often it changed: one that flutters takes no room from the
//! samples. Errors: none.

use palpate_shared::units::DeviceTime;
use palpate_shared::wire::Inputs;

/// Messages that may follow each other at once: the edges of four pulses.
const BURST: u8 = 8;

/// Time in which one message more is allowed, in µs: 200 a second, a tenth of what a line at 921600 baud leaves beside
/// 8000 samples a second.
const SPACING_US: u32 = 5000;

/// What was seen and told of the inputs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InputWatch {
    /// Levels last seen; `None` before the first look in a stream.
    seen: Option<u8>,
    /// Changes seen and not told.
    untold: u16,
    /// When the last of them was seen.
    changed: DeviceTime,
    /// Messages that may still follow each other at once.
    allowed: u8,
    /// Up to when `allowed` was counted.
    counted: DeviceTime,
}

impl Default for InputWatch {
    fn default() -> Self {
        Self { seen: None, untold: 0, changed: DeviceTime(0), allowed: BURST, counted: DeviceTime(0) }
    }
}

impl InputWatch {
    /// A stream begins, or is asked for again: what the inputs are is told anew.
    pub(crate) fn begin(&mut self) {
        *self = Self { allowed: self.allowed, counted: self.counted, ..Self::default() };
    }

    /// Takes what the inputs read with a sample; what to tell, if anything.
    pub(crate) fn look(&mut self, levels: u8, now: DeviceTime) -> Option<Inputs> {
        let before = self.seen.replace(levels);
        let is_first = before.is_none();
        let changed = before.map_or(0, |before| before ^ levels);
        if changed != 0 || is_first {
            self.changed = now;
            // Eight at most.
            self.untold = self.untold.saturating_add(u16::try_from(changed.count_ones()).unwrap_or(0));
        }
        if self.untold == 0 && !is_first {
            return None;
        }
        self.earn(now);
        self.allowed = self.allowed.checked_sub(1)?;
        let changes = core::mem::take(&mut self.untold);
        Some(Inputs { time: self.changed, levels, changes })
    }

    /// Allows what the time since the last count allows.
    fn earn(&mut self, now: DeviceTime) {
        let passed = now.since(self.counted) / SPACING_US;
        if self.allowed >= BURST || passed >= u32::from(BURST) {
            (self.allowed, self.counted) = (BURST, now);
            return;
        }
        self.allowed = self.allowed.saturating_add(u8::try_from(passed).unwrap_or(BURST)).min(BURST);
        self.counted = DeviceTime(self.counted.0.wrapping_add(passed * SPACING_US));
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    /// What is told of levels that are read every 250 µs.
    fn told(levels: impl IntoIterator<Item = u8>) -> Vec<Inputs> {
        let mut watch = InputWatch::default();
        let now = |n: u32| DeviceTime(1_000_000 + 250 * n);
        levels.into_iter().zip(0..).filter_map(|(levels, n)| watch.look(levels, now(n))).collect()
    }

    #[test]
    fn the_state_at_the_start_and_every_lone_change_are_told_at_their_samples() {
        let levels = (0..200_u32).map(|n| if (50..100).contains(&n) { 0x81 } else { 0x80 });
        let told: Vec<_> =
            told(levels).iter().map(|one| ((one.time.0 - 1_000_000) / 250, one.levels, one.changes)).collect();
        assert_eq!(told, [(0, 0x80, 0), (50, 0x81, 1), (100, 0x80, 1)]);
    }

    #[test]
    fn two_inputs_at_once_are_two_changes() {
        let told = told([0, 0, 0b110, 0b101]);
        assert_eq!(told.iter().map(|one| one.changes).collect::<Vec<_>>(), [0, 2, 2]);
    }

    #[test]
    fn a_line_that_flutters_is_told_now_and_then_and_no_change_is_uncounted() {
        let flutter = (0..4000_u32).map(|n| u8::from(n % 2 == 1)).chain(core::iter::repeat_n(0, 400));
        let told = told(flutter);
        // A second: the burst, then one in 5 ms.
        assert!((190..=225).contains(&told.len()), "{} messages", told.len());
        assert_eq!(told.iter().map(|one| u32::from(one.changes)).sum::<u32>(), 4000);
        let last = told.last().unwrap();
        assert_eq!((last.levels, last.time.0), (0, 1_000_000 + 250 * 4000));
    }

    #[test]
    fn a_pulse_that_could_not_be_told_singly_is_counted() {
        // Eight messages are gone; a pulse up and down comes within the next 5 ms.
        let mut watch = InputWatch::default();
        let mut heard = Vec::new();
        let levels = [0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0];
        for (&levels, n) in levels.iter().chain([0; 30].iter()).zip(0..) {
            heard.extend(watch.look(levels, DeviceTime(250 * n)));
        }
        assert_eq!(heard.len(), 9);
        assert_eq!((heard[8].levels, heard[8].changes), (0, 3));
    }

    #[test]
    fn the_state_is_told_anew_when_the_stream_is_asked_for_again() {
        let mut watch = InputWatch::default();
        assert!(watch.look(3, DeviceTime(0)).is_some());
        assert!(watch.look(3, DeviceTime(250)).is_none());
        watch.begin();
        assert_eq!(watch.look(3, DeviceTime(500)), Some(Inputs { time: DeviceTime(500), levels: 3, changes: 0 }));
    }
}
