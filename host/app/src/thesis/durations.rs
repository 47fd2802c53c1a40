//! How long the tables take with their own numbers of cases.
//!
//! Measured with `palpate tables NAME`, optimised, on one core of a server of 2023 (x86-64 with AVX2), a few cases of each and scaled
//! to all where all take hours: good to a factor of two, elsewhere too. On several processors it is so much less.
//!
//! Units: s of one processor. Errors: none; a table that is not named here was not measured.

/// Tables by name.
const PROCESSOR_S: &[(&str, f64)] = &[
    ("2.1", 0.3),
    ("2.2", 0.3),
    ("2.3", 0.2),
    ("A", 0.3),
    ("2-noise", 7.0),
    ("touches", 5.0),
    ("touch", 260.0),
    ("touched-parts", 1850.0),
    ("explore", 170.0),
    ("3.1", 57.0),
    ("3.2", 28.0),
    ("6", 0.1),
    ("6.1", 3.0),
    ("6.2", 9.0),
    ("8.2.2", 74.0),
    ("basin", 0.3),
    // By its first 44 rows, 1200 s, of which those of elliptic parts took nearly all.
    ("finger-shapes", 3600.0),
    ("6.3", 3.0),
    ("6.3-friction", 20.0),
    ("pose", 130.0),
    ("pose-friction", 290.0),
    ("force", 92.0),
    ("model-error-angles", 130.0),
    ("magnitude", 63.0),
    ("drawn-pushes", 170.0),
    ("invariances", 280.0),
    ("drawn-rest", 130.0),
    ("drawn-forces", 1600.0),
    ("model-error", 7500.0),
    ("chain", 2400.0),
    ("chain-worlds", 900.0),
    // One case of each row was broken off at 66 s: 20 000 s at least.
    ("chain-masses", 30_000.0),
    ("chain-curved", 280.0),
    ("plan", 170.0),
    ("plan-chain", 820.0),
    ("parts", 600.0),
    ("parts-chain", 5800.0),
    ("pushed-parts", 9_500.0),
    ("7", 96.0),
    ("7-axes", 36.0),
    ("7-which", 91.0),
    ("7-gho", 12.0),
    ("observability", 160.0),
    ("observability-exceptions", 25.0),
    ("7-observability", 70.0),
    ("drawn-rolls", 35.0),
];

/// How long the table of this name takes.
pub(super) fn processor_s(name: &str) -> Option<f64> {
    PROCESSOR_S.iter().find(|(known, _)| *known == name).map(|(_, seconds)| *seconds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::thesis::EXPERIMENTS;

    #[test]
    fn every_table_was_measured_and_none_else() {
        let mut measured: Vec<_> = PROCESSOR_S.iter().map(|(name, _)| *name).collect();
        let mut there: Vec<_> = EXPERIMENTS.iter().map(|experiment| experiment.name).collect();
        measured.sort_unstable();
        there.sort_unstable();
        assert_eq!(measured, there);
    }
}
