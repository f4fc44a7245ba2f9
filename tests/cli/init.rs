//! First steps of a user: `upm init`, the list of jobs, and the written examples.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use super::{root, upm};

/// Runs `upm` in `folder`; returns exit status, stdout and stderr.
fn run_in(folder: &Path, args: &[&str]) -> (Option<i32>, String, String) {
    let output = upm().args(args).current_dir(folder).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

/// JSON files below `folder`, as paths from `base`, sorted.
fn json_files(base: &Path, folder: &str) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(base.join(folder)).unwrap() {
        let name = format!("{folder}/{}", entry.unwrap().file_name().to_str().unwrap());
        if base.join(&name).is_dir() {
            found.extend(json_files(base, &name));
        } else if name.ends_with(".json") {
            found.push(name);
        }
    }
    found.sort();
    found
}

/// A new folder after `upm init`.
fn begun() -> TempDir {
    let folder = TempDir::new().unwrap();
    let (code, stdout, stderr) = run_in(folder.path(), &["init", "."]);
    assert_eq!(code, Some(0), "{stdout}{stderr}");
    folder
}

#[test]
fn init_writes_every_shipped_file_and_each_is_valid_there() {
    let folder = TempDir::new().unwrap();
    let (code, stdout, _) = run_in(folder.path(), &["init"]);
    assert!(code == Some(0) && stdout.contains("cd upm-jobs") && stdout.contains("upm run configs/"), "{stdout}");
    let made = folder.path().join("upm-jobs");
    for shipped in ["configs", "assets/libraries"] {
        let names = json_files(&root(), shipped);
        assert_eq!(json_files(&made, shipped), names);
        for name in &names {
            assert_eq!(fs::read(made.join(name)).unwrap(), fs::read(root().join(name)).unwrap(), "{name}");
        }
    }
    // the check of a rig reads its library; jobs whose paths are searched take long, and are as shipped
    let names = json_files(&made, "configs");
    let of_check = |name: &&str| !["schemas/", "/arrange-", "/swap-"].iter().any(|of| name.contains(of));
    let checked: Vec<&str> = names.iter().map(String::as_str).filter(of_check).collect();
    let (code, _, stderr) = run_in(&made, &[&["check"], &checked[..]].concat());
    assert_eq!(code, Some(0), "{stderr}");
}

#[test]
fn changed_file_is_kept_until_force() {
    let folder = begun();
    let job = folder.path().join("configs/plus-sign.json");
    fs::write(&job, "mine").unwrap();
    fs::remove_file(folder.path().join("configs/hold-4.json")).unwrap();
    let (code, stdout, _) = run_in(folder.path(), &["init", ".", "--json"]);
    let said: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(code, Some(0));
    assert_eq!(
        (&said["kept"][0], &said["written"][0]),
        (&"configs/plus-sign.json".into(), &"configs/hold-4.json".into())
    );
    assert_eq!(fs::read_to_string(&job).unwrap(), "mine");
    let (_, stdout, _) = run_in(folder.path(), &["init", "."]);
    assert!(stdout.contains("--force") && stdout.contains("configs/plus-sign.json"), "{stdout}");
    run_in(folder.path(), &["init", ".", "--force"]);
    assert_eq!(fs::read(&job).unwrap(), fs::read(root().join("configs/plus-sign.json")).unwrap());
}

#[test]
fn init_names_the_file_that_is_in_the_way() {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("configs"), "a file").unwrap();
    let (code, _, stderr) = run_in(folder.path(), &["init", "."]);
    assert!(code == Some(1) && stderr.contains("cannot write ./configs") && stderr.lines().count() == 1, "{stderr}");
}

#[test]
fn run_without_a_file_lists_the_jobs_there_are() {
    let folder = begun();
    fs::copy(folder.path().join("configs/ring-6.json"), folder.path().join("mine.json")).unwrap();
    fs::write(folder.path().join("configs/broken.json"), "{\"task\": {}, \"name\": 7}").unwrap();
    let (code, stdout, stderr) = run_in(folder.path(), &["run"]);
    assert!(code == Some(0) && stderr.lines().count() == 1, "{stderr}");
    let line = |of: &str| stdout.lines().find(|line| line.contains(of)).unwrap_or_else(|| panic!("{of}: {stdout}"));
    let said = line("configs/sort-8.json").split_once("# ").unwrap().1;
    assert!(said.starts_with("4 penny, 4 quarter; sort into 2 bins; about ") && said.ends_with(" s, at most 300 s"));
    assert!(line("configs/plus-sign-endless.json").contains("no end"), "{stdout}");
    assert!(line("configs/broken.json").contains("faults: `upm check`"), "{stdout}");
    assert!(line("upm run mine.json").contains("fault"), "its rig is elsewhere: {stdout}");
    assert!(!stdout.contains("daemon.json") && !stdout.contains("simulate/"), "{stdout}");
}

#[test]
fn run_in_an_empty_folder_suggests_init() {
    let folder = TempDir::new().unwrap();
    let (code, _, stderr) = run_in(folder.path(), &["run"]);
    assert!(code == Some(2) && stderr.contains("`upm init`") && stderr.lines().count() == 1, "{stderr}");
    let (_, _, stderr) = run_in(folder.path(), &["run", "configs/plus-sign.json"]);
    assert!(stderr.contains("no such file") && stderr.contains("`upm init` writes it"), "{stderr}");
}
