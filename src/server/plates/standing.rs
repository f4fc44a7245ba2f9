use std::io;
use std::sync::atomic::{AtomicBool, Ordering};

use parking_lot::Mutex;

use super::validate::{JobRules, validated};
use super::{StandingSetup, StandingSnapshot};
use crate::states::StandingState;
use crate::store::NewJob;

/// The standing job of a plate: runs whenever the plate's queue is empty, and gives way to every queued job.
#[derive(Debug)]
pub(super) struct Standing {
    pub job: NewJob,
    /// Set when a job is queued: the run on the plate ends between two cycles.
    pub give_way: AtomicBool,
    /// Why it waits for a person.
    paused: Mutex<Option<String>>,
    /// Why it waits for anything else than its turn.
    held: Mutex<Option<String>>,
}

impl Standing {
    /// The standing job of a plate, held against `rules` as a job that is sent to it.
    pub fn new(setup: &StandingSetup, rules: &JobRules) -> io::Result<Self> {
        let StandingSetup { job, pace, paused } = setup;
        let text = job.effective_without_rig().to_string();
        let job = validated(rules, &text, *pace, None).map_err(|faults| {
            let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
            io::Error::new(io::ErrorKind::InvalidInput, lines.join("; "))
        })?;
        let (give_way, held) = (AtomicBool::new(false), Mutex::default());
        Ok(Self { job, give_way, paused: Mutex::new(paused.clone()), held })
    }

    /// Why it waits for a person.
    pub fn paused(&self) -> Option<String> {
        self.paused.lock().clone()
    }

    /// Has it wait for a person, or lets it run again.
    pub fn pause(&self, why: Option<String>) {
        *self.paused.lock() = why;
    }

    /// Notes why it may not begin, apart from its turn. True when that is news.
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

    /// How it is now, on the plate or not.
    pub fn snapshot(&self, is_running: bool) -> StandingSnapshot {
        let (state, why) = match (is_running, self.paused()) {
            (true, _) => (StandingState::Running, None),
            (false, Some(why)) => (StandingState::Paused, Some(why)),
            (false, None) => (StandingState::Waiting, self.held.lock().clone()),
        };
        StandingSnapshot { name: self.job.name.clone(), state, why: why.unwrap_or_default() }
    }
}
