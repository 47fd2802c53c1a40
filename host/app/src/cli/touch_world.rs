//! The simulated world of the commands that touch: a part on a table, and the finger that comes to it.

use std::f64::consts::TAU;
use std::path::Path;

use nalgebra::Point2;
use palpate::geometry::{Pose, SimplePolygon};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::pushing::approach_speed::ApproachLimits;
use palpate::pushing::quasi_static::Support;
use palpate::pushing::touched_world::{TouchErrors, TouchedWorld};
use palpate_files::part::PolygonFile;

use super::read::{read_beside, tell_part};
use super::{finite, positive};
use crate::thesis::demonstration::compliance_by_design;

/// Where no file says it: friction of the table.
const MU: f64 = 0.3;

/// Where no file says it: friction between finger and part.
pub(super) const MU_C: f64 = 0.25;

/// Tries to place a part in an area before it is taken for too large.
const PLACES_TRIED: u32 = 10_000;

/// Where the part lies and what it weighs.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct WorldArguments {
    /// Where the simulated part may lie: two corners of a rectangle, in mm
    #[arg(long, value_name = "X,Y,X,Y", default_value = "0,0,200,200", value_parser = area_mm, allow_hyphen_values = true)]
    pub(super) area_mm: Area,

    /// Where it lies: X,Y in mm of its file's origin, and its turn in degrees [default: anywhere in the area]
    #[arg(long, value_name = "X,Y,DEG", value_parser = pose_mm, allow_hyphen_values = true)]
    pose: Option<Pose>,

    /// Its mass
    #[arg(long, value_name = "KG", default_value_t = 1.0, value_parser = positive)]
    mass_kg: f64,
}

/// A rectangle in the robot's frame, m: the lesser coordinates first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Area(pub(super) [Point2<f64>; 2]);

fn numbers<const N: usize>(text: &str, what: &str) -> Result<[f64; N], String> {
    let numbers: Vec<f64> = text.split(',').map(|word| finite(word.trim())).collect::<Result<_, _>>()?;
    numbers.try_into().map_err(|numbers: Vec<_>| format!("{text:?} has {} numbers, and {what}", numbers.len()))
}

/// Longest side of an area, m: beyond the reach of any robot that touches, and what is sought there takes days.
const SIDE_MAX: f64 = 10.0;

/// Two corners in mm.
pub(super) fn area_mm(text: &str) -> Result<Area, String> {
    let [a, b, c, d] = numbers(text, "two corners are four: X,Y,X,Y")?.map(|mm| mm * 1e-3);
    let [low, high] = [Point2::new(a.min(c), b.min(d)), Point2::new(a.max(c), b.max(d))];
    let [least, most] = [(high - low).min(), (high - low).max()];
    if least <= 0.0 {
        return Err(format!("{text:?} has no breadth"));
    }
    if most > SIDE_MAX {
        return Err(format!("a side is {most:.1} m long, and {SIDE_MAX} m is the most: are the numbers in mm?"));
    }
    Ok(Area([low, high]))
}

/// A place in mm.
pub(super) fn point_mm(text: &str) -> Result<Point2<f64>, String> {
    Ok(Point2::from(numbers(text, "a place has two: X,Y")?.map(|mm: f64| mm * 1e-3)))
}

pub(super) fn pose_mm(text: &str) -> Result<Pose, String> {
    let [x, y, turn] = numbers(text, "a pose has three: X,Y,DEG")?;
    Ok(Pose { x: x * 1e-3, y: y * 1e-3, theta: turn.to_radians() })
}

/// A part file of a polygon, with what is odd about it told.
pub(super) fn read_part(path: &Path) -> miette::Result<PolygonFile> {
    let file = read_beside(path, PolygonFile::parse_beside)?;
    tell_part(path, file.part.polygon().vertices(), file.part.body(), &file.doubts());
    Ok(file)
}

impl WorldArguments {
    /// The world with the part of a file, or with one that no turn lays on itself.
    pub(super) fn world(&self, file: Option<&PolygonFile>, seed: u64) -> miette::Result<TouchedWorld> {
        let outline = file.map_or_else(five_corners, |file| file.part.polygon().clone());
        let friction = file.map_or([MU, MU_C], |file| [file.mu, file.mu_c.unwrap_or(MU_C)]);
        let pose = match self.pose {
            Some(pose) => pose,
            None => anywhere(&outline, self.area_mm, &mut Draw::new(seed))?,
        };
        Ok(simulated(outline, friction, self.mass_kg, pose))
    }
}

/// The part of demonstrations.
pub(super) fn five_corners() -> SimplePolygon {
    let corners = [[0.0, 0.0], [60.0, 0.0], [60.0, 25.0], [35.0, 45.0], [0.0, 30.0]];
    let corners = corners.map(|[x, y]: [f64; 2]| Point2::new(x * 1e-3, y * 1e-3));
    SimplePolygon::new(corners).unwrap_or_else(|error| unreachable!("five corners: {error}"))
}

/// A part of this mass (kg), with friction at table and finger, all of whose base rests; the finger is the default one.
pub(super) fn simulated(outline: SimplePolygon, [mu, mu_c]: [f64; 2], mass: f64, pose: Pose) -> TouchedWorld {
    TouchedWorld {
        outline,
        support: Support::Uniform { friction: mu },
        mass,
        gravity: GRAVITY_ASSUMED,
        radius: RADIUS,
        contact_friction: mu_c,
        // In this world, which goes on step by step, only the stiffness counts, and no error of a reading does.
        limits: ApproachLimits {
            stiffness: 1.0 / compliance_by_design(),
            threshold: 0.0,
            latency: 0.0,
            deceleration: f64::INFINITY,
        },
        errors: TouchErrors { position: 0.0, clock: 0.0, angle: 0.0 },
        pose,
        pressed: None,
    }
}

/// Of the simulated finger's disk, m.
pub(super) const RADIUS: f64 = 0.015;

/// A pose in which all of the part is in the area.
pub(super) fn anywhere(outline: &SimplePolygon, Area([low, high]): Area, draw: &mut Draw) -> miette::Result<Pose> {
    for _ in 0..PLACES_TRIED {
        let pose =
            Pose { x: draw.uniform(low.x, high.x), y: draw.uniform(low.y, high.y), theta: draw.uniform(0.0, TAU) };
        let is_inside = |vertex: &Point2<f64>| {
            let at = pose.isometry() * vertex;
            (low - at).max() <= 0.0 && (at - high).max() <= 0.0
        };
        if outline.vertices().iter().all(is_inside) {
            return Ok(pose);
        }
    }
    Err(miette::miette!(help = "tell a larger --area-mm", "the part does not fit into the area"))
}
