//! The start from rest: how a part begins to move when a finger begins to.
//!
//! At rest the direction of support friction follows from the acceleration that it opposes. Without contact friction,
//! and in rolling, the acceleration A = (a_N, a_T, α) is the only minimum of the strictly convex Gauss function
//! |a|²/2 + ρ²α²/2 + µg Φ(A) under the contact's constraint, with Φ the mean speed under the part of a twist A (thesis
//! §5.1.3 finds it by a Newton iteration on the centre of rotation). In sliding the contact force is at an angle to the
//! constraint; the same equations are solved in a plane across the force, and are reached from the frictionless ones.
//!
//! Assumes: as [`super::model`]; a foot that stays at rest creeps ([`super::FOOT_AT_REST`], here in m/s²).
//! Frames: components along N and T of [`super::disk_on_edge`]; per unit mass. Units: SI.
//! Errors: [`RestError`] where the iteration does not settle.

use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};

use super::body::Body;
use super::contact_mode::ContactForce;
use super::model::{Arm, ContactMode};
use crate::math::Jet;

/// Iterations after which a solution is given up: a few suffice.
const ITERATIONS_MAX: usize = 60;

/// Halvings of a step that does not improve: 2⁻⁴⁰ of a step is none.
const HALVINGS_MAX: u32 = 40;

/// Residual relative to the finger's acceleration plus µg that counts as solved: a hundred times rounding.
const RESIDUAL_SOLVED: f64 = 1e-14;

/// The same where the iteration can no longer improve. Above it, nothing was found.
const RESIDUAL_STALLED: f64 = 1e-9;

/// Least share of the contact friction by which to approach a sliding contact.
const SHARE_MIN: f64 = 1e-3;

/// How a part at rest begins to move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestStart {
    /// Acceleration of the centre of mass along N, m/s².
    pub a_n: f64,
    /// Acceleration of the centre of mass along T, m/s².
    pub a_t: f64,
    /// Angular acceleration, rad/s².
    pub alpha: f64,
    /// −F·N/m, m/s²; below 0 the finger leaves the part, which then does not move.
    pub normal_force: f64,
    /// −F·T/m, m/s².
    pub tangential_force: f64,
}

impl RestStart {
    /// The force on the part.
    pub(crate) fn force(&self) -> ContactForce {
        ContactForce { normal: self.normal_force, tangential: self.tangential_force }
    }
}

/// The iteration did not settle.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the start from rest was not found: a residual of {residual:e} m/s² is left")]
pub struct RestError {
    /// What is left, m/s².
    pub residual: f64,
}

/// The equations `across^T (M A + µg ∂Φ/∂A) = 0` with `A = offset + along x`: what the contact permits, and what its
/// force cannot balance.
struct Equations<const K: usize> {
    offset: Vector3<f64>,
    along: SMatrix<f64, 3, K>,
    across: SMatrix<f64, 3, K>,
}

/// A part at rest and what sets it in motion.
pub(super) struct AtRest<'a> {
    pub(super) body: &'a Body,
    pub(super) mu_g: f64,
    /// N, the part's outward normal at the contact, part axes.
    pub(super) normal: Vector2<f64>,
    pub(super) arm: Arm,
    /// The finger's acceleration along N and T, m/s².
    pub(super) finger: [f64; 2],
}

impl AtRest<'_> {
    /// How the part begins to move.
    pub(super) fn start(&self, contact: &ContactMode) -> Result<RestStart, RestError> {
        let finger = Vector3::new(self.finger[0], self.finger[1], 0.0);
        let acceleration = match contact.signed_friction() {
            Some(m) => self.slide(m, finger),
            None => self.roll(finger),
        }?;
        Ok(self.start_with(acceleration))
    }

    fn start_with(&self, acceleration: Vector3<f64>) -> RestStart {
        let force = -(acceleration + self.friction(&acceleration).0);
        RestStart {
            a_n: acceleration.x,
            a_t: acceleration.y,
            alpha: acceleration.z,
            normal_force: force.x,
            tangential_force: force.y,
        }
    }

    fn roll(&self, finger: Vector3<f64>) -> Result<Vector3<f64>, RestError> {
        // The turn is counted as the speed it gives the radius of gyration, so that all unknowns are accelerations.
        let turning = Vector3::new(self.arm.along, self.arm.height, 1.0) / self.body.inertia_per_mass().sqrt();
        let equations = Equations::<1> { offset: finger, along: turning, across: turning };
        self.solve(&equations, SVector::zeros()).map(|x| equations.acceleration(&x))
    }

    /// Approaches the wanted friction from none, where the problem is convex, by steps that shrink where they fail.
    fn slide(&self, m: f64, finger: Vector3<f64>) -> Result<Vector3<f64>, RestError> {
        let Arm { height, along } = self.arm;
        let equations = |m: f64| {
            let radius = self.body.inertia_per_mass().sqrt();
            // Unknown are the acceleration along T and the turn; along N the part keeps contact: a_N = a_FN + c_t α.
            let shift = Vector3::y();
            Equations::<2> {
                offset: Vector3::new(finger.x, 0.0, 0.0),
                along: SMatrix::from_columns(&[shift, Vector3::new(along, 0.0, 1.0) / radius]),
                // Directions in which the contact force −λN + mλT with its moment λ(c_t − m c_N) does no work.
                across: SMatrix::from_columns(&[
                    Vector3::new(m, 1.0, 0.0),
                    Vector3::new(along - m * height, 0.0, 1.0) / radius,
                ]),
            }
        };
        let (mut x, mut done, mut share) = (self.solve(&equations(0.0), SVector::zeros())?, 0.0, 1.0);
        while done < 1.0 && m != 0.0 {
            let next = f64::min(1.0, done + share);
            match self.solve(&equations(m * next), x) {
                Ok(found) => (x, done) = (found, next),
                Err(error) if share < SHARE_MIN => return Err(error),
                Err(_) => share /= 2.0,
            }
        }
        Ok(equations(m).acceleration(&x))
    }

    /// Newton's method, each step shortened until the residual falls.
    fn solve<const K: usize>(
        &self,
        equations: &Equations<K>,
        start: SVector<f64, K>,
    ) -> Result<SVector<f64, K>, RestError> {
        let (mut x, (mut residual, mut jacobian)) = (start, self.residual(equations, &start));
        let scale = equations.offset.norm() + self.mu_g;
        for _ in 0..ITERATIONS_MAX {
            if residual.norm() <= RESIDUAL_SOLVED * scale {
                return Ok(x);
            }
            let Some(newton) = jacobian.try_inverse().map(|inverse| inverse * residual) else { break };
            let shorter = (0..HALVINGS_MAX).map(|halvings| x - newton * 0.5_f64.powi(halvings.cast_signed()));
            let improved = shorter.map(|x| (x, self.residual(equations, &x)));
            let Some(better) = improved.into_iter().find(|(_, (r, _))| r.norm() < residual.norm()) else { break };
            (x, (residual, jacobian)) = better;
        }
        let residual = residual.norm();
        if residual <= RESIDUAL_STALLED * scale { Ok(x) } else { Err(RestError { residual }) }
    }

    fn residual<const K: usize>(
        &self,
        equations: &Equations<K>,
        x: &SVector<f64, K>,
    ) -> (SVector<f64, K>, SMatrix<f64, K, K>) {
        let acceleration = equations.acceleration(x);
        let inertia = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, self.body.inertia_per_mass()));
        let (friction, gradient) = self.friction(&acceleration);
        let across = equations.across.transpose();
        (across * (inertia * acceleration + friction), across * (inertia + gradient) * equations.along)
    }

    /// Support friction opposing a twist with components along N and T, and its gradient.
    fn friction(&self, twist: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let seed = |i: usize| Jet::<3>::variable(twist[i], i);
        let (x, y) = (self.normal.x, self.normal.y);
        // T is a quarter turn clockwise from N.
        let (n, t) = (seed(0), seed(1));
        let [d_x, d_y, turn] = self.body.sliding([n * x + t * y, n * y - t * x, seed(2)]);
        let components = [d_x * x + d_y * y, d_x * y - d_y * x, turn];
        let values = Vector3::from(components.map(|part| part.value));
        let gradient = Matrix3::from_fn(|row, column| components[row].slopes[column]);
        (values * self.mu_g, gradient * self.mu_g)
    }
}

impl<const K: usize> Equations<K> {
    fn acceleration(&self, x: &SVector<f64, K>) -> Vector3<f64> {
        self.offset + self.along * x
    }
}
