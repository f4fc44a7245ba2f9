//! Closed curves as polylines that end at their first point. The number of points does not depend on the size, so a
//! curve scaled by two has the same points at twice the distance from its centre.

use std::f64::consts::TAU;

use super::TOLERANCE_M;
use upm_core::geometry::Vec2;

/// Segments of a circle: one per degree, within the tolerance up to a radius of 1.3 m.
const CIRCLE_PIECES: usize = 360;

/// Largest figure for which the tolerance holds, m.
const LARGEST_M: f64 = 1.0;

/// One turn of a circle from `start_rad`, counter-clockwise or clockwise. All points are on the circle.
pub fn circle_path(center_m: Vec2, radius_m: f64, start_rad: f64, clockwise: bool) -> Vec<Vec2> {
    let way_rad = if clockwise { -TAU } else { TAU };
    closed(CIRCLE_PIECES, |share| {
        let (sin, cos) = libm::sincos(start_rad + way_rad * share);
        center_m + radius_m * Vec2::new(cos, sin)
    })
}

/// One period of the figure `x = w/2 sin(a t + phase)`, `y = h/2 sin(b t)` about `center_m` as a closed polyline, m.
/// `size_m` is its width and height, the frequencies `a` and `b` are coprime.
pub fn lissajous_path(center_m: Vec2, size_m: Vec2, frequencies: [u32; 2], phase_rad: f64) -> Vec<Vec2> {
    let [a, b] = frequencies.map(f64::from);
    // a segment over a time h deviates from the curve by at most h²/8 times the greatest acceleration; without a phase
    // there is a point wherever x or y is greatest
    let most = 0.5 * LARGEST_M * Vec2::new(a * a, b * b).norm();
    let least = TAU / (8.0 * TOLERANCE_M / most).sqrt();
    let pieces = (4.0 * a * b * (least / (4.0 * a * b)).ceil()) as usize;
    let reach_m = 0.5 * size_m;
    closed(pieces, |share| {
        let time = TAU * share;
        let along = Vec2::new(libm::sin(a * time + phase_rad), libm::sin(b * time));
        center_m + reach_m.component_mul(&along)
    })
}

/// Closed polyline with `pieces` segments.
fn closed(pieces: usize, at_share: impl Fn(f64) -> Vec2) -> Vec<Vec2> {
    // the last point equals the first bit for bit
    (0..=pieces).map(|i| at_share((i % pieces) as f64 / pieces as f64)).collect()
}

/// Closed polyline through `points_m` and back to the first, rotated to begin and end at `share` of its length.
pub fn closed_from(points_m: &[Vec2], share: f64) -> Vec<Vec2> {
    let mut around: Vec<Vec2> = points_m.to_vec();
    around.extend(points_m.first());
    let lengths_m: Vec<f64> = around.windows(2).map(|pair| (pair[1] - pair[0]).norm()).collect();
    let begin_m = share * lengths_m.iter().sum::<f64>();
    let mut passed_m = 0.0;
    for (i, &length_m) in lengths_m.iter().enumerate() {
        if length_m > 0.0 && begin_m < passed_m + length_m {
            let begin = around[i].lerp(&around[i + 1], (begin_m - passed_m) / length_m);
            let rest = points_m[i + 1..].iter().chain(&points_m[..=i]).copied();
            return [begin].into_iter().chain(rest).chain([begin]).collect();
        }
        passed_m += length_m;
    }
    around
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use upm_core::geometry::Segment;

    proptest! {
        #[test]
        fn circle_is_kept_to_within_the_tolerance(radius_m in 1e-3..0.2f64, start_rad in -4.0..4.0f64, clockwise: bool) {
            let center_m = Vec2::new(0.02, -0.03);
            let points = circle_path(center_m, radius_m, start_rad, clockwise);
            prop_assert_eq!(points.first(), points.last());
            prop_assert!(points.iter().all(|point| ((point - center_m).norm() - radius_m).abs() < 1e-12));
            for pair in points.windows(2) {
                let middle_m = (0.5 * (pair[0] + pair[1]) - center_m).norm();
                prop_assert!(radius_m - middle_m <= TOLERANCE_M * (1.0 + 1e-9));
                let turn = (pair[0] - center_m).perp(&(pair[1] - center_m));
                prop_assert_eq!(turn < 0.0, clockwise);
            }
        }

        #[test]
        fn lissajous_figure_is_kept_to_within_the_tolerance(
            width_m in 0.01..0.25f64, height_m in 0.01..0.25f64, a in 1..6_u32, b in 1..6_u32, phase_rad in -4.0..4.0f64,
            time in 0.0..TAU,
        ) {
            let center_m = Vec2::new(0.01, 0.02);
            let points = lissajous_path(center_m, Vec2::new(width_m, height_m), [a, b], phase_rad);
            prop_assert_eq!(points.first(), points.last());
            let offset = Vec2::new(
                0.5 * width_m * (f64::from(a) * time + phase_rad).sin(), 0.5 * height_m * (f64::from(b) * time).sin(),
            );
            let truth = center_m + offset;
            let off_m = points.windows(2).map(|pair| Segment { from: pair[0], to: pair[1] }.distance(truth));
            prop_assert!(off_m.fold(f64::INFINITY, f64::min) <= TOLERANCE_M * (1.0 + 1e-9));
        }

    }
}
