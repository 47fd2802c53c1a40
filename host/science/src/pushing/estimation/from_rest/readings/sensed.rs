//! What of a recorded push an estimate by readings takes: means of short equal stretches, free of the bias at rest, from
//! just before the push begins to where it ends.
//!
//! The noise of a mean is that of the same means at rest, whatever its colour: two of them hardly depend on each other.
//! The bias is known as well as the mean at rest, which is left aside: a second of rest knows it to a fifteenth of that
//! noise.
//!
//! Frames: those of the readings. Units: s, N. Errors: [`TareError`] where the rest was none.

use nalgebra::Vector2;

use super::ForceReading;
use crate::finger::contact::{Reading, TareError};
use crate::pushing::estimation::from_rest::onset::{PushSense, RestNoise};

/// A mean each so long, s: in so short a time a push changes little, and a converter's filter is over.
const STRETCH_S: f64 = 4e-3;

/// What is taken of the time before the push, s: that it is quiet says when the push begins.
const BEFORE_S: f64 = 0.1;

/// What is taken of the push, s: what comes later says little more about where it began, and costs as much to follow.
const PUSH_MAX_S: f64 = 1.2;

/// A stretch counts that has this share of its readings.
const FILLED: f64 = 0.5;

/// A push as an estimate takes it.
#[derive(Clone, Debug, PartialEq)]
pub struct SensedPush {
    /// On the clock of what was recorded.
    pub readings: Vec<ForceReading>,
    /// Standard deviation of one, each axis, N.
    pub noise: f64,
    /// When the contact was lost, if it was, s.
    pub lost: Option<f64>,
}

/// Sums of readings in stretches of the same length.
struct Stretches {
    from: f64,
    length: f64,
    sums: Vec<(f64, f64, Vector2<f64>)>,
}

impl Stretches {
    fn of(readings: &[Reading], bias: Vector2<f64>, from: f64, to: f64, period: f64) -> Self {
        let length = STRETCH_S.max(period);
        let mut stretches = Self { from, length, sums: Vec::new() };
        for reading in readings.iter().filter(|reading| (from..to).contains(&reading.t)) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at and after `from`")]
            let index = ((reading.t - from) / length) as usize;
            stretches.sums.resize(stretches.sums.len().max(index + 1), (0.0, 0.0, Vector2::zeros()));
            let (count, time, force) = &mut stretches.sums[index];
            *count += 1.0;
            *time += reading.t - stretches.from;
            *force += reading.force_finger - bias;
        }
        stretches
    }

    fn means(&self, period: f64) -> impl Iterator<Item = ForceReading> + '_ {
        let full = self.sums.iter().filter(move |(count, ..)| *count >= FILLED * self.length / period);
        full.map(|(count, time, force)| ForceReading { time: self.from + time / count, force: force / *count })
    }
}

/// The push in a recording that begins with so many seconds of rest; none where none is felt.
///
/// # Errors
/// [`TareError`] if the finger was not at rest.
pub fn sensed(readings: &[Reading], rest_s: f64) -> Result<Option<SensedPush>, TareError> {
    let begin = readings.first().map_or(0.0, |reading| reading.t);
    let rest = &readings[..readings.partition_point(|reading| reading.t - begin <= rest_s)];
    let noise = RestNoise::estimate(rest)?;
    let mut sense = PushSense::new(noise, None);
    readings[rest.len()..].iter().for_each(|reading| sense.push(reading));
    let Some(onset) = sense.onset_time() else { return Ok(None) };
    let lost = sense.lost_before(PUSH_MAX_S);
    let end = lost.unwrap_or(onset + PUSH_MAX_S);
    let means = |from: f64, to: f64| -> Vec<ForceReading> {
        Stretches::of(readings, noise.bias, from, to, noise.period).means(noise.period).collect()
    };
    let quiet = means(begin, begin + rest_s);
    let squares: f64 = quiet.iter().map(|mean| mean.force.norm_squared()).sum();
    // Two values each; the mean of all was taken off.
    let freedom = (2 * quiet.len()).saturating_sub(2).max(1) as f64;
    Ok(Some(SensedPush {
        readings: means((onset - BEFORE_S).max(begin), end),
        noise: (squares / freedom).sqrt(),
        lost,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Draw;

    const NOISE_N: f64 = 2e-3;

    /// A force that rises at 1.3 s to half a newton along −x and lasts for so long.
    fn recorded(lasts: f64) -> Vec<Reading> {
        let mut draw = Draw::case(3, 0);
        let bias = Vector2::new(0.4, -0.2);
        let reading = |k: i32| {
            let t = f64::from(k) * 250e-6;
            let pushed = if (1.3..1.3 + lasts).contains(&t) { Vector2::new(-0.5, 0.1) } else { Vector2::zeros() };
            Reading::new(t, bias + pushed + Vector2::new(draw.normal(), draw.normal()) * NOISE_N)
        };
        (0..12_000).map(reading).collect()
    }

    #[test]
    fn means_are_free_of_the_bias_and_as_noisy_as_at_rest() {
        let push = sensed(&recorded(5.0), 1.0).unwrap().unwrap();
        // Sixteen readings each.
        assert!((push.noise / (NOISE_N / 4.0) - 1.0).abs() < 0.2, "{} N", push.noise);
        let (before, after) = push.readings.split_at(push.readings.partition_point(|mean| mean.time < 1.3));
        assert!(before.len() > 20 && before.iter().all(|mean| mean.force.norm() < 6.0 * push.noise));
        let of_push = after.iter().skip(1).map(|mean| mean.force - Vector2::new(-0.5, 0.1));
        assert!(of_push.clone().count() > 250 && of_push.map(|off| off.norm()).all(|off| off < 8.0 * push.noise));
        assert_eq!(push.lost, None);
    }

    #[test]
    fn a_push_ends_where_the_contact_does() {
        let push = sensed(&recorded(0.5), 1.0).unwrap().unwrap();
        assert!(
            (push.lost.unwrap() - 1.8).abs() < 0.02 && push.readings.last().unwrap().time < 1.81,
            "{:?}",
            push.lost
        );
    }

    #[test]
    fn without_a_push_there_is_none() {
        assert_eq!(sensed(&recorded(0.0), 1.0).unwrap(), None);
    }
}
