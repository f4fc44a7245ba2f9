use crate::geometry::Twist;

/// One harmonic of a periodic twist.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TwistHarmonic {
    /// Amplitude of `cos kwt`.
    pub cos: Twist,
    /// Amplitude of `sin kwt`.
    pub sin: Twist,
}

/// A periodic planar velocity of the plate: harmonics `k = 1, 2, …` of one base frequency on x, y and spin.
/// A rotation about a centre is its two-harmonic special case.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TwistWave {
    /// Base frequency w, rad/s.
    pub base_radps: f64,
    /// Harmonic `k` at index `k - 1`.
    pub harmonics: Vec<TwistHarmonic>,
}

impl TwistWave {
    /// `amplitude · (cos wt - ½ cos 2wt)`: the wave that pumps parts along the field of `amplitude` (Eq. 5).
    pub fn pump(amplitude: Twist, base_radps: f64) -> Self {
        let first = TwistHarmonic { cos: amplitude, sin: Twist::ZERO };
        let second = TwistHarmonic { cos: amplitude * -0.5, sin: Twist::ZERO };
        Self { base_radps, harmonics: vec![first, second] }
    }

    /// The plate's velocity at `t_s`.
    pub fn at(&self, t_s: f64) -> Twist {
        (1..).zip(&self.harmonics).fold(Twist::ZERO, |sum, (k, harmonic)| {
            let (sin, cos) = (f64::from(k) * self.base_radps * t_s).sin_cos();
            sum + harmonic.cos * cos + harmonic.sin * sin
        })
    }
}
