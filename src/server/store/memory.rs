use std::collections::BTreeMap;
use std::io;

use jiff::Timestamp;
use parking_lot::Mutex;

use super::ids::Ids;
use super::{
    AuditEntry, CancelOutcome, ClaimedJob, JobEnd, JobId, JobRow, JobState, JobStore, MakeFolder, NewEvent, NewJob,
    Publish, RecordingStatus, StoreFault, StoredEvent,
};

/// A job store in memory, for tests of code that needs one.
#[derive(Debug)]
pub struct InMemoryJobStore {
    now: fn() -> Timestamp,
    kept: Mutex<Kept>,
}

#[derive(Debug)]
struct Kept {
    ids: Ids,
    jobs: BTreeMap<JobId, StoredJob>,
    audit: Vec<AuditEntry>,
    fault: Option<StoreFault>,
}

#[derive(Debug)]
struct StoredJob {
    row: JobRow,
    spec_json: String,
    events: Vec<StoredEvent>,
}

impl InMemoryJobStore {
    /// An empty job store that takes the time from `now`.
    pub fn new(now: fn() -> Timestamp) -> Self {
        let (jobs, audit) = Default::default();
        Self { now, kept: Mutex::new(Kept { ids: Ids::above(None), jobs, audit, fault: None }) }
    }

    /// Queues a job.
    pub fn accept(&self, job: NewJob) -> JobRow {
        let mut kept = self.kept.lock();
        let submitted_at = (self.now)();
        let row = job.row(kept.ids.next(submitted_at), submitted_at);
        let entry = StoredJob { row: row.clone(), spec_json: job.spec_json, events: Vec::new() };
        kept.jobs.insert(row.id, entry);
        row
    }

    /// Takes a job out of the queue.
    pub fn cancel_queued(&self, id: &JobId) -> CancelOutcome {
        let mut kept = self.kept.lock();
        let finished = kept.end(id, JobState::Queued, JobEnd::before_it_began(), (self.now)());
        match (kept.jobs.get(id).map(|entry| entry.row.clone()), finished) {
            (None, _) => CancelOutcome::Unknown,
            (Some(row), Some(finished)) => CancelOutcome::Now(row, finished),
            (Some(row), None) => CancelOutcome::Not(row),
        }
    }

    /// The job with that id; `None` when there is none.
    pub fn job(&self, id: &JobId) -> Option<JobRow> {
        self.kept.lock().jobs.get(id).map(|entry| entry.row.clone())
    }

    /// Every job, oldest first.
    pub fn jobs(&self) -> Vec<JobRow> {
        self.kept.lock().jobs.values().map(|entry| entry.row.clone()).collect()
    }

    /// Every event of a job.
    pub fn events(&self, id: &JobId) -> Vec<StoredEvent> {
        self.kept.lock().jobs.get(id).map(|entry| entry.events.clone()).unwrap_or_default()
    }

    /// Every entry written so far, the oldest first.
    pub fn audit_log(&self) -> Vec<AuditEntry> {
        self.kept.lock().audit.clone()
    }

    /// Makes every further write fail with `fault`; `None` ends that.
    pub fn fail_with(&self, fault: Option<StoreFault>) {
        self.kept.lock().fault = fault;
    }
}

impl Kept {
    fn check(&self) -> Result<(), StoreFault> {
        self.fault.clone().map_or(Ok(()), Err)
    }

    fn end(&mut self, id: &JobId, from: JobState, end: JobEnd, at: Timestamp) -> Option<StoredEvent> {
        let entry = self.jobs.get_mut(id).filter(|entry| entry.row.state == from)?;
        let event = end.event();
        entry.row.end(end, at);
        Some(entry.append_event(event, at))
    }
}

impl StoredJob {
    fn append_event(&mut self, event: NewEvent, at: Timestamp) -> StoredEvent {
        self.row.last_event += 1;
        let NewEvent { plate_time, kind, body } = event;
        let stored = StoredEvent { seq: self.row.last_event, at, plate_time, kind: kind.to_owned(), body };
        self.events.push(stored.clone());
        stored
    }
}

impl JobStore for InMemoryJobStore {
    fn claim(&self, plate: &str, folder: MakeFolder<'_>) -> Result<Option<ClaimedJob>, StoreFault> {
        let mut kept = self.kept.lock();
        kept.check()?;
        let next = |entry: &&mut StoredJob| entry.row.plate == plate && entry.row.state == JobState::Queued;
        let Some(StoredJob { row, spec_json, .. }) = kept.jobs.values_mut().find(next) else { return Ok(None) };
        row.folder = Some(folder(row).map_err(|error| StoreFault::Io(error.to_string()))?);
        (row.state, row.started_at) = (JobState::Running, Some((self.now)()));
        Ok(Some(ClaimedJob { row: row.clone(), spec_json: spec_json.clone() }))
    }

    fn begin_standing(&self, job: &NewJob, folder: MakeFolder<'_>) -> Result<Option<ClaimedJob>, StoreFault> {
        let mut kept = self.kept.lock();
        kept.check()?;
        let waits = |entry: &StoredJob| entry.row.plate == job.plate && entry.row.state == JobState::Queued;
        if kept.jobs.values().any(waits) {
            return Ok(None);
        }
        let now = (self.now)();
        let mut row = JobRow { standing: true, ..job.row(kept.ids.next(now), now) };
        row.folder = Some(folder(&row).map_err(|error| StoreFault::Io(error.to_string()))?);
        (row.state, row.started_at) = (JobState::Running, Some(now));
        let spec_json = job.spec_json.clone();
        let entry = StoredJob { row: row.clone(), spec_json: spec_json.clone(), events: Vec::new() };
        kept.jobs.insert(row.id, entry);
        Ok(Some(ClaimedJob { row, spec_json }))
    }

    fn finish(&self, id: &JobId, end: JobEnd) -> Result<Option<StoredEvent>, StoreFault> {
        let mut kept = self.kept.lock();
        kept.check()?;
        let finished = kept.end(id, JobState::Running, end, (self.now)());
        let has_ended = kept.jobs.get(id).is_some_and(|entry| entry.row.state.is_final());
        has_ended.then_some(finished).ok_or_else(|| unknown(id))
    }

    fn append_event(&self, id: &JobId, event: NewEvent, published: Publish) -> bool {
        let stored = {
            let mut kept = self.kept.lock();
            let known = kept.check();
            known
                .and_then(|()| kept.jobs.get_mut(id).ok_or_else(|| unknown(id)))
                .map(|entry| entry.append_event(event, (self.now)()))
        };
        published(stored);
        true
    }

    fn progress(&self, id: &JobId, progress: f64) {
        if let Some(entry) = self.kept.lock().jobs.get_mut(id) {
            entry.row.progress = progress;
        }
    }

    fn note_paused(&self, _plate: &str, _paused: bool) {}

    fn audit(&self, entry: AuditEntry) -> bool {
        self.kept.lock().audit.push(entry);
        true
    }

    fn audit_durably(&self, entry: AuditEntry) -> Result<(), StoreFault> {
        let mut kept = self.kept.lock();
        kept.check()?;
        kept.audit.push(entry);
        Ok(())
    }
}

fn unknown(id: &JobId) -> StoreFault {
    StoreFault::Io(format!("there is no job {id}"))
}

impl JobRow {
    fn end(&mut self, end: JobEnd, finished_at: Timestamp) {
        let JobEnd { state, reason, report_json, recording, .. } = end;
        if state == JobState::Completed {
            self.progress = 1.0;
        }
        (self.state, self.reason, self.report_json, self.recording) = (state, reason, report_json, recording);
        self.finished_at = Some(finished_at);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::mpsc::sync_channel;

    use super::*;
    use crate::store::Pace;
    use upm_core::time::PlateTime;

    fn new_job(plate: &str) -> NewJob {
        NewJob {
            name: "hold".into(),
            plate: plate.into(),
            seed: 3,
            pace: Pace::Max,
            spec_json: "{}".into(),
            rig_fingerprint: String::new(),
            body_sha256: [0; 32],
            key: None,
        }
    }

    fn folder(row: &JobRow) -> io::Result<String> {
        Ok(format!("{}-{}", row.name, row.seed))
    }

    #[test]
    fn the_oldest_job_of_a_plate_is_claimed_once() {
        let job_store = InMemoryJobStore::new(|| Timestamp::UNIX_EPOCH);
        let [first, second, other] = ["a", "a", "b"].map(|plate| job_store.accept(new_job(plate)).id);
        let claimed = job_store.claim("a", &folder).unwrap().unwrap().row;
        assert_eq!((claimed.id, claimed.state, claimed.folder.as_deref()), (first, JobState::Running, Some("hold-3")));
        let fault = StoreFault::Io("no room".into());
        assert_eq!(job_store.claim("a", &|_| Err(io::Error::other("no room"))), Err(fault));
        assert_eq!(job_store.claim("a", &folder).unwrap().unwrap().row.id, second);
        assert_eq!(job_store.claim("a", &folder), Ok(None));
        assert!(matches!(job_store.cancel_queued(&other), CancelOutcome::Now(..)));
        assert!(matches!(job_store.cancel_queued(&first), CancelOutcome::Not(row) if row.state == JobState::Running));
        assert_eq!(job_store.claim("b", &folder), Ok(None));
    }

    #[test]
    fn a_job_ends_once_and_faults_can_be_made() {
        let job_store = InMemoryJobStore::new(|| Timestamp::UNIX_EPOCH);
        let id = job_store.accept(new_job("a")).id;
        job_store.claim("a", &folder).unwrap();
        let end = |state| JobEnd {
            at: PlateTime::ZERO,
            state,
            stop: None,
            reason: "done".into(),
            report_json: None,
            recording: RecordingStatus::Whole,
        };
        job_store.fail_with(Some(StoreFault::Full));
        assert_eq!(job_store.finish(&id, end(JobState::Completed)), Err(StoreFault::Full));
        job_store.fail_with(None);
        assert_eq!(job_store.finish(&id, end(JobState::Completed)).map(|finished| finished.unwrap().seq), Ok(1));
        assert_eq!(job_store.finish(&id, end(JobState::Failed)), Ok(None));
        let row = job_store.job(&id).unwrap();
        assert_eq!((row.state, row.progress, row.recording), (JobState::Completed, 1.0, RecordingStatus::Whole));
    }

    #[test]
    fn events_count_from_one() {
        let job_store = InMemoryJobStore::new(|| Timestamp::UNIX_EPOCH);
        let id = job_store.accept(new_job("a")).id;
        let (sender, receiver) = sync_channel(2);
        for text in ["1", "2"] {
            let sender = sender.clone();
            let event = NewEvent { plate_time: PlateTime::ZERO, kind: "cycle", body: Arc::from(text) };
            assert!(job_store.append_event(
                &id,
                event,
                Box::new(move |stored| sender.send(stored.unwrap().seq).unwrap())
            ));
        }
        assert_eq!(receiver.try_iter().collect::<Vec<_>>(), [1, 2]);
        assert_eq!(job_store.events(&id).iter().map(|event| &*event.body).collect::<Vec<_>>(), ["1", "2"]);
    }
}
