//! Pictures of what commands find, drawn by [`plot`].

pub mod inscription;
pub mod limit_surface;
pub mod observed;
pub mod observer;
pub mod part;
pub mod plot;
pub mod point_sampling;
pub mod push;
pub mod roll;
pub mod run;
pub mod slow_chain;
pub mod slow_push;
pub mod strip;
pub mod touch;
