//! Switches that change, live: lines `T ID 0|1` of standard input, or the digital inputs of a board.
//!
//! Of a board, input 0 is switch 1. Units: s, of the lines' own clock or the device's.

use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use palpate_device::Incoming;
use palpate_device::session::InputLevels;
use palpate_files::bits::BitChange;

use super::device::DeviceArguments;
use super::simulate_device::lines_of_input;
use crate::advice::Advise as _;
use crate::live::{self, interrupt};
use crate::recording;

/// Where nothing came for so long, readings have settled. A pipe that stalls for less changes no answer.
const QUIET: Duration = Duration::from_millis(500);

/// A board's inputs.
pub(super) const BOARD_INPUTS: usize = 8;

/// What is heard of switches.
#[derive(Clone, Copy, Debug)]
pub(super) enum Heard {
    /// One that changed.
    Change(BitChange),
    /// Nothing changed until this time, s.
    Until(f64),
    /// Nothing came for a while, or nothing more comes.
    Quiet,
}

/// Hands on what is heard of so many switches, in order, until nobody tells more; whether every line could be used. What
/// `take` refuses is told, and counts for nothing.
pub(super) fn listen(
    device: &DeviceArguments,
    count: usize,
    mut take: impl FnMut(Heard) -> Result<(), String>,
) -> miette::Result<bool> {
    let is_all = if device.is_given() { from_board(device, count, &mut take)? } else { from_lines(count, &mut take)? };
    // What is not yet told is told, whatever could not be used.
    let is_told = take(Heard::Quiet).is_ok();
    Ok(is_all && is_told)
}

fn from_lines(count: usize, take: &mut impl FnMut(Heard) -> Result<(), String>) -> miette::Result<bool> {
    let lines = lines_of_input()?;
    let mut is_all = true;
    loop {
        let heard = match lines.recv_timeout(QUIET) {
            Ok(line) => line.and_then(|line| BitChange::parse(&line, count).map_err(|error| error.to_string())),
            Err(RecvTimeoutError::Timeout) => {
                take(Heard::Quiet).ok();
                continue;
            }
            Err(RecvTimeoutError::Disconnected) => return Ok(is_all),
        };
        let taken = heard.and_then(|change| change.map_or(Ok(()), |change| take(Heard::Change(change))));
        if let Err(why) = taken {
            is_all = false;
            note!("a line counts for nothing: {why}");
        }
    }
}

fn from_board(
    device: &DeviceArguments,
    count: usize,
    take: &mut impl FnMut(Heard) -> Result<(), String>,
) -> miette::Result<bool> {
    if count > BOARD_INPUTS {
        return Err(miette::miette!(
            help = "tell the changes of all of them as lines on standard input, without -d",
            "{count} switches are to be read, and a board has {BOARD_INPUTS} inputs"
        ));
    }
    interrupt::listen();
    let mut session = device.open(true)?;
    live::start(&mut session).advised()?;
    let mut levels = None;
    let mut is_all = true;
    let mut hear = |heard: Heard| {
        if let Err(why) = take(heard) {
            is_all = false;
            note!("a change counts for nothing: {why}");
        }
    };
    let streamed = live::stream(&mut session, |session, incoming| {
        recording::taken(session, incoming, &[]);
        match incoming {
            Incoming::Inputs(inputs) => {
                changes(levels, inputs, count).for_each(|change| hear(Heard::Change(change)));
                levels = Some(inputs.levels);
            }
            Incoming::Samples(samples) if levels.is_some() => {
                hear(Heard::Until(samples.device_time_s(samples.counts.len().saturating_sub(1))));
            }
            _ => super::tell(incoming),
        }
        true
    });
    // Whatever ended it, nobody listens any more.
    let stopped = session.stop();
    streamed.advised()?;
    stopped.advised()?;
    Ok(is_all)
}

/// What of the first so many inputs differs from before; of the first levels all.
fn changes(before: Option<u8>, inputs: &InputLevels, count: usize) -> impl Iterator<Item = BitChange> + use<> {
    let (levels, t) = (inputs.levels, inputs.time_us as f64 * 1e-6);
    let differs = before.map_or(u8::MAX, |before| before ^ levels);
    let is_changed = move |point: &usize| differs >> point & 1 == 1;
    (0..count).filter(is_changed).map(move |point| BitChange { t, point, covered: levels >> point & 1 == 1 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_switches_from_1_on() {
        let inputs = |time_us, levels| InputLevels { time_us, levels, changes: 0 };
        let first: Vec<_> = changes(None, &inputs(1_500_000, 0b0000_0101), 3).collect();
        let told = |point, covered| BitChange { t: 1.5, point, covered };
        assert_eq!(first, [told(0, true), told(1, false), told(2, true)]);
        // Input 7 is none of three.
        let next: Vec<_> = changes(Some(0b101), &inputs(1_500_000, 0b1000_0111), 3).collect();
        assert_eq!(next, [told(1, true)]);
    }
}
