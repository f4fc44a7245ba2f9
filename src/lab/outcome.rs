use upm_chart::Chart;
use upm_core::signal::RecordedPulse;

/// One numerical result of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Name, such as `COR of row b along x`.
    pub name: String,
    /// Unit; `1` for a ratio.
    pub unit: String,
    /// The value measured here.
    pub measured: f64,
    /// Reference value from a closed form or the paper that the measured one is meant to meet; `None` where it does not
    /// hold.
    pub reference: Option<f64>,
    /// Source of the reference, such as `UPM paper, Eq. 15`.
    pub source: String,
}

impl Figure {
    /// A figure with a reference.
    pub fn against<N: Into<String>>(name: N, unit: &str, measured: f64, reference: f64, source: &str) -> Self {
        Self::alone(name, unit, measured, source).with(Some(reference))
    }

    /// The figure with a reference where one holds.
    pub fn with(self, reference: Option<f64>) -> Self {
        Self { reference, ..self }
    }

    /// A figure without a reference; `source` gives the method.
    pub fn alone<N: Into<String>>(name: N, unit: &str, measured: f64, source: &str) -> Self {
        Self { name: name.into(), unit: unit.to_owned(), measured, reference: None, source: source.to_owned() }
    }

    /// The figure with `what` for `{}` in its name and source.
    pub fn of(self, what: &str) -> Self {
        Self { name: self.name.replace("{}", what), source: self.source.replace("{}", what), ..self }
    }

    /// The figure classed in its source, so that the printed table names it: reproduced where the measured value is in
    /// `accepted`, limits included; a missing one is not.
    pub(super) fn judged(self, accepted: [f64; 2]) -> Self {
        let [least, most] = accepted;
        let verdict = if (least..=most).contains(&self.measured) { "reproduced" } else { "NOT reproduced" };
        Self { source: format!("{verdict} ({least} to {most}): {}", self.source), ..self }
    }

    /// Deviation of `measured` from the reference, as a fraction of it; `None` where either is missing or the reference
    /// is zero.
    pub fn relative_error(&self) -> Option<f64> {
        let compared = self.reference.filter(|&reference| reference != 0.0 && !self.measured.is_nan());
        compared.map(|reference| (self.measured - reference) / reference)
    }
}

/// A table of numbers: one row per point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DataSheet {
    /// Headings of the columns, with units.
    pub columns: Vec<String>,
    /// Values; NaN for a missing one.
    pub rows: Vec<Vec<f64>>,
}

impl DataSheet {
    /// Adds a column; NaN where `column` has no value.
    pub(super) fn add(&mut self, name: &str, column: impl Iterator<Item = Option<f64>>) {
        self.columns.push(name.to_owned());
        for (row, value) in self.rows.iter_mut().zip(column) {
            row.push(value.unwrap_or(f64::NAN));
        }
    }
}

/// Complete result of an experiment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExperimentResult {
    /// Figures of the table.
    pub figures: Vec<Figure>,
    /// Pictures of the results, one SVG file each.
    pub charts: Vec<Chart>,
    /// Table of the points of a sweep, or of several machines.
    pub sheet: Option<DataSheet>,
    /// Findings that need attention, one a line.
    pub notes: Vec<String>,
    /// The trace that was evaluated.
    pub recorded: Option<RecordedPulse>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figure_in_the_accepted_interval_alone_is_reproduced() {
        for (measured, class) in [
            (0.6, "reproduced (0.6 to 1): Fig. 5"),
            (1.1, "NOT reproduced (0.6 to 1): Fig. 5"),
            (f64::NAN, "NOT reproduced (0.6 to 1): Fig. 5"),
        ] {
            let figure = Figure::against("rate", "mm/s", measured, 0.8, "Fig. 5").judged([0.6, 1.0]);
            assert_eq!(figure.source, class);
        }
    }
}
