use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, RETRY_AFTER};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use upm_core::document::{Diagnostic, counted};

/// Media type of problem documents.
pub(crate) const PROBLEM_JSON: &str = "application/problem+json";

/// Last word of the URN and title of the kind of problem that a status stands for. Both never change.
fn kind_of(status: StatusCode) -> (&'static str, &'static str) {
    match status {
        StatusCode::BAD_REQUEST => ("malformed", "The request cannot be read"),
        StatusCode::UNAUTHORIZED => ("unauthorized", "A valid bearer token is needed"),
        StatusCode::FORBIDDEN => ("forbidden", "The request is not allowed"),
        StatusCode::NOT_FOUND => ("not-found", "There is no such thing"),
        StatusCode::METHOD_NOT_ALLOWED => ("method-not-allowed", "Method not allowed for this path"),
        StatusCode::REQUEST_TIMEOUT => ("request-timeout", "The request was sent too slowly"),
        StatusCode::CONFLICT => ("conflict", "The present state does not allow this"),
        StatusCode::PAYLOAD_TOO_LARGE => ("content-too-large", "The body is too large"),
        StatusCode::UNSUPPORTED_MEDIA_TYPE => ("unsupported-media-type", "The body is of another type"),
        StatusCode::UNPROCESSABLE_ENTITY => ("invalid", "The request is not valid"),
        StatusCode::TOO_MANY_REQUESTS => ("queue-full", "The queue is full"),
        StatusCode::SERVICE_UNAVAILABLE => ("unavailable", "The service is temporarily unavailable"),
        StatusCode::INSUFFICIENT_STORAGE => ("insufficient-storage", "The disk is full"),
        _ => ("internal", "Something broke in the daemon"),
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
    status: StatusCode,
    document: Box<ProblemDocument>,
    headers: HeaderMap,
}

impl Problem {
    /// A problem answered with this status; `detail` is a sentence for people.
    pub fn new(status: StatusCode, detail: impl Into<String>) -> Self {
        let (word, title) = kind_of(status);
        let document = ProblemDocument {
            kind: format!("urn:upm:problem:{word}"),
            title: title.to_owned(),
            status: status.as_u16(),
            detail: detail.into(),
            instance: None,
            faults: Vec::new(),
            reasons: Vec::new(),
        };
        Self { status, document: Box::new(document), headers: HeaderMap::new() }
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
    pub(super) fn body(&self, instance: Option<&str>) -> Body {
        let instance = instance.map(|id| format!("urn:upm:request:{id}"));
        let document = ProblemDocument { instance, ..ProblemDocument::clone(&self.document) };
        Body::from(serde_json::to_vec(&document).unwrap_or_default())
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let mut response = (self.status, self.headers.clone(), self.body(None)).into_response();
        response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
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
        let problem = Problem::of_faults(StatusCode::UNPROCESSABLE_ENTITY, vec![fault]);
        assert_eq!(
            serde_json::to_value(&problem.document).unwrap(),
            serde_json::json!({
                "type": "urn:upm:problem:invalid", "title": "The request is not valid", "status": 422,
                "detail": "1 fault", "faults": [{"path": "seed", "found": "\"x\"", "allowed": "a whole number"}],
            })
        );
        let response = problem.into_response();
        assert_eq!(
            (response.status(), response.headers()[CONTENT_TYPE].as_bytes()),
            (StatusCode::UNPROCESSABLE_ENTITY, PROBLEM_JSON.as_bytes())
        );
        assert_eq!(Problem::busy("in use", 7).into_response().headers()[RETRY_AFTER], "7");
    }
}
