//! Arguments of the commands on run folders and token files.

use std::path::PathBuf;

use clap::Args;

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
    after_help = "Tables: positions, targets and pulses come from the journal, timings from the report. Columns carry \
                        their unit; a value that the run does not have is empty."
)]
pub struct ExportArgs {
    #[command(flatten)]
    pub run: RunFolderArgs,
    /// Write each table as comma-separated values: positions.csv, targets.csv, pulses.csv, timings.csv
    #[arg(long)]
    pub csv: bool,
    /// Write each table as Apache Parquet: positions.parquet and so on
    #[arg(long)]
    pub parquet: bool,
    /// Folder that the tables go into [default: RUN-tables beside the run folder]
    #[arg(long, value_name = "DIR")]
    pub to: Option<PathBuf>,
}

/// `upm token`.
#[derive(Args, Debug)]
#[command(
    after_help = "The file holds 64 random hex digits and is for its owner alone (mode 0600). A daemon reads it as \
                        token_file, or as read_token_file for clients that may only look, and stop; its clients read it by \
                        --token-file or UPM_TOKEN_FILE. The token itself is never printed."
)]
pub struct TokenArgs {
    /// New file for the token
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
}
