//! What to do when a device cannot be reached or does not do what it was asked to.

use std::error::Error;

use palpate_device::simulated::LinkExists;
use palpate_device::{LinkError, Opened};
use palpate_shared::wire::{PROTOCOL, ProtocolVersion, Refusal};

/// The help for this very error.
pub(super) fn about(error: &(dyn Error + 'static)) -> Option<String> {
    if error.is::<LinkExists>() {
        return Some("choose another --link or remove it".to_owned());
    }
    Some(match error.downcast_ref()? {
        LinkError::Address { .. } => {
            "a device is a serial port's path, tcp:HOST:PORT, sim:SEED, or file:RUN.mcap; `palpate ports` lists the serial ports"
                .to_owned()
        }
        LinkError::Listing { .. } => "name the port with --device, for example --device /dev/ttyACM0".to_owned(),
        LinkError::NothingFound => {
            "plug the board in, name its port with --device, or try --device sim: for a simulated finger".to_owned()
        }
        LinkError::SeveralFound { paths } => match paths.first() {
            Some(first) => format!("choose one with --device, for example --device {first}"),
            None => "choose one with --device".to_owned(),
        },
        LinkError::NoSuchPort { listed, .. } if listed.is_empty() => {
            "this machine lists no serial port: is the board plugged in?".to_owned()
        }
        LinkError::NoSuchPort { listed, .. } => format!("this machine lists {}", listed.join(", ")),
        LinkError::Permission { group: Some(group), .. } => format!(
            "the port belongs to the group {group}: run `sudo usermod -a -G {group} $USER`, then log out and in again"
        ),
        LinkError::Permission { group: None, .. } => "open it as a user who may use serial ports".to_owned(),
        LinkError::Busy { .. } => "close the other program, then try again".to_owned(),
        LinkError::Open { what, .. } => opening(*what).to_owned(),
        LinkError::NoAnswer { damaged, .. } => format!(
            "is this the finger's board, is it powered, and is palpate's firmware on it? \
             {damaged} damaged frames were seen; many of them mean a wrong speed (--baud)"
        ),
        LinkError::OtherProtocol { device, host } if device.major > host.major => {
            "update this program: the firmware is newer".to_owned()
        }
        LinkError::OtherProtocol { .. } => "update the firmware on the board: this program is newer".to_owned(),
        LinkError::NewerHello { device, host } if is_newer(*device, *host) => {
            "update palpate: the firmware is newer".to_owned()
        }
        LinkError::NewerHello { .. } => {
            "this is a bug in the firmware, whose hello says what its protocol does not have; please report it"
                .to_owned()
        }
        LinkError::NewerAnswer { device, host, .. } => newer_answer(*device, *host),
        LinkError::Refused { refusal, .. } => refused(*refusal).to_owned(),
        LinkError::Unanswered { .. } => {
            "the cable, or a device that hangs: `palpate diagnose` tells which; unplug it and plug it in again"
                .to_owned()
        }
        LinkError::NotRecorded { .. } => {
            "the recorded command did not ask this: run one that asks the device for no more than that did".to_owned()
        }
        LinkError::WrongAnswer { .. } => {
            "this is a bug in the firmware; please report it with the output of `palpate info`".to_owned()
        }
        LinkError::OtherDevice { .. } => {
            "calibration and tare belong to one finger: start again with the one that is connected now".to_owned()
        }
        LinkError::OtherSettings { .. } => {
            "calibration and tare hold for the settings that they were taken with: start again, or set the device back"
                .to_owned()
        }
        LinkError::Unplugged { address, .. } if address.starts_with("tcp:") => {
            "the device may have ended, or another program may be connected to it: it talks to one at a time".to_owned()
        }
        LinkError::Unplugged { .. } => "plug it in again".to_owned(),
    })
}

/// What to look at when a device cannot be opened.
fn opening(what: Opened) -> &'static str {
    match what {
        Opened::SerialPort => "is it a serial port? `palpate ports` lists those there are",
        Opened::Server => "is the device running there, and is the port right?",
        Opened::SimulationNotStarted => "start the simulated device first",
        Opened::Simulation => "the simulation could not start",
        Opened::Line => "the port opens but cannot be used",
        Opened::Recording => "it has to be read first",
    }
}

/// What to do about a command that was refused.
fn refused(refusal: Refusal) -> &'static str {
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
        Refusal::Streaming => "stop the stream first",
        Refusal::MatrixDamaged => "try again; a matrix that is refused again is of no finger",
        Refusal::NoForceMatrix => "give it one first",
        Refusal::NotStored => {
            "try again; a flash that refuses again is worn out or write-protected, and an emulator has none"
        }
    }
}

/// Whether a device of the same major version may say what this program does not know.
fn is_newer(device: ProtocolVersion, host: ProtocolVersion) -> bool {
    device.minor > host.minor
}

/// What to do about an answer that only a newer version can read.
fn newer_answer(device: Option<ProtocolVersion>, host: ProtocolVersion) -> String {
    match device {
        Some(device) if is_newer(device, host) => {
            format!("update palpate: the device speaks protocol {device}, this program {host}")
        }
        Some(device) => format!(
            "this is a bug in the firmware, which speaks protocol {device} and answers what {device} does not have; \
             please report it with the output of `palpate info`"
        ),
        None => format!("update palpate: the firmware is newer than protocol {host}, which this program speaks"),
    }
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::time::Duration;

    use palpate_device::session::Settings;
    use palpate_shared::wire::{CommandId, Source};

    use super::super::help;
    use super::*;

    fn path() -> String {
        "/dev/ttyACM0".to_owned()
    }

    #[test]
    fn each_failure_of_the_link_has_its_advice() {
        let open = |what| LinkError::Open { address: path(), what, source: io::ErrorKind::NotFound.into() };
        let version = |major| ProtocolVersion { major, minor: 0 };
        let request = || "a rate of 9000 Hz".to_owned();
        let settings = |gain| Settings { rate_hz: 4000, gain, source: Source::Hardware };
        let gone = |address: &str| LinkError::Unplugged { address: address.to_owned(), reason: "closed".to_owned() };
        let cases = [
            (
                LinkError::Address { text: "x".to_owned(), reason: "no" },
                "a device is a serial port's path, tcp:HOST:PORT, sim:SEED, or file:RUN.mcap; `palpate ports` lists the serial ports",
            ),
            (
                LinkError::Listing { reason: "no".to_owned() },
                "name the port with --device, for example --device /dev/ttyACM0",
            ),
            (
                LinkError::NothingFound,
                "plug the board in, name its port with --device, or try --device sim: for a simulated finger",
            ),
            (
                LinkError::SeveralFound { paths: vec![path(), "/dev/ttyACM1".to_owned()] },
                "choose one with --device, for example --device /dev/ttyACM0",
            ),
            (
                LinkError::NoSuchPort { path: path(), listed: vec![] },
                "this machine lists no serial port: is the board plugged in?",
            ),
            (
                LinkError::NoSuchPort { path: path(), listed: vec!["/dev/ttyS0".to_owned(), "/dev/ttyS1".to_owned()] },
                "this machine lists /dev/ttyS0, /dev/ttyS1",
            ),
            (
                LinkError::Permission { path: path(), group: Some("dialout".to_owned()) },
                "the port belongs to the group dialout: run `sudo usermod -a -G dialout $USER`, then log out and in again",
            ),
            (LinkError::Permission { path: path(), group: None }, "open it as a user who may use serial ports"),
            (LinkError::Busy { path: path(), holder: None }, "close the other program, then try again"),
            (open(Opened::SerialPort), "is it a serial port? `palpate ports` lists those there are"),
            (open(Opened::Server), "is the device running there, and is the port right?"),
            (open(Opened::SimulationNotStarted), "start the simulated device first"),
            (open(Opened::Simulation), "the simulation could not start"),
            (open(Opened::Line), "the port opens but cannot be used"),
            (
                LinkError::NoAnswer { address: path(), bauds: String::new(), damaged: 7 },
                "is this the finger's board, is it powered, and is palpate's firmware on it? 7 damaged frames were seen; \
                 many of them mean a wrong speed (--baud)",
            ),
            (LinkError::other_protocol(version(PROTOCOL.major + 1)), "update this program: the firmware is newer"),
            (LinkError::other_protocol(version(0)), "update the firmware on the board: this program is newer"),
            (LinkError::Refused { request: request(), refusal: Refusal::Busy }, "try again"),
            (
                LinkError::Unanswered { request: request(), times: 3, within: Duration::from_millis(600) },
                "the cable, or a device that hangs: `palpate diagnose` tells which; unplug it and plug it in again",
            ),
            (
                LinkError::WrongAnswer { request: request() },
                "this is a bug in the firmware; please report it with the output of `palpate info`",
            ),
            (
                LinkError::OtherDevice { was: "1".to_owned(), is: "2".to_owned() },
                "calibration and tare belong to one finger: start again with the one that is connected now",
            ),
            (
                LinkError::OtherSettings { was: settings(64), is: settings(32), refusal: None },
                "calibration and tare hold for the settings that they were taken with: start again, or set the device back",
            ),
            (
                gone("tcp:localhost:7800"),
                "the device may have ended, or another program may be connected to it: it talks to one at a time",
            ),
            (gone("/dev/ttyACM0"), "plug it in again"),
        ];
        for (error, wanted) in cases {
            assert_eq!(help(&error).as_deref(), Some(wanted), "{error:?}");
        }
    }

    #[test]
    fn each_refusal_has_its_advice() {
        let version = |major| ProtocolVersion { major, minor: 0 };
        let cases = [
            (Refusal::OtherProtocol { device: version(PROTOCOL.major + 1) }, "update this program"),
            (Refusal::OtherProtocol { device: version(0) }, "update the firmware on the board"),
            (Refusal::UnknownRequest, "update the firmware on the board"),
            (Refusal::RateNotPossible { slowest_hz: 500, fastest_hz: 8000 }, "choose one of these"),
            (Refusal::GainNotPossible { largest: 128 }, "choose one of these"),
            (Refusal::AddressNotPossible { last: 0x3e }, "choose one of these"),
            (Refusal::LinkTooSlow { fastest_hz: 4000 }, "choose a slower rate, or connect by a faster line"),
            (Refusal::SourceNotPossible, "choose another source, or another board"),
            (
                Refusal::NoFrontEnd,
                "check the converter's supply, clock and bus wiring; `palpate info --source simulated` works without one",
            ),
            (
                Refusal::FrontEndSilent,
                "check the converter's supply, clock and bus wiring; `palpate info --source simulated` works without one",
            ),
            (Refusal::Busy, "try again"),
            (Refusal::NotOnThisBoard, "a board with palpate's own firmware image can; see docs/HARDWARE.md"),
            (Refusal::Streaming, "stop the stream first"),
            (Refusal::MatrixDamaged, "try again; a matrix that is refused again is of no finger"),
            (Refusal::NoForceMatrix, "give it one first"),
            (
                Refusal::NotStored,
                "try again; a flash that refuses again is worn out or write-protected, and an emulator has none",
            ),
        ];
        for (refusal, wanted) in cases {
            let error = LinkError::Refused { request: "it".to_owned(), refusal };
            assert_eq!(help(&error).as_deref(), Some(wanted), "{refusal:?}");
        }
    }

    #[test]
    fn a_taken_link_has_its_advice_inside_an_error_of_the_system() {
        let error = io::Error::new(io::ErrorKind::AlreadyExists, LinkExists("/tmp/finger".into()));
        assert_eq!(error.to_string(), "/tmp/finger exists");
        assert_eq!(help(&error).unwrap(), "choose another --link or remove it");
    }

    #[test]
    fn what_only_a_newer_version_can_read_names_both_versions_and_the_remedy() {
        let newer = ProtocolVersion { minor: PROTOCOL.minor + 1, ..PROTOCOL };
        let hello = LinkError::newer_hello(newer);
        assert!(hello.to_string().contains(&format!("protocol {newer}, this program {PROTOCOL}")), "{hello}");
        assert!(help(&hello).unwrap_or_default().contains("update palpate"), "{}", help(&hello).unwrap_or_default());
        let answer = LinkError::newer_answer(CommandId(17), "a rate of 9000 Hz".to_owned(), Some(newer));
        assert_eq!(
            answer.to_string(),
            "the device answered command 17 (a rate of 9000 Hz) in a way that this version does not know"
        );
        assert_eq!(
            help(&answer).unwrap_or_default(),
            format!("update palpate: the device speaks protocol {newer}, this program {PROTOCOL}")
        );
    }

    #[test]
    fn a_device_that_says_what_its_own_version_does_not_have_has_a_bug() {
        for error in [
            LinkError::newer_hello(PROTOCOL),
            LinkError::newer_answer(CommandId(17), "a ping".to_owned(), Some(PROTOCOL)),
        ] {
            assert!(
                help(&error).unwrap_or_default().contains("bug in the firmware"),
                "{}",
                help(&error).unwrap_or_default()
            );
        }
    }
}
