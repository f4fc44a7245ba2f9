use std::f64::consts::TAU;

use super::Drawing;
use upm_core::geometry::Vec2;

/// Rule that generates any number of places.
#[derive(Clone, Debug, PartialEq)]
pub enum Pattern {
    /// Evenly spaced from one point to another, both included; a single place is in the middle.
    Line {
        /// First place, m.
        from_m: Vec2,
        /// Last place, m.
        to_m: Vec2,
    },
    /// Row by row from the top left. Where one of `rows` and `columns` is `None`, it follows from the number of places.
    Grid {
        /// Centre of the grid, m.
        center_m: Vec2,
        /// Number of rows.
        rows: Option<usize>,
        /// Number of columns.
        columns: Option<usize>,
        /// Distance between neighbours along a row or a column, m.
        spacing_m: f64,
    },
    /// Evenly spaced on a circle.
    Circle {
        /// Centre, m.
        center_m: Vec2,
        /// Distance of the places from the centre, m.
        radius_m: f64,
        /// Direction of the first place from the centre, rad counter-clockwise from x.
        start_rad: f64,
        /// True for clockwise order.
        clockwise: bool,
    },
    /// Evenly spaced along the lines of a drawing.
    Drawn(Drawing),
}

impl Pattern {
    /// Fixed point of the pattern when its size changes, m.
    pub fn center_m(&self) -> Vec2 {
        match self {
            Self::Line { from_m, to_m } => 0.5 * (from_m + to_m),
            Self::Grid { center_m, .. } | Self::Circle { center_m, .. } => *center_m,
            Self::Drawn(drawing) => drawing.center_m,
        }
    }

    /// `count` places, m; `None` if the pattern has fewer places or needs more.
    pub fn places(&self, count: usize) -> Option<Vec<Vec2>> {
        match self {
            Self::Line { from_m, to_m } => {
                let share = |i: usize| if count == 1 { 0.5 } else { i as f64 / (count - 1) as f64 };
                Some((0..count).map(|i| from_m.lerp(to_m, share(i))).collect())
            }
            Self::Grid { center_m, rows, columns, spacing_m } => {
                let (rows, columns) = grid_size(*rows, *columns, count)?;
                let first_m = Vec2::new(columns as f64 - 1.0, 1.0 - rows as f64) * (-0.5 * spacing_m);
                let step = |i: usize| Vec2::new((i % columns) as f64, -((i / columns) as f64)) * *spacing_m;
                Some((0..count).map(|i| center_m + first_m + step(i)).collect())
            }
            Self::Circle { center_m, radius_m, start_rad, clockwise } => {
                let way_rad = if *clockwise { -TAU } else { TAU };
                let place = |i: usize| {
                    let (sin, cos) = libm::sincos(start_rad + way_rad * i as f64 / count as f64);
                    center_m + Vec2::new(cos, sin) * *radius_m
                };
                Some((0..count).map(place).collect())
            }
            Self::Drawn(drawing) => drawing.places(count),
        }
    }
}

/// Rows and columns of a grid with `count` places; `None` where it has fewer.
fn grid_size(rows: Option<usize>, columns: Option<usize>, count: usize) -> Option<(usize, usize)> {
    let (rows, columns) = match (rows, columns) {
        (Some(rows), Some(columns)) => (rows, columns),
        (Some(rows), None) => (rows, count.div_ceil(rows.max(1))),
        (None, Some(columns)) => (count.div_ceil(columns.max(1)), columns),
        (None, None) => return None,
    };
    (rows.saturating_mul(columns) >= count && columns > 0).then_some((rows, columns))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = Vec2> {
        (-0.1..0.1f64, -0.1..0.1f64).prop_map(|(x, y)| Vec2::new(x, y))
    }

    proptest! {
        #[test]
        fn line_has_equal_gaps_and_ends_where_it_should(from_m in point(), to_m in point(), count in 2..64_usize) {
            let places = Pattern::Line { from_m, to_m }.places(count).unwrap();
            prop_assert_eq!(places.len(), count);
            prop_assert!((places[0] - from_m).norm() < 1e-12 && (places[count - 1] - to_m).norm() < 1e-12);
            let gap_m = (to_m - from_m).norm() / (count - 1) as f64;
            prop_assert!(places.windows(2).all(|pair| ((pair[1] - pair[0]).norm() - gap_m).abs() < 1e-12));
        }

        #[test]
        fn circle_has_every_place_at_its_radius_and_equal_gaps(
            center_m in point(), radius_m in 0.001..0.2f64, start_rad in -7.0..7.0f64, count in 1..64_usize,
            clockwise: bool,
        ) {
            let places = Pattern::Circle { center_m, radius_m, start_rad, clockwise }.places(count).unwrap();
            prop_assert_eq!(places.len(), count);
            prop_assert!(places.iter().all(|place| ((place - center_m).norm() - radius_m).abs() < 1e-12));
            let chord_m = 2.0 * radius_m * (0.5 * TAU / count as f64).sin();
            let next = places.iter().cycle().skip(1);
            prop_assert!(places.iter().zip(next).all(|(a, b)| ((a - b).norm() - chord_m).abs() < 1e-12));
        }

        #[test]
        fn grid_is_as_wide_as_its_columns_and_has_no_two_places_nearer_than_its_spacing(
            center_m in point(), rows in 1..9_usize, columns in 1..9_usize, spacing_m in 0.01..0.05f64,
        ) {
            let count = rows * columns;
            let grid = |rows, columns| Pattern::Grid { center_m, rows, columns, spacing_m };
            let places = grid(Some(rows), Some(columns)).places(count).unwrap();
            prop_assert_eq!(grid(Some(rows), None).places(count).unwrap(), &places[..]);
            prop_assert_eq!(grid(None, Some(columns)).places(count).unwrap(), &places[..]);
            prop_assert_eq!(grid(Some(rows), Some(columns)).places(count + 1), None);
            let extent = places.iter().fold(Vec2::zeros(), |most, place| most.sup(&(place - center_m).abs()));
            let expected = Vec2::new((columns - 1) as f64, (rows - 1) as f64) * (0.5 * spacing_m);
            prop_assert!((extent - expected).norm() < 1e-12);
            for (i, a) in places.iter().enumerate() {
                prop_assert!(places[..i].iter().all(|b| (a - b).norm() > spacing_m - 1e-12));
            }
        }
    }
}
