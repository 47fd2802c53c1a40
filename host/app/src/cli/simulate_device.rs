//! `palpate simulate-device`.

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Vector2;
use palpate::FingerMotion;
use palpate_device::simulated::{
    CarriedCourse, Config, Injected, InjectedOnLink, Line, LinkFaults, Pace, SimulatedDevice, SimulatedMoment,
};
use palpate_files::motion;
use palpate_files::recordings::csv;
use palpate_shared::front_ends::{FRONT_ENDS, FrontEndKind};
use palpate_shared::sim::{
    BridgesConfig, CarriedConfig, Channels, ContactLoad, Faults, FingerConfig, FloatingBus, Load, MICROSTRAIN,
};

use super::read::lines_of_stdin;
use super::switches::BOARD_INPUTS;
use crate::advice::Advise as _;
use crate::live::interrupt;
use crate::thesis::demonstration::{carried, in_the_air, unmoved};

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

    /// Break the front-end from the start, as the order `fault` does: --fault "bits 0.001 hum 5"
    #[arg(long, value_name = "FAULTS", value_parser = faults_of)]
    fault: Option<Faults>,

    /// Make the line bad from the start, as the order `line` does: --line "drop 0.01 delay 5"
    #[arg(long, value_name = "FAULTS", value_parser = link_faults_of)]
    line: Option<LinkFaults>,

    /// Frequency of the mains whose hum the wires pick up, Hz
    #[arg(long, value_name = "HZ", default_value_t = 50.0, value_parser = mains)]
    mains_hz: f32,

    /// Part of gravity across the finger, its axes, m/s²: X,Y of a finger that is mounted tilted
    #[arg(long, value_name = "X,Y", value_parser = gravity, allow_hyphen_values = true, default_value = "0,0")]
    gravity: [f32; 2],

    /// Converter: ADS131M02, or ADS131M04, which also measures the excitation and an NTC
    #[arg(long, value_name = "NAME", value_parser = front_end, default_value = FrontEndKind::Ads131m02.facts().name)]
    front_end: FrontEndKind,

    /// Run until killed, without reading orders
    #[arg(long)]
    detached: bool,
}

/// A converter by its name.
fn front_end(text: &str) -> Result<FrontEndKind, String> {
    let names = || FRONT_ENDS.map(|facts| facts.name).join(" or ");
    FrontEndKind::named(text).ok_or_else(|| format!("no converter is called {text:?}; it is {}", names()))
}

/// By how much the excitation is off, told in percent, as a ratio.
fn of_excitation(text: &str) -> Result<f32, String> {
    match number(text)? {
        percent if (-50.0..=50.0).contains(&percent) => Ok(percent / 100.0),
        percent => Err(format!("an excitation that is off by {percent} % is none; give at most 50 %")),
    }
}

/// A frequency of the mains.
fn mains(text: &str) -> Result<f32, String> {
    match number(text)? {
        hertz if (10.0..=400.0).contains(&hertz) => Ok(hertz),
        hertz => Err(format!("mains of {hertz} Hz are none; it lies within 10 and 400")),
    }
}

/// A part of gravity.
fn gravity(text: &str) -> Result<[f32; 2], String> {
    let (x, y) = text.split_once(',').ok_or_else(|| format!("{text:?} is not two numbers with a comma between"))?;
    let part = |text: &str| at_most(number(text.trim())?, GRAVITY_MAX, "the part of gravity in m/s²");
    Ok([part(x)?, part(y)?])
}

/// More of gravity cannot be across a finger, in m/s².
const GRAVITY_MAX: f32 = 9.9;

/// What can be typed.
const ORDERS: &str = "\
press ANGLE FORCE [MU]   press at ANGLE degrees with FORCE newtons, on the edge of the friction cone MU
sweep FROM TO SECONDS FORCE   move a contact round the disk, angles in degrees
force X Y                push with this force on the disk, in newtons
play FILE [MOTION [input N]]   push with the forces in a table of t, Fx, Fy: on
                         the disk, in newtons; the clamp moves as a motion
                         file says meanwhile, or rests; input N is high then,
                         as by a robot that tells so
carry MOTION             move the clamp as a motion file says, in the air
release                  let go
wait SECONDS             read the next order after so much of the device's time
fault WORDS              break the front-end; one or more of: none, absent,
                         silent (no data-ready), stuck (codes repeat), open0,
                         open1 (gauges), saturate0, saturate1, bits RATE (bit
                         errors on its bus), drift UM_M_PER_S, hum UM_M,
                         excitation PERCENT (by how much it is off)
line WORDS               break the line, both ways; one or more of: none,
                         drop P, corrupt P, duplicate P, noise P (chance for a
                         frame), stall P MS, delay MS, pieces (reads cut
                         anywhere), unplug S, restart S (once in S seconds)
counts                   what was injected on the line so far
inputs LEVELS [at SECONDS]   set the board's digital inputs: eight digits 0
                         or 1, input 7 first; at a time since the start
                         exactly, or now, some milliseconds late
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
        faults: arguments.fault.unwrap_or_default(),
        link_faults: arguments.line.unwrap_or_default(),
        pace: if arguments.as_read { Pace::AsRead } else { Pace::RealTime },
        line,
        baud: arguments.baud,
        finger: FingerConfig {
            bridges: BridgesConfig { hum_hz: arguments.mains_hz, ..BridgesConfig::default() },
            channels: match arguments.front_end {
                FrontEndKind::Ads131m02 => Channels::Two,
                FrontEndKind::Ads131m04 => Channels::Four,
            },
            ..FingerConfig::default()
        },
        carried: CarriedConfig { gravity: arguments.gravity, ..CarriedConfig::default() },
        carried_by: None,
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
            Ok(line) => match line.and_then(|line| Order::parse(&line)) {
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

/// Orders that wait to be carried out; whoever writes more waits.
const ORDERS_WAITING: usize = 64;

/// Lines of standard input or why they are none, read by a thread of their own.
pub(super) fn lines_of_input() -> miette::Result<Receiver<Result<String, String>>> {
    let (sender, receiver) = sync_channel(ORDERS_WAITING);
    let read = move || {
        for (_, line) in lines_of_stdin().map_while(Result::ok) {
            let line = line.map_or_else(|why| Err(format!("the order cannot be used: {why}")), Ok);
            if sender.send(line).is_err() {
                return;
            }
        }
    };
    std::thread::Builder::new().name("orders".to_owned()).spawn(read).into_diagnostic()?;
    Ok(receiver)
}

/// One line of input, understood.
#[derive(Clone, Debug, PartialEq)]
enum Order {
    Load(Load),
    Faults(Faults),
    LinkFaults(LinkFaults),
    /// A bit for each input, and from when on, s since the device was started.
    Inputs(u8, Option<f64>),
    Counts,
    Unplug,
    PlugIn,
    Restart,
    Truth,
    Wait(f64),
    Play(CarriedCourse),
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
            ["carry", ..] => Self::Play(in_the_air(&clamp_motion(line.trim_start_matches("carry").trim())?)),
            ["play", ..] => Self::Play(played(line.trim_start_matches("play").trim())?),
            ["press", angle, force] => Self::Load(Load::Static(contact(angle, force, "0")?)),
            ["press", angle, force, mu] => Self::Load(Load::Static(contact(angle, force, mu)?)),
            ["sweep", from, to, seconds, force] => Self::Load(sweep(from, to, seconds, force)?),
            ["fault", words @ ..] => Self::Faults(faults(words)?),
            ["line", words @ ..] => Self::LinkFaults(link_faults(words)?),
            ["inputs", levels] => Self::Inputs(input_levels(levels)?, None),
            ["inputs", levels, "at", seconds] => Self::Inputs(input_levels(levels)?, Some(exact_time_s(seconds)?)),
            ["counts"] => Self::Counts,
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

/// Largest force, in N. The default beam has 9.5 MPa for each newton at its gauges and 10.3 at its clamp: from 23 N on
/// structural steel (235 MPa, EN 10025-2) stays bent, which the simulation does not know.
const FORCE_MAX_N: f32 = 20.0;

/// Largest angle, in degrees, for sweeps of many turns; beyond it single precision makes angles coarse.
const ANGLE_MAX_DEG: f32 = 36_000.0;

/// Longest time that an order may take, in s.
const TIME_MAX_S: f32 = 4000.0;

fn at_most(value: f32, limit: f32, what: &str) -> Result<f32, String> {
    if value.abs() <= limit { Ok(value) } else { Err(format!("{what} is {value}, and the limit is {limit}")) }
}

/// Levels of the eight digital inputs, input 7 first.
fn input_levels(word: &str) -> Result<u8, String> {
    let levels = Some(word).filter(|word| word.len() == 8).and_then(|word| u8::from_str_radix(word, 2).ok());
    levels.ok_or_else(|| format!("`{word}` is not eight digits 0 or 1, input 7 first"))
}

fn force(word: &str) -> Result<f32, String> {
    bearable(number(word)?)
}

/// A force under which the finger's beam springs back.
fn bearable(newtons: f32) -> Result<f32, String> {
    if newtons.abs() <= FORCE_MAX_N {
        Ok(newtons)
    } else {
        Err(format!("{newtons} N would bend the finger's beam for good, and the limit is {FORCE_MAX_N} N"))
    }
}

fn angle(word: &str) -> Result<f32, String> {
    Ok(at_most(number(word)?, ANGLE_MAX_DEG, "the angle in degrees")?.to_radians())
}

/// The same to the microsecond, for which single precision is too coarse.
fn exact_time_s(word: &str) -> Result<f64, String> {
    time_s(word)?;
    word.parse().map_err(|_| format!("`{word}` is not a number"))
}

fn time_s(word: &str) -> Result<f32, String> {
    at_most(not_negative(word, "the time")?, TIME_MAX_S, "the time in s")
}

fn contact(angle_deg: &str, newtons: &str, mu: &str) -> Result<ContactLoad, String> {
    let normal_force = bearable(not_negative(newtons, "the force")?)?;
    let contact = ContactLoad { angle: angle(angle_deg)?, normal_force, friction_angle: number(mu)?.atan() };
    // Friction adds to what the beam bears.
    let [x, y] = contact.force_finger();
    bearable(x.hypot(y)).map(|_| contact)
}

fn sweep(from_deg: &str, to_deg: &str, seconds: &str, newtons: &str) -> Result<Load, String> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 4000 s, and not negative")]
    let duration_us = (f64::from(time_s(seconds)?) * 1e6) as u32;
    Ok(Load::Sweep { from: contact(from_deg, newtons, "0")?, to_angle: angle(to_deg)?, duration_us })
}

/// Time between forces that are played, s: one conversion.
const PLAY_STEP_S: f64 = 250e-6;

/// A file of forces, and perhaps one of a motion, and an input that tells of it.
fn played(words: &str) -> Result<CarriedCourse, String> {
    let told = words.rsplit_once(char::is_whitespace).and_then(|(before, input)| {
        let (files, word) = before.trim_end().rsplit_once(char::is_whitespace)?;
        (word == "input").then(|| (files.trim_end(), input))
    });
    let Some((files, input)) = told else { return played_files(words) };
    let input = input.parse::<u8>().ok().filter(|input| usize::from(*input) < BOARD_INPUTS);
    let input =
        input.ok_or_else(|| format!("a board has inputs 0 to {}: `{words}` names another", BOARD_INPUTS - 1))?;
    Ok(played_files(files)?.with_moving_input(input))
}

/// A file of forces, and perhaps one of a motion. A path may hold blanks: what is a file as a whole is one.
fn played_files(words: &str) -> Result<CarriedCourse, String> {
    let both = words.rsplit_once(char::is_whitespace).filter(|_| !Path::new(words).exists());
    let (forces, motion) = match both {
        Some((forces, motion)) => (forces.trim_end(), Some(clamp_motion(motion)?)),
        None => (words, None),
    };
    Ok(match motion {
        Some(motion) => carried(PLAY_STEP_S, forces_of(forces)?, &motion),
        None => unmoved(PLAY_STEP_S, forces_of(forces)?),
    })
}

fn clamp_motion(path: &str) -> Result<FingerMotion, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("cannot read `{path}`: {error}"))?;
    let motion = motion::parse(&text).map_err(|error| format!("cannot use `{path}`: {error}"))?;
    let fastest = motion.segments().iter().map(|segment| segment.acceleration.norm()).fold(0.0, f64::max);
    if fastest > ACCELERATION_MAX {
        return Err(format!("`{path}` has {fastest} m/s², and the limit is {ACCELERATION_MAX}"));
    }
    if motion.duration() > f64::from(TIME_MAX_S) {
        return Err(format!("`{path}` lasts {} s, and the limit is {TIME_MAX_S}", motion.duration()));
    }
    Ok(motion)
}

/// Fastest that a clamp may speed up, in m/s²: its own inertia would then bend the beam as 10 N do.
const ACCELERATION_MAX: f64 = 400.0;

/// Forces from a file, evenly spaced, from its first time on, N.
fn forces_of(path: &str) -> Result<impl Iterator<Item = Vector2<f64>>, String> {
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
    let (first, last) = (*first, *last);
    let times = (0_u32..).map(move |step| first.t + f64::from(step) * PLAY_STEP_S);
    let mut next = 0;
    Ok(times.take_while(move |t| *t <= last.t + PLAY_STEP_S).map(move |t| {
        while readings.get(next + 1).is_some_and(|reading| reading.t <= t) {
            next += 1;
        }
        let (from, to) = (&readings[next], readings.get(next + 1).unwrap_or(&last));
        let share = if to.t > from.t { ((t - from.t) / (to.t - from.t)).clamp(0.0, 1.0) } else { 0.0 };
        from.force_finger.lerp(&to.force_finger, share)
    }))
}

/// The faults of a front-end as an option has them.
fn faults_of(text: &str) -> Result<Faults, String> {
    faults(&text.split_whitespace().collect::<Vec<_>>())
}

/// The faults of a line as an option has them.
fn link_faults_of(text: &str) -> Result<LinkFaults, String> {
    link_faults(&text.split_whitespace().collect::<Vec<_>>())
}

/// The word behind `word`, which says how much.
fn argument<'a>(words: &mut std::slice::Iter<'_, &'a str>, word: &str) -> Result<&'a str, String> {
    words.next().copied().ok_or_else(|| format!("`{word}` needs a number behind it"))
}

fn probability(word: &str, what: &str) -> Result<f32, String> {
    match number(word)? {
        chance if (0.0..=1.0).contains(&chance) => Ok(chance),
        chance => Err(format!("{what} is {chance}; it lies between 0 and 1")),
    }
}

/// Largest drift and hum, in microstrain a second and microstrain: five times the converter's range at gain 32.
const MICROSTRAIN_MAX: f32 = 1e5;

fn microstrain(word: &str, what: &str) -> Result<f32, String> {
    Ok(at_most(number(word)?, MICROSTRAIN_MAX, what)? * MICROSTRAIN)
}

/// What is broken in the front-end, all of it together.
fn faults(words: &[&str]) -> Result<Faults, String> {
    let (mut faults, mut rest) = (Faults::default(), words.iter());
    while let Some(&word) = rest.next() {
        match word {
            "none" => faults = Faults::default(),
            "absent" => faults.chip_absent = Some(FloatingBus::High),
            "silent" => faults.data_ready_stuck = true,
            "open0" => faults.open_gauge[0] = true,
            "open1" => faults.open_gauge[1] = true,
            "saturate0" => faults.saturated[0] = true,
            "saturate1" => faults.saturated[1] = true,
            "stuck" => faults.stuck_codes = true,
            "bits" => faults.bit_error_rate = probability(argument(&mut rest, word)?, "the bit error rate")?,
            "drift" => faults.drift_per_s = microstrain(argument(&mut rest, word)?, "the drift in um/m a second")?,
            "excitation" => faults.excitation_change = of_excitation(argument(&mut rest, word)?)?,
            "hum" => faults.hum_peak_to_peak = microstrain(argument(&mut rest, word)?, "the hum in um/m")?.abs(),
            _ => return Err(format!("no such fault: `{word}`; `help` lists them")),
        }
    }
    if words.is_empty() { Err("which fault? `help` lists them".to_owned()) } else { Ok(faults) }
}

/// What is wrong with the line, all of it together.
fn link_faults(words: &[&str]) -> Result<LinkFaults, String> {
    let (mut faults, mut rest) = (LinkFaults::default(), words.iter());
    while let Some(&word) = rest.next() {
        let line = &mut faults.line;
        let mut chance = || argument(&mut rest, word).and_then(|chance| probability(chance, word)).map(f64::from);
        match word {
            "none" => faults = LinkFaults::default(),
            "drop" => line.drop = chance()?,
            "corrupt" => line.corrupt = chance()?,
            "duplicate" => line.duplicate = chance()?,
            "noise" => line.noise = chance()?,
            "stall" => {
                line.stall = chance()?;
                line.stall_s = f64::from(time_s(argument(&mut rest, word)?)?) * 1e-3;
            }
            "delay" => line.delay_s = f64::from(time_s(argument(&mut rest, word)?)?) * 1e-3,
            "pieces" => line.pieces = true,
            "unplug" => faults.unplug_every_s = f64::from(time_s(argument(&mut rest, word)?)?),
            "restart" => faults.restart_every_s = f64::from(time_s(argument(&mut rest, word)?)?),
            _ => return Err(format!("no such fault of a line: `{word}`; `help` lists them")),
        }
    }
    if words.is_empty() { Err("which fault of the line? `help` lists them".to_owned()) } else { Ok(faults) }
}

/// Does what was ordered and says what holds from now on.
fn carry_out(device: &SimulatedDevice, order: Order) -> io::Result<String> {
    let moment = match order {
        Order::Load(load) => return device.set_load(load).map(|moment| load_in_words(&load, &moment)),
        Order::Play(course) => {
            // A log that was not tared begins with its offset, which acts like any force.
            let [x, y] = course.at(0.0).unwrap_or_default().force;
            let seconds = course.duration_s();
            let what = format!("plays {seconds:.3} s, with forces at first of ({x:.4}, {y:.4}) N, then lets go");
            return device.set_course(course).map(|moment| from_now_on(&moment, &what));
        }
        Order::Faults(faults) => device.set_faults(faults)?,
        Order::Inputs(levels, None) => device.set_inputs(levels)?,
        Order::Inputs(levels, Some(at)) => {
            let moment = device.now()?;
            let now = elapsed_s(&moment);
            if at < now {
                return Ok(format!("{at} s have passed: it is {now:.3} s since the device was started"));
            }
            device.set_inputs_at(at, levels)?
        }
        Order::LinkFaults(faults) => device.set_link_faults(faults)?,
        Order::Counts => return device.injected().map(|injected| injected_in_words(&injected)),
        Order::Unplug => device.unplug()?,
        Order::PlugIn => device.plug_in()?,
        Order::Restart => device.restart()?,
        Order::Truth => device.now()?,
        Order::Wait(seconds) => wait(device, seconds)?,
        Order::Help => return Ok(ORDERS.to_owned()),
        Order::Quit => return Ok(String::new()),
    };
    Ok(in_words(&moment))
}

/// What the line did, in one line.
fn injected_in_words(injected: &InjectedOnLink) -> String {
    let way = |name: &str, way: &Injected| {
        format!(
            "{name}: {} frames dropped, {} corrupted, {} doubled, {} bursts of noise, {} stalls; {} samples lost, {} doubled",
            way.dropped, way.corrupted, way.duplicated, way.noise, way.stalled, way.samples_lost, way.samples_repeated
        )
    };
    let (to_host, to_device) = (way("to the host", &injected.to_host), way("to the device", &injected.to_device));
    format!("{to_host}. {to_device}. {} times unplugged, {} restarts", injected.unplugged, injected.restarted)
}

/// Time since the device was started, s.
fn elapsed_s(moment: &SimulatedMoment) -> f64 {
    moment.truth.time_ns as f64 * 1e-9
}

/// Waits until so much of the device's time has passed.
fn wait(device: &SimulatedDevice, seconds: f64) -> io::Result<SimulatedMoment> {
    let mut moment = device.now()?;
    let until_s = elapsed_s(&moment) + seconds;
    while elapsed_s(&moment) < until_s && !interrupt::requested() {
        // One tick of the simulation.
        std::thread::sleep(Duration::from_millis(1));
        moment = device.now()?;
    }
    Ok(moment)
}

/// What was ordered, not what still acts at the moment of the order: a load takes 20 ms to give way to the next.
fn load_in_words(load: &Load, moment: &SimulatedMoment) -> String {
    let [x, y] = load.force_at(0);
    let force = format!("force on the finger ({x:.4}, {y:.4}) N");
    let what = match load {
        Load::Released => "lets go: no contact, no force".to_owned(),
        Load::Static(contact) => format!("contact at {:.3} deg, {force}", contact.angle.to_degrees()),
        Load::Sweep { from, to_angle, duration_us } => format!(
            "contact from {:.3} to {:.3} deg in {:.3} s, at first {force}",
            from.angle.to_degrees(),
            to_angle.to_degrees(),
            f64::from(*duration_us) * 1e-6
        ),
        Load::Force(_) => format!("no contact, {force}"),
    };
    from_now_on(moment, &what)
}

fn from_now_on(moment: &SimulatedMoment, what: &str) -> String {
    format!("from conversion {} on: {what}", moment.conversion)
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
        assert_eq!(Order::parse("inputs 10000101"), Ok(Order::Inputs(0x85, None)));
        assert_eq!(Order::parse("inputs 10000101 at 3600.000125"), Ok(Order::Inputs(0x85, Some(3_600.000_125))));
        assert!(Order::parse("inputs 1000010").is_err() && Order::parse("inputs 2000010x").is_err());
        assert_eq!(Order::parse("force 1 -2.5"), Ok(Order::Load(Load::Force([1.0, -2.5]))));
    }

    #[test]
    fn faults_are_combined_in_one_order() {
        let Ok(Order::Faults(faults)) = Order::parse("fault bits 0.001 open1 drift -2 hum 5") else { panic!() };
        assert!((faults.bit_error_rate - 1e-3).abs() < 1e-9 && faults.open_gauge == [false, true]);
        assert!((faults.drift_per_s / MICROSTRAIN + 2.0).abs() < 1e-5, "{faults:?}");
        assert!((faults.hum_peak_to_peak / MICROSTRAIN - 5.0).abs() < 1e-5, "{faults:?}");
        let order = Order::parse("line drop 0.25 stall 0.5 20 delay 5 pieces unplug 10 restart 60");
        let Ok(Order::LinkFaults(faults)) = order else { panic!("{order:?}") };
        let line = faults.line;
        assert!((line.drop - 0.25).abs() < 1e-9 && (line.stall - 0.5).abs() < 1e-9 && line.pieces);
        assert!((line.stall_s - 0.02).abs() < 1e-9 && (line.delay_s - 0.005).abs() < 1e-9);
        assert!((faults.unplug_every_s - 10.0).abs() < 1e-9 && (faults.restart_every_s - 60.0).abs() < 1e-9);
        assert_eq!(Order::parse("line none"), Ok(Order::LinkFaults(LinkFaults::default())));
    }

    #[test]
    fn an_order_is_confirmed_by_what_it_asks_for_and_not_by_what_was_before() {
        let device = SimulatedDevice::start(Config { pace: Pace::AsRead, ..Config::default() }).unwrap();
        let answer = |line: &str| carry_out(&device, Order::parse(line).unwrap()).unwrap();
        for (line, confirmed) in [
            ("press 0 2", "contact at 0.000 deg, force on the finger (-2.0000, 0.0000) N"),
            ("press 90 2", "contact at 90.000 deg, force on the finger (0.0000, -2.0000) N"),
            ("force 1 -2.5", "no contact, force on the finger (1.0000, -2.5000) N"),
            ("release", "lets go: no contact, no force"),
            ("sweep 0 90 2 1", "contact from 0.000 to 90.000 deg in 2.000 s, at first force on the finger (-1.0000"),
        ] {
            // Zeros have either sign.
            let said = answer(line).replace("-0.0000", "0.0000");
            assert!(said.starts_with("from conversion ") && said.contains(confirmed), "{line}: {said}");
        }
    }

    #[test]
    fn what_cannot_be_meant_is_refused_with_a_reason() {
        for (line, word) in [
            ("press 90 -2", "negative"),
            ("press north 2", "north"),
            ("fault bits 3", "between 0 and 1"),
            ("fault fire", "fire"),
            ("fault", "which"),
            ("fault bits", "number"),
            ("fault drift 1e9", "100000"),
            ("line fire", "fire"),
            ("line drop 1.5", "between 0 and 1"),
            ("line stall 0.5", "number"),
            ("line unplug -1", "negative"),
            ("sweep 0 90 1e9 2", "4000"),
            ("press 0 1e38", "20 N"),
            ("press 30 200", "20 N"),
            ("press 30 19 0.9", "20 N"),
            ("force 0 -21", "20 N"),
            ("sweep 0 90 1 21", "20 N"),
            ("press 1e38 1", "36000"),
            ("wait 1e30", "4000"),
            ("force nan 0", "nan"),
            ("play /nowhere/forces.csv", "/nowhere/forces.csv"),
            ("play /nowhere/forces.csv /nowhere/motion.toml input 8", "inputs 0 to 7"),
            ("dance", "dance"),
        ] {
            let complaint = Order::parse(line).unwrap_err();
            assert!(complaint.contains(word), "{line}: {complaint}");
        }
    }
}
