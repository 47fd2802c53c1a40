//! All that the screen shows, made of what the session hands on.
//!
//! Frames: finger. Units: device time in s, force in the calibration's unit, strain in µm/m, angles in rad. Errors: none.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::Vector2;
use palpate::finger::Samples;
use palpate::finger::calibration::counts_vector;
use palpate::finger::contact::{Contact, Tare};
use palpate::finger::judge::{Judged, Tally};
use palpate::finger::monitor::MonitorLine;
use palpate::finger::sense::Sensed;
use palpate_device::Session;
use palpate_device::session::SessionCounts;
use palpate_shared::units::Counts;

/// How far back forces are shown, s.
pub(crate) const HISTORY_S: f64 = 30.0;

/// How far back contacts leave a trail on the disk, s.
pub(crate) const TRAIL_S: f64 = 2.0;

/// Strain, noise and rate are those of so long a stretch: ten periods of the mains at 50 Hz, twelve at 60 Hz.
const WINDOW_S: f64 = 0.2;

/// Losses are an alarm for so long, s.
const LOSS_SHOWN_S: f64 = 5.0;

/// From this share of the converter's range on a bridge is an alarm: a press harder by a quarter would end it.
const RANGE_ALARM: f64 = 0.8;

/// Noise so many times that after the tare is an alarm, where nothing touches: a loose cable, a motor nearby.
const NOISE_ALARM: f64 = 3.0;

/// What stays the same while a finger is watched.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Finger {
    /// The device's own number.
    pub(crate) device: String,
    /// Where it is connected.
    pub(crate) address: String,
    /// Whether it is a simulation.
    pub(crate) is_simulated: bool,
    /// Samples a second.
    pub(crate) rate_hz: u32,
    /// Unit of force.
    pub(crate) unit: &'static str,
    /// Strain of a count, µm/m.
    pub(crate) microstrain_per_count: f64,
}

impl Finger {
    /// The finger of this session.
    pub(crate) fn of(session: &Session, unit: &'static str, microstrain_per_count: f64) -> Self {
        let hello = session.hello();
        Self {
            device: hello.device.to_string(),
            address: session.address().to_string(),
            is_simulated: session.is_simulated(),
            rate_hz: hello.rate_hz,
            unit,
            microstrain_per_count,
        }
    }
}

/// Whether samples come.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum Link {
    /// They do, or are about to.
    #[default]
    Streaming,
    /// The device is there and sends none.
    Silent,
    /// It is not.
    Lost {
        /// How that was noticed.
        reason: String,
    },
}

/// A recording that is written.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Recorded {
    /// The file.
    pub(crate) file: String,
    /// Device time at which it began, s; none before its first sample.
    pub(crate) since: Option<f64>,
    /// Marks set in it.
    pub(crate) marks: u32,
    /// Whether it is still written.
    pub(crate) goes_on: bool,
}

/// The tare in use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TareInUse {
    /// What is subtracted.
    pub(crate) bias: Vector2<f64>,
    /// Standard deviation of a reading in the first window after it in which nothing touched, by axis.
    pub(crate) noise: Option<[f64; 2]>,
    /// When that was, s; none where it was before these samples.
    pub(crate) at: Option<f64>,
}

impl TareInUse {
    /// A tare that was taken at this time, s; none where it was before these samples.
    pub(crate) fn new(tare: &Tare, at: Option<f64>) -> Self {
        Self { bias: tare.bias, noise: None, at }
    }
}

/// A force of the past.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Past {
    /// When, s.
    pub(crate) t: f64,
    /// Its size; none where nothing was measured.
    pub(crate) magnitude: Option<f64>,
    /// Where it was felt, if it was a touch.
    pub(crate) u: Option<f64>,
}

/// Both bridges over the newest [`WINDOW_S`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Bridges {
    /// Mean strain, tare included.
    pub(crate) microstrain: [f64; 2],
    /// Largest share of the converter's range that a sample took.
    pub(crate) range: [f64; 2],
    /// Standard deviation of the readings about their mean, by axis of the finger; none without readings.
    pub(crate) noise: Option<[f64; 2]>,
    /// Samples a second that came, by the host's clock.
    pub(crate) rate_hz: f64,
}

/// All that is on the screen.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct State {
    /// Which finger.
    pub(crate) finger: Finger,
    /// Whether samples come.
    pub(crate) link: Link,
    /// Newest device time, s.
    pub(crate) t: f64,
    /// What is felt.
    pub(crate) felt: Option<Sensed>,
    /// The last [`HISTORY_S`].
    pub(crate) history: VecDeque<Past>,
    /// Strain and noise.
    pub(crate) bridges: Option<Bridges>,
    /// The tare in use; none before the first.
    pub(crate) tare: Option<TareInUse>,
    /// Whether one is being taken.
    pub(crate) is_taring: bool,
    /// What came and did not, since the first tare.
    pub(crate) tally: Tally,
    /// What the link counted.
    pub(crate) counts: SessionCounts,
    /// The board's, where it tells one.
    pub(crate) temperature_c: Option<f64>,
    /// The board's digital inputs, a bit for each, where it tells them.
    pub(crate) inputs: Option<u8>,
    /// The recording, if there is one.
    pub(crate) recording: Option<Recorded>,
    /// What was told last, the newest at the end.
    pub(crate) told: Vec<String>,
    /// When samples were last lost, s, and how many with those shortly before.
    pub(crate) loss: Option<(f64, u64)>,
    /// The stretch of which strain and noise come next.
    pub(crate) window: Window,
}

/// Sums over a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Window {
    samples: f64,
    /// Those that came after `begun`.
    arrived: f64,
    counts: Vector2<f64>,
    range: [f64; 2],
    readings: f64,
    /// A reading of the window, about which sums are taken: far from it they would round.
    origin: Option<Vector2<f64>>,
    force: Vector2<f64>,
    force_squared: Vector2<f64>,
    /// When the block before it arrived, on the host's clock.
    begun: Option<Duration>,
}

impl State {
    /// Takes a block that arrived at this time of the host's clock, and what it says of the force.
    pub(crate) fn take_block(&mut self, samples: &Samples, judged: &[Judged], arrival: Duration) {
        self.link = Link::Streaming;
        self.t = samples.device_time_s(samples.counts.len());
        if let Some(recording) = &mut self.recording {
            recording.since.get_or_insert(samples.device_time_s(0));
        }
        if samples.missing_before > 0 {
            let before = self.loss.filter(|(t, _)| self.t - t < LOSS_SHOWN_S).map_or(0, |(_, lost)| lost);
            self.loss = Some((self.t, before + samples.missing_before));
        }
        let window = &mut self.window;
        match window.begun {
            Some(_) => window.arrived += samples.counts.len() as f64,
            None => window.begun = Some(arrival),
        }
        for counts in &samples.counts {
            window.samples += 1.0;
            window.counts += counts_vector(*counts);
            for (range, counts) in window.range.iter_mut().zip(counts) {
                *range = range.max(f64::from(counts.0).abs() / f64::from(Counts::MAX.0));
            }
        }
        for reading in judged.iter().filter_map(|item| item.reading()) {
            let force = reading.force_finger - *window.origin.get_or_insert(reading.force_finger);
            window.readings += 1.0;
            window.force += force;
            window.force_squared += force.component_mul(&force);
        }
        if window.samples * samples.period_us * 1e-6 >= WINDOW_S {
            let bridges = window.concluded(arrival, self.finger.microstrain_per_count);
            let noise = bridges.noise.filter(|_| self.is_free());
            if let Some(tare) = &mut self.tare {
                tare.noise = tare.noise.or(noise);
            }
            self.bridges = Some(bridges);
            self.window = Window { begun: Some(arrival), ..Window::default() };
        }
    }

    /// Takes what is told of the newest sample.
    pub(crate) fn take_line(&mut self, line: &MonitorLine) {
        let (t, magnitude, u) = match &line.sensed {
            Sensed::NotMeasured { t, .. } => (*t, None, None),
            Sensed::Contact(reading) => match &reading.contact {
                Contact::Free { force_finger, .. } => (reading.t, Some(force_finger.norm()), None),
                Contact::Touching(touch) => (reading.t, Some(touch.magnitude), Some(touch.u)),
            },
        };
        self.felt = Some(line.sensed);
        self.tally = line.since_start;
        self.history.push_back(Past { t, magnitude, u });
        while self.history.front().is_some_and(|past| t - past.t > HISTORY_S) {
            self.history.pop_front();
        }
    }

    /// What a person must know of at once, the gravest first.
    pub(crate) fn alarms(&self) -> Vec<String> {
        let mut alarms = Vec::new();
        match &self.link {
            Link::Streaming => {}
            Link::Silent => alarms.push("no samples come".to_owned()),
            Link::Lost { reason } => alarms.push(format!("link lost ({reason}); waiting for it to come back")),
        }
        if let Some(Sensed::NotMeasured { fault, .. }) = &self.felt {
            alarms.push(format!("NOT MEASURING: {fault}"));
        }
        if self.recording.as_ref().is_some_and(|recording| !recording.goes_on) {
            alarms.push("the recording has ended".to_owned());
        }
        if let Some((t, lost)) = self.loss
            && self.t - t < LOSS_SHOWN_S
        {
            alarms.push(format!("{lost} samples missing in the last {LOSS_SHOWN_S} s"));
        }
        if let Some(bridges) = &self.bridges {
            for (bridge, range) in ["x", "y"].iter().zip(bridges.range).filter(|(_, range)| *range >= RANGE_ALARM) {
                alarms.push(format!("bridge {bridge} is at {:.0} % of its range", 100.0 * range));
            }
        }
        alarms.extend(self.noise_alarm());
        alarms
    }

    /// Whether nothing touches.
    fn is_free(&self) -> bool {
        matches!(&self.felt, Some(Sensed::Contact(reading)) if reading.contact.touch().is_none())
    }

    fn noise_alarm(&self) -> Option<String> {
        let (noise, tared) = (self.bridges?.noise?, self.tare.filter(|_| self.is_free())?.noise?);
        let times = (0..2).map(|axis| noise[axis] / tared[axis]).fold(0.0, f64::max);
        (times >= NOISE_ALARM).then(|| format!("noise is {times:.0} times that after the tare"))
    }

    /// The largest force of the history; 0 without one.
    pub(crate) fn largest(&self) -> f64 {
        self.history.iter().filter_map(|past| past.magnitude).fold(0.0, f64::max)
    }
}

impl Window {
    fn concluded(&self, arrival: Duration, microstrain_per_count: f64) -> Bridges {
        let microstrain = self.counts / self.samples * microstrain_per_count;
        let noise = (self.readings > 1.0).then(|| {
            let mean = self.force / self.readings;
            let about_mean = self.force_squared - self.readings * mean.component_mul(&mean);
            about_mean.map(|sum| (sum.max(0.0) / (self.readings - 1.0)).sqrt()).into()
        });
        let elapsed = self.begun.map_or(0.0, |begun| arrival.saturating_sub(begun).as_secs_f64());
        let rate_hz = if elapsed > 0.0 { self.arrived / elapsed } else { 0.0 };
        Bridges { microstrain: microstrain.into(), range: self.range, noise, rate_hz }
    }
}

#[cfg(test)]
mod tests {
    use palpate_shared::status::Status;

    use super::*;
    use palpate::finger::contact::{ContactReading, Reading};

    /// Blocks of eight samples at 4 kHz whose counts are ±`swing` about `offset`, the same as forces of a thousandth.
    fn watched(blocks: u64, offset: i32, swing: i32, lost: u64) -> State {
        let finger = Finger { microstrain_per_count: 0.01, rate_hz: 4000, ..Finger::default() };
        let mut state = State { finger, ..State::default() };
        for block in 0..blocks {
            let counts: Vec<_> = (0..8).map(|i| [Counts(offset + swing * (1 - 2 * (i % 2))), Counts(0)]).collect();
            let judged = counts.iter().map(|counts| Judged::Measured(Reading::new(0.0, 1e-3 * counts_vector(*counts))));
            let judged: Vec<_> = judged.collect();
            let missing_before = if block == 3 { lost } else { 0 };
            let first = 8 * block;
            let (time_us, status) = (250 * first, Status::default());
            let samples = Samples { first, missing_before, time_us, period_us: 250.0, status, counts };
            state.take_block(&samples, &judged, Duration::from_micros(2000 * block));
        }
        state
    }

    #[test]
    fn strain_noise_and_rate_are_those_of_the_window() {
        let bridges = watched(101, 100_000, 50, 0).bridges.unwrap();
        assert!((bridges.microstrain[0] - 1000.0).abs() < 1e-9, "{bridges:?}");
        // ±0.05 N, but for the n − 1 of some 800 samples.
        assert!((bridges.noise.unwrap()[0] - 0.05).abs() < 0.05 / 800.0, "{bridges:?}");
        // Eight samples each 2 ms.
        assert!((bridges.rate_hz - 4000.0).abs() < 1e-9, "{bridges:?}");
    }

    #[test]
    fn losses_and_the_end_of_the_range_are_alarms_until_they_pass() {
        assert_eq!(watched(10, 0, 5, 12).alarms(), ["12 samples missing in the last 5 s"]);
        assert_eq!(watched(3000, 0, 5, 12).alarms(), [""; 0]);
        let near = watched(110, 7_000_000, 5, 0);
        assert_eq!(near.alarms(), ["bridge x is at 83 % of its range"]);
        let (noise, bias) = (Some([0.01, 0.01]), Vector2::zeros());
        let contact = Contact::Free { force_finger: bias, sigmas: 0.5 };
        let felt = Some(Sensed::Contact(ContactReading { t: 0.0, contact, event: None }));
        let noisy = State { tare: Some(TareInUse { bias, noise, at: None }), felt, ..watched(110, 0, 50, 0) };
        assert_eq!(noisy.alarms(), ["noise is 5 times that after the tare"]);
        let lost = State { link: Link::Lost { reason: "unplugged".to_owned() }, ..near };
        assert_eq!(lost.alarms()[0], "link lost (unplugged); waiting for it to come back");
    }
}
