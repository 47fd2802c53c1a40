//! JSON as the text that it is: elements and members one after the other, without a tree of them in memory.
//!
//! For text whose grammar has been checked (see `line`), which it then only divides. A tree takes up to a hundred times the
//! memory of its text; this takes none. What is divided is gone through once for each level at which it is read, of
//! which a type has a few, so the work is in proportion to the text.

use std::borrow::Cow;

use serde_json::Number;

/// A checked value, without white space around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Json<'t>(&'t str);

/// What a value is, as far as its first letter says so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    Null,
    Bool(bool),
    Number,
    String,
    Array,
    Object,
}

impl<'t> Json<'t> {
    /// Takes text that is known to be one value.
    pub(super) fn of_checked(text: &'t str) -> Self {
        Self(text.trim_matches(is_space))
    }

    pub(super) fn text(self) -> &'t str {
        self.0
    }

    pub(super) fn shape(self) -> Shape {
        match self.0.bytes().next() {
            Some(b'n') | None => Shape::Null,
            Some(b't') => Shape::Bool(true),
            Some(b'f') => Shape::Bool(false),
            Some(b'"') => Shape::String,
            Some(b'[') => Shape::Array,
            Some(b'{') => Shape::Object,
            Some(_) => Shape::Number,
        }
    }

    pub(super) fn is_null(self) -> bool {
        self.shape() == Shape::Null
    }

    /// What a string says.
    pub(super) fn string(self) -> Cow<'t, str> {
        let inside = self.0.get(1..self.0.len().saturating_sub(1)).unwrap_or_default();
        match inside.contains('\\') {
            true => Cow::Owned(serde_json::from_str(self.0).unwrap_or_default()),
            false => Cow::Borrowed(inside),
        }
    }

    /// What a number says.
    pub(super) fn number(self) -> Number {
        serde_json::from_str(self.0).unwrap_or_else(|_| Number::from(0))
    }

    /// The elements of an array; of anything else none.
    pub(super) fn elements(self) -> Elements<'t> {
        Elements { rest: self.0.strip_prefix('[').unwrap_or_default() }
    }

    /// The members of an object in their order; of anything else none.
    pub(super) fn members(self) -> Members<'t> {
        Members(Elements { rest: self.0.strip_prefix('{').unwrap_or_default() })
    }

    /// The member of this key.
    pub(super) fn member(self, key: &str) -> Option<Self> {
        self.members().find(|(name, _)| name == key).map(|(_, value)| value)
    }
}

/// The rest of an array, from an element, a comma or the closing bracket on.
#[derive(Clone, Debug)]
pub(super) struct Elements<'t> {
    rest: &'t str,
}

impl<'t> Iterator for Elements<'t> {
    type Item = Json<'t>;

    fn next(&mut self) -> Option<Json<'t>> {
        let rest = self.rest.trim_start_matches(|c| is_space(c) || c == ',');
        let (value, rest) = rest.split_at_checked(length(rest.as_bytes()))?;
        self.rest = rest;
        (!value.is_empty()).then_some(Json(value))
    }
}

/// The rest of an object.
#[derive(Clone, Debug)]
pub(super) struct Members<'t>(Elements<'t>);

impl<'t> Iterator for Members<'t> {
    type Item = (Cow<'t, str>, Json<'t>);

    fn next(&mut self) -> Option<Self::Item> {
        let key = self.0.next()?;
        self.0.rest = self.0.rest.trim_start_matches(|c| is_space(c) || c == ':');
        Some((key.string(), self.0.next()?))
    }
}

/// Writes an object of these members.
pub(super) fn write_members<'t>(members: impl Iterator<Item = (Cow<'t, str>, Json<'t>)>, out: &mut String) {
    write_object(members, out, |_, value, out| *out += value.text());
}

/// Writes an object of these members, the values as `write` has them.
fn write_object<'t>(
    members: impl Iterator<Item = (Cow<'t, str>, Json<'t>)>,
    out: &mut String,
    mut write: impl FnMut(&str, Json<'t>, &mut String),
) {
    out.push('{');
    for (index, (key, value)) in members.enumerate() {
        if index > 0 {
            out.push(',');
        }
        write_key(&key, out);
        write(&key, value, out);
    }
    out.push('}');
}

fn write_key(key: &str, out: &mut String) {
    // A string can always be written.
    *out += &serde_json::to_string(key).unwrap_or_default();
    out.push(':');
}

/// The same without the member that the segments of a pointer lead to, where it is null, and with it the same member of
/// all other elements of the arrays on the way; none where nothing is left out. So a field is taken out once, however
/// often it is given.
pub(super) fn without_nulls(json: Json<'_>, segments: &[String]) -> Option<String> {
    let mut out = String::with_capacity(json.text().len());
    write_without_nulls(json, segments, &mut out).then_some(out)
}

fn write_without_nulls(json: Json<'_>, segments: &[String], out: &mut String) -> bool {
    let mut is_leaner = false;
    match (segments, json.shape()) {
        ([key], Shape::Object) => {
            let stays = |(name, value): &(Cow<'_, str>, Json<'_>)| !(name == key && value.is_null());
            is_leaner = !json.members().all(|member| stays(&member));
            write_members(json.members().filter(stays), out);
        }
        ([key, inner @ ..], Shape::Object) => write_object(json.members(), out, |name, value, out| match name == key {
            true => is_leaner |= write_without_nulls(value, inner, out),
            false => *out += value.text(),
        }),
        ([_, inner @ ..], Shape::Array) => {
            out.push('[');
            for (index, element) in json.elements().enumerate() {
                if index > 0 {
                    out.push(',');
                }
                is_leaner |= write_without_nulls(element, inner, out);
            }
            out.push(']');
        }
        _ => *out += json.text(),
    }
    is_leaner
}

fn is_space(c: char) -> bool {
    matches!(c, ' ' | '\t' | '\r' | '\n')
}

/// Bytes of the value at the start; none before a closing bracket or the end.
fn length(text: &[u8]) -> usize {
    match text.first() {
        Some(b'"') => length_of_string(text),
        Some(b'[' | b'{') => length_of_nested(text),
        _ => text.iter().position(|byte| b",:]} \t\r\n".contains(byte)).unwrap_or(text.len()),
    }
}

fn length_of_string(text: &[u8]) -> usize {
    let mut at = 1;
    loop {
        match text.get(at) {
            Some(b'\\') => at += 2,
            Some(b'"') => return at + 1,
            Some(_) => at += 1,
            None => return text.len(),
        }
    }
}

fn length_of_nested(text: &[u8]) -> usize {
    let (mut at, mut depth) = (0, 0_usize);
    while let Some(byte) = text.get(at) {
        match byte {
            b'"' => at += length_of_string(text.get(at..).unwrap_or_default()),
            b'[' | b'{' => {
                depth += 1;
                at += 1;
            }
            b']' | b'}' => {
                depth -= 1;
                at += 1;
                if depth == 0 {
                    return at;
                }
            }
            _ => at += 1,
        }
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::{Map, Value};

    use super::super::testing::any_json;
    use super::*;

    /// The tree that the text stands for.
    fn tree(json: Json<'_>) -> Value {
        match json.shape() {
            Shape::Null => Value::Null,
            Shape::Bool(value) => value.into(),
            Shape::Number => Value::Number(json.number()),
            Shape::String => json.string().into(),
            Shape::Array => json.elements().map(tree).collect(),
            Shape::Object => {
                Value::Object(json.members().map(|(key, value)| (key.into_owned(), tree(value))).collect::<Map<_, _>>())
            }
        }
    }

    proptest! {
        #[test]
        fn any_json_is_divided_into_what_it_was_made_of(value in any_json()) {
            for text in [value.to_string(), format!(" {value:#}\t").replace('\n', "\r")] {
                prop_assert_eq!(tree(Json::of_checked(&text)), value.clone(), "{}", text);
            }
        }

        /// Text that was not checked is divided somehow, without a crash and without going on for ever.
        #[test]
        fn any_text_is_divided_somehow(text in r#"[\[\]{}",:\\0-9ntf é]{0,40}"#) {
            tree(Json::of_checked(&text));
        }
    }
}
