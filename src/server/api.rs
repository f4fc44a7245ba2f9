//! The API: typed routes, from which the OpenAPI document is made, too, and the daemon that their handlers act on.

use std::sync::Arc;

use aide::openapi::{OpenApi, Server};
use axum::response::Redirect;
use axum::routing::get;
use axum::{Extension, Router};

use crate::http::{AllowedHosts, with_layers};

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

pub(crate) use health::liveness_failures;
pub(crate) use state::DaemonState;
#[cfg(test)]
pub(crate) use state::EVENT_STREAMS;

pub use crate::store::{Job, JobId};
pub use crate::supervisor::{Observation, Plate};
pub use events::JOB_EVENT;
pub use jobs::JobsPage;
pub use plates::{Plates, ResetRequest};
pub use state::EStopped;

/// The complete API of `daemon` as a router, layers included. Needs no socket.
pub(crate) fn app(daemon: Arc<DaemonState>) -> Router {
    let mut document = OpenApi::default();
    let routes = routes::routes(&daemon.tokens);
    let routes = routes.finish_api_with(&mut document, |api| routes::described(api, daemon.version));
    let base = daemon.spec.base_path.clone();
    let mut hosts = AllowedHosts::new(daemon.spec.listen, &daemon.spec.hosts);
    hosts.base_path.clone_from(&base);
    document.servers.extend((!base.is_empty()).then(|| Server { url: base.clone(), ..Server::default() }));
    let mut routes = routes.with_state(daemon).layer(Extension(Arc::new(document)));
    if !base.is_empty() {
        // addresses in the page are relative to one that ends with `/`
        let page = format!("{base}/");
        routes = Router::new().nest_service(&page, routes).route(&base, get(Redirect::temporary(&page)));
    }
    with_layers(routes, hosts)
}
