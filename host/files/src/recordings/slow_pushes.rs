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
            felt: logged(push, report, settings.bin),
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
    travel: Travel,
    /// Travel at the last place, m.
    end: f64,
    /// How far places are off the straight line, rms, m.
    aside: f64,
}

/// Travel over time.
enum Travel {
    /// At a constant speed: travel (m) at a time (s), and the speed (m/s).
    Steady { t0: f64, travel: f64, speed: f64 },
    /// Between these times (s) and travels (m), straight; before and after them at rest.
    Told(Vec<(f64, f64)>),
}

impl Way {
    /// Along these places (s, m), straight on from the first to the last; `axis` where they are one place.
    fn of(places: &[(f64, Point2<f64>)], axis: Vector2<f64>) -> Self {
        let (t0, last) = places[places.len() - 1];
        // Nearly along the way; the line through all rows says how nearly.
        let axis = (last - places[0].1).try_normalize(0.0).unwrap_or(axis);
        let left = Vector2::new(-axis.y, axis.x);
        let across: Vec<_> = places.iter().map(|(_, at)| ((at - last).dot(&axis), (at - last).dot(&left))).collect();
        let [off, slope] = line(&across);
        let direction = (axis + left * slope).normalize();
        let origin = last + left * off;
        let aside =
            (across.iter().map(|(x, y)| (y - off - slope * x).powi(2)).sum::<f64>() / across.len() as f64).sqrt();
        let travels: Vec<_> = places.iter().map(|(t, at)| (*t, (at - last).dot(&direction))).collect();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a small count")]
        let steady = ((1.0 - STEADY_SHARE) * places.len() as f64) as usize;
        let late: Vec<_> = travels[steady..].iter().map(|(t, travel)| (t - t0, *travel)).collect();
        let [travel, speed] = line(&late);
        Self { origin, direction, travel: Travel::Steady { t0, travel, speed }, end: travel, aside }
    }

    /// The same, but at the speed that the places tell, where it is not constant.
    fn or_as_told(self, places: &[(f64, Point2<f64>)]) -> Self {
        let told: Vec<_> = places.iter().map(|(t, at)| (*t, (at - self.origin).dot(&self.direction))).collect();
        let moving =
            |(_, travel): &&(f64, f64)| *travel - told[0].1 > STILL_M && told[told.len() - 1].1 - *travel > STILL_M;
        let off: Option<f64> = mean(told.iter().filter(moving).map(|(t, travel)| (travel - self.travel(*t)).powi(2)));
        if off.is_some_and(|square| square.sqrt() <= STEADY_M) {
            return self;
        }
        Self { end: told[told.len() - 1].1, travel: Travel::Told(told), ..self }
    }

    fn travel(&self, t: f64) -> f64 {
        match &self.travel {
            Travel::Steady { t0, travel, speed } => travel + speed * (t - t0),
            Travel::Told(told) => {
                let next = told.partition_point(|(time, _)| *time <= t).clamp(1, told.len() - 1);
                let [(t0, from), (t1, to)] = [told[next - 1], told[next]];
                from + (to - from) * ((t - t0) / (t1 - t0)).clamp(0.0, 1.0)
            }
        }
    }
}

/// The first touch in time, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FirstTouch {
    /// It began then.
    At(f64),
    /// It touched already then.
    Before(f64),
    /// It did not touch.
    Never,
    /// The force's bias is not known.
    Unknown,
}

/// Why places and forces are no slow push.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NotStraight {
    /// The finger stands still.
    #[error("the finger goes {length_mm:.2} mm: a push is some millimetres at least")]
    Still {
        /// How far, mm.
        length_mm: f64,
    },
    /// It turns.
    #[error(
        "the finger's places are {aside_mm:.2} mm rms off a straight line, at most {ASIDE_MM} mm can be a straight push: cut the path where it turns, and give each part as a push"
    )]
    Turns {
        /// How far, mm.
        aside_mm: f64,
    },
}

/// A shorter way is no push, m.
const LENGTH_LEAST_M: f64 = 1e-3;

/// Places that are farther off a straight line than this, rms in mm, are not on one: robots are straight to a tenth of it.
const ASIDE_MM: f64 = 0.5;

/// Places that are nearer than this to a constant speed, rms, follow it, m: what steps of 0.1 mm and clocks leave.
const STEADY_M: f64 = 0.1e-3;

/// Nearer than this to the first or last place the finger may stand still, m.
const STILL_M: f64 = 0.5e-3;

/// A slow push as measured places of the disk's centre (s, m) and the force on the finger while it touches (s, N; the
/// places' axes) tell it, forces averaged over stretches of `bin` (m).
///
/// # Errors
/// [`NotStraight`].
pub fn of_places(
    places: &[(f64, Point2<f64>)],
    touching: impl Iterator<Item = (f64, Vector2<f64>)>,
    first: FirstTouch,
    bin: f64,
) -> Result<FeltPush, NotStraight> {
    let length = match places {
        [(_, from), .., (_, to)] => (to - from).norm(),
        _ => 0.0,
    };
    if length < LENGTH_LEAST_M {
        return Err(NotStraight::Still { length_mm: length / MM });
    }
    let way = Way::of(places, Vector2::x());
    let aside_mm = way.aside / MM;
    if aside_mm > ASIDE_MM {
        return Err(NotStraight::Turns { aside_mm });
    }
    let way = way.or_as_told(places);
    let yaw = way.direction.y.atan2(way.direction.x);
    Ok(felt(&way, yaw, touching.map(|(t, force)| (t, -force)), first, bin))
}

/// What a report of a recording says of the first touch, on the recording's own clock.
#[must_use]
pub fn first_touch(report: &RecordingReport) -> FirstTouch {
    match (report.start, report.onset) {
        (_, _) if report.bias.is_none() => FirstTouch::Unknown,
        (RecordingStart::InContact, _) => FirstTouch::Before(report.t0),
        (_, Some(onset)) => FirstTouch::At(report.t0 + onset),
        (_, None) => FirstTouch::Never,
    }
}

/// The force on the finger while it touches, in the report's axes.
pub fn touching(report: &RecordingReport) -> impl Iterator<Item = (f64, Vector2<f64>)> + '_ {
    let readings = report.series.iter().filter(|row| row.touch.is_some());
    readings.map(|row| (report.t0 + row.t, Vector2::from(row.force_finger)))
}

/// A push of a log.
fn logged(push: &LoggedPush, report: &RecordingReport, bin: f64) -> FeltPush {
    let last = push.tips[push.tips.len() - 1].pose.yaw;
    let turn = push.tips.iter().map(|tip| palpate::math::angle::wrap_angle(tip.pose.yaw - last));
    let yaw = last + mean(turn).unwrap_or(0.0);
    let places: Vec<_> = push.tips.iter().map(|tip: &Tip| (tip.t, Point2::from(tip.pose.position_world))).collect();
    let turn = Rotation2::new(yaw);
    let way = Way::of(&places, turn * Vector2::x());
    // Force on the part: against that on the finger.
    let forces = touching(report).map(|(t, force)| (t, -(turn * force)));
    felt(&way, yaw, forces, first_touch(report), bin)
}

/// Forces on the part, world axes, averaged over stretches of the way.
fn felt(
    way: &Way,
    yaw: f64,
    forces_on_part: impl Iterator<Item = (f64, Vector2<f64>)>,
    first: FirstTouch,
    bin: f64,
) -> FeltPush {
    let end = way.end;
    let onset = match first {
        FirstTouch::Unknown => Onset::Unknown,
        FirstTouch::Before(t) => Onset::Before(way.travel(t)),
        FirstTouch::At(t) => Onset::At(way.travel(t)),
        FirstTouch::Never => Onset::Never(end),
    };
    let mut forces: Vec<FeltForce> = Vec::new();
    let mut held: Vec<Vector2<f64>> = Vec::new();
    let mut stretch = f64::NAN;
    let middle = |stretch: f64| end - (stretch + 0.5) * bin;
    for (t, force) in forces_on_part {
        // Counted back from the end, so that nothing rests on where the log begins.
        let here = ((end - way.travel(t)) / bin).floor();
        if (here - stretch).abs() > 0.0 || stretch.is_nan() {
            forces.extend(mean(held.drain(..)).map(|force| FeltForce { travel: middle(stretch), force }));
            stretch = here;
        }
        held.push(force);
    }
    forces.extend(mean(held.drain(..)).map(|force| FeltForce { travel: middle(stretch), force }));
    FeltPush { origin: way.origin, direction: way.direction, tool_yaw: yaw, end, onset, forces }
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
    fn places_and_forces_are_the_push_that_they_were() {
        // Two seconds at rest, then to 5 mm/s in 1 s, on for 2 s, and braked in 0.5 s; along a slope of 3 to 4.
        let travel = |t: f64| {
            let (t, v) = (t - 2.0, 5e-3);
            match t {
                t if t < 0.0 => 0.0,
                t if t < 1.0 => 0.5 * v * t * t,
                t if t < 3.0 => v * (t - 0.5),
                t => v * (2.5 + (t.min(3.5) - 3.0) - (t.min(3.5) - 3.0).powi(2)),
            }
        };
        let direction = Vector2::new(0.6, 0.8);
        let begin = Point2::new(0.1, -0.2);
        let places: Vec<_> =
            (0..1200).map(|k| f64::from(k) * 5e-3).map(|t| (t, begin + direction * travel(t))).collect();
        let touching = (500..1100).map(|k| f64::from(k) * 5e-3).map(|t| (t, Vector2::new(-travel(t), 2.0)));
        let felt = of_places(&places, touching, FirstTouch::At(2.5), 1e-3).unwrap();
        assert!((felt.direction - direction).norm() < 1e-9);
        let at = |travel: f64| felt.origin + felt.direction * travel;
        let Onset::At(onset) = felt.onset else { panic!("{:?}", felt.onset) };
        assert!((at(onset) - (begin + direction * travel(2.5))).norm() < 1e-6);
        assert!((at(felt.end) - places[1199].1).norm() < 1e-9);
        for force in &felt.forces[1..felt.forces.len() - 1] {
            // A mean over a stretch of a force that rises by its travel: speeds within it differ.
            let gone = (at(force.travel) - begin).norm();
            assert!((force.force - Vector2::new(gone, -2.0)).norm() < 0.2e-3, "{force:?} {gone}");
        }
        let still = of_places(&places[..300], std::iter::empty(), FirstTouch::Never, 1e-3);
        assert!(matches!(still, Err(NotStraight::Still { .. })), "{still:?}");
        let bent = (0..200).map(|k| f64::from(k) * 1e-4).map(|x| (x, Point2::new(x, (x - 0.01).abs())));
        let bent = of_places(&bent.collect::<Vec<_>>(), std::iter::empty(), FirstTouch::Never, 1e-3);
        assert!(matches!(bent, Err(NotStraight::Turns { .. })), "{bent:?}");
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
