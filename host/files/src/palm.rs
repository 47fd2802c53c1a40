//! How a palm accelerates, as a person writes it down or a sensor on the palm records it.
//!
//! ```toml
//! unit = "mm"                         # of every length below: m, cm, mm or in
//! [[harmonic]]                        # their sum; along the palm's axes
//! amplitude = [400, 0, 0]             # mm/s²
//! frequency_hz = 3
//! phase_deg = 90                      # at t = 0 (optional)
//! ```
//!
//! or
//!
//! ```toml
//! unit = "mm"
//! [[piece]]                           # one after the other; the last lasts
//! from_s = 0
//! acceleration = [400, 0, 0]          # mm/s²
//! ```
//!
//! or a table of `t, ax, ay, az` (s and m/s² unless a header names other units), as an accelerometer gives them less
//! gravity: straight between rows, which is held as its mean from each row to the next.
//!
//! Frames: palm axes, z up along the palm's normal. Units: SI once read. Errors: [`PalmFileError`] names the entry, the
//! value, the limit and what to do.

use nalgebra::Vector3;
use palpate::rolling::{Harmonic, PalmAcceleration, Pieces};
use serde::Deserialize;

use crate::part::{Numbers, Unit};
use crate::recordings::mapping::Mapping;
use crate::recordings::table::{self, Column, Quantity, Table};
use crate::recordings::{ReadError, RecordingProblem};

/// Why a text is no palm's motion.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PalmFileError {
    /// Not TOML, a key missing, unknown or of another type; the message shows the place.
    #[error("{0}")]
    Text(String),
    /// Neither kind of entry, or both.
    #[error("it has {harmonics} [[harmonic]] and {pieces} [[piece]]: write one kind or the other, at least once")]
    Kinds {
        /// Entries of one kind.
        harmonics: usize,
        /// Of the other.
        pieces: usize,
    },
    /// A number that is none.
    #[error("{place}: {key} = {value} must be {limit}")]
    Number {
        /// Which entry.
        place: String,
        /// The key in it.
        key: &'static str,
        /// What it has.
        value: String,
        /// What it may be.
        limit: &'static str,
    },
    /// Pieces out of order.
    #[error("piece {index}: from_s = {start:?} is not after the piece before it: put pieces in the order of time")]
    Order {
        /// Place of the piece in the file, from 0.
        index: usize,
        /// When it would begin, s.
        start: f64,
    },
    /// Nothing is said of the beginning.
    #[error("it begins at {start:?} s: tell the acceleration from t = 0 on, when the body is let go")]
    Late {
        /// When it begins, s.
        start: f64,
    },
    /// A table that gives nothing.
    #[error(transparent)]
    Table(#[from] ReadError),
    /// One row says nothing of what is between rows.
    #[error("one row of a table tells no motion: record for as long as the body rolls")]
    OneRow,
}

/// A palm's motion with what of its file was skipped.
#[derive(Clone, Debug, PartialEq)]
pub struct PalmFile {
    /// The acceleration, palm axes, m/s².
    pub acceleration: PalmAcceleration,
    /// Rows of a table that could not be read.
    pub problems: Vec<RecordingProblem>,
    /// When a table ends, s: beyond, the last acceleration goes on, which nobody measured.
    pub measured_until: Option<f64>,
}

/// The keys of a description.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    unit: Unit,
    #[serde(default)]
    harmonic: Vec<HarmonicKeys>,
    #[serde(default)]
    piece: Vec<PieceKeys>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct HarmonicKeys {
    amplitude: Numbers<3>,
    frequency_hz: f64,
    #[serde(default)]
    phase_deg: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PieceKeys {
    from_s: f64,
    acceleration: Numbers<3>,
}

/// The columns of a table.
const COLUMNS: [Column; 4] = [
    table::TIME,
    Column {
        key: "ax",
        name: "ax",
        names: &["ax", "a_x", "acceleration_x", "acceleration.x"],
        ends: &[".linear_acceleration.x"],
        quantity: Quantity::ACCELERATION,
    },
    Column {
        key: "ay",
        name: "ay",
        names: &["ay", "a_y", "acceleration_y", "acceleration.y"],
        ends: &[".linear_acceleration.y"],
        quantity: Quantity::ACCELERATION,
    },
    Column {
        key: "az",
        name: "az",
        names: &["az", "a_z", "acceleration_z", "acceleration.z"],
        ends: &[".linear_acceleration.z"],
        quantity: Quantity::ACCELERATION,
    },
];

impl PalmFile {
    /// Reads the text of a file: TOML if a line of it begins with `[[` or a key, a table otherwise.
    ///
    /// ```
    /// use palpate_files::palm::PalmFile;
    ///
    /// let shaken = "unit = 'mm'\n[[harmonic]]\namplitude = [400, 0, 0]\nfrequency_hz = 3\nphase_deg = 90";
    /// assert!((PalmFile::parse(shaken)?.acceleration.at(0.0).x - 0.4).abs() < 1e-12); // m/s²
    /// let measured = PalmFile::parse("t,ax,ay,az\n0,0,0,0\n0.5,2,0,0\n1,0,0,0")?;
    /// assert_eq!(measured.acceleration.at(0.2).x, 1.0); // m/s², the mean of the first half second
    /// # Ok::<(), palpate_files::palm::PalmFileError>(())
    /// ```
    ///
    /// # Errors
    /// [`PalmFileError`] names the first thing found wrong.
    pub fn parse(text: &str) -> Result<Self, PalmFileError> {
        if is_toml(text) { described(text) } else { measured(text) }
    }
}

/// Whether a text is a description: its first line of content is a key with a value or the head of an entry.
fn is_toml(text: &str) -> bool {
    let mut lines = text.lines().map(|line| line.split('#').next().unwrap_or_default().trim());
    lines.find(|line| !line.is_empty()).is_some_and(|line| line.contains('=') || line.starts_with('['))
}

fn described(text: &str) -> Result<PalmFile, PalmFileError> {
    let Keys { unit, harmonic, piece } =
        toml::from_str(text).map_err(|error| PalmFileError::Text(error.to_string()))?;
    let acceleration = match (harmonic.as_slice(), piece.as_slice()) {
        ([_, ..], []) => PalmAcceleration::Harmonic(harmonics(&harmonic, unit.metres())?),
        ([], [_, ..]) => PalmAcceleration::Piecewise(pieces(&piece, unit.metres())?),
        (harmonics, pieces) => {
            return Err(PalmFileError::Kinds { harmonics: harmonics.len(), pieces: pieces.len() });
        }
    };
    Ok(PalmFile { acceleration, problems: Vec::new(), measured_until: None })
}

fn harmonics(entries: &[HarmonicKeys], metres: f64) -> Result<Vec<Harmonic>, PalmFileError> {
    let harmonic = |(index, keys): (usize, &HarmonicKeys)| {
        let place = || format!("harmonic {index}");
        all_finite(place, "amplitude", &keys.amplitude.0)?;
        all_finite(place, "phase_deg", &[keys.phase_deg])?;
        if !(keys.frequency_hz.is_finite() && keys.frequency_hz >= 0.0) {
            let value = format!("{:?}", keys.frequency_hz);
            return Err(PalmFileError::Number { place: place(), key: "frequency_hz", value, limit: "0 or more" });
        }
        let amplitude = Vector3::from(keys.amplitude.0) * metres;
        Ok(Harmonic { amplitude, frequency_hz: keys.frequency_hz, phase: keys.phase_deg.to_radians() })
    };
    entries.iter().enumerate().map(harmonic).collect()
}

fn pieces(entries: &[PieceKeys], metres: f64) -> Result<Pieces, PalmFileError> {
    for (index, keys) in entries.iter().enumerate() {
        all_finite(|| format!("piece {index}"), "from_s", &[keys.from_s])?;
        all_finite(|| format!("piece {index}"), "acceleration", &keys.acceleration.0)?;
    }
    from_the_start(
        entries.iter().map(|keys| keys.from_s).collect(),
        entries.iter().map(|keys| Vector3::from(keys.acceleration.0) * metres).collect(),
    )
}

/// Pieces that say how the palm moves from t = 0 on.
fn from_the_start(starts: Vec<f64>, values: Vec<Vector3<f64>>) -> Result<Pieces, PalmFileError> {
    let after = (1..starts.len()).find(|&index| starts[index] <= starts[index - 1]);
    if let Some(index) = after {
        return Err(PalmFileError::Order { index, start: starts[index] });
    }
    let pieces = Pieces::new(starts, values).map_err(|error| PalmFileError::Text(error.to_string()))?;
    if pieces.start() > 0.0 { Err(PalmFileError::Late { start: pieces.start() }) } else { Ok(pieces) }
}

fn all_finite(place: impl Fn() -> String, key: &'static str, values: &[f64]) -> Result<(), PalmFileError> {
    if values.iter().all(|value| value.is_finite()) {
        return Ok(());
    }
    let limit = if values.len() == 1 { "a finite number" } else { "three finite numbers" };
    Err(PalmFileError::Number { place: place(), key, value: format!("{values:?}"), limit })
}

fn measured(text: &str) -> Result<PalmFile, PalmFileError> {
    let Table { rows, problems, .. } = table::parse(text, &COLUMNS, &Mapping::default())?;
    let value = |[_, x, y, z]: &[f64; 4]| Vector3::new(*x, *y, *z);
    let starts = rows.iter().map(|row| row[0]).take(rows.len() - 1).collect();
    let means: Vec<_> = rows.windows(2).map(|pair| (value(&pair[0]) + value(&pair[1])) / 2.0).collect();
    if means.is_empty() {
        return Err(PalmFileError::OneRow);
    }
    let acceleration = PalmAcceleration::Piecewise(from_the_start(starts, means)?);
    Ok(PalmFile { acceleration, problems, measured_until: rows.last().map(|row| row[0]) })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAKEN: &str = "unit = 'mm'\n[[harmonic]]\namplitude = [400, 0, -100]\nfrequency_hz = 2.5\nphase_deg = 30\n\
                          [[harmonic]]\namplitude = [0, 200, 0]\nfrequency_hz = 4";
    const PUSHED: &str = "unit = 'cm'\n[[piece]]\nfrom_s = 0\nacceleration = [10, 0, 0]\n[[piece]]\nfrom_s = 0.5\nacceleration = [0, 20, 0]";

    #[test]
    fn a_sum_of_harmonics_is_that_of_its_sines() {
        let palm = PalmFile::parse(SHAKEN).unwrap().acceleration;
        for t in [0.0, 0.13, 0.7] {
            let first = (std::f64::consts::TAU * 2.5 * t + 30_f64.to_radians()).sin();
            let wanted = Vector3::new(0.4 * first, 0.2 * (std::f64::consts::TAU * 4.0 * t).sin(), -0.1 * first);
            assert!((palm.at(t) - wanted).norm() < 1e-12, "at {t} s");
        }
    }

    #[test]
    fn a_piece_lasts_to_the_next_and_the_last_for_ever() {
        let palm = PalmFile::parse(PUSHED).unwrap().acceleration;
        for (t, wanted) in
            [(0.0, [0.1, 0.0, 0.0]), (0.49, [0.1, 0.0, 0.0]), (0.5, [0.0, 0.2, 0.0]), (9.0, [0.0, 0.2, 0.0])]
        {
            assert_eq!(palm.at(t), Vector3::from(wanted), "at {t} s");
        }
    }

    /// What is rolled on is as long a push as was measured: the velocity gained is that of straight lines between rows.
    #[test]
    fn a_measured_motion_gains_the_velocity_that_was_measured() {
        let rows: Vec<(f64, f64)> = (0..=50).map(|k| f64::from(k) * 0.01).map(|t| (t, 3.0 * t * t)).collect();
        let text: String = rows.iter().map(|(t, a)| format!("{t},{a},0,0\n")).collect();
        let file = PalmFile::parse(&format!("t,ax,ay,az\n{text}")).unwrap();
        let gained: f64 = (0..5000).map(|k| file.acceleration.at((f64::from(k) + 0.5) * 1e-4).x * 1e-4).sum();
        let trapezoids: f64 = rows.windows(2).map(|w| (w[1].0 - w[0].0) * (w[0].1 + w[1].1) / 2.0).sum();
        assert!((gained - trapezoids).abs() < 1e-9 && file.measured_until == Some(0.5), "{gained} m/s");
    }

    #[test]
    fn a_header_names_units_and_a_bad_row_costs_itself_alone() {
        let file = PalmFile::parse("time (ms);az;ay;ax [g]\n0;0;0;1\nx;0;0;1\n100;0;0;1\n").unwrap();
        assert!((file.acceleration.at(0.05).x - 9.806_65).abs() < 1e-12 && file.problems.len() == 1, "{file:?}");
    }

    #[test]
    fn every_mistake_is_named_with_its_entry() {
        let bad = [
            (SHAKEN.replace("2.5", "-1"), "harmonic 0: frequency_hz = -1.0 must be 0 or more"),
            (SHAKEN.replace("[0, 200, 0]", "[0, nan, 0]"), "harmonic 1: amplitude"),
            (format!("{SHAKEN}\n[[piece]]\nfrom_s = 0\nacceleration = [0, 0, 0]"), "2 [[harmonic]] and 1 [[piece]]"),
            (PUSHED.replace("0.5", "0"), "piece 1: from_s = 0.0 is not after"),
            (PUSHED.replace("from_s = 0\n", "from_s = 0.2\n"), "it begins at 0.2 s"),
            ("unit = 'mm'".to_owned(), "0 [[harmonic]] and 0 [[piece]]"),
            (SHAKEN.replace("frequency_hz", "frequency"), "unknown field `frequency`"),
            ("t,ax,ay\n0,1,1".to_owned(), "no column for az"),
            ("0,0,0,1".to_owned(), "one row"),
            ("0.1,0,0,1\n0.2,0,0,1".to_owned(), "it begins at 0.1 s"),
        ];
        for (text, wanted) in bad {
            let message = PalmFile::parse(&text).unwrap_err().to_string();
            assert!(message.contains(wanted), "wanted {wanted}, got {message}");
        }
    }
}
