use std::fs;
use std::path::Path;

use rusqlite::{Connection, OptionalExtension, params};
use serde_json::Value;

use super::audit::{ended_in_order, paused};
use super::columns::{JOB, job_of, rows};
use super::run_file::{modified, text_of};
use super::{AuditEntry, JobEnd, JobRow, JobState, RecordingStatus, RecoveryReport, Store, StoreFault};
use upm_core::job::{Outcome, StopCause};

impl Store {
    /// Recovers the state that the last daemon left: ends of its running jobs, paused plates. Idempotent: safe to
    /// repeat after a crash at any point.
    pub(super) fn recover(&self, plates: &[String]) -> Result<RecoveryReport, StoreFault> {
        let running = format!("SELECT {JOB} FROM jobs WHERE state = 'running' ORDER BY id");
        let left = self.read(|connection| rows(connection, &running, [], job_of))?;
        self.write(|write| {
            let tx = &write.tx;
            let mut found = RecoveryReport { clean: left.is_empty() && ended_in_order(tx)?, ..Default::default() };
            for job in &left {
                let folder = job.folder.as_ref().map(|name| self.runs.join(name));
                let end = end_of(folder.as_deref());
                write.end(job, JobState::Running, &end, folder.as_deref())?;
                let at = folder.as_deref().and_then(last_write).unwrap_or_else(|| write.at());
                let at = at.max(job.started_at.as_ref().unwrap_or(&job.submitted_at).clone());
                tx.execute("UPDATE jobs SET finished_at = ?2 WHERE id = ?1", params![job.id, at])?;
                let list = if end.state == JobState::Interrupted { &mut found.interrupted } else { &mut found.ended };
                list.push(job.id);
            }
            found.known = known(tx)?;
            let before = paused(tx)?;
            found.paused_after = last_ended(tx, &before)?;
            let waiting: Vec<String> =
                rows(tx, "SELECT DISTINCT plate FROM jobs WHERE state = 'queued'", [], |row| row.get(0))?;
            let is_paused = |plate: &&String| !found.clean || before.contains(plate) || waiting.contains(plate);
            found.paused = plates.iter().filter(is_paused).cloned().collect();
            // so that they stay paused if this daemon ends before they are resumed
            for plate in found.paused.iter().filter(|plate| !before.contains(plate)) {
                write.audit(&AuditEntry::of_plate(plate, AuditEntry::PAUSE, "the daemon started"))?;
            }
            // so that the next start knows them
            for plate in plates.iter().filter(|plate| !found.known.contains(plate)) {
                write.audit(&AuditEntry::of_plate(plate, AuditEntry::ADD, "first start with this plate"))?;
            }
            write.audit(&AuditEntry::of_daemon(AuditEntry::STARTED))?;
            Ok(found)
        })
    }
}

/// Plates of earlier starts.
fn known(tx: &Connection) -> rusqlite::Result<Vec<String>> {
    rows(tx, "SELECT DISTINCT plate FROM audit WHERE act = ?1", [AuditEntry::ADD], |row| row.get(0))
}

/// The newest ended job of each of `plates`.
fn last_ended(tx: &Connection, plates: &[String]) -> rusqlite::Result<Vec<JobRow>> {
    let sql = format!(
        "SELECT {JOB} FROM jobs WHERE plate = ?1 AND finished_at IS NOT NULL ORDER BY finished_at DESC LIMIT 1"
    );
    let mut statement = tx.prepare(&sql)?;
    let last = plates.iter().map(|plate| statement.query_row([plate], job_of).optional());
    last.filter_map(Result::transpose).collect()
}

/// The end of a job that was running: as in its report, if the run wrote one. A run without a report did not close its
/// recording.
fn end_of(folder: Option<&Path>) -> JobEnd {
    let report_json = folder.and_then(|folder| text_of(&folder.join("report.json")));
    let report: Option<Value> = report_json.as_deref().and_then(|text| serde_json::from_str(text).ok());
    let text = |at: &str| report.as_ref()?.pointer(at)?.as_str();
    let outcome = text("/outcome").and_then(Outcome::of_code);
    let is_recorded = folder.is_some_and(|folder| fs::symlink_metadata(folder.join("run.rrd")).is_ok());
    let recording = match (outcome, text("/recording/code")) {
        _ if !is_recorded => RecordingStatus::None,
        (None, _) => RecordingStatus::Partial,
        (Some(_), Some(_)) => RecordingStatus::Failed,
        (Some(_), None) => RecordingStatus::Whole,
    };
    let (state, reason, report_json) = match outcome {
        Some(outcome) => {
            let state = JobState::of_end(outcome, text("/stop/code").and_then(StopCause::of_code));
            (state, text("/reason").unwrap_or_default().to_owned(), report_json)
        }
        None => (JobState::Interrupted, "the daemon ended while it ran".to_owned(), None),
    };
    JobEnd { state, reason, report_json, recording, progress: 0.0 }
}

/// Time of the last write to the latest file of a run: its report, otherwise its journal, otherwise `effective.json`.
fn last_write(folder: &Path) -> Option<String> {
    ["report.json", "journal.jsonl", "effective.json"].iter().find_map(|name| modified(&folder.join(name)))
}
