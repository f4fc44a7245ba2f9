//! Report on the state that a start found left by the previous daemon: log entries and causes of pauses.

use serde_json::Value;

use crate::states::PauseCause;
use crate::store::{JobRow, JobState, RecoveryReport, Store};
use upm_recording::Report;

/// Logs the state that the previous daemon left.
pub(super) fn log(recovery: &RecoveryReport) {
    let RecoveryReport { interrupted, ended, paused, clean, .. } = recovery;
    if !clean {
        tracing::warn!(interrupted = interrupted.len(), ended = ended.len(), "the last daemon did not end in order");
    }
    for plate in paused {
        tracing::warn!(plate, "paused: nothing moves before `upm resume {plate}`");
    }
}

/// Cause of `plate`'s pause after a start: the same as before it where the end of a job had paused the plate.
pub(super) fn pause_after_start(recovery: &RecoveryReport, plate: &str) -> PauseCause {
    if recovery.clean
        && let Some(pause) = recovery.paused_after.iter().find(|job| job.plate == plate).and_then(after)
    {
        return pause;
    }
    let (code, why, remedy) = if recovery.clean {
        ("restarted", "jobs waited, or it was paused, when the daemon ended", "resume to go on")
    } else {
        ("crashed", "the daemon did not end in order", "look at the plate, then resume")
    };
    PauseCause::new(code, &format!("{why}: {remedy}"), remedy)
}

/// The pause that the end of `job` caused; `None` for an end that pauses no plate.
fn after(job: &JobRow) -> Option<PauseCause> {
    let report: Report = serde_json::from_value(Value::Object(job.report.clone()?)).ok()?;
    report.stop.filter(|stop| stop.code.pauses_plate()).map(|stop| PauseCause::after(Some(&stop), &job.reason))
}

/// Logs jobs queued for plates that are no longer configured: they can be cancelled, or the plate configured again.
pub(super) fn log_unserved(store: &Store, served: &[String]) {
    for (plate, state, jobs) in store.counts().unwrap_or_default() {
        if state == JobState::Queued && !served.contains(&plate) {
            tracing::warn!(plate, jobs, "jobs wait for a plate that is not served");
        }
    }
}
