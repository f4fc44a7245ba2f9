use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::state::{DaemonState, no_job};
use super::{answers, data_watch, files, health, metrics, page, stops, submit};
use crate::service::{
    Asset, Caller, Checked, Desk, EStopped, Feed, Job, JobsPage, JobsQuery, Layout, Opening, Order, Picture, Plate,
    Promise, Reason, Recording, Replayed, Reply, ResetRequest, Submitted, kept, promise,
};
use crate::store::{JobId, JobRow, Page};
use upm_core::background::WorkerPool;

/// Threads that check jobs, and the jobs that may wait for them: one for every connection that is allowed.
const CHECKERS: usize = 2;
const CHECKS_WAITING: usize = 1280;
/// Threads that confirm emergency stops already made, and the number of confirmations that may wait for them.
const STOP_THREADS: usize = 2;
const STOPS_WAITING: usize = 256;
/// Resets that may wait: each is stored in the audit log before it takes effect.
const RESETS_WAITING: usize = 16;

/// Threads that open files, which a hung disk blocks, and the requests that may wait for them.
const FILE_OPENERS: usize = 2;
const FILES_WAITING: usize = 64;

/// The API's [`Desk`], backed by store and plates.
#[derive(Debug)]
pub(super) struct FrontDesk {
    pub state: Arc<DaemonState>,
    checkers: Arc<WorkerPool>,
    stops: WorkerPool,
    resets: WorkerPool,
    files: Arc<WorkerPool>,
}

impl FrontDesk {
    /// Opens the desk in front of store and plates and starts the thread that watches the data folder.
    pub fn open(state: DaemonState) -> io::Result<Self> {
        let state = Arc::new(state);
        let watched = Arc::downgrade(&state);
        data_watch::watch(move || {
            let state = watched.upgrade().filter(|state| !state.ending.load(Ordering::SeqCst));
            state.inspect(|state| state.check_paths()).is_some()
        })?;
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
        reply: Reply<T>,
        then: impl FnOnce(&Arc<DaemonState>, JobRow, Reply<T>) + Send + 'static,
    ) {
        let Some(id) = JobId::parse(id) else { return reply.send(Err(no_job())) };
        let state = Arc::clone(&self.state);
        self.state.store.job(&id, move |found| match found {
            Ok(Some(row)) => then(&state, row, reply),
            Ok(None) => reply.send(Err(no_job())),
            Err(fault) => reply.send(Err(answers::unread(fault))),
        });
    }
}

impl Desk for FrontDesk {
    fn submit(&self, order: Order) -> Promise<Submitted> {
        promise(|reply| {
            let asked = submit::Asked::now(order, self.state.clock);
            submit::submit(&self.state, &self.checkers, asked, reply);
        })
    }

    fn check(&self, order: Order) -> Promise<Checked> {
        promise(|reply| {
            let state = Arc::clone(&self.state);
            self.checkers.submit(move || {
                if reply.is_awaited() {
                    reply.send(state.examined(&order.text));
                }
            });
        })
    }

    fn job(&self, id: &str) -> Promise<Job> {
        promise(|reply| self.with_job(id, reply, |_, row, reply| reply.send(Ok(answers::job(&row)))))
    }

    fn jobs(&self, query: JobsQuery) -> Promise<JobsPage> {
        let cursor = query.cursor.as_deref().and_then(JobId::parse);
        let page = Page { state: query.state, limit: query.limit, cursor };
        promise(|reply| {
            self.state.store.list(page, move |listed| {
                let page = listed.map_err(answers::unread).map(|page| JobsPage {
                    jobs: page.rows.iter().map(answers::job).collect(),
                    next: page.next.map(|id| id.to_string()),
                });
                reply.send(page);
            });
        })
    }

    fn cancel(&self, id: &str, caller: Caller) -> Promise<Job> {
        promise(|reply| stops::cancel(&self.state, id, &caller, reply))
    }

    fn delete(&self, id: &str, caller: Caller) -> Promise<()> {
        promise(|reply| stops::delete(&self.state, id, &caller, reply))
    }

    fn plates(&self) -> Promise<crate::service::Plates> {
        promise(|reply| {
            self.state.count_queued(move |state| reply.send(Ok(state.all_shown())));
        })
    }

    fn plates_as_counted(&self) -> crate::service::Plates {
        self.state.all_shown()
    }

    fn estop(&self, plate: &str, caller: Caller) -> Promise<EStopped> {
        match self.state.plate(plate) {
            Ok(plate) => plate.estop(),
            Err(refusal) => return kept(Err(refusal)),
        };
        let (state, name) = (Arc::clone(&self.state), plate.to_owned());
        promise(|reply| self.stops.submit(move || reply.send(stops::see_through(&state, &name, &caller))))
    }

    fn reset(&self, plate: &str, request: ResetRequest, caller: Caller) -> Promise<Plate> {
        // determined before the reset waits its turn: a stop that comes in between is a different one
        let may = |at| self.state.intact().map(|()| at);
        let held = match self.state.plate(plate).and_then(may).and_then(stops::held) {
            Ok(held) => held,
            Err(refusal) => return kept(Err(refusal)),
        };
        let (state, plate) = (Arc::clone(&self.state), plate.to_owned());
        promise(|reply| {
            self.resets.submit(move || {
                // a client that gave up finds the plate stopped, and the audit log has no entry for the reset
                if !reply.is_awaited() {
                    return;
                }
                let is_awaited = || reply.is_awaited();
                match state.plate(&plate).and_then(|at| stops::reset(at, held, request, &caller, is_awaited)) {
                    Ok(()) => state.answer_with(&plate, reply),
                    Err(refusal) => reply.send(Err(refusal)),
                }
            });
        })
    }

    fn resume(&self, plate: &str, caller: Caller) -> Promise<Plate> {
        let may = |at| self.state.intact().map(|()| at);
        let done = self.state.plate(plate).and_then(may).and_then(|at| stops::resume(at, &caller));
        match done {
            Ok(()) => promise(|reply| self.state.answer_with(plate, reply)),
            Err(refusal) => kept(Err(refusal)),
        }
    }

    fn ailments(&self) -> Vec<Reason> {
        health::ailments(&self.state.observed())
    }

    fn obstacles(&self) -> Vec<Reason> {
        health::obstacles(&self.state.observed())
    }

    fn metrics(&self) -> String {
        metrics::text(&self.state.observed())
    }

    fn watch(&self, id: &str, feed: Feed) -> Promise<Opening> {
        promise(|reply| {
            self.with_job(id, reply, move |state, row, reply| {
                if let Some(wire) = state.wires.get(&row.plate) {
                    wire.lead(row.id, feed);
                }
                // read again once the wire is connected: events published between the first read and that are in the
                // store by now
                let again = Arc::clone(state);
                state.store.job(&row.id, move |found| {
                    let row = found.map_err(answers::unread).and_then(|found| found.ok_or_else(no_job));
                    reply.send(row.map(|row| again.opening(&row)));
                });
            });
        })
    }

    fn replay(&self, id: &str, after: u64, most: usize) -> Promise<Replayed> {
        let Some(id) = JobId::parse(id) else { return kept(Err(no_job())) };
        promise(|reply| {
            self.state.store.replay(&id, after, most, move |found| {
                let found = found.map_err(answers::unread).and_then(|found| found.ok_or_else(no_job));
                reply.send(found.map(|replay| Replayed {
                    oldest: replay.oldest,
                    events: replay.events.iter().map(answers::event).collect(),
                }));
            });
        })
    }

    fn frame(&self, id: &str) -> Promise<Picture> {
        promise(|reply| {
            self.with_job(id, reply, |state, row, reply| reply.send(files::picture(&state.plates, &row)));
        })
    }

    fn layout(&self, id: &str) -> Promise<Layout> {
        promise(|reply| {
            self.with_job(id, reply, |state, row, reply| reply.send(files::layout(&state.plates, &row)));
        })
    }

    fn recording(&self, id: &str) -> Promise<Recording> {
        promise(|reply| {
            let files = Arc::clone(&self.files);
            self.with_job(id, reply, move |state, row, reply| {
                let state = Arc::clone(state);
                files.submit(move || reply.send(files::recording(state.store.runs(), &row)));
            });
        })
    }

    fn asset(&self, name: &str) -> Option<Asset> {
        page::asset(name)
    }
}
