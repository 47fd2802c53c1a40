//! palpate's firmware for the STM32F405. See `firmware/board/README.md` and `docs/HARDWARE.md`.
//!
//! `image` is the program; `record` is what it leaves in memory for the next start, `crystal` what it takes its clock from,
//! `temperature` what its sensor says.
//!
//! Built for the processor by `cargo xtask firmware build`. For any other target this is an empty program, so that
//! the whole workspace can be checked on a laptop that knows nothing of microcontrollers.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image;

#[cfg(any(test, target_os = "none"))]
mod crystal;
#[cfg(any(test, target_os = "none"))]
mod record;
#[cfg(any(test, target_os = "none"))]
mod temperature;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this program runs on a board: `cargo xtask firmware flash` puts it there");
}
