use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;

use parking_lot::Mutex;

use super::StoreFault;
use super::deferred_writes::DeferredWrites;
use super::write_tx::WriteTx;
use upm_core::time::{Clock, MonotonicClock};

/// Tasks that may wait for the writer.
pub(super) const MOST_WAITING: usize = 1024;

/// Free space that could not be measured.
const UNKNOWN: u64 = u64::MAX;

/// Time between two attempts to send a busy writer the command to close.
const CLOSE_AGAIN: Duration = Duration::from_millis(2);

/// A write and the callback that gets its result.
pub(super) trait WriteRequest: Send {
    /// Performs its part of a transaction. Called again from the start after a rollback.
    fn run(&mut self, tx: &WriteTx<'_>) -> rusqlite::Result<()>;

    /// Reports the result of the transaction, once.
    fn answer(self: Box<Self>, stored: Result<(), StoreFault>);
}

impl fmt::Debug for dyn WriteRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Task")
    }
}

/// A [`WriteRequest`] made of two closures.
struct WriteClosure<T, R, D> {
    run: R,
    done: D,
    made: Option<T>,
}

impl<T, R, D> WriteRequest for WriteClosure<T, R, D>
where
    T: Send,
    R: FnMut(&WriteTx<'_>) -> rusqlite::Result<T> + Send,
    D: FnOnce(Result<T, StoreFault>) + Send,
{
    fn run(&mut self, tx: &WriteTx<'_>) -> rusqlite::Result<()> {
        self.made = Some((self.run)(tx)?);
        Ok(())
    }

    fn answer(self: Box<Self>, stored: Result<(), StoreFault>) {
        let Self { done, made, .. } = *self;
        done(stored.and_then(|()| made.ok_or(StoreFault::Closed)));
    }
}

/// A task that runs `run` in a transaction, then passes the result to `done`.
pub(super) fn task<T: Send + 'static>(
    run: impl FnMut(&WriteTx<'_>) -> rusqlite::Result<T> + Send + 'static,
    done: impl FnOnce(Result<T, StoreFault>) + Send + 'static,
) -> Box<dyn WriteRequest> {
    Box::new(WriteClosure { run, done, made: None })
}

/// A command to the writer.
#[derive(Debug)]
pub(super) enum WriterCommand {
    /// Run this task in a transaction.
    Write(Box<dyn WriteRequest>),
    /// Check for pending writes.
    Wake,
    /// Write everything queued, record an orderly shutdown, end, and report whether that succeeded.
    Close(SyncSender<bool>),
}

/// State of the writer that other threads read, and writes that wait without a callback.
#[derive(Debug)]
pub(super) struct StoreWriterStatus {
    pub clock: MonotonicClock,
    pub pending: DeferredWrites,
    pub waiting: AtomicUsize,
    pub closed: AtomicBool,
    /// Free bytes on the disk of the run folders; [`UNKNOWN`] before the first measurement and after one that failed.
    free_bytes: AtomicU64,
    beat_ns: AtomicU64,
    fault: Mutex<Option<StoreFault>>,
}

impl StoreWriterStatus {
    pub fn new(clock: MonotonicClock) -> Self {
        Self {
            clock,
            pending: DeferredWrites::default(),
            waiting: AtomicUsize::new(0),
            closed: AtomicBool::new(false),
            free_bytes: AtomicU64::new(UNKNOWN),
            beat_ns: AtomicU64::new(clock.elapsed().as_nanos() as u64),
            fault: Mutex::new(None),
        }
    }

    /// Time since the loop last completed a round.
    pub fn heartbeat(&self) -> Duration {
        let beat = Duration::from_nanos(self.beat_ns.load(Ordering::Relaxed));
        self.clock.elapsed().saturating_sub(beat)
    }

    /// Free bytes on the disk of the run folders at the last round; `None` when unknown.
    pub fn free_bytes(&self) -> Option<u64> {
        Some(self.free_bytes.load(Ordering::Relaxed)).filter(|free| *free != UNKNOWN)
    }

    pub fn set_free_bytes(&self, free: Option<u64>) {
        self.free_bytes.store(free.unwrap_or(UNKNOWN), Ordering::Relaxed);
    }

    /// Fault of the last commit.
    pub fn fault(&self) -> Option<StoreFault> {
        self.fault.lock().clone()
    }

    pub fn beat(&self) {
        self.beat_ns.store(self.clock.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }

    pub fn note(&self, fault: Option<&StoreFault>) {
        *self.fault.lock() = fault.cloned();
    }
}

/// The sending end of the writer's queue.
#[derive(Clone, Debug)]
pub(super) struct WriteQueue {
    pub sender: SyncSender<WriterCommand>,
    pub status: Arc<StoreWriterStatus>,
}

impl WriteQueue {
    /// Queues a task for the writer; answers it at once when that is not possible.
    pub fn write(&self, task: Box<dyn WriteRequest>) {
        if let Err((task, fault)) = self.offer(task) {
            task.answer(Err(fault));
        }
    }

    /// Queues a task for the writer; on a fault returns it.
    pub fn offer(&self, task: Box<dyn WriteRequest>) -> Result<(), (Box<dyn WriteRequest>, StoreFault)> {
        self.status.waiting.fetch_add(1, Ordering::Relaxed);
        let refused = match self.sender.try_send(WriterCommand::Write(task)) {
            Ok(()) => return Ok(()),
            Err(TrySendError::Full(command)) => (command, StoreFault::Busy),
            Err(TrySendError::Disconnected(command)) => (command, StoreFault::Closed),
        };
        self.status.waiting.fetch_sub(1, Ordering::Relaxed);
        match refused {
            (WriterCommand::Write(task), fault) => Err((task, fault)),
            (WriterCommand::Wake | WriterCommand::Close(_), _) => Ok(()),
        }
    }

    /// Runs `run` in a transaction of the writer, and waits for the result.
    pub fn written<T: Send + 'static>(
        &self,
        run: impl FnMut(&WriteTx<'_>) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, StoreFault> {
        let (sender, answer) = sync_channel(1);
        // the caller may have gone
        let task = task(run, move |stored| drop(sender.try_send(stored)));
        self.status.waiting.fetch_add(1, Ordering::Relaxed);
        if self.sender.send(WriterCommand::Write(task)).is_err() {
            self.status.waiting.fetch_sub(1, Ordering::Relaxed);
            return Err(StoreFault::Closed);
        }
        answer.recv().unwrap_or(Err(StoreFault::Closed))
    }

    /// Notifies the writer of a pending write. A full queue does no harm: then the writer is awake.
    pub fn wake(&self) {
        let _ = self.sender.try_send(WriterCommand::Wake);
    }

    /// Ends the writer; true when it has ended in order `within` that time.
    pub fn close(&self, within: Duration) -> bool {
        let (done, closed) = sync_channel(1);
        let until = self.status.clock.elapsed() + within;
        let left = || until.saturating_sub(self.status.clock.elapsed());
        let mut command = WriterCommand::Close(done);
        loop {
            match self.sender.try_send(command) {
                Ok(()) => return closed.recv_timeout(left()).unwrap_or(false),
                Err(TrySendError::Full(full)) if !left().is_zero() => command = full,
                Err(_) => return false,
            }
            thread::sleep(CLOSE_AGAIN);
        }
    }
}
