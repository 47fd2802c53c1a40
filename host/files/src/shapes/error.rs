//! Why a file gives no outline.

use std::fmt;

use palpate::geometry::PolygonError;
use palpate::geometry::mesh::MeshError;

/// A thing in a file, and where it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// What it is called in the format: `ARC`, `<path>`.
    pub entity: String,
    /// The layer that it is on, if the format has them and it says.
    pub layer: Option<String>,
    /// The line where it begins, from 1.
    pub line: usize,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { entity, layer, line } = self;
        match layer {
            Some(layer) => write!(f, "{entity} on layer {layer:?} at line {line}"),
            None => write!(f, "{entity} at line {line}"),
        }
    }
}

/// Why a file gives no outline. Coordinates are in the file's own unit. What to do about it depends on who was asked: a part
/// file has other words than a command line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ShapeError {
    /// This program cannot read any.
    #[error("outlines from files are not built in: build with the feature `shapes`, or give `vertices`")]
    NotBuilt,
    /// The file cannot be read.
    #[error("{file}: {reason}")]
    File {
        /// As the part file names it.
        file: String,
        /// What the system says.
        reason: String,
    },
    /// Another ending.
    #[error("{file:?} ends in none of .dxf, .svg and .stl: export the part as one of these")]
    Kind {
        /// The name.
        file: String,
    },
    /// A tolerance that cannot be.
    #[error("curves are to be kept to {value:?} m: give a length above 0")]
    CurveError {
        /// As asked for, m.
        value: f64,
    },
    /// A height or a direction for a flat drawing.
    #[error("a height, a shadow and what is up are for solids (.stl), and this is a drawing")]
    OnlySolids,
    /// A layer of a solid.
    #[error("layers are for drawings, and this is a solid")]
    OnlyDrawings,
    /// Both or a wrong one.
    #[error("height = {value:?} with shadow = {shadow}: give a finite height, or shadow = true, not both")]
    WhichHeight {
        /// As given.
        value: f64,
        /// As given.
        shadow: bool,
    },
    /// A solid of which the outline was not said.
    #[error(
        "the part is a solid, {height:.3} high in the unit of its file: nobody says at what height above the table its outline is taken, or that it is that seen from above"
    )]
    HeightMissing {
        /// In the unit of the file.
        height: f64,
    },
    /// A slice beside the solid.
    #[error("a height of {height:.4} mm is not within the solid, which is {top:.4} mm high")]
    HeightBeside {
        /// As asked for, mm.
        height: f64,
        /// Of the solid, mm.
        top: f64,
    },
    /// Nobody says how long a unit is.
    #[error("the file does not say its unit ({why})")]
    UnitMissing {
        /// Where it could have been said.
        why: String,
        /// The name.
        file: String,
    },
    /// Two units.
    #[error("the file says that its unit is {said} ({place}), and {asked} was asked for: leave the latter out")]
    UnitTwice {
        /// What the file says.
        said: String,
        /// Where.
        place: String,
        /// What was asked for.
        asked: &'static str,
    },
    /// Not a file of this format.
    #[error("line {line}: {problem}")]
    Format {
        /// From 1.
        line: usize,
        /// What is wrong.
        problem: String,
    },
    /// Damage to a file without lines.
    #[error("{problem}")]
    Binary {
        /// What is wrong.
        problem: String,
    },
    /// Something that is no line of an outline.
    #[error("{place}: {problem}")]
    Entity {
        /// What and where.
        place: Place,
        /// Why it is not understood, and what to do.
        problem: String,
    },
    /// Nothing is drawn.
    #[error("nothing is drawn{}", .layer.as_ref().map(|layer| format!(" on layer {layer:?}; the layers are {}", known(.layers))).unwrap_or_default())]
    Nothing {
        /// The layer asked for.
        layer: Option<String>,
        /// Those in the file.
        layers: Vec<String>,
    },
    /// A curve that takes too many chords.
    #[error("{place} takes more chords than an outline may have")]
    Chords {
        /// What and where.
        place: Place,
    },
    /// A chain with an end.
    #[error(
        "the outline is open: {place} ends at ({:.6}, {:.6}), where nothing goes on{}", .at[0], .at[1],
        .nearest.as_ref().map(|nearest| format!("; the nearest end is that of {}, {:.6} away", nearest.0, nearest.1)).unwrap_or_default()
    )]
    Open {
        /// The piece.
        place: Place,
        /// Its end.
        at: [f64; 2],
        /// The nearest other end, and how far it is.
        nearest: Option<Box<(Place, f64)>>,
    },
    /// Three ends at one point.
    #[error("{}, {} and {} meet at ({:.6}, {:.6}): an outline goes on one way", .pieces[0], .pieces[1], .pieces[2], .at[0], .at[1])]
    Fork {
        /// What meets.
        pieces: Box<[Place; 3]>,
        /// Where.
        at: [f64; 2],
    },
    /// A hole.
    #[error(
        "{place} is a hole{}: a finger feels the outside only",
        .of.as_ref().map(|of| format!(" in the outline of {of}")).unwrap_or_default()
    )]
    Hole {
        /// What and where.
        place: String,
        /// What it is in.
        of: Option<String>,
    },
    /// Several parts.
    #[error("there are {count} outlines beside each other: {first} and {second}; a part has one")]
    Several {
        /// How many.
        count: usize,
        /// One.
        first: String,
        /// Another.
        second: String,
        /// Whether they are of a solid, which has no layers.
        is_solid: bool,
    },
    /// Too fine.
    #[error("the outline has {count} vertices, the limit is {limit}", limit = super::VERTICES_MAX)]
    TooManyVertices {
        /// How many.
        count: usize,
    },
    /// Drawn, but no outline of a part.
    #[error("the outline that begins with {place}: {error}{}", .edges.as_ref().map(|(a, b)| format!(" (these are {a} and {b})")).unwrap_or_default())]
    Outline {
        /// The first piece.
        place: String,
        /// Why.
        error: PolygonError,
        /// The pieces that cross.
        edges: Option<(String, String)>,
    },
    /// Of a size that no unit in use gives a part.
    #[error(
        "what is drawn is {extent:.3e} m across, and parts are from {:e} m to {:e} m: is the unit right?", EXTENT_M[0], EXTENT_M[1]
    )]
    Size {
        /// Along the longer axis, m.
        extent: f64,
    },
    /// No solid.
    #[error("{error}{}", .line.map(|line| format!(" (line {line})")).unwrap_or_default())]
    Mesh {
        /// Why.
        error: MeshError,
        /// Where its facet is, in a file with lines.
        line: Option<usize>,
    },
}

/// Parts are of these sizes, m: no finger pushes what is as thin as a hair, no table bears what is longer. Units that are confused
/// differ by up to a thousand, and what a finger pushes is of 5 mm to 1 m.
const EXTENT_M: [f64; 2] = [1e-4, 100.0];

/// Whether a part may be so long along its longer axis, m.
///
/// # Errors
/// [`ShapeError::Size`].
#[cfg(feature = "shapes")]
pub(super) fn check_size(extent: f64) -> Result<(), ShapeError> {
    if (EXTENT_M[0]..=EXTENT_M[1]).contains(&extent) { Ok(()) } else { Err(ShapeError::Size { extent }) }
}

/// Names in a list for people.
fn known(layers: &[String]) -> String {
    const SHOWN: usize = 8;
    let mut words: Vec<_> = layers.iter().take(SHOWN).map(|layer| format!("{layer:?}")).collect();
    if layers.len() > SHOWN {
        words.push(format!("{} more", layers.len() - SHOWN));
    }
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}
