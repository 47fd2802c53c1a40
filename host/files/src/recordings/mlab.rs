//! Pushing logs of CMU's Manipulation Lab (repository `robinzhoucmu/MLab_EXP`): a round fingertip pushes a block.
//!
//! White-space text. Line 1: the number of pushes. Then for each push the block's pose before and after
//! (`x y z qw qx qy qz`), a count and that many force rows (`t Fx Fy`), a count and that many tip rows
//! (`t x y z qw qx qy qz`). Lengths in mm, times in Unix s, forces in N in the sensor's axes and untared. The robot's
//! frame is our `world`.
//!
//! A push that cannot be read does not cost the others: two lines of seven numbers in a row are found nowhere but at
//! the start of a push, so reading goes on at the next such pair. Nothing inside the bad push is used: where a count
//! is wrong, which of the numbers are right cannot be known. A log that ends abruptly loses its last push only.

use std::ops::Range;

use nalgebra::Vector2;
use palpate::finger::contact::Reading;

use super::{ReadError, RecordingProblem, number, shorten};

/// Numbers in a line that holds a pose.
pub(super) const POSE_NUMBERS: usize = 7;
/// Numbers in a force row: time and two components.
const FORCE_NUMBERS: usize = 3;
/// Numbers in a tip row: time and pose.
const TIP_NUMBERS: usize = 8;
/// Metres in a millimetre.
const MM: f64 = 1e-3;
/// How far the squared length of a quaternion may be from 1. Tip rows have three printed digits, which gives up to
/// 1.4e-3; a column too many or too few gives far more.
const UNIT_ERROR: f64 = 5e-3;

/// Planar pose: position (m) and yaw (rad) in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockPose {
    /// Origin of the frame, m.
    pub position_world: Vector2<f64>,
    /// Angle of its x axis, rad.
    pub yaw: f64,
}

/// Pose of the fingertip at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tip {
    /// Unix time, s.
    pub t: f64,
    /// Centre of the tip and yaw of the tool.
    pub pose: BlockPose,
}

/// One push with its readings.
#[derive(Clone, Debug, PartialEq)]
pub struct LoggedPush {
    /// Number of the push in its file, from 0.
    pub index: usize,
    /// Line at which it starts, from 1.
    pub line: usize,
    /// Pose of the block before the push, robot away.
    pub before: BlockPose,
    /// Pose of the block after it, robot away.
    pub after: BlockPose,
    /// Force readings in the sensor's axes, untared.
    pub forces: Vec<Reading>,
    /// Poses of the tip; at least two, time increasing.
    pub tips: Vec<Tip>,
}

/// A push that could not be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("push {index} (from line {line}): {problem}")]
pub struct BadPush {
    /// Number of the push in its file, from 0.
    pub index: usize,
    /// Line at which it starts, from 1.
    pub line: usize,
    /// What is wrong with it.
    pub problem: RecordingProblem,
}

/// A whole log with its pushes.
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    /// How many pushes the log says it has.
    pub declared: usize,
    /// The pushes, in the order of the file.
    pub pushes: Vec<Result<LoggedPush, BadPush>>,
}

impl Log {
    /// The pushes that could be read.
    pub fn good(&self) -> impl Iterator<Item = &LoggedPush> {
        self.pushes.iter().filter_map(|push| push.as_ref().ok())
    }

    /// The pushes that could not.
    pub fn bad(&self) -> impl Iterator<Item = &BadPush> {
        self.pushes.iter().filter_map(|push| push.as_ref().err())
    }
}

/// Reads a log.
///
/// # Errors
/// [`ReadError`] if it does not start with the number of pushes. Bad pushes are in [`Log::pushes`].
pub fn parse(text: &str) -> Result<Log, ReadError> {
    let lines: Vec<Line> = lines(text);
    let first = lines.first().ok_or(ReadError::Empty)?;
    let declared = match first.fields[..] {
        [field] => field.parse().ok(),
        _ => None,
    };
    let no_count = || ReadError::NoCount { line: first.number, found: shorten(first.text) };
    let declared: usize = declared.ok_or_else(no_count)?;
    let mut cursor = Cursor { lines: &lines, next: 1, ends_whole: text.ends_with('\n') };
    let mut pushes = Vec::new();
    while cursor.next < lines.len() {
        let (index, start) = (pushes.len(), cursor.next);
        let line = lines[start].number;
        let push = cursor.push(index).map_err(|problem| BadPush { index, line, problem });
        if push.is_err() {
            cursor.seek_push(start + 1);
        }
        pushes.push(push);
    }
    Ok(Log { declared, pushes })
}

struct Line<'a> {
    number: usize,
    text: &'a str,
    fields: Vec<&'a str>,
}

/// The lines that are not blank.
fn lines(text: &str) -> Vec<Line<'_>> {
    text.lines()
        .enumerate()
        .map(|(i, text)| Line { number: i + 1, text: text.trim(), fields: text.split_whitespace().collect() })
        .filter(|line| !line.fields.is_empty())
        .collect()
}

impl Line<'_> {
    fn problem(&self, column: Option<usize>, message: String) -> RecordingProblem {
        RecordingProblem { line: self.number, column, message }
    }

    /// The line's numbers, of which there must be `N`.
    fn numbers<const N: usize>(&self, what: &str) -> Result<[f64; N], RecordingProblem> {
        if self.fields.len() != N {
            let message = format!("expected {what} ({N} numbers), found {} fields", self.fields.len());
            return Err(self.problem(None, message));
        }
        let mut values = [0.0; N];
        for (i, value) in values.iter_mut().enumerate() {
            *value = number(self.fields[i]).map_err(|message| self.problem(Some(i + 1), message))?;
        }
        Ok(values)
    }

    fn pose(&self, what: &str) -> Result<BlockPose, RecordingProblem> {
        pose(&self.numbers::<POSE_NUMBERS>(what)?).map_err(|message| self.problem(None, message))
    }

    fn is_pose(&self) -> bool {
        self.fields.len() == POSE_NUMBERS
    }
}

/// Position and yaw `2 atan2(qz, qw)` of `x y z qw qx qy qz`. The height, and the block's tilt of a fraction of a
/// degree, play no part in the plane.
fn pose(values: &[f64; POSE_NUMBERS]) -> Result<BlockPose, String> {
    let [x, y, _, qw, qx, qy, qz] = *values;
    let length_squared = qw * qw + qx * qx + qy * qy + qz * qz;
    if (length_squared - 1.0).abs() > UNIT_ERROR {
        return Err(format!(
            "the quaternion's squared length is {length_squared}, which must be 1 within {UNIT_ERROR}"
        ));
    }
    Ok(BlockPose { position_world: Vector2::new(x, y) * MM, yaw: 2.0 * qz.atan2(qw) })
}

struct Cursor<'a> {
    lines: &'a [Line<'a>],
    next: usize,
    /// Whether the text ends with a line end: if not, its last number may be cut.
    ends_whole: bool,
}

impl<'a> Cursor<'a> {
    fn push(&mut self, index: usize) -> Result<LoggedPush, RecordingProblem> {
        let first = self.line("the block's pose before the push")?;
        let before = first.pose("the block's pose before the push")?;
        let after = self.line("the block's pose after the push")?.pose("the block's pose after the push")?;
        let force_rows = self.rows("force rows")?;
        let forces = force_rows.clone().map(|row| self.force(row)).collect::<Result<Vec<_>, _>>()?;
        let tip_rows = self.rows("tip rows")?;
        let tips = tip_rows.clone().map(|row| self.tip(row)).collect::<Result<Vec<_>, _>>()?;
        let (force_times, tip_times): (Vec<_>, Vec<_>) =
            (forces.iter().map(|force| force.t).collect(), tips.iter().map(|tip| tip.t).collect());
        self.check_times(&force_rows, &force_times, "force rows")?;
        self.check_times(&tip_rows, &tip_times, "tip rows")?;
        Ok(LoggedPush { index, line: first.number, before, after, forces, tips })
    }

    fn line(&mut self, what: &str) -> Result<&'a Line<'a>, RecordingProblem> {
        let line = self.lines.get(self.next).ok_or_else(|| self.end(what))?;
        self.next += 1;
        Ok(line)
    }

    /// Reads a count and steps over that many rows.
    fn rows(&mut self, what: &str) -> Result<Range<usize>, RecordingProblem> {
        let line = self.line(what)?;
        let [field] = line.fields[..] else {
            let message = format!("expected the number of {what}, found {} fields", line.fields.len());
            return Err(line.problem(None, message));
        };
        let bad = |_| line.problem(Some(1), format!("`{}` is not the number of {what}", shorten(field)));
        let rows: usize = field.parse().map_err(bad)?;
        let start = self.next;
        let there = self.lines.len() - start;
        if rows > there || (rows == there && !self.ends_whole) {
            let message = format!("the file ends after {there} of the {rows} {what} announced here");
            return Err(line.problem(None, message));
        }
        self.next = start + rows;
        Ok(start..self.next)
    }

    fn force(&self, row: usize) -> Result<Reading, RecordingProblem> {
        let [t, fx, fy] = self.lines[row].numbers::<FORCE_NUMBERS>("a force row `t Fx Fy`")?;
        Ok(Reading::new(t, Vector2::new(fx, fy)))
    }

    fn tip(&self, row: usize) -> Result<Tip, RecordingProblem> {
        let line = &self.lines[row];
        let [t, values @ ..] = line.numbers::<TIP_NUMBERS>("a tip row `t x y z qw qx qy qz`")?;
        Ok(Tip { t, pose: pose(&values).map_err(|message| line.problem(None, message))? })
    }

    /// Interpolation, filters and the tare all need times that increase.
    fn check_times(&self, rows: &Range<usize>, times: &[f64], what: &str) -> Result<(), RecordingProblem> {
        let row = |i: usize| &self.lines[rows.start + i];
        if times.len() < 2 {
            let message = format!("{} {what}, where at least 2 are needed", times.len());
            return Err(self.lines[rows.start - 1].problem(None, message));
        }
        match times.windows(2).position(|pair| pair[1] <= pair[0]) {
            Some(i) => Err(row(i + 1).problem(Some(1), format!("time {} s is not after the row before", times[i + 1]))),
            None => Ok(()),
        }
    }

    fn end(&self, what: &str) -> RecordingProblem {
        let line = self.lines.last().map_or(0, |line| line.number);
        RecordingProblem { line, column: None, message: format!("the file ends where {what} should follow") }
    }

    /// Goes on to the next pair of pose lines at or after line `from`.
    fn seek_push(&mut self, from: usize) {
        let starts = |i: &usize| self.lines[*i].is_pose() && self.lines.get(i + 1).is_some_and(Line::is_pose);
        self.next = (from..self.lines.len()).find(starts).unwrap_or(self.lines.len());
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::synthetic::{PushSpec, log};
    use super::*;

    fn three() -> String {
        log(&[
            PushSpec::default(),
            PushSpec { t0: 60.0, ..PushSpec::default() },
            PushSpec { t0: 120.0, ..PushSpec::default() },
        ])
    }

    #[test]
    fn poses_are_in_metres_and_radians() {
        let text = "1\n100 200 3 0 0 0 1\n100 200 3 1 0 0 0\n2\n0 1 2\n1 1 2\n2\n0 1 2 3 1 0 0 0\n1 1 2 3 1 0 0 0\n";
        let log = parse(text).unwrap();
        let push = log.pushes[0].as_ref().unwrap();
        assert!((push.before.position_world - Vector2::new(0.1, 0.2)).norm() < 1e-12);
        assert!((push.before.yaw - std::f64::consts::PI).abs() < 1e-12);
        assert_eq!(push.forces[1], Reading::new(1.0, Vector2::new(1.0, 2.0)));
        assert_eq!(push.line, 2);
    }

    /// Replaces one line (from 1) of a text.
    fn with_line(text: &str, line: usize, new: &str) -> String {
        let replaced: Vec<&str> =
            text.lines().enumerate().map(|(i, old)| if i + 1 == line { new } else { old }).collect();
        replaced.join("\n") + "\n"
    }

    #[test]
    fn a_bad_push_is_named_and_does_not_lose_the_others() {
        let text = three();
        let second = parse(&text).unwrap().pushes[1].as_ref().unwrap().line;
        let cases = [
            (second, "1 2 3 1 0 0", "expected the block's pose before the push (7 numbers), found 6 fields"),
            (second + 1, "1 2 3 1 1 0 0", "squared length is 2"),
            (second + 2, "668.5", "`668.5` is not the number of force rows"),
            (second + 2, "100000", "of the 100000 force rows announced"),
            (second + 2, "3", "expected the number of tip rows, found 3 fields"),
            (second + 2, "1200", "expected a force row"),
            (second + 5, "1 NaN 2", "column 2: `NaN` is not finite"),
            (second + 5, "0 1 2", "is not after the row before"),
        ];
        for (line, new, message) in cases {
            let log = parse(&with_line(&text, line, new)).unwrap();
            assert_eq!(log.good().count(), 2, "{new}: {:?}", log.bad().collect::<Vec<_>>());
            let bad: Vec<_> = log.bad().collect();
            assert_eq!((bad.len(), bad[0].index), (1, 1), "{new}");
            assert!(bad[0].to_string().contains(message), "{new}: {}", bad[0]);
        }
    }

    #[test]
    fn a_log_that_ends_abruptly_keeps_its_whole_pushes_wherever_it_was_cut() {
        let text = three();
        let whole = parse(&text).unwrap();
        let starts: Vec<usize> = whole.good().map(|push| push.line).collect();
        for cut in (0..text.len()).step_by(97).chain(text.len() - 200..text.len()) {
            let lines = text[..cut].matches('\n').count();
            let Ok(log) = parse(&text[..cut]) else {
                assert_eq!(lines, 0, "cut at {cut}");
                continue;
            };
            let complete = starts[1..].iter().filter(|&&start| lines >= start - 1).count();
            assert_eq!(log.good().count(), complete, "cut at {cut}");
            assert!(log.good().eq(whole.good().take(complete)), "cut at {cut}");
        }
    }

    #[test]
    fn what_is_no_log_is_refused() {
        assert_eq!(parse(""), Err(ReadError::Empty));
        assert!(matches!(parse("t Fx Fy\n"), Err(ReadError::NoCount { line: 1, .. })));
        assert_eq!(parse("5\n").unwrap().pushes, []);
    }

    proptest! {
        #[test]
        fn any_text_at_all_is_read_or_refused(
            lines in proptest::collection::vec("([0-9.e-]{1,3} ?){0,9}", 0..40)
        ) {
            let _ = parse(&(lines.join("\n") + "\n"));
        }
    }
}
