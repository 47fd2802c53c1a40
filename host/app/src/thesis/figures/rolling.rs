//! Figures 7.2 and 7.3: the frames of a body on a palm, and its surface's sections at the contact.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point2, UnitQuaternion, Vector2, Vector3};
use palpate::rolling::{Model, RollState, RollingBody, Shape, Spin};

use super::{Illustration, area, captioned, thin};
use crate::pictures::plot::{Colour, Dash, Figure, Key, PlotScene, Stroke, Style};
use crate::thesis::{Cell, Table, TableSettings};

pub(super) const FIGURE_7_2: Illustration =
    Illustration { name: "figure-7.2", title: "frames of body, palm and contact", cases: 1, make: figure_7_2 };
pub(super) const FIGURE_7_3: Illustration = Illustration {
    name: "figure-7.3",
    title: "sections in the principal directions, with their radii of curvature",
    cases: 1,
    make: figure_7_3,
};

/// Semi-axes of the body, m.
const SEMI_AXES: [f64; 3] = [0.02, 0.03, 0.04];

/// The body on the palm, and how it turns.
fn state() -> RollState {
    let attitude = UnitQuaternion::from_euler_angles(0.9, 0.35, 0.5);
    RollState { orientation: attitude.into_inner(), omega: Vector3::new(2.0, -3.0, 1.0), u: Vector2::zeros() }
}

/// x, y, z at the contact, body axes: principal directions, the longer radius first, and the normal. With the radii.
fn contact_frame(shape: &Shape, normal: &Vector3<f64>) -> (Matrix3<f64>, [f64; 2]) {
    let eigen = shape.local(normal, &Vector3::zeros()).hessian.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let x = eigen.eigenvectors.column(order[0]).into_owned();
    (Matrix3::from_columns(&[x, normal.cross(&x), *normal]), [order[0], order[1]].map(|k| eigen.eigenvalues[k]))
}

/// From above and the side: palm axes to the page.
fn seen(p: Vector3<f64>) -> Point2<f64> {
    let (turn, tilt) = (0.55_f64, 0.42_f64);
    let across = p.x * turn.cos() - p.y * turn.sin();
    let away = p.x * turn.sin() + p.y * turn.cos();
    Point2::new(across, p.z * tilt.cos() + away * tilt.sin())
}

/// The direction that [`seen`] looks along, palm axes.
fn line_of_sight() -> Vector3<f64> {
    let unit = |p: Vector3<f64>| seen(p).coords;
    let (x, y, z) = (unit(Vector3::x()), unit(Vector3::y()), unit(Vector3::z()));
    Vector3::new(x.x, y.x, z.x).cross(&Vector3::new(x.y, y.y, z.y)).normalize()
}

fn axes(scene: &mut PlotScene, at: Vector3<f64>, frame: &Matrix3<f64>, names: [&str; 3], length: f64, colour: Colour) {
    for (axis, name) in frame.column_iter().zip(names) {
        let vector = seen(axis * length).coords;
        scene.arrow(seen(at), vector, colour);
        scene.label(seen(at) + vector, vector, name, colour);
    }
}

fn figure_7_2(_: &TableSettings) -> (Table, Figure) {
    let caption = "A body on the palm (grey) with the frames that the thesis uses: of the palm (black); of the body, along its principal axes from its centre of mass (blue); and at the contact, x and y along the principal curvatures, z out of the body, into the palm (red).";
    let figure = captioned("Figure 7.2: frames of body, palm and contact", [620.0, 480.0], caption);
    let definition = "An ellipsoid of 4, 6 and 8 cm on a palm: height of its centre of mass, where it touches, and how far the contact's z is from straight down.";
    let (state, Ok(body)) = (state(), RollingBody::ellipsoid(SEMI_AXES)) else { return (Table::default(), figure) };
    let attitude = state.attitude().to_rotation_matrix();
    let normal = state.normal();
    let (frame, _) = contact_frame(body.shape(), &normal);
    let contact = body.shape().contact(&normal);
    // The contact is at the palm's origin.
    let centre = attitude * -contact;
    let place = |p: Vector3<f64>| seen(centre + attitude * p);
    let mut scene = PlotScene::new("").without_axes();
    let palm: Vec<_> = [[-0.05, -0.05], [0.07, -0.05], [0.07, 0.06], [-0.05, 0.06]]
        .map(|[x, y]| seen(Vector3::new(x, y, 0.0)))
        .to_vec();
    scene.polygon(&palm, Style::area(Colour::GREY, 0.2).outlined(thin(Colour::GREY)));
    // The rim: where the surface's normal is across the line of sight.
    let sight = attitude.inverse() * line_of_sight();
    let first = sight.cross(&Vector3::x()).normalize();
    let second = sight.cross(&first);
    let ring = |a: Vector3<f64>, b: Vector3<f64>| -> Vec<Point2<f64>> {
        (0..120)
            .map(|k| TAU * f64::from(k) / 120.0)
            .map(|t| place(body.shape().contact(&(a * t.cos() + b * t.sin()))))
            .collect()
    };
    scene.polygon(&ring(first, second), area(Colour::BLUE));
    for (a, b) in [(Vector3::x(), Vector3::y()), (Vector3::y(), Vector3::z()), (Vector3::z(), Vector3::x())] {
        scene.polygon(&ring(a, b), Stroke::solid(Colour::BLUE.faded(0.5), 0.6).with(Dash::Dashed));
    }
    axes(&mut scene, centre, attitude.matrix(), ["xB", "yB", "zB"], 0.03, Colour::BLUE);
    axes(&mut scene, Vector3::new(-0.035, 0.02, 0.0), &Matrix3::identity(), ["xP", "yP", "zP"], 0.022, Colour::BLACK);
    axes(&mut scene, Vector3::zeros(), &(attitude.matrix() * frame), ["x", "y", "z"], 0.02, Colour::VERMILLION);
    scene.dot(seen(Vector3::zeros()), Colour::VERMILLION);
    scene.dot(seen(centre), Colour::BLUE);
    scene.key(Key::Dot(Colour::BLUE), "centre of mass");
    scene.key(Key::Dot(Colour::VERMILLION), "contact");
    let down = (attitude * normal + Vector3::z()).norm();
    let mut table = Table::new(["body", "height mm", "contact x mm", "contact y mm", "contact z mm", "z off down rad"]);
    table.definitions.push(definition.to_owned());
    let mm = |value: f64| Cell::number(1e3 * value, 2);
    table.push(["ellipsoid".into(), mm(centre.z), mm(contact.x), mm(contact.y), mm(contact.z), Cell::number(down, 12)]);
    if down > 1e-12 || frame.determinant() < 0.0 || (centre.z - body.shape().height(&normal)).abs() > 1e-12 {
        table.failures.push(format!("{down:e} off, height {}", centre.z));
    }
    (table, figure.column(1.0, vec![scene.into()]))
}

fn figure_7_3(_: &TableSettings) -> (Table, Figure) {
    let caption = "The body of figure 7.2 cut along the principal directions x and y of its contact, with the circles that bend as the surface does there (dashed) and their centres. Rolling moves the contact along x by the longer radius times the turn about y, along y by the shorter times that about x.";
    let figure = captioned("Figure 7.3: principal sections at the contact", [860.0, 460.0], caption);
    let definition = "Radii of curvature along the principal directions, and the contact's speed over the surface: of the library's motion, and −ρ1 ωy along x, ρ2 ωx along y.";
    let (state, Ok(body)) = (state(), RollingBody::ellipsoid(SEMI_AXES)) else { return (Table::default(), figure) };
    let normal = state.normal();
    let (frame, radii) = contact_frame(body.shape(), &normal);
    let contact = body.shape().contact(&normal);
    let quadric = Matrix3::from_diagonal(&Vector3::from(SEMI_AXES.map(|a| 1.0 / (a * a))));
    let mut table = Table::new(["section", "radius mm", "ω across rad/s", "speed mm/s", "of the motion mm/s"]);
    table.definitions.push(definition.to_owned());
    let rates = Model { body: &body, spin: Spin::Free }.rates(&state, &Vector3::zeros());
    // u' = A β', seen along the contact's axes.
    let palm_rate = Vector3::new(rates.u.x, rates.u.y, 0.0);
    let moved = state.attitude().inverse() * palm_rate;
    let mut figure = figure;
    for (axis, name) in ["x", "y"].into_iter().enumerate() {
        let across = frame.column(axis).into_owned();
        let radius = radii[axis];
        let mut scene = PlotScene::new(format!("({}) along {name}", ["a", "b"][axis])).with_axes([name, "height"]);
        // Rays from the contact into the body, in the plane of the section.
        let section: Vec<_> = (1..180)
            .map(|k| TAU / 2.0 * f64::from(k) / 180.0)
            .filter_map(|angle| {
                let ray = across * angle.cos() - normal * angle.sin();
                let way = -2.0 * ray.dot(&(quadric * contact)) / ray.dot(&(quadric * ray));
                (way > 0.0).then(|| Point2::new(way * angle.cos(), way * angle.sin()))
            })
            .collect();
        scene.polygon(&[&[Point2::origin()][..], &section].concat(), area(Colour::BLUE));
        let centre = Point2::new(0.0, radius);
        scene.disk(centre, radius, Stroke::solid(Colour::VERMILLION, 1.4).with(Dash::Dashed));
        scene.polyline(&[Point2::origin(), centre], Stroke::solid(Colour::VERMILLION, 1.4));
        scene.dot(centre, Colour::VERMILLION);
        scene.label(
            nalgebra::center(&Point2::origin(), &centre),
            Vector2::x(),
            format!("ρ{}", axis + 1),
            Colour::VERMILLION,
        );
        scene.polyline(&[Point2::new(-0.05, 0.0), Point2::new(0.05, 0.0)], Stroke::solid(Colour::DARK_GREY, 1.6));
        scene.dot(Point2::origin(), Colour::BLACK);
        scene.key(Key::Area(area(Colour::BLUE)), "the body's section");
        scene.key(Key::Line(Stroke::solid(Colour::VERMILLION, 1.4).with(Dash::Dashed)), "circle of curvature");
        let (turn, sign) = if axis == 0 {
            (frame.column(1).dot(&state.omega), -1.0)
        } else {
            (frame.column(0).dot(&state.omega), 1.0)
        };
        let (wanted, got) = (sign * radius * turn, moved.dot(&across));
        table.push([
            name.into(),
            Cell::number(1e3 * radius, 3),
            Cell::number(turn, 4),
            Cell::number(1e3 * wanted, 4),
            Cell::number(1e3 * got, 4),
        ]);
        if (wanted - got).abs() > 1e-12 {
            table.failures.push(format!("along {name}: {wanted} and {got} m/s"));
        }
        figure = figure.column(1.0, vec![scene.into()]);
    }
    (table, figure)
}
