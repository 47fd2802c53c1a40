//! Contact, felt in 250 recorded pushes of a known block (`../shared/data/mlab_point_push`).
//!
//! The data is not part of the project: where it is absent, these tests say so and check nothing. What is expected
//! comes from the recordings by slow, separate code (`palpate_tests::force_logs`) and from
//! `tests/golden/mlab_pushes_begun_in_contact.csv`.

use std::collections::BTreeMap;
use std::fs;

use palpate::finger::contact::ContactSettings;
use palpate::finger::contact::offline::{BiasOrigin, RecordingStart};
use palpate_files::recordings::friction;
use palpate_files::recordings::mlab::{self, Log};
use palpate_files::recordings::part::RecordedPart;
use palpate_files::recordings::session::{self, RecordingOptions, RecordingReport, RecordingSummary};
use palpate_tests::force_logs::{self, RawPush, start_deviations, turn};

/// Pushes in each log, and logs.
const PUSHES: usize = 50;
const LOGS: usize = 5;
/// Least share of readings in contact within ±34° of the edge's inward normal.
const WITHIN_CONE_MIN: f64 = 0.85;
/// Largest difference between the bias from the first half of a free interval and the second half's mean, N: size of
/// the vector, so each axis is closer still.
const HALF_DIFFERENCE_MAX_N: f64 = 0.012;
/// From this on a push began in contact, N.
const START_FORCE_N: f64 = 0.2;
/// How far the bias may wander between neighbours, N, so that two rules for the expected bias may differ by it.
const WANDER_N: f64 = 0.02;
/// Onset against change point: 19 of 20 within one reading (10.5 ms with the clock's jitter), all within three and a
/// half. A force that grows slowly leaves the noise of either method a reading or two apart.
const ONSET_CLOSE_S: f64 = 0.011;
const ONSET_FAR_S: f64 = 0.035;
/// The tip travels at 2.5 mm/s from up to 5 mm away, and the block's pose is good to about 1 mm: at a true onset its
/// centre is about its radius (1 mm) from the edge.
const GAP_ONSET_MAX_M: f64 = 2.5e-3;
/// Two ways to find the bias differ by up to [`WANDER_N`] under forces of 1 N and more, which turns them by 1.1°.
const END_ANGLE_RAD: f64 = 0.02;

/// One log, read by palpate and by the oracle.
struct Session {
    folder: String,
    part: RecordedPart,
    log: Log,
    reports: Vec<RecordingReport>,
    raw: Vec<RawPush>,
}

/// All logs; `None`, with a word about it, where the data is absent.
fn sessions() -> Option<Vec<Session>> {
    let Some(logs) = force_logs::logs() else {
        eprintln!("NOT CHECKED: ../shared/data/mlab_point_push is absent, so no real recording was read");
        return None;
    };
    assert_eq!(logs.len(), LOGS);
    Some(logs.into_iter().map(|(folder, path)| session(folder, &path)).collect())
}

fn session(folder: String, path: &std::path::Path) -> Session {
    let text = fs::read_to_string(path).unwrap();
    let outline = path.parent().unwrap().join("../obj_geo_aluminium_triangle.txt");
    let part = RecordedPart::parse(&fs::read_to_string(outline).unwrap()).unwrap();
    let log = mlab::parse(&text).unwrap();
    let reports = session::of_log(&log, &options(part.clone(), 0.35)).unwrap();
    Session { folder, part, log, reports, raw: force_logs::read(&text) }
}

fn options(part: RecordedPart, contact_friction: f64) -> RecordingOptions {
    RecordingOptions {
        settings: ContactSettings { contact_friction, ..ContactSettings::default() },
        finger_from_sensor: session::MLAB_TOOL_FROM_SENSOR,
        part: Some(part),
        ..RecordingOptions::default()
    }
}

/// Folder and push of those that begin in contact, with the deviation in N.
fn golden() -> BTreeMap<(String, usize), f64> {
    let text = include_str!("../../golden/mlab_pushes_begun_in_contact.csv");
    let rows = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    rows.map(|row| {
        let fields: Vec<&str> = row.split(',').collect();
        ((fields[0].to_owned(), fields[1].parse().unwrap()), fields[2].parse().unwrap())
    })
    .collect()
}

#[test]
fn every_push_is_read_in_full() {
    for session in sessions().iter().flatten() {
        assert_eq!(session.log.bad().collect::<Vec<_>>(), Vec::<&mlab::BadPush>::new(), "{}", session.folder);
        assert_eq!((session.log.declared, session.reports.len()), (PUSHES, PUSHES), "{}", session.folder);
        for (push, raw) in session.log.good().zip(&session.raw) {
            assert_eq!((push.forces.len(), push.tips.len()), (raw.forces.len(), raw.tips.len()));
            let (got, want) = (push.forces.last().unwrap(), raw.forces.last().unwrap());
            assert!((got.t - want[0]).abs() + (got.force_finger.y - want[2]).abs() < 1e-12, "{got:?} {want:?}");
        }
    }
}

#[test]
fn pushes_that_begin_in_contact_are_recognised_and_no_others() {
    let Some(sessions) = sessions() else { return };
    let mut measured = BTreeMap::new();
    for session in &sessions {
        for (report, &truth) in session.reports.iter().zip(&start_deviations(&session.raw)) {
            let deviation = report.start_deviation.unwrap();
            assert!(
                (deviation - truth).abs() < WANDER_N,
                "{} {}: {deviation} N, {truth} N",
                session.folder,
                report.index
            );
            assert_eq!(
                report.start == RecordingStart::InContact,
                truth > START_FORCE_N,
                "{} {}",
                session.folder,
                report.index
            );
            if report.start == RecordingStart::InContact {
                assert!(matches!(report.bias.unwrap().found, BiasOrigin::Neighbours { refusal: None, .. }));
                measured.insert((session.folder.clone(), report.index), deviation);
            }
        }
    }
    let golden = golden();
    assert!(measured.keys().eq(golden.keys()), "felt {measured:?}, listed {golden:?}");
    for (push, listed) in golden {
        assert!((measured[&push] - listed).abs() < WANDER_N, "{push:?}: {} N, listed {listed} N", measured[&push]);
    }
}

#[test]
fn the_force_is_within_34_degrees_of_the_edge_normal() {
    let Some(sessions) = sessions() else { return };
    let mut all = Vec::new();
    for session in &sessions {
        all.extend(session.reports.iter().cloned());
        check_cone(&session.folder, &RecordingSummary::of(&session.reports));
    }
    check_cone("all", &RecordingSummary::of(&all));
}

fn check_cone(name: &str, summary: &RecordingSummary) {
    let share = summary.edge_within_cone as f64 / summary.edge_samples as f64;
    println!("{name}: {:.1} % of {} readings in contact within ±34°", 100.0 * share, summary.edge_samples);
    assert!(share >= WITHIN_CONE_MIN, "{name}: {share}, wanted {WITHIN_CONE_MIN}");
    assert!(summary.never_touched.is_empty() && summary.bias_unknown.is_empty(), "{name}: {summary:?}");
}

/// The stated intervals hold the normal in so many readings of each log, of 95 % stated; a log's friction may be found
/// from itself, or from every other of its pushes.
const WITHIN_STATED: [f64; 2] = [0.90, 0.99];
/// Friction of the fingertip while it slides, by slips and forces outside of palpate: 0.42 ± 0.05 from push to push.
const SLIDING: [f64; 2] = [0.37, 0.47];

#[test]
fn intervals_with_the_friction_found_hold_the_normal_as_often_as_stated() {
    let Some(sessions) = sessions() else { return };
    let ([mut held, mut of], mut crossed) = ([0; 2], Vec::new());
    for session in &sessions {
        let options = options(session.part.clone(), 0.0);
        let mut reports = session::of_log(&session.log, &options).unwrap();
        let found = friction::of_reports(&reports).unwrap();
        assert!((SLIDING[0]..SLIDING[1]).contains(&found.mu_c.value), "{}: {found:?}", session.folder);
        // Each half of the pushes with the friction of the other.
        let half =
            |odd: usize| -> Vec<_> { reports.iter().filter(|report| report.index % 2 == odd).cloned().collect() };
        for (taught, mut told) in [(half(0), half(1)), (half(1), half(0))] {
            friction::widen(&mut told, friction::of_reports(&taught).unwrap().cone());
            let summary = RecordingSummary::of(&told);
            crossed.push(summary.edge_within_stated as f64 / summary.edge_samples as f64);
        }
        friction::widen(&mut reports, found.cone());
        let summary = RecordingSummary::of(&reports);
        let share = summary.edge_within_stated as f64 / summary.edge_samples as f64;
        println!("{}: {found:?}, {:.1} % held", session.folder, 100.0 * share);
        assert!((WITHIN_STATED[0]..=WITHIN_STATED[1]).contains(&share), "{}: {share}", session.folder);
        (held, of) = (held + summary.edge_within_stated, of + summary.edge_samples);
    }
    println!("all: {:.1} % held; halves by the other half: {crossed:.3?}", 100.0 * held as f64 / of as f64);
    let mean = crossed.iter().sum::<f64>() / crossed.len() as f64;
    assert!((WITHIN_STATED[0]..=WITHIN_STATED[1]).contains(&mean), "{mean}: {crossed:?}");
}

#[test]
fn the_direction_at_the_end_is_that_of_separate_geometry_with_the_known_pose() {
    for session in sessions().iter().flatten() {
        for (report, raw) in session.reports.iter().zip(&session.raw) {
            if report.start == RecordingStart::InContact {
                continue; // The oracle takes its bias from the start.
            }
            let end = report.series.last().unwrap().t;
            let rows = report.series.iter().filter(|row| row.t > end - 0.1);
            let angles: Vec<f64> = rows.filter_map(|row| row.touch?.angle_to_normal).collect();
            let mean = angles.iter().sum::<f64>() / angles.len() as f64;
            let (name, oracle) = (&session.folder, raw.end_angle());
            assert!(turn(mean - oracle).abs() < END_ANGLE_RAD, "{name} {}: {mean}, {oracle} rad", report.index);
        }
    }
}

#[test]
fn the_bias_of_half_the_free_time_is_that_of_the_other_half() {
    let Some(sessions) = sessions() else { return };
    let (mut worst, mut checked): (f64, usize) = (0.0, 0);
    for session in &sessions {
        for (report, raw) in session.reports.iter().zip(&session.raw) {
            if report.start == RecordingStart::InContact {
                continue;
            }
            // The free time by the change point, in halves by time: nothing of palpate's is used.
            let end = raw.change_point() - 0.05;
            let (first, second) = (raw.mean(0.0, end / 2.0), raw.mean(end / 2.0, end));
            let oracle = (first[0] - second[0]).hypot(first[1] - second[1]);
            let own = report.free_check.map_or(0.0, |check| check.half_difference);
            let name = format!("{} push {}", session.folder, report.index);
            assert!(oracle < HALF_DIFFERENCE_MAX_N, "{name}: {oracle} N by the change point");
            assert!(own < HALF_DIFFERENCE_MAX_N, "{name}: {own} N");
            worst = worst.max(oracle).max(own);
            checked += 1;
        }
    }
    println!("halves of the free time: worst {worst:.4} N of {checked} pushes, limit {HALF_DIFFERENCE_MAX_N} N");
    assert_eq!(checked, LOGS * PUSHES - golden().len());
}

#[test]
fn onsets_agree_with_a_search_over_every_change_point_and_with_the_tip_s_path() {
    let Some(sessions) = sessions() else { return };
    let (mut close, mut worst, mut checked): (usize, f64, usize) = (0, 0.0, 0);
    for session in &sessions {
        for (report, raw) in session.reports.iter().zip(&session.raw) {
            let Some(onset) = report.onset else { continue };
            let difference = (onset - raw.change_point()).abs();
            let name = format!("{} push {}", session.folder, report.index);
            assert!(difference < ONSET_FAR_S, "{name}: onset at {onset} s, change at {} s", raw.change_point());
            let gap = report.edge.and_then(|edge| edge.gap_onset).unwrap();
            assert!(gap < GAP_ONSET_MAX_M, "{name}: the tip's centre is {gap} m from the edge at the onset");
            close += usize::from(difference < ONSET_CLOSE_S);
            worst = worst.max(difference);
            checked += 1;
        }
    }
    println!("onsets: {close} of {checked} within one reading of the change point, worst {worst:.3} s");
    assert_eq!(checked, LOGS * PUSHES - golden().len());
    assert!(close as f64 >= 0.95 * checked as f64, "{close} of {checked}");
}

#[test]
fn the_tare_predicts_the_noise_of_readings_it_has_not_seen() {
    let Some(sessions) = sessions() else { return };
    let all: Vec<RecordingReport> = sessions.into_iter().flat_map(|session| session.reports).collect();
    let summary = RecordingSummary::of(&all);
    let within = summary.free_within as f64 / summary.free_samples as f64;
    let chi = summary.half_difference_chi.unwrap();
    println!("free readings within 2 sigma: {:.1} % of {} (Gaussian 86.5 %)", 100.0 * within, summary.free_samples);
    println!("difference of halves: mean square {chi:.2} of the stated one");
    // Never too sure: no fewer inside than Gaussian noise has, and the bias no worse than stated. Not useless either:
    // these readings' neighbours are correlated by −0.15, so that means are better than white noise would make them.
    assert!((0.865..0.95).contains(&within), "{within}");
    assert!((0.4..1.1).contains(&chi), "{chi}");
}
