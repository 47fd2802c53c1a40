//! What is behind the sampler's bus: the chip on SPI1, or the simulated finger that a host asked for.
//!
//! SPI1 runs in mode 1 at an eighth of its bus clock: 10.5 MHz, or 2 MHz on the bare internal oscillator; a frame of
//! 12 bytes takes 9 µs, one of 18 bytes 14 µs. Transfers are polled with a bound, so a bus that does not answer costs time and nothing else.

use core::cell::RefCell;
use core::f32::consts::TAU;

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};
use palpate_firmware_core::ads131m::Ads131m;
use palpate_firmware_core::{SelectSource, SourceNotPossible};
use palpate_shared::sim::{Channels, ContactLoad, FingerConfig, Load, SimulatedFrontEnd, SpiPort};
use palpate_shared::wire::{FrontEndKind, Source};
use stm32f4::stm32f405::{GPIOA, GPIOB, SPI1};

use super::meter;

/// The converter's driver. The simulated finger has the same converter.
pub(super) type Chip = Ads131m<Bus, CHANNELS>;

/// How many channels the converter and its simulation have.
const CHANNELS: usize = match super::FRONT_END {
    FrontEndKind::Ads131m02 => 2,
    FrontEndKind::Ads131m04 => 4,
};

/// How often the bus is looked at for one byte, which takes 128 cycles: ten times as long.
const BYTE_POLLS: u32 = 400;

/// Cycles of the core in 1000 ns, at most.
const CYCLES_PER_US: u32 = 168;

/// Seed of the simulated finger: every board simulates the same one.
const SEED: u64 = 1;

/// Force with which the simulated finger is pressed, in N.
const FORCE_N: f32 = 2.0;

/// The simulated finger is free for this time, so that a tare can be taken, in µs.
const FREE_US: u32 = 3_000_000;

/// Then a contact travels round the disk once, in this time, in µs; and so on.
const ROUND_US: u32 = 8_000_000;

/// The simulated finger's digital inputs while a contact travels: input 0, as of a light barrier, is high.
const TOUCHED: u8 = 1;

/// Nanoseconds in a microsecond.
const NS_PER_US: u32 = 1000;

/// The chip's SPI bus and the pins on its port.
struct ChipBus {
    spi: SPI1,
    port: GPIOA,
}

/// The bus took too long for a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BusTimeout;

impl embedded_hal::spi::Error for BusTimeout {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl ChipBus {
    fn new(spi: SPI1, port: GPIOA) -> Self {
        spi.cr1().write(|w| w.mstr().set_bit().cpha().set_bit().br().div8().ssm().set_bit().ssi().set_bit());
        spi.cr1().modify(|_, w| w.spe().set_bit());
        Self { spi, port }
    }

    /// Eight clocks. Not inlined: the bus is slower than the call.
    #[inline(never)]
    fn exchange(&mut self, byte: u8) -> Result<u8, BusTimeout> {
        self.wait(|spi| spi.sr().read().txe().bit_is_set())?;
        // SAFETY: eight bits, as the bus is set.
        #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
        self.spi.dr().write(|w| unsafe { w.bits(u16::from(byte)) });
        self.wait(|spi| spi.sr().read().rxne().bit_is_set())?;
        let [received, ..] = self.spi.dr().read().bits().to_le_bytes();
        Ok(received)
    }

    fn wait(&self, is_ready: impl Fn(&SPI1) -> bool) -> Result<(), BusTimeout> {
        if (0..BYTE_POLLS).any(|_| is_ready(&self.spi)) { Ok(()) } else { Err(BusTimeout) }
    }

    fn operate(&mut self, operation: &mut Operation<'_, u8>) -> Result<(), BusTimeout> {
        match operation {
            Operation::Read(bytes) => bytes.iter_mut().try_for_each(|byte| self.exchange(0).map(|got| *byte = got)),
            Operation::Write(bytes) => bytes.iter().try_for_each(|&byte| self.exchange(byte).map(drop)),
            Operation::TransferInPlace(bytes) => {
                bytes.iter_mut().try_for_each(|byte| self.exchange(*byte).map(|got| *byte = got))
            }
            Operation::Transfer(read, write) => (0..read.len().max(write.len())).try_for_each(|at| {
                let got = self.exchange(write.get(at).copied().unwrap_or(0))?;
                if let Some(place) = read.get_mut(at) {
                    *place = got;
                }
                Ok(())
            }),
            Operation::DelayNs(duration_ns) => {
                delay(*duration_ns);
                Ok(())
            }
        }
    }

    /// One frame: chip select falls, the operations run, chip select rises.
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), BusTimeout> {
        self.port.bsrr().write(|w| w.br4().set_bit());
        let result = operations.iter_mut().try_for_each(|operation| self.operate(operation));
        // The last byte was received, so the bus is idle.
        self.port.bsrr().write(|w| w.bs4().set_bit());
        result
    }
}

/// Waits so long at least: a slower core waits longer.
fn delay(duration_ns: u32) {
    cortex_m::asm::delay(duration_ns.div_ceil(NS_PER_US).saturating_mul(CYCLES_PER_US));
}

/// The simulated finger. It is large: it belongs into a variable that is there for good, not onto the stack.
pub(super) fn simulation() -> RefCell<SimulatedFrontEnd> {
    let channels = if CHANNELS == 4 { Channels::Four } else { Channels::Two };
    RefCell::new(SimulatedFrontEnd::new(FingerConfig { channels, ..FingerConfig::default() }, SEED))
}

/// What the simulated finger goes through, again and again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Doing {
    /// Nothing touches the disk.
    Free,
    /// A contact travels round its disk.
    Round,
}

/// The bus, with what a host selected behind it.
pub(super) struct Bus {
    chip: ChipBus,
    /// The port whose upper eight pins are the digital inputs.
    inputs: GPIOB,
    simulation: &'static mut RefCell<SimulatedFrontEnd>,
    is_simulated: bool,
    /// What the simulated finger does now, and for how long still, in µs.
    doing: (Doing, u32),
}

impl Bus {
    /// The chip's, with a simulated finger at hand.
    pub(super) fn new(
        spi: SPI1,
        (port, inputs): (GPIOA, GPIOB),
        simulation: &'static mut RefCell<SimulatedFrontEnd>,
    ) -> Self {
        Self { chip: ChipBus::new(spi, port), inputs, simulation, is_simulated: false, doing: (Doing::Free, FREE_US) }
    }

    /// Lets one simulated conversion happen; tells whether data are ready.
    pub(super) fn step(&mut self) -> bool {
        meter::SIMULATION.measure(|| self.convert())
    }

    /// One conversion, with the contact where it is by now.
    fn convert(&mut self) -> bool {
        let simulation = self.simulation.get_mut();
        let period_us = simulation.period_ns() / NS_PER_US;
        let (doing, left_us) = self.doing;
        self.doing = match (left_us.checked_sub(period_us), doing) {
            (Some(left_us), _) => (doing, left_us),
            (None, Doing::Free) => {
                let from = ContactLoad::frictionless(0.0, FORCE_N);
                simulation.set_inputs(TOUCHED);
                simulation.set_load(Load::Sweep { from, to_angle: TAU, duration_us: ROUND_US });
                (Doing::Round, ROUND_US)
            }
            (None, Doing::Round) => {
                simulation.set_inputs(0);
                simulation.set_load(Load::Released);
                (Doing::Free, FREE_US)
            }
        };
        simulation.step()
    }

    /// Time between simulated conversions, in µs.
    pub(super) fn period_us(&self) -> u32 {
        self.simulation.borrow().period_ns() / NS_PER_US
    }
}

impl ErrorType for Bus {
    type Error = BusTimeout;
}

impl SpiDevice for Bus {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), BusTimeout> {
        if self.is_simulated {
            // Never busy: it is borrowed nowhere else while the sampler has the bus.
            let mut port = SpiPort::new(self.simulation);
            meter::SIMULATION.measure(|| port.transaction(operations).map_err(|_| BusTimeout))
        } else {
            self.chip.transaction(operations)
        }
    }
}

impl DelayNs for Bus {
    fn delay_ns(&mut self, duration_ns: u32) {
        if self.is_simulated {
            SpiPort::new(self.simulation).delay_ns(duration_ns);
        } else {
            delay(duration_ns);
        }
    }
}

impl SelectSource for Bus {
    fn select(&mut self, source: Source) -> Result<(), SourceNotPossible> {
        self.is_simulated = source == Source::Simulated;
        Ok(())
    }

    fn is_simulated(&self) -> bool {
        self.is_simulated
    }

    fn inputs(&self) -> u8 {
        if self.is_simulated {
            self.simulation.borrow().inputs()
        } else {
            let [_, upper, ..] = self.inputs.idr().read().bits().to_le_bytes();
            upper
        }
    }
}
