//! Complex amplitudes. Their transcendental functions are those of `libm`: the C library's differ in the last bit from
//! processor to processor, and journals would, too.

use nalgebra::Complex;

/// The amplitude of this magnitude and angle.
pub fn polar(magnitude: f64, angle_rad: f64) -> Complex<f64> {
    let (sin, cos) = libm::sincos(angle_rad);
    Complex::new(magnitude * cos, magnitude * sin)
}

/// Angle of an amplitude, rad, in -π to π.
pub fn argument(of: Complex<f64>) -> f64 {
    libm::atan2(of.im, of.re)
}

/// Magnitude of an amplitude.
pub fn magnitude(of: Complex<f64>) -> f64 {
    of.norm_sqr().sqrt()
}
