//! Whether the path of the contact tells the state of a rolling body, to first order over a short window.
//!
//! The rank is that of the sensitivities of `u(t)` over a window: the same as that of the differentials of `u` and all
//! its Lie derivatives, without differentiating noise-free data many times. Beside it stands the thesis's sufficient
//! condition, with its terms: where it fails although the state is observable, it is only sufficient.
//!
//! Implements: thesis §7.2 as a numeric test; Theorem 32 with (7.28), (7.29), (7.32)–(7.34). For a contact without spin
//! the condition (7.33) reads h(n) > 0 and always holds.
//! Assumes: the contact lasts, whatever the force.
//! Frames: changes of attitude about body axes, of angular velocity in palm axes. Units: changes relative to rad, the
//! body's size L and √(g/L).
//! Errors: none.

use nalgebra::{DMatrix, Matrix2, Matrix3, SymmetricEigen, Vector3};

use super::flow::{Columns, STATE_COLUMNS, StateWithTangent};
use super::mechanics::{ContactPointInertia, Model, RollState, Spin};
use crate::math::Spectrum;

/// Length of the window, in units of √(L/g): about 0.2 s for 3 cm.
const WINDOW: f64 = 4.0;

/// Contacts in the window, and Runge–Kutta steps from one to the next, for a body that turns by at most
/// [`TURN_OF_STEPS`].
const CONTACTS: u32 = 80;
const STEPS: u32 = 10;

/// What a body may turn by in √(L/g) for each [`STEPS`] steps, rad: a tenth of a radian a step.
const TURN_OF_STEPS: f64 = 20.0;

/// The most that a body may turn by in √(L/g), rad: some 30,000 rad/s for 3 cm. More could not be followed in a
/// fraction of a second.
pub const TURN_MAX: f64 = 2000.0;

/// Sine of the angle between contact vector and normal below which they count as parallel.
const PARALLEL: f64 = 1e-9;

/// Relative difference of the radii of curvature below which the principal directions are anybody's (an umbilic).
const UMBILIC: f64 = 1e-9;

/// Terms below this, relative to what they are made of, count as 0 in the sufficient condition.
const TERM_THRESHOLD: f64 = 1e-9;

/// How the palm moves while it feels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inputs {
    /// No acceleration.
    Zero,
    /// Up and down alone.
    Vertical,
    /// In all directions, with unrelated frequencies.
    Generic,
}

/// The names of the components of a change of state, in order.
pub const STATE_NAMES: [&str; 8] =
    ["u1", "u2", "rotation_x", "rotation_y", "rotation_z", "omega_palm_x", "omega_palm_y", "omega_palm_z"];

/// What the contact path tells.
#[derive(Clone, Debug, PartialEq)]
pub struct RollObservability {
    /// Rank and unseen directions, in the order of [`STATE_NAMES`]; without spin the last is missing.
    pub spectrum: Spectrum,
    /// Theorem 32 with its terms.
    pub sufficient_condition: SufficientCondition,
}

/// The thesis's sufficient condition with its terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SufficientCondition {
    /// Whether all that it demands holds.
    pub holds: bool,
    /// `det(b₁, b₂, β)` over L³ (7.32), made of lengths divided by L; `None` at an umbilic, where b₁ and b₂ depend on
    /// the choice of principal directions.
    pub determinant: Option<f64>,
    /// `β·(I z)` over m L³ (7.33), or `h(n)` over L without spin.
    pub contact_and_inertia: f64,
    /// `|β × z|` over L: where it is 0, (7.34) is asked instead of (7.33).
    pub contact_across_normal: f64,
    /// `κ₁ xᵀD⁻¹x − κ₂ yᵀD⁻¹y`, times L³ (7.34).
    pub curvature_and_mobility: f64,
    /// `xᵀD⁻¹y`, times L² (7.34).
    pub mobility_across: f64,
}

/// Why the motion that starts at a state could not be followed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CannotFollow {
    /// The body turns too fast.
    #[error(
        "the body turns by {turn:e} rad in the time √(size/g), the limit is {TURN_MAX}: check the unit of omega, rad/s"
    )]
    TurnsTooFast {
        /// Turn in the time √(L/g), rad.
        turn: f64,
    },
    /// The contact rushes over edges that are too sharp for the steps.
    #[error(
        "the contact rushes over an edge with a radius of curvature of {radius:.1e} of the body's size, too fast to be followed: \
         give a rounder body"
    )]
    TooSharp {
        /// The body's least radius of curvature, over its size.
        radius: f64,
    },
}

/// The rank test and the thesis's condition at one state.
///
/// # Errors
/// [`CannotFollow`].
pub fn observability(
    model: &Model,
    state: &RollState,
    g: f64,
    inputs: Inputs,
) -> Result<RollObservability, CannotFollow> {
    let turn = state.omega.norm() * (model.body.size() / g).sqrt();
    if turn.is_nan() || turn > TURN_MAX {
        return Err(CannotFollow::TurnsTooFast { turn });
    }
    let sensitivities = sensitivities(model, state, g, inputs, turn);
    if sensitivities.iter().any(|entry| !entry.is_finite()) {
        return Err(CannotFollow::TooSharp { radius: model.body.sharpest() / model.body.size() });
    }
    Ok(RollObservability {
        spectrum: Spectrum::of(sensitivities),
        sufficient_condition: sufficient_condition(model, state),
    })
}

/// Changes of the contact over the window, over L, by the scaled state: two rows a contact. The body turns by `turn`
/// (rad) in √(L/g).
fn sensitivities(model: &Model, state: &RollState, g: f64, inputs: Inputs, turn: f64) -> DMatrix<f64> {
    // Scales: length L, time √(L/g). Fast bodies get more steps.
    let size = model.body.size();
    let rate = (g / size).sqrt();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 1 to TURN_MAX/TURN_OF_STEPS")]
    let steps = STEPS * (turn / TURN_OF_STEPS).ceil().max(1.0) as u32;
    let dt = WINDOW / rate / f64::from(CONTACTS * steps);
    let specific_force = |step: u32, within: f64| feel(inputs, g, rate * dt * (f64::from(step) + within));
    let dimension = model.dimension();
    let mut rows = DMatrix::zeros(2 * CONTACTS as usize + 2, dimension);
    let mut here = StateWithTangent::<STATE_COLUMNS>::seed(&state.normalized());
    for contact in 0..=CONTACTS {
        let place = 2 * contact as usize;
        for axis in 0..2 {
            rows[(place + axis, axis)] = 1.0;
            for column in 0..dimension - 2 {
                // u itself is of scale L; turns have none, angular velocities √(g/L).
                let scale = if column < 3 { 1.0 } else { rate };
                rows[(place + axis, 2 + column)] = here.tangent.u[axis][column] * scale / size;
            }
        }
        for step in contact * steps..(contact + 1) * steps {
            let specific_force = [0.0, 0.5, 1.0].map(|within| specific_force(step, within));
            here = model.step_with(Columns::STATE, &here, &specific_force, dt);
        }
    }
    rows
}

/// What the body feels at a time in units of √(L/g).
fn feel(inputs: Inputs, g: f64, time: f64) -> Vector3<f64> {
    let wave = |frequency: f64, phase: f64| 0.3 * g * (frequency * time + phase).sin();
    match inputs {
        Inputs::Zero => Vector3::new(0.0, 0.0, g),
        Inputs::Vertical => Vector3::new(0.0, 0.0, g + wave(2.3, 0.4)),
        Inputs::Generic => {
            Vector3::new(wave(1.3, 0.2) + wave(3.1, 1.0), wave(1.9, 1.1) - wave(2.7, 0.5), g + wave(2.3, 0.4))
        }
    }
}

/// Theorem 32 at the contact of a state.
pub(super) fn sufficient_condition(model: &Model, state: &RollState) -> SufficientCondition {
    let normal = state.normal();
    let local = model.body.shape().local(&normal, &Vector3::zeros());
    let (contact, size) = (local.contact, model.body.size());
    // D⁻¹ (7.16), principal directions x and y, curvatures −1/radius.
    let inverse_inertia = ContactPointInertia::new(&model.body.inertia(), &contact).inverse();
    let ([x, y], radii) = principal(&normal, &local.hessian);
    let [k1, k2] = radii.map(|radius| -1.0 / radius);
    let umbilic = (radii[0] - radii[1]).abs() <= UMBILIC * radii[0];
    // b₁ (7.28), b₂ (7.29) and their determinant with β (7.32). At an umbilic x and y are not defined.
    let determinant = (!umbilic).then(|| {
        let bends = geodesic_curvatures(model, &normal, [&x, &y], radii);
        let b1 = -x + (normal * bends[0] - y * k1).cross(&contact);
        let b2 = -y + (normal * bends[1] + x * k2).cross(&contact);
        Matrix3::from_columns(&[b1, b2, contact / size]).determinant()
    });
    // β·(Iz) of (7.33); without spin h = β·z takes its place.
    let contact_and_inertia = match model.spin {
        Spin::Free => contact.dot(&model.body.inertia().component_mul(&normal)) / size.powi(3),
        Spin::NoSpin => contact.dot(&normal) / size,
    };
    // |β × z| says which is asked; then the terms of (7.30), (7.34), in units of L.
    let across = contact.cross(&normal).norm() / size;
    let curvature = (k1 * x.dot(&(inverse_inertia * x)) - k2 * y.dot(&(inverse_inertia * y))) * size.powi(3);
    let mixed = x.dot(&(inverse_inertia * y)) * size * size;
    let turned = if across > PARALLEL {
        contact_and_inertia.abs() > TERM_THRESHOLD
    } else {
        curvature.abs() > TERM_THRESHOLD || mixed.abs() > TERM_THRESHOLD
    };
    SufficientCondition {
        holds: turned && determinant.is_some_and(|determinant| determinant.abs() > TERM_THRESHOLD),
        determinant,
        contact_and_inertia,
        contact_across_normal: across,
        curvature_and_mobility: curvature,
        mobility_across: mixed,
    }
}

/// Principal directions x, y with x × y = z, and the radii of curvature along them, the larger first.
pub(super) fn principal(normal: &Vector3<f64>, hessian: &Matrix3<f64>) -> ([Vector3<f64>; 2], [f64; 2]) {
    let seed = Vector3::ith(normal.iamin(), 1.0);
    let a = normal.cross(&seed).normalize();
    let b = normal.cross(&a);
    let h = |p: &Vector3<f64>, q: &Vector3<f64>| p.dot(&(hessian * q));
    let eigen = SymmetricEigen::new(Matrix2::new(h(&a, &a), h(&a, &b), h(&a, &b), h(&b, &b)));
    let [first, second] = if eigen.eigenvalues[0] >= eigen.eigenvalues[1] { [0, 1] } else { [1, 0] };
    let x = a * eigen.eigenvectors[(0, first)] + b * eigen.eigenvectors[(1, first)];
    ([x, normal.cross(&x)], [eigen.eigenvalues[first], eigen.eigenvalues[second]])
}

/// `y·∇ₓx` and `y·∇ᵧx` along the principal directions: how those turn from place to place, from the slope of the
/// Hessian.
fn geodesic_curvatures(model: &Model, normal: &Vector3<f64>, [x, y]: [&Vector3<f64>; 2], radii: [f64; 2]) -> [f64; 2] {
    let slope = model.body.shape().local(normal, x).slope;
    // A step of arc length along a principal direction turns the normal by that direction over its radius.
    [(x, radii[0]), (y, radii[1])].map(|(along, radius)| y.dot(&(slope * along)) / radius / (radii[0] - radii[1]))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Quaternion, UnitQuaternion, Vector2};

    use super::super::body::RollingBody;
    use super::super::tests::{bodies, state_of};
    use super::*;
    use crate::gravity::GRAVITY_ASSUMED;

    fn rank(body: &RollingBody, spin: Spin, state: &RollState, inputs: Inputs) -> usize {
        observability(&Model { body, spin }, state, GRAVITY_ASSUMED, inputs).unwrap().spectrum.rank()
    }

    #[test]
    fn bodies_without_symmetry_are_observable() {
        for body in bodies() {
            for k in 0..8 {
                let k = f64::from(k);
                for inputs in [Inputs::Zero, Inputs::Vertical, Inputs::Generic] {
                    let q = [1.0 + k, 2.0 - k, 0.3 * k, 1.0];
                    let w = [3.0 - k, 2.0 * k, 1.0 + k];
                    assert_eq!(
                        rank(body, Spin::Free, &state_of(Spin::Free, q, w), inputs),
                        8,
                        "{k} {inputs:?} {body:?}"
                    );
                    assert_eq!(
                        rank(body, Spin::NoSpin, &state_of(Spin::NoSpin, q, w), inputs),
                        7,
                        "{k} {inputs:?} {body:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn symmetry_hides_what_it_turns() {
        let (q, w) = ([1.0, 0.4, -0.7, 0.2], [4.0, -6.0, 3.0]);
        let spheroid = RollingBody::ellipsoid([0.02, 0.02, 0.035]).unwrap();
        let sphere = RollingBody::ellipsoid([0.03; 3]).unwrap();
        for (spin, ranks) in [(Spin::Free, [7, 4]), (Spin::NoSpin, [6, 4])] {
            let state = state_of(spin, q, w);
            assert_eq!([&spheroid, &sphere].map(|body| rank(body, spin, &state, Inputs::Generic)), ranks, "{spin:?}");
        }
    }

    /// A body on its tip: heading and spin show only if the palm moves sideways.
    #[test]
    fn a_vertex_hides_the_heading_until_the_palm_moves() {
        let body = RollingBody::ellipsoid([0.02, 0.03, 0.04]).unwrap();
        let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7);
        let at = |spin_rate: f64| RollState {
            orientation: heading.into_inner() * Quaternion::identity(),
            omega: Vector3::new(0.0, 0.0, spin_rate),
            u: Vector2::zeros(),
        };
        let ranks = |state: &RollState, spin: Spin| {
            [Inputs::Zero, Inputs::Vertical, Inputs::Generic].map(|inputs| rank(&body, spin, state, inputs))
        };
        assert_eq!(ranks(&at(0.0), Spin::Free), [6, 6, 8]);
        assert_eq!(ranks(&at(5.0), Spin::Free), [6, 6, 8]);
        assert_eq!(ranks(&at(0.0), Spin::NoSpin), [6, 6, 7]);
        let hidden =
            observability(&Model { body: &body, spin: Spin::Free }, &at(0.0), GRAVITY_ASSUMED, Inputs::Zero).unwrap();
        for direction in &hidden.spectrum.unseen {
            let seen =
                STATE_NAMES.iter().zip(direction).filter(|(name, _)| !["rotation_z", "omega_palm_z"].contains(name));
            assert!(seen.map(|(_, weight)| weight.abs()).sum::<f64>() < 1e-6, "{hidden:?}");
        }
    }

    /// b₁ and b₂ by their meaning: minus the derivative of the contact along the principal curves, in the principal
    /// frame.
    #[test]
    fn the_terms_of_the_condition_are_those_of_its_definition() {
        for body in bodies() {
            let model = Model { body, spin: Spin::Free };
            let frame_at = |normal: &Vector3<f64>, like: &Vector3<f64>| {
                let ([x, _], _) = principal(normal, &body.shape().local(normal, &Vector3::zeros()).hessian);
                let x = if x.dot(like) < 0.0 { -x } else { x };
                Matrix3::from_columns(&[x, normal.cross(&x), *normal])
            };
            for normal in super::super::body::normals().skip(37).step_by(613) {
                let local = body.shape().local(&normal, &Vector3::zeros());
                let ([x, _], radii) = principal(&normal, &local.hessian);
                let frame = frame_at(&normal, &x);
                let b = |axis: usize| {
                    let h = 1e-5;
                    let seen = |sign: f64| {
                        let moved = (normal + frame.column(axis) * (sign * h)).normalize();
                        frame_at(&moved, &x).transpose() * body.shape().contact(&moved)
                    };
                    -frame * (seen(1.0) - seen(-1.0)) / (2.0 * h * radii[axis])
                };
                let wanted = Matrix3::from_columns(&[b(0), b(1), local.contact / body.size()]).determinant();
                let orientation = UnitQuaternion::rotation_between(&normal, &-Vector3::z()).unwrap().into_inner();
                let state = RollState { orientation, omega: Vector3::zeros(), u: Vector2::zeros() };
                let got = sufficient_condition(&model, &state).determinant.unwrap();
                // Differences of 1e-5 rad beside curvatures that change within some hundredths.
                assert!((got - wanted).abs() < 3e-4 * (1.0 + wanted.abs()), "{got} {wanted} at {normal:?} {body:?}");
            }
        }
    }

    #[test]
    fn the_condition_fails_where_the_state_is_observable_all_the_same() {
        let body = RollingBody::ellipsoid([0.02, 0.03, 0.04]).unwrap();
        let model = Model { body: &body, spin: Spin::Free };
        let signed = |angle: f64| {
            let q = UnitQuaternion::from_euler_angles(angle, 0.4, 0.3);
            let state =
                RollState { orientation: q.into_inner(), omega: Vector3::new(3.0, 2.0, 1.0), u: Vector2::zeros() };
            (sufficient_condition(&model, &state).determinant.unwrap(), state)
        };
        // Somewhere on this arc the determinant changes sign.
        let (mut low, mut high) = (0.0, 3.1);
        let found = (1..400).map(|k| f64::from(k) * 0.007_75).find(|angle| {
            let jump = signed(*angle).0 - signed(*angle - 0.007_75).0;
            signed(*angle).0 * signed(*angle - 0.007_75).0 < 0.0 && jump.abs() < 1.0
        });
        if let Some(angle) = found {
            (low, high) = (angle - 0.007_75, angle);
        }
        assert!(found.is_some(), "no change of sign between {low} and {high}");
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            *(if signed(low).0 * signed(middle).0 <= 0.0 { &mut high } else { &mut low }) = middle;
        }
        let (_, state) = signed(low);
        let at = observability(&model, &state, GRAVITY_ASSUMED, Inputs::Zero).unwrap();
        assert_eq!((at.spectrum.rank(), at.sufficient_condition.holds), (8, false), "{at:?}");
    }
}
