//! Table 6.3: the resting pose of a part from three contacts.
//!
//! Units: SI inside; the table's headings say theirs. Errors: none.

use std::f64::consts::PI;

use nalgebra::{Point2, Vector2};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::pushing::dynamics::{FingerPath, FingerShape, Part};
use palpate::pushing::estimation::{Object, RestingPose, RestingPoses, RestingPush, Table as Motions, TimedContact};

use super::{Cell, Experiment, Table, TableSettings};

/// Thesis Table 6.3.
pub(super) const FRICTIONLESS: Experiment = Experiment {
    name: "6.3",
    title: "the resting pose from three contacts, no friction",
    cases: 500,
    run: frictionless,
};

/// The thesis's tests with friction, §6.2.
pub(super) const FRICTION: Experiment = Experiment {
    name: "6.3-friction",
    title: "the resting pose from three contacts, a disk on polygons with friction under them",
    cases: 105,
    run: friction,
};

/// How far a prediction may be from an exact contact, rad or m: a hundred times what simulations differ by.
const TOLERANCE: f64 = 1e-8;

/// Ellipses with semi-axes nearer to each other than this share are not drawn.
const NEARLY_ROUND: f64 = 0.05;

/// How near the right s₀ must be, m or rad.
const RIGHT: f64 = 1e-5;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Pair {
    EllipseOnEllipse,
    LineOnEllipse,
    EllipseOnPolygon,
    DiskOnPolygon,
}

/// One random push from rest.
struct Case {
    push: RestingPush,
    edge: Option<usize>,
    s0: f64,
    contacts: Vec<TimedContact>,
}

impl Case {
    /// The first push of the sequence whose contact lasts.
    fn new(seed: u64, case: usize, pair: Pair) -> Self {
        let mut draw = Draw::case(seed, case);
        loop {
            if let Some(case) = Self::drawn(&mut draw, pair) {
                return case;
            }
        }
    }

    fn drawn(draw: &mut Draw, pair: Pair) -> Option<Self> {
        let shape = match pair {
            Pair::LineOnEllipse => FingerShape::Line,
            Pair::DiskOnPolygon => FingerShape::Disk { radius: 0.01 },
            _ => FingerShape::Ellipse { semi_axes: [draw.uniform(0.01, 0.03), draw.uniform(0.01, 0.03)] },
        };
        let u0 = if pair == Pair::LineOnEllipse { 0.0 } else { draw.uniform(1.3, 2.0) };
        let friction = pair == Pair::DiskOnPolygon;
        let (size, mu_g) =
            if friction { (draw.uniform(1.2, 1.8), 0.3 * GRAVITY_ASSUMED) } else { (draw.uniform(0.08, 0.13), 0.0) };
        let sideways = if friction { draw.uniform(-0.25, 0.25) } else { draw.uniform(-0.5, 0.5) };
        let acceleration = Vector2::new(size * sideways.sin(), size * sideways.cos());
        let path = FingerPath { centre0: Point2::origin(), velocity0: Vector2::zeros(), acceleration };
        let (object, edge, s0) = object(draw, pair)?;
        let push = RestingPush::new(object, mu_g, shape, path, u0).ok()?;
        let times = if friction {
            [draw.uniform(0.12, 0.15), draw.uniform(0.2, 0.25)]
        } else {
            [draw.uniform(0.45, 0.65), draw.uniform(0.85, 1.05)]
        };
        let measured = push.predicted(edge, s0, &times);
        let contacts: Vec<_> = times.iter().zip(&measured).map(|(&t, &u)| TimedContact { t, u }).collect();
        (contacts.len() == 2).then_some(Self { push, edge, s0, contacts })
    }

    fn is_right(&self, pose: &RestingPose) -> bool {
        let gap = pose.s0 - self.s0;
        let gap = if self.edge.is_none() { (gap + PI / 2.0).rem_euclid(PI) - PI / 2.0 } else { gap };
        pose.edge == self.edge && gap.abs() < RIGHT
    }

    fn found(&self, poses: &[RestingPose]) -> bool {
        poses.iter().any(|pose| self.is_right(pose))
    }
}

/// What is pushed and where it is touched.
fn object(draw: &mut Draw, pair: Pair) -> Option<(Object, Option<usize>, f64)> {
    if matches!(pair, Pair::EllipseOnEllipse | Pair::LineOnEllipse) {
        let semi_axes = [draw.uniform(0.018, 0.05), draw.uniform(0.018, 0.05)];
        // Nothing tells how a circle lies.
        if (semi_axes[0] / semi_axes[1] - 1.0).abs() < NEARLY_ROUND {
            return None;
        }
        return Some((Object::Ellipse(semi_axes), None, draw.uniform(0.0, PI)));
    }
    let points = 4 + draw.index(6);
    let polygon = draw.convex_polygon(points, 0.05);
    let edge = draw.index(polygon.vertices().len());
    let seen = Part::uniform(polygon.clone()).edge(edge).ok()?;
    let s0 = draw.uniform(seen.s_min, seen.s_max);
    Some((Object::Polygon(polygon), Some(edge), s0))
}

/// Counts of one row.
#[derive(Default)]
struct Counts {
    found: usize,
    unique: usize,
    candidates: usize,
    by_table: usize,
}

fn row(settings: &TableSettings, pair: Pair, failures: &mut Vec<String>) -> Counts {
    let mut counts = Counts::default();
    for index in 0..settings.cases {
        let case = Case::new(settings.seed, index, pair);
        let RestingPoses { solutions, candidates } = case.push.observe(&case.contacts, TOLERANCE);
        counts.candidates += candidates.len();
        let found = case.found(&solutions) && case.found(&candidates);
        counts.found += usize::from(found);
        counts.unique += usize::from(found && solutions.len() == 1);
        if !found || solutions.len() != 1 {
            let what = if found { format!("{} poses fit", solutions.len()) } else { "missed".to_owned() };
            failures.push(format!("{pair:?}, case {index}: {what}"));
        }
        // A table costs as much as one observation, so only some of the cases are looked up as well.
        if index % 10 == 0 {
            let looked_up = Motions::new(&case.push, 1.1 * case.contacts[1].t).observe(&case.contacts, TOLERANCE);
            let same = looked_up.candidates.len() == candidates.len() && case.found(&looked_up.solutions) == found;
            counts.by_table += usize::from(same);
            if !same {
                failures.push(format!("{pair:?}, case {index}: table found {} candidates", looked_up.candidates.len()));
            }
        }
    }
    counts
}

fn experiment(settings: &TableSettings, rows: &[(Pair, &'static str, f64)], drawn: &str) -> Table {
    let mut table = Table::new([
        "finger, object",
        "thesis ok",
        "cases",
        "unique and right",
        "right one found",
        "candidates after the first contact",
        "table agrees",
    ]);
    table.definitions = vec![
        drawn.to_owned(),
        "Contacts: at rest, at an intermediate time and at the end, exact. A pose fits if its u is within 1e-8 rad (m on a line) of both later contacts.".to_owned(),
        "unique and right: only one fits, s0 within 1e-5 m or rad. table agrees: of every tenth case, looked up instead of simulated, the same candidates.".to_owned(),
    ];
    for &(pair, name, thesis) in rows {
        let counts = row(settings, pair, &mut table.failures);
        table.push([
            name.into(),
            Cell::Share(thesis),
            Cell::count(settings.cases),
            Cell::share(counts.unique, settings.cases),
            Cell::share(counts.found, settings.cases),
            Cell::number(counts.candidates as f64 / settings.cases as f64, 2),
            Cell::share(counts.by_table, settings.cases.div_ceil(10)),
        ]);
    }
    table
}

fn frictionless(settings: &TableSettings) -> Table {
    let rows = [
        (Pair::EllipseOnEllipse, "ellipse, ellipse", 0.978),
        (Pair::LineOnEllipse, "line, ellipse", 0.975),
        (Pair::EllipseOnPolygon, "ellipse, polygon", 0.945),
    ];
    let drawn = "Drawn: finger semi-axes 1 to 3 cm, object 1.8 to 5 cm (not within 5 % of a circle) or a hull of 4 to 9 points in a disk of 5 cm; u0 1.3 to 2.0 rad (0 on a line); acceleration 8 to 13 cm/s² within 29° of y; contacts after 0.45 to 0.65 s and 0.85 to 1.05 s.";
    experiment(settings, &rows, drawn)
}

fn friction(settings: &TableSettings) -> Table {
    let rows = [(Pair::DiskOnPolygon, "disk, polygon", 94.0 / 105.0)];
    let drawn = "Drawn: disk of 1 cm, hulls of 4 to 9 points in a disk of 5 cm, µ 0.3; u0 1.3 to 2.0 rad; acceleration 1.2 to 1.8 m/s² within 14° of y; contacts after 0.12 to 0.15 s and 0.2 to 0.25 s.";
    experiment(settings, &rows, drawn)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Few cases, so that the tests stay quick; the full table is `palpate tables 6.3`.
    #[test]
    fn every_resting_pose_is_found() {
        let settings = TableSettings { cases: 4, seed: 7, jobs: None };
        for table in [frictionless(&settings), friction(&TableSettings { cases: 1, ..settings })] {
            for row in table.rows() {
                assert_eq!(
                    (&row[3], &row[4], &row[6]),
                    (&Cell::Share(1.0), &Cell::Share(1.0), &Cell::Share(1.0)),
                    "{table}"
                );
            }
        }
    }
}
