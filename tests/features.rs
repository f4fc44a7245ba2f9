//! Behaviour and messages of builds without some features. `cargo test --no-default-features --test features` tests the
//! smallest one; with all features on, the same tests check that nothing is missing.
#![allow(clippy::unwrap_used)] // a test that cannot go on shall say so

use std::fs;
use std::path::{Path, PathBuf};

use std::process::Command;

const FEATURES: [(&str, bool); 2] = [("rerun", cfg!(feature = "rerun")), ("daemon", cfg!(feature = "daemon"))];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Runs `upm`; returns exit status, stdout and stderr.
fn upm(args: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_upm")).current_dir(root()).args(args).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

fn missing() -> Vec<&'static str> {
    FEATURES.iter().filter(|(_, built)| !built).map(|(name, _)| *name).collect()
}

#[test]
fn version_and_help_name_the_missing_features_and_the_commands_that_there_are() {
    let version = upm(&["--version"]).1;
    let help = upm(&["--help"]).1;
    let stated = help.lines().find(|line| line.starts_with("Built without "));
    if missing().is_empty() {
        assert_eq!(version.trim_end(), concat!("upm ", env!("CARGO_PKG_VERSION")));
        assert_eq!(stated, None);
    } else {
        let named = missing().join(", ");
        assert_eq!(version.trim_end(), format!("upm {} (built without {named})", env!("CARGO_PKG_VERSION")));
        assert!(stated.is_some_and(|line| line.contains(&named)), "{help}");
    }
    let lists = |command: &str| help.lines().any(|line| line.split_whitespace().next() == Some(command));
    assert!(lists("run") && lists("verify"));
    for command in ["serve", "submit", "estop"] {
        assert_eq!(lists(command), !missing().contains(&"daemon"), "{command}: {help}");
    }
}

#[test]
fn missing_command_names_the_feature_it_needs() {
    let daemon = ["serve", "submit configs/plus-sign.json", "estop"].map(|command| ("daemon", command));
    let rerun = ("rerun", "run configs/plus-sign.json --rerun save --out /nowhere");
    for (feature, command) in daemon.into_iter().chain([rerun]).filter(|(feature, _)| missing().contains(feature)) {
        let (status, stdout, stderr) = upm(&command.split(' ').collect::<Vec<_>>());
        assert_eq!((status, stdout.as_str(), stderr.lines().count()), (2, "", 1), "{command}: {stderr}");
        assert!(stderr.contains(feature), "{command}: {stderr}");
    }
}

/// Every build runs jobs and keeps the files that `upm verify` needs; a recording only if the build can write one.
#[test]
fn every_build_runs_a_job_and_verifies_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().display().to_string();
    let (status, stdout, stderr) = upm(&["run", "configs/arrange-2.json", "--out", &out, "--quiet"]);
    assert_eq!(status, 0, "{stdout}{stderr}");
    let run: PathBuf = fs::read_dir(Path::new(&out)).unwrap().next().unwrap().unwrap().path();
    for file in ["effective.json", "journal.jsonl", "report.json"] {
        assert!(run.join(file).is_file(), "{file}");
    }
    assert_eq!(run.join("run.rrd").is_file(), !missing().contains(&"rerun"));
    let (status, stdout, stderr) = upm(&["verify", &run.display().to_string()]);
    assert_eq!(status, 0, "{stdout}{stderr}");
}
