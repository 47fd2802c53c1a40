//! Telling shapes and poses apart by points: which of them are covered, and which are free (thesis ch. 3).
//!
//! In reading order:
//! - `subdivision`: the regions that polygons form, and which polygons contain each;
//! - `circle`: the middle of a region, as far from its boundary as can be;
//! - `discriminate`: the fewest elements that tell sets apart, proven;
//! - `plan`: all of it put together; `decode`: which polygon it is, from what the points read;
//! - [`scenes`]: random polygons as the thesis drew them; [`reductions`]: polygons made of sets, graphs of graphs, as in its proofs.
//!
//! Decisions about segments depend on no tolerance (`geometry::exact`); sets of small numbers are `math::BitSet`.
//!
//! Pure: no files, clocks or threads; whether to go on is asked of the caller. Frames: one for all polygons. Units: m,
//! m².

mod circle;
mod decode;
mod discriminate;
mod plan;
pub mod reductions;
pub mod scenes;
mod subdivision;

pub use circle::{Circle, largest_circle};
pub use decode::{Decoded, PointReading, decode};
pub use discriminate::{Choice, Effort, Proof, Question, Search, SetSystem, fewest, questions};
pub use plan::{Objective, Plan, Request, Scene, contains, plan};
pub use subdivision::{Piece, Region, Subdivision};
