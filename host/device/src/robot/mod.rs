//! The robot that moves the finger: its lines, the link to it, and what a lost one means.
//!
//! A thread reads the link and keeps what came, newest last; orders go out on the caller's thread. A robot that says
//! nothing for [`ROBOT_SILENCE`] is lost, for then nobody knows where the finger is.
//!
//! In reading order: [`protocol`], the lines; [`RobotLink`]. `simulated::robot` is a robot without hardware.
//! Units: SI. Errors: [`RobotError`].

pub mod protocol;

use std::collections::VecDeque;
use std::io::{ErrorKind, Read as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use protocol::{LineCutter, RobotLine, RobotLineError, RobotOrder, RobotPlace};
use thiserror::Error;

use crate::clock_map::{ClockEstimate, ClockMap};
use crate::error::LinkError;
use crate::simulated::robot::SimulatedRobot;
use crate::transport::{Address, BAUD_FALLBACK, Transport};

/// A robot that tells no place for so long is lost. It is to tell twenty a second; a busy computer pauses less.
pub const ROBOT_SILENCE: Duration = Duration::from_millis(500);

/// The robot's clock is held against the host's over so long, twice in a row: twice as long as a place may be under way. A host
/// that pauses sees it too slow and then, as it reads what came meanwhile, too fast.
const CLOCK_LOOK: Duration = Duration::from_secs(1);

/// Meanwhile it may go on by so many times as much, at the least and at the most: places come late by [`ROBOT_SILENCE`] at the most,
/// which is half of that time.
const CLOCK_RATES: [f64; 2] = [0.4, 2.5];

/// Places that are kept for whoever asks: four seconds of a robot that tells a thousand a second.
const PLACES_KEPT: usize = 4096;

/// Why the finger cannot be moved.
#[derive(Debug, Error)]
pub enum RobotError {
    /// The link cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Nothing came for too long.
    #[error("the robot at {address} has told no place for {} ms", silence.as_millis())]
    Silent {
        /// What it was opened as.
        address: String,
        /// For how long.
        silence: Duration,
    },
    /// Its clock is not one of seconds.
    #[error("the robot at {address} tells times that went on by {robot_s:.3} s in {host_s:.1} s")]
    Clock {
        /// What it was opened as.
        address: String,
        /// How far its own clock went on, s.
        robot_s: f64,
        /// And the host's, s.
        host_s: f64,
    },
    /// The link broke.
    #[error("the link to the robot at {address} broke: {reason}")]
    Broken {
        /// What it was opened as.
        address: String,
        /// In the operating system's words.
        reason: String,
    },
    /// The robot says so.
    #[error("the robot says: {0}")]
    Refused(String),
    /// What comes is not what a robot says.
    #[error(transparent)]
    NotARobot(#[from] RobotLineError),
}

/// What has come and was not yet taken.
#[derive(Debug)]
struct Heard {
    places: VecDeque<(RobotPlace, Instant)>,
    clock: ClockMap,
    last: Instant,
    /// A place with which later ones are compared.
    since: Option<(RobotPlace, Instant)>,
    /// Whether its clock went on too fast when last looked at; none where it did well.
    too_fast: Option<bool>,
    /// What came and is no line of a robot, before the first place: a line that was begun before the link was opened is cut.
    unread: Option<RobotLineError>,
    /// The first thing that went wrong.
    wrong: Option<RobotError>,
}

/// A link to a robot.
#[derive(Debug)]
pub struct RobotLink {
    address: String,
    epoch: Instant,
    out: Out,
    heard: Arc<Mutex<Heard>>,
    ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// Where orders go.
#[derive(Debug)]
enum Out {
    Line(Transport),
    /// In this process: its time is that of its world, and so are its places.
    Simulated(SimulatedRobot),
    /// Nowhere: what the robot did is past.
    Recorded,
}

fn held<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl RobotLink {
    /// Opens a robot at a serial port or a TCP port, and asks it where it is. `epoch` is the host's time 0, as of the
    /// finger's session.
    ///
    /// # Errors
    /// [`RobotError::Link`]; [`RobotError::Silent`] if it does not say where it is, [`RobotError::NotARobot`] if it says
    /// something else.
    pub fn open(address: &Address, epoch: Instant) -> Result<Self, RobotError> {
        let mut transport = Transport::open(address, BAUD_FALLBACK, None)?;
        let broken =
            |error: std::io::Error| RobotError::Broken { address: address.to_string(), reason: error.to_string() };
        let reading = transport.second().map_err(broken)?;
        writeln!(transport, "{}", RobotOrder::Where).map_err(broken)?;
        let now = Instant::now();
        let heard = Heard::new(now);
        let (heard, ended) = (Arc::new(Mutex::new(heard)), Arc::new(AtomicBool::new(false)));
        let thread = {
            let (heard, ended, address) = (Arc::clone(&heard), Arc::clone(&ended), address.to_string());
            let read = move || listen(reading, &heard, &ended, &address, epoch);
            std::thread::Builder::new().name("robot".to_owned()).spawn(read).map_err(broken)?
        };
        let out = Out::Line(transport);
        let mut link = Self { address: address.to_string(), epoch, out, heard, ended, thread: Some(thread) };
        link.place()?;
        Ok(link)
    }

    /// The robot of a simulated world in this process.
    #[must_use]
    pub fn simulated(robot: SimulatedRobot, epoch: Instant) -> Self {
        Self::without_line("sim:", epoch, Out::Simulated(robot))
    }

    /// The robot of a recorded run: it takes orders without a word, and whoever plays the run knows what it said.
    #[must_use]
    pub fn recorded(epoch: Instant) -> Self {
        Self::without_line("file:", epoch, Out::Recorded)
    }

    fn without_line(address: &str, epoch: Instant, out: Out) -> Self {
        let heard = Heard::new(epoch);
        let (heard, ended) = (Arc::new(Mutex::new(heard)), Arc::new(AtomicBool::new(false)));
        Self { address: address.to_owned(), epoch, out, heard, ended, thread: None }
    }

    /// Gives an order.
    ///
    /// # Errors
    /// [`RobotError::Broken`].
    pub fn order(&mut self, order: RobotOrder) -> Result<(), RobotError> {
        match &mut self.out {
            Out::Simulated(robot) => {
                robot.order(order);
                Ok(())
            }
            Out::Recorded => Ok(()),
            Out::Line(transport) => writeln!(transport, "{order}")
                .map_err(|error| RobotError::Broken { address: self.address.clone(), reason: error.to_string() }),
        }
    }

    /// The places that came since this was last asked, with the host's time of their arrival; of a robot in this process
    /// that of the world.
    ///
    /// # Errors
    /// What went wrong with the robot or the link to it: [`RobotError`].
    pub fn places(&mut self) -> Result<Vec<(RobotPlace, Instant)>, RobotError> {
        if let Out::Simulated(robot) = &self.out {
            return Ok(robot.told().into_iter().map(|place| (place, self.epoch)).collect());
        }
        let mut heard = held(&self.heard);
        if let Some(wrong) = heard.wrong.take() {
            return Err(wrong);
        }
        let silence = heard.last.elapsed();
        if silence > ROBOT_SILENCE {
            if let Some(unread) = heard.unread.take() {
                return Err(unread.into());
            }
            return Err(RobotError::Silent { address: self.address.clone(), silence });
        }
        Ok(heard.places.drain(..).collect())
    }

    /// Waits for the next place.
    ///
    /// # Errors
    /// As [`RobotLink::places`].
    pub fn place(&mut self) -> Result<RobotPlace, RobotError> {
        if let Out::Simulated(robot) = &self.out {
            return Ok(robot.place());
        }
        loop {
            if let Some((place, _)) = self.places()?.pop() {
                return Ok(place);
            }
            std::thread::sleep(POLL);
        }
    }

    /// The robot's clock on the host's, from arrivals: late by the least delay of the link. None for a robot in this
    /// process, whose clock is known.
    #[must_use]
    pub fn clock(&self) -> Option<ClockEstimate> {
        held(&self.heard).clock.estimate()
    }

    /// The robot in this process, if it is one.
    #[must_use]
    pub fn as_simulated(&self) -> Option<&SimulatedRobot> {
        match &self.out {
            Out::Simulated(robot) => Some(robot),
            Out::Line(_) | Out::Recorded => None,
        }
    }
}

/// How often a caller that waits for a place looks.
const POLL: Duration = Duration::from_millis(2);

impl Drop for RobotLink {
    fn drop(&mut self) {
        // Nobody looks after the robot any more; a link that is broken cannot carry it.
        let _ = self.order(RobotOrder::Stop);
        self.ended.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The reading thread.
fn listen(mut transport: Transport, heard: &Mutex<Heard>, ended: &AtomicBool, address: &str, epoch: Instant) {
    let (mut cutter, mut buffer) = (LineCutter::default(), [0; 1024]);
    while !ended.load(Ordering::Relaxed) {
        let length = match transport.read(&mut buffer) {
            Ok(length) => length,
            Err(error) if error.kind() == ErrorKind::TimedOut => continue,
            Err(error) => {
                let reason = error.to_string();
                held(heard).wrong.get_or_insert(RobotError::Broken { address: address.to_owned(), reason });
                return;
            }
        };
        let now = Instant::now();
        let mut heard = held(heard);
        cutter.take(&buffer[..length], |line| match line.and_then(RobotLine::parse) {
            Ok(RobotLine::Place(place)) => {
                heard.last = now;
                heard.since.get_or_insert((place, now));
                heard.unread = None;
                heard.clock.arrived(place.t, now.saturating_duration_since(epoch).as_secs_f64());
                if heard.places.len() == PLACES_KEPT {
                    heard.places.pop_front();
                }
                heard.places.push_back((place, now));
            }
            Ok(RobotLine::Error(words)) => drop(heard.wrong.get_or_insert(RobotError::Refused(words))),
            Err(error) if !heard.seen() => heard.unread = Some(error),
            Err(error) => drop(heard.wrong.get_or_insert(error.into())),
        });
        if !heard.seen() {
            heard.unread = cutter.begun().or(heard.unread.take());
        }
        heard.look_at_clock(address);
    }
}

impl Heard {
    /// Nothing yet, at a time.
    fn new(now: Instant) -> Self {
        Self {
            places: VecDeque::new(),
            clock: ClockMap::default(),
            last: now,
            since: None,
            too_fast: None,
            unread: None,
            wrong: None,
        }
    }

    /// Whether the robot's clock goes on as the host's does, for what is due is due by it.
    fn look_at_clock(&mut self, address: &str) {
        let Some(&last) = self.places.back() else { return };
        let Some((place, arrived)) = self.since else { return };
        let (robot_s, host_s) = (last.0.t - place.t, last.1.saturating_duration_since(arrived));
        if host_s < CLOCK_LOOK {
            return;
        }
        self.since = Some(last);
        let host_s = host_s.as_secs_f64();
        let [least, most] = CLOCK_RATES;
        let well = (least * host_s..=most * host_s).contains(&robot_s);
        let before = std::mem::replace(&mut self.too_fast, (!well).then_some(robot_s > host_s));
        if !well && before == self.too_fast {
            self.wrong.get_or_insert(RobotError::Clock { address: address.to_owned(), robot_s, host_s });
        }
    }

    /// Whether any place has come.
    fn seen(&self) -> bool {
        self.since.is_some()
    }
}
