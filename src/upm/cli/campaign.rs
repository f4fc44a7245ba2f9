//! `upm campaign`: many runs of a job with draws, into a folder that resumes them; `upm run --seeds`, which is one of
//! one job; the summary of such folders.

mod against;
mod args;
mod merge;
mod progress;
mod table;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::json;

use super::args::{Common, RunArgs};
use super::job_changes::{change, read_dash};
use super::output::{BAD_INPUT, Failure, INTERRUPTED, print, stop_on_interrupt};
use super::run::{USUAL_OUT, load_job, utc_now};
use args::USUAL_SHARDS;
pub use args::{CampaignArgs, CampaignCommand};
use progress::CampaignProgress;
use upm_core::job::Pace;
use upm_recording::RerunMode;
use upm_runner::campaign::{Campaign, CampaignFolder, CampaignRunner, FolderFacts, Keep, Seeds};
use upm_runner::config::{Origin, text_of};
use upm_runner::run::library_and_places;

/// Default folder of campaigns.
const USUAL_CAMPAIGNS: &str = "campaigns";

/// Runs a campaign, or one of its shards, or sums up folders of one.
pub(super) fn campaign(args: &CampaignArgs, common: Common) -> Result<u8, Failure> {
    if let Some(CampaignCommand::Merge { folders, expect }) = &args.command {
        return merge::merge(folders, *expect, common);
    }
    let file = args.file.as_deref().unwrap_or(Path::new("-"));
    read_dash([file])?;
    let campaign = args.campaign(None)?;
    let out = args.out.clone().unwrap_or_else(|| Path::new(USUAL_CAMPAIGNS).join(&campaign.name));
    let stop = stop_on_interrupt();
    if let Some(other) = &args.against {
        return against::against(&campaign, other, (args, &out), common, &stop);
    }
    let (shard, shards) = args.shard.map_or((None, USUAL_SHARDS), |(shard, shards)| (Some(shard), shards));
    let facts = FolderFacts::of(&campaign, shards, args.judge.as_deref());
    let folder = CampaignFolder::open_or_create(&out, facts)?;
    let range = args.runs_of(campaign.runs())?;
    let runner = CampaignRunner { folder: &folder, ..args.runner(&campaign, &folder, &stop) };
    made(&runner, shard.map_or(0..shards, |shard| shard..shard + 1), range, common)?;
    if stop.load(Ordering::Relaxed) {
        if !common.quiet {
            errln!("upm: ended early; the same command goes on with what is left");
        }
        return Ok(INTERRUPTED);
    }
    match shard {
        Some(shard) => {
            let runs = folder.facts.runs_of(shard).len();
            print(common.json, &json!({ "shard": shard + 1, "shards": shards, "runs": runs }), || Ok(()))
        }
        None => merge::merged(&[folder], None, common),
    }
}

/// Makes runs, with progress on stderr.
fn made(
    runner: &CampaignRunner<'_>,
    shards: std::ops::Range<usize>,
    range: std::ops::Range<usize>,
    common: Common,
) -> Result<(), Failure> {
    let of = |shard| {
        let runs = runner.folder.facts.runs_of(shard);
        runs.end.min(range.end).saturating_sub(runs.start.max(range.start))
    };
    let progress = CampaignProgress::new(&runner.folder.facts, shards.clone().map(of).sum(), common);
    let done = runner.run(shards, range, &|line| progress.show(line));
    progress.finish();
    // what is there stays whole: a full disk is no end of the campaign
    done.map_err(|error| Failure { status: BAD_INPUT, ..error.into() })
}

/// Runs the job in `file` with each of the seeds that `--seeds` names, and keeps all run folders.
pub(super) fn of_seeds(file: &Path, seeds: &Seeds, args: &RunArgs, common: Common) -> Result<u8, Failure> {
    let rerun = args.rerun.clone().unwrap_or(RerunMode::Off);
    if !matches!(rerun, RerunMode::Off | RerunMode::Save) {
        // many runs at once would be unreadable in a viewer
        return Err(Failure::bad_input(format!("--rerun: expected off or save (with --seeds), found {rerun}")));
    }
    if args.pace == Pace::RealTime {
        // runs that share the cores cannot keep it
        let found = args.pace.code();
        return Err(Failure::bad_input(format!("--pace: expected max (with --seeds), found {found}")));
    }
    let job = load_job(file, args)?;
    library_and_places(&job).map_err(Failure::faults)?;
    let name = &job.name[..job.name.floor_char_boundary(200)];
    let in_usual = || Path::new(USUAL_OUT).join(format!("{name}-seeds-{}", utc_now()));
    let out: PathBuf = args.out.clone().unwrap_or_else(in_usual);
    let campaign = Campaign::of_job(&job.name, job.effective(), Origin::of_file(file), seeds, job.camera);
    let facts = FolderFacts::of(&campaign, 1, None);
    let folder = CampaignFolder::open_or_create(&out, facts)?;
    let stop = stop_on_interrupt();
    let runner = CampaignRunner {
        campaign: &campaign,
        folder: &folder,
        threads: 0,
        keep: Keep::All,
        rerun,
        most_kept_bytes: u64::MAX,
        judge: None,
        without_guard: job.without_guard,
        stop: &stop,
    };
    made(&runner, 0..1, 0..campaign.runs(), common)?;
    let status = merge::merged(&[folder], None, common)?;
    Ok(if stop.load(Ordering::Relaxed) { INTERRUPTED } else { status })
}

impl CampaignArgs {
    /// The campaign with the changes of the command line and one more.
    fn campaign(&self, more: Option<&str>) -> Result<Campaign, Failure> {
        let file = self.file.as_deref().unwrap_or(Path::new("-"));
        let set = self.set.iter().map(|text| change("--set", text));
        let changes = set.chain(more.map(|text| change("--against", text))).collect::<Result<Vec<_>, _>>()?;
        let text = text_of(file).map_err(Failure::of_files)?;
        Campaign::from_json(&text, &Origin::of_file(file), &changes).map_err(Failure::of_files)
    }

    /// How the runs of `campaign` are made into `folder`.
    fn runner<'a>(
        &'a self,
        campaign: &'a Campaign,
        folder: &'a CampaignFolder,
        stop: &'a AtomicBool,
    ) -> CampaignRunner<'a> {
        CampaignRunner {
            campaign,
            folder,
            threads: self.jobs.map_or(0, usize::from),
            keep: self.keep,
            rerun: RerunMode::Off,
            most_kept_bytes: self.keep_mb.saturating_mul(1_000_000),
            judge: self.judge.as_deref(),
            #[cfg(feature = "mutants")]
            without_guard: self.without_guard,
            #[cfg(not(feature = "mutants"))]
            without_guard: None,
            stop,
        }
    }

    /// Numbers, from 0, of the runs that are asked for.
    fn runs_of(&self, all: usize) -> Result<std::ops::Range<usize>, Failure> {
        let (first, last) = self.runs.unwrap_or((1, all));
        if (1..=all).contains(&first) && last <= all {
            return Ok(first - 1..last);
        }
        Err(Failure::bad_input(format!("--runs: expected numbers from 1 to {all}, found {first}..{last}")))
    }
}
