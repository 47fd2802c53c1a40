//! An outline is what it encloses, not how it was typed: vertices put along its edges change no answer.
//!
//! Each documented problem, and each reference case that lies beside the project, is solved as it is and with its
//! edges split: anywhere, and within rounding of a corner. Edges of the second answer are counted as in the first.

use palpate::math::random::Draw;
use palpate_files::solve::KINDS;
use palpate_tests::project::{folder, reference_cases};
use serde_json::{Map, Value};

/// Files of reference cases with an outline in each problem.
const FILES: [&str; 9] =
    ["push", "friction", "initial_pose", "pose", "force", "corner", "inscription", "observability", "sampling"];

/// Of each file, evenly.
const CASES: usize = 10;

/// What answers that are computed, not sought, may differ by: relative to 1 or to themselves.
const COMPUTED: Closeness = Closeness { relative: 1e-6, absolute: 1e-9 };

/// Observers stop a thousandth of a unit of cost above a minimum, so some hundredths of a standard deviation beside it.
const SOUGHT: Closeness = Closeness { relative: 2e-2, absolute: 1e-6 };

/// How far from a corner a vertex within rounding of it is, in sizes of the part: nearer, it is the corner typed twice.
const NEAR_CORNER: f64 = 1e-10;

#[derive(Clone, Copy)]
struct Closeness {
    relative: f64,
    absolute: f64,
}

impl Closeness {
    /// Where two answers differ; none if they do not.
    fn difference(self, a: &Value, b: &Value, place: &str) -> Option<String> {
        match (a, b) {
            (Value::Number(x), Value::Number(y)) => {
                let (x, y) = (x.as_f64()?, y.as_f64()?);
                let near = (x - y).abs() <= self.absolute + self.relative * x.abs().max(y.abs());
                (!near).then(|| format!("{place}: {x} and {y}"))
            }
            (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
                let pairs = a.iter().zip(b).enumerate();
                pairs.into_iter().find_map(|(i, (a, b))| self.difference(a, b, &format!("{place}/{i}")))
            }
            (Value::Object(a), Value::Object(b)) if a.len() == b.len() => {
                a.iter().find_map(|(key, a)| self.difference(a, b.get(key)?, &format!("{place}/{key}")))
            }
            _ if a == b => None,
            _ => Some(format!("{place}: {a} and {b}")),
        }
    }
}

/// An outline with vertices along its edges.
struct Split {
    vertices: Vec<[f64; 2]>,
    /// Of each edge, the edge that it is a piece of.
    edge_of: Vec<u64>,
}

impl Split {
    fn new(outline: &[[f64; 2]], draw: &mut Draw) -> Self {
        let (mut vertices, mut edge_of) = (Vec::new(), Vec::new());
        let size = outline.iter().flatten().fold(0.0_f64, |size, coordinate| size.max(coordinate.abs()));
        for (i, from) in outline.iter().enumerate() {
            let to = outline[(i + 1) % outline.len()];
            let length = (to[0] - from[0]).hypot(to[1] - from[1]);
            let near = NEAR_CORNER * size / length;
            let mut shares = vec![0.0];
            shares.extend((0..draw.index(3)).map(|_| if draw.chance(0.2) { near } else { draw.uniform(0.01, 0.99) }));
            shares.sort_by(f64::total_cmp);
            shares.dedup();
            for share in shares {
                vertices.push([0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis])));
                edge_of.push(i as u64);
            }
        }
        Self { vertices, edge_of }
    }

    /// The number of an edge's first piece.
    fn first_piece(&self, edge: u64) -> usize {
        self.edge_of.iter().position(|of| *of == edge).unwrap()
    }
}

fn outline(value: &Value) -> Vec<[f64; 2]> {
    serde_json::from_value(value.clone()).unwrap()
}

/// Every outline of a problem.
fn outlines(problem: &Value) -> Vec<Vec<[f64; 2]>> {
    let one = ["/polygon", "/object/vertices"].into_iter().filter_map(|place| problem.pointer(place));
    let many = problem.get("polygons").and_then(Value::as_array).into_iter().flatten();
    one.chain(many).map(outline).collect()
}

/// A problem with its outlines split, and the split of its one outline.
fn split_problem(problem: &Map<String, Value>, draw: &mut Draw) -> (Map<String, Value>, Option<Split>) {
    let mut split = problem.clone();
    if let Some(Value::Array(polygons)) = split.get_mut("polygons") {
        let whole = |polygon: &Value| {
            Value::from(
                Split::new(&outline(polygon), draw)
                    .vertices
                    .iter()
                    .map(|p| Value::from(p.to_vec()))
                    .collect::<Vec<_>>(),
            )
        };
        *polygons = polygons.iter().map(whole).collect();
    }
    let mut of_one = None;
    let places = [vec!["polygon"], vec!["object", "vertices"]];
    for place in places {
        let mut at = Some(&mut split);
        let (last, folders) = place.split_last().unwrap();
        for folder in folders {
            at = at.and_then(|at| at.get_mut(*folder)).and_then(Value::as_object_mut);
        }
        let Some(polygon) = at.and_then(|at| at.get_mut(*last)) else { continue };
        let pieces = Split::new(&outline(polygon), draw);
        *polygon = serde_json::to_value(&pieces.vertices).unwrap();
        of_one = Some(pieces);
    }
    if let (Some(edge), Some(pieces)) = (problem.get("edge").and_then(Value::as_u64), &of_one) {
        split.insert("edge".into(), pieces.first_piece(edge).into());
    }
    (split, of_one)
}

/// An answer with its edges counted as before the split.
fn counted_as_before(answer: &Value, split: &Split) -> Value {
    match answer {
        Value::Array(values) => values.iter().map(|value| counted_as_before(value, split)).collect(),
        Value::Object(fields) => {
            let counted = fields.iter().map(|(key, value)| {
                let edge = value.as_u64().filter(|_| key == "edge");
                let value = edge.map_or_else(
                    || counted_as_before(value, split),
                    |edge| split.edge_of[usize::try_from(edge).unwrap()].into(),
                );
                (key.clone(), value)
            });
            counted.collect()
        }
        other => other.clone(),
    }
}

/// What splitting a problem's edges changes; none where it changes nothing.
fn change(problem: &Value, seed: u64) -> Option<String> {
    let fields = problem.as_object().unwrap();
    if outlines(problem).iter().any(|outline| outline.len() < 3) {
        return None;
    }
    let (split, pieces) = split_problem(fields, &mut Draw::new(seed));
    // What is refused is no outline to split.
    let whole = KINDS.solve(problem.clone()).ok()?;
    let parted = match KINDS.solve(split.clone().into()) {
        Ok(parted) => parted,
        Err(failure) => return Some(format!("{failure}\n{problem}\n{}", Value::from(split))),
    };
    let parted = pieces.as_ref().map_or(parted.clone(), |pieces| counted_as_before(&parted, pieces));
    let closeness = match problem["problem"].as_str().unwrap() {
        "observe_push" | "inscription" => SOUGHT,
        _ => COMPUTED,
    };
    let difference = closeness.difference(&whole, &parted, "")?;
    Some(format!("{difference}\n{}\n{}", problem, Value::from(split)))
}

fn assert_unchanged(problems: impl Iterator<Item = Value>) {
    let changes: Vec<_> = problems.enumerate().filter_map(|(i, problem)| change(&problem, i as u64)).collect();
    assert!(changes.is_empty(), "{} change:\n{}", changes.len(), changes.join("\n\n"));
}

fn has_outline(problem: &Value) -> bool {
    !outlines(problem).is_empty()
}

#[test]
fn documented_problems_do_not_change_when_edges_are_split() {
    let page = std::fs::read_to_string(folder().join("docs/SOLVE.md")).unwrap();
    let lines = page.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    // Answers repeat the kind behind the id.
    let problems = lines.filter(has_outline);
    assert_unchanged(problems);
}

#[test]
fn reference_cases_do_not_change_when_edges_are_split() {
    for file in FILES {
        let Some(cases) = reference_cases(file) else { return };
        let every = (cases.len() / CASES).max(1);
        let problems = cases.into_iter().map(|mut case| case["problem"].take()).filter(has_outline);
        assert_unchanged(problems.step_by(every));
    }
}
