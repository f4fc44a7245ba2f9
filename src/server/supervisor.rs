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

pub use plate::PlateHandle;
pub use start::PlateSupervisor;
pub(crate) use types::ResetError;
pub use types::{Observation, Plate};

pub use crate::states::PlateState;
