//! The paper's figures of ledges: separation of a block's orientations by a small difference between two edges (Eq.
//! 2.4, Fig. 2), the trials with pegs (Table 1, whose numbers are no longer legible), and consecutive ledges.

use super::cascade::cascade;
use super::peg::{Peg, Shape};
use super::trials::band;
use super::{Topple, measure, ratio_of_orientations};
use crate::numerics::bisect;
use crate::sweep::Progress;
use crate::texts::{chart, figure, figures, sheet};
use crate::{ExperimentResult, Figure, LabError, LabRig};
use upm_chart::Color;
use upm_core::background::on_all_cores;
use upm_core::random::Streams;
use upm_core::units::mm_from_m;

/// Coefficients of Eq. 2.4, recomputed.
const COEFFICIENTS: [f64; 2] = [2.207, 1.332];
/// Step of the finite differences for them.
const DELTA: f64 = 1e-3;
/// Thickness ratio of a second peg, whose height is chosen by bisection so that it topples at the same speed as the
/// published one.
const TWICE: f64 = 2.0;
const HALVINGS: usize = 60;
/// Edges of the blocks in the batch, m.
const BLOCK_M: [f64; 3] = [8e-3, 12e-3, 18e-3];

/// Reproduces all figures.
///
/// # Errors
///
/// None in the published settings.
pub fn reproduce(rig: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let streams = Streams::new(rig.seed);
    let mut outcome = orientations();
    let peg = Topple { seed: rig.seed as u32, ..Topple::published() };
    let pegs = [peg, alike(&peg)];
    let rows = on_all_cores(&pegs, &|share| progress(0.8 * share), |peg| {
        let exact_mps = peg.peg().pivot(peg.ledge_m).map_or(f64::NAN, |pivot| pivot.critical_mps());
        let band = band(&peg.scatter, exact_mps, &streams);
        let error = 100.0 * (band.middle_mps() / exact_mps - 1.0);
        let speeds = [exact_mps, band.none_mps, band.all_mps, band.middle_mps()].map(mm_from_m);
        let sizes = [mm_from_m(peg.length_m), mm_from_m(peg.height_m)];
        sizes.into_iter().chain(speeds).chain([error, 100.0 * band.width()]).collect::<Vec<f64>>()
    });
    let same = (rows[1][2] / rows[0][2] - 1.0).abs();
    outcome.sheet = Some(sheet("topple", rows));
    outcome.figures.push(figure("critical speeds of two pegs, one twice as thick, apart by", same));
    let trials = measure(&peg, &|_| ())?;
    outcome.figures.extend(trials.figures);
    outcome.charts.extend(trials.charts);
    progress(0.9);
    batch(&peg, &streams, &mut outcome)?;
    Ok(outcome)
}

/// The ratio of the critical speeds of a block's two orientations, as a power series.
fn orientations() -> ExperimentResult {
    let [less, more] = [-DELTA, DELTA].map(ratio_of_orientations);
    let found = [(more - less) / (2.0 * DELTA), (more - 2.0 + less) / (2.0 * DELTA * DELTA)];
    let [first, second] = COEFFICIENTS;
    let curve: Vec<[f64; 2]> = (0..=100).map(|i| 0.005 * f64::from(i)).map(|d| [d, ratio_of_orientations(d)]).collect();
    let power = curve.iter().map(|&[d, _]| [d, 1.0 + first * d + second * d * d]);
    let chart = chart("topple-ratio").dashes("1 + 2.207 δ + 1.332 δ²", Color::Gray, power);
    let chart = chart.line("closed form (Eq. 2.3)", Color::Blue, curve.iter().copied());
    let found = figures([
        ("ratio of the speeds of b x b(1 + δ): coefficient of δ", found[0]),
        ("the same: coefficient of δ²", found[1]),
    ]);
    ExperimentResult { figures: found.into(), charts: vec![chart], ..ExperimentResult::default() }
}

/// A cylinder twice as thick as that of `peg` that topples at the same speed.
fn alike(peg: &Topple) -> Topple {
    let critical = |height_m: f64| {
        let peg = Peg { shape: Shape::CYLINDER, length_m: TWICE * peg.length_m, height_m };
        peg.pivot(Topple::published().ledge_m).map_or(f64::INFINITY, |pivot| pivot.critical_mps())
    };
    let wanted = peg.peg().pivot(peg.ledge_m).map_or(f64::NAN, |pivot| pivot.critical_mps());
    // taller parts topple more easily
    let ends_m = [2.0 * peg.ledge_m, 100.0 * peg.height_m];
    let [_, height_m] = bisect(ends_m, HALVINGS, |height_m| critical(height_m) <= wanted);
    Topple { length_m: TWICE * peg.length_m, height_m, ..*peg }
}

/// Adds a batch on consecutive ledges.
fn batch(peg: &Topple, streams: &Streams, outcome: &mut ExperimentResult) -> Result<(), LabError> {
    let found = cascade(peg, BLOCK_M, streams)?;
    let [a, b, c] = BLOCK_M.map(mm_from_m);
    let first = figure("blocks {} mm on their largest face at first", found.flat[0]).of(&format!("{a} x {b} x {c}"));
    outcome.figures.push(first);
    for (i, (speed_mps, window_mps)) in found.speeds_mps.iter().zip(found.windows_mps).enumerate() {
        let [low, high] = window_mps.map(mm_from_m);
        let name = format!("the same after ledge {} at {:.0} mm/s", i + 1, mm_from_m(*speed_mps));
        let source = format!("window {low:.0} to {high:.0} mm/s; 2,000 blocks");
        outcome.figures.push(Figure::alone(name, "1", found.flat[i + 1], &source));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_sources_are_short, lab_rig};

    #[test]
    fn published_figures_come_out() {
        let outcome = reproduce(&lab_rig("upm-1"), &|_| ()).unwrap();
        assert_sources_are_short(&outcome);
        for (figure, coefficient) in outcome.figures.iter().zip(COEFFICIENTS) {
            assert!((figure.measured - coefficient).abs() < 1e-3, "{figure:?}");
        }
        let rows = outcome.sheet.unwrap().rows;
        let shapes = rows.iter().map(|row| row[1] / row[0]).collect::<Vec<_>>();
        assert!((rows[0][2] - rows[1][2]).abs() < 0.01 && (shapes[0] / shapes[1] - 1.0).abs() > 0.1, "{rows:?}");
        for row in &rows {
            assert!(
                row[6].abs() < 3.0 && (1.0..10.0).contains(&row[7]),
                "a narrow band about the closed form: {row:?}"
            );
        }
        let flat: Vec<f64> = outcome.figures.iter().rev().take(4).map(|figure| figure.measured).collect();
        assert!(flat[0] > 0.99 && flat[3] < 0.4, "{flat:?}");
    }
}
