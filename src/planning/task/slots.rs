use upm_core::geometry::Vec2;

/// Bisections that find a pattern's stretch.
const HALVINGS: usize = 20;

/// Distance from the middle that counts as zero, m.
const ROUNDING_M: f64 = 1e-9;

/// Slots for discs in a rectangle.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Slots {
    /// Centres from the rectangle's middle, m, in the order of the radii.
    pub(super) centers_m: Vec<Vec2>,
    /// Least gap between rims, or twice that between a rim and a side where it is less, m; negative where there is not
    /// enough room.
    pub(super) gap_m: f64,
}

impl Slots {
    /// Slots in rows or columns with the largest possible gap, symmetric about the middle for equal discs.
    pub(super) fn new(size_m: Vec2, radii_m: &[f64]) -> Self {
        let mut best = Self { centers_m: vec![Vec2::zeros(); radii_m.len()], gap_m: f64::NEG_INFINITY };
        for rows in 1..=radii_m.len() {
            for common_pitch in [false, true] {
                let across = in_rows(size_m, radii_m, rows, common_pitch);
                let upright = in_rows(size_m.yx(), radii_m, rows, common_pitch).iter().map(|p| p.yx()).collect();
                for mut centers_m in [across, upright] {
                    spread(size_m, radii_m, &mut centers_m);
                    let gap_m = side_gap_m(size_m, radii_m, &centers_m).min(gap_m(radii_m, &centers_m));
                    if gap_m > best.gap_m + 1e-9 {
                        best = Self { centers_m, gap_m };
                    }
                }
            }
        }
        best
    }
}

/// Numbers of discs in each row: as even as possible, symmetric, the longer rows outside.
fn counts(discs: usize, rows: usize) -> Vec<usize> {
    let (each, longer) = (discs / rows, discs % rows);
    let mut counts = vec![each; rows];
    let in_the_middle = longer % 2 * (rows % 2);
    counts[rows / 2] += in_the_middle;
    for k in 0..longer - in_the_middle {
        counts[if k % 2 == 0 { k / 2 } else { rows - 1 - k / 2 }] += 1;
    }
    counts
}

/// Centres of discs row by row from below, m. Within a row every disc's share of the width exceeds its diameter by the
/// same amount; with a common pitch it is the longest row's amount in all rows. Rows share the height likewise.
fn in_rows(size_m: Vec2, radii_m: &[f64], rows: usize, common_pitch: bool) -> Vec<Vec2> {
    let mut left = radii_m;
    let counts = counts(radii_m.len(), rows).into_iter();
    let rows: Vec<&[f64]> = counts.map(|count| left.split_off(..count).unwrap_or_default()).collect();
    let widest = |row: &[f64]| row.iter().copied().fold(0.0, f64::max);
    let rest_m = |row: &[f64]| (size_m.x - 2.0 * row.iter().sum::<f64>()) / row.len().max(1) as f64;
    let common_m = rows.iter().map(|row| rest_m(row)).fold(f64::INFINITY, f64::min);
    let heights: Vec<f64> = rows.iter().map(|row| widest(row)).collect();
    let rest_y_m = (size_m.y - 2.0 * heights.iter().sum::<f64>()) / rows.len() as f64;
    let mut centers_m = Vec::with_capacity(radii_m.len());
    for (row, y) in rows.iter().zip(side_by_side(&heights, rest_y_m)) {
        let gap_m = if common_pitch { common_m } else { rest_m(row) };
        centers_m.extend(side_by_side(row, gap_m).map(|x| Vec2::new(x, y)));
    }
    centers_m
}

/// Centres of discs side by side with `gap_m` between rims, about the middle of the row.
fn side_by_side(radii_m: &[f64], gap_m: f64) -> impl Iterator<Item = f64> {
    let whole_m: f64 = radii_m.iter().map(|radius_m| 2.0 * radius_m + gap_m).sum();
    let mut edge_m = -0.5 * whole_m;
    radii_m.iter().map(move |radius_m| {
        let center_m = edge_m + radius_m + 0.5 * gap_m;
        edge_m += 2.0 * radius_m + gap_m;
        center_m
    })
}

/// Stretches a pattern until the gaps between discs equal twice those to the sides.
fn spread(size_m: Vec2, radii_m: &[f64], centers_m: &mut [Vec2]) {
    let pattern_m = centers_m.to_vec();
    let (mut least_m, mut most_m) = (0.0, 0.5 * size_m.min());
    for _ in 0..HALVINGS {
        let margin_m = 0.5 * (least_m + most_m);
        let room = |axis: usize| {
            let room = |(center_m, radius_m): (&Vec2, &f64)| {
                (0.5 * size_m[axis] - radius_m - margin_m) / center_m[axis].abs().max(ROUNDING_M)
            };
            pattern_m.iter().zip(radii_m).map(room).fold(f64::INFINITY, f64::min)
        };
        let scale = Vec2::new(room(0), room(1)).sup(&Vec2::zeros());
        for (center_m, pattern_m) in centers_m.iter_mut().zip(&pattern_m) {
            *center_m = pattern_m.component_mul(&scale);
        }
        if gap_m(radii_m, centers_m) > 2.0 * margin_m { least_m = margin_m } else { most_m = margin_m }
    }
}

/// Twice the least gap between a rim and a side.
fn side_gap_m(size_m: Vec2, radii_m: &[f64], centers_m: &[Vec2]) -> f64 {
    let gap_m = |(center_m, radius_m): (&Vec2, &f64)| 2.0 * ((0.5 * size_m - center_m.abs()).min() - radius_m);
    centers_m.iter().zip(radii_m).map(gap_m).fold(f64::INFINITY, f64::min)
}

/// Least gap between two rims.
fn gap_m(radii_m: &[f64], centers_m: &[Vec2]) -> f64 {
    let mut gap_m = f64::INFINITY;
    for (i, (center_m, radius_m)) in centers_m.iter().zip(radii_m).enumerate() {
        for (other_m, other_radius_m) in centers_m.iter().zip(radii_m).take(i) {
            gap_m = gap_m.min((center_m - other_m).norm() - radius_m - other_radius_m);
        }
    }
    gap_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rows_are_even_and_symmetric() {
        for (discs, rows, expected) in [
            (6, 2, vec![3, 3]),
            (5, 3, vec![2, 1, 2]),
            (7, 3, vec![2, 3, 2]),
            (8, 3, vec![3, 2, 3]),
            (10, 4, vec![3, 2, 2, 3]),
            (4, 4, vec![1; 4]),
        ] {
            assert_eq!(counts(discs, rows), expected, "{discs} in {rows}");
        }
    }

    proptest! {
        #[test]
        fn gaps_are_at_least_as_wide_as_returned(width in 0.03..0.2f64, height in 0.03..0.2f64, radii in proptest::collection::vec(0.008..0.013f64, 1..14)) {
            let Slots { centers_m, gap_m } = Slots::new(Vec2::new(width, height), &radii);
            prop_assert_eq!(centers_m.len(), radii.len());
            for (i, (center, radius)) in centers_m.iter().zip(&radii).enumerate() {
                let side = (0.5 * width - center.x.abs()).min(0.5 * height - center.y.abs()) - radius;
                prop_assert!(2.0 * side >= gap_m - 1e-12);
                for (other, other_radius) in centers_m.iter().zip(&radii).take(i) {
                    prop_assert!((center - other).norm() - radius - other_radius >= gap_m - 1e-12);
                }
            }
        }

    }
}
