//! The API: typed routes, from which the OpenAPI document is made, too. It reaches store and plates only through the
//! trait [`Backend`].

use std::sync::Arc;

use aide::openapi::OpenApi;
use axum::Router;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use crate::http::{AllowedHosts, Tokens, with_layers};

mod backend;
mod events;
mod extract;
mod files;
mod jobs;
mod layout;
mod page;
mod plates;
mod routes;
#[cfg(test)]
mod tests;
mod types;

use extract::Api;

pub use backend::{
    Backend, CameraPicture, JobCreated, Pending, Recording, Refusal, Responder, Submission, pending, ready,
};
pub use events::{EVENT_STREAMS, JOB_EVENT};
pub use layout::{Checked, LayoutPartView, LayoutPathView, LayoutView};
pub use types::{EStopped, Job, JobsPage, JobsQuery, Plate, Plates, ResetRequest};

/// Inputs of the API.
pub struct AppParts {
    /// The daemon behind it.
    pub backend: Arc<dyn Backend>,
    /// Accepted tokens.
    pub tokens: Arc<Tokens>,
    /// Host names and addresses under which clients may call it.
    pub hosts: AllowedHosts,
    /// Ends event streams; the same token that ends the server.
    pub stop: CancellationToken,
    /// A permit for each of [`EVENT_STREAMS`].
    pub event_streams: Arc<Semaphore>,
    /// Port of the listener for emergency stops, if there is one: the operator page may call it.
    pub stop_port: Option<u16>,
    /// The program's version.
    pub version: &'static str,
}

/// The complete API as a router, layers included. Needs no socket.
pub fn app(parts: AppParts) -> Router {
    let mut document = OpenApi::default();
    let routes = routes::routes(&parts.tokens);
    let routes = routes.finish_api_with(&mut document, |api| routes::described(api, parts.version));
    let api = Api {
        backend: parts.backend,
        stop: parts.stop,
        document: serde_json::to_vec(&document).unwrap_or_default().into(),
        stop_port: parts.stop_port,
        event_streams: parts.event_streams,
        downloads: Arc::new(Semaphore::new(files::DOWNLOADS)),
    };
    with_layers(routes.with_state(Arc::new(api)), parts.hosts)
}
