//! What goes wrong with one line: its code, its place and its message, and the line that says so.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use serde_json::value::RawValue;

/// The field that says how long a line may be worked on, of every kind.
pub(super) const TIME_LIMIT: &str = "time_limit";

/// Most characters in a message: a log line, not a copy of the input. Fixed by the interface.
const MESSAGE_CHARS_MAX: usize = 2000;

/// What kind of mistake a line holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum ErrorCode {
    /// The line is not JSON: its grammar, its text encoding, a number beyond 64-bit floats, nesting too deep.
    InvalidJson,
    /// No problem kind has this name.
    UnknownProblem,
    /// A field is missing, unknown, of the wrong type or has an impossible value.
    InvalidInput,
    /// The search was broken off at its time limit with nothing sound to say.
    TimeLimit,
    /// A fault of the solver, not of the line.
    Internal,
}

/// The answer to a line that could not be solved.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct ErrorLine {
    /// The line's own `id`; null where it has none or it cannot be read.
    #[schemars(with = "serde_json::Value")]
    pub id: Box<RawValue>,
    /// The line of the input, from 1, blank lines counted.
    pub line: u64,
    /// What is wrong with the line.
    pub error: Failure,
}

/// What is wrong with a line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, thiserror::Error)]
#[error("{message}")]
pub struct Failure {
    /// What kind of mistake it is.
    pub code: ErrorCode,
    /// The field, the value, the limit it broke and what to do; at most 2000 characters.
    #[schemars(length(min = 1, max = 2000))]
    pub message: String,
    /// JSON Pointer to the field; null where none applies.
    pub field: Option<Pointer>,
}

impl Failure {
    pub(crate) fn new(code: ErrorCode, message: &str) -> Self {
        Self { code, message: elide(message, MESSAGE_CHARS_MAX), field: None }
    }

    pub(crate) fn internal(message: &str) -> Self {
        Self::new(ErrorCode::Internal, message)
    }

    pub(crate) fn at(self, field: Pointer) -> Self {
        Self { field: Some(field), ..self }
    }
}

impl From<InvalidInput> for Failure {
    fn from(InvalidInput { field, message }: InvalidInput) -> Self {
        match field {
            None => Self::new(ErrorCode::InvalidInput, &message),
            Some(field) => Self::new(ErrorCode::InvalidInput, &format!("`{}`: {message}", field.place())).at(field),
        }
    }
}

/// A value that a problem cannot have: the field and what is wrong with its value.
///
/// The message does not name the field; whoever reports the error puts the place in front.
///
/// ```
/// use palpate_files::solve::{InvalidInput, Pointer};
///
/// let error = InvalidInput::at(Pointer::from("times").index(3), "0.2 s is not after 0.3 s: sort the times");
/// assert_eq!(error.to_string(), r#"at "/times/3": 0.2 s is not after 0.3 s: sort the times"#);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InvalidInput {
    field: Option<Pointer>,
    message: String,
}

/// How the message about a field begins that an object cannot have. Errors carry text alone through serde.
const NOT_A_FIELD: &str = "is not a field here:";

impl InvalidInput {
    /// About the problem as a whole, or about the very value that is being read.
    pub fn new(message: impl Into<String>) -> Self {
        Self { field: None, message: message.into() }
    }

    /// About one field, seen from where the error is returned to.
    pub fn at(field: impl Into<Pointer>, message: impl Into<String>) -> Self {
        Self { field: Some(field.into()), message: message.into() }
    }

    /// A number beyond a limit: `limit` reads after "must be", `remedy` tells what to do.
    #[must_use]
    pub fn out_of_range(value: f64, limit: &str, remedy: &str) -> Self {
        Self::new(format!("{value:?} is out of range, it must be {limit}: {remedy}"))
    }

    /// A field that this combination of others needs.
    pub fn missing(field: impl Into<Pointer>, remedy: &str) -> Self {
        Self::at(field, format!("is missing: {remedy}"))
    }

    /// A field that the object cannot have: the nearest it could, as a question, and all of them.
    pub(crate) fn not_a_field(field: &str, hint: &str, known: &str) -> Self {
        Self::at(field, format!("{NOT_A_FIELD} {hint}allowed: {known}"))
    }

    /// Whether the object cannot have the field at all.
    pub(crate) fn is_not_a_field(&self) -> bool {
        self.message.starts_with(NOT_A_FIELD)
    }

    /// Two fields of which only one may be given.
    #[must_use]
    pub fn exclusive(first: &str, second: &str) -> Self {
        Self::at(second, format!("cannot be given together with `{first}`: leave one of them out"))
    }

    /// The same error seen from the object that holds this value as its field `key`.
    #[must_use]
    pub fn inside(self, key: &str) -> Self {
        self.below(Pointer::from(key))
    }

    /// The same error seen from further out: `outer` leads to where it was found.
    #[must_use]
    pub(crate) fn below(self, outer: Pointer) -> Self {
        let field = match self.field {
            Some(inner) => outer.join(&inner),
            None => outer,
        };
        Self { field: Some(field).filter(|field| !field.is_root()), ..self }
    }

    /// Where, seen from where the error was returned to.
    pub(crate) fn field(&self) -> Option<&Pointer> {
        self.field.as_ref()
    }

    /// Reads back what [`fmt::Display`] wrote: serde's errors carry text only, and this gets a place through them.
    pub(crate) fn from_text(text: &str) -> Self {
        Self::split_text(text).unwrap_or_else(|| Self::new(text))
    }

    fn split_text(text: &str) -> Option<Self> {
        let quoted = text.strip_prefix("at ")?;
        let mut strings = serde_json::Deserializer::from_str(quoted).into_iter::<String>();
        let field = strings.next()?.ok()?;
        let message = quoted.get(strings.byte_offset()..)?.strip_prefix(": ")?;
        Some(Self::at(Pointer(field), message))
    }
}

impl fmt::Display for InvalidInput {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.field {
            None => f.write_str(&self.message),
            Some(field) => write!(f, "at {}: {}", Value::from(field.0.as_str()), self.message),
        }
    }
}

impl std::error::Error for InvalidInput {}

/// Why a problem that reads well has no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// The problem's fields contradict each other or describe nothing that can exist.
    #[error(transparent)]
    InvalidInput(#[from] InvalidInput),
    /// The search was stopped before anything sound could be said.
    #[error("the search was broken off with nothing sound to say: allow it more time")]
    Stopped,
    /// The solver gave up, which it should not have.
    #[error("{0}")]
    Internal(String),
}

impl From<SolveError> for Failure {
    fn from(error: SolveError) -> Self {
        match error {
            SolveError::InvalidInput(error) => error.into(),
            SolveError::Stopped => Self::new(ErrorCode::TimeLimit, &error.to_string()).at(Pointer::from(TIME_LIMIT)),
            SolveError::Internal(message) => Self::internal(&message),
        }
    }
}

/// A JSON Pointer (RFC 6901).
///
/// ```
/// let pointer = palpate_files::solve::Pointer::from("polygon").index(3).index(0);
/// assert_eq!(pointer.to_string(), "/polygon/3/0");
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Pointer(String);

impl Pointer {
    /// To the member `key` of the object this leads to.
    #[must_use]
    pub fn key(self, key: &str) -> Self {
        Self(format!("{}/{}", self.0, key.replace('~', "~0").replace('/', "~1")))
    }

    /// To the element `index` of the array this leads to.
    #[must_use]
    pub fn index(self, index: usize) -> Self {
        Self(format!("{}/{index}", self.0))
    }

    /// The pointer as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The key of the outermost member that this leads through.
    pub(crate) fn first_key(&self) -> Option<String> {
        self.0.split('/').nth(1).map(plain)
    }

    pub(crate) fn join(self, inner: &Self) -> Self {
        Self(self.0 + &inner.0)
    }

    /// The keys and indices on the way.
    pub(crate) fn segments(&self) -> Vec<String> {
        self.0.split('/').skip(1).map(plain).collect()
    }

    fn is_root(&self) -> bool {
        self.0.is_empty()
    }

    /// The place as people write it: `polygon[3][0]`, `finger.radius`.
    fn place(&self) -> String {
        let mut place = String::new();
        for segment in self.0.split('/').skip(1) {
            let is_index = !segment.is_empty() && segment.bytes().all(|b| b.is_ascii_digit());
            let key = elide(&plain(segment), QUOTE_CHARS_MAX);
            match (is_index, place.is_empty()) {
                (true, _) => place += &format!("[{segment}]"),
                (false, true) => place += &key,
                (false, false) => place += &format!(".{key}"),
            }
        }
        place
    }
}

/// A key as its object has it.
fn plain(segment: &str) -> String {
    segment.replace("~1", "/").replace("~0", "~")
}

impl From<&str> for Pointer {
    fn from(key: &str) -> Self {
        Self::default().key(key)
    }
}

impl fmt::Display for Pointer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Most characters of the user's own text to repeat in the middle of a message.
pub(crate) const QUOTE_CHARS_MAX: usize = 80;

/// Cuts the middle out of a long text: the start says what it is about, the end what to do.
pub(crate) fn elide(text: &str, chars_max: usize) -> String {
    let count = text.chars().count();
    if count <= chars_max {
        return text.to_owned();
    }
    let tail = chars_max / 3;
    let head = chars_max - tail - 1;
    text.chars().take(head).chain(['…']).chain(text.chars().skip(count - tail)).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_pointer_escapes_its_keys() {
        assert_eq!(Pointer::from("a/b~c").index(0).as_str(), "/a~1b~0c/0");
    }

    #[test]
    fn a_failure_names_the_place_first() {
        let error = InvalidInput::at(Pointer::from("velocity").index(1), "is missing").inside("finger");
        let failure = Failure::from(error);
        assert_eq!(failure.message, "`finger.velocity[1]`: is missing");
        assert_eq!(failure.field.unwrap().as_str(), "/finger/velocity/1");
    }

    #[test]
    fn a_long_message_keeps_its_start_and_its_end() {
        let failure = Failure::new(ErrorCode::InvalidInput, &format!("start {} end", "ä".repeat(5000)));
        assert_eq!(failure.message.chars().count(), MESSAGE_CHARS_MAX);
        assert!(failure.message.starts_with("start ä") && failure.message.ends_with("ä end"));
    }

    proptest! {
        #[test]
        fn a_place_survives_being_text(keys in proptest::collection::vec(".{0,12}", 1..4), message in ".*") {
            let pointer = keys.iter().fold(Pointer::default(), |pointer, key| pointer.key(key));
            let error = InvalidInput::at(pointer, message);
            prop_assert_eq!(InvalidInput::from_text(&error.to_string()), error);
        }
    }
}
