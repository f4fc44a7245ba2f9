use std::time::Duration;

use rerun::external::re_uri::ProxyUri;
use rerun::log::LogMsg;
use rerun::sink::{GrpcSink, LogSink};

use upm_core::background::{BackgroundThread, OverflowPolicy, Queue};

/// Capacity of a viewer's queue, messages.
pub(super) const VIEWER_QUEUE: usize = 512;

/// Time for which the end of a run waits for the viewer to take the remaining messages.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(3);

/// A function that passes messages of a recording on to viewers. Never blocks.
pub(super) type MessageSink = Box<dyn FnMut(LogMsg) + Send>;

/// The thread that feeds a viewer. A gRPC sink blocks forever when its viewer is frozen or absent, so it is fed through
/// a queue that drops messages when it is full.
pub(super) struct Live {
    thread: BackgroundThread<bool>,
    queue: Queue<LogMsg>,
}

impl Live {
    /// Starts feeding the viewer at `uri`.
    pub(super) fn start(uri: ProxyUri) -> std::io::Result<(Self, MessageSink)> {
        let (queue, messages) = Queue::bounded(VIEWER_QUEUE, OverflowPolicy::GiveUp);
        let thread = BackgroundThread::start("viewer", false, move || {
            let viewer = GrpcSink::new(uri);
            messages.iter().for_each(|message| viewer.send(message));
            viewer.flush_blocking(CLOSE_TIMEOUT).is_ok()
        })?;
        let fed = queue.clone();
        let feed = Box::new(move |message| {
            fed.send(message).ok();
        });
        Ok((Self { thread, queue }, feed))
    }

    /// Waits briefly for the viewer to take the remaining messages; a stuck thread is abandoned. To be called when
    /// every [`MessageSink`] is dropped. True if the viewer has all messages.
    pub(super) fn finish(self) -> bool {
        let Self { thread, queue } = self;
        let is_whole = queue.lost() == 0;
        drop(queue);
        thread.wait_within(CLOSE_TIMEOUT) == Ok(true) && is_whole
    }
}
