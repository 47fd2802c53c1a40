//! How fast a finger may go to a part that it must not push.
//!
//! From where the disk touches until the robot stands, the clamp goes on by `v τ + v²/2a`: latency and braking. The beam
//! bends by that, and presses with stiffness times it. The part stays as long as its support's friction holds it; beyond
//! that it goes on with the clamp.
//!
//! Implements: by the ellipsoid that stands for the limit surface (`dynamics::support`), a force whose line passes the
//! support's centre at `d` moves the part from `µ m g / √(1 + (d/ρ)²)` on, with `ρ` the mean distance of the support from its
//! centre. The exact surface may lie inside it by `ELLIPSOID_SHARE`.
//! Units: SI. Errors: none.

use nalgebra::Point2;

use super::dynamics::Part;
use super::dynamics::support::{EllipsoidalLimitSurface, SupportFriction};
use crate::geometry::SimplePolygon;

/// The exact limit surface is at least this share of the ellipsoid: held against slow pushes in the tests below.
const ELLIPSOID_SHARE: f64 = 0.75;

/// What a robot and a finger do once the part is touched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ApproachLimits {
    /// Of the finger's tip against its clamp, N/m.
    pub stiffness: f64,
    /// The force from which a touch is felt, N.
    pub threshold: f64,
    /// From the touch being felt to the robot beginning to brake, s.
    pub latency: f64,
    /// With which it brakes, m/s².
    pub deceleration: f64,
}

/// What holds a part in place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Holding {
    /// Friction coefficient of the support times the weight, N.
    pub friction: f64,
    /// Mean distance of the support from its centre, m.
    pub support_radius: f64,
    /// How far from that centre a finger's line of force can pass at most, m.
    pub lever_max: f64,
}

/// A speed and what it does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafeSpeed {
    /// m/s.
    pub speed: f64,
    /// The finger presses with no more than this, N.
    pub force: f64,
    /// The part moves by no more than this where it is touched, m.
    pub motion: f64,
}

impl Holding {
    /// Of a part on this support, both in one frame, with this friction in all (N), touched from anywhere. A line of force passes the
    /// support's centre no farther away than the outline reaches, but for friction at the finger.
    #[must_use]
    pub fn of(outline: &SimplePolygon, support: &SupportFriction, friction: f64) -> Self {
        let surface = EllipsoidalLimitSurface::of(support);
        Self::about(outline, surface.centre_of_pressure, &surface, friction)
    }

    /// Of a part with this friction in all (N), as [`Holding::of`].
    #[must_use]
    pub fn of_part(part: &Part, friction: f64) -> Self {
        let surface = EllipsoidalLimitSurface::of(&part.body().support());
        // The body's frame begins at the centre of mass.
        let centre = part.body().centre_of_mass() + surface.centre_of_pressure.coords;
        Self::about(part.polygon(), centre, &surface, friction)
    }

    fn about(outline: &SimplePolygon, centre: Point2<f64>, surface: &EllipsoidalLimitSurface, friction: f64) -> Self {
        let reach = outline.vertices().iter().map(|vertex| (vertex - centre).norm()).fold(0.0, f64::max);
        Self { friction, support_radius: surface.moment_max / surface.force_max, lever_max: reach }
    }

    /// The least force that moves the part, N.
    #[must_use]
    pub fn least_moving_force(&self) -> f64 {
        ELLIPSOID_SHARE * self.friction / 1.0_f64.hypot(self.lever_max / self.support_radius)
    }
}

impl ApproachLimits {
    /// How far the clamp goes on after the disk touched, m.
    #[must_use]
    pub fn overtravel(&self, speed: f64) -> f64 {
        self.threshold / self.stiffness + speed * self.latency + 0.5 * speed * speed / self.deceleration
    }

    /// What a speed does to a part.
    #[must_use]
    pub fn at_speed(&self, speed: f64, holding: &Holding) -> SafeSpeed {
        let overtravel = self.overtravel(speed);
        let held = holding.least_moving_force() / self.stiffness;
        SafeSpeed { speed, force: self.stiffness * overtravel, motion: (overtravel - held).max(0.0) }
    }

    /// The fastest, up to `speed_max`, with which the part moves by no more than `motion_max` (m); none where already the
    /// force that is felt moves it farther.
    ///
    /// ```
    /// use palpate::pushing::approach_speed::{ApproachLimits, Holding};
    ///
    /// let limits = ApproachLimits { stiffness: 27e3, threshold: 0.1, latency: 0.01, deceleration: 1.0 };
    /// // 0.3 kg on µ = 0.25.
    /// let holding = Holding { friction: 0.74, support_radius: 0.03, lever_max: 0.04 };
    /// let safe = limits.safe_speed(&holding, 1e-5, 0.05).ok_or("no speed is safe")?;
    /// assert!(safe.motion <= 1e-5 && (1e-3..3e-3).contains(&safe.speed)); // m/s
    /// # Ok::<(), &str>(())
    /// ```
    #[must_use]
    pub fn safe_speed(&self, holding: &Holding, motion_max: f64, speed_max: f64) -> Option<SafeSpeed> {
        let speed = self.speed_for(motion_max + holding.least_moving_force() / self.stiffness)?;
        Some(self.at_speed(speed.min(speed_max), holding))
    }

    /// The speed after which the clamp goes on by so much (m); none where already the force that is felt takes it.
    #[must_use]
    pub fn speed_for(&self, overtravel: f64) -> Option<f64> {
        let room = overtravel - self.threshold / self.stiffness;
        // Of v τ + v²/2a = room the positive root, in the form that does not cancel.
        let (latency, deceleration) = (self.latency, self.deceleration);
        let speed = 2.0 * room / (latency + (latency * latency + 2.0 * room.max(0.0) / deceleration).sqrt());
        (room > 0.0).then_some(speed)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::geometry::Pose;
    use crate::inscription::Approach;
    use crate::math::random::Draw;
    use crate::pushing::quasi_static::{SlowPush, Support};
    use crate::pushing::touched_world::{TouchErrors, TouchedWorld};
    use crate::search::never;

    const LIMITS: ApproachLimits = ApproachLimits { stiffness: 27e3, threshold: 0.1, latency: 0.01, deceleration: 2.0 };

    fn world(outline: SimplePolygon) -> TouchedWorld {
        TouchedWorld {
            outline,
            support: Support::Uniform { friction: 0.3 },
            mass: 0.3,
            gravity: 9.81,
            radius: 0.015,
            contact_friction: 0.25,
            limits: LIMITS,
            errors: TouchErrors { position: 0.0, clock: 0.0, angle: 0.0 },
            pose: Pose { x: 0.0, y: 0.0, theta: 0.0 },
            pressed: None,
        }
    }

    fn approach(draw: &mut Draw) -> Approach {
        let angle = draw.uniform(0.0, std::f64::consts::TAU);
        let direction = Vector2::new(angle.cos(), angle.sin());
        let aside = Vector2::new(-direction.y, direction.x) * draw.uniform(-0.04, 0.04);
        Approach { from: Point2::from(aside - 0.2 * direction), direction, length: 0.4 }
    }

    #[test]
    fn no_push_needs_less_than_the_least_moving_force() {
        let mut least_share = f64::INFINITY;
        for case in 0..200 {
            let mut draw = Draw::case(3, case);
            let corners = 3 + draw.index(6);
            let world = world(draw.convex_polygon(corners, 0.04));
            let approach = approach(&mut draw);
            let Some((travel, _)) = world.meets(&approach) else { continue };
            let push = SlowPush {
                outline: world.outline.clone(),
                support: world.support.clone(),
                centre_of_mass: None,
                gravity: world.gravity,
                height: 0.0,
                radius: world.radius,
                contact_friction: [0.25; 2],
                path: vec![approach.at(travel - 1e-3), approach.at(travel + 1e-6)],
                pose: world.pose,
                step_max: f64::INFINITY,
            };
            let Ok(run) = push.run(&never) else { continue };
            let Some(contact) = run.samples.last().and_then(|sample| sample.contact) else { continue };
            let friction = 0.3 * world.mass * world.gravity;
            let holding = Holding::of(&world.outline, &SupportFriction::uniform(&world.outline), friction);
            least_share = least_share.min(contact.force.norm() * world.mass / holding.least_moving_force());
        }
        assert!((1.0..2.0).contains(&least_share), "the least force is {least_share} of the bound");
    }

    #[test]
    fn a_part_is_held_as_its_support_in_its_own_frame() {
        let mut draw = Draw::new(8);
        let outline = draw.star_polygon(7, 0.02, 0.04);
        let direct = Holding::of(&outline, &SupportFriction::uniform(&outline), 1.0);
        let part = Holding::of_part(&Part::uniform(outline), 1.0);
        assert!(
            (direct.lever_max - part.lever_max).abs() < 1e-12
                && (direct.support_radius - part.support_radius).abs() < 1e-9
        );
    }

    #[test]
    fn at_the_safe_speed_no_part_moves_farther_than_was_allowed_and_faster_some_do() {
        let mut moved = [0.0_f64; 2];
        for case in 0..60 {
            let mut draw = Draw::case(4, case);
            let corners = 3 + draw.index(6);
            let world = world(draw.convex_polygon(corners, 0.04));
            let friction = 0.3 * world.mass * world.gravity;
            let holding = Holding::of(&world.outline, &SupportFriction::uniform(&world.outline), friction);
            let safe = LIMITS.safe_speed(&holding, 1e-5, 0.05).unwrap();
            let approach = approach(&mut draw);
            for (moved, speed) in moved.iter_mut().zip([safe.speed, 20.0 * safe.speed]) {
                let mut world = world.clone();
                world.make(&approach, speed, &mut draw).unwrap();
                let by = world.pose.minus(&Pose { x: 0.0, y: 0.0, theta: 0.0 });
                *moved = moved.max(by.x.hypot(by.y));
            }
        }
        // A part that turns about a point beside it moves its frame's origin no farther than where it is touched.
        assert!(moved[0] <= 1e-5 && moved[1] > 1e-4, "{moved:?}");
    }
}
