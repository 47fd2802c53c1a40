//! SVG: paths and basic shapes, whatever transforms and units they are in. The centre line of a stroke counts, as cutters take it.
//!
//! What is not drawn (definitions, metadata) is passed over; what is drawn and no line of an outline (text, images, clones, clips)
//! is an error, and so is what is hidden. Layers are those of Inkscape (`inkscape:label`), otherwise the `id` of the innermost group.
//! The origin is that of the root's user space; y, which runs down in SVG, is turned up.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use kurbo::SvgArc;
use nalgebra::{Matrix2, Point2, Vector2};
use palpate::geometry::curve::{Chords, EllipticArc, RationalBezier};
use roxmltree::{Document, Node, ParsingOptions};
use svgtypes::{Length, LengthUnit, PathParser, PathSegment, PointsParser, Transform, ViewBox};

use super::chain::{self, Piece};
use super::error::{Place, ShapeError};
use super::{Drawn, Request};

/// Elements that draw nothing themselves, with all in them.
const NOT_DRAWN: [&str; 16] = [
    "defs",
    "metadata",
    "title",
    "desc",
    "namedview",
    "style",
    "script",
    "symbol",
    "clipPath",
    "mask",
    "marker",
    "pattern",
    "linearGradient",
    "radialGradient",
    "filter",
    "view",
];

/// Elements that only hold others.
const GROUPS: [&str; 3] = ["g", "a", "switch"];

/// Most elements of a file.
const NODES_MAX: u32 = 1_000_000;

/// Two scales of one page that differ by no more than this are one: programs round the size of the page.
const ONE_SCALE: f64 = 1e-3;

/// CSS pixels are not lengths on paper in every program; these are.
fn metres(unit: LengthUnit) -> Option<f64> {
    match unit {
        LengthUnit::Mm => Some(1e-3),
        LengthUnit::Cm => Some(1e-2),
        LengthUnit::In => Some(0.0254),
        LengthUnit::Pt => Some(0.0254 / 72.0),
        LengthUnit::Pc => Some(0.0254 / 6.0),
        _ => None,
    }
}

/// A map of the plane: x and y, then what is added.
#[derive(Clone, Copy)]
struct Map {
    linear: Matrix2<f64>,
    by: Vector2<f64>,
}

impl Map {
    fn of(&self, point: Point2<f64>) -> Point2<f64> {
        Point2::from(self.linear * point.coords + self.by)
    }

    /// First another, then this.
    fn after(&self, first: &Transform) -> Self {
        let linear = Matrix2::new(first.a, first.c, first.b, first.d);
        Self { linear: self.linear * linear, by: self.linear * Vector2::new(first.e, first.f) + self.by }
    }
}

/// Reads the outline.
pub(super) fn read(bytes: &[u8], request: &Request) -> Result<Drawn, ShapeError> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        ShapeError::Format { line, problem: "it is no text in UTF-8: save it as plain, uncompressed SVG".to_owned() }
    })?;
    // Old Inkscape and Illustrator files name a document type; its entities may only be in it, and few.
    let options = ParsingOptions { allow_dtd: true, nodes_limit: NODES_MAX, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text.trim_start_matches('\u{feff}'), options).map_err(|error| {
        let line = error.pos().row as usize;
        ShapeError::Format { line, problem: format!("it is no sound XML: {error}") }
    })?;
    let root = document.root_element();
    let reader = Reader { lines: line_starts(text), request, metres: 1.0 };
    if root.tag_name().name() != "svg" {
        return Err(reader.refused(root, None, "this is no SVG"));
    }
    let metres = reader.scale(root)?;
    let reader = Reader { metres, ..reader };
    let mut found = Found { pieces: Vec::new(), layers: BTreeSet::new() };
    let upright = Map { linear: Matrix2::new(1.0, 0.0, 0.0, -1.0), by: Vector2::zeros() };
    // By hand, not by recursion: groups may lie as deep in each other as a file is long.
    let mut open: Vec<(Node<'_, '_>, Map, Option<String>)> = vec![(root, upright, None)];
    while let Some((node, map, layer)) = open.pop() {
        let children: Vec<_> = node.children().filter(Node::is_element).collect();
        for child in children.into_iter().rev() {
            if let Some((map, layer)) = reader.enter(child, map, layer.as_deref(), &mut found)? {
                open.push((child, map, layer));
            }
        }
    }
    let layers: Vec<_> = found.layers.into_iter().collect();
    chain::outline(&found.pieces, metres, request, &layers)
}

fn line_starts(text: &str) -> Vec<usize> {
    std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect()
}

struct Found {
    pieces: Vec<Piece>,
    layers: BTreeSet<String>,
}

struct Reader<'a> {
    lines: Vec<usize>,
    request: &'a Request,
    /// Of a user unit of the root.
    metres: f64,
}

impl Reader<'_> {
    fn place(&self, node: Node<'_, '_>, layer: Option<&str>) -> Place {
        let at = node.range().start;
        let id = node.attribute("id").map(|id| format!(" id=\"{id}\"")).unwrap_or_default();
        Place {
            entity: format!("<{}{id}>", node.tag_name().name()),
            layer: layer.map(str::to_owned),
            line: self.lines.partition_point(|start| *start <= at),
        }
    }

    fn refused(&self, node: Node<'_, '_>, layer: Option<&str>, problem: impl Into<String>) -> ShapeError {
        ShapeError::Entity { place: self.place(node, layer), problem: problem.into() }
    }

    /// Metres of a user unit, by the size of the page or as asked for.
    fn scale(&self, root: Node<'_, '_>) -> Result<f64, ShapeError> {
        let length = |name: &str| -> Result<Option<Length>, ShapeError> {
            let Some(text) = root.attribute(name) else { return Ok(None) };
            let wrong = |_| self.refused(root, None, format!("{name} = {text:?} is no length"));
            text.trim().parse::<Length>().map(Some).map_err(wrong)
        };
        let view: Option<ViewBox> = match root.attribute("viewBox") {
            Some(text) => Some(
                text.parse().map_err(|_| self.refused(root, None, format!("viewBox = {text:?} is no rectangle")))?,
            ),
            None => None,
        };
        let (width, height) = (length("width")?, length("height")?);
        // Without a view box a user unit is a CSS pixel: the file then says nothing of paper.
        let along = |length: Option<Length>, span: fn(&ViewBox) -> f64| {
            let length = length?;
            let span = view.as_ref().map(span)?;
            Some(length.number * metres(length.unit)? / span)
        };
        let scales = [along(width, |view| view.w), along(height, |view| view.h)];
        let scales: Vec<f64> = scales.into_iter().flatten().filter(|scale| *scale > 0.0 && scale.is_finite()).collect();
        let line = self.place(root, None).line;
        let scale = match scales[..] {
            [a, b] if (a / b - 1.0).abs() > ONE_SCALE => {
                let problem = "width and height over those of the viewBox are two scales: set the page's size anew";
                return Err(self.refused(root, None, problem));
            }
            [a, ..] => a,
            [] => {
                let why = format!("the width at line {line} is no length on paper, or there is no viewBox");
                let missing = || ShapeError::UnitMissing { why, file: self.request.file.clone() };
                return self.request.unit.map(crate::part::Unit::metres).ok_or_else(missing);
            }
        };
        match self.request.unit {
            Some(unit) if (unit.metres() / scale - 1.0).abs() > ONE_SCALE => Err(ShapeError::UnitTwice {
                said: format!("{:.6} mm", scale * 1e3),
                place: format!("width over viewBox at line {line}"),
                asked: unit.name(),
            }),
            _ => Ok(scale),
        }
    }

    /// Takes an element; a group gives its map and layer for what is in it.
    fn enter(
        &self,
        node: Node<'_, '_>,
        map: Map,
        layer: Option<&str>,
        found: &mut Found,
    ) -> Result<Option<(Map, Option<String>)>, ShapeError> {
        let name = node.tag_name().name();
        let namespace = node.tag_name().namespace();
        let is_foreign = namespace.is_some_and(|space| space != "http://www.w3.org/2000/svg");
        if name == "style"
            && node
                .text()
                .is_some_and(|text| ["display", "visibility", "transform"].iter().any(|word| text.contains(word)))
        {
            return Err(self.refused(node, layer, "it hides or moves by style: write these as attributes"));
        }
        if is_foreign || NOT_DRAWN.contains(&name) {
            return Ok(None);
        }
        let is_group = GROUPS.contains(&name);
        let inkscape = |key: &str| {
            node.attributes()
                .find(|a| a.name() == key && a.namespace().is_some_and(|space| space.contains("inkscape")))
                .map(|a| a.value())
        };
        let own = is_group
            .then(|| inkscape("label").filter(|_| inkscape("groupmode") == Some("layer")).or(node.attribute("id")));
        let is_layer = is_group && inkscape("groupmode") == Some("layer");
        // An ordinary group within a layer does not hide the layer's name.
        let layer = match (own.flatten(), layer) {
            (Some(own), _) if is_layer => Some(own),
            (Some(own), None) => Some(own),
            (_, outer) => outer,
        };
        let is_asked = self.request.layer.as_deref().is_none_or(|asked| layer == Some(asked));
        if !is_group {
            found.layers.extend(layer.map(str::to_owned));
            if !is_asked {
                return Ok(None);
            }
        }
        let styled = |key: &str| {
            let style = node.attribute("style").unwrap_or_default();
            let declared =
                style.split(';').filter_map(|pair| pair.split_once(':')).find(|(name, _)| name.trim() == key);
            declared.map(|(_, value)| value.trim()).or_else(|| node.attribute(key))
        };
        // A hidden layer beside the one that is asked for is no fault.
        let is_hidden =
            styled("display") == Some("none") || matches!(styled("visibility"), Some("hidden" | "collapse"));
        if is_hidden && is_group && self.request.layer.is_some() && !is_asked {
            return Ok(None);
        }
        if is_hidden {
            let problem = "it is hidden: show it, delete it, or choose the part's layer by `layer`";
            return Err(self.refused(node, layer, problem));
        }
        if let Some(key) = ["clip-path", "mask", "marker-start"]
            .into_iter()
            .find(|key| styled(key).is_some_and(|value| value != "none"))
        {
            return Err(self.refused(node, layer, format!("its {key} is not understood: release it")));
        }
        if styled("transform").is_some() && node.attribute("transform").is_none() {
            return Err(self.refused(node, layer, "it is moved by style: write transform as an attribute"));
        }
        let map = match node.attribute("transform") {
            None => map,
            Some(text) => {
                let moved: Transform = text
                    .parse()
                    .map_err(|error| self.refused(node, layer, format!("transform = {text:?}: {error}")))?;
                map.after(&moved)
            }
        };
        if is_group {
            return Ok(Some((map, layer.map(str::to_owned))));
        }
        let pen = Pen { map, tolerance: self.request.curve_error / self.metres };
        let place = self.place(node, layer);
        let drawn = self.shape(node, layer, pen)?;
        for chords in drawn {
            let chords = chords.ok_or_else(|| ShapeError::Chords { place: place.clone() })?;
            if chords.points.iter().any(|point| point.coords.iter().any(|value| !value.is_finite())) {
                return Err(self.refused(node, layer, "it has a coordinate that is not finite"));
            }
            if chords.points.len() > 1 {
                found.pieces.push(Piece { chords, place: place.clone() });
            }
        }
        Ok(None)
    }

    /// A length in user units.
    fn user(&self, node: Node<'_, '_>, layer: Option<&str>, key: &str) -> Result<Option<f64>, ShapeError> {
        let Some(text) = node.attribute(key) else { return Ok(None) };
        let wrong = || self.refused(node, layer, format!("{key} = {text:?} is no length in the drawing's unit"));
        let length: Length = text.trim().parse().map_err(|_| wrong())?;
        match length.unit {
            LengthUnit::None | LengthUnit::Px if length.number.is_finite() => Ok(Some(length.number)),
            // CSS: 96 pixels an inch, and a pixel is a user unit.
            unit => metres(unit).map(|metres| Some(length.number * metres / (0.0254 / 96.0))).ok_or_else(wrong),
        }
    }

    fn shape(&self, node: Node<'_, '_>, layer: Option<&str>, pen: Pen) -> Result<Vec<Option<Chords>>, ShapeError> {
        let get = |key: &str| Ok(self.user(node, layer, key)?.unwrap_or(0.0));
        let size = |key: &str| match self.user(node, layer, key)? {
            Some(value) if value > 0.0 => Ok(value),
            value => Err(self.refused(node, layer, format!("its {key} is {}", value.unwrap_or(0.0)))),
        };
        let drawn = match node.tag_name().name() {
            "path" => return self.path(node, layer, pen),
            "line" => pen.lines(&[Point2::new(get("x1")?, get("y1")?), Point2::new(get("x2")?, get("y2")?)]),
            "polyline" | "polygon" => {
                let text = node.attribute("points").unwrap_or_default();
                let mut points: Vec<_> = PointsParser::from(text).map(|(x, y)| Point2::new(x, y)).collect();
                // The parser ends where it understands no more.
                let numbers = text.split([' ', ',', '\n', '\t', '\r']).filter(|word| !word.is_empty()).count();
                if numbers < 2 * points.len() && !text.contains('-') || numbers > 2 * points.len() || points.len() < 2 {
                    return Err(self.refused(node, layer, "its points are not pairs of numbers"));
                }
                if node.tag_name().name() == "polygon" && points.first() != points.last() {
                    points.push(points[0]);
                }
                pen.lines(&points)
            }
            "circle" => {
                let radius = size("r")?;
                pen.ellipse(Point2::new(get("cx")?, get("cy")?), [radius; 2])
            }
            "ellipse" => pen.ellipse(Point2::new(get("cx")?, get("cy")?), [size("rx")?, size("ry")?]),
            "rect" => {
                let (corner, span) = (Point2::new(get("x")?, get("y")?), Vector2::new(size("width")?, size("height")?));
                let (rx, ry) = (self.user(node, layer, "rx")?, self.user(node, layer, "ry")?);
                let (rx, ry) = (rx.or(ry).unwrap_or(0.0), ry.or(rx).unwrap_or(0.0));
                pen.rectangle(corner, span, [rx.clamp(0.0, span.x / 2.0), ry.clamp(0.0, span.y / 2.0)])
            }
            "use" => return Err(self.refused(node, layer, "a clone is not read here: unlink it")),
            "text" => return Err(self.refused(node, layer, "it is text: delete it, or convert it to a path")),
            _ => {
                let problem = "it is no line of an outline: delete it, or choose the part's layer by `layer`";
                return Err(self.refused(node, layer, problem));
            }
        };
        Ok(vec![drawn])
    }

    /// The subpaths of a path.
    fn path(&self, node: Node<'_, '_>, layer: Option<&str>, pen: Pen) -> Result<Vec<Option<Chords>>, ShapeError> {
        let text = node.attribute("d").unwrap_or_default();
        let mut drawn = Vec::new();
        let mut line: Option<Line> = None;
        let (mut start, mut at) = (Point2::origin(), Point2::origin());
        // The last control points of a cubic and of a quadratic curve, for those that go on smoothly.
        let (mut cubic, mut quadratic): (Option<Point2<f64>>, Option<Point2<f64>>) = (None, None);
        for segment in PathParser::from(text) {
            let segment =
                segment.map_err(|error| self.refused(node, layer, format!("its path is damaged: {error}")))?;
            let origin = |abs: bool| if abs { Vector2::zeros() } else { at.coords };
            let to = |abs: bool, x: f64, y: f64| Point2::new(x, y) + origin(abs);
            let (mut next_cubic, mut next_quadratic) = (None, None);
            let (end, chords) = match segment {
                PathSegment::MoveTo { abs, x, y } => {
                    drawn.extend(line.take().map(Line::done));
                    at = to(abs, x, y);
                    start = at;
                    (cubic, quadratic) = (None, None);
                    continue;
                }
                PathSegment::ClosePath { .. } => {
                    let mut closed = line.take().unwrap_or_else(|| Line::new(pen.map.of(start)));
                    closed.add(pen.lines(&[at, start]));
                    drawn.push(closed.done());
                    at = start;
                    (cubic, quadratic) = (None, None);
                    continue;
                }
                PathSegment::LineTo { abs, x, y } => (to(abs, x, y), None),
                PathSegment::HorizontalLineTo { abs, x } => (Point2::new(x + origin(abs).x, at.y), None),
                PathSegment::VerticalLineTo { abs, y } => (Point2::new(at.x, y + origin(abs).y), None),
                PathSegment::CurveTo { abs, x1, y1, x2, y2, x, y } => {
                    let (first, second, end) = (to(abs, x1, y1), to(abs, x2, y2), to(abs, x, y));
                    next_cubic = Some(second);
                    (end, Some(pen.bezier(&[at, first, second, end])))
                }
                PathSegment::SmoothCurveTo { abs, x2, y2, x, y } => {
                    let first = cubic.map_or(at, |last| at + (at - last));
                    let (second, end) = (to(abs, x2, y2), to(abs, x, y));
                    next_cubic = Some(second);
                    (end, Some(pen.bezier(&[at, first, second, end])))
                }
                PathSegment::Quadratic { abs, x1, y1, x, y } => {
                    let (control, end) = (to(abs, x1, y1), to(abs, x, y));
                    next_quadratic = Some(control);
                    (end, Some(pen.bezier(&[at, control, end])))
                }
                PathSegment::SmoothQuadratic { abs, x, y } => {
                    let (control, end) = (quadratic.map_or(at, |last| at + (at - last)), to(abs, x, y));
                    next_quadratic = Some(control);
                    (end, Some(pen.bezier(&[at, control, end])))
                }
                PathSegment::EllipticalArc { abs, rx, ry, x_axis_rotation, large_arc, sweep, x, y } => {
                    let end = to(abs, x, y);
                    let arc = SvgArc {
                        from: kurbo::Point::new(at.x, at.y),
                        to: kurbo::Point::new(end.x, end.y),
                        radii: kurbo::Vec2::new(rx, ry),
                        x_rotation: x_axis_rotation.to_radians(),
                        large_arc,
                        sweep,
                    };
                    (end, Some(pen.arc(&arc, [at, end])))
                }
            };
            let chords = chords.unwrap_or_else(|| pen.lines(&[at, end]));
            line.get_or_insert_with(|| Line::new(pen.map.of(at))).add(chords);
            at = end;
            (cubic, quadratic) = (next_cubic, next_quadratic);
        }
        drawn.extend(line.map(Line::done));
        Ok(drawn)
    }
}

/// A line that grows.
struct Line(Option<Chords>);

impl Line {
    fn new(at: Point2<f64>) -> Self {
        Self(Some(Chords { points: vec![at], error: 0.0 }))
    }

    fn add(&mut self, more: Option<Chords>) {
        let whole = self.0.take();
        self.0 = whole.zip(more).map(|(mut whole, more)| {
            whole.points.extend(more.points.into_iter().skip(1));
            whole.error = whole.error.max(more.error);
            whole
        });
    }

    fn done(self) -> Option<Chords> {
        self.0
    }
}

/// Draws in the root's user space, y up.
#[derive(Clone, Copy)]
struct Pen {
    map: Map,
    tolerance: f64,
}

impl Pen {
    fn lines(&self, points: &[Point2<f64>]) -> Option<Chords> {
        Some(Chords { points: points.iter().map(|point| self.map.of(*point)).collect(), error: 0.0 })
    }

    fn bezier(&self, points: &[Point2<f64>]) -> Option<Chords> {
        let points: Vec<_> = points.iter().map(|point| self.map.of(*point)).collect();
        RationalBezier::polynomial(&points).chords(self.tolerance)
    }

    fn elliptic(&self, centre: Point2<f64>, axes: [Vector2<f64>; 2], from: f64, sweep: f64) -> Option<Chords> {
        let axes = axes.map(|axis| self.map.linear * axis);
        EllipticArc { centre: self.map.of(centre), axes, from, sweep }.chords(self.tolerance)
    }

    fn ellipse(&self, centre: Point2<f64>, [rx, ry]: [f64; 2]) -> Option<Chords> {
        let mut chords = self.elliptic(centre, [Vector2::new(rx, 0.0), Vector2::new(0.0, ry)], 0.0, TAU)?;
        let first = chords.points[0];
        *chords.points.last_mut()? = first;
        Some(chords)
    }

    /// A straight line where an arc has no radius.
    fn arc(&self, arc: &SvgArc, [start, end]: [Point2<f64>; 2]) -> Option<Chords> {
        let Some(found) = kurbo::Arc::from_svg_arc(arc) else { return self.lines(&[start, end]) };
        let (sin, cos) = found.x_rotation.sin_cos();
        let axes = [Vector2::new(cos, sin) * found.radii.x, Vector2::new(-sin, cos) * found.radii.y];
        let centre = Point2::new(found.center.x, found.center.y);
        let mut chords = self.elliptic(centre, axes, found.start_angle, found.sweep_angle)?;
        *chords.points.last_mut()? = self.map.of(end);
        Some(chords)
    }

    fn rectangle(&self, corner: Point2<f64>, span: Vector2<f64>, [rx, ry]: [f64; 2]) -> Option<Chords> {
        let at = |x: f64, y: f64| corner + Vector2::new(x, y);
        let (w, h) = (span.x, span.y);
        if rx == 0.0 || ry == 0.0 {
            return self.lines(&[at(0.0, 0.0), at(w, 0.0), at(w, h), at(0.0, h), at(0.0, 0.0)]);
        }
        let mut line = Line::new(self.map.of(at(w - rx, 0.0)));
        let quarter = TAU / 4.0;
        let corners = [(w - rx, ry, -quarter), (w - rx, h - ry, 0.0), (rx, h - ry, quarter), (rx, ry, 2.0 * quarter)];
        for (x, y, from) in corners {
            let begin = at(x + rx * from.cos(), y + ry * from.sin());
            line.add(self.lines(&[begin, begin]));
            line.add(self.elliptic(at(x, y), [Vector2::new(rx, 0.0), Vector2::new(0.0, ry)], from, quarter));
        }
        line.add(self.lines(&[at(0.0, 0.0), at(w - rx, 0.0)]));
        line.done()
    }
}
