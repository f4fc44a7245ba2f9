//! `$schema`: every shipped configuration names the schema of its kind, and the shipped schemas equal those of the
//! program.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use std::process::Command;
use upm::config::{Document, schema_names};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn schemas() -> PathBuf {
    root().join("configs/schemas")
}

fn read(file: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(file).unwrap())
        .unwrap_or_else(|error| panic!("{}: {error}", file.display()))
}

/// JSON files in `folder` and below.
fn files_below(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files_below(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "json") {
            files.push(path);
        }
    }
}

/// Name of the schema of a document.
fn kind_of(document: &Value) -> Option<&'static str> {
    Some(match Document::of(document)? {
        Document::Job => "job",
        Document::Rig => "rig",
        Document::Library => "library",
        Document::Experiment => "simulate",
        Document::Trace => "trace",
        Document::Daemon => "daemon",
        Document::Coins => "coins",
        Document::Campaign => "campaign",
    })
}

/// `UPM_REMAKE_GOLDEN=1` writes the files anew.
#[test]
fn shipped_schemas_equal_the_printed_ones() {
    for name in schema_names() {
        let output = Command::new(env!("CARGO_BIN_EXE_upm")).args(["schema", name]).output().unwrap();
        assert!(output.status.success(), "{name}");
        let (printed, file) = (String::from_utf8(output.stdout).unwrap(), schemas().join(format!("{name}.json")));
        if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
            fs::create_dir_all(schemas()).unwrap();
            fs::write(&file, &printed).unwrap();
        }
        let shipped = fs::read_to_string(&file).unwrap_or_default();
        assert!(shipped == printed, "{} differs: UPM_REMAKE_GOLDEN=1 writes it anew", file.display());
    }
    let of_program: BTreeSet<String> = schema_names().iter().map(|name| format!("{name}.json")).collect();
    let names = fs::read_dir(schemas()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert_eq!(names.collect::<BTreeSet<_>>(), of_program);
}

#[test]
fn shipped_configuration_names_the_schema_of_its_kind() {
    let mut files = Vec::new();
    files_below(&root().join("configs"), &mut files);
    files.retain(|file| !file.starts_with(schemas()));
    assert!(files.len() >= 20, "configurations are where they are looked for");
    for file in files {
        let document = read(&file);
        let kind = kind_of(&document).unwrap_or_else(|| panic!("{} is of no kind", file.display()));
        let wanted = schemas().join(format!("{kind}.json")).canonicalize().unwrap();
        let named = document["$schema"].as_str().unwrap_or_else(|| panic!("{} has no $schema", file.display()));
        let found = file.parent().unwrap().join(named).canonicalize();
        assert_eq!(found.ok(), Some(wanted), "{}: $schema: {named}", file.display());
    }
}
