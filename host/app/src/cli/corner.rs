//! `palpate corner`.

use std::path::PathBuf;
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, miette};
use nalgebra::{Point2, Vector2};
use palpate::corner::{Corner, CornerPose, Flush, different_outlines, same_outline_within};
use palpate::geometry::SimplePolygon;
use palpate::inscription::Outline;
use palpate::point_sampling::Plan;
use palpate_files::solve::kinds::corner_poses::{CornerPosesAnswer, RestPose};
use palpate_files::views::NamedPart;

use super::plot::PlotArguments;
use super::read::read_beside;
use super::sample::{PlanArguments, plan_in_words, print_plan};
use super::{counted, finite, turn_deg};
use crate::pictures::point_sampling::SamplingPicture;

/// Finds the poses in which a part comes to rest when it is pushed into a corner, and points that tell them apart.
///
/// Fence A runs along +x, fence B at the corner's angle; the part lies between them. A pose is listed where both fences
/// are touched and an edge of the hull lies flush on one. The part rests in those that are stable under a push without
/// friction. Poses of a symmetric part whose outlines are the same are one for --sample.
#[derive(Debug, clap::Args)]
#[command(
    after_long_help = "The part file is that of `palpate push`; its unit and vertices are used, and its centre_of_mass: \
                       without one, the part weighs the same everywhere.\n\n\
                       Exit status: 0, 1 if a file cannot be used or outlines cannot be told apart, 64 wrong command line.",
    mut_group("PlanArguments", |group| group.requires("sample"))
)]
pub(crate) struct Arguments {
    /// The part file
    #[arg(value_name = "PART.toml")]
    part: PathBuf,
    /// Angle between the fences
    #[arg(long, value_name = "DEGREES", value_parser = finite, allow_negative_numbers = true, default_value_t = 90.0)]
    angle_deg: f64,
    /// Where the push goes, counter-clockwise from +x [default: along the bisector into the corner]
    #[arg(long, value_name = "DEGREES", value_parser = finite, allow_negative_numbers = true)]
    push_deg: Option<f64>,
    /// Leave out poses that are not stable
    #[arg(long)]
    stable: bool,
    /// Plan points that tell the poses apart
    #[arg(long)]
    sample: bool,
    #[command(flatten)]
    plan: PlanArguments,
    /// Print one JSON object: the poses as `palpate solve` does, or with --sample the plan for
    /// `palpate sample --decode`
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    plot: PlotArguments,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    // The fences touch the hull, whatever the outline.
    let file = read_beside(&arguments.part, |text, open| NamedPart::parse_beside("", text, true, open))?;
    if !matches!(file.shape, Outline::Polygon(_)) {
        let help = "describe it by `vertices`, without `rounding`";
        return Err(miette!(help = help, "{} is a smooth part, no edge of which lies flush", arguments.part.display()));
    }
    let angle = arguments.angle_deg.to_radians();
    if !(angle > 0.0 && angle < std::f64::consts::PI) {
        let help = "the fences meet at an angle between 0 and 180°";
        return Err(miette!(help = help, "--angle-deg {} makes no corner", arguments.angle_deg));
    }
    let push = arguments.push_deg.map_or(angle / 2.0 + std::f64::consts::PI, f64::to_radians);
    let corner = Corner::new(angle, Vector2::new(push.cos(), push.sin())).into_diagnostic()?;
    let part = &file.outline;
    let centre_of_mass = file.centre_of_mass.unwrap_or_else(|| part.centroid());
    let mut poses = corner.poses_of_mass_at(part, centre_of_mass);
    poses.retain(|pose| !arguments.stable || pose.is_stable());
    let outlines =
        poses.iter().map(|pose| corner.placed(part, pose)).collect::<Result<Vec<_>, _>>().into_diagnostic()?;
    let kinds = different_outlines(&outlines);
    let planned = arguments.sample.then(|| {
        let different: Vec<_> = kinds.iter().map(|kind| outlines[kind[0]].clone()).collect();
        // Regions thinner than what makes two outlines one are none.
        arguments.plan.plan(&different, same_outline_within(part))
    });
    let names: Vec<String> = kinds.iter().map(|kind| names(&poses, kind)).collect();
    match (&planned, arguments.json) {
        (Some(planned), true) => super::sample::print_json(&names, &planned.plan)?,
        (None, true) => {
            let answer = CornerPosesAnswer { poses: poses.iter().map(RestPose::from).collect() };
            say!("{}", serde_json::to_string(&answer).into_diagnostic()?);
        }
        (planned, false) => {
            print_poses(&poses);
            if let Some(planned) = planned {
                if kinds.len() < poses.len() {
                    let outlines = counted(kinds.len(), "outline");
                    say!("the part looks the same in some of these poses: {outlines} to tell apart");
                }
                print_plan(&names, planned);
            }
        }
    }
    let plan = planned.as_ref().map(|planned| &planned.plan);
    arguments.plot.draw(|| Ok(arguments.figure(&outlines, plan, angle)))?;
    Ok(plan.map_or(ExitCode::SUCCESS, super::sample::status))
}

impl Arguments {
    fn figure(&self, outlines: &[SimplePolygon], plan: Option<&Plan>, angle: f64) -> crate::pictures::plot::Figure {
        let file = self.part.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let title = format!("{file} in a corner of {}°", self.angle_deg);
        let points = plan.map_or(&[][..], |plan| &plan.points);
        let reach = outlines.iter().flat_map(SimplePolygon::vertices).map(|p| p.coords.norm()).fold(0.0, f64::max);
        let along = |angle: f64| [Point2::origin(), Point2::new(reach * angle.cos(), reach * angle.sin())];
        let mut subtitles = vec![counted(outlines.len(), "pose")];
        subtitles.extend(plan.map(plan_in_words));
        let fences = [along(0.0), along(angle)];
        SamplingPicture { polygons: outlines, points, fences: &fences, title: &title, subtitles: &subtitles }.figure()
    }
}

/// The poses in which the part has one outline.
fn names(poses: &[CornerPose], kind: &[usize]) -> String {
    kind.iter().map(|&pose| name(&poses[pose])).collect::<Vec<_>>().join(" or ")
}

fn name(pose: &CornerPose) -> String {
    let flush = flush_name(pose.flush);
    let stable = if pose.is_stable() { "" } else { ", not stable" };
    format!("{flush} at {:.2}°{stable}", turn_deg(pose.theta))
}

fn flush_name(flush: Flush) -> &'static str {
    match flush {
        Flush::A => "flush on A",
        Flush::B => "flush on B",
        Flush::Both => "flush on both",
    }
}

fn print_poses(poses: &[CornerPose]) {
    let stable = poses.iter().filter(|pose| pose.is_stable()).count();
    say!("{}, {stable} stable", counted(poses.len(), "pose"));
    say!("{:>4} {:>9} {:>9} {:>9}  {:<14} {:>16}", "pose", "x [mm]", "y [mm]", "turn [°]", "", "margin [mm/rad]");
    for (number, pose) in poses.iter().enumerate() {
        say!(
            "{:>4} {:>9.3} {:>9.3} {:>9.3}  {:<14} {:>16.3}  {}",
            number + 1,
            pose.origin.x * 1e3,
            pose.origin.y * 1e3,
            turn_deg(pose.theta),
            flush_name(pose.flush),
            pose.margin * 1e3,
            if pose.is_stable() { "stable" } else { "" }
        );
    }
}
