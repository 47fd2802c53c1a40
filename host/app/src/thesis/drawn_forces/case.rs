//! A push as a carried finger's force sensor reads it: drawn, played in a world that may differ from what is told of it, and
//! what is told of it.
//!
//! Frames: world axes; force on the finger's disk. Units: SI. Errors: none; what cannot be is drawn again.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix2, Point2, Vector2};
use palpate::geometry::{Pose, SimplePolygon, bounding_box};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::point_sampling::contains;
use palpate::pushing::dynamics::{ContactMode, EndReason, Part, State};
use palpate::pushing::estimation::from_rest::PartErrors;
use palpate::pushing::estimation::from_rest::readings::{Beginning, ForceHypothesis, ForceReading, KnownOfFinger};
use palpate::pushing::estimation::from_rest::trial::{PoseError, place, pose_error};
use palpate::pushing::finger_motion::{FingerMotion, Segment};
use palpate::pushing::measured_path::MeasuredPath;
use palpate::pushing::pushed_world::{Played, PushedWorld};

use super::super::cases;
use super::super::drawn_pushes::part;
use super::super::drawn_rest::{rigid_force, stretch};
use super::super::judged::PoseClaim;
use super::Setting;

/// A push that was felt.
pub(super) struct Case {
    pub(super) setting: Setting,
    pub(super) told: Part,
    pub(super) edge: usize,
    mu: f64,
    pub(super) mu_c: f64,
    pub(super) mass: f64,
    radius: f64,
    pub(super) finger: f64,
    finger_told: f64,
    mu_told: f64,
    pub(super) outline_sd: f64,
    motion: FingerMotion,
    pub(super) played: Played,
    pub(super) readings: Vec<ForceReading>,
    pub(super) noise: f64,
    /// By its own clock, and what that is early, s.
    pub(super) path: Option<(MeasuredPath, f64, f64)>,
}

impl Case {
    pub(super) fn draw(seed: u64, number: usize, setting: Setting) -> Self {
        cases::until_possible(&mut Draw::case(seed, number), |draw| Self::try_draw(draw, setting))
    }

    fn try_draw(draw: &mut Draw, setting: Setting) -> Option<Self> {
        let any = |draw: &mut Draw, of: &[f64]| of[draw.index(of.len())];
        let outline_sd = if setting.outline.is_empty() { 0.0 } else { any(draw, setting.outline) };
        let is_off = outline_sd > 0.0 || setting.centre_off > 0.0 || setting.is_pressure_drawn;
        let told = if is_off { cases::random_part(draw) } else { part(draw) };
        let part = true_part(draw, &told, outline_sd, &setting)?;
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
        let (wave, phase) = (draw.uniform(0.01, 0.04), draw.uniform(0.0, TAU));
        let wander = |s: f64| (setting.wander * 2.0_f64.sqrt() * (TAU * s / wave + phase).sin()).exp();
        let played = if setting.wander > 0.0 { world.play_along(wander) } else { world.play() };
        let played = played.ok().filter(|played| played.end == EndReason::Time)?;
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

    pub(super) fn known(&self, errors: Option<PartErrors>) -> KnownOfFinger<'_> {
        let Setting { knows_mass, knows_mu_c, finger_sd, mu_log_sd, is_moving, .. } = self.setting;
        KnownOfFinger {
            part: &self.told,
            errors,
            mass: knows_mass.then_some(self.mass),
            mu_g: self.mu_told * GRAVITY_ASSUMED,
            mu_g_log_sd: (mu_log_sd > 0.0).then_some(mu_log_sd),
            mu_c: knows_mu_c.then_some(self.mu_c),
            mu_c_wander_log_sd: self.setting.wander,
            radius: self.radius,
            shape: None,
            effective_mass: self.finger_told,
            effective_mass_sd: finger_sd * self.finger,
            is_moving,
            compliance: 0.0,
            compliance_sd: 0.0,
            place_sd: 0.0,
            motion: &self.motion,
            noise: self.noise,
        }
    }

    /// As the push began, or was at the first reading.
    pub(super) fn beginning(&self) -> Beginning {
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

    pub(super) fn error(&self, pose: &Pose) -> PoseError {
        let truth = self.played.pose(self.end()).unwrap_or_else(nalgebra::Isometry2::identity);
        pose_error(&self.told, 1, pose, &truth)
    }

    /// Of the pose at the last reading, in deviations of [`PoseClaim::FREEDOM`] degrees of freedom.
    pub(super) fn squared_error(&self, found: &ForceHypothesis) -> f64 {
        self.claim(found).squared
    }

    fn claim(&self, found: &ForceHypothesis) -> PoseClaim {
        let truth: Pose = self.played.pose(self.end()).unwrap_or_else(nalgebra::Isometry2::identity).into();
        let covariance = found.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        PoseClaim::new(found.probability, &found.pose_end.minus(&truth), &covariance)
    }

    /// Whether the truth is within the 95 % region of all hypotheses, by probability.
    pub(super) fn is_covered(&self, found: &[ForceHypothesis]) -> bool {
        PoseClaim::cover(&found.iter().map(|found| self.claim(found)).collect::<Vec<_>>())
    }

    /// What was drawn, in a line.
    pub(super) fn in_words(&self) -> String {
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

/// The part as it is, of one as it is told; none where that cannot be.
fn true_part(draw: &mut Draw, told: &Part, outline_sd: f64, setting: &Setting) -> Option<Part> {
    let part = if outline_sd > 0.0 {
        let off: Vec<_> = told.polygon().vertices().iter().map(|_| outline_sd * draw.normal()).collect();
        told.polygon().with_edges_moved(|edge| off[edge]).map(|outline: SimplePolygon| Part::uniform(outline))?
    } else {
        told.clone()
    };
    let moved = Vector2::new(draw.normal(), draw.normal()) * (setting.centre_off * 0.5_f64.sqrt());
    let part =
        if setting.centre_off > 0.0 { part.redistributed(moved, Vector2::zeros(), &Matrix2::identity()) } else { part };
    if !setting.is_pressure_drawn {
        return Some(part);
    }
    let feet = 6 + draw.index(19);
    let places: Vec<_> = std::iter::repeat_with(|| point_inside(draw, part.polygon())).take(feet).collect();
    let weights: Vec<_> = places.iter().map(|_| draw.normal().exp()).collect();
    let feet = balanced(&places, &weights, part.centre_of_mass())?;
    Some(Part::on_feet(part.polygon().clone(), &feet, part.body().mass()))
}

/// A place anywhere within an outline.
fn point_inside(draw: &mut Draw, outline: &SimplePolygon) -> Point2<f64> {
    let (low, high) = bounding_box(outline.vertices());
    loop {
        let place = Point2::new(draw.uniform(low.x, high.x), draw.uniform(low.y, high.y));
        if contains(outline, place) == Some(true) {
            return place;
        }
    }
}

/// Steps in which weights are balanced.
const BALANCE_STEPS: usize = 30;

/// Feet whose weights, nearest to those given, have their middle at a place: each times exp(λ·p), λ by Newton's method. None
/// where no weights have.
fn balanced(places: &[Point2<f64>], weights: &[f64], middle: Point2<f64>) -> Option<Vec<(Point2<f64>, f64)>> {
    let mut tilt = Vector2::zeros();
    for _ in 0..BALANCE_STEPS {
        let tilted = |tilt: Vector2<f64>| {
            let shares =
                places.iter().zip(weights).map(move |(place, weight)| weight * tilt.dot(&(place - middle)).exp());
            shares.collect::<Vec<_>>()
        };
        let shares = tilted(tilt);
        let total: f64 = shares.iter().sum();
        let off: Vector2<f64> =
            places.iter().zip(&shares).map(|(place, share)| (place - middle) * (share / total)).sum();
        if off.norm() < BALANCED_M {
            return Some(places.iter().copied().zip(shares.into_iter().map(|share| share / total)).collect());
        }
        let spread: Matrix2<f64> = places
            .iter()
            .zip(&shares)
            .map(|(place, share)| (place - middle - off) * (place - middle - off).transpose() * (share / total))
            .sum();
        tilt -= spread.try_inverse()? * off;
    }
    None
}

/// Middles this near are one, m.
const BALANCED_M: f64 = 1e-9;
