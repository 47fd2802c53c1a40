//! Records: an opcode, a length in 8 bytes, and the content.

use std::collections::BTreeMap;

/// What an MCAP file begins and ends with.
pub(super) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Opcode and length.
pub(super) const HEAD_BYTES: usize = 9;

/// Kinds of records, by their opcodes in the specification.
pub(super) mod op {
    pub(crate) const HEADER: u8 = 0x01;
    pub(crate) const FOOTER: u8 = 0x02;
    pub(crate) const SCHEMA: u8 = 0x03;
    pub(crate) const CHANNEL: u8 = 0x04;
    pub(crate) const MESSAGE: u8 = 0x05;
    pub(crate) const CHUNK: u8 = 0x06;
    pub(crate) const MESSAGE_INDEX: u8 = 0x07;
    pub(crate) const CHUNK_INDEX: u8 = 0x08;
    pub(crate) const ATTACHMENT: u8 = 0x09;
    pub(crate) const ATTACHMENT_INDEX: u8 = 0x0A;
    pub(crate) const STATISTICS: u8 = 0x0B;
    pub(crate) const METADATA: u8 = 0x0C;
    pub(crate) const METADATA_INDEX: u8 = 0x0D;
    pub(crate) const SUMMARY_OFFSET: u8 = 0x0E;
    pub(crate) const DATA_END: u8 = 0x0F;
}

/// Builds the content of a record.
#[derive(Clone, Debug, Default)]
pub(super) struct Built(Vec<u8>);

impl Built {
    /// Goes on behind these bytes.
    pub(super) fn behind(bytes: Vec<u8>) -> Self {
        Self(bytes)
    }

    /// All of it.
    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.0
    }

    pub(super) fn u16(mut self, value: u16) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn u64(mut self, value: u64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn bytes(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }

    pub(super) fn text(self, text: &str) -> Self {
        self.u32(length_u32(text.len())).bytes(text.as_bytes())
    }

    /// A list of what `build` gives, with its length in bytes before it.
    pub(super) fn list(self, build: impl FnOnce(Self) -> Self) -> Self {
        let list = build(Self::default()).0;
        self.u32(length_u32(list.len())).bytes(&list)
    }

    pub(super) fn texts(self, texts: &BTreeMap<String, String>) -> Self {
        self.list(|list| texts.iter().fold(list, |list, (name, value)| list.text(name).text(value)))
    }

    /// The record.
    pub(super) fn record(self, opcode: u8) -> Vec<u8> {
        let mut record = Vec::with_capacity(HEAD_BYTES + self.0.len());
        record.push(opcode);
        record.extend((self.0.len() as u64).to_le_bytes());
        record.extend(self.0);
        record
    }

    pub(super) fn content(&self) -> &[u8] {
        &self.0
    }
}

/// A length that the format keeps in four bytes.
///
/// # Panics
/// From 4 GiB on, which nothing here comes near: chunks are written each second, and files are attached up to a limit.
pub(super) fn length_u32(length: usize) -> u32 {
    u32::try_from(length).expect("what is recorded is far smaller than 4 GiB")
}

/// Takes the content of a record apart; `None` where it is too short.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    pub(super) fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    pub(super) fn text(&mut self) -> Option<&'a str> {
        let length = usize::try_from(self.u32()?).ok()?;
        std::str::from_utf8(self.bytes(length)?).ok()
    }

    pub(super) fn texts(&mut self) -> Option<BTreeMap<String, String>> {
        let length = usize::try_from(self.u32()?).ok()?;
        let mut list = Fields(self.bytes(length)?);
        let mut texts = BTreeMap::new();
        while !list.0.is_empty() {
            texts.insert(list.text()?.to_owned(), list.text()?.to_owned());
        }
        Some(texts)
    }
}

/// Texts say their own checksum under this name, since the format has none for them.
const CRC_OF_TEXTS: &str = "crc32";

/// The checksum of texts, that of their own left out.
fn crc_of_texts(texts: &BTreeMap<String, String>) -> String {
    let others = texts.iter().filter(|(name, _)| *name != CRC_OF_TEXTS);
    let all = others.fold(Built::default(), |all, (name, value)| all.text(name).text(value));
    format!("{:08x}", crc32fast::hash(all.content()))
}

/// The texts with their checksum.
pub(super) fn with_checksum(texts: &BTreeMap<String, String>) -> BTreeMap<String, String> {
    let mut all = texts.clone();
    all.insert(CRC_OF_TEXTS.to_owned(), crc_of_texts(texts));
    all
}

/// The texts, if they are as their checksum says; without one they are believed.
pub(super) fn checked_texts(mut texts: BTreeMap<String, String>) -> Option<BTreeMap<String, String>> {
    let wanted = crc_of_texts(&texts);
    texts.remove(CRC_OF_TEXTS).is_none_or(|told| told == wanted).then_some(texts)
}

/// The first record of `bytes` and what is behind it; `None` where it is not whole.
pub(super) fn split(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (&opcode, rest) = bytes.split_first()?;
    let mut fields = Fields(rest);
    let length = usize::try_from(fields.u64()?).ok()?;
    let content = fields.bytes(length)?;
    Some((opcode, content, fields.0))
}
