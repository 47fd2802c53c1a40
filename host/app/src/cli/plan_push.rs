//! `palpate plan-push`.

use std::path::PathBuf;
use std::process::ExitCode;

use nalgebra::Vector2;
use palpate::pushing::estimation::planning::{self, PlannedMotion, Present, Prospect, Rival, Sampling, SensedAngle};
use palpate::pushing::estimation::{Estimate, Hypothesis, from_rest};
use palpate::pushing::finger_motion::Segment;
use palpate_files::part::PolygonFile;
use serde_json::{Value, json};

use super::read::{read_beside, tell_part};
use super::watched_push::{MotionArgument, WatchedPushArguments};
use super::{lacking, misfit, pose, positive};
use crate::recording::{self, Believed, Seen};
use crate::threads::PATIENT;
use crate::width::folded;

/// One value a hundredth of a second, s.
const VALUES_EVERY_S: f64 = 0.01;

/// How strongly the finger turns aside and for how long where nothing else is said, mm/s² and s.
const ACCELERATION_MM_S2: f64 = 150.0;
const SECONDS: f64 = 0.5;

/// How the force's direction scatters over [`VALUES_EVERY_S`] where nothing else is said, degrees.
const NOISE_DEG: f64 = 0.112;

/// A motion that lowers the risk by less than this share of it is no better than going straight on.
const WORTHWHILE: f64 = 0.1;

const LONG_HELP: &str = "\
Takes the files of `palpate observe`: of a push so far that left several poses possible. Each motion is played ahead from
every pose that is left, and what the finger then would feel is compared pair by pair:

  first    the acceleration that the motion begins with; the recommended
           motion is told in full below
  risk     bound of the probability of naming the wrong pose afterwards, or a
           place more than a millimetre off
  nearest  the two poses that come apart least; the likeliest is 1
  D²       how far: squared, in standard deviations of the noise and of what
           is uncertain of both; below 36 they may be confused
  place    how uncertain the place on the edge then still is, of the pose
           where it is most so: standard deviation
  contact  how long every pose keeps the contact, s

What is compared is the direction of the force. A contact that never slipped so far is taken to roll on. Run it again as the
push goes on: a second choice, by what was felt since the first, is worth more than the first.

Exit status: 0, also where nothing tells the poses apart; 1 if something cannot be used, 3 if samples of the push were no
measurements (saturated, stuck, settling) or the device started anew, 64 wrong command line.";

/// Says how the finger should go on so that the poses still possible can be told apart.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// The part file
    #[arg(long, value_name = "PART.toml")]
    part: PathBuf,

    #[command(flatten)]
    motion: MotionArgument,

    /// How strongly the finger can turn aside or speed up
    #[arg(long, value_name = "MM/S2", value_parser = positive, default_value_t = ACCELERATION_MM_S2)]
    acceleration_mm_s2: f64,

    /// How fast the finger may become: faster motions are left out
    #[arg(long, value_name = "MM/S", value_parser = positive)]
    speed_max_mm_s: Option<f64>,

    /// How long it goes on
    #[arg(long, value_name = "S", value_parser = super::stretch, default_value_t = SECONDS)]
    seconds: f64,

    /// Standard deviation of the force's direction, over a hundredth of a second
    #[arg(long, value_name = "DEG", value_parser = positive, default_value_t = NOISE_DEG)]
    noise_deg: f64,

    /// Print one JSON object: SI units, radians
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    push: WatchedPushArguments,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    arguments.push.felt.check_disk()?;
    arguments.push.begin_recording()?;
    let file = read_beside(&arguments.part, PolygonFile::parse_beside)?;
    tell_part(&arguments.part, file.part.polygon().vertices(), file.part.body(), &file.doubts());
    let push = arguments.push.watch_to_its_end(&arguments.motion.file)?;
    let force = push.force()?;
    let tally = push.watch.tally();
    let known = push.known(&file);
    let estimate = from_rest::estimate_until(&known, &force, &PATIENT).found;
    let seen = Seen::pushed(known.part, known.motion, known.radius, estimate.time_end);
    recording::believed(seen, estimate.hypotheses.iter().map(Believed::from));
    let present = known.present(&estimate);
    crate::progress::says("playing motions ahead".to_owned());
    let plan = Plan { estimate: &estimate, present, motions: arguments.motions(&present)? };
    let prospects = plan.prospects(arguments);
    if arguments.json {
        let mut told = plan.as_json(&prospects);
        told["samples"] = lacking::as_json(&tally);
        say!("{told}");
        return Ok(lacking::status(&tally));
    }
    say!("{}", pose::headings());
    pose::lines(&file.part, &estimate).iter().for_each(|line| say!("{line}"));
    say!("{}\n{}", pose::legend(&file.part), pose::in_words(&file.part, &estimate));
    if estimate.hypotheses.is_empty() {
        say!("{}", misfit::explain(&known, &force));
    }
    if estimate.hypotheses.len() > 1 {
        say!("\nIf the finger goes on for {} s:", arguments.seconds);
        plan.lines(&prospects).iter().for_each(|line| say!("{line}"));
        say!("{}", folded(&plan.in_words(&prospects)));
    }
    Ok(lacking::status(&tally))
}

impl Arguments {
    /// The motions that the finger can do.
    fn motions(&self, present: &Present) -> miette::Result<Vec<PlannedMotion>> {
        let velocity = present.velocity;
        if velocity[0].hypot(velocity[1]) <= 0.0 {
            return Err(miette::miette!(
                help = "give a motion that ends under way",
                "the finger stands still at the end of what was felt: there is no straight on"
            ));
        }
        let mut motions = planning::motions(velocity, self.acceleration_mm_s2 * 1e-3, self.seconds);
        let limit = self.speed_max_mm_s.map_or(f64::INFINITY, |limit| limit * 1e-3);
        motions.retain(|motion| motion.top_speed(velocity) <= limit);
        if motions.is_empty() {
            let now = velocity[0].hypot(velocity[1]) * 1e3;
            return Err(miette::miette!(
                help = "raise --speed-max-mm-s",
                "no motion stays below {} mm/s: the finger already goes {now:.1} mm/s",
                limit * 1e3
            ));
        }
        Ok(motions)
    }
}

/// What is to be told apart, and by what.
struct Plan<'e> {
    estimate: &'e Estimate,
    present: Present<'e>,
    motions: Vec<PlannedMotion>,
}

impl Plan<'_> {
    fn prospects(&self, arguments: &Arguments) -> Vec<Prospect> {
        let beliefs: Vec<_> = self.estimate.hypotheses.iter().filter_map(Hypothesis::belief).collect();
        planning::prospects(&self.present, &beliefs, &self.motions, sampling(arguments.noise_deg))
    }

    fn lines(&self, prospects: &[Prospect]) -> Vec<String> {
        let heading = |[motion, first, risk, nearest, apart, place, contact]: [&str; 7]| {
            format!("  {motion:<18} {first:>15} {risk:>9} {nearest:>9} {apart:>8} {place:>6} {contact:>7}")
                .trim_end()
                .to_owned()
        };
        let headings = [
            heading(["motion", "first [mm/s²]", "risk", "nearest", "D²", "place", "contact"]),
            heading(["", "", "", "", "", "[mm]", "[s]"]),
        ];
        headings.into_iter().chain(prospects.iter().map(line)).collect()
    }

    /// The recommendation.
    fn in_words(&self, prospects: &[Prospect]) -> String {
        let hopeless = planning::inseparable(prospects);
        let all = prospects.first().map_or(0, |prospect| prospect.pairs.len());
        let unseparated: Vec<_> = hopeless.iter().map(|pair| pose_numbers(*pair)).collect();
        if hopeless.len() == all {
            return "The poses cannot be told apart by any of these motions.".to_owned();
        }
        let mut words = recommended(prospects);
        if !unseparated.is_empty() {
            words += &format!(" Poses {} cannot be told apart by any of these motions.", unseparated.join(", "));
        }
        words
    }

    fn as_json(&self, prospects: &[Prospect]) -> Value {
        let recommended = prospects.first().filter(|prospect| !prospect.pairs.is_empty());
        json!({
            "estimate": pose::as_json(self.estimate),
            "motions": prospects.iter().map(prospect_as_json).collect::<Vec<_>>(),
            "recommended": recommended.map(|prospect| prospect.motion.name),
            "inseparable": planning::inseparable(prospects),
        })
    }
}

/// What is felt of the force's direction, which scatters by so much, degrees.
fn sampling(noise_deg: f64) -> Sampling {
    Sampling { sensed: SensedAngle::ForceDirection, dt: VALUES_EVERY_S, sigma: noise_deg.to_radians() }
}

/// What each motion would tell of hypotheses of several parts, the best first; nothing of a finger that stands still, which has no
/// straight on.
pub(super) fn prospects_among(rivals: &[Rival<'_>]) -> Vec<Prospect> {
    let Some(velocity) = rivals.first().map(|rival| rival.present.velocity).filter(|velocity| velocity.norm() > 0.0)
    else {
        return Vec::new();
    };
    let motions = planning::motions(velocity, ACCELERATION_MM_S2 * 1e-3, SECONDS);
    planning::prospects_among(rivals, &motions, sampling(NOISE_DEG))
}

/// The motion to make, in words; none without prospects.
pub(super) fn recommended(prospects: &[Prospect]) -> String {
    match (prospects.first(), prospects.iter().find(|prospect| prospect.motion.is_straight())) {
        (Some(best), Some(straight)) if best.risk >= (1.0 - WORTHWHILE) * straight.risk => {
            "Go straight on: no other of these motions does much better.".to_owned()
        }
        (Some(best), _) => format!("Go {}: {}.", best.motion.name, told(&best.motion)),
        (None, _) => String::new(),
    }
}

/// A motion's accelerations, SI units.
pub(super) fn segments_as_json(motion: &PlannedMotion) -> Value {
    let segments = motion.segments.iter();
    segments
        .map(|segment| json!({"seconds": segment.seconds, "acceleration": [segment.acceleration.x, segment.acceleration.y]}))
        .collect()
}

fn prospect_as_json(prospect: &Prospect) -> Value {
    let pairs = prospect.pairs.iter().map(|pair| {
        json!({"hypotheses": pair.hypotheses, "distance_squared": pair.distance_squared, "shared_s": pair.shared_s})
    });
    json!({
        "motion": prospect.motion.name,
        "segments": segments_as_json(&prospect.motion),
        "risk": prospect.risk,
        "contact_s": prospect.contact_s,
        // Nothing is known of a place whose contact ends at once.
        "place_sd": prospect.place_sd.iter().map(|sd| sd.is_finite().then_some(*sd)).collect::<Vec<_>>(),
        "pairs": pairs.collect::<Vec<_>>(),
    })
}

fn line(prospect: &Prospect) -> String {
    let first = prospect.motion.segments.first().map_or_else(Vector2::zeros, |segment| segment.acceleration);
    // Without the minus sign of zero.
    let [x, y] = first.map(|component| component * 1e3 + 0.0).into();
    let nearest =
        prospect.nearest().map_or((String::new(), 0.0), |pair| (pose_numbers(pair.hypotheses), pair.distance_squared));
    let place = prospect.place_sd.iter().copied().fold(0.0, f64::max) * 1e3;
    format!(
        "  {:<18} {x:7.1} {y:7.1} {:7.2} % {:>9} {:8.1} {place:6.2} {:7.2}",
        prospect.motion.name,
        prospect.risk * 100.0,
        nearest.0,
        nearest.1,
        shortest_contact(prospect)
    )
}

/// A motion's accelerations, in words.
fn told(motion: &PlannedMotion) -> String {
    let segment = |segment: &Segment| {
        let [x, y] = segment.acceleration.map(|component| component * 1e3 + 0.0).into();
        format!("accelerate by ({x:.1}, {y:.1}) mm/s² for {:.2} s", segment.seconds)
    };
    motion.segments.iter().map(segment).collect::<Vec<_>>().join(", then ")
}

/// As people count: from 1.
fn pose_numbers([first, second]: [usize; 2]) -> String {
    format!("{} and {}", first + 1, second + 1)
}

fn shortest_contact(prospect: &Prospect) -> f64 {
    prospect.contact_s.iter().copied().reduce(f64::min).unwrap_or(0.0)
}
