//! Where the processor's cycles go.

use core::sync::atomic::{AtomicU32, Ordering};

use super::time;

/// Cycles spent on one thing since start-up; wraps.
pub(super) struct Meter(AtomicU32);

/// Cycles of the sampler's interrupt.
pub(super) static SAMPLER: Meter = Meter::new();

/// Runs of the sampler's interrupt, not cycles.
pub(super) static SAMPLER_RUNS: Meter = Meter::new();

/// The simulated finger, which is part of the sampler's interrupt.
pub(super) static SIMULATION: Meter = Meter::new();

/// Cycles of the main loop's work.
pub(super) static MAIN: Meter = Meter::new();

impl Meter {
    const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// Adds to the sum.
    pub(super) fn add(&self, count: u32) {
        self.0.fetch_add(count, Ordering::Relaxed);
    }

    /// The sum since start-up; wraps.
    pub(super) fn read(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }

    /// Does something and adds the cycles that it took, those of interrupts in between included.
    pub(super) fn measure<T>(&self, work: impl FnOnce() -> T) -> T {
        let begun = time::cycles();
        let result = work();
        self.add(time::cycles().wrapping_sub(begun));
        result
    }

    /// Does the main loop's work and adds the cycles that it took, without those of the sampler in between.
    pub(super) fn measure_below_sampler<T>(&self, work: impl FnOnce() -> T) -> T {
        let (begun, sampler_before) = (time::cycles(), SAMPLER.read());
        let result = work();
        let all = time::cycles().wrapping_sub(begun);
        self.add(all.wrapping_sub(SAMPLER.read().wrapping_sub(sampler_before)));
        result
    }
}
