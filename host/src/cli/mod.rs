//! The commands, one file each. They parse, call the library and print; they compute nothing.

// Becomes a command as soon as there is a device to open.
#[cfg(test)]
mod calibrate;
mod contact;
mod device;
mod info;
mod ports;
mod simulate_device;
mod solve;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Exit status for a wrong command line (`EX_USAGE` of BSD's sysexits; fixed by the `solve` interface).
const EXIT_USAGE: u8 = 64;

/// Feel where a known part is and how it moves, with a strain-gauge finger.
#[derive(Debug, Parser)]
#[command(name = "palpate", version, propagate_version = true, arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Contact(contact::Arguments),
    Info(info::Arguments),
    Ports(ports::Arguments),
    SimulateDevice(simulate_device::Arguments),
    Solve(solve::Arguments),
}

/// Runs the command named on the command line and returns the process's exit status.
pub(crate) fn run() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            let failed = error.use_stderr();
            // Nothing is left to do if even this cannot be written.
            let _ = error.print();
            return if failed { ExitCode::from(EXIT_USAGE) } else { ExitCode::SUCCESS };
        }
    };
    let outcome = match arguments.command {
        Command::Contact(arguments) => contact::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Ports(arguments) => ports::run(&arguments),
        Command::SimulateDevice(arguments) => simulate_device::run(&arguments),
        Command::Solve(arguments) => solve::run(&arguments),
    };
    match outcome {
        Ok(status) => status,
        Err(report) => {
            eprintln!("{report:?}");
            ExitCode::FAILURE
        }
    }
}
