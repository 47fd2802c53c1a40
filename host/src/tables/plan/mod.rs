//! The planner of pushes: how often poses stay ambiguous if the finger goes straight on, aside, or as the planner says.
//!
//! A finger pushes a random part straight for a while; the estimator lists, from noisy contact angles, where the part may be; the
//! planner chooses how to go on. Whether the whole push then could have been felt at another pose is decided on its exact angles by
//! `rivals`, which shares nothing with estimator or planner but the dynamics.
//!
//! Units: SI inside, as the headings say in the table. Errors: none.

mod rivals;

use std::f64::consts::FRAC_PI_2;
use std::num::NonZeroUsize;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::random::Draw;
use super::{Cell, Experiment, Settings, Table};
use crate::observing::planning::{Belief, Felt, Present, Sampling, motions, prospects};
use crate::observing::{Channel, Known, Measured, Observation, Prior, Touch, estimate};
use crate::pushing::{ContactLaw, EdgeEnd, Finger, Part, Push, PushModel, Sample, Start, State};

/// Time between values, s.
pub(super) const DT_S: f64 = 0.01;

/// Values of the straight beginning, its end included, and of the whole push.
const VALUES_FIRST: u32 = 21;
/// See [`VALUES_FIRST`].
const VALUES: u32 = 81;
/// Fewest values of a push that counts.
const VALUES_MIN: usize = 31;

/// rad: 0.5° each 0.5 ms, averaged over 10 ms.
pub(super) const SIGMA_RAD: f64 = 0.112 / 180.0 * std::f64::consts::PI;

/// µ g, m/s².
pub(super) const GRIP: f64 = 0.3 * 9.81;

/// Of the finger at first, m/s, and of what it then can do, m/s².
const SPEED: f64 = 0.05;
/// See [`SPEED`].
const ACCELERATION: f64 = 0.08;

/// Standard deviation of ω at the start, rad/s.
pub(super) const OMEGA_SIGMA: f64 = 1.0;

/// Places of these motions among those on offer.
const FIXED: [(&str, usize); 4] = [("straight on", 0), ("to the left", 1), ("to the right", 2), ("faster ahead", 3)];

/// The table `plan`.
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
    /// Noise of the first values, in standard deviations.
    noise: Vec<f64>,
}

/// Exact contact angles of a push, as long as it lasted.
#[derive(Clone, Debug)]
struct FeltPush {
    angles: Vec<f64>,
    /// Place on the edge at the last of them, m.
    s_end: f64,
}

/// Which motions leave a case ambiguous.
#[derive(Clone, Debug, Default)]
struct Outcome {
    fixed: [bool; FIXED.len()],
    planned: bool,
    /// Whether each of those tried does.
    all: bool,
}

/// The finger on its straight beginning.
pub(super) fn finger_first() -> Finger {
    Finger { radius: 0.01, centre0: [0.0; 2], velocity0: [0.0, SPEED], acceleration: [0.0; 2] }
}

/// The finger afterwards, in time since then.
fn finger_then(acceleration: [f64; 2]) -> Finger {
    let first = finger_first();
    Finger { centre0: first.centre(turn_s()).coords.into(), acceleration, ..first }
}

fn turn_s() -> f64 {
    f64::from(VALUES_FIRST - 1) * DT_S
}

fn accelerations() -> Vec<[f64; 2]> {
    motions([0.0, SPEED], ACCELERATION)
}

impl Case {
    /// The case of a number under a seed: drawn until every motion keeps the contact for long enough.
    fn draw(seed: u64, number: usize) -> (Self, Vec<FeltPush>) {
        let mut draw = Draw::case(seed, number);
        loop {
            let Some(case) = Self::try_draw(&mut draw) else { continue };
            let felt: Option<Vec<_>> = accelerations().into_iter().map(|motion| case.push(motion)).collect();
            if let Some(felt) = felt {
                return (case, felt);
            }
        }
    }

    pub(super) fn try_draw(draw: &mut Draw) -> Option<Self> {
        let polygon = if draw.chance(0.6) {
            let points = 3 + draw.index(7);
            draw.convex_polygon(points, 0.05)
        } else {
            let vertices = 4 + draw.index(6);
            draw.star_polygon(vertices, 0.02, 0.05)
        };
        let part = Part::uniform(polygon);
        let edge = draw.index(part.polygon().vertices().len());
        let line = part.edge(edge).ok()?;
        let s = draw.uniform(line.s_min, line.s_max);
        let u = FRAC_PI_2 + draw.uniform(-0.3, 0.3);
        let omega = OMEGA_SIGMA * draw.normal();
        let noise = (0..VALUES_FIRST).map(|_| draw.normal()).collect();
        Some(Self { part, edge, start: State { u, s, omega, v_t: 0.0 }, noise })
    }

    pub(super) fn model(&self, edge: usize, finger: Finger) -> Option<PushModel<'_>> {
        Some(PushModel { part: &self.part, edge: self.part.edge(edge).ok()?, grip: GRIP, finger })
    }

    /// What is felt if the finger goes on with an acceleration; none if it loses the part too soon.
    fn push(&self, acceleration: [f64; 2]) -> Option<FeltPush> {
        let run = |finger, start, count: u32| {
            let law = ContactLaw::Rolling { friction: None };
            let push = Push::new(self.model(self.edge, finger)?, law, Start::Moving(start), EdgeEnd::Stop).ok()?;
            let times: Vec<_> = (0..count).map(|i| f64::from(i) * DT_S).collect();
            push.run(&times).ok().map(|run| run.samples)
        };
        let first: Vec<Sample> = run(finger_first(), self.start, VALUES_FIRST)?;
        let turn = first.get(usize::try_from(VALUES_FIRST).ok()? - 1)?.state;
        let then = run(finger_then(acceleration), turn, VALUES - VALUES_FIRST + 1)?;
        let states: Vec<_> = first.iter().chain(&then[1..]).map(|sample| sample.state).collect();
        let s_end = states.last()?.s;
        (states.len() >= VALUES_MIN).then(|| FeltPush { angles: states.iter().map(|state| state.u).collect(), s_end })
    }

    /// The motion that the planner chooses after the beginning, by its place among those on offer.
    fn choice(&self, angles: &[f64]) -> usize {
        let beliefs = self.beliefs(angles);
        let finger = finger_then([0.0; 2]);
        let present = Present {
            part: &self.part,
            grip: GRIP,
            radius: finger.radius,
            centre: finger.centre0,
            velocity: finger.velocity0,
        };
        let sampling = Sampling { dt: DT_S, sigma: SIGMA_RAD, felt: Felt::ContactAngle };
        let horizon = f64::from(VALUES - VALUES_FIRST) * DT_S;
        let offered = accelerations();
        let best = prospects(&present, &beliefs, &offered, sampling, horizon).into_iter().next();
        best.and_then(|best| {
            offered.iter().position(|motion| motion.map(f64::to_bits) == best.acceleration.map(f64::to_bits))
        })
        .unwrap_or(0)
    }

    /// Where the part may be after the beginning, by what was felt of it.
    fn beliefs(&self, angles: &[f64]) -> Vec<Belief> {
        let touch = Touch::Rolling { friction: None };
        let known = Known { part: &self.part, grip: GRIP, finger: finger_first(), touch };
        let values = angles.iter().zip(&self.noise).map(|(angle, noise)| angle + SIGMA_RAD * noise).collect();
        let observation = Observation {
            dt: DT_S,
            measured: Measured::ContactAngle(Channel { values, sigma: SIGMA_RAD }),
            prior: Prior { omega0_sigma: Some(OMEGA_SIGMA), v_t0_sigma: None },
        };
        estimate(&known, &observation).hypotheses.iter().filter_map(|hypothesis| hypothesis.belief(&known)).collect()
    }
}

/// Runs the experiment.
fn run(settings: &Settings) -> Table {
    let outcomes = outcomes(settings, outcome);
    let mut table = Table::new(["after a straight beginning", "cases", "ambiguous", "straight on / this"]);
    table.definitions = definitions();
    let share = |is: &dyn Fn(&Outcome) -> bool| outcomes.iter().filter(|outcome| is(outcome)).count();
    let straight = share(&|outcome| outcome.fixed[0]);
    let mut push = |name: &str, ambiguous: usize| {
        #[expect(clippy::cast_precision_loss, reason = "counts of cases")]
        let ratio = if ambiguous > 0 { Cell::number(straight as f64 / ambiguous as f64, 1) } else { Cell::Empty };
        table.push([name.into(), Cell::count(outcomes.len()), Cell::share(ambiguous, outcomes.len()), ratio]);
    };
    for (place, (name, _)) in FIXED.into_iter().enumerate() {
        push(name, share(&|outcome| outcome.fixed[place]));
    }
    push("as the planner says", share(&|outcome| outcome.planned));
    push("best of these, in hindsight", share(&|outcome| outcome.all));
    for (case, _) in outcomes.iter().enumerate().filter(|(_, outcome)| outcome.planned && !outcome.all) {
        table.failures.push(format!("case {case}: ambiguous as planned, and not by another motion"));
    }
    table
}

fn definitions() -> Vec<String> {
    let text = [
        "Rolling contact, mu 0.3, disk of 1 cm. Parts: 60 % hulls of 3 to 9 random points, 40 % star-shaped polygons, all within 5 cm; edge and place random, contact within 17 deg of straight ahead, omega N(0, 1 rad/s); drawn anew if a motion loses the contact within 0.3 s.".to_owned(),
        format!("The finger pushes straight at 5 cm/s for 0.2 s, then goes on for 0.6 s as the row says, sideways or ahead with {:.0} cm/s2. Data end where the contact does.", ACCELERATION * 100.0),
        format!("The planner chooses among straight, left, right, ahead and the two between, from the poses that the estimator lists after the first 0.2 s of contact angles at 100 Hz with {:.3} deg of noise.", SIGMA_RAD.to_degrees()),
        "ambiguous: another edge, or an end more than 2 mm away, explains the exact angles of the whole push with D2 < 36 at that noise.".to_owned(),
    ];
    text.to_vec()
}

/// All cases, on as many threads as the machine has; in order.
pub(super) fn outcomes<O: Clone + Default + Send>(
    settings: &Settings,
    outcome: impl Fn(u64, usize) -> O + Sync,
) -> Vec<O> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(vec![O::default(); settings.cases]);
    let work = || {
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= settings.cases {
                return;
            }
            let outcome = outcome(settings.seed, number);
            if let Ok(mut done) = done.lock() {
                done[number] = outcome;
            }
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(work))));
    done.into_inner().unwrap_or_default()
}

fn outcome(seed: u64, number: usize) -> Outcome {
    let (case, felt) = Case::draw(seed, number);
    let ambiguous = |motion: usize| rivals::is_ambiguous(&case, accelerations()[motion], &felt[motion]);
    let fixed = FIXED.map(|(_, motion)| ambiguous(motion));
    let choice = case.choice(&felt[0].angles);
    let known = FIXED.iter().position(|(_, motion)| *motion == choice);
    let planned = known.map_or_else(|| ambiguous(choice), |place| fixed[place]);
    Outcome { fixed, planned, all: planned && fixed.iter().all(|ambiguous| *ambiguous) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_are_the_same_each_time_and_all_begin_alike() {
        let (case, felt) = Case::draw(1, 3);
        let (again, _) = Case::draw(1, 3);
        assert_eq!((case.edge, case.start, &case.noise), (again.edge, again.start, &again.noise));
        let beginning = |felt: &FeltPush| felt.angles[..VALUES_FIRST as usize].to_vec();
        assert!(felt.iter().all(|other| beginning(other) == beginning(&felt[0])));
    }

    #[test]
    fn a_part_with_two_like_edges_is_ambiguous_however_it_is_pushed() {
        let corners = [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(nalgebra::Point2::from);
        let part = Part::uniform(crate::geometry::SimplePolygon::new(corners).unwrap());
        let start = State { u: FRAC_PI_2 + 0.1, s: 0.008, omega: 0.0, v_t: 0.0 };
        let case = Case { part, edge: 0, start, noise: vec![0.0; VALUES_FIRST as usize] };
        for motion in accelerations() {
            assert!(rivals::is_ambiguous(&case, motion, &case.push(motion).unwrap()), "{motion:?}");
        }
    }

    #[test]
    fn a_lone_short_edge_is_told_apart() {
        // A triangle whose edges differ by far in their distance from the centre of mass.
        let corners = [[-0.05, -0.005], [0.05, -0.005], [0.04, 0.02]].map(nalgebra::Point2::from);
        let part = Part::uniform(crate::geometry::SimplePolygon::new(corners).unwrap());
        let edge = 1;
        let line = part.edge(edge).unwrap();
        let s = 0.5 * (line.s_min + line.s_max) + 0.004;
        let start = State { u: FRAC_PI_2, s, omega: 0.0, v_t: 0.0 };
        let case = Case { part, edge, start, noise: vec![0.0; VALUES_FIRST as usize] };
        let clear =
            |motion: [f64; 2]| case.push(motion).is_some_and(|felt| !rivals::is_ambiguous(&case, motion, &felt));
        assert!(accelerations().into_iter().any(clear));
    }
}
