//! The latch of an emergency stop: a stopped plate stays stopped, even over restarts and power cuts.
//!
//! Each plate has a small file that is rewritten in place, so it needs neither free disk space nor the job store.
//! Stopping is one atomic write to memory; a separate thread writes it to the disk. A file that is unreadable or
//! invalid counts as stopped, and so does the missing file of a plate that the store knows.

mod file;

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle, Thread};
use std::time::Duration;

use parking_lot::{Condvar, Mutex};

use self::file::{LatchFile, make_folder};

/// Interval at which a failed write is retried, and longest delay of a change before the thread wakes.
const AGAIN: Duration = Duration::from_millis(50);

/// A word that no latch reaches: the state on the disk is unknown.
const UNKNOWN: u64 = u64::MAX;

/// One plate's latch. Copies are the same latch.
#[derive(Clone, Debug)]
pub struct Latch(Arc<LatchCell>);

/// A stop that held when it was read. It can be released unless a newer stop was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopToken(LatchWord);

#[derive(Debug)]
struct LatchCell {
    word: AtomicU64,
    /// The word on the disk.
    wait_until_persisted: AtomicU64,
    /// Signals threads that wait until a stop is on the disk.
    settled: (Mutex<()>, Condvar),
}

/// State of a latch. The upper half counts the stops; the lower half counts the changes of state and is odd while
/// stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct LatchWord(u64);

impl LatchWord {
    const ONE_STOP: u64 = 1 << 32;

    fn changes(self) -> u64 {
        self.0 % Self::ONE_STOP
    }

    fn is_stopped(self) -> bool {
        self.changes() % 2 == 1
    }

    /// The word after one more stop; the state changes unless it is stopped already.
    fn stopped(self) -> Self {
        Self(self.0.wrapping_add(Self::ONE_STOP + u64::from(!self.is_stopped())))
    }
}

impl Latch {
    /// A latch in the state that was found, not yet confirmed to be on the disk.
    pub(super) fn found(stopped: bool) -> Self {
        let (word, wait_until_persisted) = (AtomicU64::new(u64::from(stopped)), AtomicU64::new(UNKNOWN));
        Self(Arc::new(LatchCell { word, wait_until_persisted, settled: Default::default() }))
    }

    /// Stops. True when it was not stopped before. Never waits.
    pub fn stop(&self) -> bool {
        let next = |word| Some(LatchWord(word).stopped().0);
        let before = self.0.word.fetch_update(Ordering::SeqCst, Ordering::SeqCst, next);
        before.is_ok_and(|word| !LatchWord(word).is_stopped())
    }

    /// The stop that holds, if one does.
    pub fn held(&self) -> Option<StopToken> {
        let word = self.0.word();
        word.is_stopped().then_some(StopToken(word))
    }

    /// Releases that stop. False when it was released, or another stop was made, in between.
    pub fn release(&self, StopToken(word): StopToken) -> bool {
        let released = self.0.word.compare_exchange(word.0, word.0 + 1, Ordering::SeqCst, Ordering::SeqCst).is_ok();
        if released {
            self.0.notify_waiters();
        }
        released
    }

    /// Waits until the stop that holds is on the disk, at most `within`. False when it is not by then, or no stop
    /// holds.
    pub fn wait_until_persisted(&self, within: Duration) -> bool {
        let (lock, condition) = &self.0.settled;
        condition.wait_while_for(&mut lock.lock(), |()| self.is_stopped() && !self.is_persisted(), within);
        self.is_stopped() && self.is_persisted()
    }

    /// True while it is stopped.
    pub fn is_stopped(&self) -> bool {
        self.0.word().is_stopped()
    }

    /// Marks the state as on the disk, as the writing thread does.
    #[cfg(test)]
    pub(super) fn keep(&self) {
        self.0.wait_until_persisted.store(self.0.word().0, Ordering::SeqCst);
        self.0.notify_waiters();
    }

    /// True when the disk has the current state, confirmed since the last stop or release.
    pub fn is_persisted(&self) -> bool {
        self.0.wait_until_persisted.load(Ordering::SeqCst) == self.0.word().0
    }
}

impl LatchCell {
    fn word(&self) -> LatchWord {
        LatchWord(self.word.load(Ordering::SeqCst))
    }

    /// Wakes the threads that wait for the disk, so that they check again.
    fn notify_waiters(&self) {
        let (lock, condition) = &self.settled;
        drop(lock.lock());
        condition.notify_all();
    }
}

/// The thread that writes latches to the disk.
#[derive(Debug)]
pub struct Latches {
    latches: Vec<Latch>,
    ending: Arc<AtomicBool>,
    /// `None` once the thread is joined.
    persist_thread: Option<JoinHandle<()>>,
    thread: Thread,
}

impl Latches {
    /// Opens the latch file of every plate in `folder`, creating missing ones. The flag beside a name is true when the
    /// store knew the plate before this start: then a missing file counts as stopped.
    pub fn open(folder: &Path, plates: &[(String, bool)]) -> io::Result<Self> {
        make_folder(folder)?;
        let open = |(name, known): &(String, bool)| LatchFile::open(folder, name, *known);
        let opened = plates.iter().map(open).collect::<io::Result<Vec<_>>>()?;
        let (files, stopped): (Vec<LatchFile>, Vec<bool>) = opened.into_iter().unzip();
        let latches: Vec<Latch> = stopped.into_iter().map(Latch::found).collect();
        let ending = Arc::new(AtomicBool::new(false));
        let (cells, has_ended) = (latches.clone(), Arc::clone(&ending));
        let persist_thread =
            thread::Builder::new().name("latches".into()).spawn(move || keep(files, &cells, &has_ended))?;
        let thread = persist_thread.thread().clone();
        Ok(Self { latches, ending, persist_thread: Some(persist_thread), thread })
    }

    /// The latch of each plate, in their order.
    pub fn latches(&self) -> &[Latch] {
        &self.latches
    }

    /// True while the writing thread runs.
    pub fn is_alive(&self) -> bool {
        self.persist_thread.as_ref().is_some_and(|persist_thread| !persist_thread.is_finished())
    }

    /// The writing thread; unparking it makes it write at once.
    pub fn persist_thread(&self) -> Thread {
        self.thread.clone()
    }
}

impl Drop for Latches {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::SeqCst);
        self.thread.unpark();
        if let Some(persist_thread) = self.persist_thread.take() {
            persist_thread.join().ok();
        }
    }
}

/// Writes every change to the disk until `ending`, then once more. A stop of a plate that is stopped already changes
/// nothing, but its caller, too, waits for the disk to be confirmed.
fn keep(mut files: Vec<LatchFile>, latches: &[Latch], ending: &AtomicBool) {
    loop {
        let last = ending.load(Ordering::SeqCst);
        for (file, Latch(cell)) in files.iter_mut().zip(latches) {
            let word = cell.word();
            if word.0 != cell.wait_until_persisted.load(Ordering::SeqCst) && file.persist(word.is_stopped()) {
                cell.wait_until_persisted.store(word.0, Ordering::SeqCst);
                cell.notify_waiters();
            }
        }
        if last {
            return;
        }
        thread::park_timeout(AGAIN);
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::file::RELEASED;
    use super::*;

    fn names(names: &[&str]) -> Vec<(String, bool)> {
        names.iter().map(|name| ((*name).to_owned(), false)).collect()
    }

    fn wait_until_persisted(latches: &Latches) {
        latches.persist_thread().unpark();
        while !latches.latches().iter().all(Latch::is_persisted) {
            thread::yield_now();
        }
    }

    #[test]
    fn latch_states_survive_reopen() {
        let folder = tempfile::tempdir().unwrap();
        let plates = names(&["left", "right"]);
        let stopped = |latches: &Latches| latches.latches().iter().map(Latch::is_stopped).collect::<Vec<_>>();
        {
            let latches = Latches::open(folder.path(), &plates).unwrap();
            assert_eq!(stopped(&latches), [false, false]);
            assert!(latches.latches()[1].stop());
            assert!(!latches.latches()[1].stop(), "it was stopped already");
            wait_until_persisted(&latches);
        }
        let latches = Latches::open(folder.path(), &plates).unwrap();
        assert_eq!(stopped(&latches), [false, true]);
        let held = latches.latches()[1].held().unwrap();
        assert!(latches.latches()[1].release(held));
        drop(latches);
        assert_eq!(stopped(&Latches::open(folder.path(), &plates).unwrap()), [false, false], "kept at the end");
    }

    #[test]
    fn malformed_latch_file_counts_as_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let plates = names(&["one"]);
        for text in [&b""[..], b"upm: rele", b"upm: released   x", b"upm: stopped    ", &[0; 16]] {
            fs::write(folder.path().join("one"), text).unwrap();
            assert!(Latches::open(folder.path(), &plates).unwrap().latches()[0].is_stopped(), "{text:?}");
        }
    }

    #[test]
    fn lost_files_of_known_plates_hold_over_the_next_start_until_they_are_released() {
        let folder = tempfile::tempdir().unwrap();
        let latch = folder.path().join("latch");
        let plates = [("left".to_owned(), true), ("right".to_owned(), false)];
        for _ in 0..2 {
            let latches = Latches::open(&latch, &plates).unwrap();
            let stopped: Vec<bool> = latches.latches().iter().map(Latch::is_stopped).collect();
            assert_eq!(stopped, [true, false]);
        }
        let latches = Latches::open(&latch, &plates).unwrap();
        let held = latches.latches()[0].held().unwrap();
        assert!(latches.latches()[0].release(held));
        drop(latches);
        assert!(!Latches::open(&latch, &plates).unwrap().latches()[0].is_stopped());
    }

    #[test]
    fn it_is_written_in_place() {
        let folder = tempfile::tempdir().unwrap();
        let latches = Latches::open(folder.path(), &names(&["one"])).unwrap();
        for _ in 0..3 {
            latches.latches()[0].stop();
            wait_until_persisted(&latches);
            let held = latches.latches()[0].held().unwrap();
            latches.latches()[0].release(held);
            wait_until_persisted(&latches);
        }
        assert_eq!(fs::read(folder.path().join("one")).unwrap(), RELEASED);
    }

    #[test]
    fn a_stop_that_comes_before_a_release_is_not_released_with_it() {
        let latch = Latch::found(true);
        latch.0.wait_until_persisted.store(latch.0.word().0, Ordering::SeqCst);
        let first = latch.held().unwrap();
        assert!(latch.is_persisted());
        assert!(!latch.stop(), "it is stopped already, and yet this is another stop");
        assert!(!latch.is_persisted(), "the disk is asked once more");
        assert!(!latch.release(first) && latch.is_stopped());
        let second = latch.held().unwrap();
        assert!(latch.release(second) && !latch.is_stopped());
        assert!(!latch.release(second), "once");
        assert_eq!(latch.held(), None);
        assert!(latch.stop() && !latch.release(second) && latch.is_stopped());
    }
}
