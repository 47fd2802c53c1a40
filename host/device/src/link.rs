//! The line under a session: bytes to messages with their time of arrival, and a note of everything that went over it.
//!
//! Live, a thread reads the transport without pause and stamps what comes, so that neither a slow consumer nor the operating
//! system's small buffers lose samples; decoding is done where the messages are taken, frame by frame, so that what is noted
//! is in the order in which it was gone by. Played, a tape takes the place of transport and clock.

use std::fmt;
use std::io::{self, Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use palpate_shared::frame::{DELIMITER, FRAME_MAX, encode};
use palpate_shared::wire::{Command, FromDevice, NewerMessage, ProtocolVersion};
use serde::Serialize;

use crate::error::{LinkError, Opened};
use crate::simulated::{Pace, SimulatedDevice};
use crate::tape::{Played, Tape};
use crate::trace::{Entry, Input, LinkEvent, Recorder, Stamp, Traced, nanoseconds};
use crate::transport::Transport;
use crate::transport::address::Address;
use crate::wire_reader::{MessageReader, ReaderCounts};

/// Pieces that wait for a slow consumer before the reading thread stops reading: four seconds of blocks at 4 kHz, where
/// each comes by itself. What then comes is lost, and counted, on the device; memory stays bounded.
const WAITING_MAX: usize = 2048;

/// Most bytes of a piece: forty blocks.
const PIECE_BYTES: usize = 4096;

/// What was heard.
#[derive(Debug)]
pub(crate) enum Heard {
    Message(Box<FromDevice>, Stamp),
    /// A message that only a newer version can read.
    Newer(NewerMessage, Stamp),
    Broken(String),
    /// Nothing within the wait; never on a tape.
    Nothing,
    /// What the recorded session made of its clock.
    Recorded(LinkEvent),
    /// The tape is over.
    Over,
}

/// What the reading thread hands on.
#[derive(Debug)]
enum Arrival {
    Bytes(Vec<u8>, Stamp),
    Broken(String),
}

/// What the reading thread shares with the session.
#[derive(Debug, Default)]
struct Shared {
    stop: AtomicBool,
    /// When the line was last looked at and held nothing. A thread that had no time to look has not found silence.
    found_nothing: Mutex<Option<Instant>>,
}

/// A message as bytes of the line, with its delimiter.
fn framed(message: &impl Serialize) -> io::Result<Vec<u8>> {
    let mut buffer = [0; FRAME_MAX + 1];
    let frame = encode(message, &mut buffer).map_err(|_| io::ErrorKind::InvalidInput)?;
    Ok(frame.to_vec())
}

/// An open transport with its reading thread.
#[derive(Debug)]
struct Line {
    transport: Transport,
    /// `None` only while it is being closed: the thread must not wait for room that nobody makes.
    arrivals: Option<Receiver<Arrival>>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    /// The piece that is being taken, and how far it is.
    piece: (Vec<u8>, usize),
    piece_came: Stamp,
}

/// Where bytes come from.
enum Way {
    Live(Option<Line>),
    Taped { tape: Box<Tape>, is_open: bool },
}

/// The line under a session.
pub(crate) struct Link {
    epoch: Instant,
    way: Way,
    reader: MessageReader,
    /// Reader counts of lines that were closed.
    closed: ReaderCounts,
    recorder: Option<Box<dyn Recorder>>,
    /// Entries that are not to be noted yet.
    held: Option<Vec<Entry>>,
    /// Time 0 of a simulated device in real time, on the session's clock, ns.
    simulated_epoch_ns: Option<i64>,
}

impl fmt::Debug for Link {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut told = f.debug_struct("Link");
        match &self.way {
            Way::Live(line) => told.field("line", line),
            Way::Taped { tape, .. } => told.field("tape", tape),
        };
        told.field("recorder", &self.recorder).finish_non_exhaustive()
    }
}

impl Link {
    /// A link that is not open yet.
    pub(crate) fn live(epoch: Instant, recorder: Option<Box<dyn Recorder>>) -> Self {
        Self::over(epoch, Way::Live(None), recorder)
    }

    /// The same, played.
    pub(crate) fn taped(epoch: Instant, tape: Tape, recorder: Option<Box<dyn Recorder>>) -> Self {
        Self::over(epoch, Way::Taped { tape: Box::new(tape), is_open: false }, recorder)
    }

    fn over(epoch: Instant, way: Way, recorder: Option<Box<dyn Recorder>>) -> Self {
        let (reader, closed) = (MessageReader::default(), ReaderCounts::default());
        Self { epoch, way, reader, closed, recorder, held: None, simulated_epoch_ns: None }
    }

    /// Opens it.
    pub(crate) fn open(
        &mut self,
        address: &Address,
        baud: u32,
        simulated: Option<&SimulatedDevice>,
    ) -> Result<u32, LinkError> {
        self.abandon();
        let opened = match &mut self.way {
            Way::Taped { tape, is_open } => {
                let opened = tape.open().map_err(|reason| gone(address, reason))?;
                *is_open = true;
                opened
            }
            Way::Live(line) => {
                let transport = Transport::open(address, baud, simulated.map(SimulatedDevice::connect))?;
                *line = Some(Line::start(transport).map_err(|source| LinkError::Open {
                    address: address.to_string(),
                    what: Opened::Line,
                    source,
                })?);
                let in_real_time = simulated.filter(|device| device.pace() == Pace::RealTime);
                let simulated_epoch_ns = in_real_time.map(|device| signed_ns(device.epoch(), self.epoch));
                LinkEvent::Opened { baud, simulated_epoch_ns }
            }
        };
        let LinkEvent::Opened { baud, simulated_epoch_ns } = opened else { return Ok(baud) };
        self.simulated_epoch_ns = simulated_epoch_ns;
        self.note(opened);
        Ok(baud)
    }

    /// Closes it; whether it was open.
    pub(crate) fn close(&mut self) -> bool {
        let was_open = self.is_open();
        self.closed = self.closed.and(self.reader.counts());
        self.abandon();
        was_open
    }

    /// Closes it, and forgets what its reader counted: nobody has answered.
    pub(crate) fn abandon(&mut self) {
        match &mut self.way {
            Way::Live(line) => *line = None,
            Way::Taped { is_open, .. } => *is_open = false,
        }
        self.reader = MessageReader::default();
    }

    pub(crate) fn is_open(&self) -> bool {
        match &self.way {
            Way::Live(line) => line.is_some(),
            Way::Taped { is_open, .. } => *is_open,
        }
    }

    /// Whether it is played.
    pub(crate) fn is_taped(&self) -> bool {
        matches!(self.way, Way::Taped { .. })
    }

    /// Whether there is nothing more to play.
    pub(crate) fn is_over(&self) -> bool {
        matches!(&self.way, Way::Taped { tape, .. } if tape.is_over())
    }

    /// Whether the recorded link was then tried at another speed.
    pub(crate) fn opens_next(&self) -> bool {
        matches!(&self.way, Way::Taped { tape, .. } if tape.opens_next())
    }

    pub(crate) fn epoch(&self) -> Instant {
        self.epoch
    }

    /// Time 0 of a simulated device in real time.
    pub(crate) fn simulated_epoch(&self) -> Option<Instant> {
        let ns = self.simulated_epoch_ns?;
        let distance = Duration::from_nanos(ns.unsigned_abs());
        if ns < 0 { self.epoch.checked_sub(distance) } else { self.epoch.checked_add(distance) }
    }

    /// Now, on the session's clock: on a tape, where it is played to.
    pub(crate) fn now(&self) -> Instant {
        self.stamp().at
    }

    fn stamp(&self) -> Stamp {
        match &self.way {
            Way::Live(_) => Stamp::now(),
            Way::Taped { tape, .. } => tape.stamp(self.epoch),
        }
    }

    /// What the readers of this link's lines have counted, of what was taken.
    pub(crate) fn counts(&self) -> ReaderCounts {
        self.closed.and(self.reader.counts())
    }

    /// What was unusable since the line was opened.
    pub(crate) fn unusable_since_opened(&self) -> u64 {
        self.reader.counts().unusable()
    }

    pub(crate) fn other_protocol(&self) -> Option<ProtocolVersion> {
        self.reader.other_protocol()
    }

    /// When the line was last looked at and held nothing.
    pub(crate) fn found_nothing(&self) -> Option<Instant> {
        let Way::Live(Some(line)) = &self.way else { return None };
        *line.shared.found_nothing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn send(&mut self, command: &Command) -> io::Result<()> {
        // The leading delimiter ends whatever noise the device may have received before.
        let bytes = [&[DELIMITER][..], &framed(command)?].concat();
        let sent = match &mut self.way {
            Way::Live(Some(line)) => {
                line.transport.write_all(&bytes).and_then(|()| line.transport.flush()).map(|()| bytes)
            }
            Way::Live(None) => Err(io::ErrorKind::NotConnected.into()),
            Way::Taped { tape, .. } => tape.send(command).map(|recorded| recorded.unwrap_or(bytes)),
        };
        match sent {
            Ok(bytes) => {
                self.take_down(self.stamp(), || Traced::Sent(bytes));
                Ok(())
            }
            Err(error) => {
                let was_full = error.kind() == io::ErrorKind::TimedOut;
                self.note(LinkEvent::NotSent { reason: error.to_string(), was_full });
                Err(error)
            }
        }
    }

    /// The next message, or what happened instead.
    pub(crate) fn receive(&mut self, wait: Duration) -> Heard {
        let deadline = Instant::now() + wait;
        loop {
            let (bytes, came) = match &mut self.way {
                Way::Live(None) => return Heard::Nothing,
                Way::Live(Some(line)) => match line.next_frame(deadline) {
                    Ok(Some(frame)) => frame,
                    Ok(None) => return Heard::Nothing,
                    Err(reason) => {
                        self.note(LinkEvent::Broken { reason: reason.clone() });
                        return Heard::Broken(reason);
                    }
                },
                Way::Taped { tape, .. } => {
                    let played = tape.receive();
                    let came = tape.stamp(self.epoch);
                    match played {
                        Played::Bytes(bytes) => (bytes, came),
                        Played::Reply(reply) => {
                            let message = FromDevice::Reply(reply);
                            // The recorded device sent it elsewhere, or never: here it is as if it did.
                            if let Ok(bytes) = framed(&message) {
                                self.take_down(came, || Traced::Received(bytes));
                            }
                            return Heard::Message(Box::new(message), came);
                        }
                        Played::Event(LinkEvent::Broken { reason }) => {
                            self.note(LinkEvent::Broken { reason: reason.clone() });
                            return Heard::Broken(reason);
                        }
                        Played::Event(event) => return Heard::Recorded(event),
                        Played::Over => return Heard::Over,
                    }
                }
            };
            let mut read = None;
            self.reader.read_each(&bytes, |message| read = Some(message));
            self.take_down(came, || Traced::Received(bytes));
            match (read, &mut self.way) {
                (None, _) => {}
                (Some(Ok(message)), Way::Live(_)) => return Heard::Message(Box::new(message), came),
                (Some(Ok(message)), Way::Taped { tape, .. }) => {
                    return Heard::Message(Box::new(tape.renamed(message)), came);
                }
                (Some(Err(newer)), Way::Live(_)) => return Heard::Newer(newer, came),
                (Some(Err(newer)), Way::Taped { tape, .. }) => return Heard::Newer(tape.renamed_newer(newer), came),
            }
        }
    }

    /// The recorded event that decides here, if it is next.
    pub(crate) fn recorded(&mut self, wanted: impl Fn(&LinkEvent) -> bool) -> Option<LinkEvent> {
        match &mut self.way {
            Way::Taped { tape, .. } => tape.take_event(wanted),
            Way::Live(_) => None,
        }
    }

    /// The inputs that the recorded program took here.
    pub(crate) fn recorded_inputs(&mut self) -> Vec<Input> {
        let Way::Taped { tape, .. } = &mut self.way else { return Vec::new() };
        std::iter::from_fn(|| tape.take_input()).collect()
    }

    /// Has an event noted.
    pub(crate) fn note(&mut self, event: LinkEvent) {
        self.take_down(self.stamp(), || Traced::Event(event));
    }

    /// Has an input noted.
    pub(crate) fn note_input(&mut self, input: Input) {
        self.take_down(self.stamp(), || Traced::Input(input));
    }

    /// From now on holds entries back, until [`Link::let_go`].
    pub(crate) fn hold(&mut self) {
        self.held = Some(Vec::new());
    }

    /// The entries that were held back so far.
    pub(crate) fn held(&mut self) -> Vec<Entry> {
        self.held.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Notes entries at once again; the last that were held back.
    pub(crate) fn let_go(&mut self) -> Vec<Entry> {
        self.held.take().unwrap_or_default()
    }

    /// Has entries noted that were held back.
    pub(crate) fn note_held(&mut self, entries: Vec<Entry>) {
        if let Some(recorder) = &mut self.recorder {
            entries.into_iter().for_each(|entry| recorder.take(entry));
        }
    }

    fn take_down(&mut self, stamp: Stamp, what: impl FnOnce() -> Traced) {
        let Some(recorder) = &mut self.recorder else { return };
        let entry = Entry { host_ns: stamp.since(self.epoch), unix_ns: stamp.unix_ns, what: what() };
        match &mut self.held {
            Some(held) => held.push(entry),
            None => recorder.take(entry),
        }
    }
}

/// From `epoch` to `at`, which may come before it; ns.
fn signed_ns(at: Instant, epoch: Instant) -> i64 {
    let later = i64::try_from(nanoseconds(at.saturating_duration_since(epoch))).unwrap_or(i64::MAX);
    let earlier = i64::try_from(nanoseconds(epoch.saturating_duration_since(at))).unwrap_or(i64::MAX);
    later - earlier
}

/// The error for a device that is not there.
pub(crate) fn gone(address: &Address, reason: String) -> LinkError {
    LinkError::Unplugged { address: address.to_string(), reason }
}

impl Line {
    fn start(transport: Transport) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let (sender, arrivals) = sync_channel(WAITING_MAX);
        let (mut reading_end, for_thread) = (transport.second()?, Arc::clone(&shared));
        let thread = std::thread::Builder::new()
            .name("palpate link".to_owned())
            .spawn(move || read_until_stopped(&mut reading_end, &for_thread, &sender))?;
        let (arrivals, thread) = (Some(arrivals), Some(thread));
        Ok(Self { transport, arrivals, shared, thread, piece: (Vec::new(), 0), piece_came: Stamp::now() })
    }

    /// The bytes up to the next delimiter, or to the end of what came together; `None` if none came in time.
    fn next_frame(&mut self, deadline: Instant) -> Result<Option<(Vec<u8>, Stamp)>, String> {
        let ended = || "the reading thread ended".to_owned();
        if self.piece.1 == self.piece.0.len() {
            let arrivals = self.arrivals.as_ref().ok_or_else(ended)?;
            match arrivals.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(Arrival::Bytes(bytes, came)) => (self.piece, self.piece_came) = ((bytes, 0), came),
                Ok(Arrival::Broken(reason)) => return Err(reason),
                Err(RecvTimeoutError::Timeout) => return Ok(None),
                Err(RecvTimeoutError::Disconnected) => return Err(ended()),
            }
        }
        let (bytes, taken) = &mut self.piece;
        let rest = &bytes[*taken..];
        let length = rest.iter().position(|byte| *byte == DELIMITER).map_or(rest.len(), |place| place + 1);
        let frame = rest[..length].to_vec();
        *taken += length;
        Ok(Some((frame, self.piece_came)))
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.arrivals = None;
        if let Some(thread) = self.thread.take() {
            // A panic in the thread has been reported by it.
            let _ = thread.join();
        }
    }
}

/// The reading thread: bytes, stamped.
fn read_until_stopped(transport: &mut Transport, shared: &Shared, sender: &SyncSender<Arrival>) {
    let mut buffer = [0; PIECE_BYTES];
    while !shared.stop.load(Ordering::Relaxed) {
        let arrival = match transport.read(&mut buffer) {
            Ok(length) => Arrival::Bytes(buffer[..length].to_vec(), Stamp::now()),
            Err(error) if error.kind() == io::ErrorKind::TimedOut => {
                *shared.found_nothing.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
                continue;
            }
            Err(error) => {
                // The session may be gone already; then nobody needs to know.
                let _ = sender.send(Arrival::Broken(error.to_string()));
                return;
            }
        };
        if sender.send(arrival).is_err() {
            return;
        }
    }
}
