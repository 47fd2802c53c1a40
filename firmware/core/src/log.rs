//! Log lines: `defmt`'s where that feature is on, nothing where it is off.
//!
//! Remember `DEFMT_LOG=info` when building: without it defmt compiles these lines out.

/// Expands to the `defmt` macro of the same name.
#[cfg(feature = "defmt")]
macro_rules! line {
    ($level:ident, $($rest:tt)*) => { ::defmt::$level!($($rest)*) };
}

/// Expands to nothing, but still uses the arguments.
#[cfg(not(feature = "defmt"))]
macro_rules! line {
    ($level:ident, $format:literal $(, $argument:expr)* $(,)?) => { { $(let _ = &$argument;)* } };
}

/// Something a person at the bench wants to see.
macro_rules! info {
    ($($rest:tt)*) => { $crate::log::line!(info, $($rest)*) };
}

/// Something went wrong and was dealt with.
macro_rules! warning {
    ($($rest:tt)*) => { $crate::log::line!(warn, $($rest)*) };
}

pub(crate) use {info, line, warning};
