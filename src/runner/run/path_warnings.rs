//! Warnings about paths that ask for more speed or time than there is, and about dense places.

use std::f64::consts::TAU;

use super::planner_selection::PlannerSelection;
use super::setup::{LEAD_M, LONGEST_STEP_M};
use super::tolerance::tolerance_warning;
use crate::config::{Diagnostic, JobSpec, TaskSpec};
use upm_core::geometry::Vec2;
use upm_core::rig::RigModel;
use upm_core::units::mm_from_m;
use upm_planning::cor_library::Library;
use upm_planning::planner::PlanningMethod;

/// Share of the rest after the longest pulse that comes after every pulse.
const LEAST_REST: f64 = 0.5;
/// Segments of motions without pauses last this many periods of the fields.
const SEGMENT_PERIODS: f64 = 2.0;

/// Parts at places as dense as this, by the gap between rims, m, come to rest after minutes or not at all where there
/// are so many and each has neighbours: 30 dimes 20 mm apart, while 20 take half a minute.
const DENSE_M: f64 = 2.5e-3;
const MANY: usize = 24;

/// Warnings, in the form of faults, of a valid job: a run may reach its goal by luck, later, or in part.
pub fn job_warnings(job: &JobSpec, library: &Library) -> Vec<Diagnostic> {
    let mut warnings = job.warnings.clone();
    warnings.extend(tolerance_warning(job, library));
    warnings.extend(job.each_task().enumerate().filter_map(|(i, task)| speed_warning(job, i, task, library)));
    warnings.extend(time_warning(job));
    warnings.extend(job.each_task().filter_map(|task| density_warning(job, task)));
    warnings
}

fn speed_warning(job: &JobSpec, number: usize, task: &TaskSpec, library: &Library) -> Option<Diagnostic> {
    let TaskSpec::Trajectories { paths, .. } = task else { return None };
    let planner = PlannerSelection::of(job);
    let most_mps = most_speed_mps(planner.method, &job.rig.model, library)?;
    let moving = paths.iter().enumerate().filter(|(_, path)| path.waypoints_m.len() > 1);
    let (part, fastest) = moving.reduce(|a, b| if b.1.speed_mps > a.1.speed_mps { b } else { a })?;
    let at = job.path_of(number, part)?.key("speed_mm_s");
    (fastest.speed_mps > most_mps).then(|| {
        let found = format!("{}, which no motion of the rig can hold", mm_from_m(fastest.speed_mps));
        let most_mm_s = mm_from_m(most_mps).floor();
        let allowed =
            format!("less than {most_mm_s} with {} (`upm check --plan` finds what can be held)", planner.report.name);
        Diagnostic::new(&job.file, at, found, allowed)
    })
}

/// A speed along paths that no motion of the rig exceeds, m/s: the longest step of a cycle over the shortest cycle. For
/// motions without pauses, the way to the farthest point of a path that is aimed at over the length of a segment.
fn most_speed_mps(method: PlanningMethod, model: &RigModel, library: &Library) -> Option<f64> {
    let cycle_s = |attack_s: f64, rest_s: f64| 2.0 * attack_s + rest_s + 1.0 / model.frame_hz;
    Some(match method {
        PlanningMethod::MovingField => (LONGEST_STEP_M + LEAD_M) * model.fields?.base_radps / (SEGMENT_PERIODS * TAU),
        PlanningMethod::SynthesizedField => {
            let fields = model.fields?;
            LONGEST_STEP_M / cycle_s(fields.attack_s, fields.rest_s)
        }
        PlanningMethod::CorSequence | PlanningMethod::PseudoInverse => {
            let table = &library.displacement;
            let of_pulse = |(&sustain_s, &distance_m): (&f64, &f64)| {
                distance_m / (2.0 * model.attack_s + sustain_s + LEAST_REST * model.rest_s)
            };
            let pulses = table.distance_m.iter().flat_map(|row| table.sustain_s.iter().zip(row));
            let fastest_mps = pulses.map(of_pulse).fold(0.0, f64::max);
            fastest_mps.min(LONGEST_STEP_M / cycle_s(model.attack_s, LEAST_REST * model.rest_s))
        }
    })
}

fn time_warning(job: &JobSpec) -> Option<Diagnostic> {
    let time_s = |task: &TaskSpec| match task {
        TaskSpec::Trajectories { paths, in_phase, .. } => {
            let with_end = paths.iter().filter(|path| path.repeat > 0);
            with_end.map(|path| path.length_m(*in_phase) / path.speed_mps).fold(0.0, f64::max)
        }
        _ => 0.0,
    };
    let all_s = f64::from(job.document.repeat) * job.each_task().map(time_s).sum::<f64>();
    (all_s > job.plate_time_limit_s).then(|| {
        let found = format!("{}, which ends before the paths", job.plate_time_limit_s);
        let allowed = format!("more than {all_s:.1}, which the paths take at the speed asked");
        Diagnostic::new(&job.file, "limits.plate_time_s", found, allowed)
    })
}

fn density_warning(job: &JobSpec, task: &TaskSpec) -> Option<Diagnostic> {
    let TaskSpec::Arrange { targets_m, .. } = task else { return None };
    let kinds = job.kinds_of_parts();
    let disc = |(to_m, kind): (&Option<Vec2>, &usize)| Some(((*to_m)?, job.rig.kinds.get(*kind)?.kind.radius_m));
    let discs: Vec<(Vec2, f64)> = targets_m.iter().zip(&kinds).filter_map(disc).collect();
    let pairs = discs.iter().enumerate().flat_map(|(i, a)| discs[..i].iter().map(move |b| (a, b)));
    let dense = pairs.map(|(a, b)| (a.0 - b.0).norm() - a.1 - b.1).filter(|gap_m| *gap_m < DENSE_M).count();
    (discs.len() >= MANY && dense >= discs.len()).then(|| {
        let found = format!("{dense} pairs of {} places nearer than that, which may take minutes", discs.len());
        let allowed = format!("{:.1} mm or more between rims, or fewer parts at a time", mm_from_m(DENSE_M));
        Diagnostic::new(&job.file, "parts", found, allowed)
    })
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::run::job_library;
    use crate::run::testing::job_in_configs;

    /// Warnings of pennies on these paths of `upm-2`.
    fn warned(planner: &str, paths: &Value, in_phase: bool, plate_time_s: f64) -> Vec<String> {
        let count = |path: &Value| path["count"].as_u64().unwrap_or(1);
        let pennies: u64 = paths.as_array().unwrap().iter().map(count).sum();
        let job = json!({
            "name": "paths", "rig": "rigs/upm-2.json", "parts": [{"kind": "penny", "count": pennies}],
            "task": {"type": "trajectories", "paths": paths, "in_phase": in_phase},
            "planner": planner, "limits": {"plate_time_s": plate_time_s},
        });
        let job = job_in_configs(&job);
        let warnings = job_warnings(&job, &job_library(&job).unwrap());
        warnings.iter().map(|warning| format!("{}: {}", warning.path, warning.expected)).collect()
    }

    #[test]
    fn speeds_beyond_every_motion_are_told_with_the_path() {
        let planners = ["cor_sequence", "pseudo_inverse", "synthesized_field", "moving_field"];
        for planner in planners {
            let ring = |speed: f64| json!({"circle": {"radius_mm": 80}, "count": 3, "speed_mm_s": speed});
            let inner = |speed: f64| json!({"circle": {"radius_mm": 20}, "speed_mm_s": speed});
            assert_eq!(warned(planner, &json!([ring(12.0), inner(3.0)]), false, 600.0), [""; 0], "{planner}");
            let fast = warned(planner, &json!([ring(12.0), inner(1000.0)]), false, 600.0);
            assert!(fast.len() == 1 && fast[0].starts_with("task.paths[1].speed_mm_s: less than "), "{fast:?}");
            assert!(fast[0].contains(&format!("with {planner} ")), "{fast:?}");
        }
        let ring = json!([{"circle": {"radius_mm": 80}, "count": 8, "speed_mm_s": 200}]);
        assert_eq!(warned("synthesized_field", &ring, true, 600.0).len(), 1, "the parts are carried at about 20 mm/s");
    }

    #[test]
    fn limit_shorter_than_the_paths_is_told_with_their_time() {
        // there and back, then there: 300 mm at 10 mm/s
        let line = |repeat: u32| json!([{"waypoints_mm": [[-50, 0], [50, 0]], "speed_mm_s": 10, "repeat": repeat}]);
        let told = ["limits.plate_time_s: more than 30.0, which the paths take at the speed asked"];
        assert_eq!(warned("auto", &line(2), false, 29.0), told);
        assert_eq!(warned("auto", &line(2), false, 31.0), [""; 0]);
        assert_eq!(warned("auto", &line(2), true, 39.0).len(), 1, "in phase the last pass goes back, too");
        assert_eq!(warned("auto", &line(0), false, 1.0), [""; 0]);
    }

    #[test]
    fn many_parts_at_dense_places_are_told() {
        let warned = |rows: u32, spacing_mm: f64| {
            let grid = json!({"grid": {"rows": rows, "columns": 6, "spacing_mm": spacing_mm}});
            let job = job_in_configs(&json!({
                "name": "grid", "rig": "rigs/upm-2.json", "parts": [{"kind": "dime", "count": 6 * rows}],
                "task": {"type": "arrange", "targets": grid},
            }));
            job_warnings(&job, &job_library(&job).unwrap()).iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        assert_eq!([warned(5, 21.0), warned(3, 20.0)].concat(), [""; 0]);
        let told = "parts: expected 2.5 mm or more between rims, or fewer parts at a time, found 49 pairs of 30 places";
        assert!(warned(5, 20.0).len() == 1 && warned(5, 20.0)[0].contains(told), "{:?}", warned(5, 20.0));
    }

    #[test]
    fn tasks_of_a_list_are_told_apart_and_their_times_added() {
        let line = |speed: f64| json!({"waypoints_mm": [[-50, 0], [50, 0]], "speed_mm_s": speed});
        let task = |speed: f64| json!({"type": "trajectories", "paths": [line(speed)]});
        let job = json!({
            "name": "two", "rig": "rigs/upm-2.json", "parts": [{"kind": "penny"}],
            "tasks": [task(10.0), task(500.0)], "repeat": 3, "limits": {"plate_time_s": 30},
        });
        let job = job_in_configs(&job);
        let warnings = job_warnings(&job, &job_library(&job).unwrap());
        let told: Vec<&str> = warnings.iter().map(|warning| warning.path.as_str()).collect();
        assert_eq!(told, ["tasks[1].paths[0].speed_mm_s", "limits.plate_time_s"]);
        assert!(warnings[1].expected.starts_with("more than 30.6, "), "{}", warnings[1]);
    }
}
