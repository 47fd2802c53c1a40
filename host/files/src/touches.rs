//! Touches on a block of known outline, as a person writes them down to find the disk's place on the wrist.
//!
//! ```toml
//! unit = "mm"                     # of every length below: m, cm, mm or in
//! radius = 15                     # of the disk
//! sigma = 0.02                    # what a touch is off by, one standard deviation (optional, 0.02 mm)
//! block = [[0, 0], [50, 0], [50, 30], [0, 30]]   # its outline, in a frame of its own
//! pose = [300, 100, 23]           # where that frame is in the robot's: x, y, degrees; about where, if it is sought
//! find_block = false              # whether that is to be found too (optional)
//! [[touch]]
//! wrist = [265, 120]              # the wrist's point in the robot's frame, when the disk touched
//! turn_deg = 0                    # of the wrist's axes in the robot's (optional)
//! face = 3                        # the face that was touched: from this vertex to the next, counted from 0
//! ```
//!
//! Frames: as named. Units: SI once read. Errors: [`TouchFileError`] names what cannot be.

use nalgebra::{Isometry2, Point2, Vector2};
use palpate::SimplePolygon;
use palpate::pushing::tip::{Block, Touch};
use serde::Deserialize;

use crate::part::Unit;

/// What one touch is off by where nothing is said of it, m.
const TOUCH_SD_M: f64 = 2e-5;

/// Why a text holds no touches.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TouchFileError {
    /// Not TOML, a key missing, unknown or of another type; the message shows the place.
    #[error("{0}")]
    Text(String),
    /// A length that cannot be.
    #[error("{name} = {value}, but it must be finite and above 0")]
    Length {
        /// The key.
        name: &'static str,
        /// As given, in the file's unit.
        value: f64,
    },
    /// A number that is none.
    #[error("{0} holds a number that is not finite")]
    NotFinite(String),
    /// An outline that is none.
    #[error("block: {0}")]
    Block(String),
}

/// The keys of the file, in its unit.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    unit: Unit,
    radius: f64,
    sigma: Option<f64>,
    block: Vec<[f64; 2]>,
    pose: [f64; 3],
    #[serde(default)]
    find_block: bool,
    #[serde(default)]
    touch: Vec<TouchKeys>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TouchKeys {
    wrist: [f64; 2],
    #[serde(default)]
    turn_deg: f64,
    face: usize,
}

/// Reads the text of a file of touches.
///
/// ```
/// let text = "unit = 'mm'\nradius = 15\nblock = [[0, 0], [50, 0], [50, 30], [0, 30]]\npose = [300, 100, 0]\n\
///             [[touch]]\nwrist = [265, 120]\nface = 3";
/// let (block, touches) = palpate_files::touches::parse(text)?;
/// assert!((block.radius - 0.015).abs() < 1e-12 && touches.len() == 1);
/// # Ok::<(), palpate_files::touches::TouchFileError>(())
/// ```
///
/// # Errors
/// [`TouchFileError`] names the first thing found wrong.
pub fn parse(text: &str) -> Result<(Block, Vec<Touch>), TouchFileError> {
    let keys: Keys = toml::from_str(text).map_err(|error| TouchFileError::Text(error.to_string()))?;
    let metres = keys.unit.metres();
    let length = |name: &'static str, value: f64| {
        if value.is_finite() && value > 0.0 { Ok(value * metres) } else { Err(TouchFileError::Length { name, value }) }
    };
    let finite = |name: String, values: &[f64]| {
        if values.iter().all(|value| value.is_finite()) { Ok(()) } else { Err(TouchFileError::NotFinite(name)) }
    };
    let vertices: Vec<_> = keys.block.iter().map(|vertex| Point2::from(*vertex) * metres).collect();
    let outline = SimplePolygon::new(vertices).map_err(|error| TouchFileError::Block(error.to_string()))?;
    finite("pose".to_owned(), &keys.pose)?;
    let [x, y, turn_deg] = keys.pose;
    let block = Block {
        outline,
        pose: Isometry2::new(Vector2::new(x, y) * metres, turn_deg.to_radians()),
        is_sought: keys.find_block,
        radius: length("radius", keys.radius)?,
        touch_sd: keys.sigma.map_or(Ok(TOUCH_SD_M), |sigma| length("sigma", sigma))?,
    };
    let touches = keys.touch.iter().enumerate().map(|(number, touch)| {
        finite(format!("touch {number}"), &[touch.wrist[0], touch.wrist[1], touch.turn_deg])?;
        Ok(Touch { wrist: Point2::from(touch.wrist) * metres, turn: touch.turn_deg.to_radians(), face: touch.face })
    });
    Ok((block, touches.collect::<Result<_, _>>()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_is_named() {
        let with = |line: &str| {
            parse(&format!(
                "unit = 'mm'\npose = [0, 0, 0]\nblock = [[0, 0], [50, 0], [50, 30]]\n{line}\n[[touch]]\nwrist = [1, 2]\nface = 0"
            ))
        };
        assert!(with("radius = 15").is_ok());
        assert!(matches!(with("radius = 0"), Err(TouchFileError::Length { name: "radius", .. })));
        assert!(matches!(with("radius = 15\nsigma = -1"), Err(TouchFileError::Length { name: "sigma", .. })));
        assert!(matches!(with("radius = 15\nangle = 3"), Err(TouchFileError::Text(_))));
        let line = parse("unit = 'mm'\nradius = 1\npose = [0, 0, 0]\nblock = [[0, 0], [1, 0]]");
        assert!(matches!(line, Err(TouchFileError::Block(_))));
    }
}
