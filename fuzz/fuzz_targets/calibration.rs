//! Text as a calibration: result, plan, raw samples.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| palpate_tests::fuzz_files::calibration(bytes));
