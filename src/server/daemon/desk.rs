use std::collections::BTreeMap;
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use parking_lot::{Mutex, MutexGuard};

use serde_json::json;

use super::clerks::Clerks;
use super::data_watch::{self, DataWatch};
use super::observe::Damage;
use super::wires::Wire;
use super::{answers, files, health, metrics, page, stops, submit};
use crate::plates::{self, Plates};
use crate::service::{
    Asset, Caller, Desk, EStopped, Feed, Job, JobsPage, JobsQuery, Opening, Order, Picture, Plate, Promise, Reason,
    Recording, Refusal, Replayed, Reply, ResetRequest, Submitted, Traffic, kept, promise,
};
use crate::store::{JobId, JobRow, JobState, Page, Store};
use upm_core::time::MonotonicClock;
use upm_runner::config::DaemonSpec;

/// Threads that check jobs, and the jobs that may wait for them: one of every connection there can be.
const CHECKERS: usize = 2;
const CHECKS_WAITING: usize = 1280;
/// Threads that see emergency stops through, which are done by then, and how many may wait for them.
const STOP_CLERKS: usize = 2;
const STOPS_WAITING: usize = 256;
/// Resets that may wait: each is written down before it takes place.
const RESETS_WAITING: usize = 16;

/// Threads that open files, which a dead disk holds up, and how many may wait for them.
const FILE_OPENERS: usize = 2;
const FILES_WAITING: usize = 64;

/// Answers the API out of store and plates.
#[derive(Debug)]
pub(super) struct FrontDesk {
    pub office: Arc<Office>,
    checkers: Arc<Clerks>,
    stops: Clerks,
    resets: Clerks,
    files: Arc<Clerks>,
}

/// What answers are made of.
#[derive(Debug)]
pub(super) struct Office {
    pub spec: DaemonSpec,
    pub store: Arc<Store>,
    pub plates: Arc<Plates>,
    pub clock: MonotonicClock,
    /// The daemon ends.
    pub ending: AtomicBool,
    /// What each plate tells.
    wires: BTreeMap<String, Arc<Wire>>,
    /// Jobs, when they were counted last.
    counted: Mutex<Counted>,
    /// What the API is asked.
    pub traffic: Traffic,
    /// What the store had come to when it was opened.
    pub damage: Damage,
    /// Whether the data folder is still the one that is held open.
    pub data: DataWatch,
    pub version: &'static str,
}

/// How many jobs there are.
#[derive(Clone, Debug, Default)]
pub(super) struct Counted {
    /// Those that wait for each plate.
    pub queued: BTreeMap<String, u64>,
    /// Those of each plate in each state.
    pub jobs: Vec<(String, JobState, u64)>,
}

/// What an office is opened with.
pub(super) struct Furniture {
    pub spec: DaemonSpec,
    pub store: Arc<Store>,
    pub plates: Arc<Plates>,
    pub clock: MonotonicClock,
    pub damage: Option<String>,
    pub version: &'static str,
}

impl FrontDesk {
    /// A desk in front of store and plates.
    pub fn open(with: Furniture) -> io::Result<Self> {
        let Furniture { spec, store, plates, clock, damage, version } = with;
        let wires = plates.iter().map(|plate| {
            let wire = Arc::<Wire>::default();
            plate.subscribe(wire.clone());
            (plate.name().to_owned(), wire)
        });
        let (wires, ending, counted) = (wires.collect(), AtomicBool::new(false), Mutex::default());
        let (traffic, damage, data) = (Traffic::default(), Damage::found(damage), DataWatch::default());
        let office = Office { spec, store, plates, clock, ending, wires, counted, traffic, damage, data, version };
        let office = Arc::new(office);
        data_watch::watch(&office)?;
        let checkers = Arc::new(Clerks::hire("check", CHECKERS, CHECKS_WAITING)?);
        let stops = Clerks::hire_urgent("stops", STOP_CLERKS, STOPS_WAITING)?;
        let resets = Clerks::hire("resets", 1, RESETS_WAITING)?;
        let files = Arc::new(Clerks::hire("files", FILE_OPENERS, FILES_WAITING)?);
        Ok(Self { office, checkers, stops, resets, files })
    }

    /// The job of that id, handed on to `then` with the reply it is for.
    fn with_job<T: Send + 'static>(
        &self,
        id: &str,
        reply: Reply<T>,
        then: impl FnOnce(&Arc<Office>, JobRow, Reply<T>) + Send + 'static,
    ) {
        let Some(id) = JobId::parse(id) else { return reply.send(Err(no_job())) };
        let office = Arc::clone(&self.office);
        self.office.store.job(&id, move |found| match found {
            Ok(Some(row)) => then(&office, row, reply),
            Ok(None) => reply.send(Err(no_job())),
            Err(fault) => reply.send(Err(answers::unread(fault))),
        });
    }
}

impl Office {
    pub fn plate(&self, name: &str) -> Result<&plates::Plate, Refusal> {
        self.plates.get(name).ok_or_else(|| Refusal::Unknown("there is no such plate".to_owned()))
    }

    /// All plates as they are now, with their queues as they were last seen.
    fn all_shown(&self) -> crate::service::Plates {
        crate::service::Plates { plates: self.plates.iter().map(|plate| self.shown(plate)).collect() }
    }

    /// A plate as it is now, with its queue as it was last seen.
    fn shown(&self, plate: &plates::Plate) -> Plate {
        answers::plate(&plate.snapshot(), self.counted().queued.get(plate.name()).copied().unwrap_or(0))
    }

    /// Looks how many jobs wait, then does `then`; where the store does not say, with the numbers of before.
    pub fn count_queued(self: &Arc<Self>, then: impl FnOnce(&Self) + Send + 'static) {
        let office = Arc::clone(self);
        self.store.queued(move |counted| {
            if let Ok(counted) = counted {
                office.counted().queued = counted.into_iter().collect();
            }
            then(&office);
        });
    }

    /// Counts all jobs there are.
    pub fn count_jobs(self: &Arc<Self>) {
        let office = Arc::clone(self);
        self.store.counts(move |counted| {
            if let Ok(counted) = counted {
                office.counted().jobs = counted;
            }
        });
    }

    pub fn counted(&self) -> MutexGuard<'_, Counted> {
        self.counted.lock()
    }

    /// Answers with the plate as it is after what was done to it.
    fn answer_with(self: &Arc<Self>, name: &str, reply: Reply<Plate>) {
        let name = name.to_owned();
        self.count_queued(move |office| reply.send(office.plate(&name).map(|plate| office.shown(plate))));
    }

    /// How a job stands, for one who comes to watch it.
    fn opening(&self, row: &JobRow) -> Opening {
        let plate = self.plate(&row.plate).ok().map(|plate| self.shown(plate));
        let snapshot = json!({"job": answers::job(row), "plate": plate}).to_string();
        Opening { snapshot, newest: row.last_event, is_over: row.state.is_final() }
    }
}

impl Desk for FrontDesk {
    fn submit(&self, order: Order) -> Promise<Submitted> {
        promise(|reply| {
            let asked = submit::Asked::now(order, self.office.clock);
            submit::submit(&self.office, &self.checkers, asked, reply);
        })
    }

    fn job(&self, id: &str) -> Promise<Job> {
        promise(|reply| self.with_job(id, reply, |_, row, reply| reply.send(Ok(answers::job(&row)))))
    }

    fn jobs(&self, query: JobsQuery) -> Promise<JobsPage> {
        let cursor = query.cursor.as_deref().and_then(JobId::parse);
        let page = Page { state: query.state, limit: query.limit, cursor };
        promise(|reply| {
            self.office.store.list(page, move |listed| {
                let page = listed.map_err(answers::unread).map(|page| JobsPage {
                    jobs: page.rows.iter().map(answers::job).collect(),
                    next: page.next.map(|id| id.to_string()),
                });
                reply.send(page);
            });
        })
    }

    fn cancel(&self, id: &str, caller: Caller) -> Promise<Job> {
        promise(|reply| stops::cancel(&self.office, id, &caller, reply))
    }

    fn plates(&self) -> Promise<crate::service::Plates> {
        promise(|reply| {
            self.office.count_queued(move |office| reply.send(Ok(office.all_shown())));
        })
    }

    fn plates_as_counted(&self) -> crate::service::Plates {
        self.office.all_shown()
    }

    fn estop(&self, plate: &str, caller: Caller) -> Promise<EStopped> {
        match self.office.plate(plate) {
            Ok(plate) => plate.estop(),
            Err(refusal) => return kept(Err(refusal)),
        };
        let (office, name) = (Arc::clone(&self.office), plate.to_owned());
        promise(|reply| self.stops.give(move || reply.send(stops::see_through(&office, &name, &caller))))
    }

    fn reset(&self, plate: &str, request: ResetRequest, caller: Caller) -> Promise<Plate> {
        // found before it waits its turn: a stop that comes meanwhile is another one
        let may = |at| self.office.intact().map(|()| at);
        let held = match self.office.plate(plate).and_then(may).and_then(stops::held) {
            Ok(held) => held,
            Err(refusal) => return kept(Err(refusal)),
        };
        let (office, plate) = (Arc::clone(&self.office), plate.to_owned());
        promise(|reply| {
            self.resets.give(move || {
                // a client that gave up finds the plate stopped, and nothing of this in the audit log
                if !reply.is_awaited() {
                    return;
                }
                let is_awaited = || reply.is_awaited();
                match office.plate(&plate).and_then(|at| stops::reset(at, held, request, &caller, is_awaited)) {
                    Ok(()) => office.answer_with(&plate, reply),
                    Err(refusal) => reply.send(Err(refusal)),
                }
            });
        })
    }

    fn resume(&self, plate: &str, caller: Caller) -> Promise<Plate> {
        let may = |at| self.office.intact().map(|()| at);
        let done = self.office.plate(plate).and_then(may).and_then(|at| stops::resume(at, &caller));
        match done {
            Ok(()) => promise(|reply| self.office.answer_with(plate, reply)),
            Err(refusal) => kept(Err(refusal)),
        }
    }

    fn ailments(&self) -> Vec<Reason> {
        health::ailments(&self.office.observed())
    }

    fn obstacles(&self) -> Vec<Reason> {
        health::obstacles(&self.office.observed())
    }

    fn metrics(&self) -> String {
        metrics::text(&self.office.observed())
    }

    fn watch(&self, id: &str, feed: Feed) -> Promise<Opening> {
        promise(|reply| {
            self.with_job(id, reply, move |office, row, reply| {
                if let Some(wire) = office.wires.get(&row.plate) {
                    wire.lead(row.id, feed);
                }
                // read again behind the wire: what was told between the first look and the wire is in the store by now
                let again = Arc::clone(office);
                office.store.job(&row.id, move |found| {
                    let row = found.map_err(answers::unread).and_then(|found| found.ok_or_else(no_job));
                    reply.send(row.map(|row| again.opening(&row)));
                });
            });
        })
    }

    fn replay(&self, id: &str, after: u64, most: usize) -> Promise<Replayed> {
        let Some(id) = JobId::parse(id) else { return kept(Err(no_job())) };
        promise(|reply| {
            self.office.store.replay(&id, after, most, move |found| {
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
            self.with_job(id, reply, |office, row, reply| reply.send(files::picture(&office.plates, &row)));
        })
    }

    fn recording(&self, id: &str) -> Promise<Recording> {
        promise(|reply| {
            let files = Arc::clone(&self.files);
            self.with_job(id, reply, move |office, row, reply| {
                let office = Arc::clone(office);
                files.give(move || reply.send(files::recording(office.store.runs(), &row)));
            });
        })
    }

    fn asset(&self, name: &str) -> Option<Asset> {
        page::asset(name)
    }
}

pub(super) fn no_job() -> Refusal {
    Refusal::Unknown("there is no such job".to_owned())
}
