//! One parameter over a range, its points in parallel: `--sweep duty=0.5:1:26`.

use super::settings::key_and_numbers;
use super::{DataSheet, ExperimentResult, Figure, LabError};
use upm_chart::{Chart, Color};
use upm_core::background::on_all_cores;

/// Most points of a sweep.
const MOST_POINTS: usize = 10_000;

/// Receives the share of the work that is done, 0 to 1.
pub type Progress<'a> = &'a (dyn Fn(f64) + Sync);

/// Values of one parameter, evenly spaced.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// Name of the parameter.
    pub key: String,
    /// First and last value.
    pub ends: [f64; 2],
    /// Number of values, at least two.
    pub points: usize,
}

impl Sweep {
    /// The sweep as typed on the command line: `duty=0.5:1:26`.
    ///
    /// # Errors
    ///
    /// Another form.
    pub fn parse(text: &str) -> Result<Self, String> {
        let parse = || {
            let (key, [from, to, points]) = key_and_numbers(text)?;
            let is_allowed = points.fract() == 0.0 && (2.0..=MOST_POINTS as f64).contains(&points);
            is_allowed.then_some(Self { key, ends: [from, to], points: points as usize })
        };
        parse().ok_or_else(|| format!("expected KEY=FROM:TO:POINTS with 2 to {MOST_POINTS} points, found {text:?}"))
    }

    /// Values of the parameter at all points.
    pub fn values(&self) -> Vec<f64> {
        let ([from, to], last) = (self.ends, (self.points - 1) as f64);
        (0..self.points).map(|i| (from * (last - i as f64) + to * i as f64) / last).collect()
    }

    /// Measures at every value, on all cores, and collects the figures of each in one table. Rows of values at which
    /// the machine cannot be measured are empty, with the reason in the notes.
    ///
    /// # Errors
    ///
    /// The first fault, where no value can be measured.
    pub(super) fn run(
        &self,
        measure: impl Fn(f64) -> Result<ExperimentResult, LabError> + Sync,
        progress: Progress<'_>,
    ) -> Result<ExperimentResult, LabError> {
        let values = self.values();
        let found = on_all_cores(&values, progress, |&value| measure(value));
        let Some(first) = found.iter().flatten().next() else {
            return Err(found.into_iter().find_map(Result::err).unwrap_or(LabError::Setting("no points".into())));
        };
        let rows = values.iter().map(|&value| vec![value]).collect();
        let mut sheet = DataSheet { columns: vec![self.key.clone()], rows };
        let mut charts = Vec::new();
        for (i, figure) in first.figures.iter().enumerate() {
            let column: Vec<Option<&Figure>> = found.iter().map(|found| found.as_ref().ok()?.figures.get(i)).collect();
            sheet.add(&heading(figure), column.iter().map(|figure| Some(figure.as_ref()?.measured)));
            if figure.reference.is_some() {
                let name = format!("{}: reference", heading(figure));
                sheet.add(&name, column.iter().map(|figure| figure.as_ref()?.reference));
            }
            charts.push(self.chart(i, figure, &values, &column));
        }
        let (notes, sheet) = (self.notes(&values, &found), Some(sheet));
        Ok(ExperimentResult { notes, charts, sheet, ..ExperimentResult::default() })
    }

    /// Notes of the points and reasons of those that fail; neighbours that say the same share a line.
    fn notes(&self, values: &[f64], found: &[Result<ExperimentResult, LabError>]) -> Vec<String> {
        let mut lines: Vec<(String, [usize; 2])> = Vec::new();
        for (i, found) in found.iter().enumerate() {
            let said = found.as_ref().map_or_else(|fault| vec![fault.to_string()], |outcome| outcome.notes.clone());
            for said in said {
                match lines.iter_mut().find(|(known, [_, last])| *known == said && *last + 1 == i) {
                    Some((_, [_, last])) => *last = i,
                    None => lines.push((said, [i, i])),
                }
            }
        }
        let line = |(said, [first, last]): (String, [usize; 2])| {
            let to = if last > first { format!(" to {}", values[last]) } else { String::new() };
            format!("{}={}{to}: {said}", self.key, values[first])
        };
        lines.into_iter().map(line).collect()
    }

    fn chart(&self, index: usize, figure: &Figure, values: &[f64], column: &[Option<&Figure>]) -> Chart {
        let points = |of: fn(&Figure) -> Option<f64>| {
            let pairs = values.iter().zip(column);
            pairs.filter_map(move |(&x, figure)| Some([x, of((*figure)?)?])).collect::<Vec<_>>()
        };
        let reference = points(|figure| figure.reference);
        let name = format!("sweep-{}-{}", self.key, index + 1);
        let mut chart = Chart::plot(name, figure.name.clone(), [&self.key, &heading(figure)]);
        if !reference.is_empty() {
            chart = chart.line(&figure.source, Color::Blue, reference);
        }
        chart.dots("measured", Color::Orange, points(|figure| Some(figure.measured)))
    }
}

fn heading(figure: &Figure) -> String {
    if figure.unit == "1" { figure.name.clone() } else { format!("{} ({})", figure.name, figure.unit) }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn points_are_in_order_and_those_that_fail_are_empty() {
        let sweep = Sweep { key: "x".into(), ends: [0.0, 9.0], points: 10 };
        let measure = |x: f64| match x {
            4.0 => Err(LabError::Setting("four".into())),
            x => Ok(ExperimentResult {
                figures: vec![Figure::against("square", "mm", x * x, x, "line")],
                notes: if x < 3.0 { vec!["small".into()] } else { Vec::new() },
                ..ExperimentResult::default()
            }),
        };
        let seen = Mutex::new(Vec::new());
        let outcome = sweep.run(measure, &|share| seen.lock().unwrap().push(share)).unwrap();
        let sheet = outcome.sheet.unwrap();
        assert_eq!(sheet.columns, ["x", "square (mm)", "square (mm): reference"]);
        let squares: Vec<f64> = sheet.rows.iter().map(|row| row[1]).filter(|square| !square.is_nan()).collect();
        assert_eq!(squares, [0.0, 1.0, 4.0, 9.0, 25.0, 36.0, 49.0, 64.0, 81.0]);
        assert_eq!(outcome.notes, ["x=0 to 2: small", "x=4: four"]);
        let seen = seen.into_inner().unwrap();
        assert!(seen.len() == 10 && seen.is_sorted() && seen[9] == 1.0, "{seen:?}");
        let all_fail = |_| Err(LabError::Setting("never".into()));
        assert_eq!(sweep.run(all_fail, &|_| ()).unwrap_err(), LabError::Setting("never".into()));
    }
}
