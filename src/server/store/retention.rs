use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use parking_lot::Mutex;

use super::write_queue::WriteQueue;
use super::{JobId, StoreFault, StoreLimits};
use upm_core::thread_priority::lower_thread_priority;

/// Time between two sweeps.
const SWEEP_EVERY: Duration = Duration::from_secs(60);

/// Result of a sweep.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct SweepReport {
    /// Names of the run folders that were deleted.
    pub deleted: Vec<String>,
    /// Bytes of the run folders that are left.
    pub bytes: u64,
}

/// Receiver of a sweep's result; `None` when no caller waits for it.
type SweepReply = Option<SyncSender<Result<SweepReport, StoreFault>>>;

/// Names of run folders whose jobs were deleted.
type Discarded = Arc<Mutex<Vec<String>>>;

/// Requests the removal of run folders whose jobs were deleted.
#[derive(Clone, Debug)]
pub(super) struct Discards {
    asked: SyncSender<SweepReply>,
    discarded: Discarded,
}

impl Discards {
    /// Requests the removal of the run folder of that name.
    pub fn add(&self, folder: &str) {
        self.discarded.lock().push(folder.to_owned());
        let _ = self.asked.try_send(None);
    }
}

/// The thread that deletes run folders. It ends with the store.
#[derive(Debug)]
pub(super) struct Retention {
    asked: SyncSender<SweepReply>,
    discarded: Discarded,
    /// Bytes in run folders at the last count; `u64::MAX` before the first.
    bytes: Arc<AtomicU64>,
}

impl Retention {
    pub fn start(sweeper: Sweeper) -> io::Result<Self> {
        let (sender, asked) = sync_channel(1);
        let (bytes, discarded) = (Arc::clone(&sweeper.bytes), Arc::clone(&sweeper.discarded));
        thread::Builder::new().name("store-sweep".into()).spawn(move || {
            lower_thread_priority();
            sweeper.run(&asked);
        })?;
        Ok(Self { asked: sender, discarded, bytes })
    }

    /// Requests a sweep, unless one is requested already.
    pub fn notify(&self) {
        let _ = self.asked.try_send(None);
    }

    /// A handle for the run folders of deleted jobs.
    pub fn discards(&self) -> Discards {
        Discards { asked: self.asked.clone(), discarded: Arc::clone(&self.discarded) }
    }

    /// Bytes in run folders at the last count; `None` before the first.
    pub fn bytes(&self) -> Option<u64> {
        Some(self.bytes.load(Ordering::Relaxed)).filter(|bytes| *bytes != u64::MAX)
    }

    /// Requests a sweep and waits for it.
    #[cfg(test)]
    pub fn sweep(&self) -> Result<SweepReport, StoreFault> {
        let (done, swept) = sync_channel(1);
        self.asked.send(Some(done)).map_err(|_| StoreFault::Closed)?;
        swept.recv().unwrap_or(Err(StoreFault::Closed))
    }
}

/// The run folder of an ended job.
#[derive(Clone, Debug, PartialEq)]
struct EndedRun {
    folder: String,
    job: JobId,
    bytes: u64,
}

/// Deletes the run folders of the jobs that ended first while all are too large in total.
#[derive(Debug)]
pub(super) struct Sweeper {
    /// Folder of run folders.
    runs: PathBuf,
    limits: StoreLimits,
    queue: WriteQueue,
    discarded: Discarded,
    /// Sizes of the folders of ended jobs, bytes.
    sizes: BTreeMap<String, u64>,
    bytes: Arc<AtomicU64>,
}

impl Sweeper {
    pub fn new(runs: PathBuf, limits: StoreLimits, queue: WriteQueue) -> Self {
        let bytes = Arc::new(AtomicU64::new(u64::MAX));
        Self { runs, limits, queue, discarded: Discarded::default(), sizes: BTreeMap::new(), bytes }
    }

    fn run(mut self, asked: &Receiver<SweepReply>) {
        loop {
            let asked = match asked.recv_timeout(SWEEP_EVERY) {
                Ok(asked) => asked,
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => return,
            };
            let swept = self.sweep();
            match (asked, swept) {
                (Some(done), swept) => drop(done.try_send(swept)),
                (None, Ok(_) | Err(StoreFault::Closed)) => {}
                (None, Err(fault)) => tracing::warn!("old run folders are not deleted: {fault}"),
            }
        }
    }

    /// Deletes run folders, and rows of old keys and jobs; a failure of one does not prevent the other.
    fn sweep(&mut self) -> Result<SweepReport, StoreFault> {
        let swept = self.delete_folders();
        let missing = self.prune_missing();
        let forgotten = self.queue.written(|tx| tx.forget_keys().and_then(|()| tx.forget_jobs()));
        // a failure shows in the store's health, and makes nothing older
        let _ = self.queue.written(|tx| tx.note_uptime());
        forgotten.and(missing).and(swept)
    }

    /// While there are too many jobs, clears the run folder in rows of ended jobs whose folder was removed by hand.
    /// Such rows can then be forgotten; otherwise newer ones would be, in their place.
    fn prune_missing(&self) -> Result<(), StoreFault> {
        if !self.queue.written(|tx| tx.has_too_many_jobs())? {
            return Ok(());
        }
        for (folder, job) in self.queue.written(|tx| tx.ended_runs())? {
            if !self.runs.join(&folder).exists() {
                self.queue.written(move |tx| tx.prune(&job, &folder))?;
            }
        }
        Ok(())
    }

    /// Deletes the run folders that are due. A folder that cannot be deleted does not prevent the deletion of others.
    fn delete_folders(&mut self) -> Result<SweepReport, StoreFault> {
        let (mut deleted, mut faults) = (Vec::new(), Vec::new());
        let discarded = std::mem::take(&mut *self.discarded.lock());
        deleted.extend(discarded.into_iter().filter(|folder| self.remove(folder, &mut faults)));
        self.delete_standing(&mut deleted, &mut faults)?;
        let (ended, mut bytes) = self.folders()?;
        for EndedRun { folder, job, bytes: size } in ended {
            if bytes <= self.limits.runs_bytes {
                break;
            }
            if self.delete(&folder, job, &mut faults)? {
                bytes = bytes.saturating_sub(size);
                deleted.push(folder);
            }
        }
        self.bytes.store(bytes, Ordering::Relaxed);
        if let Some(first) = faults.first() {
            tracing::warn!(folders = faults.len(), "old run folders cannot be deleted, the first: {first}");
        }
        Ok(SweepReport { deleted, bytes })
    }

    /// Deletes surplus runs of standing jobs with their rows: a plate that is never idle would otherwise fill the disk
    /// and displace the runs of other jobs.
    fn delete_standing(&mut self, deleted: &mut Vec<String>, faults: &mut Vec<String>) -> Result<(), StoreFault> {
        for (id, folder) in self.queue.written(|tx| tx.surplus_standing())? {
            if let Some(folder) = folder {
                if !self.delete(&folder, id, faults)? {
                    continue;
                }
                deleted.push(folder);
            }
            self.queue.written(move |tx| tx.forget_standing(&id))?;
        }
        Ok(())
    }

    /// The run folders of ended jobs, those that ended first at the front, and the bytes of the run folders of all
    /// jobs.
    fn folders(&mut self) -> Result<(Vec<EndedRun>, u64), StoreFault> {
        let (running, rows) = self.queue.written(|tx| Ok((tx.begun_runs()?, tx.ended_runs()?)))?;
        let mut bytes: u64 = running.iter().map(|folder| size_of(&self.runs.join(folder))).sum();
        let mut sizes = BTreeMap::new();
        let mut ended = Vec::new();
        for (folder, job) in rows {
            let size = self.sizes.get(&folder).copied().unwrap_or_else(|| size_of(&self.runs.join(&folder)));
            bytes += size;
            sizes.insert(folder.clone(), size);
            ended.push(EndedRun { folder, job, bytes: size });
        }
        self.sizes = sizes;
        Ok((ended, bytes))
    }

    /// Deletes the run folder of an ended job, then removes it from the job's row: a deletion that is cut short is
    /// repeated. False when the folder stays; errors are added to `faults`.
    fn delete(&mut self, folder: &str, job: JobId, faults: &mut Vec<String>) -> Result<bool, StoreFault> {
        let is_removed = self.remove(folder, faults);
        if is_removed {
            let name = folder.to_owned();
            self.queue.written(move |tx| tx.prune(&job, &name))?;
        }
        Ok(is_removed)
    }

    /// Removes a run folder; false when it stays. Errors are added to `faults`.
    fn remove(&self, folder: &str, faults: &mut Vec<String>) -> bool {
        let path = self.runs.join(folder);
        match fs::remove_dir_all(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                faults.push(format!("{}: {error}", path.display()));
                false
            }
            _ => true,
        }
    }
}

/// Bytes of all files below a folder. Links are not followed; unreadable entries count as 0.
fn size_of(folder: &Path) -> u64 {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    let size = |entry: fs::DirEntry| match entry.metadata() {
        Ok(file) if file.is_dir() => size_of(&entry.path()),
        Ok(file) => file.len(),
        Err(_) => 0,
    };
    entries.flatten().map(size).sum()
}
