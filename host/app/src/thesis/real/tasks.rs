//! The tasks that recordings of slow pushes are judged by: what the estimator is told in each, and what it answers.
//!
//! - `a`: the pose before, as it was measured; `a_learned`: the same, with what earlier pushes of the log have taught.
//! - `b1`: a box of ± 10 mm and ± 10°, somewhere about the truth; `b3`: such a box before the push but two, then three
//!   pushes in a row.
//! - `c1` to `c4`: the pose unknown before the first, then one to four pushes in a row.
//! - `d`: a box before the first push of the log, then nothing but the finger's way and its force. Where somebody has
//!   moved the part between two pushes (the clock says so) it is looked for anew, as in `c`.
//!
//! An answer is made before the pose after the push is looked at; of the poses before it sees what its task says. Its
//! push's numbers rest on nothing later.
//!
//! Frames: the robot's = world; poses of the centre of mass. Units: SI. Errors: none.

use palpate::geometry::Pose;
use palpate::math::angle::wrap_angle;
use palpate::math::random::Draw;
use palpate::pushing::estimation::slow_pushes::{
    AfterPush, Before, Cells, Cloud, FilterSettings, Kernel, ParameterBelief, Region, SlowFilter, SlowScene, learned,
};
use palpate_files::recordings::slow_pushes::MeasuredPush;
use serde::Serialize;

/// Half sides of the box in which the start is known: m and rad.
pub(crate) const BOX: [f64; 2] = [10e-3, 10.0 * std::f64::consts::PI / 180.0];

/// Standard deviations of a measured pose against the finger's frame: m and rad.
const MEASURED: [f64; 2] = [0.3e-3, 3e-3];

/// Kernels with which cells are counted after one to four pushes from anywhere, m and rad: the fewer, the farther apart
/// are the cloud's poses. With kernels narrower by a tenth to a fifth the sets after one and two pushes hold nine in ten.
const CELL_KERNELS: [[f64; 2]; 4] = [[1.5e-3, 0.03], [1.5e-3, 0.03], [1.2e-3, 0.024], [0.9e-3, 0.018]];

/// Part of the filter's kernel with which regions are stated: the filter's is wider to keep its cloud alive.
const STATED: f64 = 0.85;

/// The next push begins within this, s, or the part was moved by hand meanwhile.
const SESSION_GAP_S: f64 = 600.0;

/// Pushes between two starts of task `c`.
pub(crate) const UNKNOWN_EVERY: usize = 5;

/// A log with its pushes.
#[derive(Clone, Debug)]
pub(crate) struct RealLog {
    /// Its folder's name.
    pub(crate) name: String,
    /// In the order of the file.
    pub(crate) pushes: Vec<MeasuredPush>,
}

/// What the estimator says of one push in one task.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Answer {
    pub(crate) log: String,
    /// From 1.
    pub(crate) push: usize,
    pub(crate) task: &'static str,
    pub(crate) seed: u64,
    /// After the push: of the centre of mass, and the part's axes, in the robot's frame: m, m, rad.
    pub(crate) pose: [f64; 3],
    /// Whether the truth is in the stated 95 % region.
    pub(crate) covered: bool,
    /// Of the ellipsoid of the region's volume: m, m, rad.
    pub(crate) semi_axes: [f64; 3],
    /// Cells in the 95 % set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) cells: Option<usize>,
    /// Error of the place, m, and of the angle, rad.
    #[serde(skip)]
    pub(crate) error: [f64; 2],
}

/// How far a pose is off: m and rad.
pub(crate) fn error(pose: &Pose, truth: &Pose) -> [f64; 2] {
    [(pose.x - truth.x).hypot(pose.y - truth.y), wrap_angle(pose.theta - truth.theta).abs()]
}

/// One log under one seed.
pub(crate) struct Judge<'a> {
    pub(crate) log: &'a RealLog,
    pub(crate) scene: &'a SlowScene,
    pub(crate) settings: FilterSettings,
    pub(crate) seed: u64,
    pub(crate) log_seed: u64,
}

impl Judge<'_> {
    /// A generator of its own for each task and push.
    fn draw(&self, task: u64, push: usize) -> Draw {
        Draw::case(self.seed ^ (task << 32) ^ self.log_seed, push)
    }

    fn filter(&self) -> SlowFilter<'_> {
        SlowFilter { scene: self.scene, settings: self.settings }
    }

    fn pushes(&self) -> &[MeasuredPush] {
        &self.log.pushes
    }

    /// A box of the stated size about a pose that is itself anywhere in it.
    fn boxed(&self, push: usize) -> Before<'static> {
        let truth = self.pushes()[push].known.before;
        // The same box for all tasks that begin at a push.
        let mut draw = self.draw(0, push);
        let [place, angle] = BOX;
        let pose = Pose {
            x: truth.x + draw.uniform(-place, place),
            y: truth.y + draw.uniform(-place, place),
            theta: truth.theta + draw.uniform(-angle, angle),
        };
        Before::Box(pose, place, angle)
    }

    /// Whether a push goes on where the one before it ended.
    fn goes_on(&self, push: usize) -> bool {
        let Some(before) = push.checked_sub(1).map(|before| &self.pushes()[before]) else { return false };
        let gap = self.pushes()[push].begins - before.ends;
        (0.0..SESSION_GAP_S).contains(&gap)
    }

    /// The kernel of what is stated.
    fn stated(&self) -> Kernel {
        let kernel = Kernel::of(&self.settings);
        Kernel { place: STATED * kernel.place, angle: STATED * kernel.angle, ..kernel }
    }

    fn answer(&self, task: &'static str, push: usize, cloud: &Cloud, draw: &mut Draw) -> Answer {
        let region = Region::of(cloud, self.stated(), draw);
        let pose = cloud.middle();
        let semi_axes = region.semi_axes();
        self.judged(task, push, pose, semi_axes, None, &|truth| region.holds(truth))
    }

    fn judged(
        &self,
        task: &'static str,
        push: usize,
        pose: Pose,
        semi_axes: [f64; 3],
        cells: Option<usize>,
        holds: &dyn Fn(&Pose) -> bool,
    ) -> Answer {
        let truth = &self.pushes()[push].known.after;
        Answer {
            log: self.log.name.clone(),
            push: self.pushes()[push].index + 1,
            task,
            seed: self.seed,
            pose: [pose.x, pose.y, wrap_angle(pose.theta)],
            covered: holds(truth),
            semi_axes,
            cells,
            error: error(&pose, truth),
        }
    }

    /// Task `a`.
    pub(crate) fn start_given(&self) -> Vec<Answer> {
        let [place, angle] = MEASURED;
        let each = self.pushes().iter().enumerate().map(|(push, measured)| {
            let mut draw = self.draw(1, push);
            let before = Before::Measured(measured.known.before, place, angle);
            let after = self.filter().push(&before, &measured.known.felt, &ParameterBelief::default(), &mut draw);
            self.answer("a", push, &after.cloud, &mut draw)
        });
        each.collect()
    }

    /// Task `a_learned`.
    pub(crate) fn start_given_and_learned(&self) -> Vec<Answer> {
        let [place, angle] = MEASURED;
        let known: Vec<_> = self.pushes().iter().map(|push| push.known.clone()).collect();
        let each = self.pushes().iter().enumerate().map(|(push, measured)| {
            let mut draw = self.draw(5, push);
            let (scene, belief) = learned(self.scene, &known[..push], &self.settings);
            let before = Before::Measured(measured.known.before, place, angle);
            let filter = SlowFilter { scene: &scene, settings: self.settings };
            let after = filter.push(&before, &measured.known.felt, &belief, &mut draw);
            self.answer("a_learned", push, &after.cloud, &mut draw)
        });
        each.collect()
    }

    /// Tasks `b1` and `b3`.
    pub(crate) fn start_in_a_box(&self) -> Vec<Answer> {
        let mut answers = Vec::new();
        for first in 0..self.pushes().len() {
            let mut draw = self.draw(2, first);
            let mut after = self.filter().push(
                &self.boxed(first),
                &self.pushes()[first].known.felt,
                &ParameterBelief::default(),
                &mut draw,
            );
            answers.push(self.answer("b1", first, &after.cloud, &mut draw));
            let last = first + 2;
            if last >= self.pushes().len() || !(first + 1..=last).all(|push| self.goes_on(push)) {
                continue;
            }
            for push in first + 1..=last {
                after = self.next(&after.cloud, push, &mut draw);
            }
            answers.push(self.answer("b3", last, &after.cloud, &mut draw));
        }
        answers
    }

    fn next(&self, cloud: &Cloud, push: usize, draw: &mut Draw) -> AfterPush {
        self.filter().push(&Before::After(cloud), &self.pushes()[push].known.felt, &ParameterBelief::default(), draw)
    }

    /// Tasks `c1` to `c4`.
    pub(crate) fn start_unknown(&self) -> Vec<Answer> {
        const NAMES: [&str; 4] = ["c1", "c2", "c3", "c4"];
        let mut answers = Vec::new();
        let last = |first: usize| first + NAMES.len() - 1;
        let lasts = |first: &usize| {
            last(*first) < self.pushes().len() && (first + 1..=last(*first)).all(|push| self.goes_on(push))
        };
        for first in (0..self.pushes().len()).step_by(UNKNOWN_EVERY).filter(lasts) {
            let mut draw = self.draw(3, first);
            let mut cloud: Option<Cloud> = None;
            for (number, task) in NAMES.into_iter().enumerate() {
                let push = first + number;
                let before = cloud.as_ref().map_or(Before::Anywhere, Before::After);
                let felt = &self.pushes()[push].known.felt;
                let after = self.filter().push(&before, felt, &ParameterBelief::default(), &mut draw);
                let [place, angle] = CELL_KERNELS[number];
                let kernel = Kernel { place, angle, ..self.stated() };
                let cells = Cells::of(&after.cloud, &kernel, &mut draw);
                let region = Region::of(&after.cloud, self.stated(), &mut draw);
                let holds = |truth: &Pose| cells.holds(truth);
                answers.push(self.judged(task, push, cells.pose, region.semi_axes(), Some(cells.count()), &holds));
                cloud = Some(after.cloud);
            }
        }
        answers
    }

    /// Task `d`.
    pub(crate) fn blind(&self) -> Vec<Answer> {
        let mut answers = Vec::new();
        self.follow_blind(|answer, _| answers.push(answer));
        answers
    }

    /// Task `d`, with the cloud after each push.
    pub(crate) fn follow_blind(&self, mut tell: impl FnMut(Answer, &Cloud)) {
        let mut draw = self.draw(4, 0);
        let mut cloud: Option<Cloud> = None;
        for push in 0..self.pushes().len() {
            let before = match &cloud {
                None => self.boxed(push),
                Some(cloud) if self.goes_on(push) => Before::After(cloud),
                Some(_) => Before::Anywhere,
            };
            let felt = &self.pushes()[push].known.felt;
            let after = self.filter().push(&before, felt, &ParameterBelief::default(), &mut draw);
            tell(self.answer("d", push, &after.cloud, &mut draw), &after.cloud);
            cloud = Some(after.cloud);
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Vector2};
    use palpate::pushing::estimation::slow_pushes::{
        FeltForce, FeltPush, KnownPush, Onset, PushParameters, SlowConstants, Standing,
    };

    use super::*;

    const FEW: FilterSettings = FilterSettings { particles: 60, ..FilterSettings::STANDARD };

    fn scene() -> SlowScene {
        super::super::scene(&Standing::Face, SlowConstants::BOARD, &[]).unwrap()
    }

    /// A chain of pushes at the part's middle, from all sides.
    fn chain(scene: &SlowScene, count: u32) -> RealLog {
        let mut before = Pose { x: 0.2, y: 0.1, theta: 0.3 };
        let mut pushes = Vec::new();
        for index in 0..count {
            let angle = 1.3 * f64::from(index);
            let direction = Vector2::new(angle.cos(), angle.sin());
            let origin = Point2::new(before.x, before.y) - direction * 0.06;
            let mut felt =
                FeltPush { origin, direction, tool_yaw: angle, end: 0.0, onset: Onset::Unknown, forces: Vec::new() };
            let touched = scene.first_touch(&felt, &before).unwrap();
            felt.end = touched + 13e-3;
            felt.onset = Onset::At(touched);
            let place = |i: u32| FeltForce { travel: touched + 3e-3 + 1e-3 * f64::from(i), force: Vector2::zeros() };
            felt.forces = (0..8).map(place).collect();
            let simulated = scene.simulate(&felt, &before, &PushParameters::default(), FEW.stride);
            for (felt, force) in felt.forces.iter_mut().zip(&simulated.forces) {
                felt.force = force.unwrap();
            }
            let after = simulated.pose;
            let begins = 40.0 * f64::from(index);
            let known = KnownPush { felt, before, after };
            pushes.push(MeasuredPush { index: index as usize, begins, ends: begins + 7.0, known });
            before = after;
        }
        RealLog { name: "chain".to_owned(), pushes }
    }

    fn judge<'a>(log: &'a RealLog, scene: &'a SlowScene) -> Judge<'a> {
        Judge { log, scene, settings: FEW, seed: 1, log_seed: 7 }
    }

    fn poses(answers: &[Answer]) -> Vec<[f64; 3]> {
        answers.iter().map(|answer| answer.pose).collect()
    }

    #[test]
    fn no_pose_after_the_start_reaches_a_blind_answer() {
        let scene = scene();
        let log = chain(&scene, 5);
        let mut scrambled = log.clone();
        for (number, push) in scrambled.pushes.iter_mut().enumerate() {
            push.known.after = Pose { x: -1.0, y: 2.0, theta: 3.0 };
            if number > 0 {
                push.known.before = Pose { x: 4.0, y: -2.0, theta: 1.0 };
            }
        }
        let (told, blind) = (judge(&log, &scene).blind(), judge(&scrambled, &scene).blind());
        assert_eq!(poses(&told), poses(&blind));
        // And the truth that it is judged by is another.
        assert!(told.iter().any(|answer| answer.covered) && blind.iter().all(|answer| !answer.covered));
        let (told, unknown) = (judge(&log, &scene).start_unknown(), judge(&scrambled, &scene).start_unknown());
        assert_eq!(poses(&told), poses(&unknown));
        assert_eq!(told.iter().map(|answer| answer.task).collect::<Vec<_>>(), ["c1", "c2", "c3", "c4"]);
    }

    #[test]
    fn what_is_learned_comes_from_earlier_pushes_alone() {
        let scene = scene();
        let log = chain(&scene, 4);
        let mut scrambled = log.clone();
        let last = scrambled.pushes.last_mut().unwrap();
        last.known.after = Pose { x: -1.0, y: 2.0, theta: 3.0 };
        let learned = |log: &RealLog| poses(&judge(log, &scene).start_given_and_learned());
        assert_eq!(learned(&log), learned(&scrambled));
    }

    #[test]
    fn a_part_that_was_moved_by_hand_is_looked_for_anew() {
        let scene = scene();
        let mut log = chain(&scene, 4);
        for push in &mut log.pushes[2..] {
            push.begins += 2.0 * SESSION_GAP_S;
            push.ends += 2.0 * SESSION_GAP_S;
        }
        // So few poses as elsewhere here would not fill what is possible.
        let settings = FilterSettings { particles: 5 * FEW.particles, ..FEW };
        let answers = Judge { settings, ..judge(&log, &scene) }.blind();
        // From anywhere the region is far larger than in a chain.
        assert!(answers[2].semi_axes[0] > 2.0 * answers[1].semi_axes[0], "{:?}", answers[2].semi_axes);
    }
}
