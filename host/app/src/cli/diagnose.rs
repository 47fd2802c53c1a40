//! `palpate diagnose`.

use std::process::ExitCode;
use std::time::Instant;

use nalgebra::Matrix2;
use palpate::finger::calibration::ForceUnit;
use palpate::finger::diagnosis::{self, Figures, Finding, ObservedAtRest, RestSamples, Verdict};
use palpate_device::{Incoming, Session};
use palpate_shared::sim::ads131m::{CLKIN_HZ, noise_rms};

use super::calibrated::CalibrationArguments;
use super::device::DeviceArguments;
use super::latency::Latency;
use crate::advice::{Advise as _, remedy};
use crate::live;
use crate::live::interrupt;
use crate::recording;
use crate::width::folded;

/// Is the finger well? Ten seconds at rest, then five lines.
///
/// Keep the finger free of contact. Exit status 1 if a line says FAULT.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// How long to look, in seconds
    #[arg(long, default_value_t = 10.0, value_name = "S", allow_negative_numbers = true, value_parser = super::stretch)]
    seconds: f64,

    /// Print one JSON object instead
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    calibration: CalibrationArguments,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    interrupt::listen();
    arguments.device.begin_recording()?;
    let mut session = arguments.device.open(true)?;
    let newtons_per_count = newtons_per_count(&session, &arguments.calibration)?;
    note!(
        "{}looking at {} for {} s; keep the finger free",
        super::simulated_note(&session),
        session.address(),
        arguments.seconds
    );
    let (observation, latency) = observe(&mut session, arguments.seconds, newtons_per_count)?;
    let Some((figures, findings)) = diagnosis::diagnose(&observation) else {
        return Err(miette::miette!(
            help = "give --seconds 1 or more",
            "{} samples are too few to judge the finger by",
            observation.counts.len()
        ));
    };
    if arguments.json {
        say!("{}", as_json(&session, &figures, &findings));
    } else {
        findings.iter().for_each(print_finding);
    }
    if let Some(latency) = latency.in_words() {
        note!("latency {latency}");
    }
    let fault = findings.iter().any(|finding| finding.verdict == Verdict::Fault);
    Ok(if fault { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// The finger's matrix, if it is calibrated in newtons.
fn newtons_per_count(session: &Session, arguments: &CalibrationArguments) -> miette::Result<Option<Matrix2<f64>>> {
    let calibration = arguments.load(session)?;
    Ok(calibration.filter(|known| known.unit() == ForceUnit::Newton).map(|known| *known.inverse()))
}

fn observe(
    session: &mut Session,
    seconds: f64,
    newtons_per_count: Option<Matrix2<f64>>,
) -> miette::Result<(ObservedAtRest, Latency)> {
    live::start(session).advised()?;
    session.ping().advised()?;
    let before = session.counts();
    let mut latency = Latency::default();
    let mut rest = RestSamples::new(seconds);
    live::stream(session, |session, incoming| {
        recording::taken(session, incoming, &[]);
        let Incoming::Samples(samples) = incoming else {
            super::tell(incoming);
            return true;
        };
        latency.take(session, samples, Instant::now());
        !rest.take(samples)
    })
    .advised()?;
    session.stop().advised()?;
    let after = session.counts();
    let (counts, saturated) = rest.into_counts();
    let hello = session.hello();
    let oversampling = oversampling(hello.rate_hz);
    let observation = ObservedAtRest {
        counts,
        saturated,
        rate_hz: f64::from(hello.rate_hz),
        clock_ratio: session.clock().filter(|_| seconds >= 5.0).map(|clock| 1.0 / (1.0 + clock.drift)),
        arrival_spread_s: latency.spread_s(),
        missing: after.missing - before.missing,
        damaged_frames: after.damaged_frames - before.damaged_frames,
        front_end: live::front_end(hello).advised()?,
        converter_noise_v: f64::from(noise_rms(hello.gain, oversampling)),
        newtons_per_count,
    };
    Ok((observation, latency))
}

/// The oversampling ratio that gives a rate: the power of two that is nearest, since the converter's clock may be
/// somewhat other than nominal.
fn oversampling(rate_hz: u32) -> u32 {
    let at_nominal = CLKIN_HZ / 2 / rate_hz.max(1);
    // Nearest as a ratio, to the half of a power: 1048 is 1024, as at 8 MHz.
    let half_power_up = at_nominal.saturating_mul(17) / 12;
    1 << half_power_up.max(1).ilog2()
}

fn print_finding(finding: &Finding) {
    let verdict = match finding.verdict {
        Verdict::Good => "ok   ",
        Verdict::Look => "LOOK ",
        Verdict::Fault => "FAULT",
    };
    let margin = " ".repeat("subject LOOK  ".len());
    let figures = folded(&format!("{margin}{}", finding.figures));
    say!("{:<7} {verdict} {}", finding.subject, figures.trim_start());
    if let Some(cause) = finding.cause {
        say!("{}", folded(&format!("{margin}-> {}", remedy(cause))));
    }
}

fn as_json(session: &Session, figures: &Figures, findings: &[Finding]) -> String {
    let findings: Vec<_> = findings
        .iter()
        .map(|finding| {
            serde_json::json!({
                "subject": finding.subject,
                "verdict": match finding.verdict {
                    Verdict::Good => "ok",
                    Verdict::Look => "look",
                    Verdict::Fault => "fault",
                },
                "figures": finding.figures,
                "remedy": finding.cause.map_or("", remedy),
            })
        })
        .collect();
    let pair = |pair: nalgebra::Vector2<f64>| [pair.x, pair.y];
    serde_json::json!({
        "simulated": session.is_simulated(),
        "noise_microstrain": pair(figures.noise_microstrain),
        "noise_20ms_microstrain": pair(figures.averaged_noise_microstrain),
        "noise_newtons": figures.noise_newtons.map(pair),
        "hum_hz": figures.hum_hz,
        "hum_microstrain_peak_to_peak": pair(figures.hum_microstrain),
        "drift_microstrain_per_min": pair(figures.drift_microstrain_per_min),
        "drift_sd_microstrain_per_min": pair(figures.drift_sd),
        "longest_equal_run": figures.longest_run,
        "findings": findings,
    })
    .to_string()
}

#[cfg(test)]
mod tests {
    use super::oversampling;

    #[test]
    fn a_converter_on_a_clock_of_8_mhz_has_the_same_ratios() {
        for (rate_hz, ratio) in [(8000, 512), (7813, 512), (4000, 1024), (3906, 1024), (500, 8192), (488, 8192)] {
            assert_eq!(oversampling(rate_hz), ratio, "{rate_hz} Hz");
        }
    }
}
