//! Outlines of parts from drawings and solids: DXF, SVG and STL.
//!
//! Curves become chords within a stated tolerance ([`Request::curve_error`]), and what they are off is told
//! ([`Drawn::error`]). Nothing is dropped: what is not understood, a chain that is open, a second outline and a hole are
//! errors that name the thing and its place in the file. What a file does not say of its unit is asked for.
//!
//! - `chain`: pieces of a drawing joined end to end; `dxf`, `svg`: the readers of drawings;
//! - `stl`: the reader of solids: an outline at a height or the shadow, mass and feet.
//!
//! The readers of DXF and STL are our own. Crates for DXF pass over entities that they do not know and keep no
//! lines; those for STL end at the first `endsolid`, take a binary file whose header begins with "solid" for text, and keep
//! no lines either.
//!
//! Frames: x and y as drawn, y up; of a solid, those of the table. Units: m once read.

#[cfg(feature = "shapes")]
mod chain;
#[cfg(feature = "shapes")]
mod dxf;
mod error;
mod request;
#[cfg(feature = "shapes")]
mod stl;
#[cfg(feature = "shapes")]
mod svg;
#[cfg(test)]
#[cfg(feature = "shapes")]
mod tests;

pub use error::{Place, ShapeError};
pub use request::{Height, Opener, OutlineKeys, Request, Up, closed};

use nalgebra::Point2;
use palpate::geometry::SimplePolygon;
use palpate::pushing::dynamics::Mass;

/// The outline of a part, as a file draws it.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// Part frame, m.
    pub outline: SimplePolygon,
    /// Its chords are no further from the curves that they stand for, m.
    pub error: f64,
    /// What a solid tells beside its outline.
    pub solid: Option<Solid>,
}

/// A solid on a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// m³.
    pub volume: f64,
    /// How high it is, m.
    pub height: f64,
    /// Height of the centre of mass above the table, m.
    pub centre_height: f64,
    /// Of uniform density, as seen from above, part frame.
    pub mass: Mass,
    /// What it stands on, part frame, m, with the share of the weight on it; none where all of the outline bears evenly.
    pub feet: Option<Vec<(Point2<f64>, f64)>>,
}

/// Most vertices of an outline: each edge is a place where the finger may be.
pub const VERTICES_MAX: usize = 20_000;

/// Draws what a file holds. The ending of its name says of what kind it is: `.dxf`, `.svg` or `.stl`.
///
/// # Errors
/// [`ShapeError`] names the first thing found wrong, and where it is.
pub fn draw(bytes: &[u8], request: &Request) -> Result<Drawn, ShapeError> {
    #[cfg(feature = "shapes")]
    return drawn(bytes, request);
    #[cfg(not(feature = "shapes"))]
    {
        let _ = (bytes, request);
        Err(ShapeError::NotBuilt)
    }
}

#[cfg(feature = "shapes")]
fn drawn(bytes: &[u8], request: &Request) -> Result<Drawn, ShapeError> {
    let name = request.file.to_lowercase();
    let is = |ending: &str| name.ends_with(ending);
    if !(request.curve_error > 0.0 && request.curve_error.is_finite()) {
        return Err(ShapeError::CurveError { value: request.curve_error });
    }
    let is_solid = is(".stl");
    if !is_solid && (request.height.is_some() || request.up != Up::PlusZ) {
        return Err(ShapeError::OnlySolids);
    }
    if is_solid && request.layer.is_some() {
        return Err(ShapeError::OnlyDrawings);
    }
    match () {
        () if is(".dxf") => dxf::read(bytes, request),
        () if is(".svg") => svg::read(bytes, request),
        () if is_solid => stl::read(bytes, request),
        () => Err(ShapeError::Kind { file: request.file.clone() }),
    }
}
