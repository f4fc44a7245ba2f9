//! Sequences of rotations about centres of the library: look-up, program, order, refinement.
//!
//! ```text
//!  steps ─► subgoals ─► displacement_matrix ─► least_time ─► order ─► refine ─► pulses, four at a time
//!                            ▲  ▲               (clarabel)           (clarabel)      │
//!                            │  └─────────────── prices ◄────┘          ▲            │ observation
//!                        motion_set ─────────── rollout ────────────────┘◄───────────┘
//! ```

mod belt_table;
mod displacement_matrix;
mod least_time;
mod motion_set;
mod planner;
mod refine;
mod rollout;
mod single;
mod stride;
mod subgoals;

#[cfg(test)]
mod tests;

pub use planner::RotationPlanner;
