//! How many equal discs surely find room in a rectangle.

use super::room::ROUNDING_M;
use crate::geometry::Vec2;

/// Up to `most` places for discs of `radius_m` with `gap_m` between rims in a rectangle of `size_m`, from its lower left
/// corner, m: straight or interlocked rows along either side, whichever hold more. There may be room for more
/// yet, in an order less plain.
pub(super) fn places_in(size_m: Vec2, radius_m: f64, gap_m: f64, most: usize) -> Vec<Vec2> {
    let centers_m = size_m.add_scalar(-2.0 * radius_m + ROUNDING_M);
    let pitch_m = 2.0 * radius_m + gap_m;
    let upright = |row_m: f64, shift_m: f64| -> Vec<Vec2> {
        rows(centers_m, pitch_m, row_m, shift_m).take(most).map(|p| p.add_scalar(radius_m)).collect()
    };
    let lying = |row_m: f64, shift_m: f64| -> Vec<Vec2> {
        rows(centers_m.yx(), pitch_m, row_m, shift_m).take(most).map(|p| p.yx().add_scalar(radius_m)).collect()
    };
    let (row_m, shift_m) = (0.75_f64.sqrt() * pitch_m, 0.5 * pitch_m);
    let ways = [upright(pitch_m, 0.0), upright(row_m, shift_m), lying(row_m, shift_m)];
    ways.into_iter().reduce(|best, next| if next.len() > best.len() { next } else { best }).unwrap_or_default()
}

/// Points in a rectangle of `size_m`, `pitch_m` apart in rows `row_m` apart, every other row shifted by `shift_m`.
fn rows(size_m: Vec2, pitch_m: f64, row_m: f64, shift_m: f64) -> impl Iterator<Item = Vec2> {
    let steps = |length_m: f64, step_m: f64| if length_m < 0.0 { 0 } else { (length_m / step_m) as usize + 1 };
    (0..steps(size_m.y, row_m)).flat_map(move |row| {
        let first_m = if row % 2 == 1 { shift_m } else { 0.0 };
        let along = steps(size_m.x - first_m, pitch_m);
        (0..along).map(move |k| Vec2::new(first_m + k as f64 * pitch_m, row as f64 * row_m))
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::room::fits;
    use super::*;

    fn number(width: f64, height: f64, gap: f64) -> usize {
        places_in(Vec2::new(width, height), 1.0, gap, usize::MAX).len()
    }

    #[test]
    fn known_packings_are_found() {
        assert_eq!(number(6.0, 4.0, 0.0), 6);
        assert_eq!(number(5.99, 4.0, 0.0), 5, "columns of 2, 1 and 2, interlocked");
        assert_eq!(number(5.4, 4.0, 0.0), 4);
        assert_eq!(number(2.0, 2.0, 5.0), 1);
        assert_eq!(number(1.99, 30.0, 0.0), 0);
        assert_eq!(number(6.2, 4.2, 0.1), 6);
        // rows of 6 and 5 in turn, interlocked, 2 + 6 √3 high, standing and lying
        assert_eq!(number(12.0, 12.393, 0.0), 39);
        assert_eq!(number(12.393, 12.0, 0.0), 39);
        assert_eq!(places_in(Vec2::new(1e9, 1e9), 1.0, 0.0, 5).len(), 5);
    }

    proptest! {
        #[test]
        fn places_are_inside_and_apart(w in 0.0..0.2f64, h in 0.0..0.2f64, radius in 0.004..0.03f64, gap in 0.0..0.01f64) {
            let places = places_in(Vec2::new(w, h), radius, gap, 64);
            for (i, p) in places.iter().enumerate() {
                prop_assert!(p.min() >= radius && p.x <= w - radius + 2e-9 && p.y <= h - radius + 2e-9);
                prop_assert!(places[..i].iter().all(|q| (p - q).norm() >= 2.0 * radius + gap - 1e-12));
            }
            // no more than Groemer's bound leaves in the square around the rectangle
            prop_assert!(fits(&vec![radius; places.len()], w.max(h) + 1e-8, gap));
        }
    }
}
