//! `palpate observe --method follow`: pose and motion at each reading, while the push goes on.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread::Scope;

use miette::IntoDiagnostic as _;
use palpate::math::angle::wrap_angle;
use palpate::pushing::dynamics::{ContactMode, Part};
use palpate::pushing::estimation::Status;
use palpate::pushing::estimation::from_rest::readings::{
    ForceTracker, Found, KnownOfFinger, MotionClock, PushFollower, SearchTask, TrackedHypothesis, TrackerState,
};
use palpate::pushing::finger_motion::FingerMotion;
use palpate::pushing::streamed_path::StreamedPath;
use palpate_device::Session;
use palpate_device::trace::Input;
use palpate_files::part::PolygonFile;
use serde_json::{Value, json};

use super::lacking;
use super::motion_source::AskedMotion;
use super::observed_plot::{FollowedHistory, Heading};
use super::plot::PlotArguments;
use super::pose::{self, columns, deviation};
use super::watched_push::{FeltPush, Ongoing, Watched, WatchedPushArguments, Watching, too_short};
use crate::pictures::plot::Figure;
use crate::recording::{self, Believed, Seen};
use crate::threads::{EveryProcessor, PATIENT};
use crate::width::folded;

/// Poses of one reading that a person is shown; a program gets them all.
const SHOWN: usize = 3;

/// Widths of the columns: time, probability, edge, centre of mass and its error, turn and its error, velocity, turning,
/// mass.
const WIDTHS: [usize; 12] = [5, 6, 5, 8, 8, 6, 8, 6, 7, 7, 8, 6];

/// What tells when the finger's motion begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum MotionBegins {
    /// Where force is first felt, finger and part being at rest in contact.
    Felt,
    /// At a time on the clock of what is felt.
    At(MotionClock),
    /// Where a digital input of the board, 0 to 7, changes; so well it is known, one standard deviation, s.
    Input { input: usize, sd: f64 },
    /// Where measured places show it, by a clock that shows this when that of what is felt shows 0; known so well, s.
    Places { clock: f64, sd: f64 },
}

/// What is told of inputs comes no later than this after what is felt, s: both are sent at once, in blocks of samples.
const INPUT_LATE_S: f64 = 0.1;

/// What is printed of a push that is followed.
pub(super) struct Following<'f> {
    pub(super) file: &'f PolygonFile,
    /// Print no more often than every so many seconds of the push.
    pub(super) every_s: f64,
    pub(super) json: bool,
    /// When the finger's motion begins.
    pub(super) begins: MotionBegins,
    /// Title of the picture, where one is asked for.
    pub(super) plot: Option<String>,
}

/// What a recording calls the searches that a run made beside, and their lines: where one was begun, and where it was done. A
/// replay goes by them, since how long a search takes is the machine's affair.
const SEARCH: &str = "search";
const BEGUN: &str = "begun";
const FOUND: &str = "found";

fn note(session: &mut Session, line: &str) {
    session.note_input(Input { source: SEARCH.to_owned(), line: Some(line.to_owned()) });
}

/// A push that is followed.
struct Follow<'f, 'scope, 'env> {
    following: &'f Following<'env>,
    follower: PushFollower,
    /// Where searches run beside.
    scope: &'scope Scope<'scope, 'env>,
    pending: Option<Receiver<Found>>,
    /// What a recording says of the searches of its run and was not needed yet.
    told: VecDeque<String>,
    /// Whether nobody waits for a search any more.
    stop: &'env AtomicBool,
    /// When something was printed last, s since the motion began.
    last: f64,
    is_headed: bool,
    /// For a picture, where one is asked for.
    history: Option<FollowedHistory>,
    /// What a picture of it shows.
    figure: Option<Figure>,
}

impl Following<'_> {
    /// Follows a push to the end of the finger's motion.
    pub(super) fn run(
        &self,
        push: &WatchedPushArguments,
        motion: AskedMotion<'_>,
        plot: &PlotArguments,
    ) -> miette::Result<ExitCode> {
        let stop = AtomicBool::new(false);
        let watching = Watching { every_s: f64::INFINITY, watched: Watched::Everything };
        let (pushed, figure) = std::thread::scope(|scope| {
            let mut follow = Follow {
                following: self,
                follower: PushFollower::new(match self.begins {
                    MotionBegins::At(clock) => Some(clock),
                    MotionBegins::Felt | MotionBegins::Input { .. } | MotionBegins::Places { .. } => None,
                }),
                scope,
                pending: None,
                told: VecDeque::new(),
                stop: &stop,
                last: f64::NEG_INFINITY,
                is_headed: false,
                history: self.plot.as_ref().map(|_| FollowedHistory::default()),
                figure: None,
            };
            let watched = push.watch(motion, watching, &mut |ongoing| follow.look(ongoing));
            stop.store(true, Ordering::Relaxed);
            watched.map(|watched| (watched, follow.figure))
        })?;
        pushed.was_felt()?;
        if !self.json {
            say!("{}", legend());
        }
        if plot.is_asked() {
            let Some(figure) = figure else { return Err(too_short()) };
            plot.draw(|| Ok(figure))?;
        }
        Ok(lacking::status(&pushed.watch.tally()))
    }
}

impl<'scope, 'env> Follow<'_, 'scope, 'env>
where
    'env: 'scope,
{
    fn look(&mut self, ongoing: &mut Ongoing<'_>) -> miette::Result<ControlFlow<()>> {
        let (file, motion, felt) = (self.following.file, ongoing.motion, ongoing.felt);
        // The noise is that of the readings, which the follower knows.
        let known = felt.known_of_finger(file, motion, 0.0);
        if let Some(session) = &mut ongoing.session {
            self.told.extend(session.recorded_inputs(SEARCH).into_iter().flatten());
            if let Some(found) = self.found(session)? {
                self.follower.adopt(&known, found);
            }
        }
        if !self.is_begun(ongoing)? {
            return Ok(ControlFlow::Continue(()));
        }
        while let Some(time) = self.follower.next(&known, ongoing.path, ongoing.watch) {
            if let Some(task) = self.follower.search_due() {
                let is_beside = ongoing.session.as_mut().is_some_and(|session| self.is_beside(session));
                match is_beside {
                    true => self.search_beside(task, felt, motion)?,
                    false => self.search_here(&known, &task),
                }
            }
            if let (Some(history), Some(tracker)) = (&mut self.history, self.follower.tracker())
                && tracker.state() == TrackerState::Following
            {
                history.take(tracker.time(), &self.follower.hypotheses(&known), tracker.misfit());
            }
            if time >= self.last + self.following.every_s {
                self.last = time;
                self.print(&known, time, ongoing);
            }
        }
        let begun = self.follower.clock().map(|clock| clock.begins).or(ongoing.watch.onset_time());
        let is_over = begun.is_some_and(|begun| ongoing.is_motion_over(begun));
        if !is_over {
            return Ok(ControlFlow::Continue(()));
        }
        self.conclude(&known, ongoing)?;
        Ok(ControlFlow::Break(()))
    }

    /// Whether it is known when the motion began; where an input tells it, that may be still to come.
    fn is_begun(&mut self, ongoing: &Ongoing<'_>) -> miette::Result<bool> {
        if self.follower.clock().is_some() {
            return Ok(true);
        }
        let (input, sd) = match self.following.begins {
            MotionBegins::Felt | MotionBegins::At(_) => return Ok(true),
            MotionBegins::Input { input, sd } => (input, sd),
            MotionBegins::Places { clock, sd } => {
                let begun = ongoing.path.and_then(StreamedPath::begun_at);
                begun.into_iter().for_each(|begun| self.follower.set_clock(MotionClock { begins: begun - clock, sd }));
                return Ok(begun.is_some());
            }
        };
        let Some(sense) = ongoing.watch.sense() else { return Ok(false) };
        if let Some(changed) = ongoing.inputs.first_change(input) {
            // Inputs are read with each sample: in the mean it changed half a period before.
            let begins = changed - 0.5 * sense.rest().period;
            note!(
                "input {input}: the finger moves from t = {begins:.6} s on (--motion-begins, for forces that are kept)"
            );
            self.follower.set_clock(MotionClock { begins, sd });
            return Ok(true);
        }
        match sense.onset_time() {
            Some(onset) if sense.now() > onset + INPUT_LATE_S => Err(miette::miette!(
                help = "`palpate monitor` shows the inputs; without --motion-begins the motion begins where force is first felt",
                "force was felt from {onset:.3} s of the device's time on, and input {input} has not told that the finger moves"
            )),
            _ => Ok(false),
        }
    }

    /// The push is over: what is still searched is waited for.
    fn conclude(&mut self, known: &KnownOfFinger<'_>, ongoing: &Ongoing<'_>) -> miette::Result<()> {
        let Some(last) = self.follower.tracker().map(ForceTracker::last) else { return Ok(()) };
        let pending = self.pending.take();
        if let Some(pending) = &pending {
            let found = pending.recv().into_diagnostic()?;
            self.follower.adopt(known, found);
            self.follower.finish(known);
        }
        let task = self.follower.search_now();
        if let Some(task) = &task {
            self.search_here(known, task);
        }
        if pending.is_some() || task.is_some() || self.last < last {
            self.print(known, last, ongoing);
        }
        self.draw(known, ongoing);
        Ok(())
    }

    /// What a picture shows of it, where one is asked for.
    fn draw(&mut self, known: &KnownOfFinger<'_>, ongoing: &Ongoing<'_>) {
        let (Some(history), Some(title)) = (&mut self.history, &self.following.plot) else { return };
        let (Some(tracker), Some(sense)) = (self.follower.tracker(), ongoing.watch.sense()) else { return };
        let hypotheses = self.follower.hypotheses(known);
        if history.trail.last().is_none_or(|(time, _)| *time < tracker.time()) {
            history.take(tracker.time(), &hypotheses, tracker.misfit());
        }
        let words = match hypotheses.as_slice() {
            [] => "No pose was followed to the end.".to_owned(),
            [_] => "One pose explains what was felt to the end.".to_owned(),
            several => format!("{} poses explain what was felt to the end.", several.len()),
        };
        let onset = sense.onset_time().unwrap_or(0.0);
        let before_onset = self.follower.clock().map_or(0.0, |clock| onset - clock.begins);
        let heading = Heading { title: title.clone(), words };
        let readings = (sense.readings(), before_onset);
        let part = (known.part, known.radius);
        self.figure = Some(history.figure(part, known.motion, readings, known.effective_mass, &heading));
    }

    fn search_here(&mut self, known: &KnownOfFinger<'_>, task: &SearchTask) {
        let found = task.run(&self.follower.known(known), &PATIENT);
        self.follower.adopt(known, found);
    }

    /// Whether a search is made beside: always live, and in a recording where the recorded run made it so. What else is
    /// made of a recording waits for it, as a file does.
    fn is_beside(&mut self, session: &mut Session) -> bool {
        if session.is_recorded() {
            let is_told = self.told.front().is_some_and(|line| line == BEGUN);
            if is_told {
                self.told.pop_front();
            }
            return is_told;
        }
        note(session, BEGUN);
        true
    }

    /// What a search beside has found meanwhile; in a recording, at the place where the recorded run had it.
    fn found(&mut self, session: &mut Session) -> miette::Result<Option<Found>> {
        let Some(pending) = &self.pending else { return Ok(None) };
        let found = if session.is_recorded() {
            if self.told.front().is_some_and(|line| line == FOUND) {
                self.told.pop_front();
                pending.recv().map_err(|_| TryRecvError::Disconnected)
            } else {
                Err(TryRecvError::Empty)
            }
        } else {
            pending.try_recv()
        };
        match found {
            Ok(found) => {
                if !session.is_recorded() {
                    note(session, FOUND);
                }
                self.pending = None;
                Ok(Some(found))
            }
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(miette::miette!("the search for poses ended without an answer")),
        }
    }

    /// Searches beside, with the motion as far as it is told now.
    fn search_beside(&mut self, task: SearchTask, felt: FeltPush, motion: &FingerMotion) -> miette::Result<()> {
        let (sender, receiver) = channel();
        let scope = self.scope;
        let (file, stop, motion, follower) = (self.following.file, self.stop, motion.clone(), self.follower.clone());
        let search = move || {
            let known = follower.known(&felt.known_of_finger(file, &motion, 0.0));
            // Nobody may wait for it any more.
            let _ = sender.send(task.run(&known, &EveryProcessor { stops: || stop.load(Ordering::Relaxed) }));
        };
        std::thread::Builder::new().name("search".to_owned()).spawn_scoped(scope, search).into_diagnostic()?;
        self.pending = Some(receiver);
        Ok(())
    }
}

impl Follow<'_, '_, '_> {
    /// What is known at a reading.
    fn print(&mut self, known: &KnownOfFinger<'_>, time: f64, ongoing: &Ongoing<'_>) {
        let Some(tracker) = self.follower.tracker() else { return };
        let told = Told {
            time,
            at: tracker.time(),
            state: tracker.state(),
            explanations: tracker.explanations(),
            can_exclude_others: known.errors.is_none_or(|errors| errors.can_exclude_others()),
            hypotheses: self.follower.hypotheses(known),
            part: known.part,
        };
        let believed = told.hypotheses.iter().map(|it| Believed {
            probability: it.probability,
            edge: it.edge,
            pose: it.pose,
            covariance: Some(it.covariance.fixed_view::<3, 3>(0, 0).into_owned()),
        });
        recording::believed(Seen::pushed(known.part, known.motion, known.radius, told.at), believed);
        if self.following.json {
            let mut object = told.as_json();
            object["samples"] = lacking::as_json(&ongoing.watch.tally());
            say!("{object}");
            return;
        }
        if !self.is_headed {
            say!("{}", headings());
            self.is_headed = true;
        }
        told.lines().iter().for_each(|line| say!("{line}"));
    }
}

/// What is known at a reading.
struct Told<'p> {
    /// Of the reading, s since the motion began.
    time: f64,
    /// What the hypotheses are of, s.
    at: f64,
    state: TrackerState,
    /// Places that explain it and are not followed.
    explanations: usize,
    /// Whether a single hypothesis is certain.
    can_exclude_others: bool,
    hypotheses: Vec<TrackedHypothesis>,
    part: &'p Part,
}

impl Told<'_> {
    /// How far the hypotheses are behind, s.
    fn behind(&self) -> f64 {
        (self.time - self.at).max(0.0)
    }

    /// For a program: SI units and radians.
    fn as_json(&self) -> Value {
        let state = match self.state {
            TrackerState::NoContact => "no_contact",
            TrackerState::Searching => "searching",
            TrackerState::Ambiguous => "ambiguous",
            TrackerState::CatchingUp => "catching_up",
            TrackerState::Following => "following",
        };
        let status = Status::of(self.hypotheses.len().max(self.explanations), self.can_exclude_others);
        let hypotheses: Vec<_> = self.hypotheses.iter().map(hypothesis_as_json).collect();
        json!({"t": self.time, "state": state, "behind": self.behind(), "status": pose::status(status), "hypotheses": hypotheses})
    }

    /// For a person.
    fn lines(&self) -> Vec<String> {
        let at = format!("{:.2}", self.at);
        let only = |what: &str| vec![format!("{} {what}", columns(&[at.as_str()], &WIDTHS))];
        match self.state {
            TrackerState::NoContact => return only("no contact"),
            TrackerState::Searching => return only("searching"),
            TrackerState::Ambiguous => {
                return only(&format!("{} places explain it: turn aside, or go on", self.explanations));
            }
            TrackerState::CatchingUp | TrackerState::Following => {}
        }
        let shown = self.hypotheses.iter().take(SHOWN);
        let mut lines: Vec<_> = shown.map(|hypothesis| self.line(&at, hypothesis)).collect();
        if self.behind() > BEHIND_S
            && let Some(first) = lines.first_mut()
        {
            *first += &format!("\n{} {:.2} s behind", columns(&[""], &WIDTHS), self.behind());
        }
        let more = self.hypotheses.get(SHOWN..).unwrap_or_default();
        if !more.is_empty() {
            let probability: f64 = more.iter().map(|hypothesis| hypothesis.probability).sum();
            let cells = [at.clone(), format!("{probability:.3}")];
            lines.push(format!("{}  and {} more", columns(&cells, &WIDTHS), more.len()));
        }
        lines
    }

    fn line(&self, at: &str, hypothesis: &TrackedHypothesis) -> String {
        let TrackedHypothesis { edge, pose, velocity, omega, mass, probability, .. } = hypothesis;
        let (distance_sd, angle_sd) = hypothesis.spread(self.part);
        let centre = pose.isometry() * self.part.centre_of_mass();
        let cells = [
            at.to_owned(),
            format!("{probability:.3}"),
            edge.to_string(),
            format!("{:.2}", centre.x * 1e3),
            format!("{:.2}", centre.y * 1e3),
            deviation(distance_sd * 1e3),
            format!("{:.2}", wrap_angle(pose.theta).to_degrees()),
            deviation(angle_sd.to_degrees()),
            format!("{:.1}", velocity.x * 1e3),
            format!("{:.1}", velocity.y * 1e3),
            format!("{:.1}", omega.to_degrees()),
            format!("{mass:.3}"),
        ];
        columns(&cells, &WIDTHS)
    }
}

/// Hypotheses that are further behind what is felt say so, s.
const BEHIND_S: f64 = 0.05;

fn headings() -> String {
    let names = ["felt", "p", "edge", "x", "y", "±", "turned", "±", "vx", "vy", "turning", "mass"];
    let units = ["[s]", "", "", "[mm]", "[mm]", "[mm]", "[°]", "[°]", "[mm/s]", "[mm/s]", "[°/s]", "[kg]"];
    format!("{}\n{}", columns(&names, &WIDTHS), columns(&units, &WIDTHS))
}

fn legend() -> String {
    folded(
        "felt: time since the finger began to move. p: probability. edge: the one in contact, as in the part file, from 0. \
         x, y, turned: the part's centre of mass, and how far the part is turned. ±: one standard deviation, of the \
         distance and of the angle. vx, vy, turning: velocity of the centre of mass, and how fast the part turns. \
         mass: of the part.",
    )
}

fn hypothesis_as_json(hypothesis: &TrackedHypothesis) -> Value {
    let TrackedHypothesis { edge, pose, velocity, omega, covariance, contact, mass, mass_log_sd, mu_c, probability } =
        hypothesis;
    let contact = match contact {
        ContactMode::Frictionless => "frictionless",
        ContactMode::Rolling => "rolling",
        ContactMode::Sliding { .. } => "sliding",
    };
    let rows: Vec<Vec<f64>> = covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
    json!({
        "edge": edge,
        "pose": [pose.x, pose.y, pose.theta],
        "twist": [velocity.x, velocity.y, omega],
        "covariance": rows,
        "contact": contact,
        "mass": mass,
        "mass_log_sd": mass_log_sd,
        "mu_c": mu_c,
        "probability": probability,
    })
}
