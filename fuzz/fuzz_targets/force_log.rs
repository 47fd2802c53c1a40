//! Text as the log of a force sensor.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| palpate_tests::fuzz_files::force_log(bytes));
