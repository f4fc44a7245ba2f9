//! The event stream of a job: the lines of its journal, as they are flushed to the disk, and the job itself whenever
//! its state changes. An `id` is the byte offset after a line, so a stream that broke goes on there.

use std::convert::Infallible;
use std::io::SeekFrom;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use tokio::fs::File;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncSeekExt, BufReader};
use tokio::sync::mpsc;
use tokio::time::sleep;

use super::extract::{ApiState, one_word};
use super::jobs::JobPath;
use super::state::DaemonState;
use crate::http::{Problem, Scope};
use crate::store::open_run_file;

pub(super) const EVENT_STREAM: &str = "text/event-stream";
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
    let (sender, events) = mpsc::channel(1);
    tokio::spawn(follow(api, id, headers, after, sender));
    let events = stream::unfold((events, permit), |(mut events, permit)| async {
        let event = events.recv().await?;
        Some((Ok::<_, Infallible>(event), (events, permit)))
    });
    let events = Sse::new(events).keep_alive(KeepAlive::new().interval(HEARTBEAT_TIME));
    // proxies that collect answers before they pass them on let this one through
    Ok(([("cache-control", "no-store"), ("x-accel-buffering", "no")], events).into_response())
}

fn last_event_id(headers: &HeaderMap) -> Result<Option<u64>, Problem> {
    let Some(text) = one_word(headers, LAST_EVENT_ID, 18)? else { return Ok(None) };
    let is_id = text.bytes().all(|b| b.is_ascii_digit());
    let bad = || Problem::new(StatusCode::BAD_REQUEST, format!("{LAST_EVENT_ID}: expected the id of an event"));
    text.parse().ok().filter(|_| is_id).map(Some).ok_or_else(bad)
}

/// Sends the events of a job to one client, who wants its journal from the byte `after` on, or with `None` from its
/// present end. The token in `headers` must hold for as long as the stream lasts. Returns early, with `None`, also when
/// the store does not answer: the client comes back and goes on after the last line it has.
///
/// All lines of a job that has ended are in its journal and come before it; an event of another new state comes at
/// once. The first has an id, so that a client that came without one misses nothing when the stream breaks before the
/// first line.
async fn follow(
    api: Arc<DaemonState>,
    id: String,
    headers: HeaderMap,
    mut after: Option<u64>,
    events: mpsc::Sender<Event>,
) -> Option<()> {
    let (mut journal, mut state) = (None::<Journal>, None);
    loop {
        let is_open = journal.is_some();
        let seen = api.on_job(&id, move |daemon, id| {
            let row = daemon.row(&id)?;
            let folder = row.folder.as_ref().filter(|_| !is_open).map(|name| daemon.store.runs().join(name));
            let journal = folder.and_then(|folder| open_run_file(&folder, "journal.jsonl").ok());
            Ok((daemon.seen(row), journal))
        });
        let (job, file) = seen.await.ok()?;
        let has_ended = job.state.is_final();
        if let Some(file) = file {
            journal = Journal::open(file, after, has_ended).await;
        }
        // a journal that comes later is wanted from its beginning
        let after = *after.get_or_insert(0);
        // a job is serialized without failure
        let mut event = Event::default().event(JOB_EVENT).json_data(&job).unwrap_or_default();
        let before = state.replace(job.state);
        if before.is_none() && !has_ended {
            event = event.id(journal.as_ref().map_or(after, |journal| journal.offset).to_string());
        }
        if before != Some(job.state) && !has_ended {
            events.send(event.clone()).await.ok()?;
        }
        while let Some(journal) = &mut journal
            && let Some(line) = journal.line().await?
        {
            events.send(line).await.ok()?;
            api.tokens.admit(&headers, Scope::Read).ok()?;
        }
        if has_ended {
            return events.send(event).await.ok();
        }
        tokio::select! {
            () = api.ending.cancelled() => return None,
            () = events.closed() => return None,
            () = sleep(POLL_INTERVAL) => {}
        }
        api.tokens.admit(&headers, Scope::Read).ok()?;
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
