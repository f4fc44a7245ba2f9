//! Tasks: where the parts should go, in the table's frame, independent of plates and motors.

mod arrange;
mod assignment;
#[cfg(test)]
mod closed_loop_tests;
mod hold;
mod least_effort;
mod multi_disc;
mod path_follower;
mod plus_sign;
mod room;
mod routes;
mod sequence;
mod slots;
mod sort;
mod space_time_astar;
mod staging;
mod trajectories;
mod turns;

pub use arrange::{Arrange, ArrangeParams};
pub use hold::{Hold, HoldParams};
pub use least_effort::Effort;
pub use path_follower::{Motions, PlateScene};
pub use plus_sign::{PlusSign, PlusSignParams};
pub use sequence::Sequence;
pub use sort::{BinParams, Sort, SortParams};
pub use trajectories::{PathParams, Trajectories, TrajectoriesParams};

use upm_core::geometry::{Polyline, Vec2};
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
    /// Number of the present task of several, from 1; 0 for one alone.
    pub task: usize,
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
    /// For each part the stretch of its path at present; empty where no part has a path.
    pub paths: Vec<Option<PathStretch>>,
    /// The last completed lap, where it took longer than asked.
    pub late_lap: Option<LateLap>,
    /// Indices of the parts without a path to their targets at present.
    pub blocked: Vec<usize>,
    /// Phase of each part along its path relative to the common reference, as a fraction of a period; empty where parts
    /// need not keep in phase.
    pub phase_error: Vec<f64>,
    /// True when the task is complete.
    pub done: bool,
}

impl Setpoints {
    /// True where parts at `places_m` have nowhere to go: the task is complete, or waits.
    pub fn asks_nothing(&self, places_m: &[Vec2]) -> bool {
        self.done || self.subgoals_m == places_m
    }
}

/// The stretch of its path on which a part moves in a cycle. Arc lengths count from the beginning of the path over all
/// laps.
#[derive(Clone, Debug, PartialEq)]
pub struct PathStretch {
    /// The stretch, from behind the part to beyond its subgoal.
    pub line: Polyline,
    /// Arc length at which it begins, m.
    pub from_m: f64,
    /// Arc length of the reference at the observation, m.
    pub reference_m: f64,
    /// Speed of the reference, m/s; 0 where none is asked.
    pub speed_mps: f64,
    /// Length of a lap, m.
    pub lap_m: f64,
    /// Largest distance from the line, m.
    pub corridor_m: f64,
    /// True for a part that waits at the end of its path.
    pub is_over: bool,
}

impl PathStretch {
    /// Arc length of the point nearest to `p_m`, m, and its distance from `p_m`, m.
    pub fn nearest(&self, p_m: Vec2) -> (f64, f64) {
        let (along_m, off_m) = self.line.nearest(p_m, 0.0, self.line.length_m());
        (self.from_m + along_m, off_m)
    }

    /// The reference's place `after_s` later, m, and its mean velocity over `period_s` about that time, m/s.
    pub fn reference_in(&self, after_s: f64, period_s: f64) -> (Vec2, Vec2) {
        let at = |after_s: f64| self.line.at((self.reference_m - self.from_m + self.speed_mps * after_s).max(0.0));
        (at(after_s), (at(after_s + 0.5 * period_s) - at(after_s - 0.5 * period_s)) / period_s)
    }
}

/// A lap that took longer than asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LateLap {
    /// Number of the lap, from 1.
    pub lap: u32,
    /// Its plate time, s.
    pub took_s: f64,
    /// Plate time at the speed asked, s.
    pub asked_s: f64,
}

/// A task as a source of subgoals.
pub trait Task {
    /// Records the parts' positions at the very first observation, however long it takes until the first
    /// [`Task::next`].
    fn first_seen(&mut self, _parts_in_table_m: &[Vec2]) {}

    /// Returns the output for the parts' present positions. Called once per cycle, in order of time.
    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints;

    /// Begins the next of several tasks with parts at rest there, once [`Task::next`] says that the present one is
    /// complete; false where it was the last.
    fn go_on(&mut self, _parts_in_table_m: &[Vec2]) -> bool {
        false
    }
}

/// Radius of a US penny, m.
#[cfg(test)]
const PENNY_M: f64 = 0.009525;
