//! Who may import whom, held against the sources. The table below is the one of `ARCHITECTURE.md` in a form that can fail.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

#[path = "architecture/scan.rs"]
mod scan;

use scan::{Scan, scan};

/// A room and what it may import besides itself: a room, or single items of it (`*Params`: all that end so).
/// The rooms of `BASE` may be imported by all.
const ROOMS: &[(&str, &[&str])] = &[
    ("units", &[]),
    ("time", &[]),
    ("priority", &[]),
    ("random", &[]),
    ("geometry", &[]),
    ("signal", &[]),
    ("rig", &["signal"]),
    ("sim", &["signal", "rig"]),
    ("vision", &["signal", "rig::PartKind"]),
    ("scene", &["signal", "rig::PartKind"]),
    ("estimation", &["signal"]),
    ("library", &["signal"]),
    ("goal", &[]),
    ("planner", &["signal", "library"]),
    ("control", &["signal", "rig", "vision", "estimation", "library", "goal", "planner"]),
    (
        "recording",
        &[
            "signal",
            "rig",
            "vision",
            "estimation",
            "library",
            "goal",
            "planner",
            "control",
            "sim::Truth",
            "sim::PartTruth",
            "sim::TruthProbe",
            "chart",
            "lab::Figure",
            "lab::HEADS",
            "lab::Motion",
            "lab::NUMBERS",
            "lab::Outcome",
            "lab::Track",
        ],
    ),
    ("chart", &[]),
    ("lab", &["chart", "signal", "rig", "sim", "vision", "scene", "estimation", "library", "control"]),
    (
        "config",
        &[
            "signal",
            "rig::RigModel",
            "rig::FieldDriveModel",
            "rig::PartKind",
            "sim::*Params",
            "library",
            "planner::*Params",
            "goal::*Params",
            "control::*Params",
        ],
    ),
    (
        "run",
        &[
            "signal",
            "rig",
            "sim",
            "vision",
            "estimation",
            "library",
            "goal",
            "planner",
            "control",
            "recording",
            "config",
        ],
    ),
    ("store", &[]),
    ("plates", &["signal", "rig", "vision", "library", "planner", "control", "recording", "config", "run", "store"]),
    ("service", &["config"]),
    ("daemon", &["signal", "rig", "library", "recording", "config", "run", "store", "plates", "service"]),
    (
        "cli",
        &[
            "signal",
            "rig",
            "vision",
            "library",
            "control",
            "recording",
            "config",
            "run",
            "service",
            "daemon",
            "lab",
            "chart",
            "scene",
        ],
    ),
    ("main", &["cli"]),
];

const BASE: &[&str] = &["units", "time", "priority", "random", "geometry"];

/// Paths outside the crate and the only places that may name them.
const OUTSIDE: &[(&str, &[&str])] = &[
    ("clarabel", &["src/planner"]),
    ("pathfinding", &["src/goal"]),
    ("rerun", &["src/recording"]),
    ("rusqlite", &["src/store"]),
    ("uuid", &["src/store", "src/service"]),
    ("rustix", &["src/priority", "src/recording", "src/store", "src/plates", "src/service", "src/daemon"]),
    ("tokio", &["src/service"]),
    ("axum", &["src/service"]),
    ("hyper", &["src/service"]),
    ("hyper_util", &["src/service"]),
    ("tower", &["src/service"]),
    ("http_body_util", &["src/service"]),
    ("bytes", &["src/service", "src/daemon"]),
    ("futures_util", &["src/service"]),
    ("subtle", &["src/service"]),
    ("prometheus_client", &["src/daemon"]),
    ("tar", &["src/daemon"]),
    ("ureq", &["src/cli"]),
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

/// The rooms where data meets the outside; of the library only its file form.
const SERDE: &[&str] = &[
    "src/config",
    "src/recording",
    "src/library/file",
    "src/library/raw",
    "src/cli",
    "src/run",
    "src/store",
    "src/plates",
    "src/service",
    "src/daemon",
    "src/lab",
];

const LONGEST_FILE: usize = 400;

/// `src/goal/plus_sign.rs` is in `goal`; `src/lib.rs` is in none.
fn room_of(file: &str) -> Option<&str> {
    let inside = file.strip_prefix("src/")?;
    let room = inside.split('/').next()?;
    let room = room.strip_suffix(".rs").unwrap_or(room);
    (room != "lib").then_some(room)
}

fn depth_of(file: &str) -> usize {
    file.matches('/').count() - usize::from(file.ends_with("/mod.rs"))
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

/// Every breach of the rules in `files` (path and text), as `file:line: rule`.
fn faults(files: &[(String, String)]) -> Vec<String> {
    let scans: Vec<Scan> = files.iter().map(|(file, text)| scan(text, depth_of(file))).collect();
    let is_test_file = |file: &str| {
        files.iter().zip(&scans).any(|((parent, _), scan)| {
            let folder = parent.trim_end_matches("/mod.rs").trim_end_matches(".rs");
            scan.test_modules
                .iter()
                .any(|m| file.strip_prefix(&format!("{folder}/{m}")).is_some_and(|r| r.starts_with(['.', '/'])))
        })
    };
    let mut faults = Vec::new();
    // For every room where its imports outside tests are written.
    let mut imports: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    let mut sim_mentions = Vec::new();
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
            let segment = |k: usize| mention.segments.get(k).map(String::as_str);
            let own = segment(0) == Some("crate") || (room == "main" && segment(0) == Some("upm"));
            if let (true, Some(other)) = (own, segment(1)) {
                if other == "sim" {
                    sim_mentions.push((room, at.clone()));
                }
                if other == room || mention.in_test || test_file {
                    continue;
                }
                imports.entry(room).or_default().insert(other);
                if !may_import(allowed, other, segment(2)) {
                    let path = mention.segments[1..].join("::");
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
    // Nothing that control can reach may see the truth, tests included.
    let (mut ways, mut queue) = (BTreeMap::from([("control", "control".to_owned())]), vec!["control"]);
    while let Some(room) = queue.pop() {
        for &next in imports.get(room).into_iter().flatten().filter(|next| **next != "sim") {
            let way = format!("{} -> {next}", ways[room]);
            if ways.insert(next, way).is_none() {
                queue.push(next);
            }
        }
    }
    faults.extend(
        sim_mentions
            .iter()
            .filter_map(|(room, at)| Some(format!("{at}: control reaches sim: {} -> sim", ways.get(room)?))),
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
fn every_room_is_on_the_map() {
    let map = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("ARCHITECTURE.md")).unwrap();
    let cells: Vec<&str> = map.lines().filter_map(|line| line.strip_prefix('|')?.split('|').next()).collect();
    for room in project().unwrap().iter().filter_map(|(file, _)| room_of(file)) {
        let on_map =
            ["`", ".rs`", "/`"].iter().any(|end| cells.iter().any(|cell| cell.contains(&format!("`{room}{end}"))));
        assert!(on_map, "ARCHITECTURE.md: the map has no row for `{room}`");
    }
}

fn faults_of(files: &[(&str, &str)]) -> Vec<String> {
    faults(&files.iter().map(|(file, text)| (file.to_string(), text.to_string())).collect::<Vec<_>>())
}

#[test]
fn forbidden_imports_are_found_however_they_are_written() {
    for source in [
        "use crate::sim::Truth;",
        "pub use crate::{geometry::Vec2, sim::Truth};",
        "fn f() { let t = crate::sim::Truth::default(); }",
        "use super::sim::Truth;",
        "mod inner { use super::super::sim; }",
        "const C: char = '\"'; use crate::sim as s;",
        "#[cfg(not(test))] use crate::sim;",
    ] {
        let found = faults_of(&[("src/goal.rs", source)]);
        assert_eq!(found.len(), 1, "{source}: {found:?}");
        assert!(found[0].starts_with("src/goal.rs:1: `goal` may not import `sim"), "{found:?}");
    }
    assert_eq!(
        faults_of(&[("src/vision/a.rs", "\n\nuse super::super::planner;")]),
        ["src/vision/a.rs:3: `vision` may not import `planner`"]
    );
    assert_eq!(
        faults_of(&[("src/geometry.rs", "use crate::signal::Frame;")]),
        ["src/geometry.rs:1: `geometry` may not import `signal::Frame`"]
    );
    assert_eq!(
        faults_of(&[("src/main.rs", "fn main() { upm::run::run() }")]),
        ["src/main.rs:1: `main` may not import `run::run`"]
    );
    assert_eq!(faults_of(&[("src/run.rs", "use crate::lab;")]), ["src/run.rs:1: `run` may not import `lab`"]);
    assert_eq!(faults_of(&[("src/utils.rs", "")]), ["src/utils.rs:1: `utils` is not in the table of rooms"]);
}

#[test]
fn allowed_imports_and_mere_words_are_not() {
    for source in [
        "use crate::{geometry::{Twist, Vec2}, time::PlateTime};",
        "// use crate::sim\n/* crate::sim::Truth */ const A: &str = \"crate::sim\"; const B: &str = r#\"\"crate::sim\"#;",
        "use super::goal::Wanted; fn f<'a>(x: &'a str) -> impl Sized + use<'a> { x }",
        "#[cfg(test)]\nmod tests { use super::*; use crate::signal::Frame; fn f() { serde_json::to_string(&1); } }",
        "struct S { rerun: bool, sim: u8 }",
    ] {
        assert_eq!(faults_of(&[("src/goal.rs", source)]), [""; 0], "{source}");
    }
    let test_file =
        [("src/goal.rs", "#[cfg(test)]\nmod long_tests;"), ("src/goal/long_tests.rs", "use crate::signal::Frame;")];
    assert_eq!(faults_of(&test_file), [""; 0]);
    assert_eq!(faults_of(&test_file[1..]).len(), 1);
}

#[test]
fn single_items_are_told_apart() {
    assert_eq!(faults_of(&[("src/recording.rs", "use crate::sim::{Truth, TruthProbe};")]), [""; 0]);
    assert_eq!(faults_of(&[("src/recording.rs", "use crate::sim::{Truth, SimulatedRig};")]).len(), 1);
    assert_eq!(faults_of(&[("src/config.rs", "use crate::sim::SimParams; use crate::sim::*;")]).len(), 1);
}

#[test]
fn control_reaches_sim_neither_through_others_nor_in_tests() {
    let files = [
        ("src/control.rs", "use crate::planner::Plan;"),
        ("src/planner/plan.rs", "use crate::library::Library;"),
        ("src/library.rs", "#[cfg(test)]\nmod tests {\n    use crate::sim::Truth;\n}"),
    ];
    assert_eq!(faults_of(&files), ["src/library.rs:3: control reaches sim: control -> planner -> library -> sim"]);
    assert_eq!(faults_of(&files[1..]), [""; 0]);
}

#[test]
fn outside_crates_have_their_places_and_files_their_length() {
    assert_eq!(
        faults_of(&[("src/control.rs", "use clarabel::solver;")]),
        ["src/control.rs:1: `clarabel` is named in src/planner only"]
    );
    assert_eq!(faults_of(&[("src/goal.rs", "#[derive(serde::Serialize)] struct S;")]).len(), 1);
    assert_eq!(faults_of(&[("src/control.rs", "use std::{env, fmt};")]).len(), 1);
    assert_eq!(
        faults_of(&[
            ("src/planner/program.rs", "use clarabel::solver;"),
            ("src/library/file.rs", "use serde::Serialize;")
        ]),
        [""; 0]
    );
    let long = "\n".repeat(401);
    assert_eq!(faults_of(&[("src/goal.rs", &long)]), ["src/goal.rs:401: files have at most 400 lines"]);
}
