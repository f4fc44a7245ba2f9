use std::sync::Arc;

use axum::Router;
use axum::middleware::{from_fn, from_fn_with_state};

mod admission;
mod bodies;
mod descriptors;
mod guard;
#[cfg(test)]
mod guard_tests;
mod head;
mod limits;
mod listen;
#[cfg(test)]
mod listen_tests;
mod problem;
mod reason;
mod request_id;
mod shared_tokens;
mod socket;
mod stop;
mod tokens;

pub use bodies::BodyRoom;
pub use guard::Hosts;
pub use limits::Limits;
pub(super) use listen::Peer;
pub use listen::{Served, serve};
pub(super) use problem::PROBLEM_JSON;
pub use problem::{Problem, ProblemDocument, ProblemKind};
pub use reason::{Reason, ReasonCode, joined};
pub use shared_tokens::SharedTokens;
pub use stop::{StopFlag, StopSender};
pub use tokens::{Caller, Scope, Tokens};

/// Puts the layers round `app` that every request passes, the outermost last.
pub(super) fn enclose(app: Router, hosts: Hosts, limits: Arc<Limits>) -> Router {
    app.layer(from_fn_with_state(Arc::new(hosts), guard::guard))
        .layer(from_fn_with_state(limits, limits::limit))
        .layer(from_fn(limits::catch))
        .layer(from_fn(request_id::identify))
}
