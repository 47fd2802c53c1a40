//! Parts found by touch: is the pose right, and how many approaches does it take?

use std::f64::consts::TAU;

use nalgebra::{Point2, Vector2};
use palpate::GRAVITY_ASSUMED;
use palpate::geometry::{Pose, SimplePolygon};
use palpate::inscription::{Approach, Met, TouchSearch, TouchTask, TouchTolerance, TouchVerdict, outlines_apart};
use palpate::math::angle::wrap_angle;
use palpate::math::random::Draw;
use palpate::math::statistics::{median, percentile};
use palpate::pushing::approach_speed::{ApproachLimits, Holding};
use palpate::pushing::dynamics::support::SupportFriction;
use palpate::pushing::quasi_static::Support;
use palpate::pushing::touched_world::{TouchErrors, TouchedWorld};

use super::cases::{of_each_in_order, until_possible};
use super::processor_time::ProcessorTime;
use super::{Cell, Experiment, Table, TableSettings};

/// Parts anywhere in a square.
pub(super) const EXPERIMENT: Experiment =
    Experiment { name: "touch", title: "parts found by touch, approach by approach", cases: 500, run: table };

/// Side of the square, m.
const SQUARE: f64 = 0.2;

/// Of the disk: the default finger's, m.
pub(super) const RADIUS: f64 = 0.015;

/// Friction between finger and part, and of the part's support.
pub(super) const CONTACT_FRICTION: f64 = 0.25;
const SUPPORT_FRICTION: f64 = 0.3;

/// Of the part, kg.
const MASS: f64 = 0.3;

/// The part may be moved by so much in a touch, m.
const MOTION_MAX: f64 = 1e-5;

/// The robot goes to parts no faster, m/s.
const SPEED_MAX: f64 = 0.02;

/// Approaches after which a search is given up.
pub(super) const APPROACHES_MAX: usize = 40;

/// The default finger, felt from 0.1 N on, and a robot that brakes 10 ms later with 2 m/s².
const LIMITS: ApproachLimits = ApproachLimits { stiffness: 27.455e3, threshold: 0.1, latency: 0.01, deceleration: 2.0 };

/// Directions in which an outline is laid on itself, to see whether it can be told from a turned one.
const TURNS: u32 = 720;

/// How approaches are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Choice {
    Planned,
    /// Lines drawn evenly in direction and offset across the square.
    Uniform,
}

/// A row.
struct Setting {
    name: &'static str,
    choice: Choice,
    /// Of each coordinate, mm.
    robot_mm: f64,
    /// None where it follows from what holds the part.
    speed: Option<f64>,
    /// Whether parts look the same after some turn.
    symmetric: bool,
}

/// Of each of the robot's coordinates, as a rule, mm.
pub(super) const PLANNED_ROBOT_MM: f64 = 0.02;

const PLANNED: Setting =
    Setting { name: "planned", choice: Choice::Planned, robot_mm: PLANNED_ROBOT_MM, speed: None, symmetric: false };

const SETTINGS: [Setting; 5] = [
    PLANNED,
    Setting { name: "uniform lines", choice: Choice::Uniform, ..PLANNED },
    Setting { name: "robot 0.05 mm", robot_mm: 0.05, ..PLANNED },
    Setting { name: "at 20 mm/s", speed: Some(0.02), ..PLANNED },
    Setting { name: "symmetric parts", symmetric: true, ..PLANNED },
];

fn table(settings: &TableSettings) -> Table {
    let columns = [
        "row",
        "parts",
        "can be told",
        "right and one",
        "wrong and certain",
        "said alike",
        "touches",
        "touches 90 %",
        "approaches",
        "mean approaches",
        "moved mm",
        "s a part",
    ];
    let mut table = Table::new(columns);
    table.definitions.extend([
        format!(
            "Parts within 8 cm, three of five convex with 3 to 9 corners, the others stars, of {MASS} kg on their faces with \
             a friction of {SUPPORT_FRICTION}; anywhere and at any angle in a square of 200 mm, touched by a disk of 30 mm \
             with a friction of {CONTACT_FRICTION}. Symmetric parts: rectangles and regular polygons."
        ),
        format!(
            "The robot's coordinates are off by 0.02 mm (one standard deviation), its clock by 1 ms, the force's direction by \
             0.02 rad; it brakes 10 ms after 0.1 N are felt, with 2 m/s², and goes as fast as moves no part by more than \
             {:.2} mm, by its support's friction. What it presses on beyond that moves the part.",
            MOTION_MAX * 1e3
        ),
        "Can be told: laid on itself by its centroid at no turn beyond 1° is the outline within 0.2 mm; the next columns \
         count those, of symmetric parts all. Right: within 0.2 mm (of the centroid) and 0.3°, where the part then lies. \
         Alike: poses that no touch tells apart, the truth among them. Touches, approaches: medians of those that meet \
         the part, and of all; moved: the median of how far the part was moved in all."
            .to_owned(),
    ]);
    for setting in &SETTINGS {
        let threads = settings.jobs();
        let trials = of_each_in_order(settings.cases, threads, |case| trial(settings.seed, case, setting), |_| ());
        // Too fast a finger fails nearly always: that row's figures say so.
        let is_told = |trial: &&Trial| setting.speed.is_none() && trial.is_judged(setting) && !trial.is_good(setting);
        for trial in trials.iter().filter(is_told) {
            table.failures.push(format!("{}, case {}: {}", setting.name, trial.case, trial.ending.in_words()));
        }
        table.push(row(setting, &trials));
    }
    table
}

fn row(setting: &Setting, trials: &[Trial]) -> Vec<Cell> {
    let judged: Vec<_> = trials.iter().filter(|trial| trial.is_judged(setting)).collect();
    let share =
        |of: &dyn Fn(&Trial) -> bool| Cell::share(judged.iter().filter(|trial| of(trial)).count(), judged.len());
    let number = |value: Option<f64>, decimals: usize| Cell::number(value.unwrap_or(f64::NAN), decimals);
    let touches = || judged.iter().map(|trial| trial.touches as f64);
    let approaches = || judged.iter().map(|trial| trial.approaches as f64);
    vec![
        setting.name.into(),
        Cell::count(trials.len()),
        Cell::share(trials.iter().filter(|trial| trial.can_be_told).count(), trials.len()),
        share(&|trial| trial.ending == Ending::Right),
        share(&|trial| trial.ending == Ending::Wrong),
        share(&|trial| trial.ending == Ending::Alike),
        number(median(touches()), 0),
        number(percentile(touches(), 90), 0),
        number(median(approaches()), 0),
        Cell::number(approaches().sum::<f64>() / judged.len().max(1) as f64, 2),
        number(median(judged.iter().map(|trial| trial.moved * 1e3)), 3),
        Cell::number(trials.iter().map(|trial| trial.seconds).sum::<f64>() / trials.len().max(1) as f64, 2),
    ]
}

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ending {
    Right,
    /// One pose, and not the true one; or several alike without it.
    Wrong,
    /// Poses that cannot be told apart, the true one among them.
    Alike,
    NoPose,
    GivenUp,
}

impl Ending {
    fn in_words(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Wrong => "wrong and certain",
            Self::Alike => "said to be alike",
            Self::NoPose => "no pose",
            Self::GivenUp => "not decided",
        }
    }
}

struct Trial {
    case: usize,
    can_be_told: bool,
    ending: Ending,
    touches: usize,
    approaches: usize,
    /// m.
    moved: f64,
    seconds: f64,
}

impl Trial {
    fn is_judged(&self, setting: &Setting) -> bool {
        self.can_be_told || setting.symmetric
    }

    fn is_good(&self, setting: &Setting) -> bool {
        self.ending == Ending::Right || setting.symmetric && self.ending == Ending::Alike
    }
}

fn trial(seed: u64, case: usize, setting: &Setting) -> Trial {
    let begun = ProcessorTime::now();
    let mut draw = Draw::case(seed, case);
    let outline = if setting.symmetric {
        symmetric_part(&mut draw)
    } else {
        super::cases::random_part(&mut draw).polygon().clone()
    };
    let mut world = placed(&outline, setting.robot_mm, &mut draw);
    let pose = world.pose;
    let area = area();
    let speed = setting.speed.unwrap_or_else(|| safe_speed(&outline));
    let tolerance = TouchTolerance::default();
    let mut search = TouchSearch::new(TouchTask { outline: outline.clone(), radius: RADIUS, area, tolerance });
    let mut approaches = 0;
    let ending = loop {
        match search.verdict() {
            TouchVerdict::One(mode) => break judged(&outline, &[mode.pose], &world.pose, Ending::Right),
            TouchVerdict::Alike(modes) => {
                let poses: Vec<_> = modes.iter().map(|mode| mode.pose).collect();
                break judged(&outline, &poses, &world.pose, Ending::Alike);
            }
            TouchVerdict::NoPose => break Ending::NoPose,
            TouchVerdict::Open { .. } if approaches == APPROACHES_MAX => break Ending::GivenUp,
            TouchVerdict::Open { .. } => {}
        }
        let planned = || search.next().map(|next| next.approach);
        let approach = if setting.choice == Choice::Planned { planned() } else { Some(uniform_line(&mut draw)) };
        let Some(approach) = approach else { break Ending::NoPose };
        approaches += 1;
        match world.make(&approach, speed, &mut draw) {
            Ok(met) => search.take(&approach, &widened(met)),
            Err(_) => break Ending::GivenUp,
        }
    };
    Trial {
        case,
        can_be_told: can_be_told(&outline, &tolerance),
        ending,
        touches: search.touches().len(),
        approaches,
        moved: outlines_apart(&outline, &pose, &world.pose),
        seconds: begun.seconds(),
    }
}

/// The square.
pub(super) fn area() -> [Point2<f64>; 2] {
    [Point2::origin(), Point2::new(SQUARE, SQUARE)]
}

/// A part anywhere in the square, and a robot that is off by so much (mm).
pub(super) fn placed(outline: &SimplePolygon, robot_mm: f64, draw: &mut Draw) -> TouchedWorld {
    let [low, high] = area();
    let pose = until_possible(draw, |draw| {
        let pose = Pose { x: draw.uniform(0.0, SQUARE), y: draw.uniform(0.0, SQUARE), theta: draw.uniform(0.0, TAU) };
        let is_inside = |vertex: &Point2<f64>| {
            let at = pose.isometry() * vertex;
            (low - at).max() <= 0.0 && (at - high).max() <= 0.0
        };
        outline.vertices().iter().all(is_inside).then_some(pose)
    });
    TouchedWorld {
        outline: outline.clone(),
        support: Support::Uniform { friction: SUPPORT_FRICTION },
        mass: MASS,
        gravity: GRAVITY_ASSUMED,
        radius: RADIUS,
        contact_friction: CONTACT_FRICTION,
        limits: LIMITS,
        errors: TouchErrors { position: robot_mm * 1e-3, clock: 1e-3, angle: 0.02 },
        pose,
        pressed: None,
    }
}

/// With which the finger moves a part by no more than is allowed.
pub(super) fn safe_speed(outline: &SimplePolygon) -> f64 {
    let holding = Holding::of(outline, &SupportFriction::uniform(outline), SUPPORT_FRICTION * MASS * GRAVITY_ASSUMED);
    LIMITS.safe_speed(&holding, MOTION_MAX, SPEED_MAX).map_or(0.0, |safe| safe.speed)
}

/// The touch with what the part may have moved by since.
pub(super) fn widened(met: Met) -> Met {
    match met {
        Met::Nothing => Met::Nothing,
        Met::Part(mut touch) => {
            touch.sigma = touch.sigma.hypot(MOTION_MAX);
            Met::Part(touch)
        }
    }
}

/// Whether the truth is among poses, within the tolerance.
pub(super) fn judged(outline: &SimplePolygon, poses: &[Pose], truth: &Pose, if_so: Ending) -> Ending {
    let TouchTolerance { distance, angle } = TouchTolerance::default();
    let centroid = outline.centroid();
    let is_true = |pose: &Pose| {
        (pose.isometry() * centroid - truth.isometry() * centroid).norm() <= distance
            && wrap_angle(pose.theta - truth.theta).abs() <= angle
    };
    if poses.iter().any(is_true) { if_so } else { Ending::Wrong }
}

/// Whether no turn about the centroid lays the outline on itself within the tolerance.
fn can_be_told(outline: &SimplePolygon, tolerance: &TouchTolerance) -> bool {
    let centroid = outline.centroid();
    let turned =
        |theta: f64| Pose::from(nalgebra::Isometry2::rotation_wrt_point(nalgebra::UnitComplex::new(theta), centroid));
    let apart = |theta: f64| outlines_apart(outline, &turned(0.0), &turned(theta));
    let step = TAU / f64::from(TURNS);
    // A turn of half a step moves no corner by more than this.
    let reach = outline.vertices().iter().map(|vertex| (vertex - centroid).norm()).fold(0.0, f64::max) * 0.5 * step;
    let candidates =
        (2..TURNS - 1).map(|k| step * f64::from(k)).filter(|theta| apart(*theta) <= tolerance.distance + reach);
    !candidates.into_iter().any(|theta| {
        let fine = (-50..=50).map(|k| theta + step * f64::from(k) / 100.0);
        fine.map(apart).fold(f64::INFINITY, f64::min) <= tolerance.distance
    })
}

fn symmetric_part(draw: &mut Draw) -> SimplePolygon {
    until_possible(draw, |draw| {
        let corners: Vec<Point2<f64>> = if draw.chance(0.5) {
            let [a, b] = [draw.uniform(0.012, 0.035), draw.uniform(0.012, 0.035)];
            [[-a, -b], [a, -b], [a, b], [-a, b]].map(Point2::from).to_vec()
        } else {
            let (count, radius) = (3 + u32::try_from(draw.index(4)).unwrap_or(0), draw.uniform(0.02, 0.04));
            let angle = |k: u32| TAU * f64::from(k) / f64::from(count);
            (0..count).map(|k| Point2::new(radius * angle(k).cos(), radius * angle(k).sin())).collect()
        };
        SimplePolygon::new(corners).ok()
    })
}

/// A line across the square with the disk's width about it.
fn uniform_line(draw: &mut Draw) -> Approach {
    let angle = draw.uniform(0.0, TAU);
    let direction = Vector2::new(angle.cos(), angle.sin());
    // Half of the square's breadth across the line.
    let half = 0.5 * SQUARE * (direction.x.abs() + direction.y.abs());
    let offset = draw.uniform(-half, half);
    let length = 2.0 * SQUARE;
    let middle = Point2::new(0.5 * SQUARE, 0.5 * SQUARE) + Vector2::new(-direction.y, direction.x) * offset;
    Approach { from: middle - direction * (0.5 * length), direction, length }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symmetric_parts_cannot_be_told_and_others_can() {
        let mut draw = Draw::case(5, 0);
        let tolerance = TouchTolerance::default();
        for _ in 0..5 {
            assert!(!can_be_told(&symmetric_part(&mut draw), &tolerance));
        }
        let told = (0..20).filter(|_| can_be_told(super::super::cases::random_part(&mut draw).polygon(), &tolerance));
        assert!(told.count() >= 18);
    }

    #[test]
    fn nearly_all_parts_are_found_and_none_is_wrong() {
        let trials: Vec<_> = (0..12).map(|case| trial(1, case, &PLANNED)).collect();
        let right = trials.iter().filter(|trial| trial.ending == Ending::Right).count();
        assert!(right >= 11 && trials.iter().all(|trial| trial.ending != Ending::Wrong), "{right} of 12");
    }
}
