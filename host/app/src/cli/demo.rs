//! `palpate demo`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use miette::WrapErr as _;
use nalgebra::Vector2;
use palpate::math::random::Draw;
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::Estimate;
use palpate::pushing::estimation::from_rest::onset::PushSense;
use palpate::pushing::estimation::from_rest::trial::{Drawn, Ranges, pose_error, random_part, straight_motion};
use palpate::pushing::estimation::from_rest::{self, CarriedFinger, KnownFromRest};
use palpate::pushing::finger_motion::FingerMotion;
use palpate::pushing::pushed_world::{Played, STEP_S};
use palpate_device::simulated::Line;
use palpate_files::motion;
use palpate_files::part::PolygonFile;

use super::kept_push::{self, FORCES, MOTION, as_table};
use super::read::{kept_elsewhere, read, read_beside, read_text, tell_part};
use super::watched_push::MuUncertainty;
use super::{not_negative, pose, static_demo, touch};
use crate::advice::Advise as _;
use crate::thesis::chain::known_of;
use crate::thesis::demonstration::{
    CALIBRATION_CONTACTS, CALIBRATION_FORCE_N, Rig, SensedPush, compliance_by_design, course,
};
use crate::width::folded;

/// Times since the onset at which the host says what it knows, s; the end of the push comes last.
const TIMES_S: [f64; 3] = [0.1, 0.2, 0.4];

/// Largest factor of the noise: a light part's force is lost in it, and a heavier calibration weight would bend the
/// beam for good.
const NOISE_MAX: f64 = 20.0;

/// Shows the whole chain without hardware: a part is pushed, and the host names its pose from the force on the finger.
///
/// A simulated world puts a part before a simulated finger, which begins to push it. Between the force and the bytes is
/// the firmware's own code on a model of its chip; the host calibrates the finger, knows the part's shape, the friction
/// under it and how the finger moves, and finds where the part is. Then the truth is revealed. With --static, the
/// thesis's experiment with contacts that do not move.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Push this part (a part file as for `palpate push`) instead of a random one
    #[arg(long, value_name = "FILE", conflicts_with = "static_contacts")]
    part: Option<PathBuf>,

    /// Move the finger so (a motion file as for `palpate observe`) instead of along x, then aside
    #[arg(long, value_name = "FILE", conflicts_with_all = ["static_contacts", "straight"])]
    motion: Option<PathBuf>,

    /// Push straight, so that more poses feel alike
    #[arg(long, conflicts_with = "static_contacts")]
    straight: bool,

    /// Seed of everything random
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    seed: u64,

    /// Noise and hum of the finger, as a multiple of the datasheet's
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = noise, conflicts_with = "static_contacts", allow_negative_numbers = true)]
    noise: f64,

    /// Keep what the host had to go by in this folder: part.toml, motion.toml and forces.csv, for `palpate observe`; and
    /// played.csv, the force that acted, for `play` of `palpate simulate-device`
    #[arg(long, value_name = "DIR", conflicts_with = "static_contacts")]
    keep: Option<PathBuf>,

    /// Feel contacts round the disk that do not move, as the thesis did, and compare with its figures
    #[arg(long = "static")]
    static_contacts: bool,

    /// Find a part by touch with a simulated robot
    #[arg(long, conflicts_with_all = ["static_contacts", "part", "motion", "straight", "noise", "keep"])]
    touch: bool,
}

fn noise(text: &str) -> Result<f64, String> {
    not_negative(text).and_then(|factor| {
        if factor <= NOISE_MAX { Ok(factor) } else { Err(format!("{factor} is too much: at most {NOISE_MAX}")) }
    })
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    if arguments.static_contacts {
        return static_demo::run(arguments.seed);
    }
    if arguments.touch {
        return touch::demo::run(arguments.seed);
    }
    let mut draw = Draw::case(arguments.seed, 0);
    let (part, mut ranges) = arguments.part(&mut draw)?;
    if let Some(motion) = arguments.motion()? {
        ranges.motion = motion;
    }
    let drawn = ranges.draw(&mut draw, &part).ok_or_else(|| {
        miette::miette!(
            help = "choose a larger part, or a shorter motion",
            "the finger finds no edge of this part to push at for {} s without leaving it",
            ranges.motion.duration()
        )
    })?;
    let mut rig = Rig::start(arguments.seed, arguments.noise, line()).advised()?;
    introduce(&rig, &part, &ranges, CALIBRATION_FORCE_N * arguments.noise.max(1.0));
    let measured = rig.push(course(&drawn.played, &ranges.motion)).advised()?;
    if let Some(folder) = &arguments.keep {
        arguments.keep_files(
            folder,
            &part,
            &ranges,
            &Felt { acted: &drawn.played, measured: &measured, finger: rig.finger() },
        )?;
    }
    // As much as `observe` is told where nothing is said of it.
    let known = KnownFromRest { mu_g_log_sd: MuUncertainty::UNTOLD.log_sd, ..known_of(&ranges, &part, rig.finger()) };
    let Some(estimate) = say_what_is_felt(&known, &measured.sense) else {
        say!("The push was not felt: its force does not stand out of {} times the noise.", arguments.noise);
        return Ok(ExitCode::SUCCESS);
    };
    reveal(&part, &drawn, ranges.mu, &estimate);
    Ok(ExitCode::SUCCESS)
}

/// As real a line as the system has.
fn line() -> Line {
    if cfg!(unix) { Line::Pty { link: None } } else { Line::Pipe }
}

impl Arguments {
    fn part(&self, draw: &mut Draw) -> miette::Result<(Part, Ranges)> {
        let default = Ranges { compliance: compliance_by_design(), ..Ranges::default() };
        let Some(path) = &self.part else { return Ok((random_part(draw), default)) };
        let file = read_beside(path, PolygonFile::parse_beside)?;
        tell_part(path, file.part.polygon().vertices(), file.part.body(), &file.doubts());
        let mu_c = file.mu_c.map_or(default.mu_c, |mu_c| mu_c..=mu_c);
        Ok((file.part, Ranges { mu: file.mu, mu_c, ..default }))
    }

    fn keep_files(&self, folder: &Path, part: &Part, ranges: &Ranges, felt: &Felt<'_>) -> miette::Result<()> {
        let finger = felt.finger;
        let cannot = || format!("cannot keep the push in {}", folder.display());
        let part = match &self.part {
            Some(path) => kept_elsewhere(path, read_text(path).wrap_err_with(cannot)?),
            None => part_as_toml(part, ranges.mu),
        };
        let files = [
            ("part.toml", part),
            (MOTION, motion::to_text(&ranges.motion)),
            (FORCES, as_table(felt.measured.readings.iter().map(|reading| (reading.t, reading.force_finger)))),
            ("played.csv", as_table(felt.acted_evenly())),
        ];
        let files: Vec<_> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
        kept_push::write_new(folder, &files)?;
        let named = |name: &str| folder.join(name).display().to_string();
        let [part, motion, forces] = ["part.toml", MOTION, FORCES].map(named);
        let mass = finger.effective_mass * 1e3;
        let mass = format!("--effective-mass-g {mass:.2}");
        note!("kept; to look again: palpate observe {forces} --part {part} --motion {motion} {mass}");
        note!("to feel it again: `play {} {motion}` in palpate simulate-device", named("played.csv"));
        Ok(())
    }

    fn motion(&self) -> miette::Result<Option<FingerMotion>> {
        match &self.motion {
            Some(path) => read(path, motion::parse).map(Some),
            None => Ok(self.straight.then(straight_motion)),
        }
    }
}

/// A part without feet or a mass of its own, as its file.
fn part_as_toml(part: &Part, mu: f64) -> String {
    let vertices: Vec<_> =
        part.polygon().vertices().iter().map(|vertex| format!("[{}, {}]", vertex.x, vertex.y)).collect();
    format!("unit = \"m\"\nvertices = [{}]\nmu = {mu}\n", vertices.join(", "))
}

/// A push as it was, and as the finger felt it: with its offset, its noise and its hum.
struct Felt<'a> {
    acted: &'a Played,
    measured: &'a SensedPush,
    finger: CarriedFinger,
}

impl Felt<'_> {
    /// The force on the disk with its time since the push began.
    fn acted_evenly(&self) -> impl Iterator<Item = (f64, Vector2<f64>)> {
        let times = (0_u32..).map(|step| f64::from(step) * STEP_S);
        times.zip(self.acted.forces_evenly())
    }
}

fn introduce(rig: &Rig, part: &Part, ranges: &Ranges, force: f64) {
    let address = rig.session().address();
    say!("A simulated finger runs the firmware at {address};\nthe host opens it like any serial port.");
    let worst = rig.fit().held_back().map_or_else(String::new, |held| {
        format!("; those held back are off by at most {:.2}°", held.worst_error.abs().to_degrees())
    });
    say!("{}", folded(&format!("It was calibrated on {CALIBRATION_CONTACTS} contacts of {force} N{worst}.")));
    let CarriedFinger { effective_mass, effective_mass_sd, .. } = rig.finger();
    let [mass, sd] = [effective_mass, effective_mass_sd].map(|mass| mass * 1e3);
    let waved = format!(
        "Waved in the air it feels {mass:.2} ± {sd:.2} g of its own, which the host takes out of what it reads."
    );
    say!("{}", folded(&waved));
    let vertices: Vec<_> =
        part.polygon().vertices().iter().map(|v| format!("({:.0}, {:.0})", v.x * 1e3, v.y * 1e3)).collect();
    say!("{}", folded(&format!("The part, in mm: {}; µ {} on the table.", vertices.join(" "), ranges.mu)));
    let segments = ranges.motion.segments().iter().map(|segment| {
        let [x, y] = segment.acceleration.map(|value| value * 1e3).into();
        format!("{} s with ({x:.0}, {y:.0}) mm/s²", segment.seconds)
    });
    let segments = segments.collect::<Vec<_>>().join(", then ");
    say!("{}", folded(&format!("The finger touches it somewhere, at rest, and then moves: {segments}.")));
    let untold = "What the host is not told: where and at what angle it touches, the part's mass, the friction at the \
                  finger. The µ of the table it takes for known to 20 %.";
    say!("{}", folded(untold));
}

/// The host's answers as the push goes on; the last one.
fn say_what_is_felt(known: &KnownFromRest, sense: &PushSense) -> Option<Estimate> {
    let end = known.motion.duration();
    let mut last = None;
    for until in TIMES_S.into_iter().filter(|&until| until < end).chain([end]) {
        let Some(measured) = sense.windowed_force(until).filter(|measured| measured.count() >= from_rest::WINDOWS_MIN)
        else {
            continue;
        };
        if last.is_none() {
            say!("\n{}", pose::headings());
        }
        let estimate = from_rest::estimate(known, &measured);
        pose::lines(known.part, &estimate).iter().for_each(|line| say!("{line}"));
        last = Some(estimate);
    }
    last
}

fn reveal(part: &Part, drawn: &Drawn, mu: f64, estimate: &Estimate) {
    say!("{}\n\n{}", pose::legend(part), pose::in_words(part, estimate));
    let Some(truth) = drawn.played.pose(estimate.time_end) else { return };
    let centre = truth * part.centre_of_mass();
    let truth_in_words = format!(
        "The truth after {:.2} s: edge {}, centre of mass at ({:.2}, {:.2}) mm, turned {:.2}°; {:.3} kg, µ_c {:.3}, µ {}.",
        estimate.time_end,
        drawn.edge,
        centre.x * 1e3,
        centre.y * 1e3,
        truth.rotation.angle().to_degrees(),
        drawn.mass,
        drawn.mu_c,
        mu
    );
    say!("{}", folded(&truth_in_words));
    for (place, hypothesis) in estimate.hypotheses.iter().enumerate() {
        let error = pose_error(part, estimate.symmetry, &hypothesis.pose_end, &truth);
        let which = if place == 0 { "The likeliest pose".to_owned() } else { format!("Number {}", place + 1) };
        say!("{which} is off by {:.3} mm and {:.3}°.", error.distance * 1e3, error.angle.to_degrees());
    }
    say!("Nothing here was measured: finger and part were simulated. README.md says how to\nbuild a real finger.");
}
