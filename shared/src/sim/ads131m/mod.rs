//! The ADS131M02 and its sibling of four channels, the ADS131M04: simultaneous 24-bit ΔΣ converters behind an SPI bus,
//! as the bus sees them. What is said of two channels below holds for four, in frames of six words.
//!
//! A state machine with two inputs: [`Chip::convert`] tells it that one conversion period has passed and what the
//! pins had on average, and [`Chip::select`], [`Chip::exchange`], [`Chip::deselect`] are the bus, byte for byte.
//!
//! Its parts: [`registers`], `frame` (the bus, byte by byte) and `converter` (the analogue half).
//!
//! Implements: SBAS853A (ADS131M02) where its text could be had, else that of the siblings ADS131M03 (SBAS889A),
//! ADS131M08 (SBAS950B) and AMC131M02 (SBASA56), which share frames, commands and registers:
//! - frames: `response | channel 0 | channel 1 | CRC`, the response being to the frame before; words of 16, 24 or
//!   32 bits; output CRC always, input CRC by MODE.RX_CRC_EN; CCITT or ANSI polynomial, start value FFFF;
//! - commands NULL, RESET (needs a full frame), STANDBY, WAKEUP, LOCK, UNLOCK, RREG and WREG of any length; a wrong
//!   input CRC stops every command but WREG, whose words take effect as they are shifted in;
//! - the register map with its reset values, read-only and reserved bits, offset and gain correction applied;
//! - the frame that gives out several registers takes no command (stated for the related ADS131B26-Q1, and
//!   reported for the ADS131M03 in TI's forum, thread 1333317): it is answered like NULL;
//! - a two-deep FIFO: data are gone once both channels are shifted out; whoever lets one conversion pass reads data
//!   one conversion old from then on, until two frames are read between two conversions or SYNC is pulsed;
//! - DRDY: low while unread data are there (it pulses high before each new fall); with MODE.DRDY_FMT a short pulse,
//!   every second one missing while data are not read.
//!
//! Where the text is silent and a driver might come to rely on either, [`Behaviour`] says which way the model goes; a
//! driver has to work with all of them: when STATUS is latched, at which moment a frame's RESET takes place.
//!
//! Where the text is silent the model does this: CRC_ERR and F_RESYNC clear once STATUS is output; a change of OSR,
//! turbo or gain resynchronises but keeps the FIFO; the CRC of the settings runs over addresses 02 to 12 and is 0
//! while MODE.REG_CRC_EN is 0; a frame cut before its input CRC counts as a CRC error; WREG that writes no register
//! replies as if m were −1 in seven bits.
//!
//! Not modelled: the start-up time t_POR, SPI clock limits and time-out, power modes, channel phase,
//! DC block, global chop, current detection, corrupted settings (REG_MAP stays 0).
//! Units: volts, nanoseconds. Errors: none; a chip has no way to report one but STATUS.
//!
//! ```
//! use palpate_shared::sim::ads131m::Chip;
//! let mut chip = Chip::new(1);
//! let mut frame = [0xA0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]; // RREG of ID; its answer comes in the next frame
//! chip.transfer(&mut frame);
//! assert_eq!(frame[..2], [0xFF, 0x22]); // the answer to the reset at power-up
//! frame = [0; 12];
//! chip.transfer(&mut frame);
//! assert_eq!(frame[0], 0x22); // two channels
//! ```

mod behaviour;
mod converter;
mod frame;
pub mod registers;

pub use behaviour::{Behaviour, Channels, ResetMoment, StatusLatch};
pub use converter::{noise_rms, volts_per_count};

use converter::Converter;
use frame::{Command, Frame, Received, crc16_of_words, polynomial};
use registers::{
    CHANNELS_MAX, CLOCK, GAIN1, MODE, MODE_DRDY_FMT, MODE_REG_CRC_EN, REGMAP_CRC, Registers, STATUS, STATUS_CRC_ERR,
    STATUS_F_RESYNC, STATUS_LOCK,
};

use crate::units::Counts;

/// Frequency of the clock pin, in hertz, where no other is set: the chip's nominal 8.192 MHz.
pub const CLKIN_HZ: u32 = 8_192_000;

/// Nanoseconds that 128 cycles of the clock pin (64 of the modulator) take at the nominal frequency, exactly; every
/// conversion period is a multiple.
const PERIOD_OF_64_NS: u32 = 15_625;

/// Shortest low time on SYNC/RESET that resets, in nanoseconds: 2048 clocks.
pub const RESET_PULSE_NS: u64 = 250_000;

/// What the next frame begins with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reply {
    /// This word, then data.
    Word(u16),
    /// One register, then data. NULL is answered with STATUS.
    Register(u8),
    /// An acknowledgement and several registers instead of data.
    Registers { address: u8, count: u8 },
}

/// The chip's two-deep memory of conversions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Fifo {
    /// Oldest first; the first one is what a frame gives out, even after it was read.
    slots: [[Counts; CHANNELS_MAX]; 2],
    unread: u8,
}

impl Fifo {
    /// Adds a conversion; the oldest makes room.
    fn push(&mut self, codes: [Counts; CHANNELS_MAX]) {
        self.slots = match self.unread {
            0 => [codes, codes],
            1 => [self.slots[0], codes],
            _ => [self.slots[1], codes],
        };
        self.unread = (self.unread + 1).min(2);
    }

    /// Forgets the oldest conversion.
    fn pop(&mut self) {
        self.slots[0] = self.slots[1];
        self.unread = self.unread.saturating_sub(1);
    }
}

/// The converter chip, seen from its pins.
#[derive(Clone, Debug, PartialEq)]
pub struct Chip {
    channels: Channels,
    registers: Registers,
    converter: Converter,
    fifo: Fifo,
    /// The conversion last made, for a converter that is stuck.
    last: [Counts; CHANNELS_MAX],
    stuck: bool,
    frame: Option<Frame>,
    reply: Reply,
    locked: bool,
    standby: bool,
    crc_error: bool,
    resynchronised: bool,
    /// With DRDY_FMT set: the next pulse is lost because the last data were not read.
    pulse_lost: bool,
    behaviour: Behaviour,
    /// Whether unread data were there when the last frame ended.
    ready_at_end: bool,
    /// Nanoseconds that 64 modulator clocks take.
    period_of_64_ns: u32,
    /// Time for which a reset still keeps the chip from its bus, in nanoseconds.
    acquiring_ns: u32,
}

impl Chip {
    /// A chip of two channels just powered up. The seed determines its noise.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self::with(Channels::Two, seed)
    }

    /// A chip of so many channels, likewise.
    #[must_use]
    pub fn with(channels: Channels, seed: u64) -> Self {
        Self {
            channels,
            registers: Registers::new(channels),
            converter: Converter::new(seed),
            fifo: Fifo::default(),
            last: [Counts(0); CHANNELS_MAX],
            stuck: false,
            frame: None,
            reply: Reply::Word(channels.reset_done()),
            locked: false,
            standby: false,
            crc_error: false,
            resynchronised: false,
            pulse_lost: false,
            behaviour: Behaviour::default(),
            ready_at_end: false,
            period_of_64_ns: PERIOD_OF_64_NS,
            acquiring_ns: 0,
        }
    }

    /// Gives the clock pin another frequency, in hertz. Time is counted in whole nanoseconds for 64 clocks of the
    /// modulator: those of the nominal one and of 8 MHz are.
    pub fn set_clock_hz(&mut self, hz: u32) {
        const PRODUCT: u64 = 128 * 1_000_000_000;
        self.period_of_64_ns = u32::try_from(PRODUCT / u64::from(hz.max(1))).unwrap_or(u32::MAX);
    }

    /// Decides what the datasheet leaves open.
    pub fn set_behaviour(&mut self, behaviour: Behaviour) {
        self.behaviour = behaviour;
    }

    /// Time passes on the bus; that of conversions is counted by [`Chip::convert`].
    pub fn wait(&mut self, duration_ns: u32) {
        self.acquiring_ns = self.acquiring_ns.saturating_sub(duration_ns);
    }

    /// Multiplies the converter's noise, which is the datasheet's at first; 0 switches it off.
    pub fn set_noise_factor(&mut self, factor: f32) {
        self.converter.set_noise_factor(factor);
    }

    /// While set, every conversion repeats the last codes: a converter that hangs while its bus works.
    pub fn set_stuck(&mut self, stuck: bool) {
        self.stuck = stuck;
    }

    /// One conversion period has passed, in which the pins had these voltages on average, by channel; those that are
    /// not told stay 0.
    ///
    /// Returns whether DRDY fell.
    pub fn convert<const N: usize>(&mut self, volts: [f32; N]) -> bool {
        // The shortest period is longer than any start-up of the registers.
        self.acquiring_ns = 0;
        if !self.is_converting() {
            return false;
        }
        let codes = self.converter.convert(volts, &self.registers);
        if !self.stuck {
            self.last = codes;
        }
        let unread = self.fifo.unread > 0;
        self.fifo.push(self.last);
        self.pulse_lost = self.registers.mode(MODE_DRDY_FMT) && unread && !self.pulse_lost;
        !self.pulse_lost
    }

    /// Whether DRDY is low. In pulse mode it is high between conversions; see [`Chip::convert`] for its edges.
    #[must_use]
    pub fn is_data_ready(&self) -> bool {
        self.fifo.unread > 0 && self.is_converting() && !self.registers.mode(MODE_DRDY_FMT)
    }

    /// Whether conversions run: not in standby, and a channel enabled.
    #[must_use]
    pub fn is_converting(&self) -> bool {
        !self.standby && ((0..self.channels.count()).any(|channel| self.registers.is_enabled(channel)))
    }

    /// Oversampling ratio that CLOCK asks for.
    #[must_use]
    pub fn oversampling(&self) -> u32 {
        self.registers.oversampling()
    }

    /// Gain of a channel, 1 to 128. Channels that there are not count as the last.
    #[must_use]
    pub fn gain(&self, channel: usize) -> u8 {
        1 << self.registers.gain_log2(channel.min(self.channels.count() - 1))
    }

    /// Time of one conversion, in nanoseconds: 2 OSR / CLKIN, exactly at the nominal clock.
    #[must_use]
    pub fn period_ns(&self) -> u32 {
        self.oversampling() / 64 * self.period_of_64_ns
    }

    /// Conversions per second, Hz.
    #[must_use]
    pub fn rate_hz(&self) -> f32 {
        1e9 / self.period_ns() as f32
    }

    /// SYNC/RESET was low for less than [`RESET_PULSE_NS`]: restarts the filter and empties the FIFO.
    pub fn sync_pulse(&mut self) {
        self.resynchronise();
        self.fifo = Fifo::default();
    }

    /// SYNC/RESET was low for [`RESET_PULSE_NS`] or longer: everything as after power-up, but for the noise's course.
    pub fn reset_pulse(&mut self) {
        self.reset();
        self.frame = None;
    }

    /// Chip select falls: a frame begins, unless the chip still starts up after a reset.
    pub fn select(&mut self) {
        self.frame = (self.acquiring_ns == 0).then(|| Frame::new(&self.registers, self.fifo.slots[0]));
    }

    /// Eight clocks in a frame: a byte in, a byte out. Without [`Chip::select`] the bus floats high, and so it does
    /// while the chip starts up.
    pub fn exchange(&mut self, byte: u8) -> u8 {
        let Some(mut frame) = self.frame.take() else { return 0xFF };
        if let Some(word) = frame.word_to_load() {
            self.load(&mut frame, word);
        }
        let (out, received) = frame.exchange(byte);
        if let Received::Data { command: Command::Write { address, .. }, index, word } = received {
            frame.written += u16::from(self.write(u16::from(address) + index, word));
        }
        if self.behaviour.reset_at == ResetMoment::LastClock && self.resets_now(&frame) {
            self.reset();
        } else {
            self.frame = Some(frame);
        }
        out
    }

    /// Chip select rises: the frame's command takes effect.
    pub fn deselect(&mut self) {
        let Some(frame) = self.frame.take() else { return };
        if frame.is_empty() {
            return;
        }
        if self.has_data_in_frame() && frame.words() >= self.channels.data_words() {
            self.fifo.pop();
        }
        self.reply = self.execute(&frame);
        self.ready_at_end = self.fifo.unread > 0;
    }

    /// A whole frame, in place: what goes in is replaced by what comes out.
    pub fn transfer(&mut self, bytes: &mut [u8]) {
        self.select();
        for byte in bytes {
            *byte = self.exchange(*byte);
        }
        self.deselect();
    }

    /// Loads the word that goes out at a place in the frame.
    fn load(&mut self, frame: &mut Frame, place: u16) {
        let crc_place = match self.reply {
            Reply::Registers { count, .. } => u16::from(count) + 1,
            _ => self.channels.frame_words() - 1,
        };
        match (place, self.reply) {
            (0, reply) => frame.load(self.response(reply)),
            _ if place == crc_place => frame.load_crc(),
            _ if place > crc_place => frame.load(0),
            (_, Reply::Registers { address, .. }) => frame.load(self.read_at(u16::from(address) + place - 1)),
            _ => frame.load_code(frame.codes[usize::from(place - 1)]),
        }
    }

    /// Whether the frame in progress carries conversion data.
    fn has_data_in_frame(&self) -> bool {
        !matches!(self.reply, Reply::Registers { .. })
    }

    /// The first word of a frame.
    fn response(&mut self, reply: Reply) -> u16 {
        match reply {
            Reply::Word(word) => word,
            Reply::Register(address) => self.read_at(address.into()),
            Reply::Registers { address, count } => 0xE000 | u16::from(address) << 7 | u16::from(count - 1),
        }
    }

    /// A register as it is output. Outputting STATUS clears its flags.
    fn read_at(&mut self, address: u16) -> u16 {
        let word = self.peek(address);
        if address == u16::from(STATUS) {
            self.crc_error = false;
            self.resynchronised = false;
        }
        word
    }

    /// A register's content, without the side effects of outputting it. 0 where there is no register.
    #[must_use]
    pub fn peek(&self, address: u16) -> u16 {
        match u8::try_from(address) {
            Ok(STATUS) => self.status(),
            Ok(REGMAP_CRC) if self.registers.mode(MODE_REG_CRC_EN) => {
                crc16_of_words(polynomial(&self.registers), self.registers.settings())
            }
            Ok(address) => self.registers.read(address),
            Err(_) => 0,
        }
    }

    /// The STATUS word. CRC_TYPE, RESET and WLENGTH stand where they stand in MODE.
    fn status(&self) -> u16 {
        let flag = |on: bool, bit: u16| if on { bit } else { 0 };
        let ready = match self.behaviour.status_latch {
            StatusLatch::FrameStart => self.fifo.unread > 0,
            StatusLatch::FrameEnd => self.ready_at_end,
        };
        self.registers.read(MODE) & 0x0F00
            | flag(self.locked, STATUS_LOCK)
            | flag(self.resynchronised, STATUS_F_RESYNC)
            | flag(self.crc_error, STATUS_CRC_ERR)
            | if ready { self.registers.read(CLOCK) >> 8 & self.channels.bits() } else { 0 }
    }

    /// Writes one word of a WREG command and tells whether there was a register to write.
    fn write(&mut self, address: u16, word: u16) -> bool {
        let Ok(address) = u8::try_from(address) else { return false };
        if self.locked || !self.has_data_in_frame() {
            return false;
        }
        let before = (self.registers.read(CLOCK), self.registers.read(GAIN1));
        let written = self.registers.write(address, word);
        if before != (self.registers.read(CLOCK), self.registers.read(GAIN1)) {
            self.resynchronise();
        }
        written
    }

    /// Carries out a frame's command and gives the reply to it.
    fn execute(&mut self, frame: &Frame) -> Reply {
        let status = Reply::Register(STATUS);
        let Some(command) = frame.command else { return status };
        if frame.crc_expected && frame.crc_is_right != Some(true) {
            self.crc_error = true;
            return status;
        }
        if !self.has_data_in_frame() || self.locked && !command.passes_lock() {
            return status;
        }
        match command {
            Command::Null | Command::Unknown => status,
            Command::Reset if frame.words() < self.channels.frame_words() => Reply::Word(0x0011),
            Command::Reset => self.reset(),
            Command::Standby => self.set_standby(true),
            Command::Wakeup => self.set_standby(false),
            Command::Lock => self.set_lock(true),
            Command::Unlock => self.set_lock(false),
            Command::Read { address, count: 1 } => Reply::Register(address),
            Command::Read { address, count } => Reply::Registers { address, count },
            Command::Write { address, .. } => {
                Reply::Word(0x4000 | u16::from(address) << 7 | frame.written.wrapping_sub(1) & 0x7F)
            }
        }
    }

    /// Whether the frame is a whole one that resets, with what must be right for that.
    fn resets_now(&self, frame: &Frame) -> bool {
        frame.command == Some(Command::Reset)
            && frame.words() >= self.channels.frame_words()
            && (!frame.crc_expected || frame.crc_is_right == Some(true))
            && self.has_data_in_frame()
            && !self.locked
    }

    /// Everything as after power-up, but that the bus has to wait.
    fn reset(&mut self) -> Reply {
        self.registers = Registers::new(self.channels);
        self.converter.reset(&self.registers);
        self.fifo = Fifo::default();
        self.locked = false;
        self.standby = false;
        self.crc_error = false;
        self.resynchronised = false;
        self.ready_at_end = false;
        self.acquiring_ns = self.behaviour.register_acquisition_ns;
        self.reply = Reply::Word(self.channels.reset_done());
        self.reply
    }

    /// Enters or leaves standby; leaving restarts the conversions.
    fn set_standby(&mut self, on: bool) -> Reply {
        if self.standby && !on {
            self.sync_pulse();
        }
        self.standby = on;
        Reply::Word(if on { 0x0022 } else { 0x0033 })
    }

    /// Locks or unlocks the interface.
    fn set_lock(&mut self, on: bool) -> Reply {
        self.locked = on;
        Reply::Word(if on { 0x0555 } else { 0x0655 })
    }

    /// Restarts the filter, and says so in STATUS.
    fn resynchronise(&mut self) {
        self.converter.resynchronise(&self.registers);
        self.resynchronised = true;
    }
}

#[cfg(test)]
mod tests;
