//! Messages on their way to the host: a bounded ring of encoded frames.
//!
//! A frame goes in whole or not at all. Blocks, and whatever else comes at its own times, leave [`RESERVED`] bytes free, so that a link which cannot
//! keep up with samples still carries replies and events. Replies and events have an allowance, so that a host
//! which asks without end does not crowd the samples out: five eighths of the ring, given anew whenever nothing
//! waits, and a twentieth of what goes out meanwhile (what rates leave free of a line). One byte stays free for the
//! delimiter with which [`Outbox::redirect`] begins on another link.
//! Errors: none; what does not fit is refused by return value.

use palpate_shared::frame::{DELIMITER, FRAME_MAX, encode};
use palpate_shared::wire::{FrameBuffer, FromDevice};

use crate::settings::HEADROOM_INVERSE;

/// Bytes that blocks leave free: three of the longest replies, with events beside them.
pub const RESERVED: usize = 256;

/// Bytes that go out for one that replies and events may take.
const BYTES_PER_EARNED: usize = HEADROOM_INVERSE as usize;

/// A ring of `N` bytes.
#[derive(Clone, Debug)]
pub struct Outbox<const N: usize> {
    bytes: [u8; N],
    /// Where the oldest byte is; less than `N`.
    start: usize,
    /// How many bytes wait; less than `N`.
    length: usize,
    /// Whether the last byte that went out is in the middle of a frame.
    is_mid_frame: bool,
    /// Bytes that replies and events may still take.
    allowance: usize,
    /// Bytes that went out since the allowance last grew; less than [`BYTES_PER_EARNED`].
    unpaid: usize,
}

impl<const N: usize> Default for Outbox<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Outbox<N> {
    /// What replies and events may take of the ring at most, in bytes.
    const ALLOWANCE_MAX: usize = N / 8 * 5;

    /// An empty ring.
    ///
    /// Does not compile for less than 512 bytes: a block would hardly find room.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(N >= 2 * RESERVED, "an outbox needs at least 512 bytes") }
        Self { bytes: [0; N], start: 0, length: 0, is_mid_frame: false, allowance: Self::ALLOWANCE_MAX, unpaid: 0 }
    }

    /// Adds a bare delimiter, which ends whatever half a frame the line carried before a restart.
    pub fn push_delimiter(&mut self) {
        if self.length + 1 < N {
            self.append(&[DELIMITER]);
        }
    }

    /// Adds a message's frame; tells whether there was room.
    pub fn push_message(&mut self, message: &FromDevice) -> bool {
        let mut line: FrameBuffer = [0; FRAME_MAX + 1];
        let Ok(frame) = encode(message, &mut line) else { return false };
        let is_periodic = matches!(
            message,
            FromDevice::Block(_) | FromDevice::Force(_) | FromDevice::Temperature(_) | FromDevice::SlowChannels(_)
        );
        let kept_free = if is_periodic { RESERVED } else { 0 };
        let is_allowed = is_periodic || frame.len() <= self.allowance;
        let has_room = is_allowed && frame.len() + kept_free < N - self.length;
        if has_room {
            self.append(frame);
            self.allowance -= if is_periodic { 0 } else { frame.len() };
        }
        has_room
    }

    /// The oldest bytes, as many as lie in a row; empty only if nothing waits.
    #[must_use]
    pub fn readable(&self) -> &[u8] {
        let end = (self.start + self.length).min(N);
        self.bytes.get(self.start..end).unwrap_or_default()
    }

    /// Lets go of the oldest `n` bytes, or of all if there are fewer.
    pub fn consume(&mut self, n: usize) {
        let n = n.min(self.length);
        if let Some(last) = n.checked_sub(1) {
            self.is_mid_frame = self.waiting(last) != Some(DELIMITER);
        }
        self.length -= n;
        self.earn(n);
        self.start = if self.length == 0 { 0 } else { (self.start + n) % N };
    }

    /// Lets the allowance grow with the bytes that went out.
    fn earn(&mut self, sent: usize) {
        let unpaid = self.unpaid + sent;
        let earned = if self.length == 0 { Self::ALLOWANCE_MAX } else { unpaid / BYTES_PER_EARNED };
        self.allowance = (self.allowance + earned).min(Self::ALLOWANCE_MAX);
        self.unpaid = unpaid % BYTES_PER_EARNED;
    }

    /// What waits goes another way from here on: lets go of a message that is half out, and begins with a delimiter,
    /// which ends whatever half a frame that way carried before.
    pub fn redirect(&mut self) {
        if self.is_mid_frame {
            let rest = (0..self.length).take_while(|&at| self.waiting(at) != Some(DELIMITER)).count();
            self.consume(rest + 1);
        }
        if self.waiting(0) == Some(DELIMITER) {
            return;
        }
        self.start = (self.start + N - 1) % N;
        if let Some(place) = self.bytes.get_mut(self.start) {
            *place = DELIMITER;
            self.length += 1;
        }
    }

    /// One of the bytes that wait, by its place in the row.
    fn waiting(&self, at: usize) -> Option<u8> {
        if at < self.length { self.bytes.get((self.start + at) % N).copied() } else { None }
    }

    /// How many bytes wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.length
    }

    /// Whether no byte waits to be sent.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Adds bytes for which there is room, in two pieces where the ring ends.
    fn append(&mut self, frame: &[u8]) {
        let at = (self.start + self.length) % N;
        let (before, after) = self.bytes.split_at_mut(at);
        let straight = frame.len().min(after.len());
        let (head, tail) = frame.split_at(straight);
        after[..straight].copy_from_slice(head);
        before[..tail.len()].copy_from_slice(tail);
        self.length += frame.len();
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use palpate_shared::frame::FrameReader;
    use palpate_shared::units::{Counts, DeviceTime, Seq};
    use palpate_shared::wire::{Block, CommandId, Outcome, Reply, Status};
    use proptest::prelude::*;

    use super::*;

    fn block(n: u32) -> FromDevice {
        let samples = [[Counts(1000), Counts(-1000)]; 8].into_iter().collect();
        FromDevice::Block(Block { first: Seq(n), time: DeviceTime(n), status: Status::default(), samples })
    }

    fn reply(n: u32) -> FromDevice {
        FromDevice::Reply(Reply { id: CommandId(n), outcome: Outcome::Done })
    }

    #[test]
    fn blocks_leave_room_for_replies() {
        let mut outbox = Outbox::<1024>::new();
        while outbox.push_message(&block(1)) {}
        let blocks = outbox.len();
        // One more block might have fitted but for the reserve; blocks here take about 50 bytes.
        assert!((1024 - RESERVED - 60..=1024 - RESERVED).contains(&blocks), "{blocks}");
        assert!(outbox.push_message(&reply(1)) && !outbox.push_message(&block(2)));
        let replies = (2..1000).filter(|&n| outbox.push_message(&reply(n))).count();
        assert!(replies >= RESERVED / 10, "{replies}");
        assert!(outbox.len() <= 1024);
    }

    #[test]
    fn replies_without_end_leave_room_for_blocks() {
        let mut outbox = Outbox::<1024>::new();
        while outbox.push_message(&reply(1)) {}
        assert!(outbox.len() <= 640, "{}", outbox.len());
        assert!(outbox.push_message(&block(1)));
        // A twentieth of what goes out may come in again as replies: 10 bytes of 200.
        outbox.consume(200);
        assert!(outbox.push_message(&reply(2)) && !outbox.push_message(&reply(3)));
        outbox.consume(usize::MAX);
        assert!((0..20).all(|n| outbox.push_message(&reply(n))));
    }

    #[test]
    fn consuming_more_than_there_is_empties_the_box() {
        let mut outbox = Outbox::<512>::new();
        outbox.consume(7);
        assert!(outbox.push_message(&reply(1)));
        outbox.consume(usize::MAX);
        assert!(outbox.is_empty() && outbox.readable().is_empty());
    }

    /// All messages in a row of bytes, and how many frames in it were damaged.
    fn read(bytes: &[u8]) -> (Vec<FromDevice>, usize) {
        let (mut reader, mut rest, mut messages, mut damaged) = (FrameReader::new(), bytes, Vec::new(), 0);
        while !rest.is_empty() {
            let (taken, frame) = reader.push(rest);
            rest = &rest[taken..];
            match frame {
                None => {}
                Some(Ok(payload)) => messages.push(FromDevice::from_payload(payload).unwrap()),
                Some(Err(_)) => damaged += 1,
            }
        }
        (messages, damaged)
    }

    #[test]
    fn a_full_box_has_room_for_the_delimiter_of_another_link() {
        let mut outbox = Outbox::<512>::new();
        while outbox.push_message(&reply(1)) {}
        while outbox.len() < 511 {
            outbox.push_delimiter();
        }
        outbox.push_delimiter();
        assert_eq!(outbox.len(), 511);
        for _ in 0..2 {
            outbox.redirect();
            assert_eq!((outbox.len(), outbox.readable().first()), (512, Some(&DELIMITER)));
        }
    }

    proptest! {
        /// However much of the messages has gone one way when the rest is sent another: what arrives on either is whole
        /// but for the one under way, and that is lost, not garbled, even where the other way carried half a frame.
        #[test]
        fn a_message_under_way_when_the_link_changes_is_lost_and_no_other(
            lead in 0_usize..500, sent in 0_usize..400, count in 1_u32..7, half in prop::collection::vec(1_u8.., 0..40),
        ) {
            let mut outbox = Outbox::<512>::new();
            // Somewhere in the ring.
            outbox.push_delimiter();
            for _ in 0..lead {
                outbox.push_delimiter();
                outbox.consume(1);
            }
            let given: Vec<FromDevice> = (1..=count).map(|n| if n % 2 == 0 { block(n) } else { reply(n) }).collect();
            let taken: Vec<_> = given.iter().take_while(|message| outbox.push_message(message)).cloned().collect();
            let take = |outbox: &mut Outbox<512>, most: usize| {
                let mut bytes = Vec::new();
                while bytes.len() < most && !outbox.is_empty() {
                    let piece: Vec<u8> = outbox.readable().iter().copied().take(most - bytes.len()).collect();
                    outbox.consume(piece.len());
                    bytes.extend(piece);
                }
                bytes
            };
            let first = take(&mut outbox, sent);
            outbox.redirect();
            let second = take(&mut outbox, 512);
            let ((before, damaged), was_cut) = (read(&first), first.last().is_some_and(|&byte| byte != DELIMITER));
            prop_assert_eq!(damaged, 0);
            let (after, damaged) = read(&[half.clone(), second].concat());
            prop_assert!(damaged <= usize::from(!half.is_empty()));
            let lost = usize::from(was_cut);
            prop_assert_eq!(before.len() + lost + after.len(), taken.len());
            prop_assert_eq!(&before[..], &taken[..before.len()]);
            prop_assert_eq!(&after[..], &taken[before.len() + lost..]);
        }

        /// Every message that went in comes out, whole and in order, whatever the pieces it is read in.
        #[test]
        fn what_goes_in_comes_out(steps in prop::collection::vec((any::<bool>(), 0_usize..200), 1..300)) {
            let mut outbox = Outbox::<512>::new();
            let (mut given, mut got) = (Vec::new(), Vec::new());
            let mut reader = FrameReader::new();
            let mut drain = |outbox: &mut Outbox<512>, most: usize, got: &mut Vec<FromDevice>| {
                let bytes: Vec<u8> = outbox.readable().iter().copied().take(most).collect();
                outbox.consume(bytes.len());
                let mut rest = &bytes[..];
                while !rest.is_empty() {
                    let (taken, payload) = reader.push(rest);
                    got.extend(payload.map(|payload| FromDevice::from_payload(payload.unwrap()).unwrap()));
                    rest = &rest[taken..];
                }
            };
            for (n, (is_block, most)) in (0..).zip(steps) {
                let message = if is_block { block(n) } else { reply(n) };
                if outbox.push_message(&message) {
                    given.push(message);
                }
                drain(&mut outbox, most, &mut got);
            }
            while !outbox.is_empty() {
                drain(&mut outbox, 512, &mut got);
            }
            prop_assert_eq!(got, given);
        }
    }
}
