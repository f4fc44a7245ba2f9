//! The HTTP API: the server with its guard and limits, the table of operations, and the OpenAPI document generated from
//! the same table. The only module that uses tokio; its callers see a blocking function.
//!
//! The API reaches store and plates only through the trait [`Backend`].

mod api;
mod http;

pub use api::{
    AppParts, Asset, Backend, CameraPicture, Checked, EStopped, EventSender, HttpMetrics, JOB_OVER, Job, JobCreated,
    JobsPage, JobsQuery, LayoutPart, LayoutPath, LayoutView, PauseCause, Pending, Plate, PlateCondition, Plates,
    Recording, Refusal, ReplayPage, Requests, ResetRequest, Responder, StandingJob, StreamEvent, StreamStart,
    Submission, app, pending, ready,
};

pub use crate::states::{JobState, PlateState, RecordingStatus, StandingState};
pub use http::{
    AllowedHosts, BodyMemoryLimit, Caller, HttpLimits, Problem, ProblemDocument, ProblemKind, Reason, ReasonCode,
    Scope, SharedTokens, ShutdownReport, StopFlag, StopSender, Tokens, joined, serve,
};
pub use upm_core::job::Pace;
