mod agreement;
mod daemon;
mod faults;
mod jobs;
mod many;
mod mutation;
mod placing;
mod refusals;
mod rig_changes;
mod rigs;
mod shapes;
mod simulate;
mod traces;

use serde_json::Value;

use super::{Diagnostic, JobSpec, Origin, RigSpec};

/// A shipped file by its path in the repository.
fn shipped(path: &str) -> std::path::PathBuf {
    std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs").join(path)
}

fn text_of(path: &str) -> String {
    std::fs::read_to_string(shipped(path)).unwrap()
}

fn value_of(path: &str) -> Value {
    serde_json::from_str(&text_of(path)).unwrap()
}

/// A document beside the shipped jobs.
fn origin() -> Origin {
    Origin::of_file(&shipped("test.json"))
}

/// Sets the value at a JSON pointer; the last component may name a new key.
fn set(document: &mut Value, pointer: &str, value: Value) {
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match document.pointer_mut(parent).unwrap() {
        Value::Array(items) => items[key.parse::<usize>().unwrap()] = value,
        object => drop(object.as_object_mut().unwrap().insert(key.to_owned(), value)),
    }
}

fn job(document: &Value) -> Result<JobSpec, Vec<Diagnostic>> {
    JobSpec::from_json(&document.to_string(), &origin(), None)
}

fn rig(document: &Value) -> Result<RigSpec, Vec<Diagnostic>> {
    RigSpec::from_json(&document.to_string(), &Origin::of_file(&shipped("rigs/test.json")))
}

/// Faults without the file name.
fn lines(faults: Vec<Diagnostic>) -> Vec<String> {
    faults.into_iter().map(|f| format!("{}: expected {}, found {}", f.path, f.expected, f.found)).collect()
}
