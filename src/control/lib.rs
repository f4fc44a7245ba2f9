//! The control cycle (look, ask the goal, plan, play, look again) and the supervisor that ends a run in good order.
//!
//! Neither this crate nor anything it imports can reach ground truth: its only inputs are frames and traces.

pub mod calibration;
mod condition;
mod conditions;
mod cycle;
mod ending;
mod eyes;
mod facts;
mod guards;
mod learning;
mod params;
mod planning;
mod plans;
mod progress;
mod rehearsal;

pub use condition::{Condition, ConditionChange};
pub use cycle::{Devices, Finish, run};
pub use ending::Ending;
pub use eyes::{ExpectedPart, Eyes, Moment};
pub use facts::{
    Carried, ConditionFacts, ConfirmedFacts, CycleFacts, EventLevel, FrameFacts, LocalisedFacts, Milestone,
    MilestoneFacts, PulseFacts, Sink,
};
pub use guards::Guards;
pub use params::ControlParams;
pub use plans::FreshPlanner;
pub use rehearsal::{LimitMet, Nearest, Rehearsal, RehearsalParams, rehearse};
