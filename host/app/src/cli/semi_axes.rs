//! Semi-axes of an elliptic finger, as a command line tells them.

use palpate::pushing::dynamics::FingerShape;

use super::positive;

/// The value of `--semi-axes-mm`.
#[derive(Clone, Copy, Debug)]
pub(super) struct SemiAxes([f64; 2]);

impl SemiAxes {
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let Some((a, b)) = text.split_once(',') else {
            return Err(format!("`{text}` is not two lengths: write for example 20,10"));
        };
        Ok(Self([positive(a)?, positive(b)?]))
    }

    pub(super) fn shape(self) -> FingerShape {
        FingerShape::Ellipse { semi_axes: self.0.map(|mm| mm * 1e-3) }
    }
}
