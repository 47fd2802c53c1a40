//! What every problem about a part and the finger that pushes it has in common.

use palpate::geometry::SimplePolygon;
use palpate::pushing::dynamics::{Finger as Disk, Mass, Part};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

use super::push::{Mode, Support};
use crate::solve::InvalidInput;
use crate::solve::fields::{FingerFields, NonNegative, Polygon, Positive, default_gravity, plane_friction};
use crate::solve::read::read_side_by_side;

/// The fields of a problem about a pushed part, all in one object: those that every such problem has, and its own.
#[derive(Clone, Debug, Serialize)]
pub struct Pushed<F> {
    /// The part, the plane under it, and the finger.
    #[serde(flatten)]
    pub setup: PushSetup,
    /// The problem's own fields.
    #[serde(flatten)]
    pub own: F,
}

/// A part on a plane, and a finger that pushes it.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct PushSetup {
    /// The part's outline.
    pub polygon: Polygon,
    /// Friction between part and plane.
    #[serde(deserialize_with = "plane_friction")]
    pub mu: NonNegative,
    /// Gravity, m/s².
    #[serde(default = "default_gravity")]
    pub g: NonNegative,
    /// What happens at the contact.
    pub mode: Mode,
    /// Friction between finger and part: required for `sliding` and `coulomb`; in `rolling` it bounds the force.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_c: Option<NonNegative>,
    /// The finger and its motion.
    pub finger: FingerFields,
    /// Where the weight rests; uniform over the polygon where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub support: Option<Support>,
    /// Part frame, m; the area centroid where not given. Together with `inertia_per_mass`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_of_mass: Option<[f64; 2]>,
    /// Moment of inertia about `centre_of_mass` over the mass, m².
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia_per_mass: Option<Positive>,
}

// By hand, because serde's own flattening loses the places of errors and does not know which fields there are.
impl<'de, F: DeserializeOwned> Deserialize<'de> for Pushed<F> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let (setup, own) = read_side_by_side(deserializer)?;
        Ok(Self { setup, own })
    }
}

/// The schema of the problem's own fields, with those of the setup among them.
impl<F: JsonSchema> JsonSchema for Pushed<F> {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        F::schema_name()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = F::json_schema(generator);
        let object = schema.ensure_object();
        let mut setup = PushSetup::json_schema(generator);
        for list in ["properties", "required"] {
            match (setup.remove(list), object.get_mut(list)) {
                (Some(Value::Object(shared)), Some(Value::Object(own))) => own.extend(shared),
                (Some(Value::Array(shared)), Some(Value::Array(own))) => own.extend(shared),
                _ => {}
            }
        }
        schema
    }
}

impl PushSetup {
    /// The part, or which field is missing.
    pub(super) fn part(&self) -> Result<Part, InvalidInput> {
        part((*self.polygon).clone(), self.centre_of_mass, self.inertia_per_mass, self.support.as_ref())
    }

    /// The finger's disk and its motion.
    pub(super) fn disk(&self) -> Disk {
        self.finger.disk()
    }

    /// Friction between part and plane times gravity, m/s².
    pub(super) fn mu_g(&self) -> f64 {
        self.mu.get() * self.g.get()
    }

    /// The friction of the contact where it is given.
    pub(super) fn contact_friction(&self) -> Option<f64> {
        self.mu_c.map(NonNegative::get)
    }

    /// The friction of the contact, for a mode that cannot do without.
    pub(super) fn needed_friction(&self) -> Result<f64, InvalidInput> {
        let missing =
            || InvalidInput::missing("mu_c", "the modes `sliding` and `coulomb` need the friction of the contact");
        self.contact_friction().ok_or_else(missing)
    }
}

/// A part of an outline, or which field is missing.
pub(super) fn part(
    polygon: SimplePolygon,
    centre_of_mass: Option<[f64; 2]>,
    inertia_per_mass: Option<Positive>,
    support: Option<&Support>,
) -> Result<Part, InvalidInput> {
    let mass = mass(Mass::uniform(&polygon), centre_of_mass, inertia_per_mass)?;
    Ok(match support {
        None => Part::with_mass(polygon, mass),
        Some(support) => Part::on_feet(polygon, &support.feet(), mass),
    })
}

/// Where a part's mass is, that of a uniform plate where not told, or which field is missing.
pub(super) fn mass(
    uniform: Mass,
    centre_of_mass: Option<[f64; 2]>,
    inertia_per_mass: Option<Positive>,
) -> Result<Mass, InvalidInput> {
    match (centre_of_mass, inertia_per_mass) {
        (None, None) => Ok(uniform),
        (Some(centre), Some(inertia)) => Ok(Mass { centre_of_mass: centre.into(), inertia_per_mass: inertia.get() }),
        (Some(_), None) => Err(InvalidInput::missing("inertia_per_mass", "`centre_of_mass` needs it")),
        (None, Some(_)) => Err(InvalidInput::missing("centre_of_mass", "`inertia_per_mass` needs it")),
    }
}
