//! What a part file says of the file that draws its outline.
//!
//! ```toml
//! outline = "part.dxf"
//! outline = { file = "part.stl", unit = "mm", height = 8 }
//! ```

use std::io;

use serde::Deserialize;

use super::{Drawn, ShapeError, draw};
use crate::part::Unit;

/// How the files are read that a part file names, as it names them.
pub type Opener<'a> = &'a dyn Fn(&str) -> io::Result<Vec<u8>>;

/// For texts that come without a folder.
///
/// # Errors
/// Always: there is no file.
pub fn closed(_: &str) -> io::Result<Vec<u8>> {
    Err(io::Error::new(io::ErrorKind::Unsupported, "no other file can be named here"))
}

/// Where on a solid the finger goes round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Height {
    /// So far above the table, m.
    Slice(f64),
    /// Anywhere: its outline is what is seen from above.
    Shadow,
}

/// Which direction of a solid's file points up from the table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub enum Up {
    /// As most are.
    #[default]
    #[serde(rename = "z")]
    PlusZ,
    /// Lying on its back.
    #[serde(rename = "-z")]
    MinusZ,
    /// x up.
    #[serde(rename = "x")]
    PlusX,
    /// x down.
    #[serde(rename = "-x")]
    MinusX,
    /// y up.
    #[serde(rename = "y")]
    PlusY,
    /// y down.
    #[serde(rename = "-y")]
    MinusY,
}

/// What is to be drawn of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Its name, for its ending and for messages.
    pub file: String,
    /// Of the file, where it does not say itself.
    pub unit: Option<Unit>,
    /// How far a chord may be from its curve, m.
    pub curve_error: f64,
    /// The only layer that is looked at.
    pub layer: Option<String>,
    /// Whether holes are taken for material.
    pub fills_holes: bool,
    /// Where the outline of a solid is.
    pub height: Option<Height>,
    /// How a solid lies.
    pub up: Up,
}

/// How far chords may be from their curve where nobody says, m: a finger's readings place an edge to a tenth of it more.
const CURVE_ERROR_DEFAULT_M: f64 = 5e-5;

impl Request {
    /// A file of which no more is said.
    #[must_use]
    pub fn of(file: &str) -> Self {
        let file = file.to_owned();
        let curve_error = CURVE_ERROR_DEFAULT_M;
        Self { file, unit: None, curve_error, layer: None, fills_holes: false, height: None, up: Up::PlusZ }
    }
}

/// The value of `outline`.
#[derive(Clone, Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "expected the name of a file, or a table { file = \"…\", unit, curve_error, layer, holes, height, shadow, up }"
)]
pub enum OutlineKeys {
    /// The name.
    Name(String),
    /// The name and what is to be said of it.
    Table(Box<OutlineTable>),
}

/// `outline` as a table; lengths but those of the file are in the part file's unit.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutlineTable {
    file: String,
    unit: Option<Unit>,
    curve_error: Option<f64>,
    layer: Option<String>,
    holes: Option<Holes>,
    height: Option<f64>,
    #[serde(default)]
    shadow: bool,
    #[serde(default)]
    up: Up,
}

#[derive(Clone, Copy, Debug, Deserialize)]
enum Holes {
    #[serde(rename = "fill")]
    Fill,
}

impl OutlineKeys {
    /// The request of a part file whose unit is so many metres.
    ///
    /// # Errors
    /// [`ShapeError::WhichHeight`].
    pub fn request(&self, metres: f64) -> Result<Request, ShapeError> {
        let table = match self {
            Self::Name(file) => return Ok(Request::of(file)),
            Self::Table(table) => table,
        };
        let height = match (table.height, table.shadow) {
            (None, false) => None,
            (None, true) => Some(Height::Shadow),
            (Some(height), false) if height.is_finite() => Some(Height::Slice(height * metres)),
            (Some(value), shadow) => return Err(ShapeError::WhichHeight { value, shadow }),
        };
        Ok(Request {
            unit: table.unit,
            curve_error: table.curve_error.map_or(CURVE_ERROR_DEFAULT_M, |error| error * metres),
            layer: table.layer.clone(),
            fills_holes: matches!(table.holes, Some(Holes::Fill)),
            height,
            up: table.up,
            ..Request::of(&table.file)
        })
    }

    /// Opens the file and draws it.
    ///
    /// # Errors
    /// [`ShapeError`].
    pub fn draw(&self, metres: f64, open: Opener<'_>) -> Result<Drawn, ShapeError> {
        let request = self.request(metres)?;
        let bytes = open(&request.file)
            .map_err(|error| ShapeError::File { file: request.file.clone(), reason: error.to_string() })?;
        draw(&bytes, &request)
    }
}
