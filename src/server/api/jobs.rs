use axum::Json;
use axum::http::header::LOCATION;
use axum::http::{HeaderMap, HeaderName, StatusCode};
use axum::response::{IntoResponse, Response};

use super::backend::Submission;
use super::query::JobsQuery;
use super::request::RequestContext;
use crate::http::{Problem, ProblemKind};

pub(super) const IDEMPOTENCY_KEY: &str = "Idempotency-Key";
const LONGEST_KEY: usize = 255;
const IDEMPOTENCY_REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");

pub(super) async fn submit(call: RequestContext) -> Result<Response, Problem> {
    let (text, pace, key) = (call.text()?.to_owned(), call.query.pace()?, key_of(&call.headers)?);
    let submitted = call.backend.submit(Submission { text, pace, key, caller: call.caller }).await?;
    let location = [(LOCATION, format!("/v1/jobs/{}", submitted.job.id))];
    let replayed = submitted.replayed.then_some([(IDEMPOTENCY_REPLAYED, "true")]);
    Ok((StatusCode::CREATED, location, replayed, Json(submitted.job)).into_response())
}

pub(super) async fn check(call: RequestContext) -> Result<Response, Problem> {
    let order = Submission { text: call.text()?.to_owned(), pace: None, key: None, caller: call.caller };
    Ok(Json(call.backend.check(order).await?).into_response())
}

pub(super) async fn list(call: RequestContext) -> Result<Response, Problem> {
    Ok(Json(call.backend.jobs(JobsQuery::of(&call.query)?).await?).into_response())
}

pub(super) async fn show(call: RequestContext) -> Result<Response, Problem> {
    Ok(Json(call.backend.job(call.job_id()?).await?).into_response())
}

pub(super) async fn layout(call: RequestContext) -> Result<Response, Problem> {
    Ok(Json(call.backend.layout(call.job_id()?).await?).into_response())
}

pub(super) async fn run_next(call: RequestContext) -> Result<Response, Problem> {
    Ok(Json(call.backend.run_next(call.job_id()?, call.caller.clone()).await?).into_response())
}

pub(super) async fn cancel(call: RequestContext) -> Result<Response, Problem> {
    Ok(Json(call.backend.cancel(call.job_id()?, call.caller.clone()).await?).into_response())
}

pub(super) async fn delete(call: RequestContext) -> Result<Response, Problem> {
    call.backend.delete(call.job_id()?, call.caller.clone()).await?;
    Ok(StatusCode::NO_CONTENT.into_response())
}

fn key_of(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let mut values = headers.get_all(IDEMPOTENCY_KEY).iter();
    let Some(value) = values.next() else { return Ok(None) };
    let bytes = value.as_bytes();
    let is_key = (1..=LONGEST_KEY).contains(&bytes.len()) && bytes.iter().all(u8::is_ascii_graphic);
    match value.to_str() {
        Ok(key) if is_key && values.next().is_none() => Ok(Some(key.to_owned())),
        _ => {
            let detail = format!("{IDEMPOTENCY_KEY} is one word of 1 to {LONGEST_KEY} visible ASCII characters");
            Err(Problem::new(ProblemKind::Malformed, detail))
        }
    }
}
