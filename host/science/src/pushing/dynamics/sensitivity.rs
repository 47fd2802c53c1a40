//! Derivatives of a push with respect to where it starts and what drives it.
//!
//! Parameters become jets, and the same formulas and steps then carry exact derivatives: those of the very numbers
//! computed, not approximations of them. Support friction enters by its own gradient in closed form.
//!
//! Assumes: the contact stays as it is; what ends it moves with the parameters and has no part in these derivatives.
//! Units: SI; derivatives in units of the state over units of the parameter. Errors: none.

use nalgebra::{SMatrix, Vector2};

use super::model::{ContactMode, Finger, PushModel, State};
use crate::math::Jet;

/// What a push can be derived by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// Contact angle at the start, rad.
    U,
    /// Contact on the edge at the start, m.
    S,
    /// Angular velocity at the start, rad/s.
    Omega,
    /// Velocity along the contact at the start, m/s.
    VT,
    /// µ g of the plane, m/s².
    MuG,
    /// µ_c of a sliding contact.
    ContactFriction,
    /// Velocity of the finger at t = 0 along world axis 0 or 1, m/s.
    FingerVelocity(usize),
    /// Acceleration of the finger along world axis 0 or 1, m/s².
    FingerAcceleration(usize),
}

/// A model, contact and start whose numbers carry derivatives.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::geometry::SimplePolygon;
/// use palpate::pushing::dynamics::{ContactMode, Finger, Parameter, Part, PushModel, Seeded, State, derivatives};
///
/// let block = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?;
/// let part = Part::uniform(block);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let model = PushModel { part: &part, edge: part.edge(0)?, mu_g: 0.3 * 9.81, finger };
/// let start = State { u: 1.6, s: 0.005, omega: 0.0, v_t: 0.0 };
/// let seeded = Seeded::new(&model, &ContactMode::Rolling, &start, [Parameter::S]);
/// let end = seeded.model.rollout(&seeded.contact, &seeded.start, 0.005).nth(99).unwrap(); // after 0.5 s
/// // Off the middle by a millimetre more, the block turns further.
/// assert!(derivatives(&end)[(0, 0)] * 1e-3 > 0.01); // rad
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Seeded<'p, const N: usize> {
    /// The model, whose parameters carry derivatives.
    pub model: PushModel<'p, Jet<N>>,
    /// The contact mode, whose friction carries derivatives.
    pub contact: ContactMode<Jet<N>>,
    /// State at t = 0, carrying its derivatives.
    pub start: State<Jet<N>>,
}

impl<'p, const N: usize> Seeded<'p, N> {
    /// Makes each of `parameters` a variable. Naming one that the contact does not depend on gives zeros.
    #[must_use]
    pub fn new(model: &PushModel<'p>, contact: &ContactMode, start: &State, parameters: [Parameter; N]) -> Self {
        // Derivative `row` is by parameter `row`; what is not asked for is a constant.
        let seed = |value: f64, parameter: Parameter| {
            let row = parameters.iter().position(|&wanted| wanted == parameter);
            row.map_or_else(|| Jet::constant(value), |row| Jet::variable(value, row))
        };
        let Finger { radius, centre0, velocity0, acceleration } = model.finger;
        let axes = |vector: Vector2<f64>, parameter: fn(usize) -> Parameter| {
            Vector2::from([0, 1].map(|axis| seed(vector[axis], parameter(axis))))
        };
        let finger = Finger {
            radius,
            centre0,
            velocity0: axes(velocity0, Parameter::FingerVelocity),
            acceleration: axes(acceleration, Parameter::FingerAcceleration),
        };
        let contact = contact.map(|friction| seed(friction, Parameter::ContactFriction));
        let start = State {
            u: seed(start.u, Parameter::U),
            s: seed(start.s, Parameter::S),
            omega: seed(start.omega, Parameter::Omega),
            v_t: seed(start.v_t, Parameter::VT),
        };
        Self {
            model: PushModel { part: model.part, edge: model.edge, mu_g: seed(model.mu_g, Parameter::MuG), finger },
            contact,
            start,
        }
    }
}

/// The derivatives that a state carries: rows u, s, ω, v_T; columns the parameters.
#[must_use]
pub fn derivatives<const N: usize>(state: &State<Jet<N>>) -> SMatrix<f64, 4, N> {
    let rows = [state.u, state.s, state.omega, state.v_t].map(|part| part.slopes);
    SMatrix::from_fn(|row, column| rows[row][column])
}
