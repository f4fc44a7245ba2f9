use std::path::Path;

use serde_json::{Value, json};

use super::args::Common;
use super::output::{Failure, INTERRUPTED, NOT_REACHED, print_json, stop_on_interrupt};
use super::progress::RunProgress;
use super::run::run_failure;
use super::run_args::RunFolderArgs;
use super::run_folder::run_folder;
use upm_runner::run::{PacingStats, Verification, verify as verify_run};

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
        print_json(&as_json(&verdict))?
    } else {
        print_verdict(&run, &verdict)?
    }
    Ok(if matches!(verdict, Verification::Differs { .. }) { NOT_REACHED } else { 0 })
}

fn as_json(verdict: &Verification) -> Value {
    match verdict {
        Verification::Equal { lines, stopped } => json!({ "equal": true, "lines": lines, "stopped": stopped }),
        Verification::Differs { line, recorded, repeated } => {
            json!({ "equal": false, "line": line, "recorded": recorded, "repeated": repeated })
        }
    }
}

fn print_verdict(run: &Path, verdict: &Verification) -> Result<(), Failure> {
    let run = run.display();
    match verdict {
        Verification::Equal { lines, stopped: false } => {
            outln!("{run}: the repetition's journal is equal byte for byte, {lines} lines")
        }
        Verification::Equal { lines, stopped: true } => {
            outln!("{run}: stopped from outside; equal byte for byte up to there, {lines} lines")
        }
        Verification::Differs { line, recorded, repeated } => {
            outln!("{run}: journals differ from line {line} on")?;
            outln!("  recorded: {}", shown(recorded))?;
            outln!("  repeated: {}", shown(repeated))
        }
    }
}

fn shown(line: &str) -> String {
    line.chars().take(SHOWN).collect()
}
