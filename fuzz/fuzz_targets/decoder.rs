//! Bytes from a device, of any kind.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| palpate_tests::fuzz::decoder(bytes));
