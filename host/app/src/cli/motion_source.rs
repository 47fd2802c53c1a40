//! How the finger moves: a file, or segments from standard input as they come.

use std::path::Path;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Point2;
use palpate::pushing::finger_motion::{FingerMotion, RisingSegment};
use palpate_device::Session;
use palpate_device::trace::Input;
use palpate_files::motion::{self, MotionFileError};

use super::read::{lines_of_stdin, read};

/// Where the finger's motion comes from.
#[derive(Debug)]
pub(super) enum MotionSource {
    Whole(FingerMotion),
    Streamed { lines: Told, motion: Option<FingerMotion>, open: bool },
}

/// Where lines come from.
#[derive(Debug)]
pub(super) enum Told {
    /// Standard input: number and text of each.
    Now(Receiver<Result<(u64, String), String>>),
    /// A recording has them at their places among the samples, so many so far.
    Before(u64),
}

/// What lines of a motion are called in a recording.
const MOTION: &str = "motion";

impl MotionSource {
    /// Reads a motion file, or begins to listen to standard input; in a recording, to what was told there.
    pub(super) fn open(path: &Path, is_recorded: bool) -> miette::Result<Self> {
        if path != Path::new("-") {
            return Ok(Self::Whole(read(path, motion::parse)?));
        }
        if is_recorded {
            return Ok(Self::Streamed { lines: Told::Before(0), motion: None, open: true });
        }
        let (sender, lines) = channel();
        let reader = move || {
            for line in lines_of_stdin() {
                let told = match line {
                    Ok((_, Ok(text))) if text.trim().is_empty() => continue,
                    Ok((number, text)) => {
                        text.map(|text| (number, text)).map_err(|why| format!("line {number}: {why}"))
                    }
                    Err(error) => Err(error.to_string()),
                };
                if sender.send(told).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("motion".to_owned()).spawn(reader).into_diagnostic()?;
        Ok(Self::Streamed { lines: Told::Now(lines), motion: None, open: true })
    }

    /// Takes the segments that have come, and has them noted at their place among the samples.
    pub(super) fn take(&mut self, session: &mut Session) -> miette::Result<()> {
        let Self::Streamed { lines, motion, open: open @ true } = self else { return Ok(()) };
        let lines = match lines {
            Told::Now(lines) => lines,
            Told::Before(taken) => {
                for line in session.recorded_inputs(MOTION) {
                    *taken += 1;
                    match line {
                        Some(line) => add(motion, Ok((*taken, line)))?,
                        None => *open = false,
                    }
                }
                return Ok(());
            }
        };
        let mut note = |line: Option<String>| session.note_input(Input { source: MOTION.to_owned(), line });
        loop {
            match lines.try_recv() {
                Ok(told) => {
                    if let Ok((_, line)) = &told {
                        note(Some(line.clone()));
                    }
                    add(motion, told)?;
                }
                Err(TryRecvError::Empty) => return Ok(()),
                Err(TryRecvError::Disconnected) => {
                    note(None);
                    *open = false;
                    return Ok(());
                }
            }
        }
    }

    /// Waits for all segments: the forces are there already.
    pub(super) fn read_all(&mut self) -> miette::Result<()> {
        let Self::Streamed { lines, motion, open } = self else { return Ok(()) };
        if let Told::Now(lines) = lines {
            lines.iter().try_for_each(|told| add(motion, told))?;
        }
        *open = false;
        Ok(())
    }

    /// The motion as far as it is told.
    pub(super) fn known(&self) -> Option<&FingerMotion> {
        match self {
            Self::Whole(motion) => Some(motion),
            Self::Streamed { motion, .. } => motion.as_ref(),
        }
    }

    /// The same, given away.
    pub(super) fn into_known(self) -> Option<FingerMotion> {
        match self {
            Self::Whole(motion) => Some(motion),
            Self::Streamed { motion, .. } => motion,
        }
    }

    /// Whether no more segments are to come.
    pub(super) fn is_complete(&self) -> bool {
        !matches!(self, Self::Streamed { open: true, .. })
    }
}

/// Adds the segment of a line, of which the number is told too.
fn add(motion: &mut Option<FingerMotion>, told: Result<(u64, String), String>) -> miette::Result<()> {
    let parsed = |(number, text): (u64, String)| {
        let segment =
            serde_json::from_str::<RisingSegment>(&text).map_err(|error| format!("line {number}: {error}"))?;
        Ok((number, segment))
    };
    let segment = told.and_then(parsed).map_err(MotionFileError::Text);
    let added = segment.and_then(|(number, segment)| match motion {
        // Of lines the first is 1, of segments 0.
        Some(motion) => {
            Ok(motion.append_rising(usize::try_from(number).unwrap_or(usize::MAX).saturating_sub(1), segment)?)
        }
        None => Ok(FingerMotion::rising(Point2::origin(), &[segment]).map(|first| *motion = Some(first))?),
    });
    added.into_diagnostic().wrap_err("cannot use the finger's motion on standard input")
}
