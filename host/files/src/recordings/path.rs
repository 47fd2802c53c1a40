//! Measured places of a finger: a table of `t, x, y`, read as `table` says. Without a header the columns are t (s), x, y
//! (m).

use nalgebra::Point2;

use super::mapping::Mapping;
use super::table::{self, Column, Quantity, Table};
use super::{ReadError, RecordingProblem};

/// What a table of places gave.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedPath {
    /// When each was taken, increasing, s.
    pub times: Vec<f64>,
    /// Places of the disk's centre without force, finger axes, m.
    pub places: Vec<Point2<f64>>,
    /// What was skipped, in the order of the file.
    pub problems: Vec<RecordingProblem>,
}

const COLUMNS: [Column; 3] = [
    table::PATH_TIME,
    Column {
        key: "x",
        name: "x",
        names: &["x", "position_x", "position.x"],
        ends: &[".position.x", ".translation.x", ".point.x"],
        quantity: Quantity::LENGTH,
    },
    Column {
        key: "y",
        name: "y",
        names: &["y", "position_y", "position.y"],
        ends: &[".position.y", ".translation.y", ".point.y"],
        quantity: Quantity::LENGTH,
    },
];

/// Reads a table.
///
/// ```
/// let path = palpate_files::recordings::path::parse("t, x [mm], y [mm]\n0, 1, 2\n0.01, 1.5, 2")?;
/// assert!((path.places[1].x - 0.0015).abs() < 1e-12); // m
/// # Ok::<(), palpate_files::recordings::ReadError>(())
/// ```
///
/// # Errors
/// [`ReadError`] if not one place could be got.
pub fn parse(text: &str) -> Result<RecordedPath, ReadError> {
    parse_with(text, &Mapping::default())
}

/// Reads a table whose columns a mapping names: `path_t`, `x`, `y`.
///
/// # Errors
/// [`ReadError`] if not one place could be got.
pub fn parse_with(text: &str, mapping: &Mapping) -> Result<RecordedPath, ReadError> {
    let Table { rows, problems, .. } = table::parse(text, &COLUMNS, mapping)?;
    let (times, places) = rows.into_iter().map(|[t, x, y]| (t, Point2::new(x, y))).unzip();
    Ok(RecordedPath { times, places, problems })
}
