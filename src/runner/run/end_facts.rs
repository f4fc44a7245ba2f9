//! Ending of a run for its report, and the verdict of the ground truth on it.

use pathfinding::prelude::{Matrix, kuhn_munkres_min};

use super::{PlannerSelection, RunError, RunSetup};
use crate::config::{Assignment, JobSpec, TaskSpec, fault_entry};
use upm_control::{ExpectedPart, FinalState, RunEnd};
use upm_core::geometry::Vec2;
use upm_core::job::{Finding, Outcome, StopCause, StopRequest};
use upm_core::units::{m_from_mm, mm_from_m};
use upm_recording::{IncidentReport, PartReport, Report, StopReport, Verdict, WorkReport, rounded};

/// Allowance for the measurement error by which a true error may exceed the tolerance, mm.
const SENSING_MM: f64 = 0.1;

/// Report of the end of a run, without what its sinks counted; `setup` is `None` for a run that had no plate.
pub(super) fn ending(job: &JobSpec, setup: Option<&RunSetup>, finish: FinalState, wall_time_s: f64) -> Report {
    let FinalState { ending: RunEnd { outcome, cause, reason }, wanted, measured_m, lost, evidence } = finish;
    let parts_of = |setup: &RunSetup| {
        let truth = setup.known_truth();
        let part_at_end = |(i, part): (usize, &ExpectedPart)| {
            let kind = setup.params.kinds.get(part.kind).map_or("", |kind| &kind.name);
            let target_m = wanted.as_ref().and_then(|wanted| wanted.targets_m.get(i).copied());
            let true_m = truth.as_ref().and_then(|truth| Some(truth.read().parts.get(i)?.part_in_table.position_m));
            PartReport::of(&part.id, kind, target_m, measured_m.get(i).copied(), true_m)
        };
        setup.params.parts.iter().enumerate().map(part_at_end).collect()
    };
    let faults_begun = |RunSetup { faults, ended_at, .. }: &RunSetup| {
        let begun = faults.iter().filter(|fault| fault.from <= *ended_at);
        begun.map(fault_entry).collect()
    };
    let laps = wanted.as_ref().map_or(0, |wanted| wanted.laps);
    Report {
        name: job.name.clone(),
        seed: job.seed(),
        camera: job.camera,
        planner: Some(setup.map_or_else(|| PlannerSelection::of(job), |setup| setup.planner.clone()).report),
        outcome,
        stop: cause.map(|cause| StopReport::of(cause, &reason)),
        reason,
        plate_time_s: setup.map_or(0.0, |setup| rounded(setup.ended_at.secs())),
        wall_time_s: rounded(wall_time_s),
        work: WorkReport { laps, lost_parts: lost.len(), ..WorkReport::default() },
        parts: setup.map(parts_of).unwrap_or_default(),
        evidence,
        incidents: IncidentReport { faults: setup.map(faults_begun).unwrap_or_default(), ..IncidentReport::default() },
        ..Report::default()
    }
}

/// Adds `error`, about a file that could not be written, to the end of a run. A lost part and a stop from outside
/// remain its cause.
pub(super) fn add_write_failure(ending: &mut RunEnd, error: &RunError) {
    use StopRequest::{Cancelled, Estop, Interrupted};
    match (ending.outcome, ending.cause) {
        (_, Some(StopCause::Found(Finding::PartLost))) => ending.reason = format!("{}; {error}", ending.reason),
        (Outcome::Cancelled, Some(StopCause::Asked(Estop | Cancelled | Interrupted))) => {
            ending.reason = format!("stopped; {error}");
        }
        _ => {
            let (outcome, cause) = (Outcome::Failed, Some(StopCause::Found(Finding::JournalLost)));
            *ending = RunEnd { outcome, cause, reason: error.to_string() };
        }
    }
}

/// Verdict of the ground truth on `report`, a run of `job`; `None` if the truth is unknown. Parts on endless paths or
/// at prescribed speeds have no final target: their true positions are compared with the measured ones.
pub(super) fn verdict(job: &JobSpec, report: &Report) -> Option<Verdict> {
    if report.parts.is_empty() || report.parts.iter().any(|part| part.true_mm.is_none()) {
        return None;
    }
    let near =
        |part: &PartReport| part.error_mm.is_none_or(|error_mm| error_mm <= mm_from_m(job.tolerance_m) + SENSING_MM);
    let is_reached = match &job.task {
        TaskSpec::Trajectories { .. } => each_has_its_part(report, job, |part| part.measured_mm),
        _ if job.is_endless() => each_has_its_part(report, job, |part| part.measured_mm),
        TaskSpec::Sort { bins } => {
            let kinds = job.kinds_of_parts();
            let in_bin = |part: usize| {
                let bin = bins.iter().find(|bin| bin.parts.contains(&part))?;
                let at_m = Vec2::from(report.parts[part].true_mm?).map(m_from_mm);
                Some(bin.inside_m(at_m, job.rig.kinds.get(kinds[part])?.kind.radius_m) >= -m_from_mm(SENSING_MM))
            };
            (0..report.parts.len()).all(|part| in_bin(part) == Some(true))
        }
        TaskSpec::Hold { .. } | TaskSpec::Arrange { assignment: Assignment::Optimal, .. } => {
            each_has_its_part(report, job, |part| part.target_mm)
        }
        _ => report.parts.iter().all(near),
    };
    let is_false = report.outcome == Outcome::Completed && !is_reached;
    Some(if is_false { Verdict::FalseSuccess } else { Verdict::True })
}

/// True if a part of the right kind truly is at each `place_mm`, whichever part it is: parts of a kind may exchange
/// their targets, and their names where the camera cannot distinguish them.
fn each_has_its_part(report: &Report, job: &JobSpec, place_mm: impl Fn(&PartReport) -> Option<[f64; 2]>) -> bool {
    let (kinds, within_mm) = (job.kinds_of_parts(), mm_from_m(job.tolerance_m) + SENSING_MM);
    let of_kind = || report.parts.iter().zip(&kinds);
    let places: Vec<_> = of_kind().filter_map(|(part, &kind)| Some((kind, place_mm(part)?))).collect();
    let parts: Vec<_> = of_kind().filter_map(|(part, &kind)| Some((kind, part.true_mm?))).collect();
    all_taken(&places, &parts, within_mm)
}

/// True if the parts can be given to the places so that each place has one of its kind within `within_mm`.
fn all_taken(places: &[(usize, [f64; 2])], parts: &[(usize, [f64; 2])], within_mm: f64) -> bool {
    if places.is_empty() || places.len() > parts.len() {
        return places.is_empty();
    }
    let missed = |(place, part): (usize, usize)| {
        let ((kind, [x, y]), (of, [at_x, at_y])) = (places[place], parts[part]);
        i64::from(kind != of || libm::hypot(at_x - x, at_y - y) > within_mm)
    };
    kuhn_munkres_min(&Matrix::from_fn(places.len(), parts.len(), missed)).0 == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wide_tolerances_give_no_place_the_part_that_another_needs() {
        let at = |xs: &[f64]| xs.iter().map(|&x| (0, [x, 0.0])).collect::<Vec<_>>();
        // the part in the middle can take any place, the other two one place each
        assert!(all_taken(&at(&[0.0, 20.0, 40.0]), &at(&[20.0, -22.0, 62.0]), 25.0));
        assert!(!all_taken(&at(&[0.0, 20.0, 40.0]), &at(&[20.0, -22.0, -23.0]), 25.0));
        assert!(!all_taken(&at(&[0.0, 20.0]), &at(&[0.0]), 25.0), "a part is missing");
        assert!(!all_taken(&at(&[0.0]), &[(1, [0.0; 2])], 25.0), "of another kind");
        assert!(all_taken(&[], &at(&[0.0]), 25.0));
    }

    #[test]
    fn write_failure_is_added_to_the_cause_or_replaces_a_lesser_one() {
        let error = RunError::Write { path: "journal.jsonl".into(), reason: "no space".into() };
        let ended = |cause, outcome| {
            let mut ending = RunEnd { cause, outcome, reason: "penny-1 is lost".into() };
            add_write_failure(&mut ending, &error);
            (ending.cause, ending.outcome, ending.reason)
        };
        let (failed, cancelled) = (Outcome::Failed, Outcome::Cancelled);
        let lost = "penny-1 is lost; cannot write journal.jsonl: no space";
        assert_eq!(
            ended(Some(StopCause::Found(Finding::PartLost)), failed),
            (Some(StopCause::Found(Finding::PartLost)), failed, lost.into())
        );
        let stopped = "stopped; cannot write journal.jsonl: no space";
        assert_eq!(
            ended(Some(StopCause::Asked(StopRequest::Estop)), cancelled),
            (Some(StopCause::Asked(StopRequest::Estop)), cancelled, stopped.into())
        );
        for cause in [None, Some(StopCause::Asked(StopRequest::Stopped)), Some(StopCause::Found(Finding::TimeLimit))] {
            let (named, outcome, reason) = ended(cause, cancelled);
            assert_eq!((named, outcome), (Some(StopCause::Found(Finding::JournalLost)), failed));
            assert_eq!(reason, error.to_string());
        }
    }
}
