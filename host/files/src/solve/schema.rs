//! JSON Schema (draft 2020-12) of everything that goes into and comes out of `palpate solve`.

use schemars::Schema;
use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;
use serde_json::{Map, Value, json};

use super::error::{ErrorLine, TIME_LIMIT};
use super::problem::{KindSchema, Problem, Registry};

/// What `palpate solve --schema` prints: every kind by name with its `problem` and `result`, what all problems have in
/// common, and the error line. Each schema stands on its own.
#[must_use]
pub fn document(registry: &Registry) -> Value {
    let kinds: Map<String, Value> =
        registry.kinds().iter().map(|kind| (kind.name().to_owned(), json!(kind.schema()))).collect();
    json!({
        "title": "palpate solve: one problem a line in, one result or error a line out",
        "version": env!("CARGO_PKG_VERSION"),
        "kinds": kinds,
        "problem": any_problem(registry),
        "error": error(),
    })
}

/// The schema of a line that reports an error.
#[must_use]
pub fn error() -> Schema {
    settings().for_serialize().into_generator().into_root_schema_for::<ErrorLine>()
}

fn settings() -> SchemaSettings {
    SchemaSettings::draft2020_12().with_transform(RecursiveTransform(describe_in_words))
}

/// Keeps of a description, which is the doc comment of a type, what speaks to those who write JSON: the text before the
/// first example and the first heading, both of which are about Rust.
fn describe_in_words(schema: &mut Schema) {
    let Some(Value::String(description)) = schema.get_mut("description") else { return };
    let ends = ["```", "\n#"].map(|mark| description.find(mark).unwrap_or(description.len()));
    description.truncate(ends.into_iter().min().unwrap_or_default());
    description.truncate(description.trim_end().len());
}

/// What every problem has, whatever its kind.
fn any_problem(registry: &Registry) -> Value {
    let names: Vec<_> = registry.names().collect();
    // An empty `enum` is bad style in JSON Schema, and a fair number of validators refuse it.
    let kind = if names.is_empty() { json!({"type": "string"}) } else { json!({"enum": names}) };
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "type": "object",
        "properties": {"problem": kind, "id": id(), TIME_LIMIT: time_limit()},
        "required": ["problem"],
    })
}

fn id() -> Value {
    json!({"description": "Any JSON value; the result repeats it."})
}

fn time_limit() -> Value {
    json!({
        "description": "How long to work on this problem, s. A search that is broken off then says `\"complete\": false`.",
        "type": "number",
        "minimum": 0,
    })
}

fn complete() -> Value {
    json!({"description": "There if the search was broken off, or cannot exclude others: nothing is excluded by not being listed.", "const": false})
}

/// The schemas of one kind.
pub(super) fn of<P: Problem>() -> KindSchema {
    let problem = settings().into_generator().into_root_schema_for::<P>();
    let result = settings().for_serialize().into_generator().into_root_schema_for::<P::Answer>();
    KindSchema {
        problem: with_envelope(problem, P::KIND, &["problem"], (TIME_LIMIT, time_limit())),
        result: with_envelope(result, P::KIND, &["id", "problem"], ("complete", complete())),
    }
}

/// Adds the fields that the frame adds.
fn with_envelope(mut schema: Schema, kind: &str, required: &[&str], optional: (&str, Value)) -> Schema {
    let object = schema.ensure_object();
    add_fields(object, kind, required, &optional);
    schema
}

fn add_fields(object: &mut Map<String, Value>, kind: &str, required: &[&str], optional: &(&str, Value)) {
    // The variants of an enum are objects of their own, and each forbids fields that it does not list.
    for variants in ["oneOf", "anyOf"] {
        let Some(Value::Array(variants)) = object.get_mut(variants) else { continue };
        let objects = variants.iter_mut().filter_map(Value::as_object_mut);
        objects.for_each(|variant| add_fields(variant, kind, required, optional));
        return;
    }
    if let Value::Object(properties) = object.entry("properties").or_insert_with(|| json!({})) {
        properties.insert("problem".to_owned(), json!({"const": kind}));
        properties.insert("id".to_owned(), id());
        properties.entry(optional.0).or_insert_with(|| optional.1.clone());
    }
    if let Value::Array(names) = object.entry("required").or_insert_with(|| json!([])) {
        names.extend(required.iter().map(|&name| json!(name)));
    }
}

#[cfg(test)]
mod tests {
    use super::super::KINDS;
    use super::super::testing;
    use super::*;

    #[test]
    fn a_kind_comes_with_problem_and_result() {
        let document = document(&testing::KINDS);
        let area = &document["kinds"]["area"];
        assert_eq!(area["problem"]["properties"]["problem"], json!({"const": "area"}));
        assert_eq!(area["problem"]["required"], json!(["polygon", "problem"]));
        assert_eq!(area["problem"]["additionalProperties"], json!(false));
        assert_eq!(area["problem"]["$defs"]["Polygon"]["minItems"], json!(3));
        assert_eq!(area["result"]["required"], json!(["area", "id", "problem"]));
        assert!(document["problem"]["properties"]["problem"]["enum"].as_array().unwrap().contains(&json!("area")));
    }

    #[test]
    fn the_error_line_is_described_without_any_kind() {
        let document = document(&Registry::new(&[]));
        assert_eq!(document["kinds"], json!({}));
        assert_eq!(document["error"]["required"], json!(["id", "line", "error"]));
        let codes = document["error"]["$defs"]["ErrorCode"].to_string();
        for code in ["invalid_json", "unknown_problem", "invalid_input", "time_limit", "internal"] {
            assert!(codes.contains(code), "{code} is not in {codes}");
        }
    }

    /// Every `description`, however deep.
    fn descriptions(value: &Value, found: &mut Vec<String>) {
        match value {
            Value::Object(object) => {
                found.extend(object.get("description").and_then(Value::as_str).map(str::to_owned));
                object.values().for_each(|value| descriptions(value, found));
            }
            Value::Array(array) => array.iter().for_each(|value| descriptions(value, found)),
            _ => {}
        }
    }

    #[test]
    fn descriptions_are_about_json_and_not_about_rust() {
        let mut found = Vec::new();
        descriptions(&document(&KINDS), &mut found);
        assert!(found.iter().any(|text| text == "How a part slides on a plane."));
        for text in found {
            assert!(!["```", "# ", "[`", "use palpate"].iter().any(|rust| text.contains(rust)), "{text}");
            assert!(!text.is_empty() && text == text.trim_end());
        }
    }

    /// The frame's fields would be written twice.
    #[test]
    fn no_answer_has_a_field_of_the_frame() {
        for kind in KINDS.kinds().iter().chain(testing::KINDS.kinds()) {
            let result = json!(kind.schema().result);
            // A kind may have results of several forms.
            let forms = result["anyOf"].as_array().cloned().unwrap_or_else(|| vec![result]);
            for form in forms {
                let required = form["required"].as_array().unwrap();
                for name in ["id", "problem"] {
                    assert_eq!(required.iter().filter(|field| *field == name).count(), 1, "{} has {name}", kind.name());
                }
            }
        }
    }
}
