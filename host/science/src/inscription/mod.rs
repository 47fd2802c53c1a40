//! A part's pose from its supporting lines: thesis chapter 2 and appendix A.
//!
//! A sensor that looks at a part from outside sees it between two tangents, a cone. Two cones nearly always leave one
//! pose of a known convex part.
//!
//! In reading order:
//! - [`readings`](Cone): cones, half-planes and what else a sensor says;
//! - `triple`: three lines, and all turns at which a part touches them;
//! - `exact`: all poses for any number of exact lines ([`poses`]), or why there is a continuum of them.
//! - `mixed`: lines mixed with points that the outline passes through ([`poses_through`]);
//! - `noise`: bearings with errors, all modes with their covariances ([`estimate`]);
//! - `touches`: points felt on the outline, with errors, mixed with lines and free disks ([`touched_poses`]);
//! - `next_touch`: which approaches of a finger find a part, and when it is found ([`TouchSearch`]), also which of several
//!   it is ([`PartsSearch`]);
//! - `exploration`: the outline of an unknown part from touches around it ([`Exploration`]);
//! - `passing`: lines and cones of a part that is carried past light barriers and turning beams ([`Passages`]);
//! - `quality`: how well lines hold a pose, and which poses of a symmetric part look the same;
//! - [`likeness`]: turns that lay an outline nearly on itself, which touches confuse;
//! - `planner`: where to take another view;
//! - `boundary`: piecewise smooth outlines by their support function; `outline`: any of the outlines ([`Outline`]).
//!
//! Pure. Frames: world, and the part's own. Units: m, rad. Errors: impossible readings only; "no pose" and "not
//! determined" are answers.

mod boundary;
mod exact;
mod exploration;
pub mod likeness;
mod mixed;
mod next_touch;
mod noise;
mod outline;
mod passing;
mod planner;
mod quality;
mod readings;
mod touches;
mod triple;

pub use crate::geometry::Pose;
pub use boundary::{Boundary, Ellipse, Rounded, boundary_poses};
pub use exact::{Continuum, Inscription, MISS_MAX_RELATIVE, determined, misses, nearest_misses, poses};
pub use exploration::{Exploration, ExploredOutline};
pub use mixed::poses_through;
pub use next_touch::{
    Approach, FingerTouch, Met, NextTouch, PartLeft, PartsSearch, PartsVerdict, PressedFinger, TRUSTED_SD, TouchSearch,
    TouchTask, TouchTolerance, TouchVerdict, outlines_apart, shapes_apart, way_round,
};
pub use noise::{
    FENCE_SD_RELATIVE, GATE, InscriptionEstimate, NoisyReadings, PoseMode, estimate, estimate_until, view,
};
pub use outline::Outline;
pub use passing::{Barrier, Beam, BeamChange, Covered, Passage, Passages, TurningBeam, changes, noisy};
pub use planner::{PlannedView, expected_view, plan_view};
pub use quality::{conditioning, congruent_groups, symmetry_order};
pub use readings::{Bearing, Cone, ConeError, HalfPlane, Side};
pub use touches::{
    FeltNormal, Fence, FreeDisk, Touch, TouchEstimate, TouchReadings, touched_poses, touched_poses_until,
};
