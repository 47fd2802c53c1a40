//! Contact, felt in what was recorded: one [`RecordingReport`] for each push or table.
//!
//! The same code as on a live finger ([`palpate::finger::contact`]) runs over the recorded forces. Where the log knows
//! the part's pose before and after the push, the direction felt is compared with the inward normal of the edge
//! touched.
//!
//! Frames: `finger` = the sensor's axes after [`RecordingOptions::finger_from_sensor`]; `world` where the log has the
//! finger's yaw, otherwise the same as `finger`. The force is the force on the finger; `u` is the direction of the force
//! on the part, so without friction it is that of the edge's inward normal. Units: SI.
//! Errors: a bias that cannot be known is an answer, and such a report has no contact in it.

use nalgebra::{Matrix2, Vector2};
use palpate::finger::contact::offline::{self, Bias, BiasOrigin, BiasUnknown, Judged, RecordingStart};
use palpate::finger::contact::{Contact, ContactReading, ContactSettings, Event, Reading, SettingsError, Tare, noise};
use palpate::math::angle::wrap_angle;
use palpate::math::statistics::{mean, median};
use serde::Serialize;

use super::csv::RecordedTable;
use super::mlab::{BlockPose, Log, LoggedPush, Tip};
use super::part::RecordedPart;

/// Probability that the intervals are stated for.
pub const COVERAGE: f64 = 0.95;
/// Size of noise, standard deviations, for which the share of readings within is reported.
pub const WITHIN_SIGMAS: f64 = 2.0;
/// `1/√2`, what the mounting's matrix is made of.
const K: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// How the pushing logs' sensor is mounted: force on the finger in the tool's axes = this × force in the sensor's.
///
/// From the logs' notes: the force on the block in the tool frame is `−Aᵀ F`, so that on the finger is `Aᵀ F`. It is a
/// reflection: one of the two frames is left-handed.
pub const MLAB_TOOL_FROM_SENSOR: Matrix2<f64> = Matrix2::new(K, K, K, -K);

/// How recordings are to be read.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingOptions {
    /// Thresholds, averaging, friction and mounting angle.
    pub settings: ContactSettings,
    /// Turns (and mirrors, if need be) the file's force components into the finger's axes.
    pub finger_from_sensor: Matrix2<f64>,
    /// A stretch without contact, s after the first reading; `None` to find one by comparing recordings.
    pub tare: Option<[f64; 2]>,
    /// Force by which a recording's start must differ from its neighbours' to have begun in contact.
    pub start_force: f64,
    /// The part that was pushed.
    pub part: Option<RecordedPart>,
    /// Half angle, rad, within which the force is expected about the edge's inward normal.
    pub cone: f64,
}

impl Default for RecordingOptions {
    fn default() -> Self {
        Self {
            settings: ContactSettings::default(),
            finger_from_sensor: Matrix2::identity(),
            tare: None,
            start_force: START_FORCE_N,
            part: None,
            cone: CONE_DEG.to_radians(),
        }
    }
}

/// Default of [`RecordingOptions::start_force`], N: biases wander by up to 0.09 N in half an hour, touches start at
/// 0.5 N.
pub const START_FORCE_N: f64 = 0.2;
/// Default of [`RecordingOptions::cone`], degrees: finger friction of 0.35 (19°) and the error of an edge's angle that
/// is interpolated between the poses before and after.
pub const CONE_DEG: f64 = 34.0;

/// What was felt in one recording.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingReport {
    /// Number in its file, from 0.
    pub index: usize,
    /// Time of the first reading, s, on the file's clock; times below are relative to it.
    pub t0: f64,
    /// Length, s.
    pub duration: f64,
    /// Readings of the force.
    pub readings: usize,
    /// Whether it began without contact, in contact, or cannot be told.
    pub start: RecordingStart,
    /// Size of the first moments' mean less the bias expected from the neighbours, force units.
    pub start_deviation: Option<f64>,
    /// Began free, but that difference is unusually large: perhaps lightly touched, and its own bias wrong by as much.
    pub start_doubtful: bool,
    /// The bias, and how it was found.
    pub bias: Option<Bias>,
    /// Why there is none.
    #[serde(serialize_with = "in_words")]
    pub bias_unknown: Option<BiasUnknown>,
    /// How the free interval's second half agrees with its first.
    pub free_check: Option<FreeCheck>,
    /// Start of the first contact, s after the first reading; `None` if there was none, or if it began before.
    pub onset: Option<f64>,
    /// How many contacts there were.
    pub contacts: usize,
    /// Force and direction in contact.
    pub touch: Option<TouchSummary>,
    /// Comparison with the part's edge.
    pub edge: Option<EdgeSummary>,
    /// One row a reading.
    #[serde(skip)]
    pub series: Vec<Row>,
}

/// The second half of a free interval, judged by a tare on the first.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FreeCheck {
    /// Size of (bias from the first half − mean of the second), force units.
    pub half_difference: f64,
    /// The same in standard deviations that the tare states for it; `None` if the first half is too short for a tare.
    pub half_difference_sigmas: Option<f64>,
    /// Readings of the second half judged with the first half's noise; 0 if that is too short for a tare.
    pub samples: usize,
    /// How many of them are within [`WITHIN_SIGMAS`]: of Gaussian noise in a plane, 86.5 %.
    pub within: usize,
}

/// Contact over a whole recording.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TouchSummary {
    /// Readings that are in contact.
    pub samples: usize,
    /// Mean and largest size of the force, force units.
    pub force_mean: f64,
    /// Largest size of the force, force units.
    pub force_max: f64,
    /// Circular mean of the direction, rad in (−π, π], world.
    pub u_mean: f64,
    /// Median of the direction's standard deviation, rad.
    pub u_sd_median: f64,
}

/// Direction felt against the edge of the part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EdgeSummary {
    /// Edge touched by most readings; edge `i` runs from vertex `i` to the next.
    pub edge: usize,
    /// Readings in contact, of which the next ones count.
    pub samples: usize,
    /// Readings within the cone of [`RecordingOptions::cone`] about the inward normal.
    pub within_cone: usize,
    /// Readings whose stated interval ([`COVERAGE`]; noise and finger friction) holds the inward normal.
    pub within_stated: usize,
    /// Median of (direction − inward normal), rad: positive counter-clockwise.
    pub angle_median: f64,
    /// Largest size of it, rad.
    pub angle_worst: f64,
    /// Distance from the tip's centre to the nearest edge at the onset (pose before), m.
    pub gap_onset: Option<f64>,
    /// The same at the end (pose after), m.
    pub gap_end: f64,
    /// Way of the tip along that edge from the onset (pose before) to the end (pose after), m: counter-clockwise about
    /// the part is positive. `None` if the onset was not seen.
    pub slip: Option<f64>,
}

/// One reading with what was felt of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Time after the first reading, s.
    pub t: f64,
    /// Tared force on the finger, finger axes.
    pub force_finger: [f64; 2],
    /// What was felt, where it is in contact.
    pub touch: Option<RowTouch>,
}

/// Direction at one reading in contact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RowTouch {
    /// Direction of the force on the part, rad in (−π, π], world.
    pub u: f64,
    /// Its standard deviation, rad.
    pub u_sd: f64,
    /// Half width of the interval that holds the inward normal with probability [`COVERAGE`], rad.
    pub u_half_width: f64,
    /// Size of the force.
    pub magnitude: f64,
    /// Standard deviation of `magnitude`, force units.
    pub magnitude_sd: f64,
    /// Direction − inward normal, rad in (−π, π].
    pub angle_to_normal: Option<f64>,
    /// Number of the edge touched, from 0.
    pub edge: Option<usize>,
}

/// Feels all pushes of a log that could be read.
///
/// # Errors
/// [`SettingsError`] if a setting is out of range.
pub fn of_log(log: &Log, options: &RecordingOptions) -> Result<Vec<RecordingReport>, SettingsError> {
    let pushes: Vec<&LoggedPush> = log.good().collect();
    let recordings: Vec<Vec<Reading>> = pushes.iter().map(|push| in_finger_axes(&push.forces, options)).collect();
    let judged = judge(&recordings, options);
    let reports = pushes.iter().zip(&recordings).zip(judged);
    reports
        .map(|((push, readings), judged)| {
            let judged = Judged { bias: judged.bias.map(|bias| numbered(bias, &pushes)), ..judged };
            report(push.index, readings, judged, Some(push), options)
        })
        .collect()
}

/// Names neighbours by their numbers in the file, where pushes that could not be read count too.
fn numbered(bias: Bias, pushes: &[&LoggedPush]) -> Bias {
    let number = |recording: usize| pushes[recording].index;
    let found = match bias.found {
        BiasOrigin::Neighbours { before, after, refusal } => {
            BiasOrigin::Neighbours { before: before.map(number), after: after.map(number), refusal }
        }
        other => other,
    };
    Bias { found, ..bias }
}

/// Feels a table.
///
/// # Errors
/// [`SettingsError`] if a setting is out of range.
pub fn of_table(table: &RecordedTable, options: &RecordingOptions) -> Result<RecordingReport, SettingsError> {
    let recordings = [in_finger_axes(&table.readings, options)];
    let [readings] = &recordings;
    let unknown = BiasUnknown::NothingToCompare { neighbours: 0, candidate: None };
    let none = Judged { start: RecordingStart::Unknown, deviation: None, doubtful: false, bias: Err(unknown) };
    let judged = judge(&recordings, options).pop().unwrap_or(none);
    report(0, readings, judged, None, options)
}

fn in_finger_axes(forces: &[Reading], options: &RecordingOptions) -> Vec<Reading> {
    forces.iter().map(|r| Reading::new(r.t, options.finger_from_sensor * r.force_finger)).collect()
}

/// Judges by comparison, and puts the caller's stretch in place of what was found, if one was named.
fn judge(recordings: &[Vec<Reading>], options: &RecordingOptions) -> Vec<Judged> {
    let slices: Vec<&[Reading]> = recordings.iter().map(Vec::as_slice).collect();
    let mut judged = offline::judge(&slices, &options.settings, options.start_force);
    if let Some([t_from, t_to]) = options.tare {
        for (judged, readings) in judged.iter_mut().zip(recordings) {
            judged.bias = offline::given(readings, &(t_from..=t_to), &options.settings);
        }
    }
    judged
}

fn report(
    index: usize,
    readings: &[Reading],
    judged: Judged,
    push: Option<&LoggedPush>,
    options: &RecordingOptions,
) -> Result<RecordingReport, SettingsError> {
    let t0 = readings.first().map_or(0.0, |reading| reading.t);
    let bias = judged.bias.ok();
    let measured = match &bias {
        Some(bias) => offline::feel(readings, &options.settings, bias.tare)?,
        None => Vec::new(),
    };
    let onsets: Vec<f64> = measured.iter().filter_map(onset).collect();
    let began = judged.start == RecordingStart::InContact;
    let scene = push.and_then(|push| Some(Scene::new(push, options.part.as_ref()?, onsets.first().copied(), began)));
    let view = View { t0, tips: push.map(|push| push.tips.as_slice()), scene: scene.as_ref() };
    let series: Vec<Row> = measured.iter().map(|measured| view.row(measured)).collect();
    Ok(RecordingReport {
        index,
        t0,
        duration: readings.last().map_or(0.0, |reading| reading.t - t0),
        readings: readings.len(),
        start: judged.start,
        start_deviation: judged.deviation,
        start_doubtful: judged.doubtful,
        free_check: bias.as_ref().and_then(|bias| free_check(readings, bias, &options.settings)),
        bias_unknown: judged.bias.err(),
        bias,
        onset: onsets.first().filter(|_| !began).map(|onset| onset - t0),
        contacts: onsets.len(),
        touch: summarise(&series),
        edge: scene.and_then(|scene| scene.summarise(&series, options.cone)),
        series,
    })
}

#[expect(clippy::ref_option, reason = "the signature that serde asks for")]
fn in_words<S: serde::Serializer>(unknown: &Option<BiasUnknown>, serializer: S) -> Result<S::Ok, S::Error> {
    unknown.map(|unknown| unknown.to_string()).serialize(serializer)
}

fn onset(measured: &ContactReading) -> Option<f64> {
    match measured.event {
        Some(Event::Onset { t, .. }) => Some(t),
        _ => None,
    }
}

/// Splits the free interval in two and judges the second half by the first.
fn free_check(readings: &[Reading], bias: &Bias, settings: &ContactSettings) -> Option<FreeCheck> {
    if bias.found != BiasOrigin::OwnFreeInterval {
        return None;
    }
    let (from, to) = (bias.tare.t_from, bias.tare.t_to);
    let free: Vec<Reading> = readings.iter().filter(|r| (from..=to).contains(&r.t)).copied().collect();
    let (first, second) = free.split_at(free.len() / 2);
    let force = |half: &[Reading]| mean(half.iter().map(|reading| reading.force_finger)).unwrap_or_else(Vector2::zeros);
    match Tare::estimate(first, &settings.tare_settings()) {
        Err(_) => Some(FreeCheck {
            half_difference: (force(first) - force(second)).norm(),
            half_difference_sigmas: None,
            samples: 0,
            within: 0,
        }),
        Ok(tare) => {
            let difference = tare.bias - force(second);
            let one = tare.single_covariance + tare.bias_covariance;
            let inside = |r: &&Reading| noise::mahalanobis(&(r.force_finger - tare.bias), &one) <= WITHIN_SIGMAS;
            // The second half is as long as the first, so its mean is as uncertain.
            let sigmas = noise::mahalanobis(&difference, &(tare.bias_covariance * 2.0));
            Some(FreeCheck {
                half_difference: difference.norm(),
                half_difference_sigmas: Some(sigmas),
                samples: second.len(),
                within: second.iter().filter(inside).count(),
            })
        }
    }
}

fn summarise(series: &[Row]) -> Option<TouchSummary> {
    let touches: Vec<RowTouch> = series.iter().filter_map(|row| row.touch).collect();
    let u_sd_median = median(touches.iter().map(|touch| touch.u_sd))?;
    let direction: Vector2<f64> = touches.iter().map(|touch| Vector2::new(touch.u.cos(), touch.u.sin())).sum();
    Some(TouchSummary {
        samples: touches.len(),
        force_mean: mean(touches.iter().map(|touch| touch.magnitude))?,
        force_max: touches.iter().map(|touch| touch.magnitude).fold(0.0, f64::max),
        u_mean: direction.y.atan2(direction.x),
        u_sd_median,
    })
}

/// How the sense's answers are to be seen: from which time, and in which frame.
struct View<'a> {
    t0: f64,
    tips: Option<&'a [Tip]>,
    scene: Option<&'a Scene<'a>>,
}

impl View<'_> {
    fn row(&self, measured: &ContactReading) -> Row {
        let (force, touch) = match measured.contact {
            Contact::Free { force_finger, .. } => (force_finger, None),
            Contact::Touching(touch) => (touch.force_finger, Some(touch)),
        };
        let tip = self.tips.map(|tips| tip_at(tips, measured.t));
        let touch = touch.map(|touch| {
            let u = wrap_angle(touch.u + tip.map_or(0.0, |tip| tip.yaw));
            let normal = self.scene.zip(tip).map(|(scene, tip)| scene.normal(measured.t, &tip));
            RowTouch {
                u,
                u_sd: touch.u_sd,
                u_half_width: touch.interval(COVERAGE).half_width,
                magnitude: touch.magnitude,
                magnitude_sd: touch.magnitude_sd,
                angle_to_normal: normal.map(|(_, angle)| wrap_angle(u - angle)),
                edge: normal.map(|(edge, _)| edge),
            }
        });
        Row { t: measured.t - self.t0, force_finger: [force.x, force.y], touch }
    }
}

/// Pose of the tip at a time: linear between rows, held at the ends.
fn tip_at(tips: &[Tip], t: f64) -> BlockPose {
    let after = tips.partition_point(|tip| tip.t <= t).clamp(1, tips.len() - 1);
    let (start, end) = (&tips[after - 1], &tips[after]);
    start.pose.interpolate(&end.pose, ((t - start.t) / (end.t - start.t)).clamp(0.0, 1.0))
}

/// The pushed part between its known poses.
struct Scene<'a> {
    push: &'a LoggedPush,
    part: &'a RecordedPart,
    /// Start of the push, s: the part is at its pose before.
    t_start: f64,
    /// Whether the start was seen, and not before the recording.
    seen: bool,
    /// End of the push, s: the part is at its pose after.
    t_end: f64,
}

impl<'a> Scene<'a> {
    /// The part rests until the first contact (or moves from the first reading on, if it was touched then) and moves
    /// evenly to the end.
    fn new(push: &'a LoggedPush, part: &'a RecordedPart, onset: Option<f64>, began_in_contact: bool) -> Self {
        let t_first = push.tips.first().map_or(0.0, |tip| tip.t);
        let t_end = push.tips.last().map_or(0.0, |tip| tip.t);
        let seen = onset.is_some() && !began_in_contact;
        Self { push, part, t_start: onset.filter(|_| seen).unwrap_or(t_first).min(t_end), seen, t_end }
    }

    fn part_pose(&self, t: f64) -> BlockPose {
        let duration = self.t_end - self.t_start;
        let share = if duration > 0.0 { ((t - self.t_start) / duration).clamp(0.0, 1.0) } else { 1.0 };
        self.push.before.interpolate(&self.push.after, share)
    }

    /// Edge nearest to the tip, and the polar angle of its inward normal, rad, world.
    fn normal(&self, t: f64, tip: &BlockPose) -> (usize, f64) {
        let pose = self.part_pose(t);
        let edge = self.part.nearest(&pose.from_world(&tip.position_world)).edge;
        (edge, pose.yaw + self.part.inward_normal(edge))
    }

    fn gap(&self, t: f64, pose: &BlockPose) -> f64 {
        self.part.nearest(&pose.from_world(&tip_at(&self.push.tips, t).position_world)).distance
    }

    /// Where along an edge the tip is, m.
    fn along(&self, edge: usize, t: f64, pose: &BlockPose) -> f64 {
        self.part.along(edge, &pose.from_world(&tip_at(&self.push.tips, t).position_world))
    }

    fn summarise(&self, series: &[Row], cone: f64) -> Option<EdgeSummary> {
        let touches: Vec<RowTouch> = series.iter().filter_map(|row| row.touch).collect();
        let edges: Vec<usize> = touches.iter().filter_map(|touch| touch.edge).collect();
        let angles: Vec<f64> = touches.iter().filter_map(|touch| touch.angle_to_normal).collect();
        let times = |edge: &&usize| edges.iter().filter(|other| other == edge).count();
        let edge = *edges.iter().max_by_key(times)?;
        let [first, last] = [(self.t_start, &self.push.before), (self.t_end, &self.push.after)]
            .map(|(t, pose)| self.along(edge, t, pose));
        Some(EdgeSummary {
            edge,
            samples: angles.len(),
            within_cone: angles.iter().filter(|angle| angle.abs() <= cone).count(),
            within_stated: within_stated(series),
            angle_median: median(angles.iter().copied())?,
            angle_worst: angles.iter().fold(0.0, |worst: f64, angle| worst.max(angle.abs())),
            gap_onset: self.seen.then(|| self.gap(self.t_start, &self.push.before)),
            gap_end: self.gap(self.t_end, &self.push.after),
            slip: self.seen.then_some(last - first),
        })
    }
}

/// Readings whose stated interval holds the inward normal.
pub(super) fn within_stated(series: &[Row]) -> usize {
    let holds = |touch: &RowTouch| touch.angle_to_normal.is_some_and(|angle| angle.abs() <= touch.u_half_width);
    series.iter().filter(|row| row.touch.as_ref().is_some_and(holds)).count()
}

/// All reports of a session in a few numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RecordingSummary {
    /// Recordings that were felt.
    pub recordings: usize,
    /// Those that began in contact (numbers in their file).
    pub began_in_contact: Vec<usize>,
    /// Those that began free, but perhaps lightly touched.
    pub start_doubtful: Vec<usize>,
    /// Those whose bias is unknown.
    pub bias_unknown: Vec<usize>,
    /// Those never touched, though their bias is known.
    pub never_touched: Vec<usize>,
    /// Those with a free interval that was split in halves.
    pub halves: usize,
    /// Largest difference between the halves, force units.
    pub half_difference_max: f64,
    /// Mean square of that difference in standard deviations of each axis, over those where it is stated: 1 if right.
    pub half_difference_chi: Option<f64>,
    /// Readings of second halves judged by the first, and those within [`WITHIN_SIGMAS`].
    pub free_samples: usize,
    /// Those of `free_samples` within [`WITHIN_SIGMAS`].
    pub free_within: usize,
    /// Readings in contact compared with an edge.
    pub edge_samples: usize,
    /// Of these, within the cone.
    pub edge_within_cone: usize,
    /// Of these, with the inward normal in the stated interval.
    pub edge_within_stated: usize,
    /// Mean distance of the tip's centre from the edge at the end, m.
    pub gap_end_mean: Option<f64>,
}

impl RecordingSummary {
    /// Sums up the reports of a session.
    #[must_use]
    pub fn of(reports: &[RecordingReport]) -> Self {
        let numbers =
            |keep: &dyn Fn(&RecordingReport) -> bool| reports.iter().filter(|r| keep(r)).map(|r| r.index).collect();
        let checks: Vec<FreeCheck> = reports.iter().filter_map(|report| report.free_check).collect();
        let edges: Vec<EdgeSummary> = reports.iter().filter_map(|report| report.edge).collect();
        let squares: Vec<f64> =
            checks.iter().filter_map(|check| Some(check.half_difference_sigmas?.powi(2) / 2.0)).collect();
        let gaps: Vec<f64> = edges.iter().map(|edge| edge.gap_end).collect();
        Self {
            recordings: reports.len(),
            began_in_contact: numbers(&|r| r.start == RecordingStart::InContact),
            start_doubtful: numbers(&|r| r.start_doubtful),
            bias_unknown: numbers(&|r| r.bias.is_none()),
            never_touched: numbers(&|r| r.bias.is_some() && r.contacts == 0),
            halves: checks.len(),
            half_difference_max: checks.iter().map(|check| check.half_difference).fold(0.0, f64::max),
            half_difference_chi: mean(&squares),
            free_samples: checks.iter().map(|check| check.samples).sum(),
            free_within: checks.iter().map(|check| check.within).sum(),
            edge_samples: edges.iter().map(|edge| edge.samples).sum(),
            edge_within_cone: edges.iter().map(|edge| edge.within_cone).sum(),
            edge_within_stated: edges.iter().map(|edge| edge.within_stated).sum(),
            gap_end_mean: mean(&gaps),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::{PushSpec, log, session};
    use super::super::{csv, mlab};
    use super::*;

    const TRIANGLE: &str = "3\n0 0 0\n150 0 0\n0 150 0\n50\n";
    /// Two sampling periods of the made-up logs, s: an onset is dated to a reading, and the force is there at once.
    const ONSET_ERROR_S: f64 = 0.021;
    /// How far a bias from neighbours may be off, N; the made-up ones do not drift and have 4 mN of noise.
    const BIAS_ERROR_N: f64 = 0.002;

    fn options() -> RecordingOptions {
        let settings = ContactSettings { contact_friction: 0.25_f64.tan(), ..ContactSettings::default() };
        let part = Some(RecordedPart::parse(TRIANGLE).unwrap());
        RecordingOptions { settings, finger_from_sensor: MLAB_TOOL_FROM_SENSOR, part, ..RecordingOptions::default() }
    }

    fn measured(pushes: &[PushSpec]) -> Vec<RecordingReport> {
        of_log(&mlab::parse(&log(pushes)).unwrap(), &options()).unwrap()
    }

    fn bias_in_finger_axes(push: &PushSpec) -> Vector2<f64> {
        MLAB_TOOL_FROM_SENSOR * Vector2::from(push.bias)
    }

    #[test]
    fn a_push_that_starts_free_is_felt_with_onset_direction_and_force() {
        for (i, yaw) in [0.0, 1.0, 3.0, -2.0].into_iter().enumerate() {
            let pushes: Vec<_> = session(5).into_iter().map(|push| PushSpec { yaw, ..push }).collect();
            let report = &measured(&pushes)[i];
            assert_eq!(report.start, RecordingStart::Free);
            assert!((report.onset.unwrap() - 1.5).abs() < ONSET_ERROR_S, "{:?}", report.onset);
            let touch = report.touch.unwrap();
            let truth = yaw + std::f64::consts::FRAC_PI_2 + 0.2;
            assert!(wrap_angle(touch.u_mean - truth).abs() < 0.005, "yaw {yaw}: {}, wanted {truth}", touch.u_mean);
            assert!((touch.force_max - 3.0).abs() < 0.02, "{}", touch.force_max);
            let edge = report.edge.unwrap();
            assert_eq!(edge.edge, 0);
            assert!((edge.angle_median - 0.2).abs() < 0.003, "{edge:?}");
            assert_eq!((edge.within_cone, edge.within_stated), (edge.samples, edge.samples));
            assert!((edge.gap_onset.unwrap() - 1e-3).abs() < 1e-4, "{edge:?}");
            // The last force row comes 30 ms after the last tip row.
            assert!((edge.gap_end - 1e-3).abs() < 1.5e-4, "{edge:?}");
        }
    }

    #[test]
    fn a_push_that_begins_in_contact_gets_its_bias_from_its_neighbours_in_time() {
        let mut pushes = session(7);
        pushes[3].onset = 0.0;
        pushes.rotate_left(2);
        let reports = measured(&pushes);
        let began: Vec<_> = reports.iter().filter(|r| r.start == RecordingStart::InContact).map(|r| r.index).collect();
        assert_eq!(began, [1], "the order in the file does not matter");
        let bias = reports[1].bias.unwrap();
        assert_eq!(bias.found, BiasOrigin::Neighbours { before: Some(0), after: Some(2), refusal: None });
        assert!((bias.tare.bias - bias_in_finger_axes(&pushes[1])).norm() < BIAS_ERROR_N);
        assert_eq!((reports[1].onset, reports[1].contacts), (None, 1), "contact began before the recording");
        assert!((reports[1].edge.unwrap().angle_median - 0.2).abs() < 0.003);
    }

    #[test]
    fn a_drifting_bias_is_interpolated_to_the_push_s_own_time() {
        let drift = |t: f64| [0.03 + 2e-4 * t, -0.08 - 1e-4 * t];
        let times = [0.0, 60.0, 120.0, 180.0, 200.0, 280.0, 340.0, 400.0];
        let mut pushes = times.map(|t0| PushSpec { t0, bias: drift(t0), ..PushSpec::default() });
        pushes[4].onset = 0.0;
        let report = &measured(&pushes)[4];
        let bias = report.bias.unwrap().tare.bias;
        // Halfway between the neighbours instead would be 6.7 mN off.
        assert!((bias - bias_in_finger_axes(&pushes[4])).norm() < BIAS_ERROR_N, "{bias}");
    }

    #[test]
    fn the_part_rests_until_the_onset_and_then_moves_evenly_to_its_end() {
        let log = mlab::parse(&log(&session(1))).unwrap();
        let push = log.good().next().unwrap();
        let part = RecordedPart::parse(TRIANGLE).unwrap();
        let (start, end) = (push.tips[0].t, push.tips[199].t);
        let scene = Scene::new(push, &part, Some(start + 1.5), false);
        let moved = |t: f64| (scene.part_pose(t).position_world - push.before.position_world).norm();
        let whole = (push.after.position_world - push.before.position_world).norm();
        for (t, want) in [(start, 0.0), (start + 1.5, 0.0), (0.5 * (start + 1.5 + end), 0.5 * whole), (end, whole)] {
            assert!((moved(t) - want).abs() < 1e-6, "{t}: {} m, wanted {want} m", moved(t));
        }
    }

    #[test]
    fn a_touch_too_early_for_an_own_tare_takes_the_neighbours_and_says_why() {
        let mut pushes = session(6);
        pushes[2] = PushSpec { onset: 0.19, force: 1.0, ..pushes[2] };
        let report = &measured(&pushes)[2];
        assert_eq!(report.start, RecordingStart::Free);
        let BiasOrigin::Neighbours { before: Some(1), after: Some(3), refusal: Some(_) } = report.bias.unwrap().found
        else {
            panic!("{:?}", report.bias);
        };
        assert!((report.onset.unwrap() - 0.19).abs() < ONSET_ERROR_S);
    }

    #[test]
    fn a_light_steady_touch_at_the_start_is_doubted() {
        let mut pushes = session(12);
        // 0.1 N for the whole push: below the force that counts as contact, far above the wander of 1 mN.
        pushes[5] = PushSpec { onset: -1.0, force: 0.1, ..pushes[5] };
        let doubted: Vec<_> = measured(&pushes).iter().filter(|r| r.start_doubtful).map(|r| r.index).collect();
        assert_eq!(doubted, [5]);
    }

    #[test]
    fn long_averages_are_tared_on_the_free_time_found_without_them() {
        let settings = ContactSettings {
            averaging: palpate::finger::contact::Averaging::Seconds(0.1),
            ..ContactSettings::default()
        };
        let options = RecordingOptions { settings, ..options() };
        for report in of_log(&mlab::parse(&log(&session(6))).unwrap(), &options).unwrap() {
            let bias = report.bias.unwrap();
            assert_eq!((bias.found, bias.tare.averaging_samples), (BiasOrigin::OwnFreeInterval, 10));
            // The window's middle crosses half of itself later, less what the force is above the threshold.
            assert!((report.onset.unwrap() - 1.5).abs() < 0.06, "{:?}", report.onset);
        }
    }

    #[test]
    fn a_push_alone_has_an_unknown_bias_and_no_contact_is_claimed() {
        let free = &measured(&session(1))[0];
        assert_eq!((free.start, free.contacts, free.bias), (RecordingStart::Unknown, 0, None));
        let words = free.bias_unknown.unwrap().to_string();
        assert!(words.contains("0.00 s to 1.4") && words.contains("quiet"), "{words}");
        let pressed = &measured(&[PushSpec { onset: 0.0, ..PushSpec::default() }])[0];
        assert_eq!((pressed.start, pressed.touch, pressed.bias), (RecordingStart::Unknown, None, None));
    }

    #[test]
    fn pushes_without_any_free_time_have_an_unknown_bias() {
        let pushes: Vec<_> = session(6).iter().map(|p| PushSpec { onset: 0.17, force: 1.0, ..*p }).collect();
        for report in measured(&pushes) {
            assert_eq!((report.start, report.bias, report.contacts), (RecordingStart::Free, None, 0));
            assert!(report.bias_unknown.unwrap().to_string().contains("0 neighbours with some"));
        }
    }

    #[test]
    fn pushes_hours_apart_say_nothing_of_each_other() {
        let pushes: Vec<_> = session(6).iter().map(|p| PushSpec { t0: p.t0 * 60.0, ..*p }).collect();
        assert!(
            measured(&pushes).iter().all(|report| report.start == RecordingStart::Unknown && report.bias.is_none())
        );
    }

    #[test]
    fn neighbours_are_named_by_their_numbers_in_the_file() {
        let mut pushes = session(7);
        pushes[4].onset = 0.0;
        let text = log(&pushes);
        let second = mlab::parse(&text).unwrap().pushes[1].as_ref().unwrap().line;
        let broken: Vec<&str> =
            text.lines().enumerate().map(|(i, line)| if i + 1 == second { "1 2 3 9 9 9 9" } else { line }).collect();
        let reports = of_log(&mlab::parse(&(broken.join("\n") + "\n")).unwrap(), &options()).unwrap();
        let report = reports.iter().find(|report| report.start == RecordingStart::InContact).unwrap();
        assert_eq!(report.index, 4);
        let found = report.bias.unwrap().found;
        assert_eq!(found, BiasOrigin::Neighbours { before: Some(3), after: Some(5), refusal: None });
    }

    /// A table at 100 Hz, pressed with 2 N along −x from 1 s on.
    fn table() -> csv::RecordedTable {
        let mut random = palpate::math::random::Draw::case(9, 0);
        let row = |i: u32| {
            let force = Vector2::new(random.normal(), random.normal()) * 0.004
                - Vector2::new(if i < 100 { 0.0 } else { 2.0 }, 0.1);
            format!("{:.2},{:.6},{:.6}\n", f64::from(i) * 0.01, force.x, force.y)
        };
        csv::parse(&(0..300).map(row).collect::<String>()).unwrap()
    }

    #[test]
    fn a_table_is_felt_with_the_tare_that_was_named_and_only_then() {
        let plain = RecordingOptions::default();
        let unknown = of_table(&table(), &plain).unwrap();
        assert!(unknown.bias.is_none() && unknown.touch.is_none());
        let given = of_table(&table(), &RecordingOptions { tare: Some([0.0, 0.9]), ..plain.clone() }).unwrap();
        assert!((given.onset.unwrap() - 1.0).abs() < ONSET_ERROR_S);
        assert!(given.touch.unwrap().u_mean.abs() < 0.01, "pressed from +x: {:?}", given.touch);
        let touched = of_table(&table(), &RecordingOptions { tare: Some([0.5, 1.5]), ..plain }).unwrap();
        assert!(touched.bias.is_none() && touched.touch.is_none());
        let words = touched.bias_unknown.unwrap().to_string();
        assert!(words.contains("the stretch given cannot serve") && words.contains("stepped by"), "{words}");
    }

    #[test]
    fn the_summary_counts_what_the_reports_say() {
        let mut pushes = session(6);
        pushes[2].onset = 0.0;
        let summary = RecordingSummary::of(&measured(&pushes));
        assert_eq!((summary.recordings, summary.began_in_contact.as_slice()), (6, &[2][..]));
        assert_eq!((summary.halves, summary.bias_unknown.len(), summary.never_touched.len()), (5, 0, 0));
        assert!(summary.half_difference_max < BIAS_ERROR_N && summary.half_difference_max > 0.0);
        // 5 × 72 readings: the share within two standard deviations is 86.5 % ± 1.8 %; four of those.
        let share = summary.free_within as f64 / summary.free_samples as f64;
        assert!((share - 0.865).abs() < 0.072, "{share}");
        assert_eq!(summary.edge_within_cone, summary.edge_samples);
    }
}
