//! What all that is not known leaves open, sampled.
//!
//! Samples are minima of what might have been felt instead, of a push that is as a minimum says, each number with its prior drawn
//! too (randomised maximum likelihood; Oliver, He and Reynolds 1996). Where a valley bends, slopes at its lowest point say too
//! little: fits of samples begin at the minimum, all along its valley, and where else on its edge a search has come to.
//!
//! A sample that costs less by what was felt than the minimum itself shows that this was none, and leads to a lower one.
//!
//! Units: SI. Errors: none.

use super::GATE;
use super::felt::Felt;
use super::fit::Problem;
use super::numbers::{COST_STEP, EFFORT, Instead, NumberedGuess, NumberedMinimum, OF_SAMPLE, Unknown};
use super::path::{Course, Guess};
use super::valley::Valley;
use crate::math::random::Draw;
use crate::search::Halt;

/// Samples of the minima that are listed of an edge.
const SAMPLES: usize = 24;

/// Of each of them at the least.
const SAMPLES_MIN: usize = 8;

/// How many of each, where so many of an edge are listed: these are samples of it themselves.
pub(super) const fn samples_of(listed_of_edge: usize) -> usize {
    let each = if listed_of_edge > 1 { SAMPLES / listed_of_edge } else { SAMPLES };
    if each > SAMPLES_MIN { each } else { SAMPLES_MIN }
}

/// Slopes and samples tell the volume of what numbers leave open to a factor of four; its logarithm. With this as many poses of
/// every stated probability are true as it says, in `palpate tables model-error`; without it, of unlikely ones far more.
pub(super) const EVIDENCE_LOG_SD: f64 = 1.4;

/// Places of a valley from which samples are fitted, at the most.
const PLACES_MAX: usize = 8;

/// So often samples may lead to a lower minimum.
const LOWER_MAX: usize = 2;

/// What might have been felt is drawn with this: the same for every push, so that an answer can be had again.
const SEED: u64 = 0x7265_6472_6177_6e00;

/// What is seen about a minimum.
#[derive(Default)]
pub(super) struct Sampled {
    /// The minimum to which samples led, where it is a lower one.
    pub(super) lower: Option<NumberedMinimum>,
    /// About that.
    pub(super) samples: Vec<NumberedMinimum>,
    /// Its valley, where that bends: what numbers change is held there, and they are found anew.
    pub(super) valley: Option<Valley>,
}

impl Unknown<'_, '_> {
    /// So many samples about a minimum, or a lower one that they lead to, if it is possible; fits begin at `leads` of its edge, too.
    /// Nothing is looked at for none.
    pub(super) fn sampled(
        &self,
        minimum: &NumberedMinimum,
        felt: &dyn Felt,
        leads: &[Guess],
        count: usize,
        halt: &Halt<'_>,
    ) -> Sampled {
        if count == 0 {
            return Sampled::default();
        }
        let (mut seen, mut least) = self.about(minimum, felt, leads, count, halt);
        for _ in 0..LOWER_MAX {
            let cost = seen.lower.as_ref().unwrap_or(minimum).tried.cost;
            let found = least.and_then(|least| self.fitted(&least, &[felt], EFFORT, halt));
            // Straight lines may promise of a sample what a fit does not find.
            let found = found.filter(|found| found.tried.cost < cost && self.is_possible(found, felt));
            let Some(found) = found else { break };
            let (about, lower) = self.about(&found, felt, leads, count, halt);
            (seen, least) = (Sampled { lower: Some(found), ..about }, lower);
        }
        seen
    }

    /// Samples that explain what was felt nearly as well, and the guess of the best of them where that costs less than the minimum.
    fn about(
        &self,
        minimum: &NumberedMinimum,
        felt: &dyn Felt,
        leads: &[Guess],
        count: usize,
        halt: &Halt<'_>,
    ) -> (Sampled, Option<NumberedGuess>) {
        let tried = &minimum.tried;
        let valley = self.valley(minimum, felt, halt);
        let places = valley.as_ref().map_or(&[][..], |valley| &valley.places);
        let apart = places.len().div_ceil(PLACES_MAX).max(1);
        let along_valley = places.iter().step_by(apart).map(|place| place.there.guess);
        let on_edge = leads.iter().filter(|lead| lead.edge == tried.guess.edge).copied();
        let starts: Vec<_> = along_valley.chain(on_edge).collect();
        let sample = |number: usize| {
            // Every other one begins elsewhere, evenly over what there is.
            let elsewhere = starts.get((number / 2) * starts.len() / (count / 2).max(1)).filter(|_| number % 2 == 1);
            let found = self.sample(minimum, felt, *elsewhere.unwrap_or(&tried.guess), number, halt)?;
            let cost = self.cost(&found, felt)?;
            (cost <= tried.cost + GATE).then_some((cost, found))
        };
        let samples: Vec<_> = halt.each((0..count).collect(), sample).into_iter().flatten().collect();
        let least = samples.iter().min_by(|a, b| a.0.total_cmp(&b.0)).filter(|least| least.0 < tried.cost - COST_STEP);
        let least = least.and_then(|(_, least)| Some(self.begun(least.tried.guess)?.off(&least.taken)));
        let samples = samples.into_iter().map(|(_, sample)| sample).collect();
        (Sampled { lower: None, samples, valley }, least)
    }

    /// The minimum of what might have been felt instead, to which a guess leads.
    fn sample(
        &self,
        minimum: &NumberedMinimum,
        felt: &dyn Felt,
        guess: Guess,
        number: usize,
        halt: &Halt<'_>,
    ) -> Option<NumberedMinimum> {
        let tried = &minimum.tried;
        let mut draw = Draw::case(SEED, number);
        let data = felt.data() + tried.predicted.redrawn(tried.mass, felt.data().len(), &mut draw);
        let prior: Vec<_> = minimum.taken.iter().map(|_| draw.normal()).collect();
        let mu_g_log = self.course.mu_g_log_sd.map_or(0.0, |sd| sd * draw.normal());
        let course = Course { mu_g: self.course.mu_g * mu_g_log.exp(), ..self.course.clone() };
        let begun = self.begun(Guess { mu_g_log: guess.mu_g_log - mu_g_log, ..guess })?;
        let begun = begun.off(&minimum.taken).with_priors(prior);
        let unknown = Unknown { course: &course, ..*self };
        let mut found = unknown.fitted(&begun, &[&Instead::redrawn(felt, data)], OF_SAMPLE, halt)?;
        found.tried.guess.mu_g_log += mu_g_log;
        Some(found)
    }

    /// The valley of a minimum, where it bends: what numbers change is held, and they are found anew.
    fn valley(&self, minimum: &NumberedMinimum, felt: &dyn Felt, halt: &Halt<'_>) -> Option<Valley> {
        let course = minimum.numbered.course(self.course).sure();
        let held = Instead::held(felt, minimum.tried.predicted.numbers.clone());
        let problem = Problem { course: &course, measured: &held, mass: self.mass };
        problem.valley(&problem.try_path(minimum.tried.guess, minimum.tried.path.clone())?, halt)
    }
}
