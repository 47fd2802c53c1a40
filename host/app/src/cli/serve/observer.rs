//! The observer of a pushed part beside the page: a thread of its own, so that a search never keeps the samples waiting.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use miette::IntoDiagnostic as _;
use palpate::finger::judge::Judged;
use palpate::pushing::estimation::Estimate;
use palpate::pushing::estimation::from_rest::watch::PushWatch;
use palpate::pushing::finger_motion::FingerMotion;
use palpate::{Caller as _, Stop};
use palpate_files::part::PolygonFile;

use super::super::watched_push::{FeltPush, not_at_rest};
use crate::live::interrupt;
use crate::recording::{self, Believed, Seen};
use crate::threads::EveryProcessor;
use crate::web::server::Board;
use crate::web::shown::{Belief, PushStage, ShownPose};

/// Blocks that wait for a search to end, at most: a minute of them at 4 kHz, 10 MB. Then the samples wait too, in the session.
const WAITING_MAX: usize = 30_000;

/// Pieces in which the finger's way is drawn.
const PATH_PIECES: u32 = 64;

/// What the thread is told, in the order of the samples.
enum Told {
    /// Samples, along the robot's axes.
    Judged(Vec<Judged>),
    /// The finger's motion as far as it is told, and whether that is all.
    Motion(FingerMotion, bool),
    /// The finger rests for another push.
    Anew,
}

/// What is known of the push.
pub(super) struct Known {
    /// The part.
    pub(super) file: PolygonFile,
    /// All but part and motion.
    pub(super) felt: FeltPush,
    /// A finger about to rest.
    pub(super) watch: PushWatch,
}

/// The thread.
pub(super) struct Observer {
    told: Option<SyncSender<Told>>,
    is_stopped: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Observer {
    /// Observes pushes and shows what it finds.
    pub(super) fn start(known: Known, board: Board) -> miette::Result<Self> {
        let (told, received) = sync_channel(WAITING_MAX);
        let is_stopped = Arc::new(AtomicBool::new(false));
        let stop = Arc::clone(&is_stopped);
        let observe = move || Observing::new(known, board).run(&received, &stop);
        let thread = thread::Builder::new().name("palpate observer".to_owned()).spawn(observe).into_diagnostic()?;
        Ok(Self { told: Some(told), is_stopped, thread: Some(thread) })
    }

    fn tell(&self, told: Told) {
        if let Some(way) = &self.told {
            // A thread that has panicked has been reported; the page goes on without it.
            let _ = way.send(told);
        }
    }

    /// Takes samples.
    pub(super) fn take(&self, judged: Vec<Judged>) {
        self.tell(Told::Judged(judged));
    }

    /// Takes the finger's motion as far as it is told.
    pub(super) fn move_so(&self, motion: &FingerMotion, is_complete: bool) {
        self.tell(Told::Motion(motion.clone(), is_complete));
    }

    /// The finger rests for another push.
    pub(super) fn begin_anew(&self) {
        self.tell(Told::Anew);
    }

    /// No more is to come: waits until everything was looked at, or the person wishes to stop.
    pub(super) fn finish(mut self) {
        self.join();
    }

    fn join(&mut self) {
        drop(self.told.take());
        if let Some(thread) = self.thread.take() {
            // A panic in the thread has been reported by it.
            let _ = thread.join();
        }
    }
}

impl Drop for Observer {
    fn drop(&mut self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        self.join();
    }
}

/// What the thread has.
struct Observing {
    known: Known,
    board: Board,
    watch: PushWatch,
    motion: Option<(FingerMotion, bool)>,
    is_over: bool,
}

impl Observing {
    fn new(known: Known, board: Board) -> Self {
        let watch = known.watch.clone();
        Self { known, board, watch, motion: None, is_over: false }
    }

    fn run(mut self, told: &Receiver<Told>, stop: &AtomicBool) {
        let caller = EveryProcessor { stops: || stop.load(Ordering::Relaxed) || interrupt::requested() };
        for told in told {
            if caller.stops() {
                return;
            }
            match told {
                Told::Judged(judged) => self.take(judged, &caller),
                Told::Motion(motion, is_complete) => {
                    let path = path(&motion);
                    self.show(|push| push.path = path);
                    self.motion = Some((motion, is_complete));
                }
                Told::Anew => {
                    (self.watch, self.is_over) = (self.known.watch.clone(), false);
                    self.show(|push| push.begin_anew());
                }
            }
        }
    }

    fn show(&self, change: impl FnOnce(&mut crate::web::shown::Push)) {
        self.board.update(|shown| shown.push.as_mut().map(change));
    }

    fn take(&mut self, judged: Vec<Judged>, stop: Stop<'_>) {
        if self.is_over {
            return;
        }
        if let Err(error) = self.watch.take(judged) {
            self.is_over = true;
            let why = not_at_rest(error).to_string();
            return self.show(|push| push.stage = PushStage::Unusable(why));
        }
        let Some((motion, is_complete)) = &self.motion else { return };
        let Some(sense) = self.watch.sense() else { return };
        let (now, onset) = (sense.now(), sense.onset_time());
        let since = onset.map_or(0.0, |onset| (now - onset).clamp(0.0, motion.duration()));
        let finger = motion.centre(since).coords.into();
        let stage = if onset.is_some() { PushStage::Pushing } else { PushStage::Ready };
        self.show(|push| (push.stage, push.finger) = (stage, finger));
        let known = self.known.felt.known(&self.known.file, motion);
        if self.watch.is_due(motion)
            && let Some(answer) = self.watch.look(&known, stop)
        {
            self.believe(motion, &answer.estimate, false);
        }
        if self.watch.is_over(motion, *is_complete) {
            let answer = self.watch.conclude(&known, stop).filter(|_| !stop.stops());
            self.is_over = true;
            match answer {
                Some(answer) => {
                    self.believe(motion, &answer.estimate, true);
                    self.show(|push| push.stage = PushStage::Over);
                }
                None => self.show(|push| push.stage = PushStage::Unusable("the push was too short".to_owned())),
            }
        }
    }

    fn believe(&self, motion: &FingerMotion, estimate: &Estimate, is_last: bool) {
        let part = &self.known.file.part;
        let seen = Seen::pushed(part, motion, self.known.felt.radius(), estimate.time_end);
        recording::believed(seen, estimate.hypotheses.iter().map(Believed::from));
        let poses = estimate.hypotheses.iter().map(|it| ShownPose {
            probability: it.probability,
            edge: it.edge,
            pose: [it.pose_end.x, it.pose_end.y, it.pose_end.theta],
            centre: (it.pose_end.isometry() * part.centre_of_mass()).coords.into(),
            spread: it.spread(part).map(|(distance, angle)| [distance, angle]),
        });
        let belief = Belief { felt_s: estimate.time_end, poses: poses.collect(), is_last };
        self.show(|push| push.believe(belief));
    }
}

/// Places on the finger's way, from its beginning.
fn path(motion: &FingerMotion) -> Vec<[f64; 2]> {
    let time = |piece: u32| motion.duration() * f64::from(piece) / f64::from(PATH_PIECES);
    (0..=PATH_PIECES).map(|piece| motion.centre(time(piece)).coords.into()).collect()
}
