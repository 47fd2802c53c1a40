//! All that a page shows, made of what the session hands on, and the messages that tell it.
//!
//! A message has the state of now and the points that the page has not had: each stands for some milliseconds of samples, all
//! of which are in one point, with the least and the largest force among them. So a page draws 30 seconds at its own pace and
//! misses no spike.
//!
//! Frames: `finger` for what is felt, the frame of the finger's motion for poses. Units: SI, force in the calibration's unit,
//! strain in µm/m, angles in rad; device time. Errors: none.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::Vector2;
use palpate::finger::Samples;
use palpate::finger::contact::{Contact, Tare};
use palpate::finger::judge::{Judged, SampleFault};
use palpate::finger::monitor::MonitorLine;
use palpate::finger::sense::Sensed;
use serde_json::{Value, json};

use crate::screen::state::{HISTORY_S, Link, State, TareInUse};

/// Samples of so long a time make a point, s: four of them a frame.
const POINT_S: f64 = 0.008;

/// Points that are kept: [`HISTORY_S`] of them.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "3750")]
const POINTS_MAX: usize = (HISTORY_S / POINT_S) as usize;

/// Marks that are kept.
const MARKS_MAX: usize = 1000;

/// Places of the part's centre that are kept for its trail.
const TRAIL_MAX: usize = 500;

/// The delay that is told is a mean over so many blocks.
const LATENCY_BLOCKS: f64 = 50.0;

/// Lines of what was told last.
const TOLD_MAX: usize = 6;

/// Whether there is a device.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum Device {
    /// None yet, and why.
    #[default]
    Sought,
    /// It cannot be opened.
    Missing(String),
    /// It is open.
    Here,
    /// The run is over.
    Over,
}

/// Samples of some milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Point {
    /// The device's number of the first.
    first: u64,
    samples: u64,
    /// How many never came, before it.
    missing: u64,
    /// Device time at its end, s.
    t: f64,
    /// Least and largest force of a sample, less the tare; none where nothing was measured or tared.
    extremes: Option<[f64; 2]>,
    /// The averaged force.
    magnitude: Option<f64>,
    /// Polar angle of the contact and its standard deviation, where something touches.
    u: Option<[f64; 2]>,
}

/// Where a watched push is.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum PushStage {
    /// The finger rests, for the tare.
    #[default]
    Resting,
    /// The push may begin.
    Ready,
    /// It goes on.
    Pushing,
    /// It is over.
    Over,
    /// It cannot be watched, and why.
    Unusable(String),
}

/// A pose that explains what is felt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ShownPose {
    pub(crate) probability: f64,
    pub(crate) edge: usize,
    /// x, y, theta.
    pub(crate) pose: [f64; 3],
    /// The part's centre of mass there.
    pub(crate) centre: [f64; 2],
    /// Standard deviations of its distance and of the angle.
    pub(crate) spread: Option<[f64; 2]>,
}

/// What is known of a push.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Belief {
    /// Up to when the push was used, since it began, s.
    pub(crate) felt_s: f64,
    /// Everywhere that the part may be, the likeliest first.
    pub(crate) poses: Vec<ShownPose>,
    /// Whether everything was sought since the push ended.
    pub(crate) is_last: bool,
}

/// A part that is pushed.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Push {
    /// Its name.
    pub(crate) part: String,
    /// Its outline, part frame.
    pub(crate) outline: Vec<[f64; 2]>,
    /// Of the finger's disk.
    pub(crate) radius: f64,
    /// The way of the finger as far as it is told.
    pub(crate) path: Vec<[f64; 2]>,
    pub(crate) stage: PushStage,
    /// Where the finger is.
    pub(crate) finger: [f64; 2],
    pub(crate) belief: Option<Belief>,
    /// Where the likeliest pose's centre of mass was.
    pub(crate) trail: VecDeque<[f64; 2]>,
}

impl Push {
    /// Another push of the same part.
    pub(crate) fn begin_anew(&mut self) {
        let start = self.path.first().copied().unwrap_or_default();
        (self.stage, self.belief, self.finger) = (PushStage::Resting, None, start);
        self.trail.clear();
    }

    /// Takes what is known now.
    pub(crate) fn believe(&mut self, belief: Belief) {
        if let Some(best) = belief.poses.first() {
            self.trail.push_back(best.centre);
            if self.trail.len() > TRAIL_MAX {
                self.trail.pop_front();
            }
        }
        self.belief = Some(belief);
    }
}

/// All that a page shows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shown {
    /// What a terminal's screen shows as well.
    pub(crate) state: State,
    pub(crate) device: Device,
    /// Why there is no tare, where one was refused.
    pub(crate) tare_refused: Option<String>,
    pub(crate) push: Option<Push>,
    /// The tare, for the force of single samples.
    bias: Option<Vector2<f64>>,
    /// Whether the finger was felt since the tare.
    is_felt: bool,
    points: VecDeque<Point>,
    /// How many have been made.
    made: u64,
    forming: Point,
    /// Blocks taken.
    blocks: u64,
    marks: VecDeque<(f64, u32)>,
    latency_s: Option<f64>,
}

/// What a page has had.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cursor {
    /// Messages.
    sent: u64,
    /// Points, with those that it was too late for.
    points: u64,
    blocks: u64,
}

impl Shown {
    /// Takes a block that arrived at this time of the host's clock, and what it says of the force.
    pub(crate) fn take_block(&mut self, samples: &Samples, judged: &[Judged], arrival: Duration) {
        self.state.take_block(samples, judged, arrival);
        self.blocks += 1;
        if samples.missing_before > 0 && self.forming.samples > 0 {
            // What a point has is in one piece.
            self.close();
        }
        let point = &mut self.forming;
        if point.samples == 0 {
            point.first = samples.first;
        }
        point.missing += samples.missing_before;
        point.samples += samples.counts.len() as u64;
        point.t = samples.device_time_s(samples.counts.len());
        if let Some(bias) = self.bias {
            for reading in judged.iter().filter_map(|item| item.reading()) {
                let force = (reading.force_finger - bias).norm();
                let [least, largest] = point.extremes.unwrap_or([force, force]);
                point.extremes = Some([least.min(force), largest.max(force)]);
            }
        }
    }

    /// Takes the lines that a block made, and makes a point of its samples if there are enough.
    pub(crate) fn take_lines(&mut self, lines: &[MonitorLine], period_us: f64) {
        for line in lines {
            self.state.take_line(line);
            self.is_felt = true;
        }
        if self.forming.samples as f64 * period_us * 1e-6 >= POINT_S {
            self.close();
        }
    }

    fn close(&mut self) {
        let mut point = std::mem::take(&mut self.forming);
        if self.is_felt
            && let Some(Sensed::Contact(reading)) = &self.state.felt
        {
            match &reading.contact {
                Contact::Free { force_finger, .. } => point.magnitude = Some(force_finger.norm()),
                Contact::Touching(touch) => {
                    (point.magnitude, point.u) = (Some(touch.magnitude), Some([touch.u, touch.u_sd]));
                }
            }
        }
        self.points.push_back(point);
        self.made += 1;
        if self.points.len() > POINTS_MAX {
            self.points.pop_front();
        }
    }

    /// Takes how long ago the newest sample was taken when it had been made sense of, s.
    pub(crate) fn take_latency(&mut self, latency_s: f64) {
        let before = self.latency_s.unwrap_or(latency_s);
        self.latency_s = Some(before + (latency_s - before) / LATENCY_BLOCKS);
    }

    /// A tare is being taken.
    pub(crate) fn tare_begins(&mut self) {
        self.state.is_taring = true;
        if let Some(push) = &mut self.push {
            push.begin_anew();
        }
    }

    /// From now on forces are less this tare; `at` is none where it is older than these samples.
    pub(crate) fn tared(&mut self, tare: &Tare, at: Option<f64>) {
        self.state.tare = Some(TareInUse::new(tare, at));
        (self.state.is_taring, self.tare_refused) = (false, None);
        (self.bias, self.is_felt) = (Some(tare.bias), false);
    }

    /// It is no tare.
    pub(crate) fn tare_refused(&mut self, why: String) {
        self.state.is_taring = false;
        self.tell(if self.bias.is_some() { format!("no new tare, the one before stays: {why}") } else { why.clone() });
        self.tare_refused = Some(why);
    }

    /// Sets a mark.
    pub(crate) fn mark(&mut self, number: u32) {
        self.marks.push_back((self.state.t, number));
        if self.marks.len() > MARKS_MAX {
            self.marks.pop_front();
        }
    }

    /// Tells a line.
    pub(crate) fn tell(&mut self, line: String) {
        self.state.told.push(line);
        let excess = self.state.told.len().saturating_sub(TOLD_MAX);
        self.state.told.drain(..excess);
    }

    /// What a person must know before anything else: a word for programs, and a sentence.
    fn condition(&self) -> (&'static str, String) {
        let link = match (&self.device, &self.state.link) {
            (Device::Sought, _) => Some(("no_device", "no device yet".to_owned())),
            (Device::Missing(why), _) => Some(("no_device", format!("no device yet: {why}"))),
            (Device::Over, _) => Some(("over", "palpate has ended".to_owned())),
            (Device::Here, Link::Lost { reason }) => {
                Some(("unplugged", format!("unplugged ({reason}): waiting for it to come back")))
            }
            (Device::Here, Link::Silent) => Some(("silent", "the device is there and sends no samples".to_owned())),
            (Device::Here, Link::Streaming) => None,
        };
        if let Some(told) = link {
            return told;
        }
        let fault = match &self.state.felt {
            Some(Sensed::NotMeasured { fault, .. }) if self.is_felt => Some(*fault),
            _ => None,
        };
        if self.state.is_taring {
            ("taring", "taring: keep the finger free".to_owned())
        } else if self.bias.is_none() {
            let why = self.tare_refused.as_ref().map_or(String::new(), |why| format!(": {why}"));
            ("not_tared", format!("not tared{why}; free the finger, then press t"))
        } else if !self.is_felt || fault == Some(SampleFault::Settling) {
            ("settling", "settling: no force is told yet".to_owned())
        } else if let Some(fault) = fault {
            ("not_measuring", format!("not measuring: {fault}"))
        } else if self.touches() {
            ("contact", "contact".to_owned())
        } else {
            ("free", "no contact".to_owned())
        }
    }

    fn touches(&self) -> bool {
        matches!(&self.state.felt, Some(Sensed::Contact(reading)) if reading.contact.touch().is_some())
    }

    /// The next message for a page that has had this, and what it has had then.
    pub(crate) fn message(&self, had: Cursor) -> (Value, Cursor) {
        let state = &self.state;
        let oldest = self.made - self.points.len() as u64;
        let from = had.points.max(oldest);
        let is_first = had.sent == 0;
        let skipped = if is_first { 0 } else { from - had.points };
        #[expect(clippy::cast_possible_truncation, reason = "at most as many as are kept")]
        let points: Vec<_> = self.points.iter().skip((from - oldest) as usize).map(Point::as_json).collect();
        let (is, words) = self.condition();
        let finger = &state.finger;
        let message = json!({
            "frame": had.sent,
            "condition": { "is": is, "words": words },
            "finger": (self.device != Device::Sought && finger.rate_hz > 0).then(|| json!({
                "device": finger.device, "address": finger.address, "simulated": finger.is_simulated,
                "rate_hz": finger.rate_hz, "unit": finger.unit,
            })),
            "t": thousandth(state.t),
            "felt": state.felt.filter(|_| self.is_felt).and_then(|felt| felt_as_json(&felt)),
            "bridges": state.bridges.map(|bridges| json!({
                "microstrain": bridges.microstrain.map(thousandth), "range": bridges.range.map(thousandth),
                "noise": bridges.noise.map(|noise| noise.map(millionth)), "rate_hz": thousandth(bridges.rate_hz),
            })),
            "tared_at": state.tare.map(|tare| tare.at),
            "counts": {
                "blocks": self.blocks, "samples": state.counts.samples, "missing": state.counts.missing,
                "damaged_frames": state.counts.damaged_frames, "repeated": state.counts.repeated,
                "disconnections": state.counts.disconnections, "restarts": state.counts.restarts,
            },
            "blocks": self.blocks - had.blocks,
            "latency_ms": self.latency_s.map(|latency| thousandth(latency * 1e3)),
            "temperature_c": state.temperature_c,
            "alarms": state.alarms(),
            "told": state.told,
            "recording": state.recording.as_ref().map(|it| json!({ "file": it.file, "goes_on": it.goes_on })),
            "marks": self.marks,
            "points": { "first": from, "skipped": skipped, "of": points, "forming": self.forming.samples },
            "push": self.push.as_ref().map(Push::as_json),
            "history_s": HISTORY_S,
        });
        (message, Cursor { sent: had.sent + 1, points: self.made, blocks: self.blocks })
    }
}

impl Point {
    /// In the order in which the page names them; shorter than an object a point.
    fn as_json(&self) -> Value {
        let [least, largest] = [0, 1].map(|which| self.extremes.map(|extremes| millionth(extremes[which])));
        let [u, u_sd] = [0, 1].map(|which| self.u.map(|u| millionth(u[which])));
        let magnitude = self.magnitude.map(millionth);
        json!([self.first, self.samples, self.missing, millionth(self.t), least, largest, magnitude, u, u_sd])
    }
}

impl Push {
    fn as_json(&self) -> Value {
        let (stage, words) = match &self.stage {
            PushStage::Resting => ("resting", "resting: no force on the finger".to_owned()),
            PushStage::Ready => ("ready", "ready: push".to_owned()),
            PushStage::Pushing => ("pushing", "pushing".to_owned()),
            PushStage::Over => ("over", "the push is over; t tares for another".to_owned()),
            PushStage::Unusable(why) => ("unusable", format!("{why}; t begins again")),
        };
        json!({
            "part": self.part, "outline": self.outline, "radius": self.radius, "path": self.path,
            "stage": stage, "words": words, "finger": self.finger.map(millionth),
            "trail": self.trail.iter().map(|place| place.map(millionth)).collect::<Vec<_>>(),
            "belief": self.belief.as_ref().map(Belief::as_json),
        })
    }
}

impl Belief {
    fn as_json(&self) -> Value {
        let (status, words) = match self.poses.len() {
            0 => ("none", "no pose explains what is felt".to_owned()),
            1 => ("unique", "one pose explains what is felt".to_owned()),
            several => ("ambiguous", format!("ambiguous: {several} poses explain what is felt")),
        };
        let poses = self.poses.iter().map(|it| {
            json!({
                "probability": millionth(it.probability), "edge": it.edge, "pose": it.pose.map(millionth),
                "centre": it.centre.map(millionth), "spread": it.spread.map(|spread| spread.map(millionth)),
            })
        });
        let poses: Vec<_> = poses.collect();
        let felt_s = millionth(self.felt_s);
        json!({ "felt_s": felt_s, "status": status, "words": words, "is_last": self.is_last, "poses": poses })
    }
}

fn felt_as_json(felt: &Sensed) -> Option<Value> {
    let Sensed::Contact(reading) = felt else { return None };
    Some(match &reading.contact {
        Contact::Free { force_finger: force, sigmas } => {
            json!({ "contact": false, "force": [millionth(force.x), millionth(force.y)], "sigmas": thousandth(*sigmas) })
        }
        Contact::Touching(touch) => json!({
            "contact": true, "u": millionth(touch.u), "u_sd": millionth(touch.u_sd),
            "friction_half_angle": millionth(touch.friction_half_angle),
            "force": [millionth(touch.force_finger.x), millionth(touch.force_finger.y)],
            "magnitude": millionth(touch.magnitude), "magnitude_sd": millionth(touch.magnitude_sd),
        }),
    })
}

/// A number with no more digits than a page shows.
fn millionth(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

fn thousandth(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use palpate::finger::contact::Reading;
    use palpate_shared::status::Status;
    use palpate_shared::units::Counts;

    use super::*;
    use crate::screen::state::Finger;

    /// Blocks of eight samples of 1 N at 4 kHz, of which one in block 5 has 3 N, and 16 are lost before block 9.
    fn shown(blocks: u64) -> Shown {
        let finger = Finger { rate_hz: 4000, ..Finger::default() };
        let mut shown = Shown { state: State { finger, ..State::default() }, device: Device::Here, ..Shown::default() };
        let tare = Tare { bias: Vector2::zeros(), ..a_tare() };
        shown.tared(&tare, Some(0.0));
        take(&mut shown, 0..blocks);
        shown
    }

    fn a_tare() -> Tare {
        let readings: Vec<_> = (0..4000_u32)
            .map(|i| {
                let (t, noise) =
                    (f64::from(i) * 250e-6, 1e-3 * f64::from(i.wrapping_mul(2_654_435_761) >> 16) / 65536.0);
                Reading::new(t, Vector2::new(noise, 1e-3 * f64::from(i.wrapping_mul(40_503) >> 8 & 0xff) / 256.0))
            })
            .collect();
        Tare::estimate(&readings, &palpate::finger::contact::ContactSettings::default().tare_settings()).unwrap()
    }

    fn take(shown: &mut Shown, blocks: std::ops::Range<u64>) {
        for block in blocks {
            let lost = if block >= 9 { 16 } else { 0 };
            let first = 8 * block + lost;
            let force = |i: u64| if block == 5 && i == 3 { 3.0 } else { 1.0 };
            let judged = (0..8).map(|i| Judged::Measured(Reading::new(0.0, Vector2::new(force(i), 0.0))));
            let judged: Vec<_> = judged.collect();
            let (missing_before, counts) = (if block == 9 { 16 } else { 0 }, vec![[Counts(0); 2]; 8]);
            let (time_us, status) = (250 * first, Status::default());
            let samples = Samples { first, missing_before, time_us, period_us: 250.0, status, counts };
            shown.take_block(&samples, &judged, Duration::from_micros(2000 * block));
            shown.state.counts.samples += 8;
            shown.take_lines(&[], samples.period_us);
        }
    }

    fn points(message: &Value) -> Vec<[u64; 3]> {
        let points = message["points"]["of"].as_array().unwrap().iter();
        points.map(|point| [0, 1, 2].map(|place| point[place].as_u64().unwrap())).collect()
    }

    #[test]
    fn every_sample_is_in_one_point_and_a_spike_shows() {
        let (message, had) = shown(14).message(Cursor::default());
        // Eight milliseconds each; a gap ends a point, so that each is in one piece.
        assert_eq!(points(&message), [[0, 32, 0], [32, 32, 0], [64, 8, 0], [88, 32, 16]]);
        assert_eq!(message["points"]["forming"], 8);
        let of = &message["points"]["of"];
        assert_eq!(json!([of[0][4], of[0][5], of[1][4], of[1][5]]), json!([1.0, 1.0, 1.0, 3.0]));
        assert_eq!((had.points, message["blocks"].as_u64()), (4, Some(14)));
    }

    #[test]
    fn a_page_that_waited_is_told_what_it_missed_and_nothing_piles_up() {
        let mut shown = shown(100);
        let (_, had) = shown.message(Cursor::default());
        take(&mut shown, 100..104);
        let (message, next) = shown.message(had);
        assert_eq!(
            (points(&message).len(), &message["points"]["skipped"], next.points),
            (1, &Value::from(0), had.points + 1)
        );
        // A minute of which half is kept.
        take(&mut shown, 104..30_104);
        assert_eq!(shown.points.len(), POINTS_MAX);
        let (message, _) = shown.message(next);
        assert_eq!(points(&message).len(), POINTS_MAX);
        assert_eq!(message["points"]["skipped"], shown.made - next.points - POINTS_MAX as u64);
        // Who comes first has missed nothing that concerns it.
        assert_eq!(shown.message(Cursor::default()).0["points"]["skipped"], 0);
    }

    #[test]
    fn what_is_amiss_is_said_the_gravest_first() {
        let is = |shown: &Shown| shown.condition().0;
        let mut shown = Shown::default();
        assert_eq!(is(&shown), "no_device");
        shown.device = Device::Missing("there is no port /dev/x".to_owned());
        assert_eq!(shown.condition().1, "no device yet: there is no port /dev/x");
        shown.device = Device::Here;
        assert_eq!(is(&shown), "not_tared");
        shown.tare_begins();
        assert_eq!(is(&shown), "taring");
        shown.tare_refused("it is under load".to_owned());
        assert_eq!(
            shown.condition(),
            ("not_tared", "not tared: it is under load; free the finger, then press t".to_owned())
        );
        shown.tared(&a_tare(), None);
        assert_eq!(is(&shown), "settling");
        shown.is_felt = true;
        for (fault, expected) in
            [(SampleFault::Settling, "settling"), (SampleFault::Stuck { channel: 0 }, "not_measuring")]
        {
            shown.state.felt = Some(Sensed::NotMeasured { t: 0.0, fault });
            assert_eq!(is(&shown), expected);
        }
        shown.state.link = Link::Lost { reason: "the cable".to_owned() };
        assert_eq!(is(&shown), "unplugged");
        shown.state.link = Link::Silent;
        assert_eq!(is(&shown), "silent");
        shown.device = Device::Over;
        assert_eq!(is(&shown), "over");
    }

    #[test]
    fn poses_are_told_as_one_several_or_none() {
        let pose = ShownPose { probability: 0.5, edge: 1, pose: [0.0; 3], centre: [0.0; 2], spread: None };
        for (count, status) in [(0, "none"), (1, "unique"), (2, "ambiguous")] {
            let belief = Belief { felt_s: 0.5, poses: vec![pose; count], is_last: false };
            assert_eq!(belief.as_json()["status"], status);
        }
    }
}
