//! `palpate serve` on a finger of 4,000 samples a second: frames and samples that a page gets, and what that costs.
//!
//! The yardstick is the same program that nobody looks at, in the same run. Linux alone tells a process's time here; elsewhere
//! only frames are told. `cargo bench -p palpate-cli --bench serve`.

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

const PALPATE: &str = env!("CARGO_BIN_EXE_palpate");

/// Each case is looked at for so long.
const SPAN: Duration = Duration::from_secs(10);

/// Pages that never read.
const DEAF: usize = 20;

fn main() {
    let folder = tempfile::tempdir().expect("a folder");
    let words = ["calibrate", "-d", "sim:7", "--load", "2 N", "--contacts", "6", "--out", "calibration"];
    let calibrated = Command::new(PALPATE).args(words).current_dir(folder.path()).output().expect("palpate runs");
    assert!(calibrated.status.success(), "{}", String::from_utf8_lossy(&calibrated.stderr));
    let mut serve = Command::new(PALPATE);
    serve.args(["serve", "-d", "sim:7", "--port", "0", "--tare", "0.5", "-q"]).current_dir(folder.path());
    let mut served = serve.stdout(Stdio::piped()).spawn().expect("palpate runs");
    let url = BufReader::new(served.stdout.take().expect("piped")).lines().next().expect("an address").expect("text");
    let address = url.trim_start_matches("http://").trim_end_matches('/').to_owned();
    let mut page = Page::open(&address);
    while page.next()["condition"]["is"] != "free" {}
    drop(page);

    let alone = Cost::over(&served, || std::thread::sleep(SPAN));
    println!("no page:             {alone}");
    let mut page = Page::open(&address);
    let looked_at = Cost::over(&served, || page.look());
    println!("one page:            {looked_at}, {:.2} times as much", looked_at.cpu_s / alone.cpu_s);
    let deaf: Vec<_> = (0..DEAF).map(|_| ask(&address)).collect();
    let crowded = Cost::over(&served, || page.look());
    println!("and {DEAF} that are deaf: {crowded}, {:.2} times as much", crowded.cpu_s / alone.cpu_s);
    drop(deaf);
    let _ = served.kill();
    let _ = served.wait();
}

fn ask(address: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).expect("somebody listens");
    // As HTTP/1.0 the answer comes in one piece.
    write!(stream, "GET /events HTTP/1.0\r\nHost: {address}\r\n\r\n").expect("it is sent");
    stream
}

/// A page that reads.
struct Page(BufReader<TcpStream>);

impl Page {
    fn open(address: &str) -> Self {
        Self(BufReader::new(ask(address)))
    }

    fn next(&mut self) -> Value {
        loop {
            let mut line = String::new();
            assert!(self.0.read_line(&mut line).expect("the stream goes on") > 0, "the stream ended");
            if let Some(data) = line.strip_prefix("data: ") {
                return serde_json::from_str(data).expect("JSON");
            }
        }
    }

    /// Looks for [`SPAN`], and tells what came.
    fn look(&mut self) {
        let (begun, mut frames, mut samples, mut bytes) = (Instant::now(), 0_u32, 0, 0);
        while begun.elapsed() < SPAN {
            let message = self.next();
            assert_eq!(message["points"]["skipped"], 0);
            frames += 1;
            bytes += message.to_string().len();
            let points = message["points"]["of"].as_array().expect("a list").iter();
            // What a page that was just opened has of the past is none of it.
            if frames > 1 {
                samples += points.map(|point| point[1].as_u64().expect("a number")).sum::<u64>();
            }
        }
        let seconds = begun.elapsed().as_secs_f64();
        let per_second = |count: f64| count / seconds;
        println!(
            "  {:.1} frames/s, {:.0} samples/s in them, {:.0} kB/s",
            per_second(f64::from(frames)),
            per_second(samples as f64),
            per_second(bytes as f64) / 1e3
        );
    }
}

/// What a process takes.
struct Cost {
    cpu_s: f64,
    share: f64,
    resident_mb: f64,
}

impl Cost {
    fn over(child: &Child, meanwhile: impl FnOnce()) -> Self {
        let (before, begun) = (cpu_s(child), Instant::now());
        meanwhile();
        let used = cpu_s(child) - before;
        Self { cpu_s: used, share: used / begun.elapsed().as_secs_f64(), resident_mb: resident_mb(child) }
    }
}

impl std::fmt::Display for Cost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.1} % of a core, {:.1} MB resident", 100.0 * self.share, self.resident_mb)
    }
}

fn field(child: &Child, file: &str) -> String {
    fs::read_to_string(Path::new("/proc").join(child.id().to_string()).join(file)).unwrap_or_default()
}

/// User and system time of a process, s; its simulated device is part of it.
fn cpu_s(child: &Child) -> f64 {
    // Linux counts them in hundredths of a second.
    const TICKS_PER_S: f64 = 100.0;
    let stat = field(child, "stat");
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let ticks = after_name.split_whitespace().skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok());
    ticks.sum::<f64>() / TICKS_PER_S
}

fn resident_mb(child: &Child) -> f64 {
    let status = field(child, "status");
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kilobytes.unwrap_or(f64::NAN) / 1e3
}
