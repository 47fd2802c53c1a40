//! The analogue front-ends, by table: what firmware, host and simulation have to know of each.
//!
//! To add one: a variant of [`FrontEndKind`], which is a change of the wire format, and a row here. Its driver is in the
//! firmware's core (`docs/ARCHITECTURE.md`, "A converter").
//!
//! Units: in the names. Errors: none; what cannot be told is `None`.

use serde::{Deserialize, Serialize};

use crate::units::Counts;

/// A kind of analogue front-end; the numbers of the variants are on the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum FrontEndKind {
    /// Texas Instruments ADS131M02: two channels at once, 24 bit.
    #[default]
    Ads131m02,
    /// Texas Instruments ADS131M04: four channels; excitation and NTC on the last two. Since version 1.3.
    Ads131m04,
}

/// What is known of a front-end before it is asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrontEndFacts {
    /// Which one it is, on the wire.
    pub kind: FrontEndKind,
    /// Its name, as its maker writes it.
    pub name: &'static str,
    /// Input of the largest code at gain 1, in µV.
    pub full_scale_uv: u32,
    /// Largest gain; the others are this halved once or more, down to 1.
    pub gain_largest: u8,
    /// Oversampling of its fastest and of its slowest rate; those between are doubled once or more. A sample takes twice
    /// as many cycles of its clock.
    pub oversampling: [u32; 2],
    /// What the upper byte of its ID register holds.
    pub id_high: u8,
    /// Last address of a register that a command can name.
    pub last_register: u8,
    /// Bytes of a frame on its bus.
    pub frame_bytes: u8,
    /// What its slow channels measure, if it has such.
    pub slow: Option<SlowCircuit>,
}

/// The circuit on channels 2 and 3 of a front-end that has them, as `docs/HARDWARE.md` draws it.
///
/// Both channels are set to gain 1. Both voltages scale with the excitation, and so does what the bridges give: what they
/// say together does not depend on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlowCircuit {
    /// Part of the excitation that channel 2 gets, by its divider.
    pub excitation_part: f32,
    /// Resistor from the excitation to channel 3, in Ω; the NTC goes from there to ground.
    pub series_ohm: f32,
    /// Resistance of the NTC at 25 °C, in Ω.
    pub ntc_ohm: f32,
    /// B value of the NTC between 25 and 85 °C, in K.
    pub ntc_b_k: f32,
}

/// 0 °C, in K.
const ZERO_CELSIUS_K: f64 = 273.15;
/// Temperature at which an NTC has its nominal resistance, in K.
const NTC_REFERENCE_K: f64 = 298.15;
/// Codes on either side of zero.
const HALF_RANGE_CODES: f64 = 8_388_608.0;

/// 15 kΩ and 10 kΩ make 1.0 V of 2.5 V, below the full scale of 1.2 V. With 39 kΩ a 10 kΩ NTC reads from 0 °C (1.16 V) on.
pub const SLOW_CIRCUIT: SlowCircuit =
    SlowCircuit { excitation_part: 0.4, series_ohm: 39_000.0, ntc_ohm: 10_000.0, ntc_b_k: 3950.0 };

/// Every front-end, in the order of their numbers on the wire.
pub const FRONT_ENDS: [FrontEndFacts; 2] = [
    FrontEndFacts {
        kind: FrontEndKind::Ads131m02,
        name: "ADS131M02",
        full_scale_uv: 1_200_000,
        gain_largest: 128,
        oversampling: [512, 8192],
        id_high: 0x22,
        last_register: 0x3F,
        frame_bytes: 12,
        slow: None,
    },
    FrontEndFacts {
        kind: FrontEndKind::Ads131m04,
        name: "ADS131M04",
        full_scale_uv: 1_200_000,
        gain_largest: 128,
        oversampling: [512, 8192],
        id_high: 0x24,
        last_register: 0x3F,
        frame_bytes: 18,
        slow: Some(SLOW_CIRCUIT),
    },
];

impl FrontEndKind {
    /// The one that its maker calls so; capitals do not matter.
    #[must_use]
    pub const fn named(name: &str) -> Option<Self> {
        let mut at = 0;
        while at < FRONT_ENDS.len() {
            if is_same(FRONT_ENDS[at].name.as_bytes(), name.as_bytes()) {
                return Some(FRONT_ENDS[at].kind);
            }
            at += 1;
        }
        None
    }

    /// What is known of it.
    ///
    /// ```
    /// use palpate_shared::front_ends::FrontEndKind;
    /// assert_eq!(FrontEndKind::Ads131m04.facts().name, "ADS131M04");
    /// ```
    #[must_use]
    pub const fn facts(self) -> &'static FrontEndFacts {
        let [two_channels, four_channels] = &FRONT_ENDS;
        match self {
            Self::Ads131m02 => two_channels,
            Self::Ads131m04 => four_channels,
        }
    }
}

/// Whether two texts are the same but for capitals; the standard library's own is `const` since Rust 1.89.
const fn is_same(one: &[u8], other: &[u8]) -> bool {
    let mut at = 0;
    while at < one.len() && at < other.len() {
        if !one[at].eq_ignore_ascii_case(&other[at]) {
            return false;
        }
        at += 1;
    }
    one.len() == other.len()
}

impl FrontEndFacts {
    /// The excitation, in V, that channel 2 read as this code; `None` without slow channels.
    ///
    /// ```
    /// use palpate_shared::{front_ends::FrontEndKind, units::Counts};
    /// // 1.0 V of 1.2 V.
    /// let volts = FrontEndKind::Ads131m04.facts().excitation_v(Counts(6_990_507)).expect("it has slow channels");
    /// assert!((volts - 2.5).abs() < 1e-6);
    /// ```
    #[must_use]
    pub fn excitation_v(&self, code: Counts) -> Option<f64> {
        let full_scale_v = f64::from(self.full_scale_uv) * 1e-6;
        self.slow.map(|slow| f64::from(code.0) / HALF_RANGE_CODES * full_scale_v / f64::from(slow.excitation_part))
    }

    /// Resistance of the NTC, in Ω, by the codes of both slow channels; `None` without them, where the excitation is gone
    /// (below a tenth of the range), and where the NTC is shorted or open. Free of the excitation and of the reference.
    #[must_use]
    pub fn ntc_ohm(&self, [excitation, ntc]: [Counts; 2]) -> Option<f64> {
        let slow = self.slow?;
        if f64::from(excitation.0) < HALF_RANGE_CODES / 10.0 || ntc.is_saturated() {
            return None;
        }
        let part = f64::from(ntc.0) * f64::from(slow.excitation_part) / f64::from(excitation.0);
        // Within a thousandth of either end it is no NTC: 10 Ω to 40 MΩ.
        (0.001..=0.999).contains(&part).then(|| f64::from(slow.series_ohm) * part / (1.0 - part))
    }
}

impl SlowCircuit {
    /// Part of the excitation that channel 3 gets while the NTC has this resistance, in Ω.
    #[must_use]
    pub fn ntc_part(&self, ohm: f64) -> f64 {
        ohm / (ohm + f64::from(self.series_ohm))
    }

    /// Logarithm of the NTC's resistance by that at 25 °C, at a temperature in °C: B (1/T − 1/T₂₅).
    #[must_use]
    pub fn ln_ratio_at(&self, celsius: f64) -> f64 {
        f64::from(self.ntc_b_k) * (1.0 / (celsius + ZERO_CELSIUS_K) - 1.0 / NTC_REFERENCE_K)
    }

    /// Temperature, in °C, at which the logarithm of the resistance by that at 25 °C is this: the B equation.
    #[must_use]
    pub fn celsius_at_ln_ratio(&self, ln_ratio: f64) -> f64 {
        1.0 / (ln_ratio / f64::from(self.ntc_b_k) + 1.0 / NTC_REFERENCE_K) - ZERO_CELSIUS_K
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_a_row_for_each_number_on_the_wire() {
        for facts in FRONT_ENDS {
            assert_eq!(facts.kind.facts(), &facts, "{}", facts.name);
            assert_eq!(FrontEndKind::named(&facts.name.to_lowercase()), Some(facts.kind));
        }
    }

    #[test]
    fn the_ntc_is_read_by_the_ratio_of_both_channels() {
        let facts = FrontEndKind::Ads131m04.facts();
        let slow = facts.slow.unwrap();
        // 10 kΩ under 39 kΩ: 10/49 of the excitation; by hand at 2.5 V: 0.510204 V of 1.2 V.
        let at = |volts: f64| {
            #[expect(clippy::cast_possible_truncation, reason = "within the range")]
            let code = |input_v: f64| Counts((input_v / 1.2 * 8_388_608.0).round() as i32);
            [code(f64::from(0.4_f32) * volts), code(10.0 / 49.0 * volts)]
        };
        for volts in [2.5, 2.4, 2.9] {
            let ohm = facts.ntc_ohm(at(volts)).unwrap();
            assert!((ohm - 10_000.0).abs() < 0.01, "{ohm} Ω at {volts} V");
        }
        assert!((slow.ntc_part(10_000.0) - 10.0 / 49.0).abs() < 1e-12);
        assert_eq!(facts.ntc_ohm([Counts(0), Counts(5)]), None, "no excitation");
        assert_eq!(facts.ntc_ohm([Counts(6_990_507), Counts(0)]), None, "shorted");
        assert_eq!(facts.ntc_ohm([Counts(6_990_507), Counts::MAX]), None, "open");
        assert_eq!(FrontEndKind::Ads131m02.facts().ntc_ohm(at(2.5)), None);
    }

    #[test]
    fn the_ntc_follows_the_b_equation() {
        let slow = SLOW_CIRCUIT;
        assert!(slow.ln_ratio_at(25.0).abs() < 1e-12);
        // By hand, B = 3950 K: at 0 °C ln(R/R25) = 3950 (1/273.15 − 1/298.15) = 1.212554.
        assert!((slow.ln_ratio_at(0.0) - 1.212_554).abs() < 2e-6, "{}", slow.ln_ratio_at(0.0));
        for celsius in [-10.0, 0.0, 23.0, 60.0] {
            assert!((slow.celsius_at_ln_ratio(slow.ln_ratio_at(celsius)) - celsius).abs() < 1e-9);
        }
    }
}
