//! What `palpate inscribe` is made of: a person's part and view files (TOML), and the picture of the poses.
//!
//! Pure. Frames: world, and the part's own. Units: SI once read. Errors: [`FileError`] names the key, the value and what to do.

mod files;
mod picture;

pub use files::{FileError, NamedPart, Views};
pub use picture::{InscribePicture, Shown};
