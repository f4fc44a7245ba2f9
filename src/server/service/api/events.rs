use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::http::HeaderMap;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use bytes::{Bytes, BytesMut};
use futures_util::stream;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::sleep;

use super::desk::Desk;
use super::feed::{Event, EventReceiver, Opening, feed};
use super::request::Call;
use super::traffic::StreamGauge;
use crate::service::http::{Problem, ProblemKind, StopFlag};

pub(super) const EVENT_STREAM: &str = "text/event-stream";
/// Code of the `bye` of a job that has ended: its stream is not asked for again.
pub const JOB_OVER: &str = "job_over";
pub(super) const LAST_EVENT_ID: &str = "Last-Event-ID";

/// Events read from the store at once.
const PAGE: usize = 500;

/// Streams the job's events: how it stands, what was missed since the last event seen, what happens. Ends with the
/// job, with the daemon, or with the client.
pub(super) async fn watch(call: Call) -> Result<Response, Problem> {
    let id = call.job_id()?.to_owned();
    let after = last_event_id(&call.headers)?;
    let permit = call.api.watchers.clone().try_acquire_owned();
    let full = |_| Problem::new(ProblemKind::Unavailable, "too many event streams").retry_after(10);
    let counted = (permit.map_err(full)?, call.api.traffic.stream());
    let (feed, receiver) = feed();
    let opening = call.desk.watch(&id, feed).await?;
    let (stop, heartbeat) = (call.api.stop.clone(), call.api.limits.heartbeat_time);
    let stage = Stage::Opening { opening, after };
    let watcher = Watcher { desk: call.desk, id, stop, heartbeat, receiver, sent: 0, is_over: false, stage, counted };
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

/// One client that watches one job.
struct Watcher {
    desk: Arc<dyn Desk>,
    id: String,
    stop: StopFlag,
    heartbeat: Duration,
    receiver: EventReceiver,
    /// Number of the last kept event that was sent, or that the client has no need of.
    sent: u64,
    is_over: bool,
    stage: Stage,
    #[allow(dead_code)] // held for as long as the stream is
    counted: (OwnedSemaphorePermit, StreamGauge),
}

enum Stage {
    /// Send the state of the job.
    Opening { opening: Opening, after: Option<u64> },
    /// Send what is kept, up to this number.
    Replay { newest: u64 },
    /// Send what happens.
    Live,
    /// Nothing more.
    Ended,
}

impl Watcher {
    /// The next piece of the stream; `None` at its end.
    async fn next(&mut self) -> Option<Bytes> {
        loop {
            let text = match std::mem::replace(&mut self.stage, Stage::Ended) {
                Stage::Opening { opening, after } => self.open(&opening, after),
                Stage::Replay { newest } => self.replay(newest).await,
                Stage::Live => self.live().await,
                Stage::Ended => return None,
            };
            if !text.is_empty() {
                return Some(text);
            }
        }
    }

    fn open(&mut self, opening: &Opening, after: Option<u64>) -> Bytes {
        let mut text = BytesMut::from("retry: 1000\n\n");
        self.is_over = opening.is_over;
        self.sent = after.unwrap_or(before_end(opening)).min(opening.newest);
        // who comes without a number loses nothing when the stream breaks off before the first event that has one
        let id = after.is_none().then_some(self.sent);
        text.extend_from_slice(&Event::new(id, "snapshot", &opening.snapshot).text);
        if let Some(after) = after.filter(|after| *after > opening.newest) {
            // the store of then is gone: those numbers will be given to other events
            text.extend_from_slice(&gap(opening.newest + 1, after));
        }
        self.stage = if self.sent < opening.newest { Stage::Replay { newest: opening.newest } } else { Stage::Live };
        text.freeze()
    }

    async fn replay(&mut self, newest: u64) -> Bytes {
        let mut text = BytesMut::new();
        match self.desk.replay(&self.id, self.sent, PAGE).await {
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
                self.stage = if is_done { Stage::Live } else { Stage::Replay { newest } };
            }
            // what is kept can be had later: the client comes back and goes on from what it has
            Err(_) => return bye("store_silent", "the job store does not answer now"),
        }
        text.freeze()
    }

    /// Writes an event that has not been sent.
    fn take(&mut self, event: &Event, text: &mut BytesMut) {
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
            () = self.stop.stopped() => bye("daemon_ends", "the daemon ends"),
            event = self.receiver.next() => {
                let Some(event) = event else { return feed_closed() };
                let mut text = BytesMut::new();
                self.take(&event, &mut text);
                self.stage = Stage::Live;
                text.freeze()
            }
            () = sleep(self.heartbeat) => {
                self.stage = Stage::Live;
                Bytes::from_static(b": hb\n\n")
            }
        }
    }

    /// Restarts a client that was too slow, with the gap and the state of the job now.
    async fn reopen(&mut self) -> Bytes {
        let (feed, receiver) = feed();
        self.receiver = receiver;
        let Ok(opening) = self.desk.watch(&self.id, feed).await else {
            return feed_closed();
        };
        let mut text = BytesMut::new();
        let missed_to = before_end(&opening);
        if missed_to > self.sent {
            text.extend_from_slice(&gap(self.sent + 1, missed_to));
        }
        text.extend_from_slice(&self.open(&opening, None));
        text.freeze()
    }
}

/// The newest event that is not told to who comes now: who comes after the end is told of it all the same, and it is
/// the last event.
fn before_end(opening: &Opening) -> u64 {
    opening.newest.saturating_sub(opening.is_over.into())
}

/// Kept events `from` to `to` will not come on this stream.
fn gap(from: u64, to: u64) -> Bytes {
    Event::new(None, "gap", &format!("{{\"from\":{from},\"to\":{to}}}")).text
}

/// The last event of a stream: why it ends, for programs and for a person.
fn bye(code: &str, why: &str) -> Bytes {
    Event::new(None, "bye", &format!("{{\"code\":\"{code}\",\"why\":\"{why}\"}}")).text
}

fn feed_closed() -> Bytes {
    bye("feed_closed", "the daemon tells no more of this job")
}
