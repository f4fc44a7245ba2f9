//! Jobs with the changes of the command line, and files on standard input.

use std::path::Path;

use serde_json::{Value, json};

use super::output::Failure;
use super::run_args::JobChanges;
use upm_core::document::{Diagnostic, read_standard_input};
use upm_runner::campaign::put;
use upm_runner::config::{JobSpec, Origin, text_of};

/// Reads standard input if one of `files` is called `-`.
pub(super) fn read_dash<'a>(files: impl IntoIterator<Item = &'a Path>) -> Result<(), Failure> {
    if files.into_iter().any(|file| file == Path::new("-")) {
        read_standard_input().map_err(|error| Failure::read_failed(Path::new("-"), &error))?;
    }
    Ok(())
}

/// The job in `file` with `changes`, which are checked as if they stood there.
pub(super) fn load(file: &Path, changes: &JobChanges) -> Result<Result<JobSpec, Vec<Diagnostic>>, Failure> {
    let changes = listed(changes)?;
    let job = text_of(file).ok().and_then(|text| serde_json::from_str::<Value>(&text).ok());
    let Some(mut job) = job.filter(|_| !changes.is_empty()) else { return Ok(JobSpec::load(file)) };
    for (key, value) in changes {
        if put(&mut job, &key, value).is_none() {
            let allowed = "a place in the job such as limits.plate_time_s or parts[0].count";
            return Err(Failure::bad_input(format!("--set: expected {allowed}, found {key:?}")));
        }
    }
    Ok(JobSpec::from_json(&job.to_string(), &Origin::of_file(file), None))
}

/// Places and values of `changes`, in the order in which they are made.
fn listed(changes: &JobChanges) -> Result<Vec<(String, Value)>, Failure> {
    let mut all = Vec::new();
    if let Some(rig) = &changes.rig {
        // a job names its rig from its own folder
        let path = std::path::absolute(rig).map_err(|error| Failure::read_failed(rig, &error))?;
        all.push(("rig".to_owned(), json!(path)));
    }
    all.extend(changes.planner.iter().map(|planner| ("planner".to_owned(), json!(planner))));
    changes.set.iter().try_for_each(|text| change("--set", text).map(|change| all.push(change)))?;
    Ok(all)
}

/// A place in a job and a value for it, as typed for `option`.
pub(super) fn change(option: &str, text: &str) -> Result<(String, Value), Failure> {
    let wrong = || Failure::bad_input(format!("{option}: expected KEY=VALUE, found {text:?}"));
    let (key, value) = text.split_once('=').ok_or_else(wrong)?;
    Ok((key.to_owned(), serde_json::from_str(value).unwrap_or_else(|_| json!(value))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shipped(name: &str) -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(name)
    }

    fn loaded(set: &[&str]) -> Result<JobSpec, String> {
        let set = set.iter().map(|text| (*text).to_owned()).collect();
        let changes = JobChanges { set, rig: Some(shipped("rigs/upm-2-evening.json")), ..JobChanges::default() };
        let said = |failure: Failure| failure.lines.join("\n");
        load(&shipped("arrange-2.json"), &changes).map_err(said)?.map_err(|faults| faults[0].to_string())
    }

    #[test]
    fn values_are_put_where_their_keys_say_and_checked_there() {
        let job = loaded(&["limits.plate_time_s=30", "name=own", "planner=moving_field"]).unwrap();
        assert_eq!((job.plate_time_limit_s, job.name.as_str()), (30.0, "own"));
        assert_eq!((job.rig.document.friction.spread, job.rig.document.camera.levels[0]), (0.1, 20.0));
        assert_eq!(job.effective()["planner"], "moving_field");
        let refused = loaded(&["parts[0].kind=pennyy"]).unwrap_err();
        assert!(refused.contains("parts[0].kind: expected one of penny"), "{refused}");
        let refused = loaded(&["planner=fast"]).unwrap_err();
        assert!(refused.contains("planner: expected one of auto, cor_sequence"), "{refused}");
        for text in ["seed", "parts[9].count=1", "name.x=1", "=1"] {
            assert!(loaded(&[text]).unwrap_err().starts_with("--set: expected "), "{text}");
        }
    }
}
