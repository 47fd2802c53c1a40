//! `palpate simulate-device`.

use std::io::{self, BufRead as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate_device::simulated::{Config, ForceCourse, Line, Pace, SimulatedDevice, SimulatedMoment};
use palpate_files::recordings::csv;
use palpate_shared::sim::{ContactLoad, Faults, FloatingBus, Load};

use crate::advice::Advise as _;
use crate::live::interrupt;

/// Runs a finger without hardware: the firmware on a simulated front-end, behind a pseudo-terminal.
///
/// Prints the path to open, then takes orders from standard input, one a line; `help` lists them. A file of orders with
/// `wait`s between them is a script. Ends with the input's end, or with `quit`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Listen on a TCP port instead of a pseudo-terminal: tcp:HOST:PORT (port 0 takes any free one)
    #[arg(long, value_name = "ADDRESS")]
    listen: Option<String>,

    /// Make a symbolic link that leads to the pseudo-terminal, also after `unplug` and `plug`
    #[arg(long, value_name = "PATH", conflicts_with = "listen")]
    link: Option<PathBuf>,

    /// Seed of everything random
    #[arg(long, default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,

    /// Speed of the line in baud, 9600 or more [default: as fast as it goes]
    #[arg(long, value_name = "BAUD", value_parser = clap::value_parser!(u32).range(9600..))]
    baud: Option<u32>,

    /// Let time pass as fast as the host reads, instead of as on the clock
    #[arg(long)]
    as_read: bool,

    /// Run until killed, without reading orders
    #[arg(long)]
    detached: bool,
}

/// What can be typed.
const ORDERS: &str = "\
press ANGLE FORCE [MU]   press at ANGLE degrees with FORCE newtons, on the edge of the friction cone MU
sweep FROM TO SECONDS FORCE   move a contact round the disk, angles in degrees
force X Y                push with this force on the disk, in newtons
play FILE                push with the forces in a table of t, Fx, Fy: on the disk, in newtons
release                  let go
wait SECONDS             read the next order after so much of the device's time
fault none|absent|silent|open0|open1|saturate0|saturate1|stuck|bits RATE
unplug | plug            pull the cable, plug it in again
restart                  switch off and on
truth (or nothing)       what presses now
quit";

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let line = match &arguments.listen {
        Some(address) => Line::Tcp { host: address.strip_prefix("tcp:").unwrap_or(address).to_owned() },
        None => Line::Pty { link: arguments.link.clone() },
    };
    let device = SimulatedDevice::start(Config {
        seed: arguments.seed,
        pace: if arguments.as_read { Pace::AsRead } else { Pace::RealTime },
        line,
        baud: arguments.baud,
        ..Config::default()
    })
    .advised()
    .wrap_err("cannot start the simulated device")?;
    interrupt::listen();
    say!("{}", device.address());
    if !arguments.detached {
        note!("type `help` for the orders, `quit` to end");
    }
    let orders = if arguments.detached { None } else { Some(lines_of_input()?) };
    while !interrupt::requested() {
        let Some(orders) = &orders else {
            std::thread::sleep(LISTEN_WAIT);
            continue;
        };
        match orders.recv_timeout(LISTEN_WAIT) {
            Ok(line) => match Order::parse(&line) {
                Ok(Order::Quit) => break,
                Ok(order) => say!("{}", carry_out(&device, order).into_diagnostic()?),
                Err(complaint) => say!("{complaint}"),
            },
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// How long to wait for an order before looking whether the user wants to stop.
const LISTEN_WAIT: Duration = Duration::from_millis(100);

/// Lines of standard input, read by a thread of their own; what is not UTF-8 in them is replaced, and refused later.
fn lines_of_input() -> miette::Result<Receiver<String>> {
    let (sender, receiver) = channel();
    std::thread::Builder::new()
        .name("orders".to_owned())
        .spawn(move || {
            let mut input = io::stdin().lock();
            let mut line = Vec::new();
            while let Ok(1..) = input.read_until(b'\n', &mut line) {
                if sender.send(String::from_utf8_lossy(&line).trim().to_owned()).is_err() {
                    return;
                }
                line.clear();
            }
        })
        .into_diagnostic()?;
    Ok(receiver)
}

/// One line of input, understood.
#[derive(Clone, Debug, PartialEq)]
enum Order {
    Load(Load),
    Faults(Faults),
    Unplug,
    PlugIn,
    Restart,
    Truth,
    Wait(f64),
    Play(ForceCourse),
    Help,
    Quit,
}

impl Order {
    fn parse(line: &str) -> Result<Self, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        Ok(match words.as_slice() {
            [] | ["truth"] => Self::Truth,
            ["help"] => Self::Help,
            ["quit"] => Self::Quit,
            ["unplug"] => Self::Unplug,
            ["plug"] => Self::PlugIn,
            ["wait", seconds] => Self::Wait(f64::from(time_s(seconds)?)),
            ["restart"] => Self::Restart,
            ["release"] => Self::Load(Load::Released),
            ["force", x, y] => Self::Load(Load::Force([force(x)?, force(y)?])),
            ["play", ..] => Self::Play(course(line.trim_start_matches("play").trim())?),
            ["press", angle, force] => Self::Load(Load::Static(contact(angle, force, "0")?)),
            ["press", angle, force, mu] => Self::Load(Load::Static(contact(angle, force, mu)?)),
            ["sweep", from, to, seconds, force] => Self::Load(sweep(from, to, seconds, force)?),
            ["fault", words @ ..] => Self::Faults(faults(words)?),
            _ => return Err(format!("cannot read `{line}`; `help` lists the orders")),
        })
    }
}

fn number(word: &str) -> Result<f32, String> {
    word.parse().ok().filter(|value: &f32| value.is_finite()).ok_or_else(|| format!("`{word}` is not a number"))
}

fn not_negative(word: &str, what: &str) -> Result<f32, String> {
    let value = number(word)?;
    if value >= 0.0 { Ok(value) } else { Err(format!("{what} is {value}, and cannot be negative")) }
}

/// Largest force, in N: the default beam would long have bent for good.
const FORCE_MAX_N: f32 = 1000.0;

/// Largest angle, in degrees, for sweeps of many turns; beyond it single precision makes angles coarse.
const ANGLE_MAX_DEG: f32 = 36_000.0;

/// Longest time that an order may take, in s.
const TIME_MAX_S: f32 = 4000.0;

fn at_most(value: f32, limit: f32, what: &str) -> Result<f32, String> {
    if value.abs() <= limit { Ok(value) } else { Err(format!("{what} is {value}, and the limit is {limit}")) }
}

fn force(word: &str) -> Result<f32, String> {
    at_most(number(word)?, FORCE_MAX_N, "the force in N")
}

fn angle(word: &str) -> Result<f32, String> {
    Ok(at_most(number(word)?, ANGLE_MAX_DEG, "the angle in degrees")?.to_radians())
}

fn time_s(word: &str) -> Result<f32, String> {
    at_most(not_negative(word, "the time")?, TIME_MAX_S, "the time in s")
}

fn contact(angle_deg: &str, newtons: &str, mu: &str) -> Result<ContactLoad, String> {
    let normal_force = at_most(not_negative(newtons, "the force")?, FORCE_MAX_N, "the force in N")?;
    Ok(ContactLoad { angle: angle(angle_deg)?, normal_force, friction_angle: number(mu)?.atan() })
}

fn sweep(from_deg: &str, to_deg: &str, seconds: &str, newtons: &str) -> Result<Load, String> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 4000 s, and not negative")]
    let duration_us = (f64::from(time_s(seconds)?) * 1e6) as u32;
    Ok(Load::Sweep { from: contact(from_deg, newtons, "0")?, to_angle: angle(to_deg)?, duration_us })
}

/// Time between forces that are played, s: one conversion.
const PLAY_STEP_S: f64 = 250e-6;

/// Forces from a file, evenly spaced, from its first time on.
fn course(path: &str) -> Result<ForceCourse, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("cannot read `{path}`: {error}"))?;
    let readings = csv::parse(&text).map_err(|error| format!("cannot use `{path}`: {error}"))?.readings;
    let (Some(first), Some(last)) = (readings.first(), readings.last()) else {
        return Err(format!("`{path}` holds no forces"));
    };
    let span = last.t - first.t;
    if span > f64::from(TIME_MAX_S) {
        return Err(format!("`{path}` lasts {span} s, and the limit is {TIME_MAX_S}"));
    }
    if let Some(large) = readings.iter().find(|reading| reading.force_finger.amax() > f64::from(FORCE_MAX_N)) {
        return Err(format!(
            "`{path}` has {} N at t = {} s, and the limit is {FORCE_MAX_N}",
            large.force_finger.amax(),
            large.t
        ));
    }
    let times = std::iter::successors(Some(0.0), |step| Some(step + 1.0)).map(|step| first.t + step * PLAY_STEP_S);
    let mut next = 0;
    let forces = times.take_while(|t| *t <= last.t + PLAY_STEP_S).map(|t| {
        while readings.get(next + 1).is_some_and(|reading| reading.t <= t) {
            next += 1;
        }
        let (from, to) = (&readings[next], readings.get(next + 1).unwrap_or(last));
        let share = if to.t > from.t { ((t - from.t) / (to.t - from.t)).clamp(0.0, 1.0) } else { 0.0 };
        let force = from.force_finger.lerp(&to.force_finger, share);
        #[expect(clippy::cast_possible_truncation, reason = "the simulation computes in single precision")]
        let single = [force.x as f32, force.y as f32];
        single
    });
    Ok(ForceCourse::new(PLAY_STEP_S, forces.collect()))
}

fn faults(words: &[&str]) -> Result<Faults, String> {
    let none = Faults::default();
    Ok(match words {
        ["none"] => none,
        ["absent"] => Faults { chip_absent: Some(FloatingBus::High), ..none },
        ["silent"] => Faults { data_ready_stuck: true, ..none },
        ["open0"] => Faults { open_gauge: [true, false], ..none },
        ["open1"] => Faults { open_gauge: [false, true], ..none },
        ["saturate0"] => Faults { saturated: [true, false], ..none },
        ["saturate1"] => Faults { saturated: [false, true], ..none },
        ["stuck"] => Faults { stuck_codes: true, ..none },
        ["bits", rate] => match number(rate)? {
            rate if (0.0..=1.0).contains(&rate) => Faults { bit_error_rate: rate, ..none },
            rate => return Err(format!("the bit error rate is {rate}; it lies between 0 and 1")),
        },
        _ => return Err(format!("no such fault: `{}`; `help` lists them", words.join(" "))),
    })
}

/// Does what was ordered and says what then is.
fn carry_out(device: &SimulatedDevice, order: Order) -> io::Result<String> {
    let moment = match order {
        Order::Load(load) => device.set_load(load)?,
        Order::Faults(faults) => device.set_faults(faults)?,
        Order::Unplug => device.unplug()?,
        Order::PlugIn => device.plug_in()?,
        Order::Restart => device.restart()?,
        Order::Play(course) => device.set_course(course)?,
        Order::Truth => device.now()?,
        Order::Wait(seconds) => wait(device, seconds)?,
        Order::Help => return Ok(ORDERS.to_owned()),
        Order::Quit => return Ok(String::new()),
    };
    Ok(in_words(&moment))
}

/// Waits until so much of the device's time has passed.
fn wait(device: &SimulatedDevice, seconds: f64) -> io::Result<SimulatedMoment> {
    let elapsed_s = |moment: &SimulatedMoment| moment.truth.time_ns as f64 * 1e-9;
    let mut moment = device.now()?;
    let until_s = elapsed_s(&moment) + seconds;
    while elapsed_s(&moment) < until_s && !interrupt::requested() {
        // One tick of the simulation.
        std::thread::sleep(Duration::from_millis(1));
        moment = device.now()?;
    }
    Ok(moment)
}

fn in_words(moment: &SimulatedMoment) -> String {
    let truth = &moment.truth;
    let [x, y] = truth.force_finger;
    let contact = match truth.contact_angle {
        Some(angle) => format!("contact at {:.3} deg", angle.to_degrees()),
        None => "no contact".to_owned(),
    };
    format!(
        "conversion {}: {contact}, force on the finger ({x:.4}, {y:.4}) N, {:.2} C",
        moment.conversion, truth.temperature_c
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_read_in_degrees_and_newtons() {
        let Ok(Order::Load(Load::Static(contact))) = Order::parse("press 90 2 0.2") else { panic!() };
        assert!((contact.angle - std::f32::consts::FRAC_PI_2).abs() < 1e-6);
        assert!((contact.friction_angle.tan() - 0.2).abs() < 1e-6);
        assert_eq!(Order::parse("  unplug "), Ok(Order::Unplug));
        assert_eq!(Order::parse("force 1 -2.5"), Ok(Order::Load(Load::Force([1.0, -2.5]))));
    }

    #[test]
    fn what_cannot_be_meant_is_refused_with_a_reason() {
        for (line, word) in [
            ("press 90 -2", "negative"),
            ("press north 2", "north"),
            ("fault bits 3", "between 0 and 1"),
            ("fault fire", "fire"),
            ("sweep 0 90 1e9 2", "4000"),
            ("press 0 1e38", "1000"),
            ("press 1e38 1", "36000"),
            ("wait 1e30", "4000"),
            ("force nan 0", "nan"),
            ("play /nowhere/forces.csv", "/nowhere/forces.csv"),
            ("dance", "dance"),
        ] {
            let complaint = Order::parse(line).unwrap_err();
            assert!(complaint.contains(word), "{line}: {complaint}");
        }
    }
}
