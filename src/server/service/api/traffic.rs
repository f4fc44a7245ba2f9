use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::Response;

use crate::service::http::ProblemKind;

/// Name under which requests without an operation are counted.
const NONE: &str = "none";

/// Counters of requests and event streams, without locks. Copies share them; their number does not depend on what clients
/// send.
#[derive(Clone, Debug)]
pub struct Traffic(Arc<Counts>);

/// Requests that were answered alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Requests {
    /// The operation's name in the OpenAPI document; `none` for requests refused before it was known, or that asked for
    /// none.
    pub operation: &'static str,
    /// The status; 0 for all that the document does not know of.
    pub status: u16,
    /// How many.
    pub count: u64,
}

#[derive(Debug)]
struct Counts {
    rows: Vec<Row>,
    streams: AtomicU64,
}

#[derive(Debug)]
struct Row {
    operation: &'static str,
    counts: Vec<(u16, AtomicU64)>,
}

impl Row {
    fn new(operation: &'static str, statuses: impl IntoIterator<Item = u16>) -> Self {
        let counts = statuses.into_iter().chain([0]).map(|status| (status, AtomicU64::new(0))).collect();
        Self { operation, counts }
    }

    fn count(&self, status: u16) {
        let known = self.counts.iter().find(|(known, _)| *known == status);
        if let Some((_, count)) = known.or(self.counts.last()) {
            count.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl Traffic {
    /// Counts for `operations`, each with the statuses that it can be answered with.
    pub(super) fn of(operations: impl IntoIterator<Item = (&'static str, Vec<u16>)>) -> Self {
        let mut rows: Vec<Row> = operations.into_iter().map(|(id, statuses)| Row::new(id, statuses)).collect();
        rows.push(Row::new(NONE, ProblemKind::ALL.map(|kind| kind.status().as_u16())));
        Self(Arc::new(Counts { rows, streams: AtomicU64::new(0) }))
    }

    /// Requests answered so far, for every operation and every status it can be answered with.
    pub fn requests(&self) -> Vec<Requests> {
        let of_row = |row: &Row| {
            let operation = row.operation;
            let count = |(status, count): &(u16, AtomicU64)| Requests {
                operation,
                status: *status,
                count: count.load(Ordering::Relaxed),
            };
            row.counts.iter().map(count).collect::<Vec<_>>()
        };
        self.0.rows.iter().flat_map(of_row).collect()
    }

    /// Event streams that are open.
    pub fn event_streams(&self) -> u64 {
        self.0.streams.load(Ordering::Relaxed)
    }

    /// Counts an event stream for as long as the answer is kept.
    pub(super) fn stream(&self) -> StreamGauge {
        self.0.streams.fetch_add(1, Ordering::Relaxed);
        StreamGauge(self.0.clone())
    }

    fn count(&self, operation: &str, status: u16) {
        let row = self.0.rows.iter().find(|row| row.operation == operation);
        row.iter().for_each(|row| row.count(status));
    }
}

/// An event stream that is counted.
#[derive(Debug)]
pub(super) struct StreamGauge(Arc<Counts>);

impl Drop for StreamGauge {
    fn drop(&mut self) {
        self.0.streams.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Left in a request by the layer, filled in by the operation it reaches: so the layer knows it whatever becomes of the
/// handler.
#[derive(Clone, Debug, Default)]
pub(super) struct MatchedOperation(Arc<OnceLock<&'static str>>);

impl MatchedOperation {
    /// The request has come to `operation`.
    pub fn note(request: &Request, operation: &'static str) {
        if let Some(Self(reached)) = request.extensions().get() {
            reached.get_or_init(|| operation);
        }
    }
}

/// The layer outside all others: counts every answer.
pub(super) async fn count(State(traffic): State<Traffic>, mut request: Request, next: Next) -> Response {
    let reached = MatchedOperation::default();
    request.extensions_mut().insert(reached.clone());
    let response = next.run(request).await;
    traffic.count(reached.0.get().unwrap_or(&NONE), response.status().as_u16());
    response
}
