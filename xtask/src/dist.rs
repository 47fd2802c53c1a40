//! `cargo xtask dist`: the tool and the images that a release hands out, with their checksums.
//!
//! The tool is for computers like the one that builds it, with every feature. For each converter that an image can be built for: the ELF file, for probes and for `addr2line`, and a `.dfu` file, which
//! holds the flash's contents and the suffix of DFU 1.1 (the device that it is for, CRC-32): `dfu-util` and
//! `palpate_device::dfu` check it. `SHA256SUMS` is what `sha256sum --check` reads.

use std::env::consts::{self, EXE_SUFFIX};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

/// Converters that an image can be built for: the names that `shared/src/front_ends.rs` has. The usual one is built last, so
/// that it is the one that other chores find.
pub(crate) const FRONT_ENDS: [&str; 2] = ["ADS131M04", "ADS131M02"];

/// Vendor and product of the chip's own loader.
const LOADER: (u16, u16) = (0x0483, 0xDF11);

/// Version of the DFU specification that the suffix follows.
const DFU_VERSION: u16 = 0x0100;

/// Which version of the product is meant: any.
const ANY_VERSION: u16 = 0xFFFF;

/// The suffix's length, in bytes.
const SUFFIX_BYTES: u8 = 16;

/// Builds the tool with `tool`, which gives its file, and every image with `build`, which takes a converter's name and gives an
/// ELF file and its flash's contents, and writes what a release has into a folder of `target`. Gives that folder.
///
/// # Errors
/// What `tool` and `build` say, or why a file cannot be written.
pub(crate) fn write(
    target: &Path,
    tool: impl FnOnce() -> Result<PathBuf, String>,
    mut build: impl FnMut(&str) -> Result<(PathBuf, Vec<u8>), String>,
) -> Result<PathBuf, String> {
    let folder = target.join("dist");
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut sums = String::new();
    let mut keep = |name: String, bytes: &[u8]| {
        let path = folder.join(&name);
        let digest: String = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        // Writing to a text does not fail.
        let _ = writeln!(sums, "{digest}  {name}");
        std::fs::write(&path, bytes).map_err(|error| format!("{}: {error}", path.display()))?;
        Ok::<_, String>(path)
    };
    let read = |path: &Path| std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()));
    let built = tool()?;
    let name = format!("palpate-{}-{}-{}{EXE_SUFFIX}", env!("CARGO_PKG_VERSION"), consts::OS, consts::ARCH);
    let tool = keep(name, &read(&built)?)?;
    let permissions = std::fs::metadata(&built).and_then(|of| std::fs::set_permissions(&tool, of.permissions()));
    permissions.map_err(|error| format!("{}: {error}", tool.display()))?;
    for front_end in FRONT_ENDS {
        let name = format!("palpate-{}-{}", env!("CARGO_PKG_VERSION"), front_end.to_lowercase());
        let (elf, contents) = build(front_end)?;
        let elf = read(&elf)?;
        keep(format!("{name}.elf"), &elf)?;
        keep(format!("{name}.dfu"), &with_suffix(contents))?;
    }
    let path = folder.join("SHA256SUMS");
    std::fs::write(&path, sums).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(folder)
}

/// Contents of a flash with the suffix behind them (DFU 1.1, appendix B).
fn with_suffix(mut contents: Vec<u8>) -> Vec<u8> {
    for half in [ANY_VERSION, LOADER.1, LOADER.0, DFU_VERSION] {
        contents.extend(half.to_le_bytes());
    }
    contents.extend(b"UFD");
    contents.push(SUFFIX_BYTES);
    let crc = crc(&contents);
    contents.extend(crc.to_le_bytes());
    contents
}

/// CRC-32 as in zip, without its last inversion.
fn crc(bytes: &[u8]) -> u32 {
    bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| crc >> 1 ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_suffix_is_that_of_the_standard() {
        let file = with_suffix(b"123456789".to_vec());
        // By Python: struct.pack("<HHHH3sB", 0xffff, 0xdf11, 0x0483, 0x0100, b"UFD", 16), and zlib.crc32 of all, inverted.
        let wanted = [0xFF, 0xFF, 0x11, 0xDF, 0x83, 0x04, 0x00, 0x01, b'U', b'F', b'D', 16];
        assert_eq!(file[9..21], wanted);
        assert_eq!(file[21..], 0x3939_1E8B_u32.to_le_bytes());
    }

    #[test]
    fn a_release_has_the_tool_both_images_and_the_sums_of_all_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let elf = folder.path().join("elf");
        std::fs::write(&elf, b"abc").expect("a file");
        let mut built = Vec::new();
        let tool = || Ok(elf.clone());
        let dist = write(folder.path(), tool, |front_end| {
            built.push(front_end.to_owned());
            Ok((elf.clone(), b"123456789".to_vec()))
        });
        let dist = dist.expect("it is written");
        assert_eq!(built, FRONT_ENDS);
        let sums = std::fs::read_to_string(dist.join("SHA256SUMS")).expect("the sums");
        assert_eq!(sums.lines().count(), 5);
        // FIPS 180-2: SHA-256 of "abc".
        let of_abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let name = format!("palpate-{}-ads131m02.elf", env!("CARGO_PKG_VERSION"));
        assert!(sums.contains(&format!("{of_abc}  {name}\n")), "{sums}");
        for (_, name) in sums.lines().filter_map(|line| line.split_once("  ")) {
            assert!(dist.join(name).is_file(), "{name}");
        }
        assert!(write(folder.path(), tool, |_| Err("no compiler".to_owned())).is_err());
        let without_tool = || Err("no compiler".to_owned());
        assert!(write(folder.path(), without_tool, |_| Ok((elf.clone(), Vec::new()))).is_err());
    }
}
