//! `palpate observe --method slow`: slow pushes, one after another, from recordings or live.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _, miette};
use nalgebra::{Matrix3, Point2, Vector2, Vector3};
use palpate::Pose;
use palpate::finger::contact::offline::BiasUnknown;
use palpate::geometry::distance_to_segment;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::math::statistics::{mean, percentile};
use palpate::pushing::estimation::slow_pushes::{
    AfterPush, Before, Cloud, FeltPush, FilterSettings, Heap, Kernel, Onset, ParameterBelief, PushParameters, Region,
    SlowConstants, SlowFilter, SlowScene, Spread, Standing,
};
use palpate::pushing::finger_motion::FingerMotion;
use palpate_files::output;
use palpate_files::part::PolygonFile;
use palpate_files::recordings::csv::RecordedTable;
use palpate_files::recordings::path::RecordedPath;
use palpate_files::recordings::session::{RecordingOptions, RecordingReport, of_table};
use palpate_files::recordings::slow_pushes::{FirstTouch, first_touch, of_places, touching};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::plot::PlotArguments;
use super::read::read;
use super::told_tables::TableArguments;
use super::touch_world::pose_mm;
use super::watched_push::{FeltPushArguments, WatchedPushArguments};
use super::{lacking, not_negative, positive};
use crate::pictures::slow_chain::{ChainPush, figure};
use crate::recording::{self, Believed, Seen};
use crate::width::folded;

/// A part that friction stops within this, m, shows nothing of its inertia: it is a tenth of what frames and clocks leave of
/// where a contact began, and at a friction of 0.3 a speed of 11 mm/s.
pub(super) const SLOW_STOP_M: f64 = 0.02e-3;

/// The speed of measured places is that over so many seconds: places in steps of 0.1 mm then tell it to 0.5 mm/s.
const SPEED_OVER_S: f64 = 0.2;

/// A finger that feels live is in mean over two periods of the mains before its way counts, s.
const MEAN_S: f64 = 0.04;

/// A told motion in steps of this, s: of 0.01 mm at 10 mm/s.
const MOTION_STEP_S: f64 = 1e-3;

/// Heaps are told until so much of the cloud is left.
const LEFT_OVER: f64 = 0.05;

/// And so many at most.
const HEAPS_SHOWN: usize = 5;

/// Friction at the finger where nothing is said of it, and how well that is known: of dry metal and plastic.
const MU_C_UNTOLD: [f64; 2] = [0.4, 0.3];

/// Weight times friction, where the part is not weighed, is the force that is felt, known to this share: where it is
/// pushed aside of its centre of mass half of it is enough.
const UNWEIGHED: f64 = 0.5;

/// An effective number below this is an onset or a force that nothing explains well: of some thousand poses one in fifty.
const EFFECTIVE_LEAST: f64 = 40.0;

/// How far a part slides that goes at this speed, m/s, until friction has stopped it, m.
pub(super) fn stopping_distance(speed: f64, mu: f64) -> f64 {
    speed * speed / (2.0 * mu * GRAVITY_ASSUMED)
}

/// The largest speed of a told motion, m/s: at an end of a segment, as it is convex within.
pub(super) fn fastest_told(motion: &FingerMotion) -> f64 {
    let speeds = motion.segments().iter().scan(Vector2::zeros(), |velocity: &mut Vector2<f64>, segment| {
        *velocity += segment.acceleration * segment.seconds;
        Some(velocity.norm())
    });
    speeds.fold(0.0, f64::max)
}

/// The largest speed of measured places, m/s; none where they tell of no motion, or of too little time.
pub(super) fn fastest_measured(path: &RecordedPath) -> Option<f64> {
    let (times, places) = (&path.times, &path.places);
    let speed = |from: usize| {
        let to = times.partition_point(|t| *t < times[from] + SPEED_OVER_S);
        (to < times.len()).then(|| (places[to] - places[from]).norm() / (times[to] - times[from]))
    };
    let fastest = (0..times.len()).filter_map(speed).fold(0.0, f64::max);
    (fastest > 0.0).then_some(fastest)
}

/// What slow pushes need.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Slow pushes (--method slow)")]
pub(super) struct SlowArguments {
    /// Where the part was about before the first push, in the frame of the places: X,Y in mm of its file's origin, and its
    /// turn in degrees [default: anywhere on the table]
    #[arg(long, value_name = "X,Y,DEG", value_parser = pose_mm, allow_hyphen_values = true)]
    near: Option<Pose>,

    /// How far it may be from there, along x and y and in turn
    #[arg(long, value_name = "MM,DEGREES", value_parser = within, default_value = "10,10", requires = "near")]
    near_within: Within,

    /// Forces and path of the push that came next, of the part where it lay then; as often as given
    #[arg(long, value_names = ["FORCES", "PATH"], num_args = 2, requires = "path", action = clap::ArgAction::Append)]
    next: Vec<PathBuf>,

    /// Begin with what was believed after the push before, as this file has it, and leave in it what is believed after
    /// this one: for chains of pushes over several runs
    #[arg(long, value_name = "FILE", conflicts_with = "near")]
    belief: Option<PathBuf>,

    /// What the part weighs [default: found with its friction from the force, and then of less use]
    #[arg(long, value_name = "G", value_parser = positive)]
    mass_g: Option<f64>,

    /// Height of the contact above the table [default: 0]
    #[arg(long, value_name = "MM", value_parser = not_negative, allow_negative_numbers = true)]
    height_mm: Option<f64>,

    /// How far the finger went on after the last place of each path: what `palpate import` says of its logs [default: 0]
    #[arg(long, value_name = "MM", value_parser = not_negative, allow_negative_numbers = true, requires = "path")]
    beyond_mm: Option<f64>,

    /// Of the random numbers: the same one, the same answer [default: 1]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
}

/// The value of `--near-within`: m and rad.
#[derive(Clone, Copy, Debug)]
struct Within([f64; 2]);

fn within(text: &str) -> Result<Within, String> {
    let numbers = text.split(',').map(|number| positive(number.trim())).collect::<Result<Vec<_>, _>>()?;
    match numbers[..] {
        [place, turn] => Ok(Within([place * 1e-3, turn.to_radians()])),
        _ => Err(format!("`{text}` is not a length and an angle: write for example 10,10")),
    }
}

impl SlowArguments {
    /// Whether anything was said that is for slow pushes alone.
    pub(super) fn is_given(&self) -> bool {
        let Self { near, near_within: _, next, belief, mass_g, height_mm, beyond_mm, seed } = self;
        near.is_some()
            || !next.is_empty()
            || belief.is_some()
            || mass_g.is_some()
            || height_mm.is_some()
            || beyond_mm.is_some()
            || seed.is_some()
    }
}

/// What is believed between two pushes, in a file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BeliefFile {
    /// What this is.
    palpate_slow_belief: u32,
    /// The part's outline, m: another part has another belief.
    outline: Vec<[f64; 2]>,
    /// Pushes so far.
    pushes: usize,
    /// Of the centre of mass, with the part's axes: m, m, rad.
    poses: Vec<[f64; 3]>,
    /// What the part is taken to weigh, kg.
    mass: f64,
    /// Logarithm of weight times friction against that weight and the file's friction, and how far the next push's may be
    /// off.
    friction_log: [f64; 2],
}

/// Version of [`BeliefFile`].
const BELIEF_VERSION: u32 = 1;

/// What is believed between two pushes.
struct Chain {
    cloud: Option<Cloud>,
    pushes: usize,
    belief: ParameterBelief,
}

/// `observe --method slow`.
pub(super) struct SlowObserving<'a> {
    pub(super) file: &'a PolygonFile,
    pub(super) json: bool,
    pub(super) slow: &'a SlowArguments,
    /// The title of a picture that is asked for.
    pub(super) plot: Option<String>,
}

/// A push as it came in.
struct Incoming {
    felt: FeltPush,
    /// For a person: where it came from.
    name: String,
}

impl SlowObserving<'_> {
    /// Pushes from files of forces and places.
    pub(super) fn recorded(
        &self,
        first: (&Path, &Path),
        tables: &TableArguments,
        felt: FeltPushArguments,
        plot: &PlotArguments,
    ) -> miette::Result<ExitCode> {
        let next = self.slow.next.chunks_exact(2).map(|pair| (pair[0].as_path(), pair[1].as_path()));
        let pushes = std::iter::once(first).chain(next).map(|(forces, path)| self.read(forces, path, tables, felt));
        let pushes = pushes.collect::<miette::Result<Vec<_>>>()?;
        self.observe(&pushes, felt, plot)?;
        Ok(ExitCode::SUCCESS)
    }

    /// A push that is watched, live or from forces, the finger moving as told.
    pub(super) fn watched(
        &self,
        push: &WatchedPushArguments,
        motion: &Path,
        plot: &PlotArguments,
    ) -> miette::Result<ExitCode> {
        let watched = push.watch_to_its_end(motion)?;
        watched.was_felt()?;
        let motion = watched.motion();
        // Where contact was lost the rest of the way tells that as well, but a knock on the way back would not.
        let duration = watched.lost().map_or(motion.duration(), |lost| lost.min(motion.duration()));
        let steps = (duration / MOTION_STEP_S).ceil();
        let times = std::iter::successors(Some(0.0), |k| Some(k + 1.0)).take_while(|k| *k <= steps);
        let places: Vec<_> = times.map(|k| duration * k / steps).map(|t| (t, motion.centre(t))).collect();
        // What the finger feels of its own mass is none of the part's.
        let inertia = |t: f64| motion.acceleration(t) * watched.effective_mass();
        let forces = watched.since_onset(MEAN_S).into_iter().filter(|(t, _)| *t <= duration);
        let forces = forces.map(|(t, force)| (t, force + inertia(t)));
        let felt = of_places(&places, forces, FirstTouch::At(0.0), FilterSettings::STANDARD.bin);
        let felt = felt.map_err(|error| miette!(help = "tell a motion that goes straight on", "{error}"))?;
        let name = push.forces.as_ref().map_or_else(|| "live".to_owned(), |file| file.display().to_string());
        self.observe(&[Incoming { felt, name }], push.felt, plot)?;
        Ok(lacking::status(&watched.watch.tally()))
    }

    /// Reads a push of a recording.
    fn read(
        &self,
        forces: &Path,
        path: &Path,
        tables: &TableArguments,
        felt: FeltPushArguments,
    ) -> miette::Result<Incoming> {
        let named = || format!("cannot use the push {} along {}", forces.display(), path.display());
        let table = tables.forces(forces)?;
        let readings = table.readings.iter().map(|reading| reading.mounted(felt.mounting())).collect();
        let report = judged(&RecordedTable { readings, ..table }, felt.tare()).wrap_err_with(named)?;
        if let Some(why) = &report.bias_unknown {
            tracing::warn!(
                "{}: {why}; its force and where it began are not used, the part is moved on by its path alone",
                forces.display()
            );
        }
        let RecordedPath { times, places, .. } = tables.places(path)?;
        let places: Vec<_> = times.into_iter().zip(places).collect();
        let felt = of_places(&places, touching(&report), first_touch(&report), FilterSettings::STANDARD.bin);
        let felt = felt.into_diagnostic().wrap_err_with(named)?;
        Ok(Incoming { felt, name: forces.display().to_string() })
    }

    /// Takes the pushes one after another, and says what is known after each.
    fn observe(&self, pushes: &[Incoming], felt: FeltPushArguments, plot: &PlotArguments) -> miette::Result<()> {
        let (radius, mu_log_sd) = (felt.radius(), felt.mu_g_log_sd().unwrap_or(0.0));
        let kept = self.kept()?;
        let mass = self.mass(pushes, kept.as_ref());
        let scene = self.scene(radius, mass)?;
        let settings = FilterSettings::STANDARD;
        let filter = SlowFilter { scene: &scene, settings };
        let mut draw = Draw::new(self.slow.seed.unwrap_or(1));
        let mut chain = self.begun(kept.as_ref(), mu_log_sd);
        let mut shown = Vec::new();
        if !self.json {
            say!("{}", headings());
        }
        for push in pushes {
            let before = match (&chain.cloud, self.slow.near) {
                (Some(cloud), _) => Before::After(cloud),
                (None, None) => Before::Anywhere,
                (None, Some(near)) => {
                    let Within([place, angle]) = self.slow.near_within;
                    let at = near.isometry() * self.file.part.centre_of_mass();
                    Before::Box(Pose { x: at.x, y: at.y, ..near }, place, angle)
                }
            };
            let after = filter.push(&before, &push.felt, &chain.belief, &mut draw);
            chain.pushes += 1;
            chain.belief = learned(&after, &chain.belief);
            let region = Region::of(&after.cloud, Kernel::of(&settings), &mut draw);
            let answer = Answer {
                number: chain.pushes,
                push,
                radius,
                heaps: after.cloud.heaps(LEFT_OVER),
                semi_axes: region.semi_axes(),
                after: &after,
            };
            self.tell(&answer);
            shown.push(ChainPush {
                origin: push.felt.origin,
                direction: push.felt.direction,
                end: push.felt.end,
                onset: onset(&push.felt),
                poses: after.cloud.poses.clone(),
                middle: after.cloud.middle(),
                truth: None,
                title: format!("push {}", chain.pushes),
            });
            chain.cloud = Some(after.cloud);
        }
        if !self.json {
            say!("{}", folded(LEGEND));
        }
        self.keep(&chain, mass)?;
        let title = self.plot.clone().unwrap_or_default();
        plot.draw(|| Ok(figure(&title, &self.outline_from_centre(), radius, &shown)))
    }

    fn outline_from_centre(&self) -> Vec<Point2<f64>> {
        let centre = self.file.part.centre_of_mass();
        self.file.part.polygon().vertices().iter().map(|vertex| Point2::from(vertex - centre)).collect()
    }

    /// What the part weighs, kg; where it was not weighed, what makes the force that was felt.
    fn mass(&self, pushes: &[Incoming], kept: Option<&BeliefFile>) -> f64 {
        if let Some(mass_g) = self.slow.mass_g {
            return mass_g * 1e-3;
        }
        let forces = pushes.iter().flat_map(|push| &push.felt.forces).map(|felt| felt.force.norm());
        let felt = percentile(forces, 50).unwrap_or(GRAVITY_ASSUMED * self.file.mu);
        kept.map_or(felt / (GRAVITY_ASSUMED * self.file.mu), |kept| kept.mass)
    }

    /// What is believed before the first push.
    fn begun(&self, kept: Option<&BeliefFile>, mu_log_sd: f64) -> Chain {
        let scatter = Spread::PUSH.friction_log;
        let friction_log = if self.slow.mass_g.is_some() { scatter.hypot(mu_log_sd) } else { UNWEIGHED };
        let contact_log = if self.file.mu_c.is_some() { Spread::PUSH.contact_log } else { MU_C_UNTOLD[1] };
        let belief = ParameterBelief {
            middle: PushParameters::default(),
            spread: Spread { friction_log, contact_log, ..Spread::PUSH },
        };
        let Some(kept) = kept else { return Chain { cloud: None, pushes: 0, belief } };
        let [friction_log, sd] = kept.friction_log;
        let belief = ParameterBelief {
            middle: PushParameters { friction_log, ..belief.middle },
            spread: Spread { friction_log: sd, ..belief.spread },
        };
        let poses = kept.poses.iter().map(|&[x, y, theta]| Pose { x, y, theta }).collect();
        Chain { cloud: Some(Cloud { poses }), pushes: kept.pushes, belief }
    }

    /// The belief that was kept, if one was.
    fn kept(&self) -> miette::Result<Option<BeliefFile>> {
        let Some(path) = self.slow.belief.as_deref().filter(|path| path.exists()) else { return Ok(None) };
        let parse = |text: &str| serde_json::from_str::<BeliefFile>(text);
        let kept = read(path, parse)?;
        let cannot = |why: &str| {
            let help = "name another file with --belief, or the part that this one is about";
            miette!(help = help, "cannot use {}: {why}", path.display())
        };
        if kept.palpate_slow_belief != BELIEF_VERSION {
            return Err(cannot("it was written by another version of palpate"));
        }
        let finite = kept.poses.iter().flatten().chain(&kept.friction_log).all(|number| number.is_finite());
        if kept.poses.is_empty() || !finite || kept.mass <= 0.0 {
            return Err(cannot("it holds no pose"));
        }
        if kept.outline != self.outline() {
            return Err(cannot("it is of a part with another outline"));
        }
        Ok(Some(kept))
    }

    fn outline(&self) -> Vec<[f64; 2]> {
        self.file.part.polygon().vertices().iter().map(|vertex| [vertex.x, vertex.y]).collect()
    }

    /// Keeps what is believed, where that was asked for.
    fn keep(&self, chain: &Chain, mass: f64) -> miette::Result<()> {
        let (Some(path), Some(cloud)) = (&self.slow.belief, &chain.cloud) else { return Ok(()) };
        let kept = BeliefFile {
            palpate_slow_belief: BELIEF_VERSION,
            outline: self.outline(),
            pushes: chain.pushes,
            poses: cloud.poses.iter().map(|pose| [pose.x, pose.y, pose.theta]).collect(),
            mass,
            friction_log: [chain.belief.middle.friction_log, chain.belief.spread.friction_log],
        };
        let text = serde_json::to_string(&kept).into_diagnostic()? + "\n";
        // Whatever is there was read as a belief before the first push.
        output::replace(path, text.as_bytes()).into_diagnostic()?;
        note!("what is believed after {} pushes is in {}", chain.pushes, path.display());
        Ok(())
    }

    fn scene(&self, radius: f64, mass: f64) -> miette::Result<SlowScene> {
        let part = &self.file.part;
        let standing = match part.body().feet() {
            Some(feet) => Standing::Feet(feet.map(|(at, _)| at).collect()),
            None => Standing::Face,
        };
        let constants = SlowConstants {
            tip_ahead: 0.0,
            tip_left: 0.0,
            radius,
            height: self.slow.height_mm.unwrap_or(0.0) * 1e-3,
            pressure_rise: SlowConstants::pressure_rise_of(part.body().inertia_per_mass()),
            friction: self.file.mu,
            contact_friction: self.file.mu_c.unwrap_or(MU_C_UNTOLD[0]),
            stick_ratio: SlowConstants::BOARD.stick_ratio,
            beyond_log: self.slow.beyond_mm.unwrap_or(0.0) * 1e-3,
            felt_late: 0.0,
        };
        let scene = SlowScene::new(part.polygon(), part.centre_of_mass(), mass, &standing, constants);
        scene.ok_or_else(|| {
            let help = "give at least three feet that are not on a line, or leave them out for the whole base";
            miette!(help = help, "slow pushes need a part that stands firmly")
        })
    }
}

/// What a push taught of weight times friction: the next one scatters about it.
fn learned(after: &AfterPush, belief: &ParameterBelief) -> ParameterBelief {
    let logs = || after.parameters.iter().map(|push| push.friction_log);
    let middle = mean(logs()).unwrap_or(belief.middle.friction_log);
    let sd = mean(logs().map(|log| (log - middle).powi(2))).unwrap_or(0.0).sqrt();
    let friction_log = sd.hypot(Spread::PUSH.friction_log).min(belief.spread.friction_log);
    ParameterBelief {
        middle: PushParameters { friction_log: middle, ..belief.middle },
        spread: Spread { friction_log, ..belief.spread },
    }
}

/// What a recording says of contact: the beginning, of so many seconds at most, that looks free, is the tare.
fn judged(table: &RecordedTable, tare_s: f64) -> miette::Result<RecordingReport> {
    let options = RecordingOptions::default();
    let report = of_table(table, &options).into_diagnostic()?;
    match report.bias_unknown {
        Some(BiasUnknown::NothingToCompare { candidate: Some([from, to]), .. }) => {
            let options = RecordingOptions { tare: Some([from, to.min(from + tare_s)]), ..options };
            of_table(table, &options).into_diagnostic()
        }
        _ => Ok(report),
    }
}

/// Where along its way the finger first met the part, m.
fn onset(felt: &FeltPush) -> Option<f64> {
    match felt.onset {
        Onset::At(travel) | Onset::Before(travel) => Some(travel),
        Onset::Never(_) | Onset::Unknown => None,
    }
}

/// What is known after a push.
struct Answer<'a> {
    number: usize,
    push: &'a Incoming,
    /// Of the finger's disk, m.
    radius: f64,
    heaps: Vec<Heap>,
    semi_axes: [f64; 3],
    after: &'a AfterPush,
}

const LEGEND: &str = "after: pushes so far. share: of all that is possible. x, y: centre of mass, with standard deviations. turned: of the                       part's own axes. 95 %: half the size of what holds the pose with a probability of 95 %, as a ball of that many mm                       and degrees; only in a push's first row.";

/// Two lines of headings.
fn headings() -> String {
    let above = format!("{:>44}", "centre of mass [mm]");
    format!("{above}\n{}", line(["after", "share", "x", "y", "turned [°]", "95 %"]))
}

fn line([after, share, x, y, turned, region]: [&str; 6]) -> String {
    format!("{after:>5} {share:>6} {x:>15} {y:>15} {turned:>15} {region:>7}")
}

impl SlowObserving<'_> {
    fn tell(&self, answer: &Answer<'_>) {
        let Answer { number, push, radius, heaps, semi_axes, after } = answer;
        let FeltPush { origin, direction, end, .. } = push.felt;
        let believed = heaps.iter().map(|heap| Believed {
            probability: heap.share,
            edge: self.nearest_edge(&heap.pose, origin + direction * end),
            pose: self.own(&heap.pose),
            covariance: Some(Matrix3::from_diagonal(&Vector3::from(heap.sd.map(|sd| sd * sd)))),
        });
        let outline = self.file.part.polygon().vertices();
        let disk = (origin + direction * end, *radius);
        recording::believed(Seen { part: 0, outline, disk, felt_s: f64::NAN }, believed);
        let onset_off =
            matches!(push.felt.onset, Onset::At(_) | Onset::Before(_)) && after.effective_onset < EFFECTIVE_LEAST;
        if self.json {
            say!("{}", self.as_json(answer));
        } else {
            let each = |value: f64, sd: f64, unit: f64| format!("{:.1} ± {:.1}", value * unit, sd * unit);
            for (row, heap) in heaps.iter().take(HEAPS_SHOWN).enumerate() {
                let number = if row == 0 { number.to_string() } else { String::new() };
                let region = if row == 0 { format!("{:.1}", semi_axes[0] * 1e3) } else { String::new() };
                say!(
                    "{}",
                    line([
                        &number,
                        &format!("{:.0} %", heap.share * 100.0),
                        &each(heap.pose.x, heap.sd[0], 1e3),
                        &each(heap.pose.y, heap.sd[1], 1e3),
                        &each(heap.pose.theta, heap.sd[2], 1_f64.to_degrees()),
                        &region,
                    ])
                    .trim_end()
                );
            }
            if heaps.len() > HEAPS_SHOWN {
                say!(
                    "{:>5} {} more places with {most:.0} % or less of all in each",
                    "",
                    heaps.len() - HEAPS_SHOWN,
                    most = heaps[HEAPS_SHOWN].share * 100.0
                );
            }
        }
        if onset_off || after.effective_force < EFFECTIVE_LEAST {
            let what = if onset_off { "where the finger first met the part" } else { "the force" };
            tracing::warn!(
                "push {number} ({}): hardly any pose explains {what}; what follows rests on few. Was the part moved by hand, or is it another?",
                push.name
            );
        }
    }

    /// The pose of the part's own frame, from that of its centre of mass.
    fn own(&self, pose: &Pose) -> Pose {
        let origin = pose.isometry() * Point2::from(-self.file.part.centre_of_mass().coords);
        Pose { x: origin.x, y: origin.y, theta: pose.theta }
    }

    /// The edge nearest to the finger of a part that lies so.
    fn nearest_edge(&self, pose: &Pose, finger: Point2<f64>) -> usize {
        let outline = self.outline_from_centre();
        let at = pose.isometry().inverse_transform_point(&finger);
        let away = |edge: usize| distance_to_segment(at, outline[edge], outline[(edge + 1) % outline.len()]);
        (0..outline.len()).min_by(|a, b| away(*a).total_cmp(&away(*b))).unwrap_or(0)
    }

    /// SI units and radians; poses of the part's own frame.
    fn as_json(&self, answer: &Answer<'_>) -> serde_json::Value {
        let Answer { number, push, heaps, semi_axes, after, .. } = answer;
        let heaps = heaps.iter().map(|heap| {
            let (at, Pose { x, y, theta }) = ([heap.pose.x, heap.pose.y], self.own(&heap.pose));
            json!({"share": heap.share, "centre_of_mass": at, "pose": [x, y, theta], "sd": heap.sd})
        });
        json!({
            "push": number, "method": "slow", "forces": push.name, "heaps": heaps.collect::<Vec<_>>(), "semi_axes": semi_axes,
            "effective_onset": after.effective_onset, "effective_force": after.effective_force,
        })
    }
}
