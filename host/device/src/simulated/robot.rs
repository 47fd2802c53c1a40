//! A robot without hardware that carries the simulated finger to a part: one world, so that the force felt follows the
//! motion.
//!
//! It goes straight, speeds up and brakes with a stated acceleration, and its place is the mean of that over
//! acceleration/jerk, which bounds the jerk (twice that from speeding up straight to braking). Orders act, and places are told, after a latency; places are stamped by a clock of
//! its own, which begins elsewhere and runs a little fast. In each step the disk meets the part or does not
//! ([`TouchedWorld::press`]): the finger feels that force, and what friction does not hold moves the part.
//!
//! The world's time is that of the simulated finger which it carries ([`super::Config::carried_by`]); without one a server
//! lets it pass as on the clock.
//!
//! Frames: world, whose axes are the finger's. Units: SI. Errors: none; what cannot be pushed stays.

use std::collections::VecDeque;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nalgebra::{Point2, Vector2};
use palpate::Pose;
use palpate::math::random::Draw;
use palpate::pushing::touched_world::TouchedWorld;
use palpate_shared::sim::Carriage;

use super::Line;
use super::outlet::Outlet;
use crate::robot::protocol::{LineCutter, RobotOrder, RobotPlace};
use crate::transport::Address;

/// The world goes on in steps of this, s: one conversion at 4 kHz.
const STEP_S: f64 = 250e-6;

/// Nearer than this to its target a robot is there, m.
const THERE_M: f64 = 1e-9;

/// Places that wait for a host which does not read; older ones are lost.
const TOLD_MAX: usize = 4096;

/// How often a server looks at its line.
const SERVER_TICK: Duration = Duration::from_millis(1);

/// A robot's properties.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobotConfig {
    /// Where the disk's centre is at first, m.
    pub start: Point2<f64>,
    /// m/s².
    pub acceleration: f64,
    /// m/s³.
    pub jerk: f64,
    /// From an order being given to its acting, and from a place to its being told, s.
    pub latency: f64,
    /// Time between two places, s.
    pub report_period: f64,
    /// What its clock shows at the world's time 0, s.
    pub clock_offset: f64,
    /// Seconds that its clock gains in a second.
    pub clock_drift: f64,
    /// Standard deviation of each coordinate that it tells, m.
    pub position_sd: f64,
    /// Seed of those errors.
    pub seed: u64,
}

impl Default for RobotConfig {
    fn default() -> Self {
        Self {
            start: Point2::origin(),
            acceleration: 2.0,
            jerk: 100.0,
            latency: 4e-3,
            report_period: 4e-3,
            clock_offset: 812.5,
            clock_drift: 2e-5,
            position_sd: 2e-5,
            seed: 0,
        }
    }
}

/// What goes on in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobotTruth {
    /// World time, s.
    pub t: f64,
    /// Of the disk's centre without force, m.
    pub clamp: Point2<f64>,
    /// m/s.
    pub velocity: Vector2<f64>,
    /// On the finger, N.
    pub force: Vector2<f64>,
    /// The largest so far, N.
    pub force_max: f64,
    /// Of the part.
    pub pose: Pose,
    /// World time at which the last order to stop acted, s.
    pub stopped: Option<f64>,
}

/// Straight ways with bounded acceleration and jerk.
#[derive(Clone, Debug)]
struct Drive {
    at: Point2<f64>,
    direction: Vector2<f64>,
    speed: f64,
    target: Option<(Point2<f64>, f64)>,
    /// Before the mean is taken: the last acceleration/jerk seconds.
    recent: VecDeque<Point2<f64>>,
    sum: Vector2<f64>,
    /// The last three means, newest last.
    means: [Point2<f64>; 3],
    acceleration: f64,
}

impl Drive {
    fn new(config: &RobotConfig) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a fraction of a second in steps")]
        let count = (config.acceleration / config.jerk / STEP_S).round().max(1.0) as usize;
        Self {
            at: config.start,
            direction: Vector2::x(),
            speed: 0.0,
            target: None,
            recent: vec![config.start; count].into(),
            sum: config.start.coords * count as f64,
            means: [config.start; 3],
            acceleration: config.acceleration,
        }
    }

    fn order(&mut self, order: RobotOrder) {
        match order {
            RobotOrder::Move { to, speed } => self.target = Some((to, speed)),
            RobotOrder::Stop => self.target = None,
            RobotOrder::Where => {}
        }
    }

    /// The greatest speed from which it can still stand after a way: in steps, by `v²/2a + v dt`.
    fn braking(&self, way: f64) -> f64 {
        let slack = self.acceleration * STEP_S;
        (slack * slack + 2.0 * self.acceleration * way.max(0.0)).sqrt() - slack
    }

    fn step(&mut self) {
        let wanted = match self.target {
            None => 0.0,
            Some((to, speed)) => {
                let left = to - self.at;
                if self.speed == 0.0 {
                    self.direction = left.try_normalize(THERE_M).unwrap_or(self.direction);
                }
                let along = left.dot(&self.direction);
                // What lies aside or behind needs another way: first it brakes.
                let is_ahead = along > 0.0 && left.perp(&self.direction).abs() <= THERE_M + 1e-6 * left.norm();
                if is_ahead { speed.min(self.braking(along)) } else { 0.0 }
            }
        };
        let change = self.acceleration * STEP_S;
        self.speed = wanted.clamp(self.speed - change, self.speed + change).max(0.0);
        self.at += self.direction * (self.speed * STEP_S);
        if let Some((to, _)) = self.target
            && (to - self.at).norm() <= THERE_M + change * STEP_S
            && self.speed <= change
        {
            (self.at, self.speed) = (to, 0.0);
        }
        self.recent.push_back(self.at);
        let oldest = self.recent.pop_front().unwrap_or(self.at);
        self.sum += self.at - oldest;
        let mean = Point2::from(self.sum / self.recent.len() as f64);
        self.means = [self.means[1], self.means[2], mean];
    }

    fn place(&self) -> Point2<f64> {
        self.means[2]
    }

    fn velocity(&self) -> Vector2<f64> {
        (self.means[2] - self.means[1]) / STEP_S
    }

    fn clamp_acceleration(&self) -> Vector2<f64> {
        ((self.means[2] - self.means[1]) - (self.means[1] - self.means[0])) / (STEP_S * STEP_S)
    }
}

/// Robot, finger and part.
#[derive(Clone, Debug)]
struct Scene {
    config: RobotConfig,
    world: TouchedWorld,
    drive: Drive,
    steps: u64,
    orders: VecDeque<(f64, RobotOrder)>,
    told: VecDeque<(f64, RobotPlace)>,
    next_report: f64,
    force: Vector2<f64>,
    force_max: f64,
    stopped: Option<f64>,
    draw: Draw,
}

impl Scene {
    fn time(&self) -> f64 {
        self.steps as f64 * STEP_S
    }

    fn go_on_to(&mut self, time: f64) {
        while self.time() + STEP_S <= time {
            self.step();
        }
    }

    fn step(&mut self) {
        self.steps += 1;
        let now = self.time();
        while self.orders.front().is_some_and(|(due, _)| *due <= now) {
            if let Some((_, order)) = self.orders.pop_front() {
                self.drive.order(order);
                match order {
                    RobotOrder::Where => self.report(),
                    RobotOrder::Stop => self.stopped = Some(now),
                    RobotOrder::Move { .. } => {}
                }
            }
        }
        self.drive.step();
        // What friction cannot be asked of stays where it is; the force is that of the beam all the same.
        self.force = self.world.press(self.drive.place(), self.drive.velocity());
        self.force_max = self.force_max.max(self.force.norm());
        if now >= self.next_report {
            self.next_report += self.config.report_period;
            self.report();
        }
    }

    fn report(&mut self) {
        let (now, sd) = (self.time(), self.config.position_sd);
        let off = Vector2::new(self.draw.normal(), self.draw.normal()) * sd;
        let t = self.config.clock_offset + (1.0 + self.config.clock_drift) * now;
        if self.told.len() == TOLD_MAX {
            self.told.pop_front();
        }
        self.told.push_back((now + self.config.latency, RobotPlace { t, at: self.drive.place() + off }));
    }

    fn take_told(&mut self) -> Vec<RobotPlace> {
        let now = self.time();
        let due = self.told.iter().take_while(|(due, _)| *due <= now).count();
        self.told.drain(..due).map(|(_, place)| place).collect()
    }

    #[expect(clippy::cast_possible_truncation, reason = "the simulated finger computes in single precision")]
    fn carriage(&self) -> Carriage {
        let acceleration = self.drive.clamp_acceleration();
        Carriage {
            force: [self.force.x as f32, self.force.y as f32],
            acceleration: [acceleration.x as f32, acceleration.y as f32],
        }
    }
}

/// A simulated robot: its world is shared by all copies.
#[derive(Clone, Debug)]
pub struct SimulatedRobot(Arc<Mutex<Scene>>);

impl SimulatedRobot {
    /// A robot at rest beside a part.
    #[must_use]
    pub fn new(config: RobotConfig, world: TouchedWorld) -> Self {
        let drive = Drive::new(&config);
        Self(Arc::new(Mutex::new(Scene {
            config,
            world,
            drive,
            steps: 0,
            orders: VecDeque::new(),
            told: VecDeque::new(),
            next_report: 0.0,
            force: Vector2::zeros(),
            force_max: 0.0,
            stopped: None,
            draw: Draw::new(config.seed),
        })))
    }

    fn scene(&self) -> MutexGuard<'_, Scene> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gives an order, which acts after the latency.
    pub fn order(&self, order: RobotOrder) {
        let mut scene = self.scene();
        let due = scene.time() + scene.config.latency;
        scene.orders.push_back((due, order));
    }

    /// The places told since this was last asked.
    #[must_use]
    pub fn told(&self) -> Vec<RobotPlace> {
        self.scene().take_told()
    }

    /// Where it says that it is, without its errors and its latency.
    #[must_use]
    pub fn place(&self) -> RobotPlace {
        let scene = self.scene();
        let t = scene.config.clock_offset + (1.0 + scene.config.clock_drift) * scene.time();
        RobotPlace { t, at: scene.drive.place() }
    }

    /// The world's time of a moment on the robot's clock, s.
    #[must_use]
    pub fn world_time(&self, t: f64) -> f64 {
        let config = self.scene().config;
        (t - config.clock_offset) / (1.0 + config.clock_drift)
    }

    /// Somebody lays the part elsewhere.
    pub fn lay(&self, pose: Pose) {
        let mut scene = self.scene();
        (scene.world.pose, scene.world.pressed) = (pose, None);
    }

    /// What is so.
    #[must_use]
    pub fn truth(&self) -> RobotTruth {
        let scene = self.scene();
        RobotTruth {
            t: scene.time(),
            clamp: scene.drive.place(),
            velocity: scene.drive.velocity(),
            force: scene.force,
            force_max: scene.force_max,
            pose: scene.world.pose,
            stopped: scene.stopped,
        }
    }

    /// Lets the world go on to a time, s; what acts on the finger then.
    pub fn go_on_to(&self, time: f64) -> Carriage {
        let mut scene = self.scene();
        scene.go_on_to(time);
        scene.carriage()
    }

    /// Speaks the protocol at a pseudo-terminal or a TCP port. `has_own_time`: where no simulated finger moves the
    /// world's time on.
    ///
    /// # Errors
    /// What the operating system says when the pseudo-terminal, the port or the thread cannot be had.
    pub fn serve(&self, line: &Line, has_own_time: bool) -> io::Result<RobotServer> {
        let outlet = Outlet::at(line)?;
        let address = outlet.address(0);
        let ended = Arc::new(AtomicBool::new(false));
        let thread = {
            let (robot, ended) = (self.clone(), Arc::clone(&ended));
            std::thread::Builder::new()
                .name("simulated robot".to_owned())
                .spawn(move || robot.talk(outlet, &ended, has_own_time))?
        };
        Ok(RobotServer { address, ended, thread: Some(thread) })
    }

    fn talk(&self, mut outlet: Outlet, ended: &AtomicBool, has_own_time: bool) {
        let begun = Instant::now();
        let (mut cutter, mut buffer, mut waiting) = (LineCutter::default(), [0; 256], Vec::new());
        while !ended.load(Ordering::Relaxed) {
            if has_own_time {
                self.go_on_to(begun.elapsed().as_secs_f64());
            }
            let length = outlet.read(&mut buffer);
            cutter.take(&buffer[..length], |line| match line.and_then(RobotOrder::parse) {
                Ok(order) => self.order(order),
                Err(error) => waiting.extend_from_slice(format!("error {error}\n").as_bytes()),
            });
            for place in self.told() {
                // A host that does not read loses places, and not the robot its memory.
                if waiting.len() < WAITING_BYTES_MAX {
                    waiting.extend_from_slice(format!("{place}\n").as_bytes());
                }
            }
            let sent = outlet.write(&waiting);
            waiting.drain(..sent);
            std::thread::sleep(SERVER_TICK);
        }
    }
}

/// Bytes that wait for a host which does not read: a second of places.
const WAITING_BYTES_MAX: usize = 16_384;

/// A robot's end of a line; it ends when this is dropped.
#[derive(Debug)]
pub struct RobotServer {
    address: Address,
    ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl RobotServer {
    /// What a host gives as the robot's name.
    #[must_use]
    pub fn address(&self) -> &Address {
        &self.address
    }
}

impl Drop for RobotServer {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests;
