//! What is left of a damaged file: every chunk and every attached file whose checksum fits, wherever it stands.
//!
//! No place in the file is believed for what another place says: bytes are gone through one by one for what may be a record
//! with a checksum of its own, and only one whose checksum fits is taken, and gone on behind. So what is undamaged comes back,
//! before the damage and behind it. Records that only say where others are have no checksum; they are passed, and written
//! anew.
//!
//! Units: bytes, ns since 1970. Errors: none; nothing to be found is an answer.

use std::collections::BTreeMap;
use std::ops::Range;

use super::reader::{Content, Reader, attachment, unpacked};
use super::record::{Fields, MAGIC, checked_texts, op, split};
use super::writer::Channel;

/// Something that came back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Recovered {
    /// A chunk's messages, each with its channel and its number there.
    Chunk(Vec<RecoveredMessage>),
    /// A file, or texts by their names.
    Beside(Content),
}

/// A message of an undamaged chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecoveredMessage {
    /// What it was sent on.
    pub channel: Channel,
    /// How many there were on that channel before it, modulo 2³².
    pub sequence: u32,
    /// When it was recorded, ns.
    pub log_time_ns: u64,
    /// When it was made, ns.
    pub publish_time_ns: u64,
    /// What it says.
    pub data: Vec<u8>,
}

/// Bytes that are no part of anything known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Where.
    pub bytes: Range<usize>,
    /// When the last message before it was recorded, and the first behind it, ns; none where there is none.
    pub between_ns: (Option<u64>, Option<u64>),
}

/// What is left of a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recovery {
    /// In the file's order.
    pub found: Vec<Recovered>,
    /// In the file's order; none where the file is whole.
    pub damages: Vec<Damage>,
}

impl Recovery {
    /// Goes through a file.
    ///
    /// ```
    /// use palpate_files::mcap::Recovery;
    ///
    /// let nothing = Recovery::of(b"not a recording");
    /// assert!(nothing.found.is_empty());
    /// assert_eq!(nothing.damages[0].bytes, 0..15);
    /// ```
    #[must_use]
    pub fn of(file: &[u8]) -> Self {
        let mut recovery = Self::default();
        let (mut at, mut last_ns, mut damaged_from) = (0, None, None);
        let mut is_ended = false;
        while at < file.len() {
            let taken = taken_at(file, at);
            let Some((length, found)) = taken else {
                damaged_from.get_or_insert(at);
                at += 1;
                continue;
            };
            let first_ns = match &found {
                Passed::Found(Recovered::Chunk(messages)) => messages.iter().map(|message| message.log_time_ns).min(),
                _ => None,
            };
            if let Some(from) = damaged_from.take() {
                recovery.damages.push(Damage { bytes: from..at, between_ns: (last_ns, None) });
            }
            for damage in recovery.damages.iter_mut().filter(|damage| damage.between_ns.1.is_none()) {
                damage.between_ns.1 = first_ns;
            }
            match found {
                Passed::Found(found) => {
                    if let Recovered::Chunk(messages) = &found {
                        last_ns = messages.iter().map(|message| message.log_time_ns).max().or(last_ns);
                    }
                    recovery.found.push(found);
                }
                Passed::End => is_ended = true,
                Passed::Other => {}
            }
            at += length;
        }
        if let Some(from) = damaged_from {
            recovery.damages.push(Damage { bytes: from..file.len(), between_ns: (last_ns, None) });
        } else if !is_ended {
            recovery.damages.push(Damage { bytes: file.len()..file.len(), between_ns: (last_ns, None) });
        }
        recovery
    }

    /// Whether nothing is missing.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.damages.is_empty()
    }

    /// How many messages of each topic are missing between some that are there, by their numbers.
    #[must_use]
    pub fn missing(&self) -> BTreeMap<String, u64> {
        let (mut next, mut missing) = (BTreeMap::<String, u32>::new(), BTreeMap::new());
        for message in self.messages() {
            let topic = &message.channel.topic;
            let expected = next.insert(topic.clone(), message.sequence.wrapping_add(1)).unwrap_or(0);
            let lost = message.sequence.wrapping_sub(expected);
            if lost > 0 {
                *missing.entry(topic.clone()).or_default() += u64::from(lost);
            }
        }
        missing
    }

    /// Every message, in the file's order.
    pub fn messages(&self) -> impl Iterator<Item = &RecoveredMessage> {
        self.found.iter().flat_map(|found| match found {
            Recovered::Chunk(messages) => messages.as_slice(),
            Recovered::Beside(_) => &[],
        })
    }
}

/// What stands at a place.
enum Passed {
    Found(Recovered),
    /// The mark at the end.
    End,
    /// The mark at the beginning, or what says where others are.
    Other,
}

/// What stands at a place, with its length; none of what is nothing known, or damaged.
fn taken_at(file: &[u8], at: usize) -> Option<(usize, Passed)> {
    let rest = &file[at..];
    if rest.starts_with(&MAGIC) {
        let is_end = at > 0 && rest.len() == MAGIC.len();
        return Some((MAGIC.len(), if is_end { Passed::End } else { Passed::Other }));
    }
    let (opcode, content, behind) = split(rest)?;
    let length = rest.len() - behind.len();
    let passed = match opcode {
        op::CHUNK => Passed::Found(Recovered::Chunk(messages(&unpacked(content, at as u64).ok()?)?)),
        op::ATTACHMENT => Passed::Found(Recovered::Beside(attachment(content)?)),
        op::METADATA => {
            let mut fields = Fields(content);
            let name = fields.text()?.to_owned();
            let texts = checked_texts(fields.texts().filter(|_| fields.0.is_empty())?)?;
            Passed::Found(Recovered::Beside(Content::Metadata { name, texts }))
        }
        // Without a checksum: believed where it has the form of what it says it is, and nothing that has one begins within.
        _ if has_form(opcode, content) => is_alone(file, at + 1..at + length).then_some(Passed::Other)?,
        _ => return None,
    };
    Some((length, passed))
}

/// A field of a record, as far as its length goes.
#[derive(Clone, Copy)]
enum Field {
    /// So many bytes.
    Bytes(usize),
    Text,
    /// A list of items of so many bytes.
    List(usize),
}

/// The fields of a record without a checksum; none of other kinds.
fn form_of(opcode: u8) -> Option<&'static [Field]> {
    use Field::{Bytes, List, Text};
    Some(match opcode {
        op::HEADER => &[Text, Text],
        op::FOOTER => &[Bytes(20)],
        op::SCHEMA => &[Bytes(2), Text, Text, List(1)],
        op::CHANNEL => &[Bytes(4), Text, Text, List(1)],
        op::MESSAGE_INDEX => &[Bytes(2), List(16)],
        op::CHUNK_INDEX => &[Bytes(32), List(10), Bytes(8), Text, Bytes(16)],
        op::ATTACHMENT_INDEX => &[Bytes(40), Text, Text],
        op::STATISTICS => &[Bytes(42), List(10)],
        op::METADATA_INDEX => &[Bytes(16), Text],
        op::SUMMARY_OFFSET => &[Bytes(17)],
        op::DATA_END => &[Bytes(4)],
        _ => return None,
    })
}

/// Whether a record without a checksum has the fields of its kind, and nothing else.
fn has_form(opcode: u8, content: &[u8]) -> bool {
    let mut fields = Fields(content);
    let mut is_there = |field: &Field| match *field {
        Field::Bytes(count) => fields.bytes(count).is_some(),
        Field::Text => fields.text().is_some(),
        Field::List(item) => {
            let length = fields.u32().and_then(|length| usize::try_from(length).ok());
            length.is_some_and(|length| length.is_multiple_of(item) && fields.bytes(length).is_some())
        }
    };
    form_of(opcode).is_some_and(|form| form.iter().all(&mut is_there)) && fields.0.is_empty()
}

/// Whether no record with a checksum that fits begins at these places.
fn is_alone(file: &[u8], places: Range<usize>) -> bool {
    let may_be = |at: &usize| matches!(file[*at], op::CHUNK | op::ATTACHMENT);
    !places.filter(may_be).any(|at| matches!(taken_at(file, at), Some((_, Passed::Found(_)))))
}

/// The messages in a chunk's records; none where they are no records.
fn messages(records: &[u8]) -> Option<Vec<RecoveredMessage>> {
    let sequences = sequences(records)?;
    // A file of nothing but these records, whose end is missing.
    let file = [&MAGIC[..], records].concat();
    let mut reader = Reader::new(file.as_slice()).ok()?;
    let mut messages = Vec::new();
    while let Ok(Some(content)) = reader.next_content() {
        let Content::Message { channel, log_time_ns, publish_time_ns, data } = content else { continue };
        let sequence = *sequences.get(messages.len())?;
        let channel = reader.channel(channel)?.clone();
        messages.push(RecoveredMessage { channel, sequence, log_time_ns, publish_time_ns, data });
    }
    Some(messages)
}

/// The numbers of the messages.
fn sequences(records: &[u8]) -> Option<Vec<u32>> {
    let (mut rest, mut sequences) = (records, Vec::new());
    while !rest.is_empty() {
        let (opcode, content, behind) = split(rest)?;
        if opcode == op::MESSAGE {
            let mut fields = Fields(content);
            fields.u16()?;
            sequences.push(fields.u32()?);
        }
        rest = behind;
    }
    Some(sequences)
}
