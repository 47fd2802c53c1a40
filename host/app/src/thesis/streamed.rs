//! A table that is printed while it is made: each row as it is done.
//!
//! Columns are as wide as their headings and the first row need; what is wider later takes its neighbours' room. Of a
//! table that is wider than a terminal the first block of columns is printed row by row, the others when it is done, as
//! [`Table`] itself prints them.
//!
//! Units: columns, one a character. Errors: none.

use super::{GAP, Table, blocks, line};
use crate::width::{COLUMNS, folded};

/// What of a table was printed, and what it had.
#[derive(Debug, Default)]
pub(crate) struct Streamed {
    /// The table as it was known last.
    table: Table,
    /// Rows and definitions that are printed.
    rows: usize,
    definitions: usize,
    widths: Vec<usize>,
    is_done: bool,
}

/// Names of rows differ most in length: room for most of them.
const NAME: usize = 12;

/// Numbers of later rows may be wider than those of the first: room for most of them, in columns.
const GROWTH: usize = 2;

impl Streamed {
    /// What is to be printed now that the table has come so far.
    pub(crate) fn rows(&mut self, table: &Table) -> String {
        self.table = table.clone();
        let mut text = String::new();
        if self.widths.is_empty() {
            text += &self.definitions();
            self.widths = self.table.widths();
            self.leave_room();
            text += &(line(&self.table.headings(), &self.widths, &self.first_block()) + "\n");
        }
        text += &self.table.lines(self.rows, &self.widths, &self.first_block());
        self.rows = self.table.rows.len();
        text
    }

    /// What is still to be printed of the table as it is in the end.
    pub(crate) fn rest(&mut self, table: Table) -> String {
        self.is_done = true;
        let mut text = if self.widths.is_empty() && table.rows.is_empty() {
            self.table = table;
            self.definitions()
        } else {
            self.rows(&table)
        };
        text += &self.definitions();
        text + &self.ending()
    }

    /// The same of a table that will have no more rows, and how many it has; none where it is done already.
    pub(crate) fn broken_off(&mut self) -> Option<(String, usize)> {
        let was_done = std::mem::replace(&mut self.is_done, true);
        (!was_done).then(|| (self.ending(), self.table.rows.len()))
    }

    /// The table as it was known last.
    pub(crate) fn table(&self) -> &Table {
        &self.table
    }

    /// Other blocks of columns, then what stands out and what failed.
    fn ending(&self) -> String {
        let (table, widths) = (&self.table, self.table.widths());
        let first = self.first_block();
        let left: Vec<_> = (0..self.widths.len()).filter(|column| !first.contains(column)).collect();
        let others = if left.is_empty() { Vec::new() } else { blocks(&widths, left.into_iter(), COLUMNS) };
        let others = others.into_iter().map(|block| {
            format!("\n{}\n{}", line(&table.headings(), &widths, &block), table.lines(0, &widths, &block))
        });
        others.collect::<String>() + &table.sentences()
    }

    /// Leaves the names of rows to come what room the first block has for them.
    fn leave_room(&mut self) {
        let used: usize = self.first_block().iter().map(|&column| self.widths[column] + GAP.len()).sum();
        let left = (COLUMNS + GAP.len()).saturating_sub(used + GROWTH);
        if let Some(name) = self.widths.first_mut() {
            *name = NAME.min(*name + left).max(*name);
        }
    }

    /// The columns that are printed row by row.
    fn first_block(&self) -> Vec<usize> {
        let columns = 1..self.widths.len();
        blocks(&self.widths, columns, COLUMNS - GROWTH).into_iter().next().unwrap_or_default()
    }

    /// Definitions that are not printed yet.
    fn definitions(&mut self) -> String {
        let new = self.table.definitions.iter().skip(self.definitions);
        let text = new.fold(String::new(), |text, definition| text + &folded(definition) + "\n");
        self.definitions = self.table.definitions.len();
        text
    }
}

#[cfg(test)]
mod tests {
    use super::super::Cell;
    use super::*;

    /// A table of three rows and what is printed as it comes to have them, and in the end.
    fn printed(columns: impl IntoIterator<Item = &'static str>) -> (Table, Vec<String>) {
        let mut table = Table::new(columns);
        table.definitions.push("What counts.".to_owned());
        let mut streamed = Streamed::default();
        let mut texts = Vec::new();
        for name in ["one", "a longer name", "three"] {
            table.push([name.into(), Cell::count(7), Cell::share(1, 3)]);
            texts.push(streamed.rows(&table));
        }
        table.failures.push("case 7".to_owned());
        texts.push(streamed.rest(table.clone()));
        (table, texts)
    }

    #[test]
    fn every_row_is_printed_once_as_soon_as_it_is_done() {
        let (table, texts) = printed(["rows", "cases", "share"]);
        assert_eq!(texts[0], "What counts.\nrows          cases   share\none               7  33.3 %\n");
        assert_eq!(texts[1], "a longer name     7  33.3 %\n", "it takes its neighbour's room");
        assert_eq!(texts[3], "failed: case 7\n");
        // What is there in the end is what the table itself prints, but for the widths.
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(words(&texts.concat()), words(&table.to_string()));
    }

    #[test]
    fn of_a_wide_table_the_first_columns_come_at_once_and_the_others_in_the_end() {
        let columns = ["rows", "forty columns of heading ...............", "and once more forty columns ..........."];
        let (table, texts) = printed(columns);
        assert!(texts[1].starts_with("a longer name") && !texts[1].contains('%'), "{texts:?}");
        assert!(texts[3].contains("a longer name") && texts[3].contains('%'), "{texts:?}");
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(words(&texts.concat()), words(&table.to_string()));
        assert!(texts.concat().lines().all(|line| line.chars().count() <= COLUMNS));
    }

    #[test]
    fn a_table_that_is_broken_off_has_all_columns_of_the_rows_that_are_done() {
        let columns = ["rows", "forty columns of heading ...............", "and once more forty columns ..........."];
        let mut table = Table::new(columns);
        table.push(["one".into(), Cell::count(7), Cell::share(1, 3)]);
        let mut streamed = Streamed::default();
        let begun = streamed.rows(&table);
        let (rest, rows) = streamed.broken_off().unwrap();
        assert_eq!(rows, 1);
        assert_eq!(streamed.broken_off(), None, "once");
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(words(&(begun + &rest)), words(&table.to_string()));
    }
}
