//! Loaders on USB: what is plugged in, and requests as control transfers.
//!
//! **No test has spoken to a chip by this**; what it carries is tested against a loader in memory. DFU 1.1, sections 3 and 4;
//! AN2606 for vendor and product. Errors: [`UsbError`].

use std::time::Duration;

use nusb::descriptors::language_id::US_ENGLISH;
use nusb::transfer::{ControlIn, ControlOut, ControlType, Recipient, TransferError};
use nusb::{DeviceInfo, Interface, MaybeFuture as _};

use super::{DfuPort, LOADER};

/// How long a request may take: the loader answers at once, and says by itself when it is busy.
const PATIENCE: Duration = Duration::from_secs(5);

/// The loader's only interface.
const INTERFACE: u8 = 0;

/// What the name of the memory begins with that images go to. Others are option bytes and one-time memory.
const FLASH_NAME: &str = "@Internal Flash";

/// Requests of the class (DFU 1.1, table 3.2).
const DOWNLOAD: u8 = 1;
const UPLOAD: u8 = 2;
const GET_STATUS: u8 = 3;
const CLEAR_STATUS: u8 = 4;
const ABORT: u8 = 6;

/// Why a loader cannot be reached.
#[derive(Debug, thiserror::Error)]
pub enum UsbError {
    /// The system does not tell what is plugged in.
    #[error("cannot list what is plugged in to USB: {0}")]
    List(nusb::Error),
    /// The system does not let it be used.
    #[error("cannot use the loader at USB: {0}")]
    Open(nusb::Error),
    /// It has no memory for images.
    #[error("the loader names no memory as {FLASH_NAME:?}")]
    NoFlash,
    /// A request did not arrive, or was not obeyed.
    #[error("{0}")]
    Transfer(#[from] TransferError),
    /// It does not say what it is.
    #[error("the loader does not name its memory: {0}")]
    Name(#[from] nusb::GetDescriptorError),
}

impl UsbError {
    /// Whether whoever runs this has no right to.
    #[must_use]
    pub fn is_forbidden(&self) -> bool {
        matches!(self, Self::Open(error) if error.kind() == nusb::ErrorKind::PermissionDenied)
    }
}

/// A loader that is plugged in.
#[derive(Clone, Debug)]
pub struct FoundLoader(DeviceInfo);

/// The loaders that are plugged in now.
///
/// # Errors
/// [`UsbError::List`].
pub fn loaders() -> Result<Vec<FoundLoader>, UsbError> {
    let there = nusb::list_devices().wait().map_err(UsbError::List)?;
    Ok(there.filter(|device| (device.vendor_id(), device.product_id()) == LOADER).map(FoundLoader).collect())
}

impl FoundLoader {
    /// Its serial number, as the chip's maker has it made; empty if it has none.
    #[must_use]
    pub fn serial_number(&self) -> &str {
        self.0.serial_number().unwrap_or_default()
    }

    /// Whether it is the same plug as another, not unplugged meanwhile.
    #[must_use]
    pub fn is(&self, other: &Self) -> bool {
        self.0.id() == other.0.id()
    }

    /// Takes hold of it.
    ///
    /// # Errors
    /// [`UsbError`]: also where it has no memory for images.
    pub fn open(&self) -> Result<UsbLoader, UsbError> {
        let device = self.0.open().wait().map_err(UsbError::Open)?;
        let interface = device.claim_interface(INTERFACE).wait().map_err(UsbError::Open)?;
        let named =
            interface.descriptors().filter_map(|setting| Some((setting.alternate_setting(), setting.string_index()?)));
        for (setting, name) in named.collect::<Vec<_>>() {
            let memory = device.get_string_descriptor(name, US_ENGLISH, PATIENCE).wait()?;
            if memory.starts_with(FLASH_NAME) {
                interface.set_alt_setting(setting).wait().map_err(UsbError::Open)?;
                return Ok(UsbLoader { interface, memory });
            }
        }
        Err(UsbError::NoFlash)
    }
}

/// The way to a loader on USB.
pub struct UsbLoader {
    interface: Interface,
    memory: String,
}

impl UsbLoader {
    fn order(&self, request: u8, value: u16, data: &[u8]) -> Result<(), UsbError> {
        let (control_type, recipient, index) = (ControlType::Class, Recipient::Interface, INTERFACE.into());
        let order = ControlOut { control_type, recipient, request, value, index, data };
        Ok(self.interface.control_out(order, PATIENCE).wait()?)
    }

    fn ask(&self, request: u8, value: u16, length: usize) -> Result<Vec<u8>, UsbError> {
        let (control_type, recipient, index) = (ControlType::Class, Recipient::Interface, INTERFACE.into());
        let length = u16::try_from(length).unwrap_or(u16::MAX);
        let question = ControlIn { control_type, recipient, request, value, index, length };
        Ok(self.interface.control_in(question, PATIENCE).wait()?)
    }
}

impl DfuPort for UsbLoader {
    type Error = UsbError;

    fn memory(&mut self) -> Result<String, UsbError> {
        Ok(self.memory.clone())
    }

    fn download(&mut self, block: u16, data: &[u8]) -> Result<(), UsbError> {
        self.order(DOWNLOAD, block, data)
    }

    fn upload(&mut self, block: u16, into: &mut [u8]) -> Result<usize, UsbError> {
        let came = self.ask(UPLOAD, block, into.len())?;
        let length = came.len().min(into.len());
        into[..length].copy_from_slice(&came[..length]);
        Ok(length)
    }

    fn status(&mut self) -> Result<[u8; 6], UsbError> {
        let came = self.ask(GET_STATUS, 0, 6)?;
        // A status that is too short says nothing: as if it had not come.
        came.try_into().map_err(|_| UsbError::Transfer(TransferError::Fault))
    }

    fn clear_status(&mut self) -> Result<(), UsbError> {
        self.order(CLEAR_STATUS, 0, &[])
    }

    fn abort(&mut self) -> Result<(), UsbError> {
        self.order(ABORT, 0, &[])
    }

    fn wait(&mut self, time: Duration) {
        std::thread::sleep(time);
    }
}
