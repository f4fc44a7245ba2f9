use std::io;
use std::sync::Arc;

use super::state::{DaemonState, no_job};
use super::{convert, estop, files, health, metrics, submit};
use crate::api::{
    Backend, CameraPicture, Checked, EStopped, EventSender, Job, JobCreated, JobsPage, JobsQuery, LayoutView, Pending,
    Plate, Recording, ReplayPage, ResetRequest, Responder, StreamStart, Submission, pending, ready,
};
use crate::http::{Caller, Reason};
use crate::store::{JobId, JobRow, JobSelection};
use upm_core::background::WorkerPool;

/// Threads that check jobs, and the jobs that may wait for them: one for every connection that is allowed.
const CHECKERS: usize = 2;
const CHECKS_WAITING: usize = 512;
/// Threads that confirm emergency stops already made, and the number of confirmations that may wait for them.
const STOP_THREADS: usize = 2;
const STOPS_WAITING: usize = 256;
/// Resets that may wait: each is stored in the audit log before it takes effect.
const RESETS_WAITING: usize = 16;

/// Threads that open files, which a hung disk blocks, and the requests that may wait for them.
const FILE_OPENERS: usize = 2;
const FILES_WAITING: usize = 64;

/// The API's [`Backend`], backed by store and plates.
#[derive(Debug)]
pub(super) struct DaemonBackend {
    pub state: Arc<DaemonState>,
    checkers: Arc<WorkerPool>,
    stops: WorkerPool,
    resets: WorkerPool,
    files: Arc<WorkerPool>,
}

impl DaemonBackend {
    /// Opens the backend in front of store and plates and starts its threads.
    pub fn open(state: DaemonState) -> io::Result<Self> {
        let state = Arc::new(state);
        let checkers = Arc::new(WorkerPool::start("check", CHECKERS, CHECKS_WAITING, true)?);
        let stops = WorkerPool::start("stops", STOP_THREADS, STOPS_WAITING, false)?;
        let resets = WorkerPool::start("resets", 1, RESETS_WAITING, true)?;
        let files = Arc::new(WorkerPool::start("files", FILE_OPENERS, FILES_WAITING, true)?);
        Ok(Self { state, checkers, stops, resets, files })
    }

    /// Looks up the job of that id and passes it to `then` with the reply to fulfil.
    fn with_job<T: Send + 'static>(
        &self,
        id: &str,
        reply: Responder<T>,
        then: impl FnOnce(&Arc<DaemonState>, JobRow, Responder<T>) + Send + 'static,
    ) {
        let Some(id) = JobId::parse(id) else { return reply.send(Err(no_job())) };
        let state = Arc::clone(&self.state);
        self.state.store.job(&id, move |found| match found {
            Ok(Some(row)) => then(&state, row, reply),
            Ok(None) => reply.send(Err(no_job())),
            Err(fault) => reply.send(Err(convert::unread(fault))),
        });
    }
}

impl Backend for DaemonBackend {
    fn submit(&self, submission: Submission) -> Pending<JobCreated> {
        pending(|reply| {
            let asked = submit::SubmitRequest::now(submission, self.state.clock);
            submit::submit(&self.state, &self.checkers, asked, reply);
        })
    }

    fn check(&self, text: String) -> Pending<Checked> {
        pending(|reply| {
            let state = Arc::clone(&self.state);
            self.checkers.submit(move || {
                if reply.is_listening() {
                    reply.send(state.examined(&text));
                }
            });
        })
    }

    fn job(&self, id: &str) -> Pending<Job> {
        pending(|reply| self.with_job(id, reply, |_, row, reply| reply.send(Ok(convert::job(&row)))))
    }

    fn jobs(&self, query: JobsQuery) -> Pending<JobsPage> {
        let cursor = match query.cursor.as_deref().map(JobId::parse) {
            Some(None) => return ready(Err(no_job())),
            cursor => cursor.flatten(),
        };
        let page = JobSelection { state: query.state, limit: query.limit, cursor };
        pending(|reply| {
            self.state.store.list(page, move |listed| {
                let page = listed.map_err(convert::unread).map(|page| JobsPage {
                    jobs: page.rows.iter().map(convert::job).collect(),
                    next: page.next.map(|id| id.to_string()),
                });
                reply.send(page);
            });
        })
    }

    fn run_next(&self, id: &str, caller: Caller) -> Pending<Job> {
        pending(|reply| submit::run_next(&self.state, id, &caller, reply))
    }

    fn cancel(&self, id: &str, caller: Caller) -> Pending<Job> {
        pending(|reply| estop::cancel(&self.state, id, &caller, reply))
    }

    fn delete(&self, id: &str, caller: Caller) -> Pending<()> {
        pending(|reply| estop::delete(&self.state, id, &caller, reply))
    }

    fn plates(&self) -> Pending<crate::api::Plates> {
        pending(|reply| {
            self.state.count_queued(move |state| reply.send(Ok(state.plate_statuses())));
        })
    }

    fn plates_as_counted(&self) -> crate::api::Plates {
        self.state.plate_statuses()
    }

    fn estop(&self, plate: &str, caller: Caller) -> Pending<EStopped> {
        match self.state.plate(plate) {
            Ok(plate) => plate.estop(),
            Err(refusal) => return ready(Err(refusal)),
        };
        let (state, name) = (Arc::clone(&self.state), plate.to_owned());
        pending(|reply| self.stops.submit(move || reply.send(estop::confirm_stop(&state, &name, &caller))))
    }

    fn reset(&self, plate: &str, request: ResetRequest, caller: Caller) -> Pending<Plate> {
        // determined before the reset waits its turn: a stop that comes in between is a different one
        let held = match self.state.plate(plate).and_then(estop::held) {
            Ok(held) => held,
            Err(refusal) => return ready(Err(refusal)),
        };
        let (state, plate) = (Arc::clone(&self.state), plate.to_owned());
        pending(|reply| {
            self.resets.submit(move || {
                // a client that gave up finds the plate stopped, and the audit log has no entry for the reset
                if !reply.is_listening() {
                    return;
                }
                let is_listening = || reply.is_listening();
                match state.plate(&plate).and_then(|at| estop::reset(at, held, request, &caller, is_listening)) {
                    Ok(()) => state.answer_with(&plate, reply),
                    Err(refusal) => reply.send(Err(refusal)),
                }
            });
        })
    }

    fn resume(&self, plate: &str, caller: Caller) -> Pending<Plate> {
        let done = self.state.plate(plate).and_then(|at| estop::resume(at, &caller));
        match done {
            Ok(()) => pending(|reply| self.state.answer_with(plate, reply)),
            Err(refusal) => ready(Err(refusal)),
        }
    }

    fn liveness_failures(&self) -> Vec<Reason> {
        health::liveness_failures(&self.state.observed())
    }

    fn readiness_failures(&self) -> Vec<Reason> {
        health::readiness_failures(&self.state.observed())
    }

    fn metrics(&self) -> String {
        metrics::text(&self.state.observed())
    }

    fn watch(&self, id: &str, sender: EventSender) -> Pending<StreamStart> {
        pending(|reply| {
            self.with_job(id, reply, move |state, row, reply| {
                if let Some(relay) = state.relays.get(&row.plate) {
                    relay.forward(row.id, sender);
                }
                // read again once the relay is connected: events published between the first read and that are in the
                // store by now
                let again = Arc::clone(state);
                state.store.job(&row.id, move |found| {
                    let row = found.map_err(convert::unread).and_then(|found| found.ok_or_else(no_job));
                    reply.send(row.map(|row| again.stream_start(&row)));
                });
            });
        })
    }

    fn replay(&self, id: &str, after: u64, most: usize) -> Pending<ReplayPage> {
        let Some(id) = JobId::parse(id) else { return ready(Err(no_job())) };
        pending(|reply| {
            self.state.store.replay(&id, after, most, move |found| {
                let found = found.map_err(convert::unread).and_then(|found| found.ok_or_else(no_job));
                reply.send(found.map(|replay| ReplayPage {
                    oldest: replay.oldest,
                    events: replay.events.iter().map(convert::event).collect(),
                }));
            });
        })
    }

    fn frame(&self, id: &str) -> Pending<CameraPicture> {
        pending(|reply| {
            self.with_job(id, reply, |state, row, reply| reply.send(files::picture(&state.plates, &row)));
        })
    }

    fn layout(&self, id: &str) -> Pending<LayoutView> {
        pending(|reply| {
            self.with_job(id, reply, |state, row, reply| reply.send(files::layout(&state.plates, &row)));
        })
    }

    fn recording(&self, id: &str) -> Pending<Recording> {
        pending(|reply| {
            let files = Arc::clone(&self.files);
            self.with_job(id, reply, move |state, row, reply| {
                let state = Arc::clone(state);
                files.submit(move || reply.send(files::recording(state.store.runs(), &row)));
            });
        })
    }
}
