//! Contact readings, and the steps in time that pass by them.
//!
//! Motions are computed from an instant in the middle outward, both ways: errors of the state there grow over half the
//! window only, which widens the basin in which a fit converges.
//!
//! Frames: palm. Units: SI. Errors: none.

use nalgebra::{Vector2, Vector3};

use super::super::mechanics::specific_force;
use super::super::palm::PalmAcceleration;

/// The length of time that one averaged reading of the search stands for, s: short beside all that happens.
const BLOCK_S: f64 = 8e-3;

/// Standard deviation that even perfect readings have in the search, m: what averaging and long steps leave.
const SEARCH_SIGMA_MIN: f64 = 3e-5;

/// Longest steps, s: in the search, for readings with noise, and for readings without.
const STEP_SEARCH_S: f64 = 1.1e-2;
const STEP_NOISY_S: f64 = 4e-3;
const STEP_FINE_S: f64 = 1e-3;
const STEP_EXACT_S: f64 = 2.5e-4;

/// Averaged readings from which on half of them are enough for a first look: eight away from the middle each way.
const DENSE: usize = 17;

/// Standard deviations below which readings ask for the finer steps, m.
const SIGMA_NOISY: f64 = 2e-5;
const SIGMA_FINE: f64 = 5e-8;

/// How the readings err.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Noise {
    /// Independent normal errors of this standard deviation, m.
    Gauss(f64),
    /// Each coordinate is the nearest multiple of this pitch, m.
    Grid(f64),
    /// No errors but rounding.
    Exact,
}

impl Noise {
    /// Standard deviation of a coordinate, m; what no noise stands for is below every sensor and above rounding.
    #[must_use]
    pub fn sigma(self) -> f64 {
        const EXACT_SIGMA: f64 = 1e-9;
        match self {
            Self::Gauss(sigma) => sigma,
            Self::Grid(pitch) => pitch / 12.0_f64.sqrt(),
            Self::Exact => EXACT_SIGMA,
        }
    }
}

/// Contacts at equal steps of time.
#[derive(Clone, Debug, PartialEq)]
pub struct Readings {
    /// Of the first, s.
    pub start: f64,
    /// Time between readings, s.
    pub dt: f64,
    /// Contacts on the palm, m.
    pub u: Vec<Vector2<f64>>,
    /// Standard deviation of a coordinate, m.
    pub sigma: f64,
}

/// One step of the integration.
#[derive(Clone, Copy, Debug)]
pub(super) struct IntegrationStep {
    /// Length, s; negative backward in time.
    pub(super) dt: f64,
    /// What the body feels at its start, middle and end, palm axes, m/s².
    pub(super) specific_force: [Vector3<f64>; 3],
    /// The reading at its end.
    pub(super) reading: Option<Vector2<f64>>,
    /// How many readings away from the middle it ends, or the next one is.
    pub(super) rank: usize,
}

/// Readings with the steps that pass by them, from the middle outward.
#[derive(Clone, Debug)]
pub(super) struct Track {
    pub(super) centre: Vector2<f64>,
    /// Time of the middle reading, from which integration goes both ways, s.
    pub(super) centre_time: f64,
    pub(super) sigma: f64,
    /// Time between readings, s.
    pub(super) dt: f64,
    /// It passes by every reading, or by every other one.
    stride: usize,
    pub(super) forward: Vec<IntegrationStep>,
    pub(super) backward: Vec<IntegrationStep>,
}

impl Readings {
    /// The time of a reading, s.
    #[must_use]
    pub fn time(&self, index: usize) -> f64 {
        let steps = index as f64;
        self.start + steps * self.dt
    }

    /// From the first to the last, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.time(self.u.len() - 1) - self.start
    }

    /// Means of neighbours, for the search. `pace`: the share of a round body's times in which this one does as much.
    pub(super) fn averaged(&self, pace: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small positive count")]
        let block = ((BLOCK_S * pace / self.dt).round() as usize).clamp(1, (self.u.len() / 8).max(1));
        let count = block as f64;
        let mean = |block: &[Vector2<f64>]| block.iter().sum::<Vector2<f64>>() / count;
        Self {
            start: self.start + 0.5 * (count - 1.0) * self.dt,
            dt: self.dt * count,
            u: self.u.chunks_exact(block).map(mean).collect(),
            sigma: (self.sigma / count.sqrt()).max(SEARCH_SIGMA_MIN),
        }
    }

    /// The steps that a search takes.
    pub(super) fn search_track(&self, palm: &PalmAcceleration, g: f64, pace: f64) -> Track {
        self.track(palm, g, STEP_SEARCH_S * pace, 1)
    }

    /// Half as many steps, by every other reading where they are dense: they show as well which attitudes are worth more.
    pub(super) fn first_look(&self, palm: &PalmAcceleration, g: f64, pace: f64) -> Track {
        let is_dense = self.dt <= STEP_SEARCH_S * pace && self.u.len() >= DENSE;
        self.track(palm, g, 2.0 * STEP_SEARCH_S * pace, if is_dense { 2 } else { 1 })
    }

    /// The steps that the last fit takes: short enough that their error stays below that of the readings.
    pub(super) fn fine_track(&self, palm: &PalmAcceleration, g: f64, pace: f64) -> Track {
        let longest = match self.sigma {
            sigma if sigma >= SIGMA_NOISY => STEP_NOISY_S,
            sigma if sigma >= SIGMA_FINE => STEP_FINE_S,
            _ => STEP_EXACT_S,
        };
        self.track(palm, g, longest * pace, 1)
    }

    /// By every reading whose distance from the middle is a multiple of `stride`.
    fn track(&self, palm: &PalmAcceleration, g: f64, longest: f64, stride: usize) -> Track {
        let last = self.u.len() - 1;
        let middle = last / 2;
        let integration_steps = |index: usize, next: usize, rank: usize| {
            let (from, to) = (self.time(index), self.time(next));
            let mut integration_steps = between(palm, g, [from, to], longest);
            for integration_step in &mut integration_steps {
                integration_step.rank = rank;
            }
            if let Some(end) = integration_steps.last_mut() {
                end.reading = Some(self.u[next]);
            }
            integration_steps
        };
        Track {
            centre: self.u[middle],
            centre_time: self.time(middle),
            sigma: self.sigma,
            dt: self.dt,
            stride,
            forward: (stride..=last - middle)
                .step_by(stride)
                .flat_map(|rank| integration_steps(middle + rank - stride, middle + rank, rank))
                .collect(),
            backward: (stride..=middle)
                .step_by(stride)
                .flat_map(|rank| integration_steps(middle + stride - rank, middle - rank, rank))
                .collect(),
        }
    }
}

/// Steps no longer than `longest`, none across a jump of the palm's acceleration.
fn between(palm: &PalmAcceleration, g: f64, [from, to]: [f64; 2], longest: f64) -> Vec<IntegrationStep> {
    let mut stops: Vec<f64> = palm.jumps(from.min(to), from.max(to)).collect();
    if to < from {
        stops.reverse();
    }
    stops.push(to);
    let mut integration_steps = Vec::with_capacity(stops.len());
    let mut at = from;
    for stop in stops {
        let parts = ((stop - at).abs() / longest).ceil().max(1.0);
        let dt = (stop - at) / parts;
        let mut done = 0.0;
        while done < parts {
            let (start, end) = (at + done * dt, at + (done + 1.0) * dt);
            let middle = 0.5 * (start + end);
            let specific_force = [start, middle, end].map(|time| specific_force(palm.at_within(time, middle), g));
            integration_steps.push(IntegrationStep { dt, specific_force, reading: None, rank: 0 });
            done += 1.0;
        }
        at = stop;
    }
    integration_steps
}

impl Track {
    /// Readings away from the middle within a time, at least three of those passed by and no more than there are.
    pub(super) fn ranks(&self, seconds: f64) -> usize {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating, and capped below")]
        let ranks = (seconds / self.dt).round() as usize;
        ranks.next_multiple_of(self.stride).max(3 * self.stride).min(self.ranks_max())
    }

    /// Coordinates read up to so many readings away from the middle.
    pub(super) fn numbers(&self, ranks: usize) -> usize {
        let within = |steps: &[IntegrationStep]| {
            steps.iter().take_while(|step| step.rank <= ranks).filter(|step| step.reading.is_some()).count()
        };
        2 * (1 + within(&self.forward) + within(&self.backward))
    }

    /// Readings away from the middle at most.
    pub(super) fn ranks_max(&self) -> usize {
        let last = |integration_steps: &[IntegrationStep]| {
            integration_steps.last().map_or(0, |integration_step| integration_step.rank)
        };
        last(&self.forward).max(last(&self.backward))
    }
}
