//! The kind `point_sampling`: points that tell shapes or poses apart.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use palpate::geometry::SimplePolygon;
use palpate::point_sampling::{self, Objective, Plan, Request, Scene};
use palpate::{Searched, Stop, never};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::solve::fields::{NonNegative, Polygon};
use crate::solve::{InvalidInput, Problem, SolveError};

/// Most points by which any two polygons may be asked to differ.
const SEPARATION_MAX: usize = 64;

/// Polygons to tell apart by points that are inside some and outside others.
///
/// ```
/// use palpate_files::solve::Problem;
/// use palpate_files::solve::kinds::point_sampling::PointSampling;
///
/// let line = r#"{"polygons": [[[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]], [[0.02, 0], [0.08, 0], [0.08, 0.04], [0.02, 0.04]]]}"#;
/// let answer = serde_json::from_str::<PointSampling>(line)?.solve()?;
/// assert_eq!((answer.points.len(), answer.regions, answer.optimal), (1, 3, true));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointSampling {
    /// Outlines, all in one frame.
    pub polygons: Vec<Polygon>,
    /// Regions of this area or less are left out, m².
    #[serde(default = "zero")]
    pub min_area: NonNegative,
    /// Points nearer than this to an edge of any polygon are left out, m.
    #[serde(default = "zero")]
    pub min_clearance: NonNegative,
    /// What a choice of points is judged by.
    #[serde(default)]
    pub objective: ObjectiveName,
    /// By how many points any two polygons must differ: 1 tells them apart, t + 1 notices t misread points, 2 t + 1 corrects
    /// them.
    #[serde(default = "one")]
    pub separation: usize,
}

fn zero() -> NonNegative {
    NonNegative::default()
}

fn one() -> usize {
    1
}

/// What is wanted of the points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObjectiveName {
    /// The fewest; then the largest smallest clearance.
    #[default]
    Fewest,
    /// The greedy choice, at most 2 ln n times as many.
    Greedy,
}

/// Points, and how good they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PointSamplingAnswer {
    /// Whether the points tell all polygons apart.
    pub status: PointSamplingStatus,
    /// Polygons that no points (in regions and with clearances as asked) tell apart, the lesser index first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pairs: Vec<[usize; 2]>,
    /// Places of the points, m.
    pub points: Vec<[f64; 2]>,
    /// Distance of each point from the nearest edge of any polygon, m.
    pub clearances: Vec<f64>,
    /// For each polygon, 1 for each point inside it and 0 for each outside.
    pub signatures: Vec<Vec<u8>>,
    /// Bounded faces inside at least one polygon with an area above `min_area`.
    pub regions: usize,
    /// No fewer points tell the polygons apart.
    pub lower_bound: usize,
    /// Whether there are as few points as `lower_bound`.
    pub optimal: bool,
    /// No plan of so many points has a larger smallest clearance, m; null for the greedy choice.
    pub clearance_bound: Option<f64>,
    /// What proves that `lower_bound` points are needed.
    pub proof: ProofOfBound,
}

/// Whether polygons can be told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Status")]
pub enum PointSamplingStatus {
    /// All.
    Ok,
    /// All but `pairs`.
    Indistinguishable,
}

/// What a bound rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ProofOfBound {
    /// Binary digits that number the polygons.
    pub digits: usize,
    /// What linear programs with counting rows prove before any branching; 0 if none was needed.
    pub program: usize,
    /// Linear programs solved by branching.
    pub branches: u64,
    /// Partitions of the polygons looked at.
    pub partitions: u64,
}

impl From<&Plan> for PointSamplingAnswer {
    fn from(plan: &Plan) -> Self {
        let point_sampling::Proof { digits, program, branches, partitions } = plan.proof;
        Self {
            status: if plan.indistinguishable.is_empty() {
                PointSamplingStatus::Ok
            } else {
                PointSamplingStatus::Indistinguishable
            },
            pairs: plan.indistinguishable.clone(),
            points: plan.points.iter().map(|point| point.centre.into()).collect(),
            clearances: plan.points.iter().map(|point| point.radius).collect(),
            signatures: plan
                .signatures
                .iter()
                .map(|signature| signature.iter().copied().map(u8::from).collect())
                .collect(),
            regions: plan.regions,
            lower_bound: plan.lower_bound,
            optimal: plan.is_fewest(),
            clearance_bound: plan.clearance_bound,
            proof: ProofOfBound { digits, program, branches, partitions },
        }
    }
}

impl Problem for PointSampling {
    const KIND: &'static str = "point_sampling";
    const TIME_LIMIT_S: Option<f64> = Some(60.0);
    type Answer = PointSamplingAnswer;

    fn solve(&self) -> Result<PointSamplingAnswer, SolveError> {
        Ok(self.solve_until(&never)?.found)
    }

    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<PointSamplingAnswer>, SolveError> {
        if self.polygons.is_empty() {
            return Err(InvalidInput::at("polygons", "is empty: give at least one polygon").into());
        }
        let request = self.request()?;
        let polygons: Vec<SimplePolygon> = self.polygons.iter().map(|polygon| (**polygon).clone()).collect();
        let stopped = AtomicBool::new(false);
        let stop = || {
            if !stopped.load(Relaxed) && stop.stops() {
                stopped.store(true, Relaxed);
            }
            stopped.load(Relaxed)
        };
        // Without all regions nothing is known of any point.
        let scene = Scene::new_until(&polygons, &stop).ok_or(SolveError::Stopped)?;
        let plan = scene.plan_until(&request, &stop).ok_or(SolveError::Stopped)?;
        let mut found = PointSamplingAnswer::from(&plan);
        let complete = !stopped.into_inner() && (plan.is_fewest() || self.objective == ObjectiveName::Greedy);
        // As few may be proven, but more clearance was still looked for.
        found.optimal &= complete || self.objective == ObjectiveName::Greedy;
        Ok(Searched { found, complete })
    }
}

impl PointSampling {
    fn request(&self) -> Result<Request, InvalidInput> {
        if !(1..=SEPARATION_MAX).contains(&self.separation) {
            let message =
                format!("{} is out of range, it must be from 1 to {SEPARATION_MAX}: it counts points", self.separation);
            return Err(InvalidInput::at("separation", message));
        }
        Ok(Request {
            min_area: self.min_area.get(),
            min_clearance: self.min_clearance.get(),
            separation: self.separation,
            objective: match self.objective {
                ObjectiveName::Fewest => Objective::Fewest,
                ObjectiveName::Greedy => Objective::Greedy,
            },
        })
    }
}
