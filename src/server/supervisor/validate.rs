use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::{JobLayout, PlateSetup};
use crate::store::{NewJob, Pace};
use upm_cor_library::Library;
use upm_runner::config::{Diagnostic, JobSpec, LibraryRef, Origin, Path, RigSpec};
use upm_runner::run::{check_job, check_places, job_library};

/// Name of a submitted job in faults, in place of a file name.
const REQUEST: &str = "job";

/// Rules that jobs of a plate are checked against before they are queued.
#[derive(Debug)]
pub(super) struct JobRules {
    plate: String,
    pub rig: RigSpec,
    /// The library for jobs that bring none.
    pub library: Arc<Library>,
    library_sha256: String,
    /// True when jobs may make the simulated rig fail on purpose.
    allow_faults: bool,
    /// True when a job may bring a library that disagrees with the plate's own.
    allow_inline_libraries: bool,
}

impl JobRules {
    /// The rules of the plate that `setup` describes.
    pub fn new(setup: &PlateSetup, allow_inline_libraries: bool) -> Self {
        let PlateSetup { name, rig, library, allow_faults, .. } = setup;
        Self {
            plate: name.clone(),
            rig: rig.clone(),
            library: Arc::clone(library),
            library_sha256: sha256_hex(library),
            allow_faults: *allow_faults,
            allow_inline_libraries,
        }
    }

    /// SHA-256 of a library's file form, in hex.
    fn sha256_of(&self, library: &Arc<Library>) -> String {
        if Arc::ptr_eq(library, &self.library) { self.library_sha256.clone() } else { sha256_hex(library) }
    }
}

fn sha256_hex(library: &Library) -> String {
    Sha256::digest(library.to_json().as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A submitted job, checked completely: its text, its library and whether its parts fit on the plate.
pub(super) fn validated(
    rules: &JobRules,
    text: &str,
    pace: Pace,
    key: Option<String>,
) -> Result<NewJob, Vec<Diagnostic>> {
    let (job, library) = checked(rules, text)?;
    Ok(NewJob {
        name: job.name.clone(),
        plate: rules.plate.clone(),
        seed: job.seed(),
        pace,
        spec_json: job.effective_without_rig().to_string(),
        rig_fingerprint: rules.rig.fingerprint.clone(),
        library_sha256: rules.sha256_of(&library),
        body_sha256: Sha256::digest(text.as_bytes()).into(),
        key,
    })
}

/// Name and layout of a submitted job that [`validated`] would accept.
pub(super) fn layout_of_submission(rules: &JobRules, text: &str) -> Result<(String, JobLayout), Vec<Diagnostic>> {
    let (job, _) = checked(rules, text)?;
    Ok((job.name.clone(), JobLayout::of(&job)))
}

fn checked(rules: &JobRules, text: &str) -> Result<(JobSpec, Arc<Library>), Vec<Diagnostic>> {
    let job = JobSpec::from_json(text, &Origin::of_request(REQUEST), Some(&rules.rig))?;
    if !rules.allow_faults && !job.faults.is_empty() {
        let count = job.faults.len();
        let found = format!("{count} fault{}", if count == 1 { "" } else { "s" });
        let allowed = "none (unless the daemon's file says \"allow_faults\": true)";
        return Err(vec![Diagnostic::new(REQUEST, Path::root().key("faults"), found, allowed)]);
    }
    let library = fitting_library(&job, &rules.library)?;
    if !rules.allow_inline_libraries {
        agreeing(&job, &library, &rules.library).map_err(|fault| vec![fault])?;
    }
    Ok((job, library))
}

/// The library of `job` on a plate whose own is `of_plate`, checked together with the places of the parts.
pub fn fitting_library(job: &JobSpec, of_plate: &Arc<Library>) -> Result<Arc<Library>, Vec<Diagnostic>> {
    let library = library_for(job, of_plate)?;
    match &job.library {
        Some(LibraryRef::Inline(_)) => check_job(job, &library)?,
        // the plate's own was checked against the rig when the plate was set up, and that check takes a while
        _ => check_places(job).map_err(|fault| vec![fault])?,
    }
    Ok(library)
}

/// Checks that a submitted library describes the plate as the plate's own does.
fn agreeing(job: &JobSpec, library: &Library, of_plate: &Library) -> Result<(), Diagnostic> {
    let disagreement = match &job.library {
        Some(LibraryRef::Inline(_)) => library.disagreement(of_plate),
        _ => None,
    };
    disagreement.map_or(Ok(()), |fault| Err(fault.in_file(&format!("{REQUEST}: library"))))
}

/// The job's own library, or the plate's.
pub(super) fn library_for(job: &JobSpec, of_plate: &Arc<Library>) -> Result<Arc<Library>, Vec<Diagnostic>> {
    match job.library {
        Some(LibraryRef::Inline(_)) => job_library(job),
        _ => Ok(Arc::clone(of_plate)),
    }
}
