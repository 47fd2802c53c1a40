//! The whole simulated device: finger, bridges and chip, one conversion at a time.
//!
//! [`SimulatedFrontEnd::step`] lets one conversion period pass: the load's force is taken at the period's end and
//! held over it, the beam moves, the bridges give their mean voltages, the chip converts. The host side of the chip
//! is reached through `port`.
//!
//! Units: SI, nanoseconds for simulated time. Errors: none; what goes wrong is simulated (see [`Faults`]).

use super::ads131m::{Behaviour, Channels, Chip, RESET_PULSE_NS};
use super::beam::{Beam, BeamConfig};
use super::bridge::{Bridges, BridgesConfig};
use super::carried::{Carriage, CarriedBeam};
use super::load::{Load, Loading, RAMP_US, Script};
use super::noise::{Source, Stream, minus_ln_of_rest};
use super::thermal::{Thermal, ThermalConfig};
use crate::front_ends::SlowCircuit;

/// What a saturated channel sees, in volts: past full scale at every gain.
const SATURATING_V: f32 = 2.4;

/// Conversions between two looks at the temperature, less one: it moves by 0.2 mK a second at most.
const THERMAL_EVERY: u32 = 0xFF;

/// What channels 2 and 3 are wired to.
const SLOW: SlowCircuit = crate::front_ends::SLOW_CIRCUIT;

/// Everything that describes a simulated finger. The default is the project's default finger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerConfig {
    /// Beam and disk of the finger.
    pub beam: BeamConfig,
    /// Bridges, their errors, and the hum.
    pub bridges: BridgesConfig,
    /// How the temperature goes.
    pub thermal: ThermalConfig,
    /// The converter's noise as a multiple of the datasheet's; 0 is none.
    pub converter_noise: f32,
    /// How many channels the converter has. Four: the ADS131M04, with excitation and NTC on channels 2 and 3.
    pub channels: Channels,
    /// What the converter does where its datasheet is silent.
    pub converter: Behaviour,
    /// Time for one load to give way to the next, in microseconds.
    pub ramp_us: u32,
}

impl Default for FingerConfig {
    fn default() -> Self {
        Self {
            beam: BeamConfig::default(),
            bridges: BridgesConfig::default(),
            thermal: ThermalConfig::default(),
            converter_noise: 1.0,
            channels: Channels::default(),
            converter: Behaviour::default(),
            ramp_us: RAMP_US,
        }
    }
}

impl FingerConfig {
    /// The default beam with nothing wrong: no errors, hum, noise, drift, resonance or ramp.
    #[must_use]
    pub fn ideal() -> Self {
        Self {
            beam: BeamConfig { resonance: false, ..BeamConfig::default() },
            bridges: BridgesConfig::ideal(),
            thermal: ThermalConfig { swing_k: 0.0, ..ThermalConfig::default() },
            converter_noise: 0.0,
            channels: Channels::default(),
            converter: Behaviour::default(),
            ramp_us: 0,
        }
    }
}

/// What a bus without a chip reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FloatingBus {
    /// All ones: a pull-up.
    High,
    /// All zeros: a pull-down, or a short.
    Low,
}

impl FloatingBus {
    /// The byte that is read.
    #[must_use]
    pub const fn byte(self) -> u8 {
        match self {
            Self::High => 0xFF,
            Self::Low => 0x00,
        }
    }
}

/// What is broken. Each can be switched at any time; the default is nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// No chip answers, DRDY stays high, and the bus reads this. When it comes back it has been powered up anew.
    pub chip_absent: Option<FloatingBus>,
    /// Probability that a bit on the bus is inverted, in either direction, 0 to 1.
    pub bit_error_rate: f32,
    /// DRDY stays high although the chip converts.
    pub data_ready_stuck: bool,
    /// The converter's clock stands still: its bus answers, and nothing is converted.
    pub clock_stopped: bool,
    /// Change of the excitation as a ratio: −0.01 lowers it by 1 %, and all voltages of bridges and NTC with it.
    pub excitation_change: f32,
    /// Bridges with a broken gauge: they sit at their rail and are noisy.
    pub open_gauge: [bool; 2],
    /// Channels driven past full scale.
    pub saturated: [bool; 2],
    /// Every conversion repeats the last codes.
    pub stuck_codes: bool,
    /// Offset that both bridges gain in a second, as strain: a gauge whose glue gives way. What was gained stays until
    /// this is 0 again.
    pub drift_per_s: f32,
    /// Hum on both bridges beside the finger's own, from peak to peak, as strain.
    pub hum_peak_to_peak: f32,
}

/// The state of the simulated world: where expected values come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Simulated time, in nanoseconds.
    pub time_ns: u64,
    /// Force on the disk over the last conversion period, in newtons, finger frame.
    pub force_finger: [f32; 2],
    /// Angle of the contact, in radians, where the load is a contact.
    pub contact_angle: Option<f32>,
    /// Whether the load has come up in full. The beam rings on: by 1/e in 43 ms with the default finger.
    pub is_ramp_over: bool,
    /// Strain of both bridges under that force at rest, without offset, drift and hum, those of faults neither.
    pub strain: [f32; 2],
    /// Temperature, in degrees Celsius.
    pub temperature_c: f32,
}

/// Bit errors on the bus: the number of good bits before the next bad one is drawn, not every bit.
#[derive(Clone, Debug, PartialEq)]
struct BitErrors {
    stream: Stream,
    rate: f32,
    good_bits: u32,
}

impl BitErrors {
    /// A bus without errors.
    fn new(seed: u64) -> Self {
        Self { stream: Stream::new(seed, Source::Bus), rate: 0.0, good_bits: u32::MAX }
    }

    /// Sets the probability of an error.
    fn set_rate(&mut self, rate: f32) {
        if self.rate.to_bits() != rate.to_bits() {
            self.rate = rate;
            self.good_bits = self.draw();
        }
    }

    /// Good bits before the next bad one: geometrically distributed.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative; large ones saturate")]
    fn draw(&mut self) -> u32 {
        match self.rate {
            rate if rate > 0.0 && rate < 1.0 => (self.stream.exponential() / minus_ln_of_rest(rate)) as u32,
            rate if rate >= 1.0 => 0,
            _ => u32::MAX,
        }
    }

    /// A byte after its way over the bus.
    fn pass(&mut self, byte: u8) -> u8 {
        let mut out = byte;
        let mut bit = 0;
        while self.good_bits < 8 - bit {
            bit += self.good_bits;
            out ^= 0x80 >> bit;
            bit += 1;
            self.good_bits = self.draw();
            if bit == 8 {
                return out;
            }
        }
        if self.rate > 0.0 {
            self.good_bits -= 8 - bit;
        }
        out
    }
}

/// Level of the SYNC/RESET pin, which is low-active.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SyncPin {
    High,
    LowSince { time_ns: u64 },
}

/// Finger, bridges and chip.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedFrontEnd {
    beam: Beam,
    bridges: Bridges,
    thermal: Thermal,
    loading: Loading,
    chip: Chip,
    faults: Faults,
    bit_errors: BitErrors,
    channels: Channels,
    /// Excitation without faults, in volts.
    excitation_v: f32,
    /// Voltage on channel 3 as part of the excitation, by the NTC at the present temperature.
    ntc_part: f32,
    /// Levels of the board's digital inputs.
    inputs: u8,
    /// Offset that the bridges have gained by a fault, as strain.
    drifted: f32,
    sync_pin: SyncPin,
    time_ns: u64,
    conversions: u32,
    period_ns: u32,
    force_finger: [f32; 2],
    temperature_c: f32,
}

impl SimulatedFrontEnd {
    /// A released finger and a chip just powered up. The same seed gives the same bytes.
    #[must_use]
    pub fn new(config: FingerConfig, seed: u64) -> Self {
        let mut chip = Chip::with(config.channels, seed);
        chip.set_noise_factor(config.converter_noise);
        chip.set_behaviour(config.converter);
        let period_ns = chip.period_ns();
        let thermal = Thermal::new(config.thermal, seed);
        Self {
            beam: Beam::new(config.beam, seconds(period_ns)),
            bridges: Bridges::new(config.bridges, config.beam.strain_per_newton(), period_ns, seed),
            loading: Loading::new(config.ramp_us),
            chip,
            faults: Faults::default(),
            bit_errors: BitErrors::new(seed),
            channels: config.channels,
            excitation_v: config.bridges.excitation_v,
            ntc_part: ntc_part(thermal.at(0)),
            inputs: 0,
            drifted: 0.0,
            sync_pin: SyncPin::High,
            time_ns: 0,
            conversions: 0,
            period_ns,
            force_finger: [0.0; 2],
            temperature_c: thermal.at(0),
            thermal,
        }
    }

    /// Replaces the load from now on, and drops the rest of any script.
    pub fn set_load(&mut self, load: Load) {
        self.loading.set_load(load, self.time_us());
    }

    /// Starts a script; its times count from now.
    pub fn set_script(&mut self, script: Script) {
        self.loading.set_script(script, self.time_us());
    }

    /// Gives the converter another clock than its nominal one, in hertz.
    pub fn set_clock_hz(&mut self, hz: u32) {
        self.chip.set_clock_hz(hz);
    }

    /// Sets the levels of the board's eight digital inputs, a bit for each.
    pub fn set_inputs(&mut self, levels: u8) {
        self.inputs = levels;
    }

    /// The levels of the board's digital inputs.
    #[must_use]
    pub fn inputs(&self) -> u8 {
        self.inputs
    }

    /// What is broken from now on.
    pub fn set_faults(&mut self, faults: Faults) {
        if self.faults.chip_absent.is_some() && faults.chip_absent.is_none() {
            self.chip.reset_pulse();
        }
        self.faults = faults;
        self.bit_errors.set_rate(faults.bit_error_rate);
        self.chip.set_stuck(faults.stuck_codes);
        self.bridges.set_foreign_hum(faults.hum_peak_to_peak, self.period_ns);
        if faults.drift_per_s.abs() <= 0.0 {
            self.drifted = 0.0;
        }
    }

    /// What is broken at present.
    #[must_use]
    pub fn faults(&self) -> Faults {
        self.faults
    }

    /// Lets one conversion period pass. Returns whether DRDY fell, which on a board is the interrupt.
    pub fn step(&mut self) -> bool {
        self.begin_period();
        self.force_finger = self.loading.advance_to(self.time_us());
        let elastic = self.beam.step(self.force_finger);
        self.convert(elastic)
    }

    /// The same of a finger that is carried about: `carriage` says what acts at a simulated time, in nanoseconds. The
    /// force that it gives acts beside the load.
    pub fn step_carried(&mut self, finger: &mut CarriedBeam, mut carriage: impl FnMut(u64) -> Carriage) -> bool {
        self.begin_period();
        let (began_ns, loading) = (self.time_ns - u64::from(self.period_ns), &mut self.loading);
        let mut force = self.force_finger;
        let felt = finger.advance(self.period_ns, |after_ns| {
            let now_ns = began_ns + u64::from(after_ns);
            let (load, acts) = (loading.advance_to(now_ns / 1000), carriage(now_ns));
            force = core::array::from_fn(|i| load[i] + acts.force[i]);
            Carriage { force, ..acts }
        });
        self.force_finger = force;
        self.convert(felt)
    }

    /// Time goes on by a period.
    #[inline(always)]
    fn begin_period(&mut self) {
        self.follow_rate();
        self.time_ns += u64::from(self.period_ns);
        self.follow_temperature();
    }

    /// The chip's next conversion, of what the gauges felt on average.
    #[inline(always)]
    fn convert(&mut self, elastic: [f32; 2]) -> bool {
        self.drifted += self.faults.drift_per_s * seconds(self.period_ns);
        let volts = self.bridges.step(elastic, self.thermal.above_reference(self.temperature_c), self.drifted);
        let volts = self.break_inputs(volts.map(|v| v * (1.0 + self.faults.excitation_change)));
        if self.faults.clock_stopped {
            return false;
        }
        let fell = match self.channels {
            Channels::Two => self.chip.convert(volts),
            Channels::Four => {
                let [excitation_v, ntc_v] = self.slow_volts();
                let [x, y] = volts;
                self.chip.convert([x, y, excitation_v, ntc_v])
            }
        };
        fell && self.is_data_ready_wired()
    }

    /// Whether DRDY is low.
    #[must_use]
    pub fn is_data_ready(&self) -> bool {
        self.chip.is_data_ready() && self.is_data_ready_wired()
    }

    /// Time of one conversion at the present rate, in nanoseconds.
    #[must_use]
    pub fn period_ns(&self) -> u32 {
        self.chip.period_ns()
    }

    /// The chip, for a look at its registers.
    #[must_use]
    pub fn chip(&self) -> &Chip {
        &self.chip
    }

    /// The state of the world.
    #[must_use]
    pub fn truth(&self) -> Truth {
        let now_us = self.time_us();
        Truth {
            time_ns: self.time_ns,
            force_finger: self.force_finger,
            contact_angle: self.loading.contact_at(now_us).map(|contact| contact.angle),
            is_ramp_over: self.loading.is_ramp_over(now_us),
            strain: self.bridges.strain(self.force_finger),
            temperature_c: self.temperature_c,
        }
    }

    /// Drives SYNC/RESET. A low time below 250 µs of simulated time synchronises, a longer one resets.
    pub fn set_sync_reset(&mut self, high: bool) {
        match (self.sync_pin, high) {
            (SyncPin::High, false) => self.sync_pin = SyncPin::LowSince { time_ns: self.time_ns },
            (SyncPin::LowSince { time_ns }, true) => {
                self.sync_pin = SyncPin::High;
                if self.time_ns - time_ns < RESET_PULSE_NS { self.chip.sync_pulse() } else { self.chip.reset_pulse() }
            }
            _ => {}
        }
    }

    /// Chip select falls: a frame begins.
    pub(super) fn select(&mut self) {
        self.chip.select();
    }

    /// Eight clocks on the bus.
    pub(super) fn exchange(&mut self, byte: u8) -> u8 {
        if let Some(floating) = self.faults.chip_absent {
            return floating.byte();
        }
        let received = self.bit_errors.pass(byte);
        let sent = self.chip.exchange(received);
        self.bit_errors.pass(sent)
    }

    /// Chip select rises: the frame ends.
    pub(super) fn deselect(&mut self) {
        self.chip.deselect();
    }

    /// Time passes on the bus, in nanoseconds; the world stands still.
    pub(super) fn wait(&mut self, duration_ns: u32) {
        self.chip.wait(duration_ns);
    }

    /// Simulated time in microseconds.
    fn time_us(&self) -> u64 {
        self.time_ns / 1000
    }

    /// Whether DRDY's level reaches the host.
    fn is_data_ready_wired(&self) -> bool {
        self.faults.chip_absent.is_none() && !self.faults.data_ready_stuck
    }

    /// Adopts the conversion period that the chip was set to.
    fn follow_rate(&mut self) {
        if self.period_ns != self.chip.period_ns() {
            self.period_ns = self.chip.period_ns();
            self.beam.set_step(seconds(self.period_ns));
            self.bridges.set_step(self.period_ns);
        }
    }

    /// Looks at the temperature now and then.
    fn follow_temperature(&mut self) {
        if self.conversions & THERMAL_EVERY == 0 {
            self.temperature_c = self.thermal.at(self.time_ns);
            if self.channels == Channels::Four {
                self.ntc_part = ntc_part(self.temperature_c);
            }
        }
        self.conversions = self.conversions.wrapping_add(1);
    }

    /// What channels 2 and 3 have: parts of the excitation.
    fn slow_volts(&self) -> [f32; 2] {
        let excitation_v = self.excitation_v * (1.0 + self.faults.excitation_change);
        [SLOW.excitation_part, self.ntc_part].map(|part| part * excitation_v)
    }

    /// What the chip's pins have, given what sound bridges would have.
    fn break_inputs(&mut self, volts: [f32; 2]) -> [f32; 2] {
        if self.faults.saturated == [false; 2] && self.faults.open_gauge == [false; 2] {
            return volts;
        }
        let open = self.bridges.open_gauge_volts();
        core::array::from_fn(|i| match (self.faults.saturated[i], self.faults.open_gauge[i]) {
            (true, _) => SATURATING_V,
            (false, true) => open[i],
            (false, false) => volts[i],
        })
    }
}

/// Part of the excitation that an NTC of 10 kΩ (B = 3950 K) below 39 kΩ leaves at a temperature in °C, by the B equation.
fn ntc_part(temperature_c: f32) -> f32 {
    let ohm = SLOW.ntc_ohm * libm::expf(SLOW.ntc_b_k * (1.0 / (temperature_c + 273.15) - 1.0 / 298.15));
    ohm / (ohm + SLOW.series_ohm)
}

/// Nanoseconds as seconds, s.
fn seconds(ns: u32) -> f32 {
    ns as f32 * 1e-9
}

#[cfg(test)]
mod tests;
