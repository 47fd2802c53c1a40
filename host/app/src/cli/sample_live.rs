//! `palpate sample --decode PLAN -`: readings that come live, line by line, each part named as it settles.

use std::process::ExitCode;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use palpate_files::bits::{BitChange, Settled, Settling};
use palpate_files::sampling_plan::{PlanFile, in_words};
use serde_json::json;

use super::simulate_device::lines_of_input;

/// Where nothing came for so long, readings have settled. A pipe that stalls for less changes no answer.
const QUIET: Duration = Duration::from_millis(500);

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

/// Readings of standard input, to its end.
pub(super) fn decode(plan: &PlanFile, live: LiveDecoding) -> miette::Result<ExitCode> {
    let points = plan.answer.points.len();
    let lines = lines_of_input()?;
    let mut settling = Settling::new(points, live.debounce);
    let mut told = Told { plan, live, contradicted: vec![0; points] };
    let mut unusable = 0_usize;
    loop {
        let change = match lines.recv_timeout(QUIET) {
            Ok(line) => line.and_then(|line| BitChange::parse(&line, points).map_err(|error| error.to_string())),
            Err(RecvTimeoutError::Timeout) => {
                settling.settle().iter().for_each(|settled| told.tell(settled));
                continue;
            }
            Err(RecvTimeoutError::Disconnected) => break,
        };
        let settled = change.and_then(|change| match change {
            Some(change) => settling.take(&change).map_err(|error| error.to_string()),
            None => Ok(None),
        });
        match settled {
            Ok(settled) => settled.iter().for_each(|settled| told.tell(settled)),
            Err(why) => {
                unusable += 1;
                note!("a line counts for nothing: {why}");
            }
        }
    }
    settling.settle().iter().for_each(|settled| told.tell(settled));
    Ok(if unusable == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// What is told of each part.
struct Told<'a> {
    plan: &'a PlanFile,
    live: LiveDecoding,
    /// How many answers in a row each point contradicted.
    contradicted: Vec<usize>,
}

impl Told<'_> {
    fn tell(&mut self, Settled { t, readings }: &Settled) {
        // One character for each point of the plan, which is all that can be wrong.
        let Ok(decoded) = self.plan.decode(readings) else { return };
        let misread: &[usize] = decoded.contradicted.first().map_or(&[], Vec::as_slice);
        let is_one = decoded.nearest.len() == 1 && misread.len() <= self.live.correct;
        if self.live.json {
            let nearest: Vec<_> = decoded.nearest.iter().map(|&polygon| self.plan.name(polygon)).collect();
            let wrong: Vec<_> = decoded.contradicted.iter().map(|points| plus_one(points)).collect();
            let name = is_one.then(|| nearest.first().cloned()).flatten();
            say!("{}", json!({"t": t, "readings": readings, "name": name, "nearest": nearest, "misread": wrong}));
        } else if is_one || misread.is_empty() {
            say!("{t:.3} s  {readings}  {}", in_words(self.plan, &decoded));
        } else {
            say!("{t:.3} s  {readings}  nothing that is known: {}", in_words(self.plan, &decoded));
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

/// Numbers from 1, as a person counts.
fn plus_one(points: &[usize]) -> Vec<usize> {
    points.iter().map(|point| point + 1).collect()
}
