//! Slow, obvious code that shares nothing with what it checks.

/// Longest frame without its delimiter that a reader takes, from `docs/PROTOCOL.md`.
const FRAME_MAX: usize = 197;

/// The frames in a stream: what stands between zeros, and is not empty. What comes after the last zero is none yet.
pub fn frames(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let end = bytes.iter().rposition(|&byte| byte == 0).unwrap_or(0);
    bytes[..end].split(|&byte| byte == 0).filter(|frame| !frame.is_empty())
}

/// The payloads of the good frames in a stream, decoded byte by byte as `docs/PROTOCOL.md` says.
#[must_use]
pub fn good_payloads(bytes: &[u8]) -> Vec<Vec<u8>> {
    frames(bytes).filter(|frame| frame.len() <= FRAME_MAX).filter_map(cobs_decode).filter_map(checked).collect()
}

/// COBS by its definition: each group is its length plus one, then its bytes; a zero follows all but a full group
/// and the last.
fn cobs_decode(frame: &[u8]) -> Option<Vec<u8>> {
    let (mut out, mut rest) = (Vec::new(), frame);
    while let Some((&code, tail)) = rest.split_first() {
        let (group, after) = tail.split_at_checked(usize::from(code) - 1)?;
        out.extend(group);
        if code != 0xFF && !after.is_empty() {
            out.push(0);
        }
        rest = after;
    }
    Some(out)
}

/// A body without its checksum, if that is right.
fn checked(body: Vec<u8>) -> Option<Vec<u8>> {
    let (payload, checksum) = body.split_last_chunk::<4>()?;
    (crc32(payload) == u32::from_le_bytes(*checksum)).then(|| payload.to_vec())
}

/// CRC-32/ISO-HDLC, bit by bit.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    let mut register = u32::MAX;
    for &byte in bytes {
        register ^= u32::from(byte);
        for _ in 0..8 {
            register = if register & 1 == 1 { register >> 1 ^ 0xEDB8_8320 } else { register >> 1 };
        }
    }
    !register
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_on_the_protocol_page_is_a_good_frame() {
        assert_eq!(good_payloads(&[0x08, 0x01, 0x05, 0x07, 0xC3, 0xD2, 0x90, 0x1D, 0x00]), [[1, 5, 7]]);
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }
}
