use std::path::Path;
use std::sync::atomic::Ordering;

use serde_json::{Value, json};

use super::args::Common;
use super::export::{differing_files, episodes_in};
use super::output::{Failure, INTERRUPTED, NOT_REACHED, print, stop_on_interrupt};
use super::progress::{LateProgress, RunProgress};
use super::run_args::RunFolderArgs;
use super::run_folder::run_folder;
use upm_runner::run::{Extent, PacingStats, Verification, maker, maker_of, verify as verify_run};

/// Most characters shown of a line that differs.
const SHOWN: usize = 160;

pub(super) fn verify(args: &RunFolderArgs, common: Common) -> Result<u8, Failure> {
    let folder = run_folder(args)?;
    let episodes = episodes_in(&folder);
    let is_set = !episodes.is_empty();
    let runs = if is_set { episodes } else { vec![folder.clone()] };
    let stop = stop_on_interrupt();
    // at full speed: the repetition has no clock to keep up with
    let pacing = PacingStats::default();
    let mut progress = RunProgress::new(common, &pacing);
    let until_stop = runs.iter().take_while(|_| !stop.load(Ordering::Relaxed));
    let verdicts = until_stop.map(|run| verify_run(run, &stop, &mut progress)).collect::<Result<Vec<_>, _>>();
    progress.finish();
    if stop.load(Ordering::Relaxed) {
        return Ok(INTERRUPTED);
    }
    let verdicts = verdicts?;
    let mut progress = LateProgress::new(common);
    let show = |done, run: &Path| progress.show(done, || run.display().to_string());
    let differ = if is_set { differing_files(&folder, show)? } else { Vec::new() };
    progress.finish();
    let are_equal = verdicts.iter().all(|verdict| matches!(verdict, Verification::Equal { .. })) && differ.is_empty();
    let told: Value = runs.iter().zip(&verdicts).map(|(run, verdict)| as_json(run, verdict)).collect();
    let of_set = json!({ "equal": are_equal, "episodes": told, "files_that_differ": differ });
    print(common.json, if is_set { &of_set } else { &told[0] }, || {
        runs.iter().zip(&verdicts).try_for_each(|(run, verdict)| print_verdict(run, verdict))?;
        differ.iter().try_for_each(|file| outln!("{file}: differs from what the episodes give"))?;
        let (set, count) = (folder.display(), runs.len());
        if is_set && are_equal { outln!("{set}: {count} episodes and all files are equal") } else { Ok(()) }
    })?;
    Ok(if are_equal { 0 } else { NOT_REACHED })
}

fn as_json(run: &Path, verdict: &Verification) -> Value {
    let mut told = match verdict {
        Verification::Equal { lines, extent } => {
            let [stopped, killed] = [Extent::Stopped, Extent::Killed].map(|of| of == *extent);
            json!({ "equal": true, "lines": lines, "stopped": stopped, "killed": killed })
        }
        Verification::LineEnds => json!({ "equal": false, "line_ends": true }),
        Verification::Differs { line, key, recorded, repeated } => {
            let key = key.as_ref().map(|(key, _)| key);
            json!({ "equal": false, "line": line, "key": key, "recorded": recorded, "repeated": repeated })
        }
    };
    (told["made_by"], told["this"]) = (maker_of(run).into(), maker().into());
    told
}

fn print_verdict(run: &Path, verdict: &Verification) -> Result<(), Failure> {
    let (made_by, this, run) = (maker_of(run), maker(), run.display());
    match verdict {
        Verification::Equal { lines, extent: Extent::Whole } => {
            outln!("{run}: the repetition's journal is equal byte for byte, {lines} lines")
        }
        Verification::Equal { lines, extent: Extent::Stopped } => {
            outln!("{run}: stopped from outside; equal byte for byte up to there, {lines} lines")
        }
        Verification::Equal { lines, extent: Extent::Killed } => {
            let how_far = format!("equal byte for byte as far as it goes, {lines} lines");
            outln!("{run}: no report, so it was killed or still runs; {how_far}")
        }
        Verification::LineEnds => {
            outln!("{run}: journals are equal but for their line ends, which something changed to CR LF")
        }
        Verification::Differs { line, key, recorded, repeated } => {
            if let Some(other) = made_by.filter(|made_by| *made_by != this) {
                outln!("{run}: made by {other}; this is {this}")?;
            }
            outln!("{run}: journals differ from line {line} on")?;
            if let Some((key, [recorded, repeated])) = key {
                outln!("  first in {key}: recorded {recorded}, repeated {repeated}")?;
            }
            outln!("  recorded: {}", shown(recorded))?;
            outln!("  repeated: {}", shown(repeated))
        }
    }
}

fn shown(line: &str) -> String {
    line.chars().take(SHOWN).collect()
}
