//! Which crystal a board has, from how fast it swings beside the chip's internal oscillator.
//!
//! Boards with this chip have crystals of 8 or of 12 MHz. The PLL multiplies whatever it is given: with the divider for
//! the other crystal the core would run at 252 MHz, or USB at 32 MHz. So the crystal is measured first; one that is
//! neither is refused, and the board runs on the internal oscillator and says so.
//!
//! Pure, and tested on a PC; `image/clock.rs` counts.

/// The crystals that the PLL has dividers for, in MHz: what boards with this chip have.
const USABLE_MHZ: [u8; 2] = [8, 12];

/// How much slower and how much faster than it is a crystal may look, in per cent: the internal oscillator is up to 4.5 %
/// fast or 8 % slow over its temperatures (STM32F405 datasheet, DocID022152, "High-speed internal (HSI) RC oscillator").
/// The next crystals that are made, of 10 MHz, stay outside.
const TOLERANCE_PERCENT: (u32, u32) = (5, 9);

/// The internal oscillator, in kHz.
const INTERNAL_KHZ: u32 = 16_000;

/// Periods of the crystal that are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Periods(pub(crate) u32);

/// What there is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Crystal {
    /// It does not swing.
    Absent,
    /// It swings at so many MHz, for which there is a divider.
    Usable {
        /// In MHz.
        mhz: u8,
    },
    /// It swings at another frequency, or could not be measured.
    Odd {
        /// In kHz; 0 if it could not be measured.
        khz: u32,
    },
}

impl Crystal {
    /// What was counted while it swung, if it does: its periods, and the internal oscillator's ticks meanwhile.
    pub(crate) fn of(counted: Option<(Periods, u32)>) -> Self {
        let Some((Periods(periods), ticks)) = counted else { return Self::Absent };
        let khz = (INTERNAL_KHZ * periods).checked_div(ticks).unwrap_or(0);
        let is_near = |mhz: &u8| {
            let nominal_khz = u32::from(*mhz) * 1000;
            let (slower, faster) = TOLERANCE_PERCENT;
            (nominal_khz - nominal_khz * slower / 100..=nominal_khz + nominal_khz * faster / 100).contains(&khz)
        };
        USABLE_MHZ.into_iter().find(is_near).map_or(Self::Odd { khz }, |mhz| Self::Usable { mhz })
    }
}

/// What the board makes the converter's clock of, where it makes one: 8 MHz in either case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ConverterClockSource {
    /// The crystal, as it swings.
    Crystal,
    /// Half of the internal oscillator, up to a few per cent off.
    Internal,
}

/// What the converter's clock is, where the board makes it, in Hz.
pub(crate) const CONVERTER_CLOCK_HZ: u32 = 8_000_000;

impl ConverterClockSource {
    /// On a board with this crystal. One of 12 MHz has no whole part within what the converter takes.
    pub(crate) fn on(crystal: Crystal) -> Self {
        match crystal {
            Crystal::Usable { mhz: 8 } => Self::Crystal,
            Crystal::Usable { .. } | Crystal::Absent | Crystal::Odd { .. } => Self::Internal,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks of an internal oscillator of so many kHz in 992 periods of a crystal.
    fn ticks(crystal_khz: u32, internal_khz: u32) -> u32 {
        992 * internal_khz / crystal_khz
    }

    #[test]
    fn both_usual_crystals_are_known_however_warm_the_internal_oscillator_is() {
        for mhz in USABLE_MHZ {
            // −8 % to +4.5 %, and a count that is off by one.
            for internal_khz in [14_720, 15_840, 16_000, 16_160, 16_720] {
                for off in [0, 1, 2] {
                    let ticks = ticks(u32::from(mhz) * 1000, internal_khz) + off - 1;
                    assert_eq!(Crystal::of(Some((Periods(992), ticks))), Crystal::Usable { mhz }, "{internal_khz} kHz");
                }
            }
        }
    }

    #[test]
    fn the_converters_clock_is_that_of_the_crystal_where_it_fits() {
        assert_eq!(u32::from(USABLE_MHZ[0]) * 1_000_000, CONVERTER_CLOCK_HZ);
        assert_eq!(INTERNAL_KHZ * 1000 / 2, CONVERTER_CLOCK_HZ);
        assert_eq!(ConverterClockSource::on(Crystal::Usable { mhz: 8 }), ConverterClockSource::Crystal);
        for crystal in [Crystal::Usable { mhz: 12 }, Crystal::Absent, Crystal::Odd { khz: 10_000 }] {
            assert_eq!(ConverterClockSource::on(crystal), ConverterClockSource::Internal);
        }
    }

    #[test]
    fn other_crystals_are_refused_with_what_was_measured() {
        for khz in [4000, 6000, 10_000, 16_000, 20_000, 24_000, 25_000, 26_000] {
            for internal_khz in [14_720, 16_000, 16_720] {
                let Crystal::Odd { khz: found } = Crystal::of(Some((Periods(992), ticks(khz, internal_khz)))) else {
                    panic!("{khz} kHz beside {internal_khz} kHz passes")
                };
                assert!(found.abs_diff(khz) <= khz / 10, "{found} for {khz} kHz");
            }
        }
        assert_eq!(Crystal::of(Some((Periods(992), 0))), Crystal::Odd { khz: 0 });
        assert_eq!(Crystal::of(None), Crystal::Absent);
    }
}
