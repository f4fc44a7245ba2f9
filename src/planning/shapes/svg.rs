//! Drawings from SVG path data. SVG has y downwards and the table upwards; drawings keep their orientation on a screen.

use kurbo::{Affine, BezPath, Shape};
use svgtypes::{SimplePathSegment, SimplifyingPathParser};

use super::Drawing;
use super::drawing::{Knots, flattened};
use upm_core::geometry::Vec2;

/// Most lines of a drawing; no plate has parts for more.
const MOST_LINES: usize = 256;

/// Most points of a drawing's lines once its curves are straight pieces; bounds their memory.
const MOST_POINTS: usize = 1_000_000;

/// Greatest ratio of a drawing's derived side to the side given.
const MOST_SHAPE: f64 = 1e3;

impl Drawing {
    /// Drawing of the path data `d` with the middle of its extent at `center_m`, of this width or else of this height.
    ///
    /// # Errors
    /// The fault of `d` where it is not valid path data, has too many lines or points, draws nothing, or has next to no
    /// extent along the given axis.
    pub fn of_svg(d: &str, width_m: Option<f64>, height_m: Option<f64>, center_m: Vec2) -> Result<Self, String> {
        let mut path = parsed(d)?;
        let lines = path.subpaths().count();
        if lines > MOST_LINES {
            return Err(format!("{lines} lines"));
        }
        if path.segments().next().is_none() {
            return Err("no line".to_owned());
        }
        let extent = path.bounding_box();
        let unit = if width_m.is_some() { extent.width() } else { extent.height() };
        let shape = extent.width().max(extent.height()) / unit;
        if shape.is_nan() || shape > MOST_SHAPE {
            return Err("a drawing with next to no extent along that axis".to_owned());
        }
        path.apply_affine(
            Affine::scale_non_uniform(1.0 / unit, -1.0 / unit) * Affine::translate(-extent.center().to_vec2()),
        );
        let mut points = 0;
        let fits = |segment| {
            points += flattened(segment).len();
            points <= MOST_POINTS
        };
        if !path.segments().all(fits) {
            return Err(format!("curves of more than {MOST_POINTS} straight pieces"));
        }
        Ok(Self::of_path(&path, Knots::Ends, width_m.or(height_m).unwrap_or_default(), center_m))
    }
}

/// Parsed path data.
pub(super) fn parsed(d: &str) -> Result<BezPath, String> {
    let mut path = BezPath::new();
    for segment in SimplifyingPathParser::from(d) {
        match segment.map_err(|error| error.to_string())? {
            SimplePathSegment::MoveTo { x, y } => path.move_to((x, y)),
            SimplePathSegment::LineTo { x, y } => path.line_to((x, y)),
            SimplePathSegment::CurveTo { x1, y1, x2, y2, x, y } => path.curve_to((x1, y1), (x2, y2), (x, y)),
            SimplePathSegment::Quadratic { x1, y1, x, y } => path.quad_to((x1, y1), (x, y)),
            SimplePathSegment::ClosePath => path.close_path(),
        }
    }
    let is_small = |x: f64| x.abs() <= 1e9;
    let extent = path.control_box();
    let fits = path.is_empty() || [extent.x0, extent.y0, extent.x1, extent.y1].into_iter().all(is_small);
    if path.is_finite() && fits { Ok(path) } else { Err("a number out of range".to_owned()) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn extent(places: &[Vec2]) -> [Vec2; 2] {
        let far = Vec2::repeat(f64::INFINITY);
        let wider = |[low, high]: [Vec2; 2], place: &Vec2| [low.inf(place), high.sup(place)];
        places.iter().fold([far, -far], wider)
    }

    #[test]
    fn drawing_is_upright_and_at_its_place() {
        let center_m = Vec2::new(0.01, 0.02);
        let tee = Drawing::of_svg("m 10 10 h 20 m -10 0 v 40", None, Some(0.08), center_m).unwrap();
        let places = tee.places(tee.fewest()).unwrap();
        let [low, high] = extent(&places);
        assert!((low - Vec2::new(-0.01, -0.02)).norm() < 1e-12 && (high - Vec2::new(0.03, 0.06)).norm() < 1e-12);
        let at_top = places.iter().filter(|place| (place.y - 0.06).abs() < 1e-12).count();
        assert_eq!(at_top, 3, "the bar is at the top: {places:?}");
    }

    proptest! {
        #[test]
        fn drawing_is_as_wide_as_asked_for_and_its_places_are_evenly_spaced(
            corners in proptest::collection::vec((-50..50_i32, -50..50_i32), 3..9), count in 2..40_usize,
            width_m in 0.01..0.2f64,
        ) {
            let d: String = corners.iter().enumerate()
                .map(|(i, (x, y))| format!("{}{x} {y}", if i == 0 { "M" } else { "L" })).collect();
            prop_assume!(corners.iter().any(|(x, _)| *x != corners[0].0));
            prop_assume!(corners.first() != corners.last());
            let drawing = Drawing::of_svg(&d, Some(width_m), None, Vec2::zeros()).unwrap();
            let points = drawing.single_line().unwrap();
            let [low, high] = extent(&points);
            prop_assert!((high.x - low.x - width_m).abs() < 1e-9);
            let length_m: f64 = points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
            let places = drawing.places(count).unwrap();
            prop_assert_eq!(places.len(), count);
            let gap_m = length_m / (count - 1) as f64;
            prop_assert!(places.windows(2).all(|pair| (pair[1] - pair[0]).norm() <= gap_m + 1e-9));
        }

        #[test]
        fn no_text_makes_it_panic(d in "[MmLlHhVvCcSsQqTtAaZz0-9 .,eE+-]{0,40}") {
            if let Ok(drawing) = Drawing::of_svg(&d, None, Some(0.1), Vec2::zeros()) {
                let places = drawing.places(drawing.fewest() + 5).unwrap_or_default();
                prop_assert!(places.iter().all(|place| place.iter().all(|x| x.is_finite())));
            }
        }
    }
}
