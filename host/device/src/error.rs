//! What can go wrong between host and device, and what to do about it.

use std::io;
use std::time::Duration;

use miette::Diagnostic;
use palpate_shared::wire::{PROTOCOL, ProtocolVersion, Refusal};
use thiserror::Error;

/// Why a device cannot be reached or does not do what it was asked to.
#[derive(Debug, Error, Diagnostic)]
pub enum LinkError {
    /// The device's name cannot be meant.
    #[error("`{text}` is not a device: {reason}")]
    #[diagnostic(help(
        "a device is a serial port's path, tcp:HOST:PORT, or sim:SEED; `palpate ports` lists the serial ports"
    ))]
    Address {
        /// What was given.
        text: String,
        /// Why it cannot be meant.
        reason: &'static str,
    },

    /// The operating system does not list its ports.
    #[error("cannot list the serial ports: {reason}")]
    #[diagnostic(help("name the port with --device, for example --device /dev/ttyACM0"))]
    Listing {
        /// The operating system's words.
        reason: String,
    },

    /// No device was named and none is there.
    #[error("no USB serial port found")]
    #[diagnostic(help("plug the board in, name its port with --device, or try --device sim: for a simulated finger"))]
    NothingFound,

    /// No device was named and there is a choice.
    #[error("{} USB serial ports found: {}", paths.len(), paths.join(", "))]
    #[diagnostic(help("choose one with --device, for example --device {}", paths[0]))]
    SeveralFound {
        /// What there is to choose from; never empty.
        paths: Vec<String>,
    },

    /// The port's file does not exist.
    #[error("there is no port {path}")]
    #[diagnostic(help("{}", if listed.is_empty() {
        "this machine lists no serial port: is the board plugged in?".to_owned()
    } else {
        format!("this machine lists {}", listed.join(", "))
    }))]
    NoSuchPort {
        /// The path that was given.
        path: String,
        /// The ports that there are.
        listed: Vec<String>,
    },

    /// The port may not be opened by this user.
    #[error("no permission to open {path}")]
    #[diagnostic(help("{remedy}"))]
    Permission {
        /// The path that was given.
        path: String,
        /// What to do on this system.
        remedy: String,
    },

    /// Another program holds the port.
    #[error("{path} is in use{}", holder.as_ref().map(|holder| format!(" by {holder}")).unwrap_or_default())]
    #[diagnostic(help("close the other program, then try again"))]
    Busy {
        /// The path that was given.
        path: String,
        /// Name and number of the process, where that can be known.
        holder: Option<String>,
    },

    /// The port cannot be opened for another reason.
    #[error("cannot open {address}")]
    #[diagnostic(help("{remedy}"))]
    Open {
        /// What was to be opened.
        address: String,
        /// What to look at.
        remedy: &'static str,
        /// The operating system's words.
        #[source]
        source: io::Error,
    },

    /// The port opens, but no palpate firmware answers.
    #[error("no answer from {address}{}", if bauds.is_empty() { String::new() } else { format!(" at {bauds} baud") })]
    #[diagnostic(help(
        "is this the finger's board, is it powered, and is palpate's firmware on it? \
         {damaged} damaged frames were seen; many of them mean a wrong speed (--baud)"
    ))]
    NoAnswer {
        /// Who was asked.
        address: String,
        /// At which speeds; empty where there is none.
        bauds: String,
        /// Frames that arrived but made no sense.
        damaged: u64,
    },

    /// The device speaks another major version of the protocol.
    #[error("the device speaks protocol {device}, this program {host}")]
    #[diagnostic(help("{}", if device.major > host.major {
        "update this program: the firmware is newer"
    } else {
        "update the firmware on the board: this program is newer"
    }))]
    OtherProtocol {
        /// What the device speaks.
        device: ProtocolVersion,
        /// What this program speaks.
        host: ProtocolVersion,
    },

    /// The device answered a command with a refusal.
    #[error("the device refused {request}: {}", in_words(*refusal))]
    #[diagnostic(help("{}", remedy(*refusal)))]
    Refused {
        /// The command in words.
        request: String,
        /// Why it was refused.
        refusal: Refusal,
    },

    /// A command was repeated without an answer.
    #[error("no answer to {request}, sent {times} times in {} ms", within.as_millis())]
    #[diagnostic(help(
        "the cable, or a device that hangs: `palpate diagnose` tells which; unplug it and plug it in again"
    ))]
    Unanswered {
        /// The command in words.
        request: String,
        /// How often it was sent.
        times: u32,
        /// From the first time to giving up.
        within: Duration,
    },

    /// The answer does not belong to the question.
    #[error("the device gave {request} an answer of the wrong kind")]
    #[diagnostic(help("this is a bug in the firmware; please report it with the output of `palpate info`"))]
    WrongAnswer {
        /// The command in words.
        request: String,
    },

    /// Another device answers where the first one was.
    #[error("another device answers: {is} instead of {was}")]
    #[diagnostic(help("calibration and tare belong to one finger: start again with the one that is connected now"))]
    OtherDevice {
        /// Number of the device that was connected before.
        was: String,
        /// Number of the device that answers now; the same where only its bridge supply or range differ.
        is: String,
    },

    /// The device is gone.
    #[error("{address} is gone: {reason}")]
    #[diagnostic(help("{}", if address.starts_with("tcp:") {
        "the device may have ended, or another program may be connected to it: it talks to one at a time"
    } else {
        "plug it in again"
    }))]
    Unplugged {
        /// What was open.
        address: String,
        /// How that was noticed.
        reason: String,
    },
}

impl LinkError {
    /// A device of another major version.
    #[must_use]
    pub fn other_protocol(device: ProtocolVersion) -> Self {
        Self::OtherProtocol { device, host: PROTOCOL }
    }
}

/// A refusal in words, with the limit that was broken.
fn in_words(refusal: Refusal) -> String {
    match refusal {
        Refusal::OtherProtocol { device } => format!("it speaks protocol {device}, this program {PROTOCOL}"),
        Refusal::UnknownRequest => "it does not know this command".to_owned(),
        Refusal::RateNotPossible { slowest_hz, fastest_hz } => {
            format!("its rates are {fastest_hz} Hz and halves of it down to {slowest_hz} Hz")
        }
        Refusal::LinkTooSlow { fastest_hz } => format!("its serial line carries at most {fastest_hz} Hz"),
        Refusal::GainNotPossible { largest } => format!("its gains are 1, 2, 4 … {largest}"),
        Refusal::SourceNotPossible => "this board has no such source".to_owned(),
        Refusal::NoFrontEnd => "no front-end answers on its bus".to_owned(),
        Refusal::FrontEndSilent => "its front-end does not answer".to_owned(),
        Refusal::AddressNotPossible { last } => format!("the last register is {last:#04x}"),
        Refusal::Busy => "it is busy with an earlier command".to_owned(),
        Refusal::NotOnThisBoard => "this kind of board cannot do that".to_owned(),
    }
}

/// What to do about a refusal.
fn remedy(refusal: Refusal) -> &'static str {
    match refusal {
        Refusal::OtherProtocol { device } if device.major > PROTOCOL.major => "update this program",
        Refusal::OtherProtocol { .. } | Refusal::UnknownRequest => "update the firmware on the board",
        Refusal::RateNotPossible { .. } | Refusal::GainNotPossible { .. } | Refusal::AddressNotPossible { .. } => {
            "choose one of these"
        }
        Refusal::LinkTooSlow { .. } => "choose a slower rate, or connect by a faster line",
        Refusal::SourceNotPossible => "choose another source, or another board",
        Refusal::NoFrontEnd | Refusal::FrontEndSilent => {
            "check the converter's supply, clock and bus wiring; `palpate info --source simulated` works without one"
        }
        Refusal::Busy => "try again",
        Refusal::NotOnThisBoard => "a board with palpate's own firmware image can; see docs/HARDWARE.md",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn help_of(error: &LinkError) -> String {
        error.help().map(|help| help.to_string()).unwrap_or_default()
    }

    #[test]
    fn a_version_clash_names_the_side_to_update() {
        let newer = LinkError::other_protocol(ProtocolVersion { major: PROTOCOL.major + 1, minor: 0 });
        assert!(help_of(&newer).contains("update this program"), "{}", help_of(&newer));
        let older = LinkError::other_protocol(ProtocolVersion { major: 0, minor: 3 });
        assert!(help_of(&older).contains("update the firmware"), "{}", help_of(&older));
    }

    #[test]
    fn a_refusal_names_the_limit() {
        let error = LinkError::Refused {
            request: "a rate of 9000 Hz".to_owned(),
            refusal: Refusal::RateNotPossible { slowest_hz: 500, fastest_hz: 8000 },
        };
        assert_eq!(
            error.to_string(),
            "the device refused a rate of 9000 Hz: its rates are 8000 Hz and halves of it down to 500 Hz"
        );
    }
}
