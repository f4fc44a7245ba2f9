use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::shared::Shared;
use crate::store::{NewJob, Pace};
use upm_library::Library;
use upm_runner::config::{Fault, JobSpec, LibraryRef, Origin, Path};
use upm_runner::run::{check_job, check_places, job_library};

/// What faults of a job that came in a request call it.
const REQUEST: &str = "job";

/// The job of a request, checked as a whole: its text, the library it is to run with and whether its parts find room.
pub(super) fn validated(shared: &Shared, text: &str, pace: Pace, key: Option<String>) -> Result<NewJob, Vec<Fault>> {
    let job = JobSpec::from_json(text, &Origin::of_request(REQUEST), Some(&shared.rig))?;
    if !shared.allow_faults && !job.faults.is_empty() {
        let count = job.faults.len();
        let found = format!("{count} fault{}", if count == 1 { "" } else { "s" });
        let allowed = "none, unless the daemon's file says \"allow_faults\": true";
        return Err(vec![Fault::new(REQUEST, Path::root().key("faults"), found, allowed)]);
    }
    let library = fitting_library(&job, &shared.library)?;
    if !shared.allow_inline_libraries {
        agreeing(&job, &library, &shared.library).map_err(|fault| vec![fault])?;
    }
    Ok(NewJob {
        name: job.name.clone(),
        plate: shared.name.clone(),
        seed: job.seed(),
        pace,
        spec_json: job.effective_without_rig().to_string(),
        rig_fingerprint: shared.rig.fingerprint.clone(),
        library_sha256: shared.sha256_of(&library),
        body_sha256: Sha256::digest(text.as_bytes()).into(),
        key,
    })
}

/// The library of `job` on a plate whose own is `of_plate`, checked together with the places of the parts.
pub fn fitting_library(job: &JobSpec, of_plate: &Arc<Library>) -> Result<Arc<Library>, Vec<Fault>> {
    let library = library_for(job, of_plate)?;
    match &job.library {
        Some(LibraryRef::Inline(_)) => check_job(job, &library)?,
        // the plate's own was held against the rig when the plate was set up, and that takes a while
        _ => check_places(job).map_err(|fault| vec![fault])?,
    }
    Ok(library)
}

/// A library that came with a request says the same of the plate as the plate's own.
fn agreeing(job: &JobSpec, library: &Library, of_plate: &Library) -> Result<(), Fault> {
    let disagreement = match &job.library {
        Some(LibraryRef::Inline(_)) => library.disagreement(of_plate),
        _ => None,
    };
    disagreement.map_or(Ok(()), |fault| Err(fault.in_file(&format!("{REQUEST}: library"))))
}

/// The job's own library, or the plate's.
pub(super) fn library_for(job: &JobSpec, of_plate: &Arc<Library>) -> Result<Arc<Library>, Vec<Fault>> {
    match job.library {
        Some(LibraryRef::Inline(_)) => job_library(job),
        _ => Ok(Arc::clone(of_plate)),
    }
}
