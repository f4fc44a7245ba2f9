use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use parking_lot::Mutex;

use upm_core::priority::step_back;

type Task = Box<dyn FnOnce() + Send>;

/// A few threads for what takes time and nobody may be held up by: checking a job, seeing an emergency stop through.
/// They end when they are let go and have done what waits.
#[derive(Debug)]
pub(super) struct Clerks(SyncSender<Task>);

impl Clerks {
    /// `count` threads called `name`, with room for `waiting` tasks. They step back.
    pub fn hire(name: &str, count: usize, waiting: usize) -> io::Result<Self> {
        Self::start(name, count, waiting, step_back)
    }

    /// The same for what is urgent: they do not step back.
    pub fn hire_urgent(name: &str, count: usize, waiting: usize) -> io::Result<Self> {
        Self::start(name, count, waiting, || ())
    }

    fn start(name: &str, count: usize, waiting: usize, on_start: fn()) -> io::Result<Self> {
        let (sender, tasks) = sync_channel::<Task>(waiting);
        let tasks = Arc::new(Mutex::new(tasks));
        for _ in 0..count {
            let tasks = Arc::clone(&tasks);
            thread::Builder::new().name(name.to_owned()).spawn(move || {
                on_start();
                work(&tasks);
            })?;
        }
        Ok(Self(sender))
    }

    /// Has `task` done, unless too many wait already: then it is dropped, and with it the reply it holds.
    pub fn give(&self, task: impl FnOnce() + Send + 'static) {
        self.0.try_send(Box::new(task)).ok();
    }
}

fn work(tasks: &Mutex<Receiver<Task>>) {
    loop {
        let next = tasks.lock().recv();
        let Ok(task) = next else { return };
        // the reply it held went with it, so nobody waits; the tasks after it want this thread
        if catch_unwind(AssertUnwindSafe(task)).is_err() {
            tracing::error!("a task panicked");
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::RecvTimeoutError;
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_task_that_panics_leaves_its_clerk_to_the_next() {
        let clerks = Clerks::hire("clerk", 1, 2).unwrap();
        let (reply, answered) = sync_channel::<u32>(1);
        clerks.give(move || {
            let _reply = reply;
            panic!("as asked");
        });
        assert_eq!(answered.recv_timeout(Duration::from_secs(5)), Err(RecvTimeoutError::Disconnected));
        let (reply, answered) = sync_channel::<u32>(1);
        clerks.give(move || reply.send(1).unwrap());
        assert_eq!(answered.recv_timeout(Duration::from_secs(5)), Ok(1));
    }

    #[test]
    fn what_does_not_fit_is_dropped_and_the_rest_done() {
        let clerks = Clerks::hire("clerk", 1, 1).unwrap();
        let (hold, held) = sync_channel::<()>(0);
        let (done, seen) = sync_channel::<u32>(8);
        let began = done.clone();
        clerks.give(move || {
            began.send(0).unwrap();
            held.recv().unwrap();
        });
        assert_eq!(seen.recv().unwrap(), 0);
        for number in 1..4 {
            let done = done.clone();
            clerks.give(move || done.send(number).unwrap());
        }
        hold.send(()).unwrap();
        assert_eq!(seen.recv().unwrap(), 1);
        drop((done, clerks));
        assert_eq!(seen.recv_timeout(Duration::from_secs(5)), Err(RecvTimeoutError::Disconnected));
    }
}
