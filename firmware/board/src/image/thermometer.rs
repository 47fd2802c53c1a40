//! The chip's temperature, about once a second: its own converter, its sensor and its reference, never waited for.
//!
//! At each look one conversion is fetched that the look before began, and the next one begun; looks are 0.1 s apart, a
//! conversion takes 25 µs at most.
//!
//! Registers: RM0090, chapter 13 (ADC; 13.10 for the sensor). An emulator has no factory values, and no temperature.

use stm32f4::stm32f405::{ADC_COMMON, ADC1, RCC};

use super::machine::Machine;
use crate::temperature::{Calibration, READINGS};

/// Where the factory stored three words: the reference's reading, the sensor's at 30 °C, and at 110 °C.
const STORED: *const [u16; 3] = 0x1FFF_7A2A as *const _;

/// The sensor's channel.
const SENSOR: u8 = 16;

/// The reference's channel.
const REFERENCE: u8 = 17;

/// The converter and what it read since the last temperature.
pub(super) struct Thermometer {
    converter: ADC1,
    calibration: Calibration,
    /// Sums of the readings, sensor first.
    sums: [u32; 2],
    /// Conversions fetched: even ones are the sensor's.
    fetched: u32,
    /// Whether one was begun.
    begun: bool,
}

impl Thermometer {
    /// Starts the converter, on a chip that the factory has calibrated.
    pub(super) fn start(converter: ADC1, common: &ADC_COMMON, rcc: &RCC, machine: Machine) -> Option<Self> {
        if machine == Machine::Emulator {
            return None;
        }
        // SAFETY: on this chip the address holds three words that never change, two bytes aligned.
        #[expect(unsafe_code, reason = "the values are at an address and nowhere else")]
        let calibration = Calibration::of(unsafe { STORED.read_volatile() })?;
        rcc.apb2enr().modify(|_, w| w.adc1en().set_bit());
        // Two cycles of its bus until it hears (ES0182, 2.1.13).
        let _ = rcc.apb2enr().read();
        cortex_m::asm::dsb();
        // 21 MHz at most, of 36; the sensor wants 10 µs for a sample, and gets 480 cycles.
        common.ccr().modify(|_, w| w.adcpre().div4().tsvrefe().enabled());
        converter.smpr1().modify(|_, w| w.smp16().cycles480().smp17().cycles480());
        converter.cr2().modify(|_, w| w.adon().enabled());
        Some(Self { converter, calibration, sums: [0; 2], fetched: 0, begun: false })
    }

    /// Fetches a reading and begins the next; gives the temperature, in hundredths of a degree Celsius, when there are
    /// enough.
    pub(super) fn look(&mut self) -> Option<i16> {
        if self.begun && self.converter.sr().read().eoc().bit_is_set() {
            // Reading it makes room for the next.
            let [sensor, reference] = &mut self.sums;
            let sum = if self.fetched.is_multiple_of(2) { sensor } else { reference };
            *sum += u32::from(self.converter.dr().read().data().bits());
            self.fetched += 1;
        }
        let channel = if self.fetched.is_multiple_of(2) { SENSOR } else { REFERENCE };
        // SAFETY: a channel of this converter.
        #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
        self.converter.sqr3().write(|w| unsafe { w.sq1().bits(channel) });
        self.converter.cr2().modify(|_, w| w.swstart().set_bit());
        self.begun = true;
        if self.fetched < 2 * READINGS {
            return None;
        }
        let [sensor, reference] = core::mem::take(&mut self.sums);
        self.fetched = 0;
        self.calibration.centi_celsius(sensor, reference)
    }
}
