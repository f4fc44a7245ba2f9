use nalgebra::Matrix2;

use super::Vec2;

/// Intrinsic geometry of a pinhole camera with radial and tangential distortion (Brown, 1966; the five-number form that
/// calibration tools print). `ideal` image coordinates are those of the same camera without distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Focal length, px; pixels are square.
    pub focal_px: f64,
    /// Principal point, where the optical axis meets the image, px.
    pub principal_px: Vec2,
    /// Coefficients of r² and r⁴, r in units of the focal length.
    pub radial: [f64; 2],
    /// Coefficients of the tangential distortion.
    pub tangential: [f64; 2],
}

impl Lens {
    /// A lens without distortion.
    #[inline]
    pub fn ideal(focal_px: f64, principal_px: Vec2) -> Self {
        Self { focal_px, principal_px, radial: [0.0; 2], tangential: [0.0; 2] }
    }

    /// A lens without distortion for a picture of these columns and rows, its axis through the middle. The focal length
    /// is a multiple of the longer side: from about 4 on parts are seen from straight above.
    pub fn centered(size_px: [usize; 2], focal_sides: f64) -> Self {
        let size = Vec2::from(size_px.map(|size| size as f64));
        Self::ideal(focal_sides * size.max(), (size - Vec2::repeat(1.0)) / 2.0)
    }

    /// True without distortion.
    #[inline]
    pub fn is_ideal(&self) -> bool {
        self.radial == [0.0; 2] && self.tangential == [0.0; 2]
    }

    /// Image coordinates (px) of an ideal image point (px).
    #[inline]
    pub fn image_from_ideal(&self, ideal_px: Vec2) -> Vec2 {
        let n = (ideal_px - self.principal_px) / self.focal_px;
        self.principal_px + self.focal_px * self.distort(n)
    }

    /// Ideal image coordinates (px) of an image point (px), by Newton's method;
    /// within 1e-9 px wherever the distortion is one-to-one.
    pub fn ideal_from_image(&self, image_px: Vec2) -> Vec2 {
        let wanted = (image_px - self.principal_px) / self.focal_px;
        let mut n = wanted;
        for _ in 0..8 {
            let error = self.distort(n) - wanted;
            match self.distortion_jacobian(n).try_inverse() {
                Some(inverse) if error.norm() > 1e-14 => n -= inverse * error,
                _ => break,
            }
        }
        self.principal_px + self.focal_px * n
    }

    /// Jacobian of the distortion: motion of the image point with its ideal point.
    #[inline]
    pub fn jacobian_at_ideal(&self, ideal_px: Vec2) -> Matrix2<f64> {
        self.distortion_jacobian((ideal_px - self.principal_px) / self.focal_px)
    }

    #[inline]
    fn distort(&self, n: Vec2) -> Vec2 {
        let ([k1, k2], [p1, p2]) = (self.radial, self.tangential);
        let r2 = n.norm_squared();
        let radial = 1.0 + r2 * (k1 + r2 * k2);
        Vec2::new(
            n.x * radial + 2.0 * p1 * n.x * n.y + p2 * (r2 + 2.0 * n.x * n.x),
            n.y * radial + p1 * (r2 + 2.0 * n.y * n.y) + 2.0 * p2 * n.x * n.y,
        )
    }

    fn distortion_jacobian(&self, n: Vec2) -> Matrix2<f64> {
        let ([k1, k2], [p1, p2]) = (self.radial, self.tangential);
        let r2 = n.norm_squared();
        let radial = 1.0 + r2 * (k1 + r2 * k2);
        let slope = 2.0 * k1 + 4.0 * k2 * r2;
        let mixed = slope * n.x * n.y + 2.0 * p1 * n.x + 2.0 * p2 * n.y;
        Matrix2::new(
            radial + slope * n.x * n.x + 2.0 * p1 * n.y + 6.0 * p2 * n.x,
            mixed,
            mixed,
            radial + slope * n.y * n.y + 6.0 * p1 * n.y + 2.0 * p2 * n.x,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lens() -> Lens {
        Lens {
            focal_px: 1200.0,
            principal_px: Vec2::new(640.0, 512.0),
            radial: [-0.12, 0.03],
            tangential: [4e-4, -3e-4],
        }
    }

    proptest! {
        #[test]
        fn undistortion_inverts_distortion(x in 0.0..1280.0f64, y in 0.0..1024.0f64) {
            let p = Vec2::new(x, y);
            prop_assert!((lens().ideal_from_image(lens().image_from_ideal(p)) - p).norm() < 1e-9);
            let step = Vec2::new(1e-4, 2e-4);
            let moved = lens().image_from_ideal(p + step) - lens().image_from_ideal(p - step);
            prop_assert!((lens().jacobian_at_ideal(p) * (2.0 * step) - moved).norm() < 1e-8);
        }
    }
}
