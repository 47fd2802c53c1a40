//! What `palpate observe --plot` draws: a push that was observed, of whichever method.

use nalgebra::{Point2, Vector2};
use palpate::finger::contact::Reading;
use palpate::geometry::Pose;
use palpate::math::statistics::chi_square_quantile;
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::Estimate;
use palpate::pushing::estimation::Hypothesis;
use palpate::pushing::estimation::from_rest::readings::{ForceHypothesis, ForceReading, TrackedHypothesis};
use palpate::pushing::estimation::from_rest::{ExplainedForce, KnownFromRest, WindowedForce};
use palpate::pushing::finger_motion::FingerMotion;
use palpate::pushing::pushed_world::Played;

use crate::pictures::observed::{Misfits, ObservedPicture, PossiblePose, ShownForce};
use crate::pictures::plot::Figure;
use crate::width::folded_to;

/// Points of the trail and of the finger's path.
const POINTS: u32 = 120;

/// Forces of a push that was not averaged under windows are averaged over so long for the picture, s: a period of the mains.
const AVERAGED_S: f64 = 0.02;

/// Columns of the lines below the title.
const COLUMNS: usize = 150;

/// Of two degrees of freedom: what chance exceeds once in a hundred readings.
const USUAL: f64 = 0.99;

/// Words and title above a picture.
pub(super) struct Heading {
    /// Above everything.
    pub(super) title: String,
    /// What the answer means.
    pub(super) words: String,
}

impl Heading {
    /// The words as lines of the page.
    fn lines(&self) -> Vec<String> {
        let words = self.words.split_whitespace().collect::<Vec<_>>().join(" ");
        folded_to(&words, COLUMNS).lines().map(str::to_owned).collect()
    }
}

/// Moments from 0 to the end, s.
fn moments(end: f64) -> impl Iterator<Item = f64> {
    (0..=POINTS).map(move |k| end * f64::from(k) / f64::from(POINTS))
}

fn finger(motion: &FingerMotion, end: f64) -> Vec<(f64, Point2<f64>)> {
    moments(end).map(|t| (t, motion.centre(t))).collect()
}

fn trail(played: &Played, end: f64) -> Vec<(f64, Pose)> {
    moments(end.min(played.duration())).filter_map(|t| Some((t, played.pose(t)?.into()))).collect()
}

/// A picture of the finger's way alone, up to a time (s): poses and forces are still to be put in.
fn unfilled<'p>(
    (part, radius): (&'p Part, f64),
    motion: &FingerMotion,
    end: f64,
    heading: &Heading,
) -> ObservedPicture<'p> {
    ObservedPicture {
        part,
        radius,
        finger: finger(motion, end),
        poses: Vec::new(),
        trail: Vec::new(),
        force: Vec::new(),
        misfits: None,
        title: heading.title.clone(),
        subtitles: heading.lines(),
    }
}

/// A push of which all that was felt from rest on was explained at once.
pub(super) fn searched(
    known: &KnownFromRest<'_>,
    force: &WindowedForce,
    estimate: &Estimate,
    heading: &Heading,
) -> Figure {
    let end = estimate.time_end;
    let best = estimate.hypotheses.first();
    let possible =
        |it: &Hypothesis| PossiblePose { probability: it.probability, pose: it.pose_end, covariance: it.covariance };
    let explained = best.map(|best| known.explained(force, best)).unwrap_or_default();
    let shown = |it: &ExplainedForce| ShownForce { time: it.time, felt: it.felt, left: Some([it.left, it.sd]) };
    let force = if explained.is_empty() {
        unexplained(&known.explainable(force))
    } else {
        explained.iter().map(shown).collect()
    };
    let picture = ObservedPicture {
        poses: estimate.hypotheses.iter().map(possible).collect(),
        trail: best.and_then(|best| known.played(best)).map(|played| trail(&played, end)).unwrap_or_default(),
        force,
        ..unfilled((known.part, known.radius), known.motion, end, heading)
    };
    picture.figure()
}

fn unexplained(forces: &[(f64, Vector2<f64>)]) -> Vec<ShownForce> {
    forces.iter().map(|&(time, felt)| ShownForce { time, felt, left: None }).collect()
}

/// A push of a finger whose places were measured; `motion` is what they say, from the onset on.
pub(super) fn measured(
    part: (&Part, f64),
    motion: &FingerMotion,
    readings: &[ForceReading],
    hypotheses: &[&ForceHypothesis],
    played: Option<&Played>,
    heading: &Heading,
) -> Figure {
    let end = readings.last().map_or(0.0, |last| last.time);
    let possible = |it: &&ForceHypothesis| PossiblePose {
        probability: it.probability,
        pose: it.pose_end,
        covariance: Some(it.covariance.fixed_view::<3, 3>(0, 0).into_owned()),
    };
    let effective_mass = hypotheses.first().map_or(0.0, |best| best.effective_mass);
    let of_contact = |it: &ForceReading| (it.time, it.force + motion.acceleration(it.time) * effective_mass);
    let picture = ObservedPicture {
        poses: hypotheses.iter().map(possible).collect(),
        trail: played.map(|played| trail(played, end)).unwrap_or_default(),
        force: unexplained(&readings.iter().map(of_contact).collect::<Vec<_>>()),
        ..unfilled(part, motion, end, heading)
    };
    picture.figure()
}

/// A push of which one pose was followed, without any uncertainty.
pub(super) fn trailed(
    part: (&Part, f64),
    motion: &FingerMotion,
    trail: &[(f64, Pose)],
    felt: &[(f64, Vector2<f64>)],
    heading: &Heading,
) -> Figure {
    let last = trail.last();
    let picture = ObservedPicture {
        poses: last
            .map(|(_, pose)| PossiblePose { probability: 1.0, pose: *pose, covariance: None })
            .into_iter()
            .collect(),
        trail: trail.to_vec(),
        force: unexplained(felt),
        ..unfilled(part, motion, last.map_or(0.0, |(time, _)| *time), heading)
    };
    picture.figure()
}

/// What was told of a push that was followed, reading by reading.
#[derive(Clone, Debug, Default)]
pub(super) struct FollowedHistory {
    /// The likeliest pose of each reading that was followed to, with its time, s.
    pub(super) trail: Vec<(f64, Pose)>,
    /// Its misfit there, squared deviations.
    pub(super) misfits: Vec<[f64; 2]>,
    /// Everything that may be at the last of them.
    pub(super) last: Vec<PossiblePose>,
}

impl FollowedHistory {
    /// Takes what is known at a time, s.
    pub(super) fn take(&mut self, time: f64, hypotheses: &[TrackedHypothesis], misfit: Option<f64>) {
        let Some(best) = hypotheses.first() else { return };
        self.trail.push((time, best.pose));
        self.misfits.extend(misfit.map(|misfit| [time, misfit]));
        let possible = |it: &TrackedHypothesis| PossiblePose {
            probability: it.probability,
            pose: it.pose,
            covariance: Some(it.covariance.fixed_view::<3, 3>(0, 0).into_owned()),
        };
        self.last = hypotheses.iter().map(possible).collect();
    }

    /// Draws it, with the readings of the finger (times since the onset, s) that begins to move so long before it.
    pub(super) fn figure(
        &self,
        part: (&Part, f64),
        motion: &FingerMotion,
        (readings, before_onset): (&[Reading], f64),
        effective_mass: f64,
        heading: &Heading,
    ) -> Figure {
        let end = motion.duration();
        let felt = averaged(readings).into_iter().map(|(t, force)| (t + before_onset, force));
        let felt = felt.filter(|(t, _)| (0.0..=end).contains(t));
        let of_contact = felt.map(|(t, force)| (t, force + motion.acceleration(t) * effective_mass));
        let usual_max = chi_square_quantile(USUAL, 2);
        let picture = ObservedPicture {
            poses: self.last.clone(),
            trail: self.trail.clone(),
            force: unexplained(&of_contact.collect::<Vec<_>>()),
            misfits: Some(Misfits { over_time: self.misfits.clone(), usual_max }),
            ..unfilled(part, motion, self.trail.last().map_or(end, |(time, _)| *time), heading)
        };
        picture.figure()
    }
}

/// Means over [`AVERAGED_S`], with their mean times.
fn averaged(readings: &[Reading]) -> Vec<(f64, Vector2<f64>)> {
    #[expect(clippy::cast_possible_truncation, reason = "seconds over a fiftieth")]
    let number = |reading: &Reading| (reading.t / AVERAGED_S).floor() as i64;
    let mean = |stretch: &[Reading]| {
        let count = stretch.len() as f64;
        let time = stretch.iter().map(|it| it.t).sum::<f64>() / count;
        (time, stretch.iter().map(|it| it.force_finger).sum::<Vector2<f64>>() / count)
    };
    readings.chunk_by(|a, b| number(a) == number(b)).map(mean).collect()
}
