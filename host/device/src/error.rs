//! What can go wrong between host and device. The facts alone: what to do about them is for the program to say.

use std::io;
use std::time::Duration;

use palpate_shared::wire::{CommandId, PROTOCOL, ProtocolVersion, Refusal};
use thiserror::Error;

use crate::session::Settings;

/// What could not be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opened {
    /// A file that is to be a serial port.
    SerialPort,
    /// A device behind a TCP port.
    Server,
    /// A simulated device's end of a pipe, of which there is none.
    SimulationNotStarted,
    /// A simulated device.
    Simulation,
    /// What opened as a port, but cannot be read and written in threads of their own.
    Line,
    /// A recording, whose entries have to be given.
    Recording,
}

/// Why a device cannot be reached or does not do what it was asked to.
#[derive(Debug, Error)]
pub enum LinkError {
    /// The device's name cannot be meant.
    #[error("`{text}` is not a device: {reason}")]
    Address {
        /// The address as it was written.
        text: String,
        /// Why it cannot be meant.
        reason: &'static str,
    },

    /// The operating system does not list its ports.
    #[error("cannot list the serial ports: {reason}")]
    Listing {
        /// The operating system's words.
        reason: String,
    },

    /// No device was named and none is there.
    #[error("no USB serial port found")]
    NothingFound,

    /// No device was named and there is a choice.
    #[error("{} USB serial ports found: {}", paths.len(), paths.join(", "))]
    SeveralFound {
        /// What there is to choose from; never empty.
        paths: Vec<String>,
    },

    /// The port's file does not exist.
    #[error("there is no port {path}")]
    NoSuchPort {
        /// The path that was given.
        path: String,
        /// The ports that there are.
        listed: Vec<String>,
    },

    /// The port may not be opened by this user.
    #[error("no permission to open {path}")]
    Permission {
        /// The path that was given.
        path: String,
        /// The group of users that the port belongs to, where that can be known.
        group: Option<String>,
    },

    /// Another program holds the port.
    #[error("{path} is in use{}", holder.as_ref().map(|holder| format!(" by {holder}")).unwrap_or_default())]
    Busy {
        /// The path that was given.
        path: String,
        /// Name and number of the process, where that can be known.
        holder: Option<String>,
    },

    /// The port cannot be opened for another reason.
    #[error("cannot open {address}")]
    Open {
        /// What was to be opened.
        address: String,
        /// What kind of thing that is.
        what: Opened,
        /// The operating system's words.
        #[source]
        source: io::Error,
    },

    /// The port opens, but no palpate firmware answers.
    #[error("no answer from {address}{}", if bauds.is_empty() { String::new() } else { format!(" at {bauds} baud") })]
    NoAnswer {
        /// Address that was asked.
        address: String,
        /// At which speeds; empty where there is none.
        bauds: String,
        /// Frames that arrived but made no sense.
        damaged: u64,
    },

    /// The device speaks another major version of the protocol.
    #[error("the device speaks protocol {device}, this program {host}")]
    OtherProtocol {
        /// What the device speaks.
        device: ProtocolVersion,
        /// What this program speaks.
        host: ProtocolVersion,
    },

    /// The device describes itself in ways that only a newer minor version of the protocol knows.
    #[error("the device speaks protocol {device}, this program {host}, which does not know all that its hello says")]
    NewerHello {
        /// What the device speaks.
        device: ProtocolVersion,
        /// What this program speaks.
        host: ProtocolVersion,
    },

    /// The device answered a command in a way that only a newer minor version of the protocol knows.
    #[error("the device answered command {} ({request}) in a way that this version does not know", id.0)]
    NewerAnswer {
        /// Id of the command.
        id: CommandId,
        /// The command in words.
        request: String,
        /// What the device speaks, as far as is known.
        device: Option<ProtocolVersion>,
        /// What this program speaks.
        host: ProtocolVersion,
    },

    /// The device answered a command with a refusal.
    #[error("the device refused {request}: {}", in_words(*refusal))]
    Refused {
        /// The command in words.
        request: String,
        /// Why it was refused.
        refusal: Refusal,
    },

    /// A command was repeated without an answer.
    #[error("no answer when asked {}, {times} times in {} ms", asked(request), within.as_millis())]
    Unanswered {
        /// The command in words.
        request: String,
        /// How often it was sent.
        times: u32,
        /// From the first time to giving up.
        within: Duration,
    },

    /// A recording does not have the answer to a command.
    #[error("the recording has no answer to a device asked {}", asked(request))]
    NotRecorded {
        /// The command in words.
        request: String,
    },

    /// The answer does not belong to the question.
    #[error("asked {}, the device gave an answer of the wrong kind", asked(request))]
    WrongAnswer {
        /// The command in words.
        request: String,
    },

    /// Another device answers where the first one was.
    #[error("another device answers: {is} instead of {was}")]
    OtherDevice {
        /// Number of the device that was connected before.
        was: String,
        /// Number of the device that answers now; the same where only its bridge supply or range differ.
        is: String,
    },

    /// The device restarted, or another host set it otherwise, and it does not take the settings of the session again.
    #[error("the device is set to {is} now and does not go back to {was}{}", refusal.map(|refusal| format!(": {}", in_words(refusal))).unwrap_or_default())]
    OtherSettings {
        /// What the session was opened with or has set.
        was: Settings,
        /// What the device says it has.
        is: Settings,
        /// Why it refused to be set; `None` where it said that it was done.
        refusal: Option<Refusal>,
    },

    /// The device is gone.
    #[error("{address} is gone: {reason}")]
    Unplugged {
        /// Address that was open.
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

    /// A device whose hello only a newer version can read.
    #[must_use]
    pub fn newer_hello(device: ProtocolVersion) -> Self {
        if device.major == PROTOCOL.major {
            Self::NewerHello { device, host: PROTOCOL }
        } else {
            Self::other_protocol(device)
        }
    }

    /// An answer that only a newer version can read, of a device that speaks `device`.
    #[must_use]
    pub fn newer_answer(id: CommandId, request: String, device: Option<ProtocolVersion>) -> Self {
        Self::NewerAnswer { id, request, device, host: PROTOCOL }
    }
}

/// A request in words behind "asked": "to do it" as it is, a thing with "for".
fn asked(request: &str) -> String {
    if request.starts_with("to ") { request.to_owned() } else { format!("for {request}") }
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
        Refusal::Streaming => "it streams samples".to_owned(),
        Refusal::MatrixDamaged => "the matrix came damaged, or holds numbers that are too large".to_owned(),
        Refusal::NoForceMatrix => "it has no matrix to compute forces by".to_owned(),
        Refusal::NotStored => "its flash did not take it; what it keeps is as before".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use palpate_shared::wire::Source;

    use super::*;

    #[test]
    fn what_was_asked_reads_as_a_sentence() {
        let unanswered = |request: &str| {
            let within = Duration::from_millis(1500);
            LinkError::Unanswered { request: request.to_owned(), times: 6, within }.to_string()
        };
        assert_eq!(unanswered("to stop streaming"), "no answer when asked to stop streaming, 6 times in 1500 ms");
        assert_eq!(unanswered("a gain of 64"), "no answer when asked for a gain of 64, 6 times in 1500 ms");
        let wrong = LinkError::WrongAnswer { request: "a ping".to_owned() };
        assert_eq!(wrong.to_string(), "asked for a ping, the device gave an answer of the wrong kind");
    }

    #[test]
    fn settings_that_do_not_come_back_are_both_named() {
        let was = Settings { rate_hz: 4000, gain: 64, source: Source::Hardware };
        let error = LinkError::OtherSettings {
            was,
            is: Settings { gain: 32, ..was },
            refusal: Some(Refusal::GainNotPossible { largest: 32 }),
        };
        assert_eq!(
            error.to_string(),
            "the device is set to 4000 Hz, gain 32, own front-end now and does not go back to \
             4000 Hz, gain 64, own front-end: its gains are 1, 2, 4 … 32"
        );
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
