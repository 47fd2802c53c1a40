//! The sampler's interrupt: DRDY fell (EXTI3), or SysTick raised it.

use cortex_m::peripheral::NVIC;
use palpate_firmware_core::sampler::IDLE_US;
use palpate_firmware_core::{Sampler, SelectSource as _};
use palpate_shared::units::DeviceTime;
use stm32f4::stm32f405::{EXTI, Interrupt, interrupt};

use super::front_end::Chip;
use super::handover::Handover;
use super::meter;
use super::time::{self, TICK_US};

/// Priority of the interrupt, in the upper four bits.
const PRIORITY: u8 = 0x20;

/// What the interrupt owns.
pub(super) struct Sampling {
    sampler: Sampler<'static, Chip>,
    edges: EXTI,
}

static SAMPLING: Handover<&'static mut Sampling> = Handover::new();

/// Hands the sampler to its interrupt, which runs from here on.
pub(super) fn start(sampling: &'static mut Sampling, interrupts: &mut NVIC) {
    SAMPLING.leave(sampling);
    // SAFETY: no critical section is built on priorities.
    #[expect(unsafe_code, reason = "priorities can break critical sections that are built on them; none are")]
    unsafe {
        interrupts.set_priority(Interrupt::EXTI3, PRIORITY);
        NVIC::unmask(Interrupt::EXTI3);
    }
}

impl Sampling {
    /// Of a sampler and the unit that sees DRDY's edges.
    pub(super) fn new(sampler: Sampler<'static, Chip>, edges: EXTI) -> Self {
        Self { sampler, edges }
    }

    /// DRDY fell, or a tick came, or both.
    fn interrupt(&mut self) {
        let fell = self.edges.pr().read().pr3().bit_is_set();
        if fell {
            self.edges.pr().write(|w| w.pr3().clear_bit_by_one());
        }
        let tick = time::woken_at();
        if self.sampler.bus_mut().is_simulated() {
            if let Some(now) = tick {
                self.convert(now);
            }
        } else {
            self.listen(fell, tick);
        }
        time::wake_sampler_every(self.ticks_to_next());
    }

    /// One conversion of the simulated finger.
    fn convert(&mut self, now: DeviceTime) {
        if self.sampler.bus_mut().step() { self.sampler.data_ready(now) } else { self.sampler.idle(now) }
    }

    /// What the interrupt does with the chip: a conversion is ready, or a tick has come.
    fn listen(&mut self, fell: bool, tick: Option<DeviceTime>) {
        if fell {
            self.sampler.data_ready(time::now());
        }
        if tick.is_some() {
            self.sampler.idle(time::now());
        }
    }

    /// Ticks until the interrupt is wanted even without an edge.
    fn ticks_to_next(&mut self) -> u32 {
        let bus = self.sampler.bus_mut();
        let wait_us = if bus.is_simulated() { bus.period_us() } else { IDLE_US };
        wait_us / TICK_US
    }
}

#[interrupt]
fn EXTI3() {
    static mut OWN: Option<&'static mut Sampling> = None;
    if OWN.is_none() {
        *OWN = SAMPLING.fetch();
    }
    if let Some(sampling) = OWN {
        meter::SAMPLER.measure(|| sampling.interrupt());
        meter::SAMPLER_RUNS.add(1);
    }
}
