//! The kind `push`: forward simulation of a part that a finger pushes. See [`palpate::pushing::dynamics`].

use nalgebra::Point2;
use palpate::pushing::dynamics::{
    ContactForce, ContactLaw, ContactMode, EdgeEnd, EndReason, Part, Push as Simulation, PushError, PushModel, PushRun,
    PushRunError, Sample, SecondContact, Slip, Start, State,
};
use palpate::{Searched, Stop, never};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::pushed::Pushed;
use crate::solve::fields::{PoseFields, Times};
use crate::solve::{InvalidInput, Pointer, Problem, SolveError};

/// A part pushed at one of its edges by a disk that only translates.
pub type Push = Pushed<PushFields>;

/// A part pushed at one of its edges by a disk that only translates.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Push")]
pub struct PushFields {
    /// The edge in contact, from vertex `edge` to the next.
    pub edge: usize,
    /// State at t = 0.
    pub initial: PushStartFields,
    /// When to sample, s. The run ends at the last, if nothing ends it before.
    pub times: Times,
    /// Whether the run ends where the contact reaches a vertex; otherwise the edge's line goes on.
    #[serde(default = "default_stop_at_edge_end")]
    pub stop_at_edge_end: bool,
}

fn default_stop_at_edge_end() -> bool {
    true
}

/// What happens at the contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// No contact friction.
    Frictionless,
    /// No slip.
    Rolling,
    /// Slip in one direction.
    Sliding,
    /// Rolling and sliding by Coulomb's law.
    Coulomb,
}

/// State at t = 0: in motion (`omega`, `vT`), or at rest (`at_rest`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Initial")]
pub struct PushStartFields {
    /// Polar angle of the contact seen from the disk's centre, rad.
    pub u: f64,
    /// Contact along the edge, from the foot of the perpendicular through the centre of mass, m.
    pub s: f64,
    /// Angular velocity of the part, rad/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub omega: Option<f64>,
    /// Velocity of the part's centre of mass along T = (−sin u, cos u), m/s; not for `rolling`.
    #[serde(default, rename = "vT", skip_serializing_if = "Option::is_none")]
    pub v_t: Option<f64>,
    /// `sliding` only: the sign of the contact velocity (part − finger) along the edge.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sliding_sign: Option<f64>,
    /// Part and finger at rest, the finger accelerating into the part.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub at_rest: bool,
}

/// Where a part's weight rests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "SupportFields", into = "SupportFields")]
pub struct Support {
    feet: Vec<[f64; 3]>,
}

/// The JSON form of [`Support`].
#[derive(Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct SupportFields {
    /// `[x, y, share]`: part frame, m; share of the weight. The shares sum to 1.
    feet: Vec<[f64; 3]>,
}

/// How far the shares of the feet may be from adding up to 1: shares rounded to four decimals pass for a dozen feet.
const SHARES_SUM_TOLERANCE: f64 = 1e-3;

/// Whether shares of the weight add up to all of it; the field is `feet`.
pub(super) fn check_shares_sum(sum: f64) -> Result<(), InvalidInput> {
    if (sum - 1.0).abs() <= SHARES_SUM_TOLERANCE {
        return Ok(());
    }
    let message = format!("the shares of the weight sum to {sum:?}, they must sum to 1: divide each by the sum");
    Err(InvalidInput::at("feet", message))
}

impl TryFrom<SupportFields> for Support {
    type Error = InvalidInput;

    fn try_from(SupportFields { feet }: SupportFields) -> Result<Self, InvalidInput> {
        let at = |index: usize| Pointer::from("feet").index(index);
        if feet.is_empty() {
            return Err(InvalidInput::at("feet", "is empty: give at least one foot, or leave `support` out"));
        }
        if let Some(index) = feet.iter().position(|[_, _, share]| *share < 0.0) {
            let message = format!("the share {:?} of the weight is negative: check its sign", feet[index][2]);
            return Err(InvalidInput::at(at(index).index(2), message));
        }
        let sum: f64 = feet.iter().map(|[_, _, share]| share).sum();
        check_shares_sum(sum)?;
        Ok(Self { feet })
    }
}

impl From<Support> for SupportFields {
    fn from(Support { feet }: Support) -> Self {
        Self { feet }
    }
}

impl Support {
    /// Places in the part's frame, m, and shares of the weight.
    #[must_use]
    pub fn feet(&self) -> Vec<(Point2<f64>, f64)> {
        self.feet.iter().map(|&[x, y, share]| (Point2::new(x, y), share)).collect()
    }
}

/// How a push went.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct PushAnswer {
    /// The part at each time asked for, up to the end.
    pub samples: Vec<PushSample>,
    /// What ended the run.
    pub end: PushEnd,
    /// The part at the end.
    #[serde(rename = "final")]
    pub last: PushSample,
    /// How the part begins to move; for a start `at_rest`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_acceleration: Option<InitialAcceleration>,
    /// When the finger first reached another edge of a part that is not convex: what follows leaves that contact out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second_contact: Option<Meeting>,
    /// When rolling and sliding took turns; for `coulomb`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transitions: Option<Vec<Transition>>,
}

/// The finger reaches an edge that it does not push.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Meeting {
    /// Time since the push began, s.
    pub t: f64,
    /// The edge that it reaches: of those that make one straight side the first.
    pub edge: usize,
}

impl From<SecondContact> for Meeting {
    fn from(SecondContact { t, edge }: SecondContact) -> Self {
        Self { t, edge }
    }
}

/// A part at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct PushSample {
    /// Time since the push began, s.
    pub t: f64,
    /// The edge in contact: of those that make one straight side with the given one, that which holds `s`; null on an
    /// ellipse.
    pub edge: Option<usize>,
    /// Polar angle of the contact, rad, not wrapped.
    pub u: f64,
    /// Contact along the edge, m.
    pub s: f64,
    /// Angular velocity, rad/s.
    pub omega: f64,
    /// Velocity of the centre of mass along T, m/s.
    #[serde(rename = "vT")]
    pub v_t: f64,
    /// Of the polygon's own frame.
    pub pose: PoseFields,
    /// Of the centre of mass, world axes, m/s.
    pub velocity: [f64; 2],
    /// What the contact does.
    pub mode: Mode,
    /// −F·N per unit mass, m/s²; null where the contact jams.
    pub normal_force: Option<f64>,
    /// −F·T per unit mass, m/s²; null where the contact jams.
    pub tangential_force: Option<f64>,
}

/// The end of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct PushEnd {
    /// Why the run ended.
    pub reason: PushEndReasonAnswer,
    /// Time since the push began, s.
    pub t: f64,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Reason")]
pub enum PushEndReasonAnswer {
    /// The last time asked for.
    Time,
    /// The finger leaves the part.
    Break,
    /// Sliding stopped.
    Stick,
    /// Rolling needs more friction than there is.
    Slip,
    /// The edge's first vertex.
    EdgeLo,
    /// The edge's second vertex.
    EdgeHi,
    /// No contact force fits (Painlevé).
    Jam,
    /// The finger reached another edge; `palpate push` only, `palpate solve` notes it in `second_contact` and goes on.
    SecondContact,
}

/// Acceleration from rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct InitialAcceleration {
    /// Of the centre of mass, world axes, m/s².
    pub centroid: [f64; 2],
    /// Angular acceleration, rad/s².
    pub alpha: f64,
}

/// A change between rolling and sliding.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Transition {
    /// Time since the push began, s.
    pub t: f64,
    /// The mode from then on.
    pub to: Mode,
}

impl Problem for Push {
    const KIND: &'static str = "push";
    type Answer = PushAnswer;

    fn solve(&self) -> Result<PushAnswer, SolveError> {
        Ok(self.solve_until(&never)?.found)
    }

    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<PushAnswer>, SolveError> {
        let part = self.setup.part()?;
        let push = Simulation::new(self.model(&part)?, self.law()?, self.start()?, self.edge_end()).map_err(refuse)?;
        let run = push.run_until(&self.own.times, stop).map_err(|error| match error {
            PushRunError::Stopped { .. } => SolveError::Stopped,
            _ => SolveError::Internal(error.to_string()),
        })?;
        Ok(Searched { found: self.answer(&part, &run), complete: true })
    }
}

/// A start that is impossible, at the field to look at first.
fn refuse(error: PushError) -> InvalidInput {
    let field = match error {
        PushError::BeyondEdge { .. } => Pointer::from("initial").key("s"),
        PushError::Overlap { .. } => Pointer::from("finger").key("radius"),
        PushError::FingerMoves { .. } => Pointer::from("finger").key("velocity0"),
        PushError::MovesAway { .. } | PushError::ChangesOutOfOrder { .. } => {
            Pointer::from("finger").key("acceleration")
        }
        PushError::SlipAgainstSign { .. } => Pointer::from("initial").key("sliding_sign"),
    };
    InvalidInput::at(field, error.to_string())
}

impl Push {
    /// The push as the simulation has it, its start checked.
    pub(super) fn checked<'p>(&self, part: &'p Part) -> Result<(PushModel<'p>, Start), InvalidInput> {
        let (model, start) = (self.model(part)?, self.start()?);
        Simulation::new(model, self.law()?, start, self.edge_end()).map_err(refuse)?;
        Ok((model, start))
    }

    fn model<'p>(&self, part: &'p Part) -> Result<PushModel<'p>, InvalidInput> {
        let edge = part.edge(self.own.edge).map_err(|error| InvalidInput::at("edge", error.to_string()))?;
        Ok(PushModel { part, edge, mu_g: self.setup.mu_g(), finger: self.setup.disk() })
    }

    fn edge_end(&self) -> EdgeEnd {
        if self.own.stop_at_edge_end { EdgeEnd::Stop } else { EdgeEnd::Extend }
    }

    fn law(&self) -> Result<ContactLaw, InvalidInput> {
        let needed = || self.setup.needed_friction();
        match self.setup.mode {
            Mode::Frictionless => Ok(ContactLaw::Frictionless),
            Mode::Rolling => Ok(ContactLaw::Rolling { friction: self.setup.contact_friction() }),
            Mode::Sliding => Ok(ContactLaw::Sliding { friction: needed()?, slip: self.own.initial.slip()? }),
            Mode::Coulomb => Ok(ContactLaw::Coulomb { friction: needed()? }),
        }
    }

    fn start(&self) -> Result<Start, InvalidInput> {
        let PushStartFields { u, s, omega, v_t, sliding_sign, at_rest } = self.own.initial;
        let refuse = |key: &str, why: &str| Err(InvalidInput::at(Pointer::from("initial").key(key), why));
        if sliding_sign.is_some() && self.setup.mode != Mode::Sliding {
            return refuse("sliding_sign", "is for the mode `sliding` only: leave it out");
        }
        if at_rest {
            return match (omega, v_t) {
                (None, None) => Ok(Start::Rest { u, s }),
                (Some(_), _) => refuse("omega", "cannot be given with `at_rest`: leave one of them out"),
                (None, Some(_)) => refuse("vT", "cannot be given with `at_rest`: leave one of them out"),
            };
        }
        let missing = |key: &str, remedy: &str| InvalidInput::missing(Pointer::from("initial").key(key), remedy);
        let omega = omega.ok_or_else(|| missing("omega", "give the angular velocity, or `\"at_rest\": true`"))?;
        match (self.setup.mode, v_t) {
            (Mode::Rolling, None) => Ok(Start::Moving(State { u, s, omega, v_t: 0.0 })),
            (Mode::Rolling, Some(_)) => refuse("vT", "follows from `omega` in the mode `rolling`: leave it out"),
            (_, Some(v_t)) => Ok(Start::Moving(State { u, s, omega, v_t })),
            (_, None) => Err(missing("vT", "every mode but `rolling` needs it")),
        }
    }

    fn answer(&self, part: &Part, run: &PushRun) -> PushAnswer {
        let sample = |sample: &Sample| PushSample::of(sample, Some(part.edge_at(self.own.edge, sample.state.s)));
        let changes = || run.changes.iter().map(|change| Transition { t: change.t, to: change.to.into() }).collect();
        PushAnswer {
            samples: run.samples.iter().map(sample).collect(),
            end: PushEnd { reason: run.end.reason.into(), t: run.end.t },
            last: sample(&run.last),
            initial_acceleration: run.rest_start.filter(|_| self.own.initial.at_rest).map(|acceleration| {
                InitialAcceleration { centroid: acceleration.centre_of_mass.into(), alpha: acceleration.alpha }
            }),
            second_contact: run.second_contact.map(Meeting::from),
            transitions: (self.setup.mode == Mode::Coulomb).then(changes),
        }
    }
}

impl PushStartFields {
    fn slip(&self) -> Result<Slip, InvalidInput> {
        let place = || Pointer::from("initial").key("sliding_sign");
        match self.sliding_sign {
            Some(1.0) => Ok(Slip::Forward),
            Some(-1.0) => Ok(Slip::Backward),
            Some(other) => Err(InvalidInput::at(place(), format!("got {other:?}, it must be 1 or -1"))),
            None => Err(InvalidInput::missing(place(), "the mode `sliding` needs 1 or -1")),
        }
    }
}

impl From<ContactMode> for Mode {
    fn from(contact: ContactMode) -> Self {
        match contact {
            ContactMode::Frictionless => Self::Frictionless,
            ContactMode::Rolling => Self::Rolling,
            ContactMode::Sliding { .. } => Self::Sliding,
        }
    }
}

impl From<EndReason> for PushEndReasonAnswer {
    fn from(reason: EndReason) -> Self {
        match reason {
            EndReason::Time => Self::Time,
            EndReason::Break => Self::Break,
            EndReason::Stick => Self::Stick,
            EndReason::Slip => Self::Slip,
            EndReason::EdgeMin => Self::EdgeLo,
            EndReason::EdgeMax => Self::EdgeHi,
            EndReason::Jam => Self::Jam,
            EndReason::SecondContact => Self::SecondContact,
        }
    }
}

impl PushSample {
    /// A sample of a push at an edge; at none on an ellipse.
    #[must_use]
    pub fn of(sample: &Sample, edge: Option<usize>) -> Self {
        let State { u, s, omega, v_t } = sample.state;
        let force = |component: fn(ContactForce) -> f64| sample.force.map(component);
        Self {
            t: sample.t,
            edge,
            u,
            s,
            omega,
            v_t,
            pose: PoseFields { x: sample.position.x, y: sample.position.y, theta: sample.theta },
            velocity: sample.velocity.into(),
            mode: sample.contact.into(),
            normal_force: force(|force| force.normal),
            tangential_force: force(|force| force.tangential),
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::solve::read;

    /// A block pushed up at the middle of its lower edge.
    fn problem() -> Value {
        json!({
            "polygon": [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]], "edge": 0, "mu": 0.3,
            "mode": "rolling", "times": [0, 0.1],
            "finger": {"radius": 0.01, "centre0": [0, 0], "velocity0": [0, 0.05], "acceleration": [0, 0]},
            "initial": {"u": 1.6, "s": 0.002, "omega": 0.1},
        })
    }

    fn changed(changes: Value) -> Value {
        let mut problem = problem();
        for (key, value) in changes.as_object().unwrap() {
            problem[key] = value.clone();
        }
        problem
    }

    fn answer(problem: Value) -> Value {
        serde_json::to_value(read::<Push>(problem).unwrap().solve().unwrap()).unwrap()
    }

    fn refuse(problem: Value) -> String {
        let solved = read::<Push>(problem).map_err(SolveError::from).and_then(|push| push.solve());
        match solved.unwrap_err() {
            SolveError::InvalidInput(error) => error.to_string(),
            other => panic!("{other}"),
        }
    }

    #[test]
    fn every_impossible_start_has_a_message_of_its_own() {
        let moving = json!({"u": 1.6, "s": 0.002, "omega": 0.1, "vT": 0.0, "sliding_sign": -1});
        let finger = |velocity: [f64; 2], acceleration: [f64; 2]| json!({"radius": 0.01, "centre0": [0, 0], "velocity0": velocity, "acceleration": acceleration});
        let rest = json!({"u": 1.6, "s": 0.002, "at_rest": true});
        // A notch narrower than the disk.
        let notch = json!([
            [-0.03, -0.02],
            [-0.004, -0.02],
            [-0.004, 0.0],
            [0.004, 0.0],
            [0.004, -0.02],
            [0.03, -0.02],
            [0.03, 0.02],
            [-0.03, 0.02]
        ]);
        let cases = [
            (json!({"edge": 4}), "/edge", "4 is no edge of a polygon with 4"),
            (json!({"mu": -0.1}), "/mu", "-0.1 is out of range"),
            (json!({"mode": "sliding", "initial": moving}), "/mu_c", "is missing"),
            (json!({"initial": {"u": 1.6, "s": 0.031, "omega": 0.0}}), "/initial/s", "beyond the edge"),
            (
                json!({"polygon": notch, "edge": 2, "initial": {"u": 1.6, "s": 0.0, "omega": 0.0}}),
                "/finger/radius",
                "overlaps the part",
            ),
            (json!({"initial": rest}), "/finger/velocity0", "at rest its velocity must be 0"),
            (
                json!({"initial": rest, "finger": finger([0.0; 2], [0.0, -1.0])}),
                "/finger/acceleration",
                "accelerates away from the part",
            ),
            (
                json!({"mode": "sliding", "mu_c": 0.2, "initial": moving, "finger": finger([-0.02, 0.05], [0.0; 2])}),
                "/initial/sliding_sign",
                "against the sliding sign",
            ),
            (json!({"initial": moving}), "/initial/sliding_sign", "for the mode `sliding` only"),
            (json!({"initial": {"u": 1.6, "s": 0.0, "omega": 0.0, "vT": 0.0}}), "/initial/vT", "leave it out"),
            (json!({"initial": {"u": 1.6, "s": 0.0}}), "/initial/omega", "is missing"),
            (json!({"mode": "frictionless"}), "/initial/vT", "is missing"),
            (json!({"centre_of_mass": [0, 0]}), "/inertia_per_mass", "`centre_of_mass` needs it"),
            (json!({"inertia_per_mass": 1e-4}), "/centre_of_mass", "`inertia_per_mass` needs it"),
            (json!({"support": {"feet": []}}), "/support/feet", "is empty"),
            (json!({"support": {"feet": [[0, 0, 0.5]]}}), "/support/feet", "must sum to 1"),
            (json!({"support": {"feet": [[0, 0, 2], [0, 0, -1]]}}), "/support/feet/1/2", "is negative"),
            (json!({"colour": "red"}), "/colour", "colour"),
        ];
        for (changes, place, message) in cases {
            let told = refuse(changed(changes.clone()));
            assert!(told.contains(&format!("{place:?}")) && told.contains(message), "{changes}: {told}");
        }
    }

    #[test]
    fn samples_are_those_asked_for_up_to_the_end() {
        let run = answer(changed(json!({"times": [0.05, 0.1, 5.0]})));
        let times: Vec<_> =
            run["samples"].as_array().unwrap().iter().map(|sample| sample["t"].as_f64().unwrap()).collect();
        assert_eq!(times, [0.05, 0.1]);
        assert_eq!(run["end"]["reason"], "break");
        assert_eq!(run["final"]["t"], run["end"]["t"]);
        assert!(run.get("transitions").is_none() && run.get("initial_acceleration").is_none());
    }

    #[test]
    fn a_time_of_zero_alone_asks_for_the_forces_there() {
        let run = answer(changed(json!({"times": [0]})));
        assert_eq!(run["end"], json!({"reason": "time", "t": 0.0}));
        assert_eq!(run["samples"][0], run["final"]);
    }

    #[test]
    fn rolling_beyond_the_friction_cone_slips_at_once() {
        let run = answer(changed(json!({"mu_c": 0.0})));
        assert_eq!(run["end"], json!({"reason": "slip", "t": 0.0}));
    }

    #[test]
    fn a_jam_has_no_force() {
        let run = answer(changed(json!({
            "mode": "sliding", "mu_c": 5.0,
            "initial": {"u": 1.6, "s": 0.02, "omega": 0.1, "vT": -0.05, "sliding_sign": 1},
        })));
        assert_eq!(run["end"], json!({"reason": "jam", "t": 0.0}));
        assert_eq!(run["samples"][0]["normal_force"], Value::Null);
        assert_eq!(run["final"]["tangential_force"], Value::Null);
    }

    #[test]
    fn a_finger_that_slows_down_faster_than_the_part_breaks_contact_at_once() {
        let finger = json!({"radius": 0.01, "centre0": [0, 0], "velocity0": [0, 0.05], "acceleration": [0, -9.0]});
        let run = answer(changed(json!({"finger": finger})));
        assert_eq!(run["end"], json!({"reason": "break", "t": 0.0}));
    }

    #[test]
    fn a_problem_is_written_as_it_is_read() {
        let problem = changed(json!({"g": 9.81, "stop_at_edge_end": true, "support": {"feet": [[0.0, 0.01, 1.0]]}}));
        let written = serde_json::to_value(read::<Push>(problem.clone()).unwrap()).unwrap();
        assert_eq!(
            read::<Push>(written.clone()).unwrap().solve().unwrap().samples,
            read::<Push>(problem).unwrap().solve().unwrap().samples
        );
        assert_eq!(written["support"], json!({"feet": [[0.0, 0.01, 1.0]]}));
    }
}
