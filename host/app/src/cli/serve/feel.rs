//! The loop of `palpate serve`: samples in, the page and the observer told, and the wishes of who watches.

use std::time::Instant;

use palpate::finger::contact::Tare;
use palpate::finger::judge::{CountsJudge, Judged, Tally};
use palpate::finger::monitor::ContactMonitor;
use palpate::finger::rest::RestStretch;
use palpate_device::trace::Input;
use palpate_device::{Incoming, Session};

use super::super::calibrated::KeptTare;
use super::super::monitor::watch::{INPUTS, MARK, TARE};
use super::super::motion_source::MotionSource;
use super::super::tared::{self, Untared};
use super::Arguments;
use super::observer::Observer;
use crate::advice;
use crate::live::{self, LiveError};
use crate::recording;
use crate::screen::state::Link;
use crate::screen::terminal::Wish;
use crate::web::server::{Board, Server};
use crate::web::shown::Shown;

/// A line is due at this rate, Hz: that of the page's points.
const LINES_HZ: f64 = 125.0;

/// What feels, and tells.
pub(super) struct Feel<'a> {
    arguments: &'a Arguments,
    finger: Untared,
    server: &'a Server,
    board: Board,
    observer: Option<Observer>,
    motion: Option<MotionSource>,
    /// Segments of the motion that the observer knows, and whether it knows them all.
    told_motion: Option<(usize, bool)>,
    /// None before the first tare.
    monitor: Option<ContactMonitor>,
    resting: Option<RestStretch>,
    marks: u32,
    /// Device time to stop at, s.
    until_s: Option<f64>,
}

impl<'a> Feel<'a> {
    pub(super) fn new(
        arguments: &'a Arguments,
        finger: Untared,
        server: &'a Server,
        observer: Option<Observer>,
        motion: Option<MotionSource>,
    ) -> Self {
        recording::tared(finger.unit(), None);
        Self {
            arguments,
            finger,
            server,
            board: server.board(),
            observer,
            motion,
            told_motion: None,
            monitor: None,
            resting: None,
            marks: 0,
            until_s: None,
        }
    }

    /// Has what was felt looked at to its end; what the samples since the first tare lacked.
    pub(super) fn finish(mut self) -> Tally {
        self.observer.take().into_iter().for_each(Observer::finish);
        self.monitor.as_ref().map(ContactMonitor::tally).unwrap_or_default()
    }

    /// Feels until it is time to stop.
    pub(super) fn watch(&mut self, session: &mut Session) -> miette::Result<()> {
        let mut judge = CountsJudge::new(&self.finger.calibration);
        let (mut silent, mut failed) = (false, None);
        loop {
            let ended = live::judged(session, &mut judge, |session, incoming, judged| {
                silent &= !matches!(incoming, Incoming::Samples(_));
                self.take(session, incoming, judged).unwrap_or_else(|report| {
                    failed = Some(report);
                    false
                })
            });
            match ended {
                // The device is there and its front-end is not: it may come back as a cable does.
                Err(error @ LiveError::Silent { .. }) => {
                    if !silent {
                        note!("{error}; waiting");
                        self.board.update(|shown| shown.state.link = Link::Silent);
                    }
                    silent = true;
                }
                Err(error) => return Err(advice::report(error)),
                Ok(()) => return failed.map_or(Ok(()), Err),
            }
        }
    }

    /// Takes what came; whether to go on.
    fn take(&mut self, session: &mut Session, incoming: &Incoming, judged: Vec<Judged>) -> miette::Result<bool> {
        let Incoming::Samples(samples) = incoming else {
            crate::cli::tell(incoming);
            self.board.update(|shown| match incoming {
                Incoming::Disconnected { reason } => shown.state.link = Link::Lost { reason: reason.clone() },
                Incoming::Silent { .. } => shown.state.link = Link::Silent,
                Incoming::Restarted(_) => shown.tell("the device started anew; its settings were restored".to_owned()),
                Incoming::Event(event) => shown.tell(format!("device: {}", live::in_words(event.kind))),
                Incoming::Samples(_)
                | Incoming::Temperature(_)
                | Incoming::SlowChannels(_)
                | Incoming::Inputs(_)
                | Incoming::Force(_)
                | Incoming::Reconnected { .. } => {}
            });
            self.observe(session, &judged)?;
            if let Some(monitor) = &mut self.monitor {
                monitor.take(judged);
            }
            return Ok(true);
        };
        self.observe(session, &judged)?;
        let arrival = session.arrival().saturating_duration_since(session.epoch());
        let (counts, temperature_c) = (session.counts(), session.temperature_c());
        // At once: whoever looks in between would see samples that nobody counted.
        self.board.update(|shown| {
            shown.take_block(samples, &judged, arrival);
            (shown.state.counts, shown.state.temperature_c) = (counts, temperature_c);
        });
        self.rest(session, &judged)?;
        let lines = self.monitor.as_mut().map(|monitor| monitor.take(judged)).unwrap_or_default();
        let newest_s = samples.device_time_s(samples.counts.len().saturating_sub(1));
        let taken = session.moment(newest_s).filter(|_| !session.is_recorded());
        let latency = taken.map(|taken| Instant::now().saturating_duration_since(taken).as_secs_f64());
        self.board.update(|shown| {
            shown.take_lines(&lines, samples.period_us);
            latency.into_iter().for_each(|latency| shown.take_latency(latency));
            if let Some(recording) = &mut shown.state.recording {
                recording.goes_on = recording::goes_on();
            }
        });
        self.heed_wishes(session);
        let end_s = samples.device_time_s(samples.counts.len());
        let until_s = *self.until_s.get_or_insert(end_s + self.arguments.seconds.unwrap_or(f64::INFINITY));
        Ok(end_s < until_s)
    }

    /// Has the observer take it, and what was told of the motion meanwhile.
    fn observe(&mut self, session: &mut Session, judged: &[Judged]) -> miette::Result<()> {
        let (Some(observer), Some(motion)) = (&self.observer, &mut self.motion) else { return Ok(()) };
        motion.take(session)?;
        if let Some(known) = motion.known() {
            let told = (known.segments().len(), motion.is_complete());
            if self.told_motion.replace(told) != Some(told) {
                observer.move_so(known, motion.is_complete());
            }
        }
        let mounting = self.arguments.felt.mounting();
        observer.take(judged.iter().map(|item| item.mounted(mounting)).collect());
        Ok(())
    }

    /// Does what was asked for on the page, now or when it was recorded.
    fn heed_wishes(&mut self, session: &mut Session) {
        for line in session.recorded_inputs(INPUTS).into_iter().flatten() {
            match line.strip_prefix(TARE).map(str::parse) {
                Some(Ok(seconds)) => self.begin_tare(seconds),
                _ => self.mark(&line),
            }
        }
        for wish in self.server.wishes() {
            let mut note_input = |line: &str| {
                session.note_input(Input { source: INPUTS.to_owned(), line: Some(line.to_owned()) });
            };
            match wish {
                Wish::Tare if self.resting.is_some() => {}
                Wish::Tare => {
                    let seconds = self.arguments.felt.tare();
                    note_input(&format!("{TARE}{seconds}"));
                    self.begin_tare(seconds);
                }
                Wish::Mark => {
                    let mark = format!("{MARK} {}", self.marks + 1);
                    note_input(&mark);
                    self.mark(&mark);
                }
                // No key of the page asks for it.
                Wish::Record => {}
            }
        }
    }

    fn mark(&mut self, mark: &str) {
        self.marks += 1;
        let (number, is_kept) = (self.marks, recording::goes_on());
        note!("{mark}{}", if is_kept { "" } else { ", on the page alone: nothing is recorded (--record)" });
        self.board.update(|shown| shown.mark(number));
    }

    pub(super) fn begin_tare(&mut self, seconds: f64) {
        note!("taring for {seconds} s: keep the finger free");
        self.resting = Some(RestStretch::new(seconds));
        self.board.update(Shown::tare_begins);
        if let Some(observer) = &self.observer {
            observer.begin_anew();
        }
    }

    /// Takes samples for a tare, if one is being taken, and puts it to use once it is done.
    fn rest(&mut self, session: &Session, judged: &[Judged]) -> miette::Result<()> {
        let Some(rested) = tared::rested(&mut self.resting, judged) else { return Ok(()) };
        match rested.and_then(|readings| self.finger.tare(&readings)) {
            Ok(tare) => self.put_to_use(session, tare, false),
            Err(error) => {
                let help = advice::help(&error).map_or(String::new(), |help| format!(" ({help})"));
                let told = format!("{error}{help}");
                note!("no tare: {told}");
                self.board.update(|shown| shown.tare_refused(told));
                Ok(())
            }
        }
    }

    pub(super) fn put_to_use(&mut self, session: &Session, tare: Tare, is_from_file: bool) -> miette::Result<()> {
        let sense = self.finger.tared(tare)?;
        match &mut self.monitor {
            Some(monitor) => monitor.set_sense(sense),
            None => self.monitor = Some(ContactMonitor::new(sense, LINES_HZ.recip())),
        }
        tared::report(&tare, self.finger.unit());
        KeptTare::new(session, self.finger.unit(), tare).attach();
        self.board.update(|shown| {
            let at = (!is_from_file).then_some(shown.state.t);
            shown.tared(&tare, at);
        });
        Ok(())
    }
}
