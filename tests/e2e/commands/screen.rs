//! `palpate monitor` on a terminal: the real binary on a real pseudo-terminal, its keys, and the terminal afterwards.

use std::fs::{self, File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use palpate_tests::rig::PATIENCE;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};

use crate::PALPATE;
use crate::observe::text;
use crate::recording::{calibrated, ok, palpate};

/// How a program takes over a terminal's whole window, and how it gives it back.
const ENTERED: &str = "\u{1b}[?1049h";
const LEFT: &str = "\u{1b}[?1049l";

/// A terminal of 80 columns and 24 rows with a program on it.
pub(crate) struct Terminal {
    child: Child,
    keyboard: File,
    screen: Receiver<Vec<u8>>,
    /// All that was written on it.
    seen: String,
    window: Window,
    /// The program's end, which stays open so that its settings can be asked for.
    program_end: File,
}

impl Terminal {
    pub(crate) fn run(folder: &Path, arguments: &[&str]) -> Self {
        let keyboard = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&keyboard).unwrap();
        unlockpt(&keyboard).unwrap();
        let path = ptsname(&keyboard, Vec::new()).unwrap().into_string().unwrap();
        // Not the terminal of this process.
        let no_controlling_terminal = i32::try_from(rustix::fs::OFlags::NOCTTY.bits()).unwrap();
        let program_end =
            OpenOptions::new().read(true).write(true).custom_flags(no_controlling_terminal).open(path).unwrap();
        tcsetwinsize(&program_end, Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 }).unwrap();
        let end = || Stdio::from(program_end.try_clone().unwrap());
        let mut command = Command::new(PALPATE);
        command.args(arguments).current_dir(folder).env("TERM", "xterm-256color");
        command.env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION").env_remove("NO_COLOR");
        let child = command.stdin(end()).stdout(end()).stderr(end()).spawn().unwrap();
        let keyboard = File::from(keyboard);
        let mut output = keyboard.try_clone().unwrap();
        let (sender, screen) = channel();
        std::thread::spawn(move || {
            let mut buffer = [0; 4096];
            while let Ok(length @ 1..) = output.read(&mut buffer) {
                if sender.send(buffer[..length].to_vec()).is_err() {
                    return;
                }
            }
        });
        Self { child, keyboard, screen, seen: String::new(), window: Window::default(), program_end }
    }

    fn press(&mut self, key: &str) {
        self.keyboard.write_all(key.as_bytes()).unwrap();
    }

    /// Takes what the program writes for so long at most; whether it wrote.
    fn take(&mut self, wait: Duration) -> bool {
        let Ok(piece) = self.screen.recv_timeout(wait) else { return false };
        let piece = text(&piece);
        self.window.take(&piece);
        self.seen.push_str(&piece);
        true
    }

    /// Waits until all of these are on the window.
    fn wait_for(&mut self, words: &[&str]) {
        let deadline = Instant::now() + PATIENCE;
        while !words.iter().all(|word| self.window.text().contains(word)) {
            let left = deadline.saturating_duration_since(Instant::now());
            assert!(!left.is_zero() && self.take(left), "{words:?} are not shown:\n{}", self.window.text());
        }
    }

    /// Waits until this was written.
    pub(crate) fn wait_until_seen(&mut self, words: &str) {
        let deadline = Instant::now() + PATIENCE;
        while !self.seen.contains(words) {
            let left = deadline.saturating_duration_since(Instant::now());
            assert!(!left.is_zero() && self.take(left), "{words} is not shown:\n{}", self.seen);
        }
    }

    /// All that was written.
    pub(crate) fn seen(&self) -> &str {
        &self.seen
    }

    /// Ends the program at once.
    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Whether the terminal echoes what is typed and hands it on by lines, as it does for a shell.
    fn is_as_before(&self) -> bool {
        let modes = tcgetattr(&self.program_end).unwrap().local_modes;
        modes.contains(LocalModes::ECHO | LocalModes::ICANON | LocalModes::ISIG)
    }

    /// Waits for the program's end, and takes what it still writes.
    fn ended(&mut self) -> Option<i32> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                while self.take(Duration::from_millis(200)) {}
                return status.code();
            }
            assert!(Instant::now() < deadline, "it does not end:\n{}", self.window.text());
            self.take(Duration::from_millis(20));
        }
    }
}

/// What stands on a terminal, as far as the programs here move about on it: they set the place and write from there on.
#[derive(Default)]
struct Window {
    cells: Vec<Vec<char>>,
    row: usize,
    column: usize,
    /// A control sequence that has begun.
    sequence: Option<String>,
}

impl Window {
    fn take(&mut self, written: &str) {
        for c in written.chars() {
            if let Some(sequence) = &mut self.sequence {
                sequence.push(c);
                if c.is_ascii_alphabetic() {
                    let sequence = self.sequence.take().unwrap();
                    self.obey(&sequence);
                }
                continue;
            }
            match c {
                '\u{1b}' => self.sequence = Some(String::new()),
                '\r' => self.column = 0,
                '\n' => self.row += 1,
                c => {
                    let (row, column) = (self.row, self.column);
                    self.cells.resize_with(self.cells.len().max(row + 1), Vec::new);
                    let cells = &mut self.cells[row];
                    cells.resize(cells.len().max(column + 1), ' ');
                    cells[column] = c;
                    self.column += 1;
                }
            }
        }
    }

    fn obey(&mut self, sequence: &str) {
        if let Some(place) = sequence.strip_prefix('[').and_then(|rest| rest.strip_suffix('H')) {
            let numbers: Vec<usize> = place.split(';').map(|number| number.parse().unwrap_or(1)).collect();
            (self.row, self.column) = (numbers[0] - 1, numbers.get(1).map_or(0, |column| column - 1));
        } else if sequence.ends_with('J') || ["[?1049h", "[?1049l"].contains(&sequence) {
            self.cells.clear();
        }
    }

    fn text(&self) -> String {
        self.cells.iter().map(|row| row.iter().collect::<String>() + "\n").collect()
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn keys_tare_record_mark_and_quit_and_the_recording_plays() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = calibrated(folder.path());
    let mut terminal = Terminal::run(folder.path(), &["monitor", "-d", "sim:7", "-c", &calibration, "--tare", "0.5"]);
    assert!(terminal.is_as_before());
    terminal.wait_for(&["SIMULATED", "no contact", "of 4000 samples/s", "tared", "not recorded"]);
    assert!(!terminal.is_as_before() && terminal.seen.contains(ENTERED));
    // Where nothing is recorded a mark has no place.
    terminal.press("m");
    terminal.wait_for(&["nothing is recorded"]);
    terminal.press("r");
    terminal.wait_for(&["recording in monitor-"]);
    terminal.wait_for(&["● monitor-", "tared earlier"]);
    terminal.press("t");
    terminal.wait_for(&["TARING"]);
    terminal.wait_for(&["tared 0 s ago"]);
    terminal.press("m");
    terminal.wait_for(&["mark 1"]);
    terminal.press("m");
    terminal.wait_for(&["mark 2", "marks: 2"]);
    terminal.press("q");
    assert_eq!(terminal.ended(), Some(0), "{}", terminal.seen);
    assert!(terminal.is_as_before());
    // No line was printed across the screen, as that of the inputs at the start of each stream.
    assert!(!terminal.seen.contains("inputs 7..0"), "{}", terminal.seen);
    // What was told meanwhile is on the terminal as it was.
    let (_, after) = terminal.seen.rsplit_once(LEFT).unwrap();
    for told in ["taring for 0.5 s", "mark 2", "samples, 0 missing", "recorded "] {
        assert!(after.contains(told), "{told} is missing:\n{after}");
    }

    let files = fs::read_dir(folder.path()).unwrap().flatten().map(|entry| entry.path());
    let run = files.filter(|path| path.extension().is_some_and(|end| end == "mcap")).collect::<Vec<_>>();
    let [run] = run.as_slice() else { panic!("{run:?}") };
    // In a pipe its replay prints lines, begins with the tare of before, tares where the key was pressed and names the marks.
    let replayed = palpate(folder.path(), &["replay", run.to_str().unwrap()]);
    assert!(ok(&replayed).lines().count() > 5);
    let told = text(&replayed.stderr);
    assert_eq!(told.matches("tare (").count(), 2, "{told}");
    assert!(told.contains("tare.toml is gone or has changed") && told.contains("mark 2"), "{told}");
}

#[test]
fn the_terminal_is_what_it_was_whatever_ends_the_screen() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = calibrated(folder.path());
    let monitor = ["monitor", "-d", "sim:7", "-c", &calibration, "--tare", "0.5", "--record"];
    for (name, end) in [("key.mcap", None), ("signal.mcap", Some(rustix::process::Signal::INT))] {
        let mut terminal = Terminal::run(folder.path(), &[&monitor[..], &[name]].concat());
        terminal.wait_for(&["no contact", "●"]);
        match end {
            None => terminal.press("\u{3}"),
            Some(signal) => {
                let process = rustix::process::Pid::from_child(&terminal.child);
                rustix::process::kill_process(process, signal).unwrap();
            }
        }
        assert_eq!(terminal.ended(), Some(0), "{}", terminal.seen);
        assert!(terminal.is_as_before() && terminal.seen.contains(LEFT), "{name}");
    }
    // An error while the screen is on: so short a stretch makes no tare.
    let mut terminal = Terminal::run(folder.path(), &["monitor", "-d", "sim:7", "-c", &calibration, "--tare", "0.001"]);
    assert_eq!(terminal.ended(), Some(1), "{}", terminal.seen);
    assert!(terminal.is_as_before());
    let (_, after) = terminal.seen.rsplit_once(LEFT).unwrap();
    assert!(after.contains("cannot tare"), "{after}");
}

#[test]
fn plain_is_lines_on_a_terminal_too() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = calibrated(folder.path());
    let words = ["monitor", "-d", "sim:7", "-c", &calibration, "--tare", "0.5", "--seconds", "0.5", "--plain"];
    let mut terminal = Terminal::run(folder.path(), &words);
    assert_eq!(terminal.ended(), Some(0));
    assert!(!terminal.seen.contains(ENTERED) && terminal.seen.contains("no contact"), "{}", terminal.seen);
}
