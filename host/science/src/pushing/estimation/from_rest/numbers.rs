//! A fit with the numbers of part and motion found too.
//!
//! Each number has a prior and is told in its standard deviations. What it changes of the force is straight only near where
//! it is taken to be: so each fit begins where the one before came to, until nothing changes (Gauss and Newton).
//!
//! Units: SI. Errors: none; an outline whose edges cross has no fit.

use super::felt::{Felt, NumberOff};
use super::fit::{Problem, SHARE_OF_SD, Tried};
use super::friction_along::FrictionAlong;
use super::model::sought;
use super::part_errors::PartErrors;
use super::path::{Changed, Course, Guess};
use crate::pushing::dynamics::Part;
use crate::pushing::finger_motion::Leg;
use crate::search::Halt;

/// Fits in which numbers are found.
const FITS: usize = 12;

/// Of them at the most those in which what the numbers change is noise, too.
const FITS_ROUGHLY: usize = 4;

/// A fit that changes the cost by less is the last.
const COST_STEP: f64 = 0.01;

/// Minima of a search that are followed with numbers found too.
pub(super) const NUMBERED_LEADS: usize = 16;

/// A motion that numbers tell.
pub(super) trait MotionNumbers {
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

/// A minimum with its numbers.
pub(super) struct NumberedMinimum {
    pub(super) tried: Tried,
    /// What it is a minimum of.
    pub(super) numbered: Numbered,
    /// How many standard deviations each number is off: of the part, then of the motion, then of the friction along the edge.
    pub(super) taken: Vec<f64>,
}

impl Unknown<'_, '_> {
    /// The minimum that a guess leads to; `roughly` is what was felt with what the numbers change taken for noise.
    pub(super) fn found(
        &self,
        guess: Guess,
        felt: &dyn Felt,
        roughly: &dyn Felt,
        explains: impl Fn(&Tried) -> bool,
        halt: &Halt<'_>,
    ) -> Option<NumberedMinimum> {
        let found = self.fitted(guess, felt, None, halt);
        if self.errors.is_none() || found.as_ref().is_some_and(|found| explains(&found.tried)) {
            return found;
        }
        // A part far from what it is told to be leads to its minimum only so.
        let others = self.fitted(guess, felt, Some(roughly), halt);
        found.into_iter().chain(others).min_by(|a, b| a.tried.cost.total_cmp(&b.tried.cost))
    }

    fn fitted(
        &self,
        mut guess: Guess,
        felt: &dyn Felt,
        mut first: Option<&dyn Felt>,
        halt: &Halt<'_>,
    ) -> Option<NumberedMinimum> {
        let mut off = vec![0.0; self.of_part()];
        off.extend(self.motion.iter().flat_map(|motion| motion.taken_for()));
        let knots = self.friction_along(guess)?;
        off.extend(std::iter::repeat_n(0.0, knots.count()));
        let felt_off = off.clone();
        let mut before = f64::INFINITY;
        for fit in 1..=FITS {
            // What is not at its minimum is no answer.
            if halt.is_wished() {
                return None;
            }
            let numbered = self.numbered(&off, &felt_off, &knots)?;
            let course = numbered.course(self.course);
            let problem = Problem { course: &course, measured: first.unwrap_or(felt), mass: self.mass };
            let tried = problem.descend(problem.try_guess(guess)?, usize::MAX);
            guess = tried.guess;
            // The cost by straight lines; where nothing changes any more, it is the cost.
            let is_still = (before - tried.cost).abs() < COST_STEP;
            before = tried.cost;
            let taken = problem.taken_of_numbers(&tried);
            drop(course);
            if first.is_none() && (is_still || fit == FITS) {
                return Some(NumberedMinimum { tried, numbered, taken });
            }
            off = taken;
            if first.is_some() && (is_still || fit >= FITS_ROUGHLY) {
                (before, first) = (f64::INFINITY, None);
            }
        }
        None
    }

    /// How many numbers the part has.
    pub(super) fn of_part(&self) -> usize {
        self.errors.map_or(0, |errors| errors.count(self.course.part))
    }

    fn numbered(&self, off: &[f64], felt_off: &[f64], knots: &FrictionAlong) -> Option<Numbered> {
        let (part, legs) = (self.part(off)?, self.legs(off)?);
        let changed = (0..off.len()).map(|number| self.changed(number, off, &part, &legs, knots)).collect();
        let both = off.iter().zip(felt_off).map(|(&predicted, &felt)| NumberOff { predicted, felt }).collect();
        Some(Numbered { part, legs, friction_along: self.friction(knots, off), changed, off: both })
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
        Some(if wanders { FrictionAlong::constant(from, to) } else { FrictionAlong::default() })
    }

    /// The friction along the edge that goes with numbers.
    fn friction(&self, knots: &FrictionAlong, off: &[f64]) -> FrictionAlong {
        let of_friction = &off[off.len() - knots.count()..];
        knots.with_logs(of_friction.iter().map(|off| off * self.mu_c_wander_log_sd))
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
