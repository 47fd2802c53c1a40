//! Reader, solvers and writer: lines are solved at the same time and answered in their order.
//!
//! ```text
//! reader ──line──▶ solver ──answer──▶ writer (the caller's thread)
//!    ▲             solver                │
//!    └────────── window: room ◀──────────┘
//! ```
//! The reader waits for room in a window of lines not yet written, so memory stays flat on endless input even while one
//! slow line holds up those behind it. An answer is written as soon as those before it are: nobody waits for the next
//! line.
//!
//! The threads are not joined: a reader may hang in a read that never ends after the output is gone.

use std::collections::BTreeMap;
use std::io::{self, BufReader, Read, Write};
use std::num::NonZeroUsize;
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;

use super::answer::{Answer, answer};
use super::problem::Registry;
use crate::lines::{Line, Lines};

/// Lines in flight for each solver: enough that one ten times slower than the rest does not idle the others.
const LINES_PER_JOB: usize = 64;

/// Longest line read, in bytes. A minute of contacts at 4 kHz takes 5 MB.
pub(super) const LINE_BYTES_MAX: usize = 64 << 20;

/// Bytes of input in flight; one line is let in however long it is.
const BYTES_MAX: usize = LINE_BYTES_MAX;

/// How a run went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Lines answered, blank ones not counted.
    pub answered: u64,
    /// Those among them whose answer is an error.
    pub failed: u64,
}

/// Why a run ended before the input did.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The input could not be read.
    #[error("cannot read the problems")]
    Read(#[source] io::Error),
    /// The output could not be written.
    #[error("cannot write the results")]
    Write(#[source] io::Error),
    /// The operating system gave no thread.
    #[error("cannot start a thread for the solvers")]
    Thread(#[source] io::Error),
    /// A thread ended before its work was done, which only a bug can make it do.
    #[error("a solver ended before its work was done: this is a bug of palpate, please report it")]
    Lost,
}

/// Answers every line of `input` on `output`, in order, with `jobs` lines being solved at a time.
///
/// Each answer is flushed once it is next in order. A broken pipe on the output ends the run without an error: whoever
/// read the answers has seen enough.
///
/// # Errors
/// [`RunError`] if the input cannot be read or the output not written. Mistakes in lines are answers, not errors.
///
/// ```
/// use std::num::NonZeroUsize;
///
/// let mut output = Vec::new();
/// let input = br#"{"problem": "fly", "id": 7}"#;
/// let summary = palpate_files::solve::run(palpate_files::solve::KINDS, NonZeroUsize::MIN, &input[..], &mut output)?;
/// assert_eq!((summary.answered, summary.failed), (1, 1));
/// assert!(output.starts_with(br#"{"id":7,"line":1,"error":{"code":"unknown_problem","#));
/// # Ok::<(), palpate_files::solve::RunError>(())
/// ```
pub fn run(
    registry: Registry,
    jobs: NonZeroUsize,
    input: impl Read + Send + 'static,
    output: &mut impl Write,
) -> Result<Summary, RunError> {
    let window = Arc::new(Window::new(jobs.get().saturating_mul(LINES_PER_JOB)));
    let (to_solvers, lines) = mpsc::channel();
    let (to_writer, events) = mpsc::channel();
    let lines = Arc::new(Mutex::new(lines));
    for _ in 0..jobs.get() {
        let (lines, to_writer) = (Arc::clone(&lines), to_writer.clone());
        start("solver", move || solve_lines(registry, &lines, &to_writer))?;
    }
    let reader = Reader { window: Arc::clone(&window), to_solvers, to_writer };
    start("reader", move || reader.read_lines(input))?;
    let mut writer = Writer::default();
    let result = writer.write_in_order(&events, &window, output);
    window.close();
    match result {
        Err(RunError::Write(error)) if error.kind() == io::ErrorKind::BrokenPipe => {}
        other => other?,
    }
    Ok(writer.summary)
}

fn start(name: &str, work: impl FnOnce() + Send + 'static) -> Result<(), RunError> {
    thread::Builder::new().name(name.to_owned()).spawn(work).map(drop).map_err(RunError::Thread)
}

/// A line with its place among those that are answered, from 0.
struct Job {
    place: u64,
    line: Line,
}

/// What the writer hears.
enum Event {
    Answered {
        place: u64,
        size: usize,
        answer: Answer,
    },
    /// The input ended after this many lines to answer, well or badly.
    End {
        lines: u64,
        result: io::Result<()>,
    },
}

struct Reader {
    window: Arc<Window>,
    to_solvers: Sender<Job>,
    to_writer: Sender<Event>,
}

impl Reader {
    fn read_lines(self, input: impl Read) {
        let mut lines = 0;
        let mut result = Ok(());
        for line in Lines::new(BufReader::with_capacity(1 << 16, input), LINE_BYTES_MAX) {
            let line = match line {
                Ok(line) if line.content.is_blank() => continue,
                Ok(line) => line,
                Err(error) => {
                    result = Err(error);
                    break;
                }
            };
            // Either way nobody wants the answer any more.
            if !self.window.enter(line.content.size()) || self.to_solvers.send(Job { place: lines, line }).is_err() {
                return;
            }
            lines += 1;
        }
        // If the writer is gone, nobody needs to know.
        let _ = self.to_writer.send(Event::End { lines, result });
    }
}

fn solve_lines(registry: Registry, lines: &Mutex<Receiver<Job>>, to_writer: &Sender<Event>) {
    loop {
        let received = lock(lines).recv();
        let Ok(Job { place, line }) = received else { return };
        let answer = answer(&registry, line.number, &line.content);
        if to_writer.send(Event::Answered { place, size: line.content.size(), answer }).is_err() {
            return;
        }
    }
}

#[derive(Default)]
struct Writer {
    /// Answers that came before their turn, with the size of their line.
    waiting: BTreeMap<u64, (usize, Answer)>,
    /// Whose turn it is.
    next: u64,
    end: Option<(u64, io::Result<()>)>,
    summary: Summary,
}

impl Writer {
    fn write_in_order(
        &mut self,
        events: &Receiver<Event>,
        window: &Window,
        output: &mut impl Write,
    ) -> Result<(), RunError> {
        while self.is_open() {
            self.take(events.recv().map_err(|_| RunError::Lost)?);
            // Bounded by the window; many answers then cost one write.
            events.try_iter().for_each(|event| self.take(event));
            let turn = self.take_turn();
            if turn.lines > 0 {
                output.write_all(turn.text.as_bytes()).and_then(|()| output.flush()).map_err(RunError::Write)?;
                window.leave(turn.lines, turn.bytes);
            }
        }
        self.end.take().map_or(Ok(()), |(_, result)| result.map_err(RunError::Read))
    }

    fn is_open(&self) -> bool {
        self.end.as_ref().is_none_or(|(lines, _)| self.next < *lines)
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Answered { place, size, answer } => drop(self.waiting.insert(place, (size, answer))),
            Event::End { lines, result } => self.end = Some((lines, result)),
        }
    }

    /// All answers whose turn has come.
    fn take_turn(&mut self) -> Turn {
        let mut turn = Turn::default();
        while let Some((bytes, answer)) = self.waiting.remove(&self.next) {
            self.next += 1;
            self.summary.answered += 1;
            self.summary.failed += u64::from(answer.failed);
            turn.lines += 1;
            turn.bytes += bytes;
            turn.text += &answer.text;
        }
        turn
    }
}

#[derive(Default)]
struct Turn {
    text: String,
    lines: usize,
    bytes: usize,
}

/// Bounds what has been read and not yet written.
struct Window {
    lines_max: usize,
    inside: Mutex<Inside>,
    changed: Condvar,
}

#[derive(Default)]
struct Inside {
    lines: usize,
    bytes: usize,
    closed: bool,
}

impl Window {
    fn new(lines_max: usize) -> Self {
        Self { lines_max, inside: Mutex::default(), changed: Condvar::new() }
    }

    /// Waits for room. False if the window has closed.
    fn enter(&self, bytes: usize) -> bool {
        let full = |inside: &mut Inside| {
            let full = inside.lines >= self.lines_max || (inside.lines > 0 && inside.bytes + bytes > BYTES_MAX);
            full && !inside.closed
        };
        let mut inside = self.changed.wait_while(lock(&self.inside), full).unwrap_or_else(PoisonError::into_inner);
        inside.lines += 1;
        inside.bytes += bytes;
        !inside.closed
    }

    fn leave(&self, lines: usize, bytes: usize) {
        let mut inside = lock(&self.inside);
        inside.lines -= lines;
        inside.bytes -= bytes;
        self.changed.notify_one();
    }

    fn close(&self) {
        lock(&self.inside).closed = true;
        self.changed.notify_one();
    }
}

/// Locks; a panic elsewhere leaves nothing half-changed in what is locked here.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use proptest::prelude::*;
    use serde_json::{Value, json};

    use super::super::testing::{self, run_text};
    use super::*;

    const TWO: NonZeroUsize = NonZeroUsize::new(2).unwrap();

    fn answers(jobs: usize, input: &[u8]) -> (Vec<Value>, Summary) {
        let (text, summary) = run_text(NonZeroUsize::new(jobs).unwrap(), input.to_vec());
        (text.lines().map(|line| serde_json::from_str(line).unwrap()).collect(), summary)
    }

    #[test]
    fn a_slow_line_holds_up_those_behind_it_and_keeps_its_place() {
        let lines: String = (0..50)
            .map(|i| format!("{{\"problem\":\"sleep\",\"ms\":{},\"id\":{i}}}\n", if i % 10 == 0 { 20 } else { 0 }))
            .collect();
        let (answers, summary) = answers(4, lines.as_bytes());
        let ids: Vec<_> = answers.iter().map(|answer| answer["id"].as_i64().unwrap()).collect();
        assert_eq!(ids, (0..50).collect::<Vec<_>>());
        assert_eq!(summary, Summary { answered: 50, failed: 0 });
    }

    #[test]
    fn a_crash_is_an_error_of_its_line_and_the_run_goes_on() {
        let input = br#"{"problem":"crash","id":1}
{"problem":"not_a_number","id":2}
{"problem":"give_up","id":3}
{"problem":"sleep","ms":0,"id":4}"#;
        let (answers, summary) = answers(1, input);
        for (answer, said) in answers.iter().zip(["crashed at ", r#"NaN at "/values/1""#, "no convergence"]) {
            let error = &answer["error"];
            assert_eq!((error["code"].as_str(), &error["field"]), (Some("internal"), &Value::Null), "{answer}");
            assert!(error["message"].as_str().unwrap().contains(said), "{answer}");
        }
        assert!(!answers[0].to_string().contains("index out of bounds"), "{}", answers[0]);
        assert_eq!(answers[3], json!({"id": 4, "problem": "sleep"}));
        assert_eq!(summary, Summary { answered: 4, failed: 3 });
    }

    /// Endless lines, counting how many have been asked for.
    struct Endless {
        line: &'static [u8],
        served: Arc<AtomicUsize>,
    }

    impl Read for Endless {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            // One line a read, so that the count is exact.
            self.served.fetch_add(1, Ordering::SeqCst);
            buffer[..self.line.len()].copy_from_slice(self.line);
            Ok(self.line.len())
        }
    }

    /// Takes `room` bytes, then fails.
    struct Full {
        room: usize,
        kind: io::ErrorKind,
    }

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.room = self.room.checked_sub(bytes.len()).ok_or(self.kind)?;
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn run_endless(kind: io::ErrorKind) -> Result<Summary, RunError> {
        let input = Endless { line: b"{\"problem\":1}\n", served: Arc::default() };
        run(testing::KINDS, TWO, input, &mut Full { room: 10_000, kind })
    }

    #[test]
    fn a_reader_that_has_seen_enough_ends_the_run_quietly() {
        let summary = run_endless(io::ErrorKind::BrokenPipe).unwrap();
        assert!(summary.answered > 0 && summary.failed == summary.answered, "{summary:?}");
    }

    #[test]
    fn a_full_disk_ends_the_run_with_an_error() {
        let error = run_endless(io::ErrorKind::StorageFull).unwrap_err();
        assert!(matches!(&error, RunError::Write(error) if error.kind() == io::ErrorKind::StorageFull), "{error:?}");
    }

    /// Waits on a channel before it takes its first bytes.
    struct Gate {
        opened: Receiver<()>,
        bytes: usize,
    }

    impl Write for Gate {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.bytes == 0 {
                self.opened.recv().map_err(io::Error::other)?;
            }
            self.bytes += bytes.len();
            if self.bytes > 1_000_000 { Err(io::ErrorKind::BrokenPipe.into()) } else { Ok(bytes.len()) }
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn reading_stops_while_nobody_takes_the_answers() {
        let served = Arc::new(AtomicUsize::new(0));
        let input = Endless { line: b"[]\n", served: Arc::clone(&served) };
        let (open, opened) = mpsc::channel();
        let running = thread::spawn(move || run(testing::KINDS, TWO, input, &mut Gate { opened, bytes: 0 }));
        let most = 2 * LINES_PER_JOB + 1; // One more is read and waits at the window.
        while served.load(Ordering::SeqCst) < most {
            thread::yield_now();
        }
        // Nothing can prove that no more will ever be read; a reader without bounds would be far ahead by now.
        thread::sleep(std::time::Duration::from_millis(50));
        assert_eq!(served.load(Ordering::SeqCst), most);
        open.send(()).unwrap();
        let summary = running.join().unwrap().unwrap();
        assert!(usize::try_from(summary.answered).unwrap() > most, "{summary:?}");
    }

    struct Broken;

    impl Read for Broken {
        fn read(&mut self, _buffer: &mut [u8]) -> io::Result<usize> {
            Err(io::ErrorKind::InvalidData.into())
        }
    }

    #[test]
    fn what_was_read_before_the_input_broke_is_answered() {
        let mut output = Vec::new();
        let error = run(testing::KINDS, TWO, (&b"1\n2\n"[..]).chain(Broken), &mut output).unwrap_err();
        assert!(matches!(error, RunError::Read(_)), "{error:?}");
        assert_eq!(output.iter().filter(|&&byte| byte == b'\n').count(), 2);
    }

    /// Bytes that get past the first checks more often than any bytes do.
    fn line_of_bytes() -> impl Strategy<Value = Vec<u8>> {
        let nearly_json = prop::sample::select(vec![
            "{",
            "}",
            "[",
            "]",
            ":",
            ",",
            "\"",
            "\\",
            "1e999",
            "NaN",
            "-",
            "0",
            "0.5",
            "null",
            "true",
            "\"problem\"",
            "\"area\"",
            "\"polygon\"",
            "\"id\"",
            "\\u0000",
            "\\ud800",
            " ",
            "\t",
            "\r",
            "\u{feff}",
            "é",
        ]);
        prop_oneof![
            proptest::collection::vec(any::<u8>(), 0..40),
            proptest::collection::vec(nearly_json, 0..20).prop_map(|parts| parts.concat().into_bytes()),
            testing::area_problem().prop_map(|problem| problem.to_string().into_bytes()),
        ]
    }

    proptest! {
        #[test]
        fn any_bytes_get_one_answer_a_line_in_order(
            lines in proptest::collection::vec(line_of_bytes(), 0..20), jobs in 1_usize..4,
        ) {
            let input = lines.join(&b'\n');
            let content = input.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&input);
            let is_blank = |line: &[u8]| line.iter().all(|byte| b" \t\r".contains(byte));
            let numbers: Vec<_> =
                (1_u64..).zip(content.split(|&b| b == b'\n')).filter(|(_, line)| !is_blank(line)).map(|(n, _)| n).collect();
            let (answers, summary) = answers(jobs, &input);
            prop_assert_eq!(answers.len(), numbers.len());
            for (answer, number) in answers.iter().zip(numbers) {
                match answer.get("error") {
                    Some(error) => {
                        prop_assert_eq!(&answer["line"], &json!(number));
                        prop_assert_ne!(&error["code"], &json!("internal"), "{}", answer);
                    }
                    None => prop_assert_eq!(&answer["problem"], &json!("area")),
                }
            }
            let failed = answers.iter().filter(|answer| answer.get("error").is_some()).count();
            prop_assert_eq!(summary, Summary { answered: answers.len() as u64, failed: failed as u64 });
        }
    }
}
