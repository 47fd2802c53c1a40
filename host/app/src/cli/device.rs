//! What every command that talks to a device takes: which one, and at what speed.

use crate::advice::Advise as _;
use std::path::{Path, PathBuf};

use palpate_device::PlaySpeed;
use palpate_device::session::{Session, SessionOptions};
use palpate_device::transport::address::{self, Address};

use crate::recording;

/// How to find the device, and whether to keep what it sends.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct DeviceArguments {
    #[command(flatten)]
    choice: DeviceChoice,

    #[command(flatten)]
    record: RecordArguments,
}

/// How to find the device.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Device")]
pub(crate) struct DeviceChoice {
    /// Serial port, tcp:HOST:PORT, sim:SEED for a simulated finger, or file:RUN.mcap for a recording [default: the one USB
    /// serial port]
    #[arg(long, short = 'd', value_name = "DEVICE", env = "PALPATE_DEVICE")]
    device: Option<String>,

    /// Speed of the serial line in baud [default: 921600, then 115200]
    #[arg(long, value_name = "BAUD")]
    baud: Option<u32>,

    /// Play a recording so many times as fast as it was recorded [default: as fast as it is read]
    #[arg(long, value_name = "TIMES", value_parser = super::positive)]
    speed: Option<f64>,
}

/// Whether to keep the run.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Recording")]
pub(crate) struct RecordArguments {
    /// Keep everything that comes and goes in this file, which must not exist: MCAP, to be played with -d file:FILE
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// Keep force and contact of every sample in it, not of every block
    #[arg(long, requires = "record")]
    full: bool,
}

impl RecordArguments {
    /// Begins the recording, if one is asked for and has not begun.
    fn begin(&self) -> miette::Result<()> {
        match &self.record {
            Some(file) if !recording::is_active() => recording::begin(file, self.full),
            _ => Ok(()),
        }
    }
}

impl DeviceArguments {
    /// Begins a recording, if one is asked for: before files are read, which are attached to it.
    pub(crate) fn begin_recording(&self) -> miette::Result<()> {
        self.record.begin()
    }

    /// Whether a device was named.
    pub(crate) fn is_given(&self) -> bool {
        self.choice.device.is_some()
    }

    /// Whether the device is a recording.
    pub(crate) fn is_recording(&self) -> bool {
        self.choice.device.as_ref().is_some_and(|name| matches!(name.parse(), Ok(Address::Recording(_))))
    }

    /// Whether a recording is to be played at a speed, and not as fast as it is read.
    pub(crate) fn has_speed(&self) -> bool {
        self.choice.speed.is_some()
    }

    /// The address that was given, or that of the only device there is.
    pub(crate) fn address(&self) -> miette::Result<Address> {
        self.choice.address()
    }

    /// Opens the device, reconnecting by itself later if `reconnect`, and begins the recording that is asked for.
    pub(crate) fn open(&self, reconnect: bool) -> miette::Result<Session> {
        self.open_at(reconnect, PlaySpeed::Unlimited)
    }

    /// The same; a recording is played at this speed where nothing is said of it.
    pub(crate) fn open_at(&self, reconnect: bool, speed: PlaySpeed) -> miette::Result<Session> {
        self.begin_recording()?;
        self.choice.open_at(reconnect, speed)
    }

    /// Whether a device that is not there may come: not where none of this name can be, nor a recording or a simulation.
    #[cfg(feature = "web")]
    pub(crate) fn can_come(&self) -> miette::Result<bool> {
        let Some(name) = &self.choice.device else { return Ok(true) };
        let address: Address = name.parse().advised()?;
        Ok(!matches!(address, Address::Recording(_) | Address::Simulated { .. }))
    }
}

impl DeviceChoice {
    /// The address that was given, or that of the only device there is.
    pub(crate) fn address(&self) -> miette::Result<Address> {
        Ok(match &self.device {
            Some(name) => name.parse().advised()?,
            None => address::only_device(&address::ports().advised()?).advised()?,
        })
    }

    /// Opens the device, reconnecting by itself later if `reconnect`.
    pub(crate) fn open(&self, reconnect: bool) -> miette::Result<Session> {
        self.open_at(reconnect, PlaySpeed::Unlimited)
    }

    /// The same; a recording is played at this speed where nothing is said of it.
    fn open_at(&self, reconnect: bool, speed: PlaySpeed) -> miette::Result<Session> {
        let options = self.options(reconnect);
        let speed = self.speed.map_or(speed, PlaySpeed::Times);
        match self.address()? {
            Address::Recording(path) => recording::play::open(Path::new(&path), options, speed),
            address => Session::open_noted(&address, options, recording::recorder()).advised(),
        }
    }

    /// The options of a session with this device.
    fn options(&self, reconnect: bool) -> SessionOptions {
        SessionOptions { baud: self.baud, reconnect }
    }
}
