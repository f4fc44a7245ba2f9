//! Tests of the rules on small sources, with the map of the project.

use super::rules::{self, Source};

fn sources(files: &[(&str, &str)]) -> Vec<Source> {
    rules::sources(&files.iter().map(|(file, text)| (file.to_string(), text.to_string())).collect::<Vec<_>>())
}

fn faults_of(files: &[(&str, &str)]) -> Vec<String> {
    rules::faults(&sources(files))
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
        let found = faults_of(&[("src/planning/task/plus_sign.rs", source)]);
        assert_eq!(found.len(), 1, "{source}: {found:?}");
        assert!(found[0].starts_with("src/planning/task/plus_sign.rs:1: `task` may not import `sim"), "{found:?}");
    }
    for (file, source, fault) in [
        ("perception/vision/a.rs", "\n\nuse super::super::estimation;", "3: `vision` may not import `estimation`"),
        ("core/geometry.rs", "use crate::signal::Frame;", "1: `geometry` may not import `signal::Frame`"),
        ("main.rs", "fn main() { upm::run::run() }", "1: `main` may not import `run::run`"),
        ("runner/run.rs", "use upm_lab::Figure;", "1: `run` may not import `lab::Figure`"),
        ("utils.rs", "", "1: `utils` is not on the map"),
        ("runner/config.rs", "use upm_sim::{SimParams, SimRig};", "1: `config` may not import `sim::SimRig`"),
        ("control/pulse_planner.rs", "use clarabel::solver;", "1: `clarabel` is named in planning/qp only"),
        ("planning/task/plus_sign.rs", &"\n".repeat(401), "401: files have at most 400 lines"),
    ] {
        assert_eq!(faults_of(&[(&format!("src/{file}"), source)]), [format!("src/{file}:{fault}")]);
    }
}

#[test]
fn allowed_imports_and_mere_words_are_not() {
    for source in [
        "use upm_core::{geometry::{Twist, Vec2}, time::PlateTime};",
        "// use upm_sim\n/* upm_sim::SimRig */ const A: &str = \"upm_sim::SimRig\"; const B: &str = r#\"\"upm_sim::SimRig\"#;",
        "use super::task::Setpoints; fn f<'a>(x: &'a str) -> impl Sized + use<'a> { x }",
        "#[cfg(test)]\nmod tests { use super::*; use upm_core::signal::Frame; fn f() { serde_json::to_string(&1); } }",
        "struct S { rerun: bool, sim: u8 }",
    ] {
        assert_eq!(faults_of(&[("src/planning/task/plus_sign.rs", source)]), [""; 0], "{source}");
    }
    let test_file = [
        ("src/planning/task.rs", "#[cfg(test)]\nmod long_tests;"),
        ("src/planning/task/long_tests.rs", "use upm_core::signal::Frame;"),
    ];
    assert_eq!(faults_of(&test_file), [""; 0]);
    assert_eq!(faults_of(&test_file[1..]).len(), 1);
}

#[test]
fn control_reaches_sim_neither_through_others_nor_in_tests() {
    let files = [
        ("src/control/lib.rs", "use upm_planning::planner::Plan;"),
        ("src/planning/planner/plan.rs", "use upm_planning::cor_library::Library;"),
        ("src/planning/cor_library/file.rs", "#[cfg(test)]\nmod tests {\n    use upm_sim::SimRig;\n}"),
    ];
    assert_eq!(
        faults_of(&files),
        ["src/planning/cor_library/file.rs:3: control reaches sim: control -> planner -> cor_library -> sim"]
    );
    assert_eq!(faults_of(&files[1..]), [""; 0]);
}

#[test]
fn import_cycles_are_found_through_re_exports_and_only_outside_tests() {
    let found = |files: &[(&str, &str)]| rules::cycles_in(&sources(files));
    let room = ("src/planning/task.rs", "mod a; mod b; pub use a::A; pub use b::B;");
    let both = [
        room,
        ("src/planning/task/a.rs", "use super::B; pub struct A;"),
        ("src/planning/task/b.rs", "use crate::task::A; pub struct B;"),
    ];
    let cycle = "import cycle of 2 files:\n  src/planning/task/a.rs -> src/planning/task/b.rs: B\n  \
                 src/planning/task/b.rs -> src/planning/task/a.rs: A";
    assert_eq!(found(&both), [cycle]);
    let one_way =
        [room, both[1], ("src/planning/task/b.rs", "#[cfg(test)] mod tests { use super::super::A; } pub struct B;")];
    assert_eq!(found(&one_way), [""; 0], "tests may");
    let renamed = [
        ("src/planning/task.rs", "mod a; mod b;"),
        ("src/planning/task/a.rs", "use super::b as other; pub const A: u8 = other::B;"),
        ("src/planning/task/b.rs", "use super::a::*; pub const B: u8 = 1; const C: u8 = A;"),
    ];
    assert_eq!(found(&renamed).len(), 1);
}
