//! The other side of a link as a recording has it: answers commands as they were answered, and sends what was sent.
//!
//! A program that does what the recorded one did gets exactly what that got, entry by entry. One that does something else
//! gets the recorded samples all the same; its commands are answered as the recorded device answered the same command
//! elsewhere, and refused as not recorded where it never did.
//!
//! Errors: those of [`std::io`], by kind: `TimedOut` where the recorded line had no room, `Unsupported` for a command whose
//! answer is not recorded.

use std::collections::VecDeque;
use std::fmt;
use std::io;
use std::thread;
use std::time::{Duration, Instant};

use palpate_shared::frame::FrameReader;
use palpate_shared::wire::{Command, CommandId, CommandRead, FromDevice, NewerMessage, Outcome, Reply, Request};

use crate::trace::{Entry, Input, LinkEvent, Stamp, Traced};
use crate::wire_reader::MessageReader;

/// How fast a recording is played.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PlaySpeed {
    /// As fast as it is read.
    #[default]
    Unlimited,
    /// So many times as fast as it was recorded.
    Times(f64),
}

/// The entries of a recording, as they are played.
pub(crate) struct Tape {
    entries: Box<dyn Iterator<Item = Entry> + Send>,
    head: Option<Entry>,
    /// Where it is played to.
    stamp: (u64, u64),
    /// When it was begun, and at which recorded time.
    begun: Option<(Instant, u64)>,
    speed: PlaySpeed,
    /// Recorded ids of commands that were sent again, and those they have now.
    ids: Vec<(CommandId, CommandId)>,
    /// Commands that are not sent again, until their replies have passed.
    passed: Vec<(CommandId, Request)>,
    /// How each command was answered, last that is known.
    answers: Vec<(Request, Outcome)>,
    /// Replies to commands that were not recorded at this place.
    replies: VecDeque<Reply>,
    is_over: bool,
}

impl fmt::Debug for Tape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tape").field("stamp", &self.stamp).field("is_over", &self.is_over).finish_non_exhaustive()
    }
}

/// What a tape has next.
#[derive(Debug)]
pub(crate) enum Played {
    Bytes(Vec<u8>),
    Reply(Reply),
    Event(LinkEvent),
    Over,
}

impl Tape {
    /// A tape of these entries. `scanned` are the same: they are gone through once for the answers to commands.
    pub(crate) fn new(
        scanned: impl Iterator<Item = Entry>,
        entries: Box<dyn Iterator<Item = Entry> + Send>,
        speed: PlaySpeed,
    ) -> Self {
        let mut tape = Self {
            entries,
            head: None,
            stamp: (0, 0),
            begun: None,
            speed,
            ids: Vec::new(),
            passed: Vec::new(),
            answers: first_answers(scanned),
            replies: VecDeque::new(),
            is_over: false,
        };
        tape.head = tape.entries.next();
        tape
    }

    /// Where it is played to, for a session of this epoch.
    pub(crate) fn stamp(&self, epoch: Instant) -> Stamp {
        let (host_ns, unix_ns) = self.stamp;
        Stamp { at: epoch + Duration::from_nanos(host_ns), unix_ns }
    }

    /// Whether all of it was played, or the recorded program was stopped here.
    pub(crate) fn is_over(&self) -> bool {
        self.is_over
    }

    /// Opens the recorded link, or opens it again.
    pub(crate) fn open(&mut self) -> Result<LinkEvent, String> {
        loop {
            match self.head.as_ref().map(|entry| &entry.what) {
                Some(Traced::Event(LinkEvent::NotOpened { reason, .. })) => return Err(reason.clone()),
                None | Some(Traced::Event(LinkEvent::Interrupted)) => {
                    self.is_over = true;
                    return Err("the recording ends here".to_owned());
                }
                Some(_) => match self.advance().map(|entry| entry.what) {
                    Some(Traced::Event(event @ LinkEvent::Opened { .. })) => return Ok(event),
                    _ => continue,
                },
            }
        }
    }

    /// Whether the next thing that happened is that the link was opened, at another speed.
    pub(crate) fn opens_next(&self) -> bool {
        matches!(self.head_event(), Some(LinkEvent::Opened { .. }))
    }

    /// Sends a command: the recorded one, if it comes next, of which the recorded bytes are given: it is they that the
    /// recorded reply answers.
    pub(crate) fn send(&mut self, command: &Command) -> io::Result<Option<Vec<u8>>> {
        while matches!(self.head.as_ref().map(|entry| &entry.what), Some(Traced::Input(_))) {
            self.advance();
        }
        match self.head.as_ref().map(|entry| &entry.what) {
            Some(Traced::Sent(bytes)) => {
                if let Some(recorded) = command_in(bytes).filter(|recorded| recorded.request == command.request) {
                    let bytes = bytes.clone();
                    self.advance();
                    self.ids.retain(|(id, _)| *id != recorded.id);
                    self.ids.push((recorded.id, command.id));
                    return Ok(Some(bytes));
                }
            }
            Some(Traced::Event(LinkEvent::NotSent { reason, was_full })) => {
                let kind = if *was_full { io::ErrorKind::TimedOut } else { io::ErrorKind::BrokenPipe };
                let error = io::Error::new(kind, reason.clone());
                self.advance();
                return Err(error);
            }
            _ => {}
        }
        let known = self.answers.iter().find(|(request, _)| *request == command.request);
        let outcome = match (command.request, known) {
            // The samples come as they were recorded, whoever asked for them.
            (Request::Start | Request::Stop, _) => Outcome::Done,
            // A time of another moment would mislead.
            (Request::Ping, _) | (_, None) => return Err(io::ErrorKind::Unsupported.into()),
            (_, Some((_, outcome))) => outcome.clone(),
        };
        self.replies.push_back(Reply { id: command.id, outcome });
        Ok(None)
    }

    /// What comes next.
    pub(crate) fn receive(&mut self) -> Played {
        if let Some(reply) = self.replies.pop_front() {
            return Played::Reply(reply);
        }
        while let Some(entry) = self.advance() {
            match entry.what {
                Traced::Received(bytes) => return Played::Bytes(bytes),
                Traced::Event(LinkEvent::Interrupted) => break,
                Traced::Event(event) => return Played::Event(event),
                // Of a program that did something else.
                Traced::Sent(bytes) => {
                    self.passed.extend(command_in(&bytes).map(|command| (command.id, command.request)));
                }
                Traced::Input(_) => {}
            }
        }
        self.is_over = true;
        Played::Over
    }

    /// A message as it reads now: replies have the ids of the commands that were sent again.
    pub(crate) fn renamed(&mut self, message: FromDevice) -> FromDevice {
        let FromDevice::Reply(mut reply) = message else { return message };
        if let Some(place) = self.passed.iter().position(|(id, _)| *id == reply.id) {
            let (_, request) = self.passed.swap_remove(place);
            self.answers.retain(|(known, _)| *known != request);
            self.answers.push((request, reply.outcome.clone()));
        }
        reply.id = self.now_called(reply.id);
        FromDevice::Reply(reply)
    }

    /// The same of a message that only a newer version can read.
    pub(crate) fn renamed_newer(&self, newer: NewerMessage) -> NewerMessage {
        match newer {
            NewerMessage::Reply { id, device } => NewerMessage::Reply { id: self.now_called(id), device },
            other => other,
        }
    }

    fn now_called(&self, recorded: CommandId) -> CommandId {
        self.ids.iter().find(|(id, _)| *id == recorded).map_or(recorded, |(_, now)| *now)
    }

    /// The next event, if it is next and `wanted`.
    pub(crate) fn take_event(&mut self, wanted: impl Fn(&LinkEvent) -> bool) -> Option<LinkEvent> {
        self.head_event().filter(|event| wanted(event))?;
        match self.advance()?.what {
            Traced::Event(event) => Some(event),
            _ => None,
        }
    }

    /// The next input, if it is next.
    pub(crate) fn take_input(&mut self) -> Option<Input> {
        if !matches!(self.head.as_ref()?.what, Traced::Input(_)) {
            return None;
        }
        match self.advance()?.what {
            Traced::Input(input) => Some(input),
            _ => None,
        }
    }

    fn head_event(&self) -> Option<&LinkEvent> {
        match &self.head.as_ref()?.what {
            Traced::Event(event) => Some(event),
            _ => None,
        }
    }

    /// Goes on to the next entry, not before its time.
    fn advance(&mut self) -> Option<Entry> {
        let entry = self.head.take()?;
        self.head = self.entries.next();
        self.stamp = (entry.host_ns, entry.unix_ns);
        let (begun, first_ns) = *self.begun.get_or_insert_with(|| (Instant::now(), entry.host_ns));
        if let PlaySpeed::Times(times) = self.speed {
            let due = Duration::try_from_secs_f64(entry.host_ns.saturating_sub(first_ns) as f64 * 1e-9 / times);
            let wait = due.unwrap_or(Duration::MAX).saturating_sub(begun.elapsed());
            if !wait.is_zero() {
                thread::sleep(wait);
            }
        }
        Some(entry)
    }
}

/// The command in a frame that a host sent.
fn command_in(bytes: &[u8]) -> Option<Command> {
    let (mut frames, mut rest) = (FrameReader::new(), bytes);
    while !rest.is_empty() {
        let (taken, payload) = frames.push(rest);
        if let Some(Ok(payload)) = payload
            && let Ok(CommandRead::Command(command)) = Command::from_payload(payload)
        {
            return Some(command);
        }
        rest = &rest[taken..];
    }
    None
}

/// How each command was answered first.
fn first_answers(entries: impl Iterator<Item = Entry>) -> Vec<(Request, Outcome)> {
    let (mut reader, mut asked) = (MessageReader::default(), Vec::<(CommandId, Request)>::new());
    let mut answers = Vec::<(Request, Outcome)>::new();
    for entry in entries {
        match entry.what {
            Traced::Sent(bytes) => asked.extend(command_in(&bytes).map(|command| (command.id, command.request))),
            Traced::Received(bytes) => reader.read(&bytes, |message| {
                let FromDevice::Reply(reply) = message else { return };
                let Some(place) = asked.iter().position(|(id, _)| *id == reply.id) else { return };
                let (_, request) = asked.swap_remove(place);
                if answers.iter().all(|(known, _)| *known != request) {
                    answers.push((request, reply.outcome));
                }
            }),
            Traced::Event(_) | Traced::Input(_) => {}
        }
    }
    answers
}
