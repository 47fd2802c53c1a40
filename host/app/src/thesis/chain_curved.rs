//! The whole chain with outlines that bend: elliptic parts, elliptic fingers, and disks, whose turn nobody can feel.
//!
//! Each case is a finger of its own, calibrated, waved in the air and pushed as in [`super::chain`]; its end alone is another.
//!
//! Units: as the columns' headings say. Errors: none; a chain that broke is a failure.

use nalgebra::{Isometry2, Matrix3, Vector2, Vector3};
use palpate::math::random::Draw;
use palpate::pushing::dynamics::{Body, ContactMode, FingerShape, Part};
use palpate::pushing::estimation::Hypothesis;
use palpate::pushing::estimation::from_rest::trial::{Drawn, PoseError, RADIUS_M, Ranges, TrialOutcome, random_part};
use palpate_device::simulated::Line;

use super::cases::{of_each_in_order, until_possible};
use super::chain::{ERRORS, STATUSES, errors_of_best, felt, finger_seed, statuses};
use super::demonstration::{Rig, compliance_by_design};
use super::judged::{PoseClaim, rate};
use super::{Cell, Experiment, Table, TableSettings};

/// What `palpate tables chain-curved` runs.
pub(super) const EXPERIMENT: Experiment =
    Experiment { name: "chain-curved", title: "the same of elliptic parts and by elliptic fingers", cases: 60, run };

/// Longer semi-axes of parts, or radii, m: as large as the polygons of the other tables.
const PART_M: [f64; 2] = [0.025, 0.05];

/// The shorter semi-axis as a share of the longer: with less there are no such parts, and at 1 no turn can be felt.
const SHORTER: [f64; 2] = [0.4, 0.9];

/// Semi-axes of elliptic fingers, each by itself, m: up to the default disk's radius.
const FINGER_M: [f64; 2] = [0.005, RADIUS_M];

/// What touches what.
struct Row {
    name: &'static str,
    part: fn(&mut Draw) -> Part,
    is_finger_elliptic: bool,
    /// Whether the part is a disk, whose angle is anything.
    is_round: bool,
}

const ROWS: [Row; 4] = [
    Row { name: "ellipse, by a disk", part: ellipse, is_finger_elliptic: false, is_round: false },
    Row { name: "polygon, by an ellipse", part: random_part, is_finger_elliptic: true, is_round: false },
    Row { name: "ellipse, by an ellipse", part: ellipse, is_finger_elliptic: true, is_round: false },
    Row { name: "disk, by a disk", part: disk, is_finger_elliptic: false, is_round: true },
];

fn ellipse(draw: &mut Draw) -> Part {
    let [longest, shorter] = [PART_M, SHORTER].map(|[from, to]| draw.uniform(from, to));
    elliptic([longest, longest * shorter])
}

fn disk(draw: &mut Draw) -> Part {
    elliptic([draw.uniform(PART_M[0], PART_M[1]); 2])
}

fn elliptic(semi_axes: [f64; 2]) -> Part {
    Part::elliptic(semi_axes, Body::ellipse(semi_axes))
}

/// What came of a case.
#[derive(Clone, Debug)]
struct Outcome {
    trial: TrialOutcome,
    /// Whether the part slipped along the finger.
    slipped: bool,
    is_covered: bool,
}

fn run(settings: &TableSettings) -> Table {
    let columns = ["pushed", "cases", "slipped"].into_iter().chain(STATUSES).chain(["in all's 95 %"]).chain(ERRORS);
    let mut table = Table::new(columns);
    table.definitions = definitions();
    for row in &ROWS {
        row.add(settings, &mut table);
    }
    table
}

fn definitions() -> Vec<String> {
    let text = [
        "Pushes as in the table chain, with a turn, by its finger with noise, hum, mass and bending. Ellipses: of uniform density, the longer semi-axis 25 to 50 mm, the other 0.4 to 0.9 of it; disks with a radius of 25 to 50 mm; polygons as there. Elliptic fingers: semi-axes of 5 to 15 mm along and across, otherwise a disk of 15 mm. The contact uniform by the ellipse's eccentric angle, or along the polygon.",
        "slipped: the part slipped along the finger. unique, ambiguous, none, wrong, wrong and certain: as in the table chain; an ellipse turned by half a turn is the same.",
        "in all's 95 %: how often the truth is where what all hypotheses say together is densest, and 95 % of it; in brackets the interval of 99 %.",
        "Errors at the end of the push: of the centre of mass and of the angle, of the best pose listed. A disk's angle is told as anything: its place alone is judged, by the contact's place on the finger.",
    ];
    text.map(str::to_owned).to_vec()
}

impl Row {
    fn add(&self, settings: &TableSettings, table: &mut Table) {
        let case = |number| self.case(settings.seed, number);
        let outcomes = of_each_in_order(settings.cases, settings.jobs(), case, |_| ());
        let sound: Vec<_> = outcomes.iter().filter_map(|outcome| outcome.as_ref().ok()).collect();
        let trials: Vec<_> = sound.iter().map(|outcome| &outcome.trial).collect();
        let covered = sound.iter().filter(|outcome| outcome.is_covered).count();
        let slipped = sound.iter().filter(|outcome| outcome.slipped).count();
        let [mm, mm_most, degrees, degrees_most] = errors_of_best(&trials);
        let angles = if self.is_round { [Cell::Empty, Cell::Empty] } else { [degrees, degrees_most] };
        let cells = [self.name.into(), Cell::count(outcomes.len()), Cell::count(slipped)];
        let judged = statuses(&trials, outcomes.len()).into_iter().chain([rate(covered, sound.len()), mm, mm_most]);
        table.push(cells.into_iter().chain(judged).chain(angles));
        table.failures.extend(outcomes.iter().enumerate().filter_map(|(number, outcome)| match outcome {
            Ok(outcome) if outcome.trial.holds_truth && outcome.is_covered => None,
            Ok(outcome) => Some(format!("{}, case {number}: {outcome:?}", self.name)),
            Err(error) => Some(format!("{}, {error}", self.name)),
        }));
    }

    fn case(&self, seed: u64, number: usize) -> Result<Outcome, String> {
        let (ranges, part, drawn) = self.drawn(seed, number);
        let rig = Rig::start(finger_seed(seed, number), 1.0, Line::Pipe);
        let estimate = felt(rig, &ranges, &part, &drawn, number)?;
        let truth = drawn.played.pose(estimate.time_end).ok_or_else(|| format!("case {number}: no pose at the end"))?;
        let trial = TrialOutcome::new(&part, &drawn, &estimate);
        let slipped = drawn.played.samples.iter().any(|sample| sample.contact != ContactMode::Rolling);
        if self.is_round {
            let places: Vec<_> = estimate.hypotheses.iter().map(|found| Place::new(found, &part, &truth)).collect();
            let claims: Vec<_> = places.iter().map(|place| place.claim).collect();
            let trial = TrialOutcome { holds_truth: places.iter().any(Place::is_right), ..trial };
            return Ok(Outcome { trial, slipped, is_covered: PoseClaim::cover(&claims) });
        }
        let claim = |found| PoseClaim::of(found, estimate.symmetry, &truth);
        let claims: Vec<_> = estimate.hypotheses.iter().map(claim).collect();
        Ok(Outcome { trial, slipped, is_covered: PoseClaim::cover(&claims) })
    }

    fn drawn(&self, seed: u64, number: usize) -> (Ranges, Part, Drawn) {
        until_possible(&mut Draw::case(seed, number), |draw| {
            let part = (self.part)(draw);
            let semi_axes = [draw.uniform(FINGER_M[0], FINGER_M[1]), draw.uniform(FINGER_M[0], FINGER_M[1])];
            let shape = self.is_finger_elliptic.then_some(FingerShape::Ellipse { semi_axes });
            let ranges = Ranges { compliance: compliance_by_design(), shape, ..Ranges::default() };
            let drawn = ranges.draw(draw, &part)?;
            Some((ranges, part, drawn))
        })
    }
}

/// What a hypothesis says of where a disk is that a disk pushes: beside the finger, at a contact angle that it knows so well.
struct Place {
    claim: PoseClaim,
    distance: f64,
    /// Stated standard deviation of that, m.
    sd: f64,
}

impl Place {
    fn new(found: &Hypothesis, part: &Part, truth: &Isometry2<f64>) -> Self {
        let apart = RADIUS_M + part.semi_axes().map_or(0.0, |[radius, _]| radius);
        let sd = apart * found.state_covariance.map_or(f64::INFINITY, |covariance| covariance[(0, 0)].sqrt());
        let (sin, cos) = found.end.u.sin_cos();
        let along = Vector2::new(-sin, cos) * sd;
        let along = Vector3::new(along.x, along.y, 0.0);
        let off = found.pose_end.minus(&(*truth).into());
        // Every angle is the true one.
        let off = Vector3::new(off.x, off.y, 0.0);
        let covariance: Matrix3<f64> = along * along.transpose();
        Self { claim: PoseClaim::new(found.probability, &off, &covariance), distance: off.norm(), sd }
    }

    fn is_right(&self) -> bool {
        PoseError { distance: self.distance, angle: 0.0 }.is_within((self.sd, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Short runs; the full ones are `palpate tables chain-curved`.
    #[test]
    fn outlines_that_bend_are_felt_by_a_carried_finger() {
        for row in &ROWS {
            let outcome = row.case(1, 0).unwrap();
            assert!(outcome.trial.holds_truth, "{}: {outcome:?}", row.name);
        }
    }
}
