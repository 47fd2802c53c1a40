//! How a load is written by people: on the command line, in plans and in files, all alike.
//!
//! `2 N` or `2N`, `204 g`, `0.204 kg` (hung, so its weight at standard gravity), `same`, `unknown`.

use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use thiserror::Error;

use super::measurements::Load;
use crate::gravity::GRAVITY_STANDARD;

/// A load that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error(
    "the load \"{0}\" is neither a weight above zero with its unit, such as \"2 N\" or \"204 g\", nor \"same\" nor \"unknown\""
)]
pub struct LoadTextError(String);

impl FromStr for Load {
    type Err = LoadTextError;

    fn from_str(text: &str) -> Result<Self, LoadTextError> {
        let trimmed = text.trim();
        match trimmed {
            "same" => return Ok(Self::Same),
            "unknown" => return Ok(Self::Unknown),
            _ => {}
        }
        let units = [("kg", GRAVITY_STANDARD), ("g", GRAVITY_STANDARD * 1e-3), ("N", 1.0)];
        let newtons = units
            .into_iter()
            .find_map(|(unit, newtons)| Some(trimmed.strip_suffix(unit)?.trim().parse::<f64>().ok()? * newtons));
        newtons
            .filter(|newtons| newtons.is_finite() && *newtons > 0.0)
            .map(Self::Newtons)
            .ok_or_else(|| LoadTextError(text.to_owned()))
    }
}

impl std::fmt::Display for Load {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unknown => f.write_str("unknown"),
            Self::Same => f.write_str("same"),
            // The shortest decimal that reads back to the same number.
            Self::Newtons(newtons) => write!(f, "{newtons} N"),
        }
    }
}

impl Serialize for Load {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Load {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn weights_are_read_as_newtons() {
        assert_eq!("2 N".parse(), Ok(Load::Newtons(2.0)));
        assert_eq!("2N".parse(), Ok(Load::Newtons(2.0)));
        assert_eq!("same".parse(), Ok(Load::Same));
        let Ok(Load::Newtons(newtons)) = "204 g".parse() else { panic!() };
        assert!((newtons - 2.000_556_6).abs() < 1e-9, "got {newtons} N");
        assert_eq!("0.5 kg".parse::<Load>(), Ok(Load::Newtons(0.5 * GRAVITY_STANDARD)));
    }

    #[test]
    fn what_is_no_load_is_refused() {
        for text in ["", "2", "N", "-2 N", "0 N", "inf N", "nan g", "2 lb", "Same"] {
            assert!(text.parse::<Load>().is_err(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn a_load_reads_back_exactly(newtons in 1e-6..1e6) {
            prop_assert_eq!(Load::Newtons(newtons).to_string().parse(), Ok(Load::Newtons(newtons)));
        }
    }
}
