use std::path::PathBuf;
use std::sync::Arc;

use super::Pause;
use crate::store::{Ledger, Pace};
use upm_core::time::MonotonicClock;
use upm_library::Library;
use upm_runner::config::{JobSpec, RigSpec, WatchdogSpec};

/// One plate to be made.
#[derive(Clone, Debug)]
pub struct PlateSetup {
    /// Its name, fit for a file.
    pub name: String,
    /// True when the store knew it before this start: a latch file that is missing then counts as stopped.
    pub known: bool,
    /// The simulated rig.
    pub rig: RigSpec,
    /// The library its jobs use unless they bring their own.
    pub library: Arc<Library>,
    /// Why it must not move at first; `None` when it may.
    pub paused: Option<Pause>,
    /// Port of its live stream; `None` for any free one.
    pub live_port: Option<u16>,
    /// The job that runs whenever its queue is empty.
    pub standing: Option<StandingSetup>,
    /// True to take jobs that make the simulated rig fail on purpose.
    pub allow_faults: bool,
}

/// Resources and settings that all plates share.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// Where jobs come from and go to.
    pub ledger: Arc<dyn Ledger>,
    /// Folder of run folders.
    pub runs: PathBuf,
    /// Folder of the latches.
    pub latches: PathBuf,
    /// The daemon's clock.
    pub clock: MonotonicClock,
    /// False to make no recordings.
    pub record: bool,
    /// When a plate is stopped because something is wrong.
    pub watchdog: WatchdogSpec,
    /// With fewer bytes than this left on the disk recordings are stopped.
    pub min_free_bytes: u64,
    /// Bytes a live stream keeps for viewers that come later; `None` for no live streams.
    pub live_history_bytes: Option<u64>,
    /// Whether a job may bring a library that does not agree with the plate's own.
    pub allow_inline_libraries: bool,
}

/// Settings of a standing job.
#[derive(Clone, Debug)]
pub struct StandingSetup {
    /// The job, on the plate's rig.
    pub job: JobSpec,
    /// How fast it runs.
    pub pace: Pace,
    /// Why it must not run at first; `None` when it may.
    pub paused: Option<String>,
}
