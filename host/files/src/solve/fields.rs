//! Fields that several kinds of problem share, checked as they are read.
//!
//! Each type here can hold only what the interface allows, so a solver never checks it again. All serialize to
//! the form they are read from.
//!
//! Units: SI, radians. Frames: as named by the field that holds the value.
//! Errors: a value out of range is refused with [`InvalidInput`], which the frame reports with its place.

use std::ops::Deref;

use nalgebra::{Isometry2, Point2, Vector2};
use palpate::geometry::{PolygonError, SimplePolygon};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::pushing::dynamics::{Finger, FingerPath};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use super::error::{InvalidInput, Pointer};

/// What a `sigma` of 0 stands for, rad: exact data still need a scale to weigh their residuals by.
pub const SIGMA_LEAST: f64 = 1e-6;

/// The default of a field `g`: use with `#[serde(default = "default_gravity")]`.
#[must_use]
pub fn default_gravity() -> NonNegative {
    NonNegative(GRAVITY_ASSUMED)
}

/// Largest number of a field that has a sign only: no length, time or mass in SI units comes near it.
const NUMBER_MAX: f64 = 1e12;

/// Largest coefficient of friction between part and plane: ten times that of the stickiest rubber.
const FRICTION_MAX: f64 = 100.0;

/// How far a finger may go in a push, in sizes of the part: none that is felt lasts so long.
const TRAVEL_MAX: f64 = 100.0;

/// Refuses a push whose finger goes farther by a time (s) than could be followed; `size` of the part in m.
pub(super) fn check_travel(path: &FingerPath, time: f64, size: f64) -> Result<(), String> {
    check_gone((path.centre(time) - path.centre(0.0)).norm(), time, size)
}

/// The same for so long a way, m.
pub(super) fn check_gone(way: f64, time: f64, size: f64) -> Result<(), String> {
    let gone = way / size;
    // Written so that NaN is refused.
    if gone <= TRAVEL_MAX {
        return Ok(());
    }
    Err(format!(
        "at {time:?} s the finger has gone {gone:.0} sizes of the part, the limit is {TRAVEL_MAX}: check the units of time and of the finger's motion"
    ))
}

/// The largest distance of a vertex from the centroid, m.
pub(super) fn size(polygon: &SimplePolygon) -> f64 {
    let centroid = polygon.centroid();
    polygon.vertices().iter().map(|vertex| (vertex - centroid).norm()).fold(0.0, f64::max)
}

/// Reads the friction between part and plane: use with `#[serde(deserialize_with = "plane_friction")]`.
pub(super) fn plane_friction<'de, D: Deserializer<'de>>(deserializer: D) -> Result<NonNegative, D::Error> {
    let mu = NonNegative::deserialize(deserializer)?;
    let too_large = || InvalidInput::out_of_range(mu.get(), &format!("≤ {FRICTION_MAX}"), "check the coefficient");
    if mu.get() <= FRICTION_MAX { Ok(mu) } else { Err(D::Error::custom(too_large())) }
}

/// A type with one JSON form: its name, and the schema of that form.
macro_rules! schema {
    ($type:ident, $($schema:tt)+) => {
        schema!($type as stringify!($type), $($schema)+);
    };
    ($type:ident as $name:expr, $($schema:tt)+) => {
        impl JsonSchema for $type {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                $name.into()
            }

            fn json_schema(_generator: &mut SchemaGenerator) -> Schema {
                json_schema!($($schema)+)
            }
        }
    };
}

/// A finite number from 0: a coefficient of friction, a radius, gravity.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct NonNegative(f64);

schema!(NonNegative, {"type": "number", "minimum": 0});

impl NonNegative {
    /// A thousandth: a millimetre, where a length is meant.
    pub(super) const ONE_MILLI: Self = Self(1e-3);

    /// The number.
    #[must_use]
    pub fn get(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for NonNegative {
    type Error = InvalidInput;

    fn try_from(value: f64) -> Result<Self, InvalidInput> {
        if value > NUMBER_MAX {
            return Err(too_large(value));
        }
        let ok = value >= 0.0;
        // `-0.0` passes the comparison; adding zero drops its sign.
        if ok { Ok(Self(value + 0.0)) } else { Err(InvalidInput::out_of_range(value, "≥ 0", "check its sign")) }
    }
}

impl From<NonNegative> for f64 {
    fn from(NonNegative(value): NonNegative) -> Self {
        value
    }
}

fn too_large(value: f64) -> InvalidInput {
    InvalidInput::out_of_range(value, &format!("≤ {NUMBER_MAX:e}"), "check its unit")
}

/// A finite number above 0: a time step, a semi-axis.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Positive(f64);

schema!(Positive, {"type": "number", "exclusiveMinimum": 0});

impl Positive {
    /// Half a thousandth: half a millimetre, where a length is meant.
    pub(super) const HALF_A_MILLI: Self = Self(5e-4);

    /// The number.
    #[must_use]
    pub fn get(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for Positive {
    type Error = InvalidInput;

    fn try_from(value: f64) -> Result<Self, InvalidInput> {
        if value > NUMBER_MAX {
            return Err(too_large(value));
        }
        let ok = value > 0.0;
        if ok { Ok(Self(value)) } else { Err(InvalidInput::out_of_range(value, "> 0", "check its sign and unit")) }
    }
}

impl From<Positive> for f64 {
    fn from(Positive(value): Positive) -> Self {
        value
    }
}

/// Standard deviation of one measured angle, rad; 0 stands for [`SIGMA_LEAST`].
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(try_from = "NonNegative", into = "f64")]
pub struct Sigma(f64);

schema!(Sigma, {"type": "number", "minimum": 0});

impl Sigma {
    /// The standard deviation to compute with, rad: never 0.
    #[must_use]
    pub fn get(self) -> f64 {
        if self.0 == 0.0 { SIGMA_LEAST } else { self.0 }
    }
}

impl From<NonNegative> for Sigma {
    fn from(value: NonNegative) -> Self {
        Self(value.get())
    }
}

impl From<Sigma> for f64 {
    fn from(Sigma(value): Sigma) -> Self {
        value
    }
}

/// Instants at which to report, s: at least one, from 0, each after the one before.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<f64>", into = "Vec<f64>")]
pub struct Times(Vec<f64>);

schema!(Times, {"type": "array", "items": {"type": "number", "minimum": 0}, "minItems": 1});

impl Deref for Times {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.0
    }
}

impl TryFrom<Vec<f64>> for Times {
    type Error = InvalidInput;

    fn try_from(times: Vec<f64>) -> Result<Self, InvalidInput> {
        let Some(&first) = times.first() else {
            return Err(InvalidInput::new("is empty: give at least one time"));
        };
        NonNegative::try_from(first).map_err(|error| error.below(Pointer::default().index(0)))?;
        // Written so that NaN fails.
        let bad = (1..times.len()).find(|&i| !(times[i] > times[i - 1] && times[i].is_finite()));
        let Some(i) = bad else { return Ok(Self(times)) };
        let message =
            format!("{:?} s is not after the time before it, {:?} s: times must increase", times[i], times[i - 1]);
        Err(InvalidInput::at(Pointer::default().index(i), message))
    }
}

impl From<Times> for Vec<f64> {
    fn from(Times(times): Times) -> Self {
        times
    }
}

/// A part's outline `[[x,y],…]`, m, in the part's frame: simple, counter-clockwise, first vertex not repeated.
///
/// ```
/// use palpate_files::solve::fields::Polygon;
///
/// let block: Polygon = serde_json::from_str("[[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]]")?;
/// assert_eq!(block.vertices().len(), 4);
/// let error = serde_json::from_str::<Polygon>("[[0, 0], [0, 0.04], [0.06, 0.04], [0.06, 0]]").unwrap_err();
/// assert!(error.to_string().contains("clockwise"));
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[f64; 2]>", into = "Vec<[f64; 2]>")]
pub struct Polygon(SimplePolygon);

schema!(Polygon, {
    "description": "Outline in metres: simple, counter-clockwise, first vertex not repeated.",
    "type": "array",
    "items": {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2},
    "minItems": 3,
});

impl Deref for Polygon {
    type Target = SimplePolygon;

    fn deref(&self) -> &SimplePolygon {
        &self.0
    }
}

impl TryFrom<Vec<[f64; 2]>> for Polygon {
    type Error = InvalidInput;

    fn try_from(points: Vec<[f64; 2]>) -> Result<Self, InvalidInput> {
        let vertices: Vec<_> = points.into_iter().map(Point2::from).collect();
        Ok(Self(SimplePolygon::new(vertices)?))
    }
}

impl From<Polygon> for Vec<[f64; 2]> {
    fn from(Polygon(polygon): Polygon) -> Self {
        polygon.vertices().iter().map(|p| [p.x, p.y]).collect()
    }
}

impl From<PolygonError> for InvalidInput {
    fn from(error: PolygonError) -> Self {
        match error.vertex() {
            Some(vertex) => Self::at(Pointer::default().index(vertex), error.to_string()),
            None => Self::new(error.to_string()),
        }
    }
}

/// A pose `[x,y,theta]`, m and rad: `p_world = R(theta) p_part + (x, y)`, with `p_part` in the polygon's own frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "[f64; 3]", into = "[f64; 3]")]
pub struct PoseFields {
    /// The world's position of the part frame's origin, m.
    pub x: f64,
    /// As `x`, along the world's y, m.
    pub y: f64,
    /// The turn from world to part axes, counter-clockwise, rad; kept as given, not wrapped.
    pub theta: f64,
}

schema!(PoseFields as "Pose", {
    "description": "[x, y, theta] in metres and radians: p_world = R(theta) p_part + (x, y).",
    "type": "array",
    "items": {"type": "number"},
    "minItems": 3,
    "maxItems": 3,
});

impl PoseFields {
    /// The same as a transformation of points. It knows the turn only up to whole turns.
    #[must_use]
    pub fn world_from_part(self) -> Isometry2<f64> {
        Isometry2::new(Vector2::new(self.x, self.y), self.theta)
    }
}

impl From<[f64; 3]> for PoseFields {
    fn from([x, y, theta]: [f64; 3]) -> Self {
        Self { x, y, theta }
    }
}

impl From<PoseFields> for [f64; 3] {
    fn from(PoseFields { x, y, theta }: PoseFields) -> Self {
        [x, y, theta]
    }
}

/// A finger: a disk that translates on a parabola, `C(t) = centre0 + velocity0·t + acceleration·t²/2`, world axes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Finger")]
pub struct FingerFields {
    /// Radius of the disk, m.
    pub radius: NonNegative,
    /// Centre at t = 0, m.
    pub centre0: [f64; 2],
    /// Velocity at t = 0, m/s.
    pub velocity0: [f64; 2],
    /// Acceleration, constant, m/s².
    pub acceleration: [f64; 2],
}

impl FingerFields {
    /// The same as the science has it.
    #[must_use]
    pub(crate) fn disk(&self) -> Finger {
        Finger {
            radius: self.radius.get(),
            centre0: self.centre0.into(),
            velocity0: self.velocity0.into(),
            acceleration: self.acceleration.into(),
        }
    }

    /// The centre at time `t` (s), m.
    #[must_use]
    pub fn centre(&self, t: f64) -> Point2<f64> {
        let [c, v, a] = [self.centre0, self.velocity0, self.acceleration].map(Vector2::from);
        Point2::from(c + t * v + 0.5 * t * t * a)
    }

    /// The velocity at time `t` (s), m/s.
    #[must_use]
    pub fn velocity(&self, t: f64) -> Vector2<f64> {
        Vector2::from(self.velocity0) + t * Vector2::from(self.acceleration)
    }
}

#[cfg(test)]
mod tests {
    use serde::de::DeserializeOwned;
    use serde_json::{Value, json};

    use super::super::read::read;
    use super::*;

    fn refuse<T: DeserializeOwned + std::fmt::Debug>(value: Value) -> String {
        read::<T>(value).unwrap_err().to_string()
    }

    #[test]
    fn numbers_out_of_range_are_refused_with_their_limit() {
        assert_eq!(refuse::<NonNegative>(json!(-0.3)), "-0.3 is out of range, it must be ≥ 0: check its sign");
        assert_eq!(refuse::<Positive>(json!(0)), "0.0 is out of range, it must be > 0: check its sign and unit");
        assert_eq!(refuse::<Sigma>(json!(-1e-9)), "-1e-9 is out of range, it must be ≥ 0: check its sign");
        for value in [f64::NAN, f64::INFINITY] {
            assert!(NonNegative::try_from(value).is_err() && Positive::try_from(value).is_err());
        }
    }

    #[test]
    fn an_exact_angle_still_has_a_scale() {
        let sigma = |value: Value| read::<Sigma>(value).unwrap().get().to_bits();
        assert_eq!(sigma(json!(0)), SIGMA_LEAST.to_bits());
        assert_eq!(sigma(json!(0.002)), 0.002_f64.to_bits());
    }

    #[test]
    fn times_must_increase_from_zero() {
        assert_eq!(read::<Times>(json!([0, 0.5, 0.6])).unwrap().len(), 3);
        assert_eq!(refuse::<Times>(json!([])), "is empty: give at least one time");
        assert_eq!(refuse::<Times>(json!([-1, 2])), r#"at "/0": -1.0 is out of range, it must be ≥ 0: check its sign"#);
        let repeated = refuse::<Times>(json!([0, 0.5, 0.5]));
        assert_eq!(repeated, r#"at "/2": 0.5 s is not after the time before it, 0.5 s: times must increase"#);
        assert_eq!(refuse::<Times>(json!([0, "soon"])), r#"at "/1": got the string "soon", expected a finite number"#);
    }

    #[test]
    fn a_polygon_is_refused_at_its_vertex() {
        let spike = json!([[0, 0], [1, 0], [1, 1], [1, 2], [1, 1], [0, 1]]);
        let told = refuse::<Polygon>(spike);
        assert_eq!(told, r#"at "/3": the outline turns straight back at vertex 3 (a spike): remove the spike"#);
        assert!(refuse::<Polygon>(json!([[0, 0], [0, 1], [1, 0]])).contains("clockwise"));
    }

    #[test]
    fn what_is_read_is_written_the_same() {
        fn round<T: DeserializeOwned + Serialize>(value: Value) {
            assert_eq!(serde_json::to_value(read::<T>(value.clone()).unwrap()).unwrap(), value);
        }
        round::<Polygon>(json!([[0.0, 0.0], [1.0, 0.0], [0.5, 0.25]]));
        round::<PoseFields>(json!([0.1, -0.2, 7.5]));
        round::<Times>(json!([0.0, 0.1]));
        round::<Sigma>(json!(0.0));
        round::<FingerFields>(json!({
            "radius": 0.01, "centre0": [0.0, 1.0], "velocity0": [2.0, 3.0], "acceleration": [4.0, 5.0]
        }));
    }

    #[test]
    fn a_finger_moves_on_its_parabola() {
        let finger = FingerFields {
            radius: NonNegative(0.01),
            centre0: [0.1, 0.2],
            velocity0: [0.5, -0.25],
            acceleration: [2.0, 4.0],
        };
        assert_eq!(finger.centre(0.5), Point2::new(0.1 + 0.25 + 0.25, 0.2 - 0.125 + 0.5));
        assert_eq!(finger.velocity(0.5), Vector2::new(1.5, 1.75));
    }
}
