use std::cell::Cell;
use std::fs::File;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::Duration;

use jiff::Timestamp;
use rusqlite::{Connection, TransactionBehavior};

use super::ages::AgeClock;
use super::connection::restart_log;
use super::deferred_writes::Deferred;
use super::ids::Ids;
use super::write_queue::{StoreWriterStatus, WriteRequest, WriterCommand};
use super::write_tx::WriteTx;
use super::{StoreFault, StoreLimits};
use upm_core::files::free_bytes;
use upm_core::time::Clock;

/// Most tasks of one transaction.
const MOST_TOGETHER: usize = 256;

/// Longest duration of a round of the loop without work.
const ROUND: Duration = Duration::from_millis(250);

/// Time between two writes of progress alone.
const PROGRESS_EVERY: Duration = Duration::from_secs(1);

/// Time between two attempts to write after a fault.
const TRY_EVERY: Duration = Duration::from_secs(2);

/// The writer's next step after a round.
enum WriterStep {
    GoOn,
    /// End, and report to the sender, if a caller waits for it.
    End(Option<SyncSender<bool>>),
}

/// The thread that writes: all tasks that arrived during one transaction share the next, and with it one wait for the
/// disk.
pub(super) struct Writer {
    pub connection: Connection,
    pub queue: Receiver<WriterCommand>,
    pub status: Arc<StoreWriterStatus>,
    pub ids: Ids,
    pub limits: StoreLimits,
    pub runs: PathBuf,
    pub now: fn() -> Timestamp,
    pub ages: AgeClock,
    pub uncounted: Cell<u64>,
    /// Held as long as the writer may write.
    pub lock: File,
}

impl Writer {
    /// Writes until it is closed or every sender is gone.
    pub fn run(mut self) {
        let mut progress_at = self.status.clock.elapsed();
        let mut tried_at = progress_at;
        loop {
            self.status.set_free_bytes(free_bytes(&self.runs).ok());
            let (batch, then) = self.collect();
            self.status.beat();
            let now = self.status.clock.elapsed();
            let due = now.saturating_sub(progress_at) >= PROGRESS_EVERY
                || !batch.is_empty()
                || matches!(then, WriterStep::End(_));
            if due {
                progress_at = now;
            }
            let notes = self.status.pending.take(due);
            self.write(notes, batch);
            if now.saturating_sub(tried_at) >= TRY_EVERY && self.status.fault().is_some() {
                tried_at = now;
                // only a write shows whether the fault is over
                let _ =
                    self.commit_alone(|tx| tx.connection.execute("UPDATE meta SET clean_shutdown = 0", []).map(|_| ()));
            }
            if let WriterStep::End(closing) = then {
                return self.finish(closing);
            }
        }
    }

    /// The tasks to be written together, and the step after them.
    fn collect(&self) -> (Vec<Box<dyn WriteRequest>>, WriterStep) {
        let mut batch = Vec::new();
        let mut command = self.queue.recv_timeout(ROUND);
        loop {
            match command {
                Ok(WriterCommand::Write(task)) => batch.push(task),
                Ok(WriterCommand::Wake) => {}
                Ok(WriterCommand::Close(done)) => return (batch, WriterStep::End(Some(done))),
                Err(RecvTimeoutError::Timeout) => return (batch, WriterStep::GoOn),
                Err(RecvTimeoutError::Disconnected) => return (batch, WriterStep::End(None)),
            }
            if batch.len() == MOST_TOGETHER {
                return (batch, WriterStep::GoOn);
            }
            match self.queue.try_recv() {
                Ok(next) => command = Ok(next),
                // the next round detects that every sender is gone
                Err(_) => return (batch, WriterStep::GoOn),
            }
        }
    }

    /// Writes notes and tasks in one transaction, the notes first, since they were added before. If that fails, writes
    /// the notes and each task alone, so that a fault of one does not affect the others.
    fn write(&mut self, notes: Option<Deferred>, mut batch: Vec<Box<dyn WriteRequest>>) {
        self.status.waiting.fetch_sub(batch.len(), Ordering::Relaxed);
        if usize::from(notes.is_some()) + batch.len() > 1 {
            let stored = self.commit(|tx| {
                notes.iter().try_for_each(|notes| notes.write(tx))?;
                batch.iter_mut().try_for_each(|task| task.run(tx))
            });
            if stored.is_ok() {
                self.status.pending.written();
                batch.into_iter().for_each(|task| task.answer(Ok(())));
                return;
            }
        }
        if let Some(notes) = notes {
            self.write_notes(notes);
        }
        for mut task in batch {
            let stored = self.commit_alone(|tx| task.run(tx));
            task.answer(stored);
        }
    }

    /// Writes the notes alone; on a fault they are put back.
    fn write_notes(&mut self, notes: Deferred) {
        match self.commit_alone(|tx| notes.write(tx)) {
            Ok(()) => self.status.pending.written(),
            Err(_) => self.status.pending.put_back(notes),
        }
    }

    /// Commits one write and notes its fault.
    fn commit_alone(&mut self, act: impl FnOnce(&WriteTx<'_>) -> rusqlite::Result<()>) -> Result<(), StoreFault> {
        let stored = self.commit(act);
        if let Err(fault) = &stored {
            self.status.note(Some(fault));
        }
        stored
    }

    fn commit(&mut self, act: impl FnOnce(&WriteTx<'_>) -> rusqlite::Result<()>) -> Result<(), StoreFault> {
        let before = self.connection.total_changes();
        let tx = self.connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let (now, uptime, runs) = ((self.now)(), self.ages.uptime(), self.runs.as_path());
        let write = WriteTx {
            connection: &tx,
            ids: &self.ids,
            limits: &self.limits,
            runs,
            now,
            uptime,
            uncounted: &self.uncounted,
        };
        act(&write)?;
        tx.commit()?;
        // a transaction that only read says nothing about the disk
        if self.connection.total_changes() > before {
            self.status.note(None);
        }
        Ok(())
    }

    /// Ends the writer; in order only when a caller waits for that. Later commands are answered with
    /// [`StoreFault::Closed`].
    fn finish(mut self, closing: Option<SyncSender<bool>>) {
        self.status.closed.store(true, Ordering::SeqCst);
        let stored = closing.as_ref().map(|_| self.note_clean());
        let Self { connection, lock, queue, .. } = self;
        drop((connection, lock));
        if let (Some(done), Some(stored)) = (closing, stored) {
            // the caller may have given up
            let _ = done.try_send(stored);
        }
        while let Ok(command) = queue.recv() {
            match command {
                WriterCommand::Write(task) => task.answer(Err(StoreFault::Closed)),
                WriterCommand::Wake => {}
                WriterCommand::Close(done) => drop(done.try_send(false)),
            }
        }
    }

    fn note_clean(&mut self) -> bool {
        let clean = |tx: &WriteTx<'_>| {
            tx.note_uptime()?;
            tx.connection.execute("UPDATE meta SET clean_shutdown = 1", []).map(|_| ())
        };
        let stored = self.commit_alone(clean).and_then(|()| Ok(restart_log(&self.connection)?));
        if let Err(fault) = &stored {
            tracing::error!("the job store was not closed in order: {fault}");
        }
        stored.is_ok()
    }
}
