//! Picture of the plan of a job: bins, wanted paths and the predicted paths of its parts.

use std::collections::BTreeMap;

use super::picture::{at_mm, weakest_directions};
use super::plan::PlanReport;
use super::plan_statistics::{PlanVerdict, range};
use super::plan_table::SAME;
use upm_chart::{Chart, Color, Ground, Layer, Mark, Palette, bin_label, bin_outline};
use upm_core::job::Bin;
use upm_core::units::mm_from_m;
use upm_runner::config::JobLayout;
use upm_runner::run::PartForecast;

/// Extent of the picture, in half sides of the plate from its middle.
const PLAN_REACH: f64 = 1.08;

/// Half the length of the line in a part's weakest direction, in radii of the part.
const REACH: f64 = 1.7;

/// Chart of the plate from above: bins, wanted paths, starts, targets, and the predicted paths in the first dry run.
/// A part has one colour, parts of one kind similar ones.
pub(super) fn plan_chart(planned: &PlanReport) -> Chart {
    let PlanReport { forecast, layout, half_side_m, .. } = planned;
    let half_side_mm = mm_from_m(*half_side_m);
    let kinds: Vec<&str> = layout.parts.iter().map(|part| part.kind.as_str()).collect();
    let palette = Palette::of(&kinds, Ground::Light);
    let color = |i: usize| palette.parts().get(i).map_or(Color::Gray, |&rgb| Color::Rgb(rgb));
    let mut layers = vec![Layer::plate(half_side_mm)];
    layers.extend(bins(layout, &palette));
    let paths_m = forecast.dry_runs.first().map_or(&[][..], |dry_run| &dry_run.record.paths_m);
    let predicted = paths_m.iter().enumerate();
    layers.extend(predicted.map(|(i, path_m)| Layer::new("", Mark::Line, color(i), path_m.iter().copied().map(at_mm))));
    layers.extend(paths(layout, &color));
    layers.extend(forecast.parts.iter().enumerate().flat_map(|(i, part)| marks(part, color(i))));
    if weakness_changes(&forecast.parts) {
        layers.push(weakest_directions(forecast.parts.iter().map(|PartForecast { start, radius_m, .. }| {
            (at_mm(start.place.position_m), at_mm(start.place.weakest_direction * (REACH * radius_m)))
        })));
    }
    layers.push(names(&forecast.parts, &color));
    layers.extend(legend(planned, &palette));
    Chart::plate_map(format!("plan-{}", planned.job), plan_title(planned), Some(PLAN_REACH * half_side_mm), layers)
}

fn plan_title(planned: &PlanReport) -> String {
    let PlanReport { job, rig, forecast, .. } = planned;
    match range(&forecast.dry_runs, |report| report.plate_time_s) {
        Some([_, median_s, _]) if planned.verdict() == PlanVerdict::CanBeDone => {
            format!("{job} on {rig}: predicted to take {median_s:.1} s of plate time")
        }
        Some(_) => format!("{job} on {rig}: not every dry run reaches the goal"),
        None => format!("{job} on {rig}: predicted that it cannot be done"),
    }
}

/// True if some part can be moved less well in its weakest direction than another: directions that are all alike tell
/// nothing.
fn weakness_changes(parts: &[PartForecast]) -> bool {
    let shares = || parts.iter().map(|part| part.start.place.share);
    let most = shares().fold(0.0, f64::max);
    shares().any(|share| most - share > SAME * most)
}

/// Rims of the bins, each in the colour of its kind.
fn bins(layout: &JobLayout, palette: &Palette) -> impl Iterator<Item = Layer> {
    layout.bins.iter().map(|bin| {
        let Bin { kinds, min_m, max_m } = bin;
        let color = palette.of_bin(kinds).map_or(Color::Gray, Color::Rgb);
        Layer::new(&bin_label(kinds), Mark::Line, color, bin_outline(at_mm(*min_m), at_mm(*max_m)))
    })
}

/// The wanted paths, each in the colour of its part.
fn paths(layout: &JobLayout, color: impl Fn(usize) -> Color) -> impl Iterator<Item = Layer> {
    layout.paths.iter().map(move |path| {
        let color = path.part.map_or(Color::Gray, &color);
        Layer::new("", Mark::Dashes, color, path.line_m().into_iter().map(at_mm))
    })
}

/// Outline at the start and target of a part.
fn marks(part: &PartForecast, color: Color) -> [Layer; 2] {
    let rim = Mark::Circles { radius: mm_from_m(part.radius_m) };
    let target = part.target.iter().map(|spot| at_mm(spot.place.position_m));
    [Layer::new("", rim, color, [at_mm(part.start.place.position_m)]), Layer::new("", Mark::Crosses, color, target)]
}

/// The names of the parts beside their starts.
fn names(parts: &[PartForecast], color: &impl Fn(usize) -> Color) -> Layer {
    let names = Mark::Names {
        texts: parts.iter().map(|part| part.id.clone()).collect(),
        radii: parts.iter().map(|part| mm_from_m(part.radius_m)).collect(),
        colors: (0..parts.len()).map(color).collect(),
    };
    Layer::new("", names, Color::Gray, parts.iter().map(|part| at_mm(part.start.place.position_m)))
}

/// Entries of the legend for several layers together: each kind with number and size, then the marks of all parts.
fn legend(planned: &PlanReport, palette: &Palette) -> Vec<Layer> {
    let PlanReport { forecast, layout, .. } = planned;
    let mut kinds: BTreeMap<&str, (usize, f64)> = BTreeMap::new();
    for part in &layout.parts {
        let (count, radius_m) = kinds.entry(&part.kind).or_default();
        (*count, *radius_m) = (*count + 1, part.radius_m);
    }
    // the colours of a single kind are many
    let single = kinds.len() == 1;
    let entry = |(kind, (count, radius_m)): (&str, (usize, f64))| {
        let color = palette.kind(kind).filter(|_| !single).map_or(Color::Gray, Color::Rgb);
        let radius = mm_from_m(radius_m);
        Layer::new(
            &format!("{count} × {kind}, {:.1} mm, at the start", 2.0 * radius),
            Mark::Circles { radius },
            color,
            [],
        )
    };
    let mut entries: Vec<Layer> = kinds.into_iter().map(entry).collect();
    let mut of_all = |label: &str, mark: Mark| entries.push(Layer::new(label, mark, Color::Gray, []));
    of_all("predicted path", Mark::Line);
    if forecast.parts.iter().any(|part| part.target.is_some()) {
        of_all("target", Mark::Crosses);
    }
    if !layout.paths.is_empty() {
        of_all("wanted path", Mark::Dashes);
    }
    entries
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::progress::ProgressMode;
    use std::path::Path;
    use upm_runner::config::JobSpec;
    use upm_runner::run::{PlannerSelection, job_library};

    fn chart(job: &str) -> Chart {
        plan_chart(&planned(job))
    }

    fn planned(job: &str) -> PlanReport {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(job);
        let job = JobSpec::load(&path).unwrap();
        let library = job_library(&job).unwrap();
        PlanReport::of(&job, &library, PlannerSelection::with_forecast(&job, &library), ProgressMode::Hidden).unwrap()
    }

    fn named<'a>(chart: &'a Chart, label: &str) -> &'a Layer {
        chart.layers.iter().find(|layer| layer.label == label).unwrap_or_else(|| panic!("{label} in {chart:#?}"))
    }

    #[test]
    fn a_plan_to_sort_shows_bins_and_kinds_in_one_colour() {
        let chart = chart("sort-8.json");
        for (kind, size) in [("penny", "19.1"), ("quarter", "24.3")] {
            let bin = named(&chart, &format!("bin: {kind}"));
            assert_eq!((bin.points.len(), &bin.mark), (5, &Mark::Line));
            assert_eq!(named(&chart, &format!("4 × {kind}, {size} mm, at the start")).color, bin.color);
        }
        let circles = chart.layers.iter().filter(|layer| matches!(layer.mark, Mark::Circles { .. }));
        let mut colors: Vec<String> = circles.map(|layer| format!("{:?}", layer.color)).collect();
        colors.sort();
        colors.dedup();
        assert_eq!(colors.len(), 8 + 2, "each part has its own, each kind one for the legend");
        assert!(chart.layers.iter().all(|layer| layer.label != "weakest direction"), "alike everywhere");
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

    #[test]
    fn weakest_directions_are_drawn_where_they_differ() {
        let mut planned = planned("trajectories.json");
        let share = planned.forecast.parts[0].start.place.share;
        planned.forecast.parts[1].start.place.share = share * (1.0 + 0.5 * SAME);
        assert!(plan_chart(&planned).layers.iter().all(|layer| layer.label != "weakest direction"), "alike");
        planned.forecast.parts[1].start.place.share = share * (1.0 + 2.0 * SAME);
        let chart = plan_chart(&planned);
        let arrows = named(&chart, "weakest direction");
        let Mark::Arrows { vectors } = &arrows.mark else { panic!("arrows: {arrows:?}") };
        assert_eq!((arrows.points.len(), vectors.len()), (4, 4), "two arrows for each part");
        for (i, part) in planned.forecast.parts.iter().enumerate() {
            assert_eq!(arrows.points[2 * i], at_mm(part.start.place.position_m));
            let length_mm = vectors[2 * i][0].hypot(vectors[2 * i][1]);
            assert!((length_mm - 1e3 * REACH * part.radius_m).abs() < 1e-9, "{length_mm}");
        }
    }
}
