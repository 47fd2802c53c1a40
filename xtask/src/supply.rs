//! `cargo xtask deny`: whose code this project takes, and from where, held to deny.toml by cargo-deny.
//!
//! Licences, bans and sources are judged by what cargo keeps of the packages; advisories need a network, and where
//! there is none, that is said. What cannot be judged at all is told by an exit status of its own.

use std::process::{Command, ExitCode, Stdio};

use crate::toolchain::own_cargo;

/// Exit status where nothing could be judged, by sysexits.h "unavailable".
const UNAVAILABLE: u8 = 69;

/// What the packages themselves tell.
const OF_PACKAGES: [&str; 5] = ["deny", "check", "licenses", "bans", "sources"];

/// What others tell of them, from what `cargo deny fetch` brought.
const OF_OTHERS: [&str; 4] = ["deny", "check", "--disable-fetch", "advisories"];

/// Judges what this project takes.
pub(crate) fn run() -> ExitCode {
    if !succeeds(&["deny", "--version"]) {
        eprintln!("not judged: cargo-deny is not installed; `cargo install cargo-deny --locked` installs it");
        return ExitCode::from(UNAVAILABLE);
    }
    // Those of other systems too, which no build here has brought.
    if !succeeds(&["fetch", "--locked"]) {
        eprintln!("not judged: `cargo fetch --locked` cannot bring all packages; is there a network?");
        return ExitCode::from(UNAVAILABLE);
    }
    let packages = judges(&OF_PACKAGES);
    let others = if succeeds(&["deny", "fetch", "all"]) {
        judges(&OF_OTHERS)
    } else {
        eprintln!("advisories are not judged: `cargo deny fetch` cannot bring them; is there a network?");
        true
    };
    if packages && others { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs cargo, which says itself what it finds.
fn judges(arguments: &[&str]) -> bool {
    eprintln!("+ cargo {}", arguments.join(" "));
    Command::new(own_cargo()).args(arguments).status().is_ok_and(|status| status.success())
}

/// Whether cargo can do this; quietly.
fn succeeds(arguments: &[&str]) -> bool {
    let mut command = Command::new(own_cargo());
    // Where there is no network, not to be told so for minutes.
    command.args(arguments).env("CARGO_NET_RETRY", "0").env("CARGO_HTTP_TIMEOUT", "20");
    command.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}
