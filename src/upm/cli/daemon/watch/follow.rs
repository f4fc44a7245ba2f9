use std::io::{self, BufRead, BufReader, Read};
use std::thread;
use std::time::Duration;

use serde::Deserialize;
use serde_json::Value;

use crate::cli::daemon::client::{Client, ClientRefusal};
use upm_server::api::{JOB_EVENT, Job};

/// Longest line of a stream that is read, bytes. The longest that a daemon sends is a line of a journal.
const LONGEST_LINE: u64 = 16 << 20;

/// Server-sent event.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ReceivedEvent {
    /// Offset in the journal from which the stream can be resumed.
    pub id: Option<u64>,
    /// Name of the event; `message` for a line of the journal.
    pub kind: String,
    /// Payload; null if it is not JSON.
    pub data: Value,
}

/// Parser of server-sent events.
pub(super) struct EventReader<R> {
    lines: BufReader<R>,
}

impl<R: Read> EventReader<R> {
    pub fn new(stream: R) -> Self {
        Self { lines: BufReader::new(stream) }
    }

    /// The next event; `None` at the end of the stream. An event cut short by the end is dropped.
    pub fn next(&mut self) -> io::Result<Option<ReceivedEvent>> {
        let (mut id, mut kind, mut data) = (None, "message".to_owned(), String::new());
        while let Some(line) = self.line()? {
            let (field, value) = line.split_once(':').unwrap_or((&line, ""));
            let value = value.strip_prefix(' ').unwrap_or(value);
            match field {
                "id" => id = value.parse().ok(),
                "event" => value.clone_into(&mut kind),
                "data" => data = if data.is_empty() { value.to_owned() } else { format!("{data}\n{value}") },
                "" if line.is_empty() && !data.is_empty() => {
                    let data = serde_json::from_str(&data).unwrap_or(Value::Null);
                    return Ok(Some(ReceivedEvent { id, kind, data }));
                }
                _ => {}
            }
        }
        Ok(None)
    }

    /// The next complete line, without its terminator.
    fn line(&mut self) -> io::Result<Option<String>> {
        let mut bytes = Vec::new();
        self.lines.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut bytes)?;
        if bytes.pop() != Some(b'\n') {
            let too_long = || io::Error::new(io::ErrorKind::InvalidData, "a line without end");
            return if bytes.len() as u64 + 1 >= LONGEST_LINE { Err(too_long()) } else { Ok(None) };
        }
        if bytes.last() == Some(&b'\r') {
            bytes.pop();
        }
        Ok(Some(String::from_utf8_lossy(&bytes).into_owned()))
    }
}

/// Rest before the first attempt to reconnect, and the longest rest between two.
const FIRST_REST: Duration = Duration::from_millis(if cfg!(test) { 1 } else { 250 });
const LONGEST_REST: Duration = Duration::from_millis(if cfg!(test) { 1 } else { 5000 });

/// Number of attempts to reconnect before giving up, about two minutes.
const MOST_RESTS: u32 = 28;

/// Message about a followed job.
#[derive(Debug)]
pub(super) enum StreamItem {
    Event(ReceivedEvent),
    /// The connection was lost for this reason; reconnecting.
    Lost(String),
    /// The stream cannot be had; this message is the last.
    Refused(ClientRefusal),
}

/// Follows the events of a job across lost connections until it has ended.
pub(super) struct StreamFollower {
    client: Client,
    path: String,
    /// Last id received; reconnecting asks for the journal from there on.
    last: Option<u64>,
    stream: Option<EventReader<Box<dyn Read + Send>>>,
    /// True once the job has ended or the stream was refused.
    has_ended: bool,
    /// Attempts to reconnect since the last message; `None` before the first connection.
    rests: Option<u32>,
}

impl StreamFollower {
    /// Follower of the events at `path` from byte `after` of the journal on; `None` for its end.
    pub fn new(client: Client, path: String, after: Option<u64>) -> Self {
        Self { client, path, last: after, stream: None, has_ended: false, rests: None }
    }

    /// The next message; `None` once the job has ended and every event was returned, or after [`StreamItem::Refused`].
    pub fn next(&mut self) -> Option<StreamItem> {
        if self.stream.is_none() {
            if self.has_ended {
                return None;
            }
            match self.connect() {
                Ok(stream) => self.stream = Some(stream),
                Err(refusal) => {
                    self.has_ended = true;
                    return Some(StreamItem::Refused(refusal));
                }
            }
        }
        let lost = match self.stream.as_mut()?.next() {
            Ok(Some(event)) => return Some(StreamItem::Event(self.take(event))),
            Ok(None) => "the daemon closed the connection".to_owned(),
            Err(error) => format!("the connection is lost: {error}"),
        };
        self.stream = None;
        (!self.has_ended).then_some(StreamItem::Lost(lost))
    }

    /// Connects; retries once there has been a connection.
    fn connect(&mut self) -> Result<EventReader<Box<dyn Read + Send>>, ClientRefusal> {
        loop {
            if let Some(rests) = &mut self.rests {
                thread::sleep((FIRST_REST * 2u32.saturating_pow(*rests)).min(LONGEST_REST));
                *rests += 1;
            }
            match self.client.stream(&self.path, self.last) {
                Ok(stream) => {
                    self.rests.get_or_insert(0);
                    return Ok(EventReader::new(stream));
                }
                Err(refusal) if refusal.may_pass() && self.rests.is_some_and(|rests| rests < MOST_RESTS) => {}
                Err(refusal) => return Err(refusal),
            }
        }
    }

    fn take(&mut self, event: ReceivedEvent) -> ReceivedEvent {
        self.last = event.id.or(self.last);
        match job_of(&event) {
            Some(job) => self.has_ended |= job.state.is_final(),
            // a job proves a connection, not new lines: a daemon that ends every stream after it must not be asked
            // again at once
            None => self.rests = Some(0),
        }
        event
    }
}

/// The job in an event that has one.
pub(super) fn job_of(event: &ReceivedEvent) -> Option<Job> {
    Some(event).filter(|event| event.kind == JOB_EVENT).and_then(|event| Job::deserialize(&event.data).ok())
}
