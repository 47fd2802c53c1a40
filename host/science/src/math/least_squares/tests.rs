use std::f64::consts::{PI, TAU};

use nalgebra::{DMatrix, DVector, Matrix2x3, Vector1, Vector2, Vector3};
use proptest::prelude::*;

use super::*;
use crate::math::angle::wrap_angle;

/// Residuals with their Jacobian as functions of plain vectors.
struct Plain<F, J> {
    residuals: F,
    slopes: J,
}

impl<const N: usize, const M: usize, F, J> LeastSquaresProblem<N> for Plain<F, J>
where
    F: Fn(&SVector<f64, N>) -> SVector<f64, M>,
    J: Fn(&SVector<f64, N>) -> SMatrix<f64, M, N>,
{
    type Place = SVector<f64, N>;

    fn cost(&self, x: &SVector<f64, N>) -> f64 {
        (self.residuals)(x).norm_squared()
    }

    fn normal_equations(&self, x: &SVector<f64, N>) -> NormalEquations<N> {
        let (residuals, slopes) = ((self.residuals)(x), (self.slopes)(x));
        let mut equations = NormalEquations::zero();
        for row in 0..M {
            equations.add(residuals[row], slopes.row(row).transpose());
        }
        equations
    }

    fn moved(&self, x: &SVector<f64, N>, step: &SVector<f64, N>) -> Option<SVector<f64, N>> {
        Some(x + step)
    }
}

/// Rosenbrock's valley: residuals 1 − x and 10 (y − x²), with its second unknown in other units.
fn rosenbrock(unit: f64) -> impl LeastSquaresProblem<2, Place = Vector2<f64>> {
    Plain {
        residuals: move |v: &Vector2<f64>| Vector2::new(1.0 - v.x, 10.0 * (v.y / unit - v.x * v.x)),
        slopes: move |v: &Vector2<f64>| nalgebra::Matrix2::new(-1.0, 0.0, -20.0 * v.x, 10.0 / unit),
    }
}

/// Where everybody starts in it.
const VALLEY_START: Vector2<f64> = Vector2::new(-1.2, 1.0);

/// Gauss's and Newton's steps, as long as they help.
fn undamped<const N: usize>() -> LeastSquaresSettings<N> {
    let standard = LeastSquaresSettings::<N>::default();
    let damping = Damping { first: 0.0, min_after_failure: 1e-3, ..standard.damping };
    LeastSquaresSettings { damping, floor: Floor::NONE, ..standard }
}

#[test]
fn a_bent_valley_is_followed_to_its_end() {
    let found = minimise(&rosenbrock(1.0), VALLEY_START, &LeastSquaresSettings::default(), |_| false);
    assert!((found.place - Vector2::new(1.0, 1.0)).norm() < 1e-9, "{found:?}");
    assert!(found.trials < 50 && found.outcome != Outcome::LimitReached, "{found:?}");
}

#[test]
fn a_linear_problem_takes_one_undamped_step() {
    let matrix = Matrix2x3::new(1.0, 2.0, 0.5, -1.0, 0.3, 4.0).transpose();
    let right = Vector3::new(1.0, -2.0, 0.7);
    let line = Plain { residuals: move |x: &Vector2<f64>| matrix * x - right, slopes: move |_: &Vector2<f64>| matrix };
    let found =
        minimise(&line, Vector2::new(30.0, -50.0), &LeastSquaresSettings { trials_max: 1, ..undamped() }, |_| false);
    let normal = (matrix.transpose() * matrix).try_inverse().unwrap() * matrix.transpose() * right;
    assert!((found.place - normal).norm() < 1e-12, "{found:?} {normal}");
}

#[test]
fn what_has_no_influence_stays_where_it_is() {
    // Only x + y is measured, and z not at all.
    let row = Vector3::new(1.0, 1.0, 0.0).transpose();
    let sum = Plain {
        residuals: move |v: &Vector3<f64>| Vector1::new((row * v)[0] - 3.0),
        slopes: move |_: &Vector3<f64>| row,
    };
    for floor in [Floor::Relative(1e-12), Floor::Absolute([1e-6; 3])] {
        let found = minimise(
            &sum,
            Vector3::new(0.0, 1.0, 7.0),
            &LeastSquaresSettings { floor, ..LeastSquaresSettings::default() },
            |_| false,
        );
        // The step nearest to the start: both measured unknowns share it alike.
        assert!((found.place - Vector3::new(1.0, 2.0, 7.0)).norm() < 1e-6, "{floor:?} {found:?}");
    }
}

#[test]
fn a_singular_curvature_without_floor_stalls_where_it_began() {
    let blind = Plain {
        residuals: |_: &Vector2<f64>| Vector1::new(1.0),
        slopes: |_: &Vector2<f64>| nalgebra::RowVector2::zeros(),
    };
    let found = minimise(&blind, Vector2::new(1.0, 2.0), &undamped(), |_| false);
    assert_eq!((found.place, found.outcome), (Vector2::new(1.0, 2.0), Outcome::Stalled));
    assert!(found.trials < 20, "{}", found.trials);
}

/// Mean of angles: a place on a circle, not on a line.
struct MeanAngle([f64; 3]);

impl LeastSquaresProblem<1> for MeanAngle {
    type Place = f64;

    fn cost(&self, angle: &f64) -> f64 {
        self.0.iter().map(|reading| wrap_angle(angle - reading).powi(2)).sum()
    }

    fn normal_equations(&self, angle: &f64) -> NormalEquations<1> {
        let mut equations = NormalEquations::zero();
        self.0.iter().for_each(|reading| equations.add(wrap_angle(angle - reading), Vector1::new(1.0)));
        equations
    }

    fn moved(&self, angle: &f64, step: &Vector1<f64>) -> Option<f64> {
        Some(wrap_angle(angle + step[0]))
    }
}

#[test]
fn the_mean_of_angles_on_both_sides_of_the_cut_is_between_them() {
    let found = minimise(&MeanAngle([3.1, -3.1, 3.12]), 3.0, &LeastSquaresSettings::default(), |_| false);
    assert!((wrap_angle(found.place - (3.1 + 3.12 + TAU - 3.1) / 3.0)).abs() < 1e-9, "{found:?}");
    assert!(found.place.abs() <= PI);
}

#[test]
fn trials_and_steps_are_bounded() {
    let few = LeastSquaresSettings { trials_max: 3, ..LeastSquaresSettings::default() };
    let found = minimise(&rosenbrock(1.0), VALLEY_START, &few, |_| false);
    assert_eq!((found.outcome, found.trials), (Outcome::LimitReached, 3));
    let mut steps = 0;
    let short = LeastSquaresSettings { steps_max: 5, ..LeastSquaresSettings::default() };
    let found = minimise(&rosenbrock(1.0), VALLEY_START, &short, |trial| {
        steps += usize::from(trial.is_lower);
        false
    });
    assert_eq!((found.outcome, steps), (Outcome::LimitReached, 5));
    let none = LeastSquaresSettings { steps_max: 0, ..LeastSquaresSettings::default() };
    assert_eq!(minimise(&rosenbrock(1.0), VALLEY_START, &none, |_| false).place, VALLEY_START);
}

#[test]
fn the_caller_sees_every_trial_and_stops_when_it_likes() {
    let mut seen = Vec::new();
    let found = minimise(&rosenbrock(1.0), VALLEY_START, &LeastSquaresSettings::default(), |trial| {
        seen.push((trial.count, trial.is_lower, trial.cost_before, trial.cost_after));
        trial.is_lower && trial.cost_after < 1.0
    });
    assert_eq!(found.outcome, Outcome::Stopped);
    assert!(seen.iter().enumerate().all(|(i, trial)| trial.0 == i + 1) && seen.len() == found.trials);
    assert!(seen.iter().all(|(_, is_lower, before, after)| *is_lower == (after < before)));
    let costs: Vec<_> = seen.iter().filter(|trial| trial.1).collect();
    assert!(costs.windows(2).all(|pair| pair[0].3.to_bits() == pair[1].2.to_bits()), "{costs:?}");
    let last = rosenbrock(1.0).cost(&found.place);
    assert!(last < 1.0 && last.to_bits() == costs[costs.len() - 1].3.to_bits());
}

/// ln x − target: defined for x > 0 only.
struct Logarithm(f64);

impl LeastSquaresProblem<1> for Logarithm {
    type Place = f64;

    fn cost(&self, x: &f64) -> f64 {
        (x.ln() - self.0).powi(2)
    }

    fn normal_equations(&self, x: &f64) -> NormalEquations<1> {
        let mut equations = NormalEquations::zero();
        equations.add(x.ln() - self.0, Vector1::new(1.0 / x));
        equations
    }

    fn moved(&self, x: &f64, step: &Vector1<f64>) -> Option<f64> {
        Some(x + step[0]).filter(|x| *x > 0.0)
    }
}

#[test]
fn a_place_without_evaluation_is_a_trial_that_failed() {
    // The first step would lead below 0.
    let mut failed = 0;
    let found = minimise(&Logarithm(0.0), 5.0, &LeastSquaresSettings::default(), |trial| {
        failed += usize::from(trial.cost_after.is_infinite());
        false
    });
    assert!((found.place - 1.0).abs() < 1e-9, "{found:?}");
    assert!(failed >= 1);
}

/// A problem within bounds, with steps no longer than a limit.
struct Bounded {
    bound: f64,
    step_max: f64,
}

impl LeastSquaresProblem<2> for Bounded {
    type Place = Vector2<f64>;

    fn cost(&self, v: &Vector2<f64>) -> f64 {
        rosenbrock(1.0).cost(v)
    }

    fn normal_equations(&self, v: &Vector2<f64>) -> NormalEquations<2> {
        rosenbrock(1.0).normal_equations(v)
    }

    fn moved(&self, v: &Vector2<f64>, step: &Vector2<f64>) -> Option<Vector2<f64>> {
        assert!(step.norm() <= self.step_max * (1.0 + 1e-12), "{step}");
        Some(Vector2::new((v.x + step.x).min(self.bound), v.y + step.y))
    }

    fn held(&self, v: &Vector2<f64>, equations: &NormalEquations<2>) -> [bool; 2] {
        [v.x >= self.bound && equations.gradient.x < 0.0, false]
    }

    fn limited(&self, step: Vector2<f64>) -> Vector2<f64> {
        step * (self.step_max / step.norm()).min(1.0)
    }
}

#[test]
fn a_minimum_against_a_bound_is_found_on_it() {
    let problem = Bounded { bound: 0.5, step_max: 0.3 };
    let found = minimise(&problem, VALLEY_START, &LeastSquaresSettings::default(), |_| false);
    // With x held at 0.5 the lowest y is its square.
    assert!((found.place - Vector2::new(0.5, 0.25)).norm() < 1e-9, "{found:?}");
}

#[test]
fn a_cost_that_no_step_lowers_stalls_within_the_damping() {
    // The slope has the wrong sign.
    let contrary =
        Plain { residuals: |x: &Vector1<f64>| Vector1::new(1.0 + x[0]), slopes: |_: &Vector1<f64>| Vector1::new(-1.0) };
    let found = minimise(&contrary, Vector1::new(0.0), &LeastSquaresSettings::default(), |_| false);
    assert_eq!((found.place, found.outcome), (Vector1::new(0.0), Outcome::Stalled));
    // From 1e-3 up to 1e8 by tens.
    assert!(found.trials <= 12, "{}", found.trials);
}

/// A parabola on whose slope somebody has dug a hole: from within it no step leads lower, though by slopes one would.
#[test]
fn where_no_step_lowers_the_cost_and_none_would_by_more_than_is_enough_one_is_tried() {
    const HOLE: f64 = 0.05;
    let problem = Plain {
        residuals: |x: &Vector1<f64>| Vector2::new(x[0], if x[0] < HOLE { 0.1 } else { 0.0 }),
        slopes: |_: &Vector1<f64>| Vector2::new(1.0, 0.0),
    };
    let tried = |absolute: f64| {
        let enough = Enough { relative: 0.0, absolute, damping_max: f64::INFINITY };
        let settings = LeastSquaresSettings { enough, ..LeastSquaresSettings::default() };
        let Found { outcome, trials, place } = minimise(&problem, Vector1::new(HOLE), &settings, |_| false);
        assert!((place[0] - HOLE).abs() < 1e-6, "{place}");
        (outcome, trials)
    };
    // By slopes 0.0025 are to be gained.
    assert_eq!(tried(0.0026), (Outcome::Converged, 1));
    let (outcome, trials) = tried(0.0);
    assert!(outcome == Outcome::Stalled && trials > 5, "{outcome:?} {trials}");
}

#[test]
fn numbers_that_are_none_move_nothing() {
    for bad in [f64::NAN, f64::INFINITY] {
        let broken = Plain {
            residuals: move |x: &Vector1<f64>| Vector1::new(if x[0] == 0.0 { 1.0 } else { bad }),
            slopes: move |_: &Vector1<f64>| Vector1::new(bad),
        };
        let found = minimise(&broken, Vector1::new(0.0), &LeastSquaresSettings::default(), |_| false);
        assert_eq!(found.place, Vector1::new(0.0));
        assert_eq!(found.outcome, Outcome::Stalled);
    }
}

#[test]
fn a_minimum_that_the_problem_knows_ends_the_descent_before_a_trial() {
    struct Known;
    impl LeastSquaresProblem<1> for Known {
        type Place = f64;
        fn cost(&self, x: &f64) -> f64 {
            x * x
        }
        fn normal_equations(&self, x: &f64) -> NormalEquations<1> {
            NormalEquations { cost: x * x, gradient: Vector1::new(*x), curvature: Vector1::new(1.0) }
        }
        fn moved(&self, x: &f64, step: &Vector1<f64>) -> Option<f64> {
            Some(x + step[0])
        }
        fn is_minimum(&self, x: &f64, _: &NormalEquations<1>) -> bool {
            x.abs() < 0.1
        }
    }
    let found = minimise(&Known, 0.05, &LeastSquaresSettings::default(), |_| false);
    assert_eq!((found.trials, found.outcome), (0, Outcome::Converged));
    assert!((predicted_reduction(&Known, &0.05, &LeastSquaresSettings::default()) - 0.05 * 0.05).abs() < 1e-15);
    assert_eq!(lowered(&Known, &0.05, &LeastSquaresSettings::default(), &mut 1e-3), Err(Outcome::Converged));
}

#[test]
fn damping_falls_where_the_parabola_is_trusted_and_grows_where_a_trial_fails() {
    let settings = LeastSquaresSettings::<1>::default();
    let mut damping = settings.damping.first;
    lowered(&MeanAngle([0.1, 0.2, 0.3]), &0.0, &settings, &mut damping).unwrap();
    assert!((damping - 1e-4).abs() < 1e-18, "{damping}");
    let mut damping = settings.damping.first;
    lowered(&Logarithm(0.0), &5.0, &settings, &mut damping).unwrap();
    assert!(damping > settings.damping.first, "{damping}");
    // From far to the left of it the parabola promises more than the logarithm keeps.
    let wary = LeastSquaresSettings { damping: Damping { trusted_share: 2.0, ..settings.damping }, ..settings };
    let mut damping = settings.damping.first;
    lowered(&Logarithm(0.0), &0.1, &wary, &mut damping).unwrap();
    assert!((damping - settings.damping.first).abs() < 1e-18, "{damping}");
}

/// Numbers of a matrix whose columns are far from parallel.
fn entries() -> impl Strategy<Value = (Vec<f64>, Vec<f64>)> {
    let matrix = proptest::collection::vec(-1.0..1.0, 24);
    let right = proptest::collection::vec(-5.0..5.0, 8);
    (matrix, right).prop_filter("columns are nearly dependent", |(matrix, _)| {
        DMatrix::from_column_slice(8, 3, matrix).svd(false, false).singular_values.min() > 0.1
    })
}

proptest! {
    /// The normal equations and a QR factorisation of the Jacobian have one solution.
    #[test]
    fn a_linear_problem_has_the_solution_of_its_orthogonal_factors((matrix, right) in entries()) {
        let (tall, sides) = (DMatrix::from_column_slice(8, 3, &matrix), DVector::from_vec(right));
        let factors = tall.clone().qr();
        let other = factors.r().solve_upper_triangular(&(factors.q().transpose() * &sides)).unwrap();
        let fixed = SMatrix::<f64, 8, 3>::from_column_slice(&matrix);
        let sides = SVector::<f64, 8>::from_column_slice(sides.as_slice());
        let problem = Plain {
            residuals: move |x: &Vector3<f64>| fixed * x - sides,
            slopes: move |_: &Vector3<f64>| fixed,
        };
        for settings in [undamped(), LeastSquaresSettings::default()] {
            let found = minimise(&problem, Vector3::zeros(), &settings, |_| false);
            let off = (found.place - Vector3::from_column_slice(other.as_slice())).norm();
            // Squaring the matrix squares its condition, at most 50; 1e-12 of the cost is left where damped steps end.
            prop_assert!(off < 1e-5, "off by {off:e}: {found:?}");
            prop_assert!(settings.damping.first > 0.0 || off < 1e-10, "off by {off:e}: {found:?}");
        }
    }

    /// What the normal equations say of the cost is what central differences say.
    #[test]
    fn gradients_are_those_of_finite_differences(x in -2.0..2.0, y in -2.0..2.0) {
        const STEP: f64 = 1e-5;
        let (problem, place) = (rosenbrock(1.0), Vector2::new(x, y));
        let equations = problem.normal_equations(&place);
        prop_assert_eq!(equations.cost.to_bits(), problem.cost(&place).to_bits());
        for i in 0..2 {
            let mut aside = Vector2::zeros();
            aside[i] = STEP;
            let difference = (problem.cost(&(place + aside)) - problem.cost(&(place - aside))) / (2.0 * STEP);
            // A cubic term of up to 1e4 and costs of up to 1e4 that round.
            prop_assert!((2.0 * equations.gradient[i] - difference).abs() < 1e-5, "{equations:?} {difference}");
        }
    }

    /// Costs never rise, and what is predicted is what happens to short steps.
    #[test]
    fn short_steps_lower_the_cost_as_predicted(x in -2.0..2.0, y in -2.0..2.0) {
        let (problem, place) = (rosenbrock(1.0), Vector2::new(x, y));
        let equations = problem.normal_equations(&place);
        let step = -equations.gradient * (1e-4 / equations.gradient.norm().max(1e-3));
        let gained = problem.cost(&place) - problem.cost(&(place + step));
        // The parabola leaves out the residual 10 (y − x²), up to 60, times its second derivative, 20: 1200 of the step
        // squared, and 1e-3 of that for cubes.
        const LEFT_OUT: f64 = 1201.0 * 1e-4 * 1e-4;
        prop_assert!((gained - equations.predicted_reduction(&step)).abs() < LEFT_OUT, "{gained} {equations:?}");
    }

    /// Marquardt's damping knows no units: a descent in others visits the same places.
    #[test]
    fn the_path_does_not_depend_on_units(power in -6..7) {
        let unit = 10.0_f64.powi(power);
        let no_floor = LeastSquaresSettings { floor: Floor::NONE, trials_max: 12, ..LeastSquaresSettings::default() };
        let plain = minimise(&rosenbrock(1.0), VALLEY_START, &no_floor, |_| false);
        let start = Vector2::new(VALLEY_START.x, VALLEY_START.y * unit);
        let scaled = minimise(&rosenbrock(unit), start, &no_floor, |_| false);
        let off = Vector2::new(scaled.place.x, scaled.place.y / unit) - plain.place;
        prop_assert!(off.norm() < 1e-9, "{plain:?} {scaled:?}");
    }

    /// Turning all readings and the start turns the answer.
    #[test]
    fn an_angle_turns_with_its_readings(turn in -10.0..10.0, a in -0.5..0.5, b in -0.5..0.5) {
        let mean = |by: f64| {
            let readings = [a, b, 0.1].map(|reading| wrap_angle(reading + by));
            minimise(&MeanAngle(readings), wrap_angle(0.3 + by), &LeastSquaresSettings::default(), |_| false).place
        };
        prop_assert!(wrap_angle(mean(turn) - mean(0.0) - turn).abs() < 1e-6);
    }

    /// A descent step by step is the descent in one go.
    #[test]
    fn steps_side_by_side_are_those_of_one_descent(x in -2.0..2.0, y in -2.0..2.0, steps in 1_usize..8) {
        let never = Enough { relative: -1.0, absolute: 0.0, damping_max: 0.0 };
        let settings = LeastSquaresSettings { steps_max: steps, enough: never, ..LeastSquaresSettings::default() };
        let whole = minimise(&rosenbrock(1.0), Vector2::new(x, y), &settings, |_| false);
        let (mut place, mut damping) = (Vector2::new(x, y), settings.damping.first);
        for _ in 0..steps {
            let Ok(lower) = lowered(&rosenbrock(1.0), &place, &settings, &mut damping) else { break };
            place = lower;
        }
        prop_assert_eq!(place, whole.place);
    }
}
