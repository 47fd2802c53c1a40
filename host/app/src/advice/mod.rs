//! What to do about an error: the one place that says so.
//!
//! The libraries' errors hold facts and know of no command line. [`help`] looks down an error's chain of sources and
//! gives the advice for the first one that it knows; `Advise::advised` puts it under the error that a person is
//! shown.
//!
//! Errors whose message is another's (`#[error(transparent)]`) stand in that one's place in the chain, so each such
//! variant is followed here by name.
//!
//! `device`, `calibration` and `finger` hold the advice about each; files and what is left are here.

mod calibration;
mod device;
mod finger;

use std::error::Error;
use std::fmt;
use std::io;

use miette::{Diagnostic, Report};
use palpate_files::mcap::McapError;
use palpate_files::part::PartFileError;
use palpate_files::recordings::ReadError;
use palpate_files::recordings::stamped::StampedError;
use palpate_files::scene::SceneFileError;
use palpate_files::shapes::ShapeError;
use palpate_files::views;

use crate::live::LiveError;
use crate::thesis::demonstration::RigError;
use crate::thesis::static_contacts::ExperimentError;
pub(crate) use finger::remedy;

/// The help for the first error of the chain that there is help for.
///
/// ```
/// use palpate::finger::calibration::FrontEndError;
///
/// assert_eq!(palpate_cli::advice::help(&FrontEndError::Gain(3)).unwrap(), "read the gain from the device again (palpate info)");
/// assert_eq!(palpate_cli::advice::help(&std::io::Error::other("disk full")), None);
/// ```
#[must_use]
pub fn help(error: &(dyn Error + 'static)) -> Option<String> {
    let mut next = Some(error);
    while let Some(error) = next {
        if let Some(help) = about(error) {
            return Some(help);
        }
        next = error.source();
    }
    None
}

/// The help for this very error.
fn about(error: &(dyn Error + 'static)) -> Option<String> {
    // The system's error has the one that it was made from inside, and names only that one's source as its own.
    if let Some(inside) = error.downcast_ref::<io::Error>().and_then(io::Error::get_ref) {
        return help(inside);
    }
    own(error)
        .or_else(|| device::about(error))
        .or_else(|| calibration::about(error))
        .or_else(|| finger::about(error))
        .or_else(|| files(error))
}

/// The errors of this program.
fn own(error: &(dyn Error + 'static)) -> Option<String> {
    if let Some(error) = error.downcast_ref() {
        return match error {
            LiveError::Link(error) => help(error),
            LiveError::Silent { .. } => Some("`palpate info` shows what the device and its front-end say".to_owned()),
            LiveError::Tare { source } => help(source),
            LiveError::FrontEnd(error) => help(error),
        };
    }
    if let Some(error) = error.downcast_ref() {
        return match error {
            RigError::Link(error) => help(error),
            RigError::Live(error) => help(error),
            _ => None,
        };
    }
    if let Some(error) = error.downcast_ref() {
        return crate::cli::touch_advice(error);
    }
    match error.downcast_ref()? {
        ExperimentError::Live(error) => help(error),
        ExperimentError::NotFelt { .. } => {
            Some("is the force above the noise? `palpate diagnose` tells the noise".to_owned())
        }
        _ => None,
    }
}

/// Help about files of parts and views.
fn files(error: &(dyn Error + 'static)) -> Option<String> {
    if let Some(views::ViewFileError::NotConvex(_)) = error.downcast_ref() {
        return Some("--hull takes the hull".to_owned());
    }
    if let Some(error) = error.downcast_ref() {
        return tables(error);
    }
    if let Some(error) = error.downcast_ref() {
        return match error {
            StampedError::Several { .. } | StampedError::Other { .. } => Some("name one with --topic".to_owned()),
            StampedError::Mcap(McapError::Cut { .. } | McapError::Damaged { .. }) => {
                Some("`palpate recover` brings back what it still has".to_owned())
            }
            _ => None,
        };
    }
    if let Some(error) = error.downcast_ref() {
        return outline(error, true);
    }
    if let Some(SceneFileError::Drawing { error, .. }) = error.downcast_ref() {
        return outline(error, false);
    }
    if let Some(views::ViewFileError::Drawing(error)) = error.downcast_ref() {
        return outline(error, false);
    }
    match error.downcast_ref()? {
        PartFileError::Drawing(error) => outline(error, false),
        PartFileError::Supports { .. } => {
            Some("`palpate which-part` tells which it is; for anything else leave one, as `feet` or without".to_owned())
        }
        _ => None,
    }
}

/// Help about an outline from CAD, which the command line or a file that names it asks for.
fn outline(error: &ShapeError, is_command_line: bool) -> Option<String> {
    let tell = |option: &str, keys: &str| match is_command_line {
        true => format!("tell {option}; in a part file it is {keys}"),
        false => format!("say {keys} in the table `outline`"),
    };
    let by_hand = |what: &str, option: &str, keys: &str| format!("{what}, or {}", tell(option, keys));
    match error {
        ShapeError::UnitMissing { file, .. } => Some(match is_command_line {
            true => format!(
                "tell --unit mm (m, cm, mm or in); in a part file it is `outline = {{ file = {file:?}, unit = \"mm\" }}`"
            ),
            false => format!("say it: `outline = {{ file = {file:?}, unit = \"mm\" }}` (m, cm, mm or in)"),
        }),
        ShapeError::HeightMissing { .. } => Some(tell(
            "--height-mm, the height at which the finger touches it, or --shadow",
            "`height` or `shadow = true`",
        )),
        ShapeError::Hole { .. } => {
            Some(by_hand("delete it", "--fill-holes, which takes it for material", "`holes = \"fill\"`"))
        }
        ShapeError::Several { is_solid: true, .. } => Some("delete the others in the CAD program".to_owned()),
        ShapeError::Several { is_solid: false, .. } => {
            Some(by_hand("delete the others", "the one's --layer", "`layer`"))
        }
        ShapeError::Chords { .. } | ShapeError::TooManyVertices { .. } | ShapeError::CurveError { .. } => {
            Some(tell("a larger --curve-error-mm", "a larger `curve_error`"))
        }
        _ => None,
    }
}

/// Help about tables of forces and places.
fn tables(error: &ReadError) -> Option<String> {
    let told = |key: &str| format!("name the column with --columns {key}=NAME, or {key}=#NUMBER");
    match error {
        ReadError::NoColumn { key, .. } | ReadError::SeveralColumns { key, .. } => Some(told(key)),
        ReadError::UnknownUnit { .. } => Some("tell the unit with --columns, such as fx=NAME[mN]".to_owned()),
        ReadError::AllBad { first, .. } if first.message.contains("decimal comma") => {
            Some("--decimal-comma reads such numbers".to_owned())
        }
        ReadError::AllBad { first, .. } if first.message.contains("more need a header") => {
            Some("--columns t=#1,fx=#2,fy=#3 says which columns they are".to_owned())
        }
        _ => None,
    }
}

/// An error with the advice about it.
#[derive(Debug)]
struct Advised<E> {
    error: E,
    help: Option<String>,
}

impl<E: Error> fmt::Display for Advised<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.error, f)
    }
}

impl<E: Error> Error for Advised<E> {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.error.source()
    }
}

impl<E: Error> Diagnostic for Advised<E> {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }
}

/// The error as a person is shown it: its message, what it came from, and what to do.
pub(crate) fn report<E: Error + Send + Sync + 'static>(error: E) -> Report {
    Advised { help: help(&error), error }.into()
}

/// Results of the libraries, for commands.
pub(crate) trait Advise<T> {
    /// With the error as a person is shown it.
    fn advised(self) -> miette::Result<T>;
}

impl<T, E: Error + Send + Sync + 'static> Advise<T> for Result<T, E> {
    fn advised(self) -> miette::Result<T> {
        self.map_err(report)
    }
}

#[cfg(test)]
mod tests {
    use palpate::finger::calibration::fit::FitError;
    use palpate::finger::calibration::force::CalibrationError;
    use palpate_files::part::PartFile;
    use palpate_files::views::NamedPart;

    use super::*;

    #[test]
    fn a_report_says_what_the_error_says_and_what_to_do() {
        let report = report(FitError::Unusable(CalibrationError::Covariance));
        assert_eq!(report.to_string(), "the contacts give no usable matrix");
        let chain: Vec<String> = report.chain().map(ToString::to_string).collect();
        assert_eq!(chain[1..], ["the covariance of the calibration is not symmetric and positive definite"]);
        let help = "calibrate again; the file or the data it came from is damaged";
        assert_eq!(report.help().unwrap().to_string(), help);
        assert_eq!(report.wrap_err("cannot use it").help().unwrap().to_string(), help, "also with the place around it");
    }

    #[test]
    fn an_error_without_advice_is_shown_alone() {
        let report = report(io::Error::other("disk full"));
        assert_eq!(report.to_string(), "disk full");
        assert!(report.help().is_none());
    }

    #[test]
    fn this_programs_own_errors_have_their_help() {
        let silent = LiveError::Silent { last_event: None };
        let wanted = "`palpate info` shows what the device and its front-end say";
        assert_eq!(help(&silent).unwrap(), wanted);
        assert_eq!(help(&RigError::Live(LiveError::Silent { last_event: None })).unwrap(), wanted);
        assert_eq!(help(&ExperimentError::Live(silent)).unwrap(), wanted);
        let not_felt = ExperimentError::NotFelt { angle_deg: 30.0, normal_force: 1.0, readings: 0, wanted: 9 };
        assert_eq!(help(&not_felt).unwrap(), "is the force above the noise? `palpate diagnose` tells the noise");
    }

    #[test]
    fn a_part_with_a_notch_or_on_several_supports_is_told_the_way_out() {
        let notched = "unit = 'mm'\nvertices = [[0, 0], [10, 0], [3, 3], [0, 10]]\nmu = 0.3";
        assert_eq!(help(&NamedPart::parse("part", notched, false).unwrap_err()).unwrap(), "--hull takes the hull");
        let supports = "unit = 'mm'\nvertices = [[0, 0], [10, 0], [0, 10]]\nmu = 0.3\nmu_c = 0.2\n\
             [[support]]\nname = 'flat'\n[[support]]\nname = 'feet'\nfeet = [[1, 1, 1], [2, 1, 1], [1, 2, 1]]";
        assert_eq!(
            help(&PartFile::parse(supports).unwrap_err()).unwrap(),
            "`palpate which-part` tells which it is; for anything else leave one, as `feet` or without"
        );
    }

    #[test]
    fn an_outline_is_asked_for_in_the_words_of_where_it_is() {
        let hole = ShapeError::Hole { place: "CIRCLE".to_owned(), of: None };
        let wanted =
            "delete it, or tell --fill-holes, which takes it for material; in a part file it is `holes = \"fill\"`";
        assert_eq!(help(&hole).unwrap(), wanted);
        let wanted = "delete it, or say `holes = \"fill\"` in the table `outline`";
        assert_eq!(help(&PartFileError::Drawing(hole)).unwrap(), wanted);
        let several = |is_solid| {
            help(&ShapeError::Several { count: 2, first: "a".to_owned(), second: "b".to_owned(), is_solid }).unwrap()
        };
        assert!(several(false).contains("--layer") && !several(true).contains("layer"));
    }
}
