//! The kind `push` in the mode `quasi_static`: a part that a finger pushes slowly. See
//! [`palpate::pushing::quasi_static`]; [`AnyPush`] is a push in any mode.

use std::borrow::Cow;

use nalgebra::Point2;
use palpate::pushing::quasi_static as slow;
use palpate::pushing::quasi_static::{SlowEnd, SlowMode, SlowPush, SlowPushError, SlowRun, SlowSample};
use palpate::{Pose, Searched, Stop, never};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize};

use super::push::{Push, PushAnswer, check_shares_sum};
use crate::solve::fields::{NonNegative, Polygon, PoseFields, Positive, default_gravity, plane_friction, size};
use crate::solve::read::named_or;
use crate::solve::{InvalidInput, Pointer, Problem, SolveError, Variant};

/// How far the finger may go, in sizes of the part: a path in other units is longer.
const PATH_MAX: f64 = 1e4;

/// Steps that a path may take at least: ten times what a path of that length takes with steps that fit its part.
const STEPS_MAX: f64 = 1e7;

/// A push, in time or so slow that nothing swings.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum AnyPush {
    /// With inertia.
    InTime(Box<Push>),
    /// Without.
    QuasiStatic(Box<QuasiStaticPush>),
}

impl<'de> Deserialize<'de> for AnyPush {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let slow: Variant<Self> = ("quasi_static", |fields| fields.read().map(Self::QuasiStatic));
        named_or(deserializer, "mode", slow, |fields| fields.read().map(Self::InTime))
    }
}

// By hand, because each variant's own fields have to stand in it for the frame to add its own.
impl JsonSchema for AnyPush {
    fn schema_name() -> Cow<'static, str> {
        "AnyPush".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut slow = QuasiStaticPush::json_schema(generator);
        let object = slow.ensure_object();
        if let Some(serde_json::Value::Object(properties)) = object.get_mut("properties") {
            properties.insert("mode".to_owned(), serde_json::json!({"const": "quasi_static"}));
        }
        if let Some(serde_json::Value::Array(required)) = object.get_mut("required") {
            required.push("mode".into());
        }
        json_schema!({"anyOf": [Push::json_schema(generator), slow]})
    }
}

/// How a push went.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum AnyPushAnswer {
    /// With inertia.
    InTime(Box<PushAnswer>),
    /// Without.
    QuasiStatic(QuasiStaticAnswer),
}

impl JsonSchema for AnyPushAnswer {
    fn schema_name() -> Cow<'static, str> {
        "AnyPushAnswer".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        json_schema!({"anyOf": [PushAnswer::json_schema(generator), QuasiStaticAnswer::json_schema(generator)]})
    }
}

impl Problem for AnyPush {
    const KIND: &'static str = Push::KIND;
    type Answer = AnyPushAnswer;

    fn solve(&self) -> Result<AnyPushAnswer, SolveError> {
        Ok(self.solve_until(&never)?.found)
    }

    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<AnyPushAnswer>, SolveError> {
        match self {
            Self::InTime(push) => {
                let Searched { found, complete } = push.solve_until(stop)?;
                Ok(Searched { found: AnyPushAnswer::InTime(Box::new(found)), complete })
            }
            Self::QuasiStatic(push) => {
                Ok(Searched { found: AnyPushAnswer::QuasiStatic(push.solve_until(stop)?), complete: true })
            }
        }
    }
}

/// A part pushed by a disk so slowly that friction alone decides.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct QuasiStaticPush {
    /// The part's outline.
    pub polygon: Polygon,
    /// Friction between part and plane.
    #[serde(deserialize_with = "plane_friction")]
    pub mu: NonNegative,
    /// Gravity, m/s².
    #[serde(default = "default_gravity")]
    pub g: NonNegative,
    /// Where the weight rests; uniform over the polygon where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub support: Option<SlowSupport>,
    /// Part frame, m; where the support puts it where not given. Counts where there is a `height`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_of_mass: Option<[f64; 2]>,
    /// Height of the contact above the plane, m.
    #[serde(default)]
    pub height: NonNegative,
    /// The finger and its path.
    pub finger: SlowFinger,
    /// Friction between finger and part while it slides.
    pub mu_c: NonNegative,
    /// The largest while it sticks; `mu_c` where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_c_static: Option<NonNegative>,
    /// Where the part lies at first.
    pub initial: SlowStart,
    /// The longest step of the integration, m.
    #[serde(default = "default_max_step")]
    pub max_step: Positive,
}

fn default_max_step() -> Positive {
    Positive::HALF_A_MILLI
}

/// A disk that goes along a path and does not turn.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SlowFinger {
    /// Radius of the disk, m.
    pub radius: Positive,
    /// Its centre, world axes, m; straight between.
    pub path: SlowPath,
}

/// Points of a path, at least one.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "Vec<[f64; 2]>", into = "Vec<[f64; 2]>")]
pub struct SlowPath(Vec<[f64; 2]>);

impl TryFrom<Vec<[f64; 2]>> for SlowPath {
    type Error = InvalidInput;

    fn try_from(points: Vec<[f64; 2]>) -> Result<Self, InvalidInput> {
        if points.is_empty() { Err(InvalidInput::new("is empty: give at least one point")) } else { Ok(Self(points)) }
    }
}

impl From<SlowPath> for Vec<[f64; 2]> {
    fn from(SlowPath(points): SlowPath) -> Self {
        points
    }
}

/// Where a slowly pushed part lies at first.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SlowStart {
    /// Of the polygon's own frame.
    pub pose: PoseFields,
}

/// Feet that a slowly pushed part stands on.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "SlowSupportFields", into = "SlowSupportFields")]
pub struct SlowSupport(SlowSupportFields);

/// The JSON form of [`SlowSupport`].
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct SlowSupportFields {
    /// `[x, y, share]` or `[x, y, share, mu of that foot]`: part frame, m; share of the weight. The shares sum to 1.
    feet: Vec<Vec<f64>>,
    /// Radius of the ring on which each foot stands, m.
    #[serde(default = "default_ring_radius")]
    ring_radius: NonNegative,
}

fn default_ring_radius() -> NonNegative {
    NonNegative::ONE_MILLI
}

impl TryFrom<SlowSupportFields> for SlowSupport {
    type Error = InvalidInput;

    fn try_from(fields: SlowSupportFields) -> Result<Self, InvalidInput> {
        let at = |index: usize| Pointer::from("feet").index(index);
        if fields.feet.is_empty() {
            return Err(InvalidInput::at("feet", "is empty: give at least one foot, or leave `support` out"));
        }
        for (index, foot) in fields.feet.iter().enumerate() {
            if !(3..=4).contains(&foot.len()) {
                let message = format!(
                    "has {} numbers, a foot has 3, `[x, y, share]`, or 4, `[x, y, share, mu of that foot]`",
                    foot.len()
                );
                return Err(InvalidInput::at(at(index), message));
            }
            if foot[2] < 0.0 {
                let message = format!("the share {:?} of the weight is negative: check its sign", foot[2]);
                return Err(InvalidInput::at(at(index).index(2), message));
            }
            if let Some(mu) = foot.get(3).filter(|mu| **mu < 0.0) {
                return Err(InvalidInput::at(at(index).index(3), format!("mu {mu:?} is negative: check its sign")));
            }
        }
        let sum: f64 = fields.feet.iter().map(|foot| foot[2]).sum();
        check_shares_sum(sum)?;
        Ok(Self(fields))
    }
}

impl From<SlowSupport> for SlowSupportFields {
    fn from(SlowSupport(fields): SlowSupport) -> Self {
        fields
    }
}

/// How a slow push went.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct QuasiStaticAnswer {
    /// The part at each point of the path, up to the end, in the motion that arrives there; at the first, that begins.
    pub samples: Vec<QuasiStaticSample>,
    /// What ended the run.
    pub end: QuasiStaticEnd,
}

/// A slowly pushed part where the finger passes a point of its path; the contact's fields are null where it is free.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct QuasiStaticSample {
    /// Of the polygon's own frame.
    pub pose: PoseFields,
    /// The touched point, world, m.
    pub contact: Option<[f64; 2]>,
    /// Direction of the part's outward normal there, rad.
    pub normal_angle: Option<f64>,
    /// The edge that is touched, ends included.
    pub edge: Option<usize>,
    /// The vertex that is touched between its edges' normals.
    pub vertex: Option<usize>,
    /// What the contact does.
    pub mode: QuasiStaticMode,
    /// On the part per unit mass, m/s².
    pub force: Option<[f64; 2]>,
}

/// What the contact of a slow push does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum QuasiStaticMode {
    /// The finger does not touch, or does not push.
    Free,
    /// No slip.
    Sticking,
    /// Slip.
    Sliding,
}

/// The end of a slow push.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct QuasiStaticEnd {
    /// Why the run ended.
    pub reason: QuasiStaticEndReason,
    /// How far the finger has gone, m.
    pub length: f64,
}

/// Why a slow push ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum QuasiStaticEndReason {
    /// The last point of the path.
    Path,
    /// The disk meets a second point of the outline.
    SecondContact,
    /// The supports cannot hold the part.
    Tip,
}

impl QuasiStaticPush {
    /// Follows the push.
    ///
    /// # Errors
    /// [`SolveError`]: of the input, of the simulation, or because it was asked to stop.
    pub fn solve_until(&self, stop: Stop<'_>) -> Result<QuasiStaticAnswer, SolveError> {
        let push = self.push()?;
        let run = push.run(stop).map_err(|error| match error {
            SlowPushError::Stopped { .. } => SolveError::Stopped,
            SlowPushError::Overlap { .. } => {
                InvalidInput::at(Pointer::from("finger").key("path").index(0), error.to_string()).into()
            }
            SlowPushError::NoFriction => {
                let field = if self.g.get() == 0.0 { "g" } else { "mu" };
                InvalidInput::at(field, error.to_string()).into()
            }
            SlowPushError::FeetOnALine => {
                InvalidInput::at(Pointer::from("support").key("feet"), error.to_string()).into()
            }
            _ => SolveError::Internal(error.to_string()),
        })?;
        Ok(run.into())
    }

    /// The push as the science has it.
    ///
    /// # Errors
    /// [`InvalidInput`] where fields contradict each other.
    pub fn push(&self) -> Result<SlowPush, InvalidInput> {
        let path: Vec<Point2<f64>> = self.finger.path.0.iter().map(|&point| point.into()).collect();
        self.check_path(&path)?;
        let sticking = self.mu_c_static.unwrap_or(self.mu_c).get();
        if sticking < self.mu_c.get() {
            let message = format!(
                "{sticking:?} is less than `mu_c`, {:?}: what sticks holds no less than what slides; check both",
                self.mu_c.get()
            );
            return Err(InvalidInput::at("mu_c_static", message));
        }
        let mu = self.mu.get();
        let support = match &self.support {
            None => slow::Support::Uniform { friction: mu },
            Some(SlowSupport(fields)) => {
                let foot = |foot: &Vec<f64>| slow::Foot {
                    at: Point2::new(foot[0], foot[1]),
                    share: foot[2],
                    friction: foot.get(3).copied().unwrap_or(mu),
                };
                slow::Support::Feet {
                    feet: fields.feet.iter().map(foot).collect(),
                    ring_radius: fields.ring_radius.get(),
                }
            }
        };
        let PoseFields { x, y, theta } = self.initial.pose;
        Ok(SlowPush {
            outline: (*self.polygon).clone(),
            support,
            centre_of_mass: self.centre_of_mass.map(Point2::from),
            gravity: self.g.get(),
            height: self.height.get(),
            radius: self.finger.radius.get(),
            contact_friction: [self.mu_c.get(), sticking],
            path,
            pose: Pose { x, y, theta },
            step_max: self.max_step.get(),
        })
    }

    fn check_path(&self, path: &[Point2<f64>]) -> Result<(), InvalidInput> {
        let length: f64 = path.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        let sizes = length / size(&self.polygon);
        // Written so that NaN is refused.
        let is_short = sizes <= PATH_MAX;
        if !is_short {
            let message = format!(
                "is {sizes:.0} sizes of the part long, the limit is {PATH_MAX}: check its unit, or push in several problems"
            );
            return Err(InvalidInput::at(Pointer::from("finger").key("path"), message));
        }
        let steps = length / self.max_step.get();
        let are_few = steps <= STEPS_MAX;
        if !are_few {
            let message = format!(
                "steps of {:?} m are {steps:.0} on a path of {length:?} m, the limit is {STEPS_MAX:e}: take longer ones",
                self.max_step.get()
            );
            return Err(InvalidInput::at("max_step", message));
        }
        Ok(())
    }
}

impl From<SlowRun> for QuasiStaticAnswer {
    fn from(run: SlowRun) -> Self {
        let reason = match run.end {
            SlowEnd::Path => QuasiStaticEndReason::Path,
            SlowEnd::SecondContact => QuasiStaticEndReason::SecondContact,
            SlowEnd::Tip => QuasiStaticEndReason::Tip,
        };
        let samples = run.samples.iter().map(QuasiStaticSample::from).collect();
        Self { samples, end: QuasiStaticEnd { reason, length: run.length } }
    }
}

impl From<&SlowSample> for QuasiStaticSample {
    fn from(sample: &SlowSample) -> Self {
        let Pose { x, y, theta } = sample.pose;
        let contact = sample.contact.as_ref();
        let element = contact.map(|contact| contact.element);
        let mode = match contact.map(|contact| contact.mode) {
            None => QuasiStaticMode::Free,
            Some(SlowMode::Sticking) => QuasiStaticMode::Sticking,
            Some(SlowMode::Sliding) => QuasiStaticMode::Sliding,
        };
        Self {
            pose: PoseFields { x, y, theta },
            contact: contact.map(|contact| contact.at.into()),
            normal_angle: contact.map(|contact| contact.normal_angle),
            edge: element.and_then(|element| if let slow::Element::Edge(edge) = element { Some(edge) } else { None }),
            vertex: element
                .and_then(|element| if let slow::Element::Vertex(vertex) = element { Some(vertex) } else { None }),
            mode,
            force: contact.map(|contact| <[f64; 2]>::from(contact.force)),
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::solve::read;

    /// A block pushed up at its lower edge.
    fn problem() -> Value {
        json!({
            "mode": "quasi_static", "polygon": [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]], "mu": 0.3,
            "mu_c": 0.2, "finger": {"radius": 0.004, "path": [[0, -0.026], [0, -0.02]]}, "initial": {"pose": [0, 0, 0]},
        })
    }

    fn changed(changes: &Value) -> Value {
        let mut problem = problem();
        for (key, value) in changes.as_object().unwrap() {
            problem[key] = value.clone();
        }
        problem
    }

    fn answer(problem: Value) -> Value {
        serde_json::to_value(read::<AnyPush>(problem).unwrap().solve().unwrap()).unwrap()
    }

    #[test]
    fn a_free_sample_is_null_but_for_its_pose() {
        let run = answer(problem());
        let free = json!({
            "pose": [0.0, 0.0, 0.0], "contact": null, "normal_angle": null, "edge": null, "vertex": null,
            "mode": "free", "force": null,
        });
        assert_eq!(run["samples"][0], free);
        assert_eq!((&run["samples"][1]["mode"], &run["samples"][1]["edge"]), (&json!("sticking"), &json!(0)));
        assert_eq!(run["end"]["reason"], "path");
    }

    #[test]
    fn what_cannot_be_is_refused_at_its_field() {
        let feet = |feet: Value| json!({"support": {"feet": feet}});
        let cases = [
            (json!({"mu": 0}), "/mu", "nothing resists"),
            (json!({"mode": "quasistatic"}), "/mode", "did you mean `quasi_static`"),
            (json!({"g": 0}), "/g", "nothing resists"),
            (json!({"mu_c_static": 0.1}), "/mu_c_static", "less than `mu_c`"),
            (json!({"height": -0.01}), "/height", "out of range"),
            (json!({"max_step": 0}), "/max_step", "out of range"),
            (json!({"max_step": 1e-12}), "/max_step", "take longer ones"),
            (json!({"finger": {"radius": 0, "path": [[0, 0]]}}), "/finger/radius", "out of range"),
            (json!({"finger": {"radius": 0.01, "path": []}}), "/finger/path", "is empty"),
            (json!({"finger": {"radius": 0.01, "path": [[0, -0.025]]}}), "/finger/path/0", "overlaps"),
            (json!({"finger": {"radius": 0.01, "path": [[0, -0.1], [0, -1e5]]}}), "/finger/path", "sizes of the part"),
            (json!({"edge": 0}), "/edge", "edge"),
            (json!({"inertia_per_mass": 1e-4}), "/inertia_per_mass", "inertia_per_mass"),
            (feet(json!([])), "/support/feet", "is empty"),
            (feet(json!([[0, 0]])), "/support/feet/0", "has 2 numbers"),
            (feet(json!([[0, 0, 2], [0, 0.01, -1]])), "/support/feet/1/2", "negative"),
            (feet(json!([[0, 0, 1, -0.1]])), "/support/feet/0/3", "negative"),
            (feet(json!([[0, 0, 0.5]])), "/support/feet", "must sum to 1"),
            (
                json!({"height": 0.01, "support": {"feet": [[0, 0, 0.5], [0.01, 0.01, 0.5]]}}),
                "/support/feet",
                "on one line",
            ),
        ];
        for (changes, place, message) in cases {
            let solved = read::<AnyPush>(changed(&changes)).map_err(SolveError::from).and_then(|push| push.solve());
            let SolveError::InvalidInput(error) = solved.unwrap_err() else { panic!("{changes}") };
            let told = error.to_string();
            assert!(told.contains(&format!("{place:?}")) && told.contains(message), "{changes}: {told}");
        }
    }

    #[test]
    fn a_push_in_time_is_read_as_before() {
        let missing = read::<AnyPush>(json!({"mode": "rolling"})).unwrap_err().to_string();
        assert!(!missing.contains("path"), "{missing}");
    }

    #[test]
    fn a_problem_is_written_as_it_is_read() {
        let mut own = problem();
        own.as_object_mut().unwrap().remove("mode");
        let written = serde_json::to_value(read::<QuasiStaticPush>(own).unwrap()).unwrap();
        let again = read::<QuasiStaticPush>(written).unwrap();
        assert_eq!(serde_json::to_value(again.solve_until(&never).unwrap()).unwrap(), answer(problem()));
    }
}
