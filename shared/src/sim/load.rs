//! What presses on the disk, and when.
//!
//! A [`Load`] is one way of pressing; a [`Script`] is a list of loads with their times. A change from one load to the
//! next takes a ramp, 20 ms by default: a real contact builds up while the surfaces meet, and a step would make the
//! elastic force overshoot to nearly twice the load.
//!
//! Frame: finger. **Force is the force on the disk.** A contact at the angle u (seen from the disk's centre) presses
//! the finger away from it: without friction along −(cos u, sin u), with the friction angle φ along
//! −(cos(u+φ), sin(u+φ)).
//! Units: newtons, radians, microseconds. Errors: [`Script::push`] refuses steps out of order and more than it holds.

use heapless::Vec;

use super::trig::{phase_of, sin_cos};

/// Most steps a script holds.
pub const STEPS_MAX: usize = 64;

/// Default time for one load to give way to the next, in microseconds.
pub const RAMP_US: u32 = 20_000;

/// A point of the disk's rim that is pressed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactLoad {
    /// Polar angle of the contact seen from the disk's centre, u, in radians.
    pub angle: f32,
    /// Force along the contact's normal, in newtons, not negative.
    pub normal_force: f32,
    /// Angle between force and normal, φ, in radians, counter-clockwise on the finger; |φ| < π/2, at most atan μ.
    pub friction_angle: f32,
}

impl ContactLoad {
    /// A contact without friction.
    #[must_use]
    pub const fn frictionless(angle: f32, normal_force: f32) -> Self {
        Self { angle, normal_force, friction_angle: 0.0 }
    }

    /// Force on the disk, in newtons: N / cos φ along −(cos(u+φ), sin(u+φ)).
    ///
    /// ```
    /// use palpate_shared::sim::ContactLoad;
    /// let [x, y] = ContactLoad::frictionless(0.0, 2.0).force_finger(); // pressed from +x ...
    /// assert!((x + 2.0).abs() < 1e-6 && y.abs() < 1e-6); // ... the finger is pushed towards −x
    /// ```
    #[must_use]
    pub fn force_finger(&self) -> [f32; 2] {
        let force = self.normal_force / sin_cos(phase_of(self.friction_angle)).1;
        let (sin, cos) = sin_cos(phase_of(self.angle + self.friction_angle));
        [-force * cos, -force * sin]
    }
}

/// One way of pressing on the disk.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Load {
    /// Nothing touches the finger.
    #[default]
    Released,
    /// A contact that stays where it is.
    Static(ContactLoad),
    /// A contact that travels round the disk at constant speed and force, then stays.
    Sweep {
        /// The contact at the start.
        from: ContactLoad,
        /// Angle at the end, in radians; a full turn round is `from.angle + 2π`.
        to_angle: f32,
        /// Time it takes, in microseconds.
        duration_us: u32,
    },
    /// Any force on the disk, in newtons. One that is not finite counts as none.
    Force([f32; 2]),
}

impl Load {
    /// The contact at a time after the load began, where there is one.
    #[must_use]
    pub fn contact_at(&self, elapsed_us: u64) -> Option<ContactLoad> {
        match *self {
            Self::Released | Self::Force(_) => None,
            Self::Static(contact) => Some(contact),
            Self::Sweep { from, to_angle, duration_us } => {
                let part = part_of(elapsed_us, duration_us);
                Some(ContactLoad { angle: from.angle + part * (to_angle - from.angle), ..from })
            }
        }
    }

    /// Force on the disk at a time after the load began, in newtons.
    #[must_use]
    pub fn force_at(&self, elapsed_us: u64) -> [f32; 2] {
        match self {
            Self::Force(force) if force.iter().all(|f| f.is_finite()) => *force,
            _ => self.contact_at(elapsed_us).map_or([0.0; 2], |contact| contact.force_finger()),
        }
    }
}

/// How much of a duration has passed, 0 to 1; 1 where the duration is 0.
fn part_of(elapsed_us: u64, duration_us: u32) -> f32 {
    u32::try_from(elapsed_us)
        .ok()
        .filter(|&elapsed| elapsed < duration_us)
        .map_or(1.0, |elapsed| elapsed as f32 / duration_us as f32)
}

/// Why a script takes no further step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScriptError {
    /// It holds [`STEPS_MAX`] already.
    Full,
    /// The step would begin before the one ahead of it.
    OutOfOrder {
        /// When the step should begin, in microseconds.
        start_us: u64,
        /// When the last step begins, in microseconds.
        last_us: u64,
    },
}

impl core::fmt::Display for ScriptError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Full => write!(f, "a load script holds at most {STEPS_MAX} steps; set later loads while it runs"),
            Self::OutOfOrder { start_us, last_us } => {
                write!(f, "step at {start_us} us after one at {last_us} us; put the steps in order of time")
            }
        }
    }
}

impl core::error::Error for ScriptError {}

/// Loads with the times at which they begin. Empty: nothing ever touches the finger.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    steps: Vec<(u64, Load), STEPS_MAX>,
}

impl Script {
    /// A script without steps.
    #[must_use]
    pub const fn new() -> Self {
        Self { steps: Vec::new() }
    }

    /// Adds a load that begins so many microseconds after the script is started.
    ///
    /// # Errors
    /// When the script is full, or the step begins before the last one.
    pub fn push(&mut self, start_us: u64, load: Load) -> Result<(), ScriptError> {
        match self.steps.last() {
            Some(&(last_us, _)) if start_us < last_us => Err(ScriptError::OutOfOrder { start_us, last_us }),
            _ => self.steps.push((start_us, load)).map_err(|_| ScriptError::Full),
        }
    }
}

/// A load in force, with the script it comes from and the ramp to it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Loading {
    ramp_us: u32,
    script: Script,
    /// Simulated time at which the script began, in microseconds.
    script_start_us: u64,
    next_step: usize,
    load: Load,
    load_start_us: u64,
    /// Force at the moment the load began, in newtons.
    force_before: [f32; 2],
    force: [f32; 2],
}

impl Loading {
    /// A released finger whose loads come up in so many microseconds.
    pub(super) fn new(ramp_us: u32) -> Self {
        Self {
            ramp_us,
            script: Script::new(),
            script_start_us: 0,
            next_step: 0,
            load: Load::Released,
            load_start_us: 0,
            force_before: [0.0; 2],
            force: [0.0; 2],
        }
    }

    /// Replaces the load from now on, and drops the rest of any script.
    pub(super) fn set_load(&mut self, load: Load, now_us: u64) {
        self.set_script(Script::new(), now_us);
        self.begin(load, now_us);
    }

    /// Starts a script; the present load stays until its first step.
    pub(super) fn set_script(&mut self, script: Script, now_us: u64) {
        self.script = script;
        self.script_start_us = now_us;
        self.next_step = 0;
    }

    /// The force on the disk at a time, which must not run backwards.
    pub(super) fn advance_to(&mut self, now_us: u64) -> [f32; 2] {
        while let Some(&(start_us, load)) = self.script.steps.get(self.next_step) {
            let start_us = self.script_start_us.saturating_add(start_us);
            if now_us < start_us {
                break;
            }
            self.next_step += 1;
            self.begin(load, start_us);
        }
        let part = self.ramp(now_us);
        let target = self.load.force_at(now_us.saturating_sub(self.load_start_us));
        self.force = core::array::from_fn(|i| self.force_before[i] + part * (target[i] - self.force_before[i]));
        self.force
    }

    /// The contact at a time, if there is one.
    pub(super) fn contact_at(&self, now_us: u64) -> Option<ContactLoad> {
        self.load.contact_at(now_us.saturating_sub(self.load_start_us))
    }

    /// Whether the load has fully come up.
    pub(super) fn is_ramp_over(&self, now_us: u64) -> bool {
        now_us.saturating_sub(self.load_start_us) >= self.ramp_us.into()
    }

    /// Lets a load begin.
    fn begin(&mut self, load: Load, start_us: u64) {
        self.load = load;
        self.load_start_us = start_us;
        self.force_before = self.force;
    }

    /// How far the load has come up, 0 to 1, starting and ending without a kink: 3p² − 2p³.
    fn ramp(&self, now_us: u64) -> f32 {
        let part = part_of(now_us.saturating_sub(self.load_start_us), self.ramp_us);
        part * part * (3.0 - 2.0 * part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::{PI, TAU};
    use proptest::prelude::*;

    /// Rounding of a force of a few newtons, in newtons.
    const FORCE_ERROR_N: f32 = 5e-6;

    proptest! {
        #[test]
        fn the_normal_part_of_a_contact_force_is_what_was_asked(
            angle in -PI..PI, normal_force in 0.0f32..5.0, friction_angle in -1.0f32..1.0
        ) {
            let [x, y] = ContactLoad { angle, normal_force, friction_angle }.force_finger();
            let inward = -(x * angle.cos() + y * angle.sin());
            let sideways = -(y * angle.cos() - x * angle.sin());
            prop_assert!((inward - normal_force).abs() < FORCE_ERROR_N);
            prop_assert!((sideways - normal_force * friction_angle.tan()).abs() < 2.0 * FORCE_ERROR_N);
        }

        #[test]
        fn a_sweep_turns_the_contact_at_constant_speed(from in -PI..PI, turn in -TAU..TAU, part in 0u32..=1000) {
            let from = ContactLoad::frictionless(from, 2.0);
            let sweep = Load::Sweep { from, to_angle: from.angle + turn, duration_us: 1_000_000 };
            let contact = sweep.contact_at(u64::from(part) * 1000).unwrap();
            prop_assert!((contact.angle - (from.angle + turn * part as f32 / 1000.0)).abs() < 2e-6);
        }
    }

    #[test]
    fn a_sweep_stays_at_its_end() {
        let sweep = Load::Sweep { from: ContactLoad::frictionless(0.0, 1.0), to_angle: 1.0, duration_us: 10 };
        for elapsed_us in [10, 1 << 40] {
            assert!((sweep.contact_at(elapsed_us).unwrap().angle - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn a_contact_comes_up_over_the_ramp_and_not_at_once() {
        let mut loading = Loading::new(RAMP_US);
        loading.set_load(Load::Force([4.0, 0.0]), 1000);
        assert!(loading.advance_to(1000)[0].abs() < FORCE_ERROR_N);
        assert!((loading.advance_to(11_000)[0] - 2.0).abs() < FORCE_ERROR_N);
        assert!(!loading.is_ramp_over(20_999));
        assert!((loading.advance_to(21_000)[0] - 4.0).abs() < FORCE_ERROR_N);
        assert!(loading.is_ramp_over(21_000));
    }

    #[test]
    fn a_script_plays_its_loads_at_their_times() {
        let mut script = Script::new();
        script.push(1000, Load::Force([1.0, 0.0])).unwrap();
        script.push(2000, Load::Force([0.0, 3.0])).unwrap();
        let mut loading = Loading::new(0);
        loading.set_script(script, 500);
        let mut force_is = |now_us, [x, y]: [f32; 2]| {
            let force = loading.advance_to(now_us);
            assert!((force[0] - x).abs() + (force[1] - y).abs() < FORCE_ERROR_N, "{force:?} at {now_us} us");
        };
        force_is(1499, [0.0, 0.0]);
        force_is(1500, [1.0, 0.0]);
        force_is(2499, [1.0, 0.0]);
        force_is(9000, [0.0, 3.0]);
    }

    #[test]
    fn a_ramp_begins_when_the_script_says_and_not_at_the_next_sample() {
        let mut script = Script::new();
        script.push(1000, Load::Force([4.0, 0.0])).unwrap();
        let mut loading = Loading::new(RAMP_US);
        loading.set_script(script, 0);
        assert!((loading.advance_to(11_000)[0] - 2.0).abs() < FORCE_ERROR_N);
    }

    #[test]
    fn a_force_that_is_not_finite_counts_as_none() {
        for force in [[f32::NAN, 1.0], [1.0, f32::INFINITY]] {
            assert!(Load::Force(force).force_at(0).iter().all(|f| f.abs() < FORCE_ERROR_N));
        }
    }

    #[test]
    fn a_script_refuses_steps_out_of_order_and_too_many() {
        let mut script = Script::new();
        (0..STEPS_MAX as u64).for_each(|i| script.push(i, Load::Released).unwrap());
        assert_eq!(script.push(100, Load::Released), Err(ScriptError::Full));
        assert_eq!(
            script.push(3, Load::Released),
            Err(ScriptError::OutOfOrder { start_us: 3, last_us: STEPS_MAX as u64 - 1 })
        );
    }
}
