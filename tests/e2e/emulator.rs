//! The board's own image in the emulator, driven over its serial line by the real host.
//!
//! What is asserted is content, order and counters, never speed: the machine's time depends on its instructions
//! alone, and the host's time on everything else that the computer does.

#[path = "../../xtask/src/emulator.rs"]
mod emulator;

#[path = "../../xtask/src/image.rs"]
#[allow(dead_code, reason = "only its place and the log's lines are wanted here")]
mod image;

#[cfg(unix)]
#[path = "emulator/hardware.rs"]
mod hardware;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant, SystemTime};

use emulator::Serial;
use palpate::finger::Samples;
use palpate_device::dfu::simulated::{Faults, Loader};
use palpate_device::dfu::{self, FirmwareFile};
use palpate_device::session::SessionOptions;
use palpate_device::wire_reader::MessageReader;
use palpate_device::{Address, Incoming, LinkError, Session};
use palpate_shared::force::ForceMatrix;
use palpate_shared::frame::{DELIMITER, FRAME_MAX, encode};
use palpate_shared::wire::{
    Checks, ClockSource, Command as ToDevice, CommandId, Failure, FaultCause, FromDevice, Health, Outcome, Refusal,
    Reply, Request, RestartReason, Source, Status,
};
use palpate_tests::rig;

/// The image to test; otherwise the one that `cargo xtask firmware build` left.
const IMAGE_VARIABLE: &str = "PALPATE_FIRMWARE";

/// Times that a host tries to get hold of a machine that is starting.
const ATTEMPTS: u32 = 20;

/// The processor's clock on the board, in Hz.
const BOARD_HZ: f64 = 168e6;

/// Samples a second of the bar.
const RATE_HZ: u32 = 4000;

/// Part of the processor that the path from DRDY to queued bytes may take at [`RATE_HZ`].
const SHARE_MAX: f64 = 0.05;

/// A machine in the emulator. It ends when this is dropped.
struct Machine {
    process: Child,
    address: Address,
}

impl Drop for Machine {
    fn drop(&mut self) {
        // It may have ended by itself, which some test will have noticed.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// What makes an image, or makes it anew.
const REMEDY: &str = "`cargo xtask firmware build` builds it, `cargo xtask firmware emulate --test` tests it too";

/// Says, once, why these tests do not run; not through the test harness, which would keep it to itself.
fn absent(reason: &str) -> Option<PathBuf> {
    let _ = writeln!(std::io::stderr(), "the emulator's end-to-end test did not run: {reason}");
    None
}

/// The image and the machine for it, or `None` after saying why not.
fn image() -> Option<(&'static PathBuf, &'static str)> {
    static IMAGE: OnceLock<Option<PathBuf>> = OnceLock::new();
    let image = IMAGE.get_or_init(|| match (std::env::var_os(IMAGE_VARIABLE), emulator::machine()) {
        (Some(_), None) => panic!("{} has no STM32F405, or is not installed", emulator::PROGRAM),
        (Some(path), Some(_)) => Some(PathBuf::from(path)),
        (None, None) => absent(&format!("{} is not installed", emulator::PROGRAM)),
        (None, Some(_)) => built(),
    });
    image.as_ref().zip(emulator::machine())
}

/// The image that was built last in this target folder, unless its sources changed since. Nothing is built here: a test
/// that compiles measures the computer, and may change the code under the other tests.
fn built() -> Option<PathBuf> {
    // Tests run from `<target>/<profile>/deps`.
    let me = std::env::current_exe().expect("a test knows its program");
    let path = image::path_in(me.ancestors().nth(3).expect("a test lies in the target folder"));
    match modified(&path) {
        None => absent(&format!("no image is built; {REMEDY}")),
        Some(built) if changed_since(&path, built) => {
            absent(&format!("the image {} is older than its sources; {REMEDY}", path.display()))
        }
        Some(_) => Some(path),
    }
}

/// When a file was last written; `None` if it is not there.
fn modified(path: &Path) -> Option<SystemTime> {
    std::fs::metadata(path).and_then(|about| about.modified()).ok()
}

/// Whether a source of an image, as the compiler listed them beside it, was changed after it was built.
fn changed_since(image: &Path, built: SystemTime) -> bool {
    let listed = std::fs::read_to_string(image.with_extension("d")).unwrap_or_default();
    let sources = listed.split_once(": ").map_or("", |(_, sources)| sources).replace("\\ ", "\0");
    let mut sources = sources.split_whitespace().map(|source| source.replace('\0', " "));
    sources.any(|source| modified(Path::new(&source)).is_none_or(|changed| changed > built))
}

/// A machine that waits for its host at a TCP port.
fn tcp_machine() -> Option<Machine> {
    let (image, machine) = image()?;
    Some(tcp_machine_of(machine, image, &[]))
}

/// A machine at a TCP port, with more arguments for the emulator.
fn tcp_machine_of(machine: &str, image: &Path, more: &[&str]) -> Machine {
    let port = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a free port").port();
    let mut command = emulator::command(machine, image, Serial::Tcp { port, wait: true });
    command.args(more).stdout(Stdio::null()).stderr(Stdio::null());
    let process = command.spawn().expect("the emulator starts");
    Machine { process, address: Address::Tcp(format!("127.0.0.1:{port}")) }
}

/// The chip's RAM: address and size.
#[cfg(unix)]
const RAM: (u32, usize) = (0x2000_0000, 128 * 1024);

/// What a debug probe would see of the log: the bytes in the first channel of the RTT block, which it finds by its
/// name.
///
/// Source: SEGGER's RTT description: 16 bytes of name, two counts, then for each channel six words: name, buffer, size,
/// write, read, flags.
#[cfg(unix)]
fn rtt_bytes(ram: &[u8]) -> Option<&[u8]> {
    let block = ram.windows(16).position(|name| name == b"SEGGER RTT\0\0\0\0\0\0")?;
    let word = |index: usize| Some(u32::from_le_bytes(ram.get(block + 24 + 4 * index..)?.get(..4)?.try_into().ok()?));
    let start = usize::try_from(word(1)?.checked_sub(RAM.0)?).ok()?;
    ram.get(start..)?.get(..usize::try_from(word(3)?).ok()?)
}

/// The machine's memory, by way of the emulator's control socket.
#[cfg(unix)]
fn memory(control: &std::path::Path, folder: &std::path::Path) -> std::io::Result<Vec<u8>> {
    let (stream, file) = (std::os::unix::net::UnixStream::connect(control)?, folder.join("ram"));
    let (mut answers, mut orders) = (BufReader::new(stream.try_clone()?), stream);
    let save = serde_json::json!({
        "execute": "pmemsave",
        "arguments": { "val": RAM.0, "size": RAM.1, "filename": file },
    });
    for order in [serde_json::json!({ "execute": "qmp_capabilities" }), save] {
        orders.write_all(format!("{order}\n").as_bytes())?;
    }
    let mut returned = 0;
    while returned < 2 {
        let mut line = String::new();
        if answers.read_line(&mut line)? == 0 || line.contains("\"error\"") {
            return Err(std::io::Error::other(line));
        }
        returned += usize::from(line.contains("\"return\""));
    }
    std::fs::read(file)
}

/// Undoes defmt's packing of a frame (rzCOBS: read from its end, each control byte tells which of the seven bytes
/// before it were zero, or how many were not).
#[cfg(unix)]
fn unpack(packed: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = packed.iter().rev().copied();
    let mut frame = Vec::new();
    while let Some(control) = bytes.next() {
        match control {
            0 => return None,
            1..=0x7F => {
                for bit in (0..7).rev() {
                    frame.push(if control >> bit & 1 == 1 { 0 } else { bytes.next()? });
                }
            }
            0x80..=0xFE => {
                frame.push(0);
                for _ in 0..(control & 0x7F) + 7 {
                    frame.push(bytes.next()?);
                }
            }
            0xFF => {
                for _ in 0..134 {
                    frame.push(bytes.next()?);
                }
            }
        }
    }
    frame.reverse();
    Some(frame)
}

/// A frame as a person reads it: level and text, its numbers put in where they are whole ones of 32 bits.
#[cfg(unix)]
fn line_of(frame: &[u8], lines: &[(u32, String)]) -> Option<String> {
    let (number, mut arguments) = frame.split_first_chunk::<2>()?;
    let number = u32::from(u16::from_le_bytes(*number));
    let (_, about) = lines.iter().find(|(known, _)| *known == number)?;
    let about: serde_json::Value = serde_json::from_str(about).ok()?;
    let level = about["tag"].as_str()?.strip_prefix("defmt_")?.to_owned();
    let mut text = about["data"].as_str()?.to_owned();
    while let (Some(at), Some((value, rest))) = (text.find("{=u32}"), arguments.split_first_chunk::<4>()) {
        text.replace_range(at..at + "{=u32}".len(), &u32::from_le_bytes(*value).to_string());
        arguments = rest;
    }
    Some(format!("{level} {text}"))
}

#[cfg(unix)]
#[test]
fn the_log_is_there_and_readable() {
    let Some((image_path, machine)) = image() else { return };
    let folder = tempfile::tempdir().unwrap();
    let control = folder.path().join("control");
    let machine =
        tcp_machine_of(machine, image_path, &["-qmp", &format!("unix:{},server=on,wait=off", control.display())]);
    machine.open_simulated();
    let ram = memory(&control, folder.path()).unwrap();
    let lines = image::Image::read(image_path).expect("the image can be read").log_lines;
    let log: Vec<String> = rtt_bytes(&ram)
        .expect("an RTT block")
        .split(|&byte| byte == 0)
        .filter_map(unpack)
        .filter_map(|frame| line_of(&frame, &lines))
        .collect();
    println!("{}", log.join("\n"));
    for wanted in ["info core at 168000000 Hz", "info no USB", "warn no front-end", "info front-end found"] {
        assert!(log.iter().any(|line| line.contains(wanted)), "{wanted:?} is not in {log:#?}");
    }
}

/// A machine at a pseudo-terminal, on systems that have those.
fn pty_machine() -> Option<Machine> {
    let (image, machine) = image().filter(|_| cfg!(unix))?;
    let mut command = emulator::command(machine, image, Serial::Pty);
    let mut process = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("the emulator starts");
    let mut line = String::new();
    BufReader::new(process.stdout.take().expect("a pipe")).read_line(&mut line).expect("the emulator's first line");
    // "char device redirected to /dev/pts/3 (label serial0)"
    let path = line.split_whitespace().find(|word| word.starts_with("/dev/")).expect("a terminal's path").to_owned();
    Some(Machine { process, address: Address::Serial(path) })
}

impl Machine {
    /// Opens it, as soon as it lets itself be opened.
    fn open(&self) -> Session {
        let mut last = None;
        for _ in 0..ATTEMPTS {
            match Session::open(&self.address, SessionOptions::default()) {
                Ok(session) => return session,
                Err(error) => last = Some(error),
            }
            std::thread::sleep(Duration::from_millis(250));
        }
        panic!("{:?}: {last:?}", self.address);
    }

    /// Opens it and switches to its simulated finger.
    fn open_simulated(&self) -> Session {
        let mut session = self.open();
        session.set_source(Source::Simulated).expect("the image has a simulated finger");
        assert_eq!(session.hello().source, Source::Simulated);
        session
    }
}

/// Checks that blocks follow each other without a gap and all say that they are simulated.
fn assert_whole(blocks: &[Samples]) {
    for pair in blocks.windows(2) {
        assert_eq!((pair[1].missing_before, pair[0].first + pair[0].counts.len() as u64), (0, pair[1].first));
    }
    assert!(blocks.iter().all(|block| block.status.contains(Status::SIMULATED)));
}

/// Streams so many samples, checks them, and returns them.
fn stream(session: &mut Session, count: usize) -> Vec<Samples> {
    session.start().expect("it starts");
    let blocks = rig::samples(session, count);
    session.stop().expect("it stops");
    assert_whole(&blocks);
    blocks
}

fn refusal<T: std::fmt::Debug>(result: Result<T, LinkError>) -> Refusal {
    match result {
        Err(LinkError::Refused { refusal, .. }) => refusal,
        other => panic!("{other:?} is no refusal"),
    }
}

/// What these tests, without an image that is named, say on standard error from a program at `me`, with this search
/// path.
fn said_where_they_do_not_run(me: &Path, search: &Path) -> String {
    let others = ["--skip", "where_no_", "--test-threads", "1"];
    let mut command = Command::new(me);
    let output = command.args(others).env("PATH", search).env_remove(IMAGE_VARIABLE).output().expect("it starts");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    said
}

#[test]
fn where_no_emulator_is_installed_these_tests_say_so_in_one_line() {
    let me = std::env::current_exe().expect("a test knows its program");
    let said = said_where_they_do_not_run(&me, Path::new(""));
    assert_eq!(said, "the emulator's end-to-end test did not run: qemu-system-arm is not installed\n");
}

#[cfg(unix)]
#[test]
fn where_no_image_is_built_these_tests_say_how_to_build_one() {
    use std::os::unix::fs::PermissionsExt as _;
    // A target folder without an image, and a stand-in for the emulator that knows the board.
    let real = std::env::current_exe().unwrap();
    let folder = tempfile::tempdir_in(real.parent().unwrap()).unwrap();
    let me = folder.path().join("debug/deps/emulator");
    std::fs::create_dir_all(me.parent().unwrap()).unwrap();
    std::fs::hard_link(real, &me).unwrap();
    let emulator = folder.path().join(emulator::PROGRAM);
    std::fs::write(&emulator, "#!/bin/sh\necho olimex-stm32-h405 a board\n").unwrap();
    std::fs::set_permissions(&emulator, std::fs::Permissions::from_mode(0o755)).unwrap();
    let said = said_where_they_do_not_run(&me, folder.path());
    assert_eq!(said, format!("the emulator's end-to-end test did not run: no image is built; {REMEDY}\n"));

    // An image older than what it was made from is not taken for it.
    let image = image::path_in(folder.path());
    std::fs::create_dir_all(image.parent().unwrap()).unwrap();
    std::fs::write(&image, "").unwrap();
    std::fs::write(image.with_extension("d"), format!("{}: /no/such/source.rs\n", image.display())).unwrap();
    let said = said_where_they_do_not_run(&me, folder.path());
    assert!(said.contains("is older than its sources") && said.contains("cargo xtask firmware build"), "{said}");
}

#[test]
fn without_a_chip_the_image_says_so_and_streams_nothing() {
    let Some(machine) = tcp_machine() else { return };
    let mut session = machine.open();
    let hello = session.hello().clone();
    assert_eq!((hello.board.as_str(), hello.clock), ("STM32-H405, emulated", ClockSource::Host));
    assert_eq!((hello.source, hello.front_end.id_word, hello.restart), (Source::Hardware, 0, RestartReason::PowerOn));
    assert_eq!(refusal(session.self_test()), Refusal::NoFrontEnd);
    assert_eq!(refusal(session.read_register(0)), Refusal::NoFrontEnd);
    assert_eq!(refusal(session.set_gain(16)), Refusal::NoFrontEnd);
    assert_eq!(refusal(session.start()), Refusal::NoFrontEnd);
    session.ping().unwrap();
    let counters = session.device_counters().unwrap();
    assert_eq!((counters.samples, counters.blocks_sent, counters.frames_damaged), (0, 0, 0));
    assert_eq!(counters.commands_refused, 4);
    assert_eq!(session.counts().samples, 0);
}

#[test]
fn every_command_works_on_the_simulated_finger_and_twenty_thousand_samples_arrive() {
    let Some(machine) = tcp_machine() else { return };
    let mut session = machine.open_simulated();
    let front_end = session.hello().front_end;
    assert_eq!(front_end.id_word >> 8, u16::from(front_end.kind.facts().id_high));
    assert_eq!(session.read_register(0).unwrap(), session.hello().front_end.id_word);
    let blocks = stream(&mut session, 20_000);
    // Three seconds free, then a force of 2 N that travels round the disk: both bridges see it come or go.
    for channel in 0..2 {
        let counts = || blocks.iter().flat_map(|block| &block.counts).map(|counts| counts[channel].0);
        let (least, most) = (counts().min().unwrap(), counts().max().unwrap());
        assert!(least < most && most - least > 10_000, "channel {channel}: {least} to {most}");
    }
    // Time is the sampler's: one period from sample to sample.
    for pair in blocks.windows(2) {
        assert_eq!(pair[1].time_us - pair[0].time_us, 250 * pair[0].counts.len() as u64);
    }
    let test = session.self_test().unwrap();
    assert_eq!((test.failed, test.checked.contains(Checks::RATE)), (Checks::default(), true));
    assert_eq!(test.period_ns, 250_000);

    for rate_hz in [500, 1000, 2000, 8000, 4000] {
        session.set_rate(rate_hz).unwrap();
        assert_eq!(session.hello().rate_hz, rate_hz);
        stream(&mut session, 64);
    }
    for gain in [1, 2, 4, 8, 16, 64, 128, 32] {
        session.set_gain(gain).unwrap();
        assert_eq!(session.hello().gain, gain);
    }
    assert!(matches!(refusal(session.set_rate(3000)), Refusal::RateNotPossible { .. }));
    assert!(matches!(refusal(session.set_gain(3)), Refusal::GainNotPossible { .. }));
    assert!(matches!(refusal(session.read_register(64)), Refusal::AddressNotPossible { .. }));
    assert_eq!(session.last_fault().unwrap(), None);
    session.ping().unwrap();

    let (counters, counts) = (session.device_counters().unwrap(), session.counts());
    assert_eq!((counters.samples_missed, counters.samples_damaged, counters.samples_dropped), (0, 0, 0));
    assert_eq!((counters.blocks_dropped, counters.notices_dropped, counters.frames_damaged), (0, 0, 0));
    assert_eq!((counters.commands_refused, counts.missing, counts.damaged_frames), (3, 0, 0));
    assert_eq!(u64::from(counters.samples), counts.samples, "all that was numbered has arrived");
    session.set_source(Source::Hardware).unwrap();
    assert_eq!(refusal(session.start()), Refusal::NoFrontEnd);
}

#[test]
fn the_same_image_streams_through_a_serial_port() {
    let Some(machine) = pty_machine() else { return };
    let mut session = machine.open_simulated();
    stream(&mut session, 20_000);
    session.ping().unwrap();
    let (counters, counts) = (session.device_counters().unwrap(), session.counts());
    assert_eq!((u64::from(counters.samples), counts.missing), (counts.samples, 0));
    assert_eq!((counters.samples_missed, counters.samples_dropped, counters.blocks_dropped), (0, 0, 0));
}

#[test]
fn garbage_is_counted_and_the_next_command_works() {
    let Some(machine) = tcp_machine() else { return };
    let Address::Tcp(host) = &machine.address else { unreachable!() };
    let mut stream = (0..ATTEMPTS)
        .find_map(|_| {
            std::thread::sleep(Duration::from_millis(100));
            TcpStream::connect(host).ok()
        })
        .expect("the machine listens");
    stream.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    // A board that is still starting does not hear anything.
    assert!(matches!(ask_until_answered(&mut stream, 1, Request::Ping), Some(Outcome::Pong { .. })));
    // Bytes of every value, runs longer than any frame, and damaged frames between delimiters; faster than any serial
    // line, so that some of it finds no room.
    let mix = |i: u32| i.wrapping_mul(i).wrapping_mul(2_654_435_761).to_le_bytes()[2];
    let mut garbage: Vec<u8> = (0..4000_u32).map(mix).collect();
    garbage.extend([7; 500]);
    garbage.push(0);
    stream.write_all(&garbage).unwrap();
    let damaged = garbage.split(|&byte| byte == 0).filter(|frame| !frame.is_empty()).count();
    let counters = ask_until_answered(&mut stream, 2, Request::Counters).expect("a reply");
    let Outcome::Counters(counters) = counters else { panic!("{counters:?}") };
    let range = 1..=u32::try_from(damaged).unwrap();
    assert!(range.contains(&counters.frames_damaged), "{range:?}: {counters:?}");
    assert_eq!(counters.commands, counters.commands_repeated + 2, "{counters:?}");
}

/// Sends one command over a bare stream, as often as it takes, until its reply is there.
fn ask_until_answered(stream: &mut TcpStream, id: u32, request: Request) -> Option<Outcome> {
    let id = CommandId(id);
    let mut buffer = [0; FRAME_MAX + 1];
    let frame = encode(&ToDevice::new(id, request), &mut buffer).ok()?;
    let (mut reader, mut found, mut bytes) = (MessageReader::default(), None, [0; 4096]);
    let begun = Instant::now();
    while begun.elapsed() < rig::PATIENCE && found.is_none() {
        stream.write_all(&[&[DELIMITER], frame].concat()).ok()?;
        // Until it has nothing to say for the stream's time-out.
        while let Ok(length @ 1..) = stream.read(&mut bytes) {
            reader.read(&bytes[..length], |message| {
                if let FromDevice::Reply(Reply { id: answered, outcome }) = message {
                    // What is not, is another answer to the last command, which was repeated.
                    if answered == id {
                        found.get_or_insert(outcome);
                    }
                }
            });
        }
    }
    found
}

/// Waits until the device has started anew and its stream goes on; returns why it restarted.
fn comes_back(session: &mut Session) -> RestartReason {
    let reason = rig::wait_for(session, |incoming| match incoming {
        Incoming::Restarted(hello) => Some(hello.restart),
        _ => None,
    });
    let blocks = rig::samples(session, 800);
    // What was under way when it restarted comes first.
    let anew = blocks.iter().rposition(|block| block.first == 0).expect("numbers begin at 0 again");
    assert_whole(&blocks[anew..]);
    reason
}

#[test]
fn a_restart_while_streaming_is_survived_with_all_settings() {
    let Some(machine) = tcp_machine() else { return };
    let mut session = machine.open_simulated();
    session.set_rate(2000).unwrap();
    session.start().unwrap();
    rig::samples(&mut session, 400);
    session.reboot().unwrap();
    assert_eq!(comes_back(&mut session), RestartReason::Requested);
    let hello = session.hello();
    assert_eq!((hello.rate_hz, hello.source, hello.restarts), (2000, Source::Simulated, 1));
    // The host goes and another comes, while it streams.
    drop(session);
    let mut session = machine.open();
    assert!(session.hello().streaming);
    rig::samples(&mut session, 400);
    assert_eq!(session.counts().restarts, 0);
}

/// What the loader would be given: the image's file is taken, and leaves free what the board keeps its matrix in.
#[test]
fn the_image_is_one_that_is_put_onto_boards_and_leaves_the_store_free() {
    let Some((path, _)) = image() else { return };
    let file = FirmwareFile::read(&std::fs::read(path).expect("the image can be read")).expect("it is taken");
    let (_, store, behind) = (&file.bytes()[..0x4000], &file.bytes()[0x4000..0xC000], &file.bytes()[0xC000..]);
    assert!(store.iter().all(|&byte| byte == 0xFF), "sectors 1 and 2");
    assert!(!behind.is_empty() && behind[0] != 0xFF);
    let mut loader = Loader::new(2, Faults::default());
    dfu::flash(&mut loader, &file, |_| ()).expect("a loader in memory takes it");
    assert!(!loader.erased.iter().any(|at| (0x0800_4000..0x0800_C000).contains(at)), "{:x?}", loader.erased);
}

/// The emulator's flash cannot be written: the image finds that out by reading back, says so, and goes on.
#[test]
fn a_flash_that_takes_nothing_is_told_and_the_device_goes_on() {
    let Some(machine) = tcp_machine() else { return };
    let mut session = machine.open_simulated();
    assert_eq!(session.device_matrix().unwrap(), None);
    let matrix = ForceMatrix::new([[-37.45e-6, 0.0], [0.0, 37e-6]], [0.0, 0.0]).unwrap();
    session.request(Request::SetForceMatrix { matrix, checksum: matrix.checksum() }).unwrap();
    assert_eq!(refusal(session.store_device_matrix(true)), Refusal::NotStored);
    assert_eq!(session.device_matrix().unwrap(), Some(matrix));
    // Nothing is kept, and so there is nothing to write.
    session.store_device_matrix(false).unwrap();
    stream(&mut session, 800);
    assert_eq!(session.hello().restarts, 0);
}

/// The emulator's chip has no loader of its own: the image finds that out after its restart, and goes on.
#[test]
fn a_chip_that_has_no_loader_restarts_and_goes_on() {
    let Some(machine) = tcp_machine() else { return };
    let mut session = machine.open_simulated();
    session.start().unwrap();
    rig::samples(&mut session, 400);
    session.enter_loader().unwrap();
    assert_eq!(comes_back(&mut session), RestartReason::Requested);
    assert_eq!((session.hello().restarts, session.last_fault().unwrap()), (1, None));
}

#[test]
fn every_failure_ends_in_a_restart_that_says_why() {
    let Some(machine) = tcp_machine() else { return };
    let mut session = machine.open_simulated();
    session.start().unwrap();
    let failures = [
        (Failure::Panic, FaultCause::Panic, RestartReason::Panic),
        (Failure::Hang, FaultCause::Hang, RestartReason::Watchdog),
        (Failure::BadAccess, FaultCause::Processor, RestartReason::Panic),
        (Failure::StackOverflow, FaultCause::StackOverflow, RestartReason::Panic),
    ];
    for (number, (failure, cause, reason)) in failures.into_iter().enumerate() {
        session.request(Request::Fail { failure }).unwrap();
        assert_eq!(comes_back(&mut session), reason, "{failure:?}");
        assert_eq!(usize::from(session.hello().restarts), number + 1);
        let fault = session.last_fault().unwrap().expect("a record");
        assert_eq!(fault.cause, cause);
        match failure {
            // The memory protection's half of the status: it was the guard that stopped it.
            Failure::StackOverflow => assert!(fault.fault_status & 0xFF != 0, "{fault:?}"),
            Failure::Panic => assert!(fault.place.contains("fault.rs:"), "{fault:?}"),
            Failure::BadAccess => assert!(fault.program_counter >= 0x0800_0000 && fault.fault_status != 0, "{fault:?}"),
            Failure::Hang => {}
        }
    }
}

/// Instructions of one sample, by what they are spent on.
struct PerSample {
    /// From DRDY to the queue, without the simulated finger.
    sampler: f64,
    /// In the main loop, up to bytes in the transmitter's queue.
    main: f64,
    simulation: f64,
}

fn per_sample(before: &Health, after: &Health) -> PerSample {
    let ns_per_instruction = f64::from(1_u32 << emulator::INSTRUCTION_NS_LOG2);
    let instructions_per_cycle = 1e9 / f64::from(after.core_hz) / ns_per_instruction;
    let runs = f64::from(after.sampler_runs.wrapping_sub(before.sampler_runs));
    let spent = |cycles: fn(&Health) -> u32| {
        f64::from(cycles(after).wrapping_sub(cycles(before))) * instructions_per_cycle / runs
    };
    let simulation = spent(|health| health.simulation_cycles);
    let sampler = spent(|health| health.sampler_cycles) - simulation;
    PerSample { sampler, main: spent(|health| health.main_cycles), simulation }
}

#[test]
fn the_sampling_path_stays_within_its_share_of_the_processor() {
    let Some(machine) = tcp_machine() else { return };
    let mut session = machine.open_simulated();
    assert_eq!(session.hello().rate_hz, RATE_HZ);
    session.start().unwrap();
    rig::samples(&mut session, 4000);
    let before = session.health().unwrap();
    rig::samples(&mut session, 8000);
    let after = session.health().unwrap();
    let PerSample { sampler, main, simulation } = per_sample(&before, &after);
    let share = (sampler + main) * f64::from(RATE_HZ) / BOARD_HZ;
    println!("sampler         {sampler:6.0} instructions a sample");
    println!("main loop       {main:6.0} instructions a sample, polling included");
    println!("simulation      {simulation:6.0} instructions a sample, not counted in the share");
    println!("share           {:6.2} % of 168 MHz at {RATE_HZ} Hz, at most {:.0} %", share * 100.0, SHARE_MAX * 100.0);
    println!("stack           {:6} of {} bytes in use at most", after.stack_used_max, after.stack_bytes);
    assert!(sampler > 0.0 && main > 0.0 && share <= SHARE_MAX, "{share}");
    assert!(after.stack_used_max < after.stack_bytes * 9 / 10, "{after:?}");
}
