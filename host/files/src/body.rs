//! The file in which a person describes a smooth body: TOML, with the unit of its lengths.
//!
//! ```toml
//! unit = "mm"                 # of every length below: m, cm, mm or in
//! shape = "ellipsoid"         # or "egg", "rounded"
//! semi_axes = [20, 30, 40]
//! e = 3                       # egg only: how much longer the end at +z is
//! zc = 1.4                    # egg only: the origin on the third axis, from the ellipsoid's centre
//! r = 12                      # rounded only: the least radius of curvature
//! radii_of_gyration = [22, 20, 15]    # about the three axes (egg, rounded; else uniform density)
//! ```
//!
//! Frames: the body's own. Units: SI once read.
//! Errors: [`BodyFileError`] names the key, the value, the limit and what to do.

use palpate::rolling::{BodyError, Egg, RollingBody, RoundedShape};
use serde::Deserialize;

use crate::part::{Numbers, Unit};

/// A body that a person has described.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyFile {
    /// Shape and inertia, body frame, m and m².
    pub body: RollingBody,
    /// The unit in which the person thinks.
    pub unit: Unit,
}

/// The keys of the file, in its unit.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    unit: Unit,
    shape: ShapeName,
    semi_axes: Numbers<3>,
    e: Option<f64>,
    zc: Option<f64>,
    r: Option<f64>,
    radii_of_gyration: Option<Numbers<3>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum ShapeName {
    Ellipsoid,
    Egg,
    Rounded,
}

/// Why a file does not describe a body.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BodyFileError {
    /// Not TOML, a key missing, unknown or of another type; the message shows the place.
    #[error("{0}")]
    Toml(String),
    /// A key that another shape has.
    #[error("{key} is not for this shape: leave it out")]
    Foreign {
        /// The key that this shape does not have.
        key: &'static str,
    },
    /// A key that this shape needs.
    #[error("{key} is missing: this shape needs it")]
    Missing {
        /// The key that this shape needs.
        key: &'static str,
    },
    /// There is no such body.
    #[error(transparent)]
    Body(#[from] BodyError),
}

impl BodyFile {
    /// Reads the text of a file.
    ///
    /// ```
    /// use palpate_files::body::BodyFile;
    ///
    /// let pebble = BodyFile::parse("unit = 'mm'\nshape = 'ellipsoid'\nsemi_axes = [20, 30, 40]")?;
    /// assert!((pebble.body.size() - 0.03).abs() < 1e-12); // m
    /// # Ok::<(), palpate_files::body::BodyFileError>(())
    /// ```
    ///
    /// # Errors
    /// [`BodyFileError`] names the first thing found wrong.
    pub fn parse(text: &str) -> Result<Self, BodyFileError> {
        let keys: Keys = toml::from_str(text).map_err(|error| BodyFileError::Toml(error.to_string()))?;
        Ok(Self { body: keys.body()?, unit: keys.unit })
    }
}

impl Keys {
    fn body(&self) -> Result<RollingBody, BodyFileError> {
        self.refuse_foreign()?;
        let metres = self.unit.metres();
        let semi_axes = self.semi_axes.0.map(|axis| axis * metres);
        let inertia = self.radii_of_gyration.map(|radii| radii.0.map(|radius| (radius * metres).powi(2)));
        let needed = |key: &'static str, value: Option<f64>| value.ok_or(BodyFileError::Missing { key });
        match self.shape {
            ShapeName::Ellipsoid => Ok(RollingBody::ellipsoid(semi_axes)?),
            ShapeName::Egg => {
                let skew = needed("e", self.e)? * metres;
                let origin = needed("zc", self.zc)? * metres;
                Ok(RollingBody::egg(Egg { semi_axes, skew, origin }, inertia)?)
            }
            ShapeName::Rounded => {
                Ok(RollingBody::rounded(RoundedShape { semi_axes, radius: needed("r", self.r)? * metres }, inertia)?)
            }
        }
    }

    fn refuse_foreign(&self) -> Result<(), BodyFileError> {
        let foreign = [
            ("e", self.e.is_some() && self.shape != ShapeName::Egg),
            ("zc", self.zc.is_some() && self.shape != ShapeName::Egg),
            ("r", self.r.is_some() && self.shape != ShapeName::Rounded),
            ("radii_of_gyration", self.radii_of_gyration.is_some() && self.shape == ShapeName::Ellipsoid),
        ];
        match foreign.into_iter().find(|(_, given)| *given) {
            Some((key, _)) => Err(BodyFileError::Foreign { key }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PEBBLE: &str = "unit = 'mm'\nshape = 'ellipsoid'\nsemi_axes = [20, 30, 40]\n";

    #[test]
    fn units_change_nothing_but_the_numbers() {
        for (unit, metres) in [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("in", 0.0254)] {
            let file = BodyFile::parse(&PEBBLE.replace("mm", unit)).unwrap();
            assert!((file.body.size() / (30.0 * metres) - 1.0).abs() < 1e-12, "{unit}");
        }
    }

    #[test]
    fn radii_of_gyration_are_taken_in_the_files_unit() {
        let text =
            "unit = 'cm'\nshape = 'rounded'\nsemi_axes = [2, 3, 2.5]\nr = 1.2\nradii_of_gyration = [2.2, 2, 1.9]";
        let inertia = BodyFile::parse(text).unwrap().body.inertia();
        assert!((inertia.x - 0.022_f64.powi(2)).abs() < 1e-15 && (inertia.z - 0.019_f64.powi(2)).abs() < 1e-15);
    }

    #[test]
    fn every_mistake_is_named_with_its_key() {
        let egg = PEBBLE.replace("ellipsoid", "egg");
        let bad = [
            (PEBBLE.replace("[20, 30, 40]", "[20, -30, 40]"), "semi-axis 1"),
            (PEBBLE.replace("[20, 30, 40]", "[20, 30]"), "expected"),
            (PEBBLE.replace("ellipsoid", "cube"), "cube"),
            (format!("{PEBBLE}r = 2"), "r is not for this shape"),
            (format!("{PEBBLE}mass = 2"), "unknown field `mass`"),
            (egg.clone(), "e is missing"),
            (format!("{egg}e = 4\nzc = 0"), "set zc to"),
            (format!("{egg}e = 40\nzc = 0\nradii_of_gyration = [22, 20, 15]"), "not strictly convex"),
            (format!("{egg}e = 4\nzc = 0\nradii_of_gyration = [0, 20, 15]"), "above 0"),
        ];
        for (text, wanted) in bad {
            let message = BodyFile::parse(&text).unwrap_err().to_string();
            assert!(message.contains(wanted), "wanted {wanted}, got {message}");
        }
    }
}
