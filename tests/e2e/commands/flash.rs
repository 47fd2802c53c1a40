//! Images onto boards: what is refused by name, and all of it but for the board.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::PALPATE;

/// Where the mark lies in the images of these tests.
const MARK_AT: usize = 600;

/// Contents of a flash with a vector table, what every image of palpate holds, and two free sectors.
fn contents() -> Vec<u8> {
    let mut contents = vec![0xFF; 0xC000 + 5000];
    contents[..1000].fill(0x5A);
    contents[..8].copy_from_slice(&[0x00, 0x20, 0x00, 0x20, 0x99, 0xC1, 0x00, 0x08]);
    contents[MARK_AT..MARK_AT + 14].copy_from_slice(b"palpate finger");
    contents[0xC000..].fill(0xA5);
    contents
}

/// With the suffix of DFU 1.1 for this vendor and product.
fn dfu(contents: &[u8], [vendor, product]: [u16; 2]) -> Vec<u8> {
    let mut file = contents.to_vec();
    for half in [0xFFFF, product, vendor, 0x0100] {
        file.extend(half.to_le_bytes());
    }
    file.extend(b"UFD\x10");
    let crc = file.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| crc >> 1 ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 })
    });
    file.extend(crc.to_le_bytes());
    file
}

/// The loader's vendor and product.
const LOADER: [u16; 2] = [0x0483, 0xDF11];

fn flash(folder: &Path, words: &[&str]) -> Output {
    let mut command = Command::new(PALPATE);
    command.arg("flash").args(words).current_dir(folder).env_remove("PALPATE_DEVICE").stdin(Stdio::null());
    command.output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    // Messages are broken at the terminal's end.
    String::from_utf8_lossy(bytes).split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" ")
}

#[test]
fn all_of_it_but_for_the_board_is_tried_on_a_simulated_one() {
    let folder = tempfile::tempdir().unwrap();
    let contents = contents();
    fs::write(folder.path().join("good.dfu"), dfu(&contents, LOADER)).unwrap();
    let output = flash(folder.path(), &["good.dfu", "-d", "sim:7"]);
    let told = text(&output.stdout);
    assert!(output.status.success(), "{told}{}", text(&output.stderr));
    // The first sector and the fourth; the two between stay free.
    assert!(told.contains(&format!("good.dfu: {} bytes in 2 sectors, CRC-32 as stated", contents.len())), "{told}");
    assert!(told.contains("SIMULATED: written to a loader in memory and read back"), "{told}");

    let output = flash(folder.path(), &["good.dfu", "--dry-run"]);
    assert!(output.status.success() && text(&output.stdout).contains("nothing was written"), "{output:?}");

    fs::write(folder.path().join("bare.bin"), &contents).unwrap();
    let output = flash(folder.path(), &["bare.bin", "--dry-run"]);
    assert!(text(&output.stdout).contains("without a checksum to hold it against"), "{output:?}");
}

#[test]
fn damaged_and_foreign_images_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let good = dfu(&contents(), LOADER);
    let mut damaged = good.clone();
    damaged[0xC123] ^= 1;
    let mut foreign = contents();
    foreign[MARK_AT] = b'P';
    let mut other_chip = contents();
    other_chip[7] = 0x00;
    let list = format!("{}  listed.dfu\n", "0".repeat(64));
    fs::write(folder.path().join("SHA256SUMS"), list).unwrap();
    let cases: [(&str, &[u8], &str); 7] = [
        ("damaged.dfu", &damaged, "it is damaged: its CRC-32 is"),
        ("short.dfu", &good[..good.len() - 100], "it does not end as a file for DFU does"),
        ("foreign.dfu", &dfu(&foreign, LOADER), "it is an image for this chip, and none of palpate's"),
        ("device.dfu", &dfu(&contents(), [0x1209, 1]), "it is for the device 1209:0001"),
        ("chip.dfu", &dfu(&other_chip, LOADER), "its vector table is none for this chip"),
        ("cut.elf", b"\x7fELF\x01\x01\x01", "it is no executable for this chip: it is cut off"),
        ("listed.dfu", &good, "it is damaged: its SHA-256 is"),
    ];
    for (name, bytes, wanted) in cases {
        fs::write(folder.path().join(name), bytes).unwrap();
        let output = flash(folder.path(), &[name, "-d", "sim:"]);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{name}: {said}");
        assert!(said.contains(wanted) && said.contains(&format!("{name} is not put onto a board")), "{name}: {said}");
        assert!(output.stdout.is_empty(), "{name}: {output:?}");
    }
}

#[test]
fn where_no_loader_is_meant_nothing_is_written_and_the_way_is_told() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("good.dfu"), dfu(&contents(), LOADER)).unwrap();
    // Whatever is plugged in here, no loader has this number.
    let output = flash(folder.path(), &["good.dfu", "--serial", "no such number"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let said = text(&output.stderr);
    let known = ["no board is in its loader", "no loader has the serial number", "cannot list what is plugged in"];
    assert!(known.iter().any(|known| said.contains(known)), "{said}");
    let output = flash(folder.path(), &["good.dfu", "-d", "file:run.mcap"]);
    assert!(text(&output.stderr).contains("a recording has no flash to write"), "{output:?}");
}
