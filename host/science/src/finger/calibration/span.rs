//! Whether contacts at these angles can tell the whole matrix, and which angle to add if not.
//!
//! Only directions matter here, so the test runs before any fit and for any finger: to first order the matrix of a
//! balanced finger errs in direction by a rotation and two stretches, `δ(u) ∝ r + s sin 2u + c cos 2u`. From the
//! normal matrix of the contacts in these three (the size of the matrix eliminated) follows how uncertain the
//! direction of a later contact at any angle is, in units of the uncertainty of a single calibration contact.
//! Sixteen contacts all round give √(3/16) = 0.43; contacts on one line through the centre give infinity elsewhere.
//!
//! Assumes: equal noise in every contact, a finger near a balanced one. Frames: finger. Units: rad. Errors: none.

use nalgebra::{Matrix2x4, Matrix3, Matrix4, RowVector4, Vector2, Vector3, Vector4};

use super::measurements::Load;
use crate::math::angle::push_direction;

/// Largest uncertainty of a later contact angle, in uncertainties of one calibration contact, that is accepted.
///
/// Contacts spread all round stay below 1 from three on. Above 2 the weakest direction rests on small differences
/// between contacts, so one angle set wrong by 0.1° turns what is felt there by more than the bar of 0.2°.
pub const SPAN_MAX: f64 = 2.0;

/// What is aimed at when angles to add are named: as good as a single contact in the worst direction.
const SPAN_AIM: f64 = 1.0;

/// Beyond this the uncertainty is reported as infinite; far above any accepted value, far below what rounding makes.
const SPAN_ENDLESS: f64 = 1e3;

/// Added to the normal matrix so that data of one line invert; worth a contact in a million.
const REGULARISATION: f64 = 1e-6 * 1e-3;

/// Angles tried as the worst one and as ones to add, in degrees; a step finer would be lost in the fixture.
const GRID_DEG: u32 = 5;

/// Directions nearer to each other than this count as one, rad (2°): a line, for loads pulling either way.
const SAME_LINE: f64 = 2.0 * std::f64::consts::PI / 180.0;

/// At most this many angles are proposed.
const PROPOSALS_MAX: usize = 6;

/// What the angles of a set of contacts allow.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    /// Uncertainty of a later contact angle in the worst direction, over that of one contact; may be infinite.
    pub worst: f64,
    /// Contact angle at which it is worst, rad in [0, π).
    pub worst_angle: f64,
    /// Different lines through the disk's centre along which the contacts push.
    pub lines: usize,
}

impl Span {
    /// Whether a matrix can be fitted to such contacts.
    #[must_use]
    pub fn is_enough(&self) -> bool {
        self.worst <= SPAN_MAX
    }
}

/// Judges contacts by their angles (rad) and what is known of their loads.
#[must_use]
pub fn span(contacts: &[(f64, Load)]) -> Span {
    let (worst, worst_angle) = worst_direction(&shape_information(contacts));
    let worst = if worst > SPAN_ENDLESS { f64::INFINITY } else { worst };
    Span { worst, worst_angle, lines: count_lines(contacts) }
}

/// Angles, rad in [0, π), whose addition spans both axes well; the worst direction first, empty if nothing is missing.
#[must_use]
pub fn angles_to_add(contacts: &[(f64, Load)]) -> Vec<f64> {
    // Of unknown load even where others are known: whoever measures less must be told enough angles.
    let mut contacts = contacts.to_vec();
    let mut added = Vec::new();
    while added.len() < PROPOSALS_MAX {
        let (worst, angle) = worst_direction(&shape_information(&contacts));
        if worst <= SPAN_AIM {
            break;
        }
        contacts.push((angle, Load::Unknown));
        added.push(angle);
    }
    added
}

/// Standard deviation and angle of the worst direction, in units of one contact's.
fn worst_direction(information: &Matrix3<f64>) -> (f64, f64) {
    let regular = information + Matrix3::identity() * REGULARISATION;
    let Some(covariance) = regular.try_inverse() else { return (f64::INFINITY, 0.0) };
    let uncertainty = |angle: f64| {
        let shape = shape_of_direction(angle);
        shape.dot(&(covariance * shape)).max(0.0).sqrt()
    };
    let grid = (0..180).step_by(GRID_DEG as usize).map(|degrees: u32| f64::from(degrees).to_radians());
    grid.map(|angle| (uncertainty(angle), angle))
        .fold((0.0, 0.0), |best, next| if next.0 > best.0 { next } else { best })
}

/// How the direction at contact angle `u` depends on rotation and the two stretches (an orthonormal basis).
fn shape_of_direction(angle: f64) -> Vector3<f64> {
    let (sin, cos) = (2.0 * angle).sin_cos();
    Vector3::new(1.0, sin, cos) * std::f64::consts::FRAC_1_SQRT_2
}

/// Information on rotation and the two stretches, with the matrix's size and a shared unknown load eliminated.
fn shape_information(contacts: &[(f64, Load)]) -> Matrix3<f64> {
    let full = matrix_information(contacts);
    let basis = [[1.0, 0.0, 0.0, 1.0], [0.0, -1.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 1.0, 0.0]];
    let to_shape = Matrix4::from_rows(&basis.map(|row| RowVector4::from(row) * std::f64::consts::FRAC_1_SQRT_2));
    let turned = to_shape * full * to_shape.transpose();
    let shape = turned.fixed_view::<3, 3>(1, 1).into_owned();
    let with_size = turned.fixed_view::<3, 1>(1, 0).into_owned();
    // A semidefinite matrix has zeros beside a zero on its diagonal, so nothing is to be eliminated then.
    if turned[(0, 0)] > REGULARISATION { shape - with_size * with_size.transpose() / turned[(0, 0)] } else { shape }
}

/// Normal matrix of `[b11, b12, b21, b22]` at the balanced finger `B = 1`, unit loads, unit noise.
fn matrix_information(contacts: &[(f64, Load)]) -> Matrix4<f64> {
    let mut information = Matrix4::zeros();
    let (mut with_shared_load, mut shared) = (Vector4::zeros(), 0.0);
    for &(angle, load) in contacts {
        let force = push_direction(angle);
        let jacobian = Matrix2x4::new(force.x, force.y, 0.0, 0.0, 0.0, 0.0, force.x, force.y);
        let across = Vector2::new(-force.y, force.x);
        information += match load {
            // Its own unknown size leaves only the component across the force.
            Load::Unknown => jacobian.transpose() * across * across.transpose() * jacobian,
            Load::Same | Load::Newtons(_) => jacobian.transpose() * jacobian,
        };
        if load == Load::Same {
            with_shared_load += jacobian.transpose() * force;
            shared += 1.0;
        }
    }
    if shared > 0.0 {
        information -= with_shared_load * with_shared_load.transpose() / shared;
    }
    information
}

/// Number of directions, opposite ones counted once, that differ by more than [`SAME_LINE`].
fn count_lines(contacts: &[(f64, Load)]) -> usize {
    let half_turn = std::f64::consts::PI;
    let mut lines: Vec<f64> = Vec::new();
    for (angle, _) in contacts {
        let line = angle.rem_euclid(half_turn);
        let apart = |other: &f64| (line - other).abs().min(half_turn - (line - other).abs());
        if lines.iter().all(|other| apart(other) > SAME_LINE) {
            lines.push(line);
        }
    }
    lines.len()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn at(load: Load, degrees: &[f64]) -> Vec<(f64, Load)> {
        degrees.iter().map(|&angle| (f64::to_radians(angle), load)).collect()
    }

    #[test]
    fn contacts_on_a_line_through_the_centre_do_not_span() {
        for load in [Load::Unknown, Load::Same, Load::Newtons(2.0)] {
            let span = span(&at(load, &[30.0, 210.0, 30.0, 210.0]));
            assert!(span.worst.is_infinite() && span.lines == 1, "{load:?}: {span:?}");
        }
    }

    #[test]
    fn two_square_axes_span_only_with_comparable_loads() {
        let axes = [0.0, 90.0, 180.0, 270.0];
        assert!(span(&at(Load::Newtons(2.0), &axes)).is_enough());
        assert!(span(&at(Load::Same, &axes)).is_enough());
        // Each axis may have any gain if no load is known: nothing says what 45° looks like.
        let unknown = span(&at(Load::Unknown, &axes));
        assert!(unknown.worst.is_infinite(), "{unknown:?}");
        assert!(
            (unknown.worst_angle.to_degrees() - 45.0).abs() < 1e-9
                || (unknown.worst_angle.to_degrees() - 135.0).abs() < 1e-9
        );
    }

    #[test]
    fn even_contacts_of_unknown_load_reach_the_closed_form() {
        for count in 3..20_u32 {
            let angles: Vec<f64> = (0..count).map(|k| 180.0 * f64::from(k) / f64::from(count)).collect();
            let (got, wanted) = (span(&at(Load::Unknown, &angles)).worst, (3.0 / f64::from(count)).sqrt());
            assert!((got - wanted).abs() < 1e-6, "{count} contacts: got {got}, wanted {wanted}");
        }
    }

    proptest! {
        #[test]
        fn what_is_proposed_is_enough(start in 0.0..360.0_f64, spread in 0.0..20.0_f64, count in 1..6_u32) {
            let angles: Vec<f64> = (0..count).map(|k| start + spread * f64::from(k) / f64::from(count)).collect();
            for load in [Load::Unknown, Load::Same, Load::Newtons(1.0)] {
                let mut contacts = at(load, &angles);
                let added = angles_to_add(&contacts);
                contacts.extend(added.iter().map(|&angle| (angle, Load::Unknown)));
                let after = span(&contacts);
                prop_assert!(after.is_enough(), "added {added:?}: {after:?}");
            }
        }

        #[test]
        fn turning_by_the_grid_turns_the_answer(steps in 0..36_u32, spread in 3.0..60.0_f64) {
            let angles = [0.0, spread, 2.0 * spread];
            let turned = angles.map(|angle| angle + f64::from(steps * GRID_DEG));
            let (before, after) = (span(&at(Load::Unknown, &angles)), span(&at(Load::Unknown, &turned)));
            prop_assert!((before.worst / after.worst - 1.0).abs() < 1e-6, "{before:?} {after:?}");
        }
    }
}
