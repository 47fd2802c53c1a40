//! Every figure of docs/HARDWARE.md again, from its formula: a page that somebody builds from has to add up.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use palpate_shared::front_ends::SLOW_CIRCUIT;
use palpate_shared::sim::BeamConfig;

/// Excitation, V.
const EXCITATION: f64 = 2.5;
/// A gauge, and a resistor of the completion, Ω.
const GAUGE: f64 = 350.0;
/// Young's modulus of steel, Pa.
const E: f64 = 200e9;
/// Converter's noise at 4 kHz and gain 32, V.
const NOISE: f64 = 1.2e-6;
/// Boltzmann's constant, J/K.
const BOLTZMANN: f64 = 1.380_649e-23;

/// The figures by their names on the page.
fn figures() -> BTreeMap<&'static str, f64> {
    let rod = BeamConfig::default();
    let (diameter, lever, length) =
        (f64::from(rod.diameter), f64::from(rod.gauge_to_contact), f64::from(rod.clamp_to_contact));
    let (side, round_moment) = (3.5e-3_f64, PI * diameter.powi(4) / 64.0);
    let square_moment = side.powi(4) / 12.0;
    let strain_at_2n = 2.0 * lever * (diameter / 2.0) / (E * round_moment);
    let volts_per_strain = EXCITATION * 2.0 / 2.0;
    let range = 1.2 / 32.0;
    let volts_per_newton = strain_at_2n * volts_per_strain / 2.0;
    let filter_ohm = 2.0 * 470.0;
    let cell = 1e-3 * EXCITATION / 9.81;
    let ntc_at_0 = 10_000.0 * (3950.0 * (1.0 / 273.15 - 1.0 / 298.15_f64)).exp();
    BTreeMap::from([
        ("current of four legs, mA", 4.0 * EXCITATION / (2.0 * GAUGE) * 1e3),
        ("current with 1 kΩ gauges and completion, mA", 4.0 * EXCITATION / 2000.0 * 1e3),
        (
            "current with one shared divider of 2 × 1 kΩ, mA",
            (2.0 * EXCITATION / (2.0 * GAUGE) + EXCITATION / 2000.0) * 1e3,
        ),
        ("power in a gauge, mW", (EXCITATION / (2.0 * GAUGE)).powi(2) * GAUGE * 1e3),
        ("least AVDD, V", EXCITATION / 2.0 + 1.8),
        ("range at gain 32, mV", range * 1e3),
        ("range at gain 32, microstrain", range / volts_per_strain * 1e6),
        ("bridge output for a microstrain, µV", volts_per_strain),
        ("converter's noise, microstrain", NOISE / volts_per_strain * 1e6),
        ("strain at 2 N, microstrain", strain_at_2n * 1e6),
        ("stress at 2 N, MPa", E * strain_at_2n * 1e-6),
        ("bridge output at 2 N, µV", 2.0 * volts_per_newton * 1e6),
        ("share of the range at 2 N, %", 2.0 * volts_per_newton / range * 100.0),
        ("bridge output of a newton, µV", volts_per_newton * 1e6),
        ("noise of a sample, mN", NOISE / volts_per_newton * 1e3),
        ("yielding of the tip, µm/N", length.powi(3) / (3.0 * E * round_moment) * 1e6),
        ("round of a 4 mm rod for each of four gauges, mm", PI * diameter / 4.0 * 1e3),
        ("second moment of the rod, mm⁴", round_moment * 1e12),
        ("second moment of a square bar of 3.5 mm, mm⁴", square_moment * 1e12),
        ("strain of the square bar at 2 N, microstrain", 2.0 * lever * (side / 2.0) / (E * square_moment) * 1e6),
        ("corner of the input filter, kHz", 1e-3 / (2.0 * PI * filter_ohm * 10e-9)),
        ("delay of the input filter, µs", filter_ohm * 10e-9 * 1e6),
        ("noise of its resistors, µV", (4.0 * BOLTZMANN * 296.0 * filter_ohm * 0.262 * 4000.0).sqrt() * 1e6),
        ("delay at 4 kHz, µs", 1.5 * 250.0),
        ("delay at 500 Hz, µs", 0.5 * 2000.0 + 250.0),
        ("bus time of a frame of 12 bytes, µs", 96.0 / 10.5),
        ("bus time of a frame of 18 bytes, µs", 144.0 / 10.5),
        ("output of a hobby cell for a newton, µV", cell * 1e6),
        ("noise of a sample with it, mN", NOISE / cell * 1e3),
        ("excitation's channel of the ADS131M04, V", EXCITATION * 10.0 / 25.0),
        ("NTC's channel at 25 °C, V", EXCITATION * SLOW_CIRCUIT.ntc_part(10_000.0)),
        ("NTC's channel at 0 °C, V", EXCITATION * SLOW_CIRCUIT.ntc_part(ntc_at_0)),
    ])
}

fn page() -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/HARDWARE.md");
    std::fs::read_to_string(path).expect("the page is in the tree")
}

/// The rows of the page's table: name and value as written.
fn rows(page: &str) -> Vec<(&str, &str)> {
    let (_, section) = page.split_once("\n## Figures\n").expect("a section of figures");
    let section = section.split("\n## ").next().unwrap_or_default();
    section
        .lines()
        .filter(|line| line.starts_with("| ") && !line.starts_with("| figure "))
        .map(|line| {
            let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
            let [name, _, value] = cells[..] else { panic!("a row of three cells: {line}") };
            (name, value)
        })
        .collect()
}

#[test]
fn every_figure_of_the_page_is_what_its_formula_gives() {
    let (page, figures) = (page(), figures());
    let rows = rows(&page);
    for (name, written) in &rows {
        let computed = figures.get(name).unwrap_or_else(|| panic!("no formula here for {name:?}"));
        let decimals = written.split_once('.').map_or(0, |(_, decimals)| decimals.len());
        let value: f64 = written.parse().expect("a number");
        let half = 0.5 * 10_f64.powi(-i32::try_from(decimals).expect("a few"));
        // A hair more, for what is rounded exactly at the half.
        assert!((value - computed).abs() <= half * (1.0 + 1e-6), "{name}: {written} on the page, {computed}");
    }
    assert_eq!(rows.len(), figures.len(), "each formula has its row");
}

#[test]
fn the_excitation_that_the_page_asks_for_drives_the_bridges_that_it_describes() {
    let page = page();
    let figures = figures();
    assert!(page.contains("**2.5 V, 30 mA or more**") && page.contains("draw 14.3 mA"));
    // Twice what they draw: a part near its limit drifts with its load.
    assert!(30.0 >= 2.0 * figures["current of four legs, mA"]);
    // What the named reference gives by its datasheet (SBOS410), and what it is named for.
    let reference_ma = 10.0;
    assert!(figures["current of four legs, mA"] > reference_ma);
    assert!(figures["current with 1 kΩ gauges and completion, mA"] < reference_ma);
    assert!(figures["current with one shared divider of 2 × 1 kΩ, mA"] < reference_ma);
    // The square bar is as stiff as the rod, and has room for a gauge.
    let ratio = figures["second moment of a square bar of 3.5 mm, mm⁴"] / figures["second moment of the rod, mm⁴"];
    assert!((ratio - 1.0).abs() < 0.005, "{ratio}");
}
