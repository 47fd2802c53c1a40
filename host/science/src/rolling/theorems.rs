//! The numbered results of thesis §7.2 on random bodies, contacts and turns: Propositions 25, 28 and 31, Lemmas 26, 27,
//! 29 and 30, and the sphere.
//!
//! Q and its kin are built here from their definitions (7.20), (7.21), differentiated by differences along the principal
//! curves, and held against the motion of the library. Derivatives are by arc length, so ‖β_s‖ = 1, and times the body's
//! size. The proofs are those of a body that is free to spin; of bodies of revolution and the sphere the tests say what
//! the thesis does not.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, UnitQuaternion, Vector2, Vector3};
use proptest::prelude::*;

use super::mechanics::ContactPointInertia;
use super::observability::{principal, sufficient_condition};
use super::tests::bodies;
use super::*;
use crate::gravity::GRAVITY_ASSUMED;

/// What fourth-order differences over [`STEP`] leave of derivatives, relative: 1e-12 of rounding over the step, and what
/// curvatures change within it.
const DIFFERENCES: f64 = 1e-6;

/// Step of the differences, rad of the normal.
const STEP: f64 = 3e-4;

/// Contacts where the radii of curvature are nearer to each other than this, relative, are left out: principal directions
/// turn fast there.
const NEAR_UMBILIC: f64 = 0.15;

/// One contact of a body: the frame (x, y, z) of (7.1), radii of curvature along x and y (m), β, D⁻¹ of (7.16).
#[derive(Clone, Copy, Debug)]
struct Contact {
    frame: Matrix3<f64>,
    radii: [f64; 2],
    beta: Vector3<f64>,
    inverse: Matrix3<f64>,
}

impl Contact {
    fn of(body: &RollingBody, normal: &Vector3<f64>) -> Self {
        let local = body.shape().local(normal, &Vector3::zeros());
        let ([x, y], radii) = principal(normal, &local.hessian);
        let inverse = ContactPointInertia::new(&body.inertia(), &local.contact).inverse();
        Self { frame: Matrix3::from_columns(&[x, y, *normal]), radii, beta: local.contact, inverse }
    }

    /// The contact where the normal has turned towards a principal direction, its frame that of the same curves.
    fn moved(&self, body: &RollingBody, axis: usize, angle: f64) -> Self {
        let normal = (self.frame.column(2) + self.frame.column(axis) * angle).normalize();
        let mut there = Self::of(body, &normal);
        if there.frame.column(0).dot(&self.frame.column(0)) < 0.0 {
            there.frame.column_mut(0).neg_mut();
            there.frame.column_mut(1).neg_mut();
        }
        there
    }

    fn is_near_umbilic(&self) -> bool {
        (self.radii[0] - self.radii[1]).abs() < NEAR_UMBILIC * self.radii[0]
    }

    /// S⁻¹(y, −x)ᵀ: of curvatures κ = −1/radius.
    fn front(&self) -> Matrix2x3<f64> {
        let [x, y] = [self.frame.column(0), self.frame.column(1)];
        Matrix2x3::from_rows(&[-y.transpose() * self.radii[0], x.transpose() * self.radii[1]])
    }

    /// (7.21).
    fn q(&self) -> Matrix2x3<f64> {
        self.front() * self.inverse * self.beta.cross_matrix() * self.frame
    }

    /// (7.20): Q_ψ.
    fn q_psi(&self, psi: f64) -> Matrix2x3<f64> {
        let [x, y, z] = [0, 1, 2].map(|column| self.frame.column(column).into_owned());
        let r = r_psi(psi);
        let palm = Matrix3::from_columns(&[x * r[(0, 0)] + y * r[(1, 0)], x * r[(0, 1)] + y * r[(1, 1)], -z]);
        r * self.front() * self.inverse * self.beta.cross_matrix() * palm
    }

    /// Q̄ before Lemma 29.
    fn q_bar(&self) -> Matrix2x3<f64> {
        let q = self.q();
        Matrix2::new(0.0, -1.0, 1.0, 0.0) * q + q.fixed_columns::<2>(0) * Matrix2x3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0)
    }

    /// A function of the contact by arc length along a principal curve.
    fn slope(&self, body: &RollingBody, axis: usize, of: impl Fn(&Self) -> Matrix2x3<f64>) -> Matrix2x3<f64> {
        let at = |steps: f64| of(&self.moved(body, axis, steps * STEP));
        ((at(1.0) - at(-1.0)) * 8.0 - (at(2.0) - at(-2.0))) / (12.0 * STEP * self.radii[axis])
    }

    /// The same along both.
    fn slopes(&self, body: &RollingBody, of: impl Fn(&Self) -> Matrix2x3<f64>) -> [Matrix2x3<f64>; 2] {
        [0, 1].map(|axis| self.slope(body, axis, &of) * body.size())
    }

    /// The state of a body that touches here, turned by ψ about the normal: (7.2).
    fn state(&self, psi: f64) -> RollState {
        let r = r_psi(psi);
        let turn = Matrix3::new(r[(0, 0)], r[(0, 1)], 0.0, r[(1, 0)], r[(1, 1)], 0.0, 0.0, 0.0, -1.0);
        let orientation = UnitQuaternion::from_matrix(&(turn * self.frame.transpose())).into_inner();
        RollState { orientation, omega: Vector3::zeros(), u: Vector2::zeros() }
    }
}

/// R_ψ of (7.2).
fn r_psi(psi: f64) -> Matrix2<f64> {
    Matrix2::new(psi.cos(), -psi.sin(), -psi.sin(), -psi.cos())
}

/// u̇ of a state by its angular velocity.
fn u_rate(model: &Model, state: &RollState, omega: Vector3<f64>) -> Vector2<f64> {
    model.rates(&RollState { omega, ..*state }, &Vector3::zeros()).u
}

/// Singular values of 2 × 3 matrices side by side as vectors of six, the largest first.
fn singular<const N: usize>(columns: [Matrix2x3<f64>; N]) -> Vec<f64> {
    let matrix = nalgebra::DMatrix::from_fn(6, N, |row, column| columns[column].as_slice()[row]);
    let mut values: Vec<f64> = matrix.singular_values().iter().copied().collect();
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

/// Bodies without symmetry of revolution: random ellipsoids, and one of each other kind.
fn any_body() -> impl Strategy<Value = RollingBody> {
    let ellipsoid = [0.02..0.026, 0.028..0.034, 0.036..0.05_f64];
    prop_oneof![
        3 => ellipsoid.prop_map(|axes| RollingBody::ellipsoid(axes).unwrap()),
        1 => (1..3_usize).prop_map(|kind| bodies()[kind].clone()),
    ]
}

fn direction() -> impl Strategy<Value = Vector3<f64>> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0_f64]
        .prop_map(Vector3::from)
        .prop_filter("a direction", |v| (0.2..1.0).contains(&v.norm()))
        .prop_map(|v| v.normalize())
}

/// A body and a contact away from its umbilics.
fn contacts() -> impl Strategy<Value = (RollingBody, Contact)> {
    (any_body(), direction())
        .prop_map(|(body, normal)| {
            let contact = Contact::of(&body, &normal);
            (body, contact)
        })
        .prop_filter("away from umbilics", |(_, contact)| !contact.is_near_umbilic())
}

/// A contact of no particular body: any β with β·z > 0, any inertia, any two radii.
fn free_contacts() -> impl Strategy<Value = Contact> {
    let inertia = [1e-4..6e-4, 1e-4..6e-4, 1e-4..6e-4_f64];
    (direction(), direction(), 0.01..0.04_f64, [0.01..0.05, 0.01..0.05_f64], inertia, direction()).prop_map(
        |(z, towards, length, radii, inertia, turn)| {
            let x = z.cross(&turn).normalize();
            let beta = (z * 1.2 + towards) * length;
            let attitude = UnitQuaternion::from_scaled_axis(turn * 2.0).to_rotation_matrix();
            let inertia = attitude.matrix() * Matrix3::from_diagonal(&inertia.into()) * attitude.matrix().transpose();
            let d = inertia + Matrix3::identity() * beta.norm_squared() - beta * beta.transpose();
            let frame = Matrix3::from_columns(&[x, z.cross(&x), z]);
            Contact { frame, radii, beta, inverse: d.try_inverse().unwrap() }
        },
    )
}

proptest! {
    /// Proposition 25 with its determinant −1/(K z₃): (7.19) eliminates ω₃.
    #[test]
    fn proposition_25_the_contacts_velocity_shows_the_angular_velocity((body, contact) in contacts(), psi in -3.0..3.0) {
        let (model, state) = (Model { body: &body, spin: Spin::Free }, contact.state(psi));
        let z = contact.frame.column(2);
        prop_assume!(z[2].abs() > 0.05);
        let columns = [[1.0, 0.0, -z[0] / z[2]], [0.0, 1.0, -z[1] / z[2]]].map(|omega| u_rate(&model, &state, omega.into()));
        let determinant = Matrix2::from_columns(&columns).determinant();
        let wanted = -contact.radii[0] * contact.radii[1] / z[2];
        prop_assert!((determinant / wanted - 1.0).abs() < 1e-9, "{determinant} {wanted}");
    }

    /// (7.20) is what the palm's acceleration does to that of the contact in the library's motion.
    #[test]
    fn q_psi_is_what_the_palm_does_to_the_contact((body, contact) in contacts(), psi in -3.0..3.0) {
        let (model, state) = (Model { body: &body, spin: Spin::Free }, contact.state(psi));
        let gravity = specific_force(Vector3::zeros(), GRAVITY_ASSUMED);
        let turn = |a: Vector3<f64>| model.rates(&state, &(gravity + a)).omega - model.rates(&state, &gravity).omega;
        let columns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|a| u_rate(&model, &state, turn(a)));
        let wanted = contact.q_psi(psi);
        prop_assert!((Matrix2x3::from_columns(&columns) - wanted).norm() < 1e-9 * (1.0 + wanted.norm()), "{columns:?} {wanted}");
    }

    /// Lemma 26, and more: the derivatives of Q_ψ and of Q are turned into each other, so they have the same singular
    /// values. Of a body of revolution both depend.
    #[test]
    fn lemma_26_q_psi_and_q_depend_alike((body, contact) in contacts(), psi in -3.0..3.0, waist in 0.02..0.026, length in 0.03..0.04, normal in direction()) {
        let spheroid = RollingBody::ellipsoid([waist, waist, length]).unwrap();
        let round = Contact::of(&spheroid, &normal);
        prop_assume!(!round.is_near_umbilic());
        for (body, contact, is_round) in [(&body, &contact, false), (&spheroid, &round, true)] {
            let [turned, plain] = [singular(contact.slopes(body, |at| at.q_psi(psi))), singular(contact.slopes(body, Contact::q))];
            for (a, b) in turned.iter().zip(&plain) {
                prop_assert!((a - b).abs() < DIFFERENCES * plain[0], "{turned:?} {plain:?}");
            }
            prop_assert!(!is_round || plain[1] < DIFFERENCES * plain[0], "{plain:?}");
        }
    }

    /// Lemma 27 as an equation: the determinant of the two vectors is det S⁻¹ det D⁻¹ · β·(Iz)/m · det(b₁, b₂, β), so it
    /// is 0 exactly if one of the last two is. b₁ and b₂ come from the library, the vectors from differences of Q.
    #[test]
    fn lemma_27_the_vectors_depend_exactly_where_one_of_two_terms_is_zero((body, contact) in contacts()) {
        let model = Model { body: &body, spin: Spin::Free };
        let condition = sufficient_condition(&model, &contact.state(0.0));
        let vectors = contact.slopes(&body, Contact::q).map(|slope| slope * contact.frame.transpose() * contact.beta);
        let got = Matrix2::from_columns(&vectors).determinant();
        // The condition's terms are over powers of the size L; slopes are times L.
        let size = body.size();
        let terms = condition.contact_and_inertia * condition.determinant.unwrap() * size.powi(3 + 1 + 2);
        let wanted = contact.radii[0] * contact.radii[1] * contact.inverse.determinant() * terms;
        let scale = vectors[0].norm() * vectors[1].norm() + size * size * DIFFERENCES;
        prop_assert!((got - wanted).abs() < 10.0 * DIFFERENCES * scale, "{got} {wanted} of {scale}");
    }

    /// Lemma 27's two cases by its right sides (7.26), (7.27): each term alone makes the vectors depend, and nothing else
    /// does.
    #[test]
    fn lemma_27_has_its_two_cases(contact in free_contacts(), b in [direction(), direction()], share in 0.1..0.9) {
        let vectors = |contact: &Contact, b: [Vector3<f64>; 2]| {
            b.map(|b| contact.front() * contact.inverse * contact.beta.cross(&b))
        };
        let dependence = |contact: &Contact, b: [Vector3<f64>; 2]| {
            let [v, w] = vectors(contact, b);
            Matrix2::from_columns(&[v, w]).determinant().abs() / (v.norm() * w.norm())
        };
        let z = contact.frame.column(2).into_owned();
        let d = contact.inverse.try_inverse().unwrap();
        let across = contact.beta.dot(&(d * z)).abs() / (contact.beta.norm() * (d * z).norm());
        let volume = Matrix3::from_columns(&[b[0], b[1], contact.beta.normalize()]).determinant().abs();
        prop_assume!(across > 0.01 && volume > 0.01);
        prop_assert!(dependence(&contact, b) > 1e-6);
        // det(b₁, b₂, β) = 0.
        let flat = [b[0], b[0] * share + contact.beta.normalize()];
        prop_assert!(dependence(&contact, flat) < 1e-9);
        // β·(Iz) = 0: no uniform body has it, but a D with Dz across β does.
        let wanted = d * z - contact.beta * (contact.beta.dot(&(d * z)) / contact.beta.norm_squared());
        let shift = wanted - d * z;
        let tilted = Contact { inverse: (d + shift * z.transpose() + z * shift.transpose() - z * z.dot(&shift) * z.transpose()).try_inverse().unwrap(), ..contact };
        prop_assert!(dependence(&tilted, b) < 1e-6, "{}", dependence(&tilted, b));
    }

    /// Proposition 28: where neither term is 0 the derivatives of Q_ψ by the place span its space. The area that they
    /// span is at least that of Lemma 27's vectors over |β|².
    #[test]
    fn proposition_28_the_palms_accelerations_show_the_place((body, contact) in contacts(), psi in -3.0..3.0) {
        let condition = sufficient_condition(&Model { body: &body, spin: Spin::Free }, &contact.state(psi));
        let terms = condition.contact_and_inertia * condition.determinant.unwrap();
        prop_assume!(terms.abs() > 1e-4);
        let area = singular(contact.slopes(&body, |at| at.q_psi(psi))).iter().product::<f64>();
        let lemma_27 = (contact.radii[0] * contact.radii[1] * contact.inverse.determinant() * terms).abs() * body.size().powi(6);
        let least = lemma_27 / contact.beta.norm_squared();
        prop_assert!(area > least * (1.0 - 1e-3), "{area} {least}");
    }

    /// "All but at most a one-dimensional set of contact points", says the text below Proposition 28. Of no body of
    /// revolution is it one: condition (2) fails everywhere, and the place does not show.
    #[test]
    fn proposition_28_says_nothing_of_bodies_of_revolution(waist in 0.02..0.026, length in 0.03..0.04, normal in direction(), psi in -3.0..3.0) {
        let body = RollingBody::ellipsoid([waist, waist, length]).unwrap();
        let contact = Contact::of(&body, &normal);
        prop_assume!(!contact.is_near_umbilic());
        let condition = sufficient_condition(&Model { body: &body, spin: Spin::Free }, &contact.state(psi));
        prop_assert!(condition.determinant.unwrap().abs() < 1e-9 && !condition.holds, "{condition:?}");
        let slopes = singular(contact.slopes(&body, |at| at.q_psi(psi)));
        prop_assert!(slopes[1] < DIFFERENCES * slopes[0], "{slopes:?}");
    }

    /// Lemma 29, and more: Q̄ is the derivative of Q_ψ by ψ turned, so the three have the same singular values.
    #[test]
    fn lemma_29_the_turn_adds_what_q_bar_adds((body, contact) in contacts(), psi in -3.0..3.0) {
        let at = |steps: f64| contact.q_psi(psi + steps * STEP);
        let by_psi = ((at(1.0) - at(-1.0)) * 8.0 - (at(2.0) - at(-2.0))) / (12.0 * STEP);
        let [a, b] = contact.slopes(&body, |at| at.q_psi(psi));
        let turned = singular([a, b, by_psi]);
        let [a, b] = contact.slopes(&body, Contact::q);
        let plain = singular([a, b, contact.q_bar()]);
        for (a, b) in turned.iter().zip(&plain) {
            prop_assert!((a - b).abs() < DIFFERENCES * plain[0], "{turned:?} {plain:?}");
        }
    }

    /// Lemma 30 with its converse: Q̄ is 0 exactly if β × z is 0 and (7.30) holds.
    #[test]
    fn lemma_30_q_bar_vanishes_only_under_three_conditions(contact in free_contacts(), moments in [2e-4..1e-3, 2e-4..1e-3_f64], mixed in 1e-5..1e-4) {
        let scale = |contact: &Contact| contact.q().norm();
        let z = contact.frame.column(2).into_owned();
        prop_assume!(contact.beta.cross(&z).norm() > 1e-3 * contact.beta.norm());
        // β × z is not 0: the third column is none.
        prop_assert!(contact.q_bar().column(2).norm() > 1e-6 * scale(&contact));
        // β × z = 0, and D along the principal directions.
        let above = |radii: [f64; 2], mixed: f64| {
            let d = Matrix3::new(moments[0], mixed, 0.0, mixed, moments[1], 0.0, 0.0, 0.0, 3e-4);
            let inverse = (contact.frame * d * contact.frame.transpose()).try_inverse().unwrap();
            Contact { beta: z * contact.beta.norm(), radii, inverse, ..contact }
        };
        // κ₁/D₁ = κ₂/D₂ with κ = −1/radius.
        let fit = [contact.radii[0], contact.radii[0] * moments[0] / moments[1]];
        let all = above(fit, 0.0);
        prop_assert!(all.q_bar().norm() < 1e-12 * scale(&all), "{}", all.q_bar());
        let mixed = above(fit, mixed);
        prop_assert!(mixed.q_bar().norm() > 1e-3 * scale(&mixed));
        let off = above([fit[0], fit[1] * 1.01], 0.0);
        prop_assert!(off.q_bar().norm() > 1e-3 * scale(&off));
    }

    /// "Hardly violated by any shape other than a sphere", says the text below Theorem 32 of (7.34): every uniform
    /// spheroid on its pole violates it, and no other uniform ellipsoid on a vertex does.
    #[test]
    fn lemma_30_has_the_poles_of_spheroids(axes in [0.02..0.03, 0.02..0.03, 0.02..0.04_f64]) {
        let size = |axes: [f64; 3]| {
            let body = RollingBody::ellipsoid(axes).unwrap();
            let contact = Contact::of(&body, &Vector3::z());
            contact.q_bar().norm() / contact.q().norm()
        };
        prop_assert!(size([axes[0], axes[0], axes[2]]) < 1e-12);
        prop_assume!((axes[0] / axes[1] - 1.0).abs() > 0.01);
        prop_assert!(size(axes) > 1e-3, "{}", size(axes));
    }

    /// Proposition 31 is a postulate. On bodies without symmetry the three derivatives are independent wherever
    /// Proposition 28's condition holds.
    #[test]
    fn proposition_31_the_palms_accelerations_show_place_and_turn((body, contact) in contacts(), psi in -3.0..3.0) {
        let condition = sufficient_condition(&Model { body: &body, spin: Spin::Free }, &contact.state(psi));
        prop_assume!((condition.contact_and_inertia * condition.determinant.unwrap()).abs() > 1e-3);
        let [a, b] = contact.slopes(&body, Contact::q);
        let values = singular([a, b, contact.q_bar()]);
        prop_assert!(values[2] > 10.0 * DIFFERENCES * values[0], "{values:?} {body:?} {contact:?}");
    }

    /// Theorem 32: where its condition holds, and not by a hair, the state is observable, for either kind of contact.
    #[test]
    fn theorem_32_where_its_condition_holds_the_state_is_observable(
        (body, contact) in contacts(), psi in -3.0..3.0, omega in [-6.0..6.0, -6.0..6.0, -6.0..6.0_f64],
    ) {
        for (spin, states) in [(Spin::Free, 8), (Spin::NoSpin, 7)] {
            let state = super::tests::state_of(spin, contact.state(psi).orientation.coords.into(), omega);
            let told = observability(&Model { body: &body, spin }, &state, GRAVITY_ASSUMED, Inputs::Generic).unwrap();
            let condition = told.sufficient_condition;
            prop_assume!((condition.contact_and_inertia * condition.determinant.unwrap()).abs() > 1e-4);
            prop_assert!(condition.holds);
            prop_assert_eq!(told.spectrum.rank(), states, "{:?} {:?}", spin, told.spectrum);
        }
    }

    /// The shape that is not observable: of a sphere Q is −5/7 (1, 0) wherever it touches, so neither place nor turn
    /// shows, whatever the palm does; four of the state's eight numbers are left.
    #[test]
    fn a_sphere_is_not_observable(radius in 0.01..0.05, normal in direction(), psi in -3.0..3.0, omega in [-8.0..8.0, -8.0..8.0, -8.0..8.0_f64]) {
        let body = RollingBody::ellipsoid([radius; 3]).unwrap();
        let contact = Contact::of(&body, &normal);
        let wanted = Matrix2x3::new(-1.0, 0.0, 0.0, 0.0, -1.0, 0.0) * (5.0 / 7.0);
        prop_assert!((contact.q() - wanted).norm() < 1e-12 && contact.q_bar().norm() < 1e-12, "{}", contact.q());
        let state = RollState { omega: omega.into(), ..contact.state(psi) };
        for (spin, unseen) in [(Spin::Free, 4), (Spin::NoSpin, 3)] {
            let state = super::tests::state_of(spin, state.orientation.coords.into(), state.omega.into());
            let told = observability(&Model { body: &body, spin }, &state, GRAVITY_ASSUMED, Inputs::Generic).unwrap();
            prop_assert_eq!(told.spectrum.unseen.len(), unseen);
        }
    }
}

/// The ten functions of Theorem 32 by the eight numbers of a state that may spin: u, u̇ and Q_ψ have rank 7 at most, for
/// none of them tells how fast the body spins about the normal.
#[test]
fn theorem_32s_ten_functions_do_not_show_spin() {
    let body = &bodies()[0];
    let contact = Contact::of(body, &Vector3::new(0.3, -0.5, 0.7).normalize());
    let (model, state) = (Model { body, spin: Spin::Free }, contact.state(0.4));
    let spin = contact.frame.column(2).into_owned();
    assert!(u_rate(&model, &state, spin).norm() < 1e-15);
    let gravity = specific_force(Vector3::zeros(), GRAVITY_ASSUMED);
    let palm = |omega: Vector3<f64>, a: Vector3<f64>| {
        let state = RollState { omega, ..state };
        model.rates(&state, &(gravity + a)).omega - model.rates(&state, &gravity).omega
    };
    for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
        assert!((palm(spin * 7.0, axis) - palm(Vector3::zeros(), axis)).norm() < 1e-9);
    }
}
