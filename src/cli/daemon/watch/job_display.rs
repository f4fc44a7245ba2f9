use std::io::{IsTerminal, stderr, stdout};

use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::events::ReceivedEvent;
use crate::cli::args::Common;
use crate::cli::daemon::client::on_one_line;
use crate::cli::daemon::jobs::{headline, plate_line, print_job};
use crate::cli::output::Failure;
use crate::cli::progress::{FULL, bar, behind};
use upm_server::api::{Job, Plate};
use upm_server::states::{JobState, PlateState};

/// Output format of a watched job.
enum OutputFormat {
    /// Each event as a JSON object on a line of stdout.
    Json,
    /// A progress bar on stderr.
    Bar(ProgressBar),
    /// A line on stdout for each event.
    Lines,
    /// Only the end of the job.
    EndAlone,
}

/// Output of a watched job.
pub(super) struct JobDisplay {
    how: OutputFormat,
    quiet: bool,
    verbose: bool,
    id: String,
}

impl JobDisplay {
    pub fn new(id: &str, Common { json, quiet, verbose }: Common) -> Self {
        let how = match (json, quiet) {
            (true, _) => OutputFormat::Json,
            (false, true) => OutputFormat::EndAlone,
            (false, false) if stderr().is_terminal() && stdout().is_terminal() => OutputFormat::Bar(bar(false)),
            (false, false) => OutputFormat::Lines,
        };
        Self { how, quiet, verbose: verbose > 0, id: id.to_owned() }
    }

    pub fn show(&mut self, event: &ReceivedEvent) -> Result<(), Failure> {
        match &self.how {
            OutputFormat::Json => {
                let ReceivedEvent { id, kind, data } = event;
                outln!("{}", json!({ "id": id, "event": kind, "data": data }))?;
            }
            OutputFormat::Bar(bar) => {
                if let Some((done, message)) = bar_of(event) {
                    bar.set_position((done * FULL as f64) as u64);
                    bar.set_message(message);
                }
                if let Some(note) = note_of(event) {
                    bar.suspend(|| errln!("{note}"));
                }
            }
            OutputFormat::Lines => {
                if let Some(line) = line_of(event) {
                    outln!("{line}")?;
                }
            }
            OutputFormat::EndAlone => {}
        }
        Ok(())
    }

    /// Shows a message about the connection, not about the job.
    pub fn note(&self, line: &str) {
        let line = format!("upm: {}", on_one_line(line));
        match &self.how {
            _ if self.quiet => {}
            OutputFormat::Bar(bar) => bar.suspend(|| errln!("{line}")),
            _ => errln!("{line}"),
        }
    }

    pub fn ended(&self, job: &Job) -> Result<(), Failure> {
        match self.how {
            OutputFormat::Json => Ok(()),
            OutputFormat::EndAlone => outln!("{}", headline(job)),
            OutputFormat::Bar(_) | OutputFormat::Lines => {
                print_job(job, self.verbose)?;
                outln!("  {:15} upm show {}", "all of it", self.id)
            }
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        if let OutputFormat::Bar(bar) = &self.how {
            bar.finish_and_clear();
        }
    }
}

/// Share done and current activity, for the bar.
fn bar_of(event: &ReceivedEvent) -> Option<(f64, String)> {
    let data = &event.data;
    match event.kind.as_str() {
        "look" | "cycle" => {
            let behind = behind(number(data, "behind_s"));
            let message = format!("plate {:6.1} s{behind}  {}", number(data, "at_s"), text(data, "phase"));
            Some((number(data, "progress"), message))
        }
        "snapshot" => {
            let JobSnapshot { job, plate } = JobSnapshot::of(data)?;
            let waits = |plate: &Plate| match plate.state {
                PlateState::Running => "waits: its plate has another job".to_owned(),
                PlateState::Paused | PlateState::Stopped => format!("waits: {}", plate_line(plate)),
                PlateState::Idle => "waits".to_owned(),
            };
            let queued = plate.as_ref().filter(|_| job.state == JobState::Queued);
            let message = queued.map_or_else(|| job.state.code().to_owned(), waits);
            Some((job.progress, message))
        }
        "state" => Some((0.0, text(data, "state"))),
        _ => None,
    }
}

/// Line that stays on the screen above the bar.
pub(super) fn note_of(event: &ReceivedEvent) -> Option<String> {
    let data = &event.data;
    let at = format!("plate {:6.1} s", number(data, "at_s"));
    match event.kind.as_str() {
        "warning" => Some(format!("{at}  {}: {}", text(data, "level"), text(data, "text"))),
        "recording" => {
            let why = Some(text(data, "reason")).filter(|why| !why.is_empty()).map(|why| format!(": {why}"));
            Some(format!("{at}  recording {}{}", text(data, "recording"), why.unwrap_or_default()))
        }
        "gap" => {
            let [from, to] = ["from", "to"].map(|key| data.get(key).and_then(Value::as_u64).unwrap_or_default());
            Some(format!("events {from} to {to} cannot be had any more"))
        }
        _ => None,
    }
}

/// The event as one line of text.
pub(super) fn line_of(event: &ReceivedEvent) -> Option<String> {
    let data = &event.data;
    let at = format!("plate {:6.1} s", number(data, "at_s"));
    match event.kind.as_str() {
        "snapshot" => {
            let JobSnapshot { job, plate } = JobSnapshot::of(data)?;
            let queued = plate.filter(|_| job.state == JobState::Queued);
            let waits = queued.map(|plate| format!("\n{}", plate_line(&plate))).unwrap_or_default();
            Some(format!("{}{waits}", headline(&job)))
        }
        "state" => Some(format!("{at}  {}", text(data, "state"))),
        "cycle" => {
            let [cycle, pulses] =
                ["cycle", "pulses"].map(|key| data.get(key).and_then(Value::as_u64).unwrap_or_default());
            let (percent, phase) = (100.0 * number(data, "progress"), text(data, "phase"));
            let noun = if pulses == 1 { "pulse" } else { "pulses" };
            let behind = behind(number(data, "behind_s"));
            Some(format!("{at}{behind}  {percent:3.0} %  cycle {cycle}, {pulses} {noun}  {phase}"))
        }
        "finished" => Some(format!("{at}  {}: {}", text(data, "state"), text(data, "reason"))),
        _ => note_of(event),
    }
}

struct JobSnapshot {
    job: Job,
    /// `None` if the daemon no longer has a plate of that name.
    plate: Option<Plate>,
}

impl JobSnapshot {
    fn of(data: &Value) -> Option<Self> {
        let plate = data.get("plate").and_then(|plate| serde_json::from_value(plate.clone()).ok());
        Some(Self { job: serde_json::from_value(data.get("job")?.clone()).ok()?, plate })
    }
}

fn number(data: &Value, key: &str) -> f64 {
    data.get(key).and_then(Value::as_f64).unwrap_or_default()
}

fn text(data: &Value, key: &str) -> String {
    on_one_line(data.get(key).and_then(Value::as_str).unwrap_or_default())
}
