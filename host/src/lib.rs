//! Feel where a known part is and how it moves.

pub mod calibration;
pub mod contact;
pub mod demonstration;
pub mod diagnosis;
pub mod experiment;
pub mod finger_motion;
pub mod geometry;
pub mod interrupt;
pub mod link;
pub mod live;
pub mod observing;
pub mod part_file;
pub mod plot;
pub mod push_picture;
pub mod push_plan;
pub mod push_sense;
pub mod pushed_world;
pub mod pushing;
pub mod recording;
pub mod sensing;
pub mod simulated_device;
pub mod solve;
pub mod tables;
