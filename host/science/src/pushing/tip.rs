//! Where the disk's centre is on the robot's wrist, from touches on a block whose outline is known.
//!
//! The wrist is brought up to the block until the disk touches one of its faces; the wrist's place and turn are noted.
//! From several touches follows the way from the wrist's point to the disk's centre, in the wrist's axes. Where the wrist
//! was turned between touches, the block's own pose may be found with it; with one turn only the two cannot be told
//! apart, and the block's pose must be known.
//!
//! Implements: least squares of the gaps n·(w + R(φ) d − p) − r over the touched faces, unknown d and, where asked for,
//! the block's place and turn, by [`math::least_squares`](crate::math::least_squares). Standard deviations follow from
//! what the touches leave, or from what one is stated to be off by if that is more.
//!
//! Assumes: a light touch, so that nothing bends; faces that the disk meets beside their corners. Frames: robot, wrist,
//! and the block's own. Units: m, rad. Errors: [`TipError`].

use nalgebra::{DMatrix, Isometry2, Point2, Rotation2, SVector, UnitComplex, Vector2};

use crate::geometry::SimplePolygon;
use crate::math::least_squares::{LeastSquaresProblem, LeastSquaresSettings, NormalEquations, minimise};

/// Unknowns: d (m), the block's place (m) and turn (rad).
const UNKNOWNS: usize = 5;

/// The first of the block's among them.
const BLOCK: usize = 2;

/// A direction in which the touches say less than this share of what they say most does not come out at all.
const RANK_SHARE: f64 = 1e-6;

/// One touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The wrist's point, robot frame, m.
    pub wrist: Point2<f64>,
    /// Turn of the wrist's axes in the robot's, rad.
    pub turn: f64,
    /// The face of the block that was touched: from this vertex to the next.
    pub face: usize,
}

/// A block, a disk, and what is known of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Its outline.
    pub outline: SimplePolygon,
    /// Its pose in the robot's frame.
    pub pose: Isometry2<f64>,
    /// Whether that is to be found too, from near there.
    pub is_sought: bool,
    /// Radius of the disk, m.
    pub radius: f64,
    /// What one touch is off by, standard deviation, m.
    pub touch_sd: f64,
}

/// Where the disk is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TipFit {
    /// From the wrist's point to the disk's centre, wrist axes, m.
    pub offset: Vector2<f64>,
    /// Standard deviation of either component, m.
    pub sd: Vector2<f64>,
    /// What the touches leave, rms, m.
    pub rms: f64,
    /// How many there were.
    pub touches: usize,
    /// The block's pose, as found or as known.
    pub block: Isometry2<f64>,
}

/// Why touches say nothing.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TipError {
    /// A face that the block does not have.
    #[error("touch {touch} is on face {face}, but the block has {faces}, counted from 0")]
    Face {
        /// Its place in the list, from 0.
        touch: usize,
        /// As given.
        face: usize,
        /// How many there are.
        faces: usize,
    },
    /// Too few touches, or too much alike.
    #[error(
        "{touches} touches leave {unknowns} unknowns open: touch two faces that are not parallel; to find the block too, \
         touch it at three turns of the wrist, each on faces a quarter turn apart"
    )]
    Underdetermined {
        /// How many there were.
        touches: usize,
        /// What is to be found.
        unknowns: usize,
    },
}

/// The way from the wrist's point to the disk's centre.
///
/// ```
/// use nalgebra::{Isometry2, Point2};
/// use palpate::SimplePolygon;
/// use palpate::pushing::tip::{Block, Touch, locate};
///
/// // A block of 40 mm at the origin; the disk of 15 mm is 5 mm before the wrist's point, and 2 mm aside.
/// let outline = SimplePolygon::new([[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]].map(Point2::from))?;
/// let block = Block { outline, pose: Isometry2::identity(), is_sought: false, radius: 0.015, touch_sd: 2e-5 };
/// let touch = |x: f64, y: f64, face| Touch { wrist: Point2::new(x, y), turn: 0.0, face };
/// // Face 1 looks along x, face 2 along y.
/// let touches = [touch(0.03, 0.0, 1), touch(0.03, 0.01, 1), touch(0.0, 0.033, 2), touch(0.005, 0.033, 2)];
/// let found = locate(&block, &touches)?;
/// assert!((found.offset.x - 0.005).abs() < 1e-9 && (found.offset.y - 0.002).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`TipError`].
pub fn locate(block: &Block, touches: &[Touch]) -> Result<TipFit, TipError> {
    let faces = block.outline.vertices().len();
    if let Some((touch, &Touch { face, .. })) = touches.iter().enumerate().find(|(_, touch)| touch.face >= faces) {
        return Err(TipError::Face { touch, face, faces });
    }
    let problem = Gaps { block, touches };
    let unknowns = if block.is_sought { UNKNOWNS } else { BLOCK };
    let open = TipError::Underdetermined { touches: touches.len(), unknowns };
    if touches.len() < unknowns {
        return Err(open);
    }
    let found = minimise(&problem, SVector::zeros(), &LeastSquaresSettings::default(), |_| false).place;
    let equations = problem.normal_equations(&found);
    let curvature = equations.curvature.view((0, 0), (unknowns, unknowns)).into_owned();
    let inverse = inverse(&curvature, &problem.scales()[..unknowns]).ok_or(open)?;
    let left = equations.cost / ((touches.len() - unknowns).max(1)) as f64;
    let variance = left.max(block.touch_sd.powi(2));
    let sd = |n: usize| (variance * inverse[(n, n)]).max(0.0).sqrt();
    Ok(TipFit {
        offset: Vector2::new(found[0], found[1]),
        sd: Vector2::new(sd(0), sd(1)),
        rms: (equations.cost / touches.len() as f64).sqrt(),
        touches: touches.len(),
        block: problem.pose(&found),
    })
}

/// The inverse of a curvature whose unknowns are of these sizes; none where it is singular.
fn inverse(curvature: &DMatrix<f64>, scales: &[f64]) -> Option<DMatrix<f64>> {
    let scaled = DMatrix::from_fn(scales.len(), scales.len(), |i, j| curvature[(i, j)] * scales[i] * scales[j]);
    let eigenvalues = scaled.symmetric_eigenvalues();
    if eigenvalues.min() <= RANK_SHARE * eigenvalues.max() {
        return None;
    }
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(scales.len(), scales.len(), |i, j| inverse[(i, j)] * scales[i] * scales[j]))
}

type Unknowns = SVector<f64, UNKNOWNS>;

/// How far the disk would be from the faces that it touched.
struct Gaps<'a> {
    block: &'a Block,
    touches: &'a [Touch],
}

impl Gaps<'_> {
    /// Sizes of the unknowns: turns count at the block's own size.
    fn scales(&self) -> [f64; UNKNOWNS] {
        let vertices = self.block.outline.vertices();
        let size = vertices.iter().map(|vertex| (vertex - vertices[0]).norm()).fold(0.0, f64::max);
        [1.0, 1.0, 1.0, 1.0, 1.0 / size]
    }

    fn pose(&self, at: &Unknowns) -> Isometry2<f64> {
        let Isometry2 { rotation, translation } = self.block.pose;
        let shift = translation.vector + Vector2::new(at[2], at[3]);
        Isometry2::from_parts(shift.into(), rotation * UnitComplex::new(at[4]))
    }

    /// The gap of a touch, m, and how it changes with the unknowns.
    fn gap(&self, touch: &Touch, at: &Unknowns) -> (f64, Unknowns) {
        let vertices = self.block.outline.vertices();
        let (from, to) = (vertices[touch.face], vertices[(touch.face + 1) % vertices.len()]);
        let pose = self.pose(at);
        let way = (pose * (to - from)).normalize();
        // Outwards of an outline that runs counter-clockwise.
        let normal = Vector2::new(way.y, -way.x);
        let turn = Rotation2::new(touch.turn);
        let centre = touch.wrist + turn * Vector2::new(at[0], at[1]);
        let from = pose * from;
        let by_offset = turn.inverse() * normal;
        // As the block turns about its frame's origin, both the face's point and its normal do.
        let about = centre - Point2::from(pose.translation.vector);
        let by_turn = normal.perp(&about);
        let slopes = [by_offset.x, by_offset.y, -normal.x, -normal.y, by_turn];
        (normal.dot(&(centre - from)) - self.block.radius, Unknowns::from(slopes))
    }
}

impl LeastSquaresProblem<UNKNOWNS> for Gaps<'_> {
    type Place = Unknowns;

    fn cost(&self, at: &Unknowns) -> f64 {
        self.touches.iter().map(|touch| self.gap(touch, at).0.powi(2)).sum()
    }

    fn normal_equations(&self, at: &Unknowns) -> NormalEquations<UNKNOWNS> {
        let mut equations = NormalEquations::zero();
        for (gap, slopes) in self.touches.iter().map(|touch| self.gap(touch, at)) {
            equations.add(gap, slopes);
        }
        equations
    }

    fn moved(&self, at: &Unknowns, step: &Unknowns) -> Option<Unknowns> {
        Some(at + step)
    }

    fn held(&self, _: &Unknowns, _: &NormalEquations<UNKNOWNS>) -> [bool; UNKNOWNS] {
        std::array::from_fn(|n| n >= BLOCK && !self.block.is_sought)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Draw;

    const OFFSET: Vector2<f64> = Vector2::new(0.012, -0.034);
    const RADIUS_M: f64 = 0.015;
    const SD_M: f64 = 2e-5;

    fn outline() -> SimplePolygon {
        SimplePolygon::new([[0.0, 0.0], [0.05, 0.0], [0.05, 0.03], [0.0, 0.03]].map(Point2::from)).unwrap()
    }

    /// Touches at these turns on all four faces of a block in a pose, off by this much.
    fn touches(pose: Isometry2<f64>, turns: &[f64], sd: f64, draw: &mut Draw) -> Vec<Touch> {
        let outline = outline();
        let vertices = outline.vertices();
        let mut made = Vec::new();
        for &turn in turns {
            for face in 0..4 {
                let (from, to) = (vertices[face], vertices[(face + 1) % 4]);
                let way = (to - from).normalize();
                let gap = RADIUS_M + sd * draw.normal();
                let centre = from + (to - from) * draw.uniform(0.2, 0.8) + Vector2::new(way.y, -way.x) * gap;
                made.push(Touch { wrist: pose * centre - Rotation2::new(turn) * OFFSET, turn, face });
            }
        }
        made
    }

    fn block(pose: Isometry2<f64>, is_sought: bool) -> Block {
        Block { outline: outline(), pose, is_sought, radius: RADIUS_M, touch_sd: SD_M }
    }

    #[test]
    fn tip_and_block_are_found_together_within_what_is_stated() {
        let pose = Isometry2::new(Vector2::new(0.3, 0.1), 0.4);
        let told = Isometry2::new(Vector2::new(0.303, 0.098), 0.43);
        let mut squares = 0.0;
        for case in 0..50 {
            let mut draw = Draw::case(1, case);
            let touches = touches(pose, &[0.0, 1.0, 2.5], SD_M, &mut draw);
            let found = locate(&block(told, true), &touches).unwrap();
            let off = (found.offset - OFFSET).component_div(&found.sd);
            assert!(off.amax() < 5.0, "{case}: {found:?}");
            squares += off.norm_squared();
            assert!((found.block.rotation.angle() - 0.4).abs() < 5e-3, "{case}: {found:?}");
        }
        // 100 squares: 1 ± 0.14. What is left is at least what was stated, which makes them smaller.
        assert!((0.4..1.4).contains(&(squares / 100.0)), "{}", squares / 100.0);
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let mut draw = Draw::case(2, 0);
        let pose = Isometry2::new(Vector2::new(0.3, 0.1), 0.4);
        let block = block(pose, true);
        let gaps = Gaps { block: &block, touches: &[] };
        let at = Unknowns::from([0.01, -0.03, 1e-3, 2e-3, 0.05]);
        for touch in touches(pose, &[0.7], SD_M, &mut draw) {
            let (_, slopes) = gaps.gap(&touch, &at);
            for n in 0..UNKNOWNS {
                let step = Unknowns::from_fn(|i, _| if i == n { 1e-6 } else { 0.0 });
                let difference = (gaps.gap(&touch, &(at + step)).0 - gaps.gap(&touch, &(at - step)).0) / 2e-6;
                assert!((difference - slopes[n]).abs() < 1e-7, "unknown {n}: {difference} {}", slopes[n]);
            }
        }
    }

    #[test]
    fn touches_that_say_too_little_are_refused() {
        let mut draw = Draw::case(3, 0);
        let pose = Isometry2::identity();
        let all = touches(pose, &[0.0], 0.0, &mut draw);
        // Parallel faces.
        let along = [all[0], all[2], all[0]];
        assert!(matches!(locate(&block(pose, false), &along), Err(TipError::Underdetermined { .. })));
        // One turn of the wrist: tip and block cannot be told apart.
        let one_turn = touches(pose, &[0.0, 0.0], 0.0, &mut draw);
        assert!(matches!(locate(&block(pose, true), &one_turn), Err(TipError::Underdetermined { .. })));
        assert!(locate(&block(pose, false), &one_turn).is_ok());
        let wrong = [Touch { face: 9, ..all[0] }];
        assert!(matches!(locate(&block(pose, false), &wrong), Err(TipError::Face { face: 9, faces: 4, .. })));
    }
}
