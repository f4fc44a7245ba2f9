//! Finest tolerance that a job can hold on its rig.

use std::f64::consts::SQRT_2;

use super::planner_selection::PlannerSelection;
use super::setup::{MEASURED_SHARE, MIN_DISTANCE_M};
use crate::config::{Diagnostic, FIELD_SCATTER_M, JobSpec, TaskSpec, accuracy_m};
use upm_core::units::mm_from_m;
use upm_planning::cor_library::{DisplacementModel, Library};
use upm_planning::planner::PlanningMethod;

/// Longest residual displacement that every planner leaves, since shorter steps get no pulse, m.
const LEFT_M: f64 = 0.5 * MIN_DISTANCE_M;
/// Share of the tolerance to which a hold brings back a part that has drifted.
const BROUGHT_BACK: f64 = 0.5;

/// Finest tolerance that the parts of `job` can hold, m: the displacement that the planner leaves plus three standard
/// deviations of sensing and scatter must fit in the share of the tolerance within which a part is measured to have
/// arrived:
///
/// `(left + 3 hypot(sensing, scatter)) / 0.9`
///
/// A synthesised field leaves 0.15 mm of each part's displacement. Rotations leave √2 times that if there are several
/// parts, since each pulse for one of them moves the others, and scatter like the library's shortest useful pulses. On
/// `upm-2` that gives 0.29 mm by fields and 0.28 mm by rotations. Runs of arrange-2 and arrange-4 that reached their
/// goal, with seeds 1 to 3, and 1 to 6 from 0.22 mm on:
///
/// | tolerance, mm | 0.05 | 0.1 | 0.15 | 0.2 | 0.22 | 0.28 |
/// |---|---|---|---|---|---|---|
/// | fields | 0 of 6 | 2 of 6 | 3 of 6 | 5 of 6 | 11 of 12 | 12 of 12 |
/// | rotations | 0 of 6 | 0 of 6 | 1 of 6 | 2 of 6 | 10 of 12 | 12 of 12 |
///
/// A hold brings parts back to half of its tolerance and has time for further attempts, so the displacement left must
/// fit in that half. `None` for sorting, whose bins are larger than any such distance.
pub(super) fn finest_tolerance_m(job: &JobSpec, library: &Library) -> Option<f64> {
    let parts: usize = job.parts.iter().map(|group| group.count).sum();
    let (left_m, scatter_m) = match PlannerSelection::of(job).method {
        PlanningMethod::SynthesizedField | PlanningMethod::MovingField => (LEFT_M, FIELD_SCATTER_M),
        PlanningMethod::CorSequence | PlanningMethod::PseudoInverse => {
            (if parts > 1 { SQRT_2 * LEFT_M } else { LEFT_M }, scatter_m(&library.displacement))
        }
    };
    let finest_m = (left_m + accuracy_m(&job.rig.sim.camera, scatter_m)) / MEASURED_SHARE;
    let of_task = |task: &TaskSpec| match task {
        TaskSpec::PlusSign { .. } | TaskSpec::Trajectories { .. } | TaskSpec::Arrange { .. } => Some(finest_m),
        TaskSpec::Hold { .. } => Some(finest_m.max(left_m / (BROUGHT_BACK * MEASURED_SHARE))),
        TaskSpec::Sort { .. } => None,
    };
    job.each_task().filter_map(of_task).reduce(f64::max)
}

/// Scatter of the shortest useful pulses: the root mean square over the speeds of the standard deviation of the
/// shortest pulse whose displacement is worth a pulse, m.
fn scatter_m(model: &DisplacementModel) -> f64 {
    let shortest = |(distances, sds): (&Vec<f64>, &Vec<f64>)| {
        let at = distances.iter().position(|&distance_m| distance_m >= MIN_DISTANCE_M)?;
        sds.get(at).copied()
    };
    let sds: Vec<f64> = model.distance_m.iter().zip(&model.sd_m).filter_map(shortest).collect();
    (sds.iter().map(|sd| sd * sd).sum::<f64>() / sds.len().max(1) as f64).sqrt()
}

/// Warning, in the form of a fault, for a job whose tolerance is finer than it can hold. The job stays valid: a run may
/// reach its goal by luck, and ends where it makes no progress.
pub(super) fn tolerance_warning(job: &JobSpec, library: &Library) -> Option<Diagnostic> {
    let finest_mm = (100.0 * mm_from_m(finest_tolerance_m(job, library)?)).ceil() / 100.0;
    let found_mm = mm_from_m(job.tolerance_m);
    (found_mm < finest_mm - 1e-9).then(|| {
        let found = format!("{found_mm} mm, which is below the positioning accuracy");
        let allowed = format!("{finest_mm:.2} mm or more with {}", PlannerSelection::of(job).report.name);
        Diagnostic::new(&job.file, "tolerance_mm", found, allowed)
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use serde_json::{Value, json};

    use super::*;
    use crate::config::Origin;
    use crate::run::job_library;

    fn warning(name: &str, change: impl FnOnce(&mut Value)) -> Option<Diagnostic> {
        let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs").join(name);
        let mut job: Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
        change(&mut job);
        let job = JobSpec::from_json(&job.to_string(), &Origin::of_file(&file), None).unwrap();
        tolerance_warning(&job, &job_library(&job).unwrap())
    }

    #[test]
    fn too_fine_tolerance_is_reported_with_the_one_that_holds() {
        let at = |planner: &'static str, tolerance_mm: f64| {
            warning("arrange-4.json", move |job| {
                (job["planner"], job["tolerance_mm"]) = (json!(planner), json!(tolerance_mm));
            })
        };
        let fault = at("auto", 0.1).unwrap();
        assert!(fault.path == "tolerance_mm" && fault.found.starts_with("0.1 mm"), "{fault}");
        assert!(fault.expected.starts_with("0.29 mm or more with moving_field"), "{fault}");
        assert_eq!(at("auto", 0.29), None);
        let fault = at("cor_sequence", 0.25).unwrap();
        assert!(fault.expected.starts_with("0.28 mm or more with cor_sequence"), "{fault}");
        assert_eq!(at("cor_sequence", 0.28), None);
    }

    #[test]
    fn holds_need_room_to_bring_parts_back_and_sorting_none() {
        let fine = |job: &mut Value| job["tolerance_mm"] = json!(0.3);
        assert!(warning("hold-4.json", fine).is_some_and(|fault| fault.expected.starts_with("0.34 mm")));
        assert_eq!(warning("sort-8.json", |job| job["tolerance_mm"] = json!(0.001)), None);
    }

    #[test]
    fn shipped_jobs_are_coarse_enough() {
        for name in ["plus-sign.json", "trajectories-cor.json", "arrange-4-cor.json", "hold-4.json", "ring-6.json"] {
            assert_eq!(warning(name, |_| ()), None, "{name}");
        }
    }
}
