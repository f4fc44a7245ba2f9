#[cfg(feature = "daemon")]
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};

use super::campaign::CampaignArgs;
#[cfg(feature = "daemon")]
use super::client_args::ClientCommand;
use super::features::{HELP, VERSION};
use super::run_args::{BenchmarkArgs, ExportArgs, JobChanges, RunFolderArgs, pace};
use upm_core::job::{CameraMode, Pace};
use upm_recording::RerunMode;
use upm_runner::campaign::Seeds;
use upm_runner::config::schema_names;

/// One flat plate, shaken sideways, moves many coins on it independently, with a camera that closes the loop.
#[derive(Parser, Debug)]
#[command(name = "upm", version = VERSION.as_str(), after_help = HELP.as_str())]
#[command(max_term_width = 100, arg_required_else_help = true)]
pub struct Cli {
    /// Command to run.
    #[command(subcommand)]
    pub command: Command,
    /// Flags every command takes.
    #[command(flatten)]
    pub common: Common,
}

/// Flags every command takes.
#[derive(Args, Debug, Clone, Copy)]
pub struct Common {
    /// Print the machine-readable result alone on stdout
    #[arg(long, global = true)]
    pub json: bool,
    /// Say more: errors of forecasts and sensing in the summary of a run, and more on stderr (-vv: each cycle and its
    /// times; -vvv: libraries' messages, too)
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Say nothing on stderr but errors
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
}

/// Subcommands of `upm` with their arguments.
#[derive(Subcommand, Debug)]
pub enum Command {
    /// Write the shipped configurations into a folder: jobs, rigs, libraries, examples
    Init(InitArgs),
    /// Run one job and leave a run folder: journal, report, recording; without a file, list the jobs there are
    Run(RunArgs),
    /// Many runs of a job whose values are drawn or take several values in turn, on all cores, resumable
    Campaign(CampaignArgs),
    /// Measure what a rig can do and write its COR library
    Calibrate(CalibrateArgs),
    /// Render the first camera frame of a job, and where everything truly is
    Render(RenderArgs),
    /// Find table and parts in a picture
    Locate(LocateArgs),
    /// Open loop: given pulses on given parts, true trajectories out
    Simulate {
        /// Experiment file
        #[arg(value_name = "EXPERIMENT.json")]
        experiment: PathBuf,
    },
    /// Open a run in the Rerun viewer
    Replay(RunFolderArgs),
    /// Run a job again from its run folder alone, or those of a data set, and compare the journals byte for byte
    Verify(RunFolderArgs),
    /// Run standard tasks without pixels and print a row of figures for each run, or repeat such rows
    Benchmark(BenchmarkArgs),
    /// Write a run as tables (positions, targets, pulses, events, timings), or runs as a LeRobot data set or MCAP
    Export(ExportArgs),
    /// The daemon: jobs over HTTP, several plates, an operator page
    #[cfg(feature = "daemon")]
    Serve(ServeArgs),
    /// Validate job, rig, daemon, experiment, library, trace and coins files
    Check(CheckArgs),
    /// Print the JSON Schema of a file
    Schema {
        /// job, rig, simulate, library, trace, daemon or coins; of a run folder journal (a line of it) or report
        #[arg(value_name = "NAME", value_parser = schemas(), hide_possible_values = true)]
        name: String,
    },
    /// Commands sent to a daemon.
    #[cfg(feature = "daemon")]
    #[command(flatten)]
    Client(ClientCommand),
    /// Print completions for a shell
    Completions {
        /// Shell that is to load the completions
        #[arg(value_enum)]
        shell: clap_complete::Shell,
    },
}

impl Command {
    /// File of the timeline that is asked for.
    pub(super) fn trace(&self) -> Option<&Path> {
        match self {
            Self::Run(args) => args.trace.as_deref(),
            #[cfg(feature = "daemon")]
            Self::Serve(args) => args.trace.as_deref(),
            _ => None,
        }
    }

    /// Log format of a command that runs as a daemon; `None` for all others.
    pub(super) fn log(&self) -> Option<LogFormat> {
        match self {
            #[cfg(feature = "daemon")]
            Self::Serve(args) => Some(args.log),
            _ => None,
        }
    }
}

/// `upm init`.
#[derive(Args, Debug)]
pub struct InitArgs {
    /// Folder that they go into; the examples of the documentation run from there
    #[arg(value_name = "DIR", default_value = "upm-jobs")]
    pub folder: PathBuf,
    /// Overwrite files that were changed
    #[arg(long)]
    pub force: bool,
}

fn cameras() -> impl TypedValueParser<Value = CameraMode> {
    PossibleValuesParser::new(CameraMode::ALL.map(CameraMode::code))
        .map(|name| CameraMode::of_code(&name).unwrap_or_default())
}

/// `upm run`.
#[derive(Args, Debug)]
pub struct RunArgs {
    /// Job file, - for standard input; left out, the jobs in `configs` and here are listed
    #[arg(value_name = "JOB.json")]
    pub job: Option<PathBuf>,
    #[command(flatten)]
    pub changes: JobChanges,
    /// Seed in place of the job's
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Run the job with each of these seeds, on all cores, and print the figures of all: 1..20 (both ends included),
    /// 1,5,9
    #[arg(long, value_name = "SEEDS", conflicts_with = "seed", requires = "job")]
    pub seeds: Option<Seeds>,
    /// Folder that run folders are made in; a batch's summary.json goes there, too, and replaces that of an earlier
    /// batch [default: runs; with --seeds a new folder in it]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// As fast as possible, or no faster than the clock
    #[arg(long, value_parser = pace(), default_value = "max")]
    pub pace: Pace,
    /// Rendered pictures, or positions with the noise of a measurement in pictures: much faster
    #[arg(long, value_parser = cameras(), default_value = "pixels")]
    pub camera: CameraMode,
    /// Recording for Rerun: off, save, connect[=URL] or spawn [default: save where this build can record; with --seeds
    /// off, since a recording for each run is a lot]
    #[arg(long, value_name = "MODE", value_parser = rerun_mode)]
    pub rerun: Option<RerunMode>,
    /// Write what the camera sees as an animated GIF
    #[arg(long, value_name = "FILE.gif", conflicts_with = "seeds", requires = "job")]
    pub movie: Option<PathBuf>,
    /// Write a timeline of the program's work (job, cycles, pictures, plans, pulses), up to 64 MiB, which
    /// ui.perfetto.dev opens
    #[arg(long, value_name = "FILE.json", requires = "job")]
    pub trace: Option<PathBuf>,
    /// Faults of the simulated rig besides the job's, for example coil0:reversed@1.2 or camera:shift=3;0@0.5-2; several
    /// by comma or again
    #[arg(long, value_name = "COMPONENT:KIND[=VALUE][@FROM_S[-TO_S]]")]
    pub faults: Vec<String>,
    /// Disable one guard, to test that its absence is noticed
    #[cfg(feature = "mutants")]
    #[arg(long, value_name = "CODE", value_parser = super::run_args::finding)]
    pub without_guard: Option<upm_core::job::Finding>,
}

/// `upm serve`.
#[cfg(feature = "daemon")]
#[derive(Args, Debug)]
pub struct ServeArgs {
    /// Daemon file: plates, limits, where to listen and to keep things
    #[arg(long, value_name = "FILE.json", default_value = "configs/daemon.json")]
    pub config: PathBuf,
    /// Address and port in place of the file's; port 0 picks a free one, the one in use is the first line on stdout
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub listen: Option<SocketAddr>,
    /// Folder of job store and run folders in place of the file's
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Check everything that can be checked before a start, and start nothing; status 1 when only an address is taken
    #[arg(long)]
    pub check: bool,
    /// Write a timeline of the program's work, requests included, up to 64 MiB, which ui.perfetto.dev opens
    #[arg(long, value_name = "FILE.json")]
    pub trace: Option<PathBuf>,
    /// The log on stderr: for people, or one JSON object a line
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = LogFormat::Text)]
    pub log: LogFormat,
}

/// Log format of a daemon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// For people.
    Text,
    /// One JSON object a line.
    Json,
}

/// `upm calibrate`.
#[derive(Args, Debug)]
pub struct CalibrateArgs {
    /// Rig file
    #[arg(long, value_name = "RIG.json")]
    pub rig: PathBuf,
    /// Where the library goes
    #[arg(long, value_name = "LIBRARY.json")]
    pub out: PathBuf,
    /// Seed of noise, friction and coin places
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// `upm render`.
#[derive(Args, Debug)]
pub struct RenderArgs {
    /// Job file
    #[arg(value_name = "JOB.json")]
    pub job: PathBuf,
    /// Where the picture goes (png, jpg, pgm, tiff)
    #[arg(long, value_name = "FRAME.png")]
    pub out: PathBuf,
    /// Where the truth goes: corners and parts
    #[arg(long, value_name = "TRUTH.json")]
    pub truth: Option<PathBuf>,
    /// Seed in place of the job's
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
}

/// `upm locate`.
#[derive(Args, Debug)]
pub struct LocateArgs {
    /// Pictures: PNG, JPEG, BMP, PNM or TIFF, gray or colour, 8 or 16 bits
    #[arg(value_name = "IMAGE", required = true)]
    pub images: Vec<PathBuf>,
    /// Rig file with plate, kinds and lens
    #[arg(long, value_name = "RIG.json")]
    pub rig: Option<PathBuf>,
    /// Round parts that there are: us, eu, uk, jp or a file like configs/coins/eu.json
    #[arg(long, value_name = "SET", default_value = "us", conflicts_with = "rig")]
    pub coins: String,
    /// Kinds to look for. Without it all of the set or the rig
    #[arg(long, value_name = "KIND,...", value_delimiter = ',')]
    pub kinds: Vec<String>,
    /// Side of the square plate, mm [default: derived from the sizes of two kinds of parts, else 203.2]
    #[arg(long, value_name = "MM", conflicts_with = "rig", allow_negative_numbers = true)]
    pub plate_side_mm: Option<f64>,
    /// The plate is a rectangle of these sides, mm, as 297x210
    #[arg(long, value_name = "WxH", conflicts_with_all = ["rig", "plate_side_mm"])]
    pub rectangle: Option<String>,
    /// Corners of the plate in the picture, px, one after the other around it
    #[arg(long, value_name = "X,Y", num_args = 4)]
    pub corners: Option<Vec<String>>,
    /// The plane of the parts: the plate that is found, or the whole picture, taken from straight above
    #[arg(long, value_enum, default_value = "found", conflicts_with_all = ["corners", "rectangle", "rig", "plate_side_mm"])]
    pub plate: PlateInPicture,
    /// Scale of the picture in the middle of the plane, as 12.3px/mm
    #[arg(long, value_name = "SCALE", conflicts_with_all = ["rig", "plate_side_mm", "rectangle"])]
    pub scale: Option<String>,
    /// One part that gives the scale: its kind, and its place in the picture, px, as quarter@812,440
    #[arg(long, value_name = "KIND[@X,Y]", conflicts_with_all = ["rig", "plate_side_mm", "rectangle", "scale"])]
    pub scale_from: Option<String>,
    /// Draw plate, parts and other discs over each picture, into this folder
    #[arg(long, value_name = "DIR")]
    pub overlay: Option<PathBuf>,
}

/// Where the plane of the parts is in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum PlateInPicture {
    /// A plate with four sides in view
    Found,
    /// Everywhere
    Whole,
}

/// Reads a recording mode; refuses one whose recordings cannot be made.
fn rerun_mode(text: &str) -> Result<RerunMode, String> {
    let mode: RerunMode = text.parse()?;
    upm_viewer::RerunSink::check(&mode).map_err(|error| error.to_string())?;
    Ok(mode)
}

/// `upm check`.
#[derive(Args, Debug)]
#[command(
    after_help = "Of a COR library it tells what is covered: where the centres of rotation lie, how far one pulse moves a \
                  part in the direction in which it moves it least, and where some direction cannot be reached.\n\n\
                  With --plan it makes five dry runs of a job on all cores: runs from the same start places, with \
                  successive seeds and with --camera positions. All their figures are predictions. Exit status 1 when most dry runs fail."
)]
pub struct CheckArgs {
    /// Files to validate: jobs, rigs, daemons, experiments, COR libraries, traces, coins; - for standard input
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<PathBuf>,
    /// Rig to check jobs on in place of their own, and that libraries must have been measured on
    #[arg(long, value_name = "RIG.json")]
    pub rig: Option<PathBuf>,
    /// Report for each job whether its library can do it, how long that takes and where it is hard
    #[arg(long)]
    pub plan: bool,
    /// With --plan, the first seed in place of the job's
    #[arg(long, value_name = "N", requires = "plan")]
    pub seed: Option<u64>,
    /// With --plan, a dry run for each of these seeds: 1..20 (both ends included), 1,5,9
    #[arg(long, value_name = "SEEDS", conflicts_with = "seed", requires = "plan")]
    pub seeds: Option<Seeds>,
    /// Draw the coverage of the one library given as a map; with --plan the predicted paths of the one job's parts
    #[arg(long, value_name = "MAP.svg")]
    pub picture: Option<PathBuf>,
}

/// The names of schemas: those of files, and of the files of a run folder.
fn schemas() -> PossibleValuesParser {
    PossibleValuesParser::new(schema_names().iter().copied().chain(["journal", "report"]))
}

#[cfg(all(test, feature = "daemon"))]
mod tests {
    use std::path::Path;

    use super::*;

    /// The command line of the shipped unit is one that this program takes.
    #[test]
    fn the_shipped_unit_starts_the_daemon() {
        let unit = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/systemd/upm.service");
        let unit = std::fs::read_to_string(unit).unwrap();
        let of = |key: &str| unit.lines().filter_map(|line| line.strip_prefix(key)).collect::<Vec<_>>();
        let started = of("ExecStart=");
        assert_eq!(started.len(), 1);
        let cli = Cli::try_parse_from(started[0].replace("%S", "/var/lib").split_whitespace()).unwrap();
        assert_eq!(cli.command.log(), Some(LogFormat::Text));
        let Command::Serve(args) = cli.command else { panic!("{started:?}") };
        assert_eq!(args.data.as_deref(), Some(Path::new("/var/lib/upm")));
        assert_eq!([of("Type="), of("NotifyAccess="), of("StateDirectory=")], [["notify"], ["main"], ["upm"]]);
    }
}
