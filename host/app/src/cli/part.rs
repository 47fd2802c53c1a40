//! `palpate part`.

use std::path::PathBuf;
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Point2;
use palpate::geometry::{SimplePolygon, bounding_box, convex_hull};
use palpate::inscription::likeness::{Likeness, Likenesses, likenesses};
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::from_rest::symmetry;
use palpate_files::part::{DescribedPart, Doubt, FromDrawing, PartFile, Unit};
use palpate_files::shapes::{Height, Request, Up, draw};
use serde_json::{Value, json};

use super::plot::PlotArguments;
use super::read::{DRAWING, drawing_bytes, is_from_cad, read_beside};
use super::{counted, finite, positive, turn_deg};
use crate::pictures::part::PartPicture;
use crate::recording;
use crate::width::{COLUMNS, folded, folded_to};

/// Shows a part as palpate sees it, and what of it can be confused.
///
/// Takes a part file, or a drawing (.dxf, .svg) or a solid (.stl) from CAD at once. Tells outline, area, hull, symmetry, mass and feet; the
/// turns after which the outline is nearly the same, which touches confuse; and the sides at which pushes begin alike.
#[derive(Debug, clap::Args)]
#[command(
    after_long_help = "What the options say of a file from CAD stands in a part file as `outline = {file = \"part.stl\", unit = \"mm\", \
                       height = 8}`; other keys of it are `layer`, `curve_error`, `holes = \"fill\"`, `shadow = true` and `up`.\n\n\
                       Exit status: 0, 1 if the file cannot be used or the picture cannot be written, 64 wrong command line."
)]
pub(crate) struct Arguments {
    /// The part file, or a file from CAD
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Unit of a file from CAD that does not say: m, cm, mm or in
    #[arg(long, value_name = "UNIT", value_parser = unit)]
    unit: Option<Unit>,
    /// The only layer of a drawing to look at
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// How far chords may be from their curves [default: 0.05]
    #[arg(long, value_name = "MM", value_parser = positive)]
    curve_error_mm: Option<f64>,
    /// Take holes for material
    #[arg(long)]
    fill_holes: bool,
    /// Outline of a solid at this height above the table
    #[arg(long, value_name = "MM", value_parser = finite, conflicts_with = "shadow")]
    height_mm: Option<f64>,
    /// Outline of a solid as seen from above
    #[arg(long)]
    shadow: bool,
    /// Which direction of a solid's file points up: z, -z, x, -x, y or -y [default: z]
    #[arg(long, value_name = "AXIS", value_parser = up, allow_hyphen_values = true)]
    up: Option<Up>,
    /// Density of a solid, for its mass
    #[arg(long, value_name = "G/CM³", value_parser = positive)]
    density_g_cm3: Option<f64>,
    /// Outlines no further apart than this are one to a touch
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = 0.2)]
    alike_mm: f64,
    /// Print one JSON object; m, kg, rad
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    plot: PlotArguments,
}

fn unit(text: &str) -> Result<Unit, String> {
    let units = [Unit::Metre, Unit::Centimetre, Unit::Millimetre, Unit::Inch];
    let found = units.into_iter().find(|unit| unit.name() == text);
    found.ok_or_else(|| format!("`{text}` is none of m, cm, mm and in"))
}

fn up(text: &str) -> Result<Up, String> {
    let ups = [
        ("z", Up::PlusZ),
        ("-z", Up::MinusZ),
        ("x", Up::PlusX),
        ("-x", Up::MinusX),
        ("y", Up::PlusY),
        ("-y", Up::MinusY),
    ];
    let found = ups.into_iter().find(|(name, _)| *name == text).map(|(_, up)| up);
    found.ok_or_else(|| format!("`{text}` is none of z, -z, x, -x, y and -y"))
}

/// Beyond so many times what a touch cannot tell, likenesses are not worth a line.
const LIKE_TIMES: f64 = 10.0;

/// Most vertices that are listed.
const LISTED_MAX: usize = 40;

/// Most likenesses that are listed.
const LIKE_MAX: usize = 12;

/// A part, whatever file it is from.
struct Seen {
    part: DescribedPart,
    drawn: Option<FromDrawing>,
    outline_sigma: f64,
    doubts: Vec<Doubt>,
}

/// Options that any file from CAD takes.
const OF_FILE: [&str; 3] = ["--unit", "--curve-error-mm", "--fill-holes"];

/// Those that only drawings take.
const OF_DRAWING: [&str; 1] = ["--layer"];

/// Those that only solids take.
const OF_SOLID: [&str; 3] = ["--height-mm", "--shadow", "--up"];

/// That which a part file that names a solid takes, too.
const DENSITY: [&str; 1] = ["--density-g-cm3"];

/// What was found.
struct Found {
    outline: Vec<Point2<f64>>,
    polygon: Option<SimplePolygon>,
    hull: Vec<Point2<f64>>,
    area: f64,
    hull_area: f64,
    perimeter: f64,
    turned: Likenesses,
    flipped: Likenesses,
    order: usize,
    alike_sides: Vec<[usize; 2]>,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let seen = arguments.seen()?;
    for doubt in &seen.doubts {
        tracing::warn!("{}: {doubt}", arguments.file.display());
    }
    let found = Found::of(&seen, LIKE_TIMES * arguments.alike_mm * 1e-3);
    if arguments.json {
        say!("{}", serde_json::to_string(&arguments.json(&seen, &found)).into_diagnostic()?);
    } else {
        arguments.tell(&seen, &found);
    }
    arguments.plot.draw(|| Ok(arguments.figure(&seen, &found)))?;
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    /// Refuses options that this file makes no use of.
    fn refuse(&self, options: &[&str], why: &str) -> miette::Result<()> {
        let given = [
            ("--unit", self.unit.is_some()),
            ("--curve-error-mm", self.curve_error_mm.is_some()),
            ("--fill-holes", self.fill_holes),
            ("--layer", self.layer.is_some()),
            ("--height-mm", self.height_mm.is_some()),
            ("--shadow", self.shadow),
            ("--up", self.up.is_some()),
            ("--density-g-cm3", self.density_g_cm3.is_some()),
        ];
        let is_refused = |(option, is_given): &&(&str, bool)| *is_given && options.contains(option);
        let refused: Vec<_> = given.iter().filter(is_refused).map(|(option, _)| *option).collect();
        if refused.is_empty() {
            return Ok(());
        }
        let (options, file) = (refused.join(", "), self.file.display());
        Err(miette::miette!(help = format!("leave {options} out"), "{options} says nothing of {file}: {why}"))
    }

    fn seen(&self) -> miette::Result<Seen> {
        if !is_from_cad(&self.file) {
            self.refuse(
                &[&OF_FILE[..], &OF_DRAWING, &OF_SOLID].concat(),
                "a part file says it itself, in its table `outline`",
            )?;
            let file = read_beside(&self.file, PartFile::parse_beside)?;
            let doubts = file.doubts();
            let PartFile { part, drawn, errors, .. } = file;
            if drawn.as_ref().is_none_or(|drawn| drawn.solid.is_none()) {
                self.refuse(&DENSITY, "the part is no solid")?;
            }
            return Ok(Seen { part, drawn, outline_sigma: errors.outline_sigma, doubts });
        }
        let cannot = || format!("cannot use {}", self.file.display());
        match self.file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("stl")) {
            true => self.refuse(&OF_DRAWING, "a solid has no layers")?,
            false => self.refuse(&[&OF_SOLID[..], &DENSITY].concat(), "a drawing is no solid (.stl)")?,
        }
        let bytes = drawing_bytes(&self.file).into_diagnostic().wrap_err_with(cannot)?;
        recording::attach(DRAWING, &self.file, &bytes);
        let height = match (self.height_mm, self.shadow) {
            (Some(mm), _) => Some(Height::Slice(mm * 1e-3)),
            (None, true) => Some(Height::Shadow),
            (None, false) => None,
        };
        let of_file = Request::of(&self.file.to_string_lossy());
        let request = Request {
            unit: self.unit,
            curve_error: self.curve_error_mm.map_or(of_file.curve_error, |mm| mm * 1e-3),
            layer: self.layer.clone(),
            fills_holes: self.fill_holes,
            height,
            up: self.up.unwrap_or_default(),
            ..of_file
        };
        let drawn = draw(&bytes, &request).map_err(crate::advice::report).wrap_err_with(cannot)?;
        let unit = self.unit.unwrap_or(Unit::Millimetre);
        let part = DescribedPart::of_drawn(&drawn, unit).map_err(crate::advice::report).wrap_err_with(cannot)?;
        let outline_sigma = drawn.error;
        let doubts = part.doubts();
        Ok(Seen { part, doubts, drawn: Some(FromDrawing { error: drawn.error, solid: drawn.solid }), outline_sigma })
    }

    /// kg, of a solid whose density was told.
    fn mass(&self, seen: &Seen) -> Option<f64> {
        let solid = seen.drawn.as_ref()?.solid.as_ref()?;
        Some(self.density_g_cm3? * 1e3 * solid.volume)
    }

    fn tell(&self, seen: &Seen, found: &Found) {
        let (low, high) = bounding_box(&found.outline);
        let size = (high - low) * 1e3;
        let mm = |point: Point2<f64>| format!("({:.3}, {:.3}) mm", point.x * 1e3, point.y * 1e3);
        say!("{}", self.file.display());
        say!("size            {:.3} × {:.3} mm", size.x, size.y);
        say!("area            {:.4} cm²", found.area * 1e4);
        say!("perimeter       {:.3} mm", found.perimeter * 1e3);
        if let Some(polygon) = &found.polygon {
            say!("centroid        {}", mm(polygon.centroid()));
        }
        let share = found.area / found.hull_area;
        let convexity = match found.is_notched() {
            false => "convex".to_owned(),
            true => format!(
                "notched: its hull has {:.4} cm², of which it fills {:.1} %",
                found.hull_area * 1e4,
                100.0 * share
            ),
        };
        say!("hull            {}; {convexity}", counted(found.hull.len(), "corner"));
        if let Some(drawn) = &seen.drawn {
            say!("curves          as chords, at most {:.4} mm off", drawn.error * 1e3);
        }
        if seen.outline_sigma > 0.0 {
            say!("outline_sigma   {:.4} mm", seen.outline_sigma * 1e3);
        }
        let body = seen.part.body();
        say!("centre of mass  {}", mm(body.centre_of_mass()));
        say!("gyration        {:.3} mm radius", body.inertia_per_mass().sqrt() * 1e3);
        if let Some(solid) = seen.drawn.as_ref().and_then(|drawn| drawn.solid.as_ref()) {
            say!(
                "solid           {:.4} cm³, {:.3} mm high, centre of mass {:.3} mm above the table",
                solid.volume * 1e6,
                solid.height * 1e3,
                solid.centre_height * 1e3
            );
        }
        if let Some(mass) = self.mass(seen) {
            say!("mass            {mass:.5} kg, inertia {:.4e} kg·m²", mass * body.inertia_per_mass());
        }
        self.tell_feet(seen);
        self.tell_likenesses(found);
        tell_pushes(found);
        tell_vertices(&found.outline);
    }

    fn tell_feet(&self, seen: &Seen) {
        match feet(seen) {
            None => say!("stands on       all of its base"),
            Some(feet) => {
                say!("stands on       {}", counted(feet.len(), "foot").replace("foots", "feet"));
                for (at, share) in feet {
                    say!(
                        "                ({:.3}, {:.3}) mm with {:.1} % of the weight",
                        at.x * 1e3,
                        at.y * 1e3,
                        100.0 * share
                    );
                }
            }
        }
    }

    fn tell_likenesses(&self, found: &Found) {
        for (likenesses, how) in [(&found.turned, "turned"), (&found.flipped, "turned over, then")] {
            match likenesses {
                Likenesses::AnyTurn => say_folded(&format!(
                    "{how} by any angle: less than {:.2} mm apart; no touch tells the angle",
                    LIKE_TIMES * self.alike_mm
                )),
                Likenesses::Turns(turns) => {
                    for turn in turns.iter().take(LIKE_MAX) {
                        say_folded(&format!(
                            "{how} by {:.2}°: outlines {:.3} mm apart at most; {}",
                            turn_deg(turn.pose.theta),
                            turn.apart * 1e3,
                            self.verdict(turn)
                        ));
                    }
                    if turns.len() > LIKE_MAX {
                        say!("{how}: … {} in all", counted(turns.len(), "turn"));
                    }
                }
            }
        }
        if [&found.turned, &found.flipped].into_iter().all(|likenesses| *likenesses == Likenesses::Turns(Vec::new())) {
            say!("alike           no turn, on either face, is within {:.2} mm of it", LIKE_TIMES * self.alike_mm);
        }
    }

    fn verdict(&self, turn: &Likeness) -> String {
        if turn.apart * 1e3 <= self.alike_mm {
            format!("touches within {} mm confuse them", self.alike_mm)
        } else {
            "touches tell them apart, but must be good".to_owned()
        }
    }

    fn json(&self, seen: &Seen, found: &Found) -> Value {
        let body = seen.part.body();
        let place = |point: &Point2<f64>| [point.x, point.y];
        let turns = |likenesses: &Likenesses| match likenesses {
            Likenesses::AnyTurn => json!("any"),
            Likenesses::Turns(turns) => turns
                .iter()
                .map(|turn| {
                    let pose = [turn.pose.x, turn.pose.y, turn.pose.theta];
                    json!({"pose": pose, "apart": turn.apart, "confused": turn.apart * 1e3 <= self.alike_mm})
                })
                .collect(),
        };
        let solid = seen.drawn.as_ref().and_then(|drawn| drawn.solid.as_ref());
        json!({
            "vertices": found.outline.iter().map(place).collect::<Vec<_>>(),
            "area": found.area,
            "perimeter": found.perimeter,
            "centroid": found.polygon.as_ref().map(|polygon| place(&polygon.centroid())),
            "hull": found.hull.iter().map(place).collect::<Vec<_>>(),
            "hull_area": found.hull_area,
            "convex": !found.is_notched(),
            "outline_sigma": seen.outline_sigma,
            "centre_of_mass": place(&body.centre_of_mass()),
            "radius_of_gyration": body.inertia_per_mass().sqrt(),
            "volume": solid.map(|solid| solid.volume),
            "height": solid.map(|solid| solid.height),
            "mass": self.mass(seen),
            "inertia": self.mass(seen).map(|mass| mass * body.inertia_per_mass()),
            "feet": feet(seen).map(|feet| feet.iter().map(|(at, share)| [at.x, at.y, *share]).collect::<Vec<_>>()),
            "push_symmetry": found.order,
            "sides_pushed_alike": found.alike_sides,
            "turned": turns(&found.turned),
            "turned_over": turns(&found.flipped),
        })
    }

    fn figure(&self, seen: &Seen, found: &Found) -> crate::pictures::plot::Figure {
        let title = self.file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let feet: Vec<_> = feet(seen).unwrap_or_default().into_iter().map(|(at, _)| at).collect();
        let like = match &found.turned {
            Likenesses::Turns(turns) => turns.first(),
            Likenesses::AnyTurn => None,
        };
        let like = like.map(|turn| {
            let turned: Vec<_> = found.outline.iter().map(|point| turn.pose.isometry() * point).collect();
            (turned, format!("turned by {:.1}°, {:.2} mm apart", turn_deg(turn.pose.theta), turn.apart * 1e3))
        });
        let subtitles = [format!(
            "{}, {:.2} cm²",
            counted(found.outline.len(), "vertex").replace("vertexs", "vertices"),
            found.area * 1e4
        )];
        PartPicture {
            outline: &found.outline,
            hull: &found.hull,
            is_notched: found.is_notched(),
            centre_of_mass: seen.part.centre_of_mass(),
            feet: &feet,
            like: like.as_ref().map(|(turned, name)| (&turned[..], &name[..])),
            title: &title,
            subtitles: &subtitles,
        }
        .figure()
    }
}

/// A hull that has more than this share of the area beside the part has a notch; less is rounding.
const NOTCH: f64 = 1e-9;

impl Found {
    fn of(seen: &Seen, within: f64) -> Self {
        let outline = seen.part.outline();
        let polygon = SimplePolygon::new(outline.clone()).ok();
        let hull: Vec<_> = convex_hull(&outline).into_iter().map(|index| outline[index]).collect();
        let area = |points: &[Point2<f64>]| palpate::geometry::mesh::signed_area(points);
        let next = outline.iter().cycle().skip(1);
        let none = || Likenesses::Turns(Vec::new());
        let like = |mirrored| polygon.as_ref().map_or_else(none, |polygon| likenesses(polygon, mirrored, within));
        let part: Option<&Part> = match &seen.part {
            DescribedPart::Polygon(part) => Some(part),
            DescribedPart::Ellipse { .. } => None,
        };
        Self {
            area: area(&outline),
            hull_area: area(&hull),
            perimeter: outline.iter().zip(next).map(|(a, b)| (b - a).norm()).sum(),
            turned: like(false),
            flipped: like(true),
            order: part.map_or(2, symmetry::order),
            alike_sides: part.map(symmetry::alike_sides).unwrap_or_default(),
            outline,
            polygon,
            hull,
        }
    }

    fn is_notched(&self) -> bool {
        self.hull_area - self.area > NOTCH * self.hull_area
    }
}

/// What it stands on, part frame, m, with the share of the weight.
fn feet(seen: &Seen) -> Option<Vec<(Point2<f64>, f64)>> {
    seen.part.body().feet().map(Iterator::collect)
}

/// The room of a line's name.
const LABEL: &str = "                ";

fn say_folded(sentence: &str) {
    say!("{}", folded(sentence));
}

fn tell_pushes(found: &Found) {
    if found.order > 1 {
        say!("pushes          {} turns that no push tells apart", found.order);
    }
    match found.alike_sides.len() {
        0 => say!("pushes          begin differently at every side"),
        count => {
            let shown: Vec<_> = found.alike_sides.iter().take(LIKE_MAX).map(|[a, b]| format!("{a} and {b}")).collect();
            let more = if count > LIKE_MAX { format!(", … {count} in all") } else { String::new() };
            let text =
                folded_to(&format!("begin alike at the sides {}{more}", shown.join(", ")), COLUMNS - LABEL.len());
            say!("pushes          {}", text.replace('\n', &format!("\n{LABEL}")));
        }
    }
}

fn tell_vertices(outline: &[Point2<f64>]) {
    say!("vertices        {}, in mm", outline.len());
    for (number, vertex) in outline.iter().enumerate().take(LISTED_MAX) {
        say!("{number:>6} {:>12.4} {:>12.4}", vertex.x * 1e3, vertex.y * 1e3);
    }
    if outline.len() > LISTED_MAX {
        say!("     … --json lists all");
    }
}
