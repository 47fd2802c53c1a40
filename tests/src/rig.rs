//! Devices, sessions and hostile lines for the end-to-end tests.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use palpate::finger::Samples;
use palpate_device::session::SessionOptions;
use palpate_device::simulated::{Config, Line, Pace, SimulatedDevice};
use palpate_device::{Incoming, LinkError, Session};
use palpate_shared::frame::FrameReader;
use palpate_shared::wire::{Command, CommandRead, Request};

/// Longest wait for anything, in s: a hundred times what it takes on an idle machine.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// A simulated device with the default finger, at the host's pace.
///
/// # Panics
/// If it cannot be started.
#[must_use]
pub fn device(seed: u64, line: Line) -> Arc<SimulatedDevice> {
    device_of(Config { seed, line, pace: Pace::AsRead, ..Config::default() })
}

/// A simulated device as configured.
///
/// # Panics
/// If it cannot be started.
#[must_use]
pub fn device_of(config: Config) -> Arc<SimulatedDevice> {
    Arc::new(SimulatedDevice::start(config).expect("the simulated device starts"))
}

/// A line that is as real as this system has it: a pseudo-terminal, or else TCP.
#[must_use]
pub fn real_line() -> Line {
    if cfg!(unix) { Line::Pty { link: None } } else { Line::Tcp { host: "127.0.0.1:0".to_owned() } }
}

/// A session with a device.
///
/// # Panics
/// If it cannot be opened.
#[must_use]
pub fn session(device: &Arc<SimulatedDevice>) -> Session {
    Session::open_simulated(Arc::clone(device), SessionOptions::default()).expect("the session opens")
}

/// Blocks from `session` until `count` samples are there.
///
/// # Panics
/// If the link fails or nothing comes within [`PATIENCE`].
pub fn samples(session: &mut Session, count: usize) -> Vec<Samples> {
    let mut blocks: Vec<Samples> = Vec::new();
    while blocks.iter().map(|block| block.counts.len()).sum::<usize>() < count {
        if let Incoming::Samples(block) = next(session) {
            blocks.push(block);
        }
    }
    blocks
}

/// Whatever comes next.
///
/// # Panics
/// If the link fails or nothing comes within [`PATIENCE`].
pub fn next(session: &mut Session) -> Incoming {
    session.next(PATIENCE).expect("the link holds").expect("something arrives in time")
}

/// Waits for the first incoming thing that `wanted` accepts, and returns what it made of it.
///
/// # Panics
/// If the link fails or it does not come within [`PATIENCE`].
pub fn wait_for<T>(session: &mut Session, wanted: impl Fn(Incoming) -> Option<T>) -> T {
    let begun = std::time::Instant::now();
    while begun.elapsed() < PATIENCE {
        if let Some(found) = wanted(next(session)) {
            return found;
        }
    }
    panic!("it did not come within {PATIENCE:?}");
}

/// A peer on TCP that answers each connection with `answer`, then listens on in silence.
///
/// # Panics
/// If no port is to be had.
#[must_use]
pub fn peer_that_says(answer: Vec<u8>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("a bound port");
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let answer = answer.clone();
            std::thread::spawn(move || {
                let mut stream = stream;
                let _ = stream.write_all(&answer);
                let _ = std::io::copy(&mut stream, &mut std::io::sink());
            });
        }
    });
    address
}

/// Where a robot stands that tells a line each 10 ms, by the seconds since it was asked first.
///
/// # Panics
/// If no port is to be had.
#[must_use]
pub fn robot_that_tells(line: impl Fn(f64) -> String + Clone + Send + 'static) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("a bound port");
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let line = line.clone();
            std::thread::spawn(move || {
                let begun = Instant::now();
                while writeln!(stream, "{}", line(begun.elapsed().as_secs_f64())).is_ok() {
                    std::thread::sleep(Duration::from_millis(10));
                }
            });
        }
    });
    address
}

/// A peer on TCP that understands commands and answers them as a test wants.
#[derive(Debug)]
pub struct Peer {
    /// Where it listens.
    pub address: SocketAddr,
    heard: Arc<Mutex<Vec<Command>>>,
}

impl Peer {
    /// A peer that answers a command with these frames, given the number of the connection; `None` hangs up.
    ///
    /// # Panics
    /// If no port is to be had.
    #[must_use]
    pub fn that_answers(answer: impl Fn(usize, &Command) -> Option<Vec<u8>> + Send + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let address = listener.local_addr().expect("a bound port");
        let heard = Arc::new(Mutex::new(Vec::new()));
        let all_heard = Arc::clone(&heard);
        std::thread::spawn(move || {
            for (number, stream) in listener.incoming().flatten().enumerate() {
                converse(stream, |command| {
                    all_heard.lock().expect("no test panics here").push(*command);
                    answer(number, command)
                });
            }
        });
        Self { address, heard }
    }

    /// The requests that it heard, repetitions included, in order.
    ///
    /// # Panics
    /// If the answering function did.
    #[must_use]
    pub fn requests(&self) -> Vec<Request> {
        self.heard.lock().expect("no test panics there").iter().map(|command| command.request).collect()
    }
}

/// Answers the commands that come by `stream` until it ends or `answer` hangs up.
fn converse(mut stream: TcpStream, answer: impl Fn(&Command) -> Option<Vec<u8>>) {
    let (mut frames, mut buffer) = (FrameReader::new(), [0; 4096]);
    while let Ok(length @ 1..) = stream.read(&mut buffer) {
        let mut rest = &buffer[..length];
        while !rest.is_empty() {
            let (taken, payload) = frames.push(rest);
            rest = &rest[taken..];
            let Some(Ok(payload)) = payload else { continue };
            let Ok(CommandRead::Command(command)) = Command::from_payload(payload) else { continue };
            match answer(&command) {
                Some(answer) if stream.write_all(&answer).is_ok() => {}
                _ => return,
            }
        }
    }
}

/// Opens a device by its TCP address.
///
/// # Errors
/// What the link says.
pub fn open_tcp(address: SocketAddr) -> Result<Session, LinkError> {
    Session::open(&format!("tcp:{address}").parse()?, SessionOptions { baud: None, reconnect: false })
}

/// A line that swallows commands and replies: `drops` decides for each, by direction and number, whether it is lost.
/// Samples, events and the like pass.
///
/// # Panics
/// If no port is to be had.
#[must_use]
pub fn lossy_line(device: SocketAddr, drops: fn(Towards, usize) -> bool) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("a bound port");
    std::thread::spawn(move || {
        for host in listener.incoming().flatten() {
            let Ok(device) = TcpStream::connect(device) else { return };
            let (Ok(host_too), Ok(device_too)) = (host.try_clone(), device.try_clone()) else { return };
            std::thread::spawn(move || forward(host_too, device_too, |number| drops(Towards::Device, number)));
            std::thread::spawn(move || forward(device, host, |number| drops(Towards::Host, number)));
        }
    });
    address
}

/// Which way a frame goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Towards {
    /// A command.
    Device,
    /// Samples, events, replies.
    Host,
}

/// Passes frames on, except those that `drops` names by number.
fn forward(mut from: TcpStream, mut to: TcpStream, drops: impl Fn(usize) -> bool) {
    let (mut buffer, mut frame, mut number) = ([0; 4096], Vec::new(), 0);
    while let Ok(length @ 1..) = from.read(&mut buffer) {
        for &byte in &buffer[..length] {
            frame.push(byte);
            if byte == 0 {
                let counts = is_command_or_reply(&frame);
                if !(counts && drops(number)) && to.write_all(&frame).is_err() {
                    return;
                }
                number += usize::from(counts);
                frame.clear();
            }
        }
    }
}

/// Whether a frame, delimiter included, is a command (first byte: the protocol's major version) or a reply (variant 3).
fn is_command_or_reply(frame: &[u8]) -> bool {
    let mut frame = frame[..frame.len() - 1].to_vec();
    let payload = palpate_shared::frame::decode_in_place(&mut frame).unwrap_or_default();
    matches!(payload.first(), Some(&PROTOCOL_MAJOR | &REPLY))
}

/// First byte of a command.
const PROTOCOL_MAJOR: u8 = palpate_shared::wire::PROTOCOL.major;

/// First byte of a reply.
const REPLY: u8 = 3;
