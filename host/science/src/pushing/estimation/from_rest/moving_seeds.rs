//! Where to begin with a part that moves already: guesses spread over places, frictions and speeds, each agreeing with the
//! first direction of the force.
//!
//! A contact that slides has its force at the edge of the friction cone: that fixes its angle. One that rolls may have it
//! anywhere inside, and then the angular velocity follows. What a part did before is forgotten within the time that
//! friction takes to stop it, some tens of milliseconds, so that few speeds suffice.
//!
//! Units: SI. Errors: none.

use super::fit::{MU_C_MAX, Problem, Tried};
use super::model::PlayedModel;
use super::path::Guess;
use super::seeds::{Cover, places};
use crate::pushing::dynamics::{ContactMode, State};

/// Angular velocities tried, rad/s: of a part that slides.
const SPINS: [f64; 9] = [-6.0, -3.5, -2.0, -0.8, 0.0, 0.8, 2.0, 3.5, 6.0];

/// Speeds of sliding tried, m/s, both ways.
const SLIDES: [f64; 3] = [0.005, 0.02, 0.06];

/// Angles of the force from the contact's normal tried for a part that rolls, as shares of the cone's.
const IN_CONE: i32 = 7;

/// The angular velocity of a part that rolls is sought between these, in so many steps; rad/s.
const ROLLING_SPIN: (f64, i32) = (9.0, 36);

/// Frictions tried where it is not known, of a contact that slides.
const FRICTIONS: [f64; 6] = [0.06, 0.13, 0.22, 0.33, 0.48, 0.75];

/// Angular velocities nearer than this are of one family, rad/s.
const SAME_SPIN: f64 = 1.6;

/// Contact angles nearer than this are, rad.
const SAME_ANGLE: f64 = 0.2;

/// Guesses that are better than their neighbours, on one edge.
pub(super) fn on_edge(problem: &Problem, edge: usize, cover: Cover) -> Vec<Tried> {
    let Some(side) = problem.course.side(edge) else { return Vec::new() };
    let Some(model) = problem.course.first_model(edge) else { return Vec::new() };
    let force = problem.measured.first();
    let direction = (-force.y).atan2(-force.x);
    let at_place = |s: f64| -> Vec<_> {
        let guesses = rolling(problem, edge, model, s, direction).chain(sliding(problem, edge, s, direction));
        guesses.filter_map(|guess| problem.try_guess(guess)).collect()
    };
    let of_places: Vec<_> = places(problem, &side, cover).into_iter().map(at_place).collect();
    let is_best = |place: usize, seed: &Tried| {
        let around = &of_places[place.saturating_sub(1)..of_places.len().min(place + 2)];
        !around.iter().flatten().any(|other| is_better_neighbour(other, seed))
    };
    let best: Vec<Vec<_>> =
        (0..of_places.len()).map(|place| of_places[place].iter().map(|seed| is_best(place, seed)).collect()).collect();
    let kept = of_places.into_iter().flatten().zip(best.into_iter().flatten());
    kept.filter(|(_, is_best)| *is_best).map(|(seed, _)| seed).collect()
}

/// Whether another guess at the same or the next place leads the same way, from lower.
fn is_better_neighbour(there: &Tried, at: &Tried) -> bool {
    there.cost < at.cost
        && (there.guess.slide == 0.0) == (at.guess.slide == 0.0)
        && there.guess.slide * at.guess.slide >= 0.0
        && (there.guess.u - at.guess.u).abs() < SAME_ANGLE
        && (there.guess.omega - at.guess.omega).abs() < SAME_SPIN
        && there.path.course == at.path.course
}

/// Parts that slide: the force is at the edge of the cone.
fn sliding(problem: &Problem, edge: usize, s: f64, direction: f64) -> impl Iterator<Item = Guess> {
    let known = problem.course.mu_c.map(|known| vec![known]);
    let frictions = known.unwrap_or_else(|| FRICTIONS.to_vec());
    frictions.into_iter().flat_map(move |mu_c| {
        [1.0, -1.0].into_iter().flat_map(move |way: f64| {
            SPINS.into_iter().flat_map(move |omega| {
                // Both signs of the angle: which one goes with which way the force decides.
                [1.0, -1.0].into_iter().flat_map(move |side: f64| {
                    let u = direction + side * mu_c.atan();
                    SLIDES.into_iter().map(move |speed| Guess {
                        edge,
                        u,
                        s,
                        mu_c,
                        omega,
                        slide: way * speed,
                        ..Guess::AT_REST
                    })
                })
            })
        })
    })
}

/// Parts that roll: for each angle in the cone the angular velocities that turn the force there.
fn rolling<'a>(
    problem: &'a Problem,
    edge: usize,
    model: PlayedModel<'a>,
    s: f64,
    direction: f64,
) -> impl Iterator<Item = Guess> + 'a {
    let local = -problem.course.legs[0].from;
    let mu_c = problem.course.mu_c;
    let cone = mu_c.unwrap_or(MU_C_MAX).atan();
    (-IN_CONE..=IN_CONE).flat_map(move |share| {
        let from_normal = cone * f64::from(share) / f64::from(IN_CONE);
        let u = direction - from_normal;
        let off = |omega: f64| {
            let at = State { u, s, omega, v_t: 0.0 };
            let at = State { v_t: model.rolling_v_t(local, &at), ..at };
            let force = model.motion(&ContactMode::Rolling, local, &at).force();
            (force.normal > 0.0).then(|| (-force.tangential).atan2(force.normal) - from_normal)
        };
        let spin = |step: i32| ROLLING_SPIN.0 * f64::from(step) / f64::from(ROLLING_SPIN.1);
        let crossing = move |step: i32| {
            let (a, b) = (off(spin(step))?, off(spin(step + 1))?);
            ((a <= 0.0) != (b <= 0.0)).then(|| spin(step) + (spin(step + 1) - spin(step)) * a / (a - b))
        };
        let spins: Vec<_> = (-ROLLING_SPIN.1..ROLLING_SPIN.1).filter_map(crossing).collect();
        let mu_c = mu_c.unwrap_or(f64::INFINITY);
        spins.into_iter().map(move |omega| Guess { edge, u, s, mu_c, omega, ..Guess::AT_REST })
    })
}
