//! An experiment as a recording: motion, charts and the table of figures on one page.

use std::path::Path;

use rerun::blueprint::{ContainerLike, Grid, Horizontal, Spatial2DView, TextDocumentView, Vertical};
use rerun::{Ellipses2D, LineStrips2D, MediaType, Points2D, TextDocument};

use super::blueprint::ViewLayout;
use super::charts::{self, ChartView};
use super::file::RrdFile;
use super::paint::{self, above, thin};
use super::run_stream::{LogResult, RunStream};
use super::sink::record;
use super::titles;
use crate::types::ExperimentView;
use crate::types::{RecordingError, RecordingStats};
use upm_chart::{Chart, Playback, PlaybackTrack};
use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;
use upm_recording::RerunMode;

/// Columns of a page with more than three views.
const COLUMNS: u32 = 3;

/// Half the side of the view, in half sides of the plate.
const REACH: f64 = 1.15;

/// Records `experiment` into the file at `path` and to the viewer of `mode`. Does nothing with [`RerunMode::Off`].
pub fn record_experiment(
    mode: &RerunMode,
    path: &Path,
    experiment: &ExperimentView,
) -> Result<RecordingStats, RecordingError> {
    record(mode, path, |file| log(file, experiment))
}

fn log(file: RrdFile, experiment: &ExperimentView) -> LogResult {
    let charts: Vec<(String, ChartView)> =
        experiment.charts.iter().map(|chart| (format!("charts/{}", chart.name), ChartView::new(chart))).collect();
    let stream = RunStream::start(file, experiment.title.clone(), |stream| {
        let mut layout = ViewLayout::default();
        let page = page(&mut layout, experiment, &charts);
        layout.send(stream, vec![page])
    })?;
    // logged at a time, so that the time panel has its timeline even where nothing moves
    let figures = TextDocument::new(experiment.figures.as_str()).with_media_type(MediaType::markdown());
    stream.log_columns("figures", [0], figures.columns_of_unit_batches().map_err(|e| e.to_string())?)?;
    for (path, chart) in &charts {
        chart.log(&stream, path)?;
    }
    if let Some(motion) = &experiment.motion {
        log_motion(&stream, motion)?;
    }
    stream.flush()
}

/// The page: motion and charts above, figures below.
fn page(layout: &mut ViewLayout, experiment: &ExperimentView, charts: &[(String, ChartView)]) -> ContainerLike {
    let mut views: Vec<ContainerLike> = Vec::new();
    if let Some(motion) = &experiment.motion {
        let reach_mm = mm_from_m(motion.half_side_m) * REACH;
        let view = Spatial2DView::new("Playback, mm").with_origin("motion");
        views.push(layout.bounded(view, [-reach_mm, reach_mm], [-reach_mm, reach_mm]));
    }
    let columns = match charts.len() + views.len() {
        shown @ 1..=3 => shown,
        _ => COLUMNS as usize,
    };
    for ((path, view), Chart { title, .. }) in charts.iter().zip(&experiment.charts) {
        let [x, y] = view.bounds();
        let title = titles::shortened(title, titles::WINDOW / columns as f64);
        views.push(layout.bounded(Spatial2DView::new(title).with_origin(path.as_str()), x, y));
    }
    let figures = TextDocumentView::new("Figures").with_origin("figures").into();
    let page = match views.len() {
        0 => Vertical::new([figures]),
        1..=3 => Vertical::new([Horizontal::new(views).into(), figures]).with_row_shares([2.0, 1.0]),
        _ => Vertical::new([Grid::new(views).with_grid_columns(COLUMNS).into(), figures]).with_row_shares([3.0, 1.0]),
    };
    page.with_name("Experiment").into()
}

/// Logs the parts as circles over plate time, their paths and the plate.
fn log_motion(stream: &RunStream, motion: &Playback) -> LogResult {
    let (h, tracks) = (motion.half_side_m, &motion.tracks);
    let rim = [[-h, -h], [h, -h], [h, h], [-h, h], [-h, -h]].map(place);
    let plate = LineStrips2D::new([rim]).with_colors([paint::color(paint::FAINT)]).with_radii([thin(1.0)]);
    stream.log_static("motion/plate", &plate)?;
    let instants = tracks.iter().map(|track| track.positions_m.len()).fold(motion.t_s.len(), usize::min);
    if tracks.is_empty() || instants == 0 {
        return Ok(());
    }
    // those of the charts beside it
    let colors: Vec<_> = (0..tracks.len()).map(|i| charts::color(upm_chart::Color::nth(i))).collect();
    let ways = tracks.iter().map(|track| track.positions_m.iter().copied().map(place).collect::<Vec<_>>());
    let ways = LineStrips2D::new(ways).with_colors(colors.clone()).with_radii([thin(0.6)]);
    stream.log_static("motion/ways", &ways)?;
    let sizes = tracks.iter().map(|track| [mm_from_m(track.radius_m) as f32; 2]);
    let circles = Ellipses2D::update_fields().with_half_sizes(sizes).with_line_radii([thin(1.5)]);
    stream.log_static("motion/parts", &circles.with_colors(colors.clone()))?;
    let names = Points2D::update_fields().with_labels(tracks.iter().map(|track| track.label.as_str()));
    let names = names.with_show_labels(true).with_colors(colors).with_radii([thin(0.1)]);
    stream.log_static("motion/names", &names)?;

    let times_ns = || motion.t_s.iter().take(instants).map(|t| (t * 1e9).round() as i64);
    let rows = || (0..instants).map(|_| tracks.len());
    let centers = Ellipses2D::update_fields().with_centers(places(tracks, instants, |_| 0.0));
    stream.log_columns("motion/parts", times_ns(), centers.columns(rows()).map_err(|e| e.to_string())?)?;
    let below = Points2D::update_fields().with_positions(places(tracks, instants, |track| track.radius_m));
    stream.log_columns("motion/names", times_ns(), below.columns(rows()).map_err(|e| e.to_string())?)
}

/// For each instant, a point for each track, `below_m` its centre.
fn places(tracks: &[PlaybackTrack], instants: usize, below_m: impl Fn(&PlaybackTrack) -> f64) -> Vec<[f32; 2]> {
    let at = |i: usize| tracks.iter().filter_map(move |track| Some((track, *track.positions_m.get(i)?)));
    (0..instants).flat_map(at).map(|(track, [x, y])| place([x, y - below_m(track)])).collect()
}

fn place(p_m: [f64; 2]) -> [f32; 2] {
    above(Vec2::from(p_m))
}
