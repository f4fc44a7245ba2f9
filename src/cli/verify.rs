use std::io::IsTerminal;

use super::args::{Common, RunFolderArgs};
use super::failure::Failure;
use super::progress::RunProgress;
use super::run::run_failure;
use super::{INTERRUPTED, NOT_REACHED, stop_on_interrupt};
use crate::run::{Verdict, VerifyError, verify as verify_run};

/// Characters of a differing line that are shown.
const SHOWN: usize = 160;

pub(super) fn verify(args: &RunFolderArgs, common: Common) -> Result<u8, Failure> {
    let stop = stop_on_interrupt();
    let mut progress = RunProgress::new(common.quiet || !std::io::stderr().is_terminal());
    let verdict = verify_run(&args.run, &stop, &mut progress);
    progress.finish();
    if stop.load(std::sync::atomic::Ordering::Relaxed) {
        return Ok(INTERRUPTED);
    }
    match verdict.map_err(failure)? {
        Verdict::Equal { lines } => {
            say!("{}: the repetition's journal is equal byte for byte, {lines} lines", args.run.display());
            Ok(0)
        }
        Verdict::Differs { line, recorded, repeated } => {
            say!("{}: journals differ from line {line} on", args.run.display());
            say!("  recorded: {}", shown(&recorded));
            say!("  repeated: {}", shown(&repeated));
            Ok(NOT_REACHED)
        }
    }
}

fn failure(error: VerifyError) -> Failure {
    match error {
        VerifyError::Read { .. } => Failure::bad_input(error.to_string()),
        VerifyError::Job(faults) => Failure::faults(faults),
        VerifyError::Run(error) => run_failure(&error),
    }
}

fn shown(line: &str) -> String {
    line.chars().take(SHOWN).collect()
}
