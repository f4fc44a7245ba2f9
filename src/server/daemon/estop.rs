use super::convert;
use super::state::{DaemonState, no_job};
use crate::api::{EStopped, Job, Refusal, ResetRequest};
use crate::http::Caller;
use crate::store::{AuditEntry, CancelOutcome, DeleteOutcome, JobId, JobState};
use crate::supervisor::{self, PlateHandle, ResetFault, StopToken};

/// Stores an emergency stop already made in the audit log and reports its result.
pub(super) fn confirm_stop(state: &DaemonState, name: &str, caller: &Caller) -> Result<EStopped, Refusal> {
    let plate = state.plate(name)?;
    plate.wait_until_motors_off();
    let persisted = plate.record_estop(requester(caller));
    let times = plate.stop_times();
    Ok(EStopped {
        plate: name.to_owned(),
        silent: times.is_some(),
        persisted,
        requested_at_s: times.map(|times| times.requested_at.secs()),
        silent_at_s: times.map(|times| times.motors_off_at.secs()),
        wall_s: times.map(|times| times.wall.as_secs_f64()),
    })
}

/// The emergency stop that a reset requested now would end.
pub(super) fn held(plate: &PlateHandle) -> Result<StopToken, Refusal> {
    plate.held().map_err(refusal)
}

/// Ends that emergency stop, unless its client no longer waits. Waits for the disk.
pub(super) fn reset(
    plate: &PlateHandle,
    held: StopToken,
    request: ResetRequest,
    caller: &Caller,
    is_listening: impl Fn() -> bool,
) -> Result<(), Refusal> {
    let ResetRequest { operator, reason } = request;
    plate
        .reset(held, supervisor::ResetRequester { operator, reason, ..requester(caller) }, is_listening)
        .map_err(refusal)
}

fn refusal(fault: ResetFault) -> Refusal {
    match fault {
        ResetFault::NotPersisted(fault) => convert::refusal(fault),
        fault => Refusal::Conflict(fault.to_string()),
    }
}

/// Resumes a plate.
pub(super) fn resume(plate: &PlateHandle, caller: &Caller) -> Result<(), Refusal> {
    let stopped = || Refusal::Conflict("an emergency stop holds: it must be reset first".to_owned());
    plate.resume(requester(caller)).then_some(()).ok_or_else(stopped)
}

/// Takes a job out of the queue, or has its plate end it.
pub(super) fn cancel(state: &DaemonState, id: &JobId, caller: &Caller) -> Result<Job, Refusal> {
    tracing::info!(job = %id, caller = caller.name, "cancel");
    match state.store.cancel_queued(id).map_err(convert::refusal)? {
        CancelOutcome::Unknown => Err(no_job()),
        CancelOutcome::Now(row) => Ok(state.job(&row)),
        CancelOutcome::Not(row) if row.state == JobState::Running => {
            let is_stopping = state.plates.get(&row.plate).is_some_and(|plate| plate.cancel(id));
            let too_late = || Refusal::Conflict("the job has already finished".to_owned());
            is_stopping.then(|| state.job(&row)).ok_or_else(too_late)
        }
        CancelOutcome::Not(row) => Err(Refusal::Conflict(format!("the job has ended: {}", row.state.code()))),
    }
}

/// Deletes a job that does not run.
pub(super) fn delete(state: &DaemonState, id: &JobId, caller: &Caller) -> Result<(), Refusal> {
    tracing::info!(job = %id, caller = caller.name, "delete");
    let supervisor::ResetRequester { remote, token_name, .. } = requester(caller);
    let entry = AuditEntry { act: AuditEntry::DELETE.to_owned(), remote, token_name, ..AuditEntry::default() };
    match state.store.delete(id, entry).map_err(convert::refusal)? {
        DeleteOutcome::Now => Ok(()),
        DeleteOutcome::Not => Err(Refusal::Conflict("the job runs: cancel it first".to_owned())),
        DeleteOutcome::Unknown => Err(no_job()),
    }
}

/// The requester, as far as the network identifies it.
fn requester(caller: &Caller) -> supervisor::ResetRequester {
    let remote = caller.remote.map(|address| address.to_string()).unwrap_or_default();
    supervisor::ResetRequester { remote, token_name: caller.name.clone(), ..supervisor::ResetRequester::default() }
}
