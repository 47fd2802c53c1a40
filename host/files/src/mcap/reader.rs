//! Reads a file in the order in which it was written, a chunk at a time.
//!
//! Whoever needs what is behind damage recovers the file first; here reading ends at it, and says so.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use super::record::{Fields, HEAD_BYTES, MAGIC, checked_texts, op, split};
use super::writer::{Channel, ZSTD};

/// The compression of older chunks, and of other tools'.
const LZ4: &str = "lz4";

/// Longest record that is read, bytes: a chunk of a second takes well under a megabyte.
const RECORD_BYTES_MAX: u64 = 1 << 30;

/// Why a file cannot be read on.
#[derive(Debug, thiserror::Error)]
pub enum McapError {
    /// The operating system refused.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// It is another kind of file.
    #[error("it is no MCAP file: it does not begin with the mark of one")]
    NotMcap,
    /// The file ends within a record, or without an end.
    #[error("the file ends at byte {at}, before its end was written")]
    Cut {
        /// Where the record that is not whole begins.
        at: u64,
    },
    /// Something is not as it was written.
    #[error("{what} at byte {at} is damaged")]
    Damaged {
        /// What.
        what: &'static str,
        /// Where it begins.
        at: u64,
    },
    /// A chunk is compressed in a way that is not known here.
    #[error(
        "the chunk at byte {at} is compressed with {compression}, which cannot be read here; only lz4 and zstd can"
    )]
    Compression {
        /// Where it begins.
        at: u64,
        /// Name of the compression.
        compression: String,
    },
}

/// What a file has, in its order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Content {
    /// A message.
    Message {
        /// Number of its channel: see [`Reader::channel`].
        channel: u16,
        /// When it was recorded, ns.
        log_time_ns: u64,
        /// When it was made, ns.
        publish_time_ns: u64,
        /// What it says.
        data: Vec<u8>,
    },
    /// A file.
    Attachment {
        /// Its name.
        name: String,
        /// What kind of file it is.
        media_type: String,
        /// What is in it.
        data: Vec<u8>,
    },
    /// Texts by their names.
    Metadata {
        /// What they are about.
        name: String,
        /// The texts.
        texts: BTreeMap<String, String>,
    },
}

/// Reads an MCAP file.
#[derive(Debug)]
pub struct Reader<R> {
    from: R,
    /// Where the next record begins.
    at: u64,
    schemas: BTreeMap<u16, (String, String, String)>,
    channels: BTreeMap<u16, Channel>,
    /// Records of a chunk that are not handed on yet.
    chunk: (Vec<u8>, usize),
    chunk_at: u64,
    is_over: bool,
}

impl Reader<BufReader<File>> {
    /// Opens a file.
    ///
    /// # Errors
    /// [`McapError::Io`], [`McapError::NotMcap`].
    pub fn open(path: &Path) -> Result<Self, McapError> {
        Self::new(BufReader::new(File::open(path)?))
    }
}

impl<R: Read> Reader<R> {
    /// Reads from a beginning.
    ///
    /// # Errors
    /// [`McapError::Io`], [`McapError::NotMcap`].
    pub fn new(mut from: R) -> Result<Self, McapError> {
        let mut magic = [0; MAGIC.len()];
        match from.read_exact(&mut magic) {
            Ok(()) if magic == MAGIC => {}
            Ok(()) => return Err(McapError::NotMcap),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Err(McapError::NotMcap),
            Err(error) => return Err(error.into()),
        }
        let at = MAGIC.len() as u64;
        let (schemas, channels) = (BTreeMap::new(), BTreeMap::new());
        Ok(Self { from, at, schemas, channels, chunk: (Vec::new(), 0), chunk_at: 0, is_over: false })
    }

    /// The channel of this number, once a message of it was read.
    #[must_use]
    pub fn channel(&self, number: u16) -> Option<&Channel> {
        self.channels.get(&number)
    }

    /// How much of the file is read, bytes.
    #[must_use]
    pub fn position(&self) -> u64 {
        self.at
    }

    /// What comes next; `None` at the end.
    ///
    /// # Errors
    /// [`McapError`]; from then on there is nothing more.
    pub fn next_content(&mut self) -> Result<Option<Content>, McapError> {
        if self.is_over {
            return Ok(None);
        }
        let next = self.find_next();
        self.is_over = !matches!(next, Ok(Some(_)));
        next
    }

    fn find_next(&mut self) -> Result<Option<Content>, McapError> {
        loop {
            while let Some((opcode, content)) = self.next_in_chunk()? {
                let at = self.chunk_at;
                if let Some(found) = self.take(opcode, &content, at)? {
                    return Ok(Some(found));
                }
            }
            let at = self.at;
            let (opcode, content) = self.next_record()?;
            match opcode {
                // What follows is the summary, which says nothing that was not read.
                op::DATA_END | op::FOOTER => return Ok(None),
                op::CHUNK => (self.chunk, self.chunk_at) = ((unpacked(&content, at)?, 0), at),
                _ => {
                    if let Some(found) = self.take(opcode, &content, at)? {
                        return Ok(Some(found));
                    }
                }
            }
        }
    }

    fn next_in_chunk(&mut self) -> Result<Option<(u8, Vec<u8>)>, McapError> {
        let (records, taken) = &mut self.chunk;
        let rest = &records[*taken..];
        if rest.is_empty() {
            return Ok(None);
        }
        let damaged = McapError::Damaged { what: "a record in the chunk", at: self.chunk_at };
        let (opcode, content, behind) = split(rest).ok_or(damaged)?;
        *taken = records.len() - behind.len();
        Ok(Some((opcode, content.to_vec())))
    }

    fn next_record(&mut self) -> Result<(u8, Vec<u8>), McapError> {
        let at = self.at;
        let cut = |error: io::Error| match error.kind() {
            io::ErrorKind::UnexpectedEof => McapError::Cut { at },
            _ => error.into(),
        };
        let mut head = [0; HEAD_BYTES];
        self.from.read_exact(&mut head).map_err(cut)?;
        let length = Fields(&head[1..]).u64().unwrap_or_default();
        if length > RECORD_BYTES_MAX {
            return Err(McapError::Damaged { what: "the record", at });
        }
        let mut content = Vec::new();
        (&mut self.from).take(length).read_to_end(&mut content)?;
        if (content.len() as u64) < length {
            return Err(McapError::Cut { at });
        }
        self.at += HEAD_BYTES as u64 + length;
        Ok((head[0], content))
    }

    fn take(&mut self, opcode: u8, content: &[u8], at: u64) -> Result<Option<Content>, McapError> {
        let damaged = |what| McapError::Damaged { what, at };
        match opcode {
            op::SCHEMA => {
                let (id, schema) = schema(content).ok_or(damaged("the schema"))?;
                self.schemas.insert(id, schema);
                Ok(None)
            }
            op::CHANNEL => {
                let (id, channel) = self.channel_of(content).ok_or(damaged("the channel"))?;
                self.channels.insert(id, channel);
                Ok(None)
            }
            op::MESSAGE => message(content).ok_or(damaged("the message")).map(Some),
            op::ATTACHMENT => attachment(content).ok_or(damaged("the attachment")).map(Some),
            op::METADATA => {
                let mut fields = Fields(content);
                let name = fields.text().map(str::to_owned);
                let texts = fields.texts().and_then(checked_texts);
                let found = name.zip(texts).map(|(name, texts)| Content::Metadata { name, texts });
                found.ok_or(damaged("the metadata")).map(Some)
            }
            _ => Ok(None),
        }
    }

    fn channel_of(&self, content: &[u8]) -> Option<(u16, Channel)> {
        let mut fields = Fields(content);
        let (id, schema_id) = (fields.u16()?, fields.u16()?);
        let (topic, message_encoding) = (fields.text()?.to_owned(), fields.text()?.to_owned());
        let metadata = fields.texts()?;
        let (schema_name, schema_encoding, schema) = self.schemas.get(&schema_id).cloned().unwrap_or_default();
        Some((id, Channel { topic, message_encoding, schema_name, schema_encoding, schema, metadata }))
    }
}

/// Number, name, encoding and text of a schema.
fn schema(content: &[u8]) -> Option<(u16, (String, String, String))> {
    let mut fields = Fields(content);
    Some((fields.u16()?, (fields.text()?.to_owned(), fields.text()?.to_owned(), fields.text()?.to_owned())))
}

fn message(content: &[u8]) -> Option<Content> {
    let mut fields = Fields(content);
    let (channel, _sequence) = (fields.u16()?, fields.u32()?);
    let (log_time_ns, publish_time_ns) = (fields.u64()?, fields.u64()?);
    Some(Content::Message { channel, log_time_ns, publish_time_ns, data: fields.0.to_vec() })
}

/// An attachment whose checksum fits.
pub(super) fn attachment(content: &[u8]) -> Option<Content> {
    let (covered, crc) = content.split_at_checked(content.len().checked_sub(4)?)?;
    let mut fields = Fields(covered);
    fields.bytes(16)?;
    let (name, media_type) = (fields.text()?.to_owned(), fields.text()?.to_owned());
    let length = usize::try_from(fields.u64()?).ok()?;
    let data = fields.bytes(length).filter(|_| fields.0.is_empty())?.to_vec();
    let told = Fields(crc).u32()?;
    (told == 0 || told == crc32fast::hash(covered)).then_some(Content::Attachment { name, media_type, data })
}

/// The records of a chunk, whose checksum fits.
pub(super) fn unpacked(content: &[u8], at: u64) -> Result<Vec<u8>, McapError> {
    let damaged = || McapError::Damaged { what: "the chunk", at };
    let mut fields = Fields(content);
    fields.bytes(16).ok_or_else(damaged)?;
    let (length, crc) = fields.u64().zip(fields.u32()).ok_or_else(damaged)?;
    let compression = fields.text().ok_or_else(damaged)?;
    let packed_bytes = fields.u64().and_then(|bytes| usize::try_from(bytes).ok()).ok_or_else(damaged)?;
    let packed = fields.bytes(packed_bytes).filter(|_| fields.0.is_empty()).ok_or_else(damaged)?;
    let mut records = Vec::new();
    match compression {
        "" => records.extend_from_slice(packed),
        LZ4 => {
            // No more than it says, whatever the damage makes of it.
            let decoder = lz4_flex::frame::FrameDecoder::new(packed);
            decoder.take(length.min(RECORD_BYTES_MAX)).read_to_end(&mut records).map_err(|_| damaged())?;
        }
        ZSTD => {
            let decoder = zstd::stream::read::Decoder::with_buffer(packed).map_err(|_| damaged())?;
            decoder.take(length.min(RECORD_BYTES_MAX)).read_to_end(&mut records).map_err(|_| damaged())?;
        }
        other => return Err(McapError::Compression { at, compression: other.to_owned() }),
    }
    let fits = records.len() as u64 == length && (crc == 0 || crc == crc32fast::hash(&records));
    if fits { Ok(records) } else { Err(damaged()) }
}
