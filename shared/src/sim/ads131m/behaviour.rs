//! What the chip's datasheet leaves open: the moments at which it does something.
//!
//! A driver that works with every value of these works with the chip, whichever it does. What is known of them:
//! the bits of STATUS are said to tell of unread data, not at which moment they are looked at; a RESET is said to be
//! "latched at the end of the frame", not whether that is the last clock or the rise of chip select (SBAS950B, 8.5.1.10.2).
//! Errors: none.

/// How many channels the chip has: which one of its family it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// The ADS131M02.
    #[default]
    Two,
    /// The ADS131M04.
    Four,
}

impl Channels {
    /// Their number.
    #[must_use]
    pub const fn count(self) -> usize {
        self.number() as usize
    }

    /// Their number, as it stands in the chip's words.
    pub(super) const fn number(self) -> u16 {
        match self {
            Self::Two => 2,
            Self::Four => 4,
        }
    }

    /// A bit for each.
    pub(super) const fn bits(self) -> u16 {
        (1 << self.number()) - 1
    }

    /// The response after a reset: FF, and their number.
    pub(super) const fn reset_done(self) -> u16 {
        0xFF20 | self.number()
    }

    /// Words after which all of them are shifted out.
    pub(super) const fn data_words(self) -> u16 {
        self.number() + 1
    }

    /// Words in a frame without register data: response, channels, CRC.
    pub(super) const fn frame_words(self) -> u16 {
        self.number() + 2
    }
}

/// When a frame's STATUS word is put together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StatusLatch {
    /// As the frame begins: a conversion's own frame says that its data are unread.
    #[default]
    FrameStart,
    /// As the frame before ends: a conversion's own frame says that all data were read.
    FrameEnd,
}

/// At which moment of its frame a RESET takes place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ResetMoment {
    /// When chip select rises.
    #[default]
    ChipSelectRise,
    /// With the last clock of the frame's last word; clocks after it are lost.
    LastClock,
}

/// t_REGACQ: what the chip takes after a reset before it answers, in nanoseconds (SBAS950B, 8.5.1.10.2: 5 µs).
const REGISTER_ACQUISITION_NS: u32 = 5000;

/// One way in which a chip may behave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Behaviour {
    /// When STATUS is put together.
    pub status_latch: StatusLatch,
    /// When a RESET takes place.
    pub reset_at: ResetMoment,
    /// Time after a reset in which frames are ignored, in nanoseconds.
    pub register_acquisition_ns: u32,
}

impl Default for Behaviour {
    fn default() -> Self {
        Self {
            status_latch: StatusLatch::default(),
            reset_at: ResetMoment::default(),
            register_acquisition_ns: REGISTER_ACQUISITION_NS,
        }
    }
}

impl Behaviour {
    /// Every combination of the moments.
    pub const ALL: [Self; 4] = [
        Self::of(StatusLatch::FrameStart, ResetMoment::ChipSelectRise),
        Self::of(StatusLatch::FrameStart, ResetMoment::LastClock),
        Self::of(StatusLatch::FrameEnd, ResetMoment::ChipSelectRise),
        Self::of(StatusLatch::FrameEnd, ResetMoment::LastClock),
    ];

    /// With these moments.
    const fn of(status_latch: StatusLatch, reset_at: ResetMoment) -> Self {
        Self { status_latch, reset_at, register_acquisition_ns: REGISTER_ACQUISITION_NS }
    }
}
