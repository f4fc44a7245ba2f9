use std::io;
use std::thread;

use tokio::sync::oneshot;

use upm_core::background::{OverflowPolicy, Queue};

/// Emergency stops that may wait for their confirmation.
const WAITING: usize = 512;

/// Threads of the usual priority that confirm emergency stops: they stand ready, so that a stop needs no new thread,
/// and all others may wait for the disk.
#[derive(Debug)]
pub struct Confirmations(Queue<Box<dyn FnOnce() + Send>>);

impl Confirmations {
    /// Starts `threads` threads with this name, which end when this value is dropped.
    pub fn start(name: &str, threads: usize) -> io::Result<Self> {
        let (queue, waiting) = Queue::<Box<dyn FnOnce() + Send>>::bounded(WAITING, OverflowPolicy::GiveUp);
        for _ in 0..threads {
            let waiting = waiting.clone();
            let confirm = move || waiting.iter().for_each(|confirmation| confirmation());
            thread::Builder::new().name(name.to_owned()).spawn(confirm)?;
        }
        Ok(Self(queue))
    }

    /// The result of `confirm` on one of the threads; `None` when too many others wait.
    pub async fn of<T: Send + 'static>(&self, confirm: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        let (reply, confirmed) = oneshot::channel();
        self.0.send(Box::new(move || drop(reply.send(confirm())))).ok()?;
        confirmed.await.ok()
    }
}
