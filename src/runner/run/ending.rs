//! The ending of a run as its report has it.

use super::{Bench, PlannerSelection, RunError};
use crate::config::JobSpec;
use upm_control::{ExpectedPart, Finish};
use upm_core::job::{Outcome, StopCause};
use upm_core::time::PlateTime;
use upm_recording::{Ending, FaultReport, PartEnding};
use upm_sim::faults::FaultSpec;

/// The ending of a run; without a bench of one that never had a plate.
pub(super) fn ending(job: &JobSpec, bench: Option<&Bench>, finish: Finish, wall_time_s: f64) -> Ending {
    let Finish { ending, wanted, measured_m, lost } = finish;
    let part_ending = |(i, part): (usize, &ExpectedPart), bench: &Bench| PartEnding {
        id: part.id.clone(),
        kind: bench.params.kinds.get(part.kind).map(|kind| kind.name.clone()).unwrap_or_default(),
        target_m: wanted.as_ref().and_then(|wanted| wanted.targets_m.get(i).copied()),
        measured_m: measured_m.get(i).copied(),
    };
    let parts = bench.map(|bench| bench.params.parts.iter().enumerate().map(|part| part_ending(part, bench)).collect());
    Ending {
        name: job.name.clone(),
        seed: job.seed(),
        planner: Some(PlannerSelection::of(job).report()),
        outcome: ending.outcome,
        reason: ending.reason,
        cause: ending.cause,
        plate_time: bench.map_or(PlateTime::ZERO, Bench::now),
        bound_s: None,
        wall_time_s,
        deadlines: None,
        laps: wanted.as_ref().map_or(0, |wanted| wanted.laps),
        lost_parts: lost.len(),
        parts: parts.unwrap_or_default(),
        faults: bench.map(faults_within).unwrap_or_default(),
    }
}

/// The ending of a run of which something could not be written. A lost part is named all the same, and whoever stopped the run
/// stopped it.
pub(super) fn unwritten_ending(ending: &mut Ending, error: &RunError) {
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

/// The faults that have begun by now.
fn faults_within(bench: &Bench) -> Vec<FaultReport> {
    let now = bench.now();
    let begun = bench.faults.iter().filter(|fault| fault.from <= now);
    let report = |fault: &FaultSpec| FaultReport {
        component: fault.component.name(),
        kind: fault.kind.name().to_owned(),
        value: fault.values.iter().copied().take(fault.kind.values().len()).collect(),
        from_s: fault.from.secs(),
        to_s: fault.to.map(PlateTime::secs),
    };
    begun.map(report).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_of_which_something_is_unwritten_still_says_what_matters() {
        let error = RunError::Write { path: "journal.jsonl".into(), reason: "no space".into() };
        let ended = |cause, outcome| {
            let mut ending = Ending { cause, outcome, reason: "penny-1 is lost".into(), ..Ending::default() };
            unwritten_ending(&mut ending, &error);
            (ending.cause, ending.outcome, ending.reason)
        };
        let (failed, cancelled) = (Outcome::Failed, Outcome::Cancelled);
        let lost = "penny-1 is lost; journal.jsonl: cannot be written: no space";
        assert_eq!(ended(Some(StopCause::PartLost), failed), (Some(StopCause::PartLost), failed, lost.into()));
        let stopped = "stopped; journal.jsonl: cannot be written: no space";
        assert_eq!(ended(Some(StopCause::Estop), cancelled), (Some(StopCause::Estop), cancelled, stopped.into()));
        for cause in [None, Some(StopCause::Stopped), Some(StopCause::TimeLimit)] {
            let (named, outcome, reason) = ended(cause, cancelled);
            assert_eq!((named, outcome), (Some(StopCause::JournalLost), failed));
            assert_eq!(reason, error.to_string());
        }
    }
}
