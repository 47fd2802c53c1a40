//! The pins through which firmware sees the simulated front-end: SPI with chip select, DRDY, SYNC/RESET.
//!
//! The handles share the front-end through a [`RefCell`], so that the firmware's driver can hold them while the
//! world is stepped. One transaction of [`SpiDevice`] is one frame, however many operations it has.
//!
//! Errors: [`PortBusy`] when a handle is used while the front-end is borrowed, which only a caller that steps the
//! world from within a transfer can bring about.
//!
//! ```
//! use core::cell::RefCell;
//! use embedded_hal::{digital::InputPin, spi::SpiDevice};
//! use palpate_shared::sim::{DataReadyPin, FingerConfig, SimulatedFrontEnd, SpiPort};
//!
//! let front_end = RefCell::new(SimulatedFrontEnd::new(FingerConfig::default(), 1));
//! let (mut spi, mut data_ready) = (SpiPort::new(&front_end), DataReadyPin::new(&front_end));
//! front_end.borrow_mut().step();
//! assert!(data_ready.is_low()?);
//! let mut frame = [0; 12]; // NULL: response, two channels, CRC
//! spi.transfer_in_place(&mut frame)?;
//! assert!(data_ready.is_high()?);
//! # Ok::<(), palpate_shared::sim::PortBusy>(())
//! ```

use core::cell::RefCell;

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{self, InputPin, OutputPin};
use embedded_hal::spi::{self, Operation, SpiDevice};

use super::front_end::SimulatedFrontEnd;

/// A handle was used while the front-end was borrowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortBusy;

impl core::fmt::Display for PortBusy {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("the simulated front-end is borrowed; do not step it during a transfer")
    }
}

impl core::error::Error for PortBusy {}

impl spi::Error for PortBusy {
    fn kind(&self) -> spi::ErrorKind {
        spi::ErrorKind::Other
    }
}

impl digital::Error for PortBusy {
    fn kind(&self) -> digital::ErrorKind {
        digital::ErrorKind::Other
    }
}

/// The SPI bus, mode 1, with its chip select.
#[derive(Clone, Copy, Debug)]
pub struct SpiPort<'a>(&'a RefCell<SimulatedFrontEnd>);

impl<'a> SpiPort<'a> {
    /// The bus of a front-end.
    #[must_use]
    pub const fn new(front_end: &'a RefCell<SimulatedFrontEnd>) -> Self {
        Self(front_end)
    }

    /// Levels of the board's digital inputs; all low while the front-end is borrowed elsewhere.
    #[must_use]
    pub fn inputs(&self) -> u8 {
        self.0.try_borrow().map_or(0, |front_end| front_end.inputs())
    }
}

impl spi::ErrorType for SpiPort<'_> {
    type Error = PortBusy;
}

impl SpiDevice for SpiPort<'_> {
    /// One frame. The host sends zeros where it only reads; delays pass on the bus and not in the world.
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), PortBusy> {
        let mut front_end = self.0.try_borrow_mut().map_err(|_| PortBusy)?;
        front_end.select();
        for operation in operations {
            operate(&mut front_end, operation);
        }
        front_end.deselect();
        Ok(())
    }
}

/// One operation of a transaction.
fn operate(front_end: &mut SimulatedFrontEnd, operation: &mut Operation<'_, u8>) {
    match operation {
        Operation::Read(bytes) => bytes.iter_mut().for_each(|byte| *byte = front_end.exchange(0)),
        Operation::Write(bytes) => bytes.iter().for_each(|&byte| {
            front_end.exchange(byte);
        }),
        Operation::TransferInPlace(bytes) => bytes.iter_mut().for_each(|byte| *byte = front_end.exchange(*byte)),
        Operation::Transfer(read, write) => transfer(front_end, read, write),
        Operation::DelayNs(duration_ns) => front_end.wait(*duration_ns),
    }
}

/// Waits between frames, chip select high; nothing passes while the front-end is borrowed elsewhere.
impl DelayNs for SpiPort<'_> {
    fn delay_ns(&mut self, duration_ns: u32) {
        if let Ok(mut front_end) = self.0.try_borrow_mut() {
            front_end.wait(duration_ns);
        }
    }
}

/// A transfer between buffers of any lengths: zeros out, or bytes dropped, where one is longer.
fn transfer(front_end: &mut SimulatedFrontEnd, read: &mut [u8], write: &[u8]) {
    for i in 0..read.len().max(write.len()) {
        let byte = front_end.exchange(write.get(i).copied().unwrap_or(0));
        if let Some(slot) = read.get_mut(i) {
            *slot = byte;
        }
    }
}

/// The DRDY pin: low while unread data are there.
#[derive(Clone, Copy, Debug)]
pub struct DataReadyPin<'a>(&'a RefCell<SimulatedFrontEnd>);

impl<'a> DataReadyPin<'a> {
    /// DRDY of a front-end.
    #[must_use]
    pub const fn new(front_end: &'a RefCell<SimulatedFrontEnd>) -> Self {
        Self(front_end)
    }
}

impl digital::ErrorType for DataReadyPin<'_> {
    type Error = PortBusy;
}

impl InputPin for DataReadyPin<'_> {
    fn is_high(&mut self) -> Result<bool, PortBusy> {
        self.is_low().map(|low| !low)
    }

    fn is_low(&mut self) -> Result<bool, PortBusy> {
        self.0.try_borrow().map(|front_end| front_end.is_data_ready()).map_err(|_| PortBusy)
    }
}

/// The SYNC/RESET pin. A low time below 250 µs of simulated time synchronises, a longer one resets.
#[derive(Clone, Copy, Debug)]
pub struct SyncResetPin<'a>(&'a RefCell<SimulatedFrontEnd>);

impl<'a> SyncResetPin<'a> {
    /// SYNC/RESET of a front-end.
    #[must_use]
    pub const fn new(front_end: &'a RefCell<SimulatedFrontEnd>) -> Self {
        Self(front_end)
    }

    /// Drives the pin high or low.
    fn set(&self, high: bool) -> Result<(), PortBusy> {
        self.0.try_borrow_mut().map(|mut front_end| front_end.set_sync_reset(high)).map_err(|_| PortBusy)
    }
}

impl digital::ErrorType for SyncResetPin<'_> {
    type Error = PortBusy;
}

impl OutputPin for SyncResetPin<'_> {
    fn set_low(&mut self) -> Result<(), PortBusy> {
        self.set(false)
    }

    fn set_high(&mut self) -> Result<(), PortBusy> {
        self.set(true)
    }
}
