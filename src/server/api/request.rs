use std::collections::BTreeMap;
use std::sync::Arc;

use axum::http::HeaderMap;
use bytes::Bytes;
use tokio::sync::Semaphore;

use super::backend::Backend;
use super::query::{QueryParams, is_job_id};
use crate::http::{Caller, Problem, ProblemKind, ShutdownSignal, Tokens};
use upm_runner::config::is_plain_name;

/// State shared by all requests.
pub(super) struct Api {
    pub backend: Arc<dyn Backend>,
    pub tokens: Arc<Tokens>,
    pub stop: ShutdownSignal,
    pub document: Bytes,
    pub event_streams: Arc<Semaphore>,
    pub downloads: Arc<Semaphore>,
}

/// An admitted request, as its handler receives it.
pub(super) struct RequestContext {
    pub backend: Arc<dyn Backend>,
    pub api: Arc<Api>,
    pub caller: Caller,
    pub headers: HeaderMap,
    pub query: QueryParams,
    pub body: Bytes,
    pub path: BTreeMap<String, String>,
}

impl RequestContext {
    /// The job id in the path. Text that cannot be an id is answered like an unknown job.
    pub fn job_id(&self) -> Result<&str, Problem> {
        let id = self.path.get("id").map_or("", String::as_str);
        is_job_id(id).then_some(id).ok_or_else(|| Problem::new(ProblemKind::NotFound, "there is no such job"))
    }

    /// The plate name in the path. Text that cannot be a name is answered like an unknown plate.
    pub fn plate(&self) -> Result<&str, Problem> {
        let name = self.path.get("name").map_or("", String::as_str);
        is_plain_name(name).then_some(name).ok_or_else(|| Problem::new(ProblemKind::NotFound, "there is no such plate"))
    }

    /// The file of the operator page named in the path.
    pub fn file(&self) -> &str {
        self.path.get("file").map_or("", String::as_str)
    }

    /// The body as text.
    pub fn text(&self) -> Result<&str, Problem> {
        std::str::from_utf8(&self.body).map_err(|error| {
            let found = format!("a byte that is not UTF-8 at offset {}", error.valid_up_to());
            Problem::new(ProblemKind::Malformed, "1 fault").with_fault("$", found, "UTF-8 text")
        })
    }
}
