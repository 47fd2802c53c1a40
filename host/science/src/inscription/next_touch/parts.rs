//! Which of several parts lies there, and where.
//!
//! Every part has a search of its own, which takes the same approaches; a part of which no pose is left is none. What a
//! touch costs is kept small: a part that cannot reach from one touch to another is left out before its poses are covered.
//!
//! That one part is left does not make it the one: it may be none of them. So what is left is confirmed: the finger goes
//! to where the part's outline would be, far from what was touched, and only [`CONFIRMED`] touches that come where
//! they are foreseen make it certain. A stranger's outline is there by chance only.
//!
//! Frames: world. Units: m, rad. Errors: none; "none of them" is an answer.

use nalgebra::Point2;

use super::super::noise::PoseMode;
use super::{
    Approach, Belief, Met, NextTouch, TRUSTED_SD, TouchSearch, TouchTask, TouchTolerance, TouchVerdict, cells, plan,
};
use crate::geometry::SimplePolygon;

/// So many touches must come where the one part that is left would be.
const CONFIRMED: usize = 2;

/// Before the first touch this many poses stand for all of a part, at the least.
const SPREAD_LEAST: u32 = 6;

/// A part that is left, and its poses.
#[derive(Clone, Debug, PartialEq)]
pub struct PartLeft {
    /// Its number among the parts.
    pub part: usize,
    /// Best first; none where they are not told apart yet.
    pub modes: Vec<PoseMode>,
}

/// What is known of the parts by now.
#[derive(Clone, Debug, PartialEq)]
pub enum PartsVerdict {
    /// Several parts or poses are left, or what is left is not confirmed yet, or not known well enough.
    Open(Vec<PartLeft>),
    /// This part, in one pose or in several that no touch tells apart.
    One(PartLeft),
    /// Parts that no touch tells apart: their outlines are the same within the tolerance.
    Alike(Vec<PartLeft>),
    /// None of the parts explains what was felt.
    NoneOfThese,
}

/// The search for which of several parts was touched.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::SimplePolygon;
/// use palpate::inscription::{Met, PartsSearch, PartsVerdict, TouchTolerance};
///
/// let wedge = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.02, 0.04]].map(Point2::from))?;
/// let block = SimplePolygon::new([[0.0, 0.0], [0.05, 0.0], [0.05, 0.03], [0.0, 0.03]].map(Point2::from))?;
/// let area = [Point2::origin(), Point2::new(0.2, 0.2)]; // m
/// let mut search = PartsSearch::new(&[wedge, block], 0.015, area, TouchTolerance::default());
/// let next = search.next().ok_or("nowhere to go")?;
/// search.take(&next.approach, &Met::Nothing);
/// assert!(matches!(search.verdict(), PartsVerdict::Open(parts) if parts.len() == 2));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct PartsSearch {
    searches: Vec<TouchSearch>,
    /// The largest distance between two points of each part, m.
    diameters: Vec<f64>,
    /// The numbers of the parts that are left.
    left: Vec<usize>,
    /// Touches that came where the one part that was left would be.
    confirmed: usize,
}

impl PartsSearch {
    /// Nothing was touched yet; `area` holds all of the part.
    #[must_use]
    pub fn new(parts: &[SimplePolygon], radius: f64, area: [Point2<f64>; 2], tolerance: TouchTolerance) -> Self {
        let count = u32::try_from(parts.len()).unwrap_or(u32::MAX).max(1);
        let spread = (cells::SPREAD / count).max(SPREAD_LEAST);
        let task = |outline: &SimplePolygon| TouchTask { outline: outline.clone(), radius, area, tolerance };
        let searches: Vec<_> = parts.iter().map(|part| TouchSearch::with_spread(task(part), spread)).collect();
        let diameters = parts.iter().map(diameter).collect();
        Self { left: (0..searches.len()).collect(), searches, diameters, confirmed: 0 }
    }

    /// The search of one part, with all that was felt as long as the part was left.
    #[must_use]
    pub fn part(&self, part: usize) -> &TouchSearch {
        &self.searches[part]
    }

    /// How many parts are left.
    #[must_use]
    pub fn parts_left(&self) -> usize {
        self.left.len()
    }

    /// Takes what came of an approach.
    pub fn take(&mut self, approach: &Approach, met: &Met) {
        let was = self.decided();
        let Self { searches, diameters, left, .. } = self;
        left.retain(|&part| {
            let search = &mut searches[part];
            let reaches = match met {
                Met::Nothing => true,
                Met::Part(touch) => search.touches.iter().all(|other| {
                    let slack = TRUSTED_SD * touch.sigma.hypot(other.sigma);
                    (touch.centre - other.centre).norm() <= diameters[part] + 2.0 * search.task.radius + slack
                }),
            };
            if reaches {
                search.take(approach, met);
            }
            // Drawn poses say nothing of those between them.
            let drawn = matches!(search.belief, Belief::Spread(_));
            reaches && (drawn || search.verdict() != TouchVerdict::NoPose)
        });
        self.confirmed = match (was, self.decided()) {
            (Some(was), Some(now)) if was == now => self.confirmed + usize::from(matches!(met, Met::Part(_))),
            _ => 0,
        };
    }

    /// The one part that is left, if its poses are known.
    fn decided(&self) -> Option<usize> {
        let [part] = *self.left.as_slice() else { return None };
        self.is_found(part).then_some(part)
    }

    /// Whether a part's poses are known: one, or several that no touch tells apart.
    fn is_found(&self, part: usize) -> bool {
        matches!(self.searches[part].verdict(), TouchVerdict::One(_) | TouchVerdict::Alike(_))
    }

    /// What is known by now.
    #[must_use]
    pub fn verdict(&self) -> PartsVerdict {
        let left: Vec<_> = self.left.iter().map(|&part| self.part_left(part)).collect();
        if let Some(part) = self.decided() {
            let part = self.part_left(part);
            return if self.confirmed >= CONFIRMED { PartsVerdict::One(part) } else { PartsVerdict::Open(vec![part]) };
        }
        match left.as_slice() {
            [] => PartsVerdict::NoneOfThese,
            [_] => PartsVerdict::Open(left),
            [first, others @ ..] if others.iter().all(|other| self.are_alike(first, other)) => {
                PartsVerdict::Alike(left)
            }
            _ => PartsVerdict::Open(left),
        }
    }

    fn part_left(&self, part: usize) -> PartLeft {
        PartLeft { part, modes: self.searches[part].modes().to_vec() }
    }

    /// Whether all poses of two parts are known, and their outlines the same in them.
    fn are_alike(&self, a: &PartLeft, b: &PartLeft) -> bool {
        let placed = |left: &PartLeft| left.modes.first().map(|mode| (&self.searches[left.part].task, mode.pose));
        let (Some((task, at)), Some((other, other_at))) = (placed(a), placed(b)) else { return false };
        self.is_found(a.part)
            && self.is_found(b.part)
            && super::shapes_apart((&task.outline, &at), (&other.outline, &other_at)) <= task.tolerance.distance
    }

    /// The approach after which the least is expected to be left, or, where one part is, one that confirms it; none where
    /// no part is left.
    #[must_use]
    pub fn next(&self) -> Option<NextTouch> {
        if let Some(part) = self.decided() {
            return plan::confirm(&self.searches[part]);
        }
        let left: Vec<_> = self.left.iter().map(|&part| &self.searches[part]).collect();
        plan::next(&left)
    }
}

/// The largest distance between two points of an outline, m.
fn diameter(outline: &SimplePolygon) -> f64 {
    let vertices = outline.vertices();
    let from = |a: &Point2<f64>| vertices.iter().map(|b| (a - b).norm()).fold(0.0, f64::max);
    vertices.iter().map(from).fold(0.0, f64::max)
}
