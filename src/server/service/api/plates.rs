use std::time::Duration;

use tokio::time::timeout;

use super::jobs::text_of;
use super::table::{Call, Outcome, json, media};
use super::types::{ResetRequest, Well};
use crate::service::http::{Problem, ProblemKind, Reason, joined};

pub(super) const OPENMETRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Longest time the list waits for the store to count the queues anew.
const COUNTED_WITHIN: Duration = Duration::from_millis(100);

/// The list is what an emergency stop of all plates begins with: it comes whatever the store does.
pub(super) fn list(call: Call) -> Outcome {
    Box::pin(async move {
        match timeout(COUNTED_WITHIN, call.desk.plates()).await {
            Ok(Ok(plates)) => json(200, &plates),
            _ => json(200, &call.desk.plates_as_counted()),
        }
    })
}

/// The plate is told before anything is waited for.
pub(super) fn estop(call: Call) -> Outcome {
    let stopped = call.plate().map(|plate| call.desk.estop(plate, call.caller.clone()));
    Box::pin(async move { json(200, &stopped?.await?) })
}

pub(super) fn reset(call: Call) -> Outcome {
    Box::pin(async move {
        let plate = call.plate()?;
        let request = reset_request(&text_of(call.body.clone())?)?;
        json(200, &call.desk.reset(plate, request, call.caller.clone()).await?)
    })
}

pub(super) fn resume(call: Call) -> Outcome {
    Box::pin(async move { json(200, &call.desk.resume(call.plate()?, call.caller.clone()).await?) })
}

pub(super) fn healthz(call: Call) -> Outcome {
    Box::pin(async move { well(call.desk.ailments()) })
}

pub(super) fn readyz(call: Call) -> Outcome {
    Box::pin(async move { well(call.desk.obstacles()) })
}

pub(super) fn metrics(call: Call) -> Outcome {
    Box::pin(async move { media(200, OPENMETRICS, call.desk.metrics().into()) })
}

fn well(reasons: Vec<Reason>) -> Result<axum::response::Response, Problem> {
    if reasons.is_empty() {
        return json(200, &Well { ok: true });
    }
    Err(Problem::new(ProblemKind::Unavailable, joined(&reasons)).with_reasons(reasons))
}

/// 400 for what is no JSON, 422 for JSON that is no reset.
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
