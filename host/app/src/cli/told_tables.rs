//! What every command that reads files of forces or places takes: what is what in them.

use std::path::Path;

use nalgebra::Point2;
use palpate_files::recordings::csv::{self, RecordedTable};
use palpate_files::recordings::mapping::Mapping;
use palpate_files::recordings::path::{self, RecordedPath};
use palpate_files::recordings::stamped::{self, Stamped, StampedError};

use miette::WrapErr as _;

use super::read::{read, report_problems};
use crate::advice::Advise as _;

/// What is what in files of forces and places.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Files of forces and places")]
pub(crate) struct TableArguments {
    /// What is what in a file: KEY=COLUMN,… of t, fx, fy in forces and path_t, x, y in places; a column by its name or #NUMBER,
    /// with - for the other sign and a unit: `t=stamp[ms],fx=-Fz[mN],fy=#3`. Of MCAP files fields, such as force.z
    #[arg(long, value_name = "KEY=COLUMN,…", value_parser = Mapping::parse)]
    columns: Option<Mapping>,

    /// Numbers have a comma before their fraction; columns are then separated by ;, tabs or blanks
    #[arg(long)]
    decimal_comma: bool,

    /// Topic of an MCAP file that has several with forces or places (repeatable)
    #[arg(long, value_name = "TOPIC")]
    topic: Vec<String>,
}

impl TableArguments {
    /// What was told.
    pub(super) fn mapping(&self) -> Mapping {
        let told = self.columns.clone().unwrap_or_default();
        Mapping { decimal_comma: self.decimal_comma, topics: self.topic.clone(), ..told }
    }

    /// The forces in a file, which is a table or MCAP; what could not be read is told.
    pub(super) fn forces(&self, path: &Path) -> miette::Result<RecordedTable> {
        let mapping = self.mapping();
        if stamped::is_mcap(path) {
            let (readings, unit) = taken(path, stamped::forces(path, &mapping))?;
            let force_in_newtons = unit.is_none_or(|unit| unit == "N");
            return Ok(RecordedTable { readings, problems: Vec::new(), force_in_newtons });
        }
        let table = read(path, |text| csv::parse_with(text, &mapping))?;
        report_problems(path, &table.problems);
        Ok(table)
    }

    /// The forces in the text of a table.
    pub(super) fn forces_of(&self, text: &str) -> miette::Result<RecordedTable> {
        csv::parse_with(text, &self.mapping()).advised()
    }

    /// The places in a file, which is a table or MCAP; what could not be read is told.
    pub(super) fn places(&self, path: &Path) -> miette::Result<RecordedPath> {
        let mapping = self.mapping();
        if stamped::is_mcap(path) {
            let (rows, _) = taken(path, stamped::places(path, &mapping))?;
            let (times, places): (Vec<f64>, Vec<Point2<f64>>) = rows.into_iter().unzip();
            return Ok(RecordedPath { times, places, problems: Vec::new() });
        }
        let table = read(path, |text| path::parse_with(text, &mapping))?;
        report_problems(path, &table.problems);
        Ok(table)
    }
}

/// What an MCAP file gave, with the unit that it names; what could not be read is told.
fn taken<T>(path: &Path, read: Result<Stamped<T>, StampedError>) -> miette::Result<(Vec<T>, Option<String>)> {
    let Stamped { rows, topic, unit, problems } =
        read.advised().wrap_err_with(|| format!("cannot use {}", path.display()))?;
    report_problems(path, &problems);
    note!("{}: {} of {topic}", path.display(), super::counted(rows.len(), "message"));
    Ok((rows, unit))
}
