//! Checks the imports of all sources against the table below, which is that of `ARCHITECTURE.md` in executable form.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

#[path = "architecture/circles.rs"]
mod circles;
#[path = "architecture/scan.rs"]
mod scan;

use scan::{Scan, scan};

/// Crates and their rooms. If a crate's only room has the crate's name, the crate is that room.
const CRATES: &[(&str, &[&str])] = &[
    (
        "core",
        &[
            "units",
            "time",
            "priority",
            "random",
            "geometry",
            "signal",
            "disc_friction",
            "ground_truth",
            "background",
            "coded_enum",
            "files",
            "job",
            "rig",
        ],
    ),
    ("document", &["document"]),
    ("sim", &["sim"]),
    ("scene", &["scene"]),
    ("perception", &["vision", "estimation"]),
    ("reference", &["reference"]),
    ("library", &["library"]),
    ("goal", &["goal"]),
    ("shapes", &["shapes"]),
    ("qp", &["qp"]),
    ("planner", &["planner"]),
    ("control", &["control"]),
    ("chart", &["chart"]),
    ("recording", &["recording"]),
    ("viewer", &["viewer"]),
    ("runner", &["config", "run"]),
    ("lab", &["lab"]),
    ("server", &["states", "store", "plates", "service", "daemon"]),
    ("fixtures", &["fixtures"]),
];

/// Rooms and their permitted imports: a room, or single items of it (`*Params`: all items that end so). Every room may
/// also import itself and the rooms of `BASE`.
const ROOMS: &[(&str, &[&str])] = &[
    ("units", &[]),
    ("time", &[]),
    ("priority", &[]),
    ("random", &[]),
    ("geometry", &[]),
    ("signal", &[]),
    ("disc_friction", &[]),
    ("ground_truth", &[]),
    ("background", &[]),
    ("coded_enum", &[]),
    ("files", &[]),
    ("job", &[]),
    ("rig", &["signal"]),
    ("sim", &["signal", "rig", "disc_friction", "ground_truth"]),
    ("vision", &["signal", "rig::PartKind"]),
    ("reference", &["signal", "rig::PartKind", "vision"]),
    ("scene", &["signal", "rig::PartKind"]),
    ("estimation", &["signal"]),
    ("document", &[]),
    ("library", &["signal"]),
    ("goal", &[]),
    ("shapes", &[]),
    ("qp", &[]),
    ("planner", &["signal", "disc_friction", "library", "qp"]),
    ("control", &["signal", "rig", "vision", "estimation", "library", "goal", "planner"]),
    ("recording", &["signal", "rig", "vision", "estimation", "library", "goal", "planner", "control", "ground_truth"]),
    (
        "viewer",
        &[
            "signal",
            "rig",
            "vision",
            "estimation",
            "library",
            "goal",
            "planner",
            "control",
            "recording",
            "chart",
            "ground_truth",
        ],
    ),
    ("fixtures", &["signal", "rig", "vision", "estimation", "library", "goal", "planner", "control", "ground_truth"]),
    ("chart", &[]),
    ("lab", &["chart", "signal", "disc_friction", "rig", "sim", "vision", "scene", "estimation", "library", "control"]),
    (
        "config",
        &[
            "signal",
            "rig::RigModel",
            "rig::FieldDriveModel",
            "rig::PartKind",
            "sim::*Params",
            "sim::faults",
            "library",
            "shapes",
            "planner::*Params",
            "goal::*Params",
            "control::*Params",
        ],
    ),
    (
        "run",
        &[
            "signal",
            "ground_truth",
            "rig",
            "sim",
            "vision",
            "estimation",
            "library",
            "goal",
            "planner",
            "control",
            "recording",
            "viewer",
            "config",
        ],
    ),
    ("states", &[]),
    ("store", &["states"]),
    (
        "plates",
        &[
            "signal",
            "rig",
            "vision",
            "library",
            "planner",
            "control",
            "recording",
            "viewer",
            "config",
            "run",
            "states",
            "store",
        ],
    ),
    ("service", &["config", "states"]),
    (
        "daemon",
        &["signal", "rig", "library", "recording", "viewer", "config", "run", "states", "store", "plates", "service"],
    ),
    (
        "cli",
        &[
            "signal",
            "rig",
            "vision",
            "library",
            "control",
            "recording",
            "viewer",
            "config",
            "run",
            "service",
            "daemon",
            "lab",
            "chart",
            "scene",
            "reference",
        ],
    ),
    ("main", &["cli"]),
];

const BASE: &[&str] =
    &["units", "time", "priority", "random", "geometry", "background", "coded_enum", "files", "job", "document"];

/// Rooms that neither control nor anything it imports may name, tests included.
const TRUTH: &[&str] = &["sim", "ground_truth"];

/// Paths outside the workspace, and the only places that may name them.
const OUTSIDE: &[(&str, &[&str])] = &[
    ("clarabel", &["src/qp"]),
    ("crossbeam_channel", &["src/core/background"]),
    ("pathfinding", &["src/goal", "src/perception/vision/tracking"]),
    ("kurbo", &["src/shapes"]),
    ("svgtypes", &["src/shapes"]),
    ("roxmltree", &["src/shapes"]),
    ("imageproc", &["src/reference", "src/cli/locate/canvas", "src/server/plates/draw"]),
    ("rustfft", &["src/perception"]),
    ("realfft", &["src/perception/vision"]),
    ("rerun", &["src/viewer"]),
    ("rusqlite", &["src/server/store"]),
    ("uuid", &["src/server/store", "src/server/service"]),
    ("rustix", &["src/core/files", "src/core/priority", "src/viewer", "src/server"]),
    ("tokio", &["src/server/service"]),
    ("axum", &["src/server/service"]),
    ("hyper", &["src/server/service"]),
    ("hyper_util", &["src/server/service"]),
    ("socket2", &["src/server/service"]),
    ("tower", &["src/server/service"]),
    ("tower_http", &["src/server/service"]),
    ("http_body_util", &["src/server/service"]),
    ("bytes", &["src/server/service", "src/server/daemon"]),
    ("futures_util", &["src/server/service"]),
    ("subtle", &["src/server/service"]),
    ("prometheus_client", &["src/server/daemon"]),
    ("tar", &["src/server/daemon"]),
    ("ureq", &["src/cli"]),
    ("getrandom", &["src/cli/token"]),
    ("csv", &["src/cli/export"]),
    ("parquet", &["src/cli/export"]),
    ("nix", &["src/cli/daemon"]),
    ("libc", &["src/main"]),
    ("clap_mangen", &["src/cli"]),
    ("clap", &["src/cli"]),
    ("plotters", &["src/chart"]),
    ("ellip", &["src/lab"]),
    ("serde", SERDE),
    ("serde_json", SERDE),
    ("schemars", SERDE),
    ("std::env", &["src/cli", "src/main"]),
];

/// Rooms that read or write external data; of the library only its file form. Job words are the same outside.
const SERDE: &[&str] = &[
    "src/core/coded_enum",
    "src/core/job",
    "src/document",
    "src/recording",
    "src/library/file",
    "src/library/raw",
    "src/runner",
    "src/cli",
    "src/server",
    "src/lab",
];

const LONGEST_FILE: usize = 400;

/// Crate of `name` (`upm_core`, `core`), with its rooms.
fn crate_rooms(name: &str) -> Option<(&'static str, &'static [&'static str])> {
    let name = name.strip_prefix("upm_").unwrap_or(name);
    CRATES.iter().find(|(of, _)| *of == name).copied()
}

/// Member crate of `file`; `None` for the root package.
fn crate_of(file: &str) -> Option<(&'static str, &'static [&'static str])> {
    let (folder, _) = file.strip_prefix("src/")?.split_once('/')?;
    crate_rooms(folder)
}

/// Room of a source: `src/core/geometry/lens.rs` is in `geometry`, `src/sim/plate.rs` in `sim`; a crate's `lib.rs` that
/// only lists rooms is in none.
fn room_of(file: &str) -> Option<&str> {
    let inside = file.strip_prefix("src/")?;
    let inside = match crate_of(file) {
        Some((name, [only])) if name == *only => return Some(only),
        Some((name, _)) => inside.strip_prefix(name)?.strip_prefix('/')?,
        None => inside,
    };
    let room = inside.split('/').next()?;
    let room = room.strip_suffix(".rs").unwrap_or(room);
    (room != "lib").then_some(room)
}

/// Depth of the file's module in its crate.
fn depth_of(file: &str) -> usize {
    let folders = file.matches('/').count() - usize::from(crate_of(file).is_some());
    if file.ends_with("/lib.rs") { 0 } else { folders }
}

/// Room, and item in it, of a path of this workspace as seen from `file`.
fn room_and_item<'a>(file: &str, segments: &'a [String]) -> Option<(&'a str, Option<&'a str>)> {
    let segment = |k: usize| segments.get(k).map(String::as_str);
    let (of, rooms) = match segment(0)? {
        "crate" => crate_of(file).unwrap_or(("upm", &[])),
        "upm" => ("upm", &[] as &[&str]),
        name if name.starts_with("upm_") => crate_rooms(name)?,
        _ => return None,
    };
    match rooms {
        [only] if *only == of => Some((only, segment(1))),
        _ => Some((segment(1)?, segment(2))),
    }
}

fn may_import(allowed: &[&str], room: &str, item: Option<&str>) -> bool {
    BASE.contains(&room)
        || allowed.iter().any(|entry| match entry.split_once("::") {
            None => *entry == room,
            Some((of, wanted)) => {
                of == room
                    && item.is_some_and(|item| match wanted.strip_prefix('*') {
                        Some(suffix) => item.ends_with(suffix),
                        None => item == wanted,
                    })
            }
        })
}

/// True if `file` belongs to a module that is compiled for tests only.
fn is_test_file(files: &[(String, String)], scans: &[Scan], file: &str) -> bool {
    files.iter().zip(scans).any(|((parent, _), scan)| {
        let folder = parent.trim_end_matches("/mod.rs").trim_end_matches("/lib.rs").trim_end_matches(".rs");
        scan.test_modules
            .iter()
            .any(|m| file.strip_prefix(&format!("{folder}/{m}")).is_some_and(|r| r.starts_with(['.', '/'])))
    })
}

/// Import cycles among `files` (path and text), tests left out.
fn circles_in(files: &[(String, String)]) -> Vec<String> {
    let scans: Vec<Scan> = files.iter().map(|(file, text)| scan(text, depth_of(file))).collect();
    let all = files.iter().zip(&scans).map(|((file, _), scan)| (file.as_str(), scan));
    let shipped: Vec<(&str, &Scan)> = all.filter(|(file, _)| !is_test_file(files, &scans, file)).collect();
    let members: Vec<&str> = CRATES.iter().map(|(name, _)| *name).collect();
    circles::circles(&shipped, &members)
}

/// All violations of the rules in `files` (path and text), as `file:line: rule`.
fn faults(files: &[(String, String)]) -> Vec<String> {
    let scans: Vec<Scan> = files.iter().map(|(file, text)| scan(text, depth_of(file))).collect();
    let is_test_file = |file: &str| is_test_file(files, &scans, file);
    let mut faults = Vec::new();
    // For every room, the place of each import outside tests.
    let mut imports: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    let mut truth_mentions = Vec::new();
    for ((file, text), scan) in files.iter().zip(&scans) {
        let lines = text.lines().count();
        if lines > LONGEST_FILE {
            faults.push(format!("{file}:{lines}: files have at most {LONGEST_FILE} lines"));
        }
        let Some(room) = room_of(file) else { continue };
        let Some((_, allowed)) = ROOMS.iter().find(|(name, _)| *name == room) else {
            faults.push(format!("{file}:1: `{room}` is not in the table of rooms"));
            continue;
        };
        let test_file = is_test_file(file);
        for mention in &scan.mentions {
            let at = format!("{file}:{}", mention.line);
            if let Some((other, item)) = room_and_item(file, &mention.segments) {
                if TRUTH.contains(&other) {
                    truth_mentions.push((room, other, at.clone()));
                }
                if other == room || mention.in_test || test_file {
                    continue;
                }
                imports.entry(room).or_default().insert(other);
                if !may_import(allowed, other, item) {
                    let path = std::iter::once(other).chain(item).collect::<Vec<_>>().join("::");
                    faults.push(format!("{at}: `{room}` may not import `{path}`"));
                }
            } else if !(mention.in_test || test_file) {
                let written = mention.segments.join("::") + "::";
                for (outside, places) in OUTSIDE.iter().filter(|(o, _)| written.starts_with(&format!("{o}::"))) {
                    if !places.iter().any(|place| file.starts_with(place)) {
                        faults.push(format!("{at}: `{outside}` is named in {} only", places.join(", ")));
                    }
                }
            }
        }
    }
    // Control must not reach the truth by any chain of imports, tests included.
    let (mut ways, mut queue) = (BTreeMap::from([("control", "control".to_owned())]), vec!["control"]);
    while let Some(room) = queue.pop() {
        for &next in imports.get(room).into_iter().flatten().filter(|next| !TRUTH.contains(*next)) {
            let way = format!("{} -> {next}", ways[room]);
            if ways.insert(next, way).is_none() {
                queue.push(next);
            }
        }
    }
    faults.extend(
        truth_mentions
            .iter()
            .filter_map(|(room, of, at)| Some(format!("{at}: control reaches {of}: {} -> {of}", ways.get(room)?))),
    );
    faults
}

fn sources(folder: &Path, name: &str, files: &mut Vec<(String, String)>) -> std::io::Result<()> {
    let mut entries = std::fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    entries.sort_by_key(|entry| entry.file_name());
    for entry in entries {
        let name = format!("{name}/{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            sources(&entry.path(), &name, files)?;
        } else if name.ends_with(".rs") {
            files.push((name, std::fs::read_to_string(entry.path())?));
        }
    }
    Ok(())
}

fn project() -> std::io::Result<Vec<(String, String)>> {
    let mut files = Vec::new();
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), "src", &mut files)?;
    Ok(files)
}

#[test]
fn rooms_import_only_what_they_may() {
    let files = project().unwrap();
    assert!(files.len() > 20, "sources are where they are looked for");
    let faults = faults(&files);
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

#[test]
fn files_import_each_other_in_no_circle() {
    let circles = circles_in(&project().unwrap());
    assert!(circles.is_empty(), "\n{}", circles.join("\n"));
}

#[test]
fn every_room_is_on_the_map() {
    let map = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("ARCHITECTURE.md")).unwrap();
    let cells: Vec<&str> = map.lines().filter_map(|line| line.strip_prefix('|')?.split('|').next()).collect();
    for room in project().unwrap().iter().filter_map(|(file, _)| room_of(file)) {
        let on_map = [".rs`", "/`"]
            .iter()
            .flat_map(|end| ["`", "/"].map(|start| format!("{start}{room}{end}")))
            .any(|written| cells.iter().any(|cell| cell.contains(&written)));
        assert!(on_map, "ARCHITECTURE.md: the map has no row for `{room}`");
    }
}

/// Sections of a manifest's dependencies, with the workspace's crates in each.
fn member_dependencies(manifest: &str) -> Vec<(String, String)> {
    let (mut section, mut found) = (String::new(), Vec::new());
    for line in manifest.lines() {
        if line.starts_with('[') {
            section = line.trim_matches(['[', ']']).to_owned();
        }
        let name = line.split(['.', ' ', '=']).next().unwrap_or_default();
        if let (true, Some(name)) = (section.ends_with("dependencies"), name.strip_prefix("upm-")) {
            found.push((section.clone(), name.to_owned()));
        }
    }
    found
}

#[test]
fn no_crate_that_control_builds_on_knows_the_simulator() {
    let manifest = |name: &str| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(name);
        std::fs::read_to_string(folder.join("Cargo.toml")).unwrap()
    };
    let (mut reached, mut queue) = (BTreeSet::from(["control".to_owned()]), vec!["control".to_owned()]);
    while let Some(name) = queue.pop() {
        for (_, next) in member_dependencies(&manifest(&name)) {
            if reached.insert(next.clone()) {
                queue.push(next);
            }
        }
    }
    assert!(reached.contains("core") && reached.contains("planner"), "{reached:?}");
    assert!(!reached.contains("sim"), "control builds on sim: {reached:?}");
    for (name, _) in CRATES {
        for (section, of) in member_dependencies(&manifest(name)) {
            assert!(of != "fixtures" || section == "dev-dependencies", "{name}: fixtures are for tests");
        }
    }
}

fn faults_of(files: &[(&str, &str)]) -> Vec<String> {
    faults(&files.iter().map(|(file, text)| (file.to_string(), text.to_string())).collect::<Vec<_>>())
}

#[test]
fn forbidden_imports_are_found_however_they_are_written() {
    for source in [
        "use upm_sim::SimRig;",
        "pub use {upm_core::geometry::Vec2, upm_sim::SimRig};",
        "fn f() { let t = upm_sim::SimRig::default(); }",
        "mod inner { use upm_sim; }",
        "const C: char = '\"'; use upm_sim as s;",
        "#[cfg(not(test))] use upm_sim;",
    ] {
        let found = faults_of(&[("src/goal/plus_sign.rs", source)]);
        assert_eq!(found.len(), 1, "{source}: {found:?}");
        assert!(found[0].starts_with("src/goal/plus_sign.rs:1: `goal` may not import `sim"), "{found:?}");
    }
    assert_eq!(
        faults_of(&[("src/perception/vision/a.rs", "\n\nuse super::super::estimation;")]),
        ["src/perception/vision/a.rs:3: `vision` may not import `estimation`"]
    );
    assert_eq!(
        faults_of(&[("src/core/geometry.rs", "use crate::signal::Frame;")]),
        ["src/core/geometry.rs:1: `geometry` may not import `signal::Frame`"]
    );
    assert_eq!(
        faults_of(&[("src/main.rs", "fn main() { upm::run::run() }")]),
        ["src/main.rs:1: `main` may not import `run::run`"]
    );
    assert_eq!(
        faults_of(&[("src/runner/run.rs", "use upm_lab::Figure;")]),
        ["src/runner/run.rs:1: `run` may not import `lab::Figure`"]
    );
    assert_eq!(faults_of(&[("src/utils.rs", "")]), ["src/utils.rs:1: `utils` is not in the table of rooms"]);
}

#[test]
fn allowed_imports_and_mere_words_are_not() {
    for source in [
        "use upm_core::{geometry::{Twist, Vec2}, time::PlateTime};",
        "// use upm_sim\n/* upm_sim::SimRig */ const A: &str = \"upm_sim::SimRig\"; const B: &str = r#\"\"upm_sim::SimRig\"#;",
        "use super::goal::Wanted; fn f<'a>(x: &'a str) -> impl Sized + use<'a> { x }",
        "#[cfg(test)]\nmod tests { use super::*; use upm_core::signal::Frame; fn f() { serde_json::to_string(&1); } }",
        "struct S { rerun: bool, sim: u8 }",
    ] {
        assert_eq!(faults_of(&[("src/goal/plus_sign.rs", source)]), [""; 0], "{source}");
    }
    let test_file = [
        ("src/goal/lib.rs", "#[cfg(test)]\nmod long_tests;"),
        ("src/goal/long_tests.rs", "use upm_core::signal::Frame;"),
    ];
    assert_eq!(faults_of(&test_file), [""; 0]);
    assert_eq!(faults_of(&test_file[1..]).len(), 1);
}

#[test]
fn single_items_are_told_apart() {
    assert_eq!(faults_of(&[("src/runner/config.rs", "use upm_sim::{SimParams, CameraParams};")]), [""; 0]);
    assert_eq!(faults_of(&[("src/runner/config.rs", "use upm_sim::{SimParams, SimRig};")]).len(), 1);
    assert_eq!(faults_of(&[("src/runner/config.rs", "use upm_sim::SimParams; use upm_sim::*;")]).len(), 1);
}

#[test]
fn control_reaches_sim_neither_through_others_nor_in_tests() {
    let files = [
        ("src/control/lib.rs", "use upm_planner::Plan;"),
        ("src/planner/plan.rs", "use upm_library::Library;"),
        ("src/library/look.rs", "#[cfg(test)]\nmod tests {\n    use upm_sim::SimRig;\n}"),
    ];
    assert_eq!(faults_of(&files), ["src/library/look.rs:3: control reaches sim: control -> planner -> library -> sim"]);
    assert_eq!(faults_of(&files[1..]), [""; 0]);
    let truth = [("src/control/eyes.rs", "use upm_core::ground_truth::GroundTruth;")];
    assert_eq!(faults_of(&truth).len(), 2, "not allowed, and within reach of control");
}

#[test]
fn outside_crates_have_their_places_and_files_their_length() {
    assert_eq!(
        faults_of(&[("src/control/plans.rs", "use clarabel::solver;")]),
        ["src/control/plans.rs:1: `clarabel` is named in src/qp only"]
    );
    assert_eq!(faults_of(&[("src/goal/plus_sign.rs", "#[derive(serde::Serialize)] struct S;")]).len(), 1);
    assert_eq!(faults_of(&[("src/control/plans.rs", "use std::{env, fmt};")]).len(), 1);
    assert_eq!(
        faults_of(&[("src/qp/lib.rs", "use clarabel::solver;"), ("src/library/file.rs", "use serde::Serialize;")]),
        [""; 0]
    );
    let long = "\n".repeat(401);
    assert_eq!(
        faults_of(&[("src/goal/plus_sign.rs", &long)]),
        ["src/goal/plus_sign.rs:401: files have at most 400 lines"]
    );
}

#[test]
fn circles_are_found_through_names_that_are_handed_on_and_only_outside_tests() {
    let found = |files: &[(&str, &str)]| {
        circles_in(&files.iter().map(|(file, text)| (file.to_string(), text.to_string())).collect::<Vec<_>>())
    };
    let room = ("src/goal/lib.rs", "mod a; mod b; pub use a::A; pub use b::B;");
    let both =
        [room, ("src/goal/a.rs", "use super::B; pub struct A;"), ("src/goal/b.rs", "use crate::A; pub struct B;")];
    let circle = "circle of 2 files:\n  src/goal/a.rs -> src/goal/b.rs: B\n  src/goal/b.rs -> src/goal/a.rs: A";
    assert_eq!(found(&both), [circle]);
    let one_way = [room, both[1], ("src/goal/b.rs", "#[cfg(test)] mod tests { use super::super::A; } pub struct B;")];
    assert_eq!(found(&one_way), [""; 0], "tests may");
    let parent = [
        ("src/goal/lib.rs", "mod a; pub struct P; fn f() { a::g() }"),
        ("src/goal/a.rs", "use super::P; pub fn g() {}"),
    ];
    assert_eq!(found(&parent).len(), 1, "a parent that uses its child");
    let renamed = [
        ("src/goal/lib.rs", "mod a; mod b;"),
        ("src/goal/a.rs", "use super::b as other; pub const A: u8 = other::B;"),
        ("src/goal/b.rs", "use super::a::*; pub const B: u8 = 1; const C: u8 = A;"),
    ];
    assert_eq!(found(&renamed).len(), 1);
}
