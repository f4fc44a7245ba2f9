use std::f64::consts::TAU;

use nalgebra::Complex;

use super::force_sign::wrong_signs;
use super::recorded::{fit, waveform_fit_of};
use super::shaken::{BarePlate, steady_motion};
use super::sweep::Progress;
use super::{ExperimentResult, Figure, LabFault, LabRig};
use upm_chart::{Axis, Chart, Color};
use upm_control::calibration::{Axes, AxisResonance};
use upm_core::signal::{Drive, Envelope, RecordedPulse};
use upm_core::units::mm_from_m;
use upm_perception::estimation::{AxisPhasors, TwistFit, nearest_pump};
use upm_planning::cor_library::AxisShape;

/// The amplitudes played: row f of the paper's Table 1, in units. Its centre of rotation is off both axes and no two
/// accelerometers move alike.
const AMPLITUDES: [i32; 4] = [0, -2, -1, 3];
/// Fraction of the motors' limit used.
const EFFORT: f64 = 0.9;
const SUSTAIN_S: f64 = 0.1;
/// Random drives for which the sign is evaluated.
const SIGNS: usize = 10_000;
const AXES: [&str; 3] = ["x", "y", "spin"];

/// The least-squares fit of the accelerometers' traces (UPM paper, section 3.2, Eq. 12 and 13, App. B): one pulse
/// through the whole chain, measured and compared with the plate's true motion; and the effect of calibration's
/// pre-compensation on every axis. In addition the spectrum of the same trace by FFT, and the resonances of the axes as
/// determined by calibration.
///
/// # Errors
///
/// [`LabFault::Rig`] when calibration refuses the rig or the rig refuses a pulse, [`LabFault::Trace`] when a trace
/// cannot be read.
pub fn waveform_fit(lab: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabFault> {
    let mut plate = BarePlate::new(lab);
    let axes = plate.axes()?;
    let mut outcome = one_pulse(lab, &mut plate, &axes)?;
    outcome.figures.extend(precompensation(lab, &axes));
    add_resonances(lab, &mut plate, &mut outcome)?;
    let wrong = wrong_signs(lab, SIGNS, progress)? as f64;
    let source = "Eq. 14, random drives off the null through the whole chain";
    outcome.figures.push(Figure::against(format!("force signs wrong, of {SIGNS}"), "1", wrong, 0.0, source));
    Ok(outcome)
}

fn one_pulse(lab: &LabRig, plate: &mut BarePlate, axes: &Axes) -> Result<ExperimentResult, LabFault> {
    let drive = drive(lab, &axes.shapes);
    let recorded = RecordedPulse {
        trace: plate.play(&drive)?,
        envelope: drive.envelope,
        base_radps: drive.base_radps,
        accelerometer_in_plate_m: lab.model.accelerometer_in_plate_m,
        channel_gain: axes.accelerometer_gain,
    };
    let mut outcome = waveform_fit_of(&recorded)?;
    let fit = fit(&recorded).map_err(|fault| LabFault::Trace { what: "pulse".into(), fault })?;
    outcome.figures.extend(against_truth(lab, &drive, &fit));
    outcome.recorded = Some(recorded);
    Ok(outcome)
}

/// The drive at the allowed fraction of the motors' limit.
fn drive(lab: &LabRig, shapes: &[AxisShape; 3]) -> Drive {
    const TRIAL: i32 = 1000;
    let sustain_s = SUSTAIN_S.min(lab.model.max_sustain_s);
    let envelope = Envelope { attack_s: lab.model.attack_s, sustain_s, rest_s: lab.model.rest_s };
    let of = |unit: i32| lab.drive_around(AMPLITUDES.map(|a| a * unit), shapes, envelope);
    let unit = f64::from(TRIAL) * EFFORT * lab.model.count_limit / of(TRIAL).peak_counts();
    of(unit as i32)
}

/// The measured motion compared with the plate's true steady motion.
fn against_truth(lab: &LabRig, drive: &Drive, fit: &TwistFit) -> Vec<Figure> {
    const TRUTH: &str = "the simulated plate's true motion, settled";
    let truth = nearest_pump(&steady_motion(lab, drive), lab.model.accelerometer_in_plate_m.norm()).0;
    let mut figures =
        vec![Figure::against("spin, against truth", "rad/s", fit.pump.spin_radps, truth.spin_radps, TRUTH)];
    if let (Some(read), Some(truth)) = (fit.pump.center_of_rotation(), truth.center_of_rotation()) {
        for (axis, read, truth) in [("x", read.x, truth.x), ("y", read.y, truth.y)] {
            let name = format!("COR along {axis}, against truth");
            figures.push(Figure::against(name, "mm", mm_from_m(read), mm_from_m(truth), TRUTH));
        }
    }
    figures
}

/// Ratio and phase of the harmonics of every axis, driven alone, before and after pre-compensation; true motion.
fn precompensation(lab: &LabRig, axes: &Axes) -> Vec<Figure> {
    const SOURCE: &str = "Eq. 5, on the simulated plate's true motion";
    let mut figures = Vec::new();
    for (axis, name) in AXES.iter().enumerate() {
        for (shapes, how) in [([AxisShape::FREE_MASS; 3], "as Eq. 8"), (axes.shapes, "pre-compensated")] {
            let ratio = axis_ratio(lab, axis, &shapes);
            let name = format!("axis {name}, {how}");
            figures.push(Figure::against(format!("{name}: second over first"), "1", ratio.norm(), 0.5, SOURCE));
            let phase_deg = (-ratio).arg().to_degrees();
            figures.push(Figure::against(format!("{name}: second's lead"), "deg", phase_deg, 0.0, SOURCE));
        }
    }
    figures
}

/// True `second · conj(first)² / |first|³` of one axis driven alone; ideally -½.
fn axis_ratio(lab: &LabRig, axis: usize, shapes: &[AxisShape; 3]) -> Complex<f64> {
    let amplitudes =
        [[1, -1, 0, 0], [0, 0, 1, -1], [-1, -1, 1, 1]][axis].map(|a| a * (lab.model.count_limit * 0.4) as i32);
    let envelope = Envelope { attack_s: lab.model.attack_s, sustain_s: SUSTAIN_S, rest_s: 0.0 };
    let motion: [AxisPhasors; 3] = steady_motion(lab, &lab.drive_around(amplitudes, shapes, envelope));
    motion[axis].harmonic_ratio().unwrap_or_default()
}

/// Adds natural frequency, damping ratio and frequency response of every axis to `outcome`.
fn add_resonances(lab: &LabRig, plate: &mut BarePlate, outcome: &mut ExperimentResult) -> Result<(), LabFault> {
    const SOURCE: &str = "the rig's file; multisine, FFT, Eq. 33";
    let Some(found) = plate.resonances()? else {
        outcome.notes.push("resonances: the rig's longest sustain is too short to tell them".to_owned());
        return Ok(());
    };
    let truth = &lab.sim.plate;
    for (axis, (name, AxisResonance { fit, .. })) in AXES.iter().zip(&found).enumerate() {
        let (natural_hz, sd_hz) = (fit.natural_radps / TAU, fit.natural_sd_radps / TAU);
        let name = format!("axis {name}, resonance");
        let figures = [
            Figure::against(format!("{name}: natural"), "Hz", natural_hz, truth.resonance_hz[axis], SOURCE),
            Figure::against(format!("{name}: damping"), "1", fit.damping_ratio, truth.damping_ratio[axis], SOURCE),
            Figure::alone(format!("{name}: natural, sd"), "Hz", sd_hz, "residual of the fit"),
        ];
        outcome.figures.extend(figures);
    }
    outcome.charts.push(resonance_chart(&found));
    Ok(())
}

/// Acceleration per force over that of a free mass: at the measured lines, and of the fitted oscillators.
fn resonance_chart(found: &[AxisResonance; 3]) -> Chart {
    const STEPS: u32 = 300;
    let title = "Answer of the axes to a multisine: lines as read, and the oscillators fitted to them";
    let axes = [Axis::log("frequency (Hz)"), Axis::log("acceleration over a free mass's (1)")];
    let mut chart = Chart::over("waveform-fit-resonance", title, axes);
    for (axis, (name, AxisResonance { fit, lines })) in AXES.iter().zip(found).enumerate() {
        let relative = |radps: f64, response: Complex<f64>| [radps / TAU, response.norm() / fit.accel_per_force];
        let shown = lines.iter().map(|&(radps, response)| relative(radps, response));
        let [first, last] = [lines.first(), lines.last()].map(|line| line.map_or(1.0, |(radps, _)| *radps));
        let curve = (0..=STEPS).map(|i| first * (last / first).powf(f64::from(i) / f64::from(STEPS)));
        let fitted = curve.map(|radps| relative(radps, fit.accel_response(radps)));
        chart = chart.dots(name, Color::nth(axis), shown).line("", Color::nth(axis), fitted);
    }
    chart
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, lab_rig};
    use super::*;
    use crate::sweep::parallel;
    use rand::RngExt;
    use upm_core::random::Streams;

    fn pulse(name: &str) -> ExperimentResult {
        let lab = lab_rig(name);
        let mut plate = BarePlate::new(&lab);
        let axes = plate.axes().unwrap();
        one_pulse(&lab, &mut plate, &axes).unwrap()
    }

    #[test]
    fn fitted_figures_agree_with_the_truth() {
        for name in ["upm-1", "upm-2"] {
            let outcome = pulse(name);
            assert_sources_are_short(&outcome);
            let mut seen = 0;
            for figure in outcome.figures.iter().filter(|figure| figure.name.ends_with("against truth")) {
                let off = (figure.measured - figure.reference.unwrap()).abs();
                let bar = if figure.unit == "mm" { 0.5 } else { 0.02 * figure.measured.abs() };
                assert!(off < bar, "{name}: {figure:?}");
                seen += 1;
            }
            assert_eq!(seen, 3);
            assert!(outcome.recorded.is_some());
        }
    }

    /// FFT bins at w and 2w against least squares; noise against the sensors' own and the converter's rounding.
    #[test]
    fn spectrum_agrees_with_least_squares_and_shows_the_noise() {
        for name in ["upm-1", "upm-2"] {
            let (outcome, sensors) = (pulse(name), lab_rig(name).sim.accelerometers);
            let bins: Vec<_> = outcome.figures.iter().filter(|figure| figure.name.contains("FFT amplitude")).collect();
            let strongest = bins.iter().map(|figure| figure.measured).fold(0.0, f64::max);
            for figure in &bins {
                let off = (figure.measured - figure.reference.unwrap()).abs();
                assert!(off < 0.01 * strongest, "{name}: {figure:?}");
            }
            let noise = outcome.figures.iter().find(|figure| figure.name == "noise of a sample").unwrap().measured;
            let count_mps2 = sensors.range_mps2 / f64::from(1u32 << (sensors.bits - 1));
            let expected = sensors.noise_mps2.hypot(count_mps2 / 12f64.sqrt());
            assert!(bins.len() == 8 && (noise / expected - 1.0).abs() < 0.2, "{name}: {noise} of {expected}");
        }
    }

    #[test]
    fn resonances_are_those_of_the_rigs_file() {
        for name in ["upm-1", "upm-2"] {
            let (lab, mut outcome) = (lab_rig(name), ExperimentResult::default());
            add_resonances(&lab, &mut BarePlate::new(&lab), &mut outcome).unwrap();
            assert_sources_are_short(&outcome);
            assert_eq!((outcome.figures.len(), outcome.charts.len()), (9, 1));
            for figure in outcome.figures.iter().filter(|figure| figure.reference.is_some()) {
                let bar = if figure.unit == "Hz" { 0.03 * figure.measured } else { 0.03 };
                assert!((figure.measured - figure.reference.unwrap()).abs() < bar, "{name}: {figure:?}");
            }
        }
    }

    /// Largest errors of the harmonics against Eq. 5 after calibration, over all axes: relative error of the ratio, and
    /// phase, °. Tests require 1 % and 1°.
    fn worst_after_calibration(lab: &LabRig) -> (f64, f64) {
        let axes = BarePlate::new(lab).axes().unwrap();
        let ratios = [0, 1, 2].map(|axis| axis_ratio(lab, axis, &axes.shapes));
        let amplitude = ratios.iter().map(|r| (r.norm() / 0.5 - 1.0).abs()).fold(0.0, f64::max);
        let phase_deg = ratios.iter().map(|r| (-r).arg().to_degrees().abs()).fold(0.0, f64::max);
        (amplitude, phase_deg)
    }

    #[test]
    fn calibration_compensates_any_resonance_from_5_to_25_hz() {
        let mut rng = Streams::new(1).stream("resonances");
        let mut random_rig = |seed| {
            let mut lab = LabRig { seed, ..lab_rig("upm-1") };
            lab.sim.plate.resonance_hz = [0; 3].map(|_| rng.random_range(5.0..25.0));
            lab.sim.plate.damping_ratio = [0; 3].map(|_| rng.random_range(0.02..0.3));
            lab
        };
        let rigs: Vec<LabRig> = (0..24).map(&mut random_rig).collect();
        for (lab, (amplitude, phase_deg)) in rigs.iter().zip(parallel(&rigs, &|_| (), worst_after_calibration)) {
            assert!(amplitude < 0.01 && phase_deg < 1.0, "{:?}: {amplitude}, {phase_deg}°", lab.sim.plate);
        }
    }

    #[test]
    fn a_resonance_above_the_drive_is_refused_with_the_reason() {
        let mut lab = lab_rig("upm-1");
        lab.sim.plate.resonance_hz[1] = 75.0;
        let fault = BarePlate::new(&lab).axes().unwrap_err().to_string();
        assert!(fault.contains("axis y") && fault.contains("below the drive's frequency"), "{fault}");
    }
}
