//! Results on disk: `calibration/<finger>/<date>.toml`, with the raw samples beside it.
//!
//! A result is text for people and programs, format 1, never edited by hand: its last line is a checksum of everything
//! above it. It names the raw file and that file's checksum. Both are SHA-256, since results are passed on and
//! recordings refer to them for years. Line ends do not count, so that a checkout with other line ends stays valid.
//!
//! Writing never replaces a file: it goes to a temporary name first and is then linked to its own, which fails if that
//! exists. Reading checks format, checksum, every number and that the covariance is one.
//!
//! Units: degrees, microstrain and counts in the file, by name. Errors: [`CalibrationFileError`].

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix2, Vector2};
use palpate::finger::calibration::fit::{CalibrationFit, ContactResult, Quality, Role};
use palpate::finger::calibration::force::{
    Calibration, CalibrationError, CalibrationParts, ForceUnit, ParameterCovariance,
};
use palpate::finger::calibration::front_end::FrontEnd;
use palpate::finger::calibration::held_back::HeldBack;
use palpate::finger::calibration::measurements::Load;
use palpate::finger::calibration::plan::Step;
use palpate::finger::calibration::session::Taken;
use palpate::finger::calibration::zero_drift::ZeroDrift;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use thiserror::Error;

use super::carried::{ComplianceRecord, TipRecord, WaveRecord, ZeroDriftRecord};
use super::raw::{Provenance, ProvenanceError, RawError, RawRun};
use super::raw_wave::RawWave;
use crate::output::{self, OutputError};

/// Format of result files.
pub const FILE_FORMAT: u32 = 1;

/// What the last line begins with.
const SEAL: &str = "# sha256 of all lines above: ";

/// First lines, for whoever opens the file.
const PREAMBLE: &str = "# A finger's calibration. Do not edit: recalculate it from the raw samples instead.\n\
                        # counts - tare = matrix * force on the finger's disk, in finger axes.\n";

/// A calibration as it is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationFile {
    /// Format of the file.
    pub format: u32,
    /// Unit of force in which the matrix is.
    pub unit: ForceUnit,
    /// Counts per unit of force: rows are the x and y bridge, columns the x and y force.
    pub matrix: [[f64; 2]; 2],
    /// Unloaded reading, counts.
    pub offset: [f64; 2],
    /// Covariance of matrix (row by row) and offset.
    pub covariance: [[f64; 6]; 6],
    /// Force with which the finger's own weight bends it lying on its side, in the unit of force.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_weight: Option<f64>,
    /// What it was measured with.
    pub measured_with: Provenance,
    /// How well the fitted contacts agree.
    pub fit: Quality,
    /// What the held-back contacts say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_back: Option<HeldBackRecord>,
    /// What a wave in the air found, where it was waved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wave: Option<WaveRecord>,
    /// How far its tip gives way, where that was found or stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compliance: Option<ComplianceRecord>,
    /// Where its disk is on the wrist, where touches found that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tip: Option<TipRecord>,
    /// How its reading without load goes with temperature, where that was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zero_drift: Option<ZeroDriftRecord>,
    /// The samples it was made from.
    pub raw: RawRecord,
    /// Unloaded readings in the order taken.
    pub tare: Vec<TareRecord>,
    /// Contacts in the order taken.
    pub contact: Vec<ContactRecord>,
}

/// The raw file of a result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawRecord {
    /// Its name, in the same folder.
    pub file: String,
    /// Its SHA-256, hexadecimal, with line ends of one byte.
    pub sha256: String,
}

/// One unloaded reading of the run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TareRecord {
    /// Position of the dividing head as contact angle, degrees, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<f64>,
    /// Mean of both bridges, counts.
    pub counts: [f64; 2],
}

/// Whether a contact was fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RoleRecord {
    /// Fitted with full weight.
    Fitted,
    /// Fitted, but turned down as an outlier.
    Outlier,
    /// Held back from the fit to judge it.
    Held,
}

/// One contact and how it agrees with the matrix.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactRecord {
    /// Angle it was set to, degrees.
    pub angle_deg: f64,
    /// What was known of its load.
    pub load: Load,
    /// Whether it was fitted.
    pub role: RoleRecord,
    /// Weight in the fit, 0 to 1; 0 if held back.
    pub weight: f64,
    /// Force on the finger that the matrix finds, finger axes.
    pub force: [f64; 2],
    /// Felt minus set angle, degrees.
    pub angle_error_deg: f64,
    /// What noise and fixture (and the calibration, if held back) let one expect of it, 1 σ, degrees.
    pub angle_sigma_deg: f64,
    /// What the matrix does not explain, microstrain on each bridge.
    pub residual_microstrain: [f64; 2],
    /// Distance in standard deviations.
    pub sigmas: f64,
}

/// Judgement by the held-back contacts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldBackRecord {
    /// How many contacts were kept out of the fit.
    pub contacts: usize,
    /// Mean of felt minus set angle, degrees.
    pub mean_error_deg: f64,
    /// Root mean square of the same, degrees.
    pub rms_error_deg: f64,
    /// Error of the worst, degrees.
    pub worst_error_deg: f64,
    /// Angle of that contact, degrees.
    pub worst_angle_deg: f64,
    /// What it may be by noise, fixture and calibration, 1 σ, degrees.
    pub worst_sigma_deg: f64,
}

/// Why a result cannot be written or used.
#[derive(Debug, Error)]
pub enum CalibrationFileError {
    /// The operating system refused to read or write.
    #[error("cannot {doing} {path}")]
    Io {
        /// What was tried, in words.
        doing: &'static str,
        /// File or folder that was meant.
        path: PathBuf,
        /// Reason that the system gives.
        #[source]
        source: io::Error,
    },
    /// It was not written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Not TOML, or not a calibration.
    #[error("not a calibration: {0}")]
    Text(String),
    /// The file is of another format, with this number.
    #[error("the calibration has format {0}, this program reads format {FILE_FORMAT}")]
    Format(i64),
    /// Changed after it was written.
    #[error("the calibration was changed or cut short after it was written (its checksum does not match)")]
    Altered,
    /// The raw samples are not those it was made from.
    #[error("{path} is not the raw file this calibration was made from (sha256 {found}, not {wanted})")]
    RawAltered {
        /// Path of the raw file.
        path: PathBuf,
        /// SHA-256 that the raw file has, hexadecimal.
        found: String,
        /// The one in the result.
        wanted: String,
    },
    /// A number that is infinite or not a number.
    #[error("{0} in the calibration is not a finite number")]
    NotFinite(String),
    /// It was made with another device than the one connected.
    #[error("the calibration was made with device {made_with}, but device {connected} is connected")]
    WrongDevice {
        /// The device in the file.
        made_with: String,
        /// The device that is connected.
        connected: String,
    },
    /// It was made with other settings than the device has.
    #[error("the calibration was made with {made_with}, but the device runs with {connected}")]
    WrongFrontEnd {
        /// The settings in the file.
        made_with: String,
        /// The settings of the device that is connected.
        connected: String,
    },
    /// Numbers that make no calibration.
    #[error("the numbers in the calibration cannot be used")]
    Calibration(#[from] CalibrationError),
    /// Names or date that cannot be.
    #[error(transparent)]
    Provenance(#[from] ProvenanceError),
    /// The raw samples cannot be written.
    #[error(transparent)]
    Raw(#[from] RawError),
}

/// Whether the raw samples of a result are at hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RawState {
    /// Beside it, and the right ones.
    Verified,
    /// Not beside it. The calibration is usable, but cannot be recalculated.
    Missing,
}

impl CalibrationFile {
    /// Puts a result together.
    #[must_use]
    pub fn new(
        fit: &CalibrationFit,
        taken: &[Taken],
        provenance: &Provenance,
        front_end: &FrontEnd,
        raw: RawRecord,
    ) -> Self {
        let CalibrationParts { unit, matrix, offset, covariance } = *fit.calibration.parts();
        let tare = |taken: &Taken| match taken.step {
            Step::Tare { angle_deg } => Some(TareRecord { angle_deg, counts: taken.dwell.reading.counts.into() }),
            Step::Contact(_) => None,
        };
        Self {
            format: FILE_FORMAT,
            unit,
            matrix: matrix.transpose().into(),
            offset: offset.into(),
            covariance: covariance.transpose().into(),
            own_weight: fit.own_weight,
            measured_with: provenance.clone(),
            fit: fit.quality,
            held_back: fit.held_back().map(HeldBackRecord::from),
            wave: None,
            compliance: None,
            tip: None,
            zero_drift: None,
            raw,
            tare: taken.iter().filter_map(tare).collect(),
            contact: fit.contacts.iter().map(|contact| ContactRecord::new(contact, front_end)).collect(),
        }
    }

    /// The calibration, checked.
    ///
    /// # Errors
    /// Numbers that make none.
    pub fn calibration(&self) -> Result<Calibration, CalibrationError> {
        Calibration::new(CalibrationParts {
            unit: self.unit,
            matrix: Matrix2::from(self.matrix).transpose(),
            offset: Vector2::from(self.offset),
            covariance: ParameterCovariance::from(self.covariance).transpose(),
        })
        .map(|calibration| calibration.with_zero_drift(self.zero_drift()))
    }

    /// How its reading without load goes with temperature, in counts.
    fn zero_drift(&self) -> Option<ZeroDrift> {
        // A front-end that makes no sense was refused when the file was read.
        let front_end = FrontEnd::new(self.measured_with.front_end).ok()?;
        self.zero_drift.map(|record| record.drift(&front_end))
    }

    /// Refuses to serve another device, or the same with another gain or excitation: counts would mean other strains.
    ///
    /// # Errors
    /// What differs.
    pub fn check_device(&self, device: &str, front_end: &FrontEnd) -> Result<(), CalibrationFileError> {
        if self.measured_with.device != device {
            let (made_with, connected) = (self.measured_with.device.clone(), device.to_owned());
            return Err(CalibrationFileError::WrongDevice { made_with, connected });
        }
        let electrical = |settings: palpate::finger::calibration::front_end::FrontEndSettings| {
            format!(
                "gain {}, {} V excitation and {} V full scale",
                settings.gain, settings.excitation_v, settings.full_scale_v
            )
        };
        let (made_with, connected) = (electrical(self.measured_with.front_end), electrical(front_end.settings()));
        if made_with == connected { Ok(()) } else { Err(CalibrationFileError::WrongFrontEnd { made_with, connected }) }
    }

    /// The text of the file, sealed.
    ///
    /// # Errors
    /// The result cannot be written as TOML.
    pub fn to_text(&self) -> Result<String, CalibrationFileError> {
        let body = toml::to_string(self).map_err(|error| CalibrationFileError::Text(error.to_string()))?;
        let sealed = format!("{PREAMBLE}{body}");
        let seal = sha256(sealed.as_bytes());
        Ok(format!("{sealed}{SEAL}{seal}\n"))
    }

    /// Reads and checks the text of a file.
    ///
    /// # Errors
    /// [`CalibrationFileError`]: anything cut off, changed or impossible.
    pub fn from_text(text: &str) -> Result<Self, CalibrationFileError> {
        let table: toml::Table =
            text.parse().map_err(|error: toml::de::Error| CalibrationFileError::Text(error.to_string()))?;
        match table.get("format").and_then(toml::Value::as_integer) {
            Some(format) if format == i64::from(FILE_FORMAT) => {}
            Some(format) => return Err(CalibrationFileError::Format(format)),
            None => return Err(CalibrationFileError::Text("no format number".to_owned())),
        }
        check_seal(text)?;
        check_finite("", &toml::Value::Table(table.clone()))?;
        let file: Self =
            table.try_into().map_err(|error: toml::de::Error| CalibrationFileError::Text(error.to_string()))?;
        file.measured_with.check()?;
        file.calibration()?;
        if !file.zero_drift.is_none_or(|drift| drift.is_sound()) {
            return Err(CalibrationFileError::Text("no finger's zero drifts as [zero_drift] says".to_owned()));
        }
        // The raw file lies beside the result; a path could lead anywhere.
        if file.raw.file.is_empty() || file.raw.file.contains(['/', '\\', ':']) {
            return Err(CalibrationFileError::Text(format!("\"{}\" is not the name of a raw file", file.raw.file)));
        }
        Ok(file)
    }

    /// Reads a file and, if it is at hand, checks its raw file.
    ///
    /// # Errors
    /// [`CalibrationFileError`].
    pub fn read(path: &Path) -> Result<(Self, RawState), CalibrationFileError> {
        let text = fs::read_to_string(path).map_err(|source| CalibrationFileError::Io {
            doing: "read",
            path: path.to_owned(),
            source,
        })?;
        let file = Self::from_text(&text)?;
        let raw_path = path.with_file_name(&file.raw.file);
        let state = match fs::read(&raw_path) {
            Ok(bytes) => file.check_raw(&raw_path, &bytes).map(|()| RawState::Verified)?,
            Err(error) if error.kind() == io::ErrorKind::NotFound => RawState::Missing,
            Err(source) => return Err(CalibrationFileError::Io { doing: "read", path: raw_path, source }),
        };
        Ok((file, state))
    }

    fn check_raw(&self, path: &Path, bytes: &[u8]) -> Result<(), CalibrationFileError> {
        let (found, wanted) = (sha256(bytes), self.raw.sha256.clone());
        if found == wanted {
            Ok(())
        } else {
            Err(CalibrationFileError::RawAltered { path: path.to_owned(), found, wanted })
        }
    }
}

impl ContactRecord {
    fn new(contact: &ContactResult, front_end: &FrontEnd) -> Self {
        let (role, weight) = match contact.role {
            Role::HeldBack => (RoleRecord::Held, 0.0),
            Role::Fitted { weight } if contact.is_outlier() => (RoleRecord::Outlier, weight),
            Role::Fitted { weight } => (RoleRecord::Fitted, weight),
        };
        Self {
            angle_deg: contact.angle.to_degrees(),
            load: contact.load,
            role,
            weight,
            force: contact.force_finger.into(),
            angle_error_deg: contact.angle_error.to_degrees(),
            angle_sigma_deg: contact.angle_sigma.to_degrees(),
            residual_microstrain: (contact.residual_counts * front_end.microstrain_per_count()).into(),
            sigmas: contact.sigmas,
        }
    }
}

impl From<HeldBack> for HeldBackRecord {
    fn from(held: HeldBack) -> Self {
        Self {
            contacts: held.contacts,
            mean_error_deg: held.mean_error.to_degrees(),
            rms_error_deg: held.rms_error.to_degrees(),
            worst_error_deg: held.worst_error.to_degrees(),
            worst_angle_deg: held.worst_angle.to_degrees(),
            worst_sigma_deg: held.worst_sigma.to_degrees(),
        }
    }
}

/// SHA-256 in hexadecimal, carriage returns left out.
fn sha256(bytes: &[u8]) -> String {
    let mut hasher = Sha256::new();
    bytes.split(|&byte| byte == b'\r').for_each(|part| hasher.update(part));
    hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

fn check_seal(text: &str) -> Result<(), CalibrationFileError> {
    let at = text.rfind(SEAL).ok_or(CalibrationFileError::Altered)?;
    let (sealed, seal) = text.split_at(at);
    let ended =
        seal.strip_prefix(SEAL).and_then(|seal| seal.strip_suffix('\n')).ok_or(CalibrationFileError::Altered)?;
    if ended.trim_end_matches('\r') == sha256(sealed.as_bytes()) { Ok(()) } else { Err(CalibrationFileError::Altered) }
}

/// Names the first number that is infinite or not a number.
fn check_finite(name: &str, value: &toml::Value) -> Result<(), CalibrationFileError> {
    match value {
        toml::Value::Float(number) if !number.is_finite() => {
            Err(CalibrationFileError::NotFinite(name.trim_start_matches('.').to_owned()))
        }
        toml::Value::Array(values) => {
            values.iter().enumerate().try_for_each(|(index, value)| check_finite(&format!("{name}[{index}]"), value))
        }
        toml::Value::Table(table) => {
            table.iter().try_for_each(|(key, value)| check_finite(&format!("{name}.{key}"), value))
        }
        _ => Ok(()),
    }
}

/// Writes raw samples to `<root>/<finger>/<date>.csv` and returns the path.
///
/// # Errors
/// [`CalibrationFileError`]; no file is ever replaced, and none is left half written.
pub fn save_raw(root: &Path, run: &RawRun) -> Result<PathBuf, CalibrationFileError> {
    run.provenance.check()?;
    let path = path_of(root, &run.provenance, "csv");
    output::write_new(&path, run.to_text()?.as_bytes())?;
    Ok(path)
}

/// Writes the raw samples of a run that is not over to `<root>/<finger>/<date>.unfinished.csv`, in place of those it
/// has written before, and returns the path.
///
/// # Errors
/// [`CalibrationFileError`]; what was there before stays until the new file is whole.
pub fn save_unfinished(root: &Path, run: &RawRun) -> Result<PathBuf, CalibrationFileError> {
    run.provenance.check()?;
    let path = path_of(root, &run.provenance, "unfinished.csv");
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|source| OutputError::Io {
            doing: "create",
            path: folder.to_owned(),
            source,
        })?;
    }
    output::replace(&path, run.to_text()?.as_bytes())?;
    Ok(path)
}

/// Writes the result of a fit to `<root>/<finger>/<date>.toml`, for raw samples already written, and returns the path.
///
/// # Errors
/// [`CalibrationFileError`]; no file is ever replaced, and none is left half written.
pub fn save_result(
    root: &Path,
    fit: &CalibrationFit,
    taken: &[Taken],
    provenance: &Provenance,
    raw_path: &Path,
) -> Result<PathBuf, CalibrationFileError> {
    let front_end = provenance.check()?;
    let bytes = fs::read(raw_path).map_err(|source| CalibrationFileError::Io {
        doing: "read",
        path: raw_path.to_owned(),
        source,
    })?;
    let name = raw_path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let record = RawRecord { file: name, sha256: sha256(&bytes) };
    let file = CalibrationFile::new(fit, taken, provenance, &front_end, record);
    let path = path_of(root, provenance, "toml");
    output::write_new(&path, file.to_text()?.as_bytes())?;
    Ok(path)
}

/// Writes a result to which something was added beside the one that it came from, under its own date, and returns the
/// path. The raw samples stay those of the first.
///
/// # Errors
/// [`CalibrationFileError`]; no file is ever replaced.
pub fn save_beside(path: &Path, file: &CalibrationFile) -> Result<PathBuf, CalibrationFileError> {
    file.measured_with.check()?;
    let path = path.with_file_name(format!("{}.toml", file.measured_with.file_stem()));
    output::write_new(&path, file.to_text()?.as_bytes())?;
    Ok(path)
}

/// Writes the raw samples of a wave to `<date>.wave.csv` beside a result, and returns what the result is to say of them.
///
/// # Errors
/// [`CalibrationFileError`]; no file is ever replaced, and none is left half written.
pub fn save_raw_wave(path: &Path, wave: &RawWave) -> Result<RawRecord, CalibrationFileError> {
    wave.provenance.check()?;
    let name = format!("{}.wave.csv", wave.provenance.file_stem());
    let text = wave.to_text()?;
    output::write_new(&path.with_file_name(&name), text.as_bytes())?;
    Ok(RawRecord { file: name, sha256: sha256(text.as_bytes()) })
}

/// Writes a result anew to which a step of the same run was added.
///
/// # Errors
/// [`CalibrationFileError`]; what was there before stays until the new file is whole.
pub fn save_completed(path: &Path, file: &CalibrationFile) -> Result<(), CalibrationFileError> {
    file.measured_with.check()?;
    Ok(output::replace(path, file.to_text()?.as_bytes())?)
}

fn path_of(root: &Path, provenance: &Provenance, extension: &str) -> PathBuf {
    root.join(&provenance.finger).join(format!("{}.{extension}", provenance.file_stem()))
}
