//! Messages of ROS 2 taken apart by the definitions that stand beside them in a file (`ros2msg`).
//!
//! Whatever a file's channels are, their messages become JSON, and rows of a table: a field a column, named by its way
//! (`wrench.force.x`), an element of a sequence of messages a row.
//!
//! Format: <https://design.ros2.org/articles/legacy_interface_definition.html>, the definitions of all messages within one after
//! the other, each behind a line of `=` and a line `MSG: package/Name`.
//! Errors: what is not understood is `None`.

use std::collections::BTreeMap;

use serde_json::{Map, Value};

use super::cdr::CdrFields;

/// Messages within messages at the most: a definition that contains itself has no end.
const DEPTH_MAX: usize = 24;

/// Columns of a table at the most: what has more is an image, or made to exhaust a reader.
const COLUMNS_MAX: usize = 10_000;

/// The definition of a message and of all that is within it.
#[derive(Clone, Debug, PartialEq)]
pub struct Definition {
    messages: BTreeMap<String, Vec<Field>>,
    root: String,
}

#[derive(Clone, Debug, PartialEq)]
struct Field {
    name: String,
    kind: Kind,
    many: Many,
}

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Bool,
    Signed(usize),
    Unsigned(usize),
    Float,
    Double,
    Text,
    /// Known by its name, without `msg/`.
    Message(String),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Many {
    One,
    Fixed(usize),
    Sequence,
}

/// A value in a table.
pub type Row = Vec<Value>;

impl Definition {
    /// Reads the definition of a message with this name.
    #[must_use]
    pub fn parse(name: &str, text: &str) -> Option<Self> {
        let root = without_msg(name);
        let mut messages = BTreeMap::new();
        // Everything that has a time has this, whether or not it is told.
        let time = |name: &str| Field { name: name.to_owned(), kind: Kind::Unsigned(4), many: Many::One };
        let seconds = Field { kind: Kind::Signed(4), ..time("sec") };
        for stamp in ["builtin_interfaces/Time", "builtin_interfaces/Duration"] {
            messages.insert(stamp.to_owned(), vec![seconds.clone(), time("nanosec")]);
        }
        let (mut current, mut fields) = (root.clone(), Vec::new());
        for line in text.lines().map(|line| line.split('#').next().unwrap_or_default().trim()) {
            if line.len() >= 3 && line.chars().all(|c| c == '=') {
                messages.insert(std::mem::take(&mut current), std::mem::take(&mut fields));
            } else if let Some(name) = line.strip_prefix("MSG:") {
                current = without_msg(name.trim());
            } else if !line.is_empty() {
                let package = current.split('/').next().unwrap_or_default();
                fields.extend(field(line, package)?);
            }
        }
        messages.insert(current, fields);
        let definition = Self { messages, root };
        let width = definition.width(&definition.root, 0, &mut BTreeMap::new())?;
        (width <= COLUMNS_MAX).then_some(definition)
    }

    /// Columns that a message takes in a table, if everything within is defined and has an end.
    fn width<'a>(&'a self, name: &'a str, depth: usize, known: &mut BTreeMap<&'a str, usize>) -> Option<usize> {
        if let Some(width) = known.get(name) {
            return Some(*width);
        }
        if depth >= DEPTH_MAX {
            return None;
        }
        let mut width = 0_usize;
        for Field { kind, many, .. } in self.messages.get(name)? {
            let one = match kind {
                Kind::Message(name) => self.width(name, depth + 1, known)?,
                _ => 1,
            };
            let count = if let Many::Fixed(count) = many { *count } else { 1 };
            width = width.saturating_add(one.saturating_mul(count));
        }
        known.insert(name, width);
        Some(width)
    }

    /// A message as JSON; what is no number there, such as NaN, is null.
    #[must_use]
    pub fn decode(&self, message: &[u8]) -> Option<Value> {
        self.message(&self.root, &mut CdrFields::of(message)?)
    }

    fn message(&self, name: &str, from: &mut CdrFields<'_>) -> Option<Value> {
        let mut object = Map::new();
        for field in self.messages.get(name)? {
            let value = match field.many {
                Many::One => self.value(&field.kind, from)?,
                Many::Fixed(count) => self.values(&field.kind, count, from)?,
                Many::Sequence => {
                    let count = from.length()?;
                    self.values(&field.kind, count, from)?
                }
            };
            object.insert(field.name.clone(), value);
        }
        Some(Value::Object(object))
    }

    fn values(&self, kind: &Kind, count: usize, from: &mut CdrFields<'_>) -> Option<Value> {
        // Every element takes a byte at least.
        if count > from.left() {
            return None;
        }
        (0..count).map(|_| self.value(kind, from)).collect::<Option<Vec<_>>>().map(Value::Array)
    }

    fn value(&self, kind: &Kind, from: &mut CdrFields<'_>) -> Option<Value> {
        Some(match kind {
            Kind::Bool => from.bool()?.into(),
            Kind::Signed(1) => i8::from_le_bytes(from.number()?).into(),
            Kind::Signed(2) => i16::from_le_bytes(from.number()?).into(),
            Kind::Signed(4) => from.i32()?.into(),
            Kind::Signed(_) => i64::from_le_bytes(from.number()?).into(),
            Kind::Unsigned(1) => from.u8()?.into(),
            Kind::Unsigned(2) => u16::from_le_bytes(from.number()?).into(),
            Kind::Unsigned(4) => from.u32()?.into(),
            Kind::Unsigned(_) => from.u64()?.into(),
            Kind::Float => f32::from_le_bytes(from.number()?).into(),
            Kind::Double => from.f64()?.into(),
            Kind::Text => from.text()?.into(),
            Kind::Message(name) => self.message(name, from)?,
        })
    }

    /// Columns of a table of such messages.
    #[must_use]
    pub fn columns(&self) -> Vec<String> {
        let (mut columns, mut exploded) = (Vec::new(), None);
        self.columns_of(&self.root, "", &mut columns, &mut exploded);
        columns
    }

    fn columns_of(&self, name: &str, before: &str, columns: &mut Vec<String>, exploded: &mut Option<String>) {
        for Field { name, kind, many } in self.messages.get(name).into_iter().flatten() {
            let way = format!("{before}{name}");
            match (kind, many) {
                (Kind::Message(inner), Many::One) => self.columns_of(inner, &format!("{way}."), columns, exploded),
                (Kind::Message(inner), Many::Sequence) if exploded.is_none() => {
                    *exploded = Some(way.clone());
                    self.columns_of(inner, &format!("{way}."), columns, exploded);
                }
                (Kind::Message(inner), Many::Fixed(count)) => {
                    (0..*count).for_each(|k| self.columns_of(inner, &format!("{way}[{k}]."), columns, exploded));
                }
                (_, Many::Fixed(count)) => columns.extend((0..*count).map(|k| format!("{way}[{k}]"))),
                _ => columns.push(way),
            }
        }
    }

    /// The rows of a message that was decoded: one, or one for each element of its first sequence of messages.
    #[must_use]
    pub fn rows(&self, message: &Value) -> Vec<Row> {
        let mut rows = vec![Row::new()];
        let mut is_exploded = false;
        self.rows_of(&self.root, Some(message), &mut rows, &mut is_exploded);
        rows
    }

    fn rows_of(&self, name: &str, message: Option<&Value>, rows: &mut Vec<Row>, is_exploded: &mut bool) {
        for Field { name, kind, many } in self.messages.get(name).into_iter().flatten() {
            let value = message.and_then(|message| message.get(name));
            let element = |k: usize| value.and_then(|value| value.get(k));
            match (kind, many) {
                (Kind::Message(inner), Many::One) => self.rows_of(inner, value, rows, is_exploded),
                (Kind::Message(inner), Many::Sequence) if !*is_exploded => {
                    *is_exploded = true;
                    let count = value.and_then(Value::as_array).map_or(0, Vec::len);
                    let before = std::mem::take(rows);
                    // One that is empty has a row all the same: it was said that there is nothing.
                    for k in 0..count.max(1) {
                        let mut more = before.clone();
                        self.rows_of(inner, element(k), &mut more, is_exploded);
                        rows.append(&mut more);
                    }
                }
                (Kind::Message(inner), Many::Fixed(count)) => {
                    (0..*count).for_each(|k| self.rows_of(inner, element(k), rows, is_exploded));
                }
                (_, Many::Fixed(count)) => {
                    let values: Vec<_> = (0..*count).map(|k| element(k).cloned().unwrap_or_default()).collect();
                    rows.iter_mut().for_each(|row| row.extend(values.iter().cloned()));
                }
                _ => rows.iter_mut().for_each(|row| row.push(value.cloned().unwrap_or_default())),
            }
        }
    }
}

/// `package/msg/Name` without what says that it is a message.
fn without_msg(name: &str) -> String {
    name.replacen("/msg/", "/", 1)
}

/// The field that a line defines: none where it is a constant; `None` where it is not understood.
fn field(line: &str, package: &str) -> Option<Option<Field>> {
    let (kind, rest) = line.split_once(char::is_whitespace)?;
    let name = rest.split_whitespace().next()?;
    if rest.contains('=') && !kind.contains("<=") || name.contains('=') {
        return Some(None);
    }
    let (kind, many) = match kind.split_once('[') {
        None => (kind, Many::One),
        Some((kind, size)) => {
            let size = size.strip_suffix(']')?;
            (kind, size.parse().map_or(Many::Sequence, Many::Fixed))
        }
    };
    let kind = match kind.split("<=").next()? {
        "bool" => Kind::Bool,
        "int8" => Kind::Signed(1),
        "int16" => Kind::Signed(2),
        "int32" => Kind::Signed(4),
        "int64" => Kind::Signed(8),
        "uint8" | "byte" | "char" => Kind::Unsigned(1),
        "uint16" => Kind::Unsigned(2),
        "uint32" => Kind::Unsigned(4),
        "uint64" => Kind::Unsigned(8),
        "float32" => Kind::Float,
        "float64" => Kind::Double,
        "string" => Kind::Text,
        "Header" => Kind::Message("std_msgs/Header".to_owned()),
        "time" => Kind::Message("builtin_interfaces/Time".to_owned()),
        "duration" => Kind::Message("builtin_interfaces/Duration".to_owned()),
        // Two bytes a character and other rules.
        "wstring" => return None,
        named if named.contains('/') => Kind::Message(without_msg(named)),
        named => Kind::Message(format!("{package}/{named}")),
    };
    Some(Some(Field { name: name.to_owned(), kind, many }))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::cdr::Cdr;
    use super::*;

    const BELIEF: &str = "\
# Everywhere that it may be
uint8 NONE=0
std_msgs/Header header
Guess[] guesses
string<=20 note 'a default'
float64[2] both
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: palpate_msgs/Guess
float64 p # probability
int8 edge
";

    fn message(guesses: &[f64]) -> Vec<u8> {
        let cdr = Cdr::new().header(5_000_000_007, "world");
        let cdr = cdr.sequence(guesses, |cdr, p| cdr.f64(*p).u8(255));
        cdr.text("seen").f64s([1.5, f64::NAN]).finish()
    }

    #[test]
    fn messages_become_objects_and_rows_by_the_definitions_beside_them() {
        let definition = Definition::parse("palpate_msgs/msg/Belief", BELIEF).unwrap();
        let decoded = definition.decode(&message(&[0.75, 0.25])).unwrap();
        let header = json!({"stamp": {"sec": 5, "nanosec": 7}, "frame_id": "world"});
        let guesses = json!([{"p": 0.75, "edge": -1}, {"p": 0.25, "edge": -1}]);
        assert_eq!(decoded, json!({"header": header, "guesses": guesses, "note": "seen", "both": [1.5, null]}));
        let columns = definition.columns();
        assert_eq!(
            columns.join(" "),
            "header.stamp.sec header.stamp.nanosec header.frame_id guesses.p guesses.edge note both[0] both[1]"
        );
        let rows = definition.rows(&decoded);
        assert_eq!(rows.len(), 2);
        assert_eq!(json!(rows[1]), json!([5, 7, "world", 0.25, -1, "seen", 1.5, null]));
        let none = definition.decode(&message(&[])).unwrap();
        assert_eq!(json!(definition.rows(&none)), json!([[5, 7, "world", null, null, "seen", 1.5, null]]));
    }

    #[test]
    fn what_is_not_understood_is_none_and_has_an_end() {
        let definition = Definition::parse("palpate_msgs/msg/Belief", BELIEF).unwrap();
        let whole = message(&[0.75]);
        assert!((0..whole.len()).all(|length| definition.decode(&whole[..length]).is_none()));
        assert_eq!(Definition::parse("a/msg/B", "c/D d\n"), None, "D is not defined");
        assert_eq!(Definition::parse("a/msg/B", "B within\nB[] more\nB[3] and_more\n"), None, "it contains itself");
        assert_eq!(Definition::parse("a/msg/B", "uint8[1000000000] image\n"), None, "too wide for a table");
        assert_eq!(Definition::parse("a/msg/B", "float64\n"), None, "no name");
    }
}
