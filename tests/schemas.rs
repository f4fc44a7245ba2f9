//! `$schema`: every shipped configuration names the schema of its kind, the shipped schemas equal those of the program,
//! and the key has no effect.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::{Value, json};
use tempfile::TempDir;
use upm::config::{Document, schema_names};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn schemas() -> PathBuf {
    root().join("configs/schemas")
}

fn upm(args: &[&str]) -> Command {
    let mut command = Command::cargo_bin("upm").unwrap();
    command.args(args).current_dir(root());
    command
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
    })
}

/// `UPM_REMAKE_GOLDEN=1` writes the files anew.
#[test]
fn shipped_schemas_equal_the_printed_ones() {
    for name in schema_names() {
        let output = upm(&["schema", name]).output().unwrap();
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

/// A small document of each kind.
fn one_of_each() -> Vec<Value> {
    let channel = json!([0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
    let rig = root().join("configs/rigs/upm-1.json");
    let mut rig_alone = read(&rig);
    // its path leads from the rig's folder
    rig_alone.as_object_mut().unwrap().remove("library");
    vec![
        json!({"name": "small", "rig": rig, "parts": [{"kind": "penny"}], "task": {"type": "hold", "duration_s": 1}}),
        rig_alone,
        read(&root().join("assets/libraries/upm-1.json")),
        json!({
            "rig": rig, "parts": [{"kind": "penny", "position_mm": [40, 0]}],
            "pulses": [{"direction_deg": 90, "speed_mps": 0.02, "sustain_s": 0.1}],
        }),
        json!({
            "sample_hz": 1000, "mps2_per_count": 0.05, "count_limit": 511, "base_hz": 50, "attack_s": 0.02,
            "sustain_s": 0.1, "position_mm": [-92, 92],
            "counts": {"x1": channel, "y1": channel, "x2": channel, "y2": channel},
        }),
        json!({"plates": [{"name": "small", "rig": rig}]}),
    ]
}

#[test]
fn every_kind_of_document_takes_the_key_as_a_text_and_as_nothing_else() {
    let (folder, documents) = (TempDir::new().unwrap(), one_of_each());
    let kinds: BTreeSet<&str> = documents.iter().filter_map(kind_of).collect();
    assert_eq!(kinds, schema_names().iter().copied().collect());
    let file = folder.path().join("document.json");
    let check = |document: &Value| {
        fs::write(&file, document.to_string()).unwrap();
        let output = upm(&["check", file.to_str().unwrap()]).output().unwrap();
        (output.status.code().unwrap(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    for mut document in documents {
        let kind = kind_of(&document).unwrap();
        for address in ["schemas/job.json", "https://example.org/schema.json", "", "nowhere"] {
            document["$schema"] = json!(address);
            assert_eq!(check(&document), (0, String::new()), "{kind}: {address}");
        }
        for other in [json!(3), Value::Null, json!({"job": 1})] {
            document["$schema"] = other;
            let (status, said) = check(&document);
            assert_eq!(status, 2, "{kind}: {said}");
            assert!(said.contains("document.json: [\"$schema\"]: expected a string, found "), "{said}");
        }
        document["$schema"] = json!("schema.json");
        document["$schemas"] = json!("schema.json");
        assert!(check(&document).1.contains("unknown key \"$schemas\""), "{kind}");
    }
}

/// Runs `job`; returns `effective.json` and `journal.jsonl`.
fn run(job: &Value) -> [String; 2] {
    let folder = TempDir::new().unwrap();
    let (file, out) = (folder.path().join("job.json"), folder.path().join("out"));
    fs::write(&file, job.to_string()).unwrap();
    let args = ["run", file.to_str().unwrap(), "--rerun", "off", "--quiet", "--out", out.to_str().unwrap()];
    upm(&args).assert().success();
    let run = fs::read_dir(&out).unwrap().next().unwrap().unwrap().path();
    ["effective.json", "journal.jsonl"].map(|name| fs::read_to_string(run.join(name)).unwrap())
}

#[test]
fn key_in_job_rig_and_library_leaves_every_byte_of_a_run_as_it_is() {
    let mut rig = read(&root().join("configs/rigs/upm-1.json"));
    let mut library = read(&root().join("assets/libraries/upm-1.json"));
    let object = rig.as_object_mut().unwrap();
    object.remove("library");
    object.remove("$schema");
    let job = |rig: &Value, library: &Value| {
        json!({
            "name": "short", "seed": 5, "rig": rig, "library": library, "parts": [{"kind": "penny"}],
            "task": {"type": "hold", "duration_s": 0.5},
        })
    };
    let plain = run(&job(&rig, &library));
    rig["$schema"] = json!("../schemas/rig.json");
    library["$schema"] = json!("../schemas/library.json");
    let mut marked = job(&rig, &library);
    marked["$schema"] = json!("schemas/job.json");
    assert_eq!(run(&marked), plain);
    assert!(!plain[0].contains("$schema") && plain[1].lines().count() > 2, "{}", plain[1]);
}
