//! What is what in a recording of others: which column, or field of a message, is the time, the force, the place.
//!
//! Written as people write it: `t=stamp[ms],fx=-Fz,fy=#3`. Keys are `t`, `fx`, `fy` of forces and `path_t`, `x`, `y` of places; a value
//! is a column's name or, behind `#`, its number from 1, with a sign before it and a unit in brackets behind it.
//!
//! Errors: [`MappingError`], with the entry that is to blame.

/// What is what.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mapping {
    /// Where values come from, by their [`KEYS`]; others are found by their usual names.
    pub sources: Vec<(&'static str, Source)>,
    /// Whether numbers have a comma before their fraction; fields are then separated by anything else.
    pub decimal_comma: bool,
    /// Topics of the messages in MCAP files.
    pub topics: Vec<String>,
}

/// Where a value comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// The column.
    pub place: Place,
    /// Whether its sign is changed.
    pub is_negative: bool,
    /// Its unit, lower case, where that is told.
    pub unit: Option<String>,
}

/// A column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// By its name in the header.
    Name(String),
    /// By its number, from 1.
    Number(usize),
}

/// What can be told.
pub const KEYS: [&str; 6] = ["t", "fx", "fy", "path_t", "x", "y"];

/// Why a mapping is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MappingError {
    /// An entry without a key or a value.
    #[error("`{0}` is not KEY=COLUMN, such as fx=Fx[mN] or fy=-#3")]
    Entry(String),
    /// A key that there is not.
    #[error("`{0}` is none of t, fx, fy (forces), path_t, x, y (places)")]
    Key(String),
    /// A key twice.
    #[error("`{0}` is told twice")]
    Twice(String),
}

impl Mapping {
    /// Reads a mapping.
    ///
    /// # Errors
    /// [`MappingError`].
    pub fn parse(text: &str) -> Result<Self, MappingError> {
        let mut mapping = Self::default();
        for entry in text.split(',') {
            let bad = || MappingError::Entry(entry.trim().to_owned());
            let (key, value) = entry.split_once('=').ok_or_else(bad)?;
            let known = KEYS.into_iter().find(|known| known.eq_ignore_ascii_case(key.trim()));
            let key = known.ok_or_else(|| MappingError::Key(key.trim().to_owned()))?;
            if mapping.source(key).is_some() {
                return Err(MappingError::Twice(key.to_owned()));
            }
            mapping.sources.push((key, source(value.trim()).ok_or_else(bad)?));
        }
        Ok(mapping)
    }

    /// Where this value comes from, if that was told.
    #[must_use]
    pub fn source(&self, key: &str) -> Option<&Source> {
        self.sources.iter().find(|(known, _)| *known == key).map(|(_, source)| source)
    }
}

fn source(text: &str) -> Option<Source> {
    let (text, unit) = match text.strip_suffix(']') {
        Some(rest) => {
            let (name, unit) = rest.rsplit_once('[')?;
            (name.trim(), Some(unit.trim().to_lowercase()))
        }
        // A bracket that is not closed was to be a unit.
        None if text.matches('[').count() > text.matches(']').count() => return None,
        None => (text, None),
    };
    let (text, is_negative) = text.strip_prefix('-').map_or((text, false), |rest| (rest.trim(), true));
    let place = match text.strip_prefix('#') {
        Some(number) => Place::Number(number.parse().ok().filter(|&number| number > 0)?),
        None if text.is_empty() => return None,
        None => Place::Name(text.to_owned()),
    };
    Some(Source { place, is_negative, unit })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_have_a_place_a_sign_and_a_unit() {
        let mapping = Mapping::parse("t=stamp [ms], FX=-Force X,fy=#3").unwrap();
        let name = |name: &str| Place::Name(name.to_owned());
        let source =
            |place, is_negative, unit: Option<&str>| Source { place, is_negative, unit: unit.map(str::to_owned) };
        assert_eq!(mapping.source("t"), Some(&source(name("stamp"), false, Some("ms"))));
        assert_eq!(mapping.source("fx"), Some(&source(name("Force X"), true, None)));
        assert_eq!(mapping.source("fy"), Some(&source(Place::Number(3), false, None)));
        assert_eq!(mapping.source("x"), None);
    }

    #[test]
    fn what_is_no_mapping_is_named() {
        for text in ["", "fx", "fx=", "fx=-", "fx=#0", "fx=#a", "fx=a[", "t=a,"] {
            assert!(matches!(Mapping::parse(text), Err(MappingError::Entry(_) | MappingError::Key(_))), "{text}");
        }
        assert_eq!(
            Mapping::parse("fz=a").unwrap_err().to_string(),
            "`fz` is none of t, fx, fy (forces), path_t, x, y (places)"
        );
        assert_eq!(Mapping::parse("x=a,x=b"), Err(MappingError::Twice("x".to_owned())));
    }
}
