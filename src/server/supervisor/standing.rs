use std::io;
use std::sync::atomic::{AtomicBool, Ordering};

use parking_lot::Mutex;

use super::validate::JobRules;
use crate::states::{StandingJob, StandingState};
use crate::store::{NewJob, Pace};
use upm_runner::config::StandingSpec;

/// Reason of a waiting standing job that is configured with `"start": "paused"`.
const STARTS_PAUSED: &str = "it starts paused, as the configuration says";

/// The standing job of a plate: runs whenever the plate's queue is empty, and gives way to every queued job.
#[derive(Debug)]
pub(super) struct Standing {
    pub job: NewJob,
    /// Set when a job is queued: the standing run then ends between two cycles.
    pub give_way: AtomicBool,
    /// Reason of its pause; `None` when it is not paused.
    paused: Mutex<Option<String>>,
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

    /// Reason of its pause; `None` when it is not paused.
    pub fn paused(&self) -> Option<String> {
        self.paused.lock().clone()
    }

    /// Pauses it, or resumes it with `None`.
    pub fn pause(&self, why: Option<String>) {
        *self.paused.lock() = why;
    }

    /// Sets the reason for which it may not begin, apart from its turn. True when the reason is new.
    pub fn hold(&self, why: Option<String>) -> bool {
        let mut held = self.held.lock();
        let is_news = *held != why;
        *held = why;
        is_news
    }

    /// Ends its run between two cycles.
    pub fn give_way(&self) {
        self.give_way.store(true, Ordering::SeqCst);
    }

    /// The state of the standing job now, on the plate or not.
    pub fn snapshot(&self, is_running: bool) -> StandingJob {
        let (state, why) = match (is_running, self.paused()) {
            (true, _) => (StandingState::Running, None),
            (false, Some(why)) => (StandingState::Paused, Some(why)),
            (false, None) => (StandingState::Waiting, self.held.lock().clone()),
        };
        StandingJob { name: self.job.name.clone(), state, why: why.unwrap_or_default() }
    }
}
