//! Synthesised fields: one periodic motion of many harmonics gives every part its own step at once (equation sheet,
//! section 5).

mod harmonic_basis;
mod limits;
mod motor_effort;
mod moving;
mod optimizer;
mod planner;
mod rollout;
mod seeds;
mod separation;

#[cfg(test)]
mod tests;

pub use moving::{Heading, MovingPlanner, Segment};
pub use planner::FieldPlanner;
