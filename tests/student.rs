//! Checks the pictures of `docs/student.md` against the program: each equals the one drawn by its command.
//! `UPM_REMAKE_GOLDEN=1` writes them anew.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use tempfile::TempDir;

#[path = "../examples/draw_principle.rs"]
#[allow(dead_code)] // its main
mod draw_principle;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A folder laid out like the repository, for the commands that draw.
fn workplace() -> TempDir {
    let folder = TempDir::new().unwrap();
    for name in ["configs", "assets"] {
        symlink(root().join(name), folder.path().join(name)).unwrap();
    }
    folder
}

/// Runs `script` in `folder` with the `upm` under test; returns its exit status and all of its output.
fn run_script(folder: &Path, script: &str) -> (i32, String) {
    let script = format!("exec 2>&1\nupm() {{ '{}' \"$@\"; }}\n{script}\n", env!("CARGO_BIN_EXE_upm"));
    let output = Command::new("bash").args(["-c", &script]).current_dir(folder).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stdout).unwrap())
}

/// Pictures of the page besides those of `upm-lab`: each with the command that draws it and the file that it writes.
const PICTURES: &[(&str, &str, &str)] = &[
    ("plan-arrange-4-cor.svg", "upm check configs/arrange-4-cor.json --plan --picture plan.svg", "plan.svg"),
    ("plan-arrange-8.svg", "upm check configs/arrange-8.json --plan --picture plan.svg", "plan.svg"),
];

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
    let folder = workplace();
    for (picture, command, file) in PICTURES {
        let (status, printed) = run_script(folder.path(), command);
        assert_eq!(status, 0, "{printed}");
        let drawn = fs::read_to_string(folder.path().join(file)).unwrap();
        holds(&root().join("assets/student").join(picture), &drawn);
    }
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn diagram_of_the_principle_is_the_one_that_its_example_draws() {
    let library = upm::cor_library::Library::load(&root().join("assets/libraries/upm-2.json")).unwrap();
    let drawn = draw_principle::picture(&Arc::new(library)).unwrap();
    holds(&root().join("assets/principle.svg"), &drawn);
}
