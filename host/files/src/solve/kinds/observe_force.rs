//! The kind `observe_force`: pose and motion of a part from what the finger's force sensor reads. See
//! [`palpate::pushing::estimation::from_rest::readings`].

use nalgebra::{Point2, Vector2};
use palpate::pushing::dynamics::support::SupportFriction;
use palpate::pushing::dynamics::{Body, FingerShape, Mass, Part, ShapeError};
use palpate::pushing::estimation::from_rest;
use palpate::pushing::estimation::from_rest::PartErrors;
use palpate::pushing::estimation::from_rest::readings::{
    self, ForceHypothesis, ForceReading, KnownOfFinger, MeasuredFinger,
};
use palpate::pushing::finger_motion::{FingerMotion, Segment};
use palpate::pushing::measured_path::{MeasuredPath, PLACES_MIN};
use palpate::pushing::measured_turn::MeasuredTurn;
use palpate::{Searched, Stop, never};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use super::initial_pose::{EllipseObject, PolygonObject, PushedObject};
use super::push::Support;
use super::pushed;
use crate::solve::fields::{NonNegative, Polygon, PoseFields, Positive, check_gone, default_gravity, plane_friction};
use crate::solve::{InvalidInput, Pointer, Problem, SolveError};

/// A part that a carried finger begins to push, or is pushing: where is it, and how does it move?
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObserveForce {
    /// The part's outline; or `object`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub polygon: Option<Polygon>,
    /// Instead of `polygon`: the part's outline as `initial_pose` has it, an ellipse too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<PushedObject>,
    /// Standard deviation of the offset of each edge's line along its normal, or of an ellipse's semi-axes, m, independent.
    #[serde(default)]
    pub polygon_sigma: NonNegative,
    /// Friction between part and plane.
    #[serde(deserialize_with = "plane_friction")]
    pub mu: NonNegative,
    /// Standard deviation of ln(mu); 0 where it is known.
    #[serde(default)]
    pub mu_sigma_log: NonNegative,
    /// Gravity, m/s².
    #[serde(default = "default_gravity")]
    pub g: NonNegative,
    /// Where the weight rests; uniform over the polygon where not given. "unknown": anywhere under the part, most likely
    /// about as uniform.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub support: Option<SupportField>,
    /// Part frame, m; the area centroid where not given. Together with `inertia_per_mass`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_of_mass: Option<[f64; 2]>,
    /// Moment of inertia about `centre_of_mass` over the mass, m².
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia_per_mass: Option<Positive>,
    /// Standard deviation of the centre of mass, each coordinate, m.
    #[serde(default)]
    pub centre_of_mass_sigma: NonNegative,
    /// Of the part, kg; unknown where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass: Option<Positive>,
    /// Friction between finger and part; unknown, from 0 to 1, where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_c: Option<NonNegative>,
    /// Standard deviation of ln(mu_c) along an edge, from one place to another 5 mm away; 0 where it is the same everywhere.
    #[serde(default)]
    pub mu_c_wander_sigma_log: NonNegative,
    /// The finger, how it bends and how it moves.
    pub finger: CarriedFinger,
    /// What its sensor reads.
    pub force: ForceFields,
    /// The part when the force begins.
    #[serde(default)]
    pub start: StartField,
}

/// Where a part's weight rests, as far as that is known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum SupportField {
    /// On feet.
    Known(Support),
    /// Nobody knows.
    Unknown(UnknownSupport),
}

/// The word for a support that is not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum UnknownSupport {
    /// Anywhere under the part.
    Unknown,
}

/// A disk on a finger that a robot carries.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CarriedFinger {
    /// A disk, if nothing else is said: with `radius`, an ellipse with `a` and `b`, its axes the world's, or a straight line
    /// along the world's x with the part above it.
    #[serde(default, rename = "type")]
    pub outline: FingerOutline,
    /// Of a disk, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius: Option<NonNegative>,
    /// Of an ellipse: semi-axis along x, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub a: Option<Positive>,
    /// Of an ellipse: semi-axis along y, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub b: Option<Positive>,
    /// What the sensor feels of the finger's own inertia, kg; null where it is unknown: then 0.02 ± 0.02.
    #[serde(default = "no_mass", deserialize_with = "mass_or_null")]
    pub effective_mass: Option<NonNegative>,
    /// Standard deviation of `effective_mass`, kg.
    #[serde(default)]
    pub effective_mass_sigma: NonNegative,
    /// How far the disk gives way to a force on it, m/N.
    #[serde(default)]
    pub compliance: NonNegative,
    /// How the robot moves its clamp: where the disk's centre is without force.
    pub motion: MotionFields,
}

/// Outline of a finger.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FingerOutline {
    /// A disk.
    #[default]
    Disk,
    /// An ellipse.
    Ellipse,
    /// A straight edge.
    Line,
}

impl CarriedFinger {
    /// The disk's radius, m, and the outline where it is no disk.
    fn shape(&self) -> Result<(f64, Option<FingerShape>), InvalidInput> {
        let given = [("radius", self.radius.is_some()), ("a", self.a.is_some()), ("b", self.b.is_some())];
        let (needed, of): (&[&str], _) = match self.outline {
            FingerOutline::Disk => (&["radius"], "a disk"),
            FingerOutline::Ellipse => (&["a", "b"], "an ellipse"),
            FingerOutline::Line => (&[], "a line"),
        };
        for (field, is_given) in given {
            match (needed.contains(&field), is_given) {
                (true, false) => return Err(InvalidInput::missing(field, &format!("{of} needs it"))),
                (false, true) => {
                    return Err(InvalidInput::at(field, format!("is not of {of}: leave it out, or change `type`")));
                }
                _ => {}
            }
        }
        Ok(match (self.outline, self.radius, self.a, self.b) {
            (FingerOutline::Line, ..) => (0.0, Some(FingerShape::Line)),
            (FingerOutline::Ellipse, _, Some(a), Some(b)) => {
                (0.0, Some(FingerShape::Ellipse { semi_axes: [a.get(), b.get()] }))
            }
            (_, radius, ..) => (radius.map_or(0.0, NonNegative::get), None),
        })
    }
}

#[expect(clippy::unnecessary_wraps, reason = "serde wants the type of the field")]
fn no_mass() -> Option<NonNegative> {
    Some(NonNegative::default())
}

fn mass_or_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<NonNegative>, D::Error> {
    Option::deserialize(deserializer)
}

/// A motion from rest: `centre0` and `segments`, or a measured `path` with its `sigma`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionFields {
    /// Where the clamp rests until t = 0, m. With `segments`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre0: Option<[f64; 2]>,
    /// One after the other from t = 0 on; after the last the velocity is constant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segments: Option<Vec<SegmentFields>>,
    /// Instead of `segments`: measured places of the clamp.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<PathFields>,
    /// With `path`: standard deviation of one coordinate, white, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<Positive>,
    /// With `path`: standard deviation of what its time is early against the force's, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock_offset_sigma: Option<NonNegative>,
}

/// Measured places of the clamp.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PathFields {
    /// When each was taken, s, increasing.
    pub t: Vec<f64>,
    /// World axes, m.
    pub x: Vec<f64>,
    /// m.
    pub y: Vec<f64>,
    /// From the world's axes to the sensor's, rad, whole turns aside: the disk turns about its centre, and the force's axes
    /// with it. They stay as the world's where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phi: Option<Vec<f64>>,
}

/// A stretch of constant acceleration.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SegmentFields {
    /// s.
    pub duration: Positive,
    /// World axes, m/s².
    pub acceleration: [f64; 2],
}

/// Readings of a force sensor.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ForceFields {
    /// When each was taken, s, increasing.
    pub t: Vec<f64>,
    /// Force on the finger along the world's x, less what the finger's own mass takes, N.
    pub x: Vec<f64>,
    /// Along y, N.
    pub y: Vec<f64>,
    /// Standard deviation of one value, white, N.
    pub sigma: Positive,
}

/// A part when the force begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StartField {
    /// Finger and part touch, both at rest.
    #[default]
    AtRest,
    /// The finger is pushing the part.
    Moving,
}

/// Where the part may be, and how it may move.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ObserveForceAnswer {
    /// How many explanations there are.
    pub status: ObserveForceStatus,
    /// The explanations, most probable first.
    pub hypotheses: Vec<ForceHypothesisAnswer>,
}

/// How many explanations there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObserveForceStatus {
    /// One.
    Unique,
    /// Several.
    Ambiguous,
    /// No pose and motion of this part explains the readings.
    #[serde(rename = "none")]
    Unexplained,
}

/// A pose and motion that explain the readings.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ForceHypothesisAnswer {
    /// The edge in contact at the last reading; null of an ellipse.
    pub edge: Option<usize>,
    /// Contact on the finger at the first reading: polar angle of a disk, eccentric angle of an ellipse, rad; 0 on a line.
    pub u0: f64,
    /// Contact along the edge at the first reading, m; on an ellipse its eccentric angle in [0, π), rad.
    pub s0: f64,
    /// Of the polygon's own frame at the first reading.
    pub pose_start: PoseFields,
    /// The same at the last reading.
    pub s_end: f64,
    /// Of the polygon's own frame at the last reading.
    pub pose_end: PoseFields,
    /// Velocity of the centre of mass at the last reading, world axes, m/s, and angular velocity, rad/s.
    pub twist_end: [f64; 3],
    /// Of the part, kg.
    pub mass: f64,
    /// Friction between finger and part; null where it is unknown and the contact never slipped.
    pub mu_c: Option<f64>,
    /// With `mu_sigma_log` in the problem: the friction between part and plane that goes with this explanation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mu: Option<f64>,
    /// Where it is not known exactly: that of the finger that goes with this explanation, kg.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub effective_mass: Option<f64>,
    /// Of `pose_end` (x, y, theta) and `twist_end`, everything unknown included; null of a continuum.
    pub covariance: Option<[[f64; 6]; 6]>,
    /// Whether it is one of a continuum: round a disk, or along a straight finger, all places explain the same.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub unobservable: bool,
    /// Squared residuals in standard deviations, prior terms included.
    pub cost: f64,
    /// Data and prior terms less fitted parameters.
    pub dof: usize,
    /// Among the listed ones, before the push every place of the perimeter being as likely.
    pub probability: f64,
    /// With `clock_offset_sigma` in the problem: what the path's time is early against the force's, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock_offset: Option<f64>,
    /// When the finger began to push, s; null for `moving`.
    pub onset: Option<f64>,
}

impl Problem for ObserveForce {
    const KIND: &'static str = "observe_force";
    type Answer = ObserveForceAnswer;

    fn solve(&self) -> Result<ObserveForceAnswer, SolveError> {
        Ok(self.solve_until(&never)?.found)
    }

    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<ObserveForceAnswer>, SolveError> {
        let part = self.part()?;
        let (radius, shape) = self.finger.shape().map_err(|error| error.inside("finger"))?;
        if part.semi_axes().is_none() && shape == Some(FingerShape::Line) {
            let place = Pointer::from("finger").key("type");
            return Err(InvalidInput::at(place, ShapeError::BothStraight.to_string()).into());
        }
        let carried = self.finger.motion.read().map_err(|error| error.inside("motion").inside("finger"))?;
        let readings = self.force.readings().map_err(|error| error.inside("force"))?;
        let end = readings.last().map_or(0.0, |reading| reading.time);
        // Of a measured one nothing but the readings is asked.
        let told = match &carried {
            Carried::Told { onset, motion } => Some((*onset, motion.clone())),
            Carried::Measured { .. } => None,
        };
        let (told_onset, motion) = told.unwrap_or_else(|| (0.0, FingerMotion::untold()));
        match &carried {
            Carried::Told { .. } => {
                let gone = (motion.centre(end - told_onset) - motion.centre(0.0)).norm();
                check_gone(gone, end, reach(&part)).map_err(|message| InvalidInput::at("finger", message))?;
            }
            Carried::Measured { path, turn, clock_offset_sd } => {
                if turn.is_some() && shape.is_some() {
                    let place = Pointer::from("finger").key("type");
                    let message = "only a disk may turn: leave `path.phi` out, or give a `radius`";
                    return Err(InvalidInput::at(place, message).into());
                }
                covers(path, *clock_offset_sd, &readings).map_err(|error| error.inside("motion").inside("finger"))?;
            }
        }
        let errors = PartErrors {
            outline_sigma: self.polygon_sigma.get(),
            mass_follows_outline: self.centre_of_mass.is_none(),
            centre_of_mass_sigma: self.centre_of_mass_sigma.get(),
            pressure_log_sd: if matches!(self.support, Some(SupportField::Unknown(_))) {
                PartErrors::PRESSURE_UNKNOWN
            } else {
                0.0
            },
        };
        let finger = &self.finger;
        let (mass_sd, prior) = (finger.effective_mass_sigma.get(), from_rest::CarriedFinger::UNKNOWN);
        let (effective_mass, effective_mass_sd) =
            finger.effective_mass.map_or((prior.effective_mass, prior.effective_mass_sd), |mass| (mass.get(), mass_sd));
        let known = KnownOfFinger {
            part: &part,
            errors: errors.if_any(),
            mass: self.mass.map(Positive::get),
            mu_g: self.mu.get() * self.g.get(),
            mu_g_log_sd: (self.mu_sigma_log.get() > 0.0).then_some(self.mu_sigma_log.get()),
            mu_c: self.mu_c.map(NonNegative::get),
            mu_c_wander_log_sd: self.mu_c_wander_sigma_log.get(),
            radius,
            shape,
            is_moving: self.start == StartField::Moving,
            compliance: finger.compliance.get(),
            compliance_sd: 0.0,
            place_sd: 0.0,
            effective_mass,
            effective_mass_sd,
            motion: &motion,
            noise: self.force.sigma.get(),
        };
        let Searched { found: (onset, found), complete } = match &carried {
            Carried::Told { onset, .. } => {
                let since = |reading: &ForceReading| ForceReading { time: reading.time - onset, ..*reading };
                let readings: Vec<_> = readings.iter().map(since).collect();
                let Searched { found, complete } = readings::estimate_until(&known, &readings, stop);
                let found = found.into_iter().map(|found| (None, found)).collect::<Vec<_>>();
                Searched { found: (Some(*onset), found), complete }
            }
            Carried::Measured { path, turn, clock_offset_sd } => {
                let finger = MeasuredFinger { path, turn: turn.as_ref(), clock_offset_sd: *clock_offset_sd };
                let Searched { found: estimate, complete } =
                    readings::estimate_measured_until(&known, &finger, &readings, stop);
                let is_unknown = *clock_offset_sd > 0.0;
                let found = estimate.hypotheses.into_iter();
                let found = found.map(|(offset, found)| (is_unknown.then_some(offset), found)).collect();
                Searched { found: (estimate.onset, found), complete }
            }
        };
        if !complete && found.is_empty() {
            return Err(SolveError::Stopped);
        }
        // That nothing explains it is said of all there is to search.
        let complete = complete && (found.is_empty() || errors.can_exclude_others());
        let status = match found.len() {
            _ if !complete => ObserveForceStatus::Ambiguous,
            0 => ObserveForceStatus::Unexplained,
            1 if !found[0].1.is_continuum => ObserveForceStatus::Unique,
            _ => ObserveForceStatus::Ambiguous,
        };
        let onset = onset.filter(|_| self.start == StartField::AtRest);
        let answers = found.iter().map(|(clock_offset, found)| ForceHypothesisAnswer {
            clock_offset: *clock_offset,
            ..ForceHypothesisAnswer::of(found, &known, self.g.get(), onset)
        });
        let hypotheses = answers.collect();
        Ok(Searched { found: ObserveForceAnswer { status, hypotheses }, complete })
    }
}

impl ObserveForce {
    fn part(&self) -> Result<Part, InvalidInput> {
        let polygon = match (&self.polygon, &self.object) {
            (Some(_), Some(_)) => return Err(InvalidInput::exclusive("polygon", "object")),
            (None, None) => return Err(InvalidInput::missing("polygon", "give the part's outline, or an `object`")),
            (Some(polygon), None) => polygon,
            (None, Some(PushedObject::Polygon(PolygonObject { vertices }))) => vertices,
            (None, Some(PushedObject::Ellipse(EllipseObject { a, b }))) => return self.ellipse([a.get(), b.get()]),
        };
        let support = match &self.support {
            Some(SupportField::Known(support)) => Some(support),
            Some(SupportField::Unknown(_)) | None => None,
        };
        pushed::part((**polygon).clone(), self.centre_of_mass, self.inertia_per_mass, support)
    }

    fn ellipse(&self, semi_axes: [f64; 2]) -> Result<Part, InvalidInput> {
        let mass = pushed::mass(Mass::of_ellipse(semi_axes), self.centre_of_mass, self.inertia_per_mass)?;
        let body = match &self.support {
            Some(SupportField::Known(support)) => Body::on_feet(&support.feet(), mass),
            Some(SupportField::Unknown(_)) | None => Body::uniform(SupportFriction::ellipse(semi_axes), mass),
        };
        Ok(Part::elliptic(semi_axes, body))
    }
}

/// A part's largest distance from its centre of mass, m.
fn reach(part: &Part) -> f64 {
    let centre = part.centre_of_mass();
    part.polygon().vertices().iter().map(|vertex| (vertex - centre).norm()).fold(0.0, f64::max)
}

impl ForceHypothesisAnswer {
    /// In the words of the interface, under this gravity (m/s²); the clock of the finger's path being the force's.
    #[must_use]
    pub fn of(found: &ForceHypothesis, known: &KnownOfFinger, g: f64, onset: Option<f64>) -> Self {
        let [vx, vy] = found.velocity_end.into();
        // An ellipse repeats.
        let place = |s: f64| if known.part.semi_axes().is_some() { s.rem_euclid(std::f64::consts::PI) } else { s };
        Self {
            edge: known.part.semi_axes().is_none().then_some(found.edge),
            u0: found.start.u,
            s0: place(found.start.s),
            pose_start: PoseFields::from(<[f64; 3]>::from(found.pose_start)),
            s_end: place(found.end.s),
            pose_end: PoseFields::from(<[f64; 3]>::from(found.pose_end)),
            twist_end: [vx, vy, found.end.omega],
            mass: found.mass,
            mu_c: found.mu_c,
            mu: known.mu_g_log_sd.map(|_| found.mu_g / g),
            effective_mass: (known.effective_mass_sd > 0.0).then_some(found.effective_mass),
            covariance: (!found.is_continuum).then(|| found.covariance.transpose().into()),
            unobservable: found.is_continuum,
            cost: found.cost,
            dof: found.degrees_of_freedom,
            probability: found.probability,
            clock_offset: None,
            onset,
        }
    }
}

impl MotionFields {
    /// As it was told or measured.
    fn read(&self) -> Result<Carried, InvalidInput> {
        match (&self.segments, &self.path) {
            (Some(_), Some(_)) => Err(InvalidInput::exclusive("segments", "path")),
            (Some(segments), None) => {
                for (field, is_given) in
                    [("sigma", self.sigma.is_some()), ("clock_offset_sigma", self.clock_offset_sigma.is_some())]
                {
                    if is_given {
                        return Err(InvalidInput::at(field, "is for a measured `path`: leave it out with `segments`"));
                    }
                }
                let centre = self.centre0.ok_or_else(|| InvalidInput::missing("centre0", "`segments` begin there"))?;
                let (onset, motion) = told(centre, segments)?;
                Ok(Carried::Told { onset, motion })
            }
            (None, Some(path)) => {
                if self.centre0.is_some() {
                    return Err(InvalidInput::at("centre0", "is for `segments`: a `path` says where it begins"));
                }
                let sigma = self.sigma.ok_or_else(|| InvalidInput::missing("sigma", "a `path` needs its noise"))?;
                let (path, turn) = path.measured(sigma.get()).map_err(|error| error.inside("path"))?;
                Ok(Carried::Measured {
                    path,
                    turn,
                    clock_offset_sd: self.clock_offset_sigma.map_or(0.0, NonNegative::get),
                })
            }
            (None, None) => Err(InvalidInput::missing("segments", "give `segments` or a measured `path`")),
        }
    }
}

/// How the finger is carried.
enum Carried {
    /// From rest, beginning at a time.
    Told { onset: f64, motion: FingerMotion },
    /// By measured places.
    Measured { path: MeasuredPath, turn: Option<MeasuredTurn>, clock_offset_sd: f64 },
}

impl PathFields {
    fn measured(&self, sigma: f64) -> Result<(MeasuredPath, Option<MeasuredTurn>), InvalidInput> {
        check_columns(&self.t, &self.x, &self.y, PLACES_MIN)?;
        let places = self.x.iter().zip(&self.y).map(|(x, y)| Point2::new(*x, *y)).collect();
        let turn = |phi: &Vec<f64>| {
            if phi.len() != self.t.len() {
                let message = format!("has {} values, but `t` has {}: give one for each time", phi.len(), self.t.len());
                return Err(InvalidInput::at("phi", message));
            }
            MeasuredTurn::new(&self.t, phi).map_err(|error| InvalidInput::at("phi", error.to_string()))
        };
        let turn = self.phi.as_ref().map(turn).transpose()?;
        Ok((MeasuredPath { times: self.t.clone(), places, sigma }, turn))
    }
}

/// Whether a path is there for all readings, wherever its clock is.
fn covers(path: &MeasuredPath, clock_offset_sd: f64, readings: &[ForceReading]) -> Result<(), InvalidInput> {
    let (Some(first), Some(last)) = (path.times.first(), path.times.last()) else { return Ok(()) };
    let (Some(from), Some(to)) = (readings.first(), readings.last()) else { return Ok(()) };
    let beyond = OFFSETS_COVERED * clock_offset_sd;
    if *first <= from.time - beyond && *last >= to.time + beyond {
        return Ok(());
    }
    let message = format!(
        "runs from {first:?} to {last:?} s, but the force from {:?} to {:?} s: with {OFFSETS_COVERED} `clock_offset_sigma` on either side it must cover that",
        from.time, to.time
    );
    Err(InvalidInput::at(Pointer::from("path").key("t"), message))
}

/// A path covers the readings by so many standard deviations of its clock.
pub const OFFSETS_COVERED: f64 = 3.0;

/// When it begins, s, and how it goes on from there.
fn told(centre0: [f64; 2], all: &[SegmentFields]) -> Result<(f64, FingerMotion), InvalidInput> {
    let is_still = |segment: &&SegmentFields| segment.acceleration.iter().all(|a| *a == 0.0);
    let still = all.iter().take_while(is_still).count();
    let onset = all[..still].iter().map(|segment| segment.duration.get()).sum();
    let moving = all[still..].iter();
    let segments: Vec<_> = moving
        .map(|segment| Segment { seconds: segment.duration.get(), acceleration: Vector2::from(segment.acceleration) })
        .chain([Segment { seconds: f64::from(u32::MAX), acceleration: Vector2::zeros() }])
        .collect();
    if segments.len() == 1 {
        return Err(InvalidInput::at("segments", "has no acceleration: a finger that never moves pushes nothing"));
    }
    let motion = FingerMotion::new(Point2::from(centre0), &segments)
        .map_err(|error| InvalidInput::at("segments", error.to_string()))?;
    Ok((onset, motion))
}

impl ForceFields {
    fn readings(&self) -> Result<Vec<ForceReading>, InvalidInput> {
        check_columns(&self.t, &self.x, &self.y, READINGS_MIN)?;
        let reading = |((t, x), y): ((&f64, &f64), &f64)| ForceReading { time: *t, force: Vector2::new(*x, *y) };
        Ok(self.t.iter().zip(&self.x).zip(&self.y).map(reading).collect())
    }
}

/// Refuses columns `t`, `x`, `y` of different lengths, of too few rows, or out of time's order.
fn check_columns(t: &[f64], x: &[f64], y: &[f64], least: usize) -> Result<(), InvalidInput> {
    for (field, values) in [("x", x), ("y", y)] {
        if values.len() != t.len() {
            let message = format!("has {} values, but `t` has {}: give one for each time", values.len(), t.len());
            return Err(InvalidInput::at(field, message));
        }
    }
    if t.len() < least {
        let message = format!("has {} times, at least {least} are needed", t.len());
        return Err(InvalidInput::at("t", message));
    }
    // JSON has no NaN.
    if let Some(i) = (1..t.len()).find(|&i| t[i] <= t[i - 1]) {
        let message = format!("{:?} s is not after the time before it, {:?} s: times must increase", t[i], t[i - 1]);
        return Err(InvalidInput::at(Pointer::from("t").index(i), message));
    }
    Ok(())
}

/// Fewest readings: there are up to six unknowns, and two numbers a reading.
const READINGS_MIN: usize = 4;

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    use serde_json::{Value, json};

    use super::*;
    use crate::solve::read;

    /// A block that is pushed straight; nothing is said of what is felt but that it is a steady force.
    fn problem() -> Value {
        let t: Vec<_> = (0..12).map(|n| 0.02 * f64::from(n)).collect();
        json!({
            "polygon": [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]], "mu": 0.3,
            "finger": {"radius": 0.01, "motion": {"centre0": [0, 0], "segments": [{"duration": 0.3, "acceleration": [0, 0.2]}]}},
            "force": {"t": t, "x": vec![0.0; 12], "y": vec![-0.6; 12], "sigma": 0.01},
        })
    }

    fn changed(place: &str, value: Value) -> Value {
        let mut problem = problem();
        let (parent, key) = place.rsplit_once('/').unwrap();
        problem.pointer_mut(parent).unwrap()[key] = value;
        problem
    }

    fn refuse(problem: Value) -> String {
        let solved = read::<ObserveForce>(problem).map_err(SolveError::from).and_then(|problem| problem.solve());
        match solved.unwrap_err() {
            SolveError::InvalidInput(error) => error.to_string(),
            other => panic!("{other}"),
        }
    }

    #[test]
    fn every_mistake_has_a_message_and_a_place_of_its_own() {
        let cases = [
            ("/force/x", json!([0.0]), "/force/x", "has 1 values, but `t` has 12"),
            ("/force/t", json!([0.0, 0.1, 0.1]), "/force/x", "has 12 values, but `t` has 3"),
            ("/force/sigma", json!(0), "/force/sigma", "> 0"),
            ("/mass", json!(-1), "/mass", "> 0"),
            ("/mu_c", json!(-0.1), "/mu_c", "≥ 0"),
            ("/polygon_sigma", json!(-1), "/polygon_sigma", "≥ 0"),
            ("/finger/effective_mass", json!(-1), "/finger/effective_mass", "≥ 0"),
            ("/finger/motion/segments", json!([]), "/finger/motion/segments", "never moves"),
            (
                "/finger/motion/path",
                json!({"t": [], "x": [], "y": []}),
                "/finger/motion/path",
                "cannot be given together",
            ),
            ("/finger/motion/sigma", json!(1e-6), "/finger/motion/sigma", "for a measured `path`"),
            ("/finger/motion/segments/0/duration", json!(0), "/finger/motion/segments/0/duration", "> 0"),
            ("/finger/motion/segments/0/acceleration", json!([1e6, 0]), "/finger", "sizes of the part"),
            ("/start", json!("still"), "/start", "at_rest"),
            ("/centre_of_mass", json!([0, 0]), "/inertia_per_mass", "is missing"),
            ("/dt", json!(0.1), "/dt", "not a field"),
            ("/object", json!({"type": "ellipse", "a": 0.03, "b": 0.02}), "/object", "cannot be given together"),
            ("/finger/type", json!("ellipse"), "/finger/radius", "is not of an ellipse"),
            ("/finger/a", json!(0.01), "/finger/a", "is not of a disk"),
        ];
        for (place, value, field, message) in cases {
            let told = refuse(changed(place, value.clone()));
            assert!(told.contains(&format!("{field:?}")) && told.contains(message), "{place} {value}: {told}");
        }
        let mut backwards = problem();
        backwards["force"]["t"][5] = json!(0.0);
        assert!(refuse(backwards).contains("times must increase"));
    }

    #[test]
    fn a_straight_finger_on_a_polygon_is_refused_and_on_an_ellipse_its_place_is_not_told() {
        let mut straight = problem();
        straight["finger"].as_object_mut().unwrap().remove("radius");
        straight["finger"]["type"] = json!("line");
        let told = refuse(straight.clone());
        assert!(told.contains("/finger/type") && told.contains("straight"), "{told}");
        straight.as_object_mut().unwrap().remove("polygon");
        straight["object"] = json!({"type": "ellipse", "a": 0.03, "b": 0.02});
        let answer = read::<ObserveForce>(straight).unwrap().solve().unwrap();
        assert_eq!(answer.status, ObserveForceStatus::Ambiguous, "{answer:?}");
        for found in &answer.hypotheses {
            assert!(found.unobservable && found.covariance.is_none() && found.edge.is_none(), "{found:?}");
            assert!((0.0..std::f64::consts::PI).contains(&found.s0), "{found:?}");
        }
    }

    #[test]
    fn on_an_unknown_pressure_no_answer_is_certain() {
        let known = read::<ObserveForce>(problem()).unwrap().solve_until(&never).unwrap();
        assert!(known.complete && !known.found.hypotheses.is_empty(), "{known:?}");
        let mut problem = problem();
        problem["support"] = json!("unknown");
        let unknown = read::<ObserveForce>(problem.clone()).unwrap().solve_until(&never).unwrap();
        assert!(!unknown.complete && unknown.found.status == ObserveForceStatus::Ambiguous, "{unknown:?}");
        // Ten newtons are no push of this part, however it presses on the plane.
        problem["force"]["x"].as_array_mut().unwrap().iter_mut().for_each(|force| *force = json!(10.0));
        let none = read::<ObserveForce>(problem).unwrap().solve_until(&never).unwrap();
        assert!(none.complete && none.found.status == ObserveForceStatus::Unexplained, "{none:?}");
    }

    #[test]
    fn a_search_that_is_broken_off_is_certain_of_nothing() {
        let problem = read::<ObserveForce>(problem()).unwrap();
        for most in [0, 1, 10, 100, 1000] {
            let asked = AtomicUsize::new(0);
            let stop = || asked.fetch_add(1, Relaxed) >= most;
            match problem.solve_until(&stop) {
                Ok(Searched { found, complete: false }) => assert_eq!(found.status, ObserveForceStatus::Ambiguous),
                Ok(Searched { .. }) => assert!(asked.into_inner() <= most),
                Err(error) => assert_eq!(error, SolveError::Stopped),
            }
        }
    }

    #[test]
    fn strange_problems_are_answered_too() {
        for (place, value) in [
            ("/finger/effective_mass", Value::Null),
            ("/finger/radius", json!(0)),
            ("/finger/compliance", json!(1e-3)),
            ("/start", json!("moving")),
            ("/mu", json!(0)),
            ("/mu_c", json!(0)),
            ("/mu_c", json!(5)),
            ("/mu_sigma_log", json!(0.3)),
            ("/polygon_sigma", json!(1e-4)),
            ("/polygon_sigma", json!(1)),
            ("/mass", json!(1e-9)),
            ("/force/sigma", json!(1e3)),
            ("/force/t", json!([-1.2, -1.1, -1.0, -0.9, -0.8, -0.7, -0.6, -0.5, -0.4, -0.3, -0.2, -0.1])),
            ("/force/t", json!([0, 1e-9, 2e-9, 3e-9, 4e-9, 5e-9, 6e-9, 7e-9, 8e-9, 9e-9, 1e-8, 0.1])),
        ] {
            let told = format!("{place} {value}");
            let answer = read::<ObserveForce>(changed(place, value)).unwrap().solve().unwrap();
            crate::solve::testing::all_finite(&answer);
            let count = answer.hypotheses.len();
            let expected = [ObserveForceStatus::Unexplained, ObserveForceStatus::Unique, ObserveForceStatus::Ambiguous];
            assert_eq!(answer.status, expected[count.min(2)], "{told}");
        }
    }
}
