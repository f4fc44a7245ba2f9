use std::sync::atomic::Ordering;

use serde::de::IgnoredAny;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::convert;
use super::state::{DaemonState, no_job};
use crate::api::{Checked, Job, JobCreated, Refusal, Submission};
use crate::http::Caller;
use crate::store::{JobId, JobState, NewJob, Pace, SubmitOutcome};
use crate::supervisor::PlateHandle;
use upm_core::files::free_bytes;
use upm_runner::config::{Diagnostic, PlateSpec};

/// `Retry-After` for a full queue, s. A guess, chosen to keep retries cheap.
const FULL_RETRY_S: u32 = 5;

/// Checks a job and queues it: it is on the disk when this returns. A repeated key gets the earlier reply, whatever now
/// prevents a new job. A job is not stored when its client no longer waits, since that may send it again. Takes
/// milliseconds and waits for the disk.
pub(super) fn submit(
    state: &DaemonState,
    submission: &Submission,
    is_awaited: &dyn Fn() -> bool,
) -> Result<JobCreated, Refusal> {
    let body_sha256 = sha256(submission);
    if let Some(key) = &submission.key
        && let Some(known) = state.store.repeated(key, &body_sha256).map_err(convert::unread)?
    {
        return submitted(known);
    }
    if state.ending.load(Ordering::SeqCst) {
        return Err(Refusal::Busy { why: "the daemon ends".to_owned(), retry_after_s: 1 });
    }
    let plate = state.plate_of(&submission.text)?;
    let pace = submission.pace.unwrap_or(state.spec.pace);
    let job = plate.validate(&submission.text, pace, submission.key.clone());
    let job = NewJob { body_sha256, ..job.map_err(|faults| faulty(&submission.text, faults))? };
    if let Some(refusal) = state.rejection(plate) {
        return Err(refusal);
    }
    let unheard = || Refusal::Busy { why: "its client no longer waits".to_owned(), retry_after_s: 1 };
    let accepted = state.store.accept(&job, is_awaited).map_err(convert::refusal)?.ok_or_else(unheard)?;
    if matches!(accepted, SubmitOutcome::New(_)) {
        plate.job_queued();
    }
    submitted(accepted)
}

/// Fingerprint that a repeated key must match: the body and the requested pace. Values that the daemon derives from
/// either are excluded, since they may change with a restart.
fn sha256(submission: &Submission) -> [u8; 32] {
    let pace = submission.pace.map_or("none", Pace::code);
    Sha256::new().chain_update(pace).chain_update("\n").chain_update(&submission.text).finalize().into()
}

/// Moves a queued job to the front of its plate's queue.
pub(super) fn run_next(state: &DaemonState, id: &JobId, caller: &Caller) -> Result<Job, Refusal> {
    tracing::info!(job = %id, caller = caller.name, "run next");
    let row = state.store.move_to_front(id).map_err(convert::refusal)?.ok_or_else(no_job)?;
    match row.state {
        JobState::Queued => Ok(convert::job(&row)),
        other => Err(Refusal::Conflict(format!("the job does not wait for its plate: {}", other.code()))),
    }
}

fn submitted(accepted: SubmitOutcome) -> Result<JobCreated, Refusal> {
    match accepted {
        SubmitOutcome::New(row) => Ok(JobCreated { job: convert::job(&row), replayed: false }),
        SubmitOutcome::Replayed(row) => Ok(JobCreated { job: convert::job(&row), replayed: true }),
        SubmitOutcome::KeyReused => Err(Refusal::KeyReused),
        SubmitOutcome::QueueFull { queued } => Err(Refusal::QueueFull { queued, retry_after_s: FULL_RETRY_S }),
    }
}

/// The refusal of a job's text with its faults.
fn faulty(text: &str, faults: Vec<Diagnostic>) -> Refusal {
    let is_json = serde_json::from_str::<IgnoredAny>(text).is_ok();
    if is_json { Refusal::Invalid(faults) } else { Refusal::Malformed(faults) }
}

impl DaemonState {
    /// The plate that a job names. A job that names none goes to the default plate, or, when it brings a rig, to one
    /// with a rig of that name. Text that is not JSON goes to any plate, whose check then reports the faults.
    fn plate_of(&self, text: &str) -> Result<&PlateHandle, Refusal> {
        let Ok(job) = serde_json::from_str::<Value>(text) else {
            return self.plates.iter().next().ok_or_else(|| self.unaddressed("nothing"));
        };
        if let Some(name) = job.get("plate").and_then(Value::as_str) {
            return self.plates.get(name).ok_or_else(|| self.unaddressed(&format!("{name:?}")));
        }
        let default = self.spec.default_plate.as_deref();
        let rig = job.get("rig").and_then(|rig| rig.get("name")).and_then(Value::as_str);
        let has_rig = |plate: &&PlateSpec| rig.is_none_or(|rig| plate.rig.model.name == rig);
        let of_rig = || self.spec.plates.iter().find(|plate| rig.is_some() && has_rig(plate));
        let fitting = default.and_then(|name| self.spec.plate(name)).filter(has_rig).or_else(of_rig);
        let name = fitting.map(|plate| plate.name.as_str()).or(default);
        name.and_then(|name| self.plates.get(name)).ok_or_else(|| self.unaddressed("nothing"))
    }

    fn unaddressed(&self, found: &str) -> Refusal {
        let allowed = format!("one of {}", self.spec.plate_names().join(", "));
        let (file, path) = ("job".to_owned(), "plate".to_owned());
        Refusal::Invalid(vec![Diagnostic::new(&file, path, found, allowed)])
    }

    /// Checks a job as for queueing, regardless of the state of its plate. Takes milliseconds.
    pub(super) fn examined(&self, text: &str) -> Result<Checked, Refusal> {
        let plate = self.plate_of(text)?;
        let (name, layout) = plate.check(text).map_err(|faults| faulty(text, faults))?;
        Ok(Checked { name, plate: plate.name().to_owned(), layout: convert::layout(&layout) })
    }

    /// The reason why `plate` takes no jobs; `None` when it does.
    fn rejection(&self, plate: &PlateHandle) -> Option<Refusal> {
        if plate.is_stopped() {
            let why = format!("plate {} is stopped by an emergency stop: it must be reset first", plate.name());
            return Some(Refusal::Conflict(why));
        }
        let free = free_bytes(self.store.runs()).ok().filter(|free| *free < self.spec.min_free_bytes)?;
        Some(Refusal::DiskFull(format!(
            "{:.1} MB are free on the disk, {:.1} are needed (`disk.min_free_mb`)",
            free as f64 * 1e-6,
            self.spec.min_free_bytes as f64 * 1e-6
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn idempotency_key_is_bound_to_text_and_pace() {
        let sha256 = |text: &str, pace| {
            let caller = Caller { name: "test".to_owned(), remote: None };
            sha256(&Submission { text: text.to_owned(), pace, key: Some("k".to_owned()), caller })
        };
        let asked = [("{}", None), ("{}", Some(Pace::RealTime)), ("{}", Some(Pace::Max)), ("{} ", None)];
        let different: std::collections::BTreeSet<_> = asked.map(|(text, pace)| sha256(text, pace)).into();
        assert_eq!(different.len(), asked.len());
        assert_eq!(sha256("{}", None), sha256("{}", None));
    }
}
