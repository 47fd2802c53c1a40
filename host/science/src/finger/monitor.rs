//! What somebody who watches a finger is told, and when: judged samples in, lines out.
//!
//! A line is due on the samples' own time, and at once where contact begins or ends, or a sample turns out to be no
//! measurement, or one again. Each says what the samples since the line before lacked, so that nothing lost falls
//! between two lines.
//!
//! Units: device time in s. Errors: none.

use super::judge::{Judged, SampleFault, Tally};
use super::sense::{FingerSense, Sensed};

/// A line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MonitorLine {
    /// What the last sample was worth.
    pub sensed: Sensed,
    /// What came, and did not, since the line before.
    pub since_last: Tally,
    /// The same since the beginning.
    pub since_start: Tally,
}

/// A finger that is watched.
#[derive(Clone, Debug)]
pub struct ContactMonitor {
    sense: FingerSense,
    /// Time between two lines, s; 0 for a line a reading.
    period_s: f64,
    /// Device time of the next line, s.
    next_s: f64,
    fault: Option<SampleFault>,
    tally: Tally,
    /// What was told with the last line.
    told: Tally,
}

impl ContactMonitor {
    /// A tared finger, of which a line shall be told every `period_s` seconds; 0 for a line a reading.
    #[must_use]
    pub fn new(sense: FingerSense, period_s: f64) -> Self {
        let (tally, told) = (Tally::default(), Tally::default());
        Self { sense, period_s, next_s: f64::NEG_INFINITY, fault: None, tally, told }
    }

    /// Takes what came next, and gives the lines that are due.
    pub fn take(&mut self, judged: impl IntoIterator<Item = Judged>) -> Vec<MonitorLine> {
        judged.into_iter().filter_map(|item| self.take_item(item)).collect()
    }

    /// What came, and did not, since the beginning.
    #[must_use]
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Goes on with another tare. What was counted stays.
    pub fn set_sense(&mut self, sense: FingerSense) {
        self.sense = sense;
        self.next_s = f64::NEG_INFINITY;
    }

    fn take_item(&mut self, item: Judged) -> Option<MonitorLine> {
        self.tally.add(&item);
        let sensed = self.sense.feel([item]).pop()?;
        let (t, fault, event) = match &sensed {
            Sensed::Contact(reading) => (reading.t, None, reading.event),
            Sensed::NotMeasured { t, fault } => (*t, Some(*fault), None),
        };
        let is_news = event.is_some() || fault != self.fault;
        self.fault = fault;
        if !is_news && t < self.next_s {
            return None;
        }
        self.next_s = t + self.period_s;
        let since_last = self.tally - self.told;
        self.told = self.tally;
        Some(MonitorLine { sensed, since_last, since_start: self.tally })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finger::contact::test_noise::Noise;
    use crate::finger::contact::{Averaging, ContactSettings, Reading, Tare};

    /// A finger tared on a second of noise at 1 kHz, watched with ten lines a second.
    fn watched(noise: &mut Noise) -> ContactMonitor {
        let settings = ContactSettings { averaging: Averaging::Seconds(0.02), ..ContactSettings::default() };
        let tare = Tare::estimate(&noise.readings(1000), &settings.tare_settings()).unwrap();
        ContactMonitor::new(FingerSense::new(None, tare, &settings).unwrap(), 0.1)
    }

    #[test]
    fn what_is_lost_is_in_the_next_line_whatever_the_averaging_hides() {
        let mut noise = Noise::white(1, 0.005);
        let mut monitor = watched(&mut noise);
        let (mut lost, mut told) = (0, Tally::default());
        let mut lines = 0;
        for i in 0..5000_u64 {
            // Two blocks in a hundred are lost, oftener than the averaging's window fills.
            let mut items = Vec::new();
            if i % 17 == 16 {
                noise.t += 8e-3;
                lost += 8;
                items.push(Judged::Missing(Some(8)));
            }
            items.push(Judged::Measured(noise.reading()));
            for line in monitor.take(items) {
                lines += 1;
                told = line.since_start;
            }
        }
        assert_eq!(monitor.tally().missing, lost);
        // Nothing fills the window: there is no line at all, and the tally still knows.
        assert_eq!((lines, told), (0, Tally::default()));
        let more: Vec<_> = (0..200).flat_map(|_| monitor.take([Judged::Measured(noise.reading())])).collect();
        assert_eq!(more[0].since_last.missing, lost);
        assert_eq!(more.iter().map(|line| line.since_last.missing).sum::<u64>(), lost);
    }

    #[test]
    fn a_fault_is_told_at_once_and_so_is_its_end() {
        let mut noise = Noise::white(2, 0.005);
        let mut monitor = watched(&mut noise);
        let fault = SampleFault::Stuck { channel: 1 };
        let mut lines = Vec::new();
        for i in 0..400 {
            let reading: Reading = noise.reading();
            let bad = (150..250).contains(&i);
            let item = if bad { Judged::NotMeasured { t: reading.t, fault } } else { Judged::Measured(reading) };
            lines.extend(monitor.take([item]).into_iter().map(|line| (i, line)));
        }
        let first = lines.iter().find(|(_, line)| matches!(line.sensed, Sensed::NotMeasured { .. })).unwrap();
        assert_eq!(first.0, 150);
        // After the fault the window of 20 readings fills again.
        let back = lines.iter().find(|(i, line)| *i > 250 && matches!(line.sensed, Sensed::Contact(_))).unwrap();
        assert!((265..275).contains(&back.0), "{}", back.0);
        assert_eq!(lines.iter().map(|(_, line)| line.since_last.stuck[1]).sum::<u64>(), 100);
    }
}
