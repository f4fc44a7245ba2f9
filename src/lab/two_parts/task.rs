//! The large step with two parts, and their paths to its goals in one observation and in several.

use super::super::{LabError, LabRig};
use super::plan::{CENTERS, PartPositions, distances, mean_miss};
use upm_core::geometry::Vec2;

/// Corners of the workspace, in half sides of the plate: counter-clockwise from the upper left, in the order of
/// rotation.
const CORNERS: [[f64; 2]; CENTERS] = [[-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]];
/// Starts and goals, in half sides of the plate; the steps are large on purpose, as in the paper.
const STARTS: [[f64; 2]; 2] = [[-0.26, -0.19], [0.49, 0.0]];
const GOALS: [[f64; 2]; 2] = [[-0.6, -0.11], [0.3, -0.29]];
/// Numbers of observations into which the step is split.
pub const OBSERVATIONS: [usize; 4] = [1, 2, 4, 8];

/// The problem on a plate of this size.
pub struct TwoPartProblem {
    pub half_side_m: f64,
    pub centers_m: [Vec2; CENTERS],
    pub starts_m: PartPositions,
    pub goals_m: PartPositions,
}

impl TwoPartProblem {
    pub fn on(rig: &LabRig) -> Self {
        let half_side_m = 0.5 * rig.sim.plate.side_m;
        let scaled = |[x, y]: [f64; 2]| Vec2::new(x, y) * half_side_m;
        Self { half_side_m, centers_m: CORNERS.map(scaled), starts_m: STARTS.map(scaled), goals_m: GOALS.map(scaled) }
    }

    /// Target positions after `done` of `observations` observations: on straight lines to the goals.
    fn waypoints_m(&self, done: usize, observations: usize) -> PartPositions {
        let share = done as f64 / observations as f64;
        std::array::from_fn(|i| self.starts_m[i] + (self.goals_m[i] - self.starts_m[i]) * share)
    }

    /// Splits the step into `observations` observations; at each, solves for d at the parts' present positions and
    /// rotates them by it with `rotate`, centre after centre.
    pub fn go(
        &self,
        observations: usize,
        mut rotate: impl FnMut(&PartPositions, usize, f64) -> Result<PartPositions, LabError>,
    ) -> Result<TwoPartPath, LabError> {
        let (mut at, mut corners) = (self.starts_m, vec![self.starts_m]);
        for number in 1..=observations {
            let wanted = self.waypoints_m(number, observations);
            let d_m = distances(&self.centers_m, &at, &wanted)?;
            for (center, &d) in d_m.iter().enumerate() {
                at = rotate(&at, center, d)?;
                corners.push(at);
            }
        }
        Ok(TwoPartPath { corners, miss_m: mean_miss(&at, &self.goals_m) })
    }
}

/// Course of both parts through a step, with the error at its end.
pub struct TwoPartPath {
    /// Positions initially and after each rotation.
    pub corners: Vec<PartPositions>,
    /// E at the end, m.
    pub miss_m: f64,
}

/// The step by one mover in 1, 2, 4 and 8 observations.
pub struct StepSeries {
    pub name: &'static str,
    /// Numbers of observations and the resulting paths.
    pub ways: Vec<(usize, TwoPartPath)>,
    /// Numbers of observations that failed, and the reason: a part fell, or the four fields became dependent.
    pub failed: Vec<(usize, LabError)>,
}

impl StepSeries {
    pub fn of(
        name: &'static str,
        task: &TwoPartProblem,
        rotate: impl Fn(&PartPositions, usize, f64) -> Result<PartPositions, LabError>,
    ) -> Self {
        let mut runs = Self { name, ways: Vec::new(), failed: Vec::new() };
        for observations in OBSERVATIONS {
            match task.go(observations, &rotate) {
                Ok(way) => runs.ways.push((observations, way)),
                Err(fault) => runs.failed.push((observations, fault)),
            }
        }
        runs
    }

    /// E after `observations` observations, m.
    pub fn miss_m(&self, observations: usize) -> Option<f64> {
        self.ways.iter().find(|(of, _)| *of == observations).map(|(_, way)| way.miss_m)
    }
}
