//! The table of a plan: what one pulse does at the start and the target of each part. Columns that do not change are
//! stated once, above it.

use super::coverage_report::{degrees, mm, shown};
use upm_runner::run::{PartForecast, StartForecast};

/// Values of a column that differ by less than this share of the largest are stated once.
pub(super) const SAME: f64 = 0.05;

/// Directions of which none differs by more than this from the first one are stated once, degrees.
const SAME_DIRECTION_DEG: f64 = 5.0;

/// Start and, where there is one, target of a part.
pub(super) fn spots(part: &PartForecast) -> impl Iterator<Item = (&'static str, &StartForecast)> {
    [("start", Some(&part.start)), ("target", part.target.as_ref())]
        .into_iter()
        .filter_map(|(name, spot)| Some((name, spot?)))
}

/// A column of numbers.
struct PlanColumn {
    head: &'static str,
    /// Name in the line of what does not change.
    name: &'static str,
    unit: &'static str,
    places: usize,
    /// One value per row; NaN for a row without a value.
    values: Vec<f64>,
    /// Difference of two values above which the column changes.
    tolerance: f64,
    /// Period of the values, 180 deg for directions; `None` for a quantity.
    period: Option<f64>,
}

impl PlanColumn {
    fn new(head: &'static str, name: &'static str, (unit, places): (&'static str, usize), values: Vec<f64>) -> Self {
        let size = values.iter().fold(0.0, |size: f64, value| size.max(value.abs()));
        Self { head, name, unit, places, values, tolerance: SAME * size, period: None }
    }

    /// A column of directions modulo their opposites, degrees.
    fn of_directions(head: &'static str, name: &'static str, values: Vec<f64>) -> Self {
        let column = Self::new(head, name, (" deg", 0), values);
        Self { tolerance: SAME_DIRECTION_DEG, period: Some(180.0), ..column }
    }

    fn text(&self, value: f64) -> String {
        match value.is_nan() {
            true => "-".into(),
            false => format!("{value:.0$}", self.places),
        }
    }

    /// Least and largest value; `None` for a column without values.
    fn range(&self) -> Option<[f64; 2]> {
        let known = || self.values.iter().copied().filter(|value| !value.is_nan());
        let least = known().reduce(f64::min)?;
        Some([least, known().fold(least, f64::max)])
    }

    fn changes(&self) -> bool {
        let Some([least, most]) = self.range() else { return false };
        if self.values.iter().any(|value| value.is_nan()) {
            return true;
        }
        match self.period {
            None => most - least > self.tolerance,
            // directions on both sides of 0 are near each other, but have no range to state
            Some(period) if most - least > 0.5 * period => true,
            Some(_) => self.values.iter().any(|value| (value - self.values[0]).abs() > self.tolerance),
        }
    }

    /// The values as they are stated once: `longest step 26.15 to 26.77 mm`, or `no shortest step`.
    fn stated(&self) -> String {
        let Some(range) = self.range() else { return format!("no {}", self.name) };
        let [least, most] = range.map(|value| self.text(value));
        let range = if least == most { least } else { format!("{least} to {most}") };
        format!("{} {range}{}", self.name, self.unit)
    }
}

/// A line of what is the same everywhere, if anything is, then the table with a header and one line per part and place.
pub(super) fn lines(parts: &[PartForecast]) -> Vec<String> {
    let rows: Vec<(&str, &str, &StartForecast)> =
        parts.iter().flat_map(|part| spots(part).map(|(name, spot)| (part.id.as_str(), name, spot))).collect();
    // a single row has nothing that it could differ from
    let is_shown = |column: &PlanColumn| rows.len() < 2 || column.changes();
    let (shown_columns, same): (Vec<PlanColumn>, Vec<PlanColumn>) = columns(&rows).into_iter().partition(is_shown);
    let mut lines = Vec::new();
    if !same.is_empty() {
        let stated: Vec<String> = same.iter().map(PlanColumn::stated).collect();
        lines.push(format!("{:16} {}", "everywhere", stated.join(", ")));
    }
    let has_targets = rows.iter().any(|(_, name, _)| *name == "target");
    let wide = rows.iter().map(|(part, ..)| part.len()).max().unwrap_or(0).max(4);
    let line = |part: &str, place: &str, at: &str, cells: &[String]| {
        let place = if has_targets { format!("  {place:6}") } else { String::new() };
        format!("{part:wide$}{place}  {at:16}{}", cells.concat()).trim_end().to_owned()
    };
    let width = |column: &PlanColumn| {
        column.values.iter().map(|&value| column.text(value).len()).fold(column.head.chars().count(), usize::max)
    };
    let cell = |column: &PlanColumn, text: &str| format!("  {text:>0$}", width(column));
    let heads: Vec<String> = shown_columns.iter().map(|column| cell(column, column.head)).collect();
    lines.push(line("part", "place", if has_targets { "at (mm)" } else { "start (mm)" }, &heads));
    for (i, (part, place, spot)) in rows.iter().enumerate() {
        let cells: Vec<String> =
            shown_columns.iter().map(|column| cell(column, &column.text(column.values[i]))).collect();
        lines.push(line(part, place, &shown(spot.place.position_m), &cells));
    }
    lines
}

/// The effect of one pulse in the weakest direction at each place.
fn columns(rows: &[(&str, &str, &StartForecast)]) -> Vec<PlanColumn> {
    let of = |value: fn(&StartForecast) -> f64| rows.iter().map(|(.., spot)| value(spot)).collect::<Vec<f64>>();
    let longest = of(|spot| mm(spot.place.longest_step_m));
    let size = longest.iter().copied().fold(0.0, f64::max);
    let mm_2 = (" mm", 2);
    vec![
        PlanColumn::of_directions(
            "weakest (deg)",
            "weakest direction",
            of(|spot| degrees(spot.place.weakest_direction)),
        ),
        PlanColumn::new("share", "share of the best step", ("", 2), of(|spot| spot.place.share)),
        PlanColumn::new(
            "shortest (mm)",
            "shortest step",
            mm_2,
            of(|spot| spot.place.shortest_step_m.map_or(f64::NAN, mm)),
        ),
        PlanColumn::new("longest (mm)", "longest step", mm_2, longest),
        // small beside the step, so that its changes are held against the step
        PlanColumn {
            tolerance: SAME * size,
            ..PlanColumn::new("sd (mm)", "its sd", mm_2, of(|spot| mm(spot.place.longest_sd_m)))
        },
        PlanColumn::new("sv 1", "first singular value", ("", 2), of(|spot| spot.singular_values[0])),
        PlanColumn::new("sv 2", "second singular value", ("", 2), of(|spot| spot.singular_values[1])),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::geometry::Vec2;
    use upm_runner::run::WorstDirection;

    fn spot(x_m: f64, longest_step_m: f64, shortest_step_m: Option<f64>) -> StartForecast {
        let place = WorstDirection {
            position_m: Vec2::new(x_m, 0.0),
            weakest_direction: Vec2::x(),
            share: 0.9,
            longest_step_m,
            longest_sd_m: 1e-5,
            shortest_step_m,
        };
        StartForecast { place, singular_values: [4.0, 2.0 + 10.0 * x_m] }
    }

    fn part(id: &str, start: StartForecast, target: Option<StartForecast>) -> PartForecast {
        PartForecast { id: id.to_owned(), radius_m: 0.0095, start, target }
    }

    #[test]
    fn columns_that_do_not_change_are_stated_once() {
        let parts = [
            part("penny-1", spot(0.0, 0.02615, Some(1e-4)), Some(spot(0.05, 0.02677, Some(2e-4)))),
            part("penny-2", spot(0.1, 0.0262, Some(1e-4)), None),
        ];
        assert_eq!(
            lines(&parts),
            [
                "everywhere       weakest direction 0 deg, share of the best step 0.90, longest step 26.15 to 26.77 mm, \
                 its sd 0.01 mm, first singular value 4.00",
                "part     place   at (mm)           shortest (mm)  sv 2",
                "penny-1  start   (0.0, 0.0)                 0.10  2.00",
                "penny-1  target  (50.0, 0.0)                0.20  2.50",
                "penny-2  start   (100.0, 0.0)               0.10  3.00",
            ]
        );
    }

    #[test]
    fn one_place_has_all_its_columns_and_a_missing_step_is_a_change() {
        let one = lines(&[part("dime-1", spot(0.0, 0.02, None), None)]);
        assert_eq!(one.len(), 2);
        assert!(one[0].starts_with("part    start (mm)") && one[0].contains("longest (mm)"), "{one:?}");
        assert!(one[1].split_whitespace().any(|cell| cell == "-"), "{one:?}");
        let two = [part("a-1", spot(0.0, 0.02, None), None), part("a-2", spot(0.0, 0.02, Some(1e-4)), None)];
        let two = lines(&two);
        assert!(two[1].contains("shortest (mm)") && !two[1].contains("longest (mm)"), "{two:?}");
    }

    #[test]
    fn missing_shortest_step_is_stated_in_words() {
        let parts = [part("a-1", spot(0.0, 0.02, None), None), part("a-2", spot(0.0, 0.02, None), None)];
        let lines = lines(&parts);
        assert!(lines[0].contains(", no shortest step, longest step 20.00 mm,"), "{lines:?}");
        assert!(!lines.concat().contains("inf"), "{lines:?}");
    }

    #[test]
    fn directions_are_compared_modulo_their_opposites() {
        let table = |first_deg: f64, second_deg: f64| {
            let towards = |deg: f64| {
                let mut spot = spot(0.0, 0.02, None);
                let (sin, cos) = deg.to_radians().sin_cos();
                spot.place.weakest_direction = Vec2::new(cos, sin);
                spot
            };
            lines(&[part("a-1", towards(first_deg), None), part("a-2", towards(second_deg), None)])
        };
        let near = table(1.0, 2.0);
        assert!(near[0].contains("weakest direction 1 to 2 deg") && !near[1].contains("weakest"), "{near:?}");
        for (first_deg, second_deg) in [(170.0, 178.0), (179.0, 1.0)] {
            let table = table(first_deg, second_deg);
            assert!(!table[0].contains("weakest") && table[1].contains("weakest (deg)"), "{table:?}");
            for (row, deg) in table[2..].iter().zip([first_deg, second_deg]) {
                assert!(row.ends_with(&format!("  {deg}")), "{row}");
            }
        }
    }
}
