//! List of the jobs at hand, for `upm run` without a file.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::args::Common;
use super::output::{BAD_INPUT, Failure, print_json};
use upm_runner::config::{Document, JobSpec, TaskSpec};

/// Folders searched for jobs.
const FOLDERS: [&str; 2] = ["configs", "."];

/// Most files examined in a folder.
const MOST_FILES: usize = 500;

/// Largest file examined, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// A job file with its content, or the number of its faults.
type JobEntry = (PathBuf, Result<JobSpec, usize>);

/// Lists the jobs in `configs` and in the current folder. Returns the exit status of a missing argument.
pub(super) fn list(common: Common) -> Result<u8, Failure> {
    let jobs: Vec<JobEntry> = FOLDERS.iter().flat_map(|folder| jobs_in(Path::new(folder))).collect();
    if common.json {
        print_json(&jobs.iter().map(json).collect::<Vec<_>>())?;
        return Ok(BAD_INPUT);
    }
    if jobs.is_empty() {
        let line = "run: expected a job file, found none in ./configs or here; `upm init` writes some to try";
        return Err(Failure::bad_input(line));
    }
    errln!("upm: run: expected a job file, found none; these are here:");
    let rows: Vec<[String; 4]> = jobs.iter().map(row).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let [file_width, parts_width, task_width] = [0, 1, 2].map(width);
    for [file, parts, task, time] in &rows {
        errln!("  upm run {file:file_width$}  {parts:parts_width$}  {task:task_width$}  {time}");
    }
    errln!("`upm check FILE --plan` forecasts how long one takes on the plate; a simulated rig is faster than that.");
    Ok(BAD_INPUT)
}

/// Files of `folder` whose keys are those of a job, sorted by name.
fn jobs_in(folder: &Path) -> Vec<JobEntry> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let files = entries.map(|file| file.strip_prefix(".").map_or_else(|_| file.clone(), Path::to_owned));
    let mut files: Vec<PathBuf> =
        files.filter(|file| file.extension().is_some_and(|ending| ending == "json")).take(MOST_FILES).collect();
    // sorts arrange-4 before arrange-16
    files.sort_by_cached_key(|file| (numberless(file), file.as_os_str().len(), file.clone()));
    let jobs = files.into_iter().filter(|file| is_job(file));
    jobs.map(|file| (file.clone(), JobSpec::load(&file).map_err(|faults| faults.len()))).collect()
}

/// The path up to its first digit.
fn numberless(file: &Path) -> String {
    file.display().to_string().chars().take_while(|c| !c.is_ascii_digit()).collect()
}

fn is_job(file: &Path) -> bool {
    let is_small = std::fs::metadata(file).is_ok_and(|found| found.is_file() && found.len() <= MOST_BYTES);
    let text = is_small.then(|| std::fs::read_to_string(file).ok()).flatten();
    let value = text.and_then(|text| serde_json::from_str::<Value>(&text).ok());
    value.and_then(|value| Document::of(&value)) == Some(Document::Job)
}

fn row((file, job): &JobEntry) -> [String; 4] {
    let file = file.display().to_string();
    match job {
        Ok(job) => [file, parts(job), task(job), time(job)],
        Err(count) => [file, format!("faults: `upm check` shows them ({count})"), String::new(), String::new()],
    }
}

fn json((file, job): &JobEntry) -> Value {
    let file = file.display().to_string();
    match job {
        Ok(job) => json!({
            "file": file,
            "name": job.name,
            "rig": job.rig.model.name,
            "parts": parts(job),
            "task": task(job),
            "plate_time_limit_s": job.plate_time_limit_s,
            "endless": job.is_endless(),
        }),
        Err(count) => json!({ "file": file, "faults": count }),
    }
}

/// Parts by kind: `4 penny, 4 quarter`.
fn parts(job: &JobSpec) -> String {
    let mut counts: Vec<(usize, usize)> = Vec::new();
    for group in &job.parts {
        match counts.iter_mut().find(|(kind, _)| *kind == group.kind) {
            Some((_, count)) => *count += group.count,
            None => counts.push((group.kind, group.count)),
        }
    }
    let name = |kind| job.kind(kind).map_or("part", |spec| spec.kind.name.as_str());
    counts.into_iter().map(|(kind, count)| format!("{count} {}", name(kind))).collect::<Vec<_>>().join(", ")
}

fn task(job: &JobSpec) -> String {
    let laps = |laps: u32| match laps {
        0 => String::new(),
        1 => ", 1 lap".to_owned(),
        laps => format!(", {laps} laps"),
    };
    match &job.task {
        TaskSpec::PlusSign { laps: count, .. } => format!("plus sign{}", laps(*count)),
        TaskSpec::Trajectories { paths, .. } => {
            format!("trajectories{}", laps(paths.iter().map(|path| path.repeat).max().unwrap_or(0)))
        }
        TaskSpec::Arrange { .. } => "arrange".to_owned(),
        TaskSpec::Sort { bins } => format!("sort into {} bins", bins.len()),
        TaskSpec::Hold { .. } => "hold".to_owned(),
    }
}

/// Plate time, as far as it follows from the file alone.
fn time(job: &JobSpec) -> String {
    let limit_s = job.plate_time_limit_s;
    match job.task {
        _ if job.is_endless() => format!("no end, stops at {limit_s} s"),
        TaskSpec::Hold { duration_s } => format!("{duration_s} s"),
        _ => format!("at most {limit_s} s"),
    }
}
