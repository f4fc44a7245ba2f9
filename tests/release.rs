//! Checks `tools/release` against the manifest and the files it packs, without building anything.
#![allow(clippy::unwrap_used)] // a test that cannot go on shall say so

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn plan() -> Value {
    let script = root().join("tools/release");
    let made = Command::new("python3").arg(&script).args(["--dry-run", "--json"]).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    serde_json::from_slice(&made.stdout).unwrap()
}

fn text(path: impl AsRef<Path>) -> String {
    std::fs::read_to_string(root().join(path)).unwrap()
}

/// The value of `key = "..."` in a manifest.
fn value<'a>(manifest: &'a str, key: &str) -> &'a str {
    let line = manifest.lines().find_map(|line| line.strip_prefix(key)?.trim_start().strip_prefix('='));
    line.unwrap().trim().trim_matches('"')
}

#[test]
fn archives_have_the_names_that_binstall_expects() {
    let (plan, manifest) = (plan(), text("Cargo.toml"));
    assert_eq!(plan["version"], env!("CARGO_PKG_VERSION"));
    let archives = plan["archives"].as_array().unwrap();
    let targets: Vec<&str> = archives.iter().map(|archive| archive["target"].as_str().unwrap()).collect();
    assert_eq!(targets, ["x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu"]);
    for archive in archives {
        let filled = |template: &str| {
            template
                .replace("{ name }", "upm")
                .replace("{ bin }", "upm")
                .replace("{ binary-ext }", "")
                .replace("{ version }", env!("CARGO_PKG_VERSION"))
                .replace("{ target }", archive["target"].as_str().unwrap())
                .replace("{ archive-format }", value(&manifest, "pkg-fmt"))
        };
        let url = filled(value(&manifest, "pkg-url"));
        assert_eq!(url.rsplit('/').next(), archive["archive"].as_str());
        assert_eq!(filled(value(&manifest, "bin-dir")), archive["program"].as_str().unwrap());
        let command: Vec<&str> =
            archive["command"].as_array().unwrap().iter().map(|arg| arg.as_str().unwrap()).collect();
        assert!(command.contains(&"--locked"), "{command:?}");
        let environment = archive["environment"].as_object().unwrap();
        assert!(environment.values().any(|value| value == "-C target-feature=+crt-static"), "{environment:?}");
    }
}

#[test]
fn all_that_is_packed_is_there() {
    let plan = plan();
    let files = plan["files"].as_object().unwrap();
    assert!(files.len() > 5);
    for (source, place) in files {
        assert!(root().join(source).exists(), "{source}");
        // configurations name libraries by relative paths, which must be kept
        assert_eq!(place, source);
    }
}

/// The container is made of existing files, with the compiler version of the manifest.
#[test]
fn container_builds_from_existing_files() {
    let (file, manifest) = (text("Dockerfile"), text("Cargo.toml"));
    assert!(file.contains(&format!("FROM rust:{}-", value(&manifest, "rust-version"))));
    assert!(file.contains("--profile dist --locked") && file.contains("+crt-static"));
    let config: Value = serde_json::from_str(&text("configs/daemon-container.json")).unwrap();
    assert!(file.contains("/usr/share/upm/configs/daemon-container.json"));
    assert!(file.contains(&format!("UPM_TOKEN_FILE={}", config["token_file"].as_str().unwrap())));
    assert!(file.contains(&format!("VOLUME {}", config["data"].as_str().unwrap())));
}
