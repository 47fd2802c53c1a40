//! Payloads as a newer minor version of the protocol would send them: with a variant's number beyond the last.
//!
//! Where the numbers stand is found by a decoder of its own, written from `docs/PROTOCOL.md`, that follows the types'
//! serde descriptions. So an enum that is added to the protocol is found without being listed here.

use palpate_shared::frame::{self, FRAME_MAX, PAYLOAD_MAX};
use palpate_shared::wire::{Command, FromDevice};
use serde::de::value::Error;
use serde::de::{self, Deserialize, DeserializeSeed, Error as _, IntoDeserializer, Visitor};
use serde::ser::{Serialize, SerializeTuple, Serializer};

/// A variant's number in a payload.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VariantNumber {
    /// The enum's name.
    pub of: &'static str,
    /// How many variants this version knows.
    pub known: u32,
    /// Where the number stands.
    pub bytes: std::ops::Range<usize>,
}

impl VariantNumber {
    /// `payload` up to this number, then `number` in its place, then `rest`.
    #[must_use]
    pub fn replaced(&self, payload: &[u8], number: u32, rest: &[u8]) -> Vec<u8> {
        [&payload[..self.bytes.start], &varint(number), rest].concat()
    }
}

/// The variants' numbers in a device's message, outermost first.
///
/// # Panics
/// If it is none.
#[must_use]
pub fn numbers_in_message(payload: &[u8]) -> Vec<VariantNumber> {
    numbers::<FromDevice>(payload)
}

/// The variants' numbers in a command, outermost first.
///
/// # Panics
/// If it is none.
#[must_use]
pub fn numbers_in_command(payload: &[u8]) -> Vec<VariantNumber> {
    numbers::<Command>(payload)
}

fn numbers<'de, T: Deserialize<'de>>(payload: &'de [u8]) -> Vec<VariantNumber> {
    let mut tracer = Tracer { payload, at: 0, found: Vec::new() };
    assert!(T::deserialize(&mut tracer).is_ok(), "{payload:02x?} is a message of this version");
    tracer.found
}

/// `payload` with the number of its first `of` beyond the last by one, and with all that stands behind it.
///
/// # Panics
/// If there is no such number.
#[must_use]
pub fn with_newer(payload: &[u8], of: &str) -> Vec<u8> {
    let numbers = numbers_in_message(payload);
    let number = numbers.iter().find(|number| number.of == of).expect("the enum is in the message");
    number.replaced(payload, number.known, &payload[number.bytes.end..])
}

/// The payload of a message or a command.
///
/// # Panics
/// If it is too long for a frame.
#[must_use]
pub fn payload_of(message: &impl Serialize) -> Vec<u8> {
    let mut line = [0; FRAME_MAX + 1];
    let length = frame::encode(message, &mut line).expect("it fits a frame").len();
    frame::decode_in_place(&mut line[..length - 1]).expect("it was just coded").to_vec()
}

/// The frame of a payload, delimiter included.
///
/// # Panics
/// If the payload is longer than [`PAYLOAD_MAX`].
#[must_use]
pub fn frame_of(payload: &[u8]) -> Vec<u8> {
    assert!(payload.len() <= PAYLOAD_MAX);
    frame::encode(&Raw(payload), &mut [0; FRAME_MAX + 1]).expect("it fits a frame").to_vec()
}

/// Bytes as they are, without their length.
struct Raw<'a>(&'a [u8]);

impl Serialize for Raw<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut bytes = serializer.serialize_tuple(self.0.len())?;
        self.0.iter().try_for_each(|byte| bytes.serialize_element(byte))?;
        bytes.end()
    }
}

fn varint(mut number: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    loop {
        let [low, ..] = (number & 0x7F).to_le_bytes();
        number >>= 7;
        bytes.push(if number == 0 { low } else { low | 0x80 });
        if number == 0 {
            return bytes;
        }
    }
}

/// Reads a message and notes the variants' numbers.
struct Tracer<'de> {
    payload: &'de [u8],
    at: usize,
    found: Vec<VariantNumber>,
}

impl<'de> Tracer<'de> {
    fn take(&mut self, count: usize) -> Result<&'de [u8], Error> {
        let bytes = self.payload.get(self.at..self.at + count).ok_or_else(|| Error::custom("cut off"))?;
        self.at += count;
        Ok(bytes)
    }

    fn byte(&mut self) -> Result<u8, Error> {
        Ok(self.take(1)?[0])
    }

    fn varint(&mut self) -> Result<u32, Error> {
        let mut number = 0;
        for shift in (0..32).step_by(7) {
            let byte = self.byte()?;
            number |= u32::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                return Ok(number);
            }
        }
        Err(Error::custom("a number without end"))
    }

    fn signed(&mut self) -> Result<i32, Error> {
        let number = self.varint()?;
        Ok((number >> 1).cast_signed() ^ -(number & 1).cast_signed())
    }

    fn length(&mut self) -> Result<usize, Error> {
        self.varint().map(|length| length as usize)
    }
}

impl<'de> de::Deserializer<'de> for &mut Tracer<'de> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Error> {
        Err(Error::custom("the protocol has no such type"))
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_bool(self.byte()? == 1)
    }

    fn deserialize_u8<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_u8(self.byte()?)
    }

    fn deserialize_u16<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_u32(self.varint()?)
    }

    fn deserialize_u32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_u32(self.varint()?)
    }

    fn deserialize_i16<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_i32(self.signed()?)
    }

    fn deserialize_i32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_i32(self.signed()?)
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        let length = self.length()?;
        visitor.visit_str(std::str::from_utf8(self.take(length)?).map_err(Error::custom)?)
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        self.deserialize_str(visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        if self.byte()? == 0 { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        let length = self.length()?;
        self.deserialize_tuple(length, visitor)
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_seq(Items { tracer: self, left: length })
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        self.deserialize_tuple(fields.len(), visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        let start = self.at;
        let number = self.varint()?;
        let known = u32::try_from(variants.len()).map_err(Error::custom)?;
        self.found.push(VariantNumber { of: name, known, bytes: start..self.at });
        visitor.visit_enum(Chosen { tracer: self, number })
    }

    serde::forward_to_deserialize_any! {
        i8 i64 i128 u64 u128 f32 f64 char bytes byte_buf unit unit_struct tuple_struct map identifier ignored_any
    }
}

/// The items of a list or the fields of a struct.
struct Items<'a, 'de> {
    tracer: &'a mut Tracer<'de>,
    left: usize,
}

impl<'de> de::SeqAccess<'de> for Items<'_, 'de> {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Error> {
        let Some(left) = self.left.checked_sub(1) else { return Ok(None) };
        self.left = left;
        seed.deserialize(&mut *self.tracer).map(Some)
    }
}

/// A variant whose number was read.
struct Chosen<'a, 'de> {
    tracer: &'a mut Tracer<'de>,
    number: u32,
}

impl<'de> de::EnumAccess<'de> for Chosen<'_, 'de> {
    type Error = Error;
    type Variant = Self;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), Error> {
        Ok((seed.deserialize(self.number.into_deserializer())?, self))
    }
}

impl<'de> de::VariantAccess<'de> for Chosen<'_, 'de> {
    type Error = Error;

    fn unit_variant(self) -> Result<(), Error> {
        Ok(())
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Error> {
        seed.deserialize(self.tracer)
    }

    fn tuple_variant<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, Error> {
        de::Deserializer::deserialize_tuple(self.tracer, length, visitor)
    }

    fn struct_variant<V: Visitor<'de>>(self, fields: &'static [&'static str], visitor: V) -> Result<V::Value, Error> {
        de::Deserializer::deserialize_tuple(self.tracer, fields.len(), visitor)
    }
}

#[cfg(test)]
mod tests {
    use palpate_shared::units::DeviceTime;
    use palpate_shared::wire::{CommandId, Event, EventKind, Request, Source};

    use super::*;

    #[test]
    fn the_numbers_of_an_event_stand_first_and_behind_its_time() {
        let event = Event { time: DeviceTime(128), kind: EventKind::FrontEndSilent { quiet_us: 1000 } };
        let payload = payload_of(&FromDevice::Event(event));
        let [outer, kind] = &numbers_in_message(&payload)[..] else { panic!("two numbers") };
        assert_eq!((outer.of, outer.bytes.clone()), ("FromDevice", 0..1));
        assert_eq!(*kind, VariantNumber { of: "EventKind", known: 5, bytes: 3..4 });
        assert_eq!(with_newer(&payload, "EventKind"), [2, 0x80, 1, 5, 0xE8, 7]);
    }

    #[test]
    fn the_numbers_of_a_command_are_its_requests_and_its_words() {
        let payload = payload_of(&Command::new(CommandId(5), Request::SetSource { source: Source::Simulated }));
        let named: Vec<_> = numbers_in_command(&payload).into_iter().map(|number| (number.of, number.known)).collect();
        assert_eq!(named, [("Request", 21), ("Source", 2)]);
    }

    #[test]
    fn a_frame_of_bytes_is_the_frame_of_the_message_that_they_are() {
        let ping = Command::new(CommandId(5), Request::Ping);
        assert_eq!(frame_of(&payload_of(&ping)), [0x08, 1, 5, 7, 0xC3, 0xD2, 0x90, 0x1D, 0]);
    }
}
