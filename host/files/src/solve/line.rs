//! One line of text to an `id` and a request: strict JSON, before any kind looks at its fields.

use std::borrow::Cow;
use std::cell::Cell;
use std::collections::HashSet;
use std::fmt;

use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::value::RawValue;

use super::error::{ErrorCode, Failure, InvalidInput, Pointer, QUOTE_CHARS_MAX, elide};
use super::text::{Json, Shape};

/// The field that names the kind.
pub(super) const PROBLEM: &str = "problem";

/// The field that an answer repeats.
pub(super) const ID: &str = "id";

/// What one line asks for.
#[derive(Debug)]
pub(super) struct Request<'t> {
    /// Name of the kind.
    pub kind: String,
    /// An object: all fields, `problem` and `id` among them.
    pub fields: Json<'t>,
}

/// A line that has been read, well or badly.
#[derive(Debug)]
pub(super) struct ParsedLine<'t> {
    /// The `id` to the letter, null where there is none.
    pub id: Box<RawValue>,
    /// What the line asks for, or why it cannot be understood.
    pub request: Result<Request<'t>, Failure>,
}

/// Reads a line (without its line end).
pub(super) fn parse(line: &[u8]) -> ParsedLine<'_> {
    match std::str::from_utf8(line) {
        Ok(text) => ParsedLine { id: read_id(text), request: read_request(text) },
        Err(error) => ParsedLine { id: null(), request: Err(not_utf8(line, error)) },
    }
}

/// The raw `null`.
pub(super) fn null() -> Box<RawValue> {
    RawValue::NULL.to_owned()
}

fn not_utf8(line: &[u8], error: std::str::Utf8Error) -> Failure {
    let at = error.valid_up_to();
    let byte = line.get(at).copied().unwrap_or_default();
    invalid_json(&format!("byte {} of the line (0x{byte:02x}) is not UTF-8: save the input as UTF-8", at + 1))
}

fn invalid_json(message: &str) -> Failure {
    Failure::new(ErrorCode::InvalidJson, message)
}

/// The `id` of any line that keeps JSON's grammar, even if its numbers, its nesting or its other fields are refused.
fn read_id(text: &str) -> Box<RawValue> {
    #[derive(Deserialize)]
    struct OnlyId<'a> {
        #[serde(borrow)]
        id: Option<&'a RawValue>,
    }
    // serde_json would also take an array of the fields.
    let is_object = text.trim_start().starts_with('{');
    let id = serde_json::from_str::<OnlyId>(text).ok().filter(|_| is_object).and_then(|line| line.id);
    // Skipping over the id does not check it, and what is refused as input must not come out again.
    let id = id.filter(|id| check(id.get()).is_ok()).and_then(|id| without_spaces(id.get()));
    id.unwrap_or_else(null)
}

/// The same JSON to the letter but for the white space between its tokens, where a bare CR may hide and look like a
/// line end.
fn without_spaces(json: &str) -> Option<Box<RawValue>> {
    let (mut in_string, mut escaped) = (false, false);
    let keep = |c: &char| {
        let keep = in_string || !matches!(c, ' ' | '\t' | '\r' | '\n');
        in_string ^= *c == '"' && !escaped;
        escaped = in_string && *c == '\\' && !escaped;
        keep
    };
    let mut lean = String::with_capacity(json.len());
    lean.extend(json.chars().filter(keep));
    RawValue::from_string(lean).ok()
}

fn read_request(text: &str) -> Result<Request<'_>, Failure> {
    let problem = check(text)?;
    if problem.shape() != Shape::Object {
        return Err(InvalidInput::new(r#"a problem is a JSON object: {"problem": KIND, ...}"#).into());
    }
    match problem.member(PROBLEM) {
        Some(kind) if kind.shape() == Shape::String => {
            Ok(Request { kind: kind.string().into_owned(), fields: problem })
        }
        Some(other) => {
            let other = elide(other.text(), QUOTE_CHARS_MAX);
            Err(InvalidInput::at(PROBLEM, format!("got {other}, expected the name of a kind as a string")).into())
        }
        None => Err(InvalidInput::missing(PROBLEM, "name the kind of problem").into()),
    }
}

/// Checks that this is JSON as RFC 8259 has it, in the range of 64-bit floats, nested at most 127 deep, no key twice in
/// an object. Holds no more in memory than the keys of the objects that are open.
fn check(text: &str) -> Result<Json<'_>, Failure> {
    let duplicate = Cell::new(None);
    let mut deserializer = serde_json::Deserializer::from_str(text);
    let checked = Strict { duplicate: &duplicate }.deserialize(&mut deserializer);
    let checked = checked.and_then(|()| deserializer.end());
    checked.map_err(|error| explain_syntax(text, &error))?;
    match duplicate.take() {
        None => Ok(Json::of_checked(text)),
        Some(place) => Err(InvalidInput::at(place, "is given twice: leave one of them out").into()),
    }
}

fn explain_syntax(text: &str, error: &serde_json::Error) -> Failure {
    // The line of the input is reported beside the message; the line within the line is always the first.
    let column = error.column();
    let message = error.to_string();
    let reason = message.split(" at line ").next().unwrap_or_default();
    let rest = text.get(column.saturating_sub(1)..).unwrap_or_default();
    let is_word = ["NaN", "Infinity", "nan", "inf", "Inf"].iter().any(|word| rest.starts_with(word))
        || text.get(column.saturating_sub(2)..).is_some_and(|rest| rest.starts_with("-I") || rest.starts_with("-i"));
    let remedy = match reason {
        _ if is_word => "JSON has no NaN or Infinity, give a finite number or leave the field out",
        "number out of range" => "numbers end at ±1.797e308, give a finite number or leave the field out",
        "recursion limit exceeded" => "nested more than 127 deep, no problem needs that",
        "trailing characters" => "give one JSON object a line and nothing after it",
        _ if error.is_eof() => "the line ends too early, give one whole JSON object a line",
        _ => "give one JSON object a line",
    };
    invalid_json(&format!("not JSON at column {column}: {reason} ({remedy})"))
}

/// Reads JSON and keeps nothing of it, but notices keys given twice, of which `serde_json` keeps the last.
#[derive(Clone, Copy)]
struct Strict<'a> {
    /// The first key found twice. A line that is not even JSON is told so first, so this waits until the end.
    duplicate: &'a Cell<Option<Pointer>>,
}

impl Strict<'_> {
    /// Puts the place of an element in front of a duplicate found inside it.
    fn located<T>(self, outer: impl FnOnce() -> Pointer, read: impl FnOnce(Strict<'_>) -> T) -> T {
        let inner = Cell::new(None);
        let result = read(Strict { duplicate: &inner });
        if let Some(place) = inner.take() {
            self.report(|| outer().join(&place));
        }
        result
    }

    /// Keeps the place if it is the first.
    fn report(self, place: impl FnOnce() -> Pointer) {
        let first = self.duplicate.take().unwrap_or_else(place);
        self.duplicate.set(Some(first));
    }
}

impl<'de> DeserializeSeed<'de> for Strict<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

/// Accepts values that hold no others.
macro_rules! accept {
    ($($method:ident($($type:ty)?),)*) => {$(
        fn $method<E>(self, $(_: $type)?) -> Result<(), E> {
            Ok(())
        }
    )*};
}

impl<'de> Visitor<'de> for Strict<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    accept! {
        visit_unit(),
        visit_bool(bool),
        visit_i64(i64),
        visit_u64(u64),
        visit_str(&str),
    }

    fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<(), E> {
        if value.is_finite() { Ok(()) } else { Err(E::custom("number out of range")) }
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut elements: A) -> Result<(), A::Error> {
        let mut index = 0;
        while let Some(()) =
            self.located(|| Pointer::default().index(index), |seed| elements.next_element_seed(seed))?
        {
            index += 1;
        }
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<(), A::Error> {
        let mut keys = Keys::default();
        while let Some(Key(key)) = members.next_key()? {
            self.located(|| Pointer::from(&*key), |seed| members.next_value_seed(seed))?;
            if keys.has(&key) {
                self.report(|| Pointer::from(&*key));
            } else {
                keys.insert(key);
            }
        }
        Ok(())
    }
}

/// A key, in its own memory only if it was written with escapes.
struct Key<'de>(Cow<'de, str>);

impl<'de> Deserialize<'de> for Key<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Text;

        impl<'de> Visitor<'de> for Text {
            type Value = Key<'de>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a key")
            }

            fn visit_borrowed_str<E>(self, text: &'de str) -> Result<Key<'de>, E> {
                Ok(Key(text.into()))
            }

            fn visit_str<E>(self, text: &str) -> Result<Key<'de>, E> {
                Ok(Key(text.to_owned().into()))
            }
        }

        deserializer.deserialize_str(Text)
    }
}

/// The keys of an object, none twice: the first few in a row, as most objects have no more.
#[derive(Default)]
struct Keys<'de> {
    few: Vec<Cow<'de, str>>,
    many: HashSet<Cow<'de, str>>,
}

/// Keys that are compared one by one.
const FEW: usize = 16;

impl<'de> Keys<'de> {
    fn has(&self, key: &str) -> bool {
        self.few.iter().any(|other| other == key) || (!self.many.is_empty() && self.many.contains(key))
    }

    fn insert(&mut self, key: Cow<'de, str>) {
        if self.few.len() < FEW {
            self.few.push(key);
        } else {
            self.many.insert(key);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::{Value, json};

    use super::super::testing::{answer_to, any_json};
    use super::*;

    fn told(line: &str) -> (String, String, Value) {
        let answer = answer_to(line);
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        (text(&answer["error"]["code"]), text(&answer["error"]["message"]), answer["error"]["field"].clone())
    }

    #[test]
    fn what_is_not_json_is_told_with_its_column_and_a_remedy() {
        let cases = [
            ("problem: roll", "column 1: expected value"),
            (r#"{"problem": "roll",}"#, "column 20: trailing comma"),
            (r#"{"a": NaN}"#, "column 7: expected value (JSON has no NaN or Infinity"),
            (r#"{"a": -Infinity}"#, "(JSON has no NaN or Infinity"),
            (r#"{"a": [1, Infinity]}"#, "(JSON has no NaN or Infinity"),
            (r#"{"a": 1e999}"#, "column 11: number out of range (numbers end at ±1.797e308"),
            (r#"{"a": -1e400}"#, "number out of range"),
            (r#"{"a": 01}"#, "invalid number"),
            (r#"{"a": .5}"#, "expected value"),
            (r#"{"a": +1}"#, "expected value"),
            (r#"{"a": 0x1}"#, "expected `,` or `}`"),
            (r#"{"a": 1"#, "the line ends too early"),
            (r#"{"a": "1"#, "the line ends too early"),
            (r#"{"a": 1} {"a": 2}"#, "one JSON object a line and nothing after it"),
            (r#"{'a': 1}"#, "key must be a string"),
            (r#"{"a": "\ud800"}"#, "column 14"),
            (r#"{"a": "\x"}"#, "invalid escape"),
            ("{\"a\": \"\u{1}\"}", "control character"),
            ("{\"a\": 1} // why", "trailing characters"),
        ];
        for (line, expected) in cases {
            let (code, message, field) = told(line);
            assert_eq!((code.as_str(), &field), ("invalid_json", &Value::Null), "{line}: {message}");
            assert!(message.contains(expected), "{line}: {message}");
        }
    }

    #[test]
    fn json_that_is_no_problem_is_told_as_such() {
        for line in ["42", "null", "\"push\"", "[]", "[{\"problem\": \"area\"}]"] {
            let (code, message, field) = told(line);
            assert_eq!((code.as_str(), field), ("invalid_input", Value::Null), "{line}");
            assert!(message.contains("JSON object"), "{message}");
        }
        let cases = [
            ("{}", "invalid_input", "`problem`: is missing"),
            (r#"{"problem": null}"#, "invalid_input", "`problem`: got null"),
            (r#"{"problem": ["area"]}"#, "invalid_input", r#"`problem`: got ["area"]"#),
            (r#"{"problem": ""}"#, "unknown_problem", "`` is not a kind of problem: known: `area`"),
            (r#"{"problem": "aera"}"#, "unknown_problem", "did you mean `area`?"),
        ];
        for (line, code, message) in cases {
            let (got_code, got_message, field) = told(line);
            assert_eq!((got_code.as_str(), field), (code, json!("/problem")), "{line}");
            assert!(got_message.contains(message), "{line}: {got_message}");
        }
    }

    #[test]
    fn a_key_given_twice_is_told_at_its_place() {
        let cases = [
            (r#"{"problem": "area", "problem": "area"}"#, "/problem"),
            (r#"{"problem": "area", "id": 1, "\u0069d": 2}"#, "/id"),
            (r#"{"problem": "area", "x": [0, {"a": {"b": 1, "b": 2}}], "x": 1}"#, "/x/1/a/b"),
            (r#"{"problem": "no such kind", "x": {"a/b": 1, "a/b": 1}}"#, "/x/a~1b"),
        ];
        for (line, place) in cases {
            let (code, message, field) = told(line);
            assert_eq!((code.as_str(), field), ("invalid_input", json!(place)), "{line}");
            assert!(message.contains("twice"), "{message}");
        }
        // What is not JSON is told first.
        assert_eq!(told(r#"{"a": 1, "a": 2,"#).0, "invalid_json");
    }

    #[test]
    fn nesting_is_refused_from_the_depth_that_is_told() {
        let nested = |depth: usize| format!(r#"{{"id": 3, "a": {}0{}}}"#, "[".repeat(depth), "]".repeat(depth));
        // The line's own object is one level.
        assert_eq!(told(&nested(126)).0, "invalid_input");
        for depth in [127, 200, 100_000] {
            let (code, message, _) = told(&nested(depth));
            assert_eq!(code, "invalid_json");
            assert!(message.contains("127 deep"), "{message}");
            assert_eq!(answer_to(&nested(depth))["id"], json!(3));
        }
        assert_eq!(told(&"[".repeat(1_000_000)).0, "invalid_json");
    }

    #[test]
    fn bytes_that_are_not_text_are_told_with_their_place() {
        let message = parse(b"{\"id\": \"\xff\"}").request.unwrap_err().message;
        assert_eq!(message, "byte 9 of the line (0xff) is not UTF-8: save the input as UTF-8");
    }

    #[test]
    fn an_id_is_repeated_to_the_letter() {
        let ids = [
            "null",
            "0",
            "-0",
            "1.0",
            "1e5",
            "1.50",
            "\"\"",
            "\"ä\\u00e4\\n\"",
            "[]",
            "true",
            "[1,{\"a\":\" b \"}]",
            "123456789012345678901234567890",
            "0.1000000000000000055511151231257827",
            "\"\\\\\"",
            "[\"\\\\ \\\" \",\" \"]",
        ];
        for id in ids {
            let line = format!(r#"{{"problem": "none", "id": {id}}}"#);
            assert_eq!(parse(line.as_bytes()).id.get(), id);
        }
        assert_eq!(parse(b"{\"id\": [ 1,\r\t{\"a b\": 2} ]}").id.get(), "[1,{\"a b\":2}]");
        assert_eq!(parse(b"{}").id.get(), "null");
    }

    #[test]
    fn an_id_is_read_wherever_the_grammar_is_kept() {
        for (line, id) in [
            (r#"{"id": 7, "a": 1e999}"#, "7"),
            (r#"{"id": 7, "a": "\ud800"}"#, "7"),
            (r#"{"id": 7, "a": NaN}"#, "null"),
            (r#"{"id": 7"#, "null"),
            (r#"{"id": 1e999}"#, "null"),
            (r#"{"id": "\ud800"}"#, "null"),
            (r#"{"id": {"a": 1, "a": 2}}"#, "null"),
            (r#"{"id": 1, "id": 2}"#, "null"),
            (r#"[{"id": 7}]"#, "null"),
        ] {
            assert_eq!(parse(line.as_bytes()).id.get(), id, "{line}");
        }
    }

    #[test]
    fn a_good_line_repeats_its_id_and_its_kind() {
        let line = r#"{"id": "a", "problem": "area", "polygon": [[0, 0], [2, 0], [0, 0.1]]}"#;
        let (text, summary) = super::super::testing::run_text(std::num::NonZeroUsize::MIN, line.into());
        assert_eq!(text, "{\"id\":\"a\",\"problem\":\"area\",\"area\":0.1}\n");
        assert_eq!(summary.failed, 0);
    }

    #[test]
    fn a_bad_field_is_told_with_its_index_its_value_and_a_remedy() {
        let line = r#"{"problem": "area", "polygon": [[0, 0], [2, 0], ["NaN", 1]]}"#;
        let (code, message, field) = told(line);
        assert_eq!((code.as_str(), field), ("invalid_input", json!("/polygon/2/0")));
        assert_eq!(message, r#"`polygon[2][0]`: got the string "NaN", expected a finite number"#);
        let (_, message, field) = told(r#"{"problem": "area", "polygon": [[0, 0], [2, 0], [2, 1]], "least": 9}"#);
        assert_eq!((message.as_str(), field), ("`least`: 9 is above the area", json!("/least")));
    }

    #[test]
    fn the_longest_mistakes_get_messages_of_bounded_length() {
        let long = "x".repeat(1_000_000);
        for line in [
            format!(r#"{{"problem": "{long}"}}"#),
            format!(r#"{{"problem": ["{long}"]}}"#),
            format!(r#"{{"problem": "area", "{long}": 1}}"#),
            format!(r#"{{"problem": "area", "polygon": "{long}"}}"#),
            format!(r#"{{"{long}": 1, "{long}": 2}}"#),
            long.clone(),
        ] {
            let message = told(&line).1;
            assert!((1..=2000).contains(&message.chars().count()), "{message}");
        }
    }

    proptest! {
        #[test]
        fn any_json_is_read_as_it_was_written(value in any_json()) {
            for text in [value.to_string(), format!("{value:#}").replace('\n', "\r")] {
                let read = check(&text).map(|json| serde_json::from_str::<Value>(json.text()).unwrap());
                prop_assert_eq!(read, Ok(value.clone()));
                let id = without_spaces(&text).unwrap();
                prop_assert_eq!(id.get(), value.to_string());
            }
        }
    }
}
