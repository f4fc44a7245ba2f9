//! `upm benchmark`: standard tasks run without pixels, a row of figures each, which anyone can run again and compare.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Serialize};
use serde_json::{Deserializer, Value, json};
use sha2::{Digest, Sha256};

use super::args::Common;
use super::export::Drafts;
use super::init::write_shipped;
use super::output::{Failure, INTERRUPTED, NOT_REACHED, stop_on_interrupt};
use super::progress::LateProgress;
use super::run_args::BenchmarkArgs;
use super::shipped::FILES;
use upm_control::{FrameFacts, Sink};
use upm_core::ground_truth::GroundTruthHandle;
use upm_core::job::CameraMode;
use upm_core::time::{Clock, MonotonicClock};
use upm_recording::{Fanout, Journal, rounded};
use upm_runner::config::{JobSpec, Origin, one_of};
use upm_runner::episode::{Episode, EpisodeParams};
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

/// Streams of eight pennies, in which a part that has arrived gets a new place, and the distance within which it has
/// arrived, mm: that of the other tasks, and 65 % of a penny's diameter, the share by which MagBotSim counts its goals.
const STREAMS: [(&str, f64); 2] = [("stream-8", 0.5), ("stream-8-coarse", 12.4)];
/// The planner of fields, which turns the steps of an episode into motions.
const STREAM_PLANNER: &str = "synthesized_field";
/// Places that a stream's parts reach in all.
const GOALS: u64 = 500;

/// Weights of a part's speed, acceleration and jerk in the smoothness of a run, those of MagBotSim.
const OF_MOTION: [f64; 3] = [1.0, 5.0, 15.0];

/// Figures of one run.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Row {
    task: String,
    planner: String,
    seed: u64,
    /// Every part at its place, in truth, too.
    success: bool,
    /// Plate time until then, or until the run ended, s.
    makespan_s: f64,
    /// Parts, or places of a stream, a second of plate time; 0 without success.
    throughput_per_s: f64,
    /// Contacts between parts.
    collisions: u64,
    /// Largest true error at the end, mm.
    max_error_mm: Option<f64>,
    /// Mean weighted sum of speed, acceleration and jerk of all parts along both axes, in m and s, between frames.
    smoothness: Option<f64>,
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
            let usual = TASKS.into_iter().chain(STREAMS.map(|(task, _)| task)).map(str::to_owned).collect();
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
    let clock = MonotonicClock::new();
    let row = match STREAMS.into_iter().find(|(name, _)| *name == task) {
        Some((_, within_mm)) => stream(folder, within_mm, planner, seed, stop)?,
        None => run(folder, task, planner, seed, stop)?,
    };
    let process_time_s = rounded(clock.elapsed().as_secs_f64());
    Ok(Row { task: task.to_owned(), seed, process_time_s, program: maker(), ..row })
}

fn run(folder: &Path, task: &str, planner: Option<&str>, seed: u64, stop: &AtomicBool) -> Result<Row, Failure> {
    let file = format!("configs/{task}.json");
    let Some((_, text)) = FILES.iter().find(|(name, _)| TASKS.contains(&task) && *name == file) else {
        let known: Vec<&str> = TASKS.into_iter().chain(STREAMS.map(|(task, _)| task)).collect();
        return Err(Failure::bad_input(format!("benchmark: expected {}, found {task:?}", one_of(task, &known))));
    };
    let mut document: Value = serde_json::from_str(text).map_err(Failure::failed)?;
    document["seed"] = seed.into();
    planner.into_iter().for_each(|planner| document["planner"] = planner.into());
    let origin = Origin { file, folder: Some(folder.join("configs")) };
    let job = JobSpec::from_json(&document.to_string(), &origin, None).map_err(Failure::faults)?;
    let job = job.with_camera(CameraMode::Positions);
    let run = InMemoryRun::new(&job)?;
    let mut journal = Journal::new(Sha256::new(), Arc::clone(run.library()));
    let mut smoothness = Smoothness { truth: run.truth(), ..Smoothness::default() };
    let mut sinks = Fanout { sinks: vec![&mut journal, &mut smoothness], after_frame: None };
    let report = run.run_until(stop, &mut sinks);
    let success = report.reached_goal();
    Ok(Row {
        planner: report.planner.map(|planner| planner.name).unwrap_or_default(),
        success,
        makespan_s: report.plate_time_s,
        throughput_per_s: if success { report.parts.len() as f64 / report.plate_time_s } else { 0.0 },
        collisions: report.work.collisions.unwrap_or_default(),
        max_error_mm: report.accuracy.max_error_mm,
        smoothness: smoothness.mean(),
        job: format!("{:x}", Sha256::digest(text)),
        journal: format!("{:x}", journal.finish().map_err(Failure::failed)?.finalize()),
        ..Row::default()
    })
}

/// A stream by the planner of fields, which learns how far its steps carry each part.
fn stream(folder: &Path, within_mm: f64, planner: Option<&str>, seed: u64, stop: &AtomicBool) -> Result<Row, Failure> {
    if let Some(other) = planner.filter(|planner| *planner != STREAM_PLANNER) {
        return Err(Failure::bad_input(format!(
            "benchmark: a stream takes the planner {STREAM_PLANNER}, found {other:?}"
        )));
    }
    let text = json!({
        "parts": [{"kind": "penny", "count": 8}], "task": {"type": "stream"}, "action": "steps",
        "tolerance_mm": within_mm, "limits": {"plate_time_s": 1e5},
    });
    let text = text.to_string();
    let origin = Origin { file: "stream".into(), folder: Some(folder.join("configs")) };
    let mut episode = Episode::new(&Arc::new(EpisodeParams::from_json(&text, &origin)?), seed)?;
    let (mut goals, mut collisions) = (0, 0);
    while goals < GOALS && !episode.outcome().is_last() && !stop.load(Ordering::Relaxed) {
        let action = episode.expert();
        let outcome = episode.step(&action)?;
        goals += outcome.arrived as u64;
        collisions += outcome.collisions;
    }
    let makespan_s = episode.outcome().plate_time_s;
    let success = goals >= GOALS;
    Ok(Row {
        planner: STREAM_PLANNER.to_owned(),
        success,
        makespan_s,
        throughput_per_s: if success { goals as f64 / makespan_s } else { 0.0 },
        collisions,
        job: format!("{:x}", Sha256::digest(&text)),
        journal: episode.journal_hash(),
        ..Row::default()
    })
}

/// Measures how smoothly the parts move, in truth.
#[derive(Default)]
struct Smoothness {
    truth: GroundTruthHandle,
    /// Time of the last frame, s, and velocities, m/s, and accelerations, m/s², there, x and y of each part.
    last: Option<(f64, Vec<f64>, Vec<f64>)>,
    sum: f64,
    frames: u32,
}

impl Smoothness {
    fn mean(&self) -> Option<f64> {
        (self.frames > 0).then(|| rounded(self.sum / f64::from(self.frames)))
    }
}

impl Sink for Smoothness {
    fn frame(&mut self, _: &FrameFacts<'_>) {
        let truth = self.truth.read();
        let (at_s, velocities) =
            (truth.at.secs(), truth.parts.iter().flat_map(|part| [part.velocity_mps.x, part.velocity_mps.y]));
        let velocities: Vec<f64> = velocities.collect();
        let (last_s, before, slopes) =
            self.last.take().unwrap_or_else(|| (0.0, velocities.clone(), vec![0.0; velocities.len()]));
        let since_s = (at_s - last_s).max(f64::MIN_POSITIVE);
        let accelerations: Vec<f64> =
            velocities.iter().zip(&before).map(|(now, before)| (now - before) / since_s).collect();
        let jerk = accelerations.iter().zip(&slopes).map(|(now, before)| (now - before).abs() / since_s).sum::<f64>();
        let size = |of: &[f64]| of.iter().map(|x| x.abs()).sum::<f64>();
        let of_motion = [size(&velocities), size(&accelerations), jerk];
        self.sum += OF_MOTION.iter().zip(of_motion).map(|(weight, size)| weight * size).sum::<f64>();
        self.frames += 1;
        self.last = Some((at_s, velocities, accelerations));
    }
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
