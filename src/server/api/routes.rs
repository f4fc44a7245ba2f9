//! Every operation of the API, with the token that it needs; router and OpenAPI document are made from these routes.

use std::sync::Arc;

use aide::OperationOutput;
use aide::axum::ApiRouter;
use aide::axum::routing::{delete_with, get_with, post_with};
use aide::generate::{GenContext, in_context};
use aide::openapi::{Operation, Response as Described, SecurityScheme};
use aide::transform::{TransformOpenApi, TransformOperation};
use axum::Json;
use axum::extract::{ConnectInfo, Request, State};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::Response;
use axum::routing::get;
use schemars::generate::SchemaSettings;
use serde_json::json;

use super::state::DaemonState;
use super::{events, files, jobs, page, plates};
use crate::http::{Caller, PROBLEM_JSON, Problem, ProblemDocument, Scope, Tokens};
use crate::store::Job;

type Routes = ApiRouter<Arc<DaemonState>>;

/// All routes. Every operation beyond health and page needs one of `tokens`, where there are any.
pub(super) fn routes(tokens: &Arc<Tokens>) -> Routes {
    in_context(|context| {
        let settings = SchemaSettings::draft2020_12();
        context.schema = settings.with(|of| of.definitions_path = "/components/schemas".into()).into_generator();
    });
    let routes = open().merge(admitted(read(), Scope::Read, tokens));
    routes.merge(admitted(operate(), Scope::Operate, tokens))
}

fn open() -> Routes {
    ApiRouter::new()
        .api_route("/healthz", get_with(plates::healthz, named("healthz", "Liveness; on failure 503 with the reasons")))
        .api_route("/readyz", get_with(plates::readyz, named("readyz", "Does it take jobs? If not, 503 with reasons")))
        .route("/", get(page::index))
        .route("/assets/{file}", get(page::asset))
}

fn read() -> Routes {
    let layout = "Parts, targets, bins and paths of a job on its plate, until the next begins there";
    let frame = "The latest camera frame of a job on its plate or last there, with marks; `Upm-Age-Ms` is its age, ms";
    let recording = "The job's recording (.rrd)";
    let estop = "Emergency stop: motors to zero, held until a reset; any token may";
    let watch = "Watch a job by server-sent events: `job`, whenever its state changes, and the lines of its journal from the \
                 `id` on that `Last-Event-ID` names, 0 for all; without one from now on. The stream of a job that has \
                 ended ends with `job`";
    ApiRouter::new()
        .api_route("/v1/jobs", get_with(jobs::list, named("jobs", "List jobs, newest first")))
        .api_route("/v1/jobs/{id}", get_with(jobs::show, named("job", "A job and its report")))
        .api_route("/v1/jobs/{id}/layout", get_with(jobs::layout, named("layout", layout)))
        .api_route("/v1/jobs/{id}/events", get_with(events::watch, file("events", watch, events::EVENT_STREAM)))
        .api_route("/v1/jobs/{id}/recording", get_with(files::recording, file("recording", recording, files::RRD)))
        .api_route("/v1/jobs/{id}/frame.png", get_with(files::frame, file("frame", frame, "image/png")))
        .api_route("/v1/plates", get_with(plates::list, named("plates", "All plates as they are")))
        .api_route("/v1/plates/{name}/estop", post_with(plates::estop, named("estop", estop)))
        .api_route("/metrics", get_with(plates::metrics, file("metrics", "For Prometheus", plates::OPENMETRICS)))
        .api_route("/openapi.json", get_with(files::openapi, file("openapi", "This document", "application/json")))
}

fn operate() -> Routes {
    let submit = "Queue a job: 201 once it is on the disk, with its address in `Location`; \
                  `Idempotency-Replayed: true` when it had been queued before, under the same key";
    let dry_run = "Make dry runs of a job without queueing it: starts them, or tells how far they are. Asked again until \
                   there is a forecast; of a job whose client no longer asks they may be given up";
    let delete = "Delete a queued or ended job and its run folder";
    let run_next = "Run a queued job before the others";
    let cancel = "Take a job out of the queue, or stop it";
    let reset = "End an emergency stop; the plate stays paused";
    let resume = "Let a paused plate go on with its queue, and a paused standing job run";
    ApiRouter::new()
        .api_route(
            "/v1/jobs",
            post_with(jobs::submit, |operation| {
                let mut operation = named("submit", submit)(operation).response::<201, Json<Job>>();
                let about = "The same key and body again within a day, and as long as the job is stored, give the same job again.";
                let schema = json!({"type": "string", "minLength": 1, "maxLength": jobs::MAX_KEY_CHARS});
                let key = json!({"in": "header", "name": jobs::IDEMPOTENCY_KEY, "description": about, "schema": schema});
                operation.inner_mut().parameters.extend(serde_json::from_value(key).ok());
                operation
            }),
        )
        .api_route("/v1/dry-run", post_with(jobs::dry_run, named("dry-run", dry_run)))
        .api_route("/v1/check", post_with(jobs::check, named("check", "Check a job without queueing it")))
        .api_route("/v1/jobs/{id}", delete_with(jobs::delete, named("delete", delete)))
        .api_route("/v1/jobs/{id}/run-next", post_with(jobs::run_next, named("run-next", run_next)))
        .api_route("/v1/jobs/{id}/cancel", post_with(jobs::cancel, named("cancel", cancel)))
        .api_route("/v1/plates/{name}/reset", post_with(plates::reset, named("reset", reset)))
        .api_route("/v1/plates/{name}/resume", post_with(plates::resume, named("resume", resume)))
}

/// The same routes for clients whose token grants `scope`.
fn admitted(routes: Routes, scope: Scope, tokens: &Arc<Tokens>) -> Routes {
    routes
        .with_path_items(|path| path.security_requirement_scopes("token", [scope.code()]))
        .route_layer(from_fn_with_state((tokens.clone(), scope), admit))
}

async fn admit(
    State((tokens, scope)): State<(Arc<Tokens>, Scope)>,
    mut request: Request,
    next: Next,
) -> Result<Response, Problem> {
    let name = tokens.admit(request.headers(), scope)?;
    let remote = request.extensions().get().map(|ConnectInfo(address)| *address);
    request.extensions_mut().insert(Caller { name, remote });
    Ok(next.run(request).await)
}

/// Describes an operation whose answer has a type.
fn named(id: &'static str, summary: &'static str) -> impl FnOnce(TransformOperation<'_>) -> TransformOperation<'_> {
    move |operation| operation.id(id).summary(summary)
}

/// Describes an operation that answers with text or bytes of this media type.
fn file(
    id: &'static str,
    summary: &'static str,
    media: &'static str,
) -> impl FnOnce(TransformOperation<'_>) -> TransformOperation<'_> {
    move |operation| {
        let mut operation = named(id, summary)(operation);
        let answer = json!({"200": {"description": summary, "content": {media: {}}}});
        operation.inner_mut().responses = serde_json::from_value(answer).ok();
        operation
    }
}

impl OperationOutput for Problem {
    type Inner = ProblemDocument;

    fn operation_response(context: &mut GenContext, _: &mut Operation) -> Option<Described> {
        let schema = context.schema.subschema_for::<ProblemDocument>();
        let content = json!({PROBLEM_JSON: {"schema": schema}});
        serde_json::from_value(json!({"description": "The request failed.", "content": content})).ok()
    }
}

/// Completes the OpenAPI document of the routes.
pub(super) fn described<'t>(api: TransformOpenApi<'t>, version: &str) -> TransformOpenApi<'t> {
    let description = "Jobs for plates that move coins. Errors are problem documents (RFC 9457); `X-Request-Id` names \
                       the request in them and in the log. What is no HTTP request at all, or has more than 16 KiB or \
                       64 lines of header, is answered 400 or 431 without a body; a header that does not come within \
                       5 s ends the connection.";
    let token = SecurityScheme::Http {
        scheme: "bearer".to_owned(),
        bearer_format: None,
        description: Some("Needed when the daemon has tokens; it must have some to listen beyond loopback.".to_owned()),
        extensions: Default::default(),
    };
    let api = api.title("upm").version(version).description(description);
    api.security_scheme("token", token).default_response::<Problem>()
}
