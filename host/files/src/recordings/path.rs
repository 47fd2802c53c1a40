//! Measured places of a finger: a table of `t, x, y` and, where the wrist turns, `phi`, read as `table` says. Without a
//! header the columns are t (s), x, y (m), phi (rad).

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
    /// How far the wrist is turned at each, rad, whole turns aside; none where the table does not say.
    pub angles: Option<Vec<f64>>,
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

/// How far the wrist is turned.
const TURN: Column = Column {
    key: "phi",
    name: "phi",
    names: &["phi", "angle", "theta", "yaw", "turn"],
    ends: &[],
    quantity: Quantity::ANGLE,
};

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

/// Reads a table whose columns a mapping names: `path_t`, `x`, `y`, `phi`.
///
/// # Errors
/// [`ReadError`] if not one place could be got.
pub fn parse_with(text: &str, mapping: &Mapping) -> Result<RecordedPath, ReadError> {
    if table::offers(text, &TURN, COLUMNS.len(), mapping) {
        let [t, x, y] = COLUMNS;
        let Table { rows, problems, .. } = table::parse(text, &[t, x, y, TURN], mapping)?;
        let angles = rows.iter().map(|[.., phi]| *phi).collect();
        let (times, places) = rows.into_iter().map(|[t, x, y, _]| (t, Point2::new(x, y))).unzip();
        return Ok(RecordedPath { times, places, angles: Some(angles), problems });
    }
    let Table { rows, problems, .. } = table::parse(text, &COLUMNS, mapping)?;
    let (times, places) = rows.into_iter().map(|[t, x, y]| (t, Point2::new(x, y))).unzip();
    Ok(RecordedPath { times, places, angles: None, problems })
}

/// Rows of a table that come one by one.
///
/// ```
/// use palpate_files::recordings::mapping::Mapping;
/// use palpate_files::recordings::path::PathRows;
///
/// let mut rows = PathRows::new(Mapping::default());
/// assert_eq!(rows.read(1, "t, x [mm], y [mm]")?, None); // the header
/// let path = rows.read(2, "0.01, 1.5, 2")?.ok_or("a row")?;
/// assert!((path.places[0].x - 0.0015).abs() < 1e-12); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct PathRows {
    mapping: Mapping,
    /// The first line where it is no row; none before there was one.
    header: Option<String>,
}

impl PathRows {
    /// Of columns that a mapping may name.
    #[must_use]
    pub const fn new(mapping: Mapping) -> Self {
        Self { mapping, header: None }
    }

    /// A table of the row of a line, which is the `number`-th; none where it is the header, or empty.
    ///
    /// # Errors
    /// [`ReadError`] if it is no row; the next line may be.
    pub fn read(&mut self, number: usize, line: &str) -> Result<Option<RecordedPath>, ReadError> {
        if line.trim().is_empty() {
            return Ok(None);
        }
        let header = self.header.as_deref().unwrap_or_default();
        match parse_with(&format!("{header}{line}"), &self.mapping) {
            Err(ReadError::Empty) if self.header.is_none() => {
                self.header = Some(format!("{line}\n"));
                Ok(None)
            }
            Err(ReadError::AllBad { lines, first }) => {
                Err(ReadError::AllBad { lines, first: RecordingProblem { line: number, ..first } })
            }
            Ok(table) => {
                self.header.get_or_insert_default();
                Ok(Some(table))
            }
            Err(ReadError::Empty) => Ok(None),
            Err(error) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fourth_column_is_the_turn_whether_it_has_a_name_or_not() {
        let named = parse("t, phi [deg], x, y\n0, 90, 1, 2\n1, 45, 1, 2").unwrap();
        assert!((named.angles.as_ref().unwrap()[0] - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
        assert!((named.places[1].y - 2.0).abs() < 1e-15);
        assert_eq!(parse("0 1 2 0.5\n1 1 2 0.6").unwrap().angles, Some(vec![0.5, 0.6]));
        assert_eq!(parse("0 1 2\n1 1 2").unwrap().angles, None);
    }
}
