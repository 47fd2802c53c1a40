//! How much stack was ever in use: start-up paints it, and what was used has lost its paint. And its end, which nobody
//! may touch: below the RAM a chip may have other memory, so that overflowing it would not fault by itself.
//!
//! Registers: ARMv7-M manual, B3.5 (MPU).

use cortex_m::peripheral::MPU;
use cortex_m_rt::STACK_PAINT_VALUE;

/// Where the guard lies: below the stack, at the beginning of the RAM (`memory.x`). A multiple of its size.
const GUARD_START: u32 = 0x2000_0000;

/// Size of the guard as the MPU has it, a power of two: 256 bytes, of which most of what runs over them writes some.
const GUARD_LOG2: u32 = 8;

/// `MPU_RBAR`: the region in `MPU_RNR` is meant.
const REGION: u32 = 0;

/// `MPU_RASR`: nobody may read or write, nothing is code; so large; on.
const NO_ACCESS: u32 = 1 << 28 | (GUARD_LOG2 - 1) << 1 | 1;

/// `MPU_CTRL`: on, and all else is as without an MPU. Off in the fault handler, which may so write anywhere.
const ON_WITH_DEFAULTS: u32 = 1 << 2 | 1;

/// CFSR: an access was refused by the MPU, and its address is known.
const REFUSED_AT: u32 = 1 << 7 | 1 << 1;

/// Bytes that the processor saves when it takes an interrupt.
const FRAME_BYTES: u32 = 32;

/// Bytes of a word.
const WORD: u32 = 4;

/// Lowest and first address of the stack, from `memory.x`.
fn bounds() -> (u32, u32) {
    #[expect(unsafe_code, reason = "the linker's symbols; only their addresses are used")]
    unsafe extern "C" {
        static _stack_end: u32;
        static _stack_start: u32;
    }
    ((&raw const _stack_end) as u32, (&raw const _stack_start) as u32)
}

/// Lets everything fault that touches the guard.
pub(super) fn guard(mpu: &MPU) {
    // SAFETY: nothing lies there, and nothing else uses the MPU.
    #[expect(unsafe_code, reason = "what memory may be touched is for the whole program")]
    unsafe {
        mpu.rnr.write(REGION);
        mpu.rbar.write(GUARD_START);
        mpu.rasr.write(NO_ACCESS);
        mpu.ctrl.write(ON_WITH_DEFAULTS);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Whether the fault with this status was an access to the guard, `address` being the one that the MPU noted.
pub(super) fn is_guard(fault_status: u32, address: u32) -> bool {
    fault_status & REFUSED_AT == REFUSED_AT && address >> GUARD_LOG2 == GUARD_START >> GUARD_LOG2
}

/// Size of the stack, in bytes.
pub(super) fn size() -> u32 {
    let (low, high) = bounds();
    high - low
}

/// The most of it that was ever in use, in bytes; `known` is what an earlier call found, and saves work.
pub(super) fn used_max(known: u32) -> u32 {
    let (low, high) = bounds();
    let painted = (low..high - known).step_by(WORD as usize).take_while(|&address| {
        // SAFETY: within the stack's memory, and aligned.
        #[expect(unsafe_code, reason = "the stack's memory belongs to no variable")]
        let word = unsafe { (address as *const u32).read_volatile() };
        word == STACK_PAINT_VALUE
    });
    size() - WORD * u32::try_from(painted.count()).unwrap_or(0)
}

/// Whether the registers that an interrupt saved at this address lie on the stack.
pub(super) fn holds_frame(address: u32) -> bool {
    let (low, high) = bounds();
    address.is_multiple_of(WORD) && address >= low && address <= high - FRAME_BYTES
}
