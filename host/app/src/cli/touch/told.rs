//! What `palpate touch` prints: lines for a person, objects for programs.

use nalgebra::Point2;
use palpate::geometry::Pose;
use palpate::inscription::{Met, NextTouch, PartLeft, PartsSearch, PartsVerdict, PoseMode, TouchSearch, TouchVerdict};
use serde_json::{Value, json};

use super::{Ground, Sought};
use crate::cli::{counted, turn_deg};
use crate::pictures::touch::TouchLeft;
use crate::width::folded;

/// Poses that a person is shown; a program gets them all.
const SHOWN: usize = 6;

/// Poses that a picture shows after an approach.
const DRAWN: usize = 24;

/// How it is printed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Told {
    pub(crate) json: bool,
}

fn mm(place: Point2<f64>) -> String {
    format!("({:.1}, {:.1})", place.x * 1e3, place.y * 1e3)
}

/// Exit status where nothing that is known fits.
const EXIT_NOTHING: u8 = 2;

/// Exit status where the approaches did not decide.
pub(super) const EXIT_OPEN: u8 = 3;

impl Told {
    /// The approach that is made now.
    pub(super) fn next(self, number: usize, next: &NextTouch) {
        if self.json {
            return;
        }
        let approach = &next.approach;
        if next.leaves.is_nan() {
            say!("approach {number}: from {} mm towards {} mm", mm(approach.from), mm(approach.at(approach.length)));
            return;
        }
        say!(
            "approach {number}: from {} mm towards {} mm\n  it meets the part with {:.0} %; {:.0} % of what is left stay on average",
            mm(approach.from),
            mm(approach.at(approach.length)),
            next.meets * 1e2,
            next.leaves * 1e2
        );
    }

    /// What came of it.
    pub(super) fn met(self, sought: &dyn Sought, number: usize, next: &NextTouch, met: &Met) {
        if self.json {
            let approach = &next.approach;
            let end = approach.at(approach.length);
            let mut object = json!({
                "approach": number,
                "from": [approach.from.x, approach.from.y],
                "towards": [end.x, end.y],
                "touch": touch_json(met),
            });
            let (key, left) = sought.left_json();
            object[key] = left;
            say!("{object}");
            return;
        }
        match met {
            Met::Nothing => say!("  nothing there"),
            Met::Part(touch) => say!(
                "  touched: disk at ({:.2}, {:.2}) ± {:.3} mm, normal at {:.1}° ± {:.1}°",
                touch.centre.x * 1e3,
                touch.centre.y * 1e3,
                touch.sigma * 1e3,
                touch.force_angle.to_degrees(),
                touch.half_width.to_degrees()
            ),
        }
        if sought.has_touched() {
            sought.say_left();
        }
    }
}

fn say_poses(search: &TouchSearch, modes: &[PoseMode], indent: &str) {
    for mode in modes.iter().take(SHOWN) {
        say!("{indent}{}", in_words(search, mode));
    }
    if modes.len() > SHOWN {
        say!("{indent}and {} more", modes.len() - SHOWN);
    }
}

/// How many approaches there were.
pub(super) fn after(approaches: usize, touches: usize) -> String {
    let made = if approaches == 1 { "1 approach".to_owned() } else { format!("{approaches} approaches") };
    format!("after {made}, {touches} of which met the part")
}

impl Sought for TouchSearch {
    fn ground(&self) -> Ground {
        Ground { radius: self.task().radius, area: self.task().area }
    }

    fn next(&self) -> Option<NextTouch> {
        matches!(self.verdict(), TouchVerdict::Open { .. }).then(|| self.next()).flatten()
    }

    fn take(&mut self, next: &NextTouch, met: &Met) {
        self.take(&next.approach, met);
    }

    fn has_touched(&self) -> bool {
        !self.touches().is_empty()
    }

    fn left_json(&self) -> (&'static str, Value) {
        ("poses", poses_json(self, modes(&self.verdict())).into())
    }

    fn say_left(&self) {
        let verdict = self.verdict();
        let modes = modes(&verdict);
        match modes.len() {
            0 => say!("  the poses that are left are not told apart yet"),
            count => say!("  {} left", counted(count, "pose")),
        }
        say_poses(self, modes, "    ");
    }

    fn left(&self) -> (String, Vec<TouchLeft>) {
        let verdict = self.verdict();
        let words = match (&verdict, modes(&verdict).len()) {
            (TouchVerdict::NoPose, _) => "no pose fits".to_owned(),
            (_, 0) => "poses not told apart".to_owned(),
            (_, count) => format!("{} left", counted(count, "pose")),
        };
        let is_told_apart = !modes(&verdict).is_empty();
        let of_a_pose =
            |(number, outline)| TouchLeft { outline, kind: if is_told_apart { number } else { 0 }, name: None };
        (words, outlines(self, DRAWN).into_iter().enumerate().map(of_a_pose).collect())
    }

    fn end(&self, told: Told, approaches: usize, is_given_up: bool) -> miette::Result<u8> {
        let verdict = self.verdict();
        let touches = self.touches().len();
        let modes = modes(&verdict);
        let status = match verdict {
            TouchVerdict::One(_) | TouchVerdict::Alike(_) => 0,
            TouchVerdict::Open { .. } if is_given_up => EXIT_OPEN,
            TouchVerdict::Open { .. } | TouchVerdict::NoPose => EXIT_NOTHING,
        };
        if told.json {
            let verdict = match verdict {
                TouchVerdict::One(_) => "one",
                TouchVerdict::Alike(_) => "alike",
                TouchVerdict::NoPose => "none",
                TouchVerdict::Open { .. } => "open",
            };
            let poses = poses_json(self, modes);
            say!("{}", json!({ "verdict": verdict, "approaches": approaches, "touches": touches, "poses": poses }));
            return Ok(status);
        }
        let after = after(approaches, touches);
        match verdict {
            TouchVerdict::One(mode) => {
                say!("{}", folded(&format!("The part is at {}, {after}.", in_words(self, &mode))));
            }
            TouchVerdict::Alike(_) => {
                let same = "in each the outline is the same within the tolerance";
                say!("{}", folded(&format!("Touch cannot tell these poses apart, {after}: {same}.")));
                say_poses(self, modes, "    ");
            }
            TouchVerdict::NoPose => {
                let why = "it was moved, it is another, or it is not all within --area-mm";
                let last = self
                    .touches()
                    .last()
                    .map_or(String::new(), |touch| format!(", the last at {} mm", mm(touch.centre)));
                let remedy = "Hold it still, or name the right file or a larger area, and begin anew.";
                say!("{}", folded(&format!("No pose of this part fits what was felt, {after}{last}: {why}. {remedy}")));
            }
            TouchVerdict::Open { .. } => {
                say!("Not decided {after}.");
                say_poses(self, modes, "    ");
            }
        }
        Ok(status)
    }
}

/// Which of the parts of a library lies there.
pub(super) struct SoughtPart {
    search: PartsSearch,
    names: Vec<String>,
    touches: usize,
}

impl SoughtPart {
    pub(super) fn new(search: PartsSearch, names: Vec<String>) -> Self {
        Self { search, names, touches: 0 }
    }

    fn say_parts(&self, left: &[PartLeft]) {
        for left in left.iter().take(SHOWN) {
            say!("    {}", self.names[left.part]);
            say_poses(self.search.part(left.part), &left.modes, "      ");
        }
        if left.len() > SHOWN {
            say!("    and {}", counted(left.len() - SHOWN, "more part"));
        }
    }

    fn parts_json(&self, left: &[PartLeft]) -> Vec<Value> {
        let part = |left: &PartLeft| {
            let poses = poses_json(self.search.part(left.part), &left.modes);
            json!({ "part": self.names[left.part], "poses": poses })
        };
        left.iter().map(part).collect()
    }
}

impl Sought for SoughtPart {
    fn ground(&self) -> Ground {
        let task = self.search.part(0).task();
        Ground { radius: task.radius, area: task.area }
    }

    fn next(&self) -> Option<NextTouch> {
        matches!(self.search.verdict(), PartsVerdict::Open(_)).then(|| self.search.next()).flatten()
    }

    fn take(&mut self, next: &NextTouch, met: &Met) {
        self.touches += usize::from(matches!(met, Met::Part(_)));
        self.search.take(&next.approach, met);
    }

    fn has_touched(&self) -> bool {
        self.touches > 0
    }

    fn left_json(&self) -> (&'static str, Value) {
        let left = self.search.parts_left();
        // Of hundreds the number is enough.
        let parts = if left <= SHOWN { self.parts_json(parts(&self.search.verdict())) } else { Vec::new() };
        ("left", json!({ "count": left, "parts": parts }))
    }

    fn say_left(&self) {
        say!("  {} left of {}", counted(self.search.parts_left(), "part"), self.names.len());
        if self.search.parts_left() <= SHOWN {
            self.say_parts(parts(&self.search.verdict()));
        }
    }

    fn left(&self) -> (String, Vec<TouchLeft>) {
        let verdict = self.search.verdict();
        let words = match verdict {
            PartsVerdict::NoneOfThese => "none of the parts fits".to_owned(),
            _ => format!("{} left", counted(self.search.parts_left(), "part")),
        };
        // Of hundreds nothing would be seen.
        let shown = Some(parts(&verdict)).filter(|parts| parts.len() <= SHOWN).unwrap_or_default();
        let of_a_part = |left: &PartLeft| {
            let (kind, name) = (left.part, &self.names[left.part]);
            let outlines = outlines(self.search.part(kind), DRAWN / shown.len()).into_iter();
            outlines.map(move |outline| TouchLeft { outline, kind, name: Some(name.clone()) }).collect::<Vec<_>>()
        };
        (words, shown.iter().flat_map(of_a_part).collect())
    }

    fn end(&self, told: Told, approaches: usize, is_given_up: bool) -> miette::Result<u8> {
        let verdict = self.search.verdict();
        let status = match verdict {
            PartsVerdict::One(_) | PartsVerdict::Alike(_) => 0,
            PartsVerdict::Open(_) if is_given_up => EXIT_OPEN,
            PartsVerdict::Open(_) | PartsVerdict::NoneOfThese => EXIT_NOTHING,
        };
        let left = parts(&verdict);
        if told.json {
            let name = match verdict {
                PartsVerdict::One(_) => "one",
                PartsVerdict::Alike(_) => "alike",
                PartsVerdict::NoneOfThese => "none",
                PartsVerdict::Open(_) => "open",
            };
            let parts = self.parts_json(left);
            say!("{}", json!({ "verdict": name, "approaches": approaches, "touches": self.touches, "parts": parts }));
            return Ok(status);
        }
        let after = after(approaches, self.touches);
        let sentence = match &verdict {
            PartsVerdict::One(_) => format!("It is this part, {after}:"),
            PartsVerdict::Alike(_) => format!("Touch cannot tell these parts apart, {after}:"),
            PartsVerdict::NoneOfThese => {
                format!(
                    "It is none of the {} parts, {after}; or it was moved, or is not all within --area-mm.",
                    self.names.len()
                )
            }
            PartsVerdict::Open(_) => format!("Not decided {after}."),
        };
        say!("{}", folded(&sentence));
        self.say_parts(left);
        Ok(status)
    }
}

/// A part's outline in some of the poses that are left.
fn outlines(search: &TouchSearch, most: usize) -> Vec<Vec<Point2<f64>>> {
    let vertices = search.task().outline.vertices();
    let placed = |pose: Pose| vertices.iter().map(|vertex| pose.isometry() * vertex).collect();
    search.some_poses(most).into_iter().map(placed).collect()
}

/// The parts that are told.
fn parts(verdict: &PartsVerdict) -> &[PartLeft] {
    match verdict {
        PartsVerdict::One(left) => std::slice::from_ref(left),
        PartsVerdict::Alike(left) | PartsVerdict::Open(left) => left,
        PartsVerdict::NoneOfThese => &[],
    }
}

/// The poses that are told.
fn modes(verdict: &TouchVerdict) -> &[PoseMode] {
    match verdict {
        TouchVerdict::One(mode) => std::slice::from_ref(mode),
        TouchVerdict::Alike(modes) | TouchVerdict::Open { modes } => modes,
        TouchVerdict::NoPose => &[],
    }
}

fn in_words(search: &TouchSearch, mode: &PoseMode) -> String {
    let [distance, angle] = search.deviations(mode);
    let centroid = mode.pose.isometry() * search.task().outline.centroid();
    format!(
        "centroid ({:.2}, {:.2}) ± {:.3} mm, turned {:.2} ± {:.2}°",
        centroid.x * 1e3,
        centroid.y * 1e3,
        distance * 1e3,
        turn_deg(mode.pose.theta),
        angle.to_degrees()
    )
}

fn touch_json(met: &Met) -> Value {
    match met {
        Met::Nothing => Value::Null,
        Met::Part(touch) => json!({
            "centre": [touch.centre.x, touch.centre.y],
            "sigma": touch.sigma,
            "force_angle": touch.force_angle,
            "half_width": touch.half_width,
        }),
    }
}

fn poses_json(search: &TouchSearch, modes: &[PoseMode]) -> Vec<Value> {
    let pose = |mode: &PoseMode| {
        let [distance_sd, angle_sd] = search.deviations(mode);
        let covariance: Vec<Vec<f64>> =
            (0..3).map(|row| (0..3).map(|column| mode.covariance[(row, column)]).collect()).collect();
        json!({
            "x": mode.pose.x, "y": mode.pose.y, "theta": mode.pose.theta, "chi2": mode.chi2,
            "covariance": covariance, "centroid_sd": distance_sd, "theta_sd": angle_sd,
        })
    };
    modes.iter().map(pose).collect()
}
