//! Pushes from rest drawn at random, judged from outside: how often a single answer is wrong, and whether the search is
//! to blame.
//!
//! Parts, fingers, frictions, motions and noise are drawn widely, where the table `chain` has one laboratory; there is
//! no device in between. The truth comes from the error-controlled simulation, its force reaches the sensor as it is
//! (`step`: a stiff sensor) or through the disk's mode (`ring`), and readings go through the same tare, onset and
//! windows as those of a file. Where the set lacks the truth, the fit is begun again from the truth itself: if that
//! explains the force well enough to be listed, the search has missed it; if not, noise or the sensing has hidden it.
//!
//! Frames: finger axes; force on the finger's disk. Units: SI inside, as the headings say in the table. Errors: none.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point2, Vector2};
use palpate::finger::contact::Reading;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::math::statistics::mean;
use palpate::pushing::dynamics::{ContactLaw, ContactMode, EndReason, Part, State};
use palpate::pushing::estimation::from_rest::onset::{PushSense, RestNoise};
use palpate::pushing::estimation::from_rest::trial::{is_right_pose, place};
use palpate::pushing::estimation::from_rest::{self, CarriedFinger, KnownFromRest, WINDOWS_MIN, WindowedForce};
use palpate::pushing::estimation::{Estimate, FromForce, GATE, Hypothesis, SAME_END_M, Status};
use palpate::pushing::finger_motion::{FingerMotion, Segment};
use palpate::pushing::pushed_world::{Played, PushedWorld};

use super::drawn_pushes::part;
use super::judged::{self, JudgedCase, Stated};
use super::processor_time::ProcessorTime;
use super::{Cell, Experiment, Table, TableSettings, cases};

/// The table.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "drawn-rest",
    title: "pushes from rest drawn widely at random: single answers that are wrong, truths that are missing, and why",
    cases: 100,
    run,
};

/// Time at rest for the tare, s.
const TARE_S: f64 = 1.0;

/// Readings go on for so long after the finger has stopped, without force, s.
const AFTER_S: f64 = 0.1;

/// Frequency (Hz) and time to 1/e (s) of the default finger's disk.
const RING: (f64, f64) = (186.5, 0.043);

/// Step with which the ringing disk is followed, s: a hundredth of its period.
const RING_STEP_S: f64 = 5e-5;

/// Of the contact at the end: its angle and place.
const FREEDOM: usize = 2;

/// How the force reaches the readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sensor {
    /// Through the mode of the finger's disk.
    Ring,
    /// As it is.
    Step,
}

/// A row.
#[derive(Clone, Copy, Debug)]
struct Setting {
    name: &'static str,
    sensor: Sensor,
    /// Readings a second, one of these.
    rates_hz: &'static [f64],
}

const ROWS: [Setting; 4] = [
    Setting { name: "ring, 500 Hz and more", sensor: Sensor::Ring, rates_hz: &[500.0, 1000.0, 2000.0, 4000.0] },
    Setting { name: "step, 500 Hz and more", sensor: Sensor::Step, rates_hz: &[500.0, 1000.0, 2000.0, 4000.0] },
    Setting { name: "step, 250 Hz", sensor: Sensor::Step, rates_hz: &[250.0] },
    Setting { name: "step, 100 Hz", sensor: Sensor::Step, rates_hz: &[100.0] },
];

/// A push that was felt.
struct Case {
    part: Part,
    edge: usize,
    mu: f64,
    mu_c: f64,
    mass: f64,
    radius: f64,
    motion: FingerMotion,
    u: f64,
    s: f64,
    played: Played,
    readings: Vec<Reading>,
    /// When the finger begins to move, s.
    onset: f64,
    noise: f64,
    rate_hz: f64,
}

/// What came of one case.
#[derive(Clone, Debug)]
struct Outcome {
    judged: JudgedCase,
    /// Of the onset, s.
    onset_error: f64,
    /// What was drawn and found.
    told: String,
}

fn run(settings: &TableSettings) -> Table {
    let columns = ["sensor and rate"].into_iter().chain(judged::COLUMNS).chain(["not felt", "onset error ms"]);
    let mut table = Table::new(columns);
    table.definitions = definitions();
    table.definitions.extend(judged::definitions());
    for setting in ROWS {
        let outcomes = cases::of_each(settings.cases, |number| judge(&Case::draw(settings.seed, number, setting)));
        for (number, outcome) in outcomes.iter().enumerate() {
            let failure = outcome
                .judged
                .failure()
                .map(|what| format!("{}, case {number}: {what}; {}", setting.name, outcome.told));
            table.failures.extend(failure);
        }
        let cells = cells(setting.name, &outcomes, &mut table);
        table.push(cells);
    }
    table
}

fn definitions() -> Vec<String> {
    let text = [
        "Polygons of 3 to 10 vertices (60 % hulls, 40 % stars) within 5 cm, every fourth with a centre of mass and an inertia of its own; mu 0.15 to 0.6, mu_c 0.05 to 0.5, 0.1 to 0.8 kg; disks of 5 to 15 mm; one or two stretches of 0.2 to 0.45 s at 0.05 to 0.35 m/s2, the second any way; the contact uniform along the outline, within 46 deg of the finger's way; drawn until the contact lasts on its edge. mu is known; mass, mu_c, onset and noise are not.",
        "ring: the rigid force through the disk's mode, 186.5 Hz, 43 ms; step: the rigid force itself. Readings are samples at an instant, with 1 to 10 mN of white noise each; 1 s at rest for the tare, and no force once the finger has stopped.",
        "wrong single, truth missing: no listed pose is within 5 of its stated standard deviations (or 0.2 mm and 0.17 deg) of the truth.",
        "search missed it: what a fit from the truth finds costs little enough to be listed, and is not. That fit shares with the search the model of the force, the windows and the descent, not where to begin: a descent that fails from the truth too counts as noise, and shows as a truth that is missing.",
        "NEES and the 95 % region are those of the contact's angle and place at the end, freedom 2; of several poses about the truth the nearest counts.",
        "onset error: mean and standard deviation of the onset that was found, less the true one.",
    ];
    text.map(str::to_owned).to_vec()
}

fn cells(name: &'static str, outcomes: &[Outcome], table: &mut Table) -> Vec<Cell> {
    let judged: Vec<_> = outcomes.iter().map(|outcome| &outcome.judged).collect();
    let onsets: Vec<_> = outcomes.iter().map(|o| o.onset_error * 1e3).filter(|error| error.is_finite()).collect();
    let middle: f64 = mean(&onsets).unwrap_or(f64::NAN);
    let variance: f64 = mean(onsets.iter().map(|error| (error - middle).powi(2))).unwrap_or(f64::NAN);
    let mut cells = judged::cells(name, &judged, FREEDOM, table);
    cells.push(Cell::count(judged.iter().filter(|judged| judged.status.is_none()).count()));
    cells.push(Cell::Text(format!("{middle:.2} ± {:.2}", variance.sqrt())));
    cells
}

fn judge(case: &Case) -> Outcome {
    let begun = ProcessorTime::now();
    let (onset, measured) = case.felt();
    let onset_error = onset.map_or(f64::NAN, |onset| onset - case.onset);
    let Some(measured) = measured else {
        let judged = JudgedCase {
            status: None,
            has_truth: false,
            is_missed: false,
            squared_error: None,
            is_covered: None,
            stated: Vec::new(),
            milliseconds: begun.milliseconds(),
        };
        return Outcome { judged, onset_error, told: case.told() };
    };
    let known = case.known();
    let estimate = from_rest::estimate(&known, &measured);
    let milliseconds = begun.milliseconds();
    let hypotheses = &estimate.hypotheses;
    let truth = case.truth_among(&estimate);
    let refitted = from_rest::follow(&known, &measured, &case.truth(&estimate));
    let judged = JudgedCase {
        status: Some(estimate.status()),
        has_truth: truth.is_some(),
        is_missed: truth.is_none() && is_missed(&estimate, &refitted),
        squared_error: truth.and_then(|truth| case.squared_error(&hypotheses[truth], estimate.time_end)),
        is_covered: None,
        stated: Stated::all(
            hypotheses,
            |hypothesis| hypothesis.probability,
            |a, b| is_right_pose(&case.part, estimate.symmetry, a, &b.pose_end.isometry()),
            |hypothesis| case.is_truth(hypothesis, &estimate),
        ),
        milliseconds,
    };
    let cost = |estimate: &Estimate| estimate.fit.cost.unwrap_or(f64::NAN);
    let told = format!(
        "cost {:.1}, from the truth {:.1}, limit {:.1}; onset {:.2} ms off; {}",
        cost(&estimate),
        cost(&refitted),
        estimate.fit.cost_max,
        onset_error * 1e3,
        case.told()
    );
    Outcome { judged, onset_error, told }
}

/// Whether what a fit from the truth found costs little enough to be listed, and is not.
fn is_missed(estimate: &Estimate, refitted: &Estimate) -> bool {
    let most = match (estimate.status(), estimate.fit.cost) {
        (Status::Unexplained, _) | (_, None) => estimate.fit.cost_max,
        (_, Some(least)) => least + GATE,
    };
    let listed = |found: &Hypothesis| {
        estimate.hypotheses.iter().any(|listed| {
            listed.side == found.side
                && (listed.end.s - found.end.s).abs() < SAME_END_M
                && near(listed.end.u, found.end.u)
        })
    };
    let found = refitted.hypotheses.iter().find(|found| found.cost <= most);
    found.is_some_and(|found| !listed(found))
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() < from_rest::SAME_PLACE.angle
}

impl Case {
    fn draw(seed: u64, number: usize, setting: Setting) -> Self {
        cases::until_possible(&mut Draw::case(seed, number), |draw| Self::try_draw(draw, setting))
    }

    fn try_draw(draw: &mut Draw, setting: Setting) -> Option<Self> {
        let part = part(draw);
        let (edge, s) = place(draw, &part)?;
        let (mu, mu_c) = (draw.uniform(0.15, 0.6), draw.uniform(0.05, 0.5));
        let (mass, radius) = (draw.uniform(0.1, 0.8), draw.uniform(0.005, 0.015));
        let ahead = draw.uniform(-PI, PI);
        let u = ahead + draw.uniform(-0.8, 0.8);
        let mut segments = vec![stretch(draw, ahead)];
        if draw.chance(0.6) {
            let toward = draw.uniform(-PI, PI);
            segments.push(stretch(draw, toward));
        }
        let motion = FingerMotion::new(Point2::origin(), &segments).ok()?;
        let world =
            PushedWorld { part: &part, mu_g: mu * GRAVITY_ASSUMED, mass, mu_c, radius, motion: &motion, edge, u, s };
        let played = world.play().ok().filter(|played| played.end == EndReason::Time)?;
        let rate_hz = setting.rates_hz[draw.index(setting.rates_hz.len())];
        let noise = 1e-3 * 10.0_f64.powf(draw.unit());
        let onset = TARE_S + draw.uniform(0.2, 0.3);
        let force = forces(&played, setting.sensor);
        let bias = Vector2::new(draw.uniform(-1.0, 1.0), draw.uniform(-1.0, 1.0));
        let readings = (0_u32..).map(|index| f64::from(index) / rate_hz);
        let readings = readings.take_while(|t| *t <= onset + played.duration() + AFTER_S);
        let readings = readings.map(|t| {
            let error = Vector2::new(draw.normal(), draw.normal()) * noise;
            Reading::new(t, bias + force(t - onset) + error)
        });
        let readings = readings.collect();
        Some(Self {
            edge,
            mu,
            mu_c,
            mass,
            radius,
            u,
            s,
            played,
            readings,
            onset,
            noise,
            rate_hz,
            motion: motion.clone(),
            part: part.clone(),
        })
    }

    fn known(&self) -> KnownFromRest<'_> {
        KnownFromRest {
            part: &self.part,
            errors: None,
            mu_g: self.mu * GRAVITY_ASSUMED,
            mu_g_log_sd: None,
            radius: self.radius,
            shape: None,
            finger: CarriedFinger::RIGID,
            motion: &self.motion,
        }
    }

    /// When the push was felt to begin, and what was felt of it.
    fn felt(&self) -> (Option<f64>, Option<WindowedForce>) {
        let (rest, push) = self.readings.split_at(self.readings.partition_point(|reading| reading.t < TARE_S));
        let Ok(noise) = RestNoise::estimate(rest) else { return (None, None) };
        let mut sense = PushSense::new(noise, None);
        push.iter().for_each(|reading| sense.push(reading));
        let measured = sense.windowed_force(self.motion.duration());
        (sense.onset_time(), measured.filter(|measured| measured.count() >= WINDOWS_MIN))
    }

    fn is_truth(&self, hypothesis: &Hypothesis, estimate: &Estimate) -> bool {
        let truth = self.played.pose(estimate.time_end);
        truth.is_some_and(|truth| is_right_pose(&self.part, estimate.symmetry, hypothesis, &truth))
    }

    /// Which hypothesis is the truth: of several about it the nearest.
    fn truth_among(&self, estimate: &Estimate) -> Option<usize> {
        let hypotheses = &estimate.hypotheses;
        let near = (0..hypotheses.len()).filter(|n| self.is_truth(&hypotheses[*n], estimate));
        let off = |n: &usize| self.squared_error(&hypotheses[*n], estimate.time_end).unwrap_or(f64::INFINITY);
        near.min_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// Of the contact's angle and place at the end.
    fn squared_error(&self, hypothesis: &Hypothesis, time: f64) -> Option<f64> {
        let end = self.played.samples.iter().min_by(|a, b| (a.t - time).abs().total_cmp(&(b.t - time).abs()))?;
        let off = Vector2::new(hypothesis.end.u - end.state.u, hypothesis.end.s - end.state.s);
        let covariance = hypothesis.state_covariance?.fixed_view::<2, 2>(0, 0).into_owned();
        // On a part that a turn takes to itself the answer may be on another edge.
        let off = Vector2::new(palpate::math::angle::wrap_angle(off.x), off.y);
        Some((off.transpose() * covariance.try_inverse()? * off)[0])
    }

    /// The truth as an answer, from which a fit can be begun.
    fn truth(&self, estimate: &Estimate) -> Estimate {
        let start = State { u: self.u, s: self.s, omega: 0.0, v_t: 0.0 };
        let first = &self.played.samples[0];
        let pose = palpate::Pose { x: first.position.x, y: first.position.y, theta: first.theta };
        let slips = self.played.samples.iter().any(|sample| sample.contact != ContactMode::Rolling);
        let hypothesis = Hypothesis {
            edge: self.edge,
            side: self.part.side(self.edge),
            start,
            contact_start: ContactMode::Rolling,
            end: start,
            contact_end: ContactMode::Rolling,
            law: ContactLaw::Coulomb { friction: self.mu_c },
            pose_start: pose,
            pose_end: pose,
            velocity_end: Vector2::zeros(),
            covariance: None,
            state_covariance: None,
            mu_g: self.mu * GRAVITY_ASSUMED,
            mu_g_log_sd: None,
            from_force: Some(FromForce {
                mass: self.mass,
                mass_log_sd: 0.0,
                resistance_log_sd: 0.0,
                mu_c: slips.then_some(self.mu_c),
                mu_c_sd: None,
                friction_needed: 0.0,
            }),
            cost: 0.0,
            probability: 1.0,
        };
        Estimate { hypotheses: vec![hypothesis], ..estimate.clone() }
    }

    /// What was drawn, in a line.
    fn told(&self) -> String {
        let slips = self.played.samples.iter().filter(|sample| sample.contact != ContactMode::Rolling).count();
        format!(
            "edge {}, s0 {:.2} mm, u0 {:.4}, mu_c {:.3}, {:.3} kg, {:.1} mN at {} Hz, slips {:.0} %",
            self.edge,
            self.s * 1e3,
            self.u,
            self.mu_c,
            self.mass,
            self.noise * 1e3,
            self.rate_hz,
            100.0 * slips as f64 / self.played.samples.len() as f64
        )
    }
}

/// A stretch of the finger's motion, towards an angle.
pub(super) fn stretch(draw: &mut Draw, toward: f64) -> Segment {
    let (seconds, size) = (draw.uniform(0.2, 0.45), draw.uniform(0.05, 0.35));
    Segment { seconds, acceleration: Vector2::new(toward.cos(), toward.sin()) * size }
}

/// The force on the disk at a time since the onset, N; none before and after the push.
pub(super) fn rigid_force(played: &Played) -> impl Fn(f64) -> Vector2<f64> + use<> {
    let (played, duration) = (played.clone(), played.duration());
    move |t: f64| if t < 0.0 || t > duration { Vector2::zeros() } else { played.force_finger(t) }
}

/// The force that a sensor reads at a time since the onset, N.
fn forces(played: &Played, sensor: Sensor) -> impl Fn(f64) -> Vector2<f64> + use<> {
    let (rigid, duration) = (rigid_force(played), played.duration());
    let rung = (sensor == Sensor::Ring).then(|| rung(&rigid, duration + AFTER_S));
    move |t: f64| match &rung {
        None => rigid(t),
        Some(_) if t < 0.0 => Vector2::zeros(),
        Some(rung) => {
            let place = t / RING_STEP_S;
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "not negative; steps of a push"
            )]
            let before = (place as usize).min(rung.len() - 2);
            rung[before].lerp(&rung[before + 1], (place - before as f64).min(1.0))
        }
    }
}

/// What a disk on a beam shows of a force, each [`RING_STEP_S`]: the force is held over a step, so that it is exact.
fn rung(rigid: &impl Fn(f64) -> Vector2<f64>, duration: f64) -> Vec<Vector2<f64>> {
    let (decay, turning) = (1.0 / RING.1, TAU * RING.0);
    let (shrunk, (sin, cos)) = ((-decay * RING_STEP_S).exp(), (turning * RING_STEP_S).sin_cos());
    let (mut shown, mut rate) = (Vector2::zeros(), Vector2::zeros());
    let mut all = vec![shown];
    let mut time = 0.0;
    while time < duration + 2.0 * RING_STEP_S {
        let force = rigid(time + 0.5 * RING_STEP_S);
        let off: Vector2<f64> = shown - force;
        let across = (rate + off * decay) / turning;
        shown = force + (off * cos + across * sin) * shrunk;
        rate = ((across * turning - off * decay) * cos - (off * turning + across * decay) * sin) * shrunk;
        all.push(shown);
        time += RING_STEP_S;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_few_pushes_from_rest_the_search_misses_none() {
        let table = run(&TableSettings { cases: 4, seed: 1, jobs: None });
        assert_eq!(table.rows().count(), ROWS.len());
        let missed: Vec<_> = table.failures.iter().filter(|failure| failure.contains("the search missed it")).collect();
        assert!(missed.is_empty(), "{missed:?}");
    }

    #[test]
    fn a_ringing_disk_overshoots_a_step_and_comes_to_rest_on_it() {
        let shown = rung(&|_| Vector2::new(1.0, 0.0), 0.5);
        let most = shown.iter().map(|force| force.x).fold(0.0, f64::max);
        // Half a period after the step: 1 + exp(−T/2τ).
        assert!((most - (1.0 + (-0.5 / RING.0 / RING.1).exp())).abs() < 1e-3, "{most}");
        assert!((shown[shown.len() - 1].x - 1.0).abs() < 1e-4);
    }
}
