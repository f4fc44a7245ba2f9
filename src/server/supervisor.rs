//! The supervisor of the plates. Each plate has a thread that runs its jobs one after another and its standing job
//! while the queue is empty, an emergency stop that never blocks, and subscribers, which are notified without the plate
//! waiting for them.
//!
//! ```text
//!            wake            try_send            send (after commit)
//!  submit ────────► worker ───────────► publisher ──────────────────► store
//!                     │ run                │ offer
//!  estop ─► latch     ▼                    ▼
//!        └► interlock rig                 subscribers: event streams, pages
//! ```

mod current_job;
mod draw;
mod emergency_stop;
mod event_publisher;
mod events;
mod latch;
mod plate;
mod preview;
mod run_observer;
mod setup;
mod shared;
mod standing;
mod start;
#[cfg(test)]
mod tests;
mod types;
mod validate;
mod watchdog;
mod worker;

pub use events::{EventSubscriber, JobEvent};
pub use latch::StopToken;
pub use plate::{PlateHandle, ResetRequester};
pub use preview::PreviewPicture;
pub use setup::{PlateSetup, SharedServices, StandingSetup};
pub use start::PlateSupervisor;
pub use types::{LastObservation, Pause, PlateSnapshot, ResetFault};

pub use crate::states::{PlateState, StandingState};
pub use upm_runner::config::{JobLayout, LayoutPart, LayoutPath};
