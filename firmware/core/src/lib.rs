//! palpate's firmware without a board.
#![no_std]

#[cfg(test)]
extern crate std;
