//! The event stream of a job: the lines of its journal, as they are flushed to the disk, and the job itself whenever
//! its state changes. An `id` is the byte offset after a line, so a stream that broke goes on there.

use std::convert::Infallible;
use std::io::SeekFrom;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::header::{CACHE_CONTROL, HeaderName};
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use tokio::fs::File;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncSeekExt, BufReader};
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::sleep;

use super::extract::{ApiState, one_word};
use super::jobs::JobPath;
use super::state::DaemonState;
use crate::http::{Problem, Scope};
use crate::states::JobState;
use crate::store::open_run_file;

pub(super) const EVENT_STREAM: &str = "text/event-stream";
const NO_BUFFERING: HeaderName = HeaderName::from_static("x-accel-buffering");
const LAST_EVENT_ID: &str = "Last-Event-ID";
/// Name of the events whose data is the job, as `GET /v1/jobs/ID` has it. Other events are lines of the journal.
pub const JOB_EVENT: &str = "job";

/// Longest silence on an event stream.
const HEARTBEAT_TIME: Duration = Duration::from_millis(if cfg!(test) { 200 } else { 5000 });

/// Interval at which journal and job are looked at, as long as a journal takes to be flushed.
const POLL_INTERVAL: Duration = Duration::from_millis(250);

/// Bytes read from a journal at a time. One that runs is read from its last line on if that lies within as many.
const CHUNK_BYTES: u64 = 256 << 10;

/// Longest line of a journal that is sent, bytes; one beyond it ends the stream.
const LONGEST_LINE: u64 = 8 << 20;

/// Streams a job's events: its state, the journal from the byte on that the client names, its end. Ends with the job,
/// with its token, with the daemon, or with the client.
pub(super) async fn watch(
    State(api): ApiState,
    Path(JobPath { id }): Path<JobPath>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let after = last_event_id(&headers)?;
    let full = |_| Problem::busy("too many event streams", 10);
    let permit = api.event_streams.clone().try_acquire_owned().map_err(full)?;
    // an unknown job is refused before the stream begins
    api.on_job(&id, |daemon, id| daemon.row(&id)).await?;
    let watcher = JobWatcher { api, id, headers, after, journal: None, state: None, end: None, is_over: false, permit };
    let events = stream::unfold(watcher, |mut watcher| async {
        let event = watcher.next().await?;
        Some((Ok::<_, Infallible>(event), watcher))
    });
    let events = Sse::new(events).keep_alive(KeepAlive::new().interval(HEARTBEAT_TIME));
    // proxies that collect answers before they pass them on let this one through
    Ok(([(CACHE_CONTROL, "no-store"), (NO_BUFFERING, "no")], events).into_response())
}

fn last_event_id(headers: &HeaderMap) -> Result<Option<u64>, Problem> {
    let Some(text) = one_word(headers, LAST_EVENT_ID, 18)? else { return Ok(None) };
    let is_id = text.bytes().all(|b| b.is_ascii_digit());
    let bad = || Problem::new(StatusCode::BAD_REQUEST, format!("{LAST_EVENT_ID}: expected the id of an event"));
    text.parse().ok().filter(|_| is_id).map(Some).ok_or_else(bad)
}

/// The event stream of one client that watches one job.
struct JobWatcher {
    api: Arc<DaemonState>,
    id: String,
    /// Headers of the request, whose token must hold for as long as the stream lasts.
    headers: HeaderMap,
    /// Offset from which the client wants the journal; `None` for its present end.
    after: Option<u64>,
    journal: Option<Journal>,
    /// State of the job that was seen last.
    state: Option<JobState>,
    /// The last event: the job, once it has ended.
    end: Option<Event>,
    is_over: bool,
    #[allow(dead_code)] // held for as long as the stream is
    permit: OwnedSemaphorePermit,
}

impl JobWatcher {
    /// The next event; `None` at the end of the stream. Without an answer of the store the client comes back and goes
    /// on after the last line it has.
    async fn next(&mut self) -> Option<Event> {
        loop {
            self.api.tokens.admit(&self.headers, Scope::Read).ok()?;
            if let Some(journal) = &mut self.journal
                && let Some(line) = journal.line().await?
            {
                return Some(line);
            }
            if self.end.is_some() || self.is_over {
                self.is_over = true;
                return self.end.take();
            }
            if self.state.is_some() {
                tokio::select! {
                    () = self.api.ending.cancelled() => return None,
                    () = sleep(POLL_INTERVAL) => {}
                }
            }
            if let Some(job) = self.look().await? {
                return Some(job);
            }
        }
    }

    /// Looks at the job, and opens its journal once there is one. All lines of a job that has ended are in its journal
    /// and come before it; an event of another new state comes at once. The first has an id, so that a client that came
    /// without one misses nothing when the stream breaks before the first line. `None` when the store does not answer.
    async fn look(&mut self) -> Option<Option<Event>> {
        let is_open = self.journal.is_some();
        let seen = self.api.on_job(&self.id, move |daemon, id| {
            let row = daemon.row(&id)?;
            let folder = row.folder.as_ref().filter(|_| !is_open).map(|name| daemon.store.runs().join(name));
            let journal = folder.and_then(|folder| open_run_file(&folder, "journal.jsonl").ok());
            Ok((daemon.seen(row), journal))
        });
        let (job, file) = seen.await.ok()?;
        if let Some(file) = file {
            self.journal = Journal::open(file, self.after, job.state.is_final()).await;
        }
        // a journal that comes later is wanted from its beginning
        let after = *self.after.get_or_insert(0);
        let before = self.state.replace(job.state);
        // a job is serialized without failure
        let event = Event::default().event(JOB_EVENT).json_data(&job).unwrap_or_default();
        if job.state.is_final() {
            self.end = Some(event);
            return Some(None);
        }
        let at = self.journal.as_ref().map_or(after, |journal| journal.offset);
        let event = if before.is_none() { event.id(at.to_string()) } else { event };
        Some(Some(event).filter(|_| before != Some(job.state)))
    }
}

/// The journal of a job, read line by line while it grows.
struct Journal {
    file: BufReader<File>,
    /// Offset after the last line that was sent.
    offset: u64,
    /// Bytes read of the line after it.
    rest: Vec<u8>,
}

impl Journal {
    /// The journal from the line on that begins at byte `after`, or from its present end; from its beginning when no
    /// line begins there. One of an ended job that is wanted from its end has nothing to send. `None` when it cannot be
    /// read.
    async fn open(file: std::fs::File, after: Option<u64>, has_ended: bool) -> Option<Self> {
        let mut file = File::from_std(file);
        let length = file.metadata().await.ok()?.len();
        let (from, to) = match after {
            Some(after) if after <= length => (after.saturating_sub(1), after),
            Some(_) => (0, 0),
            None if has_ended => (length, length),
            None => (length.saturating_sub(CHUNK_BYTES), length),
        };
        let mut piece = Vec::new();
        file.seek(SeekFrom::Start(from)).await.ok()?;
        (&mut file).take(to - from).read_to_end(&mut piece).await.ok()?;
        let end = piece.iter().rposition(|byte| *byte == b'\n').map(|at| from + at as u64 + 1);
        let offset = if after.is_none() && has_ended { length } else { end.unwrap_or(0) };
        file.seek(SeekFrom::Start(offset)).await.ok()?;
        Some(Self { file: BufReader::with_capacity(CHUNK_BYTES as usize, file), offset, rest: Vec::new() })
    }

    /// The event of the next whole line; within it `None` when there is none yet. `None` for a file that cannot be read
    /// or has a line without end.
    async fn line(&mut self) -> Option<Option<Event>> {
        let room = LONGEST_LINE - self.rest.len() as u64;
        (&mut self.file).take(room).read_until(b'\n', &mut self.rest).await.ok()?;
        if !self.rest.ends_with(b"\n") {
            return ((self.rest.len() as u64) < LONGEST_LINE).then_some(None);
        }
        self.offset += self.rest.len() as u64;
        // JSON has no control characters, a damaged file may have
        let text = String::from_utf8_lossy(&self.rest).replace(char::is_control, "");
        self.rest.clear();
        Some(Some(Event::default().id(self.offset.to_string()).data(text)))
    }
}
