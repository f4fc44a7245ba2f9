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
mod dry_runs;
mod emergency_stop;
mod job_rules;
mod latch;
mod plate;
mod preview;
mod run_observer;
mod start;
#[cfg(test)]
mod tests;
mod types;
mod watchdog;
mod worker;

pub use dry_runs::DryRunState;
pub(crate) use dry_runs::{DryRunError, DryRunSlot};
pub use plate::PlateHandle;
pub use start::PlateSupervisor;
pub(crate) use types::ResetError;
pub use types::{Observation, Plate};

pub use crate::states::PlateState;
