//! What this program runs on: the chip it was made for, or an emulator of it.
//!
//! An emulator has no oscillators, no debug unit and no factory-programmed number, and its line has no speed. It is
//! told apart by the debug unit's identity, which reads 0 there. The hello names it, so that nothing which an
//! emulator says can pass for a measurement on hardware.

use cortex_m::peripheral::SYST;
use palpate_shared::wire::{ClockSource, DeviceId};
use stm32f4::stm32f405::DBGMCU;

use super::clock::Clock;
use crate::crystal::Crystal;

/// The factory-programmed unique number, 96 bits (RM0090, section 39.1).
const UNIQUE_NUMBER: *const [u8; 12] = 0x1FFF_7A10 as *const _;

/// The emulator's core runs eight times as fast as its reference clock, whose speed it states.
const REFERENCE_DIVIDER: u32 = 8;

/// SysTick's calibration value is for 10 ms.
const CALIBRATIONS_PER_S: u32 = 100;

/// What this program runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Machine {
    /// The STM32F405 of a board.
    Chip,
    /// An emulator of it.
    Emulator,
}

impl Machine {
    /// Asks the debug unit for its `DBGMCU_IDCODE` (RM0090, section 38.6.1). Any answer is a chip's: early ones name
    /// another device than 413.
    pub(super) fn detect(debug_unit: &DBGMCU) -> Self {
        if debug_unit.idcode().read().bits() == 0 { Self::Emulator } else { Self::Chip }
    }

    /// The board's name, and whether it can be talked to over USB, or why not. At most 24 characters.
    pub(super) const fn name(self, has_usb: bool, crystal: Crystal) -> &'static str {
        match (self, has_usb, crystal) {
            (Self::Chip, true, Crystal::Usable { mhz: 12 }) => "STM32F405 with USB",
            (Self::Chip, true, _) => "STM32-H405 with USB",
            (Self::Chip, false, Crystal::Odd { .. }) => "STM32F405, odd crystal",
            (Self::Chip, false, _) => "STM32-H405, no USB",
            (Self::Emulator, ..) => "STM32-H405, emulated",
        }
    }

    /// The clock, given how it came up.
    pub(super) fn clock(self, started: Clock, timer: &SYST) -> Clock {
        match self {
            Self::Emulator if started.source == ClockSource::Internal => {
                let reference_hz = (timer.calib.read() & 0x00FF_FFFF).wrapping_add(1) * CALIBRATIONS_PER_S;
                Clock::emulated(reference_hz * REFERENCE_DIVIDER)
            }
            _ => started,
        }
    }

    /// The device's unique number.
    pub(super) fn device_id(self) -> DeviceId {
        match self {
            // SAFETY: on this chip the address holds twelve bytes that never change.
            #[expect(unsafe_code, reason = "the number is at an address and nowhere else")]
            Self::Chip => DeviceId(unsafe { UNIQUE_NUMBER.read_volatile() }),
            Self::Emulator => DeviceId(*b"emulated-405"),
        }
    }
}
