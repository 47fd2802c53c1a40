//! A fit with the numbers of part and motion found too.
//!
//! Each number has a prior and is told in its standard deviations. What it changes of the force is straight only near where
//! it is taken to be: so each fit begins where the one before came to, until nothing changes (Gauss and Newton).
//!
//! Units: SI. Errors: none; an outline whose edges cross has no fit.

use super::super::fit::{Problem, SHARE_OF_SD};
use super::super::friction_along::FrictionAlong;
use super::super::path::{Changed, Course, Guess};
use super::{Concluded, FeltPush, concluded};
use crate::pushing::dynamics::Part;
use crate::pushing::finger_motion::Leg;
use crate::search::Halt;

/// Fits in which numbers are found.
const FITS: usize = 12;

/// Of them those that take what the numbers change for noise, too: a part far from what it is told to be leads to its
/// minimum only so.
const FITS_ROUGHLY: usize = 4;

/// A fit that changes the cost by less is the last.
const COST_STEP: f64 = 0.01;

impl FeltPush<'_, '_> {
    /// The minimum that a guess leads to, and how many standard deviations each number then is off: of the part, then of the
    /// motion, then of the friction along the edge.
    pub(super) fn with_numbers(&self, mut guess: Guess, halt: &Halt<'_>) -> Option<(Concluded, Vec<f64>)> {
        let mut off = vec![0.0; self.of_part()];
        off.extend(self.path.iter().flat_map(|path| path.taken_for()));
        let of_friction = self.friction_along(guess)?;
        off.extend(std::iter::repeat_n(0.0, of_friction.count()));
        let (mut before, mut is_rough) = (f64::INFINITY, self.known.errors.is_some());
        for fit in 1..=FITS {
            // What is not at its minimum is no answer.
            if halt.is_wished() {
                return None;
            }
            let part = self.part(&off)?;
            let legs = self.legs(&off)?;
            let friction_along = self.friction(&of_friction, &off);
            let changed: Vec<_> =
                (0..off.len()).map(|number| self.changed(number, &off, &part, &legs, &of_friction)).collect();
            let course =
                Course { part: &part, legs, friction_along, changed: &changed, off: &off, ..self.course.clone() };
            let measured = if is_rough { &self.roughly } else { &self.felt };
            let problem = Problem { course: &course, measured, mass: self.known.mass };
            let tried = problem.descend(problem.try_guess(guess)?, usize::MAX);
            guess = tried.guess;
            // The cost by straight lines; where nothing changes any more, it is the cost.
            let is_still = (before - tried.cost).abs() < COST_STEP;
            before = tried.cost;
            let taken = problem.taken_of_numbers(&tried);
            if !is_rough && (is_still || fit == FITS) {
                let found = concluded(&problem, vec![tried], self.known, &self.felt).pop()?;
                return Some((found, if is_still { off } else { taken }));
            }
            off = taken;
            if is_rough && (is_still || fit >= FITS_ROUGHLY) {
                (before, is_rough) = (f64::INFINITY, false);
            }
        }
        None
    }

    /// Numbers of the part.
    pub(super) fn of_part(&self) -> usize {
        self.known.errors.map_or(0, |errors| errors.count(self.known.part))
    }

    fn part(&self, off: &[f64]) -> Option<Part> {
        match &self.known.errors {
            Some(errors) => errors.moved(self.known.part, &off[..self.of_part()]),
            None => Some(self.known.part.clone()),
        }
    }

    fn legs(&self, off: &[f64]) -> Option<Vec<Leg>> {
        match &self.path {
            Some(path) => path.legs(&off[self.of_part()..][..path.taken_for().len()]),
            None => Some(self.course.legs.clone()),
        }
    }

    /// Knots of the friction along a guess's edge; none where it is the same everywhere.
    fn friction_along(&self, guess: Guess) -> Option<FrictionAlong> {
        let edge = self.known.part.edge(guess.edge).ok()?;
        let wanders = self.known.mu_c_wander_log_sd > 0.0;
        Some(if wanders { FrictionAlong::constant(&edge) } else { FrictionAlong::default() })
    }

    /// The friction along the edge that goes with numbers.
    fn friction(&self, knots: &FrictionAlong, off: &[f64]) -> FrictionAlong {
        let of_friction = &off[off.len() - knots.count()..];
        knots.with_logs(of_friction.iter().map(|off| off * self.known.mu_c_wander_log_sd))
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
