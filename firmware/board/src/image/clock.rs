//! The processor's clock: 168 MHz from the crystal, else from the internal oscillator, else the latter as it is.
//!
//! The crystal is measured against the internal oscillator before the PLL gets it (`crystal`): TIM11 sees the crystal
//! through the divider that it shares with the real-time clock, and counts the internal oscillator, which the core still
//! runs on. Every wait is bounded, so a board whose crystal does not start, or is another, still comes up and says so
//! in its hello.
//!
//! Source: RM0090 (STM32F405 reference manual), chapters 3.5 (flash), 7 (RCC), 19.5.11 (TIM11_OR); 30.3.4 for the line's
//! divider.

use palpate_shared::wire::ClockSource;
use stm32f4::stm32f405::{FLASH, RCC, TIM11};

use crate::crystal::{ConverterClockSource, Crystal, Periods};

/// The internal oscillator, in MHz.
const INTERNAL_MHZ: u8 = 16;

/// What the crystal is divided by on its way to TIM11: the most that there is.
const CRYSTAL_DIVIDER: u8 = 31;

/// Rising edges that make a capture: the most that there are.
const EDGES_PER_CAPTURE: u32 = 8;

/// Captures that make a measurement: 124 µs with 8 MHz, and 1984 ticks, of which one more or less is 0.05 %.
const CAPTURES: u32 = 4;

/// How often one capture is waited for: 1 ms and more; with 4 MHz, the slowest that swings, it takes 62 µs.
const CAPTURE_POLLS: u32 = 2000;

/// What TIM11 counts to: it has 16 bits.
const COUNTER_MASK: u32 = 0xFFFF;

/// `TIM11_OR`: its input is the crystal, divided.
const INPUT_FROM_CRYSTAL: u8 = 0b10;

/// `TIM11_CCMR1`: channel 1 is an input, and every eighth edge counts.
const CAPTURE_EIGHTH_EDGES: u32 = 0b11 << 2 | 0b01;

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
    /// What the board has for a crystal.
    pub(super) crystal: Crystal,
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
        Self { source: ClockSource::Host, crystal: Crystal::Absent, core_hz, line_hz: INTERNAL_HZ, link_baud: 0 }
    }

    /// The bare internal oscillator, as after a reset.
    const fn bare(crystal: Crystal) -> Self {
        let (source, line_hz) = (ClockSource::Internal, INTERNAL_HZ);
        Self { source, crystal, core_hz: INTERNAL_HZ, line_hz, link_baud: BAUD_FALLBACK }
    }

    /// 168 MHz, 84 MHz for the UART.
    const fn fast(crystal: Crystal) -> Self {
        let source = if let Crystal::Usable { .. } = crystal { ClockSource::Crystal } else { ClockSource::InternalPll };
        Self { source, crystal, core_hz: PLL_HZ, line_hz: PLL_HZ / 2, link_baud: BAUD }
    }

    /// The UART's divider, rounded: 91 for 921600 baud from 84 MHz, 0.2 % off.
    pub(super) fn line_divider(self) -> u16 {
        let baud = if self.link_baud == 0 { BAUD_FALLBACK } else { self.link_baud };
        u16::try_from((self.line_hz + baud / 2) / baud).unwrap_or(u16::MAX)
    }
}

/// Starts the fastest clock that there is.
pub(super) fn start(rcc: &RCC, flash: &FLASH, counter: &TIM11) -> Clock {
    stop_pll(rcc);
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    let swings = within(CRYSTAL_POLLS, || rcc.cr().read().hserdy().bit_is_set());
    let crystal = Crystal::of(swings.then(|| measure(rcc, counter)));
    if let Crystal::Odd { khz } = crystal {
        defmt::warn!("a crystal of {=u32} kHz, neither 8 nor 12 MHz; it is not used", khz);
        rcc.cr().modify(|_, w| w.hseon().clear_bit());
    }
    if start_pll(rcc, flash, crystal) { Clock::fast(crystal) } else { Clock::bare(crystal) }
}

/// Puts 8 MHz for the converter out at the pin MCO1 (PA8; RM0090, section 7.2.10), once the clock runs.
pub(super) fn give_out(rcc: &RCC, crystal: Crystal) {
    rcc.cfgr().modify(|_, w| match ConverterClockSource::on(crystal) {
        ConverterClockSource::Crystal => w.mco1pre().div1().mco1().hse(),
        ConverterClockSource::Internal => w.mco1pre().div2().mco1().hsi(),
    });
}

/// Back to the internal oscillator, which the core runs on after a reset; a boot loader may have left it otherwise.
fn stop_pll(rcc: &RCC) {
    rcc.cr().modify(|_, w| w.hsion().set_bit());
    rcc.cfgr().modify(|_, w| w.sw().hsi().hpre().div1().ppre1().div1().ppre2().div1());
    // An emulator has no other clock, and says so at once.
    within(PLL_POLLS, || rcc.cfgr().read().sws().is_hsi());
    rcc.cr().modify(|_, w| w.pllon().clear_bit());
}

/// Counts the internal oscillator, which the core and with it TIM11 run on, over some periods of the crystal: these, and
/// the ticks, 0 if that went wrong.
fn measure(rcc: &RCC, counter: &TIM11) -> (Periods, u32) {
    rcc.cfgr().modify(|_, w| w.rtcpre().set(CRYSTAL_DIVIDER));
    rcc.apb2enr().modify(|_, w| w.tim11en().set_bit());
    // Two cycles of its bus until it hears (ES0182, 2.1.13).
    let _ = rcc.apb2enr().read();
    cortex_m::asm::dsb();
    // SAFETY: the codes that the manual has for these fields.
    #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
    unsafe {
        counter.or().write(|w| w.rmp().bits(INPUT_FROM_CRYSTAL));
        counter.arr().write(|w| w.bits(COUNTER_MASK));
        counter.ccmr1_input().write(|w| w.bits(CAPTURE_EIGHTH_EDGES));
    }
    counter.ccer().write(|w| w.cc1e().set_bit());
    counter.cr1().write(|w| w.cen().set_bit());
    let capture = || {
        // Reading what was captured makes room for the next.
        let is_there = within(CAPTURE_POLLS, || counter.sr().read().cc1if().bit_is_set());
        is_there.then(|| counter.ccr1().read().bits())
    };
    let begun = capture();
    let ended = (0..CAPTURES).try_fold(0, |_, _| capture());
    let ticks = begun.zip(ended).map_or(0, |(begun, ended)| ended.wrapping_sub(begun) & COUNTER_MASK);
    // One that came before the last was read would make the time look longer.
    let is_whole = counter.sr().read().cc1of().bit_is_clear();
    counter.cr1().write(|w| w.cen().clear_bit());
    rcc.apb2enr().modify(|_, w| w.tim11en().clear_bit());
    let periods = Periods(u32::from(CRYSTAL_DIVIDER) * EDGES_PER_CAPTURE * CAPTURES);
    (periods, if is_whole { ticks } else { 0 })
}

/// Runs the core from the PLL; false, and nothing changed, if that does not lock.
fn start_pll(rcc: &RCC, flash: &FLASH, crystal: Crystal) -> bool {
    let (from_crystal, divider) = match crystal {
        Crystal::Usable { mhz } => (true, mhz),
        Crystal::Absent | Crystal::Odd { .. } => (false, INTERNAL_MHZ),
    };
    rcc.pllcfgr().write(|w| {
        w.pllsrc().bit(from_crystal);
        w.pllp().div2();
        // SAFETY: within the fields' ranges by RM0090, section 7.3.2.
        #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
        unsafe {
            w.pllm().bits(divider).plln().bits(PLL_MULTIPLIER).pllq().bits(PLL_USB_DIVIDER)
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
