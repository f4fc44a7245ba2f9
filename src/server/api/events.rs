//! The event stream of a job: the lines of its journal, as they are flushed to the disk, and the job itself whenever
//! its state changes. An `id` is the byte offset after a line, so a stream that broke goes on there.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::io::SeekFrom;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::http::header::CACHE_CONTROL;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use tokio::fs::File;
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use super::backend::{Backend, Refusal};
use super::extract::{ApiState, FromPath};
use super::jobs::JobPath;
use super::types::Job;
use crate::http::{Problem, ProblemKind};
use crate::states::JobState;

pub(super) const EVENT_STREAM: &str = "text/event-stream";
const LAST_EVENT_ID: &str = "Last-Event-ID";
/// Name of the events whose data is the job, as `GET /v1/jobs/ID` has it. Other events are lines of the journal.
pub const JOB_EVENT: &str = "job";

/// Most event streams at once.
pub const EVENT_STREAMS: usize = 256;

/// Longest silence on an event stream.
const HEARTBEAT_TIME: Duration = Duration::from_secs(5);

/// Interval at which journal and job are looked at, as long as a journal takes to be flushed.
const POLL_INTERVAL: Duration = Duration::from_millis(250);

/// Bytes read from a journal at a time.
const CHUNK_BYTES: u64 = 256 << 10;

/// Longest line of a journal that is sent, bytes; one beyond it ends the stream.
const LONGEST_LINE: usize = 8 << 20;

/// Streams a job's events: its state, the journal from the byte on that the client names, its end. Ends with the job,
/// with the daemon, or with the client.
pub(super) async fn watch(
    State(api): ApiState,
    FromPath(JobPath { id }): FromPath<JobPath>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let after = last_event_id(&headers)?;
    let full = |_| Problem::new(ProblemKind::Unavailable, "too many event streams").retry_after(10);
    let permit = api.event_streams.clone().try_acquire_owned().map_err(full)?;
    // an unknown job is refused before the stream begins
    api.backend.job(&id).await?;
    let watcher = JobWatcher {
        backend: Arc::clone(&api.backend),
        id,
        stop: api.stop.clone(),
        after,
        journal: None,
        state: None,
        ready: VecDeque::new(),
        is_over: false,
        permit,
    };
    let events = stream::unfold(watcher, |mut watcher| async {
        let event = watcher.next().await?;
        Some((Ok::<_, Infallible>(event), watcher))
    });
    let events = Sse::new(events).keep_alive(KeepAlive::new().interval(HEARTBEAT_TIME));
    Ok(([(CACHE_CONTROL, "no-store")], events).into_response())
}

fn last_event_id(headers: &HeaderMap) -> Result<Option<u64>, Problem> {
    let mut values = headers.get_all(LAST_EVENT_ID).iter();
    let Some(value) = values.next() else { return Ok(None) };
    let text = value.to_str().unwrap_or_default();
    let is_id = (1..=18).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit()) && values.next().is_none();
    let bad = || Problem::new(ProblemKind::Malformed, format!("{LAST_EVENT_ID} is the id of an event"));
    is_id.then(|| text.parse().ok()).flatten().map(Some).ok_or_else(bad)
}

/// The event stream of one client that watches one job.
struct JobWatcher {
    backend: Arc<dyn Backend>,
    id: String,
    stop: CancellationToken,
    /// Offset from which the client wants the journal; `None` for its present end.
    after: Option<u64>,
    journal: Option<Journal>,
    /// State of the job that was sent last.
    state: Option<JobState>,
    /// Events to be sent.
    ready: VecDeque<Event>,
    is_over: bool,
    #[allow(dead_code)] // held for as long as the stream is
    permit: OwnedSemaphorePermit,
}

impl JobWatcher {
    /// The next event; `None` at the end of the stream.
    async fn next(&mut self) -> Option<Event> {
        loop {
            if let Some(event) = self.ready.pop_front() {
                return Some(event);
            }
            if self.is_over {
                return None;
            }
            // without an answer the client comes back and goes on after the last line it has
            if self.look().await.is_err() {
                return None;
            }
            if self.ready.is_empty() && !self.is_over {
                tokio::select! {
                    () = self.stop.cancelled() => return None,
                    () = sleep(POLL_INTERVAL) => {}
                }
            }
        }
    }

    /// Takes what is new of job and journal. The job first: all lines of one that has ended are in its journal.
    async fn look(&mut self) -> Result<(), Refusal> {
        let job = self.backend.job(&self.id).await?;
        let (has_ended, is_first) = (job.state.is_final(), self.state.is_none());
        if job.state != JobState::Queued && self.journal.is_none() {
            self.journal = match self.backend.journal(&self.id).await? {
                Some(file) => Journal::open(file, self.after, has_ended).await,
                None => None,
            };
        }
        // a journal that comes later is wanted from its beginning
        self.after.get_or_insert(0);
        // before the lines, except at the end
        if !has_ended && self.state != Some(job.state) {
            self.send_job(&job, is_first);
        }
        let lines = match &mut self.journal {
            Some(journal) => {
                journal.lines().await.ok_or_else(|| Refusal::Broken("the journal has no line".to_owned()))?
            }
            None => Vec::new(),
        };
        let is_read = lines.is_empty();
        self.ready.extend(lines);
        if has_ended && is_read {
            self.send_job(&job, false);
            self.is_over = true;
        }
        Ok(())
    }

    /// Sends the job; with an id, so that a client that came without one misses nothing when the stream breaks before
    /// the first line.
    fn send_job(&mut self, job: &Job, with_id: bool) {
        self.state = Some(job.state);
        // a job is serialized without failure
        let event = Event::default().event(JOB_EVENT).json_data(job).unwrap_or_default();
        let at = self.journal.as_ref().map(|journal| journal.offset).or(self.after).unwrap_or(0);
        self.ready.push_back(if with_id { event.id(at.to_string()) } else { event });
    }
}

/// The journal of a job, read line by line while it grows.
struct Journal {
    file: File,
    /// Offset after the last line that was sent.
    offset: u64,
    /// Bytes read after it.
    rest: Vec<u8>,
}

impl Journal {
    /// The journal from the line on that begins at byte `after`, or from its present end; from its beginning when no
    /// line begins there. One of an ended job that is wanted from its end has nothing to send. `None` when it cannot be
    /// read.
    async fn open(file: std::fs::File, after: Option<u64>, has_ended: bool) -> Option<Self> {
        let file = File::from_std(file);
        let length = file.metadata().await.ok()?.len();
        let mut journal = Self { file, offset: 0, rest: Vec::new() };
        match after {
            Some(after) if (1..=length).contains(&after) => {
                journal.file.seek(SeekFrom::Start(after - 1)).await.ok()?;
                if journal.file.read_u8().await.ok()? == b'\n' {
                    journal.offset = after;
                }
            }
            Some(_) => {}
            None if has_ended => journal.offset = length,
            None => journal.offset = last_line_end(&mut journal.file, length).await?,
        }
        journal.file.seek(SeekFrom::Start(journal.offset)).await.ok()?;
        Some(journal)
    }

    /// The whole lines that were added, as many as fit into a chunk; none when the file cannot be read. `None` for a
    /// line without end.
    async fn lines(&mut self) -> Option<Vec<Event>> {
        loop {
            let read = (&mut self.file).take(CHUNK_BYTES).read_to_end(&mut self.rest).await.unwrap_or(0);
            if let Some(end) = self.rest.iter().rposition(|byte| *byte == b'\n') {
                let left = self.rest.split_off(end + 1);
                let whole = std::mem::replace(&mut self.rest, left);
                return Some(whole.split_inclusive(|byte| *byte == b'\n').map(|line| self.event(line)).collect());
            }
            if read == 0 {
                return (self.rest.len() < LONGEST_LINE).then(Vec::new);
            }
            if self.rest.len() > LONGEST_LINE {
                return None;
            }
        }
    }

    /// The event of a line with its line feed.
    fn event(&mut self, line: &[u8]) -> Event {
        self.offset += line.len() as u64;
        // JSON has no control characters, a damaged file may have
        let text = String::from_utf8_lossy(line).replace(char::is_control, "");
        Event::default().id(self.offset.to_string()).data(text)
    }
}

/// Offset after the last whole line of a journal of that length.
async fn last_line_end(file: &mut File, length: u64) -> Option<u64> {
    let (mut end, mut piece) = (length, Vec::new());
    while end > length.saturating_sub(LONGEST_LINE as u64) {
        let begin = end.saturating_sub(CHUNK_BYTES);
        file.seek(SeekFrom::Start(begin)).await.ok()?;
        piece.clear();
        (&mut *file).take(end - begin).read_to_end(&mut piece).await.ok()?;
        if let Some(at) = piece.iter().rposition(|byte| *byte == b'\n') {
            return Some(begin + at as u64 + 1);
        }
        end = begin;
    }
    Some(0)
}
