//! Time figure of a job: a rough plate time of its steps by rotations, by which jobs are compared.

use std::sync::Arc;

use crate::config::{JobSpec, TaskSpec};
use upm_control::{ControlParams, CycleFacts, Sink};
use upm_cor_library::Library;
use upm_core::geometry::Vec2;
use upm_planner::{PartState, RotationPlanner};

/// Most parts of a job with a time figure: the program takes 50 to 200 ms for 16 parts and grows with their third
/// power.
const MOST_PARTS: usize = 16;

/// Rough plate time by rotations from `starts_m` to `targets_m`, s: the relaxed program over the library at the flows
/// of the start, which is no bound: a run by rotations may take half of it. Jobs by synthesised fields have the figure
/// of rotations, too.
///
/// `None` for tasks whose parts follow paths or stay at their places, for more than 16 parts, and where the library
/// cannot make the steps.
pub(super) fn time_figure_s(
    job: &JobSpec,
    library: &Arc<Library>,
    params: &ControlParams,
    starts_m: &[Vec2],
    targets_m: &[Vec2],
) -> Option<f64> {
    let has_final_targets = match job.task {
        TaskSpec::Arrange { .. } | TaskSpec::Sort { .. } => true,
        TaskSpec::PlusSign { .. } | TaskSpec::Trajectories { .. } | TaskSpec::Hold { .. } => false,
    };
    let counts = 1..=MOST_PARTS;
    if !has_final_targets || !counts.contains(&starts_m.len()) || starts_m.len() != targets_m.len() {
        return None;
    }
    let part = |(i, (&position_m, target_m)): (usize, (&Vec2, &Vec2))| PartState {
        position_m,
        step_m: target_m - position_m,
        radius_m: params.radius_m(i),
        gain: 1.0,
    };
    let parts: Vec<PartState> = starts_m.iter().zip(targets_m).enumerate().map(part).collect();
    RotationPlanner::new(Arc::clone(library), params.planner).least_time_s(&parts)
}

/// Positions and final targets at the first observation of a run. The figure is computed after the run, so that it
/// costs the run no time.
#[derive(Clone, Debug, Default)]
pub(super) struct FirstObservation {
    observed_m: Vec<Vec2>,
    targets_m: Vec<Vec2>,
}

impl FirstObservation {
    /// Time figure of the run; also `None` for a run that ended in its first cycle.
    pub fn time_figure_s(&self, job: &JobSpec, library: &Arc<Library>, params: &ControlParams) -> Option<f64> {
        time_figure_s(job, library, params, &self.observed_m, &self.targets_m)
    }
}

impl Sink for FirstObservation {
    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        if facts.index == 0 {
            (self.observed_m, self.targets_m) = (facts.observed_m.to_vec(), facts.wanted.targets_m.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use serde_json::{Value, json};

    use super::*;
    use crate::config::Origin;
    use crate::run::{RunSetup, job_library};

    /// Time figure of a job of pennies on `upm-2`, from their starts to `targets_m`.
    fn figure(pennies: &[[f64; 2]], task: Value, targets_m: &[Vec2]) -> Option<f64> {
        let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/job.json");
        let parts: Vec<Value> = pennies.iter().map(|at| json!({"kind": "penny", "position_mm": at})).collect();
        let job = json!({"name": "made", "rig": "rigs/upm-2.json", "parts": parts, "task": task});
        let job = JobSpec::from_json(&job.to_string(), &Origin::of_file(&folder), None).unwrap();
        let library = job_library(&job).unwrap();
        let setup = RunSetup::new(&job, &library).unwrap();
        let starts_m: Vec<Vec2> = setup.placed.iter().map(|part| part.position_m).collect();
        time_figure_s(&job, &library, &setup.params, &starts_m, targets_m)
    }

    #[test]
    fn figure_grows_with_the_way() {
        let task = |x: f64| json!({"type": "arrange", "targets_mm": [[x, 0.0], [0.0, 60.0]]});
        let at = |x_mm: f64| {
            let targets_m = [Vec2::new(1e-3 * x_mm, 0.0), Vec2::new(0.0, 0.06)];
            figure(&[[0.0, 0.0], [0.0, 60.0]], task(x_mm), &targets_m).unwrap()
        };
        let (near_s, far_s) = (at(20.0), at(60.0));
        assert!(0.05 < near_s && 2.0 * near_s < far_s && far_s < 60.0, "{near_s} {far_s}");
        assert_eq!(at(0.0), 0.0, "no way takes no time");
    }

    #[test]
    fn tasks_without_final_targets_and_many_parts_have_no_figure() {
        assert_eq!(figure(&[[0.0, 0.0]], json!({"type": "plus_sign", "laps": 1}), &[Vec2::new(0.05, 0.0)]), None);
        assert_eq!(figure(&[[0.0, 0.0]], json!({"type": "hold", "duration_s": 1}), &[Vec2::zeros()]), None);
        let places: Vec<[f64; 2]> =
            (0..17).map(|i| [-120.0 + 50.0 * f64::from(i % 5), -90.0 + 50.0 * f64::from(i / 5)]).collect();
        let targets_m: Vec<Vec2> = places.iter().map(|at| 1e-3 * Vec2::from(*at)).collect();
        assert_eq!(figure(&places, json!({"type": "arrange", "targets_mm": places}), &targets_m), None);
    }
}
