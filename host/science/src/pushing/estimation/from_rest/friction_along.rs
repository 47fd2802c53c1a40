//! A friction of the contact that wanders along an edge.
//!
//! Its logarithm is straight between knots. What it is off at each is a number of its own; that it is the same everywhere on
//! an edge but for those is what an estimate takes for granted.
//!
//! Units: m along the edge from its foot below the centre of mass; logarithms. Errors: none.

/// From knot to knot, m: as far as a smear, a scratch or the grain of a cut face goes on.
const KNOTS_APART_M: f64 = 1.5e-3;

/// Most knots of an edge: of longer ones they are further apart.
const KNOTS_MAX: f64 = 48.0;

/// By what µ_c at a place differs from that of a guess; the default is nowhere.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct FrictionAlong {
    /// The place of the first knot.
    from: f64,
    apart: f64,
    /// ln of the factor at each.
    logs: Vec<f64>,
}

impl FrictionAlong {
    /// Knots from end to end of an edge (m), at none of which it differs.
    pub(super) fn constant(from: f64, to: f64) -> Self {
        let length = to - from;
        let stretches = (length / KNOTS_APART_M).ceil().clamp(1.0, KNOTS_MAX - 1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 1 and 47")]
        let knots = stretches as usize + 1;
        Self { from, apart: length / stretches, logs: vec![0.0; knots] }
    }

    /// Knots.
    pub(super) fn count(&self) -> usize {
        self.logs.len()
    }

    /// The same with what it is off at each knot.
    pub(super) fn with_logs(&self, logs: impl Iterator<Item = f64>) -> Self {
        Self { logs: logs.collect(), ..*self }
    }

    /// Whether it is the same everywhere.
    pub(super) fn is_constant(&self) -> bool {
        self.logs.iter().all(|log| *log == 0.0)
    }

    /// Whether it differs from another where a contact was, s in m.
    #[expect(clippy::float_cmp, reason = "what was not moved is the same to the bit")]
    pub(super) fn differs_within(&self, other: &Self, [low, high]: [f64; 2]) -> bool {
        let knots = self.logs.iter().zip(&other.logs).enumerate().filter(|(_, (log, other))| log != other);
        knots
            .map(|(knot, _)| self.from + self.apart * knot as f64)
            .any(|at| (low - at < self.apart) && (at - high < self.apart))
    }

    /// µ_c at a place over that of the guess; beyond the ends that of the nearest knot.
    pub(super) fn factor(&self, s: f64) -> f64 {
        let (Some(last), true) = (self.logs.len().checked_sub(1), self.apart > 0.0) else { return 1.0 };
        let place = ((s - self.from) / self.apart).clamp(0.0, last as f64);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the knots")]
        let before = (place.floor() as usize).min(last.saturating_sub(1));
        let share = place - before as f64;
        let after = self.logs[(before + 1).min(last)];
        (self.logs[before] + share * (after - self.logs[before])).exp()
    }
}
