//! What must hold for any text at all that is read as a file, or as a line of `palpate solve`: the bodies of the fuzz
//! targets beside [`crate::fuzz`].
//!
//! Every reader either gives values that can be, or says in words why not; none panics.

use std::fmt::Display;
use std::io::Cursor;
use std::num::NonZeroUsize;
use std::time::Duration;

use palpate::pushing::tip::locate;
use palpate_files::body::BodyFile;
use palpate_files::calibration::{file::CalibrationFile, plan, raw::RawRun};
use palpate_files::motion;
use palpate_files::part::{PartFile, PolygonFile};
use palpate_files::recordings::{csv, mlab};
use palpate_files::scene::SceneFile;
use palpate_files::solve::{KINDS, run};
use palpate_files::touches;
use palpate_files::views::{NamedPart, Views};
use serde_json::Value;

/// The field that gives a problem time of its own.
const LIMIT: &[u8] = b"time_limit";

/// What a text is read as; bytes that are no text have the replacement character for each.
fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The value that was read; an error must say something.
fn told<T, E: Display>(read: Result<T, E>) -> Option<T> {
    read.map_err(|error| assert!(!error.to_string().trim().is_empty(), "an error without a word")).ok()
}

/// A description of a part, as each command reads it.
///
/// # Panics
/// If a law is broken.
pub fn part(bytes: &[u8]) {
    let text = text(bytes);
    if let Some(file) = told(PartFile::parse(&text)) {
        assert!(file.mu >= 0.0 && file.mu.is_finite(), "µ = {}", file.mu);
        let centre = file.part.centre_of_mass();
        assert!(centre.x.is_finite() && centre.y.is_finite(), "centre of mass {centre}");
    }
    if let Some(parts) = told(PolygonFile::parse_supports(&text)) {
        assert!(!parts.is_empty());
        for (_, file) in parts {
            assert!(file.mu > 0.0 && file.part.polygon().area() > 0.0);
        }
    }
    for hull in [false, true] {
        told(NamedPart::parse("part", &text, hull));
    }
}

/// A description of a rolling body.
///
/// # Panics
/// If a law is broken.
pub fn body(bytes: &[u8]) {
    if let Some(file) = told(BodyFile::parse(&text(bytes))) {
        assert!(file.body.size() > 0.0 && file.body.size().is_finite(), "a body of {} m", file.body.size());
    }
}

/// Shapes with their places.
///
/// # Panics
/// If a law is broken.
pub fn scene(bytes: &[u8]) {
    if let Some(file) = told(SceneFile::parse(&text(bytes))) {
        assert_eq!(file.names.len(), file.polygons.len());
        assert!(file.polygons.iter().all(|polygon| polygon.area() > 0.0));
    }
}

/// What sensors see of a part.
///
/// # Panics
/// If a law is broken.
pub fn views(bytes: &[u8]) {
    if let Some(views) = told(Views::parse(&text(bytes))) {
        for cone in &views.cones {
            assert!(cone.opening() > 0.0 && cone.opening() < std::f64::consts::PI, "opening {}", cone.opening());
        }
    }
}

/// How a finger moves.
///
/// # Panics
/// If a law is broken.
pub fn motion(bytes: &[u8]) {
    if let Some(motion) = told(motion::parse(&text(bytes))) {
        let begun = motion.centre(0.0);
        assert!(begun.x.is_finite() && begun.y.is_finite(), "begins at {begun}");
    }
}

/// Touches on a block, and the tip that they lead to.
///
/// # Panics
/// If a law is broken.
pub fn touches(bytes: &[u8]) {
    if let Some((block, touches)) = told(touches::parse(&text(bytes)))
        && let Some(found) = told(locate(&block, &touches))
    {
        assert!(found.rms >= 0.0 && found.touches == touches.len(), "{found:?}");
    }
}

/// A calibration: its result, its plan, its raw samples.
///
/// # Panics
/// If a law is broken.
pub fn calibration(bytes: &[u8]) {
    let text = text(bytes);
    if let Some(file) = told(CalibrationFile::from_text(&text)) {
        let written = file.to_text();
        assert!(written.is_ok_and(|text| CalibrationFile::from_text(&text).is_ok()), "what is kept can be read again");
    }
    told(plan::from_toml(&text));
    told(RawRun::from_text(&text));
}

/// Logs of a force sensor, of both kinds.
///
/// # Panics
/// If a law is broken.
pub fn force_log(bytes: &[u8]) {
    let text = text(bytes);
    if let Some(table) = told(csv::parse(&text)) {
        assert!(!table.readings.is_empty());
        assert!(table.readings.iter().all(|reading| reading.t.is_finite()));
        assert!(table.readings.windows(2).all(|two| two[0].t < two[1].t), "time increases");
    }
    if let Some(log) = told(mlab::parse(&text)) {
        for push in log.good() {
            assert!(push.tips.len() >= 2 && push.tips.windows(2).all(|two| two[0].t < two[1].t), "time increases");
        }
    }
}

/// Lines of `palpate solve`, with no time to search: every line that is not blank has one answer, which is JSON and
/// repeats or leaves out the id, and none is a crash.
///
/// # Panics
/// If a law is broken.
pub fn solve(bytes: &[u8]) {
    let (kinds, mut output) = (KINDS.with_time_limit(Duration::ZERO), Vec::new());
    // A problem may have a limit of its own: those that do are left out, because a test must end.
    if bytes.windows(LIMIT.len()).any(|word| word == LIMIT) {
        return;
    }
    let summary = run(kinds, NonZeroUsize::MIN, Cursor::new(bytes.to_vec()), &mut output);
    let summary = summary.unwrap_or_else(|error| panic!("bytes in memory can be read: {error}"));
    let answers: Vec<Value> = output
        .split(|byte| *byte == b'\n')
        .filter(|line| !line.is_empty())
        .map(|line| serde_json::from_slice(line).unwrap_or_else(|error| panic!("an answer that is no JSON: {error}")))
        .collect();
    let content = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let lines = content.split(|byte| *byte == b'\n');
    let asked = lines.filter(|line| line.iter().any(|byte| !b" \t\r".contains(byte))).count();
    assert_eq!((answers.len(), summary.answered), (asked, asked as u64), "one answer a line");
    for answer in answers {
        let message = answer["error"]["message"].as_str().unwrap_or_default();
        assert!(!message.contains("crashed"), "{answer}");
        assert!(message.chars().count() <= 2000, "{answer}");
        assert_eq!(answer.get("error").is_none(), message.is_empty(), "{answer}");
    }
}
