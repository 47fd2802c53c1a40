//! How a finger turns whose angle was measured: a smooth function of time, from the angles that a wrist tells.
//!
//! Where the wrist turns, the sensor's frame turns with it, and the rim of the disk goes by at the contact. What turns a
//! force is the angle itself; what slips is its rate; and a part that rolls feels the rate's rate. So the angles are
//! smoothed: a quadratic spline by least squares, its knots a few angles apart. Angles are taken for as exact as an encoder's.
//!
//! Frames: from the world's axes to the sensor's, counter-clockwise. Units: SI. Errors: [`TurnError`].

use nalgebra::{DMatrix, DVector};

use super::finger_motion::LegTurn;

/// Nearest that knots are, s: a wrist does not change its acceleration more often.
const KNOTS_S: f64 = 0.02;

/// Angles from knot to knot: two leave as much of their noise, and none of the third.
const ANGLES_A_KNOT: f64 = 2.5;

/// Fewest angles that tell of a turn.
pub const ANGLES_MIN: usize = 8;

/// A bend of the spline costs so much of its square: where no angle tells of a piece, it goes straight on.
const STRAIGHT: f64 = 1e-6;

/// Fastest turn, rad/s. A force is followed in steps of 5 ms and read as its mean over as long. Over Δ = 5 ms at Ω a mean is
/// shorter than what it is of by (ΩΔ)²/24: at 12 rad/s by 1.5e-4, and the model of a force is good to 2e-4 of it.
pub const TURN_RATE_MAX: f64 = 12.0;

/// Furthest turn from one angle to the next, rad: over more of a turn nobody knows what it did in between.
pub const TURN_BETWEEN_MAX: f64 = 0.5;

/// Angles that tell no turn.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TurnError {
    /// Fewer than [`ANGLES_MIN`], or not one a time.
    #[error("{count} angles tell no turn: at least {ANGLES_MIN} are needed, one a place")]
    TooFew {
        /// How many there are.
        count: usize,
    },
    /// Faster than the model holds for.
    #[error(
        "the finger turns at {rate:.2} rad/s at t = {time:.3} s, but at most {TURN_RATE_MAX} rad/s can be followed: a force is \
         read over 5 ms, and turns too far meanwhile; turn the wrist more slowly"
    )]
    TooFast {
        /// When, s.
        time: f64,
        /// How fast, rad/s.
        rate: f64,
    },
    /// Too far from one angle to the next.
    #[error(
        "the finger turns by {angle:.2} rad from one angle to the next at t = {time:.3} s, at most {TURN_BETWEEN_MAX} rad can \
         be followed: measure it more often, or turn the wrist more slowly"
    )]
    TooFar {
        /// When, s.
        time: f64,
        /// How far, rad.
        angle: f64,
    },
}

/// A measured turn.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredTurn {
    from: f64,
    /// From knot to knot, s.
    apart: f64,
    /// Of the quadratic splines, rad.
    weights: Vec<f64>,
}

impl MeasuredTurn {
    /// From angles (rad, whole turns aside) at times (s, increasing).
    ///
    /// # Errors
    /// [`TurnError`].
    pub fn new(times: &[f64], angles: &[f64]) -> Result<Self, TurnError> {
        let count = times.len().min(angles.len());
        if count < ANGLES_MIN || times.len() != angles.len() {
            return Err(TurnError::TooFew { count });
        }
        let mut unwrapped = vec![angles[0]];
        for (pair, time) in angles.windows(2).zip(times) {
            let step = crate::math::angle::wrap_angle(pair[1] - pair[0]);
            if step.abs() > TURN_BETWEEN_MAX {
                return Err(TurnError::TooFar { time: *time, angle: step.abs() });
            }
            unwrapped.push(unwrapped[unwrapped.len() - 1] + step);
        }
        let (first, last) = (times[0], times[count - 1]);
        let wanted = KNOTS_S.max(ANGLES_A_KNOT * (last - first) / (count - 1) as f64);
        let pieces = ((last - first) / wanted).floor().max(1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "no more than there are angles")]
        let columns = pieces as usize + 2;
        let mut turn = Self { from: first, apart: (last - first) / pieces, weights: vec![0.0; columns] };
        let mut normal = DMatrix::<f64>::zeros(columns, columns);
        let mut right = DVector::<f64>::zeros(columns);
        for (time, angle) in times.iter().zip(&unwrapped) {
            let (piece, [values, ..]) = turn.splines(*time);
            for (row, value) in values.iter().enumerate() {
                right[piece + row] += value * angle;
                values
                    .iter()
                    .enumerate()
                    .for_each(|(column, other)| normal[(piece + row, piece + column)] += value * other);
            }
        }
        for bend in 1..columns - 1 {
            for (row, one) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                for (column, other) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                    normal[(bend - 1 + row, bend - 1 + column)] += STRAIGHT * one * other;
                }
            }
        }
        // Positive definite: angles and straight lines leave nothing open.
        let solved = normal.cholesky().ok_or(TurnError::TooFew { count })?.solve(&right);
        turn.weights = solved.iter().copied().collect();
        for time in times {
            let rate = turn.at(*time)[1].abs();
            if rate > TURN_RATE_MAX {
                return Err(TurnError::TooFast { time: *time, rate });
            }
        }
        Ok(turn)
    }

    /// The first of the three splines that reach a time (s), and of each its value, rate (1/s) and acceleration (1/s²).
    fn splines(&self, time: f64) -> (usize, [[f64; 3]; 3]) {
        let pieces = self.weights.len() - 2;
        let place = ((time - self.from) / self.apart).clamp(0.0, pieces as f64);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the pieces")]
        let piece = (place.floor() as usize).min(pieces - 1);
        let x = place - piece as f64;
        let values = [0.5 * (1.0 - x) * (1.0 - x), 0.5 + x - x * x, 0.5 * x * x];
        let rates = [x - 1.0, 1.0 - 2.0 * x, x].map(|rate| rate / self.apart);
        let bends = [1.0, -2.0, 1.0].map(|bend| bend / (self.apart * self.apart));
        (piece, [values, rates, bends])
    }

    /// Angle (rad) and rate (rad/s) at a time, s: before the first angle and after the last that of these.
    #[must_use]
    pub fn at(&self, time: f64) -> [f64; 2] {
        let (piece, [values, rates, _]) = self.splines(time);
        let of =
            |shares: [f64; 3]| shares.iter().zip(&self.weights[piece..]).map(|(share, weight)| share * weight).sum();
        [of(values), of(rates)]
    }

    /// Over a stretch from one time to another, s, with the angle and the rate exact at its start and the rate at its end.
    #[must_use]
    pub fn over(&self, from: f64, to: f64) -> LegTurn {
        let last = self.from + self.apart * (self.weights.len() - 2) as f64;
        let to = to.min(last);
        let ([angle0, rate0], [_, rate]) = (self.at(from), self.at(to));
        LegTurn { angle0, rate0, acceleration: if to > from { (rate - rate0) / (to - from) } else { 0.0 } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Draw;

    /// Angle and rate of a wrist that swings: to what noise of an encoder leaves.
    #[test]
    fn angle_and_rate_are_found_from_noisy_angles() {
        let angle = |t: f64| 0.8 * (1.0 - (3.0 * t).cos()) + 3.0;
        let rate = |t: f64| 2.4 * (3.0 * t).sin();
        let mut draw = Draw::case(5, 0);
        let times: Vec<_> = (0..100).map(|n| 0.01 * f64::from(n) + draw.uniform(0.0, 0.004)).collect();
        // Whole turns come and go.
        let angles: Vec<_> =
            times.iter().map(|t| crate::math::angle::wrap_angle(angle(*t) + 1e-5 * draw.normal())).collect();
        let turn = MeasuredTurn::new(&times, &angles).unwrap();
        for t in (5..95).map(|n| 0.01 * f64::from(n)) {
            let [found, found_rate] = turn.at(t);
            assert!((found - angle(t)).abs() < 1e-4, "{t}: {}", found - angle(t));
            assert!((found_rate - rate(t)).abs() < 0.01, "{t}: {}", found_rate - rate(t));
        }
    }

    #[test]
    fn what_cannot_be_followed_is_refused() {
        let times: Vec<_> = (0..40).map(|n| 0.01 * f64::from(n)).collect();
        let at = |rate: f64| times.iter().map(|t| rate * t).collect::<Vec<_>>();
        assert!(MeasuredTurn::new(&times, &at(11.0)).is_ok());
        assert!(matches!(MeasuredTurn::new(&times, &at(13.0)), Err(TurnError::TooFast { .. })));
        let seldom: Vec<_> = times.iter().map(|t| 10.0 * t).collect();
        assert!(matches!(MeasuredTurn::new(&seldom, &at(60.0)), Err(TurnError::TooFar { .. })));
        assert!(matches!(MeasuredTurn::new(&times[..5], &[0.0; 5]), Err(TurnError::TooFew { .. })));
    }
}
