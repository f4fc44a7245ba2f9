use std::collections::HashMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::json;

use super::args::{CampaignArgs, USUAL_SHARDS};
use super::progress::CampaignProgress;
use crate::cli::args::Common;
use crate::cli::output::{Failure, INTERRUPTED, print};
use upm_runner::campaign::{Campaign, CampaignFolder, CampaignRunner, FolderFacts, Pairs, PairsVerdict, RunLine};

/// Pairs that are made before they are looked at; those after the one that decides are not counted.
const BATCH: usize = 64;

/// Makes the runs of `campaign` and of another one in pairs until they are told apart, or found equal.
pub(super) fn against(
    campaign: &Campaign,
    other: &str,
    (args, out): (&CampaignArgs, &Path),
    common: Common,
    stop: &AtomicBool,
) -> Result<u8, Failure> {
    let file = args.file.as_deref().unwrap_or(Path::new("-"));
    let program = Path::new(other).is_file().then(|| Path::new(other));
    let changed = match program {
        Some(_) => campaign.clone(),
        None => args.campaign(Some(other))?,
    };
    let open = |campaign: &Campaign, name: &str| {
        let facts = FolderFacts::of(campaign, USUAL_SHARDS, args.judge.as_deref());
        CampaignFolder::open_or_create(&out.join(name), facts)
    };
    let this = open(campaign, "this")?;
    let range = args.runs_of(campaign.runs())?;
    let progress = CampaignProgress::new(&this.facts, 2 * range.len(), common);
    let (mut pairs, mut done) = (Pairs::new(args.tells), range.start);
    while done < range.end && pairs.verdict == PairsVerdict::Open && !stop.load(Ordering::Relaxed) {
        let batch = done..(done + BATCH).min(range.end);
        let make = |runner: CampaignRunner<'_>| runner.run(0..USUAL_SHARDS, batch.clone(), &|line| progress.show(line));
        make(args.runner(campaign, &this, stop))?;
        let those = match program {
            None => {
                let folder = open(&changed, "other")?;
                make(args.runner(&changed, &folder, stop))?;
                folder
            }
            Some(program) => {
                by_program(program, file, &out.join("other"), (batch.start + 1, batch.end), args)?;
                batch.clone().for_each(|_| progress.show(None));
                CampaignFolder::open(&out.join("other"))?
            }
        };
        let [ours, theirs] = [&this, &those].map(|folder| lines(folder, &batch));
        let (ours, theirs) = (ours?, theirs?);
        for run in batch.clone() {
            let Some((ours, theirs)) = ours.get(&run).zip(theirs.get(&run)) else { break };
            pairs.add(ours, theirs);
        }
        done = batch.end;
    }
    progress.finish();
    if stop.load(Ordering::Relaxed) {
        return Ok(INTERRUPTED);
    }
    shown(&pairs, other, args.tells, common)
}

/// Runs of these numbers, from 1, by another program.
fn by_program(
    program: &Path,
    file: &Path,
    out: &Path,
    (first, last): (usize, usize),
    args: &CampaignArgs,
) -> Result<(), Failure> {
    let mut command = Command::new(program);
    command.arg("campaign").arg(file).args(args.set.iter().flat_map(|set| ["--set", set]));
    command.args(args.judge.iter().flat_map(|judge| ["--judge", judge]));
    command.args(args.jobs.iter().flat_map(|jobs| ["--jobs".to_owned(), jobs.to_string()]));
    command.args(["--runs", &format!("{first}..{last}")]);
    let started = command.arg("--out").arg(out).arg("--quiet").stdin(Stdio::null()).stdout(Stdio::null()).status();
    let status = started.map_err(|error| Failure::read_failed(program, &error))?;
    // 1 is for runs without success
    if matches!(status.code(), Some(0 | 1)) {
        return Ok(());
    }
    Err(Failure::failed(format!("--against: {} ended with {status}", program.display())))
}

/// The lines of these runs, by their numbers from 0.
fn lines(folder: &CampaignFolder, range: &std::ops::Range<usize>) -> Result<HashMap<usize, RunLine>, Failure> {
    let meets = |shard: &usize| {
        let runs = folder.facts.runs_of(*shard);
        runs.start < range.end && range.start < runs.end
    };
    let mut found = HashMap::new();
    for shard in (0..folder.facts.shards).filter(meets) {
        let (lines, _) = folder.lines_of(shard, &[])?;
        found.extend(lines.into_iter().map(|line| (line.run - 1, line)));
    }
    Ok(found)
}

fn shown(pairs: &Pairs, other: &str, tells: f64, common: Common) -> Result<u8, Failure> {
    let ratio = pairs.mean_log_ratio();
    let share = |log: f64| 100.0 * (libm::exp(log) - 1.0);
    let told = json!({ "against": other, "tells": tells, "pairs": pairs, "mean_log_ratio": ratio });
    print(common.json, &told, || {
        let verdict = match pairs.verdict {
            PairsVerdict::Open => format!("not told from this one by {} pairs", pairs.pairs),
            PairsVerdict::Slower => "takes longer".into(),
            PairsVerdict::Faster => "takes less time".into(),
            PairsVerdict::Equal => format!("takes as long, within {:.1} %", 100.0 * tells),
            PairsVerdict::MoreSuccess => "succeeds more often".into(),
            PairsVerdict::LessSuccess => "succeeds less often".into(),
        };
        outln!("{other}: {verdict}")?;
        let Pairs { pairs, both, other_alone, this_alone, .. } = pairs;
        outln!("  {pairs} pairs; both succeed in {both}, it alone in {other_alone}, this one alone in {this_alone}")?;
        let Some(ratio) = ratio else { return Ok(()) };
        let [mean, low, high] = [ratio.value, ratio.low, ratio.high].map(share);
        outln!("  its plate time is {mean:+.1} % (95 %: {low:+.1} to {high:+.1}), by the mean of its logarithms")
    })
}
