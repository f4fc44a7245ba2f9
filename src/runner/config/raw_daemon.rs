use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use upm_core::job::Pace;

use super::raw_rig::RigSource;
use upm_document::SchemaKey;

/// The daemon's configuration: plates, and limits of queue, disk and memory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "daemon")]
pub struct RawDaemon {
    /// Path or address of this file's schema, for editors. Nothing else reads it.
    #[serde(rename = "$schema", default, skip_serializing)]
    pub schema: SchemaKey,
    /// Address and port to listen on, as `127.0.0.1:8750`; port 0 is any free one. An address that others can reach
    /// asks for a token.
    #[serde(default = "listen")]
    #[schemars(length(min = 1, max = 64))]
    pub listen: String,
    /// Address and port of a second listener, which stops every plate by `POST /v1/estop` and does nothing else. Left
    /// out: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1, max = 64))]
    pub stop_listen: Option<String>,
    /// Folder of the job store, run folders and latches, relative to this file.
    #[serde(default = "data")]
    #[schemars(length(min = 1, max = 4096))]
    pub data: String,
    /// Plates that the daemon drives, each with its rig; 1 to 16.
    #[schemars(length(min = 1, max = 16))]
    pub plates: Vec<RawServedPlate>,
    /// Plate of jobs that name none. Left out: the only plate, or none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1, max = 64))]
    pub default_plate: Option<String>,
    /// Jobs that may wait for one plate.
    #[serde(default = "queue")]
    #[schemars(range(min = 1, max = 10_000))]
    pub queue: u32,
    /// How fast jobs run that do not say.
    #[serde(default)]
    pub pace: Pace,
    /// Names under which the daemon is reached besides its address and localhost, without a port. A proxy in front of
    /// it must pass on the Host header that it got: the operator page works only under that host and port.
    #[serde(default)]
    #[schemars(length(max = 64))]
    pub hosts: Vec<String>,
    /// File of the token that may do everything, relative to this file. The log warns of one that others may read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1, max = 4096))]
    pub token_file: Option<String>,
    /// File of the token that may only look, and stop.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1, max = 4096))]
    pub read_token_file: Option<String>,
    /// Retention of jobs that have ended.
    #[serde(default)]
    pub keep: RawKeep,
    /// Room on the disk.
    #[serde(default)]
    pub disk: RawDisk,
    /// When a plate is stopped because something is wrong.
    #[serde(default)]
    pub watchdog: RawWatchdog,
    /// Live streams for the Rerun viewer.
    #[serde(default)]
    pub live: RawLive,
    /// True to take jobs with `faults`, which make the simulated rig fail on purpose.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub allow_faults: bool,
}

fn listen() -> String {
    "127.0.0.1:8750".to_owned()
}

fn data() -> String {
    "data".to_owned()
}

fn queue() -> u32 {
    64
}

/// A plate that is served.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawServedPlate {
    /// Its name, by which jobs ask for it: letters, digits, `.`, `_` and `-`.
    #[schemars(length(min = 1, max = 64), extend("pattern" = "^[A-Za-z0-9._-]+$"))]
    pub name: String,
    /// The rig: a path relative to this file, or the object itself.
    pub rig: RigSource,
    /// COR library in place of the rig's: a path relative to this file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1, max = 4096))]
    pub library: Option<String>,
    /// Port of its live stream on 127.0.0.1, which no token covers. Left out: any free one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1))]
    pub live_port: Option<u16>,
    /// Job that runs whenever the plate's queue is empty, and gives way between two cycles to any job that comes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub standing_job: Option<RawStandingJob>,
}

/// The standing job of a plate. It begins again whenever it ends, until it fails or a person cancels it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawStandingJob {
    /// Path of the job file, relative to this file. It may name the plate's rig, and no other.
    #[schemars(length(min = 1, max = 4096))]
    pub job: String,
    /// Whether it runs from the start of the daemon on, or waits for `upm resume PLATE`.
    #[serde(default)]
    pub start: RawStart,
}

/// How a standing job is when the daemon starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RawStart {
    /// It runs as soon as its plate may move and nothing is queued.
    #[default]
    Running,
    /// It waits until a person resumes the plate.
    Paused,
}

/// Retention of jobs that have ended. Run folders go when they are too large in total, the oldest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawKeep {
    /// Most room for run folders, GB of 10⁹ bytes.
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
    pub runs_gb: f64,
    /// Ended runs of a standing job that are kept, for each plate: the newest. They go with folder and row.
    #[schemars(range(min = 1, max = 10_000))]
    pub standing_runs: u32,
    /// Jobs that are remembered.
    #[schemars(range(min = 100, max = 10_000_000))]
    pub jobs: u32,
}

impl Default for RawKeep {
    fn default() -> Self {
        Self { runs_gb: 20.0, standing_runs: 8, jobs: 100_000 }
    }
}

/// Room on the disk, MB of 10⁶ bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawDisk {
    /// With less than this left no job is taken, and standing jobs wait.
    #[schemars(range(min = 1.0, max = 1e9))]
    pub min_free_mb: f64,
}

impl Default for RawDisk {
    fn default() -> Self {
        Self { min_free_mb: 500.0 }
    }
}

/// When a plate is stopped because something is wrong.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawWatchdog {
    /// No frame came for so long, s of wall time.
    #[schemars(range(min = 1.0, max = 3600.0))]
    pub hung_s: f64,
    /// No part was seen for so long, s of plate time.
    #[schemars(range(min = 0.1, max = 60.0))]
    pub no_part_s: f64,
    /// A journal or a queue of events took nothing for so long, s of wall time.
    #[schemars(range(min = 0.1, max = 60.0))]
    pub blocked_s: f64,
}

impl Default for RawWatchdog {
    fn default() -> Self {
        Self { hung_s: 30.0, no_part_s: 0.5, blocked_s: 30.0 }
    }
}

/// Live streams for the Rerun viewer, one of Rerun's servers for each plate. They ask for no token, and so are on the
/// loopback alone and only while the daemon is, too.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawLive {
    /// Whether there are any. Any program on this machine could reach them, and so could any page in a browser on it.
    pub rerun: bool,
    /// Memory limit of a server for what it keeps for later viewers, MB of 10⁶ bytes. It counts about half of the
    /// memory that it takes.
    #[schemars(range(min = 1.0, max = 10_000.0))]
    pub history_mb: f64,
}

impl Default for RawLive {
    fn default() -> Self {
        Self { rerun: false, history_mb: 8.0 }
    }
}
