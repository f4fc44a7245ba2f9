use std::collections::BTreeSet;
use std::path::Path;

use super::record_experiment;
use super::tests::stores;
use crate::ExperimentView;
use crate::{RecordingError, RecordingStats};
use upm_chart::{Axis, Chart, Color, Layer, Mark, Playback, PlaybackTrack};
use upm_recording::RerunMode;

/// A map and a curve with every kind of mark, and two moving parts.
fn experiment() -> ExperimentView {
    let grid = || (0..49).map(|i| [f64::from(i % 7) * 20.0 - 60.0, f64::from(i / 7) * 20.0 - 60.0]);
    let turn = |p: [f64; 2]| [-0.12 * p[1], 0.12 * p[0]];
    let cells = Mark::Cells { side: 20.0, values: grid().map(|[x, y]| x.hypot(y) / 85.0).collect() };
    let map = Chart {
        name: "field".to_owned(),
        title: "A field about the centre".to_owned(),
        x: Axis::new("x (mm)"),
        y: Axis::new("y (mm)"),
        map: true,
        layers: vec![
            Layer::new("speed", cells, Color::Blue, grid()),
            Layer::new("flow", Mark::Arrows { vectors: grid().map(turn).collect() }, Color::Orange, grid()),
            Layer::new("penny", Mark::Circles { radius: 9.5 }, Color::Green, [[40.0, 30.0]]),
            Layer::new("centre", Mark::Crosses, Color::Red, [[0.0, 0.0]]),
            Layer::plate(100.0),
        ],
    };
    let over = |f: fn(f64) -> f64| (0..=60).map(move |i| f64::from(i) / 20.0).map(move |x| [x, f(x)]);
    let curve = Chart {
        name: "force".to_owned(),
        title: "Mean force against speed".to_owned(),
        x: Axis::new("speed (m/s)"),
        y: Axis { range: Some([-1.0, 2.0]), ..Axis::new("force (mN)") },
        map: false,
        layers: vec![
            Layer::new("measured", Mark::Dots, Color::Blue, over(|x| x.sin() + 0.02 * (30.0 * x).sin())),
            Layer::new("formula", Mark::Line, Color::Orange, over(f64::sin)),
            Layer::new("limit", Mark::Dashes, Color::Gray, over(|_| 1.5)),
        ],
    };
    let t_s: Vec<f64> = (0..200).map(|i| 0.01 * f64::from(i)).collect();
    let way = |start: f64| t_s.iter().map(|t| [0.05 * (start + t).cos(), 0.05 * (start + t).sin()]).collect();
    let track =
        |label: &str, start| PlaybackTrack { label: label.to_owned(), radius_m: 9.5e-3, positions_m: way(start) };
    let motion =
        Playback { half_side_m: 0.1, tracks: vec![track("penny-1", 0.0), track("penny-2", 3.0)], t_s: t_s.clone() };
    let figures = "| figure | measured |\n| --- | ---: |\n| COR of row a along x | 40.2 |".to_owned();
    let title = "made up, seed 1".to_owned();
    ExperimentView { title, figures, charts: vec![map, curve], motion: Some(motion) }
}

fn record(experiment: &ExperimentView, path: &Path) -> Result<RecordingStats, RecordingError> {
    record_experiment(&RerunMode::Save, path, experiment)
}

#[test]
fn everything_an_experiment_leaves_is_in_its_recording() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lab.rrd");
    let stats = record(&experiment(), &path).unwrap();
    assert_eq!(stats.file_bytes, path.metadata().unwrap().len());
    let (recording, blueprint) = stores(&path);
    let entities: BTreeSet<String> = recording.all_entities().iter().map(ToString::to_string).collect();
    for path in [
        "/figures",
        "/charts/field/axes/lines",
        "/charts/field/axes/words",
        "/charts/field/legend",
        "/charts/field/1_speed",
        "/charts/field/2_flow",
        "/charts/field/3_penny",
        "/charts/field/4_centre",
        "/charts/field/5_plate",
        "/charts/force/1_measured",
        "/charts/force/2_formula",
        "/charts/force/3_limit",
        "/motion/plate",
        "/motion/parts",
        "/motion/names",
        "/motion/ways",
    ] {
        assert!(entities.contains(path), "{path} is not among {entities:#?}");
    }
    let chunks = || recording.iter_physical_chunks();
    let timelines: BTreeSet<String> =
        chunks().flat_map(|chunk| chunk.timelines().keys().map(ToString::to_string)).collect();
    assert_eq!(timelines, BTreeSet::from(["plate_time".to_owned()]));
    let rows = |path: &str| -> usize {
        let moving = chunks().filter(|chunk| !chunk.is_static() && *chunk.entity_path() == path.into());
        moving.map(|chunk| chunk.num_rows()).sum()
    };
    assert_eq!((rows("motion/parts"), rows("motion/names")), (200, 200));
    let bounded = blueprint.all_entities().iter().filter(|path| path.to_string().ends_with("VisualBounds2D")).count();
    assert_eq!(bounded, 3);
}

#[test]
fn an_experiment_without_motion_or_with_nothing_is_recorded_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lab.rrd");
    record(&ExperimentView { motion: None, ..experiment() }, &path).unwrap();
    assert!(stores(&path).0.all_entities().iter().all(|entity| !entity.to_string().starts_with("/motion")));
    record(&ExperimentView::default(), &path).unwrap();
    let broken = Playback {
        t_s: vec![0.0],
        tracks: vec![PlaybackTrack { positions_m: vec![], label: "a".into(), radius_m: 0.01 }],
        half_side_m: 0.1,
    };
    record(&ExperimentView { motion: Some(broken), ..ExperimentView::default() }, &path).unwrap();
    assert_eq!(stores(&path).0.all_entities().iter().filter(|e| e.to_string().starts_with("/motion")).count(), 1);
}

#[test]
fn off_leaves_no_file_and_an_unusable_path_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lab.rrd");
    assert_eq!(record_experiment(&RerunMode::Off, &path, &experiment()).unwrap(), RecordingStats::default());
    assert!(!path.exists());
    assert!(matches!(record(&experiment(), folder.path()), Err(RecordingError::Create { .. })));
}
