//! The figures of a recorded run: force, contact and belief over time, and where the part was.
//!
//! Pure. Units: s since the run began; what is drawn otherwise is named on the axes. Errors: none.

use nalgebra::{Point2, Vector2};
use palpate::geometry::Pose;
use palpate::pushing::dynamics::Part;

use super::plot::{Chart, Colour, Dash, Figure, Key, PlotScene, Stroke, Style};

/// Points of a curve at the most: more are drawn as how far they reach within each of so many pieces.
const PIECES: usize = 700;

/// Size of a figure with one chart, and with the plane.
const CHART: [f64; 2] = [960.0, 300.0];
const PLANE: [f64; 2] = [960.0, 520.0];

/// Poses of the likeliest hypothesis that are drawn on the way.
const ON_THE_WAY: usize = 8;

/// Hypotheses that are drawn at the end, as faint as they are unlikely.
const DRAWN_MAX: usize = 40;

/// Least extents of the charts: N or units of force, degrees.
const SPANS_MIN: [f64; 2] = [0.01, 1.0];

/// Colours of what is along x and along y.
const ALONG: [Colour; 2] = [Colour::VERMILLION, Colour::PURPLE];

/// A value over time.
pub type Series = Vec<[f64; 2]>;

/// Draws values over time: as a line, or where there are many as how far they reach and their means.
fn draw(chart: &mut Chart, name: &str, points: &[[f64; 2]], colour: Colour) {
    if points.len() <= 2 * PIECES {
        chart.curve(name, points, Stroke::solid(colour, 1.2));
        return;
    }
    let pieces = points.chunks(points.len().div_ceil(PIECES));
    let (bands, means): (Vec<_>, Vec<_>) = pieces.map(reach).unzip();
    chart.band("", &bands, colour);
    chart.curve(name, &means, Stroke::solid(colour, 1.2));
}

/// From where to where a piece reaches, and its mean; both at its middle.
fn reach(piece: &[[f64; 2]]) -> ([f64; 3], [f64; 2]) {
    let t = 0.5 * (piece[0][0] + piece[piece.len() - 1][0]);
    let values = piece.iter().map(|point| point[1]).filter(|value| value.is_finite());
    let (low, high) = values.clone().fold((f64::NAN, f64::NAN), |(low, high), value| (value.min(low), value.max(high)));
    let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value));
    ([t, low, high], [t, sum / count])
}

/// Force along x and y, with moments that were marked.
#[must_use]
pub fn force(force: &[(f64, Vector2<f64>)], unit: &str, marks: &[(f64, String)]) -> Figure {
    let mut chart = Chart::new("", ["time [s]", unit]);
    chart.y_span_at_least(SPANS_MIN[0]);
    for (axis, (name, colour)) in ["Fx", "Fy"].into_iter().zip(ALONG).enumerate() {
        let points: Series = force.iter().map(|(t, force)| [*t, force[axis]]).collect();
        draw(&mut chart, name, &points, colour);
    }
    marks.iter().for_each(|(t, mark)| chart.instant(*t, mark.as_str()));
    Figure::new("", CHART[0], CHART[1]).panel(chart)
}

/// Contact angle with two standard deviations, in degrees, while something is touched.
#[must_use]
pub fn contact(angles: &[[f64; 3]]) -> Figure {
    let mut chart = Chart::new("", ["time [s]", "u [°]"]);
    chart.y_span_at_least(SPANS_MIN[1]);
    let step = angles.len().div_ceil(2 * PIECES).max(1);
    let some: Vec<_> = angles.iter().step_by(step).collect();
    let band: Vec<_> = some.iter().map(|&&[t, u, sd]| [t, u - 2.0 * sd, u + 2.0 * sd]).collect();
    chart.band("two standard deviations", &band, Colour::BLUE);
    chart.curve(
        "contact angle",
        &some.iter().map(|&&[t, u, _]| [t, u]).collect::<Vec<_>>(),
        Stroke::solid(Colour::BLUE, 1.2),
    );
    Figure::new("", CHART[0], CHART[1]).panel(chart)
}

/// Where a part was believed to be at a moment: probability and pose, the likeliest first.
pub type Believed = (f64, Vec<(f64, Pose)>);

/// How likely the likeliest pose was, and how many poses there were.
#[must_use]
pub fn belief(beliefs: &[Believed]) -> Figure {
    let mut likely = Chart::new("probability of the likeliest pose", ["time [s]", "p"]);
    likely.level(1.0, "");
    likely.level(0.0, "");
    let first: Series = beliefs.iter().map(|(t, poses)| [*t, poses.first().map_or(f64::NAN, |(p, _)| *p)]).collect();
    likely.curve("", &first, Stroke::solid(Colour::BLUE, 1.4));
    let mut count = Chart::new("poses that explain the force", ["time [s]", "poses"]);
    count.level(0.0, "");
    let counts: Series = beliefs.iter().map(|(t, poses)| [*t, poses.len() as f64]).collect();
    count.curve("", &counts, Stroke::solid(Colour::GREEN, 1.4));
    Figure::new("", CHART[0], CHART[1]).panel(likely).panel(count)
}

/// The part at every pose that was left in the end, and the likeliest on its way there.
#[must_use]
pub fn plane(part: &Part, beliefs: &[Believed]) -> Figure {
    let outline = |pose: &Pose| part.polygon().vertices().iter().map(|v| pose.isometry() * v).collect::<Vec<_>>();
    let centre = |pose: &Pose| pose.isometry() * part.centre_of_mass();
    let mut scene = PlotScene::new("");
    let way: Vec<(f64, Pose)> = beliefs.iter().filter_map(|(t, poses)| Some((*t, poses.first()?.1))).collect();
    let step = way.len().div_ceil(ON_THE_WAY).max(1);
    for (_, pose) in way.iter().step_by(step) {
        scene.polygon(&outline(pose), Stroke::solid(Colour::GREY, 0.8).with(Dash::Dashed));
    }
    if let Some((_, last)) = beliefs.last() {
        for (p, pose) in last.iter().take(DRAWN_MAX).rev() {
            let ink = p.clamp(0.0, 1.0);
            let stroke = Stroke::solid(Colour::BLUE.faded(ink.max(0.15)), if ink > 0.5 { 1.8 } else { 1.0 });
            scene.polygon(&outline(pose), Style::area(Colour::SKY_BLUE, 0.4 * ink).outlined(stroke));
        }
    }
    let places: Vec<Point2<f64>> = way.iter().map(|(_, pose)| centre(pose)).collect();
    scene.polyline(&places, Stroke::solid(Colour::GREEN, 1.5));
    if let Some(last) = places.last() {
        scene.dot(*last, Colour::GREEN);
    }
    scene.key(
        Key::Area(Style::area(Colour::SKY_BLUE, 0.4).outlined(Stroke::solid(Colour::BLUE, 1.8))),
        "at the end, as faint as unlikely",
    );
    scene.key(Key::Line(Stroke::solid(Colour::GREY, 0.8).with(Dash::Dashed)), "the likeliest before");
    scene.key(Key::Line(Stroke::solid(Colour::GREEN, 1.5)), "its centre of mass");
    Figure::new("", PLANE[0], PLANE[1]).panel(scene)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_values_is_drawn_how_far_they_reach() {
        let piece = [[0.0, 1.0], [1.0, -3.0], [2.0, f64::NAN], [4.0, 5.0]];
        assert_eq!(reach(&piece), ([2.0, -3.0, 5.0], [2.0, 1.0]));
        let many: Vec<_> = (0..100_000).map(|k| (f64::from(k), Vector2::new(f64::from(k).sin(), 0.5))).collect();
        let svg = force(&many, "N", &[(5e4, "mark 1".to_owned())]).to_page().to_svg();
        assert!(svg.len() < 400_000 && svg.contains("aria-label=\"mark 1\""), "{} bytes", svg.len());
    }
}
