//! A part on a table that a finger touches: the truth behind demonstrations, tables and tests of touching.
//!
//! The finger goes along a line until it is stopped by what it feels. It tells where it touched, with the errors of its
//! robot and the direction of a force with friction; meanwhile it went on, and where it then presses more than friction
//! holds, the part yields: as a slow push over what the beam does not give way.
//!
//! Frames: world. Units: SI. Errors: [`SlowPushError`], of parts that nothing holds.

use nalgebra::{Point2, Rotation2, Vector2};

use super::approach_speed::ApproachLimits;
use super::quasi_static::{SlowPush, SlowPushError, Support};
use crate::geometry::disk_curve::DiskCurve;
use crate::geometry::{Pose, SimplePolygon};
use crate::inscription::{Approach, FingerTouch, Met, TRUSTED_SD};
use crate::math::angle::wrap_angle;
use crate::math::random::Draw;
use crate::search::never;

/// A push begins so far before the part, m: any length beyond rounding.
const LEAD_M: f64 = 1e-3;

/// The force with which the part begins to move is taken after this much of its motion, m.
const ONSET_M: f64 = 1e-7;

/// A way of less than this is none, m.
const WAY_LEAST_M: f64 = 1e-9;

/// So far behind the clamp a contact is looked for, m: farther than any beam bends.
const BACK_M: f64 = 5e-3;

/// A part that yields does so in steps of this, m: a twentieth of a newton on a beam of 27 N/mm.
const YIELD_STEP_M: f64 = 2e-6;

/// A part, what it stands on, and the finger that comes to it.
#[derive(Clone, Debug)]
pub struct TouchedWorld {
    /// The part.
    pub outline: SimplePolygon,
    /// What it stands on.
    pub support: Support,
    /// kg.
    pub mass: f64,
    /// m/s².
    pub gravity: f64,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// Friction between finger and part.
    pub contact_friction: f64,
    /// What finger and robot do once they touch.
    pub limits: ApproachLimits,
    /// What readings are off by.
    pub errors: TouchErrors,
    /// Where the part lies.
    pub pose: Pose,
    /// What presses now, where time goes on step by step.
    pub pressed: Option<Pressed>,
}

/// A contact that lasts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pressed {
    /// The way of the clamp on which it began: the beam bends along it.
    pub direction: Vector2<f64>,
    /// From this force on the part moves, N.
    pub holds: f64,
}

/// What readings of a touch are off by, one standard deviation each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchErrors {
    /// Each coordinate of the robot, m.
    pub position: f64,
    /// The robot's clock against the finger's, s.
    pub clock: f64,
    /// The direction of the force, rad.
    pub angle: f64,
}

impl TouchErrors {
    /// Standard deviation of a touch at this speed (m/s), m.
    #[must_use]
    pub fn sigma(&self, speed: f64) -> f64 {
        self.position.hypot(speed * self.clock)
    }
}

impl TouchedWorld {
    /// Makes an approach at this speed (m/s); the part may be moved by it.
    ///
    /// # Errors
    /// [`SlowPushError`], where the part cannot be pushed slowly.
    pub fn make(&mut self, approach: &Approach, speed: f64, draw: &mut Draw) -> Result<Met, SlowPushError> {
        let Some((travel, normal)) = self.meets(approach) else { return Ok(Met::Nothing) };
        let off = Vector2::new(draw.normal(), draw.normal()) * self.errors.position;
        let late = speed * self.errors.clock * draw.normal();
        let touch = FingerTouch {
            centre: approach.at(travel + late) + off,
            sigma: self.errors.sigma(speed),
            force_angle: wrap_angle(self.force_angle(&approach.direction, &normal) + self.errors.angle * draw.normal()),
            half_width: self.contact_friction.atan() + TRUSTED_SD * self.errors.angle,
        };
        self.yield_to(approach, travel, speed)?;
        Ok(Met::Part(touch))
    }

    /// What the finger feels with its clamp (the disk's centre without force) at a place, moving so; the part is moved by
    /// what presses more than friction holds. For worlds that go on in small steps.
    pub fn press(&mut self, clamp: Point2<f64>, velocity: Vector2<f64>) -> Vector2<f64> {
        let direction = match self.pressed {
            Some(pressed) => pressed.direction,
            None if self.is_clear(clamp) => return Vector2::zeros(),
            None => velocity.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector2::x),
        };
        // From before the contact to the clamp: the rest of that way is what the beam gives.
        let back = Approach { from: clamp - direction * BACK_M, direction, length: BACK_M };
        let Some((travel, normal)) = self.meets(&back) else {
            self.pressed = None;
            return Vector2::zeros();
        };
        let bent = BACK_M - travel;
        let holds = match self.pressed {
            Some(pressed) => pressed.holds,
            None => self.holds(&back, travel),
        };
        self.pressed = Some(Pressed { direction, holds });
        let beyond = bent - holds / self.limits.stiffness;
        let bent = if beyond > YIELD_STEP_M && self.push(&back, travel, beyond).is_ok() { bent - beyond } else { bent };
        let angle = self.force_angle(&direction, &normal);
        Vector2::new(angle.cos(), angle.sin()) * (bent * self.limits.stiffness)
    }

    /// Whether the disk is surely off the part.
    fn is_clear(&self, centre: Point2<f64>) -> bool {
        let curve = DiskCurve::new(&self.outline, self.radius);
        curve.signed_distance(self.pose.isometry().inverse() * centre).0 >= self.radius
    }

    /// The force from which an approach moves the part, N: none where it cannot be told.
    fn holds(&self, approach: &Approach, travel: f64) -> f64 {
        let begun = self.pushed(approach, travel, ONSET_M).ok();
        let contact = begun.and_then(|run| run.samples.get(1)?.contact);
        contact.map_or(f64::INFINITY, |contact| contact.force.norm() * self.mass)
    }

    /// The direction of the force on the finger: friction holds the disk against the part as far as it can, so it is
    /// against the way, within the cone about the normal.
    fn force_angle(&self, direction: &Vector2<f64>, normal: &Vector2<f64>) -> f64 {
        let cone = self.contact_friction.atan();
        let normal_angle = normal.y.atan2(normal.x);
        normal_angle + wrap_angle((-direction.y).atan2(-direction.x) - normal_angle).clamp(-cone, cone)
    }

    /// After which travel an approach meets the part, and its outward normal there.
    #[must_use]
    pub fn meets(&self, approach: &Approach) -> Option<(f64, Vector2<f64>)> {
        let turn = Rotation2::new(-self.pose.theta);
        let centre = Point2::from(turn * (approach.from - self.pose.origin()));
        let curve = DiskCurve::new(&self.outline, self.radius);
        let (travel, place) = curve.first_touch(centre, turn * approach.direction, approach.length, 0.0)?;
        Some((travel, turn.inverse() * curve.touched(place).normal))
    }

    /// Moves the part as far as the finger goes on and the beam does not bend.
    fn yield_to(&mut self, approach: &Approach, travel: f64, speed: f64) -> Result<(), SlowPushError> {
        let way = self.limits.overtravel(speed) - self.holds(approach, travel) / self.limits.stiffness;
        if way > WAY_LEAST_M { self.push(approach, travel, way) } else { Ok(()) }
    }

    /// Moves the part as a finger does that goes on so far after it touched.
    fn push(&mut self, approach: &Approach, travel: f64, way: f64) -> Result<(), SlowPushError> {
        let run = self.pushed(approach, travel, way)?;
        self.pose = run.samples.last().map_or(self.pose, |sample| sample.pose);
        Ok(())
    }

    fn pushed(
        &self,
        approach: &Approach,
        travel: f64,
        way: f64,
    ) -> Result<super::quasi_static::SlowRun, SlowPushError> {
        let push = SlowPush {
            outline: self.outline.clone(),
            support: self.support.clone(),
            centre_of_mass: None,
            gravity: self.gravity,
            height: 0.0,
            radius: self.radius,
            contact_friction: [self.contact_friction; 2],
            path: vec![approach.at(travel - LEAD_M), approach.at(travel + way)],
            pose: self.pose,
            step_max: f64::INFINITY,
        };
        push.run(&never)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn world() -> TouchedWorld {
        let outline = SimplePolygon::new([[0.0, -0.02], [0.06, -0.02], [0.06, 0.02], [0.0, 0.02]].map(Point2::from));
        TouchedWorld {
            outline: outline.unwrap(),
            support: Support::Uniform { friction: 0.3 },
            mass: 0.3,
            gravity: 10.0,
            radius: 0.01,
            contact_friction: 0.25,
            limits: ApproachLimits { stiffness: 27e3, threshold: 0.1, latency: 0.01, deceleration: 2.0 },
            errors: TouchErrors { position: 0.0, clock: 0.0, angle: 0.0 },
            pose: Pose { x: 0.05, y: 0.0, theta: 0.0 },
            pressed: None,
        }
    }

    #[test]
    fn a_clamp_that_goes_on_presses_until_friction_gives_way_and_then_pushes() {
        let mut world = world();
        let velocity = Vector2::new(0.004, 0.0);
        let mut felt = Vector2::zeros();
        for step in 0..1000 {
            let clamp = Point2::new(0.0395 + 1e-6 * f64::from(step), 0.0);
            felt = world.press(clamp, velocity);
            let bent = (clamp.x + 0.01 - 0.05).max(0.0);
            // Through the middle: µ m g = 0.9 N hold it, which bends the beam by 33 µm.
            if bent < 33e-6 {
                let has_stayed = world.pose == Pose { x: 0.05, y: 0.0, theta: 0.0 };
                assert!((felt.x + 27e3 * bent).abs() < 1e-6 && has_stayed, "{felt} at {bent}");
            }
        }
        // The clamp is at 40.499 mm.
        let bent = 0.9 / 27e3;
        assert!((felt.x + 0.9).abs() < 0.06 && felt.y.abs() < 1e-9, "{felt}");
        assert!((world.pose.x - (0.040499 + 0.01 - bent)).abs() < 2.0 * YIELD_STEP_M, "{:?}", world.pose);
        // Away again the force goes, and the part stays.
        let pose = world.pose;
        for step in 0..60 {
            felt = world.press(Point2::new(0.040499 - 1e-6 * f64::from(step), 0.0), -velocity);
        }
        assert!(felt == Vector2::zeros() && world.pressed.is_none() && world.pose == pose, "{felt}");
    }

    #[test]
    fn an_approach_tells_the_disks_centre_and_a_force_within_the_cone() {
        let mut world = world();
        let mut draw = Draw::new(1);
        for angle in [-1.2, -0.5, -0.1, 0.0, 0.2, 0.7, 1.3_f64] {
            let direction = Vector2::new(angle.cos(), angle.sin());
            let approach = Approach { from: Point2::new(0.04, 0.0) - direction * 0.1, direction, length: 0.2 };
            let Met::Part(touch) = world.make(&approach, 1e-4, &mut draw).unwrap() else { panic!("missed") };
            assert!((touch.centre - Point2::new(0.04, 0.0)).norm() < 1e-9, "{touch:?}");
            // The outward normal is −x.
            assert!(
                wrap_angle(touch.force_angle - std::f64::consts::PI).abs() <= touch.half_width + 1e-12,
                "{touch:?}"
            );
        }
        let beside = Approach { from: Point2::new(0.0, 0.031), direction: Vector2::x(), length: 0.2 };
        assert_eq!(world.make(&beside, 1e-4, &mut draw), Ok(Met::Nothing));
    }
}
