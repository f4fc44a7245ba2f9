use upm_chart::{Chart, Playback};
use upm_core::signal::RecordedPulse;

/// One number an experiment comes to.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Name: `COR of row b along x`.
    pub name: String,
    /// Its unit; `1` for a ratio.
    pub unit: String,
    /// The value measured here.
    pub measured: f64,
    /// Value to compare it with.
    pub reference: Option<f64>,
    /// Where the reference is from: `UPM paper, Eq. 15`.
    pub source: String,
}

impl Figure {
    /// A figure with something to compare it with.
    pub fn against<N: Into<String>>(name: N, unit: &str, measured: f64, reference: f64, source: &str) -> Self {
        Self { reference: Some(reference), ..Self::alone(name, unit, measured, source) }
    }

    /// A figure by itself; `source` says how it was found.
    pub fn alone<N: Into<String>>(name: N, unit: &str, measured: f64, source: &str) -> Self {
        Self { name: name.into(), unit: unit.to_owned(), measured, reference: None, source: source.to_owned() }
    }

    /// How far `measured` is from the reference, as a part of it; `None` where either is missing or the reference is zero.
    pub fn relative_error(&self) -> Option<f64> {
        let compared = self.reference.filter(|&reference| reference != 0.0 && !self.measured.is_nan());
        compared.map(|reference| (self.measured - reference) / reference)
    }
}

/// Numbers over something, for plots of people's own; the unit is in the name.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// `speed_mps`.
    pub name: String,
    /// In order.
    pub values: Vec<f64>,
}

impl Series {
    /// Values under a name.
    pub fn new(name: &str, values: impl IntoIterator<Item = f64>) -> Self {
        Self { name: name.to_owned(), values: values.into_iter().collect() }
    }

    /// The columns of `rows` under these names.
    pub(super) fn columns<const N: usize>(names: [&str; N], rows: &[[f64; N]]) -> Vec<Self> {
        names.iter().enumerate().map(|(i, name)| Self::new(name, rows.iter().map(|row| row[i]))).collect()
    }
}

/// A table of numbers: a row a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheet {
    /// Headings of the columns, with units.
    pub columns: Vec<String>,
    /// Values; NaN for a missing one.
    pub rows: Vec<Vec<f64>>,
}

impl Sheet {
    /// Rows under these headings.
    pub(super) fn new<const N: usize>(columns: [&str; N], rows: Vec<Vec<f64>>) -> Self {
        Self { columns: columns.map(str::to_owned).to_vec(), rows }
    }

    /// Adds a column; NaN where `column` has no value.
    pub(super) fn add(&mut self, name: &str, column: impl Iterator<Item = Option<f64>>) {
        self.columns.push(name.to_owned());
        for (row, value) in self.rows.iter_mut().zip(column) {
            row.push(value.unwrap_or(f64::NAN));
        }
    }

    /// Its columns.
    pub(super) fn series(&self) -> Vec<Series> {
        let column = |i: usize| self.rows.iter().map(move |row| row[i]);
        self.columns.iter().enumerate().map(|(i, name)| Series::new(name, column(i))).collect()
    }
}

/// All that an experiment leaves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// The table.
    pub figures: Vec<Figure>,
    /// The curves behind it.
    pub series: Vec<Series>,
    /// Pictures.
    pub charts: Vec<Chart>,
    /// Table of the points of a sweep, or of machines side by side.
    pub sheet: Option<Sheet>,
    /// Motion of the parts.
    pub motion: Option<Playback>,
    /// Findings to look at again, one a line.
    pub notes: Vec<String>,
    /// The trace it read.
    pub recorded: Option<RecordedPulse>,
}
