//! What a contact tells while nothing accelerates (thesis §5.2.2, §8.2.1), and at the degenerate contacts of Theorem 32.
//!
//! Implements: the questions that the thesis leaves open, as ranks: of Lie derivatives of raised order in two precisions for
//! pushes and rolls, of sensitivities over a window for rolls. Verdicts are about the states drawn, not proofs for all.
//! Units: singular values are shares of the largest, of states scaled by the part's size and √(size/g). Errors: none; a
//! verdict that the precisions disagree about is a failure.

use nalgebra::{UnitQuaternion, Vector2, Vector3};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::pushing::observability::Scales;
use palpate::pushing::observability::constant_velocity::{ConstantContact, ConstantPush, LeastTold, ORDERS, Told};
use palpate::rolling::constant_velocity::{RollTold, told};
use palpate::rolling::{
    Egg, Inputs, Model, RollObservability, RollState, RollingBody, RoundedShape, Spin, observability,
};

use super::cases::{of_each, until_possible};
use super::figures::captioned;
use super::{Cell, Experiment, Table, TableSettings};
use crate::pictures::plot::{Chart, Colour, Dash, Figure, Stroke};

/// Pushes at constant velocity.
pub(super) const PUSHES: Experiment = Experiment {
    name: "observability",
    title: "what a push tells while the finger does not accelerate, by order and precision",
    cases: 1000,
    run: pushes,
};

/// Where derivatives do not tell, sought instead of drawn.
pub(super) const EXCEPTIONS: Experiment = Experiment {
    name: "observability-exceptions",
    title: "states of a push that so many derivatives do not tell, sought by descents",
    cases: 100,
    run: exceptions,
};

/// Rolls on a palm that does not accelerate, and the degenerate contacts of Theorem 32.
pub(super) const ROLLS: Experiment = Experiment {
    name: "7-observability",
    title: "what a roll tells while the palm does not accelerate, and where Theorem 32 is silent",
    cases: 100,
    run: rolls,
};

/// Orders of derivatives that are compared.
const COMPARED: [usize; 4] = [3, 4, 8, 12];

/// Twofold and plain precision may differ by this in the last pivot of what shows, relative.
const PRECISIONS_AGREE: f64 = 1e-2;

/// Below this last pivot plain precision has no digits left to agree with.
const PLAIN_SEES: f64 = 1e-11;

/// What a state of a push is drawn like.
#[derive(Clone, Copy)]
struct Kind {
    name: &'static str,
    contact: fn(&mut Draw) -> ConstantContact,
    on_ice: bool,
    special: fn(&mut ConstantPush),
}

fn as_drawn(_: &mut ConstantPush) {}

fn not_turning(push: &mut ConstantPush) {
    push.state[1] = 0.0;
}

fn not_turning_nor_slipping(push: &mut ConstantPush) {
    push.state[1] = 0.0;
    push.state[2] = push.finger[0];
}

/// In line behind the centre of mass, going as the finger does: nothing will ever change.
fn in_line(push: &mut ConstantPush) {
    // Three alike feet, the centre of mass between them: their friction has no moment in translation.
    push.feet = [0.0_f64, 2.1, 4.2].map(|angle| [0.015 * angle.cos(), 0.015 * angle.sin(), 1.0 / 3.0]).to_vec();
    let middle = [0, 1].map(|axis| push.feet.iter().map(|foot| foot[axis]).sum::<f64>() / 3.0);
    push.feet.iter_mut().for_each(|foot| (foot[0], foot[1]) = (foot[0] - middle[0], foot[1] - middle[1]));
    push.state = [0.0, 0.0, 0.0];
    push.finger[0] = 0.0;
}

fn beside_gyration(push: &mut ConstantPush) {
    push.state[0] = (push.height * push.height + push.inertia_per_mass).sqrt();
}

fn frictionless(_: &mut Draw) -> ConstantContact {
    ConstantContact::Slides(0.0)
}

fn rolls_on_it(_: &mut Draw) -> ConstantContact {
    ConstantContact::Rolls
}

fn slides(draw: &mut Draw) -> ConstantContact {
    let friction = draw.uniform(0.05, 0.4);
    ConstantContact::Slides(if draw.chance(0.5) { friction } else { -friction })
}

const KINDS: [Kind; 15] = [
    Kind { name: "no friction, table", contact: frictionless, on_ice: false, special: as_drawn },
    Kind { name: "rolling, table", contact: rolls_on_it, on_ice: false, special: as_drawn },
    Kind { name: "sliding, table", contact: slides, on_ice: false, special: as_drawn },
    Kind { name: "no friction, ice", contact: frictionless, on_ice: true, special: as_drawn },
    Kind { name: "rolling, ice", contact: rolls_on_it, on_ice: true, special: as_drawn },
    Kind { name: "sliding, ice", contact: slides, on_ice: true, special: as_drawn },
    Kind { name: "rolling, ice, s²=h²+ρ²", contact: rolls_on_it, on_ice: true, special: beside_gyration },
    Kind { name: "no friction, ice, ω=0", contact: frictionless, on_ice: true, special: not_turning },
    Kind { name: "rolling, ice, ω=0", contact: rolls_on_it, on_ice: true, special: not_turning },
    Kind { name: "sliding, ice, ω=0", contact: slides, on_ice: true, special: not_turning },
    Kind { name: "no friction, table, ω=0", contact: frictionless, on_ice: false, special: not_turning },
    Kind {
        name: "no friction, table, with the finger",
        contact: frictionless,
        on_ice: false,
        special: not_turning_nor_slipping,
    },
    Kind { name: "rolling, table, ω=0", contact: rolls_on_it, on_ice: false, special: not_turning },
    Kind { name: "no friction, table, in line", contact: frictionless, on_ice: false, special: in_line },
    Kind { name: "rolling, table, in line", contact: rolls_on_it, on_ice: false, special: in_line },
];

impl Kind {
    /// A push whose contact lasts, but for what makes it special.
    fn drawn(&self, draw: &mut Draw) -> ConstantPush {
        until_possible(draw, |draw| {
            let rho = draw.uniform(0.012, 0.03);
            let feet = [0, 1, 2].map(|k| {
                let angle = 2.1 * f64::from(k) + draw.uniform(-0.5, 0.5);
                let (distance, share) = (draw.uniform(0.5, 1.4) * rho, draw.uniform(0.2, 0.5));
                [distance * angle.cos(), distance * angle.sin(), share]
            });
            let mut push = ConstantPush {
                radius: draw.uniform(0.003, 0.02),
                height: draw.uniform(0.5, 1.5) * rho,
                inertia_per_mass: rho * rho,
                mu_g: if self.on_ice { 0.0 } else { draw.uniform(0.1, 0.6) * GRAVITY_ASSUMED },
                feet: feet.to_vec(),
                contact: (self.contact)(draw),
                state: [draw.uniform(-1.3, 1.3) * rho, draw.uniform(-2.0, 2.0), draw.uniform(-0.03, 0.03)],
                finger: [draw.uniform(-0.03, 0.03), draw.uniform(-0.08, -0.02)],
            };
            (self.special)(&mut push);
            // On ice a part that does not turn needs no force.
            (push.normal_force() > 0.0 || self.on_ice && push.state[1] == 0.0).then_some(push)
        })
    }
}

/// Units of a push: its radius of gyration, and the time in which friction forgets a speed or √(L/g), whichever is shorter.
fn scales(push: &ConstantPush) -> Scales {
    let length = push.inertia_per_mass.sqrt();
    let speed = push.finger[0].hypot(push.finger[1]);
    let forgets = if push.mu_g > 0.0 { speed / push.mu_g } else { f64::INFINITY };
    Scales { length, time: (length / GRAVITY_ASSUMED).sqrt().min(forgets) }
}

fn least(told: &Told) -> f64 {
    told.spectrum.singular_values.last().copied().unwrap_or(0.0)
}

fn pushes(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "state",
        "unknowns",
        "observable, order 3",
        "order 4",
        "order 8",
        "order 12",
        "rank",
        "least singular value",
        "median",
        "last pivot, 16 digits",
        "31 digits",
    ]);
    table.definitions = [
        "Drawn: disk, edge, inertia, three feet with their shares of the weight, state and constant velocity of the finger at random, so that the contact presses. ice: no friction under the part; with the finger: it neither turns nor slips; in line: it goes as the finger does, its centre of mass and of pressure straight ahead of the contact.",
        "observable, order n: the share of states for which the differentials of u and its first n derivatives have full rank, by the last pivot in twofold precision (above 1e-22). rank: the least at order 12. Singular values at order 12, as shares of the largest. last pivot: the least of all states in double and in twofold precision; what is 0 but for rounding differs by 16 digits.",
    ]
    .map(str::to_owned)
    .to_vec();
    let small = |value: f64| Cell::from(format!("{value:.0e}"));
    for (number, kind) in KINDS.iter().enumerate() {
        let told = of_each(settings.cases, |case| {
            let push = kind.drawn(&mut Draw::case(settings.seed, 1_000_000 * number + case));
            let scales = scales(&push);
            (push.dimension(), COMPARED.map(|order| push.told(order, &scales)))
        });
        let Some(dimension) = told.first().map(|(dimension, _)| *dimension) else { continue };
        let share =
            |order: usize| Cell::share(told.iter().filter(|(_, told)| told[order].observable()).count(), told.len());
        let last: Vec<_> = told.iter().map(|(_, told)| &told[3]).collect();
        let singular: Vec<f64> = last.iter().map(|told| least(told)).collect();
        let lowest = |of: &dyn Fn(&Told) -> f64| last.iter().map(|told| of(told)).fold(f64::INFINITY, f64::min);
        // Of what shows to 31 digits; singular values stop at rounding.
        let rank = last
            .iter()
            .map(|told| if told.observable() { dimension } else { told.spectrum.rank().min(dimension - 1) })
            .min();
        table.push([
            kind.name.into(),
            Cell::count(dimension),
            share(0),
            share(1),
            share(2),
            share(3),
            Cell::count(rank.unwrap_or(0)),
            small(lowest(&least)),
            percentile(singular.iter().copied(), 50).map_or(Cell::Empty, small),
            small(lowest(&|told: &Told| told.last_pivot[0])),
            small(lowest(&|told: &Told| told.last_pivot[1])),
        ]);
        for (case, told) in last.iter().enumerate() {
            let [plain, twofold] = told.last_pivot;
            if twofold > PLAIN_SEES && (plain / twofold - 1.0).abs() > PRECISIONS_AGREE {
                table.failures.push(format!("{}, case {case}: pivots {plain:e} and {twofold:e}", kind.name));
            }
        }
    }
    table
}

/// What is as small as this share of the largest singular value is 0 where a descent ended: it goes on until rounding ends it,
/// and other ends are above.
const LOST: f64 = 1e-9;

/// Kinds whose exceptions are sought: those of [`KINDS`] that are not special.
const SOUGHT: usize = 6;

/// Orders at which they are sought, beyond the first that can tell all; and the highest.
const BEYOND: [usize; 4] = [0, 1, 2, 3];
/// See [`BEYOND`].
const HIGHEST: usize = ORDERS - 1;

/// States are sought as far as they are drawn: of s in radii of gyration, of ω rad/s and of v_T m/s.
fn bounds(push: &ConstantPush) -> [f64; 3] {
    [1.3 * push.inertia_per_mass.sqrt(), 2.0, 0.03]
}

fn exceptions(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "contact, derivatives",
        "descents",
        "lose rank",
        "at the edge",
        "one more, least pivot",
        "all 12, least pivot",
        "others: least",
        "median",
        "slowest foot mm/s",
    ]);
    table.definitions = [
        "From each push drawn as for the table observability a descent to a state of the same part and finger at which the differentials of u and of its first derivatives, as many as the row says, come nearest to losing rank: down the least singular value, each differential at length 1, each state in units of what it shows at the start. |s| up to 1.3 radii of gyration, |ω| up to 2 rad/s, |v_T| up to 3 cm/s; the contact presses and no foot is slower than 2 mm/s.",
        "lose rank: the share of descents that end below 1e-9 of the largest. at the edge: of those, where the state may not go on. least pivot: of those states, by one derivative more and by 12, in twofold precision, as a share of the first; on ice rounding. others: the least singular value, least and median of the descents that end above; slowest foot: at the least.",
    ]
    .map(str::to_owned)
    .to_vec();
    let small = |value: Option<f64>| value.map_or(Cell::Empty, |value| Cell::from(format!("{value:.0e}")));
    for (number, kind) in KINDS.iter().take(SOUGHT).enumerate() {
        let states = kind.drawn(&mut Draw::case(settings.seed, 1_000_000 * number)).dimension();
        for order in BEYOND.map(|beyond| states - 1 + beyond).into_iter().chain([HIGHEST]) {
            let found: Vec<(LeastTold, Option<[f64; 2]>)> = of_each(settings.cases, |case| {
                let push = kind.drawn(&mut Draw::case(settings.seed, 1_000_000 * number + case));
                let scales = scales(&push);
                let found = push.least_told(order, &scales, bounds(&push))?;
                let more = (found.least < LOST)
                    .then(|| [order + 1, HIGHEST].map(|order| found.push.told(order, &scales).last_pivot[1]));
                Some((found, more))
            })
            .into_iter()
            .flatten()
            .collect();
            let lost: Vec<_> = found.iter().filter_map(|(found, more)| Some((found.at_edge, (*more)?))).collect();
            let others = || found.iter().filter(|(_, more)| more.is_none()).map(|(found, _)| found);
            let pivot = |which: usize| small(lost.iter().map(|(_, pivots)| pivots[which]).reduce(f64::min));
            let least = others().min_by(|a, b| a.least.total_cmp(&b.least));
            table.push([
                format!("{}, {order}", kind.name).into(),
                Cell::count(found.len()),
                Cell::share(lost.len(), found.len()),
                Cell::share(lost.iter().filter(|(at_edge, _)| *at_edge).count(), lost.len()),
                if order < HIGHEST { pivot(0) } else { Cell::Empty },
                pivot(1),
                small(least.map(|found| found.least)),
                small(percentile(others().map(|found| found.least), 50)),
                least
                    .map(|found| found.push.slowest_foot())
                    .filter(|speed| speed.is_finite())
                    .map_or(Cell::Empty, |speed| Cell::number(1e3 * speed, 1)),
            ]);
        }
    }
    table
}

/// The push of the pictures, on a table unless `mu_g` is 0.
fn pictured(contact: ConstantContact, mu_g: f64, omega: f64) -> ConstantPush {
    ConstantPush {
        radius: 0.01,
        height: 0.02,
        inertia_per_mass: 4e-4,
        mu_g,
        feet: vec![[0.018, 0.0, 0.3], [-0.01, 0.016, 0.4], [-0.008, -0.017, 0.3]],
        contact,
        state: [0.006, omega, 0.012],
        finger: [0.0, -0.05],
    }
}

/// Where derivatives do not tell the state of one push, in the plane of one v_T.
pub(super) fn exception_figures(_: &TableSettings) -> Vec<(String, Figure)> {
    let caption = "States of one push without friction at the finger, on a table, the part sliding along the finger by 12 mm/s. On the lines u and three derivatives do not tell the state, at the points four do not, either. Five tell every state in this plane; through space there are points at which it takes six.";
    let mut chart = Chart::new("", ["where the part is touched, s [mm]", "ω [rad/s]"]);
    let scales = Scales { length: 0.02, time: 0.015 };
    for (order, name, colour) in
        [(3, "three derivatives do not tell", Colour::BLUE), (4, "four do not", Colour::VERMILLION)]
    {
        let starts = 24 * 24;
        let ends = of_each(starts, |start| {
            let [across, up] = [start % 24, start / 24].map(|place| (place as f64 + 0.5) / 12.0 - 1.0);
            let mut push = pictured(ConstantContact::Slides(0.0), 3.0, 2.0 * up);
            push.state[0] = 0.026 * across;
            let found = push.least_told_along(order, &scales, bounds(&push), [true, true, false])?;
            let [s, omega, _] = found.push.state;
            (found.least < LOST).then_some([1e3 * s, omega])
        });
        chart.dots(name, &ends.into_iter().flatten().collect::<Vec<_>>(), colour);
    }
    let figure = captioned("Where derivatives do not tell", [760.0, 440.0], caption);
    vec![("observability-exceptions".to_owned(), figure.column(1.0, vec![chart.into()]))]
}

/// How well a push tells its state by how fast the part turns, on a table and on ice.
pub(super) fn figures(_: &TableSettings) -> Vec<(String, Figure)> {
    let caption = "The least singular value of what a push at constant velocity tells, up to order 12, by how fast the part turns. On ice it falls to 0 where the part does not turn: where it is touched then changes nothing. In the two other notches three derivatives of the angle do not tell, and a fourth does. On a table friction turns the part, and all shows.";
    let mut chart = Chart::new("", ["ω [rad/s]", "log10 of the least singular value"]);
    for (name, contact, mu_g, stroke) in [
        ("no friction at the finger, table", ConstantContact::Slides(0.0), 3.0, Stroke::solid(Colour::BLUE, 1.8)),
        ("the same, ice", ConstantContact::Slides(0.0), 0.0, Stroke::solid(Colour::BLUE, 1.8).with(Dash::Dashed)),
        ("rolling, table", ConstantContact::Rolls, 3.0, Stroke::solid(Colour::VERMILLION, 1.8)),
        ("the same, ice", ConstantContact::Rolls, 0.0, Stroke::solid(Colour::VERMILLION, 1.8).with(Dash::Dashed)),
    ] {
        let curve: Vec<_> = (-100..=100)
            .map(|k| 0.02 * f64::from(k))
            .filter_map(|omega| {
                let push = pictured(contact, mu_g, omega);
                // The same unit of time for all curves.
                let told = push.told(12, &Scales { length: 0.02, time: 0.015 });
                Some([omega, least(&told).log10()]).filter(|point| point[1] > -16.0)
            })
            .collect();
        chart.curve(name, &curve, stroke);
    }
    let figure = captioned("What a push at constant velocity tells", [760.0, 440.0], caption);
    vec![("observability".to_owned(), figure.column(1.0, vec![chart.into()]))]
}

/// A random body without symmetry of revolution.
fn body(draw: &mut Draw) -> Option<RollingBody> {
    let axes = [draw.uniform(0.018, 0.025), draw.uniform(0.027, 0.033), draw.uniform(0.036, 0.05)];
    match draw.index(3) {
        0 => RollingBody::rounded(RoundedShape { semi_axes: [axes[0], axes[1], 0.8 * axes[1]], radius: 0.012 }, None)
            .ok(),
        1 => {
            // The inertia of the ellipsoid that it comes from: any will do.
            let inertia = [[1, 2], [0, 2], [0, 1]].map(|[a, b]| (axes[a] * axes[a] + axes[b] * axes[b]) / 5.0);
            RollingBody::egg(Egg { semi_axes: axes, skew: 0.1 * axes[0], origin: 0.0 }, Some(inertia)).ok()
        }
        _ => RollingBody::ellipsoid(axes).ok(),
    }
}

fn turning(draw: &mut Draw, spin: Spin, attitude: UnitQuaternion<f64>) -> RollState {
    let omega = Vector3::new(draw.normal(), draw.normal(), draw.normal()) * 6.0;
    let mut state = RollState { orientation: attitude.into_inner(), omega, u: Vector2::zeros() };
    if spin == Spin::NoSpin {
        let normal = state.normal();
        state.omega -= normal * normal.dot(&state.omega);
    }
    state
}

fn attitude(draw: &mut Draw) -> UnitQuaternion<f64> {
    let q = nalgebra::Quaternion::new(draw.normal(), draw.normal(), draw.normal(), draw.normal());
    UnitQuaternion::from_quaternion(q)
}

/// An attitude in which the body stands on the end of its third axis, turned about it.
fn on_its_end(draw: &mut Draw) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), draw.uniform(-3.0, 3.0))
}

/// Where det(b₁, b₂, β) changes its sign on a random arc of attitudes, found by halving.
fn determinant_zero(draw: &mut Draw, body: &RollingBody, spin: Spin) -> Option<UnitQuaternion<f64>> {
    const STEP: f64 = 0.02;
    let (from, axis) = (attitude(draw), Vector3::new(draw.normal(), draw.normal(), draw.normal()).normalize());
    let at = |angle: f64| UnitQuaternion::from_scaled_axis(axis * angle) * from;
    let determinant = |angle: f64| {
        let state = RollState { orientation: at(angle).into_inner(), omega: Vector3::zeros(), u: Vector2::zeros() };
        let told = observability(&Model { body, spin }, &state, GRAVITY_ASSUMED, Inputs::Zero).ok()?;
        told.sufficient_condition.determinant
    };
    // Not where it jumps, at an umbilic.
    let low = (0..100).map(|k| STEP * f64::from(k)).find(|&angle| {
        matches!((determinant(angle), determinant(angle + STEP)), (Some(a), Some(b)) if a * b < 0.0 && (a - b).abs() < 0.5)
    })?;
    let (mut low, mut high) = (low, low + STEP);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        let same = determinant(low)? * determinant(middle)? > 0.0;
        *(if same { &mut low } else { &mut high }) = middle;
    }
    (determinant(low)?.abs() < 1e-6).then(|| at(low))
}

type State = fn(&mut Draw, Spin) -> Option<(RollingBody, RollState)>;

fn any(draw: &mut Draw, spin: Spin) -> Option<(RollingBody, RollState)> {
    let (body, attitude) = (body(draw)?, attitude(draw));
    Some((body, turning(draw, spin, attitude)))
}

fn released(draw: &mut Draw, spin: Spin) -> Option<(RollingBody, RollState)> {
    let (body, state) = any(draw, spin)?;
    Some((body, RollState { omega: Vector3::zeros(), ..state }))
}

fn without_determinant(draw: &mut Draw, spin: Spin) -> Option<(RollingBody, RollState)> {
    let body =
        RollingBody::ellipsoid([draw.uniform(0.018, 0.025), draw.uniform(0.027, 0.033), draw.uniform(0.036, 0.05)])
            .ok()?;
    let attitude = determinant_zero(draw, &body, spin)?;
    Some((body, turning(draw, spin, attitude)))
}

fn of_revolution(draw: &mut Draw, spin: Spin) -> Option<(RollingBody, RollState)> {
    let (waist, attitude) = (draw.uniform(0.02, 0.03), attitude(draw));
    let body = RollingBody::ellipsoid([waist, waist, draw.uniform(0.032, 0.05)]).ok()?;
    Some((body, turning(draw, spin, attitude)))
}

fn on_a_vertex_at_rest(draw: &mut Draw, _: Spin) -> Option<(RollingBody, RollState)> {
    let body = RollingBody::ellipsoid([0.02, 0.03, draw.uniform(0.035, 0.05)]).ok()?;
    Some((body, RollState { orientation: on_its_end(draw).into_inner(), omega: Vector3::zeros(), u: Vector2::zeros() }))
}

fn on_a_vertex(draw: &mut Draw, spin: Spin) -> Option<(RollingBody, RollState)> {
    let (body, _) = on_a_vertex_at_rest(draw, spin)?;
    let attitude = on_its_end(draw);
    Some((body, turning(draw, spin, attitude)))
}

fn on_a_pole(draw: &mut Draw, spin: Spin) -> Option<(RollingBody, RollState)> {
    let waist = draw.uniform(0.02, 0.03);
    let (body, attitude) = (RollingBody::ellipsoid([waist, waist, draw.uniform(0.032, 0.05)]).ok()?, on_its_end(draw));
    Some((body, turning(draw, spin, attitude)))
}

fn sphere(draw: &mut Draw, spin: Spin) -> Option<(RollingBody, RollState)> {
    let (body, attitude) = (RollingBody::ellipsoid([draw.uniform(0.02, 0.04); 3]).ok()?, attitude(draw));
    Some((body, turning(draw, spin, attitude)))
}

const ROLL_KINDS: [(&str, State); 8] = [
    ("any", any),
    ("any, released at rest", released),
    ("det(b1, b2, β) = 0", without_determinant),
    ("on a vertex", on_a_vertex),
    ("on a vertex at rest", on_a_vertex_at_rest),
    ("of revolution", of_revolution),
    ("of revolution, on its pole", on_a_pole),
    ("sphere", sphere),
];

/// Orders up to which the path of a roll is compared.
const ROLL_ORDERS: [usize; 4] = [3, 4, 6, 12];

/// What is told of one roll: by a window with the palm at rest and moving, and order by order with the palm at rest.
struct ToldRoll {
    unknowns: usize,
    windows: [Option<RollObservability>; 2],
    orders: Option<Vec<RollTold>>,
}

impl ToldRoll {
    fn of(body: &RollingBody, spin: Spin, state: &RollState) -> Self {
        let model = Model { body, spin };
        let windows =
            [Inputs::Zero, Inputs::Generic].map(|inputs| observability(&model, state, GRAVITY_ASSUMED, inputs).ok());
        Self { unknowns: model.dimension(), windows, orders: told(&model, state, GRAVITY_ASSUMED, &ROLL_ORDERS) }
    }

    /// What the highest order tells.
    fn last(&self) -> Option<&RollTold> {
        self.orders.as_ref()?.last()
    }

    /// Whether the window, both precisions and all that follows from the highest order agree.
    fn stands(&self) -> bool {
        let agree = || {
            let (window, last) = (self.windows[0].as_ref()?, self.last()?);
            let [plain, twofold] = last.last_seen();
            let seen = twofold < PLAIN_SEES || (plain / twofold - 1.0).abs() < PRECISIONS_AGREE;
            Some(window.spectrum.rank() == last.rank() && seen)
        };
        agree().unwrap_or(false)
    }
}

/// The least and the most of ranks.
fn ranks(ranks: impl Iterator<Item = usize> + Clone) -> Cell {
    let (low, high) = (ranks.clone().min().unwrap_or(0), ranks.max().unwrap_or(0));
    Cell::from(if low == high { low.to_string() } else { format!("{low} to {high}") })
}

fn rolls(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "state",
        "unknowns",
        "condition holds",
        "rank, palm at rest",
        "rank, palm moving",
        "least seen, palm at rest",
        "largest unseen",
        "rank, order 3",
        "order 4",
        "order 6",
        "order 12",
        "least pivot, 16 digits",
        "least pivot, 31 digits",
        "unseen, 16 digits",
        "unseen, 31 digits",
        "least β·(Iz)",
    ]);
    table.definitions = [
        "Drawn: ellipsoids, eggs and rounded bodies at random attitudes, turning by 6 rad/s a component. Ranks: of the sensitivities of the contact's path over 4√(L/g) by the state, from the least to the most found; palm moving: accelerated in all directions. condition holds: all of Theorem 32. spins: a body free to spin about the contact's normal.",
        "least seen and largest unseen: singular values, as shares of the largest, above and below 1e-7, the least and largest of all states. rank, order n: of the differentials of u and its first n derivatives, palm at rest, by pivots above 1e-22 of an elimination in twofold precision. Pivots: at order 12, as shares of the first, the least of those that count and the largest of those that do not, in double and in twofold precision; what is 0 but for rounding differs by many digits. β·(Iz): over m L³, or h(n)/L without spin: (7.33) fails only where it is 0.",
    ]
    .map(str::to_owned)
    .to_vec();
    let small = |value: f64| Cell::from(format!("{value:.0e}"));
    for (number, (name, state)) in ROLL_KINDS.iter().enumerate() {
        for (spin, spin_name) in [(Spin::Free, "spins"), (Spin::NoSpin, "no spin")] {
            let told = of_each(settings.cases, |case| {
                let mut draw = Draw::case(settings.seed, 1_000_000 * number + case);
                let (body, state) = until_possible(&mut draw, |draw| state(draw, spin));
                ToldRoll::of(&body, spin, &state)
            });
            let Some(unknowns) = told.first().map(|told| told.unknowns) else { continue };
            let rest: Vec<_> = told.iter().filter_map(|told| told.windows[0].as_ref()).collect();
            let moving: Vec<_> = told.iter().filter_map(|told| told.windows[1].as_ref()).collect();
            let last: Vec<_> = told.iter().filter_map(ToldRoll::last).collect();
            let of_order =
                |order: usize| ranks(told.iter().filter_map(|told| Some(told.orders.as_ref()?.get(order)?.rank())));
            let seen = rest
                .iter()
                .map(|told| told.spectrum.singular_values[told.spectrum.rank() - 1])
                .fold(f64::INFINITY, f64::min);
            let unseen = rest
                .iter()
                .filter_map(|told| told.spectrum.singular_values.get(told.spectrum.rank()))
                .copied()
                .fold(0.0, f64::max);
            let pivot_seen =
                |digits: usize| small(last.iter().map(|told| told.last_seen()[digits]).fold(f64::INFINITY, f64::min));
            let pivot_unseen = |digits: usize| {
                let unseen = last.iter().filter_map(|told| Some(told.first_unseen()?[digits]));
                unseen.reduce(f64::max).map_or(Cell::Empty, small)
            };
            let holds = rest.iter().filter(|told| told.sufficient_condition.holds).count();
            let term = rest
                .iter()
                .map(|told| told.sufficient_condition.contact_and_inertia.abs())
                .fold(f64::INFINITY, f64::min);
            table.push([
                format!("{name}; {spin_name}").into(),
                Cell::count(unknowns),
                Cell::share(holds, rest.len()),
                ranks(rest.iter().map(|told| told.spectrum.rank())),
                ranks(moving.iter().map(|told| told.spectrum.rank())),
                small(seen),
                if unseen > 0.0 { small(unseen) } else { Cell::Empty },
                of_order(0),
                of_order(1),
                of_order(2),
                of_order(3),
                pivot_seen(0),
                pivot_seen(1),
                pivot_unseen(0),
                pivot_unseen(1),
                Cell::number(term, 3),
            ]);
            let fallen: Vec<_> = (0..told.len()).filter(|&case| !told[case].stands()).collect();
            if let Some(&case) = fallen.first() {
                let told = (&told[case].windows[0], told[case].last());
                table
                    .failures
                    .push(format!("{name}; {spin_name}: {} do not stand, case {case}: {told:?}", fallen.len()));
            }
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_shows_at_constant_velocity_is_what_the_page_says() {
        let table = pushes(&TableSettings { cases: 20, seed: 1, jobs: None });
        assert!(table.failures.is_empty(), "{table}");
        let full = |row: &[Cell]| matches!(row[5], Cell::Share(share) if share > 0.999);
        for row in table.rows() {
            let name = row[0].to_string();
            // On ice a part that does not turn hides its place.
            let hides = name.contains("ice, ω=0");
            assert_eq!(full(row), !hides, "{name}: {table}");
        }
    }

    /// Surfaces, curves and points at which so many derivatives do not tell; none at which one more does not. On ice, where
    /// the part does not turn, no number of them tells.
    #[test]
    fn states_that_are_sought_are_as_the_page_says() {
        let table = exceptions(&TableSettings { cases: 30, seed: 1, jobs: None });
        let share = |row: &[Cell]| if let Cell::Share(share) = row[2] { share } else { panic!("{table}") };
        let rows: Vec<_> = table.rows().collect();
        assert_eq!(rows.len(), SOUGHT * (BEYOND.len() + 1));
        for (kind, rows) in KINDS.iter().zip(rows.chunks(BEYOND.len() + 1)) {
            let shares: Vec<f64> = rows.iter().map(|row| share(row)).collect();
            // Of three states in rolling two are free, of four three: where none is left to meet one condition more.
            let met = if kind.name.starts_with("rolling") { 2 } else { 3 };
            for (place, share) in shares.into_iter().enumerate() {
                assert_eq!(share > 0.0, kind.on_ice || place < met, "{}, {place}: {table}", kind.name);
            }
        }
    }

    #[test]
    fn what_shows_on_a_palm_at_rest_is_what_the_page_says() {
        let table = rolls(&TableSettings { cases: 4, seed: 1, jobs: None });
        assert!(table.failures.is_empty(), "{table}");
        let ranks = |name: &str, column: usize| {
            let rows = table.rows().filter(|row| row[0].to_string().split("; ").next() == Some(name));
            rows.map(|row| row[column].to_string()).collect::<Vec<_>>()
        };
        for (name, wanted) in [
            ("any", ["8", "7"]),
            ("det(b1, b2, β) = 0", ["8", "7"]),
            ("on a vertex at rest", ["6", "6"]),
            ("of revolution", ["7", "6"]),
            ("sphere", ["4", "4"]),
        ] {
            assert_eq!(ranks(name, 3), wanted, "{name}: {table}");
            // The same by 12 derivatives and 31 digits.
            assert_eq!(ranks(name, 10), wanted, "{name}: {table}");
        }
    }
}
