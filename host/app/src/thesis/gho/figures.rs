//! Figures 6.1 to 6.4: the thesis's observer follows one push, without friction at the finger and with so much that the part
//! rolls.
//!
//! The thesis prints neither its two polygons nor where its pushes began; it prints how many edges they have, from where to
//! where the edge in contact reaches, how far apart truth and estimate were, and for how long the push went. Polygons and
//! starts with just that are drawn until the observer follows one, as the thesis's did.
//!
//! Implements: figures 6.1, 6.2 (rolling) and 6.3, 6.4 (frictionless). *Misprint*: the range of s under figure 6.4 is that
//! of figure 6.2; having no other, it is taken. Units: SI. Errors: none; a seed that draws no such push has no figure.

use std::f64::consts::PI;

use nalgebra::{Point2, Rotation2, Vector2};
use palpate::geometry::{Pose, SimplePolygon};
use palpate::math::random::Draw;
use palpate::pushing::dynamics::{ContactMode, Finger, Part, State};

use super::{Attempt, Case, Cell, Experiment, NEGLIGIBLE, STEP, STEPS_MAX, Table, TableSettings, ZETA, state};
use crate::pictures::observer::{Moment, ObserverPicture};
use crate::pictures::plot::{Chart, Colour, Figure};
use crate::thesis::figures::{Illustration, captioned};

/// The pushes of figures 6.1 to 6.4.
pub(in crate::thesis) const EXPERIMENT: Experiment = Experiment {
    name: "6",
    title: "figures 6.1 to 6.4: the thesis's observer follows a push; with --plot they are drawn",
    cases: 5000,
    run,
};

/// Where the edge in contact begins and ends, from below the centre of mass, m.
const EDGE: [f64; 2] = [-0.0582, 0.0290];

/// The thesis's disk and its speed, m and m/s.
const RADIUS: f64 = 0.01;
/// See [`RADIUS`].
const SPEED: f64 = 0.05;

/// Parts that reach farther are redrawn, m: the thesis's are some 12 cm across.
const ACROSS_MAX: f64 = 0.14;

/// Parts thinner than this share of their edge are redrawn: what is not seen from above is no picture.
const THICK_MIN: f64 = 0.5;

/// Truth and estimate must be one for so long at the end, in steps.
const FOLLOWED: usize = 10;

/// Steps from one snapshot to the next: 0.1 s.
const SNAPSHOT: usize = 10;

/// What the thesis says of a pair of figures.
struct Printed {
    /// Scene, and the states over time.
    figures: [&'static str; 2],
    vertices: usize,
    contact: ContactMode,
    /// Steps of the push.
    steps: usize,
    /// Of the contact and its estimate, at the start, m.
    apart: f64,
    /// When the error was negligible, s.
    followed_s: f64,
}

const PRINTED: [Printed; 2] = [
    Printed {
        figures: ["6.1", "6.2"],
        vertices: 7,
        contact: ContactMode::Rolling,
        steps: 71,
        apart: 0.045,
        followed_s: 0.56,
    },
    Printed {
        figures: ["6.3", "6.4"],
        vertices: 5,
        contact: ContactMode::Frictionless,
        steps: 60,
        apart: 0.0784,
        followed_s: 0.5,
    },
];

/// Gains, and first guesses of the place, of the basin: how many along the edge, and up to which angular velocity off.
const GAINS: [f64; 10] = [2.0, 4.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0, 80.0];
/// See [`GAINS`].
const GUESSES: u32 = 60;
/// See [`GAINS`], rad/s.
const OMEGAS_OFF: [f64; 3] = [0.0, 0.5, 1.0];

/// How local the observer is, for the push of figure 6.1.
pub(in crate::thesis) const BASIN: Experiment = Experiment {
    name: "basin",
    title: "first guesses from which the thesis's observer follows the 7-gon of figure 6.1, by gain",
    cases: 5000,
    run: basin,
};

/// A push that the observer follows.
struct Followed {
    case: Case,
    /// One a step, beside the truth.
    estimates: Vec<State>,
    /// From which step on nothing distinguishes them.
    since: usize,
    /// Pushes that lasted before it and that the observer did not follow.
    not_followed: usize,
}

impl Printed {
    /// The first push of a seed that lasts and is followed, of so many drawn.
    fn drawn(&self, seed: u64, cases: usize) -> Option<Followed> {
        let mut not_followed = 0;
        for number in 0..cases {
            let Some((case, start)) = self.case(seed, number) else { continue };
            let attempt = Attempt { edge: case.edge, start, zeta: ZETA };
            let estimates = case.observed(attempt, STEPS_MAX);
            let is_near = |step: &usize| {
                estimates.get(*step).is_some_and(|estimate| case.negligible(estimate, &case.truth[*step]))
            };
            let apart = (0..=self.steps).rev().find(|step| !is_near(step));
            let since = apart.map_or(0, |last| last + 1);
            if since + FOLLOWED <= self.steps {
                return Some(Followed { case, estimates, since, not_followed });
            }
            not_followed += 1;
        }
        None
    }

    /// A push that lasts, and an estimate that is as far off as the thesis's.
    fn case(&self, seed: u64, number: usize) -> Option<(Case, State)> {
        let mut draw = Draw::case(seed, number);
        let part = Part::uniform(polygon(&mut draw, self.vertices)?);
        let edge = 0;
        let (truth, estimate) = (state(&part, edge, &mut draw)?, state(&part, edge, &mut draw)?);
        let beside = [truth.s + self.apart, truth.s - self.apart];
        let s = beside.into_iter().find(|s| (EDGE[0]..=EDGE[1]).contains(s))?;
        let velocity0 = Vector2::new(0.0, SPEED);
        let finger = Finger { radius: RADIUS, centre0: Point2::origin(), velocity0, acceleration: Vector2::zeros() };
        let mut case = Case { part, edge, finger, contact: self.contact, truth: Vec::new(), draw };
        case.truth = case.simulated(truth);
        if case.truth.len() <= self.steps {
            return None;
        }
        case.truth.truncate(self.steps + 1);
        Some((case, State { s, ..estimate }))
    }
}

/// A convex polygon whose edge 0 is [`EDGE`], below the centre of mass at the origin of s; none where what was drawn is too
/// large or too thin.
fn polygon(draw: &mut Draw, vertices: usize) -> Option<SimplePolygon> {
    let drawn = draw.convex_polygon(2 * vertices, 1.0);
    let corners = drawn.vertices();
    if corners.len() != vertices {
        return None;
    }
    let first = draw.index(vertices);
    let (from, to) = (corners[first], corners[(first + 1) % vertices]);
    let along = to - from;
    let turn = Rotation2::rotation_between(&along, &Vector2::x());
    let size = (EDGE[1] - EDGE[0]) / along.norm();
    let laid = (0..vertices).map(|k| turn * (corners[(first + k) % vertices] - from) * size);
    let laid: Vec<_> = laid.map(|corner| Point2::from(corner + Vector2::new(EDGE[0], 0.0))).collect();
    // Sheared along the edge, which stays where it is, until the centre of mass stands over the origin.
    let centre = Part::uniform(SimplePolygon::new(laid.clone()).ok()?).centre_of_mass();
    let sheared: Vec<_> = laid.iter().map(|p| Point2::new(p.x - p.y * centre.x / centre.y, p.y)).collect();
    let reach = |of: fn(&Point2<f64>) -> f64| {
        let values = || sheared.iter().map(of);
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    let (across, thick) = (reach(|p| p.x).max(reach(|p| p.y)), reach(|p| p.y));
    let is_sound = across <= ACROSS_MAX && thick >= THICK_MIN * (EDGE[1] - EDGE[0]);
    is_sound.then(|| SimplePolygon::new(sheared).ok())?
}

fn run(settings: &TableSettings) -> Table {
    table_of(&PRINTED, settings)
}

/// Figures 6.1 to 6.4, each by itself.
pub(in crate::thesis) const FIGURE_6_1: Illustration = Illustration {
    name: "figure-6.1",
    title: "the thesis's observer follows a 7-gon that rolls on the disk",
    cases: EXPERIMENT.cases,
    make: |settings| illustrated(settings, 0, 0),
};
/// See [`FIGURE_6_1`].
pub(in crate::thesis) const FIGURE_6_2: Illustration = Illustration {
    name: "figure-6.2",
    title: "states and estimates of figure 6.1",
    cases: EXPERIMENT.cases,
    make: |settings| illustrated(settings, 0, 1),
};
/// See [`FIGURE_6_1`].
pub(in crate::thesis) const FIGURE_6_3: Illustration = Illustration {
    name: "figure-6.3",
    title: "the thesis's observer follows a 5-gon that slides on the disk without friction",
    cases: EXPERIMENT.cases,
    make: |settings| illustrated(settings, 1, 0),
};
/// See [`FIGURE_6_1`].
pub(in crate::thesis) const FIGURE_6_4: Illustration = Illustration {
    name: "figure-6.4",
    title: "states and estimates of figure 6.3",
    cases: EXPERIMENT.cases,
    make: |settings| illustrated(settings, 1, 1),
};

/// One figure of a pair, with the row of the pair.
fn illustrated(settings: &TableSettings, pair: usize, which: usize) -> (Table, Figure) {
    let printed = &PRINTED[pair];
    let table = table_of(std::slice::from_ref(printed), settings);
    let pictures = printed.drawn(settings.seed, settings.cases).map(|followed| printed.pictures(&followed));
    let picture = pictures.and_then(|pictures| pictures.into_iter().nth(which));
    let none = || captioned(&format!("Figure {}", printed.figures[which]), [760.0, 100.0], "No push was followed.");
    (table, picture.map_or_else(none, |(_, figure)| figure))
}

fn table_of(pairs: &[Printed], settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "figures",
        "thesis apart cm",
        "apart cm",
        "thesis one after s",
        "one after s",
        "s apart at the end mm",
        "not followed before",
    ]);
    table.definitions = [
        format!("Drawn: convex polygons of 7 and 5 edges whose edge in contact reaches from {:.2} to {:.2} cm, as printed (the thesis does not give its polygons); µ 0.3, disk of 1 cm at 5 cm/s for 0.71 and 0.6 s; u 80° to 100°, |ω| ≤ 1 rad/s, |vT| ≤ 0.4 cm/s; s and its estimate as far apart as printed. The first push of the seed is shown that lasts so long and that the observer follows.", 100.0 * EDGE[0], 100.0 * EDGE[1]),
        super::RUN.to_owned(),
        format!("one after: from then to the end u, s, ω and vT are within {:.1}°, {:.0} mm, {} rad/s and {:.1} cm/s. not followed before: pushes that lasted, and that the observer had not found 0.1 s before their end.", NEGLIGIBLE.u.to_degrees(), 1e3 * NEGLIGIBLE.s, NEGLIGIBLE.omega, 1e2 * NEGLIGIBLE.v_t),
    ]
    .to_vec();
    for printed in pairs {
        let name = format!("{}, {}", printed.figures[0], printed.figures[1]);
        let Some(followed) = printed.drawn(settings.seed, settings.cases) else {
            table.failures.push(format!("{name}: of {} drawn none was followed", settings.cases));
            continue;
        };
        let (truth, estimates) = (&followed.case.truth, &followed.estimates);
        let apart = |step: usize| (truth[step].s - estimates[step].s).abs();
        table.push([
            name.into(),
            Cell::number(100.0 * printed.apart, 2),
            Cell::number(100.0 * apart(0), 2),
            Cell::number(printed.followed_s, 2),
            Cell::number(STEP * followed.since as f64, 2),
            Cell::number(1e3 * apart(printed.steps), 2),
            Cell::count(followed.not_followed),
        ]);
    }
    table
}

/// Of one gain and one error of ω at first, the guesses of s (m) with whether the observer comes to follow from there.
fn guesses(printed: &Printed, case: &Case, zeta: f64, omega_off: f64) -> Vec<(f64, bool)> {
    let inside = 0.02 * (EDGE[1] - EDGE[0]);
    (0..GUESSES)
        .map(|k| {
            let share = f64::from(k) / f64::from(GUESSES - 1);
            let s = EDGE[0] + inside + share * (EDGE[1] - EDGE[0] - 2.0 * inside);
            let truth = case.truth[0];
            let start = State { s, omega: truth.omega + omega_off, ..truth };
            let estimates = case.observed(Attempt { edge: case.edge, start, zeta }, STEPS_MAX);
            let is_near =
                |step: usize| estimates.get(step).is_some_and(|estimate| case.negligible(estimate, &case.truth[step]));
            (s, (printed.steps + 1 - FOLLOWED..=printed.steps).all(is_near))
        })
        .collect()
}

fn basin(settings: &TableSettings) -> Table {
    let mut table = Table::new(["gain ζ 1/s", "ω right", "ω 0.5 rad/s off", "ω 1 rad/s off", "farthest s off mm"]);
    table.definitions = [
        format!("The push of figure 6.1 (its 7-gon, drawn from the seed). First guesses: u right, s at {GUESSES} places along the edge, ω off by so much. Share of them from which u, s and ω are right for the last {:.1} s of the push of {:.2} s; a larger gain goes faster. farthest: the largest error of s from which it follows, ω right.", STEP * FOLLOWED as f64, STEP * PRINTED[0].steps as f64),
        super::RUN.to_owned(),
    ]
    .to_vec();
    let printed = &PRINTED[0];
    let Some(followed) = printed.drawn(settings.seed, settings.cases) else {
        table.failures.push(format!("of {} drawn none was followed", settings.cases));
        return table;
    };
    let case = &followed.case;
    for zeta in GAINS {
        let found = OMEGAS_OFF.map(|off| guesses(printed, case, zeta, off));
        let share = |found: &[(f64, bool)]| Cell::share(found.iter().filter(|guess| guess.1).count(), found.len());
        let farthest =
            found[0].iter().filter(|guess| guess.1).map(|guess| (guess.0 - case.truth[0].s).abs()).fold(0.0, f64::max);
        table.push([
            Cell::number(zeta, 0),
            share(&found[0]),
            share(&found[1]),
            share(&found[2]),
            Cell::number(1e3 * farthest, 1),
        ]);
    }
    table
}

/// Which first guesses lead to the truth, by gain.
pub(in crate::thesis) fn basin_figures(settings: &TableSettings) -> Vec<(String, Figure)> {
    let printed = &PRINTED[0];
    let Some(followed) = printed.drawn(settings.seed, settings.cases) else { return Vec::new() };
    let caption = "Each dot is a first guess of the place on the edge (across) with a gain (up): blue, the observer follows the 7-gon of figure 6.1 in the end; red, it does not. See that gains below 8 are too slow for 0.71 s; from there on every place on the edge will do, for the estimate is set back to it.";
    let mut chart = Chart::new("", ["first guess of s [mm]", "gain ζ [1/s]"]);
    for (follows, name, colour) in [(true, "follows", Colour::BLUE), (false, "does not", Colour::VERMILLION)] {
        let dots: Vec<_> = GAINS
            .iter()
            .flat_map(|&zeta| {
                guesses(printed, &followed.case, zeta, 0.0).into_iter().map(move |(s, is_near)| (s, zeta, is_near))
            })
            .filter(|(.., is_near)| *is_near == follows)
            .map(|(s, zeta, _)| [1e3 * s, zeta])
            .collect();
        chart.dots(name, &dots, colour);
    }
    chart.instant(1e3 * followed.case.truth[0].s, "true");
    let figure = captioned("How local is the thesis's observer?", [760.0, 440.0], caption);
    vec![("basin".to_owned(), figure.column(1.0, vec![chart.into()]))]
}

/// The figures of a seed with their names.
pub(in crate::thesis) fn figures(settings: &TableSettings) -> Vec<(String, Figure)> {
    let pictures = PRINTED.iter().filter_map(|printed| {
        let followed = printed.drawn(settings.seed, settings.cases)?;
        Some((printed, followed))
    });
    pictures.flat_map(|(printed, followed)| printed.pictures(&followed)).collect()
}

impl Printed {
    fn pictures(&self, followed: &Followed) -> [(String, Figure); 2] {
        let case = &followed.case;
        let moment = |step: usize| {
            let (time, truth, estimate) = (STEP * step as f64, case.truth[step], followed.estimates[step]);
            Moment {
                time,
                finger: case.finger.centre(time),
                truth,
                estimate,
                pose: pose(case, time, &truth),
                believed: pose(case, time, &estimate),
            }
        };
        let moments: Vec<_> = (0..=self.steps).map(moment).collect();
        let mut snapshots: Vec<_> = (0..=self.steps).step_by(SNAPSHOT).collect();
        if !self.steps.is_multiple_of(SNAPSHOT) {
            snapshots.push(self.steps);
        }
        let is_rolling = self.contact == ContactMode::Rolling;
        let part = format!("{}-gon", self.vertices);
        let how = if is_rolling { "rolls on it" } else { "slides on it without friction" };
        let seconds = STEP * self.steps as f64;
        let one = STEP * followed.since as f64;
        let apart = 100.0 * (case.truth[0].s - followed.estimates[0].s).abs();
        let setting = format!(
            "A disk of 1 cm at 5 cm/s pushes a {part} that {how}, for {seconds:.2} s; µ 0.3 on the table; ζ 10, correction on for 0.06 s, off for 0.04 s."
        );
        let [scene, states] = self.figures;
        let picture = ObserverPicture {
            part: &case.part,
            edge: EDGE,
            radius: RADIUS,
            moments: &moments,
            snapshots: &snapshots,
            has_slip: !is_rolling,
            one,
        };
        let of_scene = [
            setting.clone(),
            "Left what happens, right what the observer believes, which feels only where on the disk the contact is (dots), every 0.1 s. See the part on the".to_owned(),
            format!(
                "right begin {apart:.2} cm along its edge from where it is, slip along until {one:.2} s, and from then on move as the left one does."
            ),
        ];
        let of_states = [
            setting,
            format!(
                "Truth (lines) and estimate (dashed). See u, which is felt, come together at once, ω{} soon after, and the place s last: from {one:.2} s on nothing",
                if is_rolling { "" } else { " and vT" }
            ),
            "tells them apart. Where the estimate of s runs along the end of the edge it was set back to it."
                .to_owned(),
        ];
        [
            (
                format!("figure-{scene}"),
                picture.scenes(format!("Figure {scene}: the observer follows a {part}"), &of_scene),
            ),
            (
                format!("figure-{states}"),
                picture.states(format!("Figure {states}: states and estimates of figure {scene}"), &of_states),
            ),
        ]
    }
}

/// The part at a state on its edge.
fn pose(case: &Case, time: f64, state: &State) -> Pose {
    let Some(model) = case.model(case.edge) else { return Pose { x: f64::NAN, y: f64::NAN, theta: f64::NAN } };
    let theta = state.u + PI - model.edge.normal.y.atan2(model.edge.normal.x);
    let origin = model.centre_of_mass(time, state) - Rotation2::new(theta) * case.part.centre_of_mass().coords;
    Pose { x: origin.x, y: origin.y, theta }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn drawn_polygons_have_the_printed_edge() {
        let mut draw = Draw::case(1, 0);
        for vertices in [5, 7].repeat(20) {
            let Some(polygon) = polygon(&mut draw, vertices) else { continue };
            let part = Part::uniform(polygon);
            let edge = part.edge(0).unwrap();
            assert!((edge.s_min - EDGE[0]).abs() < 1e-9 && (edge.s_max - EDGE[1]).abs() < 1e-9, "{edge:?}");
            assert_eq!(part.polygon().vertices().len(), vertices);
        }
    }

    /// The disk touches the part where the state says, in the picture too.
    #[test]
    fn poses_of_the_picture_touch_the_disk() {
        let printed = &PRINTED[0];
        let followed = printed.drawn(1, EXPERIMENT.cases).unwrap();
        let case = &followed.case;
        for (step, estimate) in followed.estimates.iter().enumerate().take(printed.steps) {
            let time = STEP * step as f64;
            let pose = pose(case, time, estimate).isometry();
            let vertices = case.part.polygon().vertices();
            let (from, to) = (pose * vertices[0], pose * vertices[1]);
            let touched = from + (to - from).normalize() * (estimate.s - EDGE[0]);
            let on_disk = case.finger.centre(time) + Vector2::new(estimate.u.cos(), estimate.u.sin()) * RADIUS;
            assert!((touched - on_disk).norm() < 1e-9, "{step}: {touched} {on_disk}");
        }
    }

    #[test]
    fn figures_show_observers_that_follow() {
        let settings = TableSettings { cases: EXPERIMENT.cases, seed: 1, jobs: None };
        let table = run(&settings);
        assert!(table.failures.is_empty(), "{table}");
        let names: Vec<_> = figures(&settings).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["figure-6.1", "figure-6.2", "figure-6.3", "figure-6.4"]);
        for printed in &PRINTED {
            let followed = printed.drawn(1, EXPERIMENT.cases).unwrap();
            let (truth, estimates) = (&followed.case.truth, &followed.estimates);
            assert!(((truth[0].s - estimates[0].s).abs() - printed.apart).abs() < 1e-12);
            assert!(truth[0].u > FRAC_PI_2 - 0.2 && truth[0].u < FRAC_PI_2 + 0.2);
        }
    }
}
