//! A recording as a device: `file:RUN.mcap`.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use miette::WrapErr as _;
use palpate_device::session::SessionOptions;
use palpate_device::trace::{Entry, Traced};
use palpate_device::{Address, PlaySpeed, Session};
use palpate_files::mcap::cdr::CdrFields;
use palpate_files::mcap::{Content, McapError, Reader};
use serde::Deserialize;

use super::channels::Kind;
use super::{ATTACHED, FORMAT, RUN, checksum};
use crate::advice::Advise as _;
use crate::progress;

/// A file that was attached to a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Attached {
    /// What for: `calibration`, `part`, `motion`, `tare`.
    pub(crate) role: String,
    /// Its name on the command line.
    pub(crate) name: String,
    /// What was in it.
    pub(crate) data: Vec<u8>,
}

/// What a recording says of its run.
#[derive(Clone, Debug, Default)]
pub(crate) struct Run {
    /// The words of its command.
    pub(crate) command_line: Vec<String>,
    /// The files that it read, in order.
    pub(crate) attached: Vec<Attached>,
}

/// The files that came with the recording that this process plays.
static ATTACHMENTS: Mutex<Vec<Attached>> = Mutex::new(Vec::new());

/// The newest file of this role that came with the recording that is played.
pub(crate) fn attachment(role: &str) -> Option<Attached> {
    let attachments = ATTACHMENTS.lock().unwrap_or_else(PoisonError::into_inner);
    attachments.iter().rev().find(|attached| attached.role == role).cloned()
}

/// Goes through a recording for what it says of its run.
pub(crate) fn run_of(path: &Path) -> miette::Result<Run> {
    let command_line = command_line(path).wrap_err_with(|| cannot(path))?;
    let mut scan = Scan::open(path).map_err(not_read).wrap_err_with(|| cannot(path))?;
    scan.by_ref().for_each(drop);
    Ok(Run { command_line, attached: scan.attached })
}

/// Opens a recording as a device.
pub(crate) fn open(path: &Path, options: SessionOptions, speed: PlaySpeed) -> miette::Result<Session> {
    let address = Address::Recording(path.display().to_string());
    command_line(path).wrap_err_with(|| cannot(path))?;
    let opened = || Scan::open(path).map_err(not_read).wrap_err_with(|| cannot(path));
    let (mut scan, mut played) = (opened()?, opened()?);
    scan.is_told = true;
    played.shown = path.metadata().ok().map(|about| (about.len(), 0));
    let session = Session::open_recorded(&address, options, scan.by_ref(), Box::new(played), speed, super::recorder())
        .advised()?;
    *ATTACHMENTS.lock().unwrap_or_else(PoisonError::into_inner) = scan.attached;
    Ok(session)
}

/// What the recorded program took in beside the link from one source, line by line and `None` where it ended, as fast as it
/// is asked for or so many times as fast as it came.
pub(crate) fn inputs(
    path: &Path,
    source: &'static str,
    times: Option<f64>,
) -> miette::Result<impl Iterator<Item = Option<String>> + use<>> {
    command_line(path).wrap_err_with(|| cannot(path))?;
    let mut scan = Scan::open(path).map_err(not_read).wrap_err_with(|| cannot(path))?;
    scan.is_told = true;
    let begun = Instant::now();
    let mut first_ns = None;
    Ok(scan.filter_map(move |entry| {
        let Traced::Input(input) = entry.what else { return None };
        let since = entry.host_ns.saturating_sub(*first_ns.get_or_insert(entry.host_ns));
        if let Some(times) = times {
            let due = begun + Duration::from_nanos(since).div_f64(times);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        (input.source == source).then_some(input.line)
    }))
}

fn cannot(path: &Path) -> String {
    format!("cannot play the recording {}", path.display())
}

fn not_read(error: McapError) -> miette::Report {
    match &error {
        McapError::NotMcap => miette::miette!(help = "give a file that --record or `palpate record` wrote", "{error}"),
        _ => miette::miette!("{error}"),
    }
}

/// The words of the recorded command, where this version reads the recording.
fn command_line(path: &Path) -> miette::Result<Vec<String>> {
    let mut scan = Scan::open(path).map_err(not_read)?;
    let told = loop {
        match scan.next_content() {
            Ok(Some(Found::Metadata(name, texts))) if name == RUN => break texts,
            Ok(Some(Found::Metadata(..) | Found::Attachment(..))) => {}
            // It comes before everything else.
            Ok(Some(Found::Entry(_)) | None) | Err(_) => {
                let help = "give a file that --record or `palpate record` wrote";
                return Err(miette::miette!(help = help, "it is no recording of palpate"));
            }
        }
    };
    match told.get("format") {
        Some(format) if format == FORMAT => {}
        other => {
            let format = other.map_or("unknown", String::as_str);
            return Err(miette::miette!(
                help = "update palpate",
                "its format is {format}, and this version reads format {FORMAT}"
            ));
        }
    }
    Ok(told.get("command_line").and_then(|words| serde_json::from_str(words).ok()).unwrap_or_default())
}

/// The attachment, as the facts before it describe it.
fn attached(facts: &[BTreeMap<String, String>], name: String, data: Vec<u8>) -> Option<Attached> {
    let sum = checksum(&data);
    let fits =
        |facts: &&BTreeMap<String, String>| facts.get("name") == Some(&name) && facts.get("sha256") == Some(&sum);
    let Some(facts) = facts.iter().rev().find(fits) else {
        tracing::warn!("the recording's attachment {name} does not have the checksum that was recorded with it");
        return None;
    };
    Some(Attached { role: facts.get("role").cloned().unwrap_or_default(), name, data })
}

/// Goes through a recording: gives its entries, and keeps what else is found.
#[derive(Debug)]
struct Scan {
    reader: Reader<BufReader<File>>,
    path: PathBuf,
    facts: Vec<BTreeMap<String, String>>,
    attached: Vec<Attached>,
    /// Whether damage is told.
    is_told: bool,
    /// Size of the file where it is told how far it is played, bytes; and how far it was told last.
    shown: Option<(u64, u64)>,
}

/// What is found in a recording.
enum Found {
    Entry(Entry),
    Attachment(String, Vec<u8>),
    Metadata(String, BTreeMap<String, String>),
}

/// An event or input with its time.
#[derive(Deserialize)]
struct Timed<T> {
    host_ns: u64,
    #[serde(flatten)]
    told: T,
}

impl Scan {
    fn open(path: &Path) -> Result<Self, McapError> {
        let (reader, path) = (Reader::open(path)?, path.to_owned());
        Ok(Self { reader, path, facts: Vec::new(), attached: Vec::new(), is_told: false, shown: None })
    }

    fn next_content(&mut self) -> Result<Option<Found>, McapError> {
        while let Some(content) = self.reader.next_content()? {
            match content {
                Content::Attachment { name, data, .. } => return Ok(Some(Found::Attachment(name, data))),
                Content::Metadata { name, texts } => return Ok(Some(Found::Metadata(name, texts))),
                Content::Message { channel, log_time_ns, data, .. } => {
                    let kind = self.reader.channel(channel).and_then(|channel| Kind::of(&channel.topic));
                    if let Some(entry) = kind.and_then(|kind| entry(kind, log_time_ns, &data)) {
                        return Ok(Some(Found::Entry(entry)));
                    }
                }
            }
        }
        Ok(None)
    }
}

impl Scan {
    /// Shows how far it is played, where that is wanted: once a chunk.
    fn show(&mut self) {
        if let Some((size, told)) = &mut self.shown
            && *told != self.reader.position()
        {
            *told = self.reader.position();
            progress::reached(*told / 1000, *size / 1000, "replaying, kB");
        }
    }
}

impl Iterator for Scan {
    type Item = Entry;

    fn next(&mut self) -> Option<Entry> {
        loop {
            match self.next_content() {
                Ok(Some(Found::Entry(entry))) => {
                    self.show();
                    return Some(entry);
                }
                Ok(Some(Found::Metadata(name, texts))) if name == ATTACHED => self.facts.push(texts),
                Ok(Some(Found::Metadata(..))) => {}
                Ok(Some(Found::Attachment(name, data))) => self.attached.extend(attached(&self.facts, name, data)),
                Ok(None) => return None,
                Err(error) => {
                    // What is whole before the damage is played.
                    if self.is_told {
                        tracing::warn!("{}: {error}; it is played up to there", self.path.display());
                    }
                    return None;
                }
            }
        }
    }
}

/// The host's time and the bytes of a `palpate_msgs/msg/LinkBytes`; `None` if it is none.
fn link_bytes(message: &[u8]) -> Option<(u64, &[u8])> {
    let mut fields = CdrFields::of(message)?;
    Some((fields.u64()?, fields.bytes()?))
}

/// The entry in a message.
fn entry(kind: Kind, unix_ns: u64, data: &[u8]) -> Option<Entry> {
    let (host_ns, what) = match kind {
        Kind::Received => link_bytes(data).map(|(host_ns, bytes)| (host_ns, Traced::Received(bytes.to_vec())))?,
        Kind::Sent => link_bytes(data).map(|(host_ns, bytes)| (host_ns, Traced::Sent(bytes.to_vec())))?,
        Kind::Events => {
            let timed: Timed<_> = serde_json::from_slice(data).ok()?;
            (timed.host_ns, Traced::Event(timed.told))
        }
        Kind::Inputs => {
            let timed: Timed<_> = serde_json::from_slice(data).ok()?;
            (timed.host_ns, Traced::Input(timed.told))
        }
        _ => return None,
    };
    Some(Entry { host_ns, unix_ns, what })
}
