//! Single frames on the converter's bus, as a person writes and reads them: for a board's first power-up.
//!
//! Written: 24 hexadecimal digits go out as they are; 4 are a command word and 8 a command word and its value, which get
//! the checksum that the firmware has the converter expect. Words of the ADS131M02: SBAS853A, section 8.5.1.
//! Errors: [`NotAFrame`].
//!
//! ```
//! use palpate_device::raw_frame::{self, Received};
//! assert_eq!(raw_frame::parse("a000")?, raw_frame::parse("a00000 710000 000000 000000")?);
//! # use palpate_shared::wire::FrontEndKind;
//! let received = Received::of(FrontEndKind::Ads131m02, [0x22, 0x82, 0, 0, 0, 1, 0xFF, 0xFF, 0xFE, 0x20, 0xDF, 0]);
//! assert_eq!((received.response, received.counts), (0x2282, [1, -2]));
//! # Ok::<(), palpate_device::raw_frame::NotAFrame>(())
//! ```

use palpate_firmware_core::ads131m::{frame_of, has_its_checksum};
use palpate_shared::wire::{FrontEndKind, RAW_FRAME_BYTES};

/// A text that names no frame.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` is no frame: give 24 hexadecimal digits, or 4 of a command word, or 8 of a command word and its value"
)]
pub struct NotAFrame {
    /// What was given.
    pub text: String,
}

/// The frame that a text names.
///
/// # Errors
/// [`NotAFrame`].
pub fn parse(text: &str) -> Result<[u8; RAW_FRAME_BYTES], NotAFrame> {
    let refused = || NotAFrame { text: text.to_owned() };
    let digits: Vec<u32> = text
        .chars()
        .filter(|c| !c.is_whitespace())
        .map(|c| c.to_digit(16).ok_or_else(refused))
        .collect::<Result<_, _>>()?;
    let number = |digits: &[u32]| digits.iter().fold(0, |number, digit| number << 4 | digit);
    let word = |digits: &[u32]| u16::try_from(number(digits)).map_err(|_| refused());
    match digits.len() {
        4 => Ok(frame_of(word(&digits)?, None)),
        8 => Ok(frame_of(word(&digits[..4])?, Some(word(&digits[4..])?))),
        24 => {
            let bytes = digits.chunks(2).map(|pair| u8::try_from(number(pair)));
            let bytes = bytes.collect::<Result<Vec<u8>, _>>().map_err(|_| refused())?;
            bytes.try_into().map_err(|_| refused())
        }
        _ => Err(refused()),
    }
}

/// A frame that came in, taken apart as words of 24 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// The first word: the response to the frame before.
    pub response: u16,
    /// The codes of both channels.
    pub counts: [i32; 2],
    /// Whether the checksum is that of response and codes; `None` where the front-end's frames are longer, and their
    /// checksum is not among what came.
    pub is_sound: Option<bool>,
}

impl Received {
    /// Takes a frame of this front-end apart.
    #[must_use]
    pub fn of(kind: FrontEndKind, bytes: [u8; RAW_FRAME_BYTES]) -> Self {
        let code = |at: usize| i32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], 0]) >> 8;
        Self {
            response: u16::from_be_bytes([bytes[0], bytes[1]]),
            counts: [code(3), code(6)],
            is_sound: (usize::from(kind.facts().frame_bytes) == RAW_FRAME_BYTES).then(|| has_its_checksum(&bytes)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_completed_with_the_checksums_of_the_datasheets_polynomial() {
        // CRCs by Python's binascii.crc_hqx(bytes, 0xFFFF).
        assert_eq!(parse("0000"), parse("000000cc9c00000000000000"));
        assert_eq!(parse("0655"), parse("0655 00 8f76 00 000000 000000"));
        assert_eq!(parse("6100 1110"), parse("610000111000638800000000"));
        for text in ["", "a", "a00", "a0000", "a000000000", "g000", "a000007100000000000000000", "0xa000"] {
            assert_eq!(parse(text), Err(NotAFrame { text: text.to_owned() }));
        }
    }

    #[test]
    fn a_damaged_frame_is_not_sound() {
        let bytes = [1, 3, 0, 0, 0, 1, 0xFF, 0xFF, 0xFF, 0x9F, 0xFC, 0];
        let received = |kind| Received::of(kind, bytes);
        let sound = Received { response: 0x0103, counts: [1, -1], is_sound: Some(true) };
        assert_eq!(received(FrontEndKind::Ads131m02), sound);
        assert_eq!(received(FrontEndKind::Ads131m04), Received { is_sound: None, ..sound });
        for at in 0..11 {
            let mut damaged = bytes;
            damaged[at] ^= 0x10;
            assert_eq!(Received::of(FrontEndKind::Ads131m02, damaged).is_sound, Some(false), "byte {at}");
        }
    }
}
