//! Figures 1.2, 5.2 to 5.6, 6.6 (simulated), 6.8 and C.1: pushes, what they tell of the pose and what they do not.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Isometry2, Point2, Rotation2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::pushing::dynamics::support::{SupportFriction, Twist};
use palpate::pushing::dynamics::{
    Body, ContactLaw, EdgeEnd, FingerPath, FingerShape, Part, PartSide, PushRun, Sample, ShapedModel, ShapedPush, Start,
};

use super::{Illustration, area, captioned, thin};
use crate::pictures::plot::{Chart, Colour, Dash, Figure, Key, PlotScene, Stroke, Style};
use crate::thesis::{Cell, Table, TableSettings};

pub(super) const FIGURE_1_2: Illustration = Illustration {
    name: "figure-1.2",
    title: "two resting poses under an ellipse give two motions of the contact",
    cases: 1,
    make: figure_1_2,
};
pub(super) const FIGURE_5_2: Illustration =
    Illustration { name: "figure-5.2", title: "a finger translates and pushes an object", cases: 1, make: figure_5_2 };
pub(super) const FIGURE_5_3: Illustration =
    Illustration { name: "figure-5.3", title: "the instantaneous centre of rotation", cases: 1, make: figure_5_3 };
pub(super) const FIGURE_5_4: Illustration =
    Illustration { name: "figure-5.4", title: "a disk pushes a polygon: u, s, h and r", cases: 1, make: figure_5_4 };
pub(super) const FIGURE_5_5: Illustration = Illustration {
    name: "figure-5.5",
    title: "the resting pose by shooting: where u(t1; s0) meets u1",
    cases: 1,
    make: figure_5_5,
};
pub(super) const FIGURE_5_6: Illustration = Illustration {
    name: "figure-5.6",
    title: "rolling and sliding: the force within the friction cone, and on its edge",
    cases: 1,
    make: figure_5_6,
};
pub(super) const FIGURE_6_6: Illustration = Illustration {
    name: "figure-6.6",
    title: "the last contact by where a triangle was touched first (simulated)",
    cases: 1,
    make: figure_6_6,
};
pub(super) const FIGURE_6_8: Illustration =
    Illustration { name: "figure-6.8", title: "motions that do not tell poses apart", cases: 1, make: figure_6_8 };
pub(super) const FIGURE_C_1: Illustration = Illustration {
    name: "figure-C.1",
    title: "a polygon as triangles from the centre of rotation",
    cases: 1,
    make: figure_c_1,
};

/// What slows a part on the table, µ g of µ 0.3, m/s².
const MU_G: f64 = 0.3 * 9.81;

const FINGER: Colour = Colour::DARK_GREY;
const FORCE: Colour = Colour::VERMILLION;

/// Times from 0, evenly apart, s.
fn times(end: f64, count: u32) -> Vec<f64> {
    (0..=count).map(|k| end * f64::from(k) / f64::from(count)).collect()
}

/// A push from rest of a body by a finger that begins at the origin.
struct FromRest<'a> {
    body: &'a Body,
    side: PartSide,
    mu_g: f64,
    shape: FingerShape,
    acceleration: Vector2<f64>,
    law: ContactLaw,
    u: f64,
    s: f64,
}

impl FromRest<'_> {
    fn path(&self) -> FingerPath {
        FingerPath { centre0: Point2::origin(), velocity0: Vector2::zeros(), acceleration: self.acceleration }
    }

    fn run(&self, times: &[f64]) -> Option<PushRun> {
        let model = ShapedModel::new(self.body, self.side, self.mu_g, self.shape, self.path()).ok()?;
        let start = Start::Rest { u: self.u, s: self.s };
        ShapedPush::new(model, self.law, start, EdgeEnd::Stop).ok()?.run(times).ok()
    }

    /// The finger's outline and the contact on it.
    fn finger(&self, time: f64) -> Vec<Point2<f64>> {
        let centre = self.path().centre(time);
        (0..120).map(|k| centre + self.shape.point(TAU * f64::from(k) / 120.0)).collect()
    }

    fn contact(&self, sample: &Sample) -> Point2<f64> {
        self.path().centre(sample.t) + self.shape.point(sample.state.u)
    }

    /// The part's outward normal at the contact.
    fn normal(&self, sample: &Sample) -> Vector2<f64> {
        let angle = self.shape.normal_angle(sample.state.u);
        -Vector2::new(angle.cos(), angle.sin())
    }
}

fn placed(outline: &[Point2<f64>], sample: &Sample) -> Vec<Point2<f64>> {
    outline.iter().map(|p| Isometry2::new(sample.position.coords, sample.theta) * p).collect()
}

fn polygon<const N: usize>(corners: [[f64; 2]; N]) -> Option<Part> {
    Some(Part::uniform(SimplePolygon::new(corners.map(Point2::from)).ok()?))
}

fn quadrilateral() -> Option<Part> {
    polygon([[-0.03, -0.022], [0.034, -0.018], [0.026, 0.024], [-0.022, 0.03]])
}

/// A table without rows, and why.
fn failed(definition: &str, why: &str) -> Table {
    let mut table = Table::new(["nothing"]);
    table.definitions.push(definition.to_owned());
    table.failures.push(why.to_owned());
    table
}

fn figure_1_2(_: &TableSettings) -> (Table, Figure) {
    let caption = "An elliptic finger touches a quadrilateral with the same place of its outline, and pushes it the same way; only the part's pose differs. See the contact (dots, every 0.1 s) run one way on the finger in (a), the other way in (b): it tells the poses apart.";
    let figure = captioned("Figure 1.2: two poses, two motions of the contact", [860.0, 440.0], caption);
    let definition = "An ellipse of 2 cm × 1 cm accelerates upwards by 0.25 m/s² from rest and pushes without friction at the finger, µ 0.3 on the table: the contact on the finger.";
    let Some(part) = quadrilateral() else { return (failed(definition, "no part"), figure) };
    let mut table = Table::new(["pose", "touched on edge", "s mm", "u at first °", "u at 0.8 s °"]);
    table.definitions.push(definition.to_owned());
    let mut figure = figure;
    for (name, edge, s) in [("(a)", 0, 0.012), ("(b)", 2, -0.010)] {
        let Ok(side) = part.edge(edge) else { continue };
        let push = FromRest {
            body: part.body(),
            side: PartSide::Edge(side),
            mu_g: MU_G,
            shape: FingerShape::Ellipse { semi_axes: [0.02, 0.01] },
            acceleration: Vector2::new(0.0, 0.25),
            law: ContactLaw::Frictionless,
            u: 1.45,
            s,
        };
        let Some(run) = push.run(&times(0.8, 8)) else {
            table.failures.push(format!("{name}: the push cannot be simulated"));
            continue;
        };
        let mut scene = PlotScene::new(name);
        let last = run.samples.len() - 1;
        for (k, sample) in run.samples.iter().enumerate() {
            if k == 0 || k == last {
                let stroke = Stroke::solid(Colour::BLUE, 1.4);
                let style = if k == 0 { stroke.with(Dash::Dashed).into() } else { area(Colour::BLUE) };
                scene.polygon(&placed(part.polygon().vertices(), sample), style);
                scene.polygon(&push.finger(sample.t), thin(FINGER));
            }
            scene.dot(push.contact(sample), FORCE);
        }
        scene.key(Key::Line(Stroke::solid(Colour::BLUE, 1.4).with(Dash::Dashed)), "at first");
        scene.key(Key::Dot(FORCE), "contact");
        let u = |k: usize| run.samples[k].state.u.to_degrees();
        table.push([
            name.into(),
            Cell::count(edge),
            Cell::number(1e3 * s, 1),
            Cell::number(u(0), 1),
            Cell::number(u(last), 1),
        ]);
        if last < 8 {
            table.failures.push(format!("{name}: the contact ended: {:?}", run.end));
        }
        figure = figure.column(1.0, vec![scene.into()]);
    }
    (table, figure)
}

/// The push of figures 5.2 and 5.3: an ellipse by an ellipse, and one moment of it.
fn ellipse_by_ellipse(body: &Body) -> Option<(FromRest<'_>, Sample)> {
    let push = FromRest {
        body,
        side: PartSide::Ellipse { semi_axes: OBJECT, middle: Vector2::zeros() },
        mu_g: MU_G,
        shape: FingerShape::Ellipse { semi_axes: [0.02, 0.012] },
        acceleration: Vector2::new(0.05, 0.3),
        law: ContactLaw::Frictionless,
        u: 1.2,
        s: -1.9,
    };
    let run = push.run(&times(0.4, 4))?;
    let sample = *run.samples.last()?;
    Some((push, sample))
}

/// Semi-axes of the object of figures 5.2 and 5.3, m.
const OBJECT: [f64; 2] = [0.04, 0.025];

fn object_outline() -> Vec<Point2<f64>> {
    (0..160)
        .map(|k| TAU * f64::from(k) / 160.0)
        .map(|t| Point2::new(OBJECT[0] * t.cos(), OBJECT[1] * t.sin()))
        .collect()
}

fn figure_5_2(_: &TableSettings) -> (Table, Figure) {
    let caption = "A finger (grey) that only translates pushes an object; both may have any smooth outline. u is where the contact is on the finger, s where on the object; N and T are the object's normal and the tangent there, v and ω the object's motion 0.4 s after rest.";
    let figure = captioned("Figure 5.2: a finger pushes an object", [560.0, 440.0], caption);
    let definition = "An ellipse of 4 cm × 2 cm accelerates by (0.05, 0.3) m/s² and pushes an ellipse of 8 cm × 5 cm without friction at the contact, µ 0.3 on the table: the motion 0.4 s after rest.";
    let body = Body::ellipse(OBJECT);
    let Some((push, sample)) = ellipse_by_ellipse(&body) else { return (failed(definition, "no push"), figure) };
    let mut scene = PlotScene::new("");
    scene.polygon(&placed(&object_outline(), &sample), area(Colour::BLUE));
    scene.polygon(&push.finger(sample.t), Style::area(FINGER, 0.15).outlined(thin(FINGER)));
    let (contact, normal) = (push.contact(&sample), push.normal(&sample));
    let tangent = Vector2::new(-normal.y, normal.x);
    for (vector, name) in [(normal, "N"), (-tangent, "T")] {
        scene.arrow(contact, vector * 0.018, Colour::BLACK);
        scene.label(contact + vector * 0.018, vector, name, Colour::BLACK);
    }
    let velocity = push.path().velocity(sample.t);
    let seconds = 0.2;
    for (at, vector, name, colour) in
        [(push.path().centre(sample.t), velocity, "vF", FINGER), (sample.position, sample.velocity, "v", Colour::GREEN)]
    {
        scene.arrow(at, vector * seconds, colour);
        scene.label(at + vector * seconds, vector, name, colour);
    }
    scene.dot(contact, FORCE);
    scene.label(contact, Vector2::x(), "u, s", FORCE);
    scene.key(Key::Dot(FORCE), "contact");
    // The turn about the centre of mass, an arc as long as it lasts a second.
    let arc: Vec<_> = (0..=40)
        .map(|k| 0.6 + sample.state.omega * f64::from(k) / 40.0)
        .map(|angle| sample.position + Vector2::new(angle.cos(), angle.sin()) * 0.012)
        .collect();
    if let [.., before, end] = arc[..] {
        scene.polyline(&arc, Stroke::solid(Colour::GREEN, 1.4));
        scene.arrow(end, (end - before) * 4.0, Colour::GREEN);
        scene.label(arc[arc.len() / 2], arc[arc.len() / 2] - sample.position, "ω", Colour::GREEN);
    }
    let mut table = Table::new(["at 0.4 s", "u °", "s °", "ω rad/s", "v mm/s", "vF mm/s"]);
    table.definitions.push(definition.to_owned());
    table.push([
        "contact".into(),
        Cell::number(sample.state.u.to_degrees(), 2),
        Cell::number(sample.state.s.to_degrees(), 2),
        Cell::number(sample.state.omega, 3),
        Cell::number(1e3 * sample.velocity.norm(), 1),
        Cell::number(1e3 * velocity.norm(), 1),
    ]);
    // (5.1): along the normal both move alike at the contact.
    let there = Twist::new(sample.velocity, sample.state.omega).velocity_at(contact - sample.position);
    let gap = (there - velocity).dot(&normal);
    table.notes.push(format!("Along N the contact moves alike on both, to {:.0e} m/s: (5.1).", gap.abs().max(1e-15)));
    if gap.abs() > 1e-9 {
        table.failures.push(format!("finger and object part at {gap:e} m/s"));
    }
    (table, figure.column(1.0, vec![scene.into()]))
}

fn figure_5_3(_: &TableSettings) -> (Table, Figure) {
    let caption = "The motion of figure 5.2 as a rotation: every point of the object moves across the line from the centre of rotation q, faster the farther away. Friction on the table acts against these arrows.";
    let figure = captioned("Figure 5.3: the centre of rotation", [560.0, 440.0], caption);
    let definition = "The instantaneous centre of rotation q = c + ẑ × v/ω of figure 5.2's object, and how far from perpendicular the velocities of points are to their lines from it.";
    let body = Body::ellipse(OBJECT);
    let Some((_, sample)) = ellipse_by_ellipse(&body) else { return (failed(definition, "no push"), figure) };
    let omega = sample.state.omega;
    let centre = sample.position + Vector2::new(-sample.velocity.y, sample.velocity.x) / omega;
    let mut scene = PlotScene::new("");
    scene.polygon(&placed(&object_outline(), &sample), area(Colour::BLUE));
    let mut worst = 0.0_f64;
    let scale = 0.012 / sample.velocity.norm();
    for k in 0..8 {
        for share in [0.5, 1.0] {
            let t = TAU * f64::from(k) / 8.0;
            let point = Isometry2::new(sample.position.coords, sample.theta)
                * Point2::new(share * OBJECT[0] * t.cos(), share * OBJECT[1] * t.sin());
            let velocity = Twist::new(sample.velocity, omega).velocity_at(point - sample.position);
            worst = worst.max((velocity.dot(&(point - centre)) / velocity.norm() / (point - centre).norm()).abs());
            scene.polyline(&[centre, point], Stroke::solid(Colour::GREY, 0.6));
            scene.arrow(point, velocity * scale, Colour::GREEN);
        }
    }
    scene.dot(sample.position, Colour::BLUE);
    scene.label(sample.position, Vector2::x(), "c", Colour::BLUE);
    scene.dot(centre, FORCE);
    scene.label(centre, -Vector2::y(), "q", FORCE);
    scene.key(Key::Arrow(Colour::GREEN), "velocity");
    let mut table = Table::new(["centre of rotation", "x mm", "y mm", "distance from c mm", "largest cosine"]);
    table.definitions.push(definition.to_owned());
    table.push([
        "q".into(),
        Cell::number(1e3 * centre.x, 2),
        Cell::number(1e3 * centre.y, 2),
        Cell::number(1e3 * (centre - sample.position).norm(), 2),
        Cell::number(worst, 12),
    ]);
    if worst > 1e-9 {
        table.failures.push(format!("velocities are not across, by {worst:e}"));
    }
    (table, figure.column(1.0, vec![scene.into()]))
}

fn figure_5_4(_: &TableSettings) -> (Table, Figure) {
    let caption = "What the state of a push is: u, the angle at which the disk of radius r is touched; s, how far the contact is along the edge from the foot of the perpendicular (length h) through the centre of mass c, counter-clockwise positive; with ω and vT, the part's speed along T.";
    let figure = captioned("Figure 5.4: a disk pushes a polygon", [560.0, 440.0], caption);
    let definition = "The coordinates of a disk that pushes a polygon, and the contact found from them twice: from the disk and from the part.";
    let Some((part, edge)) = quadrilateral().and_then(|part| part.edge(0).ok().map(|edge| (part, edge))) else {
        return (failed(definition, "no part"), figure);
    };
    let (radius, u, s) = (0.015, 1.9, 0.016);
    let push = FromRest {
        body: part.body(),
        side: PartSide::Edge(edge),
        mu_g: MU_G,
        shape: FingerShape::Disk { radius },
        acceleration: Vector2::new(0.0, 0.3),
        law: ContactLaw::Frictionless,
        u,
        s,
    };
    let Some(sample) = push.run(&[0.0]).and_then(|run| run.samples.first().copied()) else {
        return (failed(definition, "no push"), figure);
    };
    let world = Isometry2::new(sample.position.coords, sample.theta);
    let (centre, contact) = (push.path().centre(0.0), push.contact(&sample));
    let mass = world * part.centre_of_mass();
    let foot = mass + Rotation2::new(sample.theta) * edge.normal * edge.height;
    let tangent = Rotation2::new(sample.theta) * Vector2::new(-edge.normal.y, edge.normal.x);
    let mut scene = PlotScene::new("");
    scene.polygon(&placed(part.polygon().vertices(), &sample), area(Colour::BLUE));
    scene.disk(centre, radius, Style::area(FINGER, 0.15).outlined(thin(FINGER)));
    let line = |scene: &mut PlotScene, from: Point2<f64>, to: Point2<f64>, name: &str, colour: Colour| {
        scene.polyline(&[from, to], Stroke::solid(colour, 2.0));
        let across = Vector2::new(to.y - from.y, from.x - to.x);
        scene.label(nalgebra::center(&from, &to), across, name, colour);
    };
    line(&mut scene, mass, foot, "h", Colour::GREEN);
    line(&mut scene, foot, contact, "s", FORCE);
    line(&mut scene, centre, contact, "r", Colour::BLACK);
    scene.polyline(&[centre, centre + Vector2::x() * radius], thin(FINGER).with(Dash::Dashed));
    let arc: Vec<_> = (0..=30)
        .map(|k| u * f64::from(k) / 30.0)
        .map(|t| centre + Vector2::new(t.cos(), t.sin()) * (0.35 * radius))
        .collect();
    scene.polyline(&arc, Stroke::solid(Colour::PURPLE, 1.4));
    scene.label(arc[15], Vector2::new(1.0, 1.0), "u", Colour::PURPLE);
    for (point, name, colour) in [(mass, "c", Colour::BLUE), (contact, "", FORCE), (centre, "", FINGER)] {
        scene.dot(point, colour);
        if !name.is_empty() {
            scene.label(point, Vector2::x(), name, colour);
        }
    }
    let miss = (contact - (foot + tangent * s)).norm();
    let mut table = Table::new(["coordinates", "u °", "s mm", "h mm", "r mm", "contacts apart mm"]);
    table.definitions.push(definition.to_owned());
    table.push([
        "disk and polygon".into(),
        Cell::number(u.to_degrees(), 1),
        Cell::number(1e3 * s, 1),
        Cell::number(1e3 * edge.height, 2),
        Cell::number(1e3 * radius, 1),
        Cell::number(1e3 * miss, 9),
    ]);
    if miss > 1e-12 {
        table.failures.push(format!("the contacts are {miss:e} m apart"));
    }
    (table, figure.column(1.0, vec![scene.into()]))
}

/// The disk's radius and motion of figures 5.5 and 6.6, m and m/s².
const DISK: f64 = 0.015;
/// See [`DISK`].
const UPWARDS: Vector2<f64> = Vector2::new(0.0, 0.3);

/// u at times after a push from rest that begins at s₀ of an edge, while the contact lasts.
fn angles(part: &Part, edge: usize, s0: f64, mu_g: f64, times: &[f64]) -> Option<Vec<f64>> {
    let push = FromRest {
        body: part.body(),
        side: PartSide::Edge(part.edge(edge).ok()?),
        mu_g,
        shape: FingerShape::Disk { radius: DISK },
        acceleration: UPWARDS,
        law: ContactLaw::Frictionless,
        u: FRAC_PI_2,
        s: s0,
    };
    let run = push.run(times)?;
    (run.samples.len() == times.len()).then(|| run.samples.iter().map(|sample| sample.state.u).collect())
}

/// Where a curve crosses a level, x between two of its points.
fn crossings(curve: &[[f64; 2]], level: f64) -> Vec<f64> {
    let between = curve.windows(2).filter(|pair| (pair[0][1] - level) * (pair[1][1] - level) < 0.0);
    between
        .map(|pair| pair[0][0] + (pair[1][0] - pair[0][0]) * (level - pair[0][1]) / (pair[1][1] - pair[0][1]))
        .collect()
}

fn figure_5_5(_: &TableSettings) -> (Table, Figure) {
    let caption = "(a) Where on the disk the contact is, over time, for two places a and b of an edge at which the push may have begun. (b) The same at t1 for every place between: where the curve meets the felt u1 is a resting pose; s0* is the true one.";
    let figure = captioned("Figure 5.5: the resting pose by shooting", [860.0, 400.0], caption);
    let definition = "A disk of 1.5 cm accelerates by 0.3 m/s² from rest, touched at 90°, and pushes edge 0 without friction at the finger, µ 0.3 on the table; t1 = 0.5 s. Places that explain what is felt at t1 if the push began at s0* = 6 mm.";
    let Some(part) = quadrilateral() else { return (failed(definition, "no part"), figure) };
    let (t1, truth, ends) = (0.5, 0.006, [-0.012, 0.014]);
    let mut over_time = Chart::new("(a) over time", ["time [s]", "u [°]"]);
    for (s0, name, colour) in
        [(ends[0], "s0 = a", Colour::BLUE), (ends[1], "s0 = b", Colour::GREEN), (truth, "s0*", FORCE)]
    {
        let steps = times(t1, 50);
        let Some(found) = angles(&part, 0, s0, MU_G, &steps) else { continue };
        let curve: Vec<_> = steps.iter().zip(&found).map(|(t, u)| [*t, u.to_degrees()]).collect();
        over_time.curve(name, &curve, Stroke::solid(colour, 1.8));
    }
    let by_place: Vec<_> = (0..=80)
        .map(|k| ends[0] + (ends[1] - ends[0]) * f64::from(k) / 80.0)
        .filter_map(|s0| Some([1e3 * s0, angles(&part, 0, s0, MU_G, &[t1])?[0].to_degrees()]))
        .collect();
    let Some(felt) = angles(&part, 0, truth, MU_G, &[t1]).map(|u| u[0].to_degrees()) else {
        return (failed(definition, "no push"), figure);
    };
    let found = crossings(&by_place, felt);
    let mut shooting = Chart::new("(b) at t1, by where it began", ["s0 [mm]", "u(t1; s0) [°]"]);
    shooting.curve("", &by_place, Stroke::solid(Colour::BLUE, 1.8));
    shooting.level(felt, "u1, felt");
    shooting.dots("resting pose", &found.iter().map(|s0| [*s0, felt]).collect::<Vec<_>>(), FORCE);
    let mut table = Table::new(["resting pose", "s0 mm", "felt u1 °"]);
    table.definitions.push(definition.to_owned());
    for (k, s0) in found.iter().enumerate() {
        table.push([(k + 1).to_string().into(), Cell::number(*s0, 2), Cell::number(felt, 2)]);
    }
    if !found.iter().any(|s0| (s0 - 1e3 * truth).abs() < 0.05) {
        table.failures.push(format!("the true place is not among {found:?} mm"));
    }
    (table, figure.column(1.0, vec![over_time.into()]).column(1.0, vec![shooting.into()]))
}

fn figure_5_6(_: &TableSettings) -> (Table, Figure) {
    const FRICTION: f64 = 0.4;
    let caption = "The friction cone (dashed) at the contact, µc 0.4, and the force of the finger on the part just after rest. (a) The force that keeps the contact from slipping is inside the cone: it rolls. (b) Pushed more along its edge it would be outside: the part slides, and the force is on the cone's edge.";
    let figure = captioned("Figure 5.6: rolling and sliding", [860.0, 420.0], caption);
    let definition = "A block of 6 cm × 4 cm pushed from rest by a disk, µc 0.4, µ 0.3 on the table, 0.02 s after it began: tangential over normal force.";
    let Some((part, edge)) = polygon([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]])
        .and_then(|part| part.edge(0).ok().map(|edge| (part, edge)))
    else {
        return (failed(definition, "no part"), figure);
    };
    let mut table = Table::new(["contact", "force along / into", "of the cone's", "slips"]);
    table.definitions.push(definition.to_owned());
    let mut figure = figure;
    for (title, aside, slides) in [("(a) rolling", 0.05, false), ("(b) sliding", 0.6, true)] {
        let push = FromRest {
            body: part.body(),
            side: PartSide::Edge(edge),
            mu_g: MU_G,
            shape: FingerShape::Disk { radius: DISK },
            acceleration: Vector2::new(aside, 0.5),
            law: ContactLaw::Coulomb { friction: FRICTION },
            u: FRAC_PI_2,
            s: 0.008,
        };
        let sample = push.run(&[0.0, 0.02]).and_then(|run| run.samples.last().copied());
        let Some((sample, force)) = sample.and_then(|sample| sample.force.map(|force| (sample, force))) else {
            table.failures.push(format!("{title}: no force"));
            continue;
        };
        let (contact, normal) = (push.contact(&sample), push.normal(&sample));
        let along = Vector2::new(-normal.y, normal.x);
        let mut scene = PlotScene::new(title);
        scene.polygon(&placed(part.polygon().vertices(), &sample), area(Colour::BLUE));
        scene.disk(push.path().centre(sample.t), DISK, Style::area(FINGER, 0.15).outlined(thin(FINGER)));
        for side in [-1.0, 1.0] {
            let edge_of_cone = (-normal + along * (side * FRICTION)) * 0.022;
            scene.polyline(&[contact, contact + edge_of_cone], Stroke::solid(Colour::BLACK, 1.2).with(Dash::Dashed));
        }
        let pushed = -normal * force.normal + along * force.tangential;
        scene.arrow(contact, pushed * (0.02 / pushed.norm()), FORCE);
        scene.key(Key::Arrow(FORCE), "force on the part");
        scene.key(Key::Line(Stroke::solid(Colour::BLACK, 1.2).with(Dash::Dashed)), "friction cone");
        let share = force.tangential / force.normal;
        table.push([
            title.into(),
            Cell::number(share, 4),
            Cell::number(share.abs() / FRICTION, 4),
            if slides { "yes" } else { "no" }.into(),
        ]);
        let on_edge = (share.abs() - FRICTION).abs() < 1e-9;
        if on_edge != slides || share.abs() > FRICTION + 1e-9 {
            table.failures.push(format!("{title}: force {share}"));
        }
        figure = figure.column(1.0, vec![scene.into()]);
    }
    (table, figure)
}

fn figure_6_6(_: &TableSettings) -> (Table, Figure) {
    let caption = "Where the disk feels a triangle after a push of 0.75 s, by where around the triangle it was touched at first (at 90° of the disk). One reading, here 105°, leaves the places where the curve meets the line; a second push tells them apart. The thesis measured the same with a robot; nothing measured is shown here.";
    let figure = captioned("Figure 6.6: the last contact by the first place (simulated)", [620.0, 420.0], caption);
    let definition = "A triangle of 12, 13 and 12 cm pushed from rest without friction at the finger by a disk of 1.5 cm that accelerates by 0.3 m/s², µ 0.3 on the table; s0 is counted around the outline from vertex 0. Places where u1 is 105°.";
    let Some(part) = polygon([[0.0, 0.0], [0.13, 0.0], [0.065, 0.1009]]) else {
        return (failed(definition, "no part"), figure);
    };
    let mut chart = Chart::new("", ["s0 around the outline [cm]", "u1 after 0.75 s [°]"]);
    chart.level(105.0, "felt");
    let mut table = Table::new(["place", "on edge", "s0 cm", "u1 °"]);
    table.definitions.push(definition.to_owned());
    let (mut from, mut found, mut longest) = (0.0, Vec::new(), 0);
    for (edge, side) in part.sides() {
        let length = side.s_max - side.s_min;
        let curve: Vec<_> = (1..160)
            .map(|k| length * f64::from(k) / 160.0)
            .filter_map(|way| {
                Some([1e2 * (from + way), angles(&part, edge, side.s_min + way, MU_G, &[0.75])?[0].to_degrees()])
            })
            .collect();
        longest = longest.max(curve.len());
        chart.curve("", &curve, Stroke::solid(Colour::BLUE, 1.8));
        found.extend(crossings(&curve, 105.0).into_iter().map(|s0| (edge, s0)));
        from += length;
    }
    chart.dots("places that explain it", &found.iter().map(|(_, s0)| [*s0, 105.0]).collect::<Vec<_>>(), FORCE);
    for (k, (edge, s0)) in found.iter().enumerate() {
        table.push([(k + 1).to_string().into(), Cell::count(*edge), Cell::number(*s0, 2), Cell::number(105.0, 1)]);
    }
    if found.len() < 2 || longest < 40 {
        table.failures.push(format!("{} places from at most {longest} pushes an edge", found.len()));
    }
    (table, figure.column(1.0, vec![chart.into()]))
}

fn figure_6_8(_: &TableSettings) -> (Table, Figure) {
    let caption = "Pairs of poses (blue, red) that nothing felt tells apart. (a) The finger pushes straight at the centre of mass, on whatever edge: the part translates and the contact stays where it is. (b) Two edges as far from the centre of mass, on a plane without friction: both give the same motion of the contact. The charts have two curves each, one on the other.";
    let figure = captioned("Figure 6.8: motions that do not tell poses apart", [900.0, 640.0], caption);
    let definition = "Pushes from rest without friction at the finger by a disk that accelerates by 0.3 m/s², for 0.6 s: how far the contact angles of two poses are apart at most. (a) µ 0.3 on the table, at the foot of the perpendicular of two edges; (b) no friction on the table, 8 mm beside it on two edges of one height. Beside them the same two places on two edges of different heights, which are told apart.";
    // Edges 0 and 2 are 2 cm from the centre of mass at the origin, edge 1 is not.
    let Some(part) = polygon([[-0.04, -0.02], [0.04, -0.02], [0.04, 0.02], [-0.04, 0.02]]) else {
        return (failed(definition, "no part"), figure);
    };
    let Some(kite) = kite() else { return (failed(definition, "no kite"), figure) };
    let mut table = Table::new(["poses", "edges", "u changes by °", "apart at most °"]);
    table.definitions.push(definition.to_owned());
    let steps = times(0.6, 60);
    let mut figure = figure;
    let cases = [
        ("(a) at the centre of mass", &part, [0, 1], 0.0, MU_G, true),
        ("(b) edges of one height", &kite, [0, 3], 0.008, 0.0, true),
        ("told apart", &part, [0, 1], 0.008, MU_G, false),
    ];
    for (title, part, edges, s0, mu_g, is_alike) in cases {
        let mut scene = PlotScene::new(title);
        let mut chart = Chart::new("", ["time [s]", "u [°]"]);
        chart.y_span_at_least(2.0);
        let mut felt = Vec::new();
        for (edge, colour) in edges.into_iter().zip([Colour::BLUE, Colour::VERMILLION]) {
            let Ok(side) = part.edge(edge) else { continue };
            let push = FromRest {
                body: part.body(),
                side: PartSide::Edge(side),
                mu_g,
                shape: FingerShape::Disk { radius: DISK },
                acceleration: UPWARDS,
                law: ContactLaw::Frictionless,
                u: FRAC_PI_2,
                s: s0,
            };
            let Some(run) = push.run(&steps).filter(|run| run.samples.len() == steps.len()) else {
                table.failures.push(format!("{title}: edge {edge} cannot be pushed"));
                continue;
            };
            for (k, sample) in [run.samples[0], run.last].iter().enumerate() {
                let stroke = Stroke::solid(colour, 1.4);
                let style =
                    if k == 0 { stroke.with(Dash::Dashed).into() } else { Style::area(colour, 0.1).outlined(stroke) };
                scene.polygon(&placed(part.polygon().vertices(), sample), style);
                scene.disk(push.path().centre(sample.t), DISK, thin(FINGER));
                scene.dot(push.contact(sample), FORCE);
            }
            let curve: Vec<_> = run.samples.iter().map(|sample| [sample.t, sample.state.u.to_degrees()]).collect();
            let dash = if felt.is_empty() { Dash::Solid } else { Dash::Dashed };
            let width = if felt.is_empty() { 3.0 } else { 1.6 };
            chart.curve(
                if felt.is_empty() { "blue pose" } else { "red pose" },
                &curve,
                Stroke::solid(colour, width).with(dash),
            );
            felt.push(curve);
        }
        let [first, second] = &felt[..] else { continue };
        let apart = first.iter().zip(second).map(|(a, b)| (a[1] - b[1]).abs()).fold(0.0, f64::max);
        table.push([
            title.into(),
            format!("{} and {}", edges[0], edges[1]).into(),
            Cell::number((first[60][1] - first[0][1]).abs(), 4),
            Cell::number(apart, 9),
        ]);
        if (apart < 1e-6) != is_alike {
            table.failures.push(format!("{title}: {apart:e}° apart"));
        }
        if is_alike {
            figure = figure.column(1.0, vec![scene.into(), chart.into()]);
        }
    }
    (table, figure)
}

/// A kite whose two lower edges are as far from the centre of mass, though no turn takes one to the other: what happens at one is not the other's mirror image, either.
fn kite() -> Option<Part> {
    polygon([[0.0, -0.045], [0.034, 0.012], [0.0, 0.03], [-0.034, 0.012]]).filter(|part| {
        let heights = [0, 3].map(|edge| part.edge(edge).map_or(0.0, |edge| edge.height));
        (heights[0] - heights[1]).abs() < 1e-9
    })
}

fn figure_c_1(_: &TableSettings) -> (Table, Figure) {
    let caption = "The integral of friction over a polygon is a sum of one triangle an edge, from the centre of rotation q: edges that run counter-clockwise about q add theirs (green), the others take theirs away (red). What is beyond the polygon is added once and taken away once.";
    let figure = captioned("Figure C.1: a polygon as triangles from the centre of rotation", [600.0, 440.0], caption);
    let definition = "∫ v̂ dA (I1, in cm²) over the triangle of each edge, by quadrature in the angle about q, and its sum beside that of the library.";
    let Some(part) = polygon([[-0.03, -0.02], [0.03, -0.025], [0.035, 0.015], [0.005, 0.005], [-0.02, 0.03]]) else {
        return (failed(definition, "no part"), figure);
    };
    let vertices = part.polygon().vertices();
    let q = Point2::new(-0.055, 0.012);
    let mut scene = PlotScene::new("");
    let mut table = Table::new(["edge", "share of the area cm²", "I1x cm²", "I1y cm²"]);
    table.definitions.push(definition.to_owned());
    let mut sum = (0.0, Vector2::zeros());
    for (k, (from, to)) in part.polygon().edges().enumerate() {
        let (a, b) = (from - q, to - q);
        let area = 0.5 * a.perp(&b);
        let colour = if area > 0.0 { Colour::GREEN } else { Colour::VERMILLION };
        scene.polygon(&[q, from, to], Style::area(colour, 0.18).outlined(thin(colour)));
        // ½ R² v̂ over the angle, R to the edge's line; Gauss's rule of two points in 400 parts.
        let sweep = a.perp(&b).atan2(a.dot(&b));
        let (start, direction) = (a.y.atan2(a.x), (b - a).normalize());
        let reach = |angle: f64| {
            let ray = Vector2::new(angle.cos(), angle.sin());
            (a.perp(&direction) / ray.perp(&direction), ray)
        };
        let part_of = sweep / 400.0;
        let integral: Vector2<f64> = (0..400)
            .flat_map(|i| [-1.0, 1.0].map(|side| f64::from(i) + 0.5 + side / 12.0_f64.sqrt()))
            .map(|i| reach(start + part_of * i))
            .map(|(radius, ray)| Vector2::new(-ray.y, ray.x) * (0.25 * radius * radius * part_of))
            .sum();
        sum = (sum.0 + area, sum.1 + integral);
        table.push([
            k.to_string().into(),
            Cell::number(1e4 * area, 4),
            Cell::number(1e4 * integral.x, 5),
            Cell::number(1e4 * integral.y, 5),
        ]);
        scene.label(nalgebra::center(&from, &to), Vector2::new(b.y - a.y, a.x - b.x), k.to_string(), Colour::BLACK);
    }
    scene.polygon(vertices, Stroke::solid(Colour::BLUE, 2.0));
    scene.dot(q, Colour::BLACK);
    scene.label(q, -Vector2::x(), "q", Colour::BLACK);
    scene.key(Key::Area(Style::area(Colour::GREEN, 0.18)), "added");
    scene.key(Key::Area(Style::area(Colour::VERMILLION, 0.18)), "taken away");
    table.push([
        "sum".into(),
        Cell::number(1e4 * sum.0, 4),
        Cell::number(1e4 * sum.1.x, 5),
        Cell::number(1e4 * sum.1.y, 5),
    ]);
    // A turn of 1 rad/s about q: the velocity of the origin is ẑ × (0 − q).
    let twist = Twist::new(Vector2::new(q.y, -q.x), 1.0);
    let wanted = SupportFriction::uniform(part.polygon()).mean_sliding(&twist).direction * part.polygon().area();
    table.push([
        "of the library".into(),
        Cell::number(1e4 * part.polygon().area(), 4),
        Cell::number(1e4 * wanted.x, 5),
        Cell::number(1e4 * wanted.y, 5),
    ]);
    if (sum.1 - wanted).norm() > 1e-9 * wanted.norm() || (sum.0 - part.polygon().area()).abs() > 1e-15 {
        table.failures.push(format!("{} and {wanted}", sum.1));
    }
    (table, figure.column(1.0, vec![scene.into()]))
}
