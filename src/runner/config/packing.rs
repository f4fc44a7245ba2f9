//! How many equal discs surely find room in a rectangle.

use super::room::ROUNDING_M;
use upm_core::geometry::Vec2;

/// How many discs of `radius_m` with `gap_m` between rims lie in straight rows and columns in a rectangle of `size_m`. More
/// may lie there interlocked, but not where parts get in and past each other.
pub(super) fn in_rows(size_m: Vec2, radius_m: f64, gap_m: f64) -> usize {
    let along = |length_m: f64| {
        let centers_m = length_m - 2.0 * radius_m + ROUNDING_M;
        if centers_m < 0.0 { 0 } else { (centers_m / (2.0 * radius_m + gap_m)) as usize + 1 }
    };
    along(size_m.x).saturating_mul(along(size_m.y))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::room::fits;
    use super::*;

    fn number(width: f64, height: f64, gap: f64) -> usize {
        in_rows(Vec2::new(width, height), 1.0, gap)
    }

    #[test]
    fn rows_hold_what_they_can() {
        assert_eq!(number(6.0, 4.0, 0.0), 6);
        assert_eq!(number(5.99, 4.0, 0.0), 4);
        assert_eq!(number(2.0, 2.0, 5.0), 1);
        assert_eq!(number(1.99, 30.0, 0.0), 0);
        assert_eq!(number(6.2, 4.2, 0.1), 6);
        assert_eq!(number(6.19, 4.2, 0.1), 4);
    }

    proptest! {
        #[test]
        fn no_more_than_groemers_bound(w in 0.0..0.2f64, h in 0.0..0.2f64, radius in 0.004..0.03f64, gap in 0.0..0.01f64) {
            let count = in_rows(Vec2::new(w, h), radius, gap);
            prop_assert!(fits(&vec![radius; count], w.max(h) + 1e-8, gap));
        }
    }
}
