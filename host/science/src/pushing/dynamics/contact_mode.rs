//! Which contact mode follows: whether the part sticks to the finger or slides along it, which way, when it breaks and
//! jams.
//!
//! The one place where that is decided. Simulations and estimators compute forces and slips each in its own way, and
//! ask here.
//!
//! Implements: Coulomb's law at the contact (thesis §5.4). With F_n and F_t the force on the part that *rolling* needs:
//!
//! | occasion | what follows |
//! |---|---|
//! | nothing slips yet: a start, a new acceleration of the finger | sticks if \|F_t\| ≤ µ_s F_n, otherwise slides with sgn σ = −sgn F_t |
//! | a slip has come to zero | sticks on the same condition, otherwise slides the other way |
//! | rolling has used up its friction | slides with sgn σ = −sgn F_t |
//!
//! The contact breaks where F_n < 0 *in the mode that follows*: where rolling would have to pull, sliding may still
//! push. It jams where the mode that follows slides and has no force (Painlevé), D ≤ 0.
//!
//! Why that is consistent: let W be what a force per mass accelerates the part's point at the contact by (2×2, positive
//! definite). Under a force F that keeps the contact (no acceleration along the normal), with F_r the one that rolling
//! needs,
//!
//! ```text
//! normal       0  = w_nn (F_n − F_rn) + w_nt (F_t − F_rt)
//! slip         σ̇  = (F_t − F_rt) det W / w_nn
//! sliding      F_t = −µ_c sgn(σ) F_n        F_n = (w_nn F_rn + w_nt F_rt)/D        D = w_nn − µ_c sgn(σ) w_nt
//! ```
//!
//! If |F_rt| > µ_c F_rn and D > 0 both ways, the only slip that grows under its own friction is that against F_rt, also
//! where F_rn < 0. And a slip that friction has brought to zero had σ̇ against it: then σ̇'s sign says that F_rt is
//! along the slip, and the second row of the table is the first one, free of rounding.
//!
//! Signs, in every simulation: along the edge, counter-clockwise is positive, both for the slip σ (part relative to
//! finger) and for F_t (force on the part); F_n > 0 pushes into the part. Friction opposes slip, F_t σ ≤ 0.
//! Frames: edge. Units: SI, forces per unit mass of the part. Numbers may carry derivatives; their values decide.
//! Errors: none.

use super::model::{ContactMode, Slip};
use super::rest::RestStart;
use super::scalar::Scalar;

/// Slip and speed that count as none, m/s: an atom's width a second. Rounding in the velocities is a million times
/// less.
pub(super) const SLIP_NONE: f64 = 1e-9;

/// A sliding denominator D (1 for s = 0) below this is a jam: the contact force is a thousand million times its usual
/// size, and at the pace of any push the true zero is less than a nanosecond away.
pub(crate) const JAM_DENOMINATOR: f64 = 1e-9;

/// Force of the finger on the part, per unit mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactForce<T = f64> {
    /// Into the part, m/s².
    pub normal: T,
    /// Along the edge's counter-clockwise direction, m/s².
    pub tangential: T,
}

/// Coefficients of Coulomb friction between finger and part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ContactFriction<T = f64> {
    /// µ_c of a contact that slides.
    pub(crate) sliding: T,
    /// µ_s of a contact that does not slip yet; not below `sliding`. Infinite for one that never slips.
    pub(crate) sticking: T,
}

impl<T: Scalar> ContactForce<T> {
    /// Whether the finger pushes. Otherwise, and if there is no such force, the contact breaks.
    pub(crate) fn pushes(&self) -> bool {
        self.normal.re() > 0.0
    }
}

impl<T: Scalar> ContactFriction<T> {
    /// One coefficient for both, as everywhere so far.
    pub(crate) fn same(mu_c: T) -> Self {
        Self { sliding: mu_c, sticking: mu_c }
    }

    /// The same in other numbers.
    pub(crate) fn map<U>(&self, convert: impl Fn(T) -> U) -> ContactFriction<U> {
        ContactFriction { sliding: convert(self.sliding), sticking: convert(self.sticking) }
    }

    /// What a contact does that does not slip yet, from the force that rolling needs.
    pub(crate) fn without_slip(&self, rolling: &ContactForce<T>) -> ContactMode<T> {
        let sticks = rolling.tangential.re().abs() <= self.sticking.re() * rolling.normal.re();
        if sticks { ContactMode::Rolling } else { self.slides_against(rolling) }
    }

    /// What a contact does that slips at `slip` (m/s), or does not slip yet.
    pub(crate) fn at_slip(&self, slip: f64, rolling: impl FnOnce() -> ContactForce<T>) -> ContactMode<T> {
        if slip.abs() < SLIP_NONE { self.without_slip(&rolling()) } else { self.slides(Slip::of(slip)) }
    }

    /// What follows a mode that has come to its end, [`Self::left`] being used up: from the force that rolling needs
    /// there.
    pub(crate) fn after(&self, mode: &ContactMode<T>, rolling: &ContactForce<T>) -> ContactMode<T> {
        match (*mode, self.without_slip(rolling)) {
            (ContactMode::Sliding { .. }, ContactMode::Rolling) => ContactMode::Rolling,
            (ContactMode::Sliding { slip, .. }, _) => self.slides(slip.reversed()),
            // At the instant that was found, rounding may say that the friction still suffices.
            (ContactMode::Rolling | ContactMode::Frictionless, _) => self.slides_against(rolling),
        }
    }

    /// The contact that slides this way.
    pub(crate) fn slides(&self, slip: Slip) -> ContactMode<T> {
        ContactMode::Sliding { friction: self.sliding, slip }
    }

    fn slides_against(&self, force: &ContactForce<T>) -> ContactMode<T> {
        self.slides(Slip::of(-force.tangential.re()))
    }

    /// What must not fall below 0 for a mode to last: friction that rolling leaves unused (m/s²), slip in its direction
    /// (m/s).
    pub(crate) fn left(
        &self,
        mode: &ContactMode<T>,
        slip: impl FnOnce() -> T,
        force: impl FnOnce() -> ContactForce<T>,
    ) -> T {
        match *mode {
            ContactMode::Frictionless => T::from(f64::INFINITY),
            ContactMode::Rolling => self.unused(&force()),
            ContactMode::Sliding { slip: direction, .. } => slip_left(slip(), direction),
        }
    }

    /// Friction that rolling leaves unused, m/s²; below 0 it needs more than there is.
    pub(crate) fn unused(&self, rolling: &ContactForce<T>) -> T {
        let along = rolling.tangential;
        self.sticking * rolling.normal - if along.re() < 0.0 { -along } else { along }
    }

    /// The same towards both sides of the friction cone, the counter-clockwise one first: each is smooth.
    pub(super) fn unused_each_way(&self, rolling: &ContactForce<T>) -> [T; 2] {
        let most = self.sticking * rolling.normal;
        [most - rolling.tangential, most + rolling.tangential]
    }
}

impl ContactFriction {
    /// How a part at rest begins to move, and in which mode, at a finger that slips along it at `slip` (m/s) already,
    /// if it does. `start` solves how for a given mode.
    pub(crate) fn begun<E>(
        &self,
        slip: f64,
        start: impl Fn(&ContactMode) -> Result<RestStart, E>,
    ) -> Result<(ContactMode, RestStart), E> {
        let slides = |contact: ContactMode| Ok((contact, start(&contact)?));
        if slip.abs() >= SLIP_NONE {
            return slides(self.slides(Slip::of(slip)));
        }
        let rolling = start(&ContactMode::Rolling)?;
        match self.without_slip(&rolling.force()) {
            ContactMode::Rolling => Ok((ContactMode::Rolling, rolling)),
            sliding => slides(sliding),
        }
    }
}

/// Slip in the direction of sliding, m/s; below 0 the sliding has stopped.
pub(crate) fn slip_left<T: Scalar>(slip: T, direction: Slip) -> T {
    slip * direction.sign()
}

/// Whether no finite force fits a sliding part, given its D.
pub(crate) fn jams(sliding_denominator: f64) -> bool {
    sliding_denominator <= JAM_DENOMINATOR
}

#[cfg(test)]
mod tests;
