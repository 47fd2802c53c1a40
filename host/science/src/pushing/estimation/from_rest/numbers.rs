//! A fit with the numbers of part and motion found too.
//!
//! Each number has a prior and is told in its standard deviations. What it changes of the force is straight only near where
//! it is taken to be: so each fit begins where the one before came to, until nothing changes (Gauss and Newton; damped where that
//! leads to what costs more: Levenberg and Marquardt).
//!
//! Units: SI. Errors: none; an outline whose edges cross has no fit.

use std::borrow::Cow;

use nalgebra::{DVector, SVector, Vector2};

use super::felt::{Felt, NumberOff, OfNumber, Predicted, undamped};
use super::fit::{COLUMNS, PARAMETERS, Problem, SHARE_OF_SD, Tried, moved};
use super::friction_along::FrictionAlong;
use super::is_possible;
use super::model::sought;
use super::part_errors::PartErrors;
use super::path::{Changed, Course, Guess, Path};
use super::valley::change;
use crate::pushing::dynamics::Part;
use crate::pushing::finger_motion::Leg;
use crate::search::Halt;

/// How long a minimum is sought.
#[derive(Clone, Copy)]
pub(super) struct Effort {
    /// Fits in which numbers are found.
    fits: usize,
    /// Of those that led to what costs more.
    damped: usize,
    /// Steps of each.
    steps: usize,
}

/// Of what is listed.
pub(super) const EFFORT: Effort = Effort { fits: 16, damped: 8, steps: usize::MAX };

/// Of that where nothing else explains what was felt.
const THOROUGH: Effort = Effort { fits: 48, damped: 24, ..EFFORT };

/// Of one of many samples, which may stop within a fraction of a deviation of its minimum.
pub(super) const OF_SAMPLE: Effort = Effort { fits: 4, damped: 4, steps: 8 };

/// Of what only leads there, at the most.
const FITS_BEFORE: usize = 3;

/// Where numbers are far from what they are told, straight lines lead past the minimum: noise so many times as large lets them
/// come near step by step.
const NOISIER: [f64; 3] = [16.0, 6.0, 2.5];

/// What holds numbers where straight lines led too far, beside their priors: so many times as much, at first and the next time.
const DAMPING_FIRST: f64 = 1.0;
const DAMPING_UP: f64 = 6.0;

/// How often a step is tried again, each time twice as far, at the most.
const FURTHER_MAX: usize = 6;

/// A fit that lowers the cost by less is the last.
pub(super) const COST_STEP: f64 = 0.01;

/// Minima of a search that are followed with numbers found too.
pub(super) const NUMBERED_LEADS: usize = 32;

/// A motion that numbers tell.
pub(super) trait MotionNumbers: Sync {
    /// What each is taken for before anything is found.
    fn taken_for(&self) -> Vec<f64>;

    /// The motion that goes with numbers.
    fn legs(&self, off: &[f64]) -> Option<Vec<Leg>>;
}

/// What is not known of part and motion.
pub(super) struct Unknown<'a, 'p> {
    /// With all of it as it is told.
    pub(super) course: &'a Course<'p>,
    /// The part's, where it is known, kg.
    pub(super) mass: Option<f64>,
    pub(super) errors: Option<PartErrors>,
    pub(super) motion: Option<&'a dyn MotionNumbers>,
    /// Standard deviation of ln µ_c from one place of an edge to another; 0 where it is the same everywhere.
    pub(super) mu_c_wander_log_sd: f64,
}

/// A guess, its numbers and their cost where a step has led that changed both by so much, or further the same way as long as that
/// costs less: along a valley that bends each fit goes a little way.
fn further(
    (mut guess, mut off, mut cost): (Guess, Vec<f64>, f64),
    (by, off_by): &(SVector<f64, COLUMNS>, Vec<f64>),
    costs: impl Fn(Guess, &[f64]) -> Option<f64>,
) -> (Guess, Vec<f64>, f64) {
    for times in std::iter::successors(Some(1.0), |times| Some(2.0 * times)).take(FURTHER_MAX) {
        let further = (0..PARAMETERS).fold(guess, |guess, i| moved(&guess, i, by[i] * times));
        let off_there: Vec<_> = off.iter().zip(off_by).map(|(off, by)| off + by * times).collect();
        let there = costs(further, &off_there).filter(|there| *there < cost - COST_STEP);
        let Some(there) = there else { break };
        (guess, off, cost) = (further, off_there, there);
    }
    (guess, off, cost)
}

/// A part and a motion with numbers off, and with each of them a little more off.
#[derive(Clone, Debug)]
pub(super) struct Numbered {
    part: Part,
    legs: Vec<Leg>,
    friction_along: FrictionAlong,
    changed: Vec<Changed>,
    off: Vec<NumberOff>,
}

impl Numbered {
    /// As a course, where one with everything as it is told is given.
    pub(super) fn course<'s>(&'s self, told: &Course<'s>) -> Course<'s> {
        Course {
            part: &self.part,
            legs: self.legs.clone(),
            friction_along: self.friction_along.clone(),
            changed: &self.changed,
            off: &self.off,
            ..told.clone()
        }
    }
}

/// Where a fit begins that finds numbers too, all of them in standard deviations.
pub(super) struct NumberedGuess {
    guess: Guess,
    /// How far each number is off what is told.
    off: Vec<f64>,
    /// How far it is off in what was felt, from which what the finger carries is taken.
    felt_off: Vec<f64>,
    /// Where its prior is.
    prior: Vec<f64>,
}

impl NumberedGuess {
    /// The same with the numbers off by so much.
    pub(super) fn off(self, off: &[f64]) -> Self {
        Self { off: off.to_vec(), ..self }
    }

    /// The same with each number's prior elsewhere.
    pub(super) fn with_priors(self, prior: Vec<f64>) -> Self {
        Self { prior, ..self }
    }
}

/// Something to fit instead of what was felt.
#[derive(Debug)]
pub(super) struct Instead<'a> {
    felt: &'a dyn Felt,
    data: Cow<'a, DVector<f64>>,
    /// By how much noise is larger, as a factor; none where it is the same.
    noise: Option<f64>,
    /// What numbers change, held for every guess.
    numbers: Vec<OfNumber>,
}

impl<'a> Instead<'a> {
    /// Other data.
    pub(super) fn redrawn(felt: &'a dyn Felt, data: DVector<f64>) -> Self {
        Self { felt, data: Cow::Owned(data), noise: None, numbers: Vec::new() }
    }

    /// The same with noise so many times as large.
    fn noisier(felt: &'a dyn Felt, noise: f64) -> Self {
        Self { noise: Some(noise), ..Self::redrawn(felt, felt.data() / noise) }
    }

    /// The same with what numbers change held.
    pub(super) fn held(felt: &'a dyn Felt, numbers: Vec<OfNumber>) -> Self {
        Self { felt, data: Cow::Borrowed(felt.data()), noise: None, numbers }
    }
}

impl Felt for Instead<'_> {
    fn data(&self) -> &DVector<f64> {
        &self.data
    }

    fn freedom(&self) -> f64 {
        self.felt.freedom()
    }

    fn first(&self) -> Vector2<f64> {
        self.felt.first()
    }

    fn predicted(&self, path: &Path, delay: f64) -> Predicted {
        let predicted = self.felt.predicted(path, delay);
        let predicted = match self.noise {
            Some(noise) => predicted.with_noise(noise),
            None => predicted,
        };
        Predicted { numbers: self.numbers.clone(), ..predicted }
    }

    fn onset_sd(&self) -> Option<f64> {
        self.felt.onset_sd()
    }

    fn carried(&self, legs: &[Leg]) -> Option<DVector<f64>> {
        Some(self.felt.carried(legs)? / self.noise.unwrap_or(1.0))
    }

    fn onsets_tried(&self) -> Vec<f64> {
        self.felt.onsets_tried()
    }
}

/// A minimum with its numbers.
pub(super) struct NumberedMinimum {
    pub(super) tried: Tried,
    /// What it is a minimum of.
    pub(super) numbered: Numbered,
    /// How many standard deviations each number is off: of the part, then of the motion, then of the friction along the edge.
    pub(super) taken: Vec<f64>,
}

impl Unknown<'_, '_> {
    /// The minimum that a guess leads to; `roughly` is what was felt with what the numbers change taken for noise. Where nothing
    /// else explains what was felt, `thoroughly` comes near step by step what is far from what is told.
    pub(super) fn found(
        &self,
        guess: Guess,
        felt: &dyn Felt,
        roughly: &dyn Felt,
        explains: impl Fn(&Tried) -> bool,
        thoroughly: bool,
        halt: &Halt<'_>,
    ) -> Option<NumberedMinimum> {
        let effort = if thoroughly { THOROUGH } else { EFFORT };
        let found = self.fitted(&self.begun(guess)?, &[felt], effort, halt);
        if (self.errors.is_none() && !thoroughly) || found.as_ref().is_some_and(|found| explains(&found.tried)) {
            return found;
        }
        // A part far from what it is told to be leads to its minimum only so.
        let noisier = NOISIER.map(|noise| Instead::noisier(felt, noise));
        let between = noisier.iter().take(if thoroughly { NOISIER.len() } else { 0 }).map(|felt| felt as &dyn Felt);
        let stages: Vec<_> = std::iter::once(roughly).chain(between).chain([felt]).collect();
        let others = self.fitted(&self.begun(guess)?, &stages, effort, halt);
        found.into_iter().chain(others).min_by(|a, b| a.tried.cost.total_cmp(&b.tried.cost))
    }

    /// A guess with every number as it is told.
    pub(super) fn begun(&self, guess: Guess) -> Option<NumberedGuess> {
        let mut off = vec![0.0; self.of_part()];
        off.extend(self.motion.iter().flat_map(|motion| motion.taken_for()));
        off.extend(std::iter::repeat_n(0.0, self.friction_along(guess)?.count()));
        Some(NumberedGuess { guess, prior: vec![0.0; off.len()], felt_off: off.clone(), off })
    }

    /// Whether the finger can be at a minimum at all, outside of the part as it is there.
    pub(super) fn is_possible(&self, found: &NumberedMinimum, measured: &dyn Felt) -> bool {
        let course = found.numbered.course(self.course);
        is_possible(&Problem { course: &course, measured, mass: self.mass }, &found.tried)
    }

    /// What a minimum of something else costs by what was felt, with numbers near its own.
    pub(super) fn cost(&self, of: &NumberedMinimum, felt: &dyn Felt) -> Option<f64> {
        let begun = self.begun(of.tried.guess)?;
        let knots = self.friction_along(begun.guess)?;
        Some(self.seen(begun.guess, &of.taken, &begun, &knots, felt)?.1.cost)
    }

    /// The minimum of the last of several things felt, to which those before it lead one after the other.
    pub(super) fn fitted(
        &self,
        begun: &NumberedGuess,
        felt: &[&dyn Felt],
        effort: Effort,
        halt: &Halt<'_>,
    ) -> Option<NumberedMinimum> {
        let (mut guess, mut off) = (begun.guess, begun.off.clone());
        let knots = self.friction_along(guess)?;
        let (last, before) = felt.split_last()?;
        for &measured in before {
            let minimum =
                self.descended((guess, off), begun, &knots, measured, Effort { fits: FITS_BEFORE, ..effort }, halt)?;
            (guess, off) = (minimum.tried.guess, minimum.taken);
        }
        self.descended((guess, off), begun, &knots, *last, effort, halt)
    }

    /// Goes down by fits with what the numbers change held. Where one leads to what costs more, straight lines have led too far:
    /// the next holds the numbers nearer to where they are (Levenberg and Marquardt).
    fn descended(
        &self,
        (mut guess, mut off): (Guess, Vec<f64>),
        begun: &NumberedGuess,
        knots: &FrictionAlong,
        measured: &dyn Felt,
        effort: Effort,
        halt: &Halt<'_>,
    ) -> Option<NumberedMinimum> {
        let costs = |guess: Guess, off: &[f64]| self.cost_as_taken(guess, off, begun, knots, measured);
        let mut cost = costs(guess, &off)?;
        let (mut numbered, mut at) = self.seen(guess, &off, begun, knots, measured)?;
        let (mut damping, mut fits, mut damped) = (0.0, 0, 0);
        while fits < effort.fits && damped < effort.damped {
            // What is not at its minimum is no answer.
            halt.goes_on()?;
            let course = numbered.course(self.course).sure();
            let numbers = at.predicted.numbers.iter().map(|number| number.damped(damping));
            // What the numbers change follows the guess slowly: it is seen once a fit.
            let held = Instead::held(measured, numbers.collect());
            let sure = Problem { course: &course, measured: &held, mass: self.mass };
            let tried = sure.descend(sure.try_path(at.guess, at.path.clone())?, effort.steps);
            let taken = sure.taken_of_numbers(&tried).into_iter().zip(&off).zip(&begun.prior);
            // They are found in deviations from their priors.
            let taken = taken.map(|((of, off), prior)| prior + undamped(of, off - prior, damping)).collect::<Vec<_>>();
            let cost_there = costs(tried.guess, &taken).filter(|there| *there <= cost);
            drop(course);
            match cost_there {
                Some(there) => {
                    // Held numbers may go further once they are freed.
                    let is_last = damping <= 0.0 && cost - there < COST_STEP;
                    let by = (change(&at, &tried), taken.iter().zip(&off).map(|(to, from)| to - from).collect());
                    (guess, off, cost) = further((tried.guess, taken, there), &by, costs);
                    (numbered, at) = self.seen(guess, &off, begun, knots, measured)?;
                    if is_last {
                        break;
                    }
                    damping = if damping > DAMPING_FIRST { damping / DAMPING_UP } else { 0.0 };
                    fits += 1;
                }
                None => {
                    damping = if damping > 0.0 { damping * DAMPING_UP } else { DAMPING_FIRST };
                    damped += 1;
                }
            }
        }
        let taken = {
            let course = numbered.course(self.course);
            Problem { course: &course, measured, mass: self.mass }.taken_of_numbers(&at)
        };
        let taken = taken.iter().zip(&begun.prior).map(|(off, prior)| off + prior).collect();
        Some(NumberedMinimum { tried: at, numbered, taken })
    }

    /// What a guess with numbers costs, none of them being found anew.
    fn cost_as_taken(
        &self,
        guess: Guess,
        off: &[f64],
        begun: &NumberedGuess,
        knots: &FrictionAlong,
        measured: &dyn Felt,
    ) -> Option<f64> {
        let (part, legs) = (self.part(off)?, self.legs(off)?);
        let carried = |legs: &[Leg]| self.motion.and_then(|_| measured.carried(legs));
        let data = match (carried(&legs), carried(&self.course.legs)) {
            (Some(there), Some(told)) => measured.data() + there - told,
            _ => measured.data().clone(),
        };
        let friction_along = self.friction(knots, off);
        let course = Course { part: &part, legs, friction_along, ..self.course.sure() };
        let measured = Instead::redrawn(measured, data);
        let there = Problem { course: &course, measured: &measured, mass: self.mass }.try_guess(guess)?;
        let squares = off.iter().zip(&begun.prior).map(|(off, prior)| (off - prior).powi(2));
        Some(there.cost + squares.sum::<f64>())
    }

    /// What a guess with numbers comes to, each of them seen there.
    fn seen(
        &self,
        guess: Guess,
        off: &[f64],
        begun: &NumberedGuess,
        knots: &FrictionAlong,
        measured: &dyn Felt,
    ) -> Option<(Numbered, Tried)> {
        let numbered = self.numbered(off, begun, knots)?;
        let tried = {
            let course = numbered.course(self.course);
            Problem { course: &course, measured, mass: self.mass }.try_guess(guess)?
        };
        Some((numbered, tried))
    }

    /// How many numbers the part has.
    pub(super) fn of_part(&self) -> usize {
        self.errors.map_or(0, |errors| errors.count(self.course.part))
    }

    fn numbered(&self, off: &[f64], begun: &NumberedGuess, knots: &FrictionAlong) -> Option<Numbered> {
        let (part, legs) = (self.part(off)?, self.legs(off)?);
        let changed = (0..off.len()).map(|number| self.changed(number, off, &part, &legs, knots)).collect();
        let both = off.iter().zip(&begun.felt_off).zip(&begun.prior);
        let both = both.map(|((off, felt_off), prior)| NumberOff { predicted: off - prior, felt: felt_off - prior });
        Some(Numbered { part, legs, friction_along: self.friction(knots, off), changed, off: both.collect() })
    }

    fn part(&self, off: &[f64]) -> Option<Part> {
        match &self.errors {
            Some(errors) => errors.moved(self.course.part, &off[..self.of_part()]),
            None => Some(self.course.part.clone()),
        }
    }

    fn legs(&self, off: &[f64]) -> Option<Vec<Leg>> {
        match &self.motion {
            Some(motion) => motion.legs(&off[self.of_part()..][..motion.taken_for().len()]),
            None => Some(self.course.legs.clone()),
        }
    }

    /// Knots of the friction along a guess's edge; none where it is the same everywhere.
    fn friction_along(&self, guess: Guess) -> Option<FrictionAlong> {
        let [from, to] = sought(&self.course.side(guess.edge)?, 1);
        let wanders = self.mu_c_wander_log_sd > 0.0;
        Some(if wanders { FrictionAlong::constant(to - from) } else { FrictionAlong::default() })
    }

    /// The friction along the edge that goes with numbers.
    fn friction(&self, knots: &FrictionAlong, off: &[f64]) -> FrictionAlong {
        let of_friction = &off[off.len() - knots.count()..];
        knots.with_numbers(of_friction.iter().map(|off| off * self.mu_c_wander_log_sd))
    }

    /// What there is with one number a little more off.
    fn changed(&self, number: usize, off: &[f64], part: &Part, legs: &[Leg], knots: &FrictionAlong) -> Changed {
        let mut more = off.to_vec();
        more[number] += SHARE_OF_SD;
        if number + knots.count() >= off.len() {
            Changed::Friction(self.friction(knots, &more))
        } else if number < self.of_part() {
            // An edge so short that it vanishes changes nothing.
            Changed::Part(self.part(&more).unwrap_or_else(|| part.clone()))
        } else {
            Changed::Motion(self.legs(&more).unwrap_or_else(|| legs.to_vec()))
        }
    }
}
