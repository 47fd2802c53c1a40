//! Thesis chapter 7: what the path of a contact tells about a rolling body.
//!
//! The thesis proves local observability and leaves the observer open, so there are no numbers of its own to compare
//! with.

use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::rolling::{
    BodyKnowledge, Model, Noise, PalmAcceleration, PalmKnowledge, RollEstimate, RollGho, RollHypothesis, RollQuestion,
    RollState, RollingBody, Spin, specific_force,
};

use super::processor_time::ProcessorTime;
use super::{Cell, Experiment, Table, TableSettings};

/// Attitudes from 0.4 s of contacts, and from other windows and sensors.
pub(super) const ATTITUDE: Experiment = Experiment {
    name: "7",
    title: "attitude of a 2-3-4 cm ellipsoid from the path of its contact",
    cases: 200,
    run: attitude,
};

/// Bodies that were never measured.
pub(super) const SEMI_AXES: Experiment = Experiment {
    name: "7-axes",
    title: "semi-axes of an unknown ellipsoid from one second of its contact path",
    cases: 100,
    run: semi_axes,
};

/// Which body, and whether the contact transmits spin.
pub(super) const WHICH: Experiment = Experiment {
    name: "7-which",
    title: "which of six bodies, and whether it spins, from the path of the contact",
    cases: 100,
    run: which,
};

/// The thesis's observer, for this system.
pub(super) const GHO: Experiment = Experiment {
    name: "7-gho",
    title: "the observer of Gauthier, Hammouri and Othman on a rolling ellipsoid",
    cases: 40,
    run: gho,
};

/// Readings 500 times a second, s.
const DT: f64 = 0.002;

/// Standard deviation of each component of the angular velocity at the start, rad/s.
const OMEGA_SIGMA: f64 = 6.0;

/// Least normal force while the contact counts as kept, as a share of the weight.
const FORCE_MIN: f64 = 0.1;

/// Attitude within this, in degrees, is right.
const RIGHT_DEG: f64 = 2.0;

/// Semi-axes of the six bodies to tell apart, cm: some differ by 5 %.
const SIX: [[f64; 3]; 6] =
    [[2.0, 3.0, 4.0], [2.1, 3.0, 4.0], [2.0, 2.8, 4.2], [2.5, 3.0, 3.5], [1.5, 3.0, 4.5], [2.2, 3.0, 3.8]];

/// A roll that kept its contact.
struct Trial {
    start: RollState,
    end: RollState,
    u: Vec<Vector2<f64>>,
}

/// What the readings of a row are like.
#[derive(Clone, Copy)]
struct Sensing {
    seconds: f64,
    noise: Noise,
}

fn millimetre_grid(seconds: f64) -> Sensing {
    Sensing { seconds, noise: Noise::Grid(1e-3) }
}

/// Rolls with random starts until one keeps its contact: uniform attitude, normal angular velocity.
fn trial(draw: &mut Draw, body: &RollingBody, spin: Spin, sensing: &Sensing) -> Trial {
    let steps = readings(sensing.seconds);
    let model = Model { body, spin };
    let weight = specific_force(Vector3::zeros(), GRAVITY_ASSUMED);
    loop {
        let start = start(draw, spin);
        let mut states = vec![start];
        for _ in 1..steps {
            states.push(model.step(&states[states.len() - 1], &[weight; 3], DT));
        }
        let pressed = |state: &RollState| model.contact_force(state, &weight).z > FORCE_MIN * GRAVITY_ASSUMED;
        if states.iter().all(pressed) {
            let u = states.iter().map(|state| sense(draw, sensing.noise, state.u)).collect();
            return Trial { start, end: states[states.len() - 1], u };
        }
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few hundred")]
fn readings(seconds: f64) -> usize {
    (seconds / DT).round() as usize + 1
}

fn start(draw: &mut Draw, spin: Spin) -> RollState {
    let mut normal = || draw.normal();
    let orientation = Quaternion::new(normal(), normal(), normal(), normal()).normalize();
    let omega = Vector3::new(normal(), normal(), normal()) * OMEGA_SIGMA;
    let u = Vector2::new(draw.uniform(-0.01, 0.01), draw.uniform(-0.01, 0.01));
    let mut state = RollState { orientation, omega, u };
    if spin == Spin::NoSpin {
        let normal = state.normal();
        state.omega -= normal * normal.dot(&state.omega);
    }
    state
}

fn sense(draw: &mut Draw, noise: Noise, u: Vector2<f64>) -> Vector2<f64> {
    match noise {
        Noise::Exact => u,
        Noise::Gauss(sigma) => u + Vector2::new(draw.normal(), draw.normal()) * sigma,
        Noise::Grid(pitch) => u.map(|x| (x / pitch).round() * pitch),
    }
}

fn question(bodies: Vec<RollingBody>, spins: Vec<Spin>, noise: Noise) -> RollQuestion {
    RollQuestion {
        body: BodyKnowledge::OneOf(bodies),
        spins,
        palm: PalmKnowledge::Known(PalmAcceleration::Rest),
        g: GRAVITY_ASSUMED,
        noise,
    }
}

/// An estimate with the processor time it took, ms.
fn timed(question: &RollQuestion, trial: &Trial) -> (Option<RollEstimate>, f64) {
    let begun = ProcessorTime::now();
    let estimate = question.answer(DT, &trial.u).ok();
    (estimate, begun.milliseconds())
}

/// One of the values, the upper of the two middle ones; not a number without any.
fn median(values: Vec<f64>) -> f64 {
    percentile(values, 50).unwrap_or(f64::NAN)
}

/// Attitude error at the end, modulo symmetry, degrees.
fn error_deg(body: &RollingBody, hypothesis: &RollHypothesis, trial: &Trial) -> f64 {
    body.symmetry()
        .angle(&hypothesis.end.attitude(), &trial.end.attitude())
        .to_degrees()
        .max(body.symmetry().angle(&hypothesis.start.attitude(), &trial.start.attitude()).to_degrees())
}

fn pebble(axes_cm: [f64; 3]) -> Option<RollingBody> {
    RollingBody::ellipsoid(axes_cm.map(|axis| axis * 0.01)).ok()
}

fn attitude(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "body [cm]",
        "spin",
        "window [s]",
        "noise",
        "within 2°",
        "in the list",
        "median [°]",
        "unique",
        "certified",
        "wrong unique",
        "wrong certified",
        "median [ms]",
    ]);
    table.definitions = vec![
        "Starts: uniform attitude, angular velocity N(0, 6²) rad/s per axis; drawn again where the contact carries less than \
         a tenth of the weight; 500 readings a second."
            .to_owned(),
        "Errors are the larger of those at the first and the last reading, modulo the body's symmetry; time is the \
         processor's, for one estimate without a prior."
            .to_owned(),
    ];
    let gauss = |seconds: f64| Sensing { seconds, noise: Noise::Gauss(3e-4) };
    let rows = [
        ([2.0, 3.0, 4.0], millimetre_grid(0.4)),
        ([2.0, 3.0, 4.0], millimetre_grid(0.2)),
        ([2.0, 3.0, 4.0], millimetre_grid(1.0)),
        ([2.0, 3.0, 4.0], gauss(0.4)),
        ([1.5, 3.0, 5.0], millimetre_grid(0.4)),
        ([2.9, 3.0, 3.1], millimetre_grid(0.6)),
    ];
    for (axes, sensing) in rows {
        for spin in [Spin::Free, Spin::NoSpin] {
            if let Some(body) = pebble(axes) {
                attitude_row(settings, &mut table, &body, spin, &sensing);
            }
        }
    }
    table
}

fn attitude_row(settings: &TableSettings, table: &mut Table, body: &RollingBody, spin: Spin, sensing: &Sensing) {
    let question = question(vec![body.clone()], vec![spin], sensing.noise);
    let (mut errors, mut times) = (Vec::new(), Vec::new());
    let [mut right, mut listed, mut unique, mut certified, mut wrong_unique, mut wrong_certified] = [0; 6];
    let name = format!("{} {:?} {} s {}", shape_name(body), spin, sensing.seconds, noise_name(sensing.noise));
    for case in 0..settings.cases {
        let trial = trial(&mut Draw::case(settings.seed, case), body, spin, sensing);
        let (estimate, time) = timed(&question, &trial);
        times.push(time);
        let hypotheses = estimate.as_ref().map_or(&[][..], |estimate| &estimate.hypotheses);
        let miss: Vec<f64> = hypotheses.iter().map(|hypothesis| error_deg(body, hypothesis, &trial)).collect();
        let error = miss.first().copied().unwrap_or(180.0);
        let is_right = error < RIGHT_DEG;
        errors.push(error);
        right += usize::from(is_right);
        listed += usize::from(miss.iter().any(|miss| *miss < RIGHT_DEG));
        unique += usize::from(hypotheses.len() == 1);
        wrong_unique += usize::from(hypotheses.len() == 1 && !is_right);
        let sure = estimate.as_ref().is_some_and(|estimate| estimate.certified);
        certified += usize::from(sure);
        wrong_certified += usize::from(sure && !is_right);
        if !is_right {
            let cost = estimate.as_ref().map_or(f64::NAN, |estimate| estimate.cost);
            let word = if sure { ", certified" } else { "" };
            let count = miss.len();
            table.failures.push(format!("{name}, case {case}: {error:.2}°, {count} hypotheses, cost {cost:.1}{word}"));
        }
    }
    table.push([
        shape_name(body).into(),
        format!("{spin:?}").to_lowercase().into(),
        Cell::number(sensing.seconds, 1),
        noise_name(sensing.noise).into(),
        Cell::share(right, settings.cases),
        Cell::share(listed, settings.cases),
        Cell::number(median(errors), 3),
        Cell::share(unique, settings.cases),
        Cell::share(certified, settings.cases),
        Cell::count(wrong_unique),
        Cell::count(wrong_certified),
        Cell::number(median(times), 1),
    ]);
}

fn shape_name(body: &RollingBody) -> String {
    match body.shape() {
        palpate::rolling::Shape::Ellipsoid(ellipsoid) => {
            let [a, b, c] = ellipsoid.semi_axes.map(|axis| axis * 100.0);
            format!("{a:.1}-{b:.1}-{c:.1}")
        }
        other => format!("{other:?}"),
    }
}

fn noise_name(noise: Noise) -> String {
    match noise {
        Noise::Exact => "none".to_owned(),
        Noise::Gauss(sigma) => format!("{} mm", sigma * 1e3),
        Noise::Grid(pitch) => format!("{} mm grid", pitch * 1e3),
    }
}

fn semi_axes(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "spin",
        "window [s]",
        "noise",
        "axes within 1 %",
        "median worst axis [%]",
        "unique",
        "median [ms]",
    ]);
    table.definitions = vec![
        "Semi-axes: uniform in 1.5 to 4.5 cm, no two within 8 %; the search knows 1.5 to 5 cm. Starts as in table 7."
            .to_owned(),
    ];
    for spin in [Spin::Free, Spin::NoSpin] {
        let sensing = millimetre_grid(1.0);
        let unknown = RollQuestion {
            body: BodyKnowledge::Ellipsoid { range: 0.015..=0.05 },
            ..question(Vec::new(), vec![spin], sensing.noise)
        };
        let (mut right, mut unique, mut errors, mut times) = (0, 0, Vec::new(), Vec::new());
        for case in 0..settings.cases {
            let mut draw = Draw::case(settings.seed, case);
            let axes = distinct_axes(&mut draw);
            let Ok(body) = RollingBody::ellipsoid(axes) else { continue };
            let trial = trial(&mut draw, &body, spin, &sensing);
            let (estimate, time) = timed(&unknown, &trial);
            times.push(time);
            let hypotheses = estimate.map_or_else(Vec::new, |estimate| estimate.hypotheses);
            let error = hypotheses.first().and_then(|best| best.semi_axes).map_or(1.0, |got| worst_axis(got, axes));
            right += usize::from(error < 0.01);
            unique += usize::from(hypotheses.len() == 1);
            errors.push(error * 100.0);
            if error >= 0.01 {
                let message = format!("{spin:?} case {case}: {axes:.4?} m, worst axis off by {:.2} %", error * 100.0);
                table.failures.push(message);
            }
        }
        table.push([
            format!("{spin:?}").to_lowercase().into(),
            Cell::number(sensing.seconds, 1),
            noise_name(sensing.noise).into(),
            Cell::share(right, settings.cases),
            Cell::number(median(errors), 3),
            Cell::share(unique, settings.cases),
            Cell::number(median(times), 0),
        ]);
    }
    table
}

/// m, none within 8 % of another.
fn distinct_axes(draw: &mut Draw) -> [f64; 3] {
    loop {
        let axes = [0, 1, 2].map(|_| draw.uniform(0.015, 0.045));
        let far = |a: f64, b: f64| (a / b).ln().abs() > 0.08;
        if far(axes[0], axes[1]) && far(axes[1], axes[2]) && far(axes[2], axes[0]) {
            return axes;
        }
    }
}

/// The largest relative error of an axis; the order is the estimate's own.
fn worst_axis(mut got: [f64; 3], mut wanted: [f64; 3]) -> f64 {
    got.sort_by(f64::total_cmp);
    wanted.sort_by(f64::total_cmp);
    got.iter().zip(wanted).map(|(got, wanted)| (got / wanted - 1.0).abs()).fold(0.0, f64::max)
}

fn which(settings: &TableSettings) -> Table {
    let mut table =
        Table::new(["question", "window [s]", "noise", "body right", "spin right", "both right", "median [ms]"]);
    table.definitions = vec![
        "Six ellipsoids whose semi-axes differ by 2 to 25 %, free of spin or not; the first hypothesis counts. Starts as in \
         table 7."
            .to_owned(),
    ];
    let bodies: Vec<RollingBody> = SIX.into_iter().filter_map(pebble).collect();
    for seconds in [0.3, 0.6] {
        let sensing = millimetre_grid(seconds);
        let question = question(bodies.clone(), vec![Spin::Free, Spin::NoSpin], sensing.noise);
        let ([mut body_right, mut spin_right, mut both], mut times) = ([0; 3], Vec::new());
        for case in 0..settings.cases {
            let mut draw = Draw::case(settings.seed, case);
            let index = draw.index(bodies.len());
            let spin = if draw.chance(0.5) { Spin::Free } else { Spin::NoSpin };
            let trial = trial(&mut draw, &bodies[index], spin, &sensing);
            let (estimate, time) = timed(&question, &trial);
            times.push(time);
            let first = estimate.and_then(|estimate| estimate.hypotheses.into_iter().next());
            let named = first.map(|best| (best.body, best.spin));
            body_right += usize::from(named.is_some_and(|(body, _)| body == index));
            spin_right += usize::from(named.is_some_and(|(_, named)| named == spin));
            both += usize::from(named == Some((index, spin)));
            if named != Some((index, spin)) {
                table.failures.push(format!("{seconds} s case {case}: body {index} {spin:?}, named {named:?}"));
            }
        }
        table.push([
            "body and spin".into(),
            Cell::number(seconds, 1),
            noise_name(sensing.noise).into(),
            Cell::share(body_right, settings.cases),
            Cell::share(spin_right, settings.cases),
            Cell::share(both, settings.cases),
            Cell::number(median(times), 0),
        ]);
    }
    table
}

/// One setting of the thesis's observer.
struct GhoRow {
    error_deg: f64,
    zeta: f64,
    seconds: f64,
}

fn gho(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "start off by [°]",
        "zeta [1/s]",
        "time [s]",
        "within 2°",
        "median end [°]",
        "without a change of sign",
        "of them within 2°",
    ]);
    let sensing = Sensing { seconds: 1.0, noise: Noise::Exact };
    let Some(body) = pebble(SIX[0]) else { return table };
    let (median_changes, most, share) = sign_changes(settings, &body, &sensing);
    table.definitions = vec![
        "A 2-3-4 cm ellipsoid free to spin, contacts without noise 500 times a second, steps of 2 ms. The observer inverts \
         the Jacobian by the state of the contact and its first three derivatives by time."
            .to_owned(),
        format!(
            "Its determinant changes sign {median_changes} times in a second (median; at most {most}), at all on {:.0} % of \
             {} rolls: there the correction is infinite.",
            share * 100.0,
            settings.cases
        ),
    ];
    let rows = [
        GhoRow { error_deg: 0.0, zeta: 30.0, seconds: 0.3 },
        GhoRow { error_deg: 2.0, zeta: 15.0, seconds: 0.3 },
        GhoRow { error_deg: 5.0, zeta: 15.0, seconds: 0.3 },
        GhoRow { error_deg: 0.2, zeta: 100.0, seconds: 0.2 },
    ];
    for row in rows {
        gho_row(settings, &mut table, &body, &row);
    }
    table
}

fn observer_of(body: &RollingBody, zeta: f64) -> RollGho<'_> {
    RollGho {
        model: Model { body, spin: Spin::Free },
        specific_force: specific_force(Vector3::zeros(), GRAVITY_ASSUMED),
        zeta,
    }
}

/// The states of a roll at every reading.
fn states(body: &RollingBody, trial: &Trial) -> Vec<RollState> {
    let gho = observer_of(body, 1.0);
    let steps =
        std::iter::successors(Some(trial.start), |state| Some(gho.model.step(state, &[gho.specific_force; 3], DT)));
    steps.take(trial.u.len()).collect()
}

/// Changes of the determinant's sign along a path.
fn changes(body: &RollingBody, states: &[RollState]) -> usize {
    let gho = observer_of(body, 1.0);
    let signs: Vec<bool> = states.iter().filter_map(|state| gho.determinant(state)).map(|value| value > 0.0).collect();
    signs.windows(2).filter(|pair| pair[0] != pair[1]).count()
}

/// Median and most changes of sign, and the share of rolls with any.
fn sign_changes(settings: &TableSettings, body: &RollingBody, sensing: &Sensing) -> (usize, usize, f64) {
    let count = |case: usize| {
        let trial = trial(&mut Draw::case(settings.seed, case), body, Spin::Free, sensing);
        changes(body, &states(body, &trial))
    };
    let mut counts: Vec<usize> = (0..settings.cases).map(count).collect();
    counts.sort_unstable();
    let any = counts.iter().filter(|count| **count > 0).count();
    let Cell::Share(share) = Cell::share(any, counts.len()) else { return (0, 0, 0.0) };
    (counts[counts.len() / 2], counts[counts.len() - 1], share)
}

fn gho_row(settings: &TableSettings, table: &mut Table, body: &RollingBody, row: &GhoRow) {
    let gho = observer_of(body, row.zeta);
    let sensing = Sensing { seconds: row.seconds, noise: Noise::Exact };
    let (mut errors, mut smooth, mut smooth_right, mut right) = (Vec::new(), 0, 0, 0);
    for case in 0..settings.cases {
        let mut draw = Draw::case(settings.seed, case);
        let trial = trial(&mut draw, body, Spin::Free, &sensing);
        let axis = Vector3::new(draw.normal(), draw.normal(), draw.normal()).normalize();
        let off = UnitQuaternion::from_scaled_axis(axis * row.error_deg.to_radians());
        let begun = RollState { orientation: (trial.start.attitude() * off).into_inner(), ..trial.start };
        let end = trial.u.windows(2).try_fold(begun, |state, pair| gho.step(&state, [pair[0], pair[1]], DT));
        let attitude = end.filter(|state| state.orientation.norm().is_finite()).map(|state| state.attitude());
        let angle = |attitude| body.symmetry().angle(&attitude, &trial.end.attitude()).to_degrees();
        let error = attitude.map_or(180.0, angle);
        let is_right = error < RIGHT_DEG;
        let is_smooth = changes(body, &states(body, &trial)) == 0;
        errors.push(error);
        right += usize::from(is_right);
        smooth += usize::from(is_smooth);
        smooth_right += usize::from(is_smooth && is_right);
    }
    table.push([
        Cell::number(row.error_deg, 1),
        Cell::number(row.zeta, 0),
        Cell::number(row.seconds, 1),
        Cell::share(right, settings.cases),
        Cell::number(median(errors), 2),
        Cell::count(smooth),
        Cell::share(smooth_right, smooth),
    ]);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bar for 0.4 s of a millimetre grid, on a few starts; the whole of it is table 7.
    #[test]
    fn an_attitude_is_found_from_less_than_half_a_second() {
        let body = pebble(SIX[0]).unwrap();
        for (case, spin) in (0..10).zip([Spin::Free, Spin::NoSpin].into_iter().cycle()) {
            let sensing = millimetre_grid(0.4);
            let trial = trial(&mut Draw::case(7, case), &body, spin, &sensing);
            let estimate = timed(&question(vec![body.clone()], vec![spin], sensing.noise), &trial).0.unwrap();
            let error = error_deg(&body, &estimate.hypotheses[0], &trial);
            assert!(error < RIGHT_DEG, "seed 7 case {case} {spin:?}: {error}°");
        }
    }

    /// The Cramér–Rao bound is of the size of the errors: their normalised squares average to the number of unknowns.
    #[test]
    fn the_covariance_is_that_of_the_errors() {
        let body = pebble(SIX[0]).unwrap();
        let sensing = Sensing { seconds: 0.3, noise: Noise::Gauss(3e-4) };
        let cases = 12_u32;
        let square = |case: u32| {
            let trial = trial(&mut Draw::case(11, case as usize), &body, Spin::Free, &sensing);
            let estimate = timed(&question(vec![body.clone()], vec![Spin::Free], sensing.noise), &trial).0.unwrap();
            let best = &estimate.hypotheses[0];
            let truth = body.symmetry().nearest(&best.end.attitude(), &trial.end.attitude());
            let error = (best.end.attitude().inverse() * truth).scaled_axis();
            let covariance = best.covariance.as_ref().unwrap().fixed_view::<3, 3>(0, 0).into_owned();
            (error.transpose() * covariance.try_inverse().unwrap() * error)[0]
        };
        let mean = (0..cases).map(square).sum::<f64>() / f64::from(cases);
        // Three unknowns; the mean of 12 squares of three has a standard deviation of 0.7.
        assert!((1.0..6.0).contains(&mean), "seed 11: {mean}");
    }
}
