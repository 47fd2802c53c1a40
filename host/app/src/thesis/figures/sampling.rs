//! Figures 3.1 to 3.6 and B.1: points that tell polygons apart, and the reductions behind their hardness.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Point2, Vector2};
use palpate::corner::Corner;
use palpate::geometry::SimplePolygon;
use palpate::math::random::Draw;
use palpate::point_sampling::reductions::{Graph, combs, digits, flowers, nested, path_length};
use palpate::point_sampling::scenes::SceneKind;
use palpate::point_sampling::{Objective, Plan, Request, plan};

use super::{Illustration, captioned, thin};
use crate::pictures::plot::{Colour, Dash, Figure, Key, PlotScene, Stroke, Style};
use crate::thesis::{Cell, Table, TableSettings};

pub(super) const FIGURE_3_1: Illustration = Illustration {
    name: "figure-3.1",
    title: "twelve rest poses in a corner, told apart by four points",
    cases: 1,
    make: figure_3_1,
};
pub(super) const FIGURE_3_2: Illustration = Illustration {
    name: "figure-3.2",
    title: "polygons that need the fewest and the most points",
    cases: 1,
    make: figure_3_2,
};
pub(super) const FIGURE_3_3: Illustration =
    Illustration { name: "figure-3.3", title: "sets as polygons, in two ways", cases: 1, make: figure_3_3 };
pub(super) const FIGURE_3_4: Illustration =
    Illustration { name: "figure-3.4", title: "a graph with its midvertices", cases: 1, make: figure_3_4 };
pub(super) const FIGURE_3_5: Illustration =
    Illustration { name: "figure-3.5", title: "100 sparse polygons, and 100 poses", cases: 1, make: figure_3_5 };
pub(super) const FIGURE_3_6: Illustration =
    Illustration { name: "figure-3.6", title: "50 dense polygons, and 40 dense poses", cases: 1, make: figure_3_6 };
pub(super) const FIGURE_B_1: Illustration = Illustration {
    name: "figure-B.1",
    title: "the paths that replace an edge, k even and odd",
    cases: 1,
    make: figure_b_1,
};

const POINT: Colour = Colour::VERMILLION;

/// Polygons with the points that tell them apart.
fn told_apart(title: &str, polygons: &[SimplePolygon], plan: &Plan) -> PlotScene {
    let mut scene = PlotScene::new(title);
    for (k, polygon) in polygons.iter().enumerate() {
        let colour = Colour::SERIES[k % Colour::SERIES.len()];
        let style = if polygons.len() > 12 {
            Stroke::solid(Colour::BLUE, 0.5).into()
        } else {
            Style::area(colour, 0.06).outlined(thin(colour))
        };
        scene.polygon(polygon.vertices(), style);
    }
    for point in &plan.points {
        scene.dot(point.centre, POINT);
    }
    scene.key(Key::Dot(POINT), "point to ask");
    scene
}

/// What was found of one scene.
fn row(table: &mut Table, name: &str, polygons: usize, plan: &Plan) {
    table.push([
        name.into(),
        Cell::count(polygons),
        Cell::count(plan.regions),
        Cell::count(plan.points.len()),
        Cell::count(plan.lower_bound),
    ]);
    if !plan.indistinguishable.is_empty() {
        table.failures.push(format!("{name}: {:?} are not told apart", plan.indistinguishable));
    }
}

fn counted(definition: &str) -> Table {
    let mut table = Table::new(["scene", "polygons", "regions", "points", "no fewer than"]);
    table.definitions.push(definition.to_owned());
    table
}

fn fewest(polygons: &[SimplePolygon]) -> Plan {
    plan(polygons, &Request::default(), &|| false)
}

fn figure_3_1(_: &TableSettings) -> (Table, Figure) {
    let caption = "The poses in which a part can rest in a corner of two fences (dashed) with an edge flat against one. Whether four points are covered tells all twelve apart, and three cannot: 2³ < 12. Right: the regions that the poses cut the plane into, and the room around each point.";
    let figure = captioned("Figure 3.1: twelve poses, four points", [900.0, 430.0], caption);
    // Millimetres.
    let part = [[0.0, 0.0], [52.0, -4.0], [71.0, 23.0], [49.0, 58.0], [21.0, 37.0], [-9.0, 49.0], [-17.0, 21.0]];
    let part = SimplePolygon::new(part.map(|[x, y]: [f64; 2]| Point2::new(x * 1e-3, y * 1e-3)));
    let (Ok(part), Ok(corner)) = (part, Corner::new(FRAC_PI_2, Vector2::new(-1.0, -1.0))) else {
        return (Table::default(), figure);
    };
    let outlines: Vec<_> = corner.poses(&part).iter().filter_map(|pose| corner.placed(&part, pose).ok()).collect();
    let plan = fewest(&outlines);
    let fences = [Vector2::x(), Vector2::y()].map(|along| [Point2::origin(), Point2::from(along * 0.11)]);
    let fence = Stroke::solid(Colour::BLACK, 1.8).with(Dash::Dashed);
    let mut poses = told_apart("(a) the poses", &outlines, &plan);
    let mut regions = PlotScene::new("(b) their regions");
    for outline in &outlines {
        regions.polygon(outline.vertices(), Stroke::solid(Colour::DARK_GREY, 0.6));
    }
    for point in &plan.points {
        regions.disk(point.centre, point.radius, Style::area(POINT, 0.9));
    }
    for line in &fences {
        poses.polyline(line, fence);
        regions.polyline(line, fence);
    }
    let mut table = counted("Rest poses of one part in a right corner, and the fewest points that tell them apart.");
    row(&mut table, "a corner", outlines.len(), &plan);
    if (outlines.len(), plan.points.len()) != (12, 4) {
        table.failures.push(format!("{} poses, {} points", outlines.len(), plan.points.len()));
    }
    (table, figure.column(1.0, vec![poses.into()]).column(1.0, vec![regions.into()]))
}

fn figure_3_2(_: &TableSettings) -> (Table, Figure) {
    const COUNT: usize = 8;
    let caption = "Eight polygons each. (a) The blocks on top are the digits of a polygon's number, and each polygon has one strip more below than the one before: three points are enough, one a digit; those drawn are as good. (b) Each polygon lies in the next: every ring between two of them has to be asked for.";
    let figure = captioned("Figure 3.2: log₂ n points, or n − 1", [860.0, 460.0], caption);
    let mut table = counted("Lemma 4's two bounds, ⌈log₂ n⌉ and n − 1, reached by n = 8 polygons.");
    let panels = [("(a) three are enough", digits(COUNT), 3), ("(b) seven are needed", nested(COUNT), COUNT - 1)].map(
        |(title, polygons, wanted)| {
            let plan = fewest(&polygons);
            row(&mut table, title, polygons.len(), &plan);
            if plan.points.len() != wanted {
                table.failures.push(format!("{title}: {} points", plan.points.len()));
            }
            told_apart(title, &polygons, &plan)
        },
    );
    let figure = panels.into_iter().fold(figure, |figure, panel| figure.column(1.0, vec![panel.into()]));
    (table, figure)
}

fn figure_3_3(_: &TableSettings) -> (Table, Figure) {
    // Four elements; footnote 7's kind of sets.
    let sets = [vec![0, 1], vec![1, 2], vec![0, 3], vec![2, 3], vec![0]];
    let caption = "Five sets of four elements as polygons: R(a) belongs to all, R(x) to those that have x. Whoever finds the fewest points finds the fewest elements. In (b) all polygons are convex: the corners lie on one circle in 2m equal arcs, m being the number of elements (the thesis prints 2n).";
    let figure = captioned("Figure 3.3: sets as polygons", [860.0, 440.0], caption);
    let mut table = counted(
        "Theorem 6 and Corollary 7: the sets {x1, x2}, {x2, x3}, {x1, x4}, {x3, x4} and {x1} as polygons, in two ways.",
    );
    let mut panels = Vec::new();
    for (title, polygons) in [("(a) Theorem 6", combs(4, &sets)), ("(b) convex, Corollary 7", flowers(4, &sets))] {
        let plan = fewest(&polygons);
        row(&mut table, title, polygons.len(), &plan);
        let mut scene = told_apart(title, &polygons, &plan);
        let names = if panels.is_empty() {
            (0..4).map(|k| (Point2::new(0.01 * (2.0 * f64::from(k) + 0.5), 0.0135), k)).collect::<Vec<_>>()
        } else {
            (0..4)
                .map(|k| (TAU * (f64::from(k) + 0.5) / 4.0, k))
                .map(|(angle, k)| (Point2::new(angle.cos(), angle.sin()) * 0.046, k))
                .collect()
        };
        for (place, k) in names {
            scene.label(place, Vector2::zeros(), format!("R(x{})", k + 1), Colour::BLACK);
        }
        let common = if panels.is_empty() { Point2::new(0.035, -0.005) } else { Point2::origin() };
        scene.label(common, Vector2::zeros(), "R(a)", Colour::BLACK);
        if plan.regions != 5 || plan.points.len() != 3 {
            table.failures.push(format!("{title}: {} regions, {} points", plan.regions, plan.points.len()));
        }
        panels.push(scene);
    }
    let figure = panels.into_iter().fold(figure, |figure, panel| figure.column(1.0, vec![panel.into()]));
    (table, figure)
}

/// A graph at these places, its chosen vertices filled.
fn draw_graph(title: &str, graph: &Graph, places: &[Point2<f64>], chosen: &[usize], original: usize) -> PlotScene {
    let mut scene = PlotScene::new(title).without_axes();
    for &[u, v] in &graph.edges {
        scene.polyline(&[places[u], places[v]], Stroke::solid(Colour::GREY, 1.0));
    }
    for (v, place) in places.iter().enumerate() {
        let colour = if chosen.contains(&v) {
            POINT
        } else if v < original {
            Colour::BLUE
        } else {
            Colour::DARK_GREY
        };
        scene.dot(*place, colour);
    }
    scene
}

/// The largest set of vertices of which any two are at least so far apart: by trying all.
fn independent(graph: &Graph, k: usize) -> Vec<usize> {
    let mut distance = vec![vec![usize::MAX / 2; graph.vertices]; graph.vertices];
    (0..graph.vertices).for_each(|v| distance[v][v] = 0);
    graph.edges.iter().for_each(|&[u, v]| (distance[u][v], distance[v][u]) = (1, 1));
    for via in 0..graph.vertices {
        for u in 0..graph.vertices {
            for v in 0..graph.vertices {
                distance[u][v] = distance[u][v].min(distance[u][via] + distance[via][v]);
            }
        }
    }
    grown(&distance, k, &mut Vec::new(), 0)
}

fn grown(distance: &[Vec<usize>], k: usize, chosen: &mut Vec<usize>, from: usize) -> Vec<usize> {
    let mut best = chosen.clone();
    for v in from..distance.len() {
        if chosen.iter().all(|&u| distance[u][v] >= k) {
            chosen.push(v);
            let further = grown(distance, k, chosen, v + 1);
            if further.len() > best.len() {
                best = further;
            }
            chosen.pop();
        }
    }
    best
}

/// Sizes of the largest sets before and after a reduction, which it must not change.
fn independence(table: &mut Table, name: String, graph: &Graph, k: usize, reduced: &Graph) {
    let sizes = [independent(graph, 2).len(), independent(reduced, k).len()];
    table.push([
        name.as_str().into(),
        Cell::count(graph.vertices),
        Cell::count(reduced.vertices),
        Cell::count(reduced.edges.len()),
        Cell::count(sizes[0]),
        Cell::count(sizes[1]),
    ]);
    if sizes[0] != sizes[1] {
        table.failures.push(format!("{name}: {} and {} vertices", sizes[0], sizes[1]));
    }
}

fn graph_table(definition: &str) -> Table {
    let mut table = Table::new(["graph", "vertices", "after", "edges after", "independent", "after, by k"]);
    table.definitions.push(definition.to_owned());
    table
}

fn figure_3_4(_: &TableSettings) -> (Table, Figure) {
    let caption = "Left: red vertices are independent, no edge joins two. Right: with a midvertex on every edge (grey), and midvertices of edges with a common end joined, vertices that were neighbours are two steps apart, others at least three: the red ones are 3-independent.";
    let figure = captioned("Figure 3.4: independent sets become 3-independent", [860.0, 440.0], caption);
    let graph = Graph { vertices: 6, edges: vec![[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 0], [1, 4]] };
    let around = |k: usize| TAU * k as f64 / 6.0;
    let mut places: Vec<_> = (0..6).map(around).map(|angle| Point2::new(angle.cos(), angle.sin()) * 0.05).collect();
    let chosen = independent(&graph, 2);
    let plain = draw_graph("(a) a graph", &graph, &places, &chosen, 6);
    let reduced = graph.with_midvertices();
    // Off the line, so that edges along it stay apart.
    places.extend(
        graph
            .edges
            .iter()
            .map(|&[u, v]| {
                let along = places[v] - places[u];
                nalgebra::center(&places[u], &places[v]) + Vector2::new(along.y, -along.x) * 0.12
            })
            .collect::<Vec<_>>(),
    );
    let with = draw_graph("(b) with midvertices", &reduced, &places, &chosen, 6);
    let mut table = graph_table(
        "Lemma 11: the largest independent set of a graph, and the largest 3-independent one of the graph with midvertices, by trying all.",
    );
    independence(&mut table, "midvertices, k = 3".to_owned(), &graph, 3, &reduced);
    (table, figure.column(1.0, vec![plain.into()]).column(1.0, vec![with.into()]))
}

fn figure_b_1(_: &TableSettings) -> (Table, Figure) {
    let caption = "What takes the place of an edge (u, v): each vertex (blue) becomes the middle of a path, and the ends of the two paths are joined, for odd k through a midvertex. From u to v it is k − 1 steps, between vertices without an edge at least k.";
    let figure = captioned("Figure B.1: paths in place of an edge", [860.0, 400.0], caption);
    let graph = Graph { vertices: 2, edges: vec![[0, 1]] };
    let mut table = graph_table("Lemma 33: an edge and what takes its place; the largest sets, by trying all.");
    let panels = [(6, "(a) k = 6"), (7, "(b) k = 7")].map(|(k, title)| {
        let (reduced, length) = (graph.with_paths(k), path_length(k));
        independence(&mut table, format!("k = {k}"), &graph, k, &reduced);
        let mut places = Vec::new();
        for row in [1.0, -1.0] {
            places.extend((0..length).map(|i| Point2::new(0.012 * i as f64, 0.015 * row)));
        }
        places.extend((2 * length..reduced.vertices).map(|_| Point2::new(0.006 * (length - 1) as f64, 0.0)));
        let middles = [length / 2, length + length / 2];
        let mut scene = PlotScene::new(title).without_axes();
        for &[u, v] in &reduced.edges {
            scene.polyline(&[places[u], places[v]], Stroke::solid(Colour::GREY, 1.0));
        }
        for (v, place) in places.iter().enumerate() {
            scene.dot(*place, if middles.contains(&v) { Colour::BLUE } else { Colour::DARK_GREY });
        }
        for (name, middle) in ["u", "v"].into_iter().zip(middles) {
            let outward = if middle < length { Vector2::y() } else { -Vector2::y() };
            scene.label(places[middle], outward, name, Colour::BLUE);
        }
        scene
    });
    let figure = panels.into_iter().fold(figure, |figure, panel| figure.column(1.0, vec![panel.into()]));
    (table, figure)
}

/// Two scenes of the thesis's kinds, as its greedy choice solves them.
fn random_scenes(
    settings: &TableSettings,
    figure: Figure,
    mut table: Table,
    scenes: [(&'static str, SceneKind, usize, &str); 2],
) -> (Table, Figure) {
    let mut panels = Vec::new();
    for (title, kind, count, printed) in scenes {
        let polygons = kind.draw(&mut Draw::new(settings.seed), count);
        let plan = plan(&polygons, &Request { objective: Objective::Greedy, ..Request::default() }, &|| false);
        row(&mut table, title, count, &plan);
        table.notes.push(format!("{title}: the thesis's scene has {printed}."));
        panels.push(told_apart(title, &polygons, &plan));
    }
    let figure = panels.into_iter().fold(figure, |figure, panel| figure.column(1.0, vec![panel.into()]));
    (table, figure)
}

const SCENES: &str = "Scenes drawn as the thesis says, which leaves the walk open, so they are other ones; points as the greedy choice finds them.";

fn figure_3_5(settings: &TableSettings) -> (Table, Figure) {
    let caption = "A hundred polygons, and a hundred poses of one polygon, far apart: few overlap, so most points tell one polygon from all others, and half as many points as polygons are needed.";
    let figure = captioned("Figure 3.5: sparse polygons and their points", [900.0, 470.0], caption);
    random_scenes(
        settings,
        figure,
        counted(SCENES),
        [
            ("(a) polygons", SceneKind::SPARSE_SHAPES, 100, "1422 regions and 51 points"),
            ("(b) poses", SceneKind::SPARSE_POSES, 100, "1643 regions and 61 points"),
        ],
    )
}

fn figure_3_6(settings: &TableSettings) -> (Table, Figure) {
    let caption = "In a square of a quarter of the side everything overlaps: most points halve what is left, and far fewer are enough than there are polygons or poses. No choice has fewer than log₂ of these, 6.";
    let figure = captioned("Figure 3.6: dense polygons and their points", [900.0, 470.0], caption);
    random_scenes(
        settings,
        figure,
        counted(SCENES),
        [
            ("(a) polygons", SceneKind::DENSE_SHAPES, 50, "2678 regions and 13 points"),
            ("(b) poses", SceneKind::DENSE_POSES, 40, "4995 regions and 9 points (4955 in the caption)"),
        ],
    )
}
