//! What a part may look like: a convex polygon, one with rounded corners, or an ellipse.
//!
//! Frames: world, and the part's own. Units: m, rad.

use nalgebra::{Matrix3, Point2, Rotation2};

use super::boundary::{Boundary, Ellipse, Rounded, boundary_poses};
use super::exact::{Continuum, Inscription, determined, miss_gradient};
use super::mixed::{information, poses_through};
use super::quality::congruent_groups;
use super::readings::HalfPlane;
use crate::geometry::ConvexPolygon;
use crate::geometry::Pose;

/// Directions in which a smooth outline is sampled: half a degree apart.
const SAMPLES: u32 = 720;

/// Samples beside an edge are this near to its normal, rad.
const BESIDE_EDGE: f64 = 1e-7;

/// A convex part, as polygon or smooth shape.
#[derive(Clone, Debug)]
pub enum Outline {
    /// With straight edges and sharp corners.
    Polygon(ConvexPolygon),
    /// With straight edges and round corners.
    Rounded(Rounded),
    /// An ellipse about the frame's origin.
    Ellipse(Ellipse),
}

impl Outline {
    /// All poses in which the part touches every line from its inner side and, if it is a polygon, passes through every
    /// point; points on a smooth outline are not looked at.
    ///
    /// ```
    /// use palpate::inscription::{Ellipse, HalfPlane, Inscription, Outline};
    ///
    /// // Jaws 70 mm apart and a floor: an ellipse of 80 by 60 mm stands askew, four ways.
    /// let ellipse = Outline::Ellipse(Ellipse { a: 0.04, b: 0.03 });
    /// let lines = [(0.0, 0.07), (3.141592653589793, 0.0), (-1.570796326794897, 0.0)];
    /// let lines = lines.map(|(angle, offset)| HalfPlane::new(angle, offset));
    /// let Inscription::Poses(poses) = ellipse.poses(&lines, &[]) else { unreachable!() };
    /// assert_eq!((poses.len(), ellipse.congruent_groups(&poses).len()), (4, 2));
    /// ```
    #[must_use]
    pub fn poses(&self, lines: &[HalfPlane], points: &[Point2<f64>]) -> Inscription {
        let smooth = match self {
            Self::Polygon(part) => return poses_through(part, lines, points),
            Self::Rounded(part) => boundary_poses(part, lines),
            Self::Ellipse(part) => boundary_poses(part, lines),
        };
        match (determined(&self.alike(), lines), smooth) {
            (Err(continuum), _) => Inscription::Underdetermined(continuum),
            (Ok(()), None) => Inscription::Underdetermined(Continuum::Loose),
            (Ok(()), Some(poses)) => Inscription::Poses(poses),
        }
    }

    /// How well lines and points hold a pose: an error e of them moves it by about e over this (x, y, size·θ).
    #[must_use]
    pub fn conditioning(&self, lines: &[HalfPlane], points: &[Point2<f64>], pose: &Pose) -> f64 {
        let information = match self {
            Self::Polygon(part) => information(part, lines, points, pose),
            Self::Rounded(part) => touch_information(part, lines, pose),
            Self::Ellipse(part) => touch_information(part, lines, pose),
        };
        information.symmetric_eigenvalues().min().max(0.0).sqrt()
    }

    /// Poses by their indices, those together in which a symmetric part looks the same.
    #[must_use]
    pub fn congruent_groups(&self, poses: &[Pose]) -> Vec<Vec<usize>> {
        congruent_groups(&self.alike(), poses)
    }

    /// A polygon for pictures: a smooth outline in steps of half a degree.
    #[must_use]
    pub fn sampled(&self) -> ConvexPolygon {
        match self {
            Self::Polygon(part) => part.clone(),
            Self::Rounded(part) => sampled(part).unwrap_or_else(|| part.polygon.clone()),
            Self::Ellipse(part) => sampled(part).unwrap_or_else(|| unreachable!("an ellipse has an area")),
        }
    }

    /// A polygon with the same symmetries and of about the same size.
    fn alike(&self) -> ConvexPolygon {
        match self {
            Self::Polygon(part) | Self::Rounded(Rounded { polygon: part, .. }) => part.clone(),
            Self::Ellipse(_) => self.sampled(),
        }
    }
}

/// JᵀJ of the misses of lines; the part's origin stands for its centre.
fn touch_information(part: &impl Boundary, lines: &[HalfPlane], pose: &Pose) -> Matrix3<f64> {
    let row = |line: &HalfPlane| {
        let arm = Rotation2::new(pose.theta) * part.touch(line.angle - pose.theta);
        miss_gradient(line, arm, part.size())
    };
    lines.iter().map(row).map(|row| row * row.transpose()).sum()
}

fn sampled(part: &impl Boundary) -> Option<ConvexPolygon> {
    let even = (0..SAMPLES).map(|k| std::f64::consts::TAU * f64::from(k) / f64::from(SAMPLES));
    let beside = part.flat().into_iter().flat_map(|edge| [edge - BESIDE_EDGE, edge + BESIDE_EDGE]);
    let points: Vec<_> = even.chain(beside).map(|angle| Point2::from(part.touch(angle))).collect();
    ConvexPolygon::hull_of_points(&points)
}
