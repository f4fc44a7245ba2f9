//! Targets and paths made by a rule: where the parts go, and what is said when they do not fit.

use std::f64::consts::TAU;

use proptest::prelude::*;
use serde_json::{Value, json};

use super::{job, lines, origin, shipped, value_of};
use crate::config::{JobSpec, Origin, REST_GAP_M, TaskSpec};
use upm_core::geometry::Vec2;
use upm_goal::PathParams;

fn pennies(count: usize) -> Value {
    json!([{"kind": "penny", "count": count}])
}

fn document(parts: &Value, task: &Value) -> Value {
    json!({"name": "s", "rig": "rigs/upm-2.json", "parts": parts, "task": task})
}

fn arranged(parts: &Value, targets: &Value) -> Result<Vec<Vec2>, Vec<String>> {
    let spec = job(&document(parts, &json!({"type": "arrange", "targets": targets}))).map_err(lines)?;
    match spec.task {
        TaskSpec::Arrange { targets_m, .. } => Ok(targets_m),
        task => panic!("{task:?}"),
    }
}

fn followed(count: usize, paths: &Value, in_phase: bool) -> Result<Vec<PathParams>, Vec<String>> {
    let task = json!({"type": "trajectories", "paths": paths, "in_phase": in_phase});
    match job(&document(&pennies(count), &task)).map_err(lines)?.task {
        TaskSpec::Trajectories { paths, .. } => Ok(paths),
        task => panic!("{task:?}"),
    }
}

fn refused(parts: usize, targets: &Value) -> String {
    let faults = arranged(&pennies(parts), targets).unwrap_err();
    assert_eq!(faults.len(), 1, "{faults:?}");
    faults[0].clone()
}

/// The figure that a fault says would do: `height_mm of at least 131 mm`.
fn proposed(fault: &str, key: &str) -> f64 {
    let after = |words: &str| fault.split_once(&format!("{key} of {words} ")).map(|(_, rest)| rest);
    let rest = after("at least").or(after("at most")).unwrap_or_else(|| panic!("{fault}"));
    rest.split(' ').next().unwrap().parse().unwrap()
}

#[test]
fn each_rule_puts_the_parts_where_it_says() {
    let places = arranged(&pennies(10), &json!({"line": {"from_mm": [-120, 30], "to_mm": [120, 30]}})).unwrap();
    assert_eq!((places[0], places[9]), (Vec2::new(-0.12, 0.03), Vec2::new(0.12, 0.03)));
    let places =
        arranged(&pennies(4), &json!({"grid": {"columns": 2, "spacing_mm": 50, "center_mm": [10, 0]}})).unwrap();
    assert!((places[3] - Vec2::new(0.035, -0.025)).norm() < 1e-12, "{places:?}");
    let places =
        arranged(&pennies(4), &json!({"circle": {"radius_mm": 60, "start_deg": 90, "clockwise": true}})).unwrap();
    assert!((places[1] - Vec2::new(0.06, 0.0)).norm() < 1e-12, "{places:?}");
    let places = arranged(&pennies(2), &json!({"text": {"string": "i", "height_mm": 80}})).unwrap();
    assert!((places[0] - Vec2::new(0.0, -0.04)).norm() < 1e-12, "{places:?}");
    let places = arranged(&pennies(4), &json!({"svg": {"d": "M0 0 h8 v8 h-8 z", "width_mm": 80}})).unwrap();
    assert!((places[0] - Vec2::new(-0.04, 0.04)).norm() < 1e-12, "SVG has y downwards: {places:?}");
}

#[test]
fn exactly_one_rule_is_allowed() {
    let line = json!({"from_mm": [-120, 30], "to_mm": [120, 30]});
    let of = |targets: &Value| refused(4, targets);
    let all = "exactly one of line, grid, circle, text, svg";
    assert_eq!(of(&json!({})), format!("task.targets: expected {all}, found none"));
    let two = json!({"line": line, "circle": {"radius_mm": 50}});
    assert_eq!(of(&two), format!("task.targets: expected {all}, found line and circle"));
    assert!(of(&json!({"lin": line})).contains("did you mean line?"));
    let task = json!({"type": "arrange", "targets": {"line": line}, "targets_mm": [[0, 0]]});
    let faults = lines(job(&document(&pennies(1), &task)).unwrap_err());
    assert_eq!(faults, ["task.targets: expected one of the two, found targets and targets_mm"]);
    let faults = lines(job(&document(&pennies(1), &json!({"type": "arrange"}))).unwrap_err());
    assert!(faults[0].starts_with("task.targets_mm: expected a list of places, or targets"), "{faults:?}");
}

#[test]
fn parts_that_would_touch_are_named_with_the_size_that_fits() {
    let apart = "expected 21.050 mm or more (both radii and 2.000 mm between the rims)";
    let fault = refused(16, &json!({"text": {"string": "HI", "height_mm": 80}}));
    let found = "found penny-1 and penny-2 20.000 mm apart";
    assert_eq!(fault, format!("task.targets.text: {apart}; height_mm of at least 84.2 mm, {found}"));
    let fault = refused(10, &json!({"line": {"from_mm": [0, 0], "to_mm": [0, 90]}}));
    let found = "found penny-1 and penny-2 10.000 mm apart";
    assert_eq!(fault, format!("task.targets.line: {apart}; a length of at least 189.5 mm, {found}"));
    let fault = refused(40, &json!({"circle": {"radius_mm": 30}}));
    assert!(fault.contains("radius_mm of at least 134.2 mm, found "), "{fault}");
    let fault = refused(60, &json!({"circle": {"radius_mm": 30}}));
    assert!(fault.contains("no radius_mm gives 60 parts room there, at most 42, found "), "{fault}");
}

#[test]
fn parts_off_the_plate_are_named_with_the_size_that_fits() {
    let fault = refused(2, &json!({"line": {"from_mm": [-150, 0], "to_mm": [100, 0]}}));
    let range = "from -141.875 to 141.875 (the whole part on the plate, 1.000 mm inside its edge)";
    let expected = format!(
        "task.targets.line: expected {range}; a length of at most 233.7 mm, found penny-1 at [-150.000, 0.000]"
    );
    assert_eq!(fault, expected);
    let fault = refused(4, &json!({"circle": {"center_mm": [200, 0], "radius_mm": 60}}));
    assert!(fault.contains("a middle nearer to that of the plate, found "), "{fault}");
    let fault = refused(16, &json!({"text": {"string": "HI", "height_mm": 300}}));
    assert!(fault.contains("height_mm of at most ") && fault.contains(", found penny-"), "{fault}");
}

#[test]
fn texts_that_cannot_be_written_are_faults() {
    let text = |string: &str, parts: usize| refused(parts, &json!({"text": {"string": string, "height_mm": 100}}));
    let unknown = text("GRÜN", 16);
    assert!(
        unknown.starts_with("task.targets.text.string: expected letters of ABC")
            && unknown.ends_with("found 'Ü' in \"GRÜN\""),
        "{unknown}"
    );
    assert!(text("  ", 4).starts_with("task.targets.text.string: expected a letter or more, found \"  \""));
    let fewer = "task.targets.text: expected 8 or more: one at every end and every corner of its lines, found 3 parts";
    assert_eq!(text("HI", 3), fewer);
}

#[test]
fn drawings_and_grids_that_cannot_be_are_faults() {
    let svg = |svg: Value| json!({"svg": svg});
    for (targets, path, found) in [
        (json!({"grid": {"spacing_mm": 30}}), "task.targets.grid: ", "neither rows nor columns"),
        (json!({"grid": {"rows": 1, "columns": 3, "spacing_mm": 30}}), "task.targets.grid: ", "1 x 3 places"),
        (svg(json!({"d": "M0 0 H1"})), "task.targets.svg: expected exactly one of width_mm, height_mm", "none"),
        (svg(json!({"width_mm": 50})), "task.targets.svg: expected exactly one of file, d", "none"),
        (svg(json!({"d": "M0 0 H1", "height_mm": 50})), "task.targets.svg.d: ", "a drawing with next to no extent"),
        (svg(json!({"d": "M0 0 X", "height_mm": 50})), "task.targets.svg.d: ", ""),
        (svg(json!({"file": "none.svg", "height_mm": 50})), "$: ", "no such file"),
    ] {
        let fault = refused(4, &targets);
        assert!(fault.starts_with(path) && fault.contains(&format!(", found {found}")), "{fault}");
    }
    let text = document(&pennies(4), &json!({"type": "arrange", "targets": {"svg": {"file": "a.svg", "width_mm": 9}}}));
    let faults = JobSpec::from_json(&text.to_string(), &Origin::of_request("the request"), None).unwrap_err();
    assert!(faults.iter().any(|fault| fault.path == "task.targets.svg.file"), "{faults:?}");
}

#[test]
fn drawing_of_a_file_is_written_out() {
    let folder = tempfile::tempdir().unwrap();
    let drawing =
        r#"<svg xmlns="http://www.w3.org/2000/svg"><g transform="scale(3)"><path d="M0 0 H10 V10 H0 Z"/></g></svg>"#;
    std::fs::write(folder.path().join("square.svg"), drawing).unwrap();
    let rig = value_of("rigs/upm-2.json");
    let task = json!({"type": "arrange", "targets": {"svg": {"file": "square.svg", "width_mm": 100}}});
    let text = json!({"name": "s", "rig": rig, "parts": pennies(8), "task": task}).to_string();
    let spec = JobSpec::from_json(&text, &Origin::of_file(&folder.path().join("job.json")), None).unwrap();
    let effective = spec.effective();
    assert_eq!(effective.pointer("/task/targets/svg/file"), None);
    assert_eq!(effective.pointer("/task/targets/svg/d").unwrap(), "M0,0 L30,0 L30,30 L0,30 Z");
    std::fs::remove_file(folder.path().join("square.svg")).unwrap();
    let again =
        JobSpec::from_json(&effective.to_string(), &Origin::of_file(&folder.path().join("effective.json")), None)
            .unwrap();
    assert_eq!(again.task, spec.task);
}

#[test]
fn parts_on_one_path_begin_evenly_spaced_and_go_all_the_way_round() {
    let circle = json!([{"circle": {"radius_mm": 60}, "count": 4, "speed_mm_s": 10}]);
    let paths = followed(4, &circle, true).unwrap();
    for (path, k) in paths.iter().zip(0..) {
        let (sin, cos) = (0.25 * TAU * f64::from(k)).sin_cos();
        assert!((path.waypoints_m[0] - 0.06 * Vec2::new(cos, sin)).norm() < 1e-4, "{k}: {:?}", path.waypoints_m[0]);
        assert_eq!(path.waypoints_m.first(), path.waypoints_m.last());
    }
    let faults = followed(4, &circle, false).unwrap_err();
    assert_eq!(faults, ["task.paths[0].count: expected 1 (more parts on one path only with in_phase), found 4"]);
    let faults = followed(3, &circle, true).unwrap_err();
    assert_eq!(faults, ["task.paths: expected 3, one for each part, found 4 paths"]);
}

#[test]
fn paths_that_do_not_fit_name_the_size_that_does() {
    let one = |path: Value| followed(1, &json!([path]), false).unwrap_err();
    let faults = one(json!({"circle": {"center_mm": [100, 0], "radius_mm": 60}, "speed_mm_s": 10}));
    assert!(faults[0].ends_with("found a way through [160.000, 0.000]"), "{faults:?}");
    assert!(faults[0].contains("; radius_mm of at most 41.8 mm, found "), "{faults:?}");
    let figure = json!({"size_mm": [300, 100], "frequencies": [1, 2]});
    let faults = one(json!({"lissajous": figure, "speed_mm_s": 10}));
    assert!(faults[0].contains("; size_mm of at most [283.7, 94.5] mm, found "), "{faults:?}");
    let figure = json!({"size_mm": [283.7, 94.5], "frequencies": [1, 2]});
    assert!(followed(1, &json!([{"lissajous": figure, "speed_mm_s": 10}]), false).is_ok());
    let faults = one(json!({"lissajous": {"size_mm": [50, 50], "frequencies": [2, 4]}, "speed_mm_s": 10}));
    assert!(
        faults[0].contains("expected [1, 2], the same figure") && faults[0].ends_with("found [2, 4]"),
        "{faults:?}"
    );
    let faults = one(json!({"svg": {"d": "M0 0 H1 M0 1 H2", "width_mm": 50}, "speed_mm_s": 10}));
    assert_eq!(faults, ["task.paths[0].svg: expected one unbroken line, found a drawing of several lines"]);
    let faults = one(json!({"speed_mm_s": 10}));
    assert_eq!(faults, ["task.paths[0]: expected exactly one of waypoints_mm, circle, lissajous, svg, found none"]);
    let faults = followed(6, &json!([{"circle": {"radius_mm": 20}, "count": 6, "speed_mm_s": 10}]), true).unwrap_err();
    assert!(faults.len() == 1 && faults[0].contains(", found penny-"), "{faults:?}");
    let radius_mm = proposed(&faults[0], "radius_mm");
    let larger = json!([{"circle": {"radius_mm": radius_mm + 0.1}, "count": 6, "speed_mm_s": 10}]);
    assert!(followed(6, &larger, true).is_ok() && (21.0..21.3).contains(&radius_mm), "{faults:?}");
}

#[test]
fn effective_keeps_the_rule_and_reads_as_the_same_job() {
    for name in ["line-10.json", "letters-16.json", "circle-turns.json", "ballet-8.json"] {
        let spec = JobSpec::load(&shipped(name)).unwrap();
        let effective = spec.effective();
        assert!(effective.pointer("/task/targets").is_some() || effective.pointer("/task/paths/0/circle").is_some());
        let again = JobSpec::from_json(&effective.to_string(), &origin(), None).unwrap();
        assert_eq!((again.effective(), again.task), (effective, spec.task), "{name}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn proposed_height_fits_and_a_little_less_does_not(
        string in "[A-Z0-9]{1,3}", more in 0..12_usize, height_mm in 5.0..60.0f64,
    ) {
        let targets = |height_mm: f64| json!({"text": {"string": string, "height_mm": height_mm}});
        let parts = upm_shapes::Drawing::of_text(&string, 1.0, Vec2::zeros()).unwrap().fewest() + more;
        let Err(faults) = arranged(&pennies(parts), &targets(height_mm)) else { return Ok(()) };
        if faults[0].contains("at least") {
            let least_mm = proposed(&faults[0], "height_mm");
            prop_assert!(arranged(&pennies(parts), &targets(least_mm)).is_ok(), "{faults:?}");
            prop_assert!(arranged(&pennies(parts), &targets(least_mm - 0.2)).is_err(), "{faults:?}");
        } else {
            prop_assert!(faults[0].contains("no height_mm gives"), "{faults:?}");
        }
    }

    #[test]
    fn made_targets_keep_what_typed_ones_must(
        which in 0..4_usize, count in 1..20_usize, size_mm in 1.0..160.0f64, x in -150.0..150.0f64, y in -150.0..150.0f64,
        quarters in 0..3_usize,
    ) {
        let targets = [
            json!({"line": {"from_mm": [x, y], "to_mm": [x + size_mm, -y]}}),
            json!({"grid": {"center_mm": [x, y], "rows": 2, "spacing_mm": size_mm}}),
            json!({"circle": {"center_mm": [x, y], "radius_mm": size_mm}}),
            json!({"svg": {"d": "M0 0 C5 9 9 5 9 0 Z", "center_mm": [x, y], "width_mm": size_mm}}),
        ][which].clone();
        let parts = json!([{"kind": "penny", "count": count}, {"kind": "quarter", "count": quarters + 1}]);
        let radius_m = |part: usize| if part < count { 0.5 * 0.01905 } else { 0.5 * 0.02426 };
        let Ok(places) = arranged(&parts, &targets) else { return Ok(()) };
        prop_assert_eq!(places.len(), count + quarters + 1);
        for (i, a) in places.iter().enumerate() {
            prop_assert!(a.amax() <= 0.1524 - 1e-3 - radius_m(i) + 1e-8);
            for (k, b) in places.iter().enumerate().take(i) {
                prop_assert!((a - b).norm() >= radius_m(i) + radius_m(k) + REST_GAP_M - 1e-8);
            }
        }
        // the same places typed one by one are accepted, too
        let typed: Vec<[f64; 2]> = places.iter().map(|place| [1e3 * place.x, 1e3 * place.y]).collect();
        let typed = document(&parts, &json!({"type": "arrange", "targets_mm": typed}));
        prop_assert!(job(&typed).is_ok());
    }
}
