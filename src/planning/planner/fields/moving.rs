//! Motions for parts that move: segments of one period, each of which takes over from the last one without a pause.
//!
//! Over its period the motion of a segment replaces the last one, as a cross-fade of the plate's displacement. Where no
//! segment follows, the motion plays for another period and fades out over a third one. While a segment plays, the next
//! one is planned for the state that the parts will have at its end.

mod aims;
mod constrained;
mod filter;
mod model;
mod motion;
mod planner;
mod search;

#[cfg(test)]
mod tests;

pub use aims::Heading;
pub use planner::{MovingPlanner, Segment};
