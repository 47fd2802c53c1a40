//! Text as the description of a part.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| palpate_tests::fuzz_files::part(bytes));
