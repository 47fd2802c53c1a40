//! The whole chain, many times: how often a pushed part's pose is named, and how well.
//!
//! Each case is a finger of its own, calibrated, and a random part pushed from rest; see
//! [`crate::thesis::demonstration`]. Nothing of the thesis is beside it: its sensor was never used on a moving part
//! (§6.4).

use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::from_rest::trial::{
    Drawn, RADIUS_M, Ranges, TrialOutcome, random_part, straight_motion,
};
use palpate::pushing::estimation::from_rest::{self, CarriedFinger, KnownFromRest};
use palpate::pushing::estimation::{Estimate, Status};
use palpate::pushing::pushed_world::STEP_S;
use palpate_device::simulated::{CarriedCourse, Line};

use super::cases::of_each;
use super::{Cell, Experiment, Table, TableSettings};
use crate::thesis::demonstration::{Rig, RigError, compliance_by_design, course, unmoved};
use palpate::gravity::GRAVITY_ASSUMED;

/// A part drawn for a case, and how it was pushed.
pub(super) fn drawn(ranges: &Ranges, seed: u64, number: usize) -> (Part, Drawn) {
    let mut draw = Draw::case(seed, number);
    loop {
        let part = random_part(&mut draw);
        if let Some(drawn) = ranges.draw(&mut draw, &part) {
            return (part, drawn);
        }
    }
}

/// The seed of a case's finger.
pub(super) fn finger_seed(seed: u64, number: usize) -> u64 {
    seed.wrapping_mul(1_000_003).wrapping_add(number as u64)
}

/// What the host makes of a push, felt with a finger of so much noise and weight; the error where the chain broke.
pub(super) fn felt(
    rig: Result<Rig, RigError>,
    ranges: &Ranges,
    part: &Part,
    drawn: &Drawn,
    number: usize,
) -> Result<Estimate, String> {
    felt_of(rig, course(&drawn.played, &ranges.motion), None, (ranges, part), number)
}

/// The same of what happens to the finger; `told` is what the host takes it for, where that is not what it found by waving it.
fn felt_of(
    rig: Result<Rig, RigError>,
    course: CarriedCourse,
    told: Option<CarriedFinger>,
    (ranges, part): (&Ranges, &Part),
    number: usize,
) -> Result<Estimate, String> {
    let duration = ranges.motion.duration();
    let felt = rig.and_then(|mut rig| Ok((rig.push(course)?, told.unwrap_or_else(|| rig.finger()))));
    let (measured, finger) = felt.map_err(|error| format!("case {number}: {error}"))?;
    let measured =
        measured.sense.windowed_force(duration).ok_or_else(|| format!("case {number}: the push was not felt"))?;
    Ok(from_rest::estimate(&known_of(ranges, part, finger), &measured))
}

/// Runs one case; the error where the chain broke.
fn case(ranges: &Ranges, seed: u64, number: usize) -> Result<TrialOutcome, String> {
    let (part, drawn) = drawn(ranges, seed, number);
    let rig = Rig::start(finger_seed(seed, number), 1.0, Line::Pipe);
    let estimate = felt(rig, ranges, &part, &drawn, number)?;
    Ok(TrialOutcome::new(&part, &drawn, &estimate))
}

/// What the host knows of a push drawn from these ranges.
pub(crate) fn known_of<'a>(ranges: &'a Ranges, part: &'a Part, finger: CarriedFinger) -> KnownFromRest<'a> {
    KnownFromRest {
        part,
        errors: None,
        mu_g: ranges.mu * GRAVITY_ASSUMED,
        mu_g_log_sd: None,
        radius: RADIUS_M,
        shape: ranges.shape,
        finger,
        motion: &ranges.motion,
    }
}

/// What `palpate tables chain` runs.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "chain",
    title: "a part pushed from rest, its pose from the force on the finger, through the whole chain",
    cases: 600,
    run,
};

/// What `palpate tables chain-worlds` runs.
pub(super) const WORLDS: Experiment = Experiment {
    name: "chain-worlds",
    title: "the same pushes by a finger without mass that does not bend, and by one as it is",
    cases: 300,
    run: worlds,
};

/// The world that a push happens in, and what the host knows of its finger.
struct World {
    name: &'static str,
    /// Whether the finger has mass and gives way.
    is_carried: bool,
    /// Whether the host knows that.
    is_told: bool,
}

const WORLDS_TOLD: [World; 3] = [
    World { name: "no mass, stiff", is_carried: false, is_told: true },
    World { name: "as it is, taken for that", is_carried: true, is_told: false },
    World { name: "as it is, and known", is_carried: true, is_told: true },
];

impl World {
    fn case(&self, seed: u64, number: usize) -> Result<TrialOutcome, String> {
        let compliance = if self.is_carried { compliance_by_design() } else { 0.0 };
        let ranges = Ranges { compliance, ..Ranges::default() };
        let (part, drawn) = drawn(&ranges, seed, number);
        let rig = Rig::start(finger_seed(seed, number), 1.0, Line::Pipe);
        let course = if self.is_carried {
            course(&drawn.played, &ranges.motion)
        } else {
            unmoved(STEP_S, drawn.played.forces_evenly().into_iter())
        };
        let told = if self.is_carried && self.is_told { None } else { Some(CarriedFinger::RIGID) };
        let estimate = felt_of(rig, course, told, (&ranges, &part), number)?;
        Ok(TrialOutcome::new(&part, &drawn, &estimate))
    }
}

fn worlds(settings: &TableSettings) -> Table {
    let mut table = Table::new(columns("finger"));
    table.definitions = definitions();
    table.definitions.push(
        "The finger goes with a turn. no mass, stiff: what it feels of its own mass is not in the simulated world, and its tip does not give way. taken for that: the host knows of neither.".to_owned(),
    );
    for world in &WORLDS_TOLD {
        let outcomes = of_each(settings.cases, |number| world.case(settings.seed, number));
        add(&mut table, world.name, &outcomes);
    }
    table
}

/// Headings, the first of what rows are of.
fn columns(first: &'static str) -> impl Iterator<Item = &'static str> {
    let others = ["nearest 95 % mm", "listed", "redrawn"];
    [first, "cases"].into_iter().chain(STATUSES).chain(ERRORS).chain(others)
}

/// Draws, simulates and judges all cases.
fn run(settings: &TableSettings) -> Table {
    let mut table = Table::new(columns("finger's path"));
    table.definitions = definitions();
    let turning = Ranges { compliance: compliance_by_design(), ..Ranges::default() };
    let straight = Ranges { motion: straight_motion(), ..turning.clone() };
    for (name, ranges) in [("with a turn", turning), ("straight", straight)] {
        let outcomes = of_each(settings.cases, |number| case(&ranges, settings.seed, number));
        add(&mut table, name, &outcomes);
    }
    table
}

fn definitions() -> Vec<String> {
    let text = [
        "Drawn: two of three parts convex (hull of 8 points in a disk of 5 cm), one a star of 5 to 8 vertices 2.5 to 5.5 cm out; the contact uniform along the outline, its angle within 46 deg of the finger's way, mu_c 0.1 to 0.5, mass 0.2 to 0.8 kg, mu 0.3; starts redrawn where the finger does not fit, or whose contact does not stay on its edge for 0.8 s.",
        "The finger starts at rest on the part: 0.15 m/s² for 0.3 s, then 0.15 m/s² across for 0.5 s (with a turn), or 0.12 m/s² for 0.8 s (straight). Known to the host: polygon, mu, g, the finger's motion, its effective mass by waving it in the air, and that its tip gives way by 36 um/N.",
        "Each case has its own simulated finger with the datasheet's noise and hum, calibrated on 12 contacts of 2 N through its own firmware and wire.",
        "unique, ambiguous, none: one pose listed, several, or none explains the force. wrong: no listed pose is within 5 of its stated standard deviations (or 0.2 mm and 0.17 deg) of the truth. wrong and certain: so, and only one was listed.",
        "Errors at the end of the push: of the centre of mass and of the angle, of the best pose listed; nearest: of the listed one nearest to the truth. listed: mean number of poses. redrawn: mean number of starts drawn in vain.",
    ];
    text.map(str::to_owned).to_vec()
}

/// Headings of [`statuses`].
pub(super) const STATUSES: [&str; 5] = ["unique", "ambiguous", "none", "wrong", "wrong and certain"];

/// How often answers named one pose, several or none, and a wrong one: of so many cases.
pub(super) fn statuses(outcomes: &[&TrialOutcome], all: usize) -> [Cell; 5] {
    let share = |pick: &dyn Fn(&TrialOutcome) -> bool| Cell::share(outcomes.iter().filter(|it| pick(it)).count(), all);
    [
        share(&|outcome| outcome.status == Status::Unique),
        share(&|outcome| outcome.status == Status::Ambiguous),
        share(&|outcome| outcome.status == Status::Unexplained),
        share(&|outcome| !outcome.holds_truth),
        share(&|outcome| !outcome.holds_truth && outcome.status == Status::Unique),
    ]
}

/// Headings of [`errors_of_best`].
pub(super) const ERRORS: [&str; 4] = ["median mm", "95 % mm", "median deg", "95 % deg"];

/// Errors of the best poses listed, of the centre of mass and of the angle.
pub(super) fn errors_of_best(outcomes: &[&TrialOutcome]) -> [Cell; 4] {
    let best = || outcomes.iter().filter_map(|outcome| outcome.best);
    let millimetres = |per_cent| error_at(per_cent, best().map(|error| error.distance * 1e3));
    let degrees = |per_cent| error_at(per_cent, best().map(|error| error.angle.to_degrees()));
    [millimetres(50), millimetres(95), degrees(50), degrees(95)]
}

fn error_at(per_cent: usize, errors: impl Iterator<Item = f64>) -> Cell {
    percentile(errors, per_cent).map_or(Cell::Empty, |error| Cell::number(error, 3))
}

fn add(table: &mut Table, name: &str, outcomes: &[Result<TrialOutcome, String>]) {
    let sound: Vec<_> = outcomes.iter().filter_map(|outcome| outcome.as_ref().ok()).collect();
    let all = outcomes.len();
    let nearest = error_at(95, sound.iter().filter_map(|outcome| outcome.nearest).map(|error| error.distance * 1e3));
    let listed = sound.iter().map(|outcome| outcome.listed).sum::<usize>();
    let redrawn = sound.iter().map(|outcome| outcome.redrawn).sum::<usize>();
    let mean = |sum: usize, of: usize| sum as f64 / (of as f64).max(1.0);
    let cells = [name.into(), Cell::count(all)].into_iter().chain(statuses(&sound, all));
    table.push(cells.chain(errors_of_best(&sound)).chain([
        nearest,
        Cell::number(mean(listed, all), 2),
        Cell::number(mean(redrawn, all), 1),
    ]));
    table.failures.extend(outcomes.iter().enumerate().filter_map(|(number, outcome)| match outcome {
        Ok(outcome) if outcome.holds_truth => None,
        Ok(outcome) => Some(format!("{name}, case {number}: {outcome:?}")),
        Err(error) => Some(format!("{name}, {error}")),
    }));
}
