//! Frames: how a message's bytes survive a serial line.
//!
//! A frame is `COBS(payload ‖ CRC-32 of the payload, little-endian) ‖ 0x00`. COBS leaves no zero
//! inside, so a zero always ends a frame and a reader that lost its place finds it again at the next
//! one. The CRC is CRC-32/ISO-HDLC (the one of Ethernet and zip). What the payload holds is the
//! business of [`crate::wire`].
//!
//! Errors: a damaged frame is an error value for that frame alone; nothing here panics on any input.

use serde::Serialize;

/// Longest payload, in bytes, that either side may send.
///
/// A block of full-scale samples takes 79 bytes and the longest hello 73; the rest is room for
/// later minor versions, whose messages may be longer.
pub const PAYLOAD_MAX: usize = 192;

/// The CRC-32 of bytes, as frames have it.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

/// Bytes of the CRC behind the payload.
const CRC_BYTES: usize = 4;

/// Longest frame, in bytes, without its delimiter: payload, CRC, and COBS's one byte in 254.
pub const FRAME_MAX: usize = PAYLOAD_MAX + CRC_BYTES + 1;

/// The byte that ends every frame and occurs nowhere else.
pub const DELIMITER: u8 = 0;

/// One table lookup a byte: 1 KiB of flash.
#[cfg(not(feature = "large-crc-table"))]
type CrcTable = crc::Table<1>;
/// Sixteen bytes a step: 16 KiB, several times faster; for hosts.
#[cfg(feature = "large-crc-table")]
type CrcTable = crc::Table<16>;

static CRC: crc::Crc<u32, CrcTable> = crc::Crc::<u32, CrcTable>::new(&crc::CRC_32_ISO_HDLC);

/// Why a frame's bytes are not a payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// More than [`FRAME_MAX`] bytes without a delimiter; all up to the next delimiter is skipped.
    TooLong,
    /// The zero-free coding is broken: bytes were lost or damaged.
    Coding,
    /// The checksum does not fit: bytes were lost or damaged.
    Checksum,
}

/// A message did not fit into the given buffer, or into [`PAYLOAD_MAX`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLarge;

/// Writes `message` as one frame, delimiter included, to the front of `out`; returns the bytes written.
///
/// A buffer of [`FRAME_MAX`]` + 1` bytes holds any frame.
///
/// # Errors
/// [`TooLarge`] if the payload exceeds [`PAYLOAD_MAX`] or the frame exceeds `out`.
pub fn encode<'a, M: Serialize>(message: &M, out: &'a mut [u8]) -> Result<&'a [u8], TooLarge> {
    let mut body = [0; PAYLOAD_MAX + CRC_BYTES];
    let payload_length = postcard::to_slice(message, &mut body[..PAYLOAD_MAX]).map_err(|_| TooLarge)?.len();
    let body_length = payload_length + CRC_BYTES;
    let checksum = CRC.checksum(&body[..payload_length]).to_le_bytes();
    body[payload_length..body_length].copy_from_slice(&checksum);
    let coded_length = cobs::try_encode(&body[..body_length], out).map_err(|_| TooLarge)?;
    *out.get_mut(coded_length).ok_or(TooLarge)? = DELIMITER;
    Ok(&out[..=coded_length])
}

/// Turns one frame, without its delimiter, into its payload, in place.
///
/// # Errors
/// [`FrameError::TooLong`], [`FrameError::Coding`] or [`FrameError::Checksum`].
pub fn decode_in_place(frame: &mut [u8]) -> Result<&[u8], FrameError> {
    if frame.len() > FRAME_MAX {
        return Err(FrameError::TooLong);
    }
    let body_length = cobs::decode_in_place(frame).map_err(|_| FrameError::Coding)?;
    let (payload, checksum) = frame[..body_length].split_last_chunk::<CRC_BYTES>().ok_or(FrameError::Checksum)?;
    if CRC.checksum(payload) != u32::from_le_bytes(*checksum) {
        return Err(FrameError::Checksum);
    }
    Ok(payload)
}

/// Collects bytes, in pieces of any size, into frames.
#[derive(Clone, Debug)]
pub struct FrameReader {
    buffer: [u8; FRAME_MAX],
    length: usize,
    /// The frame under way is already too long; its bytes are dropped until its delimiter.
    overlong: bool,
}

impl Default for FrameReader {
    fn default() -> Self {
        Self::new()
    }
}

impl FrameReader {
    /// A reader at the beginning of a frame.
    #[must_use]
    pub const fn new() -> Self {
        Self { buffer: [0; FRAME_MAX], length: 0, overlong: false }
    }

    /// Forgets the frame under way, as after a reconnection.
    pub fn reset(&mut self) {
        self.length = 0;
        self.overlong = false;
    }

    /// Takes bytes up to and including the next delimiter.
    ///
    /// Returns how many bytes were taken and, if they ended a frame, its payload or why it has none.
    /// Call again with the rest. Empty frames (delimiters in a row) are not reported: senders use
    /// them to end whatever noise came before.
    ///
    /// ```
    /// use palpate_shared::frame::{encode, FrameReader, FRAME_MAX};
    /// let mut line = [0; FRAME_MAX + 1];
    /// let frame = encode(&2500_u16, &mut line).unwrap();
    /// let mut reader = FrameReader::new();
    /// assert_eq!(reader.push(&frame[..3]), (3, None));
    /// assert_eq!(reader.push(&frame[3..]), (frame.len() - 3, Some(Ok(&[0xC4, 0x13][..]))));
    /// ```
    pub fn push(&mut self, bytes: &[u8]) -> (usize, Option<Result<&[u8], FrameError>>) {
        let end = bytes.iter().position(|&byte| byte == DELIMITER);
        self.collect(&bytes[..end.unwrap_or(bytes.len())]);
        match end {
            Some(end) => (end + 1, self.finish()),
            None => (bytes.len(), None),
        }
    }

    /// Adds bytes that hold no delimiter.
    fn collect(&mut self, bytes: &[u8]) {
        match self.buffer.get_mut(self.length..self.length + bytes.len()) {
            Some(room) if !self.overlong => {
                room.copy_from_slice(bytes);
                self.length += bytes.len();
            }
            _ => self.overlong = true,
        }
    }

    /// Ends the frame under way.
    fn finish(&mut self) -> Option<Result<&[u8], FrameError>> {
        let (length, overlong) = (self.length, self.overlong);
        self.reset();
        match (overlong, length) {
            (true, _) => Some(Err(FrameError::TooLong)),
            (false, 0) => None,
            (false, _) => Some(decode_in_place(&mut self.buffer[..length])),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec;
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    /// A frame by another road than [`encode`]: straight from the definition in the module's header.
    fn frame_of(payload: &[u8]) -> Vec<u8> {
        let mut body = payload.to_vec();
        body.extend(CRC.checksum(payload).to_le_bytes());
        let mut frame = vec![];
        for run in body.split(|&byte| byte == 0) {
            for piece in run.chunks(254) {
                frame.push(u8::try_from(piece.len() + 1).unwrap());
                frame.extend(piece);
            }
            if run.is_empty() {
                frame.push(1);
            }
        }
        frame.push(DELIMITER);
        frame
    }

    /// Every outcome of `bytes` fed in pieces of `step`.
    fn read(bytes: &[u8], step: usize) -> Vec<Result<Vec<u8>, FrameError>> {
        let mut reader = FrameReader::new();
        let mut outcomes = Vec::new();
        for mut piece in bytes.chunks(step) {
            while !piece.is_empty() {
                let (taken, outcome) = reader.push(piece);
                outcomes.extend(outcome.map(|result| result.map(<[u8]>::to_vec)));
                piece = &piece[taken..];
            }
        }
        outcomes
    }

    #[test]
    fn the_checksum_is_the_one_of_ethernet() {
        assert_eq!(CRC.checksum(b"123456789"), 0xCBF4_3926);
    }

    #[test]
    fn delimiters_in_a_row_are_no_frames() {
        assert_eq!(read(&[0, 0, 0], 1), []);
    }

    #[test]
    fn a_message_that_outgrows_the_payload_is_refused() {
        let mut out = [0; 4 * FRAME_MAX];
        assert!(encode(&[1_u8; 32], &mut out).is_ok());
        let long = heapless::Vec::<u8, 512>::from_slice(&[1; PAYLOAD_MAX]).unwrap();
        assert_eq!(encode(&long, &mut out), Err(TooLarge));
        assert_eq!(encode(&[1_u8; 32], &mut [0; 37]), Err(TooLarge));
    }

    #[test]
    fn an_overlong_frame_is_one_error_and_the_next_frame_is_read() {
        let mut bytes = vec![7; 10 * FRAME_MAX];
        bytes.push(DELIMITER);
        bytes.extend(frame_of(b"next"));
        assert_eq!(read(&bytes, 33), [Err(FrameError::TooLong), Ok(b"next".to_vec())]);
    }

    proptest! {
        #[test]
        fn what_is_encoded_is_read_back_whatever_the_pieces(
            payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..PAYLOAD_MAX), 1..8),
            step in 1_usize..300,
        ) {
            let bytes: Vec<u8> = payloads.iter().flat_map(|payload| frame_of(payload)).collect();
            let wanted: Vec<_> = payloads.into_iter().map(Ok).collect();
            prop_assert_eq!(read(&bytes, step), wanted);
        }

        #[test]
        fn encoding_follows_the_definition(message in any::<(u32, i32, u64, [u8; 24])>()) {
            let mut out = [0; FRAME_MAX + 1];
            let frame = encode(&message, &mut out).unwrap();
            let mut payload = [0; PAYLOAD_MAX];
            let payload = postcard::to_slice(&message, &mut payload).unwrap();
            prop_assert_eq!(frame, &frame_of(payload)[..]);
        }

        #[test]
        fn one_damaged_bit_costs_one_frame_at_most_two(
            payload in prop::collection::vec(any::<u8>(), 1..PAYLOAD_MAX), at in any::<prop::sample::Index>(), bit in 0_u32..8,
        ) {
            let (first, last) = (frame_of(&payload), frame_of(b"last"));
            let mut bytes = [first.clone(), last].concat();
            bytes[at.index(first.len())] ^= 1_u8 << bit;
            let outcomes = read(&bytes, 64);
            let good: Vec<_> = outcomes.iter().flatten().collect();
            // A damaged delimiter joins both frames; any other damage spares the last.
            prop_assert!(good.iter().all(|payload| payload.as_slice() == b"last"), "{outcomes:?}");
            let joined = at.index(first.len()) == first.len() - 1;
            prop_assert_eq!(good.is_empty(), joined);
            prop_assert!(outcomes.iter().any(Result::is_err));
        }

        #[test]
        fn noise_is_never_a_payload(bytes in prop::collection::vec(any::<u8>(), 0..2000), step in 1_usize..100) {
            // By chance one frame in 2³² would pass.
            prop_assert!(read(&bytes, step).iter().all(Result::is_err));
        }
    }
}
