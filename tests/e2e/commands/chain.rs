//! The whole chain: force on the simulated disk, through firmware, wire and calibration, to a contact angle.

use std::sync::Arc;

use palpate::finger::calibration::plan::{CalibrationPlan, TareMode};
use palpate::finger::calibration::{self, Calibration, Load};
use palpate::finger::contact::Averaging;
use palpate_cli::live::{self, LinkSource, SimulatedBench};
use palpate_cli::thesis::static_contacts::{self, ContactAccuracy, Contacts, ExperimentError, worst};
use palpate_device::Session;
use palpate_device::simulated::SimulatedDevice;
use palpate_tests::rig;

/// Force of the calibration and of the bar, N.
const FORCE_N: f64 = 2.0;

fn calibrate(session: &mut Session, hand: &SimulatedDevice) -> Calibration {
    let plan = CalibrationPlan::all_round(12, Load::Newtons(FORCE_N), TareMode::Each);
    let front_end = live::front_end(session.hello()).unwrap();
    let rate_hz = f64::from(session.hello().rate_hz);
    let mut run =
        calibration::session::CalibrationRun::new(plan.steps(), plan.dwell_settings(front_end, rate_hz).unwrap());
    let mut bench = SimulatedBench::new(hand, FORCE_N, |_, _| ());
    calibration::session::run(&mut run, &mut LinkSource::new(session), &mut bench).unwrap();
    let measurements = calibration::session::measurements(run.taken());
    calibration::fit(&measurements, &plan.fit_settings(&front_end)).unwrap().calibration
}

/// Contacts that are felt: none of them at an angle of the calibration.
const FELT_CONTACTS: u32 = 36;

/// Largest mean error of any contact at 2 N.
const MEAN_ERROR_MAX_DEG: f64 = 0.2;

/// Largest standard deviation of single readings of any contact at 2 N.
const SINGLE_SD_MAX_DEG: f64 = 0.5;

/// Largest standard deviation of 20 ms averages of any contact at 2 N.
const AVERAGED_SD_MAX_DEG: f64 = 0.15;

/// Smallest share of readings, over all contacts, whose stated 99 % interval holds the truth. Averages that overlap and
/// a drift common to a contact's readings make the share scatter by about half a per cent.
const COVERED_MIN: f64 = 0.98;

const AVERAGINGS: [Averaging; 3] = [Averaging::Off, Averaging::Seconds(0.01), Averaging::Seconds(0.02)];

/// A calibrated finger behind a line as real as this system has it.
struct Finger {
    hand: Arc<SimulatedDevice>,
    session: Session,
    calibration: Calibration,
}

impl Finger {
    fn calibrated(seed: u64) -> Self {
        let hand = rig::device(seed, rig::real_line());
        let mut session = rig::session(&hand);
        let calibration = calibrate(&mut session, &hand);
        Self { hand, session, calibration }
    }

    fn feel(&mut self, contacts: &Contacts) -> Vec<Vec<ContactAccuracy>> {
        let felt = static_contacts::feel(&mut self.session, &self.hand, &self.calibration, contacts, &AVERAGINGS);
        felt.unwrap_or_else(|error| panic!("{error}"))
    }
}

fn covered(felt: &[ContactAccuracy]) -> f64 {
    felt.iter().map(|felt| felt.covered).sum::<f64>() / felt.len() as f64
}

#[test]
fn static_contacts_at_two_newtons_are_felt_within_the_bars() {
    for seed in [20, 21, 22] {
        let mut finger = Finger::calibrated(seed);
        let felt = finger.feel(&Contacts::round_the_disk(FELT_CONTACTS, FORCE_N));
        for ((averaging, felt), sd_max) in
            AVERAGINGS.iter().zip(&felt).zip([SINGLE_SD_MAX_DEG, SINGLE_SD_MAX_DEG, AVERAGED_SD_MAX_DEG])
        {
            let worst = worst(felt);
            let (error, sd) = (worst.error.to_degrees(), worst.sd.to_degrees());
            assert!(error <= MEAN_ERROR_MAX_DEG, "seed {seed}, {averaging:?}: mean error {error} deg");
            assert!(sd <= sd_max, "seed {seed}, {averaging:?}: standard deviation {sd} deg");
            assert!(covered(felt) >= COVERED_MIN, "seed {seed}, {averaging:?}: {} covered", covered(felt));
            assert!(felt.iter().all(|felt| (felt.magnitude - FORCE_N).abs() < 0.01 * FORCE_N), "{felt:#?}");
        }
        let counts = finger.session.counts();
        assert_eq!((counts.missing, counts.repeated, counts.damaged_frames), (0, 0, 0), "{counts:?}");
    }
}

#[test]
fn the_error_falls_as_the_force_grows() {
    let mut finger = Finger::calibrated(23);
    let noise: Vec<f64> =
        [0.5, 1.0, 5.0].map(|force| worst(&finger.feel(&Contacts::round_the_disk(12, force))[0]).sd * force).to_vec();
    // The noise of the force is the same, so angle times force is: within what twelve thousand readings scatter.
    for product in &noise {
        assert!((product / noise[0] - 1.0).abs() < 0.1, "{noise:?}");
    }
}

#[test]
fn the_stated_interval_holds_the_contact_whatever_friction_does() {
    let mut finger = Finger::calibrated(24);
    let felt = finger.feel(&Contacts::round_the_disk(FELT_CONTACTS, FORCE_N).with_friction(0.2));
    for (averaging, felt) in AVERAGINGS.iter().zip(&felt) {
        assert!(covered(felt) >= COVERED_MIN, "{averaging:?}: {}", covered(felt));
        // The direction itself is off by the friction angle, which the interval must not hide.
        assert!((worst(felt).error.to_degrees() - 0.2_f64.atan().to_degrees()).abs() < 0.2, "{:?}", worst(felt));
    }
}

#[test]
fn a_host_that_is_not_told_of_friction_does_not_cover_it() {
    let mut finger = Finger::calibrated(25);
    let contacts = Contacts { mu_c: 0.0, ..Contacts::round_the_disk(12, FORCE_N).with_friction(0.2) };
    // Two of five contacts have the full friction angle, two half of it: 11 and 6 degrees, of 0.5 that are stated.
    assert!(covered(&finger.feel(&contacts)[2]) < 0.5);
}

#[test]
fn a_finger_that_is_not_touched_feels_no_contact() {
    let mut finger = Finger::calibrated(26);
    let contacts = Contacts::round_the_disk(4, 1e-4);
    let felt = static_contacts::feel(&mut finger.session, &finger.hand, &finger.calibration, &contacts, &AVERAGINGS);
    assert!(matches!(felt, Err(ExperimentError::NotFelt { readings: 0, .. })), "{felt:?}");
}
