//! Checked JSON to typed fields, with errors that name the place and speak the user's language.
//!
//! A deserializer of its own rather than serde_json's, for four reasons: every error knows its place, down to the
//! index, also inside [`tagged`] objects; it says what was expected in terms of JSON, not of Rust; an object cannot
//! be given as an array of its fields, which serde_json accepts; and numbers go from the text to where they belong,
//! past any tree, so that no line takes many times its length in memory.

use std::borrow::Cow;
use std::fmt::{self, Display};

use serde::de::value::{BorrowedStrDeserializer, CowStrDeserializer, StrDeserializer};
use serde::de::{
    self, Deserialize, DeserializeOwned, DeserializeSeed, Deserializer, Error as _, Expected, Unexpected, Visitor,
};
use serde::forward_to_deserialize_any;
use serde_json::{Number, Value};

use super::error::{InvalidInput, Pointer, QUOTE_CHARS_MAX, elide};
use super::spelling;
use super::text::{self, Json, Shape};

/// What serde calls the expected type, and what it is called in JSON.
const TYPE_NAMES: [(&str, &str); 8] = [
    ("f64", "a finite number"),
    ("usize", "a whole number from 0"),
    ("u64", "a whole number from 0"),
    ("u32", "a whole number from 0"),
    ("i64", "a whole number"),
    ("a boolean", "true or false"),
    ("a sequence", "an array"),
    ("fewer elements in array", "fewer elements"),
];

/// Reads a typed value.
///
/// # Errors
/// [`InvalidInput`], with the place seen from `value`.
pub fn read<T: DeserializeOwned>(value: Value) -> Result<T, InvalidInput> {
    let text = value.to_string();
    // Of a tree only its text is needed any more.
    drop(value);
    Fields::of(Json::of_checked(&text)).read()
}

/// A value that has not been read yet; of an object perhaps not all fields.
#[derive(Clone, Copy, Debug)]
pub struct Fields<'t> {
    json: Json<'t>,
    shown: Shown<'t>,
}

/// Which members of an object are read.
#[derive(Clone, Copy, Debug)]
enum Shown<'t> {
    Without(&'t [&'t str]),
    Only(&'t [&'t str]),
}

impl Shown<'_> {
    fn shows(self, key: &str) -> bool {
        match self {
            Self::Without(names) => !names.contains(&key),
            Self::Only(names) => names.contains(&key),
        }
    }

    /// Whether it shows every member of every object.
    fn is_all(self) -> bool {
        matches!(self, Self::Without([]))
    }
}

impl<'t> Fields<'t> {
    pub(super) fn of(json: Json<'t>) -> Self {
        Self::without(json, &[])
    }

    /// All fields of an object but these.
    pub(super) fn without(json: Json<'t>, names: &'t [&'t str]) -> Self {
        Self { json, shown: Shown::Without(names) }
    }

    /// These fields of an object.
    fn only(json: Json<'t>, names: &'t [&'t str]) -> Self {
        Self { json, shown: Shown::Only(names) }
    }

    /// Reads a typed value.
    ///
    /// # Errors
    /// [`InvalidInput`], with the place seen from here.
    pub fn read<T: Deserialize<'t>>(self) -> Result<T, InvalidInput> {
        T::deserialize(self)
    }

    fn members(self) -> impl Iterator<Item = (Cow<'t, str>, Json<'t>)> {
        self.json.members().filter(move |(key, _)| self.shown.shows(key))
    }

    /// The text of what is read.
    fn text(self) -> Cow<'t, str> {
        if self.shown.is_all() || self.json.shape() != Shape::Object {
            return Cow::Borrowed(self.json.text());
        }
        let mut text = String::with_capacity(self.json.text().len());
        text::write_members(self.members(), &mut text);
        Cow::Owned(text)
    }
}

/// Any value as its text: what is read twice, or by a field of its own first.
struct Unread<'de>(Cow<'de, str>);

/// By this name a deserializer of this module knows that its text is wanted. Others see a newtype of any value.
const UNREAD: &str = "palpate_files::solve::Unread";

impl<'de> Deserialize<'de> for Unread<'de> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Text;

        impl<'de> Visitor<'de> for Text {
            type Value = Unread<'de>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("JSON")
            }

            fn visit_borrowed_str<E>(self, text: &'de str) -> Result<Unread<'de>, E> {
                Ok(Unread(text.into()))
            }

            fn visit_str<E>(self, text: &str) -> Result<Unread<'de>, E> {
                Ok(Unread(text.to_owned().into()))
            }

            fn visit_string<E>(self, text: String) -> Result<Unread<'de>, E> {
                Ok(Unread(text.into()))
            }

            fn visit_newtype_struct<D: Deserializer<'de>>(self, deserializer: D) -> Result<Unread<'de>, D::Error> {
                Value::deserialize(deserializer).map(|value| Unread(value.to_string().into()))
            }
        }

        deserializer.deserialize_newtype_struct(UNREAD, Text)
    }
}

impl Unread<'_> {
    fn json(&self) -> Json<'_> {
        Json::of_checked(&self.0)
    }
}

/// One variant of an object that says in one field which variant it is: the name and how to read the other fields.
pub type Variant<T> = (&'static str, fn(Fields<'_>) -> Result<T, InvalidInput>);

/// Reads an object whose field `tag` names the variant.
///
/// Accepts what `#[serde(tag = "…")]` accepts, but keeps the place of an error inside the variant, which serde's own
/// version loses. Derive the schema with `#[schemars(tag = "…")]`.
///
/// # Errors
/// Those of the variant, of a missing `tag` and of an unknown variant.
///
/// ```
/// use palpate_files::solve::{read, tagged};
///
/// #[derive(Debug, PartialEq)]
/// enum Shape { Disk(Disk) }
/// #[derive(Debug, PartialEq, serde::Deserialize)]
/// #[serde(deny_unknown_fields)]
/// struct Disk { radius: f64 }
///
/// impl<'de> serde::Deserialize<'de> for Shape {
///     fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
///         tagged(deserializer, "type", &[("disk", |fields| fields.read().map(Shape::Disk))])
///     }
/// }
///
/// let shape: Shape = read(serde_json::json!({"type": "disk", "radius": 0.015})).unwrap();
/// assert_eq!(shape, Shape::Disk(Disk { radius: 0.015 })); // m
/// let error = read::<Shape>(serde_json::json!({"type": "disk", "radius": "big"})).unwrap_err();
/// assert!(error.to_string().starts_with(r#"at "/radius": "#));
/// ```
pub fn tagged<'de, D: Deserializer<'de>, T>(
    deserializer: D,
    tag: &'static str,
    variants: &[Variant<T>],
) -> Result<T, D::Error> {
    let unread = Unread::deserialize(deserializer)?;
    read_tagged(unread.json(), tag, variants).map_err(D::Error::custom)
}

fn read_tagged<T>(json: Json<'_>, tag: &'static str, variants: &[Variant<T>]) -> Result<T, InvalidInput> {
    let names: Vec<_> = variants.iter().map(|&(name, _)| name).collect();
    if json.shape() != Shape::Object {
        let expected = format!("an object whose field `{tag}` is one of {}", list(&names));
        return Err(mistaken(json, &expected.as_str()));
    }
    let Some(chosen) = json.member(tag) else {
        return Err(InvalidInput::missing(tag, &format!("give one of {}", list(&names))));
    };
    let is_name = chosen.shape() == Shape::String;
    let name = if is_name { chosen.string() } else { chosen.text().into() };
    match variants.iter().find(|&&(known, _)| is_name && name == known) {
        Some((_, read_variant)) => read_variant(Fields::without(json, &[tag])),
        None => Err(InvalidInput::at(tag, unknown_name(&name, &names))),
    }
}

/// Reads an object by what its field `tag` says: `named` without that field if it is `name`, otherwise the whole with
/// `others`. What is all but that name is taken for a slip.
///
/// # Errors
/// Those of either.
pub(super) fn named_or<'de, D: Deserializer<'de>, T>(
    deserializer: D,
    tag: &'static str,
    (name, named): Variant<T>,
    others: fn(Fields<'_>) -> Result<T, InvalidInput>,
) -> Result<T, D::Error> {
    let unread = Unread::deserialize(deserializer)?;
    let json = unread.json();
    let is_object = json.shape() == Shape::Object;
    let chosen = is_object.then(|| json.member(tag)).flatten();
    let word = chosen.filter(|chosen| chosen.shape() == Shape::String).map(|chosen| chosen.string());
    let read = match word {
        Some(word) if word == name => named(Fields::without(json, &[tag])),
        // The others would not name this one.
        Some(word) if spelling::nearest(&word, [name]).is_some() => {
            Err(InvalidInput::at(tag, format!("`{word}` is none: did you mean `{name}`?")))
        }
        _ => others(Fields::of(json)),
    };
    read.map_err(D::Error::custom)
}

/// Reads what is either a word or something else: `Ok` the word, if it is one of a string, `Err` the other thing.
///
/// # Errors
/// Those of the other thing.
pub(super) fn word_or<'de, D: Deserializer<'de>, T: DeserializeOwned>(
    deserializer: D,
) -> Result<Result<String, T>, D::Error> {
    let unread = Unread::deserialize(deserializer)?;
    match unread.json().shape() {
        Shape::String => Ok(Ok(unread.json().string().into_owned())),
        _ => Fields::of(unread.json()).read().map(Err).map_err(D::Error::custom),
    }
}

/// Reads one object as two structs of different fields, as if all were those of one.
///
/// What serde calls flattening, but with the place of every error, and with a field that neither struct has refused.
pub(super) fn read_side_by_side<'de, D, A, B>(deserializer: D) -> Result<(A, B), D::Error>
where
    D: Deserializer<'de>,
    A: DeserializeOwned,
    B: DeserializeOwned,
{
    let unread = Unread::deserialize(deserializer)?;
    split(unread.json()).map_err(D::Error::custom)
}

fn split<A: DeserializeOwned, B: DeserializeOwned>(json: Json<'_>) -> Result<(A, B), InvalidInput> {
    if json.shape() != Shape::Object {
        return Err(mistaken(json, &"an object"));
    }
    let (of_first, of_second) = (field_names::<A>(), field_names::<B>());
    let known: Vec<_> = of_first.iter().chain(of_second).copied().collect();
    let stranger = json.members().map(|(key, _)| key).find(|key| !known.contains(&&**key));
    let stranger = stranger.map(|key| not_a_field(&key, &known));
    match (Fields::only(json, of_first).read(), Fields::without(json, of_first).read(), stranger) {
        (Ok(first), Ok(second), None) => Ok((first, second)),
        (first, second, stranger) => {
            // A struct tells of the first field that is wrong; only where all are good, of one that is missing.
            let place = |error: &InvalidInput| {
                let key = error.field().and_then(Pointer::first_key);
                key.and_then(|key| json.members().position(|(other, _)| other == key)).unwrap_or(usize::MAX)
            };
            // The second struct refuses what is no field of its own, too, but knows its own fields only.
            let errors = stranger.into_iter().chain(first.err()).chain(second.err());
            Err(errors.min_by_key(place).unwrap_or_else(|| InvalidInput::new("cannot be read")))
        }
    }
}

/// The names of a struct's fields, as it tells them to any deserializer; none for other types.
fn field_names<T: DeserializeOwned>() -> &'static [&'static str] {
    let mut names = Names(&[]);
    // Whatever is read from nothing: only the names that it asks for count.
    let _ = T::deserialize(&mut names);
    names.0
}

/// A deserializer that gives nothing and notes what fields it is asked for.
struct Names(&'static [&'static str]);

impl<'de> Deserializer<'de> for &mut Names {
    type Error = InvalidInput;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, InvalidInput> {
        visitor.visit_unit()
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, InvalidInput> {
        self.0 = fields;
        self.deserialize_any(visitor)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option newtype_struct enum
        unit unit_struct seq tuple tuple_struct map identifier ignored_any
    }
}

/// The deserializer.
impl<'de> Deserializer<'de> for Fields<'de> {
    type Error = InvalidInput;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, InvalidInput> {
        match self.json.shape() {
            Shape::Null => visitor.visit_unit(),
            Shape::Bool(value) => visitor.visit_bool(value),
            Shape::Number => visit_number(&self.json.number(), visitor),
            Shape::String => match self.json.string() {
                Cow::Borrowed(text) => visitor.visit_borrowed_str(text),
                Cow::Owned(text) => visitor.visit_string(text),
            },
            Shape::Array => visit_array(self.json, visitor),
            Shape::Object => visitor.visit_map(Members { rest: self.members(), current: None }),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, InvalidInput> {
        if self.json.is_null() { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        visitor: V,
    ) -> Result<V::Value, InvalidInput> {
        match name {
            UNREAD => match self.text() {
                Cow::Borrowed(text) => visitor.visit_borrowed_str(text),
                Cow::Owned(text) => visitor.visit_string(text),
            },
            _ => visitor.visit_newtype_struct(self),
        }
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, InvalidInput> {
        match self.json.shape() {
            Shape::Object => self.deserialize_any(visitor),
            _ => Err(mistaken(self.json, &"an object")),
        }
    }

    /// A name, or an object of one field whose name is the variant's.
    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, InvalidInput> {
        match self.json.shape() {
            Shape::String => visitor.visit_enum(Choice { variant: self.json.string(), content: None }),
            Shape::Object => {
                let mut members = self.members();
                match (members.next(), members.next()) {
                    (Some((variant, content)), None) => visitor.visit_enum(Choice { variant, content: Some(content) }),
                    _ => Err(InvalidInput::new(format!("expected exactly one of the fields {}", list(variants)))),
                }
            }
            _ => Err(mistaken(self.json, &format!("one of {}", list(variants)).as_str())),
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf
        unit unit_struct seq tuple tuple_struct map identifier ignored_any
    }
}

fn visit_number<'de, V: Visitor<'de>>(number: &Number, visitor: V) -> Result<V::Value, InvalidInput> {
    match kind_of_number(number) {
        Unexpected::Signed(value) => visitor.visit_i64(value),
        Unexpected::Unsigned(value) => visitor.visit_u64(value),
        Unexpected::Float(value) => visitor.visit_f64(value),
        other => Err(InvalidInput::invalid_type(other, &visitor)),
    }
}

fn visit_array<'de, V: Visitor<'de>>(array: Json<'de>, visitor: V) -> Result<V::Value, InvalidInput> {
    let mut elements = Elements { rest: array.elements(), next: 0 };
    let value = visitor.visit_seq(&mut elements)?;
    match elements.rest.count() {
        0 => Ok(value),
        more => Err(InvalidInput::invalid_length(elements.next + more, &"fewer elements")),
    }
}

/// Inside an array.
struct Elements<'de> {
    rest: text::Elements<'de>,
    next: usize,
}

impl<'de> de::SeqAccess<'de> for Elements<'de> {
    type Error = InvalidInput;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, InvalidInput> {
        let Some(value) = self.rest.next() else { return Ok(None) };
        let index = self.next;
        self.next += 1;
        seed.deserialize(Fields::of(value)).map(Some).map_err(|error| error.below(Pointer::default().index(index)))
    }
}

/// Inside an object.
struct Members<'de, I> {
    rest: I,
    current: Option<(Cow<'de, str>, Json<'de>)>,
}

impl<'de, I: Iterator<Item = (Cow<'de, str>, Json<'de>)>> de::MapAccess<'de> for Members<'de, I> {
    type Error = InvalidInput;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, InvalidInput> {
        let Some((key, value)) = self.rest.next() else { return Ok(None) };
        let read = match &key {
            Cow::Borrowed(key) => seed.deserialize(BorrowedStrDeserializer::new(key)),
            Cow::Owned(key) => seed.deserialize(StrDeserializer::new(key)),
        };
        self.current = Some((key, value));
        read.map(Some)
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, InvalidInput> {
        let Some((key, value)) = self.current.take() else { return Err(InvalidInput::new("has no value")) };
        seed.deserialize(Fields::of(value)).map_err(|error| error.inside(&key))
    }
}

/// The variant of an enum.
struct Choice<'de> {
    variant: Cow<'de, str>,
    content: Option<Json<'de>>,
}

impl<'de> de::EnumAccess<'de> for Choice<'de> {
    type Error = InvalidInput;
    type Variant = Self;

    fn variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<(T::Value, Self), InvalidInput> {
        let name = CowStrDeserializer::<InvalidInput>::new(self.variant.clone());
        Ok((seed.deserialize(name)?, self))
    }
}

impl<'de> Choice<'de> {
    fn read<T>(self, read: impl FnOnce(Fields<'de>) -> Result<T, InvalidInput>) -> Result<T, InvalidInput> {
        match self.content {
            Some(content) => read(Fields::of(content)).map_err(|error| error.inside(&self.variant)),
            None => Err(InvalidInput::new(format!("`{0}` needs a value: {{\"{0}\": ...}}", self.variant))),
        }
    }
}

impl<'de> de::VariantAccess<'de> for Choice<'de> {
    type Error = InvalidInput;

    fn unit_variant(self) -> Result<(), InvalidInput> {
        match self.content {
            None => Ok(()),
            Some(_) => Err(InvalidInput::at(&*self.variant, format!("takes no value: write \"{}\"", self.variant))),
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, InvalidInput> {
        self.read(|content| seed.deserialize(content))
    }

    fn tuple_variant<V: Visitor<'de>>(self, _len: usize, visitor: V) -> Result<V::Value, InvalidInput> {
        self.read(|content| content.deserialize_any(visitor))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, InvalidInput> {
        self.read(|content| content.deserialize_struct("", fields, visitor))
    }
}

impl de::Error for InvalidInput {
    fn custom<T: Display>(message: T) -> Self {
        Self::from_text(&message.to_string())
    }

    fn invalid_type(got: Unexpected<'_>, expected: &dyn Expected) -> Self {
        let expected = expected.to_string();
        let known = TYPE_NAMES.iter().find(|(rust, _)| *rust == expected);
        Self::new(format!("got {}, expected {}", describe(got), known.map_or(expected.as_str(), |&(_, json)| json)))
    }

    fn invalid_value(got: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::invalid_type(got, expected)
    }

    fn invalid_length(length: usize, expected: &dyn Expected) -> Self {
        let expected = expected.to_string();
        let known = TYPE_NAMES.iter().find(|(rust, _)| *rust == expected);
        Self::new(format!("got length {length}, expected {}", known.map_or(expected.as_str(), |&(_, json)| json)))
    }

    fn unknown_variant(variant: &str, expected: &'static [&'static str]) -> Self {
        Self::new(unknown_name(variant, expected))
    }

    fn unknown_field(field: &str, expected: &'static [&'static str]) -> Self {
        not_a_field(field, expected)
    }

    fn missing_field(field: &'static str) -> Self {
        Self::missing(field, "this field is required")
    }
}

/// A value that is not what was expected.
fn mistaken(json: Json<'_>, expected: &dyn Expected) -> InvalidInput {
    let string;
    let got = match json.shape() {
        Shape::Null => Unexpected::Unit,
        Shape::Bool(value) => Unexpected::Bool(value),
        Shape::Number => kind_of_number(&json.number()),
        Shape::String => {
            string = json.string();
            Unexpected::Str(&string)
        }
        Shape::Array => Unexpected::Seq,
        Shape::Object => Unexpected::Map,
    };
    InvalidInput::invalid_type(got, expected)
}

/// A number in the narrowest of serde's three types.
fn kind_of_number(number: &Number) -> Unexpected<'static> {
    let signed = number.as_i64().map(Unexpected::Signed);
    let whole = signed.or_else(|| number.as_u64().map(Unexpected::Unsigned));
    whole.or_else(|| number.as_f64().map(Unexpected::Float)).unwrap_or(Unexpected::Other("a number"))
}

fn describe(got: Unexpected<'_>) -> String {
    match got {
        Unexpected::Unit => "null".to_owned(),
        Unexpected::Bool(value) => value.to_string(),
        Unexpected::Unsigned(value) => value.to_string(),
        Unexpected::Signed(value) => value.to_string(),
        Unexpected::Float(value) => format!("{value:?}"),
        Unexpected::Str(text) => format!("the string {:?}", elide(text, QUOTE_CHARS_MAX)),
        Unexpected::Seq => "an array".to_owned(),
        Unexpected::Map => "an object".to_owned(),
        other => other.to_string(),
    }
}

/// Says that a name is none of those known, suggests the nearest and lists them.
fn unknown_name(name: &str, known: &[&str]) -> String {
    let shown = elide(name, QUOTE_CHARS_MAX);
    format!("`{shown}` is not known: {}expected one of {}", hint(name, known), list(known))
}

/// Says that an object has a field it cannot have, suggests the nearest and lists them.
fn not_a_field(field: &str, known: &[&str]) -> InvalidInput {
    InvalidInput::not_a_field(field, &hint(field, known), &list(known))
}

fn hint(name: &str, known: &[&str]) -> String {
    let near = spelling::nearest(name, known.iter().copied());
    near.map(|near| format!("did you mean `{near}`? ")).unwrap_or_default()
}

fn list(names: &[&str]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde::Deserialize;
    use serde_json::json;

    use super::super::testing::any_json;
    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only reading is tested")]
    struct Push {
        mode: Mode,
        edge: usize,
        path: Vec<[f64; 2]>,
        tip: Tip,
        choice: Option<Choice>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "snake_case")]
    #[expect(dead_code, reason = "only reading is tested")]
    enum Choice {
        Ball(Disk),
        None,
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Mode {
        Rolling,
        Sliding,
    }

    #[derive(Debug)]
    #[expect(dead_code, reason = "only reading is tested")]
    enum Tip {
        Disk(Disk),
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only reading is tested")]
    struct Disk {
        radius: f64,
    }

    impl<'de> Deserialize<'de> for Tip {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            tagged(deserializer, "type", &[("disk", |fields| fields.read().map(Tip::Disk))])
        }
    }

    /// A good problem with one field changed (`None`: left out).
    fn refuse(field: &str, value: Option<Value>) -> String {
        let mut good = json!({"mode": "rolling", "edge": 0, "path": [[0, 1]], "tip": {"type": "disk", "radius": 0.01}});
        assert!(read::<Push>(good.clone()).is_ok());
        match value {
            Some(value) => good[field] = value,
            None => drop(good.as_object_mut().unwrap().remove(field)),
        }
        read::<Push>(good).unwrap_err().to_string()
    }

    #[test]
    fn every_mistake_is_told_at_its_place_in_terms_of_json() {
        let cases = [
            ("edge", None, r#"at "/edge": is missing: this field is required"#),
            ("edge", Some(json!(0.5)), r#"at "/edge": got 0.5, expected a whole number from 0"#),
            ("edge", Some(json!(-1)), r#"at "/edge": got -1, expected a whole number from 0"#),
            (
                "path",
                Some(json!([[0, 1], [2, "map"]])),
                r#"at "/path/1/1": got the string "map", expected a finite number"#,
            ),
            ("path", Some(json!([[0, null]])), r#"at "/path/0/1": got null, expected a finite number"#),
            ("path", Some(json!([[0]])), r#"at "/path/0": got length 1, expected an array of length 2"#),
            ("path", Some(json!([[0, 1, 2]])), r#"at "/path/0": got length 3, expected fewer elements"#),
            ("path", Some(json!({})), r#"at "/path": got an object, expected an array"#),
            (
                "mode",
                Some(json!("roling")),
                r#"at "/mode": `roling` is not known: did you mean `rolling`? expected one of `rolling`, `sliding`"#,
            ),
            (
                "pth",
                Some(json!(1)),
                r#"at "/pth": is not a field here: did you mean `path`? allowed: `mode`, `edge`, `path`, `tip`, `choice`"#,
            ),
            ("tip", Some(json!({"type": "disk"})), r#"at "/tip/radius": is missing: this field is required"#),
            (
                "tip",
                Some(json!({"type": "disk", "radius": []})),
                r#"at "/tip/radius": got an array, expected a finite number"#,
            ),
            (
                "tip",
                Some(json!({"type": "disk", "radius": 1, "a": 2})),
                r#"at "/tip/a": is not a field here: allowed: `radius`"#,
            ),
            ("tip", Some(json!({"radius": 1})), r#"at "/tip/type": is missing: give one of `disk`"#),
            (
                "tip",
                Some(json!({"type": "disc"})),
                r#"at "/tip/type": `disc` is not known: did you mean `disk`? expected one of `disk`"#,
            ),
            ("tip", Some(json!({"type": 7})), r#"at "/tip/type": `7` is not known: expected one of `disk`"#),
            ("choice", Some(json!("cube")), r#"at "/choice": `cube` is not known: expected one of `ball`, `none`"#),
            ("choice", Some(json!("ball")), r#"at "/choice": `ball` needs a value: {"ball": ...}"#),
            ("choice", Some(json!({"none": 1})), r#"at "/choice/none": takes no value: write "none""#),
            (
                "choice",
                Some(json!({"ball": {"radius": true}})),
                r#"at "/choice/ball/radius": got true, expected a finite number"#,
            ),
            ("choice", Some(json!({"ball": [0.1]})), r#"at "/choice/ball": got an array, expected an object"#),
            (
                "choice",
                Some(json!({"ball": 1, "none": 1})),
                r#"at "/choice": expected exactly one of the fields `ball`, `none`"#,
            ),
            ("choice", Some(json!([])), r#"at "/choice": got an array, expected one of `ball`, `none`"#),
            ("tip", Some(json!(3)), r#"at "/tip": got 3, expected an object whose field `type` is one of `disk`"#),
        ];
        for (field, value, expected) in cases {
            assert_eq!(refuse(field, value.clone()), expected, "{field} = {value:?}");
        }
    }

    #[test]
    fn a_name_full_of_traps_is_still_told_at_its_place() {
        let trap = r#"x`, expected one of `a`, at "/b": y"#;
        let told = refuse(trap, Some(json!(1)));
        assert!(
            told.starts_with(&format!("at {}: is not a field here", json!(Pointer::from(trap).as_str()))),
            "{told}"
        );
    }

    #[test]
    fn a_long_value_does_not_hide_what_was_expected() {
        let told = refuse("edge", Some(json!("z".repeat(100_000))));
        assert!(told.ends_with("expected a whole number from 0") && told.len() < 1000, "{told}");
    }

    /// The fields of [`Push`], as two structs.
    #[derive(Debug, Deserialize)]
    #[expect(dead_code, reason = "only reading is tested")]
    struct Where {
        edge: usize,
        path: Vec<[f64; 2]>,
        tip: Tip,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only reading is tested")]
    struct How {
        mode: Mode,
        choice: Option<Choice>,
    }

    struct Both;

    impl<'de> Deserialize<'de> for Both {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            read_side_by_side::<_, Where, How>(deserializer).map(|_| Self)
        }
    }

    /// But for the order in which they list the fields and miss them.
    #[test]
    fn two_structs_side_by_side_are_read_as_one_of_all_their_fields() {
        let good = json!({"mode": "rolling", "edge": 0, "path": [[0, 1]], "tip": {"type": "disk", "radius": 0.01}});
        let wrong = [json!(null), json!(-1), json!("ball"), json!([[0, null]]), json!({"type": "disk"}), json!({})];
        let names = ["mode", "edge", "path", "tip", "choice", "a", "pth", "zeal", "moda"];
        let mut problems = vec![good.clone(), json!([]), json!(1)];
        for (name, value) in names.iter().flat_map(|name| wrong.iter().map(move |value| (name, value))) {
            let mut one = good.clone();
            one[*name] = value.clone();
            for other in names {
                let mut two = one.clone();
                two[other] = json!("?");
                problems.push(two);
            }
            problems.push(one);
        }
        for name in ["mode", "edge", "path", "tip"] {
            let mut lean = good.clone();
            lean.as_object_mut().unwrap().remove(name);
            problems.push(lean);
        }
        let told = |error: InvalidInput| {
            let whole = error.to_string();
            whole.split_once("allowed: ").map_or(whole.clone(), |(told, list)| {
                let mut names: Vec<_> = list.split(", ").collect();
                names.sort_unstable();
                format!("{told}{names:?}")
            })
        };
        for problem in problems {
            let (one, two) = (read::<Push>(problem.clone()).err(), read::<Both>(problem.clone()).err());
            assert_eq!(two.map(told), one.map(told), "{problem}");
        }
    }

    proptest! {
        #[test]
        fn any_json_is_read_as_it_is(value in any_json()) {
            prop_assert_eq!(read::<Value>(value.clone()), Ok(value));
        }
    }
}
