use super::client::{Client, job_path, on_one_line};
use super::job_id::{job_id, short_id};
use crate::cli::args::Common;
use crate::cli::client_args::{DaemonArgs, JobArgs, JobsArgs};
use crate::cli::output::{Failure, print};
use crate::cli::progress::behind;
use crate::cli::summary;
use upm_core::job::Pace;
use upm_recording::Report;
use upm_server::api::{Job, Plate, Plates};
use upm_server::states::{JobState, PlateState, RecordingStatus, StandingJob, StandingState};

pub(super) fn jobs(args: &JobsArgs, common: Common) -> Result<u8, Failure> {
    let client = Client::new(&args.daemon)?;
    let most = if args.all { u32::MAX } else { args.limit };
    let page = client.jobs(args.state.as_deref(), most)?;
    print(common.json, &page, || {
        let ids: Vec<String> = page.jobs.iter().map(|job| job.id.to_string()).collect();
        page.jobs.iter().zip(&ids).try_for_each(|(job, id)| print_line(job, &short_id(id, &ids)))?;
        if page.next.is_some() && !common.quiet {
            errln!("upm: there are more: --limit N, or --all");
        }
        Ok(())
    })
}

fn print_line(job: &Job, id: &str) -> Result<(), Failure> {
    let Job { name, plate, submitted_at, .. } = job;
    let (state, percent) = (job.state.code(), 100.0 * job.progress);
    let standing = if job.standing { " (standing job)" } else { "" };
    let line = format!("{id}  {state:11} {percent:3.0} %  {}  {plate:16} {name}{standing}", seconds(submitted_at));
    outln!("{}", on_one_line(&line))
}

pub(super) fn show(args: &JobArgs, common: Common) -> Result<u8, Failure> {
    let client = Client::new(&args.daemon)?;
    let job: Job = client.get(&job_path(&job_id(&client, &args.id)?))?;
    print(common.json, &job, || print_job(&job, common.verbose > 0))
}

/// The job that `args` name after an operation on it.
fn after(operation: &str, args: &JobArgs) -> Result<Job, Failure> {
    let client = Client::new(&args.daemon)?;
    let path = job_path(&job_id(&client, &args.id)?);
    Ok(client.post(&format!("{path}/{operation}"), "", None)?)
}

pub(super) fn run_next(args: &JobArgs, common: Common) -> Result<u8, Failure> {
    let job = after("run-next", args)?;
    print(common.json, &job, || outln!("{}: runs next on plate {}", job.id, job.plate))
}

pub(super) fn cancel(args: &JobArgs, common: Common) -> Result<u8, Failure> {
    let job = after("cancel", args)?;
    let state = if job.state == JobState::Running { "is being stopped" } else { job.state.code() };
    print(common.json, &job, || outln!("{}: {state}", job.id))
}

/// Prints a job as text; [`summary::rows`] explains `verbose`.
pub(super) fn print_job(job: &Job, verbose: bool) -> Result<(), Failure> {
    outln!("{}", headline(job))?;
    for (label, text) in rows(job, verbose) {
        outln!("  {label:15} {}", on_one_line(&text))?;
    }
    Ok(())
}

/// Job, plate, state and reason on one line.
pub(super) fn headline(job: &Job) -> String {
    let state = job.state.code();
    let why = if job.reason.is_empty() { String::new() } else { format!(": {}", job.reason) };
    on_one_line(&format!("{} on plate {}, seed {}: {state}{why}", job.name, job.plate, job.seed))
}

fn rows(job: &Job, verbose: bool) -> Vec<(&'static str, String)> {
    let mut rows = vec![("id", job.id.to_string()), ("submitted", seconds(&job.submitted_at))];
    rows.extend(job.started_at.as_deref().map(|at| ("started", seconds(at))));
    rows.extend(job.finished_at.as_deref().map(|at| ("finished", seconds(at))));
    if job.state == JobState::Running {
        rows.push(("progress", format!("{:.0} %", 100.0 * job.progress)));
    }
    if job.pace == Pace::Max {
        rows.push(("pace", "as fast as possible".to_owned()));
    }
    if job.recording != RecordingStatus::None {
        rows.push(("recording", job.recording.code().to_owned()));
    }
    let report = job.report.clone().map(serde_json::Value::Object);
    let report: Option<Report> = report.and_then(|report| serde_json::from_value(report).ok());
    if let Some(report) = report {
        rows.extend(summary::rows(&report, verbose));
        rows.extend(report.incidents.warnings.into_iter().map(|warning| ("warning", warning)));
    }
    rows
}

pub(super) fn plates(daemon: &DaemonArgs, common: Common) -> Result<u8, Failure> {
    let plates: Plates = Client::new(daemon)?.get("/v1/plates")?;
    print(common.json, &plates, || plates.plates.iter().try_for_each(|plate| outln!("{}", plate_line(plate))))
}

/// Plate on one line, with the command to type if it waits for an operator.
pub(super) fn plate_line(plate: &Plate) -> String {
    let Plate { name, queued, why, .. } = plate;
    let behind = behind(plate.behind_s);
    let is_running = |standing: &StandingJob| standing.state == StandingState::Running;
    let doing = match plate.state {
        PlateState::Idle => {
            plate.standing_job.as_ref().map(|standing| standing_line(standing, name)).unwrap_or_default()
        }
        PlateState::Running if plate.standing_job.as_ref().is_some_and(is_running) => {
            format!("standing job {}{behind}  {}", plate.job.as_deref().unwrap_or_default(), plate.observation.phase)
        }
        PlateState::Running => {
            let job = plate.job.as_deref().unwrap_or("a job");
            format!("{:3.0} % of {job}{behind}  {}", 100.0 * plate.observation.progress, plate.observation.phase)
        }
        PlateState::Paused => format!("{why} (upm resume {name})"),
        PlateState::Stopped => format!("{why} (upm reset {name} --operator NAME --reason TEXT)"),
    };
    let state = plate.state.code();
    let resumed = plate.resumed_by.as_ref().map(|operator| format!("  resumed by {operator}")).unwrap_or_default();
    on_one_line(format!("{name:16} {state:8} {queued:4} queued  {doing}{resumed}").trim_end())
}

/// Line for a standing job that is not running.
fn standing_line(standing: &StandingJob, plate: &str) -> String {
    let StandingJob { name, state, why } = standing;
    match state {
        StandingState::Paused => format!("standing job {name} is paused: {why} (upm resume {plate})"),
        StandingState::Waiting | StandingState::Running if why.is_empty() => String::new(),
        StandingState::Waiting | StandingState::Running => format!("standing job {name} waits: {why}"),
    }
}

/// Timestamp without fractions of a second.
fn seconds(at: &str) -> String {
    let time: Option<jiff::Timestamp> = at.parse().ok();
    time.map_or_else(|| on_one_line(at), |time| time.strftime("%Y-%m-%d %H:%M:%SZ").to_string())
}
