//! When something goes wrong: record it, restart, and tell afterwards.
//!
//! - A panic records its place, a processor fault its registers; both restart at once.
//! - A main loop that stands still for [`HANG_TICKS`] is ended by SysTick, which records that. Should SysTick stand
//!   still as well, the independent watchdog resets the chip after [`WATCHDOG_MS`]; only the processor's flag tells.
//! - The stack lies at the bottom of the RAM (`memory.x`), above a guard (`stack`), so what overflows it faults. The
//!   fault handler begins with a stack of its own choosing, since the one there was is full.
//!
//! Registers: RM0090, sections 7.3.21 (RCC_CSR) and 21.4 (IWDG); ARMv7-M manual, B1.5.6 (frame) and B3.2.15 (CFSR).

use core::arch::naked_asm;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use heapless::String;
use palpate_shared::wire::{Failure, Fault, FaultCause, RestartReason};
use stm32f4::stm32f405::{DBGMCU, IWDG, RCC};

use super::stack;
use super::time::{self, TICKS_PER_S};
use crate::record::{Intent, Record, ResetFlags};

/// Ticks without a sign of life of the main loop after which it counts as hung: a second.
const HANG_TICKS: u32 = TICKS_PER_S;

/// Time after which the independent watchdog resets, in ms, at its oscillator's nominal 32 kHz (17 to 47 kHz).
const WATCHDOG_MS: u16 = 2000;

/// The watchdog's counter steps once in this many ms: 64 periods of its oscillator.
const WATCHDOG_STEP_MS: u16 = 2;

/// `IWDG_PR`'s code for 64.
const WATCHDOG_DIVIDE_BY_64: u8 = 4;

/// `IWDG_KR`: its registers may be written.
const WATCHDOG_UNLOCK: u16 = 0x5555;
/// `IWDG_KR`: it runs, and cannot be stopped any more.
const WATCHDOG_START: u16 = 0xCCCC;
/// `IWDG_KR`: it begins to count anew.
const WATCHDOG_FEED: u16 = 0xAAAA;

/// CFSR: the processor could not put its registers onto the stack.
const STACKING_FAILED: u32 = 1 << 12 | 1 << 4;

/// An address that belongs to no memory.
const NOWHERE: *const u32 = 0xB000_0000 as *const u32;

#[expect(unsafe_code, reason = "start-up clears every other section")]
#[unsafe(link_section = ".uninit.RECORD")]
static mut RECORD: MaybeUninit<Record> = MaybeUninit::uninit();

/// The tick of the main loop's last sign of life.
static ALIVE_AT: AtomicU32 = AtomicU32::new(0);

/// Samples numbered so far, for the record.
static SAMPLES: AtomicU32 = AtomicU32::new(0);

/// Reads the record from the memory that start-up leaves alone.
fn load() -> Record {
    // SAFETY: every pattern of bits is a record, and nothing else runs that could write it at the same time: only
    // start-up writes it, and what ends the program.
    #[expect(unsafe_code, reason = "memory that start-up does not clear")]
    unsafe {
        (&raw const RECORD).cast::<Record>().read_volatile()
    }
}

/// Writes the record to the memory that start-up leaves alone.
fn store(record: Record) {
    // SAFETY: as in `load`.
    #[expect(unsafe_code, reason = "memory that start-up does not clear")]
    unsafe {
        (&raw mut RECORD).cast::<Record>().write_volatile(record.sealed());
    }
}

/// What is known of the run before.
pub(super) struct Before {
    pub(super) reason: RestartReason,
    pub(super) restarts: u16,
    pub(super) fault: Option<Fault>,
    /// The chip's own loader is to take over.
    pub(super) wants_loader: bool,
}

/// Begins a run: finds out why, and leaves a fresh record.
pub(super) fn begin(rcc: &RCC) -> Before {
    let csr = rcc.csr().read();
    let flags = ResetFlags {
        power_on: csr.porrstf().bit(),
        brown_out: csr.borrstf().bit(),
        watchdog: csr.wdgrstf().bit() || csr.wwdgrstf().bit(),
        software: csr.sftrstf().bit(),
        pin: csr.padrstf().bit(),
    };
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    let last = load().checked();
    let (record, reason) = Record::begin(last, flags);
    store(record);
    let wants_loader = Record::wants_loader(last, flags);
    Before { reason, restarts: record.restarts(), fault: record.fault(), wants_loader }
}

/// The watchdogs: one in SysTick, which can tell, and the chip's, which always works.
pub(super) struct Watchdog(IWDG);

impl Watchdog {
    /// Starts both. The chip's stands still while a debug probe halts the core.
    pub(super) fn start(watchdog: IWDG, debug_unit: &DBGMCU) -> Self {
        debug_unit.apb1_fz().modify(|_, w| w.dbg_iwdg_stop().set_bit());
        let key = |value| {
            // SAFETY: one of the three keys.
            #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
            watchdog.kr().write(|w| unsafe { w.key().bits(value) });
        };
        key(WATCHDOG_START);
        key(WATCHDOG_UNLOCK);
        // SAFETY: three bits, and twelve.
        #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
        unsafe {
            watchdog.pr().write(|w| w.pr().bits(WATCHDOG_DIVIDE_BY_64));
            watchdog.rlr().write(|w| w.rl().bits(WATCHDOG_MS / WATCHDOG_STEP_MS));
        }
        Self(watchdog)
    }

    /// The main loop is alive.
    pub(super) fn feed(&self) {
        let now = time::ticks();
        // If SysTick stands still, nobody watches the main loop: then the chip's watchdog shall bite.
        if ALIVE_AT.swap(now, Ordering::Relaxed) != now {
            // SAFETY: one of the three keys.
            #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
            self.0.kr().write(|w| unsafe { w.key().bits(WATCHDOG_FEED) });
        }
    }
}

/// So many samples were numbered by now.
pub(super) fn note_samples(samples: u32) {
    SAMPLES.store(samples, Ordering::Relaxed);
}

/// Called at every tick: ends a main loop that stands still.
pub(super) fn watch(ticks: u32) {
    if ticks.wrapping_sub(ALIVE_AT.load(Ordering::Relaxed)) >= HANG_TICKS {
        end(&fault(FaultCause::Hang));
    }
}

/// Restarts, as the host has asked.
pub(super) fn reboot() -> ! {
    store(load().with_intent(Intent::Requested));
    SCB::sys_reset()
}

/// Restarts, to hand over to the chip's own loader. By way of a reset, since nothing else stops the independent watchdog.
pub(super) fn enter_loader() -> ! {
    store(load().with_intent(Intent::EnterLoader));
    SCB::sys_reset()
}

/// Fails on purpose, as the host has asked.
pub(super) fn fail(failure: Failure) -> ! {
    match failure {
        Failure::Panic => panic!("asked for"),
        Failure::Hang => hang(),
        Failure::BadAccess => {
            // SAFETY: none; this is meant to fault.
            #[expect(unsafe_code, reason = "a read where no memory is, on purpose")]
            let found = unsafe { NOWHERE.read_volatile() };
            defmt::error!("memory where none should be: {=u32}", found);
            hang()
        }
        Failure::StackOverflow => {
            defmt::error!("the stack has no end: {=u32}", descend(0));
            hang()
        }
    }
}

/// Stands still until it is found hanging.
fn hang() -> ! {
    loop {
        cortex_m::asm::nop();
    }
}

/// Calls itself until the stack is full.
#[expect(unconditional_recursion, reason = "on purpose")]
#[inline(never)]
fn descend(depth: u32) -> u32 {
    let room = core::hint::black_box([depth; 16]);
    descend(depth + 1).wrapping_add(core::hint::black_box(room[3]))
}

/// A fault of which no more is known.
fn fault(cause: FaultCause) -> Fault {
    Fault {
        cause,
        uptime_s: time::ticks() / TICKS_PER_S,
        samples: SAMPLES.load(Ordering::Relaxed),
        program_counter: 0,
        return_address: 0,
        fault_status: 0,
        place: String::new(),
    }
}

/// Records the fault and restarts.
fn end(fault: &Fault) -> ! {
    store(load().with_fault(fault));
    SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    let mut panic = fault(FaultCause::Panic);
    if let Some(place) = info.location() {
        panic.place = in_words(place.file(), place.line());
    }
    end(&panic)
}

/// The end of a file's path, which says more than its beginning, and a line. Formatting it costs 4 KiB of flash less
/// by hand.
fn in_words(file: &str, line: u32) -> String<40> {
    let mut place = String::new();
    let digits = [10_000, 1000, 100, 10, 1].map(|unit| char::from(b'0' + (line / unit % 10).to_le_bytes()[0]));
    let start = file.len().saturating_sub(place.capacity() - 1 - digits.len());
    // Fits by construction; paths here are ASCII.
    let _ = place.push_str(file.get(start..).unwrap_or_default());
    let leading = digits.iter().take_while(|&&digit| digit == '0').count();
    let _ = core::iter::once(&':').chain(&digits[leading..]).try_for_each(|&character| place.push(character));
    place
}

/// The processor's fault handler: notes where the registers were saved, takes a fresh stack, goes on.
#[allow(unsafe_code, reason = "the vector table takes this name; nothing else here has it")]
#[unsafe(naked)]
#[unsafe(no_mangle)]
extern "C" fn HardFault() -> ! {
    naked_asm!(
        "mrs r0, msp",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "mov sp, r1",
        "b {recorded}",
        recorded = sym processor_fault,
    )
}

/// Records a processor fault; `frame` is where the processor saved its registers, if it could.
extern "C" fn processor_fault(frame: *const u32) -> ! {
    // SAFETY: a read of a register that is always there.
    #[expect(unsafe_code, reason = "the fault handler owns nothing")]
    let (fault_status, address) = unsafe { ((*SCB::PTR).cfsr.read(), (*SCB::PTR).mmfar.read()) };
    let overflow = fault_status & STACKING_FAILED != 0
        || stack::is_guard(fault_status, address)
        || !stack::holds_frame(frame as u32);
    let known = fault(if overflow { FaultCause::StackOverflow } else { FaultCause::Processor });
    let [return_address, program_counter] = if overflow {
        [0; 2]
    } else {
        // SAFETY: the frame lies on the stack.
        #[expect(unsafe_code, reason = "the saved registers are at an address and nowhere else")]
        [5, 6].map(|register| unsafe { frame.add(register).read_volatile() })
    };
    end(&Fault { program_counter, return_address, fault_status, ..known })
}
