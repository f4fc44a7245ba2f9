//! Report on the state that a start found left by the previous daemon: log entries and causes of pauses.

use crate::store::{JobRow, RecoveryReport, Store};
use crate::supervisor::Pause;
use upm_recording::Report;

/// Logs the state that the previous daemon left.
pub(super) fn log(recovery: &RecoveryReport) {
    let RecoveryReport { interrupted, ended, paused, moved_aside, damage, clean, orphans, .. } = recovery;
    if let Some(damage) = damage {
        let aside = moved_aside.as_deref().map(|path| format!("; it was moved to {}", path.display()));
        tracing::error!("the job store was damaged: {damage}{}", aside.unwrap_or_default());
    }
    if !clean {
        tracing::warn!(interrupted = interrupted.len(), ended = ended.len(), "the last daemon did not end in order");
    }
    if !orphans.is_empty() {
        tracing::warn!(folders = orphans.len(), "run folders that belong to no job");
    }
    for plate in paused {
        tracing::warn!(plate, "paused: nothing moves before `upm resume {plate}`");
    }
}

/// Cause of `plate`'s pause after a start: the same as before it where the end of a job had paused the plate.
pub(super) fn pause_after_start(recovery: &RecoveryReport, plate: &str) -> Pause {
    if recovery.damage.is_none()
        && recovery.clean
        && let Some(pause) = recovery.paused_after.iter().find(|job| job.plate == plate).and_then(after)
    {
        return pause;
    }
    let (code, why, remedy) = match (&recovery.damage, recovery.clean) {
        (Some(_), _) => ("store_damaged", "the job store was damaged", "look through the jobs, then resume"),
        (None, false) => ("crashed", "the daemon did not end in order", "look at the plate, then resume"),
        (None, true) => ("restarted", "jobs waited, or it was paused, when the daemon ended", "resume to go on"),
    };
    Pause::new(code, &format!("{why}: {remedy}"), remedy)
}

/// The pause that the end of `job` caused; `None` for an end that pauses no plate.
fn after(job: &JobRow) -> Option<Pause> {
    let report: Report = serde_json::from_str(job.report_json.as_deref()?).ok()?;
    report.stop.filter(|stop| stop.code.pauses_plate()).map(|stop| Pause::after(Some(&stop), &job.reason))
}

/// Logs jobs queued for plates that are no longer configured: they can be cancelled, or the plate configured again.
pub(super) fn log_unserved(store: &Store, served: Vec<String>) {
    store.queued(move |counted| {
        for (plate, jobs) in counted.unwrap_or_default() {
            if !served.contains(&plate) {
                tracing::warn!(plate, jobs, "jobs wait for a plate that is not served");
            }
        }
    });
}
