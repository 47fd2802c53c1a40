//! `palpate push --quasi-static`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::{Point2, Vector2};
use palpate::geometry::{Element, Pose};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::pushing::quasi_static::{SlowChange, SlowContact, SlowEnd, SlowMode, SlowSample};
use palpate_files::part::PartFile;
use palpate_files::recordings::path::{self, RecordedPath};
use palpate_files::solve::kinds::quasi_static::QuasiStaticAnswer;

use super::plot::PlotArguments;
use super::push::fixed;
use super::read::{read, report_problems};
use super::touch_world::pose_mm;
use super::{not_negative, positive};
use crate::pictures::plot::Figure;
use crate::pictures::slow_push::{SAMPLES, SlowPushPicture};
use crate::push_scenario::slow::{SlowPlan, SlowWay, SlowlyPushed};
use crate::width::folded;

/// Slow pushes.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Slow pushes (--quasi-static)")]
pub(super) struct SlowArguments {
    /// Push so slowly that friction alone decides: no inertia, no speed, no time
    #[arg(long, conflicts_with_all = [
        "around_deg", "speed_mm_s", "acceleration_mm_s2", "acceleration_direction_deg", "then", "turning_deg_s",
        "contact", "time_s", "limit_surface",
    ])]
    quasi_static: bool,

    /// How far to push
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = 20.0, requires = "quasi_static")]
    distance_mm: f64,

    /// Places of the disk's centre instead: a table of t, x, y in s and m (or as its header says), straight between, as
    /// `palpate import` writes it; its times do not count
    #[arg(long, value_name = "PATH.csv", requires = "quasi_static")]
    #[arg(conflicts_with_all = ["edge", "s_mm", "direction_deg", "distance_mm"])]
    path: Option<PathBuf>,

    /// Where the part lies at first, in the path's frame: X,Y in mm of its file's origin, and its turn in degrees [default:
    /// as drawn]
    #[arg(long, value_name = "X,Y,DEG", value_parser = pose_mm, allow_hyphen_values = true, requires = "path")]
    pose: Option<Pose>,

    /// Follow the path within this by as few straight pieces as that takes: places that were measured in steps make
    /// corners that no finger made
    #[arg(long, value_name = "MM", value_parser = positive, requires = "path")]
    within_mm: Option<f64>,

    /// The largest friction between part and finger while they stick [default: as while they slide]
    #[arg(long, value_name = "MU", value_parser = not_negative, allow_negative_numbers = true, requires = "quasi_static")]
    mu_c_static: Option<f64>,

    /// Height of the contact above the table: load moves towards where the part is pushed
    #[arg(long, value_name = "MM", value_parser = not_negative, allow_negative_numbers = true)]
    #[arg(default_value_t = 0.0, requires = "quasi_static")]
    height_mm: f64,

    /// Radius of the ring on which each foot stands
    #[arg(long, value_name = "MM", value_parser = not_negative, allow_negative_numbers = true)]
    #[arg(default_value_t = 1.0, requires = "quasi_static")]
    ring_radius_mm: f64,
}

impl SlowArguments {
    pub(super) fn is_asked(&self) -> bool {
        self.quasi_static
    }
}

/// A slow push as it was asked for.
pub(super) struct SlowlyPushing<'a> {
    /// Of the part's file, without its folder.
    pub(super) name: String,
    pub(super) part: &'a Path,
    pub(super) file: &'a PartFile,
    pub(super) edge: Option<usize>,
    /// m.
    pub(super) s: Option<f64>,
    /// rad.
    pub(super) direction: f64,
    /// m.
    pub(super) radius: f64,
    pub(super) mu_c: Option<f64>,
    pub(super) rows: u32,
    pub(super) json: bool,
}

impl SlowlyPushing<'_> {
    pub(super) fn run(&self, slow: &SlowArguments, plot: &PlotArguments) -> miette::Result<ExitCode> {
        let plan = self.plan(slow)?;
        let cannot = || format!("cannot push {}", self.part.display());
        let run = |parts| plan.run(self.file, parts).into_diagnostic().wrap_err_with(cannot);
        let pushed = run(self.rows)?;
        let text = if self.json { json(&pushed)? } else { self.table(&pushed) };
        plot.draw(|| Ok(self.figure(&plan, &run(SAMPLES)?)))?;
        super::write_out(format_args!("{text}"));
        Ok(ExitCode::SUCCESS)
    }

    fn plan(&self, slow: &SlowArguments) -> miette::Result<SlowPlan> {
        let sliding = self.mu_c.unwrap_or(0.0);
        let sticking = slow.mu_c_static.unwrap_or(sliding);
        if sticking < sliding {
            let help =
                "what sticks holds no less than what slides: check --mu-c-static and --mu-c, or mu_c in the part file";
            return Err(miette::miette!(
                help = help,
                "--mu-c-static {sticking} is less than the friction of sliding, {sliding}"
            ));
        }
        Ok(SlowPlan {
            way: self.way(slow)?,
            radius: self.radius,
            contact_friction: [sliding, sticking],
            height: slow.height_mm * 1e-3,
            ring_radius: slow.ring_radius_mm * 1e-3,
        })
    }

    fn way(&self, slow: &SlowArguments) -> miette::Result<SlowWay> {
        let Some(file) = &slow.path else {
            let Some(edge) = self.edge else {
                let help = "give --edge, from this vertex to the next, or --path with the finger's places";
                return Err(miette::miette!(help = help, "where to push at {} is not said", self.name));
            };
            let distance = slow.distance_mm * 1e-3;
            return Ok(SlowWay::Straight { edge, s: self.s, direction: self.direction, distance });
        };
        let RecordedPath { places, problems, .. } = read(file, path::parse)?;
        report_problems(file, &problems);
        let length: f64 = places.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        if length == 0.0 {
            let help = "give at least two places that differ";
            return Err(miette::miette!(help = help, "the finger does not move in {}", file.display()));
        }
        let places = match slow.within_mm {
            Some(within) => straightened(&places, within * 1e-3),
            None => places,
        };
        let pose = slow.pose.unwrap_or(Pose { x: 0.0, y: 0.0, theta: 0.0 });
        Ok(SlowWay::Along { places, pose })
    }

    fn table(&self, pushed: &SlowlyPushed) -> String {
        let mut text = format!(
            "{:>7} {:>17} {:>7} {:>17} {:>15}\n",
            "way", "centre of mass", "turned", "touched", "force / weight"
        ) + &line(["[mm]", "x [mm]", "y [mm]", "[°]", "at", "s [mm]", "into", "along", "contact"]);
        for (length, sample) in pushed.lengths.iter().zip(&pushed.run.samples) {
            text += &self.row(*length, sample);
        }
        for change in changes(pushed) {
            text += &format!("{:.3} mm: {}\n", change.length * 1e3, begins(change));
        }
        text + &folded(&end_in_words(pushed)) + "\n"
    }

    fn row(&self, length: f64, sample: &SlowSample) -> String {
        let centre = sample.pose.isometry() * self.file.part.centre_of_mass();
        let contact = sample.contact.map(|contact| self.seen(sample, &contact));
        let (at, s, force) =
            contact.map_or(("--".to_owned(), "--".to_owned(), ["--".to_owned(), "--".to_owned()]), |seen| {
                (
                    seen.at,
                    seen.s.map_or_else(|| "--".to_owned(), |s| fixed(s * 1e3, 3)),
                    seen.force.map(|part| fixed(part, 4)),
                )
            });
        line([
            &fixed(length * 1e3, 3),
            &fixed(centre.x * 1e3, 2),
            &fixed(centre.y * 1e3, 2),
            &fixed(sample.pose.theta.to_degrees(), 2),
            &at,
            &s,
            &force[0],
            &force[1],
            verb(sample.contact.map(|contact| contact.mode)),
        ])
    }

    /// The contact as a person tells it.
    fn seen(&self, sample: &SlowSample, contact: &SlowContact) -> Seen {
        let (sin, cos) = contact.normal_angle.sin_cos();
        let normal = Vector2::new(cos, sin);
        let force = contact.force / GRAVITY_ASSUMED;
        let force = [-force.dot(&normal), force.dot(&Vector2::new(-normal.y, normal.x))];
        match contact.element {
            Element::Vertex(vertex) => Seen { at: format!("vertex {vertex}"), s: None, force },
            Element::Edge(edge) => {
                let part_point = sample.pose.isometry().inverse_transform_point(&contact.at);
                let outline = self.file.part.outline();
                Seen { at: format!("edge {edge}"), s: Some(place(&outline, edge, part_point, self.file)), force }
            }
        }
    }

    fn figure(&self, plan: &SlowPlan, pushed: &SlowlyPushed) -> Figure {
        let [sliding, sticking] = plan.contact_friction;
        let sticking = if sticking > sliding { format!(" ({sticking} sticking)") } else { String::new() };
        let height =
            if plan.height > 0.0 { format!(", {} mm above the table", plan.height * 1e3) } else { String::new() };
        let subtitles = [
            format!(
                "µ {} on the table, {sliding}{sticking} at the finger; finger: radius {} mm{height}",
                self.file.mu,
                self.radius * 1e3
            ),
            end_in_words(pushed),
        ];
        let title = match &plan.way {
            SlowWay::Straight { edge, .. } => format!("Pushing {} slowly at edge {edge}", self.name),
            SlowWay::Along { .. } => format!("Pushing {} slowly along a path", self.name),
        };
        let picture = SlowPushPicture {
            file: self.file,
            pushed,
            radius: self.radius,
            friction: sliding,
            title: &title,
            subtitles: &subtitles,
        };
        picture.figure()
    }
}

/// A contact in a person's words.
struct Seen {
    at: String,
    /// Along the edge from the foot of the perpendicular through the centre of mass, m.
    s: Option<f64>,
    /// Into the part, and along its edge, as shares of its weight.
    force: [f64; 2],
}

/// Place of a point (part frame) on an edge, m.
fn place(outline: &[Point2<f64>], edge: usize, point: Point2<f64>, file: &PartFile) -> f64 {
    let along = outline[(edge + 1) % outline.len()] - outline[edge];
    (point - file.part.centre_of_mass()).dot(&along.normalize())
}

/// The fewest of the places between which straight lines pass within this of all (m); the first and last stay.
fn straightened(places: &[Point2<f64>], within: f64) -> Vec<Point2<f64>> {
    let mut kept = vec![places[0]];
    let mut begin = 0;
    while begin + 1 < places.len() {
        let fits = |end: &usize| {
            let inner = &places[begin + 1..*end];
            inner
                .iter()
                .all(|place| palpate::geometry::distance_to_segment(*place, places[begin], places[*end]) <= within)
        };
        // As far as it fits; a path may come back, so not the farthest that does.
        begin = (begin + 1..places.len()).take_while(fits).last().unwrap_or(begin + 1);
        kept.push(places[begin]);
    }
    kept
}

/// Changes on the way: what is at its start is in the first row.
fn changes(pushed: &SlowlyPushed) -> impl Iterator<Item = &SlowChange> {
    pushed.run.changes.iter().filter(|change| change.length > 0.0)
}

fn begins(change: &SlowChange) -> &'static str {
    match change.to {
        Some(SlowMode::Sticking) => "the contact sticks from here on",
        Some(SlowMode::Sliding) => "the contact slides from here on",
        None => "the finger leaves the part",
    }
}

fn verb(mode: Option<SlowMode>) -> &'static str {
    match mode {
        Some(SlowMode::Sticking) => "sticks",
        Some(SlowMode::Sliding) => "slides",
        None => "free",
    }
}

/// Cells in their columns.
fn line([way, x, y, turned, at, s, into, along, contact]: [&str; 9]) -> String {
    format!("{way:>7} {x:>8} {y:>8} {turned:>7} {at:>8} {s:>8} {into:>7} {along:>7} {contact}\n")
}

fn end_in_words(pushed: &SlowlyPushed) -> String {
    let why = match pushed.run.end {
        SlowEnd::Path => "the way was over",
        SlowEnd::SecondContact => "the finger met a second point of the part: two contacts are not simulated",
        SlowEnd::Tip => "the supports cannot hold the part any more: it tips",
    };
    format!("ended after {:.3} mm: {why}", pushed.run.length * 1e3)
}

fn json(pushed: &SlowlyPushed) -> miette::Result<String> {
    Ok(serde_json::to_string(&QuasiStaticAnswer::from(pushed.run.clone())).into_diagnostic()? + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_staircase_along_a_line_is_a_line() {
        // Steps of 0.1 mm along a slope, and back at its end.
        let step = |value: f64| (value / 1e-4).round() * 1e-4;
        let there = (0..200).map(|k| f64::from(k) * 5e-5).map(|x| Point2::new(step(x), step(0.3 * x)));
        let mut places: Vec<_> = there.collect();
        places.push(Point2::new(0.0, 0.003));
        let kept = straightened(&places, 1.1e-4);
        assert!(kept.len() <= 4, "{kept:?}");
        assert_eq!((kept[0], *kept.last().unwrap()), (places[0], *places.last().unwrap()));
        assert_eq!(straightened(&places, 1e-9).last(), places.last());
    }

    #[test]
    fn forces_are_told_into_the_part_and_along_its_edge() {
        let file = PartFile::parse("unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3").unwrap();
        let pushing = SlowlyPushing {
            name: String::new(),
            part: Path::new("block.toml"),
            file: &file,
            edge: Some(0),
            s: None,
            direction: 0.0,
            radius: 5e-3,
            mu_c: None,
            rows: 1,
            json: false,
        };
        let pose = Pose { x: 0.1, y: 0.2, theta: 1.0 };
        let normal = pose.isometry() * Vector2::new(0.0, -1.0);
        let contact = SlowContact {
            at: pose.isometry() * Point2::new(0.04, 0.0),
            normal_angle: normal.y.atan2(normal.x),
            element: Element::Edge(0),
            mode: SlowMode::Sliding,
            force: pose.isometry() * Vector2::new(0.1, 0.3) * GRAVITY_ASSUMED,
        };
        let seen = pushing.seen(&SlowSample { pose, contact: Some(contact) }, &contact);
        assert!((seen.s.unwrap() - 0.01).abs() < 1e-12);
        assert!((seen.force[0] - 0.3).abs() < 1e-12 && (seen.force[1] - 0.1).abs() < 1e-12, "{:?}", seen.force);
    }
}
