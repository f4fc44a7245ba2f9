use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::Duration;

use super::events::{EventDraft, JobEvent};
use super::shared::PlateInner;
use crate::store::{JobId, NewEvent};
use upm_core::background::{Receiver, RecvTimeoutError};

/// Interval at which the publisher encodes a waiting picture while no event arrives.
const TICK: Duration = Duration::from_millis(100);

/// A message from a plate's thread to its event publisher.
#[derive(Debug)]
pub(super) enum Outgoing {
    /// Publish this event of a job.
    Event(JobId, EventDraft),
    /// Confirm that everything before this has been passed to the store.
    Pass(SyncSender<()>),
    /// End the publisher; always the last message.
    End,
}

/// Publishes the plate's events to the store and to subscribers, and encodes pictures. Runs on its own thread, so that
/// the plate never waits for the disk or for subscribers.
pub(super) fn publish(shared: &PlateInner, items: &Receiver<Outgoing>) {
    loop {
        match items.recv_timeout(TICK) {
            Ok(Outgoing::Event(job, draft)) => publish_event(shared, job, draft),
            // the waiting thread may be gone
            Ok(Outgoing::Pass(passed)) => drop(passed.try_send(())),
            Ok(Outgoing::End) | Err(RecvTimeoutError::Disconnected) => return,
            Err(RecvTimeoutError::Timeout) => {}
        }
        shared.preview.encode();
    }
}

/// Publishes an event. A durable one is published only once it is on the disk, so that a number a client has seen is
/// never reused; one that the store cannot take is published without a number.
fn publish_event(shared: &PlateInner, job: JobId, draft: EventDraft) {
    let EventDraft { plate_time, kind, body, durable } = draft;
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
    if !shared.job_store.append_event(&job, event, published) {
        shared.subscribers.offer(&unnumbered);
    }
}
