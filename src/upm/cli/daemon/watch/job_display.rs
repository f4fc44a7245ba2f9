use std::io::{IsTerminal, stderr, stdout};

use indicatif::ProgressBar;
use serde::Deserialize;
use serde_json::json;

use super::events::ReceivedEvent;
use crate::cli::args::Common;
use crate::cli::daemon::client::on_one_line;
use crate::cli::daemon::jobs::{headline, print_job};
use crate::cli::output::Failure;
use crate::cli::progress::{FULL, bar};
use upm_server::api::{JOB_EVENT, Job};

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
    if let Some(job) = job_of(event) {
        return Some((job.progress, job.state.code().to_owned()));
    }
    let Cycle { at_s, progress, phase, .. } = Cycle::of(event)?;
    Some((progress, format!("plate {at_s:6.1} s  {}", on_one_line(&phase))))
}

/// Line that stays on the screen above the bar.
pub(super) fn note_of(event: &ReceivedEvent) -> Option<String> {
    let Note { at_s, level, text } = Note::of(event)?;
    (level != "info").then(|| on_one_line(&format!("plate {at_s:6.1} s  {level}: {text}")))
}

/// The event as one line of text.
pub(super) fn line_of(event: &ReceivedEvent) -> Option<String> {
    if let Some(job) = job_of(event) {
        return Some(headline(&job));
    }
    let Some(Cycle { cycle, at_s, progress, phase, pulses }) = Cycle::of(event) else { return note_of(event) };
    let noun = if pulses == 1 { "pulse" } else { "pulses" };
    let percent = 100.0 * progress;
    Some(on_one_line(&format!("plate {at_s:6.1} s  {percent:3.0} %  cycle {cycle}, {pulses} {noun}  {phase}")))
}

/// The job in an event that has one.
pub(super) fn job_of(event: &ReceivedEvent) -> Option<Job> {
    Some(event).filter(|event| event.kind == JOB_EVENT).and_then(|event| Job::deserialize(&event.data).ok())
}

/// A cycle of the journal, as far as it is shown.
struct Cycle {
    cycle: u64,
    at_s: f64,
    progress: f64,
    phase: String,
    pulses: usize,
}

impl Cycle {
    fn of(event: &ReceivedEvent) -> Option<Self> {
        let data = Some(&event.data).filter(|data| data["type"] == "cycle")?;
        Some(Self {
            cycle: data["cycle"].as_u64()?,
            at_s: data["ended_at_s"].as_f64()?,
            progress: data["wanted"]["progress"].as_f64()?,
            phase: data["wanted"]["phase"].as_str()?.to_owned(),
            pulses: data["plan"]["pulses"].as_array()?.len(),
        })
    }
}

/// An event of the journal.
#[derive(Deserialize)]
struct Note {
    at_s: f64,
    level: String,
    text: String,
}

impl Note {
    fn of(event: &ReceivedEvent) -> Option<Self> {
        let data = Some(&event.data).filter(|data| data["type"] == "event")?;
        Self::deserialize(data).ok()
    }
}
