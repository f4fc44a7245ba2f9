//! Synthesised fields: one periodic motion of many harmonics gives every part its own step at once (equation sheet,
//! section 5).

mod aim;
mod bank;
mod course;
mod guard;
mod limits;
mod planner;
mod strength;
mod waves;

#[cfg(test)]
mod tests;

pub use planner::FieldPlanner;
