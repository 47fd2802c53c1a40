//! Small kinds of problem with which the frame is tested.

use std::num::NonZeroUsize;
use std::thread;
use std::time::Duration;

use proptest::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::fields::Polygon;
use super::{InvalidInput, Kind, Problem, Registry, SolveError, Summary, run};

pub(super) const KINDS: Registry = Registry::new(&[
    Kind::of::<Area>(),
    Kind::of::<Crash>(),
    Kind::of::<GiveUp>(),
    Kind::of::<NotANumber>(),
    Kind::of::<Sleep>(),
]);

/// Runs the test kinds on whole input.
pub(super) fn run_text(jobs: NonZeroUsize, input: Vec<u8>) -> (String, Summary) {
    let mut output = Vec::new();
    let summary = run(KINDS, jobs, std::io::Cursor::new(input), &mut output).unwrap();
    (String::from_utf8(output).unwrap(), summary)
}

/// The one answer to one line.
pub(super) fn answer_to(line: &str) -> Value {
    let (text, _) = run_text(NonZeroUsize::MIN, line.as_bytes().to_vec());
    serde_json::from_str(&text).unwrap()
}

/// A problem of kind `area` that is good most of the time.
pub(super) fn area_problem() -> impl Strategy<Value = Value> {
    proptest::collection::vec([-9..9_i32, -9..9_i32], 2..6)
        .prop_map(|polygon| json!({"problem": "area", "polygon": polygon}))
}

/// Any JSON of moderate depth.
pub(super) fn any_json() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        any::<f64>().prop_filter_map("JSON has finite numbers only", |x| x.is_finite().then(|| Value::from(x))),
        any::<String>().prop_map(Value::from),
    ];
    leaf.prop_recursive(4, 30, 6, |inner| {
        prop_oneof![
            proptest::collection::vec(inner.clone(), 0..6).prop_map(Value::from),
            proptest::collection::btree_map(any::<String>(), inner, 0..6).prop_map(|map| map.into_iter().collect()),
        ]
    })
}

#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Area {
    polygon: Polygon,
    /// Refused if above the area: two fields that must agree.
    least: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
struct AreaAnswer {
    area: f64,
}

impl Problem for Area {
    const KIND: &'static str = "area";
    type Answer = AreaAnswer;

    fn solve(&self) -> Result<AreaAnswer, SolveError> {
        let area = self.polygon.area();
        match self.least {
            Some(least) if least > area => Err(InvalidInput::at("least", format!("{least} is above the area")).into()),
            _ => Ok(AreaAnswer { area }),
        }
    }
}

#[derive(Serialize, JsonSchema)]
struct Nothing {}

#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Crash {}

impl Problem for Crash {
    const KIND: &'static str = "crash";
    type Answer = Nothing;

    fn solve(&self) -> Result<Nothing, SolveError> {
        panic!("index out of bounds");
    }
}

#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct GiveUp {}

impl Problem for GiveUp {
    const KIND: &'static str = "give_up";
    type Answer = Nothing;

    fn solve(&self) -> Result<Nothing, SolveError> {
        Err(SolveError::Internal("no convergence in 100 steps".to_owned()))
    }
}

#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct NotANumber {}

#[derive(Serialize, JsonSchema)]
struct Values {
    values: [f64; 2],
}

impl Problem for NotANumber {
    const KIND: &'static str = "not_a_number";
    type Answer = Values;

    fn solve(&self) -> Result<Values, SolveError> {
        Ok(Values { values: [0.0, f64::NAN] })
    }
}

#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Sleep {
    ms: u64,
}

impl Problem for Sleep {
    const KIND: &'static str = "sleep";
    type Answer = Nothing;

    fn solve(&self) -> Result<Nothing, SolveError> {
        thread::sleep(Duration::from_millis(self.ms));
        Ok(Nothing {})
    }
}

/// Every good problem that `docs/SOLVE.md` shows, as a line.
pub(super) fn documented_lines() -> Vec<String> {
    let page = include_str!("../../../../docs/SOLVE.md");
    let shown = page.lines().map(|line| {
        let typed = line.strip_prefix("$ echo '").and_then(|line| line.split("' | palpate").next());
        typed.unwrap_or(line)
    });
    // Answers begin with the id.
    let problems = shown.filter(|line| line.starts_with("{\"problem\"") && !line.contains("\"fly\""));
    problems.map(str::to_owned).collect()
}

/// Whether every number of an answer can be written.
pub(super) fn all_finite(answer: &impl Serialize) {
    super::finite::check(answer).unwrap();
}
