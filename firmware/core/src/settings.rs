//! How the front-end can be set, and which rate a serial line carries.
//!
//! Errors: none; what is not possible is `None`.

use palpate_shared::frame::FRAME_MAX;
use palpate_shared::front_ends::FRONT_ENDS;
use palpate_shared::wire::BLOCK_SAMPLES;

/// Largest frame of a block, in bytes, delimiter included: 79 of payload, 4 of CRC, 1 of COBS, 1 delimiter.
pub const BLOCK_FRAME_BYTES_MAX: u32 = 85;

const _: () = assert!(BLOCK_FRAME_BYTES_MAX as usize <= FRAME_MAX + 1);

/// Largest frame of a block's mean force, in bytes, delimiter included: 25 of payload.
pub const FORCE_FRAME_BYTES_MAX: u32 = 31;

/// What is sent with each block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WithBlocks {
    /// Nothing.
    Nothing,
    /// The mean force over its samples.
    Forces,
}

impl WithBlocks {
    /// Bytes of a block's frame and of this, at most.
    const fn frame_bytes(self) -> u32 {
        match self {
            Self::Nothing => BLOCK_FRAME_BYTES_MAX,
            Self::Forces => BLOCK_FRAME_BYTES_MAX + FORCE_FRAME_BYTES_MAX,
        }
    }
}

/// Samples in a full block.
const SAMPLES_PER_BLOCK: u32 = 8;

const _: () = assert!(SAMPLES_PER_BLOCK as usize == BLOCK_SAMPLES);

/// Bits on a serial line for each byte: start, eight, stop.
const LINE_BITS_PER_BYTE: u32 = 10;

/// Part of the line kept for replies and events, as its inverse: one twentieth of what the blocks take.
///
/// With it 921600 baud carries 8 kHz (92 % of the line in the worst case) and 115200 baud 1 kHz.
pub(crate) const HEADROOM_INVERSE: u32 = 20;

/// Oversampling ratio of the slowest rate.
const SLOWEST_OVERSAMPLING: u32 = FRONT_ENDS[0].oversampling[1];

/// Fastest rate as a power of two above the slowest.
const FASTEST_LOG2: u8 = 4;

// The rates and gains here are those of every front-end so far; the first one with others makes `Rate` or `Gain` take
// them from its row of the table.
const _: () = {
    let mut at = 0;
    while at < FRONT_ENDS.len() {
        let [fastest, slowest] = FRONT_ENDS[at].oversampling;
        assert!(slowest == SLOWEST_OVERSAMPLING && fastest << FASTEST_LOG2 == slowest);
        assert!(FRONT_ENDS[at].gain_largest == Gain::LARGEST.factor());
        at += 1;
    }
};

/// Nanoseconds in a second.
const NS_PER_S: u64 = 1_000_000_000;

/// The clock at the converter's CLKIN pin. All rates are divided from it.
///
/// ```
/// use palpate_firmware_core::{ConverterClock, Rate};
/// let crystals = ConverterClock::from_hz(8_000_000).expect("near enough to nominal");
/// assert_eq!(Rate::on(crystals).map(Rate::hz).collect::<Vec<_>>(), [7813, 3906, 1953, 977, 488]);
/// assert_eq!(ConverterClock::from_hz(4_096_000), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ConverterClock {
    hz: u32,
}

impl ConverterClock {
    /// 8.192 MHz, which gives round rates.
    pub const NOMINAL: Self = Self { hz: 8_192_000 };

    /// Slowest clock, in Hz: 5 % below nominal, as far as the steps of the built-in simulation follow it.
    const SLOWEST_HZ: u32 = 7_782_400;

    /// Fastest clock that the converter takes, in Hz (SBAS950B, "Recommended operating conditions", high resolution).
    const FASTEST_HZ: u32 = 8_400_000;

    /// A clock of so many hertz; `None` beyond 7.7824 to 8.4 MHz.
    #[must_use]
    pub const fn from_hz(hz: u32) -> Option<Self> {
        if Self::SLOWEST_HZ <= hz && hz <= Self::FASTEST_HZ { Some(Self { hz }) } else { None }
    }

    /// Its frequency, in Hz.
    #[must_use]
    pub const fn hz(self) -> u32 {
        self.hz
    }
}

/// A sample rate of the front-end.
///
/// ```
/// use palpate_firmware_core::{ConverterClock, Rate};
/// assert_eq!(Rate::from_hz(4000, ConverterClock::NOMINAL).map(Rate::period_ns), Some(250_000));
/// assert_eq!(Rate::from_hz(3000, ConverterClock::NOMINAL), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Rate {
    /// Power of two above the slowest, at most [`FASTEST_LOG2`].
    log2: u8,
    clock: ConverterClock,
}

impl Rate {
    /// 4 kHz or near it: what a device starts with, where its line carries it.
    const DEFAULT_LOG2: u8 = 3;

    /// Every rate that this clock gives, fastest first.
    pub fn on(clock: ConverterClock) -> impl Iterator<Item = Self> {
        (0..=FASTEST_LOG2).rev().map(move |log2| Self { log2, clock })
    }

    /// The slowest rate that this clock gives: 500 Hz at the nominal one.
    #[must_use]
    pub const fn slowest(clock: ConverterClock) -> Self {
        Self { log2: 0, clock }
    }

    /// The fastest rate that this clock gives: 8 kHz at the nominal one.
    #[must_use]
    pub const fn fastest(clock: ConverterClock) -> Self {
        Self { log2: FASTEST_LOG2, clock }
    }

    /// The rate that a device with this clock starts with, where its line carries it: 4 kHz at the nominal one.
    #[must_use]
    pub const fn usual(clock: ConverterClock) -> Self {
        Self { log2: Self::DEFAULT_LOG2, clock }
    }

    /// The rate of `hz` samples a second, rounded to whole ones, if this clock gives it.
    #[must_use]
    pub fn from_hz(hz: u32, clock: ConverterClock) -> Option<Self> {
        Self::on(clock).find(|rate| rate.hz() == hz)
    }

    /// Cycles of the converter's clock for each sample.
    const fn cycles(self) -> u32 {
        2 * self.oversampling()
    }

    /// Conversions of the converter's modulator for each sample.
    #[must_use]
    pub const fn oversampling(self) -> u32 {
        SLOWEST_OVERSAMPLING >> self.log2
    }

    /// Samples a second, Hz, rounded.
    #[must_use]
    pub const fn hz(self) -> u32 {
        (self.clock.hz + self.cycles() / 2) / self.cycles()
    }

    /// Time between samples, in ns, rounded; exact for every rate of the nominal clock.
    #[must_use]
    pub fn period_ns(self) -> u32 {
        let product = u64::from(self.cycles()) * NS_PER_S;
        let hz = u64::from(self.clock.hz);
        // 2.1 ms at most.
        u32::try_from((product + hz / 2) / hz).unwrap_or(u32::MAX)
    }

    /// Whether a line of so many baud carries this rate in the worst case; 0 baud has no limit.
    #[must_use]
    pub fn fits_line(self, link_baud: u32, with: WithBlocks) -> bool {
        let bits_per_block = with.frame_bytes() * LINE_BITS_PER_BYTE;
        let blocks = self.hz() / SAMPLES_PER_BLOCK;
        let needed = blocks * bits_per_block + blocks * bits_per_block / HEADROOM_INVERSE;
        link_baud == 0 || needed <= link_baud
    }

    /// The fastest rate that a line of so many baud carries, if it carries any.
    #[must_use]
    pub fn fastest_on_line(link_baud: u32, clock: ConverterClock, with: WithBlocks) -> Option<Self> {
        Self::on(clock).find(|rate| rate.fits_line(link_baud, with))
    }
}

/// A gain of the front-end's amplifiers: 1, 2, 4 … 128.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gain {
    /// The gain is two to this power, at most 7.
    log2: u8,
}

impl Gain {
    /// 32: as little input noise as 128, with four times the range (datasheet's noise table).
    pub const DEFAULT: Self = Self { log2: 5 };
    /// 128, the largest.
    pub const LARGEST: Self = Self { log2: 7 };

    /// This gain, if the front-end has it.
    #[must_use]
    pub fn from_factor(factor: u8) -> Option<Self> {
        (0..=Self::LARGEST.log2).map(|log2| Self { log2 }).find(|gain| gain.factor() == factor)
    }

    /// How much it amplifies.
    #[must_use]
    pub const fn factor(self) -> u8 {
        1 << self.log2
    }

    /// The power of two that it is.
    #[must_use]
    pub const fn log2(self) -> u16 {
        self.log2 as u16
    }
}

/// Rate and gain, the same for both channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceSettings {
    /// Sampling rate of both channels.
    pub rate: Rate,
    /// Gain of both channels' amplifiers.
    pub gain: Gain,
}

impl DeviceSettings {
    /// What a device starts with: gain 32, and 4 kHz (or what its converter's clock makes of it) or the fastest rate
    /// below it that the line carries.
    #[must_use]
    pub fn at_start(link_baud: u32, clock: ConverterClock) -> Self {
        let fastest = Rate::fastest_on_line(link_baud, clock, WithBlocks::Nothing);
        let rate = fastest.unwrap_or(Rate::slowest(clock)).min(Rate::usual(clock));
        Self { rate, gain: Gain::DEFAULT }
    }
}

#[cfg(test)]
mod tests {
    use palpate_shared::frame::encode;
    use palpate_shared::units::{Counts, DeviceTime, Seq};
    use palpate_shared::wire::{Block, FrameBuffer, FromDevice, MeanForce, Status};

    use super::*;

    #[test]
    fn the_largest_block_takes_as_many_bytes_as_the_constant_says() {
        let samples = [[Counts::MIN, Counts::MAX]; BLOCK_SAMPLES].into_iter().collect();
        let (first, time, status) = (Seq(u32::MAX), DeviceTime(u32::MAX), Status(u16::MAX));
        let message = FromDevice::Block(Block { first, time, status, samples });
        let mut line: FrameBuffer = [0; FRAME_MAX + 1];
        assert_eq!(encode(&message, &mut line).unwrap().len(), BLOCK_FRAME_BYTES_MAX as usize);
    }

    #[test]
    fn the_largest_force_takes_as_many_bytes_as_the_constant_says() {
        let (first, time, status) = (Seq(u32::MAX), DeviceTime(u32::MAX), Status(u16::MAX));
        let force = MeanForce { first, time, samples: 8, status, force_un: [i32::MIN; 2] };
        let mut line: FrameBuffer = [0; FRAME_MAX + 1];
        assert_eq!(encode(&FromDevice::Force(force), &mut line).unwrap().len(), FORCE_FRAME_BYTES_MAX as usize);
    }

    #[test]
    fn rates_have_the_datasheets_oversampling_ratios() {
        // f_CLKIN / 2 / OSR with 8.192 MHz.
        for (hz, ratio) in [(8000, 512), (4000, 1024), (2000, 2048), (1000, 4096), (500, 8192)] {
            let rate = Rate::from_hz(hz, ConverterClock::NOMINAL).unwrap();
            assert_eq!((rate.hz(), 8_192_000 / 2 / ratio), (hz, hz));
            assert_eq!(rate.oversampling(), ratio);
            assert_eq!(u64::from(rate.period_ns()) * u64::from(hz), 1_000_000_000);
        }
        for hz in [0, 1, 250, 499, 3999, 16_000, u32::MAX] {
            assert_eq!(Rate::from_hz(hz, ConverterClock::NOMINAL), None, "{hz}");
        }
    }

    #[test]
    fn rates_follow_the_converters_clock() {
        // By hand, at 8 MHz: 2 · 1024 cycles of 125 ns.
        let clock = ConverterClock::from_hz(8_000_000).unwrap();
        let rate = Rate::usual(clock);
        assert_eq!((rate.hz(), rate.period_ns(), rate.oversampling()), (3906, 256_000, 1024));
        assert_eq!((Rate::slowest(clock).hz(), Rate::fastest(clock).hz()), (488, 7813));
        assert_eq!((Rate::from_hz(3906, clock), Rate::from_hz(4000, clock)), (Some(rate), None));
        assert_eq!(DeviceSettings::at_start(921_600, clock).rate, rate);
        for hz in [0, 4_096_000, 7_782_399, 8_400_001, 16_000_000, u32::MAX] {
            assert_eq!(ConverterClock::from_hz(hz), None, "{hz}");
        }
    }

    #[test]
    fn gains_are_the_powers_of_two_to_128() {
        let gains: std::vec::Vec<u8> = (0..=255).filter(|&factor| Gain::from_factor(factor).is_some()).collect();
        assert_eq!(gains, [1, 2, 4, 8, 16, 32, 64, 128]);
        assert_eq!(Gain::from_factor(32).map(Gain::log2), Some(5));
    }

    #[test]
    fn lines_carry_what_their_bits_allow() {
        // By hand: 85 bytes · 10 bits · rate / 8 · 1.05.
        let with = |with, baud| Rate::fastest_on_line(baud, ConverterClock::NOMINAL, with).map(Rate::hz);
        let fastest = |baud| with(WithBlocks::Nothing, baud);
        // 116 bytes: 1218 kbit/s at 8 kHz, 609 at 4 kHz.
        assert_eq!(
            [0, 921_600, 115_200].map(|baud| with(WithBlocks::Forces, baud)),
            [Some(8000), Some(4000), Some(500)]
        );
        assert_eq!([0, 892_500, 921_600, 892_499].map(fastest), [Some(8000), Some(8000), Some(8000), Some(4000)]);
        assert_eq!([115_200, 57_600, 9600, 1].map(fastest), [Some(1000), Some(500), None, None]);
        assert_eq!(
            [0, 921_600, 115_200, 9600].map(|baud| DeviceSettings::at_start(baud, ConverterClock::NOMINAL).rate.hz()),
            [4000, 4000, 1000, 500]
        );
    }
}
