//! A session that goes on: minutes of real time or hours of simulated time, replugs and restarts, with every lost sample
//! attributed to where it was lost.
//!
//! `cargo run --release -p palpate-tests --bin soak -- minutes 30`, `-- simulated-hours 24`, `-- replugs 100`,
//! `-- restarts 100`. Not part of the tests: its results are in docs/RELIABILITY.md. The device is simulated in this
//! process; the line is a real pseudo-terminal, but for simulated hours, which go through a pipe.
//!
//! Exit status: 0 if every sample is accounted for and nothing grew, 1 if not, 64 wrong command line.

#![forbid(unsafe_code)]

use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use palpate_device::session::SessionOptions;
use palpate_device::simulated::{Config, Line, Pace, SimulatedDevice};
use palpate_device::{Incoming, Session};
use palpate_shared::wire::Counters;

/// What a process takes of the machine.
#[derive(Clone, Copy, Debug)]
struct Footprint {
    resident_kib: u64,
    threads: u64,
    handles: usize,
}

impl Footprint {
    /// Of this process, where the system tells.
    fn now() -> Self {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let number = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key));
            line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
        };
        let handles = std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count);
        Self { resident_kib: number("VmRSS:"), threads: number("Threads:"), handles }
    }
}

/// What happens during the session.
#[derive(Clone, Copy, Debug)]
enum Plan {
    /// Nothing, for so long by the clock.
    Real(Duration),
    /// Nothing, for so many seconds of the device's time, as fast as it can be read.
    Simulated(f64),
    Replugs(u32),
    Restarts(u32),
}

fn plan(words: &[String]) -> Option<Plan> {
    let [what, count] = words else { return None };
    let count: u32 = count.parse().ok().filter(|count| *count > 0)?;
    match what.as_str() {
        "minutes" => Some(Plan::Real(Duration::from_secs(60 * u64::from(count)))),
        "simulated-hours" => Some(Plan::Simulated(3600.0 * f64::from(count))),
        "replugs" => Some(Plan::Replugs(count)),
        "restarts" => Some(Plan::Restarts(count)),
        _ => None,
    }
}

/// What went by in the session.
#[derive(Debug, Default)]
struct Seen {
    /// Device time of the last sample, s.
    until_s: f64,
    samples: u64,
    reconnected: u32,
    restarted: u32,
    silences: u32,
    uncountable: u32,
}

impl Seen {
    fn take(&mut self, incoming: &Incoming) {
        match incoming {
            Incoming::Samples(samples) => {
                self.until_s = samples.device_time_s(samples.counts.len());
                self.samples += samples.counts.len() as u64;
            }
            Incoming::Reconnected { countable, .. } => {
                self.reconnected += 1;
                self.uncountable += u32::from(!countable);
            }
            Incoming::Restarted(_) => self.restarted += 1,
            Incoming::Silent { .. } => self.silences += 1,
            Incoming::Event(_)
            | Incoming::Temperature(_)
            | Incoming::SlowChannels(_)
            | Incoming::Inputs(_)
            | Incoming::Force(_)
            | Incoming::Disconnected { .. } => {}
        }
    }
}

/// Longest wait for a cable that was plugged in again, or a device that was started anew.
const PATIENCE: Duration = Duration::from_secs(60);

/// Samples taken between two replugs or restarts: a second of them.
const SAMPLES_BETWEEN: u64 = 4000;

/// A process that has taken its buffers grows by no more, KiB: a second of samples on the heap is 64.
const GROWTH_MAX_KIB: u64 = 8192;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let Some(plan) = plan(&words) else {
        eprintln!("usage: soak minutes N | simulated-hours N | replugs N | restarts N");
        return ExitCode::from(64);
    };
    match soak(plan) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn soak(plan: Plan) -> Result<bool, Box<dyn std::error::Error>> {
    let is_simulated = matches!(plan, Plan::Simulated(_));
    let (line, pace) =
        if is_simulated { (Line::Pipe, Pace::AsRead) } else { (Line::Pty { link: None }, Pace::RealTime) };
    let device = Arc::new(SimulatedDevice::start(Config { seed: 1, line, pace, ..Config::default() })?);
    let mut session = Session::open_simulated(Arc::clone(&device), SessionOptions::default())?;
    session.start()?;
    let (mut seen, begun) = (Seen::default(), Instant::now());
    // Buffers grow to their size in the first seconds.
    for_a_while(&mut session, &mut seen, 4 * SAMPLES_BETWEEN)?;
    let before = Footprint::now();
    let mut told = Instant::now();
    let mut done = 0;
    loop {
        let is_over = match plan {
            Plan::Real(duration) => begun.elapsed() >= duration,
            Plan::Simulated(seconds) => seen.until_s >= seconds,
            Plan::Replugs(count) | Plan::Restarts(count) => done >= count,
        };
        if is_over {
            break;
        }
        match plan {
            Plan::Replugs(_) => {
                device.unplug()?;
                let times = seen.reconnected;
                wait(&mut session, &mut seen, |incoming| matches!(incoming, Incoming::Disconnected { .. }))?;
                device.plug_in()?;
                wait_until(&mut session, &mut seen, |seen| seen.reconnected > times)?;
                done += 1;
            }
            Plan::Restarts(_) => {
                let times = seen.restarted;
                device.restart()?;
                wait_until(&mut session, &mut seen, |seen| seen.restarted > times)?;
                done += 1;
            }
            Plan::Real(_) | Plan::Simulated(_) => {}
        }
        for_a_while(&mut session, &mut seen, SAMPLES_BETWEEN)?;
        if told.elapsed() > Duration::from_secs(60) {
            told = Instant::now();
            println!("{:8.0} s  {}", seen.until_s, in_words(&session, &seen, &Footprint::now()));
        }
    }
    conclude(&mut session, seen, before, plan)
}

/// Takes so many samples, and whatever comes between.
fn for_a_while(session: &mut Session, seen: &mut Seen, samples: u64) -> Result<(), Box<dyn std::error::Error>> {
    let until = seen.samples + samples;
    wait_until(session, seen, |seen| seen.samples >= until)
}

fn wait(
    session: &mut Session,
    seen: &mut Seen,
    wanted: impl Fn(&Incoming) -> bool,
) -> Result<(), Box<dyn std::error::Error>> {
    let mut found = false;
    wait_for(session, seen, |incoming, _| {
        found |= wanted(incoming);
        found
    })
}

fn wait_until(
    session: &mut Session,
    seen: &mut Seen,
    wanted: impl Fn(&Seen) -> bool,
) -> Result<(), Box<dyn std::error::Error>> {
    wait_for(session, seen, |_, seen| wanted(seen))
}

fn wait_for(
    session: &mut Session,
    seen: &mut Seen,
    mut is_enough: impl FnMut(&Incoming, &Seen) -> bool,
) -> Result<(), Box<dyn std::error::Error>> {
    let mut heard = Instant::now();
    while heard.elapsed() < PATIENCE {
        if let Some(incoming) = session.next(Duration::from_millis(100))? {
            heard = Instant::now();
            seen.take(&incoming);
            if is_enough(&incoming, seen) {
                return Ok(());
            }
        }
    }
    Err(format!("nothing for {} s", PATIENCE.as_secs()).into())
}

fn in_words(session: &Session, seen: &Seen, footprint: &Footprint) -> String {
    let counts = session.counts();
    format!(
        "{} samples, {} missing, {} damaged frames, {} reconnected, {} restarted, {} silences; {} KiB, {} threads, {} handles",
        counts.samples,
        counts.missing,
        counts.damaged_frames,
        seen.reconnected,
        seen.restarted,
        seen.silences,
        footprint.resident_kib,
        footprint.threads,
        footprint.handles
    )
}

/// Stops the stream, takes what is on its way, and says where every sample is.
fn conclude(
    session: &mut Session,
    mut seen: Seen,
    before: Footprint,
    plan: Plan,
) -> Result<bool, Box<dyn std::error::Error>> {
    session.stop()?;
    let counters = session.device_counters()?;
    while let Some(incoming) = session.next(Duration::from_millis(500))? {
        seen.take(&incoming);
    }
    let after = Footprint::now();
    println!("{:8.0} s  {}", seen.until_s, in_words(session, &seen, &after));
    let Counters { samples, samples_missed, samples_damaged, samples_dropped, .. } = counters;
    let lost_on_board = u64::from(samples_missed) + u64::from(samples_damaged) + u64::from(samples_dropped);
    let counts = session.counts();
    println!(
        "board    {samples} numbered: {samples_missed} not read in time, {samples_damaged} damaged on the bus, {samples_dropped} without room"
    );
    // A device that counts anew says nothing of what it counted before.
    let is_one_run = matches!(plan, Plan::Real(_) | Plan::Simulated(_) | Plan::Replugs(_)) && seen.uncountable == 0;
    let on_the_way = counts.missing.saturating_sub(lost_on_board);
    println!("line     {} missing at the host, of these on the way {on_the_way}", counts.missing);
    // The board's numbers have 32 bits.
    let adds_up = !is_one_run || (counts.samples + counts.missing) & 0xFFFF_FFFF == u64::from(samples);
    let is_named = !matches!(plan, Plan::Real(_) | Plan::Simulated(_)) || on_the_way == 0 || counts.damaged_frames > 0;
    let grew = after.resident_kib.saturating_sub(before.resident_kib);
    let is_flat = grew <= GROWTH_MAX_KIB && after.threads <= before.threads && after.handles <= before.handles;
    println!("process  {before:?} to {after:?}");
    println!("adds up: {adds_up}, every loss has a place: {is_named}, nothing grew: {is_flat}");
    Ok(adds_up && is_named && is_flat)
}
