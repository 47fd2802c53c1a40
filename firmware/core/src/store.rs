//! Where the matrix of forces outlives a restart: two sectors of a flash, written like a log.
//!
//! A record has eight words: its number, six numbers of the matrix, and a CRC-32 of the seven before it, which is written last. The
//! newest sound record counts. A new one goes behind it, or, where its sector is full, into the other one, which is erased
//! first. So whatever moment the supply fails at, what counted before counts still, or the new one does; and a sector
//! is erased once in as many changes as it has room for, which matters since a chip that erases stands still meanwhile.
//!
//! [`MemoryFlash`] is a flash in memory, for simulated devices and for tests that cut its supply. Errors: [`NotStored`].

use palpate_shared::frame;
use palpate_shared::wire::ForceMatrix;

/// What a word reads that was erased.
pub const ERASED: u32 = u32::MAX;

/// Words in a record.
const RECORD_WORDS: usize = 8;

/// In a record's first word: there is no matrix any more. The number is in the bits above it.
const NONE: u32 = 1;

/// One of the two sectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sector {
    /// The first.
    A,
    /// The second.
    B,
}

impl Sector {
    /// Both.
    pub const BOTH: [Self; 2] = [Self::A, Self::B];

    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

/// Two sectors of flash: words that are erased together, and of which each can then be written once.
pub trait Flash {
    /// Words in a sector.
    const WORDS: usize;

    /// What a word holds; `at` is below [`Self::WORDS`].
    fn word(&self, sector: Sector, at: usize) -> u32;

    /// Erases a sector. Whether that went well is seen by reading it.
    fn erase(&mut self, sector: Sector);

    /// Writes a word. Likewise.
    fn write(&mut self, sector: Sector, at: usize, word: u32);
}

/// The flash did not take it: what it keeps is as before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotStored;

/// A record that counts, and where it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Found {
    sector: Sector,
    number: u32,
    matrix: Option<ForceMatrix>,
}

/// The store.
#[derive(Clone, Debug)]
pub struct MatrixStore<F> {
    flash: F,
}

impl<F: Flash> MatrixStore<F> {
    /// On this flash, whatever it holds.
    pub const fn new(flash: F) -> Self {
        Self { flash }
    }

    /// The flash.
    pub const fn flash_mut(&mut self) -> &mut F {
        &mut self.flash
    }

    /// The matrix that is kept, if one is.
    #[must_use]
    pub fn kept(&self) -> Option<ForceMatrix> {
        self.newest()?.matrix
    }

    /// Keeps this matrix, or none. Writes nothing where it is kept already.
    ///
    /// # Errors
    /// [`NotStored`].
    pub fn keep(&mut self, matrix: Option<ForceMatrix>) -> Result<(), NotStored> {
        let newest = self.newest();
        if newest.and_then(|newest| newest.matrix) == matrix {
            return Ok(());
        }
        let number = newest.map_or(0, |newest| newest.number.wrapping_add(1));
        let home = newest.map_or(Sector::A, |newest| newest.sector);
        let (sector, at) = match self.free_place(home) {
            Some(at) => (home, at),
            None => (self.emptied(home.other())?, 0),
        };
        let record = record_of(number, matrix);
        for (place, word) in (at..).zip(record) {
            self.flash.write(sector, place, word);
        }
        if self.record(sector, at) == record { Ok(()) } else { Err(NotStored) }
    }

    /// The newest sound record of both sectors.
    fn newest(&self) -> Option<Found> {
        let places = Sector::BOTH.into_iter().flat_map(|sector| Self::places().map(move |at| (sector, at)));
        places.filter_map(|(sector, at)| found(sector, self.record(sector, at))).max_by_key(|found| found.number)
    }

    /// Where records begin.
    fn places() -> impl DoubleEndedIterator<Item = usize> {
        (0..F::WORDS / RECORD_WORDS).map(|index| index * RECORD_WORDS)
    }

    fn record(&self, sector: Sector, at: usize) -> [u32; RECORD_WORDS] {
        core::array::from_fn(|index| self.flash.word(sector, at + index))
    }

    /// The place behind the last one that is not erased. A record of which the supply cut off the end takes one, too.
    fn free_place(&self, sector: Sector) -> Option<usize> {
        let is_free = |at: &usize| self.record(sector, *at) == [ERASED; RECORD_WORDS];
        Self::places().rev().take_while(is_free).last()
    }

    /// Erases a sector if it holds anything.
    fn emptied(&mut self, sector: Sector) -> Result<Sector, NotStored> {
        let is_erased = |flash: &F| (0..F::WORDS).all(|at| flash.word(sector, at) == ERASED);
        if !is_erased(&self.flash) {
            self.flash.erase(sector);
        }
        if is_erased(&self.flash) { Ok(sector) } else { Err(NotStored) }
    }
}

/// What a record says, if it is one.
fn found(sector: Sector, record: [u32; RECORD_WORDS]) -> Option<Found> {
    let [head, xx, xy, yx, yy, x, y, checksum] = record;
    if head == ERASED || checksum_of(&record) != checksum {
        return None;
    }
    let [xx, xy, yx, yy, x, y] = [xx, xy, yx, yy, x, y].map(u32::cast_signed);
    let matrix = ForceMatrix { entries: [[xx, xy], [yx, yy]], tare: [x, y] };
    let matrix = (head & NONE == 0 && matrix.is_sound()).then_some(matrix);
    Some(Found { sector, number: head >> 1, matrix })
}

/// The record of this number.
fn record_of(number: u32, matrix: Option<ForceMatrix>) -> [u32; RECORD_WORDS] {
    let none = if matrix.is_none() { NONE } else { 0 };
    let ForceMatrix { entries: [[xx, xy], [yx, yy]], tare: [x, y] } =
        matrix.unwrap_or(ForceMatrix { entries: [[0; 2]; 2], tare: [0; 2] });
    let [xx, xy, yx, yy, x, y] = [xx, xy, yx, yy, x, y].map(i32::cast_unsigned);
    // 2³¹ changes: each takes a place in flash, which is worn out long before.
    let mut record = [number << 1 | none, xx, xy, yx, yy, x, y, 0];
    record[RECORD_WORDS - 1] = checksum_of(&record);
    record
}

/// CRC-32 of all words but the last, little-endian.
fn checksum_of(record: &[u32; RECORD_WORDS]) -> u32 {
    let mut bytes = [0; 4 * (RECORD_WORDS - 1)];
    for (place, word) in bytes.chunks_exact_mut(4).zip(record) {
        place.copy_from_slice(&word.to_le_bytes());
    }
    frame::checksum(&bytes)
}

/// A flash in memory, with sectors of so many words, whose supply can be cut.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemoryFlash<const WORDS: usize> {
    sectors: [[u32; WORDS]; 2],
    /// Words that may still be erased or written before the supply fails; within the last one, bits are left as they were.
    until_cut: Option<u32>,
    /// How often each sector was erased.
    erased: [u32; 2],
}

impl<const WORDS: usize> Default for MemoryFlash<WORDS> {
    fn default() -> Self {
        Self { sectors: [[ERASED; WORDS]; 2], until_cut: None, erased: [0; 2] }
    }
}

impl<const WORDS: usize> MemoryFlash<WORDS> {
    /// A flash that holds this.
    #[must_use]
    pub fn of(sectors: [[u32; WORDS]; 2]) -> Self {
        Self { sectors, ..Self::default() }
    }

    /// Cuts the supply within the word after so many; `None` gives it back.
    pub fn cut_after(&mut self, words: Option<u32>) {
        self.until_cut = words;
    }

    /// How often each sector was erased.
    #[must_use]
    pub fn erased(&self) -> [u32; 2] {
        self.erased
    }

    /// What a word becomes that shall become `wanted`: half of it where the supply fails, nothing after that.
    fn become_of(&mut self, before: u32, wanted: u32) -> u32 {
        const FIRST_HALF: u32 = 0xFFFF;
        match &mut self.until_cut {
            None => wanted,
            Some(0) => before,
            Some(left) => {
                *left -= 1;
                if *left == 0 { before & !FIRST_HALF | wanted & FIRST_HALF } else { wanted }
            }
        }
    }
}

impl<const WORDS: usize> Flash for MemoryFlash<WORDS> {
    const WORDS: usize = WORDS;

    fn word(&self, sector: Sector, at: usize) -> u32 {
        self.sectors[sector as usize][at]
    }

    fn erase(&mut self, sector: Sector) {
        self.erased[sector as usize] += 1;
        for at in 0..WORDS {
            let before = self.word(sector, at);
            self.sectors[sector as usize][at] = self.become_of(before, ERASED);
        }
    }

    fn write(&mut self, sector: Sector, at: usize, word: u32) {
        let before = self.word(sector, at);
        // Bits go from 1 to 0 only.
        self.sectors[sector as usize][at] = self.become_of(before, before & word);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Four records in a sector, so that they are full soon.
    type Small = MemoryFlash<32>;

    fn matrix(number: i32) -> Option<ForceMatrix> {
        (number % 5 != 4).then_some(ForceMatrix { entries: [[number, -1], [2, 1 << 29]], tare: [-5, number] })
    }

    #[test]
    fn the_last_one_is_kept_over_any_number_of_changes_and_restarts() {
        let mut store = MatrixStore::new(Small::default());
        assert_eq!(store.kept(), None);
        for number in 0..40 {
            store.keep(matrix(number)).unwrap();
            assert_eq!(store.kept(), matrix(number), "{number}");
            // As after a restart.
            store = MatrixStore::new(store.flash_mut().clone());
            assert_eq!(store.kept(), matrix(number), "{number}");
        }
        // Forty records, four to a sector, the first two of them into sectors that were never written.
        assert_eq!(store.flash_mut().erased(), [4, 4]);
    }

    #[test]
    fn what_is_kept_already_is_not_written_again() {
        let mut store = MatrixStore::new(Small::default());
        store.keep(None).unwrap();
        assert_eq!(*store.flash_mut(), Small::default());
        store.keep(matrix(1)).unwrap();
        let once = store.flash_mut().clone();
        store.keep(matrix(1)).unwrap();
        assert_eq!(*store.flash_mut(), once);
    }

    #[test]
    fn a_supply_that_fails_at_any_word_leaves_the_old_one_or_the_new_one() {
        // After each number of records, so that every place and both erasures are met.
        for before in 0..12 {
            let mut whole = MatrixStore::new(Small::default());
            (0..before).for_each(|number| whole.keep(matrix(number)).unwrap());
            let (old, new) = (whole.kept(), matrix(100));
            let mut survived = [false; 2];
            for cut in 0..60 {
                let mut store = whole.clone();
                store.flash_mut().cut_after(Some(cut));
                let done = store.keep(new).is_ok();
                store.flash_mut().cut_after(None);
                let kept = store.kept();
                assert!(kept == old || kept == new, "{kept:?} after {before} records, cut at word {cut}");
                assert!(!done || kept == new, "said to be kept after {before} records, cut at word {cut}");
                survived[usize::from(kept == new)] = true;
                // It works again afterwards.
                store.keep(matrix(7)).unwrap();
                assert_eq!(store.kept(), matrix(7), "after {before} records, cut at word {cut}");
            }
            assert_eq!(survived, [true; 2], "the cuts meet both sides of the change");
        }
    }

    #[test]
    fn a_flash_that_takes_nothing_is_told() {
        // As an emulator has it, whose flash reads 0 and cannot be written; and one that is worn out.
        let mut zeros = MatrixStore::new(Small::of([[0; 32]; 2]));
        zeros.flash_mut().cut_after(Some(0));
        assert_eq!((zeros.kept(), zeros.keep(matrix(1)), zeros.kept()), (None, Err(NotStored), None));
        let mut worn = MatrixStore::new(Small::default());
        worn.flash_mut().cut_after(Some(0));
        assert_eq!((worn.keep(matrix(1)), worn.kept()), (Err(NotStored), None));
    }

    proptest! {
        #[test]
        fn whatever_another_firmware_left_is_no_matrix_and_no_obstacle(
            left in prop::collection::vec(any::<u32>(), 64), blank in any::<[bool; 2]>(),
        ) {
            let mut sectors = [[ERASED; 32]; 2];
            for ((sector, words), blank) in sectors.iter_mut().zip(left.chunks(32)).zip(blank) {
                if !blank {
                    sector.copy_from_slice(words);
                }
            }
            let mut store = MatrixStore::new(Small::of(sectors));
            prop_assert_eq!(store.kept(), None);
            for number in 0..10 {
                store.keep(matrix(number)).unwrap();
                prop_assert_eq!(store.kept(), matrix(number));
            }
        }

        #[test]
        fn no_bit_of_a_record_may_change(bit in 0..256_usize) {
            let mut store = MatrixStore::new(Small::default());
            store.keep(matrix(1)).unwrap();
            let mut sectors = store.flash_mut().sectors;
            sectors[0][bit / 32] ^= 1 << (bit % 32);
            prop_assert_eq!(MatrixStore::new(Small::of(sectors)).kept(), None);
        }
    }
}
