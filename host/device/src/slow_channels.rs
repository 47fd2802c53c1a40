//! What the slow channels of a front-end say: the excitation that the bridges have, and how warm the finger is.
//!
//! What a bridge gives is proportional to its excitation, so codes are divided by the measured one and multiplied by the
//! nominal one, which the calibration knows: they then mean strain whatever the excitation does. A mean of 256
//! conversions is 64 ms old at 4 kHz when it comes, and its own noise is 3e-7 of it.
//!
//! Units: V, °C, counts. Errors: none.

use palpate_shared::front_ends::FrontEndKind;
use palpate_shared::units::Counts;
use palpate_shared::wire::{Hello, SlowChannels};

/// An excitation further than this share from the nominal one is a fault, not a drift, and nothing is scaled by it.
const BELIEVED_SHARE: f64 = 0.2;

/// What was heard last.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SlowReadings {
    /// The last means, and which front-end gave them.
    last: Option<(FrontEndKind, SlowChannels)>,
    /// The nominal excitation by the measured one, once a credible one was measured.
    scale: Option<f64>,
}

impl SlowReadings {
    /// Takes what a device told.
    pub(crate) fn take(&mut self, hello: &Hello, slow: SlowChannels) {
        let kind = hello.front_end.kind;
        self.last = Some((kind, slow));
        let nominal_v = f64::from(hello.excitation_mv) * 1e-3;
        let scale = self.excitation_v().map(|volts| nominal_v / volts);
        let credible = scale.filter(|scale| (scale.recip() - 1.0).abs() <= BELIEVED_SHARE);
        if credible.is_none() {
            tracing::warn!("the excitation reads {:?} V instead of {nominal_v} V", self.excitation_v());
        }
        self.scale = Some(credible.unwrap_or(1.0));
    }

    /// The excitation, in V.
    pub(crate) fn excitation_v(&self) -> Option<f64> {
        self.last.and_then(|(kind, slow)| kind.facts().excitation_v(slow.excitation))
    }

    /// The NTC's temperature, in °C.
    pub(crate) fn ntc_c(&self) -> Option<f64> {
        let (kind, slow) = self.last?;
        let ohm = kind.facts().ntc_ohm([slow.excitation, slow.ntc])?;
        kind.facts().slow.map(|circuit| circuit.celsius_at_ln_ratio((ohm / f64::from(circuit.ntc_ohm)).ln()))
    }

    /// Whether this device measures its excitation and has not told yet.
    pub(crate) fn is_awaited(&self, hello: &Hello) -> bool {
        hello.front_end.kind.facts().slow.is_some() && self.scale.is_none()
    }

    /// A code as it would be at the nominal excitation. One at the end of the range stays there.
    pub(crate) fn at_nominal(&self, code: Counts) -> Counts {
        match self.scale {
            Some(scale) if !code.is_saturated() => {
                #[expect(clippy::cast_possible_truncation, reason = "a code of 24 bits times at most 1.25, clamped")]
                let scaled = (f64::from(code.0) * scale).round() as i32;
                Counts(scaled.clamp(Counts::MIN.0 + 1, Counts::MAX.0 - 1))
            }
            _ => code,
        }
    }
}
