//! Background work: bounded queues with an overflow policy, and threads whose result is awaited with a time limit.

use std::fmt;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

pub use crossbeam_channel::{Receiver, RecvTimeoutError};
use crossbeam_channel::{Sender, bounded};
use parking_lot::Mutex;

use crate::thread_priority::lower_thread_priority;

/// Behaviour of a sender whose queue is full.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OverflowPolicy {
    /// The sender waits.
    #[default]
    Wait,
    /// The sender waits for this time, then gives up as below.
    WaitAtMost(Duration),
    /// The sender never waits: the item is lost and counted.
    GiveUp,
}

/// The sending end of a bounded queue. Clones send into the same queue.
#[derive(Clone)]
pub struct Queue<T> {
    items: Sender<T>,
    overflow: OverflowPolicy,
    lost: Arc<AtomicU64>,
}

/// Reason for which an item was not queued.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QueueError {
    /// The queue was full.
    Full,
    /// The receiving end was dropped.
    Closed,
}

impl<T> fmt::Debug for Queue<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Queue").field("overflow", &self.overflow).field("lost", &self.lost).finish_non_exhaustive()
    }
}

impl<T> Queue<T> {
    /// A queue of capacity `room`, and its receiving end.
    pub fn bounded(room: usize, overflow: OverflowPolicy) -> (Self, Receiver<T>) {
        let (items, receiver) = bounded(room);
        (Self { items, overflow, lost: Arc::default() }, receiver)
    }

    /// Sends `item`; when the queue is full, its overflow policy applies.
    ///
    /// # Errors
    /// [`QueueError::Full`] when the queue is full for as long as the policy waits, [`QueueError::Closed`] when the
    /// receiving end was dropped. The item counts as lost.
    pub fn send(&self, item: T) -> Result<(), QueueError> {
        let unsent = |is_full| if is_full { QueueError::Full } else { QueueError::Closed };
        let sent = match self.overflow {
            OverflowPolicy::Wait => self.items.send(item).map_err(|_| QueueError::Closed),
            OverflowPolicy::WaitAtMost(longest) => {
                self.items.send_timeout(item, longest).map_err(|error| unsent(error.is_timeout()))
            }
            OverflowPolicy::GiveUp => self.items.try_send(item).map_err(|error| unsent(error.is_full())),
        };
        sent.inspect_err(|_| {
            self.lost.fetch_add(1, Ordering::Relaxed);
        })
    }

    /// The same queue for a sender with another policy.
    pub fn with_policy(&self, overflow: OverflowPolicy) -> Self {
        Self { overflow, items: self.items.clone(), lost: Arc::clone(&self.lost) }
    }

    /// Number of items lost since the queue was made.
    pub fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

/// A thread that computes one result.
#[derive(Debug)]
pub struct BackgroundThread<T>(Receiver<T>);

/// Reason for which a thread has no result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitError {
    /// The thread has not ended in time; it can be waited for again.
    Hangs,
    /// The thread panicked, or its result was taken before.
    Died,
}

impl<T: Send + 'static> BackgroundThread<T> {
    /// Starts the thread `name`, at lower priority if `steps_back`.
    ///
    /// # Errors
    /// The system's error where it cannot start a thread.
    pub fn start(name: &str, steps_back: bool, work: impl FnOnce() -> T + Send + 'static) -> io::Result<Self> {
        let (report, done) = bounded(1);
        thread::Builder::new().name(name.to_owned()).spawn(move || {
            if steps_back {
                lower_thread_priority();
            }
            report.send(work()).ok();
        })?;
        Ok(Self(done))
    }

    /// Waits for its result: as long as it takes under [`OverflowPolicy::Wait`], else as [`Self::wait_within`].
    ///
    /// # Errors
    /// [`WaitError::Died`] when the thread panicked, and when its result has already been taken.
    pub fn wait_as(&self, overflow: OverflowPolicy, longest: Duration) -> Result<T, WaitError> {
        match overflow {
            OverflowPolicy::Wait => self.0.recv().map_err(|_| WaitError::Died),
            OverflowPolicy::GiveUp | OverflowPolicy::WaitAtMost(_) => self.wait_within(longest),
        }
    }

    /// Waits for its result for at most `longest`.
    ///
    /// # Errors
    /// [`WaitError::Hangs`] when the thread has not ended within that time, [`WaitError::Died`] as [`Self::wait_as`].
    pub fn wait_within(&self, longest: Duration) -> Result<T, WaitError> {
        self.0.recv_timeout(longest).map_err(|fault| match fault {
            RecvTimeoutError::Timeout => WaitError::Hangs,
            RecvTimeoutError::Disconnected => WaitError::Died,
        })
    }
}

/// Runs `work` on every item, on all cores; the results are in the order of the items, whatever the number of cores.
/// `progress` receives the share of the items that are done, 0 to 1.
pub fn on_all_cores<T: Sync, R: Send>(
    items: &[T],
    progress: &(dyn Fn(f64) + Sync),
    work: impl Fn(&T) -> R + Sync,
) -> Vec<R> {
    on_threads(0, items.iter(), progress, work)
}

/// As [`on_all_cores`], for items that are handed over, on up to `threads` threads; 0 is one for each core that the
/// process may use.
pub fn on_threads<I: Send, R: Send>(
    threads: usize,
    items: impl ExactSizeIterator<Item = I> + Send,
    progress: &(dyn Fn(f64) + Sync),
    work: impl Fn(I) -> R + Sync,
) -> Vec<R> {
    let all = items.len();
    let threads = if threads > 0 { threads } else { thread::available_parallelism().map_or(1, |cores| cores.get()) };
    let (waiting, done) = (Mutex::new(items.enumerate()), Mutex::new(Vec::with_capacity(all)));
    let take_turns = || loop {
        let Some((index, item)) = waiting.lock().next() else { break };
        let result = work(item);
        let mut done = done.lock();
        done.push((index, result));
        progress(done.len() as f64 / all as f64);
    };
    thread::scope(|scope| {
        // short work is over before many threads have begun
        for _ in (1..threads.min(all)).take_while(|_| waiting.lock().len() > 0) {
            scope.spawn(take_turns);
        }
        take_turns();
    });
    let mut done = done.into_inner();
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;

    use super::*;

    const LONG: Duration = Duration::from_secs(5);

    #[test]
    fn full_queue_waits_or_loses_as_stated() {
        let (queue, items) = Queue::bounded(1, OverflowPolicy::GiveUp);
        assert_eq!((queue.send(1), queue.send(2), queue.lost()), (Ok(()), Err(QueueError::Full), 1));
        assert_eq!((queue.clone().lost(), items.recv()), (1, Ok(1)));
        drop(items);
        assert_eq!((queue.send(4), queue.lost()), (Err(QueueError::Closed), 2));
        let (patient, items) = Queue::bounded(1, OverflowPolicy::WaitAtMost(LONG));
        thread::scope(|scope| {
            scope.spawn(|| (1..=3).for_each(|item| patient.send(item).unwrap()));
            assert_eq!(items.iter().take(3).collect::<Vec<_>>(), [1, 2, 3]);
        });
        let (impatient, _items) = Queue::bounded(0, OverflowPolicy::WaitAtMost(Duration::from_millis(1)));
        assert_eq!((impatient.send(1), impatient.lost()), (Err(QueueError::Full), 1));
    }

    #[test]
    fn result_of_a_thread_is_waited_for_but_not_for_good() {
        let (go, held) = sync_channel::<()>(0);
        let worker = BackgroundThread::start("slow", false, move || held.recv().is_ok()).unwrap();
        assert_eq!(worker.wait_within(Duration::from_millis(1)), Err(WaitError::Hangs));
        go.send(()).unwrap();
        assert_eq!(worker.wait_as(OverflowPolicy::Wait, LONG), Ok(true));
        let dies = BackgroundThread::<()>::start("dies", true, || panic!("as asked")).unwrap();
        assert_eq!(dies.wait_within(LONG), Err(WaitError::Died));
    }
}
