use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use upm_core::document::Diagnostic;

use super::extract::{Answer, ApiState, FromQuery, JsonBody, RequestCaller};
use super::health::{liveness_failures, readiness_failures};
use super::metrics;
use super::state::{EStopped, audit_entry, conflict};
use crate::http::{Problem, Reason};
use crate::store::AuditEntry;
use crate::supervisor::Plate;

pub(super) const OPENMETRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Every plate of the daemon at one moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plates {
    /// The plates, in the order of the configuration.
    pub plates: Vec<Plate>,
    /// Address and port of the listener whose `POST /v1/estop` stops every plate; null where there is none.
    pub stop_listen: Option<String>,
}

/// A request to end an emergency stop.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ResetRequest {
    /// Name of the operator who inspected the plate.
    #[schemars(length(min = 1, max = 200), extend("pattern" = "\\S"))]
    pub operator: String,
    /// Reason why it may move again.
    #[schemars(length(min = 1, max = 1000), extend("pattern" = "\\S"))]
    pub reason: String,
}

impl ResetRequest {
    /// The first member that is empty or too long: its name, the text found, and what is allowed.
    pub fn fault(&self) -> Option<(&'static str, String, String)> {
        let members = [("operator", &self.operator, 200), ("reason", &self.reason, 1000)];
        let is_said = |text: &str, most: usize| !text.trim().is_empty() && text.chars().count() <= most;
        let (member, text, most) = members.into_iter().find(|(_, text, most)| !is_said(text, *most))?;
        let found = format!("{} characters", text.trim().chars().count());
        Some((member, found, format!("1 to {most} characters, not blanks alone")))
    }
}

/// Confirmation that all is well; otherwise the answer is a problem with the reasons.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Health {
    /// Always true.
    pub ok: bool,
}

/// Path of an operation on one plate.
#[derive(Deserialize, JsonSchema)]
#[schemars(inline)]
pub(super) struct PlatePath {
    /// Name of a plate.
    name: String,
}

type OnePlate = Path<PlatePath>;

/// The person who lets a plate go on.
#[derive(Deserialize, JsonSchema)]
#[schemars(inline)]
pub(super) struct ResumeQuery {
    /// Name of the operator.
    #[serde(default)]
    #[schemars(length(max = 200))]
    operator: String,
}

/// Lists the plates, with their queues as last counted. An emergency stop of all plates begins with this list, so it
/// needs neither the store nor another thread.
pub(super) async fn list(State(api): ApiState) -> Json<Plates> {
    let plates = api.plates.iter().map(|plate| api.plate_now(plate)).collect();
    Json(Plates { plates, stop_listen: api.spec.stop_listen.map(|address| address.to_string()) })
}

/// Stops a plate. The motors are cut before anything is awaited.
pub(super) async fn estop(
    State(api): ApiState,
    Path(plate): OnePlate,
    Extension(caller): RequestCaller,
) -> Answer<EStopped> {
    let (daemon, plate) = (Arc::clone(&api), Arc::clone(api.plate(&plate.name)?));
    plate.estop();
    let confirmed = api.confirmations.of(move || daemon.confirm_stops(&[plate], &caller)).await;
    let unconfirmed = || Problem::busy("the plate is stopped; what became of its motors is not known", 1);
    Ok(Json(confirmed.and_then(|mut stops| stops.pop()).ok_or_else(unconfirmed)?))
}

/// Ends an emergency stop. A client that gave up finds the plate stopped.
pub(super) async fn reset(
    State(api): ApiState,
    Path(plate): OnePlate,
    Extension(caller): RequestCaller,
    body: JsonBody<ResetRequest>,
) -> Answer<Plate> {
    let request = body.read()?;
    if let Some((member, found, allowed)) = request.fault() {
        let fault = Diagnostic::new("body", member, found, allowed);
        return Err(Problem::of_document(vec![fault]));
    }
    let plate = Arc::clone(api.plate(&plate.name)?);
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
    Path(plate): OnePlate,
    FromQuery(ResumeQuery { operator }): FromQuery<ResumeQuery>,
    Extension(caller): RequestCaller,
) -> Answer<Plate> {
    let plate = Arc::clone(api.plate(&plate.name)?);
    let who = AuditEntry { operator, ..audit_entry(caller) };
    let resumed = api.blocking(move |daemon, _| {
        let stopped = || conflict("an emergency stop holds: it must be reset first");
        plate.resume(who).then(|| daemon.plate_after(&plate)).ok_or_else(stopped)
    });
    Ok(Json(resumed.await?))
}

pub(super) async fn healthz(State(api): ApiState) -> Answer<Health> {
    health(liveness_failures(&api.observed()))
}

pub(super) async fn readyz(State(api): ApiState) -> Answer<Health> {
    health(readiness_failures(&api.observed()))
}

pub(super) async fn metrics(State(api): ApiState) -> Response {
    ([(CONTENT_TYPE, OPENMETRICS)], metrics::text(&api.observed())).into_response()
}

fn health(reasons: Vec<Reason>) -> Answer<Health> {
    if reasons.is_empty() { Ok(Json(Health { ok: true })) } else { Err(Problem::of_reasons(reasons)) }
}
