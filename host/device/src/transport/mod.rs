//! Moves bytes: a serial port, a TCP connection, or a simulated device in this process.
//!
//! [`address`]: what a device may be called; [`pipe`]: the line to a simulated device; `platform`: what depends on the
//! operating system.

pub mod address;
pub mod pipe;
pub(crate) mod platform;

pub use address::Address;

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::time::Duration;

use serialport::SerialPort;

use crate::error::{LinkError, Opened};

/// How long one read waits for bytes: short, so that a reader notices soon that it shall end.
pub const READ_WAIT: Duration = Duration::from_millis(20);

/// How long a write may take before the device counts as gone.
const WRITE_WAIT: Duration = Duration::from_millis(500);

/// How long a TCP connection may take to come about.
const CONNECT_WAIT: Duration = Duration::from_secs(3);

/// Speed of the serial line where none is asked for, in baud.
pub const BAUD: u32 = 921_600;

/// Speed that a board falls back to when it has no precise clock, in baud.
pub const BAUD_FALLBACK: u32 = 115_200;

/// The host's end of a link. Reading yields [`io::ErrorKind::TimedOut`] where nothing came within [`READ_WAIT`].
#[derive(Debug)]
pub enum Transport {
    /// A serial port or pseudo-terminal.
    Serial(Box<dyn SerialPort>),
    /// A connection to a TCP port.
    Tcp(TcpStream),
    /// A simulated device in this process.
    Pipe(pipe::PipeEnd),
}

impl Transport {
    /// Opens the device at `address`; `baud` is used for serial ports.
    ///
    /// A simulated device must be running already: the host's end of a pipe to it is given as `simulated`.
    ///
    /// # Errors
    /// [`LinkError`]: no such port, no permission, in use, or not reachable.
    pub fn open(address: &Address, baud: u32, simulated: Option<pipe::PipeEnd>) -> Result<Self, LinkError> {
        match (address, simulated) {
            (Address::Serial(path), _) => open_serial(path, baud),
            (Address::Tcp(host), _) => open_tcp(host).map_err(|source| LinkError::Open {
                address: address.to_string(),
                what: Opened::Server,
                source,
            }),
            (Address::Simulated { .. }, Some(end)) => Ok(Self::Pipe(end)),
            (Address::Simulated { .. }, None) => Err(LinkError::Open {
                address: address.to_string(),
                what: Opened::SimulationNotStarted,
                source: io::ErrorKind::NotConnected.into(),
            }),
            (Address::Recording(_), _) => Err(LinkError::Open {
                address: address.to_string(),
                what: Opened::Recording,
                source: io::ErrorKind::Unsupported.into(),
            }),
        }
    }

    /// A second handle on the same link, for a thread of its own.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn second(&self) -> io::Result<Self> {
        Ok(match self {
            Self::Serial(port) => Self::Serial(port.try_clone()?),
            Self::Tcp(stream) => Self::Tcp(stream.try_clone()?),
            Self::Pipe(end) => Self::Pipe(end.clone()),
        })
    }
}

impl Read for Transport {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = match self {
            Self::Serial(port) => port.read(buffer),
            Self::Tcp(stream) => stream.read(buffer),
            Self::Pipe(end) => end.read(buffer),
        };
        match read {
            Ok(0) if !buffer.is_empty() => {
                Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the device closed the link"))
            }
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {
                Err(io::ErrorKind::TimedOut.into())
            }
            other => other,
        }
    }
}

impl Write for Transport {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Serial(port) => port.write(bytes),
            Self::Tcp(stream) => stream.write(bytes),
            Self::Pipe(end) => end.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            // A drain would wait for a device that has stopped listening; the bytes are on their way.
            Self::Serial(_) => Ok(()),
            Self::Tcp(stream) => stream.flush(),
            Self::Pipe(end) => end.flush(),
        }
    }
}

fn open_tcp(host: &str) -> io::Result<Transport> {
    let mut last = io::Error::new(io::ErrorKind::NotFound, "the name has no address");
    for candidate in host.to_socket_addrs()? {
        match TcpStream::connect_timeout(&candidate, CONNECT_WAIT) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(READ_WAIT))?;
                stream.set_write_timeout(Some(WRITE_WAIT))?;
                return Ok(Transport::Tcp(stream));
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn open_serial(path: &str, baud: u32) -> Result<Transport, LinkError> {
    serialport::new(path, baud)
        .timeout(READ_WAIT)
        .open()
        .map(Transport::Serial)
        .map_err(|error| why_not_opened(path, error))
}

/// Finds out what a failure to open a port means and what to do about it.
fn why_not_opened(path: &str, error: serialport::Error) -> LinkError {
    let file = Path::new(path);
    let holder = platform::holder(file);
    // The crate reports some failures by a kind of its own and words only, so the file itself is asked as well.
    let may_read = std::fs::OpenOptions::new().read(true).write(true).open(file);
    let is_terminal = may_read.as_ref().is_ok_and(io::IsTerminal::is_terminal);
    match (error.kind(), may_read.map_err(|error| error.kind())) {
        (_, Err(io::ErrorKind::NotFound)) => LinkError::NoSuchPort {
            path: path.to_owned(),
            listed: address::ports().unwrap_or_default().into_iter().map(|port| port.path).collect(),
        },
        (_, Err(io::ErrorKind::PermissionDenied)) => {
            LinkError::Permission { path: path.to_owned(), group: platform::owning_group(file) }
        }
        (_, Err(io::ErrorKind::ResourceBusy)) => LinkError::Busy { path: path.to_owned(), holder },
        // What can be opened but not locked is locked by another.
        (serialport::ErrorKind::NoDevice, Ok(_)) if is_terminal => LinkError::Busy { path: path.to_owned(), holder },
        _ if is_terminal && holder.is_some() => LinkError::Busy { path: path.to_owned(), holder },
        _ => LinkError::Open { address: path.to_owned(), what: Opened::SerialPort, source: error.into() },
    }
}
