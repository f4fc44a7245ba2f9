mod crashes;
mod damage;
mod deletion;
mod events;
mod forgotten;
mod full_disk;
mod queue;
mod reads;
mod recordings;
mod standing;
mod sweeping;
mod versions;

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::Duration;

use jiff::Timestamp;

use super::retention::SweepReport;
use super::write_queue::{WriteRequest, task};
use super::{
    AuditEntry, ClaimedJob, Clocks, FINISHED, JobEnd, JobId, JobRow, JobSelection, JobState, JobStore, NewEvent,
    NewJob, OpenOutcome, Pace, RecordingStatus, Store, StoreFault, StoreLimits, SubmitOutcome,
};
use upm_core::time::{Clock, MonotonicClock, PlateTime};
use upm_fixtures::wait::eventually;

/// Longest wait for an answer of a store that works.
const TIMEOUT: Duration = Duration::from_secs(60);

impl Store {
    /// Queues a job. A job in the answer is on the disk.
    pub(crate) fn accept(&self, job: NewJob, done: impl FnOnce(Result<SubmitOutcome, StoreFault>) + Send + 'static) {
        let done = |accepted: Result<Option<_>, _>| done(accepted.and_then(|new| new.ok_or(StoreFault::Closed)));
        self.accept_if(job, || true, done);
    }

    /// Blocks the writer until the returned sender is dropped.
    pub(crate) fn hold(&self) -> SyncSender<()> {
        let ((let_go, gate), (stop, stopped)) = (sync_channel(0), sync_channel(0));
        self.queue.write(wish(move |_| {
            stop.send(()).unwrap();
            assert!(gate.recv().is_err());
        }));
        stopped.recv_timeout(TIMEOUT).unwrap();
        let_go
    }

    /// Deletes run folders that are too old or too large in total, and waits for that.
    fn sweep(&self) -> Result<SweepReport, StoreFault> {
        self.retention.sweep()
    }
}

/// A task that writes nothing.
fn wish(done: impl FnOnce(Result<(), StoreFault>) + Send + 'static) -> Box<dyn WriteRequest> {
    task(|_| Ok(()), done)
}

/// The result of `act`, run on another thread, so that a test of code that hangs fails after a while.
#[cfg(target_os = "linux")]
fn in_time<T: Send + 'static>(act: impl FnOnce() -> T + Send + 'static) -> T {
    let (sender, done) = sync_channel(1);
    std::thread::spawn(move || sender.send(act()).unwrap());
    done.recv_timeout(TIMEOUT).unwrap()
}

/// Stores whether a plate is paused, and waits until that is on the disk.
fn set_paused(store: &Store, plate: &'static str, paused: bool) {
    store.queue.written(move |tx| tx.set_paused(plate, paused)).unwrap();
}

fn fixed_time() -> Timestamp {
    Timestamp::from_second(1_800_000_000).unwrap()
}

/// Clocks with a wall clock that the test controls and the machine's monotonic clock.
fn still(wall: fn() -> Timestamp) -> Clocks {
    Clocks::new(wall, MonotonicClock::new())
}

/// A monotonic clock that a test sets, in hours.
struct Hours(&'static AtomicI64);

impl Clock for Hours {
    fn elapsed(&self) -> Duration {
        Duration::from_secs(3600 * self.0.load(Ordering::SeqCst).unsigned_abs())
    }
}

fn limits() -> StoreLimits {
    StoreLimits::default()
}

fn plates() -> Vec<String> {
    ["a", "b"].map(String::from).to_vec()
}

fn try_open(data: &Path, limits: StoreLimits) -> Result<OpenOutcome, StoreFault> {
    Store::open(data, &plates(), limits, still(fixed_time))
}

/// Opens a store that an earlier opener may still be closing.
fn open(data: &Path, limits: StoreLimits) -> OpenOutcome {
    eventually("the store is unlocked", || match try_open(data, limits.clone()) {
        Err(StoreFault::Io(reason)) if reason.contains("another daemon") => None,
        other => Some(other.unwrap()),
    })
}

/// A new store in a new folder.
fn new_store(limits: StoreLimits) -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let OpenOutcome { store, recovery } = open(folder.path(), limits);
    assert_eq!((recovery.clean, recovery.damage, recovery.paused.len()), (true, None, 0));
    (folder, store)
}

fn new_job(name: &str, plate: &str) -> NewJob {
    NewJob {
        name: name.into(),
        plate: plate.into(),
        seed: u64::MAX,
        pace: Pace::Max,
        spec_json: format!("{{\"name\": {name:?}}}"),
        rig_fingerprint: "0123456789abcdef".into(),
        body_sha256: [7; 32],
        key: None,
    }
}

/// Waits for the answer of a callback.
fn ask<T: Send + 'static>(question: impl FnOnce(Box<dyn FnOnce(T) + Send>)) -> T {
    let (sender, answer) = sync_channel(1);
    question(Box::new(move |made| sender.send(made).unwrap()));
    answer.recv_timeout(TIMEOUT).unwrap()
}

fn accept(store: &Store, job: NewJob) -> Result<SubmitOutcome, StoreFault> {
    ask(|done| store.accept(job, done))
}

/// Queues a job that must be accepted.
fn queue(store: &Store, name: &str, plate: &str) -> JobRow {
    match accept(store, new_job(name, plate)) {
        Ok(SubmitOutcome::New(row)) => row,
        other => panic!("{other:?}"),
    }
}

fn job(store: &Store, id: JobId) -> JobRow {
    ask(|done| store.job(&id, done)).unwrap().unwrap()
}

fn all_jobs(store: &Store) -> Vec<JobRow> {
    let (mut rows, mut cursor) = (Vec::new(), None);
    loop {
        let page =
            ask(|done| store.list(JobSelection { state: None, limit: JobSelection::MOST, cursor }, done)).unwrap();
        rows.extend(page.rows);
        cursor = page.next;
        if cursor.is_none() {
            return rows;
        }
    }
}

/// Creates a run folder like a plate does.
fn folder(store: &Store) -> impl Fn(&JobRow) -> io::Result<String> {
    let runs = store.runs().to_owned();
    move |row| {
        std::fs::create_dir(runs.join(&row.name))?;
        Ok(row.name.clone())
    }
}

/// Queues a job and claims it for its plate.
fn begin(store: &Store, name: &str, plate: &str) -> ClaimedJob {
    queue(store, name, plate);
    store.claim(plate, &folder(store)).unwrap().unwrap()
}

fn end(state: JobState) -> JobEnd {
    let at = PlateTime::from_secs(2.5);
    let (reason, report_json) = ("so it went".into(), Some("{}".into()));
    JobEnd { at, state, stop: None, reason, report_json, recording: RecordingStatus::Whole }
}

fn event(kind: &'static str, body: &str) -> NewEvent {
    NewEvent { plate_time: PlateTime::from_secs(1.5), kind, body: Arc::from(body) }
}

/// Stores an event and returns its number.
fn append(store: &Store, id: JobId, body: &str) -> Result<u64, StoreFault> {
    ask(|done| assert!(store.append_event(&id, event("cycle", body), done))).map(|stored| stored.seq)
}

fn act(operator: &str) -> AuditEntry {
    AuditEntry { plate: Some("a".into()), act: "reset".into(), operator: operator.into(), ..AuditEntry::default() }
}

/// A copy of all files on the disk, as a kill at this moment would leave them.
fn snapshot(data: &Path) -> tempfile::TempDir {
    let copy = tempfile::tempdir().unwrap();
    copy_folder(data, copy.path());
    copy
}

fn copy_folder(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let there = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            std::fs::create_dir(&there).unwrap();
            copy_folder(&entry.path(), &there);
        } else {
            std::fs::copy(entry.path(), there).unwrap();
        }
    }
}
