//! The two sectors of the chip's flash in which the matrix of forces outlives a restart: 1 and 2, of 16 KiB each, the smallest that
//! there are (`memory.x` keeps the image off them).
//!
//! While the flash erases or writes, nothing can be read from it, the image neither: the whole chip stands still, for 16 µs a word
//! and a quarter of a second a sector (half a second at most; STM32F405 datasheet, "Flash memory programming", 32 bits at a time).
//! The independent watchdog waits 1.3 s and more. The cycle counter runs on, and tells how long it was; the device's time is put
//! forward by that. An emulator's flash takes nothing: then what is read back is not what was written.
//!
//! Registers: RM0090, chapter 3.

use cortex_m::peripheral::{DCB, DWT};
use palpate_firmware_core::store::{Flash, Sector};
use stm32f4::stm32f405::FLASH;

use super::time;

/// Where sector 1 begins.
const START: u32 = 0x0800_4000;

/// Bytes of a sector.
const SECTOR_BYTES: u32 = 16 * 1024;

/// Bytes of a word.
const WORD: u32 = 4;

/// `FLASH_KEYR`: both unlock the control register, in this order.
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// `FLASH_CR`: 32 bits at a time, which 2.7 V and more allow.
const WORDS_AT_A_TIME: u32 = 0b10 << 8;

/// `FLASH_CR`: words may be written; a sector is to be erased; its number's place.
const WRITE: u32 = 1;
const ERASE: u32 = 1 << 1;
const SECTOR_SHIFT: u32 = 3;

/// `FLASH_SR`: all that tells of something that went wrong; each is cleared by writing it.
const FAILURES: u32 = 0b1111_0010;

/// How often a busy flash is looked at. It is fetched from itself, so one look takes until it is done.
const POLLS: u32 = 100_000;

/// The sectors, and the unit that writes them.
pub(super) struct Sectors(FLASH);

impl Sectors {
    /// Starts the counter of cycles, too, by which it is told how long the chip stood still.
    pub(super) fn new(unit: FLASH, debug: &mut DCB, cycles: &mut DWT) -> Self {
        debug.enable_trace();
        cycles.enable_cycle_counter();
        Self(unit)
    }

    fn address(sector: Sector, at: usize) -> u32 {
        let at = u32::try_from(at).unwrap_or(0);
        START + SECTOR_BYTES * sector as u32 + WORD * at
    }

    /// Has the unit do something with its control register unlocked, and set so; the device's time goes on meanwhile.
    fn work(&self, control: u32, start: impl FnOnce(&FLASH)) {
        let unit = &self.0;
        time::over_a_stall(|| {
            // SAFETY: keys and fields as the manual has them; nothing else uses the unit.
            #[expect(unsafe_code, reason = "the access crate does not know the keys")]
            unsafe {
                for key in KEYS {
                    unit.keyr().write(|w| w.bits(key));
                }
                unit.sr().write(|w| w.bits(FAILURES));
                unit.cr().write(|w| w.bits(control));
            }
            start(unit);
            cortex_m::asm::dsb();
            // Should it never be done, what is read back tells.
            let _ = (0..POLLS).any(|_| unit.sr().read().bsy().bit_is_clear());
            unit.cr().write(|w| w.lock().set_bit());
            // What was read before must not be told from memory of it (RM0090, 3.5.4).
            unit.acr().modify(|_, w| w.dcen().clear_bit());
            unit.acr().modify(|_, w| w.dcrst().set_bit());
            unit.acr().modify(|_, w| w.dcrst().clear_bit().dcen().set_bit());
        });
    }
}

impl Flash for Sectors {
    const WORDS: usize = (SECTOR_BYTES / WORD) as usize;

    fn word(&self, sector: Sector, at: usize) -> u32 {
        // SAFETY: within both sectors, which hold no variable, and aligned.
        #[expect(unsafe_code, reason = "flash that the linker leaves free")]
        unsafe {
            (Self::address(sector, at) as *const u32).read_volatile()
        }
    }

    fn erase(&mut self, sector: Sector) {
        // Sectors 1 and 2 of the chip.
        let number = 1 + sector as u32;
        self.work(WORDS_AT_A_TIME | ERASE | number << SECTOR_SHIFT, |unit| {
            unit.cr().modify(|_, w| w.strt().set_bit());
        });
    }

    fn write(&mut self, sector: Sector, at: usize, word: u32) {
        self.work(WORDS_AT_A_TIME | WRITE, |_| {
            // SAFETY: as for reading; the unit lets it be written once.
            #[expect(unsafe_code, reason = "flash that the linker leaves free")]
            unsafe {
                (Self::address(sector, at) as *mut u32).write_volatile(word);
            }
        });
    }
}
