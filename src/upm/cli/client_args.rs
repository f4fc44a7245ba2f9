use std::path::PathBuf;

use clap::builder::PossibleValuesParser;
use clap::{Args, Subcommand};

use super::run_args::pace;
use upm_core::job::Pace;
use upm_server::states::JobState;

/// Commands sent to a daemon.
#[derive(Subcommand, Debug)]
pub enum ClientCommand {
    /// Daemon: queue a job; prints the end of its id
    Submit(SubmitArgs),
    /// Daemon: list jobs, newest first
    Jobs(JobsArgs),
    /// Daemon: a job and what became of it
    Show(JobArgs),
    /// Daemon: follow a job until it ends
    Watch(JobArgs),
    /// Daemon: run a queued job before the others of its plate
    RunNext(JobArgs),
    /// Daemon: take a job out of the queue, or stop it
    Cancel(JobArgs),
    /// Daemon: all plates as they are
    Plates(DaemonArgs),
    /// Daemon: emergency stop, held until a reset; without a name all plates
    Estop(EstopArgs),
    /// Daemon: end an emergency stop; the plate stays paused
    Reset(ResetArgs),
    /// Daemon: let a paused plate go on with its queue, and a paused standing job start
    Resume(ResumeArgs),
}

/// How to reach the daemon.
#[derive(Args, Debug, Clone, Default)]
pub struct DaemonArgs {
    /// Address of the daemon [default: UPM_URL, else http://127.0.0.1:8750]
    #[arg(long, value_name = "URL")]
    pub url: Option<String>,
    /// File that holds the token, where the daemon asks for one [default: UPM_TOKEN_FILE]
    #[arg(long, value_name = "FILE")]
    pub token_file: Option<PathBuf>,
}

/// `upm submit`.
#[derive(Args, Debug)]
#[command(after_help = "Exit status with --watch: 0 completed; 1 failed, cancelled or interrupted; 130 when Ctrl-C \
                        ended the watching (the job goes on).")]
pub struct SubmitArgs {
    /// Job file. Without a rig in it the plate's own applies; with one it must be the plate's
    #[arg(value_name = "JOB.json")]
    pub job: PathBuf,
    /// Plate to run on, in place of the job's
    #[arg(long, value_name = "NAME")]
    pub plate: Option<String>,
    /// As fast as possible, or no faster than the clock [default: as the daemon is set up]
    #[arg(long, value_parser = pace())]
    pub pace: Option<Pace>,
    /// Idempotency key: the same key and job again give the same job [default: a new one each time]
    #[arg(long, value_name = "KEY")]
    pub key: Option<String>,
    /// Seed in place of the job's
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Follow the job until it ends
    #[arg(long)]
    pub watch: bool,
    #[command(flatten)]
    pub daemon: DaemonArgs,
}

/// `upm jobs`.
#[derive(Args, Debug)]
pub struct JobsArgs {
    /// Only jobs in this state
    #[arg(long, value_name = "STATE", value_parser = PossibleValuesParser::new(JobState::ALL.map(JobState::code)))]
    pub state: Option<String>,
    /// Most jobs listed
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..))]
    pub limit: u32,
    /// List them all
    #[arg(long, conflicts_with = "limit")]
    pub all: bool,
    #[command(flatten)]
    pub daemon: DaemonArgs,
}

/// Commands on one job.
#[derive(Args, Debug)]
pub struct JobArgs {
    /// Id of the job, as `upm submit` and `upm jobs` print it; more or fewer digits of its beginning or ending will do,
    /// while they are unique. Or the job's name, for the newest of that name, or last, for the last that was submitted
    #[arg(value_name = "ID")]
    pub id: String,
    #[command(flatten)]
    pub daemon: DaemonArgs,
}

/// `upm estop`.
#[derive(Args, Debug)]
#[command(
    after_help = "A daemon on this machine is asked through the socket DATA/estop.sock first, past its HTTP server and any \
                  token; only the user that runs it, and root, may write there. Without --data and UPM_DATA it is looked \
                  for in /var/lib/upm and in the data folder of configs/daemon.json when the URL is on this machine, and \
                  only the daemon on the URL's port answers. Where no socket answers, the request goes over HTTP.\n\n\
                  Without this command: echo | socat - UNIX-CONNECT:DATA/estop.sock, or SIGUSR1 to the daemon. Both stop \
                  every plate.\n\n\
                  Exit status: 0 when every plate's motors were seen silent and the stop is on the disk; 1 when one of \
                  both is not so, or no daemon was reached; 2 for a plate that does not exist."
)]
pub struct EstopArgs {
    /// Plates to stop; left out, all
    #[arg(value_name = "PLATE")]
    pub plates: Vec<String>,
    /// Data folder of the daemon on this machine [default: UPM_DATA]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Address of the daemon's `stop_listen`, asked before --url to stop all plates [default: UPM_STOP_URL]
    #[arg(long, value_name = "URL", conflicts_with = "plates")]
    pub stop_url: Option<String>,
    #[command(flatten)]
    pub daemon: DaemonArgs,
}

/// `upm reset`.
#[derive(Args, Debug)]
pub struct ResetArgs {
    /// Plate that was stopped
    #[arg(value_name = "PLATE")]
    pub plate: String,
    /// Operator who inspected the plate
    #[arg(long, value_name = "NAME")]
    pub operator: String,
    /// Why it may move again
    #[arg(long, value_name = "TEXT")]
    pub reason: String,
    #[command(flatten)]
    pub daemon: DaemonArgs,
}

/// `upm resume`.
#[derive(Args, Debug)]
pub struct ResumeArgs {
    /// Name of the plate
    #[arg(value_name = "PLATE")]
    pub plate: String,
    /// Operator who looked at the plate, for log and audit log [default: USER]
    #[arg(long, value_name = "NAME")]
    pub operator: Option<String>,
    #[command(flatten)]
    pub daemon: DaemonArgs,
}
