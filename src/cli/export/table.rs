use std::fs::File;
use std::io;
use std::path::Path;

/// Type of the values of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Whole,
    Real,
    Flag,
    Text,
}

/// Name, with the unit where there is one, and type of the values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Column(pub &'static str, pub Kind);

/// Schema of a table of a run.
#[derive(Debug)]
pub(super) struct ExportTable {
    /// Stem of the file name.
    pub name: &'static str,
    pub columns: &'static [Column],
}

/// A value of its column's type, or empty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum TableCell<'a> {
    Empty,
    Whole(i64),
    Real(f64),
    Flag(bool),
    Text(&'a str),
}

/// File of a table in one format.
pub(super) trait TableFile {
    /// Appends a row with one cell per column.
    fn row(&mut self, cells: &[TableCell<'_>]) -> io::Result<()>;
    /// Writes buffered rows and closes the file.
    fn finish(self: Box<Self>) -> io::Result<()>;
}

/// Comma-separated values as in RFC 4180, with a header row.
pub(super) struct CsvFile(csv::Writer<File>);

impl CsvFile {
    pub fn create(path: &Path, table: &ExportTable) -> io::Result<Self> {
        let mut file = csv::Writer::from_writer(File::create(path)?);
        file.write_record(table.columns.iter().map(|Column(name, _)| name))?;
        Ok(Self(file))
    }
}

impl TableFile for CsvFile {
    fn row(&mut self, cells: &[TableCell<'_>]) -> io::Result<()> {
        for cell in cells {
            match cell {
                TableCell::Empty => self.0.write_field("")?,
                // shortest text that reads back to the same number
                TableCell::Real(number) => self.0.write_field(number.to_string())?,
                TableCell::Whole(number) => self.0.write_field(number.to_string())?,
                TableCell::Flag(flag) => self.0.write_field(flag.to_string())?,
                TableCell::Text(text) => self.0.write_field(text)?,
            }
        }
        self.0.write_record(None::<&[u8]>)?;
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.0.flush()
    }
}
