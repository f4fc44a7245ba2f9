//! Checks the pictures of `docs/student.md` against the program: each equals the one drawn by its command.
//! `UPM_REMAKE_GOLDEN=1` writes them anew.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::fs;
use std::path::Path;
use std::sync::Arc;

use tempfile::TempDir;

#[path = "../examples/draw_principle.rs"]
#[allow(dead_code)] // its main
mod draw_principle;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn holds(shipped: &Path, drawn: &str) {
    if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
        fs::write(shipped, drawn).unwrap();
    }
    assert!(drawn.len() < 60_000, "{}: {} bytes", shipped.display(), drawn.len());
    assert!(fs::read_to_string(shipped).unwrap() == drawn, "{} is drawn differently now", shipped.display());
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn pictures_of_the_page_are_those_that_the_program_draws() {
    let folder = TempDir::new().unwrap();
    for job in ["arrange-4-cor", "arrange-4-fields"] {
        let (file, picture) = (format!("configs/{job}.json"), folder.path().join("plan.svg"));
        let mut upm = std::process::Command::new(env!("CARGO_BIN_EXE_upm"));
        upm.args(["check", &file, "--plan", "--picture"]).arg(&picture).current_dir(root());
        assert!(upm.output().unwrap().status.success());
        let shipped = root().join(format!("assets/student/plan-{job}.svg"));
        holds(&shipped, &fs::read_to_string(picture).unwrap());
    }
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn diagram_of_the_principle_is_the_one_that_its_example_draws() {
    let library = upm::cor_library::Library::load(&root().join("assets/libraries/upm-2.json")).unwrap();
    let drawn = draw_principle::picture(&Arc::new(library)).unwrap();
    holds(&root().join("assets/principle.svg"), &drawn);
}
