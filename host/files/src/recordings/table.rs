//! Any table of numbers by time, in columns that are known by name or by their order.
//!
//! Columns are separated by `;`, `,`, tab or blanks, whichever the first line of data or header has (in this order).
//! A header is optional: names in any case, with units in brackets (`Fx [N]`, `t (ms)`), columns that are not needed
//! are ignored. Without one the columns come in the order in which they are asked for. `#` starts a comment; blank lines,
//! CR LF and a byte-order mark are fine.
//!
//! A line that cannot be read, or whose time is not after that of the rows kept, is reported and skipped. Which
//! lines are out of order is decided over the whole file (the longest increasing run of times is kept), so that one
//! wrong time costs one line and not all that follow.
//!
//! Written by hand: a table of numbers needs no quoting rules, and the usual reader for this format knows neither
//! blanks as separators nor lines to skip.

use super::{ReadError, RecordingProblem, number, shorten};

/// A column that is asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column {
    /// Its name in messages.
    pub name: &'static str,
    /// Names by which it is known in a header, lower case.
    pub names: &'static [&'static str],
    /// What it measures.
    pub quantity: Quantity,
}

/// What a column measures: its units, and what one is in SI.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quantity {
    name: &'static str,
    units: &'static [(&'static str, f64)],
    known: &'static str,
}

impl Quantity {
    /// s.
    pub(crate) const TIME: Self = Self {
        name: "time",
        units: &[("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("ns", 1e-9)],
        known: "s, ms, us, ns",
    };
    /// N.
    pub(crate) const FORCE: Self =
        Self { name: "force", units: &[("n", 1.0), ("mn", 1e-3), ("kn", 1e3)], known: "N, mN, kN" };
    /// m.
    pub(crate) const LENGTH: Self = Self {
        name: "length",
        units: &[("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6), ("µm", 1e-6), ("in", 0.0254)],
        known: "m, cm, mm, um, in",
    };
    /// rad.
    pub(crate) const ANGLE: Self = Self {
        name: "angle",
        units: &[
            ("rad", 1.0),
            ("mrad", 1e-3),
            ("deg", std::f64::consts::PI / 180.0),
            ("°", std::f64::consts::PI / 180.0),
        ],
        known: "rad, mrad, deg",
    };
    /// m/s².
    pub(crate) const ACCELERATION: Self = Self {
        name: "acceleration",
        units: &[("m/s^2", 1.0), ("m/s²", 1.0), ("m/s2", 1.0), ("mm/s^2", 1e-3), ("mm/s²", 1e-3), ("g", 9.806_65)],
        known: "m/s^2, mm/s^2, g",
    };
}

/// The time of a row.
pub(crate) const TIME: Column =
    Column { name: "time (t)", names: &["t", "time", "time_s", "timestamp", "stamp"], quantity: Quantity::TIME };

/// What a table gave.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Table<const N: usize> {
    /// Rows in SI units where the header names units, the first column (time) increasing.
    pub rows: Vec<[f64; N]>,
    /// What was skipped, in the order of the file.
    pub problems: Vec<RecordingProblem>,
    /// Which columns the header gives a unit.
    pub has_unit: [bool; N],
}

/// Reads a table; the first column is the time.
///
/// # Errors
/// [`ReadError`] if not one row could be got.
pub(crate) fn parse<const N: usize>(text: &str, wanted: &[Column; N]) -> Result<Table<N>, ReadError> {
    let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, content(line))).filter(|(_, l)| !l.is_empty());
    let first = lines.clone().next().ok_or(ReadError::Empty)?;
    let separator = Separator::of(first.1);
    let columns = Columns::of(wanted, first.0, &separator.split(first.1))?;
    if columns.is_named {
        lines.next();
    }
    let (mut rows, mut problems) = (Vec::new(), Vec::new());
    for (line, content) in lines {
        match columns.row(&separator.split(content)) {
            Ok(row) => rows.push((line, row)),
            Err((column, message)) => problems.push(RecordingProblem { line, column, message }),
        }
    }
    let tried = rows.len() + problems.len();
    let rows = keep_increasing(rows, &mut problems);
    problems.sort_by_key(|problem| problem.line);
    match problems.first() {
        Some(first) if rows.is_empty() => Err(ReadError::AllBad { lines: tried, first: first.clone() }),
        None if rows.is_empty() => Err(ReadError::Empty),
        _ => Ok(Table { rows, problems, has_unit: columns.has_unit }),
    }
}

/// Whether a table has a column: by its header, or, without one, by having so many and that one.
pub(crate) fn offers(text: &str, column: &Column, place: usize) -> bool {
    let Some(first) = text.lines().map(content).find(|line| !line.is_empty()) else { return false };
    let fields = Separator::of(first).split(first);
    if fields.iter().any(|field| field.parse::<f64>().is_ok()) {
        return fields.len() == place + 1;
    }
    headings(&fields).iter().any(|(name, _)| column.names.contains(&name.as_str()))
}

/// A line without its comment.
fn content(line: &str) -> &str {
    line.split('#').next().unwrap_or_default().trim()
}

/// What stands between fields.
#[derive(Clone, Copy)]
enum Separator {
    Character(char),
    Blanks,
}

impl Separator {
    fn of(line: &str) -> Self {
        [';', ',', '\t'].into_iter().find(|&c| line.contains(c)).map_or(Self::Blanks, Self::Character)
    }

    fn split(self, line: &str) -> Vec<&str> {
        let bare = |field: &'_ str| field.trim().trim_matches('"').trim().len();
        match self {
            Self::Character(c) => line.split(c).map(|field| field.trim().trim_matches('"').trim()).collect(),
            Self::Blanks => line.split_whitespace().filter(|field| bare(field) > 0).collect(),
        }
    }
}

/// Where the values are in a line, and what to multiply them by.
struct Columns<const N: usize> {
    places: [usize; N],
    scales: [f64; N],
    has_unit: [bool; N],
    fields: usize,
    is_named: bool,
}

impl<const N: usize> Columns<N> {
    /// From the first line: a header unless a field of it is a number.
    fn of(wanted: &[Column; N], line: usize, fields: &[&str]) -> Result<Self, ReadError> {
        let (mut places, mut scales, mut has_unit) = (std::array::from_fn(|i| i), [1.0; N], [false; N]);
        if fields.iter().any(|field| field.parse::<f64>().is_ok()) {
            return Ok(Self { places, scales, has_unit, fields: N, is_named: false });
        }
        let headings = headings(fields);
        for (i, column) in wanted.iter().enumerate() {
            let place = headings.iter().position(|(name, _)| column.names.contains(&name.as_str()));
            let found = || headings.iter().map(|(name, _)| shorten(name)).collect::<Vec<_>>().join(", ");
            places[i] = place.ok_or_else(|| ReadError::NoColumn { line, column: column.name, found: found() })?;
            if let Some(unit) = &headings[places[i]].1 {
                scales[i] = column.quantity.scale(line, unit)?;
                has_unit[i] = true;
            }
        }
        Ok(Self { places, scales, has_unit, fields: headings.len(), is_named: true })
    }

    fn row(&self, fields: &[&str]) -> Result<[f64; N], (Option<usize>, String)> {
        if fields.len() != self.fields {
            let advice = if self.is_named { "" } else { "; more need a header that names them" };
            return Err((None, format!("{} fields, where {} are expected{advice}", fields.len(), self.fields)));
        }
        let mut values = [0.0; N];
        for (i, value) in values.iter_mut().enumerate() {
            let place = self.places[i];
            *value = number(fields[place]).map_err(|message| (Some(place + 1), message))? * self.scales[i];
        }
        Ok(values)
    }
}

impl Quantity {
    fn scale(&self, line: usize, unit: &str) -> Result<f64, ReadError> {
        let Self { name: quantity, units, known } = *self;
        let found = units.iter().find(|(name, _)| *name == unit);
        found.map(|(_, scale)| *scale).ok_or_else(|| ReadError::UnknownUnit {
            line,
            unit: shorten(unit),
            quantity,
            known,
        })
    }
}

/// Name (lower case) and unit of each column. Where blanks separate, a unit in brackets is a field of its own.
fn headings(fields: &[&str]) -> Vec<(String, Option<String>)> {
    let mut headings: Vec<(String, Option<String>)> = Vec::new();
    for field in fields {
        let (name, unit) = match field.find(['[', '(']) {
            Some(open) => (field[..open].trim(), Some(field[open + 1..].trim_end_matches([']', ')']).trim())),
            None => (*field, None),
        };
        let unit = unit.map(str::to_lowercase);
        match headings.last_mut() {
            Some(last) if name.is_empty() => last.1 = unit,
            _ => headings.push((name.to_lowercase(), unit)),
        }
    }
    headings
}

/// Keeps the longest run of rows whose times increase; reports the others.
fn keep_increasing<const N: usize>(
    rows: Vec<(usize, [f64; N])>,
    problems: &mut Vec<RecordingProblem>,
) -> Vec<[f64; N]> {
    let kept = longest_increasing(&rows.iter().map(|(_, row)| row[0]).collect::<Vec<_>>());
    let mut readings = Vec::with_capacity(rows.len());
    for ((line, row), keep) in rows.into_iter().zip(kept) {
        if keep {
            readings.push(row);
        } else {
            let message = format!("time {} s is out of order among its neighbours", row[0]);
            problems.push(RecordingProblem { line, column: None, message });
        }
    }
    readings
}

/// Which values belong to a longest strictly increasing subsequence.
///
/// `ends[k]` is the index of the smallest value that ends a run of length `k + 1`.
fn longest_increasing(values: &[f64]) -> Vec<bool> {
    let mut ends: Vec<usize> = Vec::new();
    let mut before: Vec<Option<usize>> = vec![None; values.len()];
    for (i, value) in values.iter().enumerate() {
        let length = ends.partition_point(|&end| values[end] < *value);
        before[i] = length.checked_sub(1).map(|last| ends[last]);
        if length == ends.len() {
            ends.push(i);
        } else {
            ends[length] = i;
        }
    }
    let mut keep = vec![false; values.len()];
    let mut next = ends.last().copied();
    while let Some(i) = next {
        keep[i] = true;
        next = before[i];
    }
    keep
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_kept_run_is_as_long_as_the_longest_found_by_trying_all(
            values in proptest::collection::vec((0_i32..12).prop_map(f64::from), 0..11)
        ) {
            let increases = |kept: &[f64]| kept.windows(2).all(|pair| pair[0] < pair[1]);
            let pick = |mask: u32| -> Vec<f64> {
                (0..values.len()).filter(|i| mask >> i & 1 == 1).map(|i| values[i]).collect()
            };
            let best = (0..1_u32 << values.len()).map(pick).filter(|kept| increases(kept)).map(|kept| kept.len()).max();
            let keep = longest_increasing(&values);
            let kept: Vec<f64> = values.iter().zip(&keep).filter(|(_, keep)| **keep).map(|(v, _)| *v).collect();
            prop_assert!(increases(&kept));
            prop_assert_eq!(Some(kept.len()), best);
        }
    }
}
