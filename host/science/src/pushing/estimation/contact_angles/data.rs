//! Measured values made ready: angles without jumps, the instants they belong to, and smooth estimates at one instant.
//!
//! Units: SI. Errors: none.

use super::clock::count;
use crate::math::angle::wrap_angle;
use crate::math::statistics::percentile;
use crate::pushing::estimation::observation::{Channel, Measured, Observation};

/// What is fitted, one value each `dt` from t = 0 on.
#[derive(Clone, Debug)]
pub(super) struct Data {
    /// Time between values, s.
    pub(super) dt: f64,
    /// How many instants there are.
    pub(super) values: usize,
    /// Contact angles, continuous, rad.
    pub(super) angle: Option<Channel>,
    /// Directions of the force on the part, continuous, rad.
    pub(super) direction: Option<Channel>,
    /// Logarithms of the force per mass.
    pub(super) log_magnitude: Option<Channel>,
    /// Where the contact angle at t = 0 can be, rad; of force data.
    pub(super) u0_range: Option<[f64; 2]>,
    /// Whether `log_magnitude` is right but for one number that is added to all.
    pub(super) mass_is_unknown: bool,
}

/// A straight line fitted to values around one instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    /// The value at that instant, in the channel's unit.
    pub(super) value: f64,
    /// Its rate, 1/s; zero from a single value.
    pub(super) rate: f64,
}

impl Data {
    pub(super) fn new(observation: &Observation) -> Self {
        let (dt, values) = (observation.dt, observation.len());
        let none = Self {
            dt,
            values,
            angle: None,
            direction: None,
            log_magnitude: None,
            u0_range: None,
            mass_is_unknown: false,
        };
        match &observation.measured {
            Measured::ContactAngle(channel) => Self { angle: Some(continuous(channel)), ..none },
            Measured::Force { direction, magnitude, u0_range, mass_is_unknown } => Self {
                direction: direction.as_ref().map(continuous),
                log_magnitude: magnitude.clone(),
                u0_range: u0_range.as_ref().map(|range| [*range.start(), *range.end()]),
                mass_is_unknown: *mass_is_unknown && magnitude.is_some(),
                ..none
            },
        }
    }

    /// Time of the last value, s.
    pub(super) fn duration(&self) -> f64 {
        count(self.values - 1) * self.dt
    }

    /// The contact angle measured nearest to a time, rad.
    pub(super) fn angle_near(&self, time: f64) -> Option<f64> {
        let angle = self.angle.as_ref()?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, ≥ 0, cut to the count")]
        let value = ((time / self.dt).round().max(0.0) as usize).min(self.values - 1);
        let (before, after) = angle.values.split_at(value);
        after.iter().chain(before.iter().rev()).copied().find(|angle| angle.is_finite())
    }

    /// How many numbers were measured, less the one that an unknown mass takes.
    pub(super) fn terms(&self) -> usize {
        let finite = self.channels().flat_map(|channel| &channel.values).filter(|value| value.is_finite()).count();
        finite.saturating_sub(usize::from(self.mass_is_unknown))
    }

    /// The least standard deviation of an angle or a logarithm.
    pub(super) fn sigma_min(&self) -> f64 {
        self.channels().map(|channel| channel.sigma).fold(f64::INFINITY, f64::min)
    }

    /// The same data with no standard deviation below a floor.
    pub(super) fn with_sigma_floor(&self, floor: f64) -> Self {
        let raised = |channel: &Option<Channel>| {
            channel.as_ref().map(|channel| Channel { values: channel.values.clone(), sigma: channel.sigma.max(floor) })
        };
        Self {
            angle: raised(&self.angle),
            direction: raised(&self.direction),
            log_magnitude: raised(&self.log_magnitude),
            ..self.clone()
        }
    }

    /// The first so many values of the same data.
    pub(super) fn first(&self, values: usize) -> Self {
        let first = |channel: &Option<Channel>| {
            let of = |channel: &Channel| channel.values.iter().take(values).copied().collect();
            channel.as_ref().map(|channel| Channel { values: of(channel), sigma: channel.sigma })
        };
        let (angle, direction) = (first(&self.angle), first(&self.direction));
        Self { values, angle, direction, log_magnitude: first(&self.log_magnitude), ..self.clone() }
    }

    /// The same data without the values before a time, s.
    pub(super) fn without_first(&self, time: f64) -> Self {
        self.only(|value| count(value) * self.dt >= time)
    }

    /// The same data without some values.
    pub(super) fn without(&self, values: &[usize]) -> Self {
        self.only(|value| !values.contains(&value))
    }

    fn only(&self, is_kept: impl Fn(usize) -> bool) -> Self {
        let kept = |(i, value): (usize, &f64)| if is_kept(i) { *value } else { f64::NAN };
        let only = |channel: &Option<Channel>| {
            let of = |channel: &Channel| channel.values.iter().enumerate().map(kept).collect();
            channel.as_ref().map(|channel| Channel { values: of(channel), sigma: channel.sigma })
        };
        let (angle, direction) = (only(&self.angle), only(&self.direction));
        Self { angle, direction, log_magnitude: only(&self.log_magnitude), ..self.clone() }
    }

    /// The values that no smooth motion passes through; none if they are too many to be outliers.
    pub(super) fn outliers(&self) -> Option<Vec<usize>> {
        let lie_off = |value: &usize| self.channels().any(|channel| lies_off(channel, *value));
        let outliers: Vec<_> = (0..self.values).filter(lie_off).collect();
        are_few(outliers.len(), self.values).then_some(outliers)
    }

    fn channels(&self) -> impl Iterator<Item = &Channel> {
        self.angle.iter().chain(&self.direction).chain(&self.log_magnitude)
    }
}

/// Whether so many of all values can be outliers.
fn are_few(outliers: usize, values: usize) -> bool {
    outliers * OUTLIERS_SHARE <= values
}

/// At most one value in so many can be an outlier.
const OUTLIERS_SHARE: usize = 4;

/// Values on either side that a value is compared with.
const NEIGHBOURS: usize = 4;

/// An outlier is off by more than this many standard deviations.
const OUTLIER_SIGMAS: f64 = 6.0;

/// Standard deviation over the median distance from zero, of normal errors.
const SIGMA_PER_MEDIAN: f64 = 1.4826;

/// Whether a value is far from the straight line through its neighbours: by the median of the slopes between them and
/// the median of what they are off it, so that a few wrong ones among them do not count. Neighbours on a bend widen the
/// limit.
fn lies_off(Channel { values, sigma }: &Channel, value: usize) -> bool {
    let around = value.saturating_sub(NEIGHBOURS)..(value + NEIGHBOURS + 1).min(values.len());
    let near: Vec<_> = around.filter(|&i| i != value && values[i].is_finite()).collect();
    if near.len() < NEIGHBOURS || !values[value].is_finite() {
        return false;
    }
    let pairs = near.iter().enumerate().flat_map(|(i, &a)| near[i + 1..].iter().map(move |&b| (a, b)));
    let middle_of = |values: &mut dyn Iterator<Item = f64>| percentile(values, 50).unwrap_or(f64::NAN);
    let slope = middle_of(&mut pairs.map(|(a, b)| (values[b] - values[a]) / (count(b) - count(a))));
    let level = |i: usize| values[i] - slope * count(i);
    let middle = middle_of(&mut near.iter().map(|&i| level(i)));
    let spread = SIGMA_PER_MEDIAN * middle_of(&mut near.iter().map(|&i| (level(i) - middle).abs()));
    (level(value) - middle).abs() > OUTLIER_SIGMAS * sigma.max(spread)
}

/// Angles without jumps of whole turns.
fn continuous(channel: &Channel) -> Channel {
    let mut values = channel.values.clone();
    let mut last = channel.values.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
    for value in values.iter_mut().filter(|value| value.is_finite()) {
        *value = last + wrap_angle(*value - last);
        last = *value;
    }
    Channel { values, sigma: channel.sigma }
}

/// The straight line through the values within `half_width` of an instant (all in values), by least squares.
pub(super) fn local(values: &[f64], dt: f64, time: f64, half_width: f64) -> Local {
    let inside = |i: &usize| values[*i].is_finite() && (count(*i) * dt - time).abs() <= half_width + 1e-9 * dt;
    let mut sums = [0.0; 5];
    for i in (0..values.len()).filter(inside) {
        let (x, y) = (count(i) * dt - time, values[i]);
        for (sum, term) in sums.iter_mut().zip([1.0, x, x * x, y, x * y]) {
            *sum += term;
        }
    }
    let [n, x, xx, y, xy] = sums;
    let spread = n * xx - x * x;
    if n < 2.0 || spread <= 0.0 {
        return between(values, dt, time);
    }
    Local { value: (xx * y - x * xy) / spread, rate: (n * xy - x * y) / spread }
}

/// The straight line through the two values nearest to an instant.
fn between(values: &[f64], dt: f64, time: f64) -> Local {
    let mut there: Vec<_> = (0..values.len()).filter(|&i| values[i].is_finite()).collect();
    there.sort_by(|&i, &j| (count(i) * dt - time).abs().total_cmp(&(count(j) * dt - time).abs()));
    match there[..] {
        [] => Local { value: 0.0, rate: 0.0 },
        [only] => Local { value: values[only], rate: 0.0 },
        [i, j, ..] => {
            let rate = (values[j] - values[i]) / ((count(j) - count(i)) * dt);
            Local { value: values[i] + rate * (time - count(i) * dt), rate }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn whole_turns_between_values_do_not_count() {
        let wrapped = Channel { values: vec![3.1, -3.1, -3.0, 3.1 + TAU], sigma: 1e-3 };
        let continuous = continuous(&wrapped).values;
        assert!(continuous.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.3), "{continuous:?}");
    }

    #[test]
    fn wrong_values_are_outliers_only_while_they_are_few() {
        let sparks = |count: usize| {
            let value = |i: usize| 1.0 + 0.01 * i as f64 + if i % 4 == 1 && i / 4 < count { 0.5 } else { 0.0 };
            let values = (0..40).map(value).collect();
            Channel { values, sigma: 1e-3 }
        };
        let off = |count: usize| (0..40).filter(|&i| lies_off(&sparks(count), i)).count();
        for count in 1..=10 {
            assert_eq!(off(count), count);
            assert!(are_few(count, 40), "{count} of 40");
        }
        assert!(!are_few(11, 40) && !are_few(20, 40));
    }

    #[test]
    fn a_straight_line_is_found_to_rounding() {
        let values: Vec<_> = (0..30).map(|i| 1.5 - 0.7 * 0.01 * f64::from(i)).collect();
        for time in [0.0, 0.123, 0.29] {
            let Local { value, rate } = local(&values, 0.01, time, 0.05);
            assert!((value - (1.5 - 0.7 * time)).abs() < 1e-13 && (rate + 0.7).abs() < 1e-11);
        }
        assert!((local(&values, 0.01, 0.1, 0.0).value - 1.43).abs() < 1e-13);
        // Also through a gap.
        let mut values = values;
        values[9..12].fill(f64::NAN);
        let Local { value, rate } = local(&values, 0.01, 0.1, 0.01);
        assert!((value - 1.43).abs() < 1e-13 && (rate + 0.7).abs() < 1e-11);
        values[0..29].fill(f64::NAN);
        assert!((local(&values, 0.01, 0.1, 0.01).value - values[29]).abs() < 1e-13);
    }
}
