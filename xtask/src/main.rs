//! `cargo xtask check`: formatting, lints, documentation, tests, as CI runs them. `cargo xtask firmware`: the board's
//! image.
//!
//! `toolchain`: which compilers are there; `firmware`: builds the image; `image`: what is in it; `emulator`: runs it.

#![forbid(unsafe_code)]

mod emulator;
mod firmware;
mod image;
mod toolchain;

use std::env;
use std::process::{Command, ExitCode};

/// A run of cargo.
struct Check {
    arguments: &'static [&'static str],
    /// A variable to set for it.
    environment: Option<(&'static str, &'static str)>,
}

/// What CI runs before the README's test command, in order.
const LINTS: [Check; 3] = [
    Check { arguments: &["fmt", "--all", "--check"], environment: None },
    Check { arguments: &["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], environment: None },
    Check {
        arguments: &["doc", "--workspace", "--no-deps", "--document-private-items"],
        environment: Some(("RUSTDOCFLAGS", "-D warnings")),
    },
];

const TESTS: Check = Check { arguments: &["test"], environment: None };

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["check"] => ended(lint().and_then(|()| run_all(&[TESTS]))),
        ["lint"] => ended(lint()),
        ["firmware", rest @ ..] => firmware::run(rest).unwrap_or_else(usage),
        _ => usage(),
    }
}

/// A command that failed; it has said why.
struct Failed;

/// The exit status of a chore.
fn ended(result: Result<(), Failed>) -> ExitCode {
    result.map_or(ExitCode::FAILURE, |()| ExitCode::SUCCESS)
}

/// What CI runs before the README's test command.
fn lint() -> Result<(), Failed> {
    run_all(&LINTS)?;
    firmware::lint().map_err(|_| Failed)
}

/// Says how it is used.
fn usage() -> ExitCode {
    eprintln!("usage: cargo xtask check                     formatting, lints, documentation and tests");
    eprintln!("       cargo xtask lint                      the same without the tests");
    eprintln!("{}", firmware::USAGE);
    ExitCode::from(64)
}

/// Runs each command and stops at the first that fails.
fn run_all(checks: &[Check]) -> Result<(), Failed> {
    let cargo = env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    for check in checks {
        eprintln!("+ cargo {}", check.arguments.join(" "));
        match Command::new(&cargo).args(check.arguments).envs(check.environment).status() {
            Ok(status) if status.success() => {}
            Ok(_) => return Err(Failed),
            Err(error) => {
                eprintln!("cannot start {cargo}: {error}");
                return Err(Failed);
            }
        }
    }
    Ok(())
}
