//! Planners that a rig and a task do not allow.

use std::f64::consts::TAU;

use serde_json::json;

use super::job_file::{JobFile, PlannerChoice, TaskSection};
use super::rig::RigSpec;
use upm_core::document::{Diagnostics, Path};
use upm_core::rig::Interlock;

/// Checks that the planner fits the rig and the task.
pub(super) fn check_planner(document: &JobFile, rig: &RigSpec, root: &Path, faults: &mut Diagnostics) {
    let tasks = document.each_task();
    let stays = |task: &TaskSection| matches!(task, TaskSection::PlusSign { .. } | TaskSection::Hold { .. });
    let is_plus_sign = |task: &TaskSection| matches!(task, TaskSection::PlusSign { .. });
    let moves_parts = tasks.iter().any(|(_, task)| !stays(task)) && !tasks.iter().any(|(_, task)| is_plus_sign(task));
    let (others, obstacle) = match document.planner {
        PlannerChoice::Auto | PlannerChoice::CorSequence | PlannerChoice::PseudoInverse => return,
        _ if rig.model.fields.is_none() => ("cor_sequence, pseudo_inverse", Some(without_fields())),
        PlannerChoice::MovingField => ("synthesized_field", moving_obstacle(rig, moves_parts)),
        PlannerChoice::SynthesizedField => return,
    };
    if let Some((found, allowed)) = obstacle {
        let found = format!("{} {found}", json!(document.planner));
        faults.push(root.key("planner"), found, format!("auto, {others}, or {allowed}"));
    }
}

fn without_fields() -> (String, String) {
    ("on a rig without `fields`".into(), "a rig that has `fields`".into())
}

/// The reason for which motions without pauses are not possible, and what would do; `None` where they are.
pub(crate) fn moving_obstacle(rig: &RigSpec, moves_parts: bool) -> Option<(String, String)> {
    let Some(fields) = rig.model.fields else { return Some(without_fields()) };
    let (base_hz, frame_hz) = (fields.base_radps / TAU, rig.model.frame_hz);
    let stiffest_hz = rig.document.plate.resonance_hz.into_iter().fold(0.0, f64::max);
    // a segment is two periods of the fields: it is driven from half their frequency on, shown by two frames at least,
    // and over before the lease is
    let (slowest_hz, least_hz) = (0.5 * base_hz, (2.0 * stiffest_hz).max(2.0 / Interlock::LEASE_S));
    Some(if !moves_parts {
        ("for a plus sign or a hold".into(), "a task of type arrange, sort or trajectories".into())
    } else if frame_hz < base_hz {
        (format!("with {frame_hz} frames a second"), format!("a camera of {base_hz:.0} or more"))
    } else if base_hz < least_hz {
        let why = format!("its segments are driven from {slowest_hz:.1} Hz on and last {:.3} s", 2.0 / base_hz);
        (format!("on a rig with fields of {base_hz:.1} Hz ({why})"), format!("fields.base_hz of {least_hz:.1} or more"))
    } else {
        return None;
    })
}
