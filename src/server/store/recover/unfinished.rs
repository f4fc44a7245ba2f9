use std::fs;
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use serde::Deserialize;
use serde_json::Value;

use crate::store::run_file::{modified, text_of};
use crate::store::{
    JobEnd, JobRow, JobState, RecordingRepair, RecordingStatus, RecoveryReport, RepairRecording, RunFileFault,
    open_run_file,
};
use upm_core::job::{Outcome, RecordingEnd, StopCause};
use upm_core::time::PlateTime;

/// Bytes of a journal that are searched at a time.
const BLOCK_BYTES: u64 = 1 << 20;

/// Repairs the recording in a run folder if needed, and returns its state now. A recording that is not a regular file
/// stays as it is.
pub(super) fn repair_recording(
    folder: &Path,
    job: &JobRow,
    repair: RepairRecording<'_>,
    found: &mut RecoveryReport,
) -> RecordingStatus {
    let (part, whole) = (folder.join("run.rrd.part"), folder.join("run.rrd"));
    let repaired = match open_run_file(folder, "run.rrd.part").map(drop) {
        Err(RunFileFault::Missing) if whole.exists() => return closed(folder, job.recording),
        Err(RunFileFault::Missing) => return RecordingStatus::None,
        Err(fault) => Err(format!("run.rrd.part: {fault}")),
        // code that reads damaged files may panic; a start must not
        Ok(()) => catch_unwind(AssertUnwindSafe(|| repair(&part, &whole)))
            .unwrap_or_else(|_| Err("the repair failed on it".to_owned())),
    };
    let kept = match &repaired {
        Ok(RecordingRepair { was_whole: true, .. }) => closed(folder, job.recording),
        Ok(_) => RecordingStatus::Recovered,
        Err(_) => RecordingStatus::Partial,
    };
    if repaired.is_ok() && part.exists() {
        // repaired into another file; if this one stays, it is repaired again
        let _ = fs::remove_file(&part);
    }
    found.repaired.push((whole, repaired));
    kept
}

/// State of a closed recording, from the state known before this start.
fn closed(folder: &Path, known: RecordingStatus) -> RecordingStatus {
    match known {
        RecordingStatus::None if ends_early(folder) => RecordingStatus::Stopped,
        RecordingStatus::None => RecordingStatus::Whole,
        // a start that was killed may have closed it
        RecordingStatus::Partial | RecordingStatus::Failed => RecordingStatus::Recovered,
        kept => kept,
    }
}

/// True when the report, or the journal of a run without a report, says that the recording ended before the run did.
fn ends_early(folder: &Path) -> bool {
    let Some(report) = text_of(&folder.join("report.json")) else { return journal_reports_early_end(folder) };
    let report: Value = serde_json::from_str(&report).unwrap_or_default();
    report["recording"].is_object()
}

/// Searches a journal for the end of its recording, block by block, since it may be long. False for an unreadable
/// journal.
fn journal_reports_early_end(folder: &Path) -> bool {
    let Ok(mut file) = open_run_file(folder, "journal.jsonl") else { return false };
    let signs = RecordingEnd::ALL.map(|end| format!("\"code\":\"{}\"", end.code()));
    let longest = signs.iter().map(String::len).max().unwrap_or(0);
    let mut seen = Vec::new();
    loop {
        // a match may cross two blocks
        seen.drain(..seen.len().saturating_sub(longest));
        match (&mut file).take(BLOCK_BYTES).read_to_end(&mut seen) {
            Ok(0) | Err(_) => return false,
            Ok(_) if signs.iter().any(|sign| seen.windows(sign.len()).any(|bytes| bytes == sign.as_bytes())) => {
                return true;
            }
            Ok(_) => {}
        }
    }
}

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
}

#[derive(Deserialize)]
struct ReportedStop {
    code: String,
}

impl ReportedEnd {
    fn stop(&self) -> Option<StopCause> {
        self.stop.as_ref().and_then(|stop| StopCause::of_code(&stop.code))
    }
}

/// The end of a job that was running: as in its report, if the run wrote one.
pub(super) fn end_of(folder: Option<&Path>, recording: RecordingStatus) -> JobEnd {
    let report_json = folder.and_then(|folder| text_of(&folder.join("report.json")));
    let report: Option<ReportedEnd> = report_json.as_deref().and_then(|text| serde_json::from_str(text).ok());
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
    fn early_end_of_a_recording_is_read_from_journal_and_report() {
        let folder = tempfile::tempdir().unwrap();
        let journal = folder.path().join("journal.jsonl");
        assert!(!ends_early(folder.path()));
        let block = BLOCK_BYTES as usize;
        for line in [
            r#""text":"whatever it says","code":"recording_stopped""#,
            r#""text":"whatever it says","code":"recording_failed""#,
        ] {
            for before in [0, block - line.len() / 2, block - 8, block, 2 * block + 5] {
                fs::write(&journal, ["x".repeat(before).as_str(), line, &"x".repeat(99)].concat()).unwrap();
                assert!(ends_early(folder.path()), "{before} bytes before it");
            }
        }
        fs::write(folder.path().join("report.json"), "{}").unwrap();
        assert!(!ends_early(folder.path()), "the report knows better");
        let report = r#"{"recording": {"code": "recording_failed", "text": "no space"}}"#;
        fs::write(folder.path().join("report.json"), report).unwrap();
        assert!(ends_early(folder.path()));
    }

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
            let end = end_of(Some(folder.path()), RecordingStatus::None);
            assert_eq!((end.state, end.stop), (state, stop), "{report}");
        }
    }
}
