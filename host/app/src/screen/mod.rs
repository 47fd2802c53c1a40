//! What somebody sees who watches a finger full screen: a state, a picture of it, and the terminal that shows it.
//!
//! `state`: everything that is on the screen, made of what comes, without clock or terminal; `view`: a frame of it, a pure
//! function; `terminal`: the thread that draws and listens to keys, and that leaves the terminal as it was whatever ends the
//! program. A slow terminal delays pictures, never samples.

pub(crate) mod state;
pub(crate) mod terminal;
mod view;
#[cfg(test)]
mod view_tests;
