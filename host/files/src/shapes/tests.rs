//! Outlines written by the tests in every format, as programs write them, and read again; then all that can be wrong.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;

use nalgebra::{Point2, Rotation2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::math::random::Draw;
use palpate::pushing::dynamics::Mass;
use proptest::prelude::*;

use super::*;
use crate::part::{PartFile, Unit};
use crate::scene::SceneFile;

/// Decimals are written to a nanometre of a drawing in mm; outlines of some cm agree to a hundred times that.
const WRITTEN: f64 = 1e-10;

fn request(file: &str) -> Request {
    Request::of(file)
}

fn read(file: &str, text: &str) -> Result<Drawn, ShapeError> {
    draw(text.as_bytes(), &request(file))
}

fn told(file: &str, text: &str) -> String {
    read(file, text).unwrap_err().to_string()
}

/// A DXF with these entities, each as its pairs, and `$INSUNITS`.
fn dxf(units: Option<u8>, entities: &[String]) -> String {
    let mut text = "999\nwritten by a test\n0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n".to_owned();
    if let Some(units) = units {
        let _ = writeln!(text, "9\n$INSUNITS\n 70\n     {units}");
    }
    text += "0\nENDSEC\n0\nSECTION\n2\nTABLES\n0\nTABLE\n2\nLAYER\n70\n2\n";
    text += "0\nLAYER\n2\n0\n70\n0\n62\n7\n6\nCONTINUOUS\n0\nLAYER\n2\nhidden\n70\n1\n62\n7\n0\nENDTAB\n0\nENDSEC\n";
    text += "0\nSECTION\n2\nBLOCKS\n0\nBLOCK\n2\n*Model_Space\n0\nENDBLK\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n";
    text + &entities.concat() + "0\nENDSEC\n0\nEOF\n"
}

fn entity(name: &str, layer: &str, pairs: &[(i32, f64)]) -> String {
    let mut text = format!("  0\n{name}\n  5\n2A\n100\nAcDbEntity\n  8\n{layer}\n");
    for (code, value) in pairs {
        let _ = match code {
            60..=79 => writeln!(text, "{code:>3}\n{value:>6.0}"),
            _ => writeln!(text, "{code:>3}\n{value:.9}"),
        };
    }
    text
}

fn line(a: Point2<f64>, b: Point2<f64>) -> String {
    entity("LINE", "0", &[(10, a.x), (20, a.y), (30, 0.0), (11, b.x), (21, b.y), (31, 0.0)])
}

/// The sides of an outline as lines, some of them backwards, in an order of their own.
fn lines(outline: &[Point2<f64>], draw: &mut Draw) -> Vec<String> {
    let n = outline.len();
    let mut lines: Vec<String> = (0..n)
        .map(|i| {
            let (a, b) = (outline[i], outline[(i + 1) % n]);
            if draw.chance(0.5) { line(a, b) } else { line(b, a) }
        })
        .collect();
    (1..n).for_each(|i| lines.swap(i, draw.index(i + 1)));
    lines
}

fn points_mm(polygon: &SimplePolygon) -> Vec<Point2<f64>> {
    polygon.vertices().iter().map(|point| point * 1e3).collect()
}

/// Whether two outlines are one, wherever their lists begin.
fn same(found: &SimplePolygon, wanted: &SimplePolygon) -> bool {
    let (a, b) = (found.vertices(), wanted.vertices());
    let fits = |shift: usize| (0..a.len()).all(|i| (a[i] - b[(i + shift) % b.len()]).norm() < WRITTEN);
    a.len() == b.len() && (0..a.len()).any(fits)
}

/// An outline of straight sides and circular arcs: corners with the bulge of the side after each, mm, and its exact area (mm²).
fn bulged(seed: u64) -> (Vec<(Point2<f64>, f64)>, f64) {
    let mut draw = Draw::new(seed);
    let corners = points_mm(&draw.convex_polygon(6, 0.04));
    let n = corners.len();
    let bulges: Vec<f64> = (0..n).map(|_| if draw.chance(0.5) { draw.uniform(0.02, 0.3) } else { 0.0 }).collect();
    let segment = |i: usize| {
        let (chord, angle) = ((corners[(i + 1) % n] - corners[i]).norm(), 4.0 * bulges[i].atan());
        if angle == 0.0 { 0.0 } else { (chord / 2.0 / (angle / 2.0).sin()).powi(2) * (angle - angle.sin()) / 2.0 }
    };
    let straight = SimplePolygon::new(corners.clone()).unwrap().area();
    let area = straight + (0..n).map(segment).sum::<f64>();
    (corners.into_iter().zip(bulges).collect(), area)
}

/// The circle that a bulged side is of: centre, radius, and the angle at which it begins.
fn circle((a, bulge): (Point2<f64>, f64), b: Point2<f64>) -> (Point2<f64>, f64, f64) {
    let angle = 4.0 * f64::atan(bulge);
    let across = Rotation2::new(PI / 2.0) * (b - a);
    let centre = a + (b - a) / 2.0 + across / (2.0 * (angle / 2.0).tan());
    let from = a - centre;
    (centre, from.norm(), from.y.atan2(from.x))
}

/// Area between an outline and its chords, which are off by no more than the error, mm².
fn area_off(found: &Drawn, perimeter: f64) -> f64 {
    found.error * 1e3 * perimeter
}

proptest! {
    #[test]
    fn polygons_come_back_from_every_format(seed: u64, corners in 4..12_usize, backwards: bool) {
        let mut draw_numbers = Draw::new(seed);
        let polygon = draw_numbers.star_polygon(corners, 0.02, 0.05);
        let mut outline = points_mm(&polygon);
        if backwards {
            outline.reverse();
        }
        // LibreCAD: lines one by one, in mm.
        let found = read("part.dxf", &dxf(Some(4), &lines(&outline, &mut draw_numbers))).unwrap();
        prop_assert!(same(&found.outline, &polygon) || found.outline.vertices().len() == corners);
        prop_assert!((found.outline.area() / polygon.area() - 1.0).abs() < 1e-6);
        // FreeCAD and Inkscape: one light polyline.
        let mut pairs = vec![(90, outline.len() as f64), (70, 1.0)];
        pairs.extend(outline.iter().flat_map(|p| [(10, p.x / 25.4), (20, p.y / 25.4)]));
        let found = read("part.DXF", &dxf(Some(1), &[entity("LWPOLYLINE", "0", &pairs)])).unwrap();
        prop_assert!((found.outline.area() / polygon.area() - 1.0).abs() < 1e-6);
        // R12: a polyline with vertices, without a unit.
        let mut old = entity("POLYLINE", "0", &[(66, 1.0), (70, 1.0)]);
        outline.iter().for_each(|p| old += &entity("VERTEX", "0", &[(10, p.x), (20, p.y), (30, 0.0)]));
        old += "0\nSEQEND\n";
        let asked = Request { unit: Some(Unit::Millimetre), ..request("part.dxf") };
        let found = draw(dxf(None, &[old]).as_bytes(), &asked).unwrap();
        prop_assert!(same(&found.outline, &polygon));
        prop_assert!(found.error <= 0.0);
        // Inkscape: relative path in a moved layer, page in mm.
        let mut d = format!("m {:.9},{:.9}", outline[0].x, -outline[0].y);
        for pair in outline.windows(2) {
            let _ = write!(d, " {:.9},{:.9}", pair[1].x - pair[0].x, pair[0].y - pair[1].y);
        }
        let svg = format!(
            "<?xml version=\"1.0\" standalone=\"no\"?>\n<svg width=\"210mm\" height=\"297mm\" viewBox=\"0 0 210 297\"\n\
             xmlns=\"http://www.w3.org/2000/svg\" xmlns:inkscape=\"http://www.inkscape.org/namespaces/inkscape\" \
             xmlns:sodipodi=\"http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd\">\n<sodipodi:namedview id=\"base\"/><defs/>\n\
             <g inkscape:groupmode=\"layer\" inkscape:label=\"Layer 1\" transform=\"translate(10,-20)\">\n\
             <path style=\"fill:none;stroke:#000000\" d=\"{d} z\" id=\"path1\"/></g></svg>"
        );
        let found = read("part.svg", &svg).unwrap();
        prop_assert!((found.outline.area() / polygon.area() - 1.0).abs() < 1e-6);
        prop_assert!((found.outline.centroid() - polygon.centroid() - Vector2::new(0.01, 0.02)).norm() < 1e-9);
        // OpenSCAD: absolute path, viewBox that begins elsewhere.
        let d: Vec<String> = outline.iter().map(|p| format!("{},{}", p.x, -p.y)).collect();
        let svg = format!(
            "<svg width=\"120mm\" height=\"120mm\" viewBox=\"-60 -60 120 120\" xmlns=\"http://www.w3.org/2000/svg\" version=\"1.1\">\n\
             <title>OpenSCAD Model</title>\n<path d=\"\nM {} z\n\" stroke=\"black\" fill=\"lightgray\" stroke-width=\"0.5\"/>\n</svg>",
            d.join(" L ")
        );
        prop_assert!(same(&read("part.svg", &svg).unwrap().outline, &polygon));
    }

    #[test]
    fn arcs_are_within_the_tolerance_in_every_format(seed: u64, tolerance_mm in 0.002..0.2) {
        let (corners, area) = bulged(seed);
        let n = corners.len();
        let asked = |file: &str| Request { curve_error: tolerance_mm * 1e-3, ..request(file) };
        let mut pairs = vec![(90, n as f64), (70, 1.0)];
        pairs.extend(corners.iter().flat_map(|(p, bulge)| [(10, p.x), (20, p.y), (42, *bulge)]));
        let light = draw(dxf(Some(4), &[entity("LWPOLYLINE", "0", &pairs)]).as_bytes(), &asked("p.dxf")).unwrap();
        let sides = (0..n).map(|i| {
            let (corner, end) = (corners[i], corners[(i + 1) % n].0);
            if corner.1 == 0.0 {
                return line(corner.0, end);
            }
            let (centre, radius, from) = circle(corner, end);
            let (from, to) = (from.to_degrees(), (from + 4.0 * corner.1.atan()).to_degrees());
            entity("ARC", "0", &[(10, centre.x), (20, centre.y), (40, radius), (50, from.rem_euclid(360.0)), (51, to.rem_euclid(360.0))])
        });
        let sides: Vec<String> = sides.collect();
        let arcs = draw(dxf(Some(4), &sides).as_bytes(), &asked("p.dxf")).unwrap();
        let mut d = format!("M{:.9} {:.9}", corners[0].0.x, -corners[0].0.y);
        for i in 0..n {
            let ((_, bulge), end) = (corners[i], corners[(i + 1) % n].0);
            let _ = if bulge == 0.0 {
                write!(d, "L{:.9} {:.9}", end.x, -end.y)
            } else {
                let (_, radius, _) = circle(corners[i], end);
                write!(d, "A{radius:.9} {radius:.9} 0 0 0 {:.9} {:.9}", end.x, -end.y)
            };
        }
        let svg = format!("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"100mm\" height=\"100mm\" viewBox=\"0 0 100 100\"><path d=\"{d}Z\"/></svg>");
        let drawn = draw(svg.as_bytes(), &asked("p.svg")).unwrap();
        for found in [&light, &arcs, &drawn] {
            prop_assert!(found.error <= tolerance_mm * 1e-3 * (1.0 + 1e-9), "{}", found.error);
            let off = area - found.outline.area() * 1e6;
            // Chords of outward arcs are inside.
            prop_assert!(off > -1e-4 && off <= area_off(found, 2.0 * TAU * 40.0) + 1e-4, "{off} mm²");
        }
    }
}

/// The prism over an outline as facets, mm: lids are fanned from the origin, which sees all corners.
fn prism(outline: &[Point2<f64>], [low, high]: [f64; 2]) -> Vec<[[f64; 3]; 3]> {
    let n = outline.len();
    let at = |p: Point2<f64>, z: f64| [p.x, p.y, z];
    let middle = Point2::origin();
    (0..n)
        .flat_map(|i| {
            let (a, b) = (outline[i], outline[(i + 1) % n]);
            [
                [at(a, high), at(b, high), at(middle, high)],
                [at(b, low), at(a, low), at(middle, low)],
                [at(a, low), at(b, low), at(b, high)],
                [at(a, low), at(b, high), at(a, high)],
            ]
        })
        .collect()
}

/// As OpenSCAD writes it.
fn stl_text(facets: &[[[f64; 3]; 3]]) -> String {
    let mut text = "solid OpenSCAD_Model\n".to_owned();
    for facet in facets {
        text += "  facet normal nan 0 -1\n    outer loop\n";
        facet.iter().for_each(|[x, y, z]| {
            let _ = writeln!(text, "      vertex {x} {y} {z}");
        });
        text += "    endloop\n  endfacet\n";
    }
    text + "endsolid OpenSCAD_Model\n"
}

/// As programs write it whose header begins like a text.
#[expect(clippy::cast_possible_truncation, reason = "binary STL has single precision")]
fn stl_binary(facets: &[[[f64; 3]; 3]]) -> Vec<u8> {
    let mut bytes = b"solid exported".to_vec();
    bytes.resize(80, b' ');
    bytes.extend(u32::try_from(facets.len()).unwrap().to_le_bytes());
    for facet in facets {
        bytes.extend([0_u8; 12]);
        facet.iter().flatten().for_each(|value| bytes.extend((*value as f32).to_le_bytes()));
        bytes.extend([0_u8; 2]);
    }
    bytes
}

fn solid(height: Height) -> Request {
    Request { unit: Some(Unit::Millimetre), height: Some(height), ..request("part.stl") }
}

proptest! {
    #[test]
    fn a_prism_comes_back_from_stl_by_slice_and_by_shadow(seed: u64, corners in 4..12_usize) {
        let polygon = Draw::new(seed).star_polygon(corners, 0.02, 0.05);
        let plate = Mass::uniform(&polygon);
        let facets = prism(&points_mm(&polygon), [-5.0, 12.0]);
        for height in [Height::Slice(0.004), Height::Shadow] {
            for bytes in [stl_text(&facets).into_bytes(), stl_binary(&facets)] {
                let found = draw(&bytes, &solid(height)).unwrap();
                // Single precision, 4e-9 m of 5 cm; and corners that are off by less than the tolerance are left out.
                let perimeter: f64 = polygon.edges().map(|(a, b)| (b - a).norm()).sum();
                let off = (found.outline.area() - polygon.area()).abs();
                prop_assert!(off < found.error * perimeter + 1e-4 * polygon.area(), "{height:?}: {off}");
                let solid = found.solid.unwrap();
                prop_assert!((solid.volume / (polygon.area() * 0.017) - 1.0).abs() < 1e-5);
                prop_assert!((solid.mass.centre_of_mass - plate.centre_of_mass).norm() < 1e-7);
                prop_assert!((solid.mass.inertia_per_mass / plate.inertia_per_mass - 1.0).abs() < 1e-5);
                prop_assert!((solid.height - 0.017).abs() < 1e-8 && (solid.centre_height - 0.0085).abs() < 1e-8);
                prop_assert_eq!(solid.feet, None);
            }
        }
    }

    #[test]
    fn damaged_files_are_errors_with_words_and_no_panic(seed: u64, cuts in 1..6_usize) {
        let mut draw_numbers = Draw::new(seed);
        let polygon = draw_numbers.star_polygon(6, 0.02, 0.05);
        let outline = points_mm(&polygon);
        let circle = entity("CIRCLE", "0", &[(10, 0.0), (20, 0.0), (40, 5.0)]);
        let files = [
            ("a.dxf", dxf(Some(4), &[lines(&outline, &mut draw_numbers), vec![circle]].concat()).into_bytes()),
            ("a.svg", format!("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"1in\" viewBox=\"0 0 9 9\"><g transform=\"rotate(3)\"><path d=\"M1 2c3 4 5 6 7 8A1 2 3 0 1 5 6z\"/><circle r=\"{}\"/></g></svg>", outline[0].x).into_bytes()),
            ("a.stl", stl_text(&prism(&outline, [0.0, 9.0])).into_bytes()),
            ("a.stl", stl_binary(&prism(&outline, [0.0, 9.0]))),
        ];
        for (name, mut bytes) in files {
            for _ in 0..cuts {
                let at = draw_numbers.index(bytes.len());
                match draw_numbers.index(4) {
                    0 => bytes.truncate(at.max(1)),
                    1 => bytes[at] = u8::try_from(draw_numbers.index(256)).unwrap(),
                    2 => bytes.splice(at..at, *b"1e308").for_each(drop),
                    _ => {
                        let end = (at + 40).min(bytes.len());
                        let piece = bytes[at..end].to_vec();
                        bytes.splice(at..at, piece);
                    }
                }
            }
            for asked in [solid(Height::Shadow), solid(Height::Slice(0.004))] {
                let asked = Request { file: name.to_owned(), height: asked.height.filter(|_| name == "a.stl"), ..asked };
                match draw(&bytes, &asked) {
                    Ok(found) => prop_assert!(found.outline.area() > 0.0 && found.error.is_finite()),
                    Err(error) => prop_assert!(!error.to_string().trim().is_empty()),
                }
            }
        }
    }
}

#[test]
fn round_things_of_dxf_have_their_areas() {
    let area = |entities: &[String]| {
        let fine = Request { curve_error: 1e-6, ..request("a.dxf") };
        draw(dxf(Some(4), entities).as_bytes(), &fine).unwrap().outline.area() * 1e6
    };
    // 1 µm of chord all round 190 mm is 0.13 mm² of area.
    assert!((area(&[entity("CIRCLE", "0", &[(10, 3.0), (20, 4.0), (40, 30.0)])]) - PI * 900.0).abs() < 0.19);
    let ellipse = [(10, 3.0), (20, 4.0), (11, 18.0), (21, 24.0), (40, 0.5), (41, 0.0), (42, TAU)];
    assert!((area(&[entity("ELLIPSE", "0", &ellipse)]) - PI * 450.0).abs() < 0.19);
    // A half disk of an arc that was mirrored: seen from below, its angles run from the other side.
    let arc = entity(
        "ARC",
        "0",
        &[(10, 0.0), (20, 0.0), (40, 30.0), (50, 90.0), (51, 270.0), (210, 0.0), (220, 0.0), (230, -1.0)],
    );
    let chord = line(Point2::new(0.0, -30.0), Point2::new(0.0, 30.0));
    let half = draw(dxf(Some(4), &[arc, chord]).as_bytes(), &request("a.dxf")).unwrap();
    assert!(half.outline.centroid().x > 0.01, "{}", half.outline.centroid());
    // A circle as a rational spline.
    let w = 0.5_f64.sqrt();
    let mut pairs = vec![(70, 11.0), (71, 2.0), (72, 12.0), (73, 9.0)];
    pairs.extend([0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4].map(|knot| (40, f64::from(knot))));
    let ring = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]];
    pairs.extend((0..9).map(|k| (41, if k % 2 == 0 { 1.0 } else { w })));
    pairs.extend(ring.iter().flat_map(|[x, y]| [(10, 30.0 * f64::from(*x)), (20, 30.0 * f64::from(*y)), (30, 0.0)]));
    assert!((area(&[entity("SPLINE", "0", &pairs)]) - PI * 900.0).abs() < 0.19);
}

#[test]
fn round_things_of_svg_have_their_areas() {
    let area = |shape: &str| {
        let svg = format!(
            "<svg xmlns='http://www.w3.org/2000/svg' width='10cm' height='10cm' viewBox='0 0 200 200'>{shape}</svg>"
        );
        let fine = Request { curve_error: 1e-6, ..request("a.svg") };
        draw(svg.as_bytes(), &fine).unwrap().outline.area() * 1e6
    };
    // A user unit is half a millimetre.
    let near = |found: f64, wanted: f64| assert!((found - wanted).abs() < 0.2, "{found} {wanted}");
    near(area("<circle cx='9' cy='9' r='60'/>"), PI * 900.0);
    near(area("<ellipse rx='60' ry='30'/>"), PI * 450.0);
    near(area("<circle r='60' transform='scale(1,0.5) rotate(20)'/>"), PI * 450.0);
    near(area("<rect width='120' height='80' rx='20'/>"), 2400.0 - (4.0 - PI) * 100.0);
    near(area("<rect width='120' height='80'/>"), 2400.0);
    near(area("<polygon points='0,0 120,0 0,80'/>"), 1200.0);
    near(area("<polyline points='0,0 120,0 0,80 0,0'/>"), 1200.0);
    // ∫ y dx of x = 120 (3t² − 2t³), y = 240 t (1 − t).
    near(area("<path d='M0 0 C0 80 120 80 120 0 Z'/>"), 0.25 * 5760.0);
    near(area("<path d='M0,0 Q60,80 120,0'/><path d='M120 0H0'/>"), 0.25 * 2.0 / 3.0 * 60.0 * 80.0);
    near(area("<path d='M0 0 q30 40 60 0 t60 0 v90 h-120 z'/>"), 0.25 * 120.0 * 90.0);
}

#[test]
fn what_a_drawing_has_beside_one_outline_is_named() {
    let block = [[0.0, 0.0], [60.0, 0.0], [60.0, 40.0], [0.0, 40.0]].map(Point2::from);
    let mut sides: Vec<String> = (0..4).map(|i| line(block[i], block[(i + 1) % 4])).collect();
    let with = |entity: String| told("a.dxf", &dxf(Some(4), &[sides.clone(), vec![entity]].concat()));
    let circle = |x: f64| entity("CIRCLE", "bores", &[(10, x), (20, 20.0), (40, 5.0)]);
    let hole = with(circle(30.0));
    assert!(hole.contains("CIRCLE on layer \"bores\" at line") && hole.contains("is a hole"), "{hole}");
    let several = with(circle(130.0));
    assert!(several.contains("2 outlines") && several.contains("bores"), "{several}");
    let text = with(entity("MTEXT", "notes", &[(10, 0.0), (20, 0.0)]));
    assert!(text.contains("MTEXT on layer \"notes\" at line") && text.contains("`layer`"), "{text}");
    assert!(with(entity("INSERT", "0", &[])).contains("explode"));
    assert!(with(entity("LINE", "hidden", &[])).contains("hidden"));
    assert!(with(entity("SPLINE", "0", &[(11, 1.0), (21, 1.0)])).contains("goes through"));
    let steep = entity("LINE", "0", &[(10, 0.0), (20, 0.0), (30, 0.0), (11, 5.0), (21, 5.0), (31, 5.0)]);
    assert!(with(steep).contains("z = 0 to 5"));
    let tilted = entity("CIRCLE", "0", &[(10, 9.0), (20, 9.0), (40, 5.0), (210, 1.0), (220, 0.0), (230, 0.0)]);
    assert!(with(tilted).contains("x-y plane"));
    let fork = with(line(block[0], block[2]));
    assert!(fork.contains("meet at"), "{fork}");
    sides.pop();
    let open = told("a.dxf", &dxf(Some(4), &sides));
    assert!(open.contains("open") && open.contains("LINE on layer \"0\" at line") && open.contains("40.0"), "{open}");
    // A layer, filled holes.
    sides.push(line(block[3], block[0]));
    let all = dxf(Some(4), &[sides, vec![circle(30.0)]].concat());
    let layer = |name: &str| draw(all.as_bytes(), &Request { layer: Some(name.to_owned()), ..request("a.dxf") });
    assert!((layer("0").unwrap().outline.area() - 2.4e-3).abs() < 1e-12);
    let missing = layer("cut").unwrap_err().to_string();
    assert!(missing.contains("\"0\", \"bores\""), "{missing}");
    let filled = draw(all.as_bytes(), &Request { fills_holes: true, ..request("a.dxf") }).unwrap();
    assert!((filled.outline.area() - 2.4e-3).abs() < 1e-12);
    let bow = [[0.0, 0.0], [60.0, 40.0], [60.0, 0.0], [0.0, 40.0]].map(Point2::from);
    let bow: Vec<String> = (0..4).map(|i| line(bow[i], bow[(i + 1) % 4])).collect();
    let crossing = told("a.dxf", &dxf(Some(4), &bow));
    assert!(crossing.contains("crosses") && crossing.matches("LINE on layer").count() >= 3, "{crossing}");
}

#[test]
fn units_are_taken_asked_for_and_never_guessed() {
    let circle = [entity("CIRCLE", "0", &[(10, 0.0), (20, 0.0), (40, 1.0)])];
    let radius = |found: Drawn| (found.outline.area() / PI).sqrt();
    assert!((radius(read("a.dxf", &dxf(Some(1), &circle)).unwrap()) - 0.0254).abs() < 1e-4);
    assert!((radius(read("a.dxf", &dxf(Some(5), &circle)).unwrap()) - 0.01).abs() < 1e-4);
    for silent in [dxf(None, &circle), dxf(Some(0), &circle)] {
        let message = told("a.dxf", &silent);
        assert!(message.contains("does not say its unit") && message.contains("$INSUNITS"), "{message}");
    }
    let asked = Request { unit: Some(Unit::Centimetre), ..request("a.dxf") };
    assert!((radius(draw(dxf(None, &circle).as_bytes(), &asked).unwrap()) - 0.01).abs() < 1e-4);
    let twice = draw(dxf(Some(4), &circle).as_bytes(), &asked).unwrap_err().to_string();
    assert!(twice.contains("is mm ($INSUNITS at line") && twice.contains("cm"), "{twice}");
    assert!(told("a.dxf", &dxf(Some(7), &circle)).contains("$INSUNITS = 7"));
    let svg = |attributes: &str| format!("<svg xmlns='http://www.w3.org/2000/svg' {attributes}><circle r='10'/></svg>");
    for silent in
        ["", "width='100' height='100' viewBox='0 0 100 100'", "width='100px' viewBox='0 0 9 9'", "width='50mm'"]
    {
        assert!(told("a.svg", &svg(silent)).contains("does not say its unit"), "{silent}");
    }
    assert!((radius(read("a.svg", &svg("width='5in' viewBox='0 0 5 5'")).unwrap()) - 0.254).abs() < 1e-4);
    assert!(told("a.svg", &svg("width='5in' height='5in' viewBox='0 0 5 9'")).contains("two scales"));
    assert!(
        told("a.stl", &stl_text(&prism(&[[1.0, -1.0], [0.0, 2.0], [-1.0, -1.0]].map(Point2::from), [0.0, 1.0])))
            .contains("STL never does")
    );
}

#[test]
fn what_is_drawn_in_svg_and_not_understood_is_named_with_its_line() {
    let with = |shape: &str| {
        told(
            "a.svg",
            &format!(
                "<svg xmlns='http://www.w3.org/2000/svg' width='9mm' viewBox='0 0 9 9'>\n<rect width='5' height='4'/>\n{shape}</svg>"
            ),
        )
    };
    for (shape, wanted) in [
        ("<text>5</text>", "<text> at line 3: it is text"),
        ("<use href='#a'/>", "<use> at line 3: a clone"),
        ("<image/>", "<image> at line 3"),
        ("<g id='marks'><line x2='3'/></g>", "<line> on layer \"marks\" at line 3"),
        ("<path d='M0 0 L5'/>", "<path> at line 3: its path is damaged"),
        ("<circle r='0'/>", "its r is 0"),
        ("<circle r='1' style='display:none'/>", "hidden"),
        ("<circle r='1' clip-path='url(#a)'/>", "clip-path"),
        ("<circle r='1' transform='twist(3)'/>", "twist"),
        ("<circle cx='2' cy='2' r='1' id='bore'/>", "<circle id=\"bore\"> at line 3 is a hole"),
        ("<circle cx='30' r='1'/>", "2 outlines"),
        ("<style>.a{display:none}</style>", "by style"),
        ("<polyline points='1,2,x'/>", "pairs of numbers"),
        ("<rect", "line 3: it is no sound XML"),
    ] {
        let message = with(shape);
        assert!(message.contains(wanted), "{shape}: {message}");
    }
    assert!(told("a.svg", "<html/>").contains("no SVG"));
    assert!(draw(b"<svg>\xff</svg>", &request("a.svg")).unwrap_err().to_string().contains("UTF-8"));
}

#[test]
fn what_is_no_part_of_a_solid_is_named() {
    let block = [[-30.0, -20.0], [30.0, -20.0], [30.0, 20.0], [-30.0, 20.0]].map(Point2::from);
    let facets = prism(&block, [0.0, 20.0]);
    let message =
        |facets: &[[[f64; 3]; 3]], height| draw(stl_text(facets).as_bytes(), &solid(height)).unwrap_err().to_string();
    let open = message(&facets[1..], Height::Shadow);
    assert!(open.contains("open at 3") && open.contains("facet 2") && open.contains("(line 16)"), "{open}");
    assert!(message(&facets, Height::Slice(0.03)).contains("30.0000 mm is not within the solid, which is 20.0000 mm"));
    let beside: Vec<_> =
        prism(&block, [0.0, 20.0]).iter().map(|facet| facet.map(|[x, y, z]| [x + 90.0, y, z])).collect();
    assert!(message(&[facets.clone(), beside].concat(), Height::Slice(0.01)).contains("2 outlines"));
    let moved = |[x, y, z]: [f64; 3]| -> Vec<_> {
        facets.iter().map(|facet| facet.map(|[a, b, c]| [a + x, b + y, c + z])).collect()
    };
    for at in [[0.0; 3], [25.0, 0.0, 0.0], [20.0, 10.0, 18.0]] {
        for height in [Height::Shadow, Height::Slice(0.005), Height::Slice(0.019)] {
            let twice = message(&[facets.clone(), moved(at)].concat(), height);
            assert!(twice.contains("would weigh twice"), "{at:?}, {height:?}: {twice}");
        }
    }
    // Bodies that touch are two in a slice, and no hole.
    assert!(message(&[facets.clone(), moved([60.0, 5.0, 1.0])].concat(), Height::Slice(0.01)).contains("2 outlines"));
    let ask = Request { height: None, ..solid(Height::Shadow) };
    let asked = draw(stl_text(&facets).as_bytes(), &ask).unwrap_err().to_string();
    assert!(asked.contains("20.000 high") && asked.contains("height above the table"), "{asked}");
    let text = stl_text(&facets);
    for (damaged, wanted) in [
        (text.replace("endsolid OpenSCAD_Model\n", ""), "ends before endsolid"),
        (text.replacen("vertex -30", "vertex x", 1), "line 4: a vertex has three"),
        (text.replacen("    endloop", "      vertex 1 2 3\n    endloop", 1), "the fourth"),
        ("solid\nfacet\nendfacet\nendsolid".to_owned(), "0 vertices"),
        ("solid\nendsolid".to_owned(), "no facet"),
        ("hello".to_owned(), "too short"),
    ] {
        let message = draw(damaged.as_bytes(), &solid(Height::Shadow)).unwrap_err().to_string();
        assert!(message.contains(wanted), "wanted {wanted}, got {message}");
    }
    let mut claims = stl_binary(&facets);
    claims[0] = b'x';
    claims[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    let message = draw(&claims, &solid(Height::Shadow)).unwrap_err().to_string();
    assert!(message.contains("4294967295 facets"), "{message}");
}

#[test]
fn a_solid_on_feet_stands_on_them_and_a_chamfered_one_on_its_base() {
    let square = |half: f64, x: f64, y: f64| {
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[i, j]| Point2::new(x + half * i, y + half * j))
    };
    let moved = |facets: Vec<[[f64; 3]; 3]>, x: f64, y: f64| -> Vec<[[f64; 3]; 3]> {
        facets.iter().map(|facet| facet.map(|[a, b, c]| [a + x, b + y, c])).collect()
    };
    let mut facets = prism(&square(30.0, 0.0, 0.0), [2.0, 20.0]);
    for (x, y) in [(-25.0, -25.0), (25.0, -25.0), (0.0, 25.0)] {
        facets.extend(moved(prism(&square(1.0, 0.0, 0.0), [0.0, 2.0]), x, y));
    }
    let found = draw(&stl_binary(&facets), &solid(Height::Slice(0.01))).unwrap();
    let feet = found.solid.unwrap().feet.unwrap();
    assert_eq!(feet.len(), 3);
    for (at, share) in feet {
        // Statics: half on the one, a quarter on either of the two.
        let wanted = if at.y > 0.0 { 0.5 } else { 0.25 };
        assert!((share - wanted).abs() < 1e-3, "{at} {share}");
    }
    // A pedestal of half the width: four feet with the second moment of its square, s²/12 along each axis.
    let pedestal = [prism(&square(30.0, 0.0, 0.0), [2.0, 20.0]), prism(&square(15.0, 0.0, 0.0), [0.0, 2.0])].concat();
    let feet = draw(&stl_binary(&pedestal), &solid(Height::Shadow)).unwrap().solid.unwrap().feet.unwrap();
    let moment: f64 = feet.iter().map(|(at, share)| share * at.coords.norm_squared()).sum();
    assert!((moment / (0.03 * 0.03 / 6.0) - 1.0).abs() < 1e-3 && feet.len() == 4, "{feet:?}");
}

#[test]
fn a_round_solid_is_simplified_and_a_turned_one_lies_as_it_is_told() {
    let at = |i: u32| f64::from(i) / 360.0 * TAU;
    let round: Vec<_> = (0..360).map(|i| Point2::new(30.0 * at(i).cos(), 20.0 * at(i).sin())).collect();
    let facets = prism(&round, [0.0, 10.0]);
    let found = draw(&stl_binary(&facets), &solid(Height::Slice(0.005))).unwrap();
    assert!(found.outline.vertices().len() < 100 && found.error > 1e-6 && found.error <= 5e-5, "{}", found.error);
    let side = Request { up: Up::PlusY, ..solid(Height::Shadow) };
    let found = draw(&stl_binary(&facets), &side).unwrap();
    assert!((found.outline.area() - 0.06 * 0.01).abs() < 2e-6, "{}", found.outline.area());
    assert!((found.solid.unwrap().height - 0.04).abs() < 1e-6);
}

#[test]
fn huge_and_hostile_files_are_refused_in_words() {
    // Groups as deep as the file is long.
    let deep = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' width='9mm' viewBox='0 0 9 9'>{}{}</svg>",
        "<g>".repeat(20_000),
        "</g>".repeat(20_000)
    );
    assert!(!told("a.svg", &deep).is_empty());
    let laughs = "<!DOCTYPE svg [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'><!ENTITY c '&b;&b;&b;&b;&b;&b;&b;&b;'>\
                  <!ENTITY d '&c;&c;&c;&c;&c;&c;&c;&c;'><!ENTITY e '&d;&d;&d;&d;&d;&d;&d;&d;'>]><svg><text>&e;&e;&e;&e;</text></svg>";
    assert!(!told("a.svg", laughs).is_empty());
    // A circle so large that its chords are beyond all numbers, and a file of very many vertices.
    let vast = entity("CIRCLE", "0", &[(10, 0.0), (20, 0.0), (40, 1e15)]);
    assert!(told("a.dxf", &dxf(Some(4), &[vast])).contains("chords"));
    let mut pairs = vec![(70, 1.0)];
    pairs.extend((0..100_000).flat_map(|i| [(10, f64::from(i).cos()), (20, f64::from(i).sin())]));
    assert!(told("a.dxf", &dxf(Some(4), &[entity("LWPOLYLINE", "0", &pairs)])).contains("vertices"));
    let stacked: Vec<String> = (0..2_000).map(|_| line(Point2::origin(), Point2::new(1.0, 0.0))).collect();
    assert!(told("a.dxf", &dxf(Some(4), &stacked)).contains("meet at"));
    assert!(told("a.dxf", "AutoCAD Binary DXF\r\n").contains("binary DXF"));
    assert!(told("a.step", "").contains("ends in none of"));
}

#[test]
fn a_drawing_of_a_size_that_no_part_has_is_refused() {
    let corners = [[0.0, 0.0], [90.0, 0.0], [70.0, 50.0], [0.0, 40.0]].map(Point2::from);
    let block = prism(&corners.map(|p| p - nalgebra::Vector2::new(40.0, 20.0)), [0.0, 10.0]);
    for scale in [1e-7, 1e-3, 1e4, 1e9, 1e306] {
        let outline = corners.map(|p| p * scale);
        let drawn = told("a.dxf", &dxf(Some(4), &lines(&outline, &mut Draw::new(1))));
        let solids = block.iter().map(|facet| facet.map(|p| p.map(|value| value * scale))).collect::<Vec<_>>();
        let solid = draw(stl_text(&solids).as_bytes(), &solid(Height::Shadow)).unwrap_err().to_string();
        assert!(drawn.contains("is the unit right?") && drawn.len() < 150, "{scale}: {drawn}");
        assert!(solid.contains("is the unit right?") || scale > 1e9, "{scale}: {solid}");
    }
}

#[test]
fn part_and_scene_files_take_an_outline_from_a_file() {
    let circle = dxf(Some(4), &[entity("CIRCLE", "0", &[(10, 0.0), (20, 0.0), (40, 30.0)])]);
    let open = |name: &str| match name {
        "disk.dxf" => Ok(circle.clone().into_bytes()),
        _ => Err(std::io::Error::new(std::io::ErrorKind::NotFound, "no such file")),
    };
    let part = |keys: &str| PartFile::parse_beside(&format!("unit = 'mm'\nmu = 0.3\n{keys}"), &open);
    let file = part("outline = 'disk.dxf'\noutline_sigma = 0.03").unwrap();
    let error = file.drawn.unwrap().error;
    assert!(error > 1e-5 && error <= 5e-5, "{error}");
    assert!((file.errors.outline_sigma - error.hypot(3e-5)).abs() < 1e-15);
    let coarse = part("outline = {file = 'disk.dxf', curve_error = 1}").unwrap();
    assert!(coarse.part.outline().len() < 16 && coarse.errors.outline_sigma > 2e-4);
    for (keys, wanted) in [
        ("outline = 'else.dxf'", "outline: else.dxf: no such file"),
        ("outline = 'disk.dxf'\nvertices = [[0, 0], [1, 0], [1, 1]]", "two outlines"),
        ("outline = {file = 'disk.dxf', heigth = 3}", "outline"),
        ("outline = {file = 'disk.dxf', height = 3}", "for solids"),
        ("outline = {file = 'disk.dxf', curve_error = 0}", "above 0"),
    ] {
        let message = part(keys).unwrap_err().to_string();
        assert!(message.contains(wanted), "{keys}: {message}");
    }
    assert!(
        PartFile::parse("unit = 'mm'\nmu = 0.3\noutline = 'a.dxf'").unwrap_err().to_string().contains("no other file")
    );
    let scene = "unit = 'mm'\n[[shape]]\nname = 'disk'\noutline = 'disk.dxf'\nposes = [[0, 0, 0], [50, 0, 0]]";
    let scene = SceneFile::parse_beside(scene, &open).unwrap();
    assert_eq!(scene.polygons.len(), 2);
    assert!((scene.curve_error - error).abs() < 1e-15);
    assert!(
        SceneFile::parse("unit = 'mm'\n[[shape]]\nname = 'x'").unwrap_err().to_string().contains("`x`: give either")
    );
}
