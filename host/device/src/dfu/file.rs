//! What a file of firmware has to be: whole, for this chip, and palpate's.
//!
//! A `.dfu` file is the flash's contents with the suffix of DFU 1.1 behind them: 16 bytes with the device that it is for and a
//! CRC-32 of all before it, as `cargo xtask dist` writes it. An ELF file is what the compiler makes; it and bare contents
//! (`.bin`) have no checksum of their own. Errors: [`NotAFirmware`].

use std::ops::Range;

use super::elf;
use super::{FLASH_BYTES, FLASH_START, LOADER};

/// Bytes of the suffix.
const SUFFIX_BYTES: usize = 16;

/// The suffix's end, before its length and the CRC.
const SIGNATURE: &[u8; 3] = b"UFD";

/// What every image of palpate holds: its name on USB.
const MARK: &[u8] = b"palpate finger";

/// The chip's RAM; a stack begins in it or at its end.
const RAM: Range<u32> = 0x2000_0000..0x2002_0001;

/// Bytes of the vector table that are looked at.
const VECTORS_BYTES: usize = 8;

/// Contents of the flash that passed every check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FirmwareFile {
    bytes: Vec<u8>,
}

/// Why a file is not put onto a board. Nothing was erased.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotAFirmware {
    /// It is an executable, and not one that fits the chip.
    #[error("it is no executable for this chip: {0}")]
    Executable(&'static str),
    /// It has no suffix.
    #[error("it does not end as a file for DFU does: it is cut off, or of another kind")]
    NoSuffix,
    /// Its checksum is another.
    #[error("it is damaged: its CRC-32 is {found:#010x}, and {stated:#010x} is stated")]
    Damaged {
        /// What it states.
        stated: u32,
        /// What it has.
        found: u32,
    },
    /// It is for another device.
    #[error("it is for the device {vendor:04x}:{product:04x}, and not for the loader 0483:df11")]
    OtherDevice {
        /// The vendor.
        vendor: u16,
        /// The product.
        product: u16,
    },
    /// It is larger than the chip's flash.
    #[error("it holds {bytes} bytes, and the chip's flash {FLASH_BYTES}")]
    TooLarge {
        /// How many it holds.
        bytes: usize,
    },
    /// Its vector table is none of an image at the flash's beginning.
    #[error("its vector table is none for this chip: stack {stack:#010x}, start {start:#010x}")]
    OtherChip {
        /// Where the stack would begin.
        stack: u32,
        /// Where the image would start.
        start: u32,
    },
    /// It is for this chip, and not palpate's.
    #[error("it is an image for this chip, and none of palpate's")]
    Foreign,
}

impl FirmwareFile {
    /// Checks what a file holds: an ELF file's form, or the suffix and checksum of a `.dfu` file; and that it is an image of
    /// palpate's for this chip.
    ///
    /// # Errors
    /// [`NotAFirmware`].
    pub fn read(file: &[u8]) -> Result<Self, NotAFirmware> {
        if file.starts_with(elf::MAGIC) {
            let flash = FLASH_START..FLASH_START + FLASH_BYTES;
            return Self::read_bare(&elf::flash_contents(file, &flash).map_err(NotAFirmware::Executable)?);
        }
        let (bytes, suffix) =
            file.len().checked_sub(SUFFIX_BYTES).map(|at| file.split_at(at)).ok_or(NotAFirmware::NoSuffix)?;
        if suffix[8..11] != *SIGNATURE || usize::from(suffix[11]) != SUFFIX_BYTES {
            return Err(NotAFirmware::NoSuffix);
        }
        let stated = u32::from_le_bytes([suffix[12], suffix[13], suffix[14], suffix[15]]);
        let found = crc(&file[..file.len() - 4]);
        if found != stated {
            return Err(NotAFirmware::Damaged { stated, found });
        }
        let half = |at: usize| u16::from_le_bytes([suffix[at], suffix[at + 1]]);
        let (product, vendor) = (half(2), half(4));
        if (vendor, product) != LOADER {
            return Err(NotAFirmware::OtherDevice { vendor, product });
        }
        Self::read_bare(bytes)
    }

    /// Checks bare contents of the flash, of which nothing tells whether they are whole.
    ///
    /// # Errors
    /// [`NotAFirmware`].
    pub fn read_bare(bytes: &[u8]) -> Result<Self, NotAFirmware> {
        if bytes.len() > FLASH_BYTES as usize {
            return Err(NotAFirmware::TooLarge { bytes: bytes.len() });
        }
        let word = |at: usize| bytes.get(at..at + 4).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let (stack, start) = (word(0), word(4));
        let end = FLASH_START + u32::try_from(bytes.len()).unwrap_or(0);
        let is_code = start % 2 == 1 && (FLASH_START..end).contains(&start);
        if bytes.len() < VECTORS_BYTES || !RAM.contains(&stack) || !is_code {
            return Err(NotAFirmware::OtherChip { stack, start });
        }
        if !bytes.windows(MARK.len()).any(|window| window == MARK) {
            return Err(NotAFirmware::Foreign);
        }
        Ok(Self { bytes: bytes.to_vec() })
    }

    /// What is to be in the flash, from its beginning.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

/// The suffix's checksum: CRC-32 as in zip, without its last inversion.
pub(super) fn crc(bytes: &[u8]) -> u32 {
    bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| crc >> 1 ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 })
    })
}
