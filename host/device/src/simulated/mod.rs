//! A whole device without hardware: the firmware's own code on the simulated finger, behind a serial line.
//!
//! A thread steps the simulated front-end conversion by conversion, calls the firmware's sampler at each, and
//! carries bytes between the firmware and an outlet: a pipe in this process (`sim:`), a pseudo-terminal that is
//! opened like any serial port, or a TCP port. Everything between the force on the disk and those bytes is the
//! code that runs on a board, or the model of the chip that stands on it.
//!
//! Three paces: [`Pace::RealTime`] takes samples when a board would; [`Pace::AsRead`] takes the next ones as soon as
//! the host has read the last, so that a minute of samples takes a second; with [`Pace::AsAsked`] the world stands still
//! but while a session waits for something, so that what a host does repeats to the digit. In each the device's clock
//! counts conversions, and the same seed gives the same samples.
//!
//! A finger may be carried by a simulated [`robot`], which meets a part.
//!
//! The owner of a [`SimulatedDevice`] is the hand that presses: it sets loads and faults, pulls the cable, and
//! knows the truth.

mod board;
mod line_faults;
mod outlet;
pub mod robot;
mod troubled_outlet;

use std::io;
use std::path::PathBuf;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::Instant;

use board::Control;
use palpate_shared::sim::{Carriage, CarriedConfig, Faults, FingerConfig, Load, RAMP_US, Script, Truth};

use crate::Address;
pub use board::SimulatedOnly;
pub use line_faults::{FaultyLine, Injected, LineFaults};
pub use outlet::LinkExists;
use outlet::Outlet;

use crate::transport::pipe::{Pipe, PipeEnd};

/// How fast simulated time passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pace {
    /// As fast as on the clock.
    #[default]
    RealTime,
    /// As fast as the host reads.
    AsRead,
    /// While the [`crate::Session`] of this device waits for what is to come, and at no other time: what its owner orders
    /// takes effect at the sample up to which the session has asked, however busy the computer is.
    AsAsked,
}

/// Where the device's serial line comes out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Line {
    /// A pipe within this process.
    #[default]
    Pipe,
    /// At a pseudo-terminal; Unix only.
    Pty {
        /// A symbolic link that leads to it, also after it was unplugged and plugged in again.
        link: Option<PathBuf>,
    },
    /// At a TCP port, for one host at a time.
    Tcp {
        /// Name or address, and port, as in `localhost:7800`; port 0 takes any free one.
        host: String,
    },
}

/// What a simulated device is made of.
#[derive(Clone, Debug, Default)]
pub struct Config {
    /// Seed of everything random.
    pub seed: u64,
    /// The finger; by default the project's default finger.
    pub finger: FingerConfig,
    /// Its beam's own mass, and how it is mounted; by default of steel, upright.
    pub carried: CarriedConfig,
    /// What is broken from the start.
    pub faults: Faults,
    /// What is wrong with the way to the host from the start.
    pub link_faults: LinkFaults,
    /// Who carries it, and to what: time goes on in that world as conversions are made.
    pub carried_by: Option<robot::SimulatedRobot>,
    /// How fast time passes.
    pub pace: Pace,
    /// Where the line comes out.
    pub line: Line,
    /// Speed of the line in baud; `None` is as fast as it goes.
    pub baud: Option<u32>,
}

/// What is wrong with the way between a simulated device and its host; the default is nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkFaults {
    /// What the line does to frames, in either direction.
    pub line: LineFaults,
    /// The cable is pulled once in so many seconds on average, for some tenths of a second; 0 is never.
    pub unplug_every_s: f64,
    /// The device is switched off and on once in so many seconds on average; 0 is never.
    pub restart_every_s: f64,
}

/// What was done on the way between a simulated device and its host.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InjectedOnLink {
    /// To what the device sent.
    pub to_host: Injected,
    /// To what the host sent.
    pub to_device: Injected,
    /// Times that the cable was pulled by chance.
    pub unplugged: u64,
    /// Times that the device was restarted by chance.
    pub restarted: u64,
}

/// What happens to a carried finger: forces on its disk, which another simulation computed, and how its clamp
/// accelerates. Evenly spaced in time, with straight lines between.
///
/// The first acts at once, without a ramp. After the last the force is let go within [`RAMP_US`], as any load is, and the
/// clamp goes on as fast as it is.
#[derive(Clone, Debug, PartialEq)]
pub struct CarriedCourse {
    step_s: f64,
    carriages: Vec<Carriage>,
    moving_input: Option<u8>,
}

impl CarriedCourse {
    /// Forces on the disk (N) and accelerations of the clamp (m/s²) in finger axes, each `step_s` seconds after the one
    /// before.
    #[must_use]
    pub fn new(step_s: f64, carriages: Vec<Carriage>) -> Self {
        Self { step_s, carriages, moving_input: None }
    }

    /// The same with a digital input of the board, 0 to 7, that is high meanwhile: the line by which a robot tells that it moves.
    #[must_use]
    pub fn with_moving_input(self, input: u8) -> Self {
        Self { moving_input: Some(input), ..self }
    }

    /// Levels of a board's inputs where they are these without it, while it goes on or when it is over.
    fn levels(&self, levels: u8, goes_on: bool) -> u8 {
        let bit = self.moving_input.and_then(|input| 1_u8.checked_shl(input.into())).unwrap_or(0);
        if goes_on { levels | bit } else { levels & !bit }
    }

    /// What acts at a time since the course began, s; `None` once it is over.
    #[must_use]
    pub fn at(&self, t: f64) -> Option<Carriage> {
        let place = (t / self.step_s).max(0.0);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "not negative; large ones saturate"
        )]
        let index = place as usize;
        let Some((from, to)) = self.carriages.get(index).zip(self.carriages.get(index + 1)) else {
            return self.let_go(t - self.duration_s());
        };
        #[expect(clippy::cast_possible_truncation, reason = "a share of 1")]
        let share = place.fract() as f32;
        let between = |from: [f32; 2], to: [f32; 2]| [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
        Some(Carriage {
            force: between(from.force, to.force),
            acceleration: between(from.acceleration, to.acceleration),
        })
    }

    /// What acts so many seconds after the last.
    fn let_go(&self, after_s: f64) -> Option<Carriage> {
        let left = 1.0 - after_s / (f64::from(RAMP_US) * 1e-6);
        #[expect(clippy::cast_possible_truncation, reason = "a share of 1")]
        let force = self.carriages.last()?.force.map(|force| left as f32 * force);
        (left > 0.0).then_some(Carriage { force, ..Carriage::default() })
    }

    /// How long it lasts, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.step_s * self.carriages.len().saturating_sub(1) as f64
    }
}

/// The simulated world at one moment.
#[derive(Clone, Copy, Debug)]
pub struct SimulatedMoment {
    /// Conversions since the device started.
    pub conversion: u64,
    /// State of the simulated world then.
    pub truth: Truth,
    /// Where the tip is, finger axes, from where it is without load and at rest, m.
    pub tip_finger: [f32; 2],
}

/// A running simulated device. It ends when this is dropped.
#[derive(Debug)]
pub struct SimulatedDevice {
    seed: u64,
    pace: Pace,
    address: Address,
    pipe: Option<Pipe>,
    control: Sender<Control>,
    thread: Option<JoinHandle<()>>,
    /// Host time at the device's time 0, for a device in real time.
    epoch: Instant,
}

impl SimulatedDevice {
    /// Starts a device.
    ///
    /// # Errors
    /// What the operating system says when the pseudo-terminal, the TCP port or the thread cannot be had.
    pub fn start(config: Config) -> io::Result<Self> {
        let (outlet, pipe) = match &config.line {
            Line::Pipe => {
                let pipe = Pipe::default();
                (Outlet::pipe(pipe.clone()), Some(pipe))
            }
            line => (Outlet::at(line)?, None),
        };
        let (seed, pace, address) = (config.seed, config.pace, outlet.address(config.seed));
        let (control, orders) = channel();
        let epoch = Instant::now();
        let thread = std::thread::Builder::new()
            .name("simulated device".to_owned())
            .spawn(move || board::run(&config, outlet, &orders, epoch))?;
        Ok(Self { seed, pace, address, pipe, control, thread: Some(thread), epoch })
    }

    /// The default finger in this process, in real time.
    ///
    /// # Errors
    /// As [`SimulatedDevice::start`].
    pub fn start_default(seed: u64) -> io::Result<Self> {
        Self::start(Config { seed, ..Config::default() })
    }

    /// Seed of everything random in it.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// How fast its time passes.
    #[must_use]
    pub fn pace(&self) -> Pace {
        self.pace
    }

    /// What a host gives as the device's name.
    #[must_use]
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// The host's end of the line of a device in this process; a dead end for any other.
    #[must_use]
    pub fn connect(&self) -> PipeEnd {
        self.pipe.clone().unwrap_or_default().host_end()
    }

    /// Host time at the device's time 0; meaningful in real time, until the device restarts.
    #[must_use]
    pub fn epoch(&self) -> Instant {
        self.epoch
    }

    /// Presses on the disk from now on; returns the moment from which the load acts.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn set_load(&self, load: Load) -> io::Result<SimulatedMoment> {
        self.ask(|answer| Control::Load(load, answer))
    }

    /// Starts a script of loads.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn set_script(&self, script: Script) -> io::Result<SimulatedMoment> {
        self.ask(|answer| Control::Script(Box::new(script), answer))
    }

    /// Lets whatever presses go, and starts a course.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn set_course(&self, course: CarriedCourse) -> io::Result<SimulatedMoment> {
        self.ask(|answer| Control::Course(course, answer))
    }

    /// Breaks or mends things.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn set_faults(&self, faults: Faults) -> io::Result<SimulatedMoment> {
        self.ask(|answer| Control::Faults(faults, answer))
    }

    /// Sets the levels of the board's eight digital inputs from now on, a bit for each; returns the moment from which
    /// they hold.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn set_inputs(&self, levels: u8) -> io::Result<SimulatedMoment> {
        self.ask(|answer| Control::Inputs(levels, answer))
    }

    /// Sets them from a time on, s since the device was started; at once where that has passed. The first conversion from
    /// then on sees it: orders that come one by one act some milliseconds late.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn set_inputs_at(&self, seconds: f64, levels: u8) -> io::Result<SimulatedMoment> {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates before the start")]
        let time_ns = (seconds * 1e9) as u64;
        self.ask(|answer| Control::InputsAt(time_ns, levels, answer))
    }

    /// Makes the way to the host worse or better.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn set_link_faults(&self, faults: LinkFaults) -> io::Result<SimulatedMoment> {
        self.ask(|answer| Control::LinkFaults(faults, answer))
    }

    /// What was done on the way to the host so far.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn injected(&self) -> io::Result<InjectedOnLink> {
        self.ask(Control::Injected)
    }

    /// The state of the world now.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn now(&self) -> io::Result<SimulatedMoment> {
        self.ask(Control::Now)
    }

    /// Pulls the cable; bytes under way are lost, the device goes on sampling.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn unplug(&self) -> io::Result<SimulatedMoment> {
        self.ask(Control::Unplug)
    }

    /// Plugs the cable in again.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn plug_in(&self) -> io::Result<SimulatedMoment> {
        self.ask(Control::PlugIn)
    }

    /// Switches the device off and on again: it forgets its settings and counts from 0.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn restart(&self) -> io::Result<SimulatedMoment> {
        self.ask(Control::Restart)
    }

    /// Puts bytes on the line towards the host, as noise on the cable would.
    ///
    /// # Errors
    /// If the device has ended.
    pub fn disturb(&self, noise: Vec<u8>) -> io::Result<SimulatedMoment> {
        self.ask(|answer| Control::Disturb(noise, answer))
    }

    /// Lets the time of a device at [`Pace::AsAsked`] go on for a while; returns when what it then had to send is on the
    /// line.
    pub(crate) fn let_time_pass(&self) -> io::Result<SimulatedMoment> {
        self.ask(Control::LetTimePass)
    }

    fn ask<T>(&self, order: impl FnOnce(Sender<T>) -> Control) -> io::Result<T> {
        let (answer, answered) = channel();
        let ended = || io::Error::new(io::ErrorKind::BrokenPipe, "the simulated device has ended");
        self.control.send(order(answer)).map_err(|_| ended())?;
        answered.recv().map_err(|_| ended())
    }
}

impl Drop for SimulatedDevice {
    fn drop(&mut self) {
        // A thread that has ended already does not listen.
        let _ = self.control.send(Control::End);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
