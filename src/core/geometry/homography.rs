use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::Vec2;

/// A plane-to-plane projective map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Homography(Matrix3<f64>);

impl Homography {
    /// The map with this matrix, at any scale.
    #[inline]
    pub fn new(matrix: Matrix3<f64>) -> Self {
        Self(matrix)
    }

    /// The map from four points to four points, `None` when three of either are collinear.
    pub fn from_corners(from: [Vec2; 4], to: [Vec2; 4]) -> Option<Self> {
        let mut a = SMatrix::<f64, 8, 8>::zeros();
        let mut b = SVector::<f64, 8>::zeros();
        for (i, (p, q)) in from.iter().zip(&to).enumerate() {
            let (u, v) = (2 * i, 2 * i + 1);
            a.fixed_view_mut::<1, 8>(u, 0).copy_from_slice(&[p.x, p.y, 1.0, 0.0, 0.0, 0.0, -p.x * q.x, -p.y * q.x]);
            a.fixed_view_mut::<1, 8>(v, 0).copy_from_slice(&[0.0, 0.0, 0.0, p.x, p.y, 1.0, -p.x * q.y, -p.y * q.y]);
            b[u] = q.x;
            b[v] = q.y;
        }
        let h = a.full_piv_lu().solve(&b)?;
        let matrix = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0);
        (h.iter().all(|x| x.is_finite()) && matrix.determinant().abs() > 1e-12).then_some(Self(matrix))
    }

    /// The image of `p`.
    #[inline]
    pub fn apply(&self, p: Vec2) -> Vec2 {
        let q = self.0 * Vector3::new(p.x, p.y, 1.0);
        Vec2::new(q.x / q.z, q.y / q.z)
    }

    /// Jacobian of the map at `p`.
    #[inline]
    pub fn jacobian_at(&self, p: Vec2) -> nalgebra::Matrix2<f64> {
        let q = self.0 * Vector3::new(p.x, p.y, 1.0);
        let image = Vec2::new(q.x / q.z, q.y / q.z);
        let top = self.0.fixed_view::<2, 2>(0, 0);
        let bottom = self.0.fixed_view::<1, 2>(2, 0);
        (top - image * bottom) / q.z
    }

    /// The inverse map; `None` for a singular matrix.
    #[inline]
    pub fn inverse(&self) -> Option<Self> {
        self.0.try_inverse().map(Self)
    }

    /// The matrix of the map.
    #[inline]
    pub fn matrix(&self) -> &Matrix3<f64> {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn square() -> [Vec2; 4] {
        [Vec2::new(-1.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(1.0, -1.0), Vec2::new(-1.0, -1.0)]
    }

    proptest! {
        #[test]
        fn corners_go_where_they_should(jitter in proptest::array::uniform8(-0.3..0.3f64), x in -0.5..0.5f64, y in -0.5..0.5f64) {
            let to = [0, 1, 2, 3].map(|i| 3.0 * square()[i] + Vec2::new(jitter[2 * i], jitter[2 * i + 1]));
            let map = Homography::from_corners(square(), to).unwrap();
            for (p, q) in square().into_iter().zip(to) {
                prop_assert!((map.apply(p) - q).norm() < 1e-9);
            }
            let p = Vec2::new(x, y);
            prop_assert!((map.inverse().unwrap().apply(map.apply(p)) - p).norm() < 1e-9);
            let step = Vec2::new(1e-6, -2e-6);
            let moved = map.apply(p + step) - map.apply(p);
            prop_assert!((map.jacobian_at(p) * step - moved).norm() < 1e-10);
        }
    }
}
