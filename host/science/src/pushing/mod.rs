//! Parts that a finger pushes across a plane (thesis ch. 5 and 6).
//!
//! [`dynamics`] moves them, [`quasi_static`] where that is so slow that nothing swings; [`observability`] says what of
//! their state can be felt, [`estimation`] finds pose and motion from what is felt. [`finger_motion`] is how the finger
//! goes, told, or measured ([`measured_path`], and [`streamed_path`] while it goes), [`wave`] what it weighs on itself,
//! [`tip`] where its disk is on the wrist; [`pushed_world`] plays a push as it would happen, [`touched_world`] a touch;
//! [`approach_speed`] is how fast the finger may go to a part.
//!
//! Frames: world, unless named. Units: SI.

pub mod approach_speed;
pub mod dynamics;
pub mod estimation;
pub mod finger_motion;
pub mod measured_path;
pub mod measured_turn;
pub mod observability;
pub mod pushed_world;
pub mod quasi_static;
pub mod streamed_path;
pub mod tip;
pub mod touched_world;
pub mod wave;
