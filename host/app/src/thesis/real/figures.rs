//! Pictures of what the estimator of slow pushes leaves unexplained, and a blind chain as a film strip.
//!
//! Frames: the robot's = world. Units: SI in, mm and degrees on the axes.

use nalgebra::{Point2, Rotation2, Vector2};
use palpate::geometry::{SimplePolygon, distance_to_segment};
use palpate::pushing::estimation::slow_pushes::Onset;
use palpate_files::recordings::slow_pushes::MeasuredPush;

use super::tasks::{Answer, Judge};
use super::{BLOCK_M, CENTRE_OF_MASS_M, Readied};
use crate::pictures::plot::{Chart, Colour, Dash, Figure, Stroke};
use crate::pictures::slow_chain::{self, ChainPush};

/// Pushes of a blind chain before the box that it begins in is forgotten.
pub(super) const SETTLED: usize = 5;

/// Frames of a film strip, and how many of them are before the worst.
const FRAMES: usize = 10;
const BEFORE: usize = 3;

/// Errors of blind chains are drawn up to this, mm and degrees: a part that is looked for anew is off by far more than one that is
/// followed.
const SHOWN_MOST: f64 = 10.0;

/// Size of the page of errors.
const PAGE: [f64; 2] = [1180.0, 760.0];

/// Colours of logs, in their order.
const LOGS: [Colour; 5] = [Colour::BLUE, Colour::VERMILLION, Colour::GREEN, Colour::ORANGE, Colour::DARK_GREY];

/// Errors of place and angle as one length, m: an angle at the block's radius of gyration.
pub(super) fn size(answer: &Answer) -> f64 {
    answer.error[0].hypot(answer.error[1] * 0.05)
}

/// The block about its centre of mass, m.
fn outline() -> Vec<Point2<f64>> {
    let [x, y] = CENTRE_OF_MASS_M;
    BLOCK_M.map(|[a, b]| Point2::new(a - x, b - y)).to_vec()
}

/// How a push came: its angle against the normal of the edge that it met, rad, and how far its line passes the centre of
/// mass, m.
fn circumstances(push: &MeasuredPush) -> Option<[f64; 2]> {
    let (felt, pose) = (&push.known.felt, push.known.before);
    let onset = match felt.onset {
        Onset::At(travel) | Onset::Before(travel) => travel,
        Onset::Never(_) | Onset::Unknown => return None,
    };
    let outline = SimplePolygon::new(outline()).ok()?;
    let at = pose.isometry().inverse_transform_point(&(felt.origin + felt.direction * onset));
    let direction = pose.isometry().inverse_transform_vector(&felt.direction);
    let nearest = |a: &(Point2<f64>, Point2<f64>), b: &(Point2<f64>, Point2<f64>)| {
        distance_to_segment(at, a.0, a.1).total_cmp(&distance_to_segment(at, b.0, b.1))
    };
    let (from, to) = outline.edges().min_by(nearest)?;
    let along = (to - from).normalize();
    let inward = Vector2::new(-along.y, along.x);
    let angle = inward.perp(&direction).atan2(inward.dot(&direction));
    Some([angle, at.coords.perp(&direction)])
}

/// Errors with the start given by direction and place, and of blind chains push by push.
pub(super) fn errors(logs: &[Readied], answers: &[Answer]) -> Figure {
    let labels = ["angle between push and normal [°]", "push passes the centre of mass at [mm]"];
    let words = ["centre of mass off by [mm]", "turn off by [°]"];
    let units = [1e3, 1_f64.to_degrees()];
    let chart = |about: usize, part: usize| {
        let title = if about == 0 && part == 0 { "Start given (task a), by direction" } else { "" };
        let title = if about == 1 && part == 0 { "Start given (task a), by place" } else { title };
        let mut chart = Chart::new(title, [labels[about], words[part]]);
        for (number, Readied { log, .. }) in logs.iter().enumerate() {
            let of_log = answers.iter().filter(|answer| answer.task == "a" && answer.log == log.name);
            let point = |answer: &Answer| {
                let push = log.pushes.iter().find(|push| push.index + 1 == answer.push)?;
                let about_unit = [1_f64.to_degrees(), 1e3][about];
                Some([circumstances(push)?[about] * about_unit, answer.error[part] * units[part]])
            };
            let points: Vec<_> = of_log.filter_map(point).collect();
            let name = if about == 0 && part == 0 { log.name.as_str() } else { "" };
            chart.dots(name, &points, LOGS[number % LOGS.len()]);
        }
        chart
    };
    let blind = |part: usize| {
        let title = if part == 0 { "Blind chains (task d), push by push, first seed" } else { "" };
        let mut chart = Chart::new(title, ["push", &format!("{}, {SHOWN_MOST:.0} at most", words[part])]);
        for (number, Readied { log, .. }) in logs.iter().enumerate() {
            let of_log = || answers.iter().filter(|answer| answer.task == "d" && answer.log == log.name);
            let first = of_log().map(|answer| answer.seed).min();
            let points = of_log().filter(|answer| Some(answer.seed) == first && answer.push > SETTLED);
            let cut = |answer: &Answer| (answer.error[part] * units[part]).min(SHOWN_MOST);
            let points: Vec<_> = points.map(|answer| [answer.push as f64, cut(answer)]).collect();
            chart.curve("", &points, Stroke::solid(LOGS[number % LOGS.len()], 1.3).with(Dash::Solid));
        }
        chart
    };
    let columns = [[chart(0, 0), chart(0, 1)], [chart(1, 0), chart(1, 1)], [blind(0), blind(1)]];
    let figure = Figure::new("What is not explained of recorded slow pushes", PAGE[0], PAGE[1]);
    columns.into_iter().fold(figure, |figure, column| figure.column(1.0, column.map(Into::into).into()))
}

/// A blind chain around the push with this number.
pub(super) fn film(judge: &Judge<'_>, worst: usize) -> Figure {
    let count = judge.log.pushes.len();
    let begin = worst.saturating_sub(BEFORE + 1).min(count.saturating_sub(FRAMES));
    let constants = *judge.scene.constants();
    let mut frames = Vec::new();
    let mut push = 0;
    judge.follow_blind(|answer, cloud| {
        let known = &judge.log.pushes[push].known;
        push += 1;
        if !(begin..begin + FRAMES).contains(&(push - 1)) {
            return;
        }
        let offset = Rotation2::new(known.felt.tool_yaw) * Vector2::new(constants.tip_ahead, constants.tip_left);
        let onset = match known.felt.onset {
            Onset::At(travel) | Onset::Before(travel) => Some(travel),
            Onset::Never(_) | Onset::Unknown => None,
        };
        let [place, turn] = answer.error;
        frames.push(ChainPush {
            origin: known.felt.origin + offset,
            direction: known.felt.direction,
            end: known.felt.end + constants.beyond_log,
            onset,
            poses: cloud.poses.clone(),
            middle: cloud.middle(),
            truth: Some(known.after),
            title: format!(
                "{}: {:.1} mm, {:.1}°{}",
                answer.push,
                place * 1e3,
                turn.to_degrees(),
                if answer.covered { "" } else { ", outside" }
            ),
        });
    });
    let name = &judge.log.name;
    let title = format!(
        "Blind from the first push on: {name}, around push {worst}; how far off, and whether outside of the 95 % region"
    );
    slow_chain::figure(&title, &outline(), constants.radius, &frames)
}
