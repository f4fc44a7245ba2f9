//! Places for the parts, typed one by one or made by a rule.

use super::fit::{Growth, Shape};
use super::raw_shapes::{RawCircle, RawGrid, RawLine, RawSvg, RawTargets, RawText};
use super::read::{exactly_one, point_m};
use super::room::{REST_GAP_M, REST_MARGIN_M, check_apart, check_inside};
use super::task::Scene;
use upm_core::geometry::Vec2;
use upm_core::units::{m_from_mm, mm_from_m};
use upm_document::{Faults, Path, counted, quoted};
use upm_shapes::{Drawing, Pattern, Size, known_letters};

impl Scene<'_> {
    /// A place for each part, m; faults where parts would not have room there.
    pub(super) fn targets(
        &self,
        typed_mm: Option<&[[f64; 2]]>,
        made: Option<&RawTargets>,
        faults: &mut Faults,
    ) -> Option<Vec<Vec2>> {
        match (typed_mm, made) {
            (Some(targets_mm), None) => Some(self.typed_targets(targets_mm, faults)),
            (None, Some(raw)) => self.made_targets(raw, &self.at.key("targets"), faults),
            (Some(_), Some(_)) => {
                faults.push(self.at.key("targets"), "targets and targets_mm", "one of the two");
                None
            }
            (None, None) => {
                let allowed = "a list of places, or targets with one of line, grid, circle, text, svg";
                faults.push_missing(self.at.key("targets_mm"), allowed);
                None
            }
        }
    }

    fn typed_targets(&self, targets_mm: &[[f64; 2]], faults: &mut Faults) -> Vec<Vec2> {
        let at = self.at.key("targets_mm");
        self.demand_one_each(targets_mm.len(), "target", &at, faults);
        let targets_m: Vec<Vec2> = targets_mm.iter().copied().map(point_m).collect();
        let discs: Vec<(Vec2, f64, Path)> =
            targets_m.iter().zip(&self.radii_m).zip(0..).map(|((&to, &radius), i)| (to, radius, at.index(i))).collect();
        for (target_m, radius_m, at) in &discs {
            check_inside(*target_m, *radius_m, self.half_m, REST_MARGIN_M, at, faults);
        }
        check_apart(&discs, REST_GAP_M, faults);
        targets_m
    }

    fn made_targets(&self, raw: &RawTargets, at: &Path, faults: &mut Faults) -> Option<Vec<Vec2>> {
        let RawTargets { line, grid, circle, text, svg } = raw;
        let keys = [
            ("line", line.is_some()),
            ("grid", grid.is_some()),
            ("circle", circle.is_some()),
            ("text", text.is_some()),
            ("svg", svg.is_some()),
        ];
        if !exactly_one(&keys, at, faults) {
            return None;
        }
        let shape = if let Some(raw) = line {
            line_of(raw, at.key("line"))
        } else if let Some(raw) = grid {
            self.grid(raw, at.key("grid"), faults)?
        } else if let Some(raw) = circle {
            circle_of(raw, at.key("circle"))
        } else if let Some(raw) = text {
            self.text(raw, at.key("text"), faults)?
        } else {
            let at = at.key("svg");
            let (drawing, growth) = drawing_of(svg.as_ref()?, &at, faults)?;
            self.drawn(drawing, growth, at, faults)?
        };
        self.places_of(&shape, faults)
    }

    fn grid(&self, raw: &RawGrid, at: Path, faults: &mut Faults) -> Option<Shape> {
        let RawGrid { center_mm, rows, columns, spacing_mm } = raw;
        let center_m = point_m(*center_mm);
        let parts = self.kinds.len();
        if rows.is_none() && columns.is_none() {
            faults.push(&at, "neither rows nor columns", "rows, columns or both");
            return None;
        }
        if let (Some(rows), Some(columns)) = (rows, columns)
            && ((rows * columns) as usize) < parts
        {
            let found = format!("{rows} x {columns} places");
            faults.push(&at, found, format!("{parts} or more, one for each part"));
            return None;
        }
        let [rows, columns] = [rows, columns].map(|number| number.map(|number| number as usize));
        let pattern = Pattern::Grid { center_m, rows, columns, spacing_m: m_from_mm(*spacing_mm) };
        Some(Shape { at, pattern, growth: Growth { name: "spacing_mm", size_mm: vec![*spacing_mm], center_m } })
    }

    fn text(&self, raw: &RawText, at: Path, faults: &mut Faults) -> Option<Shape> {
        let RawText { string, height_mm, center_mm } = raw;
        let center_m = point_m(*center_mm);
        let drawing = Drawing::of_text(string, m_from_mm(*height_mm), center_m);
        let in_string = at.key("string");
        match drawing {
            Ok(drawing) if drawing.fewest() == 0 => {
                faults.push(in_string, quoted(string), "a letter or more");
                None
            }
            Ok(drawing) => {
                let growth = Growth { name: "height_mm", size_mm: vec![*height_mm], center_m };
                self.drawn(drawing, growth, at, faults)
            }
            Err(unknown) => {
                let letters: String = known_letters().collect();
                let allowed = format!("letters of {letters}, small letters as capitals, and spaces");
                faults.push(in_string, format!("{:?} in {}", unknown.0, quoted(string)), allowed);
                None
            }
        }
    }

    /// The drawing with its places; a fault where there are fewer parts than ends and corners.
    fn drawn(&self, drawing: Drawing, growth: Growth, at: Path, faults: &mut Faults) -> Option<Shape> {
        let (parts, fewest) = (self.kinds.len(), drawing.fewest());
        let allowed = format!("{fewest} or more: one at every end and every corner of its lines");
        faults.demand(parts >= fewest, &at, counted(parts, "part"), allowed);
        (parts >= fewest).then_some(Shape { at, pattern: Pattern::Drawn(drawing), growth })
    }
}

fn line_of(raw: &RawLine, at: Path) -> Shape {
    let [from_m, to_m] = [raw.from_mm, raw.to_mm].map(point_m);
    let pattern = Pattern::Line { from_m, to_m };
    let growth =
        Growth { name: "a length", size_mm: vec![mm_from_m((to_m - from_m).norm())], center_m: pattern.center_m() };
    Shape { at, pattern, growth }
}

fn circle_of(raw: &RawCircle, at: Path) -> Shape {
    let RawCircle { center_mm, radius_mm, start_deg, clockwise } = *raw;
    let (center_m, radius_m) = (point_m(center_mm), m_from_mm(radius_mm));
    let pattern = Pattern::Circle { center_m, radius_m, start_rad: start_deg.to_radians(), clockwise };
    Shape { at, pattern, growth: Growth { name: "radius_mm", size_mm: vec![radius_mm], center_m } }
}

/// The drawing at `at`, whose file has been written out.
pub(super) fn drawing_of(raw: &RawSvg, at: &Path, faults: &mut Faults) -> Option<(Drawing, Growth)> {
    let RawSvg { d, width_mm, height_mm, center_mm, .. } = raw;
    let keys = [("width_mm", width_mm.is_some()), ("height_mm", height_mm.is_some())];
    if !exactly_one(&keys, at, faults) {
        return None;
    }
    let (name, size_mm, size) = match (width_mm, height_mm) {
        (Some(mm), _) => ("width_mm", *mm, Size::Width(m_from_mm(*mm))),
        (None, mm) => ("height_mm", mm.unwrap_or_default(), Size::Height(m_from_mm(mm.unwrap_or_default()))),
    };
    let center_m = point_m(*center_mm);
    match Drawing::of_svg(d.as_deref()?, size, center_m) {
        Ok(drawing) => Some((drawing, Growth { name, size_mm: vec![size_mm], center_m })),
        Err(error) => {
            faults.push(at.key("d"), error, "SVG path data that draws up to 256 lines, such as M0 0 H10 V10 Z");
            None
        }
    }
}
