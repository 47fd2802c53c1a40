//! Driver of the ADS131M02 and the ADS131M04, converters with two and with four channels at once.
//!
//! A frame goes both ways at each transfer: out goes a command, in comes the response to the *previous*
//! frame's command and the newest unread codes of all channels. Reading samples and reading registers
//! therefore share the same frames, and no sample is lost to a register access.
//!
//! Implements: TI SBAS853A (ADS131M02), sections on frames, commands and registers. SPI mode 1, words of 24
//! bits, 4 words in a frame: `response | channel 0 | channel 1 | CRC` in, `command | CRC | 0 | 0` out
//! (`command | value | CRC | 0` for a write). The ADS131M04 has two words more, of channels 2 and 3, which this driver
//! sets to gain 1: its slow channels. Both CRCs are CRC-16/CCITT with seed FFFF.
//! Assumes: chip select is driven by the [`SpiDevice`], which can also wait with chip select high ([`DelayNs`]); 12
//! bytes take far less than a conversion. Where the datasheet leaves open when the chip does something, both ways will
//! do: see [`Frame::is_new`] and `reset_transaction`; the tests run on a model of each.
//! Errors: [`Error`]; nothing panics, nothing waits.
//!
//! ```
//! use palpate_firmware_core::{ConverterClock, DeviceSettings, ads131m::{Ads131m02, Command}};
//! # use core::cell::RefCell;
//! # use palpate_shared::sim::{FingerConfig, SimulatedFrontEnd, SpiPort};
//! # let front_end = RefCell::new(SimulatedFrontEnd::new(FingerConfig::default(), 1));
//! # let spi = SpiPort::new(&front_end);
//! let mut chip = Ads131m02::new(spi);
//! assert_eq!(chip.init(DeviceSettings::at_start(921_600, ConverterClock::NOMINAL))? >> 8, 0x22); // two channels
//! # front_end.borrow_mut().step();
//! // At each falling edge of DRDY:
//! let frame = chip.read_frame(Command::Null)?;
//! assert!(frame.counts[0].0.abs() < 8_388_608);
//! # Ok::<(), palpate_firmware_core::ads131m::Error<palpate_shared::sim::PortBusy>>(())
//! ```

use crc::{CRC_16_CMS, CRC_16_IBM_3740, Crc, NoTable};
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{Operation, SpiDevice};
use palpate_shared::front_ends::FrontEndKind;
use palpate_shared::units::Counts;

use crate::front_end::{Answer, Ask, FrontEnd, Reading, Registers, SelectSource, Trouble};
use crate::settings::{DeviceSettings, Rate};

/// Addresses of the registers used.
pub mod register {
    /// Identity: 22 or 24 in the upper byte, the number of channels in its lower digit.
    pub const ID: u8 = 0x00;
    /// Status word; also the response to a NULL command.
    pub const STATUS: u8 = 0x01;
    /// CRCs, word length, data-ready pin.
    pub const MODE: u8 = 0x02;
    /// Channels on, oversampling ratio, power.
    pub const CLOCK: u8 = 0x03;
    /// Gains of all channels.
    pub const GAIN1: u8 = 0x04;
    /// The last address that a command can name.
    pub const LAST: u8 = 0x3F;
}

/// Response of the ADS131M02 to the RESET command, and to anything first after a reset; its last digit is the number of
/// channels.
pub const RESET_DONE: u16 = 0xFF22;

/// STATUS: the interface is locked.
const STATUS_LOCK: u16 = 1 << 15;
/// STATUS: the last command's CRC was wrong, so it was not carried out (a write was all the same).
const STATUS_CRC_ERROR: u16 = 1 << 12;
/// STATUS: CRCs with the other polynomial.
const STATUS_CRC_TYPE: u16 = 1 << 11;
/// STATUS: the chip was reset since MODE was last written.
const STATUS_RESET: u16 = 1 << 10;
/// STATUS: length of a word.
const STATUS_WORD_LENGTH: u16 = 0b11 << 8;
/// STATUS: words of 24 bits.
const STATUS_24_BIT: u16 = 0b01 << 8;
/// STATUS: a bit for each channel whose codes were not read yet; those of channels that are not there are always 0.
const STATUS_DATA_READY: u16 = 0xFF;

/// MODE as this driver writes it: input CRC on, no reset seen, 24-bit words, SPI time-out on.
const MODE_VALUE: u16 = 1 << 12 | 0b01 << 8 | 1 << 4;

/// CLOCK without its oversampling ratio and channels: high resolution.
const CLOCK_BASE: u16 = 0b10;

/// Bytes of the part of a frame that holds a command, its value and its checksum: a whole frame of the ADS131M02.
pub const FRAME_BYTES: usize = palpate_shared::wire::RAW_FRAME_BYTES;

/// Bytes of a word.
const WORD_BYTES: usize = 3;

/// Bytes of the longest frame, that of four channels.
const FRAME_BYTES_MAX: usize = WORD_BYTES * (4 + 2);

/// Pause after a reset, in ns, once with chip select low and once with it high: twice the datasheet's t_REGACQ of 5 µs.
const AFTER_RESET_NS: u32 = 10_000;

/// Times that [`Ads131m02::init`] goes through its steps before it gives up.
///
/// A damaged bit spoils one pass in a hundred at one error in 10⁵ bits, far above any usable bus.
const INIT_TRIES: u8 = 3;

/// CRC-16/CCITT, seed FFFF: a table of 512 bytes.
static CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_IBM_3740);

/// Bytes of a frame of four channels in the longest words.
const RESET_BYTES_MAX: usize = 4 * (4 + 2);

/// RESET in every word length and with both CRCs, for a chip whose MODE register is not what it should be.
const RESETS: [[u8; RESET_BYTES_MAX]; 6] = [
    reset_frame::<2>(&Crc::<u16, NoTable>::new(&CRC_16_CMS)),
    reset_frame::<2>(&Crc::<u16, NoTable>::new(&CRC_16_IBM_3740)),
    reset_frame::<4>(&Crc::<u16, NoTable>::new(&CRC_16_CMS)),
    reset_frame::<4>(&Crc::<u16, NoTable>::new(&CRC_16_IBM_3740)),
    reset_frame::<3>(&Crc::<u16, NoTable>::new(&CRC_16_CMS)),
    reset_frame::<3>(&Crc::<u16, NoTable>::new(&CRC_16_IBM_3740)),
];

/// A RESET command in words of `WORD` bytes, long enough for a whole frame of any length.
const fn reset_frame<const WORD: usize>(crc: &Crc<u16, NoTable>) -> [u8; RESET_BYTES_MAX] {
    let mut word = [0; WORD];
    [word[0], word[1]] = Command::Reset.word().to_be_bytes();
    let mut frame = [0; RESET_BYTES_MAX];
    [frame[0], frame[1]] = Command::Reset.word().to_be_bytes();
    [frame[WORD], frame[WORD + 1]] = crc.checksum(&word).to_be_bytes();
    frame
}

/// What a frame asks the chip to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Nothing; the response is the STATUS register.
    Null,
    /// Forget all settings and start again.
    Reset,
    /// Take commands again after a LOCK.
    Unlock,
    /// Read the register at this address; only its lower six bits count.
    Read(u8),
    /// Write the register at this address; only its lower six bits count.
    Write(u8, u16),
}

impl Command {
    /// The 16 bits that name the command.
    const fn word(self) -> u16 {
        match self {
            Self::Null => 0x0000,
            Self::Reset => 0x0011,
            Self::Unlock => 0x0655,
            Self::Read(address) => 0xA000 | field(address),
            Self::Write(address, _) => 0x6000 | field(address),
        }
    }

    /// What the next frame's response is if a write was carried out at this address.
    pub(crate) const fn write_done(address: u8) -> u16 {
        0x4000 | field(address)
    }

    /// The bytes that go out.
    fn frame(self) -> [u8; FRAME_BYTES] {
        let value = if let Self::Write(_, value) = self { Some(value) } else { None };
        frame_of(self.word(), value)
    }
}

/// The frame of any command word, and of the one value that follows it, if any: with its checksum, in words of 24 bits.
///
/// ```
/// use palpate_firmware_core::ads131m::frame_of;
/// assert_eq!(frame_of(0xA000, None), [0xA0, 0x00, 0, 0x71, 0x00, 0, 0, 0, 0, 0, 0, 0]); // read the ID register
/// ```
#[must_use]
pub fn frame_of(command: u16, value: Option<u16>) -> [u8; FRAME_BYTES] {
    let mut frame = [0; FRAME_BYTES];
    [frame[0], frame[1]] = command.to_be_bytes();
    if let Some(value) = value {
        [frame[3], frame[4]] = value.to_be_bytes();
        [frame[6], frame[7]] = CRC.checksum(&frame[..6]).to_be_bytes();
    } else {
        [frame[3], frame[4]] = CRC.checksum(&frame[..3]).to_be_bytes();
    }
    frame
}

/// Whether a frame of the ADS131M02 that came in, in words of 24 bits, has the checksum of its response and codes.
#[must_use]
pub fn has_its_checksum(bytes: &[u8; FRAME_BYTES]) -> bool {
    checksum_fits(bytes)
}

/// Whether the last word of a frame is the checksum of those before.
fn checksum_fits(frame: &[u8]) -> bool {
    let (data, checksum) = frame.split_at(frame.len() - WORD_BYTES);
    CRC.checksum(data).to_be_bytes() == checksum[..2]
}

/// An address where commands have it.
const fn field(address: u8) -> u16 {
    ((address & register::LAST) as u16) << 7
}

/// What came in with one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// The command that the response answers: the previous frame's.
    pub answers: Command,
    /// The 16 bits of the response.
    pub response: u16,
    /// Codes of the bridges' channels.
    pub counts: [Counts; 2],
    /// Codes of channels 2 and 3, on a chip that has them.
    pub slow: Option<[Counts; 2]>,
}

impl Frame {
    /// Whether STATUS says that the codes had not been read before; `None` unless the response is STATUS.
    ///
    /// Set bits prove unread codes. Clear ones do so only in a frame that follows another at once: a chip may look at
    /// them when the frame before ends, and then a conversion's own frame has them clear. The datasheet does not say.
    #[must_use]
    pub fn is_new(&self) -> Option<bool> {
        let all = self.ready_bits();
        (self.answers == Command::Null).then_some(self.response & all == all)
    }

    /// STATUS of the chip that sent it while all channels have unread codes.
    fn ready_bits(&self) -> u16 {
        if self.slow.is_some() { 0b1111 } else { 0b11 }
    }

    /// STATUS: bits that are always 0 on the chip that sent it.
    fn reserved_bits(&self) -> u16 {
        STATUS_DATA_READY & !self.ready_bits()
    }

    /// Whether the chip says that the previous command came damaged.
    #[must_use]
    pub fn tells_input_damage(&self) -> bool {
        match self.answers {
            Command::Null => self.response & STATUS_CRC_ERROR != 0,
            _ => self.may_be_refusal(),
        }
    }

    /// Whether a register's value may as well be the STATUS register after a damaged command.
    fn may_be_refusal(&self) -> bool {
        const SHAPE: u16 = STATUS_CRC_ERROR | STATUS_LOCK | STATUS_CRC_TYPE | STATUS_RESET | STATUS_WORD_LENGTH;
        self.response & (SHAPE | self.reserved_bits()) == STATUS_CRC_ERROR | STATUS_24_BIT
    }

    /// What it answers to the command before, as the sampler's requests take it.
    fn answer(&self) -> Answer {
        match self.answers {
            Command::Null | Command::Reset | Command::Unlock => Answer::None,
            Command::Write(address, _) if self.response == Command::write_done(address) => Answer::Written,
            Command::Write(..) => Answer::NotWritten,
            Command::Read(_) if self.may_be_refusal() => Answer::Doubtful(self.response),
            Command::Read(_) => Answer::Value(self.response),
        }
    }

    /// Whether the chip cannot have the settings that it was given: it was reset, or a damaged write
    /// went astray. Its codes then say nothing.
    #[must_use]
    pub fn tells_lost_settings(&self) -> bool {
        const SHAPE: u16 = STATUS_LOCK | STATUS_CRC_TYPE | STATUS_RESET | STATUS_WORD_LENGTH;
        match self.answers {
            _ if self.response == reset_done(self.ready_bits()) => true,
            Command::Null => self.response & (SHAPE | self.reserved_bits()) != STATUS_24_BIT,
            Command::Write(address, _) => is_write_done(self.response) && self.response != Command::write_done(address),
            // Two damaged bits make a write of a read, and one a read of several registers, whose words then
            // stand in the place of the codes. A chip with its settings carries out no damaged read.
            Command::Read(address) => {
                self.response == Command::write_done(address) || is_several_registers(self.response)
            }
            Command::Reset | Command::Unlock => false,
        }
    }
}

/// Whether a response acknowledges some write.
fn is_write_done(response: u16) -> bool {
    response >> 13 == 0b010
}

/// Whether a response announces several registers; none that this driver reads or leaves as it was holds
/// such a value.
fn is_several_registers(response: u16) -> bool {
    response >> 13 == 0b111
}

/// The response after a reset, of the chip with as many channels as there are bits.
const fn reset_done(channel_bits: u16) -> u16 {
    if channel_bits == 0b11 { RESET_DONE } else { 0xFF24 }
}

/// Why the front-end did not do what it should.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error<E> {
    /// The SPI bus reported an error.
    Bus(E),
    /// What came in is damaged, or nothing answers; `response` is its first word.
    Checksum {
        /// The first word of the frame.
        response: u16,
    },
    /// The chip sends words of 16 bits: a damaged write changed its settings.
    WordLength {
        /// The first word of the frame.
        response: u16,
    },
    /// The ID register names another chip.
    OtherChip {
        /// The 16 bits of the ID register.
        id_word: u16,
    },
    /// The chip did not acknowledge a reset.
    NotReset {
        /// The 16 bits that it responded.
        response: u16,
    },
    /// A register does not hold what was written.
    NotSet {
        /// Address of the register.
        address: u8,
        /// The raw 16 bits that it holds instead.
        value: u16,
    },
}

impl<E> Error<E> {
    /// The word that was read where something else was expected; all ones if the bus itself failed.
    #[must_use]
    pub fn word(&self) -> u16 {
        match *self {
            Self::Bus(_) => u16::MAX,
            Self::Checksum { response } | Self::WordLength { response } | Self::NotReset { response } => response,
            Self::OtherChip { id_word } => id_word,
            Self::NotSet { value, .. } => value,
        }
    }
}

/// The ADS131M02 behind its bus.
pub type Ads131m02<Spi> = Ads131m<Spi, 2>;

/// The ADS131M04 behind its bus.
pub type Ads131m04<Spi> = Ads131m<Spi, 4>;

/// A chip of two or four channels behind its bus.
#[derive(Debug)]
pub struct Ads131m<Spi, const CHANNELS: usize> {
    spi: Spi,
    /// The command whose response comes next.
    previous: Command,
}

impl<Spi, const CHANNELS: usize> Ads131m<Spi, CHANNELS> {
    /// Which chip it drives.
    const KIND: FrontEndKind = match CHANNELS {
        2 => FrontEndKind::Ads131m02,
        4 => FrontEndKind::Ads131m04,
        _ => panic!("no chip of this driver has so many channels"),
    };

    /// Bytes of a frame.
    const FRAME: usize = Self::KIND.facts().frame_bytes as usize;

    /// Bits of as many channels.
    const CHANNEL_BITS: u16 = (1 << CHANNELS) - 1;

    /// Its response after a reset.
    const RESET_DONE: u16 = reset_done(Self::CHANNEL_BITS);

    /// A driver that has not touched the chip yet.
    pub const fn new(spi: Spi) -> Self {
        Self { spi, previous: Command::Null }
    }

    /// The SPI bus that the chip is on.
    pub fn spi(&self) -> &Spi {
        &self.spi
    }

    /// The bus, to switch what is behind it.
    pub fn spi_mut(&mut self) -> &mut Spi {
        &mut self.spi
    }

    /// Gives the bus back.
    pub fn release(self) -> Spi {
        self.spi
    }
}

impl<Spi: SpiDevice + DelayNs, const CHANNELS: usize> Ads131m<Spi, CHANNELS> {
    /// Exchanges one frame: sends a command, gets the previous one's response and a sample.
    ///
    /// # Errors
    /// [`Error::Bus`], [`Error::Checksum`] and [`Error::WordLength`]; whether the command arrived is then unknown.
    pub fn read_frame(&mut self, command: Command) -> Result<Frame, Error<Spi::Error>> {
        let answers = core::mem::replace(&mut self.previous, command);
        let mut bytes = padded(command.frame());
        self.spi.transfer_in_place(&mut bytes[..Self::FRAME]).map_err(Error::Bus)?;
        parse::<CHANNELS, _>(answers, &bytes)
    }

    /// Exchanges one frame whose bytes are the caller's, and gives what came in, unchecked. On a chip with longer frames
    /// zeros go out after them, and what comes in then is left out.
    ///
    /// What it made of the chip is not known afterwards: [`Self::init`] puts that right.
    ///
    /// # Errors
    /// [`Error::Bus`].
    pub fn exchange_raw(&mut self, bytes: [u8; FRAME_BYTES]) -> Result<[u8; FRAME_BYTES], Error<Spi::Error>> {
        // Whatever comes in response to it was not asked for by this driver.
        self.previous = Command::Reset;
        let mut frame = padded(bytes);
        self.spi.transfer_in_place(&mut frame[..Self::FRAME]).map_err(Error::Bus)?;
        let mut received = [0; FRAME_BYTES];
        received.copy_from_slice(&frame[..FRAME_BYTES]);
        Ok(received)
    }

    /// Resets the chip, checks that it is the right one, writes its settings and reads them back.
    ///
    /// Returns the ID register. Leaves no unread samples behind, so that the next data-ready edge
    /// announces a sample which the next frame brings. Takes 16 frames, or several times that on a
    /// damaged bus.
    ///
    /// # Errors
    /// Any [`Error`]: the last try's.
    pub fn init(&mut self, settings: DeviceSettings) -> Result<u16, Error<Spi::Error>> {
        let mut result = self.init_once(settings);
        for _ in 1..INIT_TRIES {
            if result.is_ok() {
                break;
            }
            self.reset_whatever_its_mode()?;
            result = self.init_once(settings);
        }
        result
    }

    /// Writes rate and gain and reads them back, without a reset.
    ///
    /// # Errors
    /// Any [`Error`] but [`Error::OtherChip`] and [`Error::NotReset`].
    pub fn configure(&mut self, settings: DeviceSettings) -> Result<(), Error<Spi::Error>> {
        let [clock, gain] = setting_words(settings, Self::CHANNEL_BITS);
        self.write_register(register::CLOCK, clock)?;
        self.write_register(register::GAIN1, gain)
    }

    /// Reads a register with two frames of its own; the samples in them are lost.
    ///
    /// # Errors
    /// As [`Self::read_frame`].
    pub fn read_register(&mut self, address: u8) -> Result<u16, Error<Spi::Error>> {
        self.read_frame(Command::Read(address))?;
        Ok(self.read_frame(Command::Null)?.response)
    }

    /// Writes a register and reads it back, with three frames of its own.
    ///
    /// # Errors
    /// As [`Self::read_frame`], and [`Error::NotSet`].
    pub fn write_register(&mut self, address: u8, value: u16) -> Result<(), Error<Spi::Error>> {
        self.read_frame(Command::Write(address, value))?;
        let reply = self.read_frame(Command::Read(address))?.response;
        let read = self.read_frame(Command::Null)?.response;
        // A damaged write may have gone to another register; the reply names the one it went to.
        let is_done = reply == Command::write_done(address) && read == value;
        if is_done { Ok(()) } else { Err(Error::NotSet { address, value: read }) }
    }

    /// Reads the ID register and checks it.
    ///
    /// # Errors
    /// As [`Self::read_frame`], and [`Error::OtherChip`].
    pub fn id(&mut self) -> Result<u16, Error<Spi::Error>> {
        let id_word = self.read_register(register::ID)?;
        if id_word >> 8 == u16::from(Self::KIND.facts().id_high) {
            Ok(id_word)
        } else {
            Err(Error::OtherChip { id_word })
        }
    }

    /// Resets the chip; it then has none of its settings.
    ///
    /// # Errors
    /// As [`Self::read_frame`], and [`Error::NotReset`].
    pub fn reset(&mut self) -> Result<(), Error<Spi::Error>> {
        // Another program may have left the chip locked; it would not take the reset.
        self.read_frame(Command::Unlock)?;
        self.previous = Command::Reset;
        let mut bytes = padded(Command::Reset.frame());
        self.reset_transaction(&mut bytes[..Self::FRAME])?;
        let response = self.read_frame(Command::Null)?.response;
        if response == Self::RESET_DONE { Ok(()) } else { Err(Error::NotReset { response }) }
    }

    /// Reads both places of the chip's memory for samples, so that the next one read is new.
    ///
    /// # Errors
    /// As [`Self::read_frame`].
    pub fn discard_samples(&mut self) -> Result<(), Error<Spi::Error>> {
        self.read_frame(Command::Null)?;
        self.read_frame(Command::Null)?;
        Ok(())
    }

    /// One pass of [`Self::init`].
    fn init_once(&mut self, settings: DeviceSettings) -> Result<u16, Error<Spi::Error>> {
        self.reset()?;
        let id_word = self.id()?;
        self.write_register(register::MODE, MODE_VALUE)?;
        self.configure(settings)?;
        self.discard_samples()?;
        Ok(id_word)
    }

    /// Sends a reset that a chip understands whatever a damaged write made of its MODE register.
    fn reset_whatever_its_mode(&mut self) -> Result<(), Error<Spi::Error>> {
        self.previous = Command::Reset;
        // A copy of each: what comes in replaces what goes out.
        RESETS.into_iter().try_for_each(|mut frame| self.reset_transaction(&mut frame[..4 * (CHANNELS + 2)]))
    }

    /// Sends a frame that resets, and pauses.
    ///
    /// The reset is "latched at the end of the frame": with its last clock or when chip select rises. So the pause is
    /// made twice, before that rise and after it.
    fn reset_transaction(&mut self, bytes: &mut [u8]) -> Result<(), Error<Spi::Error>> {
        let mut operations = [Operation::TransferInPlace(bytes), Operation::DelayNs(AFTER_RESET_NS)];
        let result = self.spi.transaction(&mut operations).map_err(Error::Bus);
        self.spi.delay_ns(AFTER_RESET_NS);
        result
    }
}

impl<Spi: SpiDevice + DelayNs + SelectSource, const CHANNELS: usize> FrontEnd for Ads131m<Spi, CHANNELS> {
    type Bus = Spi;

    const KIND: FrontEndKind = Self::KIND;

    const REGISTERS: Registers = Registers {
        id: register::ID,
        mode: register::MODE,
        rate: register::CLOCK,
        gain: register::GAIN1,
        status: register::STATUS,
        mode_word: MODE_VALUE,
    };

    fn bus(&self) -> &Spi {
        &self.spi
    }

    fn bus_mut(&mut self) -> &mut Spi {
        &mut self.spi
    }

    fn initialise(&mut self, settings: DeviceSettings) -> Result<u16, Trouble> {
        self.init(settings).map_err(Trouble::from)
    }

    #[inline]
    fn read_frame(&mut self, ask: Ask) -> Result<Reading, Trouble> {
        let command = match ask {
            Ask::Nothing => Command::Null,
            Ask::Read(address) => Command::Read(address),
            Ask::Write(address, value) => Command::Write(address, value),
        };
        let frame = Self::read_frame(self, command).map_err(Trouble::from)?;
        Ok(Reading {
            counts: frame.counts,
            slow: frame.slow,
            is_new: frame.is_new(),
            answer: frame.answer(),
            has_lost_settings: frame.tells_lost_settings(),
            tells_input_damage: frame.tells_input_damage(),
        })
    }

    fn exchange_raw(&mut self, bytes: [u8; FRAME_BYTES]) -> Result<[u8; FRAME_BYTES], Trouble> {
        Self::exchange_raw(self, bytes).map_err(Trouble::from)
    }

    fn setting_words(settings: DeviceSettings) -> [u16; 2] {
        setting_words(settings, Self::CHANNEL_BITS)
    }
}

impl<E> From<Error<E>> for Trouble {
    fn from(error: Error<E>) -> Self {
        Self { word: error.word(), has_lost_settings: matches!(error, Error::WordLength { .. }) }
    }
}

/// CLOCK and GAIN1 for rate and gain, with these channels on; the slow ones have gain 1.
fn setting_words(settings: DeviceSettings, channel_bits: u16) -> [u16; 2] {
    let gain = settings.gain.log2();
    [channel_bits << 8 | CLOCK_BASE | oversampling_code(settings.rate) << 2, gain << 4 | gain]
}

/// The oversampling ratio's code in the CLOCK register: 0 for 128, 1 for 256, and so on.
fn oversampling_code(rate: Rate) -> u16 {
    const LEAST: u32 = 128;
    #[expect(clippy::cast_possible_truncation, reason = "at most 6")]
    let code = (rate.oversampling() / LEAST).trailing_zeros() as u16;
    code
}

/// Takes the bytes of a frame of so many channels apart.
#[inline]
fn parse<const CHANNELS: usize, E>(answers: Command, bytes: &[u8; FRAME_BYTES_MAX]) -> Result<Frame, Error<E>> {
    let [r0, r1, _, a0, a1, a2, b0, b1, b2, c0, c1, c2, d0, d1, d2, ..] = *bytes;
    let response = u16::from_be_bytes([r0, r1]);
    let frame = &bytes[..WORD_BYTES * (CHANNELS + 2)];
    if !checksum_fits(frame) {
        return Err(Error::Checksum { response });
    }
    // A checksum over data and their checksum is 0, and stays so over zeros: what a chip sends in words of
    // 16 bits, with its checksum in the last of them and zeros from there on, always passes the check above.
    // One sound frame in 2²⁴ looks the same, an hour's at 4 kHz: a status that itself says 24 bits is believed.
    let says_24_bits = matches!(answers, Command::Null) && response & STATUS_WORD_LENGTH == STATUS_24_BIT;
    let (short, rest) = frame.split_at(2 * (CHANNELS + 2));
    let is_short = || rest[..rest.len() - 1].iter().all(|&byte| byte == 0) && CRC.checksum(short) == 0;
    if !says_24_bits && is_short() {
        return Err(Error::WordLength { response });
    }
    let slow = (CHANNELS == 4).then(|| [code([c0, c1, c2]), code([d0, d1, d2])]);
    Ok(Frame { answers, response, counts: [code([a0, a1, a2]), code([b0, b1, b2])], slow })
}

/// A frame's bytes, with zeros after them up to the longest one.
fn padded(bytes: [u8; FRAME_BYTES]) -> [u8; FRAME_BYTES_MAX] {
    let mut frame = [0; FRAME_BYTES_MAX];
    frame[..FRAME_BYTES].copy_from_slice(&bytes);
    frame
}

/// A 24-bit two's complement code.
fn code([high, middle, low]: [u8; 3]) -> Counts {
    Counts(i32::from_be_bytes([high, middle, low, 0]) >> 8)
}

// The tests run on every chip that the datasheet allows; `tests/rig/chip.rs` reads which one from the module's name.
#[cfg(test)]
mod four_channels;
#[cfg(test)]
mod tests;
#[cfg(test)]
#[path = "ads131m/tests.rs"]
mod tests_reset_at_last_clock;
#[cfg(test)]
#[path = "ads131m/tests.rs"]
mod tests_status_at_frame_end;
#[cfg(test)]
#[path = "ads131m/tests.rs"]
mod tests_status_at_frame_end_reset_at_last_clock;
