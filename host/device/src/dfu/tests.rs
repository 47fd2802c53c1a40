//! Files and loaders, good and bad.

use super::file::crc;
use super::simulated::{Faults, Loader};
use super::*;

/// Contents of a flash as palpate's image has them: a vector table, the mark, and so many bytes in all.
fn contents(bytes: usize) -> Vec<u8> {
    let mut contents: Vec<u8> = (0..bytes).map(|at| u8::try_from(at * 31 % 251).unwrap()).collect();
    contents[..4].copy_from_slice(&0x2000_2000_u32.to_le_bytes());
    contents[4..8].copy_from_slice(&0x0800_0199_u32.to_le_bytes());
    contents[600..614].copy_from_slice(b"palpate finger");
    contents
}

/// The file of these contents, for this device: the suffix as DFU 1.1 has it, appendix B.
fn file(contents: &[u8], vendor: u16, product: u16) -> Vec<u8> {
    let mut file = contents.to_vec();
    file.extend([0xFF, 0xFF]);
    file.extend(product.to_le_bytes());
    file.extend(vendor.to_le_bytes());
    file.extend([0x00, 0x01, b'U', b'F', b'D', 16]);
    let crc = crc(&file);
    file.extend(crc.to_le_bytes());
    file
}

fn good(bytes: usize) -> FirmwareFile {
    FirmwareFile::read(&file(&contents(bytes), 0x0483, 0xDF11)).unwrap()
}

#[test]
fn the_checksum_is_that_of_the_standard() {
    // zlib.crc32(b"123456789") ^ 0xFFFFFFFF, by Python.
    assert_eq!(crc(b"123456789"), !0xCBF4_3926);
}

#[test]
fn an_image_gets_onto_the_board_and_is_started_whatever_state_the_loader_was_left_in() {
    for state in [2, 5, 9, 10] {
        let mut loader = Loader::new(state, Faults::default());
        let (image, mut steps) = (good(75_000), Vec::new());
        flash(&mut loader, &image, |step| steps.push(step)).unwrap();
        assert_eq!(&loader.flash[..75_000], image.bytes());
        assert!(loader.has_left, "started");
        // 75,000 bytes lie in the four sectors of 16 KiB and the one of 64 KiB; nothing else is erased.
        let wanted = [0, 0x4000, 0x8000, 0xC000, 0x1_0000].map(|at| FLASH_START + at);
        assert_eq!(loader.erased, wanted);
        assert!(loader.flash[0x2_0000..].iter().all(|&byte| byte == 0x5A));
        // The loader's own waits were kept: 5 sectors of 0.8 s at least.
        assert!(loader.waited >= Duration::from_secs(4), "{:?}", loader.waited);
        let writes = steps.iter().filter(|step| matches!(step, Step::Writing(_))).count();
        assert_eq!((writes, steps.last()), (75_000_usize.div_ceil(2048), Some(&Step::Starting)));
    }
}

#[test]
fn sectors_are_those_of_the_chip() {
    let needed = |bytes: usize| sectors(&vec![0; bytes]).map(|(at, part)| (at, part.len())).collect::<Vec<_>>();
    assert_eq!(needed(1), [(FLASH_START, 1)]);
    assert_eq!(needed(16 * 1024), [(FLASH_START, 16 * 1024)]);
    assert_eq!(needed(64 * 1024 + 1).last(), Some(&(0x0801_0000, 1)));
    assert_eq!(needed(FLASH_BYTES as usize).len(), 12);
    assert_eq!(SECTORS_KIB.iter().sum::<u32>() * 1024, FLASH_BYTES);
}

#[test]
fn what_an_image_leaves_free_stays_as_it_is() {
    let mut gapped = contents(80_000);
    // Two sectors of 16 KiB and some of the next.
    gapped[0x4000..0xD000].fill(0xFF);
    let image = FirmwareFile::read(&file(&gapped, 0x0483, 0xDF11)).unwrap();
    let (mut loader, mut told) = (Loader::new(2, Faults::default()), 0);
    flash(&mut loader, &image, |_| told += 1).unwrap();
    assert_eq!(loader.erased, [0, 0xC000, 0x1_0000].map(|at| FLASH_START + at));
    assert!(loader.flash[0x4000..0xC000].iter().all(|&byte| byte == 0x5A), "left as it was");
    assert_eq!(loader.flash[0xC000..80_000], gapped[0xC000..]);
    assert_eq!((told, sectors_needed(&image)), (steps(&image), 3));
}

#[test]
fn a_loader_of_another_chip_is_left_alone() {
    // STM32F411, STM32F103 and F446, STM32G4, and what is no name of sectors.
    for memory in [
        "@Internal Flash  /0x08000000/04*016Kg,01*064Kg,03*128Kg",
        "@Internal Flash /0x08000000/512*001Kg",
        "@Internal Flash  /0x08000000/04*016Kg,01*064Kg,07*128Mg",
        "@Internal Flash  /0x08020000/04*016Kg,01*064Kg,07*128Kg",
        "@Internal Flash  /0x08000000/999999999*128Kg",
        "@Option Bytes  /0x1FFFC000/01*016 e",
        "",
    ] {
        let mut loader = Loader::new(2, Faults::default());
        memory.clone_into(&mut loader.memory);
        let refused = flash(&mut loader, &good(3000), |_| ()).unwrap_err();
        assert!(matches!(&refused, FlashError::OtherChip { memory: named } if named == memory), "{refused}");
        assert!(loader.erased.is_empty());
    }
}

/// An ELF file with these parts: where each is kept, and what it holds.
fn elf(parts: &[(u32, &[u8])]) -> Vec<u8> {
    let mut file = b"\x7fELF\x01\x01\x01".to_vec();
    file.resize(16, 0);
    // Executable, ARM, version; entry, program headers behind this header, no sections; flags, sizes and counts.
    file.extend([2, 0, 40, 0, 1, 0, 0, 0]);
    for word in [0x0800_0199_u32, 52, 0, 0x0500_0400] {
        file.extend(word.to_le_bytes());
    }
    for half in [52, 32, u16::try_from(parts.len()).unwrap(), 40, 0, 0] {
        file.extend(half.to_le_bytes());
    }
    let mut offset = 52 + 32 * u32::try_from(parts.len()).unwrap();
    for (kept_at, bytes) in parts {
        let length = u32::try_from(bytes.len()).unwrap();
        // It is used elsewhere than it is kept, as variables are.
        for word in [1, offset, 0x2000_0000, *kept_at, length, length, 5, 4] {
            file.extend(word.to_le_bytes());
        }
        offset += length;
    }
    parts.iter().for_each(|(_, bytes)| file.extend(*bytes));
    file
}

#[test]
fn an_executable_is_taken_by_what_it_keeps_in_the_flash() {
    let whole = contents(3000);
    let image = FirmwareFile::read(&elf(&[(FLASH_START, &whole[..2000]), (FLASH_START + 2100, &[1, 2, 3])])).unwrap();
    assert_eq!(image.bytes()[..2000], whole[..2000]);
    assert_eq!(image.bytes()[2000..], [&[0xFF; 100][..], &[1, 2, 3]].concat());

    let file = elf(&[(FLASH_START, &whole)]);
    for length in [6, 20, 51, 60, 100, file.len() - 1] {
        let refused = FirmwareFile::read(&file[..length]).unwrap_err();
        assert!(matches!(refused, NotAFirmware::Executable(_)), "{length}: {refused}");
    }
    let mut other_processor = file.clone();
    other_processor[18] = 62;
    for elsewhere in [elf(&[(0x2000_0000, &whole)]), elf(&[(u32::MAX, &[0; 4])]), other_processor] {
        assert!(matches!(FirmwareFile::read(&elsewhere), Err(NotAFirmware::Executable(_))));
    }
    // Bare contents, with nothing around them, where that is said.
    assert_eq!(FirmwareFile::read_bare(&whole).unwrap().bytes(), whole);
    assert_eq!(FirmwareFile::read(&whole), Err(NotAFirmware::NoSuffix));
    let mut foreign = whole.clone();
    foreign[600..614].copy_from_slice(b"another finger");
    assert_eq!(FirmwareFile::read(&elf(&[(FLASH_START, &foreign)])), Err(NotAFirmware::Foreign));
}

#[test]
fn damaged_and_foreign_files_are_refused_before_anything_is_erased() {
    let whole = file(&contents(3000), 0x0483, 0xDF11);
    for at in (0..whole.len()).step_by(7) {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x04;
        let refused = FirmwareFile::read(&damaged).unwrap_err();
        assert!(matches!(refused, NotAFirmware::Damaged { .. } | NotAFirmware::NoSuffix), "{at}: {refused}");
    }
    for length in [0, 5, 15, 16, 100, whole.len() - 1] {
        let refused = FirmwareFile::read(&whole[..length]).unwrap_err();
        assert!(matches!(refused, NotAFirmware::NoSuffix | NotAFirmware::Damaged { .. }), "{length}: {refused}");
    }
    let other = NotAFirmware::OtherDevice { vendor: 0x1209, product: 0x0001 };
    assert_eq!(FirmwareFile::read(&file(&contents(3000), 0x1209, 0x0001)), Err(other));
    let refused = |contents: &[u8]| FirmwareFile::read(&file(contents, 0x0483, 0xDF11)).unwrap_err();
    let mut foreign = contents(3000);
    foreign[600..614].copy_from_slice(b"another finger");
    assert_eq!(refused(&foreign), NotAFirmware::Foreign);
    // Linked for behind another loader, with an even address, or with its stack elsewhere.
    for (at, word) in [(4, 0x0801_0199_u32), (4, 0x0800_0198), (0, 0x1000_1000), (0, 0xFFFF_FFFF)] {
        let mut moved = contents(3000);
        moved[at..at + 4].copy_from_slice(&word.to_le_bytes());
        assert!(matches!(refused(&moved), NotAFirmware::OtherChip { .. }), "{word:#x}");
    }
    assert!(matches!(refused(&contents(FLASH_BYTES as usize + 1)), NotAFirmware::TooLarge { .. }));
}

#[test]
fn what_the_loader_cannot_do_is_told_with_its_place() {
    let failed = |faults: Faults| flash(&mut Loader::new(2, faults), &good(75_000), |_| ()).unwrap_err();
    let faults = Faults::default();
    let at = FLASH_START + 3 * 2048;
    let refused = failed(Faults { write_fails_at: Some(at), ..faults });
    assert!(matches!(refused, FlashError::Refused { step: Step::Writing(step), error: 6 } if step == at), "{refused}");
    assert!(refused.to_string().contains("writing failed"), "{refused}");
    // A cell that does not take a 0 shows when it is read back.
    let stuck = failed(Faults { stuck_at: Some(at + 5), ..faults });
    assert!(matches!(stuck, FlashError::Different { address, found: 0xFF, .. } if address == at + 5), "{stuck}");
    assert!(matches!(failed(Faults { hangs: true, ..faults }), FlashError::Busy { step: Step::Erasing(_), .. }));
    for requests in [0, 1, 7, 60, 200] {
        let gone = failed(Faults { unplugged_after: Some(requests), ..faults });
        assert!(matches!(gone, FlashError::Port { .. }), "{requests}: {gone}");
    }
}

#[test]
fn a_board_without_all_of_an_image_is_not_started() {
    let mut loader = Loader::new(2, Faults { stuck_at: Some(FLASH_START + 100), ..Faults::default() });
    assert!(flash(&mut loader, &good(4000), |_| ()).is_err());
    assert!(!loader.has_left);
}
