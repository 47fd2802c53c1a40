//! A push as a person plans it: a part as drawn in its file, a finger at one of its edges, and how the finger moves.
//!
//! The finger touches the edge from outside at t = 0, while the part lies as drawn, and then moves with a constant acceleration.
//! Without a speed, part and finger start at rest. With one, the part already goes along with the finger: no slip, and no
//! turning unless one is given.
//!
//! Assumes, in turn: see [`crate::pushing`]. Frames: world, which is the part's at t = 0. Units: SI.
//! Errors: [`PlanError`] for what cannot be.

use nalgebra::{Point2, Rotation2, Vector2};

use crate::part_file::PartFile;
use crate::pushing::{
    ContactLaw, Edge, EdgeEnd, Finger, ModelError, Part, Push, PushError, PushModel, Run, RunError, Sample, Start,
    State,
};

/// Gravity, m/s².
pub const GRAVITY: f64 = crate::solve::fields::GRAVITY_DEFAULT;

/// A motion planned nearer than this to straight along the edge is along it, rad.
const ALONG_TOLERANCE: f64 = 1e-9;

/// How a finger is to push a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PushPlan {
    /// The edge, from this vertex to the next, from 0.
    pub edge: usize,
    /// Where on the edge, m counter-clockwise from the foot of the perpendicular through the centre of mass; the edge's middle if
    /// not given.
    pub s: Option<f64>,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// Of the finger at t = 0, m/s.
    pub speed: f64,
    /// Where the finger moves at t = 0: 0 is straight into the edge, rad counter-clockwise.
    pub direction: f64,
    /// Of the finger, m/s²; negative brakes.
    pub acceleration: f64,
    /// Where the finger accelerates, like `direction`.
    pub acceleration_direction: f64,
    /// Of the part at t = 0, rad/s; not for a start from rest.
    pub omega: f64,
    /// What happens at the contact.
    pub contact: ContactLaw,
}

/// What became of a plan.
#[derive(Clone, Debug)]
pub struct Pushed {
    /// The motion.
    pub run: Run,
    /// The finger's motion, world axes.
    pub finger: Finger,
    /// The edge that was pushed.
    pub edge: Edge,
}

/// A plan that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The part has fewer edges.
    #[error(transparent)]
    Edge(#[from] ModelError),
    /// Nothing moves.
    #[error("neither speed nor acceleration is given, so nothing would move: give one of them")]
    NoMotion,
    /// The finger leaves, or would only rub along the edge.
    #[error(
        "the finger {what} {:.1}° from straight into the edge, which is away from the part or along it: it must be within 90°",
        direction.to_degrees()
    )]
    MovesAway {
        /// Moves or accelerates.
        what: &'static str,
        /// As planned, rad.
        direction: f64,
    },
    /// A part that turns does not start from rest.
    #[error("the part turns at {:.3} °/s at the start, but the finger's speed is 0: give it a speed, or leave out the turning", omega.to_degrees())]
    TurnsAtRest {
        /// As planned, rad/s.
        omega: f64,
    },
    /// Impossible from the start.
    #[error(transparent)]
    Push(#[from] PushError),
    /// Could not be followed.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl PushPlan {
    /// Simulates the push and samples it at `times`: s, increasing, from 0 on, at least one.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn run(&self, file: &PartFile, times: &[f64]) -> Result<Pushed, PlanError> {
        let edge = file.part.edge(self.edge)?;
        self.check_motion()?;
        let s = self.s.unwrap_or(0.5 * (edge.s_min + edge.s_max));
        let (u, finger) = (contact_angle(&edge), self.finger(&file.part, &edge, s));
        let start = if self.speed == 0.0 { Start::Rest { u, s } } else { self.moving(&edge, u, s) };
        let model = PushModel { part: &file.part, edge, grip: file.mu * GRAVITY, finger };
        let run = Push::new(model, self.contact, start, EdgeEnd::Stop)?.run(times)?;
        Ok(Pushed { run, finger, edge })
    }

    fn check_motion(&self) -> Result<(), PlanError> {
        let away = |direction: f64| direction.cos() <= ALONG_TOLERANCE;
        let (speed, acceleration) = (self.speed, self.acceleration);
        if speed == 0.0 && acceleration == 0.0 {
            return Err(PlanError::NoMotion);
        }
        if speed == 0.0 && self.omega != 0.0 {
            return Err(PlanError::TurnsAtRest { omega: self.omega });
        }
        if speed != 0.0 && away(self.direction) {
            return Err(PlanError::MovesAway { what: "moves", direction: self.direction });
        }
        let backward = if acceleration < 0.0 { std::f64::consts::PI } else { 0.0 };
        let direction = self.acceleration_direction + backward;
        if speed == 0.0 && away(direction) {
            return Err(PlanError::MovesAway { what: "accelerates", direction });
        }
        Ok(())
    }

    /// The finger, touching the part where it lies.
    fn finger(&self, part: &Part, edge: &Edge, s: f64) -> Finger {
        let along = Vector2::new(-edge.normal.y, edge.normal.x);
        let centre = part.centre_of_mass() + edge.normal * (edge.height + self.radius) + along * s;
        let toward = |direction: f64, size: f64| (Rotation2::new(direction) * -edge.normal * size).into();
        Finger {
            radius: self.radius,
            centre0: centre.coords.into(),
            velocity0: toward(self.direction, self.speed),
            acceleration: toward(self.acceleration_direction, self.acceleration),
        }
    }

    /// A start in motion, without slip.
    fn moving(&self, edge: &Edge, u: f64, s: f64) -> Start {
        let v_t = self.speed * self.direction.sin() + edge.height * self.omega;
        Start::Moving(State { u, s, omega: self.omega, v_t })
    }
}

/// Polar angle of an edge's inward normal, for a part that lies as drawn.
fn contact_angle(edge: &Edge) -> f64 {
    (-edge.normal.y).atan2(-edge.normal.x)
}

impl Pushed {
    /// Where the finger touches the part, world, m.
    #[must_use]
    pub fn contact_point(&self, sample: &Sample) -> Point2<f64> {
        let u = sample.state.u;
        self.finger.centre(sample.t) + Vector2::new(u.cos(), u.sin()) * self.finger.radius
    }

    /// Force of the finger on the part over its weight, world axes; none where the contact jams.
    #[must_use]
    pub fn force_over_weight(&self, sample: &Sample) -> Option<Vector2<f64>> {
        let (sin, cos) = sample.state.u.sin_cos();
        let force = sample.force?;
        Some((Vector2::new(cos, sin) * force.normal + Vector2::new(sin, -cos) * force.tangential) / GRAVITY)
    }
}

/// A point of the part, world, m.
#[must_use]
pub fn to_world(sample: &Sample, point_part: Point2<f64>) -> Point2<f64> {
    sample.position + Rotation2::new(sample.theta) * point_part.coords
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pushing::EndReason;

    const BLOCK: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3";

    /// Through the middle of the block's lower edge, straight up, from rest.
    const STRAIGHT: PushPlan = PushPlan {
        edge: 0,
        s: None,
        radius: 0.015,
        speed: 0.0,
        direction: 0.0,
        acceleration: 0.1,
        acceleration_direction: 0.0,
        omega: 0.0,
        contact: ContactLaw::Coulomb { friction: 0.3 },
    };

    /// Rounding of positions after half a second, m.
    const PLACE_ROUNDING: f64 = 1e-9;

    fn push(plan: PushPlan) -> Result<Pushed, PlanError> {
        plan.run(&PartFile::parse(BLOCK).unwrap(), &[0.0, 0.25, 0.5])
    }

    #[test]
    fn a_push_through_the_centre_of_mass_carries_the_part_along() {
        let pushed = push(STRAIGHT).unwrap();
        let last = pushed.run.last;
        assert_eq!(pushed.run.end.reason, EndReason::Time);
        let wanted = Point2::new(0.0, 0.5 * 0.1 * 0.25);
        assert!((last.position - wanted).norm() < PLACE_ROUNDING, "{last:?}");
        // Newton's second law: friction µ of the weight, and what accelerates.
        let force = pushed.force_over_weight(&last).unwrap();
        assert!((force - Vector2::new(0.0, 0.3 + 0.1 / GRAVITY)).norm() < 1e-9, "{force}");
    }

    #[test]
    fn the_contact_stays_on_finger_and_part() {
        let plan = PushPlan { s: Some(0.02), speed: 0.05, direction: 0.4, omega: 0.2, ..STRAIGHT };
        for edge in 0..4 {
            let pushed = push(PushPlan { edge, s: Some(0.005), ..plan }).unwrap();
            let file = PartFile::parse(BLOCK).unwrap();
            for sample in &pushed.run.samples {
                let along = Vector2::new(-pushed.edge.normal.y, pushed.edge.normal.x);
                let normal = pushed.edge.normal * pushed.edge.height;
                let on_part = to_world(sample, file.part.centre_of_mass() + normal + along * sample.state.s);
                let gap = (on_part - pushed.contact_point(sample)).norm();
                assert!(gap < PLACE_ROUNDING, "edge {edge}, t = {}: {gap:e} m", sample.t);
            }
        }
    }

    #[test]
    fn what_cannot_be_has_a_message_of_its_own() {
        let bad = [
            (PushPlan { edge: 4, ..STRAIGHT }, "4 is no edge of a polygon with 4"),
            (PushPlan { acceleration: 0.0, ..STRAIGHT }, "nothing would move"),
            (PushPlan { speed: 0.1, direction: 2.0, ..STRAIGHT }, "the finger moves 114.6° from straight"),
            (PushPlan { acceleration: -0.1, ..STRAIGHT }, "the finger accelerates 180.0° from straight"),
            (PushPlan { omega: 1.0, ..STRAIGHT }, "turns at 57.296 °/s"),
            (PushPlan { s: Some(0.031), ..STRAIGHT }, "beyond the edge"),
        ];
        for (plan, wanted) in bad {
            let message = push(plan).unwrap_err().to_string();
            assert!(message.contains(wanted), "wanted {wanted}, got {message}");
        }
    }

    #[test]
    fn a_finger_too_large_for_a_notch_is_refused() {
        let notch = "unit = 'mm'\nvertices = [[0, 0], [20, 0], [20, 30], [40, 30], [40, 0], [60, 0], [60, 50], [0, 50]]\nmu = 0.3";
        let file = PartFile::parse(notch).unwrap();
        let plan = |radius: f64| PushPlan { edge: 2, radius, ..STRAIGHT };
        assert!(plan(0.009).run(&file, &[0.1]).is_ok());
        let message = plan(0.012).run(&file, &[0.1]).unwrap_err().to_string();
        assert!(message.contains("the finger overlaps the part"), "{message}");
    }
}
