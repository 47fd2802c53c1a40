//! A pushed part in world coordinates: positions and velocities of its centre of mass and angle, the contact as a
//! constraint solved with its force by elimination, support on feet one by one. Slow, obvious, and without any formula
//! of `palpate::pushing::dynamics`, which works in contact coordinates with the constraint solved by hand.
//!
//! Units: SI, world axes, per unit mass.

/// A plane vector.
type V = [f64; 2];

/// What is pushed, by what.
#[derive(Clone, Debug)]
pub struct World {
    /// Outward normal of the edge in contact, part axes.
    pub normal: V,
    /// A vertex of that edge, from the centre of mass, part axes, m.
    pub vertex: V,
    /// Inertia over mass, m².
    pub inertia: f64,
    /// Feet: places from the centre of mass, part axes, m, and shares of the weight.
    pub feet: Vec<(V, f64)>,
    /// µ g, m/s².
    pub mu_g: f64,
    /// The finger: radius, centre, velocity and acceleration at t = 0.
    pub radius: f64,
    /// See `radius`.
    pub centre: V,
    /// See `radius`.
    pub velocity: V,
    /// See `radius`.
    pub acceleration: V,
}

/// What the tangential force does.
#[derive(Clone, Copy, Debug)]
pub enum Tangential {
    /// It is this multiple of the normal force, along the edge's counter-clockwise direction.
    Multiple(f64),
    /// It keeps the contact from slipping.
    NoSlip,
}

/// Position of the centre of mass, angle, and their rates.
pub type Motion = [f64; 6];

/// What can be seen of a motion.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Polar angle of the contact, rad, up to whole turns.
    pub u: f64,
    /// Contact along the edge, m.
    pub s: f64,
    /// Slip of the part on the finger, along the edge, m/s.
    pub slip: f64,
    /// Force into the part.
    pub normal_force: f64,
    /// Force along the edge.
    pub tangential_force: f64,
}

fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn cross(a: V, b: V) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn left(a: V) -> V {
    [-a[1], a[0]]
}

fn plus(a: V, b: V, times: f64) -> V {
    [a[0] + times * b[0], a[1] + times * b[1]]
}

fn turned(a: V, angle: f64) -> V {
    let (sin, cos) = angle.sin_cos();
    [cos * a[0] - sin * a[1], sin * a[0] + cos * a[1]]
}

/// Places and velocities at one instant.
struct Instant {
    normal: V,
    along: V,
    /// Disk's centre, contact and their velocities, from the centre of mass.
    disk: V,
    disk_velocity: V,
    contact: V,
    contact_velocity: V,
    /// Velocity of the part at the contact less the finger's.
    slip: V,
}

impl World {
    /// The motion that has the disk touch the edge at `s` from the foot of the perpendicular, at polar angle `u`, with
    /// the centre of mass moving at `v_t` along the disk's tangent and the part turning at `omega`.
    #[must_use]
    pub fn start(&self, u: f64, s: f64, omega: f64, v_t: f64) -> Motion {
        let out = [u.cos(), u.sin()];
        let angle = out[1].atan2(out[0]) + std::f64::consts::PI - self.normal[1].atan2(self.normal[0]);
        let normal = turned(self.normal, angle);
        let contact = plus(self.centre, out, self.radius);
        let height = dot(self.normal, self.vertex);
        let arm = plus([height * normal[0], height * normal[1]], left(normal), s);
        let position = plus(contact, arm, -1.0);
        // Along the normal the contact point of the part moves with the finger.
        let v_n = dot(self.velocity, normal) - omega * dot(left(arm), normal);
        let velocity = plus([v_n * normal[0], v_n * normal[1]], left(out), v_t);
        [position[0], position[1], angle, velocity[0], velocity[1], omega]
    }

    fn instant(&self, t: f64, motion: &Motion) -> Instant {
        let [x, y, angle, v_x, v_y, omega] = *motion;
        let normal = turned(self.normal, angle);
        let centre = plus(plus(self.centre, self.velocity, t), self.acceleration, 0.5 * t * t);
        let finger = plus(self.velocity, self.acceleration, t);
        let (disk, disk_velocity) = (plus(centre, [x, y], -1.0), plus(finger, [v_x, v_y], -1.0));
        // The contact is one radius from the disk's centre, against the part's normal, which turns with the part.
        let contact = plus(disk, normal, -self.radius);
        let contact_velocity = plus(disk_velocity, left(normal), -self.radius * omega);
        let slip = plus(plus([v_x, v_y], left(contact), omega), finger, -1.0);
        Instant { normal, along: left(normal), disk, disk_velocity, contact, contact_velocity, slip }
    }

    /// Force and moment of support friction.
    fn friction(&self, motion: &Motion) -> (V, f64) {
        let [_, _, angle, v_x, v_y, omega] = *motion;
        let mut total = ([0.0; 2], 0.0);
        for &(place, share) in &self.feet {
            let arm = turned(place, angle);
            let velocity = plus([v_x, v_y], left(arm), omega);
            let speed = velocity[0].hypot(velocity[1]);
            if speed > 0.0 {
                let force = -self.mu_g * share / speed;
                total = (plus(total.0, velocity, force), total.1 + force * cross(arm, velocity));
            }
        }
        total
    }

    /// Speed of the slowest foot, m/s.
    #[must_use]
    pub fn slowest_foot(&self, motion: &Motion) -> f64 {
        let [_, _, angle, v_x, v_y, omega] = *motion;
        let speed = |place: V| {
            let velocity = plus([v_x, v_y], left(turned(place, angle)), omega);
            velocity[0].hypot(velocity[1])
        };
        self.feet.iter().map(|&(place, _)| speed(place)).fold(f64::INFINITY, f64::min)
    }

    /// Accelerations and the contact force's components (into the part, along the edge).
    fn solve(&self, t: f64, motion: &Motion, tangential: Tangential) -> [f64; 5] {
        let omega = motion[5];
        let Instant { normal: n, along, disk, disk_velocity, contact, contact_velocity, slip } =
            self.instant(t, motion);
        let (friction, moment) = self.friction(motion);
        let turn = cross(contact, n);
        // Newton and Euler: a = −λ n + τ t + friction.
        let mut rows = [
            [1.0, 0.0, 0.0, n[0], -along[0], friction[0]],
            [0.0, 1.0, 0.0, n[1], -along[1], friction[1]],
            [0.0, 0.0, self.inertia, turn, -cross(contact, along), moment],
            [0.0; 6],
            [0.0; 6],
        ];
        // The gap n·(disk) − h − r stays zero: its second derivative.
        let known =
            2.0 * omega * dot(left(n), disk_velocity) - omega * omega * dot(n, disk) + dot(n, self.acceleration);
        rows[3] = [n[0], n[1], -dot(left(n), disk), 0.0, 0.0, known];
        rows[4] = match tangential {
            Tangential::Multiple(multiple) => [0.0, 0.0, 0.0, -multiple, 1.0, 0.0],
            Tangential::NoSlip => {
                // The slip t·(v + ω ẑ × c − v_F) stays zero: its derivative.
                let known =
                    dot(along, self.acceleration) - omega * dot(along, left(contact_velocity)) + omega * dot(n, slip);
                [along[0], along[1], dot(along, left(contact)), 0.0, 0.0, known]
            }
        };
        eliminate(rows)
    }

    /// The motion `dt` later, by the classical Runge–Kutta method.
    #[must_use]
    pub fn step(&self, t: f64, motion: &Motion, tangential: Tangential, dt: f64) -> Motion {
        let rates = |t: f64, m: &Motion| {
            let [a_x, a_y, alpha, _, _] = self.solve(t, m, tangential);
            [m[3], m[4], m[5], a_x, a_y, alpha]
        };
        let moved = |rates: &Motion, dt: f64| std::array::from_fn(|i| motion[i] + dt * rates[i]);
        let k1 = rates(t, motion);
        let k2 = rates(t + dt / 2.0, &moved(&k1, dt / 2.0));
        let k3 = rates(t + dt / 2.0, &moved(&k2, dt / 2.0));
        let k4 = rates(t + dt, &moved(&k3, dt));
        let mean: Motion = std::array::from_fn(|i| (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0);
        moved(&mean, dt)
    }

    /// What a finger could tell.
    #[must_use]
    pub fn seen(&self, t: f64, motion: &Motion, tangential: Tangential) -> Seen {
        let Instant { normal, along, contact, slip, .. } = self.instant(t, motion);
        let [.., normal_force, tangential_force] = self.solve(t, motion, tangential);
        Seen {
            u: (-normal[1]).atan2(-normal[0]),
            s: dot(along, contact),
            slip: dot(along, slip),
            normal_force,
            tangential_force,
        }
    }
}

/// Gauss's elimination with the largest pivot of each column.
fn eliminate(mut rows: [[f64; 6]; 5]) -> [f64; 5] {
    for column in 0..5 {
        let pivot = (column..5).max_by(|&i, &j| rows[i][column].abs().total_cmp(&rows[j][column].abs()));
        rows.swap(column, pivot.unwrap_or(column));
        let pivot_row = rows[column];
        for (_, row) in rows.iter_mut().enumerate().filter(|(i, _)| *i != column) {
            let times = row[column] / pivot_row[column];
            row.iter_mut().zip(pivot_row).for_each(|(value, pivot)| *value -= times * pivot);
        }
    }
    std::array::from_fn(|i| rows[i][5] / rows[i][i])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mass point on a frictionless table, pushed straight: it moves with the finger, the force is its acceleration.
    #[test]
    fn a_straight_push_is_newtons_law() {
        let world = World {
            normal: [0.0, -1.0],
            vertex: [-0.02, -0.02],
            inertia: 1e-4,
            feet: Vec::new(),
            mu_g: 0.0,
            radius: 0.01,
            centre: [0.0; 2],
            velocity: [0.0, 0.1],
            acceleration: [0.0, 0.5],
        };
        let start = world.start(std::f64::consts::FRAC_PI_2, 0.0, 0.0, 0.0);
        let seen = world.seen(0.0, &start, Tangential::Multiple(0.0));
        assert!((seen.normal_force - 0.5).abs() < 1e-12 && seen.s.abs() < 1e-15, "{seen:?}");
        let end = world.step(0.0, &start, Tangential::NoSlip, 0.1);
        // No turn, or a whole one: where it began is only known modulo 2π.
        let turned = end[2].sin().abs() > 1e-12 || end[2].cos() < 0.0;
        assert!((end[1] - (0.03 + 0.01 + 0.0025)).abs() < 1e-12 && !turned, "{end:?}");
    }
}
