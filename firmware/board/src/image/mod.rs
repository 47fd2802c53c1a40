//! The image: start-up, the main loop, and the three interrupts.
//!
//! ```text
//!  priority 0  SysTick  counts time, wakes the sampler          (`time`)
//!  priority 1  USART1   bytes in, bytes out                     (`line`)
//!  priority 2  EXTI4    DRDY fell, or SysTick asks: the sampler (`sampling`)
//!  thread      main     commands, blocks, events                (here)
//! ```
//!
//! The sides share only lock-free queues (`firmware/core`'s, and one each way for the line's bytes), so no interrupt
//! ever waits for another one or is held off by a lock longer than a hand-over at start-up.

mod clock;
mod front_end;
mod handover;
mod line;
mod machine;
mod pins;
mod sampling;
mod time;

use core::cell::RefCell;

use cortex_m_rt::entry;
use defmt_rtt as _;
use heapless::spsc::Queue;
use palpate_firmware_core::{Device, Identity, Queues, Sampler, Settings};
use palpate_shared::sim::SimulatedFrontEnd;
use palpate_shared::wire::{Axis, Bridge, Channel, RestartReason};
use stm32f4::stm32f405::Peripherals;

use front_end::Bus;
use line::Line;
use machine::Machine;
use sampling::Sampling;

/// Bytes for the host that the main loop keeps while the line is busy: 60 blocks, 0.1 s at 4 kHz.
const OUTBOX_BYTES: usize = 4096;

/// Bridge excitation on the board, in mV: `docs/HARDWARE.md` says why not more.
const EXCITATION_MV: u16 = 2500;

/// What the two channels measure.
const CHANNELS: [Channel; 2] =
    [Channel { axis: Axis::X, bridge: Bridge::Half }, Channel { axis: Axis::Y, bridge: Bridge::Half }];

#[entry]
fn main() -> ! {
    static mut QUEUES: Queues = Queues::new();
    static mut RECEIVED: Queue<u8, { line::RECEIVED }> = Queue::new();
    static mut TO_SEND: Queue<u8, { line::TO_SEND }> = Queue::new();
    static mut SIMULATION: Option<RefCell<SimulatedFrontEnd>> = None;
    static mut SAMPLING: Option<Sampling> = None;
    static mut DEVICE: Option<Device<'static, OUTBOX_BYTES>> = None;

    // Both are there: nothing has run before.
    let (Some(mut core), Some(board)) = (cortex_m::Peripherals::take(), Peripherals::take()) else { halt() };
    let machine = Machine::detect(&board.DBGMCU);
    let clock = machine.clock(clock::start(&board.RCC, &board.FLASH), &core.SYST);
    pins::set_up(&board.RCC, &board.GPIOA, &board.GPIOC, &board.SYSCFG, &board.EXTI);
    time::start(&mut core.SYST, &mut core.SCB, clock.core_hz);
    let identity = Identity {
        device: machine.device_id(),
        board: machine.name(),
        clock: clock.source,
        link_baud: clock.link_baud,
        restart: RestartReason::Unknown,
        restarts: 0,
        excitation_mv: EXCITATION_MV,
        channels: CHANNELS,
    };
    defmt::info!("core at {=u32} Hz, line at {=u32} baud", clock.core_hz, clock.link_baud);

    let (sampler_end, device_end) = QUEUES.split();
    let simulation = SIMULATION.insert(front_end::simulation());
    let bus = Bus::new(board.SPI1, board.GPIOA, simulation);
    let sampler = Sampler::new(bus, sampler_end, Settings::at_start(clock.link_baud));
    sampling::start(SAMPLING.insert(Sampling::new(sampler, board.EXTI)), &mut core.NVIC);
    let line = line::start(board.USART1, clock.line_divider(), (RECEIVED, TO_SEND), &mut core.NVIC);
    serve(DEVICE.insert(Device::new(identity, device_end)), line)
}

/// The main loop: never waits for anything but the next interrupt.
fn serve(device: &mut Device<'static, OUTBOX_BYTES>, mut line: Line) -> ! {
    let mut buffer = [0; line::RECEIVED];
    loop {
        let now = time::now();
        device.receive(line.receive(&mut buffer), now);
        device.poll(now);
        let sent = line.send(device.transmit());
        device.transmitted(sent);
        // SysTick wakes it after 125 µs at the latest.
        cortex_m::asm::wfi();
    }
}

/// Stands still for good.
fn halt() -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(_info: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}
