//! Writes a file that is whole after every flush.
//!
//! The file ends with a summary, by which a reader finds its way. Each flush writes the next chunk where the last summary
//! began, with a new summary behind it, in one piece, and waits until the disk has it. So whoever opens the file finds
//! all that was flushed; what a power cut tears is the piece under way. Where the disk is full the last summary is
//! written again, and the file ends as it was.
//!
//! The summary names every chunk, about 200 bytes each: it grows by 1.4 MB in an hour of two flushes a second.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Seek as _, SeekFrom, Write as _};
use std::path::Path;

use super::record::{Built, MAGIC, length_u32, op, with_checksum};

/// Name of the compression in the format.
pub(super) const ZSTD: &str = "zstd";

/// How hard chunks are packed: what goes beyond costs several times the time and saves some percent.
const ZSTD_LEVEL: i32 = 3;

/// What a message has before its data: channel, number and two times.
const MESSAGE_HEAD_BYTES: usize = 2 + 4 + 8 + 8;

/// What a channel is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Name of the channel, such as `/finger/wrench`.
    pub topic: String,
    /// How its messages are encoded: `cdr`, `json`.
    pub message_encoding: String,
    /// Name of the schema, such as `geometry_msgs/msg/WrenchStamped`.
    pub schema_name: String,
    /// How the schema is written: `ros2msg`, `jsonschema`.
    pub schema_encoding: String,
    /// The schema.
    pub schema: String,
    /// What else is to be known of the channel.
    pub metadata: BTreeMap<String, String>,
}

/// Number of a channel in its file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ChannelId(u16);

/// Writes an MCAP file.
#[derive(Debug)]
pub struct Writer {
    file: File,
    /// Where the data end and the last summary begins.
    end: u64,
    /// What stands there: the end of the file.
    tail: Vec<u8>,
    /// Schema and channel records, one after the other.
    definitions: Vec<u8>,
    channels: Vec<WrittenChannel>,
    chunk: OpenChunk,
    /// Attachments and metadata since the last flush.
    beside: Vec<u8>,
    /// What the summary says of attachments and metadata of `beside`: written with it.
    indexed: Vec<Indexed>,
    summary: Summary,
}

#[derive(Clone, Copy, Debug, Default)]
struct WrittenChannel {
    /// Messages so far: the next one's number.
    messages: u64,
}

/// Messages since the last flush.
#[derive(Clone, Debug, Default)]
struct OpenChunk {
    records: Vec<u8>,
    times: Option<(u64, u64)>,
    /// For each channel, log time and place of its messages.
    index: BTreeMap<u16, Vec<(u64, u64)>>,
}

/// An attachment or metadata record of which the summary has an index record.
#[derive(Clone, Debug)]
struct Indexed {
    opcode: u8,
    /// Where the record begins in `beside`, and its length.
    place: (u64, u64),
    /// What follows place and length in the index record.
    rest: Vec<u8>,
}

/// What is written at the end.
#[derive(Clone, Debug, Default)]
struct Summary {
    chunk_indexes: Vec<u8>,
    attachment_indexes: Vec<u8>,
    metadata_indexes: Vec<u8>,
    chunks: u32,
    attachments: u32,
    metadata: u32,
    times: Option<(u64, u64)>,
    counts: BTreeMap<u16, u64>,
}

impl Writer {
    /// Begins a file that does not exist yet, with nothing in it.
    ///
    /// # Errors
    /// What the operating system says; [`io::ErrorKind::AlreadyExists`] where there is one.
    pub fn create(path: &Path, library: &str) -> io::Result<Self> {
        let mut file = File::options().write(true).create_new(true).open(path)?;
        let header = Built::default().text("").text(library).record(op::HEADER);
        let head = [&MAGIC[..], &header].concat();
        file.write_all(&head)?;
        let mut writer = Self {
            file,
            end: head.len() as u64,
            tail: Vec::new(),
            definitions: Vec::new(),
            channels: Vec::new(),
            chunk: OpenChunk::default(),
            beside: Vec::new(),
            indexed: Vec::new(),
            summary: Summary::default(),
        };
        writer.append(&[], Summary::default())?;
        Ok(writer)
    }

    /// Adds a channel.
    ///
    /// # Panics
    /// After 65,534 of them.
    pub fn channel(&mut self, channel: &Channel) -> ChannelId {
        let id = u16::try_from(self.channels.len() + 1).expect("there are few channels");
        let schema = Built::default().u16(id).text(&channel.schema_name).text(&channel.schema_encoding);
        let schema = schema.list(|list| list.bytes(channel.schema.as_bytes())).record(op::SCHEMA);
        let told = Built::default().u16(id).u16(id).text(&channel.topic).text(&channel.message_encoding);
        let definition = [schema, told.texts(&channel.metadata).record(op::CHANNEL)].concat();
        // A chunk that is under way began with those before.
        if !self.chunk.records.is_empty() {
            self.chunk.records.extend_from_slice(&definition);
        }
        self.definitions.extend(definition);
        self.channels.push(WrittenChannel::default());
        ChannelId(id)
    }

    /// Adds a message, of which the file knows after the next flush. Messages are kept in this order.
    pub fn message(&mut self, channel: ChannelId, log_time_ns: u64, publish_time_ns: u64, data: &[u8]) {
        let ChannelId(id) = channel;
        let Some(written) = self.channels.get_mut(usize::from(id) - 1) else { return };
        #[expect(clippy::cast_possible_truncation, reason = "the format's numbers begin anew after 2³²")]
        let sequence = written.messages as u32;
        written.messages += 1;
        let chunk = &mut self.chunk;
        if chunk.records.is_empty() {
            chunk.records.extend_from_slice(&self.definitions);
        }
        chunk.index.entry(id).or_default().push((log_time_ns, chunk.records.len() as u64));
        chunk.times = Some(with(chunk.times, log_time_ns));
        // There are thousands a second: written where they stay.
        let records = Built::behind(std::mem::take(&mut chunk.records));
        let head = records.bytes(&[op::MESSAGE]).u64((MESSAGE_HEAD_BYTES + data.len()) as u64);
        let message = head.u16(id).u32(sequence).u64(log_time_ns).u64(publish_time_ns).bytes(data);
        chunk.records = message.into_bytes();
    }

    /// Adds a file, of which this one knows after the next flush.
    pub fn attachment(&mut self, name: &str, media_type: &str, data: &[u8], time_ns: u64) {
        let content = Built::default().u64(time_ns).u64(time_ns).text(name).text(media_type);
        let content = content.u64(data.len() as u64).bytes(data);
        let crc = crc32fast::hash(content.content());
        let rest = Built::default().u64(time_ns).u64(time_ns).u64(data.len() as u64).text(name).text(media_type);
        self.write_beside(op::ATTACHMENT_INDEX, &content.u32(crc).record(op::ATTACHMENT), rest);
    }

    /// Adds texts by their names, of which the file knows after the next flush.
    pub fn metadata(&mut self, name: &str, texts: &BTreeMap<String, String>) {
        let record = Built::default().text(name).texts(&with_checksum(texts)).record(op::METADATA);
        self.write_beside(op::METADATA_INDEX, &record, Built::default().text(name));
    }

    fn write_beside(&mut self, opcode: u8, record: &[u8], rest: Built) {
        let place = (self.beside.len() as u64, record.len() as u64);
        self.indexed.push(Indexed { opcode, place, rest: rest.content().to_vec() });
        self.beside.extend_from_slice(record);
    }

    /// Writes what was added, so that the file is whole and has it, and waits for the disk. Gives the file's size.
    ///
    /// # Errors
    /// What the operating system says. The file is then as it was after the last flush, as far as that can be had.
    pub fn flush(&mut self) -> io::Result<u64> {
        let (chunk, beside) = (std::mem::take(&mut self.chunk), std::mem::take(&mut self.beside));
        let indexed = std::mem::take(&mut self.indexed);
        if chunk.records.is_empty() && beside.is_empty() {
            return Ok(self.end + self.tail.len() as u64);
        }
        let mut summary = self.summary.clone();
        for Indexed { opcode, place: (offset, length), rest } in indexed {
            let index = Built::default().u64(self.end + offset).u64(length).bytes(&rest).record(opcode);
            if opcode == op::ATTACHMENT_INDEX {
                summary.attachment_indexes.extend(index);
                summary.attachments += 1;
            } else {
                summary.metadata_indexes.extend(index);
                summary.metadata += 1;
            }
        }
        let mut data = beside;
        if let Some(times) = chunk.times {
            chunk.write(times, self.end, &mut data, &mut summary)?;
        }
        self.append(&data, summary)
    }

    /// Writes data where the last summary began, and a summary behind them.
    fn append(&mut self, data: &[u8], summary: Summary) -> io::Result<u64> {
        let tail = self.tail_behind(self.end + data.len() as u64, &summary);
        let piece = [data, &tail].concat();
        let written = self.file.seek(SeekFrom::Start(self.end)).and_then(|_| self.file.write_all(&piece));
        if let Err(error) = written.and_then(|()| self.file.sync_data()) {
            // The old end, which was there already, has room where the new one has not.
            let whole = self.end + self.tail.len() as u64;
            let restored = self.file.seek(SeekFrom::Start(self.end)).and_then(|_| self.file.write_all(&self.tail));
            restored.and_then(|()| self.file.set_len(whole)).and_then(|()| self.file.sync_data()).map_err(|also| {
                io::Error::new(error.kind(), format!("{error}; nor could its end be written again: {also}"))
            })?;
            return Err(error);
        }
        self.end += data.len() as u64;
        (self.tail, self.summary) = (tail, summary);
        Ok(self.end + self.tail.len() as u64)
    }

    /// End of the data, summary and footer, for data that end at `end`.
    fn tail_behind(&self, end: u64, summary: &Summary) -> Vec<u8> {
        // A checksum over all data would have to be computed anew each time; the chunks have theirs.
        let mut tail = Built::default().u32(0).record(op::DATA_END);
        let summary_start = end + tail.len() as u64;
        let from = tail.len();
        let mut groups = Vec::new();
        for (opcode, group) in self.groups(summary) {
            if !group.is_empty() {
                groups.push((opcode, end + tail.len() as u64, group.len() as u64));
                tail.extend(group);
            }
        }
        let offsets_start = end + tail.len() as u64;
        for (opcode, start, length) in groups {
            tail.extend(Built::default().bytes(&[opcode]).u64(start).u64(length).record(op::SUMMARY_OFFSET));
        }
        let footer = Built::default().u64(summary_start).u64(offsets_start).u32(0).record(op::FOOTER);
        // The checksum covers everything from the summary on up to itself.
        tail.extend_from_slice(&footer[..footer.len() - 4]);
        let crc = crc32fast::hash(&tail[from..]);
        tail.extend(crc.to_le_bytes());
        tail.extend(MAGIC);
        tail
    }

    /// What the summary has, by kind.
    fn groups(&self, summary: &Summary) -> Vec<(u8, Vec<u8>)> {
        let (mut schemas, mut channels) = (Vec::new(), Vec::new());
        let mut rest = self.definitions.as_slice();
        while let Some((opcode, content, behind)) = super::record::split(rest) {
            let group = if opcode == op::SCHEMA { &mut schemas } else { &mut channels };
            group.extend(Built::default().bytes(content).record(opcode));
            rest = behind;
        }
        let (start, end) = summary.times.unwrap_or_default();
        let defined = self.channels.len();
        let statistics = Built::default()
            .u64(summary.counts.values().sum())
            .u16(u16::try_from(defined).unwrap_or(u16::MAX))
            .u32(length_u32(defined))
            .u32(summary.attachments)
            .u32(summary.metadata)
            .u32(summary.chunks)
            .u64(start)
            .u64(end)
            .list(|list| summary.counts.iter().fold(list, |list, (id, count)| list.u16(*id).u64(*count)));
        vec![
            (op::SCHEMA, schemas),
            (op::CHANNEL, channels),
            (op::STATISTICS, statistics.record(op::STATISTICS)),
            (op::CHUNK_INDEX, summary.chunk_indexes.clone()),
            (op::ATTACHMENT_INDEX, summary.attachment_indexes.clone()),
            (op::METADATA_INDEX, summary.metadata_indexes.clone()),
        ]
    }
}

impl OpenChunk {
    /// Appends the chunk and the index of its messages to `data`, which begin at `base` in the file.
    fn write(self, times: (u64, u64), base: u64, data: &mut Vec<u8>, summary: &mut Summary) -> io::Result<()> {
        let (start, end) = times;
        let packed = zstd::bulk::compress(&self.records, ZSTD_LEVEL)?;
        let unpacked_bytes = self.records.len() as u64;
        let chunk = Built::default().u64(start).u64(end).u64(unpacked_bytes).u32(crc32fast::hash(&self.records));
        let chunk = chunk.text(ZSTD).u64(packed.len() as u64).bytes(&packed).record(op::CHUNK);
        let chunk_place = (base + data.len() as u64, chunk.len() as u64);
        data.extend(chunk);
        let indexes_start = data.len();
        let mut offsets = Built::default();
        for (id, messages) in &self.index {
            offsets = offsets.u16(*id).u64(base + data.len() as u64);
            let index = Built::default()
                .u16(*id)
                .list(|list| messages.iter().fold(list, |list, (time, place)| list.u64(*time).u64(*place)));
            data.extend(index.record(op::MESSAGE_INDEX));
            *summary.counts.entry(*id).or_default() += messages.len() as u64;
        }
        let index = Built::default()
            .u64(start)
            .u64(end)
            .u64(chunk_place.0)
            .u64(chunk_place.1)
            .list(|list| list.bytes(offsets.content()))
            .u64((data.len() - indexes_start) as u64)
            .text(ZSTD)
            .u64(packed.len() as u64)
            .u64(unpacked_bytes);
        summary.chunk_indexes.extend(index.record(op::CHUNK_INDEX));
        summary.chunks += 1;
        summary.times = Some(with(Some(with(summary.times, start)), end));
        Ok(())
    }
}

/// The span of times with one more.
fn with(times: Option<(u64, u64)>, time: u64) -> (u64, u64) {
    times.map_or((time, time), |(first, last)| (first.min(time), last.max(time)))
}
