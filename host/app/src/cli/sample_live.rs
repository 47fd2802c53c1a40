//! `palpate sample --decode PLAN`: readings that come live, each part named as it settles.

use std::process::ExitCode;

use palpate::point_sampling::{Decoded, PointReading};
use palpate_files::bits::{Settled, Settling};
use palpate_files::sampling_plan::{PlanFile, in_words};
use serde_json::{Value, json};

use super::counted;
use super::device::DeviceArguments;
use super::switches::{Heard, listen};
use crate::pictures::point_sampling::Answered;

/// Answers in a row that a point contradicts before it is said to be stuck.
const STUCK_ANSWERS: usize = 3;

/// How readings are decoded as they come.
#[derive(Clone, Copy, Debug)]
pub(super) struct LiveDecoding {
    /// Readings count once none has changed for so long, s.
    pub(super) debounce: f64,
    /// A name is told with so many misread points at most.
    pub(super) correct: usize,
    pub(super) json: bool,
}

/// Readings of standard input or a board's inputs, to their end.
pub(super) fn decode(
    plan: &PlanFile,
    device: &DeviceArguments,
    live: LiveDecoding,
    drawn: Option<&mut Vec<Answered>>,
) -> miette::Result<ExitCode> {
    let points = plan.answer.points.len();
    let mut settling = Settling::new(points, live.debounce);
    let mut told = Told { plan, live, contradicted: vec![0; points], drawn };
    let is_all = listen(device, points, |heard| {
        let settled = match heard {
            Heard::Change(change) => settling.take(&change).map_err(|error| error.to_string())?,
            Heard::Until(time) => settling.until(time),
            Heard::Quiet => settling.settle(),
        };
        settled.iter().for_each(|settled| told.tell(settled));
        Ok(())
    })?;
    Ok(if is_all { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// What is told of each part.
struct Told<'a> {
    plan: &'a PlanFile,
    live: LiveDecoding,
    /// How many answers in a row each point contradicted.
    contradicted: Vec<usize>,
    /// For a picture, where one is asked for.
    drawn: Option<&'a mut Vec<Answered>>,
}

impl Told<'_> {
    fn tell(&mut self, Settled { t, readings }: &Settled) {
        // One character for each point of the plan, which is all that can be wrong.
        let Ok(decoded) = self.plan.decode(readings) else { return };
        let misread = misread(&decoded);
        let is_one = is_certain(&decoded, self.live.correct);
        if self.live.json {
            let mut told = decoded_as_json(self.plan, readings, &decoded, self.live.correct);
            told["t"] = json!(t);
            say!("{told}");
        } else if is_one || misread.is_empty() {
            say!("{t:.3} s  {readings}  {}", in_words(self.plan, &decoded));
        } else {
            say!("{t:.3} s  {readings}  nothing that is known: {}", in_words(self.plan, &decoded));
        }
        if let Some(drawn) = &mut self.drawn {
            drawn.push(picture_of(self.plan, readings, &decoded, Some(*t)));
        }
        if !is_one {
            return;
        }
        for (point, count) in self.contradicted.iter_mut().enumerate() {
            *count = if misread.contains(&point) { *count + 1 } else { 0 };
            if *count == STUCK_ANSWERS {
                note!("point {} was wrong {STUCK_ANSWERS} times in a row: is it stuck?", point + 1);
            }
        }
    }
}

/// The points that were misread, where it is the first of what is nearest.
fn misread(decoded: &Decoded) -> &[usize] {
    decoded.contradicted.first().map_or(&[], Vec::as_slice)
}

/// Whether it is one, with so many misread points at most.
fn is_certain(decoded: &Decoded, correct: usize) -> bool {
    decoded.nearest.len() == 1 && misread(decoded).len() <= correct
}

/// What readings say, for a picture; with when they settled, s.
pub(super) fn picture_of(plan: &PlanFile, readings: &str, decoded: &Decoded, t: Option<f64>) -> Answered {
    let reading = |character: char| match PointReading::from_char(character)? {
        PointReading::Covered => Some(Some(true)),
        PointReading::Free => Some(Some(false)),
        PointReading::Unreadable => Some(None),
    };
    let name = match decoded.nearest.as_slice() {
        [one] => plan.name(*one),
        several => counted(several.len(), "outline"),
    };
    let when = t.map_or(String::new(), |t| format!("{t:.3} s: "));
    Answered {
        readings: readings.chars().filter_map(reading).collect(),
        nearest: decoded.nearest.clone(),
        misread: misread(decoded).to_vec(),
        words: format!("{when}{name}"),
    }
}

/// What readings say, for a program: the name is null where it is not certain with so many misread points at most.
pub(super) fn decoded_as_json(plan: &PlanFile, readings: &str, decoded: &Decoded, correct: usize) -> Value {
    let nearest: Vec<_> = decoded.nearest.iter().map(|&polygon| plan.name(polygon)).collect();
    let wrong: Vec<Vec<_>> =
        decoded.contradicted.iter().map(|points| points.iter().map(|point| point + 1).collect()).collect();
    let name = nearest.first().filter(|_| is_certain(decoded, correct));
    json!({"readings": readings, "name": name, "nearest": nearest, "misread": wrong})
}
