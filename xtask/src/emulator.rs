//! How the emulator is started; the end-to-end test includes this file, so that both mean the same machine.

use std::path::Path;
use std::process::{Command, Stdio};

/// The emulator's program.
pub(crate) const PROGRAM: &str = "qemu-system-arm";

/// Machines with an STM32F405, the better match first: the first one that the installed emulator has is used.
const MACHINES: [&str; 2] = ["olimex-stm32-h405", "netduinoplus2"];

/// How much virtual time an instruction takes, as a power of two in ns: 8 ns, 125 million instructions a second,
/// about what the processor does at 168 MHz. So the machine's time depends on its program and on nothing else.
pub(crate) const INSTRUCTION_NS_LOG2: u32 = 3;

/// Where the emulated serial line comes out.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Serial {
    /// At this TCP port of this computer; the machine waits for its host if asked to.
    Tcp {
        /// The port.
        port: u16,
        /// Start only when a host has connected.
        wait: bool,
    },
    /// At a pseudo-terminal, which the emulator names on its standard output.
    Pty,
}

/// The machine that the installed emulator has; `None` if there is no emulator, or it has none of them.
#[must_use]
pub(crate) fn machine() -> Option<&'static str> {
    let listed = Command::new(PROGRAM).args(["-machine", "help"]).stderr(Stdio::null()).output().ok()?;
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    let has = |machine: &&&str| listed.lines().any(|line| line.split_whitespace().next() == Some(**machine));
    MACHINES.iter().find(has).copied()
}

/// The emulator's command line for an image.
#[must_use]
pub(crate) fn command(machine: &str, image: &Path, serial: Serial) -> Command {
    let serial = match serial {
        Serial::Tcp { port, wait } => {
            let wait = if wait { "on" } else { "off" };
            format!("tcp:127.0.0.1:{port},server=on,wait={wait},nodelay=on")
        }
        Serial::Pty => "pty".to_owned(),
    };
    let mut command = Command::new(PROGRAM);
    command.args(["-machine", machine, "-display", "none", "-monitor", "none"]);
    command.args(["-icount", &format!("shift={INSTRUCTION_NS_LOG2}"), "-serial", &serial, "-kernel"]).arg(image);
    command.stdin(Stdio::null());
    command
}
