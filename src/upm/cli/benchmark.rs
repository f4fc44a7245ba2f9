//! `upm benchmark`: standard tasks run without pixels, a row of figures each, which anyone can run again and compare.

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::args::Common;
use super::output::{Failure, INTERRUPTED, NOT_REACHED, stop_on_interrupt};
use super::progress::LateProgress;
use super::run::{run_failure, utc_now};
use super::run_args::BenchmarkArgs;
use super::shipped::FILES;
use upm_core::job::CameraMode;
use upm_core::time::MonotonicClock;
use upm_recording::{Fanout, RecordingOptions, RerunMode};
use upm_runner::config::{JobSpec, Origin, one_of};
use upm_runner::run::{PacingStats, RunOptions, RunResult, library_and_places, maker, run};

/// The tasks: shipped jobs.
const TASKS: [&str; 9] = [
    "arrange-2",
    "arrange-4",
    "arrange-8",
    "arrange-16",
    "arrange-24",
    "arrange-32",
    "sort-8",
    "sort-12",
    "letters-16",
];

/// Figures of one run.
#[derive(Debug, Serialize, Deserialize)]
struct Row {
    task: String,
    planner: String,
    seed: u64,
    /// Every part at its place, in truth, too.
    success: bool,
    /// Plate time until then, or until the run ended, s.
    makespan_s: f64,
    /// Parts a second of plate time; 0 without success.
    throughput_per_s: f64,
    /// Contacts between parts.
    collisions: u64,
    /// Largest true error at the end, mm.
    max_error_mm: Option<f64>,
    /// Time by the computer's clock, s.
    process_time_s: f64,
    /// Program and machine.
    program: String,
    /// SHA-256 of the task's job file, and of the run's journal.
    job: String,
    journal: String,
}

/// Runs the tasks, or those of a file of rows again.
pub(super) fn benchmark(args: &BenchmarkArgs, common: Common) -> Result<u8, Failure> {
    let stop = stop_on_interrupt();
    let mut shown = LateProgress::new(common);
    let rows = args.check.as_deref().map(rows_of).transpose()?;
    let wanted: Vec<(String, Option<String>, u64)> = match &rows {
        Some(rows) => rows.iter().map(|row| (row.task.clone(), Some(row.planner.clone()), row.seed)).collect(),
        None => {
            let usual = TASKS.map(str::to_owned).to_vec();
            let tasks = if args.tasks.is_empty() { usual } else { args.tasks.clone() };
            let each = |task: String| {
                args.seeds.as_slice().iter().map(move |seed| (task.clone(), args.planner.clone(), *seed))
            };
            tasks.into_iter().flat_map(each).collect()
        }
    };
    let (folder, mut differing) = (Folder::with_shipped()?, 0);
    for (number, (task, planner, seed)) in wanted.iter().enumerate() {
        shown.show(number as f64 / wanted.len() as f64, || format!("{task}, seed {seed}"));
        let row = folder.row(task, planner.as_deref(), *seed, &stop)?;
        if stop.load(Ordering::Relaxed) {
            shown.finish();
            return Ok(INTERRUPTED);
        }
        let line = match rows.as_ref().map(|rows| &rows[number]) {
            None => serde_json::to_string(&row).map_err(Failure::failed)?,
            Some(told) if (&told.job, &told.journal) == (&row.job, &row.journal) => continue,
            Some(told) => {
                differing += 1;
                let what = if told.job == row.job { "journal" } else { "job" };
                format!("{task}, seed {seed}: another {what}; made by {}, this is {}", told.program, row.program)
            }
        };
        let mut put = Ok(());
        shown.suspend(|| put = outln!("{line}"));
        put?;
    }
    shown.finish();
    let Some(rows) = rows else { return Ok(0) };
    outln!("{} of {} rows are equal byte for byte", rows.len() - differing, rows.len())?;
    Ok(if differing > 0 { NOT_REACHED } else { 0 })
}

/// Rows of a file that an earlier benchmark printed.
fn rows_of(file: &Path) -> Result<Vec<Row>, Failure> {
    let lines = BufReader::new(File::open(file).map_err(|error| Failure::read_failed(file, &error))?).lines();
    let row = |(number, line): (usize, io::Result<String>)| {
        let line = line.map_err(|error| Failure::read_failed(file, &error))?;
        let wrong =
            |error| Failure::bad_input(format!("{}: line {number}: expected a row, found {error}", file.display()));
        serde_json::from_str(&line).map_err(wrong)
    };
    (1..).zip(lines).map(row).collect()
}

/// A folder for the tasks' files and runs, removed at the end.
struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}

impl Folder {
    fn with_shipped() -> Result<Self, Failure> {
        let folder = Self(std::env::temp_dir().join(format!("upm-benchmark-{}", std::process::id())));
        for (name, text) in FILES {
            let file = folder.0.join(name);
            let written = fs::create_dir_all(file.parent().unwrap_or(&folder.0)).and_then(|()| fs::write(&file, text));
            written.map_err(|error| Failure::write(&file, error))?;
        }
        Ok(folder)
    }

    /// The run of a task with a planner, or with that of its job.
    fn row(&self, task: &str, planner: Option<&str>, seed: u64, stop: &AtomicBool) -> Result<Row, Failure> {
        let (text, job) = self.job(task, planner, seed)?;
        let library = library_and_places(&job).map_err(Failure::faults)?;
        let clock = MonotonicClock::new();
        let options = RunOptions {
            out: self.0.join("runs"),
            started_utc: utc_now(),
            rerun: RerunMode::Off,
            real_time: false,
            recording_options: RecordingOptions::lossless(clock),
        };
        let (pacing, mut watcher) = (PacingStats::default(), Fanout::default());
        let done = run(&job, library, &options, &clock, stop, &pacing, &mut watcher);
        let RunResult { folder, report } = done.map_err(|error| run_failure(&error))?;
        let path = folder.join("journal.jsonl");
        let journal = fs::read(&path).map_err(|error| Failure::read_failed(&path, &error))?;
        fs::remove_dir_all(&folder).ok();
        let success = report.reached_goal();
        Ok(Row {
            task: task.to_owned(),
            planner: report.planner.map(|planner| planner.name).unwrap_or_default(),
            seed,
            success,
            makespan_s: report.plate_time_s,
            throughput_per_s: if success { report.parts.len() as f64 / report.plate_time_s } else { 0.0 },
            collisions: report.work.collisions.unwrap_or_default(),
            max_error_mm: report.accuracy.max_error_mm,
            process_time_s: report.wall_time_s,
            program: maker(),
            job: hash(text.as_bytes()),
            journal: hash(&journal),
        })
    }

    /// The text of a task's job file, and the job with a seed and a planner.
    fn job(&self, task: &str, planner: Option<&str>, seed: u64) -> Result<(&'static str, JobSpec), Failure> {
        let file = format!("configs/{task}.json");
        let Some((_, text)) = FILES.iter().find(|(name, _)| TASKS.contains(&task) && *name == file) else {
            return Err(Failure::bad_input(format!("benchmark: expected {}, found {task:?}", one_of(task, &TASKS))));
        };
        let mut document: Value = serde_json::from_str(text).map_err(Failure::failed)?;
        document["seed"] = seed.into();
        planner.into_iter().for_each(|planner| document["planner"] = planner.into());
        let origin = Origin { file, folder: Some(self.0.join("configs")) };
        let job = JobSpec::from_json(&document.to_string(), &origin, None).map_err(Failure::faults)?;
        Ok((text, job.with_camera(CameraMode::Positions)))
    }
}

fn hash(bytes: &[u8]) -> String {
    format!("{:x}", Sha256::digest(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_repeated_by_task_seed_and_planner() {
        let (folder, stop) = (Folder::with_shipped().unwrap(), AtomicBool::new(false));
        let row = |planner, seed| folder.row("arrange-2", planner, seed, &stop).unwrap();
        let first = row(None, 1);
        assert!(first.success && first.planner == "moving_field" && first.throughput_per_s > 0.5, "{first:?}");
        let (again, other) = (row(Some("moving_field"), 1), row(None, 2));
        assert_eq!((&first.job, &first.journal), (&again.job, &again.journal));
        assert!(first.job == other.job && first.journal != other.journal);
        let refused = folder.row("arrange-3", None, 1, &stop).unwrap_err().lines;
        assert!(refused[0].contains("did you mean arrange-2?"), "{refused:?}");
    }
}
