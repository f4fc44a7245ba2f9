use std::path::PathBuf;
use std::sync::Arc;

use crate::states::PauseCause;
use crate::store::{Pace, Store};
use upm_core::time::MonotonicClock;
use upm_planning::cor_library::Library;
use upm_recording::RerunMode;
use upm_runner::config::{PlateSpec, WatchdogSpec};

/// Settings of one plate.
#[derive(Clone, Debug)]
pub struct PlateSetup {
    /// The plate in the daemon's file.
    pub spec: PlateSpec,
    /// True when the store knew it before this start: a missing latch file then counts as stopped.
    pub known: bool,
    /// The library of the plate.
    pub library: Arc<Library>,
    /// Cause of an initial pause; `None` to start unpaused.
    pub paused: Option<PauseCause>,
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
    /// Destination of the runs' recordings.
    pub rerun: RerunMode,
    /// Limits at which the watchdog stops a plate.
    pub watchdog: WatchdogSpec,
    /// Standing jobs wait while fewer bytes than this are free on the disk.
    pub min_free_bytes: u64,
    /// True to accept jobs that make the simulated rig fail on purpose.
    pub allow_faults: bool,
    /// Pace of the runs of standing jobs.
    pub pace: Pace,
}
