use std::f32::consts::FRAC_1_SQRT_2;
use std::f64::consts::SQRT_2;

use nalgebra::Matrix2;

use super::super::CameraParams;
use super::tiles::Tile;

/// Distance from an edge, in standard deviations, beyond which its blur is negligible (1e-5 of the step).
pub(super) const REACH: f64 = 4.2;

/// Variance of a point spread over one pixel, px².
pub(super) const PIXEL_VARIANCE_PX2: f64 = 1.0 / 12.0;

/// Footprint of a pixel: the lens's blur and the pixel's square.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blur {
    variance_px2: f64,
    /// Distance of a block's centre from an edge, in standard deviations, beyond which the edge reaches none of its
    /// pixels.
    pub(super) block_reach: f32,
}

impl Blur {
    pub(super) fn new(params: &CameraParams) -> Self {
        let variance_px2 = params.blur_px * params.blur_px + PIXEL_VARIANCE_PX2;
        // The farthest pixel is 1.5·√2 px from the centre; 10 % more for the uneven scale.
        let block_radius_px = 1.5 * 1.1 * SQRT_2;
        Self { variance_px2, block_reach: (REACH + block_radius_px / variance_px2.sqrt()) as f32 }
    }

    pub(super) fn sd_px(&self) -> f64 {
        self.variance_px2.sqrt()
    }

    /// Upper bound of the footprint's standard deviation in any direction on the table, m.
    pub(super) fn bound_m(&self, tile: &Tile) -> f64 {
        let c = &tile.px_covariance_m2;
        ((c.m11.max(c.m22) + c.m12.abs()) * self.variance_px2).sqrt()
    }

    pub(super) fn covariance_m2(&self, tile: &Tile) -> Matrix2<f64> {
        tile.px_covariance_m2 * self.variance_px2
    }
}

/// Visible share of a half-plane blurred by a Gaussian, `z` standard deviations inside its edge: the normal
/// distribution function, by Hastings' formula for the error function (Abramowitz, Stegun, 7.1.28), within 3e-7. No
/// branch and no table, so that loops over it become vector code.
#[inline(always)]
pub(super) fn edge_spread(z: f32) -> f32 {
    const A: [f32; 6] = [0.070_523_08, 0.042_282_01, 0.009_270_527, 0.000_152_014_3, 0.000_276_567_2, 0.000_043_063_8];
    let x = z.abs() * FRAC_1_SQRT_2;
    let p1 = 1.0 + x * (A[0] + x * (A[1] + x * (A[2] + x * (A[3] + x * (A[4] + x * A[5])))));
    let p2 = p1 * p1;
    let p4 = p2 * p2;
    let p8 = p4 * p4;
    let tail = 0.5 / (p8 * p8);
    if z < 0.0 { tail } else { 1.0 - tail }
}

/// `1/sqrt(x)` to a relative error of 5e-6: a first guess that halves the exponent, refined twice by Newton's method
/// (Lomont, 2003). Vectorised on every machine, unlike square root and division.
#[inline(always)]
pub(super) fn inverse_sqrt(x: f32) -> f32 {
    let refined = |y: f32| y * (1.5 - 0.5 * x * y * y);
    refined(refined(f32::from_bits(0x5f37_5a86_u32.wrapping_sub(x.to_bits() >> 1))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_integral_of_the_normal_density() {
        let density = |z: f64| (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
        let (step, mut integral) = (1e-3, 0.0);
        for k in 0..6000 {
            let z = f64::from(k) * step;
            assert!((f64::from(edge_spread(z as f32)) - 0.5 - integral).abs() < 7e-7, "{z}");
            assert!((f64::from(edge_spread(-z as f32)) - 0.5 + integral).abs() < 7e-7, "-{z}");
            integral += step * density(z + step / 2.0);
        }
        assert_eq!((edge_spread(-1e20), edge_spread(1e20)), (0.0, 1.0));
    }
}
