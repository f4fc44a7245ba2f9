use nalgebra::Matrix2;

use super::super::Table;
use upm_core::geometry::Vec2;

/// Map from plate to picture around a part, to second order: `origin + J d + ½ dᵀ H d`, d in radii.
pub(in super::super) struct LocalMap {
    pub(in super::super) origin: Vec2,
    x: Vec2,
    y: Vec2,
    xx: Vec2,
    xy: Vec2,
    yy: Vec2,
}

impl LocalMap {
    /// Expands the map about a point of the plate, m; `None` where its image is not finite.
    pub(in super::super) fn new(table: &Table, origin_m: Vec2, radius_m: f64) -> Option<Self> {
        let at = |x: f64, y: f64| table.image_from_table(origin_m + Vec2::new(x, y) * radius_m);
        let origin = at(0.0, 0.0);
        let (right, left, up, down) = (at(1.0, 0.0), at(-1.0, 0.0), at(0.0, 1.0), at(0.0, -1.0));
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let diagonal = at(half, half) + at(-half, -half);
        let (xx, yy) = ((right + left) / 2.0 - origin, (up + down) / 2.0 - origin);
        let xy = diagonal - origin * 2.0 - xx - yy;
        let map = Self { origin, x: (right - left) / 2.0, y: (up - down) / 2.0, xx, xy, yy };
        [map.origin, map.x, map.y, map.xx, map.xy, map.yy]
            .iter()
            .all(|v| v.x.is_finite() && v.y.is_finite())
            .then_some(map)
    }

    /// Length of one radius, px: the square root of the magnification of areas.
    pub(in super::super) fn radius_px(&self) -> f64 {
        (self.x.x * self.y.y - self.x.y * self.y.x).abs().sqrt()
    }

    /// Linear and quadratic term along a ray.
    pub(in super::super) fn along(&self, u: Vec2) -> (Vec2, Vec2) {
        (self.x * u.x + self.y * u.y, self.xx * (u.x * u.x) + self.xy * (u.x * u.y) + self.yy * (u.y * u.y))
    }

    /// Centre of the area of a circle's image, which is not the image of its centre: with q the map's quadratic part in
    /// radii, it is the mean over the disk of `q + u (∂q/∂u)`. For a perspective picture the ellipse's centre.
    pub(in super::super) fn middle_of_circle(&self, center: Vec2, radius: f64) -> Vec2 {
        let (linear, square) = self.along(center);
        let across = self.x.x * self.y.y - self.x.y * self.y.x;
        let in_radii = |v: Vec2| Vec2::new(v.x * self.y.y - v.y * self.y.x, self.x.x * v.y - self.x.y * v.x) / across;
        let [xx, xy, yy] = [self.xx, self.xy, self.yy].map(in_radii);
        let stretch = Vec2::new(2.0 * xx.x + xy.y, xy.x + 2.0 * yy.y);
        let mean = self.xx + self.yy + self.x * stretch.x + self.y * stretch.y;
        self.origin + linear + square + mean * (0.25 * radius * radius)
    }

    /// Transforms a covariance in radii² to the picture, px².
    pub(in super::super) fn covariance_px2(&self, covariance: Matrix2<f64>) -> Matrix2<f64> {
        let jacobian = Matrix2::from_columns(&[self.x, self.y]);
        jacobian * covariance * jacobian.transpose()
    }
}

/// Middle and extra radius of the circle that fits the hull of a unit disc and of its copy moved by `shift` and swollen
/// by `growth`: mean and first harmonic of `max(0, growth + shift cos θ)`.
pub(in super::super) fn outline(shift: Vec2, growth: f64) -> (Vec2, f64) {
    let size = shift.norm();
    if size <= growth {
        return (shift, growth);
    }
    let angle = libm::acos(-growth / size);
    let (sin, cos) = libm::sincos(angle);
    let first = (2.0 * growth * sin + size * (angle + sin * cos)) / std::f64::consts::PI;
    (shift / size * first, (growth * angle + size * sin) / std::f64::consts::PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_circle_in_perspective_has_its_ellipses_centre(lean in -0.02..0.02f64, turn in 0.0..6.3f64, scale in 20.0..60.0f64) {
            // u' = u / (1 - lean u) along one direction, v' = v / (1 - lean u) across it, then turned and scaled
            let (sin, cos) = turn.sin_cos();
            let across = |v: Vec2| Vec2::new(-v.y, v.x);
            let along = Vec2::new(cos, sin);
            let q = |u: Vec2| along * (lean * u.dot(&along).powi(2)) + across(along) * (lean * u.dot(&along) * u.dot(&across(along)));
            let [x, y] = [Vec2::x(), Vec2::y()];
            let (xx, yy) = (q(x) * scale, q(y) * scale);
            let map = LocalMap { origin: Vec2::zeros(), x: x * scale, y: y * scale, xx, xy: q(x + y) * scale - xx - yy, yy };
            let ends = [1.0, -1.0].map(|u| u / (1.0 - lean * u));
            let center = along * ((ends[0] + ends[1]) / 2.0 * scale);
            prop_assert!((map.middle_of_circle(Vec2::zeros(), 1.0) - center).norm() < 1e-3);
        }

        #[test]
        fn outline_is_the_hulls_mean_and_first_harmonic(x in -0.03..0.03f64, y in -0.03..0.03f64, growth in 0.0..0.02f64) {
            let shift = Vec2::new(x, y);
            let n = 20_000;
            let (mut mean, mut first) = (0.0, Vec2::zeros());
            for k in 0..n {
                let (sin, cos) = (f64::from(k) / f64::from(n) * std::f64::consts::TAU).sin_cos();
                let beyond = (growth + x * cos + y * sin).max(0.0);
                mean += beyond / f64::from(n);
                first += Vec2::new(cos, sin) * (2.0 * beyond / f64::from(n));
            }
            let (middle, extra) = outline(shift, growth);
            prop_assert!((middle - first).norm() < 1e-6 && (extra - mean).abs() < 1e-6);
        }
    }
}
