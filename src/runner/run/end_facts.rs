//! Ending of a run for its report, and the verdict of the ground truth on it.

use super::{PlannerSelection, RunError, RunSetup};
use crate::config::{Assignment, JobSpec, TaskSpec};
use upm_control::{ExpectedPart, FinalState};
use upm_core::job::{Outcome, StopCause};
use upm_core::rig::Rig;
use upm_core::time::PlateTime;
use upm_core::units::mm_from_m;
use upm_recording::{EndFacts, FaultReport, PartEnd, PartReport, Report, Verdict};
use upm_sim::faults::FaultSpec;

/// Allowance for the measurement error by which a true error may exceed the tolerance, mm.
const SENSING_MM: f64 = 0.1;

/// Ending of a run; `setup` is `None` for a run that had no plate.
pub(super) fn ending<R: Rig>(
    job: &JobSpec,
    setup: Option<&RunSetup<R>>,
    finish: FinalState,
    wall_time_s: f64,
) -> EndFacts {
    let FinalState { ending, wanted, measured_m, lost } = finish;
    let part_ending = |(i, part): (usize, &ExpectedPart), setup: &RunSetup<R>| PartEnd {
        id: part.id.clone(),
        kind: setup.params.kinds.get(part.kind).map(|kind| kind.name.clone()).unwrap_or_default(),
        target_m: wanted.as_ref().and_then(|wanted| wanted.targets_m.get(i).copied()),
        measured_m: measured_m.get(i).copied(),
    };
    let parts = setup.map(|setup| setup.params.parts.iter().enumerate().map(|part| part_ending(part, setup)).collect());
    EndFacts {
        name: job.name.clone(),
        seed: job.seed(),
        planner: Some(PlannerSelection::of(job).report()),
        outcome: ending.outcome,
        reason: ending.reason,
        cause: ending.cause,
        plate_time: setup.map_or(PlateTime::ZERO, RunSetup::now),
        bound_s: None,
        wall_time_s,
        deadlines: None,
        laps: wanted.as_ref().map_or(0, |wanted| wanted.laps),
        lost_parts: lost.len(),
        parts: parts.unwrap_or_default(),
        faults: setup.map(faults_within).unwrap_or_default(),
    }
}

/// Adds `error`, about a file that could not be written, to the ending of a run. A lost part and a stop from outside
/// remain its cause.
pub(super) fn unwritten_ending(ending: &mut EndFacts, error: &RunError) {
    let lost = ending.cause.filter(|&cause| cause == StopCause::PartLost);
    match (lost, ending.outcome, ending.cause) {
        (Some(_), ..) => ending.reason = format!("{}; {error}", ending.reason),
        (None, Outcome::Cancelled, Some(StopCause::Estop | StopCause::Cancelled | StopCause::Interrupted)) => {
            ending.reason = format!("stopped; {error}");
        }
        (None, ..) => {
            ending.reason = error.to_string();
            (ending.outcome, ending.cause) = (Outcome::Failed, Some(StopCause::JournalLost));
        }
    }
}

/// Faults that have begun by now.
fn faults_within<R: Rig>(setup: &RunSetup<R>) -> Vec<FaultReport> {
    let now = setup.now();
    let begun = setup.faults.iter().filter(|fault| fault.from <= now);
    let report = |fault: &FaultSpec| FaultReport {
        component: fault.component.name(),
        kind: fault.kind.name().to_owned(),
        value: fault.values.iter().copied().take(fault.kind.values().len()).collect(),
        from_s: fault.from.secs(),
        to_s: fault.to.map(PlateTime::secs),
    };
    begun.map(report).collect()
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
            let in_bin = |(part, kind): (&PartReport, usize)| {
                let mut own = bins.iter().filter(|bin| bin.kinds.contains(&kind));
                own.any(|bin| {
                    let radius_m = job.kind(kind).map_or(0.0, |spec| spec.kind.radius_m);
                    part.true_mm.is_some_and(|at_mm| {
                        (0..2).all(|axis| {
                            let least_mm = mm_from_m(bin.min_m[axis] + radius_m) - SENSING_MM;
                            let most_mm = mm_from_m(bin.max_m[axis] - radius_m) + SENSING_MM;
                            (least_mm..=most_mm).contains(&at_mm[axis])
                        })
                    })
                })
            };
            report.parts.iter().zip(job.kinds_of_parts()).all(in_bin)
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
    let mut left: Vec<(usize, [f64; 2])> =
        report.parts.iter().zip(&kinds).filter_map(|(part, &kind)| Some((kind, part.true_mm?))).collect();
    report.parts.iter().zip(&kinds).all(|(part, &kind)| {
        let Some(place_mm) = place_mm(part) else { return true };
        let near = |at_mm: [f64; 2]| (at_mm[0] - place_mm[0]).hypot(at_mm[1] - place_mm[1]) <= within_mm;
        let found = left.iter().position(|&(of, at_mm)| of == kind && near(at_mm));
        found.map(|at| left.swap_remove(at)).is_some()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn write_failure_is_added_to_the_cause_or_replaces_a_lesser_one() {
        let error = RunError::Write { path: "journal.jsonl".into(), reason: "no space".into() };
        let ended = |cause, outcome| {
            let mut ending = EndFacts { cause, outcome, reason: "penny-1 is lost".into(), ..EndFacts::default() };
            unwritten_ending(&mut ending, &error);
            (ending.cause, ending.outcome, ending.reason)
        };
        let (failed, cancelled) = (Outcome::Failed, Outcome::Cancelled);
        let lost = "penny-1 is lost; cannot write journal.jsonl: no space";
        assert_eq!(ended(Some(StopCause::PartLost), failed), (Some(StopCause::PartLost), failed, lost.into()));
        let stopped = "stopped; cannot write journal.jsonl: no space";
        assert_eq!(ended(Some(StopCause::Estop), cancelled), (Some(StopCause::Estop), cancelled, stopped.into()));
        for cause in [None, Some(StopCause::Stopped), Some(StopCause::TimeLimit)] {
            let (named, outcome, reason) = ended(cause, cancelled);
            assert_eq!((named, outcome), (Some(StopCause::JournalLost), failed));
            assert_eq!(reason, error.to_string());
        }
    }
}
