//! Checks the sources against the map of the code in `ARCHITECTURE.md`, and that page against the sources.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::Path;
use std::sync::LazyLock;

#[path = "architecture/ceilings.rs"]
mod ceilings;
#[path = "architecture/cycles.rs"]
mod cycles;
#[path = "architecture/layers.rs"]
mod layers;
#[path = "architecture/map.rs"]
mod map;
#[path = "architecture/rules.rs"]
mod rules;
#[path = "architecture/rules_tests.rs"]
mod rules_tests;
#[path = "architecture/scan.rs"]
mod scan;

use layers::Crates;
use map::{MAP, PAGE, quoted};
use rules::Source;

/// Paths and texts of the project's sources; tests that run the program `upm-lab` are none.
static FILES: LazyLock<Vec<(String, String)>> = LazyLock::new(|| {
    let mut files = Vec::new();
    read_folder(&root().join("src"), "src", &mut files).unwrap();
    files.retain(|(name, _)| !name.starts_with("src/lab/tests/"));
    files
});

static SOURCES: LazyLock<Vec<Source>> = LazyLock::new(|| rules::sources(&FILES));

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read_folder(folder: &Path, name: &str, files: &mut Vec<(String, String)>) -> io::Result<()> {
    let mut entries = fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    entries.sort_by_key(|entry| entry.file_name());
    for entry in entries {
        let name = format!("{name}/{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            read_folder(&entry.path(), &name, files)?;
        } else if name.ends_with(".rs") {
            files.push((name, fs::read_to_string(entry.path())?));
        }
    }
    Ok(())
}

/// Fails with a list of faults, one a line.
#[track_caller]
fn none(faults: Vec<String>) {
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

#[test]
fn rooms_have_only_allowed_imports() {
    assert!(FILES.len() > 20, "sources are where they are looked for");
    none(rules::faults(&SOURCES));
}

#[test]
fn map_has_each_room_once_and_base_rooms_are_rooms() {
    none(MAP.faults());
}

#[test]
fn map_lists_nothing_that_sources_do_not_need() {
    assert!(MAP.base.len() > 5 && MAP.outside.len() > 20, "the map is read: {MAP:?}");
    none(rules::unused(&SOURCES));
}

#[test]
fn files_have_no_import_cycle() {
    none(rules::cycles_in(&SOURCES));
}

#[test]
fn page_names_files_and_items_that_exist() {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let texts = FILES.iter().map(|(_, text)| text.as_str()).chain([include_str!("../Cargo.toml")]);
    let words: BTreeSet<&str> = texts.flat_map(|text| text.split(|c| !is_word(c))).collect();
    // the end of a source's path or folder is enough: `fields/seeds` is `src/planning/planner/fields/seeds.rs`
    let is_source = |path: &str| FILES.iter().any(|(file, _)| file.contains(&format!("/{path}")));
    let exists = |name: &str| match name.trim_end_matches('/') {
        path if path.contains('/') || path.contains('.') => root().join(path).exists() || is_source(path),
        name => name.split([':', '-']).all(|word| word.is_empty() || words.contains(word)),
    };
    let is_plain = |name: &&str| {
        name.chars().all(|c| is_word(c) || "-./:".contains(c)) && !name.starts_with('_') && !name.starts_with("std::")
    };
    let missing = PAGE.lines().flat_map(quoted).filter(is_plain).filter(|name| !exists(name) && !words.contains(name));
    let wide = PAGE.lines().filter(|line| line.chars().count() > 120 && !line.starts_with(['|', '!']));
    let missing = missing.map(|name| format!("there is no `{name}`"));
    none(missing.chain(wide.map(|line| format!("more than 120 columns: {line}"))).collect());
}

#[test]
fn crates_are_in_the_layers_that_their_manifests_make() {
    let crates = Crates::read();
    for (number, layer) in MAP.layers.iter().enumerate() {
        assert!(layer.title.starts_with(&format!("Layer {number}: ")), "{}", layer.title);
        for of in &layer.crates {
            assert_eq!(crates.layer(of), number, "the layer of `{of}`");
        }
    }
}

#[test]
fn crates_are_no_heavier_than_their_ceilings() {
    none(ceilings::faults(&SOURCES));
}

#[test]
fn control_does_not_depend_on_the_simulator() {
    let reached = Crates::read_with_tests().reached("control");
    assert!(reached.contains("core") && reached.contains("planning"), "{reached:?}");
    assert!(!reached.contains("sim"), "control builds on sim: {reached:?}");
}

#[test]
fn fixtures_are_imported_by_tests_only() {
    let importing: Vec<&str> =
        Crates::read().imports().filter(|(_, i)| i.contains("fixtures")).map(|(of, _)| of).collect();
    assert_eq!(importing, [""; 0]);
}
