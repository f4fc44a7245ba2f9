use serde_json::json;

use super::layout::{Checked, LayoutView};
use super::operation::{Handler, HttpMethod, MediaType, Operation, Param, ParamIn, ResponseSpec, schema_of};
use super::types::{EStopped, Health, Job, JobsPage, Plate, Plates, ResetRequest};
use super::{events, files, jobs, plates};
use crate::http::{ProblemKind, Scope};
use crate::states::JobState;
use upm_core::job::Pace;
use upm_runner::config::JobFile;

/// Every operation of the API.
pub(super) fn operations() -> Vec<Operation> {
    [job_operations(), file_operations(), plate_operations(), own_operations()].into_iter().flatten().collect()
}

fn job_operations() -> Vec<Operation> {
    const JOBS: &[ResponseSpec] = &[answer(200, "A page of jobs.", MediaType::Json(schema_of::<JobsPage>))];
    const JOB: &[ResponseSpec] = &[answer(200, "The job.", MediaType::Json(schema_of::<Job>))];
    const LAYOUT: &[ResponseSpec] = &[answer(200, "The layout.", MediaType::Json(schema_of::<LayoutView>))];
    const CHECKED: &[ResponseSpec] = &[answer(200, "It may be queued.", MediaType::Json(schema_of::<Checked>))];
    const DELETED: &[ResponseSpec] = &[answer(204, "The job is deleted.", MediaType::Nothing)];
    let layout = "Parts, targets, bins and paths of a job that is on its plate";
    vec![
        Operation {
            params: SUBMIT_PARAMS,
            body: Some(schema_of::<JobFile>),
            problems: &[
                ProblemKind::Conflict,
                ProblemKind::Invalid,
                ProblemKind::QueueFull,
                ProblemKind::InsufficientStorage,
            ],
            ..post("submit", "/v1/jobs", "Queue a job", SUBMIT_ANSWERS, jobs::submit)
        },
        Operation {
            body: Some(schema_of::<JobFile>),
            problems: &[ProblemKind::Invalid],
            ..post("check", "/v1/check", "Check a job without queueing it", CHECKED, jobs::check)
        },
        Operation { params: LIST_PARAMS, ..get("jobs", "/v1/jobs", "List jobs, newest first", JOBS, jobs::list) },
        get("job", "/v1/jobs/{id}", "A job and its report", JOB, jobs::show),
        get("layout", "/v1/jobs/{id}/layout", layout, LAYOUT, jobs::layout),
        Operation {
            problems: &[ProblemKind::Conflict, ProblemKind::InsufficientStorage],
            ..post("run-next", "/v1/jobs/{id}/run-next", "Run a queued job before the others", JOB, jobs::run_next)
        },
        Operation {
            problems: &[ProblemKind::Conflict, ProblemKind::InsufficientStorage],
            ..post("cancel", "/v1/jobs/{id}/cancel", "Take a job out of the queue, or stop it", JOB, jobs::cancel)
        },
        Operation {
            method: HttpMethod::Delete,
            problems: &[ProblemKind::Conflict, ProblemKind::InsufficientStorage],
            ..post("delete", "/v1/jobs/{id}", "Delete a queued or ended job and its run folder", DELETED, jobs::delete)
        },
    ]
}

const SUBMIT_PARAMS: &[Param] = &[
    Param {
        name: jobs::IDEMPOTENCY_KEY,
        location: ParamIn::Header,
        description: "The same key and body again within a day give the same job again.",
        schema: || json!({"type": "string", "pattern": "^[!-~]{1,255}$"}),
    },
    Param {
        name: "pace",
        location: ParamIn::Query,
        description: "How fast the job runs; left out: the pace in the daemon's configuration, `real-time` if none is set.",
        schema: || json!({"type": "string", "enum": Pace::ALL.map(Pace::code)}),
    },
];

const SUBMIT_ANSWERS: &[ResponseSpec] = &[ResponseSpec {
    headers: &[
        ("Location", "Where the job is."),
        ("Idempotency-Replayed", "`true` when the job had been queued before, under the same key."),
    ],
    ..answer(201, "The job is queued, and on the disk.", MediaType::Json(schema_of::<Job>))
}];

const LIST_PARAMS: &[Param] = &[
    Param {
        name: "state",
        location: ParamIn::Query,
        description: "Only jobs in this state.",
        schema: || json!({"type": "string", "enum": JobState::ALL.map(JobState::code)}),
    },
    Param {
        name: "limit",
        location: ParamIn::Query,
        description: "Most jobs on the page.",
        schema: || json!({"type": "integer", "minimum": 1, "maximum": 200, "default": 50}),
    },
    Param { name: "cursor", location: ParamIn::Query, description: "`next` of the page before.", ..JOB_ID },
];

fn file_operations() -> Vec<Operation> {
    const EVENTS: &[ResponseSpec] = &[answer(
        200,
        "Server-sent events: `snapshot`, then what was missed, then what happens. An `id` once seen can be resumed from, \
         that of a `snapshot` too; `gap` tells of events that cannot be had any more. `bye` ends the stream: unless a \
         `finished` came before, it can be resumed.",
        MediaType::Media(events::EVENT_STREAM),
    )];
    const PICTURE: &[ResponseSpec] = &[ResponseSpec {
        headers: &[("Upm-Age-Ms", "Wall time since it was taken, ms: a whole number.")],
        ..answer(200, "The picture, at most a few seconds old.", MediaType::Media("image/png"))
    }];
    const RECORDING: &[ResponseSpec] = &[
        ResponseSpec {
            headers: &[("ETag", "Changes with the file."), ("Accept-Ranges", "`bytes`.")],
            ..answer(200, "The whole file.", MediaType::Media(files::RRD))
        },
        ResponseSpec {
            headers: &[("ETag", "Changes with the file."), ("Content-Range", "Which bytes of how many.")],
            ..answer(206, "The bytes asked for.", MediaType::Media(files::RRD))
        },
    ];
    let picture = "The latest camera frame, what is known drawn over it";
    vec![
        Operation {
            params: const { &[JOB_ID, LAST_EVENT_ID] },
            ..get("events", "/v1/jobs/{id}/events", "Watch a job", EVENTS, events::watch)
        },
        Operation {
            params: const { &[JOB_ID, RANGE] },
            problems: &[ProblemKind::Conflict, ProblemKind::RangeNotSatisfiable],
            ..get("recording", "/v1/jobs/{id}/recording", "The job's recording (.rrd)", RECORDING, files::recording)
        },
        get("frame", "/v1/jobs/{id}/frame.png", picture, PICTURE, files::frame),
    ]
}

const LAST_EVENT_ID: Param = Param {
    name: events::LAST_EVENT_ID,
    location: ParamIn::Header,
    description: "Number of the last event seen; later ones are sent first. 0 for all that are kept.",
    schema: || json!({"type": "string", "pattern": "^[0-9]{1,18}$"}),
};

const RANGE: Param = Param {
    name: "Range",
    location: ParamIn::Header,
    description: "A single byte range; any other value is ignored.",
    schema: || json!({"type": "string"}),
};

fn plate_operations() -> Vec<Operation> {
    const PLATES: &[ResponseSpec] = &[answer(200, "All plates.", MediaType::Json(schema_of::<Plates>))];
    const PLATE: &[ResponseSpec] = &[answer(200, "The plate.", MediaType::Json(schema_of::<Plate>))];
    const STOPPED: &[ResponseSpec] = &[answer(200, "The plate is stopped.", MediaType::Json(schema_of::<EStopped>))];
    let estop = "Emergency stop: motors to zero, held until a reset; any token may";
    let reset = "End an emergency stop; the plate stays paused";
    let resume = "Let a paused plate go on with its queue, and a paused standing job run";
    vec![
        get("plates", "/v1/plates", "All plates as they are", PLATES, plates::list),
        Operation {
            scope: Some(Scope::Read),
            ..post("estop", "/v1/plates/{name}/estop", estop, STOPPED, plates::estop)
        },
        Operation {
            body: Some(schema_of::<ResetRequest>),
            problems: &[ProblemKind::Conflict, ProblemKind::Invalid, ProblemKind::InsufficientStorage],
            ..post("reset", "/v1/plates/{name}/reset", reset, PLATE, plates::reset)
        },
        Operation {
            problems: &[ProblemKind::Conflict],
            ..post("resume", "/v1/plates/{name}/resume", resume, PLATE, plates::resume)
        },
    ]
}

/// Operations on the daemon itself, and the files it serves. Those without a scope need no token.
fn own_operations() -> Vec<Operation> {
    const HEALTHY: &[ResponseSpec] =
        &[answer(200, "The check passed. On failure: 503 with the reasons.", MediaType::Json(schema_of::<Health>))];
    const METRICS: &[ResponseSpec] = &[answer(200, "OpenMetrics.", MediaType::Media(plates::OPENMETRICS))];
    const DOCUMENT: &[ResponseSpec] = &[answer(200, "OpenAPI 3.1.", MediaType::Media("application/json"))];
    const UNCHANGED: ResponseSpec =
        answer(304, "Not modified: the tag in `If-None-Match` is current.", MediaType::Nothing);
    const PAGE: &[ResponseSpec] = &[answer(200, "The page.", MediaType::Media("text/html")), UNCHANGED];
    const ASSET: &[ResponseSpec] = &[answer(200, "The file.", MediaType::Media("*/*")), UNCHANGED];
    vec![
        Operation { scope: None, ..get("healthz", "/healthz", "Liveness", HEALTHY, plates::healthz) },
        Operation { scope: None, ..get("readyz", "/readyz", "Does it take jobs?", HEALTHY, plates::readyz) },
        get("metrics", "/metrics", "Figures for Prometheus", METRICS, plates::metrics),
        get("openapi", "/openapi.json", "This document", DOCUMENT, files::openapi),
        Operation {
            scope: None,
            problems: &[ProblemKind::NotFound],
            ..get("page", "/", "The operator page", PAGE, files::page)
        },
        Operation { scope: None, ..get("asset", "/assets/{file}", "A file of the operator page", ASSET, files::asset) },
    ]
}

const fn answer(status: u16, description: &'static str, content: MediaType) -> ResponseSpec {
    ResponseSpec { status, description, content, headers: &[] }
}

const JOB_ID: Param = Param {
    name: "id",
    location: ParamIn::Path,
    description: "Id of a job.",
    schema: || json!({"type": "string", "pattern": "^[0-9a-f]{32}$"}),
};
const PLATE_NAME: Param = Param { name: "name", description: "Name of a plate.", ..ASSET_NAME };
const ASSET_NAME: Param = Param {
    name: "file",
    location: ParamIn::Path,
    description: "Name of the file.",
    schema: || json!({"type": "string", "pattern": "^[A-Za-z0-9._-]{1,64}$"}),
};

fn get(
    id: &'static str,
    path: &'static str,
    summary: &'static str,
    answers: &'static [ResponseSpec],
    handler: impl Handler,
) -> Operation {
    let params: &[Param] = match path {
        path if path.contains("{id}") => const { &[JOB_ID] },
        path if path.contains("{name}") => const { &[PLATE_NAME] },
        path if path.contains("{file}") => const { &[ASSET_NAME] },
        _ => &[],
    };
    let (method, scope, handler) = (HttpMethod::Get, Some(Scope::Read), Box::new(handler));
    Operation { id, method, path, scope, summary, params, body: None, answers, problems: &[], handler }
}

fn post(
    id: &'static str,
    path: &'static str,
    summary: &'static str,
    answers: &'static [ResponseSpec],
    handler: impl Handler,
) -> Operation {
    Operation { method: HttpMethod::Post, scope: Some(Scope::Operate), ..get(id, path, summary, answers, handler) }
}
