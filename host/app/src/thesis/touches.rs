//! Poses from touches, beyond the thesis: are errors as stated, and is the truth in the gate?

use std::f64::consts::TAU;

use nalgebra::Vector2;
use palpate::geometry::{Pose, SimplePolygon};
use palpate::inscription::{FeltNormal, PoseMode, Touch, TouchReadings, touched_poses};
use palpate::math::random::Draw;
use palpate::math::statistics;

use super::inscription::nees;
use super::{Cell, Experiment, Table, TableSettings};

/// Random parts, touched with noise.
pub(super) const EXPERIMENT: Experiment =
    Experiment { name: "touches", title: "poses from touches with noise", cases: 500, run: table };

/// Touches, their standard deviation (mm) and whether normals were felt.
const ROWS: [(usize, f64, bool); 7] = [
    (5, 0.05, false),
    (5, 0.2, false),
    (8, 0.05, false),
    (8, 0.5, false),
    (20, 0.2, false),
    (3, 0.2, true),
    (5, 0.2, true),
];

/// Standard deviation of a normal, rad.
const NORMAL_SIGMA: f64 = 0.03;

/// Errors beyond this are as good as any: a mode far from the truth says little about the covariance of another.
const NEES_MAX: f64 = 30.0;

fn table(settings: &TableSettings) -> Table {
    let columns = [
        "touches",
        "sigma mm",
        "normals",
        "tests",
        "NEES",
        "in the gate",
        "several modes",
        "best is true",
        "sd angle deg",
    ];
    let mut table = Table::new(columns);
    table.definitions.extend([
        "Parts of 8 cm with 5 to 10 corners, every other one with notches; each touch on a side drawn by length, with normal errors of sigma \
         in each coordinate and of 0.03 rad in normals."
            .to_owned(),
        "NEES: squared error of the mode nearest to the truth, normalised by its covariance, at most 30, where a mode is listed; 3 if \
         errors are as stated. In the gate: that mode is nearer than 30; 99 % if the gate is right and the touches are near their sides."
            .to_owned(),
    ]);
    for (touches, sigma_mm, with_normals) in ROWS {
        let cases = 0..settings.cases;
        let judged: Vec<_> =
            cases.map(|case| trial(settings.seed, case, touches, sigma_mm * 1e-3, with_normals)).collect();
        let judged: Vec<_> = judged.into_iter().flatten().collect();
        let listed = judged.iter().filter(|judged| judged.modes > 0);
        let mean = statistics::mean(listed.map(|judged| judged.nees.min(NEES_MAX))).unwrap_or(f64::NAN);
        let angles = judged.iter().filter_map(|judged| judged.sd_angle);
        let share =
            |of: fn(&Judged) -> bool| Cell::share(judged.iter().filter(|judged| of(judged)).count(), judged.len());
        table.push([
            Cell::count(touches),
            Cell::number(sigma_mm, 2),
            Cell::count(usize::from(with_normals)),
            Cell::count(judged.len()),
            Cell::number(mean, 2),
            share(|judged| judged.nees < NEES_MAX),
            share(|judged| judged.modes > 1),
            share(|judged| judged.best_is_true),
            Cell::number(statistics::median(angles).unwrap_or(f64::NAN).to_degrees(), 3),
        ]);
    }
    table
}

/// What came of one case.
struct Judged {
    /// Infinite where no mode was listed.
    nees: f64,
    modes: usize,
    best_is_true: bool,
    sd_angle: Option<f64>,
}

/// None where the touches leave the part free.
fn trial(seed: u64, case: usize, count: usize, sigma: f64, with_normals: bool) -> Option<Judged> {
    let mut draw = Draw::case(seed, case);
    let corners = 5 + draw.index(6);
    let part = if case.is_multiple_of(2) {
        draw.convex_polygon(corners, 0.04)
    } else {
        draw.star_polygon(corners, 0.025, 0.045)
    };
    let truth = Pose { x: draw.uniform(-0.3, 0.3), y: draw.uniform(-0.3, 0.3), theta: draw.uniform(0.0, TAU) };
    let touches = (0..count).map(|_| touch(&mut draw, &part, &truth, sigma, with_normals)).collect();
    let estimate = touched_poses(&part, &TouchReadings { touches, ..TouchReadings::default() });
    if estimate.loose.is_some() {
        return None;
    }
    let error = |mode: &PoseMode| nees(mode, &truth);
    let nearest = estimate.modes.iter().min_by(|a, b| error(a).total_cmp(&error(b)));
    Some(Judged {
        nees: nearest.map_or(f64::INFINITY, error),
        modes: estimate.modes.len(),
        best_is_true: nearest.is_some() && nearest == estimate.modes.first(),
        sd_angle: nearest.map(|mode| mode.covariance[(2, 2)].sqrt()),
    })
}

/// A touch of a side of the part, sides drawn by length.
fn touch(draw: &mut Draw, part: &SimplePolygon, truth: &Pose, sigma: f64, with_normal: bool) -> Touch {
    let perimeter: f64 = part.edges().map(|(start, end)| (end - start).norm()).sum();
    let mut left = draw.unit() * perimeter;
    let side = part.edges().find(|(start, end)| {
        left -= (end - start).norm();
        left <= 0.0
    });
    let (start, end) = side.or_else(|| part.edges().last()).unwrap_or_else(|| unreachable!("a polygon has sides"));
    let (start, end) = (truth.isometry() * start, truth.isometry() * end);
    let point = start + (end - start) * draw.unit() + Vector2::new(draw.normal(), draw.normal()) * sigma;
    let angle = (start.x - end.x).atan2(end.y - start.y) + NORMAL_SIGMA * draw.normal();
    Touch { point, sigma, normal: with_normal.then_some(FeltNormal { angle, sigma: NORMAL_SIGMA }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_as_stated() {
        let judged: Vec<_> = (0..150).filter_map(|case| trial(1, case, 8, 5e-5, false)).collect();
        let mean = judged.iter().map(|judged| judged.nees.min(NEES_MAX)).sum::<f64>() / judged.len() as f64;
        // Of 150 squared errors with a mean of 3 the mean has a standard deviation of 0.2.
        assert!(judged.len() > 140 && (2.3..3.8).contains(&mean), "{mean} over {}", judged.len());
    }
}
