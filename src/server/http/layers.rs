use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::{HeaderValue, StatusCode};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::Response;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::limit::RequestBodyLimitLayer;
use tower_http::timeout::TimeoutLayer;
use tracing::Instrument;
use upm_core::document::MOST_BYTES;
use uuid::Uuid;

use super::origin_check::{AllowedHosts, guard};
use super::problem::{PROBLEM_JSON, Problem};

/// Longest time until an answer starts, the arrival of the request's body included.
const ANSWER_TIME: Duration = Duration::from_secs(10);

/// Adds the layers around `app` that every request passes, the outermost last.
pub(crate) fn with_layers(app: Router, hosts: AllowedHosts) -> Router {
    app.layer(RequestBodyLimitLayer::new(usize::try_from(MOST_BYTES).unwrap_or(usize::MAX)))
        .layer(TimeoutLayer::with_status_code(StatusCode::SERVICE_UNAVAILABLE, ANSWER_TIME))
        .layer(from_fn_with_state(Arc::new(hosts), guard))
        .layer(CatchPanicLayer::new())
        .layer(from_fn(identify))
}

/// The problem of a body above the limit.
pub(crate) fn too_large() -> Problem {
    Problem::new(StatusCode::PAYLOAD_TOO_LARGE, format!("a body has at most {MOST_BYTES} bytes"))
}

/// The problem behind a status that the router or one of the layers answered with alone.
fn problem_of(status: StatusCode) -> Option<Problem> {
    let detail = match status {
        // a path that is not UTF-8 names nothing
        StatusCode::BAD_REQUEST | StatusCode::NOT_FOUND => {
            return Some(Problem::new(StatusCode::NOT_FOUND, "unknown path; see /openapi.json"));
        }
        StatusCode::METHOD_NOT_ALLOWED => "method not allowed; see the Allow header".to_owned(),
        StatusCode::PAYLOAD_TOO_LARGE => return Some(too_large()),
        StatusCode::SERVICE_UNAVAILABLE => format!("no answer within {} s", ANSWER_TIME.as_secs()),
        StatusCode::INTERNAL_SERVER_ERROR => "internal error".to_owned(),
        _ => return None,
    };
    Some(Problem::new(status, detail))
}

/// The outermost layer: assigns the request an id (32 hex digits that sort by time) and writes it into the answer, its
/// problem document and the log. An id sent by the client is ignored: clients must not write log lines.
async fn identify(request: Request, next: Next) -> Response {
    let id = Uuid::now_v7().simple().to_string();
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let span = tracing::trace_span!("request", %method, path);
    let mut response = next.run(request).instrument(span).await;
    let before = response.status();
    if let Some(problem) = response.extensions_mut().remove::<Problem>().or_else(|| problem_of(before)) {
        *response.status_mut() = problem.status();
        *response.body_mut() = problem.body(&id);
        response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
        response.headers_mut().remove(CONTENT_LENGTH);
    }
    if let Ok(value) = HeaderValue::from_str(&id) {
        response.headers_mut().insert("x-request-id", value);
    }
    let status = response.status().as_u16();
    if is_alarming(&path, status) {
        tracing::warn!(request = id, %method, path, status, "request");
    } else {
        tracing::debug!(request = id, %method, path, status, "request");
    }
    response
}

/// True for answers that are logged as warnings. Failed health probes are not, since they come every few seconds.
fn is_alarming(path: &str, status: u16) -> bool {
    let is_probe = path.ends_with("/healthz") || path.ends_with("/readyz");
    status >= 500 && !(is_probe && status == 503)
}
