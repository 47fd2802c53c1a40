//! Pushing logs as the estimator of slow pushes takes them ([`palpate::pushing::estimation::slow_pushes`]).
//!
//! The fingertip goes straight on at a constant speed, and its rows are rounded to 0.1 mm: a line through them says where
//! it was to some hundredths. Travel is measured back from the last row, so that nothing rests on where a log begins:
//! the plan put that 2.5 mm before the part's edge, which would give away the pose.
//!
//! Frames: robot = `world`; poses are of the block's centre of mass, with the axes of its frame. Units: SI.
//! Errors: [`StandingError`] for a folder's name that is none.

use nalgebra::{Point2, Rotation2, Vector2};
use palpate::finger::contact::offline::RecordingStart;
use palpate::geometry::Pose;
use palpate::math::statistics::mean;
use palpate::pushing::estimation::slow_pushes::{FeltForce, FeltPush, FilterSettings, KnownPush, Onset, Standing};

use super::mlab::{BlockPose, Log, LoggedPush, Tip};
use super::session::{RecordingOptions, RecordingReport, of_log};
use crate::recordings::session::MLAB_TOOL_FROM_SENSOR;

/// Share of the rows, the last ones, that say how fast the finger goes: the first may still speed up.
const STEADY_SHARE: f64 = 0.7;

/// Millimetres in a metre.
const MM: f64 = 1e-3;

/// Why a folder's name does not tell what the part stood on.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{name}` does not say what the part stood on: expected `patch`, or feet as x1_x2_x3_y1_y2_y3 in mm (at least three)"
)]
pub struct StandingError {
    /// The folder's name.
    pub name: String,
}

/// What the part stood on, from the name of a log's folder.
///
/// # Errors
/// [`StandingError`].
pub fn standing(name: &str) -> Result<Standing, StandingError> {
    if name == "patch" {
        return Ok(Standing::Face);
    }
    let error = || StandingError { name: name.to_owned() };
    let numbers: Result<Vec<f64>, _> = name.split('_').map(str::parse).collect();
    let numbers = numbers.map_err(|_| error())?;
    let count = numbers.len() / 2;
    if numbers.len() % 2 != 0 || count < 3 || numbers.iter().any(|number| !number.is_finite()) {
        return Err(error());
    }
    Ok(Standing::Feet((0..count).map(|i| Point2::new(numbers[i], numbers[count + i]) * MM).collect()))
}

/// One push of a log with the poses that were measured.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredPush {
    /// Number in its file, from 0.
    pub index: usize,
    /// Unix time of its first force, s.
    pub begins: f64,
    /// Unix time of its last force, s.
    pub ends: f64,
    /// What the finger felt, and the poses measured before and after.
    pub known: KnownPush,
}

/// All pushes of a log that could be read, of a part with this centre of mass (part frame, m).
#[must_use]
pub fn of_pushes(log: &Log, centre_of_mass: Point2<f64>, settings: &FilterSettings) -> Vec<MeasuredPush> {
    let options = RecordingOptions { finger_from_sensor: MLAB_TOOL_FROM_SENSOR, ..RecordingOptions::default() };
    let Ok(reports) = of_log(log, &options) else { return Vec::new() };
    let measured = log.good().zip(&reports).map(|(push, report)| MeasuredPush {
        index: push.index,
        begins: report.t0,
        ends: report.t0 + report.duration,
        known: KnownPush {
            felt: felt(push, report, settings.bin),
            before: at_centre(&push.before, centre_of_mass),
            after: at_centre(&push.after, centre_of_mass),
        },
    });
    measured.collect()
}

fn at_centre(pose: &BlockPose, centre_of_mass: Point2<f64>) -> Pose {
    let at = pose.position_world + Rotation2::new(pose.yaw) * centre_of_mass.coords;
    Pose { x: at.x, y: at.y, theta: pose.yaw }
}

/// A straight line through `(x, y)`: value at 0 and slope.
fn line(points: &[(f64, f64)]) -> [f64; 2] {
    let mean_of = |value: &dyn Fn(&(f64, f64)) -> f64| mean(points.iter().map(value)).unwrap_or(0.0);
    let (x, y) = (mean_of(&|p| p.0), mean_of(&|p| p.1));
    let spread: f64 = points.iter().map(|p| (p.0 - x) * (p.0 - x)).sum();
    let slope = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / spread;
    [y - slope * x, slope]
}

/// The finger's straight way.
struct Way {
    origin: Point2<f64>,
    direction: Vector2<f64>,
    yaw: f64,
    /// Travel at time `t0` and speed, m/s.
    t0: f64,
    travel: [f64; 2],
}

impl Way {
    fn of(tips: &[Tip]) -> Self {
        let last = tips[tips.len() - 1];
        let turn = tips.iter().map(|tip| palpate::math::angle::wrap_angle(tip.pose.yaw - last.pose.yaw));
        let yaw = last.pose.yaw + mean(turn).unwrap_or(0.0);
        // Nearly along the way; the line through all rows says how nearly.
        let gone = last.pose.position_world - tips[0].pose.position_world;
        let axis = gone.try_normalize(0.0).unwrap_or_else(|| Rotation2::new(yaw) * Vector2::x());
        let left = Vector2::new(-axis.y, axis.x);
        let from_last = |tip: &Tip| tip.pose.position_world - last.pose.position_world;
        let places: Vec<_> = tips.iter().map(|tip| (from_last(tip).dot(&axis), from_last(tip).dot(&left))).collect();
        let [off, slope] = line(&places);
        let direction = (axis + left * slope).normalize();
        let origin = Point2::from(last.pose.position_world + left * off);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a small count")]
        let steady = ((1.0 - STEADY_SHARE) * tips.len() as f64) as usize;
        let t0 = last.t;
        let times: Vec<_> = tips[steady..].iter().map(|tip| (tip.t - t0, from_last(tip).dot(&direction))).collect();
        Self { origin, direction, yaw, t0, travel: line(&times) }
    }

    fn travel(&self, t: f64) -> f64 {
        self.travel[0] + self.travel[1] * (t - self.t0)
    }
}

fn felt(push: &LoggedPush, report: &RecordingReport, bin: f64) -> FeltPush {
    let way = Way::of(&push.tips);
    let travel_of = |t: f64| way.travel(report.t0 + t);
    let end = way.travel(way.t0);
    let onset = match (report.start, report.onset) {
        (_, _) if report.bias.is_none() => Onset::Unknown,
        (RecordingStart::InContact, _) => Onset::Before(travel_of(0.0)),
        (_, Some(onset)) => Onset::At(travel_of(onset)),
        (_, None) => Onset::Never(end),
    };
    // Force on the part: against that on the finger.
    let turn = Rotation2::new(way.yaw);
    let readings = report.series.iter().filter(|row| row.touch.is_some());
    let readings = readings.map(|row| (travel_of(row.t), -(turn * Vector2::from(row.force_finger))));
    let mut forces: Vec<FeltForce> = Vec::new();
    let mut held: Vec<Vector2<f64>> = Vec::new();
    let mut stretch = f64::NAN;
    let middle = |stretch: f64| end - (stretch + 0.5) * bin;
    for (travel, force) in readings {
        // Counted back from the end, so that nothing rests on where the log begins.
        let here = ((end - travel) / bin).floor();
        if (here - stretch).abs() > 0.0 || stretch.is_nan() {
            forces.extend(mean(held.drain(..)).map(|force| FeltForce { travel: middle(stretch), force }));
            stretch = here;
        }
        held.push(force);
    }
    forces.extend(mean(held.drain(..)).map(|force| FeltForce { travel: middle(stretch), force }));
    FeltPush { origin: way.origin, direction: way.direction, tool_yaw: way.yaw, end, onset, forces }
}

#[cfg(test)]
mod tests {
    use super::super::mlab::parse;
    use super::super::synthetic::{log, session};
    use super::*;

    /// Rows are rounded to 1e-4 mm here; a line through them is as good.
    const ROUNDING_M: f64 = 1e-6;

    #[test]
    fn folders_tell_what_the_part_stood_on() {
        assert_eq!(standing("patch"), Ok(Standing::Face));
        let feet = [[0.03, 0.03], [0.063_33, 0.043_33], [0.043_33, 0.063_33]].map(Point2::from).to_vec();
        let Ok(Standing::Feet(found)) = standing("30_63.33_43.33_30_43.33_63.33") else { panic!("three feet") };
        assert!(found.iter().zip(&feet).all(|(a, b)| (a - b).norm() < 1e-12), "{found:?}");
        for name in ["", "patches", "1_2_3_4", "1_2_3_4_5", "1_2_x_4_5_6", "1_2_inf_4_5_6"] {
            assert!(standing(name).is_err(), "{name}");
        }
    }

    #[test]
    fn a_push_is_felt_where_it_was_made() {
        let parsed = parse(&log(&session(6))).unwrap();
        let pushes = of_pushes(&parsed, Point2::new(0.05, 0.05), &FilterSettings::STANDARD);
        assert_eq!(pushes.len(), 6);
        let felt = &pushes[0].known.felt;
        // The tip goes along +y at 2.5 mm/s from 1.5 s before it touches the edge on y = 0, its centre 1 mm away.
        assert!((felt.direction - Vector2::y()).norm() < 1e-9);
        let Onset::At(onset) = felt.onset else { panic!("{:?}", felt.onset) };
        let touched = felt.origin + felt.direction * onset;
        // Force rises within 0.1 s; a reading is 0.025 mm.
        assert!((touched - Point2::new(0.06, -1e-3)).norm() < 0.1e-3, "{touched}");
        let last = felt.forces[felt.forces.len() - 2].force;
        let wanted = 3.0 * Vector2::new(-(0.2_f64.sin()), 0.2_f64.cos());
        assert!((last - wanted).norm() < 0.02, "{last}");
        assert!(felt.forces.windows(2).all(|pair| (pair[1].travel - pair[0].travel - 1e-3).abs() < 1e-9));
        assert!((pushes[0].known.before.x - 0.05).abs() < 1e-9 && (pushes[0].known.before.y - 0.05).abs() < 1e-9);
    }

    #[test]
    fn where_a_log_begins_tells_nothing() {
        let parsed = parse(&log(&session(6))).unwrap();
        let mut later = parsed.clone();
        for push in later.pushes.iter_mut().flatten() {
            // The first millimetre.
            push.tips.drain(..14);
        }
        let felt = |log| of_pushes(log, Point2::new(0.05, 0.05), &FilterSettings::STANDARD).remove(1).known.felt;
        let (whole, cut) = (felt(&parsed), felt(&later));
        assert!((whole.origin - cut.origin).norm() < ROUNDING_M && (whole.direction - cut.direction).norm() < 1e-4);
        let (Onset::At(whole), Onset::At(cut)) = (whole.onset, cut.onset) else { panic!("both touch") };
        assert!((whole - cut).abs() < ROUNDING_M, "{whole} and {cut}");
    }
}
