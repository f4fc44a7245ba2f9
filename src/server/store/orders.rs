use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;

use super::StoreFault;
use super::books::Books;
use super::task::{Task, task};
use super::writer::{Order, Shown};
use upm_core::time::Clock;

/// Time between two tries to have a busy writer close.
const CLOSE_AGAIN: Duration = Duration::from_millis(2);

/// The way to the writer.
#[derive(Clone, Debug)]
pub(super) struct Orders {
    pub sender: SyncSender<Order>,
    pub shown: Arc<Shown>,
}

impl Orders {
    /// Hands a task to the writer, or answers it at once.
    pub fn write(&self, task: Box<dyn Task>) {
        if let Err((task, fault)) = self.offer(task) {
            task.answer(Err(fault));
        }
    }

    /// Hands a task to the writer, or gives it back.
    pub fn offer(&self, task: Box<dyn Task>) -> Result<(), (Box<dyn Task>, StoreFault)> {
        self.shown.waiting.fetch_add(1, Ordering::Relaxed);
        let refused = match self.sender.try_send(Order::Do(task)) {
            Ok(()) => return Ok(()),
            Err(TrySendError::Full(order)) => (order, StoreFault::Busy),
            Err(TrySendError::Disconnected(order)) => (order, StoreFault::Closed),
        };
        self.shown.waiting.fetch_sub(1, Ordering::Relaxed);
        match refused {
            (Order::Do(task), fault) => Err((task, fault)),
            (Order::Wake | Order::Close(_), _) => Ok(()),
        }
    }

    /// Has the writer do something, and waits for it.
    pub fn written<T: Send + 'static>(
        &self,
        vital: bool,
        run: impl FnMut(&Books<'_>) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, StoreFault> {
        let (sender, answer) = sync_channel(1);
        // an answer that nobody waits for any more is no fault
        let task = task(vital, run, move |stored| drop(sender.try_send(stored)));
        self.shown.waiting.fetch_add(1, Ordering::Relaxed);
        if self.sender.send(Order::Do(task)).is_err() {
            self.shown.waiting.fetch_sub(1, Ordering::Relaxed);
            return Err(StoreFault::Closed);
        }
        answer.recv().unwrap_or(Err(StoreFault::Closed))
    }

    /// Says that something is pending. A full queue is no harm: then the writer is awake.
    pub fn wake(&self) {
        let _ = self.sender.try_send(Order::Wake);
    }

    /// Has the writer end; true when it has, in order, `within` that time.
    pub fn close(&self, within: Duration) -> bool {
        let (done, closed) = sync_channel(1);
        let until = self.shown.clock.elapsed() + within;
        let left = || until.saturating_sub(self.shown.clock.elapsed());
        let mut order = Order::Close(done);
        loop {
            match self.sender.try_send(order) {
                Ok(()) => return closed.recv_timeout(left()).unwrap_or(false),
                Err(TrySendError::Full(full)) if !left().is_zero() => order = full,
                Err(_) => return false,
            }
            thread::sleep(CLOSE_AGAIN);
        }
    }
}
