//! Bytes to messages.
//!
//! The reader finds its place again at the next delimiter after any damage, and counts what it had to drop. What it
//! hands on has passed its checksum. Of a message that only a newer minor version knows it hands on what can be told.

use palpate_shared::frame::FrameReader;
use palpate_shared::wire::{DecodeError, FromDevice, NewerMessage, ProtocolVersion};

/// What a reader has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReaderCounts {
    /// Messages that were read and handed on.
    pub messages: u64,
    /// Frames that were too long, miscoded or failed their checksum.
    pub damaged: u64,
    /// Messages of a newer minor version, or with something in them that only a newer one knows.
    pub unknown: u64,
    /// Messages whose checksum fits and whose contents do not.
    pub malformed: u64,
}

impl ReaderCounts {
    /// Frames of which nothing can be used: damaged on the way, or a bug of the peer.
    #[must_use]
    pub fn unusable(&self) -> u64 {
        self.damaged + self.malformed
    }

    /// These and others together.
    #[must_use]
    pub fn and(self, others: Self) -> Self {
        Self {
            messages: self.messages + others.messages,
            damaged: self.damaged + others.damaged,
            unknown: self.unknown + others.unknown,
            malformed: self.malformed + others.malformed,
        }
    }
}

/// Reads messages out of a stream of bytes.
#[derive(Debug, Default)]
pub struct MessageReader {
    frames: FrameReader,
    counts: ReaderCounts,
    /// A delimiter was seen, so that what follows is a whole frame.
    in_step: bool,
    other_protocol: Option<ProtocolVersion>,
}

impl MessageReader {
    /// Reads `bytes` and hands each message that this version knows to `sink`; see [`Self::read_each`].
    pub fn read(&mut self, bytes: &[u8], mut sink: impl FnMut(FromDevice)) {
        self.read_each(bytes, |read| {
            if let Ok(message) = read {
                sink(message);
            }
        });
    }

    /// Reads `bytes` and hands each message to `sink`, or what can be told of it if only a newer version knows it.
    ///
    /// What comes before the first delimiter is the rest of a frame that began earlier. It is used if it
    /// happens to be whole and not counted as damage if not.
    pub fn read_each(&mut self, mut bytes: &[u8], mut sink: impl FnMut(Result<FromDevice, NewerMessage>)) {
        while !bytes.is_empty() {
            let (taken, outcome) = self.frames.push(bytes);
            let frame_ended = bytes.get(taken.wrapping_sub(1)) == Some(&palpate_shared::frame::DELIMITER);
            let decoded = outcome.map(|payload| payload.map_err(DecodeError::from).and_then(FromDevice::from_payload));
            match decoded {
                Some(Ok(message)) => {
                    self.counts.messages += 1;
                    sink(Ok(message));
                }
                Some(Err(error)) => {
                    self.count(error);
                    if let DecodeError::Unknown(newer) = error {
                        sink(Err(newer));
                    }
                }
                None => {}
            }
            self.in_step |= frame_ended;
            bytes = &bytes[taken..];
        }
    }

    fn count(&mut self, error: DecodeError) {
        match error {
            DecodeError::Frame(_) => self.counts.damaged += u64::from(self.in_step),
            DecodeError::Unknown(_) => self.counts.unknown += 1,
            DecodeError::Malformed => self.counts.malformed += 1,
            DecodeError::OtherProtocol { device } => self.other_protocol = Some(device),
        }
    }

    /// What was seen so far.
    #[must_use]
    pub fn counts(&self) -> ReaderCounts {
        self.counts
    }

    /// The protocol version of the device, if it said hello in another major version than ours.
    #[must_use]
    pub fn other_protocol(&self) -> Option<ProtocolVersion> {
        self.other_protocol
    }
}

#[cfg(test)]
mod tests {
    use palpate_shared::frame::{FRAME_MAX, encode};
    use palpate_shared::units::{Counts, DeviceTime, Seq};
    use palpate_shared::wire::{Block, CommandId, PROTOCOL, Status};
    use proptest::prelude::*;

    use super::*;

    fn block(number: u32) -> FromDevice {
        let samples = (0..8).map(|i| [Counts(i - 4), Counts(i32::try_from(number).unwrap() * 7919)]).collect();
        FromDevice::Block(Block {
            first: Seq(8 * number),
            time: DeviceTime(2000 * number),
            status: Status::default(),
            samples,
        })
    }

    fn frame(message: &FromDevice) -> Vec<u8> {
        encode(message, &mut [0; FRAME_MAX + 1]).unwrap().to_vec()
    }

    fn read_all(bytes: &[u8], step: usize) -> (Vec<FromDevice>, ReaderCounts) {
        let (mut reader, mut messages) = (MessageReader::default(), Vec::new());
        bytes.chunks(step).for_each(|piece| reader.read(piece, |message| messages.push(message)));
        (messages, reader.counts())
    }

    #[test]
    fn starting_in_the_middle_of_a_frame_is_not_damage() {
        let bytes: Vec<u8> = (0..3).flat_map(|number| frame(&block(number))).collect();
        let (messages, counts) = read_all(&bytes[5..], 7);
        assert_eq!(messages, [block(1), block(2)]);
        assert_eq!(counts, ReaderCounts { messages: 2, ..ReaderCounts::default() });
    }

    #[test]
    fn a_newer_devices_message_is_counted_and_skipped() {
        let mut bytes = vec![0];
        bytes.extend(encode(&[99_u8, 1, 2], &mut [0; FRAME_MAX + 1]).unwrap());
        bytes.extend(frame(&block(1)));
        let (messages, counts) = read_all(&bytes, 64);
        assert_eq!((messages.len(), counts.unknown), (1, 1));
    }

    #[test]
    fn of_a_newer_answer_it_is_told_which_command_was_answered() {
        let (mut reader, mut read) = (MessageReader::default(), Vec::new());
        // A reply to command 7: refused, for reason 200.
        let refused = encode(&[3_u8, 7, 6, 0xC8, 1], &mut [0; FRAME_MAX + 1]).unwrap().to_vec();
        reader.read_each(&refused, |message| read.push(message));
        assert_eq!(read, [Err(NewerMessage::Reply { id: CommandId(7), device: None })]);
        assert_eq!(reader.counts(), ReaderCounts { unknown: 1, ..ReaderCounts::default() });
    }

    #[test]
    fn a_hello_of_another_major_version_is_remembered() {
        let mut reader = MessageReader::default();
        let other = encode(&[0_u8, PROTOCOL.major + 1, 0], &mut [0; FRAME_MAX + 1]).unwrap().to_vec();
        reader.read(&other, |_| ());
        assert_eq!(reader.other_protocol(), Some(ProtocolVersion { major: PROTOCOL.major + 1, minor: 0 }));
    }

    /// Ways a serial line mistreats bytes.
    #[derive(Clone, Debug)]
    enum Mishap {
        Flip { at: prop::sample::Index, bit: u32 },
        Cut { at: prop::sample::Index, length: usize },
        Insert { at: prop::sample::Index, noise: Vec<u8> },
    }

    fn mishap() -> impl Strategy<Value = Mishap> {
        let at = any::<prop::sample::Index>;
        prop_oneof![
            (at(), 0_u32..8).prop_map(|(at, bit)| Mishap::Flip { at, bit }),
            (at(), 1_usize..200).prop_map(|(at, length)| Mishap::Cut { at, length }),
            (at(), prop::collection::vec(any::<u8>(), 1..400)).prop_map(|(at, noise)| Mishap::Insert { at, noise }),
        ]
    }

    fn apply(bytes: &mut Vec<u8>, mishap: &Mishap) {
        match mishap {
            Mishap::Flip { at, bit } => {
                let at = at.index(bytes.len());
                bytes[at] ^= 1_u8 << bit;
            }
            Mishap::Cut { at, length } => {
                let at = at.index(bytes.len());
                bytes.drain(at..(at + length).min(bytes.len()));
            }
            Mishap::Insert { at, noise } => {
                let at = at.index(bytes.len());
                bytes.splice(at..at, noise.iter().copied());
            }
        }
    }

    proptest! {
        #[test]
        fn damage_never_makes_a_wrong_message_and_the_rest_comes_through(
            mishaps in prop::collection::vec(mishap(), 0..6), step in 1_usize..200,
        ) {
            let sent: Vec<FromDevice> = (0..40).map(block).collect();
            let mut bytes = vec![0];
            sent.iter().for_each(|message| bytes.extend(frame(message)));
            mishaps.iter().for_each(|mishap| apply(&mut bytes, mishap));
            let (messages, counts) = read_all(&bytes, step);
            prop_assert!(messages.iter().all(|message| sent.contains(message)));
            // A mishap touches at most the frames it overlaps: a cut of 200 bytes spans four of 60, or five with its
            // ends.
            prop_assert!(messages.len() + 6 * mishaps.len() >= sent.len(), "{} of {}", messages.len(), sent.len());
            prop_assert_eq!(counts.malformed + counts.unknown, 0);
        }
    }
}
