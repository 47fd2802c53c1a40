//! Mathematics that several rooms share. Nothing here knows of fingers, friction or forces.
//!
//! - [`angle`]: wrapping, and the angle of a contact; [`Jet`] (`dual`): numbers that carry their derivatives;
//! - [`least_squares`]: the one damped descent (Levenberg and Marquardt); [`ode`]: the one Runge–Kutta step;
//!   `dormand_prince`: the one error-controlled step; `rosenbrock`: the one for what is stiff; `roots`: zeros of a function on an interval;
//! - [`Spectrum`] (`spectrum`): rank and unseen directions of a system; [`fn@least_seen`]: where it tells least; [`statistics`]: means, percentiles, quantiles;
//! - [`twofold`]: twice the digits, and power series, for verdicts that must not rest on rounding;
//! - `unscented`: a Gaussian through a function that is not straight; `covariance`: what several sources say of one thing;
//! - [`random`]: numbers and polygons from a seed; [`BitSet`], [`BitMatrix`] (`bits`): sets of small numbers;
//! - `arrays`: vectors and matrices as plain arrays in files.

pub mod angle;
pub(crate) mod arrays;
pub(crate) mod bits;
pub(crate) mod covariance;
pub(crate) mod dormand_prince;
mod dual;
mod least_seen;
pub mod least_squares;
pub mod ode;
pub mod random;
pub(crate) mod roots;
pub(crate) mod rosenbrock;
mod spectrum;
pub mod statistics;
pub mod twofold;
pub(crate) mod unscented;

pub use bits::{BitMatrix, BitRow, BitSet};
pub use dual::{Algebraic, Arithmetic, Jet, Number};
pub use least_seen::{LeastSeen, least_seen};
pub use spectrum::{RANK_THRESHOLD, Spectrum};
