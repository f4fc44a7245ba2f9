//! Steps of the centre of rotation along the two axes: the paper's differ by an eighth, while Eq. 15 gives the same for
//! both. A pair of coils stronger than the other explains the difference.

use super::rows::{ROWS, TableRow, compares_with_paper, kappa_m, read_rows};
use crate::numerics::line_through;
use crate::{Figure, LabFault, LabRig};
use upm_core::geometry::Vec2;
use upm_core::units::INCH_M;

/// The paper's step of amplitude, in its units of 128.
const STEP: f64 = 2.0;
/// Sum `S` of the amplitudes in every row, in those units.
const SUM: f64 = 4.0;

/// Steps of centres at one row each along y and x over a step of `X1 - X2` and of `Y2 - Y1`, by least squares.
fn steps(centers: &[Vec2]) -> [f64; 2] {
    let slope = |of: fn([i32; 4]) -> i32, axis: usize| {
        let point = |(row, center): (&TableRow, &Vec2)| [f64::from(of(row.amplitudes)), center[axis]];
        STEP * line_through(&ROWS.iter().zip(centers).map(point).collect::<Vec<_>>())[1]
    };
    [slope(|[x1, x2, ..]| x1 - x2, 1), slope(|[.., y1, y2]| y2 - y1, 0)]
}

/// Steps along both axes, compared with Eq. 15 and with the paper's; and those of this rig with the ratio of its pairs
/// of coils that would explain the paper's, without pre-compensation.
///
/// # Errors
///
/// Those of the experiment itself.
pub(super) fn figures(lab: &LabRig, found_m: &[Vec2]) -> Result<Vec<Figure>, LabFault> {
    let expected_in = STEP / SUM * kappa_m(lab) / INCH_M;
    let [y_in, x_in] = steps(found_m).map(|step_m| step_m / INCH_M);
    let paper = steps(&ROWS.each_ref().map(|row| Vec2::new(row.read_in[1], row.read_in[0])));
    let as_paper = compares_with_paper(lab);
    let source =
        |paper: f64| if as_paper { format!("Eq. 15; the paper's rows: {paper:.2}") } else { "Eq. 15".to_owned() };
    let mut figures = vec![
        Figure::against("axis y: step by 256 of X1 - X2", "in", y_in, expected_in, &source(paper[0])),
        Figure::against("axis x: step by 256 of Y2 - Y1", "in", x_in, expected_in, &source(paper[1])),
    ];
    if as_paper {
        let ratio = paper[0] / paper[1];
        let plain_m: Vec<Vec2> =
            read_rows(&with_stronger_x(lab, ratio))?.plain.iter().map(|read| read.center_m).collect();
        let [y_m, x_m] = steps(&plain_m);
        let name = "axis y over axis x, X coils stronger";
        let source = format!("the paper's rows; X coils {:.0} % above Y, none compensated", 100.0 * (ratio - 1.0));
        figures.push(Figure::against(name, "1", y_m / x_m, ratio, &source));
    }
    Ok(figures)
}

/// The rig with its X coils `ratio` times as strong as its Y coils, their mean kept.
fn with_stronger_x(lab: &LabRig, ratio: f64) -> LabRig {
    let mut lab = lab.clone();
    let (x, y) = (2.0 * ratio / (1.0 + ratio), 2.0 / (1.0 + ratio));
    for (gain_error, factor) in lab.sim.motors.gain_error.iter_mut().zip([x, x, y, y]) {
        *gain_error = (1.0 + *gain_error) * factor - 1.0;
    }
    lab
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::lab_rig;

    #[test]
    fn papers_axes_differ_by_an_eighth_and_a_stronger_pair_of_coils_makes_the_same() {
        let lab = lab_rig("upm-1");
        let found_m: Vec<Vec2> = read_rows(&lab).unwrap().compensated.iter().map(|read| read.center_m).collect();
        let figures = figures(&lab, &found_m).unwrap();
        for figure in &figures {
            assert!(figure.relative_error().unwrap().abs() < 0.05, "{figure:?}");
        }
        let ratio = figures[2].reference.unwrap();
        assert!((1.1..1.15).contains(&ratio), "{ratio}");
    }
}
