//! STL, as text and binary: a solid by its facets.
//!
//! Normals and attributes in the file are not looked at; facets tell which side is out by the order of their corners. A file
//! may hold several `solid`s, which are taken together.

use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::float::overlay::{FloatOverlay, OverlayOptions};
use nalgebra::{Point2, Point3};
use palpate::geometry::mesh::{BasePatch, FACETS_MAX, Mesh, MeshError, signed_area};
use palpate::geometry::{SimplePolygon, bounding_box, simplified};
use palpate::pushing::dynamics::Mass;
use palpate::pushing::dynamics::resting::weights;

use super::chain::contains;
use super::error::{ShapeError, check_size};
use super::{Drawn, Height, Request, Solid, Up, VERTICES_MAX};

/// Bytes before the facets of a binary file: the header, and their number.
const BEFORE_FACETS: usize = 84;

/// Bytes of a facet: normal and three corners of three numbers, and an attribute.
const FACET: usize = 50;

/// A loop of less than this share of the extent squared is rounding of the file, no outline and no hole.
const LOOP_AREA_MIN: f64 = 1e-7;

/// A base of more than this share of the outline's area bears everywhere: the rest is what edges are rounded by.
const WHOLE_BASE: f64 = 0.95;

/// The middle of such a base, and the centre of mass, are this near to the outline's middle, as a share of the part's size.
const WHOLE_BASE_OFF: f64 = 0.02;

/// A patch whose spread is below this share of the part's size is a foot in one point.
const POINT_FOOT: f64 = 0.03;

/// Reads the solid and its outline.
pub(super) fn read(bytes: &[u8], request: &Request) -> Result<Drawn, ShapeError> {
    let Facets { corners, lines } = facets(bytes)?;
    let Some(unit) = request.unit else {
        let why = "STL never does".to_owned();
        return Err(ShapeError::UnitMissing { why, file: request.file.clone() });
    };
    let metres = unit.metres();
    let stand = |corner: [f64; 3]| {
        let [x, y, z] = corner.map(|value| value * metres);
        // Turns, no mirrors.
        Point3::from(match request.up {
            Up::PlusZ => [x, y, z],
            Up::MinusZ => [x, -y, -z],
            Up::PlusX => [y, z, x],
            Up::MinusX => [z, y, -x],
            Up::PlusY => [z, x, y],
            Up::MinusY => [x, z, -y],
        })
    };
    let triangles: Vec<_> = corners.iter().map(|facet| facet.map(stand)).collect();
    let mesh = Mesh::new(&triangles).map_err(|error| {
        let facet = match error {
            MeshError::Open { facet, .. }
            | MeshError::NotFinite { facet }
            | MeshError::Overlap { facet, .. }
            | MeshError::Inside { facet }
            | MeshError::InsideOut { facet } => Some(facet),
            _ => None,
        };
        let line = facet.and_then(|facet| lines.get(facet).copied());
        ShapeError::Mesh { error, line }
    })?;
    check_size(mesh.extent())?;
    let [low, high] = mesh.heights();
    let (loops, what) = match request.height {
        None => return Err(ShapeError::HeightMissing { height: (high - low) / metres }),
        Some(Height::Shadow) => (shadow(&mesh), "its shadow".to_owned()),
        Some(Height::Slice(height)) => (mesh.slice(low + height), format!("the slice at {:.3} mm", height * 1e3)),
    };
    let (outline, error) = outline(loops, &what, request, [low, high], mesh.extent())?;
    let centre = mesh.centre_of_mass();
    let mass = Mass { centre_of_mass: centre.xy(), inertia_per_mass: mesh.inertia_per_mass() };
    let solid = Solid {
        volume: mesh.volume(),
        height: high - low,
        centre_height: centre.z - low,
        mass,
        feet: feet(&mesh.base(), &outline, mass.centre_of_mass),
    };
    Ok(Drawn { outline, error, solid: Some(solid) })
}

/// Facets in the file's unit, and in a text the line of each.
struct Facets {
    corners: Vec<[[f64; 3]; 3]>,
    lines: Vec<usize>,
}

fn facets(bytes: &[u8]) -> Result<Facets, ShapeError> {
    let damaged = |problem: String| ShapeError::Binary { problem };
    // A binary file may call itself "solid" too, but only by chance is a text as long as its number of facets says.
    let count = bytes.get(80..BEFORE_FACETS).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    let count = count.map(|count| count as usize);
    let length = |count: usize| count.saturating_mul(FACET).saturating_add(BEFORE_FACETS);
    if count.is_some_and(|count| length(count) == bytes.len()) {
        return binary(&bytes[BEFORE_FACETS..]);
    }
    let begin = bytes.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(bytes.len());
    if bytes[begin..].len() >= 5 && bytes[begin..begin + 5].eq_ignore_ascii_case(b"solid") {
        return text(&String::from_utf8_lossy(bytes));
    }
    Err(damaged(match count {
        None => "it is too short for an STL".to_owned(),
        Some(count) => format!(
            "it is no STL, or damaged: it says {count} facets, which take {} bytes, and has {}",
            length(count),
            bytes.len()
        ),
    }))
}

fn binary(bytes: &[u8]) -> Result<Facets, ShapeError> {
    let count = bytes.len() / FACET;
    if count > FACETS_MAX {
        return Err(ShapeError::Mesh { error: MeshError::TooManyFacets { count }, line: None });
    }
    let corner = |bytes: &[u8]| {
        let number = |k: usize| f64::from(f32::from_le_bytes([bytes[k], bytes[k + 1], bytes[k + 2], bytes[k + 3]]));
        [number(0), number(4), number(8)]
    };
    let facet = |bytes: &[u8]| [corner(&bytes[12..24]), corner(&bytes[24..36]), corner(&bytes[36..48])];
    Ok(Facets { corners: bytes.chunks_exact(FACET).map(facet).collect(), lines: Vec::new() })
}

fn text(text: &str) -> Result<Facets, ShapeError> {
    let mut facets = Facets { corners: Vec::new(), lines: Vec::new() };
    let mut open: Option<(usize, Vec<[f64; 3]>)> = None;
    let mut is_in_solid = false;
    let mut last = 0;
    for (line, words) in (1..).zip(text.lines()) {
        last = line;
        let wrong = |problem: String| ShapeError::Format { line, problem };
        let mut words = words.split_ascii_whitespace();
        let Some(word) = words.next() else { continue };
        match (word.to_ascii_lowercase().as_str(), &mut open) {
            ("solid", None) if !is_in_solid => is_in_solid = true,
            ("endsolid", None) if is_in_solid => is_in_solid = false,
            ("facet", None) if is_in_solid => open = Some((line, Vec::new())),
            ("outer" | "endloop", Some(_)) => {}
            ("vertex", Some((_, corners))) => {
                let numbers: Vec<f64> = words.by_ref().filter_map(|word| word.parse().ok()).collect();
                let corner = <[f64; 3]>::try_from(numbers).ok().filter(|corner| corner.iter().all(|x| x.is_finite()));
                corners.push(corner.ok_or_else(|| wrong("a vertex has three finite numbers".to_owned()))?);
                if corners.len() > 3 {
                    return Err(wrong("a facet has three vertices, and this is the fourth".to_owned()));
                }
            }
            ("endfacet", Some((begun, corners))) => {
                let corners = <[[f64; 3]; 3]>::try_from(std::mem::take(corners));
                let lacking =
                    |corners: Vec<_>| wrong(format!("the facet has {} vertices, and takes three", corners.len()));
                facets.corners.push(corners.map_err(lacking)?);
                facets.lines.push(*begun);
                open = None;
                if facets.corners.len() > FACETS_MAX {
                    let error = MeshError::TooManyFacets { count: facets.corners.len() };
                    return Err(ShapeError::Mesh { error, line: Some(line) });
                }
            }
            _ => {
                let shown: String = word.chars().take(40).collect();
                return Err(wrong(format!("{shown:?} does not belong here: this is no STL, or damaged")));
            }
        }
    }
    match is_in_solid {
        true => {
            Err(ShapeError::Format { line: last, problem: "the file ends before endsolid: it is damaged".to_owned() })
        }
        false => Ok(facets),
    }
}

/// The outlines of what the solid covers as seen from above: counter-clockwise round material.
fn shadow(mesh: &Mesh) -> Vec<Vec<Point2<f64>>> {
    let facets: Vec<Vec<[f64; 2]>> =
        mesh.seen_from_above().map(|corners| corners.map(|corner| [corner.x, corner.y]).to_vec()).collect();
    // Integers of 64 bits: facets that meet at a corner do so to the last digit of the file.
    let options: OverlayOptions<f64, i64> = OverlayOptions::default();
    let mut overlay =
        FloatOverlay::<[f64; 2], i64>::from_subj_custom(&facets, options, i_overlay::core::solver::Solver::default());
    let shapes = overlay.overlay(OverlayRule::Subject, FillRule::NonZero);
    shapes.into_iter().flatten().map(|contour| contour.into_iter().map(Point2::from).collect()).collect()
}

/// The one outline among loops, simplified, and how far it is from what the file has.
fn outline(
    mut loops: Vec<Vec<Point2<f64>>>,
    what: &str,
    request: &Request,
    [low, high]: [f64; 2],
    extent: f64,
) -> Result<(SimplePolygon, f64), ShapeError> {
    loops.retain(|outline| signed_area(outline).abs() > LOOP_AREA_MIN * extent * extent);
    let size = |outline: &Vec<Point2<f64>>| {
        let (low, high) = bounding_box(outline);
        let (middle, span) = ((low.coords + high.coords) * 500.0, (high - low) * 1e3);
        format!("{:.3} × {:.3} mm at ({:.3}, {:.3}) mm", span.x, span.y, middle.x, middle.y)
    };
    loops.sort_by(|a, b| signed_area(b).total_cmp(&signed_area(a)));
    let Some(outer) = loops.first().filter(|outline| signed_area(outline) > 0.0) else {
        let height = match request.height {
            Some(Height::Slice(height)) => height,
            _ => 0.0,
        };
        return Err(ShapeError::HeightBeside { height: height * 1e3, top: (high - low) * 1e3 });
    };
    // What lies in a hole is no neighbour, but there is none without the hole.
    let hole = loops[1..].last().filter(|outline| signed_area(outline) < 0.0);
    let is_beside =
        |outline: &&Vec<Point2<f64>>| signed_area(outline) > 0.0 && (hole.is_none() || !contains(outer, outline[0]));
    if let Some(other) = loops[1..].iter().find(is_beside) {
        let count = loops.iter().filter(|outline| signed_area(outline) > 0.0).count();
        let first = format!("{what}, {}", size(outer));
        return Err(ShapeError::Several { count, first, second: size(other), is_solid: true });
    }
    if let (Some(hole), false) = (hole, request.fills_holes) {
        return Err(ShapeError::Hole { place: format!("in {what}, {}", size(hole)), of: None });
    }
    let (kept, error) = if outer.len() > 20 * VERTICES_MAX {
        return Err(ShapeError::TooManyVertices { count: outer.len() });
    } else {
        simplified(outer, request.curve_error)
    };
    if kept.len() > VERTICES_MAX {
        return Err(ShapeError::TooManyVertices { count: kept.len() });
    }
    let vertices: Vec<_> = kept.iter().map(|index| outer[*index]).collect();
    let outline = SimplePolygon::new(vertices);
    let polygon = outline.map_err(|error| ShapeError::Outline { place: what.to_owned(), error, edges: None })?;
    // Straight sides cut into facets are simplified without error but for the file's rounding.
    Ok((polygon, if error > 1e-6 * extent { error } else { 0.0 }))
}

/// What bears the solid: none where all of its outline does, evenly.
///
/// A patch is stood for by four feet that have its area, middle and second moments, so that friction on them resists as on
/// it; a small one by one.
fn feet(base: &[BasePatch], outline: &SimplePolygon, centre_of_mass: Point2<f64>) -> Option<Vec<(Point2<f64>, f64)>> {
    let (low, high) = bounding_box(outline.vertices());
    let size = (high - low).amax();
    let middle = outline.centroid();
    if let [patch] = base {
        let is_near = |point: Point2<f64>| (point - middle).norm() <= WHOLE_BASE_OFF * size;
        let share = patch.area / outline.area();
        if (WHOLE_BASE..2.0 - WHOLE_BASE).contains(&share) && is_near(patch.centroid) && is_near(centre_of_mass) {
            return None;
        }
    }
    let least = base.iter().map(|patch| patch.area).filter(|area| *area > 0.0).fold(f64::INFINITY, f64::min);
    let least = if least.is_finite() { least } else { 1.0 };
    let places: Vec<_> = base
        .iter()
        .flat_map(|patch| {
            let area = if patch.area > 0.0 { patch.area } else { least };
            let [xx, xy, yy] = patch.spread;
            let axes = nalgebra::Matrix2::new(xx, xy, xy, yy).symmetric_eigen();
            if patch.spread[0] + patch.spread[2] <= (POINT_FOOT * size).powi(2) {
                return vec![(patch.centroid, area)];
            }
            let arm = |axis: usize| axes.eigenvectors.column(axis) * (2.0 * axes.eigenvalues[axis].max(0.0)).sqrt();
            let arms = [arm(0), -arm(0), arm(1), -arm(1)];
            arms.map(|arm| (patch.centroid + arm, area / 4.0)).to_vec()
        })
        .collect();
    // Where no shares carry it, the areas stay, and the reader of the part says that it tips over.
    let shares = weights(&places, centre_of_mass).unwrap_or_else(|| places.iter().map(|(_, area)| *area).collect());
    let borne = places.iter().zip(shares).map(|((at, _), share)| (*at, share));
    Some(borne.filter(|(_, share)| *share > 1e-6).collect())
}
