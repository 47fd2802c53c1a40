//! Any table of numbers by time, in columns that are known by name or by their order.
//!
//! Columns are separated by `;`, `,`, tab or blanks, whichever the first line of data or header has (in this order).
//! A header is optional: names in any case, with units in brackets (`Fx [N]`, `t (ms)`), columns that are not needed
//! are ignored. Names as robots' tools write them are known by their ends (`field.wrench.force.x`,
//! `/wrench/wrench/force/x`); a [`Mapping`] names any others. Without a header the columns come in the order in which they are
//! asked for. `#` starts a comment; blank lines, CR LF and a byte-order mark are fine. Times may be dates (ISO 8601), then s since
//! 1970; without a unit and so large that they can be nothing else they are ns since then.
//!
//! A line that cannot be read, or whose time is not after that of the rows kept, is reported and skipped. Which
//! lines are out of order is decided over the whole file (the longest increasing run of times is kept), so that one
//! wrong time costs one line and not all that follow.
//!
//! Written by hand: a table of numbers needs no quoting rules, and the usual reader for this format knows neither
//! blanks as separators nor lines to skip.

use toml::value::{Datetime, Offset};

use super::mapping::{Mapping, Place};
use super::{ReadError, RecordingProblem, number, shorten};

/// A column that is asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column {
    /// Its name in a [`Mapping`].
    pub key: &'static str,
    /// Its name in messages.
    pub name: &'static str,
    /// Names by which it is known in a header, lower case.
    pub names: &'static [&'static str],
    /// Ends of names by which it is known if it has none of those.
    pub ends: &'static [&'static str],
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
    /// m/s².
    pub(crate) const ACCELERATION: Self = Self {
        name: "acceleration",
        units: &[("m/s^2", 1.0), ("m/s²", 1.0), ("m/s2", 1.0), ("mm/s^2", 1e-3), ("mm/s²", 1e-3), ("g", 9.806_65)],
        known: "m/s^2, mm/s^2, g",
    };
}

/// The time of a row.
pub(crate) const TIME: Column = Column {
    key: "t",
    name: "time (t)",
    names: &["t", "time", "time_s", "timestamp", "stamp"],
    ends: &[".header.stamp", ".stamp"],
    quantity: Quantity::TIME,
};

/// The time of a place, where a mapping may tell it apart from that of a force.
pub(crate) const PATH_TIME: Column = Column { key: "path_t", ..TIME };

/// Times without a unit that are larger are ns since 1970: as s they would be three billion years.
const NANOSECONDS_FROM: f64 = 1e17;

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
pub(crate) fn parse<const N: usize>(
    text: &str,
    wanted: &[Column; N],
    mapping: &Mapping,
) -> Result<Table<N>, ReadError> {
    let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, content(line))).filter(|(_, l)| !l.is_empty());
    let first = lines.clone().next().ok_or(ReadError::Empty)?;
    let separator = Separator::of(first.1, mapping.decimal_comma);
    let columns = Columns::of(wanted, mapping, first.0, &separator.split(first.1))?;
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
    /// A comma within numbers is between none.
    fn of(line: &str, decimal_comma: bool) -> Self {
        let between = [';', ',', '\t'].into_iter().filter(|&c| !(decimal_comma && c == ','));
        between.into_iter().find(|&c| line.contains(c)).map_or(Self::Blanks, Self::Character)
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
    decimal_comma: bool,
}

impl<const N: usize> Columns<N> {
    /// From the first line: a header unless a field of it is a number.
    fn of(wanted: &[Column; N], mapping: &Mapping, line: usize, fields: &[&str]) -> Result<Self, ReadError> {
        let decimal_comma = mapping.decimal_comma;
        let is_number = |field: &&str| decimal(field, decimal_comma).parse::<f64>().is_ok();
        let is_named = !fields.iter().any(is_number);
        let headings = if is_named { headings(fields) } else { Vec::new() };
        let is_told = wanted.iter().any(|column| mapping.source(column.key).is_some());
        let count = match () {
            () if is_named => headings.len(),
            () if is_told => fields.len(),
            () => N,
        };
        let mut columns =
            Self { places: [0; N], scales: [1.0; N], has_unit: [false; N], fields: count, is_named, decimal_comma };
        for (i, column) in wanted.iter().enumerate() {
            let told = mapping.source(column.key);
            columns.places[i] = match told.map(|source| &source.place) {
                Some(Place::Number(number)) if *number <= count => number - 1,
                Some(place) => place_of(place, &headings).ok_or_else(|| no_column(line, column, &headings))?,
                None if is_named => known_place(column, line, &headings)?,
                None => i,
            };
            let heading = headings.get(columns.places[i]);
            let unit = told.and_then(|source| source.unit.as_ref()).or(heading.and_then(|(_, unit)| unit.as_ref()));
            if let Some(unit) = unit {
                columns.scales[i] = column.quantity.scale(line, unit)?;
                columns.has_unit[i] = true;
            }
            if told.is_some_and(|source| source.is_negative) {
                columns.scales[i] = -columns.scales[i];
            }
        }
        Ok(columns)
    }

    fn row(&self, fields: &[&str]) -> Result<[f64; N], (Option<usize>, String)> {
        if fields.len() != self.fields {
            let advice = if self.is_named { "" } else { "; more need a header that names them" };
            return Err((None, format!("{} fields, where {} are expected{advice}", fields.len(), self.fields)));
        }
        let mut values = [0.0; N];
        for (i, value) in values.iter_mut().enumerate() {
            let field = fields[self.places[i]];
            let read = number(&decimal(field, self.decimal_comma));
            *value = match read {
                Ok(time) if i == 0 && !self.has_unit[0] && time.abs() >= NANOSECONDS_FROM => time * 1e-9,
                Ok(value) => value * self.scales[i],
                Err(message) => match since_1970(field).filter(|_| i == 0) {
                    Some(seconds) => seconds,
                    None => return Err((Some(self.places[i] + 1), message)),
                },
            };
        }
        Ok(values)
    }
}

/// A number as programs write it.
fn decimal(field: &str, has_comma: bool) -> std::borrow::Cow<'_, str> {
    if has_comma { field.replacen(',', ".", 1).into() } else { field.into() }
}

/// The column that a mapping names.
fn place_of(place: &Place, headings: &[Heading]) -> Option<usize> {
    match place {
        Place::Number(_) => None,
        Place::Name(name) => headings.iter().position(|(heading, _)| *heading == name.to_lowercase()),
    }
}

/// The column that is known by its name, or alone by its name's end.
fn known_place(column: &Column, line: usize, headings: &[Heading]) -> Result<usize, ReadError> {
    let bare = |name: &str| name.trim_start_matches(['%', '_', '/', '.']).replace('/', ".");
    let names: Vec<_> = headings.iter().map(|(name, _)| bare(name)).collect();
    if let Some(place) = names.iter().position(|name| column.names.contains(&name.as_str())) {
        return Ok(place);
    }
    let ends = column.ends.iter().map(|end| {
        let has_end = |(_, name): &(usize, &String)| name.ends_with(end) || *name == end.trim_start_matches('.');
        names.iter().enumerate().filter(has_end).map(|(place, _)| place).collect::<Vec<_>>()
    });
    let found = ends.into_iter().find(|places| !places.is_empty()).unwrap_or_default();
    match found[..] {
        [place] => Ok(place),
        [] => Err(no_column(line, column, headings)),
        _ => {
            let found = found.iter().map(|&place| shorten(&headings[place].0)).collect::<Vec<_>>().join(", ");
            Err(ReadError::SeveralColumns { line, column: column.name, key: column.key, found })
        }
    }
}

fn no_column(line: usize, column: &Column, headings: &[Heading]) -> ReadError {
    let found = headings.iter().map(|(name, _)| shorten(name)).collect::<Vec<_>>().join(", ");
    ReadError::NoColumn { line, column: column.name, key: column.key, found }
}

/// A date with its time, s since 1970; without a zone it is taken for universal time.
fn since_1970(text: &str) -> Option<f64> {
    let Datetime { date: Some(date), time: Some(time), offset } = text.parse().ok()? else { return None };
    // Howard Hinnant, "chrono-compatible low-level date algorithms", `days_from_civil`: years begin in March.
    let (month, day) = (i64::from(date.month), i64::from(date.day));
    let year = i64::from(date.year) - i64::from(month <= 2);
    let (era, year_of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let day_of_year = (153 * (month + if month > 2 { -3 } else { 9 }) + 2) / 5 + day - 1;
    let days = era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719_468;
    let minutes = match offset {
        Some(Offset::Custom { minutes }) => i64::from(minutes),
        Some(Offset::Z) | None => 0,
    };
    let of_day = i64::from(time.hour) * 3600 + (i64::from(time.minute) - minutes) * 60;
    let second = i64::from(time.second.unwrap_or(0));
    Some((days * 86_400 + of_day + second) as f64 + f64::from(time.nanosecond.unwrap_or(0)) * 1e-9)
}

impl Quantity {
    /// What one of this unit is in SI.
    pub(crate) fn in_si(&self, unit: &str) -> Option<f64> {
        self.units.iter().find(|(name, _)| *name == unit).map(|(_, scale)| *scale)
    }

    /// What it is called, and its units.
    pub(crate) fn told(&self) -> (&'static str, &'static str) {
        (self.name, self.known)
    }

    fn scale(&self, line: usize, unit: &str) -> Result<f64, ReadError> {
        let (quantity, known) = self.told();
        let unknown = || ReadError::UnknownUnit { line, unit: shorten(unit), quantity, known };
        self.in_si(unit).ok_or_else(unknown)
    }
}

/// Name and unit of a column.
type Heading = (String, Option<String>);

/// Name (lower case) and unit of each column. Where blanks separate, a unit in brackets is a field of its own.
fn headings(fields: &[&str]) -> Vec<Heading> {
    let mut headings: Vec<Heading> = Vec::new();
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
