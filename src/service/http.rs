mod problem;
mod request_id;

pub use problem::{Problem, ProblemDocument, ProblemFault, ProblemKind};
pub(super) use request_id::{RequestId, identify};
