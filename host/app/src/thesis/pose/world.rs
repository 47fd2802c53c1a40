//! Random pushes with their truth.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Point2, Rotation2, Vector2, Vector3};
use palpate::geometry::Pose;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::angle::wrap_angle;
use palpate::math::random::Draw;
use palpate::pushing::dynamics::{
    ContactLaw, ContactMode, EdgeEnd, EndReason, Finger, Part, Push, PushModel, PushRun, Sample, Slip, Start, State,
};
use palpate::pushing::estimation::{Channel, Hypothesis, Known, Measured, Observation, Prior, Touch};

use crate::thesis::cases::random_part;
use crate::thesis::rivals::{self, Leg, Truth};

/// Time between values, s, and their number.
const DT_S: f64 = 0.01;
const VALUES: u32 = 81;

/// µ g, m/s².
const MU_G: f64 = 0.3 * GRAVITY_ASSUMED;

/// Friction between finger and part, where there is some.
const CONTACT_FRICTION: f64 = 0.2;

/// Of the start: rad/s and m/s.
const PRIOR: (f64, f64) = (1.0, 0.004);

/// How finger and part touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Rolling,
    Frictionless,
    Sliding,
    Coulomb,
}

/// What the finger feels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sense {
    /// The contact angle alone, rad.
    Angle,
    /// The direction of the force; where the contact is, to ±10° about straight ahead.
    Direction,
    /// That and the magnitude of the force.
    Force,
    /// The magnitude alone, by a point finger that is told the part's mass.
    Magnitude,
    /// The same without the mass.
    Course,
}

impl Sense {
    /// Radius of the finger, m.
    fn radius(self) -> f64 {
        match self {
            Self::Angle | Self::Direction | Self::Force => 0.01,
            Self::Magnitude | Self::Course => POINT_M,
        }
    }

    /// Half the range of contact angles about straight ahead, rad.
    fn range(self) -> f64 {
        match self {
            Self::Angle => 0.3,
            Self::Direction | Self::Force => ANGLE_RANGE,
            Self::Magnitude | Self::Course => MAGNITUDE_RANGE,
        }
    }
}

/// Radius of a point finger, m.
const POINT_M: f64 = 1e-3;

/// Half the range of contact angles of a point finger, rad: 45°.
const MAGNITUDE_RANGE: f64 = 45.0 / 180.0 * std::f64::consts::PI;

/// How near to the truth an estimate must end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tolerance {
    /// On the edge and of the centre of mass, m.
    pub(super) place: f64,
    /// Tolerance of orientation, rad.
    pub(super) turn: f64,
}

/// A row of an experiment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setting {
    pub(super) kind: Kind,
    pub(super) sense: Sense,
    /// Of one angle, rad; 0 for exact ones.
    pub(super) sigma: f64,
}

/// Half the range of contact angles of pushes felt by their force, rad: 10°.
const ANGLE_RANGE: f64 = 10.0 / 180.0 * std::f64::consts::PI;

/// Standard deviation of a force, relative.
const SIGMA_FORCE: f64 = 0.01;

/// A push that was felt.
#[derive(Clone, Debug)]
pub(super) struct Case {
    pub(super) part: Part,
    leg: Leg,
    pub(super) kind: Kind,
    sense: Sense,
    /// Of one value, rad; 0 for exact ones.
    pub(super) sigma: f64,
    pub(super) edge: usize,
    pub(super) samples: Vec<Sample>,
    pub(super) angles: Vec<f64>,
    /// Angles of what is felt: of the contact or of the force.
    measured: Vec<f64>,
    /// Logarithms of the force per mass.
    magnitudes: Vec<f64>,
}

impl Case {
    /// The case of a number under a seed: drawn until the contact lasts.
    pub(super) fn draw(seed: u64, number: usize, setting: Setting) -> Self {
        let mut draw = Draw::case(seed, number);
        loop {
            if let Some(mut case) = Self::try_draw(&mut draw, setting) {
                case.feel(&mut draw);
                return case;
            }
        }
    }

    fn feel(&mut self, draw: &mut Draw) {
        for (sample, angle) in self.samples.iter().zip(&self.angles) {
            let (normal, along) = sample.force.map_or((1.0, 0.0), |force| (force.normal, force.tangential));
            let from_normal = if self.sense == Sense::Angle { 0.0 } else { along.atan2(normal) };
            self.measured.push(angle - from_normal + self.sigma * draw.normal());
            self.magnitudes.push(normal.hypot(along).ln() + SIGMA_FORCE * draw.normal());
        }
    }

    fn try_draw(draw: &mut Draw, Setting { kind, sense, sigma }: Setting) -> Option<Self> {
        let part = random_part(draw);
        let edge_index = draw.index(part.polygon().vertices().len());
        let edge = part.edge(edge_index).ok()?;
        // Sliding lasts only where the finger goes along.
        let along = if kind == Kind::Sliding {
            draw.uniform(0.08, 0.20) * if draw.chance(0.5) { 1.0 } else { -1.0 }
        } else {
            0.0
        };
        let acceleration = if draw.chance(0.5) { 0.025 } else { 0.0 };
        let finger = Finger {
            radius: sense.radius(),
            centre0: Point2::origin(),
            velocity0: Vector2::new(along, 0.05),
            acceleration: Vector2::new(0.0, acceleration),
        };
        let s = draw.uniform(edge.s_min, edge.s_max);
        let u = FRAC_PI_2 + draw.uniform(-sense.range(), sense.range());
        let omega = PRIOR.0 * draw.normal();
        let state = State { u, s, omega, v_t: PRIOR.1 * draw.normal() };
        let model = PushModel { part: &part, edge, mu_g: MU_G, finger };
        let law = law(kind, Slip::of(model.slip(0.0, &state)));
        let push = Push::new(model, law, Start::Moving(state), EdgeEnd::Stop).ok()?;
        let times: Vec<_> = (0..values(kind)).map(|i| f64::from(i) * DT_S).collect();
        let PushRun { samples, end, .. } = push.run(&times).ok()?;
        if end.reason != EndReason::Time || samples.len() != times.len() {
            return None;
        }
        let is_clear = |sample: &Sample| rivals::is_clear(&part, edge_index, finger.radius, sample.state.s);
        if !samples.iter().all(is_clear) {
            return None;
        }
        let angles = samples.iter().map(|sample| sample.state.u).collect();
        let (measured, magnitudes) = (Vec::new(), Vec::new());
        let leg = Leg { finger, values: times.len() - 1 };
        Some(Self { edge: edge_index, leg, kind, sense, sigma, samples, angles, measured, magnitudes, part })
    }

    pub(super) fn known(&self) -> Known<'_> {
        let friction = CONTACT_FRICTION;
        let touch = match self.kind {
            Kind::Rolling => Touch::Rolling { friction: None },
            Kind::Frictionless => Touch::Frictionless,
            Kind::Sliding => Touch::Sliding { friction },
            Kind::Coulomb => Touch::Coulomb { friction },
        };
        Known { part: &self.part, mu_g: MU_G, finger: self.leg.finger, touch }
    }

    pub(super) fn model(&self, edge: usize) -> Option<PushModel<'_>> {
        Some(PushModel { part: &self.part, edge: self.part.edge(edge).ok()?, mu_g: MU_G, finger: self.leg.finger })
    }

    /// What another pose would have to have been felt like.
    pub(super) fn truth(&self) -> Truth<'_> {
        let Known { part, mu_g, touch, .. } = self.known();
        Truth {
            part,
            mu_g,
            legs: std::slice::from_ref(&self.leg),
            touch,
            edge: self.edge,
            start: self.samples[0].state,
            s_end: self.end().state.s,
            angles: &self.angles,
            dt: DT_S,
            sigma: self.sigma_used(),
            prior: Self::prior(),
            is_clear: true,
        }
    }

    pub(super) fn sigma_used(&self) -> f64 {
        if self.sigma == 0.0 { palpate_files::solve::fields::SIGMA_LEAST } else { self.sigma }
    }

    pub(super) fn prior() -> Prior {
        Prior { omega0_sigma: Some(PRIOR.0), v_t0_sigma: Some(PRIOR.1), mu_g_log_sigma: None }
    }

    pub(super) fn observation(&self) -> Observation {
        let angles = Channel { values: self.measured.clone(), sigma: self.sigma_used() };
        let magnitudes = Channel { values: self.magnitudes.clone(), sigma: SIGMA_FORCE };
        let u0_range = Some(FRAC_PI_2 - self.sense.range()..=FRAC_PI_2 + self.sense.range());
        let measured = match self.sense {
            Sense::Angle => Measured::ContactAngle(angles),
            Sense::Direction => {
                Measured::Force { direction: Some(angles), magnitude: None, u0_range, mass_is_unknown: false }
            }
            Sense::Force => Measured::Force {
                direction: Some(angles),
                magnitude: Some(magnitudes),
                u0_range,
                mass_is_unknown: false,
            },
            Sense::Magnitude | Sense::Course => Measured::Force {
                direction: None,
                magnitude: Some(magnitudes),
                u0_range,
                mass_is_unknown: self.sense == Sense::Course,
            },
        };
        Observation { dt: DT_S, measured, prior: Self::prior() }
    }

    pub(super) fn end(&self) -> &Sample {
        &self.samples[self.samples.len() - 1]
    }

    /// Whether a hypothesis has the true edge, and its end is within tolerances.
    pub(super) fn is_truth(&self, hypothesis: &Hypothesis, Tolerance { place, turn }: Tolerance) -> bool {
        let end = self.end();
        let centroid =
            |position: Point2<f64>, theta: f64| position + Rotation2::new(theta) * self.part.centre_of_mass().coords;
        let Pose { x, y, theta } = hypothesis.pose_end;
        let off = centroid(Point2::new(x, y), theta) - centroid(end.position, end.theta);
        hypothesis.edge == self.edge
            && (hypothesis.end.s - end.state.s).abs() < place
            && off.norm() < place
            && wrap_angle(theta - end.theta).abs() < turn
    }

    /// Squared error of a hypothesis's pose in its own standard deviations.
    pub(super) fn squared_error(&self, hypothesis: &Hypothesis) -> Option<f64> {
        let end = self.end();
        let Pose { x, y, theta } = hypothesis.pose_end;
        let off = Vector3::new(x - end.position.x, y - end.position.y, wrap_angle(theta - end.theta));
        Some((off.transpose() * hypothesis.covariance?.try_inverse()? * off)[0])
    }

    /// Whether a hypothesis, simulated with error control, has the cost it claims and keeps its contact.
    pub(super) fn reproduces(&self, hypothesis: &Hypothesis, tolerance: f64) -> bool {
        let Some(model) = self.model(hypothesis.edge) else { return false };
        let slip = match hypothesis.contact_start {
            ContactMode::Sliding { slip, .. } => slip,
            _ => Slip::Forward,
        };
        // On the edge's line, as an end may lean over a vertex by micrometres.
        let Ok(push) = Push::new(model, law(self.kind, slip), Start::Moving(hypothesis.start), EdgeEnd::Extend) else {
            return false;
        };
        let times: Vec<_> = (0..values(self.kind)).map(|i| f64::from(i) * DT_S).collect();
        let Ok(run) = push.run(&times) else { return false };
        let sigma = self.sigma_used();
        let off = run
            .samples
            .iter()
            .zip(&self.measured)
            .map(|(sample, measured)| ((sample.state.u - measured) / sigma).powi(2));
        let mut cost: f64 = off.sum::<f64>() + (hypothesis.start.omega / PRIOR.0).powi(2);
        let has_v_t = match self.kind {
            Kind::Rolling => false,
            Kind::Frictionless | Kind::Sliding => true,
            Kind::Coulomb => model.slip(0.0, &hypothesis.start).abs() > 1e-9,
        };
        cost += if has_v_t { (hypothesis.start.v_t / PRIOR.1).powi(2) } else { 0.0 };
        run.samples.len() == self.measured.len() && (cost - hypothesis.cost).abs() < tolerance
    }
}

fn values(kind: Kind) -> u32 {
    // The finger of a sliding contact goes along the edge, which ends.
    if kind == Kind::Sliding { 31 } else { VALUES }
}

fn law(kind: Kind, slip: Slip) -> ContactLaw {
    let friction = CONTACT_FRICTION;
    match kind {
        Kind::Rolling => ContactLaw::Rolling { friction: None },
        Kind::Frictionless => ContactLaw::Frictionless,
        Kind::Sliding => ContactLaw::Sliding { friction, slip },
        Kind::Coulomb => ContactLaw::Coulomb { friction },
    }
}
