//! What is in an image: sizes and symbols, read from its ELF file.
//!
//! Only what a 32-bit little-endian executable for this target needs. Source: System V ABI, chapters 4 and 5.

#[path = "../../host/device/src/dfu/elf.rs"]
mod elf;

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The board's processor, as the compiler names it.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// A section's flags: it takes memory on the target.
const ALLOCATED: u32 = 2;

/// A section's type: a symbol table.
const SYMBOLS: u32 = 2;

/// A section's type: it takes memory, but nothing in the file.
const NO_BITS: u32 = 8;

/// The flash.
const FLASH: Range<u32> = 0x0800_0000..0x0810_0000;

/// Where the RAM begins, flash being below.
const RAM_START: u32 = 0x2000_0000;

/// Bytes of a symbol's entry.
const SYMBOL_BYTES: usize = 16;

/// The folder of the image's build in cargo's target folder, apart from the host's: another compiler may build it.
#[must_use]
pub(crate) fn folder_in(target: &Path) -> PathBuf {
    target.join("firmware")
}

/// Where `cargo xtask firmware build` leaves the image.
#[must_use]
pub(crate) fn path_in(target: &Path) -> PathBuf {
    folder_in(target).join(TARGET).join("firmware").join("palpate-firmware")
}

/// An image's needs and names.
#[derive(Debug)]
pub(crate) struct Image {
    /// Bytes in flash.
    pub(crate) flash: u32,
    /// Bytes of variables in RAM.
    pub(crate) variables: u32,
    /// Bytes of stack.
    pub(crate) stack: u32,
    /// Functions for double-precision arithmetic, of which there should be none.
    pub(crate) double_precision: Vec<String>,
    /// The log's lines: the number that stands for each in the log, and what defmt says of it, as JSON.
    pub(crate) log_lines: Vec<(u32, String)>,
}

/// Why a file is not such an image.
#[derive(Debug)]
pub(crate) enum NotAnImage {
    /// It cannot be read.
    Unreadable(std::io::Error),
    /// It ends too early or is of another kind.
    OtherKind,
}

impl fmt::Display for NotAnImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable(error) => write!(f, "{error}"),
            Self::OtherKind => f.write_str("not a 32-bit little-endian ELF file"),
        }
    }
}

/// A section, as its header describes it.
#[derive(Clone, Copy)]
struct Section {
    kind: u32,
    flags: u32,
    address: u32,
    offset: u32,
    size: u32,
    link: u32,
}

/// The file's bytes, with reads that cannot leave them.
struct Bytes(Vec<u8>);

impl Bytes {
    fn word(&self, at: usize) -> Option<u32> {
        Some(u32::from_le_bytes(self.0.get(at..at + 4)?.try_into().ok()?))
    }

    fn half(&self, at: usize) -> Option<u16> {
        Some(u16::from_le_bytes(self.0.get(at..at + 2)?.try_into().ok()?))
    }

    fn text(&self, at: usize) -> Option<String> {
        let rest = self.0.get(at..)?;
        let end = rest.iter().position(|&byte| byte == 0)?;
        Some(String::from_utf8_lossy(&rest[..end]).into_owned())
    }

    fn sections(&self) -> Option<Vec<Section>> {
        if self.0.get(..6)? != b"\x7fELF\x01\x01" {
            return None;
        }
        let (start, size, count) = (self.word(32)? as usize, self.half(46)? as usize, self.half(48)? as usize);
        (0..count).map(|index| self.section(start + index * size)).collect()
    }

    fn section(&self, at: usize) -> Option<Section> {
        let field = |index: usize| self.word(at + 4 * index);
        Some(Section {
            kind: field(1)?,
            flags: field(2)?,
            address: field(3)?,
            offset: field(4)?,
            size: field(5)?,
            link: field(6)?,
        })
    }

    /// Names and values of all symbols.
    fn symbols(&self, sections: &[Section]) -> Option<Vec<(String, u32)>> {
        let table = sections.iter().find(|section| section.kind == SYMBOLS)?;
        let names = sections.get(table.link as usize)?;
        let entries = (0..table.size as usize / SYMBOL_BYTES).map(|index| table.offset as usize + index * SYMBOL_BYTES);
        entries.map(|at| Some((self.text((names.offset + self.word(at)?) as usize)?, self.word(at + 4)?))).collect()
    }
}

impl Image {
    /// Reads an image.
    ///
    /// # Errors
    /// [`NotAnImage`].
    pub(crate) fn read(path: &Path) -> Result<Self, NotAnImage> {
        let bytes = Bytes(std::fs::read(path).map_err(NotAnImage::Unreadable)?);
        Self::of(&bytes).ok_or(NotAnImage::OtherKind)
    }

    fn of(bytes: &Bytes) -> Option<Self> {
        let sections = bytes.sections()?;
        let symbols = bytes.symbols(&sections)?;
        let value = |name: &str| symbols.iter().find(|(known, _)| known == name).map(|&(_, value)| value);
        let sum = |wanted: &dyn Fn(&Section) -> bool| -> u32 {
            sections.iter().filter(|s| s.flags & ALLOCATED != 0 && wanted(s)).map(|section| section.size).sum()
        };
        Some(Self {
            // Variables with initial values lie in both.
            flash: sum(&|section| section.kind != NO_BITS),
            variables: sum(&|section| section.address >= RAM_START),
            stack: value("_stack_start")?.checked_sub(value("_stack_end")?)?,
            double_precision: symbols.iter().map(|(name, _)| name).filter(|name| is_double(name)).cloned().collect(),
            log_lines: symbols
                .iter()
                .filter(|(name, _)| name.starts_with('{'))
                .map(|(name, at)| (*at, name.clone()))
                .collect(),
        })
    }
}

/// What an ELF file puts into the flash, from the flash's beginning; what lies between its parts reads as erased.
///
/// # Errors
/// [`NotAnImage`].
pub(crate) fn flash_contents(path: &Path) -> Result<Vec<u8>, NotAnImage> {
    let file = std::fs::read(path).map_err(NotAnImage::Unreadable)?;
    elf::flash_contents(&file, &FLASH).map_err(|_| NotAnImage::OtherKind)
}

/// Whether a function of the compiler's run-time library computes in double precision.
fn is_double(name: &str) -> bool {
    let aeabi = name
        .strip_prefix("__aeabi_")
        .is_some_and(|rest| rest.starts_with('d') || rest.starts_with("cd") || rest.ends_with("2d"));
    // `df` is the library's own name for the type; `di` and `si` are integers.
    let builtin = name.starts_with("__")
        && ["adddf3", "subdf3", "muldf3", "divdf3", "extendsfdf2", "truncdfsf2"].iter().any(|end| name.ends_with(end));
    aeabi || builtin
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn double_precision_is_known_by_its_names() {
        for name in ["__aeabi_dadd", "__aeabi_dmul", "__aeabi_f2d", "__aeabi_i2d", "__aeabi_cdcmple", "__muldf3"] {
            assert!(is_double(name), "{name}");
        }
        for name in ["__aeabi_fadd", "__aeabi_uldivmod", "__aeabi_ul2f", "__aeabi_memcpy", "main", "__udivmoddi4"] {
            assert!(!is_double(name), "{name}");
        }
    }
}
