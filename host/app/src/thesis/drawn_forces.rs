//! Readings of a carried finger's force sensor drawn at random: how often a single answer is wrong, whether errors are as
//! stated, and whether the search is to blame.
//!
//! Parts, fingers with a mass of their own, frictions, motions and noise are drawn widely; each row leaves something
//! unknown. The truth comes from the error-controlled simulation; the finger's own mass takes its share of the force. Where
//! the set lacks the truth, the fit is begun again from the truth itself: if that explains the readings well enough to be
//! listed, the search has missed it.
//!
//! Frames: world axes; force on the finger's disk. Units: SI inside, as the headings say in the table. Errors: none.

use std::f64::consts::PI;
use std::time::Instant;

use nalgebra::{Matrix3, Point2, Vector2, Vector3};
use palpate::geometry::{Pose, SimplePolygon};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::math::statistics::chi_square_quantile;
use palpate::never;
use palpate::pushing::dynamics::{ContactMode, EndReason, Part, State};
use palpate::pushing::estimation::from_rest::readings::{
    Beginning, ForceHypothesis, ForceReading, KnownOfFinger, MeasuredFinger, OutlineErrors, estimate_measured_until,
    estimate_until, follow,
};
use palpate::pushing::estimation::from_rest::trial::{PoseError, place, pose_error};
use palpate::pushing::estimation::{GATE, Status};
use palpate::pushing::finger_motion::{FingerMotion, Segment};
use palpate::pushing::measured_path::MeasuredPath;
use palpate::pushing::pushed_world::{Played, PushedWorld};

use super::drawn_pushes::part;
use super::drawn_rest::{rigid_force, stretch};
use super::judged::{self, JudgedCase, Stated};
use super::{Experiment, Table, TableSettings, cases};

/// The table.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "drawn-forces",
    title: "forces of a finger with a mass of its own drawn widely: single answers that are wrong, errors, and why",
    cases: 100,
    run,
};

/// Errors are told as those of so many degrees of freedom: a pose on an exact contact has two.
const FREEDOM: usize = 2;

/// An exact contact leaves a covariance singular: what the simulations are off by, m and rad.
const SLACK: (f64, f64) = (5e-6, 5e-5);

/// Directions whose variance is this many times the slack's count as free.
const FREE: f64 = 10.0;

/// What is unknown in a row, and how.
#[derive(Clone, Copy, Debug)]
struct Setting {
    name: &'static str,
    /// One of these, kg.
    fingers: &'static [f64],
    /// Standard deviation of the told effective mass, as a share of it.
    finger_sd: f64,
    knows_mass: bool,
    knows_mu_c: bool,
    /// Standard deviation of ln µ.
    mu_log_sd: f64,
    /// Standard deviations of the outline's edges, one of these, m; empty where it is exact.
    outline: &'static [f64],
    is_moving: bool,
    /// Whether accelerations change smoothly.
    is_smooth: bool,
    /// Whether the finger's places are measured, by another clock.
    is_measured: bool,
}

/// Everything known.
const KNOWN: Setting = Setting {
    name: "massless finger",
    fingers: &[0.0],
    finger_sd: 0.0,
    knows_mass: true,
    knows_mu_c: true,
    mu_log_sd: 0.0,
    outline: &[],
    is_moving: false,
    is_smooth: false,
    is_measured: false,
};

/// Fingers, kg.
const FINGERS: &[f64] = &[0.005, 0.0207, 0.06];

const ROWS: [Setting; 10] = [
    KNOWN,
    Setting { name: "finger 5 to 60 g", fingers: FINGERS, ..KNOWN },
    Setting { name: "mass unknown", fingers: FINGERS, knows_mass: false, ..KNOWN },
    Setting { name: "mu_c unknown", fingers: FINGERS, knows_mu_c: false, ..KNOWN },
    Setting { name: "mu, finger, mass, mu_c unknown", finger_sd: 0.3, mu_log_sd: 0.2, ..UNKNOWN },
    Setting { name: "outline off", fingers: FINGERS, finger_sd: 0.05, outline: &[1e-4, 2e-4, 5e-4], ..KNOWN },
    Setting { name: "moving", fingers: FINGERS, is_moving: true, ..KNOWN },
    Setting { name: "moving, mass, mu_c unknown", is_moving: true, ..UNKNOWN },
    Setting { name: "smooth motion", fingers: FINGERS, is_smooth: true, ..KNOWN },
    Setting { name: "smooth path, measured", fingers: FINGERS, is_smooth: true, is_measured: true, ..KNOWN },
];

/// Mass and µ_c unknown.
const UNKNOWN: Setting = Setting { fingers: FINGERS, knows_mass: false, knows_mu_c: false, ..KNOWN };

/// A push that was felt.
struct Case {
    setting: Setting,
    told: Part,
    edge: usize,
    mu: f64,
    mu_c: f64,
    mass: f64,
    radius: f64,
    finger: f64,
    finger_told: f64,
    mu_told: f64,
    outline_sd: f64,
    motion: FingerMotion,
    played: Played,
    readings: Vec<ForceReading>,
    noise: f64,
    /// By its own clock, and what that is early, s.
    path: Option<(MeasuredPath, f64, f64)>,
}

fn run(settings: &TableSettings) -> Table {
    let columns = ["unknown"].into_iter().chain(judged::COLUMNS);
    let mut table = Table::new(columns);
    table.definitions = definitions();
    table.definitions.extend(judged::definitions());
    for setting in ROWS {
        let outcomes = cases::of_each(settings.cases, |number| judge(&Case::draw(settings.seed, number, setting)));
        for (number, (judged, told)) in outcomes.iter().enumerate() {
            let failure = judged.failure().map(|what| format!("{}, case {number}: {what}; {told}", setting.name));
            table.failures.extend(failure);
        }
        let judged: Vec<_> = outcomes.iter().map(|(judged, _)| judged).collect();
        let cells = judged::cells(setting.name, &judged, FREEDOM, &mut table);
        table.push(cells);
    }
    table
}

fn definitions() -> Vec<String> {
    let text = [
        "Polygons of 3 to 10 vertices (60 % hulls, 40 % stars) within 5 cm, every fourth with a centre of mass and an inertia of its own; mu 0.15 to 0.6, mu_c 0.05 to 0.6, 0.05 to 0.9 kg; disks of 5 to 15 mm; one to three stretches of 0.2 to 0.45 s at 0.05 to 0.35 m/s2, each any way; the contact uniform along the outline, within 46 deg of the finger's way; drawn until the contact lasts on its edge. Readings at 100 to 500 Hz with 1 to 10 mN of white noise; of moving parts from 0.15 to 0.5 of the motion on.",
        "Effective mass 5, 20.7 or 60 g where not told otherwise. unknown: mu to 20 %, effective mass to 30 %, mass and mu_c not at all; outline off: every edge by 0.1, 0.2 or 0.5 mm along its normal, effective mass by 5 %; path measured: smooth ramps of 60 ms, places at 50 to 200 Hz with 2 to 20 um of noise and a clock that is off by 2 to 30 ms.",
        "wrong single, truth missing: no listed pose is within 5 of its stated standard deviations (or 0.2 mm and 0.17 deg) of the truth.",
        "search missed it: what a fit from the truth finds costs little enough to be listed, and is not; not judged where the path is measured.",
        "NEES and the 95 % region are those of the pose at the last reading, scaled to freedom 2; of several poses about the truth the nearest counts.",
    ];
    text.map(str::to_owned).to_vec()
}

fn judge(case: &Case) -> (JudgedCase, String) {
    let begun = Instant::now();
    let uniform = Part::uniform;
    let outline = OutlineErrors { sigma: case.outline_sd, part: &uniform };
    let known = case.known((case.outline_sd > 0.0).then_some(outline));
    let found: Vec<_> = match &case.path {
        None => estimate_until(&known, &case.readings, &never).found,
        Some((path, clock_offset_sd, _)) => {
            let finger = MeasuredFinger { path, clock_offset_sd: *clock_offset_sd };
            let found = estimate_measured_until(&known, &finger, &case.readings, &never).found.hypotheses;
            found.into_iter().map(|(_, found)| found).collect()
        }
    };
    let milliseconds = begun.elapsed().as_secs_f64() * 1e3;
    let is_true = |found: &ForceHypothesis| case.error(&found.pose_end).is_within(found.spread(&case.told));
    let squared = |found: &ForceHypothesis| case.squared_error(found);
    let nearest = found.iter().filter(|found| is_true(found)).map(squared).min_by(f64::total_cmp);
    let followed = if case.path.is_some() { None } else { follow(&known, &case.readings, &case.beginning()) };
    let status = match found.len() {
        0 => Status::Unexplained,
        1 => Status::Unique,
        _ => Status::Ambiguous,
    };
    let least = found.iter().map(|found| found.cost).min_by(f64::total_cmp);
    let is_missed = followed.as_ref().is_some_and(|(from_truth, most)| {
        let most = least.map_or(*most, |least| least + GATE);
        let is_listed = |found: &ForceHypothesis| {
            pose_error(&case.told, 1, &from_truth.pose_end, &found.pose_end.isometry())
                .is_within(found.spread(&case.told))
        };
        from_truth.cost <= most && !found.iter().any(is_listed)
    });
    let judged = JudgedCase {
        status: Some(status),
        has_truth: nearest.is_some(),
        is_missed: nearest.is_none() && is_missed,
        squared_error: nearest,
        stated: Stated::all(
            &found,
            |found| found.probability,
            |a, b| pose_error(&case.told, 1, &a.pose_end, &b.pose_end.isometry()).is_within(a.spread(&case.told)),
            is_true,
        ),
        milliseconds,
    };
    let cost = |cost: Option<f64>| cost.map_or("none".to_owned(), |cost| format!("{cost:.1}"));
    let told = format!(
        "cost {}, from the truth {}, at most {}; {}",
        cost(least),
        cost(followed.as_ref().map(|(found, _)| found.cost)),
        cost(followed.as_ref().map(|(_, most)| *most)),
        case.in_words()
    );
    (judged, told)
}

impl Case {
    fn draw(seed: u64, number: usize, setting: Setting) -> Self {
        cases::until_possible(&mut Draw::case(seed, number), |draw| Self::try_draw(draw, setting))
    }

    fn try_draw(draw: &mut Draw, setting: Setting) -> Option<Self> {
        let any = |draw: &mut Draw, of: &[f64]| of[draw.index(of.len())];
        let outline_sd = if setting.outline.is_empty() { 0.0 } else { any(draw, setting.outline) };
        let told = if outline_sd > 0.0 { cases::random_part(draw) } else { part(draw) };
        let part = if outline_sd > 0.0 {
            let off: Vec<_> = told.polygon().vertices().iter().map(|_| outline_sd * draw.normal()).collect();
            told.polygon().with_edges_moved(|edge| off[edge]).map(|outline: SimplePolygon| Part::uniform(outline))?
        } else {
            told.clone()
        };
        let (edge, s) = place(draw, &part)?;
        let (mu, mu_c) = (draw.uniform(0.15, 0.6), draw.uniform(0.05, 0.6));
        let mass = 0.05 * 18.0_f64.powf(draw.unit());
        let radius = draw.uniform(0.005, 0.015);
        let ahead = draw.uniform(-PI, PI);
        let u = ahead + draw.uniform(-0.8, 0.8);
        let mut segments = vec![stretch(draw, ahead)];
        for _ in 0..draw.index(3) {
            let toward = draw.uniform(-PI, PI);
            segments.push(stretch(draw, toward));
        }
        if setting.is_smooth {
            segments = ramped(&segments);
        }
        let motion = FingerMotion::new(Point2::origin(), &segments).ok()?;
        let world =
            PushedWorld { part: &part, mu_g: mu * GRAVITY_ASSUMED, mass, mu_c, radius, motion: &motion, edge, u, s };
        let played = world.play().ok().filter(|played| played.end == EndReason::Time)?;
        let finger = any(draw, setting.fingers);
        let finger_told = finger * (1.0 + setting.finger_sd * draw.normal());
        let mu_told = mu * (setting.mu_log_sd * draw.normal()).exp();
        let noise = 1e-3 * 10.0_f64.powf(draw.unit());
        let rate_hz = any(draw, &[100.0, 200.0, 250.0, 400.0, 500.0]);
        let duration = played.duration();
        let from = if setting.is_moving { draw.uniform(0.15, 0.5) * duration } else { -0.02 };
        let force = rigid_force(&played);
        let phase = draw.unit();
        let offset_sd = any(draw, &[2e-3, 1e-2, 3e-2]);
        let offset = offset_sd * draw.normal();
        // Of a measured finger nobody knows when it begins to move.
        let onset = if setting.is_measured { 4.0 * offset_sd + 0.1 } else { 0.0 };
        let times = (0_u32..).map(|index| from + (f64::from(index) + phase) / rate_hz);
        let mut readings = Vec::new();
        for t in times.take_while(|t| *t <= duration) {
            let error = Vector2::new(draw.normal(), draw.normal()) * noise;
            let carried = if t < 0.0 { Vector2::zeros() } else { motion.acceleration(t) * finger };
            readings.push(ForceReading { time: t + onset, force: force(t) - carried + error });
        }
        let path = setting.is_measured.then(|| {
            let (sigma, rate) = (2e-6 * 10.0_f64.powf(draw.unit()), any(draw, &[50.0, 100.0, 200.0]));
            let times = (0_u32..).map(|index| f64::from(index) / rate);
            let times: Vec<_> = times.take_while(|t| *t <= onset + duration + 8.0 * offset_sd).collect();
            // What is beyond the motion is not of it: it goes on with no acceleration.
            let centre = |t: f64| {
                let beyond = (t - duration).max(0.0);
                motion.centre(t.clamp(0.0, duration)) + velocity_end(&motion) * beyond
            };
            let places = times
                .iter()
                .map(|time| centre(time + offset - onset) + Vector2::new(draw.normal(), draw.normal()) * sigma);
            (MeasuredPath { places: places.collect(), times, sigma }, offset_sd, offset)
        });
        Some(Self {
            setting,
            edge,
            mu,
            mu_c,
            mass,
            radius,
            finger,
            finger_told,
            mu_told,
            outline_sd,
            played,
            readings,
            noise,
            path,
            motion: motion.clone(),
            told: told.clone(),
        })
    }

    fn known<'a>(&'a self, outline: Option<OutlineErrors<'a>>) -> KnownOfFinger<'a> {
        let Setting { knows_mass, knows_mu_c, finger_sd, mu_log_sd, is_moving, .. } = self.setting;
        KnownOfFinger {
            part: &self.told,
            outline,
            mass: knows_mass.then_some(self.mass),
            mu_g: self.mu_told * GRAVITY_ASSUMED,
            mu_g_log_sd: (mu_log_sd > 0.0).then_some(mu_log_sd),
            mu_c: knows_mu_c.then_some(self.mu_c),
            radius: self.radius,
            effective_mass: self.finger_told,
            effective_mass_sd: finger_sd * self.finger,
            is_moving,
            compliance: 0.0,
            motion: &self.motion,
            noise: self.noise,
        }
    }

    /// As the push began, or was at the first reading.
    fn beginning(&self) -> Beginning {
        let time = if self.setting.is_moving { self.readings.first().map_or(0.0, |reading| reading.time) } else { 0.0 };
        let samples = &self.played.samples;
        let there = samples.iter().min_by(|a, b| (a.t - time).abs().total_cmp(&(b.t - time).abs()));
        let there = there.unwrap_or(&samples[0]);
        let state = State { ..there.state };
        Beginning { edge: self.edge, state, is_rolling: there.contact == ContactMode::Rolling, mu_c: self.mu_c }
    }

    fn end(&self) -> f64 {
        let onset = self.path.as_ref().map_or(0.0, |(_, sd, _)| 4.0 * sd + 0.1);
        self.readings.last().map_or(0.0, |reading| reading.time) - onset
    }

    fn error(&self, pose: &Pose) -> PoseError {
        let truth = self.played.pose(self.end()).unwrap_or_else(nalgebra::Isometry2::identity);
        pose_error(&self.told, 1, pose, &truth)
    }

    /// Of the pose at the last reading, in deviations of [`FREEDOM`] degrees of freedom.
    fn squared_error(&self, found: &ForceHypothesis) -> f64 {
        let truth: Pose = self.played.pose(self.end()).unwrap_or_else(nalgebra::Isometry2::identity).into();
        let off = found.pose_end.minus(&truth);
        let slack = Vector3::new(SLACK.0, SLACK.0, SLACK.1);
        let scale = Matrix3::from_diagonal(&slack.map(|sd| 1.0 / sd));
        // In slacks, so that what is free shows in the eigenvalues.
        let covariance = scale * found.covariance.fixed_view::<3, 3>(0, 0) * scale;
        let free = covariance.symmetric_eigenvalues().iter().filter(|value| **value > FREE).count().max(1);
        let off = scale * off;
        let squared =
            (covariance + Matrix3::identity()).try_inverse().map_or(f64::INFINITY, |inverse| off.dot(&(inverse * off)));
        squared * chi_square_quantile(0.95, FREEDOM) / chi_square_quantile(0.95, free)
    }

    /// What was drawn, in a line.
    fn in_words(&self) -> String {
        let slips = self.played.samples.iter().filter(|sample| sample.contact != ContactMode::Rolling).count();
        format!(
            "edge {}, mu {:.3}, mu_c {:.3}, {:.3} kg, finger {:.1} g, {:.1} mN, {} readings, outline {:.1} mm, slips {:.0} %",
            self.edge,
            self.mu,
            self.mu_c,
            self.mass,
            self.finger * 1e3,
            self.noise * 1e3,
            self.readings.len(),
            self.outline_sd * 1e3,
            100.0 * slips as f64 / self.played.samples.len() as f64
        )
    }
}

/// Time in which an acceleration of a measured motion changes, s, and its steps.
const RAMP: (f64, u32) = (0.06, 30);

/// The same with accelerations that change smoothly: along half a cosine.
fn ramped(segments: &[Segment]) -> Vec<Segment> {
    let mut smooth = Vec::new();
    let mut last = Vector2::zeros();
    for segment in segments {
        for step in 0..RAMP.1 {
            let share = 0.5 - 0.5 * (PI * (f64::from(step) + 0.5) / f64::from(RAMP.1)).cos();
            let acceleration = last.lerp(&segment.acceleration, share);
            smooth.push(Segment { seconds: RAMP.0 / f64::from(RAMP.1), acceleration });
        }
        smooth.push(Segment { seconds: segment.seconds - RAMP.0, ..*segment });
        last = segment.acceleration;
    }
    smooth
}

/// m/s.
fn velocity_end(motion: &FingerMotion) -> Vector2<f64> {
    motion.segments().iter().map(|segment| segment.acceleration * segment.seconds).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One push a row: of sixty, some rows have one that is missed, as docs/RELIABILITY.md tells.
    #[test]
    fn of_a_few_forces_the_search_misses_none() {
        let table = run(&TableSettings { cases: 1, seed: 7, jobs: None });
        assert_eq!(table.rows().count(), ROWS.len());
        let missed: Vec<_> = table.failures.iter().filter(|failure| failure.contains("the search missed it")).collect();
        assert!(missed.is_empty(), "{missed:?}");
    }
}
