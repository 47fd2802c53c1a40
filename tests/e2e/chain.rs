//! The whole chain: force on the simulated disk, through firmware, wire and calibration, to a contact angle.

use std::sync::Arc;

use palpate::calibration::plan::{Plan, TareMode};
use palpate::calibration::{self, Calibration, Load};
use palpate::contact::Averaging;
use palpate::experiment::{self, Contacts, Worst, worst};
use palpate::link::Session;
use palpate::live::{self, LinkSource, SimulatedBench};
use palpate::simulated_device::SimulatedDevice;
use palpate_tests::rig;

/// Force of the calibration and of the bar, N.
const FORCE_N: f64 = 2.0;

fn calibrate(session: &mut Session, hand: &SimulatedDevice) -> Calibration {
    let plan = Plan::all_round(12, Load::Newtons(FORCE_N), TareMode::Each);
    let front_end = live::front_end(session.hello()).unwrap();
    let rate_hz = f64::from(session.hello().rate_hz);
    let mut run = calibration::session::Session::new(plan.steps(), plan.dwell_settings(front_end, rate_hz).unwrap());
    let mut bench = SimulatedBench::new(hand, FORCE_N, |_, _| ());
    calibration::session::run(&mut run, &mut LinkSource::new(session), &mut bench).unwrap();
    let measurements = calibration::session::measurements(run.taken());
    calibration::fit(&measurements, &plan.fit_settings(&front_end)).unwrap().calibration
}

fn in_degrees(worst: &Worst) -> (f64, f64, f64) {
    (worst.error.to_degrees(), worst.sd.to_degrees(), worst.covered)
}

#[test]
fn static_contacts_are_felt_within_the_bars() {
    let device = rig::device(20, rig::real_line());
    let mut session = rig::session(&device);
    let hand = Arc::clone(&device);
    let calibration = calibrate(&mut session, &hand);
    let averagings = [Averaging::Off, Averaging::Seconds(0.01), Averaging::Seconds(0.02)];
    for force in [2.0, 0.5, 1.0, 5.0] {
        let contacts = Contacts::round_the_disk(36, force);
        let felt = experiment::feel(&mut session, &hand, &calibration, &contacts, &averagings).unwrap();
        for (averaging, felt) in averagings.iter().zip(&felt) {
            eprintln!("{force} {averaging:?}: {:?}", in_degrees(&worst(felt)));
        }
    }
    let contacts = Contacts::round_the_disk(36, FORCE_N).with_friction(0.2);
    let felt = experiment::feel(&mut session, &hand, &calibration, &contacts, &averagings).unwrap();
    for (averaging, felt) in averagings.iter().zip(&felt) {
        eprintln!("{averaging:?}: {:?}", in_degrees(&worst(felt)));
    }
    eprintln!("{:?}", session.counts());
}
