//! The kind `observe_roll`: pose and motion of a rolling body from the path of its contact. See
//! [`palpate::rolling::observer`].

use nalgebra::Vector2;
use palpate::rolling::{
    self, BodyKnowledge, Noise as ReadingNoise, ObserveError, PalmKnowledge, RollEstimate, RollHypothesis,
    RollQuestion, RollVerdict,
};
use palpate::{Searched, Stop, never};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::roll::{
    BodyFields, EggFields, HarmonicFields, PalmFields, Piecewise, RoundedFields, Spin, palm_acceleration, wxyz,
};
use crate::solve::fields::{NonNegative, Positive, default_gravity};
use crate::solve::read::word_or;
use crate::solve::{InvalidInput, Pointer, Problem, SolveError};

/// Semi-axes of an unknown ellipsoid where a problem does not say, m.
const SEMI_AXES_RANGE: [f64; 2] = [0.005, 0.2];

/// The path of a contact on a palm.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObserveRoll {
    /// The body; an ellipsoid may be unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<ObservedBody>,
    /// Instead of `body`: what it may be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bodies: Option<Vec<BodyFields>>,
    /// Lowest and highest semi-axis of an unknown ellipsoid, m; `[0.005, 0.2]` where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub semi_axes_range: Option<[Positive; 2]>,
    /// Whether the contact lets the body spin about the normal.
    pub spin: SpinKnowledge,
    /// Gravity, m/s², against the palm's normal.
    #[serde(default = "default_gravity")]
    pub g: NonNegative,
    /// Of the palm; null for a palm at rest or at constant velocity.
    #[serde(deserialize_with = "Option::deserialize")]
    pub palm_acceleration: Option<ObservedAcceleration>,
    /// Time from each contact to the next, s.
    pub dt: Positive,
    /// Contacts on the palm at 0, dt, 2 dt, …, m.
    pub u: Vec<[f64; 2]>,
    /// How the contacts err; null for not at all.
    #[serde(deserialize_with = "Option::deserialize")]
    pub noise: Option<NoiseFields>,
}

/// A body, of which an ellipsoid's semi-axes may be unknown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObservedBody {
    /// Semi-axes, m, or `"unknown"`.
    Ellipsoid(SemiAxes),
    /// An ellipsoid whose ends along z differ.
    Egg(EggFields),
    /// A body with nearly flat faces.
    Rounded(RoundedFields),
}

/// Semi-axes, m, if they are known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SemiAxes {
    /// They are.
    Known([Positive; 3]),
    /// They are not.
    Unknown,
}

/// The word for a part of the model that is to be found.
/// Longest time between contacts, s: a body that rolls turns by a radian in it, and nobody follows that.
const DT_MAX: f64 = 0.1;

const UNKNOWN: &str = "unknown";

impl<'de> Deserialize<'de> for SemiAxes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match word_or(deserializer)? {
            Ok(word) if word == UNKNOWN => Ok(Self::Unknown),
            Ok(other) => Err(D::Error::custom(format!("got \"{other}\", expected [a, b, c] in m or \"{UNKNOWN}\""))),
            Err(axes) => Ok(Self::Known(axes)),
        }
    }
}

impl Serialize for SemiAxes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Known(axes) => axes.serialize(serializer),
            Self::Unknown => UNKNOWN.serialize(serializer),
        }
    }
}

impl JsonSchema for SemiAxes {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "SemiAxes".into()
    }

    fn json_schema(_generator: &mut SchemaGenerator) -> Schema {
        json_schema!({"anyOf": [
            {"type": "array", "items": {"type": "number", "exclusiveMinimum": 0}, "minItems": 3, "maxItems": 3},
            {"const": UNKNOWN},
        ]})
    }
}

/// Whether the contact lets the body spin, if that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SpinKnowledge {
    /// It does.
    Free,
    /// It does not.
    #[serde(rename = "none")]
    NoSpin,
    /// To be found.
    Unknown,
}

/// The acceleration of a palm, as far as it is known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObservedAcceleration {
    /// Constant, to be found: with `g` it stands for an unknown tilt.
    UnknownConstant,
    /// Always the same.
    Constant([f64; 3]),
    /// Σ amplitude·sin(2π·frequency_hz·t + phase).
    Harmonic(Vec<HarmonicFields>),
    /// Constant from each instant to the next.
    Piecewise(Piecewise),
}

/// How contacts err.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Noise")]
pub enum NoiseFields {
    /// Normal errors of this standard deviation, m.
    Gauss(Positive),
    /// Each coordinate is rounded to the nearest multiple of this pitch, m.
    Grid(Positive),
}

/// What explains the contacts.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ObserveRollAnswer {
    /// How many hypotheses explain them.
    pub status: ObserveRollStatus,
    /// Best first, one per class of the body's symmetry.
    pub hypotheses: Vec<RollHypothesisAnswer>,
    /// Of the best hypothesis's body; of the body itself where nothing fits and there is only one.
    pub symmetry: Option<SymmetryFields>,
    /// What the status rests on.
    pub certificate: Certificate,
}

/// How many hypotheses explain the contacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Status")]
pub enum ObserveRollStatus {
    /// One.
    Unique,
    /// Several.
    Ambiguous,
    /// None.
    #[serde(rename = "none")]
    Unexplained,
}

/// A motion that explains the contacts.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "RollHypothesis")]
pub struct RollHypothesisAnswer {
    /// `[w, x, y, z]` at the first contact, body → palm.
    pub orientation0: [f64; 4],
    /// Angular velocity at the first contact, body axes, rad/s.
    pub omega0: [f64; 3],
    /// At the last contact.
    pub orientation_end: [f64; 4],
    /// Angular velocity at the last contact, body axes, rad/s.
    pub omega_end: [f64; 3],
    /// Sum of squared residuals over their variances.
    pub cost: f64,
    /// At the end: turn about body axes (rad), angular velocity in body axes (rad/s), then semi-axes (m) and the palm's
    /// acceleration (m/s²) where they were unknown. Null where a continuum fits.
    pub covariance: Option<Vec<Vec<f64>>>,
    /// Whether a continuum of states explains the contacts as well, beside what symmetry hides.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub unobservable: bool,
    /// Of an unknown ellipsoid, m, in the order of the body axes that the orientations refer to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub semi_axes: Option<[f64; 3]>,
    /// Place of the body in `bodies`, from 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body_index: Option<usize>,
    /// Where it was unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spin: Option<Spin>,
    /// Where it was unknown, m/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub palm_acceleration: Option<[f64; 3]>,
}

/// The groups by name, as the interface has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum SymmetryName {
    /// No symmetry.
    C1,
    /// One axis of half turns.
    C2,
    /// Three axes of half turns.
    D2,
    /// One axis of quarter turns, four of half turns.
    D4,
    /// The turns of a cube.
    O,
    /// A body of revolution.
    #[serde(rename = "revolution")]
    Revolution,
    /// A sphere.
    #[serde(rename = "sphere")]
    Sphere,
}

impl From<rolling::SymmetryName> for SymmetryName {
    fn from(name: rolling::SymmetryName) -> Self {
        match name {
            rolling::SymmetryName::C1 => Self::C1,
            rolling::SymmetryName::C2 => Self::C2,
            rolling::SymmetryName::D2 => Self::D2,
            rolling::SymmetryName::D4 => Self::D4,
            rolling::SymmetryName::O => Self::O,
            rolling::SymmetryName::Revolution => Self::Revolution,
            rolling::SymmetryName::Sphere => Self::Sphere,
        }
    }
}

/// The turns that leave a body as it is, in shape and inertia.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
pub struct SymmetryFields {
    /// Name of the group of turns.
    pub name: SymmetryName,
    /// How many turns; null for a continuum.
    pub order: Option<usize>,
}

/// What a status rests on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Certificate {
    /// Numbers read less numbers fitted.
    pub degrees_of_freedom: usize,
    /// The best cost found; null where the search found nothing.
    pub cost: Option<f64>,
    /// The cost up to which it counts as explained: 99.9 % of chi-square.
    pub cost_max: f64,
    /// Whether the estimate is unique and its attitude known, to 2° from the first contact to the last, with
    /// 3.5 standard deviations of the Cramér–Rao bound.
    pub certified: bool,
    /// What the search covered, at its widest.
    pub coverage: CoverageFields,
}

/// Where a search looked.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "Coverage")]
pub struct CoverageFields {
    /// Attitudes tried, over all bodies and modulo their symmetries.
    pub attitudes: usize,
    /// Radius of the cell of each, rad.
    pub cell: f64,
    /// Attitudes and spins from which the acceleration of the contact can be had within a cell.
    pub within_reach: usize,
    /// Different descents followed from these.
    pub followed: usize,
    /// Those that could not be excluded and were not followed, because there are too many: 0 where the search is complete.
    pub left_out: usize,
}

impl From<rolling::Coverage> for CoverageFields {
    fn from(coverage: rolling::Coverage) -> Self {
        let rolling::Coverage { attitudes, cell, within_reach, followed, left_out } = coverage;
        Self { attitudes, cell, within_reach, followed, left_out }
    }
}

impl Problem for ObserveRoll {
    const KIND: &'static str = "observe_roll";
    type Answer = ObserveRollAnswer;

    fn solve(&self) -> Result<ObserveRollAnswer, SolveError> {
        Ok(self.solve_until(&never)?.found)
    }

    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<ObserveRollAnswer>, SolveError> {
        if self.dt.get() > DT_MAX {
            return Err(InvalidInput::out_of_range(
                self.dt.get(),
                &format!("≤ {DT_MAX}"),
                "give seconds, or more contacts",
            )
            .inside("dt")
            .into());
        }
        let question = self.question()?;
        let u: Vec<Vector2<f64>> = self.u.iter().copied().map(Vector2::from).collect();
        let searched = question.answer_until(self.dt.get(), &u, stop).map_err(refuse)?;
        let Searched { found: estimate, complete } = searched;
        if !complete && estimate.hypotheses.is_empty() {
            return Err(SolveError::Stopped);
        }
        let answer = self.answer(&question, &estimate);
        Ok(Searched { found: answer, complete: estimate.complete })
    }
}

fn refuse(error: ObserveError) -> InvalidInput {
    let field = match error {
        ObserveError::NoGravity => "g",
        ObserveError::AxisRange { .. } => "semi_axes_range",
        _ => "u",
    };
    InvalidInput::at(field, error.to_string())
}

impl ObserveRoll {
    fn question(&self) -> Result<RollQuestion, InvalidInput> {
        Ok(RollQuestion {
            body: self.body()?,
            spins: match self.spin {
                SpinKnowledge::Free => vec![rolling::Spin::Free],
                SpinKnowledge::NoSpin => vec![rolling::Spin::NoSpin],
                SpinKnowledge::Unknown => vec![rolling::Spin::Free, rolling::Spin::NoSpin],
            },
            palm: self.palm(),
            g: self.g.get(),
            noise: match self.noise {
                None => ReadingNoise::Exact,
                Some(NoiseFields::Gauss(sigma)) => ReadingNoise::Gauss(sigma.get()),
                Some(NoiseFields::Grid(pitch)) => ReadingNoise::Grid(pitch.get()),
            },
        })
    }

    fn body(&self) -> Result<BodyKnowledge, InvalidInput> {
        let one = |body: BodyFields| {
            let built = body.build().map_err(|error| error.inside("body"));
            built.map(|body| BodyKnowledge::OneOf(vec![body]))
        };
        let known = match (&self.body, &self.bodies) {
            (None, None) => return Err(InvalidInput::missing("body", "give the body, or `bodies` that it may be")),
            (Some(_), Some(_)) => return Err(InvalidInput::exclusive("body", "bodies")),
            (Some(ObservedBody::Ellipsoid(SemiAxes::Unknown)), None) => return self.ellipsoid(),
            (Some(ObservedBody::Ellipsoid(SemiAxes::Known(axes))), None) => one(BodyFields::Ellipsoid(*axes))?,
            (Some(ObservedBody::Egg(egg)), None) => one(BodyFields::Egg(egg.clone()))?,
            (Some(ObservedBody::Rounded(rounded)), None) => one(BodyFields::Rounded(rounded.clone()))?,
            (None, Some(bodies)) => several(bodies)?,
        };
        match self.semi_axes_range {
            Some(_) => {
                let why = "is for `body` {\"ellipsoid\": \"unknown\"} only: leave it out";
                Err(InvalidInput::at("semi_axes_range", why))
            }
            None => Ok(known),
        }
    }

    fn ellipsoid(&self) -> Result<BodyKnowledge, InvalidInput> {
        let range = self.semi_axes_range.map_or(SEMI_AXES_RANGE, |range| range.map(Positive::get));
        if range[0] < range[1] {
            return Ok(BodyKnowledge::Ellipsoid { range: range[0]..=range[1] });
        }
        let message = format!("{:?} m is not below {:?} m: give the lowest, then the highest", range[0], range[1]);
        Err(InvalidInput::at("semi_axes_range", message))
    }

    fn palm(&self) -> PalmKnowledge {
        let known = |field: PalmFields| PalmKnowledge::Known(palm_acceleration(Some(&field)));
        match &self.palm_acceleration {
            None => PalmKnowledge::Known(palm_acceleration(None)),
            Some(ObservedAcceleration::UnknownConstant) => PalmKnowledge::Constant,
            Some(ObservedAcceleration::Constant(a)) => known(PalmFields::Constant(*a)),
            Some(ObservedAcceleration::Harmonic(harmonics)) => known(PalmFields::Harmonic(harmonics.clone())),
            Some(ObservedAcceleration::Piecewise(pieces)) => known(PalmFields::Piecewise(pieces.clone())),
        }
    }

    fn answer(&self, question: &RollQuestion, estimate: &RollEstimate) -> ObserveRollAnswer {
        let only = match &question.body {
            BodyKnowledge::OneOf(bodies) if bodies.len() == 1 => Some(bodies[0].symmetry()),
            _ => None,
        };
        let symmetry = estimate.hypotheses.first().map(|best| best.symmetry).or(only);
        ObserveRollAnswer {
            status: match estimate.verdict {
                RollVerdict::Unique => ObserveRollStatus::Unique,
                RollVerdict::Ambiguous => ObserveRollStatus::Ambiguous,
                RollVerdict::Unexplained => ObserveRollStatus::Unexplained,
            },
            hypotheses: estimate.hypotheses.iter().map(|hypothesis| self.hypothesis(hypothesis)).collect(),
            symmetry: symmetry.map(|group| SymmetryFields { name: group.kind().into(), order: group.order() }),
            certificate: Certificate {
                degrees_of_freedom: estimate.degrees_of_freedom,
                cost: Some(estimate.cost).filter(|cost| cost.is_finite()),
                cost_max: estimate.cost_max,
                certified: estimate.certified,
                coverage: estimate.coverage.into(),
            },
        }
    }

    fn hypothesis(&self, hypothesis: &RollHypothesis) -> RollHypothesisAnswer {
        let rows = |matrix: &nalgebra::DMatrix<f64>| {
            matrix.row_iter().map(|row| row.iter().copied().collect()).collect::<Vec<Vec<f64>>>()
        };
        RollHypothesisAnswer {
            orientation0: upright(&hypothesis.start.orientation),
            omega0: hypothesis.start.omega.into(),
            orientation_end: upright(&hypothesis.end.orientation),
            omega_end: hypothesis.end.omega.into(),
            cost: hypothesis.cost,
            covariance: hypothesis.covariance.as_ref().map(rows),
            unobservable: hypothesis.unobservable,
            semi_axes: hypothesis.semi_axes,
            body_index: self.bodies.is_some().then_some(hypothesis.body),
            spin: (self.spin == SpinKnowledge::Unknown).then_some(hypothesis.spin.into()),
            palm_acceleration: hypothesis.palm_acceleration.map(Into::into),
        }
    }
}

/// `[w, x, y, z]` with w ≥ 0: of the two quaternions of one attitude always the same.
fn upright(q: &nalgebra::Quaternion<f64>) -> [f64; 4] {
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    wxyz(q).map(|component| component * sign)
}

fn several(bodies: &[BodyFields]) -> Result<BodyKnowledge, InvalidInput> {
    if bodies.is_empty() {
        return Err(InvalidInput::at("bodies", "is empty: give at least one body"));
    }
    let build = |(index, body): (usize, &BodyFields)| {
        body.build().map_err(|error| error.below(Pointer::from("bodies").index(index)))
    };
    Ok(BodyKnowledge::OneOf(bodies.iter().enumerate().map(build).collect::<Result<_, _>>()?))
}
