use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use bytes::Bytes;
use tokio::sync::mpsc;

/// Events that may wait for one client.
const WAITING: usize = 256;

/// An event of a job, serialized once for all watchers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StreamEvent {
    /// Number within the job; `None` for an event that is not stored.
    pub seq: Option<u64>,
    /// True for the last event of a job.
    pub is_last: bool,
    pub(super) text: Bytes,
}

impl StreamEvent {
    /// `json` is JSON text; `kind` is one word: `state`, `cycle`, `warning`, `recording`, `finished` or `look`.
    pub fn new(seq: Option<u64>, kind: &str, json: &str) -> Self {
        let id = seq.map(|seq| format!("id: {seq}\n")).unwrap_or_default();
        // a line feed would end the field; inside strings JSON writes it as \n, so a literal one is only layout
        let json = json.replace(['\n', '\r'], " ");
        let text = format!("{id}event: {kind}\ndata: {json}\n\n");
        Self { seq, is_last: kind == "finished", text: text.into() }
    }
}

/// State of a job when a client begins to watch it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StreamStart {
    /// Job and plate, as one JSON object on one line.
    pub snapshot: String,
    /// Number of the newest stored event; 0 before the first.
    pub newest: u64,
    /// True when the job has ended and no further event follows.
    pub is_over: bool,
}

/// Stored events of a job above some number.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReplayPage {
    /// Number of the oldest stored event; one past the newest when none is stored.
    pub oldest: u64,
    /// The events, in order.
    pub events: Vec<StreamEvent>,
}

/// The daemon's end of a bounded event queue for one client. An event that finds it full is dropped, and the client is
/// notified of the gap.
#[derive(Clone, Debug)]
pub struct EventSender {
    queue: mpsc::Sender<StreamEvent>,
    overrun: Arc<AtomicBool>,
}

/// The client's end of an [`EventSender`].
#[derive(Debug)]
pub(super) struct EventReceiver {
    queue: mpsc::Receiver<StreamEvent>,
    overrun: Arc<AtomicBool>,
}

pub(super) fn event_queue() -> (EventSender, EventReceiver) {
    let (sender, receiver) = mpsc::channel(WAITING);
    let overrun = Arc::new(AtomicBool::new(false));
    (EventSender { queue: sender, overrun: overrun.clone() }, EventReceiver { queue: receiver, overrun })
}

impl EventSender {
    /// Queues an event without waiting. False when the client is gone: offer it nothing more.
    pub fn offer(&self, event: &StreamEvent) -> bool {
        match self.queue.try_send(event.clone()) {
            Ok(()) => true,
            Err(mpsc::error::TrySendError::Full(_)) => {
                self.overrun.store(true, Ordering::Release);
                true
            }
            Err(mpsc::error::TrySendError::Closed(_)) => false,
        }
    }

    /// True when the client is gone.
    pub fn is_closed(&self) -> bool {
        self.queue.is_closed()
    }
}

impl EventReceiver {
    /// The next event; `None` when the daemon offers no more.
    pub async fn next(&mut self) -> Option<StreamEvent> {
        self.queue.recv().await
    }

    /// True once an event was dropped. The queued events are older than the dropped ones.
    pub fn is_overrun(&self) -> bool {
        self.overrun.load(Ordering::Acquire)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn event_is_written_per_the_sse_standard() {
        assert_eq!(StreamEvent::new(Some(7), "cycle", "{}").text, "id: 7\nevent: cycle\ndata: {}\n\n");
        assert_eq!(StreamEvent::new(None, "look", "{\n\r}").text, "event: look\ndata: {  }\n\n");
    }

    #[tokio::test]
    async fn full_queue_never_blocks_and_is_marked_overrun() {
        let (sender, mut receiver) = event_queue();
        (0..1000).for_each(|seq| assert!(sender.offer(&StreamEvent::new(Some(seq), "cycle", "{}"))));
        assert!(receiver.is_overrun());
        assert_eq!(receiver.next().await.unwrap().seq, Some(0));
        drop(receiver);
        assert!(sender.is_closed() && !sender.offer(&StreamEvent::new(None, "look", "{}")));
    }
}
