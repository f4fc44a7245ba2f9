use std::fs::File;
use std::io::ErrorKind;
use std::path::Path;

use bytes::Bytes;

use crate::plates::Plates;
use crate::service::{Recording, Refusal};
use crate::store::{JobRow, JobState, RecordingKept};

/// The newest picture of a job that is on a plate.
pub(super) fn picture(plates: &Plates, row: &JobRow) -> Result<Bytes, Refusal> {
    let plate = plates.get(&row.plate).filter(|plate| plate.snapshot().job == Some(row.id));
    let plate = plate.ok_or_else(|| Refusal::Unknown("there are pictures of a job only while it runs".to_owned()))?;
    let none_yet = || Refusal::Busy { why: "there is no picture yet".to_owned(), retry_after_s: 1 };
    plate.picture().map(|picture| Bytes::copy_from_slice(&picture.png)).ok_or_else(none_yet)
}

/// The recording of a job that has ended, opened.
pub(super) fn recording(runs: &Path, row: &JobRow) -> Result<Recording, Refusal> {
    let none = |why: &str| Err(Refusal::Unknown(why.to_owned()));
    match (row.state, row.recording) {
        (JobState::Queued, _) => none("the job has not begun"),
        (JobState::Running, _) => Err(Refusal::Conflict("the recording is still being written".to_owned())),
        (_, RecordingKept::None) => none("the job was not recorded"),
        (_, RecordingKept::Partial) => none("the recording was not closed and could not be repaired"),
        (_, RecordingKept::Failed) => none("the recording could not be written"),
        (_, RecordingKept::Pruned) => none("the recording was deleted to make room"),
        (_, RecordingKept::Whole | RecordingKept::Recovered | RecordingKept::Stopped) => open(runs, row),
    }
}

fn open(runs: &Path, row: &JobRow) -> Result<Recording, Refusal> {
    let opened = || {
        let file = File::open(runs.join(row.folder.as_deref().unwrap_or_default()).join("run.rrd"))?;
        let bytes = file.metadata()?.len();
        Ok(Recording { file, bytes, name: format!("{}.rrd", row.name) })
    };
    opened().map_err(|error: std::io::Error| {
        if error.kind() == ErrorKind::NotFound {
            return Refusal::Unknown("the recording is gone".to_owned());
        }
        tracing::error!(job = %row.id, "the recording cannot be read: {error}");
        Refusal::Broken("the recording cannot be read".to_owned())
    })
}
