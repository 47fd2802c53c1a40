//! Is the finger well? Ten seconds at rest, then five lines that a person can judge.
//!
//! Pure: samples go in with what the link counted, findings come out. Each finding has its figure, the limit it is
//! held against, and the cause when it is broken.
//!
//! Units: microstrain (µε) for strain, because that is what gauges are read in; newtons where the finger is
//! calibrated.

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

use crate::finger::STUCK_SAMPLES;
use crate::finger::calibration::FrontEnd;
use crate::math::statistics::mean;

/// Length of the averages by which hum and drift are told from noise, in s: one mains period at 50 Hz.
const AVERAGE_S: f64 = 0.02;

/// Noise above this multiple of the converter's own is picked up on the way: a loose screen, a long lead. Single
/// converters differ from the datasheet's typical value by less.
const NOISE_RATIO_MAX: f64 = 2.0;

/// Hum above this, in µε peak to peak, moves the angle of a 1 N contact by more than 1°, before averaging.
const HUM_MAX: f64 = 2.0;

/// Drift above this, in µε per minute, moves the angle of a 1 N contact by 1° within a minute: not warmed up, or loose.
const DRIFT_MAX: f64 = 1.0;

/// A rate further than this from what was set, as a ratio: a bare internal oscillator is 1 % off at most.
const RATE_ERROR_MAX: f64 = 0.02;

/// Everything observed at rest.
#[derive(Clone, Debug)]
pub struct ObservedAtRest {
    /// Counts of both channels, sample by sample.
    pub counts: Vec<Vector2<f64>>,
    /// How many samples were at the end of the converter's range on either channel.
    pub saturated: usize,
    /// Sample rate that was set, in Hz.
    pub rate_hz: f64,
    /// Device's seconds that a host's second lasted, by the link's clock map; `None` if the time was too short.
    pub clock_ratio: Option<f64>,
    /// How much later than others some samples arrived, in s: the host, or what is between, was busy.
    pub arrival_spread_s: f64,
    /// Samples that never came.
    pub missing: u64,
    /// Frames damaged on the line.
    pub damaged_frames: u64,
    /// Front-end settings, which give strain its unit.
    pub front_end: FrontEnd,
    /// The converter's own noise in one sample, in V, by its datasheet.
    pub converter_noise_v: f64,
    /// Counts to force, where the finger is calibrated in newtons.
    pub newtons_per_count: Option<Matrix2<f64>>,
}

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// As it should be.
    Good,
    /// Usable, but look at it.
    Look,
    /// Not usable as it is: to be mended first.
    Fault,
}

/// One line of the diagnosis.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What was looked at.
    pub subject: &'static str,
    /// How bad that is.
    pub verdict: Verdict,
    /// The figures, in words.
    pub figures: String,
    /// Why it is not good; `None` where nothing needs doing.
    pub cause: Option<Cause>,
}

/// What may be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The observation lasted too short a time to tell.
    TooShort,
    /// The converter's clock runs fast or slow.
    Clock,
    /// Samples arrived too unevenly to tell the converter's clock by.
    LateArrivals,
    /// Noise beyond the converter's own is picked up on the way.
    PickedUp,
    /// Hum of the mains.
    Hum,
    /// The reading drifts, as it does with temperature or a load that creeps.
    Drift,
    /// A bridge is at the end of the converter's range.
    Saturated,
    /// The converter gives the same code over and over.
    Stuck,
    /// Samples are lost or damaged on the way.
    Lost,
}

/// Figures behind the findings, for programs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Noise of one sample, in µε rms, drift and hum taken out.
    pub noise_microstrain: Vector2<f64>,
    /// Noise of a 20 ms average, in µε rms, drift taken out.
    pub averaged_noise_microstrain: Vector2<f64>,
    /// Noise of one sample, in N rms, where calibrated.
    pub noise_newtons: Option<Vector2<f64>>,
    /// Frequency of the stronger mains hum, in Hz: 50 or 60.
    pub hum_hz: f64,
    /// Its size, in µε peak to peak.
    pub hum_microstrain: Vector2<f64>,
    /// Drift, in µε per minute.
    pub drift_microstrain_per_min: Vector2<f64>,
    /// Standard deviation of the drift, in µε per minute.
    pub drift_sd: Vector2<f64>,
    /// Longest run of equal samples on either channel.
    pub longest_run: usize,
}

/// Five findings and the figures behind them; `None` if there are too few samples to say anything.
#[must_use]
pub fn diagnose(seen: &ObservedAtRest) -> Option<(Figures, [Finding; 5])> {
    let figures = figures(seen)?;
    let findings = [rate(seen), noise(seen, &figures), drift(&figures), range(seen, &figures), losses(seen)];
    Some((figures, findings))
}

fn figures(seen: &ObservedAtRest) -> Option<Figures> {
    let strain: Vec<Vector2<f64>> =
        seen.counts.iter().map(|counts| counts * seen.front_end.microstrain_per_count()).collect();
    let window = (AVERAGE_S * seen.rate_hz).round().max(1.0);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small positive whole number")]
    let averages: Vec<Vector2<f64>> = strain.chunks_exact(window as usize).filter_map(mean).collect();
    if averages.len() < 4 {
        return None;
    }
    let minutes_per_average = window / seen.rate_hz / 60.0;
    let trend = Trend::fit(&averages);
    let (hum_hz, hum, noise) = [50.0, 60.0]
        .map(|hz| {
            let (amplitude, rest) = without_hum(&strain, hz / seen.rate_hz);
            (hz, amplitude * 2.0, rest)
        })
        .into_iter()
        .max_by(|a, b| a.1.norm().total_cmp(&b.1.norm()))?;
    // The same share of each strain's noise is there in each count's, so that the matrix carries it over to force.
    let per_count = noise / seen.front_end.microstrain_per_count();
    let noise_newtons = seen.newtons_per_count.map(|matrix| {
        Vector2::from_fn(|i, _| (0..2).map(|j| (matrix[(i, j)] * per_count[j]).powi(2)).sum::<f64>().sqrt())
    });
    Some(Figures {
        noise_microstrain: noise,
        averaged_noise_microstrain: trend.scatter,
        noise_newtons,
        hum_hz,
        hum_microstrain: hum,
        drift_microstrain_per_min: trend.slope / minutes_per_average,
        drift_sd: trend.slope_sd / minutes_per_average,
        longest_run: (0..2).map(|axis| longest_run(&seen.counts, axis)).max().unwrap_or(0),
    })
}

/// A straight line through equally spaced values.
struct Trend {
    /// Change from one value to the next.
    slope: Vector2<f64>,
    slope_sd: Vector2<f64>,
    /// Standard deviation of the values from the line.
    scatter: Vector2<f64>,
}

impl Trend {
    fn fit(values: &[Vector2<f64>]) -> Self {
        let count = values.len() as f64;
        let (centre, middle): (Vector2<f64>, f64) = (mean(values).unwrap_or_default(), (count - 1.0) / 2.0);
        let spread = count * (count * count - 1.0) / 12.0;
        let moment: Vector2<f64> =
            values.iter().enumerate().map(|(i, value)| (value - centre) * (i as f64 - middle)).sum();
        let slope = moment / spread;
        let rest = values.iter().enumerate().map(|(i, value)| value - centre - slope * (i as f64 - middle));
        let scatter = (rest.map(|rest| rest.component_mul(&rest)).sum::<Vector2<f64>>() / (count - 2.0)).map(f64::sqrt);
        Self { slope, slope_sd: scatter / spread.sqrt(), scatter }
    }
}

/// Amplitude of a sine of `cycles` per sample in both channels, and the standard deviation of what is left when it,
/// a constant and a drift are taken out.
fn without_hum(values: &[Vector2<f64>], cycles: f64) -> (Vector2<f64>, Vector2<f64>) {
    let count = values.len();
    let basis = DMatrix::from_fn(count, 4, |i, j| {
        let phase = std::f64::consts::TAU * (cycles * i as f64).fract();
        [1.0, i as f64 / count as f64 - 0.5, phase.sin(), phase.cos()][j]
    });
    let normal = basis.tr_mul(&basis).cholesky();
    let per_axis = [0, 1].map(|axis| {
        let wanted = DVector::from_iterator(count, values.iter().map(|value| value[axis]));
        // The basis is independent over any stretch longer than a period, which the caller has made sure of.
        let fitted = normal.as_ref().map(|normal| normal.solve(&basis.tr_mul(&wanted)))?;
        let rest = &wanted - &basis * &fitted;
        Some((fitted[2].hypot(fitted[3]), (rest.norm_squared() / (count as f64 - 4.0)).sqrt()))
    });
    let [x, y] = per_axis.map(|axis| axis.unwrap_or((0.0, 0.0)));
    (Vector2::new(x.0, y.0), Vector2::new(x.1, y.1))
}

fn longest_run(counts: &[Vector2<f64>], axis: usize) -> usize {
    #[expect(clippy::float_cmp, reason = "counts are whole numbers")]
    let runs = counts.chunk_by(|a, b| a[axis] == b[axis]);
    runs.map(<[_]>::len).max().unwrap_or(0)
}

fn rate(seen: &ObservedAtRest) -> Finding {
    let Some(ratio) = seen.clock_ratio else {
        return Finding {
            subject: "rate",
            verdict: Verdict::Look,
            figures: format!("{:.0} Hz set; too short to measure", seen.rate_hz),
            cause: Some(Cause::TooShort),
        };
    };
    let measured = seen.rate_hz * ratio;
    let error = (ratio - 1.0).abs();
    // Samples that come late at the end of the time seem to be few, at its beginning many.
    let by_arrival = seen.arrival_spread_s * seen.rate_hz / seen.counts.len().max(1) as f64;
    let (verdict, cause) = match () {
        () if error <= RATE_ERROR_MAX => (Verdict::Good, None),
        () if error - by_arrival <= RATE_ERROR_MAX => (Verdict::Look, Some(Cause::LateArrivals)),
        () => (Verdict::Fault, Some(Cause::Clock)),
    };
    let late = match cause {
        Some(Cause::LateArrivals) => format!("; some arrived {:.2} s later than others", seen.arrival_spread_s),
        _ => String::new(),
    };
    Finding {
        subject: "rate",
        verdict,
        figures: format!(
            "{measured:.1} Hz by the host's clock, {:.0} Hz set ({:+.0} ppm){late}",
            seen.rate_hz,
            (ratio - 1.0) * 1e6
        ),
        cause,
    }
}

fn noise(seen: &ObservedAtRest, figures: &Figures) -> Finding {
    let converter = seen.converter_noise_v / seen.front_end.volts_per_count() * seen.front_end.microstrain_per_count();
    let (noise, averaged) = (figures.noise_microstrain, figures.averaged_noise_microstrain);
    let newtons = figures
        .noise_newtons
        .map_or_else(|| "newtons after calibration".to_owned(), |n| format!("({:.1}, {:.1}) mN", n.x * 1e3, n.y * 1e3));
    let too_noisy = noise.max() > NOISE_RATIO_MAX * converter;
    let hums = figures.hum_microstrain.max() > HUM_MAX;
    Finding {
        subject: "noise",
        verdict: if too_noisy || hums { Verdict::Look } else { Verdict::Good },
        figures: format!(
            "({:.2}, {:.2}) microstrain rms, converter alone {converter:.2}; {newtons}; ({:.2}, {:.2}) after 20 ms; hum \
             ({:.1}, {:.1}) peak to peak at {:.0} Hz",
            noise.x,
            noise.y,
            averaged.x,
            averaged.y,
            figures.hum_microstrain.x,
            figures.hum_microstrain.y,
            figures.hum_hz,
        ),
        cause: match (too_noisy, hums) {
            (true, _) => Some(Cause::PickedUp),
            (false, true) => Some(Cause::Hum),
            (false, false) => None,
        },
    }
}

fn drift(figures: &Figures) -> Finding {
    let drift = figures.drift_microstrain_per_min;
    // Three standard deviations: what a drift-free finger shows by chance once in hundreds of runs is not held against
    // it.
    let certain = drift.abs() - figures.drift_sd * 3.0;
    let drifts = certain.max() > DRIFT_MAX;
    Finding {
        subject: "drift",
        verdict: if drifts { Verdict::Look } else { Verdict::Good },
        figures: format!(
            "({:+.2}, {:+.2}) microstrain a minute, each ±{:.2}",
            drift.x,
            drift.y,
            figures.drift_sd.max()
        ),
        cause: drifts.then_some(Cause::Drift),
    }
}

fn range(seen: &ObservedAtRest, figures: &Figures) -> Finding {
    let stuck = figures.longest_run >= STUCK_SAMPLES;
    let centre = mean::<Vector2<f64>, _>(&seen.counts).unwrap_or_default() * seen.front_end.microstrain_per_count();
    Finding {
        subject: "range",
        verdict: if stuck || seen.saturated > 0 { Verdict::Fault } else { Verdict::Good },
        figures: format!(
            "{} of {} samples saturated; at most {} equal in a row; resting at ({:.0}, {:.0}) microstrain",
            seen.saturated,
            seen.counts.len(),
            figures.longest_run,
            centre.x,
            centre.y,
        ),
        cause: match (seen.saturated > 0, stuck) {
            (true, _) => Some(Cause::Saturated),
            (false, true) => Some(Cause::Stuck),
            (false, false) => None,
        },
    }
}

fn losses(seen: &ObservedAtRest) -> Finding {
    let lost = seen.missing > 0 || seen.damaged_frames > 0;
    Finding {
        subject: "losses",
        verdict: if lost { Verdict::Look } else { Verdict::Good },
        figures: format!(
            "{} of {} samples missing, {} damaged frames",
            seen.missing,
            seen.counts.len() as u64 + seen.missing,
            seen.damaged_frames
        ),
        cause: lost.then_some(Cause::Lost),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::finger::calibration::FrontEndSettings;
    use crate::finger::contact::test_noise::Random;

    const RATE_HZ: f64 = 4000.0;

    /// Noise of the converter by its datasheet, in V: 0.48 µε at 2.5 V excitation.
    const CONVERTER_NOISE_V: f64 = 1.2e-6;

    fn front_end() -> FrontEnd {
        FrontEnd::new(FrontEndSettings { gain: 32, excitation_v: 2.5, full_scale_v: 1.2, gauge_factor: 2.0 }).unwrap()
    }

    /// Ten seconds of white noise, hum and drift, in µε.
    fn finger(noise: f64, hum: f64, drift_per_min: f64, seed: u64) -> ObservedAtRest {
        let mut random = Random(seed);
        // The sum of twelve uniform numbers has variance 1.
        let mut normal = move || (0..12).map(|_| random.unit()).sum::<f64>() - 6.0;
        let counts = (0..40_000).map(|i| {
            let t = f64::from(i) / RATE_HZ;
            let common = hum / 2.0 * (std::f64::consts::TAU * 50.0 * t).sin() + drift_per_min * t / 60.0;
            let strain = Vector2::new(120.0 + common + noise * normal(), -80.0 + common + noise * normal());
            (strain / front_end().microstrain_per_count()).map(f64::round)
        });
        ObservedAtRest {
            counts: counts.collect(),
            saturated: 0,
            rate_hz: RATE_HZ,
            clock_ratio: Some(1.0),
            arrival_spread_s: 0.01,
            missing: 0,
            damaged_frames: 0,
            front_end: front_end(),
            converter_noise_v: CONVERTER_NOISE_V,
            newtons_per_count: None,
        }
    }

    fn verdicts(seen: &ObservedAtRest) -> [Verdict; 5] {
        diagnose(seen).unwrap().1.map(|finding| finding.verdict)
    }

    #[test]
    fn a_good_finger_gets_five_good_lines() {
        assert_eq!(verdicts(&finger(0.48, 1.0, 0.0, 1)), [Verdict::Good; 5]);
    }

    #[test]
    fn each_complaint_shows_in_its_own_line() {
        use Verdict::{Fault, Good, Look};
        let good = finger(0.48, 1.0, 0.0, 2);
        let cases = [
            (ObservedAtRest { clock_ratio: Some(0.97), ..good.clone() }, [Fault, Good, Good, Good, Good]),
            (finger(1.5, 1.0, 0.0, 3), [Good, Look, Good, Good, Good]),
            (finger(0.48, 5.0, 0.0, 4), [Good, Look, Good, Good, Good]),
            (finger(0.48, 1.0, 6.0, 5), [Good, Good, Look, Good, Good]),
            (ObservedAtRest { saturated: 3, ..good.clone() }, [Good, Good, Good, Fault, Good]),
            (ObservedAtRest { missing: 8, ..good.clone() }, [Good, Good, Good, Good, Look]),
        ];
        for (seen, wanted) in cases {
            assert_eq!(verdicts(&seen), wanted, "{:#?}", diagnose(&seen).unwrap().1);
        }
        let mut stuck = good;
        let value = stuck.counts[500];
        stuck.counts[500..600].fill(value);
        assert_eq!(verdicts(&stuck)[3], Fault);
    }

    /// Ten seconds of samples of which the last came 1.6 s late: not the converter's fault.
    #[test]
    fn a_busy_host_does_not_blame_the_converters_clock() {
        let good = finger(0.48, 1.0, 0.0, 7);
        let rate = |clock_ratio: f64, arrival_spread_s: f64| {
            let seen = ObservedAtRest { clock_ratio: Some(clock_ratio), arrival_spread_s, ..good.clone() };
            let finding = diagnose(&seen).unwrap().1[0].clone();
            (finding.verdict, finding.cause)
        };
        assert_eq!(rate(0.939, 1.6), (Verdict::Look, Some(Cause::LateArrivals)));
        assert_eq!(rate(0.939, 0.05), (Verdict::Fault, Some(Cause::Clock)));
        assert_eq!(rate(1.001, 1.6), (Verdict::Good, None));
    }

    #[test]
    fn too_few_samples_are_no_diagnosis() {
        let mut seen = finger(0.48, 1.0, 0.0, 6);
        seen.counts.truncate(300);
        assert!(diagnose(&seen).is_none());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn the_figures_are_what_was_put_in(noise in 0.1..3.0_f64, hum in 0.0..4.0_f64, drift in -20.0..20.0_f64, seed: u64) {
            let (figures, _) = diagnose(&finger(noise, hum, drift, seed)).unwrap();
            // 40,000 samples: the scatter of a standard deviation is 0.35 %, of an amplitude noise·√(2/40,000).
            let tolerance = 5.0 * noise * (2.0 / 40_000_f64).sqrt();
            for axis in 0..2 {
                prop_assert!((figures.noise_microstrain[axis] - noise).abs() < tolerance + 0.002, "{figures:?}");
                prop_assert!((figures.hum_microstrain[axis] - hum).abs() < 2.0 * tolerance + 0.01, "{figures:?}");
                let error = (figures.drift_microstrain_per_min[axis] - drift).abs();
                prop_assert!(error < 5.0 * figures.drift_sd[axis] + 1e-3, "{figures:?}");
            }
        }
    }
}
