use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use bytes::{Bytes, BytesMut};
use futures_util::stream;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use super::backend::Backend;
use super::event_queue::{EventReceiver, StreamEvent, StreamStart, event_queue};
use super::extract::{ApiState, FromPath};
use super::jobs::JobPath;
use crate::http::{Problem, ProblemKind};

pub(super) const EVENT_STREAM: &str = "text/event-stream";
/// Code of the `bye` of a job that has ended: clients do not reconnect after it.
pub const JOB_OVER: &str = "job_over";
const LAST_EVENT_ID: &str = "Last-Event-ID";

/// Most event streams at once.
pub const EVENT_STREAMS: usize = 256;

/// Longest silence on an event stream.
const HEARTBEAT_TIME: Duration = Duration::from_secs(5);

/// Events read from the store at a time.
const PAGE: usize = 500;

/// Streams a job's events: its state, the events missed since the last one the client saw, then new ones. Ends with the
/// job, with the daemon, or with the client.
pub(super) async fn watch(
    State(api): ApiState,
    FromPath(JobPath { id }): FromPath<JobPath>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let after = last_event_id(&headers)?;
    let full = |_| Problem::new(ProblemKind::Unavailable, "too many event streams").retry_after(10);
    let permit = api.event_streams.clone().try_acquire_owned().map_err(full)?;
    let (sender, receiver) = event_queue();
    let stream_start = api.backend.watch(&id, sender).await?;
    let (backend, stop) = (api.backend.clone(), api.stop.clone());
    let stage = StreamPhase::Opening { stream_start, after };
    let watcher = EventStreamWatcher { backend, id, stop, receiver, sent: 0, is_over: false, stage, permit };
    let stream = stream::unfold(watcher, |mut watcher| async {
        let text = watcher.next().await?;
        Some((Ok::<_, std::convert::Infallible>(text), watcher))
    });
    Ok(([(CONTENT_TYPE, EVENT_STREAM)], Body::from_stream(stream)).into_response())
}

fn last_event_id(headers: &HeaderMap) -> Result<Option<u64>, Problem> {
    let mut values = headers.get_all(LAST_EVENT_ID).iter();
    let Some(value) = values.next() else { return Ok(None) };
    let text = value.to_str().unwrap_or_default();
    let is_id = (1..=18).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit()) && values.next().is_none();
    let bad = || Problem::new(ProblemKind::Malformed, format!("{LAST_EVENT_ID} is the number of an event"));
    is_id.then(|| text.parse().ok()).flatten().map(Some).ok_or_else(bad)
}

/// The event stream of one client that watches one job.
struct EventStreamWatcher {
    backend: Arc<dyn Backend>,
    id: String,
    stop: CancellationToken,
    receiver: EventReceiver,
    /// Number of the last stored event that was sent, or that the client does not need.
    sent: u64,
    is_over: bool,
    stage: StreamPhase,
    #[allow(dead_code)] // held for as long as the stream is
    permit: OwnedSemaphorePermit,
}

enum StreamPhase {
    /// Send the state of the job.
    Opening { stream_start: StreamStart, after: Option<u64> },
    /// Send stored events, up to this number.
    Replay { newest: u64 },
    /// Send new events.
    Live,
    /// The stream has ended.
    Ended,
}

impl EventStreamWatcher {
    /// The next part of the stream; `None` at its end.
    async fn next(&mut self) -> Option<Bytes> {
        loop {
            let text = match std::mem::replace(&mut self.stage, StreamPhase::Ended) {
                StreamPhase::Opening { stream_start, after } => self.open(&stream_start, after),
                StreamPhase::Replay { newest } => self.replay(newest).await,
                StreamPhase::Live => self.live().await,
                StreamPhase::Ended => return None,
            };
            if !text.is_empty() {
                return Some(text);
            }
        }
    }

    fn open(&mut self, stream_start: &StreamStart, after: Option<u64>) -> Bytes {
        let mut text = BytesMut::from("retry: 1000\n\n");
        self.is_over = stream_start.is_over;
        self.sent = after.unwrap_or(before_end(stream_start)).min(stream_start.newest);
        // with this id, a client that came without one misses nothing when the stream breaks before the first numbered
        // event
        let id = after.is_none().then_some(self.sent);
        text.extend_from_slice(&StreamEvent::new(id, "snapshot", &stream_start.snapshot).text);
        if let Some(after) = after.filter(|after| *after > stream_start.newest) {
            // the store of that time was lost: its numbers above the newest will be reused for other events
            text.extend_from_slice(&gap(stream_start.newest + 1, after));
        }
        self.stage = if self.sent < stream_start.newest {
            StreamPhase::Replay { newest: stream_start.newest }
        } else {
            StreamPhase::Live
        };
        text.freeze()
    }

    async fn replay(&mut self, newest: u64) -> Bytes {
        let mut text = BytesMut::new();
        match self.backend.replay(&self.id, self.sent, PAGE).await {
            Ok(replayed) => {
                let missing_to = replayed.oldest.saturating_sub(1).min(newest);
                if missing_to > self.sent {
                    text.extend_from_slice(&gap(self.sent + 1, missing_to));
                    self.sent = missing_to;
                }
                let is_end = replayed.events.is_empty();
                for event in replayed.events {
                    self.take(&event, &mut text);
                }
                let is_done = is_end || self.sent >= newest;
                self.stage = if is_done { StreamPhase::Live } else { StreamPhase::Replay { newest } };
            }
            // stored events are not lost: the client reconnects and continues after the last one it has
            Err(_) => return bye("store_silent", "the job store does not answer now"),
        }
        text.freeze()
    }

    /// Writes an event, unless it has been sent already.
    fn take(&mut self, event: &StreamEvent, text: &mut BytesMut) {
        if event.seq.is_some_and(|seq| seq <= self.sent) {
            return;
        }
        self.sent = event.seq.unwrap_or(self.sent);
        self.is_over |= event.is_last;
        text.extend_from_slice(&event.text);
    }

    async fn live(&mut self) -> Bytes {
        if self.is_over {
            return bye(JOB_OVER, "the job is over");
        }
        if self.receiver.is_overrun() {
            return self.reopen().await;
        }
        tokio::select! {
            biased;
            () = self.stop.cancelled() => bye("daemon_ends", "the daemon ends"),
            event = self.receiver.next() => {
                let Some(event) = event else { return feed_closed() };
                let mut text = BytesMut::new();
                self.take(&event, &mut text);
                self.stage = StreamPhase::Live;
                text.freeze()
            }
            () = sleep(HEARTBEAT_TIME) => {
                self.stage = StreamPhase::Live;
                Bytes::from_static(b": hb\n\n")
            }
        }
    }

    /// Restarts the stream of a client that was too slow, with the gap and the state of the job now.
    async fn reopen(&mut self) -> Bytes {
        let (sender, receiver) = event_queue();
        self.receiver = receiver;
        let Ok(stream_start) = self.backend.watch(&self.id, sender).await else {
            return feed_closed();
        };
        let mut text = BytesMut::new();
        let missed_to = before_end(&stream_start);
        if missed_to > self.sent {
            text.extend_from_slice(&gap(self.sent + 1, missed_to));
        }
        text.extend_from_slice(&self.open(&stream_start, None));
        text.freeze()
    }
}

/// Number after which a client without a last event id starts: the newest event, or the one before the last event of an
/// ended job, so that a late client still receives that one.
fn before_end(stream_start: &StreamStart) -> u64 {
    stream_start.newest.saturating_sub(stream_start.is_over.into())
}

/// Notice that the stored events `from` to `to` are missing from this stream.
fn gap(from: u64, to: u64) -> Bytes {
    StreamEvent::new(None, "gap", &format!("{{\"from\":{from},\"to\":{to}}}")).text
}

/// The last event of a stream: a code and a sentence for its end.
fn bye(code: &str, why: &str) -> Bytes {
    StreamEvent::new(None, "bye", &format!("{{\"code\":\"{code}\",\"why\":\"{why}\"}}")).text
}

fn feed_closed() -> Bytes {
    bye("feed_closed", "the daemon reports no more of this job")
}
