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
