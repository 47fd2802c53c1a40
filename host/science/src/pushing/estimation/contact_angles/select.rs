//! From seeds to the set of hypotheses that the data cannot exclude.
//!
//! All candidates go down side by side, a step each in turn; those whose cost will stay far above the best are given
//! up, those that meet are one. What remains is fitted to the data as they are and judged: by the laws of contact, by
//! the gate above the best cost, and the best by chi-square.
//!
//! Units: costs of no dimension. Errors: none.

use std::f64::consts::TAU;

use nalgebra::Vector5;

use super::clock::{Fineness, count};
use super::contact_intervals::contact_intervals;
use super::covariance::{is_wide, pose_covariance, state_covariance};
use super::data::Data;
use super::fit::{Candidate, Descent, Fitting, Given, STEP_MAX};
use super::initial_state::{MU_G, PLACE, StartMode, UNKNOWNS};
use super::path::ContactInterval;
use super::seed::{Width, angles, seeds, settling};
use crate::math::statistics::chi_square_quantile;
use crate::pushing::estimation::hypotheses::{Estimate, Fit, GATE, Hypothesis, Nearness, SAME_END_M, pose};
use crate::pushing::estimation::observation::{Known, Observation, Prior};
use crate::pushing::estimation::which_part::{mixed, which_part};
use crate::search::{Effort, Halt, Searched, Stop, never};

/// Probability with which data of the model pass the test of fit. Fixed by the interface.
const FIT_PROBABILITY: f64 = 0.999;

/// Standard deviation to begin with at least, rad: with less, far starts have costs beyond all comparison, and steps
/// would have to be fine before it is known where they matter.
const SIGMA_FIRST: f64 = 1e-3;

/// Standard deviation of forces to begin with, in their own: their valleys in angle and place are long and narrow.
const SETTLED_SIGMAS: f64 = 10.0;

/// From there to the data's own standard deviation by steps of this: where little is known, minima lie in valleys that
/// grow narrow as it falls, and are followed rather than looked for.
const SIGMA_RATIO: f64 = 10.0;

/// Where in such a valley to look, in standard deviations from its lowest place.
const VALLEY_PLACES: [f64; 5] = [0.0, -2.0, -1.0, 1.0, 2.0];

/// The same where a minimum explains the data poorly.
const FAR_PLACES: [f64; 6] = [-16.0, -8.0, -4.0, 4.0, 8.0, 16.0];

/// Where in the valley of a minimum that may be listed to look for another, in standard deviations: a parabola is far
/// out of the gate there.
const BESIDE_PLACES: [f64; 4] = [-10.0, -5.0, 5.0, 10.0];

/// Data of the model have a cost below that of a poor fit with this probability.
const POOR_PROBABILITY: f64 = 0.95;

/// Step over the time in which friction forgets speed, for a standard deviation of [`SIGMA_OF_SHARE`]; finer as its
/// fourth root, like the error of the steps.
const SHARE: f64 = 0.9;
/// Standard deviation of the angles for [`SHARE`], rad.
const SIGMA_OF_SHARE: f64 = 2e-3;
/// Steps that keep the slowest parts stable.
const SHARE_MAX: f64 = 1.0;

/// Error of angles after a start from rest, in standard deviations.
pub(super) const REST_ERROR: f64 = 0.05;

/// Steps are halved at most so often, as long as costs change by more than [`ROUGH`]: errors are then 65,000 times
/// smaller, and what still changes is a contact at a change of mode.
const FINER_MAX: i32 = 4;
/// Change of costs above which steps are halved once more; see [`FINER_MAX`].
const ROUGH: f64 = 0.3;

/// Rounds of descent: a step each.
const ROUNDS_MAX: usize = 60;

/// A descent is over when its next step is predicted to lower the cost by less than this.
const PREDICTED_REDUCTION_NONE: f64 = 1e-3;

/// So it is after so many steps in a row that lowered the cost by less than [`STALLED_SHARE`](super::fit::STALLED_SHARE)
/// of it, whatever was predicted: where a part hardly moves at first, slopes are not to be trusted.
const STALLED_MAX: usize = 3;

/// A descent is given up when its cost less this many times its predicted reduction is beyond the gate by [`SLACK`], and
/// would be after [`GEOMETRIC_ROUNDS`] too: steps are limited, and from afar many of them are needed.
const PREDICTED_REDUCTIONS: f64 = 3.0;
/// Rounds for which a descent is trusted to go on lowering its cost by the same factor.
const GEOMETRIC_ROUNDS: i32 = 8;
/// How far beyond the gate a cost must be predicted to stay; see [`PREDICTED_REDUCTIONS`].
const SLACK: f64 = 24.0;
/// Rounds in which places along a valley have to come to its lowest, or to another: more than any that is not in a
/// valley takes.
const PATIENCE: usize = 12;

/// Rounds before any descent is given up.
const ROUNDS_MIN: usize = 2;

/// Descents on one interval that are as near as this (angle in rad, place in m) and go on alike are one.
const MET: [f64; UNKNOWNS] = [2e-3, 2e-4, 0.1, 2e-3, 0.02];

/// Where nothing explains them, one of so many contact angles may be left out: with fewer, anything is explained
/// without some of them; with more, wrong ones stand out among their neighbours.
const SPARSE: (usize, usize) = (9, 30);

/// It must cost so much more to explain it with the others: ten standard deviations, squared.
const GROSS: f64 = 100.0;

/// A constraint may give way by so much, in its own measure: 50 µm of an edge.
const OVERRUN_MAX: f64 = 5.0;

/// Times that constraints are made ten times as stiff for a minimum that leans on one.
const STIFFER_MAX: i32 = 4;

/// Every pose and motion that explains an observation.
///
/// Where nothing does, values that no smooth motion passes through are left out, as long as they are few; among few
/// values, where none stands out, that one without which the others are explained. The estimate names them.
#[must_use]
pub fn estimate(known: &Known, observation: &Observation) -> Estimate {
    estimate_until(known, observation, &never).found
}

/// The same, ended when `stop` says so: then with the explanations that were found and fitted by then, often none.
#[must_use]
pub fn estimate_until(known: &Known, observation: &Observation, stop: Stop<'_>) -> Searched<Estimate> {
    let halt = Halt::new(stop);
    let estimate = halting_estimate(known, observation, &halt);
    halt.searched(estimate)
}

/// [`estimate_until`], for several searches that halt together.
pub(super) fn halting_estimate(known: &Known, observation: &Observation, halt: &Halt<'_>) -> Estimate {
    let effort = Effort::new(halt);
    let task = Task::new(known, observation, &effort);
    let outliers = || task.data.outliers();
    // A part that has not yet forgotten its start turns less smoothly than an outlier's neighbours should.
    let is_early = |value: usize| count(value) * observation.dt < settling(known, &task.data).unwrap_or(0.0);
    let without = |outliers: Vec<usize>| {
        let task = Task { data: task.data.without(&outliers), ..task.clone() };
        let found = || task.explained(Width::Narrow).or_else(|| task.explained(Width::Wide));
        if outliers.is_empty() { None } else { found().map(|found| Estimate { outliers, ..found }) }
    };
    let found = task
        .explained(Width::Narrow)
        .or_else(|| without(outliers()?.into_iter().filter(|&value| !is_early(value)).collect()))
        .unwrap_or_else(|| {
            let wide = task.conclude(task.minima(Width::Wide));
            // Those that are not early were left out before.
            let early = || outliers().filter(|outliers| outliers.iter().any(|&value| is_early(value)));
            let fewer = || task.without_one().or_else(|| without(early()?));
            if wide.hypotheses.is_empty() { fewer().unwrap_or(wide) } else { wide }
        });
    Estimate { simulations: effort.simulations(), ..found }
}

/// Steps fine enough for a standard deviation (rad), or finer by a factor.
pub(super) fn fineness(sigma: f64, factor: f64) -> Fineness {
    let share = factor * (SHARE * (sigma / SIGMA_OF_SHARE).powf(0.25)).min(SHARE_MAX);
    Fineness { share, on_values: false }
}

/// What all steps of an estimate need.
#[derive(Clone)]
struct Task<'a, 'p> {
    known: &'a Known<'p>,
    observation: &'a Observation,
    data: Data,
    contact_intervals: Vec<ContactInterval>,
    start_modes: Vec<StartMode>,
    effort: &'a Effort<'a>,
    halt: &'a Halt<'a>,
}

impl<'a, 'p> Task<'a, 'p> {
    fn new(known: &'a Known<'p>, observation: &'a Observation, effort: &'a Effort<'a>) -> Self {
        let contact_intervals = contact_intervals(known.part, known.finger.radius, effort.halt());
        Self {
            known,
            observation,
            data: Data::new(observation),
            contact_intervals,
            start_modes: StartMode::all(known),
            effort,
            halt: effort.halt(),
        }
    }

    /// Takes all candidates down until one should halt.
    fn descend(&self, fitting: &Fitting, candidates: &[Candidate]) -> Vec<Descent> {
        descend_together(fitting, candidates, self.halt)
    }

    /// An estimate that explains the data; none where a search of this width finds nothing that does.
    fn explained(&self, width: Width) -> Option<Estimate> {
        let mut minima = self.minima(width);
        self.look_farther(&mut minima);
        let cost_max = chi_square_quantile(FIT_PROBABILITY, self.data.terms());
        // What does not fit coarse data does not fit exact ones; what does, may not.
        let fits = minima.iter().any(|descent| descent.evaluation.cost <= cost_max);
        fits.then(|| self.conclude(minima)).filter(|found| !found.hypotheses.is_empty())
    }

    /// What explains all values but one, if they are few contact angles: each is left out in turn. The estimate holds
    /// what is left possible by whichever it was, and names the likeliest.
    fn without_one(&self) -> Option<Estimate> {
        if self.data.angle.is_none() || !(SPARSE.0..=SPARSE.1).contains(&self.data.terms()) {
            return None;
        }
        let with_all = least_cost(&self.minima(Width::Narrow));
        let values = (0..self.data.values).take_while(|_| !self.halt.is_wished());
        let explained = values.filter_map(|value| {
            let task = Task { data: self.data.without(&[value]), ..self.clone() };
            let found = Estimate { outliers: vec![value], ..task.explained(Width::Narrow)? };
            // A wrong part is off by a little everywhere, a wrong value by much in one place.
            found.fit.cost.filter(|cost| with_all > cost + GROSS)?;
            Some((self.known.part, found))
        });
        mixed(&which_part(explained), Nearness::BY_PLACE)
    }

    /// Adds what lies farther along the valleys of minima that explain the data, but poorly: the better one beside it
    /// may have been missed.
    fn look_farther(&self, minima: &mut Vec<Descent>) {
        let best = least_cost(minima);
        let [poor, wrong] =
            [POOR_PROBABILITY, FIT_PROBABILITY].map(|share| chi_square_quantile(share, self.data.terms()));
        if best > poor && best <= wrong {
            let fitting = self.coarse();
            minima.extend(self.descend(&fitting, &along_valleys(&fitting, minima, &FAR_PLACES)));
            merge_met(minima);
        }
    }

    /// The minima of the cost at the standard deviation to begin with.
    fn minima(&self, width: Width) -> Vec<Descent> {
        if self.halt.is_wished() {
            return Vec::new();
        }
        let fitting = self.coarse();
        let Some(settled) = self.settled(&fitting).filter(|_| width == Width::Narrow) else {
            let candidates = seeds(&fitting, &self.contact_intervals, &self.start_modes, width);
            return self.descend(&fitting, &candidates);
        };
        let candidates = seeds(&settled, &self.contact_intervals, &self.start_modes, width);
        let minima = self.descend(&settled, &candidates);
        self.descend(&fitting, &along_valleys(&settled, &minima, &VALLEY_PLACES))
    }

    /// Without the values before the part has settled, where the angle is not felt: those tell the first rates, but
    /// lead astray as long as the place is not known.
    fn settled(&self, fitting: &Fitting<'a, 'p>) -> Option<Fitting<'_, 'p>> {
        let is_measured = |start_mode: &StartMode| angles(self.known, &self.data, *start_mode).is_some();
        let time = settling(self.known, &self.data).filter(|_| !self.start_modes.iter().all(is_measured))?;
        let coarse = self.fitting(SETTLED_SIGMAS * fitting.data.sigma_min(), 1.0);
        Some(Fitting { data: coarse.data.without_first(time), ..coarse })
    }

    /// With the standard deviation to begin with.
    fn coarse(&self) -> Fitting<'_, 'p> {
        self.fitting(self.data.sigma_min().max(SIGMA_FIRST), 1.0)
    }

    /// With angles of at least a standard deviation and steps fine enough for it, or finer by a factor.
    fn fitting(&self, sigma: f64, factor: f64) -> Fitting<'_, 'p> {
        let data = self.data.with_sigma_floor(sigma);
        let prior = self.observation.prior;
        let given = Given { known: self.known, data, prior };
        Fitting::new(given, fineness(sigma, factor), REST_ERROR * factor * sigma, self.effort)
    }

    /// Adds what lies along the valleys of minima that may be listed, beyond where a parabola would be out of the gate:
    /// a part that can slide along the finger may have begun in two ways that lead to nearly the same.
    fn look_beside(&self, fitting: &Fitting, minima: &mut Vec<Descent>) {
        let slides = minima.iter().filter(|descent| descent.evaluation.candidate.start_mode.unknowns() > PLACE + 2);
        let sliding: Vec<_> = slides.cloned().collect();
        let most = least_cost(minima) + GATE;
        let mut beside = along_valleys(fitting, &sliding, &BESIDE_PLACES);
        beside.retain(|candidate| fitting.cost(candidate).is_some_and(|cost| cost <= most));
        if !beside.is_empty() {
            minima.extend(self.descend(fitting, &beside));
            merge_met(minima);
        }
    }

    /// Drops minima that cannot be listed, because then the best would not explain the data either: they are as costly
    /// to refine as others, and more so where they lie on constraints.
    fn forget_hopeless(&self, minima: &mut Vec<Descent>) {
        let most = chi_square_quantile(FIT_PROBABILITY, self.data.terms() + UNKNOWNS) + GATE + SLACK;
        let is_possible = |descent: &Descent| descent.evaluation.total() <= most;
        if minima.iter().any(is_possible) {
            minima.retain(is_possible);
        }
    }

    /// Follows minima to the data as they are, and judges them.
    fn conclude(&self, mut minima: Vec<Descent>) -> Estimate {
        let (least, mut sigma) = (self.data.sigma_min(), SIGMA_FIRST);
        let mut fitting = self.fitting(sigma, 1.0);
        // Rounding apart.
        while sigma > 1.001 * least {
            let candidates = along_valleys(&fitting, &minima, &VALLEY_PLACES);
            sigma = (sigma / SIGMA_RATIO).max(least);
            fitting = self.fitting(sigma, 1.0);
            minima = descend_patiently(&fitting, &candidates, PATIENCE, self.halt);
        }
        self.look_beside(&fitting, &mut minima);
        self.forget_hopeless(&mut minima);
        let mut power = 1;
        loop {
            let finer = self.fitting(least, 0.5_f64.powi(power));
            let (mut same, mut rough) = (Vec::new(), Vec::new());
            for descent in minima {
                match polished(&finer, &descent) {
                    Some(polished) => same.push(polished),
                    None => rough.push(descent),
                }
            }
            // What has come to its minimum by then is judged; the others are dropped.
            let halted = self.halt.is_wished();
            let is_last = rough.is_empty() || power == FINER_MAX || halted;
            minima = same;
            if !rough.is_empty() && !halted {
                minima.extend(self.again(&finer, &rough));
                merge_met(&mut minima);
            }
            if is_last {
                return judge_all(&finer, &minima, self.start_modes.len());
            }
            power += 1;
        }
    }

    /// Descents that go on from where others ended.
    fn again(&self, fitting: &Fitting, descents: &[Descent]) -> Vec<Descent> {
        let candidates: Vec<_> = descents.iter().map(|descent| descent.evaluation.candidate).collect();
        self.descend(fitting, &candidates)
    }
}

/// Infinity where there is none.
pub(super) fn least_cost(minima: &[Descent]) -> f64 {
    minima.iter().map(|descent| descent.evaluation.cost).fold(f64::INFINITY, f64::min)
}

/// A descent of a larger total comes to nothing beside these.
pub(super) fn total_max<'a>(minima: impl IntoIterator<Item = &'a Descent>) -> f64 {
    minima.into_iter().map(|descent| descent.evaluation.total()).fold(f64::INFINITY, f64::min) + GATE + SLACK
}

/// Minima, and places beside each along what the data say least about: with a smaller standard deviation the minimum
/// may be there, or turn out to be two.
fn along_valleys(fitting: &Fitting, minima: &[Descent], places: &[f64]) -> Vec<Candidate> {
    // Finer data cost more, not less.
    let most = total_max(minima);
    let possible = minima.iter().filter(|descent| descent.evaluation.total() <= most);
    let candidates = possible.flat_map(|descent| {
        let (lowest, valley) = (descent.evaluation.candidate, valley(fitting, descent).unwrap_or_else(Vector5::zeros));
        let at = move |share: f64| (Vector5::from(lowest.unknowns) + valley * share).into();
        places.iter().map(move |&share| Candidate { unknowns: at(share), ..lowest })
    });
    candidates.collect()
}

/// The longest axis of what the data leave open, one standard deviation long; none where they leave everything.
fn valley(fitting: &Fitting, descent: &Descent) -> Option<Vector5<f64>> {
    let sizes = Vector5::from(STEP_MAX);
    let (covariance, _) = fitting.spread(descent)?;
    let axes = covariance.component_div(&(sizes * sizes.transpose())).symmetric_eigen();
    let longest = axes.eigenvalues.imax();
    Some(axes.eigenvectors.column(longest).component_mul(&sizes) * axes.eigenvalues[longest].max(0.0).sqrt())
}

/// A step further down with finer steps; none if those see another cost.
fn polished(finer: &Fitting, descent: &Descent) -> Option<Descent> {
    let mut polished = finer.descend(descent.evaluation.candidate)?;
    let rough = (polished.evaluation.total() - descent.evaluation.total()).abs() > ROUGH;
    finer.improve(&mut polished);
    (!rough).then_some(polished)
}

/// Takes all candidates down, and gives up those that cannot come near the best, until one should halt: what has not
/// come to its minimum by then is dropped.
pub(super) fn descend_together(fitting: &Fitting, candidates: &[Candidate], halt: &Halt<'_>) -> Vec<Descent> {
    descend_patiently(fitting, candidates, ROUNDS_MAX, halt)
}

/// The same. After some rounds those are given up too that lie above a minimum on their own edge: they creep along its
/// valley.
fn descend_patiently(fitting: &Fitting, candidates: &[Candidate], patience: usize, halt: &Halt<'_>) -> Vec<Descent> {
    let begun = candidates.iter().take_while(|_| !halt.is_wished());
    let mut alive: Vec<_> = begun.filter_map(|candidate| fitting.descend(*candidate)).collect();
    let mut over: Vec<Descent> = Vec::new();
    for round in 0..ROUNDS_MAX {
        if halt.is_wished() {
            alive.clear();
        }
        let most = total_max(alive.iter().chain(&over));
        if round >= ROUNDS_MIN {
            alive.retain(|descent| may_come_below(descent, most));
        }
        if round >= patience {
            alive.retain(|descent| !over.iter().any(|minimum| is_above(descent, minimum)));
        }
        if alive.is_empty() {
            break;
        }
        let mut going = Vec::new();
        for mut descent in alive {
            let moved = fitting.improve(&mut descent);
            if !moved || descent.predicted_reduction < PREDICTED_REDUCTION_NONE || descent.stalled >= STALLED_MAX {
                over.push(descent)
            } else {
                going.push(descent)
            }
        }
        alive = going;
        if round >= ROUNDS_MIN {
            merge_met(&mut alive);
        }
    }
    over.extend(alive);
    merge_met(&mut over);
    over
}

/// Whether a descent may still come below a total: by what the next steps are predicted to bring, or by going on as fast
/// as it went.
fn may_come_below(descent: &Descent, most: f64) -> bool {
    let total = descent.evaluation.total();
    let predicted = total - PREDICTED_REDUCTIONS * descent.predicted_reduction;
    predicted.min(total * descent.last_ratio.powi(GEOMETRIC_ROUNDS)) <= most
}

fn is_above(descent: &Descent, minimum: &Descent) -> bool {
    let (a, b) = (&descent.evaluation.candidate, &minimum.evaluation.candidate);
    a.interval == b.interval && a.start_mode == b.start_mode && descent.evaluation.total() > minimum.evaluation.total()
}

/// Keeps the lowest of descents that have met.
pub(super) fn merge_met(descents: &mut Vec<Descent>) {
    descents.sort_by(|a, b| a.evaluation.total().total_cmp(&b.evaluation.total()));
    let mut kept: Vec<Descent> = Vec::new();
    for descent in descents.drain(..) {
        if !kept.iter().any(|other| have_met(&descent.evaluation.candidate, &other.evaluation.candidate)) {
            kept.push(descent);
        }
    }
    *descents = kept;
}

fn have_met(a: &Candidate, b: &Candidate) -> bool {
    let near = |i: usize| (a.unknowns[i] - b.unknowns[i]).abs() < MET[i];
    a.interval == b.interval && a.start_mode == b.start_mode && (0..a.start_mode.unknowns()).chain([MU_G]).all(near)
}

/// Stiffens the constraints until the minimum lies on them; none if it cannot.
fn onto_constraints(fitting: &Fitting, descent: &Descent) -> Option<Descent> {
    let mut descent = descent.clone();
    for power in 1..=STIFFER_MAX {
        if descent.evaluation.overrun <= OVERRUN_MAX {
            return Some(descent);
        }
        let stiffer = Fitting { constraint_stiffness: 10_f64.powi(power), ..fitting.clone() };
        descent = stiffer.descend(descent.evaluation.candidate)?;
        for _ in 0..ROUNDS_MAX {
            if !stiffer.improve(&mut descent) || descent.predicted_reduction < PREDICTED_REDUCTION_NONE {
                break;
            }
        }
    }
    (descent.evaluation.overrun <= OVERRUN_MAX).then_some(descent)
}

/// Judges which minima explain the data.
pub(super) fn judge_all(fitting: &Fitting, descents: &[Descent], start_modes: usize) -> Estimate {
    let mut possible: Vec<_> = descents.iter().filter_map(|descent| onto_constraints(fitting, descent)).collect();
    possible.sort_by(|a, b| a.evaluation.cost.total_cmp(&b.evaluation.cost));
    let degrees = |descent: &Descent| {
        let unknowns = fitting.free(descent).iter().filter(|free| **free).count();
        (fitting.data.terms() + fitting.prior_terms(&descent.evaluation.candidate)).saturating_sub(unknowns)
    };
    let cost = possible.first().map(|best| best.evaluation.cost);
    let degrees_of_freedom = possible.first().map_or(fitting.data.terms(), degrees);
    let fit = Fit { cost, degrees_of_freedom, cost_max: chi_square_quantile(FIT_PROBABILITY, degrees_of_freedom) };
    let Some(best) = cost.filter(|cost| *cost <= fit.cost_max.max(COST_OF_NO_DATA)) else {
        return Estimate::unexplained(fit, fitting.data.duration());
    };
    possible.retain(|descent| descent.evaluation.cost <= best + GATE);
    let mut judged: Vec<Judged> = Vec::new();
    for descent in &possible {
        let next = judge(fitting, descent, start_modes);
        // A curved valley along which nobody could go is not known as well as its covariance would say.
        if fitting.goes_on().is_none() && is_wide(fitting, descent) {
            continue;
        }
        if !judged.iter().any(|other| are_one(other, &next)) {
            judged.push(next);
        }
    }
    let mu_g_log_sd = fitting.prior.mu_g_log_sigma;
    Estimate { hypotheses: by_probability(judged), mu_g_log_sd, ..Estimate::unexplained(fit, fitting.data.duration()) }
}

/// A cost that counts as none where there are no more data than unknowns: what steps and constraints leave.
const COST_OF_NO_DATA: f64 = 1e-2;

/// A hypothesis and the logarithm of its evidence.
struct Judged {
    hypothesis: Hypothesis,
    log_evidence: f64,
    place: (f64, f64),
}

fn are_one(a: &Judged, b: &Judged) -> bool {
    let (x, y) = (&a.hypothesis, &b.hypothesis);
    let continuum = x.covariance.is_none() && y.covariance.is_none() && a.place == b.place;
    x.side == y.side && ((x.end.s - y.end.s).abs() < SAME_END_M || continuum)
}

fn by_probability(mut judged: Vec<Judged>) -> Vec<Hypothesis> {
    judged.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let most = judged.first().map_or(0.0, |first| first.log_evidence);
    let weights: Vec<_> = judged.iter().map(|judged| (judged.log_evidence - most).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let shares = judged.into_iter().zip(weights);
    shares.map(|(judged, weight)| Hypothesis { probability: weight / sum, ..judged.hypothesis }).collect()
}

fn judge(fitting: &Fitting, descent: &Descent, start_modes: usize) -> Judged {
    let (evaluation, candidate) = (&descent.evaluation, &descent.evaluation.candidate);
    let (interval, time) = (candidate.interval, fitting.data.duration());
    let model = fitting.known.model(interval.edge);
    let (state_covariance, mu_g_log_sd) = state_covariance(fitting, descent).unzip();
    let hypothesis = Hypothesis {
        edge: fitting.known.part.edge_at(interval.index, evaluation.end.s),
        side: interval.index,
        start: evaluation.start,
        contact_start: evaluation.contact_start,
        end: evaluation.end,
        contact_end: evaluation.contact_end,
        law: fitting.known.touch.law(evaluation.contact_end),
        pose_start: pose(&model, evaluation.start.u, 0.0, &evaluation.start),
        pose_end: pose(&model, evaluation.start.u, time, &evaluation.end),
        velocity_end: model.velocity(&evaluation.contact_end, time, &evaluation.end),
        covariance: state_covariance.map(|state| pose_covariance(fitting, descent, &state)),
        state_covariance,
        mu_g: fitting.known_by(candidate).mu_g,
        mu_g_log_sd,
        from_force: None,
        cost: evaluation.cost,
        probability: 0.0,
    };
    Judged {
        hypothesis,
        log_evidence: log_evidence(fitting, descent, start_modes),
        place: (interval.low, interval.high),
    }
}

/// Laplace's approximation of the probability of the data, up to a factor that all hypotheses share.
fn log_evidence(fitting: &Fitting, descent: &Descent, start_modes: usize) -> f64 {
    let (evaluation, candidate) = (&descent.evaluation, &descent.evaluation.candidate);
    let mut information = descent.evaluation.information;
    let bounds = fitting.bounds(candidate);
    let Prior { omega0_sigma, v_t0_sigma, mu_g_log_sigma } = fitting.prior;
    let sigmas = [None, None, omega0_sigma, v_t0_sigma, mu_g_log_sigma];
    let mut log_prior = -super::clock::count(start_modes).ln();
    for i in 0..UNKNOWNS {
        let width = bounds[i][1] - bounds[i][0];
        match sigmas[i] {
            _ if !fitting.has(candidate.start_mode, i) => information[(i, i)] = TAU, // Cancels below.
            Some(sigma) => log_prior -= (sigma * TAU.sqrt()).ln(),
            None if width.is_finite() && width > 0.0 => {
                // Flat over its range: no wider than that, however little the data say. The perimeter is shared by all.
                information[(i, i)] += 12.0 / (width * width);
                log_prior -= if i == 1 { 0.0 } else { width.ln() };
            }
            None => {}
        }
    }
    let spread = (information / TAU).determinant();
    -0.5 * evaluation.cost + log_prior - 0.5 * spread.ln()
}
