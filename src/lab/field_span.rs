//! Dimensions that motions of many parts span (UPM paper, section 2.1): rigid rotations about any number of centres
//! span three, the unit fields about them as many as there are centres. Pulses do so as long as they are short: a long
//! one carries the parts along with the belt, as a rigid rotation.

use std::f64::consts::TAU;

use nalgebra::DMatrix;
use rand::RngExt;

use super::pulses::{envelope, play};
use super::sweep::Progress;
use super::texts::{chart, figure};
use super::{ExperimentResult, LabError, LabRig};
use upm_chart::Color;
use upm_core::geometry::{Vec2, perp};
use upm_core::job::PlateMode;
use upm_core::random::Streams;
use upm_sim::OpenPulse;

/// Parts in columns and rows, and centres: as many as the parts' coordinates.
const GRID: [usize; 2] = [4, 2];
const CENTERS: usize = 2 * GRID[0] * GRID[1];
/// Spins of a plate that is much faster than the parts and of one that they catch up with, rad/s, and periods of its
/// pulse.
const FAST: [f64; 2] = [8.0, 2.0];
const SLOW: [f64; 2] = [1.0, 15.0];
/// Singular value over the largest from which a dimension counts.
const COUNTED: f64 = 1e-9;

/// Singular values of the displacements of eight parts by rotations about sixteen centres drawn at random: in the
/// ideal, and by pulses of a prescribed motion of the plate.
///
/// # Errors
///
/// [`LabError::Rig`] when the rig's figures give no valid pulse.
pub fn field_span(rig: &LabRig, _: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let mut rng = Streams::new(rig.seed).stream("field span");
    let side_m = rig.sim.plate.side_m;
    let mut drawn = || Vec2::new(rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5));
    let centers_m: Vec<Vec2> = (0..CENTERS).map(|_| drawn() * side_m).collect();
    // each part near the middle of its cell: none touch
    let middle = |i: usize, axis: usize| (i as f64 + 0.5) / GRID[axis] as f64 - 0.5;
    let cells = (0..CENTERS / 2).map(|i| Vec2::new(middle(i % GRID[0], 0), middle(i / GRID[0], 1)));
    let parts_m: Vec<Vec2> = cells.map(|cell| (cell * 0.8 + drawn() * 0.05) * side_m).collect();
    let ideal = |of: fn(Vec2) -> Vec2| {
        let moves = centers_m.iter().flat_map(|center| parts_m.iter().map(move |part| of(part - center)));
        singular_values(moves.collect())
    };
    let pulse = |[spin_radps, periods]: [f64; 2]| {
        let envelope = envelope(rig, periods * TAU / rig.model.base_radps);
        let mut moves = Vec::new();
        for &center_m in &centers_m {
            let pulse = OpenPulse::about(center_m, spin_radps, envelope);
            let played = play(rig, PlateMode::Kinematic, &parts_m, &[pulse], rig.model.base_radps / TAU)?;
            moves.extend(parts_m.iter().enumerate().map(|(i, start)| played.end_m(i) - start));
        }
        Ok::<_, LabError>(singular_values(moves))
    };
    let found = [
        ("rigid rotations", ideal(perp)),
        ("ideal fields", ideal(|arm| perp(arm) / arm.norm())),
        ("pulses of a fast plate", pulse(FAST)?),
        ("long pulses of a slow plate", pulse(SLOW)?),
    ];
    let mut outcome = ExperimentResult::default();
    let mut chart = chart("field-span");
    for (i, (name, values)) in found.iter().enumerate() {
        let counted: Vec<f64> = values.iter().copied().filter(|value| *value > COUNTED).collect();
        let spanned = [Some(3.0), Some(CENTERS as f64), None, None][i];
        let dimensions = figure("dimensions, {}", counted.len() as f64).with(spanned);
        let fourth = figure("fourth singular value over the first, {}", values[3]);
        outcome.figures.extend([dimensions, fourth].map(|figure| figure.of(name)));
        let points = counted.into_iter().enumerate().map(|(k, value)| [(k + 1) as f64, value]);
        chart = chart.line(name, Color::nth(i), points);
    }
    outcome.charts.push(chart);
    Ok(outcome)
}

/// Singular values, over the largest and in falling order, of the matrix with a column for each centre's displacements.
fn singular_values(moves: Vec<Vec2>) -> Vec<f64> {
    let entries = moves.into_iter().flat_map(|step| [step.x, step.y]);
    let found = DMatrix::from_iterator(CENTERS, CENTERS, entries).singular_values();
    let mut values: Vec<f64> = found.iter().map(|value| value / found.max()).collect();
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, lab_rig};
    use super::*;

    #[test]
    fn rigid_rotations_span_three_dimensions_and_fields_as_many_as_centres() {
        let outcome = field_span(&lab_rig("upm-2"), &|_| ()).unwrap();
        assert_sources_are_short(&outcome);
        let measured = |name: &str| outcome.figures.iter().find(|figure| figure.name == name).unwrap().measured;
        let kinds = ["rigid rotations", "ideal fields", "pulses of a fast plate", "long pulses of a slow plate"];
        assert_eq!(kinds.map(|kind| measured(&format!("dimensions, {kind}"))), [3.0, 16.0, 16.0, 16.0]);
        let [rigid, ideal, fast, slow] =
            kinds.map(|kind| measured(&format!("fourth singular value over the first, {kind}")));
        assert!(rigid < 1e-12 && slow < 0.5 * fast && fast > 0.5 * ideal, "{ideal} {fast} {slow}");
    }
}
