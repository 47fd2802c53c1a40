//! What is told of a table while it is made: each row as it is done, and how far the one under way is.
//!
//! Told only between [`begin`] and [`end`]: whoever makes tables otherwise hears nothing.
//!
//! Units: s, of the wall's clock. Errors: none.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::Table;
use crate::progress;

/// What is told of each row, as soon as the table has it.
pub(crate) type TellRow = Box<dyn FnMut(&Table) + Send>;

/// The table that is being made.
static PRESENT: Mutex<Option<Present>> = Mutex::new(None);

struct Present {
    begun: Instant,
    row_begun: Instant,
    rows: usize,
    tell: TellRow,
}

fn present() -> MutexGuard<'static, Option<Present>> {
    PRESENT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// From now on a table is made; `tell` gets it with each row that it has more.
pub(crate) fn begin(tell: TellRow) {
    let now = Instant::now();
    *present() = Some(Present { begun: now, row_begun: now, rows: 0, tell });
}

/// It is made.
pub(crate) fn end() {
    *present() = None;
}

/// It has a row more.
pub(super) fn row_done(table: &Table) {
    let Some(present) = &mut *present() else { return };
    present.rows += 1;
    let (taken, all) = (present.row_begun.elapsed().as_secs_f64(), present.begun.elapsed().as_secs_f64());
    (present.tell)(table);
    tracing::info!("row {}: {taken:.1} s, {all:.1} s in all", present.rows);
    present.row_begun = Instant::now();
    progress::says(format!("row {}", present.rows + 1));
}

/// So many cases of the row under way are done.
pub(super) fn cases_done(done: usize, of: usize) {
    if let Some(present) = &*present() {
        progress::reached(done as u64, of as u64, &format!("row {}, cases", present.rows + 1));
    }
}
