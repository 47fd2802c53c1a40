//! Any table of time and two force components: `t, Fx, Fy`, read as `table` says. Without a header the columns are t
//! (s), Fx, Fy (force, in any unit).

use nalgebra::Vector2;
use palpate::finger::contact::Reading;

use super::mapping::Mapping;
use super::table::{self, Column, Quantity, Table};
use super::{ReadError, RecordingProblem};

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

const COLUMNS: [Column; 3] = [
    table::TIME,
    Column {
        key: "fx",
        name: "Fx",
        names: &["fx", "f_x", "force_x", "force.x"],
        ends: &[".force.x"],
        quantity: Quantity::FORCE,
    },
    Column {
        key: "fy",
        name: "Fy",
        names: &["fy", "f_y", "force_y", "force.y"],
        ends: &[".force.y"],
        quantity: Quantity::FORCE,
    },
];

/// Reads a table.
///
/// # Errors
/// [`ReadError`] if not one reading could be got.
pub fn parse(text: &str) -> Result<RecordedTable, ReadError> {
    parse_with(text, &Mapping::default())
}

/// Reads a table whose columns a mapping names: `t`, `fx`, `fy`.
///
/// ```
/// use palpate_files::recordings::{csv, mapping::Mapping};
///
/// let mapping = Mapping { decimal_comma: true, ..Mapping::parse("fx=-Kraft X [mN],fy=#3,t=Zeit")? };
/// let reading = csv::parse_with("Zeit;Kraft X;Kraft Y\n0,5;1,5;-0,25", &mapping)?.readings[0];
/// assert_eq!((reading.t, reading.force_finger.x, reading.force_finger.y), (0.5, -0.0015, -0.25));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`ReadError`] if not one reading could be got.
pub fn parse_with(text: &str, mapping: &Mapping) -> Result<RecordedTable, ReadError> {
    let Table { rows, problems, has_unit: [_, x, y] } = table::parse(text, &COLUMNS, mapping)?;
    let readings = rows.into_iter().map(|[t, x, y]| Reading::new(t, Vector2::new(x, y))).collect();
    Ok(RecordedTable { readings, problems, force_in_newtons: x && y })
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

    #[test]
    fn names_as_robots_tools_write_them_are_known() {
        let want = parse("1700000000,1,2\n1700000000.5,3,4\n").unwrap().readings;
        let texts = [
            // `rostopic echo -p`: ns.
            "%time,field.header.seq,field.header.stamp,field.wrench.force.x,field.wrench.force.y,field.wrench.force.z\n\
             1700000000000000000,1,1700000000000000000,1,2,0\n1700000000500000000,2,1700000000500000000,3,4,0\n",
            // PlotJuggler: s.
            "__time,/ft/wrench/force/x,/ft/wrench/force/y\n1700000000,1,2\n1700000000.5,3,4\n",
            "stamp [ms];force.x;force.y\n1700000000000;1;2\n1700000000500;3;4",
            "time,fx,fy\n2023-11-14T22:13:20Z,1,2\n2023-11-14 23:13:20.5+01:00,3,4\n",
        ];
        for text in texts {
            let got = parse(text).unwrap();
            assert_eq!((got.readings, got.problems), (want.clone(), Vec::new()), "{text}");
        }
        let two = "__time,/a/force/x,/b/force/x,/a/force/y,/b/force/y\n0,1,2,3,4\n";
        let error = parse(two).unwrap_err();
        assert!(matches!(error, ReadError::SeveralColumns { key: "fx", .. }), "{error}");
        let mapping = Mapping::parse("fx=/b/force/x,fy=-/b/force/y").unwrap();
        let force = parse_with(two, &mapping).unwrap().readings[0].force_finger;
        assert_eq!(force, Vector2::new(2.0, -4.0));
    }

    #[test]
    fn columns_are_told_by_name_or_number_with_their_units_and_signs() {
        let read = |text: &str, mapping: &str| parse_with(text, &Mapping::parse(mapping).unwrap());
        let want = parse("0,1,2\n0.5,3,-4e-1\n").unwrap().readings;
        assert_eq!(read("0,9,1,-2000\n500,9,3,400\n", "t=#1[ms],fx=#3,fy=-#4[mN]").unwrap().readings, want);
        let other = "stamp,up,along [mN]\n0,2,1000\n0.5,-0.4,3000\n";
        assert_eq!(read(other, "fx=along,fy=up").unwrap().readings, want);
        assert!(matches!(read(other, "fx=along,fy=down"), Err(ReadError::NoColumn { key: "fy", .. })));
        assert!(matches!(read("0,1\n", "fy=#3"), Err(ReadError::NoColumn { key: "fy", .. })));
        assert!(matches!(read(other, "fx=along,fy=up[lbf]"), Err(ReadError::UnknownUnit { .. })));
        let comma = Mapping { decimal_comma: true, ..Mapping::default() };
        for text in ["t;Fx;Fy\n0;1,0;2\n0,5;3;-0,4\n", "0\t1\t2\n0,5\t3,0\t-4e-1\n", "0 1 2\n0,5 3 -0,4"] {
            assert_eq!(parse_with(text, &comma).unwrap().readings, want, "{text}");
        }
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
    }
}
