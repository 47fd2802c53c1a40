//! Turns that take a part to itself: poses that differ by one of them cannot be told apart by any touch.
//!
//! Units: SI. Errors: none.

use nalgebra::{Point2, Vector2};

use crate::pushing::dynamics::{ContactMode, Edge, Finger, Part, PushModel};

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

/// How many turns take the part to itself, the whole turn included.
#[must_use]
pub fn order(part: &Part) -> usize {
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
