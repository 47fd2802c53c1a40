//! Bytes to samples: frames, checksum, messages. Run with `cargo bench --bench decode`.
//!
//! The bar: 100 MB/s on one core, which is 2,500 fingers at 4 kHz.

#[path = "../../science/benches/yardstick/mod.rs"]
mod yardstick;

use std::hint::black_box;

use palpate_device::wire_reader::MessageReader;
use palpate_shared::frame::{FRAME_MAX, encode};
use palpate_shared::units::{Counts, DeviceTime, Seq};
use palpate_shared::wire::{Block, FromDevice, Status};
use yardstick::best_of_runs;

/// Blocks in the stream: ten seconds at 4 kHz, too much for the first-level cache.
const BLOCKS: u32 = 5000;

/// Bytes that a reading thread gets at a time.
const PIECE: usize = 4096;

fn main() {
    for (name, amplitude) in [("2 N load, 24 counts of noise", 53_000), ("full scale", 8_000_000)] {
        measure(name, &stream(amplitude));
    }
}

/// A stream of blocks whose counts swing by `amplitude`.
fn stream(amplitude: i32) -> Vec<u8> {
    let mut bytes = Vec::new();
    for number in 0..BLOCKS {
        let sample = |i: i32| [Counts(amplitude + i * 7 % 24), Counts(-amplitude - i * 5 % 24)];
        let block = FromDevice::Block(Block {
            first: Seq(8 * number),
            time: DeviceTime(2000 * number),
            status: Status::default(),
            samples: (0..8).map(sample).collect(),
        });
        let mut buffer = [0; FRAME_MAX + 1];
        bytes.extend_from_slice(encode(&block, &mut buffer).unwrap_or_default());
    }
    bytes
}

fn measure(name: &str, bytes: &[u8]) {
    let mut samples = 0;
    let decode_s = best_of_runs(|| {
        let mut reader = MessageReader::default();
        samples = 0;
        for piece in bytes.chunks(PIECE) {
            reader.read(black_box(piece), |message| {
                if let FromDevice::Block(block) = black_box(message) {
                    samples += block.samples.len();
                }
            });
        }
    });
    let mut copy = vec![0; bytes.len()];
    let copy_s = best_of_runs(|| black_box(&mut copy).copy_from_slice(black_box(bytes)));
    let rate = |seconds: f64| bytes.len() as f64 / seconds / 1e6;
    println!(
        "{name}: {:.1} bytes a block; decode {:.0} MB/s, {:.1} million samples/s; memcpy of the same bytes {:.0} MB/s; \
         decoding takes {:.0} times a memcpy",
        bytes.len() as f64 / f64::from(BLOCKS),
        rate(decode_s),
        samples as f64 / decode_s / 1e6,
        rate(copy_s),
        decode_s / copy_s,
    );
}
