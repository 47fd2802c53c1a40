//! Timing for benchmarks: the best of several runs, and ratios to a yardstick measured in the same run.
//!
//! Absolute times depend on the machine and on what else it does; the best of many runs depends on it least, and a
//! ratio to something simple measured beside it carries over to other machines.

#![allow(dead_code, reason = "each benchmark needs one of them")]
#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "a benchmark reads the clock; the library does not"
)]

#[cfg(unix)]
use std::time::Duration;
use std::time::Instant;

/// Runs of which the fastest counts.
const RUNS: usize = 30;

/// Seconds that the fastest of [`RUNS`] runs of `work` takes.
pub(crate) fn best_of_runs(mut work: impl FnMut()) -> f64 {
    let [best] = best_of_turns([&mut work]);
    best
}

/// Seconds that this thread has worked.
#[cfg(unix)]
pub(crate) fn worked() -> f64 {
    let worked = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::try_from(worked).unwrap_or_default().as_secs_f64()
}

/// Seconds that have passed since this thread asked first: nobody says how long it worked.
#[cfg(not(unix))]
pub(crate) fn worked() -> f64 {
    thread_local!(static BEGUN: Instant = Instant::now());
    BEGUN.with(Instant::elapsed).as_secs_f64()
}

/// The same of the runs that begin within a time, s, of long work one: seconds that the thread works, whatever else the
/// machine does meanwhile.
pub(crate) fn best_of_runs_within(seconds: f64, mut work: impl FnMut()) -> f64 {
    let (begun, mut best) = (Instant::now(), f64::INFINITY);
    for _ in 0..RUNS {
        let before = worked();
        work();
        best = best.min(worked() - before);
        if begun.elapsed().as_secs_f64() > seconds {
            break;
        }
    }
    best
}

/// Seconds that the fastest of [`RUNS`] runs of each work takes. They take turns, so that a clock that changes changes
/// for all.
pub(crate) fn best_of_turns<const N: usize>(mut works: [&mut dyn FnMut(); N]) -> [f64; N] {
    let mut best = [f64::INFINITY; N];
    for _ in 0..RUNS {
        for (work, best) in works.iter_mut().zip(&mut best) {
            let begun = Instant::now();
            work();
            *best = best.min(begun.elapsed().as_secs_f64());
        }
    }
    best
}
