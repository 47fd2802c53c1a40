//! The chip against its datasheet, through the same bytes a host would exchange.

use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use super::registers::{
    CFG, CH0_CFG, CH1_CFG, CLOCK_TBM, ID, ID_VALUE, MODE_CRC_TYPE, MODE_RESET, MODE_RX_CRC_EN, MODE_WLENGTH,
    STATUS_DRDY0, STATUS_DRDY1,
};
use super::*;

/// MODE after a reset.
const MODE_DEFAULT: u16 = 0x0510;
/// CLOCK after a reset: both channels, OSR 1024, high resolution.
const CLOCK_DEFAULT: u16 = 0x030E;
/// Volts that give a round part of full scale at gain 1.
const HALF_SCALE_V: f32 = 0.6;
/// Pause between frames, longer than t_REGACQ, in nanoseconds.
const PAUSE_NS: u32 = 10_000;
/// Code of half full scale.
const HALF_SCALE: i32 = 0x40_0000;

/// Oracles for both CRCs that share nothing with the chip.
const CCITT: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
const ANSI: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_CMS);

fn read(address: u8, count: u16) -> u16 {
    0xA000 | u16::from(address) << 7 | (count - 1)
}

fn write(address: u8, count: u16) -> u16 {
    0x6000 | u16::from(address) << 7 | (count - 1)
}

/// A chip without noise, and the host's side of the bus in 24-bit words.
struct Bench {
    chip: Chip,
}

impl Bench {
    /// A chip just powered up.
    fn new() -> Self {
        let mut chip = Chip::new(1);
        chip.set_noise_factor(0.0);
        Self { chip }
    }

    /// A chip that has left its start-up behind: filter synchronised, FIFO empty, first reply read.
    fn settled() -> Self {
        let mut bench = Self::new();
        bench.send(&[0]);
        bench.chip.sync_pulse();
        bench.send(&[0]);
        bench
    }

    /// One frame of 16-bit contents, padded to four words; gives the words that came back, 24 bits each.
    fn send(&mut self, words: &[u16]) -> Vec<u32> {
        self.exchange(words, words.len().max(4))
    }

    /// One frame of so many words.
    fn exchange(&mut self, words: &[u16], length: usize) -> Vec<u32> {
        let mut bytes: Vec<u8> =
            words.iter().flat_map(|word| [word.to_be_bytes()[0], word.to_be_bytes()[1], 0]).collect();
        bytes.resize(3 * length, 0);
        self.chip.wait(PAUSE_NS);
        self.chip.transfer(&mut bytes);
        bytes.chunks(3).map(|b| u32::from_be_bytes([0, b[0], b[1], b[2]])).collect()
    }

    /// A frame with a command, a NULL frame, and the response in that.
    fn ask(&mut self, words: &[u16]) -> u16 {
        self.send(words);
        response(&self.send(&[0]))
    }

    fn set(&mut self, address: u8, value: u16) {
        self.send(&[write(address, 1), value]);
    }

    /// The codes that one frame gives.
    fn codes(&mut self) -> [i32; 2] {
        codes(&self.send(&[0]))
    }

    /// One conversion of these voltages, and the codes read after it.
    fn sample(&mut self, volts: [f32; 2]) -> [i32; 2] {
        self.chip.convert(volts);
        self.codes()
    }
}

/// The first 16 bits of a frame.
fn response(frame: &[u32]) -> u16 {
    u16::try_from(frame[0] >> 8).unwrap()
}

/// Both channels' codes in a frame of 24-bit words.
fn codes(frame: &[u32]) -> [i32; 2] {
    [1, 2].map(|i| (frame[i] << 8).cast_signed() >> 8)
}

// Frames and commands

#[test]
fn the_first_response_after_power_up_is_that_to_a_reset() {
    assert_eq!(response(&Bench::new().send(&[0])), 0xFF22);
}

#[test]
fn a_response_arrives_one_frame_after_its_command() {
    let mut bench = Bench::settled();
    assert_eq!(response(&bench.send(&[read(ID, 1)])), 0x0500, "still to the frame before");
    assert_eq!(response(&bench.send(&[read(CLOCK, 1)])), ID_VALUE);
    assert_eq!(response(&bench.send(&[0])), CLOCK_DEFAULT);
}

#[test]
fn the_registers_have_their_reset_values() {
    let expected = [
        ID_VALUE, 0x0500, 0x0510, 0x030E, 0, 0, 0x0600, 0, 0, // ID STATUS MODE CLOCK GAIN1 - CFG THRSHLD
        0, 0, 0, 0x8000, 0, // CH0_CFG OCAL GCAL
        0, 0, 0, 0x8000, 0, // CH1_CFG OCAL GCAL
    ];
    let mut bench = Bench::new();
    for (address, value) in expected.into_iter().enumerate() {
        assert_eq!(bench.ask(&[read(u8::try_from(address).unwrap(), 1)]), value, "address {address:#x}");
    }
    assert_eq!(bench.ask(&[read(REGMAP_CRC, 1)]), 0);
}

#[test]
fn null_is_answered_with_status_whose_drdy_bits_tell_of_unread_data() {
    let mut bench = Bench::settled();
    assert_eq!(response(&bench.send(&[0])), 0x0500);
    bench.chip.convert([0.0; 2]);
    assert_eq!(response(&bench.send(&[0])), 0x0500 | STATUS_DRDY0 | STATUS_DRDY1);
    assert_eq!(response(&bench.send(&[0])), 0x0500);
}

#[test]
fn several_registers_are_read_without_conversion_data() {
    let mut bench = Bench::settled();
    bench.chip.convert([HALF_SCALE_V; 2]);
    bench.send(&[read(MODE, 3)]);
    bench.chip.convert([HALF_SCALE_V; 2]);
    let frame = bench.exchange(&[0], 6);
    let expected = [0xE000 | u16::from(MODE) << 7 | 2, MODE_DEFAULT, CLOCK_DEFAULT, 0];
    assert_eq!(frame[..4], expected.map(|word| u32::from(word) << 8));
    assert_eq!(frame[5], 0, "nothing follows the CRC");
    assert!(bench.chip.is_data_ready(), "the conversion is still to be read");
}

#[test]
fn the_frame_that_gives_out_several_registers_takes_no_command() {
    for refused in [[read(ID, 1), 0], [0x0022, 0], [0x0555, 0], [write(GAIN1, 1), 0x0055]] {
        let mut bench = Bench::settled();
        bench.send(&[read(MODE, 2)]);
        bench.send(&refused);
        assert_eq!(response(&bench.send(&[0])), 0x0500, "{refused:x?}");
        assert!(bench.chip.is_converting() && bench.chip.gain(0) == 1);
    }
}

#[test]
fn several_registers_are_written_by_one_frame() {
    let mut bench = Bench::settled();
    bench.send(&[write(CH0_CFG + 1, 4), 0x1122, 0x3300, 0x4455, 0x6600]);
    assert_eq!(response(&bench.send(&[read(CH0_CFG + 1, 4)])), 0x4000 | u16::from(CH0_CFG + 1) << 7 | 3);
    let frame = bench.exchange(&[0], 6);
    assert_eq!(frame[1..5], [0x11_2200, 0x33_0000, 0x44_5500, 0x66_0000]);
}

#[test]
fn read_only_and_missing_registers_are_not_written_and_not_counted() {
    let mut bench = Bench::settled();
    let reply = bench.ask(&[write(ID, 3), 0xFFFF, 0xFFFF, MODE_DEFAULT]);
    assert_eq!(reply, 0x4000, "one register written: MODE");
    assert_eq!(bench.ask(&[read(ID, 1)]), ID_VALUE);
    bench.send(&[write(0x20, 1), 0xFFFF]);
    assert_eq!(bench.ask(&[read(0x20, 1)]), 0);
    bench.set(REGMAP_CRC, 0xFFFF);
    assert_eq!(bench.ask(&[read(REGMAP_CRC, 1)]), 0);
}

#[test]
fn registers_are_written_while_they_are_shifted_in() {
    let mut bench = Bench::settled();
    bench.exchange(&[write(CFG, 3), 0x0610, 0x1234], 3); // cut before the third word
    assert_eq!(response(&bench.send(&[read(CFG, 1)])), 0x4000 | u16::from(CFG) << 7 | 1);
    assert_eq!(response(&bench.send(&[read(CFG + 1, 1)])), 0x0610);
    assert_eq!(response(&bench.send(&[0])), 0x1234);
}

#[test]
fn an_unknown_command_is_answered_like_null() {
    for word in [0x0001, 0x0666, 0x2000, 0x8000, 0xFFFF] {
        assert_eq!(Bench::settled().ask(&[word]), 0x0500, "{word:#06x}");
    }
}

#[test]
fn a_locked_interface_takes_only_null_rreg_and_unlock() {
    let mut bench = Bench::settled();
    assert_eq!(bench.ask(&[0x0555]), 0x0555);
    for refused in [[0x0011, 0], [0x0022, 0], [0x0033, 0], [write(GAIN1, 1), 0x0055], [0x0555, 0]] {
        assert_eq!(bench.ask(&refused), 0x0500 | STATUS_LOCK, "{refused:x?}");
    }
    assert!(bench.chip.is_converting());
    assert_eq!(bench.ask(&[read(GAIN1, 1)]), 0);
    assert_eq!(bench.ask(&[0x0655]), 0x0655);
    assert_eq!(bench.ask(&[write(GAIN1, 1), 0x0055]), 0x4000 | u16::from(GAIN1) << 7);
    assert_eq!(bench.ask(&[read(GAIN1, 1)]), 0x0055);
}

#[test]
fn reset_needs_a_full_frame() {
    let mut bench = Bench::settled();
    bench.set(GAIN1, 0x0055);
    bench.exchange(&[0x0011], 3);
    assert_eq!(response(&bench.send(&[0])), 0x0011);
    assert_eq!(bench.chip.gain(0), 32);
    assert_eq!(bench.ask(&[0x0011]), 0xFF22);
    assert_eq!(bench.chip.gain(0), 1);
}

/// A chip that behaves so, with input CRCs off and its start-up behind it.
fn settled_as(status_latch: StatusLatch, reset_at: ResetMoment) -> Bench {
    let mut bench = Bench::settled();
    bench.chip.set_behaviour(Behaviour { status_latch, reset_at, ..Behaviour::default() });
    bench
}

#[test]
fn for_5_us_after_a_reset_frames_are_ignored() {
    for reset_at in [ResetMoment::ChipSelectRise, ResetMoment::LastClock] {
        for (wait_ns, answer) in [(0, [0xFF, 0xFF]), (4999, [0xFF, 0xFF]), (5000, [0xFF, 0x22])] {
            let mut bench = settled_as(StatusLatch::FrameStart, reset_at);
            bench.send(&[0x0011]);
            bench.chip.wait(wait_ns);
            let mut frame = [0; 12];
            bench.chip.transfer(&mut frame);
            assert_eq!(frame[..2], answer, "{reset_at:?}, {wait_ns} ns");
        }
    }
}

#[test]
fn a_pause_within_the_frame_counts_if_the_last_clock_resets() {
    for (reset_at, answer) in [(ResetMoment::ChipSelectRise, [0xFF, 0xFF]), (ResetMoment::LastClock, [0xFF, 0x22])] {
        let mut bench = settled_as(StatusLatch::FrameStart, reset_at);
        bench.set(GAIN1, 0x0055);
        let mut frame = [0; 12];
        [frame[0], frame[1]] = [0x00, 0x11];
        bench.chip.select();
        for byte in frame {
            bench.chip.exchange(byte);
        }
        assert_eq!(bench.chip.gain(0), if reset_at == ResetMoment::LastClock { 1 } else { 32 });
        bench.chip.wait(PAUSE_NS);
        bench.chip.deselect();
        frame = [0; 12];
        bench.chip.transfer(&mut frame);
        assert_eq!((frame[..2].to_vec(), bench.chip.gain(0)), (answer.to_vec(), 1), "{reset_at:?}");
    }
}

#[test]
fn status_tells_of_unread_data_when_it_is_latched() {
    // By hand: nothing unread; one conversion, its frame; then two conversions, and a frame for each.
    for (status_latch, bits) in [(StatusLatch::FrameStart, [0, 3, 3, 3, 0]), (StatusLatch::FrameEnd, [0, 0, 0, 3, 0])] {
        let mut bench = settled_as(status_latch, ResetMoment::ChipSelectRise);
        let mut read = |conversions: usize| {
            for _ in 0..conversions {
                bench.chip.convert([0.0; 2]);
            }
            response(&bench.send(&[0])) & (STATUS_DRDY0 | STATUS_DRDY1)
        };
        assert_eq!([0, 1, 2, 0, 0].map(&mut read), bits, "{status_latch:?}");
    }
}

#[test]
fn the_reset_flag_goes_when_mode_is_written_with_0_and_cannot_be_set() {
    let mut bench = Bench::settled();
    bench.set(MODE, MODE_DEFAULT & !MODE_RESET);
    assert_eq!(bench.ask(&[0]), 0x0100);
    bench.set(MODE, MODE_DEFAULT);
    assert_eq!(bench.ask(&[0]), 0x0100);
    assert_eq!(bench.ask(&[0x0011]), 0xFF22);
    assert_eq!(bench.ask(&[0]), 0x0500);
}

#[test]
fn frames_without_clocks_and_parts_of_a_word_do_nothing() {
    let mut bench = Bench::settled();
    bench.send(&[read(ID, 1)]);
    bench.chip.transfer(&mut []);
    assert_eq!(response(&bench.send(&[0])), ID_VALUE, "an empty frame does not use up a response");
    bench.chip.transfer(&mut [0x00, 0x22]); // two of the three bytes of STANDBY
    assert!(bench.chip.is_converting());
}

#[test]
fn the_bus_floats_high_outside_a_frame() {
    assert_eq!(Chip::new(1).exchange(0x00), 0xFF);
}

#[test]
fn the_crc_of_the_settings_follows_them_while_it_is_enabled() {
    let mut bench = Bench::settled();
    bench.set(MODE, MODE_DEFAULT | MODE_REG_CRC_EN);
    let before = bench.ask(&[read(REGMAP_CRC, 1)]);
    bench.set(CFG, 0x0610);
    assert_ne!(bench.ask(&[read(REGMAP_CRC, 1)]), before);
    bench.set(CFG, 0x0600);
    assert_eq!(bench.ask(&[read(REGMAP_CRC, 1)]), before);
}

// CRC

/// Splits a frame before its CRC word and checks it with an oracle.
fn output_crc_is_right(oracle: &crc::Crc<u16>, frame: &[u8], word_bytes: usize, crc_word: usize) -> bool {
    let (words, rest) = frame.split_at(crc_word * word_bytes);
    rest[..2] == oracle.checksum(words).to_be_bytes() && rest[2..word_bytes].iter().all(|&byte| byte == 0)
}

proptest! {
    #[test]
    fn every_frame_ends_with_the_crc_of_its_words(volts in -1.0f32..1.0, ansi: bool, wlength in 0u16..4) {
        let mut bench = Bench::settled();
        let kind = if ansi { MODE_CRC_TYPE } else { 0 };
        bench.set(MODE, (MODE_DEFAULT & !MODE_WLENGTH) | wlength << 8 | kind);
        let (word_bytes, oracle) = ([2, 3, 4, 4][usize::from(wlength)], if ansi { &ANSI } else { &CCITT });
        for _ in 0..3 {
            bench.chip.convert([volts, -0.7 * volts]);
            let mut frame = vec![0; 4 * word_bytes];
            bench.chip.transfer(&mut frame);
            prop_assert!(output_crc_is_right(oracle, &frame, word_bytes, 3), "{frame:x?}");
        }
    }

    #[test]
    fn no_bytes_can_upset_the_chip(frames in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 0..20)) {
        let mut chip = Chip::new(1);
        for mut frame in frames {
            chip.convert([0.1, -0.1]);
            chip.transfer(&mut frame);
        }
        chip.reset_pulse();
        chip.wait(PAUSE_NS);
        let mut frame = [0; 12];
        chip.transfer(&mut frame);
        prop_assert_eq!(&frame[..2], &[0xFF, 0x22]);
        prop_assert_eq!(chip.peek(CLOCK.into()), CLOCK_DEFAULT);
    }

    #[test]
    fn reserved_bits_stay_as_they_were_reset(address in 0u8..0x40, value: u16) {
        let mut bench = Bench::settled();
        let before = bench.chip.registers.read(address);
        bench.chip.registers.write(address, value);
        bench.chip.registers.write(address, before);
        // Only MODE's RESET flag does not come back.
        let lost = if address == MODE { before & !value & MODE_RESET } else { 0 };
        prop_assert_eq!(bench.chip.registers.read(address), before & !lost);
    }
}

#[test]
fn the_crc_of_several_registers_follows_the_last_of_them() {
    let mut bench = Bench::settled();
    bench.send(&[read(ID, 5)]);
    let mut frame = [0; 21];
    bench.chip.transfer(&mut frame);
    assert!(output_crc_is_right(&CCITT, &frame, 3, 6), "{frame:x?}");
}

/// A frame of 24-bit words with the CRC of what was given behind it, turned wrong by `flip`.
fn with_crc(oracle: &crc::Crc<u16>, words: &[u16], flip: u16) -> Vec<u16> {
    let bytes: Vec<u8> = words.iter().flat_map(|word| [word.to_be_bytes()[0], word.to_be_bytes()[1], 0]).collect();
    let mut frame = words.to_vec();
    frame.push(oracle.checksum(&bytes) ^ flip);
    frame
}

#[test]
fn a_right_input_crc_lets_every_command_through() {
    for (oracle, kind) in [(&CCITT, 0), (&ANSI, MODE_CRC_TYPE)] {
        let mut bench = Bench::settled();
        bench.set(MODE, MODE_DEFAULT | MODE_RX_CRC_EN | kind);
        bench.send(&with_crc(oracle, &[read(ID, 1)], 0));
        assert_eq!(response(&bench.send(&with_crc(oracle, &[write(GAIN1, 1), 0x0033], 0))), ID_VALUE);
        assert_eq!(response(&bench.send(&with_crc(oracle, &[0], 0))), 0x4000 | u16::from(GAIN1) << 7);
        assert_eq!(bench.chip.gain(1), 8);
    }
}

#[test]
fn a_wrong_input_crc_stops_every_command_but_wreg() {
    let mut bench = Bench::settled();
    bench.set(MODE, MODE_DEFAULT | MODE_RX_CRC_EN);
    let null = with_crc(&CCITT, &[0], 0);
    for command in [0x0011, 0x0022, 0x0555, read(ID, 1)] {
        bench.send(&with_crc(&CCITT, &[command], 1));
        assert_eq!(response(&bench.send(&null)), 0x0500 | STATUS_CRC_ERR, "{command:#06x}");
        assert_eq!(response(&bench.send(&null)), 0x0500, "output once, CRC_ERR is gone");
    }
    assert!(bench.chip.is_converting());
    bench.send(&with_crc(&CCITT, &[write(CFG, 1), 0x0610], 0x8000));
    assert_eq!(response(&bench.send(&null)), 0x0500 | STATUS_CRC_ERR);
    assert_eq!(bench.chip.peek(CFG.into()), 0x0610, "the word was written all the same");
}

#[test]
fn a_frame_cut_before_its_input_crc_is_a_crc_error() {
    let mut bench = Bench::settled();
    bench.set(MODE, MODE_DEFAULT | MODE_RX_CRC_EN);
    bench.exchange(&[0x0022], 1);
    assert!(bench.chip.is_converting());
    assert_eq!(response(&bench.send(&with_crc(&CCITT, &[0], 0))), 0x0500 | STATUS_CRC_ERR);
}

// Word length

#[test]
fn data_fit_the_word_length() {
    // A code with a pattern in its low byte: -0x12_3456.
    let volts = -f32::from(0x12_34u16) * 256.0 * volts_per_count(1) - f32::from(0x56u8) * volts_per_count(1);
    let cases: [(u16, &[u8]); 4] = [
        (0b00, &[0xED, 0xCB]), // 16 bits: the low byte is cut off
        (0b01, &[0xED, 0xCB, 0xAA]),
        (0b10, &[0xED, 0xCB, 0xAA, 0x00]), // 32 bits, zeros behind
        (0b11, &[0xFF, 0xED, 0xCB, 0xAA]), // 32 bits, sign in front
    ];
    for (wlength, expected) in cases {
        let mut bench = Bench::settled();
        bench.set(MODE, (MODE_DEFAULT & !MODE_WLENGTH) | wlength << 8);
        (0..3).for_each(|_| {
            bench.chip.convert([volts; 2]);
        });
        bench.chip.transfer(&mut vec![0; 4 * expected.len()]);
        let mut frame = vec![0; 4 * expected.len()];
        bench.chip.transfer(&mut frame);
        assert_eq!(frame[expected.len()..2 * expected.len()], *expected, "WLENGTH {wlength:#04b}");
        assert_eq!(u16::from_be_bytes([frame[0], frame[1]]) & MODE_WLENGTH, wlength << 8, "STATUS shows it");
    }
}

// Filter and codes

#[test]
fn after_a_sync_the_filter_settles_in_exactly_three_conversions() {
    let mut bench = Bench::settled();
    let settled = f64::from(HALF_SCALE);
    for part in [1.0 / 6.0, 5.0 / 6.0, 1.0, 1.0] {
        let [code, _] = bench.sample([HALF_SCALE_V; 2]);
        // One count of rounding in f32 at half scale.
        assert!((f64::from(code) - part * settled).abs() <= 1.0, "{code:#x} for {part}");
    }
}

#[test]
fn a_step_of_the_input_settles_in_exactly_three_conversions() {
    let mut bench = Bench::settled();
    (0..3).for_each(|_| {
        bench.sample([HALF_SCALE_V, 0.0]);
    });
    let codes = [(); 3].map(|()| bench.sample([-HALF_SCALE_V, 0.0])[0]);
    assert!(codes[0] > 0 && codes[1] < 0 && codes[1] > -HALF_SCALE + 1000);
    assert!((codes[2] + HALF_SCALE).abs() <= 1);
}

#[test]
fn the_sinc_filter_averages_the_input_the_way_an_accumulator_chain_does() {
    // Oracle: three running sums over OSR samples each of a modulator-rate signal, decimated; here OSR = 64.
    const OSR: usize = 64;
    let levels = [0.0f32, 1.0, -2.0, 0.5, 3.0, -1.0];
    let mut signal: Vec<f64> = levels.iter().flat_map(|&level| [f64::from(level); OSR]).collect();
    for _ in 0..3 {
        let sums: Vec<f64> = (0..signal.len())
            .map(|end| signal[(end + 1).saturating_sub(OSR)..=end].iter().sum::<f64>() / OSR as f64)
            .collect();
        signal = sums;
    }
    let mut bench = Bench::settled();
    for (i, &level) in levels.iter().enumerate() {
        let [code, _] = bench.sample([0.1 * level, 0.0]);
        let expected = 0.1 * signal[(i + 1) * OSR - 1] / f64::from(volts_per_count(1));
        // At a finite OSR the discrete chain differs from the B-spline by order 1/OSR of the largest step, 5 levels.
        let tolerance = 0.1 * 5.0 / OSR as f64 / f64::from(volts_per_count(1));
        assert!((f64::from(code) - expected).abs() < tolerance, "conversion {i}: {code} for {expected}");
    }
}

#[test]
fn the_first_two_conversions_after_a_reset_come_from_the_fast_filter() {
    let mut bench = Bench::new();
    let codes = [HALF_SCALE_V, 0.0, HALF_SCALE_V].map(|volts| bench.sample([volts; 2])[0]);
    assert_eq!(codes[..2], [HALF_SCALE, 0]);
    assert!((codes[2] - HALF_SCALE / 3).abs() <= 1, "the third is sinc³ already: 1/6 + 1/6");
}

#[test]
fn a_reset_brings_the_fast_filter_back() {
    let mut bench = Bench::settled();
    bench.send(&[0x0011]);
    assert_eq!(bench.sample([HALF_SCALE_V; 2]), [HALF_SCALE; 2]);
}

#[test]
fn codes_are_rounded_to_the_nearest() {
    for (counts, expected) in [(0.75, 1), (0.25, 0), (-0.25, 0), (-0.75, -1), (100.6, 101)] {
        assert_eq!(settled_codes(&mut Bench::settled(), [counts * volts_per_count(1); 2]), [expected; 2]);
    }
}

#[test]
fn oversampling_sets_the_rate_and_resynchronises() {
    let rates = [(0, 32_000.0), (1, 16_000.0), (2, 8_000.0), (3, 4_000.0), (4, 2_000.0), (5, 1_000.0), (6, 500.0)];
    for (code, hertz) in rates {
        let mut bench = Bench::settled();
        let clock = 0x0302 | code << 2;
        bench.set(CLOCK, clock);
        assert!((bench.chip.rate_hz() - hertz).abs() < 1e-3);
        assert!((bench.chip.period_ns() as f32 * hertz - 1e9).abs() < 1.0);
        let flag = if clock == CLOCK_DEFAULT { 0 } else { STATUS_F_RESYNC };
        bench.send(&[0]); // the reply to WREG
        assert_eq!(response(&bench.send(&[0])), 0x0500 | flag);
    }
    let mut bench = Bench::settled();
    bench.set(CLOCK, 0x031E);
    assert_eq!((bench.chip.oversampling(), bench.chip.period_ns()), (16_256, 3_968_750));
    bench.set(CLOCK, CLOCK_DEFAULT | CLOCK_TBM);
    assert_eq!((bench.chip.oversampling(), bench.chip.period_ns()), (64, 15_625));
}

#[test]
fn slow_rates_settle_in_two_conversions() {
    for (code, n) in [(4u16, 2i32), (5, 4), (6, 8)] {
        let mut bench = Bench::settled();
        bench.set(CLOCK, 0x0302 | code << 2);
        let [first, second] = [(); 2].map(|()| bench.sample([HALF_SCALE_V; 2])[0]);
        assert!((first - HALF_SCALE / n * (n - 1)).abs() <= 1, "{first:#x}");
        assert!((second - HALF_SCALE).abs() <= 1, "{second:#x}");
    }
}

/// Settled codes of an input at a gain.
fn settled_codes(bench: &mut Bench, volts: [f32; 2]) -> [i32; 2] {
    bench.chip.sync_pulse();
    (0..3).map(|_| bench.sample(volts)).last().unwrap()
}

proptest! {
    #[test]
    fn a_code_is_the_voltage_over_2_4_volts_by_gain_by_2_to_the_24(part in -0.99f32..0.99, gain_log2 in 0u16..8) {
        let mut bench = Bench::settled();
        bench.set(GAIN1, gain_log2 << 4 | gain_log2);
        let volts = part * 1.2 / f32::from(1u8 << gain_log2);
        let codes = settled_codes(&mut bench, [volts, -volts]);
        // f32 holds a code near full scale to half a count, and so do the volts; the filter's sum adds one more.
        prop_assert!((codes[0] as f32 - part * 8_388_608.0).abs() <= 2.0);
        prop_assert!((codes[1] as f32 + part * 8_388_608.0).abs() <= 2.0);
    }

    #[test]
    fn codes_clip_at_both_ends(volts in 1.2001f32..1e6) {
        prop_assert_eq!(settled_codes(&mut Bench::settled(), [volts, -volts]), [0x7F_FFFF, -0x80_0000]);
    }

    #[test]
    fn offset_is_subtracted_before_gain_is_applied(
        code in -4_000_000i32..4_000_000, offset in -4_000_000i32..4_000_000, gain in 0u32..0x100_0000
    ) {
        let mut bench = Bench::settled();
        let (o, g) = ((offset << 8).to_be_bytes(), (gain << 8).to_be_bytes());
        let pair = |b: [u8; 4]| [u16::from_be_bytes([b[0], b[1]]), u16::from_be_bytes([b[2], b[3]])];
        let ([o0, o1], [g0, g1]) = (pair(o), pair(g));
        bench.send(&[write(CH1_CFG + 1, 4), o0, o1, g0, g1]);
        let [plain, corrected] = settled_codes(&mut bench, [code as f32 * volts_per_count(1); 2]);
        let expected = (f64::from(plain - offset) * f64::from(gain) / 8_388_608.0).clamp(-8_388_608.0, 8_388_607.0);
        prop_assert!((f64::from(corrected) - expected).abs() <= 1.0, "{} for {}", corrected, expected);
    }
}

#[test]
fn an_overdriven_channel_recovers_in_three_conversions() {
    let mut bench = Bench::settled();
    settled_codes(&mut bench, [100.0, 0.0]);
    let codes = [(); 3].map(|()| bench.sample([0.0; 2])[0]);
    assert_eq!(codes[2], 0);
}

#[test]
fn each_channel_has_its_own_gain() {
    let mut bench = Bench::settled();
    bench.set(GAIN1, 0x0005);
    assert_eq!((bench.chip.gain(0), bench.chip.gain(1)), (32, 1));
    let codes = settled_codes(&mut bench, [0.01, 0.01]);
    assert!((codes[0] - 32 * codes[1]).abs() <= 32);
}

#[test]
fn a_channel_that_is_off_reads_zero_and_has_no_drdy_bit() {
    let mut bench = Bench::settled();
    bench.set(CLOCK, CLOCK_DEFAULT & !0x0200);
    (0..3).for_each(|_| {
        bench.sample([HALF_SCALE_V; 2]);
    });
    bench.chip.convert([HALF_SCALE_V; 2]);
    let frame = bench.send(&[0]);
    assert_eq!(codes(&frame), [HALF_SCALE, 0]);
    assert_eq!(response(&frame), 0x0500 | STATUS_DRDY0);
}

#[test]
fn with_both_channels_off_nothing_is_converted() {
    let mut bench = Bench::settled();
    bench.set(CLOCK, CLOCK_DEFAULT & !0x0300);
    assert!(!bench.chip.convert([HALF_SCALE_V; 2]));
    assert!(!bench.chip.is_data_ready());
}

#[test]
fn the_multiplexer_shorts_the_input_or_applies_the_test_signal() {
    // 2/15 of full scale, whatever the gain.
    for (mux, expected) in [(1, 0), (2, 1_118_481), (3, -1_118_481)] {
        let mut bench = Bench::settled();
        bench.set(GAIN1, 0x0055);
        bench.set(CH1_CFG, mux);
        let [_, code] = settled_codes(&mut bench, [HALF_SCALE_V; 2]);
        assert!((code - expected).abs() <= 1, "{code} for {expected}");
    }
}

// DRDY and the FIFO

#[test]
fn drdy_falls_with_new_data_and_rises_once_both_channels_are_out() {
    let mut bench = Bench::settled();
    assert!(!bench.chip.is_data_ready());
    assert!(bench.chip.convert([0.0; 2]));
    assert!(bench.chip.is_data_ready());
    bench.exchange(&[0], 2); // response and channel 0 only
    assert!(bench.chip.is_data_ready());
    bench.exchange(&[0], 3); // the CRC need not be read
    assert!(!bench.chip.is_data_ready());
}

#[test]
fn unread_data_do_not_stop_drdy_from_falling_again() {
    let mut bench = Bench::settled();
    assert!((0..5).all(|_| bench.chip.convert([0.0; 2])));
}

/// Lets conversions pass unread: a ramp of 10 mV each, so that a code tells which conversion it is.
fn pause(bench: &mut Bench, conversions: std::ops::Range<i32>) {
    for i in conversions {
        bench.chip.convert([0.01 * i as f32, 0.0]);
    }
}

/// The number of the conversion that a code of the ramp belongs to; the filter is one conversion behind the input.
fn which(code: i32) -> f32 {
    code as f32 * volts_per_count(1) / 0.01 + 1.0
}

#[test]
fn after_a_pause_the_first_read_is_one_sample_stale() {
    let mut bench = Bench::settled();
    pause(&mut bench, 0..20);
    assert!((which(bench.codes()[0]) - 18.0).abs() < 0.01);
    assert!(bench.chip.is_data_ready(), "one more is waiting");
    pause(&mut bench, 20..21);
    assert!((which(bench.codes()[0]) - 19.0).abs() < 0.01, "and it stays stale");
}

#[test]
fn two_reads_after_a_pause_make_the_data_fresh() {
    let mut bench = Bench::settled();
    pause(&mut bench, 0..20);
    bench.codes();
    assert!((which(bench.codes()[0]) - 19.0).abs() < 0.01);
    assert!(!bench.chip.is_data_ready());
    pause(&mut bench, 20..21);
    assert!((which(bench.codes()[0]) - 20.0).abs() < 0.01);
}

#[test]
fn a_sync_pulse_after_a_pause_empties_the_fifo() {
    let mut bench = Bench::settled();
    pause(&mut bench, 0..20);
    bench.chip.sync_pulse();
    assert!(!bench.chip.is_data_ready());
    pause(&mut bench, 20..21);
    bench.codes();
    assert!(!bench.chip.is_data_ready());
}

#[test]
fn reading_without_new_data_repeats_the_last() {
    let mut bench = Bench::settled();
    pause(&mut bench, 0..1);
    pause(&mut bench, 1..2);
    bench.codes();
    let last = bench.codes();
    assert_eq!(bench.codes(), last);
}

proptest! {
    #[test]
    fn the_fifo_gives_the_last_two_conversions_once_each_and_in_order(
        reads in prop::collection::vec(0usize..4, 1..60)
    ) {
        // Oracle: a queue that drops its oldest when a third comes. The fast filter makes each code its own input.
        let mut chip = Chip::new(1);
        chip.set_noise_factor(0.0);
        let mut queue = std::collections::VecDeque::new();
        let mut last = 0;
        for (i, &reads) in (1..).zip(&reads) {
            chip.converter.reset(&chip.registers);
            chip.convert([i as f32 * volts_per_count(1); 2]);
            queue.push_back(i);
            if queue.len() > 2 {
                queue.pop_front();
            }
            for _ in 0..reads {
                prop_assert_eq!(chip.is_data_ready(), !queue.is_empty());
                let mut frame = [0; 12];
                chip.transfer(&mut frame);
                last = queue.pop_front().unwrap_or(last);
                prop_assert_eq!(i32::from(frame[5]), last);
            }
        }
    }
}

#[test]
fn in_pulse_mode_every_second_pulse_is_missing_while_data_are_not_read() {
    let mut bench = Bench::settled();
    bench.set(MODE, MODE_DEFAULT | MODE_DRDY_FMT);
    let unread: Vec<bool> = (0..6).map(|_| bench.chip.convert([0.0; 2])).collect();
    assert_eq!(unread, [true, false, true, false, true, false]);
    assert!(!bench.chip.is_data_ready(), "the level is high between pulses");
    bench.codes();
    bench.codes();
    for _ in 0..4 {
        assert!(bench.chip.convert([0.0; 2]));
        bench.codes();
    }
}

#[test]
fn a_stuck_converter_repeats_its_codes_with_a_right_crc() {
    let mut bench = Bench::settled();
    let before = settled_codes(&mut bench, [0.3, -0.2]);
    bench.chip.set_stuck(true);
    assert_eq!(bench.sample([0.9, 0.9]), before);
    bench.chip.set_stuck(false);
    assert_ne!(bench.sample([0.9, 0.9]), before);
}

// Standby and pins

#[test]
fn standby_stops_conversions_until_wakeup() {
    let mut bench = Bench::settled();
    assert_eq!(bench.ask(&[0x0022]), 0x0022);
    assert!(!bench.chip.convert([HALF_SCALE_V; 2]) && !bench.chip.is_data_ready());
    assert_eq!(bench.ask(&[0x0033]), 0x0033);
    let [code, _] = bench.sample([HALF_SCALE_V; 2]);
    assert!((code - HALF_SCALE / 6).abs() <= 1, "the filter starts anew");
}

#[test]
fn wakeup_does_nothing_while_converting() {
    let mut bench = Bench::settled();
    settled_codes(&mut bench, [HALF_SCALE_V; 2]);
    bench.ask(&[0x0033]);
    assert!((bench.sample([HALF_SCALE_V; 2])[0] - HALF_SCALE).abs() <= 1);
}

#[test]
fn a_sync_pulse_sets_a_flag_that_is_cleared_when_status_is_output() {
    let mut bench = Bench::settled();
    bench.chip.sync_pulse();
    assert_eq!(response(&bench.send(&[0])), 0x0500 | STATUS_F_RESYNC);
    assert_eq!(response(&bench.send(&[0])), 0x0500);
}

#[test]
fn a_gain_change_restarts_the_filter() {
    let mut bench = Bench::settled();
    settled_codes(&mut bench, [0.01; 2]);
    bench.set(GAIN1, 0x0055);
    let codes = [(); 3].map(|()| bench.sample([0.01; 2])[0]);
    assert!((codes[0] * 6 - codes[2]).abs() <= 6 && (codes[1] * 6 - codes[2] * 5).abs() <= 6);
}

#[test]
fn the_reset_pin_restores_every_register() {
    let mut bench = Bench::settled();
    bench.set(GAIN1, 0x0077);
    bench.ask(&[0x0555]);
    bench.chip.reset_pulse();
    assert_eq!(response(&bench.send(&[read(GAIN1, 1)])), 0xFF22);
    assert_eq!(response(&bench.send(&[0])), 0);
    assert_eq!(bench.ask(&[0]), 0x0500);
}

// Noise

/// Codes of a channel whose input is shorted, at a gain and an oversampling code.
fn noise_codes(gain_code: u16, osr_code: u16, n: usize) -> Vec<[f64; 2]> {
    let mut bench = Bench::settled();
    bench.chip.set_noise_factor(1.0);
    bench.set(GAIN1, gain_code << 4 | gain_code);
    bench.set(CLOCK, 0x0302 | osr_code << 2);
    (0..n).map(|_| bench.sample([0.0; 2]).map(f64::from)).collect()
}

/// Mean product of a sequence with itself `lag` later.
fn autocovariance(codes: &[[f64; 2]], channel: usize, lag: usize) -> f64 {
    let pairs = codes.iter().zip(&codes[lag..]);
    pairs.map(|(a, b)| a[channel] * b[channel]).sum::<f64>() / (codes.len() - lag) as f64
}

/// Samples of noise that each test looks at.
const NOISE_SAMPLES: usize = 100_000;
/// Relative standard deviation of an rms estimated from them: √((1 + 2·0.394² + 2·0.015²) / 2n).
const RMS_ERROR: f64 = 0.00256;

#[test]
fn noise_is_that_of_the_datasheet_at_4_ksps() {
    // Datasheet, µV rms at 4 kSPS: gains 1, 8, 16, 32, 64, 128.
    for (gain_code, published_uv) in [(0, 5.35), (3, 2.70), (4, 1.82), (5, 1.20), (6, 1.20), (7, 1.20)] {
        let codes = noise_codes(gain_code, 3, NOISE_SAMPLES);
        let lsb_uv = 1e6 * f64::from(volts_per_count(1 << gain_code));
        for channel in 0..2 {
            let rms_uv = autocovariance(&codes, channel, 0).sqrt() * lsb_uv;
            // Five standard deviations of the estimate: one failure in 300 000 seeds for all twelve together.
            assert!((rms_uv / published_uv - 1.0).abs() < 5.0 * RMS_ERROR, "{rms_uv} µV, gain code {gain_code}");
        }
    }
}

#[test]
fn slower_rates_have_the_noise_of_the_datasheet() {
    // Datasheet, µV rms at gain ≥ 32. The model derives these from 4 kSPS by averaging coloured noise.
    for (osr_code, published_uv) in [(4, 1.00), (5, 0.77), (7, 0.42)] {
        let codes = noise_codes(5, osr_code, NOISE_SAMPLES);
        let rms_uv = autocovariance(&codes, 0, 0).sqrt() * 1e6 * f64::from(volts_per_count(32));
        // The table has two digits, and at 250 SPS 1/f noise, which is not modelled, shows.
        assert!((rms_uv / published_uv - 1.0).abs() < 0.06, "{rms_uv} µV for {published_uv} µV");
    }
}

#[test]
fn noise_has_the_colour_of_a_sinc3_filter() {
    let codes = noise_codes(5, 3, NOISE_SAMPLES);
    let variance = autocovariance(&codes, 0, 0);
    for (lag, expected) in [(1, 26.0 / 66.0), (2, 1.0 / 66.0), (3, 0.0), (10, 0.0)] {
        let correlation = autocovariance(&codes, 0, lag) / variance;
        // Bartlett: standard deviation at most √((1 + 2·0.394² + …)/n) = 0.0036; five of them.
        assert!((correlation - expected).abs() < 0.018, "{correlation} at lag {lag}");
    }
}

#[test]
fn averaging_4_ksps_data_gives_the_published_noise_at_1_ksps() {
    // The reason for the colour: white noise of 1.20 µV would average to 0.60 µV, the datasheet says 0.77 µV.
    let codes = noise_codes(5, 3, NOISE_SAMPLES);
    let means = codes.chunks_exact(4).map(|four| four.iter().map(|c| c[0]).sum::<f64>() / 4.0);
    let rms = (means.map(|mean| mean * mean).sum::<f64>() / (NOISE_SAMPLES / 4) as f64).sqrt();
    let rms_uv = rms * 1e6 * f64::from(volts_per_count(32));
    assert!((rms_uv / 0.77 - 1.0).abs() < 0.03, "{rms_uv} µV");
}

#[test]
fn the_channels_have_independent_noise() {
    let codes = noise_codes(5, 3, NOISE_SAMPLES);
    let rms = |channel| autocovariance(&codes, channel, 0).sqrt();
    let product = codes.iter().map(|c| c[0] * c[1]).sum::<f64>() / NOISE_SAMPLES as f64;
    // Standard deviation √(1.31 / n) = 0.0036; five of them.
    assert!((product / rms(0) / rms(1)).abs() < 0.018);
}

#[test]
fn a_saturated_code_sits_still_in_the_noise() {
    let mut bench = Bench::settled();
    bench.chip.set_noise_factor(1.0);
    settled_codes(&mut bench, [2.0, -2.0]);
    assert!((0..1000).all(|_| bench.sample([2.0, -2.0]) == [0x7F_FFFF, -0x80_0000]));
}

// The chip with four channels

/// A chip of four channels after one reset, and one frame of six words with these bytes going out; what comes in, in hex.
fn four_channels(chip: &mut Chip, words: &[u16]) -> std::string::String {
    let mut bytes: Vec<u8> = words.iter().flat_map(|word| [word.to_be_bytes()[0], word.to_be_bytes()[1], 0]).collect();
    bytes.resize(18, 0);
    chip.wait(PAUSE_NS);
    chip.transfer(&mut bytes);
    bytes.iter().map(|byte| std::format!("{byte:02x}")).collect()
}

#[test]
fn four_channels_have_frames_of_six_words() {
    // Contents by hand from the family's description; CRCs by Python's `binascii.crc_hqx(bytes, 0xFFFF)`.
    let mut chip = Chip::with(Channels::Four, 1);
    chip.set_noise_factor(0.0);
    assert_eq!(four_channels(&mut chip, &[read(ID, 1)]), "ff2400000000000000000000000000dcfe00");
    assert_eq!(four_channels(&mut chip, &[read(CLOCK, 1)]), "248200000000000000000000000000e9d900");
    assert_eq!(four_channels(&mut chip, &[write(GAIN1, 1), 0x7777]), "0f0e00000000000000000000000000f11d00");
    four_channels(&mut chip, &[read(GAIN1, 1)]);
    assert_eq!(four_channels(&mut chip, &[write(GAIN1, 1), 0]), "777700000000000000000000000000cf4200");
    chip.sync_pulse();
    four_channels(&mut chip, &[0]);
    four_channels(&mut chip, &[0]);
    // A half, a quarter, minus a half, an eighth of the range, once the filter has settled.
    for _ in 0..3 {
        chip.convert([0.6, 0.3, -0.6, 0.15]);
    }
    // Three conversions, of which the memory holds two: the older one goes first.
    four_channels(&mut chip, &[0]);
    assert_eq!(four_channels(&mut chip, &[0]), "050f00400000200000c00000100000670f00");
}

#[test]
fn data_of_four_channels_are_read_once_all_of_them_are_out() {
    let mut chip = Chip::with(Channels::Four, 1);
    four_channels(&mut chip, &[0]);
    chip.sync_pulse();
    chip.convert([0.1; 4]);
    chip.transfer(&mut [0; 12]);
    assert!(chip.is_data_ready(), "after three channels");
    chip.transfer(&mut [0; 15]);
    assert!(!chip.is_data_ready(), "after four");
}

#[test]
fn a_reset_of_four_channels_needs_six_words() {
    let mut chip = Chip::with(Channels::Four, 1);
    four_channels(&mut chip, &[write(GAIN1, 1), 0x1234]);
    chip.transfer(&mut [0, 0x11, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!([chip.peek(GAIN1.into()), u16::from(chip.gain(3))], [0x1234, 2]);
    four_channels(&mut chip, &[0x0011]);
    assert_eq!(chip.peek(GAIN1.into()), 0);
    assert!(four_channels(&mut chip, &[0]).starts_with("ff24"));
}

#[test]
fn only_four_channels_have_registers_for_channels_2_and_3() {
    for (channels, last, gain) in [(Channels::Two, 0, 0x0077), (Channels::Four, 0x8000, 0x7777)] {
        let mut chip = Chip::with(channels, 1);
        four_channels(&mut chip, &[write(GAIN1, 1), 0xFFFF]);
        assert_eq!((chip.peek(GAIN1.into()), chip.peek(0x1B)), (gain, last), "{channels:?}");
    }
}
