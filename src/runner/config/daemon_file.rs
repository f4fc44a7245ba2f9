//! The daemon's configuration as a person writes it.

use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use upm_core::job::Pace;

use super::read::{BASE_PATH_PATTERN, PLAIN_NAME_PATTERN};
use super::rig_file::RigSource;
use upm_core::units::{file_form, whole};

file_form!(gigabytes: f64 => u64, |gb| (gb * 1e9).round() as u64, |bytes| *bytes as f64 / 1e9);
file_form!(megabytes: f64 => u64, |mb| (mb * 1e6).round() as u64, |bytes| *bytes as f64 / 1e6);
file_form!(seconds: f64 => Duration, Duration::from_secs_f64, Duration::as_secs_f64);

/// The daemon's configuration: plates, and limits of queue, disk and memory.
#[derive(Deserialize, JsonSchema)]
#[schemars(title = "daemon")]
pub(crate) struct DaemonFile {
    /// Address and port to listen on, as `127.0.0.1:8750`; port 0 is any free one. An address that others can reach
    /// asks for a token.
    #[serde(default = "listen")]
    #[schemars(length(min = 1, max = 64))]
    pub(crate) listen: String,
    /// Address and port of a second listener, which stops every plate by `POST /v1/estop` and does nothing else. Left
    /// out: none.
    #[schemars(length(min = 1, max = 64))]
    pub(crate) stop_listen: Option<String>,
    /// Path below which the page and the API are served, as `/upm`, for a proxy that passes it on. Left out: none.
    #[schemars(length(max = 256), extend("pattern" = BASE_PATH_PATTERN))]
    pub(crate) base_path: Option<String>,
    /// Folder of the job store, run folders and latches, relative to this file.
    #[serde(default = "data")]
    #[schemars(length(min = 1, max = 4096))]
    pub(crate) data: String,
    /// Plates that the daemon drives, each with its rig; 1 to 16.
    #[schemars(length(min = 1, max = 16))]
    pub(crate) plates: Vec<PlateEntry>,
    /// Plate of jobs that name none. Left out: the only plate, or none.
    #[schemars(length(min = 1, max = 64))]
    pub(crate) default_plate: Option<String>,
    /// Jobs that may wait for one plate.
    #[serde(default = "whole::<u32, 64>")]
    #[schemars(range(min = 1, max = 10_000))]
    pub(crate) queue: u32,
    /// How fast jobs run that do not say.
    #[serde(default)]
    pub(crate) pace: Pace,
    /// Names under which the daemon is reached besides its address and localhost, without a port. A proxy in front of
    /// it must pass on the Host header that it got: the operator page works only under that host and port.
    #[serde(default)]
    #[schemars(length(max = 64))]
    pub(crate) hosts: Vec<String>,
    /// File of the token that may do everything, relative to this file. The log warns of one that others may read.
    #[schemars(length(min = 1, max = 4096))]
    pub(crate) token_file: Option<String>,
    /// File of the token that may only look, and stop.
    #[schemars(length(min = 1, max = 4096))]
    pub(crate) read_token_file: Option<String>,
    /// Retention of jobs that have ended.
    #[serde(default)]
    pub(crate) keep: KeepSpec,
    /// Room on the disk.
    #[serde(default)]
    pub(crate) disk: DiskLimits,
    /// When a plate is stopped because something is wrong.
    #[serde(default)]
    pub(crate) watchdog: WatchdogSpec,
    /// Recordings of runs for Rerun: `off`, `save`, or `connect=URL`, which also shows each run in the viewer that
    /// listens there while it lasts (`connect` alone: on this machine). Left out: `save` where this build can record.
    #[schemars(length(min = 1, max = 4096))]
    pub(crate) rerun: Option<String>,
    /// True to take jobs with `faults`, which make the simulated rig fail on purpose.
    #[serde(default)]
    pub(crate) allow_faults: bool,
}

fn listen() -> String {
    "127.0.0.1:8750".to_owned()
}

fn data() -> String {
    "data".to_owned()
}

/// A plate that is served.
#[derive(Deserialize, JsonSchema)]
pub(crate) struct PlateEntry {
    /// Its name, by which jobs ask for it: ASCII letters, digits, `.`, `_` and `-`, not first `.` or `-`.
    #[schemars(length(min = 1, max = 64), extend("pattern" = PLAIN_NAME_PATTERN))]
    pub(crate) name: String,
    /// The rig: a path relative to this file, or the object itself.
    pub(crate) rig: RigSource,
    /// COR library in place of the rig's: a path relative to this file.
    #[schemars(length(min = 1, max = 4096))]
    pub(crate) library: Option<String>,
    /// Whether the next job begins at once after one, or once a person has resumed the plate.
    #[serde(default)]
    pub(crate) between_jobs: BetweenJobs,
    /// Job that runs whenever the plate's queue is empty, and gives way between two cycles to any job that comes.
    pub(crate) standing_job: Option<StandingEntry>,
}

/// Behaviour of a plate after a job.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum BetweenJobs {
    /// It takes the next job.
    #[default]
    GoOn,
    /// It pauses until a person resumes it.
    Wait,
}

/// The standing job of a plate. It begins again whenever it ends, until it fails or a person cancels it.
#[derive(Deserialize, JsonSchema)]
pub(crate) struct StandingEntry {
    /// Path of the job file, relative to this file. It may name the plate's rig, and no other.
    #[schemars(length(min = 1, max = 4096))]
    pub(crate) job: String,
    /// Whether it runs from the start of the daemon on, or waits for `upm resume PLATE`.
    #[serde(default)]
    pub(crate) start: StandingStart,
}

/// How a standing job is when the daemon starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum StandingStart {
    /// It runs as soon as its plate may move and nothing is queued.
    #[default]
    Running,
    /// It waits until a person resumes the plate.
    Paused,
}

/// Retention of jobs that have ended. Run folders go when they are too large in total, the oldest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct KeepSpec {
    /// Most room for run folders, GB of 10⁹ bytes.
    #[serde(rename = "runs_gb", with = "gigabytes")]
    #[schemars(with = "f64", range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
    pub runs_bytes: u64,
    /// Ended runs of a standing job that are kept, for each plate: the newest. They go with folder and row.
    #[schemars(range(min = 1, max = 10_000))]
    pub standing_runs: u64,
    /// Jobs that are remembered.
    #[schemars(range(min = 100, max = 10_000_000))]
    pub jobs: u64,
}

impl Default for KeepSpec {
    fn default() -> Self {
        Self { runs_bytes: 20_000_000_000, standing_runs: 8, jobs: 100_000 }
    }
}

/// Room on the disk, MB of 10⁶ bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct DiskLimits {
    /// With less than this left no job is taken, and standing jobs wait.
    #[serde(rename = "min_free_mb", with = "megabytes")]
    #[schemars(with = "f64", range(min = 1.0, max = 1e9))]
    pub(crate) min_free_bytes: u64,
}

impl Default for DiskLimits {
    fn default() -> Self {
        Self { min_free_bytes: 500_000_000 }
    }
}

/// When a plate is stopped because something is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct WatchdogSpec {
    /// No frame came for so long, s of wall time.
    #[serde(rename = "hung_s", with = "seconds")]
    #[schemars(with = "f64", range(min = 1.0, max = 3600.0))]
    pub hung: Duration,
    /// No part was seen for so long, s of plate time.
    #[schemars(range(min = 0.1, max = 60.0))]
    pub no_part_s: f64,
    /// A journal or a queue of events took nothing for so long, s of wall time.
    #[serde(rename = "blocked_s", with = "seconds")]
    #[schemars(with = "f64", range(min = 0.1, max = 60.0))]
    pub blocked: Duration,
}

impl Default for WatchdogSpec {
    fn default() -> Self {
        Self { hung: Duration::from_secs(30), no_part_s: 0.5, blocked: Duration::from_secs(30) }
    }
}
