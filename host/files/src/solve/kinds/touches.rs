//! The kind `inscription` where a finger felt the part: touches with noise, lines with noise beside them, and disks that
//! the part does not reach into. See [`palpate::inscription::touched_poses`].

use nalgebra::Point2;
use palpate::geometry::{ConvexPolygon, SimplePolygon};
use palpate::inscription::{FeltNormal, Fence, FreeDisk, Touch, TouchEstimate, TouchReadings, touched_poses_until};
use palpate::{Searched, Stop};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::inscription::{Inscription, InscriptionAnswer, InscriptionStatus, ModeFields};
use crate::solve::fields::{NonNegative, PoseFields, Positive};
use crate::solve::{InvalidInput, Pointer, SolveError};

/// Least standard deviation of a length to compute with, m: a smaller one counts as this. Rounding errors of
/// coordinates in metres are a ten-thousandth of it.
const SIGMA_MIN_M: f64 = 1e-12;

/// The same of an angle, rad.
const SIGMA_MIN_RAD: f64 = 1e-12;

/// A point of the part's outline that was felt.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Touch")]
pub struct TouchFields {
    /// Where, world, m.
    pub point: [f64; 2],
    /// Standard deviation of each coordinate, m.
    pub sigma: Positive,
    /// Angle of the part's outward normal there, from the part towards the finger, world, rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal_angle: Option<f64>,
    /// Standard deviation of `normal_angle`, rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal_sigma: Option<Positive>,
    /// How far the part had moved when this was felt, world: the poses are those before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub displacement: Option<PoseFields>,
}

/// A disk that the part does not overlap.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "FreeDisk")]
pub struct FreeFields {
    /// World, m.
    pub centre: [f64; 2],
    /// m.
    pub radius: NonNegative,
}

impl TouchFields {
    fn touch(&self) -> Result<Touch, InvalidInput> {
        let normal = match (self.normal_angle, self.normal_sigma) {
            (Some(angle), Some(sigma)) => Some(FeltNormal { angle, sigma: sigma.get().max(SIGMA_MIN_RAD) }),
            (None, None) => None,
            (Some(_), None) => {
                return Err(InvalidInput::missing(
                    "normal_sigma",
                    "give the standard deviation of `normal_angle`, rad",
                ));
            }
            (None, Some(_)) => {
                return Err(InvalidInput::missing("normal_angle", "give the normal that `normal_sigma` is of, rad"));
            }
        };
        let felt = Touch { point: Point2::from(self.point), sigma: self.sigma.get().max(SIGMA_MIN_M), normal };
        let Some(displacement) = self.displacement else { return Ok(felt) };
        let undo = displacement.world_from_part().inverse();
        let normal = normal.map(|normal| FeltNormal { angle: normal.angle + undo.rotation.angle(), ..normal });
        Ok(Touch { point: undo * felt.point, normal, ..felt })
    }
}

impl Inscription {
    /// Whether this is a problem with touches, or has what only such problems have.
    pub(super) fn is_touched(&self) -> bool {
        !self.touches.is_empty() || !self.free.is_empty() || self.half_planes.iter().any(|line| line.sigma.is_some())
    }

    pub(super) fn solve_touched(&self, stop: Stop<'_>) -> Result<Searched<InscriptionAnswer>, SolveError> {
        let outline = self.touched_outline()?;
        let readings = self.touch_readings()?;
        let Searched { found: estimate, complete } = touched_poses_until(&outline, &readings, stop);
        if !complete && estimate.modes.is_empty() {
            return Err(SolveError::Stopped);
        }
        Ok(Searched { found: answer(&readings, &estimate), complete })
    }

    fn touched_outline(&self) -> Result<SimplePolygon, InvalidInput> {
        for (is_there, field) in
            [(self.ellipse.is_some(), "ellipse"), (self.rounding.is_some_and(|radius| radius.get() > 0.0), "rounding")]
        {
            if is_there {
                let remedy = "touches are solved for polygons only: give one with many vertices";
                return Err(InvalidInput::at(field, remedy));
            }
        }
        if !self.points.is_empty() {
            let remedy = "points are exact: beside touches give them as `touches`, with a small `sigma`";
            return Err(InvalidInput::at("points", remedy));
        }
        let polygon =
            self.polygon.as_ref().ok_or_else(|| InvalidInput::missing("polygon", "give the part's outline"))?;
        if !self.hull {
            return Ok((**polygon).clone());
        }
        let hull = ConvexPolygon::hull(polygon);
        let corners: Vec<_> = hull.corners().iter().map(|corner| hull.centre() + corner).collect();
        SimplePolygon::new(corners).map_err(|error| InvalidInput::at("polygon", error.to_string()))
    }

    fn touch_readings(&self) -> Result<TouchReadings, InvalidInput> {
        if self.touches.is_empty() && self.half_planes.is_empty() && self.cones.is_empty() {
            return Err(InvalidInput::missing("touches", "give at least one touch, half-plane or cone"));
        }
        let sigma = self.sigma.map_or(0.0, f64::from);
        if !self.cones.is_empty() && sigma <= 0.0 {
            let remedy = "give the standard deviation of the cones' bearings, rad, above 0";
            return Err(match self.sigma {
                None => InvalidInput::missing("sigma", remedy),
                Some(_) => InvalidInput::out_of_range(sigma, "> 0", remedy).inside("sigma"),
            });
        }
        let touch = |(index, touch): (usize, &TouchFields)| {
            touch.touch().map_err(|error| error.below(Pointer::from("touches").index(index)))
        };
        let touches = self.touches.iter().enumerate().map(touch).collect::<Result<Vec<_>, _>>()?;
        let fence = |line: &super::inscription::HalfPlaneFields| Fence {
            line: line.half_plane(),
            sigma: line.sigma.map(|sigma| sigma.get().max(SIGMA_MIN_M)),
        };
        let fences = self.half_planes.iter().map(fence).collect();
        let free = self.free.iter().map(|disk| FreeDisk { centre: disk.centre.into(), radius: disk.radius.get() });
        Ok(TouchReadings {
            touches,
            fences,
            bearings: self.bearings()?,
            bearing_sigma: sigma.max(SIGMA_MIN_RAD),
            free: free.collect(),
        })
    }
}

fn answer(readings: &TouchReadings, estimate: &TouchEstimate) -> InscriptionAnswer {
    let (status, reason) = if !readings.are_enough() {
        let count = readings.constraints();
        let reason = format!("{count} of the three readings that fix a pose: touch the part in more places");
        (InscriptionStatus::Underdetermined, Some(reason))
    } else if estimate.loose.is_some() {
        let reason = "the part can slide or turn with all readings kept: touch it on a side of another direction";
        (InscriptionStatus::Underdetermined, Some(reason.to_owned()))
    } else if estimate.modes.is_empty() {
        let reason = if readings.free.is_empty() {
            "no pose explains the readings at their standard deviations"
        } else {
            "no pose clear of the free disks explains the readings at their standard deviations"
        };
        (InscriptionStatus::NoPose, Some(reason.to_owned()))
    } else {
        (InscriptionStatus::Ok, None)
    };
    InscriptionAnswer {
        status,
        reason,
        poses: Vec::new(),
        conditioning: Vec::new(),
        groups: Vec::new(),
        modes: Some(estimate.modes.iter().map(ModeFields::from).collect()),
        dof: Some(estimate.dof),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::solve::{Problem as _, read};

    fn answer(problem: Value) -> Result<InscriptionAnswer, String> {
        let solved = read::<Inscription>(problem).map_err(SolveError::from).and_then(|problem| problem.solve());
        solved.map_err(|error| match error {
            SolveError::InvalidInput(error) => error.to_string(),
            other => panic!("{other}"),
        })
    }

    /// An L felt on four of its sides.
    fn felt() -> Value {
        let touch = |x: f64, y: f64| json!({"point": [x, y], "sigma": 5e-5});
        json!({"polygon": [[0, 0], [0.06, 0], [0.06, 0.02], [0.03, 0.02], [0.03, 0.04], [0, 0.04]],
               "touches": [touch(0.01, 0.0), touch(0.05, 0.0), touch(0.0, 0.03), touch(0.045, 0.02)]})
    }

    #[test]
    fn a_notched_part_is_found_by_its_touches() {
        let answer = answer(felt()).unwrap();
        assert_eq!((answer.status, answer.dof, answer.poses.len()), (InscriptionStatus::Ok, Some(1), 0));
        let modes = answer.modes.unwrap();
        let best = modes[0].pose;
        assert!(best.x.hypot(best.y) < 1e-9 && modes[0].chi2 < 1e-9, "{modes:?}");
    }

    #[test]
    fn a_part_that_moved_between_touches_is_found_where_it_was() {
        let mut moved = felt();
        moved["touches"][3] =
            json!({"point": [0.1, 0.245], "sigma": 5e-5, "displacement": [0.12, 0.2, std::f64::consts::FRAC_PI_2]});
        let (moved, still) = (answer(moved).unwrap().modes.unwrap(), answer(felt()).unwrap().modes.unwrap());
        assert_eq!(moved.len(), still.len());
        assert!(moved.iter().zip(&still).all(|(a, b)| (a.pose.x - b.pose.x).abs() < 1e-9), "{moved:?} {still:?}");
    }

    #[test]
    fn too_little_and_too_much_are_answers() {
        let mut little = felt();
        little["touches"] = json!([felt()["touches"][0]]);
        let little = answer(little).unwrap();
        assert_eq!((little.status, little.dof), (InscriptionStatus::Underdetermined, Some(-2)));
        let mut covered = felt();
        covered["free"] = json!([{"centre": [0.015, 0.02], "radius": 0.0}]);
        let covered = answer(covered).unwrap();
        assert!(covered.modes.unwrap().iter().all(|mode| mode.pose.x.hypot(mode.pose.y) > 1e-3));
    }

    #[test]
    fn what_cannot_be_is_refused_with_its_place() {
        let cone = json!([{"apex": [-2.0, 0.3], "right": -0.1, "left": 0.3}]);
        let cases = [
            ("/touches/0/sigma", json!(0.0), "/touches/0/sigma", "> 0"),
            ("/touches/0/sigma", json!(null), "/touches/0/sigma", ""),
            ("/touches/1/normal_angle", json!(1.0), "/touches/1/normal_sigma", "missing"),
            ("/touches/1/normal_sigma", json!(1.0), "/touches/1/normal_angle", "missing"),
            ("/touches/1/normal_sigma", json!(-1.0), "/touches/1/normal_sigma", "> 0"),
            ("/free", json!([{"centre": [0, 0], "radius": -1}]), "/free/0/radius", "≥ 0"),
            ("/cones", cone, "/sigma", "missing"),
            ("/half_planes", json!([{"normal_angle": 0, "offset": 0, "sigma": 0}]), "/half_planes/0/sigma", "> 0"),
            // What only touches its hull has no notches.
            ("/touches", json!([]), "/polygon/3", "not convex"),
        ];
        for (place, value, field, wanted) in cases {
            let mut problem = felt();
            let (outer, key) = place.rsplit_once('/').unwrap();
            problem.pointer_mut(outer).unwrap()[key] = value;
            let message = answer(problem).unwrap_err();
            assert!(message.contains(field) && message.contains(wanted), "{place}: {message}");
        }
        let mut free = felt();
        free["touches"] = json!([]);
        free["free"] = json!([{"centre": [0, 0], "radius": 1}]);
        assert!(answer(free).unwrap_err().contains("/touches"));
    }
}
