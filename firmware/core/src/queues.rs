//! All that the interrupt side and the main side share: queues for one writer and one reader, and counters.
//!
//! Nothing here locks or waits. On a board, put [`Queues`] into a `static` and split it once; either end
//! may then live in an interrupt handler.
//!
//! ```
//! use palpate_firmware_core::Queues;
//! let mut queues = Queues::new();
//! let (sampler_end, device_end) = queues.split();
//! # drop((sampler_end, device_end));
//! ```

use core::sync::atomic::{AtomicU32, Ordering};

use heapless::spsc::{Consumer, Producer, Queue};
use palpate_shared::units::{Counts, DeviceTime, Seq};
use palpate_shared::wire::{EventKind, Inputs, RAW_FRAME_BYTES, Refusal, SelfTest, SlowChannels, Source, Status};

use crate::settings::DeviceSettings;

/// Places for samples, one of them never used: 32 ms at 4 kHz for the main side to come by.
pub const READINGS: usize = 128;

/// Places for notices, one of them never used.
const NOTICES: usize = 16;

/// Places for requests, one of them never used: one at work, one given up on.
const REQUESTS: usize = 3;

/// Places for notices that only answers take: one for each request that can be under way while the main side stands
/// still, those that wait and the one that the sampler works on. An answer that is lost would leave the main side with
/// settings that the front-end no longer has.
const ANSWERS_MAX: usize = REQUESTS;

/// One sample, as the sampler gives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawReading {
    /// Number of the sample.
    pub seq: Seq,
    /// When it became ready.
    pub time: DeviceTime,
    /// Codes of both channels.
    pub counts: [Counts; 2],
    /// What holds for it; [`Status::GAP_BEFORE`] is left to the block builder.
    pub status: Status,
}

/// What the main side asks the sampler for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RequestKind {
    Stream(bool),
    Apply(DeviceSettings),
    Select(Source),
    ReadRegister(u8),
    SelfTest,
    RawFrame([u8; RAW_FRAME_BYTES]),
}

/// A request with the number that its answer will carry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrontEndRequest {
    pub(crate) ticket: u8,
    pub(crate) kind: RequestKind,
}

/// What came of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Finding {
    Done,
    Register { address: u8, value: u16 },
    SelfTest(SelfTest),
    RawFrame([u8; RAW_FRAME_BYTES]),
    Refused(Refusal),
}

/// How the sampler is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SamplerState {
    pub(crate) settings: DeviceSettings,
    pub(crate) source: Source,
    pub(crate) streaming: bool,
}

/// What the sampler tells the main side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Notice {
    /// The front-end answers with this ID.
    Found { id_word: u16 },
    /// Something the host should hear of.
    Event { time: DeviceTime, kind: EventKind },
    /// What the slow channels gave on average.
    Slow(SlowChannels),
    /// Digital inputs, as they changed or stood at the start of the stream.
    Inputs(Inputs),
    /// The answer to a request, and how the sampler is set after it.
    Answer { ticket: u8, finding: Finding, state: SamplerState },
}

impl Notice {
    /// Whether it says that the front-end answers or that it does not.
    fn tells_presence(&self) -> bool {
        matches!(self, Self::Found { .. } | Self::Event { kind: EventKind::FrontEndMissing { .. }, .. })
    }
}

/// What the sampler counted; each counter wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Conversions while streaming, all numbered.
    pub samples: u32,
    /// Of these: not read in time.
    pub missed: u32,
    /// Of these: damaged on the bus.
    pub damaged: u32,
    /// Of these: no room in the queue.
    pub dropped: u32,
    /// Notices with no room in their queue.
    pub notices_dropped: u32,
}

/// The counters in a form that both sides can reach.
#[derive(Debug)]
pub(crate) struct SharedTally {
    samples: AtomicU32,
    missed: AtomicU32,
    damaged: AtomicU32,
    dropped: AtomicU32,
    notices_dropped: AtomicU32,
}

/// Reads of the counters before a changing set of them is taken as it is.
const SNAPSHOT_TRIES: u32 = 4;

impl SharedTally {
    const fn new() -> Self {
        Self {
            samples: AtomicU32::new(0),
            missed: AtomicU32::new(0),
            damaged: AtomicU32::new(0),
            dropped: AtomicU32::new(0),
            notices_dropped: AtomicU32::new(0),
        }
    }

    /// Stores a new state; only the sampler does.
    fn publish(&self, tally: &Tally) {
        self.missed.store(tally.missed, Ordering::Relaxed);
        self.damaged.store(tally.damaged, Ordering::Relaxed);
        self.dropped.store(tally.dropped, Ordering::Relaxed);
        self.notices_dropped.store(tally.notices_dropped, Ordering::Relaxed);
        self.samples.store(tally.samples, Ordering::Release);
    }

    /// The counters as they stood together at one moment.
    ///
    /// An interrupt in between is seen as two reads that differ. It comes every 125 µs at most, so the
    /// second try is quiet; if none is, the last one is right to within a sample.
    fn snapshot(&self) -> Tally {
        let mut tally = self.read();
        for _ in 1..SNAPSHOT_TRIES {
            let again = self.read();
            if again == tally {
                break;
            }
            tally = again;
        }
        tally
    }

    fn read(&self) -> Tally {
        Tally {
            samples: self.samples.load(Ordering::Acquire),
            missed: self.missed.load(Ordering::Relaxed),
            damaged: self.damaged.load(Ordering::Relaxed),
            dropped: self.dropped.load(Ordering::Relaxed),
            notices_dropped: self.notices_dropped.load(Ordering::Relaxed),
        }
    }
}

/// What the two sides share.
#[derive(Debug)]
pub struct Queues {
    readings: Queue<RawReading, READINGS>,
    notices: Queue<Notice, NOTICES>,
    requests: Queue<FrontEndRequest, REQUESTS>,
    tally: SharedTally,
}

impl Default for Queues {
    fn default() -> Self {
        Self::new()
    }
}

impl Queues {
    /// Queues with nothing in them.
    #[must_use]
    pub const fn new() -> Self {
        Self { readings: Queue::new(), notices: Queue::new(), requests: Queue::new(), tally: SharedTally::new() }
    }

    /// The sampler's end and the device's.
    pub fn split(&mut self) -> (SamplerEnd<'_>, DeviceEnd<'_>) {
        let (readings_in, readings) = self.readings.split();
        let (notices_in, notices) = self.notices.split();
        let (requests_in, requests) = self.requests.split();
        let shared = &self.tally;
        let sampler = SamplerEnd {
            readings: readings_in,
            notices: notices_in,
            requests,
            shared,
            tally: Tally::default(),
            untold: None,
        };
        (sampler, DeviceEnd { readings, notices, requests: requests_in, shared })
    }
}

/// The sampler's end of the queues.
pub struct SamplerEnd<'q> {
    readings: Producer<'q, RawReading>,
    notices: Producer<'q, Notice>,
    requests: Consumer<'q, FrontEndRequest>,
    shared: &'q SharedTally,
    /// The sampler's own copy of the counters.
    tally: Tally,
    /// Whether the front-end answers, for which there was no room; told as soon as there is.
    untold: Option<Notice>,
}

// Never inlined: the sampler counts in a dozen places, and the image has a size to keep.
impl SamplerEnd<'_> {
    /// Counts conversions that nobody read.
    #[inline(never)]
    pub(crate) fn missed(&mut self, count: u32) {
        self.count(|tally| {
            tally.samples = tally.samples.wrapping_add(count);
            tally.missed = tally.missed.wrapping_add(count);
        });
    }

    /// Counts a conversion whose frame was damaged.
    #[inline(never)]
    pub(crate) fn damaged(&mut self) {
        self.count(|tally| {
            tally.samples = tally.samples.wrapping_add(1);
            tally.damaged = tally.damaged.wrapping_add(1);
        });
    }

    /// Queues a sample, or counts it as dropped.
    #[inline(never)]
    pub(crate) fn reading(&mut self, reading: RawReading) {
        let dropped = u32::from(self.readings.enqueue(reading).is_err());
        self.count(|tally| {
            tally.samples = tally.samples.wrapping_add(1);
            tally.dropped = tally.dropped.wrapping_add(dropped);
        });
    }

    /// Queues a notice, keeps it for later, or counts it as dropped.
    #[inline(never)]
    pub(crate) fn notice(&mut self, notice: Notice) {
        let tells_presence = notice.tells_presence();
        let kept_free = if matches!(notice, Notice::Answer { .. }) { 0 } else { ANSWERS_MAX };
        // What the main side knows of the front-end must not stay behind: the newest word on it waits for room.
        let overtaken = if tells_presence { self.untold.take() } else { None };
        let has_room = self.notices.len() + kept_free < self.notices.capacity();
        let dropped = if has_room {
            u32::from(self.notices.enqueue(notice).is_err())
        } else if tells_presence {
            self.untold = Some(notice);
            0
        } else {
            1
        };
        let dropped = dropped + u32::from(overtaken.is_some());
        if dropped > 0 {
            self.count(|tally| tally.notices_dropped = tally.notices_dropped.wrapping_add(dropped));
        }
    }

    /// Tells what waits for room, if there is any now; to be called often.
    pub(crate) fn tell_untold(&mut self) {
        if let Some(notice) = self.untold.take() {
            self.notice(notice);
        }
    }

    /// The oldest request that waits, if any.
    pub(crate) fn request(&mut self) -> Option<FrontEndRequest> {
        self.requests.dequeue()
    }

    fn count(&mut self, change: impl FnOnce(&mut Tally)) {
        change(&mut self.tally);
        self.shared.publish(&self.tally);
    }
}

/// The device's end of the queues.
pub struct DeviceEnd<'q> {
    readings: Consumer<'q, RawReading>,
    notices: Consumer<'q, Notice>,
    requests: Producer<'q, FrontEndRequest>,
    shared: &'q SharedTally,
}

impl DeviceEnd<'_> {
    /// The oldest sample that waits, if any.
    pub(crate) fn reading(&mut self) -> Option<RawReading> {
        self.readings.dequeue()
    }

    /// The oldest notice that waits, if any.
    pub(crate) fn notice(&mut self) -> Option<Notice> {
        self.notices.dequeue()
    }

    /// Queues a request; tells whether there was room.
    pub(crate) fn request(&mut self, request: FrontEndRequest) -> bool {
        self.requests.enqueue(request).is_ok()
    }

    /// What the sampler has counted.
    #[must_use]
    pub fn tally(&self) -> Tally {
        self.shared.snapshot()
    }
}
