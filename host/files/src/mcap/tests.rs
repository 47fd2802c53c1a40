use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::record::{Fields, MAGIC, op, split};
use super::*;

fn channel(topic: &str) -> Channel {
    Channel {
        topic: topic.to_owned(),
        message_encoding: "json".to_owned(),
        schema_name: "Counted".to_owned(),
        schema_encoding: "jsonschema".to_owned(),
        schema: "{}".to_owned(),
        metadata: BTreeMap::from([("unit".to_owned(), "N".to_owned())]),
    }
}

/// What the test writes as message `k`: long enough that a second chunk differs from the first.
fn text(k: u64) -> Vec<u8> {
    format!("{{\"k\": {k}, \"words\": \"{}\"}}", "finger ".repeat(usize::try_from(k % 17).unwrap())).into_bytes()
}

/// Flushes of the test file, and messages between two of them.
const FLUSHES: u64 = 5;
const MESSAGES: u64 = 40;

/// Writes a file in [`FLUSHES`] flushes; what it was after each.
fn written(path: &Path) -> Vec<Vec<u8>> {
    let mut writer = Writer::create(path, "test").unwrap();
    let channels = ["/a", "/b"].map(|topic| writer.channel(&channel(topic)));
    let mut states = vec![fs::read(path).unwrap()];
    for flush in 0..FLUSHES {
        for k in flush * MESSAGES..(flush + 1) * MESSAGES {
            writer.message(channels[usize::from(k % 3 == 0)], 1_000 + k, 2_000 + k, &text(k));
        }
        if flush == 1 {
            writer.attachment("part.toml", "application/toml", b"unit = \"mm\"", 7);
            writer.metadata("palpate", &BTreeMap::from([("version".to_owned(), "0".to_owned())]));
        }
        let size = writer.flush().unwrap();
        states.push(fs::read(path).unwrap());
        assert_eq!(size, states.last().unwrap().len() as u64);
    }
    states
}

/// All that a file has, and how reading ended.
fn read(bytes: &[u8]) -> (Vec<Content>, Result<(), McapError>) {
    let mut all = Vec::new();
    let mut reader = match Reader::new(bytes) {
        Ok(reader) => reader,
        Err(error) => return (all, Err(error)),
    };
    loop {
        match reader.next_content() {
            Ok(Some(content)) => all.push(content),
            Ok(None) => return (all, Ok(())),
            Err(error) => return (all, Err(error)),
        }
    }
}

fn messages(all: &[Content]) -> Vec<u64> {
    let number = |content: &Content| match content {
        Content::Message { log_time_ns, data, .. } => {
            assert_eq!(*data, text(log_time_ns - 1_000));
            Some(log_time_ns - 1_000)
        }
        _ => None,
    };
    all.iter().filter_map(number).collect()
}

#[test]
fn after_every_flush_the_file_is_whole_and_has_all_that_was_added() {
    let folder = tempfile::tempdir().unwrap();
    for (flushes, state) in (0..).zip(written(&folder.path().join("run.mcap"))) {
        assert_eq!((&state[..8], &state[state.len() - 8..]), (&MAGIC[..], &MAGIC[..]));
        let (all, ended) = read(&state);
        ended.unwrap();
        assert_eq!(messages(&all), (0..flushes * MESSAGES).collect::<Vec<_>>());
        let attached = Content::Attachment {
            name: "part.toml".to_owned(),
            media_type: "application/toml".to_owned(),
            data: b"unit = \"mm\"".to_vec(),
        };
        assert_eq!(all.contains(&attached), flushes >= 2);
    }
}

#[test]
fn the_summary_says_where_everything_is() {
    let folder = tempfile::tempdir().unwrap();
    let state = written(&folder.path().join("run.mcap")).pop().unwrap();
    let footer = &state[state.len() - 8 - 20..state.len() - 8];
    let mut fields = Fields(footer);
    let start = usize::try_from(fields.u64().unwrap()).unwrap();
    let covered = &state[start..state.len() - 8 - 4];
    assert_eq!(Fields(&footer[16..]).u32().unwrap(), crc32fast::hash(covered));
    let opcode_at = |place: u64| state[usize::try_from(place).unwrap()];
    let (mut rest, mut chunks, mut counted) = (&state[start..], 0, 0);
    while let Some((opcode, content, behind)) = split(rest) {
        let mut fields = Fields(content);
        match opcode {
            op::CHUNK_INDEX => {
                fields.bytes(16).unwrap();
                let (chunk, length) = (fields.u64().unwrap(), fields.u64().unwrap());
                assert_eq!(opcode_at(chunk), op::CHUNK);
                // Behind it stand the places of its messages, of the channel that the index names.
                assert_eq!(opcode_at(chunk + length), op::MESSAGE_INDEX);
                let mut offsets = Fields(fields.bytes(4 + 2 * 10).unwrap());
                assert_eq!(offsets.u32(), Some(20));
                assert_eq!((offsets.u16(), offsets.u64()), (Some(1), Some(chunk + length)));
                chunks += 1;
            }
            op::ATTACHMENT_INDEX => assert_eq!(opcode_at(fields.u64().unwrap()), op::ATTACHMENT),
            op::METADATA_INDEX => assert_eq!(opcode_at(fields.u64().unwrap()), op::METADATA),
            op::STATISTICS => counted = fields.u64().unwrap(),
            op::FOOTER => break,
            _ => {}
        }
        rest = behind;
    }
    assert_eq!((chunks, counted), (FLUSHES, FLUSHES * MESSAGES));
}

#[test]
fn a_file_that_is_cut_anywhere_gives_what_is_whole_before_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let states = written(&folder.path().join("run.mcap"));
    let whole = states.last().unwrap();
    // Where the data of each flush end: there the state's summary began.
    let ends: Vec<usize> = states
        .iter()
        .map(|state| {
            let footer = &state[state.len() - 28..];
            usize::try_from(Fields(footer).u64().unwrap()).unwrap() - 13
        })
        .collect();
    for length in 0..whole.len() {
        let (all, ended) = read(&whole[..length]);
        let kept = (0..).zip(&ends).filter(|(_, end)| length >= **end).map(|(flushes, _)| flushes).max().unwrap_or(0);
        let got = messages(&all);
        assert!(got.len() as u64 >= kept * MESSAGES, "{length} bytes: {} messages of {kept} flushes", got.len());
        assert!(got.iter().copied().eq(0..got.len() as u64), "in order, and none twice");
        assert_eq!(ended.is_err(), length < ends[ends.len() - 1] + 13, "{length} bytes: {ended:?}");
    }
}

#[test]
fn no_flipped_byte_makes_a_wrong_message() {
    let folder = tempfile::tempdir().unwrap();
    let whole = written(&folder.path().join("run.mcap")).pop().unwrap();
    let (undamaged, _) = read(&whole);
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x11;
        let (all, _) = read(&damaged);
        // `messages` compares each text with its time.
        assert!(messages(&all).len() <= messages(&undamaged).len(), "byte {at}");
    }
}

#[test]
fn an_existing_file_stays_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    fs::write(&path, "mine").unwrap();
    assert_eq!(Writer::create(&path, "test").unwrap_err().kind(), std::io::ErrorKind::AlreadyExists);
    assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
}

/// Numbers of the messages that come back; each is as it was written.
fn recovered(recovery: &Recovery) -> Vec<u64> {
    let number = |message: &RecoveredMessage| {
        let k = message.log_time_ns - 1_000;
        assert_eq!((&message.data, message.publish_time_ns), (&text(k), 2_000 + k));
        assert_eq!(message.channel.topic, if k.is_multiple_of(3) { "/b" } else { "/a" });
        k
    };
    recovery.messages().map(number).collect()
}

/// Where the chunks of a file stand, with the numbers of their messages.
fn chunks(file: &[u8]) -> Vec<(std::ops::Range<usize>, Vec<u64>)> {
    let (mut rest, mut chunks) = (&file[MAGIC.len()..], Vec::new());
    while let Some((opcode, content, behind)) = split(rest) {
        let from = file.len() - rest.len();
        if opcode == op::CHUNK {
            let mut fields = Fields(content);
            let (first, last) = (fields.u64().unwrap() - 1_000, fields.u64().unwrap() - 1_000);
            chunks.push((from..file.len() - behind.len(), (first..=last).collect()));
        }
        rest = behind;
    }
    chunks
}

/// What must be found of a file: every chunk for which `is_whole` says so of its place.
fn wanted(file: &[u8], is_whole: impl Fn(&std::ops::Range<usize>) -> bool) -> Vec<u64> {
    chunks(file).into_iter().filter(|(place, _)| is_whole(place)).flat_map(|(_, numbers)| numbers).collect()
}

#[test]
fn a_whole_file_comes_back_whole() {
    let folder = tempfile::tempdir().unwrap();
    for (flushes, state) in (0..).zip(written(&folder.path().join("run.mcap"))) {
        let recovery = Recovery::of(&state);
        assert!(recovery.is_whole(), "{:?}", recovery.damages);
        assert_eq!(recovered(&recovery), (0..flushes * MESSAGES).collect::<Vec<_>>());
        assert_eq!(recovery.missing(), BTreeMap::new());
        let (all, _) = read(&state);
        let beside = recovery.found.iter().filter(|found| matches!(found, Recovered::Beside(_))).count();
        assert_eq!(beside, all.iter().filter(|content| !matches!(content, Content::Message { .. })).count());
    }
}

#[test]
fn every_whole_chunk_of_a_cut_file_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let whole = written(&folder.path().join("run.mcap")).pop().unwrap();
    for length in 0..whole.len() {
        let recovery = Recovery::of(&whole[..length]);
        assert_eq!(recovered(&recovery), wanted(&whole, |place| place.end <= length), "{length} bytes");
        assert!(length == 0 || !recovery.is_whole(), "{length} bytes: the end is missing");
    }
}

#[test]
fn every_chunk_that_a_flipped_byte_is_not_in_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let whole = written(&folder.path().join("run.mcap")).pop().unwrap();
    let all = wanted(&whole, |_| true);
    for at in 0..whole.len() {
        for bits in [0x01, 0x11, 0x80] {
            let mut damaged = whole.clone();
            damaged[at] ^= bits;
            let recovery = Recovery::of(&damaged);
            let back = recovered(&recovery);
            let wanted = wanted(&whole, |place| !place.contains(&at));
            // A chunk's own span of times is under no checksum: its messages are whole all the same.
            let is_all = back.len() == all.len();
            assert!(is_all || back == wanted, "byte {at}, bits {bits:#x}: {back:?}");
            assert!(is_all || !recovery.is_whole(), "byte {at}: the loss is stated");
        }
    }
}

#[test]
fn what_is_missing_between_chunks_is_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut damaged = written(&folder.path().join("run.mcap")).pop().unwrap();
    let (place, numbers) = chunks(&damaged)[2].clone();
    damaged[place.start + 40] ^= 1;
    let recovery = Recovery::of(&damaged);
    assert_eq!(recovery.missing().values().sum::<u64>(), numbers.len() as u64);
    let [damage] = &recovery.damages[..] else { panic!("{:?}", recovery.damages) };
    assert!(damage.bytes.start <= place.start && damage.bytes.end >= place.end, "{damage:?}");
    assert_eq!(damage.between_ns, (Some(1_000 + numbers[0] - 1), Some(1_000 + numbers[numbers.len() - 1] + 1)));
}
