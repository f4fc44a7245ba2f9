use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header::{CONNECTION, CONTENT_LENGTH, EXPECT};
use axum::http::{HeaderMap, HeaderValue, Uri};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use bytes::{Bytes, BytesMut};
use http_body_util::BodyExt;
use tokio::time::timeout;

use super::{Problem, ProblemKind};
use upm_runner::config::MOST_BYTES;

/// Most bytes of an oversized body read before the answer, for clients that read only after they have sent.
const DRAINED_BYTES: usize = 64 << 10;

/// Longest time for that.
const DRAIN_TIME: Duration = Duration::from_millis(500);

/// Limits of requests and connections.
#[derive(Clone, Debug)]
pub struct HttpLimits {
    /// Longest request target, bytes.
    pub uri_bytes: usize,
    /// Largest header, bytes.
    pub header_bytes: usize,
    /// Most header lines.
    pub header_lines: usize,
    /// Largest body, bytes.
    pub body_bytes: usize,
    /// Memory for all bodies together.
    pub bodies: BodyMemoryLimit,
    /// Longest time until the header of a connection's next request is complete.
    pub header_time: Duration,
    /// Longest time for a complete body to arrive.
    pub body_time: Duration,
    /// Longest time until an answer starts.
    pub handler_time: Duration,
    /// Longest time for which a client may accept no bytes of an answer.
    pub stalled_time: Duration,
    /// Most connections at once; further ones wait in the kernel's queue.
    pub connections: usize,
    /// Most event streams at once.
    pub watchers: usize,
    /// Longest silence on an event stream.
    pub heartbeat_time: Duration,
    /// Most recordings sent at once.
    pub downloads: usize,
    /// Longest time for requests under way when the server shuts down.
    pub ending_time: Duration,
}

impl Default for HttpLimits {
    fn default() -> Self {
        Self {
            uri_bytes: 4 << 10,
            header_bytes: 16 << 10,
            header_lines: 64,
            body_bytes: usize::try_from(MOST_BYTES).unwrap_or(usize::MAX),
            bodies: BodyMemoryLimit::of(64 << 20),
            header_time: Duration::from_secs(5),
            body_time: Duration::from_secs(10),
            handler_time: Duration::from_secs(10),
            stalled_time: Duration::from_secs(20),
            connections: 512,
            watchers: 256,
            heartbeat_time: Duration::from_secs(5),
            downloads: 8,
            ending_time: Duration::from_millis(1500),
        }
    }
}

impl HttpLimits {
    /// Reads the body within the limits of size, time and memory. Returns it with its reservation, which must be held
    /// as long as the body is.
    pub(crate) async fn read_body(
        &self,
        headers: &HeaderMap,
        body: Body,
    ) -> Result<(Bytes, BodyMemoryPermit), Problem> {
        let mut room = self.bodies.for_one();
        let announced = headers.get(CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
        if announced.is_some_and(|bytes| bytes > self.body_bytes as u64) {
            // a client that waits for `100 Continue` sends nothing until asked
            if !headers.contains_key(EXPECT) {
                let _ = timeout(DRAIN_TIME, collect(body, DRAINED_BYTES, &mut room)).await;
            }
            return Err(self.too_large());
        }
        match timeout(self.body_time, collect(body, self.body_bytes, &mut room)).await {
            Ok(Ok(bytes)) => Ok((bytes, room)),
            Ok(Err(BodyReadError::TooLarge)) => Err(self.too_large()),
            Ok(Err(BodyReadError::NoRoom)) => {
                let detail = "the bodies of other requests take all the memory there is for them";
                Err(closing(Problem::new(ProblemKind::Unavailable, detail).retry_after(1)))
            }
            Ok(Err(BodyReadError::Broken)) => Err(Problem::new(ProblemKind::Malformed, "the body broke off")),
            Err(_) => {
                let detail = format!("the body was not here after {} s", self.body_time.as_secs_f64());
                Err(closing(Problem::new(ProblemKind::RequestTimeout, detail)))
            }
        }
    }

    fn too_large(&self) -> Problem {
        let detail = format!("a body has at most {} bytes", self.body_bytes);
        closing(Problem::new(ProblemKind::ContentTooLarge, detail))
    }

    /// The answer of `handler`; a problem when it takes too long.
    pub(crate) async fn in_time<T>(&self, handler: impl Future<Output = Result<T, Problem>>) -> Result<T, Problem> {
        timeout(self.handler_time, handler).await.unwrap_or_else(|_| {
            let detail = format!("no answer within {} s", self.handler_time.as_secs_f64());
            Err(Problem::new(ProblemKind::Unavailable, detail).retry_after(5))
        })
    }

    fn check_head(&self, request: &Request) -> Result<(), Problem> {
        if uri_bytes(request.uri()) > self.uri_bytes {
            let detail = format!("an address has at most {} bytes", self.uri_bytes);
            return Err(Problem::new(ProblemKind::UriTooLong, detail));
        }
        let headers = request.headers();
        let line = |(name, value): (_, &HeaderValue)| AsRef::<str>::as_ref(name).len() + value.len() + 4;
        if headers.len() > self.header_lines || headers.iter().map(line).sum::<usize>() > self.header_bytes {
            let detail = format!("a header has at most {} lines and {} bytes", self.header_lines, self.header_bytes);
            return Err(Problem::new(ProblemKind::HeaderTooLarge, detail));
        }
        Ok(())
    }
}

fn uri_bytes(uri: &Uri) -> usize {
    uri.path_and_query().map_or(0, |part| part.as_str().len()) + uri.authority().map_or(0, |part| part.as_str().len())
}

fn closing(problem: Problem) -> Problem {
    problem.with_header(CONNECTION, HeaderValue::from_static("close"))
}

enum BodyReadError {
    TooLarge,
    NoRoom,
    Broken,
}

async fn collect(body: Body, most: usize, room: &mut BodyMemoryPermit) -> Result<Bytes, BodyReadError> {
    let (mut body, mut bytes) = (pin!(body), BytesMut::new());
    while let Some(frame) = body.frame().await {
        let Ok(data) = frame.map_err(|_| BodyReadError::Broken)?.into_data() else { continue };
        if bytes.len() + data.len() > most {
            return Err(BodyReadError::TooLarge);
        }
        // a growing buffer takes up to twice its contents
        if !room.grow_to(2 * (bytes.len() + data.len())) {
            return Err(BodyReadError::NoRoom);
        }
        bytes.extend_from_slice(&data);
    }
    Ok(bytes.freeze())
}

/// The layer that refuses request targets and headers that are too large.
pub async fn limit(State(limits): State<Arc<HttpLimits>>, request: Request, next: Next) -> Response {
    match limits.check_head(&request) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

/// The memory that all request bodies together may take, shared by all copies.
#[derive(Clone, Debug)]
pub struct BodyMemoryLimit(Arc<AtomicUsize>);

impl BodyMemoryLimit {
    /// A memory limit of `bytes`.
    pub fn of(bytes: usize) -> Self {
        Self(Arc::new(AtomicUsize::new(bytes)))
    }

    /// An empty reservation for one body.
    fn for_one(&self) -> BodyMemoryPermit {
        BodyMemoryPermit { room: self.clone(), bytes: 0 }
    }
}

/// The share of one body in a [`BodyMemoryLimit`]; freed on drop.
#[derive(Debug)]
pub(crate) struct BodyMemoryPermit {
    room: BodyMemoryLimit,
    bytes: usize,
}

impl BodyMemoryPermit {
    /// Grows the reservation to `bytes` in total. False when that exceeds the memory left: it then stays as it is.
    fn grow_to(&mut self, bytes: usize) -> bool {
        let more = bytes.saturating_sub(self.bytes);
        let take = |left: usize| left.checked_sub(more);
        let taken = self.room.0.fetch_update(Ordering::AcqRel, Ordering::Acquire, take).is_ok();
        if taken {
            self.bytes += more;
        }
        taken
    }
}

impl Drop for BodyMemoryPermit {
    fn drop(&mut self) {
        self.room.0.fetch_add(self.bytes, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_together_take_no_more_than_the_room() {
        let room = BodyMemoryLimit::of(10);
        let (mut first, mut second) = (room.for_one(), room.for_one());
        assert!(first.grow_to(6) && first.grow_to(3), "a body does not shrink");
        assert!(second.grow_to(4) && !second.grow_to(5));
        drop(first);
        assert!(second.grow_to(10));
    }
}
