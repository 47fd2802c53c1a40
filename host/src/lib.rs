//! Feel where a known part is and how it moves.

pub mod body_file;
pub mod calibration;
pub mod contact;
pub mod diagnosis;
pub mod experiment;
pub mod geometry;
pub mod inscription;
pub mod interrupt;
pub mod link;
pub mod live;
pub mod observability;
pub mod observing;
pub mod part_file;
pub mod plot;
pub mod push_picture;
pub mod push_plan;
pub mod pushing;
pub mod recording;
pub mod roll_picture;
pub mod rolling;
pub mod sensing;
pub mod simulated_device;
pub mod solve;
pub mod statistics;
pub mod tables;
