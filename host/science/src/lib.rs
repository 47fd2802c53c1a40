//! A robot finger with strain gauges touches a part that it knows: where on the part does it touch, where is the part, and
//! how does it move?
//!
//! This is the science of palpate, after Y.-B. Jia, *Geometric and Dynamic Sensing: Observation of Pose and Motion through
//! Contact* (1997): mechanics, observers and geometric sensors. Every function depends on its arguments alone: no files,
//! network, threads, clocks, environment or terminal, and the same build gives the same output for the same input, bit for
//! bit. Long searches ask a [`Stop`] whether to go on (`search`).
//!
//! A part is pushed, and found again from nothing but the angles at which the finger was touched:
//!
//! ```
//! use nalgebra::{Point2, Vector2};
//! use palpate::*;
//!
//! let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.02, 0.03]].map(Point2::from))?); // m
//! let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::new(0.02, 0.0)); // m/s, m/s²
//! let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
//! let mu_g = 0.3 * GRAVITY_ASSUMED; // friction of the table, m/s²
//! // What happens: the finger pushes edge 0, 5 mm beside its middle, for 0.6 s ...
//! let model = PushModel { part: &part, edge: part.edge(0)?, mu_g, finger };
//! let start = Start::Moving(State { u: 1.5, s: 0.005, omega: 0.0, v_t: 0.0 });
//! let times: Vec<_> = (0..61).map(|k| 0.01 * f64::from(k)).collect();
//! let truth = Push::new(model, ContactLaw::Rolling { friction: None }, start, EdgeEnd::Stop)?.run(&times)?;
//! // ... and what the host makes of the contact angles, not knowing edge, place, speed or turn.
//! let values = truth.samples.iter().map(|sample| sample.state.u).collect();
//! let measured = Measured::ContactAngle(Channel { values, sigma: 2e-3 }); // rad
//! let known = Known { part: &part, mu_g, finger, touch: Touch::Rolling { friction: None } };
//! let estimate = known.estimate(&Observation { dt: 0.01, measured, prior: Prior::default() });
//! let found = &estimate.hypotheses[0];
//! assert_eq!((estimate.status(), found.edge), (Status::Unique, 0));
//! assert!((found.pose_end.origin() - truth.last.position).norm() < 1e-4); // m
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Chapters
//!
//! | thesis | module | |
//! |---|---|---|
//! | ch. 2 | [`inscription`] | poses of a part from lines that touch it |
//! | ch. 3 | [`point_sampling`], [`corner`] | poses told apart by points that are covered or free; rest poses in a corner |
//! | §4.2, ch. 5 | [`pushing::dynamics`], [`pushing::observability`] | a part that a finger pushes, and what of it can be felt |
//! | ch. 5, 6, 8 | [`pushing::estimation`] | the observers of a pushed part: one observation in, one set of hypotheses out |
//! | §6.4 | [`finger`] | counts of two bridges to force and contact angle: calibration, tare, contact, diagnosis |
//! | ch. 7 | [`rolling`] | a smooth body on a palm: forward, observability, pose and motion from the contact's path |
//! | | [`geometry`], [`math`], [`gravity`] | polygons with exact predicates and the one [`Pose`]; numbers; g |
//!
//! Which equation, theorem or table of the thesis is where: `docs/NOTATION.md` in the repository.
//!
//! # Frames and units
//!
//! Units are SI and radians, unless a name says otherwise (`_mm`, `_deg`, `_us`). Frames are right-handed, angles
//! counter-clockwise, and a frame is part of a name: `world` (the table), `part` (as the outline was given), `body` (the
//! part's axes, origin at the centre of mass), `finger` (the sensor), `palm`. A force is *on the part* in pushing, *on the
//! finger's disk* in [`finger`]. The contact angle `u` is the polar angle of the contact seen from the disk's centre; `s`
//! is the place of the contact along its edge, from the foot of the perpendicular through the centre of mass.
//!
//! # Answers
//!
//! "No pose", "ambiguous", "not observable" and "no contact" are answers, not errors. Every estimate has an uncertainty.
//! Errors are plain enums whose variants hold the facts: the place, the value, the limit it broke.

#![forbid(unsafe_code)]
#![warn(clippy::print_stdout, clippy::print_stderr)]

pub mod corner;
pub mod finger;
pub mod geometry;
pub mod gravity;
pub mod inscription;
pub mod math;
pub mod point_sampling;
pub mod pushing;
pub mod rolling;
mod search;

pub use finger::calibration::Calibration;
pub use finger::contact::ContactSense;
pub use geometry::{ConvexPolygon, Pose, SimplePolygon};
pub use gravity::GRAVITY_ASSUMED;
pub use inscription::Cone;
pub use point_sampling::Subdivision;
pub use pushing::dynamics::{ContactLaw, EdgeEnd, Finger, Part, Push, PushModel, Start, State};
pub use pushing::estimation::{
    Channel, Estimate, Hypothesis, Known, Measured, Observation, Observer, Prior, RestingPush, Status, Touch, Tracker,
};
pub use pushing::finger_motion::FingerMotion;
pub use pushing::pushed_world::PushedWorld;
pub use rolling::{Roll, RollingBody};
pub use search::{Caller, Searched, Stop, never};

/// The examples of the crate's page are compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
