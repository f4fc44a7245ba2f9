//! Recordings of tasks with bins and paths, of parts of two kinds and of many parts.

use super::RerunSink;
use super::tests::{LoggedChunks, context, recording_options, stores};
use crate::RunContext;
use upm_chart::{Ground, Palette};
use upm_core::geometry::Vec2;
use upm_core::job::{Bin, LayoutPart, LayoutPath, Region};
use upm_fixtures::synthetic_run::SyntheticRun;
use upm_recording::RerunMode;

/// The store of a recording of two cycles with `parts` parts, in a context changed by `change`.
fn recorded(parts: usize, change: impl FnOnce(&mut RunContext)) -> LoggedChunks {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let mut run = SyntheticRun::new(parts);
    let mut context = context(&run);
    change(&mut context);
    let mut sink = RerunSink::start(&RerunMode::Save, &path, context, &recording_options()).unwrap();
    run.localise(&mut sink);
    (0..2).for_each(|_| run.cycle(&mut sink));
    sink.finish().unwrap();
    stores(&path).0
}

/// Everything logged for an entity, as text.
fn logged(store: &LoggedChunks, path: &str) -> String {
    let chunks = store.chunks().filter(|chunk| *chunk.entity_path() == path.into());
    chunks.map(|chunk| chunk.to_string()).collect()
}

/// The colour as Rerun's text form has it.
fn text_of([r, g, b]: [u8; 3]) -> String {
    u32::from_be_bytes([r, g, b, 255]).to_string()
}

#[test]
fn bins_are_drawn_in_the_colour_of_their_kind_in_both_views() {
    let bin = |kind: &str, x: f64| Bin {
        kinds: vec![kind.to_owned()],
        parts: Vec::new(),
        region: Region { min_m: Vec2::new(x, -0.05), max_m: Vec2::new(x + 0.06, 0.05) },
    };
    let store = recorded(2, |context| {
        context.parts[1] = LayoutPart { id: "quarter-1".into(), kind: "quarter".into(), radius_m: 0.012 };
        context.bins = vec![bin("penny", -0.08), bin("quarter", 0.02)];
    });
    let palette = Palette::of(&["penny", "quarter"], Ground::Dark);
    for view in ["table", "camera"] {
        let (bins, names) = (logged(&store, &format!("{view}/bins")), logged(&store, &format!("{view}/bins/names")));
        for kind in ["penny", "quarter"] {
            let color = text_of(palette.kind(kind).unwrap());
            assert!(bins.contains(&color) && names.contains(&color), "{view}, {kind}: {bins} {names}");
            assert!(names.contains(&format!("bin: {kind}")), "{names}");
        }
    }
}

#[test]
fn a_part_has_one_colour_in_outline_trail_name_path_plot_and_target() {
    let store = recorded(2, |context| {
        let line_m = |y: f64| vec![Vec2::new(-0.05, y), Vec2::new(0.05, y)];
        let path = |part, y: f64| LayoutPath { part: Some(part), waypoints_m: line_m(y), closed: false };
        context.paths = vec![path(0, -0.03), path(1, 0.03)];
    });
    let palette = Palette::of(&["penny"; 2], Ground::Dark);
    for view in [
        "table/measured",
        "table/trails/measured",
        "table/names",
        "table/paths",
        "table/wanted/targets",
        "camera/parts",
        "camera/trails",
        "camera/names",
        "camera/paths",
        "camera/targets",
        "errors/to_target_mm",
        "errors/sensing_mm",
    ] {
        let logged = logged(&store, view);
        let places: Vec<_> = palette.parts().iter().map(|&rgb| logged.find(&text_of(rgb))).collect();
        assert!(places.iter().all(Option::is_some), "{view} is without a part's colour: {logged}");
        assert!(places.is_sorted(), "{view} gives parts each other's colours: {logged}");
    }
}
