//! A finger on the ADS131M04: what it measures of its excitation and temperature, and what that does to forces.

use palpate_device::simulated::{Config, Line, Pace};
use palpate_shared::front_ends::FrontEndKind;
use palpate_shared::sim::{Channels, ContactLoad, Faults, FingerConfig, Load};
use palpate_tests::rig;

/// Mean count of channel 0 over a second, and a session's excitation and temperature, with an excitation that is off.
fn felt(channels: Channels, excitation_change: f32) -> (f64, Option<f64>, Option<f64>) {
    let finger = FingerConfig { channels, ..FingerConfig::ideal() };
    let faults = Faults { excitation_change, ..Faults::default() };
    let device = rig::device_of(Config { finger, faults, line: Line::Pipe, pace: Pace::AsRead, ..Config::default() });
    device.set_load(Load::Static(ContactLoad::frictionless(0.0, 2.0))).unwrap();
    let mut session = rig::session(&device);
    session.start().unwrap();
    // The beam swings for some tenths of a second.
    let blocks = rig::samples(&mut session, 12_000);
    let counts: Vec<_> = blocks.iter().flat_map(|block| &block.counts).skip(8000).map(|[x, _]| x.0).collect();
    let mean = counts.iter().map(|&count| f64::from(count)).sum::<f64>() / counts.len() as f64;
    let expected = if channels == Channels::Four { FrontEndKind::Ads131m04 } else { FrontEndKind::Ads131m02 };
    assert_eq!(session.hello().front_end.kind, expected);
    (mean, session.excitation_v(), session.temperature_c())
}

#[test]
fn an_excitation_that_is_off_changes_counts_of_two_channels_and_not_of_four() {
    let (as_set, none, _) = felt(Channels::Two, 0.0);
    let (lower, ..) = felt(Channels::Two, -0.02);
    assert!((lower / as_set - 0.98).abs() < 1e-4, "{lower} of {as_set}");
    assert_eq!(none, None);
    for change in [0.0, -0.02, 0.05] {
        let (count, excitation_v, celsius) = felt(Channels::Four, change);
        // A count is 4e-5 of this load; codes are rounded twice.
        assert!((count / as_set - 1.0).abs() < 1e-4, "{count} of {as_set}");
        assert!((excitation_v.unwrap() - 2.5 * (1.0 + f64::from(change))).abs() < 1e-4, "{excitation_v:?}");
        assert!((celsius.unwrap() - 23.0).abs() < 0.01, "{celsius:?}");
    }
    // Half of the excitation is a fault, and nothing is scaled by it.
    let (halved, ..) = felt(Channels::Four, -0.5);
    assert!((halved / as_set - 0.5).abs() < 1e-4, "{halved} of {as_set}");
}
