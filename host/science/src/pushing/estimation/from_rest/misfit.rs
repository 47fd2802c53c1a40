//! Why no pose explains what was felt: a handful of mistakes that people make when they say what they know, each tried.
//!
//! A mistake is undone in what is known, and the pose is sought anew, as quickly as a library's parts are ([`first_look()`]).
//! The one that makes a pose fit is likely the one that was made; that several do is possible, as is none. Tried in this
//! order, up to the first kind of which one fits (units first, where the sizes told fit on no table):
//! - axes: the force has the opposite sign (that on the part instead of that on the finger), or the axes of force and
//!   motion are turned or mirrored against each other;
//! - the rise of accelerations that were told as steps, up to the shortest segment;
//! - the radius of the finger's disk: half, twice, or whatever about and between them fits best;
//! - the unit of the part file's lengths, of the motion's, or of both, as far as what then results fits on a table;
//! - µ of the plane: known far worse than was said; or the bias: it drifts during the push, by up to some tenths of the force a second.
//!
//! A part whose lengths are all `f` times what was told is the same problem as the told part with motion, radius and µ g
//! divided by `f`, with the masses changed: force per mass is an acceleration. So no other part has to be made.
//!
//! The onset is judged apart: a finger that begins to move does work on what it touches, whatever the friction, so the
//! first force on it is at more than a right angle to its acceleration.
//!
//! Frames: finger axes. Units: SI. Errors: none.

use nalgebra::{Matrix2, Point2, Vector2};

use super::felt::Felt as _;
use super::first_look::looked;
use super::fit::Problem;
use super::{BEGINNING_S, KnownFromRest, WindowedForce, course, first_look, hann_windows, limit, search, symmetry};
use crate::pushing::estimation::hypotheses::Fit;
use crate::pushing::finger_motion::{FingerMotion, Segment};
use crate::search::{Halt, Searched, Stop};

/// Of what a length was told wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lengths {
    /// The part's file.
    OfPart,
    /// The finger's motion.
    OfMotion,
    /// Both.
    OfBoth,
}

/// What may have been told wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mistake {
    /// The force has the opposite sign: that on the part, or the motion the other way.
    Reversed,
    /// The motion's axes are so many quarter turns, counter-clockwise, from the force's: 1 or 3.
    Turned {
        /// How many quarter turns.
        quarters: u8,
    },
    /// The x of one is the −x of the other.
    MirroredX,
    /// The y of one is the −y of the other.
    MirroredY,
    /// The x of one is the y of the other, or with both signs changed.
    Swapped,
    /// Accelerations that were told as steps are each reached in so many seconds.
    Rise(f64),
    /// The finger's disk has another radius, m.
    Radius(f64),
    /// Lengths are so many times what was told.
    Unit {
        /// Which.
        of: Lengths,
        /// So many times.
        factor: f64,
    },
    /// µ g of the plane is far from what was told, m/s²: where it would fit.
    Friction(f64),
    /// The bias drifts from the onset on, by so much along either axis, N/s: a gauge comes off, or a bridge warms.
    BiasDrift(Vector2<f64>),
}

/// A mistake that would explain what was felt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LikelyMistake {
    /// Which.
    pub mistake: Mistake,
    /// Least cost without it.
    pub cost: f64,
}

/// What is known of a push that nothing explains.
#[derive(Clone, Debug, PartialEq)]
pub struct Misfit {
    /// Angle between the first force on the finger and the reverse of the finger's acceleration, rad, 0 to π. Above π/2 no
    /// part does that.
    pub onset_angle: f64,
    /// Mistakes of one kind that would explain it, the likeliest first.
    pub mistakes: Vec<LikelyMistake>,
}

/// How µ g is tried where nothing else explains the push: within a factor of two and a half, as one standard deviation.
const MU_G_LOG_SD: f64 = 0.92;

/// How fast a bias is thought to drift, as a share of the force in a second: one standard deviation. Of 1 N on the default finger it
/// is 5 microstrain/s; with a third of it what drifted by a fifth a second was named with a fourth of that, and another pose.
const BIAS_DRIFT_SHARE: f64 = 0.1;

/// Rise times tried first, s: from a stiff robot that hardly limits its jerk to one that is never quite at an acceleration.
const RISES_S: [f64; 8] = [1.5e-3, 3e-3, 6e-3, 0.012, 0.025, 0.05, 0.1, 0.2];

/// Radii tried first, in shares of what was told: a diameter for a radius and the reverse, and somewhat more.
const RADII: [f64; 9] = [0.4, 0.5, 0.62, 0.78, 0.9, 1.15, 1.45, 2.0, 2.5];

/// Golden sections of the distance between two radii or rises: to some 1e-3 of it, where the force tells less.
const VALLEY_STEPS: usize = 12;

/// A cost so many times the limit may come down to it with a better radius or rise.
const NEARLY: f64 = 300.0;

/// The units in which lengths are written: m, cm, mm and inches, m.
const UNITS_M: [f64; 4] = [1.0, 1e-2, 1e-3, 0.0254];

/// Parts that a finger pushes on a table: from their centre of mass to their furthest point, m.
const REACH_M: [f64; 2] = [4e-3, 0.5];

/// How far a finger goes in a push, m.
const TRAVEL_M: [f64; 2] = [2e-3, 1.0];

/// What would explain a push that no pose explains.
#[must_use]
pub fn misfit(known: &KnownFromRest, measured: &WindowedForce, stop: Stop<'_>) -> Searched<Misfit> {
    let halt = Halt::new(stop);
    let kinds: [&dyn Fn() -> Vec<LikelyMistake>; 5] = [
        &|| fitting(axes(known), known, measured, &halt),
        &|| fitting(rises(known, measured, &halt), known, measured, &halt),
        &|| fitting(radii(known, measured, &halt), known, measured, &halt),
        &|| fitting(units(known), known, measured, &halt),
        &|| [friction(known, measured, &halt), bias_drift(known, measured, &halt)].into_iter().flatten().collect(),
    ];
    // What does not fit on a table is most likely told in the wrong unit.
    let order = if is_of_a_table(known, 1.0, 1.0) { [0, 1, 2, 3, 4] } else { [3, 0, 1, 2, 4] };
    let wanted = order.into_iter().take_while(|_| !halt.is_wished());
    let mut mistakes = wanted.map(|kind| kinds[kind]()).find(|mistakes| !mistakes.is_empty()).unwrap_or_default();
    mistakes.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    halt.searched(Misfit { onset_angle: onset_angle(known, measured), mistakes })
}

/// What is known, were a mistake not made.
struct Tried {
    mistake: Mistake,
    motion: FingerMotion,
    radius: f64,
    mu_g: f64,
}

/// Those of one kind that fit.
fn fitting(tried: Vec<Tried>, known: &KnownFromRest, measured: &WindowedForce, halt: &Halt<'_>) -> Vec<LikelyMistake> {
    let fit = |tried: Tried| {
        let Fit { cost, cost_max, .. } = tried.fit(known, measured);
        let cost = cost.filter(|cost| *cost <= cost_max)?;
        Some(LikelyMistake { mistake: tried.mistake, cost })
    };
    halt.each(tried, fit).into_iter().flatten().collect()
}

impl Tried {
    fn new(mistake: Mistake, known: &KnownFromRest, motion: FingerMotion) -> Self {
        Self { mistake, motion, radius: known.radius, mu_g: known.mu_g }
    }

    /// How far the best pose is from explaining it.
    fn fit(&self, known: &KnownFromRest, measured: &WindowedForce) -> Fit {
        let Self { radius, mu_g, .. } = *self;
        first_look(&KnownFromRest { mu_g, radius, shape: None, motion: &self.motion, ..*known }, measured)
    }
}

/// Angle between the first force on the finger and the reverse of its acceleration.
fn onset_angle(known: &KnownFromRest, measured: &WindowedForce) -> f64 {
    let first = measured.first();
    (-known.motion.first_acceleration()).angle(&first)
}

/// A motion with every acceleration changed.
fn changed(motion: &FingerMotion, by: &Matrix2<f64>) -> Option<FingerMotion> {
    let segments = motion.segments().iter();
    let segments: Vec<_> = segments
        .map(|&Segment { seconds, acceleration }| Segment { seconds, acceleration: by * acceleration })
        .collect();
    FingerMotion::new(Point2::origin(), &segments).ok()
}

fn axes(known: &KnownFromRest) -> Vec<Tried> {
    let tried = [
        (Mistake::Reversed, [-1.0, 0.0, 0.0, -1.0]),
        (Mistake::Turned { quarters: 1 }, [0.0, -1.0, 1.0, 0.0]),
        (Mistake::Turned { quarters: 3 }, [0.0, 1.0, -1.0, 0.0]),
        (Mistake::MirroredX, [-1.0, 0.0, 0.0, 1.0]),
        (Mistake::MirroredY, [1.0, 0.0, 0.0, -1.0]),
        (Mistake::Swapped, [0.0, 1.0, 1.0, 0.0]),
        (Mistake::Swapped, [0.0, -1.0, -1.0, 0.0]),
    ];
    let motion = |by: [f64; 4]| changed(known.motion, &Matrix2::from_row_slice(&by));
    tried.into_iter().filter_map(|(mistake, by)| Some(Tried::new(mistake, known, motion(by)?))).collect()
}

/// The rise of every acceleration that fits best, if one may.
fn rises(known: &KnownFromRest, measured: &WindowedForce, halt: &Halt<'_>) -> Vec<Tried> {
    let at = |rise: f64| Some(Tried::new(Mistake::Rise(rise), known, known.motion.with_rise(rise)?));
    valley(&RISES_S, at, known, measured, halt).into_iter().collect()
}

/// The radius that fits best, if one may.
fn radii(known: &KnownFromRest, measured: &WindowedForce, halt: &Halt<'_>) -> Vec<Tried> {
    let at = |radius: f64| Some(Tried { radius, ..Tried::new(Mistake::Radius(radius), known, known.motion.clone()) });
    valley(&RADII.map(|share| share * known.radius), at, known, measured, halt).into_iter().collect()
}

/// The value of a number that fits best, if one may: the valley's floor between the values tried, which increase.
fn valley(
    values: &[f64],
    at: impl Fn(f64) -> Option<Tried> + Sync,
    known: &KnownFromRest,
    measured: &WindowedForce,
    halt: &Halt<'_>,
) -> Option<Tried> {
    // In shares of the most that noise leaves: what is far has a cost of the beginning alone.
    let cost = |value: f64| {
        let Fit { cost, cost_max, .. } = at(value)?.fit(known, measured);
        cost.map(|cost| cost / cost_max)
    };
    let cost = |value: f64| cost(value).unwrap_or(f64::INFINITY);
    let cost_of = |value: f64| if halt.is_wished() { f64::INFINITY } else { cost(value) };
    let costs = halt.every(values.to_vec(), cost_of);
    let best = (0..values.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b]))?;
    if costs[best] > NEARLY {
        return None;
    }
    let (mut low, mut high) = (values[best.saturating_sub(1)], values[(best + 1).min(values.len() - 1)]);
    let (mut middle, mut least) = (values[best], costs[best]);
    for _ in 0..VALLEY_STEPS {
        if halt.is_wished() {
            break;
        }
        // Into the wider side, by the golden section.
        let below = middle - low > high - middle;
        let next = if below { middle - GOLDEN * (middle - low) } else { middle + GOLDEN * (high - middle) };
        let found = cost(next);
        match (found < least, below) {
            (true, true) => (high, middle, least) = (middle, next, found),
            (true, false) => (low, middle, least) = (middle, next, found),
            (false, true) => low = next,
            (false, false) => high = next,
        }
    }
    at(middle)
}

/// (3 − √5)/2.
const GOLDEN: f64 = 0.381_966;

fn units(known: &KnownFromRest) -> Vec<Tried> {
    let mut tried = Vec::new();
    for (of, factor) in [Lengths::OfPart, Lengths::OfMotion, Lengths::OfBoth]
        .into_iter()
        .flat_map(|of| factors().map(move |factor| (of, factor)))
    {
        let part = if of == Lengths::OfMotion { 1.0 } else { factor };
        let moved = if of == Lengths::OfPart { 1.0 } else { factor };
        if !is_of_a_table(known, part, moved) {
            continue;
        }
        // In lengths of the part as it was told.
        let Some(motion) = changed(known.motion, &(Matrix2::identity() * (moved / part))) else { continue };
        let mistake = Mistake::Unit { of, factor };
        let (radius, mu_g) = (known.radius / part, known.mu_g / part);
        tried.push(Tried { radius, mu_g, ..Tried::new(mistake, known, motion) });
    }
    tried
}

/// Whether a part so many times as large, and a motion so many times as long, fit on a table.
fn is_of_a_table(known: &KnownFromRest, part: f64, motion: f64) -> bool {
    let centre = known.part.centre_of_mass();
    let reach = known.part.polygon().vertices().iter().map(|vertex| (vertex - centre).norm()).fold(0.0, f64::max);
    let fits = |value: f64, [least, most]: [f64; 2]| (least..=most).contains(&value);
    fits(part * reach, REACH_M) && fits(motion * travel(known.motion), TRAVEL_M)
}

/// What one unit is in another, without 1.
fn factors() -> impl Iterator<Item = f64> {
    let pairs = UNITS_M.into_iter().flat_map(|from| UNITS_M.into_iter().map(move |to| to / from));
    pairs.filter(|factor| (factor - 1.0).abs() > 1e-9)
}

/// How far the finger goes from where it began, at most at the end of a segment, m.
fn travel(motion: &FingerMotion) -> f64 {
    let (mut velocity, mut place, mut most) = (Vector2::zeros(), Vector2::zeros(), 0.0_f64);
    for Segment { seconds, acceleration } in motion.segments() {
        place += velocity * *seconds + acceleration * (0.5 * seconds * seconds);
        velocity += acceleration * *seconds;
        most = most.max(place.norm());
    }
    most
}

/// µ g of the plane at which the best pose fits, if one does, however far from what was told.
fn friction(known: &KnownFromRest, measured: &WindowedForce, halt: &Halt<'_>) -> Option<LikelyMistake> {
    let known = KnownFromRest { mu_g_log_sd: Some(MU_G_LOG_SD), ..*known };
    let beginning = measured.beginning_of(hann_windows::count(BEGINNING_S));
    // What does not explain the beginning does not explain the whole.
    let begins = beginning.span() == measured.span() || friction_of(&known, &beginning, halt).is_some();
    begins.then(|| friction_of(&known, measured, halt)).flatten()
}

/// The drift of the bias at which the best pose fits, if one does.
fn bias_drift(known: &KnownFromRest, measured: &WindowedForce, halt: &Halt<'_>) -> Option<LikelyMistake> {
    if halt.is_wished() {
        return None;
    }
    let sd = BIAS_DRIFT_SHARE * measured.rms();
    let (fit, best) = looked(known, &measured.and_bias_drift(sd));
    let best = best.filter(|best| best.cost <= fit.cost_max)?;
    // At the best of all, that of each is what it adds times what is left.
    let [.., x, y] = &best.predicted.beside[..] else { return None };
    let drift = Vector2::new(x.dot(best.rest()), y.dot(best.rest())) * sd;
    Some(LikelyMistake { mistake: Mistake::BiasDrift(drift), cost: best.cost })
}

/// The same where it is known that badly.
fn friction_of(known: &KnownFromRest, measured: &WindowedForce, halt: &Halt<'_>) -> Option<LikelyMistake> {
    let edges = symmetry::distinct(known.part, symmetry::order(known.part));
    let measured = &measured.of_contact(known.motion, known.finger);
    let course = course(known, measured);
    let tried = search(&Problem { course: &course, measured, mass: None }, &edges, halt);
    let best =
        tried.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).filter(|best| best.cost <= limit(measured))?;
    Some(LikelyMistake { mistake: Mistake::Friction(course.mu_g_of(&best.guess)), cost: best.cost })
}

#[cfg(test)]
mod tests {
    use super::super::CarriedFinger;
    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::gravity::GRAVITY_ASSUMED;
    use crate::pushing::dynamics::Part;
    use crate::pushing::estimation::Status;
    use crate::pushing::estimation::from_rest::{Uncertainty, estimate};
    use crate::pushing::pushed_world::PushedWorld;
    use crate::search::never;

    /// Noise of a window's mean, N: that of the default finger.
    const NOISE_N: f64 = 1e-3;

    const RADIUS_M: f64 = 0.015;

    /// Without symmetry, so that a mirrored motion is another push.
    fn part() -> Part {
        let vertices = [[0.0, 0.0], [0.09, 0.0], [0.1, 0.04], [0.055, 0.075], [0.01, 0.045]];
        Part::uniform(SimplePolygon::new(vertices.map(Point2::from).to_vec()).unwrap())
    }

    fn motion() -> FingerMotion {
        let segments = [(0.25, [0.15, 0.0]), (0.25, [0.0, 0.15])];
        let segments = segments.map(|(seconds, a)| Segment { seconds, acceleration: Vector2::from(a) });
        FingerMotion::new(Point2::origin(), &segments).unwrap()
    }

    /// A push of the part, as a finger feels it.
    fn felt(part: &Part, motion: &FingerMotion) -> WindowedForce {
        felt_of(part, motion, |_| Vector2::zeros())
    }

    /// The same, of a finger whose bias goes so with time.
    fn felt_of(part: &Part, motion: &FingerMotion, bias: impl Fn(f64) -> Vector2<f64>) -> WindowedForce {
        let mu_g = 0.25 * GRAVITY_ASSUMED;
        let world =
            PushedWorld { part, mu_g, mass: 0.5, mu_c: 0.25, radius: RADIUS_M, motion, edge: 3, u: 0.3, s: -0.004 };
        let played = world.play().unwrap();
        // By the trapezium rule: where the acceleration changes there are two samples at one time.
        let mean = |window: usize| {
            let (mut sum, mut total) = (Vector2::zeros(), 0.0);
            for (samples, forces) in played.samples.windows(2).zip(played.forces_finger.windows(2)) {
                for (sample, force) in samples.iter().zip(forces) {
                    let weight = 0.5 * (samples[1].t - samples[0].t) * hann_windows::weight(window, sample.t);
                    sum += (force + bias(sample.t)) * weight;
                    total += weight;
                }
            }
            sum / total
        };
        let noise = Matrix2::identity() * NOISE_N * NOISE_N;
        let uncertainty = Uncertainty {
            noise,
            noise_freedom: f64::INFINITY,
            bias: Matrix2::zeros(),
            drift_sd: Vector2::zeros(),
            drift_before: 0.0,
            calibration: None,
            onset_sd: 3e-4,
            model_share: CarriedFinger::RIGID.model_share(),
        };
        WindowedForce::new((0..hann_windows::count(motion.duration())).map(mean).collect(), &uncertainty).unwrap()
    }

    /// What is found to be wrong where this is what was told.
    fn found(told: &KnownFromRest, measured: &WindowedForce) -> Misfit {
        assert_eq!(estimate(told, measured).status(), Status::Unexplained, "it fits all the same");
        misfit(told, measured, &never).found
    }

    fn told<'a>(part: &'a Part, motion: &'a FingerMotion) -> KnownFromRest<'a> {
        let (mu_g, finger) = (0.25 * GRAVITY_ASSUMED, CarriedFinger::RIGID);
        KnownFromRest {
            part,
            errors: None,
            mu_g,
            mu_g_log_sd: Some(0.2),
            radius: RADIUS_M,
            shape: None,
            finger,
            motion,
        }
    }

    #[test]
    fn a_force_with_the_wrong_sign_is_named_and_its_onset_is_impossible() {
        let (part, motion) = (part(), motion());
        let measured = felt(&part, &motion);
        let reversed = changed(&motion, &-Matrix2::identity()).unwrap();
        let Misfit { onset_angle, mistakes } = found(&told(&part, &reversed), &measured);
        assert!(onset_angle > std::f64::consts::FRAC_PI_2, "{onset_angle}");
        assert_eq!(mistakes.first().map(|likely| likely.mistake), Some(Mistake::Reversed), "{mistakes:?}");
        // As it should be, it is not.
        assert!(super::onset_angle(&told(&part, &motion), &measured) < std::f64::consts::FRAC_PI_2);
    }

    #[test]
    fn a_motion_along_the_wrong_axis_is_named() {
        let (part, motion) = (part(), motion());
        let measured = felt(&part, &motion);
        let turned = changed(&motion, &Matrix2::new(0.0, 1.0, -1.0, 0.0)).unwrap();
        let mistakes = found(&told(&part, &turned), &measured).mistakes;
        assert_eq!(mistakes[0].mistake, Mistake::Turned { quarters: 1 }, "{mistakes:?}");
    }

    /// Ramps of 20 ms, told as steps.
    #[test]
    fn accelerations_that_rise_are_named_with_how_long_they_do() {
        /// Of 20 ms, s: what is told is tried again by whoever reads it, with what the robot's own numbers say.
        const NEAR_S: f64 = 2e-3;
        let (part, motion) = (part(), motion());
        let risen = motion.with_rise(0.02).unwrap();
        let measured = felt(&part, &risen);
        let mistakes = found(&told(&part, &motion), &measured).mistakes;
        let Mistake::Rise(rise) = mistakes[0].mistake else { panic!("{mistakes:?}") };
        assert!((rise - 0.02).abs() < NEAR_S, "{rise}");
        assert_ne!(estimate(&told(&part, &risen), &measured).status(), Status::Unexplained);
        assert!(motion.with_rise(0.3).is_none());
    }

    #[test]
    fn a_wrong_radius_is_named_with_the_one_that_fits() {
        let (part, motion) = (part(), motion());
        let measured = felt(&part, &motion);
        let mistakes = found(&KnownFromRest { radius: 0.004, shape: None, ..told(&part, &motion) }, &measured).mistakes;
        let Mistake::Radius(radius) = mistakes[0].mistake else { panic!("{mistakes:?}") };
        // A force tells little of the disk's size: one nearer to the truth is enough.
        assert!(radius > 0.006, "{radius}");
        assert_ne!(
            estimate(&KnownFromRest { radius, shape: None, ..told(&part, &motion) }, &measured).status(),
            Status::Unexplained
        );
    }

    /// A tenth and more of the force in a second.
    #[test]
    fn a_bias_that_drifts_is_named_with_how_fast() {
        /// Of the drift: a prior of [`BIAS_DRIFT_SHARE`] holds it back by less, and a pose a little off takes some.
        const NEAR_SHARE: f64 = 0.05;
        let (part, motion) = (part(), motion());
        for drift in [Vector2::new(-0.048, 0.064), Vector2::new(0.085, 0.085)] {
            let measured = felt_of(&part, &motion, |t| drift * t);
            let mistakes = found(&told(&part, &motion), &measured).mistakes;
            let Mistake::BiasDrift(named) = mistakes[0].mistake else { panic!("{mistakes:?}") };
            assert!((named - drift).norm() < NEAR_SHARE * drift.norm(), "{named}");
        }
    }

    #[test]
    fn lengths_in_the_wrong_unit_are_named_with_the_factor() {
        let (part, motion) = (part(), motion());
        let measured = felt(&part, &motion);
        let inches: Vec<_> = part.polygon().vertices().iter().map(|vertex| vertex * 25.4).collect();
        let large = Part::uniform(SimplePolygon::new(inches).unwrap());
        let mistakes = found(&told(&large, &motion), &measured).mistakes;
        let Mistake::Unit { of: Lengths::OfPart, factor } = mistakes[0].mistake else { panic!("{mistakes:?}") };
        assert!((factor * 25.4 - 1.0).abs() < 1e-9, "{factor}");
        let inches = changed(&motion, &(Matrix2::identity() / 25.4)).unwrap();
        let told = told(&part, &inches);
        let mistakes = found(&told, &measured).mistakes;
        let Mistake::Unit { of: Lengths::OfMotion, factor } = mistakes[0].mistake else { panic!("{mistakes:?}") };
        assert!((factor / 25.4 - 1.0).abs() < 1e-9, "{factor}");
    }
}
