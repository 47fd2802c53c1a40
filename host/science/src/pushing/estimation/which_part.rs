//! Which of several known parts was pushed: the same push is explained with each, and the explanations are compared.
//!
//! Laplace's approximation gives each hypothesis the weight exp(−cost/2) √det C, with C the covariance of contact angle and place
//! at the end; a part's evidence is the sum over its hypotheses. Before the push every part is as likely, and of one part every
//! place of its perimeter, so that a large part is not preferred for having more places. A part that the data exclude by
//! themselves has no hypotheses and the probability 0.
//!
//! Parts may also differ in no more than what they stand on, which is seldom known: [`mixed`] then makes one answer of all of them.
//!
//! Units: SI. Errors: none; if no part explains the data, each has the probability 0.
//!
//! Implements: thesis §8.2, recognition of the part beside its pose.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Vector3, Vector4};

use super::select::{GATE, SAME_END_M, halting_estimate};
use super::{Estimate, Hypothesis, Known, Observation};
use crate::math::angle::wrap_angle;
use crate::pushing::dynamics::Part;
use crate::search::{Halt, Searched, Stop, never};

/// What a push says about one of several parts.
#[derive(Clone, Debug, PartialEq)]
pub struct PartEstimate<E> {
    /// Its place among those given.
    pub part: usize,
    /// That it was this one, if it was one of them.
    pub probability: f64,
    /// Where it is then.
    pub estimate: E,
}

/// An explanation's part in the evidence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight {
    /// Squared residuals in standard deviations.
    pub cost: f64,
    /// Of contact angle (rad) and place (m) at the end.
    pub covariance: Matrix2<f64>,
}

/// Which of several parts explains an observation, the likeliest first; `known` differs in the part.
#[must_use]
pub fn which_part(known: &[Known], observation: &Observation) -> Vec<PartEstimate<Estimate>> {
    which_part_until(known, observation, &never).found
}

/// The same, ended when `stop` says so: then parts that were not looked at explain nothing yet, and others too little.
#[must_use]
pub fn which_part_until(
    known: &[Known],
    observation: &Observation,
    stop: Stop<'_>,
) -> Searched<Vec<PartEstimate<Estimate>>> {
    let halt = Halt::new(stop);
    let estimates = known.iter().map(|known| halting_estimate(known, observation, &halt));
    let parts = ranked(estimates.zip(known).map(|(estimate, known)| {
        let evidence = log_evidence_of(known.part, &estimate);
        (estimate, evidence)
    }));
    halt.searched(parts)
}

/// What several parts of one outline leave possible together, whichever it is: explanations of different parts that end at one place
/// are one, and its covariance holds how far they are apart. None where no part explains the data.
///
/// The order is that of [`which_part`]; goodness of fit and outliers are those of the likeliest.
#[must_use]
pub fn mixed(parts: Vec<PartEstimate<Estimate>>) -> Option<Estimate> {
    let least = parts.iter().filter_map(|part| part.estimate.fit.cost).fold(f64::INFINITY, f64::min);
    let mut all: Vec<Hypothesis> = Vec::new();
    for PartEstimate { probability, estimate, .. } in &parts {
        for found in estimate.hypotheses.iter().filter(|found| found.cost <= least + GATE) {
            let next = Hypothesis { probability: probability * found.probability, ..found.clone() };
            let one =
                |other: &&mut Hypothesis| other.edge == next.edge && (other.end.s - next.end.s).abs() < SAME_END_M;
            match all.iter_mut().find(one) {
                Some(other) => take_in(other, &next),
                None => all.push(next),
            }
        }
    }
    let sum: f64 = all.iter().map(|found| found.probability).sum();
    all.iter_mut().for_each(|found| found.probability /= sum);
    all.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let first = parts.into_iter().next()?;
    Some(Estimate { hypotheses: all, ..first.estimate }).filter(|mixed| !mixed.hypotheses.is_empty())
}

/// Makes an explanation cover another one too: the mean squares of the errors of its own pose if either may be true.
fn take_in(kept: &mut Hypothesis, other: &Hypothesis) {
    let both = kept.probability + other.probability;
    let share = if both > 0.0 { other.probability / both } else { 0.0 };
    let [x, y, turn] = [0, 1, 2].map(|index| other.pose_end[index] - kept.pose_end[index]);
    let of_pose = Vector3::new(x, y, wrap_angle(turn));
    let of_state = Vector4::new(
        other.end.u - kept.end.u,
        other.end.s - kept.end.s,
        other.end.omega - kept.end.omega,
        other.end.v_t - kept.end.v_t,
    );
    kept.covariance = kept
        .covariance
        .zip(other.covariance)
        .map(|(own, other)| own * (1.0 - share) + (other + of_pose * of_pose.transpose()) * share);
    kept.state_covariance = kept
        .state_covariance
        .zip(other.state_covariance)
        .map(|(own, other)| own * (1.0 - share) + (other + of_state * of_state.transpose()) * share);
    kept.probability = both;
}

/// [`log_evidence`] of what an estimate found.
pub(super) fn log_evidence_of(part: &Part, estimate: &Estimate) -> Option<f64> {
    let weights = estimate.hypotheses.iter().filter_map(|hypothesis| {
        let covariance = hypothesis.state_covariance?.fixed_view::<2, 2>(0, 0).into();
        Some(Weight { cost: hypothesis.cost, covariance })
    });
    log_evidence(part, weights)
}

/// Logarithm of a part's evidence, up to what all parts share; none without an explanation.
#[must_use]
pub fn log_evidence(part: &Part, weights: impl Iterator<Item = Weight>) -> Option<f64> {
    let logarithms: Vec<_> = weights.map(|weight| weight.log()).filter(|log| log.is_finite()).collect();
    let most = logarithms.iter().copied().reduce(f64::max)?;
    let sum: f64 = logarithms.iter().map(|log| (log - most).exp()).sum();
    Some(most + sum.ln() - perimeter(part).ln())
}

fn perimeter(part: &Part) -> f64 {
    let corners = part.polygon().vertices();
    let next = corners.iter().cycle().skip(1);
    corners.iter().zip(next).map(|(from, to)| (to - from).norm()).sum()
}

impl Weight {
    fn log(&self) -> f64 {
        TAU.ln() + 0.5 * (self.covariance.determinant().ln() - self.cost)
    }
}

/// Estimates by the probability of their parts, from the logarithms of evidence.
#[must_use]
pub fn ranked<E>(parts: impl Iterator<Item = (E, Option<f64>)>) -> Vec<PartEstimate<E>> {
    let parts: Vec<_> = parts.collect();
    let most = parts.iter().filter_map(|(_, evidence)| *evidence).fold(f64::NEG_INFINITY, f64::max);
    let share = |evidence: Option<f64>| evidence.map_or(0.0, |evidence| (evidence - most).exp());
    let sum: f64 = parts.iter().map(|(_, evidence)| share(*evidence)).sum();
    let probability = |evidence| if sum > 0.0 { share(evidence) / sum } else { 0.0 };
    let numbered = parts.into_iter().enumerate();
    let mut ranked: Vec<_> = numbered
        .map(|(part, (estimate, evidence))| PartEstimate { part, probability: probability(evidence), estimate })
        .collect();
    ranked.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    ranked
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use nalgebra::Point2;

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::pushing::dynamics::{ContactLaw, EdgeEnd, Finger, Mass, Push, PushModel, Start, State};
    use crate::pushing::estimation::{Channel, Measured, Prior, Touch};

    const GRIP: f64 = 0.3 * 9.81;
    const DT: f64 = 0.01; // s
    const SIGMA: f64 = 0.001_95; // rad
    const FINGER: Finger =
        Finger { radius: 0.01, centre0: [0.0; 2], velocity0: [0.0, 0.05], acceleration: [0.06, 0.0] };

    fn part(corners: &[[f64; 2]]) -> Part {
        Part::uniform(SimplePolygon::new(corners.iter().copied().map(Point2::from).collect::<Vec<_>>()).unwrap())
    }

    fn rectangle(width: f64, height: f64) -> Part {
        part(&[[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    }

    fn known(part: &Part) -> Known<'_> {
        Known { part, grip: GRIP, finger: FINGER, touch: Touch::Rolling { friction: None } }
    }

    /// Exact angles of a part that is pushed at edge 0.
    fn push(part: &Part) -> Observation {
        let model = PushModel { part, edge: part.edge(0).unwrap(), grip: GRIP, finger: FINGER };
        let start = Start::Moving(State { u: FRAC_PI_2, s: 0.006, omega: 0.0, v_t: 0.0 });
        let law = ContactLaw::Rolling { friction: None };
        let times: Vec<_> = (0..61).map(|i| f64::from(i) * DT).collect();
        let run = Push::new(model, law, start, EdgeEnd::Stop).unwrap().run(&times).unwrap();
        let values = run.samples.iter().map(|sample| sample.state.u).collect();
        let prior = Prior { omega0_sigma: Some(1.0), ..Prior::default() };
        Observation { dt: DT, measured: Measured::ContactAngle(Channel { values, sigma: SIGMA }), prior }
    }

    #[test]
    fn the_part_that_was_pushed_is_named_whichever_it_is() {
        let parts = [rectangle(0.06, 0.04), rectangle(0.08, 0.02), part(&[[0.0, 0.0], [0.07, 0.0], [0.02, 0.05]])];
        let all = parts.each_ref().map(known);
        for (truth, part) in parts.iter().enumerate() {
            let ranked = which_part(&all, &push(part));
            assert_eq!(ranked.len(), parts.len());
            assert_eq!(ranked[0].part, truth);
            assert!(ranked[0].probability > 0.9, "{truth}: {}", ranked[0].probability);
            assert!(!ranked[0].estimate.hypotheses.is_empty());
        }
    }

    /// One outline on different supports.
    fn supports() -> [Part; 4] {
        let outline = [[0.0, 0.0], [0.07, 0.0], [0.06, 0.05], [0.0, 0.04]].map(Point2::from);
        let polygon = SimplePolygon::new(outline).unwrap();
        let mass = Mass::uniform(&polygon);
        let share = |feet: &[[f64; 2]]| {
            let each = 1.0 / feet.len() as f64;
            feet.iter().map(|&at| (Point2::from(at), each)).collect::<Vec<_>>()
        };
        let rim: Vec<_> = polygon
            .edges()
            .flat_map(|(from, to)| (0..6).map(move |i| (from + (to - from) * (f64::from(i) / 6.0)).into()))
            .collect();
        let centre = mass.centre_of_mass;
        let near: Vec<[f64; 2]> =
            [[0.004, 0.0], [-0.002, 0.0035], [-0.002, -0.0035]].map(|[x, y]| [centre.x + x, centre.y + y]).to_vec();
        let three = [[0.005, 0.005], [0.065, 0.005], [0.03, 0.04]];
        [
            Part::uniform(polygon.clone()),
            Part::on_feet(polygon.clone(), &share(&rim), mass),
            Part::on_feet(polygon.clone(), &share(&three), mass),
            Part::on_feet(polygon, &share(&near), mass),
        ]
    }

    #[test]
    fn a_push_names_what_a_part_stands_on() {
        let parts = supports();
        let all = parts.each_ref().map(known);
        for (truth, part) in parts.iter().enumerate() {
            let ranked = which_part(&all, &push(part));
            assert_eq!(
                ranked[0].part,
                truth,
                "{:?}",
                ranked.iter().map(|r| (r.part, r.probability)).collect::<Vec<_>>()
            );
        }
    }

    /// Far noisier angles do not tell the support, but where the part is, whatever it stands on.
    #[test]
    fn a_pose_is_mixed_over_what_a_part_may_stand_on() {
        let parts = supports();
        let all = parts.each_ref().map(known);
        let truth = 1;
        let Observation { dt, measured, prior } = push(&parts[truth]);
        let Measured::ContactAngle(Channel { values, .. }) = measured else { panic!("angles were felt") };
        let measured = Measured::ContactAngle(Channel { values, sigma: 10.0 * SIGMA });
        let ranked = which_part(&all, &Observation { dt, measured, prior });
        assert!(ranked.iter().all(|part| part.probability < 0.95), "{ranked:?}");
        let alone: Vec<_> = ranked.iter().map(|part| (part.probability, part.estimate.clone())).collect();
        let mixed = mixed(ranked).unwrap();
        let sum: f64 = mixed.hypotheses.iter().map(|found| found.probability).sum();
        assert!((sum - 1.0).abs() < 1e-9, "{sum}");
        // Mean and mean square of every explanation, whatever the part, are those of the mixture about its own members.
        for found in &mixed.hypotheses {
            let near = |other: &&Hypothesis| other.edge == found.edge && (other.end.s - found.end.s).abs() < SAME_END_M;
            let members = alone.iter().flat_map(|(share, estimate)| {
                estimate.hypotheses.iter().filter(near).map(move |member| (share * member.probability, member))
            });
            let members: Vec<_> = members.collect();
            let weight: f64 = members.iter().map(|(share, _)| share).sum();
            let wanted: f64 = members
                .iter()
                .map(|(share, member)| {
                    let off = member.pose_end[2] - found.pose_end[2];
                    share / weight * (member.covariance.unwrap().m33 + off * off)
                })
                .sum();
            let got = found.covariance.unwrap().m33;
            assert!((got / wanted - 1.0).abs() < 1e-6, "{got} {wanted}");
        }
    }

    #[test]
    fn parts_that_are_alike_share_the_probability() {
        let parts = [rectangle(0.06, 0.04), rectangle(0.06, 0.04)];
        let ranked = which_part(&parts.each_ref().map(known), &push(&parts[0]));
        assert!(ranked.iter().all(|part| (part.probability - 0.5).abs() < 1e-9), "{ranked:?}");
    }

    #[test]
    fn evidence_is_weighed_as_gaussians_are() {
        // Two explanations of one part against one of another: e⁰ + e⁻¹ to e⁻¹, with equal widths and perimeters.
        let part = rectangle(0.06, 0.04);
        let weight = |cost| Weight { cost, covariance: Matrix2::identity() };
        let both = log_evidence(&part, [weight(0.0), weight(2.0)].into_iter());
        let one = log_evidence(&part, [weight(2.0)].into_iter());
        let none = log_evidence(&part, std::iter::empty());
        let ranked = ranked([((), none), ((), one), ((), both)].into_iter());
        let wanted = (1.0 + (-1.0_f64).exp()) / (1.0 + 2.0 * (-1.0_f64).exp());
        assert_eq!(ranked.iter().map(|part| part.part).collect::<Vec<_>>(), [2, 1, 0]);
        assert!((ranked[0].probability - wanted).abs() < 1e-12 && ranked[2].probability.abs() < 1e-300);
    }

    #[test]
    fn if_no_part_explains_the_data_none_is_named() {
        let ranked = ranked([((), None), ((), None)].into_iter());
        assert!(ranked.iter().all(|part| part.probability.abs() < 1e-300));
    }
}
