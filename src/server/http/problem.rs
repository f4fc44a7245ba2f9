use axum::Extension;
use axum::body::Body;
use axum::http::header::RETRY_AFTER;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use upm_core::document::{Diagnostic, DiagnosticClass, counted};

/// Media type of problem documents.
pub(crate) const PROBLEM_JSON: &str = "application/problem+json";

/// Cause for which the daemon does not work or takes no jobs. Codes are stable; the sentence beside one may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReasonCode {
    /// The job store has not answered for too long.
    StoreHangs,
    /// A thread that runs or watches the plates has died or hangs.
    PlatesDead,
    /// The daemon is shutting down.
    Ending,
    /// The last write of the job store failed.
    StoreUnwritable,
    /// The disk has too little free space for a job.
    DiskLow,
    /// An emergency stop holds on every plate.
    AllStopped,
}

/// A cause for which the daemon does not work or takes no jobs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Reason {
    /// Stable code for programs.
    pub code: ReasonCode,
    /// Sentence for people.
    pub detail: String,
}

impl Reason {
    /// A cause with its sentence.
    pub fn new(code: ReasonCode, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into() }
    }
}

/// The sentences of all reasons on one line.
pub fn joined(reasons: &[Reason]) -> String {
    reasons.iter().map(|reason| reason.detail.as_str()).collect::<Vec<_>>().join("; ")
}

/// A problem document (RFC 9457) without a `type`: the status says the kind.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ProblemDocument {
    /// Name of the status.
    pub title: String,
    /// HTTP status of the answer.
    #[schemars(range(min = 400, max = 599))]
    pub status: u16,
    /// Details of this occurrence, with the remedy.
    pub detail: String,
    /// Id of this request, as in the header `X-Request-Id` and in the log.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instance: Option<String>,
    /// Every fault of the request, where it was invalid.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<Diagnostic>,
    /// Reasons of the daemon's state, where that causes a 503.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<Reason>,
}

/// A failed request. The outermost layer makes the problem document, with the request's id.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    status: StatusCode,
    document: Box<ProblemDocument>,
    headers: HeaderMap,
}

impl Problem {
    /// A problem answered with this status; `detail` is a sentence for people.
    pub fn new(status: StatusCode, detail: impl Into<String>) -> Self {
        let document = ProblemDocument {
            title: status.canonical_reason().unwrap_or_default().to_owned(),
            status: status.as_u16(),
            detail: detail.into(),
            ..ProblemDocument::default()
        };
        Self { status, document: Box::new(document), headers: HeaderMap::new() }
    }

    /// The problem of a document with these faults: 400 for text that is not JSON, otherwise 422.
    pub fn of_document(faults: Vec<Diagnostic>) -> Self {
        let is_json = faults.iter().all(|fault| fault.class != DiagnosticClass::Syntax);
        Self::of_faults(if is_json { StatusCode::UNPROCESSABLE_ENTITY } else { StatusCode::BAD_REQUEST }, faults)
    }

    /// The problem of a request with these faults.
    pub fn of_faults(status: StatusCode, faults: Vec<Diagnostic>) -> Self {
        let mut problem = Self::new(status, counted(faults.len(), "fault"));
        problem.document.faults = faults;
        problem
    }

    /// The problem of a daemon in this state.
    pub fn of_reasons(reasons: Vec<Reason>) -> Self {
        let mut problem = Self::new(StatusCode::SERVICE_UNAVAILABLE, joined(&reasons));
        problem.document.reasons = reasons;
        problem
    }

    /// A problem that may be gone after this time, s.
    pub fn busy(detail: impl Into<String>, retry_after_s: u32) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, detail).with_header(RETRY_AFTER, retry_after_s.into())
    }

    /// Adds a header.
    pub fn with_header(mut self, name: HeaderName, value: HeaderValue) -> Self {
        self.headers.insert(name, value);
        self
    }

    /// Status of the answer.
    pub fn status(&self) -> StatusCode {
        self.status
    }

    /// The document for the request with the id `instance`, as the body of an answer.
    pub(super) fn body(mut self, instance: &str) -> Body {
        self.document.instance = Some(format!("urn:upm:request:{instance}"));
        Body::from(serde_json::to_vec(&self.document).unwrap_or_default())
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let headers = self.headers.clone();
        (self.status, headers, Extension(self)).into_response()
    }
}
