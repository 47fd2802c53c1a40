//! Where the finger's disk is, from how far the logged point was from the part's edges while they touched.
//!
//! Pushes with measured poses touch twice where all is known: at the onset the part still lies as before, at the end as
//! after. There the disk's centre is one radius from an edge, whatever friction did between. What that leaves open of a
//! set-up is linear: the disk's centre on the tool, and how far the finger goes on after the last logged point; and of
//! each log, by how much its frames are off each other (robot against the camera that saw the part, and the part's outline
//! against its frame).
//!
//! Implements: least squares of the gaps n·(q + R d) − r, softened like the fits of `learning`, each log's frames held
//! near none by how well such frames are known ([`FRAME_M`], [`FRAME_RAD`]). Standard deviations are those of the
//! jackknife over tenths of each log, since the gaps of one push go together; each tenth is also judged by the others.
//!
//! Assumes: an onset that is felt as late or early as another adds to the place ahead, and to what is beyond the log.
//! Frames: body; tool. Units: SI. Errors: [`TipGapsError`].

use nalgebra::{DMatrix, DVector, Point2, Rotation2, Vector2};

use super::felt::Onset;
use super::learning::KnownPush;
use crate::geometry::{Pose, SimplePolygon};
use crate::pushing::wave::Measured;

/// Numbers of the tip: ahead, left, beyond.
const TIP: usize = 3;

/// Numbers of a log's frames: of the robot's place in the world and of the outline's in the body along x and y each,
/// and of the outline's turn.
const FRAMES: usize = 5;

/// What one gap is off by, standard deviation, m; errors beyond count by their size.
const GAP_M: f64 = 0.4e-3;

/// How well frames of a robot and a camera are matched, standard deviation, m.
const FRAME_M: f64 = 0.5e-3;

/// And in angle, rad: that much at the ends of a part of 0.1 m.
const FRAME_RAD: f64 = 0.01;

/// Nearer to an end of an edge than this, m, the disk may touch the corner.
const CORNER_M: f64 = 3e-3;

/// A logged point is that of a touch if it is within this of an edge's line, m.
const NEAR_M: f64 = 6e-3;

/// The finger moves against an edge's normal by at least this share of its way, or it may have slid past.
const AGAINST: f64 = 0.2;

/// Parts of a log that are left out in turn.
const TENTHS: usize = 10;

/// Gaps of a log, at least: twice its unknowns.
const GAPS_MIN: usize = 2 * (TIP + FRAMES);

/// A tip that is known no better than this, m, does not come out: any disk of a finger is as near.
const OPEN_M: f64 = 2e-3;

/// Weights settle to a part in some thousands in so many rounds.
const ROUNDS: usize = 30;

/// Where the disk is, as gaps tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TipFromGaps {
    /// The disk's centre ahead of the logged point along the tool's x axis, m; holds for the radius given.
    pub ahead: Measured,
    /// The disk's centre to the left of it, along the tool's y axis, m.
    pub left: Measured,
    /// By how much farther along its way the finger is at the end than where the log ends, against the onset, m.
    pub beyond_log: Measured,
    /// What the gaps leave, rms, m.
    pub rms: f64,
    /// What they leave where each tenth of a log is judged by the fit to the others, rms, m.
    pub rms_left_out: f64,
    /// What they leave of a tip that is where the log says, rms about their mean, m.
    pub rms_uncalibrated: f64,
    /// How many there were.
    pub gaps: usize,
}

/// Why gaps do not tell where the disk is.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TipGapsError {
    /// Too few of a log.
    #[error(
        "log {log} has {gaps} touches beside the corners with poses that are known, {GAPS_MIN} are needed: record more pushes"
    )]
    TooFew {
        /// Its place in the list, from 0.
        log: usize,
        /// How many it has.
        gaps: usize,
    },
    /// Too much alike.
    #[error(
        "{gaps} touches leave the tip open to {:.1} mm, {:.1} mm is the limit: push at other angles to the edges",
        sd * 1e3, OPEN_M * 1e3
    )]
    Open {
        /// How many there are.
        gaps: usize,
        /// What is known worst, m.
        sd: f64,
    },
    /// None at all.
    #[error("there is no log")]
    NoLog,
}

/// A gap: what it is with a tip and frames that are as told, and how it changes with each unknown.
struct Gap {
    /// Which log.
    log: usize,
    /// Which tenth of it.
    tenth: usize,
    /// Gap less the radius, m.
    off: f64,
    tip: [f64; TIP],
    frames: [f64; FRAMES],
}

/// The tip of pushes of a part of this outline (body frame: the origin at the centre of mass), by a disk of this radius
/// (m).
///
/// # Errors
/// [`TipGapsError`].
pub fn tip_from_gaps(outline: &SimplePolygon, radius: f64, logs: &[&[KnownPush]]) -> Result<TipFromGaps, TipGapsError> {
    let mut gaps = Vec::new();
    for (log, pushes) in logs.iter().enumerate() {
        let before = gaps.len();
        for (number, push) in pushes.iter().enumerate() {
            let tenth = number * TENTHS / pushes.len();
            gaps.extend(gaps_of(outline, radius, push).into_iter().flatten().map(|gap| Gap { log, tenth, ..gap }));
        }
        let own = gaps.len() - before;
        if own < GAPS_MIN {
            return Err(TipGapsError::TooFew { log, gaps: own });
        }
    }
    if logs.is_empty() {
        return Err(TipGapsError::NoLog);
    }
    let unknown = TipGapsError::Open { gaps: gaps.len(), sd: f64::INFINITY };
    let whole = fitted(&gaps, logs.len(), |_| true).ok_or(unknown)?;
    let mut left_out = 0.0;
    let mut parts = Vec::new();
    for tenth in 0..TENTHS {
        let found = fitted(&gaps, logs.len(), |gap| gap.tenth != tenth).ok_or(unknown)?;
        left_out += gaps.iter().filter(|gap| gap.tenth == tenth).map(|gap| gap.left(&found).powi(2)).sum::<f64>();
        parts.push(found);
    }
    let count = TENTHS as f64;
    let number = |n: usize| {
        let mean = parts.iter().map(|part| part[n]).sum::<f64>() / count;
        let spread: f64 = parts.iter().map(|part| (part[n] - mean).powi(2)).sum();
        Measured { value: whole[n], sd: ((count - 1.0) / count * spread).sqrt() }
    };
    let sd = (0..TIP).map(|n| number(n).sd).fold(0.0, f64::max);
    if sd > OPEN_M || !sd.is_finite() {
        return Err(TipGapsError::Open { gaps: gaps.len(), sd });
    }
    let rms = |sum: f64| (sum / gaps.len() as f64).sqrt();
    let mean = gaps.iter().map(|gap| gap.off).sum::<f64>() / gaps.len() as f64;
    Ok(TipFromGaps {
        ahead: number(0),
        left: number(1),
        beyond_log: number(2),
        rms: rms(gaps.iter().map(|gap| gap.left(&whole).powi(2)).sum()),
        rms_left_out: rms(left_out),
        rms_uncalibrated: rms(gaps.iter().map(|gap| (gap.off - mean).powi(2)).sum()),
        gaps: gaps.len(),
    })
}

/// Those at the onset and at the end of a push.
fn gaps_of(outline: &SimplePolygon, radius: f64, push: &KnownPush) -> [Option<Gap>; 2] {
    let onset = match push.felt.onset {
        Onset::At(travel) => Some(travel),
        Onset::Before(_) | Onset::Never(_) | Onset::Unknown => None,
    };
    let gap = |travel: f64, pose: &Pose, is_end: bool| {
        let to_body = Rotation2::new(-pose.theta);
        let at = push.felt.origin + push.felt.direction * travel;
        let at_body = Point2::from(to_body * (at - pose.origin()));
        let direction = to_body * push.felt.direction;
        let (off, normal) = touched(outline, at_body, direction)?;
        let by_tool = Rotation2::new(pose.theta - push.felt.tool_yaw) * normal;
        let by_world = Rotation2::new(pose.theta) * normal;
        let by_turn = normal.perp(&at_body.coords);
        Some(Gap {
            log: 0,
            tenth: 0,
            off: off - radius,
            tip: [by_tool.x, by_tool.y, if is_end { normal.dot(&direction) } else { 0.0 }],
            frames: [by_world.x, by_world.y, normal.x, normal.y, by_turn],
        })
    };
    [onset.and_then(|travel| gap(travel, &push.before, false)), gap(push.felt.end, &push.after, true)]
}

/// The nearest edge that a point beside no corner may touch on its way: its distance and the outward normal.
fn touched(outline: &SimplePolygon, at: Point2<f64>, direction: Vector2<f64>) -> Option<(f64, Vector2<f64>)> {
    let of_edge = |(start, end): (Point2<f64>, Point2<f64>)| {
        let length = (end - start).norm();
        let way = (end - start) / length;
        let normal = Vector2::new(way.y, -way.x);
        let (off, along) = (normal.dot(&(at - start)), way.dot(&(at - start)));
        let beside = (CORNER_M..length - CORNER_M).contains(&along) && off.abs() < NEAR_M;
        (beside && normal.dot(&direction) < -AGAINST).then_some((off, normal))
    };
    outline.edges().filter_map(of_edge).min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
}

impl Gap {
    /// What is left with these numbers, m.
    fn left(&self, numbers: &DVector<f64>) -> f64 {
        self.off + self.slopes().map(|(number, slope)| slope * numbers[number]).sum::<f64>()
    }

    /// Numbers that the gap depends on, and how.
    fn slopes(&self) -> impl Iterator<Item = (usize, f64)> {
        let frames = TIP + FRAMES * self.log;
        let of_tip = self.tip.into_iter().enumerate();
        of_tip.chain(self.frames.into_iter().enumerate().map(move |(number, slope)| (frames + number, slope)))
    }
}

/// The numbers that explain the gaps that are kept.
fn fitted(gaps: &[Gap], logs: usize, keeps: impl Fn(&Gap) -> bool) -> Option<DVector<f64>> {
    let count = TIP + FRAMES * logs;
    let mut numbers = DVector::zeros(count);
    for _ in 0..ROUNDS {
        let mut curvature = DMatrix::zeros(count, count);
        let mut slope = DVector::zeros(count);
        for number in TIP..count {
            let scale = if (number - TIP) % FRAMES == FRAMES - 1 { FRAME_RAD } else { FRAME_M };
            curvature[(number, number)] = (GAP_M / scale).powi(2);
        }
        for gap in gaps.iter().filter(|gap| keeps(gap)) {
            let weight = (gap.left(&numbers) / GAP_M).hypot(1.0).recip();
            for (row, by_row) in gap.slopes() {
                slope[row] -= weight * by_row * gap.off;
                for (column, by_column) in gap.slopes() {
                    curvature[(row, column)] += weight * by_row * by_column;
                }
            }
        }
        numbers = curvature.cholesky()?.solve(&slope);
    }
    Some(numbers)
}

#[cfg(test)]
mod tests {
    use super::super::FeltPush;
    use super::*;
    use crate::math::random::Draw;

    const RADIUS_M: f64 = 1e-3;
    /// Ahead, left, beyond.
    const TIP_M: [f64; TIP] = [-0.6e-3, -0.9e-3, 1.1e-3];

    fn outline() -> SimplePolygon {
        SimplePolygon::new([[-0.05, -0.05], [0.1, -0.05], [-0.05, 0.1]].map(Point2::from)).unwrap()
    }

    /// Pushes whose disk touches the outline at the onset and at the end, with gaps that are off by `sd`, seen from
    /// frames that are off by these.
    fn pushes(count: usize, angles: f64, sd: f64, world: Vector2<f64>, draw: &mut Draw) -> Vec<KnownPush> {
        let outline = outline();
        let edges: Vec<_> = outline.edges().collect();
        let mut made = Vec::new();
        for _ in 0..count {
            let (start, end) = edges[draw.index(3)];
            let way = (end - start).normalize();
            let normal = Vector2::new(way.y, -way.x);
            let inward = (-normal.y).atan2(-normal.x) + draw.uniform(-angles, angles);
            let mut touch = |theta: f64, yaw: f64| {
                // The disk's centre in the body, then a pose by which the tool's logged point is where the push is.
                let at = start + (end - start) * draw.uniform(0.2, 0.8) + normal * (RADIUS_M + sd * draw.normal());
                let tool = Rotation2::new(yaw) * Vector2::new(TIP_M[0], TIP_M[1]);
                move |logged: Point2<f64>| {
                    let origin = logged + tool + world - Rotation2::new(theta) * at.coords;
                    Pose { x: origin.x, y: origin.y, theta }
                }
            };
            let (before, after) = (1.3, 1.2);
            let yaw = inward + before;
            let direction = Vector2::new(yaw.cos(), yaw.sin());
            let onset = touch(before, yaw)(Point2::new(0.6, 0.1) - direction * 0.013);
            let last = touch(after, yaw)(Point2::new(0.6, 0.1) + direction * TIP_M[2]);
            let felt = FeltPush {
                origin: Point2::new(0.6, 0.1),
                direction,
                tool_yaw: yaw,
                end: 0.0,
                onset: Onset::At(-0.013),
                forces: Vec::new(),
            };
            made.push(KnownPush { felt, before: onset, after: last });
        }
        made
    }

    #[test]
    fn exact_gaps_tell_the_tip_exactly() {
        let pushes = pushes(60, 0.9, 0.0, Vector2::zeros(), &mut Draw::new(1));
        let found = tip_from_gaps(&outline(), RADIUS_M, &[&pushes]).unwrap();
        for (found, wanted) in [found.ahead, found.left, found.beyond_log].iter().zip(TIP_M) {
            assert!((found.value - wanted).abs() < 1e-9, "{found:?}, wanted {wanted}");
        }
        assert!(found.rms < 1e-9 && found.rms_left_out < 1e-9 && found.rms_uncalibrated > 0.3e-3, "{found:?}");
        assert!(found.gaps > 100, "{found:?}");
    }

    #[test]
    fn noisy_gaps_tell_it_within_what_is_stated() {
        let mut squares = 0.0;
        let cases = 40;
        for case in 0..cases {
            let draw = &mut Draw::case(4, case);
            let frames = Vector2::new(draw.normal(), draw.normal()) * 0.3e-3;
            let (first, second) = (pushes(50, 0.9, 0.3e-3, frames, draw), pushes(50, 0.9, 0.3e-3, -frames, draw));
            let found = tip_from_gaps(&outline(), RADIUS_M, &[&first, &second]).unwrap();
            assert!((found.rms - 0.3e-3).abs() < 0.06e-3 && found.rms_left_out > found.rms, "{found:?}");
            squares += ((found.left.value - TIP_M[1]) / found.left.sd).powi(2);
        }
        // Of 40 squares of a jackknife of ten: 1.2 ± 0.3.
        assert!((0.5..2.2).contains(&(squares / cases as f64)), "{}", squares / cases as f64);
    }

    #[test]
    fn a_push_that_was_knocked_bends_the_others_little() {
        let mut pushes = pushes(60, 0.9, 0.0, Vector2::zeros(), &mut Draw::new(2));
        pushes[7].before.x += 3e-3;
        pushes[30].after.y -= 3e-3;
        let found = tip_from_gaps(&outline(), RADIUS_M, &[&pushes]).unwrap();
        assert!((found.left.value - TIP_M[1]).abs() < 0.05e-3, "{found:?}");
    }

    #[test]
    fn what_cannot_be_told_is_said() {
        let all = pushes(60, 0.9, 0.1e-3, Vector2::zeros(), &mut Draw::new(3));
        let few = tip_from_gaps(&outline(), RADIUS_M, &[&all, &all[..4]]);
        assert_eq!(few, Err(TipGapsError::TooFew { log: 1, gaps: 8 }));
        assert_eq!(tip_from_gaps(&outline(), RADIUS_M, &[]), Err(TipGapsError::NoLog));
        // The way into an edge and the tip's place ahead, always at right angles: to the side is open.
        let straight = pushes(60, 0.0, 0.1e-3, Vector2::zeros(), &mut Draw::new(3));
        let open = tip_from_gaps(&outline(), RADIUS_M, &[&straight]);
        assert!(matches!(open, Err(TipGapsError::Open { .. })), "{open:?}");
    }
}
