use crate::config::{JobSpec, TaskSpec};
use upm_core::units::mm_from_m;
use upm_recording::{Outcome, PartReport, Report, Verdict};

/// What a true error may exceed the tolerance by, mm: what the eyes are off by.
const SENSING_MM: f64 = 0.1;

/// What the truth says of `report`, a run of `job`; `None` where it is not known, and for paths without end and paths at
/// speeds of their own, which have no last place.
pub(super) fn verdict(job: &JobSpec, report: &Report) -> Option<Verdict> {
    if report.parts.is_empty() || report.parts.iter().any(|part| part.true_mm.is_none()) {
        return None;
    }
    let near =
        |part: &PartReport| part.error_mm.is_none_or(|error_mm| error_mm <= mm_from_m(job.tolerance_m) + SENSING_MM);
    let is_reached = match &job.task {
        TaskSpec::Trajectories { .. } => return None,
        _ if job.is_endless() => return None,
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
        _ => report.parts.iter().all(near),
    };
    let is_false = report.outcome == Outcome::Completed && !is_reached;
    Some(if is_false { Verdict::FalseSuccess } else { Verdict::True })
}
