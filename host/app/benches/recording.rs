//! What recording costs: bytes a second by what is kept, and processor time beside the same run without.
//!
//! Runs the tool as people do: ten seconds of `record` and `monitor` on a simulated finger at 4 kHz. Processor time is that of the
//! children, as the kernel counts it; where it cannot be read only sizes are printed.
//!
//! `cargo bench -p palpate-cli --bench recording`

#![allow(clippy::unwrap_used, reason = "a bench stops at whatever is wrong")]

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

const PALPATE: &str = env!("CARGO_BIN_EXE_palpate");

/// How long each run takes, s.
const SECONDS: f64 = 10.0;

/// How long `monitor` takes the tare before, which is kept too, s.
const TARE: f64 = 1.0;

/// Ticks a second of the kernel's accounts (`sysconf(_SC_CLK_TCK)`), 100 on every Linux.
const TICKS: f64 = 100.0;

/// Processor time of the children that have ended, s (`cutime` and `cstime`, proc(5)).
fn children_s() -> Option<f64> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<_> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |field: usize| fields.get(field)?.parse::<f64>().ok();
    Some((ticks(13)? + ticks(14)?) / TICKS)
}

/// Runs the tool; the processor time that it took, s.
fn run(folder: &Path, words: &[&str]) -> Option<f64> {
    let before = children_s();
    let output = Command::new(PALPATE).args(words).current_dir(folder).stdin(Stdio::null()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(children_s()? - before?)
}

fn main() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let _ = run(folder, &["calibrate", "-d", "sim:7", "--load", "2 N", "--contacts", "6", "--out", "."]);
    let entries = fs::read_dir(folder.join("finger-a")).unwrap().map(|entry| entry.unwrap().path());
    let calibration = entries.into_iter().find(|path| path.extension().is_some_and(|end| end == "toml")).unwrap();
    let calibration = calibration.to_str().unwrap();
    let seconds = SECONDS.to_string();
    let monitor = ["monitor", "-d", "sim:7", "-c", calibration, "--seconds", &seconds, "--json", "--print-hz", "10"];
    let yardstick = run(folder, &monitor);
    println!("{:34} {:>8} {:>9} {:>22}", "kept", "kB/s", "MB/h", "of a core, beside the run");
    let rows: [(&str, Vec<&str>); 4] = [
        ("the link alone", vec!["record", "a.mcap", "-d", "sim:7", "--seconds", &seconds]),
        ("and forces, 500 Hz", vec!["record", "b.mcap", "-d", "sim:7", "--seconds", &seconds, "-c", calibration]),
        ("and contacts, 500 Hz", [&monitor[..], &["--record", "c.mcap"]].concat()),
        ("and both of every sample", [&monitor[..], &["--record", "d.mcap", "--full"]].concat()),
    ];
    for (name, words) in rows {
        let took = run(folder, &words);
        let file = words.iter().find(|word| word.ends_with(".mcap")).unwrap();
        let kept = if words[0] == "monitor" { TARE + SECONDS } else { SECONDS };
        let kilobytes = fs::metadata(folder.join(file)).unwrap().len() as f64 * 1e-3 / kept;
        // `record` does less than `monitor`: only the same command tells what recording costs.
        let beside =
            took.zip(yardstick).filter(|_| words[0] == "monitor").map(|(took, without)| (took - without) / SECONDS);
        let beside = beside.map_or_else(|| "-".to_owned(), |share| format!("{:.2} %", 100.0 * share));
        println!("{name:34} {kilobytes:>8.1} {:>9.0} {beside:>22}", kilobytes * 3.6);
    }
}
