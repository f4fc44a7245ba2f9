//! Arguments of the commands on run folders, and the pace of runs.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use upm_core::job::Pace;
use upm_runner::campaign::Seeds;

/// Changes of a job for one run.
#[derive(Args, Debug, Default)]
pub struct JobChanges {
    /// Planner in place of the job's
    #[arg(long, value_name = "NAME", requires = "job")]
    pub planner: Option<String>,
    /// Rig in place of the job's
    #[arg(long, value_name = "RIG.json", requires = "job")]
    pub rig: Option<PathBuf>,
    /// Value in place of the job's, as limits.plate_time_s=30 or parts[0].count=6; several by --set again
    #[arg(long, value_name = "KEY=VALUE", requires = "job")]
    pub set: Vec<String>,
}

/// Arguments of a command on a run folder.
#[derive(Args, Debug)]
pub struct RunFolderArgs {
    /// Run folder, as `upm run` leaves it, a unique prefix of one's name, or last for the newest
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Folder that runs are looked for in by name
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub out: PathBuf,
}

/// `upm export`.
#[derive(Args, Debug)]
#[command(
    after_help = "Tables: timings are of the report, all else is of the journal. Columns carry their unit; a value \
                  that the run does not have is empty.\n\n\
                  Data set: an episode for each run, all with as many parts and the same kind of task; a frame for \
                  each cycle, its columns in meta/info.json. `upm verify DIR` repeats every episode."
)]
pub struct ExportArgs {
    /// Run folders, as `upm run` leaves them, unique prefixes of their names, or last for the newest; tables are of one
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// Folder that runs are looked for in by name
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub out: PathBuf,
    /// Write each table as comma-separated values: positions.csv, targets.csv, pulses.csv, events.csv, timings.csv
    #[arg(long)]
    pub csv: bool,
    /// Write each table as Apache Parquet: positions.parquet and so on
    #[arg(long)]
    pub parquet: bool,
    /// Folder that the tables go into [default: RUN-tables beside the run folder]
    #[arg(long, value_name = "DIR")]
    pub to: Option<PathBuf>,
    /// Write a LeRobot data set (v3.0) into this new folder: as observation places and targets of the parts, mm, and
    /// the motors' root mean square in the pulse before, counts; as action the places that the planner was asked for,
    /// mm; as reward minus the parts' mean distance from their targets after it, mm
    #[arg(long, value_name = "DIR")]
    pub lerobot: Option<PathBuf>,
    /// Write positions, targets, pulses and events as MCAP, in JSON, at plate time
    #[arg(long, value_name = "FILE.mcap")]
    pub mcap: Option<PathBuf>,
}

/// Reads a pace by its name.
pub(super) fn pace() -> impl TypedValueParser<Value = Pace> {
    PossibleValuesParser::new([Pace::Max, Pace::RealTime].map(Pace::code))
        .map(|name| Pace::of_code(&name).unwrap_or_default())
}

/// Reads a guard by its code.
#[cfg(feature = "mutants")]
pub(super) fn finding(code: &str) -> Result<upm_core::job::Finding, String> {
    use upm_core::job::Finding;
    Finding::of_code(code).ok_or_else(|| format!("not one of {}", Finding::ALL.map(Finding::code).join(", ")))
}

/// `upm benchmark`.
#[derive(Args, Debug)]
pub struct BenchmarkArgs {
    /// Tasks, all of them where none is named; a wrong name lists them
    #[arg(value_name = "TASK")]
    pub tasks: Vec<String>,
    /// Seeds of each task
    #[arg(long, default_value = "1..3")]
    pub seeds: Seeds,
    /// Planner in place of the jobs'
    #[arg(long, value_name = "NAME")]
    pub planner: Option<String>,
    /// Run the rows of this file again, and compare their jobs and journals
    #[arg(long, value_name = "ROWS.jsonl", conflicts_with_all = ["tasks", "seeds", "planner"])]
    pub check: Option<PathBuf>,
}
