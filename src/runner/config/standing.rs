use serde_json::Value;

use super::job::JobSpec;
use super::raw_daemon::{RawServedPlate, RawStandingJob, RawStart};
use super::read::Origin;
use super::rig::RigSpec;
use upm_document::{Faults, Path, shown, text_of};

/// The standing job of a plate: it runs whenever the plate's queue is empty.
#[derive(Clone, Debug, PartialEq)]
pub struct StandingSpec {
    /// The job, on the plate's rig.
    pub job: JobSpec,
    /// True when it waits for a person after the daemon's start.
    pub starts_paused: bool,
}

/// The standing job of `plate`, read from the file that the daemon file names; its faults are told under its own name.
pub(super) fn standing_of(
    raw: &RawStandingJob,
    plate: &RawServedPlate,
    rig: &RigSpec,
    origin: &Origin,
    at: &Path,
    faults: &mut Faults,
) -> Option<StandingSpec> {
    let path = origin.named_file(&raw.job, &at.key("job"), faults)?;
    let found = || shown(&Value::from(raw.job.as_str()));
    let unread = |fault: super::Fault| faults.push(at.key("job"), found(), format!("a job file ({})", fault.found));
    let text = text_of(&path).map_err(unread).ok()?;
    let job = JobSpec::from_json(&text, &Origin::of_file(&path), Some(rig));
    let job = job.map_err(|others| faults.append(others)).ok()?;
    let mut of_job = Faults::of(&job.file);
    check(&job, plate, rig, &mut of_job);
    faults.append(of_job.into_list());
    Some(StandingSpec { job, starts_paused: raw.start == RawStart::Paused })
}

/// A plate has one rig and one library, and its standing job is of no other plate.
fn check(job: &JobSpec, plate: &RawServedPlate, rig: &RigSpec, faults: &mut Faults) {
    let (root, name) = (Path::root(), &plate.name);
    let allowed = format!("the rig of plate {name}, or nothing");
    faults.demand(rig.is_as_in(&job.rig.raw), root.key("rig"), "another rig", allowed);
    let asked = job.plate.as_deref().unwrap_or(name);
    let allowed = format!("{name}, whose standing job this is, or nothing");
    faults.demand(asked == name, root.key("plate"), shown(&Value::from(asked)), allowed);
    let allowed = format!("the library itself, or nothing: that of plate {name} applies");
    faults.demand(!job.names_library_file(), root.key("library"), "a path", allowed);
}
