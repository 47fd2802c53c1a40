//! Every number of the slow-push estimator that is not physics, in one place, with where it comes from.
//!
//! "Board" is the hard board of the recordings `mlab_point_push` (five logs, 250 pushes of one aluminium block); the
//! fits are those of `palpate tables real`, which can be asked to do them again without one of the logs.
//! Units: SI.

/// What is the same for all pushes of one set-up: finger, frames and friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlowConstants {
    /// The disk's centre ahead of the logged point along the tool's x axis, m.
    pub tip_ahead: f64,
    /// The disk's centre to the left of the logged point, along the tool's y axis, m.
    pub tip_left: f64,
    /// Radius of the disk, m.
    pub radius: f64,
    /// The contact above the plane, as far as the load's transfer is concerned, m.
    pub height: f64,
    /// On a face pressure rises as `exp(rise · (p/50 mm)²)` with the distance `p` from the centre of mass.
    pub pressure_rise: f64,
    /// Friction between part and plane.
    pub friction: f64,
    /// Friction between finger and part while it slides.
    pub contact_friction: f64,
    /// The largest friction while it sticks, in that of sliding.
    pub stick_ratio: f64,
    /// By how much the finger goes on after the last logged point, m.
    pub beyond_log: f64,
    /// Travel by which a touch is felt after the disk meets the outline, m: clocks, and the part's give.
    pub felt_late: f64,
}

impl SlowConstants {
    /// What is known without any push: the contact's height is that of a fingertip against a block of 50 mm.
    pub const UNFITTED: Self = Self {
        tip_ahead: 0.0,
        tip_left: 0.0,
        radius: 0.3e-3,
        height: 12e-3,
        pressure_rise: 0.0,
        friction: 0.3,
        contact_friction: 0.35,
        stick_ratio: 1.3,
        beyond_log: 1.2e-3,
        felt_late: 0.0,
    };

    /// How pressure rises on a face of another part than the board's: alike for parts alike but for their size.
    #[must_use]
    pub fn pressure_rise_of(inertia_per_mass: f64) -> f64 {
        Self::BOARD.pressure_rise * BOARD_GYRATION_M * BOARD_GYRATION_M / inertia_per_mass
    }

    /// Fitted to the end poses of all five logs of the board (`learning::calibrated`), but for these:
    ///
    /// - `radius`: the fingertip's is 1 mm. With the tip's place along the tool it is one number but for pushes at an
    ///   angle, which ask for a small one; 0.1 to 1 mm explain the poses alike.
    /// - `stick_ratio`: chosen with forces: at one ratio of force components some pushes stick and others slide.
    /// - `beyond_log`: the plan of the recordings is 17.5 mm a push, the logs end after 16.3 mm while the tip still moves.
    /// - `felt_late`: the median of felt less computed onsets; robot and force have different clocks.
    pub const BOARD: Self = Self {
        tip_ahead: -1.47e-3,
        tip_left: -0.870e-3,
        radius: 0.3e-3,
        height: 17.5e-3,
        pressure_rise: 1.006,
        friction: 0.308,
        contact_friction: 0.433,
        stick_ratio: 1.3,
        beyond_log: 1.2e-3,
        felt_late: -0.450e-3,
    };
}

/// The finger's friction on the legs and the hypotenuse of the board's block, in that of all: of the sliding pushes of all five
/// logs (`learning::edge_frictions`). In each log the hypotenuse, edge 1, is the smoothest.
pub const BLOCK_EDGE_FRICTIONS: [f64; 3] = [1.03, 0.974, 1.08];

/// Radius of gyration of the board's block: a right-angled triangle with legs of 150 mm.
const BOARD_GYRATION_M: f64 = 0.05;

/// How far a push's own numbers scatter about those of its log or set-up: standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Of the logarithm of the plane's friction.
    pub friction_log: f64,
    /// Of the logarithm of a foot's friction against the others', or of a face's pressure 50 mm from its centre.
    pub contrast: f64,
    /// Of the logarithm of the finger's friction.
    pub contact_log: f64,
    /// Of the turn of the force's frame, rad.
    pub frame: f64,
}

impl Spread {
    /// Board: friction from force over model scatters by 8 to 13 % from push to push and by 2 to 8 % within one; feet
    /// differ by 10 to 25 %; sliding pushes have 0.42 ± 0.05 at the finger. The rest is left for rougher surfaces.
    pub const PUSH: Self = Self { friction_log: 0.17, contrast: 0.13, contact_log: 0.17, frame: 0.016 };
}

/// How the filter weighs what was felt, and how it keeps its cloud alive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterSettings {
    /// Poses kept after each push.
    pub particles: usize,
    /// Pushes simulated, per pose kept.
    pub simulated: usize,
    /// Start poses tried against the onset, per pose kept.
    pub candidates: usize,
    /// Scale of the travel at the onset, m: frames are apart by 0.3 to 0.4 mm.
    pub onset_scale: f64,
    /// Scale of the force's logarithm.
    pub force_scale: f64,
    /// Scale of the force's direction, rad.
    pub angle_scale: f64,
    /// Freedom of Student's distributions of all three.
    pub freedom: f64,
    /// Forces of one push count as so many times fewer: their errors go together.
    pub tempering: f64,
    /// Travel after the onset from which forces count, m.
    pub settle: f64,
    /// Length over which forces are averaged, m.
    pub bin: f64,
    /// Kernel's standard deviation, m.
    pub kernel: f64,
    /// Kernel's standard deviation of the angle, rad.
    pub kernel_angle: f64,
    /// Share of the kernel that is [`FilterSettings::tail_width`] times as wide.
    pub tail_share: f64,
    /// See [`FilterSettings::tail_share`].
    pub tail_width: f64,
    /// Share of the start poses of a chain that come through a kernel [`FilterSettings::lost_width`] times as wide: now and
    /// then a push goes as none of the cloud does. It is in no region that is stated.
    pub lost_share: f64,
    /// See [`FilterSettings::lost_share`].
    pub lost_width: f64,
    /// Length of a simulation's steps, m.
    pub stride: f64,
}

impl FilterSettings {
    /// Set on the board. Sharper likelihoods gain nothing there and state too much elsewhere; nor does a wider or narrower
    /// scatter of the feet's or the finger's friction, nor what a chain's forces tell of the friction of its log. With half
    /// the particles the worst of some seeds is worse by a tenth. Without start poses of parts that are lost a blind chain takes
    /// some pushes more until it has found again a part that stuck where it was to slide.
    pub const STANDARD: Self = Self {
        particles: 2000,
        simulated: 3,
        candidates: 20,
        onset_scale: 0.45e-3,
        force_scale: 0.12,
        angle_scale: 0.06,
        freedom: 4.0,
        tempering: 4.0,
        settle: 2e-3,
        bin: 1e-3,
        kernel: 0.5e-3,
        kernel_angle: 0.01,
        tail_share: 0.15,
        tail_width: 3.0,
        lost_share: 0.03,
        lost_width: 5.0,
        stride: 0.5e-3,
    };
}
