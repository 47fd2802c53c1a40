//! How the palm moves that a body rolls on: as much as a person knows of it.

use std::path::PathBuf;

use nalgebra::Vector3;
use palpate::rolling::PalmAcceleration;
use palpate_files::palm::PalmFile;

use super::read::{read, report_problems};
use super::roll::triple;

/// What every command's help says of the file.
pub(super) const FILE_HELP: &str = "\
The file of --palm is TOML; every length in it is in its `unit`. Either harmonics, whose sum counts,
  unit = \"mm\"
  [[harmonic]]
  amplitude = [400, 0, 0]  # mm/s², along the palm's axes
  frequency_hz = 3
  phase_deg = 90           # at t = 0 (optional)
or pieces, one after the other,
  [[piece]]
  from_s = 0
  acceleration = [400, 0, 0]
or a table of t, ax, ay, az in s and m/s² (or as its header says): what an accelerometer on the palm gave, less gravity.
";

/// The palm's motion.
#[derive(Debug, clap::Args)]
pub(super) struct PalmMotionArguments {
    /// The palm's acceleration, constant
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    palm_m_s2: [f64; 3],
    /// The palm's acceleration from a file: harmonics, pieces, or a table as measured
    #[arg(long, value_name = "FILE", conflicts_with = "palm_m_s2")]
    palm: Option<PathBuf>,
}

impl PalmMotionArguments {
    /// The acceleration, palm axes; what of a file was skipped is told.
    pub(super) fn read(&self) -> miette::Result<PalmMotion> {
        let Some(path) = &self.palm else {
            let acceleration = PalmAcceleration::Constant(Vector3::from(self.palm_m_s2));
            return Ok(PalmMotion { acceleration, measured_until: None });
        };
        let PalmFile { acceleration, problems, measured_until } = read(path, PalmFile::parse)?;
        report_problems(path, &problems);
        Ok(PalmMotion { acceleration, measured_until })
    }

    /// For a picture.
    pub(super) fn in_words(&self) -> String {
        let [x, y, z] = self.palm_m_s2;
        match &self.palm {
            Some(path) => {
                format!("moving as {}", path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default())
            }
            None if x == 0.0 && y == 0.0 && z == 0.0 => "at rest".to_owned(),
            None => format!("accelerating by {x}, {y}, {z} m/s²"),
        }
    }
}

/// A palm's motion as far as it is known.
#[derive(Debug)]
pub(super) struct PalmMotion {
    pub(super) acceleration: PalmAcceleration,
    /// When what was measured ends, s.
    measured_until: Option<f64>,
}

impl PalmMotion {
    /// Whether nobody measured how it moves then (s).
    pub(super) fn is_beyond(&self, t: f64) -> bool {
        self.measured_until.is_some_and(|until| t > until)
    }

    /// Says so where the palm is taken to go on as nobody measured.
    pub(super) fn tell_beyond(&self, end: f64) {
        if let Some(until) = self.measured_until.filter(|_| self.is_beyond(end)) {
            tracing::warn!("the palm's motion was measured up to {until} s; beyond, its last acceleration is taken");
        }
    }
}
