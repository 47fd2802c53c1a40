//! Tables 6.1 and 6.2: the thesis's observer on random pushes, the edge in contact known or not; and §8.2.2: observers
//! side by side.
//!
//! The observer amplifies rounding: where the angle hardly shows the place, the ∂χ/∂x that its correction inverts is
//! nearly singular. So builds that round differently, such as debug and release, print different last digits.
//!
//! Units: SI inside; the table's headings say theirs. Errors: none.

mod figures;

use std::f64::consts::PI;

use nalgebra::{Point2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::math::statistics;
use palpate::pushing::dynamics::{ContactLaw, ContactMode, EdgeEnd, Finger, Part, Push, PushModel, Start, State};
use palpate::pushing::estimation::{Gho, GhoSettings};

pub(super) use figures::{
    BASIN, EXPERIMENT as FIGURES, FIGURE_6_1, FIGURE_6_2, FIGURE_6_3, FIGURE_6_4, basin_figures, figures,
};

use super::{Cell, Experiment, Table, TableSettings};

/// Thesis Table 6.1.
pub(super) const KNOWN_EDGE: Experiment =
    Experiment { name: "6.1", title: "the thesis's observer, contact edge known", cases: 500, run: known_edge };

/// Thesis Table 6.2.
pub(super) const UNKNOWN_EDGE: Experiment =
    Experiment { name: "6.2", title: "the thesis's observer, contact edge unknown", cases: 500, run: unknown_edge };

/// The observers compared, after thesis §8.2.2.
pub(super) const SIDE_BY_SIDE: Experiment = Experiment {
    name: "8.2.2",
    title: "the thesis's observers side by side, from several starts and with several gains",
    cases: 500,
    run: side_by_side,
};

/// Step of the observer and of the data, s (thesis ch. 6).
const STEP: f64 = 0.01;

/// Steps of the simulated truth in one of the observer's.
const FINE: usize = 4;

/// Longest observation, in steps: 2 s (thesis §6.1, footnote 6).
const STEPS_MAX: usize = 200;

/// Steps for which the difference must stay negligible: 0.2 s (footnote 5).
const HELD: usize = 20;

/// Steps with correction where the edge is unknown: 0.8 s, about the mean time to convergence (footnote 7).
const CORRECTED: usize = 80;

/// Steps for which the contact must last where the edge is unknown, 1 s: otherwise nothing is left to tell edges apart.
const LASTING: usize = 100;

/// Negligible differences, the thesis does not give its own: 0.5° in u, 1 mm in s, 0.05 rad/s, 2 mm/s.
const NEGLIGIBLE: State = State { u: PI / 360.0, s: 1e-3, omega: 0.05, v_t: 2e-3 };

/// ζ of the thesis, 1/s.
const ZETA: f64 = 10.0;

/// One random push and how it goes.
struct Case {
    part: Part,
    edge: usize,
    finger: Finger,
    contact: ContactMode,
    /// At 0, STEP, …, while the contact lasts on its edge.
    truth: Vec<State>,
    draw: Draw,
}

/// An observer: which edge it takes to be in contact, where it starts, and its gain.
#[derive(Clone, Copy)]
struct Attempt {
    edge: usize,
    start: State,
    zeta: f64,
}

/// What came of observers side by side.
enum Choice {
    Right,
    WrongPlace,
    WrongEdge,
    Diverged,
}

impl Case {
    /// The first push of the sequence whose contact lasts for `steps`.
    fn new(seed: u64, case: usize, contact: ContactMode, acceleration: f64, steps: usize) -> Self {
        let mut draw = Draw::case(seed, case);
        loop {
            let part = Part::uniform(polygon(&mut draw));
            let edge = draw.index(part.polygon().vertices().len());
            let finger = Finger {
                radius: 0.01,
                centre0: Point2::origin(),
                velocity0: Vector2::new(0.0, 0.05),
                acceleration: Vector2::new(0.0, acceleration),
            };
            let Some(start) = state(&part, edge, &mut draw) else { continue };
            let mut case = Self { part, edge, finger, contact, truth: Vec::new(), draw };
            case.truth = case.simulated(start);
            if case.truth.len() > steps {
                return case;
            }
            draw = case.draw;
        }
    }

    fn model(&self, edge: usize) -> Option<PushModel<'_>> {
        let edge = self.part.edge(edge).ok()?;
        Some(PushModel { part: &self.part, edge, mu_g: 0.3 * GRAVITY_ASSUMED, finger: self.finger })
    }

    /// States while finger and part touch on the edge; none if they cannot at the start.
    fn simulated(&self, start: State) -> Vec<State> {
        let Some(model) = self.model(self.edge) else { return Vec::new() };
        let law = match self.contact {
            ContactMode::Rolling => ContactLaw::Rolling { friction: None },
            _ => ContactLaw::Frictionless,
        };
        let start = match self.contact {
            ContactMode::Rolling => State { v_t: model.rolling_v_t(0.0, &start), ..start },
            _ => start,
        };
        if Push::new(model, law, Start::Moving(start), EdgeEnd::Stop).is_err() {
            return Vec::new();
        }
        let lasts = |&(index, state): &(usize, State)| {
            let time = STEP * index as f64 / FINE as f64;
            let on_edge = (model.edge.s_min..=model.edge.s_max).contains(&state.s);
            on_edge && model.motion(&self.contact, time, &state).normal_force > 0.0
        };
        let fine = std::iter::once(start).chain(model.rollout(&self.contact, &start, STEP / FINE as f64));
        let lasting = fine.enumerate().take_while(lasts).take(STEPS_MAX * FINE + 1);
        lasting
            .step_by(FINE)
            .map(|(index, state)| match self.contact {
                ContactMode::Rolling => {
                    State { v_t: model.rolling_v_t(STEP * index as f64 / FINE as f64, &state), ..state }
                }
                _ => state,
            })
            .collect()
    }

    /// The estimates of an observer from step `from` on, each set back to its range; until one is not finite.
    fn observed(&self, attempt: Attempt, corrected: usize) -> Vec<State> {
        let Some(model) = self.model(attempt.edge) else { return Vec::new() };
        let observer = Gho { model, contact: self.contact, settings: GhoSettings::new(attempt.zeta) };
        let mut estimates = vec![attempt.start];
        for (index, pair) in self.truth.windows(2).enumerate() {
            let (time, estimate) = (STEP * index as f64, &estimates[index]);
            let next = if index < corrected {
                observer.step(time, estimate, [pair[0].u, pair[1].u], STEP)
            } else {
                observer.step_towards(time, estimate, None, STEP)
            };
            if ![next.u, next.s, next.omega, next.v_t].into_iter().all(f64::is_finite) {
                break;
            }
            estimates.push(observer.set_back(&next));
        }
        estimates
    }

    /// The step from which on the estimate is as good as the truth for long enough.
    fn converged(&self, attempt: Attempt) -> Option<usize> {
        let estimates = self.observed(attempt, STEPS_MAX);
        let near: Vec<_> = estimates.iter().zip(&self.truth).map(|(a, b)| self.negligible(a, b)).collect();
        near.windows(HELD + 1).position(|stretch| stretch.iter().all(|near| *near))
    }

    fn negligible(&self, a: &State, b: &State) -> bool {
        let v_t = self.contact == ContactMode::Rolling || (a.v_t - b.v_t).abs() < NEGLIGIBLE.v_t;
        let [u, s, omega] = [a.u - b.u, a.s - b.s, a.omega - b.omega].map(f64::abs);
        u < NEGLIGIBLE.u && s < NEGLIGIBLE.s && omega < NEGLIGIBLE.omega && v_t
    }

    /// A random estimate on an edge.
    fn estimate(&mut self, edge: usize) -> Option<State> {
        state(&self.part, edge, &mut self.draw)
    }

    /// Which of several observers keeps following the contact longest once the correction is off.
    fn chosen(&self, attempts: &[Attempt]) -> Choice {
        let followed = |attempt: &Attempt| {
            let estimates = self.observed(*attempt, CORRECTED);
            let deviation =
                |index: usize| estimates.get(index).map(|estimate| (estimate.u - self.truth[index].u).abs());
            let follows = |&index: &usize| deviation(index).is_some_and(|deviation| deviation < NEGLIGIBLE.u);
            let steps = (CORRECTED..self.truth.len()).take_while(follows).count();
            let sum: f64 = (CORRECTED..CORRECTED + steps).filter_map(deviation).map(|d| d * d).sum();
            let end =
                steps.checked_sub(1).and_then(|last| estimates.get(CORRECTED + last).map(|e| (CORRECTED + last, *e)));
            (steps, sum, attempt.edge, end)
        };
        let mut runs: Vec<_> = attempts.iter().map(followed).collect();
        runs.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)));
        match runs.first() {
            Some((_, _, edge, Some(_))) if *edge != self.edge => Choice::WrongEdge,
            Some((_, _, _, Some((at, end)))) if (end.s - self.truth[*at].s).abs() < NEGLIGIBLE.s => Choice::Right,
            Some((_, _, _, Some(_))) => Choice::WrongPlace,
            _ => Choice::Diverged,
        }
    }
}

/// Three to eleven edges, a few centimetres across; three of five are convex.
fn polygon(draw: &mut Draw) -> SimplePolygon {
    let vertices = 3 + draw.index(9);
    if draw.chance(0.6) {
        draw.convex_polygon(vertices + 2, 0.05)
    } else {
        draw.star_polygon(vertices.max(4), 0.02, 0.05)
    }
}

/// Uniform in the thesis's ranges: u in 80° to 100°, s on the edge, |ω| ≤ 1 rad/s, |v_T| ≤ 0.4 cm/s.
fn state(part: &Part, edge: usize, draw: &mut Draw) -> Option<State> {
    let seen = part.edge(edge).ok()?;
    let degree = PI / 180.0;
    Some(State {
        u: draw.uniform(80.0 * degree, 100.0 * degree),
        s: draw.uniform(seen.s_min, seen.s_max),
        omega: draw.uniform(-1.0, 1.0),
        v_t: draw.uniform(-0.004, 0.004),
    })
}

/// A row of the thesis's tables: contact, the finger's acceleration in m/s², and what the thesis found.
struct Row<T> {
    contact: ContactMode,
    acceleration: f64,
    thesis: T,
}

impl<T> Row<T> {
    fn name(&self) -> String {
        let contact = if self.contact == ContactMode::Rolling { "rolling" } else { "frictionless" };
        format!("{contact}, aF {} cm/s²", self.acceleration * 100.0)
    }
}

fn rows<T>([a, b, c, d]: [T; 4]) -> [Row<T>; 4] {
    let row = |contact: ContactMode, acceleration: f64, thesis: T| Row { contact, acceleration, thesis };
    [
        row(ContactMode::Frictionless, 0.0, a),
        row(ContactMode::Frictionless, 0.025, b),
        row(ContactMode::Rolling, 0.0, c),
        row(ContactMode::Rolling, 0.025, d),
    ]
}

const DRAWN: &str = "Drawn: hulls of random points and star-shaped polygons, 3 to 11 edges, up to 10 cm across (the thesis walked on random lines); µ 0.3, disk of 1 cm at 5 cm/s; state and estimate uniform in u 80° to 100°, s on the edge, |ω| ≤ 1 rad/s, |vT| ≤ 0.4 cm/s.";
const RUN: &str = "Observer: ζ 10, correction on 0.06 s and off 0.04 s, RK4 at 0.01 s; beyond its range (s: the edge, |ω| 10 rad/s, |vT| 20 cm/s) the estimate is set back to it.";

fn known_edge(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "contact",
        "thesis ok",
        "thesis time s",
        "cases",
        "ok",
        "contact left",
        "ok of the others",
        "time s",
    ]);
    table.definitions = [
        DRAWN,
        RUN,
        "ok: all differences negligible (u 0.5°, s 1 mm, ω 0.05 rad/s, vT 0.2 cm/s) for 0.2 s within 2 s; time: when these 0.2 s are over.",
        "contact left: not ok, and the true contact broke or left its edge within the 2 s; such cases stay in.",
    ]
    .map(str::to_owned)
    .to_vec();
    for row in rows([(0.84, 0.776), (0.88, 0.738), (0.914, 0.965), (0.912, 0.939)]) {
        let (mut times, mut left) = (Vec::new(), 0);
        for index in 0..settings.cases {
            let mut case = Case::new(settings.seed, index, row.contact, row.acceleration, 0);
            let steps = case
                .estimate(case.edge)
                .and_then(|start| case.converged(Attempt { edge: case.edge, start, zeta: ZETA }));
            match steps {
                Some(steps) => times.push(STEP * (steps + HELD) as f64),
                None if case.truth.len() <= STEPS_MAX => left += 1,
                None => table.failures.push(format!("{}, case {index}", row.name())),
            }
        }
        let ok = times.len();
        table.push([
            row.name().into(),
            Cell::Share(row.thesis.0),
            Cell::number(row.thesis.1, 2),
            Cell::count(settings.cases),
            Cell::share(ok, settings.cases),
            Cell::share(left, settings.cases),
            Cell::share(ok, settings.cases - left),
            mean(&times, 2),
        ]);
    }
    table
}

fn unknown_edge(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "contact",
        "thesis ok",
        "thesis place/edge/diverged",
        "cases",
        "ok",
        "wrong place",
        "wrong edge",
        "diverged",
    ]);
    table.definitions = [
        DRAWN,
        RUN,
        "One observer an edge, each from a random place on it, 0.8 s with correction, then without until 2 s or the end of the contact (which lasts 1 s or more).",
        "Chosen: the one whose u stays within 0.5° of the felt one longest, of equals the nearest. ok: its edge is right and s within 1 mm; diverged: none follows at all.",
    ]
    .map(str::to_owned)
    .to_vec();
    for row in
        rows([(0.52, "9/8/7 of 50"), (0.52, "9/9/6 of 50"), (0.588, "32/122/52 of 500"), (0.574, "35/129/49 of 500")])
    {
        let counts = choices(settings, &row, &mut table.failures, |case, edge| {
            case.estimate(edge).map(|start| vec![Attempt { edge, start, zeta: ZETA }]).unwrap_or_default()
        });
        let [ok, place, edge, diverged] = counts.map(|count| Cell::share(count, settings.cases));
        let thesis = [Cell::Share(row.thesis.0), row.thesis.1.into(), Cell::count(settings.cases)];
        table.push([Cell::from(row.name())].into_iter().chain(thesis).chain([ok, place, edge, diverged]));
    }
    table
}

/// How many choices were right, wrong in place, wrong in edge, and none, with observers on every edge.
fn choices<T>(
    settings: &TableSettings,
    row: &Row<T>,
    failures: &mut Vec<String>,
    mut attempts: impl FnMut(&mut Case, usize) -> Vec<Attempt>,
) -> [usize; 4] {
    let mut counts = [0; 4];
    for index in 0..settings.cases {
        let mut case = Case::new(settings.seed, index, row.contact, row.acceleration, LASTING);
        let edges = case.part.polygon().vertices().len();
        let all: Vec<_> = (0..edges).flat_map(|edge| attempts(&mut case, edge)).collect();
        let (slot, what) = match case.chosen(&all) {
            Choice::Right => (0, None),
            Choice::WrongPlace => (1, Some("wrong place")),
            Choice::WrongEdge => (2, Some("wrong edge")),
            Choice::Diverged => (3, Some("diverged")),
        };
        counts[slot] += 1;
        failures.extend(what.map(|what| format!("{}, case {index}: {what}", row.name())));
    }
    counts
}

/// Shares of an edge at which observers start, and their gains.
const STARTS: [&[f64]; 3] = [&[0.5], &[0.2, 0.5, 0.8], &[0.1, 0.3, 0.5, 0.7, 0.9]];
const GAINS: [&[f64]; 2] = [&[10.0], &[3.0, 5.0, 10.0]];

fn side_by_side(settings: &TableSettings) -> Table {
    let mut table =
        Table::new(["observers an edge", "contact", "cases", "ok", "wrong place", "wrong edge", "diverged"]);
    table.definitions = [
        DRAWN,
        RUN,
        "As table 6.2, but on each edge observers start from several places at once, u at the felt one and without motion, and with several gains ζ.",
    ]
    .map(str::to_owned)
    .to_vec();
    for (starts, gains) in [(0, 0), (1, 0), (2, 0), (1, 1)] {
        for row in rows([(); 4]).into_iter().filter(|row| row.acceleration == 0.0) {
            let counts = choices(settings, &row, &mut Vec::new(), |case, edge| {
                let Some(seen) = case.part.edge(edge).ok() else { return Vec::new() };
                let start = |share: f64| State {
                    u: case.truth[0].u,
                    s: seen.s_min + share * (seen.s_max - seen.s_min),
                    omega: 0.0,
                    v_t: 0.0,
                };
                let pairs =
                    STARTS[starts].iter().flat_map(|&share| GAINS[gains].iter().map(move |&zeta| (share, zeta)));
                pairs.map(|(share, zeta)| Attempt { edge, start: start(share), zeta }).collect()
            });
            let observers = format!("{} starts × {} gains", STARTS[starts].len(), GAINS[gains].len());
            let shares = counts.map(|count| Cell::share(count, settings.cases));
            table.push([observers.into(), row.name().into(), Cell::count(settings.cases)].into_iter().chain(shares));
        }
    }
    table
}

fn mean(values: &[f64], decimals: usize) -> Cell {
    statistics::mean(values).map_or(Cell::Empty, |mean| Cell::number(mean, decimals))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Few cases, so that the tests stay quick; the full tables are `palpate tables 6.1 6.2`.
    const SETTINGS: TableSettings = TableSettings { cases: 12, seed: 1, jobs: None };

    fn share(cell: &Cell) -> f64 {
        match cell {
            Cell::Share(share) => *share,
            other => panic!("{other:?} is no share"),
        }
    }

    #[test]
    fn with_a_known_edge_most_pushes_are_observed() {
        let table = known_edge(&SETTINGS);
        let rows: Vec<_> = table.rows().collect();
        assert_eq!(rows.len(), 4);
        // 12 cases of 70 to 90 %: fewer than half would be a broken observer.
        assert!(rows.iter().all(|row| share(&row[4]) > 0.5), "{table}");
    }

    #[test]
    fn every_case_of_an_unknown_edge_is_counted_once() {
        let table = unknown_edge(&SETTINGS);
        for row in table.rows() {
            assert!((row[4..].iter().map(share).sum::<f64>() - 1.0).abs() < 1e-12, "{table}");
        }
        let failed: f64 = table.rows().map(|row| 1.0 - share(&row[4])).sum();
        assert!((failed * 12.0 - table.failures.len() as f64).abs() < 0.5, "{table}");
    }
}
