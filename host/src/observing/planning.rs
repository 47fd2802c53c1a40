//! Which motion of the finger tells best apart the poses that are still possible.
//!
//! Straight pushes often leave several poses that predict the same contacts: edges of nearly equal height turn alike.
//! Another motion of the finger makes them differ. For each motion on offer every hypothesis is pushed ahead, with its
//! derivatives by the state that the data so far left uncertain, and each pair is compared:
//!
//! ```text
//! D² = rᵀ (σ² 1 + J_a P_a J_aᵀ + J_b P_b J_bᵀ)⁻¹ r     r: difference of the predicted angles
//! ```
//!
//! with P the covariance of a hypothesis's present state and J the derivatives of its prediction. A wrong choice between
//! the two then has the probability Q(D/2). The best motion is the one with the least probability of naming the wrong
//! hypothesis, bounded by the sum over all pairs. Pairs that no motion separates (a symmetric part) add the same to every
//! motion, so they do not hide what can be told.
//!
//! Assumes: predictions are linear in what is uncertain; one angle is felt, that of the contact or of the force; it is compared as long as both
//! hypotheses keep the contact, so losing it is never taken as evidence. Frames: world. Units: SI, rad. Errors: none; a
//! motion that a hypothesis does not survive counts as telling nothing.

use nalgebra::{DMatrix, DVector, Matrix4};

use crate::pushing::{ContactLaw, EdgeEnd, Finger, Part, Push, PushModel, Run, Sample, Start, State};
use crate::statistics::normal_tail;

/// Distance D² of two hypotheses below which they count as ambiguous: a wrong choice in one case of 740.
pub const AMBIGUOUS_BELOW: f64 = 36.0;

/// Steps of the central differences, in units of the state: far above rounding, far below what bends the prediction.
const DIFFERENCE_STEPS: [f64; 4] = [1e-5, 1e-6, 1e-4, 1e-5];

/// What the finger feels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Felt {
    /// Where it is touched.
    ContactAngle,
    /// The direction of the force, which is that of the contact only without friction.
    ForceDirection,
}

/// How it is felt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// The angle that is compared.
    pub felt: Felt,
    /// Time between values, s.
    pub dt: f64,
    /// Standard deviation of one, rad.
    pub sigma: f64,
}

/// The push as it is now.
#[derive(Clone, Copy, Debug)]
pub struct Present<'p> {
    /// The part.
    pub part: &'p Part,
    /// µ g, m/s².
    pub grip: f64,
    /// Radius of the disk, m.
    pub radius: f64,
    /// Centre of the disk, world axes, m.
    pub centre: [f64; 2],
    /// Velocity of the disk, world axes, m/s.
    pub velocity: [f64; 2],
}

/// A pose and motion that is still possible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belief {
    /// The edge in contact.
    pub edge: usize,
    /// How it touches.
    pub law: ContactLaw,
    /// Where it is and how it moves.
    pub state: State,
    /// Of u, s, ω, v_T; a row of zeros for what is known or follows from the others.
    pub covariance: Matrix4<f64>,
    /// Between 0 and 1.
    pub probability: f64,
}

/// What to expect of one motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Prospect {
    /// The finger's acceleration, world axes, m/s².
    pub acceleration: [f64; 2],
    /// Bound of the probability of naming the wrong hypothesis afterwards.
    pub risk: f64,
    /// D² of each pair of hypotheses, first index below second.
    pub pairs: Vec<Pair>,
    /// How long each hypothesis keeps the contact, s; the horizon at most.
    pub contact_s: Vec<f64>,
}

/// How far two hypotheses come apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Their places in the list.
    pub hypotheses: [usize; 2],
    /// D², with respect to noise and what is uncertain of both.
    pub distance_squared: f64,
    /// How long both keep the contact, s.
    pub shared_s: f64,
}

impl Prospect {
    /// The pair that comes apart least; none if there are fewer than two hypotheses.
    #[must_use]
    pub fn nearest(&self) -> Option<&Pair> {
        self.pairs.iter().min_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared))
    }

    /// Pairs that stay ambiguous.
    pub fn ambiguous(&self) -> impl Iterator<Item = &Pair> {
        self.pairs.iter().filter(|pair| pair.distance_squared < AMBIGUOUS_BELOW)
    }
}

/// The motions that a finger under way can be asked for: straight on, to either side, ahead, back and between.
///
/// `ahead` is where the finger goes, of any length above 0; `acceleration` is in m/s².
#[must_use]
pub fn motions(ahead: [f64; 2], acceleration: f64) -> Vec<[f64; 2]> {
    let length = ahead[0].hypot(ahead[1]);
    let [x, y] = ahead.map(|component| component / length * acceleration);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let straight = [0.0, 0.0];
    let (left, right) = ([-y, x], [y, -x]);
    let between = |side: [f64; 2]| [half * (x + side[0]), half * (y + side[1])];
    vec![straight, left, right, [x, y], between(left), between(right)]
}

/// What to call [`motions`], in their order.
pub const MOTION_NAMES: [&str; 6] =
    ["straight on", "to the left", "to the right", "faster ahead", "ahead and left", "ahead and right"];

/// The greatest speed (m/s) that a finger reaches with an acceleration (m/s²) in so many seconds.
#[must_use]
pub fn top_speed(velocity: [f64; 2], acceleration: [f64; 2], seconds: f64) -> f64 {
    // Speed squared is a parabola that opens upwards: greatest at an end.
    let after = [0, 1].map(|axis| velocity[axis] + acceleration[axis] * seconds);
    velocity[0].hypot(velocity[1]).max(after[0].hypot(after[1]))
}

/// Pairs of hypotheses that stay ambiguous whatever the motion.
#[must_use]
pub fn inseparable(prospects: &[Prospect]) -> Vec<[usize; 2]> {
    let Some((first, others)) = prospects.split_first() else { return Vec::new() };
    let stays = |pair: &&Pair| others.iter().all(|other| other.ambiguous().any(|p| p.hypotheses == pair.hypotheses));
    first.ambiguous().filter(stays).map(|pair| pair.hypotheses).collect()
}

/// What each motion would tell within `horizon` (s), the best first.
#[must_use]
pub fn prospects(
    present: &Present<'_>,
    beliefs: &[Belief],
    accelerations: &[[f64; 2]],
    sampling: Sampling,
    horizon: f64,
) -> Vec<Prospect> {
    let times = times(sampling.dt, horizon);
    let prospect = |&acceleration: &[f64; 2]| {
        let foreseen: Vec<_> =
            beliefs.iter().map(|belief| Foreseen::of(present, belief, acceleration, (&times, sampling.felt))).collect();
        judge(acceleration, beliefs, &foreseen, sampling)
    };
    let mut prospects: Vec<_> = accelerations.iter().map(prospect).collect();
    prospects.sort_by(|a, b| a.risk.total_cmp(&b.risk));
    prospects
}

/// dt, 2 dt, … up to the horizon, at least one.
fn times(dt: f64, horizon: f64) -> Vec<f64> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of samples, at least 1")]
    let count = (horizon / dt).round().max(1.0) as u32;
    (1..=count).map(|step| f64::from(step) * dt).collect()
}

/// Angles that a hypothesis predicts, and how they depend on what is uncertain of it.
struct Foreseen {
    angles: Vec<f64>,
    /// J P^½: one column a direction of uncertainty, scaled to one standard deviation.
    spread: DMatrix<f64>,
}

impl Foreseen {
    fn of(present: &Present<'_>, belief: &Belief, acceleration: [f64; 2], when: (&[f64], Felt)) -> Self {
        let angles = |state: State| angles(present, belief, state, acceleration, when);
        let nominal = angles(belief.state);
        let root = root(&belief.covariance);
        let columns = root.column_iter().filter(|column| column.norm() > 0.0).map(|column| {
            // One standard deviation along this direction may be far: a small step has the derivative.
            let step = step_along(&column);
            let moved = |sign: f64| angles(shifted(belief.state, &(column * (sign * step))));
            slope(&moved(1.0), &moved(-1.0), 2.0 * step)
        });
        let columns: Vec<Vec<f64>> = columns.collect();
        let kept = columns.iter().map(Vec::len).chain([nominal.len()]).min().unwrap_or(0);
        let spread = DMatrix::from_fn(kept, columns.len(), |row, column| columns[column][row]);
        Self { angles: nominal[..kept].to_vec(), spread }
    }
}

/// A matrix whose columns are the principal directions of a covariance, one standard deviation long.
fn root(covariance: &Matrix4<f64>) -> Matrix4<f64> {
    // Units differ by orders of magnitude: scaled to unit variances first, so that none is lost to rounding.
    let scales = covariance.diagonal().map(|variance| variance.max(0.0).sqrt());
    let inverse = scales.map(|scale| if scale > 0.0 { 1.0 / scale } else { 0.0 });
    let scaled = Matrix4::from_diagonal(&inverse) * covariance * Matrix4::from_diagonal(&inverse);
    let eigen = scaled.symmetric_eigen();
    let lengths = eigen.eigenvalues.map(|value| value.max(0.0).sqrt());
    Matrix4::from_diagonal(&scales) * eigen.eigenvectors * Matrix4::from_diagonal(&lengths)
}

/// The share of a direction that moves no component by more than its [`DIFFERENCE_STEPS`].
fn step_along(direction: &nalgebra::VectorView4<'_, f64>) -> f64 {
    let shares = direction.iter().zip(DIFFERENCE_STEPS).map(|(&component, step)| step / component.abs());
    shares.fold(f64::INFINITY, f64::min).min(1.0)
}

fn shifted(state: State, by: &nalgebra::Vector4<f64>) -> State {
    State { u: state.u + by[0], s: state.s + by[1], omega: state.omega + by[2], v_t: state.v_t + by[3] }
}

fn slope(upper: &[f64], lower: &[f64], distance: f64) -> Vec<f64> {
    upper.iter().zip(lower).map(|(upper, lower)| (upper - lower) / distance).collect()
}

/// What is felt at `times`, as long as the contact lasts; nothing where such a push is impossible.
fn angles(
    present: &Present<'_>,
    belief: &Belief,
    state: State,
    acceleration: [f64; 2],
    (times, felt): (&[f64], Felt),
) -> Vec<f64> {
    let run = run(present, belief, state, acceleration, times);
    run.map(|run| run.samples.iter().map_while(|sample| angle(sample, felt)).collect()).unwrap_or_default()
}

/// World angle of the contact or of the force on the part, rad; none where the part jams.
fn angle(sample: &Sample, felt: Felt) -> Option<f64> {
    match felt {
        Felt::ContactAngle => Some(sample.state.u),
        // The tangential force is counted along the edge, clockwise about the disk.
        Felt::ForceDirection => sample.force.map(|force| sample.state.u - force.tangential.atan2(force.normal)),
    }
}

fn run(present: &Present<'_>, belief: &Belief, state: State, acceleration: [f64; 2], times: &[f64]) -> Option<Run> {
    let Present { part, grip, radius, centre, velocity } = *present;
    let finger = Finger { radius, centre0: centre, velocity0: velocity, acceleration };
    let model = PushModel { part, edge: part.edge(belief.edge).ok()?, grip, finger };
    let push = Push::new(model, belief.law, Start::Moving(state), EdgeEnd::Stop).ok()?;
    push.run(times).ok()
}

fn judge(acceleration: [f64; 2], beliefs: &[Belief], foreseen: &[Foreseen], sampling: Sampling) -> Prospect {
    let mut pairs = Vec::new();
    let mut risk = 0.0;
    for first in 0..beliefs.len() {
        for second in first + 1..beliefs.len() {
            let (distance_squared, shared) = distance_squared(&foreseen[first], &foreseen[second], sampling.sigma);
            // Whichever of the two is true, the other is named with Q(D/2).
            risk +=
                (beliefs[first].probability + beliefs[second].probability) * normal_tail(0.5 * distance_squared.sqrt());
            let shared_s = span(shared, sampling);
            pairs.push(Pair { hypotheses: [first, second], distance_squared, shared_s });
        }
    }
    let contact_s = foreseen.iter().map(|foreseen| span(foreseen.angles.len(), sampling)).collect();
    Prospect { acceleration, risk: risk.min(1.0), pairs, contact_s }
}

/// How long so many values take, s.
fn span(values: usize, sampling: Sampling) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a count of samples")]
    let values = values as f64;
    values * sampling.dt
}

/// D² of two predictions, and how many values they share.
fn distance_squared(a: &Foreseen, b: &Foreseen, sigma: f64) -> (f64, usize) {
    let shared = a.angles.len().min(b.angles.len());
    if shared == 0 {
        return (0.0, 0);
    }
    let difference = DVector::from_fn(shared, |row, _| (a.angles[row] - b.angles[row]) / sigma);
    // By Woodbury's identity: a matrix as small as what is uncertain, whatever the number of samples.
    let width = a.spread.ncols() + b.spread.ncols();
    let spread = DMatrix::from_fn(shared, width, |row, column| match column.checked_sub(a.spread.ncols()) {
        None => a.spread[(row, column)] / sigma,
        Some(column) => b.spread[(row, column)] / sigma,
    });
    let projected = spread.tr_mul(&difference);
    let inner = DMatrix::identity(width, width) + spread.tr_mul(&spread);
    let explained = inner.cholesky().map_or(0.0, |inner| projected.dot(&inner.solve(&projected)));
    ((difference.norm_squared() - explained).max(0.0), shared)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;
    use crate::geometry::SimplePolygon;

    /// One value at 100 Hz of a sensor with 0.5° at 2 kHz, rad.
    const SAMPLING: Sampling = Sampling { felt: Felt::ContactAngle, dt: 0.01, sigma: 0.001_95 };
    const SPEED: f64 = 0.05; // m/s
    const LATERAL: f64 = 0.08; // m/s²

    fn rectangle(width: f64, height: f64) -> Part {
        let (x, y) = (0.5 * width, 0.5 * height);
        Part::uniform(SimplePolygon::new([[-x, -y], [x, -y], [x, y], [-x, y]].map(Point2::from)).unwrap())
    }

    /// A disk that moves up into whatever it touches.
    fn present(part: &Part) -> Present<'_> {
        Present { part, grip: 0.3 * 9.81, radius: 0.01, centre: [0.0; 2], velocity: [0.0, SPEED] }
    }

    /// Touched straight ahead, off the foot by `s`, moving along with the finger.
    fn belief(edge: usize, s: f64, s_sd: f64) -> Belief {
        let mut covariance = Matrix4::zeros();
        covariance[(1, 1)] = s_sd * s_sd;
        let state = State { u: std::f64::consts::FRAC_PI_2, s, omega: 0.0, v_t: 0.0 };
        let law = ContactLaw::Rolling { friction: None };
        Belief { edge, law, state, covariance, probability: 0.5 }
    }

    #[test]
    fn nothing_separates_edges_that_are_alike() {
        let part = rectangle(0.06, 0.04);
        let beliefs = [belief(0, 0.005, 1e-4), belief(2, 0.005, 1e-4)];
        let all = prospects(&present(&part), &beliefs, &motions([0.0, SPEED], LATERAL), SAMPLING, 0.5);
        for prospect in &all {
            let pair = prospect.nearest().unwrap();
            assert!(pair.distance_squared < 1e-6, "{pair:?}");
            assert!((prospect.risk - 0.5).abs() < 1e-3, "{}", prospect.risk);
        }
        assert_eq!(inseparable(&all), [[0, 1]]);
    }

    #[test]
    fn a_push_aside_separates_what_a_straight_one_does_not() {
        // Pushed through the centre of mass a straight push turns neither edge: only the height of the edge differs.
        let part = rectangle(0.06, 0.03);
        let beliefs = [belief(0, 0.0, 0.0), belief(1, 0.0, 0.0)];
        let all = prospects(&present(&part), &beliefs, &motions([0.0, SPEED], LATERAL), SAMPLING, 0.5);
        let straight = all.iter().find(|prospect| prospect.acceleration == [0.0, 0.0]).unwrap();
        assert!(straight.nearest().unwrap().distance_squared < 1e-6);
        assert!(all[0].acceleration[0] != 0.0 && all[0].ambiguous().count() == 0, "{:?}", all[0]);
        assert!(all.windows(2).all(|pair| pair[0].risk <= pair[1].risk));
        assert!(inseparable(&all).is_empty());
        // A push through the centre of mass keeps the contact for as long as it is asked to.
        assert!(straight.contact_s.iter().all(|seconds| (seconds - 0.5).abs() < 1e-9), "{:?}", straight.contact_s);
    }

    #[test]
    fn without_tangential_force_the_force_points_along_the_contact() {
        // Straight through the centre of mass nothing pulls along the edge; aside, friction has to.
        let part = rectangle(0.06, 0.03);
        let (present, belief) = (present(&part), belief(0, 0.0, 0.0));
        let angles = |acceleration, felt| angles(&present, &belief, belief.state, acceleration, (&[0.1, 0.2], felt));
        let straight = [Felt::ContactAngle, Felt::ForceDirection].map(|felt| angles([0.0, 0.0], felt));
        assert!(straight[0].iter().zip(&straight[1]).all(|(contact, force)| (contact - force).abs() < 1e-9));
        // The finger drags the part to +x: the force on the part turns from straight up towards +x.
        let aside = angles([LATERAL, 0.0], Felt::ForceDirection);
        let contact = angles([LATERAL, 0.0], Felt::ContactAngle);
        assert!(aside.iter().zip(&contact).all(|(force, contact)| force < contact), "{aside:?} {contact:?}");
    }

    #[test]
    fn the_top_speed_is_at_the_beginning_or_the_end() {
        assert!((top_speed([0.05, 0.0], [0.0, 0.24], 0.5) - 0.13).abs() < 1e-12);
        assert!((top_speed([0.05, 0.0], [-0.1, 0.0], 0.5) - 0.05).abs() < 1e-12);
    }

    #[test]
    fn what_the_uncertainty_explains_is_no_evidence() {
        // Two places of one edge, a millimetre apart: told apart if known well, and not if either could be the other.
        let part = rectangle(0.06, 0.04);
        let distance = |s_sd: f64| {
            let beliefs = [belief(0, 0.004, s_sd), belief(0, 0.005, s_sd)];
            prospects(&present(&part), &beliefs, &[[0.0, 0.0]], SAMPLING, 0.5)[0].nearest().unwrap().distance_squared
        };
        let (known, vague) = (distance(0.0), distance(1e-3));
        assert!(known > 100.0, "{known}");
        // The difference is a millimetre, the standard deviation of it √2 mm: D² tends to 1/2 as the noise vanishes.
        assert!((vague - 0.5).abs() < 0.02, "{vague}");
    }

    #[test]
    fn correlated_uncertainty_keeps_its_directions() {
        let deviations = [1e-3, 1e-4, 0.05, 0.01];
        let factor = Matrix4::from_fn(|row, column| {
            let entry = if column <= row { 1.0 / f64::from(u32::try_from(1 + row - column).unwrap()) } else { 0.0 };
            deviations[row] * entry
        });
        let covariance = factor * factor.transpose();
        let root = root(&covariance);
        let again = root * root.transpose();
        let relative = |row: usize, column: usize| {
            (again[(row, column)] - covariance[(row, column)])
                / (covariance[(row, row)] * covariance[(column, column)]).sqrt()
        };
        assert!((0..16).all(|index| relative(index / 4, index % 4).abs() < 1e-12));
    }

    #[test]
    fn a_hypothesis_that_cannot_be_pushed_tells_nothing() {
        let part = rectangle(0.06, 0.04);
        let beliefs = [belief(0, 0.005, 1e-4), belief(1, 0.5, 1e-4)]; // far beyond the edge
        let prospect = &prospects(&present(&part), &beliefs, &[[0.0, 0.0]], SAMPLING, 0.5)[0];
        assert_eq!(prospect.pairs[0].distance_squared.to_bits(), 0.0_f64.to_bits());
        assert!((prospect.risk - 0.5).abs() < 1e-9);
    }
}
