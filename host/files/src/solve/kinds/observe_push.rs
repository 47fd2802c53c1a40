//! The kind `observe_push`: pose and motion of a pushed part from what the finger feels. See
//! [`palpate::pushing::estimation`].

use std::ops::RangeInclusive;

use palpate::pushing::dynamics::{ContactMode, Part, Slip, State};
use palpate::pushing::estimation::{
    self, Channel, Estimate, GhoBank, GhoRun, GhoSettings, Known, Measured, Observation, Prior as Belief, Touch,
};
use palpate::{Searched, Stop, never};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::push::Mode;
use super::pushed::Pushed;
use crate::solve::fields::{NonNegative, PoseFields, Positive, SIGMA_LEAST, Sigma, check_travel, size};
use crate::solve::{InvalidInput, Pointer, Problem, SolveError};

/// A push of which the contact was felt: where is the part, and how does it move at the end?
pub type ObservePush = Pushed<ObservePushFields>;

/// A push of which the contact was felt: where is the part, and how does it move at the end?
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "ObservePush")]
pub struct ObservePushFields {
    /// Time from one value to the next, s; the first is at t = 0.
    pub dt: Positive,
    /// Polar angles of the contact seen from the disk's centre, rad. Whole turns between one and the next do not count.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_angle: Option<Vec<f64>>,
    /// Instead of `contact_angle`: world angles of the force on the part, rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force_direction: Option<Vec<f64>>,
    /// Instead of `contact_angle`: magnitudes of the force over the part's mass, m/s².
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force_magnitude: Option<Vec<Positive>>,
    /// Standard deviation of one angle; 0 means 1e-6 rad. Required with `contact_angle` and `force_direction`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<Sigma>,
    /// Standard deviation of one magnitude's natural logarithm; 0 means 1e-6. Required with `force_magnitude`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_magnitude_log: Option<Sigma>,
    /// With `force_magnitude`: they are right but for a factor, since the part's mass or the force's unit is not known.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub mass_unknown: bool,
    /// Where the contact angle at t = 0 can be, rad; for force data. The full circle where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub u0_range: Option<[f64; 2]>,
    /// What is known of the motion at t = 0. Where not given, |omega| ≤ 10 rad/s and |vT| ≤ 0.2 m/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<PriorFields>,
    /// Standard deviation of ln(mu): 0.2 where mu is known to a fifth. Each hypothesis then has the mu that explains the data best. Without
    /// it, mu is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_sigma_log: Option<Positive>,
    /// How the pose is estimated.
    #[serde(default)]
    pub method: Method,
    /// `gho` only: minus the poles of the observer, 1/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zeta: Option<Positive>,
    /// `gho` only: times for which the correction is on and off in turn, s; [0.06, 0.04] where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correction: Option<[NonNegative; 2]>,
    /// `gho` only: where the observer starts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_estimate: Option<InitialEstimate>,
}

/// How to estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Every explanation of the data, by simulation.
    #[default]
    Best,
    /// The observer of Gauthier, Hammouri and Othman, as in the thesis.
    Gho,
}

/// Standard deviations about zero of the motion at t = 0; what is not given is bounded instead.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Prior")]
pub struct PriorFields {
    /// Of the angular velocity, rad/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub omega0_sigma: Option<Positive>,
    /// m/s; where the contact does not roll.
    #[serde(default, rename = "vT0_sigma", skip_serializing_if = "Option::is_none")]
    pub v_t0_sigma: Option<Positive>,
}

/// Where an observer starts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitialEstimate {
    /// The edge in contact; one observer runs for each edge where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edge: Option<usize>,
    /// Contact angle at t = 0, rad.
    pub u: f64,
    /// Contact along the edge, m.
    pub s: f64,
    /// Angular velocity at t = 0, rad/s.
    pub omega: f64,
    /// Velocity of the centre of mass along T, m/s; where the contact does not roll.
    #[serde(default, rename = "vT", skip_serializing_if = "Option::is_none")]
    pub v_t: Option<f64>,
}

/// What the data say.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ObservePushAnswer {
    /// How many explanations there are.
    pub status: ObservePushStatus,
    /// The explanations, most probable first.
    pub hypotheses: Vec<PushHypothesisAnswer>,
    /// `best` only: how well the data fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit: Option<FitAnswer>,
    /// `best` only: values left out because no smooth motion passes through them, counted from 0; absent where there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub outliers: Vec<usize>,
    /// `gho` only: that of the first hypothesis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trace: Option<Vec<TracePoint>>,
}

/// How many explanations there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Status")]
pub enum ObservePushStatus {
    /// One.
    Unique,
    /// Several.
    Ambiguous,
    /// No pose and motion of this part explains the data.
    #[serde(rename = "none")]
    Unexplained,
}

/// Goodness of fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "Fit")]
pub struct FitAnswer {
    /// The least cost of anything that is physically possible; null where nothing is.
    pub cost: Option<f64>,
    /// Data and prior terms less fitted parameters, of the hypothesis with that cost.
    pub degrees_of_freedom: usize,
    /// The 99.9 % quantile of chi-square: a larger cost means that the model is wrong.
    pub cost_max: f64,
}

/// A pose and motion that explain the data, at the last value's time unless named otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "Hypothesis")]
pub struct PushHypothesisAnswer {
    /// The edge in contact.
    pub edge: usize,
    /// Contact along the edge at t = 0, m.
    pub s0: f64,
    /// Contact along the edge, m.
    pub s_end: f64,
    /// Contact angle, rad; continuous from the first value.
    pub u_end: f64,
    /// Angular velocity at the last value, rad/s.
    pub omega_end: f64,
    /// Velocity of the centre of mass along T, m/s.
    #[serde(rename = "vT_end")]
    pub v_t_end: f64,
    /// What the contact does.
    pub mode_end: Mode,
    /// The sign of the contact velocity (part − finger) along the edge where the contact slides, otherwise null.
    pub sliding_sign: Option<f64>,
    /// Of the polygon's own frame.
    pub pose_end: PoseFields,
    /// Velocity of the centre of mass, world axes, m/s, and angular velocity, rad/s.
    pub twist_end: [f64; 3],
    /// Of `pose_end`: x, y, theta; null where the data leave the pose free, and for `gho`.
    pub covariance: Option<[[f64; 3]; 3]>,
    /// Squared residuals in standard deviations, prior terms included.
    pub cost: f64,
    /// Among the listed ones, before the push every place of the perimeter being as likely; null for `gho`.
    pub probability: Option<f64>,
    /// Whether the data leave the pose free: this is one of a continuum.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub unobservable: bool,
    /// With `mu_sigma_log` in the problem: the friction between part and plane that goes with this explanation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mu: Option<f64>,
    /// Standard deviation of its natural logarithm; absent where the data leave the pose free.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mu_sigma_log: Option<f64>,
    /// `gho` only: the estimate in time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trace: Option<Vec<TracePoint>>,
}

/// An observer's estimate at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct TracePoint {
    /// Time since the push began, s.
    pub t: f64,
    /// Contact angle, rad.
    pub u: f64,
    /// Contact along the edge, m.
    pub s: f64,
    /// Angular velocity, rad/s.
    pub omega: f64,
    /// Velocity of the centre of mass along T, m/s.
    #[serde(rename = "vT")]
    pub v_t: f64,
}

impl Problem for ObservePush {
    const KIND: &'static str = "observe_push";
    type Answer = ObservePushAnswer;

    fn solve(&self) -> Result<ObservePushAnswer, SolveError> {
        Ok(self.solve_until(&never)?.found)
    }

    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<ObservePushAnswer>, SolveError> {
        let measured = self.measured()?;
        let part = self.setup.part()?;
        let known = self.known(&part)?;
        match self.own.method {
            Method::Best => self.best(&known, measured, stop),
            Method::Gho => self.gho(&known, stop),
        }
    }
}

/// Least standard deviation of the logarithm of µ: with less it is known.
const MU_SIGMA_LOG_MIN: f64 = 1e-12;

/// Why a field of `gho` is refused without it.
const FOR_GHO_ONLY: &str = "is for the method `gho` only: leave it out or set `method`";

impl ObservePush {
    fn best(
        &self,
        known: &Known,
        measured: Measured,
        stop: Stop<'_>,
    ) -> Result<Searched<ObservePushAnswer>, SolveError> {
        let gho_only = [
            ("zeta", self.own.zeta.is_some()),
            ("correction", self.own.correction.is_some()),
            ("initial_estimate", self.own.initial_estimate.is_some()),
        ];
        if let Some((field, _)) = gho_only.into_iter().find(|(_, given)| *given) {
            return Err(InvalidInput::at(field, FOR_GHO_ONLY).into());
        }
        let PriorFields { omega0_sigma, v_t0_sigma } = self.own.prior.unwrap_or_default();
        let prior = Belief {
            omega0_sigma: omega0_sigma.map(Positive::get),
            v_t0_sigma: v_t0_sigma.map(Positive::get),
            mu_g_log_sigma: self.mu_sigma_log()?,
        };
        let observation = Observation { dt: self.own.dt.get(), measured, prior };
        let duration = observation.dt * (observation.len().saturating_sub(1)) as f64;
        check_travel(&known.finger.path(), duration, size(&self.setup.polygon))
            .map_err(|message| InvalidInput::at("dt", message))?;
        let Searched { found: estimate, complete } = estimation::estimate_until(known, &observation, stop);
        if !complete && estimate.hypotheses.is_empty() {
            return Err(SolveError::Stopped);
        }
        let mut answer = ObservePushAnswer::from(&estimate);
        if self.own.mu_sigma_log.is_some() {
            for (hypothesis, found) in answer.hypotheses.iter_mut().zip(&estimate.hypotheses) {
                (hypothesis.mu, hypothesis.mu_sigma_log) = (Some(found.mu_g / self.setup.g.get()), found.mu_g_log_sd);
            }
        }
        if !complete {
            // What was not looked at may explain the data as well.
            answer.status = ObservePushStatus::Ambiguous;
        }
        Ok(Searched { found: answer, complete })
    }

    fn mu_sigma_log(&self) -> Result<Option<f64>, InvalidInput> {
        if self.own.mu_sigma_log.is_some() && self.setup.mu_g() <= 0.0 {
            let message = "says how well `mu` is known beside its size, but without friction it has none: give `mu` and `g` above 0";
            return Err(InvalidInput::at("mu_sigma_log", message));
        }
        if let Some(sigma) = self.own.mu_sigma_log.map(Positive::get).filter(|sigma| *sigma < MU_SIGMA_LOG_MIN) {
            let message = format!(
                "{sigma:e} is out of range, it must be at least {MU_SIGMA_LOG_MIN:e}: leave it out where `mu` is known"
            );
            return Err(InvalidInput::at("mu_sigma_log", message));
        }
        Ok(self.own.mu_sigma_log.map(Positive::get))
    }

    /// The thesis's observer: one for each edge and direction of slip that is not given.
    fn gho(&self, known: &Known, stop: Stop<'_>) -> Result<Searched<ObservePushAnswer>, SolveError> {
        let Some(angles) = &self.own.contact_angle else {
            return Err(InvalidInput::missing("contact_angle", "the method `gho` corrects by contact angles").into());
        };
        if self.own.mu_sigma_log.is_some() {
            return Err(InvalidInput::at(
                "mu_sigma_log",
                "is for the method `best` only: an observer takes mu as known",
            )
            .into());
        }
        let needs = |field: &str| InvalidInput::missing(field, "the method `gho` needs it");
        let zeta = self.own.zeta.ok_or_else(|| needs("zeta"))?.get();
        let start = self.own.initial_estimate.ok_or_else(|| needs("initial_estimate"))?;
        let mut settings = GhoSettings::new(zeta);
        if let Some(correction) = self.own.correction {
            [settings.correction_on, settings.correction_off] = correction.map(NonNegative::get);
        }
        let sigma = self.own.sigma.map_or(SIGMA_LEAST, Sigma::get);
        let measured = Measured::ContactAngle(Channel { values: angles.clone(), sigma });
        let observation = Observation { dt: self.own.dt.get(), measured, prior: Belief::default() };
        let contacts = self.gho_contacts(known)?;
        let edges = self.gho_edges(known.part)?.into_iter();
        let contacts: Vec<_> = edges.flat_map(|edge| contacts.iter().map(move |&on| (edge, on))).collect();
        let bank = GhoBank { known, contacts: &contacts, start: self.gho_start(start)?, settings };
        let Searched { found: runs, complete } = bank.runs_until(&observation, stop);
        let mut answer = ObservePushAnswer::of_gho(&bank, &runs, observation.dt);
        if !complete {
            if answer.hypotheses.is_empty() {
                return Err(SolveError::Stopped);
            }
            // What did not run may explain the data as well.
            answer.status = ObservePushStatus::Ambiguous;
        }
        Ok(Searched { found: answer, complete })
    }

    fn gho_contacts(&self, known: &Known) -> Result<Vec<ContactMode>, InvalidInput> {
        match known.touch {
            Touch::Frictionless => Ok(vec![ContactMode::Frictionless]),
            Touch::Rolling { .. } => Ok(vec![ContactMode::Rolling]),
            Touch::Sliding { friction } => {
                Ok([Slip::Forward, Slip::Backward].map(|slip| ContactMode::Sliding { friction, slip }).to_vec())
            }
            Touch::Coulomb { .. } => {
                let message = "the method `gho` follows one kind of contact: ask for `rolling` or `sliding`";
                Err(InvalidInput::at("mode", message))
            }
        }
    }

    fn gho_edges(&self, part: &Part) -> Result<Vec<usize>, InvalidInput> {
        let Some(edge) = self.own.initial_estimate.and_then(|estimate| estimate.edge) else {
            return Ok(part.sides().map(|(edge, _)| edge).collect());
        };
        let place = || Pointer::from("initial_estimate").key("edge");
        part.edge(edge).map_err(|error| InvalidInput::at(place(), error.to_string()))?;
        Ok(vec![edge])
    }

    /// Where the observers start. In rolling v_T follows from the rest, whatever is given.
    fn gho_start(&self, estimate: InitialEstimate) -> Result<State, InvalidInput> {
        let InitialEstimate { u, s, omega, v_t, .. } = estimate;
        match (self.setup.mode, v_t) {
            (Mode::Rolling, _) => Ok(State { u, s, omega, v_t: 0.0 }),
            (_, Some(v_t)) => Ok(State { u, s, omega, v_t }),
            (_, None) => {
                let place = Pointer::from("initial_estimate").key("vT");
                Err(InvalidInput::missing(place, "every mode but `rolling` needs it"))
            }
        }
    }

    fn known<'p>(&self, part: &'p Part) -> Result<Known<'p>, InvalidInput> {
        Ok(Known { part, mu_g: self.setup.mu_g(), finger: self.setup.disk(), touch: self.touch()? })
    }

    fn touch(&self) -> Result<Touch, InvalidInput> {
        Ok(match self.setup.mode {
            Mode::Frictionless => Touch::Frictionless,
            Mode::Rolling => Touch::Rolling { friction: self.setup.contact_friction() },
            Mode::Sliding => Touch::Sliding { friction: self.setup.needed_friction()? },
            Mode::Coulomb => Touch::Coulomb { friction: self.setup.needed_friction()? },
        })
    }

    /// The data, of one kind.
    fn measured(&self) -> Result<Measured, InvalidInput> {
        let ObservePushFields { contact_angle, force_direction, force_magnitude, .. } = &self.own;
        match (contact_angle, force_direction, force_magnitude) {
            (None, None, None) => Err(InvalidInput::missing(
                "contact_angle",
                "give `contact_angle`, or `force_direction` and/or `force_magnitude`",
            )),
            (Some(_), Some(_), _) => Err(InvalidInput::exclusive("contact_angle", "force_direction")),
            (Some(_), None, Some(_)) => Err(InvalidInput::exclusive("contact_angle", "force_magnitude")),
            (Some(angles), None, None) => self.angles(angles),
            (None, ..) => self.forces(),
        }
    }

    fn angles(&self, angles: &[f64]) -> Result<Measured, InvalidInput> {
        if self.own.u0_range.is_some() {
            let message = "is for force data: `contact_angle` already says where the contact is; leave it out";
            return Err(InvalidInput::at("u0_range", message));
        }
        if self.own.sigma_magnitude_log.is_some() {
            return Err(InvalidInput::at("sigma_magnitude_log", "is for `force_magnitude`: leave it out"));
        }
        if self.own.mass_unknown {
            return Err(InvalidInput::at("mass_unknown", "is for `force_magnitude`: leave it out"));
        }
        let sigma = self.sigma_of(self.own.sigma, "sigma", "contact_angle")?;
        Ok(Measured::ContactAngle(not_empty("contact_angle", Channel { values: angles.to_vec(), sigma })?))
    }

    fn forces(&self) -> Result<Measured, InvalidInput> {
        let direction = self.own.force_direction.as_ref().map(|values| {
            let sigma = self.sigma_of(self.own.sigma, "sigma", "force_direction")?;
            not_empty("force_direction", Channel { values: values.clone(), sigma })
        });
        let magnitude = self.own.force_magnitude.as_ref().map(|values| {
            let sigma = self.sigma_of(self.own.sigma_magnitude_log, "sigma_magnitude_log", "force_magnitude")?;
            let logarithms = values.iter().map(|value| value.get().ln()).collect();
            not_empty("force_magnitude", Channel { values: logarithms, sigma })
        });
        let (direction, magnitude) = (direction.transpose()?, magnitude.transpose()?);
        if let (Some(direction), Some(magnitude)) = (&direction, &magnitude) {
            same_length(direction, magnitude)?;
        }
        if self.own.mass_unknown && magnitude.is_none() {
            return Err(InvalidInput::at(
                "mass_unknown",
                "is for `force_magnitude`: directions do not depend on the mass; leave it out",
            ));
        }
        Ok(Measured::Force { direction, magnitude, u0_range: self.u0_range()?, mass_is_unknown: self.own.mass_unknown })
    }

    fn sigma_of(&self, sigma: Option<Sigma>, field: &str, data: &str) -> Result<f64, InvalidInput> {
        let missing = || InvalidInput::missing(field, &format!("`{data}` needs the standard deviation of a value"));
        // Finer than what counts as exact is exact.
        sigma.map(|sigma| sigma.get().max(SIGMA_LEAST)).ok_or_else(missing)
    }

    fn u0_range(&self) -> Result<Option<RangeInclusive<f64>>, InvalidInput> {
        match self.own.u0_range {
            Some([low, high]) if low > high => {
                let message = format!("runs from {low:?} down to {high:?} rad: give the lower limit first");
                Err(InvalidInput::at("u0_range", message))
            }
            range => Ok(range.map(|[low, high]| low..=high)),
        }
    }
}

fn not_empty(field: &str, channel: Channel) -> Result<Channel, InvalidInput> {
    if channel.values.is_empty() {
        return Err(InvalidInput::at(field, "is empty: give at least the value at t = 0"));
    }
    Ok(channel)
}

fn same_length(direction: &Channel, magnitude: &Channel) -> Result<(), InvalidInput> {
    let (angles, magnitudes) = (direction.values.len(), magnitude.values.len());
    if angles == magnitudes {
        return Ok(());
    }
    let message = format!("has {magnitudes} values, `force_direction` has {angles}: both need one each dt");
    Err(InvalidInput::at("force_magnitude", message))
}

impl ObservePushAnswer {
    /// Every observer that came to the end, best first, as a hypothesis; the first one's trace, even if none did.
    fn of_gho(bank: &GhoBank, runs: &[GhoRun], dt: f64) -> Self {
        let trace = |run: &GhoRun| {
            let at = |index: usize| dt * index as f64;
            run.trace.iter().enumerate().map(|(index, state)| TracePoint::of(at(index), state)).collect::<Vec<_>>()
        };
        let complete = runs.iter().filter(|run| run.cost.is_some());
        let hypothesis = |run: &GhoRun| {
            let mut hypothesis = PushHypothesisAnswer::from(&bank.hypothesis(run, dt)?);
            (hypothesis.probability, hypothesis.unobservable) = (None, false);
            hypothesis.trace = Some(trace(run));
            Some(hypothesis)
        };
        let hypotheses: Vec<_> = complete.filter_map(hypothesis).collect();
        Self {
            status: ObservePushStatus::of(hypotheses.len()),
            hypotheses,
            fit: None,
            outliers: Vec::new(),
            trace: runs.first().map(trace),
        }
    }
}

impl ObservePushStatus {
    fn of(explanations: usize) -> Self {
        match explanations {
            0 => Self::Unexplained,
            1 => Self::Unique,
            _ => Self::Ambiguous,
        }
    }
}

impl TracePoint {
    fn of(t: f64, &State { u, s, omega, v_t }: &State) -> Self {
        Self { t, u, s, omega, v_t }
    }
}

impl From<&Estimate> for ObservePushAnswer {
    fn from(estimate: &Estimate) -> Self {
        let status = ObservePushStatus::of(estimate.hypotheses.len());
        let estimation::Fit { cost, degrees_of_freedom, cost_max } = estimate.fit;
        Self {
            status,
            hypotheses: estimate.hypotheses.iter().map(PushHypothesisAnswer::from).collect(),
            fit: Some(FitAnswer { cost, degrees_of_freedom, cost_max }),
            outliers: estimate.outliers.clone(),
            trace: None,
        }
    }
}

impl From<&estimation::Hypothesis> for PushHypothesisAnswer {
    fn from(hypothesis: &estimation::Hypothesis) -> Self {
        let estimation::Hypothesis { edge, start, end, contact_end, pose_end, velocity_end, .. } = *hypothesis;
        let sliding_sign = match contact_end {
            ContactMode::Sliding { slip, .. } => Some(slip.sign()),
            ContactMode::Frictionless | ContactMode::Rolling => None,
        };
        Self {
            edge,
            s0: start.s,
            s_end: end.s,
            u_end: end.u,
            omega_end: end.omega,
            v_t_end: end.v_t,
            mode_end: contact_end.into(),
            sliding_sign,
            pose_end: PoseFields::from(<[f64; 3]>::from(pose_end)),
            twist_end: [velocity_end[0], velocity_end[1], end.omega],
            covariance: hypothesis.covariance.map(|covariance| covariance.transpose().into()),
            cost: hypothesis.cost,
            probability: Some(hypothesis.probability),
            unobservable: hypothesis.covariance.is_none(),
            mu: None,
            mu_sigma_log: None,
            trace: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    use serde_json::{Value, json};

    use super::*;
    use crate::solve::read;

    /// A block pushed up at its lower edge.
    fn problem() -> Value {
        json!({
            "polygon": [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]], "mu": 0.3, "mode": "rolling",
            "finger": {"radius": 0.01, "centre0": [0, 0], "velocity0": [0, 0.05], "acceleration": [0, 0]},
            "dt": 0.05, "contact_angle": [1.6, 1.605, 1.62, 1.64, 1.67], "sigma": 0.002,
        })
    }

    /// The same with fields changed; null leaves one out.
    fn changed(changes: &Value) -> Value {
        let mut problem = problem();
        for (key, value) in changes.as_object().unwrap() {
            match value {
                Value::Null => drop(problem.as_object_mut().unwrap().remove(key)),
                value => problem[key] = value.clone(),
            }
        }
        problem
    }

    fn solve(changes: &Value) -> ObservePushAnswer {
        read::<ObservePush>(changed(changes)).unwrap().solve().unwrap()
    }

    fn refuse(changes: &Value) -> String {
        let solved = read::<ObservePush>(changed(changes)).map_err(SolveError::from).and_then(|push| push.solve());
        match solved.unwrap_err() {
            SolveError::InvalidInput(error) => error.to_string(),
            other => panic!("{other}"),
        }
    }

    #[test]
    fn what_a_search_that_was_broken_off_found_is_never_the_only_one() {
        let problem = read::<ObservePush>(changed(&json!({}))).unwrap();
        let whole = problem.solve().unwrap();
        let all = AtomicUsize::new(0);
        problem.solve_until(&|| all.fetch_add(1, Relaxed) == usize::MAX).unwrap();
        let (all, mut broken_off) = (all.into_inner(), 0);
        // All over the search, and at each of the last questions.
        let steps = (0..60).map(|share| all * share / 60).chain(all.saturating_sub(60)..=all);
        for asks in steps {
            let asked = AtomicUsize::new(0);
            let stop = || asked.fetch_add(1, Relaxed) >= asks;
            match problem.solve_until(&stop) {
                Ok(Searched { found, complete: true }) => {
                    assert_eq!((found, asks), (whole.clone(), all));
                }
                Ok(Searched { found, complete: false }) => {
                    broken_off += 1;
                    assert_eq!(found.status, ObservePushStatus::Ambiguous);
                }
                Err(error) => assert_eq!(error, SolveError::Stopped),
            }
        }
        assert!(broken_off > 0);
    }

    #[test]
    fn every_mistake_has_a_message_and_a_place_of_its_own() {
        let forces = |extra: Value| {
            let mut force = json!({"contact_angle": null, "force_direction": [1.6, 1.6]});
            extra.as_object().unwrap().iter().for_each(|(key, value)| force[key] = value.clone());
            force
        };
        let cases = [
            (json!({"contact_angle": null}), "/contact_angle", "or `force_direction`"),
            (json!({"contact_angle": []}), "/contact_angle", "is empty"),
            (json!({"force_direction": [1.6]}), "/force_direction", "together with `contact_angle`"),
            (json!({"force_magnitude": [1.6]}), "/force_magnitude", "together with `contact_angle`"),
            (json!({"sigma": null}), "/sigma", "needs the standard deviation"),
            (json!({"sigma": -1}), "/sigma", "≥ 0"),
            (json!({"dt": 0}), "/dt", "> 0"),
            (json!({"dt": 5000}), "/dt", "sizes of the part"),
            (json!({"mu_sigma_log": 1e-150}), "/mu_sigma_log", "at least 1e-12"),
            (json!({"mode": "sliding"}), "/mu_c", "is missing"),
            (json!({"mode": "coulomb"}), "/mu_c", "is missing"),
            (json!({"u0_range": [0, 1]}), "/u0_range", "for force data"),
            (json!({"sigma_magnitude_log": 0.1}), "/sigma_magnitude_log", "for `force_magnitude`"),
            (json!({"mass_unknown": true}), "/mass_unknown", "for `force_magnitude`"),
            (forces(json!({"mass_unknown": true})), "/mass_unknown", "do not depend on the mass"),
            (json!({"zeta": 10}), "/zeta", "for the method `gho` only"),
            (json!({"prior": {"omega0_sigma": 0}}), "/prior/omega0_sigma", "> 0"),
            (json!({"mu_sigma_log": 0}), "/mu_sigma_log", "> 0"),
            (json!({"mu_sigma_log": 0.2, "mu": 0}), "/mu_sigma_log", "without friction"),
            (json!({"mu_sigma_log": 0.2, "method": "gho"}), "/mu_sigma_log", "takes mu as known"),
            (json!({"prior": {"omega_sigma": 1}}), "/prior/omega_sigma", "did you mean `omega0_sigma`"),
            (json!({"centre_of_mass": [0, 0]}), "/inertia_per_mass", "is missing"),
            (forces(json!({"force_direction": []})), "/force_direction", "is empty"),
            (forces(json!({"u0_range": [2, 1]})), "/u0_range", "lower limit first"),
            (forces(json!({"force_magnitude": [1.0, 1.0]})), "/sigma_magnitude_log", "is missing"),
            (
                forces(json!({"force_magnitude": [1.0], "sigma_magnitude_log": 0.01})),
                "/force_magnitude",
                "has 1 values",
            ),
            (forces(json!({"force_magnitude": [1.0, 0.0], "sigma_magnitude_log": 0.01})), "/force_magnitude/1", "> 0"),
        ];
        for (changes, place, message) in cases {
            let told = refuse(&changes);
            assert!(told.contains(&format!("{place:?}")) && told.contains(message), "{changes}: {told}");
        }
    }

    #[test]
    fn the_edges_of_a_symmetric_part_are_as_probable() {
        let answer = solve(&json!({}));
        assert_eq!(answer.status, ObservePushStatus::Ambiguous);
        let best = &answer.hypotheses[0];
        let twin = answer.hypotheses.iter().find(|other| other.edge == (best.edge + 2) % 4).unwrap();
        assert!((twin.s_end - best.s_end).abs() < 1e-6 && (twin.cost - best.cost).abs() < 1e-3, "{answer:?}");
        assert!((twin.probability.unwrap() / best.probability.unwrap() - 1.0).abs() < 1e-2, "{answer:?}");
        let all: f64 = answer.hypotheses.iter().filter_map(|hypothesis| hypothesis.probability).sum();
        assert!((all - 1.0).abs() < 1e-12);
    }

    #[test]
    fn whole_turns_in_the_angles_do_not_count() {
        let turned =
            json!({"contact_angle": [1.6, 1.605 + std::f64::consts::TAU, 1.62, 1.64 - std::f64::consts::TAU, 1.67]});
        let (plain, turned) = (solve(&json!({})), solve(&turned));
        assert_eq!(plain.hypotheses.len(), turned.hypotheses.len());
        // Twins of a symmetric part may change places by rounding.
        let same = |a: &PushHypothesisAnswer, b: &PushHypothesisAnswer| {
            a.edge == b.edge && (a.s_end - b.s_end).abs() < 1e-6 && (a.u_end - b.u_end).abs() < 1e-6
        };
        for a in &plain.hypotheses {
            assert!(turned.hypotheses.iter().any(|b| same(a, b)), "{a:?} not in {turned:?}");
        }
    }

    #[test]
    fn a_part_that_nothing_moves_can_be_anywhere() {
        let still = json!({"radius": 0.01, "centre0": [0, 0], "velocity0": [0, 0], "acceleration": [0, 0]});
        let answer = solve(&json!({"finger": still, "contact_angle": [1.6, 1.6, 1.6]}));
        assert_eq!(answer.hypotheses.len(), 4, "one for each edge: {answer:?}");
        assert!(answer.hypotheses.iter().all(|hypothesis| hypothesis.unobservable && hypothesis.covariance.is_none()));
    }

    #[test]
    fn the_best_explanation_is_found_where_a_part_could_also_seem_to_spin() {
        // Of each: which edge, the place at the start, m, and the cost, which a simulation of its own confirms.
        let pushes = [
            (
                json!({
                    "polygon": [[-0.01452, 0.02309], [0.00547, -0.0236], [0.03485, -0.03992], [0.0238, -0.0177]],
                    "finger": {"radius": 0.01, "centre0": [0, 0], "velocity0": [0, 0.05], "acceleration": [0, 0.025]},
                    "dt": 0.1, "sigma": 0.005, "prior": {"omega0_sigma": 0.5},
                    "contact_angle": [1.524, 1.399, 1.253, 1.104, 0.926, 0.746, 0.548],
                }),
                (2, -0.02472, 3.21),
            ),
            (
                json!({
                    "polygon": [[-0.026, -0.01123], [-0.01441, -0.03077], [0.00494, -0.0013], [0.00561, 0.02874]],
                    "finger": {"radius": 0.01, "centre0": [0, 0], "velocity0": [0, 0.05], "acceleration": [-0.08, 0]},
                    "dt": 0.12, "sigma": 0.005, "prior": {"omega0_sigma": 0.5},
                    "contact_angle": [1.683, 1.833, 1.99, 2.166, 2.354, 2.577],
                }),
                (2, 0.02709, 2.02),
            ),
        ];
        for (push, (edge, s0, cost)) in pushes {
            let answer = solve(&push);
            let found = answer.hypotheses.iter().find(|found| found.edge == edge && (found.s0 - s0).abs() < 1e-4);
            let found = found.unwrap_or_else(|| panic!("{:?}", answer.hypotheses));
            assert!((found.cost - cost).abs() < 0.02, "{found:?}");
        }
    }

    #[test]
    fn a_finger_that_moves_away_pushes_nothing() {
        let away = json!({"radius": 0.01, "centre0": [0, 0], "velocity0": [0, -0.05], "acceleration": [0, 0]});
        let answer = solve(&json!({"finger": away}));
        assert!(answer.status == ObservePushStatus::Unexplained && answer.hypotheses.is_empty(), "{answer:?}");
    }

    #[test]
    fn strange_problems_are_answered_too() {
        let finger = |radius: f64, velocity: [f64; 2]| json!({"radius": radius, "centre0": [0, 0], "velocity0": velocity, "acceleration": [0, 0.1]});
        for changes in [
            json!({"contact_angle": [1.6]}),
            json!({"contact_angle": [1.6, 1.6]}),
            json!({"contact_angle": [1.6, 1.5, 1.9], "sigma": 0}),
            json!({"mu": 0}),
            json!({"mu": 0, "mode": "frictionless"}),
            json!({"g": 0, "mode": "coulomb", "mu_c": 0.3}),
            json!({"mu_c": 0}),
            json!({"mu_sigma_log": 0.5}),
            json!({"mu_sigma_log": 1e12}),
            json!({"mu_sigma_log": 1e-12}),
            json!({"mode": "coulomb", "mu_c": 0}),
            json!({"mode": "sliding", "mu_c": 50}),
            json!({"finger": finger(0.0, [0.0, 0.05])}),
            json!({"finger": finger(10.0, [0.0, 0.05])}),
            json!({"finger": finger(0.01, [0.0, 0.0])}),
            json!({"finger": finger(0.01, [0.0, 0.0]), "mode": "coulomb", "mu_c": 0.3}),
            json!({"finger": finger(0.01, [0.0, 0.0]), "mode": "sliding", "mu_c": 0.3}),
            json!({"finger": finger(0.01, [1e-6, 1e-6])}),
            json!({"dt": 1e-6}),
            json!({"dt": 1}),
            json!({"sigma": 100}),
            json!({"contact_angle": null, "force_magnitude": [3, 3, 3], "sigma_magnitude_log": 0.1, "u0_range": [1.5, 1.7]}),
            json!({"contact_angle": null, "force_magnitude": [3, 3, 3], "sigma_magnitude_log": 0.1, "u0_range": [1.5, 1.7], "mass_unknown": true}),
            json!({"contact_angle": null, "force_direction": [1.6, 1.6, 1.6], "u0_range": [1.6, 1.6]}),
        ] {
            let answer = solve(&changes);
            crate::solve::testing::all_finite(&answer);
            assert_eq!(answer.status, ObservePushStatus::of(answer.hypotheses.len()), "{changes}");
        }
    }
}
