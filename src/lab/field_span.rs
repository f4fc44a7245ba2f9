//! Dimensions that motions of many parts span (UPM paper, section 2.1): rigid rotations about any number of centres
//! span three, the unit fields about them as many as there are centres. Pulses do so as long as they are short: a long
//! one carries the parts along with the belt, as a rigid rotation.

use std::f64::consts::TAU;

use nalgebra::DMatrix;
use rand::RngExt;

use super::pulses::{calm_envelope, place};
use super::{ExperimentResult, Figure, LabFault, LabRig, Series};
use upm_chart::{Axis, Chart, Color, Layer, Mark};
use upm_core::geometry::{Pose, Vec2, perp};
use upm_core::job::PlateMode;
use upm_core::random::Streams;
use upm_sim::{OpenPulse, simulate};

/// Parts in columns and rows, and centres: as many as the parts' coordinates.
const GRID: [usize; 2] = [4, 2];
const CENTERS: usize = 2 * GRID[0] * GRID[1];
/// Spin of the plate, rad/s, and sustains of a short and of a long pulse in periods.
const SPIN_RADPS: f64 = 8.0;
const PERIODS: [f64; 2] = [2.0, 200.0];
/// Singular value over the largest from which a dimension counts.
const COUNTED: f64 = 1e-9;

/// Singular values of the displacements of eight parts by rotations about sixteen centres drawn at random.
///
/// # Errors
///
/// [`LabFault::Rig`] when the rig's figures give no valid pulse.
pub fn field_span(rig: &LabRig) -> Result<ExperimentResult, LabFault> {
    let mut rng = Streams::new(rig.seed).stream("field span");
    let side_m = rig.sim.plate.side_m;
    let mut drawn = || Vec2::new(rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5));
    let centers_m: Vec<Vec2> = (0..CENTERS).map(|_| drawn() * side_m).collect();
    // each part near the middle of its field of the grid: none touch
    let middle = |i: usize, axis: usize| (i as f64 + 0.5) / GRID[axis] as f64 - 0.5;
    let cells = (0..GRID[0]).flat_map(|i| (0..GRID[1]).map(move |j| Vec2::new(middle(i, 0), middle(j, 1))));
    let parts_m: Vec<Vec2> = cells.map(|cell| (cell * 0.8 + drawn() * 0.05) * side_m).collect();
    let ideal =
        |of: fn(Vec2) -> Vec2| columns(&centers_m, |center| Ok(parts_m.iter().map(|p| of(p - center)).collect()));
    let pulse = |periods: f64| {
        let envelope = calm_envelope(rig, periods * TAU / rig.model.base_radps);
        columns(&centers_m, |center| displacements(rig, &parts_m, &OpenPulse::about(center, SPIN_RADPS, envelope)))
    };
    let found = [
        ("rigid rotations", ideal(perp)?),
        ("ideal fields", ideal(|arm| perp(arm) / arm.norm())?),
        ("short pulses", pulse(PERIODS[0])?),
        ("long pulses", pulse(PERIODS[1])?),
    ];
    let rank = |values: &[f64]| values.iter().filter(|value| **value > COUNTED).count() as f64;
    let source = "UPM paper, section 2.1; 8 parts, 16 centres";
    let mut figures: Vec<Figure> = found[..2]
        .iter()
        .zip([3.0, CENTERS as f64])
        .map(|((name, values), span)| Figure::against(format!("dimensions, {name}"), "1", rank(values), span, source))
        .collect();
    figures.extend(found.iter().map(|(name, values)| {
        Figure::alone(format!("fourth singular value over the first, {name}"), "1", values[3], "0 for rigid rotations")
    }));
    let layers = found.iter().enumerate().map(|(i, (name, values))| {
        let shown = values.iter().enumerate().filter(|(_, value)| **value > COUNTED);
        Layer::new(name, Mark::Line, Color::nth(i), shown.map(|(k, value)| [(k + 1) as f64, *value]))
    });
    let axes = [Axis::new("dimension"), Axis::log("singular value over the largest")];
    let chart = Chart::over("field-span", "Dimensions of the motions of 8 parts", axes, layers.collect());
    let series = found.iter().map(|(name, values)| Series::new(&name.replace(' ', "_"), values.iter().copied()));
    Ok(ExperimentResult { figures, series: series.collect(), charts: vec![chart], ..ExperimentResult::default() })
}

/// Singular values over the largest of the matrix with a column of displacements for each centre, in falling order.
fn columns(centers_m: &[Vec2], of: impl Fn(Vec2) -> Result<Vec<Vec2>, LabFault>) -> Result<Vec<f64>, LabFault> {
    let moves = centers_m.iter().map(|&center| of(center)).collect::<Result<Vec<_>, _>>()?;
    let entries = moves.iter().flatten().flat_map(|step| [step.x, step.y]);
    let mut values: Vec<f64> =
        DMatrix::from_iterator(CENTERS, CENTERS, entries).singular_values().iter().copied().collect();
    values.sort_by(|a, b| b.total_cmp(a));
    Ok(values.iter().map(|value| value / values[0]).collect())
}

/// Displacements of the parts by one pulse of a prescribed motion of the plate.
fn displacements(rig: &LabRig, parts_m: &[Vec2], pulse: &OpenPulse) -> Result<Vec<Vec2>, LabFault> {
    let parts: Vec<_> = parts_m.iter().map(|&at| (rig.penny, Pose { position_m: at, heading_rad: 0.0 })).collect();
    let pulses = std::slice::from_ref(pulse);
    let hz = rig.model.base_radps / TAU;
    let played = simulate(&rig.sim, PlateMode::Kinematic, &parts, pulses, rig.model.base_radps, hz)?;
    let ends = played
        .parts
        .iter()
        .zip(parts_m)
        .map(|(part, start)| place(part, part.x_m.len() - 1).map_or(Vec2::zeros(), |end| end - start));
    Ok(ends.collect())
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, lab_rig};
    use super::*;

    #[test]
    fn rigid_rotations_span_three_dimensions_and_fields_as_many_as_centres() {
        let outcome = field_span(&lab_rig("upm-2")).unwrap();
        assert_sources_are_short(&outcome);
        let measured: Vec<f64> = outcome.figures.iter().map(|figure| figure.measured).collect();
        assert_eq!(measured[..2], [3.0, 16.0]);
        let [rigid, ideal, short, long] = measured[2..] else { panic!("{measured:?}") };
        assert!(rigid < 1e-12 && long < 0.5 * short && short > 0.5 * ideal, "{measured:?}");
    }
}
