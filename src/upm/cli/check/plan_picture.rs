//! Picture of the plan of a job: bins, wanted paths and the predicted paths of its parts.

use super::coverage::at_mm;
use super::plan::PlanReport;
use upm_chart::{Chart, Color, Ground, Layer, Mark, Palette, bin_label, bin_outline};
use upm_core::geometry::Vec2;
use upm_core::job::Bin;
use upm_core::units::mm_from_m;
use upm_runner::config::JobLayout;
use upm_runner::run::{Forecast, PartForecast};

/// Extent of the picture, in half sides of the plate from its middle.
const PLAN_REACH: f64 = 1.08;

/// Least distance that the arrow of a path spans.
const ARROW_M: f64 = 0.012;

/// Chart of the plate from above: bins, wanted paths, starts, targets, and the predicted paths in the first dry run.
/// A part has one colour, parts of one kind similar ones.
pub(super) fn plan_chart(planned: &PlanReport<'_>) -> Chart {
    let PlanReport { job, forecast } = planned;
    let (layout, rig) = (JobLayout::of(job), &job.rig.model);
    let half_side_mm = 0.5 * mm_from_m(rig.plate_side_m);
    let kinds: Vec<&str> = layout.parts.iter().map(|part| part.kind.as_str()).collect();
    let palette = Palette::of(&kinds, Ground::Light);
    let color = |i: usize| palette.parts().get(i).map_or(Color::Gray, |&rgb| Color::Rgb(rgb));
    let mut layers = vec![Layer::plate(half_side_mm)];
    layers.extend(bins(&layout, &palette));
    let paths_m = forecast.dry_runs.0.first().map_or(&[][..], |dry_run| &dry_run.record.paths_m);
    let predicted = paths_m.iter().enumerate();
    layers.extend(predicted.flat_map(|(i, path_m)| predicted_path(path_m, color(i))));
    layers.extend(paths(&layout, &color));
    layers.extend(forecast.parts.iter().enumerate().flat_map(|(i, part)| marks(part, color(i))));
    layers.push(names(&forecast.parts, &color));
    layers.extend(legend(forecast, &layout));
    let title = format!("{} on {}: {}", job.name, rig.name, planned.verdict().text());
    Chart::plate_map(format!("plan-{}", job.name), title, Some(PLAN_REACH * half_side_mm), layers)
}

/// Rims of the bins, each in the colour of its kind.
fn bins(layout: &JobLayout, palette: &Palette) -> impl Iterator<Item = Layer> {
    layout.bins.iter().map(|bin| {
        let Bin { kinds, parts, region } = bin;
        let color = palette.of_bin(kinds).map_or(Color::Gray, Color::Rgb);
        Layer::new(&bin_label(kinds, parts), Mark::Line, color, bin_outline(at_mm(region.min_m), at_mm(region.max_m)))
    })
}

/// The wanted paths, each in the colour of its part.
fn paths(layout: &JobLayout, color: impl Fn(usize) -> Color) -> impl Iterator<Item = Layer> {
    layout.paths.iter().map(move |path| {
        let color = path.part.map_or(Color::Gray, &color);
        Layer::new("", Mark::Dashes, color, path.line_m().into_iter().map(at_mm))
    })
}

/// The predicted path of a part, with an arrow in its middle that shows which way it goes.
fn predicted_path(path_m: &[Vec2], color: Color) -> [Layer; 2] {
    let ahead = |i: usize, least_m: f64| {
        let from_m = *path_m.get(i)?;
        let to_m = path_m[i..].iter().find(|at_m| (*at_m - from_m).norm() >= least_m)?;
        Some((at_mm(from_m), at_mm(to_m - from_m)))
    };
    let travelled_m: Vec<f64> = path_m
        .windows(2)
        .scan(0.0, |sum_m, pair| {
            *sum_m += (pair[1] - pair[0]).norm();
            Some(*sum_m)
        })
        .collect();
    let length_m = travelled_m.last().copied().unwrap_or_default();
    let middle = travelled_m.partition_point(|at_m| *at_m < 0.5 * length_m);
    // a part that stays has no arrow
    let (from, vectors): (Vec<_>, Vec<_>) = ahead(middle, ARROW_M).into_iter().unzip();
    let line = Layer::new("", Mark::Line, color, path_m.iter().copied().map(at_mm));
    [line, Layer::new("", Mark::Arrows { vectors }, color, from)]
}

/// Outline of a part at its start and, with a cross, at its target.
fn marks(part: &PartForecast, color: Color) -> [Layer; 2] {
    let rim = Mark::Circles { radius: mm_from_m(part.radius_m) };
    let target = part.target.iter().map(|spot| at_mm(spot.position_m));
    let ends = [at_mm(part.start.position_m)].into_iter().chain(target.clone());
    [Layer::new("", rim, color, ends), Layer::new("", Mark::Crosses, color, target)]
}

/// The names of the parts beside their starts.
fn names(parts: &[PartForecast], color: &impl Fn(usize) -> Color) -> Layer {
    let names = Mark::Names {
        texts: parts.iter().map(|part| part.id.clone()).collect(),
        radii: parts.iter().map(|part| mm_from_m(part.radius_m)).collect(),
        colors: (0..parts.len()).map(color).collect(),
    };
    Layer::new("", names, Color::Gray, parts.iter().map(|part| at_mm(part.start.position_m)))
}

/// Entries of the legend for several layers together: the marks of all parts.
fn legend(forecast: &Forecast, layout: &JobLayout) -> impl Iterator<Item = Layer> {
    let has_targets = forecast.parts.iter().any(|part| part.target.is_some());
    let entries = [
        Some(("predicted path", Mark::Line)),
        has_targets.then_some(("target", Mark::Crosses)),
        (!layout.paths.is_empty()).then_some(("wanted path", Mark::Dashes)),
    ];
    entries.into_iter().flatten().map(|(label, mark)| Layer::new(label, mark, Color::Gray, []))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::args::Common;
    use crate::cli::progress::LateProgress;
    use std::path::Path;
    use upm_runner::config::JobSpec;
    use upm_runner::run::job_library;

    fn chart(job: &str) -> Chart {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(job);
        let job = JobSpec::load(&path).unwrap();
        let library = job_library(&job).unwrap();
        let mut progress = LateProgress::new(Common { json: false, verbose: 0, quiet: true });
        plan_chart(&PlanReport::of(&job, &[], &library, &mut progress).unwrap())
    }

    fn named<'a>(chart: &'a Chart, label: &str) -> &'a Layer {
        chart.layers.iter().find(|layer| layer.label == label).unwrap_or_else(|| panic!("{label} in {chart:#?}"))
    }

    #[test]
    fn a_plan_to_sort_shows_the_bins_and_each_part_in_its_own_colour() {
        let chart = chart("sort-8-fields.json");
        for kind in ["penny", "quarter"] {
            let bin = named(&chart, &format!("bin: {kind}"));
            assert_eq!((bin.points.len(), &bin.mark), (5, &Mark::Line));
        }
        let circles = chart.layers.iter().filter(|layer| matches!(layer.mark, Mark::Circles { .. }));
        assert!(circles.clone().all(|layer| layer.points.len() == 2), "a coin at both ends");
        let heads = chart.layers.iter().filter(|layer| matches!(layer.mark, Mark::Arrows { .. }));
        assert!(heads.clone().all(|layer| layer.points.len() == 1) && heads.count() == 8);
        let mut colors: Vec<String> = circles.map(|layer| format!("{:?}", layer.color)).collect();
        colors.sort();
        colors.dedup();
        assert_eq!(colors.len(), 8);
    }

    #[test]
    fn wanted_paths_have_the_colours_of_the_parts_that_follow_them() {
        let chart = chart("trajectories.json");
        let colors = |mark: Mark| -> Vec<Color> {
            let drawn = chart.layers.iter().filter(|layer| layer.mark == mark && layer.label.is_empty());
            drawn.map(|layer| layer.color).collect()
        };
        let dashed = colors(Mark::Dashes);
        assert!(dashed.len() == 2 && dashed[0] != dashed[1] && !dashed.contains(&Color::Gray), "{dashed:?}");
        assert_eq!(dashed, colors(Mark::Line), "the predicted paths");
        named(&chart, "wanted path");
        named(&chart, "predicted path");
    }
}
