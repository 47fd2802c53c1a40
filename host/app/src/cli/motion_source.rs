//! How the finger moves: a file, or segments or measured places from standard input as they come.

use std::path::Path;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Point2;
use palpate::pushing::finger_motion::{FingerMotion, RisingSegment};
use palpate::pushing::streamed_path::{StreamError, StreamedPath};
use palpate_device::Session;
use palpate_device::trace::Input;
use palpate_files::motion::{self, MotionFileError};
use palpate_files::recordings::ReadError;
use palpate_files::recordings::path::{PathRows, RecordedPath};

use super::read::{lines_of_stdin, read};
use super::told_tables::TableArguments;
use crate::advice::Advise as _;

/// What tells how the finger moves.
#[derive(Clone, Copy, Debug)]
pub(super) enum AskedMotion<'a> {
    /// A motion file, or - for segments from standard input.
    Told(&'a Path),
    /// Measured places, known to so much, m, one standard deviation: a table, or - for its rows from standard input.
    Measured { places: &'a Path, sigma: f64 },
}

/// Where the finger's motion comes from.
#[derive(Debug)]
pub(super) enum MotionSource {
    Whole(FingerMotion),
    /// Of measured places that are all there.
    Measured(Box<StreamedPath>),
    Streamed {
        lines: Told,
        motion: Growing,
        open: bool,
    },
}

/// A motion of which lines tell.
#[derive(Debug)]
pub(super) enum Growing {
    /// Each line a segment.
    Segments(Option<FingerMotion>),
    /// Each line a row of a table of places.
    Places { path: Box<StreamedPath>, rows: PathRows },
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
    /// Reads a file, or begins to listen to standard input; in a recording, to what was told there.
    pub(super) fn open(asked: AskedMotion<'_>, tables: &TableArguments, is_recorded: bool) -> miette::Result<Self> {
        let (path, motion) = match asked {
            AskedMotion::Told(path) => (path, Growing::Segments(None)),
            AskedMotion::Measured { places, sigma } => {
                let path = Box::new(StreamedPath::new(sigma));
                (places, Growing::Places { path, rows: PathRows::new(tables.mapping()) })
            }
        };
        if path != Path::new("-") {
            return match motion {
                Growing::Segments(_) => Ok(Self::Whole(read(path, motion::parse)?)),
                Growing::Places { path: streamed, .. } => {
                    let named = || format!("cannot use the places in {}", path.display());
                    Ok(Self::Measured(measured(streamed, tables.places(path)?).wrap_err_with(named)?))
                }
            };
        }
        if is_recorded {
            return Ok(Self::Streamed { lines: Told::Before(0), motion, open: true });
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
        Ok(Self::Streamed { lines: Told::Now(lines), motion, open: true })
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
                        Some(line) => motion.add(Ok((*taken, line)))?,
                        None => {
                            *open = false;
                            motion.end()?;
                        }
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
                    motion.add(told)?;
                }
                Err(TryRecvError::Empty) => return Ok(()),
                Err(TryRecvError::Disconnected) => {
                    note(None);
                    *open = false;
                    return motion.end();
                }
            }
        }
    }

    /// Waits for all lines: the forces are there already.
    pub(super) fn read_all(&mut self) -> miette::Result<()> {
        let Self::Streamed { lines, motion, open } = self else { return Ok(()) };
        if let Told::Now(lines) = lines {
            lines.iter().try_for_each(|told| motion.add(told))?;
        }
        *open = false;
        motion.end()
    }

    /// The motion as far as it is told.
    pub(super) fn known(&self) -> Option<&FingerMotion> {
        match self {
            Self::Whole(motion) | Self::Streamed { motion: Growing::Segments(Some(motion)), .. } => Some(motion),
            _ => self.path()?.motion(),
        }
    }

    /// The measured places that tell it, if such do.
    pub(super) fn path(&self) -> Option<&StreamedPath> {
        match self {
            Self::Measured(path) | Self::Streamed { motion: Growing::Places { path, .. }, .. } => Some(path),
            Self::Whole(_) | Self::Streamed { motion: Growing::Segments(_), .. } => None,
        }
    }

    /// Whether no more is to come.
    pub(super) fn is_complete(&self) -> bool {
        !matches!(self, Self::Streamed { open: true, .. })
    }

    /// Where nothing tells how the finger moves.
    pub(super) fn lacks(&self) -> miette::Report {
        match self.path() {
            Some(_) => miette::miette!(
                help = "are they in m, or does their header name the unit? Do they go on until the push is over?",
                "the measured places do not show the finger moving"
            ),
            None => miette::miette!(
                help = "write at least one segment, such as {{\"seconds\": 0.3, \"acceleration\": [0.15, 0]}}",
                "standard input told nothing of the finger's motion"
            ),
        }
    }
}

/// The motion of a table of places.
fn measured(mut path: Box<StreamedPath>, table: RecordedPath) -> miette::Result<Box<StreamedPath>> {
    still(&table)?;
    let mut places = table.times.into_iter().zip(table.places);
    places.try_for_each(|(time, place)| path.take(time, place)).into_diagnostic()?;
    path.end().into_diagnostic()?;
    Ok(path)
}

/// Refuses a wrist that turns.
fn still(table: &RecordedPath) -> miette::Result<()> {
    match &table.angles {
        None => Ok(()),
        Some(_) => Err(miette::miette!(
            help = "leave the column phi out where the wrist keeps still, or --method where it turns",
            "what is followed is pushed by a finger that does not turn"
        )),
    }
}

impl Growing {
    /// Adds what a line says, of which the number is told too.
    fn add(&mut self, told: Result<(u64, String), String>) -> miette::Result<()> {
        match self {
            Self::Segments(motion) => {
                add_segment(motion, told).into_diagnostic().wrap_err("cannot use the finger's motion on standard input")
            }
            Self::Places { path, rows } => {
                let (number, line) = told.map_err(|why| miette::miette!("cannot read standard input: {why}"))?;
                add_row(path, rows.read(usize::try_from(number).unwrap_or(usize::MAX), &line), number)
            }
        }
    }

    /// No more is told.
    fn end(&mut self) -> miette::Result<()> {
        match self {
            Self::Segments(_) => Ok(()),
            Self::Places { path, .. } => path.end().into_diagnostic(),
        }
    }
}

/// Adds the segment of a line.
fn add_segment(motion: &mut Option<FingerMotion>, told: Result<(u64, String), String>) -> Result<(), MotionFileError> {
    let parsed = |(number, text): (u64, String)| {
        let segment =
            serde_json::from_str::<RisingSegment>(&text).map_err(|error| format!("line {number}: {error}"))?;
        Ok((number, segment))
    };
    let (number, segment) = told.and_then(parsed).map_err(MotionFileError::Text)?;
    match motion {
        // Of lines the first is 1, of segments 0.
        Some(motion) => {
            Ok(motion.append_rising(usize::try_from(number).unwrap_or(usize::MAX).saturating_sub(1), segment)?)
        }
        None => Ok(FingerMotion::rising(Point2::origin(), &[segment]).map(|first| *motion = Some(first))?),
    }
}

/// Adds the place of a line; one that is none is left out, as in a file.
fn add_row(path: &mut StreamedPath, row: Result<Option<RecordedPath>, ReadError>, number: u64) -> miette::Result<()> {
    let row = match row {
        Ok(Some(row)) => row,
        Ok(None) => return Ok(()),
        Err(error @ ReadError::AllBad { .. }) => {
            tracing::warn!("a place on standard input is left out: {error}");
            return Ok(());
        }
        Err(error) => return Err(error).advised().wrap_err("cannot use the places on standard input"),
    };
    still(&row)?;
    for (time, place) in row.times.into_iter().zip(row.places) {
        match path.take(time, place) {
            Err(error @ StreamError::OutOfOrder { .. }) => {
                tracing::warn!("line {number} of the places on standard input is left out: {error}");
            }
            taken => taken.into_diagnostic().wrap_err("cannot use the places on standard input")?,
        }
    }
    Ok(())
}
