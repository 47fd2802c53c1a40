//! The files in which a person describes a part and what sensors saw of it.
//!
//! A part file is that of `palpate push`; only its outline matters here. Corners are rounded by `rounding = 3`: an arc
//! of this radius about each vertex, and so much is added to the edges. A view file:
//!
//! ```toml
//! unit = "mm"             # of every length below: m, cm, mm or in; angles are in degrees, counter-clockwise from x
//! sigma = 0.1             # standard deviation of each bearing, degrees (optional: without it the readings are exact)
//!
//! [[cone]]                # what a sensor sees of the part: swept counter-clockwise from right to left
//! apex = [-200, 50]
//! right = -10.3
//! left = 6.9
//! moved = [0, 0, 0]       # how far the part had moved since the start when this was read: x, y, turn (optional)
//!
//! [[fence]]               # a line that the part touches: x cos(normal) + y sin(normal) = offset, the part below it
//! normal = -90
//! offset = 0
//! sigma = 0.05            # standard deviation of the offset, in the file's unit (optional: without it the line is exact)
//!
//! [[point]]               # a point on the part's outline: a probed contact
//! at = [60, 15]
//! sigma = 0.05            # of each coordinate, in the file's unit; without it on all points they are exact, and go
//!                         # with exact readings only
//! normal = 0              # of the outline there, out of the part, and its standard deviation (optional, both or none)
//! normal_sigma = 2
//!
//! [[free]]                # a disk that the part does not reach into (optional)
//! centre = [80, 15]
//! radius = 4
//! ```
//!
//! With a point's or a fence's `sigma`, or a free disk, the part may have notches; lines and cones touch its hull.

use nalgebra::{Isometry2, Point2};
use palpate::geometry::{ConvexPolygon, NotConvex, PolygonError, SimplePolygon};
use palpate::inscription::{
    Bearing, Cone, ConeError, Ellipse, FeltNormal, Fence, FreeDisk, HalfPlane, NoisyReadings, Outline, Rounded, Touch,
    TouchReadings,
};
use serde::Deserialize;
use toml::Value;

use crate::part::{Numbers, Unit};
use crate::shapes::{Opener, OutlineKeys, ShapeError, closed};

/// A part that a person has described.
#[derive(Clone, Debug)]
pub struct NamedPart {
    /// What to call it.
    pub name: String,
    /// As the file gives it; a smooth one in short steps.
    pub outline: SimplePolygon,
    /// The convex part that its sensors see.
    pub shape: Outline,
    /// The hull of `outline`, prepared.
    pub convex: ConvexPolygon,
    /// As the file gives it, part frame, m.
    pub centre_of_mass: Option<Point2<f64>>,
}

/// What sensors saw of a part.
#[derive(Clone, Debug)]
pub struct Views {
    /// As they were read, for pictures.
    pub cones: Vec<Cone>,
    /// Everything moved to where the part was at the start.
    pub readings: NoisyReadings,
    /// Points of the outline, moved likewise.
    pub points: Vec<Point2<f64>>,
    /// Whether the readings have errors.
    pub noisy: bool,
    /// All readings as those of a part that was felt, where a point or a fence has errors or a disk is free.
    pub felt: Option<TouchReadings>,
}

/// Why a file cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ViewFileError {
    /// Not TOML, a key missing, unknown or of another type; the message shows the place.
    #[error("{0}")]
    Toml(String),
    /// An outline that is no polygon.
    #[error("vertices: {0}")]
    Outline(PolygonError),
    /// The outline has a notch.
    #[error("vertices: {0}")]
    NotConvex(NotConvex),
    /// A cone that no part can fill.
    #[error("cone {index}: {error}")]
    Cone {
        /// Place of the cone in the file, from 0.
        index: usize,
        /// Why its numbers are no cone.
        error: ConeError,
    },
    /// Not exactly one outline.
    #[error("give one of `vertices`, `ellipse` and `outline`")]
    WhichOutline,
    /// The file that draws the outline.
    #[error("outline: {0}")]
    Drawing(ShapeError),
    /// A radius that cannot be.
    #[error("rounding = {0:?} must be finite and not below 0, and needs `vertices`")]
    Rounding(f64),
    /// Semi-axes that cannot be.
    #[error(
        "ellipse = {{a = {a:?}, b = {b:?}}}: both must be finite and above 0, the larger at most 1000 times the other"
    )]
    Ellipse {
        /// As given, in the file's unit.
        a: f64,
        /// As given, in the file's unit.
        b: f64,
    },
    /// What is only solved for exact readings of polygons.
    #[error("{what} cannot be used with {with}: {remedy}")]
    Together {
        /// The one of the two.
        what: &'static str,
        /// The other of the two.
        with: &'static str,
        /// What to do about it, in words.
        remedy: &'static str,
    },
    /// A fence, a point or a motion that is no number.
    #[error("{what} {index} has a number that is not finite")]
    NotFinite {
        /// `cone`, `fence` or `point`.
        what: &'static str,
        /// Place of the entry in the file, from 0.
        index: usize,
    },
    /// A standard deviation of an entry that cannot be.
    #[error("{what} {index}: {key} = {value:?} must be finite and above 0")]
    Deviation {
        /// `fence` or `point`.
        what: &'static str,
        /// Place of the entry in the file, from 0.
        index: usize,
        /// The key.
        key: &'static str,
        /// As given.
        value: f64,
    },
    /// A point that is exact beside others that are not.
    #[error(
        "point {index} has no `sigma`, and something else here is known with errors only: give each [[point]] its `sigma`, a length"
    )]
    ExactPoint {
        /// Place of the point in the file, from 0.
        index: usize,
    },
    /// One of two keys that go together.
    #[error("point {index} has one of `normal` and `normal_sigma`: give both or none")]
    HalfNormal {
        /// Place of the point in the file, from 0.
        index: usize,
    },
    /// Exact bearings beside readings with errors.
    #[error(
        "[[cone]] beside points or fences with errors needs `sigma`, the standard deviation of each bearing in degrees"
    )]
    ExactCones,
    /// A disk that cannot be.
    #[error("free {index}: centre and radius must be finite, the radius not below 0")]
    Free {
        /// Place of the entry in the file, from 0.
        index: usize,
    },
    /// A centre of mass that is no place.
    #[error("centre_of_mass = {value:?} must be finite")]
    CentreOfMass {
        /// As given, in the file's unit.
        value: [f64; 2],
    },
    /// A standard deviation that cannot be.
    #[error("sigma = {value:?} must be finite and above 0; leave it out for exact readings")]
    Sigma {
        /// Standard deviation as given, degrees.
        value: f64,
    },
    /// No cone, no fence and no point.
    #[error("there is no [[cone]], no [[fence]] and no [[point]]: give at least one")]
    Nothing,
}

/// The keys of a part file; those that tell how it slides are for other commands, but for its centre of mass, by which
/// it comes to rest.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(dead_code, reason = "known keys, so that unknown ones are mistakes")]
struct PartKeys {
    unit: Unit,
    vertices: Option<Vec<Numbers<2>>>,
    rounding: Option<f64>,
    ellipse: Option<EllipseKeys>,
    outline: Option<OutlineKeys>,
    outline_sigma: Option<Value>,
    centre_of_mass_sigma: Option<Value>,
    mu: Option<Value>,
    mu_c: Option<Value>,
    feet: Option<Value>,
    centre_of_mass: Option<Numbers<2>>,
    radius_of_gyration: Option<Value>,
    support: Option<Value>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct EllipseKeys {
    a: f64,
    b: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewKeys {
    unit: Unit,
    sigma: Option<f64>,
    #[serde(default)]
    cone: Vec<ConeKeys>,
    #[serde(default)]
    fence: Vec<FenceKeys>,
    #[serde(default)]
    point: Vec<PointKeys>,
    #[serde(default)]
    free: Vec<FreeKeys>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FreeKeys {
    centre: Numbers<2>,
    radius: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ConeKeys {
    apex: Numbers<2>,
    right: f64,
    left: f64,
    moved: Option<Numbers<3>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FenceKeys {
    normal: f64,
    offset: f64,
    sigma: Option<f64>,
    moved: Option<Numbers<3>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PointKeys {
    at: Numbers<2>,
    sigma: Option<f64>,
    normal: Option<f64>,
    normal_sigma: Option<f64>,
    moved: Option<Numbers<3>>,
}

/// The longest ellipse for its width: its ends are sharper than its size can be measured.
const ELLIPSE_RATIO_MAX: f64 = 1000.0;

impl NamedPart {
    /// Reads the text of a part file; `hull` takes the hull of a part with notches.
    ///
    /// # Errors
    /// [`ViewFileError`] names the first thing found wrong.
    pub fn parse(name: &str, text: &str, hull: bool) -> Result<Self, ViewFileError> {
        Self::parse_beside(name, text, hull, &closed)
    }

    /// The same of a file that may name another, which is opened as it says.
    ///
    /// # Errors
    /// [`ViewFileError`] names the first thing found wrong.
    pub fn parse_beside(name: &str, text: &str, hull: bool, open: Opener<'_>) -> Result<Self, ViewFileError> {
        let keys: PartKeys = toml::from_str(text).map_err(|error| ViewFileError::Toml(error.to_string()))?;
        let metres = keys.unit.metres();
        let drawn = keys.outline.as_ref().map(|outline| outline.draw(metres, open)).transpose();
        let drawn = drawn.map_err(ViewFileError::Drawing)?;
        let mass = drawn.as_ref().and_then(|drawn| drawn.solid.as_ref()).map(|solid| solid.mass.centre_of_mass);
        let (outline, shape) = match (&keys.vertices, keys.ellipse, drawn) {
            (Some(vertices), None, None) => polygon(vertices, metres, keys.rounding, hull)?,
            (None, Some(ellipse), None) => ellipse.outline(metres, keys.rounding)?,
            (None, None, Some(drawn)) => bounded(drawn.outline, metres, keys.rounding, hull)?,
            _ => return Err(ViewFileError::WhichOutline),
        };
        let convex = match &shape {
            Outline::Polygon(convex) => convex.clone(),
            smooth => smooth.sampled(),
        };
        let centre_of_mass = match keys.centre_of_mass {
            Some(Numbers(value)) if !value.iter().all(|x| x.is_finite()) => {
                return Err(ViewFileError::CentreOfMass { value });
            }
            given => given.map(|Numbers(value)| Point2::from(value) * metres).or(mass),
        };
        Ok(Self { name: name.to_owned(), outline, shape, convex, centre_of_mass })
    }

    /// Whether the readings are of a kind that is solved for this part.
    ///
    /// # Errors
    /// [`ViewFileError::Together`] for points, or bearings with errors, of a smooth part, and for points of a part with
    /// notches.
    pub fn check(&self, views: &Views) -> Result<(), ViewFileError> {
        let together = |what, with, remedy| Err(ViewFileError::Together { what, with, remedy });
        let smooth = !matches!(self.shape, Outline::Polygon(_));
        let notched = ConvexPolygon::new(&self.outline).is_err();
        if views.felt.is_some() && smooth {
            return together("touches", "a smooth part", "describe it by many vertices");
        }
        if views.felt.is_some() {
            return Ok(());
        }
        match (views.noisy, views.points.is_empty()) {
            (true, _) if smooth => together("sigma", "a smooth part", "describe it by many vertices"),
            (false, false) if smooth => together("[[point]]", "a smooth part", "describe it by many vertices"),
            (false, false) if notched => {
                together("[[point]]", "a notched part", "it may lie in a notch, where no hull tells")
            }
            _ => Ok(()),
        }
    }
}

/// The outline with these vertices, and the convex part that it bounds.
fn polygon(
    vertices: &[Numbers<2>],
    metres: f64,
    rounding: Option<f64>,
    hull: bool,
) -> Result<(SimplePolygon, Outline), ViewFileError> {
    let vertices: Vec<_> = vertices.iter().map(|vertex| Point2::from(vertex.0) * metres).collect();
    bounded(SimplePolygon::new(vertices).map_err(ViewFileError::Outline)?, metres, rounding, hull)
}

/// An outline, and the convex part that it bounds.
fn bounded(
    outline: SimplePolygon,
    metres: f64,
    rounding: Option<f64>,
    hull: bool,
) -> Result<(SimplePolygon, Outline), ViewFileError> {
    let polygon = if hull {
        ConvexPolygon::hull(&outline)
    } else {
        ConvexPolygon::new(&outline).map_err(ViewFileError::NotConvex)?
    };
    match rounding {
        Some(radius) if !(radius.is_finite() && radius >= 0.0) => Err(ViewFileError::Rounding(radius)),
        Some(radius) if radius > 0.0 => drawn(Outline::Rounded(Rounded { polygon, radius: radius * metres })),
        _ => Ok((outline, Outline::Polygon(polygon))),
    }
}

/// A smooth part with its outline in short steps.
fn drawn(shape: Outline) -> Result<(SimplePolygon, Outline), ViewFileError> {
    let sampled = shape.sampled();
    let corners: Vec<_> = sampled.corners().iter().map(|corner| sampled.centre() + corner).collect();
    Ok((SimplePolygon::new(corners).map_err(ViewFileError::Outline)?, shape))
}

impl EllipseKeys {
    fn outline(self, metres: f64, rounding: Option<f64>) -> Result<(SimplePolygon, Outline), ViewFileError> {
        let Self { a, b } = self;
        if let Some(radius) = rounding {
            return Err(ViewFileError::Rounding(radius));
        }
        let fair = [a, b].iter().all(|axis| axis.is_finite() && *axis > 0.0) && (a / b).max(b / a) <= ELLIPSE_RATIO_MAX;
        if !fair {
            return Err(ViewFileError::Ellipse { a, b });
        }
        drawn(Outline::Ellipse(Ellipse { a: a * metres, b: b * metres }))
    }
}

impl Views {
    /// Reads the text of a view file.
    ///
    /// ```
    /// let views = palpate_files::views::Views::parse("unit = 'mm'\n[[cone]]\napex = [-200, 50]\nright = -10\nleft = 7")?;
    /// assert!((views.cones[0].opening() - 17_f64.to_radians()).abs() < 1e-12);
    /// # Ok::<(), palpate_files::views::ViewFileError>(())
    /// ```
    ///
    /// # Errors
    /// [`ViewFileError`] names the first thing found wrong.
    pub fn parse(text: &str) -> Result<Self, ViewFileError> {
        Self::parse_with(text, 1.0)
    }

    /// The same, were the file's angles in radians: what a person may have meant.
    ///
    /// # Errors
    /// As [`Views::parse`].
    pub fn parse_radians(text: &str) -> Result<Self, ViewFileError> {
        Self::parse_with(text, 1_f64.to_degrees())
    }

    /// A file whose angles are in so many degrees.
    fn parse_with(text: &str, degrees: f64) -> Result<Self, ViewFileError> {
        let keys: ViewKeys = toml::from_str(text).map_err(|error| ViewFileError::Toml(error.to_string()))?;
        let metres = keys.unit.metres();
        if let Some(value) = keys.sigma.filter(|sigma| !(sigma.is_finite() && *sigma > 0.0)) {
            return Err(ViewFileError::Sigma { value });
        }
        let (mut cones, mut bearings) = (Vec::new(), Vec::new());
        for (index, cone) in keys.cone.iter().enumerate() {
            let undo = undone(cone.moved, metres, degrees).ok_or(ViewFileError::NotFinite { what: "cone", index })?;
            let read = cone.read(metres, degrees).map_err(|error| ViewFileError::Cone { index, error })?;
            bearings.extend(read.bearings().map(|bearing: Bearing| bearing.moved(&undo)));
            cones.push(read);
        }
        let mut fences = Vec::new();
        for (index, fence) in keys.fence.iter().enumerate() {
            let fault = ViewFileError::NotFinite { what: "fence", index };
            if !(fence.normal.is_finite() && fence.offset.is_finite()) {
                return Err(fault);
            }
            let undo = undone(fence.moved, metres, degrees).ok_or(fault)?;
            fences.push(HalfPlane::new((fence.normal * degrees).to_radians(), fence.offset * metres).moved(&undo));
        }
        let points = keys.point.iter().enumerate().map(|(index, point)| {
            let undo =
                undone(point.moved, metres, degrees).filter(|_| point.at.0.iter().all(|value| value.is_finite()));
            let undo = undo.ok_or(ViewFileError::NotFinite { what: "point", index })?;
            Ok(undo * (Point2::from(point.at.0) * metres))
        });
        let points = points.collect::<Result<Vec<_>, ViewFileError>>()?;
        let noisy = keys.sigma.is_some();
        if bearings.is_empty() && fences.is_empty() && points.is_empty() {
            return Err(ViewFileError::Nothing);
        }
        let sigma = (keys.sigma.unwrap_or(0.0) * degrees).to_radians();
        let readings = NoisyReadings { bearings, fences, sigma };
        let felt = keys.is_felt().then(|| keys.felt(&readings, metres, degrees)).transpose()?;
        if noisy && felt.is_none() && !points.is_empty() {
            return Err(ViewFileError::Together {
                what: "[[point]]",
                with: "sigma",
                remedy: "a point without a `sigma` of its own (a length) is exact: give each its own",
            });
        }
        Ok(Self { cones, readings, points, noisy: noisy || felt.is_some(), felt })
    }
}

impl ViewKeys {
    /// Whether something is known with errors that only touches have, or a disk is free.
    fn is_felt(&self) -> bool {
        let has_errors = self.point.iter().any(|point| point.sigma.is_some())
            || self.fence.iter().any(|fence| fence.sigma.is_some());
        has_errors || !self.free.is_empty()
    }

    fn felt(&self, readings: &NoisyReadings, metres: f64, degrees: f64) -> Result<TouchReadings, ViewFileError> {
        if !readings.bearings.is_empty() && self.sigma.is_none() {
            return Err(ViewFileError::ExactCones);
        }
        let touches = self.point.iter().enumerate().map(|(index, point)| point.touch(index, metres, degrees));
        let fences = self.fence.iter().zip(&readings.fences).enumerate().map(|(index, (fence, line))| {
            let sigma = fence.sigma.map(|value| deviation("fence", index, "sigma", value)).transpose()?;
            Ok(Fence { line: *line, sigma: sigma.map(|sigma| sigma * metres) })
        });
        let free = self.free.iter().enumerate().map(|(index, disk)| {
            let numbers = disk.centre.0.iter().chain([&disk.radius]);
            if !numbers.into_iter().all(|value| value.is_finite()) || disk.radius < 0.0 {
                return Err(ViewFileError::Free { index });
            }
            Ok(FreeDisk { centre: Point2::from(disk.centre.0) * metres, radius: disk.radius * metres })
        });
        Ok(TouchReadings {
            touches: touches.collect::<Result<_, _>>()?,
            fences: fences.collect::<Result<_, ViewFileError>>()?,
            bearings: readings.bearings.clone(),
            bearing_sigma: readings.sigma,
            free: free.collect::<Result<_, _>>()?,
        })
    }
}

/// A standard deviation that can be.
fn deviation(what: &'static str, index: usize, key: &'static str, value: f64) -> Result<f64, ViewFileError> {
    let is_fair = value.is_finite() && value > 0.0;
    is_fair.then_some(value).ok_or(ViewFileError::Deviation { what, index, key, value })
}

impl PointKeys {
    fn touch(&self, index: usize, metres: f64, degrees: f64) -> Result<Touch, ViewFileError> {
        let sigma = self.sigma.ok_or(ViewFileError::ExactPoint { index })?;
        let sigma = deviation("point", index, "sigma", sigma)? * metres;
        let undo = undone(self.moved, metres, degrees).ok_or(ViewFileError::NotFinite { what: "point", index })?;
        let radians = |angle: f64| (angle * degrees).to_radians();
        let normal = match (self.normal, self.normal_sigma) {
            (None, None) => None,
            (Some(angle), Some(sigma)) if angle.is_finite() => {
                let sigma = radians(deviation("point", index, "normal_sigma", sigma)?);
                Some(FeltNormal { angle: radians(angle) + undo.rotation.angle(), sigma })
            }
            (Some(_), Some(_)) => return Err(ViewFileError::NotFinite { what: "point", index }),
            _ => return Err(ViewFileError::HalfNormal { index }),
        };
        Ok(Touch { point: undo * (Point2::from(self.at.0) * metres), sigma, normal })
    }
}

impl Views {
    /// The same with lengths so many times as long: what another unit would make of it.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        scaled.readings.bearings.iter_mut().for_each(|bearing| bearing.apex *= factor);
        scaled.readings.fences.iter_mut().for_each(|fence| fence.point *= factor);
        scaled.points.iter_mut().for_each(|point| *point *= factor);
        if let Some(felt) = &mut scaled.felt {
            felt.bearings.iter_mut().for_each(|bearing| bearing.apex *= factor);
            for fence in &mut felt.fences {
                fence.line.point *= factor;
                fence.sigma = fence.sigma.map(|sigma| sigma * factor);
            }
            for touch in &mut felt.touches {
                touch.point *= factor;
                touch.sigma *= factor;
            }
            for disk in &mut felt.free {
                disk.centre *= factor;
                disk.radius *= factor;
            }
        }
        scaled
    }

    /// The same readings with errors of this standard deviation, rad.
    #[must_use]
    pub fn with_sigma(&self, sigma: f64) -> Self {
        let readings = NoisyReadings { sigma, ..self.readings.clone() };
        Self { readings, noisy: true, ..self.clone() }
    }

    /// The same with points that have errors of this standard deviation, m; none where there is no point, or a cone.
    #[must_use]
    pub fn with_point_sigma(&self, sigma: f64) -> Option<Self> {
        if self.points.is_empty() || self.felt.is_some() || !self.cones.is_empty() {
            return None;
        }
        let touches = self.points.iter().map(|point| Touch { point: *point, sigma, normal: None }).collect();
        let fences = self.readings.fences.iter().map(|line| Fence { line: *line, sigma: Some(sigma) }).collect();
        let felt = TouchReadings { touches, fences, ..TouchReadings::default() };
        Some(Self { noisy: true, felt: Some(felt), ..self.clone() })
    }

    /// The views with one of them left out, each by its name in the file.
    #[must_use]
    pub fn each_left_out(&self) -> Vec<(String, Self)> {
        let cones = (0..self.cones.len()).map(|index| {
            let mut left = self.clone();
            // Two bearings a cone.
            left.readings.bearings.drain(2 * index..2 * index + 2);
            if let Some(felt) = &mut left.felt {
                felt.bearings.drain(2 * index..2 * index + 2);
            }
            left.cones.remove(index);
            (format!("cone {index}"), left)
        });
        let fences = (0..self.readings.fences.len()).map(|index| {
            let mut left = self.clone();
            left.readings.fences.remove(index);
            if let Some(felt) = &mut left.felt {
                felt.fences.remove(index);
            }
            (format!("fence {index}"), left)
        });
        let points = (0..self.points.len()).map(|index| {
            let mut left = self.clone();
            left.points.remove(index);
            if let Some(felt) = &mut left.felt {
                felt.touches.remove(index);
            }
            (format!("point {index}"), left)
        });
        cones.chain(fences).chain(points).collect()
    }
}

impl ConeKeys {
    fn read(&self, metres: f64, degrees: f64) -> Result<Cone, ConeError> {
        let [right, left] = [self.right, self.left].map(|angle| (angle * degrees).to_radians());
        Cone::new(Point2::from(self.apex.0) * metres, right, left)
    }
}

/// The motion that takes the part back; none if it is not finite.
fn undone(moved: Option<Numbers<3>>, metres: f64, degrees: f64) -> Option<Isometry2<f64>> {
    let [x, y, turn] = moved.map_or([0.0; 3], |Numbers(moved)| moved);
    let finite = [x, y, turn].iter().all(|value| value.is_finite());
    finite.then(|| Isometry2::new([x * metres, y * metres].into(), (turn * degrees).to_radians()).inverse())
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEWS: &str = "unit = 'mm'\nsigma = 0.1\n[[cone]]\napex = [-200, 50]\nright = -10\nleft = 7\n";

    #[test]
    fn lengths_are_in_the_files_unit_and_angles_in_degrees() {
        let views = Views::parse(&format!("{VIEWS}[[fence]]\nnormal = 90\noffset = 40")).unwrap();
        let bearing = views.readings.bearings[0];
        assert!(
            (bearing.apex - Point2::new(-0.2, 0.05)).norm() < 1e-15 && (bearing.angle + 0.174_532_925).abs() < 1e-9
        );
        assert!((views.readings.fences[0].beyond(Point2::new(3.0, 0.05)) - 0.01).abs() < 1e-12);
        assert!(views.noisy && (views.readings.sigma - 0.1_f64.to_radians()).abs() < 1e-15);
    }

    #[test]
    fn points_with_errors_are_felt_in_the_files_units() {
        let point = "[[point]]\nat = [60, 15]\nsigma = 0.05\nnormal = 90\nnormal_sigma = 2\nmoved = [10, 0, 90]\n";
        let views = Views::parse(&format!("{VIEWS}{point}[[free]]\ncentre = [80, 15]\nradius = 4")).unwrap();
        let felt = views.felt.unwrap();
        let touch = felt.touches[0];
        // Felt after the part was moved by 10 mm and turned by a quarter turn.
        assert!((touch.point - Point2::new(0.015, -0.05)).norm() < 1e-12 && (touch.sigma - 5e-5).abs() < 1e-15);
        let normal = touch.normal.unwrap();
        assert!(normal.angle.abs() < 1e-12 && (normal.sigma - 2_f64.to_radians()).abs() < 1e-15);
        assert!(views.noisy && felt.bearings.len() == 2 && (felt.free[0].radius - 0.004).abs() < 1e-15);
    }

    #[test]
    fn every_mistake_is_named() {
        let bad = [
            (VIEWS.replace("left = 7", "left = -30"), "cone 0: the cone opens by"),
            (VIEWS.replace("left = 7", "left = -10"), "cone 0: the cone has no opening"),
            (VIEWS.replace("left = 7", "left = nan"), "cone 0: the apex and the angles must be finite"),
            (VIEWS.replace("50]", "50, 3]"), "expected 2 numbers, not [-200.0, 50.0, 3.0]"),
            (
                VIEWS.replace("sigma = 0.1\n", "") + "[[point]]\nat = [60, 15, 3]",
                "expected 2 numbers, not [60.0, 15.0, 3.0]",
            ),
            (format!("{VIEWS}moved = [0, 0]"), "expected 3 numbers, not [0.0, 0.0]"),
            (VIEWS.replace("left = 7\n", ""), "missing field `left`"),
            (VIEWS.replace("sigma = 0.1", "sigma = -0.1"), "sigma = -0.1"),
            (VIEWS.replace("sigma", "noise"), "unknown field `noise`"),
            (format!("{VIEWS}moved = [0, inf, 0]"), "cone 0 has a number"),
            (format!("{VIEWS}[[fence]]\nnormal = inf\noffset = 0"), "fence 0 has a number"),
            (VIEWS.to_owned() + "[[point]]\nat = [1, 2]", "[[point]] cannot be used with sigma"),
            (VIEWS.to_owned() + "[[point]]\nat = [1, 2]\nsigma = 0", "point 0: sigma = 0.0"),
            (VIEWS.to_owned() + "[[point]]\nat = [1, 2]\nsigma = 1\nnormal = 3", "give both or none"),
            (VIEWS.to_owned() + "[[free]]\ncentre = [1, 2]\nradius = -1", "free 0"),
            (VIEWS.replace("sigma = 0.1\n", "") + "[[point]]\nat = [1, 2]\nsigma = 1", "needs `sigma`"),
            (VIEWS.to_owned() + "[[point]]\nat = [1, 2]\n[[point]]\nat = [1, 2]\nsigma = 1", "point 0 has no `sigma`"),
            (VIEWS.replace("sigma = 0.1\n", "") + "[[point]]\nat = [1, nan]", "point 0 has a number"),
            ("unit = 'mm'".to_owned(), "at least one"),
        ];
        for (text, wanted) in bad {
            let message = Views::parse(&text).unwrap_err().to_string();
            assert!(message.contains(wanted), "wanted {wanted}, got {message}");
        }
        let parts = [
            (
                "ellipse = {a = 40, b = 25}\nvertices = [[0, 0], [10, 0], [0, 10]]",
                "give one of `vertices`, `ellipse` and `outline`",
            ),
            ("vertices = [[0, 0], [10, 0, 1], [0, 10]]", "expected 2 numbers, not [10.0, 0.0, 1.0]"),
            ("mu = 0.3", "give one of `vertices`, `ellipse` and `outline`"),
            ("ellipse = {a = 40, b = 0}", "must be finite and above 0"),
            ("ellipse = {a = 40, b = 25}\nrounding = 2", "needs `vertices`"),
            ("rounding = -2\nvertices = [[0, 0], [10, 0], [0, 10]]", "rounding = -2.0"),
        ];
        for (text, wanted) in parts {
            let message = NamedPart::parse("part", &format!("unit = 'mm'\n{text}"), false).unwrap_err().to_string();
            assert!(message.contains(wanted), "wanted {wanted}, got {message}");
        }
        let notched = "unit = 'mm'\nvertices = [[0, 0], [10, 0], [3, 3], [0, 10]]\nmu = 0.3";
        assert!(matches!(NamedPart::parse("part", notched, false), Err(ViewFileError::NotConvex(_))));
        assert_eq!(NamedPart::parse("part", notched, true).unwrap().convex.corners().len(), 3);
    }
}
