//! What every command that needs a calibrated finger takes: which calibration, which tare.
