use std::sync::Arc;

use axum::extract::State;
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use schemars::JsonSchema;
use serde::Deserialize;
use upm_core::document::Diagnostic;

use super::extract::{Answer, ApiState, FromPath, JsonBody, RequestCaller};
use super::health::{liveness_failures, readiness_failures};
use super::metrics;
use super::state::{audit_entry, conflict};
use super::types::{EStopped, Health, Plates, ResetRequest};
use crate::http::{Problem, Reason};
use crate::store::AuditEntry;
use crate::supervisor::Plate;

pub(super) const OPENMETRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Path of an operation on one plate.
#[derive(Deserialize, JsonSchema)]
#[schemars(inline)]
pub(super) struct PlatePath {
    /// Name of a plate.
    name: String,
}

type OnePlate = FromPath<PlatePath>;

/// Lists the plates, with their queues as last counted. An emergency stop of all plates begins with this list, so it
/// needs neither the store nor another thread.
pub(super) async fn list(State(api): ApiState) -> Json<Plates> {
    let plates = api.daemon.plates.iter().map(|plate| api.daemon.plate_now(plate)).collect();
    Json(Plates { plates, stop_listen: api.daemon.spec.stop_listen.map(|address| address.to_string()) })
}

/// Stops a plate. The motors are cut before anything is awaited.
pub(super) async fn estop(
    State(api): ApiState,
    FromPath(plate): OnePlate,
    Extension(caller): RequestCaller,
) -> Answer<EStopped> {
    api.daemon.plate(&plate.name)?.estop();
    let daemon = Arc::clone(&api.daemon);
    let confirmed = api.confirmations.of(move || daemon.confirm_stop(&plate.name, &caller)).await;
    let unconfirmed = || Problem::busy("the plate is stopped; what became of its motors is not known", 1);
    Ok(Json(confirmed.ok_or_else(unconfirmed)??))
}

/// Ends an emergency stop. A client that gave up finds the plate stopped.
pub(super) async fn reset(
    State(api): ApiState,
    FromPath(plate): OnePlate,
    Extension(caller): RequestCaller,
    body: JsonBody<ResetRequest>,
) -> Answer<Plate> {
    let request = body.read()?;
    if let Some((member, found, allowed)) = request.fault() {
        let fault = Diagnostic::new("body", member, found, allowed);
        return Err(Problem::of_faults(StatusCode::UNPROCESSABLE_ENTITY, vec![fault]));
    }
    let plate = Arc::clone(api.daemon.plate(&plate.name)?);
    // determined before the reset waits its turn: a stop that comes in between is a different one
    let held = plate.emergency_stop.held()?;
    let ResetRequest { operator, reason } = request;
    let who = AuditEntry { operator, reason, ..audit_entry(caller) };
    let reset = api.blocking(move |daemon, is_awaited| {
        plate.reset(held, who, is_awaited)?;
        Ok(daemon.plate_after(&plate))
    });
    Ok(Json(reset.await?))
}

/// Lets a paused plate go on.
pub(super) async fn resume(
    State(api): ApiState,
    FromPath(plate): OnePlate,
    Extension(caller): RequestCaller,
) -> Answer<Plate> {
    let plate = Arc::clone(api.daemon.plate(&plate.name)?);
    let resumed = api.blocking(move |daemon, _| {
        let stopped = || conflict("an emergency stop holds: it must be reset first");
        plate.resume(audit_entry(caller)).then(|| daemon.plate_after(&plate)).ok_or_else(stopped)
    });
    Ok(Json(resumed.await?))
}

pub(super) async fn healthz(State(api): ApiState) -> Answer<Health> {
    health(liveness_failures(&api.daemon.observed()))
}

pub(super) async fn readyz(State(api): ApiState) -> Answer<Health> {
    health(readiness_failures(&api.daemon.observed()))
}

pub(super) async fn metrics(State(api): ApiState) -> Response {
    ([(CONTENT_TYPE, OPENMETRICS)], metrics::text(&api.daemon.observed())).into_response()
}

fn health(reasons: Vec<Reason>) -> Answer<Health> {
    if reasons.is_empty() { Ok(Json(Health { ok: true })) } else { Err(Problem::of_reasons(reasons)) }
}
