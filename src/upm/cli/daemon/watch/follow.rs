use std::io::Read;
use std::thread;
use std::time::Duration;

use super::events::{EventReader, ReceivedEvent};
use super::job_display::job_of;
use crate::cli::daemon::client::{Client, ClientRefusal};

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
