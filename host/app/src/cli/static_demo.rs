//! `palpate demo --static`: the thesis's experiment with static contacts.

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate::finger::calibration::CalibrationFit;
use palpate::finger::contact::Averaging;
use palpate::math::statistics::mean;
use palpate_device::Session;
use palpate_device::session::SessionOptions;
use palpate_device::simulated::{Config, Line, Pace, SimulatedDevice};

use crate::advice::Advise as _;
use crate::thesis::demonstration::{self, CALIBRATION_CONTACTS, CALIBRATION_FORCE_N};
use crate::thesis::static_contacts::{self, ContactAccuracy, Contacts, worst};
use crate::width::folded;

/// Contacts that are felt, evenly round the disk and between those of the calibration.
const FELT_CONTACTS: u32 = 36;

/// Forces that are felt, N.
const FORCES_N: [f64; 4] = [0.5, 1.0, 2.0, 5.0];

/// Friction coefficient of the contacts with friction.
const MU_C: f64 = 0.2;

/// Contacts that are printed one by one: every sixth.
const PRINTED_EVERY: usize = 6;

/// The averagings that are compared, with their names.
const AVERAGINGS: [(&str, Averaging); 3] = [
    ("single readings", Averaging::Off),
    ("10 ms average", Averaging::Seconds(0.01)),
    ("20 ms average", Averaging::Seconds(0.02)),
];

/// Calibrates a simulated finger, then feels contacts round its disk.
///
/// Everything between the force and the bytes is the firmware's own code on a model of its chip; everything after
/// is what a real finger goes through, from the serial port on.
pub(super) fn run(seed: u64) -> miette::Result<ExitCode> {
    let begun = Instant::now();
    let line = if cfg!(unix) { Line::Pty { link: None } } else { Line::Pipe };
    let config = Config { seed, pace: Pace::AsAsked, line, ..Config::default() };
    let hand =
        Arc::new(SimulatedDevice::start(config).into_diagnostic().wrap_err("cannot start the simulated finger")?);
    say!("A simulated finger runs the firmware at {};\nthe host opens it like any serial port.", hand.address());
    let mut session = Session::open_simulated(Arc::clone(&hand), SessionOptions::default()).advised()?;
    say!("It streams {} samples a second, gain {}.", session.hello().rate_hz, session.hello().gain);
    let fit = demonstration::calibrate(&mut session, &hand, CALIBRATION_FORCE_N).advised()?;
    print_calibration(&fit);
    feel_and_print(&mut session, &hand, &fit)?;
    print_ending(&session, begun);
    Ok(ExitCode::SUCCESS)
}

fn print_calibration(fit: &CalibrationFit) {
    let inverse = fit.calibration.inverse() * 1e6;
    say!("");
    say!("Calibrated on {CALIBRATION_CONTACTS} contacts of {CALIBRATION_FORCE_N} N:");
    say!("  force [uN] = ({:8.3} {:8.3}) counts", inverse[(0, 0)], inverse[(0, 1)]);
    say!("               ({:8.3} {:8.3})", inverse[(1, 0)], inverse[(1, 1)]);
    if let Some(held) = fit.held_back() {
        let held_back = format!(
            "  {} contacts held back from the fit: worst error {:+.3} deg at {:.0} deg, rms {:.3} deg",
            held.contacts,
            held.worst_error.to_degrees(),
            held.worst_angle.to_degrees(),
            held.rms_error.to_degrees()
        );
        say!("{}", folded(&held_back));
    }
}

fn feel_and_print(session: &mut Session, hand: &SimulatedDevice, fit: &CalibrationFit) -> miette::Result<()> {
    let averagings = AVERAGINGS.map(|(_, averaging)| averaging);
    let mut rows = Vec::new();
    for force in FORCES_N {
        let contacts = Contacts::round_the_disk(FELT_CONTACTS, force);
        let measured = static_contacts::feel(session, hand, &fit.calibration, &contacts, &averagings).advised()?;
        if force.to_bits() == CALIBRATION_FORCE_N.to_bits() {
            print_contacts(force, &measured[2]);
        }
        rows.extend(
            AVERAGINGS.iter().zip(measured).map(|((name, _), measured)| (format!("{force} N, {name}"), measured)),
        );
    }
    say!("");
    say!("All {FELT_CONTACTS} contacts, none of them used for calibration; the worst, in degrees:");
    say!("  {:<24} {:>11} {:>10} {:>22}", "", "mean error", "noise sd", "stated 99 % held");
    rows.iter().for_each(|(name, measured)| print_row(name, measured));
    say!("  {:<24} {:>11} {:>10}", "thesis, 1000 readings", "within 1", "below 0.5");

    let contacts = Contacts::round_the_disk(FELT_CONTACTS, CALIBRATION_FORCE_N).with_friction(MU_C);
    let measured = static_contacts::feel(session, hand, &fit.calibration, &contacts, &averagings).advised()?;
    say!("");
    let unseen = format!(
        "With friction {MU_C} the force leaves the normal by up to {:.1} deg, which no force sensor can see; the stated \
         interval allows for it:",
        MU_C.atan().to_degrees()
    );
    say!("{}", folded(&unseen));
    AVERAGINGS.iter().zip(measured).for_each(|((name, _), measured)| print_row(&format!("2 N, {name}"), &measured));
    Ok(())
}

/// Some contacts one by one.
fn print_contacts(force: f64, measured: &[ContactAccuracy]) {
    say!("");
    say!("Felt with {force} N, 20 ms average, in degrees:");
    say!("  {:>8} {:>9} {:>7} {:>9} {:>9} {:>9}", "true", "felt", "error", "noise sd", "stated sd", "force [N]");
    for measured in measured.iter().step_by(PRINTED_EVERY) {
        say!(
            "  {:>8.2} {:>9.2} {:>+7.2} {:>9.2} {:>9.2} {:>9.4}",
            measured.angle.to_degrees(),
            (measured.angle + measured.error).to_degrees(),
            measured.error.to_degrees(),
            measured.sd.to_degrees(),
            measured.stated_sd.to_degrees(),
            measured.magnitude,
        );
    }
}

fn print_row(name: &str, measured: &[ContactAccuracy]) {
    let worst = worst(measured);
    let held = mean(measured.iter().map(|measured| measured.covered)).unwrap_or(f64::NAN);
    say!(
        "  {name:<24} {:>11.3} {:>10.3} {:>12.1} % of readings",
        worst.error.to_degrees(),
        worst.sd.to_degrees(),
        held * 100.0
    );
}

fn print_ending(session: &Session, begun: Instant) {
    let counts = session.counts();
    say!("");
    say!(
        "{} samples received, {} lost, {} repeated, {} damaged frames; {:.1} s in all.",
        counts.samples,
        counts.missing,
        counts.repeated,
        counts.damaged_frames,
        begun.elapsed().as_secs_f64()
    );
    say!("{}", folded("Nothing here was measured: the finger was simulated. README.md says how to build a real one."));
}
