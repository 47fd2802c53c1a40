//! Runs are recorded and played again: what the real binary printed live it prints again, to the last digit.

use std::fs;
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

/// All of a file by topic, and how reading ended.
fn topics(path: &Path) -> (Vec<(String, u64)>, Result<(), McapError>) {
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
    }
    // Which of two parts it was, by the same samples.
    let words = ["replay", "follow.mcap", "--", "which-part", "--json", "--part"];
    let [part, motion] = ["part.toml", "motion.toml"].map(|name| example(name).display().to_string());
    let which = palpate(folder.path(), &[&words[..], &[&part, "--motion", &motion]].concat());
    let which: serde_json::Value = serde_json::from_str(&ok(&which)).unwrap();
    assert!(which["parts"][0]["probability"].as_f64().unwrap() > 0.9, "{which}");
}

/// The newest file of a run that is killed while it is written.
#[cfg(unix)]
#[test]
fn a_run_that_is_killed_leaves_a_whole_file_with_all_but_the_last_second() {
    let folder = tempfile::tempdir().unwrap();
    let mut whole = 0;
    const KILLS: u64 = 8;
    for kill in 0..KILLS {
        let name = format!("{kill}.mcap");
        let mut command = Command::new(PALPATE);
        command.args(["record", &name, "-d", "sim:7"]).current_dir(folder.path());
        let mut run = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        // At moments spread over the time between two flushes.
        std::thread::sleep(std::time::Duration::from_millis(1500 + 107 * kill));
        run.kill().unwrap();
        let killed_ns = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_nanos();
        run.wait().unwrap();
        let (messages, ended) = topics(&folder.path().join(&name));
        let last_ns = messages.iter().map(|(_, at)| u128::from(*at)).max().unwrap();
        // Between two flushes 0.5 s, and what writing takes on a machine that does other things too.
        assert!(killed_ns - last_ns < 3_000_000_000, "{} ms are lost", (killed_ns - last_ns) / 1_000_000);
        whole += u64::from(ended.is_ok());
    }
    assert!(whole + 1 >= KILLS, "{whole} of {KILLS} are whole");
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
    for case in 0..20 {
        let mut draw = Draw::case(21, case);
        let mut damaged = whole.clone();
        for _ in 0..=draw.index(3) {
            let at = draw.index(damaged.len());
            match draw.index(3) {
                0 => damaged[at] ^= 1 << draw.index(8),
                1 => damaged.truncate(at.max(whole.len() / 4)),
                _ => drop(damaged.drain(at..(at + 1 + draw.index(5000)).min(damaged.len() - 1).max(at))),
            }
        }
        let (name, out) = (format!("{case}.mcap"), format!("{case}.recovered.mcap"));
        fs::write(folder.join(&name), &damaged).unwrap();
        let output = palpate(folder, &["recover", &name]);
        assert!(matches!(output.status.code(), Some(0 | 3)), "case {case}: {}", text(&output.stderr));
        let (back, ended) = topics(&folder.join(&out));
        ended.unwrap();
        // No more than was there, in order.
        let mut rest = all.iter();
        assert!(back.iter().all(|message| rest.any(|other| other == message)), "case {case}");
        // Six chunks, and at most three hits.
        assert!(back.len() * 5 > all.len(), "case {case}: {} of {}", back.len(), all.len());
        let said = text(&output.stdout);
        assert!(back.len() == all.len() || said.contains("damaged: bytes") || said.contains("missing"), "{said}");
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
    let has = Command::new("python3").args(["-c", "import mcap.reader"]).output();
    if !has.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: this machine's python3 has no package `mcap`");
        return;
    }
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
    let output = Command::new("python3").args(["-c", script, "run.mcap"]).current_dir(folder.path()).output().unwrap();
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
