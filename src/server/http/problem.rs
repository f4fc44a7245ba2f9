use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, RETRY_AFTER};
use axum::http::{HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use upm_core::document::{Diagnostic, counted};

/// Media type of problem documents.
pub(crate) const PROBLEM_JSON: &str = "application/problem+json";

/// Declares [`ProblemKind`] with one row per kind: name, status, last word of its URN, title.
macro_rules! problem_kinds {
    ($($kind:ident $status:ident $word:literal $title:literal;)*) => {
        /// Kind of problem that the API answers with, each with its own status.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum ProblemKind {
            $(#[doc = concat!($title, ".")] $kind,)*
        }

        impl ProblemKind {
            fn row(self) -> (StatusCode, &'static str, &'static str) {
                match self {
                    $(Self::$kind => (StatusCode::$status, $word, $title),)*
                }
            }
        }
    };
}

problem_kinds! {
    Malformed BAD_REQUEST "malformed" "The request cannot be read";
    Unauthorized UNAUTHORIZED "unauthorized" "A valid bearer token is needed";
    Forbidden FORBIDDEN "forbidden" "The request is not allowed";
    NotFound NOT_FOUND "not-found" "There is no such thing";
    MethodNotAllowed METHOD_NOT_ALLOWED "method-not-allowed" "Method not allowed for this path";
    RequestTimeout REQUEST_TIMEOUT "request-timeout" "The request was sent too slowly";
    Conflict CONFLICT "conflict" "The present state does not allow this";
    ContentTooLarge PAYLOAD_TOO_LARGE "content-too-large" "The body is too large";
    UnsupportedMediaType UNSUPPORTED_MEDIA_TYPE "unsupported-media-type" "The body is of another type";
    RangeNotSatisfiable RANGE_NOT_SATISFIABLE "range-not-satisfiable" "The range lies outside the file";
    Invalid UNPROCESSABLE_ENTITY "invalid" "The request is not valid";
    QueueFull TOO_MANY_REQUESTS "queue-full" "The queue is full";
    HeaderTooLarge REQUEST_HEADER_FIELDS_TOO_LARGE "header-too-large" "The header is too large";
    Internal INTERNAL_SERVER_ERROR "internal" "Something broke in the daemon";
    Unavailable SERVICE_UNAVAILABLE "unavailable" "The service is temporarily unavailable";
    InsufficientStorage INSUFFICIENT_STORAGE "insufficient-storage" "The disk is full";
}

impl ProblemKind {
    /// HTTP status of the answer.
    pub fn status(self) -> StatusCode {
        self.row().0
    }

    /// URN of the kind, which never changes: `urn:upm:problem:queue-full`.
    pub fn address(self) -> String {
        format!("urn:upm:problem:{}", self.row().1)
    }

    /// Title of the kind, a few words.
    pub fn title(self) -> &'static str {
        self.row().2
    }
}

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

/// A problem document (RFC 9457).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ProblemDocument {
    /// Kind of problem, `urn:upm:problem:` and a word.
    #[serde(rename = "type")]
    pub kind: String,
    /// Title of the kind.
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

/// A failed request. Becomes a problem document; the outermost layer adds the request's id.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    kind: ProblemKind,
    document: Box<ProblemDocument>,
    headers: Vec<(HeaderName, HeaderValue)>,
}

impl Problem {
    /// A problem of this kind; `detail` is a sentence for people.
    pub fn new(kind: ProblemKind, detail: impl Into<String>) -> Self {
        let document = ProblemDocument {
            kind: kind.address(),
            title: kind.title().to_owned(),
            status: kind.status().as_u16(),
            detail: detail.into(),
            instance: None,
            faults: Vec::new(),
            reasons: Vec::new(),
        };
        Self { kind, document: Box::new(document), headers: Vec::new() }
    }

    /// The problem of a request with these faults.
    pub fn of_faults(kind: ProblemKind, faults: Vec<Diagnostic>) -> Self {
        let mut problem = Self::new(kind, counted(faults.len(), "fault"));
        problem.document.faults = faults;
        problem
    }

    /// Adds reasons of the daemon's state.
    pub fn with_reasons(mut self, reasons: impl IntoIterator<Item = Reason>) -> Self {
        self.document.reasons.extend(reasons);
        self
    }

    /// Adds the time after which to try again, s.
    pub fn retry_after(self, seconds: u32) -> Self {
        self.with_header(RETRY_AFTER, HeaderValue::from(seconds))
    }

    /// Adds a header.
    pub fn with_header(mut self, name: HeaderName, value: HeaderValue) -> Self {
        self.headers.push((name, value));
        self
    }

    /// Kind of the problem.
    pub fn kind(&self) -> ProblemKind {
        self.kind
    }

    /// The document for the request with the id `instance`.
    pub fn document(&self, instance: Option<&str>) -> ProblemDocument {
        let instance = instance.map(|id| format!("urn:upm:request:{id}"));
        ProblemDocument { instance, ..ProblemDocument::clone(&self.document) }
    }

    /// The document as the body of an answer.
    pub(super) fn body(&self, instance: Option<&str>) -> Body {
        Body::from(serde_json::to_vec(&self.document(instance)).unwrap_or_default())
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let mut response = Response::new(self.body(None));
        *response.status_mut() = self.kind.status();
        response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
        response.headers_mut().extend(self.headers.iter().cloned());
        response.extensions_mut().insert(self);
        response
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::document::Path;

    #[test]
    fn a_problem_is_sent_as_its_document() {
        let fault = Diagnostic::new("job", Path::root().key("seed"), "\"x\"", "a whole number");
        let problem = Problem::of_faults(ProblemKind::Invalid, vec![fault]).retry_after(7);
        let json = serde_json::to_value(problem.document(Some("a1"))).unwrap();
        assert_eq!(
            json,
            serde_json::json!({
                "type": "urn:upm:problem:invalid", "title": "The request is not valid", "status": 422,
                "detail": "1 fault", "instance": "urn:upm:request:a1",
                "faults": [{"path": "seed", "found": "\"x\"", "allowed": "a whole number"}],
            })
        );
        let response = problem.into_response();
        assert_eq!(response.status(), 422);
        assert_eq!(response.headers()[CONTENT_TYPE], PROBLEM_JSON);
        assert_eq!(response.headers()[RETRY_AFTER], "7");
    }
}
