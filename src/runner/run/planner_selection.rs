use std::fmt;

use crate::config::{JobSpec, PlannerChoice};
use upm_planning::planner::PlanningMethod;
use upm_recording::{PlannerReport, SelectedBy};

/// Number of parts from which on one motion for all of them is faster than rotations one after another.
const SEVERAL: usize = 2;

/// Planner of a job, the reason for it, and the other planners that its rig supports.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannerSelection {
    /// The planner that runs.
    pub method: PlanningMethod,
    /// Reason for the choice.
    pub reason: SelectionReason,
    /// Other planners that the rig supports, the most promising first.
    pub alternatives: Vec<PlanningMethod>,
}

/// Reason for the choice of a planner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SelectionReason {
    /// The job file names it.
    NamedByJob,
    /// The rig has fields and several parts are to be moved.
    SeveralParts {
        /// Number of parts.
        parts: usize,
    },
    /// A run without pixels by each planner: this one is faster.
    Forecast {
        /// Its plate time, s.
        time_s: f64,
        /// Plate time by the other planner, s; `None` where that one does not reach the goal.
        other_s: Option<f64>,
    },
    /// A single part gains nothing from a field.
    OnePart,
    /// The rig has no fields.
    NoFields,
}

impl PlannerSelection {
    /// Selects the planner of `job`. Every part counts as moved: each has a target, if only its own place.
    pub fn of(job: &JobSpec) -> Self {
        let has_fields = job.rig.model.fields.is_some();
        let parts: usize = job.parts.iter().map(|group| group.count).sum();
        let (method, reason) = match job.planner {
            PlannerChoice::CorSequence => (PlanningMethod::CorSequence, SelectionReason::NamedByJob),
            PlannerChoice::SynthesizedField => (PlanningMethod::SynthesizedField, SelectionReason::NamedByJob),
            PlannerChoice::PseudoInverse => (PlanningMethod::PseudoInverse, SelectionReason::NamedByJob),
            PlannerChoice::Auto if !has_fields => (PlanningMethod::CorSequence, SelectionReason::NoFields),
            PlannerChoice::Auto if parts < SEVERAL => (PlanningMethod::CorSequence, SelectionReason::OnePart),
            PlannerChoice::Auto => (PlanningMethod::SynthesizedField, SelectionReason::SeveralParts { parts }),
        };
        let possible = [PlanningMethod::SynthesizedField, PlanningMethod::CorSequence, PlanningMethod::PseudoInverse];
        let is_other =
            |other: &PlanningMethod| *other != method && (has_fields || *other != PlanningMethod::SynthesizedField);
        Self { method, reason, alternatives: possible.into_iter().filter(is_other).collect() }
    }

    /// The planner's name in a job file.
    pub fn name(&self) -> &'static str {
        name_of(self.method)
    }

    /// The selection in the form of `report.json`.
    pub fn report(&self) -> PlannerReport {
        PlannerReport {
            name: self.name().into(),
            chosen: if self.reason == SelectionReason::NamedByJob { SelectedBy::Job } else { SelectedBy::Auto },
            code: self.reason.code().into(),
            why: self.reason.to_string(),
            alternatives: self.alternatives.iter().map(|&other| name_of(other).into()).collect(),
        }
    }
}

impl SelectionReason {
    /// Stable code of the reason.
    pub fn code(self) -> &'static str {
        match self {
            Self::NamedByJob => "named_by_job",
            Self::SeveralParts { .. } => "several_parts",
            Self::Forecast { .. } => "forecast",
            Self::OnePart => "one_part",
            Self::NoFields => "no_fields",
        }
    }
}

impl fmt::Display for SelectionReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NamedByJob => f.write_str("the job names it"),
            Self::SeveralParts { parts } => write!(f, "the rig has fields and the job moves {parts} parts"),
            Self::Forecast { time_s, other_s: Some(other_s) } => {
                write!(f, "by forecast it takes {time_s:.1} s of plate time, the other {other_s:.1} s")
            }
            Self::Forecast { time_s, other_s: None } => {
                write!(f, "by forecast it takes {time_s:.1} s of plate time, and the other does not reach the goal")
            }
            Self::OnePart => f.write_str("the job moves one part"),
            Self::NoFields => f.write_str("the rig has no fields"),
        }
    }
}

/// Name of a planner in a job file.
fn name_of(method: PlanningMethod) -> &'static str {
    match method {
        PlanningMethod::CorSequence => "cor_sequence",
        PlanningMethod::SynthesizedField => "synthesized_field",
        PlanningMethod::PseudoInverse => "pseudo_inverse",
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use serde_json::{Value, json};

    use super::*;
    use crate::config::Origin;

    fn selection(rig: &str, pennies: usize, planner: Value) -> PlannerSelection {
        let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/job.json");
        let mut job = json!({
            "name": "made", "rig": format!("rigs/{rig}.json"), "parts": [{"kind": "penny", "count": pennies}],
            "task": {"type": "hold", "duration_s": 1}, "planner": planner,
        });
        if planner == Value::Null {
            job.as_object_mut().unwrap().remove("planner");
        }
        PlannerSelection::of(&JobSpec::from_json(&job.to_string(), &Origin::of_file(&folder), None).unwrap())
    }

    #[test]
    fn auto_takes_fields_for_several_parts_on_a_rig_that_has_them() {
        for (rig, pennies, method, reason) in [
            ("upm-2", 2, PlanningMethod::SynthesizedField, SelectionReason::SeveralParts { parts: 2 }),
            ("upm-2", 1, PlanningMethod::CorSequence, SelectionReason::OnePart),
            ("upm-1", 2, PlanningMethod::CorSequence, SelectionReason::NoFields),
            ("upm-1", 1, PlanningMethod::CorSequence, SelectionReason::NoFields),
        ] {
            for planner in [Value::Null, json!("auto")] {
                let selection = selection(rig, pennies, planner);
                assert_eq!((selection.method, selection.reason), (method, reason), "{pennies} on {rig}");
            }
        }
    }

    #[test]
    fn named_planner_is_kept_and_the_others_of_the_rig_are_alternatives() {
        let named = selection("upm-2", 4, json!("cor_sequence"));
        assert_eq!((named.method, named.reason), (PlanningMethod::CorSequence, SelectionReason::NamedByJob));
        assert_eq!(named.report().alternatives, ["synthesized_field", "pseudo_inverse"]);
        assert_eq!(named.report().chosen, SelectedBy::Job);
        let without_fields = selection("upm-1", 4, json!("pseudo_inverse"));
        assert_eq!(without_fields.report().alternatives, ["cor_sequence"]);
    }

    #[test]
    fn name_of_every_planner_is_the_one_a_job_file_has() {
        for planner in [PlannerChoice::CorSequence, PlannerChoice::SynthesizedField, PlannerChoice::PseudoInverse] {
            let in_file = serde_json::to_value(planner).unwrap();
            assert_eq!(json!(selection("upm-2", 2, in_file.clone()).name()), in_file);
        }
    }
}
