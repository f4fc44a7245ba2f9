//! The HTTP API: the server with its guard and limits, the table of operations, and the OpenAPI document generated from
//! the same table. The only module that uses tokio; its callers see a blocking function.
//!
//! The API reaches store and plates only through the trait [`Desk`].

mod api;
mod http;

pub use api::{
    AppParts, Asset, Checked, Desk, EStopped, Event, Feed, JOB_OVER, Job, JobsPage, JobsQuery, Layout, LayoutPart,
    LayoutPath, Opening, Order, PauseCause, Picture, Plate, PlateCondition, Plates, Promise, Recording, Refusal,
    Replayed, Reply, Requests, ResetRequest, StandingJob, Submitted, Traffic, app, kept, promise,
};

pub use crate::states::{JobState, PlateState, RecordingStatus, StandingState};
pub use http::{
    BodyRoom, Caller, Hosts, Limits, Problem, ProblemDocument, ProblemKind, Reason, ReasonCode, Scope, Served,
    SharedTokens, StopFlag, StopSender, Tokens, joined, serve,
};
pub use upm_core::job::Pace;
