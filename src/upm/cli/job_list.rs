//! List of the jobs at hand, for `upm run` without a file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::output::{BAD_INPUT, Failure};
use upm_runner::config::{Document, JobSpec, TaskSpec, text_of};

/// Folders searched for jobs.
const FOLDERS: [&str; 2] = ["configs", "."];

/// A job file with its content, or the number of its faults.
type JobEntry = (PathBuf, Result<JobSpec, usize>);

/// Lists the jobs in `configs` and in the current folder. Returns the exit status of a missing argument.
pub(super) fn list() -> Result<u8, Failure> {
    let jobs: Vec<JobEntry> = FOLDERS.iter().flat_map(|folder| jobs_in(Path::new(folder))).collect();
    if jobs.is_empty() {
        let line = "run: expected a job file, found none in ./configs or here; `upm init` writes some to try";
        return Err(Failure::bad_input(line));
    }
    errln!("upm: run: expected a job file, found none; these are here:");
    for (file, job) in &jobs {
        let file = file.display();
        match job {
            Ok(job) => errln!("  upm run {file}  # {}; {}; {}", parts(job), task(job), time(job)),
            Err(count) => errln!("  upm run {file}  # faults: `upm check` shows them ({count})"),
        }
    }
    errln!("`upm check FILE --plan` forecasts how long one takes on the plate; a simulated rig is faster than that.");
    Ok(BAD_INPUT)
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
        *counts.entry(job.kind(group.kind).map_or("part", |spec| &spec.kind.name)).or_default() += group.count;
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

/// Longest plate time of a job.
fn time(job: &JobSpec) -> String {
    let end = if job.is_endless() { "no end, stops at" } else { "at most" };
    format!("{end} {} s", job.plate_time_limit_s)
}
