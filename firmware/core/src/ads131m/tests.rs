//! The driver against bytes worked out by hand, and against the chip model.

use core::cell::{Cell, RefCell};
use std::vec::Vec;

use embedded_hal_mock::eh1::spi::{Mock, Transaction};
use palpate_shared::sim::{Faults, FingerConfig, FloatingBus, SimulatedFrontEnd, SpiPort, StatusLatch};
use proptest::prelude::*;

use super::*;
use crate::settings::{ConverterClock, Gain, Rate};
use crate::test_chip::{behaviour, on_chip_of};

/// The frames of [`Ads131m02::init`] at 4 kHz and gain 32: what goes out, what comes in.
///
/// Commands and registers are spelt out from the datasheet; the CRCs come from Python's
/// `binascii.crc_hqx(bytes, 0xFFFF)`, which shares nothing with this crate.
const INIT_FRAMES: [(&str, &str); 16] = [
    ("0655008f7600000000000000", "0500000000000000006fbe00"), // UNLOCK; the power-up STATUS
    ("001100fcde00000000000000", "065500000000000000c12000"), // RESET; UNLOCK acknowledged
    ("000000cc9c00000000000000", "ff2200000000000000608100"), // NULL; RESET acknowledged
    ("a00000710000000000000000", "0500000000000000006fbe00"), // RREG ID; STATUS
    ("000000cc9c00000000000000", "2282000000000000000bce00"), // NULL; ID
    ("610000111000638800000000", "0500000000000000006fbe00"), // WREG MODE 1110; STATUS
    ("a10000463000000000000000", "410000000000000000ac8800"), // RREG MODE; MODE written
    ("000000cc9c00000000000000", "1110000000000000009d1b00"), // NULL; MODE
    ("618000030e004c2700000000", "010000000000000000f35100"), // WREG CLOCK 030E; STATUS
    ("a180005da800000000000000", "418000000000000000510900"), // RREG CLOCK; CLOCK written
    ("000000cc9c00000000000000", "030e00000000000000ab2700"), // NULL; CLOCK
    ("6200000055002b0200000000", "010000000000000000f35100"), // WREG GAIN1 0055; STATUS
    ("a200001f6000000000000000", "42000000000000000081cc00"), // RREG GAIN1; GAIN1 written
    ("000000cc9c00000000000000", "0055000000000000009ba800"), // NULL; GAIN1
    ("000000cc9c00000000000000", "0103000000000000003b2400"), // NULL; STATUS with unread data
    ("000000cc9c00000000000000", "010000000000000000f35100"), // NULL; STATUS without
];

/// The frame of [`INIT_FRAMES`] that resets, after which the driver pauses.
const RESET_AT: usize = 1;

pub(super) fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

/// One frame, each way, as the mock expects it.
fn exchange(out: &str, input: &str) -> Vec<Transaction<u8>> {
    let transfer = Transaction::transfer_in_place(bytes(out), bytes(input));
    [Transaction::transaction_start(), transfer, Transaction::transaction_end()].into()
}

/// The frames of an initialisation.
fn init_transactions() -> Vec<Transaction<u8>> {
    let mut all = Vec::new();
    for (at, (out, input)) in INIT_FRAMES.into_iter().enumerate() {
        all.extend(exchange(out, input));
        if at == RESET_AT {
            all.insert(all.len() - 1, Transaction::delay(10_000));
        }
    }
    all
}

/// A bus that the mock plays, and the time that was waited with chip select high, in ns.
pub(super) struct MockBus<'a> {
    spi: Mock<u8>,
    waited_ns: &'a Cell<u32>,
}

impl<'a> MockBus<'a> {
    pub(super) fn new(spi: &Mock<u8>, waited_ns: &'a Cell<u32>) -> Self {
        Self { spi: spi.clone(), waited_ns }
    }
}

impl embedded_hal::spi::ErrorType for MockBus<'_> {
    type Error = embedded_hal::spi::ErrorKind;
}

impl SpiDevice for MockBus<'_> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Self::Error> {
        self.spi.transaction(operations)
    }
}

impl DelayNs for MockBus<'_> {
    fn delay_ns(&mut self, duration_ns: u32) {
        self.waited_ns.set(self.waited_ns.get() + duration_ns);
    }
}

pub(super) fn settings(hz: u32, gain: u8) -> DeviceSettings {
    DeviceSettings { rate: Rate::from_hz(hz, ConverterClock::NOMINAL).unwrap(), gain: Gain::from_factor(gain).unwrap() }
}

#[test]
fn initialisation_puts_these_bytes_on_the_bus() {
    let mut mock = Mock::new(&init_transactions());
    let waited_ns = Cell::new(0);
    let mut chip = Ads131m02::new(MockBus::new(&mock, &waited_ns));
    assert_eq!(chip.init(settings(4000, 32)), Ok(0x2282));
    mock.done();
    // t_REGACQ is 5 µs; whether it begins with the reset's last clock or as chip select rises is not said.
    assert_eq!(waited_ns.get(), 10_000);
}

#[test]
fn a_frame_brings_both_codes_and_the_response_to_the_frame_before() {
    // 1 and −1; then the ends of the range.
    let frames = [
        exchange("bf00001e5200000000000000", "010300000001ffffff9ffc00"),
        exchange("000000cc9c00000000000000", "0103007fffff80000091ed00"),
    ];
    let mut mock = Mock::new(&frames.concat());
    let waited_ns = Cell::new(0);
    let mut chip = Ads131m02::new(MockBus::new(&mock, &waited_ns));
    let first = Frame { answers: Command::Null, response: 0x0103, counts: [Counts(1), Counts(-1)], slow: None };
    assert_eq!(chip.read_frame(Command::Read(0x3E)), Ok(first));
    let second = chip.read_frame(Command::Null).unwrap();
    assert_eq!((second.answers, second.counts), (Command::Read(0x3E), [Counts::MAX, Counts::MIN]));
    mock.done();
}

#[test]
fn responses_that_do_not_fit_tell_of_lost_settings() {
    let tells =
        |answers, response| Frame { answers, response, counts: [Counts(0); 2], slow: None }.tells_lost_settings();
    let (read, write) = (Command::Read(4), Command::Write(4, 0x55));
    // After a reset; STATUS with RESET, LOCK, the other CRC, 16-bit words; a write nobody sent, or to another register.
    let lost = [
        (Command::Null, 0xFF22),
        (read, 0xFF22),
        (write, 0xFF22),
        (Command::Null, 0x0503),
        (Command::Null, 0x8103),
        (Command::Null, 0x0903),
        (Command::Null, 0x0003),
        (Command::Null, 0x4180),
        (Command::Null, 0x4200),
        (read, 0x4200),
        (write, 0x4280),
    ];
    // STATUS with and without new data, after a filter restart, after a damaged command; answers that fit.
    let sound = [
        (Command::Null, 0x0103),
        (Command::Null, 0x0100),
        (Command::Null, 0x4103),
        (Command::Null, 0x1103),
        (read, 0x0055),
        (write, 0x4200),
        (write, 0x1103),
        (Command::Reset, 0xFF21),
    ];
    for (answers, response) in lost {
        assert!(tells(answers, response), "{answers:?} {response:04X}");
    }
    for (answers, response) in sound {
        assert!(!tells(answers, response), "{answers:?} {response:04X}");
    }
}

#[test]
fn a_frame_with_a_wrong_checksum_brings_nothing() {
    // The last bit of channel 1 differs from the frame above.
    let mut mock = Mock::new(&exchange("000000cc9c00000000000000", "010300000001fffffe9ffc00"));
    let waited_ns = Cell::new(0);
    let mut chip = Ads131m02::new(MockBus::new(&mock, &waited_ns));
    assert_eq!(chip.read_frame(Command::Null), Err(Error::Checksum { response: 0x0103 }));
    mock.done();
}

/// The CRC of the datasheet, bit by bit.
fn crc_bit_by_bit(data: &[u8]) -> u16 {
    let mut crc = 0xFFFF_u16;
    for bit in data.iter().flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1)) {
        let is_out = crc >> 15 != u16::from(bit);
        crc = (crc << 1) ^ if is_out { 0x1021 } else { 0 };
    }
    crc
}

#[test]
fn damaged_frames_pass_no_more_often_than_the_checksum_allows() {
    // One bit in twenty: four to five damaged bits in a frame, so the CRC is as good as a random number.
    let rates = [0.02, 0.05, 0.5];
    let frames = 100_000;
    for (seed, bit_error_rate) in (1..).zip(rates) {
        let front_end = RefCell::new(SimulatedFrontEnd::new(on_chip_of(module_path!(), FingerConfig::default()), seed));
        let mut chip = Ads131m02::new(SpiPort::new(&front_end));
        let (mut refused, mut wrong) = (0, 0);
        for n in 0..frames {
            if n % 50 == 0 {
                // Damaged writes change the chip's settings too; now and then it gets them back.
                front_end.borrow_mut().set_faults(Faults::default());
                chip.init(settings(4000, 32)).unwrap();
                front_end.borrow_mut().set_faults(Faults { bit_error_rate, ..Faults::default() });
            }
            front_end.borrow_mut().step();
            let truth = RefCell::new(front_end.borrow().clone());
            truth.borrow_mut().set_faults(Faults::default());
            let mut raw = [0; FRAME_BYTES];
            SpiPort::new(&truth).transfer_in_place(&mut raw).unwrap();
            match chip.read_frame(Command::Null) {
                Ok(frame) if frame.tells_lost_settings() => {}
                Ok(frame) => {
                    wrong += i32::from(frame.counts != [code([raw[3], raw[4], raw[5]]), code([raw[6], raw[7], raw[8]])])
                }
                Err(_) => refused += 1,
            }
        }
        std::println!("bit error rate {bit_error_rate}: {refused} of {frames} refused, {wrong} wrong");
        // 10⁵/65536 = 1.5 expected at most; by chance more than 10 once in a million runs.
        assert!(refused > frames / 2 && wrong <= 10, "{refused} refused, {wrong} wrong");
    }
}

#[test]
fn a_chip_that_sends_words_of_another_length_is_noticed() {
    // In words of 16 bits: STATUS, two codes, their CRC, and zeros. Every such frame passes the CRC of 24-bit words.
    for codes in [[0, 0], [1, 0xFFFF], [0x1234, 0x8000]] {
        let mut frame = [0; FRAME_BYTES];
        for (place, word) in [0x0003, codes[0], codes[1]].into_iter().enumerate() {
            frame[2 * place..2 * place + 2].copy_from_slice(&u16::to_be_bytes(word));
        }
        let crc = crc_bit_by_bit(&frame[..6]);
        frame[6..8].copy_from_slice(&crc.to_be_bytes());
        assert_eq!(crc_bit_by_bit(&frame[..9]), 0);
        assert_eq!(parse::<2, ()>(Command::Null, &padded(frame)), Err(Error::WordLength { response: 3 }));
    }
}

#[test]
fn resets_for_any_mode_are_understood_by_the_chip_model_in_that_mode() {
    for (word_length, crc_type) in [(0, 1), (0, 0), (2, 1), (2, 0), (3, 0), (1, 1), (1, 0)] {
        let front_end = RefCell::new(SimulatedFrontEnd::new(on_chip_of(module_path!(), FingerConfig::ideal()), 1));
        let mut chip = Ads131m02::new(SpiPort::new(&front_end));
        chip.init(settings(4000, 32)).unwrap();
        // Input CRC on, and a word length and CRC that this driver never uses.
        let _ = chip.write_register(register::MODE, 1 << 12 | crc_type << 11 | word_length << 8);
        assert_eq!(front_end.borrow().chip().peek(2) >> 8, 0x10 | crc_type << 3 | word_length);
        let found = chip.init(settings(4000, 32)).map(|id_word| id_word >> 8);
        assert_eq!(found, Ok(0x22), "word length {word_length}, CRC type {crc_type}");
    }
}

#[test]
fn the_chip_model_takes_every_rate_and_gain() {
    let front_end = RefCell::new(SimulatedFrontEnd::new(on_chip_of(module_path!(), FingerConfig::ideal()), 1));
    let mut chip = Ads131m02::new(SpiPort::new(&front_end));
    for rate in Rate::on(ConverterClock::NOMINAL) {
        for log2 in 0..8 {
            let wanted = DeviceSettings { rate, gain: Gain::from_factor(1 << log2).unwrap() };
            chip.init(wanted).unwrap();
            let front_end = front_end.borrow();
            assert_eq!(front_end.period_ns(), rate.period_ns());
            assert_eq!([0, 1].map(|channel| front_end.chip().gain(channel)), [1 << log2; 2]);
        }
    }
}

#[test]
fn after_initialisation_each_edge_brings_the_conversion_that_it_announces() {
    let front_end = RefCell::new(SimulatedFrontEnd::new(on_chip_of(module_path!(), FingerConfig::default()), 1));
    let mut chip = Ads131m02::new(SpiPort::new(&front_end));
    for _ in 0..5 {
        front_end.borrow_mut().step(); // unread conversions pile up
    }
    chip.init(settings(4000, 32)).unwrap();
    for _ in 0..20 {
        assert!(front_end.borrow_mut().step());
        let frame = chip.read_frame(Command::Null).unwrap();
        let tells_of_this_frame = behaviour(module_path!()).status_latch == StatusLatch::FrameStart;
        assert_eq!(frame.is_new(), Some(tells_of_this_frame));
        // Had an older one been in the chip's memory, this one would still be there.
        assert!(!front_end.borrow().is_data_ready());
    }
}

#[test]
fn an_empty_socket_is_told_from_a_chip() {
    for (floating, word) in [(FloatingBus::High, 0xFFFF), (FloatingBus::Low, 0)] {
        let front_end = RefCell::new(SimulatedFrontEnd::new(on_chip_of(module_path!(), FingerConfig::ideal()), 1));
        front_end.borrow_mut().set_faults(Faults { chip_absent: Some(floating), ..Faults::default() });
        let mut chip = Ads131m02::new(SpiPort::new(&front_end));
        assert_eq!(chip.init(settings(4000, 32)), Err(Error::Checksum { response: word }));
    }
}

#[test]
fn a_locked_chip_is_initialised_all_the_same() {
    let front_end = RefCell::new(SimulatedFrontEnd::new(on_chip_of(module_path!(), FingerConfig::ideal()), 1));
    let mut spi = SpiPort::new(&front_end);
    spi.write(&bytes("055500000000000000000000")).unwrap(); // LOCK; input CRC is off after power-up
    let mut chip = Ads131m02::new(spi);
    assert_eq!(chip.init(settings(500, 1)), Ok(0x2282));
    assert_eq!(front_end.borrow().chip().gain(0), 1);
}

proptest! {
    #[test]
    fn any_one_to_three_damaged_bits_of_a_frame_are_noticed(
        response in any::<u16>(), codes in any::<[[u8; 3]; 2]>(),
        bits in prop::collection::btree_set(0_usize..88, 1..=3),
    ) {
        // CCITT's distance is 4 up to 32751 bits. The last byte is padding behind the CRC.
        let mut frame = [0; FRAME_BYTES];
        frame[..2].copy_from_slice(&response.to_be_bytes());
        frame[3..9].copy_from_slice(&codes.concat());
        let crc = CRC.checksum(&frame[..9]).to_be_bytes();
        frame[9..11].copy_from_slice(&crc);
        prop_assert!(parse::<2, ()>(Command::Null, &padded(frame)).is_ok());
        for bit in bits {
            frame[bit / 8] ^= 1 << (bit % 8);
        }
        // Two bytes of the frame are padding of 24-bit words: of the response (covered), of the CRC (not).
        prop_assert!(parse::<2, ()>(Command::Null, &padded(frame)).is_err());
    }

    #[test]
    fn no_reply_of_any_chip_makes_the_driver_panic(input in prop::collection::vec(any::<[u8; 12]>(), 1..80)) {
        struct Anything(std::vec::IntoIter<[u8; 12]>);
        impl embedded_hal::spi::ErrorType for Anything {
            type Error = embedded_hal::spi::ErrorKind;
        }
        impl SpiDevice for Anything {
            fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Self::Error> {
                let next = self.0.next().ok_or(embedded_hal::spi::ErrorKind::Other)?;
                for operation in operations {
                    if let Operation::TransferInPlace(buffer) = operation {
                        buffer.iter_mut().zip(next).for_each(|(to, from)| *to = from);
                    }
                }
                Ok(())
            }
        }
        impl DelayNs for Anything {
            fn delay_ns(&mut self, _: u32) {}
        }
        let mut chip = Ads131m02::new(Anything(input.into_iter()));
        prop_assert!(chip.init(DeviceSettings::at_start(0, ConverterClock::NOMINAL)).is_err());
    }
}

#[test]
fn a_sample_that_looks_like_words_of_16_bits_by_chance_is_kept() {
    // Among all codes of channel 0 that share their top byte there is one whose frame has the checksum 0.
    let chance = (0..=u16::MAX).find_map(|low| {
        let [middle, last] = low.to_be_bytes();
        let bytes = [0x05, 0x03, 0, 0x00, middle, last, 0x01, 0x02, 0, 0, 0, 0];
        (CRC.checksum(&bytes[..9]) == 0).then_some(bytes)
    });
    let frame: Result<Frame, Error<()>> = parse::<2, ()>(Command::Null, &padded(chance.unwrap()));
    assert_eq!(frame.unwrap().counts[1], Counts(0x01_0200));
}
