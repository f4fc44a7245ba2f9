//! Resonance search: each axis is driven by a multisine and its mass-spring-damper fitted to the accelerometers'
//! spectrum (UPM paper, Eq. 33).

use std::f64::consts::{PI, TAU};

use nalgebra::{Complex, Vector3};

use super::axis_pulse::AROUND;
use super::{CalibrationError, CalibrationSession};
use upm_core::phasor::polar;
use upm_core::rig::RigModel;
use upm_core::signal::{Drive, Envelope};
use upm_perception::estimation::{FitError, OscillatorFit, axis_lines, fit_oscillator};
use upm_planning::cor_library::motor_harmonics;

/// Longest period of the multisine, s: its first line is at 3.3 Hz, below the resonances of plates on springs.
const PERIOD_S: f64 = 0.3;
/// Number of lines of the multisine. A drive's peak is found accurately enough for up to 16 harmonics.
const LINES: usize = 16;
/// Share of the count limit that the multisine may use.
const EFFORT: f64 = 0.8;
/// Travel of a free plate, summed over the lines, m. A resonance multiplies the share of the lines next to it.
const TRAVEL_M: f64 = 2e-3;
/// Share of the accelerometers' range that a free plate's acceleration may use, summed over the lines.
const RANGE_SHARE: f64 = 0.7;
/// Number of pulses of either sign whose spectra are averaged.
const REPEATS: usize = 4;
/// How often the strength is halved when a resonance drives the accelerometers to their limit.
const HALVINGS: usize = 3;
const NAMES: [&str; 3] = ["resonance x", "resonance y", "resonance spin"];

/// Finds the oscillators of x, y and spin, their force in counts of the axis amplitude; the accelerometers' gains must
/// be known. `None` where the rig's longest sustain holds too few periods to resolve them.
pub(super) fn measure(session: &mut CalibrationSession<'_>) -> Result<Option<[OscillatorFit; 3]>, CalibrationError> {
    match (0..3).map(|axis| measure_axis(session, axis)).collect::<Result<Vec<_>, _>>() {
        Err(CalibrationError::Trace { fault: FitError::Undetermined { .. }, .. }) => Ok(None),
        found => Ok(found?.try_into().ok()),
    }
}

fn measure_axis(session: &mut CalibrationSession<'_>, axis: usize) -> Result<OscillatorFit, CalibrationError> {
    let mut drive = multisine(session, axis);
    for _ in 0..HALVINGS {
        match average(session, axis, &drive) {
            Err(CalibrationError::Trace { fault: FitError::Clipped { .. }, .. }) => drive = drive.scaled(0.5),
            answer => return answer,
        }
    }
    average(session, axis, &drive)
}

/// Plays `drive` in both directions [`REPEATS`] times; half the difference removes everything that does not change sign
/// with it.
fn average(
    session: &mut CalibrationSession<'_>,
    axis: usize,
    drive: &Drive,
) -> Result<OscillatorFit, CalibrationError> {
    let fault = |fault| CalibrationError::Trace { what: NAMES[axis].to_owned(), fault };
    let mut accel = vec![Complex::default(); LINES];
    for repeat in 0..REPEATS {
        session.report("resonance", REPEATS * axis + repeat, REPEATS * NAMES.len());
        for (drive, sign) in [(drive.clone(), 1.0), (drive.clone().reversed(), -1.0)] {
            let trace = session.play(&drive)?;
            let lines =
                axis_lines(&trace, &drive.envelope, drive.base_radps, LINES, &session.sensors).map_err(fault)?;
            let share = sign / (2 * REPEATS) as f64;
            accel.iter_mut().zip(&lines[axis]).for_each(|(sum, line)| *sum += line * share);
        }
    }
    // phasors of the axis amplitude that the drive plays, counts (Eq. 7)
    let signs = session.model.motor_arrangement.turned(AROUND[axis].map(f64::from));
    let phasor = |k: usize| signs.iter().zip(&drive.motors).map(|(sign, motor)| motor[k].phasor() * *sign).sum();
    let force: Vec<Complex<f64>> = (0..drive.motors[0].len()).map(phasor).collect();
    fit_oscillator(drive.base_radps, &force, &accel).map_err(fault)
}

/// The multisine, as strong as counts, accelerometers and travel allow. Force grows with frequency, so that every line
/// of a free plate has the same speed: slow lines stay within the travel, fast ones keep friction and rounding from
/// acting on slow ones. Phases are Schroeder's (IEEE Trans. Inf. Theory 16, 1970), which keep the peak low.
fn multisine(session: &CalibrationSession<'_>, axis: usize) -> Drive {
    let model = session.model;
    let trace = session.rig.trace();
    let base_radps = base_radps(PERIOD_S.min(model.max_sustain_s), trace.sample_hz);
    // a flank as long as a period: shorter ones would need more force than the sustain
    let envelope = Envelope {
        attack_s: TAU / base_radps,
        sustain_s: (TAU / base_radps).min(model.max_sustain_s),
        rest_s: model.rest_s,
    };
    let mut unit = Drive { base_radps, envelope, ..Drive::default() };
    for k in 1..=LINES {
        let k = k as f64;
        let line = polar(k, -PI * k * k / LINES as f64);
        let counts = Vector3::from_fn(|i, _| if i == axis { line } else { Complex::default() });
        for (motor, harmonic) in unit.motors.iter_mut().zip(model.motor_arrangement.turned(motor_harmonics(&counts))) {
            motor.push(harmonic);
        }
    }
    let range_mps2 = f64::from(trace.count_limit) * trace.mps2_per_count;
    let first_mps2 = free_accel_mps2(axis, model);
    let orders = (1..=LINES).map(|k| k as f64);
    let summed_mps2 = first_mps2 * orders.clone().sum::<f64>();
    let summed_m = first_mps2 / (base_radps * base_radps) * orders.map(f64::recip).sum::<f64>();
    let by_counts = EFFORT * model.count_limit / unit.peak_counts();
    let scale = by_counts.min(RANGE_SHARE * range_mps2 / summed_mps2).min(TRAVEL_M / summed_m);
    unit.scaled(scale)
}

/// Base frequency whose period is the longest whole number of samples within `period_s`.
fn base_radps(period_s: f64, sample_hz: f64) -> f64 {
    TAU * sample_hz / (period_s * sample_hz + 1e-6).floor().max(1.0)
}

/// Acceleration of one count of `axis` on a free plate, for spin that of the accelerometers, m/s².
fn free_accel_mps2(axis: usize, model: &RigModel) -> f64 {
    let force_n = model.newtons_per_count;
    if axis < 2 {
        return force_n / model.plate_mass_kg;
    }
    model.accelerometer_in_plate_m.norm() * model.lever_arm_m * force_n / model.plate_inertia_kgm2
}
