//! `palpate simulate-device`.

use std::io::{self, BufRead as _, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate::simulated_device::{Config, Line, Moment, Pace, SimulatedDevice};
use palpate_shared::sim::{Contact, Faults, FloatingBus, Load};

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
    #[arg(long, default_value_t = 0)]
    seed: u64,

    /// Speed of the line in baud [default: as fast as it goes]
    #[arg(long, value_name = "BAUD")]
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
release                  let go
wait SECONDS             read the next order after so much of the device's time
fault none|absent|silent|open0|open1|saturate0|saturate1|stuck|bits RATE
unplug | plug            pull the cable, plug it in again
restart                  switch off and on
truth                    what presses now
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
    .into_diagnostic()
    .wrap_err("cannot start the simulated device")?;
    say(&device.address().to_string())?;
    if arguments.detached {
        loop {
            std::thread::park();
        }
    }
    for line in io::stdin().lock().lines() {
        match Order::parse(&line.into_diagnostic()?) {
            Ok(Order::Quit) => break,
            Ok(order) => say(&carry_out(&device, order).into_diagnostic()?)?,
            Err(complaint) => say(&complaint)?,
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Prints a line at once, so that a program at the other end of a pipe can wait for it.
fn say(line: &str) -> miette::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).into_diagnostic()
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
            ["wait", seconds] => Self::Wait(f64::from(not_negative(seconds, "the time")?)),
            ["restart"] => Self::Restart,
            ["release"] => Self::Load(Load::Released),
            ["force", x, y] => Self::Load(Load::Force([number(x)?, number(y)?])),
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

fn contact(angle_deg: &str, force: &str, mu: &str) -> Result<Contact, String> {
    Ok(Contact {
        angle: number(angle_deg)?.to_radians(),
        normal_force: not_negative(force, "the force")?,
        friction_angle: number(mu)?.atan(),
    })
}

fn sweep(from_deg: &str, to_deg: &str, seconds: &str, force: &str) -> Result<Load, String> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to lie within range")]
    let duration_us = match not_negative(seconds, "the time")? {
        seconds if seconds <= 4000.0 => (f64::from(seconds) * 1e6) as u32,
        seconds => return Err(format!("the sweep takes {seconds} s; the longest is 4000 s")),
    };
    Ok(Load::Sweep { from: contact(from_deg, force, "0")?, to_angle: number(to_deg)?.to_radians(), duration_us })
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
        Order::Truth => device.now()?,
        Order::Wait(seconds) => wait(device, seconds)?,
        Order::Help => return Ok(ORDERS.to_owned()),
        Order::Quit => return Ok(String::new()),
    };
    Ok(in_words(&moment))
}

/// Waits until so much of the device's time has passed.
fn wait(device: &SimulatedDevice, seconds: f64) -> io::Result<Moment> {
    let time_s = |moment: &Moment| moment.truth.time_ns as f64 * 1e-9;
    let mut moment = device.now()?;
    let until_s = time_s(&moment) + seconds;
    while time_s(&moment) < until_s {
        // One tick of the simulation.
        std::thread::sleep(Duration::from_millis(1));
        moment = device.now()?;
    }
    Ok(moment)
}

fn in_words(moment: &Moment) -> String {
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
            ("sweep 0 90 1e9 2", "longest"),
            ("force nan 0", "nan"),
            ("dance", "dance"),
        ] {
            let complaint = Order::parse(line).unwrap_err();
            assert!(complaint.contains(word), "{line}: {complaint}");
        }
    }
}
