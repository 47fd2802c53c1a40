//! A part on its feet or its face before a finger, and what a push does to it.
//!
//! Poses are of the centre of mass: `theta` turns the part's axes.
//!
//! Frames: world; `body`: the part's axes, origin at the centre of mass. Units: SI.

use nalgebra::{Point2, Rotation2, Vector2};

use super::constants::{SlowConstants, Spread};
use super::felt::FeltPush;
use crate::geometry::{Pose, SimplePolygon};
use crate::gravity::GRAVITY_ASSUMED;
use crate::math::random::Draw;
use crate::pushing::quasi_static::coarse::{PushedOutline, Resisting, StepForce, StraightWay};
use crate::pushing::quasi_static::{Foot, Support};

/// Radius of the ring that a foot stands on, m. From none to 5 mm the end poses of the board do not tell.
const FOOT_RING_M: f64 = 1e-3;

/// A face is divided into triangles, this many to each edge of each triangle that its vertices make with its centroid.
const CELLS_PER_EDGE: usize = 3;

/// Distance from the centre of mass at which pressures and contrasts are stated, m.
const STATED_AT_M: f64 = 0.05;

/// What the part stands on.
#[derive(Clone, Debug, PartialEq)]
pub enum Standing {
    /// Feet: part frame, m; at least three, not on a line.
    Feet(Vec<Point2<f64>>),
    /// The whole face.
    Face,
}

/// One push's own numbers, as departures from those of the set-up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PushParameters {
    /// Logarithm of the plane's friction.
    pub friction_log: f64,
    /// Logarithms of the friction of feet against each other (of three: the second's and the third's lead along two
    /// axes at right angles), or of a face's pressure per 50 mm along the body's axes.
    pub contrasts: [f64; 2],
    /// Logarithm of the finger's friction.
    pub contact_log: f64,
    /// Turn of the force's frame, rad.
    pub frame: f64,
}

impl PushParameters {
    /// Drawn about these.
    pub(super) fn drawn(&self, spread: &Spread, draw: &mut Draw) -> Self {
        Self {
            friction_log: self.friction_log + spread.friction_log * draw.normal(),
            contrasts: self.contrasts.map(|contrast| contrast + spread.contrast * draw.normal()),
            contact_log: self.contact_log + spread.contact_log * draw.normal(),
            frame: self.frame + spread.frame * draw.normal(),
        }
    }
}

/// A point that bears weight: body frame, share, and how its friction answers to the contrasts.
#[derive(Clone, Copy, Debug)]
struct Bearing {
    at: Point2<f64>,
    share: f64,
    answers: Vector2<f64>,
}

/// A part, what it stands on, and the set-up's constants.
#[derive(Clone, Debug)]
pub struct SlowScene {
    outline: PushedOutline,
    bearings: Vec<Bearing>,
    ring: f64,
    weight: f64,
    constants: SlowConstants,
}

/// What a simulated push came to.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedPush {
    /// Of the centre of mass, at the end.
    pub pose: Pose,
    /// Travel at which the finger meets the outline, m.
    pub touched: Option<f64>,
    /// On the part in world axes at the felt forces' places, N; none where the finger does not touch.
    pub forces: Vec<Option<Vector2<f64>>>,
    /// Whether a motion was found throughout.
    pub is_whole: bool,
}

impl SlowScene {
    /// A part of this outline, centre of mass (both part frame, m) and mass (kg).
    #[must_use]
    pub fn new(
        outline: &SimplePolygon,
        centre_of_mass: Point2<f64>,
        mass: f64,
        standing: &Standing,
        constants: SlowConstants,
    ) -> Option<Self> {
        let body: Vec<_> = outline.vertices().iter().map(|p| Point2::from(p - centre_of_mass)).collect();
        let (bearings, ring) = match standing {
            Standing::Feet(feet) => (feet_bearings(feet, centre_of_mass), FOOT_RING_M),
            Standing::Face => face_bearings(&body, constants.pressure_rise),
        };
        let outline = PushedOutline::new(SimplePolygon::new(body).ok()?, constants.radius);
        let scene = Self { outline, bearings, ring, weight: mass * GRAVITY_ASSUMED, constants };
        scene.resisting(&PushParameters::default())?;
        Some(scene)
    }

    /// The set-up's constants.
    #[must_use]
    pub fn constants(&self) -> &SlowConstants {
        &self.constants
    }

    /// The same with the tip elsewhere by so much along the tool's axes, m.
    #[must_use]
    pub fn with_tip_moved(&self, ahead: f64, left: f64) -> Self {
        let mut moved = self.clone();
        moved.constants.tip_ahead += ahead;
        moved.constants.tip_left += left;
        moved
    }

    /// The same with a friction of the finger of its own on each edge of the outline, in that of the constants; edges
    /// beyond the last have 1.
    #[must_use]
    pub fn with_edge_frictions(&self, factors: &[f64]) -> Self {
        Self { outline: self.outline.clone().with_edge_frictions(factors), ..self.clone() }
    }

    /// The same with the ellipsoidal limit surface that has these feet's or this face's largest force and moment, which
    /// no load transfer reaches: a ring about the centre of mass whose radius is the mean distance of the load.
    #[must_use]
    pub fn ellipsoidal(&self) -> Self {
        let ring = self.bearings.iter().map(|bearing| bearing.share * bearing.at.coords.norm()).sum();
        let bearings = vec![Bearing { at: Point2::origin(), share: 1.0, answers: Vector2::zeros() }];
        let constants = SlowConstants { height: 0.0, ..self.constants };
        Self { bearings, ring, constants, ..self.clone() }
    }

    fn resisting(&self, parameters: &PushParameters) -> Option<Resisting> {
        let [first, second] = parameters.contrasts;
        let friction = self.constants.friction * parameters.friction_log.exp();
        let feet = self.bearings.iter().map(|bearing| Foot {
            at: bearing.at,
            share: bearing.share,
            friction: friction * (bearing.answers.x * first + bearing.answers.y * second).exp(),
        });
        let support = Support::Feet { feet: feet.collect(), ring_radius: self.ring };
        let sliding = self.constants.contact_friction * parameters.contact_log.exp();
        let contact = [sliding, sliding * self.constants.stick_ratio];
        self.outline.resisting(&support, self.constants.height, Point2::origin(), contact)
    }

    /// The way of the disk's centre.
    pub(super) fn way(&self, felt: &FeltPush) -> StraightWay {
        let offset = Vector2::new(self.constants.tip_ahead, self.constants.tip_left);
        StraightWay { origin: felt.origin + Rotation2::new(felt.tool_yaw) * offset, direction: felt.direction }
    }

    /// The point of the outline (body frame) at a share of its length, and the outward normal there.
    pub(super) fn on_outline(&self, share: f64) -> (Point2<f64>, Vector2<f64>) {
        self.outline.at_share(share)
    }

    /// The travel at which the finger meets the outline of a part that lies at `pose`.
    #[must_use]
    pub fn first_touch(&self, felt: &FeltPush, pose: &Pose) -> Option<f64> {
        self.outline.first_touch(pose, &self.way(felt))
    }

    /// The push, of a part that lies at `pose`, in steps of `stride` (m).
    #[must_use]
    pub fn simulate(&self, felt: &FeltPush, pose: &Pose, parameters: &PushParameters, stride: f64) -> SimulatedPush {
        let Some(resisting) = self.resisting(parameters) else {
            return SimulatedPush {
                pose: *pose,
                touched: None,
                forces: vec![None; felt.forces.len()],
                is_whole: false,
            };
        };
        let mut forces = vec![None; felt.forces.len()];
        let mut next = 0;
        let mut before: Option<StepForce> = None;
        let turn = Rotation2::new(parameters.frame);
        let late = self.constants.felt_late;
        let tell = |step: StepForce| {
            // Each felt force is that of the step at whose end or before it was felt.
            while let Some(place) = felt.forces.get(next).filter(|place| place.travel - late < step.travel) {
                let held = before.map(|before| {
                    let share = (place.travel - late - before.travel) / (step.travel - before.travel);
                    before.force.lerp(&step.force, share.clamp(0.0, 1.0))
                });
                forces[next] = held.map(|force| turn * force * self.weight);
                next += 1;
            }
            before = Some(step);
        };
        let end = felt.end + self.constants.beyond_log;
        let run = self.outline.push(&resisting, *pose, &self.way(felt), end, stride, tell);
        SimulatedPush { pose: run.pose, touched: run.touched, forces, is_whole: run.is_whole }
    }
}

/// Feet with shares by which their load is centred under the centre of mass where three are, evenly otherwise: how it
/// spreads then is found with the load.
fn feet_bearings(feet: &[Point2<f64>], centre_of_mass: Point2<f64>) -> Vec<Bearing> {
    let count = feet.len() as f64;
    let bearing = |(number, foot): (usize, &Point2<f64>)| {
        // Three feet lead each other along two axes at right angles: a sum of three directions at 120 degrees is none.
        let angle = std::f64::consts::TAU * number as f64 / count;
        let answers = Vector2::new(angle.cos(), angle.sin()) * std::f64::consts::SQRT_2;
        Bearing { at: Point2::from(foot - centre_of_mass), share: 1.0 / count, answers }
    };
    feet.iter().enumerate().map(bearing).collect()
}

/// A face in triangles of like size, pressed harder the farther out; and the ring that stands for a triangle's own
/// resistance to turning.
fn face_bearings(body: &[Point2<f64>], rise: f64) -> (Vec<Bearing>, f64) {
    let n = CELLS_PER_EDGE;
    let centre = SimplePolygon::new(body.to_vec()).map_or_else(|_| Point2::origin(), |polygon| polygon.centroid());
    let mut cells = Vec::new();
    let mut area_sum = 0.0;
    for (i, &a) in body.iter().enumerate() {
        let b = body[(i + 1) % body.len()];
        let (u, v) = ((a - centre) / n as f64, (b - centre) / n as f64);
        let area = 0.5 * u.perp(&v);
        let mut cell = |middle: Vector2<f64>| {
            let at = centre + middle;
            let pressure = (rise * (at.coords.norm() / STATED_AT_M).powi(2)).exp();
            area_sum += area;
            cells.push(Bearing { at, share: area * pressure, answers: at.coords / STATED_AT_M });
        };
        for row in 0..n {
            for column in 0..n - row {
                let corner = u * row as f64 + v * column as f64;
                cell(corner + (u + v) / 3.0);
                if row + column + 1 < n {
                    cell(corner + (u + v) * (2.0 / 3.0));
                }
            }
        }
    }
    let sum: f64 = cells.iter().map(|cell| cell.share).sum();
    cells.iter_mut().for_each(|cell| cell.share /= sum);
    // A disk of the cell's area resists turning as a ring of two thirds of its radius.
    let ring = 2.0 / 3.0 * (area_sum / cells.len() as f64 / std::f64::consts::PI).sqrt();
    (cells, ring)
}
