//! `cargo xtask check`: formatting, lints, documentation, tests, as CI runs them. `cargo xtask firmware`: the board's
//! image.

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
        ["check"] => run_all(LINTS.iter().chain([&TESTS])),
        ["lint"] => run_all(LINTS.iter()),
        ["firmware", rest @ ..] => firmware::run(rest).unwrap_or_else(usage),
        _ => usage(),
    }
}

/// Says how it is used.
fn usage() -> ExitCode {
    eprintln!("usage: cargo xtask check                     formatting, lints, documentation and tests");
    eprintln!("       cargo xtask lint                      the same without the tests");
    eprintln!("{}", firmware::USAGE);
    ExitCode::from(64)
}

/// Runs each command and stops at the first that fails.
fn run_all<'a>(checks: impl Iterator<Item = &'a Check>) -> ExitCode {
    let cargo = env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    for check in checks {
        eprintln!("+ cargo {}", check.arguments.join(" "));
        match Command::new(&cargo).args(check.arguments).envs(check.environment).status() {
            Ok(status) if status.success() => {}
            Ok(_) => return ExitCode::FAILURE,
            Err(error) => {
                eprintln!("cannot start {cargo}: {error}");
                return ExitCode::FAILURE;
            }
        }
    }
    ExitCode::SUCCESS
}
