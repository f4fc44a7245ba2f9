use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;

use parking_lot::Mutex;

use rusqlite::Connection;

use super::StoreFault;
use upm_core::thread_priority::lower_thread_priority;
use upm_core::time::Clock;

/// Most reads that may wait.
const MOST_WAITING: usize = 512;

type ReadRequest = Box<dyn FnOnce(Result<&Connection, StoreFault>) + Send>;

/// The threads that read. Every read is one short transaction: a long one would prevent the log from being emptied.
pub(super) struct Readers {
    questions: SyncSender<ReadRequest>,
    clock: Arc<dyn Clock + Send + Sync>,
    busy: Vec<Arc<ReaderBusy>>,
}

/// Time at which a reader took its current read, µs on the clock and at least 1; 0 while it is idle. A reader that died
/// keeps the time of its last read.
type ReaderBusy = AtomicU64;

impl Readers {
    /// Starts one thread for each connection.
    pub fn start(connections: Vec<Connection>, clock: Arc<dyn Clock + Send + Sync>) -> Result<Self, StoreFault> {
        let (sender, questions) = sync_channel::<ReadRequest>(MOST_WAITING);
        let questions = Arc::new(Mutex::new(questions));
        let mut readers = Self { questions: sender, clock, busy: Vec::new() };
        for connection in connections {
            let (questions, clock, busy) =
                (Arc::clone(&questions), Arc::clone(&readers.clock), Arc::<ReaderBusy>::default());
            readers.busy.push(Arc::clone(&busy));
            thread::Builder::new().name("store-read".into()).spawn(move || {
                lower_thread_priority();
                answer(&connection, &questions, &*clock, &busy);
            })?;
        }
        Ok(readers)
    }

    /// Longest time that a reader has spent on its current read.
    pub fn busy(&self) -> Duration {
        let now = self.clock.elapsed();
        let since = self.busy.iter().map(|busy| busy.load(Ordering::Relaxed)).filter(|since| *since > 0).min();
        since.map_or(Duration::ZERO, |since| now.saturating_sub(Duration::from_micros(since)))
    }

    /// Queues `read`; a reader's thread passes the answer to `done`. When too many reads wait, `done` is called at once
    /// on this thread.
    pub fn ask<T: 'static>(
        &self,
        read: impl FnOnce(&Connection) -> rusqlite::Result<T> + Send + 'static,
        done: impl FnOnce(Result<T, StoreFault>) + Send + 'static,
    ) {
        let question: ReadRequest =
            Box::new(move |connection| done(connection.and_then(|connection| Ok(read(connection)?))));
        match self.questions.try_send(question) {
            Ok(()) => {}
            Err(TrySendError::Full(question)) => question(Err(StoreFault::Busy)),
            Err(TrySendError::Disconnected(question)) => question(Err(StoreFault::Closed)),
        }
    }
}

fn answer(connection: &Connection, questions: &Mutex<Receiver<ReadRequest>>, clock: &dyn Clock, busy: &ReaderBusy) {
    loop {
        let next = questions.lock().recv();
        match next {
            Ok(question) => {
                let now = u64::try_from(clock.elapsed().as_micros()).unwrap_or(u64::MAX);
                busy.store(now.max(1), Ordering::Relaxed);
                question(Ok(connection));
                busy.store(0, Ordering::Relaxed);
            }
            Err(_) => return,
        }
    }
}
