//! The interrupt side: reads a frame at each data-ready edge, numbers it, queues it.
//!
//! - **Numbers.** While streaming, every conversion gets a number, whether or not it can be delivered: one
//!   that was not read in time, or whose frame was damaged, or for which the queue had no room, leaves a gap
//!   and is counted. While not streaming, frames are read but not numbered, so a pause leaves no gap.
//! - **Staleness.** The chip remembers two conversions. After a missed edge it would stay one behind, so two
//!   frames are read then and the newer one is taken. The same holds after a damaged frame, which may have
//!   taken none out; if damage then hides which is the newer one, neither is taken, and one is counted.
//! - **An edge that is not early is a conversion**, whatever STATUS says of it: whether its bits tell of this
//!   frame's data or of those that the frame before left is not documented, and both work. Bits that are set
//!   prove unread data; in the second of two frames in a row, clear ones prove that the first took the last.
//! - **Gaps in unknown timing.** While the rate changes, time does not tell how many conversions were
//!   missed, but two in the chip's memory tell that some were: the numbers then leave a gap all the same.
//! - **Doubt.** Damage may have written a setting. Samples wait until the settings are read back, four frames
//!   later, and count as damaged if those were others, or if more than 16 wait.
//! - **Slow channels**, where the front-end has them, are told as means of [`SLOW_CONVERSIONS`].
//! - **Digital inputs** are read with each edge while streaming, and told as they change (`inputs`).
//! - **Settling.** Three conversions after a reset or a change carry [`Status::SETTLING`].
//! - **Requests** of the main side share the frames that read samples (`job`); no sample is lost to them.
//! - **Raw frames.** From the first one on the chip is left to the host, so that the next one brings the answer to
//!   it. [`HANDED_OVER_US`] after the last one, or at the next request that needs the chip, it is initialised anew.
//! - **Faults.** A chip that forgot its settings gets them again. One that is absent is looked for, and one
//!   that is silent is reset, every [`RETRY_US`]. No front-end is never data: only frames with a right
//!   checksum from a chip with the right identity become samples.
//!
//! Assumes: [`Sampler::data_ready`] and [`Sampler::idle`] are called from one interrupt priority (or one
//! thread); `now` of an edge is taken when it happens. Bounded work: one frame, two after a missed edge or a
//! damaged frame; a reset takes up to 3 × 16 frames. Errors: none; they become notices and counts.

use heapless::Deque;
use palpate_shared::units::{Counts, DeviceTime, Seq};
use palpate_shared::wire::{
    Checks, EventKind, RAW_FRAME_BYTES, Refusal, SLOW_CONVERSIONS, SelfTest, SlowChannels, Source, Status,
};

use crate::clock::{ConversionClock, WINDOW};
use crate::front_end::{Answer, Ask, FrontEnd, Reading, SelectSource as _};
use crate::inputs::InputWatch;
use crate::job::{Goal, Job, Progress};
use crate::log::{info, warning};
use crate::queues::{Finding, FrontEndRequest, Notice, RawReading, RequestKind, SamplerEnd, SamplerState};
use crate::settings::DeviceSettings;

/// Periods without a data-ready edge after which the front-end counts as silent: 25 ms at 4 kHz.
///
/// Long enough for an interrupt that is held off, or a simulated device on a busy computer.
pub const SILENT_AFTER_PERIODS: u32 = 100;

/// Time between attempts to bring a missing or silent front-end back, in µs.
pub const RETRY_US: u32 = 200_000;

/// How often [`Sampler::idle`] should be called at least, in µs.
pub const IDLE_US: u32 = 10_000;

/// Time after the host's last raw frame for which the chip is left to it, in µs.
pub const HANDED_OVER_US: u32 = 1_000_000;

/// Time without data after which the missing conversions are counted, in µs; well within the clock's wrap.
const COUNT_SILENCE_US: u32 = 1_000_000;

/// Damaged frames in a row after which nothing answers: at one damaged frame in two, never in practice.
const GONE_AFTER_DAMAGED: u8 = 64;

/// Samples that wait for the settings to be read back: two readings of them fit with room for damaged ones.
const HELD_MAX: usize = 16;

/// Conversions until the filter has forgotten what came before a change (sinc³: three).
const SETTLING_CONVERSIONS: u8 = 3;

/// Frames that [`Sampler::idle`] spends on one request when no edges come.
const FRAMES_PER_IDLE: u8 = 8;

/// Whether the front-end answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Presence {
    /// It was not looked for yet.
    Unknown,
    /// It did not answer when last looked for.
    Missing,
    /// It answers and announces data.
    Present,
    /// It announces no data.
    Silent,
    /// The host talks to it frame by frame, and nobody else does.
    HandedOver,
}

/// Why a frame brought no sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// Damaged on the bus; the first word read.
    Damaged { word: u16 },
    /// The chip lost its settings.
    LostSettings,
}

/// What a frame brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sample {
    counts: [Counts; 2],
    slow: Option<[Counts; 2]>,
    /// As [`Reading::is_new`].
    is_new: Option<bool>,
}

/// Codes of the slow channels on their way to a mean.
#[derive(Clone, Copy, Debug, Default)]
struct SlowSum {
    codes: [i64; 2],
    conversions: u16,
}

/// Whether a frame may carry a command for the request at work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Share {
    WithJob,
    NoCommand,
}

/// What was seen in a stretch of [`WINDOW`] edges.
#[derive(Clone, Copy, Debug, Default)]
struct Stretch {
    edges: u32,
    damaged: u32,
    saturated: bool,
}

/// Reads the front-end and numbers its samples.
pub struct Sampler<'q, F> {
    chip: F,
    end: SamplerEnd<'q>,
    settings: DeviceSettings,
    presence: Presence,
    /// A fault was reported, and its end was not yet.
    unwell: bool,
    streaming: bool,
    /// The next conversion's number.
    next: Seq,
    clock: ConversionClock,
    /// Conversions that still carry [`Status::SETTLING`].
    settling: u8,
    /// Damaged frames in a row.
    damaged_run: u8,
    /// When the front-end was last looked for.
    tried: DeviceTime,
    job: Option<Job>,
    /// A frame was damaged, and with it perhaps the settings.
    in_doubt: bool,
    /// Samples taken in doubt.
    held: Deque<RawReading, HELD_MAX>,
    /// How many of them were taken before the settings at work were first read back.
    held_before: usize,
    /// A frame was damaged since the chip's memory was last known to be empty.
    may_be_behind: bool,
    /// The stretch under way and the one before.
    lately: [Stretch; 2],
    slow: SlowSum,
    inputs: InputWatch,
}

impl<'q, F: FrontEnd> Sampler<'q, F> {
    /// Touches nothing yet; the first call of [`Self::idle`] or [`Self::data_ready`] looks for the chip.
    pub fn new(chip: F, end: SamplerEnd<'q>, settings: DeviceSettings) -> Self {
        Self {
            chip,
            end,
            settings,
            presence: Presence::Unknown,
            unwell: false,
            streaming: false,
            next: Seq(0),
            clock: ConversionClock::new(settings.rate, DeviceTime(0)),
            settling: SETTLING_CONVERSIONS,
            damaged_run: 0,
            tried: DeviceTime(0),
            job: None,
            in_doubt: false,
            held: Deque::new(),
            held_before: 0,
            may_be_behind: false,
            lately: [Stretch::default(); 2],
            slow: SlowSum::default(),
            inputs: InputWatch::default(),
        }
    }

    /// The bus, as for stepping a simulation behind it.
    pub fn bus_mut(&mut self) -> &mut F::Bus {
        self.chip.bus_mut()
    }

    /// How the front-end is set; a simulation of it follows this rate by itself.
    pub fn settings(&self) -> DeviceSettings {
        self.settings
    }

    /// DRDY fell at `now`.
    pub fn data_ready(&mut self, now: DeviceTime) {
        match self.presence {
            Presence::Unknown => return self.look_for_chip(now),
            // Noise on a line that nothing drives; or not ours to read.
            Presence::Missing | Presence::HandedOver => return,
            Presence::Present | Presence::Silent => {}
        }
        if self.clock.is_late(now) || self.clock.is_restarted() || self.may_be_behind {
            self.read_late(now)
        } else {
            self.read_in_time(now)
        }
        if self.streaming
            && let Some(inputs) = self.inputs.look(self.chip.bus().inputs(), now)
        {
            self.end.notice(Notice::Inputs(inputs));
        }
        if self.job.as_ref().is_some_and(Job::changes_rate) {
            self.clock.restart();
        }
        self.serve(now);
    }

    /// Called every [`IDLE_US`] or more often, from the same priority as [`Self::data_ready`].
    ///
    /// Does nothing while data come. Otherwise it serves requests, looks for the front-end, and counts
    /// what is missing.
    pub fn idle(&mut self, now: DeviceTime) {
        match self.presence {
            Presence::Unknown => self.look_for_chip(now),
            Presence::Present if !self.clock.is_quiet_for(SILENT_AFTER_PERIODS, now) => return,
            Presence::Present => self.fall_silent(now),
            Presence::Missing | Presence::Silent if now.since(self.tried) >= RETRY_US => self.look_for_chip(now),
            Presence::HandedOver if now.since(self.tried) >= HANDED_OVER_US => self.take_back(now),
            Presence::Missing | Presence::Silent | Presence::HandedOver => {}
        }
        self.count_silence(now);
        self.serve_without_edges(now);
    }

    /// An edge at its time: one frame.
    fn read_in_time(&mut self, now: DeviceTime) {
        let outcome = self.exchange(Share::WithJob);
        // A glitch on the line: no conversion, no number.
        if !self.is_too_early(outcome, now) {
            self.conclude(outcome, 1, now);
        }
    }

    /// An edge after one that was missed or a damaged frame, or the first: an older conversion may come
    /// first, and is let go.
    fn read_late(&mut self, now: DeviceTime) {
        // NULL, so that the second frame says whether there was a second conversion.
        let older = self.exchange(Share::NoCommand);
        let newer = self.exchange(Share::WithJob);
        // How many conversions there were at least, and what the newest one is.
        let (least, is_only_one, outcome) = match (older, newer) {
            (Err(Fault::LostSettings), _) => (1, false, older),
            // There was just one: the edge was late, or the first after a pause.
            (_, Ok(Sample { is_new: Some(false), .. })) => (1, true, older),
            // A damaged frame may have left the older one in place, and this would be it.
            (Err(Fault::Damaged { .. }), Ok(_)) => (1, false, older),
            (Ok(_), Ok(_)) => (2, false, newer),
            _ => (1, false, newer),
        };
        self.may_be_behind = matches!(outcome, Err(Fault::Damaged { .. })) && !is_only_one;
        // A glitch on the line, as in `read_in_time`.
        if self.is_too_early(outcome, now) {
            return;
        }
        if is_only_one && self.presence == Presence::Present && !self.clock.is_very_late(now) {
            self.clock.edge_of(now, 1);
            return self.keep(outcome, now);
        }
        self.conclude(outcome, least, now);
    }

    /// Whether an edge comes before a conversion can, and nothing certain says that there was one.
    fn is_too_early(&self, outcome: Result<Sample, Fault>, now: DeviceTime) -> bool {
        let is_certain = match outcome {
            // A chip that a damaged write set to another rate has new codes, but no conversion of ours.
            Ok(sample) => sample.is_new == Some(true) && !self.is_in_doubt(),
            Err(Fault::Damaged { .. }) => false,
            Err(Fault::LostSettings) => true,
        };
        !is_certain && self.clock.is_early(now)
    }

    /// Whether damage may have changed the settings, and they were not read back since: a write is carried
    /// out whatever its checksum says.
    fn is_in_doubt(&self) -> bool {
        self.in_doubt || self.job.as_ref().is_some_and(|job| job.goal == Goal::Verify)
    }

    /// Counts an edge with all that was missed before it, and keeps what it brought; there were at least so
    /// many conversions since the edge before.
    fn conclude(&mut self, outcome: Result<Sample, Fault>, least: u32, now: DeviceTime) {
        let is_gap_in_unknown_timing = self.clock.is_restarted() && (least > 1 || self.presence == Presence::Silent);
        let conversions = if is_gap_in_unknown_timing {
            // Between two rates the slower one tells how many there were for certain.
            let to_be = self.job.as_ref().and_then(Job::rate_to_be).unwrap_or(self.settings.rate);
            let sure = self.clock.conversions_at(to_be.min(self.settings.rate), now);
            self.clock.edge_of(now, sure.max(least))
        } else {
            self.clock.edge(now)
        };
        self.skip_numbers(conversions.saturating_sub(1));
        self.keep(outcome, now);
    }

    /// Numbers what an edge brought.
    fn keep(&mut self, outcome: Result<Sample, Fault>, now: DeviceTime) {
        self.begin_stretch_when_due();
        match outcome {
            Ok(sample) => self.keep_sample(sample, now),
            Err(fault) => {
                self.number_damaged();
                self.treat(fault, now);
            }
        }
        self.settling = self.settling.saturating_sub(1);
    }

    /// Numbers and queues a good sample.
    fn keep_sample(&mut self, Sample { counts, slow, .. }: Sample, now: DeviceTime) {
        self.damaged_run = 0;
        self.presence = Presence::Present;
        if core::mem::take(&mut self.unwell) {
            self.tell(now, EventKind::FrontEndRecovered);
        }
        let status = self.status_of(counts);
        if let Some(slow) = slow {
            self.add_slow(slow, status, now);
        }
        if self.streaming {
            let reading = RawReading { seq: self.next, time: now, counts, status };
            self.next = self.next.plus(1);
            if !self.is_in_doubt() {
                self.end.reading(reading);
            } else if self.held.push_back(reading).is_err() {
                self.end.damaged();
            }
        }
    }

    /// Adds what the slow channels gave, and tells the mean when it is due. What is in doubt or unsettled is left out.
    fn add_slow(&mut self, slow: [Counts; 2], status: Status, now: DeviceTime) {
        if status.contains(Status::SETTLING) || self.is_in_doubt() {
            return;
        }
        let sum = &mut self.slow;
        for (total, code) in sum.codes.iter_mut().zip(slow) {
            *total += i64::from(code.0);
        }
        sum.conversions += 1;
        if sum.conversions < SLOW_CONVERSIONS {
            return;
        }
        // A mean of codes is a code.
        let mean = |total: i64| Counts(i32::try_from(total / i64::from(SLOW_CONVERSIONS)).unwrap_or(i32::MAX));
        let [excitation, ntc] = core::mem::take(sum).codes.map(mean);
        let simulated = if status.contains(Status::SIMULATED) { Status::SIMULATED } else { Status::default() };
        self.end.notice(Notice::Slow(SlowChannels { time: now, status: simulated, excitation, ntc }));
    }

    /// What holds for a sample; remembers saturation for the self-test.
    fn status_of(&mut self, counts: [Counts; 2]) -> Status {
        let [saturated_0, saturated_1] = counts.map(Counts::is_saturated);
        self.lately[0].saturated |= saturated_0 || saturated_1;
        // While settings are being written nobody knows which of both the chip has.
        let is_being_set = self.job.as_ref().is_some_and(|job| matches!(job.goal, Goal::Apply { .. }));
        let flags = [
            (self.chip.bus().is_simulated(), Status::SIMULATED),
            (saturated_0, Status::SATURATED_0),
            (saturated_1, Status::SATURATED_1),
            (is_being_set || self.settling > 0, Status::SETTLING),
        ];
        flags.into_iter().filter(|(is_set, _)| *is_set).fold(Status::default(), |status, (_, flag)| status.with(flag))
    }

    /// Queues the first of the samples that waited.
    #[inline(never)]
    fn release(&mut self, proved: usize) {
        for _ in 0..proved {
            let Some(reading) = self.held.pop_front() else { return };
            self.end.reading(reading);
        }
    }

    /// Counts the samples that waited as damaged.
    #[inline(never)]
    fn give_up_held(&mut self) {
        while self.held.pop_front().is_some() {
            self.end.damaged();
        }
    }

    /// Gives a number to a conversion whose frame was no good.
    fn number_damaged(&mut self) {
        if self.streaming {
            self.next = self.next.plus(1);
            self.end.damaged();
        }
    }

    /// Leaves out the numbers of conversions that nobody read.
    fn skip_numbers(&mut self, missed: u32) {
        if self.streaming && missed > 0 {
            self.next = self.next.plus(missed);
            self.end.missed(missed);
        }
        self.settling = self.settling.saturating_sub(u8::try_from(missed).unwrap_or(u8::MAX));
    }

    /// Does what a bad frame calls for.
    fn treat(&mut self, fault: Fault, now: DeviceTime) {
        match fault {
            Fault::LostSettings => self.restore_settings(now),
            Fault::Damaged { word } => {
                self.damaged_run = self.damaged_run.saturating_add(1);
                if self.damaged_run >= GONE_AFTER_DAMAGED {
                    self.go_missing(word, now);
                }
            }
        }
    }

    /// Exchanges one frame, for whatever request is at work.
    fn exchange(&mut self, share: Share) -> Result<Sample, Fault> {
        let ask = self.job.as_ref().filter(|_| share == Share::WithJob).map_or(Ask::Nothing, Job::ask);
        let result = self.chip.read_frame(ask);
        if result.as_ref().map_or(true, |reading| reading.tells_input_damage) {
            self.lately[0].damaged += 1;
            self.in_doubt = true;
        }
        let answer = result.as_ref().ok().filter(|reading| !reading.has_lost_settings).map(|reading| reading.answer);
        self.advance_job(ask, share, answer);
        match result {
            Err(trouble) if trouble.has_lost_settings => Err(Fault::LostSettings),
            Err(trouble) => {
                self.may_be_behind = true;
                Err(Fault::Damaged { word: trouble.word })
            }
            Ok(Reading { has_lost_settings: true, .. }) => Err(Fault::LostSettings),
            Ok(Reading { counts, slow, is_new, .. }) => Ok(Sample { counts, slow, is_new }),
        }
    }

    /// Tells the job at work what came in. While it writes settings, nothing has settled.
    fn advance_job(&mut self, ask: Ask, share: Share, answer: Option<Answer>) {
        let Some(job) = &mut self.job else { return };
        if matches!(ask, Ask::Write(..)) {
            // The conversion that is read in this frame still is what it was; it is marked all the same,
            // and taken off when it is numbered, hence one more.
            self.settling = SETTLING_CONVERSIONS + 1;
        }
        job.advance(share == Share::WithJob, answer);
    }

    /// Answers a finished job, or takes up the next request.
    fn serve(&mut self, now: DeviceTime) {
        self.end.tell_untold();
        match self.job.as_ref().map(Job::progress) {
            Some(Progress::UnderWay) => {}
            Some(progress) => self.finish_job(progress, now),
            None => match self.end.request() {
                Some(request) => self.take_up(request, now),
                None => self.verify_when_in_doubt(),
            },
        }
    }

    /// Reads the settings back after damage: a command that a damaged bit made a write is carried out.
    fn verify_when_in_doubt(&mut self) {
        if self.presence == Presence::Present && core::mem::take(&mut self.in_doubt) {
            self.job = Some(Job::verify::<F>());
            self.held_before = self.held.len();
        }
    }

    /// Serves a request when no data-ready edges come: with frames of its own, their samples let go.
    fn serve_without_edges(&mut self, now: DeviceTime) {
        self.serve(now);
        for _ in 0..FRAMES_PER_IDLE {
            if self.presence != Presence::Silent || self.job.is_none() {
                return;
            }
            if self.exchange(Share::WithJob) == Err(Fault::LostSettings) {
                return self.restore_settings(now);
            }
            self.serve(now);
        }
    }

    /// Begins what a request asks for; answers at once what needs no frames.
    fn take_up(&mut self, request: FrontEndRequest, now: DeviceTime) {
        let is_raw = matches!(request.kind, RequestKind::RawFrame(_));
        if self.presence == Presence::HandedOver && !is_raw {
            self.take_back(now);
        }
        let finding = match request.kind {
            RequestKind::RawFrame(bytes) => self.exchange_raw(bytes, now),
            RequestKind::Stream(on) => self.stream(on, now),
            RequestKind::Select(source) => self.select(source, now),
            _ if self.presence == Presence::Missing => Finding::Refused(Refusal::NoFrontEnd),
            RequestKind::Apply(settings) if settings == self.settings => Finding::Done,
            _ => {
                self.job = Job::of::<F>(request, self.settings);
                return;
            }
        };
        self.answer(request.ticket, finding);
    }

    /// Exchanges a frame for the host, which has the chip to itself from then on.
    fn exchange_raw(&mut self, bytes: [u8; RAW_FRAME_BYTES], now: DeviceTime) -> Finding {
        if self.streaming {
            return Finding::Refused(Refusal::Streaming);
        }
        self.presence = Presence::HandedOver;
        self.tried = now;
        self.chip.exchange_raw(bytes).map_or(Finding::Refused(Refusal::FrontEndSilent), Finding::RawFrame)
    }

    /// Takes the chip back from the host, and gives it its settings.
    fn take_back(&mut self, now: DeviceTime) {
        self.presence = Presence::Unknown;
        self.look_for_chip(now);
    }

    /// Starts or stops streaming.
    fn stream(&mut self, on: bool, now: DeviceTime) -> Finding {
        if on && self.presence == Presence::Missing {
            return Finding::Refused(Refusal::NoFrontEnd);
        }
        if on && !self.streaming && self.presence == Presence::Silent {
            // What was silent before the start is not missing.
            self.clock.skip(now);
        }
        // The answer comes after all samples.
        self.give_up_held();
        self.streaming = on;
        self.inputs.begin();
        Finding::Done
    }

    /// Puts a source behind the bus and looks for its chip.
    fn select(&mut self, source: Source, now: DeviceTime) -> Finding {
        if self.chip.bus_mut().select(source).is_err() {
            return Finding::Refused(Refusal::SourceNotPossible);
        }
        // A source of its own begins at the present; what it could not have measured is not missing.
        self.clock = ConversionClock::new(self.settings.rate, now);
        self.presence = Presence::Unknown;
        self.lately = [Stretch::default(); 2];
        self.slow = SlowSum::default();
        self.look_for_chip(now);
        self.streaming &= self.presence != Presence::Missing;
        Finding::Done
    }

    /// Answers a job that ended.
    fn finish_job(&mut self, progress: Progress, now: DeviceTime) {
        let Some(job) = self.job.take() else { return };
        let finding = if progress == Progress::Done {
            self.found_by(&job, now)
        } else {
            Finding::Refused(Refusal::FrontEndSilent)
        };
        if job.may_have_strayed {
            self.restore_settings(now);
        }
        self.in_doubt |= job.goal == Goal::Verify && progress == Progress::Failed;
        if let Some(ticket) = job.ticket {
            self.answer(ticket, finding);
        }
    }

    /// What a job that ended well found.
    fn found_by(&mut self, job: &Job, now: DeviceTime) -> Finding {
        match job.goal {
            Goal::Apply { settings, changes_rate, .. } => {
                self.settings = settings;
                if changes_rate {
                    if self.presence == Presence::Silent {
                        // The new clock counts from now on.
                        let missed = self.clock.skip(now);
                        self.skip_numbers(missed);
                    }
                    self.clock = ConversionClock::new(settings.rate, now);
                }
                self.lately = [Stretch::default(); 2];
                Finding::Done
            }
            Goal::Read(address) => {
                let [value, ..] = job.words;
                Finding::Register { address, value }
            }
            Goal::SelfTest => Finding::SelfTest(self.self_test(job.words)),
            Goal::Verify => {
                let [mode, clock, gain, ..] = job.words;
                if !self.settings_are(mode, [clock, gain]) {
                    self.restore_settings(now);
                } else {
                    // What is right after new damage was right before it.
                    self.release(if self.in_doubt { self.held_before } else { HELD_MAX });
                }
                Finding::Done
            }
        }
    }

    /// Whether the registers hold what was set.
    fn settings_are(&self, mode: u16, rate_and_gain: [u16; 2]) -> bool {
        mode == F::REGISTERS.mode_word && F::setting_words(self.settings) == rate_and_gain
    }

    /// Judges the registers read and what was seen lately.
    fn self_test(&self, words: [u16; 5]) -> SelfTest {
        let [id_word, mode, clock, gain, status_word] = words;
        let silent = self.presence == Presence::Silent;
        let period_ns = self.clock.measured_ns().filter(|_| !silent);
        let settings_hold = self.settings_are(mode, [clock, gain]);
        let is_known = silent || period_ns.is_some();
        let checks = [
            (Checks::ID, true, id_word >> 8 == u16::from(F::FACTS.id_high)),
            (Checks::SETTINGS, true, settings_hold),
            (Checks::BUS, true, self.lately.iter().all(|stretch| stretch.damaged == 0)),
            (Checks::RATE, is_known, period_ns.is_some_and(|period_ns| self.clock.is_as_set(period_ns))),
            (Checks::RANGE, !silent, !self.lately.iter().any(|stretch| stretch.saturated)),
        ];
        let gather = |wanted: fn(bool) -> bool| {
            let chosen = checks.iter().filter(|(_, checked, passed)| *checked && wanted(*passed));
            chosen.fold(Checks::default(), |all, (check, ..)| all.with(*check))
        };
        let (checked, failed) = (gather(|_| true), gather(|passed| !passed));
        SelfTest { checked, failed, id_word, status_word, period_ns: period_ns.unwrap_or(0) }
    }

    /// Resets the chip, writes its settings and says what came of it.
    fn look_for_chip(&mut self, now: DeviceTime) {
        self.tried = now;
        match self.chip.initialise(self.settings) {
            Ok(id_word) => self.found(id_word, now),
            Err(trouble) => self.go_missing(trouble.word, now),
        }
    }

    /// The chip answers and has its settings.
    fn found(&mut self, id_word: u16, now: DeviceTime) {
        self.settling = SETTLING_CONVERSIONS;
        self.begin_afresh();
        match self.presence {
            Presence::Unknown => {
                self.presence = Presence::Present;
                self.clock = ConversionClock::new(self.settings.rate, now);
            }
            // Its data are still to come.
            Presence::Missing => self.presence = Presence::Silent,
            Presence::Present | Presence::Silent | Presence::HandedOver => return,
        }
        info!("front-end found, id {=u16:x}", id_word);
        self.end.notice(Notice::Found { id_word });
    }

    /// Nothing answers, or not the right chip; said once.
    fn go_missing(&mut self, id_word: u16, now: DeviceTime) {
        if self.presence == Presence::Missing {
            return;
        }
        warning!("no front-end, id reads {=u16:x}", id_word);
        self.presence = Presence::Missing;
        self.give_up_held();
        self.damaged_run = 0;
        self.unwell = true;
        self.tried = now;
        self.tell(now, EventKind::FrontEndMissing { id_word });
        if let Some(ticket) = self.job.take().and_then(|job| job.ticket) {
            self.answer(ticket, Finding::Refused(Refusal::NoFrontEnd));
        }
    }

    /// No edges for too long; said once.
    fn fall_silent(&mut self, now: DeviceTime) {
        let quiet_us = self.clock.quiet_us(now);
        warning!("front-end silent for {=u32} us", quiet_us);
        self.presence = Presence::Silent;
        self.unwell = true;
        self.tried = now;
        self.tell(now, EventKind::FrontEndSilent { quiet_us });
    }

    /// The chip was reset, by a dip of its supply or a damaged command: writes its settings again.
    fn restore_settings(&mut self, now: DeviceTime) {
        self.tried = now;
        match self.chip.initialise(self.settings) {
            Ok(_) => {
                // One more than usual, as the edge at work is taken off at its end.
                self.settling = SETTLING_CONVERSIONS + 1;
                self.begin_afresh();
                self.tell(now, EventKind::FrontEndReset);
            }
            Err(trouble) => self.go_missing(trouble.word, now),
        }
    }

    /// The chip was reset, and its settings were written and read back: nothing is in doubt, and what the
    /// job at work did is undone.
    fn begin_afresh(&mut self) {
        self.damaged_run = 0;
        self.in_doubt = false;
        self.give_up_held();
        self.job = self.job.take().filter(|job| job.goal != Goal::Verify);
        if let Some(job) = &mut self.job {
            job.restart();
        }
    }

    /// Counts what is missing in a long silence.
    fn count_silence(&mut self, now: DeviceTime) {
        if self.clock.quiet_us(now) >= COUNT_SILENCE_US {
            let missed = self.clock.skip(now);
            self.skip_numbers(missed);
        }
    }

    /// Begins a new stretch after [`WINDOW`] edges.
    fn begin_stretch_when_due(&mut self) {
        let [current, _] = &mut self.lately;
        current.edges += 1;
        if current.edges >= WINDOW {
            let finished = *current;
            self.lately = [Stretch::default(), finished];
        }
    }

    /// Answers the request of this ticket.
    fn answer(&mut self, ticket: u8, finding: Finding) {
        let source = if self.chip.bus().is_simulated() { Source::Simulated } else { Source::Hardware };
        let state = SamplerState { settings: self.settings, source, streaming: self.streaming };
        self.end.notice(Notice::Answer { ticket, finding, state });
    }

    /// Reports an event to the device's end.
    fn tell(&mut self, time: DeviceTime, kind: EventKind) {
        self.end.notice(Notice::Event { time, kind });
    }
}

// The tests run on every chip that the datasheet allows; `tests/rig/chip.rs` reads which one from the module's name.
#[cfg(test)]
mod tests;
#[cfg(test)]
#[path = "sampler/tests.rs"]
mod tests_reset_at_last_clock;
#[cfg(test)]
#[path = "sampler/tests.rs"]
mod tests_status_at_frame_end;
#[cfg(test)]
#[path = "sampler/tests.rs"]
mod tests_status_at_frame_end_reset_at_last_clock;
