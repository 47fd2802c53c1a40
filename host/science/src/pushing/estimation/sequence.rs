//! Two pushes of one part, one after the other: what both together leave possible.
//!
//! Each push by itself may leave several poses. If the part stays where the first push left it until the second begins,
//! then the pose after the first is the pose before the second, and only pairs of explanations remain that agree about
//! it. A pair's cost is
//!
//! ```text
//! cost₁ + cost₂ + dᵀ (C₁ + C₂ + S)⁻¹ d     d: difference of the two poses, C: their covariances, S: how well the part stayed
//! ```
//!
//! and all pairs whose cost is within 16 of the least are listed, as explanations of a single push are.
//!
//! Implements: the second push that thesis §6.3 asks for where the first leaves the pose open.
//! Assumes: both poses in one world; nothing else touches the part in between.
//! Frames: world. Units: SI. Errors: none; explanations that contradict each other leave no pair.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix3x2, Vector3};

use super::hypotheses::{GATE, Hypothesis, pose};
use super::observation::{Known, Measured, Observation, Prior};
use crate::geometry::Pose;
use crate::math::angle::wrap_angle;
use crate::pushing::dynamics::{EdgeEnd, Push, Start, State};

/// Steps of the differences by u (rad), s (m) and ω (rad/s): far above rounding, far below what bends a prediction.
const STEPS: [f64; 3] = [1e-5, 1e-6, 1e-4];

/// Standard deviation of ω at the start where none is given: of a uniform one between the bounds of ±10 rad/s.
const OMEGA_SIGMA: f64 = 5.8;

/// A pose that a push leaves possible, before or after it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseBelief {
    /// Pose of the part in the world, m and rad.
    pub pose: Pose,
    /// Covariance of x, y and θ of `pose`, m and rad.
    pub covariance: Matrix3<f64>,
    /// Squared residuals of the push, in standard deviations.
    pub cost: f64,
    /// Among the explanations of that push.
    pub probability: f64,
}

/// How well a part stays between two pushes: standard deviations of what it may have moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slack {
    /// To either side, m; above 0.
    pub shift: f64,
    /// Of its orientation, rad; above 0.
    pub turn: f64,
}

/// An explanation of two pushes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Places of the explanations in the lists of the first and of the second push.
    pub explanations: [usize; 2],
    /// Of both pushes, and of how far they disagree about the pose in between.
    pub cost: f64,
    /// Among the pairs of explanations.
    pub probability: f64,
}

/// Pairs of explanations of two pushes that agree about the pose between them, most probable first.
#[must_use]
pub fn in_sequence(after_first: &[PoseBelief], before_second: &[PoseBelief], slack: Slack) -> Vec<Agreement> {
    let pairs = (0..after_first.len()).flat_map(|first| (0..before_second.len()).map(move |second| [first, second]));
    let weighed = pairs.filter_map(|explanations| {
        let [first, second] = [after_first[explanations[0]], before_second[explanations[1]]];
        let (apart, log_density) = first.apart(&second, slack)?;
        let log_probability = (first.probability * second.probability).ln() + log_density;
        Some((Agreement { explanations, cost: first.cost + second.cost + apart, probability: 0.0 }, log_probability))
    });
    let mut weighed: Vec<_> = weighed.collect();
    let least = weighed.iter().map(|(pair, _)| pair.cost).fold(f64::INFINITY, f64::min);
    weighed.retain(|(pair, _)| pair.cost <= least + GATE);
    let most = weighed.iter().map(|(_, log)| *log).fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = weighed.iter().map(|(_, log)| (log - most).exp()).sum();
    let named = weighed.into_iter().map(|(pair, log)| Agreement { probability: (log - most).exp() / sum, ..pair });
    let mut agreements: Vec<_> = named.collect();
    agreements.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    agreements
}

impl PoseBelief {
    /// The pose after a push, as one of its explanations has it; none where the data leave it free.
    #[must_use]
    pub fn after(hypothesis: &Hypothesis) -> Option<Self> {
        let Hypothesis { pose_end, cost, probability, .. } = *hypothesis;
        Some(Self { pose: pose_end, covariance: hypothesis.covariance?, cost, probability })
    }

    /// The pose before a push of which the contact angle was felt, as one of its explanations has it; none where
    /// another quantity was felt or the data leave the pose free.
    #[must_use]
    pub fn before(known: &Known, observation: &Observation, hypothesis: &Hypothesis) -> Option<Self> {
        let model = known.model(known.part.edge(hypothesis.edge).ok()?);
        let at = |state: &State| Vector3::from(<[f64; 3]>::from(pose(&model, state.u, 0.0, state)));
        let start = hypothesis.start;
        let along = Matrix3x2::from_fn(|row, column| {
            let (upper, lower) = (at(&moved(start, column, 1.0)), at(&moved(start, column, -1.0)));
            let difference = upper[row] - lower[row];
            (if row == 2 { wrap_angle(difference) } else { difference }) / (2.0 * STEPS[column])
        });
        let covariance = along * start_covariance(known, observation, hypothesis)? * along.transpose();
        let Hypothesis { cost, probability, .. } = *hypothesis;
        Some(Self { pose: pose(&model, start.u, 0.0, &start), covariance, cost, probability })
    }

    /// Squared distance of two poses in standard deviations, and the logarithm of its density, up to what all pairs
    /// share.
    fn apart(&self, other: &Self, slack: Slack) -> Option<(f64, f64)> {
        let turn = wrap_angle(other.pose.theta - self.pose.theta);
        let difference = Vector3::new(other.pose.x - self.pose.x, other.pose.y - self.pose.y, turn);
        let stayed = Vector3::new(slack.shift, slack.shift, slack.turn).map(|sd| sd * sd);
        let spread = (self.covariance + other.covariance + Matrix3::from_diagonal(&stayed)).cholesky()?;
        let apart = difference.dot(&spread.solve(&difference));
        Some((apart, -0.5 * (apart + spread.ln_determinant())))
    }
}

fn moved(start: State, which: usize, sign: f64) -> State {
    let by = |index: usize| if index == which { sign * STEPS[index] } else { 0.0 };
    State { u: start.u + by(0), s: start.s + by(1), omega: start.omega + by(2), ..start }
}

/// Covariance of u and s at t = 0, from the sensitivity of all angles to them and to ω.
fn start_covariance(known: &Known, observation: &Observation, hypothesis: &Hypothesis) -> Option<Matrix2<f64>> {
    let Measured::ContactAngle(channel) = &observation.measured else { return None };
    let times: Vec<_> = channel
        .values
        .iter()
        .scan(-observation.dt, |t, _| {
            *t += observation.dt;
            Some(t.max(0.0))
        })
        .collect();
    let angles = |state: State| angles(known, hypothesis, state, &times);
    let slopes = [0, 1, 2].map(|which| {
        // At rest there is no ω to differ in.
        let still = which == 2 && known.starts_at_rest();
        let pair = (!still)
            .then(|| (angles(moved(hypothesis.start, which, 1.0)), angles(moved(hypothesis.start, which, -1.0))));
        pair.map_or_else(Vec::new, |(upper, lower)| {
            upper.iter().zip(&lower).map(|(upper, lower)| (upper - lower) / (2.0 * STEPS[which])).collect()
        })
    });
    let Prior { omega0_sigma, .. } = observation.prior;
    let mut information = Matrix3::zeros();
    information[(2, 2)] = omega0_sigma.unwrap_or(OMEGA_SIGMA).powi(-2);
    for index in (0..times.len()).filter(|&index| channel.values[index].is_finite()) {
        let row = Vector3::from(slopes.each_ref().map(|slopes: &Vec<f64>| slopes.get(index).copied().unwrap_or(0.0)));
        information += row * row.transpose() / channel.sigma.powi(2);
    }
    let keep = Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    Some(keep * information.try_inverse()? * keep.transpose())
}

/// Angles that a start leads to, as long as the contact lasts.
fn angles(known: &Known, hypothesis: &Hypothesis, state: State, times: &[f64]) -> Vec<f64> {
    let run = || {
        let model = known.model(known.part.edge(hypothesis.edge).ok()?);
        let law = hypothesis.law;
        let start = if known.starts_at_rest() { Start::Rest { u: state.u, s: state.s } } else { Start::Moving(state) };
        Push::new(model, law, start, EdgeEnd::Stop).ok()?.run(times).ok()
    };
    run().map_or_else(Vec::new, |run| run.samples.iter().map(|sample| sample.state.u).collect())
}

#[cfg(test)]
mod tests {

    use nalgebra::{Point2, Rotation2, Vector2};
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::pushing::dynamics::{ContactLaw, Finger, Part};
    use crate::pushing::estimation::{Channel, Touch, estimate};

    const SLACK: Slack = Slack { shift: 1e-5, turn: 1e-4 };
    const DT: f64 = 0.01; // s
    const SIGMA: f64 = 0.001_95; // rad
    const ROLLING: ContactLaw = ContactLaw::Rolling { friction: None };

    /// Two edges of nearly equal height, which straight pushes hardly tell apart.
    fn part() -> Part {
        let corners = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.05], [0.0, 0.058]].map(Point2::from);
        Part::uniform(SimplePolygon::new(corners).unwrap())
    }

    fn known(part: &Part, finger: Finger) -> Known<'_> {
        Known { part, mu_g: 0.3 * 9.81, finger, touch: Touch::Rolling { friction: None } }
    }

    /// A push of an edge from rest by a finger ahead of it, and what is felt.
    fn push(part: &Part, edge: usize, s: f64, finger: Finger) -> (Observation, Pose, Pose) {
        let known = known(part, finger);
        let model = known.model(part.edge(edge).unwrap());
        let u0 = finger.acceleration[1].atan2(finger.acceleration[0]) + 0.1;
        let times: Vec<_> = (0..61).map(|i| f64::from(i) * DT).collect();
        let run = Push::new(model, ROLLING, Start::Rest { u: u0, s }, EdgeEnd::Stop).unwrap().run(&times).unwrap();
        let values = run.samples.iter().map(|sample| sample.state.u).collect();
        let at = |index: usize| pose(&model, u0, run.samples[index].t, &run.samples[index].state);
        let measured = Measured::ContactAngle(Channel { values, sigma: SIGMA });
        (Observation { dt: DT, measured, prior: Prior::default() }, at(0), at(run.samples.len() - 1))
    }

    /// A finger moved so that its push begins where another one ended.
    fn placed(finger: Finger, from: Pose, to: Pose) -> Finger {
        let turn = Rotation2::new(to.theta - from.theta);
        let centre = to.origin() + turn * (finger.centre0 - from.origin());
        Finger { centre0: centre, acceleration: turn * finger.acceleration, ..finger }
    }

    #[test]
    fn a_second_push_decides_what_the_first_left_open() {
        let part = part();
        let finger = Finger {
            radius: 0.01,
            centre0: Point2::origin(),
            velocity0: Vector2::zeros(),
            acceleration: Vector2::new(0.0, 0.12),
        };
        let (measured, _, end) = push(&part, 0, 0.006, finger);
        let (_, start_mode, _) = push(&part, 1, -0.004, finger);
        let second_finger = placed(finger, start_mode, end);
        let (measured_again, start, _) = push(&part, 1, -0.004, second_finger);
        let apart = (start.origin() - end.origin()).norm() + wrap_angle(start.theta - end.theta).abs();
        assert!(apart < 1e-9, "{start:?} {end:?}");

        let (first, second) = (known(&part, finger), known(&part, second_finger));
        let (one, two) = (estimate(&first, &measured), estimate(&second, &measured_again));
        let after: Vec<_> = one.hypotheses.iter().filter_map(PoseBelief::after).collect();
        let before: Vec<_> =
            two.hypotheses.iter().filter_map(|found| PoseBelief::before(&second, &measured_again, found)).collect();
        assert!(after.len() > 1, "the first push alone decides: {one:?}");
        let both = in_sequence(&after, &before, SLACK);
        let edges = both
            .iter()
            .map(|pair| [one.hypotheses[pair.explanations[0]].edge, two.hypotheses[pair.explanations[1]].edge]);
        assert_eq!(edges.collect::<Vec<_>>(), [[0, 1]], "{both:?}");
        assert!(both[0].probability > 0.999);
    }

    fn belief(pose: [f64; 3], cost: f64, probability: f64) -> PoseBelief {
        let covariance = Matrix3::from_diagonal(&Vector3::new(1e-6, 1e-6, 1e-4));
        PoseBelief { pose: pose.into(), covariance, cost, probability }
    }

    proptest! {
        /// Whatever the poses: what is listed agrees, and whoever agrees best is listed.
        #[test]
        fn pairs_that_agree_are_kept_and_no_others(
            poses in prop::collection::vec(([-0.01..0.01, -0.01..0.01, -3.0..3.0], 0.0..9.0), 1..5),
            shifts in prop::collection::vec(-0.01..0.01, 1..5), turns in 0..3_i32,
        ) {
            let first: Vec<_> = poses.iter().map(|(pose, cost)| belief(*pose, *cost, 1.0 / 5.0)).collect();
            // The same poses, shifted, and whole turns on.
            let second: Vec<_> = poses.iter().zip(shifts.iter().cycle()).map(|((pose, cost), shift)| {
                belief([pose[0] + shift, pose[1], pose[2] + f64::from(turns) * std::f64::consts::TAU], *cost, 1.0 / 5.0)
            }).collect();
            let pairs = in_sequence(&first, &second, SLACK);
            let least = pairs.iter().map(|pair| pair.cost).fold(f64::INFINITY, f64::min);
            let straight = |i: usize| {
                let shift = second[i].pose.x - first[i].pose.x;
                first[i].cost + second[i].cost + shift * shift / (2e-6 + SLACK.shift * SLACK.shift)
            };
            for (i, _) in first.iter().enumerate() {
                let listed = pairs.iter().find(|pair| pair.explanations == [i, i]);
                prop_assert_eq!(listed.is_some(), straight(i) <= least + GATE, "{} {}", i, straight(i));
                prop_assert!(listed.is_none_or(|pair| (pair.cost - straight(i)).abs() < 1e-6));
            }
            prop_assert!((pairs.iter().map(|pair| pair.probability).sum::<f64>() - 1.0).abs() < 1e-9);
        }
    }
}
