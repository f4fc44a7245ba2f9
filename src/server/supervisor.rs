//! The supervisor of the plates. Each plate has a thread that runs its jobs one after another and its standing job
//! while the queue is empty, and an emergency stop that never blocks.
//!
//! ```text
//!            wake           claim, finish
//!  submit ────────► worker ───────────────► store
//!                     │ run
//!  estop ─► latch     ▼
//!        └► interlock rig
//! ```

mod current_job;
mod draw;
mod emergency_stop;
mod latch;
mod layout;
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

pub use latch::StopToken;
pub use layout::{LayoutPartView, LayoutPathView, LayoutView};
pub use setup::{PlateSetup, SharedServices};
pub use shared::PlateHandle;
pub use start::PlateSupervisor;
pub use types::{Plate, ResetFault};

pub use crate::states::{PlateState, StandingState};
