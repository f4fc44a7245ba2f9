use std::sync::Arc;

use crate::store::{NewJob, Pace};
use upm_planning::cor_library::Library;
use upm_runner::config::{Diagnostic, JobSpec, Origin, Path, RigSpec};
use upm_runner::run::check_places;

/// Name of a submitted job in faults, in place of a file name.
const REQUEST: &str = "job";

/// Rules that jobs of a plate are checked against before they are queued.
#[derive(Debug)]
pub(super) struct JobRules {
    pub plate: String,
    pub rig: RigSpec,
    /// The library of the plate. It was checked against the rig when the plate was set up.
    pub library: Arc<Library>,
    /// True when jobs may make the simulated rig fail on purpose.
    pub allow_faults: bool,
}

impl JobRules {
    /// A submitted job, checked completely: its text and whether its parts fit on the plate.
    pub fn validated(&self, text: &str, pace: Pace) -> Result<NewJob, Vec<Diagnostic>> {
        let job = self.checked(text)?;
        Ok(NewJob {
            name: job.name.clone(),
            plate: self.plate.clone(),
            seed: job.seed(),
            pace,
            spec_json: job.effective_without_rig().to_string(),
            rig_fingerprint: self.rig.fingerprint.clone(),
            body_sha256: [0; 32],
            key: None,
        })
    }

    /// The job in `text`, if it may be queued.
    pub fn checked(&self, text: &str) -> Result<JobSpec, Vec<Diagnostic>> {
        let job = JobSpec::from_json(text, &Origin::of_request(REQUEST), Some(&self.rig))?;
        let refused = |key: &str, found: String, allowed: String| {
            Err(vec![Diagnostic::new(REQUEST, Path::root().key(key), found, allowed)])
        };
        if job.names_library() {
            return refused("library", "a library".into(), format!("nothing (plate {} has its library)", self.plate));
        }
        if !self.allow_faults && !job.faults.is_empty() {
            let count = job.faults.len();
            let found = format!("{count} fault{}", if count == 1 { "" } else { "s" });
            return refused("faults", found, "none (unless the daemon's file says \"allow_faults\": true)".into());
        }
        check_places(&job).map_err(|fault| vec![fault])?;
        Ok(job)
    }
}
