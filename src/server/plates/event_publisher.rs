use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::Duration;

use super::events::{EventDraft, JobEvent};
use super::shared::Shared;
use crate::store::{JobId, NewEvent};
use upm_core::background::{Receiver, RecvTimeoutError};

/// How often the publisher looks for a picture to be encoded while no event comes.
const TICK: Duration = Duration::from_millis(100);

/// A message from a plate's thread to its event publisher.
#[derive(Debug)]
pub(super) enum Outgoing {
    /// EventDraft of a job.
    Tell(JobId, EventDraft),
    /// Everything before this is on its way to the store: say so.
    Pass(SyncSender<()>),
    /// The last of all.
    End,
}

/// Tells what its plate does to the store and to those who watch, and encodes pictures. On a thread of its own, so that
/// neither disk nor watchers are ever waited for by the plate.
pub(super) fn publish(shared: &Shared, items: &Receiver<Outgoing>) {
    loop {
        match items.recv_timeout(TICK) {
            Ok(Outgoing::Tell(job, news)) => tell(shared, job, news),
            // whoever waited may be gone
            Ok(Outgoing::Pass(passed)) => drop(passed.try_send(())),
            Ok(Outgoing::End) | Err(RecvTimeoutError::Disconnected) => return,
            Err(RecvTimeoutError::Timeout) => {}
        }
        shared.window.develop();
    }
}

/// Durable events are published once they are on the disk, so that a number a client has seen is never taken back. An event
/// that the store cannot take is published without a number.
fn tell(shared: &Shared, job: JobId, news: EventDraft) {
    let EventDraft { plate_time, kind, body, durable } = news;
    let unnumbered = JobEvent { job, seq: None, kind, body: Arc::clone(&body) };
    if !durable {
        shared.subscribers.offer(&unnumbered);
        return;
    }
    let (subscribers, lost) = (Arc::clone(&shared.subscribers), unnumbered.clone());
    let event = NewEvent { plate_time, kind, body };
    let published = Box::new(move |stored: Result<crate::store::StoredEvent, _>| match stored {
        Ok(stored) => subscribers.offer(&JobEvent { seq: Some(stored.seq), ..lost }),
        Err(_) => subscribers.offer(&lost),
    });
    if !shared.ledger.tell(&job, event, published) {
        shared.subscribers.offer(&unnumbered);
    }
}
