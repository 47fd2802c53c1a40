//! When to step: instants that do not depend on what is to be found, so that costs are smooth in it.
//!
//! Friction makes a part forget its speed within v/(µg). Steps in proportion to that follow it with an error that is
//! the same for fast and slow pushes; between knots, values are interpolated (see [`super::path`]).
//!
//! Units: SI. Errors: none.

/// How finely to step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::pushing::estimation) struct Fineness {
    /// Step over the time in which friction forgets the finger's speed.
    pub(in crate::pushing::estimation) share: f64,
    /// Whether each value needs a knot of its own.
    pub(in crate::pushing::estimation) on_values: bool,
}

/// Longest step over the share, s: the part turns by a tenth of a radian at 1 rad/s.
const STEP_MAX_PER_SHARE_S: f64 = 0.1;

/// Shortest step as a part of the time between values: below it a finger at a stop would cost without end.
const STEP_MIN_SHARE: f64 = 1e-3;

/// The first steps are finer by this factor: a part that has not settled moves on the scale of its friction.
const FIRST_FACTOR: f64 = 0.2;

/// How much of the full step is added to the first one for each time in which friction forgets.
const FIRST_GROWTH: f64 = 0.2;

/// When the values of a path are: the first at 0.
#[derive(Clone, Copy, Debug)]
pub(in crate::pushing::estimation) struct ValueTimes {
    /// Time between values, s.
    pub(in crate::pushing::estimation) dt: f64,
    /// How many values there are.
    pub(in crate::pushing::estimation) values: usize,
}

/// The instants at which a path is computed.
#[derive(Clone, Debug)]
pub(in crate::pushing::estimation) struct Clock {
    /// From the start to the last value, s.
    pub(in crate::pushing::estimation) knots: Vec<f64>,
    /// Time between values, s.
    pub(in crate::pushing::estimation) dt: f64,
    /// How many values there are.
    pub(in crate::pushing::estimation) values: usize,
}

impl Clock {
    /// From `start` (s), for a part that forgets its speed within `relaxation_time` (s) at
    /// each time.
    pub(in crate::pushing::estimation) fn new(
        ValueTimes { dt, values }: ValueTimes,
        start: f64,
        fineness: Fineness,
        relaxation_time: impl Fn(f64) -> f64,
    ) -> Self {
        let mut clock = Self { knots: vec![start], dt, values };
        let step_min = STEP_MIN_SHARE * dt;
        let (mut now, end) = (start, clock.time_of(values - 1));
        while now < end {
            let relaxation_time = relaxation_time(now).min(STEP_MAX_PER_SHARE_S);
            let settled = (FIRST_FACTOR + FIRST_GROWTH * (now - start) / relaxation_time).min(1.0);
            let wished = (fineness.share * settled * relaxation_time).max(step_min);
            let (until, on_value) = clock.stretch(now, wished, fineness);
            let steps = ((until - now) / wished).ceil().max(1.0);
            now = if steps <= 1.0 { until } else { now + (until - now) / steps };
            // The last step to a value ends on it to the bit.
            if on_value && until - now < 0.5 * step_min {
                now = until;
            }
            clock.knots.push(now.min(end));
        }
        clock
    }

    /// The same instants, up to the last of the first so many values.
    pub(in crate::pushing::estimation) fn first(&self, values: usize) -> Self {
        let end = self.time_of(values - 1);
        let before = self.knots.iter().copied().take_while(|knot| *knot < end);
        Self { knots: before.chain([end]).collect(), dt: self.dt, values }
    }

    /// Where the present stretch of equal steps ends, s, and whether that is a value.
    fn stretch(&self, now: f64, wished: f64, fineness: Fineness) -> (f64, bool) {
        let end = self.time_of(self.values - 1);
        if !fineness.on_values && wished >= self.dt {
            return ((now + wished).min(end), now + wished >= end);
        }
        (self.time_of(self.first_after(now)).min(end), true)
    }

    /// The time of a value, s.
    pub(in crate::pushing::estimation) fn time_of(&self, value: usize) -> f64 {
        count(value) * self.dt
    }

    /// The first value later than a time.
    pub(in crate::pushing::estimation) fn first_after(&self, time: f64) -> usize {
        let guess = (time / self.dt).floor().max(0.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, ≥ 0, and below the count")]
        let mut value = guess as usize;
        while self.time_of(value) <= time + 1e-9 * self.dt {
            value += 1;
        }
        value
    }
}

/// A count as a number.
pub(in crate::pushing::estimation) fn count(n: usize) -> f64 {
    n as f64
}
