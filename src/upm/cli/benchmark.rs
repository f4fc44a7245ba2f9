//! `upm benchmark`: standard tasks run without pixels, a row of figures each, which anyone can run again and compare.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Serialize};
use serde_json::{Deserializer, Value};
use sha2::{Digest, Sha256};

use super::args::Common;
use super::export::Drafts;
use super::init::write_shipped;
use super::output::{Failure, INTERRUPTED, NOT_REACHED, stop_on_interrupt};
use super::progress::LateProgress;
use super::run_args::BenchmarkArgs;
use super::shipped::FILES;
use upm_core::job::CameraMode;
use upm_core::time::{Clock, MonotonicClock};
use upm_recording::{Journal, rounded};
use upm_runner::config::{JobSpec, Origin, one_of};
use upm_runner::run::{InMemoryRun, maker};

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
    let folder = std::env::temp_dir().join(format!("upm-benchmark-{}", std::process::id()));
    let _made = Drafts(vec![folder.clone()]);
    FILES.iter().try_for_each(|(name, text)| write_shipped(&folder, name, text))?;
    let mut differing = 0;
    for (number, (task, planner, seed)) in wanted.iter().enumerate() {
        shown.show(number as f64 / wanted.len() as f64, || format!("{task}, seed {seed}"));
        let row = row(&folder, task, planner.as_deref(), *seed, &stop)?;
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
    let text = fs::read_to_string(file).map_err(|error| Failure::read_failed(file, &error))?;
    let rows = Deserializer::from_str(&text).into_iter().collect::<Result<_, _>>();
    rows.map_err(|error| Failure::bad_input(format!("{}: expected a row, found {error}", file.display())))
}

/// The run of a task with a planner, or with that of its job; `folder` has the shipped files.
fn row(folder: &Path, task: &str, planner: Option<&str>, seed: u64, stop: &AtomicBool) -> Result<Row, Failure> {
    let file = format!("configs/{task}.json");
    let Some((_, text)) = FILES.iter().find(|(name, _)| TASKS.contains(&task) && *name == file) else {
        return Err(Failure::bad_input(format!("benchmark: expected {}, found {task:?}", one_of(task, &TASKS))));
    };
    let mut document: Value = serde_json::from_str(text).map_err(Failure::failed)?;
    document["seed"] = seed.into();
    planner.into_iter().for_each(|planner| document["planner"] = planner.into());
    let origin = Origin { file, folder: Some(folder.join("configs")) };
    let job = JobSpec::from_json(&document.to_string(), &origin, None).map_err(Failure::faults)?;
    let job = job.with_camera(CameraMode::Positions);
    let run = InMemoryRun::new(&job)?;
    let mut journal = Journal::new(Sha256::new(), Arc::clone(run.library()));
    let clock = MonotonicClock::new();
    let report = run.run_until(stop, &mut journal);
    let process_time_s = rounded(clock.elapsed().as_secs_f64());
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
        process_time_s,
        program: maker(),
        job: format!("{:x}", Sha256::digest(text)),
        journal: format!("{:x}", journal.finish().map_err(Failure::failed)?.finalize()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_repeated_by_task_seed_and_planner() {
        let row = |task, planner, seed| {
            row(Path::new(env!("CARGO_MANIFEST_DIR")), task, planner, seed, &AtomicBool::new(false))
        };
        let arranged = |planner, seed| row("arrange-2", planner, seed).unwrap();
        let first = arranged(None, 1);
        assert!(first.success && first.planner == "moving_field" && first.throughput_per_s > 0.5, "{first:?}");
        let (again, other) = (arranged(Some("moving_field"), 1), arranged(None, 2));
        assert_eq!((&first.job, &first.journal), (&again.job, &again.journal));
        assert!(first.job == other.job && first.journal != other.journal);
        let refused = row("arrange-3", None, 1).unwrap_err().lines;
        assert!(refused[0].contains("did you mean arrange-2?"), "{refused:?}");
    }
}
