//! Streams that cannot be written, and names that are no text: a command does its work and does not panic.
#![cfg(target_os = "linux")]

use std::fs::{self, File};
use std::os::unix::fs::symlink;
use std::process::Stdio;

use tempfile::TempDir;

use super::{root, status};

#[test]
fn full_stderr_costs_no_run_its_report_and_a_run_is_found_behind_a_link() {
    let folder = TempDir::new().unwrap();
    let [elsewhere, out] = ["elsewhere", "runs"].map(|name| folder.path().join(name));
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_upm"));
    command.args(["run", "configs/hold-4.json", "-v", "--camera", "positions", "--rerun", "off", "--out"]);
    command.arg(&elsewhere).current_dir(root()).stdout(Stdio::null());
    command.stderr(File::options().write(true).open("/dev/full").unwrap());
    assert!(command.status().unwrap().success());
    let run = fs::read_dir(&elsewhere).unwrap().next().unwrap().unwrap().path();
    assert!(run.join("report.json").is_file());
    fs::create_dir(&out).unwrap();
    symlink(run, out.join("linked")).unwrap();
    let out = out.to_str().unwrap();
    status(&["verify", "last", "--out", out], 0);
    for name in ["linked", "link"] {
        status(&["export", name, "--csv", "--out", out], 0);
    }
}
