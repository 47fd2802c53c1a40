//! What the sampler asks of a converter: the one seam between all that is counted and judged, and a chip.
//!
//! A front-end announces each conversion by an edge, and is read by frames that go both ways: out goes what is asked of
//! it, in come the newest unread codes and the answer to what the *previous* frame asked. A chip without such a pipeline
//! answers from its driver's memory. Which rates, gains and full scale it has is in its row of
//! [`palpate_shared::front_ends::FRONT_ENDS`], which host and device read too.
//!
//! Errors: [`Trouble`].

use palpate_shared::front_ends::{FrontEndFacts, FrontEndKind};
use palpate_shared::units::Counts;
use palpate_shared::wire::{RAW_FRAME_BYTES, Source};

use crate::settings::DeviceSettings;

/// This board has no such source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SourceNotPossible;

/// A bus behind which more than one front-end can be: the chip, or a simulation of it.
///
/// The choice sits below the SPI boundary, so all that reads and checks frames is the same for both.
pub trait SelectSource {
    /// Puts this source behind the bus, from the next transaction on.
    ///
    /// # Errors
    /// [`SourceNotPossible`] if there is no such source; nothing changes then.
    fn select(&mut self, source: Source) -> Result<(), SourceNotPossible>;

    /// Whether the simulation is behind the bus now.
    fn is_simulated(&self) -> bool;

    /// What the board's eight digital inputs read now, a bit for each; the simulation's own while it is behind the bus.
    /// All low on a board without any.
    fn inputs(&self) -> u8 {
        0
    }
}

/// What a frame asks of the front-end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// Nothing but the codes.
    Nothing,
    /// The value of the register at this address.
    Read(u8),
    /// To write the register at this address.
    Write(u8, u16),
}

/// What a frame answers to what the frame before asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Nothing was asked.
    None,
    /// The register's value.
    Value(u16),
    /// The register's value, or as likely a word that says that the question came damaged: to be asked again.
    Doubtful(u16),
    /// The register was written.
    Written,
    /// It is not known which register was written, if any.
    NotWritten,
}

/// What a frame brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// Codes of the two bridges.
    pub counts: [Counts; 2],
    /// Codes of the channels that see excitation and NTC, of a front-end that has them.
    pub slow: Option<[Counts; 2]>,
    /// Whether the codes had not been read before; `None` where the frame does not say. `Some(true)` is proof; `Some(false)`
    /// is proof only in a frame that follows another at once.
    pub is_new: Option<bool>,
    /// The answer to what the frame before asked.
    pub answer: Answer,
    /// The front-end cannot have the settings that it was given; its codes then say nothing.
    pub has_lost_settings: bool,
    /// The frame before came damaged.
    pub tells_input_damage: bool,
}

/// What came in is no good, or nothing came in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trouble {
    /// The word that was read where something else was expected; all ones if the bus itself failed.
    pub word: u16,
    /// It comes from a front-end that cannot have its settings.
    pub has_lost_settings: bool,
}

/// Registers by which the sampler tells a front-end's health.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Registers {
    /// Address of the identity: the kind's number in its upper byte.
    pub id: u8,
    /// Address of what is set the same at all times.
    pub mode: u8,
    /// Address of the rate.
    pub rate: u8,
    /// Address of the gain.
    pub gain: u8,
    /// Address of the status word.
    pub status: u8,
    /// What the register at `mode` holds once initialised.
    pub mode_word: u16,
}

/// A converter of two bridges behind its bus.
pub trait FrontEnd {
    /// What it is reached by.
    type Bus: SelectSource;

    /// Which one it is: its rates, gains and full scale are in this kind's row of the table.
    const KIND: FrontEndKind;

    /// By which registers its health is told.
    const REGISTERS: Registers;

    /// Its row of the table.
    const FACTS: &'static FrontEndFacts = Self::KIND.facts();

    /// Its bus.
    fn bus(&self) -> &Self::Bus;

    /// Its bus, to switch or step what is behind it.
    fn bus_mut(&mut self) -> &mut Self::Bus;

    /// Resets it, checks that it is the right one, writes its settings and reads them back; leaves no unread codes. Gives
    /// its ID word.
    ///
    /// # Errors
    /// [`Trouble`].
    fn initialise(&mut self, settings: DeviceSettings) -> Result<u16, Trouble>;

    /// Exchanges one frame.
    ///
    /// # Errors
    /// [`Trouble`]; whether what was asked arrived is then unknown.
    fn read_frame(&mut self, ask: Ask) -> Result<Reading, Trouble>;

    /// Exchanges one frame whose bytes are the host's, and gives what came in, unchecked.
    ///
    /// # Errors
    /// [`Trouble`], where the bus itself failed.
    fn exchange_raw(&mut self, bytes: [u8; RAW_FRAME_BYTES]) -> Result<[u8; RAW_FRAME_BYTES], Trouble>;

    /// What the registers of rate and gain hold with these settings.
    fn setting_words(settings: DeviceSettings) -> [u16; 2];
}
