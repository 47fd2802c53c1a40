//! A run kept as it happens: everything that the session went by, and beside it what was made of it, for other tools.
//!
//! `channels`: what is in the file; `cdr`: how; `disk`: the thread that writes it; `derived`: forces, contacts, poses; `play`:
//! a recording as a device. The container is [`palpate_files::mcap`].
//!
//! A process records one run, so the recording is the process's, as its terminal is. Whatever keeps it from being written
//! is told once and ends the recording; the run goes on.

mod cdr;
mod channels;
mod derived;
mod disk;
pub(crate) mod play;

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate_device::trace::{Entry, Recorder, Stamp, Traced};
use palpate_files::mcap::Writer;
use palpate_shared::wire::PROTOCOL;
use sha2::{Digest as _, Sha256};

use cdr::Cdr;
use channels::Kind;
use disk::{Disk, Item};

pub(crate) use derived::{Believed, believed, sensing, taken, tared};

/// Version of what is in a recording, as `palpate` reads it back.
const FORMAT: &str = "1";

/// Name of the metadata that say what was run.
const RUN: &str = "palpate";

/// Name of the metadata that say what an attachment is.
const ATTACHED: &str = "palpate attachment";

/// Files that are longer are not attached, bytes.
const ATTACHED_BYTES_MAX: usize = 64 << 20;

/// The recording of this process.
static ACTIVE: Mutex<Option<Recording>> = Mutex::new(None);

/// The words of the command that is run.
static COMMAND_LINE: Mutex<Vec<OsString>> = Mutex::new(Vec::new());

/// A recording that is being written.
#[derive(Debug)]
struct Recording {
    disk: Disk,
    derived: derived::Derived,
}

fn active() -> MutexGuard<'static, Option<Recording>> {
    ACTIVE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps the command line, for the recording that it may ask for.
pub(crate) fn remember_command_line(words: &[OsString]) {
    *COMMAND_LINE.lock().unwrap_or_else(PoisonError::into_inner) = words.to_vec();
}

/// The words of the command that is run.
pub(crate) fn command_line() -> Vec<OsString> {
    COMMAND_LINE.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Begins a recording in a file that does not exist yet.
pub(crate) fn begin(path: &Path, is_full: bool) -> miette::Result<()> {
    begin_as(path, is_full, &command_line())
}

/// The same of a run that these words play again.
pub(crate) fn begin_as(path: &Path, is_full: bool, words: &[OsString]) -> miette::Result<()> {
    let version = env!("CARGO_PKG_VERSION");
    let mut writer = Writer::create(path, &format!("palpate {version}"))
        .map_err(|error| match error.kind() {
            std::io::ErrorKind::AlreadyExists => {
                miette::miette!(help = "choose another name", "it exists already and is never overwritten")
            }
            _ => miette::miette!("{error}"),
        })
        .wrap_err_with(|| format!("cannot record in {}", path.display()))?;
    let words: Vec<_> = words.iter().map(|word| word.to_string_lossy()).collect();
    let folder = std::env::current_dir().map(|folder| folder.display().to_string()).unwrap_or_default();
    let run = BTreeMap::from([
        ("format".to_owned(), FORMAT.to_owned()),
        ("version".to_owned(), version.to_owned()),
        ("protocol".to_owned(), PROTOCOL.to_string()),
        ("command_line".to_owned(), serde_json::to_string(&words).into_diagnostic()?),
        ("folder".to_owned(), folder),
        ("system".to_owned(), format!("{} {}", std::env::consts::OS, std::env::consts::ARCH)),
    ]);
    writer.metadata(RUN, &run);
    let disk = Disk::start(writer, path).into_diagnostic()?;
    *active() = Some(Recording { disk, derived: derived::Derived::new(is_full) });
    Ok(())
}

/// The file of the recording that is being written.
pub(crate) fn file() -> Option<PathBuf> {
    active().as_ref().map(|recording| recording.disk.path().to_owned())
}

/// Whether a recording is being written.
pub(crate) fn is_active() -> bool {
    active().is_some()
}

/// Whether what is recorded is still being written.
pub(crate) fn goes_on() -> bool {
    active().as_ref().is_some_and(|recording| recording.disk.goes_on())
}

/// Ends the recording, if there is one: all of it is on the disk then, and it is told how much.
pub(crate) fn end() {
    let Some(recording) = active().take() else { return };
    recording.disk.end();
}

/// What a session's entries go to; `None` without a recording.
pub(crate) fn recorder() -> Option<Box<dyn Recorder>> {
    active().is_some().then(|| Box::new(Tap) as Box<dyn Recorder>)
}

/// Takes a session's entries down in the process's recording.
#[derive(Debug)]
struct Tap;

impl Recorder for Tap {
    fn take(&mut self, entry: Entry) {
        let (host_ns, unix_ns) = (entry.host_ns, entry.unix_ns);
        if let Some(recording) = active().as_mut() {
            recording.derived.newest_ns = unix_ns;
        }
        let (kind, data) = match entry.what {
            Traced::Received(bytes) => (Kind::Received, Cdr::new().u64(host_ns).bytes(&bytes).finish()),
            Traced::Sent(bytes) => (Kind::Sent, Cdr::new().u64(host_ns).bytes(&bytes).finish()),
            Traced::Event(event) => (Kind::Events, timed(host_ns, &event)),
            Traced::Input(input) => (Kind::Inputs, timed(host_ns, &input)),
        };
        put(kind, unix_ns, data);
    }
}

/// An object with the host's time.
fn timed(host_ns: u64, told: &impl serde::Serialize) -> Vec<u8> {
    let mut object = serde_json::json!({ "host_ns": host_ns });
    if let (Some(object), Ok(serde_json::Value::Object(told))) = (object.as_object_mut(), serde_json::to_value(told)) {
        object.extend(told);
    }
    object.to_string().into_bytes()
}

/// Has a message written.
fn put(kind: Kind, unix_ns: u64, data: Vec<u8>) {
    if let Some(recording) = active().as_mut() {
        recording.disk.put(Item::Message { kind, unix_ns, data });
    }
}

/// Attaches what was read from a file; `role` says what for.
pub(crate) fn attach(role: &str, path: &Path, bytes: &[u8]) {
    let Some(recording) = &mut *active() else { return };
    let name = path.display().to_string();
    if bytes.len() > ATTACHED_BYTES_MAX {
        tracing::warn!("{name} is not attached to the recording: it is longer than {} MiB", ATTACHED_BYTES_MAX >> 20);
        return;
    }
    let facts = BTreeMap::from([
        ("role".to_owned(), role.to_owned()),
        ("name".to_owned(), name.clone()),
        ("bytes".to_owned(), bytes.len().to_string()),
        ("sha256".to_owned(), checksum(bytes)),
    ]);
    recording.disk.put(Item::Metadata { name: ATTACHED, texts: facts });
    recording.disk.put(Item::Attachment { name, data: bytes.to_vec(), unix_ns: Stamp::now().unix_ns });
}

/// SHA-256 in hexadecimal digits.
fn checksum(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().fold(String::new(), |mut digits, byte| {
        // Writing to a string cannot fail.
        let _ = write!(digits, "{byte:02x}");
        digits
    })
}

/// Levels of `rcl_interfaces/msg/Log`.
#[derive(Clone, Copy, Debug)]
pub(crate) enum LogLevel {
    Info = 20,
    Error = 40,
}

/// Keeps what the person is told.
pub(crate) fn log(level: LogLevel, text: &str) {
    if active().is_none() {
        return;
    }
    let now = Stamp::now().unix_ns;
    let message = Cdr::new().time(now).u8(level as u8).text("palpate").text(text).text("").text("").u32(0);
    put(Kind::Log, now, message.finish());
}
