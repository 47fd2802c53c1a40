//! Forces that the device computes beside the samples: what it needs for that, and whether they were right.

use miette::miette;
use palpate::finger::calibration::{Calibration, ForceUnit};
use palpate::finger::contact::Tare;
use palpate_device::Session;
use palpate_device::session::ForceCheck;
use palpate_shared::force::{ENTRY_MAX_UN, ForceMatrix};

/// The matrix and tare of a finger, as a device keeps them.
pub(super) fn matrix(calibration: &Calibration, tare: &Tare) -> miette::Result<ForceMatrix> {
    if calibration.unit() != ForceUnit::Newton {
        return Err(miette!(
            help = "calibrate it with a load of known weight",
            "a device computes forces in newtons, and this finger is calibrated in {}",
            calibration.unit().symbol()
        ));
    }
    let inverse = calibration.inverse();
    let newtons_per_count = [[inverse[(0, 0)], inverse[(0, 1)]], [inverse[(1, 0)], inverse[(1, 1)]]];
    let at_rest = calibration.parts().matrix * tare.bias;
    ForceMatrix::new(newtons_per_count, [at_rest.x, at_rest.y]).ok_or_else(|| {
        miette!(
            help = "choose a larger gain, or look at the calibration",
            "a device computes with at most {ENTRY_MAX_UN} µN a count, and this finger has {:.0}",
            1e6 * inverse.amax()
        )
    })
}

/// Says how the device's forces compared with its samples; whether all that could be held against them were right.
pub(super) fn holds(session: &Session) -> bool {
    let ForceCheck { equal, different, unchecked } = session.force_check();
    note!("device forces: {equal} equal to those of their samples, {different} different, {unchecked} without samples");
    different == 0
}
