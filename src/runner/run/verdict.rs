use crate::config::{Assignment, JobSpec, TaskSpec};
use upm_core::job::Outcome;
use upm_core::units::mm_from_m;
use upm_recording::{PartReport, Report, Verdict};

/// What a true error may exceed the tolerance by, mm: what the eyes are off by.
const SENSING_MM: f64 = 0.1;

/// What the truth says of `report`, a run of `job`; `None` where it is not known. Parts on paths without end, or at
/// prescribed speeds, have no last place: they must lie where they are believed to be.
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

/// True when a part of the right kind truly lies at each `place_mm`, whichever it is: parts of a kind may exchange their
/// targets, and their names where the camera cannot tell them apart.
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
