//! What must hold for any bytes at all: the bodies of the fuzz targets.
//!
//! Each takes bytes and panics if a law is broken. `tests/e2e/fuzz.rs` runs them on mutations of a kept corpus with
//! stable Rust; `fuzz/` hands them to libFuzzer where there is a nightly compiler.

use palpate::link::reader::{MessageReader, ReaderCounts};
use palpate_shared::wire::FromDevice;

use crate::oracle;

/// Bytes from a device: the reader accepts exactly the frames that a slow, separate decoder accepts, whatever
/// pieces they come in, and counts the others.
///
/// # Panics
/// If that is not so.
pub fn decoder(bytes: &[u8]) {
    let (whole, counts) = read_in_pieces(bytes, bytes.len().max(1));
    for step in [1, 7, 64] {
        assert_eq!(read_in_pieces(bytes, step), (whole.clone(), counts), "in pieces of {step}");
    }
    let payloads = oracle::good_payloads(bytes);
    let accepted: Vec<FromDevice> =
        payloads.iter().filter_map(|payload| FromDevice::from_payload(payload).ok()).collect();
    assert_eq!(whole, accepted);
    let frames = oracle::frames(bytes).count() as u64;
    assert!(counts.messages + counts.damaged + counts.unknown + counts.malformed <= frames);
}

fn read_in_pieces(bytes: &[u8], step: usize) -> (Vec<FromDevice>, ReaderCounts) {
    let (mut reader, mut messages) = (MessageReader::default(), Vec::new());
    bytes.chunks(step).for_each(|piece| reader.read(piece, |message| messages.push(message)));
    (messages, reader.counts())
}
