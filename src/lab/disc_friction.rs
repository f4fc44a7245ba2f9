//! Friction of a disc that slides and spins at once: the simulation's table against the closed form in complete
//! elliptic integrals (Farkas, Bartels, Unger, Wolf, Phys. Rev. Lett. 90, 248302, 2003).

use std::f64::consts::PI;

use super::ExperimentResult;
use super::numerics::complete_elliptic;
use super::texts::{chart, figure};
use upm_chart::{Chart, Color};
use upm_core::disc_friction::DiscFriction;

/// Slip ratios compared, from 1e-4 to 1e4.
const RATIOS: usize = 200;
/// Every how many ratios a chart shows a dot.
const DOTS: usize = 8;
/// Slip ratio (or its inverse) below which series replace the closed form, which near 0 and far out is a difference of
/// nearly equal numbers.
const SERIES_BELOW: f64 = 0.01;

/// Slip ratio, `[f, t]` of the table, `[f, t]` of the closed form.
type FrictionRow = (f64, [f64; 2], [f64; 2]);

/// Adds the results of the comparison.
pub(super) fn report(outcome: &mut ExperimentResult) {
    let rows: Vec<FrictionRow> = slip_ratios()
        .map(|ratio| (ratio, DiscFriction::shared().force_and_torque(ratio, 1.0), closed_form(ratio)))
        .collect();
    let names = ["relative deviation of a disc's force, largest", "relative deviation of a disc's torque, largest"];
    for (i, name) in names.into_iter().enumerate() {
        // In the total order NaN is above all numbers, so that it would show.
        let worst = rows.iter().map(|(_, table, exact)| (table[i] / exact[i] - 1.0).abs()).max_by(f64::total_cmp);
        outcome.figures.push(figure(name, worst.unwrap_or(f64::NAN)));
    }
    outcome.charts.push(disc_chart(&rows));
}

/// Evenly spread over eight decades; 1, where force and torque have a kink, is inserted in the middle.
fn slip_ratios() -> impl Iterator<Item = f64> {
    let spread = (0..RATIOS - 1).map(|i| 10f64.powf(8.0 * i as f64 / (RATIOS - 2) as f64 - 4.0));
    let below = spread.clone().filter(|ratio| *ratio < 1.0 - 1e-9);
    let above = spread.filter(|ratio| *ratio > 1.0 + 1e-9);
    let corner = [1.0 - 1e-4, 1.0];
    below.chain(corner).chain(above)
}

/// `[F/(μ N), T/(μ N R)]` at slip ratio `e = v/(R w)`.
fn closed_form(e: f64) -> [f64; 2] {
    let e2 = e * e;
    if e < SERIES_BELOW {
        return [e - e.powi(3) / 8.0, 2.0 / 3.0 - e2 / 2.0];
    }
    if e > 1.0 / SERIES_BELOW {
        return [1.0 - 1.0 / (8.0 * e2), 1.0 / (4.0 * e) + 1.0 / (48.0 * e.powi(3))];
    }
    let modulus2 = e2.min(1.0 / e2);
    // at e = 1 the first kind is infinite and its factor zero: their product is zero
    let [first_kind, second_kind] = if modulus2 < 1.0 { complete_elliptic(modulus2) } else { [0.0, 1.0] };
    let scale = 4.0 / (9.0 * PI);
    if e <= 1.0 {
        let force = 3.0 / e * ((1.0 + e2) * second_kind - (1.0 - e2) * first_kind);
        [scale * force, scale * ((4.0 - 2.0 * e2) * second_kind - (1.0 - e2) * first_kind)]
    } else {
        let force = 3.0 * ((e2 + 1.0) * second_kind - (e2 - 1.0) * first_kind);
        let torque = e * ((4.0 - 2.0 * e2) * second_kind + (2.0 * e2 - 5.0 + 3.0 / e2) * first_kind);
        [scale * force, scale * torque]
    }
}

fn disc_chart(rows: &[FrictionRow]) -> Chart {
    let exact = |i: usize| rows.iter().map(move |(ratio, _, exact)| [*ratio, exact[i]]);
    let table = |i: usize| rows.iter().step_by(DOTS).map(move |(ratio, table, _)| [*ratio, table[i]]);
    chart("force-curve-disc")
        .line("closed form", Color::Gray, exact(0))
        .line("", Color::Gray, exact(1))
        .dots("force, simulated", Color::Blue, table(0))
        .dots("torque, simulated", Color::Orange, table(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_agrees_with_the_closed_form() {
        assert_eq!(slip_ratios().count(), RATIOS);
        let corner = [0.9, 0.99, 0.999, 0.9999, 1.0001, 1.001, 1.01, 1.1, 1.2];
        for e in slip_ratios().chain(corner) {
            let (table, exact) = (DiscFriction::shared().force_and_torque(e, 1.0), closed_form(e));
            assert!([0, 1].iter().all(|&i| (table[i] / exact[i] - 1.0).abs() < 2e-5), "{e}: {table:?} {exact:?}");
        }
    }

    #[test]
    fn closed_form_and_series_meet() {
        for e in [SERIES_BELOW, 1.0 / SERIES_BELOW] {
            let (below, above) = (closed_form(e * (1.0 - 1e-6)), closed_form(e * (1.0 + 1e-6)));
            for (below, above) in below.into_iter().zip(above) {
                assert!((below / above - 1.0).abs() < 3e-6, "{e}: {below} {above}");
            }
        }
    }
}
