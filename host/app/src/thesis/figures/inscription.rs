//! Figures 1.1, 2.1 to 2.5 and A.1: parts between lines, in cones, and in the worst case's triangle.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Matrix2, Point2, Rotation2, Vector2};
use palpate::geometry::{ConvexPolygon, Pose, SimplePolygon};
use palpate::inscription::{HalfPlane, Inscription, poses, poses_through, view};
use palpate::math::angle::wrap_angle;
use palpate::math::random::Draw;
use palpate::point_sampling::{Request, plan};

use super::{Illustration, area, captioned, draw_line, thin};
use crate::pictures::plot::{Colour, Dash, Figure, Key, PlotScene, Stroke, Style};
use crate::thesis::inscription::fan;
use crate::thesis::{Cell, Table, TableSettings};

pub(super) const FIGURE_1_1: Illustration = Illustration {
    name: "figure-1.1",
    title: "an 8-gon held by two lines and two points, or told apart by points",
    cases: 1000,
    make: figure_1_1,
};
pub(super) const FIGURE_2_1: Illustration =
    Illustration { name: "figure-2.1", title: "a part seen from two places, in two cones", cases: 1, make: figure_2_1 };
pub(super) const FIGURE_2_2: Illustration =
    Illustration { name: "figure-2.2", title: "a triangle slides in a cone", cases: 1, make: figure_2_2 };
pub(super) const FIGURE_2_3: Illustration =
    Illustration { name: "figure-2.3", title: "a polygon turns in a cone", cases: 1, make: figure_2_3 };
pub(super) const FIGURE_2_4: Illustration = Illustration {
    name: "figure-2.4",
    title: "a 6-gon with eight poses between three lines",
    cases: 20_000,
    make: figure_2_4,
};
pub(super) const FIGURE_2_5: Illustration =
    Illustration { name: "figure-2.5", title: "two poses of a 6-gon in two cones", cases: 20_000, make: figure_2_5 };
pub(super) const FIGURE_A_1: Illustration =
    Illustration { name: "figure-A.1", title: "a fan with six poses a vertex", cases: 1, make: figure_a_1 };

/// Radius within which parts are drawn, m: some centimetres across.
const RADIUS: f64 = 0.04;

/// Poses nearer than this are one, part sizes and rad.
const SAME_POSE: f64 = 1e-6;

/// A convex polygon of so many corners, none of them too flat to see.
fn convex(draw: &mut Draw, corners: usize) -> Option<SimplePolygon> {
    let polygon = draw.convex_polygon(2 * corners, RADIUS);
    let v = polygon.vertices();
    let edge = |i: usize| v[(i + 1) % v.len()] - v[i];
    let sharp = |i: usize| edge(i).perp(&edge((i + 1) % v.len())) > 0.02 * RADIUS * RADIUS;
    (v.len() == corners && (0..corners).all(sharp)).then_some(polygon)
}

/// The outline of a part in a pose.
fn placed(part: &SimplePolygon, pose: &Pose) -> Vec<Point2<f64>> {
    part.vertices().iter().map(|vertex| pose.isometry() * vertex).collect()
}

/// The line that touches a part from a direction.
fn supporting(outline: &[Point2<f64>], angle: f64) -> HalfPlane {
    let normal = Vector2::new(angle.cos(), angle.sin());
    HalfPlane::new(angle, outline.iter().map(|p| p.coords.dot(&normal)).fold(f64::NEG_INFINITY, f64::max))
}

fn poses_of(inscription: Inscription) -> Vec<Pose> {
    match inscription {
        Inscription::Poses(poses) => poses,
        Inscription::Underdetermined(_) => Vec::new(),
    }
}

/// Poses in millimetres and degrees, numbered.
fn pose_table(found: &[Pose], definition: String) -> Table {
    let mut table = Table::new(["pose", "x mm", "y mm", "turn °"]);
    table.definitions.push(definition);
    for (k, pose) in found.iter().enumerate() {
        table.push([
            (k + 1).to_string().into(),
            Cell::number(1e3 * pose.x, 2),
            Cell::number(1e3 * pose.y, 2),
            Cell::number(pose.theta.to_degrees(), 2),
        ]);
    }
    table
}

fn is_same(a: &Pose, b: &Pose) -> bool {
    wrap_angle(a.theta - b.theta).abs() < SAME_POSE && (a.x - b.x).hypot(a.y - b.y) < SAME_POSE * RADIUS
}

fn figure_1_1(settings: &TableSettings) -> (Table, Figure) {
    let truth = Pose { x: 0.0, y: 0.0, theta: 0.4 };
    let drawn = (0..settings.cases).find_map(|case| {
        let mut draw = Draw::case(settings.seed, case);
        let part = convex(&mut draw, 8)?;
        let outline = placed(&part, &truth);
        let lines = [draw.uniform(-2.2, -1.6), draw.uniform(2.6, 3.4)].map(|angle| supporting(&outline, angle));
        let on_edge = |draw: &mut Draw, edge: usize| {
            let (from, to) = (outline[edge], outline[(edge + 1) % outline.len()]);
            from + (to - from) * draw.uniform(0.2, 0.8)
        };
        let first = draw.index(8);
        let points = [on_edge(&mut draw, first), on_edge(&mut draw, (first + 3) % 8)];
        let found = poses_of(poses_through(&ConvexPolygon::new(&part).ok()?, &lines, &points));
        (found.len() == 1 && is_same(&found[0], &truth)).then_some((part, lines, points, found))
    });
    let title = "Figure 1.1: sensing an 8-gon by its geometry";
    let caption = "Left: any pose is possible; two lines that touch the outline and two points on it leave one. Right: three poses are possible; whether two points are covered tells them apart.";
    let figure = captioned(title, [860.0, 430.0], caption);
    let Some((part, lines, points, found)) = drawn else {
        let mut table = pose_table(&[], "Poses through two lines and two points.".to_owned());
        table.failures.push("no 8-gon was drawn that they hold".to_owned());
        return (table, figure);
    };
    let mut held = PlotScene::new("(a) held by lines and points");
    held.polygon(&placed(&part, &found[0]), area(Colour::BLUE));
    let middle = found[0].isometry() * part.centroid();
    for (k, line) in lines.iter().enumerate() {
        draw_line(&mut held, line, middle, 1.2 * RADIUS);
        held.label(middle - line.normal * line.beyond(middle), line.normal, format!("L{}", k + 1), Colour::BLACK);
    }
    for (k, point) in points.iter().enumerate() {
        held.dot(*point, Colour::VERMILLION);
        held.label(*point, point - middle, format!("p{}", k + 1), Colour::VERMILLION);
    }
    let possible =
        [[0.0, 0.0, 0.4], [0.022, 0.006, 1.3], [0.004, 0.024, 2.9]].map(|[x, y, theta]| Pose { x, y, theta });
    let outlines: Vec<_> = possible.iter().filter_map(|pose| SimplePolygon::new(placed(&part, pose)).ok()).collect();
    let told = plan(&outlines, &Request::default(), &|| false);
    let mut apart = PlotScene::new("(b) told apart by points");
    for (outline, colour) in outlines.iter().zip(Colour::SERIES) {
        apart.polygon(outline.vertices(), area(colour));
    }
    for (k, point) in told.points.iter().enumerate() {
        apart.dot(point.centre, Colour::BLACK);
        apart.label(point.centre, Vector2::x(), format!("q{}", k + 1), Colour::BLACK);
    }
    let mut table = pose_table(
        &found,
        "(a) Poses of the 8-gon that touch both lines and have both points on their outline; (b) points that tell three poses apart, and how many are needed.".to_owned(),
    );
    table.notes.push(format!("Points: {}, no fewer than {}.", told.points.len(), told.lower_bound));
    if told.points.len() != 2 {
        table.failures.push(format!("{} points for three poses", told.points.len()));
    }
    (table, figure.column(1.0, vec![held.into()]).column(1.0, vec![apart.into()]))
}

/// The part of figures 2.1 and 2.3, a corner at its origin.
fn quadrilateral() -> Option<SimplePolygon> {
    SimplePolygon::new([[0.0, 0.0], [0.045, -0.008], [0.058, 0.03], [0.012, 0.04]].map(Point2::from)).ok()
}

fn draw_cone(scene: &mut PlotScene, apex: Point2<f64>, angles: [f64; 2], length: f64) {
    draw_sides(scene, apex, angles, length);
    scene.dot(apex, Colour::BLACK);
}

/// A cone without a dot at its apex.
fn draw_sides(scene: &mut PlotScene, apex: Point2<f64>, angles: [f64; 2], length: f64) {
    for angle in angles {
        let end = apex + Vector2::new(angle.cos(), angle.sin()) * length;
        scene.polyline(&[apex, end], Stroke::solid(Colour::DARK_GREY, 1.2));
    }
}

fn figure_2_1(_: &TableSettings) -> (Table, Figure) {
    let caption = "Each sensor feels the two directions between which the part lies: a cone that its outline touches on both sides. The pose that touches all four sides is the part's; a thin outline is any other that does.";
    let figure = captioned("Figure 2.1: a part in two cones", [560.0, 420.0], caption);
    let truth = Pose { x: 0.01, y: 0.05, theta: 0.5 };
    let sites = [Point2::new(-0.07, 0.0), Point2::new(0.1, -0.02)];
    let seen = quadrilateral().and_then(|part| {
        let convex = ConvexPolygon::new(&part).ok()?;
        let cones = [view(&convex, &truth, sites[0])?, view(&convex, &truth, sites[1])?];
        let lines: Vec<_> = cones.iter().flatten().map(palpate::inscription::Bearing::half_plane).collect();
        let found = poses_of(poses(&convex, &lines));
        Some((part, cones, found))
    });
    let Some((part, cones, found)) = seen else { return (Table::default(), figure) };
    let mut scene = PlotScene::new("");
    for (k, (cone, site)) in cones.iter().zip(sites).enumerate() {
        draw_cone(&mut scene, site, cone.each_ref().map(|bearing| bearing.angle), 0.2);
        // Away from the part.
        let aside = Vector2::x() * (site.x - truth.x).signum();
        scene.label(site, aside, format!("sensor {}", k + 1), Colour::BLACK);
    }
    for pose in &found {
        let is_truth = is_same(pose, &truth);
        scene
            .polygon(&placed(&part, pose), if is_truth { area(Colour::BLUE) } else { thin(Colour::VERMILLION).into() });
    }
    let mut table = pose_table(&found, "All poses in both cones.".to_owned());
    if !found.iter().any(|pose| is_same(pose, &truth)) {
        table.failures.push("the part's own pose is not among them".to_owned());
    }
    (table, figure.column(1.0, vec![scene.into()]))
}

/// A cone with its apex at the origin, from this angle to that.
const CONE: [f64; 2] = [0.15, 1.25];

/// Outward normal angles of its two sides: right and left.
fn sides() -> [HalfPlane; 2] {
    [HalfPlane::new(CONE[0] - FRAC_PI_2, 0.0), HalfPlane::new(CONE[1] + FRAC_PI_2, 0.0)]
}

/// Where a turned outline's origin is once a corner of it lies on each side.
fn slid(corners: [Vector2<f64>; 2], turn: f64) -> Option<Vector2<f64>> {
    let [right, left] = sides().map(|line| line.normal);
    let turned = corners.map(|corner| Rotation2::new(turn) * corner);
    let lines = Matrix2::from_rows(&[right.transpose(), left.transpose()]);
    Some(-(lines.try_inverse()? * Vector2::new(right.dot(&turned[0]), left.dot(&turned[1]))))
}

/// How far along its side a corner lies.
fn along(angle: f64, place: Vector2<f64>) -> f64 {
    place.dot(&Vector2::new(angle.cos(), angle.sin()))
}

fn figure_2_2(_: &TableSettings) -> (Table, Figure) {
    let caption = "Corners p1 and p2 of a triangle slide along the sides of a cone while it turns. See p0 run along part of an ellipse (line), whose axes come from three of its points; all others lie on it.";
    let figure = captioned("Figure 2.2: a triangle slides in a cone", [560.0, 440.0], caption);
    let corners = [Vector2::new(0.02, -0.028), Vector2::new(0.03, 0.03)];
    let steps = 720_u32;
    let slide: Vec<_> = (0..steps)
        .filter_map(|k| {
            let turn = TAU * f64::from(k) / f64::from(steps);
            let origin = slid(corners, turn)?;
            let turned = corners.map(|corner| origin + Rotation2::new(turn) * corner);
            // On both sides of the cone, and not on their extensions.
            let is_in = along(CONE[0], turned[0]) >= 0.0 && along(CONE[1], turned[1]) >= 0.0;
            is_in.then_some((turn, origin, turned))
        })
        .collect();
    // p0 = P cos θ + Q sin θ: an ellipse about the apex.
    let at = |turn: f64| slid(corners, turn).unwrap_or_default();
    let (p, q) = (at(0.0), at(FRAC_PI_2));
    let svd = Matrix2::from_columns(&[p, q]).svd(true, false);
    let miss = slide.iter().map(|(turn, origin, _)| (origin - p * turn.cos() - q * turn.sin()).norm());
    let mut scene = PlotScene::new("");
    draw_cone(&mut scene, Point2::origin(), CONE, 0.105);
    // From where the arc begins: the turn jumps there.
    let jump = (1..slide.len()).find(|&k| slide[k].0 - slide[k - 1].0 > 0.1).unwrap_or(0);
    let arc: Vec<_> = slide[jump..].iter().chain(&slide[..jump]).collect();
    scene.polyline(
        &arc.iter().map(|(_, origin, _)| Point2::from(*origin)).collect::<Vec<_>>(),
        Stroke::solid(Colour::VERMILLION, 2.0),
    );
    let ellipse: Vec<_> =
        (0..=240).map(|k| TAU * f64::from(k) / 240.0).map(|t| Point2::from(p * t.cos() + q * t.sin())).collect();
    scene.polyline(&ellipse, thin(Colour::VERMILLION).with(Dash::Dashed));
    for (k, share) in [0.1, 0.4, 0.7].into_iter().enumerate() {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below the number of steps")]
        let (_, origin, turned) = arc[(share * arc.len() as f64) as usize];
        let triangle = [*origin, turned[0], turned[1]].map(Point2::from);
        scene.polygon(&triangle, area(Colour::SERIES[[0, 2, 3][k]]));
        if k == 1 {
            for (name, corner) in ["p0", "p1", "p2"].into_iter().zip(triangle) {
                scene.label(corner, Vector2::new(1.0, 1.0), name, Colour::BLACK);
            }
        }
    }
    scene.key(Key::Line(Stroke::solid(Colour::VERMILLION, 2.0)), "way of p0");
    scene.key(Key::Line(thin(Colour::VERMILLION).with(Dash::Dashed)), "its ellipse");
    let mut table = Table::new(["ellipse", "long semi-axis mm", "short semi-axis mm", "largest miss mm"]);
    table.definitions.push(
        "The ellipse of p0 while p1 and p2 slide along the sides of a cone, and how far p0 is off it at most."
            .to_owned(),
    );
    let miss = miss.fold(0.0, f64::max);
    table.push([
        "p0".into(),
        Cell::number(1e3 * svd.singular_values.max(), 3),
        Cell::number(1e3 * svd.singular_values.min(), 3),
        Cell::number(1e3 * miss, 9),
    ]);
    if miss > 1e-12 {
        table.failures.push(format!("p0 leaves its ellipse by {miss:e} m"));
    }
    (table, figure.column(1.0, vec![scene.into()]))
}

fn figure_2_3(_: &TableSettings) -> (Table, Figure) {
    let caption = "A convex polygon turns once in a cone, touching both sides. Between two dots the same two corners touch and its corner p0 runs along an arc of one ellipse; at a dot an edge lies on a side. There are as many arcs as there are changes, at most 2n.";
    let figure = captioned("Figure 2.3: a polygon turns in a cone", [600.0, 440.0], caption);
    let Some((part, convex)) = quadrilateral().and_then(|part| Some((part.clone(), ConvexPolygon::new(&part).ok()?)))
    else {
        return (Table::default(), figure);
    };
    let corner_at = |corner: usize| part.vertices()[convex.vertex(corner)].coords;
    let touching = |turn: f64| sides().map(|line| convex.support(wrap_angle(line.angle - turn)));
    let origin = |turn: f64| slid(touching(turn).map(corner_at), turn).unwrap_or_default();
    let steps = 1440_u32;
    let turn_of = |k: u32| TAU * f64::from(k) / f64::from(steps);
    let path: Vec<_> = (0..=steps).map(|k| Point2::from(origin(turn_of(k)))).collect();
    let changes: Vec<_> = (0..steps).filter(|&k| touching(turn_of(k)) != touching(turn_of(k + 1))).collect();
    let mut scene = PlotScene::new("");
    draw_sides(&mut scene, Point2::origin(), CONE, 0.11);
    scene.polyline(&path, Stroke::solid(Colour::VERMILLION, 1.8));
    for (k, colour) in [0_u32, 400, 900].into_iter().zip([Colour::BLUE, Colour::GREEN, Colour::PURPLE]) {
        let (place, turn) = (origin(turn_of(k)), Rotation2::new(turn_of(k)));
        let outline: Vec<_> = part.vertices().iter().map(|p| Point2::from(place + turn * p.coords)).collect();
        scene.polygon(&outline, area(colour));
        scene.label(outline[0], Vector2::new(-1.0, -1.0), "p0", colour);
    }
    for k in &changes {
        scene.dot(Point2::from(origin(turn_of(*k))), Colour::BLACK);
    }
    scene.key(Key::Line(Stroke::solid(Colour::VERMILLION, 1.8)), "way of p0");
    scene.key(Key::Dot(Colour::BLACK), "an edge lies on a side");
    let mut table = Table::new(["touching corners change at °", "on the right side", "on the left side"]);
    table.definitions.push(
        "Turns at which other corners begin to touch; corners are numbered from p0, counter-clockwise.".to_owned(),
    );
    for k in &changes {
        let [right, left] = touching(turn_of(k + 1)).map(|corner| convex.vertex(corner));
        table.push([Cell::number(turn_of(*k).to_degrees(), 1), Cell::count(right), Cell::count(left)]);
    }
    if changes.is_empty() || changes.len() > 2 * part.vertices().len() {
        table.failures.push(format!("{} changes", changes.len()));
    }
    (table, figure.column(1.0, vec![scene.into()]))
}

/// The corners between lines, each with the next.
fn triangle(lines: &[HalfPlane]) -> Vec<Point2<f64>> {
    let crossing = |(k, a): (usize, &HalfPlane)| {
        let b = &lines[(k + 1) % lines.len()];
        let rows = Matrix2::from_rows(&[a.normal.transpose(), b.normal.transpose()]);
        let offset = |line: &HalfPlane| line.normal.dot(&line.point.coords);
        rows.lu().solve(&Vector2::new(offset(a), offset(b))).map(Point2::from)
    };
    lines.iter().enumerate().filter_map(crossing).collect()
}

/// A part with its lines and all its poses, the true one first.
type Ambiguous = (SimplePolygon, Vec<HalfPlane>, Vec<Pose>);

/// The first drawn that has so many poses.
fn ambiguous(
    settings: &TableSettings,
    wanted: usize,
    lines: impl Fn(&mut Draw, &SimplePolygon, &Pose) -> Option<Vec<HalfPlane>>,
) -> Option<Ambiguous> {
    (0..settings.cases).find_map(|case| {
        let mut draw = Draw::case(settings.seed, case);
        let part = convex(&mut draw, 6)?;
        let truth = Pose { x: 0.0, y: 0.0, theta: draw.uniform(-PI, PI) };
        let lines = lines(&mut draw, &part, &truth)?;
        let mut found = poses_of(poses(&ConvexPolygon::new(&part).ok()?, &lines));
        let own = found.iter().position(|pose| is_same(pose, &truth))?;
        found.swap(0, own);
        (found.len() == wanted).then_some((part, lines, found))
    })
}

fn figure_2_4(settings: &TableSettings) -> (Table, Figure) {
    let caption = "The first pose is real: the three lines were laid at it. The seven others touch the same lines from the same sides, so nothing tells them apart but a fourth line. A dot marks the same corner in all.";
    let mut figure = captioned("Figure 2.4: eight poses between three lines", [900.0, 520.0], caption);
    let drawn = ambiguous(settings, 8, |draw, part, truth| {
        let outline = placed(part, truth);
        let first = draw.uniform(0.0, TAU);
        // The triangle that the lines form shall be closed, and no larger than the page.
        Some(
            [first, first + draw.uniform(1.7, 2.5), first - draw.uniform(1.7, 2.5)]
                .map(|angle| supporting(&outline, angle))
                .to_vec(),
        )
    });
    let definition = "All poses of a random 6-gon that touch three lines.".to_owned();
    let Some((part, lines, found)) = drawn else {
        let mut table = pose_table(&[], definition);
        table.failures.push("no 6-gon was drawn with eight poses".to_owned());
        return (table, figure);
    };
    let triangle = triangle(&lines);
    for column in 0..4 {
        let panels = [column, column + 4].map(|k| {
            let mut scene = PlotScene::new(if k == 0 { "1: real".to_owned() } else { (k + 1).to_string() });
            scene.polygon(&triangle, Stroke::solid(Colour::BLACK, 1.2));
            scene.polygon(&placed(&part, &found[k]), area(if k == 0 { Colour::BLUE } else { Colour::VERMILLION }));
            let first = found[k].isometry() * part.vertices()[0];
            scene.dot(first, Colour::BLACK);
            scene.into()
        });
        figure = figure.column(1.0, panels.into());
    }
    (pose_table(&found, definition), figure)
}

fn figure_2_5(settings: &TableSettings) -> (Table, Figure) {
    let caption = "The blue pose is real; the other touches the same four lines of sight. Two cones seldom leave two poses, and then the part has to be looked at from a third place. A dot marks the same corner in both.";
    let figure = captioned("Figure 2.5: two poses in two cones", [600.0, 460.0], caption);
    let sites = |draw: &mut Draw| {
        [0, 1].map(|_| draw.uniform(0.0, TAU)).map(|angle| Point2::new(angle.cos(), angle.sin()) * (2.2 * RADIUS))
    };
    let apexes = std::cell::RefCell::new([Point2::origin(); 2]);
    let drawn = ambiguous(settings, 2, |draw, part, truth| {
        let apex = sites(draw);
        apexes.replace(apex);
        let convex = ConvexPolygon::new(part).ok()?;
        let cones = [view(&convex, truth, apex[0])?, view(&convex, truth, apex[1])?];
        // Two cones that look past each other.
        ((apex[0] - apex[1]).norm() > 1.5 * RADIUS).then_some(())?;
        Some(cones.iter().flatten().map(palpate::inscription::Bearing::half_plane).collect())
    });
    let definition = "All poses of a random 6-gon in two cones.".to_owned();
    let Some((part, lines, found)) = drawn else {
        let mut table = pose_table(&[], definition);
        table.failures.push("no 6-gon was drawn with two poses".to_owned());
        return (table, figure);
    };
    let mut scene = PlotScene::new("");
    for (site, cone) in apexes.borrow().iter().zip(lines.chunks(2)) {
        for line in cone {
            // Away from the sensor along the line, towards the part.
            let along = Vector2::new(-line.normal.y, line.normal.x);
            let towards = along * (found[0].isometry() * part.centroid() - site).dot(&along).signum();
            scene.polyline(&[*site, site + towards * (4.5 * RADIUS)], thin(Colour::DARK_GREY));
        }
        scene.dot(*site, Colour::BLACK);
    }
    for (pose, colour) in found.iter().zip([Colour::BLUE, Colour::VERMILLION]) {
        scene.polygon(&placed(&part, pose), area(colour));
        scene.dot(pose.isometry() * part.vertices()[0], colour);
    }
    scene.key(Key::Dot(Colour::BLACK), "sensor");
    scene.key(Key::Area(area(Colour::BLUE)), "real");
    scene.key(Key::Area(area(Colour::VERMILLION)), "the other");
    (pose_table(&found, definition), figure.column(1.0, vec![scene.into()]))
}

/// Vertices of the fan that is drawn.
const FAN: u32 = 5;

fn figure_a_1(_: &TableSettings) -> (Table, Figure) {
    let caption = "A fan of 5 corners, the first in the centre of the arc on which the others are, in an equilateral triangle. Left: 6(n − 1) = 24 poses have that corner in a corner of the triangle; right: six others. 6n in all, as many as there can be.";
    let figure = captioned("Figure A.1: a part with six poses a corner", [860.0, 440.0], caption);
    let (centre, outline, lines, found) = fan(FAN, 0.5);
    let corners = triangle(&lines);
    let is_in_corner = |pose: &Pose| corners.iter().any(|corner| (pose.isometry() * centre - corner).norm() < 1e-6);
    let (inner, others): (Vec<_>, Vec<_>) = found.iter().partition(|pose| is_in_corner(pose));
    let panel = |title: &str, poses: &[&Pose]| {
        let mut scene = PlotScene::new(title);
        scene.polygon(&corners, Stroke::solid(Colour::BLACK, 1.6));
        for (k, pose) in poses.iter().enumerate() {
            let colour = Colour::SERIES[k % Colour::SERIES.len()];
            let placed: Vec<_> = outline.iter().map(|p| pose.isometry() * p).collect();
            scene.polygon(&placed, Style::area(colour, 0.05).outlined(thin(colour)));
            scene.dot(pose.isometry() * centre, Colour::BLACK);
        }
        scene
    };
    let mut table = Table::new(["poses", "found", "as many as"]);
    table
        .definitions
        .push(format!("A fan of n = {FAN} corners whose radius is in the middle of what appendix A allows."));
    table.push(["its first corner in the triangle's".into(), Cell::count(inner.len()), "6(n − 1)".into()]);
    table.push(["others".into(), Cell::count(others.len()), "6".into()]);
    if inner.len() != 6 * (FAN as usize - 1) || others.len() != 6 {
        table.failures.push(format!("{} and {} poses", inner.len(), others.len()));
    }
    let left = panel("(a) turned about a corner", &inner);
    let right = panel("(b) the six others", &others);
    (table, figure.column(1.0, vec![left.into()]).column(1.0, vec![right.into()]))
}
