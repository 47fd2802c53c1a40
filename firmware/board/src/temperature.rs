//! The chip's temperature from what its own converter reads.
//!
//! Two channels are read: the temperature sensor, and the internal reference, which tells what the supply is (the
//! converter measures in parts of it). The factory stored what both read at 3.3 V: the sensor at 30 and at 110 °C, the
//! reference at 30 °C. It is the temperature of the chip, some kelvin above the board's, and not of the gauges: it tells
//! when all is warming up, and how the board's surroundings change.
//!
//! Implements: STM32F405 datasheet (DocID022152), "Temperature sensor characteristics" and "Embedded internal reference
//! voltage", with their tables of calibration values; between the two temperatures a straight line, ±1.5 K.
//! Pure, in integers, and tested on a PC; `image/thermometer.rs` reads the converter.

/// Readings of each channel in one temperature: so many that their products fit 32 bits.
pub(crate) const READINGS: u32 = 4;

/// What the sensor's readings are multiplied by, so that rounding takes less than 0.03 K.
const FINER: u32 = 16;

/// Temperature of the first calibration value, in hundredths of a degree Celsius.
const COLD_CENTI_C: i32 = 3000;

/// From the first calibration value's temperature to the second's, in hundredths of a kelvin.
const SPAN_CENTI_K: i32 = 8000;

/// How far both calibration values are apart: 2.5 mV/K · 80 K is 248 steps of 3.3 V / 4096, and half or twice as much
/// is no calibration.
const SPAN: core::ops::RangeInclusive<u16> = 124..=496;

/// What the reference reads at 3.3 V: 1.18 to 1.24 V, and a tenth on either side.
const REFERENCE: core::ops::RangeInclusive<u16> = 1318..=1693;

/// What the chip is made for, and a little beyond, in hundredths of a degree Celsius; outside, something is wrong.
const POSSIBLE_CENTI_C: core::ops::RangeInclusive<i32> = -5000..=14_000;

/// What the factory stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Calibration {
    reference: u16,
    cold: u16,
    span: u16,
}

impl Calibration {
    /// Of the three stored words: reference, sensor at 30 °C, sensor at 110 °C. `None` if they cannot be that, as where
    /// nothing was stored.
    pub(crate) fn of([reference, cold, warm]: [u16; 3]) -> Option<Self> {
        let span = warm.checked_sub(cold).filter(|span| SPAN.contains(span))?;
        (REFERENCE.contains(&reference) && warm < 4096).then_some(Self { reference, cold, span })
    }

    /// Hundredths of a degree Celsius, of the sums of [`READINGS`] readings, 12 bits each; `None` if they cannot be
    /// right.
    pub(crate) fn centi_celsius(self, sensor: u32, reference: u32) -> Option<i16> {
        let at_calibration = (FINER * sensor * u32::from(self.reference)).checked_div(reference)?;
        let above_cold = i32::try_from(at_calibration).ok()? - i32::from(self.cold) * FINER.cast_signed();
        let span = i32::from(self.span) * FINER.cast_signed();
        // A supply so low that this does not fit is no supply.
        let centi_c = COLD_CENTI_C + above_cold.checked_mul(SPAN_CENTI_K)? / span;
        POSSIBLE_CENTI_C.contains(&centi_c).then(|| i16::try_from(centi_c).ok()).flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A usual chip: 1.21 V, 0.775 V at 30 °C, 2.5 mV/K; in steps of 3.3 V / 4096, rounded by hand.
    const STORED: [u16; 3] = [1502, 962, 1210];

    /// What a converter on so many volts reads in sum, exactly but for its rounding.
    fn sums(celsius: f64, supply_v: f64) -> (u32, u32) {
        let [reference, cold, warm] = STORED.map(|word| f64::from(word) * 3.3);
        let sensor = cold + (warm - cold) * (celsius - 30.0) / 80.0;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some thousands")]
        let sum = |volts: f64| (volts / supply_v).round() as u32 * READINGS;
        (sum(sensor), sum(reference))
    }

    #[test]
    fn the_temperature_comes_back_whatever_the_supply() {
        let calibration = Calibration::of(STORED).unwrap();
        for celsius in [-40.0, 0.0, 22.5, 30.0, 85.0, 105.0] {
            for supply_v in [2.7, 3.0, 3.3, 3.6] {
                let (sensor, reference) = sums(celsius, supply_v);
                let found = f64::from(calibration.centi_celsius(sensor, reference).unwrap()) / 100.0;
                // Half a step of the sensor is 0.16 K; half a step of the reference, in 1500, moves it as much again.
                assert!((found - celsius).abs() < 0.4, "{found} for {celsius} °C at {supply_v} V");
            }
        }
    }

    #[test]
    fn calibration_values_read_as_their_temperatures() {
        let calibration = Calibration::of(STORED).unwrap();
        let [reference, cold, warm] = STORED.map(|word| u32::from(word) * READINGS);
        assert_eq!(calibration.centi_celsius(cold, reference), Some(3000));
        assert_eq!(calibration.centi_celsius(warm, reference), Some(11_000));
    }

    #[test]
    fn what_is_no_calibration_gives_no_temperature() {
        for stored in [[0; 3], [0xFFFF; 3], [1502, 1210, 962], [1502, 962, 1060], [1502, 962, 1500], [900, 962, 1210]] {
            assert_eq!(Calibration::of(stored), None, "{stored:?}");
        }
    }

    #[test]
    fn what_cannot_be_right_gives_no_temperature() {
        let calibration = Calibration::of(STORED).unwrap();
        let all = 4095 * READINGS;
        for (sensor, reference) in [(0, 0), (all, 0), (0, all), (all, 1), (all, all / 2), (all, all)] {
            assert_eq!(calibration.centi_celsius(sensor, reference), None, "{sensor} {reference}");
        }
    }
}
