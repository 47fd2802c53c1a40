//! How much stack was ever in use: start-up paints it, and what was used has lost its paint.

use cortex_m_rt::STACK_PAINT_VALUE;

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
