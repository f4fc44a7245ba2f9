mod guard;
#[cfg(test)]
mod guard_tests;
mod problem;
mod request_id;
mod tokens;

pub use guard::Hosts;
pub(super) use guard::guard;
pub use problem::{Problem, ProblemDocument, ProblemFault, ProblemKind};
pub(super) use request_id::{RequestId, identify};
pub use tokens::{Caller, Scope, Tokens};
