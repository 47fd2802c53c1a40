//! What differs on the ADS131M04: six words in a frame, its own identity, gain 1 on the slow channels.

use core::cell::{Cell, RefCell};
use std::vec::Vec;

use embedded_hal_mock::eh1::spi::{Mock, Transaction};
use palpate_shared::front_ends::{FrontEndKind, SLOW_CIRCUIT};
use palpate_shared::sim::{Channels, FingerConfig, SimulatedFrontEnd, SpiPort};

use super::tests::{MockBus, bytes, settings};
use super::*;

/// A frame's bytes by hand: words of 24 bits, and their checksum by Python's `binascii.crc_hqx(bytes, 0xFFFF)`.
const FRAME: &str = "01 0f00 000001 ffffff 0a0b0c f4f5f6 d0a400";

fn finger() -> RefCell<SimulatedFrontEnd> {
    let config = FingerConfig { channels: Channels::Four, ..FingerConfig::ideal() };
    RefCell::new(SimulatedFrontEnd::new(config, 1))
}

#[test]
fn a_frame_has_six_words_with_the_slow_channels_in_the_last_two() {
    let out = std::format!("000000cc9c00{}", "00".repeat(12));
    let transfer = Transaction::transfer_in_place(bytes(&out), bytes(&FRAME.replace(' ', "")));
    let frames: Vec<_> = [Transaction::transaction_start(), transfer, Transaction::transaction_end()].into();
    let mut mock = Mock::new(&frames);
    let waited_ns = Cell::new(0);
    let frame = Ads131m04::new(MockBus::new(&mock, &waited_ns)).read_frame(Command::Null).unwrap();
    mock.done();
    assert_eq!(frame.counts, [Counts(1), Counts(-1)]);
    assert_eq!(frame.slow, Some([Counts(0x0A_0B0C), Counts(0xF4_F5F6 - 0x100_0000)]));
    assert_eq!((frame.is_new(), frame.tells_lost_settings()), (Some(true), false));
}

#[test]
fn initialisation_turns_four_channels_on_and_sets_the_slow_ones_to_gain_1() {
    let front_end = finger();
    let mut chip = Ads131m04::new(SpiPort::new(&front_end));
    assert_eq!(chip.init(settings(4000, 32)).map(|id_word| id_word >> 8), Ok(0x24));
    let front_end = front_end.borrow();
    assert_eq!((front_end.chip().peek(3), front_end.chip().peek(4)), (0x0F0E, 0x0055));
    assert_eq!([0, 1, 2, 3].map(|channel| front_end.chip().gain(channel)), [32, 32, 1, 1]);
}

#[test]
fn each_driver_refuses_the_other_chip() {
    let front_end = finger();
    let refused = Ads131m02::new(SpiPort::new(&front_end)).init(settings(4000, 32));
    assert!(refused.is_err(), "{refused:?}");
    let two = RefCell::new(SimulatedFrontEnd::new(FingerConfig::ideal(), 1));
    let refused = Ads131m04::new(SpiPort::new(&two)).init(settings(4000, 32));
    assert!(refused.is_err(), "{refused:?}");
}

#[test]
fn the_slow_channels_see_parts_of_the_excitation() {
    let front_end = finger();
    let mut chip = Ads131m04::new(SpiPort::new(&front_end));
    chip.init(settings(4000, 32)).unwrap();
    let mut slow = [Counts(0); 2];
    for _ in 0..6 {
        front_end.borrow_mut().step();
        slow = chip.read_frame(Command::Null).unwrap().slow.unwrap();
    }
    let volts = slow.map(|code| f64::from(code.0) * 1.2 / 8_388_608.0);
    // 2.5 V; at 23 °C, by hand: 10 kΩ · exp(3950 · (1/296.15 − 1/298.15)) = 10.935 kΩ.
    assert!((volts[0] - 2.5 * f64::from(SLOW_CIRCUIT.excitation_part)).abs() < 1e-5, "{volts:?}");
    assert!((volts[1] - 2.5 * 10.935 / 49.935).abs() < 1e-3, "{volts:?}");
    let ohm = FrontEndKind::Ads131m04.facts().ntc_ohm(slow).unwrap();
    assert!((ohm - 10_935.0).abs() < 5.0, "{ohm} Ω");
}

#[test]
fn a_chip_in_words_of_another_length_is_noticed_and_brought_back() {
    for (word_length, crc_type) in [(0, 1), (0, 0), (2, 1), (2, 0), (3, 0), (1, 1), (1, 0)] {
        let front_end = finger();
        let mut chip = Ads131m04::new(SpiPort::new(&front_end));
        chip.init(settings(4000, 32)).unwrap();
        let _ = chip.write_register(register::MODE, 1 << 12 | crc_type << 11 | word_length << 8);
        front_end.borrow_mut().step();
        let frame = chip.read_frame(Command::Null);
        let is_believed = frame.is_ok_and(|frame| !frame.tells_lost_settings());
        assert!(!is_believed || (word_length, crc_type) == (1, 0), "word length {word_length}, CRC type {crc_type}");
        let found = chip.init(settings(4000, 32)).map(|id_word| id_word >> 8);
        assert_eq!(found, Ok(0x24), "word length {word_length}, CRC type {crc_type}");
    }
}

#[test]
fn a_raw_frame_is_the_first_twelve_bytes_of_a_whole_one() {
    let front_end = finger();
    let mut chip = Ads131m04::new(SpiPort::new(&front_end));
    chip.init(settings(4000, 32)).unwrap();
    chip.exchange_raw(frame_of(0xA000, None)).unwrap();
    let received = chip.exchange_raw(frame_of(0x0011, None)).unwrap();
    assert_eq!(received[0], 0x24);
    // A RESET needs a whole frame: it was one. Then t_REGACQ.
    SpiPort::new(&front_end).delay_ns(10_000);
    assert_eq!(chip.exchange_raw(frame_of(0, None)).unwrap()[..2], [0xFF, 0x24]);
}
