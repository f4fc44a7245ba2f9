use axum::extract::{Path, State};
use axum::http::header::LOCATION;
use axum::http::{HeaderMap, HeaderName, StatusCode};
use axum::response::{IntoResponse, NoContent, Response};
use axum::{Extension, Json};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::extract::{Answer, ApiState, FromQuery, JsonBody, RequestCaller, one_word};
use super::state::{DaemonState, audit_entry, conflict, no_job};
use crate::http::Problem;
use crate::states::JobState;
use crate::store::{AuditEntry, Job, JobId};
use crate::supervisor::DryRunState;
use upm_core::job::Pace;
use upm_core::units::whole;
use upm_runner::config::{JobFile, JobLayout};

const IDEMPOTENCY_REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");

/// Selection of jobs to list, newest first.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[schemars(inline)]
pub struct JobsQuery {
    /// Only jobs in this state.
    pub state: Option<JobState>,
    /// Only jobs of the plate with this name.
    pub plate: Option<String>,
    /// Most jobs on the page.
    #[serde(default = "whole::<usize, 50>")]
    #[schemars(range(min = 1, max = 200))]
    pub limit: usize,
    /// `next` of the page before, a job that need not exist any more: only older ones.
    #[schemars(length(equal = 32))]
    pub cursor: Option<String>,
}

/// A page of jobs, newest first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobsPage {
    /// At most `limit` jobs of those that match the query.
    pub jobs: Vec<Job>,
    /// Cursor of the next page; null on the last.
    pub next: Option<String>,
}

/// A job that is ready to be queued.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Checked {
    /// Name of the job.
    pub name: String,
    /// Plate to which it would go.
    pub plate: String,
    /// Parts, targets, bins and paths that the job asks for.
    pub layout: JobLayout,
}

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
pub(super) struct SubmitQuery {
    /// How fast the job runs; left out: the pace in the daemon's configuration, `real-time` if none is set.
    pace: Option<Pace>,
}

/// Header with the idempotency key, and its greatest length.
pub(super) const IDEMPOTENCY_KEY: &str = "Idempotency-Key";
pub(super) const MAX_KEY_CHARS: usize = 255;

type OneJob = Path<JobPath>;

pub(super) async fn submit(
    State(api): ApiState,
    FromQuery(query): FromQuery<SubmitQuery>,
    headers: HeaderMap,
    body: JsonBody<JobFile>,
) -> Result<Response, Problem> {
    let key = one_word(&headers, IDEMPOTENCY_KEY, MAX_KEY_CHARS)?.map(str::to_owned);
    let submit = move |daemon: &DaemonState, is_awaited: &dyn Fn() -> bool| {
        daemon.submit(&body.text, query.pace, key, is_awaited)
    };
    let (job, is_replayed) = api.blocking(submit).await?;
    let location = [(LOCATION, format!("{}/v1/jobs/{}", api.spec.base_path, job.id))];
    let replayed = is_replayed.then_some([(IDEMPOTENCY_REPLAYED, "true")]);
    Ok((StatusCode::CREATED, location, replayed, Json(job)).into_response())
}

pub(super) async fn check(State(api): ApiState, body: JsonBody<JobFile>) -> Answer<Checked> {
    Ok(Json(api.blocking(move |daemon, _| daemon.check(&body.text)).await?))
}

pub(super) async fn dry_run(State(api): ApiState, body: JsonBody<JobFile>) -> Answer<DryRunState> {
    Ok(Json(api.blocking(move |daemon, _| daemon.dry_run(&body.text)).await?))
}

pub(super) async fn list(State(api): ApiState, FromQuery(query): FromQuery<JobsQuery>) -> Answer<JobsPage> {
    let JobsQuery { state, plate, limit, cursor } = query;
    let before = cursor.map(|text| JobId::parse(&text).ok_or_else(no_job)).transpose()?;
    let page = api.blocking(move |daemon, _| {
        let mut rows = daemon.store.list(state, plate.as_deref(), before, limit + 1)?;
        let is_last = rows.len() <= limit;
        rows.truncate(limit);
        let next = rows.last().filter(|_| !is_last).map(|row| row.id.to_string());
        Ok(JobsPage { jobs: rows.into_iter().map(|row| daemon.seen(row)).collect(), next })
    });
    Ok(Json(page.await?))
}

pub(super) async fn show(State(api): ApiState, Path(job): OneJob) -> Answer<Job> {
    Ok(Json(api.on_job(&job.id, |daemon, id| Ok(daemon.seen(daemon.row(&id)?))).await?))
}

/// The layout of a job that is on a plate, or was the last there.
pub(super) async fn layout(State(api): ApiState, Path(job): OneJob) -> Answer<JobLayout> {
    let layout = api.on_job(&job.id, |daemon, id| {
        let plate = daemon.plate_under(&id, "a layout")?;
        plate.job.layout.lock().clone().ok_or_else(|| Problem::busy("the job is being read", 1))
    });
    Ok(Json(layout.await?))
}

/// Moves a queued job to the front of its plate's queue.
pub(super) async fn run_next(State(api): ApiState, Path(job): OneJob, by: RequestCaller) -> Answer<Job> {
    tracing::info!(job = job.id, caller = by.name, "run next");
    let moved = api.on_job(&job.id, |daemon, id| {
        let row = daemon.store.move_to_front(&id)?.ok_or_else(no_job)?;
        match row.state {
            JobState::Queued => Ok(row.job),
            other => Err(conflict(format!("the job does not wait for its plate: {}", other.code()))),
        }
    });
    Ok(Json(moved.await?))
}

/// Takes a job out of the queue, or has its plate end it.
pub(super) async fn cancel(State(api): ApiState, Path(job): OneJob, by: RequestCaller) -> Answer<Job> {
    tracing::info!(job = job.id, caller = by.name, "cancel");
    let cancelled = api.on_job(&job.id, |daemon, id| {
        let (row, is_cancelled) = daemon.store.cancel_queued(&id)?.ok_or_else(no_job)?;
        let is_on_plate = !is_cancelled && row.state == JobState::Running;
        if is_on_plate && !daemon.plates.get(&row.plate).is_some_and(|plate| plate.job.cancel(&id)) {
            return Err(conflict("the job has already finished"));
        }
        if !is_cancelled && !is_on_plate {
            return Err(conflict(format!("the job has ended: {}", row.state.code())));
        }
        Ok(daemon.seen(row))
    });
    Ok(Json(cancelled.await?))
}

/// Deletes a job that does not run.
pub(super) async fn delete(
    State(api): ApiState,
    Path(job): OneJob,
    Extension(caller): RequestCaller,
) -> Result<NoContent, Problem> {
    tracing::info!(job = job.id, caller = caller.name, "delete");
    let entry = AuditEntry { act: AuditEntry::DELETE.to_owned(), ..audit_entry(caller) };
    let deleted = api.on_job(&job.id, |daemon, id| match daemon.store.delete(&id, entry)? {
        Some(true) => Ok(NoContent),
        Some(false) => Err(conflict("the job runs: cancel it first")),
        None => Err(no_job()),
    });
    deleted.await
}
