//! Feel where a known part is and how it moves.

pub mod calibration;
pub mod contact;
pub mod diagnosis;
pub mod experiment;
pub mod geometry;
pub mod interrupt;
pub mod limit_picture;
pub mod link;
pub mod live;
pub mod part_file;
pub mod plot;
pub mod push_picture;
pub mod push_plan;
pub mod pushing;
pub mod recording;
pub mod sensing;
pub mod simulated_device;
pub mod solve;
