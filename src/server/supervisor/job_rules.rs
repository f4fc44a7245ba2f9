use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use parking_lot::Mutex;

use crate::states::{StandingJob, StandingState};
use crate::store::{Job, JobRow, Pace};
use upm_core::document::counted;
use upm_planning::cor_library::Library;
use upm_runner::config::{Diagnostic, JobSpec, Origin, Path, RigSpec, StandingSpec};
use upm_runner::run::check_places;

/// Name of a submitted job in faults, in place of a file name.
const REQUEST: &str = "job";

/// Rules that jobs of a plate are checked against before they are queued.
#[derive(Debug)]
pub(crate) struct JobRules {
    pub plate: String,
    pub rig: RigSpec,
    /// The library of the plate. It was checked against the rig when the plate was set up.
    pub library: Arc<Library>,
    /// True when jobs may make the simulated rig fail on purpose.
    pub allow_faults: bool,
}

impl JobRules {
    /// A submitted job, checked completely: its text and whether its parts fit on the plate.
    pub fn validated(&self, text: &str, pace: Pace) -> Result<JobRow, Vec<Diagnostic>> {
        let spec = self.checked(text)?;
        let (name, plate) = (spec.name.clone(), self.plate.clone());
        let job = Job { name, plate, seed: spec.seed(), pace, ..Job::default() };
        let (rig_fingerprint, spec_json) = (self.rig.fingerprint.clone(), spec.effective_without_rig().to_string());
        Ok(JobRow { job, rig_fingerprint, spec_json, ..JobRow::default() })
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
            let found = counted(job.faults.len(), "fault");
            return refused("faults", found, "none (unless the daemon's file says \"allow_faults\": true)".into());
        }
        check_places(&job).map_err(|fault| vec![fault])?;
        Ok(job)
    }
}

/// Reason of a waiting standing job that is configured with `"start": "paused"`.
const STARTS_PAUSED: &str = "it starts paused, as the configuration says";

/// The standing job of a plate: runs whenever the plate's queue is empty, and gives way to every queued job.
#[derive(Debug)]
pub(super) struct Standing {
    pub job: JobRow,
    /// Set when a job is queued: the standing run then ends between two cycles.
    pub give_way: AtomicBool,
    /// Reason of its pause; `None` when it is not paused.
    pub paused: Mutex<Option<String>>,
    /// Reason for which it waits, apart from its turn and a pause.
    held: Mutex<Option<String>>,
}

impl Standing {
    /// The standing job of a plate, checked against `rules` like a submitted job.
    pub fn new(StandingSpec { job, starts_paused }: &StandingSpec, pace: Pace, rules: &JobRules) -> io::Result<Self> {
        let job = rules.validated(&job.effective_without_rig().to_string(), pace).map_err(|faults| {
            let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
            io::Error::new(io::ErrorKind::InvalidInput, lines.join("; "))
        })?;
        let paused = Mutex::new(starts_paused.then(|| STARTS_PAUSED.to_owned()));
        Ok(Self { job, give_way: AtomicBool::new(false), paused, held: Mutex::default() })
    }

    /// Sets the reason for which it may not begin, apart from its turn. True when it could begin before or can now.
    pub fn hold(&self, why: Option<String>) -> bool {
        let mut held = self.held.lock();
        let was_held = held.is_some();
        *held = why;
        was_held != held.is_some()
    }

    /// The state of the standing job now, on the plate or not.
    pub fn snapshot(&self, is_running: bool) -> StandingJob {
        let (state, why) = match (is_running, self.paused.lock().clone()) {
            (true, _) => (StandingState::Running, None),
            (false, Some(why)) => (StandingState::Paused, Some(why)),
            (false, None) => (StandingState::Waiting, self.held.lock().clone()),
        };
        StandingJob { name: self.job.name.clone(), state, why: why.unwrap_or_default() }
    }
}
