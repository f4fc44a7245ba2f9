//! The HTTP server: connections and their limits, check of origins, tokens, and refusals as problem documents. With the
//! API the only module that uses tokio's runtime; its caller sees a blocking function.

#[cfg(test)]
mod guard_tests;
mod layers;
mod listen;
#[cfg(test)]
mod listen_tests;
mod origin_check;
mod problem;
mod stop_listener;
mod tokens;

pub(crate) use layers::{too_large, with_layers};
pub(crate) use listen::BLOCKING_THREADS;
pub use listen::serve;
pub use origin_check::AllowedHosts;
pub(crate) use problem::PROBLEM_JSON;
pub use problem::{Problem, ProblemDocument, Reason, ReasonCode, joined};
pub use stop_listener::{Confirmations, STOP_PATH, serve_stops};
pub use tokens::{Caller, Scope, Tokens};
