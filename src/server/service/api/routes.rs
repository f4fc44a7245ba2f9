use serde_json::json;

use super::table::{Answer, Content, Method, Operation, Param, Place, schema_of};
use super::types::{EStopped, Job, JobsPage, Plate, Plates, ResetRequest, Well};
use super::{events, files, jobs, plates};
use crate::service::http::{ProblemKind, Scope};
use crate::states::JobState;
use upm_core::job::Pace;
use upm_runner::config::RawJob;

const JOB_ID: Param = Param {
    name: "id",
    place: Place::Path,
    what: "Id of a job.",
    schema: || json!({"type": "string", "pattern": "^[0-9a-f]{32}$"}),
};
const PLATE: Param = Param {
    name: "name",
    place: Place::Path,
    what: "Name of a plate.",
    schema: || json!({"type": "string", "pattern": "^[A-Za-z0-9._-]{1,64}$"}),
};

const OF_A_JOB: &[Param] = &[JOB_ID];
const OF_A_PLATE: &[Param] = &[PLATE];

const fn answer(status: u16, what: &'static str, content: Content) -> Answer {
    Answer { status, what, content, headers: &[] }
}

/// Everything that can be asked of the daemon.
pub(super) fn operations() -> Vec<Operation> {
    [job_operations(), file_operations(), plate_operations(), own_operations()].into_iter().flatten().collect()
}

fn job_operations() -> Vec<Operation> {
    let of_a_job = |id, method, path, scope, what, handler| Operation {
        params: OF_A_JOB,
        answers: const { &[answer(200, "The job.", Content::Json(schema_of::<Job>))] },
        ..plain(id, method, path, Some(scope), what, handler)
    };
    vec![
        Operation {
            params: SUBMIT_PARAMS,
            body: Some(schema_of::<RawJob>),
            answers: SUBMIT_ANSWERS,
            problems: &[
                ProblemKind::Conflict,
                ProblemKind::Invalid,
                ProblemKind::QueueFull,
                ProblemKind::InsufficientStorage,
            ],
            ..plain("submit", Method::Post, "/v1/jobs", Some(Scope::Operate), "Queue a job", jobs::submit)
        },
        Operation {
            params: LIST_PARAMS,
            answers: const { &[answer(200, "A page of jobs.", Content::Json(schema_of::<JobsPage>))] },
            ..plain("jobs", Method::Get, "/v1/jobs", Some(Scope::Read), "List jobs, newest first", jobs::list)
        },
        of_a_job("job", Method::Get, "/v1/jobs/{id}", Scope::Read, "A job and its report", jobs::show),
        Operation {
            problems: &[ProblemKind::Conflict, ProblemKind::InsufficientStorage],
            ..of_a_job(
                "cancel",
                Method::Post,
                "/v1/jobs/{id}/cancel",
                Scope::Operate,
                "Take a job out of the queue, or stop it",
                jobs::cancel,
            )
        },
    ]
}

const SUBMIT_PARAMS: &[Param] = &[
    Param {
        name: jobs::IDEMPOTENCY_KEY,
        place: Place::Header,
        what: "The same key and body again within a day give the same job again.",
        schema: || json!({"type": "string", "pattern": "^[!-~]{1,255}$"}),
    },
    Param {
        name: "pace",
        place: Place::Query,
        what: "How fast the job runs; left out: as the daemon's configuration says, `real-time` unless changed.",
        schema: || json!({"type": "string", "enum": Pace::ALL.map(Pace::name)}),
    },
];

const SUBMIT_ANSWERS: &[Answer] = &[Answer {
    status: 201,
    what: "The job is queued, and on the disk.",
    content: Content::Json(schema_of::<Job>),
    headers: &[
        ("Location", "Where the job is."),
        ("Idempotency-Replayed", "`true` when the job had been queued before, under the same key."),
    ],
}];

const LIST_PARAMS: &[Param] = &[
    Param {
        name: "state",
        place: Place::Query,
        what: "Only jobs in this state.",
        schema: || json!({"type": "string", "enum": JobState::ALL.map(JobState::name)}),
    },
    Param {
        name: "limit",
        place: Place::Query,
        what: "Most jobs on the page.",
        schema: || json!({"type": "integer", "minimum": 1, "maximum": 200, "default": 50}),
    },
    Param {
        name: "cursor",
        place: Place::Query,
        what: "`next` of the page before.",
        schema: || json!({"type": "string", "pattern": "^[0-9a-f]{32}$"}),
    },
];

fn file_operations() -> Vec<Operation> {
    let of_a_job = |id, path, what, handler| Operation {
        params: OF_A_JOB,
        ..plain(id, Method::Get, path, Some(Scope::Read), what, handler)
    };
    vec![
        Operation {
            params: const { &[JOB_ID, LAST_EVENT_ID] },
            answers: const {
                &[answer(
                    200,
                    "Server-sent events: `snapshot`, then what was missed, then what happens. An `id` once seen can \
                     be resumed from, that of a `snapshot` too; `gap` tells of events that cannot be had any more. \
                     `bye` ends the stream: unless a `finished` came before, it can be resumed.",
                    Content::Media(events::EVENT_STREAM),
                )]
            },
            ..of_a_job("events", "/v1/jobs/{id}/events", "Watch a job", events::watch)
        },
        Operation {
            params: const { &[JOB_ID, RANGE] },
            answers: RECORDING_ANSWERS,
            problems: &[ProblemKind::Conflict, ProblemKind::RangeNotSatisfiable],
            ..of_a_job("recording", "/v1/jobs/{id}/recording", "The job's recording (.rrd)", files::recording)
        },
        Operation {
            answers: const { &[PICTURE] },
            ..of_a_job(
                "frame",
                "/v1/jobs/{id}/frame.png",
                "The latest camera frame, what is known drawn over it",
                files::frame,
            )
        },
    ]
}

const LAST_EVENT_ID: Param = Param {
    name: events::LAST_EVENT_ID,
    place: Place::Header,
    what: "Number of the last event seen; later ones are sent first. 0 for all that are kept.",
    schema: || json!({"type": "string", "pattern": "^[0-9]{1,18}$"}),
};

const RANGE: Param = Param {
    name: "Range",
    place: Place::Header,
    what: "One range of bytes; anything else is not looked at.",
    schema: || json!({"type": "string"}),
};

const PICTURE: Answer = Answer {
    status: 200,
    what: "The picture, at most a few seconds old.",
    content: Content::Media("image/png"),
    headers: &[("Upm-Age-Ms", "Wall time since it was taken, ms: a whole number.")],
};

const RECORDING_ANSWERS: &[Answer] = &[
    Answer {
        status: 200,
        what: "The whole file.",
        content: Content::Media(files::RRD),
        headers: &[("ETag", "Changes with the file."), ("Accept-Ranges", "`bytes`.")],
    },
    Answer {
        status: 206,
        what: "The bytes asked for.",
        content: Content::Media(files::RRD),
        headers: &[("ETag", "Changes with the file."), ("Content-Range", "Which bytes of how many.")],
    },
];

fn plate_operations() -> Vec<Operation> {
    let of_a_plate = |id, path, scope, what, handler| Operation {
        params: OF_A_PLATE,
        answers: const { &[answer(200, "The plate.", Content::Json(schema_of::<Plate>))] },
        problems: &[ProblemKind::Conflict],
        ..plain(id, Method::Post, path, Some(scope), what, handler)
    };
    vec![
        Operation {
            answers: const { &[answer(200, "All plates.", Content::Json(schema_of::<Plates>))] },
            ..plain("plates", Method::Get, "/v1/plates", Some(Scope::Read), "All plates as they are", plates::list)
        },
        Operation {
            answers: const { &[answer(200, "The plate is stopped.", Content::Json(schema_of::<EStopped>))] },
            problems: &[],
            ..of_a_plate(
                "estop",
                "/v1/plates/{name}/estop",
                Scope::Read,
                "Emergency stop: motors to zero, held until a reset; any token may",
                plates::estop,
            )
        },
        Operation {
            body: Some(schema_of::<ResetRequest>),
            problems: &[ProblemKind::Conflict, ProblemKind::Invalid, ProblemKind::InsufficientStorage],
            ..of_a_plate(
                "reset",
                "/v1/plates/{name}/reset",
                Scope::Operate,
                "End an emergency stop; the plate stays paused",
                plates::reset,
            )
        },
        of_a_plate(
            "resume",
            "/v1/plates/{name}/resume",
            Scope::Operate,
            "Let a paused plate go on with its queue, and a paused standing job run",
            plates::resume,
        ),
    ]
}

fn own_operations() -> Vec<Operation> {
    const WELL: &[Answer] = &[answer(200, "Yes. Otherwise 503 and why.", Content::Json(schema_of::<Well>))];
    let open =
        |id, path, what, answers, handler| Operation { answers, ..plain(id, Method::Get, path, None, what, handler) };
    vec![
        open("healthz", "/healthz", "Is the daemon well?", WELL, plates::healthz),
        open("readyz", "/readyz", "Does it take jobs?", WELL, plates::readyz),
        Operation {
            answers: const { &[answer(200, "OpenMetrics.", Content::Media(plates::OPENMETRICS))] },
            ..plain("metrics", Method::Get, "/metrics", Some(Scope::Read), "Figures for Prometheus", plates::metrics)
        },
        Operation {
            answers: const { &[answer(200, "OpenAPI 3.1.", Content::Media("application/json"))] },
            ..plain("openapi", Method::Get, "/openapi.json", Some(Scope::Read), "This document", files::openapi)
        },
        Operation {
            problems: &[ProblemKind::NotFound],
            ..open("page", "/", "The operator page", const { &[PAGE, SAME_AS_BEFORE] }, files::page)
        },
        Operation {
            params: const { &[ASSET] },
            ..open(
                "asset",
                "/assets/{file}",
                "A file of the operator page",
                const { &[ASSET_ANSWER, SAME_AS_BEFORE] },
                files::asset,
            )
        },
    ]
}

const ASSET: Param = Param {
    name: "file",
    place: Place::Path,
    what: "Name of the file.",
    schema: || json!({"type": "string", "pattern": "^[A-Za-z0-9._-]{1,64}$"}),
};
const PAGE: Answer = answer(200, "The page.", Content::Media("text/html"));
const ASSET_ANSWER: Answer = answer(200, "The file.", Content::Media("*/*"));
const SAME_AS_BEFORE: Answer = answer(304, "As it was: its `If-None-Match` still holds.", Content::Nothing);

fn plain(
    id: &'static str,
    method: Method,
    path: &'static str,
    scope: Option<Scope>,
    what: &'static str,
    handler: fn(super::table::Call) -> super::table::Outcome,
) -> Operation {
    Operation { id, method, path, scope, what, params: &[], body: None, answers: &[], problems: &[], handler }
}
