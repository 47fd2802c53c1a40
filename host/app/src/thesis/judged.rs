//! What answers state, held against the truth: rates, errors in their own deviations, probabilities by deciles; each
//! with the interval that chance allows.
//!
//! Implements: Wilson's interval of a rate; the mean of squared errors in their own covariance (NEES), which is their
//! number of freedoms where that is right; of each tenth of stated probabilities how many were true, by the normal approximation of
//! independent draws. All intervals are of 99 %.
//! Units: none. Errors: none; of nothing there is no rate.

use std::f64::consts::TAU;

use nalgebra::{Isometry2, Matrix3, SymmetricEigen, Vector3};
use palpate::math::random::Draw;
use palpate::math::statistics::{chi_square_quantile, mean, normal_quantile};
use palpate::pushing::estimation::{Hypothesis, Status};

use super::{Cell, Table};

/// Probability that chance stays inside an interval.
const CONFIDENCE: f64 = 0.99;

/// Share of true values that a stated region is to hold.
const REGION: f64 = 0.95;

/// Claims that a tenth needs before it is compared: with fewer nothing can stand out.
const TENTH_MIN: usize = 20;

/// Squared errors above this are told by case: of few degrees of freedom, chance has one in a thousand cases above 16.
const FAR_OUTSIDE: f64 = 25.0;

/// Standard deviations on either side of a mean that hold [`CONFIDENCE`].
fn deviations() -> f64 {
    normal_quantile(0.5 + 0.5 * CONFIDENCE)
}

/// What came of one case.
#[derive(Clone, Debug)]
pub(super) struct JudgedCase {
    /// None where nothing was felt.
    pub(super) status: Option<Status>,
    /// Whether the truth is in the set.
    pub(super) has_truth: bool,
    /// Whether the search missed what a fit from the truth finds.
    pub(super) is_missed: bool,
    /// Squared error of the truth's hypothesis in its own standard deviations.
    pub(super) squared_error: Option<f64>,
    /// Whether the truth is in the 95 % region of all that is listed, by probability, where that is judged.
    pub(super) is_covered: Option<bool>,
    pub(super) stated: Vec<Stated>,
    pub(super) milliseconds: f64,
}

impl JudgedCase {
    /// What is wrong with the answer, in words; none where the truth is in it.
    pub(super) fn failure(&self) -> Option<String> {
        let what = match self.status {
            _ if self.squared_error.is_some_and(|error| error > FAR_OUTSIDE) => {
                return Some(format!(
                    "stated too narrowly, squared error {:.0}",
                    self.squared_error.unwrap_or_default()
                ));
            }
            _ if self.has_truth => return None,
            None => "no push was felt",
            Some(Status::Unique) => "wrong single answer",
            Some(Status::Ambiguous) => "truth not among those listed",
            Some(Status::Unexplained) => "no pose",
        };
        Some(format!("{what}, {}", if self.is_missed { "the search missed it" } else { "not the search" }))
    }
}

/// Headings of [`cells`], after the row's name.
pub(super) const COLUMNS: [&str; 13] = [
    "cases",
    "one pose",
    "wrong single",
    "truth missing",
    "no pose",
    "search missed it",
    ERRORS[0],
    ERRORS[1],
    ERRORS[2],
    "in all's 95 %",
    "tenths off",
    "mean ms",
    "longest ms",
];

/// A row's figures; errors have so many degrees of freedom.
pub(super) fn cells(row: &str, outcomes: &[&JudgedCase], freedom: usize, table: &mut Table) -> Vec<Cell> {
    let counted = |is: &dyn Fn(&JudgedCase) -> bool| outcomes.iter().filter(|outcome| is(outcome)).count();
    let rate_of = |is: &dyn Fn(&JudgedCase) -> bool| rate(counted(is), outcomes.len());
    let is_single = |outcome: &JudgedCase| outcome.status == Some(Status::Unique);
    let stated: Vec<_> = outcomes.iter().flat_map(|outcome| outcome.stated.iter().copied()).collect();
    let squared: Vec<_> = outcomes.iter().filter_map(|outcome| outcome.squared_error).collect();
    let [nees, by_chance, within] = errors(&squared, freedom);
    let covers: Vec<_> = outcomes.iter().filter_map(|outcome| outcome.is_covered).collect();
    let covered = rate(covers.iter().filter(|covers| **covers).count(), covers.len());
    let times = || outcomes.iter().map(|outcome| outcome.milliseconds);
    let longest = times().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    vec![
        row.into(),
        Cell::count(outcomes.len()),
        Cell::share(counted(&is_single), outcomes.len()),
        rate_of(&|outcome| is_single(outcome) && !outcome.has_truth),
        rate_of(&|outcome| !outcome.has_truth),
        rate_of(&|outcome| outcome.status == Some(Status::Unexplained)),
        Cell::count(counted(&|outcome| outcome.is_missed)),
        nees,
        by_chance,
        within,
        covered,
        tenths(row, &stated, table),
        mean(times()).map_or(Cell::Empty, |mean| Cell::number(mean, 1)),
        longest.map_or(Cell::Empty, |(case, longest)| format!("{longest:.0} (case {case})").into()),
    ]
}

/// How often something was so, with Wilson's interval; empty of nothing.
pub(super) fn rate(part: usize, whole: usize) -> Cell {
    if whole == 0 {
        return Cell::Empty;
    }
    let (n, z2) = (whole as f64, deviations().powi(2));
    let share = part as f64 / n;
    let middle = (share + 0.5 * z2 / n) / (1.0 + z2 / n);
    let half = (z2 * (share * (1.0 - share) / n + 0.25 * z2 / (n * n))).sqrt() / (1.0 + z2 / n);
    Cell::Rate { share, low: (middle - half).max(0.0), high: (middle + half).min(1.0) }
}

/// Headings of [`errors`].
pub(super) const ERRORS: [&str; 3] = ["NEES", "by chance", "within 95 %"];

/// Squared errors in their own deviations, of so many degrees of freedom: their mean, by how much it is off by chance
/// as far as their own scatter tells, and how many are inside the stated 95 % region.
pub(super) fn errors(squared: &[f64], freedom: usize) -> [Cell; 3] {
    let Some(nees) = mean(squared.iter().copied()) else { return [Cell::Empty, Cell::Empty, Cell::Empty] };
    let count = squared.len() as f64;
    // Stated to second order, errors are not normal: their own scatter counts.
    let variance = mean(squared.iter().map(|error| (error - nees) * (error - nees))).unwrap_or(0.0);
    let off = deviations() * (variance / count).sqrt();
    let region = chi_square_quantile(REGION, freedom);
    let inside = squared.iter().filter(|error| **error <= region).count();
    [Cell::number(nees, 2), format!("± {off:.2}").into(), rate(inside, squared.len())]
}

/// A claim of an answer: one hypothesis, or several that are too near to each other for the truth to tell them apart.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stated {
    /// How likely it was said to be.
    probability: f64,
    is_true: bool,
}

impl Stated {
    /// Those of an answer. Hypotheses of which one would be right, were the other the truth, make one claim, whatever
    /// the truth is.
    pub(super) fn all<H>(
        hypotheses: &[H],
        probability: impl Fn(&H) -> f64,
        are_near: impl Fn(&H, &H) -> bool,
        is_true: impl Fn(&H) -> bool,
    ) -> Vec<Self> {
        let claims = classes(hypotheses.len(), |a, b| {
            let (a, b) = (&hypotheses[a], &hypotheses[b]);
            are_near(a, b) || are_near(b, a)
        });
        let stated = |claim: &Vec<usize>| Self {
            probability: claim.iter().map(|n| probability(&hypotheses[*n])).sum(),
            is_true: claim.iter().any(|n| is_true(&hypotheses[*n])),
        };
        claims.iter().map(stated).collect()
    }
}

/// The first numbers, so many of them, put together where one leads to the other over near ones.
fn classes(count: usize, are_near: impl Fn(usize, usize) -> bool) -> Vec<Vec<usize>> {
    let mut classes: Vec<Vec<usize>> = Vec::new();
    for number in 0..count {
        let mut class = vec![number];
        class.extend(classes.extract_if(.., |other| other.iter().any(|of| are_near(*of, number))).flatten());
        classes.push(class);
    }
    classes
}

/// What a hypothesis says of a pose, held against the truth. Lengths and angles in slacks, from the truth.
#[derive(Clone, Copy, Debug)]
pub(super) struct PoseClaim {
    probability: f64,
    /// Squared error, in deviations of [`PoseClaim::FREEDOM`] degrees of freedom.
    pub(super) squared: f64,
    off: Vector3<f64>,
    /// Columns whose squares add up to the stated covariance.
    root: Matrix3<f64>,
    /// The inverse of that and of what the simulations are off by.
    precision: Matrix3<f64>,
    /// The square root of its determinant.
    peak: f64,
}

impl PoseClaim {
    /// Errors are told as those of so many degrees of freedom: a pose on an exact contact has two.
    pub(super) const FREEDOM: usize = 2;

    /// An exact contact leaves a covariance singular: what the simulations are off by, m and rad.
    const SLACK: (f64, f64) = (5e-6, 5e-5);

    /// Directions whose variance is this many times the slack's count as free.
    const FREE: f64 = 10.0;

    /// Poses drawn of each claim for the region of all: its share is off by 0.002.
    const DRAWS: usize = 10_000;

    /// They are the same for all cases.
    const SEED: u64 = 0x7265_6769_6f6e;

    /// Of a hypothesis of a part that so many turns about its frame's origin take to itself: of the poses that look the same
    /// the one nearest to the truth. A pose that is free may be anywhere.
    pub(super) fn of(hypothesis: &Hypothesis, symmetry: usize, truth: &Isometry2<f64>) -> Self {
        let mut off = hypothesis.pose_end.minus(&(*truth).into());
        let step = TAU / symmetry.max(1) as f64;
        off.z -= step * (off.z / step).round();
        let covariance = hypothesis.covariance.unwrap_or_else(|| Matrix3::identity() * f64::MAX.sqrt());
        Self::new(hypothesis.probability, &off, &covariance)
    }

    /// Of a pose that is off by so much (m, m, rad) and its stated covariance.
    pub(super) fn new(probability: f64, off: &Vector3<f64>, covariance: &Matrix3<f64>) -> Self {
        let slack = Vector3::new(Self::SLACK.0, Self::SLACK.0, Self::SLACK.1);
        let scale = Matrix3::from_diagonal(&slack.map(|sd| 1.0 / sd));
        // In slacks, so that what is free shows in the eigenvalues.
        let off = scale * off;
        let SymmetricEigen { eigenvalues, eigenvectors } = (scale * covariance * scale).symmetric_eigen();
        let variances = eigenvalues.map(|value| value.max(0.0));
        let free = variances.iter().filter(|variance| **variance > Self::FREE).count().max(1);
        let inverses = variances.map(|variance| 1.0 / (variance + 1.0));
        let precision = eigenvectors * Matrix3::from_diagonal(&inverses) * eigenvectors.transpose();
        let scaled = chi_square_quantile(REGION, Self::FREEDOM) / chi_square_quantile(REGION, free);
        Self {
            probability,
            squared: off.dot(&(precision * off)) * scaled,
            off,
            root: eigenvectors * Matrix3::from_diagonal(&variances.map(f64::sqrt)),
            precision,
            peak: inverses.map(f64::sqrt).product(),
        }
    }

    /// Whether the truth is within the 95 % region of all claims together: the places of highest density that hold as much. How
    /// much is denser than at the truth is counted among poses that are drawn as the claims say.
    pub(super) fn cover(claims: &[Self]) -> bool {
        let density = |at: &Vector3<f64>| claims.iter().map(|claim| claim.density(at)).sum::<f64>();
        let at_truth = density(&Vector3::zeros());
        let mut draw = Draw::new(Self::SEED);
        let mut denser = |claim: &Self| {
            let mut drawn = || claim.off + claim.root * Vector3::from_fn(|_, _| draw.normal());
            let count = (0..Self::DRAWS).filter(|_| density(&drawn()) > at_truth).count();
            claim.probability * count as f64 / Self::DRAWS as f64
        };
        !claims.is_empty() && claims.iter().map(&mut denser).sum::<f64>() <= REGION
    }

    /// Of the pose, up to what all claims share.
    fn density(&self, at: &Vector3<f64>) -> f64 {
        let off = at - self.off;
        self.probability * self.peak * (-0.5 * off.dot(&(self.precision * off))).exp()
    }
}

/// How many tenths of the stated probabilities are not true as often as they say, of those that can be compared; each
/// is noted in the table.
fn tenths(row: &str, stated: &[Stated], table: &mut Table) -> Cell {
    let mut compared = 0_usize;
    let mut off = 0_usize;
    for tenth in 0..10_u32 {
        let (low, high) = (0.1 * f64::from(tenth), 0.1 * f64::from(tenth + 1));
        // The last one holds certainty.
        let is_inside = |p: f64| p >= low && (p < high || tenth == 9);
        let inside: Vec<_> = stated.iter().filter(|stated| is_inside(stated.probability)).collect();
        if inside.len() < TENTH_MIN {
            continue;
        }
        compared += 1;
        let expected: f64 = inside.iter().map(|stated| stated.probability).sum();
        let variance: f64 = inside.iter().map(|stated| stated.probability * (1.0 - stated.probability)).sum();
        let found = inside.iter().filter(|stated| stated.is_true).count();
        // A count is whole, hence the half.
        if (found as f64 - expected).abs() > deviations() * variance.sqrt() + 0.5 {
            off += 1;
            table.notes.push(format!(
                "{row}: of {} claims given {:.0}-{:.0} % {found} are true, {expected:.1} ± {:.1} expected",
                inside.len(),
                100.0 * low,
                100.0 * high,
                deviations() * variance.sqrt(),
            ));
        }
    }
    format!("{off} of {compared}").into()
}

/// What the columns mean.
pub(super) fn definitions() -> [String; 3] {
    [
        "In brackets, and as \"by chance\": intervals of 99 %.".to_owned(),
        "NEES: mean squared error of the truth's hypothesis in its own covariance; within 95 %: how often it is in the stated region; in all's 95 %: how often it is where what all hypotheses say together is densest, and 95 % of it.".to_owned(),
        "tenths off: of the tenths of stated probabilities (with 20 claims or more), those that are true too often or too rarely; hypotheses of which one would count as right, were the other the truth, are one claim.".to_owned(),
    ]
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    use super::*;

    /// The interval has the ends at which the rate would be so many deviations away: checked by that definition.
    #[test]
    fn ends_of_a_rate_are_as_far_from_it_as_chance_goes() {
        for (part, whole) in [(0, 50), (3, 20_000), (40, 100), (100, 100)] {
            let Cell::Rate { share, low, high } = rate(part, whole) else { panic!("no rate") };
            assert!(low <= share && share <= high, "{low} {share} {high}");
            for end in [low, high] {
                let deviation = (end * (1.0 - end) / whole as f64).sqrt();
                let is_limit = end <= 0.0 || end >= 1.0;
                assert!(is_limit || ((share - end).abs() / deviation - deviations()).abs() < 1e-9, "{end}");
            }
        }
        assert_eq!(rate(0, 0), Cell::Empty);
    }

    /// Truths are drawn as claims say that overlap or do not, and are flat, nearly so, or as thick as they are wide.
    #[test]
    fn the_region_of_all_claims_holds_as_much_as_it_says() {
        const TRUTHS: usize = 400;
        /// Of a count that is right with 95 %.
        const DEVIATIONS: f64 = 4.0;
        let stated = |probability: f64, at: [f64; 3], sds: [f64; 3]| {
            // Turned, so that no direction is that of an axis.
            let turn = Rotation3::from_euler_angles(0.3, -0.7, 1.1).into_inner();
            let slack =
                Matrix3::from_diagonal(&Vector3::new(PoseClaim::SLACK.0, PoseClaim::SLACK.0, PoseClaim::SLACK.1));
            let root = slack * turn * Matrix3::from_diagonal(&Vector3::from(sds));
            (probability, slack * Vector3::from(at), root)
        };
        let flat = [300.0, 40.0, 0.0];
        let answers = [
            vec![stated(1.0, [0.0; 3], flat)],
            vec![stated(1.0, [0.0; 3], [300.0, 40.0, 2.0])],
            vec![stated(1.0, [0.0; 3], [300.0, 40.0, 40.0])],
            vec![stated(0.5, [0.0; 3], flat), stated(0.5, [100.0, 0.0, 0.0], [500.0, 20.0, 0.0])],
            vec![stated(0.03, [0.0; 3], flat), stated(0.97, [1e4, 0.0, 0.0], [30.0, 20.0, 10.0])],
        ];
        for (number, answer) in answers.iter().enumerate() {
            let mut draw = Draw::case(5, number);
            let covered = (0..TRUTHS).filter(|_| {
                let mut chosen = draw.unit();
                let of = answer.iter().find(|(probability, ..)| {
                    chosen -= probability;
                    chosen <= 0.0
                });
                let (_, at, root) = of.unwrap_or(&answer[0]);
                let truth = at + root * Vector3::from_fn(|_, _| draw.normal());
                let claim = |(probability, at, root): &(f64, Vector3<f64>, Matrix3<f64>)| {
                    PoseClaim::new(*probability, &(at - truth), &(root * root.transpose()))
                };
                PoseClaim::cover(&answer.iter().map(claim).collect::<Vec<_>>())
            });
            let (covered, expected) = (covered.count() as f64, REGION * TRUTHS as f64);
            let deviation = (expected * (1.0 - REGION)).sqrt();
            assert!((covered - expected).abs() < DEVIATIONS * deviation, "{number}: {covered}");
        }
    }

    proptest! {
        /// What is drawn as it is stated is inside, but for one row in a hundred; what is not stands out.
        #[test]
        fn what_is_stated_rightly_is_inside_and_overconfidence_stands_out(seed in any::<u64>()) {
            let mut draw = Draw::case(seed, 0);
            let mut drawn = |by: f64| -> Vec<_> {
                (0..4000).map(|_| (0..2).map(|_| (by * draw.normal()).powi(2)).sum::<f64>()).collect()
            };
            let nees = |squared: &[f64]| match errors(squared, 2) {
                [Cell::Number((nees, _)), ..] => nees,
                _ => f64::NAN,
            };
            // Five deviations of √(2 · 2/4000): once in two million.
            prop_assert!((nees(&drawn(1.0)) - 2.0).abs() < 5.0 * 0.032);
            prop_assert!(nees(&drawn(1.2)) > 2.0 + 5.0 * 0.032);
        }

        /// Two are in one class just where a chain of near ones joins them: by all paths, as Warshall finds them.
        #[test]
        fn a_chain_of_near_ones_is_one_class(near in prop::collection::vec(prop::collection::vec(prop::bool::weighted(0.15), 9), 9)) {
            let are_near = |a: usize, b: usize| near[a][b] || near[b][a];
            let mut joined: Vec<Vec<_>> = (0..9).map(|a| (0..9).map(|b| a == b || are_near(a, b)).collect()).collect();
            for over in 0..9 {
                for a in 0..9 {
                    for b in 0..9 {
                        joined[a][b] |= joined[a][over] && joined[over][b];
                    }
                }
            }
            let classes = classes(9, are_near);
            prop_assert_eq!(classes.iter().flatten().count(), 9);
            let class_of = |a: usize| classes.iter().position(|class| class.contains(&a));
            for (a, row) in joined.iter().enumerate() {
                for (b, is_joined) in row.iter().enumerate() {
                    prop_assert_eq!(class_of(a) == class_of(b), *is_joined, "{} {}", a, b);
                }
            }
        }

        #[test]
        fn tenths_that_say_too_much_are_named(seed in any::<u64>()) {
            let mut draw = Draw::case(seed, 0);
            let stated: Vec<_> = (0..3000)
                .map(|_| {
                    let probability = draw.uniform(0.7, 0.8);
                    Stated { probability, is_true: draw.chance(probability - 0.2) }
                })
                .collect();
            let mut table = Table::new(["row"]);
            prop_assert_eq!(tenths("row", &stated, &mut table), Cell::from("1 of 1"));
            prop_assert!(table.notes[0].contains("given 70-80 %"), "{:?}", table.notes);
        }
    }
}
