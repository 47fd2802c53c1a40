//! What every command that talks to a device takes: which one, and at what speed.

use crate::advice::Advise as _;
use palpate_device::session::{Session, SessionOptions};
use palpate_device::transport::address::{self, Address};

/// How to find the device.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Device")]
pub(crate) struct DeviceArguments {
    /// Serial port, tcp:HOST:PORT, or sim:SEED for a simulated finger [default: the one USB serial port]
    #[arg(long, short = 'd', value_name = "DEVICE", env = "PALPATE_DEVICE")]
    device: Option<String>,

    /// Speed of the serial line in baud [default: 921600, then 115200]
    #[arg(long, value_name = "BAUD")]
    baud: Option<u32>,
}

impl DeviceArguments {
    /// The address that was given, or that of the only device there is.
    pub(crate) fn address(&self) -> miette::Result<Address> {
        Ok(match &self.device {
            Some(name) => name.parse().advised()?,
            None => address::only_device(&address::ports().advised()?).advised()?,
        })
    }

    /// Opens the device, reconnecting by itself later if `reconnect`.
    pub(crate) fn open(&self, reconnect: bool) -> miette::Result<Session> {
        Session::open(&self.address()?, self.options(reconnect)).advised()
    }

    /// The options of a session with this device.
    pub(crate) fn options(&self, reconnect: bool) -> SessionOptions {
        SessionOptions { baud: self.baud, reconnect }
    }
}
