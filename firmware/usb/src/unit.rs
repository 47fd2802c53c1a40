//! The chip's USB unit (OTG_FS): whether it answers, and the port on it.
//!
//! It needs 48 MHz to a quarter of a percent, which only the crystal gives; and an emulator has no such unit. So it is
//! asked first, with bounded waits, whether it is there and can be reset; the driver then does the same without bounds.
//! Should the unit stand still later, the independent watchdog ends that.
//!
//! It is polled at the main loop's pace, every 125 µs: one packet of 63 bytes each time is 500 kB/s, and 8 kHz need 85.
//! The driver masks interrupts while it moves a packet: some µs, less than the line's next byte takes.
//!
//! Registers: RM0090, chapter 34.16. No supply sensing, since the serial line has that pin (PA9): the driver switches
//! it off.

use core::mem::MaybeUninit;

use heapless::String;
use stm32f4::stm32f405::{OTG_FS_DEVICE, OTG_FS_GLOBAL, OTG_FS_PWRCLK, RCC};
use synopsys_usb_otg::{UsbBus, UsbPeripheral};
use usb_device::bus::UsbBusAllocator;

use crate::port::{MEMORY_WORDS, Maker, NUMBER, Port};

/// `OTG_FS_CID` of an STM32F405, and of later chips of its line.
const CORE_IDS: [u32; 2] = [0x1100, 0x1200];

/// How often the unit is looked at: 60 µs and more; it resets within some of its 48 MHz clock's periods.
const POLLS: u32 = 1000;

/// The unit's registers, for the driver.
struct Unit {
    core_hz: u32,
}

// SAFETY: whoever makes one has given up the access crate's owners of these registers (`start`).
#[expect(unsafe_code, reason = "the driver's way to be told where the registers are")]
unsafe impl UsbPeripheral for Unit {
    const REGISTERS: *const () = OTG_FS_GLOBAL::ptr().cast();
    const HIGH_SPEED: bool = false;
    const FIFO_DEPTH_WORDS: usize = 320;
    const ENDPOINT_COUNT: usize = 4;

    /// Its clock runs since `start`.
    fn enable() {}

    fn ahb_frequency_hz(&self) -> u32 {
        self.core_hz
    }
}

/// What the port needs in places that are there for good.
pub struct Memory {
    endpoints: [u32; MEMORY_WORDS],
    serial_number: String<63>,
    bus: MaybeUninit<UsbBusAllocator<UsbBus<Unit>>>,
}

impl Memory {
    /// Memory that no unit uses yet.
    #[must_use]
    #[expect(clippy::new_without_default, reason = "it belongs into a `static`")]
    pub const fn new() -> Self {
        Self { endpoints: [0; MEMORY_WORDS], serial_number: String::new(), bus: MaybeUninit::uninit() }
    }
}

/// The serial port of the chip's own USB unit.
pub struct Usb(Port<'static, UsbBus<Unit>>);

/// The unit's registers, given up to its driver.
pub type Registers = (OTG_FS_GLOBAL, OTG_FS_DEVICE, OTG_FS_PWRCLK);

/// What the unit runs on.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    /// The core's frequency, in Hz.
    pub core_hz: u32,
    /// Whether it comes from the crystal.
    pub is_precise: bool,
}

/// Starts the port, if the unit is there and its clock is good enough; `number` is the device's, for the host to know
/// it by, `maker` who made the board.
#[inline(never)]
pub fn start(
    registers: Registers,
    rcc: &RCC,
    (clock, maker, number): (Clock, Maker, [u8; NUMBER / 2]),
    memory: &'static mut Memory,
) -> Option<Usb> {
    rcc.ahb2enr().modify(|_, w| w.otgfsen().set_bit());
    // Two cycles of its bus until it hears (ES0182, 2.1.13): what is asked before may read 0, as if it were not there.
    let _ = rcc.ahb2enr().read();
    cortex_m::asm::dsb();
    let answers = answers(&registers.0);
    if !answers || !clock.is_precise {
        defmt::info!("no USB: its unit answers {=bool}, the crystal runs {=bool}", answers, clock.is_precise);
        rcc.ahb2enr().modify(|_, w| w.otgfsen().clear_bit());
        return None;
    }
    memory.serial_number = maker.serial_number(&number);
    let bus = memory.bus.write(UsbBus::new(Unit { core_hz: clock.core_hz }, &mut memory.endpoints));
    Port::new(bus, maker, &memory.serial_number).map(Usb)
}

/// Whether something comes true while it is looked at so many times.
fn within(polls: u32, is_true: impl Fn() -> bool) -> bool {
    (0..polls).any(|_| is_true())
}

/// Whether the unit is there and can be reset.
fn answers(unit: &OTG_FS_GLOBAL) -> bool {
    let is_idle = || unit.grstctl().read().ahbidl().bit_is_set();
    if !CORE_IDS.contains(&unit.cid().read().bits()) || !within(POLLS, is_idle) {
        return false;
    }
    unit.grstctl().modify(|_, w| w.csrst().set_bit());
    within(POLLS, || unit.grstctl().read().csrst().bit_is_clear()) && within(POLLS, is_idle)
}

impl Usb {
    /// Answers the host, if the unit has something to say; fetches what has come.
    #[inline(never)]
    pub fn receive<'b>(&mut self, buffer: &'b mut [u8]) -> &'b [u8] {
        if !has_news() {
            return &[];
        }
        self.0.poll();
        self.0.receive(buffer)
    }

    /// Takes as many of these bytes as fit; tells how many.
    #[inline(never)]
    pub fn send(&mut self, bytes: &[u8]) -> usize {
        self.0.send(bytes)
    }
}

/// Whether the unit has raised anything that the driver listens to.
fn has_news() -> bool {
    // SAFETY: two reads without effect.
    #[expect(unsafe_code, reason = "the driver owns the registers and does not tell")]
    let unit = unsafe { &*OTG_FS_GLOBAL::ptr() };
    unit.gintsts().read().bits() & unit.gintmsk().read().bits() != 0
}
