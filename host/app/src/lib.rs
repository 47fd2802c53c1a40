//! The tool `palpate`: commands, pictures and the thesis's tables over the libraries.

pub mod advice;
mod cli;
pub mod live;
mod messages;
pub mod pictures;
pub mod push_scenario;
pub mod thesis;

pub use cli::run;
