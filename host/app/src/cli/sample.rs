//! `palpate sample`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic as _, WrapErr as _, miette};
use nalgebra::Point2;
use palpate::geometry::SimplePolygon;
use palpate::point_sampling::{
    Choice, Circle, Effort, Objective, Plan, Question, Request, Scene, Search, SetSystem, fewest, questions,
};
use palpate_files::sampling_plan::{PlanFile, in_words};
use palpate_files::scene::SceneFile;
use palpate_files::solve::kinds::point_sampling::PointSampling;

use super::device::DeviceArguments;
use super::plot::PlotArguments;
use super::read::{read_beside, read_text};
use super::sample_live::{LiveDecoding, decode, decoded_as_json, picture_of};
use super::{counted, not_negative, positive};
use crate::pictures::point_sampling::{Answered, SamplingPicture, answered};

/// Longest time to search, s.
const TIME_LIMIT_MAX_S: f64 = 1e6;

const LONG_HELP: &str = "\
A scene is TOML, or a problem `point_sampling` of `palpate solve` in a file that ends in .json:
  unit = \"mm\"                        # m, cm, mm or in
  curve_error = 0.01                 # how far a chord may be from its arc
                                     # (optional)
  [[shape]]
  name = \"bracket\"
  vertices = [[0, 0], [90, 0, 0.4], [90, 40], [30, 60]]
                                     # counter-clockwise; a third number bulges
                                     # the next edge, 1 to a half circle
  poses = [[0, 0, 0], [20, 5, 90]]   # x, y, degrees (optional)

A file of sets, for --sets, has one set a line: `name: element element …`; the elements are any words.

To plan points and keep the plan, and then to ask which shape covers the second point, but not the first and last:
  palpate sample scene.toml --json > plan.json
  palpate sample --decode plan.json 01?0

Without readings they are taken as they come, and each part is named once nothing has changed for a while: lines
`T ID 0|1` on standard input, a time in seconds, the point's number and its reading; or, with -d, the digital inputs
of a board, input 0 being point 1. `#` begins a comment. With --correct 1 a point may be stuck, and is named.
  controller | palpate sample --decode plan.json
  palpate sample --decode plan.json 0110 --outlines scene.toml --plot read.svg
  palpate sample --decode plan.json -d /dev/ttyACM0 --json

Exit status: 0, 1 if a file or a line cannot be used or shapes cannot be told apart, 64 wrong command line.";

/// Plans the fewest points that tell shapes or poses apart by which of them are covered, and decodes what they read.
///
/// The number of points is proven to be the least, or printed with the bound that is; among plans of so many points the
/// one with the largest distance from all edges is taken.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// The scene: shapes and poses
    #[arg(value_name = "SCENE", required_unless_present_any = ["decode", "sets"])]
    scene: Option<PathBuf>,
    /// Tell which shape or pose it is from a plan and what its points read: 1 covered, 0 free, ? unreadable; without
    /// readings as they come
    #[arg(long, value_names = ["PLAN.json", "READINGS"], num_args = 1..=2, conflicts_with_all = ["scene", "sets", "tree", "trade_off", "min_clearance_mm", "min_area_mm2", "notice", "greedy", "time_limit_s"])]
    decode: Vec<String>,
    /// Readings count once none has changed for so long: contacts bounce
    #[arg(long, value_name = "MS", requires = "decode", value_parser = not_negative, allow_negative_numbers = true, default_value_t = 20.0)]
    debounce_ms: f64,
    /// With --decode and --plot: the scene that the plan is of, whose outlines are drawn
    #[arg(long, value_name = "SCENE", requires = "decode", requires = "plot")]
    outlines: Option<PathBuf>,
    /// Find the fewest elements that tell the sets in a file apart
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scene", "plot", "trade_off", "min_clearance_mm", "min_area_mm2"])]
    sets: Option<PathBuf>,
    #[command(flatten)]
    plan: PlanArguments,
    /// Print what more points bring: the largest smallest distance from edges for every number of points
    #[arg(long, conflicts_with_all = ["json", "tree", "plot", "greedy"])]
    trade_off: bool,
    /// Print in which order to probe the points one after the other, the next depending on what was found
    #[arg(long, conflicts_with = "json")]
    tree: bool,
    /// Print one JSON object: the plan, for --decode, in m; with --sets the elements chosen; with --decode one for each
    /// answer
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    plot: PlotArguments,
    #[command(flatten)]
    device: DeviceArguments,
}

/// How to plan.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct PlanArguments {
    /// Keep points at least so far from every edge
    #[arg(long, value_name = "MM", value_parser = not_negative, allow_negative_numbers = true, default_value_t = 0.0)]
    min_clearance_mm: f64,
    /// Leave out regions of this area or less
    #[arg(long, value_name = "MM²", value_parser = not_negative, allow_negative_numbers = true, default_value_t = 0.0)]
    min_area_mm2: f64,
    /// Notice up to so many misread points, or do without as many unreadable ones
    #[arg(long, value_name = "T", default_value_t = 0, allow_negative_numbers = true, value_parser = clap::value_parser!(u8).range(..=31), conflicts_with = "correct")]
    notice: u8,
    /// Correct up to so many misread points
    #[arg(long, value_name = "T", default_value_t = 0, allow_negative_numbers = true, value_parser = clap::value_parser!(u8).range(..=31))]
    correct: u8,
    /// Take the greedy choice at once: at most 2 ln n times as many points as needed
    #[arg(long)]
    greedy: bool,
    /// How long to look for fewer points or a proof
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 60.0)]
    time_limit_s: f64,
}

impl PlanArguments {
    fn request(&self, curve_error: f64) -> Request {
        Request {
            min_area: self.min_area_mm2 * 1e-6,
            // The true outline is nearer than its chords by the error at most.
            min_clearance: self.min_clearance_mm * 1e-3 + curve_error,
            separation: self.separation(),
            objective: if self.greedy { Objective::Greedy } else { Objective::Fewest },
        }
    }

    fn separation(&self) -> usize {
        1 + usize::from(self.notice) + 2 * usize::from(self.correct)
    }

    /// True once the time is up, from now on.
    fn stop(&self) -> impl Fn() -> bool + use<> {
        let (begun, limit) = (Instant::now(), Duration::from_secs_f64(self.time_limit_s.min(TIME_LIMIT_MAX_S)));
        move || begun.elapsed() >= limit
    }

    /// Points for these outlines, which are within an error of what they stand for, m.
    pub(crate) fn plan(&self, outlines: &[SimplePolygon], curve_error: f64) -> Planned {
        let scene = Scene::new(outlines);
        let plan = scene.plan(&self.request(curve_error), &self.stop());
        if plan.indistinguishable.is_empty() || self.limits().is_empty() {
            return Planned { plan, kept_out: None };
        }
        let anywhere = Request { objective: Objective::Greedy, ..Request::default() };
        let alike = scene.plan(&anywhere, &|| false).indistinguishable;
        let differ = plan.indistinguishable.iter().filter(|pair| !alike.contains(pair)).count();
        Planned { plan, kept_out: self.kept_out(differ) }
    }

    /// A sentence about so many pairs that differ, but not within the limits asked for; none about none.
    fn kept_out(&self, differ: usize) -> Option<String> {
        (differ > 0).then(|| {
            let pairs = counted(differ, "pair");
            format!("{pairs} of these would be told apart without {}: ask for less", self.limits().join(" and "))
        })
    }

    /// The options given that leave points out or ask for more of them.
    fn limits(&self) -> Vec<String> {
        let given = [
            ("--min-clearance-mm", self.min_clearance_mm),
            ("--min-area-mm2", self.min_area_mm2),
            ("--notice", f64::from(self.notice)),
            ("--correct", f64::from(self.correct)),
        ];
        given.iter().filter(|(_, value)| *value > 0.0).map(|(name, value)| format!("{name} {value}")).collect()
    }
}

/// A plan, and whose fault it is where it tells not all apart.
pub(crate) struct Planned {
    pub(crate) plan: Plan,
    /// A sentence about pairs that differ, but not within the limits asked for.
    kept_out: Option<String>,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    if let [plan, readings @ ..] = arguments.decode.as_slice() {
        return arguments.decode(Path::new(plan), readings.first().map(String::as_str));
    }
    if let Some(sets) = &arguments.sets {
        return discriminate(arguments, sets);
    }
    let Some(path) = &arguments.scene else { return Err(miette!("there is no scene to plan for")) };
    let file = read_scene(path)?;
    if arguments.trade_off {
        return Ok(trade_off(arguments, &file));
    }
    let planned = arguments.plan.plan(&file.polygons, file.curve_error);
    let plan = &planned.plan;
    if arguments.json {
        print_json(&file.names, plan)?;
    } else {
        print_plan(&file.names, &planned);
        if file.curve_error > 0.0 {
            say!("curves are within {:.4} mm of their chords; clearances are from the chords", file.curve_error * 1e3);
        }
        if arguments.tree {
            print_tree(&file.names, plan, &arguments.plan.stop());
        }
    }
    arguments.plot.draw(|| {
        let title = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let subtitles = [plan_in_words(plan)];
        let picture = SamplingPicture {
            polygons: &file.polygons,
            points: &plan.points,
            fences: &[],
            title: &title,
            subtitles: &subtitles,
        };
        Ok(picture.figure())
    })?;
    Ok(status(plan))
}

/// 0 where all outlines are told apart, otherwise 1.
pub(crate) fn status(plan: &Plan) -> ExitCode {
    if plan.indistinguishable.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn read_scene(path: &Path) -> miette::Result<SceneFile> {
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json")) {
        let cannot = || format!("cannot use the scene {}", path.display());
        return from_problem(&read_text(path).wrap_err_with(cannot)?).wrap_err_with(cannot);
    }
    read_beside(path, SceneFile::parse_beside)
}

/// A problem of `palpate solve`: only its polygons count here.
fn from_problem(text: &str) -> miette::Result<SceneFile> {
    let mut fields: serde_json::Map<String, serde_json::Value> = serde_json::from_str(text).into_diagnostic()?;
    fields.retain(|key, _| key == "polygons");
    let problem: PointSampling = serde_json::from_value(fields.into()).into_diagnostic()?;
    let polygons: Vec<SimplePolygon> = problem.polygons.iter().map(|polygon| (**polygon).clone()).collect();
    let names = (0..polygons.len()).map(|number| format!("polygon {number}")).collect();
    Ok(SceneFile { names, polygons, curve_error: 0.0, unit: palpate_files::part::Unit::Metre })
}

/// How many points, and how good that is.
pub(crate) fn plan_in_words(plan: &Plan) -> String {
    let count = plan.points.len();
    if plan.points.is_empty() && !plan.indistinguishable.is_empty() {
        return format!("{}; no points tell the outlines apart", counted(plan.regions, "region"));
    }
    let proven = match plan.is_fewest() {
        true => "proven fewest".to_owned(),
        false => format!("no fewer than {} can do", plan.lower_bound),
    };
    let clearance = match plan.points.is_empty() {
        true => String::new(),
        false => format!("; smallest clearance {:.4} mm", plan.clearance() * 1e3),
    };
    format!("{}; {} ({proven}){clearance}", counted(plan.regions, "region"), counted(count, "point"))
}

pub(crate) fn print_plan(names: &[String], Planned { plan, kept_out }: &Planned) {
    say!("{}, {}", counted(names.len(), "outline"), plan_in_words(plan));
    for &[a, b] in &plan.indistinguishable {
        say!("cannot be told apart: {} and {}", names[a], names[b]);
    }
    if let Some(kept_out) = kept_out {
        say!("{kept_out}");
    }
    if plan.points.is_empty() {
        return;
    }
    if let Some(bound) = plan.clearance_bound {
        say!("no plan of as many points keeps more than {:.4} mm from all edges", bound * 1e3);
    }
    say!("{:>5} {:>11} {:>11} {:>15}", "point", "x [mm]", "y [mm]", "clearance [mm]");
    for (number, point) in plan.points.iter().enumerate() {
        let [x, y, room] = [point.centre.x, point.centre.y, point.radius].map(|length| length * 1e3);
        say!("{:>5} {x:>11.4} {y:>11.4} {room:>15.4}", number + 1);
    }
    for (name, signature) in names.iter().zip(&plan.signatures) {
        let bits: String = signature.iter().map(|&covered| if covered { '1' } else { '0' }).collect();
        say!("{bits}  {name}");
    }
}

pub(crate) fn print_json(names: &[String], plan: &Plan) -> miette::Result<()> {
    say!("{}", serde_json::to_string(&PlanFile::new(names.to_vec(), plan)).into_diagnostic()?);
    Ok(())
}

fn trade_off(arguments: &Arguments, file: &SceneFile) -> ExitCode {
    let request = arguments.plan.request(file.curve_error);
    let plans = Scene::new(&file.polygons).trade_off(&request, &arguments.plan.stop());
    say!("{:>6} {:>24} {:>22}", "points", "smallest clearance [mm]", "cannot be above [mm]");
    for plan in &plans {
        let bound = plan.clearance_bound.map_or(String::new(), |bound| format!("{:.4}", bound * 1e3));
        say!("{:>6} {:>24.4} {:>22}", plan.points.len(), plan.clearance() * 1e3, bound);
    }
    if let Some(plan) = plans.first().filter(|plan| !plan.is_fewest()) {
        say!(
            "fewer than {} were not excluded: no fewer than {} can do",
            counted(plan.points.len(), "point"),
            plan.lower_bound
        );
    }
    ExitCode::SUCCESS
}

/// Probing the plan's points one after the other.
fn print_tree(names: &[String], plan: &Plan, stop: palpate::Stop<'_>) {
    let sets: Vec<Vec<usize>> = plan
        .signatures
        .iter()
        .map(|signature| {
            signature.iter().enumerate().filter(|(_, covered)| **covered).map(|(point, _)| point).collect()
        })
        .collect();
    let order: Vec<usize> = (0..plan.points.len()).collect();
    let search = Search { separation: 1, target: 0, effort: Effort::Full, stop };
    let (tree, bound) = questions(&SetSystem::from_sets(order.len(), &sets), &order, &search);
    let proven =
        if tree.depth() == bound { "the least with these points".to_owned() } else { format!("no less than {bound}") };
    say!("one after the other: at most {} of {} ({proven})", tree.depth(), counted(order.len(), "point"));
    print_question(&tree, "", &|element| format!("point {}", element + 1), names);
}

fn print_question(question: &Question, indent: &str, ask: &dyn Fn(usize) -> String, names: &[String]) {
    match question {
        Question::Answer(sets) => {
            let names: Vec<_> = sets.iter().map(|&set| names[set].as_str()).collect();
            say!("{indent}{}", names.join(" or "));
        }
        Question::Ask { element, yes, no } => {
            let deeper = format!("{indent}  ");
            say!("{indent}{} covered?", ask(*element));
            say!("{indent}yes:");
            print_question(yes, &deeper, ask, names);
            say!("{indent}no:");
            print_question(no, &deeper, ask, names);
        }
    }
}

fn read_plan(path: &Path) -> miette::Result<PlanFile> {
    let cannot = || format!("cannot use the plan {}", path.display());
    let text = read_text(path).wrap_err_with(cannot)?;
    let mut value: serde_json::Value = serde_json::from_str(&text).map_err(no_plan).wrap_err_with(cannot)?;
    // What `palpate inscribe --resolve` prints has its plan inside.
    let value = value.get_mut("resolve").map(serde_json::Value::take).unwrap_or(value);
    serde_json::from_value(value).map_err(no_plan).wrap_err_with(cannot)
}

/// A file of another kind.
fn no_plan(error: serde_json::Error) -> miette::Report {
    miette!(help = "a plan is what `palpate sample SCENE --json` prints", "it is no plan of points: {error}")
}

impl Arguments {
    /// The outlines behind what is read, where a picture is asked for.
    fn outlines(&self, plan: &PlanFile) -> miette::Result<Vec<SimplePolygon>> {
        let path = match &self.outlines {
            Some(path) => path,
            None if self.plot.is_asked() => {
                let help = "tell --outlines SCENE, the scene that the plan is of";
                return Err(miette!(help = help, "a plan has no outlines to draw"));
            }
            None => return Ok(Vec::new()),
        };
        let file = read_scene(path)?;
        let signatures = &plan.answer.signatures;
        if file.polygons.len() != signatures.len() {
            return Err(miette!(
                help = "name the scene that the plan is of, as it was then",
                "{} has {}, and the plan tells {} apart",
                path.display(),
                counted(file.polygons.len(), "outline"),
                signatures.len()
            ));
        }
        Ok(file.polygons)
    }

    /// Draws what points read.
    fn draw_answers(&self, plan: &PlanFile, polygons: &[SimplePolygon], answers: &[Answered]) -> miette::Result<()> {
        self.plot.draw(|| {
            let places = plan.answer.points.iter().zip(&plan.answer.clearances);
            let points: Vec<_> =
                places.map(|(place, radius)| Circle { centre: Point2::from(*place), radius: *radius }).collect();
            let title = format!("What {} read", counted(points.len(), "point"));
            Ok(answered(&title, &[], polygons, &points, answers))
        })
    }

    /// Decodes readings, or what comes.
    fn decode(&self, path: &Path, readings: Option<&str>) -> miette::Result<ExitCode> {
        self.device.begin_recording()?;
        let plan = read_plan(path)?;
        let polygons = self.outlines(&plan)?;
        let correct = usize::from(self.plan.correct);
        let Some(readings) = readings else {
            let live = LiveDecoding { debounce: self.debounce_ms * 1e-3, correct, json: self.json };
            let mut answers = self.plot.is_asked().then(Vec::new);
            let status = decode(&plan, &self.device, live, answers.as_mut())?;
            self.draw_answers(&plan, &polygons, &answers.unwrap_or_default())?;
            return Ok(status);
        };
        let decoded = plan.decode(readings).into_diagnostic()?;
        if self.json {
            say!("{}", decoded_as_json(&plan, readings, &decoded, correct));
        } else {
            say!("{}", in_words(&plan, &decoded));
        }
        self.draw_answers(&plan, &polygons, &[picture_of(&plan, readings, &decoded, None)])?;
        Ok(ExitCode::SUCCESS)
    }
}

/// The fewest elements that tell the sets of a file apart.
fn discriminate(arguments: &Arguments, path: &Path) -> miette::Result<ExitCode> {
    let cannot = || format!("cannot use the sets in {}", path.display());
    let text = read_text(path).wrap_err_with(cannot)?;
    let (names, words, sets) = parse_sets(&text).wrap_err_with(cannot)?;
    let system = SetSystem::from_sets(words.len(), &sets);
    let order: Vec<usize> = (0..words.len()).collect();
    let stop = arguments.plan.stop();
    let effort = if arguments.plan.greedy { Effort::Greedy } else { Effort::Full };
    let separation = arguments.plan.separation();
    let close = system.closer_than(separation);
    let choice = if close.is_empty() {
        fewest(&system, &order, &Search { separation, target: 0, effort, stop: &stop })
    } else {
        Choice::default()
    };
    let status = if close.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    if arguments.json {
        let chosen: Vec<&str> = choice.elements.iter().map(|&element| words[element].as_str()).collect();
        let pairs: Vec<[&str; 2]> = close.iter().map(|pair| pair.map(|set| names[set].as_str())).collect();
        let codes: Vec<Vec<u8>> = if close.is_empty() {
            (0..names.len()).map(|set| code(&system, set, &choice).map(u8::from).collect()).collect()
        } else {
            Vec::new()
        };
        let status_name = if close.is_empty() { "ok" } else { "indistinguishable" };
        say!(
            "{}",
            serde_json::json!({"status": status_name, "pairs": pairs, "elements": chosen, "names": names, "signatures": codes,
                               "lower_bound": choice.lower_bound, "optimal": close.is_empty() && choice.is_fewest()})
        );
        return Ok(status);
    }
    for &[a, b] in &close {
        say!("cannot be told apart: {} and {}", names[a], names[b]);
    }
    if !close.is_empty() {
        let differ = close.len() - system.closer_than(1).len();
        if let Some(kept_out) = arguments.plan.kept_out(differ) {
            say!("{kept_out}");
        }
        return Ok(status);
    }
    print_choice(&names, &words, &system, &choice);
    if arguments.tree {
        let search = Search { separation: 1, target: 0, effort: Effort::Full, stop: &stop };
        let (tree, bound) = questions(&system, &order, &search);
        say!("one after the other: at most {}, no less than {bound}", counted(tree.depth(), "question"));
        print_question(&tree, "", &|element| words[element].clone(), &names);
    }
    Ok(ExitCode::SUCCESS)
}

/// Whether a set has each element chosen.
fn code(system: &SetSystem, set: usize, choice: &Choice) -> impl Iterator<Item = bool> {
    let code = system.code(set, &choice.elements);
    (0..choice.elements.len()).map(move |place| code.row().has(place))
}

fn print_choice(names: &[String], words: &[String], system: &SetSystem, choice: &Choice) {
    let proven = if choice.is_fewest() {
        "proven fewest".to_owned()
    } else {
        format!("no fewer than {} can do", choice.lower_bound)
    };
    let chosen: Vec<&str> = choice.elements.iter().map(|&element| words[element].as_str()).collect();
    say!(
        "{}, {}; {} of them tell the sets apart ({proven}): {}",
        counted(names.len(), "set"),
        counted(words.len(), "element"),
        chosen.len(),
        chosen.join(" ")
    );
    for (set, name) in names.iter().enumerate() {
        let bits: String = code(system, set, choice).map(|has| if has { '1' } else { '0' }).collect();
        say!("{bits}  {name}");
    }
}

/// Names of sets, elements, and the elements of each set.
type Sets = (Vec<String>, Vec<String>, Vec<Vec<usize>>);

fn parse_sets(text: &str) -> miette::Result<Sets> {
    let (mut names, mut words, mut sets) = (Vec::new(), Vec::new(), Vec::new());
    let mut numbers: BTreeMap<String, usize> = BTreeMap::new();
    let lines =
        text.lines().enumerate().map(|(number, line)| (number + 1, line.split('#').next().unwrap_or("").trim()));
    for (number, line) in lines.filter(|(_, line)| !line.is_empty()) {
        let (name, elements) = line
            .split_once(':')
            .ok_or_else(|| miette!(help = "write `name: element element …`", "line {number} has no colon"))?;
        let mut number_of = |word: &str| {
            *numbers.entry(word.to_owned()).or_insert_with(|| {
                words.push(word.to_owned());
                words.len() - 1
            })
        };
        sets.push(elements.split_whitespace().map(&mut number_of).collect());
        names.push(name.trim().to_owned());
    }
    if names.is_empty() {
        Err(miette!(help = "write one set a line", "there is no set"))
    } else {
        Ok((names, words, sets))
    }
}
