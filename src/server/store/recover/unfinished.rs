use std::fs;
use std::path::Path;

use serde::Deserialize;

use crate::store::run_file::{modified, text_of};
use crate::store::{JobEnd, JobState, RecordingStatus};
use upm_core::job::{Outcome, RecordingEnd, StopCause};
use upm_core::time::PlateTime;

/// The end of a run in its report.
#[derive(Deserialize)]
struct ReportedEnd {
    outcome: Outcome,
    #[serde(default)]
    reason: String,
    #[serde(default)]
    stop: Option<ReportedStop>,
    #[serde(default)]
    plate_time_s: f64,
    /// `None` for a recording that holds the whole run.
    #[serde(default)]
    recording: Option<ReportedRecording>,
}

#[derive(Deserialize)]
struct ReportedRecording {
    code: RecordingEnd,
}

#[derive(Deserialize)]
struct ReportedStop {
    code: String,
}

impl ReportedEnd {
    fn recording(&self) -> RecordingStatus {
        match self.recording.as_ref().map(|recording| recording.code) {
            None => RecordingStatus::Whole,
            Some(RecordingEnd::RecordingFailed) => RecordingStatus::Failed,
        }
    }

    fn stop(&self) -> Option<StopCause> {
        self.stop.as_ref().and_then(|stop| StopCause::of_code(&stop.code))
    }
}

/// The end of a job that was running: as in its report, if the run wrote one. A run without a report did not close its
/// recording.
pub(super) fn end_of(folder: Option<&Path>) -> JobEnd {
    let report_json = folder.and_then(|folder| text_of(&folder.join("report.json")));
    let report: Option<ReportedEnd> = report_json.as_deref().and_then(|text| serde_json::from_str(text).ok());
    let is_recorded = folder.is_some_and(|folder| fs::symlink_metadata(folder.join("run.rrd")).is_ok());
    let recording = match &report {
        _ if !is_recorded => RecordingStatus::None,
        Some(report) => report.recording(),
        None => RecordingStatus::Partial,
    };
    match report {
        Some(report) => {
            let stop = report.stop();
            let (at, state) = (PlateTime::from_secs(report.plate_time_s), JobState::of_end(report.outcome, stop));
            JobEnd { at, state, stop, reason: report.reason, report_json, recording }
        }
        None => JobEnd {
            at: PlateTime::ZERO,
            state: JobState::Interrupted,
            stop: Some(StopCause::Shutdown),
            reason: "the daemon ended while it ran".to_owned(),
            report_json: None,
            recording,
        },
    }
}

/// Time of the last write to the latest file of a run: its report, otherwise its journal, otherwise `effective.json`.
pub(super) fn last_write(folder: &Path) -> Option<jiff::Timestamp> {
    ["report.json", "journal.jsonl", "effective.json"].iter().find_map(|name| modified(&folder.join(name)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn end_of_a_run_is_read_from_its_report() {
        let folder = tempfile::tempdir().unwrap();
        for (report, state, stop) in [
            (r#"{"outcome": "completed"}"#, JobState::Completed, None),
            (
                r#"{"outcome": "failed", "stop": {"code": "part_lost", "text": "gone"}}"#,
                JobState::Failed,
                Some(StopCause::PartLost),
            ),
            (
                r#"{"outcome": "cancelled", "stop": {"code": "shutdown", "text": "whatever it says"}}"#,
                JobState::Interrupted,
                Some(StopCause::Shutdown),
            ),
            ("no report", JobState::Interrupted, Some(StopCause::Shutdown)),
        ] {
            fs::write(folder.path().join("report.json"), report).unwrap();
            let end = end_of(Some(folder.path()));
            assert_eq!((end.state, end.stop, end.recording), (state, stop, RecordingStatus::None), "{report}");
        }
    }
}
