//! The simulated finger, from a force on its disk to bytes on its SPI bus.
//!
//! ```text
//! load ──force on the disk──▶ beam ──elastic force──▶ bridge ──volts──▶ ads131m ──bytes──▶ port (SpiDevice, pins)
//!                                     temperature ──▶   ▲ hum             ▲ noise
//! └──────────────────────────── front_end: one conversion period per step, faults ────────────────────────────┘
//! ```
//!
//! The clamp of a finger that a host simulates is carried about: `carried` stands in the beam's place and takes its
//! acceleration too ([`SimulatedFrontEnd::step_carried`]). `thermal` is the temperature, `noise` the random numbers, `trig` sine and cosine without a library.
//!
//! The firmware's own driver runs against [`SpiPort`] as it runs against the real bus; tests take what they expect
//! from [`SimulatedFrontEnd::truth`], never from the code under test.
//!
//! Modelled: bending strain, the inertia and weight of beam and disk, and their resonance; misaligned gauges, cross-talk, unequal gains, offsets, drift of
//! both with a slow temperature; mains hum; the converter's noise (spectrum included), filter, clipping, registers,
//! frames, CRC, DRDY and its two-deep memory; faults on demand. Not modelled: torsion and axial force, gauge creep and
//! hysteresis, noise of the excitation, distortion, aliasing, the chip's start-up, and its bus timing
//! but for the pause after a reset.
//!
//! Arithmetic is `f32` throughout, time is counted in integers, nothing is allocated: the same code runs on a
//! Cortex-M4F and for hours. The same seed gives the same bytes; each source of noise has its own stream, so that
//! switching one off leaves the others as they were.
//!
//! Frame: finger. Units: SI inside, strain as a plain ratio. Errors: per module.
//!
//! ```
//! use palpate_shared::sim::{ContactLoad, FingerConfig, Load, SimulatedFrontEnd};
//! let mut front_end = SimulatedFrontEnd::new(FingerConfig::default(), 1);
//! front_end.set_load(Load::Static(ContactLoad::frictionless(0.0, 2.0))); // 2 N from the +x side
//! for _ in 0..4000 {
//!     front_end.step(); // one second at 4 kSPS
//! }
//! let microstrain = front_end.truth().strain[0] * 1e6;
//! assert!((microstrain + 98.3).abs() < 0.1); // −95.5, 3 % gain error, a little cross-talk
//! ```

pub mod ads131m;
mod beam;
mod bridge;
mod carried;
mod front_end;
mod load;
mod noise;
mod port;
mod thermal;
mod trig;

pub use ads131m::{Behaviour, Channels, ResetMoment, StatusLatch};
pub use beam::BeamConfig;
pub use bridge::{BridgeConfig, BridgesConfig, MICROSTRAIN};
pub use carried::{Carriage, CarriedBeam, CarriedConfig, CarriedMasses};
pub use front_end::{Faults, FingerConfig, FloatingBus, SimulatedFrontEnd, Truth};
pub use load::{ContactLoad, Load, RAMP_US, STEPS_MAX, Script, ScriptError};
pub use port::{DataReadyPin, PortBusy, SpiPort, SyncResetPin};
pub use thermal::ThermalConfig;
