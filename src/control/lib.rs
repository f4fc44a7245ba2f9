//! The control cycle (observe, ask the task, plan, play, observe again) and the reasons for which a run ends.
//!
//! Neither this crate nor anything it imports can reach ground truth: its only inputs are frames and traces.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod calibration;
mod cycle;
mod facts;
mod findings;
mod found;
mod gain_estimator;
mod guards;
mod hindrance;
mod params;
mod perception;
mod progress;
mod pulse_planner;
mod run_end;
mod run_io;

pub use cycle::{FinalState, fallbacks, run};
pub use facts::{
    ConfirmedFacts, CycleFacts, EventFacts, EventKind, FrameFacts, LocalisedFacts, PulseFacts, PulsePositions, Sink,
};
pub use found::{Found, Reason};
pub use gain_estimator::GainEstimator;
pub use guards::Guards;
pub use params::ControlParams;
pub use perception::ExpectedPart;
pub use pulse_planner::OwnPlanner;
pub use run_end::RunEnd;
pub use run_io::RunIo;
pub use upm_core::job::EventLevel;
