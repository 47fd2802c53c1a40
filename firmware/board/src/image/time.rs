//! Time: SysTick counts eighths of a millisecond, and its counter tells what is between.

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{DWT, NVIC, SCB, SYST};
use cortex_m_rt::exception;
use palpate_shared::units::DeviceTime;
use stm32f4::stm32f405::Interrupt;

use super::fault;

/// Time between ticks, in µs: the period of the fastest sample rate.
pub(super) const TICK_US: u32 = 125;

/// Ticks in a second.
pub(super) const TICKS_PER_S: u32 = 1_000_000 / TICK_US;

/// Ticks since start-up; wraps.
static TICKS: AtomicU32 = AtomicU32::new(0);

/// The sampler is woken every so many ticks.
static STRIDE: AtomicU32 = AtomicU32::new(1);

/// The tick with which the sampler was woken last, plus one; 0 once it knows.
static WOKEN_BY: AtomicU32 = AtomicU32::new(0);

/// The latest time that was told, in µs: none is told that lies before it.
static TOLD: AtomicU32 = AtomicU32::new(0);

/// Starts counting cycles and ticks.
pub(super) fn start(timer: &mut SYST, control: &mut SCB, core_hz: u32) {
    timer.set_clock_source(SystClkSource::Core);
    timer.set_reload(core_hz / TICKS_PER_S - 1);
    timer.clear_current();
    // SAFETY: before any interrupt is enabled, so no critical section relies on priorities.
    #[expect(unsafe_code, reason = "priorities can break critical sections that are built on them; none are")]
    unsafe {
        control.set_priority(SystemHandler::SysTick, 0x00);
    }
    timer.enable_counter();
    timer.enable_interrupt();
}

/// The device's time. Never runs backwards but for its wrap.
pub(super) fn now() -> DeviceTime {
    let (ticks, counted, per_tick) = read();
    let fresh = ticks.wrapping_mul(TICK_US).wrapping_add(counted * TICK_US / per_tick);
    let later = |told: u32| (fresh.wrapping_sub(told) < u32::MAX / 2).then_some(fresh);
    match TOLD.fetch_update(Ordering::Relaxed, Ordering::Relaxed, later) {
        Ok(_) => DeviceTime(fresh),
        // An emulator may be late with its interrupt, so that the counter begins again before the tick is counted.
        Err(told) => DeviceTime(told),
    }
}

/// Cycles of the core since start-up; wraps.
pub(super) fn cycles() -> u32 {
    let (ticks, counted, per_tick) = read();
    ticks.wrapping_mul(per_tick).wrapping_add(counted)
}

/// Ticks of the timer since start-up; wraps.
pub(super) fn ticks() -> u32 {
    TICKS.load(Ordering::Relaxed)
}

/// Ticks, the cycles since the last one, and cycles in a tick.
fn read() -> (u32, u32, u32) {
    let per_tick = SYST::get_reload() + 1;
    loop {
        let ticks = TICKS.load(Ordering::Relaxed);
        let left = SYST::get_current();
        if TICKS.load(Ordering::Relaxed) == ticks {
            return (ticks, (per_tick - 1).saturating_sub(left), per_tick);
        }
    }
}

/// How long the processor stood still in all, in µs; wraps.
static STALLED_US: AtomicU32 = AtomicU32::new(0);

/// Does what makes the processor stand still, interrupts included, and puts the time forward by the ticks that it lost. The
/// processor's own counter of cycles tells how long it was, up to 25 s; an emulator has none, and loses no time.
pub(super) fn over_a_stall(work: impl FnOnce()) {
    cortex_m::interrupt::free(|_| {
        let (_, counted, per_tick) = read();
        let begun = DWT::cycle_count();
        work();
        let passed = DWT::cycle_count().wrapping_sub(begun);
        STALLED_US.fetch_add(passed / per_tick * TICK_US + passed % per_tick * TICK_US / per_tick, Ordering::Relaxed);
        // The interrupt that waits counts one of them.
        let lost = (passed.saturating_add(counted) / per_tick).saturating_sub(1);
        TICKS.fetch_add(lost, Ordering::Relaxed);
    });
}

/// How long the processor stood still since start-up, in µs; wraps.
pub(super) fn stalled_us() -> u32 {
    STALLED_US.load(Ordering::Relaxed)
}

/// Has the sampler woken every `ticks` from now on.
pub(super) fn wake_sampler_every(ticks: u32) {
    STRIDE.store(ticks.max(1), Ordering::Relaxed);
}

/// When the tick was that woke the sampler, if one did since the last call.
pub(super) fn woken_at() -> Option<DeviceTime> {
    let tick = WOKEN_BY.swap(0, Ordering::Relaxed).checked_sub(1)?;
    Some(DeviceTime(tick.wrapping_mul(TICK_US)))
}

#[exception]
fn SysTick() {
    let ticks = TICKS.load(Ordering::Relaxed).wrapping_add(1);
    TICKS.store(ticks, Ordering::Relaxed);
    fault::watch(ticks);
    if ticks.is_multiple_of(STRIDE.load(Ordering::Relaxed)) {
        WOKEN_BY.store(ticks.saturating_add(1), Ordering::Relaxed);
        NVIC::pend(Interrupt::EXTI3);
    }
}
