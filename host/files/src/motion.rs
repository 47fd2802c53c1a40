//! How a finger moves, as a person writes it down.
//!
//! ```toml
//! unit = "mm"                     # of every length below: m, cm, mm or in
//! start = [0, 0]                  # the disk's centre at t = 0, when the motion begins (optional)
//! [[segment]]
//! seconds = 0.3
//! acceleration = [150, 0]         # mm/s², along the finger's axes
//! rise_seconds = 0.02             # how long it takes from the one before, or from none (optional: 0, a step)
//! [[segment]]
//! seconds = 0.5
//! acceleration = [0, 150]
//! ```
//!
//! Frames: finger axes. Units: SI once read. Errors: [`MotionFileError`] names the segment, the value, the limit and
//! what to do.

use nalgebra::Point2;
use palpate::pushing::finger_motion::{FingerMotion, MotionError, RisingSegment, Segment};
use serde::Deserialize;

use crate::part::Unit;

/// Why a text is no motion.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MotionFileError {
    /// Not TOML, a key missing, unknown or of another type; the message shows the place.
    #[error("{0}")]
    Text(String),
    /// No motion that can be.
    #[error(transparent)]
    Motion(#[from] MotionError),
}

/// The keys of the file, in its unit.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    unit: Unit,
    #[serde(default)]
    start: [f64; 2],
    #[serde(default)]
    segment: Vec<RisingSegment>,
}

/// Reads the text of a motion file.
///
/// ```
/// let motion = palpate_files::motion::parse("unit = 'mm'\n[[segment]]\nseconds = 0.5\nacceleration = [100, 0]")?;
/// assert!((motion.centre(0.5).x - 0.0125).abs() < 1e-12); // a t²/2, m
/// # Ok::<(), palpate_files::motion::MotionFileError>(())
/// ```
///
/// # Errors
/// [`MotionFileError`] names the first thing found wrong.
pub fn parse(text: &str) -> Result<FingerMotion, MotionFileError> {
    let keys: Keys = toml::from_str(text).map_err(|error| MotionFileError::Text(error.to_string()))?;
    let metres = keys.unit.metres();
    let segments = keys.segment.iter();
    let segments = segments.map(|segment| RisingSegment { acceleration: segment.acceleration * metres, ..*segment });
    Ok(FingerMotion::rising(Point2::from(keys.start) * metres, &segments.collect::<Vec<_>>())?)
}

/// A motion as its file, in metres.
///
/// ```
/// let motion = palpate_files::motion::parse("unit = 'mm'\n[[segment]]\nseconds = 0.5\nacceleration = [100, 0]")?;
/// assert_eq!(palpate_files::motion::parse(&palpate_files::motion::to_text(&motion))?, motion);
/// # Ok::<(), palpate_files::motion::MotionFileError>(())
/// ```
#[must_use]
pub fn to_text(motion: &FingerMotion) -> String {
    let start = motion.centre(0.0);
    let segments = motion.segments().iter().map(|Segment { seconds, acceleration }| {
        format!("\n[[segment]]\nseconds = {seconds}\nacceleration = [{}, {}]\n", acceleration.x, acceleration.y)
    });
    format!("unit = \"m\"\nstart = [{}, {}]\n{}", start.x, start.y, segments.collect::<String>())
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    const TURN: &str = "unit = 'cm'\nstart = [1, 2]\n[[segment]]\nseconds = 0.5\nacceleration = [10, 0]\n\
                        [[segment]]\nseconds = 0.25\nacceleration = [0, -20]";

    #[test]
    fn lengths_are_in_the_files_unit() {
        let motion = parse(TURN).unwrap();
        // 1 cm + 10 cm/s² · (0.5 s)²/2, then 5 cm/s for a quarter of a second.
        let wanted = [0.01 + 0.0125 + 0.0125, 0.02 - 0.2 * 0.25 * 0.25 / 2.0];
        let end = motion.centre(0.75);
        assert!((end.x - wanted[0]).abs() < 1e-15 && (end.y - wanted[1]).abs() < 1e-15, "{end}");
    }

    #[test]
    fn an_acceleration_may_rise() {
        let motion = parse(&TURN.replace("seconds = 0.25", "seconds = 0.25\nrise_seconds = 0.05")).unwrap();
        for (t, wanted) in [(0.4, [0.1, 0.0]), (0.5251, [0.05, -0.1]), (0.6, [0.0, -0.2])] {
            /// Half of a step of the rise, m/s².
            const STEP: f64 = 0.5 * 0.23 / 50.0;
            let acceleration = motion.acceleration(t);
            assert!((acceleration - Vector2::from(wanted)).norm() <= STEP, "{t} s: {acceleration}");
        }
        assert_eq!(parse(&to_text(&motion)).unwrap(), motion);
    }

    #[test]
    fn every_mistake_is_named_with_its_segment() {
        let bad = [
            (TURN.replace("0.25", "-1"), "segment 1: seconds = -1.0"),
            (TURN.replace("[0, -20]", "[0, nan]"), "segment 1: acceleration"),
            (TURN.replace("[10, 0]", "[0, 0]"), "segment 0 has no acceleration"),
            (TURN.replace("seconds = 0.25", "seconds = 0.25\nrise_seconds = 0.3"), "segment 1: rise_seconds = 0.3"),
            (TURN.replace("[1, 2]", "[inf, 2]"), "start = [inf"),
            (TURN.replace("seconds = 0.5", "second = 0.5"), "unknown field `second`"),
            ("unit = 'mm'".to_owned(), "no segments"),
        ];
        for (text, wanted) in bad {
            let message = parse(&text).unwrap_err().to_string();
            assert!(message.contains(wanted), "wanted {wanted}, got {message}");
        }
    }
}
