//! A slow push as a person plans it: straight on from a touch, as in [`PushPlan`](super::PushPlan), or along places of
//! the disk's centre.
//!
//! Assumes: see [`palpate::pushing::quasi_static`]. The load at rest is what the part's file says: its feet's, or that of
//! its whole base. Frames: world, which is the part's at first where it is touched, and that of the places where they
//! are given. Units: SI; messages in mm. Errors: [`SlowPlanError`].

use nalgebra::Point2;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::pushing::dynamics::{ModelError, Part};
use palpate::pushing::quasi_static::{SlowPush, SlowPushError, SlowRun, Support};
use palpate::{Pose, never};
use palpate_files::part::{DescribedPart, PartFile};

use super::{ALONG_TOLERANCE, MM, Place, PlanError, Spot, spot, toward};

/// The longest step, m: what is asked for is the limit of short ones, and steps are controlled by their error.
const STEP_MAX: f64 = 0.5e-3;

/// The last sample of a push that ends on the way is this share of the way before, where it is pushed for sure.
const BEFORE_END: f64 = 1e-9;

/// How a finger is to push a part slowly.
#[derive(Clone, Debug, PartialEq)]
pub struct SlowPlan {
    /// The way of the disk's centre.
    pub way: SlowWay,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// Friction between finger and part while it slides, and the largest while it sticks.
    pub contact_friction: [f64; 2],
    /// Of the contact above the table, m.
    pub height: f64,
    /// Of the ring that a foot is, m.
    pub ring_radius: f64,
}

/// The way of the disk's centre.
#[derive(Clone, Debug, PartialEq)]
pub enum SlowWay {
    /// Straight on from a touch of the part as it is drawn.
    Straight {
        /// Edge and place; the edge's middle if not given.
        edge: usize,
        /// See [`Place::Edge`].
        s: Option<f64>,
        /// 0 is straight into the part, rad counter-clockwise.
        direction: f64,
        /// m.
        distance: f64,
    },
    /// Along these places, straight between, to a part that lies here.
    Along {
        /// m.
        places: Vec<Point2<f64>>,
        /// Of the part's own frame.
        pose: Pose,
    },
}

/// What became of a plan.
#[derive(Clone, Debug)]
pub struct SlowlyPushed {
    /// One sample at each of the lengths asked for, up to the end.
    pub run: SlowRun,
    /// How far the finger had gone at each, m.
    pub lengths: Vec<f64>,
    /// Where its centre was then, m.
    pub centres: Vec<Point2<f64>>,
    /// The last sample is where the push ended and not the path.
    pub is_cut: bool,
}

/// A plan that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SlowPlanError {
    /// As of any push.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// Ellipses are pushed in time.
    #[error("the part is an ellipse: slow pushes are of polygons, an ellipse is pushed in time")]
    Ellipse,
    /// Where the path begins the finger is inside the part.
    #[error(
        "the finger overlaps the part by {:.3} mm where the path begins: begin farther away, or check the radius, the path's unit and where the part lies",
        depth * MM
    )]
    Overlap {
        /// How deep, m.
        depth: f64,
    },
    /// Otherwise.
    #[error(transparent)]
    Push(SlowPushError),
}

impl From<SlowPushError> for SlowPlanError {
    fn from(error: SlowPushError) -> Self {
        match error {
            SlowPushError::Overlap { depth } => Self::Overlap { depth },
            other => Self::Push(other),
        }
    }
}

impl From<ModelError> for SlowPlanError {
    fn from(error: ModelError) -> Self {
        Self::Plan(error.into())
    }
}

impl SlowPlan {
    /// Follows the push, and samples it at the start and after each of `parts` equal parts of the way; where it ends on the
    /// way, also there.
    ///
    /// # Errors
    /// [`SlowPlanError`].
    pub fn run(&self, file: &PartFile, parts: u32) -> Result<SlowlyPushed, SlowPlanError> {
        let DescribedPart::Polygon(part) = &file.part else { return Err(SlowPlanError::Ellipse) };
        let (places, pose) = self.places(part, &file.part)?;
        let whole = length(&places);
        let lengths: Vec<_> = (0..=parts).map(|k| whole * f64::from(k) / f64::from(parts)).collect();
        let asked = self.sampled(file, part, &places, pose, &lengths)?;
        let ended = asked.run.length;
        if asked.run.samples.len() == lengths.len() {
            return Ok(asked);
        }
        // Up to the end once more, for what is there; a rounding before it, where it is still pushed.
        let mut lengths: Vec<_> = lengths.into_iter().filter(|length| *length < ended).collect();
        lengths.push(ended * (1.0 - BEFORE_END));
        let run = self.sampled(file, part, &cut(&places, ended), pose, &lengths)?;
        let run = SlowlyPushed { is_cut: true, run: SlowRun { end: asked.run.end, length: ended, ..run.run }, ..run };
        Ok(run)
    }

    fn places(&self, part: &Part, described: &DescribedPart) -> Result<(Vec<Point2<f64>>, Pose), SlowPlanError> {
        match &self.way {
            SlowWay::Along { places, pose } => Ok((places.clone(), *pose)),
            &SlowWay::Straight { edge, s, direction, distance } => {
                if direction.cos() <= ALONG_TOLERANCE {
                    return Err(PlanError::MovesAway { what: "moves", direction }.into());
                }
                let Spot { point, normal, s, .. } = spot(Place::Edge { index: edge, s }, described)?;
                let [s_min, s_max] = part.edge_span(edge)?;
                if !(s_min..=s_max).contains(&s) {
                    return Err(PlanError::BeyondEdge { s, s_min, s_max }.into());
                }
                let begin = point + normal * self.radius;
                let end = begin + toward(normal, direction, distance);
                Ok((vec![begin, end], Pose { x: 0.0, y: 0.0, theta: 0.0 }))
            }
        }
    }

    /// Along the places, with a sample at each of the lengths.
    fn sampled(
        &self,
        file: &PartFile,
        part: &Part,
        places: &[Point2<f64>],
        pose: Pose,
        lengths: &[f64],
    ) -> Result<SlowlyPushed, SlowPlanError> {
        let (path, asked) = with_lengths(places, lengths);
        let push = SlowPush {
            outline: part.polygon().clone(),
            support: Support::of(part.body(), file.mu, self.ring_radius),
            centre_of_mass: None,
            gravity: GRAVITY_ASSUMED,
            height: self.height,
            radius: self.radius,
            contact_friction: self.contact_friction,
            path: path.clone(),
            pose,
            step_max: STEP_MAX,
        };
        let mut run = push.run(&never)?;
        let kept: Vec<_> = asked.into_iter().filter(|index| *index < run.samples.len()).collect();
        let samples = kept.iter().map(|index| run.samples[*index]).collect();
        let centres: Vec<_> = kept.iter().map(|index| path[*index]).collect();
        run.samples = samples;
        Ok(SlowlyPushed { run, lengths: lengths[..centres.len()].to_vec(), centres, is_cut: false })
    }
}

/// Of a path, m.
fn length(places: &[Point2<f64>]) -> f64 {
    places.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
}

/// The path with a point at each of these lengths along it (increasing), and their indices.
fn with_lengths(places: &[Point2<f64>], lengths: &[f64]) -> (Vec<Point2<f64>>, Vec<usize>) {
    let (mut path, mut asked) = (vec![places[0]], Vec::with_capacity(lengths.len()));
    let mut wanted = lengths.iter().copied().peekable();
    while wanted.next_if(|length| *length <= 0.0).is_some() {
        asked.push(0);
    }
    let mut gone = 0.0;
    for pair in places.windows(2) {
        let way = pair[1] - pair[0];
        let on = gone + way.norm();
        while let Some(length) = wanted.next_if(|length| *length < on) {
            path.push(pair[0] + way * ((length - gone) / (on - gone)));
            asked.push(path.len() - 1);
        }
        path.push(pair[1]);
        gone = on;
    }
    // The end, and what rounding put beyond it.
    asked.extend(wanted.map(|_| path.len() - 1));
    (path, asked)
}

/// The path up to a length.
fn cut(places: &[Point2<f64>], end: f64) -> Vec<Point2<f64>> {
    let (path, asked) = with_lengths(places, &[end]);
    path[..=asked[0]].to_vec()
}

#[cfg(test)]
mod tests {
    use palpate::pushing::quasi_static::SlowEnd;

    use super::*;

    const BLOCK: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3";

    fn plan(way: SlowWay) -> SlowPlan {
        SlowPlan { way, radius: 5e-3, contact_friction: [0.2, 0.25], height: 0.0, ring_radius: 1e-3 }
    }

    fn straight() -> SlowPlan {
        plan(SlowWay::Straight { edge: 0, s: Some(0.01), direction: 0.3, distance: 0.02 })
    }

    #[test]
    fn a_way_told_by_its_places_is_the_same_way() {
        let file = PartFile::parse(BLOCK).unwrap();
        let told = straight().run(&file, 10).unwrap();
        let places = vec![told.centres[0], told.centres[4], told.centres[10]];
        let along = plan(SlowWay::Along { places, pose: Pose { x: 0.0, y: 0.0, theta: 0.0 } });
        let along = along.run(&file, 10).unwrap();
        assert_eq!((told.lengths.len(), along.lengths.len()), (11, 11));
        for (a, b) in told.run.samples.iter().zip(&along.run.samples) {
            assert!((a.pose.origin() - b.pose.origin()).norm() < 1e-10 && (a.pose.theta - b.pose.theta).abs() < 1e-10);
        }
        // The finger goes 0.3 rad to the left of straight up, from 10 mm right of below the centre of mass.
        let went = told.centres[10] - told.centres[0];
        assert!((went.y.atan2(went.x) - std::f64::consts::FRAC_PI_2 - 0.3).abs() < 1e-12);
        assert!((told.centres[0] - Point2::new(0.04, -0.005)).norm() < 1e-12);
        assert!(told.run.samples[10].pose.theta > 0.01, "pushed right of its centre it turns counter-clockwise");
    }

    #[test]
    fn a_push_that_ends_on_the_way_is_told_up_to_there() {
        let file = PartFile::parse(BLOCK).unwrap();
        let high = SlowPlan { height: 0.5, ..straight() };
        let notch = "unit = 'mm'\nvertices = [[0, 0], [20, 0], [20, 30], [40, 30], [40, 0], [60, 0], [60, 50], [0, 50]]\nmu = 0.3";
        let notch = PartFile::parse(notch).unwrap();
        let aside = plan(SlowWay::Along {
            places: [[0.024, -0.02], [0.024, 0.02698], [0.06, 0.02698]].map(Point2::from).to_vec(),
            pose: Pose { x: 0.0, y: 0.0, theta: 0.0 },
        });
        let tipped = high.run(&file, 7).unwrap();
        let met = SlowPlan { radius: 3e-3, ..aside }.run(&notch, 9).unwrap();
        assert_eq!((tipped.run.end, met.run.end), (SlowEnd::Tip, SlowEnd::SecondContact), "{met:?}");
        assert_eq!(met.run.samples.len(), met.lengths.len());
        assert!(met.is_cut && (met.lengths.last().unwrap() - met.run.length).abs() < 1e-9);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let file = PartFile::parse(BLOCK).unwrap();
        let run = |way| plan(way).run(&file, 5).unwrap_err().to_string();
        let straight = |edge, s, direction| run(SlowWay::Straight { edge, s, direction, distance: 0.01 });
        assert!(straight(0, Some(0.05), 0.0).contains("beyond the edge"));
        assert!(straight(9, None, 0.0).contains("9 is no edge"));
        assert!(straight(0, None, 2.0).contains("away from it"));
        let places = vec![Point2::new(0.03, 0.001), Point2::new(0.03, 0.01)];
        let inside = run(SlowWay::Along { places, pose: Pose { x: 0.0, y: 0.0, theta: 0.0 } });
        assert!(inside.contains("overlaps the part by 6.000 mm"), "{inside}");
        let egg = PartFile::parse("unit = 'mm'\nellipse = {a = 40, b = 30}\nmu = 0.3").unwrap();
        let way = SlowWay::Straight { edge: 0, s: None, direction: 0.0, distance: 0.01 };
        assert_eq!(plan(way).run(&egg, 5).unwrap_err(), SlowPlanError::Ellipse);
    }
}
