use std::cell::Cell;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::Duration;

use parking_lot::Mutex;

use jiff::Timestamp;
use rusqlite::{Connection, TransactionBehavior};

use super::ages::AgeClock;
use super::ballast::Ballast;
use super::books::Books;
use super::ids::Ids;
use super::pending::{Notes, Pending};
use super::places::Lock;
use super::schema::restart_log;
use super::task::Task;
use super::{Limits, StoreFault};
use upm_core::time::{Clock, MonotonicClock};

/// Tasks that may wait for the writer.
pub(super) const MOST_WAITING: usize = 1024;

/// Most tasks of one transaction.
const MOST_TOGETHER: usize = 256;

/// Longest time between two rounds of the loop.
const ROUND: Duration = Duration::from_millis(250);

/// Time between two writes of progress alone.
const PROGRESS_EVERY: Duration = Duration::from_secs(1);

/// Time between two tries to write after a fault.
const TRY_EVERY: Duration = Duration::from_secs(2);

/// What the writer is asked.
#[derive(Debug)]
pub(super) enum Order {
    /// Write this.
    Do(Box<dyn Task>),
    /// Something is pending.
    Wake,
    /// Write what waits, note that all ended in order, end, and tell whether that was so.
    Close(SyncSender<bool>),
}

/// What the writer does after a round.
enum Then {
    GoOn,
    /// Ends; who waits for that is told.
    End(Option<SyncSender<bool>>),
}

/// What the writer shows others.
#[derive(Debug)]
pub(super) struct Shown {
    pub clock: MonotonicClock,
    pub pending: Pending,
    pub waiting: AtomicUsize,
    pub closed: AtomicBool,
    pub reserve: AtomicBool,
    beat_ns: AtomicU64,
    fault: Mutex<Option<StoreFault>>,
}

impl Shown {
    pub fn new(clock: MonotonicClock) -> Self {
        Self {
            clock,
            pending: Pending::default(),
            waiting: AtomicUsize::new(0),
            closed: AtomicBool::new(false),
            reserve: AtomicBool::new(true),
            beat_ns: AtomicU64::new(clock.elapsed().as_nanos() as u64),
            fault: Mutex::new(None),
        }
    }

    /// Time since the loop last went round.
    pub fn heartbeat(&self) -> Duration {
        let beat = Duration::from_nanos(self.beat_ns.load(Ordering::Relaxed));
        self.clock.elapsed().saturating_sub(beat)
    }

    /// Why the last commit failed.
    pub fn fault(&self) -> Option<StoreFault> {
        self.fault.lock().clone()
    }

    fn beat(&self) {
        self.beat_ns.store(self.clock.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }

    fn note(&self, fault: Option<&StoreFault>) {
        *self.fault.lock() = fault.cloned();
    }
}

/// The thread that writes: one transaction, and so one wait for the disk, for all that came while the last one ran.
pub(super) struct Writer {
    pub connection: Connection,
    pub orders: Receiver<Order>,
    pub shown: Arc<Shown>,
    pub ids: Ids,
    pub limits: Limits,
    /// The folder of run folders.
    pub runs: PathBuf,
    pub now: fn() -> Timestamp,
    pub ages: Arc<AgeClock>,
    pub ballast: Ballast,
    pub told: Cell<u64>,
    /// Held as long as anything is written.
    pub lock: Lock,
}

impl Writer {
    /// Writes until it is told to end, or nobody is left who could ask.
    pub fn run(mut self) {
        let mut progress_at = self.shown.clock.elapsed();
        let mut tried_at = progress_at;
        loop {
            let (batch, then) = self.collect();
            self.shown.beat();
            let now = self.shown.clock.elapsed();
            // a jump of the wall clock is seen soon, whether anything is written or not
            self.ages.ages();
            let due =
                now.saturating_sub(progress_at) >= PROGRESS_EVERY || !batch.is_empty() || matches!(then, Then::End(_));
            if due {
                progress_at = now;
            }
            self.ballast.tend(now);
            self.shown.reserve.store(self.ballast.aboard(), Ordering::Relaxed);
            let notes = self.shown.pending.take(due);
            self.write(notes, batch);
            if now.saturating_sub(tried_at) >= TRY_EVERY && self.shown.fault().is_some() {
                tried_at = now;
                // whether it is over is told by a write
                let _ = self.commit_alone(false, |books| {
                    books.tx.execute("UPDATE meta SET clean_shutdown = 0", []).map(|_| ())
                });
            }
            if let Then::End(closing) = then {
                return self.finish(closing);
            }
        }
    }

    /// What is to be written together, and what comes then.
    fn collect(&self) -> (Vec<Box<dyn Task>>, Then) {
        let mut batch = Vec::new();
        let mut order = self.orders.recv_timeout(ROUND);
        loop {
            match order {
                Ok(Order::Do(task)) => batch.push(task),
                Ok(Order::Wake) => {}
                Ok(Order::Close(done)) => return (batch, Then::End(Some(done))),
                Err(RecvTimeoutError::Timeout) => return (batch, Then::GoOn),
                Err(RecvTimeoutError::Disconnected) => return (batch, Then::End(None)),
            }
            if batch.len() == MOST_TOGETHER {
                return (batch, Then::GoOn);
            }
            match self.orders.try_recv() {
                Ok(next) => order = Ok(next),
                // that nobody is left is found out in the next round
                Err(_) => return (batch, Then::GoOn),
            }
        }
    }

    /// All together, and what was noted before a task was given before it; where that fails the notes and each task
    /// alone, so that one's fault is no other's.
    fn write(&mut self, notes: Option<Notes>, mut batch: Vec<Box<dyn Task>>) {
        self.shown.waiting.fetch_sub(batch.len(), Ordering::Relaxed);
        if usize::from(notes.is_some()) + batch.len() > 1 && self.ballast.aboard() {
            let stored = self.commit(|books| {
                notes.iter().try_for_each(|notes| notes.write(books))?;
                batch.iter_mut().try_for_each(|task| task.run(books))
            });
            if stored.is_ok() {
                self.shown.pending.written();
                batch.into_iter().for_each(|task| task.answer(Ok(())));
                return;
            }
        }
        if let Some(notes) = notes {
            self.write_notes(notes);
        }
        for mut task in batch {
            let stored = self.commit_alone(task.is_vital(), |books| task.run(books));
            task.answer(stored);
        }
    }

    /// Notes that could not be written wait on.
    fn write_notes(&mut self, notes: Notes) {
        match self.commit_alone(true, |books| notes.write(books)) {
            Ok(()) => self.shown.pending.written(),
            Err(_) => self.shown.pending.put_back(notes),
        }
    }

    /// On a full disk only vital things are written, and the ballast makes room for them.
    fn commit_alone(
        &mut self,
        vital: bool,
        mut act: impl FnMut(&Books<'_>) -> rusqlite::Result<()>,
    ) -> Result<(), StoreFault> {
        if !vital && !self.ballast.aboard() {
            self.shown.note(Some(&StoreFault::Full));
            return Err(StoreFault::Full);
        }
        let mut stored = self.commit(&mut act);
        if vital && stored == Err(StoreFault::Full) && self.ballast.throw_off() {
            self.shown.reserve.store(false, Ordering::Relaxed);
            stored = self.commit(&mut act);
        }
        if let Err(fault) = &stored {
            self.shown.note(Some(fault));
        }
        stored
    }

    fn commit(&mut self, act: impl FnOnce(&Books<'_>) -> rusqlite::Result<()>) -> Result<(), StoreFault> {
        let before = self.connection.total_changes();
        let tx = self.connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let (now, ages, runs) = ((self.now)(), self.ages.ages(), self.runs.as_path());
        let books = Books { tx: &tx, ids: &self.ids, limits: &self.limits, runs, now, ages, told: &self.told };
        act(&books)?;
        tx.commit()?;
        // reading alone says nothing about the disk
        if self.connection.total_changes() > before {
            self.shown.note(None);
        }
        Ok(())
    }

    /// Ends; in order only when somebody waits for it. Whoever comes later is told that all is over.
    fn finish(mut self, closing: Option<SyncSender<bool>>) {
        self.shown.closed.store(true, Ordering::SeqCst);
        let stored = closing.as_ref().map(|_| self.note_clean());
        let Self { connection, lock, orders, .. } = self;
        drop((connection, lock));
        if let (Some(done), Some(stored)) = (closing, stored) {
            // whoever waited may have given up
            let _ = done.try_send(stored);
        }
        while let Ok(order) = orders.recv() {
            match order {
                Order::Do(task) => task.answer(Err(StoreFault::Closed)),
                Order::Wake => {}
                Order::Close(done) => drop(done.try_send(false)),
            }
        }
    }

    fn note_clean(&mut self) -> bool {
        let clean = |books: &Books<'_>| {
            books.note_uptime()?;
            books.tx.execute("UPDATE meta SET clean_shutdown = 1", []).map(|_| ())
        };
        let stored = self.commit_alone(true, clean).and_then(|()| Ok(restart_log(&self.connection)?));
        if let Err(fault) = &stored {
            tracing::error!("the job store was not closed in order: {fault}");
        }
        stored.is_ok()
    }
}
