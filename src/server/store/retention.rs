use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use parking_lot::{Mutex, RwLock};

use jiff::Timestamp;

use super::ages::{AgeClock, Ages, Uptime};
use super::layout::DataDir;
use super::write_queue::WriteQueue;
use super::write_tx::EndStamp;
use super::{JobId, StoreFault, StoreLimits};
use upm_core::thread_priority::lower_thread_priority;

/// Time between two sweeps.
const SWEEP_EVERY: Duration = Duration::from_secs(60);

/// Least age of a folder without a job before it is deleted: a younger one may be one that a user is just copying
/// there.
const ORPHAN_AGE: Duration = Duration::from_secs(3600);

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

/// Held shared from the creation of a run folder until its row names it; held exclusively while folders without a row
/// are determined.
pub(super) type StartLock = Arc<RwLock<()>>;

/// Run folders of jobs by name, with when each job ended.
type RunFolders = BTreeMap<String, (JobId, Option<EndStamp>)>;

/// A run folder that may be deleted.
#[derive(Clone, Debug, PartialEq)]
struct AgedFolder {
    name: String,
    /// Its job; `None` for a folder without a job.
    job: Option<JobId>,
    ended: EndStamp,
    bytes: u64,
}

impl AgedFolder {
    /// A folder that is deleted regardless of age and size.
    fn at_once(name: String, job: Option<JobId>) -> Self {
        Self { name, job, ended: EndStamp { uptime: Uptime::MIN, at: Timestamp::MIN }, bytes: 0 }
    }
}

/// Deletes run folders that are too old, or the oldest while they are too large in total.
#[derive(Debug)]
pub(super) struct Sweeper {
    dir: DataDir,
    limits: StoreLimits,
    ages: Arc<AgeClock>,
    queue: WriteQueue,
    start_lock: StartLock,
    discarded: Discarded,
    /// Uptime at which each folder without a job was first seen since the start.
    orphans: BTreeMap<String, Uptime>,
    /// Sizes of the folders of ended jobs, bytes.
    sizes: BTreeMap<String, u64>,
    bytes: Arc<AtomicU64>,
}

impl Sweeper {
    pub fn new(
        dir: DataDir,
        limits: StoreLimits,
        ages: Arc<AgeClock>,
        queue: WriteQueue,
        start_lock: StartLock,
    ) -> Self {
        let bytes = Arc::new(AtomicU64::new(u64::MAX));
        let (orphans, sizes, discarded) = (BTreeMap::new(), BTreeMap::new(), Discarded::default());
        Self { dir, limits, ages, queue, start_lock, discarded, orphans, sizes, bytes }
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
        let (names, rows) = self.names_and_rows()?;
        let ended = rows.into_iter().filter(|(_, (_, ended))| ended.is_some());
        for (name, (id, _)) in ended.filter(|(name, _)| names.binary_search(name).is_err()) {
            self.queue.written(move |tx| tx.prune(&id, &name))?;
        }
        Ok(())
    }

    /// Deletes the run folders that are due. A folder that cannot be deleted does not prevent the deletion of others.
    fn delete_folders(&mut self) -> Result<SweepReport, StoreFault> {
        let (mut deleted, mut faults) = (Vec::new(), Vec::new());
        self.delete_discarded(&mut deleted, &mut faults)?;
        self.delete_standing(&mut deleted, &mut faults)?;
        let (folders, mut bytes) = self.folders()?;
        let oldest = self.ages.ages().cutoff(self.limits.runs_age);
        for kept in folders {
            if kept.ended.uptime >= oldest && bytes <= self.limits.runs_bytes {
                break;
            }
            if self.delete(&kept, &mut faults)? {
                bytes = bytes.saturating_sub(kept.bytes);
                deleted.push(kept.name);
            }
        }
        self.bytes.store(bytes, Ordering::Relaxed);
        if let Some(first) = faults.first() {
            tracing::warn!(folders = faults.len(), "old run folders cannot be deleted, the first: {first}");
        }
        Ok(SweepReport { deleted, bytes })
    }

    /// Removes the run folders of deleted jobs. A folder that stays has no job, and is removed by age.
    fn delete_discarded(&mut self, deleted: &mut Vec<String>, faults: &mut Vec<String>) -> Result<(), StoreFault> {
        let discarded = std::mem::take(&mut *self.discarded.lock());
        for name in discarded {
            if self.delete(&AgedFolder::at_once(name.clone(), None), faults)? {
                deleted.push(name);
            }
        }
        Ok(())
    }

    /// Deletes surplus runs of standing jobs with their rows: a plate that is never idle would otherwise fill the disk
    /// and displace the runs of other jobs.
    fn delete_standing(&mut self, deleted: &mut Vec<String>, faults: &mut Vec<String>) -> Result<(), StoreFault> {
        for (id, folder) in self.queue.written(|tx| tx.surplus_standing())? {
            if let Some(name) = folder {
                let kept = AgedFolder::at_once(name, Some(id));
                if !self.delete(&kept, faults)? {
                    continue;
                }
                deleted.push(kept.name);
            }
            self.queue.written(move |tx| tx.forget_standing(&id))?;
        }
        Ok(())
    }

    /// The folders that may be deleted, oldest first, and the bytes of all run folders.
    fn folders(&mut self) -> Result<(Vec<AgedFolder>, u64), StoreFault> {
        let (names, rows) = self.names_and_rows()?;
        let (mut folders, mut bytes) = (Vec::new(), 0);
        let (mut sizes, mut orphans) = (BTreeMap::new(), BTreeMap::new());
        let ages = self.ages.ages();
        for name in names {
            let path = self.dir.runs.join(&name);
            let (job, ended) = match rows.get(&name) {
                Some((id, ended)) => (Some(*id), *ended),
                None => {
                    let found = self.orphans.get(&name).copied().unwrap_or(ages.now);
                    orphans.insert(name.clone(), found);
                    (None, orphaned(found, ages))
                }
            };
            let known = self.sizes.get(&name).filter(|_| ended.is_some());
            let size = known.copied().unwrap_or_else(|| size_of(&path));
            bytes += size;
            if let Some(ended) = ended {
                sizes.insert(name.clone(), size);
                folders.push(AgedFolder { name, job, ended, bytes: size });
            }
        }
        (self.sizes, self.orphans) = (sizes, orphans);
        folders.sort_by(|a, b| a.ended.cmp(&b.ended).then_with(|| a.name.cmp(&b.name)));
        Ok((folders, bytes))
    }

    /// Names of the run folders and the rows that name them, read while no claim is between its folder and its row.
    fn names_and_rows(&self) -> Result<(Vec<String>, RunFolders), StoreFault> {
        let _no_start = self.start_lock.write();
        Ok((self.dir.run_names()?, self.queue.written(|tx| tx.folders())?))
    }

    /// Deletes a folder; its row first, so that no row ever names a folder that is gone. False when the folder stays,
    /// with its row as before; errors are added to `faults`.
    fn delete(&mut self, kept: &AgedFolder, faults: &mut Vec<String>) -> Result<bool, StoreFault> {
        let AgedFolder { name, job, .. } = kept;
        let row = match *job {
            None => None,
            Some(id) => {
                let folder = name.clone();
                let Some(recording) = self.queue.written(move |tx| tx.prune(&id, &folder))? else {
                    return Ok(false);
                };
                Some((id, recording))
            }
        };
        let folder = self.dir.runs.join(name);
        // a folder that was moved to the trash and cannot be removed is tried again at the next start
        let removed = self.move_away(&folder, name).and_then(|trash| remove(&trash));
        faults.extend(removed.err().map(|error| format!("{}: {error}", folder.display())));
        if folder.exists() {
            if let Some((id, recording)) = row {
                let name = name.clone();
                self.queue.written(move |tx| tx.restore_job_row(&id, &name, recording))?;
            }
            return Ok(false);
        }
        self.sizes.remove(name);
        Ok(true)
    }

    /// Moves a run folder to the trash, where it can be removed without haste; returns its new path.
    fn move_away(&self, folder: &Path, name: &str) -> io::Result<PathBuf> {
        let DataDir { trash, runs_trash, .. } = &self.dir;
        match move_into(trash, folder, name) {
            // the run folders are on another disk
            Err(error) if error.kind() == io::ErrorKind::CrossesDevices => move_into(runs_trash, folder, name),
            moved => moved,
        }
    }
}

/// The end of a folder without a job that was found at uptime `found`; `None` while it may be one that is being made.
/// The folder's own time is wall time, which cannot be trusted.
fn orphaned(found: Uptime, ages: Ages) -> Option<EndStamp> {
    (found < ages.cutoff(ORPHAN_AGE)).then_some(EndStamp { uptime: found, at: Timestamp::MIN })
}

fn move_into(trash: &Path, folder: &Path, name: &str) -> io::Result<PathBuf> {
    let path = trash.join(name);
    fs::create_dir_all(trash)?;
    remove(&path)?;
    fs::rename(folder, &path)?;
    Ok(path)
}

/// Removes folders that an earlier sweep left in the trash. Those that cannot be removed are tried again at the next
/// start.
pub(super) fn empty_trash(trash: &Path) {
    let Ok(entries) = fs::read_dir(trash) else { return };
    for entry in entries.flatten() {
        if let Err(error) = remove(&entry.path()) {
            tracing::warn!("{}: not removed: {error}", entry.path().display());
        }
    }
}

fn remove(folder: &Path) -> io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
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
