//! `palpate ports`.

use std::process::ExitCode;

use crate::advice::Advise as _;
use palpate_device::transport::address::{self, Port};

/// Lists the serial ports of this machine, USB devices first.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let ports = address::ports().advised()?;
    for port in &ports {
        say!("{}", if arguments.json { as_json(port) } else { as_line(port) });
    }
    if ports.is_empty() {
        note!("no serial port found; `--device sim:` stands for a simulated finger everywhere");
    }
    Ok(ExitCode::SUCCESS)
}

fn as_line(port: &Port) -> String {
    format!("{:<16} {}", port.path, port.description).trim_end().to_owned()
}

fn as_json(port: &Port) -> String {
    serde_json::json!({ "path": port.path, "description": port.description, "usb": port.usb }).to_string()
}
