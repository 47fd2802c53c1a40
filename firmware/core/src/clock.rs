//! When conversions happen: how many since the last one seen, and how fast they come.
//!
//! The front-end's clock and the processor's differ (by 1 % on an internal oscillator), so the period is
//! measured over windows in which nothing was missed, and trusted within [`TRUST_INVERSE`].
//! Units: device time in µs, periods in ns. Errors: none.

use palpate_shared::units::DeviceTime;

use crate::settings::Rate;

/// Data-ready edges in one measurement of the period: 0.26 s at 4 kHz, so the clock's step of 1 µs
/// leaves 4 parts in a million.
pub(crate) const WINDOW: u32 = 1024;

/// Edges from which on an unfinished window tells the period, to 1 % at 8 kHz.
const WINDOW_MIN: u32 = 64;

/// A measured period further than 1/20 from the nominal one is not the chip's: something is wrong with it.
const TRUST_INVERSE: u32 = 20;

/// The self-test's tolerance: 1/20, as the wire format documents it.
const AS_SET_INVERSE: u32 = 20;

/// What of a period the estimate of a conversion's true time may go on with each edge, as its inverse: a quarter, so that
/// it keeps up with clocks that are 25 % slow, and one edge served most of a period late hardly moves it.
const PHASE_SLACK_INVERSE: u64 = 4;

/// Nanoseconds in a microsecond.
const NS_PER_US: u64 = 1000;

/// Edges since some time.
#[derive(Clone, Copy, Debug)]
struct Window {
    start: DeviceTime,
    edges: u32,
    /// Whether every edge came one period after the one before.
    whole: bool,
}

impl Window {
    fn new(start: DeviceTime) -> Self {
        Self { start, edges: 0, whole: true }
    }

    /// Mean time between edges, in ns; `now` is the last edge.
    fn period_ns(&self, now: DeviceTime) -> u32 {
        let (elapsed_us, edges) = (now.since(self.start), self.edges.max(1));
        // In two parts, as the product alone can exceed 32 bits.
        let (whole_us, rest_us) = (elapsed_us / edges, elapsed_us % edges);
        whole_us.saturating_mul(1000).saturating_add(rest_us.saturating_mul(1000) / edges)
    }
}

/// The course of the front-end's conversions.
#[derive(Clone, Debug)]
pub(crate) struct ConversionClock {
    rate: Rate,
    /// The period to count with, in ns.
    period_ns: u32,
    /// The last conversion counted.
    last: DeviceTime,
    /// When that conversion happened at the latest, by the edges before it: an edge may be served late, never early.
    phase: DeviceTime,
    /// The next edge is one conversion, whenever it comes.
    restarted: bool,
    window: Window,
    /// Time between edges in the last finished window, in ns.
    measured_ns: Option<u32>,
}

impl ConversionClock {
    /// Conversions at this rate that begin now.
    pub(crate) fn new(rate: Rate, now: DeviceTime) -> Self {
        let (period_ns, window) = (rate.period_ns(), Window::new(now));
        Self { rate, period_ns, last: now, phase: now, restarted: true, window, measured_ns: None }
    }

    /// Time since the last conversion counted, in µs.
    pub(crate) fn quiet_us(&self, now: DeviceTime) -> u32 {
        now.since(self.last)
    }

    /// Whether more than this many periods passed since the last conversion counted.
    pub(crate) fn is_quiet_for(&self, periods: u32, now: DeviceTime) -> bool {
        u64::from(self.quiet_us(now)) * NS_PER_US > u64::from(self.period_ns) * u64::from(periods)
    }

    /// The next edge is one conversion, whenever it comes.
    pub(crate) fn restart(&mut self) {
        self.restarted = true;
    }

    /// Whether the next edge is the first, or comes after unknown timing.
    pub(crate) fn is_restarted(&self) -> bool {
        self.restarted
    }

    /// Whether an edge now would come more than one and a half periods after the last.
    pub(crate) fn is_late(&self, now: DeviceTime) -> bool {
        !self.restarted && self.half_periods(now) > 3
    }

    /// Whether an edge now would come more than two and a half periods after the last.
    pub(crate) fn is_very_late(&self, now: DeviceTime) -> bool {
        !self.restarted && self.half_periods(now) > 5
    }

    /// Whether an edge now would come less than half a period after the last conversion, which may have happened
    /// before its edge was served.
    pub(crate) fn is_early(&self, now: DeviceTime) -> bool {
        !self.restarted && self.half_periods_of(now.since(self.phase)) < 1
    }

    /// Half periods since the last conversion, rounded up where it is not exact; saturates at 6.
    fn half_periods(&self, now: DeviceTime) -> u32 {
        self.half_periods_of(self.quiet_us(now))
    }

    /// The same of any time, in µs.
    fn half_periods_of(&self, elapsed_us: u32) -> u32 {
        // Six half periods are 6 ms at most: beyond a second the product would not fit.
        let elapsed_ns = elapsed_us.min(1_000_000) * 1000;
        if elapsed_ns < self.period_ns / 2 { 0 } else { elapsed_ns.div_ceil(self.period_ns / 2).min(6) }
    }

    /// Counts an edge; returns how many conversions happened since the last one, at least one.
    pub(crate) fn edge(&mut self, now: DeviceTime) -> u32 {
        let conversions = if self.is_late(now) { self.conversions_until(now) } else { 1 };
        self.edge_of(now, conversions)
    }

    /// Counts an edge that is known to be so many conversions after the last.
    pub(crate) fn edge_of(&mut self, now: DeviceTime, conversions: u32) -> u32 {
        self.phase = self.phase_at(now, conversions);
        self.restarted = false;
        self.last = now;
        self.window.edges += 1;
        self.window.whole &= conversions == 1;
        if self.window.edges >= WINDOW {
            self.finish_window(now);
        }
        conversions
    }

    /// When the conversion of an edge at `now` happened at the latest, so many after the last: no later than by
    /// [`PHASE_SLACK_INVERSE`] of a period than due, which lets a chip's clock be that much slower than set. No earlier
    /// than a period before, or there would have been another.
    fn phase_at(&self, now: DeviceTime, conversions: u32) -> DeviceTime {
        let period_us = u64::from(self.period_ns) / NS_PER_US;
        let due_us = period_us * u64::from(conversions) + period_us / PHASE_SLACK_INVERSE;
        let late_us = u64::from(now.since(self.phase)).saturating_sub(due_us).min(period_us);
        let late_us = if self.restarted { 0 } else { u32::try_from(late_us).unwrap_or(0) };
        DeviceTime(now.0.wrapping_sub(late_us))
    }

    /// Counts the conversions that must have happened unseen, so that a long silence never outlasts the
    /// clock; leaves the newest one to the next edge.
    pub(crate) fn skip(&mut self, now: DeviceTime) -> u32 {
        let skipped = self.conversions_until(now).saturating_sub(1);
        let skipped_us = u64::from(skipped) * u64::from(self.period_ns) / NS_PER_US;
        // No more than the time since `last`, which is 32 bits.
        self.last.0 = self.last.0.wrapping_add(u32::try_from(skipped_us).unwrap_or(u32::MAX));
        self.phase = self.last;
        self.window = Window::new(self.last);
        self.window.whole = false;
        skipped
    }

    /// Conversions from the last one to now, rounded.
    fn conversions_until(&self, now: DeviceTime) -> u32 {
        self.periods_until(now, self.period_ns)
    }

    /// Conversions from the last one to now if they came at this rate, rounded.
    pub(crate) fn conversions_at(&self, rate: Rate, now: DeviceTime) -> u32 {
        self.periods_until(now, rate.period_ns())
    }

    fn periods_until(&self, now: DeviceTime, period_ns: u32) -> u32 {
        let elapsed_ns = u64::from(self.quiet_us(now)) * NS_PER_US;
        let period_ns = u64::from(period_ns.max(1));
        u32::try_from((elapsed_ns + period_ns / 2) / period_ns).unwrap_or(u32::MAX)
    }

    /// Ends a measurement and begins the next.
    fn finish_window(&mut self, now: DeviceTime) {
        let (measured_ns, nominal_ns) = (self.window.period_ns(now), self.rate.period_ns());
        if self.window.whole && measured_ns.abs_diff(nominal_ns) <= nominal_ns / TRUST_INVERSE {
            self.period_ns = measured_ns;
        }
        self.measured_ns = Some(measured_ns);
        self.window = Window::new(now);
    }

    /// Time between edges lately, in ns; none yet shortly after a start.
    pub(crate) fn measured_ns(&self) -> Option<u32> {
        let unfinished = (self.window.edges >= WINDOW_MIN).then(|| self.window.period_ns(self.last));
        self.measured_ns.or(unfinished)
    }

    /// Whether a measured time between edges is the one that was set, within 5 %.
    pub(crate) fn is_as_set(&self, measured_ns: u32) -> bool {
        let nominal_ns = self.rate.period_ns();
        measured_ns.abs_diff(nominal_ns) <= nominal_ns / AS_SET_INVERSE
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::settings::ConverterClock;

    fn at(us: u64) -> DeviceTime {
        DeviceTime(u32::try_from(us % (1 << 32)).unwrap())
    }

    /// A clock at 4 kHz that has seen its first edge at 0 µs.
    fn running() -> ConversionClock {
        let mut clock = ConversionClock::new(Rate::usual(ConverterClock::NOMINAL), at(0));
        clock.edge(at(0));
        clock
    }

    #[test]
    fn an_edge_more_than_one_and_a_half_periods_after_the_last_means_missed_ones() {
        for (us, conversions) in
            [(1, 1), (250, 1), (375, 1), (376, 2), (500, 2), (624, 2), (625, 3), (2_500_000, 10_000)]
        {
            assert_eq!(running().edge(at(us)), conversions, "{us} µs");
        }
        assert!(!running().is_very_late(at(625)) && running().is_very_late(at(626)));
        assert!(running().is_early(at(124)) && !running().is_early(at(125)));
    }

    #[test]
    fn an_edge_after_one_served_late_is_not_early() {
        // Served late by so much, once or twice; the next edge is punctual.
        for late_us in [0, 60, 140, 249] {
            let mut clock = running();
            clock.edge_of(at(250 + late_us), 1);
            assert!(!clock.is_early(at(500)), "{late_us} µs late");
            clock.edge_of(at(500), 1);
            assert!(clock.is_early(at(624)) && !clock.is_early(at(750)), "{late_us} µs late");
        }
        let mut clock = running();
        clock.edge_of(at(250 + 75), 1);
        clock.edge_of(at(500 + 175), 1);
        assert!(!clock.is_early(at(750)));
    }

    #[test]
    fn glitches_are_early_on_a_clock_that_is_a_fifth_slow_or_fast() {
        for period_us in [200, 300] {
            let mut clock = running();
            for n in 1..500 {
                assert!(!clock.is_early(at(n * period_us)), "edge {n} every {period_us} µs");
                clock.edge_of(at(n * period_us), 1);
                assert!(clock.is_early(at(n * period_us + 60)), "glitch {n} every {period_us} µs");
            }
        }
    }

    #[test]
    fn a_long_gap_is_counted_with_the_measured_period() {
        // 1 % slow: counted with the nominal period, the gap would be 1010 conversions.
        let mut clock = ConversionClock::new(Rate::usual(ConverterClock::NOMINAL), at(0));
        let edge_at = |n: u64| at(n * 505 / 2);
        for n in 0..3000 {
            clock.edge(edge_at(n));
        }
        assert_eq!(clock.edge(edge_at(2999 + 1000)), 1000);
    }

    #[test]
    fn the_first_edge_after_a_restart_is_one_conversion() {
        let mut clock = running();
        clock.restart();
        assert_eq!(clock.edge(at(10_000)), 1);
        assert_eq!(clock.edge(at(11_000)), 4);
    }

    #[test]
    fn a_silence_longer_than_the_clocks_wrap_is_counted_to_the_last_conversion() {
        let mut clock = running();
        let mut conversions = 0;
        // Two hours, looked at every 1.1 s; the clock wraps after 71.6 minutes.
        for look in 1..=6545_u64 {
            conversions += u64::from(clock.skip(at(look * 1_100_000)));
        }
        conversions += u64::from(clock.edge(at(6546 * 1_100_000)));
        assert_eq!(conversions, 6546 * 4400);
    }

    proptest! {
        /// Whatever the wrap, the jitter below a fifth of a period, a clock 1 % off, and the edges missed:
        /// every conversion is counted once.
        #[test]
        fn every_conversion_is_counted_once(
            log2 in 0_u32..5, start in any::<u32>(), error_ppm in -10_000_i64..10_000,
            jitter in prop::collection::vec(0_u64..20, 4000), missed in prop::collection::vec(1_usize..4000, 0..20),
        ) {
            let rate = Rate::from_hz(500 << log2, ConverterClock::NOMINAL).unwrap();
            let period_ns = u64::from(rate.period_ns()) * u64::try_from(1_000_000 + error_ppm).unwrap() / 1_000_000;
            let edge_at = |n: usize| {
                let late_ns = jitter[n] * period_ns / 100;
                at(u64::from(start) + (n as u64 * period_ns + late_ns) / 1000)
            };
            let mut clock = ConversionClock::new(rate, at(start.into()));
            clock.edge(edge_at(0));
            let (mut counted, mut last) = (0_u32, 0_u32);
            for n in (1..jitter.len()).filter(|n| !missed.contains(n)) {
                counted += clock.edge(edge_at(n));
                last = u32::try_from(n).unwrap();
            }
            prop_assert_eq!(counted, last);
        }

        #[test]
        fn the_period_is_measured(error_ppm in -10_000_i64..10_000, start in any::<u32>()) {
            let period_ns = u64::try_from(250 * (1_000_000 + error_ppm) / 1000).unwrap();
            let mut clock = ConversionClock::new(Rate::usual(ConverterClock::NOMINAL), at(start.into()));
            for n in 0..3000 {
                clock.edge(at(u64::from(start) + n * period_ns / 1000));
            }
            let measured_ns = u64::from(clock.measured_ns().unwrap());
            // Both ends of the window are rounded to 1 µs; the window has 1024 periods.
            prop_assert!(measured_ns.abs_diff(period_ns) <= 2, "{measured_ns} for {period_ns}");
            prop_assert!(clock.is_as_set(clock.measured_ns().unwrap()));
        }
    }
}
