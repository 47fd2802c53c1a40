//! The thread that writes a recording, so that a slow disk never keeps a session from its samples.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use palpate_files::mcap::{ChannelId, Writer};

use super::channels::Kind;

/// Between two flushes: with what writing takes on a busy machine less than a second, which is what may be lost.
const FLUSH_EVERY: Duration = Duration::from_millis(500);

/// As many bytes are flushed at once, however soon.
const FLUSH_BYTES: usize = 4 << 20;

/// Items that wait for the disk at most: a minute of everything, or some seconds at full speed of a replay.
const WAITING_MAX: usize = 1 << 17;

/// Something to write.
#[derive(Debug)]
pub(super) enum Item {
    Message {
        kind: Kind,
        unix_ns: u64,
        data: Vec<u8>,
    },
    Attachment {
        name: String,
        data: Vec<u8>,
        unix_ns: u64,
    },
    Metadata {
        name: &'static str,
        texts: BTreeMap<String, String>,
    },
    /// What forces are in from now on.
    UnitOfForce(&'static str),
}

/// The way to the thread.
#[derive(Debug)]
pub(super) struct Disk {
    path: PathBuf,
    /// `None` once it cannot be written any more.
    items: Option<SyncSender<Item>>,
    thread: Option<JoinHandle<Option<u64>>>,
}

impl Disk {
    /// Starts the thread.
    pub(super) fn start(writer: Writer, path: &Path) -> io::Result<Self> {
        let (items, received) = sync_channel(WAITING_MAX);
        let named = path.display().to_string();
        let thread = thread::Builder::new()
            .name("palpate recording".to_owned())
            .spawn(move || Written { writer, channels: BTreeMap::new(), unit: "N" }.write_all(&received, &named))?;
        Ok(Self { path: path.to_owned(), items: Some(items), thread: Some(thread) })
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Has an item written, after those before.
    pub(super) fn put(&mut self, item: Item) {
        let Some(items) = &self.items else { return };
        match items.try_send(item) {
            Ok(()) => {}
            // The thread has said why.
            Err(TrySendError::Disconnected(_)) => self.items = None,
            Err(TrySendError::Full(_)) => {
                tracing::warn!(
                    "the recording {} ends here: the disk does not keep up; the run goes on",
                    self.path.display()
                );
                self.items = None;
            }
        }
    }

    /// Whether items are still written, as far as is known.
    pub(super) fn goes_on(&self) -> bool {
        self.items.is_some()
    }

    /// Waits until all is written, and says how much that is.
    pub(super) fn end(mut self) {
        self.items = None;
        // A panic in the thread has been reported by it.
        let size = self.thread.take().and_then(|thread| thread.join().ok()).flatten();
        if let Some(bytes) = size {
            // Not to the recording, which has ended.
            crate::messages::note(format_args!("recorded {:.2} MB in {}", bytes as f64 * 1e-6, self.path.display()));
        }
    }
}

/// What the thread has.
struct Written {
    writer: Writer,
    channels: BTreeMap<Kind, ChannelId>,
    unit: &'static str,
}

impl Written {
    /// Writes until nothing more is to come; the file's size, or `None` where it ended before.
    fn write_all(mut self, items: &Receiver<Item>, named: &str) -> Option<u64> {
        let mut due = Instant::now() + FLUSH_EVERY;
        loop {
            let is_over = match items.recv_timeout(due.saturating_duration_since(Instant::now())) {
                Ok(item) => {
                    self.add(item);
                    false
                }
                Err(RecvTimeoutError::Timeout) => false,
                Err(RecvTimeoutError::Disconnected) => true,
            };
            if !is_over && Instant::now() < due && self.writer.waiting_bytes() < FLUSH_BYTES {
                continue;
            }
            match self.writer.flush() {
                Ok(size) if is_over => return Some(size),
                Ok(_) => due = Instant::now() + FLUSH_EVERY,
                Err(error) => {
                    tracing::warn!(
                        "the recording {named} ends here: {error}; what was written is whole, the run goes on"
                    );
                    return None;
                }
            }
        }
    }

    fn add(&mut self, item: Item) {
        match item {
            Item::Message { kind, unix_ns, data } => {
                let (writer, unit) = (&mut self.writer, self.unit);
                let channel = *self.channels.entry(kind).or_insert_with(|| writer.channel(&kind.channel(unit)));
                writer.message(channel, unix_ns, unix_ns, &data);
            }
            Item::Attachment { name, data, unix_ns } => {
                self.writer.attachment(&name, "application/toml", &data, unix_ns);
            }
            Item::Metadata { name, texts } => self.writer.metadata(name, &texts),
            Item::UnitOfForce(unit) => self.unit = unit,
        }
    }
}
