//! Frames as text, against what they should be.

use std::time::Duration;

use nalgebra::{Matrix2, Vector2};
use palpate::finger::contact::{Contact, ContactEstimate, ContactReading};
use palpate::finger::judge::{SampleFault, Tally};
use palpate::finger::monitor::MonitorLine;
use palpate::finger::sense::Sensed;
use palpate_device::session::SessionCounts;
use ratatui::Terminal;
use ratatui::backend::TestBackend;

use super::state::{Bridges, Finger, Link, Recorded, State, TareInUse};
use super::view;

/// The screen as text, lines without their blank ends.
fn drawn(state: &State, columns: u16, rows: u16) -> String {
    let mut terminal = Terminal::new(TestBackend::new(columns, rows)).unwrap();
    terminal.draw(|frame| view::draw(frame, state)).unwrap();
    let buffer = terminal.backend().buffer();
    let row = |y: u16| (0..columns).map(|x| buffer[(x, y)].symbol()).collect::<String>().trim_end().to_owned();
    (0..rows).map(row).collect::<Vec<_>>().join("\n")
}

fn line(sensed: Sensed) -> MonitorLine {
    MonitorLine { sensed, since_last: Tally::default(), since_start: Tally::default() }
}

/// A touch at `u_deg` of so many newtons.
fn touch(t: f64, u_deg: f64, magnitude: f64) -> MonitorLine {
    let u = u_deg.to_radians();
    let force_finger = -magnitude * Vector2::new(u.cos(), u.sin());
    let contact = Contact::Touching(ContactEstimate {
        u,
        u_sd: 0.12_f64.to_radians(),
        friction_half_angle: 0.2_f64.atan(),
        force_finger,
        force_covariance: Matrix2::identity() * 1e-5,
        magnitude,
        magnitude_sd: 0.0031,
        onset: 10.0,
    });
    line(Sensed::Contact(ContactReading { t, contact, event: None }))
}

/// A finger that was free for ten seconds and is pressed harder and harder for eight, while the contact moves.
fn pressed() -> State {
    let finger = Finger {
        device: "0000000000000007".to_owned(),
        address: "/dev/ttyACM0".to_owned(),
        is_simulated: true,
        rate_hz: 4000,
        unit: "N",
        microstrain_per_count: 0.01,
    };
    let tare = TareInUse { bias: Vector2::new(0.1234, -0.0567), noise: Some([0.004; 2]), at: Some(1.0) };
    let mut state = State {
        finger,
        tare: Some(tare),
        t: 18.0,
        temperature_c: Some(31.25),
        inputs: None,
        counts: SessionCounts { samples: 72_000, missing: 16, damaged_frames: 2, ..SessionCounts::default() },
        recording: Some(Recorded { file: "run.mcap".to_owned(), since: Some(1.0), marks: 3, goes_on: true }),
        bridges: Some(Bridges {
            microstrain: [-123.45, 45.6],
            range: [0.124, 0.046],
            noise: Some([0.0041, 0.0039]),
            rate_hz: 3999.6,
        }),
        told: vec!["mark 3".to_owned()],
        ..State::default()
    };
    let free = Contact::Free { force_finger: Vector2::new(0.001, 0.002), sigmas: 0.7 };
    (0..300).for_each(|i| {
        let t = f64::from(i) / 30.0;
        state.take_line(&line(Sensed::Contact(ContactReading { t, contact: free, event: None })));
    });
    (300..=540)
        .for_each(|i| state.take_line(&touch(f64::from(i) / 30.0, f64::from(i) / 9.0, f64::from(i - 300) / 120.0)));
    state
}

/// The screen that stands in a file of this name; written anew where `PALPATE_GOLDEN` is set.
fn check(name: &str, drawn: &str) {
    let path = palpate_tests::project::folder().join("tests/golden/screen").join(name);
    if std::env::var_os("PALPATE_GOLDEN").is_some() {
        std::fs::write(&path, format!("{drawn}\n")).unwrap();
    }
    let golden = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert_eq!(drawn, golden.trim_end_matches('\n'), "the screen is not that of {}:\n{drawn}", path.display());
}

#[test]
fn a_press_on_a_common_terminal() {
    check("pressed_80x24.txt", &drawn(&pressed(), 80, 24));
}

#[test]
fn a_press_on_a_large_terminal() {
    check("pressed_140x45.txt", &drawn(&pressed(), 140, 45));
}

#[test]
fn a_press_on_a_small_terminal_in_lines() {
    check("pressed_44x12.txt", &drawn(&pressed(), 44, 12));
}

#[test]
fn what_goes_wrong_is_on_every_screen() {
    let fault = SampleFault::Saturated { channel: 1 };
    let mut state = pressed();
    state.take_line(&line(Sensed::NotMeasured { t: 18.1, fault }));
    state.link = Link::Lost { reason: "unplugged".to_owned() };
    state.recording.iter_mut().for_each(|recording| recording.goes_on = false);
    state.counts.disconnections = 1;
    check("alarms_80x24.txt", &drawn(&state, 80, 24));
    for (columns, rows) in [(80, 24), (44, 12), (140, 45)] {
        let text = drawn(&state, columns, rows);
        // Where lines are short the alarms are cut, never left out.
        for alarm in ["link lost (unplugged)", "NOT MEASURING", "the recording has ended"] {
            assert!(text.contains(alarm), "{columns} × {rows} without {alarm}:\n{text}");
        }
    }
}

#[test]
fn more_alarms_than_there_is_room_for_take_it() {
    let mut state = pressed();
    state.link = Link::Silent;
    state.loss = Some((18.0, 7));
    state.recording.iter_mut().for_each(|recording| recording.goes_on = false);
    state.bridges.iter_mut().for_each(|bridges| bridges.range = [0.9, 0.95]);
    let text = drawn(&state, 80, 24);
    assert_eq!(state.alarms().len(), 5);
    assert!(state.alarms().iter().all(|alarm| text.contains(alarm)), "{text}");
}

#[test]
fn what_was_told_is_broken_between_words_and_its_end_is_seen() {
    let mut state = pressed();
    let tare = "tare (3.7806, -2.5761) N from 4000 samples; noise of one reading (0.0017, 0.0016) N";
    state.told.push(tare.to_owned());
    let text = drawn(&state, 80, 24);
    let shown: Vec<_> = text.lines().filter(|line| line.contains("tare (") || line.contains("0.0016")).collect();
    let words = shown.iter().flat_map(|line| line.split_whitespace()).collect::<Vec<_>>().join(" ");
    assert_eq!((shown.len(), words.as_str()), (2, tare), "{text}");
}

#[test]
fn before_anything_is_felt_the_screen_asks_to_keep_the_finger_free() {
    let state = State { is_taring: true, ..State::default() };
    for (columns, rows) in [(80, 24), (44, 12)] {
        assert!(drawn(&state, columns, rows).contains("TARING: keep the finger free"));
    }
}

/// No size of terminal is too small to draw on.
#[test]
fn every_size_is_drawn() {
    let mut state = pressed();
    state.take_block(
        &palpate::finger::Samples {
            first: 0,
            missing_before: 3,
            time_us: 18_000_000,
            period_us: 250.0,
            status: palpate_shared::status::Status::default(),
            counts: vec![[palpate_shared::units::Counts(5); 2]; 8],
        },
        &[],
        Duration::from_secs(18),
    );
    for columns in (0..170).step_by(13) {
        for rows in (0..60).step_by(7) {
            drawn(&state, columns, rows);
        }
    }
}

#[test]
fn the_contact_is_drawn_where_it_is() {
    // Of the canvas alone: the arrow stands on the side that is touched.
    for (u_deg, is_right) in [(0.0, true), (180.0, false)] {
        let mut state = State { t: 1.0, ..State::default() };
        state.take_line(&touch(1.0, u_deg, 2.0));
        let text = drawn(&state, 100, 30);
        let dots = |range: std::ops::Range<usize>| {
            let braille = |c: char| ('\u{2801}'..='\u{28ff}').contains(&c);
            let lines = text.lines().skip(1).take(20);
            lines
                .map(|line| line.chars().skip(range.start).take(range.len()).filter(|c| braille(*c)).count())
                .sum::<usize>()
        };
        let (left, right) = (dots(1..25), dots(25..49));
        assert_eq!(right > left, is_right, "{left} {right}\n{text}");
    }
}
