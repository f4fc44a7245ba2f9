use std::fs::File;
use std::io;
use std::sync::Arc;

use super::state::{DaemonState, job_id, no_job};
use super::{convert, estop, files, health, metrics, submit};
use crate::api::{
    Backend, CameraPicture, Checked, EStopped, Job, JobCreated, JobsPage, JobsQuery, LayoutView, Pending, Plate,
    Recording, Refusal, ResetRequest, Submission, pending, ready,
};
use crate::http::{Caller, Reason};
use crate::store::{JobId, JobSelection};
use upm_core::background::WorkerPool;

/// Threads that check jobs, threads for all else that waits for the disk, and threads that confirm emergency stops
/// already made, each with the most requests that may wait for them: one for every connection that is allowed.
const CHECKERS: usize = 2;
const WORKERS: usize = 4;
const STOP_THREADS: usize = 2;
const WAITING: usize = 512;

/// The API's [`Backend`], backed by store and plates.
#[derive(Debug)]
pub(super) struct DaemonBackend {
    pub state: Arc<DaemonState>,
    checkers: WorkerPool,
    workers: WorkerPool,
    stops: WorkerPool,
}

impl DaemonBackend {
    /// Opens the backend in front of store and plates and starts its threads.
    pub fn open(state: DaemonState) -> io::Result<Self> {
        let checkers = WorkerPool::start("check", CHECKERS, WAITING, true)?;
        let workers = WorkerPool::start("store", WORKERS, WAITING, true)?;
        let stops = WorkerPool::start("stops", STOP_THREADS, WAITING, false)?;
        Ok(Self { state: Arc::new(state), checkers, workers, stops })
    }

    /// The answer of `work` on a thread of `pool`. The work gets a test of whether the client still waits, and is left
    /// out when it does not.
    fn on<T: Send + 'static>(
        &self,
        pool: &WorkerPool,
        work: impl FnOnce(&DaemonState, &dyn Fn() -> bool) -> Result<T, Refusal> + Send + 'static,
    ) -> Pending<T> {
        let state = Arc::clone(&self.state);
        pending(|reply| {
            pool.submit(move || {
                if reply.is_listening() {
                    let answer = work(&state, &|| reply.is_listening());
                    reply.send(answer);
                }
            });
        })
    }

    /// The answer of `work` on the job of that id.
    fn on_job<T: Send + 'static>(
        &self,
        id: &str,
        work: impl FnOnce(&DaemonState, &JobId) -> Result<T, Refusal> + Send + 'static,
    ) -> Pending<T> {
        match job_id(id) {
            Ok(id) => self.on(&self.workers, move |state, _| work(state, &id)),
            Err(refusal) => ready(Err(refusal)),
        }
    }
}

impl Backend for DaemonBackend {
    fn submit(&self, submission: Submission) -> Pending<JobCreated> {
        self.on(&self.checkers, move |state, is_awaited| submit::submit(state, &submission, is_awaited))
    }

    fn check(&self, text: String) -> Pending<Checked> {
        self.on(&self.checkers, move |state, _| state.examined(&text))
    }

    fn job(&self, id: &str) -> Pending<Job> {
        self.on_job(id, |state, id| Ok(state.job(&state.row(id)?)))
    }

    fn jobs(&self, query: JobsQuery) -> Pending<JobsPage> {
        let cursor = match query.cursor.as_deref().map(JobId::parse) {
            Some(None) => return ready(Err(no_job())),
            cursor => cursor.flatten(),
        };
        let selection = JobSelection { state: query.state, limit: query.limit, cursor };
        self.on(&self.workers, move |state, _| {
            let page = state.store.list(&selection).map_err(convert::unread)?;
            let jobs = page.rows.iter().map(|row| state.job(row)).collect();
            Ok(JobsPage { jobs, next: page.next.map(|id| id.to_string()) })
        })
    }

    fn run_next(&self, id: &str, caller: Caller) -> Pending<Job> {
        self.on_job(id, move |state, id| submit::run_next(state, id, &caller))
    }

    fn cancel(&self, id: &str, caller: Caller) -> Pending<Job> {
        self.on_job(id, move |state, id| estop::cancel(state, id, &caller))
    }

    fn delete(&self, id: &str, caller: Caller) -> Pending<()> {
        self.on_job(id, move |state, id| estop::delete(state, id, &caller))
    }

    fn plates(&self) -> Pending<crate::api::Plates> {
        self.on(&self.workers, |state, _| {
            state.count_queued();
            Ok(state.plate_statuses())
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
        let plate = plate.to_owned();
        // a client that gave up finds the plate stopped, and the audit log has no entry for the reset
        self.on(&self.workers, move |state, is_awaited| {
            estop::reset(state.plate(&plate)?, held, request, &caller, is_awaited)?;
            state.plate_after(&plate)
        })
    }

    fn resume(&self, plate: &str, caller: Caller) -> Pending<Plate> {
        let plate = plate.to_owned();
        self.on(&self.workers, move |state, _| {
            estop::resume(state.plate(&plate)?, &caller)?;
            state.plate_after(&plate)
        })
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

    fn journal(&self, id: &str) -> Pending<Option<File>> {
        self.on_job(id, |state, id| Ok(files::journal(state.store.runs(), &state.row(id)?)))
    }

    fn frame(&self, id: &str) -> Pending<CameraPicture> {
        self.on_job(id, |state, id| files::picture(&state.plates, &state.row(id)?))
    }

    fn layout(&self, id: &str) -> Pending<LayoutView> {
        self.on_job(id, |state, id| files::layout(&state.plates, &state.row(id)?))
    }

    fn recording(&self, id: &str) -> Pending<Recording> {
        self.on_job(id, |state, id| files::recording(state.store.runs(), &state.row(id)?))
    }
}
