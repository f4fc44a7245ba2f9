use axum::extract::State;
use axum::http::header::LOCATION;
use axum::http::{HeaderName, StatusCode};
use axum::response::{IntoResponse, NoContent, Response};
use axum::{Extension, Json};
use schemars::JsonSchema;
use serde::Deserialize;

use super::backend::Submission;
use super::extract::{Answer, ApiState, FromHeaders, FromPath, FromQuery, JsonBody, RequestCaller};
use super::layout::{Checked, LayoutView};
use super::types::{Job, JobsPage, JobsQuery};
use crate::http::Problem;
use upm_core::job::Pace;
use upm_runner::config::JobFile;

const IDEMPOTENCY_REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");

/// Path of an operation on one job.
#[derive(Deserialize, JsonSchema)]
#[schemars(inline)]
pub(super) struct JobPath {
    /// Id of a job.
    #[schemars(extend("pattern" = "^[0-9a-f]{32}$"))]
    pub id: String,
}

#[derive(Deserialize, JsonSchema)]
#[schemars(inline)]
#[serde(deny_unknown_fields)]
pub(super) struct SubmitQuery {
    /// How fast the job runs; left out: the pace in the daemon's configuration, `real-time` if none is set.
    pace: Option<Pace>,
}

#[derive(Deserialize, JsonSchema)]
#[schemars(inline)]
pub(super) struct SubmitHeaders {
    /// The same key and body again within a day, and as long as the job is stored, give the same job again.
    #[serde(rename = "Idempotency-Key")]
    #[schemars(length(min = 1, max = 255))]
    key: Option<String>,
}

type OneJob = FromPath<JobPath>;

pub(super) async fn submit(
    State(api): ApiState,
    Extension(caller): RequestCaller,
    FromQuery(query): FromQuery<SubmitQuery>,
    FromHeaders(headers): FromHeaders<SubmitHeaders>,
    body: JsonBody<JobFile>,
) -> Result<Response, Problem> {
    let submission = Submission { text: body.text, pace: query.pace, key: headers.key, caller };
    let submitted = api.backend.submit(submission).await?;
    let location = [(LOCATION, format!("/v1/jobs/{}", submitted.job.id))];
    let replayed = submitted.replayed.then_some([(IDEMPOTENCY_REPLAYED, "true")]);
    Ok((StatusCode::CREATED, location, replayed, Json(submitted.job)).into_response())
}

pub(super) async fn check(State(api): ApiState, body: JsonBody<JobFile>) -> Answer<Checked> {
    Ok(Json(api.backend.check(body.text).await?))
}

pub(super) async fn list(State(api): ApiState, FromQuery(query): FromQuery<JobsQuery>) -> Answer<JobsPage> {
    Ok(Json(api.backend.jobs(query).await?))
}

pub(super) async fn show(State(api): ApiState, FromPath(job): OneJob) -> Answer<Job> {
    Ok(Json(api.backend.job(&job.id).await?))
}

pub(super) async fn layout(State(api): ApiState, FromPath(job): OneJob) -> Answer<LayoutView> {
    Ok(Json(api.backend.layout(&job.id).await?))
}

pub(super) async fn run_next(
    State(api): ApiState,
    FromPath(job): OneJob,
    Extension(caller): RequestCaller,
) -> Answer<Job> {
    Ok(Json(api.backend.run_next(&job.id, caller).await?))
}

pub(super) async fn cancel(
    State(api): ApiState,
    FromPath(job): OneJob,
    Extension(caller): RequestCaller,
) -> Answer<Job> {
    Ok(Json(api.backend.cancel(&job.id, caller).await?))
}

pub(super) async fn delete(
    State(api): ApiState,
    FromPath(job): OneJob,
    Extension(caller): RequestCaller,
) -> Result<NoContent, Problem> {
    api.backend.delete(&job.id, caller).await?;
    Ok(NoContent)
}
