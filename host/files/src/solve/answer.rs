//! One problem to one answer, whatever it holds: a line of text, or JSON that a program has at hand.

use serde_json::Value;
use serde_json::value::RawValue;

use super::error::{ErrorCode, ErrorLine, Failure};
use super::line::{self, ParsedLine, Request};
use super::panics;
use super::problem::Registry;
use crate::lines::Content;

/// A line of output.
#[derive(Debug)]
pub(super) struct Answer {
    /// The line, its line end included.
    pub text: String,
    /// Whether it reports an error.
    pub failed: bool,
}

/// Answers one line; `number` is its place in the input, from 1.
pub(super) fn answer(registry: &Registry, number: u64, content: &Content) -> Answer {
    let parsed = match content {
        Content::Bytes(bytes) => line::parse(bytes),
        Content::TooLong { bytes_max } => ParsedLine { id: line::null(), request: Err(too_long(*bytes_max)) },
    };
    let id = parsed.id;
    let solved = parsed.request.and_then(|request| solved(registry, request, &id, Some(number)));
    let failed = solved.is_err();
    let mut text = solved.unwrap_or_else(|error| error_line(ErrorLine { id, line: number, error }));
    text.push('\n');
    Answer { text, failed }
}

/// The line of output for a problem, without its line end. A crash of its solver is an error like others.
fn solved(registry: &Registry, request: Request<'_>, id: &RawValue, line: Option<u64>) -> Result<String, Failure> {
    let solve = || registry.answer(&request.kind, request.fields, id);
    panics::catch(solve).unwrap_or_else(|caught| Err(crashed(line, &caught)))
}

impl Registry {
    /// Solves one problem: the same answer, or the same error, as [`run`](super::run) gives for a line that holds it,
    /// without threads or streams. The answer has the fields `id` (null where the problem has none) and `problem`, and
    /// those of its kind.
    ///
    /// # Errors
    /// [`Failure`]: what is wrong with the problem and where, or that its solver failed.
    ///
    /// ```
    /// use palpate_files::solve::{ErrorCode, KINDS};
    /// use serde_json::json;
    ///
    /// let block = json!([[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]]); // m
    /// let mut problem = json!({"problem": "support_friction", "id": 1, "polygon": block, "velocity": [0.1, 0], "omega": 2});
    /// assert_eq!(KINDS.solve(problem.clone())?["area"], json!(0.0024)); // m²
    ///
    /// problem["polygon"][3] = json!([0.05, -0.01]);
    /// let failure = KINDS.solve(problem).unwrap_err();
    /// assert_eq!((failure.code, failure.field.unwrap().as_str()), (ErrorCode::InvalidInput, "/polygon/2"));
    /// # Ok::<(), palpate_files::solve::Failure>(())
    /// ```
    pub fn solve(&self, problem: Value) -> Result<Value, Failure> {
        let unreadable = |error: serde_json::Error| Failure::internal(&format!("the result cannot be read: {error}"));
        let line = problem.to_string();
        // Of a tree only its text is needed any more.
        drop(problem);
        let text = self.solve_line(line.as_bytes())?;
        serde_json::from_str(&text).map_err(unreadable)
    }

    /// The same for a problem as a line of text, to the letter: the line of the answer, without its line end.
    ///
    /// # Errors
    /// [`Failure`], also where the line is not JSON.
    ///
    /// ```
    /// let failure = palpate_files::solve::KINDS.solve_line(b"{\"problem\": }").unwrap_err();
    /// assert!(failure.message.starts_with("not JSON at column 13"));
    /// ```
    pub fn solve_line(&self, line: &[u8]) -> Result<String, Failure> {
        let ParsedLine { id, request } = line::parse(line);
        solved(self, request?, &id, None)
    }
}

fn error_line(line: ErrorLine) -> String {
    // Strings, a number and JSON that was just read: this cannot fail, and if it did the line must still be answered.
    serde_json::to_string(&line).unwrap_or_else(|_| {
        let number = line.line;
        format!(r#"{{"id":null,"line":{number},"error":{{"code":"internal","message":"unwritable","field":null}}}}"#)
    })
}

fn too_long(bytes_max: usize) -> Failure {
    let limit_mib = bytes_max >> 20;
    let message =
        format!("the line is longer than the limit of {limit_mib} MiB: split the problem or send fewer digits");
    Failure::new(ErrorCode::InvalidInput, &message)
}

/// The message of the panic means nothing to the user; who repairs it finds it in the log.
fn crashed(line: Option<u64>, panics::Caught { place, message }: &panics::Caught) -> Failure {
    let line_named = line.map_or_else(String::new, |line| format!("line {line}: "));
    tracing::error!("{line_named}the solver crashed at {place}: {message}");
    Failure::internal(&format!("the solver crashed at {place}: this is a bug of palpate, please report the line"))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;
    use std::num::NonZeroUsize;

    use proptest::prelude::*;
    use serde_json::json;

    use super::super::testing::{self, answer_to, any_json, area_problem, documented_lines};
    use super::super::{KINDS, run};
    use super::*;

    /// A line of the interface as a program has it that asked for one problem alone.
    fn alone(answer: &Value) -> Result<Value, Value> {
        match answer.get("error") {
            Some(error) => Err(error.clone()),
            None => Ok(answer.clone()),
        }
    }

    fn of_value(registry: &Registry, problem: Value) -> Result<Value, Value> {
        registry.solve(problem).map_err(|failure| json!(failure))
    }

    fn of_line(registry: &Registry, line: &str) -> Result<Value, Value> {
        let text = registry.solve_line(line.as_bytes()).map_err(|failure| json!(failure))?;
        Ok(serde_json::from_str(&text).unwrap())
    }

    #[test]
    fn every_documented_problem_alone_has_the_answer_of_its_line_to_the_letter() {
        let lines = documented_lines();
        assert!(lines.len() >= KINDS.kinds().len(), "{} documented problems", lines.len());
        for line in lines {
            let mut output = Vec::new();
            run(KINDS, NonZeroUsize::MIN, Cursor::new(line.clone().into_bytes()), &mut output).unwrap();
            let wanted = String::from_utf8(output).unwrap();
            assert_eq!(KINDS.solve_line(line.as_bytes()).unwrap() + "\n", wanted);
            let problem: Value = serde_json::from_str(&line).unwrap();
            assert_eq!(KINDS.solve(problem).unwrap(), serde_json::from_str::<Value>(&wanted).unwrap(), "{line}");
        }
    }

    #[test]
    fn what_is_wrong_with_a_documented_problem_is_told_alone_as_in_its_line() {
        for line in documented_lines() {
            let problem: Value = serde_json::from_str(&line).unwrap();
            let mut others: Vec<Value> = problem
                .as_object()
                .unwrap()
                .keys()
                .map(|key| {
                    let mut other = problem.clone();
                    other[key.as_str()] = json!("x");
                    other
                })
                .collect();
            others.push(json!({"problem": problem["problem"], "typo": 1}));
            for other in others {
                let mut output = Vec::new();
                run(KINDS, NonZeroUsize::MIN, Cursor::new(other.to_string().into_bytes()), &mut output).unwrap();
                let wanted = alone(&serde_json::from_slice(&output).unwrap());
                assert_eq!(of_value(&KINDS, other.clone()), wanted, "{other}");
                assert_eq!(of_line(&KINDS, &other.to_string()), wanted, "{other}");
            }
        }
    }

    #[test]
    fn enough_time_changes_no_answer_and_none_leaves_nothing_that_is_claimed() {
        for line in documented_lines() {
            let problem: Value = serde_json::from_str(&line).unwrap();
            let with = |limit: Value| {
                let mut problem = problem.clone();
                problem["time_limit"] = limit;
                of_value(&KINDS, problem)
            };
            let wanted = of_value(&KINDS, problem.clone()).unwrap();
            assert_eq!(with(json!(1e9)).unwrap(), wanted, "{line}");
            assert_eq!(with(json!(-1)).unwrap_err()["field"], "/time_limit", "{line}");
            match with(json!(0)) {
                Ok(answer) if answer.get("complete").is_none() => assert_eq!(answer, wanted, "{line}"),
                Ok(answer) => {
                    assert_eq!(answer["complete"], false);
                    assert!(answer["status"] != "unique" && answer.get("optimal") != Some(&json!(true)), "{answer}");
                }
                Err(error) => assert_eq!(error["code"], "time_limit", "{error}"),
            }
        }
    }

    #[test]
    fn the_limit_of_a_run_holds_for_problems_that_name_none() {
        let push = documented_lines().into_iter().find(|line| line.contains("\"observe_push\"")).unwrap();
        let mut problem: Value = serde_json::from_str(&push).unwrap();
        let hurried = KINDS.with_time_limit(std::time::Duration::ZERO);
        let failure = hurried.solve(problem.clone()).unwrap_err();
        assert_eq!((failure.code, failure.field.unwrap().as_str()), (ErrorCode::TimeLimit, "/time_limit"));
        problem["time_limit"] = json!(1e9);
        assert!(hurried.solve(problem).is_ok());
    }

    #[test]
    fn a_crash_and_a_result_that_is_no_number_are_failures_of_the_one_problem() {
        for kind in ["crash", "not_a_number", "give_up"] {
            let problem = json!({"problem": kind, "id": 1});
            let failure = testing::KINDS.solve(problem.clone()).unwrap_err();
            assert_eq!(failure.code, ErrorCode::Internal, "{kind}");
            assert_eq!(Err(json!(failure)), alone(&answer_to(&problem.to_string())), "{kind}");
        }
    }

    proptest! {
        #[test]
        fn any_problem_alone_has_the_answer_or_the_error_of_its_line(
            problem in prop_oneof![area_problem(), any_json()],
            id in any_json(),
        ) {
            let mut problem = problem;
            if let Some(fields) = problem.as_object_mut() {
                fields.insert("id".to_owned(), id);
            }
            let line = problem.to_string();
            let wanted = alone(&answer_to(&line));
            prop_assert_eq!(of_value(&testing::KINDS, problem), wanted.clone());
            prop_assert_eq!(of_line(&testing::KINDS, &line), wanted);
        }
    }
}
