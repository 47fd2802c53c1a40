//! How long a thread has worked: what an answer costs, whatever else the machine does meanwhile.
//!
//! Units: s. Errors: none; where the system does not count it, the time that passes stands for it.

use std::time::Duration;

/// A moment of this thread's processor time.
pub(super) struct ProcessorTime(Duration);

impl ProcessorTime {
    pub(super) fn now() -> Self {
        Self(worked())
    }

    /// Since then, s; of the same thread.
    pub(super) fn seconds(&self) -> f64 {
        worked().saturating_sub(self.0).as_secs_f64()
    }

    /// The same, ms.
    pub(super) fn milliseconds(&self) -> f64 {
        1e3 * self.seconds()
    }
}

#[cfg(unix)]
fn worked() -> Duration {
    rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime).try_into().unwrap_or_default()
}

#[cfg(not(unix))]
fn worked() -> Duration {
    thread_local!(static BEGUN: std::time::Instant = std::time::Instant::now());
    BEGUN.with(std::time::Instant::elapsed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sleep_is_no_work() {
        let (begun, passed) = (ProcessorTime::now(), std::time::Instant::now());
        while begun.seconds() == 0.0 {
            std::hint::black_box(0);
        }
        std::thread::sleep(Duration::from_millis(20));
        assert!(begun.seconds() <= passed.elapsed().as_secs_f64());
        assert!(!cfg!(unix) || begun.seconds() < passed.elapsed().as_secs_f64() - 0.015);
    }
}
