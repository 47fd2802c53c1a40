//! What every command that needs a calibrated finger takes: which calibration, and which tare.

use std::fs;
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate::calibration::Calibration;
use palpate::calibration::file::{CalibrationFile, RawState};
use palpate::contact::Tare;
use palpate::link::Session;
use palpate::live;

/// Which calibration to use.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Calibration")]
pub(crate) struct CalibrationArguments {
    /// Calibration file [default: the newest under ./calibration that was made with the connected device]
    #[arg(long, short = 'c', value_name = "FILE", env = "PALPATE_CALIBRATION")]
    calibration: Option<PathBuf>,
}

impl CalibrationArguments {
    /// The calibration that was named, or the newest made with this device; `None` if there is none.
    pub(crate) fn load(&self, session: &Session) -> miette::Result<Option<Calibration>> {
        let Some(path) = self.calibration.clone().or_else(|| newest(Path::new("calibration"), &device(session))) else {
            return Ok(None);
        };
        let named = || format!("cannot use the calibration {}", path.display());
        let (file, state) = CalibrationFile::read(&path).map_err(miette::Report::from).wrap_err_with(named)?;
        let front_end = live::front_end(session.hello()).into_diagnostic()?;
        file.check_device(&device(session), &front_end).map_err(miette::Report::from).wrap_err_with(named)?;
        if let RawState::Missing = state {
            tracing::warn!(calibration = %path.display(), "its raw samples do not lie beside it");
        }
        eprintln!("calibration {}", path.display());
        Ok(Some(file.calibration().into_diagnostic().wrap_err_with(named)?))
    }

    /// As [`CalibrationArguments::load`], where nothing can be done without.
    pub(crate) fn require(&self, session: &Session) -> miette::Result<Calibration> {
        self.load(session)?.ok_or_else(|| {
            miette::miette!(
                help = format!("run `palpate calibrate -d {}` first, or name a file with -c", session.address()),
                "no calibration for device {} under ./calibration",
                device(session)
            )
        })
    }
}

/// The connected device's name in calibration files.
fn device(session: &Session) -> String {
    session.hello().device.to_string()
}

/// The newest calibration below `root` that was made with `device`, by the date in the file.
fn newest(root: &Path, device: &str) -> Option<PathBuf> {
    let folders = fs::read_dir(root).ok()?.flatten().map(|entry| entry.path());
    let files = folders.filter_map(|folder| fs::read_dir(folder).ok()).flat_map(|entries| entries.flatten());
    let candidates = files.map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|end| end == "toml"));
    let dated = candidates.filter_map(|path| {
        let text = fs::read_to_string(&path).ok()?;
        // A file that cannot be read belongs to nobody here; naming it says what is wrong with it.
        let file = CalibrationFile::from_text(&text).ok()?;
        (file.measured_with.device == device).then_some((file.measured_with.date, path))
    });
    dated.max_by(|a, b| a.0.cmp(&b.0)).map(|(_, path)| path)
}

/// Reads a kept tare.
pub(crate) fn load_tare(path: &Path) -> miette::Result<Tare> {
    let named = || format!("cannot use the tare {}", path.display());
    let text = fs::read_to_string(path).into_diagnostic().wrap_err_with(named)?;
    toml::from_str(&text).into_diagnostic().wrap_err_with(named)
}

/// Keeps a tare.
pub(crate) fn keep_tare(path: &Path, tare: &Tare) -> miette::Result<()> {
    let text = toml::to_string(tare).into_diagnostic()?;
    fs::write(path, text).into_diagnostic().wrap_err_with(|| format!("cannot keep the tare in {}", path.display()))
}
