//! Why no pose explains what was felt: a handful of mistakes that people make when they say what they know, each tried.
//!
//! A mistake is undone in what is known, and the pose is sought anew. The one that makes a pose fit is likely the one that
//! was made; that several do is possible, as is none. Tried in this order, up to the first kind of which one fits (units
//! first, where the sizes told fit on no table):
//! - axes: the force has the opposite sign (that on the part instead of that on the finger), or the axes of force and
//!   motion are turned or mirrored against each other;
//! - the radius of the finger's disk: half, twice, or whatever between fits best;
//! - the unit of the part file's lengths, of the motion's, or of both, as far as what then results fits on a table;
//! - µ of the plane: known far worse than was said.
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
use super::fit::Problem;
use super::{Cover, KnownFromRest, WindowedForce, course, descend_all, misfit_limit, starts, symmetry};
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

/// Radii tried first, in shares of what was told: a diameter for a radius and the reverse are its ends.
const RADII: [f64; 7] = [0.5, 0.62, 0.78, 0.9, 1.15, 1.45, 2.0];

/// Halvings of the distance between two radii: to some 1e-4 of it, where the force tells less.
const RADIUS_STEPS: usize = 12;

/// A cost so many times the limit may come down to it with a better radius, or a finer search.
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
    let kinds: [&dyn Fn() -> Vec<Tried>; 4] =
        [&|| axes(known), &|| radii(known, measured, &halt), &|| units(known), &|| friction(known)];
    // What does not fit on a table is most likely told in the wrong unit, and takes long to search.
    let order = if is_of_a_table(known, 1.0, 1.0) { [0, 1, 2, 3] } else { [2, 0, 1, 3] };
    let mut mistakes = Vec::new();
    for kind in order.map(|kind| kinds[kind]) {
        mistakes = fitting(kind(), known, measured, &halt);
        if !mistakes.is_empty() || halt.is_wished() {
            break;
        }
    }
    halt.searched(Misfit { onset_angle: onset_angle(known, measured), mistakes })
}

/// What is known, were a mistake not made.
struct Tried {
    mistake: Mistake,
    motion: FingerMotion,
    radius: f64,
    mu_g: f64,
    mu_g_log_sd: Option<f64>,
}

/// Those of one kind that fit, the best first.
fn fitting(tried: Vec<Tried>, known: &KnownFromRest, measured: &WindowedForce, halt: &Halt<'_>) -> Vec<LikelyMistake> {
    let limit = limit(measured);
    let costs = tried.into_iter().take_while(|_| !halt.is_wished()).filter_map(|tried| {
        let mistake = tried.mistake;
        let (cost, mu_g) = tried.least_cost(known, measured, halt)?;
        let mistake = if let Mistake::Friction(_) = mistake { Mistake::Friction(mu_g) } else { mistake };
        (cost <= limit).then_some(LikelyMistake { mistake, cost })
    });
    let mut likely: Vec<_> = costs.collect();
    likely.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    likely
}

fn limit(measured: &WindowedForce) -> f64 {
    misfit_limit(measured.data().len(), measured.freedom())
}

impl Tried {
    fn new(mistake: Mistake, known: &KnownFromRest, motion: FingerMotion) -> Self {
        let KnownFromRest { radius, mu_g, mu_g_log_sd, .. } = *known;
        Self { mistake, motion, radius, mu_g, mu_g_log_sd }
    }

    /// Least cost of any pose, and µ g there.
    fn least_cost(&self, known: &KnownFromRest, measured: &WindowedForce, halt: &Halt<'_>) -> Option<(f64, f64)> {
        let Self { radius, mu_g, mu_g_log_sd, .. } = *self;
        let known = KnownFromRest { mu_g, mu_g_log_sd, radius, shape: None, motion: &self.motion, ..*known };
        let measured = &measured.of_contact(known.motion, known.finger);
        let course = course(&known, measured);
        let problem = Problem { course: &course, measured, mass: None };
        let tried = search(&problem, halt);
        let best = tried.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        Some((best.cost, course.mu_g_of(&best.guess)))
    }
}

/// Minima of all distinct edges.
fn search(problem: &Problem, halt: &Halt<'_>) -> Vec<super::Tried> {
    let part = problem.course.part;
    let edges = symmetry::distinct(part, symmetry::order(part));
    let course = problem.course.coarse();
    let starts = starts(&Problem { course: &course, ..*problem }, &edges, Cover::Dense, halt);
    descend_all(problem, starts, halt)
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

/// The radius that fits best, if one may: the valley's floor between the radii tried.
fn radii(known: &KnownFromRest, measured: &WindowedForce, halt: &Halt<'_>) -> Vec<Tried> {
    let at = |radius: f64| Tried { radius, ..Tried::new(Mistake::Radius(radius), known, known.motion.clone()) };
    let cost = |radius: f64| {
        let found = at(radius).least_cost(known, measured, halt);
        found.map_or(f64::INFINITY, |(cost, _)| cost)
    };
    let costs = RADII.map(|share| if halt.is_wished() { f64::INFINITY } else { cost(share * known.radius) });
    let Some(best) = (0..RADII.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])) else { return Vec::new() };
    if costs[best] > NEARLY * limit(measured) {
        return Vec::new();
    }
    let share = |index: usize| RADII[index] * known.radius;
    let (mut low, mut high) = (share(best.saturating_sub(1)), share((best + 1).min(RADII.len() - 1)));
    let (mut middle, mut least) = (share(best), costs[best]);
    for _ in 0..RADIUS_STEPS {
        if least <= limit(measured) || halt.is_wished() {
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
    vec![at(middle)]
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

fn friction(known: &KnownFromRest) -> Vec<Tried> {
    let one = Tried::new(Mistake::Friction(known.mu_g), known, known.motion.clone());
    vec![Tried { mu_g_log_sd: Some(MU_G_LOG_SD), ..one }]
}

#[cfg(test)]
mod tests {
    use super::super::CarriedFinger;
    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::gravity::GRAVITY_ASSUMED;
    use crate::pushing::dynamics::Part;
    use crate::pushing::estimation::Status;
    use crate::pushing::estimation::from_rest::{Uncertainty, estimate, hann_windows};
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
                    sum += force * weight;
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
            calibration: None,
            onset_sd: 3e-4,
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
        // As coarsely as mistakes are tried: a finger that hardly moves keeps the whole search busy for twenty seconds.
        let as_told = Tried::new(Mistake::Radius(RADIUS_M), &told, inches.clone());
        let (cost, _) = as_told.least_cost(&told, &measured, &Halt::new(&never)).unwrap();
        assert!(cost > 10.0 * limit(&measured), "it fits all the same: {cost}");
        let mistakes = misfit(&told, &measured, &never).found.mistakes;
        let Mistake::Unit { of: Lengths::OfMotion, factor } = mistakes[0].mistake else { panic!("{mistakes:?}") };
        assert!((factor / 25.4 - 1.0).abs() < 1e-9, "{factor}");
    }
}
