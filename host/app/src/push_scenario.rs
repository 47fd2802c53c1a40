//! A push as a person plans it: a part as drawn in its file, a finger at its outline, and how the finger moves.
//!
//! The finger touches the part from outside at t = 0, while the part lies as drawn, and then moves with an acceleration
//! that may change at given times. Without a speed, part and finger start at rest. With one, the part already goes
//! along with the finger: no slip, and no turning unless one is given.
//!
//! Assumes, in turn: see [`palpate::pushing::dynamics`]. Frames: world, which is the part's at t = 0. Units: SI;
//! messages in mm, as the plan's words on a command line are.
//! Errors: [`PlanError`] for what cannot be.

use nalgebra::{Point2, Rotation2, Vector2};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::pushing::dynamics::{
    ContactLaw, EdgeEnd, FingerPath, FingerShape, FingerTrack, ModelError, PartSide, PushError, PushRun, PushRunError,
    Sample, ShapeError, ShapedModel, ShapedPush, Start, State,
};
use palpate_files::part::{DescribedPart, PartFile};

pub mod slow;

/// A motion planned nearer than this to straight along the edge is along it, rad.
const ALONG_TOLERANCE: f64 = 1e-9;

/// Where a finger is to touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// On an edge of a polygon.
    Edge {
        /// From this vertex to the next, from 0.
        index: usize,
        /// m counter-clockwise from the foot of the perpendicular through the centre of mass; the edge's middle if not
        /// given.
        s: Option<f64>,
    },
    /// On the outline of an ellipse.
    Around {
        /// Eccentric angle, rad: the point (a cos, b sin).
        angle: f64,
    },
}

/// How a finger is to push a part.
#[derive(Clone, Debug, PartialEq)]
pub struct PushPlan {
    /// Where it touches the part.
    pub place: Place,
    /// Outline of the finger, world axes.
    pub shape: FingerShape,
    /// Of the finger at t = 0, m/s.
    pub speed: f64,
    /// Where the finger moves at t = 0: 0 is straight into the part, rad counter-clockwise.
    pub direction: f64,
    /// Of the finger, m/s²; negative brakes.
    pub acceleration: f64,
    /// Where the finger accelerates, like `direction`.
    pub acceleration_direction: f64,
    /// Later accelerations, each from its time on.
    pub then: Vec<Turn>,
    /// Of the part at t = 0, rad/s; not for a start from rest.
    pub omega: f64,
    /// What happens at the contact.
    pub contact: ContactLaw,
}

/// A change of the finger's acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Time since the push began, s, from which on the finger has another acceleration.
    pub t: f64,
    /// From then on, m/s².
    pub acceleration: f64,
    /// Counted like the plan's `direction`, rad.
    pub direction: f64,
}

/// What became of a plan.
#[derive(Clone, Debug)]
pub struct Pushed {
    /// Samples of the simulated motion, its changes of contact and its end.
    pub run: PushRun,
    /// The finger's outline, world axes.
    pub shape: FingerShape,
    /// The finger's motion, world axes.
    pub track: FingerTrack,
    /// Outline of the part where it is touched.
    pub side: PartSide,
}

/// A plan that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The part has fewer edges.
    #[error(transparent)]
    Edge(#[from] ModelError),
    /// A place that is not on this kind of part.
    #[error("the part is {part}: say where to touch it by {remedy}")]
    WrongPlace {
        /// What kind of part it is, in words.
        part: &'static str,
        /// The way to say.
        remedy: &'static str,
    },
    /// Outlines that do not touch at a point.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// A straight finger anywhere but below.
    #[error(
        "a straight finger lies along x and touches the part as drawn from below, where the outline faces −90°, not {:.1}°: touch it at −90°", facing.to_degrees()
    )]
    NotBelow {
        /// Where the outline faces, rad.
        facing: f64,
    },
    /// Neither speed nor acceleration is given.
    #[error("neither speed nor acceleration is given, so nothing would move: give one of them")]
    NoMotion,
    /// The finger leaves, or would only rub along the edge.
    #[error(
        "the finger {what} {:.1}° from straight into the part, which is away from it or along it: it must be within 90°",
        direction.to_degrees()
    )]
    MovesAway {
        /// Whether it moves or accelerates that way.
        what: &'static str,
        /// The direction as planned, rad.
        direction: f64,
    },
    /// A part that turns does not start from rest.
    #[error("the part turns at {:.3} °/s at the start, but the finger's speed is 0: give it a speed, or leave out the turning", omega.to_degrees())]
    TurnsAtRest {
        /// The angular velocity as planned, rad/s.
        omega: f64,
    },
    /// The contact is not on the edge.
    #[error(
        "the contact at s = {:.3} mm is beyond the edge, which runs from {:.3} to {:.3} mm: s is measured from the foot of the perpendicular through the centre of mass",
        s * MM, s_min * MM, s_max * MM
    )]
    BeyondEdge {
        /// Place of the contact on the edge, m.
        s: f64,
        /// The edge's first end, m.
        s_min: f64,
        /// The edge's second end, m.
        s_max: f64,
    },
    /// The finger reaches into the part elsewhere.
    #[error(
        "the finger overlaps the part: it reaches {:.3} mm into edge {edge}; a finger this large cannot touch here, make it smaller or touch elsewhere",
        depth * MM
    )]
    Overlap {
        /// The edge that it reaches into.
        edge: usize,
        /// How far the disk reaches into the part, m.
        depth: f64,
    },
    /// Otherwise impossible from the start.
    #[error(transparent)]
    Push(PushError),
    /// Could not be followed.
    #[error(transparent)]
    Run(#[from] PushRunError),
}

/// Millimetres in a metre.
const MM: f64 = 1e3;

impl From<PushError> for PlanError {
    /// Lengths in the unit of a plan.
    fn from(error: PushError) -> Self {
        match error {
            PushError::BeyondEdge { s, s_min, s_max } => Self::BeyondEdge { s, s_min, s_max },
            PushError::Overlap { edge, depth } => Self::Overlap { edge, depth },
            other => Self::Push(other),
        }
    }
}

/// Where the outline is touched.
struct Spot {
    side: PartSide,
    s: f64,
    /// Part frame, which is the world's at t = 0, m.
    point: Point2<f64>,
    /// Outward unit normal, part axes.
    normal: Vector2<f64>,
}

impl PushPlan {
    /// Simulates the push and samples it at `times`: s, increasing, from 0 on, at least one.
    ///
    /// It ends where the finger reaches a second edge.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn run(&self, file: &PartFile, times: &[f64]) -> Result<Pushed, PlanError> {
        let spot = spot(self.place, &file.part)?;
        self.check_motion()?;
        let (u, path) = self.finger(&spot)?;
        let model = ShapedModel::new(file.part.body(), spot.side, file.mu * GRAVITY_ASSUMED, self.shape, path)?;
        let start = if self.speed == 0.0 { Start::Rest { u, s: spot.s } } else { self.moving(&model, u, spot.s) };
        let turns: Vec<_> =
            self.then.iter().map(|turn| (turn.t, toward(spot.normal, turn.direction, turn.acceleration))).collect();
        let push = ShapedPush::new(model, self.contact, start, EdgeEnd::Stop)?.with_changes(&turns)?;
        let push = match &file.part {
            DescribedPart::Polygon(part) => push.around(part)?.ending_at_second_contact(),
            DescribedPart::Ellipse { .. } => push,
        };
        let run = push.run(times)?;
        Ok(Pushed { run, shape: self.shape, track: push.track().clone(), side: spot.side })
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

    /// Where on its own outline the finger touches the part where it lies, and how it moves.
    fn finger(&self, spot: &Spot) -> Result<(f64, FingerPath), PlanError> {
        // The finger's outward normal is the part's inward one.
        let facing = (-spot.normal.y).atan2(-spot.normal.x);
        let u = match self.shape {
            FingerShape::Disk { .. } => facing,
            FingerShape::Ellipse { semi_axes: [a, b] } => (-b * spot.normal.y).atan2(-a * spot.normal.x),
            FingerShape::Line if spot.normal.x.abs() > ALONG_TOLERANCE || spot.normal.y > 0.0 => {
                return Err(PlanError::NotBelow { facing: spot.normal.y.atan2(spot.normal.x) });
            }
            FingerShape::Line => 0.0,
        };
        let centre = spot.point - self.shape.point(u);
        let path = FingerPath {
            centre0: centre,
            velocity0: toward(spot.normal, self.direction, self.speed),
            acceleration: toward(spot.normal, self.acceleration_direction, self.acceleration),
        };
        Ok((u, path))
    }

    /// A start in motion, without slip.
    fn moving(&self, model: &ShapedModel, u: f64, s: f64) -> Start {
        let state = State { u, s, omega: self.omega, v_t: 0.0 };
        Start::Moving(State { v_t: model.rolling_v_t(0.0, &state), ..state })
    }
}

/// Where the outline of a part as drawn is touched.
fn spot(place: Place, part: &DescribedPart) -> Result<Spot, PlanError> {
    let centre = part.centre_of_mass();
    match (place, part) {
        (Place::Edge { index, s }, DescribedPart::Polygon(part)) => {
            let edge = part.edge(index)?;
            let [from, to] = part.edge_span(index)?;
            let s = s.unwrap_or(0.5 * (from + to));
            let point = centre + edge.normal * edge.height + Vector2::new(-edge.normal.y, edge.normal.x) * s;
            Ok(Spot { side: PartSide::Edge(edge), s, point, normal: edge.normal })
        }
        (Place::Around { angle }, &DescribedPart::Ellipse { semi_axes: [a, b], .. }) => {
            let (sin, cos) = angle.sin_cos();
            let side = PartSide::Ellipse { semi_axes: [a, b], middle: -centre.coords };
            let normal = Vector2::new(b * cos, a * sin).normalize();
            Ok(Spot { side, s: angle, point: Point2::new(a * cos, b * sin), normal })
        }
        (_, DescribedPart::Polygon(_)) => {
            Err(PlanError::WrongPlace { part: "a polygon", remedy: "the number of an edge" })
        }
        (_, DescribedPart::Ellipse { .. }) => {
            Err(PlanError::WrongPlace { part: "an ellipse", remedy: "an angle around it" })
        }
    }
}

/// A vector of this size in a direction counted from straight into a part with this outward normal, world axes.
fn toward(normal: Vector2<f64>, direction: f64, size: f64) -> Vector2<f64> {
    Rotation2::new(direction) * -normal * size
}

impl Pushed {
    /// Where the finger touches the part, world, m.
    #[must_use]
    pub fn contact_point(&self, sample: &Sample) -> Point2<f64> {
        self.track.centre(sample.t) + self.shape.point(sample.state.u)
    }

    /// Force of the finger on the part over its weight, world axes; none where the contact jams or rests.
    #[must_use]
    pub fn force_over_weight(&self, sample: &Sample) -> Option<Vector2<f64>> {
        let (sin, cos) = self.shape.normal_angle(sample.state.u).sin_cos();
        let force = sample.force?;
        Some((Vector2::new(cos, sin) * force.normal + Vector2::new(sin, -cos) * force.tangential) / GRAVITY_ASSUMED)
    }
}

/// A point of the part, world, m.
#[must_use]
pub fn to_world(sample: &Sample, point_part: Point2<f64>) -> Point2<f64> {
    sample.position + Rotation2::new(sample.theta) * point_part.coords
}

#[cfg(test)]
mod tests {
    use palpate::pushing::dynamics::{Edge, EndReason};

    use super::*;

    const BLOCK: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3";
    const EGG: &str = "unit = 'mm'\nellipse = {a = 40, b = 30}\nmu = 0.3";
    const NOTCH: &str =
        "unit = 'mm'\nvertices = [[0, 0], [20, 0], [20, 30], [40, 30], [40, 0], [60, 0], [60, 50], [0, 50]]\nmu = 0.3";

    /// Through the middle of the block's lower edge, straight up, from rest.
    fn straight() -> PushPlan {
        PushPlan {
            place: Place::Edge { index: 0, s: None },
            shape: FingerShape::Disk { radius: 0.015 },
            speed: 0.0,
            direction: 0.0,
            acceleration: 0.1,
            acceleration_direction: 0.0,
            then: Vec::new(),
            omega: 0.0,
            contact: ContactLaw::Coulomb { friction: 0.3 },
        }
    }

    /// Rounding of positions after half a second, m.
    const PLACE_ROUNDING: f64 = 1e-9;

    fn push(plan: &PushPlan) -> Result<Pushed, PlanError> {
        plan.run(&PartFile::parse(BLOCK).unwrap(), &[0.0, 0.25, 0.5])
    }

    #[test]
    fn a_push_through_the_centre_of_mass_carries_the_part_along() {
        for shape in [FingerShape::Disk { radius: 0.015 }, FingerShape::Ellipse { semi_axes: [0.03, 0.01] }] {
            let pushed = push(&PushPlan { shape, ..straight() }).unwrap();
            let last = pushed.run.last;
            assert_eq!(pushed.run.end.reason, EndReason::Time);
            let wanted = Point2::new(0.0, 0.5 * 0.1 * 0.25);
            assert!((last.position - wanted).norm() < PLACE_ROUNDING, "{last:?}");
            // Newton's second law: friction µ of the weight, and what accelerates.
            let force = pushed.force_over_weight(&last).unwrap();
            assert!((force - Vector2::new(0.0, 0.3 + 0.1 / GRAVITY_ASSUMED)).norm() < 1e-9, "{force}");
        }
    }

    #[test]
    fn the_contact_stays_on_finger_and_part() {
        let plan = PushPlan { speed: 0.05, direction: 0.4, omega: 0.2, ..straight() };
        for index in 0..4 {
            let pushed = push(&PushPlan { place: Place::Edge { index, s: Some(0.005) }, ..plan.clone() }).unwrap();
            let PartSide::Edge(Edge { normal, height, .. }) = pushed.side else { panic!("{:?}", pushed.side) };
            let file = PartFile::parse(BLOCK).unwrap();
            for sample in &pushed.run.samples {
                let along = Vector2::new(-normal.y, normal.x);
                let on_part = to_world(sample, file.part.centre_of_mass() + normal * height + along * sample.state.s);
                let gap = (on_part - pushed.contact_point(sample)).norm();
                assert!(gap < PLACE_ROUNDING, "edge {index}, t = {}: {gap:e} m", sample.t);
            }
        }
    }

    /// Pushed, stopped, left alone, pushed on: the part ends where the finger has gone.
    #[test]
    fn a_finger_may_pause() {
        let turn = |t, acceleration| Turn { t, acceleration, direction: 0.0 };
        let then = vec![turn(0.2, -0.1), turn(0.4, 0.0), turn(0.6, 0.2)];
        let plan = PushPlan { then, ..straight() };
        let times: Vec<_> = (0..=16).map(|i| f64::from(i) * 0.05).collect();
        let pushed = plan.run(&PartFile::parse(BLOCK).unwrap(), &times).unwrap();
        assert_eq!((pushed.run.end.reason, pushed.run.samples.len()), (EndReason::Time, 17));
        let resting = &pushed.run.samples[10];
        assert!(resting.force.is_none() && resting.velocity.norm() < PLACE_ROUNDING, "{resting:?}");
        // 2 · 0.1 · 0.2²/2 to the pause, and 0.2 · 0.2²/2 after it.
        assert!((resting.position.y - 0.004).abs() < PLACE_ROUNDING, "{resting:?}");
        assert!((pushed.run.last.position.y - 0.008).abs() < PLACE_ROUNDING, "{:?}", pushed.run.last);
    }

    /// What brakes harder than friction loses the part, and cannot pull it.
    #[test]
    fn a_finger_that_leaves_does_not_pull() {
        let plan = PushPlan { then: vec![Turn { t: 0.2, acceleration: -5.0, direction: 0.0 }], ..straight() };
        let pushed = push(&plan).unwrap();
        assert_eq!(pushed.run.end.reason, EndReason::Break);
        let force = pushed.run.last.force.unwrap();
        assert!((pushed.run.end.t - 0.2).abs() < 1e-12 && force.normal == 0.0 && force.tangential == 0.0, "{force:?}");
    }

    #[test]
    fn an_ellipse_is_pushed_by_any_finger() {
        let file = PartFile::parse(EGG).unwrap();
        let below = Place::Around { angle: -std::f64::consts::FRAC_PI_2 };
        for shape in
            [FingerShape::Line, FingerShape::Disk { radius: 0.0 }, FingerShape::Ellipse { semi_axes: [0.01, 0.02] }]
        {
            let pushed = PushPlan { place: below, shape, ..straight() }.run(&file, &[0.5]).unwrap();
            assert!((pushed.run.last.position - Point2::new(0.0, 0.0125)).norm() < PLACE_ROUNDING, "{shape:?}");
        }
        let aside = PushPlan { place: Place::Around { angle: 0.3 }, shape: FingerShape::Line, ..straight() };
        let message = aside.run(&file, &[0.5]).unwrap_err().to_string();
        assert!(message.contains("touch it at −90°"), "{message}");
    }

    #[test]
    fn what_cannot_be_has_a_message_of_its_own() {
        let bad = [
            (PushPlan { place: Place::Edge { index: 4, s: None }, ..straight() }, "4 is no edge of a polygon with 4"),
            (PushPlan { place: Place::Around { angle: 0.0 }, ..straight() }, "the part is a polygon"),
            (PushPlan { shape: FingerShape::Line, ..straight() }, "touches a straight edge along a line"),
            (PushPlan { acceleration: 0.0, ..straight() }, "nothing would move"),
            (PushPlan { speed: 0.1, direction: 2.0, ..straight() }, "the finger moves 114.6° from straight"),
            (PushPlan { acceleration: -0.1, ..straight() }, "the finger accelerates 180.0° from straight"),
            (PushPlan { omega: 1.0, ..straight() }, "turns at 57.296 °/s"),
            (PushPlan { place: Place::Edge { index: 0, s: Some(0.031) }, ..straight() }, "s = 31.000 mm is beyond"),
            (
                PushPlan { then: vec![Turn { t: 0.0, acceleration: 0.0, direction: 0.0 }], ..straight() },
                "changes at 0.0 s",
            ),
        ];
        for (plan, wanted) in bad {
            let message = push(&plan).unwrap_err().to_string();
            assert!(message.contains(wanted), "wanted {wanted}, got {message}");
        }
    }

    #[test]
    fn a_finger_too_large_for_a_notch_is_refused() {
        let file = PartFile::parse(NOTCH).unwrap();
        let plan = |radius: f64| PushPlan {
            place: Place::Edge { index: 2, s: None },
            shape: FingerShape::Disk { radius },
            ..straight()
        };
        assert!(plan(0.009).run(&file, &[0.1]).is_ok());
        let message = plan(0.012).run(&file, &[0.1]).unwrap_err().to_string();
        assert!(message.contains("the finger overlaps the part: it reaches 2.000 mm into edge"), "{message}");
    }

    /// Sliding sideways in a notch, the finger meets its wall; the distance gone tells when.
    #[test]
    fn a_second_contact_ends_a_push() {
        let file = PartFile::parse(NOTCH).unwrap();
        let plan = PushPlan {
            place: Place::Edge { index: 2, s: None },
            shape: FingerShape::Disk { radius: 0.008 },
            speed: 0.02,
            direction: 0.6,
            acceleration: 0.0,
            contact: ContactLaw::Frictionless,
            ..straight()
        };
        let pushed = plan.run(&file, &[1.0]).unwrap();
        let second = pushed.run.second_contact.unwrap();
        assert_eq!((pushed.run.end.reason, pushed.run.end.t.to_bits()), (EndReason::SecondContact, second.t.to_bits()));
        // The finger's centre is one radius from that edge's line.
        let vertices = file.part.outline();
        let [from, to] = [second.edge, second.edge + 1].map(|i| to_world(&pushed.run.last, vertices[i % 8]));
        let along = (to - from).normalize();
        let distance = along.perp(&(pushed.track.centre(second.t) - from)).abs();
        assert!((distance - 0.008).abs() < PLACE_ROUNDING && matches!(second.edge, 1 | 3), "{second:?} {distance}");
    }
}
