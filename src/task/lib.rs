//! Tasks: where the parts should go, in the table's frame, independent of plates and motors.

mod arrange;
mod assignment;
#[cfg(test)]
mod closed_loop_tests;
mod hold;
mod in_phase;
mod least_effort;
mod multi_disc;
mod path_follower;
mod plus_sign;
mod routes;
mod slots;
mod sort;
mod space_time_astar;
mod staging;
mod trajectories;
mod turns;

pub use arrange::{Arrange, ArrangeParams};
pub use hold::{Hold, HoldParams};
pub use in_phase::{InPhase, InPhaseParams};
pub use least_effort::Effort;
pub use path_follower::Motions;
pub use plus_sign::{PlusSign, PlusSignParams};
pub use sort::{BinParams, Sort, SortParams};
pub use trajectories::{PathParams, Trajectories};

use upm_core::geometry::Vec2;
use upm_core::time::PlateTime;

/// A part as tasks see it: a disc.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartOutline {
    /// Kind number; parts of one kind are interchangeable.
    pub kind: usize,
    /// Radius of its outline, m.
    pub radius_m: f64,
}

/// Output of a task for one cycle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Setpoints {
    /// Next position of each part, m. It may be further than one cycle reaches: while all parts go straight there and
    /// in step, each the same fraction of its displacement, arranged parts keep apart and on the plate.
    pub subgoals_m: Vec<Vec2>,
    /// Final position of each part, m; on endless tasks the end of the present stretch.
    pub targets_m: Vec<Vec2>,
    /// Present activity, in words: `lap 2 of 3: branch +x, outwards`.
    pub phase: String,
    /// Bound of a part's displacement in one sequence of rotations, m, where the task has one.
    pub stride_m: Option<f64>,
    /// Completed fraction of the whole task, 0 to 1; stays 0 on endless paths.
    pub progress: f64,
    /// Laps completed.
    pub laps: u32,
    /// For each part the distance from its path, m; 0 where there is no path.
    pub cross_track_m: Vec<f64>,
    /// Indices of the parts without a path to their targets at present.
    pub blocked: Vec<usize>,
    /// Phase of each part along its path relative to the common reference, as a fraction of a period; empty where parts
    /// need not keep in phase.
    pub phase_error: Vec<f64>,
    /// True when the task is complete.
    pub done: bool,
}

/// A task as a source of subgoals.
pub trait Task {
    /// Records the parts' positions at the very first observation, however long it takes until the first
    /// [`Task::next`].
    fn first_seen(&mut self, _parts_in_table_m: &[Vec2]) {}

    /// Returns the output for the parts' present positions. Called once per cycle, in order of time.
    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints;
}

/// Radius of a US penny, m.
#[cfg(test)]
const PENNY_M: f64 = 0.009525;
