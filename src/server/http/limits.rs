use std::error::Error;
use std::time::Duration;

use axum::body::{Body, HttpBody, to_bytes};
use axum::extract::Request;
use axum::http::{HeaderValue, Uri};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use http_body_util::LengthLimitError;
use tokio::time::timeout;

use super::{Problem, ProblemKind};
use upm_runner::config::MOST_BYTES;

/// Longest request target, bytes.
const URI_BYTES: usize = 4 << 10;

/// Largest header, bytes, and most of its lines.
const HEADER_BYTES: usize = 16 << 10;
const HEADER_LINES: usize = 64;

/// Longest time for a complete body to arrive.
const BODY_TIME: Duration = Duration::from_secs(10);

/// Longest time until an answer starts.
const HANDLER_TIME: Duration = Duration::from_secs(10);

/// Reads the body within the limits of size and time.
pub(crate) async fn read_body(body: Body) -> Result<Bytes, Problem> {
    let too_large = || Problem::new(ProblemKind::ContentTooLarge, format!("a body has at most {MOST_BYTES} bytes"));
    if body.size_hint().lower() > MOST_BYTES {
        return Err(too_large());
    }
    match timeout(BODY_TIME, to_bytes(body, usize::try_from(MOST_BYTES).unwrap_or(usize::MAX))).await {
        Ok(Ok(bytes)) => Ok(bytes),
        Ok(Err(error)) if error.source().is_some_and(|source| source.is::<LengthLimitError>()) => Err(too_large()),
        Ok(Err(_)) => Err(Problem::new(ProblemKind::Malformed, "the body broke off")),
        Err(_) => {
            let detail = format!("the body was not here after {} s", BODY_TIME.as_secs());
            Err(Problem::new(ProblemKind::RequestTimeout, detail))
        }
    }
}

/// The answer of `handler`; a problem when it takes too long.
pub(crate) async fn in_time<T>(handler: impl Future<Output = Result<T, Problem>>) -> Result<T, Problem> {
    timeout(HANDLER_TIME, handler).await.unwrap_or_else(|_| {
        let detail = format!("no answer within {} s", HANDLER_TIME.as_secs());
        Err(Problem::new(ProblemKind::Unavailable, detail).retry_after(5))
    })
}

/// The layer that refuses request targets and headers that are too large.
pub async fn limit(request: Request, next: Next) -> Response {
    match check_head(&request) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    }
}

fn check_head(request: &Request) -> Result<(), Problem> {
    if uri_bytes(request.uri()) > URI_BYTES {
        return Err(Problem::new(ProblemKind::UriTooLong, format!("an address has at most {URI_BYTES} bytes")));
    }
    let headers = request.headers();
    let line = |(name, value): (_, &HeaderValue)| AsRef::<str>::as_ref(name).len() + value.len() + 4;
    if headers.len() > HEADER_LINES || headers.iter().map(line).sum::<usize>() > HEADER_BYTES {
        let detail = format!("a header has at most {HEADER_LINES} lines and {HEADER_BYTES} bytes");
        return Err(Problem::new(ProblemKind::HeaderTooLarge, detail));
    }
    Ok(())
}

fn uri_bytes(uri: &Uri) -> usize {
    uri.path_and_query().map_or(0, |part| part.as_str().len()) + uri.authority().map_or(0, |part| part.as_str().len())
}
