//! What to do when a finger cannot be calibrated, or its calibration not be used.

use std::error::Error;

use palpate::finger::calibration::dwell::{DwellSettingsError, Refusal};
use palpate::finger::calibration::fit::{FITTED_MIN, FitError};
use palpate::finger::calibration::force::CalibrationError;
use palpate::finger::calibration::front_end::FrontEndError;
use palpate::finger::calibration::load_text::LoadTextError;
use palpate::finger::calibration::plan::{PLAN_FORMAT, PlanError};
use palpate::finger::calibration::session::{CalibrationRunError, SourceError};
use palpate_files::calibration::conclusion::{ConclusionError, HeldBackError};
use palpate_files::calibration::file::CalibrationFileError;
use palpate_files::calibration::plan::PlanFileError;
use palpate_files::calibration::raw::{ProvenanceError, RawError};
use palpate_files::output::OutputError;

use super::help;

/// The help for this very error.
pub(super) fn about(error: &(dyn Error + 'static)) -> Option<String> {
    settings(error).or_else(|| measuring(error)).or_else(|| result(error)).or_else(|| kept(error))
}

/// Help about what people set.
fn settings(error: &(dyn Error + 'static)) -> Option<String> {
    if let Some(error) = error.downcast_ref() {
        return Some(match error {
            FrontEndError::Gain(_) => "read the gain from the device again (palpate info)".to_owned(),
            FrontEndError::NotPositive { name, .. } => {
                format!("give the {name} from the data sheet of the part that is fitted")
            }
        });
    }
    if let Some(error) = error.downcast_ref() {
        return Some(match error {
            DwellSettingsError::Impossible { .. } => "50 or 60 Hz mains, 1 s dwell and 4000 Hz are usual".to_owned(),
            DwellSettingsError::TooShort { needed_s, .. } => format!("make the dwell at least {needed_s} s"),
        });
    }
    if let Some(error) = error.downcast_ref() {
        return match error {
            PlanError::Format(_) => Some(format!("write format = {PLAN_FORMAT}, or update palpate")),
            PlanError::Contacts(_) => Some("twelve every 30° are a good plan".to_owned()),
            PlanError::Value { name, wanted, .. } => Some(format!("{name} must be {wanted}")),
            PlanError::Dwell(error) => help(error),
        };
    }
    if let Some(error) = error.downcast_ref() {
        return match error {
            PlanFileError::Text(_) => Some("calibration/PROCEDURE.md shows one".to_owned()),
            PlanFileError::Plan(error) => help(error),
        };
    }
    error
        .is::<LoadTextError>()
        .then(|| "write it like 2 N, 204 g or 0.204 kg; \"same\" for one weight that nobody weighed".to_owned())
}

/// Taking samples at rest.
fn measuring(error: &(dyn Error + 'static)) -> Option<String> {
    if let Some(error) = error.downcast_ref() {
        return match error {
            CalibrationRunError::Source(error) => help(error),
            CalibrationRunError::Bench(error) => help(error),
        };
    }
    if error.is::<SourceError>() {
        return Some("check the cable, then repeat the step; palpate diagnose looks at the device alone".to_owned());
    }
    error.downcast_ref().map(refusal)
}

fn refusal(refusal: &Refusal) -> String {
    match refusal {
        Refusal::Drifts { .. } => {
            "let the finger warm up for ten minutes away from draughts; if loaded, see that nothing creeps or slips"
        }
        Refusal::Stepped { .. } => {
            "something slipped or was touched: settle the load and do not touch the bench while it samples"
        }
        Refusal::Swings { .. } => "let the weight come to rest; a shorter thread or a finger under the weight damps it",
        Refusal::LoadRemoved { .. } => "hang the weight again and leave it until the step is accepted",
        Refusal::NoLoad { .. } => "hang the weight or press the finger before going on",
        Refusal::TooWeak { factor, .. } => return format!("use at least {factor:.1} times the load"),
        Refusal::Saturated { .. } => {
            "lower the gain or the load; if nothing is loaded, look for a torn gauge or a loose wire"
        }
        Refusal::Stuck { .. } => "a live bridge is never that quiet: check its wiring and run palpate diagnose",
        Refusal::LostSamples { .. } => {
            "use a shorter cable or a faster link; palpate diagnose shows where samples are lost"
        }
        Refusal::Restarted { .. } => "check the supply and the cable, then repeat this step",
        Refusal::WrongRate { .. } => "state the rate the device runs at (palpate info)",
        Refusal::Trouble(_) => "palpate diagnose tells more",
        Refusal::Incomplete { .. } => "the raw file is cut short; take the data again",
    }
    .to_owned()
}

/// Making a matrix of the measurements, and judging it.
fn result(error: &(dyn Error + 'static)) -> Option<String> {
    if let Some(error) = error.downcast_ref() {
        return match error {
            ConclusionError::Raw(error) => help(error),
            ConclusionError::Fit(error) => help(error),
        };
    }
    if error.is::<HeldBackError>() {
        return Some(
            "check the head's zero and that contact, then calibrate again; see calibration/PROCEDURE.md, \
             \"When it does not come out\""
                .to_owned(),
        );
    }
    if let Some(error) = error.downcast_ref() {
        return Some(
            match error {
                CalibrationError::NotFinite(_) | CalibrationError::Covariance => {
                    "calibrate again; the file or the data it came from is damaged"
                }
                CalibrationError::NotTwoAxes { .. } => {
                    "check that the two bridges are glued a quarter turn apart and that both are connected"
                }
            }
            .to_owned(),
        );
    }
    error.downcast_ref().and_then(fit)
}

fn fit(error: &FitError) -> Option<String> {
    Some(match error {
        FitError::NoTare { .. } => {
            "take an unloaded reading before the contact, or one for all; see calibration/PROCEDURE.md, step 4"
                .to_owned()
        }
        FitError::TooFew { fitted } => {
            format!("add {} contacts at other angles", FITTED_MIN.saturating_sub(*fitted))
        }
        FitError::DoesNotSpan { add, .. } => {
            format!("add contacts at {add} (or opposite); twelve evenly all round are best")
        }
        FitError::BadContact { .. } => "take the contact again; loads are in newtons and above zero".to_owned(),
        FitError::Saturated { .. } => "lower the gain or the load, then take the contact again".to_owned(),
        FitError::LoadTooSmall { factor, needed, .. } => {
            let newtons = needed.map(|newtons| format!(" ({newtons:.2} N)")).unwrap_or_default();
            format!("use at least {factor:.1} times the load{newtons}")
        }
        FitError::NoTwoAxes => {
            "check that both bridges are connected and that the angles given are those of the contacts".to_owned()
        }
        FitError::Disagree { .. } => {
            "check the angles and loads given for those contacts, then take them again".to_owned()
        }
        FitError::NotConverged { .. } => {
            "the contacts contradict each other; check the angles given, then take them again".to_owned()
        }
        FitError::Unusable(_) => return None,
    })
}

/// The files of calibrations and of their raw samples.
fn kept(error: &(dyn Error + 'static)) -> Option<String> {
    if let Some(error) = error.downcast_ref() {
        return match error {
            ProvenanceError::Name { .. } => Some("choose a plain name like finger-a".to_owned()),
            ProvenanceError::Date(_) => Some("write it like 2024-05-02T10:15:00Z".to_owned()),
            ProvenanceError::Value { name, .. } => Some(format!("give the {name} as a plain number")),
            ProvenanceError::FrontEnd(error) => help(error),
        };
    }
    if let Some(error) = error.downcast_ref() {
        return raw(error);
    }
    error.downcast_ref().and_then(file)
}

fn raw(error: &RawError) -> Option<String> {
    let help = match error {
        RawError::Header(_) => "the comment lines at the top belong to the file: take it as it was written",
        RawError::Format(_) => "update palpate",
        RawError::Line { .. } => "the file was cut short or edited: take it as it was written",
        RawError::NoSamples(_) => "the file was cut short: take it as it was written",
        RawError::Provenance(error) => return help(error),
        RawError::Plan(error) => return help(error),
        RawError::Dwell { .. } => "the file was edited, or its plan was",
    };
    Some(help.to_owned())
}

fn file(error: &CalibrationFileError) -> Option<String> {
    let help = match error {
        CalibrationFileError::Io { .. } | CalibrationFileError::Output(OutputError::Io { .. }) => {
            "check the path, that you may read and write there, and that there is room"
        }
        CalibrationFileError::Output(OutputError::Exists(_)) => "move it away, or give another date or finger",
        CalibrationFileError::Text(_) => {
            "take the file as palpate calibrate wrote it, or recalculate it from its raw samples"
        }
        CalibrationFileError::Format(_) => "update palpate, or recalculate the calibration from its raw samples",
        CalibrationFileError::Altered => {
            "restore the file, or recalculate it: palpate calibrate --from-raw <its raw file>"
        }
        CalibrationFileError::RawAltered { .. } => "restore the raw file; the calibration itself is still valid",
        CalibrationFileError::NotFinite(_) => "recalculate the calibration from its raw samples",
        CalibrationFileError::WrongDevice { .. } => {
            "connect the finger it was made for, or calibrate this one: palpate calibrate"
        }
        CalibrationFileError::WrongFrontEnd { .. } => {
            "set the device as it was, or calibrate again with the present settings"
        }
        CalibrationFileError::Calibration(_) => return None,
        CalibrationFileError::Provenance(error) => return help(error),
        CalibrationFileError::Raw(error) => return help(error),
    };
    Some(help.to_owned())
}

#[cfg(test)]
mod tests {
    use std::io;

    use palpate::finger::calibration::Load;
    use palpate::finger::calibration::dwell::DwellChange;
    use palpate::finger::calibration::session::BenchError;

    use super::super::help;
    use super::*;

    fn check<E: Error + 'static>(cases: Vec<(E, &str)>) {
        for (error, wanted) in cases {
            assert_eq!(help(&error).as_deref(), Some(wanted), "{error:?}");
        }
    }

    #[test]
    fn each_setting_that_cannot_be_has_its_advice() {
        check(vec![
            (FrontEndError::Gain(3), "read the gain from the device again (palpate info)"),
            (
                FrontEndError::NotPositive { name: "gauge factor", value: 0.0 },
                "give the gauge factor from the data sheet of the part that is fitted",
            ),
        ]);
        check(vec![
            (
                DwellSettingsError::Impossible { name: "rate, Hz", value: 0.0 },
                "50 or 60 Hz mains, 1 s dwell and 4000 Hz are usual",
            ),
            (DwellSettingsError::TooShort { duration_s: 0.1, needed_s: 0.16 }, "make the dwell at least 0.16 s"),
        ]);
        check(vec![
            (PlanError::Format(2), "write format = 1, or update palpate"),
            (PlanError::Contacts(0), "twelve every 30° are a good plan"),
            (
                PlanError::Value { name: "held_back_every".to_owned(), value: 1.0, wanted: "0 or at least 2" },
                "held_back_every must be 0 or at least 2",
            ),
            (DwellSettingsError::TooShort { duration_s: 0.1, needed_s: 0.16 }.into(), "make the dwell at least 0.16 s"),
        ]);
        check(vec![
            (PlanFileError::Text("typo".to_owned()), "calibration/PROCEDURE.md shows one"),
            (PlanError::Contacts(0).into(), "twelve every 30° are a good plan"),
        ]);
        let wanted = "write it like 2 N, 204 g or 0.204 kg; \"same\" for one weight that nobody weighed";
        check(vec![("2 stone".parse::<Load>().unwrap_err(), wanted)]);
    }

    #[test]
    fn each_dwell_that_is_refused_has_its_advice() {
        let change = || DwellChange::Tare { microstrain: 1.0 };
        check(vec![
            (
                Refusal::Drifts { change: change(), seconds: 1.0 },
                "let the finger warm up for ten minutes away from draughts; if loaded, see that nothing creeps or slips",
            ),
            (
                Refusal::Stepped { change: change(), at_s: 0.5, seconds: 1.0 },
                "something slipped or was touched: settle the load and do not touch the bench while it samples",
            ),
            (
                Refusal::Swings { change: change(), seconds: 1.0 },
                "let the weight come to rest; a shorter thread or a finger under the weight damps it",
            ),
            (
                Refusal::LoadRemoved { before_microstrain: 9.0, after_microstrain: 1.0 },
                "hang the weight again and leave it until the step is accepted",
            ),
            (Refusal::NoLoad { microstrain: 0.1 }, "hang the weight or press the finger before going on"),
            (Refusal::TooWeak { sigma_deg: 1.0, factor: 2.54 }, "use at least 2.5 times the load"),
            (
                Refusal::Saturated { bridge: 'x', seq: 7 },
                "lower the gain or the load; if nothing is loaded, look for a torn gauge or a loose wire",
            ),
            (
                Refusal::Stuck { bridge: 'x', code: 5, seq: 7 },
                "a live bridge is never that quiet: check its wiring and run palpate diagnose",
            ),
            (
                Refusal::LostSamples { lost: 5, waited_s: 3.0, needed_s: 1.0 },
                "use a shorter cable or a faster link; palpate diagnose shows where samples are lost",
            ),
            (Refusal::Restarted { before: 9, after: 0 }, "check the supply and the cable, then repeat this step"),
            (
                Refusal::WrongRate { period_us: 500.0, rate_hz: 4000.0 },
                "state the rate the device runs at (palpate info)",
            ),
            (Refusal::Trouble("no supply".to_owned()), "palpate diagnose tells more"),
            (Refusal::Incomplete { samples: 3, needed: 4000 }, "the raw file is cut short; take the data again"),
        ]);
        let wanted = "check the cable, then repeat the step; palpate diagnose looks at the device alone";
        check(vec![(SourceError("gone".to_owned()), wanted)]);
        check(vec![(CalibrationRunError::from(SourceError("gone".to_owned())), wanted)]);
        assert_eq!(help(&CalibrationRunError::from(BenchError("its input ended".to_owned()))), None);
    }

    #[test]
    fn each_fit_that_fails_has_its_advice() {
        let damaged = "calibrate again; the file or the data it came from is damaged";
        let bridges = "check that the two bridges are glued a quarter turn apart and that both are connected";
        let weak = |needed| FitError::LoadTooSmall { contact: 1, angle_deg: 0.0, sigma_deg: 1.0, factor: 1.5, needed };
        check(vec![
            (
                FitError::NoTare { contact: 1, angle_deg: 0.0 },
                "take an unloaded reading before the contact, or one for all; see calibration/PROCEDURE.md, step 4",
            ),
            (FitError::TooFew { fitted: 1 }, "add 3 contacts at other angles"),
            (
                FitError::DoesNotSpan { lines: 1, worst_deg: 90.0, worst: f64::INFINITY, add: "90°".to_owned() },
                "add contacts at 90° (or opposite); twelve evenly all round are best",
            ),
            (
                FitError::BadContact { contact: 1, angle_deg: 0.0, what: "no load".to_owned() },
                "take the contact again; loads are in newtons and above zero",
            ),
            (
                FitError::Saturated { contact: 1, angle_deg: 0.0 },
                "lower the gain or the load, then take the contact again",
            ),
            (weak(None), "use at least 1.5 times the load"),
            (weak(Some(3.0)), "use at least 1.5 times the load (3.00 N)"),
            (
                FitError::NoTwoAxes,
                "check that both bridges are connected and that the angles given are those of the contacts",
            ),
            (
                FitError::Disagree { outliers: 4, fitted: 6, named: "1, 2, 3, 4".to_owned() },
                "check the angles and loads given for those contacts, then take them again",
            ),
            (
                FitError::NotConverged { last_step: 1.0 },
                "the contacts contradict each other; check the angles given, then take them again",
            ),
            (CalibrationError::Covariance.into(), damaged),
        ]);
        check(vec![
            (CalibrationError::NotFinite("matrix"), damaged),
            (CalibrationError::NotTwoAxes { condition: 99.0 }, bridges),
            (CalibrationError::Covariance, damaged),
        ]);
        check(vec![
            (ConclusionError::Raw(RawError::Format(9)), "update palpate"),
            (ConclusionError::Fit(FitError::TooFew { fitted: 2 }), "add 2 contacts at other angles"),
            (ConclusionError::Fit(CalibrationError::NotTwoAxes { condition: 99.0 }.into()), bridges),
        ]);
        check(vec![(
            HeldBackError { angle_deg: 0.0, error_deg: 1.0, sigma_deg: 0.1, limit_deg: 0.2 },
            "check the head's zero and that contact, then calibrate again; see calibration/PROCEDURE.md, \"When it does \
             not come out\"",
        )]);
    }

    #[test]
    fn each_file_that_cannot_be_used_has_its_advice() {
        let plain = "choose a plain name like finger-a";
        let name = || ProvenanceError::Name { what: "finger", name: "a/b".to_owned() };
        check(vec![
            (name(), plain),
            (ProvenanceError::Date("today".to_owned()), "write it like 2024-05-02T10:15:00Z"),
            (ProvenanceError::Value { name: "temperature", value: f64::NAN }, "give the temperature as a plain number"),
            (FrontEndError::Gain(3).into(), "read the gain from the device again (palpate info)"),
        ]);
        check(vec![
            (
                RawError::Header("no".to_owned()),
                "the comment lines at the top belong to the file: take it as it was written",
            ),
            (RawError::Format(9), "update palpate"),
            (
                RawError::Line { line: 3, what: "no number".to_owned() },
                "the file was cut short or edited: take it as it was written",
            ),
            (RawError::NoSamples(2), "the file was cut short: take it as it was written"),
            (name().into(), plain),
            (PlanError::Contacts(0).into(), "twelve every 30° are a good plan"),
            (
                RawError::Dwell { number: 1, refusal: Refusal::NoLoad { microstrain: 0.1 } },
                "the file was edited, or its plan was",
            ),
        ]);
        let text = String::new;
        check(vec![
            (
                CalibrationFileError::Io { doing: "read", path: "a".into(), source: io::ErrorKind::NotFound.into() },
                "check the path, that you may read and write there, and that there is room",
            ),
            (
                CalibrationFileError::Output(OutputError::Exists("a".into())),
                "move it away, or give another date or finger",
            ),
            (
                CalibrationFileError::Text(text()),
                "take the file as palpate calibrate wrote it, or recalculate it from its raw samples",
            ),
            (CalibrationFileError::Format(9), "update palpate, or recalculate the calibration from its raw samples"),
            (
                CalibrationFileError::Altered,
                "restore the file, or recalculate it: palpate calibrate --from-raw <its raw file>",
            ),
            (
                CalibrationFileError::RawAltered { path: "a".into(), found: text(), wanted: text() },
                "restore the raw file; the calibration itself is still valid",
            ),
            (CalibrationFileError::NotFinite(text()), "recalculate the calibration from its raw samples"),
            (
                CalibrationFileError::WrongDevice { made_with: text(), connected: text() },
                "connect the finger it was made for, or calibrate this one: palpate calibrate",
            ),
            (
                CalibrationFileError::WrongFrontEnd { made_with: text(), connected: text() },
                "set the device as it was, or calibrate again with the present settings",
            ),
            (CalibrationError::Covariance.into(), "calibrate again; the file or the data it came from is damaged"),
            (name().into(), plain),
            (RawError::Format(9).into(), "update palpate"),
        ]);
    }
}
