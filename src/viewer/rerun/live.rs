use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;

use rerun::external::re_uri::ProxyUri;
use rerun::log::LogMsg;
use rerun::sink::{GrpcSink, LogSink};

/// Messages that may wait for the viewer.
const QUEUE: usize = 512;

/// How long the end of a run waits for the viewer to take what is left.
const PATIENCE: Duration = Duration::from_secs(3);

/// Passes what goes into a recording on to whoever watches. Never waits.
pub(super) type Feed = Box<dyn FnMut(LogMsg) + Send>;

/// The sending end towards a viewer. A gRPC sink blocks for good when its viewer is frozen or absent, so it lives on
/// a thread of its own behind a queue that drops.
#[derive(Clone)]
pub(super) struct LiveQueue {
    queue: SyncSender<LogMsg>,
    dropped: Arc<AtomicU64>,
}

impl LiveQueue {
    /// A queue and its receiving end.
    pub(super) fn new() -> (Self, Receiver<LogMsg>) {
        Self::counting(Arc::default())
    }

    /// The same, which counts what it drops in `dropped`.
    pub(super) fn counting(dropped: Arc<AtomicU64>) -> (Self, Receiver<LogMsg>) {
        let (queue, messages) = sync_channel(QUEUE);
        (Self { queue, dropped }, messages)
    }

    /// Passes `message` on, or drops it when the viewer lags, and says so with false. Never waits.
    pub(super) fn offer(&self, message: LogMsg) -> bool {
        let offered = self.queue.try_send(message);
        if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) = offered {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        offered.is_ok()
    }
}

/// The thread that feeds a viewer.
pub(super) struct Live {
    done: Receiver<()>,
    dropped: Arc<AtomicU64>,
}

impl Live {
    /// Starts feeding the viewer at `uri`.
    pub(super) fn start(uri: ProxyUri) -> std::io::Result<(Self, Feed)> {
        let (queue, messages) = LiveQueue::new();
        let (done_tx, done) = sync_channel(1);
        thread::Builder::new().name("viewer".into()).spawn(move || {
            let viewer = GrpcSink::new(uri);
            while let Ok(message) = messages.recv() {
                viewer.send(message);
            }
            if viewer.flush_blocking(PATIENCE).is_ok() {
                done_tx.try_send(()).ok();
            }
        })?;
        let dropped = Arc::clone(&queue.dropped);
        let feed = Box::new(move |message| {
            queue.offer(message);
        });
        Ok((Self { done, dropped }, feed))
    }

    /// Waits a little for the viewer to take the rest; a stuck thread is left behind. Call when every
    /// [`Feed`] is gone. Messages dropped, and whether the viewer has all others.
    pub(super) fn finish(self) -> (u64, bool) {
        let caught_up = self.done.recv_timeout(PATIENCE).is_ok();
        (self.dropped.load(Ordering::Relaxed), caught_up)
    }
}
