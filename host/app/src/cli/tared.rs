//! A finger that is tared while it is watched, and tared again when somebody wishes it.

use miette::IntoDiagnostic as _;
use palpate::finger::calibration::{Calibration, FrontEnd};
use palpate::finger::contact::{Averaging, ContactSettings, Reading, Tare, TareError};
use palpate::finger::judge::Judged;
use palpate::finger::rest::{RestStretch, check_offset};
use palpate::finger::sense::{self, FingerSense};
use palpate_device::Session;

use super::calibrated::OffsetArguments;
use crate::advice::Advise as _;
use crate::live;
use crate::recording;

/// What it takes to make sense of a finger, but for its tare.
#[derive(Clone, Debug)]
pub(super) struct Untared {
    pub(super) calibration: Calibration,
    pub(super) front_end: FrontEnd,
    pub(super) settings: ContactSettings,
    offset: OffsetArguments,
}

impl Untared {
    /// The finger of this session.
    pub(super) fn new(
        session: &Session,
        calibration: Calibration,
        settings: ContactSettings,
        offset: OffsetArguments,
    ) -> miette::Result<Self> {
        let front_end = live::front_end(session.hello()).advised()?;
        let settings = ContactSettings { bias_walk: sense::bias_walk(&calibration, &front_end), ..settings };
        settings.check().into_diagnostic()?;
        Ok(Self { calibration, front_end, settings, offset })
    }

    /// The unit of force.
    pub(super) fn unit(&self) -> &'static str {
        self.calibration.unit().symbol()
    }

    /// What a tare is to be held against.
    pub(super) fn expected_offset(&self) -> Option<(&Calibration, &FrontEnd)> {
        self.offset.expected(&self.calibration, &self.front_end)
    }

    /// The tare that these readings at rest make.
    pub(super) fn tare(&self, readings: &[Reading]) -> Result<Tare, TareError> {
        let tare = Tare::estimate(readings, &self.settings.tare_settings())?;
        if let Some((calibration, front_end)) = self.expected_offset() {
            check_offset(&tare.bias, calibration, front_end)?;
        }
        Ok(tare)
    }

    /// The finger with this tare, which the recording knows from now on.
    pub(super) fn tared(&self, tare: Tare) -> miette::Result<FingerSense> {
        let sense = FingerSense::new(Some(self.calibration.clone()), tare, &self.settings).into_diagnostic()?;
        self.record(&sense);
        Ok(sense)
    }

    /// Has the recording know what forces are less.
    pub(super) fn record(&self, sense: &FingerSense) {
        recording::tared(self.unit(), Some(sense.tare().bias));
        recording::sensing(sense);
    }
}

/// How contacts are felt: friction at the finger, where the angle 0 lies, and over how many milliseconds forces are averaged.
pub(super) fn settings(mounting_angle: f64, contact_friction: f64, average_ms: f64) -> ContactSettings {
    let averaging = if average_ms > 0.0 { Averaging::Seconds(average_ms * 1e-3) } else { Averaging::Off };
    ContactSettings { mounting_angle, contact_friction, averaging, ..ContactSettings::default() }
}

/// Takes samples for a tare, if one is being taken; its readings once there are enough, or why it is none.
pub(super) fn rested(resting: &mut Option<RestStretch>, judged: &[Judged]) -> Option<Result<Vec<Reading>, TareError>> {
    let stretch = resting.as_mut()?;
    let outcome = judged.iter().find_map(|item| match stretch.take(item) {
        Ok(false) => None,
        Ok(true) => Some(Ok(())),
        Err(error) => Some(Err(error)),
    })?;
    let readings = resting.take().map(|rest| rest.readings().to_vec()).unwrap_or_default();
    Some(outcome.map(|()| readings))
}

/// Tells the tare.
pub(super) fn report(tare: &Tare, unit: &str) {
    note!(
        "tare ({:.4}, {:.4}) {unit} from {} samples; noise of one reading ({:.4}, {:.4}) {unit}",
        tare.bias.x,
        tare.bias.y,
        tare.samples,
        tare.sample_covariance[(0, 0)].sqrt(),
        tare.sample_covariance[(1, 1)].sqrt(),
    );
}
