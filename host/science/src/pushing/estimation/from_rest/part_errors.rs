//! What is not known of a part, as numbers in standard deviations: its outline, where its mass is, and where it presses on
//! the plane.
//!
//! Numbers in their order: of each edge how far its line is off along its normal, or of an ellipse each semi-axis; of the centre of mass x and y; of the
//! pressure the logarithm of a stretch about its middle, along x, along y, and along their diagonal. What friction resists a
//! push by depends on how far from its middle a part presses, each way: a stretch stands for all pressures that resist
//! alike. The middle of a pressure that is not known lies under the centre of mass; of one that is known it stays.
//!
//! Frames: part. Units: SI. Errors: none; an outline whose edges cross is no part.

use nalgebra::{Matrix2, Vector2};

use crate::pushing::dynamics::Part;

/// Numbers of the centre of mass.
const OF_MASS: usize = 2;

/// Numbers of the pressure.
const OF_PRESSURE: usize = 3;

/// What an outline that is not known exactly changes of the force, as a share, at the most.
const OUTLINE_SHARE: f64 = 0.02;

/// What a stretch of the pressure changes of the force, as a share of its logarithm, at the most: the place about which a
/// part turns moves by a third of that, and the force turns by less.
const PRESSURE_SHARE: f64 = 0.2;

/// What is not known of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartErrors {
    /// Standard deviation of the offset of each edge's line along its normal, or of an ellipse's semi-axes, independent, m; 0 of
    /// an exact outline.
    pub outline_sigma: f64,
    /// Whether the part's mass is that of a uniform plate with this outline, whatever the outline; otherwise it stays.
    pub mass_follows_outline: bool,
    /// Standard deviation of the centre of mass, each coordinate, m; 0 of one that is known.
    pub centre_of_mass_sigma: f64,
    /// Standard deviation of the logarithm of the stretch that stands for the pressure; 0 of one that is known.
    pub pressure_log_sd: f64,
}

impl PartErrors {
    /// A part that is known.
    pub const NONE: Self =
        Self { outline_sigma: 0.0, mass_follows_outline: true, centre_of_mass_sigma: 0.0, pressure_log_sd: 0.0 };

    /// For [`Self::pressure_log_sd`]: a part that stands on anything. A plate that bears at its rim is as one stretched by
    /// 1.5 (0.4 in the logarithm), one that bears within half its size as one by 0.5 (−0.7); of 6 to 24 feet anywhere under
    /// it with weights within a factor of e two times in three, logarithms are that far from 0.
    pub const PRESSURE_UNKNOWN: f64 = 0.4;

    /// What a stretch leaves of a pressure that is not known, as a share of the friction: four times the root mean square over
    /// twists, for those feet, of which some are two and three times as far from any stretch as most. By those the truth is lost.
    const PRESSURE_LEFT_SHARE: f64 = 0.2;

    /// What of that changes faster than what drifts, as feet come near the place about which the part turns. Of 250 pushes 95 %
    /// regions held the truth of 223 with half of both, and most of the others are held by twice of this.
    const PRESSURE_FAST_SHARE: f64 = 0.06;
}

impl PartErrors {
    /// The same, if there is anything that is not known.
    #[must_use]
    pub fn if_any(self) -> Option<Self> {
        [self.outline_sigma, self.centre_of_mass_sigma, self.pressure_log_sd].iter().any(|sd| *sd > 0.0).then_some(self)
    }

    /// Whether a search excludes what it does not list. Where the pressure is not known it does not: three numbers stand for all
    /// pressures, and of the single poses of drawn ones a third was wrong (docs/RELIABILITY.md).
    #[must_use]
    pub fn can_exclude_others(&self) -> bool {
        self.pressure_log_sd == 0.0
    }

    fn edges(&self, part: &Part) -> usize {
        if self.outline_sigma > 0.0 { part.outline_numbers() } else { 0 }
    }

    /// How many numbers.
    pub(super) fn count(&self, part: &Part) -> usize {
        let of = |sd: f64, count: usize| if sd > 0.0 { count } else { 0 };
        self.edges(part) + of(self.centre_of_mass_sigma, OF_MASS) + of(self.pressure_log_sd, OF_PRESSURE)
    }

    /// What they change of the force, as a share, at the most: noise of a search that finds none of them.
    pub(super) fn share(&self, part: &Part) -> f64 {
        let of_outline = if self.outline_sigma > 0.0 { OUTLINE_SHARE } else { 0.0 };
        let of_mass = self.centre_of_mass_sigma / part.inertia_per_mass().sqrt();
        of_outline.hypot(0.5 * of_mass).hypot(PRESSURE_SHARE * self.pressure_log_sd)
    }

    /// What the numbers cannot say of the force, as a share of it.
    pub(super) fn left_share(&self) -> f64 {
        if self.pressure_log_sd > 0.0 { Self::PRESSURE_LEFT_SHARE } else { 0.0 }
    }

    /// What of that changes faster than what drifts: noise of every reading.
    pub(super) fn fast_share(&self) -> f64 {
        if self.pressure_log_sd > 0.0 { Self::PRESSURE_FAST_SHARE } else { 0.0 }
    }

    /// The part with each number so many standard deviations off; none where edges then cross.
    pub(super) fn moved(&self, part: &Part, off: &[f64]) -> Option<Part> {
        let (of_edges, off) = off.split_at(self.edges(part));
        let moved = if of_edges.is_empty() {
            part.clone()
        } else {
            part.with_outline_off(|number| of_edges[number] * self.outline_sigma, self.mass_follows_outline)?
        };
        let (of_mass, of_pressure) =
            if self.centre_of_mass_sigma > 0.0 { off.split_at(OF_MASS) } else { (&[][..], off) };
        let mass = match *of_mass {
            [x, y] => Vector2::new(x, y) * self.centre_of_mass_sigma,
            _ => Vector2::zeros(),
        };
        Some(match *of_pressure {
            [x, y, both] => {
                let stretch = (Matrix2::new(x, both, both, y) * self.pressure_log_sd).exp();
                moved.redistributed(mass, mass, &stretch)
            }
            _ if mass == Vector2::zeros() => moved,
            _ => moved.redistributed(mass, Vector2::zeros(), &Matrix2::identity()),
        })
    }
}
