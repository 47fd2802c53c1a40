//! Payloads to messages, and what can be told of a newer peer's message that cannot be read.
//!
//! A payload has passed its checksum, so it is what the peer sent. Where it holds a variant with a number beyond those
//! that this version knows, at whatever depth, it is a newer minor version's: [`DecodeError::Unknown`]. What stands
//! behind that number cannot be read. What stands before it can, and [`NewerMessage`] says of it what a host needs:
//! who speaks, and which command was answered. Every other failure is a bug of the peer: [`DecodeError::Malformed`].
//!
//! Errors: [`DecodeError`].

use postcard::de_flavors::Flavor;
use serde::Deserialize;

use super::{Command, CommandId, FromDevice, PROTOCOL, ProtocolVersion, Refusal};
use crate::frame::FrameError;

/// The first byte of a hello in every major version.
const HELLO_BYTE: u8 = 0;

/// Numbers of [`FromDevice`]'s variants.
const HELLO: u32 = HELLO_BYTE as u32;
const BLOCK: u32 = 1;
const EVENT: u32 = 2;
const REPLY: u32 = 3;
const TEMPERATURE: u32 = 4;
const SLOW_CHANNELS: u32 = 5;
const INPUTS: u32 = 6;
const FORCE: u32 = 7;

/// The number of [`super::Outcome::Hello`].
const HELLO_OUTCOME: u32 = 1;

/// Why a payload is not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// The frame is damaged.
    Frame(FrameError),
    /// A message of a newer minor version, or one that says something that only a newer minor version can say.
    Unknown(NewerMessage),
    /// A device of another major version.
    OtherProtocol {
        /// What the device speaks.
        device: ProtocolVersion,
    },
    /// The checksum fits but the contents do not: a bug on the other side.
    Malformed,
}

impl From<FrameError> for DecodeError {
    fn from(error: FrameError) -> Self {
        Self::Frame(error)
    }
}

/// What can be told of a newer minor version's message that cannot be read as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NewerMessage {
    /// A message of a kind that this version does not have.
    Kind {
        /// Number of the kind on the wire.
        variant: u32,
    },
    /// A device that started anew, and describes itself in ways that this version does not know.
    Hello {
        /// What the device speaks.
        device: ProtocolVersion,
    },
    /// An event of a kind that this version does not have.
    Event,
    /// A command was answered, in a way that this version does not know: to repeat it would bring the same answer.
    Reply {
        /// Id of the command that was answered.
        id: CommandId,
        /// What the device speaks, where the answer is a hello.
        device: Option<ProtocolVersion>,
    },
}

impl NewerMessage {
    /// What can be told of `payload`; `None` if it is cut off, or of a kind in which nothing can be newer.
    fn of(payload: &[u8]) -> Option<Self> {
        let (variant, rest) = take::<u32>(payload)?;
        match variant {
            HELLO => take(rest).map(|(device, _)| Self::Hello { device }),
            EVENT => Some(Self::Event),
            REPLY => {
                let ((id, outcome), rest) = take::<(CommandId, u32)>(rest)?;
                let hello = (outcome == HELLO_OUTCOME).then(|| take(rest)).flatten();
                Some(Self::Reply { id, device: hello.map(|(device, _)| device) })
            }
            BLOCK | TEMPERATURE | SLOW_CHANNELS | INPUTS | FORCE => None,
            _ => Some(Self::Kind { variant }),
        }
    }
}

/// The value at the beginning of `bytes`, and the bytes behind it.
fn take<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Option<(T, &'a [u8])> {
    postcard::take_from_bytes(bytes).ok()
}

impl FromDevice {
    /// Reads a message out of a frame's payload.
    ///
    /// ```
    /// use palpate_shared::wire::{CommandId, DecodeError, FromDevice, NewerMessage};
    /// // A reply to command 7 with outcome 200, which this version does not have.
    /// let newer = NewerMessage::Reply { id: CommandId(7), device: None };
    /// assert_eq!(FromDevice::from_payload(&[3, 7, 0xC8, 0x01, 42]), Err(DecodeError::Unknown(newer)));
    /// // A reply that ends within its outcome.
    /// assert_eq!(FromDevice::from_payload(&[3, 7, 2]), Err(DecodeError::Malformed));
    /// ```
    ///
    /// # Errors
    /// [`DecodeError::Unknown`], [`DecodeError::OtherProtocol`] or [`DecodeError::Malformed`].
    pub fn from_payload(payload: &[u8]) -> Result<Self, DecodeError> {
        if let [HELLO_BYTE, major, minor, ..] = *payload
            && major != PROTOCOL.major
        {
            return Err(DecodeError::OtherProtocol { device: ProtocolVersion { major, minor } });
        }
        match postcard::take_from_bytes(payload) {
            Ok((message, _)) => Ok(message),
            // Refused by one of our types, not by postcard: a variant's number, a list or a text is beyond its end.
            // The only list is a block's.
            Err(postcard::Error::SerdeDeCustom) if !stops_after_text(payload) => {
                Err(NewerMessage::of(payload).map_or(DecodeError::Malformed, DecodeError::Unknown))
            }
            Err(_) => Err(DecodeError::Malformed),
        }
    }
}

/// Whether the last that is read of a message that cannot be read is a text, which is then too long for its field.
fn stops_after_text(payload: &[u8]) -> bool {
    let mut reading = postcard::Deserializer::from_flavor(Watched { rest: payload, took_text: false });
    // It fails as it did before.
    let _ = FromDevice::deserialize(&mut reading);
    reading.finalize().unwrap_or(false)
}

/// Bytes that remember whether the last that was taken of them was a text.
struct Watched<'de> {
    rest: &'de [u8],
    took_text: bool,
}

impl<'de> Flavor<'de> for Watched<'de> {
    /// Whether the last that was taken was a text.
    type Remainder = bool;
    type Source = &'de [u8];

    fn pop(&mut self) -> postcard::Result<u8> {
        let (&first, rest) = self.rest.split_first().ok_or(postcard::Error::DeserializeUnexpectedEnd)?;
        (self.rest, self.took_text) = (rest, false);
        Ok(first)
    }

    /// Postcard asks for several bytes at once for a text only.
    fn try_take_n(&mut self, count: usize) -> postcard::Result<&'de [u8]> {
        let (text, rest) = self.rest.split_at_checked(count).ok_or(postcard::Error::DeserializeUnexpectedEnd)?;
        (self.rest, self.took_text) = (rest, true);
        Ok(text)
    }

    fn finalize(self) -> postcard::Result<bool> {
        Ok(self.took_text)
    }
}

/// A command as far as a device could read it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandRead {
    /// A command of this protocol version.
    Command(Command),
    /// A command that must be refused, and why.
    Refuse(CommandId, Refusal),
}

impl Command {
    /// Reads a command out of a frame's payload, on the device.
    ///
    /// Whatever cannot be read behind the id, such as a newer host's request or a new word in a known one, is refused
    /// as [`Refusal::UnknownRequest`]: a host that is not answered would repeat it.
    ///
    /// # Errors
    /// [`DecodeError::Malformed`] if not even the id can be read, so that no reply is possible.
    pub fn from_payload(payload: &[u8]) -> Result<CommandRead, DecodeError> {
        let (&major, rest) = payload.split_first().ok_or(DecodeError::Malformed)?;
        let (id, _) = take(rest).ok_or(DecodeError::Malformed)?;
        if major != PROTOCOL.major {
            return Ok(CommandRead::Refuse(id, Refusal::OtherProtocol { device: PROTOCOL }));
        }
        Ok(match postcard::take_from_bytes(payload) {
            Ok((command, _)) => CommandRead::Command(command),
            Err(_) => CommandRead::Refuse(id, Refusal::UnknownRequest),
        })
    }
}
