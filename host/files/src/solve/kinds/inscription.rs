//! The kind `inscription`: a part's pose from supporting lines, and from touches ([`super::touches`]). See
//! [`palpate::inscription`].

use nalgebra::Point2;
use palpate::geometry::ConvexPolygon;
use palpate::inscription::{self, Bearing, ConeError, Continuum, HalfPlane, NoisyReadings, Outline};
use palpate::{Searched, Stop, never};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::touches::{FreeFields, TouchFields};
use crate::solve::fields::{NonNegative, Polygon, PoseFields, Positive, Sigma};
use crate::solve::{InvalidInput, Pointer, Problem, SolveError};

/// Lines that a convex part touches, and on whose inner side it lies.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Inscription {
    /// The part's outline, convex unless `hull` is set. Needed, unless the part is an `ellipse`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub polygon: Option<Polygon>,
    /// The corners of the polygon are centres of arcs of this radius, which all around is added to it, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rounding: Option<NonNegative>,
    /// Instead of `polygon`: an ellipse about the part frame's origin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ellipse: Option<EllipseFields>,
    /// Views of the part.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cones: Vec<ConeFields>,
    /// Fences and jaws that the part touches.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub half_planes: Vec<HalfPlaneFields>,
    /// Points that the part's outline passes through: probed contacts.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<PointFields>,
    /// Points that were felt on the outline, with noise; then it may have notches, and lines and cones touch its hull.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub touches: Vec<TouchFields>,
    /// Disks that the part does not overlap.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub free: Vec<FreeFields>,
    /// Standard deviation of every bearing of a cone, rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<Sigma>,
    /// Takes the convex hull of the polygon.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub hull: bool,
}

/// What a sensor sees of the part: swept counter-clockwise from `right` to `left`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Cone")]
pub struct ConeFields {
    /// The sensor, world, m.
    pub apex: [f64; 2],
    /// Angle of the right side, rad.
    pub right: f64,
    /// Angle of the left side, rad.
    pub left: f64,
    /// How far the part had moved when this was read, world: the poses are those before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub displacement: Option<PoseFields>,
    /// The same for the left side, where a turning beam reaches it later; by default that of the right side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub displacement_left: Option<PoseFields>,
}

/// The points q with q·(cos, sin)(`normal_angle`) ≤ `offset`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HalfPlaneFields {
    /// Angle of the normal that points away from the part, rad.
    pub normal_angle: f64,
    /// Distance of the line from the world's origin along the normal, m.
    pub offset: f64,
    /// Standard deviation of `offset`, m; without it the line is exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<Positive>,
    /// How far the part had moved when this was read, world: the poses are those before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub displacement: Option<PoseFields>,
}

/// A point of the part's outline.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointFields {
    /// Where it was felt, world, m.
    pub at: [f64; 2],
    /// How far the part had moved when this was read, world: the poses are those before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub displacement: Option<PoseFields>,
}

/// An ellipse about the part frame's origin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EllipseFields {
    /// Half its length along x, m.
    pub a: Positive,
    /// Half its length along y, m.
    pub b: Positive,
}

/// Where the part can be.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct InscriptionAnswer {
    /// Whether there are poses.
    pub status: InscriptionStatus,
    /// Why not, where the status is not `ok`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// All poses that touch every line, by increasing theta in [0, 2π).
    pub poses: Vec<PoseFields>,
    /// How well the lines hold each pose: an error e of the lines moves it by about e / conditioning (x, y, size·theta).
    pub conditioning: Vec<f64>,
    /// Indices of poses, those together in which a symmetric part looks the same.
    pub groups: Vec<Vec<usize>>,
    /// With `sigma` or touches: the most likely poses, best first; all whose chi2 is inside the 99 % gate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub modes: Option<Vec<ModeFields>>,
    /// With `sigma` or touches: readings less the three unknowns; with touches negative where there are fewer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dof: Option<i64>,
}

/// A pose that explains readings with noise.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct ModeFields {
    /// The most likely pose hereabouts.
    pub pose: PoseFields,
    /// Squared residuals over sigma², summed.
    pub chi2: f64,
    /// Of x, y, theta: m², m·rad, rad².
    pub covariance: [[f64; 3]; 3],
    /// Two corners are outermost at once for some sensor: errors are not normally distributed.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub at_corner_change: bool,
}

/// What lines say about the pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Status")]
pub enum InscriptionStatus {
    /// There are poses.
    Ok,
    /// There is none.
    NoPose,
    /// The lines leave a continuum of poses.
    Underdetermined,
}

impl From<inscription::Pose> for PoseFields {
    fn from(pose: inscription::Pose) -> Self {
        Self { x: pose.x, y: pose.y, theta: pose.theta }
    }
}

impl Problem for Inscription {
    const KIND: &'static str = "inscription";
    type Answer = InscriptionAnswer;

    fn solve(&self) -> Result<InscriptionAnswer, SolveError> {
        Ok(self.solve_until(&never)?.found)
    }

    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<InscriptionAnswer>, SolveError> {
        if self.is_touched() {
            return self.solve_touched(stop);
        }
        let outline = self.outline()?;
        let readings = self.readings()?;
        let (lines, points) = (readings.lines(), self.points());
        let exact = match outline.poses(&lines, &points) {
            inscription::Inscription::Poses(poses) => poses,
            inscription::Inscription::Underdetermined(continuum) => {
                return Ok(Searched { found: self.underdetermined(continuum), complete: true });
            }
        };
        let searched = match (self.sigma, &outline) {
            (Some(_), Outline::Polygon(part)) => {
                let searched = inscription::estimate_until(part, &readings, stop);
                Some(searched.map_err(|error| SolveError::Internal(error.to_string()))?)
            }
            _ => None,
        };
        let complete = searched.as_ref().is_none_or(|searched| searched.complete);
        let estimate = searched.map(|searched| searched.found);
        if !complete && estimate.as_ref().is_some_and(|estimate| estimate.modes.is_empty()) {
            return Err(SolveError::Stopped);
        }
        let found = estimate.as_ref().map_or(exact.len(), |estimate| estimate.modes.len());
        let status = if found == 0 { InscriptionStatus::NoPose } else { InscriptionStatus::Ok };
        let why = || match (self.sigma, &outline) {
            (Some(_), _) => "no pose explains the bearings at this sigma".to_owned(),
            (None, Outline::Polygon(part)) if points.is_empty() => self.nearest(part, &lines),
            _ => "no pose touches all lines and passes through all points".to_owned(),
        };
        let found = InscriptionAnswer {
            status,
            reason: (found == 0).then(why),
            conditioning: exact.iter().map(|pose| outline.conditioning(&lines, &points, pose)).collect(),
            groups: outline.congruent_groups(&exact),
            poses: exact.into_iter().map(PoseFields::from).collect(),
            dof: estimate.as_ref().map(|estimate| i64::try_from(estimate.dof).unwrap_or(i64::MAX)),
            modes: estimate.map(|estimate| estimate.modes.iter().map(ModeFields::from).collect()),
        };
        Ok(Searched { found, complete })
    }
}

impl From<&inscription::PoseMode> for ModeFields {
    fn from(mode: &inscription::PoseMode) -> Self {
        let row = |k: usize| [mode.covariance[(k, 0)], mode.covariance[(k, 1)], mode.covariance[(k, 2)]];
        let covariance = [row(0), row(1), row(2)];
        let inscription::PoseMode { pose, chi2, at_corner_change, .. } = *mode;
        Self { pose: pose.into(), chi2, covariance, at_corner_change }
    }
}

/// Semi-axes of a part that can be computed with, m.
const SEMI_AXES: std::ops::RangeInclusive<f64> = 1e-9..=1e9;

/// An ellipse this many times as long as wide is a mistake of units: its ends are sharper than its size can be measured.
const ELLIPSE_RATIO_MAX: f64 = 1000.0;

impl Inscription {
    fn outline(&self) -> Result<Outline, InvalidInput> {
        let outline = match (&self.polygon, self.ellipse) {
            (Some(_), Some(_)) => return Err(InvalidInput::exclusive("polygon", "ellipse")),
            (None, None) => return Err(InvalidInput::missing("polygon", "give the part's outline")),
            (None, Some(ellipse)) => Outline::Ellipse(self.ellipse(ellipse)?),
            (Some(polygon), None) => match self.rounding {
                Some(radius) if radius.get() > 0.0 => {
                    Outline::Rounded(inscription::Rounded { polygon: self.part(polygon)?, radius: radius.get() })
                }
                _ => Outline::Polygon(self.part(polygon)?),
            },
        };
        self.check_readings_of(&outline)?;
        Ok(outline)
    }

    fn part(&self, polygon: &Polygon) -> Result<ConvexPolygon, InvalidInput> {
        let part = ConvexPolygon::new(polygon);
        match part {
            Err(_) if self.hull && !self.points.is_empty() => Err(InvalidInput::at(
                "points",
                "a point of a notched part may lie in a notch, where no hull tells: leave the points or the notches out",
            )),
            Err(_) if self.hull => Ok(ConvexPolygon::hull(polygon)),
            part => part.map_err(|error| {
                InvalidInput::at(
                    Pointer::from("polygon").index(error.vertex),
                    format!("{error}; `\"hull\": true` takes the hull"),
                )
            }),
        }
    }

    fn ellipse(&self, EllipseFields { a, b }: EllipseFields) -> Result<inscription::Ellipse, InvalidInput> {
        let (a, b) = (a.get(), b.get());
        for (key, axis) in [("a", a), ("b", b)] {
            if !SEMI_AXES.contains(&axis) {
                let limit = format!("from {:e} to {:e}", SEMI_AXES.start(), SEMI_AXES.end());
                return Err(InvalidInput::out_of_range(axis, &limit, "give m").inside(key).inside("ellipse"));
            }
        }
        let ratio = (a / b).max(b / a);
        if ratio > ELLIPSE_RATIO_MAX {
            let limit = format!(
                "the ellipse is {ratio:e} times as long as wide, the limit is {ELLIPSE_RATIO_MAX}: check its axes"
            );
            return Err(InvalidInput::at("ellipse", limit));
        }
        match (self.rounding, self.hull) {
            (Some(_), _) => Err(InvalidInput::exclusive("ellipse", "rounding")),
            (None, true) => Err(InvalidInput::exclusive("ellipse", "hull")),
            (None, false) => Ok(inscription::Ellipse { a, b }),
        }
    }

    /// Refuses what is not answered for an outline or in a combination.
    fn check_readings_of(&self, outline: &Outline) -> Result<(), InvalidInput> {
        let smooth = !matches!(outline, Outline::Polygon(_));
        match (self.sigma, self.points.is_empty()) {
            (Some(_), _) if smooth => {
                Err(InvalidInput::at("sigma", "errors are estimated for polygons only: give one with many vertices"))
            }
            (None, false) if smooth => {
                Err(InvalidInput::at("points", "points are solved for polygons only: give one with many vertices"))
            }
            (Some(_), false) => Err(InvalidInput::at(
                "points",
                "points are exact, and cannot be given together with `sigma`: leave one of them out",
            )),
            _ => Ok(()),
        }
    }

    fn points(&self) -> Vec<Point2<f64>> {
        let undone = |point: &PointFields| {
            let at = Point2::from(point.at);
            point.displacement.map_or(at, |pose| pose.world_from_part().inverse() * at)
        };
        self.points.iter().map(undone).collect()
    }

    /// What the sensors say, all moved to where the part was at first.
    fn readings(&self) -> Result<NoisyReadings, InvalidInput> {
        let bearings = self.bearings()?;
        let fences: Vec<_> = self.half_planes.iter().map(HalfPlaneFields::half_plane).collect();
        if bearings.is_empty() && fences.is_empty() && self.points.is_empty() {
            return Err(InvalidInput::missing(
                "cones",
                "give at least one cone, half-plane or point that the part touches",
            ));
        }
        Ok(NoisyReadings { bearings, fences, sigma: self.sigma.map_or(0.0, Sigma::get) })
    }

    /// The sides of all cones.
    pub(super) fn bearings(&self) -> Result<Vec<Bearing>, InvalidInput> {
        let mut bearings = Vec::with_capacity(2 * self.cones.len());
        for (index, cone) in self.cones.iter().enumerate() {
            bearings.extend(cone.bearings().map_err(|error| {
                InvalidInput::at(Pointer::from("cones").index(index), format!("cone {index}: {error}"))
            })?);
        }
        Ok(bearings)
    }

    fn underdetermined(&self, continuum: Continuum) -> InscriptionAnswer {
        let with_sigma = self.sigma.is_some();
        let readings = 2 * self.cones.len() + self.half_planes.len();
        InscriptionAnswer {
            status: InscriptionStatus::Underdetermined,
            reason: Some(continuum.to_string()),
            poses: Vec::new(),
            conditioning: Vec::new(),
            groups: Vec::new(),
            modes: with_sigma.then(Vec::new),
            dof: with_sigma.then(|| i64::try_from(readings.saturating_sub(3)).unwrap_or(i64::MAX)),
        }
    }

    /// What keeps the nearest candidate from being a pose.
    fn nearest(&self, part: &ConvexPolygon, lines: &[HalfPlane]) -> String {
        let misses = inscription::nearest_misses(part, lines);
        let Some((_, line, miss)) = misses.first() else {
            return "in no orientation can the part touch even three of the lines".to_owned();
        };
        let name = match (line / 2, line % 2) {
            (cone, side) if cone < self.cones.len() => {
                format!("the {} side of cone {cone}", if side == 0 { "right" } else { "left" })
            }
            _ => format!("the line of half-plane {}", line - 2 * self.cones.len()),
        };
        let (verb, distance) = (if *miss > 0.0 { "crosses" } else { "stays clear of" }, miss.abs());
        format!(
            "no pose touches all lines: the nearest {verb} {name} by {distance:.3e} m; give `sigma` if the readings have errors"
        )
    }
}

impl ConeFields {
    /// Its sides, moved to where the part was at first.
    fn bearings(&self) -> Result<[Bearing; 2], ConeError> {
        let [right, left] = inscription::Cone::new(Point2::from(self.apex), self.right, self.left)?.bearings();
        let undone = |displacement: Option<PoseFields>, bearing: Bearing| match displacement {
            None => bearing,
            Some(pose) => bearing.moved(&pose.world_from_part().inverse()),
        };
        let left_displacement = self.displacement_left.or(self.displacement);
        Ok([undone(self.displacement, right), undone(left_displacement, left)])
    }
}

impl HalfPlaneFields {
    pub(super) fn half_plane(&self) -> HalfPlane {
        let line = HalfPlane::new(self.normal_angle, self.offset);
        self.displacement.map_or(line, |pose| line.moved(&pose.world_from_part().inverse()))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::solve::read;

    const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

    fn views() -> Value {
        json!([{"apex": [-2.0, 0.3], "right": -0.148_889_947_609_497_1, "left": 0.336_674_819_386_727_3},
               {"apex": [0.4, -3.0], "right": 1.373_400_766_945_015_7, "left": 1.703_347_859_091_570_7}])
    }

    fn answer(problem: Value) -> Result<InscriptionAnswer, String> {
        let solved = read::<Inscription>(problem).map_err(SolveError::from).and_then(|problem| problem.solve());
        solved.map_err(|error| match error {
            SolveError::InvalidInput(error) => error.to_string(),
            other => panic!("{other}"),
        })
    }

    fn refuse(problem: Value) -> String {
        answer(problem).unwrap_err()
    }

    #[test]
    fn a_square_has_its_four_poses_in_one_group() {
        let answer = answer(json!({"polygon": SQUARE, "cones": views()})).unwrap();
        assert_eq!((answer.status, answer.poses.len()), (InscriptionStatus::Ok, 4));
        assert_eq!(answer.groups, [[0, 1, 2, 3]]);
        assert!(answer.conditioning.iter().all(|sigma| (0.1..2.0).contains(sigma)), "{:?}", answer.conditioning);
    }

    #[test]
    fn every_bad_polygon_has_a_message_of_its_own() {
        let cases = [
            (json!([[0, 0], [0, 1], [1, 1], [1, 0]]), "clockwise"),
            (json!([[0, 0], [1, 0], [0.3, 0.3], [0, 1]]), "vertex 2 lies"),
            (json!([[0, 0], [1, 0], [1, 0], [0, 1]]), "vertex 2 repeats vertex 1"),
            (json!([[0, 0], [1, 0], [2, 0], [3, 0]]), "all 4 vertices lie on one line"),
            // Turns left at every vertex, twice round.
            (json!([[1, 0], [-0.81, 0.59], [0.31, -0.95], [0.31, 0.95], [-0.81, -0.59]]), "crosses or touches"),
            (json!([[0, 0], [1, 0], [0, 1], [0, 0]]), "repeats the first"),
            (json!([[0, 0], [1, 0], [0.5, 1e-13]]), "too thin"),
            (json!([[0, 0], [1e-12, 0], [0, 1e-12]]), "check its units"),
            (json!([[0, 0], [1, 0]]), "at least 3 vertices"),
            (json!([]), "at least 3 vertices"),
            (json!([[0, 0], [1, 0], [0, "NaN"]]), "finite number"),
            (json!([[0, 0], [1e300, 0], [0, 1]]), "beyond the limit"),
            (json!([[0, 0], [1, 0], [1, 1], [1, 2], [1, 1], [0, 1]]), "spike"),
        ];
        for (polygon, wanted) in cases {
            let message = refuse(json!({"polygon": polygon, "cones": views()}));
            assert!(message.contains("/polygon") && message.contains(wanted), "{polygon}: {message}");
        }
        let notched = json!([[0, 0], [1, 0], [0.3, 0.3], [0, 1]]);
        assert!(answer(json!({"polygon": notched, "cones": views(), "hull": true})).is_ok());
    }

    #[test]
    fn every_bad_cone_has_a_message_of_its_own() {
        let cone = |right: f64, left: f64| json!([{"apex": [-2.0, 0.3], "right": right, "left": left}]);
        let cases = [
            (cone(0.4, -0.2), "/cones/0", "swapped"),
            (cone(-0.2, 3.2), "/cones/0", "must be below π"),
            (cone(0.0, std::f64::consts::PI), "/cones/0", "must be below π"),
            (cone(0.4, 0.4), "/cones/0", "no opening"),
            (cone(0.4, 0.4 + std::f64::consts::TAU), "/cones/0", "no opening"),
            (json!([{"apex": [0, 0], "right": 0.0}]), "/cones/0/left", "missing"),
            (json!([{"apex": [0], "right": 0.0, "left": 1.0}]), "/cones/0/apex", "length 2"),
            (json!([]), "/cones", "at least one cone"),
        ];
        for (cones, place, wanted) in cases {
            let message = refuse(json!({"polygon": SQUARE, "cones": cones}));
            assert!(message.contains(place) && message.contains(wanted), "{cones}: {message}");
        }
        assert!(refuse(json!({"polygon": SQUARE, "cones": views(), "sigma": -1})).contains("/sigma"));
    }

    #[test]
    fn a_cone_may_be_given_past_a_full_turn() {
        let cone = json!([{"apex": [2.0, 0.0], "right": 3.0, "left": -3.0}]);
        assert_eq!(
            answer(json!({"polygon": SQUARE, "cones": cone})).unwrap().status,
            InscriptionStatus::Underdetermined
        );
    }

    #[test]
    fn a_part_that_moved_between_views_is_found_where_it_was() {
        let still = answer(json!({"polygon": SQUARE, "cones": views()})).unwrap();
        // Seen from one sensor, before and after the belt carried the part and turned it.
        let (shift, turn) = ([0.3, -0.2], 0.4_f64);
        let mut cones = views();
        let motion = nalgebra::Isometry2::new(shift.into(), turn);
        let apex = motion * Point2::new(0.4, -3.0);
        cones[1] = json!({"apex": [apex.x, apex.y], "right": 1.373_400_766_945_015_7 + turn, "left": 1.703_347_859_091_570_7 + turn,
                          "displacement": [shift[0], shift[1], turn]});
        let moved = answer(json!({"polygon": SQUARE, "cones": cones})).unwrap();
        assert_eq!(moved.poses.len(), still.poses.len());
        for (a, b) in moved.poses.iter().zip(&still.poses) {
            assert!((a.x - b.x).hypot(a.y - b.y) < 1e-9 && (a.theta - b.theta).abs() < 1e-9, "{a:?} {b:?}");
        }
    }

    #[test]
    fn a_probed_point_takes_the_place_of_a_third_line() {
        let lines = json!([{"normal_angle": -std::f64::consts::FRAC_PI_2, "offset": 0.0}, {"normal_angle": std::f64::consts::PI, "offset": 0.0}]);
        let block = json!([[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]]);
        let problem = json!({"polygon": block, "half_planes": lines, "points": [{"at": [0.06, 0.015]}]});
        let still = answer(problem.clone()).unwrap();
        assert!(still.poses.iter().any(|pose| pose.x.hypot(pose.y) < 1e-9 && pose.theta < 1e-9), "{:?}", still.poses);
        assert_eq!((still.status, still.conditioning.len()), (InscriptionStatus::Ok, still.poses.len()));
        // Felt after the part was moved away.
        let mut moved = problem.clone();
        moved["points"] = json!([{"at": [0.16, 0.215], "displacement": [0.1, 0.2, 0.0]}]);
        let moved = answer(moved).unwrap();
        assert_eq!(moved.poses.len(), still.poses.len());
        // Far away no pose passes through it, and without the wall too little is known.
        let mut far = problem.clone();
        far["points"][0]["at"] = json!([0.5, 0.5]);
        assert_eq!(answer(far).unwrap().status, InscriptionStatus::NoPose);
        let mut little = problem;
        little["half_planes"] = json!([lines[0]]);
        let little = answer(little).unwrap();
        assert_eq!(little.status, InscriptionStatus::Underdetermined);
        assert!(little.reason.unwrap().contains("1 distinct lines and 1 points"));
    }

    #[test]
    fn smooth_parts_are_inscribed_by_their_support_function() {
        let jaws = json!([{"normal_angle": 0.0, "offset": 0.07}, {"normal_angle": std::f64::consts::PI, "offset": 0.0},
                          {"normal_angle": -std::f64::consts::FRAC_PI_2, "offset": 0.0}]);
        let ellipse = answer(json!({"ellipse": {"a": 0.04, "b": 0.03}, "half_planes": jaws})).unwrap();
        assert_eq!((ellipse.poses.len(), ellipse.groups.len()), (4, 2));
        // √((0.07/2)² − 0.03²) over √(0.04² − 0.03²) is |cos θ|.
        let cos = ((0.035_f64.powi(2) - 0.0009) / 0.0007).sqrt();
        assert!(ellipse.poses.iter().all(|pose| (pose.theta.cos().abs() - cos).abs() < 1e-9), "{:?}", ellipse.poses);
        let square = answer(json!({"polygon": SQUARE, "rounding": 0.1, "half_planes": [
            {"normal_angle": 0.0, "offset": 1.1}, {"normal_angle": std::f64::consts::PI, "offset": 0.1},
            {"normal_angle": -std::f64::consts::FRAC_PI_2, "offset": 0.1}]}))
        .unwrap();
        assert!(square.poses.iter().any(|pose| pose.x.hypot(pose.y) < 1e-9), "{:?}", square.poses);
        let disk = answer(json!({"ellipse": {"a": 0.035, "b": 0.035}, "half_planes": jaws})).unwrap();
        assert_eq!(disk.status, InscriptionStatus::Underdetermined);
    }

    #[test]
    fn outlines_and_readings_that_do_not_go_together_are_refused() {
        let cases = [
            (json!({"cones": views()}), "/polygon", "is missing"),
            (json!({"polygon": SQUARE, "ellipse": {"a": 1, "b": 2}, "cones": views()}), "/ellipse", "together"),
            (json!({"ellipse": {"a": 1, "b": 0}, "cones": views()}), "/ellipse/b", "> 0"),
            (json!({"ellipse": {"a": 1, "b": 1e-9}, "cones": views()}), "/ellipse", "times as long as wide"),
            (json!({"ellipse": {"a": 1, "b": 2}, "rounding": 0.1, "cones": views()}), "/rounding", "together"),
            (json!({"ellipse": {"a": 1, "b": 2}, "cones": views(), "sigma": 0.01}), "/sigma", "polygons only"),
            (json!({"polygon": SQUARE, "rounding": -1, "cones": views()}), "/rounding", "≥ 0"),
            (json!({"polygon": SQUARE, "rounding": 0.1, "points": [{"at": [0, 0]}]}), "/points", "polygons only"),
            (
                json!({"polygon": SQUARE, "cones": views(), "sigma": 0.01, "points": [{"at": [0, 0]}]}),
                "/points",
                "exact",
            ),
            (
                json!({"polygon": [[0, 0], [1, 0], [0.3, 0.3], [0, 1]], "hull": true, "points": [{"at": [0, 0]}]}),
                "/points",
                "notch",
            ),
        ];
        for (problem, place, wanted) in cases {
            let message = refuse(problem.clone());
            assert!(message.contains(place) && message.contains(wanted), "{problem}: {message}");
        }
    }

    #[test]
    fn one_cone_is_underdetermined_and_says_why() {
        for sigma in [json!(null), json!(0.01)] {
            let mut problem = json!({"polygon": SQUARE, "cones": [views()[0]]});
            if !sigma.is_null() {
                problem["sigma"] = sigma;
            }
            let answer = answer(problem).unwrap();
            assert_eq!(answer.status, InscriptionStatus::Underdetermined);
            assert!(answer.reason.unwrap().contains("another view"));
        }
    }

    #[test]
    fn where_there_is_no_pose_the_nearest_is_described() {
        let box_ = json!([{"normal_angle": 0.0, "offset": 1.01}, {"normal_angle": std::f64::consts::PI, "offset": 0.0},
                          {"normal_angle": -std::f64::consts::FRAC_PI_2, "offset": 0.0}, {"normal_angle": std::f64::consts::FRAC_PI_2, "offset": 1.5}]);
        let answer = answer(json!({"polygon": SQUARE, "half_planes": box_})).unwrap();
        assert_eq!(answer.status, InscriptionStatus::NoPose);
        assert!(answer.reason.unwrap().contains("half-plane"));
    }
}
