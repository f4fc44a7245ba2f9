//! Least-squares fit of all harmonics of a pulse: two of a rotation, more of a synthesised motion.
//!
//! A polynomial is fitted with the harmonics and discarded: it takes up the sensor's bias and the plate's own resonance
//! (10-20 Hz, slowly decaying) excited by the attack. Otherwise they leak into the coefficients. Measured on simulated
//! plates with resonances of 11, 14 and 17 Hz, damping ratio 0.1, 60 Hz drive, attack 10 ms, three periods: 2.1 % of
//! the first harmonic without a polynomial, 2.0 % with degree 2, 0.1 % with degree 4, 0.01 % with degree 6, which makes
//! the coefficients 1.3 times as noisy.

use std::f64::consts::TAU;

use nalgebra::DMatrix;

use super::{AccelerometerPair, FitError, SteadyWindow, WEAKEST_MPS2, WaveFit, accelerations_mps2, sustain_window};
use super::{refuse_bad, refuse_cut_short, twist_from_corners};
use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{AccelTrace, CHANNELS, Envelope, TwistHarmonic, TwistWave};

/// Fewest samples to the period of the highest harmonic.
const LEAST_SAMPLES: f64 = 4.0;

/// Degrees of the polynomial for each period that is read. With one more it can no longer be distinguished from the
/// first harmonic, whose error over a single period is then twice its size.
const DEGREES_A_PERIOD: usize = 2;

/// Fits the plate's motion at the full height of a pulse of `harmonics` harmonics shaped by `envelope` to its
/// accelerometer trace. `base_radps` is the drive's base frequency.
///
/// # Errors
///
/// As [`sustain_window`] and [`accelerations_mps2`]; [`FitError::CutShort`] for a trace that ends within the sustain
/// and [`FitError::TooWeak`] for a motion below [`WEAKEST_MPS2`]. [`FitError::Unreadable`] also for sensors without a
/// distance between them, for gains that are not above 0, for harmonics that cannot be told from drift, and for fewer
/// than 4 samples to the period of the highest harmonic.
pub fn fit_wave(
    trace: &AccelTrace,
    envelope: &Envelope,
    base_radps: f64,
    harmonics: usize,
    sensors: &AccelerometerPair,
) -> Result<WaveFit, FitError> {
    refuse_bad(sensors)?;
    let window = sustain_window(trace, envelope, base_radps)?;
    if trace.sample_hz * TAU < LEAST_SAMPLES * harmonics as f64 * base_radps {
        return Err(FitError::Unreadable("fewer than 4 samples to the period of the highest harmonic"));
    }
    refuse_cut_short(trace, envelope)?;
    let measured = DMatrix::from_columns(&accelerations_mps2(trace, &window)?.map(Into::into));
    let basis = HarmonicBasis::new(&window, base_radps, harmonics)?;
    wave_fit(&basis, &measured, None, base_radps, sensors)
}

/// Harmonics and a polynomial at the samples of a window, and the inverse of their normal matrix.
#[derive(Clone, Debug)]
pub(super) struct HarmonicBasis {
    harmonics: usize,
    regressors: DMatrix<f64>,
    covariance: DMatrix<f64>,
}

impl HarmonicBasis {
    pub fn new(window: &SteadyWindow, base_radps: f64, harmonics: usize) -> Result<Self, FitError> {
        let regressors = regressors(window, base_radps, harmonics);
        let normal = regressors.tr_mul(&regressors).cholesky();
        let factor = normal.ok_or(FitError::Unreadable("harmonics cannot be told from drift"))?;
        Ok(Self { harmonics, regressors, covariance: factor.inverse() })
    }

    /// Coefficients of each column of `series`.
    pub fn solve(&self, series: &DMatrix<f64>) -> DMatrix<f64> {
        &self.covariance * self.regressors.tr_mul(series)
    }
}

/// The plate's motion from `measured` readings (columns, m/s²) less those in `known`, which are added to what was
/// fitted.
pub(super) fn wave_fit(
    basis: &HarmonicBasis,
    measured: &DMatrix<f64>,
    known: Option<&DMatrix<f64>>,
    base_radps: f64,
    sensors: &AccelerometerPair,
) -> Result<WaveFit, FitError> {
    let HarmonicBasis { harmonics, regressors, covariance } = basis;
    let mut solution = basis.solve(measured);
    let left_over = measured - regressors * &solution;
    if let Some(known) = known {
        solution += basis.solve(known);
    }
    let coefficient = |row: usize, channel: usize| solution[(row, channel)] / sensors.gain[channel];
    let accel_mps2: [Vec<[f64; 2]>; CHANNELS] = std::array::from_fn(|channel| {
        (0..*harmonics).map(|k| [coefficient(2 * k, channel), coefficient(2 * k + 1, channel)]).collect()
    });
    let found_mps2 = accel_mps2.iter().flatten().map(|[c, s]| libm::hypot(*c, *s)).fold(0.0, f64::max);
    if found_mps2 < WEAKEST_MPS2 || !found_mps2.is_finite() {
        return Err(FitError::TooWeak { found_mps2, needed_mps2: WEAKEST_MPS2 });
    }
    let residual_rms_mps2 = (left_over.norm_squared() / left_over.len() as f64).sqrt();
    let wave = twist_wave(&accel_mps2, base_radps, sensors.position_m);
    let freedom = CHANNELS * left_over.nrows().saturating_sub(regressors.ncols()).max(1);
    let residual_variance = left_over.norm_squared() / freedom as f64;
    let sd = |k: usize| (residual_variance * covariance[(k, k)]).sqrt();
    let accel_sd_mps2 = (0..*harmonics).map(|k| [sd(2 * k), sd(2 * k + 1)]).collect();
    let channel_residual_mps2 =
        std::array::from_fn(|channel| (left_over.column(channel).norm_squared() / left_over.nrows() as f64).sqrt());
    Ok(WaveFit { accel_mps2, accel_sd_mps2, channel_residual_mps2, residual_rms_mps2, wave })
}

/// A row for each sample of `window`: cos and sin of every harmonic, then Legendre polynomials from the constant up.
fn regressors(window: &SteadyWindow, base_radps: f64, harmonics: usize) -> DMatrix<f64> {
    let drift = 2 * harmonics;
    let mut rows = DMatrix::zeros(window.samples.len(), drift + 1 + DEGREES_A_PERIOD * window.periods);
    let half = 0.5 * window.samples.len() as f64;
    for (i, t_s) in window.times_s().enumerate() {
        for k in 0..harmonics {
            let (sin, cos) = libm::sincos((k + 1) as f64 * base_radps * t_s);
            (rows[(i, 2 * k)], rows[(i, 2 * k + 1)]) = (cos, sin);
        }
        let u = (i as f64 + 0.5) / half - 1.0;
        (rows[(i, drift)], rows[(i, drift + 1)]) = (1.0, u);
        for column in drift + 2..rows.ncols() {
            // Bonnet's recursion: n P_n = (2n - 1) u P_{n-1} - (n - 1) P_{n-2}
            let n = (column - drift) as f64;
            rows[(i, column)] = ((2.0 * n - 1.0) * u * rows[(i, column - 1)] - (n - 1.0) * rows[(i, column - 2)]) / n;
        }
    }
    rows
}

/// The plate's velocity (App. B, harmonic by harmonic) from the channels' acceleration coefficients.
fn twist_wave(accel_mps2: &[Vec<[f64; 2]>; CHANNELS], base_radps: f64, accelerometer_in_plate_m: Vec2) -> TwistWave {
    let [x1, y1, x2, y2] = accel_mps2;
    let channels = x1.iter().zip(y1).zip(x2).zip(y2).enumerate();
    let harmonics = channels.map(|(k, (((x1, y1), x2), y2))| {
        let per_speed = (k + 1) as f64 * base_radps;
        let twist = |i: usize| {
            let corners = [Vec2::new(x1[i], y1[i]), Vec2::new(x2[i], y2[i])];
            twist_from_corners(corners[0], corners[1], accelerometer_in_plate_m) * per_speed.recip()
        };
        let [of_cos, of_sin]: [Twist; 2] = [twist(0), twist(1)];
        TwistHarmonic { cos: -of_sin, sin: of_cos }
    });
    TwistWave { base_radps, harmonics: harmonics.collect() }
}

#[cfg(test)]
mod tests;
