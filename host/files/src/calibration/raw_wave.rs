//! The samples that a wave in the air was identified from, kept as those of the other steps are.
//!
//! Comment lines at the top hold a TOML table: what was measured with, and how the finger moved, as a motion file. Below, one
//! line for each sample: `seq,t_us,x,y`, the device's sample number and time in µs, and the counts of both bridges.
//!
//! Errors: [`RawError`] with the line and what is wrong in it; never a sample invented or left out.

use palpate::finger::Samples;
use palpate::finger::calibration::dwell::RawSample;
use palpate::pushing::finger_motion::FingerMotion;
use palpate_shared::status::Status;
use serde::{Deserialize, Serialize};

use super::raw::{Provenance, RawError, code, comment, number, table_of};
use crate::motion;

/// Format of raw files of a wave.
pub const RAW_WAVE_FORMAT: u32 = 1;

/// Names of the columns.
const COLUMNS: &str = "seq,t_us,x,y";

/// Samples of one block that is judged.
const BLOCK: usize = 64;

/// A wave with its samples.
#[derive(Clone, Debug, PartialEq)]
pub struct RawWave {
    /// What it was measured with.
    pub provenance: Provenance,
    /// How the finger was moved.
    pub motion: FingerMotion,
    /// What came, in order.
    pub samples: Vec<RawSample>,
}

/// The TOML in the comment lines.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    format: u32,
    motion: String,
    measured_with: Provenance,
}

/// A block's samples, one by one.
#[must_use]
pub fn samples_of(block: &Samples) -> Vec<RawSample> {
    let time = |index: usize| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within a block, microseconds")]
        let since = (index as f64 * block.period_us).round() as u64;
        block.time_us + since
    };
    let sample = |(index, counts): (usize, &[palpate_shared::units::Counts; 2])| RawSample {
        seq: block.first + index as u64,
        t_us: time(index),
        counts: *counts,
    };
    block.counts.iter().enumerate().map(sample).collect()
}

impl RawWave {
    /// The samples as a device sends them, for a judge: blocks without gaps, with what is missing between them.
    #[must_use]
    pub fn blocks(&self) -> Vec<Samples> {
        let period_us = 1e6 / self.provenance.rate_hz;
        let follows = |a: &RawSample, b: &RawSample| b.seq == a.seq + 1;
        let mut next = None;
        let stretches = self.samples.chunk_by(follows).flat_map(|stretch| stretch.chunks(BLOCK));
        let block = |block: &[RawSample]| {
            let RawSample { seq: first, t_us: time_us, .. } = block[0];
            let missing_before = next.map_or(0, |next: u64| first.saturating_sub(next));
            next = Some(first + block.len() as u64);
            let counts = block.iter().map(|sample| sample.counts).collect();
            Samples { first, missing_before, time_us, period_us, status: Status::default(), counts }
        };
        stretches.map(block).collect()
    }

    /// The text of the file.
    ///
    /// # Errors
    /// The heading cannot be written as TOML.
    pub fn to_text(&self) -> Result<String, RawError> {
        let header = Header {
            format: RAW_WAVE_FORMAT,
            motion: motion::to_text(&self.motion),
            measured_with: self.provenance.clone(),
        };
        let header = toml::to_string(&header).map_err(|error| RawError::Header(error.to_string()))?;
        let mut text = comment(&header) + COLUMNS + "\n";
        for RawSample { seq, t_us, counts: [x, y] } in &self.samples {
            text.push_str(&format!("{seq},{t_us},{},{}\n", x.0, y.0));
        }
        Ok(text)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`RawError`] with the line.
    pub fn from_text(text: &str) -> Result<Self, RawError> {
        let heading: Vec<&str> = text.lines().take_while(|line| line.starts_with('#')).collect();
        let table = table_of(&heading, RAW_WAVE_FORMAT)?;
        let Header { motion, measured_with, .. } =
            table.try_into().map_err(|error: toml::de::Error| RawError::Header(error.to_string()))?;
        measured_with.check()?;
        let motion = motion::parse(&motion).map_err(|error| RawError::Header(error.to_string()))?;
        let mut lines = text.lines().enumerate().skip(heading.len());
        match lines.next() {
            Some((_, line)) if line == COLUMNS => {}
            _ => return Err(RawError::Line { line: heading.len() + 1, what: format!("not \"{COLUMNS}\"") }),
        }
        let sample =
            |(index, line): (usize, &str)| parse_sample(line).map_err(|what| RawError::Line { line: index + 1, what });
        let samples: Vec<_> = lines.map(sample).collect::<Result<_, _>>()?;
        if let Some(place) = samples.windows(2).position(|pair| pair[1].seq <= pair[0].seq) {
            let what = "its sample number is not above the one before".to_owned();
            return Err(RawError::Line { line: heading.len() + place + 3, what });
        }
        if samples.is_empty() {
            Err(RawError::NoSamples(1))
        } else {
            Ok(Self { provenance: measured_with, motion, samples })
        }
    }
}

fn parse_sample(line: &str) -> Result<RawSample, String> {
    let fields: Vec<&str> = line.split(',').collect();
    let [seq, t_us, x, y] = fields[..] else { return Err(format!("{} fields instead of 4", fields.len())) };
    Ok(RawSample { seq: number(seq)?, t_us: number(t_us)?, counts: [code(x)?, code(y)?] })
}

#[cfg(test)]
mod tests {
    use palpate::finger::calibration::FrontEndSettings;
    use palpate_shared::units::Counts;

    use super::*;

    fn wave() -> RawWave {
        let front_end = FrontEndSettings { gain: 32, excitation_v: 2.5, full_scale_v: 1.2, gauge_factor: 2.0 };
        let provenance = Provenance {
            device: "palpate-0001".to_owned(),
            finger: "finger-a".to_owned(),
            date: "2024-05-02T10:15:00Z".to_owned(),
            temperature_c: None,
            rate_hz: 4000.0,
            front_end,
        };
        let motion = motion::parse("unit = 'm'\n[[segment]]\nseconds = 0.5\nacceleration = [1, -0.25]").unwrap();
        // Two are missing after the hundredth.
        let numbers = (0..100).chain(102..150_u64);
        let sample = |seq: u64| RawSample { seq, t_us: 250 * seq, counts: [Counts(-7), Counts(8_388_607)] };
        RawWave { provenance, motion, samples: numbers.map(sample).collect() }
    }

    #[test]
    fn a_wave_is_read_as_it_was_written() {
        let wave = wave();
        assert_eq!(RawWave::from_text(&wave.to_text().unwrap()).unwrap(), wave);
    }

    #[test]
    fn blocks_have_every_sample_and_count_the_gap() {
        let wave = wave();
        let blocks = wave.blocks();
        assert_eq!(blocks.iter().map(|block| block.missing_before).collect::<Vec<_>>(), [0, 0, 2]);
        assert_eq!(blocks.iter().flat_map(samples_of).collect::<Vec<_>>(), wave.samples);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let text = wave().to_text().unwrap();
        let says = |text: &str| RawWave::from_text(text).unwrap_err().to_string();
        assert!(
            says(&text.replace("\n3,750,", "\n2,750,")).contains("not above"),
            "{}",
            says(&text.replace("\n3,750,", "\n2,750,"))
        );
        assert!(says(&text.replace("\n3,750,", "\n3,x,")).contains("\"x\" is not a whole number"));
        assert!(says(&text.replace("format = 1", "format = 9")).contains("format 9"));
        assert!(says(text.split_once("seq").unwrap().0).contains("not \"seq"));
    }
}
