//! Runs are recorded and played again: what the real binary printed live it prints again, to the last digit.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use palpate::math::random::Draw;
use palpate_files::mcap::{Content, McapError, Reader};
use palpate_tests::project;

use crate::PALPATE;
use crate::observe::text;
#[cfg(unix)]
use crate::observe::{example, forces, observed_live, pushed};

pub(crate) fn palpate(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(PALPATE);
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    command.env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION").output().unwrap()
}

pub(crate) fn ok(output: &Output) -> String {
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

/// A calibration of simulated finger 7 in this folder.
pub(crate) fn calibrated(folder: &Path) -> String {
    let words = ["calibrate", "-d", "sim:7", "--load", "2 N", "--contacts", "6", "--out", "."];
    let report = ok(&palpate(folder, &words));
    let path = report.lines().find_map(|line| line.strip_prefix("written"));
    path.unwrap_or_else(|| panic!("{report}")).trim().to_owned()
}

/// Topic and time of each.
type Messages = Vec<(String, u64)>;

/// All of a file by topic, and how reading ended.
fn topics(path: &Path) -> (Messages, Result<(), McapError>) {
    let mut reader = Reader::open(path).unwrap();
    let mut messages = Vec::new();
    loop {
        match reader.next_content() {
            Ok(Some(Content::Message { channel, log_time_ns, .. })) => {
                messages.push((reader.channel(channel).unwrap().topic.clone(), log_time_ns));
            }
            Ok(Some(_)) => {}
            Ok(None) => return (messages, Ok(())),
            Err(error) => return (messages, Err(error)),
        }
    }
}

fn count(messages: &[(String, u64)], topic: &str) -> usize {
    messages.iter().filter(|(of, _)| of == topic).count()
}

#[test]
fn what_monitor_and_diagnose_printed_live_a_replay_prints_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let calibration = calibrated(folder);
    let monitor = ["monitor", "--seconds", "2", "--json", "--print-hz", "50"];
    let live = [&monitor[..], &["-d", "sim:7", "-c", &calibration, "--record", "run.mcap"]].concat();
    let live = ok(&palpate(folder, &live));
    assert!(live.lines().count() > 80, "{live}");
    // The calibration comes with the recording.
    fs::remove_file(folder.join(&calibration)).unwrap();
    assert_eq!(ok(&palpate(folder, &[&monitor[..], &["-d", "file:run.mcap"]].concat())), live);
    assert_eq!(ok(&palpate(folder, &["replay", "run.mcap"])), live);

    let (messages, ended) = topics(&folder.join("run.mcap"));
    ended.unwrap();
    // 4 kHz in blocks of eight, two seconds and the tare's one.
    for topic in ["/link/received", "/finger/wrench_raw"] {
        assert!(count(&messages, topic) > 1400, "{} of {topic}", count(&messages, topic));
    }
    assert!(count(&messages, "/finger/contact") > 900 && count(&messages, "/link/counters") >= 2);

    // Another command makes something else of the same samples, and is recorded itself.
    let words = ["diagnose", "-d", "file:run.mcap", "--seconds", "2", "--json", "--record", "again.mcap"];
    let diagnosed = palpate(folder, &words);
    assert!(text(&diagnosed.stdout).starts_with('{'), "{}", text(&diagnosed.stderr));
    assert_eq!(palpate(folder, &["replay", "again.mcap"]).stdout, diagnosed.stdout);

    // A recording exists once.
    let again = palpate(folder, &["record", "run.mcap", "-d", "sim:7", "--seconds", "1"]);
    assert_eq!(again.status.code(), Some(1));
    assert!(text(&again.stderr).contains("never overwritten"), "{}", text(&again.stderr));
}

/// Whether everything that was printed then is printed now, but for the last digits of numbers, which are another
/// mathematical library's; there may be more of it.
fn has_all(now: &serde_json::Value, then: &serde_json::Value) -> bool {
    use serde_json::Value::{Array, Number, Object};
    match (now, then) {
        (Number(a), Number(b)) => {
            let [a, b] = [a, b].map(|number| number.as_f64().unwrap());
            (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
        }
        (Array(now), Array(then)) => now.len() == then.len() && now.iter().zip(then).all(|(a, b)| has_all(a, b)),
        (Object(now), Object(then)) => {
            then.iter().all(|(name, value)| now.get(name).is_some_and(|now| has_all(now, value)))
        }
        _ => now == then,
    }
}

/// `tests/golden/recordings` has a run of each format that was ever written, with what was printed then: palpate 0.2.0 of
/// November 2026, `monitor -d sim:7 --seconds 0.5 --tare 0.25 --json --print-hz 50 --record format-1.mcap`.
#[test]
fn a_run_that_an_older_version_recorded_is_played_and_a_newer_format_is_refused() {
    let golden = project::folder().join("tests/golden/recordings");
    let run = golden.join("format-1.mcap");
    let folder = tempfile::tempdir().unwrap();
    let played = ok(&palpate(folder.path(), &["replay", run.to_str().unwrap()]));
    let printed = fs::read_to_string(golden.join("format-1.jsonl")).unwrap();
    assert_eq!(played.lines().count(), printed.lines().count());
    for (now, then) in played.lines().zip(printed.lines()) {
        let [now, then] = [now, then].map(|line| serde_json::from_str(line).unwrap());
        assert!(has_all(&now, &then), "{now}\nthen: {then}");
    }
    // As a later format would name itself.
    let mut writer = palpate_files::mcap::Writer::create(&folder.path().join("later.mcap"), "palpate 9").unwrap();
    writer.metadata("palpate", &[("format".to_owned(), "2".to_owned())].into());
    writer.flush().unwrap();
    for words in [&["replay", "later.mcap"][..], &["monitor", "-d", "file:later.mcap"]] {
        let output = palpate(folder.path(), words);
        assert_eq!(output.status.code(), Some(1));
        let told = crate::observe::unfolded(&text(&output.stderr));
        assert!(told.contains("its format is 2, and this version reads format 1") && told.contains("update palpate"));
    }
}

/// The search beside the stream takes what time the machine gives it: the replay goes by where it was done.
#[cfg(unix)]
#[test]
fn what_observe_printed_of_a_push_a_replay_prints_again() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let table = folder.path().join("forces.csv");
    fs::write(&table, forces(&played, 0.0, 0.0)).unwrap();
    let both = format!("{} {}", table.display(), example("motion.toml").display());
    for method in ["search", "follow"] {
        let run = folder.path().join(format!("{method}.mcap"));
        let more: &[&Path] = &[Path::new("--method"), Path::new(method), Path::new("--record"), &run];
        let live = observed_live(folder.path(), &both, &example("part.toml"), &example("motion.toml"), more);
        let live = ok(&live);
        assert!(live.lines().count() > 3, "{live}");
        assert_eq!(ok(&palpate(folder.path(), &["replay", run.to_str().unwrap()])), live, "{method}");
        let (messages, _) = topics(&run);
        assert!(count(&messages, "/part/belief") == live.lines().count() && count(&messages, "/tf") > 0, "{method}");
        is_drawn_where_it_is(folder.path(), &run);
    }
    // Each message of which the definition stands in the file, by somebody else's reader of both.
    stock_python_decodes(folder.path(), "follow.mcap");
    // Which of two parts it was, by the same samples.
    let words = ["replay", "follow.mcap", "--", "which-part", "--json", "--part"];
    let [part, motion] = ["part.toml", "motion.toml"].map(|name| example(name).display().to_string());
    let which = palpate(folder.path(), &[&words[..], &[&part, "--motion", &motion]].concat());
    let which: serde_json::Value = serde_json::from_str(&ok(&which)).unwrap();
    assert!(which["parts"][0]["probability"].as_f64().unwrap() > 0.9, "{which}");
}

/// The scene of a recorded push at its end: the part's outline at the pose that is believed, and nothing of before.
#[cfg(unix)]
fn is_drawn_where_it_is(folder: &Path, run: &Path) {
    let all = |topic: &str| {
        let lines = ok(&palpate(folder, &["export", run.to_str().unwrap(), "--json", topic]));
        lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect::<Vec<serde_json::Value>>()
    };
    let (scenes, poses) = (all("/scene"), all("/part/pose"));
    let scene = &scenes.last().unwrap()["message"];
    let markers = scene["markers"].as_array().unwrap();
    let [cleared, disk, part] = &markers[..] else { panic!("{scene}") };
    assert_eq!((&cleared["action"], &disk["type"], &part["type"]), (&3.into(), &3.into(), &4.into()), "{scene}");
    // Of many estimates a second not each is drawn.
    let last: Vec<_> = poses.iter().rev().take(10).map(|pose| &pose["message"]["pose"]["pose"]).collect();
    assert!(last.contains(&&part["pose"]), "{part}: {last:?}");
    let mm = |value: &serde_json::Value| format!("{:.0}", value.as_f64().unwrap() * 1e3);
    assert_eq!(mm(&disk["scale"]["x"]), "30", "{disk}");
    let points: Vec<_> = part["points"].as_array().unwrap().iter().map(|at| [mm(&at["x"]), mm(&at["y"])]).collect();
    let file: toml::Table = fs::read_to_string(example("part.toml")).unwrap().parse().unwrap();
    let vertices = file["vertices"].as_array().unwrap().iter();
    let vertices: Vec<_> = vertices.map(|at| [0, 1].map(|axis| at[axis].as_integer().unwrap().to_string())).collect();
    assert_eq!((&points[..vertices.len()], points.last()), (&vertices[..], points.first()), "{part}");
}

/// What a robot said came in between the samples, and the replay goes by its places.
#[test]
fn what_touch_printed_of_a_part_that_a_robot_touched_a_replay_prints_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::copy(example("part.toml"), folder.join("part.toml")).unwrap();
    let touch = ["touch", "--part", "part.toml", "--area-mm", "0,0,200,200", "--mass-kg", "1", "--json"];
    let live = [&touch[..], &["-d", "sim:1", "--robot", "sim:", "--record", "touch.mcap"]].concat();
    let live = ok(&palpate(folder, &live));
    assert!(live.lines().count() > 3, "{live}");
    assert_eq!(ok(&palpate(folder, &["replay", "touch.mcap"])), live);
    let (messages, ended) = topics(&folder.join("touch.mcap"));
    ended.unwrap();
    for topic in ["/finger/wrench", "/finger/contact", "/inputs"] {
        assert!(count(&messages, topic) > 100, "{} of {topic}", count(&messages, topic));
    }
    let inputs = ok(&palpate(folder, &["export", "touch.mcap", "--json", "/inputs"]));
    assert!(inputs.contains("\"robot_told\"") && inputs.contains("\"move "), "{inputs}");
    // Another part than the one that was touched.
    let other = fs::read_to_string(folder.join("part.toml")).unwrap().replace("[90, 0]", "[60, 0]");
    fs::write(folder.join("other.toml"), other).unwrap();
    let words = ["touch", "--part", "other.toml", "--area-mm", "0,0,200,200", "--mass-kg", "1", "--robot", "sim:"];
    let other = palpate(folder, &[&words[..], &["-d", "file:touch.mcap", "--json"]].concat());
    assert_ne!(text(&other.stdout), live);
    assert_ne!(other.status.code(), Some(0), "{}", text(&other.stdout));
}

/// A palm has no device: its contacts are what comes in.
#[test]
fn what_palm_printed_of_contacts_a_replay_prints_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::copy(example("pebble.toml"), folder.join("body.toml")).unwrap();
    let rolled = ["roll", "body.toml", "--attitude-deg", "40,20,0", "--turning-deg-s", "200,-250,50"];
    let contacts = ok(&palpate(folder, &[&rolled[..], &["--contacts-hz", "500", "--grid-mm", "1"]].concat()));
    // A line that is none, and one that is empty, have their numbers too.
    let contacts = contacts.replacen('\n', "\nnothing\n\n", 1);
    fs::write(folder.join("contacts.jsonl"), &contacts).unwrap();
    let mut command = Command::new(PALPATE);
    command.args(["palm", "body.toml", "--grid-mm", "1", "--every", "3", "--record", "palm.mcap"]).current_dir(folder);
    let live = command.stdin(fs::File::open(folder.join("contacts.jsonl")).unwrap()).output().unwrap();
    assert_eq!(live.status.code(), Some(2), "{}", text(&live.stderr));
    let told = text(&live.stdout);
    assert!(told.contains("\"tracking\"") && told.lines().count() > 50, "{told}");
    // The body comes with the recording.
    fs::remove_file(folder.join("body.toml")).unwrap();
    let again = palpate(folder, &["replay", "palm.mcap"]);
    assert_eq!((text(&again.stdout), again.status.code()), (told.clone(), Some(2)));
    fs::copy(example("pebble.toml"), folder.join("body.toml")).unwrap();
    let words = ["palm", "body.toml", "--grid-mm", "1", "--every", "3", "-d", "file:palm.mcap", "--speed", "1000"];
    assert_eq!(text(&palpate(folder, &words).stdout), told);

    let (messages, ended) = topics(&folder.join("palm.mcap"));
    ended.unwrap();
    // Two lines are none, and the end has a message of its own.
    let felt = contacts.lines().count() - 2;
    assert_eq!((count(&messages, "/inputs"), count(&messages, "/palm/contact")), (felt + 3, felt));
    let turned = count(&messages, "/palm/attitude");
    assert!(turned > felt / 2 && turned < felt, "{turned} of {felt}");
    stock_python_decodes(folder, "palm.mcap");
    let other = palpate(folder, &["palm", "body.toml", "-d", "sim:"]);
    assert_eq!(other.status.code(), Some(64));
    assert!(text(&other.stderr).contains("file:RUN.mcap"), "{}", text(&other.stderr));
}

/// Has stock Python decode all messages of ROS 2 by the definitions that stand in the file, where it has `mcap_ros2` too.
fn stock_python_decodes(folder: &Path, name: &str) {
    let Some(python) = stock_python() else { return };
    let script = "\
import sys
from mcap.reader import make_reader
try:
    from mcap_ros2.decoder import DecoderFactory
except ImportError:
    sys.exit(9)
with open(sys.argv[1], 'rb') as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    summary = reader.get_summary()
    cdr = [channel for channel in summary.channels.values() if channel.message_encoding == 'cdr']
    decoded = sum(1 for _ in reader.iter_decoded_messages(topics=[channel.topic for channel in cdr]))
    told = sum(summary.statistics.channel_message_counts[channel.id] for channel in cdr)
    assert decoded == told > 0, (decoded, told)
";
    let output = Command::new(python).args(["-c", script, name]).current_dir(folder).output().unwrap();
    match output.status.code() {
        Some(9) => eprintln!("NOT TESTED with stock Python: it has no package `mcap-ros2-support`"),
        status => assert_eq!(status, Some(0), "{name}: {}", text(&output.stderr)),
    }
}

/// What live commands other than `monitor` print of a push, a replay prints again.
#[cfg(unix)]
#[test]
fn what_which_part_and_diagnose_printed_live_a_replay_prints_again() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let folder = folder.path();
    let table = folder.join("forces.csv");
    fs::write(&table, forces(&played, 0.0, 0.0)).unwrap();
    let both = format!("{} {}", table.display(), example("motion.toml").display());
    // The example, and a part that differs from it by one corner.
    let other = folder.join("other.toml");
    let text_of = fs::read_to_string(example("part.toml")).unwrap();
    fs::write(&other, text_of.replace("[90, 0]", "[70, 0]")).unwrap();
    let (part, motion, run) = (example("part.toml"), example("motion.toml"), folder.join("which.mcap"));
    let words = ["which-part", "--json", "--part"].map(Path::new);
    let rest = [Path::new("--part"), &other, Path::new("--motion"), &motion, Path::new("--record"), &run];
    let live = ok(&crate::observe::felt_live(folder, &both, &[&words[..], &[&part], &rest].concat()));
    assert!(live.contains("\"probability\""), "{live}");
    assert_eq!(ok(&palpate(folder, &["replay", "which.mcap"])), live);

    for more in [&["--json"][..], &[]] {
        let run = format!("diagnosed-{}.mcap", more.len());
        let words = ["diagnose", "-d", "sim:7", "--seconds", "2", "--record", &run];
        let live = palpate(folder, &[&words[..], more].concat());
        assert!(live.stdout.len() > 100, "{}", text(&live.stderr));
        let again = palpate(folder, &["replay", &run]);
        assert_eq!(text(&again.stdout), text(&live.stdout));
        assert_eq!(again.status.code(), live.status.code());
    }
}

/// How many messages the reader of MCAP's own makers finds in a file that is whole for it.
fn stock(path: &Path) -> Result<u64, String> {
    let bytes = fs::read(path).unwrap();
    let summary = mcap::Summary::read(&bytes).map_err(|error| error.to_string())?;
    let told = summary.and_then(|summary| summary.stats).ok_or("it has no summary")?.message_count;
    let messages = mcap::MessageStream::new(&bytes).map_err(|error| error.to_string())?;
    let read = messages.into_iter().try_fold(0, |read, message| message.map(|_| read + 1));
    let read = read.map_err(|error| error.to_string())?;
    if read == told { Ok(read) } else { Err(format!("{read} of {told} messages")) }
}

/// Python with the package `mcap`, if this machine has it: `PALPATE_PYTHON`, which then must have it, or python3.
fn stock_python() -> Option<String> {
    let named = std::env::var("PALPATE_PYTHON").ok();
    let python = named.clone().unwrap_or_else(|| "python3".to_owned());
    let has = Command::new(&python).args(["-c", "import mcap.reader"]).output();
    if has.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    assert!(named.is_none(), "{python}, which PALPATE_PYTHON names, has no package `mcap`");
    eprintln!(
        "NOT TESTED with stock Python: {python} is not there, or has no package `mcap` (PALPATE_PYTHON names another)"
    );
    None
}

/// Which of these files stock Python reads whole, checksums and all; `None` where it was not run.
fn read_by_stock_python(folder: &Path, names: &[String]) -> Option<Vec<bool>> {
    let script = "\
import sys
from mcap.reader import make_reader
for name in sys.argv[1:]:
    try:
        with open(name, 'rb') as file:
            reader = make_reader(file, validate_crcs=True)
            told = reader.get_summary().statistics.message_count
            print(int(sum(1 for _ in reader.iter_messages()) == told))
    except Exception as error:
        print(0)
        print(name, repr(error), file=sys.stderr)
";
    let output = Command::new(stock_python()?).args(["-c", script]).args(names).current_dir(folder).output().unwrap();
    let read: Vec<_> = text(&output.stdout).lines().map(|line| line == "1").collect();
    assert_eq!(read.len(), names.len(), "{}", text(&output.stderr));
    eprint!("{}", text(&output.stderr));
    Some(read)
}

/// Runs that are killed while they are written, at random moments.
#[cfg(unix)]
#[test]
fn of_a_hundred_runs_that_are_killed_all_but_a_few_are_whole_and_all_can_be_recovered() {
    const KILLS: usize = 100;
    /// At a time.
    const BESIDE: usize = 10;
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let killed = &|number: usize| {
        let name = format!("{number}.mcap");
        let mut command = Command::new(PALPATE);
        command.args(["record", &name, "-d", "sim:7"]).current_dir(folder);
        let mut run = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        // Once something is written, at a moment drawn over a few flushes.
        while fs::metadata(folder.join(&name)).map_or(0, |about| about.len()) < 10_000 {
            assert!(run.try_wait().unwrap().is_none(), "run {number} ended by itself");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        std::thread::sleep(std::time::Duration::from_secs_f64(Draw::case(22, number).uniform(0.0, 2.0)));
        run.kill().unwrap();
        let killed_ns = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_nanos();
        run.wait().unwrap();
        (name, killed_ns)
    };
    let mut runs = Vec::new();
    for first in (0..KILLS).step_by(BESIDE) {
        let beside = std::thread::scope(|scope| {
            let threads: Vec<_> = (first..first + BESIDE).map(|number| scope.spawn(move || killed(number))).collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect::<Vec<_>>()
        });
        runs.extend(beside);
    }
    let (mut whole, mut lost_ms) = (0, Vec::new());
    for (name, killed_ns) in &runs {
        let path = folder.join(name);
        whole += usize::from(stock(&path).is_ok());
        let recovered = palpate(folder, &["recover", name]);
        assert!(matches!(recovered.status.code(), Some(0 | 3)), "{}", text(&recovered.stderr));
        let back = path.with_extension("recovered.mcap");
        stock(&back).unwrap();
        let last_ns = topics(&back).0.iter().map(|(_, at)| u128::from(*at)).max().unwrap();
        lost_ms.push((killed_ns - last_ns) / 1_000_000);
    }
    lost_ms.sort_unstable();
    eprintln!("{whole} of {KILLS} are whole as they are; lost at the end, ms: {lost_ms:?}");
    assert!(whole >= 95, "{whole} of {KILLS} are whole");
    // Between two flushes are 0.5 s. A machine that does other things may keep a run from writing; not most of them.
    let late = lost_ms.iter().filter(|lost| **lost > 1000).count();
    assert!(late <= 10, "{late} of {KILLS} lost more than a second: {lost_ms:?} ms");
    let names: Vec<_> = runs.iter().map(|(name, _)| name.clone()).collect();
    if let Some(read) = read_by_stock_python(folder, &names) {
        assert!(read.iter().filter(|read| **read).count() >= 95, "{read:?}");
        let back: Vec<_> = names.iter().map(|name| name.replace(".mcap", ".recovered.mcap")).collect();
        assert!(read_by_stock_python(folder, &back).unwrap().iter().all(|read| *read));
    }
}

/// A disk that is full is played by a limit on the sizes of files; what is beyond it fails as on a full disk.
#[cfg(unix)]
#[test]
fn a_full_disk_ends_the_recording_with_a_word_and_not_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let calibration = calibrated(folder);
    // 64 KiB, in blocks of 512 bytes: between one and two seconds of the run. The signal would end the program.
    let limited = |words: &str| {
        let script = format!("trap '' XFSZ; ulimit -f 128; exec \"$0\" {words}");
        let mut command = Command::new("sh");
        command.args(["-c", &script, PALPATE]).current_dir(folder).stdin(Stdio::null());
        command.env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION").output().unwrap()
    };
    let monitor = "monitor -d sim:7 --seconds 4 --json --print-hz 50";
    let cut = limited(&format!("{monitor} -c {calibration} --record cut.mcap"));
    let lines = ok(&cut);
    let ends: serde_json::Value = serde_json::from_str(lines.lines().last().unwrap()).unwrap();
    assert!(lines.lines().count() > 180, "the run goes on: {ends}");
    let told = crate::observe::unfolded(&text(&cut.stderr));
    assert!(told.contains("the recording cut.mcap ends here") && told.contains("the run goes on"), "{told}");
    let size = fs::metadata(folder.join("cut.mcap")).unwrap().len();
    assert!((10_000..=65_536).contains(&size), "{size} bytes");
    // What was written before is whole, as it is or recovered.
    assert!(matches!(palpate(folder, &["recover", "cut.mcap"]).status.code(), Some(0 | 3)));
    assert!(stock(&folder.join("cut.recovered.mcap")).unwrap() > 100);
    stock(&folder.join("cut.mcap")).unwrap();

    // Nothing but the recording was wanted: that is then an error.
    let record = limited("record alone.mcap -d sim:7 --seconds 20");
    assert_eq!(record.status.code(), Some(1));
    assert!(text(&record.stderr).contains("ended before its time"), "{}", text(&record.stderr));
}

/// The chunks of a file, by the reader of MCAP's own makers: where each stands, and its messages by topic and time.
fn stock_chunks(file: &[u8]) -> Vec<(Range<usize>, Messages)> {
    let summary = mcap::Summary::read(file).unwrap().unwrap();
    let chunk = |index: &mcap::records::ChunkIndex| {
        let start = usize::try_from(index.chunk_start_offset).unwrap();
        let messages = summary.stream_chunk(file, index).unwrap().map(|message| message.unwrap());
        let messages = messages.map(|message| (message.channel.topic.clone(), message.log_time)).collect();
        (start..start + usize::try_from(index.chunk_length).unwrap(), messages)
    };
    summary.chunk_indexes.iter().map(chunk).collect()
}

/// Draws damages of a recording; whatever is undamaged is read from what comes back, and what is lost is told.
#[test]
fn a_damaged_recording_comes_back_but_for_the_damage() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    ok(&palpate(folder, &["record", "run.mcap", "-d", "sim:7", "--seconds", "6"]));
    let whole = fs::read(folder.join("run.mcap")).unwrap();
    let (all, _) = topics(&folder.join("run.mcap"));
    assert!(ok(&palpate(folder, &["recover", "run.mcap"])).contains(&format!("{} messages", all.len())));
    assert_eq!(topics(&folder.join("run.recovered.mcap")).0, all);
    let chunks = stock_chunks(&whole);
    assert!(chunks.len() > 5, "{} chunks", chunks.len());
    let mut recovered = Vec::new();
    for case in 0..300 {
        let mut draw = Draw::case(21, case);
        // Each byte with where it was; none where it is another now.
        let mut damaged: Vec<(u8, Option<usize>)> = whole.iter().copied().zip((0..).map(Some)).collect();
        for _ in 0..1 + draw.index(3) {
            let at = draw.index(damaged.len());
            match draw.index(3) {
                0 => damaged[at] = (damaged[at].0 ^ 1 << draw.index(8), None),
                1 => damaged.truncate(at.max(whole.len() / 4)),
                _ => drop(damaged.drain(at..(at + 1 + draw.index(5000)).min(damaged.len() - 1).max(at))),
            }
        }
        let (name, out) = (format!("{case}.mcap"), format!("{case}.recovered.mcap"));
        fs::write(folder.join(&name), damaged.iter().map(|(byte, _)| *byte).collect::<Vec<_>>()).unwrap();
        let output = palpate(folder, &["recover", &name]);
        assert!(matches!(output.status.code(), Some(0 | 3)), "case {case}: {}", text(&output.stderr));
        let (back, ended) = topics(&folder.join(&out));
        ended.unwrap();
        assert_eq!(stock(&folder.join(&out)), Ok(back.len() as u64), "case {case}");
        // No more than was there, and all that stood in a chunk of which no byte is amiss, in order.
        let is_within = |some: &[(String, u64)], all: &[(String, u64)]| {
            let mut rest = all.iter();
            some.iter().all(|message| rest.any(|other| other == message))
        };
        let is_untouched = |place: &Range<usize>| {
            let begins = damaged.iter().position(|(_, from)| *from == Some(place.start));
            begins
                .and_then(|at| damaged.get(at..at + place.len()))
                .is_some_and(|bytes| bytes.iter().map(|(_, from)| *from).eq(place.clone().map(Some)))
        };
        let untouched = chunks.iter().filter(|(place, _)| is_untouched(place));
        let untouched: Vec<_> = untouched.flat_map(|(_, messages)| messages.clone()).collect();
        assert!(is_within(&back, &all), "case {case}");
        assert!(is_within(&untouched, &back), "case {case}: {} of {} untouched", back.len(), untouched.len());
        let said = text(&output.stdout);
        assert!(back.len() == all.len() || said.contains("damaged: bytes") || said.contains("missing"), "{said}");
        fs::remove_file(folder.join(&name)).unwrap();
        recovered.push(out);
    }
    if let Some(read) = read_by_stock_python(folder, &recovered) {
        assert!(read.iter().all(|read| *read), "{read:?}");
    }
    let output = palpate(folder, &["recover", "run.mcap"]);
    assert!(text(&output.stderr).contains("never overwritten"), "{}", text(&output.stderr));
    fs::write(folder.join("part.toml"), "unit = 'mm'").unwrap();
    let output = palpate(folder, &["recover", "part.toml"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("no part of its 11 bytes is whole"), "{}", text(&output.stderr));
}

/// Whether stock Python reads a recording, where Python has the `mcap` package.
#[test]
fn stock_python_reads_a_recording() {
    let Some(python) = stock_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    ok(&palpate(folder.path(), &["record", "run.mcap", "-d", "sim:7", "--seconds", "1"]));
    let script = "\
import sys
from mcap.reader import make_reader
with open(sys.argv[1], 'rb') as file:
    reader = make_reader(file, validate_crcs=True)
    summary = reader.get_summary()
    read = sum(1 for _ in reader.iter_messages())
    assert read == summary.statistics.message_count, (read, summary.statistics)
    print(read, *sorted(channel.topic for channel in summary.channels.values()))
";
    let output = Command::new(python).args(["-c", script, "run.mcap"]).current_dir(folder.path()).output().unwrap();
    let said = text(&output.stdout);
    let (messages, _) = topics(&folder.path().join("run.mcap"));
    assert!(said.starts_with(&format!("{} /link/counters", messages.len())), "{said}{}", text(&output.stderr));
}

#[test]
fn what_is_no_recording_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let says = |arguments: &[&str]| {
        let output = palpate(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}");
        crate::observe::unfolded(&text(&output.stderr))
    };
    fs::write(folder.path().join("part.toml"), "unit = 'mm'").unwrap();
    assert!(says(&["monitor", "-d", "file:part.toml"]).contains("it is no MCAP file"));
    assert!(says(&["replay", "gone.mcap"]).contains("cannot play the recording gone.mcap"));
    let example: PathBuf = project::folder().join("README.md");
    assert!(says(&["replay", example.to_str().unwrap()]).contains("it is no MCAP file"));
    ok(&palpate(folder.path(), &["record", "run.mcap", "-d", "sim:7", "--seconds", "1"]));
    assert!(says(&["replay", "run.mcap"]).contains("prints nothing to play again"));
    // Cut in the middle, it is played up to there and that is told.
    let whole = fs::read(folder.path().join("run.mcap")).unwrap();
    fs::write(folder.path().join("cut.mcap"), &whole[..whole.len() / 2]).unwrap();
    let words = ["replay", "cut.mcap", "--", "diagnose", "--seconds", "0.5"];
    let output = palpate(folder.path(), &words);
    assert!(text(&output.stderr).contains("it is played up to there"), "{}", text(&output.stderr));
}
