//! `palpate friction`.

use std::path::PathBuf;
use std::process::ExitCode;

use palpate::pushing::estimation::friction::{ContactFrictionTold, FrictionTold, Told, friction_told};
use palpate::pushing::estimation::{Estimate, from_rest};
use palpate_files::part::PolygonFile;
use serde_json::{Value, json};

use super::read::{read_beside, tell_part};
use super::watched_push::{MotionArgument, MuUncertainty, WatchedPushArguments};
use super::{lacking, misfit, positive};
use crate::threads::PATIENT;
use crate::width::folded;

const LONG_HELP: &str = "\
Push as for `palpate observe`, on the surface that is to be measured: accelerate by 0.15 m/s² or more, then turn aside. The
part may lie anywhere. What explains the force has a friction each; they are taken together by their probabilities.

A push tells mu times the mass best. Weigh the part and say so with --mass-g: then mu is as exact as that product. Without, the
force while the finger accelerates tells the two apart, as exactly as the answer says. mu_c is told if the contact slipped; if not,
it is what sticking took or more: turn aside more sharply.

The part file is that of `palpate push`. Its mu is where the search begins, good to a factor of three (--mu-uncertainty).

Exit status: 0; 1 if nothing explains the push, or something cannot be used; 3 if samples of the push were no measurements
(saturated, stuck, settling) or the device started anew; 64 wrong command line.";

/// Measures the friction of a plane, and that at the finger, by pushing a known part.
///
/// Live from a device, or from a file of forces. Prints mu, mu_c and the part's mass with what they may be, as lines for the
/// part file.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// The part file
    #[arg(long, value_name = "PART.toml")]
    part: PathBuf,

    #[command(flatten)]
    motion: MotionArgument,

    /// What the part weighs, g: VALUE or VALUE,SIGMA (without SIGMA known to 0.5 %)
    #[arg(long, value_name = "G", value_parser = mass)]
    mass_g: Option<Mass>,

    /// Print one JSON object: SI units
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    push: WatchedPushArguments,
}

/// A mass as told.
#[derive(Clone, Copy, Debug)]
struct Mass(Told);

/// What a kitchen balance is good for.
const WEIGHED_SHARE: f64 = 0.005;

fn mass(text: &str) -> Result<Mass, String> {
    let (value, sigma) = match text.split_once(',') {
        Some((value, sigma)) => (positive(value.trim())?, positive(sigma.trim())?),
        None => positive(text.trim()).map(|value| (value, WEIGHED_SHARE * value))?,
    };
    if sigma < value {
        Ok(Mass(Told { value: value * 1e-3, log_sd: sigma / value }))
    } else {
        Err(format!("{text} tells nothing: its standard deviation is as large as the mass"))
    }
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    arguments.push.begin_recording()?;
    if arguments.push.felt.mu_is_exact() {
        let help = "say how well it is known, such as x3, or nothing";
        return Err(miette::miette!(help = help, "a mu that is known exactly is not measured"));
    }
    let file = read_beside(&arguments.part, PolygonFile::parse_beside)?;
    tell_part(&arguments.part, file.part.polygon().vertices(), file.part.body(), &file.doubts());
    let watched = arguments.push.with_mu_uncertainty(MuUncertainty::UNMEASURED);
    let push = watched.watch_to_its_end(&arguments.motion.file)?;
    let (force, known, tally) = (push.force()?, push.known(&file), push.watch.tally());
    let estimate = from_rest::estimate_until(&known, &force, &PATIENT).found;
    let weighed = arguments.mass_g.map(|Mass(mass)| mass);
    let Some(told) = friction_told(&estimate, weighed) else {
        return Err(unexplained(&estimate, weighed, || misfit::explain(&known, &force)));
    };
    if arguments.json {
        let mut object = as_json(&told, &estimate);
        object["samples"] = lacking::as_json(&tally);
        say!("{object}");
    } else {
        lines(&told).iter().for_each(|line| say!("{line}"));
        say!("{}", folded(&in_words(&told, &estimate, weighed.is_some())));
    }
    Ok(lacking::status(&tally))
}

fn unexplained(estimate: &Estimate, weighed: Option<Told>, explain: impl FnOnce() -> String) -> miette::Report {
    match (weighed, estimate.hypotheses.first().and_then(|best| best.from_force)) {
        (Some(mass), Some(best)) => miette::miette!(
            help = "is it this part, and are the forces in newtons? Leave --mass-g out to see what the push says alone",
            "no explanation of the push has a mass of {:.1} g: the likeliest one has {:.1} g",
            mass.value * 1e3,
            best.mass * 1e3
        ),
        _ => miette::miette!(help = explain(), "no pose of this part explains the push, so that it tells no friction"),
    }
}

/// What goes into a part file, with what it may be.
fn lines(told: &FrictionTold) -> Vec<String> {
    let line = |name: &str, told: &Told, scale: f64, unit: &str| {
        let [low, high] = told.interval().map(|value| value * scale);
        format!(
            "{name} = {:<8.4} # ± {:.1} %, 95 %: {low:.4} to {high:.4}{unit}",
            told.value * scale,
            100.0 * told.log_sd
        )
    };
    let mu_c = match &told.mu_c {
        ContactFrictionTold::Slipped(mu_c) => line("mu_c", mu_c, 1.0, ""),
        // Rounded down, so that it is true.
        ContactFrictionTold::AtLeast(least) => {
            format!("# mu_c: {:.3} or more, the contact did not slip", (least * 1e3).floor() * 1e-3)
        }
    };
    vec![
        line("mu", &told.mu, 1.0, ""),
        mu_c,
        line("# mass", &told.mass, 1e3, " g"),
        line("# mu times mass", &told.resistance, 1e3, " g"),
    ]
}

/// A µ that is known worse than this does little good.
const POOR: f64 = 0.1;

/// A product that is known so many times better than µ says that the mass is what is lacking.
const BY_MASS: f64 = 3.0;

fn in_words(told: &FrictionTold, estimate: &Estimate, is_weighed: bool) -> String {
    let mut words = match estimate.hypotheses.len() {
        1 => "One pose explains the push.".to_owned(),
        several => format!("{several} poses explain the push, and all of them count."),
    };
    if !is_weighed && told.mu.log_sd > BY_MASS * told.resistance.log_sd {
        words += " Mass and friction are told apart less well than their product: weigh the part (--mass-g).";
    } else if told.mu.log_sd > POOR {
        words += " That is little: accelerate harder, turn aside, and push for longer.";
    }
    if matches!(told.mu_c, ContactFrictionTold::AtLeast(_)) {
        words += " To measure mu_c turn aside more sharply.";
    }
    words
}

fn as_json(told: &FrictionTold, estimate: &Estimate) -> Value {
    let quantity = |told: &Told| json!({"value": told.value, "log_sd": told.log_sd, "interval_95": told.interval()});
    let mu_c = match &told.mu_c {
        ContactFrictionTold::Slipped(mu_c) => quantity(mu_c),
        ContactFrictionTold::AtLeast(least) => json!({"at_least": least}),
    };
    json!({
        "t": estimate.time_end,
        "poses": estimate.hypotheses.len(),
        "mu": quantity(&told.mu),
        "mu_c": mu_c,
        "mass": quantity(&told.mass),
        "mu_times_mass": quantity(&told.resistance),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::width::COLUMNS;

    #[test]
    fn masses_are_read_with_and_without_their_deviation() {
        let read = |text: &str| mass(text).map(|Mass(told)| [told.value, told.log_sd]);
        assert_eq!(read("512,2.56"), Ok([0.512, 0.005]));
        assert_eq!(read("512"), Ok([0.512, 0.005]));
        for text in ["", "x", "0", "-3", "5,", "5,9"] {
            assert!(mass(text).is_err(), "{text}");
        }
    }

    #[test]
    fn lines_fit_a_terminal_and_a_part_file() {
        let told = Told { value: 0.29876, log_sd: 0.0123 };
        let mass = Told { value: 1.23456, log_sd: 0.2 };
        for mu_c in [ContactFrictionTold::Slipped(told), ContactFrictionTold::AtLeast(0.2999)] {
            let all = lines(&FrictionTold { mu: told, mass, resistance: mass, mu_c });
            assert!(all.iter().all(|line| line.chars().count() <= COLUMNS), "{all:?}");
            let read: toml::Table = all.join("\n").parse().unwrap();
            assert_eq!(read["mu"].as_float(), Some(0.2988), "{all:?}");
            assert_eq!(read.contains_key("mu_c"), matches!(mu_c, ContactFrictionTold::Slipped(_)), "{all:?}");
        }
    }
}
