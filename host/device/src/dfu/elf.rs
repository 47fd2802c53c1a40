//! What an ELF file puts into a chip's flash. The chores include this file too, to make the files of a release.
//!
//! Only what a 32-bit little-endian executable for ARM needs. Source: System V ABI, chapters 4 and 5.
//! Errors: in words, of a file that is no such executable.

use std::ops::Range;

/// What the file begins with: its name, 32 bits, little-endian.
pub(crate) const MAGIC: &[u8; 6] = b"\x7fELF\x01\x01";

/// The processor's number in the file.
const ARM: u32 = 40;

/// A program header's type: a part that is loaded.
const LOADED: u32 = 1;

/// What an erased byte of flash reads.
const ERASED: u8 = 0xFF;

/// The flash's contents from its beginning; what lies between the file's parts reads as erased.
///
/// By the program headers, which say where a part is kept as well as where it is used.
pub(crate) fn flash_contents(file: &[u8], flash: &Range<u32>) -> Result<Vec<u8>, &'static str> {
    const CUT_OFF: &str = "it is cut off";
    let bytes = |at: usize, count: usize| file.get(at..at.checked_add(count)?);
    let number = |at: usize, count: usize| {
        let digits = bytes(at, count).ok_or(CUT_OFF)?;
        Ok::<_, &str>(digits.iter().rev().fold(0, |value, &digit| value << 8 | u32::from(digit)))
    };
    if !file.starts_with(MAGIC) || number(18, 2)? != ARM {
        return Err("it is no 32-bit little-endian ELF file for ARM");
    }
    let (start, size, count) = (number(28, 4)? as usize, number(42, 2)? as usize, number(44, 2)? as usize);
    let mut contents = Vec::new();
    for header in (0..count).map(|index| start + index * size) {
        let [kind, offset, kept_at, length] = [0, 4, 12, 16].map(|field| number(header + field, 4));
        let (offset, kept_at, length) = (offset? as usize, kept_at?, length?);
        if kind? != LOADED || length == 0 {
            continue;
        }
        let end = kept_at.checked_add(length).filter(|end| kept_at >= flash.start && *end <= flash.end);
        let end = (end.ok_or("a part of it lies outside the chip's flash")? - flash.start) as usize;
        if contents.len() < end {
            contents.resize(end, ERASED);
        }
        let part = bytes(offset, length as usize).ok_or(CUT_OFF)?;
        contents[end - part.len()..end].copy_from_slice(part);
    }
    Ok(contents)
}
