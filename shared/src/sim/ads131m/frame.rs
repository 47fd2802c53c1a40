//! One frame on the bus: from chip select falling to chip select rising, byte by byte.
//!
//! Keeps what both directions of a frame need while it lasts: the word and byte in progress, both CRCs, the command
//! and how many of its data words came. What the words mean is the chip's business (`super`).
//!
//! Implements: SPI frames of the ADS131M family (SBAS853A §8.5.1). Words are 16, 24 or 32 bits, most significant bit
//! first, 16-bit contents left-aligned; word length and CRC settings hold from the start of a frame to its end.
//! Errors: none; a frame may end anywhere.

use super::registers::{CHANNELS_MAX, MODE, MODE_CRC_TYPE, MODE_RX_CRC_EN, MODE_WLENGTH, Registers};
use crate::units::Counts;

/// Start value of both CRCs.
const CRC_SEED: u16 = 0xFFFF;
/// x¹⁶ + x¹² + x⁵ + 1, the default.
const CRC_CCITT: u16 = 0x1021;
/// x¹⁶ + x¹⁵ + x² + 1, MODE bit 11 set.
const CRC_ANSI: u16 = 0x8005;

/// Top three bits of a command that reads registers.
const READ: u16 = 0b101;
/// Top three bits of a command that writes registers.
const WRITE: u16 = 0b011;

/// One more byte into a CRC, most significant bit first.
pub(super) fn crc16(polynomial: u16, crc: u16, byte: u8) -> u16 {
    (0..8).fold(
        crc ^ (u16::from(byte) << 8),
        |crc, _| {
            if crc & 0x8000 == 0 { crc << 1 } else { (crc << 1) ^ polynomial }
        },
    )
}

/// The CRC of a run of words, most significant byte first, as a frame would have it.
pub(super) fn crc16_of_words(polynomial: u16, words: &[u16]) -> u16 {
    words.iter().flat_map(|word| word.to_be_bytes()).fold(CRC_SEED, |crc, byte| crc16(polynomial, crc, byte))
}

/// The polynomial that MODE selects.
pub(super) fn polynomial(registers: &Registers) -> u16 {
    if registers.mode(MODE_CRC_TYPE) { CRC_ANSI } else { CRC_CCITT }
}

/// A command word, taken apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Command {
    Null,
    Reset,
    Standby,
    Wakeup,
    Lock,
    Unlock,
    Read { address: u8, count: u8 },
    Write { address: u8, count: u8 },
    Unknown,
}

impl Command {
    /// The command that a word stands for.
    pub(super) fn from_word(word: u16) -> Self {
        let address = (word >> 7).to_le_bytes()[0] & 0x3F;
        let count = (word.to_le_bytes()[0] & 0x7F) + 1;
        match word {
            0x0000 => Self::Null,
            0x0011 => Self::Reset,
            0x0022 => Self::Standby,
            0x0033 => Self::Wakeup,
            0x0555 => Self::Lock,
            0x0655 => Self::Unlock,
            _ if word >> 13 == READ => Self::Read { address, count },
            _ if word >> 13 == WRITE => Self::Write { address, count },
            _ => Self::Unknown,
        }
    }

    /// Words that follow the command before its CRC.
    fn data_words(self) -> u16 {
        if let Self::Write { count, .. } = self { count.into() } else { 0 }
    }

    /// Whether a locked interface still takes the command.
    pub(super) fn passes_lock(self) -> bool {
        matches!(self, Self::Null | Self::Unlock | Self::Read { .. })
    }
}

/// What the host sent, as far as it came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Received {
    /// A part of a word.
    Nothing,
    /// The frame's first word.
    Command(Command),
    /// A word to be written, counted from 0.
    Data { command: Command, index: u16, word: u16 },
    /// Padding, or the CRC.
    Other,
}

/// A frame in progress.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Frame {
    /// The codes this frame gives out.
    pub(super) codes: [Counts; CHANNELS_MAX],
    /// The command, once its word is in.
    pub(super) command: Option<Command>,
    /// Registers written so far.
    pub(super) written: u16,
    /// Whether the input CRC was right, once it is in. Stays `None` where none is expected.
    pub(super) crc_is_right: Option<bool>,
    /// Whether an input CRC is expected.
    pub(super) crc_expected: bool,
    polynomial: u16,
    /// Word length field of MODE.
    length: u16,
    /// Bytes in a word.
    word_bytes: u16,
    /// Bytes exchanged so far.
    bytes: u16,
    word_in: u32,
    word_out: u32,
    crc_in: u16,
    crc_out: u16,
    /// `crc_in` as it was before the word in progress.
    crc_before: u16,
}

impl Frame {
    /// A frame that begins under these settings and gives out these codes.
    pub(super) fn new(registers: &Registers, codes: [Counts; CHANNELS_MAX]) -> Self {
        let length = (registers.read(MODE) & MODE_WLENGTH) >> 8;
        Self {
            codes,
            command: None,
            written: 0,
            crc_is_right: None,
            crc_expected: registers.mode(MODE_RX_CRC_EN),
            polynomial: polynomial(registers),
            length,
            word_bytes: [2, 3, 4, 4][usize::from(length)],
            bytes: 0,
            word_in: 0,
            word_out: 0,
            crc_in: CRC_SEED,
            crc_out: CRC_SEED,
            crc_before: CRC_SEED,
        }
    }

    /// The word that goes out next, when a word begins here.
    pub(super) fn word_to_load(&self) -> Option<u16> {
        self.bytes.is_multiple_of(self.word_bytes).then_some(self.bytes / self.word_bytes)
    }

    /// Complete words exchanged so far.
    pub(super) fn words(&self) -> u16 {
        self.bytes / self.word_bytes
    }

    /// Whether the clock ran at all.
    pub(super) fn is_empty(&self) -> bool {
        self.bytes == 0
    }

    /// Loads a 16-bit content, left-aligned in the word.
    pub(super) fn load(&mut self, content: u16) {
        self.word_out = u32::from(content) << 16;
    }

    /// Loads a code in the form the word length asks for.
    pub(super) fn load_code(&mut self, code: Counts) {
        let bits = code.0.cast_unsigned();
        // 0b11 sign-extends to 32 bits; all others are left-aligned, 16 bits by leaving the low byte unsent.
        self.word_out = if self.length == 0b11 { bits } else { bits << 8 };
    }

    /// Loads the CRC of all that went out so far.
    pub(super) fn load_crc(&mut self) {
        self.load(self.crc_out);
    }

    /// Exchanges one byte; the second value is what the host has now completed.
    pub(super) fn exchange(&mut self, byte_in: u8) -> (u8, Received) {
        let at = usize::from(self.bytes % self.word_bytes);
        let byte_out = self.word_out.to_be_bytes()[at];
        self.crc_out = crc16(self.polynomial, self.crc_out, byte_out);
        self.accept(byte_in, at);
        // Longer than any command: what comes after can no longer matter.
        self.bytes = self.bytes.saturating_add(1);
        let complete = self.bytes.is_multiple_of(self.word_bytes);
        (byte_out, if complete { self.complete_word() } else { Received::Nothing })
    }

    /// Takes in one byte at its place in the word.
    fn accept(&mut self, byte: u8, at: usize) {
        if at == 0 {
            self.word_in = 0;
            self.crc_before = self.crc_in;
        }
        self.word_in |= u32::from(byte) << (24 - 8 * at);
        self.crc_in = crc16(self.polynomial, self.crc_in, byte);
    }

    /// Sorts the word that is now complete.
    fn complete_word(&mut self) -> Received {
        let word = u16::from_be_bytes([self.word_in.to_be_bytes()[0], self.word_in.to_be_bytes()[1]]);
        let place = self.words() - 1;
        let Some(command) = self.command else {
            let command = Command::from_word(word);
            self.command = Some(command);
            return Received::Command(command);
        };
        if place <= command.data_words() {
            return Received::Data { command, index: place - 1, word };
        }
        if self.crc_expected && place == command.data_words() + 1 {
            self.crc_is_right = Some(word == self.crc_before);
        }
        Received::Other
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The CRC of the usual check message.
    fn check(polynomial: u16) -> u16 {
        b"123456789".iter().fold(CRC_SEED, |crc, &byte| crc16(polynomial, crc, byte))
    }

    #[test]
    fn the_ccitt_crc_has_its_published_check_value() {
        assert_eq!(check(CRC_CCITT), 0x29B1); // CRC-16/CCITT-FALSE
    }

    #[test]
    fn the_ansi_crc_has_its_published_check_value() {
        assert_eq!(check(CRC_ANSI), 0xAEE7); // CRC-16/CMS: 0x8005, start FFFF, not reflected
    }

    #[test]
    fn commands_are_told_apart() {
        assert_eq!(Command::from_word(0xA000 | 0x03 << 7), Command::Read { address: 3, count: 1 });
        assert_eq!(Command::from_word(0x6000 | 0x3E << 7 | 4), Command::Write { address: 0x3E, count: 5 });
        assert_eq!(Command::from_word(0x0666), Command::Unknown);
    }
}
