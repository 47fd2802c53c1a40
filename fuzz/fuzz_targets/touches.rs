//! Text as touches on a block.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| palpate_tests::fuzz_files::touches(bytes));
