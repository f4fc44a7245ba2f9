use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::Duration;

use super::shared::Shared;
use super::told::{News, Told};
use crate::store::{JobId, NewEvent};

/// How often the crier looks whether there is a picture to be encoded, when nothing is told.
const TICK: Duration = Duration::from_millis(100);

/// What a plate's own thread hands to its crier.
#[derive(Debug)]
pub(super) enum Item {
    /// News of a job.
    Tell(JobId, News),
    /// Everything before this is on its way to the store: say so.
    Pass(SyncSender<()>),
    /// The last of all.
    End,
}

/// Tells what its plate does to the store and to those who watch, and encodes pictures. On a thread of its own, so that
/// neither disk nor watchers are ever waited for by the plate.
pub(super) fn cry(shared: &Shared, items: &Receiver<Item>) {
    loop {
        match items.recv_timeout(TICK) {
            Ok(Item::Tell(job, news)) => tell(shared, job, news),
            // whoever waited may be gone
            Ok(Item::Pass(passed)) => drop(passed.try_send(())),
            Ok(Item::End) | Err(RecvTimeoutError::Disconnected) => return,
            Err(RecvTimeoutError::Timeout) => {}
        }
        shared.window.develop();
    }
}

/// What is kept is told once it is on the disk, so that a number somebody has seen is never taken back. What the store
/// cannot take is told without a number.
fn tell(shared: &Shared, job: JobId, news: News) {
    let News { plate_time, kind, body, durable } = news;
    let unnumbered = Told { job, seq: None, kind, body: Arc::clone(&body) };
    if !durable {
        shared.taps.offer(&unnumbered);
        return;
    }
    let (taps, lost) = (Arc::clone(&shared.taps), unnumbered.clone());
    let event = NewEvent { plate_time, kind, body };
    let published = Box::new(move |stored: Result<crate::store::StoredEvent, _>| match stored {
        Ok(stored) => taps.offer(&Told { seq: Some(stored.seq), ..lost }),
        Err(_) => taps.offer(&lost),
    });
    if !shared.ledger.tell(&job, event, published) {
        shared.taps.offer(&unnumbered);
    }
}
