//! What survives a restart: how often the firmware started, what it meant to do, and its last fault.
//!
//! The record lies in RAM that start-up does not clear. After power-on it holds anything, so it carries a checksum
//! and counts only if that is right. Pure, and tested on a PC; `image/fault.rs` reads and writes it.

use heapless::String;
use palpate_shared::wire::{Fault, FaultCause, RestartReason};

/// Start and factor of the FNV-1a hash, 32 bits: a few instructions, and memory that was never written passes once
/// in 2³² times.
const FNV: (u32, u32) = (0x811C_9DC5, 0x0100_0193);

/// Bytes for a place.
const PLACE: usize = 40;

/// Why the firmware restarts itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum Intent {
    /// It does not: the restart is not of its own doing.
    None = 0,
    /// It was asked to.
    Requested = 1,
    /// It met a fault.
    Fault = 2,
    /// It was asked to hand over to the chip's own loader.
    EnterLoader = 3,
}

/// The record. Every pattern of bits is one, sound or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub(crate) struct Record {
    restarts: u32,
    intent: u32,
    /// The cause's number plus one; 0 where there was no fault.
    cause: u32,
    uptime_s: u32,
    samples: u32,
    program_counter: u32,
    return_address: u32,
    fault_status: u32,
    place: [u8; PLACE],
    checksum: u32,
}

/// What the processor says about its last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ResetFlags {
    pub(crate) power_on: bool,
    pub(crate) brown_out: bool,
    pub(crate) watchdog: bool,
    pub(crate) software: bool,
    pub(crate) pin: bool,
}

impl Record {
    /// Of a device that has just got power.
    pub(crate) const FIRST: Self = Self {
        restarts: 0,
        intent: 0,
        cause: 0,
        uptime_s: 0,
        samples: 0,
        program_counter: 0,
        return_address: 0,
        fault_status: 0,
        place: [0; PLACE],
        checksum: 0,
    };

    /// What the last run left, if it is sound.
    pub(crate) fn checked(self) -> Option<Self> {
        (self.hash() == self.checksum).then_some(self)
    }

    /// The record with the checksum of its content.
    pub(crate) fn sealed(self) -> Self {
        Self { checksum: self.hash(), ..self }
    }

    /// The record with another intent.
    pub(crate) fn with_intent(self, intent: Intent) -> Self {
        Self { intent: intent as u32, ..self }
    }

    /// With a fault, which is then why the firmware restarts.
    pub(crate) fn with_fault(self, fault: &Fault) -> Self {
        let mut place = [0; PLACE];
        for (byte, of_fault) in place.iter_mut().zip(fault.place.bytes()) {
            *byte = of_fault;
        }
        let cause = 1 + match fault.cause {
            FaultCause::Panic => 0,
            FaultCause::Processor => 1,
            FaultCause::StackOverflow => 2,
            FaultCause::Hang => 3,
        };
        let Fault { uptime_s, samples, program_counter, return_address, fault_status, .. } = *fault;
        let intent = Intent::Fault as u32;
        Self { intent, cause, uptime_s, samples, program_counter, return_address, fault_status, place, ..self }
    }

    /// The record of the run that begins, and why it does; `last` is what the run before left.
    pub(crate) fn begin(last: Option<Self>, flags: ResetFlags) -> (Self, RestartReason) {
        match last {
            Some(last) if !flags.power_on => {
                let restarts = last.restarts.saturating_add(1);
                (Self { restarts, ..last }.with_intent(Intent::None), last.reason(flags))
            }
            _ if flags.brown_out && !flags.power_on => (Self::FIRST, RestartReason::BrownOut),
            _ => (Self::FIRST, RestartReason::PowerOn),
        }
    }

    /// Whether the run that begins is to hand over to the loader; `last` is what the run before left.
    pub(crate) fn wants_loader(last: Option<Self>, flags: ResetFlags) -> bool {
        !flags.power_on && last.is_some_and(|last| last.intent == Intent::EnterLoader as u32)
    }

    /// Why the run after this record began.
    fn reason(&self, flags: ResetFlags) -> RestartReason {
        match (self.fault().map(|fault| fault.cause), self.intent) {
            (Some(FaultCause::Hang), 2) => RestartReason::Watchdog,
            (Some(_), 2) => RestartReason::Panic,
            (_, 1 | 3) => RestartReason::Requested,
            _ if flags.brown_out => RestartReason::BrownOut,
            _ if flags.watchdog => RestartReason::Watchdog,
            // A debug probe's doing.
            _ if flags.software => RestartReason::Requested,
            // Last, as every reset pulls the pin as well.
            _ if flags.pin => RestartReason::Pin,
            _ => RestartReason::Unknown,
        }
    }

    /// Starts since power-on, this one not counted.
    pub(crate) fn restarts(&self) -> u16 {
        u16::try_from(self.restarts).unwrap_or(u16::MAX)
    }

    /// The last fault since power-on.
    pub(crate) fn fault(&self) -> Option<Fault> {
        let causes = [FaultCause::Panic, FaultCause::Processor, FaultCause::StackOverflow, FaultCause::Hang];
        let cause = *causes.get(usize::try_from(self.cause.checked_sub(1)?).ok()?)?;
        let mut place = String::new();
        let characters = self.place.iter().take_while(|&&byte| byte != 0).map(|&byte| char::from(byte));
        // Fails at the first that does not fit, which is where the place ends.
        let _ = characters.into_iter().try_for_each(|character| place.push(character));
        let Self { uptime_s, samples, program_counter, return_address, fault_status, .. } = *self;
        Some(Fault { cause, uptime_s, samples, program_counter, return_address, fault_status, place })
    }

    fn hash(&self) -> u32 {
        let words = [self.restarts, self.intent, self.cause, self.uptime_s, self.samples];
        let more = [self.program_counter, self.return_address, self.fault_status];
        let bytes = words.into_iter().chain(more).flat_map(u32::to_le_bytes).chain(self.place);
        bytes.fold(FNV.0, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(FNV.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOFTWARE: ResetFlags =
        ResetFlags { software: true, pin: true, power_on: false, brown_out: false, watchdog: false };
    const POWER_ON: ResetFlags =
        ResetFlags { power_on: true, brown_out: true, pin: true, watchdog: false, software: false };

    fn fault(cause: FaultCause) -> Fault {
        Fault {
            cause,
            uptime_s: 7,
            samples: 28_000,
            program_counter: 0x0800_1234,
            return_address: 0x0800_4321,
            fault_status: 0x8200,
            place: String::try_from("image/mod.rs:99").unwrap(),
        }
    }

    #[test]
    fn what_is_not_sealed_does_not_count() {
        let sealed = Record::FIRST.with_fault(&fault(FaultCause::Panic)).sealed();
        assert_eq!(sealed.checked(), Some(sealed));
        for damaged in
            [Record { restarts: 1, ..sealed }, Record { checksum: sealed.checksum ^ 1, ..sealed }, Record::FIRST]
        {
            assert_eq!(damaged.checked(), None);
        }
    }

    #[test]
    fn a_fault_comes_back_as_it_was_recorded_and_stays_over_further_restarts() {
        for cause in [FaultCause::Panic, FaultCause::Processor, FaultCause::StackOverflow, FaultCause::Hang] {
            let recorded = Record::FIRST.with_fault(&fault(cause)).sealed();
            let (next, reason) = Record::begin(recorded.checked(), SOFTWARE);
            let wanted = if cause == FaultCause::Hang { RestartReason::Watchdog } else { RestartReason::Panic };
            assert_eq!((reason, next.restarts(), next.fault()), (wanted, 1, Some(fault(cause))));
            let (after, reason) = Record::begin(next.with_intent(Intent::Requested).sealed().checked(), SOFTWARE);
            assert_eq!((reason, after.restarts()), (RestartReason::Requested, 2));
            assert_eq!(after.fault(), Some(fault(cause)));
        }
    }

    #[test]
    fn power_on_forgets_whatever_the_memory_held() {
        let left = Record::FIRST.with_fault(&fault(FaultCause::Panic)).sealed();
        assert_eq!(Record::begin(left.checked(), POWER_ON), (Record::FIRST, RestartReason::PowerOn));
        assert_eq!(Record::begin(None, ResetFlags::default()), (Record::FIRST, RestartReason::PowerOn));
    }

    #[test]
    fn the_loader_is_entered_once_and_only_where_it_was_asked_for() {
        let asked = Record::FIRST.with_intent(Intent::EnterLoader).sealed().checked();
        assert!(Record::wants_loader(asked, SOFTWARE));
        // Memory that happens to be so after power-on was not asked.
        assert!(!Record::wants_loader(asked, POWER_ON));
        let (next, reason) = Record::begin(asked, SOFTWARE);
        assert_eq!((reason, next.restarts()), (RestartReason::Requested, 1));
        for last in [None, next.sealed().checked(), Record::FIRST.with_intent(Intent::Requested).sealed().checked()] {
            assert!(!Record::wants_loader(last, SOFTWARE), "{last:?}");
        }
    }

    #[test]
    fn what_the_processor_says_counts_where_the_firmware_meant_nothing() {
        let left = Record::FIRST.sealed().checked();
        let flags = ResetFlags { pin: true, ..ResetFlags::default() };
        let table = [
            (ResetFlags { brown_out: true, ..flags }, RestartReason::BrownOut),
            (ResetFlags { watchdog: true, ..flags }, RestartReason::Watchdog),
            (ResetFlags { software: true, ..flags }, RestartReason::Requested),
            (flags, RestartReason::Pin),
            (ResetFlags::default(), RestartReason::Unknown),
        ];
        for (flags, wanted) in table {
            assert_eq!(Record::begin(left, flags).1, wanted, "{flags:?}");
        }
    }
}
