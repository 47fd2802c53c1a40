//! Runs go out to other tools, and come in from them: `export`, `report`, and files whose columns are told.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use palpate_files::mcap::cdr::Cdr;
use palpate_files::mcap::{Channel, Writer};

use crate::observe::{example, forces, pushed, text, unfolded};
use crate::recording::{calibrated, ok, palpate};

/// The table of a push with other names, signs and a decimal comma, as a spreadsheet in another country writes it.
fn foreign(table: &str) -> String {
    let row = |line: &str| {
        let [t, x, y] = line.split(',').map(str::trim).collect::<Vec<_>>()[..] else { panic!("{line}") };
        let turned = x.strip_prefix('-').map_or_else(|| format!("-{x}"), str::to_owned);
        format!("{y};{t};{turned}").replace('.', ",")
    };
    let rows = table.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit() || c == '-')).map(row);
    format!("Kraft quer;Zeit;Kraft längs\n{}\n", rows.collect::<Vec<_>>().join("\n"))
}

#[test]
fn a_table_of_another_program_is_observed_as_ours_is() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let table = forces(&pushed(), 1.0, 1e-3);
    fs::write(folder.join("ours.csv"), &table).unwrap();
    fs::write(folder.join("theirs.csv"), foreign(&table)).unwrap();
    let [part, motion] = ["part.toml", "motion.toml"].map(|name| example(name).display().to_string());
    let observed =
        |more: &[&str]| palpate(folder, &[&["observe", "--json", "--part", &part, "--motion", &motion], more].concat());
    let ours = ok(&observed(&["ours.csv"]));
    assert!(ours.contains("\"hypotheses\""), "{ours}");
    let columns = ["--columns", "t=Zeit,fx=-Kraft längs,fy=#1", "--decimal-comma"];
    assert_eq!(ok(&observed(&[&["theirs.csv"][..], &columns].concat())), ours);

    // What is missing is told with where it is, and what to do.
    let told = |more: &[&str]| {
        let output = observed(more);
        assert_eq!(output.status.code(), Some(1), "{more:?}");
        unfolded(&text(&output.stderr))
    };
    let without = told(&["theirs.csv"]);
    assert!(
        without.contains("line 1") && without.contains("it has: kraft quer, zeit") && without.contains("--columns t="),
        "{without}"
    );
    let comma = told(&["theirs.csv", "--columns", "t=Zeit,fx=-Kraft längs,fy=#1"]);
    assert!(comma.contains("line 2, column") && comma.contains("--decimal-comma reads such numbers"), "{comma}");
    let wrong = palpate(folder, &["contact", "theirs.csv", "--columns", "fz=a"]);
    assert_eq!(wrong.status.code(), Some(64));
    assert!(text(&wrong.stderr).contains("none of t, fx, fy"), "{}", text(&wrong.stderr));
}

/// A robot's recording: forces and poses of its tool, by ROS.
fn robots_run(path: &Path, topics: &[&str]) {
    let mut writer = Writer::create(path, "another tool").unwrap();
    let mut channel = |topic: &str, schema: &str| {
        writer.channel(&Channel {
            topic: topic.to_owned(),
            message_encoding: "cdr".to_owned(),
            schema_name: schema.to_owned(),
            schema_encoding: "ros2msg".to_owned(),
            schema: String::new(),
            metadata: BTreeMap::new(),
        })
    };
    let channels: Vec<_> = topics.iter().map(|topic| channel(topic, "geometry_msgs/msg/WrenchStamped")).collect();
    for k in 0..4000_u32 {
        let at = 1_700_000_000_000_000_000 + 1_000_000 * u64::from(k);
        // Free for a second, then touched with 2 N at 30 degrees.
        let size = if k < 1500 { 0.0 } else { -2.0 };
        let noise = 1e-3 * f64::from(k % 7).sin();
        let (y, x) = 30_f64.to_radians().sin_cos();
        let message =
            Cdr::new().header(at, "tool").f64s([size * x + noise, size * y - noise, 0.0, 0.0, 0.0, 0.0]).finish();
        channels.iter().for_each(|channel| writer.message(*channel, at, at, &message));
    }
    writer.flush().unwrap();
}

#[test]
fn a_robots_recording_is_felt_like_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    robots_run(&folder.join("robot.mcap"), &["/ft"]);
    let felt = ok(&palpate(folder, &["contact", "robot.mcap", "--tare", "0:1", "--json"]));
    // The same as a table, through the tool's own way out.
    ok(&palpate(folder, &["export", "robot.mcap", "-o", "robot.csv"]));
    let table = fs::read_to_string(folder.join("robot.csv")).unwrap();
    assert!(table.starts_with("t [s],Fx [N],Fy [N]\n") && table.lines().count() == 4001, "{}", &table[..200]);
    let again = ok(&palpate(folder, &["contact", "robot.csv", "--tare", "0:1", "--json"]));
    assert_eq!(felt.replace("robot.mcap", ""), again.replace("robot.csv", ""));
    assert!(felt.contains("touching") || felt.contains("contact"), "{felt}");

    robots_run(&folder.join("two.mcap"), &["/left", "/right"]);
    let several = palpate(folder, &["contact", "two.mcap"]);
    assert_eq!(several.status.code(), Some(1));
    let told = unfolded(&text(&several.stderr));
    // A line may be broken after any "/".
    assert!(told.replace("/ ", "/").contains("/left, /right") && told.contains("name one with --topic"), "{told}");
    ok(&palpate(folder, &["contact", "two.mcap", "--topic", "/right", "--tare", "0:1"]));
}

#[test]
fn a_recording_goes_out_as_tables_lines_and_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let calibration = calibrated(folder);
    let monitor = ["monitor", "-d", "sim:7", "-c", &calibration, "--seconds", "4", "--json", "--record", "run.mcap"];
    ok(&palpate(folder, &monitor));
    let listed = ok(&palpate(folder, &["export", "run.mcap", "--list"]));
    let count = |topic: &str| {
        let row = listed.lines().find(|line| line.split_whitespace().next() == Some(topic)).unwrap();
        row.split_whitespace().nth(1).unwrap().parse::<usize>().unwrap()
    };
    // A table has a row for each message, and a header.
    for topic in ["/finger/wrench", "/finger/contact", "/link/counters"] {
        let table = ok(&palpate(folder, &["export", "run.mcap", topic]));
        assert_eq!(table.lines().count(), count(topic) + 1, "{topic}");
        let fields = table.lines().next().unwrap().split(',').count();
        assert!(table.lines().all(|line| line.split(',').count() == fields), "{topic}");
    }
    let contacts = ok(&palpate(folder, &["export", "run.mcap", "/finger/contact"]));
    assert!(
        contacts
            .starts_with("t,header.stamp.sec,header.stamp.nanosec,header.frame_id,device_s,measured,touching,u_rad")
    );
    // JSON Lines: each an object of its topic, in the order of the file.
    let lines = ok(&palpate(folder, &["export", "run.mcap", "--json", "/finger/wrench", "/finger/contact"]));
    assert_eq!(lines.lines().count(), count("/finger/wrench") + count("/finger/contact"));
    for line in lines.lines() {
        let object: serde_json::Value = serde_json::from_str(line).unwrap();
        assert!(object["t"].as_f64().unwrap() > 1.6e9 && object["message"]["header"]["frame_id"] == "finger", "{line}");
    }
    let none = palpate(folder, &["export", "run.mcap", "/none"]);
    assert_eq!(none.status.code(), Some(1));
    assert!(unfolded(&text(&none.stderr)).contains("it has no messages of /none"), "{}", text(&none.stderr));
    let exists = palpate(folder, &["export", "run.mcap", "-o", "run.mcap"]);
    assert!(text(&exists.stderr).contains("never overwritten"), "{}", text(&exists.stderr));

    ok(&palpate(folder, &["report", "run.mcap"]));
    let page = fs::read_to_string(folder.join("run.html")).unwrap();
    for words in [
        "<h1>run.mcap</h1>",
        "The device was simulated",
        "Force on the finger",
        "/finger/wrench_raw",
        "SHA-256",
        "</html>",
    ] {
        assert!(page.contains(words), "{words}");
    }
    // It needs nothing but itself: what it refers to is within.
    assert_eq!(page.matches("href=").count(), page.matches("href=\"#").count());
    for outside in ["src=", "<script", "<link", "@import", "url("] {
        assert!(!page.contains(outside), "{outside}");
    }
    // Anew, but not in place of somebody's file.
    ok(&palpate(folder, &["report", "run.mcap"]));
    fs::write(folder.join("run.html"), "mine").unwrap();
    assert_eq!(palpate(folder, &["report", "run.mcap"]).status.code(), Some(1));
    assert_eq!(fs::read_to_string(folder.join("run.html")).unwrap(), "mine");

    // Of a recording that was cut, what comes before.
    let whole = fs::read(folder.join("run.mcap")).unwrap();
    fs::write(folder.join("cut.mcap"), &whole[..whole.len() / 2]).unwrap();
    let cut = palpate(folder, &["report", "cut.mcap"]);
    assert_eq!(cut.status.code(), Some(2), "{}", text(&cut.stderr));
    assert!(fs::read_to_string(folder.join("cut.html")).unwrap().contains("The file is damaged"));
    assert_eq!(palpate(folder, &["export", "cut.mcap", "/finger/wrench"]).status.code(), Some(2));
}
