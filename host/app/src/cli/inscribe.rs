//! `palpate inscribe`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use miette::IntoDiagnostic as _;
use palpate::geometry::{ConvexPolygon, SimplePolygon, distance_to_segment};
use palpate::inscription::{
    Continuum, Inscription, InscriptionEstimate, Outline, PlannedView, Pose, PoseMode, TouchReadings, estimate,
    plan_view, touched_poses,
};
use palpate::point_sampling::Circle;
use palpate_files::passing::PassingFile;
use palpate_files::sampling_plan::PlanFile;
use palpate_files::scene::snapped;
use palpate_files::views::{NamedPart, ViewFileError, Views};
use serde_json::{Value, json};

use super::device::DeviceArguments;
use super::passing;
use super::plot::PlotArguments;
use super::read::{VIEWS, read, read_beside, read_kind};
use super::sample::{PlanArguments, Planned, print_plan};
use super::{counted, positive, turn_deg};
use crate::pictures::inscription::{InscribePicture, Shown};
use crate::width::folded;

const LONG_HELP: &str = "\
A part file is the one of `palpate push` (only unit and vertices or ellipse matter here); `rounding = 3` rounds the
corners by an arc of this radius about each vertex. The view file is TOML, with angles in degrees, counter-clockwise
from x:
  unit = \"mm\"        # of every length: m, cm, mm or in
  sigma = 0.1        # standard deviation of each bearing (optional: without
                     # it the readings are exact)
  [[cone]]           # what a sensor sees of the part: swept
                     # counter-clockwise from right to left
  apex = [-200, 50]
  right = -10.3
  left = 6.9
  moved = [0, 0, 0]  # how far the part had moved since the start: x, y, turn
                     # (optional: a belt, a turntable)
  [[fence]]          # a line the part touches, with the part below it:
                     # x cos(normal) + y sin(normal) = offset
  normal = -90
  offset = 0
  sigma = 0.05       # standard deviation of the offset, in the unit above
                     # (optional: without it the line is exact)
  [[point]]          # a point on the part's outline: a probed contact
                     # (polygons, also with notches)
  at = [60, 15]
  sigma = 0.05       # of each coordinate, in the unit above (optional: without
                     # it on any point, all are exact)
  normal = 0         # of the outline there, out of the part (optional, with
  normal_sigma = 2   # its standard deviation)
  [[free]]           # a disk that the part does not reach into
  centre = [80, 15]
  radius = 4

Parts that are carried past light barriers and turning beams are placed as they go by, with --passing BEAMS.toml:
  unit = \"mm\"
  velocity = [120, 0]     # of what carries the part, in the unit a second
  debounce_ms = 5         # a beam that is free for less bounces (optional)
  sigma = 0.05            # of a turning beam's angle, degrees
  [[barrier]]             # a straight beam
  id = 1                  # in lines; of a board, input 0
  at = [0, 0]
  direction = 90
  sigma = 0.05            # of where it is, across it
  time_sigma_ms = 0.5     # of when it switches
  [[beam]]                # one that turns about a point (optional)
  id = 3
  apex = [50, -300]
  phase = 0               # its angle at the time 0
  turns_per_second = 20   # counter-clockwise
Their changes come as lines `T ID 0|1` on standard input (s, 1 covered), or, with -d, from the inputs of a board. Two
barriers of different directions are four lines. `palpate simulate-passing` makes such lines. --plot draws a panel for each part
once nobody tells more.

With several part files it also says which part it is. Two views nearly always leave one pose of a part if they
are exact; with errors a third view is often needed, and the command says where to take it.

Exit status: 0, 1 if a file cannot be used or the picture not be written, 2 if no pose fits, 64 wrong command line.";

/// Exit status where no part has a pose.
const EXIT_NO_POSE: u8 = 2;

/// Finds where a known part lies from how sensors see it.
///
/// Prints every pose that fits, with its uncertainty if the readings have errors.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
#[command(mut_group("PlanArguments", |group| group.requires("resolve")))]
pub(crate) struct Arguments {
    /// The part files: the parts that it may be
    #[arg(value_name = "PART.toml", required = true)]
    parts: Vec<PathBuf>,
    /// The view file
    #[arg(long, value_name = "VIEWS.toml", required_unless_present = "passing")]
    views: Option<PathBuf>,
    /// Place parts as they are carried past the light barriers and turning beams of this file: as lines on standard input
    /// tell their changes, or a board's inputs with -d
    #[arg(long, value_name = "BEAMS.toml", conflicts_with_all = ["views", "resolve", "next_view_mm"])]
    passing: Option<PathBuf>,
    /// Take the convex hull of parts with notches: sensors cannot see into them
    #[arg(long)]
    hull: bool,
    /// How far from the part a next view would be taken [default: as the first]
    #[arg(long, value_name = "MM", value_parser = positive)]
    next_view_mm: Option<f64>,
    /// Print one JSON object: m, rad, SI throughout
    #[arg(long)]
    json: bool,
    /// Where several poses fit, plan the fewest points that tell them apart by which of them the part covers
    #[arg(long)]
    resolve: bool,
    #[command(flatten)]
    plan: PlanArguments,
    #[command(flatten)]
    plot: PlotArguments,
    #[command(flatten)]
    device: DeviceArguments,
}

/// What came of one part.
pub(super) struct Found {
    part: NamedPart,
    outcome: Result<Fits, Continuum>,
}

/// The poses of one part.
enum Fits {
    Exact(Vec<Pose>),
    Noisy(InscriptionEstimate),
}

impl Fits {
    fn poses(&self) -> Vec<Pose> {
        match self {
            Self::Exact(poses) => poses.clone(),
            Self::Noisy(estimate) => estimate.modes.iter().map(|mode| mode.pose).collect(),
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    arguments.device.begin_recording()?;
    if let Some(passing) = &arguments.passing {
        return arguments.follow(passing);
    }
    let Some(views) = &arguments.views else { return Err(miette::miette!("there is no view file")) };
    let (views, radians) = read_kind(
        views,
        |_| &[VIEWS],
        |text| Views::parse(text).map(|views| (views, Views::parse_radians(text).ok())),
    )?;
    let names = names(&arguments.parts);
    let parts = arguments.parts.iter().zip(&names).map(|(path, name)| {
        let part = read_beside(path, |text, open| {
            let part = NamedPart::parse_beside(name, text, arguments.hull || views.felt.is_some(), open)?;
            part.check(&views).map(|()| part)
        });
        part.map(|part| find(part, &views))
    });
    let found = parts.collect::<miette::Result<Vec<_>>>()?;
    let next = arguments.next_view(&found, &views);
    let resolved = arguments.resolve.then(|| resolve(&found, &arguments.plan)).flatten();
    if arguments.json {
        let mut object = json(&found, &views, next);
        if let Some((names, planned)) = &resolved {
            object["resolve"] = serde_json::to_value(PlanFile::new(names.clone(), &planned.plan)).into_diagnostic()?;
        }
        say!("{}", serde_json::to_string(&object).into_diagnostic()?);
    } else {
        tell(&found, &views, next);
        for reason in why_none(&found, &views, radians.as_ref()) {
            say!("{}", folded(&reason));
        }
        match &resolved {
            Some((names, planned)) => print_plan(names, planned),
            None if arguments.resolve => say!("there are not two poses to tell apart by points"),
            None => {}
        }
    }
    let points = resolved.as_ref().map_or(&[][..], |(_, planned)| planned.plan.points.as_slice());
    arguments.plot.draw(|| Ok(arguments.figure(&found, &views, next, points)))?;
    let any = found.iter().any(|found| found.outcome.as_ref().is_ok_and(|fits| !fits.poses().is_empty()));
    let undetermined = found.iter().any(|found| found.outcome.is_err());
    Ok(if any || undetermined { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO_POSE) })
}

/// What parts are called: as their files, without folder and ending, unless two would be called the same.
fn names(paths: &[PathBuf]) -> Vec<String> {
    let stem = |path: &PathBuf| path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let stems: Vec<String> = paths.iter().map(stem).collect();
    let is_taken = |name: &String| stems.iter().filter(|other| *other == name).count() > 1;
    let name =
        |(path, name): (&PathBuf, &String)| if is_taken(name) { path.display().to_string() } else { name.clone() };
    paths.iter().zip(&stems).map(name).collect()
}

impl Found {
    /// The poses with the part that has them.
    pub(super) fn placed(&self) -> Vec<(NamedPart, Pose)> {
        let poses = self.outcome.as_ref().map_or_else(|_| Vec::new(), Fits::poses);
        poses.into_iter().map(|pose| (self.part.clone(), pose)).collect()
    }
}

pub(super) fn find(part: NamedPart, views: &Views) -> Found {
    let outcome = outcome(&part, views);
    Found { part, outcome }
}

fn outcome(part: &NamedPart, views: &Views) -> Result<Fits, Continuum> {
    if let Some(felt) = &views.felt {
        return outcome_felt(part, felt);
    }
    if views.noisy {
        estimate(&part.convex, &views.readings).map(Fits::Noisy)
    } else {
        match part.shape.poses(&views.readings.lines(), &views.points) {
            Inscription::Poses(poses) => Ok(Fits::Exact(poses)),
            Inscription::Underdetermined(continuum) => Err(continuum),
        }
    }
}

/// Of a part that was felt, with its notches.
fn outcome_felt(part: &NamedPart, felt: &TouchReadings) -> Result<Fits, Continuum> {
    if !felt.are_enough() {
        let lines = felt.fences.len() + felt.bearings.len();
        return Err(Continuum::TooFewReadings { lines, points: felt.touches.len() });
    }
    let found = touched_poses(&part.outline, felt);
    if found.loose.is_some() {
        return Err(Continuum::Loose);
    }
    let dof = usize::try_from(found.dof).unwrap_or(0);
    Ok(Fits::Noisy(InscriptionEstimate { modes: found.modes, dof, gate: found.gate }))
}

/// Units of length, m.
const UNITS_M: [f64; 4] = [1.0, 1e-2, 1e-3, 0.0254];

/// Errors of bearings that are tried where none was stated, degrees: a good camera's, a poor one's.
const SIGMAS_DEG: [f64; 2] = [0.1, 1.0];

/// Errors of points that are tried where none was stated, mm: a machine's probe, a finger.
const SIGMAS_MM: [f64; 3] = [0.01, 0.1, 1.0];

/// What would make a pose fit where none does: a sentence each, of the first kind that does.
fn why_none(found: &[Found], views: &Views, radians: Option<&Views>) -> Vec<String> {
    let none = |outcome: &Result<Fits, Continuum>| outcome.as_ref().is_ok_and(|fits| fits.poses().is_empty());
    if !found.iter().all(|found| none(&found.outcome)) {
        return Vec::new();
    }
    let fits = |views: &Views| {
        let able = found.iter().filter(|found| found.part.check(views).is_ok());
        able.map(|found| outcome(&found.part, views)).any(|outcome| outcome.is_ok_and(|fits| !fits.poses().is_empty()))
    };
    if radians.is_some_and(fits) {
        return vec!["With its angles in radians a pose fits: the view file's are in degrees.".to_owned()];
    }
    if let Some(sigma) =
        SIGMAS_DEG.into_iter().find(|sigma| !views.noisy && fits(&views.with_sigma(sigma.to_radians())))
    {
        let exact = "Without `sigma` the readings count as exact";
        return vec![format!(
            "{exact}, and no pose fits exactly; with errors of {sigma}° (`sigma = {sigma}`) one does."
        )];
    }
    let probed =
        SIGMAS_MM.into_iter().find(|sigma| views.with_point_sigma(sigma * 1e-3).is_some_and(|views| fits(&views)));
    if let Some(sigma) = probed {
        return vec![format!(
            "Points without `sigma` are exact, and no pose fits exactly; with errors of {sigma} mm (`sigma`, a length, at each [[point]] and \
             [[fence]]) one does."
        )];
    }
    let factors = UNITS_M.into_iter().flat_map(|from| UNITS_M.into_iter().map(move |to| to / from));
    let unit = factors.filter(|factor| (factor - 1.0).abs() > 1e-9).find(|factor| fits(&views.scaled(*factor)));
    if let Some(factor) = unit {
        return vec![format!(
            "With the lengths of the views {factor:.5} times as long a pose fits: check `unit` in the files."
        )];
    }
    let alone = views.each_left_out().into_iter().filter(|(_, left)| fits(left));
    let told = |(name, left): (String, Views)| {
        let far = far_off(found, views, &name, &left).map_or(String::new(), |far| format!(", {far}"));
        format!("Without {name} a pose fits{far}: was it read well? Read it anew, or leave it out.")
    };
    let alone: Vec<_> = alone.map(told).collect();
    if alone.is_empty() {
        let asked = "Is it this part, does it lie on the face that the file shows, was each view read well?";
        return vec![format!("No single view is to blame, nor a unit. {asked}")];
    }
    alone
}

/// How far outside of the gate a point is that is left out, from the pose that fits all else best.
fn far_off(found: &[Found], views: &Views, name: &str, left: &Views) -> Option<String> {
    let index: usize = name.strip_prefix("point ")?.parse().ok()?;
    let touch = views.felt.as_ref()?.touches.get(index)?;
    let fits = found.iter().filter_map(|found| match (outcome(&found.part, left), &found.outcome) {
        (Ok(Fits::Noisy(without)), Ok(Fits::Noisy(all))) => Some((found, without.modes.into_iter().next()?, all.gate)),
        _ => None,
    });
    let (best, mode, gate) = fits.min_by(|a, b| a.1.chi2.total_cmp(&b.1.chi2))?;
    let point = nalgebra::Isometry2::new([mode.pose.x, mode.pose.y].into(), mode.pose.theta).inverse() * touch.point;
    let corners = best.part.outline.vertices();
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    let off = edges.map(|(from, to)| distance_to_segment(point, *from, *to)).fold(f64::INFINITY, f64::min);
    let share = off / touch.sigma;
    Some(format!(
        "from which it is {:.3} mm off, {share:.1} of its standard deviations (χ² of {:.0}, and all together may have {gate:.1})",
        off * 1e3,
        share * share
    ))
}

/// Points that tell the poses that fit apart, with the poses' names; none for fewer than two (thesis §2.3, last
/// paragraph).
fn resolve(found: &[Found], request: &PlanArguments) -> Option<(Vec<String>, Planned)> {
    let (mut names, mut outlines) = (Vec::new(), Vec::new());
    for Found { part, outcome } in found {
        let poses = outcome.as_ref().map_or_else(|_| Vec::new(), Fits::poses);
        for pose in &poses {
            let motion = nalgebra::Isometry2::new([pose.x, pose.y].into(), pose.theta);
            // Poses that look the same differ by rounding; they are not to be told apart by it.
            let placed: Vec<_> = part.outline.vertices().iter().map(|p| snapped(motion * p)).collect();
            // A pose moves the outline by rounding alone, so what was a polygon is one.
            outlines.push(SimplePolygon::new(placed).ok()?);
            names.push(format!("{}, pose {}", part.name, outlines.len()));
        }
    }
    (outlines.len() > 1).then(|| (names, request.plan(&outlines, 0.0)))
}

impl Arguments {
    /// Places parts as they go by.
    fn follow(&self, passing: &Path) -> miette::Result<ExitCode> {
        let file = read(passing, PassingFile::parse)?;
        let names = names(&self.parts);
        let parts = self.parts.iter().zip(&names).map(|(path, name)| {
            // Beams touch the hull, and notches are no matter.
            let part = read_beside(path, |text, open| NamedPart::parse_beside(name, text, true, open))?;
            match part.shape {
                Outline::Polygon(_) => Ok(part),
                _ => Err(ViewFileError::Together {
                    what: "beams",
                    with: "a smooth part",
                    remedy: "describe it by many vertices",
                })
                .into_diagnostic(),
            }
        });
        let parts = parts.collect::<miette::Result<Vec<_>>>()?;
        passing::follow(&parts, &file, &self.device, self.json, &self.plot)
    }

    /// The next view of the part that fits best; with exact readings there is nothing to gain.
    fn next_view(&self, found: &[Found], views: &Views) -> Option<PlannedView> {
        let candidates = found.iter().filter_map(|found| match &found.outcome {
            Ok(Fits::Noisy(estimate)) if views.felt.is_none() => {
                Some((&found.part.convex, estimate.modes.as_slice(), estimate.modes.first()?.chi2))
            }
            _ => None,
        });
        let (part, modes, _) = candidates.min_by(|a, b| a.2.total_cmp(&b.2))?;
        let radius = self.next_view_mm.map(|mm| mm * 1e-3).or_else(|| first_distance(part, modes, views))?;
        plan_view(part, &views.readings, modes, radius)
    }

    fn figure(
        &self,
        found: &[Found],
        views: &Views,
        next: Option<PlannedView>,
        points: &[Circle],
    ) -> crate::pictures::plot::Figure {
        let shown = |found: &Found| match &found.outcome {
            Ok(fits) => fits.poses(),
            Err(_) => Vec::new(),
        };
        let all: Vec<_> = found
            .iter()
            .flat_map(|found| shown(found).into_iter().map(|pose| Shown { part: &found.part, pose }))
            .collect();
        let names: Vec<_> = found.iter().map(|found| found.part.name.as_str()).collect();
        let title = format!("{} from {}", names.join(", "), in_words(views));
        let subtitles: Vec<_> = found.iter().map(in_a_line).collect();
        InscribePicture { views, poses: &all, next, points, fences: "fence", title: &title, subtitles: &subtitles }
            .figure()
    }
}

/// What was read, such as "2 views and 1 point".
fn in_words(views: &Views) -> String {
    let counts = [(views.cones.len(), "view"), (views.readings.fences.len(), "fence"), (views.points.len(), "point")];
    let present = counts.iter().filter(|(count, _)| *count > 0);
    let words: Vec<_> = present.map(|(count, name)| counted(*count, name)).collect();
    words.join(" and ")
}

/// How far the first sensor is from the part.
fn first_distance(part: &ConvexPolygon, modes: &[PoseMode], views: &Views) -> Option<f64> {
    let pose = modes.first()?.pose;
    let centre = nalgebra::Isometry2::new([pose.x, pose.y].into(), pose.theta) * part.centre();
    views.readings.bearings.first().map(|bearing| (centre - bearing.apex).norm())
}

/// What came of a part in one line.
fn in_a_line(found: &Found) -> String {
    let name = &found.part.name;
    match &found.outcome {
        Err(continuum) => format!("{name}: {continuum}"),
        Ok(fits) => match fits.poses().as_slice() {
            [] => format!("{name}: no pose fits"),
            [_] => format!("{name}: one pose"),
            several => {
                let is_notched = ConvexPolygon::new(&found.part.outline).is_err();
                let groups = if is_notched { several.len() } else { found.part.shape.congruent_groups(several).len() };
                let alike =
                    if groups < several.len() { format!(", {groups} that look different") } else { String::new() };
                format!("{name}: {} poses{alike}", several.len())
            }
        },
    }
}

pub(super) fn tell(found: &[Found], views: &Views, next: Option<PlannedView>) {
    // Numbered through all parts, as in the picture.
    let mut number = 1;
    for found in found {
        say!("{}", folded(&in_a_line(found)));
        match &found.outcome {
            Ok(Fits::Exact(poses)) if !poses.is_empty() => tell_exact(&found.part, poses, views, number),
            Ok(Fits::Noisy(estimate)) if !estimate.modes.is_empty() => tell_noisy(estimate, number),
            _ => {}
        }
        number += found.outcome.as_ref().map_or(0, |fits| fits.poses().len());
    }
    if let [first, second, ..] = best_fits(found).as_slice() {
        say!("{}", folded(&format!("{first} and {second} both fit: another view may tell them apart")));
    }
    if let Some(next) = next {
        say!("{}", folded(&next_in_words(&next)));
    }
}

/// The names of the parts that fit, if there was a choice.
fn best_fits(found: &[Found]) -> Vec<&str> {
    let fits = |found: &&Found| found.outcome.as_ref().is_ok_and(|fits| !fits.poses().is_empty());
    found.iter().filter(fits).map(|found| found.part.name.as_str()).collect()
}

fn tell_exact(part: &NamedPart, poses: &[Pose], views: &Views, first: usize) {
    say!("  pose      x [mm]      y [mm]    turned [°]   held");
    let lines = views.readings.lines();
    for (k, pose) in poses.iter().enumerate() {
        let held = part.shape.conditioning(&lines, &views.points, pose);
        say!(
            "  {:>4} {:>11.4} {:>11.4} {:>13.5} {held:>6.3}",
            first + k,
            pose.x * 1e3,
            pose.y * 1e3,
            turn_deg(pose.theta)
        );
    }
    say!("  held: an error of the readings moves the pose by one over this");
}

fn tell_noisy(estimate: &InscriptionEstimate, first: usize) {
    say!("  pose     x [mm]     y [mm] turned [°]     ± x     ± y  ± turn     χ²");
    for (k, mode) in estimate.modes.iter().enumerate() {
        let sd = |axis: usize| mode.covariance[(axis, axis)].sqrt();
        let note = if mode.at_corner_change { "  bent" } else { "" };
        say!(
            "  {:>4} {:>10.3} {:>10.3} {:>10.3} {:>7.3} {:>7.3} {:>7.3} {:>6.2}{note}",
            first + k,
            mode.pose.x * 1e3,
            mode.pose.y * 1e3,
            turn_deg(mode.pose.theta),
            sd(0) * 1e3,
            sd(1) * 1e3,
            sd(2).to_degrees(),
            mode.chi2
        );
    }
    if estimate.modes.iter().any(|mode| mode.at_corner_change) {
        say!("  bent: errors are not normal there, as the part touches with another corner");
    }
    say!("  χ² of {} of freedom; accepted up to {:.1} (99 %)", counted(estimate.dof, "degree"), estimate.gate);
}

fn next_in_words(next: &PlannedView) -> String {
    let apart = match next.separation {
        None => "",
        Some(_) if next.tells_apart() => ", and would tell the poses apart",
        Some(_) => ", but may not tell all poses apart",
    };
    format!(
        "a view from ({:.0}, {:.0}) mm would narrow ± {:.3} mm, {:.3}° to ± {:.3} mm, {:.3}°{apart}",
        next.site.x * 1e3,
        next.site.y * 1e3,
        next.position_sd_before * 1e3,
        next.theta_sd_before.to_degrees(),
        next.position_sd * 1e3,
        next.theta_sd.to_degrees()
    )
}

pub(super) fn json(found: &[Found], views: &Views, next: Option<PlannedView>) -> Value {
    let next = next.map(|next| {
        json!({"site": [next.site.x, next.site.y], "position_sd": next.position_sd, "theta_sd": next.theta_sd,
               "separation": next.separation, "tells_apart": next.tells_apart()})
    });
    json!({"parts": found.iter().map(|found| part_json(found, views)).collect::<Vec<_>>(), "next_view": next})
}

fn part_json(found: &Found, views: &Views) -> Value {
    let name = &found.part.name;
    let array = |pose: &Pose| json!([pose.x, pose.y, pose.theta]);
    match &found.outcome {
        Err(continuum) => {
            json!({"name": name, "status": "underdetermined", "reason": continuum.to_string(), "poses": []})
        }
        Ok(Fits::Exact(poses)) => {
            let lines = views.readings.lines();
            let held: Vec<_> =
                poses.iter().map(|pose| found.part.shape.conditioning(&lines, &views.points, pose)).collect();
            json!({"name": name, "status": status(poses.is_empty()), "poses": poses.iter().map(array).collect::<Vec<_>>(),
                   "conditioning": held, "groups": found.part.shape.congruent_groups(poses)})
        }
        Ok(Fits::Noisy(estimate)) => {
            let mode = |mode: &PoseMode| {
                let row = |k: usize| [mode.covariance[(k, 0)], mode.covariance[(k, 1)], mode.covariance[(k, 2)]];
                json!({"pose": array(&mode.pose), "chi2": mode.chi2, "covariance": [row(0), row(1), row(2)]})
            };
            json!({"name": name, "status": status(estimate.modes.is_empty()), "dof": estimate.dof,
                   "modes": estimate.modes.iter().map(mode).collect::<Vec<_>>()})
        }
    }
}

fn status(is_empty: bool) -> &'static str {
    if is_empty { "no_pose" } else { "ok" }
}
