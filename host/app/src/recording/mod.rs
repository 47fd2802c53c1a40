//! A run kept as it happens: everything that the session went by, and beside it what was made of it, for other tools.
//!
//! `channels`: what is in the file; `disk`: the thread that writes it; `derived`: forces, contacts, poses; `live`: these
//! for who looks on with Foxglove's protocol, where that is built in; `play`: a recording as a device; `kept`: what was made of one, to look
//! back at. The container is [`palpate_files::mcap`], messages are of its `cdr`.
//!
//! A process records one run, so the recording is the process's, as its terminal is. Whatever keeps it from being written
//! is told once and ends the recording; the run goes on.

mod channels;
mod derived;
mod disk;
pub(crate) mod kept;
#[cfg(feature = "foxglove")]
mod live;
pub(crate) mod play;

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Instant;

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate_device::trace::{Entry, Input, Recorder, Stamp, Traced};
use palpate_files::mcap::Writer;
use palpate_files::mcap::cdr::Cdr;
use palpate_shared::wire::PROTOCOL;
use sha2::{Digest as _, Sha256};

use channels::Kind;
use disk::{Disk, Item};

pub(crate) use derived::{Believed, Seen, believed, rolled, sensing, taken, tared};

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

/// What is made of a run: for a file, for who looks on, or for both.
#[derive(Debug)]
struct Recording {
    disk: Option<Disk>,
    #[cfg(feature = "foxglove")]
    live: Option<live::Live>,
    derived: derived::Derived,
}

impl Recording {
    fn new(is_full: bool) -> Self {
        Self {
            disk: None,
            #[cfg(feature = "foxglove")]
            live: None,
            derived: derived::Derived::new(is_full),
        }
    }

    /// Whether anybody may look on.
    fn is_looked_on(&self) -> bool {
        #[cfg(feature = "foxglove")]
        let is = self.live.is_some();
        #[cfg(not(feature = "foxglove"))]
        let is = false;
        is
    }

    /// Has a message written, and sent to who looks on.
    fn put(&mut self, kind: Kind, unix_ns: u64, data: Vec<u8>) {
        #[cfg(feature = "foxglove")]
        if let Some(live) = &mut self.live {
            live.put(kind, unix_ns, &data);
        }
        self.write(Item::Message { kind, unix_ns, data });
    }

    /// Has an item written.
    fn write(&mut self, item: Item) {
        if let Some(disk) = &mut self.disk {
            disk.put(item);
        }
    }
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
    let mut active = active();
    let recording = active.get_or_insert_with(|| Recording::new(is_full));
    recording.derived.is_full = is_full;
    recording.disk = Some(disk);
    Ok(())
}

/// From now on who looks on with Foxglove's protocol is sent what a recording has, but for the bytes of the link; the port is
/// told, of which 0 takes one that is free.
#[cfg(feature = "foxglove")]
pub(crate) fn look_on(at: std::net::SocketAddr) -> miette::Result<u16> {
    let (live, port) = live::Live::start(at)?;
    active().get_or_insert_with(|| Recording::new(false)).live = Some(live);
    Ok(port)
}

/// The file of the recording that is being written.
pub(crate) fn file() -> Option<PathBuf> {
    active().as_ref()?.disk.as_ref().map(|disk| disk.path().to_owned())
}

/// Whether a recording is being written.
pub(crate) fn is_active() -> bool {
    active().as_ref().is_some_and(|recording| recording.disk.is_some())
}

/// Whether what is recorded is still being written.
pub(crate) fn goes_on() -> bool {
    active().as_ref().and_then(|recording| recording.disk.as_ref()).is_some_and(Disk::goes_on)
}

/// Ends the recording, if there is one: all of it is on the disk then, and it is told how much.
pub(crate) fn end() {
    let mut active = active();
    let disk = active.as_mut().and_then(|recording| recording.disk.take());
    if !active.as_ref().is_some_and(Recording::is_looked_on) {
        *active = None;
    }
    // The thread that writes may want it.
    drop(active);
    if let Some(disk) = disk {
        disk.end();
    }
}

/// What a session's entries go to; `None` without a recording.
pub(crate) fn recorder() -> Option<Box<dyn Recorder>> {
    is_active().then(|| Box::new(Tap) as Box<dyn Recorder>)
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

/// When what came in without a session began to.
static EPOCH: OnceLock<Instant> = OnceLock::new();

/// Notes what came in where there is no session that would.
pub(crate) fn note_input(source: &str, line: Option<&str>) {
    if !is_active() {
        return;
    }
    let now = Stamp::now();
    let host_ns = now.since(*EPOCH.get_or_init(|| now.at));
    let input = Input { source: source.to_owned(), line: line.map(str::to_owned) };
    Tap.take(Entry { host_ns, unix_ns: now.unix_ns, what: Traced::Input(input) });
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
        recording.put(kind, unix_ns, data);
    }
}

/// Attaches what was read from a file; `role` says what for.
pub(crate) fn attach(role: &str, path: &Path, bytes: &[u8]) {
    let mut active = active();
    let Some(recording) = active.as_mut().filter(|recording| recording.disk.is_some()) else { return };
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
    recording.write(Item::Metadata { name: ATTACHED, texts: facts });
    recording.write(Item::Attachment { name, data: bytes.to_vec(), unix_ns: Stamp::now().unix_ns });
}

/// SHA-256 in hexadecimal digits.
pub(crate) fn checksum(bytes: &[u8]) -> String {
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
