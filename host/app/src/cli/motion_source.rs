//! How the finger moves: a file, or segments from standard input as they come.

use std::path::Path;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Point2;
use palpate::pushing::finger_motion::{FingerMotion, Segment};
use palpate_files::lines::Unusable;
use palpate_files::motion::{self, MotionFileError};

use super::read::{lines_of_stdin, read};

/// Where the finger's motion comes from.
#[derive(Debug)]
pub(super) enum MotionSource {
    Whole(FingerMotion),
    Streamed { lines: Receiver<Result<Segment, MotionFileError>>, motion: Option<FingerMotion>, open: bool },
}

impl MotionSource {
    /// Reads a motion file, or begins to listen to standard input.
    pub(super) fn open(path: &Path) -> miette::Result<Self> {
        if path != Path::new("-") {
            return Ok(Self::Whole(read(path, motion::parse)?));
        }
        let (sender, lines) = channel();
        let reader = move || {
            for line in lines_of_stdin() {
                let segment = match line {
                    Ok((_, Ok(text))) if text.trim().is_empty() => continue,
                    Ok((number, text)) => segment(text).map_err(|why| format!("line {number}: {why}")),
                    Err(error) => Err(error.to_string()),
                };
                let segment = segment.map_err(MotionFileError::Text);
                if sender.send(segment).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("motion".to_owned()).spawn(reader).into_diagnostic()?;
        Ok(Self::Streamed { lines, motion: None, open: true })
    }

    /// Takes the segments that have come.
    pub(super) fn take(&mut self) -> miette::Result<()> {
        let Self::Streamed { lines, motion, open } = self else { return Ok(()) };
        loop {
            match lines.try_recv() {
                Ok(segment) => add(motion, segment)?,
                Err(TryRecvError::Empty) => return Ok(()),
                Err(TryRecvError::Disconnected) => {
                    *open = false;
                    return Ok(());
                }
            }
        }
    }

    /// Waits for all segments: the forces are there already.
    pub(super) fn read_all(&mut self) -> miette::Result<()> {
        let Self::Streamed { lines, motion, open } = self else { return Ok(()) };
        for segment in lines.iter() {
            add(motion, segment)?;
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

/// The segment of a line.
fn segment(line: Result<String, Unusable>) -> Result<Segment, String> {
    let text = line.map_err(|why| why.to_string())?;
    serde_json::from_str(&text).map_err(|error| error.to_string())
}

fn add(motion: &mut Option<FingerMotion>, segment: Result<Segment, MotionFileError>) -> miette::Result<()> {
    let added = segment.and_then(|segment| match motion {
        Some(motion) => Ok(motion.append(segment)?),
        None => Ok(FingerMotion::new(Point2::origin(), &[segment]).map(|first| *motion = Some(first))?),
    });
    added.into_diagnostic().wrap_err("cannot use the finger's motion on standard input")
}
