//! What pushes with known poses teach: the constants of a set-up, and a log's own numbers.
//!
//! Both are least squares over simulated pushes, softened so that one push that slipped does not bend the others
//! ([`soft`]); derivatives are differences. Constants answer for where the part came to lie; a log's numbers also for
//! the force.
//!
//! Frames: world. Units: SI, residuals in standard deviations. Errors: none; where nothing can be simulated, what is
//! known beforehand remains.

use nalgebra::{Point2, Rotation2, SVector, Vector2};

use super::constants::{FilterSettings, SlowConstants, Spread};
use super::felt::{FeltForce, FeltPush, Onset};
use super::filter::ParameterBelief;
use super::scene::{PushParameters, SlowScene, Standing};
use crate::finger::contact::friction::{PushAlongEdge, sliding_friction};
use crate::geometry::{Pose, SimplePolygon, distance_to_segment};
use crate::math::least_squares::{Enough, LeastSquaresProblem, LeastSquaresSettings, NormalEquations, minimise};

/// A push whose poses before and after are known.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownPush {
    /// What the finger felt.
    pub felt: FeltPush,
    /// Pose of the centre of mass before.
    pub before: Pose,
    /// Pose of the centre of mass after.
    pub after: Pose,
}

/// Errors of an end pose are squared up to about this, m, and counted by their size beyond: errors have heavy tails.
const SOFT_M: f64 = 0.4e-3;

/// A turn counts as the way of a point so far from the centre of mass, m.
const TURN_AT_M: f64 = 0.05;

/// How far a log's numbers may be from the set-up's: logarithms, rad, and the tip's place in m.
const LOG_PRIOR: LogPrior =
    LogPrior { friction_log: 0.15, contrast: 0.15, contact_log: 0.12, frame: 0.01, tip: 0.3e-3 };

/// What a push's own numbers keep of their scatter when those of its log are known as well as can be.
const WITHIN_LOG: f64 = 0.85;

struct LogPrior {
    friction_log: f64,
    contrast: f64,
    contact_log: f64,
    frame: f64,
    tip: f64,
}

/// Numbers of a log: friction, two contrasts, finger, frame, tip ahead and left; in units of [`LOG_PRIOR`].
const LOG_NUMBERS: usize = 7;

/// A step of a difference, in units of the prior.
const DIFFERENCE: f64 = 0.05;

/// Square up to about 1, its size beyond: Huber's idea, smooth.
fn soft(residual: f64) -> f64 {
    residual.signum() * (2.0 * (residual.hypot(1.0) - 1.0)).sqrt()
}

/// A fit by differences.
struct Differences<const N: usize, F> {
    residuals: F,
}

struct Place<const N: usize> {
    unknowns: SVector<f64, N>,
    residuals: Vec<f64>,
}

impl<const N: usize, F: Fn(&SVector<f64, N>) -> Option<Vec<f64>>> Differences<N, F> {
    fn at(&self, unknowns: SVector<f64, N>) -> Option<Place<N>> {
        (self.residuals)(&unknowns).map(|residuals| Place { unknowns, residuals })
    }
}

impl<const N: usize, F: Fn(&SVector<f64, N>) -> Option<Vec<f64>>> LeastSquaresProblem<N> for Differences<N, F> {
    type Place = Place<N>;

    fn cost(&self, place: &Place<N>) -> f64 {
        place.residuals.iter().map(|residual| residual * residual).sum()
    }

    fn normal_equations(&self, place: &Place<N>) -> NormalEquations<N> {
        let moved: Vec<Option<Vec<f64>>> = (0..N)
            .map(|i| {
                let mut unknowns = place.unknowns;
                unknowns[i] += DIFFERENCE;
                (self.residuals)(&unknowns)
            })
            .collect();
        let mut equations = NormalEquations::zero();
        for (number, &residual) in place.residuals.iter().enumerate() {
            let slope = |i: usize| moved[i].as_ref().map_or(0.0, |moved| (moved[number] - residual) / DIFFERENCE);
            equations.add(residual, SVector::from_fn(|i, _| slope(i)));
        }
        equations
    }

    fn moved(&self, place: &Place<N>, step: &SVector<f64, N>) -> Option<Place<N>> {
        self.at(place.unknowns + step)
    }
}

/// A thousandth of the cost is enough: numbers are then known far better than they scatter.
fn settings<const N: usize>() -> LeastSquaresSettings<N> {
    LeastSquaresSettings {
        enough: Enough { relative: 1e-3, absolute: 0.0, damping_max: 10.0 },
        trials_max: 30,
        ..LeastSquaresSettings::default()
    }
}

/// Residuals of an end pose.
fn pose_residuals(found: &Pose, truth: &Pose, scale: f64) -> [f64; 3] {
    let off = found.minus(truth);
    [off.x, off.y, off.z * TURN_AT_M].map(|off| soft(off / scale))
}

/// A scene and the belief about a push's own numbers, as the earlier pushes of a log teach them.
#[must_use]
pub fn learned(scene: &SlowScene, earlier: &[KnownPush], filter: &FilterSettings) -> (SlowScene, ParameterBelief) {
    let taught = |unknowns: &SVector<f64, LOG_NUMBERS>| {
        let [friction, first, second, contact, frame, ahead, left] = (*unknowns).into();
        let middle = PushParameters {
            friction_log: LOG_PRIOR.friction_log * friction,
            contrasts: [LOG_PRIOR.contrast * first, LOG_PRIOR.contrast * second],
            contact_log: LOG_PRIOR.contact_log * contact,
            frame: LOG_PRIOR.frame * frame,
        };
        (scene.with_tip_moved(LOG_PRIOR.tip * ahead, LOG_PRIOR.tip * left), middle)
    };
    let residuals = |unknowns: &SVector<f64, LOG_NUMBERS>| {
        let (scene, middle) = taught(unknowns);
        let mut residuals: Vec<f64> = unknowns.iter().copied().collect();
        // Forces of one push go together, as in the filter.
        let weight = filter.tempering.sqrt().recip();
        for push in earlier {
            let simulated = scene.simulate(&push.felt, &push.before, &middle, filter.stride);
            residuals.extend(pose_residuals(&simulated.pose, &push.after, 2.0 * SOFT_M));
            let from = match push.felt.onset {
                Onset::At(travel) | Onset::Before(travel) => travel + filter.settle,
                Onset::Never(_) | Onset::Unknown => f64::INFINITY,
            };
            for (felt, force) in push.felt.forces.iter().zip(&simulated.forces) {
                // Of what does not count nought, so that there are always as many.
                let counts = force.filter(|_| felt.travel >= from);
                let off = counts.map_or([0.0; 2], |force| {
                    let size = (felt.force.norm() / force.norm()).ln() / filter.force_scale;
                    [size, force.perp(&felt.force).atan2(force.dot(&felt.force)) / filter.angle_scale]
                });
                residuals.extend(off.map(|off| weight * soft(off)));
            }
        }
        Some(residuals)
    };
    let problem = Differences::<LOG_NUMBERS, _> { residuals };
    let Some(begin) = problem.at(SVector::zeros()) else { return (scene.clone(), ParameterBelief::default()) };
    let found = minimise(&problem, begin, &settings(), |_| false);
    let (scene, middle) = taught(&found.place.unknowns);
    // The more pushes, the less of what the log's own numbers add is left.
    let known = earlier.len() as f64 / (earlier.len() as f64 + 5.0);
    let share = 1.0 - (1.0 - WITHIN_LOG) * known;
    let Spread { friction_log, contrast, contact_log, frame } = Spread::PUSH;
    let spread = Spread {
        friction_log: share * friction_log,
        contrast: share * contrast,
        contact_log: share * contact_log,
        frame: share * frame,
    };
    (scene, ParameterBelief { middle, spread })
}

/// The finger's friction on each edge of an outline (part frame, as is the centre of mass, m), in that of all edges: sides
/// that were made in different ways hold a finger differently. The force of pushes in which the finger slid far along an edge tells
/// it, without a model of pushing; an edge along which too few slid has 1.
#[must_use]
pub fn edge_frictions(
    outline: &SimplePolygon,
    centre_of_mass: Point2<f64>,
    logs: &[KnownLog<'_>],
    constants: &SlowConstants,
) -> Vec<f64> {
    let edges: Vec<_> = outline.edges().map(|(from, to)| [from - centre_of_mass, to - centre_of_mass]).collect();
    let pushes = || logs.iter().flat_map(|log| log.pushes).filter_map(|push| along_edge(&edges, push, constants));
    let middle = |pushes: Vec<PushAlongEdge>| sliding_friction(&pushes, 0.5).map(|found| found.mu_c.value);
    let all = middle(pushes().map(|(_, push)| push).collect());
    let of_edge = |edge: usize| {
        let own = middle(pushes().filter(|(touched, _)| *touched == edge).map(|(_, push)| push).collect());
        own.and_then(|own| Ok(own / all?)).unwrap_or(1.0)
    };
    (0..edges.len()).map(of_edge).collect()
}

/// The edge (body frame) that a push met, with the way along it to the push's end and the angles of the force: the part is
/// taken to turn evenly.
fn along_edge(
    edges: &[[Vector2<f64>; 2]],
    push: &KnownPush,
    constants: &SlowConstants,
) -> Option<(usize, PushAlongEdge)> {
    let KnownPush { felt, before, after } = push;
    let Onset::At(onset) = felt.onset else { return None };
    let end = felt.end + constants.beyond_log;
    let tip = Rotation2::new(felt.tool_yaw) * Vector2::new(constants.tip_ahead, constants.tip_left);
    let seen = |pose: &Pose, travel: f64| {
        pose.isometry().inverse_transform_point(&(felt.origin + tip + felt.direction * travel))
    };
    let (first, last) = (seen(before, onset), seen(after, end));
    let distance = |edge: usize| distance_to_segment(first, edges[edge][0].into(), edges[edge][1].into());
    let edge = (0..edges.len()).min_by(|a, b| distance(*a).total_cmp(&distance(*b)))?;
    let way = (edges[edge][1] - edges[edge][0]).normalize();
    let inward = Vector2::new(-way.y, way.x);
    let turned = after.minus(before).z;
    let angle = |force: &FeltForce| {
        let theta = before.theta + turned * ((force.travel - onset) / (end - onset));
        let force = Rotation2::new(-theta) * force.force;
        inward.perp(&force).atan2(inward.dot(&force))
    };
    let angles = felt.forces.iter().filter(|force| force.travel >= onset).map(angle).collect();
    Some((edge, PushAlongEdge { slip: way.dot(&(last - first)), angles }))
}

/// Pushes of one part on one thing it stands on.
#[derive(Clone, Copy, Debug)]
pub struct KnownLog<'a> {
    /// What it stands on.
    pub standing: &'a Standing,
    /// The pushes.
    pub pushes: &'a [KnownPush],
}

/// Numbers of a set-up that are fitted: tip ahead, tip left, height, rise of pressure, friction of the finger.
const CONSTANTS: usize = 5;

/// Their units: a step of a difference is [`DIFFERENCE`] of these.
const CONSTANT_UNITS: [f64; CONSTANTS] = [0.5e-3, 0.5e-3, 10e-3, 0.3, 0.2];

/// The constants that best explain where parts came to lie, begun at others, with the finger's friction on each edge as
/// [`edge_frictions`] has it; the plane's friction by the median of the forces.
#[must_use]
pub fn calibrated(
    outline: &SimplePolygon,
    centre_of_mass: Point2<f64>,
    mass: f64,
    logs: &[KnownLog<'_>],
    edge_frictions: &[f64],
    from: SlowConstants,
    stride: f64,
) -> SlowConstants {
    let told = |unknowns: &SVector<f64, CONSTANTS>| {
        let units = SVector::from(CONSTANT_UNITS);
        let [ahead, left, height, rise, contact]: [f64; CONSTANTS] = unknowns.component_mul(&units).into();
        SlowConstants {
            tip_ahead: from.tip_ahead + ahead,
            tip_left: from.tip_left + left,
            height: (from.height + height).max(0.0),
            pressure_rise: from.pressure_rise + rise,
            contact_friction: from.contact_friction * contact.exp(),
            ..from
        }
    };
    let scene = |standing: &Standing, constants| {
        let scene = SlowScene::new(outline, centre_of_mass, mass, standing, constants)?;
        Some(scene.with_edge_frictions(edge_frictions))
    };
    let residuals = |unknowns: &SVector<f64, CONSTANTS>| {
        let mut residuals = Vec::new();
        for log in logs {
            let scene = scene(log.standing, told(unknowns))?;
            for push in log.pushes {
                let simulated = scene.simulate(&push.felt, &push.before, &PushParameters::default(), stride);
                residuals.extend(pose_residuals(&simulated.pose, &push.after, SOFT_M));
            }
        }
        // What no push tells stays where it is.
        residuals.extend(unknowns.iter().map(|unknown| 0.1 * unknown));
        Some(residuals)
    };
    let problem = Differences::<CONSTANTS, _> { residuals };
    let Some(begin) = problem.at(SVector::zeros()) else { return from };
    let found = told(&minimise(&problem, begin, &settings(), |_| false).place.unknowns);
    let mut sizes = Vec::new();
    let mut late = Vec::new();
    for log in logs {
        let Some(scene) = scene(log.standing, found) else { continue };
        for push in log.pushes {
            let simulated = scene.simulate(&push.felt, &push.before, &PushParameters::default(), stride);
            let both = push.felt.forces.iter().zip(&simulated.forces);
            sizes.extend(both.filter_map(|(felt, force)| Some((felt.force.norm() / (*force)?.norm()).ln())));
            if let (Onset::At(felt), Some(touched)) = (push.felt.onset, simulated.touched) {
                late.push(felt - touched);
            }
        }
    }
    let middle = |values: Vec<f64>| crate::math::statistics::median(values).unwrap_or(0.0);
    SlowConstants { friction: found.friction * middle(sizes).exp(), felt_late: middle(late), ..found }
}
