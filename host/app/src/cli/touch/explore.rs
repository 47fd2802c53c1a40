//! `palpate touch --explore`: the outline of an unknown part, as a part file.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Point2;
use palpate::inscription::{Exploration, ExploredOutline, Met, NextTouch};
use palpate_files::output;
use palpate_files::part::PolygonFile;
use serde_json::{Value, json};

use super::carriers::Speeds;
use super::told::{EXIT_OPEN, Told, after};
use super::{Arguments, Ground, Sought, locate};
use crate::cli::positive;
use crate::cli::touch_world::{five_corners, read_part};
use crate::live::interrupt;
use crate::pictures::plot::{Colour, Figure, Fill, Key, PlotScene, Stroke, Style};
use crate::pictures::touch::TouchLeft;
use crate::width::folded;

/// Approaches for each touch that is asked for, at most: some meet nothing.
const APPROACHES_A_TOUCH: usize = 4;

/// Of a simulated part that is held still, kg.
pub(super) const HELD_MASS: f64 = 1000.0;

/// An unknown part.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Unknown part")]
pub(super) struct ExplorationArguments {
    /// Find the outline of an unknown part that is held still
    #[arg(long, conflicts_with_all = ["part", "library"], requires = "out")]
    explore: bool,

    /// Write it to this part file, in the robot's frame
    #[arg(long, value_name = "PART.toml", requires = "explore", conflicts_with_all = ["part", "library"])]
    out: Option<PathBuf>,

    /// Touch it so often
    #[arg(long, value_name = "N", default_value_t = 60, conflicts_with_all = ["part", "library"])]
    touches: usize,

    /// Friction between part and table for that file: touches do not tell it
    #[arg(long, value_name = "MU", default_value_t = 0.3, value_parser = positive, conflicts_with_all = ["part", "library"])]
    mu: f64,
}

impl ExplorationArguments {
    pub(super) fn is_asked(&self) -> bool {
        self.explore
    }
}

pub(super) fn run(arguments: &Arguments, told: Told) -> miette::Result<ExitCode> {
    let exploration = &arguments.exploration;
    let Some(out) = &exploration.out else { return Err(miette::miette!("say where to write the part: --out")) };
    if out.exists() {
        // Said before an hour of touching.
        return Err(miette::miette!(help = "choose another name, or move it away", "{} is there", out.display()));
    }
    let speeds = Speeds::held(&arguments.motion)?;
    speeds.tell_held();
    let mut carrier = arguments.carrier(&simulated_part(arguments.simulated_part.as_deref())?, &speeds)?;
    let mut sought = SoughtOutline {
        exploration: Exploration::new(arguments.radius_mm * 1e-3, arguments.area_mm.0),
        touches: exploration.touches,
    };
    let most = arguments.approaches_max.unwrap_or(APPROACHES_A_TOUCH * exploration.touches);
    let ended = locate(&mut sought, carrier.as_mut(), told, most, &mut Vec::new());
    let Some(found) = sought.exploration.outline() else { return ended };
    // Up to where it ended early, too: what was felt is not lost.
    let written = write(out, &found, &sought.exploration, exploration.mu)
        .and_then(|()| arguments.plot.draw(|| Ok(figure(&found, &sought.exploration))));
    let status = ended?;
    match written {
        Err(error) if interrupt::requested() => note!("nothing is written: {error}; what was touched is no part yet"),
        written => written?,
    }
    Ok(status)
}

/// What lies in the simulated world.
fn simulated_part(file: Option<&str>) -> miette::Result<PolygonFile> {
    if let Some(file) = file {
        return read_part(Path::new(file));
    }
    PolygonFile::parse(&text(five_corners().vertices(), "mu = 0.3\n")).into_diagnostic()
}

/// A part file's outline.
fn text(vertices: &[Point2<f64>], rest: &str) -> String {
    let mut text = "unit = \"mm\"\nvertices = [\n".to_owned();
    for vertex in vertices {
        let _ = writeln!(text, "    [{:.5}, {:.5}],", vertex.x * 1e3, vertex.y * 1e3);
    }
    text + "]\n" + rest
}

/// Writes a part file, once it is one.
fn write(out: &Path, found: &ExploredOutline, exploration: &Exploration, mu: f64) -> miette::Result<()> {
    let named = || format!("cannot write {}", out.display());
    let sigma = format!(
        "outline_sigma = {:.4} # of each edge's line, root mean square along the outline\nmu = {mu} # told, and not felt\n",
        found.sigma() * 1e3
    );
    let text = format!(
        "# Felt by {} touches of a disk of {:.3} mm radius, in the robot's frame.\n{}",
        exploration.touches().len(),
        exploration.radius() * 1e3,
        text(found.outline.vertices(), &sigma)
    );
    PolygonFile::parse(&text).into_diagnostic().wrap_err("what was touched is no part yet").wrap_err_with(named)?;
    output::write_new(out, text.as_bytes()).into_diagnostic().wrap_err_with(named)?;
    note!("written to {}", out.display());
    Ok(())
}

/// How the outline is drawn.
const OUTLINE: Style =
    Style { stroke: Some(Stroke::solid(Colour::BLUE, 1.5)), fill: Some(Fill { colour: Colour::BLUE, opacity: 0.15 }) };

/// The outline with what was touched.
fn figure(found: &ExploredOutline, exploration: &Exploration) -> Figure {
    let mut scene = PlotScene::new("robot's frame");
    for touch in exploration.touches() {
        scene.disk(touch.centre, exploration.radius(), Style::line(Stroke::solid(Colour::GREY.faded(0.5), 0.5)));
    }
    scene.polygon(found.outline.vertices(), OUTLINE);
    for touch in exploration.touches() {
        scene.dot(touch.centre, Colour::DARK_GREY);
    }
    scene.key(Key::Line(Stroke::solid(Colour::BLUE, 1.5)), "outline found");
    scene.key(Key::Dot(Colour::DARK_GREY), "disk's centre at a touch");
    let title = format!("An unknown part after {} touches", exploration.touches().len());
    let sigma = format!("edges known to ± {:.3} mm (root mean square)", found.sigma() * 1e3);
    Figure::new(title, 640.0, 700.0).subtitle(sigma).column(1.0, vec![scene.into()])
}

/// The outline of an unknown part.
struct SoughtOutline {
    exploration: Exploration,
    touches: usize,
}

impl SoughtOutline {
    fn outline_json(&self) -> Value {
        self.exploration.outline().map_or(Value::Null, |found| {
            let vertices: Vec<_> = found.outline.vertices().iter().map(|vertex| [vertex.x, vertex.y]).collect();
            json!({ "vertices": vertices, "edge_sd": found.deviations, "outline_sigma": found.sigma() })
        })
    }
}

impl Sought for SoughtOutline {
    fn ground(&self) -> Ground {
        Ground { radius: self.exploration.radius(), area: self.exploration.area() }
    }

    fn next(&self) -> Option<NextTouch> {
        (self.exploration.touches().len() < self.touches).then(|| self.exploration.next()).flatten()
    }

    fn take(&mut self, next: &NextTouch, met: &Met) {
        self.exploration.take(&next.approach, met);
    }

    fn has_touched(&self) -> bool {
        !self.exploration.touches().is_empty()
    }

    fn left_json(&self) -> (&'static str, Value) {
        ("outline_sigma", self.exploration.outline().map_or(Value::Null, |found| found.sigma().into()))
    }

    fn say_left(&self) {
        if let Some(found) = self.exploration.outline() {
            let corners = found.outline.vertices().len();
            say!("  an outline of {corners} points, known to ± {:.3} mm", found.sigma() * 1e3);
        }
    }

    fn left(&self) -> (String, Vec<TouchLeft>) {
        let Some(found) = self.exploration.outline() else { return ("no outline yet".to_owned(), Vec::new()) };
        let words = format!("known to ± {:.3} mm", found.sigma() * 1e3);
        (words, vec![TouchLeft { outline: found.outline.vertices().to_vec(), kind: 0, name: None }])
    }

    fn end(&self, told: Told, approaches: usize, is_given_up: bool) -> miette::Result<u8> {
        let found = self.exploration.outline();
        let touches = self.exploration.touches().len();
        let status = if found.is_none() || is_given_up { EXIT_OPEN } else { 0 };
        if told.json {
            let outline = self.outline_json();
            say!("{}", json!({ "approaches": approaches, "touches": touches, "outline": outline }));
            return Ok(status);
        }
        let after = after(approaches, touches);
        let sentence = match &found {
            None => format!("Too little was touched to be an outline, {after}."),
            Some(found) => format!(
                "The outline has {} points and an area of {:.1} mm², {after}; its edges are known to ± {:.3} mm.",
                found.outline.vertices().len(),
                found.outline.area() * 1e6,
                found.sigma() * 1e3
            ),
        };
        say!("{}", folded(&sentence));
        Ok(status)
    }
}
