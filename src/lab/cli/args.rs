use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

/// Experiments of the papers on the simulated plate and on their other machines: a table, plots; without a name they
/// are listed.
#[derive(Parser, Debug)]
#[command(name = "upm-lab", version, max_term_width = 100, args_conflicts_with_subcommands = true)]
pub struct Cli {
    /// Command besides the experiments.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Experiment to run.
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    /// Print the machine-readable result alone on stdout
    #[arg(long, global = true)]
    pub json: bool,
    /// Say nothing on stderr but errors
    #[arg(short, long, global = true)]
    pub quiet: bool,
}

/// Commands besides the experiments.
#[derive(Subcommand, Debug)]
pub enum Command {
    /// Draw a scene of plate and parts, with its truth
    Scene(SceneArgs),
    /// Find table and parts in a picture by the textbook: Canny, Hough and template matching; slow, for comparison
    Locate(LocateArgs),
}

/// Options of an experiment.
#[derive(Args, Debug)]
pub struct ExperimentArgs {
    /// Which one, or `all` of them; left out, they are listed
    #[arg(value_name = "EXPERIMENT")]
    pub name: Option<String>,
    /// Rig file; without it the shipped upm-1, or upm-2 where the weak upm-1 cannot show it
    #[arg(long, value_name = "RIG.json")]
    pub rig: Option<PathBuf>,
    /// Seed of noise and sensor errors
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Read this recorded trace in place of playing a pulse (waveform-fit alone)
    #[arg(long, value_name = "TRACE.json", requires = "name", conflicts_with_all = ["rig", "seed"])]
    pub trace: Option<PathBuf>,
    /// Scenes of each family, of as many seeds from --seed on (vision alone) [default: 50]
    #[arg(long, value_name = "N", requires = "name", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub scenes: Option<u32>,
    /// Set a parameter and measure that one machine; any number of times. --settings lists the parameters
    #[arg(long, value_name = "KEY=VALUE", requires = "name", conflicts_with = "trace")]
    pub set: Vec<String>,
    /// Measure at so many evenly spaced values of one parameter, all cores at once
    #[arg(long, value_name = "KEY=FROM:TO:POINTS", requires = "name", conflicts_with = "trace")]
    pub sweep: Option<String>,
    /// List what --set and --sweep take
    #[arg(long, requires = "name", conflicts_with_all = ["set", "sweep", "trace"])]
    pub settings: bool,
    /// Folder that plots go into
    #[arg(long, value_name = "DIR", default_value = "runs/lab")]
    pub out: PathBuf,
}

/// `upm-lab scene`.
#[derive(Args, Debug)]
pub struct SceneArgs {
    /// Family: clean, rough, hard or papers
    #[arg(value_name = "FAMILY")]
    pub family: String,
    /// Seed of everything in it
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Where the picture goes (png, jpg, pgm, tiff)
    #[arg(long, value_name = "FRAME.png")]
    pub out: PathBuf,
    /// Where the truth goes: corners and parts
    #[arg(long, value_name = "TRUTH.json")]
    pub truth: Option<PathBuf>,
    /// Where a rig file goes that has the scene's camera and plate, for `upm locate --rig`
    #[arg(long, value_name = "RIG.json")]
    pub rig_out: Option<PathBuf>,
}

/// `upm-lab locate`.
#[derive(Args, Debug)]
pub struct LocateArgs {
    /// Picture: PNG, JPEG, PNM or TIFF
    #[arg(value_name = "IMAGE")]
    pub image: PathBuf,
    /// Rig file; without it coins on a plate of 203.2 mm, no lens distortion
    #[arg(long, value_name = "RIG.json")]
    pub rig: Option<PathBuf>,
    /// Kinds to look for. Without it all of them
    #[arg(long, value_name = "KIND,...", value_delimiter = ',')]
    pub kinds: Vec<String>,
    /// Find them by the vision of the control loop instead, this many times; times are medians without the first
    #[arg(long, value_name = "TIMES", value_parser = clap::value_parser!(u32).range(2..=1_000))]
    pub fast: Option<u32>,
}
