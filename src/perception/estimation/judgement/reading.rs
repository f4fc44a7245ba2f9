//! Accelerometer readings of one pulse, and detection of a channel full of noise.

use nalgebra::Complex;

use super::super::accelerometer_phasors::AccelerometerPhasors;
use super::super::{PlateFit, WEAKEST_MPS2, WaveFit};
use upm_core::signal::CHANNELS;

/// Tolerance of a coefficient in standard deviations when two periods or more were read.
pub(super) const DEVIATIONS: f64 = 8.0;

/// Acceleration phasors of all channels and the mean variance of cos and sin coefficient, harmonic by harmonic.
pub(super) struct TraceReading {
    pub accel_mps2: AccelerometerPhasors,
    pub variance: Vec<f64>,
    /// The channel that is full of noise, if one is, with its share of the variance.
    pub noisy: Option<(usize, f64)>,
}

impl TraceReading {
    pub fn of(fit: &PlateFit) -> Self {
        let WaveFit { accel_mps2, accel_sd_mps2, channel_residual_mps2, .. } = fit.motion();
        let channels = accel_mps2.each_ref();
        let at = |k: usize| channels.map(|of| of.get(k).map_or_else(Complex::default, |[c, s]| Complex::new(*c, -s)));
        Self {
            accel_mps2: (0..accel_sd_mps2.len()).map(at).collect(),
            variance: accel_sd_mps2.iter().map(|[c, s]| 0.5 * (c * c + s * s)).collect(),
            noisy: noisy(channel_residual_mps2),
        }
    }
}

/// The channel full of noise, with its share of the sum of squares: its residual is more standard deviations than a
/// coefficient may be off, each the largest other residual or [`WEAKEST_MPS2`].
fn noisy(residual_mps2: &[f64; CHANNELS]) -> Option<(usize, f64)> {
    let squares = residual_mps2.map(|rms| rms * rms);
    let (channel, &most) = squares.iter().enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let others = squares.iter().enumerate().filter(|(other, _)| *other != channel);
    let next = others.map(|(_, square)| *square).fold(WEAKEST_MPS2 * WEAKEST_MPS2, f64::max);
    (most > DEVIATIONS * DEVIATIONS * next).then(|| (channel, most / squares.iter().sum::<f64>()))
}
