mod axes;
mod rows;

use self::rows::{ROWS, ReadRow, Reads, compares_with_paper, eq_15, read_rows};
use super::pulses::mm;
use super::sweep::Progress;
use super::texts::figure;
use super::{ExperimentResult, Figure, LabFault, LabRig};
use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::geometry::Vec2;
use upm_core::units::{INCH_M, mm_from_m};

/// Table 1 of the UPM paper (section 4.1): amplitudes step the centre of rotation over the plate, and the
/// accelerometers measure it. The paper's amplitudes are sent to the motors through the whole chain, all scaled alike
/// where they would exceed the motors' limit: Eq. 15 depends only on their ratios.
///
/// # Errors
///
/// A rig whose motors leave no amplitude for the table, or whose traces cannot be read.
pub fn cor_steering(lab: &LabRig, _: Progress<'_>) -> Result<ExperimentResult, LabFault> {
    let Reads { unit, compensated, plain } = read_rows(lab)?;
    let centers = |reads: &[ReadRow]| reads.iter().map(|read| read.center_m).collect::<Vec<Vec2>>();
    let (found_m, plain_m) = (centers(&compensated), centers(&plain));
    let expected_m = ROWS.each_ref().map(|row| eq_15(lab, row));
    let mut figures = figures(lab, &found_m, &plain_m, &expected_m, unit);
    figures.extend(axes::figures(lab, &found_m)?);
    let off_m = compensated.iter().map(|read| read.vectors.off_m(read.center_m)).fold(0.0, f64::max);
    figures.push(figure("COR off the perpendiculars, largest", off_m / INCH_M));
    let charts = vec![chart(lab, &found_m, &plain_m, &expected_m)];
    Ok(ExperimentResult { figures, charts, ..ExperimentResult::default() })
}

fn figures(lab: &LabRig, found_m: &[Vec2], plain_m: &[Vec2], expected_m: &[Vec2], unit: i32) -> Vec<Figure> {
    let as_paper = compares_with_paper(lab);
    let source = |paper: String| if as_paper { format!("Eq. 15; {paper}") } else { "Eq. 15".to_owned() };
    let inches = |m: f64| m / INCH_M;
    let mut figures = Vec::new();
    for ((row, found), expected) in ROWS.iter().zip(found_m).zip(expected_m) {
        let ([x1, x2, y1, y2], [paper_y, paper_x]) = (row.amplitudes, row.read_in);
        for (axis, found, expected, paper) in [("x", found.x, expected.x, paper_x), ("y", found.y, expected.y, paper_y)]
        {
            let name = format!("row {} ({x1}, {x2}, {y1}, {y2}): COR along {axis}", row.name);
            let source = source(format!("the paper read {paper}"));
            figures.push(Figure::against(name, "in", inches(found), inches(expected), &source));
        }
    }
    for (i, pair) in found_m.windows(2).enumerate() {
        let expected = (expected_m[i + 1] - expected_m[i]).norm();
        let name = format!("step {} to {}", ROWS[i].name, ROWS[i + 1].name);
        let source = source("the paper's Table 1 has 2.48 to 3.14".to_owned());
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
}
