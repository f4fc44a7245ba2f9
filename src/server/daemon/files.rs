use std::fs::File;
use std::path::Path;

use bytes::Bytes;

use super::convert;
use crate::api::{CameraPicture, LayoutView, Recording, Refusal};
use crate::store::{JobRow, JobState, RecordingStatus, RunFileFault, open_run_file};
use crate::supervisor::PlateSupervisor;

/// The newest picture of a job that is on a plate.
pub(super) fn picture(plates: &PlateSupervisor, row: &JobRow) -> Result<CameraPicture, Refusal> {
    let plate = plates.get(&row.plate).filter(|plate| plate.snapshot().job == Some(row.id));
    let plate = plate.ok_or_else(|| Refusal::Unknown("there are pictures of a job only while it runs".to_owned()))?;
    let none_yet = || Refusal::Busy { why: "there is no picture yet".to_owned(), retry_after_s: 1 };
    let (picture, age) = plate.picture().ok_or_else(none_yet)?;
    Ok(CameraPicture { png: Bytes::copy_from_slice(&picture.png), age })
}

/// The layout of a job that is on a plate.
pub(super) fn layout(plates: &PlateSupervisor, row: &JobRow) -> Result<LayoutView, Refusal> {
    let plate = plates.get(&row.plate).filter(|plate| plate.snapshot().job == Some(row.id));
    let plate = plate.ok_or_else(|| Refusal::Unknown("there is a layout of a job only while it runs".to_owned()))?;
    let none_yet = || Refusal::Busy { why: "the job is being read".to_owned(), retry_after_s: 1 };
    plate.layout(&row.id).map(|layout| convert::layout(&layout)).ok_or_else(none_yet)
}

/// The journal of a job, opened; `None` until there is one, and once its run folder is deleted.
pub(super) fn journal(runs: &Path, row: &JobRow) -> Option<File> {
    open_run_file(&runs.join(row.folder.as_deref()?), "journal.jsonl").ok()
}

/// The recording of a job that has ended, opened. Waits for the disk.
pub(super) fn recording(runs: &Path, row: &JobRow) -> Result<Recording, Refusal> {
    let none = |why: &str| Err(Refusal::Unknown(why.to_owned()));
    match (row.state, row.recording) {
        (JobState::Queued, _) => none("the job has not begun"),
        (JobState::Running, _) => Err(Refusal::Conflict("the recording is still being written".to_owned())),
        (_, RecordingStatus::None) => none("the job was not recorded"),
        (_, RecordingStatus::Pruned) => none("the recording was deleted to make room"),
        // the part written before the failure may be there
        (_, RecordingStatus::Failed) => open(runs, row, "the recording could not be written"),
        (_, RecordingStatus::Whole | RecordingStatus::Partial) => open(runs, row, "the recording is gone"),
    }
}

/// The opened file; a missing one is refused with `none` as the sentence.
fn open(runs: &Path, row: &JobRow, none: &str) -> Result<Recording, Refusal> {
    let opened = || {
        let folder = row.folder.as_deref().ok_or(RunFileFault::Missing)?;
        let file = open_run_file(&runs.join(folder), "run.rrd")?;
        let bytes = file.metadata()?.len();
        Ok(Recording { file, bytes, name: format!("{}.rrd", row.name) })
    };
    opened().map_err(|fault| match fault {
        RunFileFault::Missing => Refusal::Unknown(none.to_owned()),
        RunFileFault::NotRegular => Refusal::Conflict(format!("the recording is not served: {fault}")),
        RunFileFault::Io(error) => {
            tracing::error!(job = %row.id, "the recording cannot be read: {error}");
            Refusal::Broken("the recording cannot be read".to_owned())
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{JobId, Pace};

    fn row(recording: RecordingStatus) -> JobRow {
        JobRow {
            id: JobId::parse("019a0000000070008000000000000001").unwrap(),
            name: "rest".to_owned(),
            plate: "left".to_owned(),
            state: JobState::Completed,
            seed: 1,
            pace: Pace::Max,
            rig_fingerprint: String::new(),
            submitted_at: jiff::Timestamp::UNIX_EPOCH,
            started_at: None,
            finished_at: None,
            progress: 1.0,
            reason: String::new(),
            report_json: None,
            folder: Some("rest-1".to_owned()),
            recording,
            standing: false,
            turn: 0,
        }
    }

    #[test]
    fn failed_or_partial_recording_serves_available_bytes() {
        let runs = tempfile::tempdir().unwrap();
        let recording_bytes = |kept| recording(runs.path(), &row(kept)).map(|found| found.bytes);
        let gone = |why: &str| Err(Refusal::Unknown(why.to_owned()));
        assert_eq!(recording_bytes(RecordingStatus::Failed), gone("the recording could not be written"));
        assert_eq!(recording_bytes(RecordingStatus::Whole), gone("the recording is gone"));
        std::fs::create_dir(runs.path().join("rest-1")).unwrap();
        std::fs::write(runs.path().join("rest-1/run.rrd"), "RRF2").unwrap();
        let kept = [RecordingStatus::Failed, RecordingStatus::Partial, RecordingStatus::Whole];
        assert_eq!(kept.map(recording_bytes), [Ok(4), Ok(4), Ok(4)]);
        std::fs::rename(runs.path().join("rest-1/run.rrd"), runs.path().join("elsewhere")).unwrap();
        std::os::unix::fs::symlink("../elsewhere", runs.path().join("rest-1/run.rrd")).unwrap();
        assert!(
            matches!(recording_bytes(RecordingStatus::Whole), Err(Refusal::Conflict(_))),
            "a link leaves the folder"
        );
        assert_eq!(recording_bytes(RecordingStatus::Pruned), gone("the recording was deleted to make room"));
    }
}
