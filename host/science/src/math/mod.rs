//! Mathematics that several rooms share. Nothing here knows of parts, fingers or forces.

pub mod angle;
pub(crate) mod bits;
mod dual;
pub mod least_squares;
pub mod ode;
pub mod random;
pub(crate) mod roots;
mod spectrum;
pub mod statistics;

pub use bits::{BitMatrix, BitRow, BitSet};
pub use dual::{Jet, Number};
pub use spectrum::{RANK_THRESHOLD, Spectrum};
