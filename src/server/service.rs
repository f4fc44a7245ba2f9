//! The HTTP API: the server with its guard and limits, the operations as one table, and the OpenAPI document made from the
//! same table. The only room that knows tokio; to the outside it is a function that blocks.
//!
//! The trait [`Desk`] is all that the API knows of store and plates.

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
