use std::time::Duration;

use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use schemars::JsonSchema;
use serde::Deserialize;
use tokio::time::timeout;
use upm_core::document::Diagnostic;

use super::extract::{Answer, ApiState, FromPath, JsonBody, RequestCaller};
use super::types::{EStopped, Health, Plate, Plates, ResetRequest};
use crate::http::{Problem, ProblemKind, Reason, joined};

pub(super) const OPENMETRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Longest wait for the store to count the queues.
const COUNTED_WITHIN: Duration = Duration::from_millis(100);

/// Path of an operation on one plate.
#[derive(Deserialize, JsonSchema)]
#[schemars(inline)]
pub(super) struct PlatePath {
    /// Name of a plate.
    name: String,
}

type OnePlate = FromPath<PlatePath>;

/// Lists the plates. An emergency stop of all plates begins with this list, so it does not depend on the store.
pub(super) async fn list(State(api): ApiState) -> Answer<Plates> {
    let counted = timeout(COUNTED_WITHIN, api.backend.plates()).await;
    Ok(Json(counted.ok().and_then(Result::ok).unwrap_or_else(|| api.backend.plates_as_counted())))
}

/// Stops a plate. The motors are cut before anything is awaited.
pub(super) async fn estop(
    State(api): ApiState,
    FromPath(plate): OnePlate,
    Extension(caller): RequestCaller,
) -> Answer<EStopped> {
    Ok(Json(api.backend.estop(&plate.name, caller).await?))
}

pub(super) async fn reset(
    State(api): ApiState,
    FromPath(plate): OnePlate,
    Extension(caller): RequestCaller,
    body: JsonBody<ResetRequest>,
) -> Answer<Plate> {
    let request = body.read()?;
    if let Some((member, found, allowed)) = request.fault() {
        let fault = Diagnostic::new("body", member, found, allowed);
        return Err(Problem::of_faults(ProblemKind::Invalid, vec![fault]));
    }
    Ok(Json(api.backend.reset(&plate.name, request, caller).await?))
}

pub(super) async fn resume(
    State(api): ApiState,
    FromPath(plate): OnePlate,
    Extension(caller): RequestCaller,
) -> Answer<Plate> {
    Ok(Json(api.backend.resume(&plate.name, caller).await?))
}

pub(super) async fn healthz(State(api): ApiState) -> Answer<Health> {
    health(api.backend.liveness_failures())
}

pub(super) async fn readyz(State(api): ApiState) -> Answer<Health> {
    health(api.backend.readiness_failures())
}

pub(super) async fn metrics(State(api): ApiState) -> Response {
    ([(CONTENT_TYPE, OPENMETRICS)], api.backend.metrics()).into_response()
}

fn health(reasons: Vec<Reason>) -> Answer<Health> {
    if reasons.is_empty() {
        return Ok(Json(Health { ok: true }));
    }
    Err(Problem::new(ProblemKind::Unavailable, joined(&reasons)).with_reasons(reasons))
}
