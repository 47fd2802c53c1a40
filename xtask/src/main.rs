//! `cargo xtask check`: formatting, lints, documentation, tests, as CI runs them. `cargo xtask firmware`: the board's
//! image. `cargo xtask fuzz`: a longer search for inputs that break a parser. `cargo xtask deny`: whose code is taken.
//!
//! `toolchain`: which compilers are there; `firmware`: builds the image; `image`: what is in it; `emulator`: runs it;
//! `dist`: the files of a release; `supply`: licences and sources of other people's code.

#![forbid(unsafe_code)]

mod dist;
mod emulator;
mod firmware;
mod image;
mod supply;
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
const LINTS: [Check; 4] = [
    Check { arguments: &["fmt", "--all", "--check"], environment: None },
    Check { arguments: &["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"], environment: None },
    // The tool without what is not needed at every bench.
    Check {
        arguments: &[
            "clippy",
            "--package",
            "palpate-cli",
            "--no-default-features",
            "--all-targets",
            "--",
            "-D",
            "warnings",
        ],
        environment: None,
    },
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
        ["fuzz", target] => ended(fuzz(target, FUZZ_SECONDS)),
        ["fuzz", target, seconds] if seconds.parse::<u32>().is_ok() => ended(fuzz(target, seconds)),
        ["deny"] => supply::run(),
        ["dist"] => ended(firmware::dist().map_err(|_| Failed)),
        ["firmware", rest @ ..] => firmware::run(rest).unwrap_or_else(usage),
        _ => usage(),
    }
}

/// How long a fuzz target is searched where nobody says, s.
const FUZZ_SECONDS: &str = "60";

/// Searches for inputs that break a law of `tests/src/fuzz*.rs`, led by coverage: needs a nightly compiler and cargo-fuzz.
/// The bounded search on stable Rust is among the tests.
fn fuzz(target: &str, seconds: &str) -> Result<(), Failed> {
    let (corpus, limit) = (format!("tests/golden/fuzz/{target}"), format!("-max_total_time={seconds}"));
    // What is found goes to a folder that is not kept; what is worth keeping is moved to the corpus by hand.
    let found = format!("fuzz/corpus/{target}");
    std::fs::create_dir_all(&found).map_err(|error| {
        eprintln!("cannot make {found}: {error}");
        Failed
    })?;
    let arguments = ["+nightly", "fuzz", "run", target, &found, &corpus, "--", &limit];
    eprintln!("+ cargo {}", arguments.join(" "));
    // Not the cargo that runs this: that one is of the stable toolchain.
    match Command::new("cargo").args(arguments).env_remove("RUSTUP_TOOLCHAIN").status() {
        Ok(status) if status.success() => Ok(()),
        Ok(_) => Err(Failed),
        Err(error) => {
            eprintln!("cannot start cargo: {error}");
            Err(Failed)
        }
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
    eprintln!(
        "       cargo xtask fuzz TARGET [SECONDS]     coverage-guided search with a nightly compiler, by default {FUZZ_SECONDS} s"
    );
    eprintln!("       cargo xtask deny                      licences, bans, sources and advisories, by cargo-deny");
    eprintln!("       cargo xtask dist                      the tool and the images of a release, with checksums");
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
