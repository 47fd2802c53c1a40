//! Any table of time and two force components: `t, Fx, Fy`.
//!
//! Columns are separated by `;`, `,`, tab or blanks, whichever the first line of data or header has (in this order).
//! A header is optional: names in any case, with units in brackets (`Fx [N]`, `t (ms)`), columns that are not needed
//! are ignored. Without one the columns are t (s), Fx, Fy (force, in any unit). `#` starts a comment; blank lines,
//! CR LF and a byte-order mark are fine.
//!
//! A line that cannot be read, or whose time is not after that of the readings kept, is reported and skipped. Which
//! lines are out of order is decided over the whole file (the longest increasing run of times is kept), so that one
//! wrong time costs one line and not all that follow.
//!
//! Written by hand: a table of numbers needs no quoting rules, and the usual reader for this format knows neither
//! blanks as separators nor lines to skip.

use nalgebra::Vector2;
use palpate::finger::contact::Reading;

use super::{ReadError, RecordingProblem, number, shorten};

/// What a table gave.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedTable {
    /// The readings, time increasing; s, and N where the header names a unit of force.
    pub readings: Vec<Reading>,
    /// What was skipped, in the order of the file.
    pub problems: Vec<RecordingProblem>,
    /// Whether the header says that the force is in a unit of force; otherwise it may be anything.
    pub force_in_newtons: bool,
}

/// Reads a table.
///
/// # Errors
/// [`ReadError`] if not one reading could be got.
pub fn parse(text: &str) -> Result<RecordedTable, ReadError> {
    let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, content(line))).filter(|(_, l)| !l.is_empty());
    let first = lines.clone().next().ok_or(ReadError::Empty)?;
    let separator = Separator::of(first.1);
    let columns = Columns::of(first.0, &separator.split(first.1))?;
    if columns.is_named {
        lines.next();
    }
    let (mut rows, mut problems) = (Vec::new(), Vec::new());
    for (line, content) in lines {
        match columns.reading(&separator.split(content)) {
            Ok(reading) => rows.push((line, reading)),
            Err((column, message)) => problems.push(RecordingProblem { line, column, message }),
        }
    }
    let tried = rows.len() + problems.len();
    let readings = keep_increasing(rows, &mut problems);
    problems.sort_by_key(|problem| problem.line);
    match problems.first() {
        Some(first) if readings.is_empty() => Err(ReadError::AllBad { lines: tried, first: first.clone() }),
        None if readings.is_empty() => Err(ReadError::Empty),
        _ => Ok(RecordedTable { readings, problems, force_in_newtons: columns.force_in_newtons }),
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

/// Where the three values are in a line, and what to multiply them by.
struct Columns {
    places: [usize; 3],
    scales: [f64; 3],
    fields: usize,
    is_named: bool,
    force_in_newtons: bool,
}

/// Names by which a column is known, lower case.
const NAMES: [(&str, &[&str]); 3] = [
    ("time (t)", &["t", "time", "time_s", "timestamp", "stamp"]),
    ("Fx", &["fx", "f_x", "force_x", "force.x"]),
    ("Fy", &["fy", "f_y", "force_y", "force.y"]),
];
const TIME_UNITS: &[(&str, f64)] = &[("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("ns", 1e-9)];
const FORCE_UNITS: &[(&str, f64)] = &[("n", 1.0), ("mn", 1e-3), ("kn", 1e3)];

impl Columns {
    /// From the first line: a header unless a field of it is a number.
    fn of(line: usize, fields: &[&str]) -> Result<Self, ReadError> {
        if fields.iter().any(|field| field.parse::<f64>().is_ok()) {
            let (places, scales) = ([0, 1, 2], [1.0; 3]);
            return Ok(Self { places, scales, fields: 3, is_named: false, force_in_newtons: false });
        }
        let headings = headings(fields);
        let (mut places, mut scales, mut units) = ([0; 3], [1.0; 3], [false; 3]);
        for (i, (column, names)) in NAMES.iter().enumerate() {
            let place = headings.iter().position(|(name, _)| names.contains(&name.as_str()));
            let found = || headings.iter().map(|(name, _)| shorten(name)).collect::<Vec<_>>().join(", ");
            places[i] = place.ok_or_else(|| ReadError::NoColumn { line, column, found: found() })?;
            if let Some(unit) = &headings[places[i]].1 {
                scales[i] = scale(line, i == 0, unit)?;
                units[i] = true;
            }
        }
        let force_in_newtons = units[1] && units[2];
        Ok(Self { places, scales, fields: headings.len(), is_named: true, force_in_newtons })
    }

    fn reading(&self, fields: &[&str]) -> Result<Reading, (Option<usize>, String)> {
        if fields.len() != self.fields {
            let advice = if self.is_named { "" } else { "; more need a header that names them" };
            return Err((None, format!("{} fields, where {} are expected{advice}", fields.len(), self.fields)));
        }
        let mut values = [0.0; 3];
        for (i, value) in values.iter_mut().enumerate() {
            let place = self.places[i];
            *value = number(fields[place]).map_err(|message| (Some(place + 1), message))? * self.scales[i];
        }
        Ok(Reading::new(values[0], Vector2::new(values[1], values[2])))
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

fn scale(line: usize, is_time: bool, unit: &str) -> Result<f64, ReadError> {
    let (units, quantity, known) =
        if is_time { (TIME_UNITS, "time", "s, ms, us, ns") } else { (FORCE_UNITS, "force", "N, mN, kN") };
    let found = units.iter().find(|(name, _)| *name == unit);
    found.map(|(_, scale)| *scale).ok_or_else(|| ReadError::UnknownUnit { line, unit: shorten(unit), quantity, known })
}

/// Keeps the longest run of readings whose times increase; reports the others.
fn keep_increasing(rows: Vec<(usize, Reading)>, problems: &mut Vec<RecordingProblem>) -> Vec<Reading> {
    let kept = longest_increasing(&rows.iter().map(|(_, reading)| reading.t).collect::<Vec<_>>());
    let mut readings = Vec::with_capacity(rows.len());
    for ((line, reading), keep) in rows.into_iter().zip(kept) {
        if keep {
            readings.push(reading);
        } else {
            let message = format!("time {} s is out of order among its neighbours", reading.t);
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

    fn times(text: &str) -> Vec<f64> {
        parse(text).unwrap().readings.iter().map(|reading| reading.t).collect()
    }

    #[test]
    fn every_separator_header_comment_and_line_end_reads_the_same() {
        let want = parse("0,1,2\n0.5,3,-4e-1\n").unwrap().readings;
        let texts = [
            "t,Fx,Fy\n0,1,2\n0.5,3,-0.4",
            "# made by hand\nT;FX [N];fy [N]\r\n0;1;2\r\n\r\n0.5;3;-0.4 # late\r\n",
            "0\t1\t2\n0.5\t3\t-0.4\n",
            "  0   1  2 \n 0.5 3 -0.4\n",
            "t [s] Fx [N] Fy [N]\n0 1 2\n0.5 3 -0.4\n",
            "time (ms),Fz,\"Fy [mN]\",Fx [N]\n0,9,2000,1\n500,9,-400,3\n",
        ];
        for text in texts {
            let got = parse(text).unwrap();
            assert_eq!(got.readings, want, "{text}");
            assert_eq!(got.problems, [], "{text}");
        }
        assert!(parse(texts[1]).unwrap().force_in_newtons && !parse(texts[0]).unwrap().force_in_newtons);
    }

    #[test]
    fn bad_lines_are_reported_each_with_its_place_and_skipped() {
        let text = "t,Fx,Fy\n0,1,2\n1,x,2\n2,NaN,2\n3,1\n4,1,\n5,1e999,1\n6,1,2\n";
        let table = parse(text).unwrap();
        assert_eq!(times(text), [0.0, 6.0]);
        let places: Vec<_> = table.problems.iter().map(|problem| (problem.line, problem.column)).collect();
        assert_eq!(places, [(3, Some(2)), (4, Some(2)), (5, None), (6, Some(3)), (7, Some(2))]);
        assert_eq!(table.problems[0].to_string(), "line 3, column 2: `x` is not a number");
    }

    #[test]
    fn one_wrong_time_costs_one_line() {
        assert_eq!(times("0,1,1\n1,1,1\n1000,1,1\n2,1,1\n3,1,1\n4,1,1\n"), [0.0, 1.0, 2.0, 3.0, 4.0]);
        let table = parse("0,1,1\n1,1,1\n1,1,1\n2,1,1\n").unwrap();
        assert_eq!(table.problems.len(), 1);
        assert!(table.problems[0].message.contains("out of order"));
    }

    #[test]
    fn files_that_give_nothing_say_why() {
        assert_eq!(parse("# nothing\n\n"), Err(ReadError::Empty));
        assert_eq!(parse("t,Fx,Fy\n"), Err(ReadError::Empty));
        assert!(matches!(parse("t,Fx,Fz\n0,1,2\n"), Err(ReadError::NoColumn { column: "Fy", .. })));
        assert!(matches!(parse("t,Fx [lbf],Fy\n0,1,2\n"), Err(ReadError::UnknownUnit { quantity: "force", .. })));
        assert!(matches!(parse("0,1\n2,3\n"), Err(ReadError::AllBad { lines: 2, .. })));
    }

    proptest! {
        #[test]
        fn any_text_at_all_is_read_or_refused(text in "(?s).{0,300}") {
            let _ = parse(&text);
        }

        #[test]
        fn any_table_of_odd_fields_is_read_or_refused(
            lines in proptest::collection::vec("([0-9.eE+-]{0,6}|NaN|inf|t|Fx|\\[N\\])([,; \t]([0-9.e-]{0,5}|x)){0,3}", 0..30)
        ) {
            if let Ok(table) = parse(&lines.join("\n")) {
                prop_assert!(table.readings.windows(2).all(|pair| pair[0].t < pair[1].t));
            }
        }

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
