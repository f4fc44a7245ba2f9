use std::fs;
use std::path::Path;

use rusqlite::Row;
use serde_json::Value;

use super::columns::{Json, rows};
use super::jobs::{ended_in_order, job_of};
use super::run_folders::{modified, text_of};
use super::{AuditEntry, Job, JobState, RecordingStatus, RecoveryReport, Store, StoreError};
use crate::states::PauseCause;
use upm_core::job::{Outcome, StopCause};

/// Files of a run, the latest first.
const FILES: [&str; 3] = ["report.json", "journal.jsonl", "effective.json"];

impl Store {
    /// Recovers the state that the last daemon left: ends of its running jobs, paused plates. Idempotent: safe to
    /// repeat after a crash at any point.
    pub(super) fn recover(&self, plates: &[String]) -> Result<RecoveryReport, StoreError> {
        self.write(|write| {
            let tx = &write.tx;
            let left = rows(tx, "SELECT job FROM jobs WHERE state = 'running' ORDER BY id", [], job_of)?;
            let mut found = RecoveryReport { clean: left.is_empty() && ended_in_order(tx)?, ..Default::default() };
            for mut row in left {
                let folder = row.folder.as_ref().map(|name| self.runs.join(name));
                // the last write to its latest file
                let written = |folder: &Path| FILES.iter().find_map(|name| modified(&folder.join(name)));
                let at = folder.as_deref().and_then(written).unwrap_or_else(|| write.at.clone());
                set_end(&mut row.job, folder.as_deref());
                let ended = self.end(write, row, at)?;
                let list = if ended.state == JobState::Interrupted { &mut found.interrupted } else { &mut found.ended };
                list.push(ended.id);
            }
            let queued = rows(tx, "SELECT job FROM jobs WHERE state = 'queued'", [], job_of)?;
            for job in &queued {
                // empty, of a claim that was never stored; one that holds a run stays
                fs::remove_dir(self.runs.join(job.run_folder())).ok();
            }
            let of_row = |row: &Row<'_>| Ok((row.get(0)?, row.get::<_, Option<Json<_>>>(1)?.map(|pause| pause.0)));
            let before: Vec<(String, Option<PauseCause>)> = rows(tx, "SELECT name, pause FROM plates", [], of_row)?;
            for plate in plates {
                let known = before.iter().find(|(name, _)| name == plate).map(|(_, pause)| pause);
                let paused = known.and_then(Option::as_ref);
                let pause = match paused {
                    _ if !found.clean => Some(PauseCause::crashed()),
                    None if queued.iter().any(|job| job.plate == *plate) => Some(PauseCause::restarted()),
                    paused => paused.cloned(),
                };
                // so that it stays paused if this daemon ends before it is resumed, and the next start knows it
                write.set_pause(plate, pause.as_ref())?;
                if pause.is_some() && paused.is_none() {
                    write.audit(&AuditEntry::of_plate(plate, AuditEntry::PAUSE, "the daemon started"))?;
                }
                found.known.extend(known.map(|_| plate.clone()));
                found.paused.extend(pause.map(|pause| (plate.clone(), pause)));
            }
            write.audit(&AuditEntry::of_daemon(AuditEntry::STARTED))?;
            Ok(found)
        })
    }
}

/// Ends a job that was running: as in its report, if the run wrote one. A run without a report did not close its
/// recording.
fn set_end(job: &mut Job, folder: Option<&Path>) {
    let report = folder.and_then(|folder| text_of(folder, "report.json"));
    let report: Option<Value> = report.and_then(|text| serde_json::from_str(&text).ok());
    let text = |at: &str| report.as_ref()?.pointer(at)?.as_str();
    let outcome = text("/outcome").and_then(Outcome::of_code);
    let is_recorded = folder.is_some_and(|folder| fs::symlink_metadata(folder.join("run.rrd")).is_ok());
    job.recording = match (outcome, text("/recording")) {
        _ if !is_recorded => RecordingStatus::None,
        (None, _) => RecordingStatus::Partial,
        (Some(_), Some(_)) => RecordingStatus::Failed,
        (Some(_), None) => RecordingStatus::Whole,
    };
    let Some(outcome) = outcome else {
        return job.set_end(JobState::Interrupted, "the daemon ended while it ran");
    };
    let state = JobState::of_end(outcome, text("/stop/code").and_then(StopCause::of_code));
    job.set_end(state, text("/reason").unwrap_or_default());
    job.report = report.as_ref().and_then(Value::as_object).cloned();
}
