//! `cargo xtask check`: formatting, lints, documentation, tests, as CI runs them. `cargo xtask firmware`: the board's
//! image.

mod emulator;
mod firmware;
mod image;
mod toolchain;

use std::env;
use std::process::{Command, ExitCode};

/// What `check` runs, in order. CI runs the same list and then the README's test command.
const CHECKS: &[(&[&str], &[(&str, &str)])] = &[
    (&["fmt", "--all", "--check"], &[]),
    (&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], &[]),
    (&["doc", "--workspace", "--no-deps", "--document-private-items"], &[("RUSTDOCFLAGS", "-D warnings")]),
];

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["check"] => run_all(CHECKS.iter().chain(&[(&["test"][..], &[][..])])),
        ["lint"] => run_all(CHECKS.iter()),
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
fn run_all<'a>(checks: impl Iterator<Item = &'a (&'a [&'a str], &'a [(&'a str, &'a str)])>) -> ExitCode {
    let cargo = env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    for (arguments, environment) in checks {
        eprintln!("+ cargo {}", arguments.join(" "));
        let status = Command::new(&cargo).args(*arguments).envs(environment.iter().copied()).status();
        match status {
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
