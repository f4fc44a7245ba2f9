use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::Response;

use crate::http::ProblemKind;

/// Operation name of requests that reached no operation.
const NONE: &str = "none";

/// Lock-free counters of requests and event streams, shared by all copies. Their number is fixed and does not depend on
/// what clients send.
#[derive(Clone, Debug)]
pub struct HttpMetrics(Arc<Counters>);

/// Number of requests with the same operation and status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Requests {
    /// Name of the operation in the OpenAPI document; `none` for requests refused before it was known, or that match no
    /// operation.
    pub operation: &'static str,
    /// Status of the answers; 0 for every status that the document does not list.
    pub status: u16,
    /// Number of requests.
    pub count: u64,
}

#[derive(Debug)]
struct Counters {
    requests: Vec<Counter>,
    streams: AtomicU64,
}

#[derive(Debug)]
struct Counter {
    operation: &'static str,
    status: u16,
    count: AtomicU64,
}

impl HttpMetrics {
    /// Counters for `operations`, each with the statuses that it can answer with.
    pub(super) fn of(operations: impl IntoIterator<Item = (&'static str, Vec<u16>)>) -> Self {
        let none = (NONE, ProblemKind::ALL.map(|kind| kind.status().as_u16()).to_vec());
        let of_operation = |(operation, statuses): (_, Vec<u16>)| {
            let statuses = statuses.into_iter().chain([0]);
            statuses.map(move |status| Counter { operation, status, count: AtomicU64::new(0) })
        };
        let requests = operations.into_iter().chain([none]).flat_map(of_operation).collect();
        Self(Arc::new(Counters { requests, streams: AtomicU64::new(0) }))
    }

    /// Requests answered so far, for every operation and every status it can answer with.
    pub fn requests(&self) -> Vec<Requests> {
        let requests = |Counter { operation, status, count }: &Counter| {
            let count = count.load(Ordering::Relaxed);
            Requests { operation, status: *status, count }
        };
        self.0.requests.iter().map(requests).collect()
    }

    /// Number of open event streams.
    pub fn event_streams(&self) -> u64 {
        self.0.streams.load(Ordering::Relaxed)
    }

    /// Counts an event stream for as long as the returned value is kept.
    pub(super) fn stream(&self) -> StreamGauge {
        self.0.streams.fetch_add(1, Ordering::Relaxed);
        StreamGauge(self.0.clone())
    }

    fn count(&self, operation: &str, status: u16) {
        let counter = |status| self.0.requests.iter().find(|at| at.operation == operation && at.status == status);
        if let Some(counter) = counter(status).or_else(|| counter(0)) {
            counter.count.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// One counted event stream; dropping it ends the count.
#[derive(Debug)]
pub(super) struct StreamGauge(Arc<Counters>);

impl Drop for StreamGauge {
    fn drop(&mut self) {
        self.0.streams.fetch_sub(1, Ordering::Relaxed);
    }
}

/// The operation that a request reached. The counting layer inserts it and the operation fills it in, so the layer
/// knows the operation even when the handler panics or is dropped.
#[derive(Clone, Debug, Default)]
pub(super) struct MatchedOperation(Arc<OnceLock<&'static str>>);

impl MatchedOperation {
    /// Notes that the request has reached `operation`.
    pub fn note(request: &Request, operation: &'static str) {
        if let Some(Self(reached)) = request.extensions().get() {
            reached.get_or_init(|| operation);
        }
    }
}

/// The outermost layer: counts every answer.
pub(super) async fn count(State(http_metrics): State<HttpMetrics>, mut request: Request, next: Next) -> Response {
    let reached = MatchedOperation::default();
    request.extensions_mut().insert(reached.clone());
    let response = next.run(request).await;
    http_metrics.count(reached.0.get().unwrap_or(&NONE), response.status().as_u16());
    response
}
