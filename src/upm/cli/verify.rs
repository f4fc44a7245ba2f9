use std::path::Path;

use serde_json::{Value, json};

use super::args::Common;
use super::output::{Failure, INTERRUPTED, NOT_REACHED, print_json, stop_on_interrupt};
use super::progress::RunProgress;
use super::run::run_failure;
use super::run_args::RunFolderArgs;
use super::run_folder::run_folder;
use upm_runner::run::{Extent, PacingStats, Verification, maker, maker_of, verify as verify_run};

/// Most characters shown of a line that differs.
const SHOWN: usize = 160;

pub(super) fn verify(args: &RunFolderArgs, common: Common) -> Result<u8, Failure> {
    let run = run_folder(args)?;
    let stop = stop_on_interrupt();
    // at full speed: the repetition has no clock to keep up with
    let pacing = PacingStats::default();
    let mut progress = RunProgress::new(common, &pacing);
    let verdict = verify_run(&run, &stop, &mut progress);
    progress.finish();
    if stop.load(std::sync::atomic::Ordering::Relaxed) {
        return Ok(INTERRUPTED);
    }
    let verdict = verdict.map_err(|error| run_failure(&error))?;
    if common.json {
        print_json(&as_json(&run, &verdict))?
    } else {
        print_verdict(&run, &verdict)?
    }
    Ok(if matches!(verdict, Verification::Equal { .. }) { 0 } else { NOT_REACHED })
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
            outln!(
                "{run}: no report, so it was killed or still runs; equal byte for byte as far as it goes, {lines} lines"
            )
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
