//! Counts to force in integers: the one function by which a device computes forces and a host checks them, bit for bit.
//!
//! `F = A · (counts − tare)`, with `A` the inverse of the calibration's matrix. The entries of `A` are in 2⁻¹⁹ µN a count
//! and the tare in sixteenths of a count, both rounded; a force is in µN, rounded. What rounding does to a force is at most
//! ([`ForceMatrix::rounding_un`]) 17 µN by the entries over the whole range, 1/32 count by the tare, and half a µN at the
//! end: below 0.1 mN up to [`ENTRY_MAX_UN`].
//!
//! Frame: the finger's. Units: µN, counts. Errors: `None` where a matrix or a tare does not fit.

use serde::{Deserialize, Serialize};

use crate::units::Counts;

/// Most samples that one force is the mean of.
pub const MEAN_SAMPLES_MAX: u8 = 8;

/// Parts of a µN a count in which entries are: 2¹⁹.
const ENTRY_UNIT: i64 = 1 << 19;

/// Parts of a count in which a tare is.
const TARE_UNIT: i64 = 16;

/// Largest entry, in µN a count. A finger at gain 1 has 1200.
pub const ENTRY_MAX_UN: f64 = 2048.0;

/// Largest entry as it is stored; two products of it with the largest difference still fit 64 bits.
const ENTRY_MAX: i32 = 1 << 30;

/// How counts become force.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ForceMatrix {
    /// Force on x and y by a count of each bridge, row by row, in 2⁻¹⁹ µN.
    pub entries: [[i32; 2]; 2],
    /// What both bridges read at rest, in sixteenths of a count.
    pub tare: [i32; 2],
}

impl ForceMatrix {
    /// From forces in N a count, row by row, and a tare in counts; `None` where they are not finite or too large.
    ///
    /// ```
    /// use palpate_shared::{force::ForceMatrix, units::Counts};
    /// // 37.45 µN a count on x, −37.45 on y.
    /// let matrix = ForceMatrix::new([[37.45e-6, 0.0], [0.0, -37.45e-6]], [100.0, 0.0]).expect("it fits");
    /// assert_eq!(matrix.force_un([[Counts(1100), Counts(1000)]]), Some([37_450, -37_450]));
    /// ```
    #[must_use]
    pub fn new(newtons_per_count: [[f64; 2]; 2], tare: [f64; 2]) -> Option<Self> {
        let entry = |newtons: f64| rounded(newtons * 1e6 * ENTRY_UNIT as f64, ENTRY_MAX);
        let [[xx, xy], [yx, yy]] = newtons_per_count;
        let tare_max = Counts::MAX.0 * 16;
        let at_rest = |counts: f64| rounded(counts * TARE_UNIT as f64, tare_max);
        Some(Self {
            entries: [[entry(xx)?, entry(xy)?], [entry(yx)?, entry(yy)?]],
            tare: [at_rest(tare[0])?, at_rest(tare[1])?],
        })
    }

    /// Force by a count of each bridge, row by row, in µN.
    #[must_use]
    pub fn un_per_count(&self) -> [[f64; 2]; 2] {
        self.entries.map(|row| row.map(|entry| f64::from(entry) / ENTRY_UNIT as f64))
    }

    /// The same with another tare, in counts.
    #[must_use]
    pub fn tared(self, tare: [f64; 2]) -> Option<Self> {
        Some(Self { tare: Self::new([[0.0; 2]; 2], tare)?.tare, ..self })
    }

    /// Whether no entry and no tare is larger than the arithmetic bears.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let entries = self.entries.as_flattened().iter().all(|entry| entry.unsigned_abs() <= ENTRY_MAX.unsigned_abs());
        entries && self.tare.iter().all(|tare| tare.unsigned_abs() <= 16 * Counts::MIN.0.unsigned_abs())
    }

    /// The mean force over these samples, in µN; `None` for none, or for more than [`MEAN_SAMPLES_MAX`], or with a matrix
    /// that is not sound.
    #[must_use]
    pub fn force_un(&self, samples: impl IntoIterator<Item = [Counts; 2]>) -> Option<[i32; 2]> {
        let (mut sums, mut count) = ([0_i64; 2], 0_i64);
        for pair in samples {
            count += 1;
            for (sum, code) in sums.iter_mut().zip(pair) {
                *sum += i64::from(code.0);
            }
        }
        if count == 0 || count > i64::from(MEAN_SAMPLES_MAX) || !self.is_sound() {
            return None;
        }
        // At most 2³¹: eight codes of 2²³ in sixteenths, and as much of the tare.
        let above = |axis: usize| TARE_UNIT * sums[axis] - count * i64::from(self.tare[axis]);
        let (x, y) = (above(0), above(1));
        // At most 2⁶² and half of 2²⁶.
        let divisor = ENTRY_UNIT * TARE_UNIT * count;
        Some(self.entries.map(|[of_x, of_y]| {
            let product = i64::from(of_x) * x + i64::from(of_y) * y;
            let force = product.saturating_add(divisor / 2).div_euclid(divisor);
            // A code of 2²⁴ at 2048 µN is more than fits: 34 kN, which no finger survives.
            i32::try_from(force).unwrap_or(if force < 0 { i32::MIN } else { i32::MAX })
        }))
    }

    /// The most by which [`Self::force_un`] differs from the same in real numbers, in µN, for counts this far from the tare.
    #[must_use]
    pub fn rounding_un(&self, counts: f64) -> f64 {
        let largest = |row: [i32; 2]| row.iter().map(|entry| f64::from(*entry).abs()).sum::<f64>() / ENTRY_UNIT as f64;
        let [x, y] = self.entries.map(largest);
        // Half a unit of each entry, of the tare, of the result.
        counts / ENTRY_UNIT as f64 + x.max(y) * 0.5 / TARE_UNIT as f64 + 0.5
    }

    /// Its checksum: CRC-32 of entries and tare, as 32-bit little-endian numbers.
    #[cfg(feature = "wire")]
    #[must_use]
    pub fn checksum(&self) -> u32 {
        let mut bytes = [0; 24];
        let numbers = self.entries.as_flattened().iter().chain(&self.tare);
        for (place, number) in bytes.chunks_exact_mut(4).zip(numbers) {
            place.copy_from_slice(&number.to_le_bytes());
        }
        crate::frame::checksum(&bytes)
    }
}

/// The nearest whole number, if it is no further from 0 than that.
fn rounded(value: f64, largest: i32) -> Option<i32> {
    // `f64::round` is not in `core`.
    let nearest = if value < 0.0 { value - 0.5 } else { value + 0.5 };
    #[expect(clippy::cast_possible_truncation, reason = "within 31 bits, and cut to whole numbers")]
    (nearest.abs() < f64::from(largest) + 1.0).then_some(nearest as i32)
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    /// The bar: a tenth of a millinewton.
    const BAR_UN: f64 = 100.0;

    fn codes() -> impl Strategy<Value = [i32; 2]> {
        [Counts::MIN.0..=Counts::MAX.0, Counts::MIN.0..=Counts::MAX.0]
    }

    proptest! {
        #[test]
        fn forces_are_those_of_real_numbers_within_a_tenth_of_a_millinewton(
            // The default finger at gain 1 has 1200 µN a count, at gain 32 37 µN.
            entries in prop::array::uniform2([-1200e-6..1200e-6, -1200e-6..1200e-6]),
            tare in [-1e5..1e5, -1e5..1e5], samples in prop::collection::vec(codes(), 1..=usize::from(MEAN_SAMPLES_MAX)),
        ) {
            let matrix = ForceMatrix::new(entries, tare).unwrap();
            let found = matrix.force_un(samples.iter().map(|&[x, y]| [Counts(x), Counts(y)])).unwrap();
            let mean = |axis: usize| {
                samples.iter().map(|pair| f64::from(pair[axis])).sum::<f64>() / samples.len() as f64 - tare[axis]
            };
            for (row, found) in entries.iter().zip(found) {
                let exact = 1e6 * (row[0] * mean(0) + row[1] * mean(1));
                // What does not fit 32 bits is at their end.
                if exact.abs() < f64::from(i32::MAX) {
                    let error = (f64::from(found) - exact).abs();
                    prop_assert!(error <= BAR_UN, "{found} µN for {exact}");
                    let stated = matrix.rounding_un(mean(0).abs().max(mean(1).abs()));
                    prop_assert!(error <= stated + 1e-6 * exact.abs().max(1.0) * 1e-6, "{error} of {stated}");
                }
            }
        }

        #[test]
        fn no_sound_matrix_overflows(
            entries in prop::array::uniform2([-ENTRY_MAX..=ENTRY_MAX, -ENTRY_MAX..=ENTRY_MAX]),
            tare in [-16 * 0x80_0000..=16 * 0x80_0000, -16 * 0x80_0000..=16 * 0x80_0000],
            samples in prop::collection::vec(codes(), 1..=usize::from(MEAN_SAMPLES_MAX)),
        ) {
            let matrix = ForceMatrix { entries, tare };
            prop_assert!(matrix.is_sound());
            // In 128 bits nothing overflows.
            let count = samples.len() as i128;
            let sum = |axis: usize| samples.iter().map(|pair| i128::from(pair[axis])).sum::<i128>();
            let above = |axis: usize| 16 * sum(axis) - count * i128::from(tare[axis]);
            let divisor = (1 << 23) * count;
            let found = matrix.force_un(samples.iter().map(|&[x, y]| [Counts(x), Counts(y)])).unwrap();
            for (row, found) in entries.iter().zip(found) {
                let product = i128::from(row[0]) * above(0) + i128::from(row[1]) * above(1);
                let exact = (product + divisor / 2).div_euclid(divisor);
                prop_assert_eq!(i128::from(found), exact.clamp(i32::MIN.into(), i32::MAX.into()));
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        assert_eq!(ForceMatrix::new([[2049e-6, 0.0], [0.0, 1e-6]], [0.0; 2]), None);
        assert_eq!(ForceMatrix::new([[f64::NAN, 0.0], [0.0, 1e-6]], [0.0; 2]), None);
        assert_eq!(ForceMatrix::new([[1e-6, 0.0], [0.0, 1e-6]], [1e8, 0.0]), None);
        let matrix = ForceMatrix::new([[1e-6, 0.0], [0.0, 1e-6]], [0.0; 2]).unwrap();
        assert_eq!(matrix.force_un([]), None);
        assert_eq!(matrix.force_un([[Counts(0); 2]; 9]), None);
        let unsound = ForceMatrix { entries: [[i32::MIN, 0], [0, 0]], ..matrix };
        assert_eq!(unsound.force_un([[Counts(1); 2]]), None);
    }

    #[cfg(feature = "wire")]
    #[test]
    fn the_checksum_notices_every_bit() {
        let matrix = ForceMatrix { entries: [[1, -2], [3, 4]], tare: [-5, 6] };
        // Python: zlib.crc32(struct.pack("<6i", 1, -2, 3, 4, -5, 6)).
        assert_eq!(matrix.checksum(), 0xA69B_0E0E);
        let changed: Vec<_> =
            (0..32).map(|bit| ForceMatrix { tare: [-5 ^ (1 << bit), 6], ..matrix }.checksum()).collect();
        assert!(!changed.contains(&matrix.checksum()));
    }
}
