use std::time::Duration;

use axum::Json;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use tokio::time::timeout;

use super::request::RequestContext;
use super::types::{Health, ResetRequest};
use crate::http::{Problem, ProblemKind, Reason, joined};

pub(super) const OPENMETRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Longest wait for the store to count the queues.
const COUNTED_WITHIN: Duration = Duration::from_millis(100);

/// Lists the plates. An emergency stop of all plates begins with this list, so it does not depend on the store.
pub(super) async fn list(call: RequestContext) -> Result<Response, Problem> {
    let counted = timeout(COUNTED_WITHIN, call.backend.plates()).await;
    let plates = counted.ok().and_then(Result::ok).unwrap_or_else(|| call.backend.plates_as_counted());
    Ok(Json(plates).into_response())
}

/// Stops a plate. The motors are cut before the returned future is polled.
pub(super) fn estop(call: RequestContext) -> impl Future<Output = Result<Response, Problem>> {
    let stopped = call.plate().map(|plate| call.backend.estop(plate, call.caller.clone()));
    async move { Ok(Json(stopped?.await?).into_response()) }
}

pub(super) async fn reset(call: RequestContext) -> Result<Response, Problem> {
    let (plate, request) = (call.plate()?, reset_request(call.text()?)?);
    Ok(Json(call.backend.reset(plate, request, call.caller.clone()).await?).into_response())
}

pub(super) async fn resume(call: RequestContext) -> Result<Response, Problem> {
    Ok(Json(call.backend.resume(call.plate()?, call.caller.clone()).await?).into_response())
}

pub(super) async fn healthz(call: RequestContext) -> Result<Response, Problem> {
    well(call.backend.liveness_failures())
}

pub(super) async fn readyz(call: RequestContext) -> Result<Response, Problem> {
    well(call.backend.readiness_failures())
}

pub(super) async fn metrics(call: RequestContext) -> Result<Response, Problem> {
    Ok(([(CONTENT_TYPE, OPENMETRICS)], call.backend.metrics()).into_response())
}

fn well(reasons: Vec<Reason>) -> Result<Response, Problem> {
    if reasons.is_empty() {
        return Ok(Json(Health { ok: true }).into_response());
    }
    Err(Problem::new(ProblemKind::Unavailable, joined(&reasons)).with_reasons(reasons))
}

/// Parses a reset: 400 for text that is not JSON, 422 for JSON that is not a valid reset.
fn reset_request(text: &str) -> Result<ResetRequest, Problem> {
    let allowed = "an object with `operator` and `reason`";
    let fault = |path: &str, error: &serde_json::Error| {
        let kind = if error.is_data() { ProblemKind::Invalid } else { ProblemKind::Malformed };
        let path = if path == "." { "$" } else { path };
        Problem::new(kind, "1 fault").with_fault(path, error.to_string(), allowed)
    };
    let mut json = serde_json::Deserializer::from_str(text);
    let request: ResetRequest =
        serde_path_to_error::deserialize(&mut json).map_err(|e| fault(&e.path().to_string(), e.inner()))?;
    json.end().map_err(|error| fault(".", &error))?;
    if let Some((member, found, allowed)) = request.fault() {
        return Err(Problem::new(ProblemKind::Invalid, "1 fault").with_fault(member, found, allowed));
    }
    Ok(request)
}
