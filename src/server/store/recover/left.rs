use std::fs;
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use serde_json::Value;

use crate::store::salvage::{modified, text_of};
use crate::store::{
    BY_THE_DAEMON, JobEnd, JobRow, JobState, Mended, RecordingKept, Recovery, RepairRecording, RunFileFault,
    open_run_file,
};
use upm_core::time::PlateTime;

/// How a text begins, in a journal and in a report, that tells of a recording which ended before its run did.
const ENDS_EARLY: &str = "\"the recording ends early: ";

/// Bytes of a journal that are looked through at a time.
const BLOCK_BYTES: u64 = 1 << 20;

/// Repairs the recording in a run folder where that is needed, and tells what there is of it now. One that is no regular
/// file stays as it is.
pub(super) fn settle(folder: &Path, job: &JobRow, repair: RepairRecording<'_>, found: &mut Recovery) -> RecordingKept {
    let (part, whole) = (folder.join("run.rrd.part"), folder.join("run.rrd"));
    let repaired = match open_run_file(folder, "run.rrd.part").map(drop) {
        Err(RunFileFault::Missing) if whole.exists() => return closed(folder, job.recording),
        Err(RunFileFault::Missing) => return RecordingKept::None,
        Err(fault) => Err(format!("run.rrd.part: {fault}")),
        // what reads damaged files may stumble over them; a start must not
        Ok(()) => catch_unwind(AssertUnwindSafe(|| repair(&part, &whole)))
            .unwrap_or_else(|_| Err("the repair failed on it".to_owned())),
    };
    let kept = match &repaired {
        Ok(Mended { was_whole: true, .. }) => closed(folder, job.recording),
        Ok(_) => RecordingKept::Recovered,
        Err(_) => RecordingKept::Partial,
    };
    if repaired.is_ok() && part.exists() {
        // repaired into another file; one that stays is repaired once more
        let _ = fs::remove_file(&part);
    }
    found.repaired.push((whole, repaired));
    kept
}

/// What a file is that has its end, by what was known of it before this start.
fn closed(folder: &Path, known: RecordingKept) -> RecordingKept {
    match known {
        RecordingKept::None if ends_early(folder) => RecordingKept::Stopped,
        RecordingKept::None => RecordingKept::Whole,
        // a start that was killed may have given it that end
        RecordingKept::Partial | RecordingKept::Failed => RecordingKept::Recovered,
        kept => kept,
    }
}

/// True when the report, or the journal of a run that came to none, tells that the recording ended before the run did.
fn ends_early(folder: &Path) -> bool {
    let report = text_of(&folder.join("report.json"));
    report.map_or_else(|| journal_tells(folder), |report| report.contains(ENDS_EARLY))
}

/// A journal may be long. One that cannot be read tells nothing.
fn journal_tells(folder: &Path) -> bool {
    let Ok(mut file) = open_run_file(folder, "journal.jsonl") else { return false };
    let mut seen = Vec::new();
    loop {
        // it may lie across two blocks
        seen.drain(..seen.len().saturating_sub(ENDS_EARLY.len() - 1));
        match (&mut file).take(BLOCK_BYTES).read_to_end(&mut seen) {
            Ok(0) | Err(_) => return false,
            Ok(_) if seen.windows(ENDS_EARLY.len()).any(|bytes| bytes == ENDS_EARLY.as_bytes()) => return true,
            Ok(_) => {}
        }
    }
}

/// How a job ended that was running: as its report says, if it had come so far.
pub(super) fn end_of(folder: Option<&Path>, recording: RecordingKept) -> JobEnd {
    let report_json = folder.and_then(|folder| text_of(&folder.join("report.json")));
    let report: Option<Value> = report_json.as_deref().and_then(|text| serde_json::from_str(text).ok());
    let text = |key: &str| report.as_ref().and_then(|report| report.get(key)).and_then(Value::as_str);
    let at_s = report.as_ref().and_then(|report| report.get("plate_time_s")).and_then(Value::as_f64);
    let at = PlateTime::from_secs(at_s.unwrap_or_default());
    let reason = text("reason").unwrap_or_default();
    match text("outcome").and_then(JobState::of_name).filter(|state| state.is_final()) {
        Some(outcome) => {
            let by_daemon = outcome == JobState::Cancelled && reason == BY_THE_DAEMON;
            let state = if by_daemon { JobState::Interrupted } else { outcome };
            JobEnd { at, state, reason: reason.to_owned(), report_json, recording }
        }
        None => JobEnd {
            at,
            state: JobState::Interrupted,
            reason: "the daemon ended while it ran".to_owned(),
            report_json: None,
            recording,
        },
    }
}

/// When a run last wrote anything that is known to come late.
pub(super) fn last_sign(folder: &Path) -> Option<jiff::Timestamp> {
    ["report.json", "journal.jsonl", "effective.json"].iter().find_map(|name| modified(&folder.join(name)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_recording::ENDED_EARLY;

    #[test]
    fn journal_and_report_tell_of_a_recording_that_ends_early() {
        let folder = tempfile::tempdir().unwrap();
        let journal = folder.path().join("journal.jsonl");
        assert!(!ends_early(folder.path()));
        let told = format!("\"text\":\"{ENDED_EARLY}stopped, the disk is nearly full\"");
        let block = BLOCK_BYTES as usize;
        for before in [0, block - told.len() / 2, block - 8, block, 2 * block + 5] {
            fs::write(&journal, ["x".repeat(before), told.clone(), "x".repeat(99)].concat()).unwrap();
            assert!(ends_early(folder.path()), "{before} bytes before it");
        }
        fs::write(folder.path().join("report.json"), "{}").unwrap();
        assert!(!ends_early(folder.path()), "the report knows better");
        let report = format!("{{\n  \"warnings\": [\n    \"{ENDED_EARLY}no space\"\n  ]\n}}");
        fs::write(folder.path().join("report.json"), report).unwrap();
        assert!(ends_early(folder.path()));
    }
}
