use serde_json::json;

use super::follow::{ReceivedEvent, job_of};
use crate::cli::args::Common;
use crate::cli::daemon::client::on_one_line;
use crate::cli::daemon::jobs::{headline, print_job};
use crate::cli::output::Failure;
use upm_core::document::counted;
use upm_server::api::Job;

/// Shows an event: as a JSON object, as a line, or not at all with `--quiet`.
pub(super) fn show(event: &ReceivedEvent, common: Common) -> Result<(), Failure> {
    if common.json {
        let ReceivedEvent { id, kind, data } = event;
        return outln!("{}", json!({ "id": id, "event": kind, "data": data }));
    }
    line_of(event).filter(|_| !common.quiet).map_or(Ok(()), |line| outln!("{line}"))
}

/// Shows a message about the connection, not about the job.
pub(super) fn note(line: &str, common: Common) {
    if !common.quiet {
        errln!("upm: {}", on_one_line(line));
    }
}

/// Shows a job that has ended.
pub(super) fn show_end(job: &Job, common: Common) -> Result<(), Failure> {
    match (common.json, common.quiet) {
        (true, _) => Ok(()),
        (false, true) => outln!("{}", headline(job)),
        (false, false) => {
            print_job(job, common.verbose > 0)?;
            outln!("  {:15} upm show {}", "all of it", job.id)
        }
    }
}

/// The event as one line of text: a state of the job, a cycle, a warning or an error.
pub(super) fn line_of(event: &ReceivedEvent) -> Option<String> {
    if let Some(job) = job_of(event) {
        return Some(headline(&job));
    }
    let data = &event.data;
    let line = match data["type"].as_str()? {
        "cycle" => {
            let (at_s, percent) = (data["ended_at_s"].as_f64()?, 100.0 * data["wanted"]["progress"].as_f64()?);
            let (pulses, phase) =
                (counted(data["plan"]["pulses"].as_array()?.len(), "pulse"), data["wanted"]["phase"].as_str()?);
            format!("plate {at_s:6.1} s  {percent:3.0} %  cycle {}, {pulses}  {phase}", data["cycle"])
        }
        "event" if data["level"] != "info" => {
            let (at_s, level, text) = (data["at_s"].as_f64()?, data["level"].as_str()?, data["text"].as_str()?);
            format!("plate {at_s:6.1} s  {level}: {text}")
        }
        _ => return None,
    };
    Some(on_one_line(&line))
}
