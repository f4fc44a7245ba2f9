//! List of the jobs at hand, for `upm run` without a file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::args::Common;
use super::output::{Failure, print_json};
use super::shipped;
use upm_runner::config::{Document, JobSpec, TaskSpec, text_of};

/// Folders searched for jobs.
const FOLDERS: [&str; 2] = ["configs", "."];

/// Median plate times of the shipped jobs' dry runs, s; `tests/shipped_jobs.rs` checks and remakes them.
const EXPECTED_S: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/expected-plate-times-s.json"));

/// A job file with its content, or the number of its faults.
type JobEntry = (PathBuf, Result<JobSpec, usize>);

/// Lists the jobs in `configs` and in the current folder, with the times that are expected of the shipped ones.
pub(super) fn list(common: Common) -> Result<u8, Failure> {
    let jobs: Vec<JobEntry> = FOLDERS.iter().flat_map(|folder| jobs_in(Path::new(folder))).collect();
    if jobs.is_empty() {
        let line = "run: expected a job file, found none in ./configs or here; `upm init` writes some to try";
        return Err(Failure::bad_input(line));
    }
    if common.json {
        print_json(&jobs.iter().map(|(file, job)| row(file, job)).collect::<Vec<_>>())?;
        return Ok(0);
    }
    for (file, job) in &jobs {
        let name = file.display();
        match job {
            Ok(job) => outln!("upm run {name}  # {}; {}; {}", parts(job), task(job), time(file, job))?,
            Err(count) => outln!("upm run {name}  # faults: `upm check` shows them ({count})")?,
        }
    }
    errln!("Times are the plate's; a simulated rig is faster. `upm check FILE --plan` forecasts that of your own job.");
    Ok(0)
}

fn row(file: &Path, job: &Result<JobSpec, usize>) -> Value {
    let job = job.as_ref();
    json!({
        "file": file.display().to_string(),
        "faults": job.err(),
        "parts": job.ok().map(parts),
        "task": job.ok().map(task),
        "expected_plate_time_s": expected_s(file),
        "plate_time_limit_s": job.ok().map(|job| job.plate_time_limit_s),
    })
}

/// Plate time expected of a shipped job, s.
fn expected_s(file: &Path) -> Option<f64> {
    let known: BTreeMap<String, f64> = serde_json::from_str(EXPECTED_S).ok()?;
    known.get(shipped::job_of(&text_of(file).ok()?)?).copied()
}

/// Files of `folder` whose keys are those of a job, sorted by name.
fn jobs_in(folder: &Path) -> Vec<JobEntry> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let files = entries.map(|file| file.strip_prefix(".").map_or_else(|_| file.clone(), Path::to_owned));
    let mut files: Vec<PathBuf> = files.filter(|file| is_job(file)).collect();
    files.sort();
    files.into_iter().map(|file| (file.clone(), JobSpec::load(&file).map_err(|faults| faults.len()))).collect()
}

fn is_job(file: &Path) -> bool {
    // a pipe would be read without end
    let is_json = file.is_file() && file.extension().is_some_and(|ending| ending == "json");
    let text = is_json.then(|| text_of(file).ok()).flatten();
    let value = text.and_then(|text| serde_json::from_str::<Value>(&text).ok());
    value.and_then(|value| Document::of(&value)) == Some(Document::Job)
}

/// Parts by kind: `4 penny, 4 quarter`.
fn parts(job: &JobSpec) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for group in &job.parts {
        *counts.entry(job.rig.kinds.get(group.kind).map_or("part", |spec| &spec.kind.name)).or_default() += group.count;
    }
    counts.into_iter().map(|(kind, count)| format!("{count} {kind}")).collect::<Vec<_>>().join(", ")
}

fn task(job: &JobSpec) -> String {
    let told = |task: &TaskSpec| match task {
        TaskSpec::Sort { bins } => format!("sort into {} bins", bins.len()),
        other => other.name().replace('_', " "),
    };
    job.each_task().map(told).collect::<Vec<_>>().join(", ")
}

/// Expected and longest plate time of a job.
fn time(file: &Path, job: &JobSpec) -> String {
    let limit_s = job.plate_time_limit_s;
    match expected_s(file) {
        _ if job.is_endless() => format!("no end, stops at {limit_s} s"),
        Some(s) => format!("about {s:.*} s, at most {limit_s} s", usize::from(s < 9.95)),
        None => format!("at most {limit_s} s"),
    }
}
