//! The API as one table of operations, from which router and OpenAPI document are made. It reaches store and plates
//! only through the trait [`Backend`].

use std::sync::Arc;

use axum::Router;
use axum::middleware::from_fn_with_state;
use tokio::sync::Semaphore;

use crate::http::{AllowedHosts, ShutdownSignal, Tokens, with_layers};

mod backend;
mod event_queue;
mod events;
mod files;
mod http_metrics;
mod jobs;
mod layout;
mod openapi;
mod operation;
mod plates;
mod query;
mod request;
mod router;
mod routes;
#[cfg(test)]
mod tests;
mod types;

use request::Api;

pub use backend::{
    Asset, Backend, CameraPicture, JobCreated, Pending, Recording, Refusal, Responder, Submission, pending, ready,
};
pub use event_queue::{EventSender, ReplayPage, StreamEvent, StreamStart};
pub use events::JOB_OVER;
pub use http_metrics::{HttpMetrics, Requests};
pub use layout::{Checked, LayoutPartView, LayoutPathView, LayoutView};
pub use query::JobsQuery;
pub use types::{EStopped, Job, JobsPage, Plate, Plates, ResetRequest};

/// Inputs of the API.
pub struct AppParts {
    /// The daemon behind it.
    pub backend: Arc<dyn Backend>,
    /// Accepted tokens.
    pub tokens: Arc<Tokens>,
    /// Host names and addresses under which clients may call it.
    pub hosts: AllowedHosts,
    /// Ends event streams; the same flag that ends the server.
    pub stop: ShutdownSignal,
    /// Counters of requests and event streams.
    pub http_metrics: HttpMetrics,
    /// The program's version.
    pub version: &'static str,
}

impl Default for HttpMetrics {
    fn default() -> Self {
        Self::of(routes::operations().iter().map(|operation| (operation.id, operation.statuses())))
    }
}

/// The complete API as a router, layers included. Needs no socket.
pub fn app(parts: AppParts) -> Router {
    let operations = routes::operations();
    let api = Arc::new(Api {
        backend: parts.backend,
        tokens: parts.tokens,
        stop: parts.stop,
        document: openapi::document(&operations, parts.version).to_string().into(),
        http_metrics: parts.http_metrics.clone(),
        watchers: Arc::new(Semaphore::new(events::WATCHERS)),
        downloads: Arc::new(Semaphore::new(files::DOWNLOADS)),
    });
    let app = with_layers(router::router(operations, &api), parts.hosts);
    app.layer(from_fn_with_state(parts.http_metrics, http_metrics::count))
}
