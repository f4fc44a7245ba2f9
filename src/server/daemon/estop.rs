use std::sync::Arc;

use super::convert;
use super::state::{DaemonState, no_job};
use crate::api::{EStopped, Job, Refusal, ResetRequest, Responder};
use crate::http::Caller;
use crate::store::{CancelOutcome, DeleteOutcome, JobId, JobState};
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
pub(super) fn cancel(state: &Arc<DaemonState>, id: &str, caller: &Caller, reply: Responder<Job>) {
    let Some(id) = JobId::parse(id) else { return reply.send(Err(no_job())) };
    tracing::info!(job = %id, caller = caller.name, "cancel");
    let then = Arc::clone(state);
    state.store.cancel_queued(&id, move |cancelled| {
        reply.send(match cancelled {
            Err(fault) => Err(convert::refusal(fault)),
            Ok(CancelOutcome::Unknown) => Err(no_job()),
            Ok(CancelOutcome::Now(row, finished)) => {
                if let Some(plate) = then.plates.get(&row.plate) {
                    plate.announce_end(row.id, finished);
                }
                Ok(convert::job(&row))
            }
            Ok(CancelOutcome::Not(row)) => {
                let running = row.state == JobState::Running;
                let is_stopping = running && then.plates.get(&row.plate).is_some_and(|plate| plate.cancel(&id));
                let too_late = || {
                    let ended = format!("the job has ended: {}", row.state.code());
                    Refusal::Conflict(if running { "the job has already finished".to_owned() } else { ended })
                };
                is_stopping.then(|| convert::job(&row)).ok_or_else(too_late)
            }
        });
    });
}

/// Deletes a job that does not run, and notifies its watchers that it has ended.
pub(super) fn delete(state: &Arc<DaemonState>, id: &str, caller: &Caller, reply: Responder<()>) {
    let Some(id) = JobId::parse(id) else { return reply.send(Err(no_job())) };
    tracing::info!(job = %id, caller = caller.name, "delete");
    let then = Arc::clone(state);
    state.store.delete(&id, move |deleted| {
        reply.send(match deleted {
            Err(fault) => Err(convert::refusal(fault)),
            Ok(DeleteOutcome::Unknown) => Err(no_job()),
            Ok(DeleteOutcome::Not(_)) => Err(Refusal::Conflict("the job runs: cancel it first".to_owned())),
            Ok(DeleteOutcome::Now(row, finished)) => {
                if let (Some(plate), Some(finished)) = (then.plates.get(&row.plate), finished) {
                    plate.announce_end(row.id, finished);
                }
                Ok(())
            }
        });
    });
}

/// The requester, as far as the network identifies it.
fn requester(caller: &Caller) -> supervisor::ResetRequester {
    let remote = caller.remote.map(|address| address.to_string()).unwrap_or_default();
    supervisor::ResetRequester { remote, token_name: caller.name.clone(), ..supervisor::ResetRequester::default() }
}
