//! Whether another pose could have been felt the same: a search that shares nothing with estimator and planner but the
//! dynamics and the arithmetic of [`least_squares`].
//!
//! From places all along each edge the part is pushed as the truth was, at fixed steps; the best places of each edge
//! are improved with the derivatives of [`Seeded`]. Where rolling and sliding take turns, the error-controlled
//! simulation and its derivatives across changes ([`Push::run_derived`]) do the same.
//!
//! What misses exact angles by far at a coarse noise misses them by more at a fine one. So exact data are searched at a
//! coarse noise first, and only what fits there is followed on.
//!
//! Units: SI; costs of no dimension. Errors: none; what cannot move is no rival.

use nalgebra::{Vector2, Vector4};
use palpate::geometry::distance_to_segment;
use palpate::math::Jet;
use palpate::math::least_squares::{
    self, Damping, Enough, Floor, LeastSquaresProblem, LeastSquaresSettings, NormalEquations,
};
use palpate::pushing::dynamics::{
    ContactLaw, ContactMode, EdgeEnd, Finger, Parameter, Part, Push, PushModel, Scalar, Seeded, Slip, Start, State,
};
use palpate::pushing::estimation::{Prior, Touch};

/// Distance of places tried, m; and where rolling and sliding take turns, which costs more.
const GRID_M: f64 = 1e-3;
/// The same distance where rolling and sliding take turns, m.
const GRID_COULOMB_M: f64 = 2.5e-3;

/// Steps between values, at a coarse noise and at a fine one.
const STEPS: [usize; 2] = [2, 10];

/// Noise that is searched first at least, and by how much it falls from there, rad.
const SIGMA_COARSE: f64 = 2e-3;
/// How much less noise is searched with next, as a ratio.
const SIGMA_RATIO: f64 = 0.1;

/// How a place is improved: until a step lowers the cost by less than a thousandth of a squared standard deviation.
const IMPROVEMENT: LeastSquaresSettings<4> = LeastSquaresSettings {
    damping: Damping {
        first: 1e-3,
        min: 0.0,
        max: f64::INFINITY,
        up: 10.0,
        min_after_failure: 1e-6,
        down: 0.2,
        trusted_share: 0.0,
    },
    // Holds a velocity along the contact that makes no difference: where the contact rolls.
    floor: Floor::Absolute([1e-9; 4]),
    enough: Enough { relative: 0.0, absolute: 1e-3, damping_max: f64::INFINITY },
    trials_max: 25,
    steps_max: usize::MAX,
};

/// After so many trials its cost must be below so much.
const HOPELESS: (usize, f64) = (6, 1e4);

/// Rivals are at least so far from the truth on its own edge at the end, m.
const APART_M: f64 = 2e-3;

/// Standard deviation that keeps a rival's path on its edge, and how far beyond it may be; m.
const EDGE_SIGMA_M: f64 = 1e-5;
/// How far beyond its edge a rival may be, m.
const BEYOND_M: f64 = 5e-5;

/// Overlaps of the disk with another edge up to this are none, m: rounding.
const OVERLAP_M: f64 = 1e-9;

/// Places of an edge, of those that are better than their neighbours, that are improved.
const TRIED: usize = 6;

/// Unknowns: contact angle, place, angular velocity, velocity along the contact.
const UNKNOWNS: [Parameter; 4] = [Parameter::U, Parameter::S, Parameter::Omega, Parameter::VT];

/// A part of a push without a change of the finger's acceleration.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leg {
    /// In time since the leg's beginning.
    pub(super) finger: Finger,
    /// Values in it, that at its beginning not counted.
    pub(super) values: usize,
}

/// A push whose exact angles are known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Truth<'a> {
    pub(super) part: &'a Part,
    /// µ g of the plane, m/s².
    pub(super) mu_g: f64,
    pub(super) legs: &'a [Leg],
    pub(super) touch: Touch,
    /// Number of the edge touched, from 0.
    pub(super) edge: usize,
    /// At the first value.
    pub(super) start: State,
    /// Place on the edge at the last value, m.
    pub(super) s_end: f64,
    /// Exact contact angles, rad.
    pub(super) angles: &'a [f64],
    /// Time between values, s.
    pub(super) dt: f64,
    /// Of one angle, rad.
    pub(super) sigma: f64,
    pub(super) prior: Prior,
    /// Whether a rival's disk must be clear of the edges that it does not touch, as the truth's is.
    pub(super) is_clear: bool,
}

impl Truth<'_> {
    /// Whether a pose other than the truth has a cost below `limit` on the exact angles.
    pub(super) fn has_rival(&self, limit: f64) -> bool {
        let edges = 0..self.part.polygon().vertices().len();
        let ways: Vec<_> = edges.flat_map(|edge| self.ways(edge)).filter_map(|way| Search::new(self, way)).collect();
        let coarse = self.sigma.max(SIGMA_COARSE);
        let mut starts: Vec<_> =
            ways.iter().flat_map(|way| way.beginnings().into_iter().map(move |s| (way, s))).collect();
        starts.sort_by(|(_, a), (_, b)| a.0.total_cmp(&b.0));
        starts.into_iter().any(|(search, (_, start))| search.leads_to_rival(start, coarse, limit))
    }

    /// The ways in which the part can be touched on an edge.
    fn ways(&self, edge: usize) -> Vec<Way> {
        let contacts = match self.touch {
            Touch::Frictionless => vec![ContactMode::Frictionless],
            Touch::Rolling { .. } => vec![ContactMode::Rolling],
            Touch::Sliding { friction } => {
                [Slip::Forward, Slip::Backward].map(|slip| ContactMode::Sliding { friction, slip }).to_vec()
            }
            Touch::Coulomb { friction } => return vec![Way { edge, contact: None, friction }],
        };
        contacts.into_iter().map(|contact| Way { edge, contact: Some(contact), friction: 0.0 }).collect()
    }
}

/// Whether a disk (radius in m) that touches an edge at a place (m) overlaps no other.
pub(super) fn is_clear(part: &Part, edge: usize, radius: f64, place: f64) -> bool {
    let Ok(line) = part.edge(edge) else { return false };
    let along = Vector2::new(-line.normal.y, line.normal.x);
    let centre = part.centre_of_mass() + line.normal * (line.height + radius) + along * place;
    let others = part.polygon().edges().enumerate().filter(|(other, _)| *other != edge);
    others.into_iter().all(|(_, (from, to))| distance_to_segment(centre, from, to) > radius - OVERLAP_M)
}

/// An edge and what its contact does: always the same, or what Coulomb's law says.
#[derive(Clone, Copy, Debug)]
struct Way {
    edge: usize,
    contact: Option<ContactMode>,
    friction: f64,
}

/// A search along one edge.
struct Search<'a> {
    truth: &'a Truth<'a>,
    way: Way,
    models: Vec<PushModel<'a>>,
}

impl<'a> Search<'a> {
    fn new(truth: &'a Truth<'a>, way: Way) -> Option<Self> {
        let edge = truth.part.edge(way.edge).ok()?;
        let model = |leg: &Leg| PushModel { part: truth.part, edge, mu_g: truth.mu_g, finger: leg.finger };
        Some(Self { truth, way, models: truth.legs.iter().map(model).collect() })
    }

    /// Costs and starts of the places that are better than their neighbours.
    fn beginnings(&self) -> Vec<(f64, State)> {
        let costs: Vec<_> = self.places().into_iter().map(|start| (self.plain_cost(&start), start)).collect();
        let at = |place: usize| costs.get(place).map_or(f64::INFINITY, |found| found.0);
        let lowest = |place: &usize| {
            at(*place).is_finite() && at(*place) <= at(place.wrapping_sub(1)) && at(*place) <= at(place + 1)
        };
        let mut best: Vec<_> = (0..costs.len()).filter(lowest).map(|place| costs[place]).collect();
        best.sort_by(|a, b| a.0.total_cmp(&b.0));
        best.truncate(TRIED);
        best
    }

    fn places(&self) -> Vec<State> {
        let edge = &self.models[0].edge;
        let length = edge.s_max - edge.s_min;
        let grid = if self.way.contact.is_some() { GRID_M } else { GRID_COULOMB_M };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few dozen")]
        let steps = (length / grid).ceil() as u32;
        let place = |i: u32| edge.s_min + length * f64::from(i) / f64::from(steps);
        (0..=steps).map(|i| State { s: place(i), ..self.truth.start }).collect()
    }

    /// Squared misses of the angles, rad².
    fn plain_cost(&self, start: &State) -> f64 {
        let squares = |states: &mut dyn Iterator<Item = State>| {
            states.zip(&self.truth.angles[1..]).map(|(state, angle)| (state.u - angle).powi(2)).sum()
        };
        match self.way.contact {
            Some(contact) => {
                let models: Vec<_> = self.models.iter().collect();
                squares(&mut self.states(&models, &contact, start, STEPS[0]).skip(1))
            }
            None => self.coulomb(start).map_or(f64::INFINITY, |push| {
                let run = push.run(&self.times()).ok().filter(|run| run.samples.len() == self.truth.angles.len());
                run.map_or(f64::INFINITY, |run| squares(&mut run.samples.iter().map(|sample| sample.state).skip(1)))
            }),
        }
    }

    fn coulomb(&self, start: &State) -> Option<Push<'_>> {
        let law = ContactLaw::Coulomb { friction: self.way.friction };
        Push::new(self.models[0], law, Start::Moving(*start), EdgeEnd::Extend).ok()
    }

    fn times(&self) -> Vec<f64> {
        (0_u32..).map(|i| f64::from(i) * self.truth.dt).take(self.truth.angles.len()).collect()
    }

    /// The states at the values' times, of a contact that stays as it is.
    fn states<T: Scalar>(
        &self,
        models: &[&PushModel<'_, T>],
        contact: &ContactMode<T>,
        start: &State<T>,
        steps: usize,
    ) -> impl Iterator<Item = State<T>> + use<T> {
        let step = self.truth.dt / steps as f64;
        let mut states = vec![*start];
        for (model, leg) in models.iter().zip(self.truth.legs) {
            let from = states[states.len() - 1];
            let count = steps * leg.values;
            states.extend(model.rollout(contact, &from, step).take(count).skip(steps - 1).step_by(steps));
        }
        states.into_iter()
    }

    /// Follows a start down, first at a coarse noise, then, as long as it fits, at ever finer ones.
    fn leads_to_rival(&self, mut start: State, mut sigma: f64, limit: f64) -> bool {
        loop {
            let last = sigma <= self.truth.sigma;
            let Some((lowest, cost)) = self.lowest(start, sigma, limit) else { return false };
            if last || cost >= limit {
                return cost < limit;
            }
            (start, sigma) = (lowest, (sigma * SIGMA_RATIO).max(self.truth.sigma));
        }
    }

    /// The lowest rival that a start leads to at a noise, and its cost; none if that is no rival.
    fn lowest(&self, start: State, sigma: f64, limit: f64) -> Option<(State, f64)> {
        let mut is_hopeless = false;
        let improving = Improving { search: self, sigma };
        let found = least_squares::minimise(&improving, self.tried(&start, sigma)?, &IMPROVEMENT, |trial| {
            let Tried { equations, cost, .. } = trial.place;
            is_hopeless = trial.count >= HOPELESS.0 && equations.cost > HOPELESS.1;
            is_hopeless || (trial.is_lower && self.is_rival(trial.place) && *cost < limit)
        });
        let found = found.place;
        (!is_hopeless && self.is_rival(&found)).then_some((found.start, found.cost))
    }

    fn is_rival(&self, found: &Tried) -> bool {
        let is_truth = self.way.edge == self.truth.edge && (found.s_end - self.truth.s_end).abs() < APART_M;
        !is_truth && found.possible
    }

    fn tried(&self, start: &State, sigma: f64) -> Option<Tried> {
        let states = match self.way.contact {
            Some(contact) => {
                let seeded: Vec<_> =
                    self.models.iter().map(|model| Seeded::new(model, &contact, start, UNKNOWNS)).collect();
                let models: Vec<_> = seeded.iter().map(|seeded| &seeded.model).collect();
                let steps = if sigma < SIGMA_COARSE { STEPS[1] } else { STEPS[0] };
                self.states(&models, &seeded[0].contact, &seeded[0].start, steps).collect()
            }
            None => self.coulomb(start)?.run_derived(&self.times(), UNKNOWNS).ok()?.states,
        };
        if states.len() < self.truth.angles.len() {
            return None;
        }
        let mut tried = Tried::new(start);
        for (value, (state, angle)) in states.iter().zip(self.truth.angles).enumerate() {
            tried.add((state.u - *angle) / sigma, true);
            self.keep_on_edge(&mut tried, state.s);
            tried.possible &= self.is_clear(state.s.value);
            tried.s_end = state.s.value;
            tried.possible &= self.lasts(value, state);
        }
        self.add_prior(&mut tried, start);
        Some(tried)
    }

    fn is_clear(&self, place: f64) -> bool {
        !self.truth.is_clear || is_clear(self.truth.part, self.way.edge, self.models[0].finger.radius, place)
    }

    fn add_prior(&self, tried: &mut Tried, start: &State) {
        let v_t_counts = !matches!(self.way.contact, Some(ContactMode::Rolling));
        let v_t = self.truth.prior.v_t0_sigma.filter(|_| v_t_counts);
        for (unknown, sigma, value) in [(2, self.truth.prior.omega0_sigma, start.omega), (3, v_t, start.v_t)] {
            if let Some(sigma) = sigma {
                tried.add(Jet::variable(value, unknown) / sigma, true);
            }
        }
    }

    fn keep_on_edge(&self, tried: &mut Tried, s: Jet<4>) {
        let edge = &self.models[0].edge;
        let beyond = (s.value - edge.s_max).max(0.0) - (edge.s_min - s.value).max(0.0);
        if beyond != 0.0 {
            let limit = if beyond > 0.0 { edge.s_max } else { edge.s_min };
            tried.add((s - limit) / EDGE_SIGMA_M, false);
        }
        tried.possible &= beyond.abs() < BEYOND_M;
    }

    /// Whether the part still is pushed at a value, and slips the way it is taken to.
    fn lasts(&self, value: usize, state: &State<Jet<4>>) -> bool {
        let Some(contact) = self.way.contact else { return true };
        let (model, time) = self.at(value);
        let State { u, s, omega, v_t } = *state;
        let state = State { u: u.value, s: s.value, omega: omega.value, v_t: v_t.value };
        let slips = match contact {
            ContactMode::Sliding { slip, .. } => model.slip(time, &state) * slip.sign() > 0.0,
            _ => true,
        };
        slips && model.motion(&contact, time, &state).normal_force > 0.0
    }

    /// The leg that a value belongs to, and the time since its beginning, s.
    fn at(&self, value: usize) -> (&PushModel<'a>, f64) {
        let (mut leg, mut since) = (0, value);
        while leg + 1 < self.models.len() && since >= self.truth.legs[leg].values {
            since -= self.truth.legs[leg].values;
            leg += 1;
        }
        let time = since as f64 * self.truth.dt;
        (&self.models[leg], time)
    }
}

/// A start that was tried.
struct Tried {
    start: State,
    /// Without what keeps the path on its edge.
    cost: f64,
    /// With what keeps the path on its edge.
    equations: NormalEquations<4>,
    s_end: f64,
    possible: bool,
}

impl Tried {
    fn new(start: &State) -> Self {
        Self { start: *start, cost: 0.0, equations: NormalEquations::zero(), s_end: start.s, possible: true }
    }

    fn add(&mut self, residual: Jet<4>, counts: bool) {
        self.cost += if counts { residual.value * residual.value } else { 0.0 };
        self.equations.add(residual.value, Vector4::from(residual.slopes));
    }
}

/// A search at one noise, rad.
struct Improving<'s, 'a> {
    search: &'s Search<'a>,
    sigma: f64,
}

impl LeastSquaresProblem<4> for Improving<'_, '_> {
    type Place = Tried;

    fn cost(&self, tried: &Tried) -> f64 {
        tried.equations.cost
    }

    fn normal_equations(&self, tried: &Tried) -> NormalEquations<4> {
        tried.equations
    }

    fn moved(&self, tried: &Tried, step: &Vector4<f64>) -> Option<Tried> {
        let State { u, s, omega, v_t } = tried.start;
        let next = State { u: u + step[0], s: s + step[1], omega: omega + step[2], v_t: v_t + step[3] };
        self.search.tried(&next, self.sigma)
    }
}
