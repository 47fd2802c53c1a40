//! The `palpate` command line: parse arguments, call the library, print errors.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
