//! What a kind of problem is, and which kinds there are.
//!
//! To add a kind: write its problem and answer types, `impl Problem for` the first, and list it in
//! [`KINDS`]. Order, errors, threads and schema are the frame's.

use std::time::{Duration, Instant};

use palpate::{Searched, Stop};
use schemars::{JsonSchema, Schema};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use super::error::{ErrorCode, Failure, InvalidInput, Pointer, QUOTE_CHARS_MAX, SolveError, TIME_LIMIT, elide};
use super::fields::NonNegative;
use super::line::{ID, PROBLEM};
use super::read::Fields;
use super::text::{self, Json};
use super::{finite, kinds, schema, spelling};

/// The kinds that `palpate solve` answers.
pub const KINDS: Registry = Registry::new(&[
    Kind::of::<kinds::support_friction::SupportFrictionProblem>(),
    Kind::of::<kinds::quasi_static::AnyPush>(),
    Kind::of::<kinds::observe_push::ObservePush>(),
    Kind::of::<kinds::observe_force::ObserveForce>(),
    Kind::of::<kinds::roll::Roll>(),
    Kind::of::<kinds::observability::Observability>(),
    Kind::of::<kinds::initial_pose::InitialPose>(),
    Kind::of::<kinds::inscription::Inscription>(),
    Kind::of::<kinds::observe_roll::ObserveRoll>(),
    Kind::of::<kinds::point_sampling::PointSampling>(),
    Kind::of::<kinds::corner_poses::CornerPoses>(),
]);

/// One kind of problem.
///
/// The type holds the fields beside `problem` and `id`, checked one by one as they are read (see
/// [`fields`](super::fields)); derive `Deserialize` with `#[serde(deny_unknown_fields)]`. What several fields must fulfil
/// together is for [`Problem::solve`] to refuse.
///
/// ```
/// use palpate_files::solve::fields::Polygon;
/// use palpate_files::solve::{Problem, SolveError};
/// use schemars::JsonSchema;
/// use serde::{Deserialize, Serialize};
///
/// /// How large a part is.
/// #[derive(Deserialize, JsonSchema)]
/// #[serde(deny_unknown_fields)]
/// struct Size {
///     polygon: Polygon,
/// }
///
/// #[derive(Serialize, JsonSchema)]
/// struct SizeAnswer {
///     /// m².
///     area: f64,
/// }
///
/// impl Problem for Size {
///     const KIND: &'static str = "size";
///     type Answer = SizeAnswer;
///
///     fn solve(&self) -> Result<SizeAnswer, SolveError> {
///         Ok(SizeAnswer { area: self.polygon.area() })
///     }
/// }
///
/// let block: Size = serde_json::from_str(r#"{"polygon": [[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]]}"#)?;
/// assert!((block.solve()?.area - 0.0024).abs() < 1e-15);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Problem: DeserializeOwned + JsonSchema {
    /// The name in the field `problem`.
    const KIND: &'static str;

    /// How long to work on a problem where nobody says, s: as long as it takes, unless the interface says otherwise.
    const TIME_LIMIT_S: Option<f64> = None;

    /// The fields of a good result, beside `id` and `problem`: a struct.
    type Answer: Serialize + JsonSchema;

    /// Solves the problem. Physical answers ("no pose", "contact broke") are answers.
    ///
    /// # Errors
    /// [`SolveError::InvalidInput`] where fields contradict each other, with places seen from the problem;
    /// [`SolveError::Internal`] for a solver that should have come to an end and did not.
    fn solve(&self) -> Result<Self::Answer, SolveError>;

    /// The same, ended when `stop` says so; of a problem that takes no long search the whole answer in any case.
    ///
    /// An answer that is not complete holds what was found by then, and claims nothing of what was not.
    ///
    /// # Errors
    /// As [`Self::solve`]; [`SolveError::Stopped`] where nothing sound can be said.
    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<Self::Answer>, SolveError> {
        let _ = stop;
        Ok(Searched { found: self.solve()?, complete: true })
    }
}

/// From fields, `id` and the time limit of those that name none to the line of the answer.
type Answering = fn(Json<'_>, &RawValue, Option<Duration>) -> Result<String, Failure>;

/// A [`Problem`] with its type erased, for a [`Registry`].
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    name: &'static str,
    answer: Answering,
    schema: fn() -> KindSchema,
}

/// JSON Schemas of what goes in and what comes out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KindSchema {
    /// A line of input, `problem` and `id` included.
    pub problem: Schema,
    /// The line of output if there is no error, `problem` and `id` included.
    pub result: Schema,
}

impl Kind {
    /// The kind that `P` describes.
    #[must_use]
    pub const fn of<P: Problem>() -> Self {
        Self { name: P::KIND, answer: answer::<P>, schema: schema::of::<P> }
    }

    /// The name in the field `problem`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// The JSON Schemas of this kind.
    #[must_use]
    pub fn schema(&self) -> KindSchema {
        (self.schema)()
    }
}

/// A list of kinds.
#[derive(Clone, Copy, Debug)]
pub struct Registry {
    kinds: &'static [Kind],
    time_limit: Option<Duration>,
}

impl Registry {
    /// Lists the kinds to answer.
    #[must_use]
    pub const fn new(kinds: &'static [Kind]) -> Self {
        Self { kinds, time_limit: None }
    }

    /// The same with a limit to the work on each problem that names none.
    ///
    /// ```
    /// use std::time::Duration;
    ///
    /// use palpate_files::solve::KINDS;
    /// use serde_json::json;
    ///
    /// let block = json!([[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]]); // m
    /// let finger = json!({"radius": 0.01, "centre0": [0, 0], "velocity0": [0, 0.05], "acceleration": [0, 0]});
    /// let problem = json!({
    ///     "problem": "observe_push", "polygon": block, "mu": 0.3, "mode": "rolling", "finger": finger, "dt": 0.05,
    ///     "sigma": 2e-3, "contact_angle": [1.6, 1.605, 1.62, 1.64],
    /// });
    /// assert!(KINDS.with_time_limit(Duration::ZERO).solve(problem).is_err());
    /// ```
    #[must_use]
    pub const fn with_time_limit(self, limit: Duration) -> Self {
        Self { time_limit: Some(limit), ..self }
    }

    /// The kinds in the order listed.
    #[must_use]
    pub fn kinds(&self) -> &'static [Kind] {
        self.kinds
    }

    /// The names in the order listed.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        self.kinds.iter().map(Kind::name)
    }

    /// The kind of this name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<&'static Kind> {
        self.kinds.iter().find(|kind| kind.name == name)
    }

    /// What to tell someone who asked for a kind that is not listed.
    #[must_use]
    pub fn unknown(&self, name: &str) -> String {
        let name_cut = elide(name, QUOTE_CHARS_MAX);
        let list: Vec<_> = self.names().map(|name| format!("`{name}`")).collect();
        let hint = spelling::nearest(name, self.names()).map(|near| format!("did you mean `{near}`? "));
        match list.is_empty() {
            true => format!("`{name_cut}` is not a kind of problem: this version has none built in yet"),
            false => {
                format!("`{name_cut}` is not a kind of problem: {}known: {}", hint.unwrap_or_default(), list.join(", "))
            }
        }
    }

    /// The line of output for a good problem, without its line end.
    pub(super) fn answer(&self, kind: &str, fields: Json<'_>, id: &RawValue) -> Result<String, Failure> {
        let Some(found) = self.find(kind) else {
            let place = Pointer::from("problem");
            return Err(Failure::new(ErrorCode::UnknownProblem, &self.unknown(kind)).at(place));
        };
        (found.answer)(fields, id, self.time_limit)
    }
}

/// Reads a problem, in which null says as much as leaving an optional field out.
///
/// Where null has a meaning of its own it keeps it: only what cannot be read as it stands is read without. A field that
/// is required is then missing, and told as it stood; one that does not exist is a mistake whatever it holds. A problem
/// is read as often as it has kinds of such fields, and no more.
fn read_with_nulls<P: Problem>(fields: Json<'_>) -> Result<P, InvalidInput> {
    let mut leaner: Option<String> = None;
    let mut as_it_stood = None;
    loop {
        let fields = leaner.as_deref().map_or(fields, Json::of_checked);
        let error = match Fields::without(fields, &[PROBLEM, ID, TIME_LIMIT]).read() {
            Ok(problem) => return Ok(problem),
            Err(error) => error,
        };
        let place = error.field().filter(|_| !error.is_not_a_field());
        let without = place.and_then(|place| text::without_nulls(fields, &place.segments()));
        let first = as_it_stood.take().unwrap_or(error);
        if without.is_none() {
            return Err(first);
        }
        (leaner, as_it_stood) = (without, Some(first));
    }
}

/// How long a problem may be worked on, if it says so itself.
fn time_limit(fields: Json<'_>) -> Result<Option<Duration>, InvalidInput> {
    let Some(value) = fields.member(TIME_LIMIT).filter(|value| !value.is_null()) else { return Ok(None) };
    let seconds: NonNegative = Fields::of(value).read().map_err(|error| error.inside(TIME_LIMIT))?;
    Ok(Some(duration(seconds.get())))
}

/// So many seconds, or as long as can be.
fn duration(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
}

fn answer<P: Problem>(fields: Json<'_>, id: &RawValue, unless_said: Option<Duration>) -> Result<String, Failure> {
    #[derive(Serialize)]
    struct Good<'a, A> {
        id: &'a RawValue,
        problem: &'static str,
        #[serde(flatten)]
        answer: &'a A,
        /// Only where it is not.
        #[serde(skip_serializing_if = "Option::is_none")]
        complete: Option<bool>,
    }
    let limit = time_limit(fields)?.or(unless_said).or(P::TIME_LIMIT_S.map(duration));
    let problem: P = read_with_nulls(fields)?;
    let begun = Instant::now();
    let answer = problem.solve_until(&|| limit.is_some_and(|limit| begun.elapsed() >= limit))?;
    let complete = (!answer.complete).then_some(false);
    let answer = answer.found;
    // JSON has no such numbers and serde_json would write null, which means something else.
    finite::check(&answer).map_err(|error| Failure::internal(&format!("the result is not a number: {error}")))?;
    serde_json::to_string(&Good { id, problem: P::KIND, answer: &answer, complete })
        .map_err(|error| Failure::internal(&format!("the result cannot be written: {error}")))
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::kinds::corner_poses::CornerPoses;
    use super::kinds::inscription::Inscription;
    use super::kinds::roll::Roll;
    use super::*;

    fn read_object<P: Problem>(value: &Value) -> Result<P, InvalidInput> {
        read_with_nulls(Json::of_checked(&value.to_string()))
    }

    #[test]
    fn null_in_an_optional_field_leaves_it_out_and_in_a_required_one_is_a_mistake() {
        let square = json!([[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]]);
        let lean = json!({"polygon": square, "half_planes": [{"normal_angle": 0, "offset": 0.1}]});
        let mut full = lean.clone();
        for field in ["points", "cones", "rounding", "hull", "sigma"] {
            full[field] = Value::Null;
        }
        let [lean, full] = [lean, full].map(|value| json!(read_object::<Inscription>(&value).unwrap()));
        assert_eq!(full, lean);
        // One that does not exist is misspelt, whatever it holds.
        let mut misspelt = lean.clone();
        misspelt["sigmma"] = Value::Null;
        let message = read_object::<Inscription>(&misspelt).unwrap_err().to_string();
        assert!(message.contains("/sigmma") && message.contains("did you mean `sigma`"), "{message}");
        // Beside another whose null has a meaning, and which is required.
        let roll = json!({
            "body": {"ellipsoid": [0.02, 0.03, 0.04]}, "spin": "free", "g": null, "palm_acceleration": null,
            "initial": {"orientation": [1, 0, 0, 0], "omega": [0, 0, 1], "u": [0, 0]}, "times": [0.1],
        });
        assert!(read_object::<Roll>(&roll).unwrap().palm_acceleration.is_none());
        let required = json!({"polygon": null, "corner_angle": 1.5, "push": [-1, -1]});
        let message = read_object::<CornerPoses>(&required).unwrap_err().to_string();
        assert!(message.contains("/polygon"), "{message}");
    }
}
