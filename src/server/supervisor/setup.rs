use std::path::PathBuf;
use std::sync::Arc;

use super::Pause;
use crate::store::{Pace, Store};
use upm_core::time::MonotonicClock;
use upm_planning::cor_library::Library;
use upm_runner::config::{JobSpec, RigSpec, WatchdogSpec};

/// Settings of one plate.
#[derive(Clone, Debug)]
pub struct PlateSetup {
    /// Name of the plate, valid as a file name.
    pub name: String,
    /// True when the store knew it before this start: a missing latch file then counts as stopped.
    pub known: bool,
    /// The simulated rig.
    pub rig: RigSpec,
    /// The library of the plate.
    pub library: Arc<Library>,
    /// Cause of an initial pause; `None` to start unpaused.
    pub paused: Option<Pause>,
    /// Port of its live stream; `None` for any free one.
    pub live_port: Option<u16>,
    /// The job that runs whenever the queue is empty.
    pub standing: Option<StandingSetup>,
    /// True to accept jobs that make the simulated rig fail on purpose.
    pub allow_faults: bool,
}

/// Resources and settings that all plates share.
#[derive(Clone, Debug)]
pub struct SharedServices {
    /// The store from which jobs are taken and to which they are reported.
    pub store: Arc<Store>,
    /// Folder of the latch files.
    pub latches: PathBuf,
    /// The daemon's clock.
    pub clock: MonotonicClock,
    /// False to make no recordings.
    pub record: bool,
    /// Limits at which the watchdog stops a plate.
    pub watchdog: WatchdogSpec,
    /// Standing jobs wait while fewer bytes than this are free on the disk.
    pub min_free_bytes: u64,
    /// Memory limit of a live stream, bytes; `None` for no live streams.
    pub live_history_bytes: Option<u64>,
}

/// Settings of a standing job.
#[derive(Clone, Debug)]
pub struct StandingSetup {
    /// The job, on the plate's rig.
    pub job: JobSpec,
    /// Pace of its runs.
    pub pace: Pace,
    /// Reason of an initial pause; `None` to start unpaused.
    pub paused: Option<String>,
}
