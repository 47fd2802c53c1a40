//! Robust least squares over the finger's matrix, the offset and the loads that nobody knows.
//!
//! Model of contact `i`: `counts − tare = B · mᵢ · (−cos uᵢ, −sin uᵢ)`. Unknown are `B`, the offset (where contacts
//! have no tare of their own), and `mᵢ` where the load is unknown: one for each such contact, one for all loads called
//! the same. Gauss–Newton over all of them at once; the weights fall for contacts that lie further off than noise and
//! fixture explain, so one contact set wrong by 10° does not turn the finger.
//!
//! Why not [`math::least_squares`](crate::math::least_squares): its cost stays the same from step to step, while here
//! weights and scale are renewed at every one; and with no known load the size of `B` is free, and a solver that damps
//! a free direction neither fixes it nor gives a covariance. Here a Lagrange multiplier holds the mean load of the
//! fitted contacts at 1, and the same bordered matrix inverts to the covariance under that condition. The problem is
//! linear but for the products `B · m`, and the start is already robust, so a handful of plain steps suffices.
//!
//! Source: weights that redescend to zero: Hampel et al., "Robust Statistics" (1986), §2.6.
//! Assumes: noise of different dwells independent; contacts checked by `fit.rs`. Frames: finger. Units: scaled, so that
//! counts and loads are of order 1. Errors: no two axes, contacts that contradict each other, steps without end.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix2x4, Matrix6, Vector2};

use super::fit::{FitError, Quality};
use super::force::{DwellTare, ForceUnit};
use super::measurements::{CalibrationContact, Fixture, Load, Measurements};
use super::start;
use crate::math::angle::{contact_angle, push_direction};
use crate::math::statistics::median;

/// Variance of a value rounded to a whole code, counts²: no reading is known better, even one without any noise.
const ROUNDING_VARIANCE: f64 = 1.0 / 12.0;

/// Distance in standard deviations up to which a contact counts fully, for one and for two measured components.
///
/// Three contacts in a thousand lie beyond by chance, so good data keep the textbook covariance of least squares.
const FULL_WEIGHT_SIGMAS: [f64; 2] = [3.0, 3.44];

/// From this many times the above on, a contact counts nothing.
const NO_WEIGHT_RATIO: f64 = 2.5;

/// Median of χ² with one and two degrees of freedom, to turn a median distance into a scale.
const CHI2_MEDIAN: [f64; 2] = [0.4549, 1.3863];

/// Steps after which the robust scale is held, so that weights and scale cannot chase each other for ever.
const SCALE_FROZEN_AFTER: usize = 15;

/// Bound on the steps; good data take four to eight.
pub(super) const STEPS_MAX: usize = 100;

/// Step, relative to parameters of order 1, below which the fit has converged. Rounding leaves about 1e-14.
const STEP_CONVERGED: f64 = 1e-11;

/// Largest entry of a normal matrix times the same of its inverse; 1 for a diagonal one, without bound for a singular.
///
/// Data that span leave it below about a hundred; rounding alone turns an exactly singular matrix into some 1e15.
const SINGULAR: f64 = 1e10;

/// Size of the force of one observation, in units of the problem's load.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Magnitude {
    Known(f64),
    /// The unknown with this index among the magnitudes.
    Unknown(usize),
}

/// One measured pair of counts, scaled so that all numbers are of order 1. A tare is one with no force.
#[derive(Clone, Debug)]
struct Observation {
    /// Index of the contact, `None` for a tare of the session.
    contact: Option<usize>,
    counts: Vector2<f64>,
    noise: Matrix2<f64>,
    direction: Vector2<f64>,
    magnitude: Magnitude,
    /// Whether the session's offset is in it.
    has_offset: bool,
    /// Whether its magnitude serves no other observation, so that only the component across it measures anything.
    is_alone: bool,
    angle_sigma: f64,
    load_sigma: f64,
}

impl Observation {
    /// Components that measure the matrix.
    fn dimensions(&self) -> usize {
        if self.is_alone { 1 } else { 2 }
    }
}

/// The least-squares problem in scaled numbers.
#[derive(Clone, Debug)]
pub(super) struct Problem {
    observations: Vec<Observation>,
    pub(super) counts_scale: f64,
    pub(super) load_scale: f64,
    pub(super) reference_offset: Vector2<f64>,
    pub(super) has_offset: bool,
    magnitudes: usize,
    /// The load that all contacts called the same have.
    shared: Option<Magnitude>,
    pub(super) unit: ForceUnit,
}

/// The unknowns, in scaled numbers.
#[derive(Clone, Debug)]
pub(super) struct Unknowns {
    pub(super) matrix: Matrix2<f64>,
    pub(super) offset: Vector2<f64>,
    pub(super) magnitudes: DVector<f64>,
}

/// Where the steps came to rest.
#[derive(Clone, Debug)]
pub(super) struct Solution {
    pub(super) unknowns: Unknowns,
    /// Covariance of matrix and offset, scaled; the offset's part is zero if the problem has none.
    pub(super) covariance: Matrix6<f64>,
    pub(super) quality: Quality,
    /// Robust weight of each contact, `None` if held back.
    pub(super) weights: Vec<Option<f64>>,
    /// Distance of each contact in scaled standard deviations, `None` if held back.
    pub(super) sigmas: Vec<Option<f64>>,
}

impl Problem {
    pub(super) fn new(measurements: &Measurements, held_back: &[bool], fixture: &Fixture) -> Self {
        let fitted: Vec<usize> = (0..measurements.contacts.len()).filter(|&index| !held_back[index]).collect();
        let contacts: Vec<&CalibrationContact> = fitted.iter().map(|&index| &measurements.contacts[index]).collect();
        let sizes = contacts.iter().map(|contact| measurements.loaded_counts(contact).norm());
        let newtons = contacts
            .iter()
            .filter_map(|contact| if let Load::Newtons(newtons) = contact.load { Some(newtons) } else { None });
        let load = median(newtons);
        let mut problem = Self {
            observations: Vec::new(),
            counts_scale: median(sizes).filter(|&scale| scale > 0.0).unwrap_or(1.0),
            load_scale: load.unwrap_or(1.0),
            reference_offset: measurements.mean_tare_counts(),
            has_offset: contacts.iter().any(|contact| contact.tare.is_none()),
            magnitudes: 0,
            shared: None,
            unit: if load.is_some() { ForceUnit::Newton } else { ForceUnit::Relative },
        };
        problem.add_contacts(&fitted, measurements, fixture);
        if problem.has_offset {
            let tares: Vec<Observation> =
                measurements.tares.iter().map(|tare| problem.tare_observation(tare, fixture)).collect();
            problem.observations.extend(tares);
        }
        problem
    }

    fn add_contacts(&mut self, fitted: &[usize], measurements: &Measurements, fixture: &Fixture) {
        self.shared = self
            .shared_magnitude(fitted.iter().filter(|&&index| measurements.contacts[index].load == Load::Same).count());
        for &index in fitted {
            let contact = &measurements.contacts[index];
            let magnitude = match (contact.load, self.shared) {
                (Load::Newtons(newtons), _) => Magnitude::Known(newtons / self.load_scale),
                (Load::Same, Some(shared)) => shared,
                (Load::Same, None) | (Load::Unknown, _) => self.new_magnitude(),
            };
            let observation = self.contact_observation(index, contact, magnitude, fixture);
            self.observations.push(observation);
        }
    }

    /// With no load known in newtons, the shared one is what forces are measured in. One contact shares with nobody.
    fn shared_magnitude(&mut self, sharing: usize) -> Option<Magnitude> {
        match (sharing, self.unit) {
            (0 | 1, _) => None,
            (_, ForceUnit::Relative) => Some(Magnitude::Known(1.0)),
            (_, ForceUnit::Newton) => Some(self.new_magnitude()),
        }
    }

    fn new_magnitude(&mut self) -> Magnitude {
        self.magnitudes += 1;
        Magnitude::Unknown(self.magnitudes - 1)
    }

    fn contact_observation(
        &self,
        index: usize,
        contact: &CalibrationContact,
        magnitude: Magnitude,
        fixture: &Fixture,
    ) -> Observation {
        let zero = contact.tare.map_or(self.reference_offset, |tare| tare.0.counts);
        let is_alone = matches!(magnitude, Magnitude::Unknown(_)) && Some(magnitude) != self.shared;
        let tare_noise = contact.tare.map_or_else(Matrix2::zeros, |tare| tare.0.covariance);
        Observation {
            contact: Some(index),
            counts: (contact.reading.counts - zero) / self.counts_scale,
            noise: self.scaled_noise(contact.reading.covariance + tare_noise, fixture),
            direction: push_direction(contact.angle),
            magnitude,
            has_offset: contact.tare.is_none(),
            is_alone,
            angle_sigma: fixture.angle_sigma,
            load_sigma: if is_alone { 0.0 } else { fixture.load_sigma },
        }
    }

    fn tare_observation(&self, tare: &DwellTare, fixture: &Fixture) -> Observation {
        Observation {
            contact: None,
            counts: (tare.0.counts - self.reference_offset) / self.counts_scale,
            noise: self.scaled_noise(tare.0.covariance, fixture),
            direction: Vector2::zeros(),
            magnitude: Magnitude::Known(0.0),
            has_offset: true,
            is_alone: false,
            angle_sigma: 0.0,
            load_sigma: 0.0,
        }
    }

    fn scaled_noise(&self, covariance: Matrix2<f64>, fixture: &Fixture) -> Matrix2<f64> {
        let floor = ROUNDING_VARIANCE + fixture.drift_sigma.powi(2);
        (covariance + Matrix2::identity() * floor) / self.counts_scale.powi(2)
    }

    /// Number of matrix and offset entries among the unknowns; the magnitudes follow.
    fn leading(&self) -> usize {
        if self.has_offset { 6 } else { 4 }
    }

    /// Whether the mean load is held at 1 because nothing else fixes the size of the matrix.
    fn is_free_in_size(&self) -> bool {
        self.unit == ForceUnit::Relative && self.shared.is_none()
    }

    /// Unknowns that cost a degree of freedom. A magnitude that serves one contact costs the component it stands for.
    fn costly_unknowns(&self) -> usize {
        let alone = self.observations.iter().filter(|observation| observation.is_alone).count();
        self.leading() + self.magnitudes - alone - usize::from(self.is_free_in_size())
    }

    fn start(&self) -> Option<Unknowns> {
        let contacts: Vec<start::Observation> =
            self.observations.iter().filter(|o| o.contact.is_some()).map(Self::start_observation).collect();
        let inverse = start::robust_inverse(&contacts)?;
        let matrix = inverse.try_inverse()?;
        let mut magnitudes = DVector::from_element(self.magnitudes, 1.0);
        let mut collected: Vec<Vec<f64>> = vec![Vec::new(); self.magnitudes];
        for observation in &self.observations {
            if let Magnitude::Unknown(index) = observation.magnitude {
                collected[index].push(observation.direction.dot(&(inverse * observation.counts)));
            }
        }
        for (magnitude, values) in magnitudes.iter_mut().zip(collected) {
            *magnitude = median(values).unwrap_or(1.0);
        }
        Some(Unknowns { matrix, offset: Vector2::zeros(), magnitudes })
    }

    fn start_observation(observation: &Observation) -> start::Observation {
        let load = match observation.magnitude {
            Magnitude::Known(size) => Load::Newtons(size),
            Magnitude::Unknown(_) if observation.is_alone => Load::Unknown,
            Magnitude::Unknown(_) => Load::Same,
        };
        start::Observation { angle: contact_angle(observation.direction), load, counts: observation.counts }
    }
}

/// One observation against the present unknowns, whitened by noise and fixture.
struct Misfit {
    residual: Vector2<f64>,
    matrix_jacobian: Matrix2x4<f64>,
    offset_jacobian: Matrix2<f64>,
    magnitude_jacobian: Vector2<f64>,
}

impl Unknowns {
    /// A push cannot pull: a contact whose force points the wrong way is compared with no force at all.
    fn size(&self, observation: &Observation) -> f64 {
        match observation.magnitude {
            Magnitude::Known(size) => size,
            Magnitude::Unknown(index) => self.magnitudes[index].max(0.0),
        }
    }

    fn misfit(&self, observation: &Observation) -> Misfit {
        let force = observation.direction * self.size(observation);
        let offset = if observation.has_offset { 1.0 } else { 0.0 };
        let residual = observation.counts - self.matrix * force - self.offset * offset;
        let whiten = whitening(&self.covariance(observation));
        let pushes = !matches!(observation.magnitude, Magnitude::Unknown(index) if self.magnitudes[index] <= 0.0);
        Misfit {
            residual: whiten * residual,
            matrix_jacobian: whiten * Matrix2x4::new(force.x, force.y, 0.0, 0.0, 0.0, 0.0, force.x, force.y),
            offset_jacobian: whiten * offset,
            magnitude_jacobian: if pushes { whiten * self.matrix * observation.direction } else { Vector2::zeros() },
        }
    }

    /// Noise of the counts plus what the fixture's errors in angle and load turn into counts.
    fn covariance(&self, observation: &Observation) -> Matrix2<f64> {
        let along = self.matrix * observation.direction * self.size(observation);
        let across =
            self.matrix * Vector2::new(-observation.direction.y, observation.direction.x) * self.size(observation);
        let (angle, load) = (observation.angle_sigma.powi(2), observation.load_sigma.powi(2));
        observation.noise + across * across.transpose() * angle + along * along.transpose() * load
    }

    fn distances(&self, problem: &Problem) -> Vec<f64> {
        problem.observations.iter().map(|observation| self.misfit(observation).residual.norm()).collect()
    }

    /// Gives every magnitude that serves one contact its best value for the present matrix and offset.
    fn project_magnitudes(&mut self, problem: &Problem) {
        for observation in problem.observations.iter().filter(|observation| observation.is_alone) {
            let Magnitude::Unknown(index) = observation.magnitude else { continue };
            let whiten = whitening(&self.covariance(observation));
            let along = whiten * self.matrix * observation.direction;
            let offset = if observation.has_offset { self.offset } else { Vector2::zeros() };
            self.magnitudes[index] = along.dot(&(whiten * (observation.counts - offset))) / along.norm_squared();
        }
    }
}

/// `W` with `Wᵀ W = Σ⁻¹`.
fn whitening(covariance: &Matrix2<f64>) -> Matrix2<f64> {
    let lower = covariance.cholesky().map(|factor| factor.l());
    // Positive definite by the rounding variance in every observation; only overflow could break it.
    lower.and_then(|lower| lower.try_inverse()).unwrap_or_else(|| Matrix2::from_element(f64::NAN))
}

/// 1 up to three standard deviations, then falling in a straight line of influence to 0.
fn robust_weight(distance: f64, dimensions: usize) -> f64 {
    let full = FULL_WEIGHT_SIGMAS[dimensions - 1];
    let none = full * NO_WEIGHT_RATIO;
    if distance <= full { 1.0 } else { (full / distance * (none - distance) / (none - full)).max(0.0) }
}

/// Typical distance over the one that noise and fixture explain, at least 1.
fn robust_scale(distances: &[f64], problem: &Problem) -> f64 {
    let normalised = problem
        .observations
        .iter()
        .zip(distances)
        .map(|(o, distance)| distance.powi(2) / CHI2_MEDIAN[o.dimensions() - 1]);
    let components: usize = problem.observations.iter().map(Observation::dimensions).sum();
    let free = components.saturating_sub(problem.costly_unknowns()).max(1);
    let small_sample = components as f64 / free as f64;
    median(normalised).map_or(1.0, |middle| (middle * small_sample).sqrt().max(1.0))
}

/// Gauss–Newton with weights renewed at every step.
pub(super) fn solve(problem: &Problem) -> Result<Solution, FitError> {
    let mut unknowns = problem.start().ok_or(FitError::NoTwoAxes)?;
    let mut scale = 1.0;
    let mut last_step = f64::INFINITY;
    for step in 1..=STEPS_MAX {
        unknowns.project_magnitudes(problem);
        let distances = unknowns.distances(problem);
        if step <= SCALE_FROZEN_AFTER {
            scale = robust_scale(&distances, problem);
        }
        let weights = weights_of(problem, &distances, scale);
        let system = NormalSystem::new(problem, &unknowns, &weights);
        let inverse = system.inverse().ok_or_else(|| undetermined(problem, &weights))?;
        last_step = system.take_step(&inverse, &mut unknowns);
        if !last_step.is_finite() {
            break;
        }
        if last_step < STEP_CONVERGED {
            return Ok(Solution::new(problem, unknowns, &inverse, Ending { scale, steps: step }));
        }
    }
    Err(FitError::NotConverged { last_step })
}

/// Why a normal system has no inverse although the directions span: the contacts that count do not.
fn undetermined(problem: &Problem, weights: &[f64]) -> FitError {
    let contacts = problem.observations.iter().zip(weights).filter_map(|(o, weight)| Some((o.contact? + 1, *weight)));
    let (counting, out): (Vec<_>, Vec<_>) = contacts.partition(|(_, weight)| *weight > 0.0);
    let named: Vec<String> = out.iter().map(|(number, _)| number.to_string()).collect();
    FitError::Disagree { outliers: out.len(), fitted: out.len() + counting.len(), named: named.join(", ") }
}

fn weights_of(problem: &Problem, distances: &[f64], scale: f64) -> Vec<f64> {
    problem
        .observations
        .iter()
        .zip(distances)
        .map(|(o, distance)| robust_weight(distance / scale, o.dimensions()))
        .collect()
}

/// Normal equations, bordered by the condition on the mean load where the size is free.
struct NormalSystem {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    leading: usize,
    magnitudes: usize,
}

impl NormalSystem {
    fn new(problem: &Problem, unknowns: &Unknowns, weights: &[f64]) -> Self {
        let leading = problem.leading();
        let count = leading + problem.magnitudes;
        let size = count + usize::from(problem.is_free_in_size());
        let mut system = Self {
            matrix: DMatrix::zeros(size, size),
            right: DVector::zeros(size),
            leading,
            magnitudes: problem.magnitudes,
        };
        for (observation, weight) in problem.observations.iter().zip(weights) {
            system.add(observation, &unknowns.misfit(observation), *weight, count);
        }
        system.hold_weightless(count);
        if problem.is_free_in_size() {
            system.add_size_condition(problem, unknowns, weights, count);
        }
        system
    }

    fn add(&mut self, observation: &Observation, misfit: &Misfit, weight: f64, count: usize) {
        let mut jacobian = DMatrix::zeros(2, count);
        jacobian.view_mut((0, 0), (2, 4)).copy_from(&misfit.matrix_jacobian);
        if observation.has_offset {
            jacobian.view_mut((0, 4), (2, 2)).copy_from(&misfit.offset_jacobian);
        }
        if let Magnitude::Unknown(index) = observation.magnitude {
            jacobian.set_column(self.leading + index, &misfit.magnitude_jacobian);
        }
        let mut block = self.matrix.view_mut((0, 0), (count, count));
        block.gemm_tr(weight, &jacobian, &jacobian, 1.0);
        self.right.rows_mut(0, count).gemv_tr(weight, &jacobian, &misfit.residual, 1.0);
    }

    /// A magnitude that only weightless contacts have stays where it is.
    fn hold_weightless(&mut self, count: usize) {
        for index in self.leading..count {
            if self.matrix[(index, index)] <= 0.0 {
                self.matrix[(index, index)] = 1.0;
            }
        }
    }

    /// `Σ wᵢ mᵢ = Σ wᵢ`: relative forces are measured in the mean load of the contacts that count.
    fn add_size_condition(&mut self, problem: &Problem, unknowns: &Unknowns, weights: &[f64], border: usize) {
        for (observation, weight) in problem.observations.iter().zip(weights) {
            if let Magnitude::Unknown(index) = observation.magnitude {
                self.matrix[(border, self.leading + index)] += weight;
                self.right[border] += weight * (1.0 - unknowns.magnitudes[index]);
            }
        }
        let row = self.matrix.row(border).transpose();
        self.matrix.set_column(border, &row);
    }

    /// `None` where the matrix is singular up to rounding.
    fn inverse(&self) -> Option<DMatrix<f64>> {
        let inverse = self.matrix.clone().try_inverse()?;
        // The weights of contacts differ by far more than the unknowns do, so each row is judged by its own size.
        let product = self.matrix.component_mul(&inverse.transpose()).row_sum();
        let largest = self.matrix.component_mul(&inverse.transpose()).amax();
        (product.iter().all(|entry| entry.is_finite()) && largest < SINGULAR).then_some(inverse)
    }

    /// Moves the unknowns and returns the largest change among matrix and offset.
    fn take_step(&self, inverse: &DMatrix<f64>, unknowns: &mut Unknowns) -> f64 {
        let step = inverse * &self.right;
        unknowns.matrix += Matrix2::new(step[0], step[1], step[2], step[3]);
        if self.leading == 6 {
            unknowns.offset += Vector2::new(step[4], step[5]);
        }
        unknowns.magnitudes += step.rows(self.leading, self.magnitudes);
        step.rows(0, self.leading).amax()
    }
}

/// How the steps ended.
struct Ending {
    scale: f64,
    steps: usize,
}

impl Solution {
    fn new(problem: &Problem, unknowns: Unknowns, inverse: &DMatrix<f64>, ending: Ending) -> Self {
        let distances = unknowns.distances(problem);
        let weights = weights_of(problem, &distances, ending.scale);
        let quality = quality(problem, &distances, &weights, ending);
        let inflation = if quality.degrees_of_freedom >= 1.0 { quality.reduced_chi2.max(1.0) } else { 1.0 };
        let mut covariance = Matrix6::zeros();
        let leading = problem.leading();
        covariance.view_mut((0, 0), (leading, leading)).copy_from(&inverse.view((0, 0), (leading, leading)));
        let contacts = 1 + problem.observations.iter().filter_map(|observation| observation.contact).max().unwrap_or(0);
        let mut solution = Self {
            unknowns,
            covariance: covariance * inflation,
            quality,
            weights: vec![None; contacts],
            sigmas: vec![None; contacts],
        };
        for ((observation, weight), distance) in problem.observations.iter().zip(weights).zip(distances) {
            if let Some(contact) = observation.contact {
                solution.weights[contact] = Some(weight);
                solution.sigmas[contact] = Some(distance / quality.robust_scale);
            }
        }
        solution
    }
}

impl Solution {
    /// The load that all contacts called the same have, in the unit of force.
    pub(super) fn shared_load(&self, problem: &Problem) -> Option<f64> {
        let size = match problem.shared? {
            Magnitude::Known(size) => size,
            Magnitude::Unknown(index) => self.unknowns.magnitudes[index],
        };
        Some(size * problem.load_scale)
    }
}

fn quality(problem: &Problem, distances: &[f64], weights: &[f64], ending: Ending) -> Quality {
    let mut chi2 = 0.0;
    let mut components = 0.0;
    for ((observation, distance), weight) in problem.observations.iter().zip(distances).zip(weights) {
        chi2 += weight * distance.powi(2);
        components += weight * if observation.is_alone { 1.0 } else { 2.0 };
    }
    let degrees_of_freedom = components - problem.costly_unknowns() as f64;
    let reduced_chi2 = if degrees_of_freedom >= 1.0 { chi2 / degrees_of_freedom } else { 1.0 };
    Quality { degrees_of_freedom, reduced_chi2, robust_scale: ending.scale, steps: ending.steps }
}
