//! The processor's clock: 168 MHz from the crystal, else from the internal oscillator, else the latter as it is.
//!
//! Every wait is bounded, so a board whose crystal does not start still comes up and says so in its hello.
//! Source: RM0090 (STM32F405 reference manual), chapters 3.5 (flash), 7 (RCC); 30.3.4 for the line's divider.

use palpate_shared::wire::ClockSource;
use stm32f4::stm32f405::{FLASH, RCC};

/// The crystal, in MHz: Olimex STM32-H405.
const CRYSTAL_MHZ: u16 = 8;

/// The internal oscillator, in MHz.
const INTERNAL_MHZ: u16 = 16;

/// The internal oscillator, in Hz.
const INTERNAL_HZ: u32 = 16_000_000;

/// The PLL's output, in Hz: the fastest that the processor may run.
const PLL_HZ: u32 = 168_000_000;

/// What the PLL multiplies 1 MHz by, before it halves the result.
const PLL_MULTIPLIER: u16 = 336;

/// The PLL's divider for USB: 48 MHz.
const PLL_USB_DIVIDER: u8 = 7;

/// Wait states of the flash at 168 MHz and 3.3 V (RM0090, table 10).
const FLASH_WAIT_STATES: u8 = 5;

/// How often the crystal is looked at before it counts as absent: 25 ms and more at 16 MHz; it takes 2 ms.
const CRYSTAL_POLLS: u32 = 100_000;

/// How often the PLL is looked at: 2.5 ms and more; it locks within 0.3 ms.
const PLL_POLLS: u32 = 10_000;

/// The line's speed with a clock precise enough for it, in baud.
const BAUD: u32 = 921_600;

/// The line's speed on the bare internal oscillator: its divider for 921600 would be 2 % off.
const BAUD_FALLBACK: u32 = 115_200;

/// How the clock came up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    /// What it runs on.
    pub(super) source: ClockSource,
    /// Frequency of the core, in Hz.
    pub(super) core_hz: u32,
    /// Frequency of the bus that the line's UART is on, in Hz.
    line_hz: u32,
    /// Speed of the line, in baud; 0 where it has none.
    pub(super) link_baud: u32,
}

impl Clock {
    /// An emulator's: no oscillator answers, instructions take what time they take, and the line has no speed.
    pub(super) const fn emulated(core_hz: u32) -> Self {
        Self { source: ClockSource::Host, core_hz, line_hz: INTERNAL_HZ, link_baud: 0 }
    }

    /// The bare internal oscillator, as after a reset.
    const fn bare() -> Self {
        Self { source: ClockSource::Internal, core_hz: INTERNAL_HZ, line_hz: INTERNAL_HZ, link_baud: BAUD_FALLBACK }
    }

    /// 168 MHz, 84 MHz for the UART.
    const fn fast(source: ClockSource) -> Self {
        Self { source, core_hz: PLL_HZ, line_hz: PLL_HZ / 2, link_baud: BAUD }
    }

    /// The UART's divider, rounded: 91 for 921600 baud from 84 MHz, 0.2 % off.
    pub(super) fn line_divider(self) -> u16 {
        let baud = if self.link_baud == 0 { BAUD_FALLBACK } else { self.link_baud };
        u16::try_from((self.line_hz + baud / 2) / baud).unwrap_or(u16::MAX)
    }
}

/// Starts the fastest clock that there is.
pub(super) fn start(rcc: &RCC, flash: &FLASH) -> Clock {
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    let has_crystal = within(CRYSTAL_POLLS, || rcc.cr().read().hserdy().bit_is_set());
    let source = if has_crystal { ClockSource::Crystal } else { ClockSource::InternalPll };
    if start_pll(rcc, flash, has_crystal) { Clock::fast(source) } else { Clock::bare() }
}

/// Runs the core from the PLL; false, and nothing changed, if that does not lock.
fn start_pll(rcc: &RCC, flash: &FLASH, from_crystal: bool) -> bool {
    let divider = if from_crystal { CRYSTAL_MHZ } else { INTERNAL_MHZ };
    rcc.pllcfgr().write(|w| {
        w.pllsrc().bit(from_crystal);
        w.pllp().div2();
        // SAFETY: within the fields' ranges by RM0090, section 7.3.2.
        #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
        unsafe {
            w.pllm().bits(divider.to_le_bytes()[0]).plln().bits(PLL_MULTIPLIER).pllq().bits(PLL_USB_DIVIDER)
        }
    });
    rcc.cr().modify(|_, w| w.pllon().set_bit());
    if !within(PLL_POLLS, || rcc.cr().read().pllrdy().bit_is_set()) {
        rcc.cr().modify(|_, w| w.pllon().clear_bit());
        return false;
    }
    flash.acr().write(|w| {
        w.prften().set_bit().icen().set_bit().dcen().set_bit();
        w.latency().set(FLASH_WAIT_STATES)
    });
    // 42 MHz and 84 MHz for the peripherals: the most that they may have.
    rcc.cfgr().modify(|_, w| w.hpre().div1().ppre1().div4().ppre2().div2());
    rcc.cfgr().modify(|_, w| w.sw().pll());
    within(PLL_POLLS, || rcc.cfgr().read().sws().is_pll())
}

/// Whether something comes true while it is looked at so many times.
fn within(polls: u32, is_true: impl Fn() -> bool) -> bool {
    (0..polls).any(|_| is_true())
}
