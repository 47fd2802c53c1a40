//! The kinds of problem, one module each: `inscription`, with `touches` (thesis ch. 2), `point_sampling` and
//! `corner_poses` (ch. 3), `support_friction`, `push`, slow ones in `quasi_static`, `observe_push`, `observe_force` and
//! `initial_pose` (ch. 5, 6), `roll` and `observe_roll` (ch. 7), `observability` (of a push or a roll).

pub mod corner_poses;
pub mod initial_pose;
pub mod inscription;
pub mod observability;
pub mod observe_force;
pub mod observe_push;
pub mod observe_roll;
pub mod point_sampling;
pub mod push;
pub mod pushed;
pub mod quasi_static;
pub mod roll;
pub mod support_friction;
pub mod touches;
