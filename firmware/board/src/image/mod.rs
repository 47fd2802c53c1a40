//! The image: start-up, the main loop, and the three interrupts.
//!
//! ```text
//!  priority 0  SysTick  counts time, wakes the sampler          (`time`)
//!  priority 1  USART1   bytes in, bytes out                     (`line`)
//!  priority 2  EXTI3    DRDY fell, or SysTick asks: the sampler (`sampling`)
//!  thread      main     commands, blocks, events, USB           (here, `firmware/usb`)
//! ```
//!
//! The sides share only lock-free queues (`firmware/core`'s, and one each way for the line's bytes), so no interrupt
//! ever waits for another one. None is held off by a lock but for a hand-over at start-up and, where a host uses USB,
//! for a packet's way in or out of its unit.
//!
//! Start-up: `machine` (chip or emulator, and the chip's own loader), `clock`, `pins`, `handover` (what an interrupt owns from then on); what the
//! sampler reads: `front_end`; when something goes wrong: `fault`; how much is in use: `meter` (cycles), `stack`; how warm it
//! is: `thermometer`; what outlives a restart: `flash`.

mod clock;
mod fault;
mod flash;
mod front_end;
mod handover;
mod line;
mod machine;
mod meter;
mod pins;
mod sampling;
mod stack;
mod thermometer;
mod time;

use core::cell::RefCell;
use core::mem::MaybeUninit;

use cortex_m_rt::entry;
use defmt_rtt as _;
use heapless::spsc::Queue;
use palpate_firmware_core::device::Order;
use palpate_firmware_core::store::MatrixStore;
use palpate_firmware_core::{ConverterClock, Device, DeviceSettings, Identity, Link, Queues, Sampler};
use palpate_firmware_usb::port::Maker;
use palpate_firmware_usb::unit::{self as usb, Usb};
use palpate_shared::sim::SimulatedFrontEnd;
use palpate_shared::wire::{Axis, Bridge, Channel, ClockSource, FrontEndKind, Health, Source};
use stm32f4::stm32f405::Peripherals;

use crate::crystal::CONVERTER_CLOCK_HZ;
use fault::Watchdog;
use flash::Sectors;
use front_end::{Bus, Chip};
use line::Line;
use machine::Machine;
use sampling::Sampling;
use thermometer::Thermometer;
use time::TICKS_PER_S;

/// Bytes for the host that the main loop keeps while the line is busy: 60 blocks, 0.1 s at 4 kHz.
const OUTBOX_BYTES: usize = 4096;

/// Bridge excitation on the board, in mV: `docs/HARDWARE.md` says why not more.
const EXCITATION_MV: u16 = 2500;

/// Whether the board makes the converter's clock, at pin PA8: `PALPATE_CONVERTER_CLOCK_PIN=PA8` when the image was built.
const GIVES_CLOCK: bool = match option_env!("PALPATE_CONVERTER_CLOCK_PIN") {
    None => false,
    Some(pin) => match pin.as_bytes() {
        b"PA8" => true,
        _ => panic!("PALPATE_CONVERTER_CLOCK_PIN is not PA8, the only pin that a clock comes out at"),
    },
};

/// The converter's clock: what the board makes, what `PALPATE_CONVERTER_CLOCK_HZ` said when the image was built of an
/// oscillator, or 8.192 MHz.
const CONVERTER_CLOCK: ConverterClock = match (option_env!("PALPATE_CONVERTER_CLOCK_HZ"), GIVES_CLOCK) {
    (None, true) => ConverterClock::from_hz(CONVERTER_CLOCK_HZ).expect("8 MHz is a clock for it"),
    (Some(_), true) => panic!("PALPATE_CONVERTER_CLOCK_HZ is of an oscillator; what comes out at PA8 is 8 MHz"),
    (None, false) => ConverterClock::NOMINAL,
    (Some(digits), false) => match u32::from_str_radix(digits, 10) {
        Ok(hz) => ConverterClock::from_hz(hz).expect("PALPATE_CONVERTER_CLOCK_HZ is not within 7782400 to 8400000"),
        Err(_) => panic!("PALPATE_CONVERTER_CLOCK_HZ is not a whole number of hertz"),
    },
};

/// The converter: what `PALPATE_FRONT_END` said when the image was built, by the name that its row of the table has, or
/// the ADS131M02.
const FRONT_END: FrontEndKind = match option_env!("PALPATE_FRONT_END") {
    None => FrontEndKind::Ads131m02,
    Some(name) => match FrontEndKind::named(name) {
        Some(kind) => kind,
        None => panic!("PALPATE_FRONT_END is none of ADS131M02 and ADS131M04"),
    },
};

/// Who made the board, for USB: whoever has the domain that `PALPATE_USB_DOMAIN` named when the image was built, or somebody
/// who builds one for themselves.
const MAKER: Maker = Maker::of(option_env!("PALPATE_USB_DOMAIN"));

/// What the two channels measure.
const CHANNELS: [Channel; 2] =
    [Channel { axis: Axis::X, bridge: Bridge::Half }, Channel { axis: Axis::Y, bridge: Bridge::Half }];

#[entry]
fn main() -> ! {
    static mut QUEUES: Queues = Queues::new();
    static mut RECEIVED: Queue<u8, { line::RECEIVED }> = Queue::new();
    static mut TO_SEND: Queue<u8, { line::TO_SEND }> = Queue::new();
    static mut USB: usb::Memory = usb::Memory::new();
    static mut SIMULATION: MaybeUninit<RefCell<SimulatedFrontEnd>> = MaybeUninit::uninit();
    static mut SAMPLING: MaybeUninit<Sampling> = MaybeUninit::uninit();
    static mut DEVICE: MaybeUninit<Device<'static, OUTBOX_BYTES>> = MaybeUninit::uninit();

    // Both are there: nothing has run before.
    let (Some(mut core), Some(board)) = (cortex_m::Peripherals::take(), Peripherals::take()) else { halt() };
    let before = fault::begin(&board.RCC);
    let machine = Machine::detect(&board.DBGMCU);
    if before.wants_loader {
        // Before anything else is set up: the loader takes the chip to be as after a reset.
        machine.enter_loader((&board.RCC, &board.SYSCFG), &core.SCB);
    }
    stack::guard(&core.MPU);
    let clock = machine.clock(clock::start(&board.RCC, &board.FLASH, &board.TIM11), &core.SYST);
    pins::set_up(&board.RCC, (&board.GPIOA, &board.GPIOB, &board.GPIOC), &board.SYSCFG, &board.EXTI);
    if GIVES_CLOCK {
        clock::give_out(&board.RCC, clock.crystal);
        pins::give_clock_out(&board.GPIOA);
    }
    time::start(&mut core.SYST, &mut core.SCB, clock.core_hz);
    let watchdog = Watchdog::start(board.IWDG, &board.DBGMCU);
    let registers = (board.OTG_FS_GLOBAL, board.OTG_FS_DEVICE, board.OTG_FS_PWRCLK);
    let usb_clock = usb::Clock { core_hz: clock.core_hz, is_precise: clock.source == ClockSource::Crystal };
    let usb = usb::start(registers, &board.RCC, (usb_clock, MAKER, machine.device_id().0), USB);
    let identity = Identity {
        device: machine.device_id(),
        board: machine.name(usb.is_some(), clock.crystal),
        clock: clock.source,
        link_baud: clock.link_baud,
        restart: before.reason,
        restarts: before.restarts,
        source: Source::Hardware,
        front_end: FRONT_END,
        converter_clock: CONVERTER_CLOCK,
        excitation_mv: EXCITATION_MV,
        channels: CHANNELS,
    };
    defmt::info!("core at {=u32} Hz, line at {=u32} baud", clock.core_hz, clock.link_baud);

    let (sampler_end, device_end) = QUEUES.split();
    let simulation = settle(SIMULATION, front_end::simulation);
    let bus = Bus::new(board.SPI1, (board.GPIOA, board.GPIOB), simulation);
    let sampler = Sampler::new(Chip::new(bus), sampler_end, DeviceSettings::at_start(clock.link_baud, CONVERTER_CLOCK));
    sampling::start(SAMPLING.write(Sampling::new(sampler, board.EXTI)), &mut core.NVIC);
    let line = line::start(board.USART1, clock.line_divider(), (RECEIVED, TO_SEND), &mut core.NVIC);
    let device = settle(DEVICE, || Device::new(identity, device_end));
    device.accept_orders(before.fault);
    let store = MatrixStore::new(Sectors::new(board.FLASH, &mut core.DCB, &mut core.DWT));
    device.accept_store(store.kept());
    let health = Health { stack_bytes: stack::size(), core_hz: clock.core_hz, ..Health::default() };
    let thermometer = Thermometer::start(board.ADC1, &board.ADC_COMMON, &board.RCC, machine);
    let (looked_at, turned_at) = (time::ticks(), (0, 0));
    Main { device, line, usb, watchdog, store, thermometer, health, looked_at, turned_at, order: None }.serve()
}

/// Makes something large in a place of its own. Not inlined, so that the stack which that takes is free afterwards.
#[inline(never)]
fn settle<T>(place: &'static mut MaybeUninit<T>, make: impl FnOnce() -> T) -> &'static mut T {
    place.write(make())
}

/// How long the main loop may do nothing, in ticks: 1 ms.
const IDLE_TICKS: u32 = TICKS_PER_S / 1000;

/// How often the use of stack and processor is looked at, in ticks: a tenth of a second.
const LOOK_TICKS: u32 = TICKS_PER_S / 10;

/// How long an order waits for the line to take what is due, in ticks: a tenth of a second.
const ORDER_TICKS: u32 = TICKS_PER_S / 10;

/// How long an order waits after that for the last byte to leave the transmitter, in ticks: 3 ms. Two bytes at the
/// slower speed take 0.2 ms; over USB a host fetches once in 1 ms.
const LAST_BYTE_TICKS: u32 = 3 * TICKS_PER_S / 1000;

/// What the main loop works with.
struct Main {
    device: &'static mut Device<'static, OUTBOX_BYTES>,
    line: Line,
    usb: Option<Usb>,
    watchdog: Watchdog,
    store: MatrixStore<Sectors>,
    /// `None` where there is nothing to read.
    thermometer: Option<Thermometer>,
    health: Health,
    /// The tick at which stack and processor were last looked at.
    looked_at: u32,
    /// Runs of the sampler, and the tick, at the last turn.
    turned_at: (u32, u32),
    /// What the host ordered, and the tick by which it is carried out.
    order: Option<(Order, u32)>,
}

impl Main {
    /// The main loop: never waits for anything but the next interrupt.
    fn serve(mut self) -> ! {
        loop {
            meter::MAIN.measure_below_sampler(|| {
                self.listen_to_usb();
                if self.has_work() {
                    self.turn();
                }
            });
            // SysTick wakes it after 125 µs at the latest.
            cortex_m::asm::wfi();
        }
    }

    /// Hands on what came by USB.
    fn listen_to_usb(&mut self) {
        let Some(usb) = &mut self.usb else { return };
        let mut buffer = [0; line::RECEIVED];
        let received = usb.receive(&mut buffer);
        if !received.is_empty() {
            self.hear(Link::Usb, received);
        }
    }

    /// Hands as much of what is due to the link in use as that takes.
    fn talk(&mut self) {
        let bytes = self.device.transmit();
        let sent = match (self.device.link(), &mut self.usb) {
            (Link::Usb, Some(usb)) => usb.send(bytes),
            _ => self.line.send(bytes),
        };
        self.device.transmitted(sent);
    }

    /// Whether a turn is due: the sampler ran, bytes came or wait, or nothing of this happened for a while.
    fn has_work(&mut self) -> bool {
        let (runs, ticks) = (meter::SAMPLER_RUNS.read(), time::ticks());
        let idle = runs == self.turned_at.0 && ticks.wrapping_sub(self.turned_at.1) < IDLE_TICKS;
        let due = !idle || self.line.has_received() || !self.device.transmit().is_empty();
        if due {
            self.turned_at = (runs, ticks);
        }
        due
    }

    /// One turn of the main loop.
    fn turn(&mut self) {
        if self.line.has_received() {
            self.listen_to_line();
        }
        self.device.poll(time::now());
        self.talk();
        let ticks = time::ticks();
        if ticks.wrapping_sub(self.looked_at) >= LOOK_TICKS {
            self.looked_at = ticks;
            self.look();
        }
        self.watchdog.feed();
        self.obey(ticks);
    }

    /// Hands on what came by the line. Apart from the turn, since most turns need no buffer for it.
    #[inline(never)]
    fn listen_to_line(&mut self) {
        let mut buffer = [0; line::RECEIVED];
        let received = self.line.receive(&mut buffer);
        self.hear(Link::Serial, received);
    }

    /// Takes what came by a link, and keeps what the host has the board keep: the chip may stand still meanwhile.
    fn hear(&mut self, link: Link, received: &[u8]) {
        self.device.receive_by(link, received, time::now());
        if let Some(matrix) = self.device.take_store() {
            self.watchdog.feed();
            let before = time::stalled_us();
            let kept = self.store.keep(matrix);
            self.device.stored(kept.map(|()| time::stalled_us().wrapping_sub(before)));
        }
    }

    /// Looks at the use of stack and processor, and at the temperature.
    fn look(&mut self) {
        self.health = Health {
            stack_used_max: stack::used_max(self.health.stack_used_max),
            sampler_cycles: meter::SAMPLER.read(),
            simulation_cycles: meter::SIMULATION.read(),
            main_cycles: meter::MAIN.read(),
            sampler_runs: meter::SAMPLER_RUNS.read(),
            ..self.health
        };
        self.device.report_health(self.health);
        if let Some(centi_celsius) = self.thermometer.as_mut().and_then(Thermometer::look) {
            self.device.temperature(centi_celsius, time::now());
        }
        fault::note_samples(self.device.counters().samples);
    }

    /// Carries out what the host ordered, once its answer has gone out.
    fn obey(&mut self, ticks: u32) {
        if let Some(order) = self.device.take_order() {
            self.order = Some((order, ticks.wrapping_add(ORDER_TICKS)));
        }
        let Some((order, due)) = self.order else { return };
        let left = due.wrapping_sub(ticks);
        if left > ORDER_TICKS {
            match order {
                Order::Reboot => fault::reboot(),
                Order::EnterLoader => fault::enter_loader(),
                Order::Fail(failure) => fault::fail(failure),
            }
        }
        if left > LAST_BYTE_TICKS && self.device.transmit().is_empty() && self.line.is_idle() {
            self.order = Some((order, ticks.wrapping_add(LAST_BYTE_TICKS)));
        }
    }
}

/// Stands still for good.
fn halt() -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}
