//! The loop of `palpate monitor`: samples in, lines or a screen out, and the wishes of the person who watches.
//!
//! A wish has its place among the samples, so that a recording's replay does the same at the same sample.

use std::ffi::OsString;
use std::io;
use std::path::Path;
use std::time::{Instant, SystemTime};

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate::finger::contact::Tare;
use palpate::finger::judge::{CountsJudge, Judged, Tally};
use palpate::finger::monitor::{ContactMonitor, MonitorLine};
use palpate::finger::rest::RestStretch;
use palpate::finger::sense::FingerSense;
use palpate_device::trace::Input;
use palpate_device::{Incoming, Session};
use palpate_shared::wire::Request;

use super::super::calibrated::KeptTare;
use super::super::latency::Latency;
use super::super::replay;
use super::super::tared::{self, Untared};
use super::lines::{as_json, in_words, tell, write_line};
use super::{Arguments, SCREEN_HZ};
use crate::advice::{self, Advise as _};
use crate::live::{self, LiveError};
use crate::recording;
use crate::screen::state::{Link, Recorded, TareInUse};
use crate::screen::terminal::{Screen, Wish};

/// Where wishes are among what a recorded program took in beside the link.
pub(crate) const INPUTS: &str = "monitor";

/// The wish for a new tare; over how many seconds follows.
pub(crate) const TARE: &str = "tare ";

/// What a mark begins with; its number follows.
pub(crate) const MARK: &str = "mark";

/// A finger with its tare, and what it takes to tare it again.
pub(super) struct Tared {
    finger: Untared,
    sense: FingerSense,
}

impl Tared {
    /// This finger with this tare.
    pub(super) fn new(finger: Untared, tare: Tare) -> miette::Result<Self> {
        let sense = finger.tared(tare)?;
        Ok(Self { finger, sense })
    }

    fn unit(&self) -> &'static str {
        self.finger.unit()
    }
}

/// How watching ended.
pub(super) enum Ended {
    /// It is time, or somebody stopped it.
    Over,
    /// Nobody reads the lines any more.
    NobodyReads,
    /// To go on with a recording.
    ToRecord,
}

/// What watches.
pub(super) struct Watch<'a> {
    arguments: &'a Arguments,
    tared: Tared,
    monitor: ContactMonitor,
    judge: CountsJudge,
    screen: Option<Screen>,
    /// The stretch of which a new tare is made.
    resting: Option<RestStretch>,
    marks: u32,
    latency: Latency,
    /// Device time to stop at, s.
    until_s: Option<f64>,
    wants_recording: bool,
}

impl<'a> Watch<'a> {
    /// Watches this finger, on the screen if there is one.
    pub(super) fn new(
        arguments: &'a Arguments,
        tared: Tared,
        judge: CountsJudge,
        screen: Option<Screen>,
    ) -> miette::Result<Self> {
        let hz = if screen.is_some() { SCREEN_HZ } else { arguments.print_hz };
        let period_s = if hz > 0.0 { hz.recip() } else { 0.0 };
        let monitor = ContactMonitor::new(tared.sense.clone(), period_s);
        let watch = Self {
            arguments,
            tared,
            monitor,
            judge,
            screen,
            resting: None,
            marks: 0,
            latency: Latency::default(),
            until_s: None,
            wants_recording: false,
        };
        watch.show_tare(arguments.tare_file.is_some());
        Ok(watch)
    }

    /// What the samples watched lacked.
    pub(super) fn tally(&self) -> Tally {
        self.monitor.tally()
    }

    /// Watches until it is time to stop.
    pub(super) fn watch(&mut self, session: &mut Session) -> miette::Result<Ended> {
        let mut written = Ok(());
        let mut silent = false;
        let mut failed = None;
        loop {
            // The judge is lent apart from what takes what it says.
            let mut judge = self.judge.clone();
            let ended = live::judged(session, &mut judge, |session, incoming, judged| {
                silent &= !matches!(incoming, Incoming::Samples(_));
                match self.take(session, incoming, judged) {
                    Ok(goes_on) => goes_on,
                    Err(Failed::Written(error)) => {
                        written = Err(error);
                        false
                    }
                    Err(Failed::Otherwise(report)) => {
                        failed = Some(report);
                        false
                    }
                }
            });
            self.judge = judge;
            match ended {
                // The device is there and its front-end is not: it may come back as a cable does.
                Err(error @ LiveError::Silent { .. }) => {
                    if !silent {
                        note!("{error}; waiting");
                        self.show(|state| state.link = Link::Silent);
                    }
                    silent = true;
                }
                Err(error) => return Err(advice::report(error)),
                Ok(()) => break,
            }
        }
        if let Some(report) = failed {
            return Err(report);
        }
        match written {
            // Whoever read the lines has seen enough.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(Ended::NobodyReads),
            other => other.into_diagnostic()?,
        }
        if std::mem::take(&mut self.wants_recording) {
            return Ok(Ended::ToRecord);
        }
        if let Some(latency) = self.latency.in_words() {
            note!("latency {latency}");
        }
        Ok(Ended::Over)
    }

    /// Takes what came; whether to go on.
    fn take(&mut self, session: &mut Session, incoming: &Incoming, judged: Vec<Judged>) -> Result<bool, Failed> {
        let Incoming::Samples(samples) = incoming else {
            // On the screen inputs have their place.
            if self.screen.is_none() || !matches!(incoming, Incoming::Inputs(_)) {
                tell(self.arguments.json, incoming);
            }
            self.show(|state| match incoming {
                Incoming::Disconnected { reason } => state.link = Link::Lost { reason: reason.clone() },
                Incoming::Silent { .. } => state.link = Link::Silent,
                _ => {}
            });
            self.monitor.take(judged);
            return Ok(true);
        };
        if self.arguments.latency {
            self.latency.take(session, samples, Instant::now());
        }
        let arrival = session.arrival().saturating_duration_since(session.epoch());
        self.show(|state| state.take_block(samples, &judged, arrival));
        self.rest(session, &judged).map_err(Failed::Otherwise)?;
        let lines = self.monitor.take(judged);
        self.write(session, &lines).map_err(Failed::Written)?;
        self.heed_wishes(session);
        let end_s = samples.device_time_s(samples.counts.len());
        let until_s = *self.until_s.get_or_insert(end_s + self.arguments.seconds.unwrap_or(f64::INFINITY));
        Ok(end_s < until_s && !self.wants_recording)
    }

    /// Lines as a person or a program reads them, or on the screen.
    fn write(&self, session: &Session, lines: &[MonitorLine]) -> io::Result<()> {
        if self.screen.is_some() {
            self.show(|state| {
                lines.iter().for_each(|line| state.take_line(line));
                (state.counts, state.temperature_c) = (session.counts(), session.temperature_c());
                state.inputs = session.inputs().map(|inputs| inputs.levels);
                if let Some(recording) = &mut state.recording {
                    recording.goes_on = recording::goes_on();
                }
            });
            return Ok(());
        }
        let unit = self.tared.unit();
        lines.iter().try_for_each(|line| {
            write_line(&if self.arguments.json {
                as_json(session, line, unit).to_string()
            } else {
                in_words(session, line, unit)
            })
        })
    }

    fn show(&self, change: impl FnOnce(&mut crate::screen::state::State)) {
        if let Some(screen) = &self.screen {
            screen.update(change);
        }
    }

    fn show_tare(&self, is_from_file: bool) {
        let tare = *self.tared.sense.tare();
        self.show(|state| {
            state.tare = Some(TareInUse::new(&tare, (!is_from_file).then_some(state.t)));
            state.is_taring = false;
        });
    }

    /// Does what was asked for by a key, now or when it was recorded.
    fn heed_wishes(&mut self, session: &mut Session) {
        for line in session.recorded_inputs(INPUTS).into_iter().flatten() {
            match line.strip_prefix(TARE).map(str::parse) {
                Some(Ok(seconds)) => self.begin_tare(seconds),
                _ => note!("{line}"),
            }
        }
        for wish in self.screen.as_ref().map(Screen::wishes).unwrap_or_default() {
            let mut note_input = |line: &str| {
                session.note_input(Input { source: INPUTS.to_owned(), line: Some(line.to_owned()) });
            };
            match wish {
                Wish::Tare if self.resting.is_some() => {}
                Wish::Tare => {
                    let seconds = self.arguments.tare;
                    note_input(&format!("{TARE}{seconds}"));
                    self.begin_tare(seconds);
                }
                Wish::Mark if !recording::goes_on() => note!("nothing is recorded: r begins a recording"),
                Wish::Mark => {
                    self.marks += 1;
                    let mark = format!("{MARK} {}", self.marks);
                    note_input(&mark);
                    note!("{mark}");
                    let marks = self.marks;
                    self.show(|state| state.recording.iter_mut().for_each(|recording| recording.marks = marks));
                }
                Wish::Record if recording::is_active() => {
                    recording::end();
                    self.show(|state| state.recording = None);
                }
                Wish::Record if session.is_recorded() => note!("a recording is played: --record keeps it again"),
                Wish::Record => self.wants_recording = true,
            }
        }
    }

    fn begin_tare(&mut self, seconds: f64) {
        note!("taring for {seconds} s: keep the finger free");
        self.resting = Some(RestStretch::new(seconds));
        self.show(|state| state.is_taring = true);
    }

    /// Takes samples for a new tare, if one is being taken, and puts it to use once it is done.
    fn rest(&mut self, session: &mut Session, judged: &[Judged]) -> miette::Result<()> {
        let Some(rested) = tared::rested(&mut self.resting, judged) else { return Ok(()) };
        match rested.and_then(|readings| self.tared.finger.tare(&readings)) {
            Ok(tare) => self.put_to_use(session, tare),
            Err(error) => {
                note!("no new tare, the one before stays: {error}");
                self.show(|state| state.is_taring = false);
                Ok(())
            }
        }
    }

    fn put_to_use(&mut self, session: &mut Session, tare: Tare) -> miette::Result<()> {
        if self.arguments.device_force {
            let tare = super::device_force::matrix(&self.tared.finger.calibration, &tare)?.tare;
            session.request(Request::SetForceTare { tare }).advised()?;
        }
        self.tared.sense = self.tared.finger.tared(tare)?;
        self.monitor.set_sense(self.tared.sense.clone());
        tared::report(&tare, self.tared.unit());
        let kept = KeptTare::new(session, self.tared.unit(), tare);
        kept.attach();
        self.show_tare(false);
        match &self.arguments.keep_tare {
            Some(file) => kept.save(file),
            None => Ok(()),
        }
    }

    /// The device opened anew, with a recording that has all of it, the tare included.
    pub(super) fn recorded_from_here(&mut self, session: Session) -> miette::Result<Session> {
        drop(session);
        let begun = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_secs();
        let file = format!("monitor-{begun}.mcap");
        let words = recording::command_line();
        recording::begin_as(Path::new(&file), false, &with_tare_file(&words))?;
        let mut session = self.arguments.finger.device.open(true)?;
        self.arguments.finger.calibration.require(&session).wrap_err("the device came back otherwise")?;
        KeptTare::new(&session, self.tared.unit(), *self.tared.sense.tare()).attach();
        live::start(&mut session).advised()?;
        session.ping().advised()?;
        self.tared.finger.record(&self.tared.sense);
        self.judge = CountsJudge::new(&self.tared.finger.calibration);
        self.monitor.set_sense(self.tared.sense.clone());
        (self.resting, self.marks) = (None, 0);
        note!("recording in {file}");
        self.show(|state| {
            (state.is_taring, state.t) = (false, 0.0);
            state.tare.iter_mut().for_each(|tare| tare.at = None);
            state.history.clear();
            state.recording = Some(Recorded { file, since: None, marks: 0, goes_on: true });
        });
        Ok(session)
    }
}

/// Why what came could not be taken.
enum Failed {
    Written(io::Error),
    Otherwise(miette::Report),
}

/// The command whose replay begins with the tare that is attached, instead of taking one.
fn with_tare_file(words: &[OsString]) -> Vec<OsString> {
    let words: Vec<_> = words.iter().map(|word| word.to_string_lossy().into_owned()).collect();
    let kept = replay::without(&words, &["--tare", "--tare-file", "--average-ms", "--seconds"], &[]);
    let tare = ["--tare-file".to_owned(), KeptTare::ATTACHED.to_owned()];
    kept.into_iter().chain(tare).map(OsString::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_begun_by_a_key_is_played_with_its_tare() {
        let words = |line: &str| line.split(' ').map(OsString::from).collect::<Vec<_>>();
        let told = with_tare_file(&words("palpate monitor -d sim:7 --tare 2 --average-ms=5 --tare-anyway"));
        assert_eq!(told, words("palpate monitor -d sim:7 --tare-anyway --tare-file tare.toml"));
    }
}
