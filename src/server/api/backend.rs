use std::fs::File;
use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

use bytes::Bytes;
use tokio::sync::oneshot;

use super::layout::{Checked, LayoutView};
use super::types::{EStopped, Job, JobsPage, JobsQuery, Plate, Plates, ResetRequest};
use crate::http::{Caller, Problem, ProblemKind, Reason};
use upm_core::job::Pace;
use upm_runner::config::Diagnostic;

/// The future of an answer or refusal.
pub type Pending<T> = Pin<Box<dyn Future<Output = Result<T, Refusal>> + Send>>;

/// The daemon behind the API. The methods return at once; slow work runs on the threads of store and plates and fulfils
/// the promise, see [`pending`]. A promise may be dropped before that, when the client disconnects or the answer takes
/// too long.
///
/// Ids and names of plates are any text that a client sent.
pub trait Backend: Send + Sync {
    /// Checks a job and queues it. The promise is fulfilled once the job is on the disk.
    fn submit(&self, submission: Submission) -> Pending<JobCreated>;

    /// Checks the text of a job as for queueing. Queues nothing.
    fn check(&self, text: String) -> Pending<Checked>;

    /// The job with that id.
    fn job(&self, id: &str) -> Pending<Job>;

    /// A page of jobs, newest first.
    fn jobs(&self, query: JobsQuery) -> Pending<JobsPage>;

    /// Moves a queued job to the front of its plate's queue.
    fn run_next(&self, id: &str, caller: Caller) -> Pending<Job>;

    /// Takes a job out of the queue, or has its plate end it.
    fn cancel(&self, id: &str, caller: Caller) -> Pending<Job>;

    /// Deletes a job that does not run, with its run folder.
    fn delete(&self, id: &str, caller: Caller) -> Pending<()>;

    /// All plates, with their queues counted now. The promise may wait for the store.
    fn plates(&self) -> Pending<Plates>;

    /// All plates, with their queues as last counted. Never waits.
    fn plates_as_counted(&self) -> Plates;

    /// Emergency stop. The motors have been cut before this returns; the promise only waits for the confirmation.
    fn estop(&self, plate: &str, caller: Caller) -> Pending<EStopped>;

    /// Ends an emergency stop; the plate stays paused.
    fn reset(&self, plate: &str, request: ResetRequest, caller: Caller) -> Pending<Plate>;

    /// Lets a paused plate go on with its queue.
    fn resume(&self, plate: &str, caller: Caller) -> Pending<Plate>;

    /// Reasons why the daemon does not work at all; empty when it is healthy.
    fn liveness_failures(&self) -> Vec<Reason>;

    /// Reasons why it takes no jobs; empty when it is ready.
    fn readiness_failures(&self) -> Vec<Reason>;

    /// Its metrics, as OpenMetrics text.
    fn metrics(&self) -> String;

    /// The journal of the job, opened for reading; `None` until there is one, and once its run folder is deleted.
    fn journal(&self, id: &str) -> Pending<Option<File>>;

    /// The newest picture of the job; [`Refusal::Busy`] while no recent one is ready.
    fn frame(&self, id: &str) -> Pending<CameraPicture>;

    /// The layout of the job, while it is on its plate; [`Refusal::Busy`] while its text is being read.
    fn layout(&self, id: &str) -> Pending<LayoutView>;

    /// The job's recording, opened for reading.
    fn recording(&self, id: &str) -> Pending<Recording>;
}

/// A submitted job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Submission {
    /// Body of the request.
    pub text: String,
    /// Requested pace; `None` for that of the daemon's configuration.
    pub pace: Option<Pace>,
    /// Idempotency key.
    pub key: Option<String>,
    /// Sender of the request.
    pub caller: Caller,
}

/// Outcome of a submission.
#[derive(Clone, Debug, PartialEq)]
pub struct JobCreated {
    /// The queued job.
    pub job: Job,
    /// True when an earlier request with the same key had queued it.
    pub replayed: bool,
}

/// A picture of a job on its plate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraPicture {
    /// The PNG file.
    pub png: Bytes,
    /// Wall time since it was taken.
    pub age: Duration,
}

/// An open recording.
#[derive(Debug)]
pub struct Recording {
    /// The open file.
    pub file: File,
    /// Its size, bytes.
    pub bytes: u64,
    /// File name under which browsers save it.
    pub name: String,
}

/// Why the daemon does not do what a request asks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// No such job, plate, picture or recording: 404.
    Unknown(String),
    /// The body is not JSON: 400.
    Malformed(Vec<Diagnostic>),
    /// The body is not a valid job: 422.
    Invalid(Vec<Diagnostic>),
    /// The idempotency key was already used with another body, or for a job that was deleted: 422.
    KeyReused,
    /// The state of the plate or the job does not allow it: 409.
    Conflict(String),
    /// The plate's queue is full: 429.
    QueueFull {
        /// Number of jobs in it.
        queued: usize,
        /// Seconds after which to try again.
        retry_after_s: u32,
    },
    /// Temporarily unavailable: 503.
    Busy {
        /// The reason, as a sentence.
        why: String,
        /// Seconds after which to try again.
        retry_after_s: u32,
    },
    /// The disk is full: 507.
    DiskFull(String),
    /// A fault of the daemon itself: 500.
    Broken(String),
}

impl From<Refusal> for Problem {
    fn from(refusal: Refusal) -> Self {
        match refusal {
            Refusal::Unknown(what) => Self::new(ProblemKind::NotFound, what),
            Refusal::Malformed(faults) => Problem::of_faults(ProblemKind::Malformed, faults),
            Refusal::Invalid(faults) => Problem::of_faults(ProblemKind::Invalid, faults),
            Refusal::KeyReused => Self::new(
                ProblemKind::Invalid,
                "this Idempotency-Key was already used, with a different body or for a job since deleted",
            ),
            Refusal::Conflict(why) => Self::new(ProblemKind::Conflict, why),
            Refusal::QueueFull { queued, retry_after_s } => {
                Self::new(ProblemKind::QueueFull, format!("{queued} jobs wait for this plate"))
                    .retry_after(retry_after_s)
            }
            Refusal::Busy { why, retry_after_s } => Self::new(ProblemKind::Unavailable, why).retry_after(retry_after_s),
            Refusal::DiskFull(what) => Self::new(ProblemKind::InsufficientStorage, what),
            Refusal::Broken(what) => Self::new(ProblemKind::Internal, what),
        }
    }
}

/// The sending end of a promise: fulfils it, from any thread, without waiting.
#[derive(Debug)]
pub struct Responder<T>(oneshot::Sender<Result<T, Refusal>>);

impl<T> Responder<T> {
    /// Sends the outcome. It is dropped silently when the caller no longer waits.
    pub fn send(self, outcome: Result<T, Refusal>) {
        let _ = self.0.send(outcome);
    }

    /// True while the caller waits.
    pub fn is_listening(&self) -> bool {
        !self.0.is_closed()
    }
}

/// A promise whose [`Responder`] `start` passes to the thread that will fulfil it. A lost reply becomes
/// [`Refusal::Busy`].
pub fn pending<T: Send + 'static>(start: impl FnOnce(Responder<T>)) -> Pending<T> {
    let (sender, receiver) = oneshot::channel();
    start(Responder(sender));
    Box::pin(async move {
        let lost = || Err(Refusal::Busy { why: "the daemon is busy, or ends".to_owned(), retry_after_s: 1 });
        receiver.await.unwrap_or_else(|_| lost())
    })
}

/// A promise that is already fulfilled.
pub fn ready<T: Send + 'static>(outcome: Result<T, Refusal>) -> Pending<T> {
    Box::pin(async move { outcome })
}
