//! Where to begin: guesses spread over all edges, places and frictions, each agreeing with the first direction of the
//! force.
//!
//! At the start the force is at the angle to the contact's normal that rolling needs, or at the edge of the friction
//! cone if that is less. So the first direction felt fixes the contact angle for every place on every edge and every
//! friction, but for a few solutions. What then is left is a grid in place and friction, of which the minima are worth
//! a fit.
//!
//! Units: SI. Errors: none.

use std::f64::consts::{FRAC_PI_2, PI};

use super::between::least_cost;
use super::fit::{MU_C_MAX, MU_C_MIN, Problem, Tried};
use super::model::sought;
use super::path::Guess;
use crate::math::angle::wrap_angle;
use crate::pushing::dynamics::{ContactMode, PartSide};
use crate::search::Halt;

/// Spacing of places on an edge, of the radius of gyration: a millimetre or two for a part of 8 cm. At 0.1 one of 2,500
/// pushes is lost.
const SPACING: f64 = 0.07;

/// Fewest and most places on an edge.
const PLACES: (usize, usize) = (6, 40);

/// The same of a first look.
const SPARSE_PLACES: (usize, usize) = (3, 14);

/// So many times as far apart are its places, and every second friction is tried.
const SPARSE_TIMES: f64 = 4.0;

/// So many times as many on an outline that goes round as on an edge, at the most.
const ROUND_PLACES: usize = 2;

/// Contact angles are tried in so many steps to a right angle on either side of where the finger goes, which is left
/// out: 5° each.
const ANGLES: i32 = 18;

/// Frictions tried: each is followed until the part slips or never does.
const FRICTIONS: [f64; 9] = [0.05, 0.1, 0.15, 0.2, 0.27, 0.35, 0.45, 0.6, 0.8];

/// Contact angles nearer than this, rad, are of one family.
const FAMILY: f64 = 0.35;

/// Nearer than this they are one, rad.
const SAME_ANGLE: f64 = 1e-6;

/// A contact that rolls with more friction than this, where it is not known, leads nowhere.
const NEEDED_MAX: f64 = 2.0 * MU_C_MAX;

/// How near the direction felt the force turns back where it is tried all the same, rad: from one place to the next it
/// turns by less.
const TURNS_NEAR: f64 = 0.1;

/// Guesses beside what costs so many times the least there is are not played. At a hundred times one of 400 pushes is lost.
const HOPELESS_BESIDE: f64 = 300.0;

/// Nor are those that cost so many times as much by what the guesses around them leave unexplained: a third of the rest. Of 600
/// pushes none is lost. To give up the best guesses of the grid likewise, before a step of a fit, loses one of 150.
const HOPELESS_BETWEEN: f64 = 3.0;

/// How close the grid is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cover {
    /// A quarter of the places and half of the frictions: for a first look.
    Sparse,
    /// Enough for nearly all pushes.
    Dense,
    /// Twice as many places and frictions: for the force that nothing explains so far, though nearly.
    Denser,
}

impl Cover {
    fn spacing(self) -> f64 {
        match self {
            Self::Dense => SPACING,
            Self::Sparse => SPARSE_TIMES * SPACING,
            Self::Denser => 0.5 * SPACING,
        }
    }

    fn places(self) -> (usize, usize) {
        match self {
            Self::Dense => PLACES,
            Self::Sparse => SPARSE_PLACES,
            Self::Denser => (2 * PLACES.0, 2 * PLACES.1),
        }
    }

    /// Every so many places and frictions are played at first.
    fn step(self) -> usize {
        match self {
            Self::Sparse => 1,
            Self::Dense | Self::Denser => 2,
        }
    }

    /// Frictions, ascending.
    pub(super) fn frictions(self) -> Vec<f64> {
        match self {
            Self::Dense => FRICTIONS.to_vec(),
            Self::Sparse => FRICTIONS.into_iter().step_by(2).collect(),
            Self::Denser => {
                let between = FRICTIONS.windows(2).flat_map(|pair| [pair[0], (pair[0] * pair[1]).sqrt()]);
                [MU_C_MIN, (MU_C_MIN * FRICTIONS[0]).sqrt()].into_iter().chain(between).chain([0.8]).collect()
            }
        }
    }
}

/// A member of the grid.
struct Seed {
    place: usize,
    /// The number of frictions for what rolls.
    friction: usize,
    tried: Tried,
}

impl Seed {
    /// Whether another place and contact angle is its own or next to it, and of its family.
    fn is_beside(&self, place: usize, u: f64) -> bool {
        self.place.abs_diff(place) <= 1 && (self.tried.guess.u - u).abs() < FAMILY
    }

    /// Whether the force is compared from the same moment on.
    #[expect(clippy::float_cmp, reason = "one of a few onsets that are tried")]
    fn has_onset_of(&self, other: &Self) -> bool {
        self.tried.guess.delay == other.tried.guess.delay
    }
}

/// A place on an edge, with the contact angles that agree with the first direction of the force.
struct Place {
    index: usize,
    s: f64,
    angles: Angles,
}

/// The grid of one edge, as far as it has been played.
struct Grid<'f> {
    edge: usize,
    places: Vec<Place>,
    frictions: &'f [f64],
    /// Every so many places and frictions are played first.
    step: usize,
    seeds: Vec<Seed>,
}

/// Guesses that are better than their neighbours along their edge, for each friction. Only neighbours count of which the
/// contact does the same: where it slips back, or sticks in between, another minimum begins, however dear its first guess.
/// A guess with another friction may be cheaper and lead elsewhere: two of 2,500 pushes are lost where it counts too.
///
/// A dense grid is played thinly first, and then where that is not hopeless ([`HOPELESS_BETWEEN`], [`HOPELESS_BESIDE`]).
pub(super) fn on_edges(problem: &Problem, edges: &[usize], cover: Cover, halt: &Halt<'_>) -> Vec<Tried> {
    let frictions = problem.course.mu_c.map_or_else(|| cover.frictions(), |known| vec![known]);
    let of_edge = |&edge: &usize| {
        let side = problem.course.side(edge)?;
        let places: Vec<_> = places(problem, &side, cover).into_iter().enumerate().collect();
        let places = halt.each(places, |(index, s)| Some(Place { index, s, angles: Angles::new(problem, edge, s)? }));
        let places = places.into_iter().flatten().collect();
        Some(Grid { edge, places, frictions: &frictions, step: cover.step(), seeds: Vec::new() })
    };
    let mut grids: Vec<_> = edges.iter().filter_map(of_edge).collect();
    play(problem, &mut grids, |grid, place, friction, _| grid.is_first(place, friction), halt);
    let costs = grids.iter().flat_map(|grid| &grid.seeds).map(|seed| seed.tried.cost);
    let least = costs.fold(f64::INFINITY, f64::min);
    if cover.step() > 1 {
        let wanted = |grid: &Grid<'_>, place: usize, friction: usize, u: f64| {
            !grid.is_first(place, friction) && grid.is_hopeful(place, friction, u, least)
        };
        play(problem, &mut grids, wanted, halt);
    }
    grids.into_iter().flat_map(Grid::into_best).collect()
}

/// Plays what is wanted of every grid: of a place's number, a friction's and a contact angle.
fn play<'f>(
    problem: &Problem,
    grids: &mut [Grid<'f>],
    wanted: impl Fn(&Grid<'f>, usize, usize, f64) -> bool + Sync,
    halt: &Halt<'_>,
) {
    let places = grids.iter().enumerate().flat_map(|(grid, of)| of.places.iter().map(move |place| (grid, place)));
    let played = halt.each(places.collect(), |(grid, place)| {
        let of = &grids[grid];
        (grid, of.played(problem, place, |friction, u| wanted(of, place.index, friction, u)))
    });
    played.into_iter().for_each(|(grid, seeds)| grids[grid].seeds.extend(seeds));
}

impl Grid<'_> {
    /// Whether a guess between those of the thin grid is worth playing.
    fn is_hopeful(&self, place: usize, friction: usize, u: f64, least: f64) -> bool {
        let corners = self.corners(place, friction, u);
        let known: Vec<_> = corners.iter().flatten().collect();
        if known.iter().all(|corner| corner.tried.cost > HOPELESS_BESIDE * least) {
            return known.is_empty();
        }
        let is_alike = known.len() == corners.len() && known.iter().all(|corner| corner.has_onset_of(known[0]));
        let rests: Vec<_> = known.iter().map(|corner| corner.tried.rest()).collect();
        let between = match rests[..] {
            [a, b] if is_alike => least_cost([a, a, b, b]),
            [a, b, c, d] if is_alike => least_cost([a, b, c, d]),
            _ => 0.0,
        };
        between <= HOPELESS_BETWEEN * least
    }

    /// The guesses of the thin grid that a guess is between, by place and then by friction; none where one could not be played.
    fn corners(&self, place: usize, friction: usize, u: f64) -> Vec<Option<&Seed>> {
        let around = |number: usize| {
            let off = number % self.step;
            if off == 0 { vec![number] } else { vec![number - off, number - off + self.step] }
        };
        let frictions = if friction == self.rolling() { vec![friction] } else { around(friction) };
        let at = |place: usize, friction: usize| {
            let off = |seed: &Seed| (seed.tried.guess.u - u).abs();
            let is_there = |seed: &&Seed| seed.place == place && off(seed) < FAMILY && self.stands_for(seed, friction);
            self.seeds.iter().filter(is_there).min_by(|a, b| off(a).total_cmp(&off(b)))
        };
        around(place).into_iter().flat_map(|place| frictions.iter().map(move |&friction| at(place, friction))).collect()
    }

    /// What stands for rolling among the frictions.
    fn rolling(&self) -> usize {
        self.frictions.len()
    }

    /// µ_c of a friction's number.
    fn friction(&self, number: usize) -> f64 {
        self.frictions.get(number).copied().unwrap_or(f64::INFINITY)
    }

    /// Whether a friction changes nothing of a guess: it is the guess's own, or what rolls needs no more.
    fn stands_for(&self, seed: &Seed, friction: usize) -> bool {
        let suffices = || seed.tried.path.friction_needed <= self.friction(friction);
        seed.friction == friction || seed.friction == self.rolling() && suffices()
    }

    fn is_first(&self, place: usize, friction: usize) -> bool {
        place.is_multiple_of(self.step) && (friction.is_multiple_of(self.step) || friction == self.rolling())
    }

    /// The guesses at a place that are wanted of a friction's number and a contact angle.
    fn played(&self, problem: &Problem, place: &Place, wanted: impl Fn(usize, f64) -> bool) -> Vec<Seed> {
        let mut played: Vec<Seed> = Vec::new();
        // What rolls comes first: where one friction suffices for it, another that suffices too changes nothing.
        let rolling = problem.course.mu_c.is_none().then_some(self.rolling());
        for friction in rolling.into_iter().chain(0..self.frictions.len()) {
            let mu_c = self.friction(friction);
            for u in place.angles.solutions(mu_c).into_iter().filter(|u| wanted(friction, *u)) {
                let is_played = self.seeds.iter().chain(&played).any(|seed| {
                    let is_same = seed.place == place.index && (seed.tried.guess.u - u).abs() < SAME_ANGLE;
                    is_same && self.stands_for(seed, friction)
                });
                if !is_played {
                    let guess = Guess { edge: self.edge, u, s: place.s, mu_c, ..Guess::AT_REST };
                    let can_be = |it: &Tried| mu_c.is_finite() || it.path.friction_needed < NEEDED_MAX;
                    let tried = problem.try_onsets(guess).filter(can_be);
                    played.extend(tried.map(|tried| Seed { place: place.index, friction, tried }));
                }
            }
        }
        played
    }

    fn into_best(self) -> Vec<Tried> {
        let best: Vec<_> = self.seeds.iter().map(|seed| is_best_around(seed, &self.seeds)).collect();
        self.seeds.into_iter().zip(best).filter(|(_, best)| *best).map(|(seed, _)| seed.tried).collect()
    }
}

fn is_best_around(seed: &Seed, seeds: &[Seed]) -> bool {
    !seeds.iter().any(|other| {
        other.is_beside(seed.place, seed.tried.guess.u)
            && other.friction == seed.friction
            && other.tried.path.course == seed.tried.path.course
            && other.tried.cost < seed.tried.cost
    })
}

/// Guesses on the edge of a minimum that differ from it in their place alone and are better than their neighbours: one
/// force may have two places, and the grid lead to one of them.
pub(super) fn along_edge(problem: &Problem, minimum: &Tried, halt: &Halt<'_>) -> Vec<Tried> {
    let Some(side) = problem.course.side(minimum.guess.edge) else { return Vec::new() };
    let places = places(problem, &side, Cover::Dense);
    let tried = halt.each(places, |s| problem.try_guess(Guess { s, ..minimum.guess }));
    let cost = |place: Option<usize>| {
        let there = place.and_then(|place| tried.get(place)).and_then(Option::as_ref);
        there.map_or(f64::INFINITY, |tried| tried.cost)
    };
    let is_best = |place: usize| cost(Some(place)) <= cost(place.checked_sub(1)).min(cost(Some(place + 1)));
    let best: Vec<_> = (0..tried.len()).filter(|&place| is_best(place)).collect();
    best.into_iter().filter_map(|place| tried[place].clone()).collect()
}

pub(super) fn places(problem: &Problem, side: &PartSide, cover: Cover) -> Vec<f64> {
    let [from, to] = sought(side, problem.course.symmetry);
    let length = to - from;
    let (least, most) = cover.places();
    // An ellipse is one long side; one that is the same all around is one place.
    let (least, most) = match side {
        PartSide::Edge(_) => (least, most),
        PartSide::Ellipse { .. } if length > 0.0 => (least, ROUND_PLACES * most),
        PartSide::Ellipse { .. } => (1, 1),
    };
    let wanted = length / (cover.spacing() * problem.course.part.inertia_per_mass().sqrt());
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a few dozen")]
    let count = (wanted.ceil() as usize).clamp(least, most);
    let share = |index: usize| (index as f64 + 0.5) / count as f64;
    (0..count).map(|index| from + length * share(index)).collect()
}

/// What rolling needs at the start for each contact angle: the angle of the force from the normal.
struct Angles {
    /// Contact angle, and that of the force from it; rad.
    table: Vec<(f64, Option<f64>)>,
    /// First direction felt of the force on the part, rad.
    direction: f64,
    /// Of a straight finger all places are alike, and 0 stands for them.
    is_held: bool,
}

impl Angles {
    fn new(problem: &Problem, edge: usize, s: f64) -> Option<Self> {
        let model = problem.course.first_model(edge)?;
        let [x, y] = model.acceleration().into();
        let ahead = y.atan2(x);
        let needed = |u: f64| {
            let start = model.rest_start(&ContactMode::Rolling, u, s).ok().filter(|start| start.normal_force > 0.0)?;
            Some((-start.tangential_force).atan2(start.normal_force))
        };
        let step = FRAC_PI_2 / f64::from(ANGLES);
        let angles = (1 - ANGLES..ANGLES).map(|index| ahead + f64::from(index) * step);
        let force = problem.measured.first();
        let table = if model.turns_with_u() { angles.map(|u| (u, needed(u))).collect() } else { Vec::new() };
        Some(Self { table, direction: (-force.y).atan2(-force.x), is_held: !model.turns_with_u() })
    }

    /// Contact angles at which the force has the first direction felt, by straight lines in the table; and those at
    /// which it turns back just before it, for at the place next to this one it may reach it.
    fn solutions(&self, mu_c: f64) -> Vec<f64> {
        if self.is_held {
            return vec![0.0];
        }
        let cone = mu_c.atan();
        let off = |&(u, needed): &(f64, Option<f64>)| {
            needed.map(|needed| (u, wrap_angle(u + needed.clamp(-cone, cone) - self.direction)))
        };
        let crossing = |pair: &[(f64, Option<f64>)]| {
            let ((u0, off0), (u1, off1)) = (off(&pair[0])?, off(&pair[1])?);
            let crosses = (off0 <= 0.0) != (off1 <= 0.0) && (off1 - off0).abs() < PI;
            crosses.then(|| u0 + (u1 - u0) * off0 / (off0 - off1))
        };
        let turning = |three: &[(f64, Option<f64>)]| {
            let [(_, before), (u, here), (_, after)] = [off(&three[0])?, off(&three[1])?, off(&three[2])?];
            let nearest = here.abs() <= before.abs() && here.abs() <= after.abs();
            let turns = (here <= 0.0) == (before <= 0.0) && (here <= 0.0) == (after <= 0.0);
            (nearest && turns && here.abs() < TURNS_NEAR).then_some(u)
        };
        let crossings = self.table.windows(2).filter_map(crossing);
        crossings.chain(self.table.windows(3).filter_map(turning)).collect()
    }
}
