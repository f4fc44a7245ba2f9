//! Arguments of `upm campaign`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};

#[cfg(feature = "mutants")]
use crate::cli::run_args::finding;
use upm_runner::campaign::{Keep, MOST_SHARDS};

/// Shards of a campaign where none are asked for: tasks for as many workers as most have.
pub(super) const USUAL_SHARDS: usize = 64;

/// `upm campaign`.
#[derive(Args, Debug)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "The folder is the only state: a line for each run. The same command goes on where an earlier one was \
                  ended. Exit status 1 when a run is without success."
)]
pub struct CampaignArgs {
    /// Sum up folders instead
    #[command(subcommand)]
    pub command: Option<CampaignCommand>,
    /// Campaign file, - for standard input
    #[arg(value_name = "CAMPAIGN.json", required = true)]
    pub file: Option<PathBuf>,
    /// Value in place of the jobs', as planner=cor_sequence or limits.plate_time_s=30; several by --set again
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Folder of the results [default: campaigns/NAME]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// One shard of the runs alone, as 3/64, for engines that make a task of each
    #[arg(long, value_name = "I/N", value_parser = shard, conflicts_with_all = ["runs", "against"])]
    pub shard: Option<(usize, usize)>,
    /// Runs of these numbers alone, as 17 or 1..100
    #[arg(long, value_name = "FIRST..LAST", value_parser = range)]
    pub runs: Option<(usize, usize)>,
    /// Runs at once [default: as many as there are cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Run folders that stay
    #[arg(long, value_name = "WHICH", default_value = Keep::Nothing.code(), value_parser = keep())]
    pub keep: Keep,
    /// Largest size of all run folders that stay, MB
    #[arg(long, value_name = "MB", default_value_t = 1000)]
    pub keep_mb: u64,
    /// Command that judges runs: it reads the path of a run folder a line, and answers with a line
    /// {"violations": ["what is wrong"]}; a run without violations is a success
    #[arg(long, value_name = "COMMAND")]
    pub judge: Option<String>,
    /// Compare with the same runs changed, until one is told apart: a change as of --set or camera=pixels, or the path
    /// of another program
    #[arg(long, value_name = "CHANGE")]
    pub against: Option<String>,
    /// With --against, the share of plate time that is to be told
    #[arg(long, value_name = "SHARE", default_value = "0.03", value_parser = share, requires = "against")]
    pub tells: f64,
    /// Switch off a guard, to see that it is missed
    #[cfg(feature = "mutants")]
    #[arg(long, value_name = "CODE", value_parser = finding)]
    pub without_guard: Option<upm_core::job::Finding>,
}

/// Subcommands of `upm campaign`.
#[derive(Subcommand, Debug)]
pub enum CampaignCommand {
    /// Sum up folders of a campaign: table, summary.json, runs.parquet and a plot of plate times in the first one
    Merge {
        /// Folders of one campaign
        #[arg(value_name = "DIR", required = true)]
        folders: Vec<PathBuf>,
        /// Exit with status 1 if there are not so many runs
        #[arg(long, value_name = "N")]
        expect: Option<usize>,
    },
}

/// Reads which run folders stay, by name.
fn keep() -> impl TypedValueParser<Value = Keep> {
    PossibleValuesParser::new(Keep::ALL.map(Keep::code)).map(|name| Keep::of_code(&name).unwrap_or_default())
}

/// Two numbers with `between` between them.
fn pair(text: &str, between: &str) -> Option<(usize, usize)> {
    let (first, second) = text.split_once(between)?;
    Some((usize::from_str(first).ok()?, usize::from_str(second).ok()?))
}

fn shard(text: &str) -> Result<(usize, usize), String> {
    let found = pair(text, "/").filter(|&(shard, all)| (1..=all).contains(&shard) && all <= MOST_SHARDS);
    let (shard, all) = found.ok_or(format!("expected I/N with I from 1 to N and N up to {MOST_SHARDS}"))?;
    Ok((shard - 1, all))
}

fn range(text: &str) -> Result<(usize, usize), String> {
    let one = || usize::from_str(text).ok().map(|run| (run, run));
    let found = one().or_else(|| pair(text, "..")).filter(|(first, last)| first <= last);
    found.ok_or("expected a number or FIRST..LAST".into())
}

fn share(text: &str) -> Result<f64, String> {
    let found = f64::from_str(text).ok().filter(|share| (0.001..=1.0).contains(share));
    found.ok_or("expected 0.001 to 1".into())
}
