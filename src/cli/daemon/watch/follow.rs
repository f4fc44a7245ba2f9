use std::io::Read;
use std::thread;
use std::time::Duration;

use super::events::{Event, Events};
use crate::cli::daemon::client::{Client, Refusal};
use upm_server::service::JOB_OVER;

/// Rest before the first try to come back, and the longest between two.
const FIRST_REST: Duration = Duration::from_millis(250);
const LONGEST_REST: Duration = Duration::from_secs(5);

/// Rests after which a daemon that does not come back is given up, about two minutes.
const MOST_RESTS: u32 = 28;

/// Message about a job that is followed.
#[derive(Debug)]
pub(super) enum Heard {
    Event(Event),
    /// The connection is gone, and why; it is tried again.
    Lost(String),
    /// There is no more to be had.
    Refused(Refusal),
}

/// Follows the events of a job over lost connections until it has ended.
pub(super) struct Follower {
    client: Client,
    path: String,
    /// The last event heard that is kept; later ones are asked for.
    last: Option<u64>,
    stream: Option<Events<Box<dyn Read + Send>>>,
    has_ended: bool,
    is_given_up: bool,
    /// Tries to come back since something was heard; none before the first connection.
    rests: Option<u32>,
    first_rest: Duration,
    longest_rest: Duration,
}

impl Follower {
    /// Of the events at `path` those after `after`, then all that come.
    pub fn new(client: Client, path: String, after: Option<u64>) -> Self {
        let (stream, rests) = (None, None);
        let (first_rest, longest_rest) = (FIRST_REST, LONGEST_REST);
        let (has_ended, is_given_up) = (false, false);
        Self { client, path, last: after, stream, has_ended, is_given_up, rests, first_rest, longest_rest }
    }

    /// The same with shorter rests.
    #[cfg(test)]
    pub fn restless(self) -> Self {
        let rest = Duration::from_millis(1);
        Self { first_rest: rest, longest_rest: rest, ..self }
    }

    /// The next message; `None` once the job has ended and all is told, or there is no more to be had.
    pub fn next(&mut self) -> Option<Heard> {
        if self.is_given_up {
            return None;
        }
        if self.stream.is_none() {
            match self.connect() {
                Ok(stream) => self.stream = Some(stream),
                Err(refusal) => {
                    self.is_given_up = true;
                    return Some(Heard::Refused(refusal));
                }
            }
        }
        let lost = match self.stream.as_mut()?.next() {
            Ok(Some(event)) => return Some(Heard::Event(self.take(event))),
            Ok(None) => "the daemon closed the connection".to_owned(),
            Err(error) => format!("the connection is lost: {error}"),
        };
        self.stream = None;
        (!self.has_ended).then_some(Heard::Lost(lost))
    }

    /// Connects; once there has been a connection, again and again.
    fn connect(&mut self) -> Result<Events<Box<dyn Read + Send>>, Refusal> {
        loop {
            if let Some(rests) = &mut self.rests {
                thread::sleep((self.first_rest * 2u32.saturating_pow(*rests)).min(self.longest_rest));
                *rests += 1;
            }
            match self.client.stream(&self.path, self.last) {
                Ok(stream) => {
                    self.rests.get_or_insert(0);
                    return Ok(Events::new(stream));
                }
                Err(refusal) if refusal.may_pass() && self.rests.is_some_and(|rests| rests < MOST_RESTS) => {}
                Err(refusal) => return Err(refusal),
            }
        }
    }

    fn take(&mut self, event: Event) -> Event {
        self.last = event.id.or(self.last);
        // a snapshot proves a connection, not that anything is new: a daemon that always ends after it is not asked
        // again at once
        if event.kind != "snapshot" && event.kind != "bye" {
            self.rests = Some(0);
        }
        self.has_ended |= event.kind == "finished" || (event.kind == "bye" && event.data["code"] == JOB_OVER);
        event
    }
}
