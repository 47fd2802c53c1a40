//! Which turns leave a body as it is, in shape and in inertia.
//!
//! A contact path cannot tell attitudes apart that differ by such a turn, so estimates of attitude count modulo them.
//! Reflections do not count: a body cannot be turned into its mirror image.
//!
//! Frames: the body's; a turn `g` acts as `A → A g`. Units: rad. Errors: none.

use std::f64::consts::FRAC_1_SQRT_2;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::shape::{Egg, RoundedShape};

/// Semi-axes and moments of inertia count as equal within this, relative: rounding of the input.
const EQUAL: f64 = 1e-9;

/// The group of turns that leave a body as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Symmetry {
    /// None but standing still.
    C1,
    /// Half turns about one body axis (0, 1 or 2).
    C2(usize),
    /// Half turns about all three body axes.
    D2,
    /// Quarter turns about one body axis, half turns about the others.
    D4(usize),
    /// All turns of a cube.
    O,
    /// Any turn about one body axis.
    Revolution {
        /// 0, 1 or 2.
        axis: usize,
        /// Whether half turns across the axis belong to it too: a spheroid, not an egg.
        both_ways: bool,
    },
    /// All turns about the centre of mass.
    Sphere,
}

/// The groups by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SymmetryName {
    /// No turn but that by 0.
    C1,
    /// One axis of half turns.
    C2,
    /// Three axes of half turns.
    D2,
    /// One axis of quarter turns, four of half turns.
    D4,
    /// The turns of a cube.
    O,
    /// A body of revolution.
    Revolution,
    /// All turns: a sphere.
    Sphere,
}

impl Symmetry {
    /// Of a uniform ellipsoid.
    #[must_use]
    pub(super) fn of_ellipsoid(semi_axes: &[f64; 3]) -> Self {
        match odd_one(semi_axes) {
            OddOne::None => Self::Sphere,
            OddOne::Axis(axis) => Self::Revolution { axis, both_ways: true },
            OddOne::All => Self::D2,
        }
    }

    /// Of an egg with these moments of inertia.
    #[must_use]
    pub(super) fn of_egg(egg: &Egg, inertia: &Vector3<f64>) -> Self {
        let (shape, mass) = (odd_one(&egg.semi_axes), odd_one(&(*inertia).into()));
        let around_z = |odd| odd == OddOne::None || odd == OddOne::Axis(2);
        let is_egg = egg.skew.abs().max(egg.origin.abs()) > EQUAL * egg.semi_axes[2];
        match is_egg {
            true if around_z(shape) && around_z(mass) => Self::Revolution { axis: 2, both_ways: false },
            true => Self::C2(2),
            false => Self::smooth(shape.with(mass)),
        }
    }

    /// Of a rounded body with these moments of inertia.
    #[must_use]
    pub(super) fn of_rounded(rounded: &RoundedShape, inertia: &Vector3<f64>) -> Self {
        match odd_one(&rounded.semi_axes).with(odd_one(&(*inertia).into())) {
            OddOne::None => Self::O,
            OddOne::Axis(axis) => Self::D4(axis),
            OddOne::All => Self::D2,
        }
    }

    fn smooth(odd: OddOne) -> Self {
        match odd {
            OddOne::None => Self::Sphere,
            OddOne::Axis(axis) => Self::Revolution { axis, both_ways: true },
            OddOne::All => Self::D2,
        }
    }

    /// The name without the axis.
    #[must_use]
    pub fn kind(self) -> SymmetryName {
        match self {
            Self::C1 => SymmetryName::C1,
            Self::C2(_) => SymmetryName::C2,
            Self::D2 => SymmetryName::D2,
            Self::D4(_) => SymmetryName::D4,
            Self::O => SymmetryName::O,
            Self::Revolution { .. } => SymmetryName::Revolution,
            Self::Sphere => SymmetryName::Sphere,
        }
    }

    /// The name in a word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::C1 => "C1",
            Self::C2(_) => "C2",
            Self::D2 => "D2",
            Self::D4(_) => "D4",
            Self::O => "O",
            Self::Revolution { .. } => "revolution",
            Self::Sphere => "sphere",
        }
    }

    /// How many turns, standing still included; `None` for a continuum.
    #[must_use]
    pub fn order(self) -> Option<usize> {
        match self {
            Self::C1 => Some(1),
            Self::C2(_) => Some(2),
            Self::D2 => Some(4),
            Self::D4(_) => Some(8),
            Self::O => Some(24),
            Self::Revolution { .. } | Self::Sphere => None,
        }
    }

    /// The turns of a finite group; those of a continuum that keep its axis or turn it over.
    #[must_use]
    pub fn turns(self) -> Vec<UnitQuaternion<f64>> {
        let half = |axis: usize| turn(0.0, Vector3::ith(axis, 1.0));
        let still = UnitQuaternion::identity();
        match self {
            Self::C1 | Self::Sphere => vec![still],
            Self::C2(axis) => vec![still, half(axis)],
            Self::D2 => vec![still, half(0), half(1), half(2)],
            Self::D4(axis) => {
                let quarter = |sign: f64| turn(FRAC_1_SQRT_2, Vector3::ith(axis, sign * FRAC_1_SQRT_2));
                let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
                let diagonal =
                    |sign: f64| turn(0.0, Vector3::ith(next, FRAC_1_SQRT_2) + Vector3::ith(last, sign * FRAC_1_SQRT_2));
                vec![still, half(0), half(1), half(2), quarter(1.0), quarter(-1.0), diagonal(1.0), diagonal(-1.0)]
            }
            Self::O => {
                let quarters = [Self::D4(0), Self::D4(1), Self::D4(2)].into_iter().flat_map(Self::turns);
                let thirds = [1.0, -1.0].into_iter().flat_map(|x| {
                    [1.0, -1.0]
                        .into_iter()
                        .flat_map(move |y| [1.0, -1.0].map(move |z| turn(0.5, Vector3::new(0.5 * x, 0.5 * y, 0.5 * z))))
                });
                let mut all: Vec<UnitQuaternion<f64>> = Vec::new();
                for turn in quarters.chain(thirds) {
                    if all.iter().all(|known| known.angle_to(&turn) > 0.1) {
                        all.push(turn);
                    }
                }
                all
            }
            Self::Revolution { both_ways: false, .. } => vec![still],
            Self::Revolution { axis, both_ways: true } => vec![still, half((axis + 1) % 3)],
        }
    }

    /// The angle between two attitudes, rad, at the best of the turns that cannot be seen.
    ///
    /// For a body of revolution that is the angle between its axes, for a sphere 0.
    #[must_use]
    pub fn angle(self, a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
        self.turns().iter().map(|turn| self.plain_angle(a, &(b * turn))).fold(f64::INFINITY, f64::min)
    }

    /// `b` turned by the turn of the group that brings it nearest to `a`.
    #[must_use]
    pub fn nearest(self, a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let closer = |x: &UnitQuaternion<f64>, y: &UnitQuaternion<f64>| {
            self.plain_angle(a, x).total_cmp(&self.plain_angle(a, y))
        };
        let discrete = self.turns().into_iter().map(|turn| b * turn).min_by(closer).unwrap_or(*b);
        match self {
            Self::Sphere => *a,
            Self::Revolution { axis, .. } => {
                let axis = Vector3::ith_axis(axis);
                let across = a.inverse() * discrete;
                // The turn about the axis that undoes most of the difference.
                let about = across.imag().dot(&axis).atan2(across.w) * 2.0;
                discrete * UnitQuaternion::from_axis_angle(&axis, -about)
            }
            _ => discrete,
        }
    }

    fn plain_angle(self, a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
        match self {
            Self::Sphere => 0.0,
            Self::Revolution { axis, .. } => {
                let axis = Vector3::ith(axis, 1.0);
                let (x, y) = (a * axis, b * axis);
                x.cross(&y).norm().atan2(x.dot(&y))
            }
            _ => a.angle_to(b),
        }
    }
}

fn turn(cos: f64, axis: Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::from_parts(cos, axis))
}

/// Which of three numbers is unlike the other two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OddOne {
    /// All three are equal.
    None,
    /// The number of this axis differs.
    Axis(usize),
    /// All three are different.
    All,
}

impl OddOne {
    /// What two descriptions of the same axes have in common.
    fn with(self, other: Self) -> Self {
        match (self, other) {
            (Self::None, odd) | (odd, Self::None) => odd,
            (Self::Axis(a), Self::Axis(b)) if a == b => Self::Axis(a),
            _ => Self::All,
        }
    }
}

fn odd_one(values: &[f64; 3]) -> OddOne {
    let equal = |i: usize, j: usize| (values[i] - values[j]).abs() <= EQUAL * values[i].abs().max(values[j].abs());
    match [equal(1, 2), equal(2, 0), equal(0, 1)] {
        [true, true, _] | [true, _, true] | [_, true, true] => OddOne::None,
        [true, false, false] => OddOne::Axis(0),
        [false, true, false] => OddOne::Axis(1),
        [false, false, true] => OddOne::Axis(2),
        [false, false, false] => OddOne::All,
    }
}

#[cfg(test)]
mod tests {
    use super::super::body::{RollingBody, normals};
    use super::*;

    const EXACT: f64 = 1e-12;

    fn bodies() -> Vec<(RollingBody, &'static str, Option<usize>)> {
        let egg = |semi_axes, skew| Egg { semi_axes, skew, origin: 0.0 };
        let rounded = |semi_axes| RoundedShape { semi_axes, radius: 0.012 };
        let (thin, fat, none) = (Some([4e-4, 4e-4, 3e-4]), Some([4e-4, 4e-4, 4e-4]), Some([5e-4, 4e-4, 3e-4]));
        vec![
            (RollingBody::ellipsoid([0.02, 0.03, 0.04]).unwrap(), "D2", Some(4)),
            (RollingBody::ellipsoid([0.04, 0.02, 0.04]).unwrap(), "revolution", None),
            (RollingBody::ellipsoid([0.03; 3]).unwrap(), "sphere", None),
            (RollingBody::egg(egg([0.02, 0.03, 0.04], 0.003), none).unwrap(), "C2", Some(2)),
            (RollingBody::egg(egg([0.03, 0.03, 0.04], 0.003), thin).unwrap(), "revolution", None),
            (RollingBody::egg(egg([0.03, 0.03, 0.04], 0.003), none).unwrap(), "C2", Some(2)),
            (RollingBody::egg(egg([0.03; 3], 0.0), none).unwrap(), "D2", Some(4)),
            (RollingBody::rounded(rounded([0.02, 0.03, 0.025]), None).unwrap(), "D2", Some(4)),
            (RollingBody::rounded(rounded([0.02, 0.02, 0.025]), None).unwrap(), "D4", Some(8)),
            (RollingBody::rounded(rounded([0.02; 3]), fat).unwrap(), "O", Some(24)),
            (RollingBody::rounded(rounded([0.02; 3]), none).unwrap(), "D2", Some(4)),
        ]
    }

    #[test]
    fn every_turn_of_a_group_leaves_the_body_as_it_is() {
        for (body, name, order) in bodies() {
            let symmetry = body.symmetry();
            assert_eq!((symmetry.name(), symmetry.order()), (name, order), "{body:?}");
            let turns = symmetry.turns();
            assert!(order.is_none_or(|order| order == turns.len()), "{name}: {}", turns.len());
            for turn in turns {
                for normal in normals().step_by(97) {
                    let turned = turn * body.shape().contact(&(turn.inverse() * normal));
                    assert!((turned - body.shape().contact(&normal)).norm() < EXACT, "{name} {turn}");
                }
                let inertia = turn.to_rotation_matrix().matrix()
                    * nalgebra::Matrix3::from_diagonal(&body.inertia())
                    * turn.to_rotation_matrix().matrix().transpose();
                assert!((inertia - nalgebra::Matrix3::from_diagonal(&body.inertia())).norm() < EXACT, "{name}");
            }
        }
    }

    #[test]
    fn attitudes_a_turn_apart_are_one() {
        let a = UnitQuaternion::from_euler_angles(0.3, -1.1, 2.0);
        for (body, name, _) in bodies() {
            let symmetry = body.symmetry();
            for turn in symmetry.turns() {
                assert!(symmetry.angle(&a, &(a * turn)) < 1e-7, "{name}");
                assert!(symmetry.nearest(&a, &(a * turn)).angle_to(&a) < 1e-7, "{name}");
            }
            let b = a * UnitQuaternion::from_euler_angles(0.05, 0.02, -0.03);
            let near = symmetry.nearest(&a, &b);
            assert!((near.angle_to(&a) - symmetry.angle(&a, &b)).abs() < 1e-3, "{name}");
        }
    }
}
