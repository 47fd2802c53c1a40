//! The thread that writes a recording, so that a slow disk never keeps a session from its samples.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
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

impl Item {
    /// About as many bytes as it takes.
    fn bytes(&self) -> usize {
        match self {
            Self::Message { data, .. } | Self::Attachment { data, .. } => data.len(),
            Self::Metadata { .. } | Self::UnitOfForce(_) => 0,
        }
    }
}

/// What waits for the disk. It is taken all at once: a thread that were woken for each message would cost more than writing
/// them does.
#[derive(Debug, Default)]
struct Waiting {
    items: Vec<Item>,
    bytes: usize,
    /// Nothing more comes.
    is_over: bool,
    /// Nothing more can be written.
    has_ended: bool,
}

/// What waits, and the bell for the thread when that is much, or all.
#[derive(Debug, Default)]
struct Desk {
    waiting: Mutex<Waiting>,
    bell: Condvar,
}

impl Desk {
    /// Changes what waits.
    fn change<T>(&self, change: impl FnOnce(&mut Waiting) -> T) -> T {
        change(&mut self.waiting.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Takes what waits when that is due, much, or all; whether it is all.
    fn take(&self, due: Instant) -> (Vec<Item>, bool) {
        let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let left = due.saturating_duration_since(Instant::now());
        let is_early = |waiting: &mut Waiting| !waiting.is_over && waiting.bytes < FLUSH_BYTES;
        let taken = self.bell.wait_timeout_while(waiting, left, is_early);
        let (mut waiting, _) = taken.unwrap_or_else(PoisonError::into_inner);
        waiting.bytes = 0;
        (std::mem::take(&mut waiting.items), waiting.is_over)
    }
}

/// Says that nothing more is written when the thread ends, by a panic too: nobody else empties the desk.
struct Leaving<'a>(&'a Desk);

impl Drop for Leaving<'_> {
    fn drop(&mut self) {
        self.0.change(|waiting| *waiting = Waiting { has_ended: true, ..Waiting::default() });
    }
}

/// The way to the thread.
#[derive(Debug)]
pub(super) struct Disk {
    path: PathBuf,
    desk: Arc<Desk>,
    thread: Option<JoinHandle<Option<u64>>>,
}

impl Disk {
    /// Starts the thread.
    pub(super) fn start(writer: Writer, path: &Path) -> io::Result<Self> {
        let desk = Arc::new(Desk::default());
        let (named, at) = (path.display().to_string(), Arc::clone(&desk));
        let thread = thread::Builder::new().name("palpate recording".to_owned()).spawn(move || {
            let _leaving = Leaving(&at);
            Written { writer, channels: BTreeMap::new(), unit: "N" }.write_all(&at, &named)
        })?;
        Ok(Self { path: path.to_owned(), desk, thread: Some(thread) })
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Has an item written, after those before.
    pub(super) fn put(&mut self, item: Item) {
        let (is_much, is_too_much) = self.desk.change(|waiting| {
            // The thread has said why.
            if waiting.has_ended || waiting.is_over {
                return (false, false);
            }
            waiting.bytes += item.bytes();
            waiting.items.push(item);
            let is_too_much = waiting.items.len() > WAITING_MAX;
            // What waits is still written.
            waiting.is_over |= is_too_much;
            (is_too_much || waiting.bytes >= FLUSH_BYTES, is_too_much)
        });
        if is_much {
            self.desk.bell.notify_one();
        }
        if is_too_much {
            tracing::warn!(
                "the recording {} ends here: the disk does not keep up; the run goes on",
                self.path.display()
            );
        }
    }

    /// Whether items are still written, as far as is known.
    pub(super) fn goes_on(&self) -> bool {
        self.desk.change(|waiting| !waiting.has_ended && !waiting.is_over)
    }

    /// Waits until all is written, and says how much that is.
    pub(super) fn end(mut self) {
        self.desk.change(|waiting| waiting.is_over = true);
        self.desk.bell.notify_one();
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
    fn write_all(mut self, desk: &Desk, named: &str) -> Option<u64> {
        loop {
            let (items, is_over) = desk.take(Instant::now() + FLUSH_EVERY);
            items.into_iter().for_each(|item| self.add(item));
            match self.writer.flush() {
                Ok(size) if is_over => return Some(size),
                Ok(_) => {}
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_that_panics_has_ended() {
        let desk = Arc::new(Desk::default());
        let at = Arc::clone(&desk);
        let broken = thread::spawn(move || {
            let _leaving = Leaving(&at);
            panic!("a fault in the writer");
        });
        assert!(broken.join().is_err());
        assert!(desk.change(|waiting| waiting.has_ended));
    }
}
