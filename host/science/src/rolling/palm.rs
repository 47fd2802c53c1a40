//! How the palm accelerates.
//!
//! Only acceleration matters: the motion on a palm of constant velocity is that on a palm at rest. Gravity acts as an
//! acceleration `g` upward, so the body feels `a(t) + g e₃`.
//!
//! Implements: the input `a_P` of thesis §7.1.2 (corrected: its velocity terms break Galilean invariance).
//! Frames: palm axes, e₃ up along the palm's normal; the palm does not turn. Units: m/s², s, Hz, rad. Errors: none.

use std::f64::consts::TAU;

use nalgebra::Vector3;

/// The acceleration of a palm over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum PalmAcceleration {
    /// At rest, or at constant velocity.
    #[default]
    Rest,
    /// The same at all times, m/s².
    Constant(Vector3<f64>),
    /// A sum of harmonics.
    Harmonic(Vec<Harmonic>),
    /// Constant from each instant to the next.
    Piecewise(Pieces),
}

/// `amplitude · sin(2π·frequency_hz·t + phase)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Harmonic {
    /// Amplitude along each palm axis, m/s².
    pub amplitude: Vector3<f64>,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Phase at t = 0, rad.
    pub phase: f64,
}

/// Accelerations and when each begins; the last lasts.
#[derive(Clone, Debug, PartialEq)]
pub struct Pieces {
    starts: Vec<f64>,
    values: Vec<Vector3<f64>>,
}

/// Why a list is no piecewise acceleration.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PiecesError {
    /// A list without any instant.
    #[error("is empty: give at least one instant with its acceleration")]
    Empty,
    /// As many instants as accelerations are needed.
    #[error("has {values} accelerations for {starts} instants: give one for each")]
    Lengths {
        /// How many instants.
        starts: usize,
        /// How many accelerations.
        values: usize,
    },
    /// The instants do not increase.
    #[error("{start:?} s is not after the instant before it: instants must increase")]
    Order {
        /// Place of the piece in the list, from 0.
        index: usize,
        /// When it would begin, s.
        start: f64,
    },
}

impl Pieces {
    /// Joins instants (s) and accelerations (m/s²).
    ///
    /// # Errors
    /// [`PiecesError`] for lists of different lengths and instants out of order.
    pub fn new(starts: Vec<f64>, values: Vec<Vector3<f64>>) -> Result<Self, PiecesError> {
        if starts.is_empty() {
            return Err(PiecesError::Empty);
        }
        if starts.len() != values.len() {
            return Err(PiecesError::Lengths { starts: starts.len(), values: values.len() });
        }
        let after = |i: usize| starts[i].partial_cmp(&starts[i - 1]) == Some(std::cmp::Ordering::Greater);
        match (1..starts.len()).find(|&i| !after(i)) {
            Some(index) => Err(PiecesError::Order { index, start: starts[index] }),
            None => Ok(Self { starts, values }),
        }
    }

    /// The first instant, s.
    #[must_use]
    pub fn start(&self) -> f64 {
        self.starts[0]
    }

    /// The piece that holds at `time`; right-continuous.
    fn at(&self, time: f64) -> Vector3<f64> {
        let after = self.starts.partition_point(|start| *start <= time);
        self.values[after.saturating_sub(1)]
    }
}

impl PalmAcceleration {
    /// At `time` (s), m/s²; from the right where it jumps.
    #[must_use]
    pub fn at(&self, time: f64) -> Vector3<f64> {
        match self {
            Self::Rest => Vector3::zeros(),
            Self::Constant(value) => *value,
            Self::Harmonic(harmonics) => harmonics.iter().map(|harmonic| harmonic.at(time)).sum(),
            Self::Piecewise(pieces) => pieces.at(time),
        }
    }

    /// At `time` as seen from within the step that has `inside` in it: from the left at the step's end.
    #[must_use]
    pub fn at_within(&self, time: f64, inside: f64) -> Vector3<f64> {
        match self {
            Self::Piecewise(pieces) => pieces.at(inside),
            _ => self.at(time),
        }
    }

    /// The same with time counted from `start` (s).
    #[must_use]
    pub fn from(&self, start: f64) -> Self {
        match self {
            Self::Rest | Self::Constant(_) => self.clone(),
            Self::Harmonic(harmonics) => Self::Harmonic(
                harmonics
                    .iter()
                    .map(|harmonic| Harmonic {
                        phase: harmonic.phase + TAU * harmonic.frequency_hz * start,
                        ..*harmonic
                    })
                    .collect(),
            ),
            Self::Piecewise(Pieces { starts, values }) => Self::Piecewise(Pieces {
                starts: starts.iter().map(|instant| instant - start).collect(),
                values: values.clone(),
            }),
        }
    }

    /// The instants after `from` and before `to` (s) at which it jumps.
    pub fn jumps(&self, from: f64, to: f64) -> impl Iterator<Item = f64> + '_ {
        let starts = if let Self::Piecewise(pieces) = self { pieces.starts.as_slice() } else { &[] };
        starts.iter().copied().filter(move |start| *start > from && *start < to)
    }
}

impl Harmonic {
    fn at(&self, time: f64) -> Vector3<f64> {
        self.amplitude * (TAU * self.frequency_hz * time + self.phase).sin()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_continuous_from_the_right_and_last() {
        let values = [1.0, 2.0, 3.0].map(|x| Vector3::new(x, 0.0, 0.0));
        let palm = PalmAcceleration::Piecewise(Pieces::new(vec![0.0, 0.5, 1.0], values.to_vec()).unwrap());
        for (t, wanted) in [(0.0, 1.0), (0.499, 1.0), (0.5, 2.0), (1.0, 3.0), (9.0, 3.0)] {
            assert!((palm.at(t).x - wanted).abs() < 1e-15, "{t}");
        }
        assert!((palm.at_within(0.5, 0.4).x - 1.0).abs() < 1e-15);
        assert_eq!(palm.jumps(0.0, 1.0).collect::<Vec<_>>(), [0.5]);
    }

    #[test]
    fn instants_out_of_order_are_named() {
        let values = vec![Vector3::zeros(); 2];
        assert_eq!(
            Pieces::new(vec![0.5, 0.5], values.clone()).unwrap_err(),
            PiecesError::Order { index: 1, start: 0.5 }
        );
        assert_eq!(Pieces::new(vec![0.5], values).unwrap_err(), PiecesError::Lengths { starts: 1, values: 2 });
        assert_eq!(Pieces::new(vec![], vec![]).unwrap_err(), PiecesError::Empty);
    }

    #[test]
    fn harmonics_add_up() {
        let harmonic = |x: f64, phase: f64| Harmonic { amplitude: Vector3::new(x, 0.0, 0.0), frequency_hz: 2.0, phase };
        let palm = PalmAcceleration::Harmonic(vec![harmonic(1.0, 0.0), harmonic(3.0, TAU / 4.0)]);
        assert!((palm.at(0.125).x - 1.0).abs() < 1e-15);
    }
}
