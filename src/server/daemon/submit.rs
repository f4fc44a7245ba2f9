use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use parking_lot::Mutex;

use serde::de::IgnoredAny;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::convert;
use super::state::{DaemonState, no_job};
use crate::api::{Checked, Job, JobCreated, Refusal, Responder, Submission};
use crate::http::Caller;
use crate::store::{CancelOutcome, JobId, JobRow, JobState, NewJob, Pace, StoreFault, SubmitOutcome};
use crate::supervisor::PlateHandle;
use upm_core::background::WorkerPool;
use upm_core::time::{Clock, MonotonicClock};
use upm_runner::config::{Diagnostic, PlateSpec};

/// Longest time a job waits to be checked. After it the client is answered with `Retry-After`, while it still listens.
const CHECKED_WITHIN: Duration = Duration::from_secs(2);

/// `Retry-After` for a full queue, s. A guess, chosen to keep retries cheap.
const FULL_RETRY_S: u32 = 5;

/// `Retry-After` while too many jobs arrive at once, s.
const CROWDED_RETRY_S: u32 = 1;

/// A submission and when it arrived.
pub(super) struct SubmitRequest {
    order: Submission,
    at: Duration,
    clock: MonotonicClock,
}

impl SubmitRequest {
    pub fn now(order: Submission, clock: MonotonicClock) -> Self {
        Self { order, at: clock.elapsed(), clock }
    }

    /// Fingerprint that a repeated key must match: the body and the requested pace. Values that the daemon derives from
    /// either are excluded, since they may change with a restart.
    fn sha256(&self) -> [u8; 32] {
        let pace = self.order.pace.map_or("none", Pace::code);
        Sha256::new().chain_update(pace).chain_update("\n").chain_update(&self.order.text).finalize().into()
    }

    /// The members of a job by which the store recognizes a repeated key; the others are empty.
    fn by_key(&self) -> Option<NewJob> {
        let key = self.order.key.clone()?;
        Some(NewJob {
            name: String::new(),
            plate: String::new(),
            seed: 0,
            pace: Pace::default(),
            spec_json: String::new(),
            rig_fingerprint: String::new(),
            body_sha256: self.sha256(),
            key: Some(key),
        })
    }
}

/// The pending reply to a submission. Dropped unsent, it answers [`Refusal::Crowded`]; when a panic drops it, the lost
/// reply becomes [`Refusal::Busy`].
struct SubmitResponder(Arc<Mutex<Option<Responder<JobCreated>>>>);

impl SubmitResponder {
    fn new(reply: Responder<JobCreated>) -> Self {
        Self(Arc::new(Mutex::new(Some(reply))))
    }

    fn send(self, outcome: Result<JobCreated, Refusal>) {
        if let Some(reply) = self.take() {
            reply.send(outcome);
        }
    }

    fn take(&self) -> Option<Responder<JobCreated>> {
        self.0.lock().take()
    }

    /// A test of whether the client still waits for the reply.
    fn awaited(&self) -> impl Fn() -> bool + Send + 'static {
        let reply = Arc::downgrade(&self.0);
        move || {
            let is_listening =
                |reply: &Mutex<Option<Responder<_>>>| reply.lock().as_ref().is_some_and(Responder::is_listening);
            reply.upgrade().is_some_and(|reply| is_listening(&reply))
        }
    }
}

impl Drop for SubmitResponder {
    fn drop(&mut self) {
        if let Some(reply) = self.take().filter(|_| !thread::panicking()) {
            reply.send(Err(Refusal::Crowded { retry_after_s: CROWDED_RETRY_S }));
        }
    }
}

/// Queues a job and replies once it is on the disk. A repeated key gets the earlier reply, whatever now prevents a new
/// job; all others are checked by `checkers`. Never blocks.
pub(super) fn submit(
    state: &Arc<DaemonState>,
    checkers: &Arc<WorkerPool>,
    asked: SubmitRequest,
    reply: Responder<JobCreated>,
) {
    let answer = SubmitResponder::new(reply);
    let Some(by_key) = asked.by_key() else { return check(state, checkers, asked, answer) };
    let (then, checkers) = (Arc::clone(state), Arc::clone(checkers));
    state.store.repeated(by_key, move |known| match known {
        Ok(Some(known)) => answer.send(submitted(known)),
        Ok(None) => check(&then, &checkers, asked, answer),
        Err(fault) => answer.send(Err(unstored(fault))),
    });
}

fn check(state: &Arc<DaemonState>, checkers: &WorkerPool, asked: SubmitRequest, answer: SubmitResponder) {
    let state = Arc::clone(state);
    checkers.submit(move || queue(&state, &asked, answer));
}

/// Checks a job and queues it. Takes milliseconds, too long for the threads that answer requests.
fn queue(state: &Arc<DaemonState>, asked: &SubmitRequest, answer: SubmitResponder) {
    let waited = asked.clock.elapsed().saturating_sub(asked.at);
    // a client that was already answered with an error may send the job again
    if !answer.awaited()() {
        return;
    }
    if state.ending.load(Ordering::SeqCst) {
        return answer.send(Err(Refusal::Busy { why: "the daemon ends".to_owned(), retry_after_s: 1 }));
    }
    if waited > CHECKED_WITHIN {
        return answer.send(Err(Refusal::Crowded { retry_after_s: CROWDED_RETRY_S }));
    }
    let checked = state.plate_of(&asked.order.text).and_then(|plate| {
        let job = state.checked(plate, asked)?;
        state.rejection(plate).map_or(Ok(job), Err)
    });
    let job = match checked {
        Ok(job) => job,
        Err(refusal) => return answer.send(Err(refusal)),
    };
    let (then, awaited, has_key) = (Arc::clone(state), answer.awaited(), job.key.is_some());
    state.store.accept_if(job, answer.awaited(), move |accepted| match accepted {
        Ok(Some(SubmitOutcome::New(row))) if !has_key && !awaited() => take_back(&then, row),
        Ok(Some(accepted)) => {
            if let SubmitOutcome::New(row) = &accepted
                && let Some(plate) = then.plates.get(&row.plate)
            {
                plate.job_queued();
            }
            answer.send(submitted(accepted));
        }
        // the client no longer waits
        Ok(None) => {}
        Err(fault) => answer.send(Err(unstored(fault))),
    });
}

/// Moves a queued job to the front of its plate's queue.
pub(super) fn run_next(state: &DaemonState, id: &str, caller: &Caller, reply: Responder<Job>) {
    let Some(id) = JobId::parse(id) else { return reply.send(Err(no_job())) };
    tracing::info!(job = %id, caller = caller.name, "run next");
    state.store.move_to_front(&id, move |moved| {
        reply.send(match moved {
            Err(fault) => Err(convert::refusal(fault)),
            Ok(None) => Err(no_job()),
            Ok(Some(row)) if row.state == JobState::Queued => Ok(convert::job(&row)),
            Ok(Some(row)) => {
                Err(Refusal::Conflict(format!("the job does not wait for its plate: {}", row.state.code())))
            }
        });
    });
}

/// Takes a job out of the queue whose client was answered with an error while the job was being stored: it may send the
/// job again. A job with an idempotency key stays, since sending it again yields the same job. Does not wake the plate.
fn take_back(state: &Arc<DaemonState>, row: JobRow) {
    tracing::warn!(job = %row.id, plate = row.plate, "withdrawn: its client disconnected before it was stored");
    let then = Arc::clone(state);
    state.store.cancel_queued(&row.id, move |cancelled| match cancelled {
        Ok(CancelOutcome::Now(row, finished)) => {
            if let Some(plate) = then.plates.get(&row.plate) {
                plate.announce_end(row.id, finished);
            }
        }
        Ok(CancelOutcome::Not(row)) => {
            let is_stopping = then.plates.get(&row.plate).is_some_and(|plate| plate.cancel(&row.id));
            tracing::warn!(job = %row.id, is_stopping, "the withdrawn job was on its plate already");
        }
        Ok(CancelOutcome::Unknown) => {}
        Err(fault) => tracing::error!(job = %row.id, "not withdrawn: {fault}"),
    });
}

/// The refusal of a submission for a fault of the store.
fn unstored(fault: StoreFault) -> Refusal {
    match fault {
        StoreFault::Busy => Refusal::Crowded { retry_after_s: CROWDED_RETRY_S },
        fault => convert::refusal(fault),
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

    fn checked(&self, plate: &PlateHandle, asked: &SubmitRequest) -> Result<NewJob, Refusal> {
        let order = &asked.order;
        let pace = order.pace.unwrap_or(self.spec.pace);
        let job = plate.validate(&order.text, pace, order.key.clone());
        let job = job.map_err(|faults| faulty(&order.text, faults))?;
        Ok(NewJob { body_sha256: asked.sha256(), ..job })
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
        let free = self.store.health().free_bytes.filter(|free| *free < self.spec.min_free_bytes)?;
        Some(Refusal::DiskFull(format!(
            "{:.1} MB are free on the disk, {:.1} are needed (`disk.min_free_mb`)",
            free as f64 * 1e-6,
            self.spec.min_free_bytes as f64 * 1e-6
        )))
    }
}

#[cfg(test)]
mod tests {
    use std::task::{Context, Poll, Waker};

    use super::*;
    use crate::api::pending;
    use crate::http::Caller;

    #[test]
    fn dropped_submission_is_answered_with_retry() {
        let first_poll = |start: fn(Responder<JobCreated>)| {
            let mut pending = pending(start);
            pending.as_mut().poll(&mut Context::from_waker(Waker::noop()))
        };
        let crowded = Poll::Ready(Err(Refusal::Crowded { retry_after_s: CROWDED_RETRY_S }));
        assert_eq!(first_poll(|reply| drop(SubmitResponder::new(reply))), crowded);
        assert_eq!(first_poll(|reply| SubmitResponder::new(reply).send(Err(unstored(StoreFault::Busy)))), crowded);
        let once = first_poll(|reply| SubmitResponder::new(reply).send(Err(Refusal::KeyReused)));
        assert_eq!(once, Poll::Ready(Err(Refusal::KeyReused)));
    }

    #[test]
    fn idempotency_key_is_bound_to_text_and_pace() {
        let sha256 = |text: &str, pace| {
            let caller = Caller { name: "test".to_owned(), remote: None };
            let order = Submission { text: text.to_owned(), pace, key: Some("k".to_owned()), caller };
            SubmitRequest::now(order, MonotonicClock::new()).by_key().map(|job| job.body_sha256)
        };
        let asked = [("{}", None), ("{}", Some(Pace::RealTime)), ("{}", Some(Pace::Max)), ("{} ", None)];
        let different: std::collections::BTreeSet<_> = asked.map(|(text, pace)| sha256(text, pace)).into();
        assert_eq!(different.len(), asked.len());
        assert_eq!(sha256("{}", None), sha256("{}", None));
    }
}
