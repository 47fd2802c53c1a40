//! Text as a finger's motion.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| palpate_tests::fuzz_files::motion(bytes));
