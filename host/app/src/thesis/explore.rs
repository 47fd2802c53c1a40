//! Outlines of unknown parts, explored by touch.

use palpate::geometry::SimplePolygon;
use palpate::inscription::{Exploration, Met};
use palpate::math::random::Draw;
use palpate::math::statistics::{median, percentile};

use super::cases::of_each_in_order;
use super::touch::{area, placed};
use super::{Cell, Experiment, Table, TableSettings};

/// Unknown parts, held still.
pub(super) const EXPERIMENT: Experiment =
    Experiment { name: "explore", title: "outlines of unknown parts after 60 touches", cases: 100, run: table };

/// Touches of each part.
const TOUCHES: usize = 60;

/// Approaches at most: those that meet nothing count.
const APPROACHES_MAX: usize = 240;

/// Root mean square distance of a good outline, m.
const GOOD_M: f64 = 3e-4;

/// Circle in which parts are drawn, and the least radius of stars, m.
const PART_RADIUS: f64 = 0.03;
const STAR_RADIUS_MIN: f64 = 0.012;

/// Mass of a part that is held, kg: no touch moves it.
const HELD_MASS: f64 = 1000.0;

/// Of the robot's coordinates, mm; of the finger's approaches, m/s.
const ROBOT_MM: f64 = 0.02;
const SPEED: f64 = 0.01;

/// A row.
struct Setting {
    name: &'static str,
    /// Of the disk, m.
    radius: f64,
    convex: bool,
}

const SETTINGS: [Setting; 3] = [
    Setting { name: "disk 30 mm, convex", radius: 0.015, convex: true },
    Setting { name: "disk 30 mm, mixed", radius: 0.015, convex: false },
    Setting { name: "pin 6 mm, mixed", radius: 0.003, convex: false },
];

fn table(settings: &TableSettings) -> Table {
    let columns =
        ["row", "parts", "within 0.3 mm", "rms mm", "rms 90 %", "stated mm", "in 3 stated", "touches", "approaches"];
    let mut table = Table::new(columns);
    table.definitions.extend([
        format!(
            "Parts within a circle of 6 cm, convex with 3 to 9 corners or, two of five where they are mixed, stars of 4 to 9 vertices, \
             anywhere in a square of 200 mm and held still, each touched {TOUCHES} times; finger and robot as in the first row of `touch`."
        ),
        "Root mean square distance, along the true outline, from it to the one found: the share of parts up to 0.3 mm, median and \
         90 % of all; stated: the median of the standard deviation written to the file; in 3 stated: the share up to three times that. Notches narrower than the disk are not felt: \
         their sides are taken to go on straight."
            .to_owned(),
    ]);
    for setting in &SETTINGS {
        let of = |case| trial(settings.seed, case, setting);
        let trials = of_each_in_order(settings.cases, settings.jobs(), of, |_| ());
        for (case, trial) in trials.iter().enumerate().filter(|(_, trial)| !trial.is_good()) {
            let off = trial.off.map_or("no outline".to_owned(), |off| format!("{:.2} mm off", off * 1e3));
            table.failures.push(format!("{}, case {case}: {off}", setting.name));
        }
        let number = |value: Option<f64>, decimals| Cell::number(value.unwrap_or(f64::NAN), decimals);
        let off = || trials.iter().map(|trial| trial.off.unwrap_or(f64::INFINITY) * 1e3);
        table.push(vec![
            setting.name.into(),
            Cell::count(trials.len()),
            Cell::share(trials.iter().filter(|trial| trial.is_good()).count(), trials.len()),
            number(median(off()), 3),
            number(percentile(off(), 90), 3),
            number(median(trials.iter().filter_map(|trial| trial.stated).map(|stated| stated * 1e3)), 3),
            Cell::share(trials.iter().filter(|trial| trial.is_covered()).count(), trials.len()),
            number(median(trials.iter().map(|trial| trial.touches as f64)), 0),
            number(median(trials.iter().map(|trial| trial.approaches as f64)), 0),
        ]);
    }
    table
}

/// What came of a part.
struct Trial {
    /// None where nothing is an outline, m.
    off: Option<f64>,
    /// m.
    stated: Option<f64>,
    touches: usize,
    approaches: usize,
}

impl Trial {
    fn is_good(&self) -> bool {
        self.off.is_some_and(|off| off <= GOOD_M)
    }

    /// Whether it is off by no more than three times what is stated.
    fn is_covered(&self) -> bool {
        self.off.zip(self.stated).is_some_and(|(off, stated)| off <= 3.0 * stated)
    }
}

fn trial(seed: u64, case: usize, setting: &Setting) -> Trial {
    let mut draw = Draw::case(seed, case);
    let outline = if setting.convex || draw.chance(0.6) {
        let points = 3 + draw.index(7);
        draw.convex_polygon(points, PART_RADIUS)
    } else {
        let vertices = 4 + draw.index(6);
        draw.star_polygon(vertices, STAR_RADIUS_MIN, PART_RADIUS)
    };
    let mut world = placed(&outline, ROBOT_MM, &mut draw);
    world.mass = HELD_MASS;
    world.radius = setting.radius;
    let mut exploration = Exploration::new(setting.radius, area());
    let mut approaches = 0;
    while exploration.touches().len() < TOUCHES && approaches < APPROACHES_MAX {
        let Some(next) = exploration.next() else { break };
        // What cannot be pushed is not touched.
        let met = world.make(&next.approach, SPEED, &mut draw).unwrap_or(Met::Nothing);
        exploration.take(&next.approach, &met);
        approaches += 1;
    }
    let isometry = world.pose.isometry();
    let corners: Vec<_> = outline.vertices().iter().map(|vertex| isometry * vertex).collect();
    // A pose moves the outline by rounding alone, so what was a polygon is one.
    let truth = SimplePolygon::new(corners).ok();
    let found = exploration.outline();
    let off = truth.zip(found.as_ref()).map(|(truth, found)| truth.distance_rms(&found.outline));
    Trial { off, stated: found.map(|found| found.sigma()), touches: exploration.touches().len(), approaches }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearly_all_outlines_are_found_and_what_is_stated_is_of_their_size() {
        for setting in &SETTINGS[1..] {
            let trials: Vec<_> = (0..20).map(|case| trial(1, case, setting)).collect();
            assert!(trials.iter().filter(|trial| trial.is_good()).count() >= 19, "{}", setting.name);
            assert!(trials.iter().filter(|trial| trial.is_covered()).count() >= 18, "{}", setting.name);
        }
    }
}
