//! Where the parts should go, said without a word about plates.

mod arrange;
mod assignment;
#[cfg(test)]
mod closed_loop_tests;
mod fleet;
mod hold;
mod in_phase;
mod least_effort;
mod plus_sign;
mod routes;
mod search;
mod slots;
mod sort;
mod stages;
mod steering;
mod trajectories;
mod turns;

pub use arrange::{Arrange, ArrangeParams};
pub use hold::{Hold, HoldParams};
pub use in_phase::{InPhase, InPhaseParams};
pub use least_effort::Effort;
pub use plus_sign::{PlusSign, PlusSignParams};
pub use sort::{BinParams, Sort, SortParams};
pub use steering::Motions;
pub use trajectories::{PathParams, Trajectories};

use upm_core::geometry::Vec2;
use upm_core::time::PlateTime;

/// A part as a goal knows it: a disc.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Disc {
    /// Parts of equal kind are equal.
    pub kind: usize,
    /// Its outline, m.
    pub radius_m: f64,
}

/// What a goal wants of the parts just now.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wanted {
    /// For each part where it should go next, m. It may be further than one cycle reaches: while all parts go straight
    /// there and in step, each the same part of its way, arranged parts keep apart and on the plate.
    pub subgoals_m: Vec<Vec2>,
    /// For each part where it shall end, m; on endless tasks the end of the present stretch.
    pub targets_m: Vec<Vec2>,
    /// What is being done, in words: `lap 2 of 3: branch +x, outwards`.
    pub phase: String,
    /// Part of the whole task that is done, 0 to 1; stays 0 on endless paths.
    pub progress: f64,
    /// Laps completed.
    pub laps: u32,
    /// For each part the distance from its path, m; 0 where there is no path.
    pub cross_track_m: Vec<f64>,
    /// Indices of the parts that have no way to their targets as things stand.
    pub boxed_in: Vec<usize>,
    /// For each part how far along its path it is off the common reference, as a part of a period; empty where
    /// parts need not keep step.
    pub phase_error: Vec<f64>,
    /// True when nothing is left to do.
    pub done: bool,
}

/// A task as a source of subgoals.
pub trait Goal {
    /// Takes where the parts were found at the very first look, however long it takes until the first [`Goal::next`].
    fn first_seen(&mut self, _parts_in_table_m: &[Vec2]) {}

    /// Looks at where the parts are and says what is wanted next. Called once a cycle, in order of time.
    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Wanted;
}

/// Radius of a US penny, m.
#[cfg(test)]
const PENNY_M: f64 = 0.009525;
