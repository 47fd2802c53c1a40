//! DXF, as text: pairs of a group code and a value, a line each (Autodesk, *DXF Reference*).
//!
//! Understood are LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE, POLYLINE with VERTEX, and SPLINE, in the model space, flat and seen from
//! above or below (mirrored). Entities of the paper space are no part of the model. Any other entity, and one that is hidden, is
//! an error unless another layer is asked for.

use std::collections::{BTreeSet, HashSet};
use std::f64::consts::TAU;

use nalgebra::{Point2, Vector2};
use palpate::geometry::curve::{BulgedEdge, Chords, EllipticArc, Spline};

use super::chain::{self, Piece};
use super::error::{Place, ShapeError};
use super::{Drawn, Request};
use crate::part::Unit;

/// How a binary DXF begins.
const BINARY: &[u8] = b"AutoCAD Binary DXF";

/// Most pairs of one entity: a spline or polyline far beyond what an outline may have.
const TAGS_MAX: usize = 400_000;

/// Heights in one entity that differ by no more than this share of its coordinates are one.
const FLAT_RELATIVE: f64 = 1e-9;

/// One pair.
#[derive(Clone, Copy)]
struct Tag<'a> {
    code: i32,
    value: &'a str,
    line: usize,
}

impl Tag<'_> {
    fn wrong(&self) -> ShapeError {
        let shown: String = self.value.chars().take(40).collect();
        ShapeError::Format {
            line: self.line,
            problem: format!("{shown:?} is no finite number (group code {})", self.code),
        }
    }

    fn number(&self) -> Result<f64, ShapeError> {
        self.value.parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(|| self.wrong())
    }

    fn integer(&self) -> Result<i64, ShapeError> {
        self.value.parse().map_err(|_| self.wrong())
    }
}

/// The pairs of a text.
fn tags(text: &str) -> impl Iterator<Item = Result<Tag<'_>, ShapeError>> {
    let mut lines = (1..).zip(text.lines());
    std::iter::from_fn(move || {
        let (line, code) = lines.next()?;
        // What follows the end is nothing.
        if code.trim().is_empty() && lines.clone().all(|(_, line)| line.trim().is_empty()) {
            return None;
        }
        let Ok(code) = code.trim().parse::<i32>() else {
            let shown: String = code.trim().chars().take(40).collect();
            return Some(Err(ShapeError::Format {
                line,
                problem: format!("{shown:?} is no group code: this is no DXF, or damaged"),
            }));
        };
        let Some((line, value)) = lines.next() else {
            return Some(Err(ShapeError::Format {
                line,
                problem: "the file ends within a pair: it is damaged".to_owned(),
            }));
        };
        Some(Ok(Tag { code, value: value.trim(), line }))
    })
}

/// An entity or another record: its name, and its pairs.
struct Record<'a> {
    name: &'a str,
    line: usize,
    tags: Vec<Tag<'a>>,
}

impl<'a> Record<'a> {
    fn find(&self, code: i32) -> Option<&Tag<'a>> {
        self.tags.iter().find(|tag| tag.code == code)
    }

    fn number_or(&self, code: i32, default: f64) -> Result<f64, ShapeError> {
        self.find(code).map_or(Ok(default), Tag::number)
    }

    fn integer_or(&self, code: i32, default: i64) -> Result<i64, ShapeError> {
        self.find(code).map_or(Ok(default), Tag::integer)
    }

    fn layer(&self) -> &'a str {
        self.find(8).map_or("0", |tag| tag.value)
    }

    fn place(&self) -> Place {
        Place { entity: self.name.to_owned(), layer: Some(self.layer().to_owned()), line: self.line }
    }

    fn refused(&self, problem: impl Into<String>) -> ShapeError {
        ShapeError::Entity { place: self.place(), problem: problem.into() }
    }

    fn number(&self, code: i32) -> Result<f64, ShapeError> {
        self.find(code)
            .ok_or_else(|| self.refused(format!("it has no group code {code}: the file is damaged")))?
            .number()
    }

    fn point(&self, code: i32) -> Result<Point2<f64>, ShapeError> {
        Ok(Point2::new(self.number(code)?, self.number(code + 10)?))
    }

    /// Whether it is seen from below, so that its own x runs the other way.
    fn is_mirrored(&self) -> Result<bool, ShapeError> {
        let normal = [self.number_or(210, 0.0)?, self.number_or(220, 0.0)?, self.number_or(230, 1.0)?];
        let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
        let is_upright = normal[0].hypot(normal[1]) <= 1e-9 * length && length > 0.0;
        if is_upright {
            Ok(normal[2] < 0.0)
        } else {
            Err(self.refused("it is not drawn in the x-y plane: turn it flat"))
        }
    }

    /// Whether all heights are one.
    fn check_flat(&self, heights: &[f64], size: f64) -> Result<(), ShapeError> {
        let (low, high) =
            heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(*z), high.max(*z)));
        if high - low <= FLAT_RELATIVE * size.max(high.abs()) || heights.is_empty() {
            return Ok(());
        }
        Err(self.refused(format!("it goes from z = {low} to {high}: an outline is flat")))
    }

    fn chords(&self, chords: Option<Chords>) -> Result<Chords, ShapeError> {
        chords.ok_or_else(|| ShapeError::Chords { place: self.place() })
    }
}

/// What the header says of the unit.
enum Said {
    Nothing(String),
    Unit(&'static str, f64, usize),
}

impl Said {
    /// `$INSUNITS`.
    fn of(code: i64, line: usize) -> Result<Self, ShapeError> {
        let (name, metres) = match code {
            0 => return Ok(Self::Nothing(format!("$INSUNITS is 0, unitless, at line {line}"))),
            1 => ("in", 0.0254),
            2 => ("ft", 0.3048),
            4 => ("mm", 1e-3),
            5 => ("cm", 1e-2),
            6 => ("m", 1.0),
            9 => ("mil", 25.4e-6),
            13 => ("µm", 1e-6),
            14 => ("dm", 0.1),
            _ => {
                let problem = format!("$INSUNITS = {code} is no unit that parts are drawn in");
                return Err(ShapeError::Format { line, problem });
            }
        };
        Ok(Self::Unit(name, metres, line))
    }

    /// Metres of the drawing's unit.
    fn metres(&self, request: &Request) -> Result<f64, ShapeError> {
        match (self, request.unit) {
            (Self::Nothing(_), Some(unit)) => Ok(unit.metres()),
            (Self::Nothing(why), None) => Err(ShapeError::UnitMissing { why: why.clone(), file: request.file.clone() }),
            (Self::Unit(_, metres, _), None) => Ok(*metres),
            (Self::Unit(_, metres, _), Some(unit)) if is_same(unit, *metres) => Ok(*metres),
            (Self::Unit(name, _, line), Some(unit)) => Err(ShapeError::UnitTwice {
                said: (*name).to_owned(),
                place: format!("$INSUNITS at line {line}"),
                asked: unit.name(),
            }),
        }
    }
}

fn is_same(unit: Unit, metres: f64) -> bool {
    (unit.metres() / metres - 1.0).abs() < 1e-9
}

/// Reads the outline.
pub(super) fn read(bytes: &[u8], request: &Request) -> Result<Drawn, ShapeError> {
    if bytes.starts_with(BINARY) {
        return Err(ShapeError::Binary { problem: "this is a binary DXF: save it as DXF in text (ASCII)".to_owned() });
    }
    let text = String::from_utf8_lossy(bytes);
    let mut drawing = Drawing {
        said: Said::Nothing("it has no $INSUNITS".to_owned()),
        hidden: HashSet::new(),
        layers: BTreeSet::new(),
    };
    // The unit and the layers come before what is drawn, but nothing says that they must.
    let mut entities = Vec::new();
    drawing.scan(text.trim_start_matches('\u{feff}'), &mut entities)?;
    let metres = drawing.said.metres(request)?;
    let tolerance = request.curve_error / metres;
    let pieces = drawing.pieces(&entities, tolerance, request)?;
    let layers: Vec<_> = drawing.layers.into_iter().collect();
    chain::outline(&pieces, metres, request, &layers)
}

struct Drawing {
    said: Said,
    /// Layers that are off or frozen.
    hidden: HashSet<String>,
    layers: BTreeSet<String>,
}

impl Drawing {
    /// Goes through the file: header and layers are taken, entities kept.
    fn scan<'a>(&mut self, text: &'a str, entities: &mut Vec<Record<'a>>) -> Result<(), ShapeError> {
        let mut section = "";
        let mut record: Option<Record<'a>> = None;
        let mut variable = "";
        let mut ended = false;
        let mut has_section = false;
        for tag in tags(text) {
            let tag = tag?;
            if tag.code == 999 {
                continue;
            }
            if tag.code == 0 {
                if let Some(done) = record.take() {
                    self.take(section, done, entities)?;
                }
                match tag.value {
                    "SECTION" => (section, has_section) = ("?", true),
                    "ENDSEC" => section = "",
                    "EOF" => {
                        ended = true;
                        break;
                    }
                    name => record = Some(Record { name, line: tag.line, tags: Vec::new() }),
                }
                continue;
            }
            match (section, &mut record) {
                ("?", _) if tag.code == 2 => section = tag.value,
                ("HEADER", _) if tag.code == 9 => variable = tag.value,
                ("HEADER", _) if variable == "$INSUNITS" && tag.code == 70 => {
                    self.said = Said::of(tag.integer()?, tag.line)?
                }
                ("ENTITIES" | "TABLES", Some(record)) => {
                    if record.tags.len() >= TAGS_MAX {
                        return Err(record.refused(format!("it has more than {TAGS_MAX} values")));
                    }
                    record.tags.push(tag);
                }
                _ => {}
            }
        }
        if !has_section {
            return Err(ShapeError::Format { line: 1, problem: "there is no SECTION: this is no DXF".to_owned() });
        }
        if ended {
            Ok(())
        } else {
            Err(ShapeError::Format {
                line: text.lines().count(),
                problem: "the file ends without EOF: it is damaged".to_owned(),
            })
        }
    }

    fn take<'a>(
        &mut self,
        section: &str,
        record: Record<'a>,
        entities: &mut Vec<Record<'a>>,
    ) -> Result<(), ShapeError> {
        match section {
            "TABLES" if record.name == "LAYER" => {
                let name = record.find(2).map_or("0", |tag| tag.value);
                if record.integer_or(70, 0)? & 1 != 0 || record.integer_or(62, 7)? < 0 {
                    self.hidden.insert(name.to_owned());
                }
            }
            "ENTITIES" => {
                if !matches!(record.name, "VERTEX" | "SEQEND") {
                    self.layers.insert(record.layer().to_owned());
                }
                entities.push(record);
            }
            _ => {}
        }
        Ok(())
    }

    fn pieces(&self, entities: &[Record<'_>], tolerance: f64, request: &Request) -> Result<Vec<Piece>, ShapeError> {
        let mut pieces = Vec::new();
        let mut rest = entities.iter().peekable();
        while let Some(entity) = rest.next() {
            let mut vertices = Vec::new();
            if entity.name == "POLYLINE" || entity.name == "INSERT" {
                while let Some(vertex) = rest.next_if(|next| matches!(next.name, "VERTEX" | "ATTRIB")) {
                    vertices.push(vertex);
                }
                rest.next_if(|next| next.name == "SEQEND");
            }
            let is_asked = request.layer.as_ref().is_none_or(|layer| layer == entity.layer());
            if !is_asked || entity.integer_or(67, 0)? == 1 {
                continue;
            }
            if self.hidden.contains(entity.layer()) || entity.integer_or(60, 0)? == 1 {
                let problem = "it is hidden: show it, delete it, or choose the part's layer by `layer`";
                return Err(entity.refused(problem));
            }
            let chords = match entity.name {
                "LINE" => line(entity)?,
                "ARC" | "CIRCLE" => arc(entity, tolerance)?,
                "ELLIPSE" => ellipse(entity, tolerance)?,
                "LWPOLYLINE" => light_polyline(entity, tolerance)?,
                "POLYLINE" => polyline(entity, &vertices, tolerance)?,
                "SPLINE" => spline(entity, tolerance)?,
                "INSERT" => return Err(entity.refused("a block is not read here: explode it")),
                _ => {
                    let problem = "it is no line of an outline: delete it, or choose the part's layer by `layer`";
                    return Err(entity.refused(problem));
                }
            };
            pieces.push(Piece { chords, place: entity.place() });
        }
        Ok(pieces)
    }
}

fn flipped(mirrored: bool, point: Point2<f64>) -> Point2<f64> {
    if mirrored { Point2::new(-point.x, point.y) } else { point }
}

fn line(entity: &Record<'_>) -> Result<Chords, ShapeError> {
    let points = vec![entity.point(10)?, entity.point(11)?];
    let size = (points[1] - points[0]).norm();
    entity.check_flat(&[entity.number_or(30, 0.0)?, entity.number_or(31, 0.0)?], size)?;
    if size == 0.0 {
        return Err(entity.refused("it has no length: delete it"));
    }
    Ok(Chords { points, error: 0.0 })
}

fn arc(entity: &Record<'_>, tolerance: f64) -> Result<Chords, ShapeError> {
    let (centre, radius) = (entity.point(10)?, entity.number(40)?);
    if radius <= 0.0 {
        return Err(entity.refused(format!("its radius is {radius}")));
    }
    let is_mirrored = entity.is_mirrored()?;
    let (from, sweep) = if entity.name == "CIRCLE" {
        (0.0, TAU)
    } else {
        let [from, to] = [entity.number(50)?, entity.number(51)?].map(f64::to_radians);
        (from, turn(from, to))
    };
    let mut arc = EllipticArc::circular(flipped(is_mirrored, centre), radius, from, sweep);
    if is_mirrored {
        arc.axes[0] = -arc.axes[0];
    }
    closed_exactly(entity.chords(arc.chords(tolerance))?, sweep)
}

/// From one angle to another counter-clockwise: above 0, and once round where they are one.
fn turn(from: f64, to: f64) -> f64 {
    let turn = (to - from).rem_euclid(TAU);
    if turn < 1e-12 { TAU } else { turn }
}

/// What goes once round ends where it began, to the last digit.
fn closed_exactly(mut chords: Chords, sweep: f64) -> Result<Chords, ShapeError> {
    if (sweep.abs() - TAU).abs() < 1e-9
        && let (Some(first), Some(last)) = (chords.points.first().copied(), chords.points.last_mut())
    {
        *last = first;
    }
    Ok(chords)
}

fn ellipse(entity: &Record<'_>, tolerance: f64) -> Result<Chords, ShapeError> {
    let major = Vector2::new(entity.number(11)?, entity.number(21)?);
    let ratio = entity.number(40)?;
    entity.check_flat(&[0.0, entity.number_or(31, 0.0)?], major.norm())?;
    if major.norm() <= 0.0 || ratio == 0.0 {
        return Err(entity.refused("its axes are 0"));
    }
    let side = if entity.is_mirrored()? { -1.0 } else { 1.0 };
    let minor = Vector2::new(-major.y, major.x) * (ratio * side);
    let (from, to) = (entity.number_or(41, 0.0)?, entity.number_or(42, TAU)?);
    let sweep = turn(from, to);
    let arc = EllipticArc { centre: entity.point(10)?, axes: [major, minor], from, sweep };
    closed_exactly(entity.chords(arc.chords(tolerance))?, sweep)
}

/// Vertices with the bulge of the edge after each, as chords.
fn bulged(
    entity: &Record<'_>,
    vertices: &[(Point2<f64>, f64)],
    is_closed: bool,
    tolerance: f64,
) -> Result<Chords, ShapeError> {
    let Some(&(first, _)) = vertices.first() else { return Err(entity.refused("it has no vertex: delete it")) };
    let side = if entity.is_mirrored()? { -1.0 } else { 1.0 };
    let flip = |point| flipped(side < 0.0, point);
    let mut whole = Chords { points: vec![flip(first)], error: 0.0 };
    let ends = vertices[1..].iter().map(|(end, _)| *end).chain(is_closed.then_some(first));
    for (&(start, bulge), end) in vertices.iter().zip(ends) {
        // Programs that close an outline by its first point list it twice.
        if start == end {
            continue;
        }
        let edge = BulgedEdge { start: flip(start), end: flip(end), bulge: bulge * side };
        let Chords { points, error } = entity.chords(edge.chords(tolerance))?;
        whole.points.extend(points.into_iter().skip(1));
        whole.error = whole.error.max(error);
    }
    if whole.points.len() < 2 {
        return Err(entity.refused("it has no length: delete it"));
    }
    Ok(whole)
}

fn light_polyline(entity: &Record<'_>, tolerance: f64) -> Result<Chords, ShapeError> {
    let mut vertices: Vec<(Point2<f64>, f64)> = Vec::new();
    for tag in &entity.tags {
        match (tag.code, vertices.last_mut()) {
            (10, _) => vertices.push((Point2::new(tag.number()?, f64::NAN), 0.0)),
            (20, Some(last)) => last.0.y = tag.number()?,
            (42, Some(last)) => last.1 = tag.number()?,
            _ => {}
        }
    }
    if vertices.iter().any(|(at, _)| at.y.is_nan()) {
        return Err(entity.refused("a vertex has no y: the file is damaged"));
    }
    bulged(entity, &vertices, entity.integer_or(70, 0)? & 1 != 0, tolerance)
}

/// Flags of a POLYLINE that is a mesh or goes through space.
const NO_FLAT_LINE: i64 = 8 | 16 | 64;

/// Flag of a VERTEX that only controls a spline.
const CONTROLS: i64 = 16;

fn polyline(entity: &Record<'_>, vertices: &[&Record<'_>], tolerance: f64) -> Result<Chords, ShapeError> {
    let flags = entity.integer_or(70, 0)?;
    let mut points = Vec::new();
    let mut heights = Vec::new();
    for vertex in vertices {
        if vertex.integer_or(70, 0)? & CONTROLS == 0 {
            points.push((vertex.point(10)?, vertex.number_or(42, 0.0)?));
            heights.push(vertex.number_or(30, 0.0)?);
        }
    }
    // A line through space that is flat is as good as one.
    if flags & NO_FLAT_LINE & !8 != 0 {
        return Err(entity.refused("it is a mesh, no line: export the part as STL"));
    }
    let size = points.iter().map(|(at, _)| at.coords.norm()).fold(0.0, f64::max);
    entity.check_flat(&heights, size)?;
    bulged(entity, &points, flags & 1 != 0, tolerance)
}

fn spline(entity: &Record<'_>, tolerance: f64) -> Result<Chords, ShapeError> {
    let numbers = |code: i32| entity.tags.iter().filter(move |tag| tag.code == code).map(Tag::number);
    let collected = |code: i32| numbers(code).collect::<Result<Vec<f64>, _>>();
    let (knots, xs, ys, weights) = (collected(40)?, collected(10)?, collected(20)?, collected(41)?);
    if xs.is_empty() {
        return Err(entity
            .refused("it is told by points that it goes through, not by control points: convert it to a polyline"));
    }
    if xs.len() != ys.len() || !(weights.is_empty() || weights.len() == xs.len()) {
        return Err(entity.refused("its control points lack numbers: the file is damaged"));
    }
    let size = xs.iter().chain(&ys).fold(0.0, |size: f64, x| size.max(x.abs()));
    entity.check_flat(&collected(30)?, size)?;
    let points: Vec<_> =
        (0..xs.len()).map(|i| (Point2::new(xs[i], ys[i]), weights.get(i).copied().unwrap_or(1.0))).collect();
    let degree = usize::try_from(entity.integer_or(71, 3)?).unwrap_or(0);
    let (count, knot_count) = (points.len(), knots.len());
    let spline = Spline::new(degree, knots, &points).ok_or_else(|| {
        entity.refused(format!(
            "degree {degree}, {count} control points, {knot_count} knots and the weights make no spline"
        ))
    })?;
    entity.chords(spline.chords(tolerance))
}
