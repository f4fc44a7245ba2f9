//! The API as one table of operations, from which router and OpenAPI document are made. It reaches store and plates
//! only through the trait [`Backend`].

use std::sync::Arc;

use axum::Router;
use tokio::sync::Semaphore;

use crate::http::{AllowedHosts, ShutdownSignal, Tokens, with_layers};

mod backend;
mod events;
mod files;
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
pub use events::{EVENT_STREAMS, JOB_EVENT};
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
    /// Places for event streams, [`EVENT_STREAMS`].
    pub event_streams: Arc<Semaphore>,
    /// The program's version.
    pub version: &'static str,
}

/// The complete API as a router, layers included. Needs no socket.
pub fn app(parts: AppParts) -> Router {
    let operations = routes::operations();
    let api = Arc::new(Api {
        backend: parts.backend,
        tokens: parts.tokens,
        stop: parts.stop,
        document: openapi::document(&operations, parts.version).to_string().into(),
        event_streams: parts.event_streams,
        downloads: Arc::new(Semaphore::new(files::DOWNLOADS)),
    });
    with_layers(router::router(operations, &api), parts.hosts)
}
