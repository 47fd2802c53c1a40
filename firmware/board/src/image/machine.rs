//! What this program runs on: the chip it was made for, or an emulator of it.
//!
//! An emulator has no oscillators, no debug unit and no factory-programmed number, and its line has no speed. It is
//! told apart by the debug unit's identity, which reads 0 there. The hello names it, so that nothing which an
//! emulator says can pass for a measurement on hardware.

use cortex_m::peripheral::{SCB, SYST};
use palpate_shared::wire::{ClockSource, DeviceId};
use stm32f4::stm32f405::{DBGMCU, RCC, SYSCFG};

use super::clock::Clock;
use crate::crystal::Crystal;

/// The factory-programmed unique number, 96 bits (RM0090, section 39.1).
const UNIQUE_NUMBER: *const [u8; 12] = 0x1FFF_7A10 as *const _;

/// The chip's own loader, which begins with its vector table (RM0090, section 2.4; AN2606).
const LOADER: u32 = 0x1FFF_0000;

/// Bytes of the memory that it lies in.
const LOADER_BYTES: u32 = 30 * 1024;

/// What the upper bits of an address in the chip's RAM are.
const RAM_PREFIX: u32 = 0x2000_0000 >> 20;

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

    /// Hands over to the chip's own loader, which stays until the next reset. Comes back where there is none: an emulator
    /// has none, and something else may be where it should be.
    pub(super) fn enter_loader(self, (rcc, system): (&RCC, &SYSCFG), control: &SCB) {
        if self == Self::Emulator {
            return;
        }
        let table = LOADER as *const u32;
        // SAFETY: on this chip the addresses hold words that never change.
        #[expect(unsafe_code, reason = "the loader is at an address and nowhere else")]
        let (stack, start) = unsafe { (table.read_volatile(), table.add(1).read_volatile()) };
        if stack >> 20 != RAM_PREFIX || !(LOADER..LOADER + LOADER_BYTES).contains(&start) {
            defmt::warn!("no loader: stack {=u32:#x}, start {=u32:#x}", stack, start);
            return;
        }
        rcc.apb2enr().modify(|_, w| w.syscfgen().set_bit());
        // Two cycles of its bus until it hears (ES0182, 2.1.13).
        let _ = rcc.apb2enr().read();
        cortex_m::asm::dsb();
        // It shows at address 0, as after a reset with BOOT0 high.
        system.memrmp().write(|w| w.mem_mode().system_flash());
        // SAFETY: nothing runs but this, no interrupt is on, and what runs next brings its own stack and vectors.
        #[expect(unsafe_code, reason = "another program takes over")]
        unsafe {
            control.vtor.write(LOADER);
            cortex_m::asm::dsb();
            cortex_m::asm::isb();
            cortex_m::asm::bootload(table)
        }
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
