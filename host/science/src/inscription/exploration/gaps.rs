//! The gap between neighbouring touches in which least is known, and a way to it.
//!
//! Frames: world. Units: m, rad. Errors: none.

use nalgebra::{Point2, Rotation2, Vector2, center};

use super::fit::{Between, Fitted, height};
use super::sides::turn;
use super::{Exploration, TRIES_MAX, left};
use crate::geometry::distance_to_segment;

/// An outline that is straight as far as is known may be off by this share of a gap.
const UNSEEN: f64 = 0.05;

/// How much of what may be in a gap counts, where a corner was touched and where one is foreseen.
const TOUCHED_SHARE: f64 = 0.1;
const FORESEEN_SHARE: f64 = 0.5;

/// Between centres as near as this no disk is sent, as a share of its radius.
const CLOSED: f64 = 0.02;

/// Turns of a way about what is straight into a gap, rad: round what stands before it.
const TURNS: [f64; 7] = [0.0, 0.35, -0.35, 0.7, -0.7, 1.05, -1.05];

/// A way to a gap.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gap {
    /// The numbers of the touches beside it.
    pub(super) between: [usize; 2],
    pub(super) through: Point2<f64>,
    /// Length 1.
    pub(super) direction: Vector2<f64>,
}

/// The gap to go to; none where all that are left are closed.
pub(super) fn next(exploration: &Exploration) -> Option<Gap> {
    let fitted = Fitted::of(exploration)?;
    let total = fitted.touches.len();
    let mut gaps: Vec<_> = (0..total).map(|place| (unknown(&fitted, exploration.radius, place), place)).collect();
    gaps.sort_by(|a, b| b.0.total_cmp(&a.0));
    gaps.into_iter().find_map(|(_, place)| way(exploration, &fitted, place))
}

/// How far the outline may be from what is known in the gap after a touch, m.
fn unknown(fitted: &Fitted<'_>, radius: f64, place: usize) -> f64 {
    let next = (place + 1) % fitted.touches.len();
    let apart = (fitted.touches[next].centre - fitted.touches[place].centre).norm();
    let turn = turn(&fitted.normals[place], &fitted.normals[next]);
    // A notch is as deep to the disk as its centre goes.
    let chord = if turn > 0.0 { (fitted.contact(next) - fitted.contact(place)).norm() } else { apart };
    let share = match fitted.after[place] {
        Between::Side => 0.0,
        Between::Corner => TOUCHED_SHARE,
        Between::Foreseen => FORESEEN_SHARE,
        Between::Unknown => 1.0,
    };
    UNSEEN * apart.min(4.0 * radius) + share * height(chord, turn)
}

fn way(exploration: &Exploration, fitted: &Fitted<'_>, place: usize) -> Option<Gap> {
    let next = (place + 1) % fitted.touches.len();
    let between = [exploration.order[place], exploration.order[next]];
    let tries = exploration.tries.get(&between).copied().unwrap_or(0);
    let [a, b] = [place, next].map(|place| fitted.touches[place].centre);
    if tries >= TRIES_MAX || (b - a).norm() <= CLOSED * exploration.radius {
        return None;
    }
    let both = fitted.normals[place] + fitted.normals[next];
    // Where they are opposite, straight from outside.
    let outwards = both.try_normalize(0.2).unwrap_or_else(|| -left(&(b - a)));
    let through = center(&a, &b);
    let is_clear = |direction: &Vector2<f64>| {
        let from = exploration.across(through, *direction).from;
        (0..fitted.touches.len()).filter(|&other| other != place && other != next).all(|other| {
            let contact = fitted.contact(other);
            // Up to what lies beside the gap's own touches.
            (contact - through).norm() <= exploration.radius
                || distance_to_segment(contact, from, through) >= 0.98 * exploration.radius
        })
    };
    let ways = TURNS.iter().map(|by| -(Rotation2::new(*by) * outwards));
    let direction = ways.filter(is_clear).nth(tries)?;
    Some(Gap { between, through, direction })
}
