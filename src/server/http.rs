//! The HTTP server: connections and their limits, check of origins, tokens, and refusals as problem documents. With the
//! API the only module that uses tokio; its caller sees a blocking function.

use std::any::Any;
use std::sync::Arc;

use axum::Router;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use tower_http::catch_panic::CatchPanicLayer;

#[cfg(test)]
mod guard_tests;
mod limits;
mod listen;
#[cfg(test)]
mod listen_tests;
mod origin_check;
mod problem;
mod request_id;
mod stop_listener;
mod tokens;

pub(crate) use limits::{in_time, read_body};
pub(crate) use listen::Peer;
pub use listen::{ShutdownReport, ShutdownSender, ShutdownSignal, serve};
pub use origin_check::AllowedHosts;
pub(crate) use problem::PROBLEM_JSON;
pub use problem::{Problem, ProblemDocument, ProblemKind, Reason, ReasonCode, joined};
pub use stop_listener::{STOP_PATH, serve_stops};
pub use tokens::{Caller, Scope, Tokens};

/// Adds the layers around `app` that every request passes, the outermost last.
pub(crate) fn with_layers(app: Router, hosts: AllowedHosts) -> Router {
    app.layer(from_fn_with_state(Arc::new(hosts), origin_check::guard))
        .layer(from_fn(limits::limit))
        .layer(CatchPanicLayer::custom(panicked))
        .layer(from_fn(request_id::identify))
}

/// The answer of a handler that panics: an internal error of this request alone.
fn panicked(_: Box<dyn Any + Send>) -> Response {
    Problem::new(ProblemKind::Internal, "internal error").into_response()
}
