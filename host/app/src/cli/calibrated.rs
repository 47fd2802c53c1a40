//! What every command that needs a calibrated finger takes: which device, which calibration, and which tare.

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate::finger::calibration::{Calibration, FrontEnd};
use palpate::finger::contact::Tare;
use palpate_device::Session;
use palpate_files::calibration::file::{CalibrationFile, RawState};
use palpate_files::output;
use serde::{Deserialize, Serialize};

use super::device::DeviceArguments;
use crate::advice::Advise as _;
use crate::live;
use crate::recording;
use crate::recording::play::Attached;

/// A finger that is tared before it feels.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct FingerArguments {
    #[command(flatten)]
    pub(super) offset: OffsetArguments,

    #[command(flatten)]
    pub(super) device: DeviceArguments,

    #[command(flatten)]
    pub(super) calibration: CalibrationArguments,
}

/// Which calibration to use.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Calibration")]
pub(crate) struct CalibrationArguments {
    /// Calibration file [default: the newest under ./calibration that was made with the connected device]
    #[arg(long, short = 'c', value_name = "FILE", env = "PALPATE_CALIBRATION")]
    calibration: Option<PathBuf>,
}

/// Which tares to refuse.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct OffsetArguments {
    /// Take a tare too that lies far from what the bridges read without load when the finger was calibrated
    #[arg(long)]
    tare_anyway: bool,
}

impl OffsetArguments {
    /// Whether a tare is to be held against anything.
    pub(super) fn is_checked(self) -> bool {
        !self.tare_anyway
    }

    /// What the tare is to be held against.
    pub(super) fn expected<'a>(
        self,
        calibration: &'a Calibration,
        front_end: &'a FrontEnd,
    ) -> Option<(&'a Calibration, &'a FrontEnd)> {
        (!self.tare_anyway).then_some((calibration, front_end))
    }
}

impl CalibrationArguments {
    /// The calibration that was named, or the newest made with this device; `None` if there is none.
    pub(crate) fn load(&self, session: &Session) -> miette::Result<Option<Calibration>> {
        let Some((path, file)) = self.load_file(session)? else { return Ok(None) };
        let named = || format!("cannot use the calibration {}", path.display());
        Ok(Some(file.calibration().advised().wrap_err_with(named)?))
    }

    /// The file that was named, without a device.
    pub(super) fn named(&self) -> miette::Result<(PathBuf, CalibrationFile)> {
        let path = self.calibration.clone().ok_or_else(|| miette::miette!("name the calibration with -c"))?;
        let named = || format!("cannot use the calibration {}", path.display());
        let (file, _) = CalibrationFile::read(&path).advised().wrap_err_with(named)?;
        attach(&path);
        Ok((path, file))
    }

    /// The calibration that was named, if one was, without a device.
    pub(super) fn named_calibration(&self) -> miette::Result<Option<Calibration>> {
        if self.calibration.is_none() {
            return Ok(None);
        }
        let (path, file) = self.named()?;
        let named = || format!("cannot use the calibration {}", path.display());
        Ok(Some(file.calibration().advised().wrap_err_with(named)?))
    }

    /// As [`CalibrationArguments::load`], with all that the file says, and its place.
    fn load_file(&self, session: &Session) -> miette::Result<Option<(PathBuf, CalibrationFile)>> {
        let recorded = if session.is_recorded() { recording::play::attachment("calibration") } else { None };
        if let (None, Some(recorded)) = (&self.calibration, recorded) {
            return Self::recorded(session, &recorded).map(Some);
        }
        let Some(path) = self.calibration.clone().or_else(|| newest(Path::new("calibration"), &device(session))) else {
            return Ok(None);
        };
        let named = || format!("cannot use the calibration {}", path.display());
        let (file, state) = CalibrationFile::read(&path).advised().wrap_err_with(named)?;
        let front_end = live::front_end(session.hello()).advised()?;
        file.check_device(&device(session), &front_end).advised().wrap_err_with(named)?;
        if let RawState::Missing = state {
            tracing::warn!(
                "calibration {}: its raw samples do not lie beside it, so nobody can check or repeat its fit",
                path.display()
            );
        }
        note!("calibration {}", path.display());
        attach(&path);
        Ok(Some((path, file)))
    }

    /// The calibration that came with the recording that is played.
    fn recorded(session: &Session, recorded: &Attached) -> miette::Result<(PathBuf, CalibrationFile)> {
        let path = PathBuf::from(&recorded.name);
        let named = || format!("cannot use the calibration {} of the recording", path.display());
        let text = String::from_utf8_lossy(&recorded.data);
        let file = CalibrationFile::from_text(&text).advised().wrap_err_with(named)?;
        let front_end = live::front_end(session.hello()).advised()?;
        file.check_device(&device(session), &front_end).advised().wrap_err_with(named)?;
        note!("calibration {}, from the recording", path.display());
        recording::attach("calibration", &path, &recorded.data);
        Ok((path, file))
    }

    /// As [`CalibrationArguments::load`], where nothing can be done without.
    pub(crate) fn require(&self, session: &Session) -> miette::Result<Calibration> {
        self.require_file(session)?.1.calibration().advised()
    }

    /// The same with all that the file says, and its place.
    pub(super) fn require_file(&self, session: &Session) -> miette::Result<(PathBuf, CalibrationFile)> {
        self.load_file(session)?.ok_or_else(|| {
            miette::miette!(
                help = format!("run `palpate calibrate -d {}` first, or name a file with -c", session.address()),
                "no calibration for device {} under ./calibration",
                device(session)
            )
        })
    }
}

/// Attaches a calibration file to the recording, if there is one.
fn attach(path: &Path) {
    if let Ok(bytes) = fs::read(path) {
        recording::attach("calibration", path, &bytes);
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

/// Version of the tare file that this program writes and reads.
const TARE_FORMAT: u32 = 1;

/// Longest tare file, in bytes; one takes about a kilobyte.
const TARE_BYTES_MAX: u64 = 64 * 1024;

/// A tare as it is kept, with what it belongs to.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct KeptTare {
    format: u32,
    device: String,
    gain: u8,
    rate_hz: u32,
    unit: String,
    tare: Tare,
}

impl KeptTare {
    /// A tare of the connected device.
    pub(crate) fn new(session: &Session, unit: &str, tare: Tare) -> Self {
        let hello = session.hello();
        let (gain, rate_hz, unit) = (hello.gain, hello.rate_hz, unit.to_owned());
        Self { format: TARE_FORMAT, device: device(session), gain, rate_hz, unit, tare }
    }

    /// Its name in recordings.
    pub(super) const ATTACHED: &str = "tare.toml";

    /// Attaches the tare to the recording, if there is one.
    pub(crate) fn attach(&self) {
        if let Ok(text) = toml::to_string(self) {
            recording::attach("tare", Path::new(Self::ATTACHED), text.as_bytes());
        }
    }

    /// Writes the tare to a file.
    pub(crate) fn save(&self, path: &Path) -> miette::Result<()> {
        let named = || format!("cannot keep the tare in {}", path.display());
        let text = toml::to_string(self).into_diagnostic()?;
        // An older tare may go; anything else is somebody's.
        if path.is_file() && Self::read(path).is_err() {
            let help = "choose another name, or move it away";
            return Err(miette::miette!(help = help, "it is there and is no kept tare")).wrap_err_with(named);
        }
        output::replace(path, text.as_bytes()).into_diagnostic().wrap_err_with(named)
    }

    /// Reads one, if it belongs to the connected device as it is set now.
    pub(crate) fn load(path: &Path, session: &Session, unit: &str) -> miette::Result<Tare> {
        if let Ok(bytes) = fs::read(path) {
            recording::attach("tare", path, &bytes);
        }
        Self::read(path)
            .and_then(|kept| kept.check(&Self::new(session, unit, kept.tare)))
            .wrap_err_with(|| format!("cannot use the tare {}", path.display()))
    }

    fn read(path: &Path) -> miette::Result<Self> {
        let mut text = String::new();
        let file = fs::File::open(path).into_diagnostic()?;
        file.take(TARE_BYTES_MAX).read_to_string(&mut text).into_diagnostic()?;
        toml::from_str(&text).map_err(|error| {
            miette::miette!(help = "take a new one with `palpate monitor --keep-tare`", "it is no kept tare: {error}")
        })
    }

    /// Compares it with what a tare of now would belong to, field by field.
    fn check(&self, now: &Self) -> miette::Result<Tare> {
        let facts = [
            ("format", self.format.to_string(), now.format.to_string()),
            ("device", self.device.clone(), now.device.clone()),
            ("gain", self.gain.to_string(), now.gain.to_string()),
            ("rate in Hz", self.rate_hz.to_string(), now.rate_hz.to_string()),
            ("unit of force", self.unit.clone(), now.unit.clone()),
        ];
        if let Some((what, kept, wanted)) = facts.into_iter().find(|(_, kept, wanted)| kept != wanted) {
            return Err(miette::miette!(
                help = "take a new one with `palpate monitor --keep-tare`",
                "its {what} is {kept}, and that of the finger is {wanted}"
            ));
        }
        let tare = self.tare;
        let positive =
            |matrix: &nalgebra::Matrix2<f64>| matrix.symmetric_eigenvalues().iter().all(|value| *value > 0.0);
        let sound = tare.bias.iter().all(|value| value.is_finite())
            && positive(&tare.bias_covariance)
            && positive(&tare.sample_covariance)
            && (1..=AVERAGING_MAX).contains(&tare.averaging_samples);
        if sound { Ok(tare) } else { Err(miette::miette!("its numbers make no tare: take a new one")) }
    }
}

/// Longest averaging of a kept tare, in samples: what `palpate monitor` itself can ask for.
const AVERAGING_MAX: usize = 32_000;
