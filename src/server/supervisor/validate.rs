use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::{JobLayout, PlateSetup};
use crate::store::{NewJob, Pace};
use upm_planning::cor_library::Library;
use upm_runner::config::{Diagnostic, JobSpec, Origin, Path, RigSpec};
use upm_runner::run::check_places;

/// Name of a submitted job in faults, in place of a file name.
const REQUEST: &str = "job";

/// Rules that jobs of a plate are checked against before they are queued.
#[derive(Debug)]
pub(super) struct JobRules {
    plate: String,
    pub rig: RigSpec,
    /// The library of the plate. It was checked against the rig when the plate was set up.
    pub library: Arc<Library>,
    /// True when jobs may make the simulated rig fail on purpose.
    allow_faults: bool,
}

impl JobRules {
    /// The rules of the plate that `setup` describes.
    pub fn new(setup: &PlateSetup) -> Self {
        let PlateSetup { name, rig, library, allow_faults, .. } = setup;
        Self { plate: name.clone(), rig: rig.clone(), library: Arc::clone(library), allow_faults: *allow_faults }
    }
}

/// A submitted job, checked completely: its text and whether its parts fit on the plate.
pub(super) fn validated(
    rules: &JobRules,
    text: &str,
    pace: Pace,
    key: Option<String>,
) -> Result<NewJob, Vec<Diagnostic>> {
    let job = checked(rules, text)?;
    Ok(NewJob {
        name: job.name.clone(),
        plate: rules.plate.clone(),
        seed: job.seed(),
        pace,
        spec_json: job.effective_without_rig().to_string(),
        rig_fingerprint: rules.rig.fingerprint.clone(),
        body_sha256: Sha256::digest(text.as_bytes()).into(),
        key,
    })
}

/// Name and layout of a submitted job that [`validated`] would accept.
pub(super) fn layout_of_submission(rules: &JobRules, text: &str) -> Result<(String, JobLayout), Vec<Diagnostic>> {
    let job = checked(rules, text)?;
    Ok((job.name.clone(), JobLayout::of(&job)))
}

fn checked(rules: &JobRules, text: &str) -> Result<JobSpec, Vec<Diagnostic>> {
    let job = JobSpec::from_json(text, &Origin::of_request(REQUEST), Some(&rules.rig))?;
    let refused = |key: &str, found: String, allowed: String| {
        Err(vec![Diagnostic::new(REQUEST, Path::root().key(key), found, allowed)])
    };
    if job.names_library() {
        return refused("library", "a library".into(), format!("nothing (plate {} has its library)", rules.plate));
    }
    if !rules.allow_faults && !job.faults.is_empty() {
        let count = job.faults.len();
        let found = format!("{count} fault{}", if count == 1 { "" } else { "s" });
        return refused("faults", found, "none (unless the daemon's file says \"allow_faults\": true)".into());
    }
    check_places(&job).map_err(|fault| vec![fault])?;
    Ok(job)
}
