//! The samples a calibration was made from, kept as a text file that anything can read.
//!
//! Comment lines at the top hold a TOML table: what was measured with and the step of each dwell. Below, one line for
//! each sample: `dwell,seq,t_us,x,y`, with dwells counted from 1, the device's sample number and time in µs, and the
//! counts of both bridges. A reader that skips lines with `#` (pandas: `comment="#"`) has the samples at once.
//!
//! Errors: [`RawError`] with the line and what is wrong in it; never a sample invented or left out.

use palpate::finger::calibration::dwell::{DwellSettings, RawSample, Refusal};
use palpate::finger::calibration::front_end::{FrontEnd, FrontEndError, FrontEndSettings};
use palpate::finger::calibration::plan::{CalibrationPlan, PlanError, Step};
use palpate::finger::calibration::session::{Taken, measure_again};
use palpate_shared::units::Counts;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Format of raw files.
pub const RAW_FORMAT: u32 = 1;

/// Names of the columns.
const COLUMNS: &str = "dwell,seq,t_us,x,y";

/// Longest name of a finger or device.
const NAME_MAX: usize = 64;

/// What a run was measured with. It goes into the raw file and into the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Name of the device, as it gives it.
    pub device: String,
    /// Name of the finger; also the folder of its results.
    pub finger: String,
    /// When the run was finished, RFC 3339 with time and offset.
    pub date: String,
    /// Temperature of the finger, °C, if anybody measured it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Gain, excitation and gauges: what turns counts into strain.
    pub front_end: FrontEndSettings,
}

/// What is wrong with a name, a date or a temperature.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ProvenanceError {
    /// A name that would not do as a folder.
    #[error("the {what} \"{name}\" is not a name of 1 to {NAME_MAX} letters, digits, - and _")]
    Name {
        /// What the name is for.
        what: &'static str,
        /// The name as given.
        name: String,
    },
    /// Not a date and time.
    #[error("\"{0}\" is not a date with time and offset (RFC 3339)")]
    Date(String),
    /// A number that cannot be.
    #[error("the {name} is {value}")]
    Value {
        /// Name of the header's entry.
        name: &'static str,
        /// The number as given.
        value: f64,
    },
    /// A front-end that cannot be.
    #[error(transparent)]
    FrontEnd(#[from] FrontEndError),
}

impl Provenance {
    /// Checks names, date and numbers, and gives the front-end.
    ///
    /// # Errors
    /// The first that will not do.
    pub fn check(&self) -> Result<FrontEnd, ProvenanceError> {
        for (what, name) in [("finger", &self.finger), ("device", &self.device)] {
            let plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
            if name.is_empty() || name.len() > NAME_MAX || !plain {
                return Err(ProvenanceError::Name { what, name: name.clone() });
            }
        }
        let whole = |date: toml::value::Datetime| date.date.is_some() && date.time.is_some() && date.offset.is_some();
        if !self.date.parse().is_ok_and(whole) {
            return Err(ProvenanceError::Date(self.date.clone()));
        }
        if let Some(value) = self.temperature_c.filter(|celsius| !(-273.15..1000.0).contains(celsius)) {
            return Err(ProvenanceError::Value { name: "temperature in °C", value });
        }
        if !(self.rate_hz > 0.0 && self.rate_hz < 1e6) {
            return Err(ProvenanceError::Value { name: "sampling rate in Hz", value: self.rate_hz });
        }
        Ok(FrontEnd::new(self.front_end)?)
    }

    /// The date as part of a file name: without colons, which some systems do not allow there.
    #[must_use]
    pub fn file_stem(&self) -> String {
        self.date.replace(':', "").replace(' ', "T")
    }
}

/// A run with its samples.
#[derive(Clone, Debug, PartialEq)]
pub struct RawRun {
    /// What it was measured with.
    pub provenance: Provenance,
    /// The plan that the run followed.
    pub plan: CalibrationPlan,
    /// What was done, each with its samples; less than planned if the run was stopped.
    pub dwells: Vec<(Step, Vec<RawSample>)>,
}

/// The TOML in the comment lines.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    format: u32,
    measured_with: Provenance,
    plan: CalibrationPlan,
    dwell: Vec<Step>,
}

/// Why a raw file cannot be used.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RawError {
    /// The comment lines are no TOML table of the right content.
    #[error("the heading of the raw file cannot be read: {0}")]
    Header(String),
    /// The file is of another format, with this number.
    #[error("the raw file has format {0}, this program reads format {RAW_FORMAT}")]
    Format(u32),
    /// A line that is no sample.
    #[error("line {line} of the raw file: {what}")]
    Line {
        /// Number of the line, from 1.
        line: usize,
        /// What is wrong with the line, in words.
        what: String,
    },
    /// A dwell without samples.
    #[error("the raw file has no samples of dwell {0}")]
    NoSamples(usize),
    /// What it was measured with cannot be.
    #[error(transparent)]
    Provenance(#[from] ProvenanceError),
    /// The plan cannot be.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A dwell is not at rest.
    #[error("dwell {number} of the raw file is not usable")]
    Dwell {
        /// Its number, from 1.
        number: usize,
        /// Why its samples are no dwell.
        #[source]
        refusal: Refusal,
    },
}

impl RawRun {
    /// Puts together what a session has taken.
    #[must_use]
    pub fn new(provenance: Provenance, plan: CalibrationPlan, taken: &[Taken]) -> Self {
        let dwells = taken.iter().map(|taken| (taken.step, taken.dwell.samples.clone())).collect();
        Self { provenance, plan, dwells }
    }

    /// How its dwells were taken.
    ///
    /// # Errors
    /// Provenance or plan that cannot be.
    pub fn dwell_settings(&self) -> Result<DwellSettings, RawError> {
        self.plan.check()?;
        Ok(self.plan.dwell_settings(self.provenance.check()?, self.provenance.rate_hz)?)
    }

    /// Measures the samples as when they were taken.
    ///
    /// # Errors
    /// A dwell that would not be accepted now.
    pub fn measure(&self) -> Result<Vec<Taken>, RawError> {
        let settings = self.dwell_settings()?;
        measure_again(&self.dwells, &settings).map_err(|(number, refusal)| RawError::Dwell { number, refusal })
    }

    /// The text of the file.
    ///
    /// # Errors
    /// The heading cannot be written as TOML.
    pub fn to_text(&self) -> Result<String, RawError> {
        let header = Header {
            format: RAW_FORMAT,
            measured_with: self.provenance.clone(),
            plan: self.plan.clone(),
            dwell: self.dwells.iter().map(|(step, _)| *step).collect(),
        };
        let header = toml::to_string(&header).map_err(|error| RawError::Header(error.to_string()))?;
        let mut text = comment(&header);
        text.push_str(COLUMNS);
        text.push('\n');
        for (number, (_, samples)) in (1_usize..).zip(&self.dwells) {
            for RawSample { seq, t_us, counts: [x, y] } in samples {
                text.push_str(&format!("{number},{seq},{t_us},{},{}\n", x.0, y.0));
            }
        }
        Ok(text)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`RawError`] with the line.
    pub fn from_text(text: &str) -> Result<Self, RawError> {
        let heading: Vec<&str> = text.lines().take_while(|line| line.starts_with('#')).collect();
        let header = parse_header(&heading)?;
        header.measured_with.check()?;
        header.plan.check()?;
        let mut dwells: Vec<(Step, Vec<RawSample>)> = header.dwell.into_iter().map(|step| (step, Vec::new())).collect();
        let mut lines = text.lines().enumerate().skip(heading.len());
        match lines.next() {
            Some((_, line)) if line == COLUMNS => {}
            _ => return Err(RawError::Line { line: heading.len() + 1, what: format!("not \"{COLUMNS}\"") }),
        }
        for (index, line) in lines {
            let problem = |what: String| RawError::Line { line: index + 1, what };
            let (number, sample) = parse_sample(line).map_err(problem)?;
            let dwell = number.checked_sub(1).and_then(|index| dwells.get_mut(index));
            dwell.ok_or_else(|| problem(format!("dwell {number} is not in the heading")))?.1.push(sample);
        }
        match dwells.iter().position(|(_, samples)| samples.is_empty()) {
            Some(index) => Err(RawError::NoSamples(index + 1)),
            None => Ok(Self { provenance: header.measured_with, plan: header.plan, dwells }),
        }
    }
}

/// Text in comment lines.
pub(super) fn comment(text: &str) -> String {
    let comment = |line: &str| if line.is_empty() { "#\n".to_owned() } else { format!("# {line}\n") };
    text.lines().map(comment).collect()
}

/// The TOML table in comment lines, if it is of this format.
pub(super) fn table_of(lines: &[&str], format: u32) -> Result<toml::Table, RawError> {
    let uncommented = |line: &&str| format!("{}\n", line.trim_start_matches('#'));
    let text: String = lines.iter().map(uncommented).collect();
    let table: toml::Table = text.parse().map_err(|error: toml::de::Error| RawError::Header(error.to_string()))?;
    match table.get("format").and_then(toml::Value::as_integer).map(u32::try_from) {
        Some(Ok(told)) if told == format => Ok(table),
        Some(Ok(told)) => Err(RawError::Format(told)),
        _ => Err(RawError::Header("no format number".to_owned())),
    }
}

fn parse_header(lines: &[&str]) -> Result<Header, RawError> {
    let table = table_of(lines, RAW_FORMAT)?;
    table.try_into().map_err(|error: toml::de::Error| RawError::Header(error.to_string()))
}

fn parse_sample(line: &str) -> Result<(usize, RawSample), String> {
    let fields: Vec<&str> = line.split(',').collect();
    let [dwell, seq, t_us, x, y] = fields[..] else { return Err(format!("{} fields instead of 5", fields.len())) };
    let sample = RawSample { seq: number(seq)?, t_us: number(t_us)?, counts: [code(x)?, code(y)?] };
    Ok((number(dwell)?, sample))
}

pub(super) fn number<T: std::str::FromStr>(field: &str) -> Result<T, String> {
    field.parse().map_err(|_| format!("\"{field}\" is not a whole number"))
}

pub(super) fn code(field: &str) -> Result<Counts, String> {
    let counts = Counts(number(field)?);
    let in_range = (Counts::MIN..=Counts::MAX).contains(&counts);
    if in_range { Ok(counts) } else { Err(format!("{field} is not a 24 bit code")) }
}
