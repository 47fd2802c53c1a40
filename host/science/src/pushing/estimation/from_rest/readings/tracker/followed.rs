//! One hypothesis that is followed from reading to reading: a Gaussian of state and unknown numbers, taken through the
//! simulation by its points.
//!
//! A contact that rolls has no speed of slip, and one that slides slips one way: the Gaussian keeps to what its middle does,
//! and its points may do otherwise in between. A contact that never slipped has a friction of which only a bound is known;
//! when the readings leave what rolling predicts, it may have slipped at one of the last readings, its friction being what
//! rolling took there.
//!
//! Implements: `math::unscented`. Frames: world axes. Units: SI. Errors: none; what can no longer be played is lost.

use std::cmp::Ordering;
use std::collections::VecDeque;
use std::f64::consts::PI;

use nalgebra::{Matrix2, SVector, Vector2, Vector6};

use super::super::super::end::{
    BELIEF, BELIEF_FINGER, BELIEF_MASS, BELIEF_MU_C, BELIEF_MU_G, BELIEF_OMEGA, BELIEF_SLIDE,
};
use super::super::super::fit::{MU_C_MAX, MU_C_MIN, OMEGA_MAX, SLIDE_MAX, SLIDE_MIN};
use super::super::super::friction_along::FrictionAlong;
use super::super::super::path::{Course, CourseStart, Guess, Path, Resolution};
use super::super::read_force::{JUMP_S, MODEL_SHARE};
use super::super::{AtEnd, Concluded, FeltPush, ForceReading, KnownOfFinger, PIECES_APART};
use crate::math::unscented::{Gaussian, Measured, measured};
use crate::pushing::dynamics::ContactMode;
use crate::pushing::estimation::observation::MU_G_LOG_MAX;
use crate::pushing::finger_motion::Leg;

/// What the model may be off by in a second, in the order of [`BELIEF`]: rad, m, rad/s, m/s, of µ_c, of µ g, of the mass, kg. A
/// surface is not the same everywhere, and what is followed for long must not be surer than that.
const DRIFT: [f64; BELIEF] = [2e-4, 2e-5, 1e-2, 1e-3, 5e-3, 5e-3, 2e-3, 0.0];

/// A reading that is further off than this from what is expected, in standard deviations squared, says no more against a
/// hypothesis: a moment between slip and stick may be a millisecond off.
const WILD: f64 = 36.0;

/// So many of them one after the other are none of chance, and all they say counts.
const WILD_IN_A_ROW: usize = 3;

/// Readings back to which a contact that has not slipped may have.
const SLIPPED_BACK: usize = 5;

/// A reading so far off says that a contact which never slipped may have.
const MAY_HAVE_SLIPPED: f64 = 9.0;

/// Uncertainty of the contact angle up to which one Gaussian will do, rad. Where a contact rolls, the force tells the angle and
/// the friction together, along a bent line: one that follows it for long in a straight line finds what is not told.
const STRAIGHT_RAD: f64 = 0.015;

/// Gaussians that stand for a wide one reach so many of its standard deviations to each side.
const SPLIT_REACH: f64 = 2.5;

/// Contacts further apart are not of one, m.
const BESIDE_M: f64 = 2e-3;

/// Frictions that a contact may have had when it slipped are looked at so far apart: nearer ones are one Gaussian.
const FRICTIONS_APART: f64 = 0.06;

/// Friction is known to this share where a contact that rolls is taken to slip: rolling takes so much more from one reading
/// to the next at the most.
const SLIPPED_SHARE: f64 = 0.05;

/// A contact so far beyond its edge is none, in standard deviations of the place and m: what is beyond, the force of an edge
/// does not tell.
const BEYOND: (f64, f64) = (3.0, 2e-4);

/// A point that cannot be played is tried nearer to the middle, so many times by half.
const NEARER_MAX: usize = 3;

/// A reading is after what happens at its very moment, s.
const AFTER_S: f64 = 1e-8;

/// A hypothesis under way.
#[derive(Clone, Debug)]
pub(super) struct Followed {
    /// The side whose line it is on.
    edge: usize,
    belief: Gaussian<BELIEF>,
    contact: ContactMode,
    /// Whether µ_c is a number here: it is known, or the contact has slipped.
    has_mu_c: bool,
    friction_needed: f64,
    /// When, s.
    pub(super) time: f64,
    /// ln of its weight among the others.
    pub(super) log_weight: f64,
    /// The force on the disk at the last reading, N.
    force: Vector2<f64>,
    /// Readings that were far off, one after the other until now, and what they would have cost.
    wild: (usize, f64),
    /// The last misfit, of two degrees of freedom, at the most [`WILD`].
    pub(super) misfit: f64,
    /// As it was before the last readings, of a contact that never slipped, with those readings.
    before: VecDeque<(Box<Followed>, ForceReading)>,
}

/// What a reading is expected to be.
struct Expected {
    end: SVector<f64, BELIEF>,
    force: Vector2<f64>,
    path: Path,
    jump: Vector2<f64>,
}

/// What all hypotheses share from one reading to the next.
pub(super) struct Stretch<'a> {
    known: &'a KnownOfFinger<'a>,
    course: Course<'a>,
    /// Of the finger at its end, m/s².
    acceleration: Vector2<f64>,
}

impl<'a> Stretch<'a> {
    /// None of no length.
    pub(super) fn new(known: &'a KnownOfFinger<'a>, from: f64, to: f64) -> Option<Self> {
        let (from, to) = (from + AFTER_S, to + AFTER_S);
        let first = known.motion.legs(known.radius).filter(|leg| leg.to > from);
        let legs = first.take_while(|leg| leg.from < to);
        let legs: Vec<_> = legs.map(|leg| Leg { from: leg.from - from, to: leg.to - from, ..leg }).collect();
        let acceleration = legs.last().filter(|_| to > from)?.finger.acceleration;
        let course = Course {
            part: known.part,
            shape: known.shape,
            symmetry: 1,
            mu_g: known.mu_g,
            mu_g_log_sd: known.mu_g_log_sd,
            mu_c: known.mu_c,
            friction_along: FrictionAlong::default(),
            changed: &[],
            off: &[],
            start: CourseStart::Moving,
            legs,
            duration: to - from,
            resolution: Resolution::Fine,
        };
        Some(Self { known, course, acceleration })
    }

    fn noise(&self, force: &Vector2<f64>) -> f64 {
        let of_part = self.known.errors.map_or(0.0, |errors| errors.share(self.known.part));
        self.known.noise.hypot((MODEL_SHARE + of_part) * force.norm())
    }
}

impl Followed {
    /// What a search has found, in pieces where the contact angle is told poorly.
    pub(super) fn all_of(found: &Concluded, push: &FeltPush, time: f64) -> Vec<Self> {
        let whole = || Self::at(&found.at_end, found.guess.edge, push.known, time, found.found.probability.ln());
        if found.at_end.belief.covariance[(0, 0)] <= STRAIGHT_RAD * STRAIGHT_RAD {
            return vec![whole()];
        }
        let Some(pieces) = push.pieces(found, STRAIGHT_RAD) else { return whole().split() };
        let piece = |(share, at_end): &(f64, AtEnd)| {
            Self::at(at_end, found.guess.edge, push.known, time, (found.found.probability * share).ln())
        };
        pieces.iter().map(piece).collect()
    }

    fn at(at_end: &AtEnd, edge: usize, known: &KnownOfFinger, time: f64, log_weight: f64) -> Self {
        let AtEnd { mut belief, contact, slipped, friction_needed } = *at_end;
        let has_mu_c = slipped || known.mu_c.is_some();
        if known.mass.is_some() {
            belief.fix(BELIEF_MASS, belief.mean[BELIEF_MASS]);
        }
        if !has_mu_c || known.mu_c.is_some() {
            belief.fix(BELIEF_MU_C, known.mu_c.unwrap_or(MU_C_MAX));
        }
        if known.mu_g_log_sd.is_none() {
            belief.fix(BELIEF_MU_G, 0.0);
        }
        let mut followed = Self {
            edge,
            belief,
            contact,
            has_mu_c,
            friction_needed,
            time,
            log_weight,
            force: Vector2::zeros(),
            wild: (0, 0.0),
            misfit: 0.0,
            before: VecDeque::new(),
        };
        followed.keep_to_contact(belief.mean[BELIEF_SLIDE].signum());
        followed
    }

    /// The same as Gaussians that are narrow in the contact angle.
    pub(super) fn split(self) -> Vec<Self> {
        let sd = self.belief.covariance[(0, 0)].max(0.0).sqrt();
        if sd <= STRAIGHT_RAD {
            return vec![self];
        }
        // What goes with the angle, a standard deviation of it; each piece has a share of that.
        let along: SVector<f64, BELIEF> = self.belief.covariance.column(0) / sd;
        let share = STRAIGHT_RAD / sd;
        let spread = 1.0 - share * share;
        let covariance = self.belief.covariance - along * along.transpose() * spread;
        let apart = PIECES_APART * share;
        let side = (SPLIT_REACH / apart).ceil();
        let places = (0..).map(|place| f64::from(place) - side).take_while(|place| *place <= side);
        let weighed: Vec<_> =
            places.map(|place| place * apart).map(|at| (at, (-0.5 * at * at / spread).exp())).collect();
        let total: f64 = weighed.iter().map(|(_, weight)| weight).sum();
        let piece = |(at, weight): (f64, f64)| {
            let mut piece = self.clone();
            piece.belief = Gaussian { mean: self.belief.mean + along * at, covariance };
            piece.log_weight += (weight / total).ln();
            piece.keep_to_contact(self.belief.mean[BELIEF_SLIDE].signum());
            piece
        };
        weighed.into_iter().map(piece).collect()
    }

    pub(super) fn mass(&self) -> f64 {
        self.belief.mean[BELIEF_MASS].exp()
    }

    pub(super) fn mass_log_sd(&self) -> f64 {
        self.belief.covariance[(BELIEF_MASS, BELIEF_MASS)].max(0.0).sqrt()
    }

    pub(super) fn mu_c(&self) -> Option<f64> {
        self.has_mu_c.then(|| self.belief.mean[BELIEF_MU_C])
    }

    pub(super) fn edge(&self, known: &KnownOfFinger) -> usize {
        known.part.edge_at(self.edge, self.belief.mean[1])
    }

    pub(super) fn contact(&self) -> ContactMode {
        self.contact
    }

    /// Where on the edge the contact is, m.
    pub(super) fn place(&self) -> f64 {
        self.belief.mean[1]
    }

    /// Whether another may be a piece of the same.
    pub(super) fn is_beside(&self, other: &Self) -> bool {
        let off = self.belief.mean - other.belief.mean;
        // As far apart as two pieces and one between them, however wide they are.
        let apart = |place: usize, least: f64| {
            let variance = self.belief.covariance[(place, place)].max(other.belief.covariance[(place, place)]);
            (2.0 * PIECES_APART * variance.max(0.0).sqrt()).max(least)
        };
        self.edge == other.edge
            && off[0].abs() < apart(0, 2.0 * PIECES_APART * STRAIGHT_RAD)
            && off[1].abs() < apart(1, BESIDE_M)
    }

    /// Whether another says the same of where the part is and how it moves.
    pub(super) fn is_one_with(&self, other: &Self, near: &[f64; 3]) -> bool {
        let off = self.belief.mean - other.belief.mean;
        self.edge == other.edge
            && self.has_mu_c == other.has_mu_c
            && self.slides_forward() == other.slides_forward()
            && near.iter().zip(off.iter()).all(|(near, off)| off.abs() < *near)
    }

    /// Whether the contact slides forward; none of one that rolls.
    fn slides_forward(&self) -> Option<bool> {
        self.contact.signed_friction().map(|_| self.belief.mean[BELIEF_SLIDE] > 0.0)
    }

    /// Those that are one as one: a Gaussian of the mean and the covariance of all; none of none. What else there is of one is
    /// the first's, which is the likeliest.
    pub(super) fn joined(members: Vec<Self>) -> Option<Self> {
        let first = members.first()?;
        let share = |member: &Self| (member.log_weight - first.log_weight).exp();
        let all: f64 = members.iter().map(share).sum();
        let weighed: Vec<_> = members.iter().map(|member| (share(member) / all, member.belief)).collect();
        let (belief, log_weight) = (Gaussian::of_mixture(&weighed), first.log_weight + all.ln());
        let joined = members.into_iter().next()?;
        Some(Self { belief, log_weight, ..joined })
    }

    fn guess(&self, at: &SVector<f64, BELIEF>) -> Guess {
        let slide = match self.contact.signed_friction() {
            // It slides the way that it does.
            Some(_) if self.belief.mean[BELIEF_SLIDE] != 0.0 => {
                let way = self.belief.mean[BELIEF_SLIDE].signum();
                way * (at[BELIEF_SLIDE] * way).clamp(SLIDE_MIN, SLIDE_MAX)
            }
            _ => 0.0,
        };
        let mu_c = if self.has_mu_c { at[BELIEF_MU_C].clamp(MU_C_MIN, MU_C_MAX) } else { f64::INFINITY };
        Guess {
            edge: self.edge,
            u: at[0],
            s: at[1],
            mu_c,
            mu_g_log: at[BELIEF_MU_G].clamp(-MU_G_LOG_MAX, MU_G_LOG_MAX),
            delay: 0.0,
            omega: at[BELIEF_OMEGA].clamp(-OMEGA_MAX, OMEGA_MAX),
            slide,
        }
    }

    /// What one point leads to.
    fn expected(&self, stretch: &Stretch, at: &SVector<f64, BELIEF>) -> Option<Expected> {
        let guess = self.guess(at);
        let path = stretch.course.play(&guess).ok()?;
        let duration = stretch.course.duration;
        let mut forces = path.forces_in_finger_time(duration.min(JUMP_S));
        let (felt, mass) = (forces.at(duration), at[BELIEF_MASS].exp());
        let jump = forces.unsure(duration).map_or_else(Vector2::zeros, |(_, sd)| sd * mass);
        let carried = stretch.known.effective_mass + at[BELIEF_FINGER];
        let force = felt * mass - stretch.acceleration * carried;
        let slide = stretch.course.slide_at_end(&guess, &path)?;
        let mut end = *at;
        end.fixed_rows_mut::<4>(0).copy_from_slice(&[path.end.u, path.end.s, path.end.omega, slide]);
        Some(Expected { end, force, path, jump })
    }

    /// To the next reading; none where it can be no longer.
    pub(super) fn follow(&self, stretch: &Stretch, reading: &ForceReading) -> Option<Self> {
        let mut next = self.step(stretch, reading)?;
        next.before.clone_from(&self.before);
        if !self.has_mu_c {
            let earlier = Self { before: VecDeque::new(), ..self.clone() };
            next.before.push_back((Box::new(earlier), *reading));
            if next.before.len() > SLIPPED_BACK {
                next.before.pop_front();
            }
        }
        Some(next)
    }

    fn step(&self, stretch: &Stretch, reading: &ForceReading) -> Option<Self> {
        let mut from = self.belief;
        let duration = stretch.course.duration;
        for (place, drift) in DRIFT.into_iter().enumerate() {
            // What is known does not drift, nor what there is none of.
            if from.covariance[(place, place)] > 0.0 || place < BELIEF_SLIDE {
                from.covariance[(place, place)] += drift * drift * duration;
            }
        }
        let middle = self.expected(stretch, &from.mean)?;
        let mut ends = Vec::new();
        for offset in from.offsets() {
            for side in [offset, -offset] {
                ends.push(self.nearby(stretch, &from, side, &middle));
            }
        }
        if ends.is_empty() {
            ends.push((middle.end, middle.force));
        }
        let (points, forces): (Vec<_>, Vec<_>) = ends.into_iter().unzip();
        let noise = stretch.noise(&middle.force);
        let noise = Matrix2::identity() * noise * noise + middle.jump * middle.jump.transpose();
        let before = Gaussian::of_points(&points);
        let Measured { after, misfit, log_determinant } = measured(&before, &points, &forces, &reading.force, &noise)?;
        let (wild, cost) = self.judged(misfit);
        let is_left_aside = (1..WILD_IN_A_ROW).contains(&wild.0);
        let contact_force = middle.force + stretch.acceleration * stretch.known.effective_mass;
        let mut next = Self {
            edge: self.edge,
            belief: if is_left_aside { before } else { after },
            contact: middle.path.contact,
            has_mu_c: self.has_mu_c,
            friction_needed: self.friction_needed.max(middle.path.friction_needed),
            time: reading.time,
            log_weight: self.log_weight - 0.5 * (cost + log_determinant),
            force: contact_force,
            wild,
            misfit: misfit.min(WILD),
            before: VecDeque::new(),
        };
        next.keep_to_contact(middle.end[BELIEF_SLIDE].signum());
        next.is_possible(stretch.known).then_some(next)
    }

    /// A point so far beside the middle, nearer to it where it cannot be played, and what it leads to in its place.
    fn nearby(
        &self,
        stretch: &Stretch,
        from: &Gaussian<BELIEF>,
        offset: SVector<f64, BELIEF>,
        middle: &Expected,
    ) -> (SVector<f64, BELIEF>, Vector2<f64>) {
        let mut share = 1.0;
        for _ in 0..=NEARER_MAX {
            if let Some(found) = self.expected(stretch, &(from.mean + offset * share)) {
                let by = 1.0 / share;
                return (middle.end + (found.end - middle.end) * by, middle.force + (found.force - middle.force) * by);
            }
            share *= 0.5;
        }
        (middle.end + offset, middle.force)
    }

    /// What a misfit makes of the count of those that are far off, and what it costs.
    fn judged(&self, misfit: f64) -> ((usize, f64), f64) {
        let (count, left_aside) = self.wild;
        if misfit <= WILD {
            return ((0, 0.0), misfit);
        }
        match (count + 1).cmp(&WILD_IN_A_ROW) {
            Ordering::Less => ((count + 1, left_aside + misfit - WILD), WILD),
            // They turn out not to be of chance: all that was left aside counts.
            Ordering::Equal => ((count + 1, 0.0), misfit + left_aside),
            Ordering::Greater => ((count + 1, 0.0), misfit),
        }
    }

    /// What rolls does not slip, and what slides goes on the way that it does.
    fn keep_to_contact(&mut self, way: f64) {
        match self.contact.signed_friction() {
            Some(_) => {
                let slide = &mut self.belief.mean[BELIEF_SLIDE];
                *slide = way * (*slide * way).max(SLIDE_MIN);
            }
            None => self.belief.fix(BELIEF_SLIDE, 0.0),
        }
        if self.has_mu_c {
            self.belief.mean[BELIEF_MU_C] = self.belief.mean[BELIEF_MU_C].clamp(MU_C_MIN, MU_C_MAX);
        }
    }

    fn is_possible(&self, known: &KnownOfFinger) -> bool {
        let Ok(edge) = known.part.edge(self.edge) else { return false };
        let (s, sd) = (self.belief.mean[1], self.belief.covariance[(1, 1)].max(0.0).sqrt());
        let beyond = (edge.s_min - s).max(s - edge.s_max);
        beyond <= (BEYOND.0 * sd).max(BEYOND.1)
            && self.belief.mean[BELIEF_OMEGA].abs() <= OMEGA_MAX
            && self.belief.mean.iter().take(BELIEF_MU_C).all(|value| value.is_finite())
    }

    /// The same if the contact, which never slipped, has begun to at one of the last readings, where this one is off what was
    /// read: for each share of the frictions that it may have.
    pub(super) fn slipped(&self, known: &KnownOfFinger) -> Vec<Self> {
        if self.has_mu_c || self.misfit < MAY_HAVE_SLIPPED {
            return Vec::new();
        }
        (0..self.before.len()).flat_map(|first| self.slipped_from(known, first).unwrap_or_default()).collect()
    }

    fn slipped_from(&self, known: &KnownOfFinger, first: usize) -> Option<Vec<Self>> {
        let (start, reading) = &self.before[first];
        let stretch = Stretch::new(known, start.time, reading.time)?;
        let rolled = start.expected(&stretch, &start.belief.mean)?.path.friction_needed.min(MU_C_MAX);
        // It held before what it does not hold now: all that rolling took until then, and not all that it would take.
        let held = start.friction_needed.max(MU_C_MIN);
        let width = (rolled - held).max(SLIPPED_SHARE * rolled);
        let count = (width / FRICTIONS_APART).ceil();
        let share = width / count;
        let from = (rolled - width).max(MU_C_MIN);
        let places = (0..).map(f64::from).take_while(|place| *place < count && rolled > held);
        let slipped = places.filter_map(|place| {
            let mut slipping = Self { has_mu_c: true, before: VecDeque::new(), ..(**start).clone() };
            slipping.belief.mean[BELIEF_MU_C] = from + (place + 0.5) * share;
            slipping.belief.covariance[(BELIEF_MU_C, BELIEF_MU_C)] = share * share / 12.0;
            // Any friction beyond what rolling took is as likely, as the search has it.
            slipping.log_weight += (share / (MU_C_MAX - held)).ln();
            self.before.iter().skip(first).try_fold(slipping, |slipping, (start, reading)| {
                slipping.step(&Stretch::new(known, start.time, reading.time)?, reading)
            })
        });
        Some(slipped.flat_map(Self::split).collect())
    }

    /// Pose of the part, velocity of its centre of mass and ω, as x, y, θ, velocity, ω; θ goes on from the contact angle and
    /// is not wrapped.
    pub(super) fn motion(&self, known: &KnownOfFinger) -> Option<Gaussian<6>> {
        let time = self.time + AFTER_S;
        let leg = known.motion.legs(known.radius).filter(|leg| leg.from <= time).last()?;
        // A stretch of no length: the state is that at its start and its end.
        let course = Course {
            part: known.part,
            shape: known.shape,
            symmetry: 1,
            mu_g: known.mu_g,
            mu_g_log_sd: None,
            mu_c: None,
            friction_along: FrictionAlong::default(),
            changed: &[],
            off: &[],
            start: CourseStart::Moving,
            legs: vec![Leg { from: leg.from - time, to: leg.to - time, ..leg }],
            duration: 0.0,
            resolution: Resolution::Fine,
        };
        let toward = known.part.edge(self.edge).ok()?.normal;
        // The disk is where the finger's bending takes it.
        let bent = self.force * known.compliance;
        let of = |at: &SVector<f64, BELIEF>| {
            let (pose, velocity) = course.motion_of(&self.guess(at), &self.contact)?;
            let place = pose.translation.vector + bent;
            // The contact's normal into the part is at u + π in the world.
            let theta = at[0] + PI - toward.y.atan2(toward.x);
            Some(Vector6::new(place.x, place.y, theta, velocity.x, velocity.y, at[BELIEF_OMEGA]))
        };
        let mean = of(&self.belief.mean)?;
        let points = self.belief.offsets().into_iter().flat_map(|offset| [offset, -offset]);
        let points: Vec<_> = points.filter_map(|offset| of(&(self.belief.mean + offset))).collect();
        Some(Gaussian { mean, covariance: Gaussian::of_points(&points).covariance })
    }
}
