//! The frictionless push from rest without looking for events: a twentieth of the cost of the simulation that does.
//!
//! Without friction under the part its motion is smooth in t from the start, and goes on smoothly where in truth the
//! contact ends: an edge is followed as a line, and the finger pulls if it has to. So u at a time is a smooth function
//! of s₀ over the whole interval, with no borders to find. Roughly by the classical Runge–Kutta method of order 4,
//! exactly by [`Extrapolation`]; whether the contact lasts is seen from the places passed, and where that is close, by
//! the full simulation.
//!
//! Units: SI. Errors: none; a contact that ends has no value.

use super::{ContactInterval, Watched};
use crate::math::ode::{self, Moment};
use crate::pushing::dynamics::{ContactMode, Extrapolation, Passed, State};

/// Steps to scan a push of usual length with.
const SCAN_STEPS: u32 = 16;

/// How far a scan may be off, in the unit of u: what comes this near is looked at exactly.
pub(super) const SCAN_ERROR: f64 = 1e-4;

/// What a push comes to if its contact lasts, and whether it does.
pub(super) struct EventFree {
    /// u at each time.
    pub(super) angles: Vec<f64>,
    /// Whether it does; none where that is close.
    pub(super) lasts: Option<bool>,
}

impl Watched<'_> {
    /// u at a time, roughly, as if the contact lasted.
    pub(super) fn scanned_angle(&self, interval: &ContactInterval, s0: f64, time: f64) -> Option<f64> {
        self.halt.goes_on()?;
        let model = self.model(interval).ok()?;
        let steps = self.refinement(time) * SCAN_STEPS;
        let dt = time / f64::from(steps);
        let step = |state: State, index| {
            let start = f64::from(index) * dt;
            let rates = |moment: Moment, state: &State| {
                model.motion(&ContactMode::Frictionless, moment.time(start, dt), state).rates
            };
            ode::step(&state, dt, rates)
        };
        let end = (0..steps).fold(self.start(s0), step);
        end.u.is_finite().then_some(end.u)
    }

    /// u at each time (increasing) as if the contact lasted.
    pub(super) fn event_free(&self, interval: &ContactInterval, s0: f64, times: &[f64]) -> Option<EventFree> {
        let (model, mut passed) = (self.model(interval).ok()?, Vec::new());
        let extrapolation = Extrapolation { model: &model, contact: ContactMode::Frictionless };
        let (mut time, mut state) = (0.0, self.start(s0));
        let mut angles = Vec::with_capacity(times.len());
        for &until in times {
            self.halt.goes_on()?;
            state = extrapolation.end(time, state, until, &mut passed)?;
            time = until;
            angles.push(state.u);
        }
        passed.push(extrapolation.place(time, &state));
        Some(EventFree { angles, lasts: lasts(interval, &passed) })
    }
}

/// Whether the contact stays on the part and presses, by more than either changes from one place passed to the next.
fn lasts(interval: &ContactInterval, passed: &[Passed]) -> Option<bool> {
    let [low, high] = interval.side.range();
    let clear = |two: &[Passed]| {
        let (travel, change) = ((two[1].s - two[0].s).abs(), (two[1].normal_force - two[0].normal_force).abs());
        let room = two.iter().map(|place| (place.s - low).min(high - place.s)).fold(f64::INFINITY, f64::min);
        let press = two.iter().map(|place| place.normal_force).fold(f64::INFINITY, f64::min);
        match (room > travel && press > change, room < -travel || press < -change) {
            (true, _) => Some(true),
            (_, true) => Some(false),
            _ => None,
        }
    };
    let mut seen = passed.windows(2).map(clear);
    // What ends for sure ends whatever is unclear elsewhere.
    seen.clone()
        .any(|clear| clear == Some(false))
        .then_some(false)
        .or_else(|| seen.all(|clear| clear == Some(true)).then_some(true))
}
