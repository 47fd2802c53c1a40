//! Planning and telling parts apart through the whole chain: what `plan` and `parts` show of ideal contact angles, by the force
//! that a carried finger feels.
//!
//! Each case is a finger of its own, calibrated, waved in the air and pushed as in [`super::chain`]: it accelerates, rings and
//! bends, and the host knows of the part only what a person would tell it.
//!
//! Units: as the columns' headings say. Errors: none; a chain that broke is a failure.

use nalgebra::Vector2;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::from_rest::trial::{
    Drawn, RADIUS_M, Ranges, TrialOutcome, random_part, straight_motion,
};
use palpate::pushing::estimation::from_rest::{self, WindowedForce};
use palpate::pushing::estimation::planning::{self, PlannedMotion, Sampling, SensedAngle};
use palpate::pushing::estimation::{Hypothesis, Observer as _, which_part};
use palpate::pushing::finger_motion::{FingerMotion, Segment};
use palpate::pushing::pushed_world::{Played, PushedWorld};
use palpate_device::simulated::Line;

use super::cases::of_each;
use super::chain::{STATUSES, drawn, finger_seed, known_of, statuses};
use super::demonstration::{Rig, RigError, compliance_by_design, course};
use super::parts::{self, DOUBT, Outcome as PartOutcome};
use super::plan::{DT_S, SIGMA_RAD};
use super::{Cell, Experiment, Table, TableSettings};

/// What `palpate tables plan-chain` runs.
pub(super) const PLAN: Experiment = Experiment {
    name: "plan-chain",
    title: "the same as `plan` by the force on a carried finger, through the whole chain",
    cases: 100,
    run: plan,
};

/// What `palpate tables parts-chain` runs.
pub(super) const PARTS: Experiment = Experiment {
    name: "parts-chain",
    title: "the same as `parts` by the force on a carried finger, through the whole chain",
    cases: 100,
    run: which_parts,
};

/// Ranges of the chain, with another motion of the finger.
pub(super) fn ranges(motion: FingerMotion) -> Ranges {
    Ranges { compliance: compliance_by_design(), motion, ..Ranges::default() }
}

/// What a rig feels of a push with this motion, up to its end.
pub(super) fn felt(
    rig: &mut Rig,
    played: &Played,
    motion: &FingerMotion,
    until: f64,
) -> Result<Option<WindowedForce>, RigError> {
    let measured = rig.push(course(played, motion))?.sense.windowed_force(until);
    Ok(measured.filter(|measured| measured.count() >= from_rest::WINDOWS_MIN))
}

/// How many parts are known, and whether the finger turns.
const PART_ROWS: [(&str, usize, bool); 3] =
    [("2, straight", 2, false), ("2, with a turn", 2, true), ("5, with a turn", 5, true)];

fn which_parts(settings: &TableSettings) -> Table {
    let mut table = Table::new(parts::COLUMNS);
    table.definitions = [
        "Pushed as in the table `chain`: a random part from rest, with a turn or straight, felt by a finger of its own with the datasheet's noise and hum, calibrated and waved. The other parts are drawn alike. Known: all parts, the finger's motion, mu, the finger's mass and bending. Any edge of any part may have been touched, anywhere; mass and mu_c are found.".to_owned(),
        parts::in_words(),
    ]
    .to_vec();
    for (name, count, turns) in PART_ROWS {
        let ranges = if turns { ranges(Ranges::default().motion) } else { ranges(straight_motion()) };
        let outcomes = of_each(settings.cases, |number| part_outcome(&ranges, settings.seed, number, count));
        let sound: Vec<_> = outcomes.iter().filter_map(|outcome| outcome.as_ref().ok()).collect();
        let cells = [name.into(), Cell::count(outcomes.len())];
        table.push(cells.into_iter().chain(PartOutcome::shares(&sound, outcomes.len())));
        table.failures.extend(outcomes.iter().enumerate().filter_map(|(number, outcome)| match outcome {
            Ok(outcome) if outcome.truth > DOUBT => None,
            Ok(_) => Some(format!("{name}, case {number}: the part that was pushed is excluded")),
            Err(error) => Some(format!("{name}, case {number}: {error}")),
        }));
    }
    table
}

fn part_outcome(ranges: &Ranges, seed: u64, number: usize, count: usize) -> Result<PartOutcome, String> {
    let (part, drawn) = drawn(ranges, seed, number);
    let mut draw = Draw::case(seed ^ OTHERS, number);
    let others: Vec<Part> = (1..count).map(|_| random_part(&mut draw)).collect();
    let mut rig = Rig::start(finger_seed(seed, number), 1.0, Line::Pipe).map_err(|error| error.to_string())?;
    let measured = felt(&mut rig, &drawn.played, &ranges.motion, ranges.motion.duration());
    let measured = measured.map_err(|error| error.to_string())?.ok_or("the push was not felt")?;
    let known: Vec<_> =
        std::iter::once(&part).chain(&others).map(|part| known_of(ranges, part, rig.finger())).collect();
    let ranked = which_part(known.iter().map(|known| (known.part, known.estimate(&measured))));
    let of = |truth: bool| ranked.iter().filter(move |part| (part.part == 0) == truth).map(|part| part.probability);
    Ok(PartOutcome { truth: of(true).sum(), other: of(false).fold(0.0, f64::max) })
}

/// Of the other parts' draws, so that they are not the pushed ones.
const OTHERS: u64 = 0x5EED_0F0D_D0FF_5E75;

/// The straight beginning, s, and its acceleration, m/s².
const BEGINNING: Segment = Segment { seconds: 0.3, acceleration: Vector2::new(0.15, 0.0) };

/// How long the finger goes on, s, and how strongly it may turn, m/s².
const THEN: (f64, f64) = (0.5, 0.15);

/// What is felt of the force's direction in a hundredth of a second, as of the contact angle in the table `plan`.
const SAMPLING: Sampling = Sampling { sensed: SensedAngle::ForceDirection, dt: DT_S, sigma: SIGMA_RAD };

/// What came of a push that goes straight on, and of one that goes on as planned.
struct Planned {
    straight: TrialOutcome,
    planned: TrialOutcome,
    /// Whether the plan was to turn.
    turns: bool,
}

fn plan(settings: &TableSettings) -> Table {
    let columns = ["after a straight beginning", "cases"].into_iter().chain(STATUSES);
    let mut table = Table::new(columns.chain(["listed"]));
    table.definitions = [
        format!("Drawn and felt as in the table `chain`. The finger pushes straight with {} m/s² for {} s; from the poses that are left the planner chooses among its motions of {} m/s² for {} s, from the directions of the force at 100 Hz with 0.112 deg of noise. straight on: {} m/s² ahead, from the same start.", BEGINNING.acceleration.x, BEGINNING.seconds, THEN.1, THEN.0, BEGINNING.acceleration.x),
        "unique, ambiguous, none, wrong, wrong and certain, listed: as in the table `chain`, at the end of the push, or where the contact ends.".to_owned(),
    ]
    .to_vec();
    let ranges = ranges(motion(&[Segment { seconds: THEN.0, ..BEGINNING }]));
    let outcomes = of_each(settings.cases, |number| planned(&ranges, settings.seed, number));
    let sound: Vec<_> = outcomes.iter().filter_map(|outcome| outcome.as_ref().ok()).collect();
    let mut push = |name: &str, of: &[&TrialOutcome]| {
        let all = of.len();
        let listed = of.iter().map(|it| it.listed).sum::<usize>() as f64 / (all as f64).max(1.0);
        let cells = [name.into(), Cell::count(all)].into_iter().chain(statuses(of, all));
        table.push(cells.chain([Cell::number(listed, 2)]));
    };
    push("straight on", &sound.iter().map(|it| &it.straight).collect::<Vec<_>>());
    push("as the planner says", &sound.iter().map(|it| &it.planned).collect::<Vec<_>>());
    let turns = sound.iter().filter(|it| it.turns).count();
    table.notes.push(format!("The planner turned the finger, or slowed it, in {turns} of {} cases.", sound.len()));
    table.failures.extend(outcomes.iter().enumerate().filter_map(|(number, outcome)| match outcome {
        Ok(it) if it.planned.holds_truth => None,
        Ok(it) => Some(format!("planned, case {number}: {:?}", it.planned)),
        Err(error) => Some(format!("case {number}: {error}")),
    }));
    table
}

/// The beginning and what follows.
fn motion(then: &[Segment]) -> FingerMotion {
    let segments = [&[BEGINNING], then].concat();
    FingerMotion::new(nalgebra::Point2::origin(), &segments).expect("the planner's segments are sound")
}

fn planned(ranges: &Ranges, seed: u64, number: usize) -> Result<Planned, String> {
    let (part, drawn) = drawn(ranges, seed, number);
    let told = |error: RigError| error.to_string();
    let mut rig = Rig::start(finger_seed(seed, number), 1.0, Line::Pipe).map_err(told)?;
    let known = known_of(ranges, &part, rig.finger());
    let pushed = rig.push(course(&drawn.played, &ranges.motion)).map_err(told)?.sense;
    let whole = pushed.windowed_force(ranges.motion.duration()).ok_or("the push was not felt")?;
    let straight = TrialOutcome::new(&part, &drawn, &from_rest::estimate(&known, &whole));

    let begun = pushed.windowed_force(BEGINNING.seconds).ok_or("its beginning was not felt")?;
    let begun = from_rest::estimate(&known, &begun);
    let beliefs: Vec<_> = begun.hypotheses.iter().filter_map(Hypothesis::belief).collect();
    let present = known.present(&begun);
    let motions = planning::motions(present.velocity, THEN.1, THEN.0);
    let best = planning::prospects(&present, &beliefs, &motions, SAMPLING).into_iter().next().map(|best| best.motion);
    let Some(best) = best.filter(|best| !best.is_straight()) else {
        return Ok(Planned { planned: straight.clone(), straight, turns: false });
    };
    let planned = goes_on(&mut rig, ranges, &part, &drawn, &best)?;
    Ok(Planned { straight, planned, turns: true })
}

/// The same push, going on as planned.
fn goes_on(
    rig: &mut Rig,
    of_beginning: &Ranges,
    part: &Part,
    drawn: &Drawn,
    then: &PlannedMotion,
) -> Result<TrialOutcome, String> {
    let ranges = Ranges { motion: motion(&then.segments), ..of_beginning.clone() };
    let Drawn { mu_c, mass, edge, u, s, .. } = *drawn;
    let (mu_g, radius, motion) = (ranges.mu * GRAVITY_ASSUMED, RADIUS_M, &ranges.motion);
    let world = PushedWorld { part, mu_g, mass, mu_c, radius, motion, edge, u, s };
    let played = world.play().map_err(|error| error.to_string())?.bent(ranges.compliance);
    let until = played.duration();
    let measured = felt(rig, &played, motion, until).map_err(|error| error.to_string())?;
    let measured = measured.ok_or("the planned push was not felt")?;
    let estimate = from_rest::estimate(&known_of(&ranges, part, rig.finger()), &measured);
    Ok(TrialOutcome::new(part, &Drawn { played, ..drawn.clone() }, &estimate))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Short runs; the full ones are `palpate tables plan-chain parts-chain`.
    #[test]
    fn a_part_felt_by_a_carried_finger_is_not_excluded() {
        let outcome = part_outcome(&ranges(Ranges::default().motion), 1, 0, 2).unwrap();
        assert!(outcome.truth > DOUBT, "{outcome:?}");
    }

    #[test]
    fn a_planned_push_of_a_carried_finger_lists_the_truth() {
        let ranges = ranges(motion(&[Segment { seconds: THEN.0, ..BEGINNING }]));
        let planned = planned(&ranges, 1, 0).unwrap();
        assert!(planned.straight.holds_truth && planned.planned.holds_truth, "{:?}", planned.planned);
        assert!(planned.planned.listed <= planned.straight.listed, "{:?}", planned.planned);
    }
}
