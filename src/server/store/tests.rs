mod crashes;
mod queue;
mod retention;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use jiff::Timestamp;
use parking_lot::MutexGuard;
use rusqlite::Connection;

use super::{
    AuditEntry, Job, JobId, JobRow, JobState, KeepSpec, Pace, RecordingStatus, RecoveryReport, Store, StoreError,
    SubmitOutcome,
};

const TIMEOUT: Duration = Duration::from_secs(60);
const FIXED_TIME: &str = "2027-01-15T08:00:00.000000Z";

/// The turn of one caller.
pub(crate) struct StoreGuard<'a>(#[allow(dead_code)] MutexGuard<'a, Option<(Connection, File)>>);

impl Store {
    /// Blocks all other callers until the guard is dropped.
    pub(crate) fn hold(&self) -> StoreGuard<'_> {
        StoreGuard(self.opened.lock())
    }

    /// Makes every further write to the audit log fail, until called with false.
    pub(crate) fn fail_audit(&self, fails: bool) {
        let begin = "CREATE TEMP TRIGGER fails BEFORE INSERT ON audit BEGIN SELECT RAISE(ABORT, 'a test'); END";
        let sql = if fails { begin } else { "DROP TRIGGER fails" };
        let opened = self.opened.lock();
        opened.as_ref().unwrap().0.execute_batch(sql).unwrap();
    }

    /// Acts and operators of the audit log of known plates, in its order.
    pub(crate) fn audit_log(&self) -> Vec<(String, String)> {
        let sql = "SELECT act, operator FROM audit WHERE plate IS NOT NULL ORDER BY id";
        self.read(|connection| super::columns::rows(connection, sql, [], |row| Ok((row.get(0)?, row.get(1)?)))).unwrap()
    }

    /// Every job, oldest first.
    pub(crate) fn all_jobs(&self) -> Vec<JobRow> {
        let mut rows = self.list(None, None, None, 1000).unwrap();
        rows.reverse();
        rows
    }
}

fn fixed_time() -> Timestamp {
    FIXED_TIME.parse().unwrap()
}

/// Most jobs queued for one plate.
const QUEUE: usize = 30;

pub(crate) fn limits() -> KeepSpec {
    KeepSpec { jobs: 100_000, runs_bytes: 20_000_000_000, standing_runs: 8 }
}

fn plates() -> Vec<String> {
    ["a", "b"].map(String::from).to_vec()
}

fn try_open(data: &Path, limits: KeepSpec) -> Result<(Store, RecoveryReport), StoreError> {
    Store::open(data, &plates(), QUEUE, limits, fixed_time)
}

fn open(data: &Path, limits: KeepSpec) -> (Store, RecoveryReport) {
    try_open(data, limits).unwrap()
}

/// A new store in a new folder.
fn new_store(limits: KeepSpec) -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let (store, recovery) = open(folder.path(), limits);
    assert_eq!((recovery.clean, recovery.paused.len()), (true, 0));
    (folder, store)
}

fn new_job(name: &str, plate: &str) -> JobRow {
    let (name, plate, spec_json) = (name.into(), plate.into(), format!("{{\"name\": {name:?}}}"));
    let job = Job { name, plate, seed: u64::MAX, pace: Pace::Max, ..Job::default() };
    let rig_fingerprint = "0123456789abcdef".into();
    JobRow { job, rig_fingerprint, body_sha256: [7; 32], spec_json, ..JobRow::default() }
}

fn accept(store: &Store, job: &JobRow) -> SubmitOutcome {
    store.accept(job, || true).unwrap().unwrap()
}

/// Queues a job that must be accepted.
fn queue(store: &Store, name: &str, plate: &str) -> JobRow {
    match accept(store, &new_job(name, plate)) {
        SubmitOutcome::New(row) => without_spec(row),
        other => panic!("{other:?}"),
    }
}

/// The job as the store shows it.
fn without_spec(row: JobRow) -> JobRow {
    JobRow { spec_json: String::new(), ..row }
}

fn job(store: &Store, id: JobId) -> JobRow {
    store.job(&id).unwrap().unwrap()
}

/// The run folder of a job that has begun.
fn folder(store: &Store, row: &JobRow) -> PathBuf {
    store.runs().join(row.folder.as_ref().unwrap())
}

fn claim(store: &Store, plate: &str) -> Option<JobRow> {
    store.claim(plate).unwrap()
}

/// Queues a job and claims it for its plate.
fn begin(store: &Store, name: &str, plate: &str) -> JobRow {
    queue(store, name, plate);
    claim(store, plate).unwrap()
}

/// Ends a job, if there is one, like its plate does.
fn finish(store: &Store, id: &JobId, state: JobState) -> Result<(), StoreError> {
    let mut row = store.job(id)?.unwrap_or_default();
    row.job.set_end(state, "so it went");
    row.job = Job { report: Some(Default::default()), recording: RecordingStatus::Whole, progress: 0.25, ..row.job };
    store.finish(&row)
}

/// A store killed now and opened again, on a copy of its files.
fn killed(data: &Path) -> (tempfile::TempDir, (Store, RecoveryReport)) {
    let copy = tempfile::tempdir().unwrap();
    let copied = Command::new("cp").arg("-a").arg(data.join(".")).arg(copy.path()).status();
    assert!(copied.unwrap().success());
    let opened = open(copy.path(), limits());
    (copy, opened)
}
