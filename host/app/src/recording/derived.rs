//! What is made of the samples, beside them in the recording: a message for each block, or for each sample where all is
//! asked for.
//!
//! Frames: `finger` for forces, `world` for poses, which is the frame of the finger's motion. Units: SI; forces in the
//! calibration's unit, which the channel names.

use std::time::{Duration, Instant};

use nalgebra::{Matrix3, Point2, Quaternion, Vector2};
use palpate::finger::contact::{Contact, Reading};
use palpate::finger::judge::Judged;
use palpate::finger::sense::{FingerSense, Sensed};
use palpate::geometry::Pose;
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::Hypothesis;
use palpate::pushing::finger_motion::FingerMotion;
use palpate_device::{Incoming, Session};
use palpate_files::mcap::cdr::Cdr;
use serde_json::json;

use super::channels::Kind;
use super::disk::Item;
use super::{Recording, active};

/// Between two messages of what was counted.
const COUNTERS_EVERY: Duration = Duration::from_secs(1);

/// What numbers of forces and contacts are rounded to, in their units: a thousandth of the noise of a reading and less, without
/// which a message is half digits that mean nothing, and a recording a fifth larger. What is exact is on the link.
const RESOLUTION: f64 = 1.0 / (1 << 20) as f64;

const FINGER: &str = "finger";
const WORLD: &str = "world";
const PART: &str = "part";
const PALM: &str = "palm";

/// What the messages are made with.
#[derive(Debug)]
pub(super) struct Derived {
    pub(super) is_full: bool,
    bias: Option<Vector2<f64>>,
    sense: Option<FingerSense>,
    counted: Option<Instant>,
    /// When a scene was drawn, ns, and with how many hypotheses.
    drawn_ns: Option<u64>,
    drawn: usize,
    /// Unix time of what the session went by last, ns.
    pub(super) newest_ns: u64,
}

impl Derived {
    pub(super) fn new(is_full: bool) -> Self {
        Self { is_full, bias: None, sense: None, counted: None, drawn_ns: None, drawn: 0, newest_ns: 0 }
    }
}

/// From now on forces are in `unit`, and less this tare where there is one.
pub(crate) fn tared(unit: &'static str, bias: Option<Vector2<f64>>) {
    let Some(recording) = &mut *active() else { return };
    recording.write(Item::UnitOfForce(unit));
    #[cfg(feature = "foxglove")]
    if let Some(live) = &mut recording.live {
        live.unit = unit;
    }
    recording.derived.bias = bias;
}

/// From now on contacts are felt with this finger.
pub(crate) fn sensing(finger: &FingerSense) {
    if let Some(recording) = &mut *active() {
        recording.derived.sense = Some(finger.clone());
    }
}

/// Takes what came, and what was made of it.
pub(crate) fn taken(session: &Session, incoming: &Incoming, judged: &[Judged]) {
    if let Some(recording) = &mut *active() {
        recording.take(session, incoming, judged);
    }
}

/// Where a part may be.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Believed {
    pub(crate) probability: f64,
    /// In contact.
    pub(crate) edge: usize,
    pub(crate) pose: Pose,
    /// Of x, y, theta.
    pub(crate) covariance: Option<Matrix3<f64>>,
}

impl From<&Hypothesis> for Believed {
    fn from(hypothesis: &Hypothesis) -> Self {
        let &Hypothesis { probability, edge, pose_end: pose, covariance, .. } = hypothesis;
        Self { probability, edge, pose, covariance }
    }
}

/// What is on the table while a part is believed to be somewhere.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen<'a> {
    /// Number of the part among those that were named.
    pub(crate) part: usize,
    /// In the part's own frame, m.
    pub(crate) outline: &'a [Point2<f64>],
    /// Centre and radius of the finger's disk, m.
    pub(crate) disk: (Point2<f64>, f64),
    /// Since the push began, s; NaN where it has no speed.
    pub(crate) felt_s: f64,
}

impl<'a> Seen<'a> {
    /// The only part that was named, so long after a finger of this radius (m) began to move (s).
    pub(crate) fn pushed(part: &'a Part, motion: &FingerMotion, radius: f64, felt_s: f64) -> Self {
        Self { part: 0, outline: part.polygon().vertices(), disk: (motion.centre(felt_s), radius), felt_s }
    }
}

/// Takes where the part may be; the likeliest first.
pub(crate) fn believed(seen: Seen<'_>, hypotheses: impl IntoIterator<Item = Believed>) {
    if let Some(recording) = &mut *active() {
        let hypotheses: Vec<_> = hypotheses.into_iter().collect();
        let at = recording.derived.newest_ns;
        recording.believe(at, seen, &hypotheses);
        recording.draw(at, seen, &hypotheses);
    }
}

/// Takes where a body touches the palm (m, palm axes) and how it is turned, if that is known.
pub(crate) fn rolled(contact: Vector2<f64>, attitude: Option<Quaternion<f64>>) {
    let Some(recording) = &mut *active() else { return };
    let at = recording.derived.newest_ns;
    recording.tell(Kind::PalmContact, at, Cdr::new().header(at, PALM).f64s([contact.x, contact.y, 0.0]));
    if let Some(attitude) = attitude {
        let [x, y, z, w] = attitude.coords.into();
        recording.tell(Kind::PalmAttitude, at, Cdr::new().header(at, PALM).f64s([x, y, z, w]));
    }
}

/// Unix time of a moment on the device's clock, or of the newest arrival, ns.
fn unix_ns(session: &Session, device_s: Option<f64>) -> u64 {
    let newest = session.unix_time_of_arrival_ns().unwrap_or_else(|| palpate_device::trace::Stamp::now().unix_ns);
    let Some(seconds) = device_s.and_then(|t| session.unix_time_s(t)) else { return newest };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a time after 1970, below 2⁶⁴ ns")]
    let ns = (seconds * 1e9) as u64;
    ns
}

impl Recording {
    fn tell(&mut self, kind: Kind, unix_ns: u64, cdr: Cdr) {
        self.put(kind, unix_ns, cdr.finish());
    }

    fn take(&mut self, session: &Session, incoming: &Incoming, judged: &[Judged]) {
        if self.disk.is_none() {
            // Nobody notes what the session goes by.
            self.derived.newest_ns = session.unix_time_of_arrival_ns().unwrap_or(self.derived.newest_ns);
        }
        let readings: Vec<Reading> = judged.iter().filter_map(|item| item.reading()).collect();
        if self.derived.is_full {
            readings.iter().for_each(|reading| self.force(session, reading));
        } else if let Some(mean) = mean(&readings) {
            self.force(session, &mean);
        }
        if let Some(sense) = &mut self.derived.sense {
            let mut sensed = sense.feel(judged.iter().copied());
            if !self.derived.is_full {
                sensed.drain(..sensed.len().saturating_sub(1));
            }
            sensed.iter().for_each(|sensed| self.contact(session, sensed));
        }
        let now = session.arrival();
        let is_due = self.derived.counted.is_none_or(|at| now.saturating_duration_since(at) >= COUNTERS_EVERY);
        if is_due && matches!(incoming, Incoming::Samples(_)) {
            self.derived.counted = Some(now);
            self.count(session);
        }
    }

    fn force(&mut self, session: &Session, reading: &Reading) {
        let at = unix_ns(session, Some(reading.t));
        let wrench = |force: Vector2<f64>| {
            let components = [force.x, force.y, 0.0, 0.0, 0.0, 0.0];
            Cdr::new().header(at, FINGER).f64s(components.map(rounded))
        };
        self.tell(Kind::WrenchRaw, at, wrench(reading.force_finger));
        if let Some(bias) = self.derived.bias {
            self.tell(Kind::Wrench, at, wrench(reading.force_finger - bias));
        }
    }

    fn contact(&mut self, session: &Session, sensed: &Sensed) {
        let t = match sensed {
            Sensed::Contact(reading) => reading.t,
            Sensed::NotMeasured { t, .. } => *t,
        };
        let at = unix_ns(session, Some(t));
        let nothing = [f64::NAN; 6];
        let (is_measured, is_touching, numbers) = match sensed {
            Sensed::NotMeasured { .. } => (false, false, nothing),
            Sensed::Contact(reading) => match &reading.contact {
                Contact::Free { force_finger: force, .. } => {
                    (true, false, [f64::NAN, f64::NAN, f64::NAN, force.x, force.y, f64::NAN])
                }
                Contact::Touching(touch) => {
                    let force = touch.force_finger;
                    let angles = [touch.u, touch.u_sd, touch.friction_half_angle];
                    let [u, u_sd, friction] = angles;
                    (true, true, [u, u_sd, friction, force.x, force.y, touch.magnitude_sd])
                }
            },
        };
        let contact =
            Cdr::new().header(at, FINGER).f64(t).bool(is_measured).bool(is_touching).f64s(numbers.map(rounded));
        self.tell(Kind::Contact, at, contact);
    }

    fn count(&mut self, session: &Session) {
        let counts = session.counts();
        let told = json!({
            "samples": counts.samples,
            "missing": counts.missing,
            "repeated": counts.repeated,
            "damaged_frames": counts.damaged_frames,
            "unknown_messages": counts.unknown_messages,
            "commands_repeated": counts.commands_repeated,
            "disconnections": counts.disconnections,
            "restarts": counts.restarts,
            "temperature_c": session.temperature_c(),
        });
        let (unix_ns, data) = (unix_ns(session, None), told.to_string().into_bytes());
        self.put(Kind::Counters, unix_ns, data);
    }

    fn believe(&mut self, at: u64, seen: Seen<'_>, hypotheses: &[Believed]) {
        let part = u32::try_from(seen.part).unwrap_or(u32::MAX);
        let belief = Cdr::new().header(at, WORLD).f64(seen.felt_s).u32(part);
        let belief = belief.sequence(hypotheses, |cdr, hypothesis| {
            let pose = hypothesis.pose;
            let edge = u32::try_from(hypothesis.edge).unwrap_or(u32::MAX);
            let covariance = (0..9).map(|place| entry(hypothesis, place / 3, place % 3));
            cdr.f64(hypothesis.probability).u32(edge).f64s([pose.x, pose.y, pose.theta]).f64s(covariance)
        });
        self.tell(Kind::Belief, at, belief);
        let Some(best) = hypotheses.first() else { return };
        // Of x, y, z and the turns about them: what a plane leaves open is 0.
        let covariance = (0..36).map(|place| match [place / 6, place % 6].map(plane) {
            [Some(row), Some(column)] => entry(best, row, column),
            _ => 0.0,
        });
        self.tell(Kind::Pose, at, on_plane(Cdr::new().header(at, WORLD), &best.pose).f64s(covariance));
        let transforms =
            Cdr::new().sequence(&[best.pose], |cdr, pose| on_plane(cdr.header(at, WORLD).text(PART), pose));
        self.tell(Kind::Transforms, at, transforms);
    }

    /// Draws the part at its likeliest poses, the likelier the darker, and the finger.
    fn draw(&mut self, at: u64, seen: Seen<'_>, hypotheses: &[Believed]) {
        let is_due = self.derived.drawn_ns.is_none_or(|last| at.saturating_sub(last) >= DRAWN_EVERY_NS);
        if !is_due && self.derived.drawn == hypotheses.len() {
            return;
        }
        (self.derived.drawn_ns, self.derived.drawn) = (Some(at), hypotheses.len());
        let nowhere = Pose { x: 0.0, y: 0.0, theta: 0.0 };
        let (centre, radius) = seen.disk;
        let mut markers = vec![
            Marker { action: Marker::DELETE_ALL, ..Marker::new("", 0, Marker::LINE_STRIP, nowhere) },
            Marker {
                scale: [2.0 * radius, 2.0 * radius, DRAWN_LINE_M],
                colour: [0.4, 0.4, 0.4, 0.8],
                ..Marker::new(FINGER, 0, Marker::CYLINDER, Pose { x: centre.x, y: centre.y, theta: 0.0 })
            },
        ];
        for (number, believed) in (0..).zip(hypotheses.iter().take(DRAWN_MAX)) {
            #[expect(clippy::cast_possible_truncation, reason = "a shade")]
            let shade = believed.probability.clamp(0.15, 1.0) as f32;
            markers.push(Marker {
                scale: [DRAWN_LINE_M, 0.0, 0.0],
                colour: [0.0, 0.45, 0.7, shade],
                points: seen.outline,
                ..Marker::new(PART, number, Marker::LINE_STRIP, believed.pose)
            });
        }
        self.tell(Kind::Scene, at, Cdr::new().sequence(&markers, |cdr, marker| marker.write(cdr, at)));
    }
}

/// A scene is drawn no oftener than screens are.
const DRAWN_EVERY_NS: u64 = 33_000_000;

/// Of hypotheses so many are drawn: more of them would be one blot.
const DRAWN_MAX: usize = 20;

/// How thick outlines are drawn, and the finger's disk, m.
const DRAWN_LINE_M: f64 = 1e-3;

/// A `visualization_msgs/msg/Marker`.
struct Marker<'a> {
    name: &'static str,
    number: i32,
    kind: i32,
    action: i32,
    pose: Pose,
    scale: [f64; 3],
    colour: [f32; 4],
    /// Of a closed line, in the frame of its pose.
    points: &'a [Point2<f64>],
}

impl Marker<'_> {
    const CYLINDER: i32 = 3;
    const LINE_STRIP: i32 = 4;
    const ADD: i32 = 0;
    const DELETE_ALL: i32 = 3;

    fn new(name: &'static str, number: i32, kind: i32, pose: Pose) -> Self {
        Self { name, number, kind, action: Self::ADD, pose, scale: [1.0; 3], colour: [0.0; 4], points: &[] }
    }

    fn write(&self, cdr: Cdr, at: u64) -> Cdr {
        let cdr = cdr.header(at, WORLD).text(self.name).i32(self.number).i32(self.kind).i32(self.action);
        let cdr = on_plane(cdr, &self.pose).f64s(self.scale);
        // It stays until it is replaced, where it is.
        let cdr = self.colour.into_iter().fold(cdr, Cdr::f32).i32(0).u32(0).bool(false);
        let line: Vec<_> = self.points.iter().chain(self.points.first()).collect();
        let cdr = cdr.sequence(&line, |cdr, point| cdr.f64s([point.x, point.y, 0.0]));
        // No colours of single points, no texture, no words, no mesh.
        let cdr = cdr.sequence(&[(); 0], |cdr, ()| cdr).text("").time(0).text("").text("").bytes(&[]);
        cdr.sequence(&[(); 0], |cdr, ()| cdr).text("").text("").text("").bytes(&[]).bool(false)
    }
}

/// A force or an angle to [`RESOLUTION`].
fn rounded(number: f64) -> f64 {
    (number / RESOLUTION).round() * RESOLUTION
}

/// Adds a pose on the plane: place, then turn as a quaternion.
fn on_plane(cdr: Cdr, pose: &Pose) -> Cdr {
    let (sin, cos) = (0.5 * pose.theta).sin_cos();
    cdr.f64s([pose.x, pose.y, 0.0]).f64s([0.0, 0.0, sin, cos])
}

/// Of the covariance of x, y, theta; NaN where it is not known.
fn entry(hypothesis: &Believed, row: usize, column: usize) -> f64 {
    hypothesis.covariance.map_or(f64::NAN, |covariance| covariance[(row, column)])
}

/// Which of x, y, theta a coordinate in space is.
fn plane(coordinate: usize) -> Option<usize> {
    [0, 1, 5].iter().position(|&of_plane| of_plane == coordinate)
}

/// The mean of a block's readings, at the mean of their times.
fn mean(readings: &[Reading]) -> Option<Reading> {
    let count = readings.len() as f64;
    let first = readings.first()?.t;
    let t = first + readings.iter().map(|reading| reading.t - first).sum::<f64>() / count;
    let force = readings.iter().map(|reading| reading.force_finger).sum::<Vector2<f64>>() / count;
    Some(Reading::new(t, force))
}
