//! The planner of pushes: how often poses stay ambiguous if the finger goes straight on, aside, or as the planner says.
//!
//! A finger pushes a random part straight for a moment; the estimator lists, from noisy contact angles, where the part
//! may be; the planner chooses how to go on, and once more when it has felt what came of that. Whether another pose
//! could have been felt the same is decided on the exact angles of the whole push by [`rivals`](super::rivals), which
//! shares nothing with estimator and planner but the dynamics and the arithmetic of least squares.
//!
//! Units: SI inside, as the headings say in the table. Errors: none.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Point2, Vector2};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::pushing::dynamics::{ContactLaw, EdgeEnd, Finger, Part, Push, PushModel, Sample, Start, State};
use palpate::pushing::estimation::planning::{
    AMBIGUOUS_BELOW, PlannedMotion, Present, Sampling, SensedAngle, motions, prospects, updated,
};
use palpate::pushing::estimation::{Belief, Hypothesis};
use palpate::pushing::estimation::{Channel, Known, Measured, Observation, Prior, Touch, estimate};
use palpate::pushing::finger_motion::Segment;

use super::cases::{of_each, random_part};
use super::rivals::{Leg, Truth};
use super::{Cell, Experiment, Table, TableSettings};

/// Time between values, s.
pub(super) const DT_S: f64 = 0.01;

/// Values of the straight beginning and of the whole push, the first included.
const VALUES_FIRST: usize = 11;
/// Values of the whole push, the first included.
const VALUES: usize = 81;

/// Values until the planner chooses again, the first included.
const VALUES_SECOND: usize = 41;

/// Fewest values of a push that counts.
const VALUES_MIN: usize = 31;

/// rad: 0.5° each 0.5 ms, averaged over 10 ms.
pub(super) const SIGMA_RAD: f64 = 0.112 / 180.0 * std::f64::consts::PI;

/// How the angles are felt.
const SAMPLING: Sampling = Sampling { dt: DT_S, sigma: SIGMA_RAD, sensed: SensedAngle::ContactAngle };

/// µ g, m/s².
pub(super) const MU_G: f64 = 0.3 * GRAVITY_ASSUMED;

/// Of the finger at first, m/s, and of what it then can do, m/s².
const SPEED: f64 = 0.05;
/// See [`SPEED`]: as the finger of the demonstration turns.
const ACCELERATION: f64 = 0.15;

/// Standard deviation of ω at the start, rad/s.
pub(super) const OMEGA_SIGMA: f64 = 1.0;

/// What is known of the start.
const PRIOR: Prior = Prior { omega0_sigma: Some(OMEGA_SIGMA), v_t0_sigma: None, mu_g_log_sigma: None };

/// What `palpate tables plan` runs.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "plan",
    title: "poses that stay ambiguous after a straight push, and after one that the planner chose",
    cases: 200,
    run,
};

/// A part and how it is touched.
#[derive(Clone, Debug)]
pub(super) struct Case {
    pub(super) part: Part,
    pub(super) edge: usize,
    pub(super) start: State,
    /// Noise of the values, in standard deviations.
    noise: Vec<f64>,
}

/// Exact contact angles of a push, as long as it lasted.
#[derive(Clone, Debug)]
struct PushAngles {
    angles: Vec<f64>,
    /// Place on the edge at the last of them, m.
    s_end: f64,
    /// µ_c that it needed.
    friction: f64,
}

/// Which motions leave a case ambiguous.
#[derive(Clone, Debug, Default)]
struct Outcome {
    /// Of each motion on offer: whether it leaves the case ambiguous, and the friction that it needs.
    motions: Vec<(bool, f64)>,
    /// The planner's choice among them.
    choice: usize,
    /// The same as of a motion on offer, of the one that comes of choosing twice.
    twice: (bool, f64),
}

/// The finger on its straight beginning.
pub(super) fn finger_first() -> Finger {
    Finger {
        radius: 0.01,
        centre0: Point2::origin(),
        velocity0: Vector2::new(0.0, SPEED),
        acceleration: Vector2::zeros(),
    }
}

/// The straight beginning and what follows.
fn legs(then: &PlannedMotion) -> Vec<Leg> {
    let first = Leg { finger: finger_first(), values: VALUES_FIRST - 1 };
    let mut legs = vec![first];
    for &Segment { seconds, acceleration } in &then.segments {
        let finger = Finger { acceleration, ..after(&legs[legs.len() - 1]) };
        legs.push(Leg { finger, values: count(seconds) });
    }
    legs
}

/// The first so many seconds of a motion.
fn beginning(motion: &PlannedMotion, seconds: f64) -> PlannedMotion {
    let mut left = seconds;
    let segments = motion.segments.iter().map_while(|segment| {
        let seconds = segment.seconds.min(left);
        left -= seconds;
        (count(seconds) > 0).then_some(Segment { seconds, ..*segment })
    });
    PlannedMotion { name: motion.name, segments: segments.collect() }
}

/// The finger after a leg.
fn after(leg: &Leg) -> Finger {
    let ends = seconds(leg.values);
    Finger { centre0: leg.finger.centre(ends), velocity0: leg.finger.velocity(ends), ..leg.finger }
}

/// The finger at the end of its straight beginning.
fn present_finger() -> Finger {
    after(&legs(&PlannedMotion { name: "", segments: Vec::new() })[0])
}

/// What the finger can do after its beginning.
fn offered_first() -> Vec<PlannedMotion> {
    offered(VALUES - VALUES_FIRST)
}

/// What the finger can do for so many values.
fn offered(values: usize) -> Vec<PlannedMotion> {
    motions(Vector2::new(0.0, SPEED), ACCELERATION, seconds(values))
}

/// How many values a time (s) has.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the values of a push")]
fn count(seconds: f64) -> usize {
    (seconds / DT_S).round().max(0.0) as usize
}

/// Time from one value to the one so many later, s.
fn seconds(values: usize) -> f64 {
    values as f64 * DT_S
}

impl Case {
    /// The case of a number under a seed: drawn until every motion keeps the contact for long enough.
    fn draw(seed: u64, number: usize) -> (Self, Vec<PushAngles>) {
        let mut draw = Draw::case(seed, number);
        let offered = offered_first();
        loop {
            let Some(case) = Self::try_draw(&mut draw) else { continue };
            let measured: Option<Vec<_>> = offered.iter().map(|motion| case.push(motion)).collect();
            if let Some(measured) = measured {
                return (case, measured);
            }
        }
    }

    pub(super) fn try_draw(draw: &mut Draw) -> Option<Self> {
        let part = random_part(draw);
        let edge = draw.index(part.polygon().vertices().len());
        let line = part.edge(edge).ok()?;
        let s = draw.uniform(line.s_min, line.s_max);
        let u = FRAC_PI_2 + draw.uniform(-0.3, 0.3);
        let omega = OMEGA_SIGMA * draw.normal();
        let noise = (0..VALUES).map(|_| draw.normal()).collect();
        Some(Self { part, edge, start: State { u, s, omega, v_t: 0.0 }, noise })
    }

    pub(super) fn model(&self, edge: usize, finger: Finger) -> Option<PushModel<'_>> {
        Some(PushModel { part: &self.part, edge: self.part.edge(edge).ok()?, mu_g: MU_G, finger })
    }

    /// What is felt if the finger goes on so; none if it loses the part too soon.
    fn push(&self, then: &PlannedMotion) -> Option<PushAngles> {
        let law = ContactLaw::Rolling { friction: None };
        let mut samples: Vec<Sample> = Vec::new();
        let mut state = self.start;
        for Leg { finger, values } in legs(then) {
            let push = Push::new(self.model(self.edge, finger)?, law, Start::Moving(state), EdgeEnd::Stop).ok()?;
            let times: Vec<_> = (0..=values).map(seconds).collect();
            let run = push.run(&times).ok()?.samples;
            // The first sample of a leg is the last of the one before.
            samples.extend(run.get(usize::from(!samples.is_empty())..)?.iter().copied());
            match run.last() {
                Some(last) if run.len() == times.len() => state = last.state,
                _ => break,
            }
        }
        let s_end = samples.last()?.state.s;
        let needed = |sample: &Sample| sample.force.map_or(0.0, |force| (force.tangential / force.normal).abs());
        let friction = samples.iter().map(needed).fold(0.0, f64::max);
        let angles: Vec<_> = samples.iter().map(|sample| sample.state.u).collect();
        (angles.len() >= VALUES_MIN).then_some(PushAngles { angles, s_end, friction })
    }

    /// The motion that the planner chooses after the beginning, by its place among those on offer.
    fn choice(&self, beliefs: &[Belief]) -> usize {
        let offered = offered_first();
        let best = prospects(&self.present(&present_finger()), beliefs, &offered, SAMPLING).into_iter().next();
        best.and_then(|best| offered.iter().position(|motion| *motion == best.motion)).unwrap_or(0)
    }

    /// The motion that comes of choosing, and of choosing again by what was felt since.
    fn choices(&self, mut beliefs: Vec<Belief>) -> PlannedMotion {
        let mut made = PlannedMotion { name: "chosen twice", segments: Vec::new() };
        for (from, to) in [(VALUES_FIRST - 1, VALUES_SECOND - 1), (VALUES_SECOND - 1, VALUES - 1)] {
            let finger = legs(&made).last().map_or_else(present_finger, after);
            let present = self.present(&finger);
            let best = prospects(&present, &beliefs, &offered(VALUES - 1 - from), SAMPLING).into_iter().next();
            let Some(best) = best else { break };
            let stretch = beginning(&best.motion, seconds(to - from));
            made.segments.extend(&stretch.segments);
            let measured = self.push(&made).map_or_else(Vec::new, |measured| self.noisy(&measured.angles));
            let Some(measured) = measured.get(from + 1..=to) else { break };
            beliefs = updated(&present, &beliefs, &stretch, measured, SAMPLING);
        }
        made
    }

    /// Angles as they are felt.
    fn noisy(&self, angles: &[f64]) -> Vec<f64> {
        angles.iter().zip(&self.noise).map(|(angle, noise)| angle + SIGMA_RAD * noise).collect()
    }

    /// Whether a pose other than the truth has a cost below [`AMBIGUOUS_BELOW`] on the exact angles of a push.
    fn is_ambiguous(&self, then: &PlannedMotion, measured: &PushAngles) -> bool {
        let truth = Truth {
            part: &self.part,
            mu_g: MU_G,
            legs: &legs(then),
            touch: Touch::Rolling { friction: None },
            edge: self.edge,
            start: self.start,
            s_end: measured.s_end,
            angles: &measured.angles,
            dt: DT_S,
            sigma: SIGMA_RAD,
            prior: PRIOR,
            // These pushes are drawn without a look at it.
            is_clear: false,
        };
        truth.has_rival(AMBIGUOUS_BELOW)
    }

    fn present(&self, finger: &Finger) -> Present<'_> {
        let Finger { radius, centre0: centre, velocity0: velocity, .. } = *finger;
        Present { part: &self.part, mu_g: MU_G, radius, centre, velocity }
    }

    /// Where the part may be after the beginning, by what was felt of it.
    fn beliefs(&self, angles: &[f64]) -> Vec<Belief> {
        let touch = Touch::Rolling { friction: None };
        let known = Known { part: &self.part, mu_g: MU_G, finger: finger_first(), touch };
        let values =
            angles.iter().take(VALUES_FIRST).zip(&self.noise).map(|(angle, noise)| angle + SIGMA_RAD * noise).collect();
        let measured = Measured::ContactAngle(Channel { values, sigma: SIGMA_RAD });
        let observation = Observation { dt: DT_S, measured, prior: PRIOR };
        estimate(&known, &observation).hypotheses.iter().filter_map(Hypothesis::belief).collect()
    }
}

/// Draws, simulates and judges all cases.
fn run(settings: &TableSettings) -> Table {
    let outcomes = outcomes(settings, outcome);
    let mut table =
        Table::new(["after a straight beginning", "cases", "ambiguous", "straight on / this", "mu_c needed, median"]);
    table.definitions = definitions();
    let mut push = |name: &str, of: &dyn Fn(&Outcome) -> (bool, f64)| {
        let found: Vec<_> = outcomes.iter().map(of).collect();
        let ambiguous = found.iter().filter(|(ambiguous, _)| *ambiguous).count();
        let straight = outcomes.iter().filter(|outcome| outcome.motions[0].0).count();
        let ratio = if ambiguous > 0 { Cell::number(straight as f64 / ambiguous as f64, 1) } else { Cell::Empty };
        // Of the best in hindsight there is none: it is another motion in each case.
        let median =
            percentile(found.iter().map(|(_, friction)| *friction), 50).filter(|friction| friction.is_finite());
        let friction = median.map_or(Cell::Empty, |median| Cell::number(median, 2));
        table.push([name.into(), Cell::count(outcomes.len()), Cell::share(ambiguous, outcomes.len()), ratio, friction]);
    };
    for (place, motion) in offered_first().iter().enumerate() {
        push(motion.name, &|outcome| outcome.motions[place]);
    }
    push("as the planner says, once", &|outcome| outcome.motions[outcome.choice]);
    push("as the planner says, twice", &|outcome| outcome.twice);
    push("best of the eight, in hindsight", &|outcome| (outcome.is_ambiguous_anyway(), f64::NAN));
    for (case, _) in outcomes.iter().enumerate().filter(|(_, outcome)| outcome.twice.0) {
        table.failures.push(format!("case {case}: ambiguous although planned twice"));
    }
    table
}

impl Outcome {
    fn is_ambiguous_anyway(&self) -> bool {
        self.motions.iter().all(|(ambiguous, _)| *ambiguous)
    }
}

fn definitions() -> Vec<String> {
    let text = [
        "Rolling contact, mu 0.3, disk of 1 cm. Parts: 60 % hulls of 3 to 9 random points, 40 % star-shaped polygons, all within 5 cm; edge and place random, contact within 17 deg of straight ahead, omega N(0, 1 rad/s); drawn anew if a motion loses the contact within 0.3 s.".to_owned(),
        format!("The finger pushes straight at 5 cm/s for 0.1 s, then goes on for 0.7 s as the row says, sideways or ahead with {:.0} cm/s2; over to the other side after a third of that. Data end where the contact does.", ACCELERATION * 100.0),
        format!("The planner chooses among the eight motions above it, from the poses that the estimator lists after the first 0.1 s of contact angles at 100 Hz with {:.3} deg of noise; twice: it keeps its choice for 0.3 s and chooses again for the last 0.4 s, from those poses fitted to what was felt since.", SIGMA_RAD.to_degrees()),
        "ambiguous: another edge, or an end more than 2 mm away, explains the exact angles of the whole push with D2 < 36 at that noise.".to_owned(),
        "mu_c needed: the contact does not slip in these draws; with less friction than this it would, at some moment of the push. Towards the end of contact the normal force vanishes, and with it what friction can hold.".to_owned(),
    ];
    text.to_vec()
}

/// All cases, on as many threads as the machine has; in order.
pub(super) fn outcomes<O: Send>(settings: &TableSettings, outcome: impl Fn(u64, usize) -> O + Sync) -> Vec<O> {
    of_each(settings.cases, |number| outcome(settings.seed, number))
}

fn outcome(seed: u64, number: usize) -> Outcome {
    let (case, measured) = Case::draw(seed, number);
    let judged =
        |motion: &PlannedMotion, measured: &PushAngles| (case.is_ambiguous(motion, measured), measured.friction);
    let motions = offered_first().iter().zip(&measured).map(|(motion, measured)| judged(motion, measured)).collect();
    let beliefs = case.beliefs(&measured[0].angles);
    let choice = case.choice(&beliefs);
    let chosen = case.choices(beliefs);
    // A contact that ended too soon tells too little.
    let twice = case.push(&chosen).map_or((true, f64::INFINITY), |measured| judged(&chosen, &measured));
    Outcome { motions, choice, twice }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_are_the_same_each_time_and_all_begin_alike() {
        let (case, measured) = Case::draw(1, 3);
        let (again, _) = Case::draw(1, 3);
        assert_eq!((case.edge, case.start, &case.noise), (again.edge, again.start, &again.noise));
        let beginning = |measured: &PushAngles| measured.angles[..VALUES_FIRST].to_vec();
        assert!(measured.iter().all(|other| beginning(other) == beginning(&measured[0])));
    }

    #[test]
    fn a_part_with_two_like_edges_is_ambiguous_however_it_is_pushed() {
        let corners = [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(nalgebra::Point2::from);
        let part = Part::uniform(palpate::geometry::SimplePolygon::new(corners).unwrap());
        let start = State { u: FRAC_PI_2 + 0.1, s: 0.008, omega: 0.0, v_t: 0.0 };
        let case = Case { part, edge: 0, start, noise: vec![0.0; VALUES] };
        for motion in offered_first() {
            assert!(case.is_ambiguous(&motion, &case.push(&motion).unwrap()), "{motion:?}");
        }
    }

    #[test]
    fn a_lone_short_edge_is_told_apart() {
        // A triangle whose edges differ by far in their distance from the centre of mass.
        let corners = [[-0.05, -0.005], [0.05, -0.005], [0.04, 0.02]].map(nalgebra::Point2::from);
        let part = Part::uniform(palpate::geometry::SimplePolygon::new(corners).unwrap());
        let edge = 1;
        let line = part.edge(edge).unwrap();
        let s = 0.5 * (line.s_min + line.s_max) + 0.004;
        let start = State { u: FRAC_PI_2, s, omega: 0.0, v_t: 0.0 };
        let case = Case { part, edge, start, noise: vec![0.0; VALUES] };
        let clear =
            |motion: &PlannedMotion| case.push(motion).is_some_and(|measured| !case.is_ambiguous(motion, &measured));
        assert!(offered_first().iter().any(clear));
    }
}
