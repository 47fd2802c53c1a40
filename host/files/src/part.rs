//! The file in which a person describes a part: TOML, with the unit of its lengths.
//!
//! ```toml
//! unit = "mm"                                     # of every length below: m, cm, mm or in
//! vertices = [[0, 0], [90, 0], [90, 40], [30, 60]]    # counter-clockwise
//! mu = 0.25                                       # friction between part and table
//! mu_c = 0.3                                      # friction between part and finger (optional)
//! feet = [[5, 5, 1], [85, 5, 1], [45, 45, 2]]     # x, y, weight on it in any unit; else all of the base (optional)
//! centre_of_mass = [48, 25]                       # with radius_of_gyration; else those of a uniform plate (optional)
//! radius_of_gyration = 28                         # √(moment of inertia about the centre of mass / mass)
//! ```
//!
//! Where it is not known what a part stands on, the file lists what it may be instead of `feet`; `palpate which-part`
//! finds out:
//!
//! ```toml
//! [[support]]
//! name = "all of its base"
//! [[support]]
//! name = "three feet"
//! feet = [[5, 5, 1], [85, 5, 1], [45, 45, 2]]
//! ```
//!
//! Nothing of a part is known exactly. What is said of that widens what is told of its pose:
//!
//! ```toml
//! outline_sigma = 0.3           # standard deviation of each edge's line along its normal (optional)
//! centre_of_mass_sigma = 2      # of each coordinate (optional)
//! support = "unknown"           # it presses on the table anyhow, instead of uniformly (optional)
//! ```
//!
//! Instead of `vertices` the outline may be that of a file from CAD, next to this one: see [`crate::shapes`].
//!
//! ```toml
//! outline = "part.dxf"                            # or .svg; what is said of it goes into a table:
//! outline = {file = "part.stl", unit = "mm", height = 8}     # slice above the table, or shadow = true; up = "-z" lies on its back
//! outline = {file = "part.svg", unit = "mm", layer = "cut", curve_error = 0.02, holes = "fill"}
//! ```
//!
//! `unit` there is that of the file, needed where it does not say; chords of curves are off by `curve_error` at most (0.05 mm), and by
//! what they are off the `outline_sigma` is the more. A solid (STL) tells its centre of mass, radius of gyration and feet too, unless they
//! stand here.
//!
//! An elliptic part has, instead of `vertices`, `ellipse = {a = 40, b = 25}`: its semi-axes along x and y, its middle
//! at the origin.
//!
//! What cannot rest on a plane is refused; what can, but hardly lies on a table, is read and doubted ([`Doubt`]).
//!
//! Frames: the part's own, as its vertices are given. Units: SI once read.
//! Errors: [`PartFileError`] names the key, the value, the limit and what to do.

use nalgebra::Point2;
use palpate::geometry::{PolygonError, SimplePolygon, bounding_box, convex_hull, distance_to_segment};
use palpate::pushing::dynamics::support::SupportFriction;
use palpate::pushing::dynamics::{Body, Mass, Part};
use palpate::pushing::estimation::from_rest::PartErrors;
use serde::Deserialize;

use crate::shapes::{Drawn, Opener, OutlineKeys, ShapeError, Solid, closed};

/// A part that a person has described.
#[derive(Clone, Debug)]
pub struct PartFile {
    /// Outline, support and mass.
    pub part: DescribedPart,
    /// µ between part and table.
    pub mu: f64,
    /// µ_c between part and finger, if the file says.
    pub mu_c: Option<f64>,
    /// What is not known of the part.
    pub errors: PartErrors,
    /// The unit in which the person thinks.
    pub unit: Unit,
    /// What a file said of the outline, if one did.
    pub drawn: Option<FromDrawing>,
}

/// What a part file took from another.
#[derive(Clone, Debug, PartialEq)]
pub struct FromDrawing {
    /// Chords are no further from their curves, m.
    pub error: f64,
    /// What a solid told.
    pub solid: Option<Solid>,
}

/// A part with its outline.
#[derive(Clone, Debug)]
pub enum DescribedPart {
    /// Bounded by straight edges.
    Polygon(Part),
    /// Bounded by an ellipse about the part frame's origin.
    Ellipse {
        /// Along x and y, m.
        semi_axes: [f64; 2],
        /// What it rests on, and its mass.
        body: Body,
    },
}

/// Points in which an elliptic outline is drawn.
const OUTLINE_POINTS: u32 = 180;

/// An ellipse about the origin, point by point.
fn ellipse_outline([a, b]: [f64; 2]) -> Vec<Point2<f64>> {
    let at = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(OUTLINE_POINTS);
    (0..OUTLINE_POINTS).map(|i| Point2::new(a * at(i).cos(), b * at(i).sin())).collect()
}

impl DescribedPart {
    /// The part that a file draws, of uniform density where it is a drawing.
    ///
    /// # Errors
    /// [`PartFileError::TipsOver`] for a solid that does not stay as it lies.
    pub fn of_drawn(drawn: &Drawn, unit: Unit) -> Result<Self, PartFileError> {
        Keys::nothing(unit).drawn_polygon(drawn)
    }

    /// What is possible about the part, but rarely so.
    #[must_use]
    pub fn doubts(&self) -> Vec<Doubt> {
        doubts(&self.outline(), self.body(), 0.0, None)
    }

    /// What the part rests on, and its mass.
    #[must_use]
    pub fn body(&self) -> &Body {
        match self {
            Self::Polygon(part) => part.body(),
            Self::Ellipse { body, .. } => body,
        }
    }

    /// The centre of mass, part frame, m.
    #[must_use]
    pub fn centre_of_mass(&self) -> Point2<f64> {
        self.body().centre_of_mass()
    }

    /// Points of the outline in order, part frame, m: the vertices, or enough for a smooth picture.
    #[must_use]
    pub fn outline(&self) -> Vec<Point2<f64>> {
        match self {
            Self::Polygon(part) => part.polygon().vertices().to_vec(),
            Self::Ellipse { semi_axes, .. } => ellipse_outline(*semi_axes),
        }
    }

    /// The polygon, if it is one.
    #[must_use]
    pub fn polygon(&self) -> Option<&SimplePolygon> {
        match self {
            Self::Polygon(part) => Some(part.polygon()),
            Self::Ellipse { .. } => None,
        }
    }
}

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum Unit {
    /// Metre.
    #[serde(rename = "m")]
    Metre,
    /// Centimetre.
    #[serde(rename = "cm")]
    Centimetre,
    /// Millimetre.
    #[serde(rename = "mm")]
    Millimetre,
    /// Inch.
    #[serde(rename = "in")]
    Inch,
}

impl Unit {
    /// As files have it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
            Self::Inch => "in",
        }
    }

    /// Length of one unit, m.
    #[must_use]
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 1e-2,
            Self::Millimetre => 1e-3,
            Self::Inch => 0.0254,
        }
    }
}

/// So many numbers in a file; one too many is a mistake, not to be passed over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Numbers<const N: usize>(pub [f64; N]);

impl<'de, const N: usize> Deserialize<'de> for Numbers<N> {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let list = Vec::<f64>::deserialize(deserializer)?;
        let wrong = |list: Vec<f64>| serde::de::Error::custom(format!("expected {N} numbers, not {list:?}"));
        list.try_into().map(Self).map_err(wrong)
    }
}

/// The keys of the file, in its unit.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    unit: Unit,
    vertices: Option<Vec<Numbers<2>>>,
    ellipse: Option<SemiAxes>,
    outline: Option<OutlineKeys>,
    mu: f64,
    mu_c: Option<f64>,
    feet: Option<Vec<Numbers<3>>>,
    centre_of_mass: Option<Numbers<2>>,
    radius_of_gyration: Option<f64>,
    support: Option<SupportField>,
    outline_sigma: Option<f64>,
    centre_of_mass_sigma: Option<f64>,
}

/// The value of `support`.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "expected \"unknown\", or a list of [[support]], each with a name and maybe feet")]
enum SupportField {
    Unknown(Unknown),
    List(Vec<SupportKeys>),
}

/// The word for a support of which nothing is known.
#[derive(Clone, Copy, Debug, Deserialize)]
enum Unknown {
    #[serde(rename = "unknown")]
    Word,
}

/// What a part may stand on.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SupportKeys {
    name: String,
    feet: Option<Vec<Numbers<3>>>,
}

/// The value of `ellipse`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SemiAxes {
    a: f64,
    b: f64,
}

/// Why a file does not describe a part.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PartFileError {
    /// Not TOML, a key missing, unknown or of another type; the message shows the place.
    #[error("{0}")]
    Toml(String),
    /// The outline; coordinates are in the file's unit.
    #[error("vertices: {0}")]
    Outline(PolygonError),
    /// The file that draws the outline.
    #[error("outline: {0}")]
    Drawing(ShapeError),
    /// No outline, or two.
    #[error("the part has {what}: give one of `vertices`, `ellipse` and `outline`")]
    OneOutline {
        /// The outlines that it has, in words.
        what: &'static str,
    },
    /// An ellipse where edges are needed.
    #[error("the part is an ellipse, and this works on polygons only: describe it by `vertices`")]
    NotAPolygon,
    /// A semi-axis that cannot be.
    #[error("ellipse: {key} = {value:?} must be finite and above 0")]
    SemiAxis {
        /// Key of the semi-axis: `a` or `b`.
        key: &'static str,
        /// The length as given, in the unit of the file.
        value: f64,
    },
    /// A coefficient of friction that cannot be.
    #[error("{key} = {value:?}, but friction coefficients are finite and not negative: check its sign")]
    Friction {
        /// Key of the coefficient: `mu` or `mu_c`.
        key: &'static str,
        /// The coefficient as given.
        value: f64,
    },
    /// A coefficient of friction beyond all materials.
    #[error("{key} = {value:?}, but no two materials have more than {FRICTION_MAX}: is it in per cent, or an angle?")]
    FrictionTooLarge {
        /// Key of the coefficient: `mu` or `mu_c`.
        key: &'static str,
        /// The coefficient as given.
        value: f64,
    },
    /// A centre of mass beside what carries it.
    #[error(
        "the part tips over: its centre of mass, ({:.4}, {:.4}), is {beyond:.4} {unit} outside what it rests on, {rests_on}",
        .centre_of_mass[0], .centre_of_mass[1]
    )]
    TipsOver {
        /// As given or as it follows from the outline, in the unit of the file.
        centre_of_mass: [f64; 2],
        /// How far it is from the hull of what carries it, in the unit of the file.
        beyond: f64,
        /// The unit of the file.
        unit: &'static str,
        /// The feet or the base, in words.
        rests_on: &'static str,
    },
    /// A table without friction, where a part's resistance is to be felt.
    #[error("mu = 0, but a part is felt by how it resists a push: give the friction between part and table")]
    NothingResists,
    /// A support on feet without any foot.
    #[error("feet is empty: give at least one, or leave the key out for a base that bears everywhere")]
    NoFeet,
    /// A foot that cannot be.
    #[error("foot {index} is {foot:?}: its place must be finite and the weight on it above 0")]
    Foot {
        /// Place of the foot in the list, from 0.
        index: usize,
        /// Place in the unit of the file, and weight on it, as given.
        foot: [f64; 3],
    },
    /// Several supports where one is needed.
    #[error("the file lists {count} supports, where one is needed")]
    Supports {
        /// How many ways to support the part the file lists.
        count: usize,
    },
    /// A list without supports, or beside `feet`.
    #[error("{what}: give each thing that the part may stand on as a [[support]], and no `feet` beside them")]
    SupportList {
        /// What is wrong with the list, in words.
        what: &'static str,
    },
    /// A support of which nothing is known, with feet that are.
    #[error("support = \"unknown\" beside feet: leave one of them out")]
    UnknownFeet,
    /// A standard deviation that cannot be.
    #[error("{key} = {value:?} must be finite and not negative")]
    Deviation {
        /// Key of the standard deviation.
        key: &'static str,
        /// As given, in the unit of the file.
        value: f64,
    },
    /// A standard deviation of a part that would be another one.
    #[error(
        "{key} = {value:?} {unit} is more than a part of this size can be off, {limit:.3} {unit}: is it in the file's unit?"
    )]
    DeviationTooLarge {
        /// Key of the standard deviation.
        key: &'static str,
        /// As given, in the unit of the file.
        value: f64,
        /// The largest that is taken, in the same unit.
        limit: f64,
        /// That unit.
        unit: &'static str,
    },
    /// A support that cannot be.
    #[error("support {name:?}: {error}")]
    Support {
        /// Name of the support.
        name: String,
        /// What is wrong with it.
        error: Box<PartFileError>,
    },
    /// One of two keys that belong together.
    #[error("{given} needs {missing} beside it: give both, or neither for a plate of uniform density")]
    Alone {
        /// Key that the file has.
        given: &'static str,
        /// Not in the file.
        missing: &'static str,
    },
    /// A centre of mass that is no number.
    #[error("centre_of_mass = {value:?} must be finite")]
    CentreOfMass {
        /// The point as given, in the unit of the file.
        value: [f64; 2],
    },
    /// A radius of gyration that cannot be.
    #[error("radius_of_gyration = {value:?} must be finite and above 0")]
    RadiusOfGyration {
        /// The length as given, in the unit of the file.
        value: f64,
    },
}

/// Something about a described part that is possible, but rarely so on a table: a slip of the pen, mostly.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Doubt {
    /// Larger or smaller than what a finger pushes on a table.
    Size {
        /// Along the longer axis, m.
        extent: f64,
    },
    /// More friction than rubber has on a dry table.
    Friction {
        /// Key of the coefficient: `mu` or `mu_c`.
        key: &'static str,
        /// The coefficient.
        value: f64,
    },
    /// The mass lies further out than the outline.
    RadiusOfGyration {
        /// As given, m.
        radius: f64,
        /// From the centre of mass to the furthest point of the outline, m.
        reach: f64,
    },
    /// Weights on the feet that do not carry the part: at rest their middle lies under the centre of mass.
    Weights {
        /// How far it is from there, m.
        off: f64,
    },
}

/// What a finger pushes on a table is of this size, m.
const EXTENT_M: [f64; 2] = [5e-3, 1.0];

/// More friction than this needs rubber that is clean and dry.
const FRICTION_USUAL: f64 = 1.5;

/// Weights on the feet may have their middle so far from the centre of mass, as a share of the part's reach: they are
/// measured with kitchen scales.
const WEIGHTS_OFF: f64 = 0.1;

/// A centre of mass so far outside what carries the part, as a share of its reach, is within what feet are measured to.
const REST_SLACK: f64 = 0.01;

impl std::fmt::Display for Doubt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::Size { extent } => {
                write!(f, "the part is {} across: is its unit right?", length(extent))
            }
            Self::Friction { key, value } => {
                write!(f, "{key} = {value}: clean dry rubber has about 1; is it in per cent, or an angle?")
            }
            Self::RadiusOfGyration { radius, reach } => write!(
                f,
                "the radius of gyration is {}, but the outline reaches no further than {} from the centre of mass",
                length(radius),
                length(reach)
            ),
            Self::Weights { off } => write!(
                f,
                "the weights on the feet have their middle {} from the centre of mass, under which it lies at rest",
                length(off)
            ),
        }
    }
}

/// A length as people say it.
fn length(metres: f64) -> String {
    if metres >= 1.0 { format!("{metres:.3} m") } else { format!("{:.3} mm", metres * 1e3) }
}

/// What is doubtful about a part with this outline.
fn doubts(outline: &[Point2<f64>], body: &Body, mu: f64, mu_c: Option<f64>) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    let (low, high) = bounding_box(outline);
    let extent = (high - low).amax();
    if !(EXTENT_M[0]..=EXTENT_M[1]).contains(&extent) {
        doubts.push(Doubt::Size { extent });
    }
    let frictions = [("mu", Some(mu)), ("mu_c", mu_c)].into_iter().filter_map(|(key, value)| Some((key, value?)));
    doubts.extend(
        frictions.filter(|(_, value)| *value > FRICTION_USUAL).map(|(key, value)| Doubt::Friction { key, value }),
    );
    let (radius, reach) = (body.inertia_per_mass().sqrt(), reach(outline, body.centre_of_mass()));
    if radius > reach {
        doubts.push(Doubt::RadiusOfGyration { radius, reach });
    }
    if body.support().area().is_none() {
        // From the centre of mass.
        let off = body.support().centre_of_pressure().coords.norm();
        if off > WEIGHTS_OFF * reach {
            doubts.push(Doubt::Weights { off });
        }
    }
    doubts
}

/// From a point to the furthest of an outline, m.
fn reach(outline: &[Point2<f64>], from: Point2<f64>) -> f64 {
    outline.iter().map(|point| (point - from).norm()).fold(0.0, f64::max)
}

/// How far a point is outside the hull of others, m; 0 within.
fn beyond_hull(point: Point2<f64>, others: &[Point2<f64>]) -> f64 {
    let hull: Vec<_> = convex_hull(others).into_iter().map(|index| others[index]).collect();
    // One point has no hull.
    if let ([], Some(only)) = (hull.as_slice(), others.first()) {
        return (point - only).norm();
    }
    let edges = || hull.iter().zip(hull.iter().cycle().skip(1));
    if hull.len() > 2 && edges().all(|(a, b)| (b - a).perp(&(point - a)) >= 0.0) {
        return 0.0;
    }
    edges().map(|(a, b)| distance_to_segment(point, *a, *b)).fold(f64::INFINITY, f64::min)
}

impl PartFile {
    /// What is possible about the part, but rarely so.
    ///
    /// ```
    /// use palpate_files::part::{Doubt, PartFile};
    ///
    /// let block = PartFile::parse("unit = 'm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3")?;
    /// assert_eq!(block.doubts(), [Doubt::Size { extent: 60.0 }]); // m
    /// # Ok::<(), palpate_files::part::PartFileError>(())
    /// ```
    #[must_use]
    pub fn doubts(&self) -> Vec<Doubt> {
        doubts(&self.part.outline(), self.part.body(), self.mu, self.mu_c)
    }

    /// Reads the text of a file.
    ///
    /// ```
    /// use palpate_files::part::PartFile;
    ///
    /// let block = PartFile::parse("unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3")?;
    /// assert_eq!(block.part.outline().len(), 4);
    /// assert!((block.part.centre_of_mass().x - 0.03).abs() < 1e-12); // m
    /// # Ok::<(), palpate_files::part::PartFileError>(())
    /// ```
    ///
    /// # Errors
    /// [`PartFileError`] names the first thing found wrong.
    pub fn parse(text: &str) -> Result<Self, PartFileError> {
        Self::parse_beside(text, &closed)
    }

    /// Reads the text of a file that may name another, which is opened as it says.
    ///
    /// # Errors
    /// [`PartFileError`] names the first thing found wrong.
    pub fn parse_beside(text: &str, open: Opener<'_>) -> Result<Self, PartFileError> {
        let keys = Keys::parse(text)?;
        Self::of(&keys, keys.drawn(open)?.as_ref())
    }

    fn of(keys: &Keys, drawn: Option<&Drawn>) -> Result<Self, PartFileError> {
        if let Some(SupportField::List(supports)) = &keys.support {
            return Err(PartFileError::Supports { count: supports.len() });
        }
        let mu = friction("mu", keys.mu)?;
        let mu_c = keys.mu_c.map(|value| friction("mu_c", value)).transpose()?;
        let part = match (&keys.vertices, keys.ellipse, drawn) {
            (Some(vertices), None, None) => keys.polygon(vertices)?,
            (None, Some(semi_axes), None) => keys.ellipse(semi_axes)?,
            (None, None, Some(drawn)) => keys.drawn_polygon(drawn)?,
            (None, None, None) => return Err(PartFileError::OneOutline { what: "no outline" }),
            _ => return Err(PartFileError::OneOutline { what: "two outlines" }),
        };
        let errors = keys.errors(part.body().inertia_per_mass().sqrt(), drawn)?;
        let drawn = drawn.map(|drawn| FromDrawing { error: drawn.error, solid: drawn.solid.clone() });
        Ok(Self { part, mu, mu_c, errors, unit: keys.unit, drawn })
    }
}

/// A described part that friction holds: for what finds where it is touched by how it resists. A polygon, but where an
/// ellipse is asked for too.
#[derive(Clone, Debug)]
pub struct PolygonFile {
    /// Outline, support and mass.
    pub part: Part,
    /// µ between part and table.
    pub mu: f64,
    /// µ_c between part and finger, if the file says.
    pub mu_c: Option<f64>,
    /// What is not known of the part.
    pub errors: PartErrors,
    /// The unit in which the person thinks.
    pub unit: Unit,
}

impl PolygonFile {
    /// What is possible about the part, but rarely so.
    #[must_use]
    pub fn doubts(&self) -> Vec<Doubt> {
        doubts(self.part.polygon().vertices(), self.part.body(), self.mu, self.mu_c)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`PartFileError`], also for an elliptic part and for a µ of 0.
    pub fn parse(text: &str) -> Result<Self, PartFileError> {
        Self::parse_beside(text, &closed)
    }

    /// Reads the text of a file that may name another, which is opened as it says.
    ///
    /// # Errors
    /// [`PartFileError`], also for an elliptic part and for a µ of 0.
    pub fn parse_beside(text: &str, open: Opener<'_>) -> Result<Self, PartFileError> {
        Self::of(PartFile::parse_beside(text, open)?)
    }

    /// The same of an elliptic part too: for what asks [`Part::touched`] instead of edges.
    ///
    /// # Errors
    /// [`PartFileError`], also for a µ of 0.
    pub fn parse_curved(text: &str) -> Result<Self, PartFileError> {
        Self::parse_curved_beside(text, &closed)
    }

    /// The same of a file that may name another, which is opened as it says.
    ///
    /// # Errors
    /// As [`Self::parse_curved`].
    pub fn parse_curved_beside(text: &str, open: Opener<'_>) -> Result<Self, PartFileError> {
        Self::of_any(PartFile::parse_beside(text, open)?)
    }

    /// Reads the text of a file that may list several supports: the part on each, with the support's name. A file
    /// without such a list is one part, without a name.
    ///
    /// ```
    /// use palpate_files::part::PolygonFile;
    ///
    /// let text = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3
    /// [[support]]
    /// name = 'base'
    /// [[support]]
    /// name = 'feet'
    /// feet = [[5, 5, 1], [55, 5, 1], [30, 35, 1]]";
    /// let names: Vec<_> = PolygonFile::parse_supports(text)?.into_iter().map(|(name, _)| name).collect();
    /// assert_eq!(names, [Some("base".to_owned()), Some("feet".to_owned())]);
    /// # Ok::<(), palpate_files::part::PartFileError>(())
    /// ```
    ///
    /// # Errors
    /// [`PartFileError`], also for an elliptic part, a µ of 0 and an empty list.
    pub fn parse_supports(text: &str) -> Result<Vec<(Option<String>, Self)>, PartFileError> {
        Self::parse_supports_beside(text, &closed)
    }

    /// The same of a file that may name another, which is opened as it says.
    ///
    /// # Errors
    /// As [`Self::parse_supports`].
    pub fn parse_supports_beside(text: &str, open: Opener<'_>) -> Result<Vec<(Option<String>, Self)>, PartFileError> {
        let keys = Keys::parse(text)?;
        let drawn = keys.drawn(open)?;
        let Some(SupportField::List(supports)) = &keys.support else {
            return Ok(vec![(None, Self::of(PartFile::of(&keys, drawn.as_ref())?)?)]);
        };
        // The list says what it stands on, whatever a solid's lowest facets are.
        let drawn = drawn.map(|drawn| Drawn { solid: drawn.solid.map(|solid| Solid { feet: None, ..solid }), ..drawn });
        match (supports.is_empty(), &keys.feet) {
            (true, _) => return Err(PartFileError::SupportList { what: "support is empty" }),
            (_, Some(_)) => return Err(PartFileError::SupportList { what: "feet and supports" }),
            (false, None) => {}
        }
        let of = |support: &SupportKeys| {
            let one = Keys { feet: support.feet.clone(), support: None, ..keys.clone() };
            let file = PartFile::of(&one, drawn.as_ref()).and_then(Self::of).map_err(|error| match &support.feet {
                Some(_) => PartFileError::Support { name: support.name.clone(), error: Box::new(error) },
                None => error,
            })?;
            Ok((Some(support.name.clone()), file))
        };
        supports.iter().map(of).collect()
    }

    fn of(PartFile { part, mu, mu_c, errors, unit, .. }: PartFile) -> Result<Self, PartFileError> {
        match part {
            DescribedPart::Polygon(_) if mu == 0.0 => Err(PartFileError::NothingResists),
            DescribedPart::Polygon(part) => Ok(Self { part, mu, mu_c, errors, unit }),
            DescribedPart::Ellipse { .. } => Err(PartFileError::NotAPolygon),
        }
    }

    /// A part of any outline that has been described.
    fn of_any(PartFile { part, mu, mu_c, errors, unit, .. }: PartFile) -> Result<Self, PartFileError> {
        match part {
            _ if mu == 0.0 => Err(PartFileError::NothingResists),
            DescribedPart::Polygon(part) => Ok(Self { part, mu, mu_c, errors, unit }),
            DescribedPart::Ellipse { semi_axes, body } => {
                Ok(Self { part: Part::elliptic(semi_axes, body), mu, mu_c, errors, unit })
            }
        }
    }
}

fn friction(key: &'static str, value: f64) -> Result<f64, PartFileError> {
    match value {
        value if !(value.is_finite() && value >= 0.0) => Err(PartFileError::Friction { key, value }),
        value if value > FRICTION_MAX => Err(PartFileError::FrictionTooLarge { key, value }),
        value => Ok(value),
    }
}

/// Largest coefficient of friction that is taken: racing tyres on tarmac have 2, clean metals in vacuum more. What is
/// above is in per cent or in degrees.
pub const FRICTION_MAX: f64 = 10.0;

/// Largest standard deviation of an outline's edges, as a share of the part's radius of gyration: a part so far off is
/// another part.
const OUTLINE_SIGMA_MAX: f64 = 0.1;

/// The same of each coordinate of the centre of mass: a third of a plate's half length.
const CENTRE_OF_MASS_SIGMA_MAX: f64 = 0.5;

/// Feet in m with their shares of the weight.
fn shares(feet: &[Numbers<3>], metres: f64) -> Result<Vec<(Point2<f64>, f64)>, PartFileError> {
    if feet.is_empty() {
        return Err(PartFileError::NoFeet);
    }
    let possible = |Numbers(foot): &Numbers<3>| foot.iter().all(|value| value.is_finite()) && foot[2] > 0.0;
    if let Some(index) = feet.iter().position(|foot| !possible(foot)) {
        return Err(PartFileError::Foot { index, foot: feet[index].0 });
    }
    let weight: f64 = feet.iter().map(|Numbers([_, _, weight])| weight).sum();
    Ok(feet.iter().map(|&Numbers([x, y, share])| (Point2::new(x, y) * metres, share / weight)).collect())
}

impl Keys {
    /// A file in which nothing is said.
    fn nothing(unit: Unit) -> Self {
        Self {
            unit,
            vertices: None,
            ellipse: None,
            outline: None,
            mu: 0.0,
            mu_c: None,
            feet: None,
            centre_of_mass: None,
            radius_of_gyration: None,
            support: None,
            outline_sigma: None,
            centre_of_mass_sigma: None,
        }
    }

    fn parse(text: &str) -> Result<Self, PartFileError> {
        toml::from_str(text).map_err(|error| PartFileError::Toml(error.to_string()))
    }

    /// The outline from another file.
    fn drawn(&self, open: Opener<'_>) -> Result<Option<Drawn>, PartFileError> {
        let drawn = self.outline.as_ref().map(|outline| outline.draw(self.unit.metres(), open));
        drawn.transpose().map_err(PartFileError::Drawing)
    }

    /// What is said not to be known of a part with this radius of gyration, m. Chords count with what they are off at most
    /// as one standard deviation.
    fn errors(&self, radius_of_gyration: f64, drawn: Option<&Drawn>) -> Result<PartErrors, PartFileError> {
        let size = radius_of_gyration / self.unit.metres();
        let deviation = |key: &'static str, value: Option<f64>, share: f64| match value.unwrap_or(0.0) {
            value if !(value.is_finite() && value >= 0.0) => Err(PartFileError::Deviation { key, value }),
            value if value > share * size => {
                Err(PartFileError::DeviationTooLarge { key, value, limit: share * size, unit: self.unit.name() })
            }
            value => Ok(value * self.unit.metres()),
        };
        let is_unknown = matches!(self.support, Some(SupportField::Unknown(Unknown::Word)));
        if is_unknown && self.feet.is_some() {
            return Err(PartFileError::UnknownFeet);
        }
        Ok(PartErrors {
            outline_sigma: deviation("outline_sigma", self.outline_sigma, OUTLINE_SIGMA_MAX)?
                .hypot(drawn.map_or(0.0, |drawn| drawn.error)),
            mass_follows_outline: self.centre_of_mass.is_none() && drawn.is_none_or(|drawn| drawn.solid.is_none()),
            centre_of_mass_sigma: deviation(
                "centre_of_mass_sigma",
                self.centre_of_mass_sigma,
                CENTRE_OF_MASS_SIGMA_MAX,
            )?,
            pressure_log_sd: if is_unknown { PartErrors::PRESSURE_UNKNOWN } else { 0.0 },
        })
    }

    fn polygon(&self, vertices: &[Numbers<2>]) -> Result<DescribedPart, PartFileError> {
        let metres = self.unit.metres();
        // First as given, so that what is wrong is told in the file's unit.
        let scaled = |scale: f64| {
            let vertices: Vec<_> = vertices.iter().map(|vertex| Point2::from(vertex.0) * scale).collect();
            SimplePolygon::new(vertices).map_err(PartFileError::Outline)
        };
        scaled(1.0)?;
        self.bounded_by(scaled(metres)?, None)
    }

    /// What a file draws; what a solid tells beside its outline gives way to what is said here.
    fn drawn_polygon(&self, drawn: &Drawn) -> Result<DescribedPart, PartFileError> {
        self.bounded_by(drawn.outline.clone(), drawn.solid.as_ref())
    }

    fn bounded_by(&self, polygon: SimplePolygon, solid: Option<&Solid>) -> Result<DescribedPart, PartFileError> {
        let mass = self.mass(solid.map_or_else(|| Mass::uniform(&polygon), |solid| solid.mass))?;
        let own_feet = match (&self.feet, &self.support) {
            (None, None) => solid.and_then(|solid| solid.feet.clone()),
            _ => None,
        };
        self.rests(polygon.vertices(), own_feet.as_deref(), mass.centre_of_mass)?;
        Ok(DescribedPart::Polygon(match (&self.feet, own_feet) {
            (None, None) => Part::with_mass(polygon, mass),
            (None, Some(feet)) => Part::on_feet(polygon, &feet, mass),
            (Some(feet), _) => Part::on_feet(polygon, &shares(feet, self.unit.metres())?, mass),
        }))
    }

    fn ellipse(&self, SemiAxes { a, b }: SemiAxes) -> Result<DescribedPart, PartFileError> {
        for (key, value) in [("a", a), ("b", b)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(PartFileError::SemiAxis { key, value });
            }
        }
        let metres = self.unit.metres();
        let semi_axes = [a * metres, b * metres];
        let mass = self.mass(Mass::of_ellipse(semi_axes))?;
        self.rests(&ellipse_outline(semi_axes), None, mass.centre_of_mass)?;
        let body = match &self.feet {
            None => Body::uniform(SupportFriction::ellipse(semi_axes), mass),
            Some(feet) => Body::on_feet(&shares(feet, metres)?, mass),
        };
        Ok(DescribedPart::Ellipse { semi_axes, body })
    }

    /// Whether a part with this outline stays on what carries it: its centre of mass lies above.
    fn rests(
        &self,
        outline: &[Point2<f64>],
        own_feet: Option<&[(Point2<f64>, f64)]>,
        centre_of_mass: Point2<f64>,
    ) -> Result<(), PartFileError> {
        let metres = self.unit.metres();
        let own_feet = || own_feet.map(|feet| feet.iter().map(|(at, _)| *at).collect());
        let feet: Option<Vec<_>> = self
            .feet
            .as_ref()
            .map(|feet| feet.iter().map(|&Numbers([x, y, _])| Point2::new(x, y) * metres).collect())
            .or_else(own_feet);
        // Checked for what they are where they are read.
        let is_sound = |feet: &Vec<Numbers<3>>| {
            !feet.is_empty()
                && feet.iter().all(|Numbers([x, y, weight])| x.is_finite() && y.is_finite() && *weight > 0.0)
        };
        if self.feet.as_ref().is_some_and(|feet| !is_sound(feet)) {
            return Ok(());
        }
        let beyond = beyond_hull(centre_of_mass, feet.as_deref().unwrap_or(outline));
        if beyond <= REST_SLACK * reach(outline, centre_of_mass) {
            return Ok(());
        }
        Err(PartFileError::TipsOver {
            centre_of_mass: (centre_of_mass / metres).into(),
            beyond: beyond / metres,
            unit: self.unit.name(),
            rests_on: if feet.is_some() { "its feet" } else { "its base" },
        })
    }

    /// As given, or that of a uniform plate.
    fn mass(&self, uniform: Mass) -> Result<Mass, PartFileError> {
        let metres = self.unit.metres();
        let (centre, radius) = match (self.centre_of_mass, self.radius_of_gyration) {
            (None, None) => return Ok(uniform),
            (Some(Numbers(centre)), Some(radius)) => (centre, radius),
            (Some(_), None) => return Err(alone("centre_of_mass", "radius_of_gyration")),
            (None, Some(_)) => return Err(alone("radius_of_gyration", "centre_of_mass")),
        };
        if !centre.iter().all(|value| value.is_finite()) {
            return Err(PartFileError::CentreOfMass { value: centre });
        }
        if !(radius.is_finite() && radius > 0.0) {
            return Err(PartFileError::RadiusOfGyration { value: radius });
        }
        Ok(Mass { centre_of_mass: Point2::from(centre) * metres, inertia_per_mass: (radius * metres).powi(2) })
    }
}

fn alone(given: &'static str, missing: &'static str) -> PartFileError {
    PartFileError::Alone { given, missing }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLOCK: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3\n";

    /// Relative rounding of a few operations.
    const ROUNDING: f64 = 1e-12;

    #[test]
    fn units_change_nothing_but_the_numbers() {
        let areas = [("m", 1.0), ("cm", 1e-4), ("mm", 1e-6), ("in", 0.0254 * 0.0254)];
        for (unit, square) in areas {
            let file = PartFile::parse(&BLOCK.replace("mm", unit)).unwrap();
            let area = file.part.polygon().unwrap().area();
            assert!((area / (2400.0 * square) - 1.0).abs() < ROUNDING, "{unit}");
        }
    }

    #[test]
    fn without_more_keys_a_part_is_a_uniform_plate() {
        let PartFile { part, mu, mu_c, unit, errors, .. } = PartFile::parse(BLOCK).unwrap();
        assert_eq!(errors, PartErrors::NONE);
        assert_eq!((mu, mu_c, unit), (0.3, None, Unit::Millimetre));
        assert!((part.centre_of_mass() - Point2::new(0.03, 0.02)).norm() < ROUNDING);
        let inertia = (0.06_f64.powi(2) + 0.04_f64.powi(2)) / 12.0;
        assert!((part.body().inertia_per_mass() / inertia - 1.0).abs() < ROUNDING);
    }

    #[test]
    fn weights_on_feet_are_shares_whatever_their_unit() {
        for unit in [1.0, 250.0] {
            let feet = shares(&[Numbers([0.0, 0.0, unit]), Numbers([60.0, 10.0, 3.0 * unit])], 1e-3).unwrap();
            assert!((feet[0].1 - 0.25).abs() < ROUNDING && (feet[1].1 - 0.75).abs() < ROUNDING, "{feet:?}");
            assert!((feet[1].0 - Point2::new(0.06, 0.01)).norm() < ROUNDING, "{feet:?}");
        }
    }

    #[test]
    fn a_given_mass_is_taken_in_the_files_unit() {
        let text = format!("{BLOCK}centre_of_mass = [20, 10]\nradius_of_gyration = 25");
        let part = PartFile::parse(&text).unwrap().part;
        assert!((part.centre_of_mass() - Point2::new(0.02, 0.01)).norm() < ROUNDING);
        assert!((part.body().inertia_per_mass() / 0.025_f64.powi(2) - 1.0).abs() < ROUNDING);
    }

    #[test]
    fn an_ellipse_is_a_plate_with_a_smooth_outline() {
        let part = PartFile::parse("unit = 'mm'\nellipse = {a = 40, b = 30}\nmu = 0.3").unwrap().part;
        assert!((part.body().inertia_per_mass() / (0.05_f64.powi(2) / 4.0) - 1.0).abs() < ROUNDING);
        let on_it = |p: &Point2<f64>| ((p.x / 0.04).hypot(p.y / 0.03) - 1.0).abs() < ROUNDING;
        assert!(part.outline().iter().all(on_it) && part.polygon().is_none());
        let refused = PolygonFile::parse("unit = 'mm'\nellipse = {a = 40, b = 30}\nmu = 0.3").unwrap_err();
        assert_eq!(refused, PartFileError::NotAPolygon);
    }

    #[test]
    fn what_is_not_known_is_read_in_the_files_unit() {
        let text = format!("{BLOCK}outline_sigma = 0.3\ncentre_of_mass_sigma = 2\nsupport = 'unknown'");
        let errors = PolygonFile::parse(&text).unwrap().errors;
        assert!(
            (errors.outline_sigma - 3e-4).abs() < ROUNDING && (errors.centre_of_mass_sigma - 2e-3).abs() < ROUNDING
        );
        assert!(errors.mass_follows_outline && errors.pressure_log_sd == PartErrors::PRESSURE_UNKNOWN);
        let given = PartFile::parse(&format!("{BLOCK}centre_of_mass = [30, 20]\nradius_of_gyration = 20")).unwrap();
        assert!(!given.errors.mass_follows_outline);
        let refused = |more: &str| PartFile::parse(&format!("{BLOCK}{more}")).unwrap_err().to_string();
        assert!(refused("outline_sigma = -1").contains("outline_sigma = -1.0 must be finite and not negative"));
        // A tenth and half of √(60² + 40²)/√12 mm.
        assert!(refused("outline_sigma = 3").contains("outline_sigma = 3.0 mm is more than"));
        assert!(refused("outline_sigma = 3").contains("2.082 mm: is it in the file's unit?"));
        assert!(refused("centre_of_mass_sigma = 11").contains("10.408 mm"));
        assert!(refused("support = 'unknown'\nfeet = [[5, 5, 1], [55, 5, 1], [30, 35, 2]]").contains("leave one"));
        assert!(refused("support = 'anything'").contains("expected \"unknown\", or a list"));
    }

    #[test]
    fn every_support_of_a_list_is_a_part() {
        let list = format!(
            "{BLOCK}[[support]]\nname = 'base'\n[[support]]\nname = 'feet'\nfeet = [[5, 5, 1], [55, 5, 2], [30, 35, 3]]"
        );
        let listed = PolygonFile::parse_supports(&list).unwrap();
        let alone =
            PolygonFile::parse_supports(&format!("{BLOCK}feet = [[5, 5, 1], [55, 5, 2], [30, 35, 3]]")).unwrap();
        assert_eq!((listed.len(), alone.len()), (2, 1));
        assert_eq!(alone[0].0, None);
        // Turning about a foot, the other one alone resists: by its share of the weight.
        let resistance = |file: &PolygonFile| {
            let twist = palpate::pushing::dynamics::support::Twist::new(nalgebra::Vector2::new(0.02, -0.03), 1.0);
            format!("{:?}", file.part.body().support().mean_sliding(&twist))
        };
        assert_eq!(resistance(&listed[1].1), resistance(&alone[0].1));
        assert_ne!(resistance(&listed[0].1), resistance(&alone[0].1));
        let bad = [
            (list.replace("5, 2]", "5, -2]"), "support \"feet\": foot 1"),
            (format!("{BLOCK}support = []"), "support is empty"),
            (list.replace("mu = 0.3", "mu = 0.3\nfeet = [[1, 1, 1]]"), "feet and supports"),
        ];
        for (text, wanted) in bad {
            let message = PolygonFile::parse_supports(&text).unwrap_err().to_string();
            assert!(message.contains(wanted), "wanted {wanted}, got {message}");
        }
    }

    /// All feet in one corner, or a centre of mass beside the part: no push is needed to move it.
    #[test]
    fn a_part_that_cannot_rest_is_refused() {
        let tips = [
            ("feet = [[5, 5, 1], [10, 5, 1], [5, 10, 1]]", "its feet"),
            ("feet = [[5, 5, 1], [55, 5, 1]]", "15.0000 mm outside what it rests on, its feet"),
            ("centre_of_mass = [300, 20]\nradius_of_gyration = 20", "240.0000 mm outside what it rests on, its base"),
        ];
        for (keys, wanted) in tips {
            let message = PartFile::parse(&format!("{BLOCK}{keys}")).unwrap_err().to_string();
            assert!(message.contains("tips over") && message.contains(wanted), "wanted {wanted}, got {message}");
        }
        let ellipse =
            "unit = 'mm'\nmu = 0.3\nellipse = {a = 40, b = 30}\ncentre_of_mass = [0, 31]\nradius_of_gyration = 9";
        assert!(matches!(PartFile::parse(ellipse), Err(PartFileError::TipsOver { .. })));
        // On two feet in line with it, it can.
        assert!(PartFile::parse(&format!("{BLOCK}feet = [[5, 20, 1], [55, 20, 1]]")).is_ok());
    }

    #[test]
    fn what_hardly_lies_on_a_table_is_doubted_and_what_does_is_not() {
        let doubts = |text: &str| PartFile::parse(text).unwrap().doubts();
        assert_eq!(doubts(BLOCK), []);
        assert_eq!(doubts(&format!("{BLOCK}mu_c = 1\nfeet = [[5, 5, 1], [55, 5, 1], [30, 35, 2]]")), []);
        assert_eq!(doubts(&BLOCK.replace("mm", "m")), [Doubt::Size { extent: 60.0 }]);
        assert_eq!(doubts(&BLOCK.replace("0.3", "3")), [Doubt::Friction { key: "mu", value: 3.0 }]);
        let heavy = doubts(&format!("{BLOCK}feet = [[5, 5, 1], [55, 5, 1], [30, 35, 40]]"));
        assert!(matches!(heavy[..], [Doubt::Weights { off }] if off > 0.01), "{heavy:?}");
        let wide = doubts(&format!("{BLOCK}centre_of_mass = [30, 20]\nradius_of_gyration = 90"));
        assert!(matches!(wide[..], [Doubt::RadiusOfGyration { .. }]), "{wide:?}");
        let told: Vec<_> = [heavy, wide].concat().iter().map(ToString::to_string).collect();
        assert!(told[0].contains(" mm from the centre of mass") && told[1].contains("90.000 mm"), "{told:?}");
    }

    #[test]
    fn every_mistake_is_named_with_its_key() {
        let bad = [
            (BLOCK.replace("mu = 0.3", "mu = -0.3"), "mu = -0.3"),
            (format!("{BLOCK}mu_c = nan"), "mu_c = NaN"),
            (BLOCK.replace("mu = 0.3", "mu = 25"), "mu = 25.0, but no two materials have more than 10"),
            (format!("{BLOCK}mu_c = 1e300"), "mu_c = 1e300"),
            (BLOCK.replace("'mm'", "'furlong'"), "furlong"),
            (BLOCK.replace("unit = 'mm'\n", ""), "missing field `unit`"),
            (BLOCK.replace("[60, 40], [0, 40]", "[0, 40], [60, 40]"), "vertices: edge"),
            (BLOCK.replace("[60, 40]", "[60, 4e13]"), "the coordinate 40000000000000.0"),
            (BLOCK.replace("[60, 40]", "[60]"), "expected"),
            (format!("{BLOCK}ellipse = {{a = 40, b = 30}}"), "two outlines"),
            ("unit = 'mm'\nmu = 0.3".to_owned(), "no outline"),
            ("unit = 'mm'\nmu = 0.3\nellipse = {a = 40, b = -3}".to_owned(), "ellipse: b = -3.0"),
            (format!("{BLOCK}mass = 2"), "unknown field `mass`"),
            (format!("{BLOCK}feet = []"), "feet is empty"),
            (format!("{BLOCK}[[support]]\nname = 'base'"), "lists 1 supports"),
            (format!("{BLOCK}feet = [[1, 1, 1], [2, 2, -1]]"), "foot 1 is [2.0, 2.0, -1.0]"),
            (format!("{BLOCK}centre_of_mass = [1, 1]"), "centre_of_mass needs radius_of_gyration"),
            (format!("{BLOCK}radius_of_gyration = 1"), "radius_of_gyration needs centre_of_mass"),
            (format!("{BLOCK}centre_of_mass = [1, inf]\nradius_of_gyration = 1"), "must be finite"),
            (format!("{BLOCK}centre_of_mass = [1, 1]\nradius_of_gyration = 0"), "above 0"),
        ];
        for (text, wanted) in bad {
            let message = PartFile::parse(&text).unwrap_err().to_string();
            assert!(message.contains(wanted), "wanted {wanted}, got {message}");
        }
    }
}
