//! The API: typed routes, from which the OpenAPI document is made, too, and the daemon that their handlers act on.

use std::sync::Arc;

use aide::openapi::OpenApi;
use axum::Router;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use crate::http::{AllowedHosts, Confirmations, Tokens, with_layers};

mod events;
mod extract;
mod files;
mod health;
mod jobs;
mod metrics;
mod page;
mod plates;
mod routes;
mod state;
mod submit;
mod types;

use extract::Api;

pub(crate) use health::liveness_failures;
pub(crate) use state::DaemonState;
#[cfg(test)]
pub(crate) use state::EVENT_STREAMS;

pub use crate::store::Job;
pub use crate::supervisor::{LayoutPartView, LayoutPathView, LayoutView, Plate};
pub use events::JOB_EVENT;
pub use types::{Checked, EStopped, JobsPage, JobsQuery, Plates, ResetRequest};

/// The complete API of `daemon` as a router, layers included. Needs no socket. `stop` ends event streams, as it ends
/// the server.
pub(crate) fn app(
    daemon: Arc<DaemonState>,
    tokens: &Arc<Tokens>,
    confirmations: Confirmations,
    stop: CancellationToken,
) -> Router {
    let mut document = OpenApi::default();
    let routes = routes::routes(tokens);
    let routes = routes.finish_api_with(&mut document, |api| routes::described(api, daemon.version));
    let hosts = AllowedHosts::new(daemon.spec.listen, &daemon.spec.hosts);
    let api = Api {
        daemon,
        stop,
        document: serde_json::to_vec(&document).unwrap_or_default().into(),
        checks: Arc::new(Semaphore::new(extract::CHECKS)),
        confirmations,
        downloads: Arc::new(Semaphore::new(files::DOWNLOADS)),
    };
    with_layers(routes.with_state(Arc::new(api)), hosts)
}
