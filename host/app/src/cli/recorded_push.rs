//! Forces and a motion from files: what a finger felt of a push from rest.

use std::path::{Path, PathBuf};

use miette::WrapErr as _;
use palpate::finger::contact::{Reading, TareError};
use palpate::pushing::estimation::from_rest::onset::{PushSense, RestNoise, Touch};
use palpate::pushing::estimation::from_rest::{KnownFromRest, WINDOWS_MIN, WindowedForce};
use palpate::pushing::finger_motion::FingerMotion;
use palpate_files::motion;
use palpate_files::part::PolygonFile;
use palpate_files::recordings::csv::{self, RecordedTable};

use super::positive;
use super::read::{read, report_problems};
use crate::advice;
use palpate::gravity::GRAVITY_ASSUMED;

/// The files, as `palpate observe` takes them.
#[derive(Debug, clap::Args)]
pub(super) struct RecordedPushArguments {
    /// Forces on the finger: a table of t, Fx, Fy, with the finger at rest at its beginning
    #[arg(value_name = "FORCES")]
    forces: PathBuf,

    /// How the finger moved: a motion file, see `palpate observe --help`
    #[arg(long, value_name = "MOTION.toml")]
    motion: PathBuf,

    #[command(flatten)]
    felt: FeltPushArguments,
}

/// What must be known of the finger, its rest and the plane to make sense of the forces.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct FeltPushArguments {
    /// Radius of the finger's disk
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = 15.0)]
    radius_mm: f64,

    /// Take the tare over so many seconds at rest, at the beginning
    #[arg(long, value_name = "S", default_value_t = 1.0, allow_negative_numbers = true, value_parser = super::stretch)]
    pub(super) tare: f64,

    /// How well the part file's mu is known: 20% as one standard deviation, or x2 for within a factor of two (two of
    /// them); mu is then found too
    #[arg(long, value_name = "SHARE", value_parser = log_sd, allow_hyphen_values = true)]
    mu_uncertainty: Option<f64>,
}

impl FeltPushArguments {
    /// What is known of a push from rest of the part in this file, with this motion of the finger.
    pub(super) fn known<'a>(self, file: &'a PolygonFile, motion: &'a FingerMotion) -> KnownFromRest<'a> {
        let (mu_g, mu_g_log_sd) = (file.mu * GRAVITY_ASSUMED, self.mu_uncertainty);
        KnownFromRest { part: &file.part, mu_g, mu_g_log_sd, radius: self.radius_mm * 1e-3, motion }
    }

    /// What senses the push, from the readings at rest, and the readings in which it is sought: those after them, and
    /// after earlier contacts that were not the push.
    pub(super) fn sense<'r>(
        self,
        readings: &'r [Reading],
        motion: &FingerMotion,
    ) -> miette::Result<(PushSense, &'r [Reading])> {
        let rest_end = readings.first().map_or(0.0, |first| first.t) + self.tare;
        let (rest, push) = readings.split_at(readings.partition_point(|reading| reading.t < rest_end));
        let sense = PushSense::new(RestNoise::estimate(rest).map_err(not_at_rest)?, None);
        let contacts = contacts(&sense, push, motion.duration());
        // The push lasts as long as the finger's motion, if one contact does; otherwise the longest is taken for it.
        let lasting = contacts.iter().find(|contact| contact.lasts);
        let longest = || contacts.iter().max_by(|a, b| a.length().total_cmp(&b.length()));
        let Some(taken) = lasting.or_else(longest) else { return Ok((sense, push)) };
        for other in contacts.iter().filter(|other| other.touch != taken.touch) {
            note!(
                "a contact from t = {:.3} s to {:.3} s is not taken for the push, which begins at t = {:.3} s",
                other.touch.from,
                other.touch.to,
                taken.touch.from
            );
        }
        Ok((sense, &push[taken.first..]))
    }
}

/// A contact that may be the push.
struct FeltContact {
    touch: Touch,
    /// The reading from which on it is sensed.
    first: usize,
    /// Whether the finger was still in contact when its motion was over.
    lasts: bool,
}

impl FeltContact {
    fn length(&self) -> f64 {
        self.touch.to - self.touch.from
    }
}

/// After a contact that was no push the sensor comes to rest within this, s: three times what the default finger rings.
const RING_OUT_S: f64 = 0.13;

/// Every contact of a recording that lasts long enough to say anything, with a finger that moves for so long, s.
fn contacts(waiting: &PushSense, readings: &[Reading], duration: f64) -> Vec<FeltContact> {
    let (mut found, mut first) = (Vec::new(), 0);
    while first < readings.len() {
        let mut sense = waiting.clone();
        let over = |sense: &PushSense| sense.onset_time().is_some_and(|onset| sense.now() >= onset + duration);
        for reading in &readings[first..] {
            sense.push(reading);
            if sense.is_over() || over(&sense) {
                break;
            }
        }
        let Some(from) = sense.onset_time() else { break };
        let lost = sense.lost_before(duration);
        let to = lost.unwrap_or(sense.now());
        found.push(FeltContact { touch: Touch { from, to }, first, lasts: lost.is_none() });
        if lost.is_none() {
            break;
        }
        first = readings.partition_point(|reading| reading.t < sense.now() + RING_OUT_S);
    }
    found
}

/// A share in per cent as the standard deviation of a logarithm, or a factor as two of them.
fn log_sd(text: &str) -> Result<f64, String> {
    let neither = || format!("{text:?} is neither a share such as 20% nor a factor such as x2");
    let within = |value: &str, limits: [f64; 2], unit: &str| {
        let value: f64 = value.parse().map_err(|_| neither())?;
        let [low, high] = limits;
        if (low..=high).contains(&value) {
            Ok(value)
        } else {
            Err(format!("{text} is not within {low}{unit} and {high}{unit}"))
        }
    };
    match (text.strip_suffix('%'), text.strip_prefix(['x', '×'])) {
        (Some(share), _) => within(share.trim_end(), PER_CENT, "%").map(|share| share / 100.0),
        (None, Some(factor)) => within(factor.trim_start(), FACTOR, "").map(|factor| 0.5 * factor.ln()),
        (None, None) => Err(neither()),
    }
}

/// What the friction of a plane can be uncertain by: less than the first is nothing beside other errors, more than the
/// second is a factor.
const PER_CENT: [f64; 2] = [0.1, 100.0];

/// The same as a factor: at more than the second mu would be no guess at all.
const FACTOR: [f64; 2] = [1.01, 10.0];

/// The usable readings of a file of forces; the others are named.
pub(super) fn read_forces(path: &Path) -> miette::Result<Vec<Reading>> {
    let RecordedTable { readings, problems, .. } = read(path, csv::parse)?;
    report_problems(path, &problems);
    Ok(readings)
}

/// A push as files keep it.
pub(super) struct RecordedPush {
    pub(super) force: WindowedForce,
    motion: FingerMotion,
    felt: FeltPushArguments,
}

impl RecordedPushArguments {
    pub(super) fn read(&self) -> miette::Result<RecordedPush> {
        let motion = read(&self.motion, motion::parse)?;
        let named = || format!("cannot use the forces {}", self.forces.display());
        let force = self.feel(&motion).wrap_err_with(named)?;
        Ok(RecordedPush { force, motion, felt: self.felt })
    }

    fn feel(&self, motion: &FingerMotion) -> miette::Result<WindowedForce> {
        let readings = read_forces(&self.forces)?;
        let (mut sense, push) = self.felt.sense(&readings, motion)?;
        push.iter().for_each(|reading| sense.push(reading));
        tell_contacts(&sense, motion.duration());
        sense.windowed_force(motion.duration()).filter(|measured| measured.count() >= WINDOWS_MIN).ok_or_else(|| {
            miette::miette!(
                help = "a push must stand out of the noise for a tenth of a second at least, and begin after the tare",
                "no push was felt, or too short a one"
            )
        })
    }
}

impl RecordedPush {
    /// What is known of the push if this part was pushed.
    pub(super) fn known<'p>(&'p self, file: &'p PolygonFile) -> KnownFromRest<'p> {
        self.felt.known(file, &self.motion)
    }
}

/// Says what was felt beside the push: contacts that were too short, and an end before the motion's.
pub(super) fn tell_contacts(sense: &PushSense, duration: f64) {
    for knock in sense.knocks() {
        note!("a knock at t = {:.3} s was too short to be the push", knock.from);
    }
    if let (Some(onset), Some(lost)) = (sense.onset_time(), sense.lost_before(duration)) {
        note!(
            "contact was lost at t = {lost:.3} s, {:.3} s after the push began; the motion lasts {duration:.3} s",
            lost - onset
        );
    }
}

/// What to tell where the stretch for the tare was no rest.
pub(super) fn not_at_rest(error: TareError) -> miette::Report {
    let help = advice::help(&error).unwrap_or_default();
    let help = format!("{help}; if the rest before the push was shorter than the tare, say so with --tare");
    let help = help.trim_start_matches("; ");
    miette::miette!(help = help, "the finger was not at rest while the tare was taken: {error}")
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Vector2};
    use palpate::math::random::Draw;
    use palpate::pushing::finger_motion::Segment;

    use super::*;

    const PERIOD_S: f64 = 1e-3;

    /// Readings of a finger that is touched over these stretches, s; a rest of a second before them.
    fn touched(stretches: &[[f64; 2]]) -> Vec<Reading> {
        let mut draw = Draw::case(1, 0);
        let touched = |t: f64| stretches.iter().any(|[from, to]| (*from..*to).contains(&t));
        let mut reading = |index: u32| {
            let t = f64::from(index) * PERIOD_S;
            let force = if touched(t) { Vector2::new(-1.0, 0.3) } else { Vector2::zeros() };
            Reading::new(t, force + Vector2::new(draw.normal(), draw.normal()) * 0.01)
        };
        (0..5000).map(&mut reading).collect()
    }

    /// When the push was felt to begin, and every contact that is found, with a finger that moves for 0.8 s.
    fn sensed(stretches: &[[f64; 2]]) -> (PushSense, Vec<FeltContact>) {
        let segments = [Segment { seconds: 0.8, acceleration: Vector2::new(0.1, 0.0) }];
        let motion = FingerMotion::new(Point2::origin(), &segments).unwrap();
        let felt = FeltPushArguments { radius_mm: 15.0, tare: 1.0, mu_uncertainty: None };
        let readings = touched(stretches);
        let (mut sense, push) = felt.sense(&readings, &motion).unwrap();
        push.iter().for_each(|reading| sense.push(reading));
        let (rest, after) = readings.split_at(1000);
        let waiting = PushSense::new(RestNoise::estimate(rest).unwrap(), None);
        (sense, contacts(&waiting, after, motion.duration()))
    }

    #[test]
    fn an_earlier_touch_is_not_taken_for_the_push_and_is_named() {
        let (sense, contacts) = sensed(&[[1.3, 1.9], [3.9, 4.72]]);
        let onset = sense.onset_time().unwrap();
        assert!((onset - 3.9).abs() < 2.0 * PERIOD_S, "{onset}");
        let [early, push] = &contacts[..] else { panic!("{} contacts", contacts.len()) };
        assert!((early.touch.from - 1.3).abs() < 0.01 && (early.touch.to - 1.9).abs() < 0.01, "{:?}", early.touch);
        assert!(!early.lasts && push.lasts);
        assert!(sense.windowed_force(0.8).unwrap().count() > 30);
    }

    #[test]
    fn a_contact_lost_before_the_motion_ends_is_the_push_up_to_there() {
        for lost in [0.02, 0.04] {
            let (sense, contacts) = sensed(&[[2.0, 2.8 - lost]]);
            assert_eq!(contacts.len(), 1, "{lost} s before the end");
            let found = sense.lost_before(0.8).unwrap();
            assert!((found - (2.8 - lost)).abs() < 5e-3, "{lost} s before the end: {found}");
            assert!(sense.windowed_force(0.8).unwrap().count() > 30, "{lost} s before the end");
        }
    }
}
