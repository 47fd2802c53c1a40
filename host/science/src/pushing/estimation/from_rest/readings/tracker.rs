//! Follows a push while it goes on, by force: one reading in, every hypothesis a step further out.
//!
//! What is possible is searched for as [`super::estimate_until`] does, in the first readings of a contact and again in more of
//! them; each answer is then followed from reading to reading (`followed`), which costs a few short simulations. A search
//! takes as long as it takes: it is handed out as a [`SearchTask`] that may run elsewhere while the last hypotheses are
//! followed, and what it finds is taken on to now a few readings at a time. Where nothing explains the readings any more, what
//! was read lately is searched, of a part that moves already; so does a tracker that begins in the middle of a push.
//!
//! Before a push from rest is searched the force must have bent from a line, and where more places explain it than can be
//! followed, none is: a straight push tells too little. That is an answer too ([`TrackerState::Ambiguous`]).
//!
//! Assumes: readings in the order of time, white noise; an outline that is not known exactly counts as noise here. Frames:
//! world axes. Units: SI. Errors: none; "nothing explains the readings" is an answer.

mod followed;
#[cfg(test)]
mod tests;

use std::f64::consts::PI;

use nalgebra::{Isometry2, Matrix6, SVector, Vector2};

use followed::{Followed, Stretch};

use super::{FeltPush, ForceReading, KnownOfFinger, listed, turned_covariance, turns};
use crate::geometry::Pose;
use crate::math::angle::wrap_angle;
use crate::math::least_squares::NormalEquations;
use crate::math::statistics::chi_square_quantile;
use crate::math::unscented::Gaussian;
use crate::pushing::dynamics::{ContactMode, Part};
use crate::pushing::estimation::from_rest::symmetry;
use crate::pushing::estimation::hypotheses;
use crate::search::{Halt, Stop};

/// What the first searches of a contact go by, s since it was first read: the first answer soon, and again when a finger
/// that turns aside has told more.
const SEARCHES_S: [f64; 3] = [0.25, 0.5, 0.9];

/// What a search goes by that begins in the middle, s: what happened before is forgotten in less.
const RECENT_S: f64 = 0.5;

/// From a search that found nothing, or too much, to the next, s.
const AGAIN_S: f64 = 0.25;

/// More explanations are samples of a continuum: none of them may be where the part is. They are not followed.
const EXPLANATIONS_MAX: usize = 40;

/// Force that goes on as a line tells hardly more than four numbers, and a push has as many unknowns: it is searched so long
/// after a line has failed, s, or at the last time that searches are due.
const AFTER_LINE_S: f64 = 0.1;

/// Chance has a line fail once in so many times.
const LINE_CHANCE: f64 = 1e-4;

/// Readings kept, s: what the longest search goes by, and what comes while it runs.
const KEPT_S: f64 = 4.0;

/// Steps by which the hypotheses of a search are taken nearer to now with every new reading: at 30 µs each less than the 8 ms
/// in which the next one comes.
const STEPS_EACH: usize = 250;

/// Fewer readings tell no push.
const READINGS_MIN: usize = 12;

/// But no fewer readings than this, or they would never be at the last.
const READINGS_EACH_MIN: usize = 2;

/// Hypotheses at the most: at 30 µs each a step takes 8 ms. Where there are more, neighbours are joined: of those that would be
/// left out the pose would be told too narrowly.
const HYPOTHESES_MAX: usize = 256;

/// Hypotheses that are joined are looked for so much further apart each time, until they are few enough.
const WIDER: f64 = 1.5;

/// One whose probability is this share of the best one's is followed no further.
const NEGLIGIBLE: f64 = 1e-5;

/// Nearer than this two hypotheses are one: rad, m, rad/s.
const SAME: [f64; 3] = [2e-3, 1e-4, 0.05];

/// Readings by which the best hypothesis is judged.
const JUDGED: usize = 25;

/// Chance has them misfit so once in so many times.
const JUDGED_CHANCE: f64 = 1e-9;

/// A force of so many standard deviations is one.
const LOUD: f64 = 6.0;

/// A contact that begins so long after the finger's motion is one of a moving finger, s.
const FROM_REST_S: f64 = 0.05;

/// For so long a moving finger that meets a part says nothing that the model of a push explains, s.
const IMPACT_S: f64 = 0.02;

/// So many readings in a row without force say that the contact is lost.
const QUIET_IN_A_ROW: usize = 5;

/// What a tracker is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrackerState {
    /// Nothing is felt, or no longer.
    NoContact,
    /// What is felt is not explained yet, or no longer.
    Searching,
    /// So many poses explain it that they cannot be followed: the finger is to turn aside, or to go on.
    Ambiguous,
    /// Hypotheses are followed, and are behind the readings.
    CatchingUp,
    /// They are at the last reading.
    Following,
}

/// Pose and motion of a part at the last reading that it was followed to.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackedHypothesis {
    /// The edge that holds the contact.
    pub edge: usize,
    /// Of the part.
    pub pose: Pose,
    /// Of its centre of mass, m/s.
    pub velocity: Vector2<f64>,
    /// rad/s.
    pub omega: f64,
    /// Of x, y, theta of the pose, the velocity, and ω.
    pub covariance: Matrix6<f64>,
    /// Rolling or sliding.
    pub contact: ContactMode,
    /// kg.
    pub mass: f64,
    /// Standard deviation of its logarithm.
    pub mass_log_sd: f64,
    /// None where it is unknown and the contact never slipped.
    pub mu_c: Option<f64>,
    /// Among the hypotheses.
    pub probability: f64,
}

impl TrackedHypothesis {
    /// Standard deviations: of the centre of mass (m, both directions together) and of the angle (rad).
    #[must_use]
    pub fn spread(&self, part: &Part) -> (f64, f64) {
        hypotheses::spread(part, &self.pose, &self.covariance.fixed_view::<3, 3>(0, 0).into_owned())
    }
}

/// A search that is to be made, wherever there is time for it.
#[derive(Clone, Debug)]
pub struct SearchTask {
    readings: Vec<ForceReading>,
    is_moving: bool,
}

/// What a search found.
#[derive(Clone, Debug)]
pub struct Found {
    /// How many places explain what was read.
    explanations: usize,
    /// At the last reading that it went by; nothing where there are too many to follow.
    followed: Vec<Followed>,
    /// That, s.
    time: f64,
}

impl SearchTask {
    /// Searches. What it is stopped before it has found is missing.
    #[must_use]
    pub fn run(&self, known: &KnownOfFinger, stop: Stop<'_>) -> Found {
        let known = KnownOfFinger { is_moving: self.is_moving, ..*known };
        let halt = Halt::new(stop);
        let time = self.readings.last().map_or(f64::NEG_INFINITY, |reading| reading.time);
        let Some(push) = FeltPush::new(&known, &self.readings, None) else {
            return Found { explanations: 0, followed: Vec::new(), time };
        };
        let concluded = listed(push.all(false, &halt));
        let explanations = concluded.len();
        let few = if explanations <= EXPLANATIONS_MAX { &concluded[..] } else { &[] };
        let rolled = halt.each(few.iter().collect(), |found| push.rolled_as_well(found, &few[0], &halt));
        let all: Vec<_> = few.iter().chain(rolled.iter().flatten()).collect();
        let followed = halt.each(all, |found| Followed::all_of(found, &push, time));
        Found { explanations, followed: kept(followed.into_iter().flatten().collect()), time }
    }
}

/// Follows a push by force.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::geometry::SimplePolygon;
/// use palpate::pushing::dynamics::Part;
/// use palpate::pushing::estimation::from_rest::readings::{ForceReading, ForceTracker, KnownOfFinger, TrackerState};
/// use palpate::pushing::finger_motion::{FingerMotion, Segment};
/// use palpate::pushing::pushed_world::PushedWorld;
/// use palpate::never;
///
/// let wedge = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.02, 0.025], [-0.03, 0.01]].map(Point2::from))?;
/// let part = Part::uniform(wedge);
/// let ahead = Segment { seconds: 0.3, acceleration: Vector2::new(0.02, 0.15) };
/// let aside = Segment { seconds: 0.5, acceleration: Vector2::new(0.15, 0.0) };
/// let motion = FingerMotion::new(Point2::origin(), &[ahead, aside])?;
/// let (mu_g, mass, mu_c, radius) = (0.3 * 9.81, 0.2, 0.3, 0.01);
/// let played = PushedWorld { part: &part, mu_g, mass, mu_c, radius, motion: &motion, edge: 0, u: 1.6, s: 0.012 }.play()?;
///
/// let mut known = KnownOfFinger::new(&part, mu_g, radius, &motion, 2e-3);
/// (known.mass, known.mu_c) = (Some(mass), Some(mu_c));
/// let mut tracker = ForceTracker::new(&known);
/// for reading in (1..79).map(f64::from).map(|k| ForceReading { time: 0.01 * k, force: played.force_finger(0.01 * k) }) {
///     tracker.take(&known, reading);
///     if let Some(task) = tracker.search_due() {
///         tracker.adopt(&known, task.run(&known, &never));
///     }
/// }
/// assert_eq!(tracker.state(), TrackerState::Following);
/// let best = &tracker.hypotheses(&known)[0];
/// let truth = played.pose(tracker.time()).ok_or("it ended early")?;
/// assert!((best.pose.isometry().translation.vector - truth.translation.vector).norm() < 1e-3); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ForceTracker {
    /// Of the contact, the oldest first.
    readings: Vec<ForceReading>,
    /// When the contact was first read, s.
    begun: Option<f64>,
    /// Whether what is searched begins from rest.
    from_rest: bool,
    /// Readings without force until now.
    quiet: usize,
    /// Searches of this contact that were begun, and when the next is due, s.
    searches: usize,
    next_search: Option<f64>,
    is_searching: bool,
    /// When the readings of a push from rest were first more than a line, s.
    bent: Option<f64>,
    /// What the last search found that is not followed.
    explanations: usize,
    hypotheses: Vec<Followed>,
    /// Those of a search, on their way to now.
    arriving: Vec<Followed>,
    /// Misfits of the best one at the last readings.
    misfits: Vec<f64>,
    symmetry: usize,
}

impl ForceTracker {
    /// Waits for a contact: where nothing was felt of late, of a part at rest when the finger begins to move; where
    /// [`KnownOfFinger::is_moving`] says so, of one that may move already.
    #[must_use]
    pub fn new(known: &KnownOfFinger) -> Self {
        Self {
            readings: Vec::new(),
            begun: None,
            from_rest: !known.is_moving,
            quiet: 0,
            searches: 0,
            next_search: None,
            is_searching: false,
            bent: None,
            explanations: 0,
            hypotheses: Vec::new(),
            arriving: Vec::new(),
            misfits: Vec::new(),
            symmetry: symmetry::order(known.part),
        }
    }

    /// Takes a reading; `known` has the motion at least up to it.
    pub fn take(&mut self, known: &KnownOfFinger, reading: ForceReading) {
        // What the finger's own mass has had read is no contact.
        let acceleration = known.motion.acceleration(reading.time);
        let contact = reading.force + acceleration * known.effective_mass;
        let is_loud = contact.norm() > LOUD * known.noise.hypot(known.effective_mass_sd * acceleration.norm());
        self.quiet = if is_loud { 0 } else { self.quiet + 1 };
        if self.quiet >= QUIET_IN_A_ROW && self.begun.is_some() {
            self.lose();
        }
        if self.begun.is_none() {
            if !is_loud {
                return;
            }
            self.begun = Some(reading.time);
            self.next_search = Some(reading.time + SEARCHES_S[0]);
            // A finger that begins at the part feels it at once.
            self.from_rest &= reading.time < FROM_REST_S;
        }
        if !self.from_rest && self.begun.is_some_and(|begun| reading.time < begun + IMPACT_S) {
            return;
        }
        self.readings.push(reading);
        let old = self.readings.partition_point(|kept| kept.time < reading.time - KEPT_S);
        if old > 0 {
            self.readings.drain(..old);
            // What is left began in the middle.
            self.from_rest = false;
        }
        if self.from_rest && self.bent.is_none() && self.searches < SEARCHES_S.len() && !is_line(known, &self.readings)
        {
            self.bent = Some(reading.time);
        }
        // Without force it is not known yet whether the contact is lost.
        if is_loud {
            self.catch_up(known);
            self.judge();
        }
    }

    /// The contact is lost: the part stays where it was, and what comes next is another contact.
    fn lose(&mut self) {
        self.readings.clear();
        (self.begun, self.from_rest, self.next_search, self.bent) = (None, false, None, None);
        (self.searches, self.explanations) = (0, 0);
        self.hypotheses.clear();
        self.arriving.clear();
        self.misfits.clear();
    }

    /// A search that is due; its outcome is to be given to [`Self::adopt`].
    pub fn search_due(&mut self) -> Option<SearchTask> {
        let now = self.readings.last()?.time;
        let due = self.next_search.filter(|due| now >= *due && !self.is_searching)?;
        let latest = self.begun? + SEARCHES_S[SEARCHES_S.len() - 1];
        let told =
            if self.from_rest { self.bent.map_or(latest, |bent| (bent + AFTER_LINE_S).min(latest)) } else { due };
        (now >= told).then(|| self.search())?
    }

    /// A search of what is felt by now, whether due or not: for the end of a push that is not followed.
    pub fn search_now(&mut self) -> Option<SearchTask> {
        (!self.is_searching && self.hypotheses.is_empty() && self.arriving.is_empty()).then(|| self.search())?
    }

    fn search(&mut self) -> Option<SearchTask> {
        let now = self.readings.last().filter(|_| self.readings.len() >= READINGS_MIN)?.time;
        self.is_searching = true;
        self.searches += 1;
        let later = self.begun.zip(SEARCHES_S.get(self.searches)).map(|(begun, later)| begun + later);
        self.next_search = later.filter(|later| *later > now);
        let is_moving = !self.from_rest;
        let first = if is_moving { self.readings.partition_point(|reading| reading.time < now - RECENT_S) } else { 0 };
        Some(SearchTask { readings: self.readings[first..].to_vec(), is_moving })
    }

    /// Takes all hypotheses on to the last reading, however long it takes: for the end of a push.
    pub fn finish(&mut self, known: &KnownOfFinger) {
        while !self.arriving.is_empty() {
            self.catch_up(known);
        }
    }

    /// Takes what a search found instead of what was followed.
    pub fn adopt(&mut self, known: &KnownOfFinger, found: Found) {
        self.is_searching = false;
        // The contact may have been lost meanwhile.
        let Some(begun) = self.begun.filter(|begun| found.time >= *begun) else { return };
        self.explanations = found.explanations;
        if found.followed.is_empty() {
            let now = self.readings.last().map_or(begun, |reading| reading.time);
            let again = now + AGAIN_S;
            self.next_search = Some(self.next_search.map_or(again, |next| next.min(again)));
            // What began from rest, and nothing explains, may have been no such push.
            self.from_rest &= found.explanations > 0 || self.searches < SEARCHES_S.len();
            return;
        }
        self.explanations = 0;
        self.arriving = found.followed;
        self.catch_up(known);
    }

    /// Takes hypotheses on to the last reading, those of a search a few readings at a time.
    fn catch_up(&mut self, known: &KnownOfFinger) {
        let hypotheses = std::mem::take(&mut self.hypotheses);
        self.hypotheses = self.follow(known, hypotheses, usize::MAX);
        if !self.arriving.is_empty() {
            let arriving = std::mem::take(&mut self.arriving);
            let most = (STEPS_EACH / arriving.len()).max(READINGS_EACH_MIN);
            self.arriving = self.follow(known, arriving, most);
            if self.is_at_last(&self.arriving) {
                self.hypotheses = std::mem::take(&mut self.arriving);
                self.misfits.clear();
            }
        }
    }

    fn is_at_last(&self, hypotheses: &[Followed]) -> bool {
        hypotheses.first().zip(self.readings.last()).is_some_and(|(first, last)| first.time >= last.time)
    }

    fn follow(&self, known: &KnownOfFinger, mut hypotheses: Vec<Followed>, most: usize) -> Vec<Followed> {
        let Some(from) = hypotheses.first().map(|first| first.time) else { return hypotheses };
        let next = self.readings.partition_point(|reading| reading.time <= from);
        for reading in self.readings[next..].iter().take(most) {
            let Some(time) = hypotheses.first().map(|first| first.time) else { break };
            let Some(stretch) = Stretch::new(known, time, reading.time) else { break };
            let followed: Vec<_> = hypotheses.iter().filter_map(|it| it.follow(&stretch, reading)).collect();
            let slipped: Vec<_> = followed.iter().flat_map(|it| it.slipped(known)).collect();
            hypotheses = kept(followed.into_iter().chain(slipped).collect());
        }
        hypotheses
    }

    /// Whether the best hypothesis explains the last readings; if not, none does, and it is searched again.
    fn judge(&mut self) {
        if self.searches == 0 {
            return;
        }
        if let Some(best) = self.hypotheses.first() {
            self.misfits.push(best.misfit);
            let old = self.misfits.len().saturating_sub(JUDGED);
            self.misfits.drain(..old);
            // Two degrees of freedom each.
            let most = chi_square_quantile(1.0 - JUDGED_CHANCE, 2 * self.misfits.len());
            if self.misfits.iter().sum::<f64>() > most {
                self.hypotheses.clear();
                self.misfits.clear();
            }
        }
        if self.hypotheses.is_empty() && self.arriving.is_empty() && self.next_search.is_none() && !self.is_searching {
            self.from_rest = false;
            self.next_search = self.readings.last().map(|reading| reading.time + AGAIN_S);
        }
    }

    /// What it is doing.
    #[must_use]
    pub fn state(&self) -> TrackerState {
        match (self.begun, self.hypotheses.is_empty(), self.arriving.is_empty()) {
            (None, ..) => TrackerState::NoContact,
            (_, false, _) => TrackerState::Following,
            (_, true, false) => TrackerState::CatchingUp,
            (_, true, true) if self.explanations > 0 => TrackerState::Ambiguous,
            (_, true, true) => TrackerState::Searching,
        }
    }

    /// How many places explain what the last search went by, where they are [`TrackerState::Ambiguous`].
    #[must_use]
    pub fn explanations(&self) -> usize {
        self.explanations
    }

    /// The last reading of the contact, s; before the first, −∞.
    #[must_use]
    pub fn last(&self) -> f64 {
        self.readings.last().map_or(f64::NEG_INFINITY, |last| last.time)
    }

    /// The reading that the hypotheses are at, or else the last one, s; before the first, −∞.
    #[must_use]
    pub fn time(&self) -> f64 {
        let followed = self.shown().first().map(|first| first.time);
        followed.or(self.readings.last().map(|last| last.time)).unwrap_or(f64::NEG_INFINITY)
    }

    /// Squared deviations by which the likeliest hypothesis misses the last reading, of two degrees of freedom; none where
    /// none is at it. What is far beyond chance counts as a limit.
    #[must_use]
    pub fn misfit(&self) -> Option<f64> {
        self.hypotheses.first().map(|best| best.misfit)
    }

    fn shown(&self) -> &[Followed] {
        if self.hypotheses.is_empty() { &self.arriving } else { &self.hypotheses }
    }

    /// What may be, the likeliest first, at [`Self::time`]: each turn of a symmetric part that nobody can tell apart too.
    #[must_use]
    pub fn hypotheses(&self, known: &KnownOfFinger) -> Vec<TrackedHypothesis> {
        let shown = self.shown();
        let most = shown.first().map_or(0.0, |best| best.log_weight);
        let mut clusters: Vec<Cluster> = Vec::new();
        for it in shown {
            let Some(motion) = it.motion(known) else { continue };
            let member = (it, motion, (it.log_weight - most).exp());
            match clusters.iter_mut().find(|cluster| cluster.has_near(it)) {
                Some(cluster) => cluster.members.push(member),
                None => clusters.push(Cluster { members: vec![member] }),
            }
        }
        let total: f64 = clusters.iter().map(Cluster::weight).sum();
        let mut told: Vec<_> = clusters.iter().flat_map(|cluster| self.told(known, cluster, total)).collect();
        told.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        told
    }

    fn told(&self, known: &KnownOfFinger, cluster: &Cluster, total: f64) -> Vec<TrackedHypothesis> {
        let (best, _, _) = &cluster.members[0];
        let Gaussian { mean, covariance } = cluster.joined();
        let pose = Pose { x: mean[0], y: mean[1], theta: wrap_angle(mean[2]) };
        let turned = turns(known.part, best.edge(known), best.place(), self.symmetry).into_iter();
        let told = |(edge, about): (usize, Isometry2<f64>)| {
            let turned: Pose = (pose.isometry() * about).into();
            TrackedHypothesis {
                edge,
                covariance: turned_covariance(&covariance, &pose, &turned, known.part),
                pose: turned,
                velocity: Vector2::new(mean[3], mean[4]),
                omega: mean[5],
                contact: best.contact(),
                mass: best.mass(),
                mass_log_sd: best.mass_log_sd(),
                mu_c: best.mu_c(),
                probability: cluster.weight() / (total * self.symmetry as f64),
            }
        };
        turned.map(told).collect()
    }
}

/// Hypotheses that are pieces of one, the likeliest first, with how the part moves by each and what it weighs.
struct Cluster<'a> {
    members: Vec<(&'a Followed, Gaussian<6>, f64)>,
}

impl Cluster<'_> {
    fn has_near(&self, it: &Followed) -> bool {
        self.members.iter().any(|(member, ..)| member.is_beside(it))
    }

    fn weight(&self) -> f64 {
        self.members.iter().map(|(.., weight)| weight).sum()
    }

    /// Mean and covariance of all.
    fn joined(&self) -> Gaussian<6> {
        let total = self.weight();
        Gaussian::of_mixture(&self.members.iter().map(|(_, of, weight)| (weight / total, *of)).collect::<Vec<_>>())
    }
}

/// Whether each axis of the force, free of the finger's own mass, is a line.
fn is_line(known: &KnownOfFinger, readings: &[ForceReading]) -> bool {
    let Some(first) = readings.first() else { return true };
    let freedom = 2 * readings.len().saturating_sub(2);
    if freedom == 0 {
        return true;
    }
    let misfit = |axis: usize| {
        let mut equations = NormalEquations::<2>::zero();
        for reading in readings {
            let acceleration = known.motion.acceleration(reading.time);
            let force = (reading.force + acceleration * known.effective_mass)[axis];
            let sd = known.noise.hypot(known.effective_mass_sd * acceleration[axis]);
            equations.add(-force / sd, SVector::from([1.0, reading.time - first.time]) / sd);
        }
        let gained = equations.gauss_newton_step().map(|step| equations.predicted_reduction(&step));
        gained.map_or(0.0, |gained| equations.cost - gained)
    };
    misfit(0) + misfit(1) < chi_square_quantile(1.0 - LINE_CHANCE, freedom)
}

/// The likeliest first, without those that hardly can be, and neighbours as one: those that say the same, and where there are
/// too many to follow, also those that are wider apart.
fn kept(mut hypotheses: Vec<Followed>) -> Vec<Followed> {
    hypotheses.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
    let least = hypotheses.first().map_or(f64::NEG_INFINITY, |best| best.log_weight + NEGLIGIBLE.ln());
    hypotheses.truncate(hypotheses.partition_point(|it| it.log_weight >= least));
    let mut near = SAME;
    hypotheses = joined(hypotheses, &near);
    // Beyond half a turn all of one edge are joined that move alike.
    while hypotheses.len() > HYPOTHESES_MAX && near[0] < PI {
        near = near.map(|near| near * WIDER);
        hypotheses = joined(hypotheses, &near);
    }
    hypotheses.truncate(HYPOTHESES_MAX);
    hypotheses
}

/// Each with those that are so near to it, the likeliest first again.
fn joined(hypotheses: Vec<Followed>, near: &[f64; 3]) -> Vec<Followed> {
    let mut joined: Vec<Vec<Followed>> = Vec::new();
    for next in hypotheses {
        match joined.iter_mut().find(|others| others[0].is_one_with(&next, near)) {
            Some(others) => others.push(next),
            None => joined.push(vec![next]),
        }
    }
    let mut joined: Vec<_> = joined.into_iter().filter_map(Followed::joined).collect();
    joined.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
    joined
}
