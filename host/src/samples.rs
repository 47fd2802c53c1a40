//! What a finger's converter gives, before anybody says what it means.

/// Equal codes of a bridge in a row that no working converter gives: 5 ms at 4 kHz.
///
/// Noise of some 270 codes makes two neighbours equal once in a thousand, and even a noise of two codes makes twenty equal only
/// once in 10¹⁴ samples, which is eight hundred years. Until they are that many, a stuck converter passes for a contact at rest.
pub const STUCK_SAMPLES: usize = 20;
