//! The file in which a person describes what is to be told apart: shapes, and the poses they may be in. TOML.
//!
//! ```toml
//! unit = "mm"                 # of every length below: m, cm, mm or in
//! curve_error = 0.01          # how far a chord may be from its arc (optional; the least of what this program does)
//!
//! [[shape]]
//! name = "bracket"
//! vertices = [[0, 0], [90, 0, 0.4], [90, 40], [30, 60]]   # counter-clockwise; a third number bulges the next edge
//! poses = [[0, 0, 0], [20, 5, 90]]                        # x, y, degrees (optional: once, as drawn)
//! ```
//!
//! Instead of `vertices` a shape may have `outline = "part.dxf"`, as a part file has.
//!
//! A bulge is the tangent of a quarter of the arc's angle, as in DXF: positive to the outside, 1 for a half circle.
//! Arcs become chords, and points are kept farther from them than the chords are off (thesis §3.7).
//!
//! Frames: world. Units: SI once read. Errors: [`SceneFileError`] names the shape, the value and what to do.

use nalgebra::{Isometry2, Point2, Vector2};
use palpate::geometry::curve::{BulgedEdge, Chords};
use palpate::geometry::{PolygonError, SimplePolygon};
use serde::Deserialize;

use crate::part::{Numbers, Unit};
use crate::shapes::{Opener, OutlineKeys, ShapeError, closed};

/// How far chords may be from their arc where the file does not say, m.
const CURVE_ERROR_DEFAULT_M: f64 = 1e-5;

/// Places on the table are rounded to multiples of this, m (2⁻⁴⁰: about a picometre), so that edges that are meant to
/// lie on one another do, whatever conversion of units and turns by right angles did to their last digits.
const PLACE_STEP_M: f64 = 9.094_947_017_729_282e-13;

/// A place on the table as everything compares it: rounded to about a picometre.
#[must_use]
pub fn snapped(place: Point2<f64>) -> Point2<f64> {
    place.map(|value| (value / PLACE_STEP_M).round() * PLACE_STEP_M)
}

/// What is to be told apart.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// What each outline is called.
    pub names: Vec<String>,
    /// Outlines on the table.
    pub polygons: Vec<SimplePolygon>,
    /// How far outlines may be from the curves they stand for, m.
    pub curve_error: f64,
    /// The unit in which the person thinks.
    pub unit: Unit,
}

/// Why a file describes no scene.
#[derive(Debug, thiserror::Error)]
pub enum SceneFileError {
    /// Not TOML, or not these keys.
    #[error(transparent)]
    Toml(#[from] toml::de::Error),
    /// No shape at all.
    #[error("there is no shape: add a [[shape]] with its vertices")]
    Empty,
    /// A vertex of a wrong length, or a number that cannot be.
    #[error("vertex {vertex} of shape `{shape}` is {value:?}: give x, y and, for an arc, its bulge within ±10")]
    Vertex {
        /// Name of the shape.
        shape: String,
        /// The vertex, from 0.
        vertex: usize,
        /// The numbers that stand in place of x and y.
        value: Vec<f64>,
    },
    /// An outline that is no polygon.
    #[error("shape `{shape}`: {error}")]
    Polygon {
        /// Name of the shape.
        shape: String,
        /// Why the outline is no polygon.
        error: PolygonError,
    },
    /// Not exactly one outline.
    #[error("shape `{shape}`: give either `vertices` or `outline`")]
    WhichOutline {
        /// Name of the shape.
        shape: String,
    },
    /// The file that draws an outline.
    #[error("shape `{shape}`: outline: {error}")]
    Drawing {
        /// Name of the shape.
        shape: String,
        /// What is wrong with it.
        error: ShapeError,
    },
    /// An error that no number of chords keeps.
    #[error("`curve_error` is {0}: give a length above 0, not below a ten-thousandth of the arcs' size")]
    CurveError(f64),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawScene {
    unit: Unit,
    curve_error: Option<f64>,
    #[serde(default)]
    shape: Vec<RawShape>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawShape {
    name: Option<String>,
    vertices: Option<Vec<Vec<f64>>>,
    outline: Option<OutlineKeys>,
    #[serde(default)]
    poses: Vec<Numbers<3>>,
}

impl SceneFile {
    /// Reads a scene.
    ///
    /// # Errors
    /// [`SceneFileError`].
    ///
    /// ```
    /// let text = "unit = 'mm'\n[[shape]]\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nposes = [[0, 0, 0], [20, 0, 90]]";
    /// let scene = palpate_files::scene::SceneFile::parse(text)?;
    /// assert_eq!(scene.names, ["shape 1, pose 1", "shape 1, pose 2"]);
    /// # Ok::<(), palpate_files::scene::SceneFileError>(())
    /// ```
    pub fn parse(text: &str) -> Result<Self, SceneFileError> {
        Self::parse_beside(text, &closed)
    }

    /// Reads a scene that may name other files, which are opened as it says.
    ///
    /// # Errors
    /// [`SceneFileError`].
    pub fn parse_beside(text: &str, open: Opener<'_>) -> Result<Self, SceneFileError> {
        let raw: RawScene = toml::from_str(text)?;
        let metres = raw.unit.metres();
        let limit = raw.curve_error.map_or(CURVE_ERROR_DEFAULT_M, |error| error * metres);
        if !(limit > 0.0 && limit.is_finite()) {
            return Err(SceneFileError::CurveError(raw.curve_error.unwrap_or(limit)));
        }
        let mut scene = Self { names: Vec::new(), polygons: Vec::new(), curve_error: 0.0, unit: raw.unit };
        for (number, shape) in raw.shape.iter().enumerate() {
            scene.add(shape, number, limit, open)?;
        }
        if scene.polygons.is_empty() { Err(SceneFileError::Empty) } else { Ok(scene) }
    }

    fn add(&mut self, shape: &RawShape, number: usize, limit: f64, open: Opener<'_>) -> Result<(), SceneFileError> {
        let metres = self.unit.metres();
        let name = shape.name.clone().unwrap_or_else(|| format!("shape {}", number + 1));
        let outline = match (&shape.vertices, &shape.outline) {
            (Some(vertices), None) => self.bulged(vertices, &name, limit)?,
            (None, Some(outline)) => {
                let drawn = outline.draw(metres, open);
                let drawn = drawn.map_err(|error| SceneFileError::Drawing { shape: name.clone(), error })?;
                self.curve_error = self.curve_error.max(drawn.error);
                drawn.outline.vertices().to_vec()
            }
            _ => return Err(SceneFileError::WhichOutline { shape: name }),
        };
        let identity = vec![Numbers([0.0; 3])];
        let poses = if shape.poses.is_empty() { &identity } else { &shape.poses };
        for (k, &Numbers([x, y, degrees])) in poses.iter().enumerate() {
            let motion = Isometry2::new(metres * Vector2::new(x, y), degrees.to_radians());
            let placed: Vec<_> = outline.iter().map(|p| snapped(motion * p)).collect();
            let polygon = SimplePolygon::new(placed);
            self.polygons.push(polygon.map_err(|error| SceneFileError::Polygon { shape: name.clone(), error })?);
            let pose = if poses.len() > 1 { format!(", pose {}", k + 1) } else { String::new() };
            self.names.push(name.clone() + &pose);
        }
        Ok(())
    }
}

impl SceneFile {
    /// The outline with these vertices, its arcs as chords.
    fn bulged(&mut self, vertices: &[Vec<f64>], name: &str, limit: f64) -> Result<Vec<Point2<f64>>, SceneFileError> {
        let metres = self.unit.metres();
        let corners = corners(vertices, name, metres)?;
        let mut outline = Vec::new();
        for (k, &(start, bulge)) in corners.iter().enumerate() {
            let (end, _) = corners[(k + 1) % corners.len()];
            let chords = BulgedEdge { start, end, bulge }.chords(limit);
            let Chords { mut points, error } = chords.ok_or(SceneFileError::CurveError(limit / metres))?;
            self.curve_error = self.curve_error.max(error);
            points.pop();
            outline.extend(points);
        }
        Ok(outline)
    }
}

/// Vertices in metres, each with the bulge of the edge after it.
fn corners(vertices: &[Vec<f64>], name: &str, metres: f64) -> Result<Vec<(Point2<f64>, f64)>, SceneFileError> {
    let corner = |(vertex, value): (usize, &Vec<f64>)| match value[..] {
        [x, y] => Ok((Point2::new(x, y) * metres, 0.0)),
        [x, y, bulge] if bulge.abs() <= 10.0 => Ok((Point2::new(x, y) * metres, bulge)),
        _ => Err(SceneFileError::Vertex { shape: name.to_owned(), vertex, value: value.clone() }),
    };
    vertices.iter().enumerate().map(corner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_of_two_half_circles_is_as_round_as_asked() {
        let text = "unit = 'mm'\ncurve_error = 0.05\n[[shape]]\nname = 'disk'\nvertices = [[-20, 0, 1], [20, 0, 1]]";
        let scene = SceneFile::parse(text).unwrap();
        assert!(scene.curve_error > 1e-5 && scene.curve_error <= 5e-5, "{}", scene.curve_error);
        for point in scene.polygons[0].vertices() {
            assert!((point.coords.norm() - 0.02).abs() < PLACE_STEP_M, "{point}");
        }
        let full = std::f64::consts::PI * 0.02 * 0.02;
        assert!(scene.polygons[0].area() > 0.99 * full && scene.polygons[0].area() < full);
    }

    #[test]
    fn a_negative_bulge_goes_inwards() {
        let text = "unit = 'mm'\n[[shape]]\nvertices = [[0, 0, -0.2], [60, 0], [60, 40], [0, 40]]";
        let scene = SceneFile::parse(text).unwrap();
        assert!(scene.polygons[0].area() < 0.0024 - 1e-5);
        assert!(scene.polygons[0].vertices().iter().all(|p| p.y >= 0.0));
    }

    #[test]
    fn turns_by_right_angles_leave_no_slivers() {
        let text = "unit = 'mm'\n[[shape]]\nvertices = [[0, 0], [60, 0], [60, 20], [0, 20]]\n\
                    poses = [[0, 0, 0], [60, 0, 90], [60, 20, 180], [0, 60, 270]]";
        let scene = SceneFile::parse(text).unwrap();
        // A lying bar twice, one to the left of x = 60 standing, and one to the right of x = 0 hanging down to y = 0.
        assert_eq!(scene.polygons.len(), 4);
        let regions = palpate::point_sampling::Subdivision::new(&scene.polygons).regions().count();
        assert_eq!(regions, 5);
    }

    #[test]
    fn mistakes_are_named() {
        let told = |text: &str| SceneFile::parse(text).unwrap_err().to_string();
        assert!(told("unit = 'mm'").contains("no shape"));
        assert!(
            told("unit = 'mm'\n[[shape]]\nname = 'x'\nvertices = [[0], [1, 0], [1, 1]]")
                .contains("vertex 0 of shape `x`")
        );
        assert!(told("unit = 'mm'\n[[shape]]\nname = 'x'\nvertices = [[0, 0], [0, 1], [1, 1]]").contains("clockwise"));
        assert!(told("unit = 'mm'\ncurve_error = 0\n[[shape]]\nvertices = []").contains("curve_error"));
        assert!(told("unit = 'mm'\n[[shape]]\ncorners = []").contains("corners"));
    }
}
