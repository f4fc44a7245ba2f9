use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use rusqlite::Connection;

use super::StoreFault;
use upm_core::priority::step_back;

/// Questions that may wait.
const MOST_WAITING: usize = 512;

type Question = Box<dyn FnOnce(Result<&Connection, StoreFault>) + Send>;

/// The threads that read. Every question is one short transaction: a long one would keep the log from being emptied.
#[derive(Debug)]
pub(super) struct Readers(SyncSender<Question>);

impl Readers {
    /// One thread for each connection.
    pub fn start(connections: Vec<Connection>) -> Result<Self, StoreFault> {
        let (sender, questions) = sync_channel::<Question>(MOST_WAITING);
        let questions = Arc::new(Mutex::new(questions));
        for connection in connections {
            let questions = Arc::clone(&questions);
            thread::Builder::new().name("store-read".into()).spawn(move || {
                step_back();
                answer(&connection, &questions);
            })?;
        }
        Ok(Self(sender))
    }

    /// Asks `read`, and hands `done` the answer on a reader's thread; at once on this one when too many wait.
    pub fn ask<T: 'static>(
        &self,
        read: impl FnOnce(&Connection) -> Result<T, StoreFault> + Send + 'static,
        done: impl FnOnce(Result<T, StoreFault>) + Send + 'static,
    ) {
        let question: Question = Box::new(move |connection| done(connection.and_then(read)));
        match self.0.try_send(question) {
            Ok(()) => {}
            Err(TrySendError::Full(question)) => question(Err(StoreFault::Busy)),
            Err(TrySendError::Disconnected(question)) => question(Err(StoreFault::Closed)),
        }
    }
}

fn answer(connection: &Connection, questions: &Mutex<Receiver<Question>>) {
    loop {
        let next = questions.lock().unwrap_or_else(PoisonError::into_inner).recv();
        match next {
            Ok(question) => question(Ok(connection)),
            Err(_) => return,
        }
    }
}
