//! Spectra of accelerometer traces, and identification of a mass-spring-damper from its response to a multisine.
//!
//! A plate axis obeys `M q̈ + c q̇ + k q = F` (UPM paper, Eq. 33), in the frequency domain `F/V = jωM + c + k/(jω)`.
//! Over one measured period the plate is seldom in its steady state: the transient of the attack still decays.
//! Integrating the equation over the period leaves, for every line, the state's change between the two ends as extra
//! terms of a polynomial in `1/(jω)` (Pintelon and Schoukens, *System Identification*, 2nd ed., section 6.3.2):
//!
//! ```text
//!   M A + c A/(jω) + k A/(jω)² + p0 + p1/(jω) + p2/(jω)² = F e^{-jωτ}
//! ```
//!
//! with A the acceleration's line and τ the delay of the motors' low-pass, which if neglected would be mistaken for
//! damping. The equation is linear in all unknowns except τ, so least squares with a few iterations on τ solves it.

use std::f64::consts::TAU;

use nalgebra::{Complex, DMatrix, DVector};
use rustfft::FftPlannerScalar;

use super::twist_from_corners;
use super::{AccelerometerPair, FitError, accelerations_mps2, refuse_bad, refuse_cut_short, sustain_window};
use upm_core::geometry::Vec2;
use upm_core::phasor::{magnitude, polar};
use upm_core::signal::{AccelTrace, CHANNELS, Envelope};

/// Iterations on the delay and on the weights.
const PASSES: usize = 4;
/// Unknowns: M, c, k, three of the transient, a correction of the delay.
const UNKNOWNS: usize = 7;
/// Largest deviation of the evaluated periods from whole samples, samples. Beyond it lines leak into their neighbours.
const UNEVEN_SAMPLES: f64 = 1e-3;
/// Largest accepted standard deviation of a natural frequency, as a fraction of it, and of a damping ratio.
const LARGEST_SD: f64 = 0.05;

/// A plate axis as a mass-spring-damper, with the standard deviations from the fit's residual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OscillatorFit {
    /// Undamped natural frequency `sqrt(k/M)`, rad/s.
    pub natural_radps: f64,
    /// Standard deviation of `natural_radps`, rad/s.
    pub natural_sd_radps: f64,
    /// Damping ratio `c / (2 sqrt(k M))`.
    pub damping_ratio: f64,
    /// Standard deviation of `damping_ratio`.
    pub damping_ratio_sd: f64,
}

/// Amplitude phasors of `values` at 0, 1, 2, … cycles over their length, up to half their number: `c - js` for
/// `c cos + s sin` counted from the first value. FFT by `rustfft`, any length, of
/// equal bits whatever vectors the processor has.
pub fn amplitude_spectrum(values: &[f64]) -> Vec<Complex<f64>> {
    let mut bins: Vec<Complex<f64>> = values.iter().map(|&value| Complex::new(value, 0.0)).collect();
    FftPlannerScalar::new().plan_fft_forward(bins.len()).process(&mut bins);
    bins.truncate(values.len() / 2 + 1);
    let count = values.len();
    let scale = 2.0 / count.max(1) as f64;
    // a constant and the alternation at half the sampling rate have no mirror image
    bins.iter_mut().enumerate().for_each(|(k, bin)| *bin *= if k == 0 || 2 * k == count { 0.5 * scale } else { scale });
    bins
}

/// Acceleration phasors of x (m/s²), y (m/s²) and spin (rad/s²) at the lines 1 to `lines` of `base_radps`, from the
/// last whole periods at full height of a pulse shaped by `envelope`; times from the start of the pulse.
///
/// # Errors
///
/// [`FitError`] for traces that are too short, cut short, clipped or incomplete, for periods that are not whole
/// samples, and for lines above half the sampling rate.
pub fn axis_lines(
    trace: &AccelTrace,
    envelope: &Envelope,
    base_radps: f64,
    lines: usize,
    sensors: &AccelerometerPair,
) -> Result<[Vec<Complex<f64>>; 3], FitError> {
    refuse_bad(sensors)?;
    let window = sustain_window(trace, envelope, base_radps)?;
    refuse_cut_short(trace, envelope)?;
    let samples = window.periods as f64 * TAU / (base_radps * window.step_s);
    if (samples - window.samples.len() as f64).abs() > UNEVEN_SAMPLES {
        return Err(FitError::Unreadable("the periods read are not whole samples"));
    }
    let channels = accelerations_mps2(trace, &window)?;
    let spectra: Vec<_> = channels.iter().map(|values| amplitude_spectrum(values)).collect();
    let line = |channel: usize, k: usize| {
        let at_start = polar(1.0 / sensors.gain[channel], -(k as f64) * base_radps * window.start_s);
        spectra[channel].get(k * window.periods).map(|bin| bin * at_start)
    };
    let mut axes = [const { Vec::new() }; 3];
    for k in 1..=lines {
        let mut shown = [Complex::default(); CHANNELS];
        for (channel, shown) in shown.iter_mut().enumerate() {
            *shown = line(channel, k).ok_or(FitError::Unreadable("lines above half the sampling rate"))?;
        }
        for (axis, phasor) in axes.iter_mut().zip(axis_accelerations(shown, sensors.position_m)) {
            axis.push(phasor);
        }
    }
    Ok(axes)
}

/// A plate's x, y and spin accelerations from those of its channels (App. B), real and imaginary parts separately.
fn axis_accelerations([x1, y1, x2, y2]: [Complex<f64>; CHANNELS], position_m: Vec2) -> [Complex<f64>; 3] {
    let re = twist_from_corners(Vec2::new(x1.re, y1.re), Vec2::new(x2.re, y2.re), position_m);
    let im = twist_from_corners(Vec2::new(x1.im, y1.im), Vec2::new(x2.im, y2.im), position_m);
    [
        Complex::new(re.velocity_mps.x, im.velocity_mps.x),
        Complex::new(re.velocity_mps.y, im.velocity_mps.y),
        Complex::new(re.spin_radps, im.spin_radps),
    ]
}

/// Fits the oscillator that responds to `force` with `accel`, phasors of the lines 1, 2, … of `base_radps` (any unit of
/// force; m/s² or rad/s²). Lines without force carry no information and are left out.
///
/// # Errors
///
/// [`FitError::Undetermined`] when the lines do not fix natural frequency and damping ratio to 5 %.
pub fn fit_oscillator(
    base_radps: f64,
    force: &[Complex<f64>],
    accel: &[Complex<f64>],
) -> Result<OscillatorFit, FitError> {
    let undetermined = |found_sd: f64| FitError::Undetermined { found_sd, needed_sd: LARGEST_SD };
    let lines: Vec<SpectralLine> = (1..)
        .zip(force.iter().zip(accel))
        .filter(|(_, (force, accel))| magnitude(**force) > 0.0 && magnitude(**accel) > 0.0)
        .map(|(k, (&force, &accel))| SpectralLine { order: f64::from(k), force, accel })
        .collect();
    if 2 * lines.len() <= UNKNOWNS {
        return Err(undetermined(f64::INFINITY));
    }
    // Noise in A enters the equation through the impedance F/A: its inverse is the weight (Sanathanan and Koerner,
    // 1963).
    let mut weights: Vec<f64> = lines.iter().map(|line| magnitude(line.accel) / magnitude(line.force)).collect();
    let mut delay_rad = 0.0;
    let mut solved = None;
    for _ in 0..PASSES {
        let solution = solve(&lines, &weights, delay_rad).ok_or(undetermined(f64::INFINITY))?;
        delay_rad += solution.value[6];
        let [mass, damping, stiffness] = [0, 1, 2].map(|i| solution.value[i]);
        for (weight, line) in weights.iter_mut().zip(&lines) {
            let k = line.order;
            *weight = magnitude(Complex::new(mass - stiffness / (k * k), -damping / k)).recip();
        }
        solved = Some(solution);
    }
    let solution = solved.ok_or(undetermined(f64::INFINITY))?;
    let fit = oscillator(&solution, base_radps);
    let found_sd = (fit.natural_sd_radps / fit.natural_radps).max(fit.damping_ratio_sd);
    // written so that NaN is rejected too
    if found_sd <= LARGEST_SD && fit.damping_ratio >= -fit.damping_ratio_sd {
        Ok(OscillatorFit { damping_ratio: fit.damping_ratio.max(0.0), ..fit })
    } else {
        Err(undetermined(found_sd))
    }
}

/// One excited line: its number, the force and the acceleration.
struct SpectralLine {
    order: f64,
    force: Complex<f64>,
    accel: Complex<f64>,
}

/// Least-squares solution with its covariance; frequencies in units of the base frequency.
struct Solution {
    value: DVector<f64>,
    covariance: DMatrix<f64>,
}

fn solve(lines: &[SpectralLine], weights: &[f64], delay_rad: f64) -> Option<Solution> {
    let rows = 2 * lines.len();
    let mut regressors = DMatrix::zeros(rows, UNKNOWNS);
    let mut wanted = DVector::zeros(rows);
    for (i, (line, &weight)) in lines.iter().zip(weights).enumerate() {
        let per_s = Complex::new(0.0, -line.order.recip());
        let force = line.force * polar(1.0, -line.order * delay_rad);
        let one = Complex::new(1.0, 0.0);
        let terms = [
            line.accel,
            line.accel * per_s,
            line.accel * per_s * per_s,
            one,
            per_s,
            per_s * per_s,
            Complex::new(0.0, line.order) * force,
        ];
        for (j, term) in terms.into_iter().enumerate() {
            (regressors[(2 * i, j)], regressors[(2 * i + 1, j)]) = (weight * term.re, weight * term.im);
        }
        (wanted[2 * i], wanted[2 * i + 1]) = (weight * force.re, weight * force.im);
    }
    let scales: Vec<f64> = regressors.column_iter().map(|column| column.norm().recip()).collect();
    for (mut column, scale) in regressors.column_iter_mut().zip(&scales) {
        column *= *scale;
    }
    let inverse = regressors.tr_mul(&regressors).cholesky()?.inverse();
    let value = &inverse * regressors.tr_mul(&wanted);
    let left_over = &wanted - &regressors * &value;
    let variance = left_over.norm_squared() / (rows - UNKNOWNS) as f64;
    let unscaled = |i: usize, j: usize| scales[i] * scales[j];
    Some(Solution {
        value: DVector::from_fn(UNKNOWNS, |i, _| value[i] * scales[i]),
        covariance: DMatrix::from_fn(UNKNOWNS, UNKNOWNS, |i, j| variance * inverse[(i, j)] * unscaled(i, j)),
    })
}

fn oscillator(solution: &Solution, base_radps: f64) -> OscillatorFit {
    let [mass, damping, stiffness] = [0, 1, 2].map(|i| solution.value[i]);
    let natural = (stiffness / mass).sqrt();
    let ratio = 0.5 * damping / (stiffness * mass).sqrt();
    // standard deviation of a quantity with this gradient over mass, damping and stiffness
    let sd = |gradient: [f64; 3]| {
        let products = (0..3).flat_map(|i| (0..3).map(move |j| (i, j)));
        products.map(|(i, j)| gradient[i] * gradient[j] * solution.covariance[(i, j)]).sum::<f64>().sqrt()
    };
    OscillatorFit {
        natural_radps: natural * base_radps,
        natural_sd_radps: base_radps * sd([-0.5 * natural / mass, 0.0, 0.5 * natural / stiffness]),
        damping_ratio: ratio,
        damping_ratio_sd: sd([-0.5 * ratio / mass, 0.5 / (stiffness * mass).sqrt(), -0.5 * ratio / stiffness]),
    }
}

#[cfg(test)]
mod tests;
