use nalgebra::{Complex, Vector3};

use crate::geometry::Twist;

/// One harmonic of a periodic twist.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TwistHarmonic {
    /// Amplitude of `cos kwt`.
    pub cos: Twist,
    /// Amplitude of `sin kwt`.
    pub sin: Twist,
}

impl TwistHarmonic {
    /// The two harmonics of `amplitude · (cos wt - ½ cos 2wt)`, which pumps parts along the field of `amplitude` (Eq.
    /// 5).
    #[inline]
    pub fn pump(amplitude: Twist) -> [Self; 2] {
        [1.0, -0.5].map(|share| Self { cos: amplitude * share, sin: Twist::ZERO })
    }

    /// The phasors `cos - j sin` of x, y (m/s) and spin (rad/s).
    #[inline]
    pub fn phasor(&self) -> Vector3<Complex<f64>> {
        self.cos.vector().zip_map(&self.sin.vector(), |cos, sin| Complex::new(cos, -sin))
    }

    /// The harmonic with these phasors.
    #[inline]
    pub fn from_phasor(phasor: &Vector3<Complex<f64>>) -> Self {
        Self { cos: Twist::from_vector(phasor.map(|v| v.re)), sin: Twist::from_vector(phasor.map(|v| -v.im)) }
    }
}

/// A periodic planar velocity of the plate: harmonics `k = 1, 2, …` of one base frequency on x, y and spin. The
/// two-harmonic wave of a rotation about a centre is a special case.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TwistWave {
    /// Base frequency w, rad/s.
    pub base_radps: f64,
    /// Harmonic `k` at index `k - 1`.
    pub harmonics: Vec<TwistHarmonic>,
}

impl TwistWave {
    /// The wave of [`TwistHarmonic::pump`].
    #[inline]
    pub fn pump(amplitude: Twist, base_radps: f64) -> Self {
        Self { base_radps, harmonics: TwistHarmonic::pump(amplitude).to_vec() }
    }

    /// The plate's velocity at `t_s`.
    #[inline]
    pub fn at(&self, t_s: f64) -> Twist {
        (1..).zip(&self.harmonics).fold(Twist::ZERO, |sum, (k, harmonic)| {
            let (sin, cos) = libm::sincos(f64::from(k) * self.base_radps * t_s);
            sum + harmonic.cos * cos + harmonic.sin * sin
        })
    }
}
