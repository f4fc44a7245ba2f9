use std::f64::consts::TAU;

use super::force_sign::wrong_signs;
use super::pulses::envelope;
use super::recorded::{fit, waveform_fit_of};
use super::shaken::{BarePlate, steady_motion};
use super::sweep::Progress;
use super::texts::figure;
use super::{ExperimentResult, Figure, LabError, LabRig};
use upm_control::calibration::Axes;
use upm_core::signal::{Drive, RecordedPulse};
use upm_core::units::mm_from_m;
use upm_perception::estimation::{TwistFit, nearest_pump};
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
/// through the whole chain, measured and compared with the plate's true motion. In addition the spectrum of the same
/// trace by FFT, and the resonances of the axes as determined by calibration.
///
/// # Errors
///
/// [`LabError::Rig`] when calibration refuses the rig, the rig refuses a pulse, or a trace cannot be read.
pub fn waveform_fit(lab: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let mut plate = BarePlate::new(lab);
    let axes = plate.axes()?;
    let mut outcome = one_pulse(lab, &mut plate, &axes)?;
    add_resonances(lab, &mut plate, &mut outcome)?;
    let wrong = wrong_signs(lab, SIGNS, progress)? as f64;
    outcome.figures.push(figure("force signs wrong, of 10000", wrong));
    Ok(outcome)
}

fn one_pulse(lab: &LabRig, plate: &mut BarePlate, axes: &Axes) -> Result<ExperimentResult, LabError> {
    let drive = drive(lab, &axes.shapes);
    let recorded = RecordedPulse {
        trace: plate.play(&drive)?,
        envelope: drive.envelope,
        base_radps: drive.base_radps,
        accelerometer_in_plate_m: lab.model.accelerometer_in_plate_m,
        channel_gain: axes.accelerometer_gain,
    };
    let mut outcome = waveform_fit_of(&recorded)?;
    let fit = fit(&recorded).map_err(|fault| LabError::Rig(format!("pulse: {fault}")))?;
    outcome.figures.extend(against_truth(lab, &drive, &fit));
    Ok(outcome)
}

/// The drive at the allowed fraction of the motors' limit.
fn drive(lab: &LabRig, shapes: &[AxisShape; 3]) -> Drive {
    const TRIAL: i32 = 1000;
    let envelope = envelope(lab, SUSTAIN_S.min(lab.model.max_sustain_s));
    let of = |unit: i32| lab.drive_around(AMPLITUDES.map(|a| a * unit), shapes, envelope);
    let unit = f64::from(TRIAL) * EFFORT * lab.model.count_limit / of(TRIAL).peak_counts();
    of(unit as i32)
}

/// The measured motion compared with the plate's true steady motion.
fn against_truth(lab: &LabRig, drive: &Drive, fit: &TwistFit) -> Vec<Figure> {
    let truth = nearest_pump(&steady_motion(lab, drive), lab.model.accelerometer_in_plate_m.norm()).0;
    let mut figures = vec![figure("spin, against truth", fit.pump.spin_radps).with(Some(truth.spin_radps))];
    if let (Some(read), Some(truth)) = (fit.pump.center_of_rotation(), truth.center_of_rotation()) {
        figures.extend([("x", read.x, truth.x), ("y", read.y, truth.y)].map(|(axis, read_m, truth_m)| {
            figure("COR along {}, against truth", mm_from_m(read_m)).of(axis).with(Some(mm_from_m(truth_m)))
        }));
    }
    figures
}

/// Adds natural frequency and damping ratio of every axis to `outcome`.
fn add_resonances(lab: &LabRig, plate: &mut BarePlate, outcome: &mut ExperimentResult) -> Result<(), LabError> {
    let Some(found) = plate.calibrated(|session, _| session.resonances())? else {
        outcome.notes.push("resonances: the rig's longest sustain is too short to tell them".to_owned());
        return Ok(());
    };
    let truth = &lab.sim.plate;
    for (axis, (name, fit)) in AXES.iter().zip(&found).enumerate() {
        let figures = [
            figure("axis {}, resonance: natural", fit.natural_radps / TAU).with(Some(truth.resonance_hz[axis])),
            figure("axis {}, resonance: damping", fit.damping_ratio).with(Some(truth.damping_ratio[axis])),
            figure("axis {}, resonance: natural, sd", fit.natural_sd_radps / TAU),
        ];
        outcome.figures.extend(figures.map(|figure| figure.of(name)));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, lab_rig};
    use super::*;
    use nalgebra::Complex;
    use rand::RngExt;
    use upm_core::background::on_all_cores;
    use upm_core::random::Streams;
    use upm_perception::estimation::AxisPhasors;

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

    /// FFT bins at w and 2w against least squares.
    #[test]
    fn spectrum_agrees_with_least_squares() {
        for name in ["upm-1", "upm-2"] {
            let outcome = pulse(name);
            let bins: Vec<_> = outcome.figures.iter().filter(|figure| figure.name.contains("FFT amplitude")).collect();
            let strongest = bins.iter().map(|figure| figure.measured).fold(0.0, f64::max);
            for figure in &bins {
                let off = (figure.measured - figure.reference.unwrap()).abs();
                assert!(off < 0.01 * strongest, "{name}: {figure:?}");
            }
            assert_eq!(bins.len(), 8, "{name}");
        }
    }

    #[test]
    fn resonances_are_those_of_the_rigs_file() {
        for name in ["upm-1", "upm-2"] {
            let (lab, mut outcome) = (lab_rig(name), ExperimentResult::default());
            add_resonances(&lab, &mut BarePlate::new(&lab), &mut outcome).unwrap();
            assert_sources_are_short(&outcome);
            assert_eq!(outcome.figures.len(), 9);
            for figure in outcome.figures.iter().filter(|figure| figure.reference.is_some()) {
                let bar = if figure.unit == "Hz" { 0.03 * figure.measured } else { 0.03 };
                assert!((figure.measured - figure.reference.unwrap()).abs() < bar, "{name}: {figure:?}");
            }
        }
    }

    /// True `second · conj(first)² / |first|³` of one axis driven alone; ideally -½.
    fn axis_ratio(lab: &LabRig, axis: usize, shapes: &[AxisShape; 3]) -> Complex<f64> {
        let amplitudes =
            [[1, -1, 0, 0], [0, 0, 1, -1], [-1, -1, 1, 1]][axis].map(|a| a * (lab.model.count_limit * 0.4) as i32);
        let drive = lab.drive_around(amplitudes, shapes, envelope(lab, SUSTAIN_S));
        let motion: [AxisPhasors; 3] = steady_motion(lab, &drive);
        motion[axis].harmonic_ratio().unwrap_or_default()
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
        for (lab, (amplitude, phase_deg)) in rigs.iter().zip(on_all_cores(&rigs, &|_| (), worst_after_calibration)) {
            assert!(amplitude < 0.01 && phase_deg < 1.0, "{:?}: {amplitude}, {phase_deg}°", lab.sim.plate);
        }
    }
}
