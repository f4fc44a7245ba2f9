use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicUsize, Ordering};

use jiff::Timestamp;
use parking_lot::Mutex;

use super::write_tx::WriteTx;
use super::{AuditEntry, JobId};

/// Most audit entries that wait in memory.
const MOST_ACTS: usize = 1024;

/// Most jobs whose progress waits.
const MOST_JOBS: usize = 256;

/// Writes that wait in memory for time and space. Their callers never block and get no answer.
#[derive(Debug, Default)]
pub(super) struct DeferredWrites {
    notes: Mutex<Deferred>,
    /// Audit entries that were taken and may be put back.
    taken: AtomicUsize,
}

#[derive(Debug, Default)]
pub(super) struct Deferred {
    audit_entries: VecDeque<(Timestamp, AuditEntry)>,
    paused: BTreeMap<String, bool>,
    progress: BTreeMap<JobId, f64>,
}

impl DeferredWrites {
    /// Adds an audit entry; false when too many wait already.
    pub fn act(&self, at: Timestamp, entry: AuditEntry) -> bool {
        let audit_entries = &mut self.notes.lock().audit_entries;
        let room = audit_entries.len() + self.taken.load(Ordering::SeqCst) < MOST_ACTS;
        if room {
            audit_entries.push_back((at, entry));
        }
        room
    }

    /// Notes that a plate is paused or resumed.
    pub fn paused(&self, plate: &str, paused: bool) {
        self.notes.lock().paused.insert(plate.to_owned(), paused);
    }

    /// Notes the progress of a job; a later call overwrites it. Called by threads that drive a plate in real time, so
    /// it is skipped while another thread holds the lock.
    pub fn progress(&self, id: &JobId, progress: f64) {
        let Some(mut notes) = self.notes.try_lock() else { return };
        let waiting = &mut notes.progress;
        if waiting.len() < MOST_JOBS || waiting.contains_key(id) {
            waiting.insert(*id, progress);
        }
    }

    /// Number of audit entries that wait.
    pub fn pending_audit_entries(&self) -> usize {
        let notes = self.notes.lock();
        notes.audit_entries.len() + self.taken.load(Ordering::SeqCst)
    }

    /// Takes everything that waits; `None` when that is only progress and `progress_too` is false. The caller reports
    /// back with [`Self::written`] or [`Self::put_back`].
    pub fn take(&self, progress_too: bool) -> Option<Deferred> {
        let mut notes = self.notes.lock();
        let urgent = !notes.audit_entries.is_empty() || !notes.paused.is_empty();
        let due = urgent || (progress_too && !notes.progress.is_empty());
        due.then(|| {
            self.taken.store(notes.audit_entries.len(), Ordering::SeqCst);
            std::mem::take(&mut *notes)
        })
    }

    /// Reports that the notes taken are on the disk.
    pub fn written(&self) {
        self.taken.store(0, Ordering::SeqCst);
    }

    /// Puts notes back that could not be written, before those added since.
    pub fn put_back(&self, notes: Deferred) {
        let mut now = self.notes.lock();
        self.taken.store(0, Ordering::SeqCst);
        let Deferred { audit_entries, paused, progress } = std::mem::replace(&mut *now, notes);
        now.audit_entries.extend(audit_entries);
        now.paused.extend(paused);
        now.progress.extend(progress);
    }
}

impl Deferred {
    pub fn write(&self, tx: &WriteTx<'_>) -> rusqlite::Result<()> {
        self.audit_entries.iter().try_for_each(|(at, entry)| tx.audit(*at, entry))?;
        self.paused.iter().try_for_each(|(plate, paused)| tx.set_paused(plate, *paused))?;
        self.progress.iter().try_for_each(|(id, progress)| tx.progress(id, *progress))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_is_skipped_while_the_lock_is_held() {
        let pending = DeferredWrites::default();
        let id = JobId::parse("019a0000000070008000000000000001").unwrap();
        let busy = pending.notes.lock();
        pending.progress(&id, 0.5);
        drop(busy);
        assert!(pending.take(true).is_none(), "it was left out");
        pending.progress(&id, 0.75);
        assert_eq!(pending.take(true).unwrap().progress[&id], 0.75);
    }

    #[test]
    fn lines_that_come_back_again_and_again_do_not_pile_up() {
        let pending = DeferredWrites::default();
        let act = || pending.act(Timestamp::UNIX_EPOCH, AuditEntry::default());
        for _ in 0..3 {
            (0..MOST_ACTS).for_each(|_| _ = act());
            let notes = pending.take(false).unwrap();
            assert!(!act(), "those that were taken may come back");
            assert_eq!(pending.pending_audit_entries(), MOST_ACTS);
            pending.put_back(notes);
            assert_eq!(pending.pending_audit_entries(), MOST_ACTS);
        }
        assert_eq!(pending.take(false).unwrap().audit_entries.len(), MOST_ACTS);
        pending.written();
        assert!(act() && pending.pending_audit_entries() == 1);
    }
}
