//! A push from rest watched from the first sample to the answer: judged samples in, estimates and what they lack out.
//!
//! Rest for the tare, then waiting, then the push: [`PushWatch`] goes through them on the samples' own time, so that a
//! recording gives what was found live. When an estimate is due is decided here, by the length of the push alone; who
//! asks, live or from a file, asks [`PushWatch::is_due`] and [`PushWatch::is_over`] and prints.
//!
//! What was no measurement is left out of the force and counted: [`PushAnswer`] carries the tally since the onset.
//!
//! Frames: finger axes; force on the finger's disk. Units: s, and the calibration's unit of force.
//! Errors: [`TareError`] where the finger was not at rest, or the sensor failed meanwhile.

use std::collections::VecDeque;

use super::onset::{PushSense, RestNoise, Touch};
use super::{CarriedFinger, Estimate, KnownFromRest, WINDOWS_MIN, WindowedForce, estimate_until, follow, hann_windows};
use crate::finger::calibration::{Calibration, FrontEnd};
use crate::finger::contact::{Reading, TareError};
use crate::finger::judge::{Judged, Tally};
use crate::finger::rest::{RestStretch, check_offset};
use crate::pushing::finger_motion::FingerMotion;
use crate::search::Stop;

/// Times since the onset at which the whole part is searched, s; in between only what was found then is followed. At
/// the end all is searched once more.
const SEARCHES_S: [f64; 3] = [0.1, 0.2, 0.4];

/// How far back the tally is kept while a push may have begun, s: an onset is known within a twentieth of this.
const MARKS_S: f64 = 1.0;

/// After a contact that was no push the sensor comes to rest within this, s: three times what the default finger rings.
const RING_OUT_S: f64 = 0.13;

/// How a push is watched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WatchSettings {
    /// How long the finger rests at first, for the tare, s.
    pub rest_s: f64,
    /// An estimate is due every so many seconds of the push.
    pub every_s: f64,
}

/// Where a watched push is.
#[derive(Clone, Debug)]
enum Stage {
    Resting(RestStretch),
    Sensing(Box<PushSense>),
}

/// A finger that is watched until a push is over.
#[derive(Clone, Debug)]
pub struct PushWatch {
    settings: WatchSettings,
    calibration: Option<Calibration>,
    finger: CarriedFinger,
    /// Where the tare is held against the calibration's offset.
    front_end: Option<FrontEnd>,
    stage: Stage,
    /// What was read at rest, once that is over.
    rest: Vec<Reading>,
    tally: Tally,
    /// The tally at times before the push is felt to have begun, s.
    marks: VecDeque<(f64, Tally)>,
    /// The tally when the push began.
    at_onset: Option<Tally>,
    last: Option<Estimate>,
    /// Time since the onset of the next estimate, s.
    next_s: f64,
}

/// What is known of a push, with what its samples lack.
#[derive(Clone, Debug)]
pub struct PushAnswer {
    /// Every pose that explains what was felt.
    pub estimate: Estimate,
    /// What came, and did not, of the samples since the push began.
    pub since_onset: Tally,
}

impl PushWatch {
    /// A finger about to rest. Without a calibration the sensor's scale counts as exact.
    #[must_use]
    pub fn new(settings: WatchSettings, calibration: Option<&Calibration>) -> Self {
        Self {
            settings,
            calibration: calibration.cloned(),
            finger: CarriedFinger::RIGID,
            front_end: None,
            stage: Stage::Resting(RestStretch::new(settings.rest_s)),
            rest: Vec::new(),
            tally: Tally::default(),
            marks: VecDeque::new(),
            at_onset: None,
            last: None,
            next_s: 0.0,
        }
    }

    /// The same, of a finger that rings as heavy and as soft as it is.
    #[must_use]
    pub fn carried(self, finger: CarriedFinger) -> Self {
        Self { finger, ..self }
    }

    /// The same, of a finger with this front-end: a tare of a finger under load is refused.
    #[must_use]
    pub fn behind(self, front_end: FrontEnd) -> Self {
        Self { front_end: Some(front_end), ..self }
    }

    /// Takes what came next.
    ///
    /// # Errors
    /// [`TareError`] if the finger was not at rest for the tare, or under load, or samples were no measurements.
    pub fn take(&mut self, judged: impl IntoIterator<Item = Judged>) -> Result<(), TareError> {
        let mut now = None;
        for item in judged {
            self.tally.add(&item);
            now = self.take_item(&item)?.or(now);
        }
        if let Some(now) = now {
            self.mark(now);
        }
        Ok(())
    }

    /// Takes an item; returns its time, s.
    fn take_item(&mut self, item: &Judged) -> Result<Option<f64>, TareError> {
        match (&mut self.stage, item) {
            (Stage::Resting(rest), item) => {
                if rest.take(item)? {
                    self.ready()?;
                }
            }
            (Stage::Sensing(sense), Judged::Measured(reading)) => sense.push(reading),
            (Stage::Sensing(sense), Judged::NotMeasured { t, .. }) => sense.pass(*t),
            (Stage::Sensing(_), Judged::Missing(_) | Judged::Restarted) => {}
        }
        Ok(item.time())
    }

    /// The rest is over: judges it.
    fn ready(&mut self) -> Result<(), TareError> {
        let Stage::Resting(rest) = &self.stage else { return Ok(()) };
        let noise = RestNoise::estimate(rest.readings())?;
        if let (Some(calibration), Some(front_end)) = (&self.calibration, &self.front_end) {
            check_offset(&noise.bias, calibration, front_end)?;
        }
        let sense = PushSense::new(noise, self.calibration.as_ref()).carried(&self.finger);
        self.rest = rest.readings().to_vec();
        self.stage = Stage::Sensing(Box::new(sense));
        Ok(())
    }

    /// Keeps the tally of now, until the push is felt to have begun, and then that of when it had.
    fn mark(&mut self, now: f64) {
        match self.onset_time() {
            None => {
                self.at_onset = None;
                self.marks.push_back((now, self.tally));
                while self.marks.front().is_some_and(|(time, _)| *time < now - MARKS_S) {
                    self.marks.pop_front();
                }
            }
            Some(onset) if self.at_onset.is_none() => {
                let before = self.marks.iter().rev().find(|(time, _)| *time < onset);
                self.at_onset = Some(before.map(|(_, tally)| *tally).unwrap_or_default());
                self.marks.clear();
            }
            Some(_) => {}
        }
    }

    /// The tared finger; none while it rests.
    #[must_use]
    pub fn sense(&self) -> Option<&PushSense> {
        match &self.stage {
            Stage::Sensing(sense) => Some(sense),
            Stage::Resting(_) => None,
        }
    }

    /// What was read at rest, in order of time; nothing before that is over.
    #[must_use]
    pub fn rest(&self) -> &[Reading] {
        &self.rest
    }

    /// When the push began, s.
    #[must_use]
    pub fn onset_time(&self) -> Option<f64> {
        self.sense()?.onset_time()
    }

    /// What came, and did not, of the samples: since the push began, or since the watch did where none has.
    #[must_use]
    pub fn tally(&self) -> Tally {
        self.tally - self.at_onset.unwrap_or_default()
    }

    /// The last estimate.
    #[must_use]
    pub fn last(&self) -> Option<&Estimate> {
        self.last.as_ref()
    }

    /// Whether nothing more is to come: the finger has lost the part, or a motion that is told to its end is over.
    #[must_use]
    pub fn is_over(&self, motion: &FingerMotion, is_told_to_its_end: bool) -> bool {
        let Some((sense, onset)) = self.sense().and_then(|sense| Some((sense, sense.onset_time()?))) else {
            return false;
        };
        sense.is_over() || is_told_to_its_end && sense.now() - onset >= motion.duration()
    }

    /// Whether it is time for an estimate.
    #[must_use]
    pub fn is_due(&self, motion: &FingerMotion) -> bool {
        self.windows_over(motion).is_some_and(|windows| hann_windows::end(windows - 1) >= self.next_s)
    }

    /// How many windows of the push are over, if they are enough for an answer.
    fn windows_over(&self, motion: &FingerMotion) -> Option<usize> {
        let sense = self.sense()?;
        let pushed = sense.now() - sense.onset_time()?;
        Some(hann_windows::count(pushed.min(motion.duration()))).filter(|windows| *windows >= WINDOWS_MIN)
    }

    /// The force of the push so far; none where there is too little for an answer.
    #[must_use]
    pub fn force(&self, motion: &FingerMotion) -> Option<WindowedForce> {
        self.sense()?.windowed_force(motion.duration()).filter(|measured| measured.count() >= WINDOWS_MIN)
    }

    /// What is known by now: sought all over the part at a few times, followed in between.
    pub fn look(&mut self, known: &KnownFromRest<'_>, stop: Stop<'_>) -> Option<PushAnswer> {
        if let Some(windows) = self.windows_over(known.motion) {
            self.next_s = hann_windows::end(windows - 1) + self.settings.every_s;
        }
        let measured = self.force(known.motion)?;
        let now = measured.duration();
        let search_is_due = |before: f64| SEARCHES_S.iter().any(|&time| before < time && time <= now);
        let estimate = match &self.last {
            Some(last) if !search_is_due(last.time_end) => follow(known, &measured, last),
            _ => estimate_until(known, &measured, stop).found,
        };
        Some(self.answer(estimate))
    }

    /// What is known in the end, sought all over the part.
    pub fn conclude(&mut self, known: &KnownFromRest<'_>, stop: Stop<'_>) -> Option<PushAnswer> {
        let measured = self.force(known.motion)?;
        Some(self.answer(estimate_until(known, &measured, stop).found))
    }

    fn answer(&mut self, estimate: Estimate) -> PushAnswer {
        self.last = Some(estimate.clone());
        PushAnswer { estimate, since_onset: self.tally() }
    }
}

/// A recording of a push, watched until its rest is over, and where in it the push is.
#[derive(Clone, Debug)]
pub struct RecordedWatch {
    /// The tared finger, which has taken the rest.
    pub watch: PushWatch,
    /// The first item of the recording after the rest.
    pub rested: usize,
    /// From which item of the recording on the push is to be watched.
    pub from: usize,
    /// The contact that is the push; none where nothing was felt.
    pub push: Option<Touch>,
    /// The other contacts: before the push, or shorter.
    pub others: Vec<Touch>,
}

/// A contact that may be the push.
struct FeltContact {
    touch: Touch,
    /// The item from which on it is sensed.
    from: usize,
    /// Whether the finger was still in contact when its motion was over.
    lasts: bool,
}

impl RecordedWatch {
    /// Takes the rest at the beginning of a recording with a watch that has taken nothing, and finds the push: the first contact
    /// that lasts as long as the finger's motion, or else the longest.
    ///
    /// # Errors
    /// As [`PushWatch::take`].
    pub fn new(mut watch: PushWatch, judged: &[Judged], motion: &FingerMotion) -> Result<Self, TareError> {
        let mut rested = 0;
        while let Some(item) = judged.get(rested).filter(|_| watch.sense().is_none()) {
            watch.take([*item])?;
            rested += 1;
        }
        if watch.sense().is_none() {
            // It ends before its rest does: what there is must do.
            watch.ready()?;
        }
        let contacts =
            watch.sense().map(|sense| contacts(sense, judged, rested, motion.duration())).unwrap_or_default();
        let lasting = contacts.iter().position(|contact| contact.lasts);
        let length = |contact: &FeltContact| contact.touch.to - contact.touch.from;
        let longest = (0..contacts.len()).max_by(|a, b| length(&contacts[*a]).total_cmp(&length(&contacts[*b])));
        let taken = lasting.or(longest);
        let others = contacts.iter().enumerate().filter(|(number, _)| Some(*number) != taken);
        let others = others.map(|(_, contact)| contact.touch).collect();
        let taken = taken.map(|taken| &contacts[taken]);
        Ok(Self {
            watch,
            rested,
            from: taken.map_or(rested, |taken| taken.from),
            push: taken.map(|taken| taken.touch),
            others,
        })
    }
}

/// Every contact of a recording that lasts long enough to say anything, with a finger that moves for so long, s.
fn contacts(waiting: &PushSense, judged: &[Judged], from: usize, duration: f64) -> Vec<FeltContact> {
    let (mut found, mut from) = (Vec::new(), from);
    while from < judged.len() {
        let mut sense = waiting.clone();
        let over = |sense: &PushSense| sense.onset_time().is_some_and(|onset| sense.now() >= onset + duration);
        for item in &judged[from..] {
            match item {
                Judged::Measured(reading) => sense.push(reading),
                Judged::NotMeasured { t, .. } => sense.pass(*t),
                Judged::Missing(_) | Judged::Restarted => {}
            }
            if sense.is_over() || over(&sense) {
                break;
            }
        }
        let Some(begun) = sense.onset_time() else { break };
        let lost = sense.lost_before(duration);
        let touch = Touch { from: begun, to: lost.unwrap_or(sense.now()) };
        found.push(FeltContact { touch, from, lasts: lost.is_none() });
        if lost.is_none() {
            break;
        }
        let rung_out = |item: &Judged| item.time().is_some_and(|t| t >= sense.now() + RING_OUT_S);
        from += judged[from..].iter().position(rung_out).unwrap_or(judged.len() - from);
    }
    found
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Vector2};
    use palpate_shared::status::Status;
    use palpate_shared::units::Counts;

    use super::*;
    use crate::finger::Samples;
    use crate::finger::contact::Reading;
    use crate::finger::judge::tests::calibration;
    use crate::finger::judge::{CountsJudge, SampleFault};
    use crate::math::random::Draw;
    use crate::pushing::finger_motion::Segment;

    const PERIOD_S: f64 = 1e-3;

    const SETTINGS: WatchSettings = WatchSettings { rest_s: 1.0, every_s: 0.1 };

    /// A finger that moves for 0.8 s.
    fn motion() -> FingerMotion {
        let segments = [Segment { seconds: 0.8, acceleration: Vector2::new(0.1, 0.0) }];
        FingerMotion::new(Point2::origin(), &segments).unwrap()
    }

    /// Readings of a finger that is touched over these stretches, s; a rest of a second before them.
    fn touched(stretches: &[[f64; 2]]) -> Vec<Judged> {
        let mut draw = Draw::case(1, 0);
        let touched = |t: f64| stretches.iter().any(|[from, to]| (*from..*to).contains(&t));
        let mut reading = |index: u32| {
            let t = f64::from(index) * PERIOD_S;
            let force = if touched(t) { Vector2::new(-1.0, 0.3) } else { Vector2::zeros() };
            Judged::Measured(Reading::new(t, force + Vector2::new(draw.normal(), draw.normal()) * 0.01))
        };
        (0..5000).map(&mut reading).collect()
    }

    /// Watches a recording to the end of its push.
    fn watched(judged: &[Judged]) -> (RecordedWatch, PushWatch) {
        let recorded = RecordedWatch::new(PushWatch::new(SETTINGS, None), judged, &motion()).unwrap();
        let mut watch = recorded.watch.clone();
        for item in &judged[recorded.from..] {
            watch.take([*item]).unwrap();
            if watch.is_over(&motion(), true) {
                break;
            }
        }
        (recorded, watch)
    }

    #[test]
    fn an_earlier_touch_is_not_taken_for_the_push_and_is_named() {
        let (recorded, watch) = watched(&touched(&[[1.3, 1.9], [3.9, 4.72]]));
        let onset = watch.onset_time().unwrap();
        assert!((onset - 3.9).abs() < 2.0 * PERIOD_S, "{onset}");
        let [early] = &recorded.others[..] else { panic!("{:?}", recorded.others) };
        assert!((early.from - 1.3).abs() < 0.01 && (early.to - 1.9).abs() < 0.01, "{early:?}");
        assert!((recorded.push.unwrap().from - onset).abs() < 1e-9);
        assert!(watch.force(&motion()).unwrap().count() > 30);
    }

    #[test]
    fn a_contact_lost_before_the_motion_ends_is_the_push_up_to_there() {
        for lost in [0.02, 0.04] {
            let (recorded, watch) = watched(&touched(&[[2.0, 2.8 - lost]]));
            assert!(recorded.others.is_empty(), "{lost} s before the end");
            let found = watch.sense().unwrap().lost_before(0.8).unwrap();
            assert!((found - (2.8 - lost)).abs() < 5e-3, "{lost} s before the end: {found}");
            assert!(watch.force(&motion()).unwrap().count() > 30, "{lost} s before the end");
        }
    }

    /// A recording in which the push begins at 2 s, something happens before it, and this 0.3 s into it.
    fn spoilt(spoil: impl Fn(&Judged) -> Judged) -> Vec<Judged> {
        let mut judged = touched(&[[2.0, 2.9]]);
        for item in &mut judged[2300..2400] {
            *item = spoil(item);
        }
        // Lost while the finger waited: no matter to the push.
        judged.insert(1500, Judged::Missing(Some(7)));
        judged
    }

    #[test]
    fn a_fault_during_the_push_is_left_out_and_counted_from_the_onset() {
        let fault = SampleFault::Saturated { channel: 1 };
        let (_, watch) = watched(&spoilt(|item| Judged::NotMeasured { t: item.time().unwrap(), fault }));
        assert_eq!(watch.tally().saturated, [0, 100]);
        assert_eq!(watch.tally().missing, 0);
        let force = watch.force(&motion()).unwrap();
        assert_eq!(force.span(), hann_windows::count(0.8));
        // Of the windows, 20 ms apart and 40 long, those with more than half of their weight in the tenth of a second.
        assert!((4..=5).contains(&(force.span() - force.count())), "{} of {}", force.count(), force.span());
        assert!(force.forces_finger().iter().flatten().all(|force| (force.norm() - 1.044).abs() < 0.02));
    }

    #[test]
    fn samples_lost_during_the_push_are_counted_from_the_onset() {
        let mut judged = spoilt(|item| *item);
        // Two blocks of eight.
        for (place, count) in [(2350, 8), (2500, 8)] {
            judged.drain(place..place + count);
            judged.insert(place, Judged::Missing(Some(count as u64)));
        }
        let (_, watch) = watched(&judged);
        assert_eq!(watch.tally().missing, 16);
        assert!(watch.tally().measured > 700);
        assert_eq!(watch.force(&motion()).unwrap().count(), hann_windows::count(0.8), "the push is used to its end");
    }

    #[test]
    fn a_saturated_bridge_at_rest_refuses_the_tare() {
        let counts = vec![[Counts::MAX, Counts(3)]; 8];
        let calibration = calibration();
        let samples =
            Samples { first: 0, missing_before: 0, time_us: 0, period_us: 250.0, status: Status::default(), counts };
        let judged: Vec<_> = CountsJudge::new(&calibration).judge(&samples).collect();
        let refused = PushWatch::new(SETTINGS, Some(&calibration)).take(judged).unwrap_err();
        // The stamp is 0; at 4 kHz the converter's filter tells of 375 µs before it.
        assert_eq!(refused, TareError::NotMeasured { t: -375e-6, fault: SampleFault::Saturated { channel: 0 } });
    }

    #[test]
    fn live_and_recorded_are_one() {
        let judged = touched(&[[2.0, 2.9]]);
        let (_, recorded) = watched(&judged);
        let mut live = PushWatch::new(SETTINGS, None);
        for block in judged.chunks(8) {
            live.take(block.iter().copied()).unwrap();
            if live.is_over(&motion(), true) {
                break;
            }
        }
        assert_eq!(live.onset_time(), recorded.onset_time());
        assert_eq!(live.force(&motion()).unwrap().forces_finger(), recorded.force(&motion()).unwrap().forces_finger());
        let (a, b) = (live.tally().measured, recorded.tally().measured);
        assert!(a.abs_diff(b) <= 8, "{a} live, {b} recorded: a block of eight at most");
    }
}
