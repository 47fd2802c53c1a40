//! Which of several known parts was pushed: the same push is explained with each, and the explanations are compared.
//!
//! Laplace's approximation gives each hypothesis the weight exp(−cost/2) √det C, with C the covariance of contact angle
//! and place at the end; a part's evidence is the sum over its hypotheses. Before the push every part is as likely, and
//! of one part every place of its perimeter, so that a large part is not preferred for having more places. A part that
//! the data exclude by themselves has no hypotheses and the probability 0.
//!
//! Parts may also differ in no more than what they stand on, which is seldom known: [`mixed`] then makes one answer of
//! all of them.
//!
//! Units: SI. Errors: none; if no part explains the data, each has the probability 0.
//!
//! Implements: thesis §8.2, recognition of the part beside its pose.

use std::f64::consts::TAU;

use nalgebra::Matrix2;

use super::friction::Told;
use super::hypotheses::{Estimate, Fit, GATE, Hypothesis, Nearness, joined};
use crate::pushing::dynamics::Part;

/// What a push says about one of several parts.
#[derive(Clone, Debug, PartialEq)]
pub struct PartEstimate {
    /// Its place among those given.
    pub part: usize,
    /// That it was this one, if it was one of them.
    pub probability: f64,
    /// Where it is then.
    pub estimate: Estimate,
}

/// Which of several parts explains a push, the likeliest first: from what the same observer says with each of them.
///
/// A part's estimate comes from any [`Observer`](super::Observer); all of them from the same data.
#[must_use]
pub fn which_part<'p>(estimates: impl IntoIterator<Item = (&'p Part, Estimate)>) -> Vec<PartEstimate> {
    let (evidence, estimates): (Vec<_>, Vec<_>) =
        estimates.into_iter().map(|(part, estimate)| (log_evidence(part, weights(&estimate)), estimate)).unzip();
    let numbered = estimates.into_iter().zip(shares(&evidence)).enumerate();
    let mut ranked: Vec<_> =
        numbered.map(|(part, (estimate, probability))| PartEstimate { part, probability, estimate }).collect();
    ranked.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    ranked
}

/// What is believed of several parts, before a push or after it.
#[derive(Clone, Debug, PartialEq)]
pub struct PartBelief {
    /// Of each, by its place.
    pub parts: Vec<PossiblePart>,
    /// That it is none of them.
    pub none: f64,
}

/// What is believed of a part.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PossiblePart {
    /// That it is this one, if it is one of them; 0 for one that is excluded.
    pub probability: f64,
    /// What it weighs then, kg, where an earlier push told.
    pub mass: Option<Told>,
}

impl PossiblePart {
    /// From explanations of a push with this part: the probability of each and its mass, kg.
    #[must_use]
    pub fn new(probability: f64, masses: impl Iterator<Item = (f64, Told)> + Clone) -> Self {
        let mass = Told::mixed(masses.map(|(share, mass)| (share, mass.value.ln(), mass.log_sd.powi(2))));
        Self { probability, mass: Some(mass).filter(|mass| mass.value.is_finite()) }
    }
}

/// What the masses that two pushes of one part tell differ by beside what each states: friction of a plane wanders by some
/// hundredths from place to place.
const SAME_MASS_LOG_SD: f64 = 0.02;

impl PartBelief {
    /// Before anything was felt: each of so many parts is as likely.
    #[must_use]
    pub fn beforehand(parts: usize) -> Self {
        let part = PossiblePart { probability: 1.0 / parts.max(1) as f64, mass: None };
        Self { parts: vec![part; parts], none: UNKNOWN_BEFOREHAND }
    }

    /// Places of the parts that are not excluded.
    pub fn possible(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.parts.len()).filter(|&part| self.parts[part].probability > 0.0)
    }

    /// After a push, from what the same observer says with each part that is worth a search: its place among all, and the
    /// estimate. The others are excluded. The parts in order of likelihood, and what is believed then.
    ///
    /// Two pushes of one part have its mass in common; contact, noise and friction are each push's own. An explanation with
    /// another mass than before is left out.
    #[must_use]
    pub fn after<'p>(
        &self,
        estimates: impl IntoIterator<Item = (usize, &'p Part, Estimate)>,
    ) -> (Vec<PartEstimate>, Self) {
        let (places, estimates): (Vec<_>, Vec<_>) =
            estimates.into_iter().map(|(place, part, estimate)| (place, (part, estimate))).unzip();
        let mut ranked = which_part(estimates);
        for part in &mut ranked {
            part.part = places[part.part];
            let before = self.parts[part.part];
            let likelihood = before.mass.map_or(1.0, |mass| of_mass(&mut part.estimate, mass));
            part.probability *= before.probability * likelihood;
        }
        let sum: f64 = ranked.iter().map(|part| part.probability).sum();
        ranked.iter_mut().filter(|_| sum > 0.0).for_each(|part| part.probability /= sum);
        ranked.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        let mut parts = vec![PossiblePart::default(); self.parts.len()];
        for PartEstimate { part, probability, estimate } in &ranked {
            let masses = estimate.hypotheses.iter().filter_map(|found| {
                let force = found.from_force?;
                Some((found.probability, Told { value: force.mass, log_sd: force.mass_log_sd }))
            });
            parts[*part] = PossiblePart::new(*probability, masses);
        }
        let none = none_of_these(&ranked, self.possible().count(), self.none);
        (ranked, Self { parts, none })
    }
}

/// Keeps of an estimate what has a mass that an earlier push told, weighed by how well it agrees; how well all of it does.
fn of_mass(estimate: &mut Estimate, mass: Told) -> f64 {
    estimate.hypotheses.retain_mut(|found| {
        let Some(force) = found.from_force else { return true };
        let sd = mass.log_sd.hypot(force.mass_log_sd).hypot(SAME_MASS_LOG_SD);
        let off = (force.mass / mass.value).ln() / sd;
        found.probability *= (-0.5 * off * off).exp() / sd;
        off * off <= GATE
    });
    let likelihood: f64 = estimate.hypotheses.iter().map(|found| found.probability).sum();
    estimate.hypotheses.iter_mut().filter(|_| likelihood > 0.0).for_each(|found| found.probability /= likelihood);
    estimate.hypotheses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    likelihood
}

/// Which of many parts are worth a search, by how far each is from explaining the push at a first look
/// ([`first_look`](super::from_rest::first_look)).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shortlist {
    /// Places of those among the parts given, the nearest first.
    pub kept: Vec<usize>,
    /// Of those left out, the nearest first, with their misfits: costs over the largest that noise leaves once in a thousand times.
    pub left_out: Vec<(usize, f64)>,
}

impl Shortlist {
    /// Misfit of a part that is left out at least. A part that explains the push is below 1 after a first look (of 1,200 drawn pushes
    /// in all but 2): this leaves room for a fit that came to a minimum next to it.
    pub const MISFIT_MAX: f64 = 2.0;

    /// What costs so much more than the best is left out too: its evidence is a millionth of the best's, and if its minimum is
    /// lower than what the first look found, that of the others may be too.
    pub const BEHIND_MAX: f64 = 30.0;

    /// So many of the nearest are kept in any case: where nothing explains the push, a person wants to know what comes nearest.
    pub const KEPT_MIN: usize = 1;

    /// The list for first looks at all parts, by the same push.
    #[must_use]
    pub fn new(looks: &[Fit]) -> Self {
        let cost = |look: &Fit| look.cost.unwrap_or(f64::INFINITY);
        let misfit = |look: &Fit| cost(look) / look.cost_max;
        let mut ranked: Vec<_> = (0..looks.len()).collect();
        ranked.sort_by(|&a, &b| misfit(&looks[a]).total_cmp(&misfit(&looks[b])));
        let most = ranked.first().map_or(0.0, |&best| cost(&looks[best]) + Self::BEHIND_MAX);
        let is_near = |&&part: &&usize| misfit(&looks[part]) <= Self::MISFIT_MAX && cost(&looks[part]) <= most;
        let near = ranked.iter().filter(is_near).count();
        let left_out = ranked.split_off(near.max(Self::KEPT_MIN).min(ranked.len()));
        Self { kept: ranked, left_out: left_out.into_iter().map(|part| (part, misfit(&looks[part]))).collect() }
    }
}

/// Probability that a part is none of those that are known, before anything is felt: a new variant, a worn one, another batch.
const UNKNOWN_BEFOREHAND: f64 = 0.1;

/// By how much a part that resembles an unknown one may misfit, as a factor of the noise: anything up to this.
const MISFIT_MAX: f64 = 100.0;

/// Steps of the sum over that factor, each as likely.
const MISFIT_STEPS: usize = 400;

/// Probability that it was none of these parts, of which so many are known, however well the likeliest does among them; with what
/// it was beforehand: [`UNKNOWN_BEFOREHAND`], or what was said after an earlier push.
///
/// Of an unknown part nothing is predicted but that one which resembles it leaves residuals larger than the noise, by a
/// factor of which every order of magnitude is as likely. So a misfit that chance hardly gives speaks for it, though no
/// gate may exclude it. Of many known parts one resembles it closely: the smallest of so many factors counts, and of
/// hundreds the best explains an unknown part nearly as well as its own. 1 where no part explains the push.
#[must_use]
fn none_of_these(ranked: &[PartEstimate], known: usize, beforehand: f64) -> f64 {
    let possible = ranked.iter().filter(|part| part.probability > 0.0).map(|part| &part.estimate.fit);
    let best = possible.filter_map(|fit| Some((fit.cost?, fit.degrees_of_freedom))).min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((cost, values)) = best else { return 1.0 };
    // Likelihood of residuals f times the noise over that of the noise itself: f^-k exp(−c/2 (1/f² − 1)).
    let ratio = |index: usize| {
        let quantile = (index as f64 + 0.5) / MISFIT_STEPS as f64;
        // Of one factor, below which the smallest of all is with that probability: 1 − (1 − q)^(1/n).
        let of_one = -((-quantile).ln_1p() / known.max(1) as f64).exp_m1();
        let log = of_one * MISFIT_MAX.ln();
        (0.5 * cost * (1.0 - (-2.0 * log).exp()) - values as f64 * log).exp()
    };
    let ratio = (0..MISFIT_STEPS).map(ratio).sum::<f64>() / MISFIT_STEPS as f64;
    let (unknown, known) = (beforehand * ratio, 1.0 - beforehand);
    if unknown.is_finite() { unknown / (unknown + known) } else { 1.0 }
}

/// Probabilities from logarithms of evidence; all 0 where there is none.
fn shares(evidence: &[Option<f64>]) -> Vec<f64> {
    let most = evidence.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
    let share = |evidence: &Option<f64>| evidence.map_or(0.0, |evidence| (evidence - most).exp());
    let sum: f64 = evidence.iter().map(share).sum();
    evidence.iter().map(|evidence| if sum > 0.0 { share(evidence) / sum } else { 0.0 }).collect()
}

/// What several parts of one outline leave possible together, whichever it is: explanations of different parts that end
/// at one place are one, and its covariance holds how far they are apart.
///
/// None where no part explains the data, or where those that do differ in their symmetry, so that their poses do not
/// stand for the same. The order is that of [`which_part`]; goodness of fit and outliers are those of the likeliest.
#[must_use]
pub fn mixed(parts: &[PartEstimate], near: Nearness) -> Option<Estimate> {
    let possible = || parts.iter().filter(|part| !part.estimate.hypotheses.is_empty());
    let first = possible().next()?;
    if possible().any(|part| part.estimate.symmetry != first.estimate.symmetry) {
        return None;
    }
    let least = possible().filter_map(|part| part.estimate.fit.cost).fold(f64::INFINITY, f64::min);
    let weighted = possible().flat_map(|part| {
        let listed = part.estimate.hypotheses.iter().filter(move |found| found.cost <= least + GATE);
        listed.map(|found| Hypothesis { probability: part.probability * found.probability, ..found.clone() })
    });
    let mut all = joined(weighted, near);
    let sum: f64 = all.iter().map(|found| found.probability).sum();
    all.iter_mut().for_each(|found| found.probability /= sum);
    all.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    Some(Estimate { hypotheses: all, ..first.estimate.clone() }).filter(|mixed| !mixed.hypotheses.is_empty())
}

/// An explanation's part in the evidence.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Weight {
    /// Squared residuals in standard deviations.
    cost: f64,
    /// Of contact angle (rad) and place (m) at the end.
    covariance: Matrix2<f64>,
}

impl Weight {
    fn log(&self) -> f64 {
        TAU.ln() + 0.5 * (self.covariance.determinant().ln() - self.cost)
    }
}

/// What an estimate's hypotheses bring to the evidence; those whose place is free bring none.
fn weights(estimate: &Estimate) -> impl Iterator<Item = Weight> + '_ {
    estimate.hypotheses.iter().filter_map(|hypothesis| {
        let covariance = hypothesis.state_covariance?.fixed_view::<2, 2>(0, 0).into();
        Some(Weight { cost: hypothesis.cost, covariance })
    })
}

/// Logarithm of a part's evidence, up to what all parts share; none without an explanation.
fn log_evidence(part: &Part, weights: impl Iterator<Item = Weight>) -> Option<f64> {
    let logarithms: Vec<_> = weights.map(|weight| weight.log()).filter(|log| log.is_finite()).collect();
    let most = logarithms.iter().copied().reduce(f64::max)?;
    let sum: f64 = logarithms.iter().map(|log| (log - most).exp()).sum();
    Some(most + sum.ln() - perimeter(part).ln())
}

fn perimeter(part: &Part) -> f64 {
    part.polygon().edges().map(|(from, to)| (to - from).norm()).sum()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use nalgebra::{Point2, Vector2};
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::pushing::dynamics::{ContactLaw, EdgeEnd, Finger, Mass, Push, PushModel, Start, State};
    use crate::pushing::estimation::hypotheses::FromForce;
    use crate::pushing::estimation::{Channel, Known, Measured, Observation, Observer as _, Prior, SAME_END_M, Touch};

    const MU_G: f64 = 0.3 * 9.81;
    const DT: f64 = 0.01; // s
    const SIGMA: f64 = 0.001_95; // rad
    const FINGER: Finger = Finger {
        radius: 0.01,
        centre0: Point2::new(0.0, 0.0),
        velocity0: Vector2::new(0.0, 0.05),
        acceleration: Vector2::new(0.06, 0.0),
    };

    fn part(corners: &[[f64; 2]]) -> Part {
        Part::uniform(SimplePolygon::new(corners.iter().copied().map(Point2::from).collect::<Vec<_>>()).unwrap())
    }

    fn rectangle(width: f64, height: f64) -> Part {
        part(&[[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    }

    fn known(part: &Part) -> Known<'_> {
        Known { part, mu_g: MU_G, finger: FINGER, touch: Touch::Rolling { friction: None } }
    }

    /// Exact angles of a part that is pushed at edge 0.
    fn push(part: &Part) -> Observation {
        let model = PushModel { part, edge: part.edge(0).unwrap(), mu_g: MU_G, finger: FINGER };
        let start = Start::Moving(State { u: FRAC_PI_2, s: 0.006, omega: 0.0, v_t: 0.0 });
        let law = ContactLaw::Rolling { friction: None };
        let times: Vec<_> = (0..61).map(|i| f64::from(i) * DT).collect();
        let run = Push::new(model, law, start, EdgeEnd::Stop).unwrap().run(&times).unwrap();
        let values = run.samples.iter().map(|sample| sample.state.u).collect();
        let prior = Prior { omega0_sigma: Some(1.0), ..Prior::default() };
        Observation { dt: DT, measured: Measured::ContactAngle(Channel { values, sigma: SIGMA }), prior }
    }

    /// A part's answer that fits with such a cost.
    fn fitting(cost: f64, values: usize) -> PartEstimate {
        let fit = Fit { cost: Some(cost), degrees_of_freedom: values, cost_max: 2.0 * values as f64 };
        PartEstimate { part: 0, probability: 1.0, estimate: Estimate::unexplained(fit, 0.5) }
    }

    #[test]
    fn the_best_of_several_parts_may_be_none_of_them() {
        let values = 58;
        let none = [0.8, 1.0, 1.3, 1.64, 2.0]
            .map(|share| none_of_these(&[fitting(share * 58.0, values)], 1, UNKNOWN_BEFOREHAND));
        assert!(none[0] < 0.01 && none[1] < 0.02, "{none:?}");
        assert!(none.windows(2).all(|pair| pair[0] < pair[1]), "{none:?}");
        // The limit of chance (1.64 at 58 values) is no limit of belief; beyond it nothing else is left.
        assert!(none[3] > 0.2 && none[4] > 0.9, "{none:?}");
        assert!((none_of_these(&[], 1, UNKNOWN_BEFOREHAND) - 1.0).abs() < f64::EPSILON);
        // However many are known, one that fits makes none of them no likelier than it was beforehand; of hundreds nearly as likely.
        let of = |known: usize| none_of_these(&[fitting(0.9 * 58.0, values)], known, UNKNOWN_BEFOREHAND);
        let among = [1, 10, 100, 10_000].map(of);
        assert!(among.is_sorted() && among[0] < 0.01 && among[3] < UNKNOWN_BEFOREHAND, "{among:?}");
        assert!(among[3] > 0.9 * UNKNOWN_BEFOREHAND, "{among:?}");
    }

    #[test]
    fn the_part_that_was_pushed_is_named_whichever_it_is() {
        let parts = [rectangle(0.06, 0.04), rectangle(0.08, 0.02), part(&[[0.0, 0.0], [0.07, 0.0], [0.02, 0.05]])];
        let all = parts.each_ref().map(known);
        for (truth, part) in parts.iter().enumerate() {
            let ranked = which_part(all.iter().map(|known| (known.part, known.estimate(&push(part)))));
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
            let ranked = which_part(all.iter().map(|known| (known.part, known.estimate(&push(part)))));
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
        let measured = Observation { dt, measured, prior };
        let ranked = which_part(all.iter().map(|known| (known.part, known.estimate(&measured))));
        assert!(ranked.iter().all(|part| part.probability < 0.95), "{ranked:?}");
        let alone: Vec<_> = ranked.iter().map(|part| (part.probability, part.estimate.clone())).collect();
        let mixed = mixed(&ranked, Nearness::BY_PLACE).unwrap();
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
                    let off = member.pose_end.theta - found.pose_end.theta;
                    share / weight * (member.covariance.unwrap().m33 + off * off)
                })
                .sum();
            let got = found.covariance.unwrap().m33;
            assert!((got / wanted - 1.0).abs() < 1e-6, "{got} {wanted}");
        }
    }

    proptest! {
        #[test]
        fn a_shortlist_has_each_part_once_and_all_that_come_near(costs in prop::collection::vec(1.0_f64..1e3, 0..40)) {
            let cost_max = 100.0;
            let look = |cost: &f64| Fit { cost: Some(*cost), degrees_of_freedom: 60, cost_max };
            let Shortlist { kept, left_out } = Shortlist::new(&costs.iter().map(look).collect::<Vec<_>>());
            let mut all: Vec<_> = kept.iter().copied().chain(left_out.iter().map(|(part, _)| *part)).collect();
            prop_assert!(all.iter().map(|&part| costs[part]).is_sorted(), "{:?} {:?}", kept, left_out);
            let best = all.first().map_or(0.0, |&part| costs[part]);
            let is_near = |part: usize| {
                costs[part] <= Shortlist::MISFIT_MAX * cost_max && costs[part] <= best + Shortlist::BEHIND_MAX
            };
            all.sort_unstable();
            prop_assert_eq!(all, (0..costs.len()).collect::<Vec<_>>());
            prop_assert!(left_out.iter().all(|&(part, misfit)| !is_near(part) && (misfit * cost_max - costs[part]).abs() < 1e-9));
            prop_assert!(kept.len() <= Shortlist::KEPT_MIN || kept.iter().all(|&part| is_near(part)));
            prop_assert!(kept.len() >= costs.len().min(Shortlist::KEPT_MIN));
        }
    }

    #[test]
    fn what_an_earlier_push_said_counts_as_much() {
        let (long, short) = (rectangle(0.08, 0.04), rectangle(0.06, 0.04));
        let parts = [&short, &short, &long];
        let measured = push(&short);
        let felt = |places: [usize; 2], belief: &PartBelief| {
            belief.after(places.map(|place| (place, parts[place], known(parts[place]).estimate(&measured))))
        };
        // The first and the second are alike; the push excludes the third.
        let part = |probability: f64| PossiblePart { probability, mass: None };
        let before = PartBelief { parts: [0.2, 0.3, 0.5].map(part).to_vec(), none: 0.5 };
        let told = |belief: &PartBelief| belief.parts.iter().map(|part| part.probability).collect::<Vec<_>>();
        let (ranked, after) = felt([2, 1], &before);
        assert_eq!(told(&after), [0.0, 1.0, 0.0]);
        assert_eq!(ranked.iter().map(|part| part.part).collect::<Vec<_>>(), [1, 2]);
        let (ranked, after) = felt([0, 1], &before);
        assert!((told(&after)[0] - 0.4).abs() < 1e-9 && (told(&after)[1] - 0.6).abs() < 1e-9, "{after:?}");
        assert_eq!(ranked[0].part, 1);
        assert!(after.none < before.none, "{after:?}");
        assert_eq!(after.possible().collect::<Vec<_>>(), [0, 1]);
        // What nothing explains is none of them, however likely they were.
        let (_, none) = felt([2, 2], &before);
        assert!(none.possible().next().is_none() && (none.none - 1.0).abs() < 1e-12, "{none:?}");
        // None of them was as likely as not: what fits well makes it less so, what does not more.
        let none = [30.0, 110.0].map(|cost| none_of_these(&[fitting(cost, 58)], 1, 0.5));
        assert!(none[0] < 0.5 && none[1] > 0.5, "{none:?}");
    }

    #[test]
    fn two_pushes_of_one_part_have_its_mass_in_common() {
        // Two explanations, of 0.5 kg within 1 % and of 0.6 kg, as likely as each other.
        let part = rectangle(0.06, 0.04);
        let estimate = known(&part).estimate(&push(&part));
        let with = |mass: f64| Hypothesis {
            from_force: Some(FromForce {
                mass,
                mass_log_sd: 0.01,
                resistance_log_sd: 0.01,
                mu_c: None,
                mu_c_sd: None,
                friction_needed: 0.1,
            }),
            probability: 0.5,
            ..estimate.hypotheses[0].clone()
        };
        let felt = Estimate { hypotheses: vec![with(0.6), with(0.5)], ..estimate.clone() };
        let after = |belief: &PartBelief| belief.after([(0, &part, felt.clone()), (1, &part, felt.clone())]);
        let (_, first) = after(&PartBelief::beforehand(2));
        let mass = first.parts[0].mass.unwrap();
        // Moments of the two, by the law of total variance.
        let half = 0.5 * 1.2_f64.ln();
        let off = (mass.value.ln() - 0.3_f64.ln() * 0.5).abs().max((mass.log_sd - half.hypot(0.01)).abs());
        assert!(off < 1e-9, "{mass:?}");
        assert!(first.parts.iter().all(|part| (part.probability - 0.5).abs() < 1e-9), "{first:?}");
        // Of one that weighed 0.51 kg before the heavier explanation is left out; one that weighed 0.8 kg is excluded.
        let weighed = |kg: f64| PossiblePart { probability: 0.5, mass: Some(Told { value: kg, log_sd: 0.01 }) };
        let (ranked, second) = after(&PartBelief { parts: vec![weighed(0.8), weighed(0.51)], none: 0.1 });
        assert_eq!(second.possible().collect::<Vec<_>>(), [1]);
        let masses = ranked[0].estimate.hypotheses.iter().map(|found| found.from_force.unwrap().mass);
        assert_eq!(masses.collect::<Vec<_>>(), [0.5]);
        assert!(ranked[1].estimate.hypotheses.is_empty(), "{ranked:?}");
    }

    #[test]
    fn parts_that_are_alike_share_the_probability() {
        let parts = [rectangle(0.06, 0.04), rectangle(0.06, 0.04)];
        let measured = push(&parts[0]);
        let ranked = which_part(parts.each_ref().map(|part| (part, known(part).estimate(&measured))));
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
        let shares = shares(&[none, one, both]);
        let wanted = (1.0 + (-1.0_f64).exp()) / (1.0 + 2.0 * (-1.0_f64).exp());
        assert!((shares[2] - wanted).abs() < 1e-12 && (shares[1] - (1.0 - wanted)).abs() < 1e-12, "{shares:?}");
        assert!(shares[0].abs() < 1e-300, "{shares:?}");
    }

    #[test]
    fn if_no_part_explains_the_data_none_is_named() {
        assert!(shares(&[None, None]).iter().all(|share| share.abs() < 1e-300));
    }
}
