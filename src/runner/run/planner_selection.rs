use serde_json::json;

use crate::config::{JobSpec, PlannerChoice, TaskSpec, moving_obstacle};
use upm_planning::planner::PlanningMethod;
use upm_recording::{PlannerReport, SelectedBy};

/// Number of parts from which on one motion for all of them is faster than rotations one after another.
const SEVERAL: usize = 2;

/// Planner of a job, with the reason for it and the other planners that its rig supports.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannerSelection {
    /// The planner that runs.
    pub method: PlanningMethod,
    /// The selection in the form of `report.json`; the alternatives in it begin with the most promising one.
    pub report: PlannerReport,
}

impl PlannerSelection {
    /// Selects the planner of `job`. Every part counts as moved: each has a target, if only its own place.
    pub fn of(job: &JobSpec) -> Self {
        let parts: usize = job.parts.iter().map(|group| group.count).sum();
        let obstacle = moving_obstacle(&job.rig, moves_parts(job));
        let named = json!(job.document.planner).as_str().and_then(PlanningMethod::of_code);
        let (method, code, why) = if let Some(named) = named {
            (named, "named_by_job", "the job names it".to_owned())
        } else if job.rig.model.fields.is_none() {
            (PlanningMethod::CorSequence, "no_fields", "the rig has no fields".to_owned())
        } else if obstacle.is_none() && goes_to_places(job) {
            (PlanningMethod::MovingField, "to_places", "the rig has fields and parts go to places".to_owned())
        } else if parts < SEVERAL {
            (PlanningMethod::CorSequence, "one_part", "the job moves one part".to_owned())
        } else {
            let follows = || "pauses keep parts closer to their paths".to_owned();
            let why = obstacle.as_ref().map_or_else(follows, |(found, _)| format!("no motion without pauses {found}"));
            let why = format!("the rig has fields and the job moves {parts} parts; {why}");
            (PlanningMethod::SynthesizedField, "several_parts", why)
        };
        let is_possible = |method: PlanningMethod| match method {
            PlanningMethod::MovingField => obstacle.is_none(),
            PlanningMethod::SynthesizedField => job.rig.model.fields.is_some(),
            PlanningMethod::CorSequence | PlanningMethod::PseudoInverse => true,
        };
        let others = PlanningMethod::ALL.into_iter().rev().filter(|other| *other != method && is_possible(*other));
        let report = PlannerReport {
            name: method.code().into(),
            chosen: if job.document.planner == PlannerChoice::Auto { SelectedBy::Auto } else { SelectedBy::Job },
            code: code.into(),
            why,
            alternatives: others.map(|other| other.code().into()).collect(),
        };
        Self { method, report }
    }

    /// Falls back, for a rig that plays one pulse at a time; a planner that the job names stays.
    pub(super) fn fall_back(&mut self) {
        if self.method == PlanningMethod::MovingField && self.report.chosen == SelectedBy::Auto {
            self.method = PlanningMethod::SynthesizedField;
            self.report.name = self.method.code().into();
            self.report.why += "; the rig plays one pulse at a time";
            self.report.alternatives.retain(|other| *other != self.report.name);
        }
    }
}

fn moves_parts(job: &JobSpec) -> bool {
    let is_plus_sign = |task: &TaskSpec| matches!(task, TaskSpec::PlusSign { .. });
    !job.each_task().any(is_plus_sign) && !job.each_task().all(|task| matches!(task, TaskSpec::Hold { .. }))
}

fn goes_to_places(job: &JobSpec) -> bool {
    let is_path = |task: &TaskSpec| matches!(task, TaskSpec::PlusSign { .. } | TaskSpec::Trajectories { .. });
    moves_parts(job) && !job.each_task().any(is_path)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use serde_json::{Value, json};

    use super::*;
    use crate::config::Origin;
    use crate::run::testing::job_in_configs;

    fn selection(rig: &str, pennies: usize, planner: Value) -> PlannerSelection {
        let mut job = json!({
            "name": "made", "rig": format!("rigs/{rig}.json"), "parts": [{"kind": "penny", "count": pennies}],
            "task": {"type": "hold", "duration_s": 1}, "planner": planner,
        });
        if planner == Value::Null {
            job.as_object_mut().unwrap().remove("planner");
        }
        PlannerSelection::of(&job_in_configs(&job))
    }

    #[test]
    fn auto_takes_fields_for_several_parts_on_a_rig_that_has_them() {
        for (rig, pennies, method, reason) in [
            ("upm-2", 2, PlanningMethod::SynthesizedField, "several_parts"),
            ("upm-2", 1, PlanningMethod::CorSequence, "one_part"),
            ("upm-1", 2, PlanningMethod::CorSequence, "no_fields"),
            ("upm-1", 1, PlanningMethod::CorSequence, "no_fields"),
        ] {
            for planner in [Value::Null, json!("auto")] {
                let selection = selection(rig, pennies, planner);
                assert_eq!((selection.method, selection.report.code.as_str()), (method, reason), "{pennies} on {rig}");
            }
        }
    }

    #[test]
    fn auto_does_without_pauses_where_camera_and_drive_are_fast_enough() {
        let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let rig = std::fs::read_to_string(folder.join("configs/rigs/upm-2.json")).unwrap();
        let read = |planner: &str, change: &dyn Fn(&mut Value)| {
            let mut rig: Value = serde_json::from_str(&rig).unwrap();
            rig["library"] = json!(folder.join("assets/libraries/upm-2.json"));
            change(&mut rig);
            let job = json!({
                "name": "made", "rig": rig, "parts": [{"kind": "penny", "count": 2}],
                "task": {"type": "arrange", "targets_mm": [[0, 0], [50, 0]]}, "planner": planner,
            });
            JobSpec::from_json(&job.to_string(), &Origin::of_file(&folder.join("job.json")), None)
        };
        let selected = |change| PlannerSelection::of(&read("auto", change).unwrap());
        assert_eq!(selected(&|_| ()).method, PlanningMethod::MovingField);
        let slow_camera = |rig: &mut Value| rig["camera"]["frame_hz"] = json!(20);
        let long_segments = |rig: &mut Value| rig["fields"]["base_hz"] = json!(15);
        for (change, why) in [
            (&slow_camera as &dyn Fn(&mut Value), "20 frames a second"),
            (&long_segments, "fields of 15.0 Hz (its segments are driven from 7.5 Hz on and last 0.133 s)"),
        ] {
            let selection = selected(change);
            assert_eq!(selection.method, PlanningMethod::SynthesizedField);
            assert!(selection.report.why.contains(why), "{}", selection.report.why);
            let refused = read("moving_field", change).unwrap_err()[0].to_string();
            assert!(refused.contains(why) && refused.contains(" or more"), "{refused}");
        }
    }

    #[test]
    fn named_planner_is_kept_and_the_others_of_the_rig_are_alternatives() {
        let named = selection("upm-2", 4, json!("cor_sequence"));
        assert_eq!((named.method, named.report.code.as_str()), (PlanningMethod::CorSequence, "named_by_job"));
        assert_eq!(named.report.alternatives, ["synthesized_field", "pseudo_inverse"]);
        assert_eq!(named.report.chosen, SelectedBy::Job);
        let without_fields = selection("upm-1", 4, json!("pseudo_inverse"));
        assert_eq!(without_fields.report.alternatives, ["cor_sequence"]);
    }
}
