//! `palpate completions`.

use std::process::ExitCode;

use clap_complete::Shell;

/// Prints a script that lets a shell complete commands and options.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The shell to print it for
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

/// What the shell is to read.
pub(super) fn script(shell: Shell) -> String {
    let mut out = Vec::new();
    clap_complete::generate(shell, &mut super::command(), "palpate", &mut out);
    String::from_utf8_lossy(&out).into_owned()
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    super::write_out(format_args!("{}", script(arguments.shell)));
    Ok(ExitCode::SUCCESS)
}
