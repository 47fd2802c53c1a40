//! Pushes of a log as files that people and other commands read: force and path of each push as tables, poses as one,
//! and the part.
//!
//! - force: `t [s],Fx [N],Fy [N]`, on the finger, as [`super::csv`] reads it; not tared, since the free stretch or the bias
//!   that comparing pushes found stands in the table's comments;
//! - path: `t [s],x [m],y [m]` of the disk's centre;
//! - poses: before and after each push, as they were measured;
//! - part: [`crate::part`].
//!
//! Frames: robot = `world`, all; so force, path and poses fit each other. Times count from a push's first reading of
//! force, on the log's clocks: force and tip have one each, which the log does not compare. Units: SI; the part's file
//! in mm. Errors: [`ExportError`] for a part that cannot stand so.

use std::fmt::Write as _;

use nalgebra::{Matrix2, Point2, Rotation2, Vector2};
use palpate::finger::contact::offline::BiasOrigin;
use palpate::math::statistics::mean;
use palpate::pushing::estimation::slow_pushes::{FeltPush, Standing};

use super::mlab::{BlockPose, Log, LoggedPush};
use super::session::RecordingReport;
use crate::part::{PartFile, PartFileError};

/// Why a part has no file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ExportError {
    /// Feet that do not carry it.
    #[error("feet on one line cannot bear the part")]
    Line,
    /// What was written would not be read.
    #[error(transparent)]
    Part(#[from] PartFileError),
}

/// What a push's files are named by: `push-07` of the seventh.
#[must_use]
pub fn stem(push: &LoggedPush) -> String {
    format!("push-{:02}", push.index + 1)
}

/// The table of a push's force.
#[must_use]
pub fn force_table(
    push: &LoggedPush,
    felt: &FeltPush,
    report: &RecordingReport,
    tool_from_sensor: &Matrix2<f64>,
) -> String {
    let to_world = Rotation2::new(felt.tool_yaw);
    let t0 = report.t0;
    let mut text = format!(
        "# push {} of the log: force on the finger, robot's axes, not tared; t from Unix time {t0:.6} s\n",
        push.index + 1
    );
    text += &match &report.bias {
        Some(bias) if bias.found == BiasOrigin::OwnFreeInterval => {
            let (from, to) = (bias.tare.t_from - t0, bias.tare.t_to - t0);
            format!("# free from {from:.3} to {to:.3} s: palpate contact --tare {from:.3}:{to:.3}\n")
        }
        Some(bias) => {
            let [x, y]: [f64; 2] = (to_world * bias.tare.bias).into();
            format!("# it never is free for long; by comparing pushes the bias is ({x:.4}, {y:.4}) N\n")
        }
        None => "# its bias is not known\n".to_owned(),
    };
    text += "t [s],Fx [N],Fy [N]\n";
    for reading in &push.forces {
        let force = to_world * (tool_from_sensor * reading.force_finger);
        let _ = writeln!(text, "{:.6},{:.6},{:.6}", reading.t - t0, force.x, force.y);
    }
    text
}

/// The table of the path of a push's disk: its centre is this far ahead and to the left of the logged point, m.
#[must_use]
pub fn path_table(push: &LoggedPush, t0: f64, tip: [f64; 2]) -> String {
    let [ahead, left] = tip.map(|part| part * 1e3);
    let mut text = format!(
        "# push {} of the log: the disk's centre, robot's frame, {ahead:.3} mm ahead and {left:.3} mm to the left of the \
         logged point; t from Unix time {t0:.6} s by the robot's clock; places in steps of 0.1 mm\n\
         t [s],x [m],y [m]\n",
        push.index + 1
    );
    for logged in &push.tips {
        let at = logged.pose.position_world + Rotation2::new(logged.pose.yaw) * Vector2::from(tip);
        let _ = writeln!(text, "{:.6},{:.6},{:.6}", logged.t - t0, at.x, at.y);
    }
    text
}

/// The table of all poses of a log: of the part's frame, before and after each push.
#[must_use]
pub fn poses_table(log: &Log) -> String {
    let mut text = "# poses of the part's frame as the camera saw them, robot's frame\n\
                    push,x before [m],y before [m],theta before [rad],x after [m],y after [m],theta after [rad]\n"
        .to_owned();
    let numbers =
        |pose: &BlockPose| format!("{:.6},{:.6},{:.6}", pose.position_world.x, pose.position_world.y, pose.yaw);
    for push in log.good() {
        let _ = writeln!(text, "{},{},{}", push.index + 1, numbers(&push.before), numbers(&push.after));
    }
    text
}

/// What is known of the pushed part.
#[derive(Clone, Copy, Debug)]
pub struct Pushed<'a> {
    /// Vertices, part frame, m.
    pub vertices: &'a [Vector2<f64>],
    /// What it stands on.
    pub standing: &'a Standing,
    /// Part and plane.
    pub mu: f64,
    /// Part and finger.
    pub mu_c: f64,
    /// Of the finger's disk, m.
    pub radius: f64,
}

/// The part's file. Feet bear what a uniform plate of this outline puts on them.
///
/// # Errors
/// [`ExportError`].
pub fn part_file(pushed: &Pushed<'_>) -> Result<String, ExportError> {
    let Pushed { vertices, standing, mu, mu_c, radius } = pushed;
    let mm = |value: f64| (value * 1e6).round() / 1e3;
    let corners: Vec<_> = vertices.iter().map(|vertex| format!("[{}, {}]", mm(vertex.x), mm(vertex.y))).collect();
    let outline = format!("unit = \"mm\"\nvertices = [{}]\nmu = {mu}\nmu_c = {mu_c}\n", corners.join(", "));
    let mut text = format!(
        "# The part of a pushing log, from its frame's origin. Poses, forces and paths beside this file are in the robot's\n\
         # frame; their times count from each push's first reading of force.\n\
         # The finger's disk: radius {} mm (--radius-mm). mu and mu_c were told, not measured here.\n{outline}",
        mm(*radius)
    );
    if let Standing::Feet(feet) = standing {
        let centre = PartFile::parse(&outline)?.part.centre_of_mass();
        let shares = shares(feet, centre).ok_or(ExportError::Line)?;
        let feet: Vec<_> = feet
            .iter()
            .zip(shares)
            .map(|(foot, share)| format!("[{}, {}, {share:.6}]", mm(foot.x), mm(foot.y)))
            .collect();
        text += &format!("feet = [{}]\n", feet.join(", "));
    }
    PartFile::parse(&text)?;
    Ok(text)
}

/// Shares of the weight on feet, the evenest whose centre is here; of three feet there is but one. None on one line.
fn shares(feet: &[Point2<f64>], centre: Point2<f64>) -> Option<Vec<f64>> {
    let middle: Vector2<f64> = mean(feet.iter().map(|foot| foot.coords))?;
    let spread = feet.iter().map(|foot| foot.coords - middle);
    let spread: Matrix2<f64> = spread.map(|arm| arm * arm.transpose()).sum();
    let lean = spread.try_inverse()? * (centre.coords - middle);
    let even = 1.0 / feet.len() as f64;
    Some(feet.iter().map(|foot| even + lean.dot(&(foot.coords - middle))).collect())
}

#[cfg(test)]
mod tests {
    use super::super::session::{MLAB_TOOL_FROM_SENSOR, RecordingOptions, of_log};
    use super::super::slow_pushes::of_pushes;
    use super::super::synthetic::{log, session};
    use super::super::{csv, mlab};
    use palpate::pushing::estimation::slow_pushes::FilterSettings;

    use super::*;

    #[test]
    fn tables_hold_force_and_path_in_the_robots_frame() {
        let parsed = mlab::parse(&log(&session(6))).unwrap();
        let options = RecordingOptions { finger_from_sensor: MLAB_TOOL_FROM_SENSOR, ..RecordingOptions::default() };
        let reports = of_log(&parsed, &options).unwrap();
        let felt = of_pushes(&parsed, Point2::origin(), &FilterSettings::STANDARD)[2].known.felt.clone();
        let push = parsed.good().nth(2).unwrap();
        assert_eq!(stem(push), "push-03");
        let table = csv::parse(&force_table(push, &felt, &reports[2], &MLAB_TOOL_FROM_SENSOR)).unwrap();
        assert!(table.force_in_newtons && table.problems.is_empty() && table.readings.len() == push.forces.len());
        let (free, pressed) = (table.readings[10], table.readings[table.readings.len() - 1]);
        let change = pressed.force_finger - free.force_finger;
        // 3 N on the part at 0.2 rad from +y; on the finger against it.
        let wanted = -3.0 * Vector2::new(-(0.2_f64.sin()), 0.2_f64.cos());
        assert!((change - wanted).norm() < 0.03 && free.t.abs() < 0.2, "{change}");
        let path = path_table(push, reports[2].t0, [0.0, 2e-3]);
        let rows: Vec<Vec<f64>> =
            path.lines().skip(2).map(|row| row.split(',').map(|field| field.parse().unwrap()).collect()).collect();
        assert_eq!(rows.len(), push.tips.len());
        // The tool's x axis is the world's here.
        assert!((rows[0][1] - 0.060).abs() < 1e-6 && (rows[0][2] - (-0.001 - 2.5e-3 * 1.5 + 2e-3)).abs() < 1e-6);
        let poses = poses_table(&parsed);
        assert!(
            poses.lines().count() == 8 && poses.lines().nth(4).unwrap().starts_with("3,0.000000,0.000000,"),
            "{poses}"
        );
    }

    #[test]
    fn feet_bear_what_the_plate_puts_on_them() {
        let vertices = [[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]].map(Vector2::from);
        let feet = [[0.03, 0.03], [0.063_33, 0.043_33], [0.043_33, 0.063_33]].map(Point2::from).to_vec();
        let (mu, mu_c, radius) = (0.3, 0.45, 1e-3);
        let written = |standing: &Standing| part_file(&Pushed { vertices: &vertices, standing, mu, mu_c, radius });
        let part = PartFile::parse(&written(&Standing::Feet(feet.clone())).unwrap()).unwrap();
        assert_eq!((part.mu, part.mu_c), (mu, Some(mu_c)));
        let shares = shares(&feet, Point2::new(0.05, 0.05)).unwrap();
        let centre = feet.iter().zip(&shares).map(|(foot, share)| foot.coords * *share).sum::<Vector2<f64>>();
        assert!((centre - Vector2::new(0.05, 0.05)).norm() < 1e-12 && (shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(written(&Standing::Face).is_ok_and(|text| !text.contains("feet =")));
        let line = [[0.03, 0.03], [0.04, 0.04], [0.05, 0.05]].map(Point2::from).to_vec();
        assert_eq!(written(&Standing::Feet(line)), Err(ExportError::Line));
        let aside = [[0.0, 0.0], [0.02, 0.0], [0.0, 0.02]].map(Point2::from).to_vec();
        assert!(matches!(written(&Standing::Feet(aside)), Err(ExportError::Part(_))), "the plate tips");
    }
}
