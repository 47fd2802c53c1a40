//! What a table says on standard error while it is made: rows as they are done, and how long the one under way will take.
//!
//! Told only between [`begin`] and [`end`]: whoever makes tables without a person at a terminal hears nothing.
//!
//! Units: s, of the wall's clock. Errors: none; what cannot be written is not told.

use std::io::Write as _;
use std::sync::Mutex;
use std::time::Instant;

use crate::messages;

/// A row under way is first spoken of after this, s: shorter ones speak for themselves.
const FIRST_S: f64 = 5.0;

/// And then again so many times later.
const LATER: f64 = 4.0;

/// The table that is being made.
static PRESENT: Mutex<Option<Present>> = Mutex::new(None);

struct Present {
    begun: Instant,
    row_begun: Instant,
    /// When the row under way is next spoken of, s since it began.
    next_s: f64,
    rows: usize,
}

/// From now on a table is made.
pub(crate) fn begin(name: &str, cases: usize) {
    let now = Instant::now();
    set(Some(Present { begun: now, row_begun: now, next_s: FIRST_S, rows: 0 }));
    tell(&format!("table {name}: {cases} cases a row; rows are named here as they are done"));
}

/// It is made.
pub(crate) fn end() {
    set(None);
}

/// A row of it is done.
pub(super) fn row_done(name: &str) {
    with(|present| {
        present.rows += 1;
        let (taken, all) = (present.row_begun.elapsed().as_secs_f64(), present.begun.elapsed().as_secs_f64());
        tell(&format!("  row {}, {name}: {taken:.1} s, {all:.1} s in all", present.rows));
        (present.row_begun, present.next_s) = (Instant::now(), FIRST_S);
    });
}

/// So many cases of the row under way are done.
pub(super) fn cases_done(done: usize, of: usize) {
    with(|present| {
        let taken = present.row_begun.elapsed().as_secs_f64();
        if taken < present.next_s || done == 0 {
            return;
        }
        present.next_s = taken * LATER;
        let left = taken / done as f64 * of.saturating_sub(done) as f64;
        tell(&format!("  row {}: {done} of {of} cases in {taken:.0} s, some {left:.0} s to go", present.rows + 1));
    });
}

fn set(present: Option<Present>) {
    if let Ok(mut place) = PRESENT.lock() {
        *place = present;
    }
}

fn with(act: impl FnOnce(&mut Present)) {
    if let Ok(mut place) = PRESENT.lock()
        && let Some(present) = place.as_mut()
    {
        act(present);
    }
}

fn tell(line: &str) {
    if messages::notes_wanted() {
        let _ = writeln!(std::io::stderr(), "{line}");
    }
}
