//! Every motion that explains contact angles, or directions and magnitudes of the force.
//!
//! A hypothesis is an edge and up to five numbers at t = 0: contact angle, place on the edge, angular velocity,
//! velocity along the contact, and the plane's friction where it is not known. Simulated forward it predicts every
//! value; its cost is the sum of squared residuals. Finding all local minima of the cost over all edges, fast, takes
//! some ideas:
//! - every edge is covered with cells, at each place of which the other unknowns are fitted, so that no minimum wider
//!   than a cell is missed: see `cover`. Friction makes a part forget how it started within v/(µg), some 20 ms; from
//!   then on it moves on a slow manifold, where contact angle and place fix its velocities: that is where fits begin,
//!   near their end. See `seed` and `manifold`;
//! - a simulation on dual numbers gives the exact derivatives of all it predicts, and with them Gauss–Newton steps: a
//!   handful from seed to minimum: see `fit` and `path`;
//! - where the friction of the plane is not known well ([`Prior`](super::Prior)), its logarithm is one more unknown of
//!   every hypothesis;
//! - all candidates go down side by side, and those that cannot come near the best are given up early: see `select`.
//!
//! From observation to answer: `data` (what was felt, as it is compared); `contact_intervals` (where the disk can
//! touch); `initial_state` (how a push can begin); `clock`, `path` (simulation); `fit` (the cost and a step down);
//! `manifold`, `cover`, `seed` (where to begin); `select` (the search and the judgement);
//! `covariance` (how uncertain it is). `track` does the same while the push goes on.
//!
//! Implements: MAP estimation beside the observers of thesis chapters 5 and 6. Frames: world. Units: SI. Errors: none.

pub(super) mod clock;
mod contact_intervals;
mod covariance;
mod cover;
mod data;
mod fit;
pub(super) mod initial_state;
mod manifold;
pub(super) mod path;
mod seed;
mod select;
#[cfg(test)]
mod tests;
mod track;

pub use select::{estimate, estimate_until};
pub use track::{Tracker, TrackerSettings};

use super::hypotheses::{Estimate, Observer};
use super::observation::{Known, Observation};
use crate::search::{Searched, Stop};

impl Observer for Known<'_> {
    type Observation = Observation;

    fn estimate_until(&self, observation: &Observation, stop: Stop<'_>) -> Searched<Estimate> {
        estimate_until(self, observation, stop)
    }
}
