//! Timing for benchmarks: the best of several runs, and ratios to a yardstick measured in the same run.
//!
//! Absolute times depend on the machine and on what else it does; the best of many runs depends on it least, and a
//! ratio to something simple measured beside it carries over to other machines.

use std::time::Instant;

/// Runs of which the fastest counts.
const RUNS: usize = 30;

/// Seconds that the fastest of [`RUNS`] runs of `work` takes.
pub(crate) fn best_of_runs(mut work: impl FnMut()) -> f64 {
    let time = |work: &mut dyn FnMut()| {
        let begun = Instant::now();
        work();
        begun.elapsed().as_secs_f64()
    };
    (0..RUNS).map(|_| time(&mut work)).fold(f64::INFINITY, f64::min)
}
