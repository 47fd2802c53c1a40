//! Turns that take a part to itself: poses that differ by one of them cannot be told apart by any touch.
//!
//! Units: SI. Errors: none.

use nalgebra::{Point2, Vector2};

use super::model::{PlayedModel, sought};
use crate::pushing::dynamics::{ContactMode, Edge, Finger, Part, PushModel};
use crate::pushing::finger_motion::{Leg, LegTurn};

/// Differences below this share of the part's size are none: drawings are rounded to that.
const SAME: f64 = 1e-6;

/// A place and an angle at which friction is compared.
#[derive(Clone, Copy)]
struct Probe {
    /// How far along the edge, as a share of its length.
    share: f64,
    /// Off the edge's normal, rad.
    u: f64,
}

/// None of them special.
const PROBES: [Probe; 3] =
    [Probe { share: 0.21, u: 0.3 }, Probe { share: 0.58, u: -0.5 }, Probe { share: 0.83, u: 0.1 }];

/// The order of a part that any turn takes to itself.
pub(super) const ROUND: usize = usize::MAX;

/// Orders looked for of a disk that does not press on the plane the same all around; the last stands for a continuum.
const DISK_ORDERS: usize = 24;

/// Places where a finger may touch the part, of which no two look the same.
pub(super) fn distinct(part: &Part, order: usize) -> Vec<usize> {
    let places = part.touchable().count();
    part.touchable().take((places / order).max(1)).collect()
}

/// How many turns take the part to itself, the whole turn included; `usize::MAX` of a disk, which any does.
#[must_use]
pub fn order(part: &Part) -> usize {
    if let Some([a, b]) = part.semi_axes() {
        let orders = if (a - b).abs() < SAME * a.max(b) { DISK_ORDERS } else { 2 };
        let found = (2..=orders).rev().find(|&order| fits_turned(part, order)).unwrap_or(1);
        // What so many feet in a ring press cannot be told from a continuum.
        return if found == DISK_ORDERS { ROUND } else { found };
    }
    let edges: Vec<_> = part.sides().map(|(_, edge)| edge).collect();
    let count = edges.len();
    let size = part.inertia_per_mass().sqrt();
    let fits = |shift: usize| (0..count).all(|index| same(part, &edges[index], &edges[(index + shift) % count], size));
    (1..count).filter(|&shift| count.is_multiple_of(shift)).find(|&shift| fits(shift)).map_or(1, |shift| count / shift)
}

/// Most sides that are compared with each other.
const SIDES_MAX: usize = 200;

/// Pairs of straight sides, by the number of their first edge, at which any push begins alike: until the part has turned, force
/// does not tell which of them is touched. None of a part with too many sides to compare.
#[must_use]
pub fn alike_sides(part: &Part) -> Vec<[usize; 2]> {
    let sides: Vec<_> = part.sides().collect();
    if sides.len() > SIDES_MAX {
        return Vec::new();
    }
    let size = part.inertia_per_mass().sqrt();
    let later = |index: usize| sides[index + 1..].iter();
    let pairs = sides.iter().enumerate().flat_map(|(index, a)| later(index).map(move |b| (a, b)));
    pairs.filter(|(a, b)| same(part, &a.1, &b.1, size)).map(|(a, b)| [a.0, b.0]).collect()
}

fn same(part: &Part, a: &Edge, b: &Edge, size: f64) -> bool {
    let lengths = [(a.height, b.height), (a.s_min, b.s_min), (a.s_max, b.s_max)];
    lengths.iter().all(|(a, b)| (a - b).abs() < SAME * size)
        && PROBES.iter().all(|&probe| same_start(part, a, b, probe))
}

/// Whether pushes of an elliptic part begin alike at places so much further round.
fn fits_turned(part: &Part, order: usize) -> bool {
    let Ok(side) = part.touched(0) else { return false };
    let leg = |u: f64| Leg {
        from: 0.0,
        to: f64::INFINITY,
        finger: Finger {
            radius: 0.0,
            centre0: Point2::origin(),
            velocity0: Vector2::zeros(),
            acceleration: Vector2::new(u.cos(), u.sin()),
        },
        turn: LegTurn::default(),
    };
    let [from, to] = sought(&side, 1);
    let start = |share: f64, off: f64| {
        let model = PlayedModel::new(part, 0, None, 1.0, &leg(-off))?;
        model.rest_start(&ContactMode::Rolling, 0.0, from + share * (to - from)).ok()
    };
    let size = part.inertia_per_mass().sqrt();
    PROBES.iter().all(|&Probe { share, u }| match (start(share, u), start(share + 1.0 / order as f64, u)) {
        (Some(a), Some(b)) => {
            let same = [
                (a.normal_force, b.normal_force),
                (a.tangential_force, b.tangential_force),
                (a.alpha * size, b.alpha * size),
            ];
            same.iter().all(|(a, b)| (a - b).abs() < 100.0 * SAME)
        }
        _ => false,
    })
}

/// Whether pushes at two edges begin alike: what rests on feet may look symmetric and not be.
fn same_start(part: &Part, a: &Edge, b: &Edge, Probe { share, u }: Probe) -> bool {
    let start = |edge: &Edge| {
        let finger = Finger {
            radius: 0.0,
            centre0: Point2::origin(),
            velocity0: Vector2::zeros(),
            acceleration: Vector2::new(1.0, 0.0),
        };
        let model = PushModel { part, edge: *edge, mu_g: 1.0, finger };
        model.rest_start(&ContactMode::Rolling, u, edge.s_min + share * (edge.s_max - edge.s_min)).ok()
    };
    match (start(a), start(b)) {
        (Some(a), Some(b)) => {
            let forces = [(a.normal_force, b.normal_force), (a.tangential_force, b.tangential_force)];
            forces.iter().all(|(a, b)| (a - b).abs() < 100.0 * SAME)
        }
        _ => false,
    }
}
