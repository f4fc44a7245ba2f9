use std::time::Duration;

use super::Clocks;

/// Options of [`Store::open`](super::Store::open), without the data folder.
#[derive(Clone, Copy)]
pub(super) struct OpenOptions<'a> {
    pub plates: &'a [String],
    pub limits: &'a StoreLimits,
    pub clocks: &'a Clocks,
}

/// Limits of the store's contents.
#[derive(Clone, Debug, PartialEq)]
pub struct StoreLimits {
    /// Most jobs queued for one plate.
    pub queued: usize,
    /// Most jobs stored. The oldest ended ones are deleted first, but none while its idempotency key is remembered.
    pub jobs: u64,
    /// Most events stored of one job.
    pub events_per_job: u64,
    /// Most events stored of all jobs.
    pub events: u64,
    /// Time for which an idempotency key is remembered, measured while the store is open, see
    /// [`Clocks`](super::Clocks).
    pub keys_kept: Duration,
    /// Most bytes of run folders.
    pub runs_bytes: u64,
    /// Ended runs of standing jobs that are kept for each plate, with their folders and events.
    pub standing_runs: u64,
}

impl Default for StoreLimits {
    fn default() -> Self {
        let day = Duration::from_secs(24 * 3600);
        Self {
            queued: 64,
            jobs: 100_000,
            events_per_job: 10_000,
            events: 1_000_000,
            keys_kept: day,
            runs_bytes: 20_000_000_000,
            standing_runs: 8,
        }
    }
}
