//! What `palpate touch` prints: lines for a person, objects for programs.

use nalgebra::Point2;
use palpate::inscription::{Met, NextTouch, PoseMode, TouchSearch, TouchVerdict};
use serde_json::{Value, json};

use super::is_touch;
use crate::cli::{counted, turn_deg};
use crate::width::folded;

/// Poses that a person is shown; a program gets them all.
const SHOWN: usize = 6;

/// How it is printed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Told {
    pub(crate) json: bool,
}

fn mm(place: Point2<f64>) -> String {
    format!("({:.1}, {:.1})", place.x * 1e3, place.y * 1e3)
}

impl Told {
    /// The approach that is made now.
    pub(super) fn next(self, number: usize, next: &NextTouch) {
        if self.json {
            return;
        }
        let approach = &next.approach;
        say!(
            "approach {number}: from {} mm towards {} mm\n  it meets the part with {:.0} %; {:.0} % of what is left stay on average",
            mm(approach.from),
            mm(approach.at(approach.length)),
            next.meets * 1e2,
            next.leaves * 1e2
        );
    }

    /// What came of it.
    pub(super) fn met(self, search: &TouchSearch, number: usize, next: &NextTouch, met: &Met) {
        let verdict = search.verdict();
        if self.json {
            let approach = &next.approach;
            let end = approach.at(approach.length);
            say!(
                "{}",
                json!({
                    "approach": number,
                    "from": [approach.from.x, approach.from.y],
                    "towards": [end.x, end.y],
                    "touch": touch_json(met),
                    "poses": poses_json(search, modes(&verdict)),
                })
            );
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
        if is_touch(met) || !search.touches().is_empty() {
            let modes = modes(&verdict);
            match modes.len() {
                0 => say!("  the poses that are left are not told apart yet"),
                count => say!("  {} left", counted(count, "pose")),
            }
            self.poses(search, modes);
        }
    }

    fn poses(self, search: &TouchSearch, modes: &[PoseMode]) {
        for mode in modes.iter().take(SHOWN) {
            say!("    {}", in_words(search, mode));
        }
        if modes.len() > SHOWN {
            say!("    and {} more", modes.len() - SHOWN);
        }
    }

    /// How it ended.
    pub(super) fn end(self, search: &TouchSearch, verdict: &TouchVerdict, approaches: usize) {
        let touches = search.touches().len();
        let modes = modes(verdict);
        if self.json {
            let verdict = match verdict {
                TouchVerdict::One(_) => "one",
                TouchVerdict::Alike(_) => "alike",
                TouchVerdict::NoPose => "none",
                TouchVerdict::Open { .. } => "open",
            };
            let poses = poses_json(search, modes);
            say!("{}", json!({ "verdict": verdict, "approaches": approaches, "touches": touches, "poses": poses }));
            return;
        }
        let after = format!(
            "after {}, {} of which met the part",
            if approaches == 1 { "1 approach".to_owned() } else { format!("{approaches} approaches") },
            touches
        );
        match verdict {
            TouchVerdict::One(mode) => {
                say!("{}", folded(&format!("The part is at {}, {after}.", in_words(search, mode))));
            }
            TouchVerdict::Alike(_) => {
                let same = "in each the outline is the same within the tolerance";
                say!("{}", folded(&format!("Touch cannot tell these poses apart, {after}: {same}.")));
                self.poses(search, modes);
            }
            TouchVerdict::NoPose => {
                let why = "it was moved, it is another, or it is not all within --area-mm";
                say!("{}", folded(&format!("No pose of this part fits what was felt, {after}: {why}.")));
            }
            TouchVerdict::Open { .. } => {
                say!("Not decided {after}.");
                self.poses(search, modes);
            }
        }
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
