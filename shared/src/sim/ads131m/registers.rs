//! The chip's registers: addresses, reset values, what can be written.
//!
//! Implements: register map of the ADS131M02 (SBAS853A) and, with two more channels, of the ADS131M04 as the maker's header
//! for the family has it (ads131m0x.h, 2019); addresses and reset values checked against the maps of the siblings
//! ADS131M03 (SBAS889A, table 8-12) and AMC131M02 (SBASA56, table 8-13).
//! Errors: none. Reading an address that does not exist gives 0; writing one changes nothing and says so.

use super::Channels;

/// Identity: 2 and the number of channels in the high byte, reserved in the low byte. Read-only.
pub const ID: u8 = 0x00;
/// Status word, with a flag for each thing to know. Read-only.
pub const STATUS: u8 = 0x01;
/// Settings of the interface: word length and checksums.
pub const MODE: u8 = 0x02;
/// Channel enables, oversampling ratio, power mode.
pub const CLOCK: u8 = 0x03;
/// Gain of all channels.
pub const GAIN1: u8 = 0x04;
/// Global chop and current detection (stored, without effect in this model).
pub const CFG: u8 = 0x06;
/// First of five registers of channel 0: CFG, OCAL_MSB, OCAL_LSB, GCAL_MSB, GCAL_LSB.
pub const CH0_CFG: u8 = 0x09;
/// First of five registers of channel 1; those of channels 2 and 3 follow.
pub const CH1_CFG: u8 = 0x0E;
/// CRC over the settings. Read-only.
pub const REGMAP_CRC: u8 = 0x3E;

/// Identity word of the chip with two channels. The reserved low byte is not zero, so that a driver that compares it fails in a test.
pub const ID_VALUE: u16 = 0x2282;

/// STATUS: the interface is locked.
pub const STATUS_LOCK: u16 = 1 << 15;
/// STATUS: the filter was resynchronised since STATUS was last output.
pub const STATUS_F_RESYNC: u16 = 1 << 14;
/// STATUS: an input CRC was wrong since STATUS was last output.
pub const STATUS_CRC_ERR: u16 = 1 << 12;
/// STATUS: channel 1 has data that were not read.
pub const STATUS_DRDY1: u16 = 1 << 1;
/// STATUS: channel 0 has data that were not read.
pub const STATUS_DRDY0: u16 = 1;

/// MODE: compute the CRC of the settings.
pub const MODE_REG_CRC_EN: u16 = 1 << 13;
/// MODE: expect a CRC after every command.
pub const MODE_RX_CRC_EN: u16 = 1 << 12;
/// MODE and STATUS: ANSI polynomial instead of CCITT.
pub const MODE_CRC_TYPE: u16 = 1 << 11;
/// MODE and STATUS: a reset happened; write 0 to MODE to clear.
pub const MODE_RESET: u16 = 1 << 10;
/// MODE and STATUS: word length, two bits.
pub const MODE_WLENGTH: u16 = 0b11 << 8;
/// MODE: DRDY as a short pulse instead of a level.
pub const MODE_DRDY_FMT: u16 = 1;

/// CLOCK: turbo, oversampling ratio 64.
pub const CLOCK_TBM: u16 = 1 << 5;

/// Most channels that a chip has.
pub(super) const CHANNELS_MAX: usize = 4;

/// Number of addresses from 0 to the last register of channel 3.
const COUNT: usize = 0x1D;

/// Addresses of one channel.
const CHANNEL_COUNT: u8 = CH1_CFG - CH0_CFG;

/// The first address of each channel.
const CHANNEL_FIRST: [u8; CHANNELS_MAX] = [CH0_CFG, CH1_CFG, CH0_CFG + 2 * CHANNEL_COUNT, CH0_CFG + 3 * CHANNEL_COUNT];

/// Values after a reset, by address.
const RESET_VALUES: [u16; COUNT] = [
    ID_VALUE, 0x0500, 0x0510, 0x030E, 0x0000, 0x0000, 0x0600, 0x0000, 0x0000, // ID … THRSHLD_LSB
    0x0000, 0x0000, 0x0000, 0x8000, 0x0000, // channel 0
    0x0000, 0x0000, 0x0000, 0x8000, 0x0000, // channel 1
    0x0000, 0x0000, 0x0000, 0x8000, 0x0000, // channel 2
    0x0000, 0x0000, 0x0000, 0x8000, 0x0000, // channel 3
];

/// Bits that can be written, by address; the reserved ones read as after a reset.
const WRITABLE: [u16; COUNT] = [
    0x0000, 0x0000, 0x3F1F, 0x033F, 0x0077, 0x0000, 0x1FFF, 0xFFFF, 0xFF0F, // ID … THRSHLD_LSB
    0xFFC7, 0xFFFF, 0xFF00, 0xFFFF, 0xFF00, // channel 0
    0xFFC7, 0xFFFF, 0xFF00, 0xFFFF, 0xFF00, // channel 1
    0xFFC7, 0xFFFF, 0xFF00, 0xFFFF, 0xFF00, // channel 2
    0xFFC7, 0xFFFF, 0xFF00, 0xFFFF, 0xFF00, // channel 3
];

/// The stored registers. STATUS and REGMAP_CRC are not stored: the chip makes them when they are read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Registers {
    words: [u16; COUNT],
    /// Addresses that this chip has.
    count: usize,
    /// A bit for each channel.
    channels: u16,
}

impl Registers {
    /// The registers after a reset.
    pub(super) fn new(channels: Channels) -> Self {
        let mut registers = Self {
            words: RESET_VALUES,
            count: COUNT - usize::from(CHANNEL_COUNT) * (CHANNELS_MAX - channels.count()),
            channels: channels.bits(),
        };
        registers.words[usize::from(ID)] = ID_VALUE & 0xF0FF | channels.number() << 8;
        registers.words[usize::from(CLOCK)] |= channels.bits() << 8;
        registers
    }

    /// The bits that can be written at an address, if there is such an address.
    fn writable(&self, address: u8) -> Option<u16> {
        let mask = WRITABLE.get(..self.count)?.get(usize::from(address)).copied()?;
        Some(match address {
            CLOCK => mask | self.channels << 8,
            GAIN1 if self.channels > 0b11 => mask | 0x7700,
            _ => mask,
        })
    }

    /// The word at an address, 0 where there is none.
    pub(super) fn read(&self, address: u8) -> u16 {
        let words = self.words.get(..self.count).unwrap_or_default();
        words.get(usize::from(address)).copied().unwrap_or(0)
    }

    /// Stores a word and tells whether there was anything to write at that address.
    ///
    /// MODE's RESET bit can only be cleared.
    pub(super) fn write(&mut self, address: u8, value: u16) -> bool {
        let index = usize::from(address);
        let Some(mask) = self.writable(address) else { return false };
        let Some(word) = self.words.get_mut(index) else { return false };
        let wanted = if address == MODE { value & (*word | !MODE_RESET) } else { value };
        *word = (*word & !mask) | (wanted & mask);
        mask != 0
    }

    /// Words in the order of their addresses from MODE on, over which the CRC of the settings is taken.
    pub(super) fn settings(&self) -> &[u16] {
        self.words.get(usize::from(MODE)..self.count).unwrap_or_default()
    }

    /// Whether a bit of MODE is set.
    pub(super) fn mode(&self, bit: u16) -> bool {
        self.read(MODE) & bit != 0
    }

    /// Oversampling ratio, CLOCK bits 4:2, or 64 in turbo mode.
    pub(super) fn oversampling(&self) -> u32 {
        let clock = self.read(CLOCK);
        match (clock >> 2) & 0b111 {
            _ if clock & CLOCK_TBM != 0 => 64,
            0b111 => 16_256,
            code => 128 << code,
        }
    }

    /// Exponent of a channel's gain: gain is 2 to this power, 0 to 7.
    pub(super) fn gain_log2(&self, channel: usize) -> u8 {
        (self.read(GAIN1) >> (4 * channel)).to_le_bytes()[0] & 0b111
    }

    /// Whether a channel converts.
    pub(super) fn is_enabled(&self, channel: usize) -> bool {
        (self.read(CLOCK) >> (8 + channel)) & 1 != 0
    }

    /// A channel's input multiplexer: 0 pins, 1 shorted, 2 positive, 3 negative test signal.
    pub(super) fn input(&self, channel: usize) -> u16 {
        self.channel(channel, 0) & 0b11
    }

    /// A channel's offset correction, two's complement codes.
    pub(super) fn offset(&self, channel: usize) -> i32 {
        let raw = u32::from(self.channel(channel, 1)) << 16 | u32::from(self.channel(channel, 2));
        raw.cast_signed() >> 8
    }

    /// A channel's gain correction; 0x80_0000 is 1.
    pub(super) fn gain_correction(&self, channel: usize) -> u32 {
        u32::from(self.channel(channel, 3)) << 8 | u32::from(self.channel(channel, 4)) >> 8
    }

    /// One of a channel's five registers.
    fn channel(&self, channel: usize, index: u8) -> u16 {
        let first = CHANNEL_FIRST[channel.min(CHANNELS_MAX - 1)];
        self.read(index + first)
    }
}
