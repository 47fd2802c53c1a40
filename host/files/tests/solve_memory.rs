//! How much memory one line of `palpate solve` takes: counted bytes, no clock. A process of its own, because it counts
//! every byte of it.

#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::io::Cursor;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use palpate_files::solve::{KINDS, run};
use serde_json::Value;

/// Length of the lines, bytes: so long that what a run takes for any line is nothing beside it.
const LENGTH: usize = 1 << 20;

/// Bytes that a line may take for each of its own (documented beside 64 MiB that any run may take).
const TIMES_ITS_LENGTH: usize = 20;

/// What a run takes for any line: threads, buffers.
const OF_ANY_RUN: usize = 1 << 19;

/// The system's allocator, and the most bytes that were taken from it at once.
struct Counting {
    now: AtomicUsize,
    most: AtomicUsize,
}

#[expect(unsafe_code, reason = "an allocator is unsafe to write; all is left to the system's, in the same terms")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = self.now.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        self.most.fetch_max(now, Ordering::Relaxed);
        // SAFETY: the caller keeps to the same terms.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        self.now.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps to the same terms.
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATED: Counting = Counting { now: AtomicUsize::new(0), most: AtomicUsize::new(0) };

/// One test counts at a time.
static COUNTED: Mutex<()> = Mutex::new(());

/// The most bytes at once beyond those of the line itself, and what the answer says: its error's code and place.
fn taken(line: &str) -> (usize, Option<(String, String)>) {
    let input = Cursor::new(line.as_bytes().to_vec());
    let mut output = Vec::with_capacity(4 * line.len());
    let before = ALLOCATED.now.load(Ordering::Relaxed);
    ALLOCATED.most.store(before, Ordering::Relaxed);
    let summary = run(KINDS, NonZeroUsize::MIN, input, &mut output).unwrap();
    let taken = ALLOCATED.most.load(Ordering::Relaxed) - before;
    assert_eq!(summary.answered, 1);
    let answer: Value = serde_json::from_slice(&output).unwrap();
    let text = |value: &Value| value.as_str().unwrap_or_default().chars().take(40).collect::<String>();
    let error = answer.get("error");
    (taken, error.map(|error| (text(&error["code"]), text(&error["field"]))))
}

fn repeated(before: &str, element: &str, after: &str) -> String {
    let count = LENGTH / (element.len() + 1);
    format!("{before}{}{after}", vec![element; count].join(","))
}

/// Keys that all differ.
fn keys(before: &str, after: &str) -> String {
    let mut line = before.to_owned();
    for key in 0..LENGTH / 8 {
        let comma = if key == 0 { "" } else { "," };
        write!(line, "{comma}\"{key:x}\":0").unwrap();
    }
    line + after
}

#[test]
fn no_line_takes_more_than_its_share_of_memory() {
    let _alone = COUNTED.lock().unwrap_or_else(PoisonError::into_inner);
    let long = "x".repeat(LENGTH);
    let slashes = "/".repeat(LENGTH);
    let corner = |place: usize| {
        let angle = TAU * f64::from(u32::try_from(place).unwrap()) * 28.0 / f64::from(u32::try_from(LENGTH).unwrap());
        format!("[{:.8},{:.8}]", angle.cos(), angle.sin())
    };
    let outline: Vec<_> = (0..LENGTH / 28).map(corner).collect();
    let block = "[[0,0],[0.06,0],[0.06,0.04],[0,0.04]]";
    let invalid = |field: &str| Some(("invalid_input".to_owned(), field.to_owned()));
    let unknown = || Some(("unknown_problem".to_owned(), "/problem".to_owned()));
    let cases = [
        ("unknown field of objects", repeated(r#"{"problem":"push","x":["#, r#"{"":0}"#, "]}"), invalid("/x")),
        ("unknown field of arrays", repeated(r#"{"problem":"push","x":["#, "[]", "]}"), invalid("/x")),
        ("unknown field of keys", keys(r#"{"problem":"push","x":{"#, "}}"), invalid("/x")),
        ("unknown fields", keys(r#"{"problem":"push","#, "}"), invalid("/0")),
        (
            "unknown field of a long name",
            format!(r#"{{"problem":"push","{long}":0}}"#),
            invalid(&format!("/{}", &long[..39])),
        ),
        (
            "unknown field of slashes",
            format!(r#"{{"problem":"push","{slashes}":0}}"#),
            invalid(&format!("/{}", "~1".repeat(20))[..40]),
        ),
        (
            "unknown field inside",
            repeated(r#"{"problem":"initial_pose","finger":{"type":"disk","x":["#, r#"{"":0}"#, "]}}"),
            invalid("/finger/x"),
        ),
        (
            "a field of the wrong type",
            repeated(r#"{"problem":"observe_roll","body":{"ellipsoid":["#, r#"{"":0}"#, "]}}"),
            invalid("/body/ellipsoid/0"),
        ),
        ("an id of objects", repeated(r#"{"problem":"fly","id":["#, r#"{"":0}"#, "]}"), unknown()),
        ("an id of numbers", repeated(r#"{"problem":"fly","id":["#, "0", "]}"), unknown()),
        ("an id that is a string", format!(r#"{{"problem":"fly","id":"{long}"}}"#), unknown()),
        ("a long name of a kind", format!(r#"{{"problem":"{long}"}}"#), unknown()),
        ("a kind that is no name", repeated(r#"{"problem":["#, r#"{"":0}"#, "]}"), invalid("/problem")),
        (
            "numbers",
            repeated(&format!(r#"{{"problem":"observe_push","polygon":{block},"contact_angle":["#), "0", "]}"),
            invalid("/mu"),
        ),
        ("pairs of numbers", repeated(r#"{"problem":"initial_pose","contacts":["#, "[0,0]", "]}"), invalid("/finger")),
        (
            "a null in an optional field",
            repeated(r#"{"problem":"push","stop_at_edge_end":null,"times":["#, "0", "]}"),
            invalid("/stop_at_edge_end"),
        ),
        (
            "an outline",
            format!(
                r#"{{"problem":"support_friction","velocity":[0.1,0],"omega":1,"polygon":[{}]}}"#,
                outline.join(",")
            ),
            None,
        ),
        (
            "no JSON",
            repeated(r#"{"problem":"push","x":["#, r#"{"":0}"#, "]"),
            Some(("invalid_json".to_owned(), String::new())),
        ),
    ];
    for (what, line, wanted) in cases {
        let (taken, error) = taken(&line);
        assert_eq!(error, wanted, "{what}");
        let most = TIMES_ITS_LENGTH * line.len() + OF_ANY_RUN;
        assert!(taken <= most, "{what}: {:.1} times its length", taken as f64 / line.len() as f64);
    }
}

/// What is between lines is not kept.
#[test]
fn many_lines_take_no_more_than_a_few() {
    let _alone = COUNTED.lock().unwrap_or_else(PoisonError::into_inner);
    let line = repeated(r#"{"problem":"push","x":["#, "0", "]}");
    let once = taken_by_copies(&line, 1);
    let often = taken_by_copies(&line, 20);
    // Those read ahead: 64 MiB at most, which is more than these are together.
    assert!(often <= once + 21 * line.len() + OF_ANY_RUN, "{once} {often}");
}

fn taken_by_copies(line: &str, count: usize) -> usize {
    let input = vec![line; count].join("\n").into_bytes();
    let before = ALLOCATED.now.load(Ordering::Relaxed);
    ALLOCATED.most.store(before, Ordering::Relaxed);
    run(KINDS, NonZeroUsize::MIN, Cursor::new(input), &mut std::io::sink()).unwrap();
    ALLOCATED.most.load(Ordering::Relaxed) - before
}
