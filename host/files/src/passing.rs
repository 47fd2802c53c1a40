//! A file of the light barriers and turning beams that a part is carried past: TOML.
//!
//! ```toml
//! unit = "mm"             # of every length below: m, cm, mm or in; angles are in degrees, counter-clockwise from x
//! velocity = [120, 0]     # of what carries the part, in the unit a second
//! debounce_ms = 5         # a beam that is free for less bounces (optional)
//! sigma = 0.05            # standard deviation of a turning beam's angle as it meets a side, degrees (with [[beam]] only)
//!
//! [[barrier]]             # a straight beam
//! id = 1                  # what its changes are called; of a board, input 0
//! at = [0, 0]             # a point of it
//! direction = 90
//! sigma = 0.05            # standard deviation of where it is, across it, in the unit
//! time_sigma_ms = 0.5     # and of when it switches
//!
//! [[beam]]                # one that turns about a point
//! id = 3
//! apex = [50, -300]
//! phase = 0               # its angle at the time 0
//! turns_per_second = 20   # counter-clockwise
//! ```
//!
//! Units inside: SI. Errors: [`PassingFileError`].

use std::f64::consts::TAU;

use nalgebra::{Point2, Vector2};
use palpate::inscription::{Barrier, Beam, TurningBeam};
use serde::Deserialize;

use crate::part::{Numbers, Unit};

/// A beam that is free for less bounces, where the file says nothing, ms.
const DEBOUNCE_MS: f64 = 5.0;

/// Beams that a part is carried past.
#[derive(Clone, Debug, PartialEq)]
pub struct PassingFile {
    /// Of what carries the part, m/s.
    pub velocity: Vector2<f64>,
    /// A beam that is free for less bounces, s.
    pub debounce: f64,
    /// Standard deviation of a turning beam's angle as it meets a side of the part, rad.
    pub bearing_sigma: f64,
    /// The beams, and what the changes of each are called, from 1.
    pub beams: Vec<Beam>,
    /// In the beams' order.
    pub ids: Vec<usize>,
}

/// Why a file cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PassingFileError {
    /// Not TOML, a key missing, unknown or of another type; the message shows the place.
    #[error("{0}")]
    Toml(String),
    /// Nothing that goes by.
    #[error("velocity = {velocity:?}: both numbers must be finite, and not both 0")]
    Velocity {
        /// As given, in the file's unit a second.
        velocity: [f64; 2],
    },
    /// A number that cannot be.
    #[error("{what} {id}: {key} = {value:?} {wanted}")]
    Number {
        /// `barrier`, `beam` or `the file`.
        what: &'static str,
        /// Its id; 0 of the file.
        id: usize,
        /// The key.
        key: &'static str,
        /// As given.
        value: f64,
        /// What it must be.
        wanted: &'static str,
    },
    /// Two with one name.
    #[error("id = {id} is given to two beams: the changes of each need a number of their own")]
    Twice {
        /// The number.
        id: usize,
    },
    /// Out of range.
    #[error("id = {id} is none: give each beam a number from 1 to {ID_MAX}")]
    Id {
        /// The number.
        id: usize,
    },
    /// A barrier along which the part goes.
    #[error("barrier {id}: its beam lies along the velocity, so that no part ever begins to cover it: turn it")]
    Along {
        /// Its id.
        id: usize,
    },
    /// Nothing says when a part goes by.
    #[error("there is no [[barrier]]: at least one says when a part goes by")]
    NoBarrier,
    /// Not enough for a pose.
    #[error(
        "one [[barrier]] and no [[beam]] give two lines, and a pose needs three: add a barrier of another direction"
    )]
    TooFew,
    /// A turning beam of unknown error.
    #[error(
        "[[beam]] needs `sigma` at the file's top: the standard deviation, in degrees, of its angle as it meets a side"
    )]
    NoSigma,
}

/// Largest number of a beam.
pub const ID_MAX: usize = 64;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    unit: Unit,
    velocity: Numbers<2>,
    debounce_ms: Option<f64>,
    sigma: Option<f64>,
    #[serde(default)]
    barrier: Vec<BarrierKeys>,
    #[serde(default)]
    beam: Vec<BeamKeys>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BarrierKeys {
    id: usize,
    at: Numbers<2>,
    direction: f64,
    sigma: f64,
    time_sigma_ms: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BeamKeys {
    id: usize,
    apex: Numbers<2>,
    phase: f64,
    turns_per_second: f64,
}

/// A number that fulfils a wish, or an error that names it.
fn checked(
    what: &'static str,
    id: usize,
    (key, value): (&'static str, f64),
    is_fair: bool,
    wanted: &'static str,
) -> Result<f64, PassingFileError> {
    if value.is_finite() && is_fair {
        Ok(value)
    } else {
        Err(PassingFileError::Number { what, id, key, value, wanted })
    }
}

impl BarrierKeys {
    fn barrier(&self, metres: f64) -> Result<Barrier, PassingFileError> {
        let Self { id, at: Numbers([x, y]), direction, sigma, time_sigma_ms } = *self;
        let checked = |key, value, is_fair| checked("barrier", id, (key, value), is_fair, "must be finite");
        let above = |key, value: f64| {
            self::checked("barrier", id, (key, value), value >= 0.0, "must be finite and not below 0")
        };
        let at = Point2::new(checked("at", x, true)?, checked("at", y, true)?) * metres;
        let (sigma, time_sigma) = (above("sigma", sigma)? * metres, above("time_sigma_ms", time_sigma_ms)? * 1e-3);
        if sigma.hypot(time_sigma) == 0.0 {
            let wanted = "and time_sigma_ms = 0: nothing is exact, give one of them";
            return Err(PassingFileError::Number { what: "barrier", id, key: "sigma", value: sigma, wanted });
        }
        Ok(Barrier { at, direction: checked("direction", direction, true)?.to_radians(), sigma, time_sigma })
    }
}

impl BeamKeys {
    fn beam(&self, metres: f64) -> Result<TurningBeam, PassingFileError> {
        let Self { id, apex: Numbers([x, y]), phase, turns_per_second } = *self;
        let finite = |key, value| checked("beam", id, (key, value), true, "must be finite");
        let apex = Point2::new(finite("apex", x)?, finite("apex", y)?) * metres;
        let turns = ("turns_per_second", turns_per_second);
        let turns = checked("beam", id, turns, turns_per_second != 0.0, "must be finite and not 0")?;
        Ok(TurningBeam { apex, phase: finite("phase", phase)?.to_radians(), rate: turns * TAU })
    }
}

impl PassingFile {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`PassingFileError`] names the first thing found wrong.
    pub fn parse(text: &str) -> Result<Self, PassingFileError> {
        let keys: Keys = toml::from_str(text).map_err(|error| PassingFileError::Toml(error.to_string()))?;
        let metres = keys.unit.metres();
        let Numbers(velocity) = keys.velocity;
        if !velocity.iter().all(|value| value.is_finite()) || velocity.iter().all(|value| *value == 0.0) {
            return Err(PassingFileError::Velocity { velocity });
        }
        let velocity = Vector2::from(velocity) * metres;
        let debounce = keys.debounce_ms.unwrap_or(DEBOUNCE_MS);
        let of_file = ("debounce_ms", debounce);
        let debounce = checked("the file", 0, of_file, debounce >= 0.0, "must be finite and not below 0")? * 1e-3;
        let (mut beams, mut ids) = (Vec::new(), Vec::new());
        for keys in &keys.barrier {
            let barrier = keys.barrier(metres)?;
            barrier.front(velocity).ok_or(PassingFileError::Along { id: keys.id })?;
            beams.push(Beam::Barrier(barrier));
            ids.push(keys.id);
        }
        for keys in &keys.beam {
            beams.push(Beam::Turning(keys.beam(metres)?));
            ids.push(keys.id);
        }
        for (place, &id) in ids.iter().enumerate() {
            if !(1..=ID_MAX).contains(&id) {
                return Err(PassingFileError::Id { id });
            }
            if ids[..place].contains(&id) {
                return Err(PassingFileError::Twice { id });
            }
        }
        match (keys.barrier.len(), keys.beam.len()) {
            (0, _) => return Err(PassingFileError::NoBarrier),
            (1, 0) => return Err(PassingFileError::TooFew),
            _ => {}
        }
        let bearing_sigma = match keys.sigma {
            Some(sigma) => {
                checked("the file", 0, ("sigma", sigma), sigma > 0.0, "must be finite and above 0")?.to_radians()
            }
            None if keys.beam.is_empty() => 0.0,
            None => return Err(PassingFileError::NoSigma),
        };
        Ok(Self { velocity, debounce, bearing_sigma, beams, ids })
    }

    /// The place among the beams of one whose changes are called so.
    #[must_use]
    pub fn place(&self, id: usize) -> Option<usize> {
        self.ids.iter().position(|other| *other == id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "unit = 'mm'\nvelocity = [120, 0]\nsigma = 0.1\n\
        [[barrier]]\nid = 1\nat = [10, 0]\ndirection = 90\nsigma = 0.05\ntime_sigma_ms = 0.5\n\
        [[barrier]]\nid = 2\nat = [60, 0]\ndirection = 45\nsigma = 0.05\ntime_sigma_ms = 0.5\n\
        [[beam]]\nid = 7\napex = [50, -300]\nphase = 90\nturns_per_second = -20\n";

    #[test]
    fn a_file_is_read_in_si_units() {
        let file = PassingFile::parse(FILE).unwrap();
        assert_eq!(file.velocity, Vector2::new(0.12, 0.0));
        assert_eq!((file.debounce, file.ids.as_slice()), (5e-3, &[1, 2, 7][..]));
        let Beam::Barrier(barrier) = file.beams[1] else { panic!("{file:?}") };
        assert_eq!((barrier.at, barrier.sigma, barrier.time_sigma), (Point2::new(0.06, 0.0), 5e-5, 5e-4));
        assert!((barrier.direction - TAU / 8.0).abs() < 1e-15);
        let Beam::Turning(beam) = file.beams[2] else { panic!("{file:?}") };
        assert!((beam.rate + 20.0 * TAU).abs() < 1e-12 && (beam.phase - TAU / 4.0).abs() < 1e-15);
        assert_eq!((file.place(7), file.place(3)), (Some(2), None));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let says = |from: &str, to: &str| {
            assert!(FILE.contains(from), "{from}");
            PassingFile::parse(&FILE.replacen(from, to, 1)).unwrap_err().to_string()
        };
        assert!(says("velocity = [120, 0]", "velocity = [0, 0]").contains("not both 0"));
        assert!(says("direction = 90", "direction = 180").contains("barrier 1: its beam lies along the velocity"));
        assert!(says("id = 2", "id = 1").contains("id = 1 is given to two beams"));
        assert!(says("id = 2", "id = 0").contains("from 1 to 64"));
        assert!(says("sigma = 0.1\n", "").contains("[[beam]] needs `sigma`"));
        assert!(says("sigma = 0.05", "sigma = -1").contains("barrier 1: sigma = -1"));
        assert!(says("turns_per_second = -20", "turns_per_second = 0").contains("beam 7: turns_per_second"));
        assert!(says("phase = 90", "phaze = 90").contains("phaze"));
        let barriers = FILE.split("[[").take(2).collect::<Vec<_>>().join("[[");
        assert!(PassingFile::parse(&barriers).unwrap_err().to_string().contains("a pose needs three"));
    }
}
