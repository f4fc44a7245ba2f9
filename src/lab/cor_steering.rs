mod rows;

use self::rows::{ROWS, ReadRow, Reads, TableRow, compares_with_paper, eq_15, kappa_m, read_rows};
use super::numerics::line_through;
use super::pulses::mm;
use super::sweep::Progress;
use super::texts::figure;
use super::{ExperimentResult, Figure, LabError, LabRig};
use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::geometry::Vec2;
use upm_core::units::{INCH_M, mm_from_m};

/// The paper's step of amplitude, in its units of 128, and the sum `S` of the amplitudes in every row.
const STEP: f64 = 2.0;
const SUM: f64 = 4.0;

/// Table 1 of the UPM paper (section 4.1): amplitudes step the centre of rotation over the plate, and the
/// accelerometers measure it. The paper's amplitudes are sent to the motors through the whole chain, all scaled alike
/// where they would exceed the motors' limit: Eq. 15 depends only on their ratios.
///
/// # Errors
///
/// A rig whose motors leave no amplitude for the table, or whose traces cannot be read.
pub fn cor_steering(lab: &LabRig, _: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let Reads { unit, compensated, plain } = read_rows(lab)?;
    let centers = |reads: &[ReadRow]| reads.iter().map(|read| read.center_m).collect::<Vec<Vec2>>();
    let (found_m, plain_m) = (centers(&compensated), centers(&plain));
    let expected_m = ROWS.each_ref().map(|row| eq_15(lab, row));
    let mut figures = figures(lab, &found_m, &plain_m, &expected_m, unit);
    figures.extend(axis_figures(lab, &found_m)?);
    let off_m = compensated.iter().map(|read| read.vectors.off_m(read.center_m)).fold(0.0, f64::max);
    figures.push(figure("COR off the perpendiculars, largest", off_m / INCH_M));
    let charts = vec![chart(lab, &found_m, &plain_m, &expected_m)];
    Ok(ExperimentResult { figures, charts, ..ExperimentResult::default() })
}

/// Source of a figure of Eq. 15, with the paper's own where the rig compares with it.
fn source(lab: &LabRig, paper: &str) -> String {
    if compares_with_paper(lab) { format!("Eq. 15; {paper}") } else { "Eq. 15".to_owned() }
}

fn figures(lab: &LabRig, found_m: &[Vec2], plain_m: &[Vec2], expected_m: &[Vec2], unit: i32) -> Vec<Figure> {
    let inches = |m: f64| m / INCH_M;
    let mut figures = Vec::new();
    for ((row, found), expected) in ROWS.iter().zip(found_m).zip(expected_m) {
        let ([x1, x2, y1, y2], [paper_y, paper_x]) = (row.amplitudes, row.read_in);
        for (axis, found, expected, paper) in [("x", found.x, expected.x, paper_x), ("y", found.y, expected.y, paper_y)]
        {
            let name = format!("row {} ({x1}, {x2}, {y1}, {y2}): COR along {axis}", row.name);
            let source = source(lab, &format!("the paper read {paper}"));
            figures.push(Figure::against(name, "in", inches(found), inches(expected), &source));
        }
    }
    for (i, pair) in found_m.windows(2).enumerate() {
        let expected = (expected_m[i + 1] - expected_m[i]).norm();
        let name = format!("step {} to {}", ROWS[i].name, ROWS[i + 1].name);
        let source = source(lab, "the paper's Table 1 has 2.48 to 3.14");
        figures.push(Figure::against(name, "in", inches((pair[1] - pair[0]).norm()), inches(expected), &source));
    }
    let worst = |read: &[Vec2]| read.iter().zip(expected_m).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    figures.extend([
        figure("worst COR", inches(worst(found_m))),
        figure("worst COR without pre-compensation", inches(worst(plain_m))),
        figure("amplitude unit sent", f64::from(unit)),
    ]);
    figures
}

/// Steps of centres at one row each along y and x over a step of `X1 - X2` and of `Y2 - Y1`, by least squares.
fn steps(centers: &[Vec2]) -> [f64; 2] {
    let slope = |of: fn([i32; 4]) -> i32, axis: usize| {
        let point = |(row, center): (&TableRow, &Vec2)| [f64::from(of(row.amplitudes)), center[axis]];
        STEP * line_through(&ROWS.iter().zip(centers).map(point).collect::<Vec<_>>())[1]
    };
    [slope(|[x1, x2, ..]| x1 - x2, 1), slope(|[.., y1, y2]| y2 - y1, 0)]
}

/// Steps along both axes, compared with Eq. 15, which gives the same for both, and with the paper's, which differ by an
/// eighth; and those of this rig with the ratio of its pairs of coils that would explain the paper's, without
/// pre-compensation.
///
/// # Errors
///
/// Those of the experiment itself.
fn axis_figures(lab: &LabRig, found_m: &[Vec2]) -> Result<Vec<Figure>, LabError> {
    let expected_in = STEP / SUM * kappa_m(lab) / INCH_M;
    let [y_in, x_in] = steps(found_m).map(|step_m| step_m / INCH_M);
    let paper = steps(&ROWS.each_ref().map(|row| Vec2::new(row.read_in[1], row.read_in[0])));
    let source = |paper: f64| source(lab, &format!("the paper's rows: {paper:.2}"));
    let mut figures = vec![
        Figure::against("axis y: step by 256 of X1 - X2", "in", y_in, expected_in, &source(paper[0])),
        Figure::against("axis x: step by 256 of Y2 - Y1", "in", x_in, expected_in, &source(paper[1])),
    ];
    if compares_with_paper(lab) {
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

fn chart(lab: &LabRig, found_m: &[Vec2], plain_m: &[Vec2], expected_m: &[Vec2]) -> Chart {
    let all_mm = |points: &[Vec2]| points.iter().map(|&point| mm(point)).collect::<Vec<_>>();
    let paper: Vec<Vec2> = ROWS.iter().map(|row| Vec2::new(row.read_in[1], row.read_in[0]) * INCH_M).collect();
    let labels = Mark::Labels { texts: ROWS.iter().map(|row| row.name.to_owned()).collect() };
    let mut layers = vec![
        Layer::plate(mm_from_m(0.5 * lab.model.plate_side_m)),
        Layer::new("the way of Eq. 15", Mark::Dashes, Color::Gray, all_mm(expected_m)),
        Layer::new("Eq. 15", Mark::Circles { radius: 3.0 }, Color::Gray, all_mm(expected_m)),
        Layer::new("read here, no pre-compensation", Mark::Crosses, Color::Purple, all_mm(plain_m)),
        Layer::new("read here", Mark::Dots, Color::Blue, all_mm(found_m)),
        Layer::new("", labels, Color::Gray, all_mm(expected_m)),
    ];
    if compares_with_paper(lab) {
        layers.push(Layer::new("read in the paper", Mark::Crosses, Color::Orange, all_mm(&paper)));
    }
    Chart::plate_map("cor-steering", "Table 1, rows a to f: where the centre of rotation went", None, layers)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, lab_rig};
    use super::*;

    #[test]
    #[expect(clippy::approx_constant, reason = "the largest step of the paper's table, not π")]
    fn table_1_comes_out_through_the_whole_chain() {
        for (name, seed) in [("upm-1", 1), ("upm-1", 2), ("upm-1", 3), ("upm-2", 1)] {
            let outcome = cor_steering(&LabRig { seed, ..lab_rig(name) }, &|_| ()).unwrap();
            assert_sources_are_short(&outcome);
            let (mut rows, mut steps) = (0, 0);
            for figure in &outcome.figures {
                let off = figure.measured - figure.reference.unwrap_or_default();
                if figure.name.starts_with("row") {
                    rows += 1;
                    assert!(off.abs() < 0.15, "{name}, seed {seed}: {figure:?}");
                }
                if figure.name == "worst COR" {
                    assert!(figure.measured < 0.15, "{name}, seed {seed}: {figure:?}");
                }
                if figure.name.starts_with("step") && name == "upm-1" {
                    steps += 1;
                    assert!((2.48..=3.14).contains(&figure.measured), "{figure:?}");
                }
            }
            assert_eq!((rows, steps), (12, if name == "upm-1" { 5 } else { 0 }));
        }
    }

    #[test]
    fn paper_readings_are_shown_only_for_a_plate_like_the_papers() {
        let paper = |outcome: &ExperimentResult| {
            let layers = outcome.charts[0].layers.iter().filter(|layer| layer.label.contains("in the paper")).count();
            let sources = outcome.figures.iter().filter(|figure| figure.source.contains("paper read")).count();
            (layers, sources)
        };
        let mut lab = lab_rig("upm-1");
        let outcome = cor_steering(&lab, &|_| ()).unwrap();
        assert_eq!(paper(&outcome), (1, 12));
        let row_b = outcome.figures.iter().find(|figure| figure.name == "row b (-2, 0, 1, 1): COR along y").unwrap();
        assert_eq!(row_b.source, "Eq. 15; the paper read -2.92");
        for inertia in [&mut lab.model.plate_inertia_kgm2, &mut lab.sim.plate.inertia_kgm2] {
            *inertia *= 1.03;
        }
        assert_eq!(paper(&cor_steering(&lab, &|_| ()).unwrap()), (0, 0));
    }

    #[test]
    fn clipped_accelerometers_are_reported() {
        let mut lab = lab_rig("upm-1");
        lab.sim.accelerometers.range_mps2 = 2.0;
        let fault = cor_steering(&lab, &|_| ()).unwrap_err().to_string();
        assert!(fault.contains("clipped"), "{fault}");
    }

    #[test]
    fn papers_axes_differ_by_an_eighth_and_a_stronger_pair_of_coils_makes_the_same() {
        let lab = lab_rig("upm-1");
        let found_m: Vec<Vec2> = read_rows(&lab).unwrap().compensated.iter().map(|read| read.center_m).collect();
        let figures = axis_figures(&lab, &found_m).unwrap();
        for figure in &figures {
            assert!(figure.relative_error().unwrap().abs() < 0.05, "{figure:?}");
        }
        let ratio = figures[2].reference.unwrap();
        assert!((1.1..1.15).contains(&ratio), "{ratio}");
    }
}
