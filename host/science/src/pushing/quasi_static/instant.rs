//! How a part moves at one instant, and with what force it is pushed.
//!
//! With the contact at `c`, outward normal `n` and `t = ẑ × n`, the part's point at the contact moves at `u + σ t`: `u`
//! is the finger's velocity and `σ` the slip of the part along the finger, none while it sticks. Friction has the moment
//! of a force at the contact, `M = c × F`: this gives the rate of turning, and while it slides `F ∥ −n − sign(σ) µ_c t`
//! gives the slip. A sliding part moves the same way however the finger goes, only as fast as that goes into it: its
//! motion is found for a contact that moves by 1 into the part, which is as good where the finger is about to leave.
//! Newton's method from a motion nearby does it in a few steps; where that fails or nothing is nearby,
//! the zeros are enclosed first: without height the moment rises with the rate of turning, and the force's direction
//! turns with the contact's velocity, for the dissipation is convex. With height both are followed from there.
//!
//! Where a foot may rest, Newton's steps are taken in a variable in which friction is smooth: with `g` the velocity of
//! the slowest foot per rate of turning, `z = g/√(g² + e²) + g/ρ`.
//!
//! Frames: part axes, origin at the supports' centre. Units: SI; forces per weight. The finger's velocity is 1.
//! Errors: none; where no motion fits, none is found, and the part tips.

use nalgebra::{Vector2, Vector3};

use super::support::{EVEN, Ground, Loaded};

/// Newton's steps from a motion nearby: three or four are usual.
const NEWTON_STEPS: usize = 16;

/// The same in the variable in which a foot rests smoothly: rounding of the part's motion leaves 1e-8 of it.
const LAST_SMOOTH_STEP: f64 = 1e-6;

/// A foot so near to the centre of rotation, in sizes of the part, may rest.
const PIVOT: f64 = 0.5;

/// A misfit below this share of the largest is rounding, however long the step.
const MISFIT_LEAST: f64 = 1e-15;

/// A misfit of an enclosed motion above this is no zero but a pole: with height, friction may grow beyond all bounds.
const MISFIT_MAX: f64 = 1e-6;

/// A foot that would have to be held down by more than this share is not on the way to lifting: the motion is another.
const LOAD_BELIEVED: f64 = -0.1;

/// Doublings that enclose a zero, beginning with the finger's speed, or a turn of it over the part's size.
const DOUBLINGS: usize = 60;

/// Looks at an enclosed zero: halving alone needs some 60, and every third look halves.
const ENCLOSED_LOOKS: usize = 200;

/// Rings, in sizes of the part, with which a motion is first looked for.
const RING_EASY: f64 = 0.02;

/// The shortest part of the way to the full height, or to the right ring, that is tried.
const EASING_LEAST: f64 = 1e-4;

/// Where the finger touches: part axes, from the supports' centre.
#[derive(Clone, Copy, Debug)]
pub(super) struct Touching {
    /// m.
    pub(super) at: Vector2<f64>,
    /// Out of the part, towards the finger.
    pub(super) normal: Vector2<f64>,
}

impl Touching {
    /// `ẑ × n`.
    pub(super) fn tangent(&self) -> Vector2<f64> {
        Vector2::new(-self.normal.y, self.normal.x)
    }

    /// The twist by which the contact stays and the part turns at 1 rad/s; also what takes friction to its moment about
    /// the contact.
    fn turning(&self) -> Vector3<f64> {
        Vector3::new(self.at.y, -self.at.x, 1.0)
    }
}

/// A motion and its force.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instant {
    /// Rate of turning for a finger's speed of 1, rad/m.
    pub(super) omega: f64,
    /// Velocity of the part's point along `t` minus that of the finger.
    pub(super) slip: f64,
    /// On the part, per weight.
    pub(super) force: Vector2<f64>,
    /// The load `λ` of the supports.
    pub(super) load: Vector3<f64>,
    /// Of a contact that moves by 1 into the part: the rate of turning, and the velocity of the part along `t`.
    per_into: [f64; 2],
    /// A foot about which a sliding part all but turns.
    pivot: Option<Pivot>,
}

/// A foot near the centre of rotation.
#[derive(Clone, Copy, Debug)]
struct Pivot {
    foot: Vector2<f64>,
    /// Its velocity per rate of turning, m.
    per_turn: Vector2<f64>,
}

impl Pivot {
    /// Rate of turning and velocity along `t` of a contact that moves by 1 into the part.
    fn motion(&self, touching: &Touching) -> [f64; 2] {
        let arm = touching.at - self.foot;
        let contact = self.per_turn + Vector2::new(-arm.y, arm.x);
        let omega = -1.0 / contact.dot(&touching.normal);
        [omega, omega * contact.dot(&touching.tangent())]
    }
}

/// The motion to begin with.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near {
    omega: f64,
    per_into: [f64; 2],
    load: Vector3<f64>,
    pivot: Option<Pivot>,
}

/// Of an ellipsoid that resists like a support of this size: its largest moment over its largest force, in sizes.
const ROUGH_RADIUS: f64 = 0.4;

impl From<&Instant> for Near {
    fn from(instant: &Instant) -> Self {
        Self { omega: instant.omega, per_into: instant.per_into, load: instant.load, pivot: instant.pivot }
    }
}

/// The unknowns: rate of turning, and velocity of the part's point along `t` beyond that which is known.
#[derive(Clone, Copy, Debug)]
struct Trial {
    omega: f64,
    along: f64,
    load: Vector3<f64>,
}

/// What is asked of a motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub(super) touching: Touching,
    /// Of the finger, length 1.
    pub(super) velocity: Vector2<f64>,
    /// Direction of the force if it slides; none if it sticks.
    pub(super) force: Option<Vector2<f64>>,
}

impl Asked {
    /// What is known of the velocity of the part's point at the contact: all while it sticks, while it slides that it
    /// goes into the part, by 1.
    fn known(&self) -> Vector2<f64> {
        if self.force.is_some() { -self.touching.normal } else { self.velocity }
    }

    fn twist(&self, omega: f64, along: f64) -> Vector3<f64> {
        let at_contact = self.known() + along * self.touching.tangent();
        Vector3::new(at_contact.x, at_contact.y, 0.0) + omega * self.touching.turning()
    }

    fn begin(&self, near: &Near) -> Trial {
        match self.force {
            None => Trial { omega: near.omega, along: 0.0, load: near.load },
            Some(_) => {
                // A foot at rest stays so: from the same rates of turning it would move.
                let [omega, along] = near.pivot.map_or(near.per_into, |pivot| pivot.motion(&self.touching));
                Trial { omega, along, load: near.load }
            }
        }
    }

    /// Roughly how a part of this size moves, by the ellipsoid that its friction resembles; none if that is pulled.
    fn rough(&self, size: f64, load: Vector3<f64>) -> Option<Trial> {
        let (at, tangent) = (self.touching.at, self.touching.tangent());
        let square = (ROUGH_RADIUS * size).powi(2);
        let Some(direction) = self.force else {
            let omega = at.perp(&self.velocity) / (at.norm_squared() + square);
            return Some(Trial { omega, along: 0.0, load });
        };
        // Twists are as wrenches, but for the radius.
        let omega = at.perp(&direction) / square;
        let at_contact = direction + omega * Vector2::new(-at.y, at.x);
        let into = -at_contact.dot(&self.touching.normal);
        (into > 0.0).then(|| Trial { omega: omega / into, along: at_contact.dot(&tangent) / into, load })
    }

    /// Whether a sliding part is pushed, not pulled: the other force on the same line.
    fn is_pushed(&self, instant: &Instant) -> bool {
        self.force.is_none_or(|direction| direction.dot(&instant.force) > 0.0)
    }

    fn instant(&self, trial: Trial, loaded: &Loaded, last: Vector3<f64>) -> Instant {
        // Friction after the last, tiny step.
        let wrench = loaded.wrench + loaded.gradient * last;
        let (into, passing) = (-self.velocity.dot(&self.touching.normal), self.velocity.dot(&self.touching.tangent()));
        let Trial { omega, along, .. } = trial;
        let (force, load) = (Vector2::new(wrench.x, wrench.y), loaded.load);
        match self.force {
            None => Instant { omega, slip: 0.0, force, load, per_into: [omega / into, passing / into], pivot: None },
            Some(_) => Instant {
                omega: into * omega,
                slip: into * along - passing,
                force,
                load,
                per_into: [omega, along],
                pivot: None,
            },
        }
    }
}

impl Ground {
    /// The motion that is asked for: looked for from the one nearby, then by enclosing it.
    pub(super) fn motion(&self, asked: &Asked, near: Option<&Near>) -> Option<Instant> {
        let holds = |instant: &Instant| self.load_least(&instant.load) > LOAD_BELIEVED;
        let newton = near.and_then(|near| self.newton(asked, asked.begin(near))).filter(holds);
        newton.or_else(|| self.enclosed(asked, near.map_or(EVEN, |near| near.load)).filter(holds))
    }

    /// The motion under a load that is given, of a ground that holds its load: from the one nearby, from a rough one, or
    /// by enclosing it.
    pub(super) fn motion_under(&self, asked: &Asked, near: Option<&Near>, load: Vector3<f64>) -> Option<Instant> {
        let newton = near.and_then(|near| self.newton(asked, Trial { load, ..asked.begin(near) }));
        let newton = newton.or_else(|| self.newton(asked, asked.rough(self.size, load)?));
        newton.or_else(|| self.enclosed(asked, load))
    }

    /// The same, followed from an easier motion if nothing else helps.
    pub(super) fn motion_anew(&self, asked: &Asked, near: Option<&Near>) -> Option<Instant> {
        self.motion(asked, near).or_else(|| self.eased_into(asked))
    }

    fn newton(&self, asked: &Asked, begin: Trial) -> Option<Instant> {
        let mut trial = begin;
        let (turning, tangent) = (asked.touching.turning(), asked.touching.tangent());
        let along = Vector3::new(tangent.x, tangent.y, 0.0);
        let scale = self.friction * self.size;
        let mut misfit_before = f64::INFINITY;
        for _ in 0..NEWTON_STEPS {
            let twist = asked.twist(trial.omega, trial.along);
            let loaded = self.loaded(&twist, &trial.load)?;
            let moment = turning.dot(&loaded.wrench);
            let by_omega = loaded.gradient * turning;
            let (d_omega, d_along, misfit) = match asked.force {
                None => (-moment / turning.dot(&by_omega), 0.0, moment.abs() / scale),
                Some(direction) => {
                    let across = Vector3::new(-direction.y, direction.x, 0.0);
                    let off = across.dot(&loaded.wrench);
                    let by_along = loaded.gradient * along;
                    let (a, b) = (turning.dot(&by_omega), turning.dot(&by_along));
                    let (c, d) = (across.dot(&by_omega), across.dot(&by_along));
                    let determinant = a * d - b * c;
                    let d_omega = (b * off - d * moment) / determinant;
                    let d_along = (c * moment - a * off) / determinant;
                    (d_omega, d_along, (moment.abs() / scale).max(off.abs() / self.friction))
                }
            };
            // Written so that NaN fails.
            if !(d_omega.abs() < f64::MAX && d_along.abs() < f64::MAX && misfit < 10.0 * misfit_before) {
                return None;
            }
            misfit_before = misfit;
            let length = d_omega.abs() * self.size + d_along.abs();
            let step = turning * d_omega + along * d_along;
            trial.load = loaded.load;
            if let Some((pivot, moved)) = self.smooth_step(asked, trial.omega, &twist, &step) {
                [trial.omega, trial.along] = pivot.motion(&asked.touching);
                if moved <= LAST_SMOOTH_STEP {
                    let instant = Instant { pivot: Some(pivot), ..asked.instant(trial, &loaded, step) };
                    return asked.is_pushed(&instant).then_some(instant);
                }
                continue;
            }
            if length <= self.last_step * loaded.slowest.min(1.0) || misfit <= MISFIT_LEAST {
                trial.omega += d_omega;
                trial.along += d_along;
                let instant = asked.instant(trial, &loaded, step);
                return asked.is_pushed(&instant).then_some(instant);
            }
            trial.omega += d_omega;
            trial.along += d_along;
        }
        None
    }

    /// How the foot nearest to the centre of rotation moves after a step in the variable in which it comes to rest
    /// smoothly, and how far that step goes; none where no foot may rest.
    fn smooth_step(
        &self,
        asked: &Asked,
        omega: f64,
        twist: &Vector3<f64>,
        step: &Vector3<f64>,
    ) -> Option<(Pivot, f64)> {
        asked.force.filter(|_| self.feet_may_rest())?;
        let (foot, ring) = self.slowest_foot(twist)?;
        let at_foot = |twist: &Vector3<f64>| Vector2::new(twist.x - twist.z * foot.y, twist.y + twist.z * foot.x);
        let per_turn = at_foot(twist) / omega;
        // Written so that NaN fails.
        let is_near = per_turn.norm() < PIVOT * self.size;
        if !is_near {
            return None;
        }
        let per_turn_step = (at_foot(step) - per_turn * step.z) / omega;
        let root = per_turn.norm().hypot(ring);
        let in_ring = per_turn / root;
        let place = in_ring + per_turn / self.size;
        let change = (per_turn_step - in_ring * in_ring.dot(&per_turn_step)) / root + per_turn_step / self.size;
        let pivot = Pivot { foot, per_turn: from_smooth(place + change, ring, self.size) };
        let goes_on = pivot.motion(&asked.touching)[0] * omega > 0.0;
        goes_on.then(|| (pivot, change.norm()))
    }

    /// The motion by enclosing it, with loads followed from `load`.
    fn enclosed(&self, asked: &Asked, load: Vector3<f64>) -> Option<Instant> {
        let Some(direction) = asked.force else {
            let (trial, loaded) = self.enclosed_turning(asked, 0.0, 0.0, load)?;
            // Of a foot that all but rests the force is finer than the rate of turning can tell.
            let turning = asked.touching.turning();
            let rest = -turning.dot(&loaded.wrench) / turning.dot(&(loaded.gradient * turning));
            let last = if rest.is_finite() { turning * rest } else { Vector3::zeros() };
            let misfit = turning.dot(&loaded.wrench) / (self.friction * self.size);
            return (misfit.abs() <= MISFIT_MAX).then(|| asked.instant(trial, &loaded, last));
        };
        let mut omega = 0.0;
        let mut look = |along: f64| {
            let (trial, loaded) = self.enclosed_turning(asked, along, omega, load)?;
            omega = trial.omega;
            let off = direction.x * loaded.wrench.y - direction.y * loaded.wrench.x;
            Some((off, (trial, loaded)))
        };
        // `t` is to the left of `n`, hence to the right of a force into the part: motion along it turns the force so.
        let (trial, loaded) = enclosed_zero(&mut |along| look(-along), 0.0, 1.0)?;
        self.newton(asked, trial).or_else(|| {
            let instant = asked.instant(trial, &loaded, Vector3::zeros());
            let off = direction.perp(&instant.force) / self.friction;
            let moment = asked.touching.turning().dot(&loaded.wrench) / (self.friction * self.size);
            if off.abs().max(moment.abs()) > MISFIT_MAX {
                return None;
            }
            asked.is_pushed(&instant).then_some(instant)
        })
    }

    /// The rate of turning where the contact's velocity is known.
    fn enclosed_turning(&self, asked: &Asked, along: f64, omega: f64, load: Vector3<f64>) -> Option<(Trial, Loaded)> {
        let turning = asked.touching.turning();
        let mut load = load;
        let mut look = |omega: f64| {
            let twist = asked.twist(omega, along);
            let loaded = self.loaded(&twist, &load).or_else(|| self.loaded(&twist, &EVEN))?;
            load = loaded.load;
            Some((turning.dot(&loaded.wrench), (Trial { omega, along, load }, loaded)))
        };
        enclosed_zero(&mut look, omega, 1.0 / self.size)
    }

    /// The motion from an easier one: without height and with large rings, then with both as they are.
    fn eased_into(&self, asked: &Asked) -> Option<Instant> {
        let easy = |share: f64| self.eased(share, RING_EASY);
        let first = easy(0.0).enclosed(asked, EVEN)?;
        let raised = if self.is_lifted() {
            follow(first, |share, near| easy(share).newton(asked, asked.begin(&near)))?
        } else {
            first
        };
        // Rings shrink by as large a factor as goes.
        let shrunk = |share: f64| self.eased(1.0, RING_EASY.powf(1.0 - share) * 1e-9_f64.powf(share));
        follow(raised, |share, near| shrunk(share).newton(asked, asked.begin(&near)))
    }
}

/// Follows a solution as a share goes from 0 to 1.
fn follow(first: Instant, solve: impl Fn(f64, Near) -> Option<Instant>) -> Option<Instant> {
    let (mut at, mut found, mut step) = (0.0, first, 0.25);
    while at < 1.0 {
        let next = f64::min(at + step, 1.0);
        match solve(next, Near::from(&found)) {
            Some(instant) => {
                (at, found) = (next, instant);
                step *= 2.0;
            }
            None => {
                step *= 0.5;
                if step < EASING_LEAST {
                    return None;
                }
            }
        }
    }
    Some(found)
}

/// The velocity per rate of turning that belongs to a smooth place; see the module.
fn from_smooth(place: Vector2<f64>, ring: f64, size: f64) -> Vector2<f64> {
    let goal = place.norm();
    if goal == 0.0 {
        return place;
    }
    // x/√(x² + e²) + x/ρ rises and is concave: from below Newton's steps stay below.
    let mut x = 0.0_f64;
    let beyond = (goal - 1.0) * size;
    if beyond > 0.0 {
        x = beyond;
    }
    for _ in 0..100 {
        let root = x.hypot(ring);
        let slope = ring / root * (ring / root) / root + 1.0 / size;
        let step = (goal - x / root - x / size) / slope;
        x += step;
        if step.abs() <= 1e-15 * x.abs() {
            break;
        }
    }
    place * (x / goal)
}

/// Where a rising function is zero, with what came with its value there: enclosed from `first` by doubling steps.
fn enclosed_zero<T>(look: &mut dyn FnMut(f64) -> Option<(f64, T)>, first: f64, step: f64) -> Option<T> {
    let (value, came) = look(first)?;
    if value == 0.0 {
        return Some(came);
    }
    let way = -value.signum();
    let (mut near, mut far) = ((first, value, came), None);
    let mut length = step;
    for _ in 0..DOUBLINGS {
        let at = near.0 + way * length;
        let (value, came) = look(at)?;
        if value == 0.0 {
            return Some(came);
        }
        if value * way > 0.0 {
            far = Some((at, value, came));
            break;
        }
        near = (at, value, came);
        length *= 2.0;
    }
    let mut far = far?;
    // Illinois's false position; every third look halves, for steps in the function.
    let (mut near_weight, mut far_weight) = (1.0, 1.0);
    let mut kept = 0;
    for turn in 0..ENCLOSED_LOOKS {
        let (a, b) = (near.1 * near_weight, far.1 * far_weight);
        let mut at = (near.0 * b - far.0 * a) / (b - a);
        let middle = 0.5 * (near.0 + far.0);
        if turn % 3 == 2 || !((near.0.min(far.0)..near.0.max(far.0)).contains(&at)) {
            at = middle;
        }
        let tight = (far.0 - near.0).abs() <= 4.0 * f64::EPSILON * near.0.abs().max(far.0.abs()).max(1e-3 * step);
        let between = near.0.min(far.0) < at && at < near.0.max(far.0);
        if tight || !between {
            break;
        }
        let (value, came) = look(at)?;
        if value == 0.0 {
            return Some(came);
        }
        if value * way > 0.0 {
            far = (at, value, came);
            (far_weight, near_weight) = (1.0, if kept == 1 { 0.5 * near_weight } else { 1.0 });
            kept = 1;
        } else {
            near = (at, value, came);
            (near_weight, far_weight) = (1.0, if kept == 2 { 0.5 * far_weight } else { 1.0 });
            kept = 2;
        }
    }
    Some(if near.1.abs() < far.1.abs() { near.2 } else { far.2 })
}
