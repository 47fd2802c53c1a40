//! One line of input to one line of output, whatever the line holds.

use super::error::{ErrorCode, ErrorLine, Failure};
use super::input::{Content, LINE_BYTES_MAX};
use super::line::{self, ParsedLine};
use super::panics;
use super::problem::Registry;

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
        Content::TooLong => ParsedLine { id: line::null(), request: Err(too_long()) },
    };
    let id = parsed.id;
    let solved = parsed.request.and_then(|request| {
        let solve = || registry.answer(&request.kind, request.fields, &id);
        panics::catch(solve).unwrap_or_else(|caught| Err(crashed(number, &caught)))
    });
    let failed = solved.is_err();
    let mut text = solved.unwrap_or_else(|error| error_line(ErrorLine { id, line: number, error }));
    text.push('\n');
    Answer { text, failed }
}

fn error_line(line: ErrorLine) -> String {
    // Strings, a number and JSON that was just read: this cannot fail, and if it did the line must still be answered.
    serde_json::to_string(&line).unwrap_or_else(|_| {
        let number = line.line;
        format!(r#"{{"id":null,"line":{number},"error":{{"code":"internal","message":"unwritable","field":null}}}}"#)
    })
}

fn too_long() -> Failure {
    let limit_mib = LINE_BYTES_MAX >> 20;
    let message =
        format!("the line is longer than the limit of {limit_mib} MiB: split the problem or send fewer digits");
    Failure::new(ErrorCode::InvalidInput, &message)
}

/// The message of the panic means nothing to the user; who repairs it finds it in the log.
fn crashed(number: u64, panics::Caught { place, message }: &panics::Caught) -> Failure {
    tracing::error!("line {number}: the solver crashed at {place}: {message}");
    Failure::internal(&format!("the solver crashed at {place}: this is a bug of palpate, please report the line"))
}
