//! The resonance search of calibration, beside the figures of the rig's file.

use std::f64::consts::TAU;

use nalgebra::Complex;

use super::shaken::ShakenPlate;
use super::{Figure, LabFault, LabRig, Outcome, Series};
use upm_chart::{Chart, Color, Layer, Mark};
use upm_control::calibration::AxisResonance;

const AXES: [&str; 3] = ["x", "y", "spin"];

/// Adds natural frequency and damping ratio of every axis, and its frequency response, to `outcome`.
pub(super) fn add_resonances(lab: &LabRig, plate: &mut ShakenPlate, outcome: &mut Outcome) -> Result<(), LabFault> {
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
    outcome.series.push(Series::new("line_hz", found[0].lines.iter().map(|(radps, _)| radps / TAU)));
    for (name, AxisResonance { fit, lines }) in AXES.iter().zip(&found) {
        let relative = lines.iter().map(|(_, response)| response.norm() / fit.accel_per_force);
        outcome.series.push(Series::new(&format!("{name}_response"), relative));
    }
    outcome.charts.push(chart(&found));
    Ok(())
}

/// Acceleration per force over that of a free mass: what the lines show, and the oscillators fitted.
fn chart(found: &[AxisResonance; 3]) -> Chart {
    const STEPS: u32 = 300;
    let mut layers = Vec::new();
    for (axis, (name, AxisResonance { fit, lines })) in AXES.iter().zip(found).enumerate() {
        let relative = |radps: f64, response: Complex<f64>| [radps / TAU, response.norm() / fit.accel_per_force];
        let shown = lines.iter().map(|&(radps, response)| relative(radps, response));
        layers.push(Layer::new(name, Mark::Dots, Color::nth(axis), shown));
        let last = lines.last().map_or(0.0, |(radps, _)| *radps);
        let curve = (1..=STEPS).map(|i| last * f64::from(i) / f64::from(STEPS));
        let fitted = curve.map(|radps| relative(radps, fit.accel_response(radps)));
        layers.push(Layer::new("", Mark::Line, Color::nth(axis), fitted));
    }
    Chart::plot(
        "waveform-fit-resonance",
        "Answer of the axes to a multisine: lines as read, and the oscillators fitted to them",
        ["frequency (Hz)", "acceleration over a free mass's (1)"],
        layers,
    )
}
