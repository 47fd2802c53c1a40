//! `palpate plan-push`.

use std::path::PathBuf;
use std::process::ExitCode;

use palpate::observing::from_rest::{self, Estimate};
use palpate::observing::planning::{self, Felt, MOTION_NAMES, Present, Prospect, Sampling};
use palpate::part_file::PolygonFile;
use serde_json::{Value, json};

use super::demo::read;
use super::felt_push::FeltPushArguments;
use super::{pose, positive};

/// One value a hundredth of a second, s.
const VALUES_EVERY_S: f64 = 0.01;

/// A motion that lowers the risk by less than this share of it is no better than going straight on.
const WORTHWHILE: f64 = 0.1;

const LONG_HELP: &str = "\
Takes the files of `palpate observe`: of a push so far that left several poses possible. Each motion is played ahead from
every pose that is left, and what the finger then would feel is compared pair by pair:

  risk     bound of the probability of naming the wrong pose afterwards
  nearest  the two poses that come apart least; the likeliest is 1
  D²       how far: squared, in standard deviations of the noise and of what is uncertain of both; below 36 they may be confused
  contact  how long every pose keeps the contact, s

What is compared is the direction of the force. A contact that never slipped so far is taken to roll on.

Exit status: 0, also where nothing tells the poses apart; 1 if something cannot be used, 64 wrong command line.";

/// Says how the finger should go on so that the poses still possible can be told apart.
#[derive(Debug, clap::Args)]
#[command(after_long_help = LONG_HELP)]
pub(crate) struct Arguments {
    /// The part file
    #[arg(long, value_name = "PART.toml")]
    part: PathBuf,

    #[command(flatten)]
    push: FeltPushArguments,

    /// How strongly the finger can turn aside or speed up
    #[arg(long, value_name = "MM/S2", value_parser = positive, default_value_t = 80.0)]
    acceleration_mm_s2: f64,

    /// How fast the finger may become: faster motions are left out
    #[arg(long, value_name = "MM/S", value_parser = positive)]
    speed_max_mm_s: Option<f64>,

    /// How long it goes on
    #[arg(long, value_name = "S", value_parser = super::stretch, default_value_t = 0.5)]
    seconds: f64,

    /// Standard deviation of the force's direction, over a hundredth of a second
    #[arg(long, value_name = "DEG", value_parser = positive, default_value_t = 0.112)]
    noise_deg: f64,

    /// Print one JSON object: SI units, radians
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let file = read(&arguments.part, PolygonFile::parse)?;
    let push = arguments.push.read()?;
    let known = push.known(&file);
    let estimate = from_rest::estimate(&known, &push.force);
    let present = estimate.present(&known);
    let plan = Plan { estimate: &estimate, present, motions: arguments.motions(&present)? };
    let prospects = plan.prospects(arguments);
    if arguments.json {
        say!("{}", plan.as_json(&prospects));
        return Ok(ExitCode::SUCCESS);
    }
    say!("{}", pose::HEADINGS);
    pose::lines(&file.part, &estimate).iter().for_each(|line| say!("{line}"));
    say!("{}", pose::in_words(&file.part, &estimate));
    if estimate.hypotheses.len() > 1 {
        say!("\nIf the finger goes on for {} s:", arguments.seconds);
        plan.lines(&prospects).iter().for_each(|line| say!("{line}"));
        say!("{}", plan.in_words(&prospects));
    }
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    /// The motions that the finger can do, with their names.
    fn motions(&self, present: &Present) -> miette::Result<Vec<(&'static str, [f64; 2])>> {
        let velocity = present.velocity;
        if velocity[0].hypot(velocity[1]) <= 0.0 {
            return Err(miette::miette!(
                help = "give a motion that ends under way",
                "the finger stands still at the end of what was felt: there is no straight on"
            ));
        }
        let offered = planning::motions(velocity, self.acceleration_mm_s2 * 1e-3);
        let limit = self.speed_max_mm_s.map_or(f64::INFINITY, |limit| limit * 1e-3);
        let reached = |acceleration: &[f64; 2]| planning::top_speed(velocity, *acceleration, self.seconds);
        let named = MOTION_NAMES.into_iter().zip(offered);
        let possible: Vec<_> = named.filter(|(_, acceleration)| reached(acceleration) <= limit).collect();
        if possible.is_empty() {
            let now = reached(&[0.0; 2]) * 1e3;
            return Err(miette::miette!(
                help = "raise --speed-max-mm-s",
                "no motion stays below {} mm/s: the finger already goes {now:.1} mm/s",
                limit * 1e3
            ));
        }
        Ok(possible)
    }
}

/// What is to be told apart, and by what.
struct Plan<'e> {
    estimate: &'e Estimate,
    present: Present<'e>,
    motions: Vec<(&'static str, [f64; 2])>,
}

impl Plan<'_> {
    fn prospects(&self, arguments: &Arguments) -> Vec<Prospect> {
        let beliefs: Vec<_> = self.estimate.hypotheses.iter().map(from_rest::Hypothesis::belief).collect();
        let accelerations: Vec<_> = self.motions.iter().map(|(_, acceleration)| *acceleration).collect();
        let sampling =
            Sampling { felt: Felt::ForceDirection, dt: VALUES_EVERY_S, sigma: arguments.noise_deg.to_radians() };
        planning::prospects(&self.present, &beliefs, &accelerations, sampling, arguments.seconds)
    }

    fn name(&self, prospect: &Prospect) -> &'static str {
        let found = self
            .motions
            .iter()
            .find(|(_, acceleration)| acceleration.map(f64::to_bits) == prospect.acceleration.map(f64::to_bits));
        found.map_or("", |(name, _)| name)
    }

    fn lines(&self, prospects: &[Prospect]) -> Vec<String> {
        let heading = "  motion            acceleration [mm/s²]      risk   nearest       D²   contact [s]".to_owned();
        std::iter::once(heading).chain(prospects.iter().map(|prospect| self.line(prospect))).collect()
    }

    fn line(&self, prospect: &Prospect) -> String {
        let [x, y] = prospect.acceleration.map(|component| component * 1e3 + 0.0);
        let nearest = prospect
            .nearest()
            .map_or((String::new(), 0.0), |pair| (pose_numbers(pair.hypotheses), pair.distance_squared));
        format!(
            "  {:<16} {x:10.1} {y:10.1} {:8.2} % {:>9} {:8.1} {:13.2}",
            self.name(prospect),
            prospect.risk * 100.0,
            nearest.0,
            nearest.1,
            shortest_contact(prospect)
        )
    }

    /// The recommendation.
    fn in_words(&self, prospects: &[Prospect]) -> String {
        let hopeless = planning::inseparable(prospects);
        let all = prospects.first().map_or(0, |prospect| prospect.pairs.len());
        let told: Vec<_> = hopeless.iter().map(|pair| pose_numbers(*pair)).collect();
        if hopeless.len() == all {
            return "The poses cannot be told apart by any of these motions.".to_owned();
        }
        let mut words = match (prospects.first(), prospects.iter().find(|p| is_none(p.acceleration))) {
            (Some(best), Some(straight)) if best.risk >= (1.0 - WORTHWHILE) * straight.risk => {
                "Go straight on: no other of these motions does much better.".to_owned()
            }
            (Some(best), _) => format!("Go {}.", self.name(best)),
            (None, _) => String::new(),
        };
        if !told.is_empty() {
            words += &format!(" Poses {} cannot be told apart by any of these motions.", told.join(", "));
        }
        words
    }

    fn as_json(&self, prospects: &[Prospect]) -> Value {
        let recommended = prospects.first().filter(|prospect| !prospect.pairs.is_empty());
        json!({
            "estimate": pose::as_json(self.estimate),
            "motions": prospects.iter().map(|prospect| self.prospect_as_json(prospect)).collect::<Vec<_>>(),
            "recommended": recommended.map(|prospect| self.name(prospect)),
            "inseparable": planning::inseparable(prospects),
        })
    }

    fn prospect_as_json(&self, prospect: &Prospect) -> Value {
        let pairs = prospect.pairs.iter().map(|pair| {
            json!({"hypotheses": pair.hypotheses, "distance_squared": pair.distance_squared, "shared_s": pair.shared_s})
        });
        json!({
            "motion": self.name(prospect),
            "acceleration": prospect.acceleration,
            "risk": prospect.risk,
            "contact_s": prospect.contact_s,
            "pairs": pairs.collect::<Vec<_>>(),
        })
    }
}

/// As people count: from 1.
/// Whether this is no acceleration at all.
fn is_none([x, y]: [f64; 2]) -> bool {
    x == 0.0 && y == 0.0
}

fn pose_numbers([first, second]: [usize; 2]) -> String {
    format!("{} and {}", first + 1, second + 1)
}

fn shortest_contact(prospect: &Prospect) -> f64 {
    prospect.contact_s.iter().copied().reduce(f64::min).unwrap_or(0.0)
}
